import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.core.camera.camera import Camera
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import shapes
from rastercov.core.mesh.solids import in_solid
from rastercov.placement.candidates.rooms import (
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Place,
)
from rastercov.placement.improve import objective as objective_module
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import optimise

MESH = shapes.torus(10, 6)
CAMERA = Camera(width=64, height=48, fx=60.0, fy=60.0, cx=32.0, cy=24.0)
TASK = Task(max_incidence_deg=75)
KEPT_OUT = KeepOutBox((0.5, -9, -9), (9, 9, 9), "half")
SPACE = PoseSpace(mesh=MESH, stand_off=(1.0, 2.5), clearance=0.5, keep_out=(KEPT_OUT,))


@pytest.fixture(scope="module")
def objective():
    with open_observer(MESH, CAMERA) as observer:
        yield Objective.of(observer, TASK)


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
def test_a_search_spends_its_budget_within_the_constraints_and_by_its_seed(objective, monkeypatch):
    sizes, plain = [], objective_module.evaluate_batches

    def spied(observer, poses, task, **options):
        sizes.append(len(poses))
        return plain(observer, poses, task, **options)

    def answer(seed):
        return optimise(objective, SPACE, 2, budget=300, seed=seed)

    # The state of the old generator is the one that a search must leave alone.
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    with monkeypatch.context() as patch:
        patch.setattr(objective_module, "evaluate_batches", spied)
        result = answer(3)
    assert sizes == [256, 44]
    assert result.evaluations == 300
    assert holds(SPACE, result.poses[:, :3, 3])
    assert result.share == result.trace[-1] == objective.share_of(result.poses)
    assert (np.diff(result.trace) > 0).all()
    np.testing.assert_array_equal(result.poses, answer(3).poses)
    assert (result.poses != answer(4).poses).any()
    np.testing.assert_array_equal(np.random.get_state()[1], state)  # noqa: NPY002


@pytest.mark.slow
def test_no_exchange_of_one_camera_gains_among_the_measured_poses(objective, monkeypatch):
    measured, plain = [], objective_module.evaluate_batches

    def spied(observer, poses, task, **options):
        measured.append(poses.world_from_camera)
        return plain(observer, poses, task, **options)

    with monkeypatch.context() as patch:
        patch.setattr(objective_module, "evaluate_batches", spied)
        result = optimise(objective, SPACE, 2, budget=40)
    (poses,) = measured
    for place in range(2):
        network = result.poses.copy()
        for network[place] in poses:
            assert objective.share_of(network) <= result.share
    for pose in result.poses:
        assert (pose == poses).all(axis=(1, 2)).any()


@pytest.mark.slow
def test_a_search_is_no_worse_than_its_start_and_keeps_the_camera_of_each(objective):
    start = optimise(objective, SPACE, 2, budget=200, seed=9)
    result = optimise(objective, SPACE, 2, budget=32, start=start.poses)
    assert result.share >= start.share == result.trace[0]
    again = optimise(objective, SPACE, 2, budget=2, start=start.poses)
    np.testing.assert_array_equal(again.poses, start.poses)
    assert (again.evaluations, again.generations, again.share) == (2, 1, start.share)


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
    result = space.judge(np.array(list(places), float))
    assert [Place(value) for value in result] == list(places.values())


def test_cameras_on_walls_stay_on_walls(objective):
    walls = [[(-2.5, -3, -3), (-2.5, 3, 3)], [(-3, -3, 2.2), (3, 3, 2.2)]]
    space = PoseSpace(mesh=MESH, boxes=walls, stand_off=(0.0, 4.0))
    result = optimise(objective, space, 4, budget=64)
    x, _, z = result.poses[:, :3, 3].T
    assert ((x == -2.5) | (z == 2.2)).all()
