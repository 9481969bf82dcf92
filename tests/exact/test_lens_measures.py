"""Edges are measured eight at a time, by the rule that the longest needs, within their bounds."""

import numpy as np
import pytest
from lens_cameras import CAMERAS

from rastercov.core.camera.lenses.of_camera import planes_of
from rastercov.engine.exact_lens import EDGE_ROUNDING, edge_bulges, vertex_images
from rastercov.engine.lens_edges import MOST, bulge, node_values

pytestmark = pytest.mark.native


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS)
def test_edges_of_any_lengths_agree_with_the_best_rule(camera):
    """Random places: neighbours in a list need other rules, have no image or are too long."""
    rng, values = np.random.default_rng(2), np.empty((MOST + 1, 2))
    rules, n_taken = set(), 0
    for record in (each.record for each in planes_of(CAMERAS[camera])):
        if not len(record.window) or len(record.hole) or record.is_graded:
            continue
        limits = record.longest[record.longest > 0]
        if not limits[-1] < np.inf:
            continue
        half = np.exp(rng.uniform(np.log(limits[0]) - 2, np.log(limits[-1]) + 0.5, 900))
        middle = record.window.min(axis=0) + rng.random((900, 2)) * np.ptp(record.window, axis=0)
        turn = rng.uniform(0, 2 * np.pi, 900)
        step = half[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
        both = np.concatenate((middle - step, middle + step))
        uvw = np.ones((len(both), 3))
        uvw[:, :2] = both * (record.fx, record.fy) + (record.cx, record.cy)
        places, inside = np.empty((len(both), 4)), np.empty(len(both), np.bool_)
        vertex_images(uvw, record, places, inside)
        ends = np.arange(len(both), dtype=np.int32).reshape(2, -1).T[:-3].copy()
        result, longer = np.empty(len(ends)), np.empty(len(ends), np.int32)
        n_longer = edge_bulges(record, ends, places, result, longer)
        length = np.linalg.norm(places[ends[:, 0], :2] - places[ends[:, 1], :2], axis=1)
        known = inside[ends].all(axis=1)
        assert set(longer[:n_longer]) == set(np.flatnonzero(known & (length / 2 > limits[-1])))
        assert (np.isnan(result) == (~known | (length / 2 > limits[-1]))).all()
        rounding = EDGE_ROUNDING * (record.width + record.height)
        for e in np.flatnonzero(~np.isnan(result)):
            node_values(record, places[ends[e], :2].ravel(), values)
            size = np.abs(np.diff(values, axis=0)).sum() + 1
            error = abs(result[e] - bulge(*values.T.copy()))
            assert error <= 2 * record.tolerance + rounding * size
            rules.add(int(np.searchsorted(record.longest, length[e] / 2)))
            n_taken += 1
    assert (n_taken > 100 and len(rules) > 3) or camera in ("skew", "equirectangular")
