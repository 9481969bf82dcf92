"""The library of C: its example and its figures beside those of Python, its tests in C++."""

import ctypes
import math
import re
import resource
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_cameras import CAMERAS as LENSES
from mesh_files import VALID
from summed import sums_of

import rastercov as rc
from rastercov.base.errors import MeshError, ResourceError
from rastercov.core.area.table import take_rows
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.projection import view_border
from rastercov.placement import NearestSurface, in_solid
from rastercov.report.packed_lens import pack_lens

ROOT = Path(__file__).parents[2]
LIBRARY, HEADERS = ROOT / "build/lib/librastercov.so", ROOT / "build/include"
TESTS = ROOT / "build/c/tests"
pytestmark = pytest.mark.skipif(not LIBRARY.exists(), reason="no build/lib; run: make lib")
ZIG = [sys.executable, "-m", "ziglang", "cc", "-O1"]
COMPILERS = {"gcc": ["gcc"], "clang": ["clang"], "zig": ZIG}
"""Commands of compilers of C; that of Zig is a clang, which compiles a sanitizer without -O1."""


def has_compiler(name):
    if name == "zig":
        run_result = subprocess.run(
            [*COMPILERS[name][:3], "version"], capture_output=True, check=False
        )
        return run_result.returncode == 0
    return shutil.which(name) is not None


CAMERA_FIELDS = ("width", "height", "fx", "fy", "cx", "cy", "near")
FIGURES = ("visible", "area", "area_error", "is_certified")


class Camera(ctypes.Structure):
    _fields_ = [("size", ctypes.c_int32), *((name, ctypes.c_double) for name in CAMERA_FIELDS),
                ("lens", ctypes.c_void_p), ("is_parallel", ctypes.c_int32)]  # fmt: skip


OPTICS = ("width", "height", "fx", "fy", "cx", "cy", "skew", "max_angle_deg")


class Optics(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_double) for name in OPTICS), ("model", ctypes.c_int32)]


class Task(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_double)
        for name in ("min_depth", "max_depth", "max_incidence_deg", "min_pixel_density",
                     "min_facing_density", "min_pixels_per_m2")
    ]  # fmt: skip


class Gate(ctypes.Structure):
    _fields_ = [("k", ctypes.c_int32), ("needs", ctypes.c_void_p), ("least_deg", ctypes.c_double),
                ("most_deg", ctypes.c_double), ("most_deviation", ctypes.c_double),
                ("noise", ctypes.c_void_p), ("stripes", ctypes.c_void_p)]  # fmt: skip


def c_gate(gate):
    """A gate of a rig, and the arrays that it refers to."""
    needs, stripes = (
        np.isin(np.arange(gate.n), rows).astype(np.uint8) for rows in (gate.needs, gate.stripes)
    )
    noise = np.array(gate.noise, float)
    limits = gate.least_deg, gate.most_deg, gate.most_deviation
    arrays = needs, noise, stripes
    places = [each.ctypes.data if len(each) else None for each in arrays]
    return Gate(gate.k, places[0], *limits, *places[1:]), arrays


class Figures(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in FIGURES]


class Lit(ctypes.Structure):
    _fields_ = [("size", ctypes.c_int32),
                *((name, ctypes.c_void_p) for name in ("lit", "whole", "bound"))]  # fmt: skip


class Search(ctypes.Structure):
    _fields_ = [("size", ctypes.c_int32), ("most", ctypes.c_int32), ("least", ctypes.c_double),
                ("n_given", ctypes.c_int64), ("n_faces", ctypes.c_int64),
                ("views", ctypes.c_void_p)]  # fmt: skip


class Library:
    """The functions of rastercov.h; a code that is not 0 is a RuntimeError with the text."""

    def __init__(self):
        self._own = ctypes.CDLL(str(LIBRARY))
        self._own.rc_last_error.restype = ctypes.c_char_p
        self._own.rc_task_default.restype = Task

    def call(self, name, *arguments):
        converted = [
            ctypes.c_void_p(each.ctypes.data) if isinstance(each, np.ndarray)
            else ctypes.c_int64(each) if isinstance(each, int)
            else each
            for each in arguments
        ]  # fmt: skip
        if code := getattr(self._own, name)(*converted):
            raise RuntimeError(f"{code}: {self._own.rc_last_error().decode()}")

    def make(self, name, *arguments):
        handle = ctypes.c_void_p()
        self.call(name, *arguments, ctypes.byref(handle))
        return handle

    def task(self):
        return self._own.rc_task_default()

    def surface(self, mesh):
        roles = np.array(
            [each.is_occluder + 2 * each.is_target + 4 * each.is_two_sided for each in mesh.groups],
            np.uint8,
        )[mesh.face_group]  # fmt: skip
        return self.make(
            "rc_surface_create", np.ascontiguousarray(mesh.vertices), mesh.n_vertices,
            mesh.faces.astype(np.int32), mesh.n_faces, roles,
        )  # fmt: skip


@pytest.fixture(scope="module")
def library():
    return Library()


def c_camera(camera):
    fields = (getattr(camera, name) for name in CAMERA_FIELDS)
    return Camera(ctypes.sizeof(Camera), *fields, None, camera.is_parallel)


CAMERA = rc.Camera(width=640, height=480, fx=800, fy=800, cx=320, cy=240)
PARALLEL = rc.Camera.orthographic(width=640, height=480, px_per_m=250)


LIMITS = {"max_incidence_deg": 70.0, "min_facing_density": 170.0, "min_pixels_per_m2": 9e3}


