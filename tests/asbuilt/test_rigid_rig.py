"""Rigid rigs: one displacement of all cameras, from those whose pose is decided."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from test_edges import MESH, off, photograph, pose_of

import rastercov as rc
from rastercov.asbuilt.located import Located, Tolerance
from rastercov.asbuilt.resection import difference, displaced
from rastercov.asbuilt.rig import _move_together as move_together
from rastercov.asbuilt.rig import locate_rig
from rastercov.placement.plan import check as plan_check
from rastercov.placement.plan.check import Checked
from rastercov.placement.plan.file import plan_of

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


SMALL = {"width": 480, "height": 360, "hfov_deg": 50}
HEAD = {
    "cameras": {"eye": SMALL, "single": SMALL},
    "rigs": {
        "head": {
            "cameras": [
                {"camera": "eye", "name": "left"},
                {"camera": "eye", "name": "right", "translation": [0.3, 0.0, 0.0]},
            ]
        }
    },
}


def checked(folder: Path, monkeypatch: pytest.MonkeyPatch, rule: str | None) -> Checked:
    """A head twice, and a single camera, over the cell, as a check of a plan."""
    monkeypatch.chdir(folder)
    MESH.to_trimesh().export("cell.obj")
    head = {**HEAD["rigs"]["head"], **({"rule": rule} if rule else {})}
    table = {"meshes": [{"path": "cell.obj"}], **HEAD, "rigs": {"head": head}}
    plan = plan_of({**table, "selection": {"goal": "best_coverage", "cameras": 5}})
    row = {name: index for index, name in enumerate(plan.rig.names)}
    pair = [row["head/left"], row["head/right"]]
    places = plan.rig.rig_from_camera[pair]
    poses = np.concatenate([pose_of(1) @ places, pose_of(2) @ places, pose_of(3)[None]])
    placed = rc.Poses.of(poses, camera=np.array([*pair, *pair, row["single"]]))
    limits = plan_check.limits(plan, None, {}, may_be_none=True)
    return plan_check.check(plan, Path("rig.json"), limits, poses=placed)


@pytest.mark.parametrize("rule", [None, "all"])
def test_cameras_of_a_head_move_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rule: str | None
) -> None:
    planned = checked(tmp_path, monkeypatch, rule)
    poses = planned.cameras.placed.world_from_camera
    moved = off(poses[0], 5, 1.0, 0.005)
    Image.fromarray((255 * photograph(MESH, moved, 3)).astype(np.uint8)).save("left.png")
    photos = {0: Path("left.png")}
    result = locate_rig(planned, photos, None, lambda found: Tolerance(0.01, 0.5))
    built = result.built.cameras.placed.world_from_camera
    between = np.linalg.inv(poses[0]) @ poses[1]
    assert result.found[0].accepted
    assert np.linalg.norm(difference(built[0], moved)) < 0.02
    assert np.allclose(np.linalg.inv(built[0]) @ built[1], between, atol=1e-9)  # without a photo
    assert np.array_equal(built[2:], poses[2:])  # the other head, and the single camera, stay
