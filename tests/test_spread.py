"""Networks whose faces need views from directions that differ by an angle."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rastercov as rc
from rastercov.core.coverage.network import ViewSpread, least_cosine
from rastercov.core.mesh import shapes
from rastercov.engine.placement_selection import next_camera
from rastercov.placement import Objective, build_matrix, problem_of
from rastercov.placement.select.problem import BestCoverage
from rastercov.reference.views import covered_faces
from rastercov.report.coverage import Options, run

MESH = shapes.torus(16, 8)
CAMERA = rc.Camera(width=160, height=120, fx=90, fy=90)
POSES = rc.sphere_of_poses((0, 0, 0), 4.0, 12)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(0, 9),
    angle=st.sampled_from([0.0, 1.0, 30.0, 90.0, 179.0, 180.0]),
)
def test_faces_are_spread_where_the_reference_has_them_so(seed, n, angle):
    rng = np.random.default_rng(seed)
    covers, eyes = rng.random((n, 7)) < 0.5, rng.normal(size=(n, 3))
    eyes[: n // 3] = 1.0  # the same place, several times
    centroids = rng.normal(size=(7, 3))
    spread = ViewSpread(centroids, math.radians(angle))
    for eye, row in zip(eyes, covers, strict=True):
        spread.add(eye, np.flatnonzero(row))
    values = spread.is_spread & (covers.sum(axis=0) >= 1)
    cosine = least_cosine(math.radians(angle))
    np.testing.assert_array_equal(
        values, covered_faces(covers, eyes, centroids, np.ones(7, np.int64), cosine)
    )


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 70.0, 130.0])
@pytest.mark.parametrize("views", [1, 3])
def test_a_network_covers_what_placement_covers(views, angle):
    task = rc.Task(min_pixels=4, views=views, min_angle_deg=angle)
    added, judged = rc.Network(MESH, task), rc.Network(MESH, task)
    added.add(rc.evaluate(MESH, CAMERA, POSES, task, by="face"))
    with rc.open_observer(MESH, CAMERA) as observer:
        for part in (POSES[:5], POSES[5:]):
            for batch in judged.judge(observer, rc.Poses.of(part)):
                judged.add(batch)
        matrix = build_matrix(observer, POSES, task)
        objective = Objective.of(observer, task)
        covered = objective.covered(objective.covers(POSES), POSES[:, :3, 3])
    problem = problem_of(matrix, MESH, BestCoverage(cameras=12))
    assert problem.min_angle == math.radians(angle)
    np.testing.assert_array_equal(added.covered, judged.covered)
    np.testing.assert_array_equal(added.covered, covered)
    np.testing.assert_array_equal(added.covered, problem.covered_by(np.arange(12))[1])
    assert covered.sum() > 0


def test_a_report_counts_faces_with_views_from_two_sides(tmp_path):
    task = rc.Task(min_pixels=4, min_angle_deg=130)
    network = rc.Network(MESH, task)
    network.add(rc.evaluate(MESH, CAMERA, POSES, task, by="face"))
    without = rc.Network(MESH, rc.Task(min_pixels=4))
    without.add(rc.evaluate(MESH, CAMERA, POSES, rc.Task(min_pixels=4), by="face"))
    assert network.covered.sum() < without.covered.sum()
    for table in ("none", "seen"):
        summary = run(MESH, CAMERA, POSES, task, tmp_path, Options(pictures=0, table=table))
        assert summary["covered"] == network.summary()["covered"]
        assert summary["not_covered_because"]["too_few_views"]["faces"] > 0
    assert summary["by"] == "face"


def test_of_equal_gains_that_of_the_least_rank_is_chosen():
    gain, rank = np.full((3, 1), 5), np.array([2, 0, 1])
    free = np.ones(3), rank, np.zeros(3, np.uint8), np.inf, False
    assert next_camera(gain, np.array([1]), np.array([9]), *free) == 1


TOO_SMALL = [1e-300, 1e-9, 1e-7, 3e-5, 9.99e-4]


@pytest.mark.parametrize("angle", TOO_SMALL)
def test_an_angle_that_rounding_decides_is_refused_wherever_it_is_given(angle):
    ahead, right = np.eye(4), np.eye(4)
    right[0, 3] = 0.1
    pair = [ahead, right]
    mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    matrix = build_matrix((mesh, camera), rc.look_at((0, 0, 3), (0, 0, 0), up=(0, 1, 0)))
    given = {
        "min_angle_deg": [
            lambda: rc.Task(min_angle_deg=angle),
            lambda: rc.Task(min_angle_deg=np.float64(angle)),
            lambda: problem_of(matrix, mesh, BestCoverage(1), min_angle_deg=angle),
            lambda: ViewSpread(mesh.centroids, math.radians(angle)),
        ],
        "degrees": [lambda: rc.RayAngle([(0, 0, 1), (0, 0, 1)], angle)],
        "min_baseline_deg": [
            lambda: rc.Rig([camera] * 2, ["a", "b"], pair, rule=rc.All(min_baseline_deg=angle))
        ],
        "max_baseline_deg": [
            lambda: rc.Rig([camera] * 2, ["a", "b"], pair, rule=rc.All(max_baseline_deg=angle))
        ],
    }
    for name, calls in given.items():
        for call in calls:
            with pytest.raises(
                rc.RastercovError, match=rf"^expected {name} to be 0, or from 0\.001 to"
            ):
                call()


@pytest.mark.parametrize("angle", [0, 1e-3, 0.5, 180])
def test_an_angle_of_0_or_above_rounding_is_not_refused(angle):
    assert rc.Task(min_angle_deg=angle).min_angle_deg == angle
    assert rc.RayAngle([(0, 0, 1), (0, 0, 1)], angle).degrees == angle
    assert ViewSpread(np.zeros((2, 3)), math.radians(angle)).is_spread.all() == (angle == 0)
