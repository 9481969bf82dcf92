"""Vectors of lanes reckon like numpy, and what is compiled with a file is compiled anew with it."""

import os
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numba import njit
from numba.core import types
from numba.extending import intrinsic
from processes import run_python

from rastercov.kernels.raster_memory import LANES, make_scratch
from rastercov.kernels.raster_stage_depth import samples_of_face, write_face
from rastercov.kernels.simd import DOUBLE, LONG, SINGLE, WORD, Scalar, gather, load  # fmt: skip
from rastercov.kernels.simd_kernel import (  # fmt: skip
    append_set_bits,
    count_bits,
    lowest_bit,
    pointer,
    simd,
)
from rastercov.reference import raster_stages as twin


def scalar(vector, number):
    """A 64-bit constant."""
    return Scalar(vector.builder, LONG(number))


KINDS = {np.int32: WORD, np.int64: LONG, np.float32: SINGLE, np.float64: DOUBLE}
WHOLE, BROKEN = (np.int32, np.int64), (np.float32, np.float64)


def by_lanes(formulas, n_inputs):
    """A loop (inputs, outputs) that puts what formulas make of the inputs' lanes into the outputs.

    Inputs are arrays of `LANES`, outputs one for each formula: of lanes, or of a single value.
    """

    @intrinsic
    def reckon(typing, inputs, outputs):
        def generate(context, builder, signature, args):
            taken = [builder.extract_value(args[0], k) for k in range(n_inputs)]
            lanes = [load(builder, array, LANES) for array in taken]
            for k, formula in enumerate(formulas):
                made, out = formula(*lanes), builder.extract_value(args[1], k)
                if not isinstance(made, Scalar):
                    made.store(out)
                else:
                    builder.store(made.value, out)
            return context.get_dummy_value()

        return types.void(inputs, outputs), generate

    @intrinsic
    def pointers(typing, of):
        kinds = types.Tuple([types.CPointer(array.dtype) for array in of])

        def generate(context, builder, signature, args):
            data = []
            for k, array in enumerate(of):
                value = builder.extract_value(args[0], k)
                data.append(context.make_array(array)(context, builder, value).data)
            return context.make_tuple(builder, signature.return_type, data)

        return kinds(of), generate

    @njit
    def loop(inputs, outputs):
        reckon(pointers(inputs), pointers(outputs))

    return loop


def assert_same(found, expected, name):
    """Bit for bit, but for which NaN it is."""
    expected = np.asarray(expected)
    if expected.dtype == bool:  # a mask, as bits
        expected = (expected << np.arange(LANES)).sum()
    expected = np.atleast_1d(expected)
    if np.asarray(found).dtype.kind == "f":
        both_nan = np.isnan(found) & np.isnan(expected)
        is_same = both_nan | ((found == expected) & (np.signbit(found) == np.signbit(expected)))
        assert is_same.all(), (name, found, expected)
    else:
        assert np.array_equal(found, expected), (name, found, expected)


def truncated(a, b):
    """The quotient of whole numbers, cut off."""
    quotients = np.abs(a.astype(object)) // np.abs(b.astype(object))
    return np.where((a < 0) == (b < 0), quotients, -quotients).astype(a.dtype)


