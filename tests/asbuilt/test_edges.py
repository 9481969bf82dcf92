"""Poses from edges of photographs that the rasteriser shades: found, or undecided, never wrong."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import rastercov as rc
from rastercov.asbuilt import alignment, resection
from rastercov.asbuilt.alignment import COMMON, FINAL, MOST_SPREAD, Aligner, Matches, covariance_of
from rastercov.asbuilt.alignment import _along as along
from rastercov.asbuilt.edges import EdgePoints
from rastercov.asbuilt.located import Tolerance
from rastercov.asbuilt.photograph import Level, brightness

CAMERA = rc.Camera.from_fov(480, 360, hfov_deg=50)
OF_NIGHT = (pytest.mark.slow, pytest.mark.matter("asbuilt"))


def cell() -> rc.Mesh:
    """Boxes on a floor, none like another."""
    parts = [rc.shapes.box((3, 3, 0.1)).moved(translation=(0, 0, -0.05))]
    rng = np.random.default_rng(4)
    for _ in range(7):
        size = rng.uniform(0.2, 0.6, 3)
        place = (*rng.uniform(-1, 1, 2), size[2] / 2 + 0.01)
        parts.append(
            rc.shapes.box(tuple(size)).moved(
                axis=(0, 0, 1), angle_deg=rng.uniform(0, 90), translation=place
            )
        )
    return rc.Mesh.joined(parts)


MESH = cell()


def photograph(
    mesh: rc.Mesh, pose: np.ndarray, seed: int, camera: rc.Camera = CAMERA
) -> np.ndarray:
    """Faces shaded by their normals, with noise."""
    rng = np.random.default_rng(seed)
    light = rng.normal(size=3)
    shade = 0.55 + 0.4 * mesh.normals @ (light / np.linalg.norm(light))
    with rc.open_rasterizer(mesh, camera, "cpu", supersample=1) as rasterizer:
        face = rasterizer.render(pose).face
    grey = np.append(shade, 0.5)[face]
    return np.clip(grey + rng.normal(size=grey.shape) * 0.03, 0, 1)


def pose_of(seed: int) -> np.ndarray:
    """Pose above the cell."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi)
    eye = (3.2 * np.cos(angle), 3.2 * np.sin(angle), rng.uniform(1.5, 3))
    return np.asarray(rc.look_at(eye, rng.normal(size=3) * 0.1)[0])


def off(pose: np.ndarray, seed: int, degrees: float, share: float) -> np.ndarray:
    """Pose turned, and moved by a share of the distance."""
    rng = np.random.default_rng(seed)
    turn, step = rng.normal(size=(2, 3))
    turn *= np.radians(degrees) / np.linalg.norm(turn)
    step *= share * 3.8 / np.linalg.norm(step)
    return resection.displaced(pose, np.concatenate((turn, step)))


@pytest.mark.parametrize("seed", [0, *(pytest.param(each, marks=OF_NIGHT) for each in (1, 2))])
def test_a_pose_is_found_or_undecided(seed: int) -> None:
    true = pose_of(seed)
    photo = photograph(MESH, true, seed)
    found = rc.locate(MESH, CAMERA, photo, off(true, seed + 50, 1.0, 0.01))
    points = MESH.vertices
    apart = resection.pixels_of(points, CAMERA, found.pose) - resection.pixels_of(
        points, CAMERA, true
    )
    assert found.accepted, found.why
    assert np.nanmax(np.linalg.norm(apart, axis=1)) < 1
    assert found.covariance.shape == (6, 6)
    assert found.explained > 0.6


