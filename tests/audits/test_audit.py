"""Audits: every figure of a camera and of a frame against its definition, the slow way."""

import math
from dataclasses import replace
from importlib import import_module
from itertools import combinations
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.placement import FewestCameras, problem_of_matrix, select_greedy
from rastercov.placement.audit import audit, groups_of

audits = import_module("rastercov.placement.audit")
MESH = shapes.torus(20, 10)
WIDE = rc.Camera(width=320, height=240, fx=220, fy=230)
LONG = rc.Camera(width=200, height=200, fx=300, fy=300, cx=90)
CAMERAS = (WIDE, LONG)


def looking_in(seed, count):
    rng = np.random.default_rng(seed)
    eyes = rng.normal(size=(count, 3))
    eyes *= rng.uniform(2.5, 4.5, count)[:, None] / np.linalg.norm(eyes, axis=1)[:, None]
    poses = rc.look_at(eyes, rng.normal(0, 0.2, (count, 3)))
    return rc.Poses.of(poses, camera=rng.integers(0, 2, count))


def pairs_of(result):
    """(P, E) bool: pairs of camera and element."""
    covers = np.zeros((len(result.poses), result.problem.n_faces), bool)
    for row in range(len(covers)):
        covers[row, result.problem.faces_of(row)] = 1
    return covers


def density(point, normal, pose, camera):
    """Least singular value of the projection on the surface, by differences."""
    across = np.linalg.svd(normal[None])[2][1:]
    step = 1e-6
    ends = point + step * np.stack([across[0], -across[0], across[1], -across[1]])
    image = to_image(to_camera(ends, pose), camera)
    slopes = np.stack([image[0] - image[1], image[2] - image[3]], axis=1) / (2 * step)
    return np.linalg.svd(slopes)[1][1]


def angle(a, b):
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return 2 * math.asin(min(1.0, np.linalg.norm(a - b) / 2))


def areas_are_defined(figures, owner, covers, covered, weights):
    """Assert the areas of each camera, or of each frame, with the rows of `owner`."""
    for row in range(len(figures.seen_m2)):
        own = owner == row
        seen = covers[own].any(axis=0)
        areas = {
            "seen_m2": seen,
            "alone_m2": seen & ~covers[~own].any(axis=0),
            "lost_m2": covered(own | ~own) & ~covered(~own),
        }
        for name, mask in areas.items():
            assert getattr(figures, name)[row] == pytest.approx(weights[mask].sum(), abs=1e-12)


@pytest.mark.slow
@examples(8, at_night=8)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(1, 12),
    views=st.integers(1, 3),
    by=st.sampled_from(["area", "face"]),
)
def test_every_figure_is_its_definition(seed, count, views, by):
    poses, task = looking_in(seed, count), rc.Task(views=views)
    result = audit(MESH, CAMERAS, poses, task, by=by, resolution_of_result=0.4)
    covers, on = pairs_of(result), MESH if by == "face" else result.cells.elements
    weights = np.where(on.task_mask, on.areas, 0)
    np.testing.assert_array_equal(result.views, covers.sum(axis=0))
    np.testing.assert_array_equal(result.covered, (covers.sum(axis=0) >= views) & (weights > 0))
    for e in np.random.default_rng(seed).choice(on.n_faces, 12):
        cameras = np.flatnonzero(covers[:, e])
        point, normal = on.centroids[e], on.normals[e]
        rays = poses.world_from_camera[cameras, :3, 3] - point
        widest = max((angle(a, b) for a in rays for b in rays), default=0.0)
        assert result.widest_angle[e] == pytest.approx(widest, abs=1e-7)
        best = {
            c: density(point, normal, poses.world_from_camera[c], CAMERAS[poses.camera[c]])
            for c in cameras
        }
        most = pytest.approx(max(best.values(), default=0), rel=1e-6)
        assert result.best_density[e] == most
        assert result.best_camera[e] == -1 if not best else best[result.best_camera[e]] == most
    areas_are_defined(
        result, np.arange(count), covers, lambda rows: covers[rows].sum(axis=0) >= views, weights
    )


@pytest.mark.slow
@examples(4, at_night=10)
@given(
    seed=st.integers(0, 10_000),
    views=st.integers(1, 3),
    least=st.sampled_from([0, 20, 60]),
    n_frames=st.integers(1, 5),
)
def test_a_subset_of_cameras_and_of_frames_covers_what_all_cover(seed, views, least, n_frames):
    numbers = np.random.default_rng(seed).integers(0, n_frames, 14)
    frames = [f"t{number}" for number in numbers]
    task = rc.Task(views=views, min_angle_deg=least)
    result = audit(MESH, CAMERAS, looking_in(seed, 14), task, by="face", frames=frames)
    covers, weights = pairs_of(result), np.where(MESH.task_mask, MESH.areas, 0)

    def covered(rows):
        return result.problem.covered_by(np.flatnonzero(rows))[1] & (weights > 0)

    names = list(dict.fromkeys(frames))
    owner = np.array([names.index(frame) for frame in frames])
    assert list(result.frames.names) == names
    areas_are_defined(result.frames, owner, covers, covered, weights)
    areas_are_defined(result, np.arange(14), covers, covered, weights)
    assert not np.any(result.redundant & (result.lost_m2 > 0))
    for subset, owners in ((result.subset, np.arange(14)), (result.frames.subset, owner)):
        np.testing.assert_array_equal(covered(np.isin(owners, subset.chosen)), result.covered)
        assert subset.bound <= len(subset.chosen)
    enough = [
        len(chosen)
        for n in range(len(names) + 1)
        for chosen in combinations(range(len(names)), n)
        if (covered(np.isin(owner, chosen)) == result.covered).all()
    ]
    assert result.frames.subset.bound == len(result.frames.subset.chosen) == min(enough)
    assert result.frames.subset.status == "optimal"


