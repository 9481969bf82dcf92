"""What only the CPU rasteriser has: threads, scratch memory that grows, compiled loops on disk."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rastercov import shapes
from rastercov.camera import Camera
from rastercov.errors import ConfigError, DeviceError, ResourceError
from rastercov.mesh import Mesh
from rastercov.pose import look_at, sphere_of_poses
from rastercov.raster import canary, kernels
from rastercov.raster.contract import open_rasterizer
from rastercov.raster.cpu import MAX_SIDE, CPURasterizer

CAMERA = Camera(width=160, height=120, fx=140, fy=150)


def count(mesh, poses, **options):
    with CPURasterizer(mesh, CAMERA, **options) as rasterizer:
        return rasterizer.count(poses)


@pytest.mark.parametrize("threads", [1, 2, 5, 64])
def test_threads_change_nothing(threads):
    mesh = shapes.teapot(5)
    poses = sphere_of_poses(mesh.bounds.mean(axis=0), 0.5, 37)
    one, many = count(mesh, poses, threads=1), count(mesh, poses, threads=threads)
    assert np.array_equal(one.visible, many.visible)
    assert np.array_equal(one.drawn, many.drawn)


def test_a_pose_counts_alike_alone_and_among_others():
    # Views from inside clip hundreds of faces, views from outside none: scratch memory grows in
    # the middle of a batch, and no pose may be counted twice or left out for it.
    mesh = shapes.room(20)
    rng = np.random.default_rng(5)
    eyes = mesh.bounds.mean(axis=0) + rng.uniform(-1, 1, (12, 3))
    eyes[::3] *= 40
    poses = look_at(eyes, eyes + rng.normal(size=(12, 3)))
    together = count(mesh, poses, threads=1)
    for row, pose in enumerate(poses):
        alone = count(mesh, pose)
        assert np.array_equal(alone.visible[0], together.visible[row])
        assert np.array_equal(alone.drawn[0], together.drawn[row])
    samples = CAMERA.width * CAMERA.height
    assert (together.visible.sum(axis=1) + together.background == samples).all()


def test_faces_larger_than_the_lists_are_listed():
    # Four triangles that each touch all tiles: more entries than faces.
    corners = np.array([(-9, -9, 2), (9, -9, 2), (0, 18, 2)], float)
    mesh = Mesh(
        vertices=np.concatenate([corners * scale for scale in (1, 2, 3, 4)]),
        faces=np.arange(12).reshape(4, 3),
    )
    counts = count(mesh, np.eye(4))
    assert counts.visible.tolist() == [[CAMERA.width * CAMERA.height, 0, 0, 0]]
    assert counts.drawn.tolist() == [[CAMERA.width * CAMERA.height] * 4]


@given(st.lists(st.integers(-(2**31), 2**31), min_size=4, max_size=4), st.integers(-10, 10))
@settings(max_examples=300)
def test_an_edge_gives_the_first_sample_at_its_right(ends, row):
    # ceil((X - 128) / 256) in whole numbers, on this row and, by the stride, on the next.
    xa, ya, xb, yb = (end >> 3 for end in ends)
    ya, yb = min(ya, yb), max(ya, yb) + 1
    row += (ya + yb) >> 9
    divisor = (yb - ya) << 8

    def first(at):
        numerator = (xa - 128) * (yb - ya) + (xb - xa) * (at * 256 + 128 - ya)
        return -(-numerator // divisor)

    sample, rest, stride, stride_rest, found = kernels.edge(xa, ya, xb, yb, row)
    assert (sample, found) == (first(row), divisor)
    rest += stride_rest
    assert sample + stride + (rest >= divisor) == first(row + 1)


@given(st.data())
@settings(max_examples=500)
def test_division_in_floats_is_put_right_in_whole_numbers(data):
    # Exact multiples are where the rounded product falls on either side.
    divisor = data.draw(st.integers(1, 2**22)) << 8
    most = 2**60 // divisor
    quotient = data.draw(st.integers(-min(most, 2**31), min(most, 2**31)))
    rest = data.draw(st.sampled_from((0, 1, divisor // 2, divisor - 1)))
    numerator = quotient * divisor + rest
    assert kernels.divide(numerator, divisor, 1.0 / divisor) == (quotient, rest)


def test_no_scene_reaches_past_the_scratch_memory(tmp_path):
    checked = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    script = Path(__file__).with_name("hostile_scenes.py")
    done = subprocess.run(
        [sys.executable, script, "1500"],
        env=os.environ | checked,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_no_scene_reaches_past_the_scratch_memory_when_rolled(tmp_path):
    code = """
