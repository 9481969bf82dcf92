from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import IS_NIGHTLY, examples, nightly
from test_search import CAMERA, MESH, SPACE, TASK, holds

from rastercov.base.arguments import Lists
from rastercov.core.area.cells import cells
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.coverage.task import Task
from rastercov.placement.improve import refine as refine_module
from rastercov.placement.improve.objective import CellObjective, Objective
from rastercov.placement.improve.refine import refine

BUDGET = 800 if IS_NIGHTLY else 300
TASK_BY_AREA = Task(max_incidence_deg=70, min_pixels_per_m2=300)


@pytest.fixture(scope="module")
def objective():
    with open_observer(MESH, CAMERA) as observer:
        yield Objective.of(observer, TASK)


def network(count, seed, space=SPACE):
    """Cameras at random places that look near the middle of the part."""
    rng = np.random.default_rng(seed)
    eyes = space.sample(count, rng)
    return space.composed(eyes, rng.normal(0, 0.5, (count, 3)) - eyes, rng.uniform(-3, 3, count))


@pytest.mark.slow
@examples(4, 20)
@given(seed=st.integers(0, 10**6), cameras=st.integers(1, 3), views=st.integers(1, 2))
def test_refinement_is_never_worse_and_keeps_every_constraint(objective, seed, cameras, views):
    each = replace(objective, need=np.full_like(objective.need, views))
    start = network(cameras, seed)
    result = refine(each, SPACE, start, halvings=2, budget=BUDGET)
    assert result.share >= result.start_share == each.share_of(start)
    assert result.share == each.share_of(result.poses)
    assert holds(SPACE, result.poses[:, :3, 3])
    assert result.evaluations <= BUDGET
    assert (np.diff(result.trace) > 0).all()
    assert (result.trace[0], result.trace[-1]) == (result.start_share, result.share)
    np.testing.assert_array_equal(result.moved, (result.poses != start).any(axis=(1, 2)))
    # Roll is fixed.
    np.testing.assert_allclose(
        np.exp(1j * SPACE.decomposed(result.poses)[2]), np.exp(1j * SPACE.decomposed(start)[2])
    )


@pytest.mark.slow
def test_the_same_start_and_seed_give_the_same_network(objective):
    one, two, other = (
        refine(objective, SPACE, network(2, 5), seed=seed, halvings=1) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.poses, two.poses)
    np.testing.assert_array_equal(one.trace, two.trace)
    assert one.evaluations == two.evaluations
    assert (one.poses != other.poses).any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=nightly) for n in range(1, 5))])
def test_from_a_local_optimum_no_move_that_is_tried_gains(objective, seed, monkeypatch):
    how = {"step": 0.3, "halvings": 2}
    result = refine(objective, SPACE, network(2, seed), **how)
    assert result.status == "local optimum"
    assert result.status == "local optimum"
    monkeypatch.setattr(refine_module, "RANDOM_MOVES", 0)  # they are others each time
    again = refine(objective, SPACE, result.poses, **how)
    assert (again.share, again.moved.any()) == (result.share, False)


def test_full_coverage_ends_the_search():
    with open_observer(MESH, CAMERA) as observer:
        objective = Objective.of(observer, replace(TASK, max_incidence_deg=90))
        free = replace(SPACE, boxes=None, keep_out=())
        around = sphere_of_poses((0, 0, 0), 3.3, 24)
        result = refine(objective, free, around[free.allows(around[:, :3, 3])])
    assert result.status == "everything covered"
    assert result.share == 1.0


def test_a_budget_that_is_spent_and_a_network_without_cameras_are_told(objective):
    for budget in (3, 50):
        result = refine(objective, SPACE, network(2, 1), budget=budget)
        assert result.status == "budget spent"
        assert result.evaluations <= budget
    result = refine(objective, SPACE, np.zeros((0, 4, 4)))
    assert (result.share, result.status, result.evaluations) == (0.0, "local optimum", 0)


# --- on cells, by estimates -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def on_cells():
    finder = RegionPass(MESH, CAMERA, TASK_BY_AREA)
    with open_observer(MESH, CAMERA) as observer, closing(finder):
        yield CellObjective.of_cells(observer, finder, cells(MESH, 0.3))


class Misled(CellObjective):
    """Estimates without any truth in them."""

    def estimated(self, poses):
        self.watch(len(poses))
        draws = np.random.default_rng(len(poses)).random((len(poses), len(self.cells)))
        return Lists.of([np.flatnonzero(row < 0.5) for row in draws])


class PlainCells(CellObjective):
    """Without estimates."""

    is_estimated = False
    estimated = CellObjective.listed


@pytest.mark.slow
def test_refinement_on_cells_gains_by_measured_cells_only(on_cells):
    measured = []
    start = network(2, 6)
    watched = replace(on_cells, watch=measured.append)
    result = refine(watched, SPACE, start, halvings=1)
    assert result.status == "local optimum"
    assert result.share > result.start_share == on_cells.share_of(start)
    assert result.share == on_cells.share_of(result.poses)
    assert (np.diff(result.trace) > 0).all()
    # What the start is estimated to cover is counted by the display of progress only.
    assert sum(measured) == result.evaluations + len(start)
    again = refine(on_cells, SPACE, start, halvings=1)
    np.testing.assert_array_equal(result.poses, again.poses)


@pytest.mark.slow
def test_estimates_find_about_as_much_as_measurements(on_cells):
    start = network(2, 7)
    plain = PlainCells(**vars(on_cells))
    quick, thorough = (refine(each, SPACE, start, halvings=2) for each in (on_cells, plain))
    assert quick.share - quick.start_share > 0.9 * (thorough.share - thorough.start_share) > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_estimates_that_mislead_never_lose_anything(on_cells, seed):
    misled = Misled(**vars(on_cells))
    start = network(2, seed)
    result = refine(misled, SPACE, start, halvings=0, budget=400)
    assert result.evaluations <= 400
    assert result.share == on_cells.share_of(result.poses) >= on_cells.share_of(start)
    assert (np.diff(result.trace) > 0).all()


@pytest.mark.slow
def test_an_interrupt_while_trials_are_measured_keeps_the_best_so_far(on_cells):
    ends = []

    def watch(count):
        ends.append(count)
        if len(ends) == 12:
            raise KeyboardInterrupt

    start = network(2, 6)
    result = refine(replace(on_cells, watch=watch), SPACE, start)
    assert result.status == "interrupted"
    assert result.share == on_cells.share_of(result.poses) >= result.start_share


@pytest.mark.slow
def test_free_roll_rolls(objective):
    start = network(1, 4)
    rolls = []
    for is_free in (False, True):
        space = replace(SPACE, boxes=None, is_roll_free=is_free)
        poses = refine(objective, space, start, halvings=1).poses
        rolls.append(abs(SPACE.decomposed(poses)[2] - SPACE.decomposed(start)[2])[0])
    assert rolls[0] < 1e-6 < rolls[1]
