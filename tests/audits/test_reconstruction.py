"""Weak zones, overlap and suggested images of an audit: each against its definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import amount, examples

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement import NearestSurface
from rastercov.placement.audit import audit
from rastercov.placement.reconstruction import (
    KINDS,
    LEAST_OVERLAP,
    coarse_density,
    suggest,
    summary_of,
    weak,
)

MESH = shapes.torus(24, 12)
CAMERA = rc.Camera(width=320, height=240, fx=260, fy=260)


def from_above(count, seed=1, spread=0.4):
    rng = np.random.default_rng(seed)
    eyes = rng.normal(size=(count, 3)) * (spread, spread, 0.1) + (0, 0, 3.5)
    return rc.look_at(eyes, rng.normal(0, 0.1, (count, 3)))


@pytest.mark.parametrize("unit", ["m", "unit"])
def test_suggested_images_keep_the_size_of_a_camera_from_what_is_in_metres(unit):
    small = rc.Mesh(0.05 * MESH.vertices, MESH.faces)
    poses = from_above(6)
    poses[:, :3, 3] *= 0.05
    made = suggest(audit(small, CAMERA, poses), 4, unit=unit)
    eyes = made.poses.world_from_camera[:, :3, 3]
    away = NearestSurface(small).query(eyes).distance.min()
    assert away >= 0.05 if unit == "m" else away > 0


@pytest.mark.slow
@examples(2, at_night=12)
@given(seed=st.integers(0, 999), by=st.sampled_from(["area", "face"]), views=st.integers(1, 3))
def test_the_promise_of_suggested_images_is_the_audit_of_all_images(seed, by, views):
    task, poses = rc.Task(views=views, min_angle_deg=8 * (views - 1)), from_above(5, seed)
    result = audit(MESH, CAMERA, poses, task, by=by)
    made = suggest(result, amount(2, at_night=3))
    said, joined = made.summary(), np.concatenate([poses, made.poses.world_from_camera])
    for row in range(len(made.poses) + 1):
        after = audit(MESH, CAMERA, joined[: 5 + row], task, by=by)
        share = ([said["before"], *said["images"]])[row]
        assert share["covered_percent"] == after.summary()["covered_percent"]
        assert share["weak_percent"] == summary_of(after)["weak"]["percent"]
    assert said["after"]["weak_percent"] < said["before"]["weak_percent"]


@pytest.mark.slow
@examples(2, at_night=12)
@given(seed=st.integers(0, 999), count=st.integers(1, 9))
def test_weak_zones_and_overlap_are_their_definitions(seed, count):
    result = audit(MESH, CAMERA, from_above(count, seed, 3.0), by="face")
    covers = np.array(
        [np.isin(np.arange(576), result.problem.faces_of(row)) for row in range(count)]
    )
    said, zones = summary_of(result), weak(result)
    graph, shared = said["overlap"], (covers * MESH.areas) @ covers.T
    for pair in graph["pairs"]:
        one, other = map(int, pair["images"])
        assert pair["shared_m2"] == pytest.approx(shared[one, other], rel=1e-6)
    least = np.minimum.outer(np.diag(shared), np.diag(shared))
    linked = (shared >= LEAST_OVERLAP * least) & (shared > 0) | np.eye(count, dtype=bool)
    reach = np.linalg.matrix_power(linked.astype(int), count) > 0
    assert {frozenset(map(int, part)) for part in graph["components"]} == {
        frozenset(np.flatnonzero(row).tolist()) for row in reach
    }
    few, narrow = result.views < 2, result.widest_angle < np.radians(5)
    np.testing.assert_array_equal(zones.kind == KINDS.index("few_views"), few)
    np.testing.assert_array_equal(zones.kind == KINDS.index("small_angle"), ~few & narrow)
    assert said["weak"]["percent"] == pytest.approx(100 * zones.area.sum() / MESH.areas.sum())
    corners = [set(MESH.faces[zones.zone == row].ravel()) for row in range(len(zones.area))]
    kinds = [zones.kind[zones.zone == row] for row in range(len(zones.area))]
    for row, kind in enumerate(kinds):  # zones of one kind have no corner in common
        assert (kind == kind[0]).all()
        assert not any(corners[row] & corners[n] for n in range(row) if kinds[n][0] == kind[0])


@pytest.mark.parametrize(
    ("count", "spread", "by"), [(5, 0.4, "area"), (9, 3.0, "face"), (2, 1.0, "area")]
)
def test_images_that_are_said_to_mend_half_of_a_weak_zone_do(count, spread, by):
    """With them a new audit finds half of the zone or more not weak, but for a new median."""
    poses = from_above(count, spread=spread)
    result = audit(MESH, CAMERA, poses, by=by)
    zones, said = weak(result), summary_of(result)["weak"]["zones"]
    tried = [(row, zone["tried"]) for row, zone in enumerate(said) if zone["tried"]]
    assert len(tried) >= 2
    for row, images in tried:
        n = len(images["positions"])
        assert f"take {n} more image" in said[row]["advice"]
        new = rc.look_at(images["positions"], images["looking_at"])
        after = audit(MESH, CAMERA, np.concatenate([poses, new]), by=by)
        own, weights = zones.zone == row, result.problem.weights
        wanted = 2, np.radians(5), 0.98 * coarse_density(result)
        figures = after.views, after.widest_angle, after.best_density
        is_strong = np.all([a >= b for a, b in zip(figures, wanted, strict=True)], axis=0)
        assert weights[own & is_strong].sum() >= 0.5 * weights[own].sum()
    silent = [zone for zone in said if "would improve at least half of it" in zone["advice"]]
    assert all("take " not in zone["advice"] for zone in silent)


def test_a_weak_zone_on_a_separate_component_says_so():
    """A crumb beside a part is named, the part is not; a second half is no noise."""
    for scale, is_noise in ((0.2, True), (0.95, False)):
        crumb = np.add(np.multiply(MESH.vertices, scale), (0, 0, 3.0))
        faces = np.concatenate([MESH.faces, MESH.faces + MESH.n_vertices])
        both = rc.Mesh(np.concatenate([MESH.vertices, crumb]), faces)
        for by in ("face", "area"):
            zones = summary_of(audit(both, CAMERA, from_above(3), by=by))["weak"]["zones"]
            share = 100 * scale**2 / (1 + scale**2)
            apart = [zone for zone in zones if zone["centroid"][2] > 2]
            assert 0 < len(apart) < len(zones)
            for zone in zones:
                is_apart = zone["centroid"][2] > 2
                assert (zone["separate_percent"] is not None) == is_apart
                assert (
                    zone["advice"].startswith("on a separate component of the mesh (") == is_apart
                )
                assert ("may be noise" in zone["advice"]) == (is_apart and is_noise)
            assert apart[0]["separate_percent"] == pytest.approx(share)
