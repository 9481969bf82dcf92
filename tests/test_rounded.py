"""What decides where cameras stand: equal bits on every processor, with every library of C."""

import ast
import json
import math
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from decided_poses import decided, digest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.base import (
    arccos,
    arcsin,
    arctan2,
    cos,
    dots,
    draw_between,
    hypot,
    matmul,
    norm,
    sin,
    sort_order,
    tan,
)
from rastercov.core.mesh.arrays import nearest_rotations, rotation_about
from rastercov.engine import base_rounded

ROOT = Path(__file__).parents[1] / "rastercov"
SCRIPT = Path(__file__).parent / "support/decided_poses.py"
LOWEST = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX2 FMA3 AVX512F AVX512_SKX",
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-AVX2_Usable,-FMA4",
}
"""A processor of 2009, to numpy of any version, its BLAS and the library of C."""
DECIDED = {
    "mesh": "3dd0438175635d9d",
    "sphere": "4a480551dddef49f",
    "on_sphere": "126da78261cef34b",
    "on_hemisphere": "f5959e1d117e5b4a",
    "on_box": "7b744eb7d764568a",
    "per_face": "0fadd852135f7744",
    "per_segment": "f604c7866b1e89f7",
    "labels": "5a39416fd2556ebd",
    "closest": "f1fab7ef4e98c96a",
    "torus": "67dd1cb3469d6885",
    "on_walls": "df4e74254f11c670",
    "in_room": "4ca17a06c645eb57",
    "strips": "feea9d26377ca4e8",
    "orbit": "467769a7189e6b4e",
    "openings": "7b334186967b7658",
    "towards": "bf74c6df225f9e96",
    "cone": "e94e4cc7fc4a1fbd",
    "refine": "78ae27efff3b0347",
    "rotations": "641e7588e68c2182",
}
"""Digests, the same on all systems."""
FOLDERS = ("core", "formats", "placement", "survey")
NUMBERS = {
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "hypot", "exp", "expm1"),
    *("log", "log1p", "log2", "power", "float_power", "cbrt", "sinh", "cosh", "tanh", "interp"),
    *(
        "argsort",
        "argpartition",
        "dot",
        "inner",
        "vdot",
        "matmul",
        "einsum",
        "tensordot",
        "vecdot",
        "polyfit",
        "convolve",
    ),
    *("asin", "acos", "atan", "atan2", "pow", "dist"),
}
"""Functions of numpy and math with bits of the processor or of the library."""
SOLVERS = {"norm", "inv", "qr", "svd", "eig", "eigh", "solve", "lstsq", "pinv", "cholesky"}
DRAWS = {"uniform"}
KEPT = {
    ("core/area/advice.py", "svd"): "densities, which are a figure",
    ("core/camera/exposure.py", "exp"): "exposures, which are a figure",
    ("core/camera/exposure.py", "log"): "exposures, which are a figure",
    ("core/camera/conventions.py", "svd"): "sizes beside a tolerance",
    ("core/mesh/shapes.py", "einsum"): "whole numbers",
    ("formats/cameras/gltf.py", "norm"): "along an axis, of columns",
    ("formats/cameras/transforms.py", "inv"): "of a motion that a file gives, undone on request",
    ("core/raster/contract.py", "@"): "whole numbers",
    ("placement/improve/objective.py", "@"): "whole numbers",
}
"""Uses that decide nothing by their last digits, and why."""
ANGLES = st.floats(-1e5, 1e5) | st.sampled_from([0.0, -0.0, math.pi, math.pi / 2, 1e-300, 1e-9])
NUMBER = st.builds(math.copysign, st.floats(1e-60, 1e60), st.sampled_from([-1, 1])) | st.just(0.0)


