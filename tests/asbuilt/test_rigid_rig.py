"""Rigid rigs: one displacement of all cameras, from those whose pose is decided."""

from dataclasses import replace

import numpy as np
import pytest
from test_edges import off, pose_of

from rastercov.asbuilt.located import Located
from rastercov.asbuilt.resection import difference, displaced
from rastercov.asbuilt.rig import _move_together as move_together

SIGMA = np.array((1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 4e-3))


def rig(seed: int, n: int = 4) -> tuple[np.ndarray, np.ndarray, dict[int, Located]]:
    """Poses of the plan, those as built after one displacement, and what photographs say."""
    rng = np.random.default_rng(seed)
    planned = np.array([pose_of(10 * seed + k) for k in range(n)])
    moved = displaced(np.eye(4), rng.normal(size=6) * (0.01, 0.01, 0.01, 0.03, 0.03, 0.03))
    built = moved @ planned
    found = {}
    for row in range(n):
        seen = displaced(built[row], rng.normal(size=6) * SIGMA)
        found[row] = Located(
            seen, np.diag(SIGMA**2), np.empty((0, 2)), np.empty(0, bool), True, "",
            seen[None], 0.1, 0.9, planned[row], 3.0,
        )  # fmt: skip
    return planned, built, found


@pytest.mark.parametrize("seed", range(8))
def test_all_cameras_follow_the_decided_ones(seed: int) -> None:
    planned, built, found = rig(seed)
    found[3] = replace(found[3], accepted=False, why="no edges")
    del found[2]  # no photograph
    together, poses = move_together(found, planned)
    assert together[3].accepted
    for row in range(4):
        error = difference(poses[row], built[row])
        assert np.linalg.norm(error[:3]) < 5e-3
        assert np.linalg.norm(error[3:]) < 2e-2
    between = np.linalg.inv(planned[0]) @ planned[1:]
    assert np.allclose(np.linalg.inv(poses[0]) @ poses[1:], between, atol=1e-9)  # still rigid


def test_errors_are_those_that_the_covariance_says() -> None:
    squares, alone = [], []
    for seed in range(60):
        planned, built, found = rig(seed)
        together, poses = move_together(found, planned)
        error = difference(poses[1], built[1])
        squares.append(error @ np.linalg.solve(together[1].covariance, error))
        alone.append(np.trace(together[1].covariance) / np.trace(found[1].covariance))
    assert 4 < np.median(squares) < 7  # chi-squared of six degrees: 5.35
    assert np.max(alone) < 1  # better than each by itself


def test_a_camera_that_moved_by_itself_is_told() -> None:
    planned, _, found = rig(1)
    found[2] = replace(found[2], pose=off(found[2].pose, 3, 1.0, 0))
    together, poses = move_together(found, planned)
    assert not any(each.accepted for each in together.values())
    assert "did not move as one" in together[0].why
    assert np.array_equal(poses, planned)


def test_nothing_follows_where_nothing_is_decided() -> None:
    planned, _, found = rig(2)
    found = {row: replace(each, accepted=False, why="dark") for row, each in found.items()}
    together, poses = move_together(found, planned)
    assert {each.why for each in together.values()} == {"dark"}
    assert np.array_equal(poses, planned)
