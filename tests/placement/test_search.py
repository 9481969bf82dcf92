import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import IS_NIGHTLY, examples

from rastercov.base.errors import ConfigError
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.observer import open_observer
from rastercov.coverage.task import Task
from rastercov.mesh import shapes
from rastercov.placement.candidates.clearance import (
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    in_solid,
)
from rastercov.placement.improve import objective as objective_module
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import Place, PoseSpace
from rastercov.placement.improve.search import METHODS, optimise

MESH = shapes.torus(10, 6)
CAMERA = Camera(width=64, height=48, fx=60.0, fy=60.0, cx=32.0, cy=24.0)
TASK = Task(max_incidence_deg=75)
KEPT_OUT = KeepOutBox((0.5, -9, -9), (9, 9, 9), "half")
SPACE = PoseSpace(mesh=MESH, stand_off=(1.0, 2.5), clearance=0.5, keep_out=(KEPT_OUT,))


@pytest.fixture(scope="module")
def objective():
    with open_observer(MESH, CAMERA) as observer:
        yield Objective.of(observer, TASK)


@pytest.fixture(params=METHODS)
def method(request):
    return request.param


def holds(space, eyes):
    """Whether every constraint holds at every eye, by its definition."""
    least, greatest = space.stand_off
    far = NearestSurface(space.mesh, space.mesh.task_mask).query(eyes).distance
    inside = [
        ((eyes >= low - 1e-6) & (eyes <= high + 1e-6)).all(axis=1) for low, high in space.boxes
    ]
    return (
        (far >= least - 1e-12).all()
        and (far <= greatest + 1e-12).all()
        and (NearestSurface(space.mesh).query(eyes).distance >= space.clearance - 1e-12).all()
        and not any(volume.contains(eyes).any() for volume in space.keep_out)
        and not in_solid(space.mesh, eyes).any()
        and np.any(inside, axis=0).all()
    )


@pytest.mark.slow
def test_every_method_spends_the_same_budget_a_generation_a_batch(objective, method, monkeypatch):
    sizes = []
    plain = objective_module.evaluate_batches

    def spied(observer, poses, task, **options):
        sizes.append(len(poses))
        return plain(observer, poses, task, **options)

    monkeypatch.setattr(objective_module, "evaluate_batches", spied)
    result = optimise(objective, SPACE, 2, method, budget=41, population=8)
    assert sizes == [16, 16, 8]
    assert result.evaluations == 40
    assert len(result.trace) == 20
    assert result.generations == 3


@pytest.mark.slow
def test_the_same_seed_gives_the_same_network(objective, method):
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    one, two, other = (
        optimise(objective, SPACE, 2, method, budget=32, population=8, seed=seed)
        for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.poses, two.poses)
    np.testing.assert_array_equal(one.trace, two.trace)
    assert (one.poses != other.poses).any()
    np.testing.assert_array_equal(np.random.get_state()[1], state)  # noqa: NPY002


@pytest.mark.slow
def test_constraints_hold_and_the_share_is_that_of_the_poses(objective, method):
    result = optimise(objective, SPACE, 2, method, budget=48, population=8, seed=1)
    assert holds(SPACE, result.poses[:, :3, 3])
    assert result.share == objective.share_of(result.poses)
    assert result.share == result.trace[-1]
    assert (np.diff(result.trace) >= 0).all()


@pytest.mark.slow
def test_all_methods_begin_with_the_same_networks(objective):
    traces = [
        optimise(objective, SPACE, 2, method, budget=16, population=8).trace for method in METHODS
    ]
    for trace in traces[1:]:
        np.testing.assert_array_equal(trace, traces[0])


@pytest.fixture(scope="module")
def good(objective):
    """The best network of a hundred."""
    return optimise(objective, SPACE, 2, "random", budget=200, population=50, seed=9)


@pytest.mark.slow
def test_a_search_is_no_worse_than_its_start(objective, good, method):
    # Turned about their axes, the poses are none that the variables can express.
    turned = good.poses.copy()
    turned[:, :3, :2] = turned[:, :3, 1::-1] * (1, -1)
    for start in (good.poses, np.stack((turned, good.poses))):
        result = optimise(objective, SPACE, 2, method, budget=32, population=8, start=start)
        assert result.share >= objective.share_of(good.poses)
        assert result.share >= objective.share_of(turned) or start.ndim == 3


class Facing(Objective):
    """Faces are covered by what they face within 50 degrees and 30 of the axis: quick."""

    def covers(self, poses):
        mesh, matrices = self.observer.mesh, np.asarray(poses)
        rays = matrices[:, None, :3, 3] - mesh.centroids
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        facing = np.einsum("pfi,fi->pf", rays, mesh.normals)
        ahead = -np.einsum("pfi,pi->pf", rays, matrices[:, :3, 2])
        return (facing > np.cos(np.radians(50))) & (ahead > np.cos(np.radians(30)))


