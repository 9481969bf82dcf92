"""What only the CPU rasteriser has: threads, memory of bands, loops for each processor level."""

import _thread
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from exact_cases import triangles
from gl_device import IN_SOFTWARE
from hostile_scenes import check_scenes
from hypothesis import given
from hypothesis import strategies as st
from image_laws import assert_same_counts
from nightly import amount, examples
from processes import run_python
from scenes import soup
from solids import tessellated_plane

from rastercov import engine
from rastercov.base.errors import DeviceError, ResourceError
from rastercov.base.threads import once_each
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import limits
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster import cpu, open_rasterizer, self_test
from rastercov.core.raster.cpu import MAX_SIDE, CPURasterizer
from rastercov.engine.raster_parts import GUARD_BAND, STEPS

CAMERA = Camera(width=160, height=120, fx=140, fy=150)


def count(mesh, poses, **options):
    with CPURasterizer(mesh, CAMERA, **options) as rasterizer:
        return rasterizer.count(poses)


def test_pictures_of_many_poses_are_those_of_each():
    mesh = shapes.torus(40, 20)  # closed: from outside, back faces are left out
    eyes = np.random.default_rng(3).uniform(-2, 2, (40, 3))
    poses = look_at(eyes, np.zeros(3))
    small = CAMERA.resized(0.2)
    with CPURasterizer(mesh, small, threads=3) as rasterizer:
        near, cull, _ = limits(mesh, small, poses, asks_cut=False)
        expected = limits(mesh, small, poses)
        np.testing.assert_array_equal(near, expected[0])
        np.testing.assert_array_equal(cull, expected[1])
        assert 0 < cull.sum() < len(poses)
        images = rasterizer.render_all(poses)
        for row, pose in enumerate(poses):
            image = rasterizer.render(pose)
            np.testing.assert_array_equal(images.face[row], image.face)
            np.testing.assert_array_equal(images.depth[row], image.depth)
    with pytest.raises(DeviceError):
        rasterizer.render_all(poses)


# --- how the work is shared -----------------------------------------------------------------------


def scenes():
    """Meshes of several clusters, and poses: closed, from inside, of all sizes of triangles."""
    rng = np.random.default_rng(8)
    torus, room = shapes.torus(60, 20), shapes.room(12)
    eyes = room.bounds.mean(axis=0) + rng.uniform(-1, 1, (4, 3))
    here, there = rng.normal(size=(2, 4, 3))
    about = look_at(0.5 * here, np.add(there, (0, 0, 3)))
    return {
        "torus": (torus, sphere_of_poses((0, 0, 0), 3, 5)),
        "room": (room, look_at(eyes, eyes + rng.normal(size=(4, 3)))),
        "soup": (soup(rng, 400), np.concatenate((np.eye(4)[None], about))),
    }


SCENES = scenes()
ODD = Camera(width=173, height=91, fx=140, fy=150)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"supersample": 2, "roll": 0.3}])
@pytest.mark.parametrize("large_pose", [0, 1 << 60])
@pytest.mark.parametrize("max_band", [1, 1 << 12])
@pytest.mark.parametrize("name", SCENES)
def test_bands_and_parts_of_an_image_change_no_count(
    monkeypatch, name, max_band, large_pose, options
):
    mesh, poses = SCENES[name]
    with CPURasterizer(mesh, ODD, threads=1, **options) as rasterizer:
        expected = rasterizer.count(poses)
        image = rasterizer.render(poses[-1])
    monkeypatch.setattr(cpu, "MAX_BAND", max_band)
    monkeypatch.setattr(cpu, "LARGE_POSE", large_pose)
    for threads in (1, 3):
        with CPURasterizer(mesh, ODD, threads=threads, **options) as rasterizer:
            assert_same_counts(rasterizer.count(poses), expected)
            assert_same_counts(rasterizer.count(poses, drawn=False), replace(expected, drawn=None))
            for row, pose in enumerate(poses):
                alone = rasterizer.count(pose)
                assert np.array_equal(alone.visible[0], expected.visible[row])
                assert np.array_equal(alone.drawn[0], expected.drawn[row])
                assert alone.background[0] == expected.background[row]
            result = rasterizer.render(poses[-1])
            assert np.array_equal(result.face, image.face)
            assert np.array_equal(result.depth, image.depth)


