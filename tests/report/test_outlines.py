"""Outlines are pixels of a row beside those of another one; every pixel of a face is counted."""

import numpy as np
import pytest

from rastercov.report.images import count_pixels, outlines


@pytest.mark.parametrize("seed", range(20))
def test_an_outline_has_another_row_above_below_left_or_right(seed):
    rng = np.random.default_rng(seed)
    rows = rng.integers(-1, rng.integers(1, 4), rng.integers(1, 12, 2))
    height, width = rows.shape
    for (y, x), value in np.ndenumerate(outlines(rows)):
        beside = ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1))
        around = {int(rows[at]) for at in beside if 0 <= at[0] < height and 0 <= at[1] < width}
        assert value == (rows[y, x] >= 0 and bool(around - {int(rows[y, x])}))


@pytest.mark.parametrize("seed", range(20))
def test_every_pixel_of_a_face_is_counted(seed):
    rng = np.random.default_rng(seed)
    face = rng.integers(-1, rng.integers(1, 4), rng.integers(1, 12, 2)).astype(np.int32)
    assert count_pixels(face, 5).tolist() == [int((face == each).sum()) for each in range(5)]
