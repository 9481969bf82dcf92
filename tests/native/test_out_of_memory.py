"""Memory that runs out in C++ is a ResourceError that says at what, and objects go on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS")

PROGRAM = """
import resource, sys
import numpy as np
import rastercov as rc
from rastercov.core.area.regions import RegionPass
from rastercov.core.coverage.task import Engine
from rastercov.core.coverage.exact_pass import ExactPass, room_for
from rastercov.core.exact.surface import surface_of
from rastercov.engine import solver_parts
from rastercov.core.mesh import shapes

MEBIBYTE = 1 << 20
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
POSES = rc.look_at([(0, -4.0, 1), (3, 1, 2), (1, 3, -2)], [(0, 0, 0)] * 3)
said = []

def starved(call):
    '''Result of a call that gets ever more memory, from 1 MiB on, until it suffices.'''
    room = MEBIBYTE
    while True:
        with open("/proc/self/statm") as file:
            taken = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + room, resource.RLIM_INFINITY))
        error = None
        try:
            found = call()
        except MemoryError as raised:
            error = type(raised).__name__, str(raised)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        if error is None:
            return found
        if error[0] == "ResourceError":  # else: of numpy
            said.append(error[1])
        room = room * 5 // 4

def mesh_of(n):
    whole = shapes.torus(n, n // 2)
    mesh = rc.Mesh(whole.vertices, whole.faces)
    mesh.can_cull_back_faces, mesh.opaque.welded_faces  # numpy may crash where memory runs out
    return mesh

def surface(call, n):
    mesh = mesh_of(2 * n)
    return call(lambda: np.array(solver_parts.edges(surface_of(mesh))[1]))

def observed(call, n, method):
    mesh, poses = mesh_of(n), rc.Poses.of(POSES)
    surface_of(mesh)
    solvers, seen = ExactPass(mesh, CAMERA, Engine(method, threads=1)), room_for(3, mesh.n_faces)
    call(lambda: solvers.observe(poses, seen))
    return np.concatenate([seen.visible_pixels, seen.area_error], axis=None)

def regions(call, n):
    mesh = mesh_of(n)
    RegionPass(mesh, CAMERA, threads=1).find(rc.Poses.of(POSES))
    finder = RegionPass(mesh, CAMERA, threads=1)
    found = call(lambda: finder.find(rc.Poses.of(POSES)))
    return np.concatenate([found.area, found.bound, found.xy], axis=None)

def united(call, n):
    mesh = mesh_of(n)
    found, union = rc.regions(mesh, CAMERA, POSES, threads=1), rc.RegionUnion(mesh, 2)
    call(lambda: union.add(found))
    return np.concatenate([union.covered().area, union.covered().bound], axis=None)

def counted(call, n):
    mesh = mesh_of(2 * n)
    def count():
        with rc.open_rasterizer(mesh, CAMERA, "cpu", threads=1) as rasterizer:
            counts = rasterizer.count(POSES)
        return np.stack([counts.visible, counts.drawn])
    return call(count)

which, *more = sys.argv[1].split()
job = globals()[which]
job(lambda call: call(), 20, *more)  # what Python loads and keeps
found = job(starved, 200, *more)
assert np.array_equal(found, job(lambda call: call(), 200, *more), equal_nan=True)
for line in said:
    print(line)
"""
JOBS = {
    "surface": "Build the surface of a mesh",
    "observed certified": "Compute figures of poses",
    "observed exact": "Compute figures of poses",
    "regions": "Find regions of poses",
    "united": "Add regions",
    "counted": None,  # memory is of numpy, whose errors are its own, or of a worker
}


@pytest.mark.parametrize("job", JOBS)
def test_memory_that_runs_out_is_one_line_and_the_object_goes_on(job):
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, job], capture_output=True, text=True, check=False,
        env=os.environ | {
            "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "65536",
        },
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert lines or JOBS[job] is None
    # Contacts of faces are found when they are first asked for.
    asked = JOBS[job] or "", "Faces in contact" if JOBS[job] else ""
    begin = tuple(f'expected memory for "{what}' for what in asked)
    end = "; pass less at once or free memory"
    assert [line for line in lines if not (line.startswith(begin) and line.endswith(end))] == []
