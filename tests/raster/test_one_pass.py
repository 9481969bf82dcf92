"""Faces that the CPU judges while their counts are in the cache: those that it judges later."""

from dataclasses import replace

import numpy as np
import pytest
from judged_scenes import LENSES, compare, criteria_of, scene_of

import rastercov as rc
from rastercov.base.errors import DeviceError
from rastercov.core.raster import cpu, lens
from rastercov.core.raster.contract import area_units

pytestmark = pytest.mark.native

MESH = rc.shapes.torus(12, 8)
CAMERA = rc.Camera.from_fov(80, 60, hfov_deg=50)
POSES = rc.sphere_of_poses((0, 0, 0), 2 * MESH.diagonal, 8)


@pytest.mark.parametrize("seed", range(60))
def test_one_pass_judges_as_two_do(seed):
    rng = np.random.default_rng(seed)
    mesh, camera, poses, supersample = scene_of(rng)
    roll = float(rng.choice((0.0, 0.4)))
    options = {"supersample": supersample, "roll": roll, "threads": 1 + seed % 3}
    with rc.open_rasterizer(mesh, camera, "cpu", **options) as rasterizer:
        for _ in range(3):
            compare(rasterizer, poses, rng=rng)


@pytest.mark.parametrize("seed", range(20))
def test_evaluations_of_bits_alone_are_those_with_reasons(seed):
    rng = np.random.default_rng(seed)
    mesh, camera, poses, supersample = scene_of(rng)
    task = rc.Task(
        min_pixels=rng.uniform(0.5, 3),
        max_incidence_deg=rng.uniform(30, 90),
        min_visibility=rng.choice((0, 0.5)),
        min_pixel_density=0 if camera.is_parallel else rng.choice((0, 1 / mesh.diagonal)),
    )
    engine = rc.Engine("sampled", "cpu", supersample, threads=1 + seed % 3)
    alone, both = (
        rc.evaluate(mesh, camera, poses, task, method=engine, fields=fields)
        for fields in (("covered",), ("covered", "reason"))
    )
    covers = both.reason == rc.Reason.COVERED
    for bits in (alone.bits, both.bits):
        np.testing.assert_array_equal(bits.dense(), covers)
        np.testing.assert_array_equal(bits.area_units, covers @ area_units(mesh))
        np.testing.assert_array_equal(bits.views, covers.sum(axis=0))
    np.testing.assert_array_equal(alone.clipped, both.clipped)


@pytest.mark.parametrize("camera", [CAMERA, replace(CAMERA, **LENSES[0])])
def test_bits_alone_keep_no_counts(camera, monkeypatch):
    mesh, poses = MESH, rc.sphere_of_poses((0, 0, 0), 2 * MESH.diagonal, 40)
    run = (mesh, camera, poses)
    expected = rc.evaluate(*run, method="sampled", fields=("covered", "reason")).bits
    monkeypatch.delattr(cpu.InLoops, "_count_faces")
    found = rc.evaluate(*run, method="sampled", fields=("covered",)).bits
    np.testing.assert_array_equal(found.packed, expected.packed)
    assert found.views.any()


@pytest.mark.parametrize("make", [dict, lambda: LENSES[0]])
def test_what_is_left_to_two_passes_is_named(make, monkeypatch):
    camera = replace(CAMERA, **make())
    plain = criteria_of(MESH, rc.Task().rules(camera))
    with rc.open_rasterizer(MESH, camera, "cpu") as rasterizer:
        for value, reason in ((0.0, ""), (2.0, "no loop judges min_gloss")):
            criteria = replace(plain, rules={**plain.rules, "min_gloss": value})
            assert rasterizer._why_not_judged(criteria) == reason
        assert len(rasterizer._judge(POSES[:0], plain)[0].packed) == 0
    with pytest.raises(DeviceError, match="got a closed one"):
        rasterizer._judge(POSES, plain)
    monkeypatch.setattr(cpu, "MAX_PART", 1000)
    views = lens.SampleViews(camera, 1, 0.0, most_rows=1000) if camera.is_curved else None
    monkeypatch.setattr(lens, "views_of", lambda *args, **kept: views)
    with rc.open_rasterizer(MESH, camera, "cpu") as rasterizer:
        assert "counted one after another" in rasterizer._why_not_judged(plain)