# Formulas over lanes beside the same over arrays; of a mask, its bits.
COMMON = {
    "a + b": (lambda a, b: a + b,) * 2,
    "a - b": (lambda a, b: a - b,) * 2,
    "a * b": (lambda a, b: a * b,) * 2,
    "a + 3": (lambda a, b: a + 3,) * 2,
    "a * -7": (lambda a, b: a * -7,) * 2,
    "a < b": (lambda a, b: (a < b).bits(), lambda a, b: a < b),
    "a <= b": (lambda a, b: (a <= b).bits(), lambda a, b: a <= b),
    "a > b": (lambda a, b: (a > b).bits(), lambda a, b: a > b),
    "a >= b": (lambda a, b: (a >= b).bits(), lambda a, b: a >= b),
    "a < 0": (lambda a, b: (a < 0).bits(), lambda a, b: a < 0),
    "a equals b": (lambda a, b: a.equals(b).bits(), lambda a, b: a == b),
    "where": (lambda a, b: a.where(b > a, b * 2), lambda a, b: np.where(b > a, a, b * 2)),
    "where else 5": (lambda a, b: a.where(a <= b, 5), lambda a, b: np.where(a <= b, a, 5)),
    "minimum": (lambda a, b: a.minimum(b), lambda a, b: np.where(a < b, a, b)),
    "maximum": (lambda a, b: a.maximum(b), lambda a, b: np.where(a > b, a, b)),
    "minimum 1": (lambda a, b: a.minimum(1), lambda a, b: np.where(a < 1, a, 1)),
    "like": (lambda a, b: a.like(9), lambda a, b: np.full_like(a, 9)),
    "masks": (
        lambda a, b: (((a < b) | (a < 0)) & ~(b < 3)).bits(),
        lambda a, b: ((a < b) | (a < 0)) & ~(b < 3),
    ),
    "mask of bits": (
        lambda a, b: a.where(scalar(a, 0x1A2C5).as_mask(LANES), b),
        lambda a, b: np.where(0xA2C5 >> np.arange(LANES) & 1, a, b),
    ),
    "broadcast": (
        lambda a, b: a.lane(3).broadcast(LANES),
        lambda a, b: np.full_like(a, a[3]),
    ),
    "constants": (
        lambda a, b: a + range(LANES),
        lambda a, b: a + np.arange(LANES, dtype=a.dtype),
    ),
}
OF_WHOLE = {
    "a / b": (lambda a, b: a / b, truncated),
    "a >> 3": (lambda a, b: a >> 3,) * 2,
    "a << 5": (lambda a, b: a << 5,) * 2,
    "a & b": (lambda a, b: a & b,) * 2,
    "a | b": (lambda a, b: a | b,) * 2,
    "a & 0xFFFF": (lambda a, b: a & 0xFFFF,) * 2,
    "~a": (lambda a, b: ~a,) * 2,
    "append sign": (lambda a, b: a.append_sign(b), lambda a, b: a << 1 | (b < 0)),
    "to word": (lambda a, b: a.to(WORD), lambda a, b: a.astype(np.int32)),
    "to long": (lambda a, b: a.to(LONG), lambda a, b: a.astype(np.int64)),
    "to single": (lambda a, b: a.to(SINGLE), lambda a, b: a.astype(np.float32)),
    "to double": (lambda a, b: a.to(DOUBLE), lambda a, b: a.astype(np.float64)),
    "minimum of lanes": (lambda a, b: a.reduce("minimum"), lambda a, b: a.min()),
    "maximum of lanes": (lambda a, b: a.reduce("maximum"), lambda a, b: a.max()),
    "lane": (
        lambda a, b: a.lane(1).to(LONG) - b.lane(15).to(LONG),
        lambda a, b: a.astype(np.int64)[1] - b.astype(np.int64)[15],
    ),
}
OF_BROKEN = {
    "a / b": (lambda a, b: a / b,) * 2,
    "a / 3": (lambda a, b: a / 3,) * 2,
    "a * b + a": (lambda a, b: a * b + a,) * 2,  # rounded twice
    "floor": (lambda a, b: a.floor(), lambda a, b: np.floor(a)),
    "sqrt": (lambda a, b: a.sqrt(), lambda a, b: np.sqrt(a)),
    "absolute": (lambda a, b: a.absolute(), lambda a, b: np.abs(a)),
    "to single": (lambda a, b: a.to(SINGLE), lambda a, b: a.astype(np.float32)),
    "to double": (lambda a, b: a.to(DOUBLE), lambda a, b: a.astype(np.float64)),
}


@cache
def table(kind):
    """Names, loop and outputs of all formulas for a type."""
    formulas = COMMON | (OF_WHOLE if kind in WHOLE else OF_BROKEN)
    made = [np.asarray(of_arrays(*np.ones((2, LANES), kind))) for _, of_arrays in formulas.values()]
    outputs = [
        np.zeros(1, np.int64) if array.dtype == bool else np.zeros_like(np.atleast_1d(array))
        for array in made
    ]
    return formulas, by_lanes([formula for formula, _ in formulas.values()], 2), tuple(outputs)


def numbers(kind):
    """Small ones, which are equal now and then, and any."""
    if kind in WHOLE:
        limits = np.iinfo(kind)
        one = st.integers(-3, 3) | st.integers(int(limits.min), int(limits.max))
    else:
        width = np.dtype(kind).itemsize * 8
        one = st.integers(-12, 12).map(lambda k: k / 4) | st.floats(width=width)
    return arrays(kind, LANES, elements=one)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