@pytest.mark.parametrize("least", [0, 40])
@pytest.mark.parametrize("views", [1, 2])
def test_the_smallest_subset_is_proved_by_trying_all(views, least, monkeypatch):
    """And without an integer program its bound holds, with those that are needed one at a time."""
    task = rc.Task(views=views, min_angle_deg=least)
    poses = looking_in(5 + views, 11)
    result = audit(MESH, CAMERAS, poses, task, by="face")
    size = next(
        n
        for n in range(12)
        for chosen in combinations(range(11), n)
        if (result.problem.covered_by(chosen)[1] >= result.covered).all()
    )
    assert len(result.subset.chosen) == result.subset.bound == size
    monkeypatch.setattr(audits, "select_integer", Mock(side_effect=rc.ConfigError("no highspy")))
    without = audit(MESH, CAMERAS, poses, task, by="face").subset
    assert (result.lost_m2 > 0).sum() <= without.bound <= size <= len(without.chosen)


def test_an_interrupt_of_the_proof_ends_the_audit(monkeypatch):
    stopped = Mock(return_value=Mock(status="interrupted"))
    monkeypatch.setattr(audits, "select_integer", stopped)
    # A triangle of candidates: two are needed, and the linear program proves one and a half.
    covers = np.kron(np.eye(5), np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]]))
    problem = problem_of_matrix(covers, FewestCameras(1.0, of_reachable=True))
    monkeypatch.setattr(audits, "select_greedy", lambda p: replace(select_greedy(p), gap=0.5))
    with pytest.raises(KeyboardInterrupt):
        audits.fewest(problem, 0)


def test_a_camera_twice_is_redundant_and_left_out_of_the_subset():
    poses = looking_in(3, 5).world_from_camera
    result = audit(MESH, WIDE, np.concatenate([poses, poses]))
    assert result.redundant.all()
    assert not result.alone_m2.any()
    chosen = set(result.subset.chosen.tolist())
    assert not any({row, row + 5} <= chosen for row in range(5))


def test_covered_area_is_that_of_exact_regions():
    poses = looking_in(7, 6)
    summary = audit(MESH, CAMERAS, poses).summary()
    exact = rc.unite(rc.regions(MESH, CAMERAS, poses))
    assert summary["covered_area"]["m2"] == pytest.approx(exact.area[0].sum(), abs=1e-9)
    # The elements are half covered or not at all: near to it.
    assert summary["covered_percent"] == pytest.approx(summary["covered_area"]["percent"], abs=2)
    assert [entry["name"] for entry in summary["per_camera"]] == list("012345")


def test_occluders_and_bad_poses_are_left_out():
    both = Mesh(
        np.concatenate([MESH.vertices, np.add(MESH.vertices, (3, 0, 0))]),
        np.concatenate([MESH.faces, MESH.faces + MESH.n_vertices]),
        [Group("part"), Group("fixture", is_occluder=True)],
        np.repeat([0, 1], MESH.n_faces),
    )
    matrices = looking_in(1, 6).world_from_camera.copy()
    matrices[2, 0, 0] = 9
    result = audit(
        both, WIDE, rc.Poses.of(matrices, skip_bad=True), names=list("abcdef"), by="face"
    )
    assert result.names == ("a", "b", "d", "e", "f")
    assert not result.views[MESH.n_faces :].any()
    assert result.summary()["subset"]["names"] == [
        result.names[row] for row in result.subset.chosen
    ]
    assert result.summary()["covered_percent_on"] == "faces"


def test_cameras_of_a_rig_have_figures_by_name():
    poses = looking_in(4, 8)
    result = audit(MESH, rc.Rig(CAMERAS, ["wide", "long"]), poses, by="face")
    entries, covers = result.summary()["by_camera"], pairs_of(result)
    assert [entry["camera"] for entry in entries] == ["wide", "long"]
    for row, entry in enumerate(entries):
        own = poses.camera == row
        assert entry["poses"] == own.sum()
        assert entry["seen_m2"] == pytest.approx(MESH.areas[covers[own].any(axis=0)].sum())
    assert "frames" not in result.summary()
    assert "by_camera" not in audit(MESH, WIDE, poses.world_from_camera).summary()


def test_no_camera_covers_nothing():
    result = audit(MESH, WIDE, np.empty((0, 4, 4)))
    assert not result.views.any()
    assert result.summary()["covered_percent"] == 0
    assert len(result.subset.chosen) == 0
    assert groups_of(result.problem, result.covered, []).names == ()
