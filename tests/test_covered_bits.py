"""Bits of covered pairs: those of the reasons, areas in any order, views; also by way of shards."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import joined, soup, square

import rastercov as rc
from rastercov.core.coverage import coverage as module
from rastercov.core.raster.contract import UNITS, area_units, whole_area

PINHOLE = rc.Camera(width=64, height=48, fx=40, fy=44)
CAMERAS = (
    PINHOLE,
    rc.Camera(width=64, height=48, fx=40, fy=44, model="opencv", distortion=(-0.05, 0.01, 0, 0, 0)),
    rc.Camera(width=64, height=48, fx=20, fy=20, model="telecentric"),
)
TASK = rc.Task(min_pixels=2, max_incidence_deg=70, min_visibility=0.3)


def scene_of(seed):
    """Triangles of all sizes with a degenerate one, as many as fill no word."""
    rng = np.random.default_rng(seed)
    mesh = joined(soup(rng, int(rng.integers(1, 140))), square(1.0, 3.0))
    faces = np.concatenate([mesh.faces, [(0, 1, 0)] * int(rng.integers(1, 3))])
    wall, leaf = rc.Group("wall", is_occluder=True), rc.Group("leaf", is_two_sided=True)
    roles = [rc.Group("body"), wall, leaf]
    return rc.Mesh(mesh.vertices, faces, roles, rng.integers(0, 3, len(faces)))


@pytest.mark.parametrize("method", ["sampled:cpu", "certified"])
@pytest.mark.parametrize("seed", range(6))
def test_bits_areas_and_views_are_those_of_the_reasons(seed, method, monkeypatch, tmp_path):
    mesh = scene_of(seed)
    monkeypatch.setattr(module, "PAIRS_A_BATCH", 3 * mesh.n_faces)
    rng = np.random.default_rng(seed)
    poses = rc.look_at(rng.normal(size=(11, 3)), np.add(rng.normal(size=(11, 3)), (0, 0, 2)))
    placed = rc.Poses.of(poses, camera=rng.integers(0, 3, 11))
    rig = list(CAMERAS) if method == "sampled:cpu" else [PINHOLE] * 3
    scene = (mesh, rig, placed, TASK)
    options = {"method": rc.Engine.of(method, threads=2), "by": "face"}
    result = rc.evaluate(*scene, **options, fields=("covered", "reason"))
    covers, bits = result.reason == rc.Reason.COVERED, result.bits
    assert covers.any()
    assert bits.packed.shape == (11, -(-mesh.n_faces // 8))
    np.testing.assert_array_equal(bits.packed, np.packbits(covers, axis=1, bitorder="little"))
    np.testing.assert_array_equal(bits.dense(slice(2, 5)), covers[2:5])
    with pytest.raises(rc.ConfigError, match="expected poses to be a slice, got array"):
        bits.dense(np.arange(2))
    np.testing.assert_array_equal(bits.views, covers.sum(axis=0))
    np.testing.assert_array_equal(bits.area_units, (covers * area_units(mesh)).sum(axis=1))
    exact = (covers * np.where(mesh.task_mask, mesh.areas, 0)).sum(axis=1)
    np.testing.assert_allclose(
        bits.areas, exact, rtol=0, atol=mesh.n_faces * whole_area(mesh) / UNITS
    )
    alone = rc.evaluate(*scene, **options, fields=("covered",)).bits
    kept = rc.evaluate(*scene, **options, fields=("covered",), shards=tmp_path).bits
    for name, value in vars(bits).items():
        np.testing.assert_array_equal(getattr(alone, name), value)
        np.testing.assert_array_equal(getattr(kept, name), value)


def test_bits_that_were_not_asked_for_are_refused():
    mesh = rc.shapes.box((1, 1, 1))
    result = rc.evaluate(mesh, replace(PINHOLE, fx=30), rc.look_at((3, 0, 0), (0, 0, 0)), fields=())
    with pytest.raises(rc.ConfigError, match="expected bits of pairs, got none; add 'covered'"):
        _ = result.bits


@pytest.mark.parametrize("seed", range(6))
def test_a_network_counts_what_each_camera_covers(seed):
    mesh, rng = scene_of(seed), np.random.default_rng(seed)
    poses = rc.look_at(rng.normal(size=(11, 3)), np.add(rng.normal(size=(11, 3)), (0, 0, 2)))
    for camera in CAMERAS:
        result = rc.evaluate(mesh, camera, poses, TASK, method="sampled", fields=("reason",))
        views = (result.reason == rc.Reason.COVERED).sum(axis=0)
        np.testing.assert_array_equal(result.network.views, views)


@pytest.mark.parametrize("names", [None, ("coverage", "visibility_bound"), ("drawn_pixels",)])
def test_figures_that_are_derived_later_are_those_of_each_batch(names):
    mesh = scene_of(3)
    rng = np.random.default_rng(3)
    poses = rc.look_at(rng.normal(size=(11, 3)), np.add(rng.normal(size=(11, 3)), (0, 0, 2)))
    placed = rc.Poses.of(poses, camera=rng.integers(0, 3, 11))
    result = rc.evaluate(mesh, list(CAMERAS), placed, TASK, method="sampled", fields=names)
    with rc.open_observer(mesh, list(CAMERAS), "sampled") as observer:
        batches = list(module.evaluate_batches(observer, placed, TASK))
    for name in module.FIGURES if names is None else names:
        expected = np.concatenate([getattr(each, name) for each in batches])
        np.testing.assert_array_equal(getattr(result, name), expected)
    for name in () if names is None else set(module.FIGURES) - set(names):
        with pytest.raises(rc.ConfigError, match=f"expected {name} among the fields"):
            getattr(result, name)