@pytest.mark.slow
def test_more_samples_than_32_bits_hold():
    mesh = Mesh(vertices=[[-9, -9, 1], [9, -9, 1], [0, 9, 1]], faces=[[0, 1, 2]])
    camera = Camera(width=1024, height=1024, fx=1000, fy=1000)
    with CPURasterizer(mesh, camera, supersample=46, threads=1) as rasterizer:
        counts = rasterizer.count(np.eye(4))
    assert counts.visible.dtype == counts.drawn.dtype == np.int64
    assert counts.visible.tolist() == counts.drawn.tolist() == [[(46 * 1024) ** 2]]
    assert counts.background.tolist() == [0]
    with CPURasterizer(mesh, camera) as rasterizer:
        assert rasterizer.count(np.eye(4)).visible.dtype == np.int32


# --- which face a sample belongs to ---------------------------------------------------------------

QUARTER, HALF_SAMPLE = STEPS // 4, STEPS // 2
IMAGES = [(1, 1), (3, 17), (21, 15), (64, 4), (90, 70), (333, 2), (301, 222)]
CORNERS = st.tuples(st.integers(-8, 8), st.integers(-8, 8), st.sampled_from((0, 0.25, 0.5)))
TRIANGLES = st.tuples(
    st.tuples(st.integers(-4, 68), st.integers(-4, 68)),
    st.sampled_from((1, 1, 3, 10, 45, 160, 50000)),
    st.tuples(CORNERS, CORNERS, CORNERS),
)


def owned(corners, width, height):
    """Samples that a triangle owns, in whole numbers: those it holds a hair right and down."""
    a, b, c = (np.array(corner, np.int64) for corner in corners)
    turn = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    if turn < 0:
        b, c = c, b
    y, x = np.indices((height, width)) * STEPS + HALF_SAMPLE
    inside = np.full((height, width), turn != 0)
    for (px, py), (qx, qy) in ((a, b), (b, c), (c, a)):
        across, down = py - qy, qx - px
        value = across * (x - px) + down * (y - py)
        inside &= (value > 0) | ((value == 0) & ((across > 0) | ((across == 0) & (down > 0))))
    return inside, turn < 0