def test_a_pose_beyond_the_range_that_is_searched_is_undecided(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of a mirrored photograph, whose best pose lies there."""
    true = pose_of(0)
    monkeypatch.setattr(alignment, "BASIN", alignment.BASIN * (3, 3, 3, 1, 1, 1))
    found = rc.locate(MESH, CAMERA, photograph(MESH, true, 0), off(true, 50, 9.0, 0.0))
    assert found.turned_deg == pytest.approx(9, abs=0.1)
    assert not found.accepted
    assert "so large a turn" in found.why


def test_another_scene_is_undecided() -> None:
    true = pose_of(0)
    other = photograph(
        rc.shapes.teapot().moved(scale=10), np.asarray(rc.look_at((3, 1, 2), (0, 0, 0))[0]), 0
    )
    noise = np.random.default_rng(0).random((CAMERA.height, CAMERA.width))
    for photo in (other, noise, np.full_like(noise, 0.5)):
        found = rc.locate(MESH, CAMERA, photo, true)
        assert not found.accepted
        assert "--points" in found.why


def test_a_symmetric_part_has_several_poses() -> None:
    mesh = rc.shapes.sphere(3).moved(scale=0.5)
    pose = np.asarray(rc.look_at((0, 0.1, 2), (0, 0, 0))[0])
    found = rc.locate(mesh, CAMERA, photograph(mesh, pose, 1), pose)
    assert not found.accepted


def test_what_moved_is_told_from_what_did_not() -> None:
    tolerance = Tolerance(place=0.03, turn_deg=0.7)
    for seed in (1, 2):
        plan = pose_of(seed)
        same = rc.locate(MESH, CAMERA, photograph(MESH, plan, seed), plan)
        assert tolerance.verdict(same) == "as planned", same
        moved = rc.locate(MESH, CAMERA, photograph(MESH, off(plan, seed, 1.5, 0), seed), plan)
        assert tolerance.verdict(moved) == "moved", moved
        assert abs(moved.turned_deg - 1.5) < 0.1
    turned = resection.displaced(plan, np.array((0, np.radians(1), 0, 0, 0, 0)))  # to the right
    found = rc.locate(MESH, CAMERA, photograph(MESH, turned, 1), plan)
    right, up, clockwise = found.to_plan_deg()
    assert abs(right + 1) < 0.1
    assert abs(up) < 0.1
    assert abs(clockwise) < 0.1
    said = [Tolerance(0.03, limit).words(found) for limit in (0.5, 1, 1.5)]
    assert ": turn 1 deg left" in said[0]
    assert said[1] == f"{said[0]}; its error reaches across the limit of 30 mm and 1 deg"
    assert said[2] == said[0].split(": turn")[0]  # as planned: nothing is to be turned


def test_gradients_are_averaged_along_each_edge_alone() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        edge = np.repeat(rng.permutation(9), rng.integers(0, 15, 9))
        values = rng.normal(size=(len(edge), 3)) + 1j * rng.normal(size=(len(edge), 3))
        got, count = along(values, edge)
        for row in range(len(edge)):
            near = np.flatnonzero((edge == edge[row]) & (np.abs(np.arange(len(edge)) - row) <= 4))
            assert count[row] == len(near)
            np.testing.assert_allclose(got[row], values[near].mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("reach", [1.0, 2.0, 3.0, 5.0])
def test_an_edge_beside_another_keeps_its_place(reach: float) -> None:
    """The other is 4 px or more away, up to three times as strong, brighter or darker."""
    columns = np.arange(80)
    rows = np.arange(10, 50, 2) + 0.5
    camera = rc.Camera(width=80, height=60, fx=80, fy=80)
    for gap, ratio, at in product((4, 5, 6, -4, -5, -6), (1, 3, -1, -3), (30.0, 30.25, 30.5, 30.8)):
        step, other = (np.clip(columns + 1 - place, 0, 1) for place in (at, at + gap))
        grey = np.tile(0.4 + 0.1 * (step + ratio * other), (60, 1)).astype(np.float32)
        column = np.full(len(rows), at)
        points = np.stack(((column - camera.cx) / 80, (rows - camera.cy) / 80, column / at), axis=1)
        edge = EdgePoints(points, np.tile((0.0, 1, 0), (len(rows), 1)), np.zeros(len(rows), int))
        matches = Matches.of(Level(grey, camera), edge, np.eye(4), reach)
        assert (matches.strength > 0).all(), (gap, ratio, at)
        assert np.abs(matches.distance).max() < 0.15, (gap, ratio, at)


@pytest.mark.parametrize("seed", [1, pytest.param(0, marks=OF_NIGHT)])
def test_noise_that_hides_each_pixel_of_an_edge_does_not_hide_the_edge(seed: int) -> None:
    true = pose_of(seed)
    photo = photograph(MESH, true, seed)
    photo += np.random.default_rng(seed + 9).normal(size=photo.shape) * 0.35
    found = rc.locate(MESH, CAMERA, photo, off(true, seed + 50, 1.0, 0.01))
    assert found.accepted, found.why
    apart = resection.pixels_of(MESH.vertices, CAMERA, found.pose) - resection.pixels_of(
        MESH.vertices, CAMERA, true
    )
    assert np.nanmax(np.linalg.norm(apart, axis=1)) < 2


def test_poses_beside_the_best_are_tried_in_every_direction() -> None:
    """Each moves an edge by 5 px, as far as parallel edges may be apart, in six directions."""
    true = pose_of(1)
    aligner = Aligner(MESH, CAMERA, brightness(photograph(MESH, true, 1), CAMERA))
    beside = aligner._beside(true)
    seen = aligner.points_at(aligner.levels[-1], true, 4.0).points
    before = resection.pixels_of(seen, CAMERA, true)
    moved = [resection.pixels_of(seen, CAMERA, pose) - before for pose in beside]
    for each in moved:
        assert abs(np.nanmax(np.linalg.norm(each, axis=1)) - 5) < 0.5
    sizes = np.linalg.svd(np.nan_to_num([each.ravel() for each in moved]), compute_uv=False)
    assert (sizes > 0.02 * sizes[0]).sum() >= 6


def test_a_displacement_that_all_edges_of_a_direction_share_is_within_one_deviation() -> None:
    """As of shadows by light from one side: the covariance counts it once, however many edges."""
    true = pose_of(1)
    aligner = Aligner(MESH, CAMERA, brightness(photograph(MESH, true, 1), CAMERA))
    level = aligner.levels[-1]
    points = aligner.points_at(level, true, 2.0)
    matches = Matches.of(level, points, true, FINAL)
    covariance = covariance_of(level, points, true, matches)
    rows, jacobian, weights = alignment._equations(level, points, true, matches, FINAL)
    x, y = matches.normals[rows].T
    turn = np.rint(np.arctan2(y, x) / np.pi * 4).astype(int)
    for direction in range(4):
        shifted = COMMON * (turn % 4 == direction) * (1 - turn // 4 % 2 * 2)
        square = jacobian.T @ (jacobian * weights[:, None])
        step = np.linalg.solve(square, jacobian.T @ (shifted * weights))
        assert step @ np.linalg.solve(covariance, step) < 1


def test_halves_of_the_edges_must_agree() -> None:
    """A photograph whose squares, as of a checkerboard, are of two poses has neither."""
    true = pose_of(1)
    other = off(true, 3, 0.4, 0.004)
    row, column = np.indices((CAMERA.height, CAMERA.width)) // (CAMERA.width // 8)
    own, moved = (photograph(MESH, pose, 1) for pose in (true, other))
    mixed = np.where((row + column) % 2, own, moved)
    apart = resection.pixels_of(MESH.vertices, CAMERA, other) - resection.pixels_of(
        MESH.vertices, CAMERA, true
    )
    assert np.nanmax(np.linalg.norm(apart, axis=1)) > 2.5
    told = [
        Aligner(MESH, CAMERA, brightness(photo, CAMERA)).by_halves(true) for photo in (own, mixed)
    ]
    assert told[0] < 0.3
    assert told[1] > 1
    assert rc.locate(MESH, CAMERA, own, true).accepted
    assert "halves of its edges" in rc.locate(MESH, CAMERA, mixed, true).why


def test_a_pose_that_edges_do_not_fix_comes_after_one_that_they_fix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    true = pose_of(1)
    other = off(true, 3, 1.0, 0.01)
    aligner = Aligner(MESH, CAMERA, brightness(photograph(MESH, true, 1), CAMERA))
    judge = aligner._judge
    monkeypatch.setattr(aligner, "_refine_level", lambda level, poses: [other, true])
    for firm, first in (([other], other), ([other, true], true), ([], true)):

        def judged(pose: np.ndarray, firm: list[np.ndarray] = firm) -> alignment.Optimum:
            is_firm = any(pose is each for each in firm)
            spread = MOST_SPREAD * (1 if is_firm else 1.01)
            return replace(judge(pose), pose=pose, spread=spread)

        monkeypatch.setattr(aligner, "_judge", judged)
        assert np.array_equal(aligner.find(true)[0][0].pose, first)


def test_edges_of_which_a_place_shows_few_count_little() -> None:
    """A texture over half of the picture, in which some edges have one of the texture beside."""
    errors = []
    for seed in (0, 3, 4):
        true = pose_of(seed)
        photo = photograph(MESH, true, seed)
        blocks = np.kron(np.random.default_rng(seed).random((45, 60)), np.ones((8, 8)))
        photo[:, 200:] = blocks[:, 200:]
        aligner = Aligner(MESH, CAMERA, brightness(photo, CAMERA))
        level = aligner.levels[-1]
        points = aligner.points_at(level, true)
        matches = Matches.of(level, points, true, FINAL)
        for group in np.unique(matches.group):
            own = matches.strength[matches.group == group]
            assert own.max() <= np.count_nonzero(own) / len(own)
        pose = alignment.refine(level, points, true, 3.0)
        apart = resection.pixels_of(points.points, CAMERA, pose)
        apart -= resection.pixels_of(points.points, CAMERA, true)
        errors.append(np.nanmax(np.linalg.norm(apart, axis=1)))
    assert sum(errors) < 1.4


def test_a_pose_is_judged_where_weights_of_the_least_reach_put_it() -> None:
    true = pose_of(1)
    near = off(true, 3, 0.03, 0.0003)
    aligner = Aligner(MESH, CAMERA, brightness(photograph(MESH, true, 1), CAMERA))
    before, after = (
        resection.distance(pose, true, MESH.vertices) for pose in (near, aligner._judge(near).pose)
    )
    assert after < before / 2


@pytest.mark.parametrize("seed", [1, 3])
def test_edges_that_weights_leave_out_widen_the_covariance(seed: int) -> None:
    """A third of the picture is 2 px off: what is left out of the pose counts in its deviation."""
    true = pose_of(seed)
    photo = photograph(MESH, true, seed)
    photo[:, 300:] = np.roll(photo, 2, axis=0)[:, 300:]
    aligner = Aligner(MESH, CAMERA, brightness(photo, CAMERA))
    level = aligner.levels[-1]
    pose = alignment.refine(level, aligner.points_at(level, true), true, alignment.WIDE)
    points = aligner.points_at(level, pose)
    wider = alignment.refine(level, points, pose, alignment.WIDE, alignment.WIDE)
    apart = resection.pixels_of(points.points, CAMERA, wider)
    apart -= resection.pixels_of(points.points, CAMERA, pose)
    bias = float(np.nanmax(np.linalg.norm(apart, axis=1)))
    assert bias > 0.2
    matches = Matches.of(level, points, pose, FINAL)
    alone = resection.spread_of(
        covariance_of(level, points, pose, matches), points.points, CAMERA, pose
    )
    spread = aligner._judge(pose).spread
    assert spread >= 0.95 * bias / np.sqrt(2)
    assert spread > alone
