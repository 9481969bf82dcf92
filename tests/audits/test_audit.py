"""Audits: every figure against its definition, computed again the slow way."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples

from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.viewpoints import look_at
from rastercov.coverage.area.regions import regions
from rastercov.coverage.area.union import unite
from rastercov.coverage.task import Task
from rastercov.mesh import Group, Mesh, shapes
from rastercov.placement.audit import audit

MESH = shapes.torus(20, 10)
WIDE = Camera(width=320, height=240, fx=220, fy=230)
LONG = Camera(width=200, height=200, fx=300, fy=300, cx=90)
CAMERAS = (WIDE, LONG)


def looking_in(seed, count):
    rng = np.random.default_rng(seed)
    eyes = rng.normal(size=(count, 3))
    eyes *= rng.uniform(2.5, 4.5, count)[:, None] / np.linalg.norm(eyes, axis=1)[:, None]
    return Poses.of(look_at(eyes, rng.normal(0, 0.2, (count, 3))), camera=rng.integers(0, 2, count))


def pairs_of(found):
    """(P, E) bool: pairs of camera and element."""
    covers = np.zeros((len(found.poses), found.problem.n_faces), bool)
    for row in range(len(covers)):
        covers[row, found.problem.faces_of(row)] = 1
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


@pytest.mark.slow
@settings(max_examples=8)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(1, 12),
    views=st.integers(1, 3),
    by=st.sampled_from(["area", "face"]),
)
def test_every_figure_is_its_definition(seed, count, views, by):
    poses, task = looking_in(seed, count), Task(views=views)
    found = audit(MESH, CAMERAS, poses, task, by=by, resolution_of_result=0.4)
    covers, on = pairs_of(found), MESH if by == "face" else found.cells.elements
    weights = np.where(on.task_mask, on.areas, 0)
    np.testing.assert_array_equal(found.views, covers.sum(axis=0))
    np.testing.assert_array_equal(found.covered, (covers.sum(axis=0) >= views) & (weights > 0))
    rng = np.random.default_rng(seed)
    for e in rng.choice(on.n_faces, 12):
        cameras = np.flatnonzero(covers[:, e])
        point, normal = on.centroids[e], on.normals[e]
        rays = poses.world_from_camera[cameras, :3, 3] - point
        widest = max((angle(a, b) for a in rays for b in rays), default=0.0)
        assert found.widest_angle[e] == pytest.approx(widest, abs=1e-7)
        best = [
            density(point, normal, poses.world_from_camera[c], CAMERAS[poses.camera[c]])
            for c in cameras
        ]
        assert found.best_density[e] == pytest.approx(max(best, default=0), rel=1e-6)
        if best:
            assert best[list(cameras).index(found.best_camera[e])] == pytest.approx(
                max(best), rel=1e-6
            )
        else:
            assert found.best_camera[e] == -1
    enough = covers.sum(axis=0) >= views
    for row in range(count):
        without = np.delete(covers, row, axis=0).sum(axis=0) >= views
        assert found.lost_m2[row] == pytest.approx(weights[enough & ~without].sum(), abs=1e-12)
        only = covers[row] & (covers.sum(axis=0) == 1)
        assert found.alone_m2[row] == pytest.approx(weights[only].sum(), abs=1e-12)
        assert found.seen_m2[row] == pytest.approx(weights[covers[row]].sum(), abs=1e-12)


@pytest.mark.slow
@examples(4, at_night=8)
@given(seed=st.integers(0, 10_000), views=st.integers(1, 2), least=st.sampled_from([0, 20, 60]))
def test_the_subset_covers_what_all_cameras_cover(seed, views, least):
    task = Task(views=views, min_angle_deg=least)
    found = audit(MESH, CAMERAS, looking_in(seed, 14), task, by="face")
    _, covered = found.problem.covered_by(found.subset.chosen)
    weighted = found.problem.weights > 0
    np.testing.assert_array_equal(covered & weighted, found.covered)
    assert found.subset.bound <= len(found.subset.chosen) <= 14
    every = np.arange(14)
    for row in every:
        _, rest = found.problem.covered_by(np.delete(every, row))
        lost = found.problem.weights[found.covered & ~rest].sum()
        assert found.lost_m2[row] == pytest.approx(lost, abs=1e-12)
    assert not np.any(found.redundant & (found.lost_m2 > 0))


def test_a_camera_twice_is_redundant_and_left_out_of_the_subset():
    poses = looking_in(3, 5).world_from_camera
    found = audit(MESH, WIDE, np.concatenate([poses, poses]))
    assert found.redundant.all()
    assert not found.alone_m2.any()
    chosen = set(found.subset.chosen.tolist())
    assert not any({row, row + 5} <= chosen for row in range(5))


def test_covered_area_is_that_of_exact_regions():
    poses = looking_in(7, 6)
    found = audit(MESH, CAMERAS, poses)
    exact = unite(regions(MESH, CAMERAS, poses))
    summary = found.summary()
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
    names = list("abcdef")
    found = audit(both, WIDE, matrices, names=names, by="face", skip_bad_poses=True)
    assert found.names == ("a", "b", "d", "e", "f")
    assert not found.views[MESH.n_faces :].any()
    assert found.summary()["subset"]["names"] == [found.names[row] for row in found.subset.chosen]


def test_no_camera_covers_nothing():
    found = audit(MESH, WIDE, np.empty((0, 4, 4)))
    assert not found.views.any()
    assert found.summary()["covered_percent"] == 0
    assert len(found.subset.chosen) == 0
