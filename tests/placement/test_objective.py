"""Faces covered by number and angle of the views: compiled loops and their twin."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.base.memory import Lists
from rastercov.coverage.task import Task
from rastercov.placement.improve.objective import Objective
from rastercov.reference.views import covered_faces

ANGLES_DEG = (0, 1, 40, 90, 120, 180)


def objective(rng, n_faces, angle_deg):
    """Objective of faces with these centroids and random needs, without an observer."""
    mesh = SimpleNamespace(centroids=rng.uniform(-1, 1, (n_faces, 3)))
    cosine = np.cos(np.radians(angle_deg)) + 1e-12 if angle_deg else 2.0
    need = rng.integers(1, 4, n_faces)
    observer = SimpleNamespace(mesh=mesh)
    return Objective(observer, Task(), rng.integers(0, 9, n_faces), need, cosine)


@pytest.mark.parametrize("angle_deg", ANGLES_DEG)
@given(seed=st.integers(0, 2**32 - 1), n_cameras=st.integers(0, 7))
@examples(20)
def test_faces_are_covered_as_in_the_twin_by_the_first_cameras_and_with_each_other(
    angle_deg, seed, n_cameras
):
    rng = np.random.default_rng(seed)
    judge = objective(rng, 30, angle_deg)
    given_by = judge.observer.mesh.centroids, judge.need, judge.min_cosine
    covers = rng.random((n_cameras, 30)) < rng.uniform(0.2, 1)
    eyes = 4 * rng.normal(size=(n_cameras, 3)) * rng.choice([1, 0.02])
    eyes[rng.random(n_cameras) < 0.2] = judge.observer.mesh.centroids[0]  # a ray without length
    until = judge.cameras_until_covered(covers, eyes)
    for n in range(n_cameras + 1):
        expected = covered_faces(covers[:n], eyes[:n], *given_by)
        np.testing.assert_array_equal(until <= n, expected)
    others, centres = rng.random((3, 30)) < 0.5, 4 * rng.normal(size=(3, 3))
    found = np.empty(others.shape, bool)
    for trial in range(3):
        both = np.vstack((covers, others[trial])), np.vstack((eyes, centres[trial]))
        found[trial] = covered_faces(*both, *given_by)
    lists = Lists.of([np.flatnonzero(row) for row in others])
    without = judge.worth(judge.covered(covers, eyes))
    added = judge.worth_added(covers, eyes, lists, centres)
    np.testing.assert_array_equal(without + added, judge.worth(found))
