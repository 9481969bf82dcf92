"""Numbers of mesh files in text are those of Python's `float`, to the bit."""

import struct
from fractions import Fraction

import numpy as np
import pytest
from nightly import amount

from rastercov.base.errors import MeshError

HARD = (
    "9007199254740993", "9007199254740993.0000000000000000000000000001", "-0", "-0.0e5", "1e23",
    "2.2250738585072011e-308", "4.9406564584124654e-324", "2.4703282292062328e-324",
    "2.4703282292062327e-324", "1.7976931348623157e308", "5e-324", ".1", "1.", "+1E+05", "00012",
    "0." + "0" * 400 + "1e400", "1" + "0" * 400 + "e-400", "9" * 30 + "." + "9" * 30, "3e-5",
    "17976931348623157" + "0" * 292, "8.5e-324", "123456789012345678e-27", "7e27", "7e28", "1e-27",
)  # fmt: skip
NONE = (
    "",
    "+",
    ".",
    "e5",
    "1e",
    "1e+",
    "0x1",
    "1_0",
    "1.2.3",
    "--1",
    "1f",
    "infinit",
    "nan(1)",
    "١",
)


def words(rng, n):
    """Random doubles as people write them, and ties between two doubles with a digit more."""
    for bits in rng.integers(0, 2**63, n):
        number = struct.unpack("<d", struct.pack("<q", int(bits)))[0]
        if not np.isfinite(number):
            continue
        yield repr(number)
        yield f"{number:.{rng.integers(1, 25)}e}"
        tie = Fraction(number) + Fraction(float(np.spacing(number))) / 2
        digits = str(tie.numerator * 10**1100 // tie.denominator)
        yield f"{digits}e-1100"
        yield f"{digits}1e-1101"
    for _ in range(n):
        yield f"{rng.normal() * 10.0 ** rng.integers(-9, 9):.{rng.integers(0, 19)}f}"


def test_numbers_of_a_text_are_those_of_python_to_the_bit(load):
    every = [*HARD, *words(np.random.default_rng(5), amount(400, at_night=20_000))]
    fitting = [each for each in every if abs(float(each)) <= 1e30]
    assert len(fitting) > 800
    rows = "".join(f"v {each} 0 1\n" for each in fitting)
    mesh = load("a.obj", f"{rows}f 1 2 3\n".encode())
    expected = np.array([float(each) for each in fitting])
    np.testing.assert_array_equal(mesh.vertices[:, 0].view(np.uint64), expected.view(np.uint64))


@pytest.mark.parametrize("word", [*NONE, "1e31", "1e999", "nan", "-Infinity", "1" + "0" * 31])
def test_what_is_no_coordinate_is_refused(word, load):
    wanted = "line 1: expected three coordinates" if word in NONE else "expected finite coordinates"
    with pytest.raises(MeshError, match=wanted):
        load("a.obj", f"v {word} 0 1\nv 0 1 0\nv 1 1 1\nf 1 2 3\n".encode())


@pytest.mark.parametrize("word", ["9223372036854775807", "-9223372036854775808"])
def test_indices_have_64_bits(word, load):
    head = b"v 0 0 1\nv 0 1 0\nv 1 1 1\nf 1 2 "
    with pytest.raises(MeshError, match="line 4: expected vertex indices"):
        load("a.obj", head + word.encode())
    further = word[:-1] + str(int(word[-1]) + 1)
    with pytest.raises(MeshError, match="line 4: expected whole numbers as vertex indices"):
        load("a.obj", head + further.encode())
