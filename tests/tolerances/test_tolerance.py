import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_search import CAMERA, MESH, TASK

from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.coverage import open_observer
from rastercov.placement.improve.objective import Objective
from rastercov.tolerances import placement as tolerance_module
from rastercov.tolerances.placement import (
    LEVELS,
    InstallationError,
    Spread,
    disturb_poses,
    tolerance,
)

POSES = sphere_of_poses((0, 0, 0), 2.7, 4)
SOME = InstallationError(position_mm=100, angle_deg=5)


@pytest.fixture(scope="module", params=[0, 30], ids=["any directions", "directions apart"])
def objective(request):
    with open_observer(MESH, CAMERA) as observer:
        yield Objective.of(observer, TASK, min_angle_deg=request.param)


def test_without_errors_the_nominal_coverage_is_left(objective):
    result = tolerance(objective, POSES, InstallationError(), draws=5)
    assert result.nominal == objective.share_of(POSES)
    for spread in (result.together, *(camera.alone for camera in result.cameras)):
        assert (spread.shares == result.nominal).all()
        assert set(spread.quantiles) == {result.nominal}
        assert spread.mean == pytest.approx(result.nominal)
    np.testing.assert_array_equal(result.face_chance, covered_by(objective, POSES))


def covered_by(objective, poses):
    return objective.covered(objective.covers(poses), poses[:, :3, 3])


def test_leaving_a_camera_out_is_what_the_others_cover(objective):
    result = tolerance(objective, POSES, SOME, draws=3)
    whole = covered_by(objective, POSES)
    for row, camera in enumerate(result.cameras):
        others = np.delete(POSES, row, axis=0)
        assert camera.without == objective.share_of(others)
        assert camera.own_faces == (whole & ~covered_by(objective, others)).sum()
    assert result.critical == np.argmin([camera.without for camera in result.cameras])


@pytest.mark.slow
def test_every_draw_is_what_its_disturbed_poses_cover(objective):
    result = tolerance(objective, POSES, SOME, draws=6, seed=8)
    disturbed = disturb_poses(POSES, SOME, 6, np.random.default_rng(8))
    for number, poses in enumerate(disturbed):
        assert result.together.shares[number] == objective.share_of(poses)
        for row, camera in enumerate(result.cameras):
            one = POSES.copy()
            one[row] = poses[row]
            assert camera.alone.shares[number] == objective.share_of(one)
    counts = sum(covered_by(objective, poses).astype(int) for poses in disturbed)
    np.testing.assert_array_equal(result.face_chance, counts / 6)
    assert result.most_sensitive == np.argmin([camera.alone.mean for camera in result.cameras])
    assert result.evaluations == 4 * 7


@pytest.mark.slow
def test_the_same_seed_gives_the_same_draws_however_they_are_batched(objective, monkeypatch):
    one, other = (tolerance(objective, POSES, SOME, draws=7, seed=seed) for seed in (2, 3))
    monkeypatch.setattr(tolerance_module, "PAIRS_AT_ONCE", 1)
    two = tolerance(objective, POSES, SOME, draws=7, seed=2)
    np.testing.assert_array_equal(one.together.shares, two.together.shares)
    np.testing.assert_array_equal(one.face_chance, two.face_chance)
    assert one.summary() == two.summary()
    assert (one.together.shares != other.together.shares).any()


@pytest.mark.slow
@given(shares=st.lists(st.floats(0, 1), min_size=1, max_size=50))
def test_quantiles_are_draws_in_order_and_the_first_is_the_worst(shares):
    spread = Spread.of(np.array(shares))
    assert spread.worst == min(shares)
    assert spread.quantiles[-1] == max(shares)
    assert list(spread.quantiles) == sorted(spread.quantiles)
    assert set(spread.quantiles) <= set(shares)
    for level, quantile in zip(LEVELS, spread.quantiles, strict=True):
        assert (np.array(shares) <= quantile).mean() >= level - 1e-12


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_errors_have_the_size_that_was_asked_for(distribution):
    error = InstallationError(position_mm=20, angle_deg=3, distribution=distribution)
    disturbed = disturb_poses(POSES, error, 4000, np.random.default_rng(0))
    shift = disturbed[..., :3, 3] - POSES[:, :3, 3]
    turn = np.swapaxes(POSES[:, :3, :3], 1, 2) @ disturbed[..., :3, :3]
    angle = np.arccos(np.clip((np.trace(turn, axis1=2, axis2=3) - 1) / 2, -1, 1))
    for sizes, size in ((np.linalg.norm(shift, axis=2), 0.02), (angle, math.radians(3))):
        if distribution == "normal":
            assert np.sqrt((sizes**2).mean() / 3) == pytest.approx(size, rel=0.02)
        else:
            assert sizes.max() <= size * (1 + 1e-9)
            # A ball of half the radius holds an eighth.
            assert (sizes < size / 2).mean() == pytest.approx(1 / 8, abs=0.02)
    assert np.abs(shift.mean(axis=(0, 1))).max() < 0.001


def test_a_network_without_cameras_has_no_critical_one():
    with open_observer(MESH, CAMERA) as observer:
        result = tolerance(Objective.of(observer, TASK), np.zeros((0, 4, 4)), SOME, draws=2)
    assert (result.critical, result.most_sensitive, result.nominal) == (-1, -1, 0.0)