def c_task(library, task, camera):
    """Thresholds of a task, and depths of a camera in focus."""
    own = library.task()
    for name in (*LIMITS, "min_pixel_density"):
        setattr(own, name, getattr(task, name))
    own.min_depth, own.max_depth = camera.focus_range or (0.0, math.inf)
    return own


def some_limits(rng):
    """A task with some of the thresholds."""
    return rc.Task(**{name: value for name, value in LIMITS.items() if rng.random() < 0.5})


def said_by(name, example, folder):
    """Lines of an example by a compiler."""
    if not has_compiler(name):
        pytest.skip(f"no {name} to compile with")
    program, source = folder / example, ROOT / f"examples/c/{example}.c"
    assert len(source.read_text().splitlines()) < 60
    subprocess.run(
        [*COMPILERS[name], "-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", str(source),
         f"-I{HEADERS}", str(LIBRARY), f"-Wl,-rpath,{LIBRARY.parent}", "-o", str(program)],
        check=True,
    )  # fmt: skip
    return subprocess.run([program], capture_output=True, text=True, check=True).stdout.splitlines()


def test_the_example_of_choice_prints_what_python_computes(tmp_path):
    mesh, row = rc.shapes.box((1, 1, 1), centre=(0.5, 0.5, 0.5)), np.arange(8)
    eyes = np.stack((row % 3 * 3 - 2.5, row // 3 * 4 - 3.5, 2 + row % 2), axis=-1)
    poses = rc.look_at(eyes, (0.5, 0.5, 0.5))
    regions, need, rows, lines = rc.regions(mesh, CAMERA, poses, rc.Task()), np.ones(12), [], []
    for _ in range(2):
        worth = [worth_of(regions, [*rows, other], need) for other in row]
        gain = max(worth) - worth_of(regions, rows, need)
        rows.append(int(np.argmax(np.array(worth) >= max(worth) - 1e-12)))
        lines.append(f"camera {rows[-1]} adds {gain:.9f} m2")
    lit = rc.sunlit(mesh, [(-0.001, -0.416, 0.909)]).part_energy[0]
    lines.append(f"the sun lights {lit:.9f} m2 across its rays")
    compiler = next((name for name in COMPILERS if has_compiler(name)), "gcc")
    assert said_by(compiler, "place", tmp_path) == lines


@pytest.mark.parametrize("name", COMPILERS)
def test_the_example_prints_what_python_computes(name, tmp_path):
    said = said_by(name, "coverage", tmp_path)
    lid = [(-0.2, -0.2, 1.5), (1.2, -0.2, 1.5), (1.2, 0.5, 1.5), (-0.2, 0.5, 1.5)]
    corners = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    sides = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5),
             (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7), (8, 9, 10), (8, 10, 11)]  # fmt: skip
    mesh = rc.Mesh(
        np.concatenate((corners, lid)), sides,
        [rc.Group("box"), rc.Group("lid", is_occluder=True)], [0] * 12 + [1] * 2,
    )  # fmt: skip
    poses = np.array(
        [[[1, 0, 0, 0.5], [0, -1, 0, 0.5], [0, 0, -1, 4], [0, 0, 0, 1]],
         [[-1, 0, 0, 0.5], [0, 0, -1, 4], [0, -1, 0, 0.5], [0, 0, 0, 1]]], float,
    )  # fmt: skip
    regions = rc.regions(mesh, CAMERA, poses, rc.Task())
    together = rc.unite(regions)
    areas = [regions.area[regions.pair_pose == row].sum() for row in range(2)]
    assert said == [
        *(f"camera {row} covers {area:.9f} m2" for row, area in enumerate(areas)),
        f"together they cover {together.area[0].sum():.9f} m2, "
        f"within {together.bound.sum():.1e} m2",
    ]


def scene(seed):
    """A torus, soup and squares, with roles; some poses around."""
    rng = np.random.default_rng(seed)
    ring = rc.shapes.torus(16, 8)
    soup = rng.uniform(-1, 1, (20, 3, 3))
    vertices = np.concatenate((ring.vertices, soup.reshape(-1, 3)))
    faces = np.concatenate((ring.faces, ring.n_vertices + np.arange(60).reshape(-1, 3)))
    groups = [rc.Group("a"), rc.Group("b", is_occluder=True), rc.Group("c", is_target=True),
              rc.Group("d", is_two_sided=True)]  # fmt: skip
    mesh = rc.Mesh(vertices, faces, groups, rng.integers(0, 4, len(faces)))
    eyes = rng.normal(size=(3, 3))
    eyes *= 4 / np.linalg.norm(eyes, axis=1)[:, None]
    return mesh, rc.look_at(eyes, np.zeros((3, 3)))


@given(seed=st.integers(0, 2**32 - 1), method=st.sampled_from(["certified", "exact"]),
       is_parallel=st.booleans())  # fmt: skip
