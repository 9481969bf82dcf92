"""Lanes are looked up, listed and weighed like in numpy.

Operators on lanes are held by the stages that use them: `test_raster_stages`.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numba import njit
from numba.core import types

from rastercov.kernels.raster_memory import LANES, make_scratch
from rastercov.kernels.raster_stage_depth import count_block
from rastercov.kernels.simd import gather  # fmt: skip
from rastercov.kernels.simd_kernel import (  # fmt: skip
    append_set_bits,
    count_bits,
    lowest_bit,
    pointer,
    simd,
)
from rastercov.reference import raster_stages as twin


def look_up(kind, n):
    """A loop that looks up lanes in an array of n, and gathers them."""

    @simd(returns=types.void)
    def both_ways(array, index, found, gathered):
        found[0] = array.lookup(n, index[0])
        gathered[0] = gather(array.pointer, index[0])

    @njit
    def loop(array, index, found, gathered):
        both_ways(pointer(array), pointer(index), pointer(found), pointer(gathered))

    return loop


@pytest.mark.slow
@pytest.mark.parametrize("n", [64, 256])
@pytest.mark.parametrize("kind", [np.int32, np.float64])
def test_lanes_are_looked_up_and_gathered_alike(kind, n):
    rng = np.random.default_rng(n)
    table = rng.integers(-(2**31), 2**31, n).astype(kind)
    loop, found = look_up(kind, n), np.zeros((2, LANES), kind)
    for _ in range(50):
        index = rng.integers(0, n, LANES).astype(np.int32)
        loop(table, index, *found)
        assert np.array_equal(found[0], table[index])
        assert np.array_equal(found[1], table[index])


# --- bits and lists of lanes ----------------------------------------------------------------------


@njit
def list_all(bit_indices, starts, listed):
    """Lists of all masks; how long they are then."""
    lengths = np.empty(len(listed), np.int64)
    for mask in range(len(listed)):
        lengths[mask] = append_set_bits(
            pointer(bit_indices), mask, 3 * mask, pointer(listed[mask]), starts[mask]
        )
    return lengths


@pytest.mark.slow
def test_every_mask_is_listed_in_order_behind_what_was_there():
    n_masks, room = 1 << LANES, 3 * LANES
    bit_indices = make_scratch().bit_indices
    starts = np.random.default_rng(0).integers(0, 8, n_masks)
    listed = np.full((n_masks, room), -1, np.int32)
    lengths = list_all(bit_indices, starts, listed)
    is_set = np.arange(n_masks)[:, None] >> np.arange(LANES) & 1 > 0
    assert np.array_equal(lengths, starts + is_set.sum(axis=1))
    for mask in range(0, n_masks, 7):  # any value of either byte is among them
        expected = twin.append_set_bits(np.full(starts[mask], -1), is_set[mask], 3 * mask)
        assert np.array_equal(listed[mask, : lengths[mask]], expected)
    column = np.arange(room)
    assert (listed[column >= starts[:, None] + LANES] == -1).all()  # no more than it has room for


@njit
def bits_of(number):
    return count_bits(number), lowest_bit(number)


@given(st.integers(-(2**63), 2**63 - 1).filter(bool))
def test_bits_are_counted_and_the_lowest_is_found(number):
    digits = format(number % 2**64, "b")
    lowest = len(digits) - len(digits.rstrip("0"))
    assert bits_of(number) == (digits.count("1"), lowest)


@njit
def weigh(bits, weights):
    return count_block(bits, 0, pointer(weights))


@given(arrays(np.uint8, LANES), st.integers(0, 65535))
def test_weights_of_a_block_are_bytes_without_a_sign(weights, bits):
    assert weigh(bits, weights) == weights[bits >> np.arange(LANES) & 1 > 0].sum()
