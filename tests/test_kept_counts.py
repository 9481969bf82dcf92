"""Counts that `evaluate` keeps in place of figures, in few bytes: the figures of the counts."""

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.coverage import coverage
from rastercov.core.coverage.coverage import FIGURES, evaluate_batches
from rastercov.core.raster.contract import as_small

LIMITS = (0, 1, 255, 256, 65_535, 65_536, 2**31 - 1, 2**31, 2**40)


@pytest.mark.parametrize("most", LIMITS)
@pytest.mark.parametrize("kind", [np.int32, np.float64])
def test_counts_are_kept_as_they_are(most, kind):
    most = min(most, np.iinfo(np.int32).max if kind == np.int32 else most)
    rng = np.random.default_rng(most)
    counts = rng.integers(0, most, (3, 7), endpoint=True).astype(kind)
    counts[1, 2] = most
    kept = as_small(counts)
    np.testing.assert_array_equal(kept, counts)
    assert kept.dtype.itemsize == (1 if most < 256 else 2 if most < 65_536 else counts.itemsize)
    assert as_small(counts[:0]).shape == (0, 7)


@pytest.mark.parametrize("seed", range(6))
def test_figures_of_kept_counts_are_those_of_the_counts(seed, monkeypatch):
    monkeypatch.setattr(coverage, "POSES_A_BATCH", 3)  # with their own types
    rng = np.random.default_rng(seed)
    mesh = rc.Mesh.joined([rc.shapes.torus(6, 5), rc.shapes.box()], ["part", "t"])
    mesh = mesh.with_groups(targets=["t"] if seed % 2 else [])
    side = 20 if seed % 3 else 300
    camera = rc.Camera.from_fov(side, side, hfov_deg=60)
    far = mesh.diagonal * np.repeat((3.0, 0.3, 0.1, 0.02), 3)[:, None]
    poses = rc.look_at(rng.normal(size=(12, 3)) * far, (0, 0, 0))
    engine = rc.Engine("sampled", "cpu", int(rng.integers(1, 3)), threads=1 + seed % 2)
    task = rc.Task(min_pixels=2)
    result = rc.evaluate(mesh, camera, poses, task, method=engine)
    with rc.open_observer(mesh, camera, engine) as observer:
        batches = list(evaluate_batches(observer, poses, task))
    for name in FIGURES:
        expected = np.concatenate([getattr(each, name) for each in batches])
        np.testing.assert_array_equal(getattr(result, name), expected, err_msg=name)
    most = {each.drawn_pixels.max() * engine.supersample**2 for each in batches}
    assert side == 20 or min(most) < 1 << 16 <= max(most)
