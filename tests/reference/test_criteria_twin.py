"""The compiled criteria and coverage against their numpy twins, on scenes made to part them."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.coverage import FIGURES, Observer, evaluate_batches, open_observer
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.judging import CHOICES
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.raster.contract import BoundKind, Observation
from rastercov.reference import coverage as coverage_twin
from rastercov.reference.methods.convergence import fractions

CLOSE = ("projected_area", "in_view_fraction", "incidence")
CUT = 1e-12
"""Relative difference of areas that numpy adds up in another order; of angles."""
NASTY = np.array([0.0, -0.0, 1.0, -1.0, 1e-12, 2.0, 3.0, 0.1, -0.1, 1e-6, 0.5])

seeds = st.integers(0, 2**32 - 1)


def hostile(rng):
    """Mesh with coplanar, tiny, edge-on, repeated and huge faces, some of them two-sided."""
    n = int(rng.integers(3, 30))
    points = np.where(rng.random((n, 1)) < 0.5, rng.choice(NASTY, (n, 3)), rng.normal(size=(n, 3)))
    points *= 10.0 ** rng.choice([-30, -6, 0, 0, 0, 3, 20])
    faces = rng.integers(0, n, size=(40, 3))
    return Mesh(points, faces, [Group("one"), Group("two", False, True)], np.arange(40) % 2)


def hostile_pose(rng, mesh):
    """At a vertex, inside the bounds, along an axis, or anywhere near."""
    low, high = mesh.bounds
    if rng.random() < 0.3:
        pose = np.eye(4)
        pose[:3, 3] = mesh.vertices[rng.integers(mesh.n_vertices)]
        return pose
    size = max(float((high - low).max()), 1e-30)
    eye = low + (high - low) * rng.random(3) + size * rng.choice([0, 0.1, 2]) * rng.normal(size=3)
    return look_at(eye, eye + size * rng.normal(size=3), rng.normal(size=3))[0]


def hostile_camera(rng):
    sizes = zip(("width", "height"), rng.choice([1, 64, 640, 5000], 2).tolist(), strict=True)
    lengths = zip(("fx", "fy"), rng.choice([0.7, 50, 500, 1e5], 2).tolist(), strict=True)
    near = float(rng.choice([0, 1e-3, 0.1, 1.0]))
    focus = (0.3, 2.0) if rng.random() < 0.5 else None
    return Camera(**dict(sizes), **dict(lengths), near=near, focus_range=focus)


def hostile_task(rng):
    if rng.random() < 0.2:
        return Task.thesis(min_pixels=float(rng.choice([1e-300, 1, 50])))
    return Task(
        min_pixels=float(rng.choice([1e-300, 1e-3, 1.0, 30, 1e9])),
        min_visibility=float(rng.choice([0, 0.5, 1])),
        max_incidence_deg=float(rng.choice([1e-3, 30, 60, 89.999, 90])),
        min_pixel_density=float(rng.choice([0, 1e-9, 10, 1e5])),
        min_facing_density=float(rng.choice([0, 1e-9, 10, 1e5])),
        min_pixels_per_m2=float(rng.choice([0, 1e-9, 1e3, 1e9])),
        min_coverage=float(rng.choice([0, 1e-9, 0.5, 1])),
        focus_rule=str(rng.choice(["vertices", "centroid"])),
        cap_resolution=bool(rng.random() < 0.5),
    )


def hostile_observation(rng, n_poses, n_faces):
    """Areas as no scene has them: none, hidden, larger than what is drawn, of every kind."""
    shape = n_poses, n_faces
    drawn = rng.choice([0, 1e-200, 0.25, 1.0, 30, 1e7], shape) * rng.choice([1, 0.7], shape)
    visible = drawn * rng.choice([0, 0.3, 1, 1 + 2e-16], shape)
    error = np.broadcast_to(0.0, shape)
    if rng.random() < 0.5:
        error = drawn * rng.choice([0, 1e-9, 0.5, 1, 2], shape)
    kind = rng.choice(list(BoundKind), shape).astype(np.uint8)
    return Observation(
        visible, drawn, kind, error, rng.random(n_poses) < 0.5, int(rng.choice([1, 4, 64]))
    )


def assert_close(name, result, expected):
    np.testing.assert_allclose(result, expected, rtol=CUT, atol=1e-15, err_msg=name)
    assert np.array_equal(result == 0, expected == 0), name


class Recorded(Observer):
    """An observer that gives one observation whatever it is asked for."""

    info, threads = None, 2

    def __init__(self, mesh, camera, seen):
        self.mesh, self.camera, self.seen = mesh, camera, seen

    def observe(self, poses):
        assert len(poses) == len(self.seen.kind)
        return self.seen

    def close(self):
        pass


def assert_judged(result, task, poses, seen):
    """Figures of a Coverage are those of the twin; an angle is not near its limit."""
    limit = math.radians(task.max_incidence_deg)
    for row, pose in enumerate(poses):
        with np.errstate(all="ignore"):
            expected = coverage_twin.figures_of_pose(
                result.mesh, result.camera, task, pose, seen, row
            )
        sure = np.abs(expected["incidence"] - limit) > 1e-12
        for name in FIGURES:
            one, other = getattr(result, name)[row], expected[name]
            assert np.isfinite(one).all(), name
            if name in ("coverage", "reason"):
                one, other = one[sure], other[sure]
            if name in CLOSE:
                assert_close(name, one, other)
            else:
                np.testing.assert_array_equal(one, other, err_msg=name)


@pytest.mark.slow
@given(seeds)
def test_any_observation_is_judged_as_by_the_twin(seed):
    rng = np.random.default_rng(seed)
    mesh, camera, task = hostile(rng), hostile_camera(rng), hostile_task(rng)
    poses = np.stack([hostile_pose(rng, mesh) for _ in range(3)])
    seen = hostile_observation(rng, 3, mesh.n_faces)
    (result,) = evaluate_batches(Recorded(mesh, camera, seen), poses, task)
    assert_judged(result, task, poses, seen)


@pytest.mark.parametrize("dtype", [np.int32, np.int64])
def test_counts_are_judged_as_the_areas_that_they_are(dtype):
    mesh, camera = shapes.teapot(3), Camera(width=96, height=80, fx=90, fy=84)
    poses = Poses.of([hostile_pose(np.random.default_rng(seed), mesh) for seed in range(4)])
    with open_observer(mesh, camera, "sampled:cpu@3") as observer:
        counts = observer.measure(poses)
    some = {name: getattr(counts, name).astype(dtype) for name in ("visible", "drawn")}
    counts, faces = dataclasses.replace(counts, **some), FacePass(mesh, camera, 2)
    of_counts = fractions(faces, counts, poses)
    of_areas = fractions(faces, Observation.of_counts(counts), poses)
    for one, other in zip(of_counts, of_areas, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (of_counts[0] > 0).any()


@pytest.mark.slow
@given(seeds, st.sampled_from(CHOICES), st.integers(1, 3))
def test_rows_of_a_table_are_the_chosen_figures_whatever_the_threads(seed, choice, threads):
    rng = np.random.default_rng(seed)
    mesh, camera, task = hostile(rng), hostile_camera(rng), hostile_task(rng)
    poses = np.stack([hostile_pose(rng, mesh) for _ in range(5)])
    recorded = Recorded(mesh, camera, hostile_observation(rng, 5, mesh.n_faces))
    recorded.threads = threads
    (figures,) = evaluate_batches(recorded, poses, task)
    network, with_rows = Network(mesh, task), Network(mesh, task)
    (batch,) = with_rows.judge(recorded, Poses.of(poses), pairs=choice)
    expected = coverage_twin.rows_of(figures, choice)
    for name, column in batch.rows.items():
        np.testing.assert_array_equal(column, expected[name], err_msg=name)
        assert column.dtype == expected[name].dtype, name
    # Neither rows nor threads change the network, which is that of the figures.
    network.add(figures)
    with_rows.add(batch)
    assert with_rows.summary() == network.summary()
    np.testing.assert_array_equal(with_rows.reason, network.reason)
