import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.base.errors import ConfigError
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.observer import open_observer
from rastercov.coverage.task import Task
from rastercov.mesh import shapes
from rastercov.mesh.solids import in_solid
from rastercov.placement.candidates.clearance import (
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Place,
)
from rastercov.placement.improve import objective as objective_module
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
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
def test_every_method_spends_its_budget_within_the_constraints_and_by_its_seed(
    objective, method, monkeypatch
):
    sizes, plain = [], objective_module.evaluate_batches

    def spied(observer, poses, task, **options):
        sizes.append(len(poses))
        return plain(observer, poses, task, **options)

    def found(seed):
        return optimise(objective, SPACE, 2, method, budget=41, population=8, seed=seed)

    # The state of the old generator is the one that a search must leave alone.
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    with monkeypatch.context() as patch:
        patch.setattr(objective_module, "evaluate_batches", spied)
        result = found(3)
    assert sizes == [16, 16, 8]  # a generation a batch
    assert (result.evaluations, len(result.trace), result.generations) == (40, 20, 3)
    assert holds(SPACE, result.poses[:, :3, 3])
    assert result.share == result.trace[-1] == objective.share_of(result.poses)
    assert (np.diff(result.trace) >= 0).all()
    np.testing.assert_array_equal(result.poses, found(3).poses)
    assert (result.poses != found(4).poses).any()
    np.testing.assert_array_equal(np.random.get_state()[1], state)  # noqa: NPY002


@pytest.mark.slow
def test_all_methods_begin_with_the_same_networks_which_may_be_of_candidates(objective):
    around = sphere_of_poses((0, 0, 0), 3.0, 40)
    allowed = around[SPACE.allows(around[:, :3, 3])]
    assert 0 < len(allowed) < 40
    for candidates in (None, around):
        results = [
            optimise(objective, SPACE, 2, each, budget=16, population=8, candidates=candidates)
            for each in METHODS
        ]
        for result in results[1:]:
            np.testing.assert_array_equal(result.trace, results[0].trace)
    for pose in results[0].poses:
        assert (pose == allowed).all(axis=(1, 2)).any()


@pytest.fixture(scope="module")
def good(objective):
    """The best network of a hundred."""
    return optimise(objective, SPACE, 2, "random", budget=200, population=50, seed=9)


@pytest.mark.slow
def test_a_search_is_no_worse_than_its_start(objective, good, method):
    # Turned about their axes, the poses are none that the variables can express.
    turned = good.poses.copy()
    turned[:, :3, :2] = turned[:, :3, 1::-1] * (1, -1)
    for start in (good.poses, turned):
        result = optimise(objective, SPACE, 2, method, budget=32, population=8, start=start)
        assert result.share >= objective.share_of(start)


@pytest.mark.slow
def test_searching_beats_drawing_at_random(objective):
    free = replace(SPACE, boxes=None, keep_out=())
    shares = {each: optimise(objective, free, 3, each, budget=900).share for each in METHODS}
    assert min(shares["pso"], shares["ga"], shares["de"]) > shares["random"], shares


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