import numpy as np
from hostile_scenes import scene
from rastercov.raster.cpu import CPURasterizer
rng = np.random.default_rng(1)
for _ in range(500):
    mesh, camera, poses, scale = scene(rng)
    roll = rng.uniform(-2, 2)
    with CPURasterizer(mesh, camera, threads=1, supersample=scale, roll=roll) as rasterizer:
        both, alone = rasterizer.count(poses), rasterizer.count(poses, drawn=False)
    assert np.array_equal(both.visible, alone.visible)
    assert (both.visible >= 0).all() and (both.visible <= both.drawn).all()
    assert (both.background >= 0).all()
"""
    checked = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    tests = {"PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | checked | tests,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_a_compiler_that_errs_is_not_trusted(monkeypatch):
    monkeypatch.setattr(canary, "VISIBLE", canary.VISIBLE + 1)
    with pytest.raises(DeviceError, match="cannot be trusted"):
        CPURasterizer(shapes.box(), CAMERA)


def test_an_interrupt_ends_the_count_within_a_turn(monkeypatch):
    turns_taken = []
    count_poses = kernels.count_poses

    def interrupted(*args):
        turns_taken.append(1)
        if len(turns_taken) == 3:
            raise KeyboardInterrupt
        return count_poses(*args)

    poses = sphere_of_poses((0, 0, 0), 4, 4000)
    with CPURasterizer(shapes.box(), CAMERA, threads=2) as rasterizer:
        monkeypatch.setattr(kernels, "count_poses", interrupted)
        with pytest.raises(KeyboardInterrupt):
            rasterizer.count(poses)
        assert len(turns_taken) < 100  # of 250
        monkeypatch.undo()
        assert rasterizer.count(poses[:3]).visible.any()


def test_closed_rasteriser_says_so():
    rasterizer = CPURasterizer(shapes.box(), CAMERA)
    rasterizer.close()
    rasterizer.close()
    for call in (rasterizer.count, rasterizer.render):
        with pytest.raises(DeviceError, match="closed"):
            call(np.eye(4))


def test_limits_are_refused_before_anything_is_allocated():
    with pytest.raises(ResourceError, match="1,048,576"):
        CPURasterizer(shapes.box(), Camera(width=131072, height=8, fx=1, fy=1), supersample=9)
    large = Camera(width=131072, height=131072, fx=1, fy=1)
    with pytest.raises(ResourceError, match="1,048,576 samples, got 1,202,"):
        CPURasterizer(shapes.box(), large, supersample=7, roll=0.4)
    assert MAX_SIDE * kernels.STEPS <= kernels.FAR_OUT
    for threads in (0, -1, True):
        with pytest.raises(ConfigError, match="threads"):
            CPURasterizer(shapes.box(), CAMERA, threads=threads)


def test_auto_is_the_cpu_without_hardware_and_opengl_when_its_options_are_given(device):
    with open_rasterizer(shapes.box(), CAMERA) as rasterizer:
        assert rasterizer.info.backend == "cpu"
    with open_rasterizer(shapes.box(), CAMERA, device=device) as rasterizer:
        assert rasterizer.info.backend == "gl"


def test_it_runs_without_a_graphics_library_or_a_place_to_keep_compiled_loops(tmp_path):
    # A locator that finds nowhere to write is what a read-only installation gives.
    code = """
import sys
sys.modules["moderngl"] = None
from numba.core import caching
caching.CacheImpl._locator_classes = []
import numpy as np, rastercov as rc
from rastercov import shapes
with rc.open_rasterizer(shapes.box(), rc.Camera(width=8, height=8, fx=8, fy=8), "cpu") as r:
    print(int(r.count(rc.look_at((0, 0, 3), (0, 0, 0))).visible.sum()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"HOME": str(tmp_path / "missing")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 0
    assert "compiling" in done.stderr
