"""Calls of loops that do not look at the types of their arguments."""

from typing import NamedTuple

import numpy as np
import pytest

from rastercov.kernels.direct import DirectCalls
from rastercov.kernels.jit import allocation_free


class Pair(NamedTuple):
    """Two arrays."""

    first: np.ndarray
    second: np.ndarray


@allocation_free
def inner(pair, factor):
    """Factor times the inner product of a pair of arrays."""
    total = 0.0
    for i in range(pair.first.shape[0]):
        total += pair.first[i] * pair.second[i]
    return factor * total


@allocation_free
def twice(value):
    """Twice an integer."""
    return 2 * value


def read_only(array):
    array.flags.writeable = False
    return array


def test_each_call_is_that_of_the_loop():
    call, rng = DirectCalls(), np.random.default_rng(0)
    for n in (3, 0, 5):
        pair = Pair(rng.normal(size=n), rng.integers(0, 9, n).astype(np.int32))
        assert call(inner, pair, 2.0) == inner(pair, 2.0)
        assert call(inner, pair, np.float64(3)) == inner(pair, 3.0)


@pytest.mark.parametrize(
    "other",
    [
        Pair(np.ones(2, np.float32), np.ones(2, np.int32)),
        Pair(np.ones(4)[::2], np.ones(2, np.int32)),
        Pair(np.ones(2), np.ones(2)),
        Pair(np.ones((2, 1)), np.ones(2, np.int32)),
        Pair(np.ones(2), read_only(np.ones(2, np.int32))),
        Pair(np.ones(2), 3),
        (np.ones(2), np.ones(2, np.int32)),
    ],
)
def test_a_check_finds_other_types(other):
    call = DirectCalls()
    assert call.is_checked  # in all tests
    for n in (2, 3, 3):  # numba is asked for the types of the second only
        call(inner, Pair(np.ones(n), np.ones(n, np.int32)), 1.0)
    for _ in range(2):
        with pytest.raises(TypeError, match="inner was called with arguments of other types"):
            call(inner, other, 1.0)
    for factor in (1, np.float32(1), 1 << 63, True):
        with pytest.raises(TypeError, match="inner was called with arguments of other types"):
            call(inner, Pair(np.ones(2), np.ones(2, np.int32)), factor)


def test_integers_are_checked_by_their_width():
    call = DirectCalls()
    for value in (3, 4, 1 << 40, -1):
        assert call(twice, value) == 2 * value
    with pytest.raises(TypeError, match="twice was called with arguments of other types"):
        call(twice, 1 << 63)


def test_where_loops_are_python_functions_they_are_called():
    assert DirectCalls()(lambda value: value + 1, 2) == 3
