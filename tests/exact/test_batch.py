"""Poses of a call are shared among threads of the engine: no figure depends on how."""

import _thread
import threading
import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from surfaces import surface_of

import rastercov as rc
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera.pose import engine_camera
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.exact_pass import ExactPass, room_for
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import shapes
from rastercov.engine import solver_parts, solver_visibility

pytestmark = pytest.mark.native
CAMERA = rc.Camera(width=160, height=120, fx=140, fy=150)
FIGURES = ("visible_pixels", "drawn_pixels", "kind", "area_error")


def seen_by(mesh, camera, poses, method, threads):
    seen = room_for(len(poses), mesh.n_faces)
    ExactPass(mesh, camera, Engine(method, threads=threads)).observe(rc.Poses.of(poses), seen)
    return seen


@pytest.mark.parametrize("camera", [CAMERA, CAMERAS["brown"]], ids=["pinhole", "lens"])
@pytest.mark.parametrize("method", ["certified", "exact"])
def test_the_number_of_threads_changes_no_bit(camera, method):
    mesh, poses = shapes.torus(24, 16), sphere_of_poses((0, 0, 0), 3, 60)
    one = seen_by(mesh, camera, poses, method, 1)
    for threads in (2, 5):
        other = seen_by(mesh, camera, poses, method, threads)
        for name in FIGURES:
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    regions = [rc.regions(mesh, camera, poses, method=method, threads=n) for n in (1, 3)]
    for name in ("xy", "starts", "face", "pose", "area", "bound", "excess"):
        assert np.array_equal(*(getattr(each, name) for each in regions)), name


@pytest.mark.parametrize("threads", [1, 3])
def test_an_interrupt_ends_the_call_and_finished_rows_stay(threads):
    mesh, poses = shapes.torus(60, 30), sphere_of_poses((0, 0, 0), 3, 2000)
    seen = room_for(len(poses), mesh.n_faces)
    seen.kind[:] = 9
    solvers = ExactPass(mesh, CAMERA, Engine("exact", threads=threads))
    solvers.observe(rc.Poses.of(poses[:1]), seen_of(seen, slice(1)))
    seen.kind[0] = 9  # computed once more
    threading.Thread(target=interrupt_after_a_row, args=(seen.kind[1:, 0],)).start()
    with pytest.raises(KeyboardInterrupt):
        solvers.observe(rc.Poses.of(poses), seen)
    is_done = (seen.kind != 9).all(axis=1)
    assert 0 < is_done.sum() < len(poses)
    rows = np.flatnonzero(is_done)[:3]
    again = seen_by(mesh, CAMERA, poses[rows], "exact", 1)
    assert np.array_equal(again.visible_pixels, seen.visible_pixels[rows])


def interrupt_after_a_row(kind):
    while (kind == 9).all():
        time.sleep(0.001)
    _thread.interrupt_main()


def seen_of(seen, rows):
    return rc.Observation(**{name: getattr(seen, name)[rows] for name in (*FIGURES, "clipped")})


def test_what_a_worker_raises_is_raised_once_and_the_pass_stays_usable(monkeypatch):
    mesh, poses = shapes.torus(24, 16), sphere_of_poses((0, 0, 0), 3, 200)
    seen = room_for(len(poses), mesh.n_faces)
    solvers = ExactPass(mesh, CAMERA, Engine("certified", threads=3))
    monkeypatch.setattr("rastercov.core.mesh.contacts.touching_faces", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        solvers.observe(rc.Poses.of(poses), seen)
    monkeypatch.undo()
    solvers.observe(rc.Poses.of(poses), seen)
    assert np.array_equal(
        seen.visible_pixels, seen_by(mesh, CAMERA, poses, "certified", 1).visible_pixels
    )


def test_a_solver_that_failed_says_so(monkeypatch):
    mesh, pose = rc.Mesh(*arrays_of(shapes.torus(6, 5))), np.eye(4)
    solver = solver_parts.Solver(surface_of(mesh).native, True, False)
    monkeypatch.setattr("rastercov.core.mesh.contacts.touching_faces", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        solver.solve(engine_camera(CAMERA), pose, 1e-3, False)
    with pytest.raises(ValueError, match="create another one"):
        solver.solve(engine_camera(CAMERA), pose, 1e-3, False)


def arrays_of(mesh):
    return mesh.vertices, mesh.faces


def spoilt(placed, **changed):
    return placed._replace(**changed)


@pytest.mark.parametrize(
    ("changed", "wanted"),
    [
        ({"camera": np.array([1], np.int32)}, "camera must hold cameras"),
        ({"camera": np.array([-1], np.int32)}, "camera must hold cameras"),
        ({"rows": np.array([1])}, "rows must be poses"),
        ({"turns": np.array([1])}, "turns must be rows"),
        ({"camera": np.zeros(2, np.int32)}, "one row in each array"),
    ],
)
def test_poses_that_do_not_fit_are_refused(changed, wanted):
    mesh, seen = shapes.box(), room_for(1, 12)
    solvers = ExactPass(mesh, CAMERA, Engine("certified", threads=1))
    inner = solvers._solvers

    class Spoiling:
        def observe(self, surface, mask, placed, *rest):
            inner.observe(surface, mask, spoilt(placed, **changed), *rest)

        def __getattr__(self, name):
            return getattr(inner, name)

    solvers._solvers = Spoiling()
    with pytest.raises(ValueError, match=wanted):
        solvers.observe(rc.Poses.of(np.eye(4)[None]), seen)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.1, 0.5]),
    near=st.sampled_from([1e-3, 1e-300, 1e300, 0.0, -1.0, np.nan, np.inf]),
    certified=st.booleans(),
)  # fmt: skip
def test_no_pose_or_camera_crashes_a_solver(seed, share, near, certified):
    rng = np.random.default_rng(seed)
    few = np.array([0.0, -0.0, 1.0, -1.0, 1e-300, 1e29, 1e300, np.inf, -np.inf, np.nan])
    pose, numbers = np.eye(4), np.array([140.0, 150.0, 80.0, 60.0, 160.0, 120.0])
    for array in (pose.reshape(-1), numbers):
        rows = rng.random(array.size) < share * rng.random()
        array[rows] = rng.choice(few, rows.sum())
    solver = solver_parts.Solver(surface_of(shapes.torus(8, 6)).native, certified, True)
    with suppress(ValueError):
        camera = solver_visibility.Camera(tuple(numbers.tolist()), 0.0, False)
        solver.solve(camera, pose, near, bool(rng.integers(2)))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from((0.02, 0.2, 1.0)))
def test_no_frame_of_a_face_crashes_regions(seed, share):
    rng, mesh = np.random.default_rng(seed), shapes.torus(8, 6)
    finder = RegionPass(mesh, CAMERA, rc.Task(max_incidence_deg=50), threads=1)
    planes = [array.copy() for array in finder._planes(finder._is_asked)]
    few = np.array([0.0, -0.0, 1.0, -2.5, 1e-300, 1e300, np.inf, -np.inf, np.nan])
    for array in planes[:-2]:
        flat = array.reshape(-1)
        rows = rng.random(flat.size) < share * rng.random()
        flat[rows] = rng.choice(few, rows.sum())
    finder._planes = lambda _: tuple(planes)
    with suppress(ValueError):
        finder.find(rc.Poses.of(sphere_of_poses((0, 0, 0), 3, 3)))
