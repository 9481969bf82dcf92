"""The search by weights of faces: its rules written once more by dense arrays, and known optima."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from selection_cases import QUICK, covers_faces, is_met, problems
from set_cover_cases import COVERS, FOLDER, OPTIMA, read_set_cover, steiner

from rastercov.engine import placement_weighting as kernels
from rastercov.placement.bits import by_face
from rastercov.placement.select.bounds import NEVER
from rastercov.placement.select.methods import (
    construct,
    has_equal_cameras,
    search_by_weights,
    select_greedy,
)
from rastercov.placement.select.presolve import presolve
from rastercov.placement.select.problem import FewestCameras, problem_of_matrix

ALL = FewestCameras(of_reachable=True)


class Twin:
    """The search on a (C, F) array, with every gain and loss computed anew."""

    def __init__(self, covers, views, rank, chosen):
        self.covers, self.views, self.rank = covers, views, rank
        self.chosen, self.best = chosen.astype(bool), chosen.astype(bool)
        self.weight = np.ones(covers.shape[1], np.int64)
        self.changed = np.zeros(len(covers), np.int64)
        self.held_back = np.zeros(len(covers), bool)
        self.step, self.added = 0, -1
        count = self.count
        self.open = list(np.flatnonzero(count < views))

    @property
    def count(self):
        return self.covers[self.chosen].sum(axis=0)

    def scores(self):
        without = self.count - self.chosen[:, None]
        return (self.covers & (without < self.views)) @ self.weight

    def first(self, among, sign):
        scores = sign * self.scores()
        return min(among, key=lambda c: (-scores[c], self.changed[c], self.rank[c]), default=None)

    def flip(self, camera):
        before = self.count < self.views
        self.chosen[camera] ^= True
        after = self.count < self.views
        for face in np.flatnonzero(self.covers[camera]):
            if after[face] and not before[face]:
                self.open.append(face)
            elif before[face] and not after[face]:  # the last one takes its place
                self.open[self.open.index(face)] = self.open[-1]
                self.open.pop()
        near = self.covers[:, self.covers[camera]].any(axis=1)
        self.held_back[near] = False
        self.held_back[camera] = not self.chosen[camera]
        self.changed[camera] = self.step

    def drop(self):
        camera = self.first([c for c in np.flatnonzero(self.chosen) if c != self.added], -1)
        if camera is not None:
            self.flip(camera)

    def run(self, numbers, enough):
        for number in numbers:
            self.step += 1
            while not self.open:
                self.best = self.chosen.copy()
                if self.chosen.sum() <= enough:
                    return
                self.added = -1
                self.drop()
            self.drop()
            if not self.open:
                continue
            face = self.open[number % len(self.open)]
            free = self.covers[:, face] & ~self.chosen & ~self.held_back
            if (camera := self.first(np.flatnonzero(free), 1)) is not None:
                self.flip(camera)
                self.added = camera
            self.weight[self.open] += 1
        if not self.open:
            self.best = self.chosen.copy()


def searched(covers, views, rank, chosen, numbers, enough):
    """What the compiled search has at the end, in two calls: best, now, weights, changes, last."""
    n, n_faces = covers.shape
    indptr = np.concatenate(([0], np.cumsum(covers.sum(axis=1))))
    face = np.nonzero(covers)[1].astype(np.int32)
    starts, covering = by_face(indptr, face, n_faces)
    now, best = chosen.astype(np.uint8), chosen.astype(np.uint8)
    weight, changed = np.ones(n_faces, np.int64), np.zeros(n, np.int64)
    last = np.array([0, -1])
    sought = (now, weight, changed, np.zeros(n, np.uint8), last)
    lists = (indptr, face, starts, covering, views.astype(np.int32))
    for part in np.array_split(numbers, 2):
        kernels.fewer_cameras(lists, rank, part, enough, sought, best)
        if best.sum() <= enough:
            break
    return best.astype(bool), now.astype(bool), weight, changed, last


@examples(60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 12), st.integers(0, 2))
def test_steps_are_those_of_dense_arrays(seed, n, n_faces, most_views):
    rng = np.random.default_rng(seed)
    covers = rng.random((n, n_faces)) < rng.choice([0.2, 0.5, 0.9])
    views = np.minimum(rng.integers(0, most_views + 1, n_faces), covers.sum(axis=0))
    rank, numbers = rng.permutation(n), rng.integers(0, 1 << 32, 40, np.uint32)
    enough = int(rng.integers(0, 3))
    best, now, weight, changed, last = searched(covers, views, rank, np.ones(n), numbers, enough)
    twin = Twin(covers, views, rank, np.ones(n))
    for part in np.array_split(numbers, 2):
        twin.run(part, enough)
        twin.open.sort()  # a call finds open faces in the order of their numbers
        if twin.best.sum() <= enough:
            break
    np.testing.assert_array_equal(best, twin.best)
    np.testing.assert_array_equal(now, twin.chosen)
    np.testing.assert_array_equal(weight, twin.weight)
    np.testing.assert_array_equal(changed, twin.changed)
    np.testing.assert_array_equal(last, [twin.step, twin.added])
    assert (covers[best].sum(axis=0) >= views).all()


@examples(40)
@given(problems(goals=["fewest"], angles=[0]))
def test_it_takes_part_only_where_cameras_are_counted_to_cover_all(problem):
    state = construct(presolve(problem).list_rows())
    if not has_equal_cameras(state):
        return
    kept = state.reduced.candidates
    for item in search_by_weights(state, 0, 50, QUICK, 0, NEVER):
        chosen = kept[sorted(item)]
        assert is_met(problem, covers_faces(problem, chosen))
        assert len(chosen) < len(state.chosen)


@pytest.mark.parametrize("n_points", [9, 15, 27, 45])
def test_triple_systems_reach_the_known_optimum(n_points):
    selection = select_greedy(problem_of_matrix(steiner(n_points), ALL), effort=50 * QUICK)
    assert selection.objective == COVERS[n_points]


def test_the_search_beats_the_greedy_rule_on_a_published_cover():
    problem = read_set_cover(FOLDER / "scpe1.txt.xz")
    assert select_greedy(problem).objective == OPTIMA["scpe1"]
    assert select_greedy(problem, effort=0).objective > OPTIMA["scpe1"]