@settings(max_examples=25)
def test_lanes_reckon_like_numpy(kind, data):
    a, b = data.draw(numbers(kind)), data.draw(numbers(kind))
    if kind in WHOLE:  # the two quotients that there are not
        b[(b == 0) | ((b == -1) & (a == np.iinfo(kind).min))] = 1
    formulas, loop, outputs = table(kind)
    loop((a, b), outputs)
    with np.errstate(all="ignore"):
        for (name, (_, of_arrays)), found in zip(formulas.items(), outputs, strict=True):
            assert_same(found, of_arrays(a, b), name)


@given(arrays(np.float64, LANES, elements=st.floats(-(2.0**31) + 1, 2.0**31 - 1)))
@settings(max_examples=25)
def test_lanes_become_whole_by_cutting_off(a):
    loop, words, longs = whole_loop(), np.zeros(LANES, np.int32), np.zeros(LANES, np.int64)
    loop((a,), (words, longs))
    assert np.array_equal(words, np.trunc(a))
    assert np.array_equal(longs, np.trunc(a))


@cache
def whole_loop():
    return by_lanes([lambda a: a.to(WORD), lambda a: a.to(LONG)], 1)


def test_bytes_are_extended_without_a_sign():
    numbers = np.arange(256, dtype=np.uint8).reshape(16, 16)
    loop, found = by_lanes([lambda a: a.zero_extended(WORD)], 1), np.zeros(LANES, np.int32)
    for row in numbers:
        loop((row,), (found,))
        assert np.array_equal(found, row)


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


@pytest.mark.slow
def test_every_mask_is_made_of_bits_and_back():
    loop = by_lanes([lambda a, bits: from_mask(bits).bits()], 2)
    a, bits, found = np.zeros(LANES, np.int32), np.zeros(LANES, np.int64), np.zeros(1, np.int64)
    for mask in range(1 << LANES):
        bits[0] = mask - (mask << 17)  # what is above does not matter
        loop((a, bits), (found,))
        assert found[0] == mask


def from_mask(bits):
    return bits.lane(0).as_mask(LANES)


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


@given(st.integers(0, 62))
def test_a_lone_bit_is_the_lowest(bit):
    assert bits_of(1 << bit) == (1, bit)


@njit
def give(owner, at, bits, face):
    write_face(pointer(owner), at, bits, face)
    return samples_of_face(pointer(owner), at, face)


@pytest.mark.slow
@given(arrays(np.int32, 48, elements=st.integers(0, 3)), st.integers(0, 32), st.integers(0, 65535))
def test_samples_go_to_a_face_and_no_others_do(owner, at, bits):
    expected, block = owner.copy(), slice(at, at + LANES)
    expected[block] = twin.write_face(owner[block], bits >> np.arange(LANES) & 1 > 0, 2)
    held = give(owner, at, bits, np.int32(2))
    assert np.array_equal(owner, expected)
    assert held == (twin.samples_of_face(owner[block], 2) << np.arange(LANES)).sum()


# --- compiled loops on disk -----------------------------------------------------------------------

LOOP = """
from numba.extending import intrinsic
from numba.core import types
from lanepackage import formula
from rastercov.kernels.jit import compiled

@compiled
def loop(number):
    return formula.changed(number) + 1

if __name__ == "lanepackage.loop":
    result = loop(2)
    hits, misses = loop.stats.cache_hits, loop.stats.cache_misses
    print(result, sum(hits.values()), sum(misses.values()))
"""
FORMULA = """
from numba.extending import intrinsic
from numba.core import types

@intrinsic
def changed(typing, number):
    def generate(context, builder, signature, args):
        return builder.mul(args[0], args[0].type({factor}))

    return types.int64(types.int64), generate
"""


@pytest.mark.compile
def test_a_loop_is_compiled_anew_when_a_file_that_it_is_made_of_changes(tmp_path):
    package = tmp_path / "lanepackage"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "loop.py").write_text(LOOP)
    formula = package / "formula.py"

    def run():
        kept = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        done = run_python("-c", "import lanepackage.loop", paths=[tmp_path], **kept)
        return tuple(map(int, done.stdout.split()))

    def write(factor, seconds):
        formula.write_text(FORMULA.format(factor=factor))
        os.utime(formula, (seconds, seconds))

    write(3, 10**9)
    assert run() == (7, 0, 1)
    assert run() == (7, 1, 0)
    write(4, 10**9 + 5)  # as long as it was, and newer
    assert run() == (9, 0, 1)
    write(50, 10**9 + 5)  # as old as it was, and longer
    assert run() == (101, 0, 1)