@settings(max_examples=25, deadline=None)
def test_areas_of_c_and_of_python_are_equal_and_figures_agree_within_their_bounds(
    library, seed, method, is_parallel
):
    mesh, poses = scene(seed)
    seen_by = PARALLEL if is_parallel else CAMERA
    rng = np.random.default_rng(seed)
    seen_by = replace(seen_by, focus_range=(3.2, 4.3) if rng.random() < 0.5 else None)
    task = some_limits(rng) if rng.random() < 0.5 else rc.Task()
    shape = len(poses), mesh.n_faces
    surface = library.surface(mesh)
    solver = library.make("rc_solver_create", surface, int(method == "exact"), 2)
    visible, area, error = np.empty((3, *shape))
    certified, world = np.empty(shape, np.uint8), np.ascontiguousarray(poses)
    camera = c_camera(seen_by)
    figures = Figures(*(each.ctypes.data for each in (visible, area, error, certified)))
    library.call(
        "rc_observe", solver, ctypes.byref(camera), world, len(poses), None, None,
        ctypes.byref(figures),
    )  # fmt: skip
    with rc.open_observer(mesh, seen_by, method) as observer:
        seen = observer.observe(poses)
    assert np.abs(area - seen.drawn_pixels).max() <= 1e-6
    assert (np.abs(visible - seen.visible_pixels) <= error + seen.area_error + 1e-12).all()
    limits = c_task(library, task, seen_by)
    regions = library.make(
        "rc_find_regions", solver, ctypes.byref(camera), ctypes.byref(limits), world,
        len(poses), None, None,
    )  # fmt: skip
    union = library.make("rc_union_create", surface, 2)
    library.call("rc_union_add", union, regions)
    expected = rc.unite(rc.regions(mesh, seen_by, poses, task, method=method), views=2)
    areas, bounds = np.empty((2, mesh.n_faces))
    for views in (1, 2):
        library.call("rc_union_areas", union, views, mesh.n_faces, areas, bounds)
        np.testing.assert_array_equal(areas, expected.area[views - 1])
        np.testing.assert_allclose(bounds, expected.bound, rtol=1e-3, atol=1e-9)
    excess, sums = np.empty(mesh.n_faces), np.empty((3, 5))
    library.call("rc_union_excess", union, mesh.n_faces, excess)
    part = np.random.default_rng(seed).integers(-1, 3, mesh.n_faces).astype(np.int32)
    of_parts = part, np.array([1, 2, 1], np.int32)
    library.call("rc_union_sums", union, mesh.n_faces, part, 3, of_parts[1], sums)
    own = np.empty(mesh.n_faces)
    library.call("rc_surface_areas", surface, mesh.n_faces, own)
    faces = expected.area, np.array([bounds, excess]), own
    assert sums.tobytes() == (sums_of(*faces, *of_parts) + 0.0).tobytes()
    for name, handle in (("union", union), ("regions", regions), ("solver", solver),
                         ("surface", surface)):  # fmt: skip
        library.call(f"rc_{name}_free", handle)
        with pytest.raises(RuntimeError, match="2: expected a live handle"):
            library.call(f"rc_{name}_free", handle)