@pytest.mark.slow
def test_searching_beats_drawing_at_random(objective):
    facing = Facing(objective.observer, TASK, objective.integer_weights, objective.need)
    free = replace(SPACE, boxes=None, keep_out=())
    shares = {
        method: [
            optimise(facing, free, 3, method, budget=1500, population=20, seed=seed).share
            for seed in range(3 if IS_NIGHTLY else 1)
        ]
        for method in METHODS
    }
    means = {method: np.mean(of_method) for method, of_method in shares.items()}
    assert min(means["pso"], means["ga"], means["de"]) > means["random"]


@pytest.mark.slow
def test_first_networks_may_come_from_candidates(objective):
    around = sphere_of_poses((0, 0, 0), 3.0, 40)
    allowed = around[SPACE.allows(around[:, :3, 3])]
    assert 0 < len(allowed) < 40
    result = optimise(objective, SPACE, 2, "random", budget=16, population=8, candidates=around)
    for pose in result.poses:
        assert (pose == allowed).all(axis=(1, 2)).any()


@pytest.mark.slow
def test_without_pymoo_one_line_says_what_to_install(objective, monkeypatch):
    monkeypatch.setitem(sys.modules, "pymoo.core.problem", None)
    monkeypatch.setitem(sys.modules, "pymoo.algorithms.soo.nonconvex.de", None)
    with pytest.raises(ConfigError, match=r"method pso needs pymoo; install rastercov\[place\]"):
        optimise(objective, SPACE, 2, "pso", budget=16, population=8)
    assert optimise(objective, SPACE, 2, "random", budget=16, population=8).evaluations == 16


# Where cameras may stand


@examples(10)
@given(
    eyes=st.lists(st.tuples(*[st.floats(-4, 4)] * 3), min_size=1, max_size=8).map(np.array),
    least=st.floats(0, 1),
    clearance=st.floats(0, 1),
)
def test_what_is_settled_stands_where_it_may(eyes, least, clearance):
    ball = KeepOutSphere((1.5, 0, 0), 0.5)
    space = PoseSpace(mesh=MESH, stand_off=(least, 2.0), clearance=clearance, keep_out=(ball,))
    points, allowed = space.project_to_allowed(eyes)
    assert holds(space, points[allowed])
    at_once = space.allows(eyes)
    np.testing.assert_array_equal(points[at_once], eyes[at_once])
    assert allowed[at_once].all()


def test_places_in_a_solid_too_near_or_too_far_are_settled():
    space = PoseSpace(mesh=MESH, stand_off=(0.3, 2.0), clearance=0.1)
    inside = np.array([(np.cos(a), np.sin(a), 0.1) for a in np.linspace(0, 6, 20)])
    assert in_solid(MESH, inside).all()
    for points in (inside, 1.45 * inside, 9.0 * inside):
        assert not space.allows(points).any()
        settled, allowed = space.project_to_allowed(points)
        assert allowed.all()
        # No further than needed: across the tube, or to where the stand-off begins or ends.
        assert (np.linalg.norm(settled - space.nearest_in_boxes(points), axis=1) < 1.5).all()


def test_every_reason_to_refuse_a_place_is_told():
    space = PoseSpace(
        mesh=MESH,
        boxes=[(-3, -3, -3), (3, 3, 3)],
        stand_off=(0.5, 2.0),
        clearance=0.2,
        keep_out=(KeepOutSphere((0, 0, 1.5), 0.11),),
    )
    places = {
        (0, 0, 1.4): Place.KEPT_OUT,
        (0, 0, 1.2): Place.ALLOWED,
        (0, 0, 3): Place.TOO_FAR,
        (0, 0, 0): Place.ALLOWED,
        (0.2, 0, 0): Place.TOO_NEAR,
        (1, 0, 0): Place.IN_SOLID,
        (0, 0, 3.1): Place.OUTSIDE,
    }
    found = space.judge(np.array(list(places), float))
    assert [Place(value) for value in found] == list(places.values())


def test_cameras_on_walls_stay_on_walls(objective):
    walls = [[(-2.5, -3, -3), (-2.5, 3, 3)], [(-3, -3, 2.2), (3, 3, 2.2)]]
    space = PoseSpace(mesh=MESH, boxes=walls, stand_off=(0.0, 4.0))
    result = optimise(objective, space, 4, "random", budget=64, population=8)
    x, _, z = result.poses[:, :3, 3].T
    assert ((x == -2.5) | (z == 2.2)).all()


def test_poses_are_composed_of_what_they_are_decomposed_into():
    poses = sphere_of_poses((0.3, 0.2, 0.1), 2.0, 30)
    turns = np.linspace(-3, 3, len(poses))
    rolled = SPACE.composed(*SPACE.decomposed(poses)[:2], turns)
    np.testing.assert_allclose(SPACE.decomposed(rolled)[2], turns, atol=1e-9)
    np.testing.assert_allclose(SPACE.composed(*SPACE.decomposed(rolled)), rolled, atol=1e-12)


@pytest.mark.slow
def test_no_place_at_all_is_an_error():
    space = PoseSpace(mesh=MESH, boxes=[(8, 8, 8), (9, 9, 9)], stand_off=(0.0, 1.0))
    with pytest.raises(ConfigError, match="no place for 5 cameras"):
        space.sample(5, np.random.default_rng(0))


# What a network is worth