@pytest.mark.slow
@given(
    st.sampled_from(IMAGES),
    st.lists(TRIANGLES, min_size=1, max_size=24),
    st.randoms(use_true_random=False),
    st.booleans(),
)
@examples(8, at_night=25)
def test_each_sample_belongs_to_the_nearest_face_that_whole_numbers_give_it(
    size, drawn, random, hides_backs
):
    # Corners on quarters of samples, so that edges pass through samples; depths far apart.
    width, height = size
    depths = list(range(2, len(drawn) + 2))
    random.shuffle(depths)
    corners, points = [], []
    for (centre, scale, offsets), depth in zip(drawn, depths, strict=True):
        for u, v, behind in offsets:
            at = [width * centre[0] // 16 + scale * u, height * centre[1] // 16 + scale * v]
            corners.append([QUARTER * k for k in at])
            points.append([*((depth + behind) * k / 256 for k in at), depth + behind])
    mesh = triangles(*np.reshape(points, (-1, 3, 3)))
    mesh.__dict__.update(can_cull_back_faces=hides_backs, is_closed_outward=hides_backs)
    face = np.full((height, width), -1)
    held = [owned(corners[3 * f : 3 * f + 3], width, height) for f in range(mesh.n_faces)]
    for f in np.argsort(depths)[::-1]:
        inside, is_front = held[f]
        if is_front or not hides_backs:
            face[inside] = f
    own = [inside.sum() for inside, _ in held]
    camera = Camera(width=width, height=height, fx=64, fy=64, cx=0, cy=0)
    with CPURasterizer(mesh, camera, threads=1) as rasterizer:
        assert np.array_equal(rasterizer.render(np.eye(4)).face, face)
        for counts in (rasterizer.count(np.eye(4)), rasterizer.count(np.eye(4), drawn=False)):
            values = np.append(counts.background, counts.visible[0])
            assert np.array_equal(values, np.bincount(face.ravel() + 1, minlength=len(own) + 1))
            assert counts.drawn is None or np.array_equal(counts.drawn[0], own)


# --- memory, processors, faults -------------------------------------------------------------------


@pytest.mark.native
@pytest.mark.parametrize("is_rolled", [False, True])
def test_no_scene_reaches_past_the_scratch_memory(is_rolled):
    check_scenes(amount(100, at_night=250), is_rolled)


@pytest.mark.native
def test_every_processor_counts_alike(monkeypatch):
    expected = all_counts()
    for level in engine.built_modules():
        if level not in engine.runnable():
            continue
        module = engine.load(f"_{level}")
        monkeypatch.setattr(cpu, "solver_raster", module.solver_raster)
        monkeypatch.setattr(cpu, "_scene_of", once_each(cpu._scene_of.__wrapped__))
        for one, other in zip(all_counts(), expected, strict=True):
            assert np.array_equal(one, other)


def all_counts():
    counts = [count(mesh, poses) for mesh, poses in SCENES.values()]
    return [numbers for c in counts for numbers in (c.visible, c.drawn, c.background)]


def test_a_compiler_that_errs_is_not_trusted(monkeypatch):
    monkeypatch.setattr(self_test, "VISIBLE", self_test.VISIBLE + 1)
    with pytest.raises(
        DeviceError, match="expected correct counts of a known scene, got wrong ones from ra"
    ):
        CPURasterizer(shapes.box(), CAMERA)


@pytest.mark.parametrize("threads", [1, 3])
def test_an_interrupt_ends_the_count_within_a_pose(threads):
    mesh, poses = SCENES["torus"][0], sphere_of_poses((0, 0, 0), 4, 2000)
    with CPURasterizer(mesh, CAMERA, threads=threads, supersample=12) as rasterizer:
        expected = rasterizer.count(poses[:3])
        threading.Timer(0.1, _thread.interrupt_main).start()
        began = time.process_time()
        with pytest.raises(KeyboardInterrupt):
            rasterizer.count(poses)  # which takes a minute
        assert time.process_time() - began < 20
        assert rasterizer._drawing.n_idle == 0  # an error may have left it half changed
        assert_same_counts(rasterizer.count(poses[:3]), expected)


def test_limits_are_refused_before_anything_is_allocated():
    with pytest.raises(ResourceError, match="1,048,576"):
        CPURasterizer(shapes.box(), Camera(width=131072, height=8, fx=1, fy=1), supersample=9)
    large = Camera(width=131072, height=131072, fx=1, fy=1)
    with pytest.raises(ResourceError, match="1,048,576 samples, got 1,202,"):
        CPURasterizer(shapes.box(), large, supersample=7, roll=0.4)
    assert MAX_SIDE * STEPS <= GUARD_BAND


@pytest.mark.parametrize(
    ("skew", "drawing"),
    [(0, ("gl", "pipeline" if IN_SOFTWARE else "compute")), (1.5, ("cpu", "threads"))],
)
def test_opengl_takes_pinholes_when_its_options_are_given(device, skew, drawing):
    camera = replace(CAMERA, skew=skew)
    with open_rasterizer(shapes.box(), camera) as rasterizer:
        assert rasterizer.info.backend == "cpu"
    with open_rasterizer(shapes.box(), camera, device=device) as rasterizer:
        assert (rasterizer.info.backend, rasterizer.info.plan) == drawing


def test_it_runs_without_a_graphics_library():
    code = """
import sys
sys.modules["moderngl"] = None
import rastercov as rc
from rastercov import shapes
scene = shapes.box(), rc.Camera(width=8, height=8, fx=8, fy=8)
with rc.open_rasterizer(*scene, "cpu") as r:
    print(int(r.count(rc.look_at((0, 0, 3), (0, 0, 0))).visible.sum()))
try:
    rc.open_rasterizer(*scene, device="surfaceless")
except rc.DeviceError as error:
    print(error)
"""
    seen, error = run_python("-c", code).stdout.splitlines()
    assert int(seen) > 0
    assert error.startswith("expected OpenGL, got an import error (import of moderngl halted")
    assert error.endswith("; run: pip install moderngl, or use the device cpu")


# --- what the loops are given ---------------------------------------------------------------------


def grid_arguments(**changed):
    """Arguments of a canvas of 32 x 16 scattered samples."""
    n_blocks = 16 * 4
    scattered = {
        "offsets": np.zeros(16 * n_blocks, np.int32),
        "used": np.zeros(n_blocks, np.uint16),
        "cell_bounds": np.zeros(n_blocks // 16, np.float32),
        "lanes": np.zeros(0, np.int32),
        "samples": np.zeros(0, np.int32),
        "places": np.zeros((0, 2), np.float32),
    }
    rest = {
        "width": 32,
        "height": 16,
        "lens": np.array((20, 20, 16, 8.0)),
        "mix": np.eye(2),
        "runs": np.tile(np.array(((0,), (32,)), np.int32), 16),
        "is_rolled": False,
        "is_parallel": False,
    }
    tuple_of = {name: changed.get(name, value) for name, value in scattered.items()}
    named = {name: changed.get(name, value) for name, value in rest.items()}
    return tuple(tuple_of.values()), tuple(named.values()), cpu.MAX_BAND


SPOILT = {
    "width": 0, "height": 1 << 40, "runs": np.zeros((2, 15), np.int32), "is_rolled": True,
    "offsets": np.zeros(16, np.int32), "used": np.zeros(3, np.uint16),
    "cell_bounds": np.zeros(9, np.float32), "lanes": np.zeros(1, np.int32),
}  # fmt: skip


@pytest.mark.native
@pytest.mark.parametrize("name", SPOILT)
def test_a_canvas_that_is_none_is_refused(name):
    engine.solver_raster.Canvas(*grid_arguments())
    with pytest.raises(ValueError, match="must"):
        engine.solver_raster.Canvas(*grid_arguments(**{name: SPOILT[name]}))


@pytest.mark.native
def test_lanes_and_samples_outside_are_refused():
    drawing = cpu.drawing_of(self_test.MESH, 1)
    corners = self_test.MESH.vertices[self_test.MESH.faces]
    looks = np.eye(4)[None, None], np.full(1, 1e-3), np.zeros(1, bool)
    places = np.zeros((3, 2), np.float32)
    for lanes, samples in (
        ((1, 2, 3), (0, 1, 9)),
        ((1, 2, 3), (0, 1, -1)),
        ((40, -3, 50), (0, 1, 2)),
    ):
        own = {"lanes": np.array(lanes, np.int32), "samples": np.array(samples, np.int32)}
        canvas = engine.solver_raster.Canvas(*grid_arguments(**own, places=places))
        image = np.zeros(3, np.int32), np.zeros(3, np.float32)
        with suppress(ValueError):
            drawing.render_lanes([canvas], looks, corners, False, *image, 2)


@pytest.mark.native
def test_output_that_does_not_fit_is_refused():
    mesh, poses = SCENES["torus"]
    drawing, canvas = cpu.drawing_of(mesh, 1), cpu.canvas_of(cpu.SampleGrid(CAMERA))
    near, cull, _ = limits(mesh, CAMERA, poses)
    n, looks = len(poses), (poses[None], near, cull)
    visible, filled = np.empty((n, mesh.n_faces), np.int32), np.empty(n, np.int64)
    good = [canvas], looks, (visible, visible[:0], filled, False), 1, 1
    drawing.count(*good)
    for k, spoilt in (
        (0, [canvas, canvas]),
        (1, (poses[None], near[1:].copy(), cull)),
        (2, (visible[1:], visible[:0], filled, False)),
        (2, (visible[:, 1:].copy(), visible[:0], filled, False)),
        (2, (visible, visible[:1].copy(), filled, False)),
        (2, (visible, visible[:0], filled[1:], False)),
        (3, 0),
    ):
        with pytest.raises(ValueError, match="must"):
            drawing.count(*good[:k], spoilt, *good[k + 1 :])
    images = np.empty((n, 9, 9), np.int32), np.empty((n, 9, 9), np.float32)
    with pytest.raises(ValueError, match="one element for each sample"):
        drawing.render(canvas, looks, *images, 1)


@pytest.mark.parametrize("far", [(-1e7, 60), (1e7, 60), (80, -1e7), (80, 1e7)])
def test_a_triangle_that_reaches_far_out_covers_the_image(far):
    # Two corners stand beside the image, opposite to the third, which is clipped for its distance.
    away = np.sign(np.array(far) - (80, 60)) * (np.abs(far) > 1e6)
    beside = np.array((80, 60)) - 120 * away
    across = 400 * np.abs(away[::-1])
    image = np.array((far, beside - across, beside + across))
    rays = (image - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy)
    points = np.column_stack((rays, np.ones(3)))
    counts = count(Mesh(vertices=points, faces=np.arange(3)[None]), np.eye(4))
    assert counts.visible.tolist() == [[CAMERA.width * CAMERA.height]]
    assert counts.drawn.tolist() == [[CAMERA.width * CAMERA.height]]


def test_a_sliver_along_the_view_that_reaches_far_out_is_clipped():
    # It lies beyond the near plane, and so does the sphere around it, but its corner at the camera
    # is 2.5e7 samples to the right: more than 32 bits of steps hold.
    corner, tip, side = np.array(((0.25, 0, 2e-5), (0.25, 0, 1), (0.25, 0.002, 0.6)))
    cuts = [corner + (0.1 - corner[2]) / (to[2] - corner[2]) * (to - corner) for to in (tip, side)]
    camera = Camera(width=1200, height=300, fx=2000, fy=2000, cx=0, cy=150)
    whole = Mesh(vertices=[corner, tip, side], faces=[[0, 1, 2]])
    # What is left beyond the depth 0.1, before which all of it is beside the image.
    part = Mesh(vertices=[cuts[0], tip, side, cuts[1]], faces=[[0, 1, 2], [0, 2, 3]])
    counts = []
    for mesh in (whole, part):
        with CPURasterizer(mesh, camera) as rasterizer:
            result = rasterizer.count(np.eye(4))
            counts.append(result.visible.sum())
            assert np.array_equal(result.visible, result.drawn)
    assert counts[0] == counts[1] > 3000


def test_small_faces_fill_a_rolled_image_to_its_rim():
    # A plane beyond the image on all sides, of faces that reach at most 2 x 2 samples.
    plane = tessellated_plane(149, 149, 1.4, 1.4, jitter=0)
    mesh = Mesh(vertices=np.add(plane.vertices, (0, 0, 1)), faces=plane.faces)
    camera = Camera(width=90, height=70, fx=80, fy=80)
    for roll in (0.1, 0.3, -0.4, 0.7):
        with CPURasterizer(mesh, camera, roll=roll) as rasterizer:
            counts = rasterizer.count(np.eye(4))
        assert counts.background.tolist() == [0]
        assert np.array_equal(counts.visible, counts.drawn)


def test_threads_that_open_a_mesh_at_once_share_one_scene(monkeypatch):
    """A second one would free the first, which a rasteriser reads without holding it."""
    made = []

    def slow(*arguments):
        made.append(arguments)
        time.sleep(0.2)
        return scene(*arguments)

    scene = cpu.solver_raster.Scene
    monkeypatch.setattr(cpu.solver_raster, "Scene", slow)
    mesh, poses = shapes.torus(12, 10), sphere_of_poses((0, 0, 0), 4, 2)

    def drawn(_):
        with open_rasterizer(mesh, CAMERA, "cpu") as rasterizer:
            return rasterizer.render(poses[0]).face.tobytes()

    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(drawn, range(4)))) == 1
    assert [len(faces) for _, faces, *_ in made].count(mesh.n_faces) == 1