@given(seed=st.integers(0, 2**32 - 1), n_threads=st.integers(1, 3), is_fine=st.booleans())
@settings(max_examples=25, deadline=None)
def test_what_the_sun_lights_has_the_bits_of_python(library, seed, n_threads, is_fine):
    rng = np.random.default_rng(seed)
    mesh, _ = scene(seed)
    if seed % 3 == 0:  # closed, divided unevenly
        mesh = rc.shapes.by_name(("sphere", "torus", "box", "teapot-5")[seed // 3 % 4])
    n = int(rng.integers(1, 9))
    towards = rng.normal(size=(n, 3)) if is_fine else rng.integers(0, 3, (n, 3)) - 1.0
    towards[~towards.any(axis=1)] = 0, 0, 1  # among them those along walls
    towards *= 10.0 ** rng.integers(-3, 4, (n, 1))
    out = np.full((3, n, mesh.n_faces), -7.0)
    lit = Lit(ctypes.sizeof(Lit), *(each.ctypes.data for each in out))
    surface = library.surface(mesh)
    solver = library.make("rc_solver_create", surface, 0, ctypes.c_int32(n_threads))
    library.call("rc_sunlit", solver, towards, n, None, None, ctypes.byref(lit))
    areas, whole, bound = out
    assert ((areas >= 0) & (bound >= 0) & (areas <= whole + bound)).all()
    expected = rc.sunlit(mesh, towards)
    share = np.divide(areas, whole, np.zeros(areas.shape), where=whole > 0)
    np.testing.assert_array_equal(np.minimum(share, 1).sum(axis=0), expected.hours)
    np.testing.assert_array_equal(areas.sum(axis=0), expected.energy)
    np.testing.assert_allclose(bound.sum(axis=0), expected.energy_bound, rtol=1e-9, atol=1e-13)
    for kind, handle in (("solver", solver), ("surface", surface)):
        library.call(f"rc_{kind}_free", handle)


STOPPING = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


def test_sunlight_that_is_none_is_a_line_and_rows_before_a_stop_are_kept(library):
    mesh = rc.shapes.torus(520, 512)  # of which one direction is solved at a time
    n, out = 4, np.full((3, 4, mesh.n_faces), -7.0)
    solver = library.make("rc_solver_create", library.surface(mesh), 0, 1)
    lit = Lit(ctypes.sizeof(Lit), *(each.ctypes.data for each in out))
    towards, asked = np.tile((0.1, 0.2, 0.3), (n, 1)), []
    go_on = STOPPING(lambda _: asked.append(1) or len(asked) < n)
    with pytest.raises(RuntimeError, match="4: stopped by the callback"):
        library.call("rc_sunlit", solver, towards, n, go_on, None, ctypes.byref(lit))
    is_there = (out != -7).all(axis=(0, 2))
    assert 0 < is_there.sum() < n
    assert (out[:, ~is_there] == -7).all()
    assert (out[:, is_there] == out[:, :1]).all()
    before = out.copy()
    for row, bad, line in (
        (0, math.nan, "1: expected directions within 1e30, got nan"),
        (1, math.inf, "1: expected directions within 1e30, got inf"),
        (3, 0.0, "1: expected directions of a length above 0, got 0; leave these out"),
    ):
        wrong = towards.copy()
        wrong[row] = bad
        with pytest.raises(RuntimeError, match=line):
            library.call("rc_sunlit", solver, wrong, n, None, None, ctypes.byref(lit))
    lit.size -= 8
    with pytest.raises(RuntimeError, match=r"1: expected size of sizeof\(rc_lit\) bytes, got 24"):
        library.call("rc_sunlit", solver, towards, n, None, None, ctypes.byref(lit))
    np.testing.assert_array_equal(out, before)


def worth_of(regions, rows, need):
    """Area that poses cover, in their order, counted up to the views that each face needs."""
    if not len(rows):
        return 0.0
    areas = rc.unite(take_rows(regions, np.array(rows)), views=int(need.max())).area
    return float(np.where(np.arange(len(areas))[:, None] < need, areas, 0.0).sum())


@given(seed=st.integers(0, 2**32 - 1), n_given=st.integers(0, 2), is_rare=st.booleans())
@settings(max_examples=15, deadline=None)
def test_poses_are_chosen_that_add_most_of_all(library, seed, n_given, is_rare):
    rng = np.random.default_rng(seed)
    mesh, _ = scene(seed)
    eyes = rng.normal(size=(7, 3))
    eyes *= rng.uniform(1.5, 5, (7, 1)) / np.linalg.norm(eyes, axis=1)[:, None]
    poses = rc.look_at(eyes, rng.uniform(-0.3, 0.3, (7, 3)))
    poses[6] = poses[3]  # of two alike the first
    need = rng.integers(1, 4, mesh.n_faces).astype(np.int32)
    least = 0.5 if is_rare else 0.0
    surface = library.surface(mesh)
    solver = library.make("rc_solver_create", surface, 0, 1)
    of = ctypes.byref(c_camera(CAMERA)), ctypes.byref(library.task())
    parts = [
        library.make("rc_find_regions", solver, *of, np.ascontiguousarray(own), len(own), None,
                     None)
        for own in (poses[:3], poses[3:])
    ]  # fmt: skip
    handles = (ctypes.c_void_p * 2)(*(each.value for each in parts))
    search = Search(ctypes.sizeof(Search), 5, least, n_given, mesh.n_faces, need.ctypes.data)
    chosen, gains, n = np.full(5, -7), np.full(5, -7.0), ctypes.c_int64(-7)
    library.call("rc_place", handles, 2, ctypes.byref(search), None, None, chosen, gains,
                 ctypes.byref(n))  # fmt: skip
    regions, rows = rc.regions(mesh, CAMERA, poses, rc.Task()), [*range(n_given)]
    for row, gain in [*zip(chosen[: n.value].tolist(), gains, strict=False), (-1, least)]:
        rest = [other for other in range(7) if other not in rows]
        before = worth_of(regions, rows, need)
        added = {other: worth_of(regions, [*rows, other], need) - before for other in rest}
        if row < 0:  # the end
            assert n.value == 5 or all(each <= least + 1e-12 for each in added.values())
            continue
        assert gain == pytest.approx(added[row], rel=1e-12, abs=1e-12)
        assert gain > least
        assert gain >= max(added.values()) - 1e-12
        assert row != 6 or 3 in rows
        rows.append(row)
    assert (chosen[n.value :] == -7).all()
    for kind, each in [("regions", own) for own in parts] + [
        ("solver", solver), ("surface", surface)
    ]:  # fmt: skip
        library.call(f"rc_{kind}_free", each)


def rule_of(rng, n):
    """A rule of n devices by their names "0", "1", ..."""
    some = [str(row) for row in rng.permutation(n)]
    if rng.random() < 0.4:
        k = int(rng.integers(1, n + 1))
        return rc.AtLeast(k, needs=some[: int(rng.integers(k + 1))])
    least, most = np.sort(rng.uniform(0, 25, 2)).tolist()
    limits = {"min_baseline_deg": least * (rng.random() < 0.5)}
    limits["max_baseline_deg"] = 180.0 if rng.random() < 0.5 else max(most, 3.0)
    if rng.random() < 0.6:
        limits |= {"max_uncertainty": float(10 ** rng.uniform(-2.5, 0)), "stripes": some[: n - 1]}
        limits["noise_px"] = float(rng.uniform(0.1, 3))
        limits["stripes"] = some[: int(rng.integers(n))]
    return rc.All(**limits)


@given(seed=st.integers(0, 2**32 - 1), is_parallel=st.booleans())
@settings(max_examples=30, deadline=None)
def test_what_devices_of_a_rule_measure_together_is_that_of_python(library, seed, is_parallel):
    """Parallel rays come from a point that is 2^96 m behind."""
    rng = np.random.default_rng(seed)
    mesh, poses = scene(seed)
    n = int(rng.integers(2, 5))
    camera = PARALLEL if is_parallel else CAMERA
    rig = rc.Rig([camera] * n, [str(row) for row in range(n)], rule=rule_of(rng, n))
    eyes = poses[0, :3, 3] + rng.normal(0, 0.6, (n, 3))
    world = np.ascontiguousarray(rc.look_at(eyes, np.zeros((n, 3))))
    task = library.task()
    task.max_incidence_deg = float(rng.choice((90, 70)))
    surface = library.surface(mesh)
    solver = library.make("rc_solver_create", surface, 0, 1)
    of_camera, of_task = ctypes.byref(c_camera(camera)), ctypes.byref(task)
    own = [
        library.make("rc_find_regions", solver, of_camera, of_task, pose, 1, None, None)
        for pose in world.reshape(n, 16)
    ]
    eyes = world.copy()
    eyes[:, :3, 3] -= 2.0**96 * is_parallel * world[:, :3, 2]
    gate, arrays = c_gate(rig.gates[0])
    handles = (ctypes.c_void_p * n)(*(each.value for each in own))
    together = library.make("rc_regions_together", ctypes.byref(gate), handles, eyes, n)
    areas, bounds = np.empty((2, mesh.n_faces))
    library.call("rc_regions_areas", together, 0, 1, mesh.n_faces, areas, bounds)
    limits = rc.Task(max_incidence_deg=task.max_incidence_deg)
    expected = rc.regions(mesh, rig, rc.Poses.of(world, camera=list(range(n))), limits)
    np.testing.assert_array_equal(areas, expected.areas()[0])
    np.testing.assert_allclose(bounds, expected._dense(expected.bound)[0], rtol=1e-3, atol=1e-9)
    del arrays
    for kind, handle in [("regions", each) for each in (*own, together)] + [
        ("solver", solver), ("surface", surface)
    ]:  # fmt: skip
        library.call(f"rc_{kind}_free", handle)


def lens_of(library, camera):
    """A camera with its lens, of its model."""
    values = [getattr(camera, each) or 0 for each in OPTICS]
    optics = Optics(*values, list(MODELS).index(camera.model))
    own, distortion = c_camera(camera), np.array(camera.distortion, float)
    own.lens = library.make("rc_lens_prove", ctypes.byref(optics), distortion, len(distortion))
    return own


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3))
@settings(max_examples=10, deadline=None)
def test_what_a_camera_sees_that_some_lamp_lights_is_a_rule(library, seed, n):
    """That of Python's lamps, by a rule that needs the camera, and one more."""
    rng = np.random.default_rng(seed)
    mesh, poses = scene(seed)
    lamps = [
        rc.Lamp.point(intensity=1) if rng.random() < 0.3
        else rc.Lamp.spot(half_angle_deg=float(rng.integers(2, 9) * 10), intensity=1)
        for _ in range(n)
    ]  # fmt: skip
    eyes = rng.normal(size=(n, 3))
    eyes *= 3 / np.linalg.norm(eyes, axis=1)[:, None]
    places = rc.look_at(eyes, rng.uniform(-0.5, 0.5, (n, 3)))
    surface = library.surface(mesh)
    solver = library.make("rc_solver_create", surface, 0, 1)
    task = ctypes.byref(library.task())
    world = np.ascontiguousarray(np.concatenate([poses[:1], places]))
    eyes = [c_camera(CAMERA), *(lens_of(library, lamp.eye) for lamp in lamps)]
    own = [
        library.make("rc_find_regions", solver, ctypes.byref(by), task, pose, 1, None, None)
        for by, pose in zip(eyes, world.reshape(-1, 16), strict=True)
    ]
    needs = np.array([1] + [0] * n, np.uint8)
    gate = Gate(2, needs.ctypes.data, 0.0, 180.0, 0.0, None, None)
    handles = (ctypes.c_void_p * len(own))(*(each.value for each in own))
    lit = library.make("rc_regions_together", ctypes.byref(gate), handles, world, len(own))
    areas, bounds = np.empty((2, mesh.n_faces))
    library.call("rc_regions_areas", lit, 0, 1, mesh.n_faces, areas, bounds)
    expected = rc.regions(mesh, CAMERA, poses[:1], rc.Task(), lamps=rc.Lamps(lamps, places))
    np.testing.assert_allclose(areas, expected.areas()[0], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(bounds, expected.bounds()[0], rtol=1e-3, atol=1e-9)
    for kind, handle in [("regions", each) for each in (*own, lit)] + [
        *(("lens", ctypes.c_void_p(each.lens)) for each in eyes[1:]),
        ("solver", solver), ("surface", surface),
    ]:  # fmt: skip
        library.call(f"rc_{kind}_free", handle)


PARTS = ("faces", "counts", "views", "zones", "reasons", "areas", "corners")


class Parts(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in PARTS]


def zones_of(library, network, mesh, views, groups, unseeable):
    """Parts of dead zones by C, by name, and the number of zones."""
    found = library.make("rc_find_zones", network, mesh.n_faces, views, groups, unseeable)
    sizes = np.empty(3, np.int64)
    library.call("rc_zones_size", found, *(sizes[k : k + 1] for k in range(3)))
    n_zones, n, n_corners = sizes.tolist()
    arrays = {name: np.empty(n, np.int32) for name in PARTS[:5]}
    arrays |= {"areas": np.empty(n), "corners": np.empty((n_corners, 3))}
    parts = Parts(*(each.ctypes.data for each in arrays.values()))
    library.call("rc_zones_read", found, n, n_corners, ctypes.byref(parts))
    face = arrays["faces"]
    corners = np.split(arrays["corners"], np.cumsum(arrays["counts"])[:-1])
    middles = np.array([each.mean(axis=0) for each in corners]).reshape(-1, 3)
    places, reasons = np.empty((2, n + 1), np.int32)
    a, b, _ = mesh.vertices[mesh.faces[0]]
    middles, face = np.vstack([middles, a + 50 * (b - a)]), np.append(face, np.int32(0))
    library.call("rc_reason_at", found, n + 1, middles, face, places, reasons)
    assert (places[n], reasons[n]) == (-1, rc.Reason.COVERED)
    is_off = (places[:n] != arrays["zones"]) | (reasons[:n] != arrays["reasons"])
    assert is_off.sum() <= 0.02 * n  # thinner than a rounding
    library.call("rc_zones_free", found)
    return arrays, n_zones


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_dead_zones_are_those_of_python(library, seed):
    rng = np.random.default_rng(seed)
    mesh, poses = scene(seed)
    n = int(rng.integers(2, 5))
    camera = replace(CAMERA, focus_range=(1.0, 4.0) if rng.random() < 0.5 else None)
    rule = rule_of(rng, n) if rng.random() < 0.5 else None
    eyes = np.concatenate([poses[:1, :3, 3] + rng.normal(0, 0.6, (n, 3)), poses[1:, :3, 3]])
    if rule is None:
        rig, owner = camera, [0] * (n + 2)
    else:
        eyes, owner = eyes[:n], [*range(n)]
        rig = rc.Rig([camera] * n, [str(row) for row in range(n)], rule=rule)
    world = np.ascontiguousarray(rc.look_at(eyes, np.zeros((len(eyes), 3))))
    task = some_limits(rng)
    k = int(rng.integers(1, 3))
    wanted = rng.integers(1, k + 1, mesh.n_faces).astype(np.int32)
    placed = rc.Poses.of(world, camera=owner)
    covered = rc.unite(rc.regions(mesh, rig, placed, task), k)
    expected = rc.dead_zones(covered, wanted, (rig, task, placed))

    surface, of_task = library.surface(mesh), c_task(library, task, camera)
    network = library.make("rc_network_create", surface, 1)
    of_camera = ctypes.byref(c_camera(camera))
    for _ in range(2):  # the second from what is kept
        library.call("rc_network_clear", network)
        for pose in world.reshape(-1, 16):
            library.call("rc_network_add", network, of_camera, ctypes.byref(of_task), pose)
        if rule is not None:
            gate, arrays = c_gate(rig.gates[0])
            library.call("rc_network_join", network, ctypes.byref(gate), n)
            del arrays
        result, n_zones = zones_of(
            library, network, mesh, wanted, mesh.face_group.astype(np.int32), None
        )
        most = covered.bound.sum() + expected.doubt.sum() + 1e-9 * mesh.areas.sum()
        for code in np.unique([*expected.reason, *result["reasons"].astype(np.uint32)]):
            own = result["areas"][result["reasons"].astype(np.uint32) == code].sum()
            assert abs(own - expected.piece_area[expected.reason == code].sum()) <= most, code
        assert np.array_equal(np.unique(result["zones"]), np.arange(n_zones))
        sizes = np.bincount(result["zones"], result["areas"])
        large = int((expected.area > 10 * most).sum())
        np.testing.assert_allclose(sizes[:large], expected.area[:large], atol=most)
        np.testing.assert_array_less((sizes[large:]).max(initial=0.0), 11 * most)
    for kind, handle in (("network", network), ("surface", surface)):
        library.call(f"rc_{kind}_free", handle)


@pytest.mark.parametrize(
    ("changes", "n", "line"),
    [
        ({"k": 0}, 2, "expected k from 1"),
        ({"k": 3}, 2, "expected k from 1"),
        ({}, 1, "expected 2 to 64 devices"),
        ({"least_deg": 20.0, "most_deg": 10.0}, 2, "expected least_deg up to most_deg"),
        ({"most_deg": 181.0}, 2, "expected angles of 0 to 180 degrees, got 181;"),
        ({"most_deviation": math.nan}, 2, "expected most_deviation of 0 to 1e30 m"),
        ({"most_deviation": 1.0}, 2, "expected a pointer to noise"),
    ],
)
def test_rules_that_are_none_are_a_line(library, changes, n, line):
    given = {"k": 2, "least_deg": 0.0, "most_deg": 180.0, "most_deviation": 0.0} | changes
    gate, handle = Gate(**given), ctypes.c_void_p()
    handles = (ctypes.c_void_p * 2)()
    with pytest.raises(RuntimeError, match=line):
        library.call("rc_regions_together", ctypes.byref(gate), handles,
                     np.tile(np.eye(4), (2, 1, 1)), n, ctypes.byref(handle))  # fmt: skip
    assert handle.value is None


def test_parallel_rays_are_refused_where_no_call_takes_them(library):
    mesh, poses = scene(0)
    surface, by, task = library.surface(mesh), c_camera(PARALLEL), library.task()
    solver = library.make("rc_solver_create", surface, 0, 1)
    network = library.make("rc_network_create", surface, 1)
    asked = ctypes.byref(by), ctypes.byref(task), poses[0]
    line = "expected rays through a point, got 1; use rc_observe or rc_find_regions"
    calls = {
        "rc_judge_faces": (solver, *asked, mesh.n_faces, ctypes.byref(ctypes.c_void_p())),
        "rc_judge_points": (surface, *asked, 0, None, None, None),
        "rc_network_add": (network, *asked),
    }
    for name, arguments in calls.items():
        with pytest.raises(RuntimeError, match=line):
            library.call(name, *arguments)
    of_one = solver, ctypes.byref(by), ctypes.byref(task), poses[0], 1, None, None
    by.is_parallel = 2
    with pytest.raises(RuntimeError, match="expected is_parallel of 0, or of 1 without a"):
        library.make("rc_find_regions", *of_one)
    with_lens = lens_of(library, replace(CAMERA, model="opencv", distortion=(0.1, 0, 0, 0)))
    with_lens.is_parallel = 1
    of_one = solver, ctypes.byref(with_lens), *of_one[2:]
    with pytest.raises(RuntimeError, match="without a lens, got 1; set all fields"):
        library.make("rc_find_regions", *of_one)


LIMITED = """
import ctypes, resource, sys
import numpy as np
library = ctypes.CDLL(sys.argv[1])
library.rc_last_error.restype = ctypes.c_char_p
n = 2_000_000
vertices, faces = np.random.default_rng(0).random((n, 3)), np.arange(3 * n, dtype=np.int32) % n
nine = np.arange(9, dtype=np.int32)  # kept, as the library reads it where it lies
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + (100 << 20), -1))
handle, p = ctypes.c_void_p(), ctypes.c_void_p
code = library.rc_surface_create(
    p(vertices.ctypes.data), ctypes.c_int64(n), p(faces.ctypes.data), ctypes.c_int64(n), None,
    ctypes.byref(handle))
print(code, library.rc_last_error().decode(), handle.value)
small = library.rc_surface_create(
    p(vertices.ctypes.data), ctypes.c_int64(9), p(nine.ctypes.data), ctypes.c_int64(3),
    None, ctypes.byref(handle))
print(small)
"""


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_AS"), reason="no limit of memory here")
def test_memory_that_a_limit_denies_is_a_code_and_a_line():
    said = subprocess.run(
        [sys.executable, "-c", LIMITED, str(LIBRARY)], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    text = "expected memory for making a surface, got too little; pass fewer poses or free handles"
    assert said == [f"3 {text} None", "0"]


@pytest.mark.parametrize("program", ["cases", "fuzz", "fuzz_files"])
def test_the_tests_in_cpp_pass(program):
    if not (TESTS / program).exists():
        pytest.skip(f"no {TESTS / program}: doctest-dev was not there for make lib")
    ended = subprocess.run([TESTS / program], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout[-2000:]


FORMATS = ("stl", "obj", "ply", "off")


def mesh_of(library, extension, data, most_faces=2**31 - 1, memory_budget=2**33):
    """Vertices, faces, polygons, groups, names and notes of a file that C reads."""
    content = np.frombuffer(data or b"\0", np.uint8)
    mesh = library.make(
        "rc_read_mesh", content, len(data), ctypes.c_int32(FORMATS.index(extension)),
        ctypes.c_double(0.001), most_faces, memory_budget,
    )  # fmt: skip
    sizes = [ctypes.c_int64() for _ in range(4)]
    library.call("rc_mesh_size", mesh, *map(ctypes.byref, sizes))
    n_vertices, n_faces, n_groups, n_text = (each.value for each in sizes)
    vertices, faces = np.empty((n_vertices, 3)), np.empty((n_faces, 3), np.int32)
    polygons, groups = np.empty(n_faces, np.int32), np.empty(n_faces, np.int32)
    library.call("rc_mesh_read", mesh, n_vertices, n_faces, vertices, faces, polygons, groups)
    text = np.empty(n_text, np.uint8)
    library.call("rc_mesh_text", mesh, n_text, text)
    library.call("rc_mesh_free", mesh)
    lines = text.tobytes().decode("utf-8", "replace").split("\n")[:-1]
    return vertices, faces, polygons, groups, lines[:n_groups], lines[n_groups:]


@pytest.mark.parametrize("name", [name for name in VALID if not name.endswith(".glb")])
def test_meshes_of_files_and_their_faults_are_those_of_python(library, name, load):
    extension = name.rpartition(".")[2]
    rng, data = np.random.default_rng(3), VALID[name]
    mesh = load(name, data, unit="mm")
    vertices, faces, polygons, groups, names, _ = mesh_of(library, extension, data)
    np.testing.assert_array_equal(vertices, mesh.vertices)
    np.testing.assert_array_equal(faces, mesh.faces)
    np.testing.assert_array_equal(polygons, mesh.source_face)
    own = [names[group] or name.rpartition(".")[0] for group in groups]
    assert own == [mesh.groups[group].name for group in mesh.face_group]
    n_refused = 0
    for size in [0, *rng.integers(0, len(data), 30)]:
        try:
            whole = load(name, data[:size], unit="mm")
        except (MeshError, ResourceError) as error:
            line = str(error).partition(f"{name}: ")[2]
            with pytest.raises(RuntimeError, match=re.escape(f"1: {line}")):
                mesh_of(library, extension, data[:size])
            n_refused += 1
        else:
            notes = [note.partition(f"{name}: ")[2] for note in whole.notes]
            assert mesh_of(library, extension, data[:size])[-1] == notes
    assert n_refused > 10
    for limits in ({"most_faces": 3}, {"memory_budget": 1199}):
        with pytest.raises(RuntimeError, match=r"1: expected at most \d+ bytes and \d+ triangles"):
            mesh_of(library, extension, data, **limits)


def test_a_concave_polygon_is_cut_in_c_as_in_python(library, load):
    data = b"OFF 4 1\n0 0 0\n2 0 0\n.5 .5 0\n0 2 0\n4 "
    for order in (b"2 3 0 1", b"1 2 3 0", b"0 2 1 3"):
        mesh, (_, faces, *_, notes) = (
            load("a.off", data + order),
            mesh_of(library, "off", data + order),
        )
        np.testing.assert_array_equal(faces, mesh.faces)
        assert notes == [note.partition("a.off: ")[2] for note in mesh.notes]


@pytest.mark.parametrize("name", LENSES)
def test_lenses_of_models_are_those_of_python(library, name):
    camera, n = LENSES[name], ctypes.c_int64()
    lens = ctypes.c_void_p(lens_of(library, camera).lens)
    library.call("rc_lens_size", lens, ctypes.byref(n))
    numbers, border = np.empty(n.value), np.empty((32, 3))
    library.call("rc_lens_read", lens, n.value, numbers)
    np.testing.assert_array_equal(numbers, pack_lens(camera))
    library.call("rc_lens_border", lens, 8, border)
    np.testing.assert_allclose(border, view_border(camera, 8), atol=1e-14)
    library.call("rc_lens_free", lens)


@pytest.mark.parametrize("name", LENSES)
def test_a_camera_that_is_not_that_of_its_lens_is_refused(library, name):
    """Each field, one step of rounding or more away; none where it is that of the lens."""
    camera, mesh = LENSES[name], rc.shapes.by_name("box")
    numbers, own = pack_lens(camera), c_camera(camera)
    own.lens = library.make("rc_lens_create", numbers, len(numbers))
    network = library.make("rc_network_create", library.surface(mesh), 1)
    task, pose = library.task(), np.ascontiguousarray(rc.look_at((0, 0, 3), (0, 0, 0))[0])
    library.call("rc_network_add", network, ctypes.byref(own), ctypes.byref(task), pose)
    for field in CAMERA_FIELDS[:6]:
        kept = getattr(own, field)
        for other in (np.nextafter(kept, 0), kept + 1):
            setattr(own, field, other)
            with pytest.raises(RuntimeError, match=r"expected width, height, fx.* of its lens"):
                library.call("rc_network_add", network, ctypes.byref(own), ctypes.byref(task), pose)
        setattr(own, field, kept)


NUMBERS = st.floats(-1, 1).filter(lambda x: x == 0 or abs(x) > 1e-100) | st.sampled_from(
    [0.0, 1.0, -1.0, 1e-8, 1e-100, 1e25]
)
TRIPLE = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)


@given(eye=TRIPLE, way=TRIPLE, up=TRIPLE, is_along=st.booleans(), has_up=st.booleans())
@settings(max_examples=200, deadline=None)
def test_poses_of_c_look_as_those_of_python(library, eye, way, up, is_along, has_up):
    target, pose = eye + way, np.full((4, 4), 7.0)
    up = way.copy() if is_along else up
    given_up = (up,) if has_up else ()
    words = "rc_look_at", eye, target, up if has_up else None, pose
    try:
        wanted = rc.look_at(eye, target, *given_up)[0]
    except rc.PoseError:
        with pytest.raises(RuntimeError, match="expected eye and target at different points"):
            library.call(*words)
        assert (pose == 7).all()
        return
    library.call(*words)
    np.testing.assert_array_equal(pose[:, 3], wanted[:, 3])
    np.testing.assert_allclose(pose, wanted, rtol=0, atol=1e-12)
    turned = pose[:3, :3]
    np.testing.assert_allclose(turned.T @ turned, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("row", range(3))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -2e30])
def test_what_no_pose_can_look_from_is_refused(library, row, bad):
    points = [np.zeros(3), np.ones(3), np.array([0.0, 0, 1])]
    points[row][1] = bad
    with pytest.raises(RuntimeError, match="expected eye, target and up within 1e30 m"):
        library.call("rc_look_at", *points, np.empty((4, 4)))
    points[row] = np.ones(3) * (row == 1)
    for missing in range(2):
        given_points = [None if k == missing else each for k, each in enumerate(points)]
        with pytest.raises(
            RuntimeError, match="expected a pointer to eye, target and pose, got null"
        ):
            library.call("rc_look_at", *given_points, np.empty((4, 4)))


def test_the_header_says_what_the_library_has(library):
    header = (HEADERS / "rastercov.h").read_text()
    assert (ROOT / "rastercov/engine/include/rastercov.h").read_text() == header
    names = set(re.findall(r"\b(rc_\w+)\(", header)) - {"rc_go_on"}
    assert len(names) >= 18
    assert all(hasattr(library._own, name) for name in names)
    assert math.isinf(library.task().max_depth)


@pytest.mark.parametrize("seed", range(4))
def test_places_for_a_camera_are_those_of_python(library, seed):
    """Outside of bodies, which may be open, and as far from every surface as is asked for."""
    rng = np.random.default_rng(seed)
    whole = rc.shapes.by_name(("sphere", "box", "teapot-5", "torus")[seed])
    low, high = whole.bounds
    open_part = rng.random(whole.n_faces) < 0.9
    mesh = rc.Mesh(whole.vertices, whole.faces[open_part])
    points = rng.uniform(1.3 * low - 0.3 * high, 1.3 * high - 0.3 * low, (500, 3))
    least, clear = 0.04 * mesh.diagonal, np.full(len(points), 9, np.uint8)
    surface = library.surface(mesh)
    library.call("rc_clear_places", surface, len(points), points, ctypes.c_double(least), clear)
    is_far = NearestSurface(mesh).query(points).distance >= least
    np.testing.assert_array_equal(clear == 1, ~in_solid(mesh, points) & is_far)
    assert 0 < clear.sum() < is_far.sum()
    with pytest.raises(
        RuntimeError, match="expected a distance of 0 m or more, got -1; pass metres"
    ):
        library.call("rc_clear_places", surface, 1, points, ctypes.c_double(-1), clear)
    library.call("rc_surface_free", surface)