def uses(tree):
    """Names of functions and operators that the law forbids, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield "@", node.lineno
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        owner, name = ast.unparse(node.func.value), node.func.attr
        is_ours = owner in ("np", "math") and name in NUMBERS
        if is_ours or (owner == "np.linalg" and name in SOLVERS) or name in DRAWS:
            yield name, node.lineno


def test_what_decides_uses_no_function_whose_bits_depend_on_the_processor():
    found, kept = [], set()
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            file = path.relative_to(ROOT).as_posix()
            for name, line in uses(ast.parse(path.read_text("utf-8"))):
                if (file, name) in KEPT:
                    kept.add((file, name))
                else:
                    found.append(f"{file}:{line} {name}")
    assert not found
    assert kept == set(KEPT)  # no exception is left over


def test_the_law_sees_each_kind_of_use():
    text = "a @ b; np.sin(a); math.atan2(a, b); np.linalg.inv(a); rng.uniform(a); np.argsort(a)"
    assert [name for name, _ in uses(ast.parse(text))] == text_names(text)
    assert not list(uses(ast.parse("np.sort(a); np.sqrt(a); sin(a); sort_order(a)")))


def text_names(text):
    names = [part.split("(")[0].split(".")[-1] for part in text.split("; ")]
    return ["@", *names[1:]]


def test_what_is_decided_has_the_digits_of_all_systems():
    assert {name: digest(array) for name, array in decided()} == DECIDED


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="levels of x86-64")
def test_what_is_decided_is_equal_on_the_lowest_processor():
    said = subprocess.run(
        [sys.executable, SCRIPT], env=os.environ | LOWEST, capture_output=True, check=True
    ).stdout
    assert json.loads(said) == DECIDED


def near(found, wanted, ulps=1):
    return abs(found - wanted) <= ulps * math.ulp(wanted)


@given(angle=ANGLES, x=NUMBER, y=NUMBER, cosine=st.floats(-1, 1))
@examples(200)
def test_functions_are_those_of_the_library_to_a_digit(angle, x, y, cosine):
    assert near(sin(angle), math.sin(angle))
    assert near(cos(angle), math.cos(angle))
    assert near(tan(angle), math.tan(angle))
    assert near(arctan2(y, x), math.atan2(y, x))
    assert near(hypot(x, y), math.hypot(x, y))
    assert near(arccos(cosine), math.acos(cosine), 3)
    assert near(arcsin(cosine), math.asin(cosine), 3)


@given(seed=st.integers(0, 10**6), shape=st.sampled_from([(), (0,), (3,), (2, 4)]))
@examples(20)
def test_functions_of_arrays_are_those_of_their_numbers(seed, shape):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=shape), rng.normal(size=shape[-1:])
    for function in (arctan2, hypot):
        found = np.asarray(function(a, b))
        each = [function(float(x), float(y)) for x, y in np.nditer([a, b], ["zerosize_ok"])]
        assert found.shape == shape
        assert found.ravel().tolist() == each
    assert np.asarray(sin(a)).ravel().tolist() == [sin(float(x)) for x in np.ravel(a)]


@given(seed=st.integers(0, 10**6))
@examples(20)
def test_products_are_those_of_numpy(seed):
    rng = np.random.default_rng(seed)
    n, k, m = rng.integers(1, 6, 3)
    shapes = [((n, k), (k, m)), ((n, k), (k,)), ((k,), (k, m)), ((k,), (k,)), ((4, n, k), (k, m)),
              ((4, n, k), (4, k, m)), ((5, 1, n, k), (4, k, m)), ((0, k), (k, m))]  # fmt: skip
    for one, other in shapes:
        a, b = rng.normal(size=one), rng.normal(size=other)
        assert np.shape(matmul(a, b)) == np.shape(a @ b)
        np.testing.assert_allclose(matmul(a, b), a @ b, rtol=1e-13, atol=1e-13)
    a, b = rng.integers(-(2**20), 2**20, (2, n, 3)).astype(float)
    assert dots(a, b).tolist() == (a.astype(int) * b.astype(int)).sum(axis=1).tolist()
    np.testing.assert_allclose(norm(a), np.linalg.norm(a, axis=1), rtol=1e-15)


@given(seed=st.integers(0, 10**6), k=st.integers(0, 40), dtype=st.sampled_from(["f4", "f8"]))
@examples(60)
def test_inner_products_have_the_bits_of_sums_of_numpy(seed, k, dtype):
    """Whatever the length and layout, also of zeros with a sign; golden answers have these bits."""
    rng = np.random.default_rng(seed)
    for shape in ((k,), (0, k), (9, k), (3, 4, k)):
        a, b = rng.normal(size=(2, *shape)) * 10.0 ** rng.integers(-9, 9, (2, *shape))
        a[rng.random(shape) < 0.3] = -0.0
        if rng.random() < 0.2:
            a[:], b[:] = -0.0, 1.0
        for order in "CF":
            one, other = (np.asarray(each, dtype, order) for each in (a, b))
            expected = np.multiply(one, other).sum(axis=-1)
            found = dots(one, other)
            assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
            assert found.tobytes() == expected.tobytes()


@given(seed=st.integers(0, 10**6))
@examples(20)
def test_nearest_rotations_are_the_polar_factor(seed):
    rng = np.random.default_rng(seed)
    exact = np.array([rotation_about(rng.normal(size=3), rng.uniform(-3, 3)) for _ in range(5)])
    drifted = exact + 10.0 ** rng.uniform(-12, -2) * rng.uniform(-1, 1, exact.shape)
    u, _, vt = np.linalg.svd(drifted)
    found = nearest_rotations(drifted)
    np.testing.assert_allclose(found, u @ vt, atol=1e-14)
    assert np.abs(found @ found.transpose(0, 2, 1) - np.eye(3)).max() < 1e-15


@given(seed=st.integers(0, 10**6), shape=st.sampled_from([3, (4, 3)]))
@examples(10)
def test_draws_are_between_their_limits_with_the_stream_of_the_generator(seed, shape):
    low, high = np.array((-1.0, 2.0, 5.0)), np.array((0.0, 2.5, 900.0))
    found = draw_between(low, high, shape, np.random.default_rng(seed))
    assert ((found >= low) & (found <= high)).all()
    usual = np.random.default_rng(seed).uniform(low, high, shape)
    np.testing.assert_allclose(found, usual, rtol=1e-15)


@given(values=st.lists(st.integers(-3, 3)), rows=st.integers(1, 3))
@examples(20)
def test_equal_values_stay_in_their_order(values, rows):
    wanted = sorted(range(len(values)), key=values.__getitem__)
    assert sort_order(np.tile(values, (rows, 1))).tolist() == [wanted] * rows


@given(first=st.floats(1e-6, 1e6), ratio=st.floats(1.0, 1e6), n=st.integers(2, 12))
@examples(50)
def test_steps_are_in_equal_ratios(first, ratio, n):
    out = np.empty((1, n))
    base_rounded.fill_steps(np.array([first]), np.array([first * ratio]), out)
    assert (out[0, 0], out[0, -1]) == (first, first * ratio)
    np.testing.assert_allclose(out[0], np.geomspace(first, first * ratio, n), rtol=1e-13)
