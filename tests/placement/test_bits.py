"""Covered pairs as bits: every sum, count and list of them against the dense array."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.placement import bits
from rastercov.placement.bits import CoveredBits, pack_bits, spread_out, unpack_bits

pytestmark = pytest.mark.native


@st.composite
def dense_and_bits(draw):
    """A dense array, and its bits in one part or in several."""
    n, m = draw(st.sampled_from((0, 1, 5, 40))), draw(st.sampled_from((1, 63, 64, 65, 200)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dense = rng.random((n, m)) < draw(st.sampled_from((0.0, 0.05, 0.5, 1.0)))
    cut = draw(st.integers(0, n))
    bits = CoveredBits.from_dense(dense)
    if draw(st.booleans()):
        first, rest = (CoveredBits.from_dense(part) for part in (dense[:cut], dense[cut:]))
        bits = first.joined(rest)
    return dense, bits, rng


@examples(25)
@given(dense_and_bits())
def test_bits_are_the_pairs_of_the_dense_array(case):
    dense, result, rng = case
    n, m = dense.shape
    assert (result.n_rows, result.n_faces) == (n, m)
    for row in range(n):
        faces = result.faces_of(row)
        assert faces.dtype == np.int32
        assert faces.tolist() == np.flatnonzero(dense[row]).tolist()
        np.testing.assert_array_equal(unpack_bits(result.row(row), m), dense[row])
    for count in range(4):
        counts = np.minimum(dense.sum(axis=0), count)
        np.testing.assert_array_equal(result.counts_up_to(count), counts)
    rows = rng.integers(0, n, 7) if n else np.zeros(0, np.int64)  # in any order, some twice
    values = rng.integers(-(2**62), 2**62, (3, m))
    masks = rng.random((3, m)) < 0.7
    some = result.sums(spread_out(values), np.stack([pack_bits(mask) for mask in masks]), rows)
    np.testing.assert_array_equal(some, dense[rows].astype(np.int64) @ (values * masks).T)
    np.testing.assert_array_equal(
        result.sums(spread_out(values)), dense.astype(np.int64) @ values.T
    )


@pytest.mark.parametrize("threads", [1, 3])
def test_sums_do_not_depend_on_threads(monkeypatch, threads):
    rng = np.random.default_rng(1)
    dense, values = rng.random((300, 1000)) < 0.2, rng.integers(0, 2**40, (2, 1000))
    monkeypatch.setattr(bits, "WORDS_A_TURN", 64)
    monkeypatch.setattr(bits, "thread_count", lambda asked: threads)
    result = CoveredBits.from_dense(dense)
    np.testing.assert_array_equal(
        result.sums(spread_out(values)), dense.astype(np.int64) @ values.T
    )
