"""Texts of numbers are one: the page writes each as Python does."""

import inspect
import json
import math

import numpy as np
import pytest
from nightly import IS_NIGHTLY
from page_in_node import NEEDS_NODE
from page_in_node import node as node

from rastercov.base import format as texts
from rastercov.camera.camera import depths_in_focus
from rastercov.camera.viewpoints import distances_tried
from rastercov.coverage import required
from rastercov.coverage.densities import density_text
from rastercov.report.script import SHARED, script_of, texts_script

SPECS = (
    "",
    ",",
    ",.0f",
    ".0f",
    ".1f",
    ".3f",
    ",.2f",
    ".0e",
    ".1e",
    ".30e",
    ".1g",
    ".3g",
    ",.10g",
    "g",
)
PARTS = {
    "page figure": lambda value: texts.number(value),
    "page percent": lambda value: texts.percent(value / 100),
    "page metres": lambda value: texts.distance(value),
    "page squareMetres": lambda value: texts.area(value),
}
"""Functions of the panels of the page, which write a value of Python's as this does."""


def drawn(rng):
    """A number: one of a decimal tie, of a power of ten or near it, whole, or of any size."""
    power = 10.0 ** int(rng.integers(-12, 16))
    kind = int(rng.integers(6))
    sign = 1 if rng.random() < 0.8 else -1
    if kind == 0:  # a tie of binary fractions, such as 62.25
        return sign * int(rng.integers(0, 10**6)) / 2 ** int(rng.integers(0, 10))
    if kind == 1:  # a tie of whole numbers, such as 7,645
        return sign * float(int(rng.integers(0, 10**5)) * 5 * 10 ** int(rng.integers(0, 8)))
    if kind == 2:
        return float(np.nextafter(power, rng.choice((0.0, power, math.inf))))
    if kind == 3:  # a decimal, which is nearly a tie
        return sign * int(rng.integers(0, 10**7)) / 10 ** int(rng.integers(0, 9))
    return sign * float(rng.uniform(0, 100) if kind == 4 else rng.uniform() * power)


def case_of(rng):
    """Name and arguments of a function of the page, and what Python's gives."""
    value, other = drawn(rng), abs(drawn(rng))
    unit, digits = str(rng.choice(("m", "unit"))), int(rng.integers(1, 9))
    share, bound = float(rng.choice((value % 1, value % 100 / 100))), other % 10
    statuses = (required.HOLDS, required.FAILS, required.UNDECIDED)
    is_most, plan = bool(rng.random() < 0.5), other if rng.random() < 0.5 else None
    status = str(rng.choice(statuses))
    cases = [
        (depths_in_focus, other + 1, other / 2 + 1e-9, bound + 1e-9, share),
        (distances_tried, other, bound, [share, value], share, bound),
        (texts.number, value, digits),
        (texts.percent, share),
        (texts.with_bound, 100 * share, bound),
        (texts.area, abs(value), unit, other),
        (texts.distance, value, unit),
        (texts.signed, value, digits),
        (density_text, abs(value), f"px/{unit}", other),
        (required.status_of, share, share + bound, other % 1, is_most),
        (required.short_by, share, other % 1, status, is_most),
        (required.share_of, value, other),
        (required.ends_in_words, share, other % 1),
        (required.outcome_line, "a: ", status, [share, plan], other % 1, "b", "c", is_most),
    ]
    function, *given = cases[int(rng.integers(len(cases)))]
    wanted = called(function, given)
    if isinstance(wanted, tuple):
        wanted = ["inf" if each == math.inf else each for each in wanted]
    return [function.__name__, *given], wanted


def called(function, given):
    """What a function gives of arguments in their order, those by name alone, too."""
    return function(**dict(zip(inspect.signature(function).parameters, given, strict=False)))


def of_kinds(rng):
    """A further case: a format of Python itself, or a function of a panel."""
    value, row = drawn(rng), int(rng.integers(3))
    if row == 0:
        spec = str(rng.choice(SPECS))
        return ["formatted", round(value), spec], format(round(value), spec)
    if row == 1:
        spec = str(rng.choice(SPECS[2:]))
        return ["formatted", value, spec], format(value, spec)
    name = str(rng.choice(list(PARTS)))
    value = abs(value) if name != "page metres" else value
    return [name, value], PARTS[name](value)


@NEEDS_NODE
def test_the_page_writes_numbers_as_python_does(node, tmp_path):
    rng = np.random.default_rng(62)
    cases = [
        make(rng) for make in (case_of, of_kinds) for _ in range(100_000 if IS_NIGHTLY else 12_000)
    ]
    given, wanted = zip(*cases, strict=True)
    (tmp_path / "cases.json").write_text(json.dumps(given))
    found = node("texts.mjs", tmp_path / "cases.json")
    assert [row for row in zip(given, found, wanted, strict=True) if row[1] != row[2]] == []
    assert {name for name, *_ in given} >= {each.__name__ for each in SHARED} - {"advice_of"}


@NEEDS_NODE
@pytest.mark.parametrize("value", [62.25, 0.5, 2.5, 1e22, 5e-324, -0.0, 1.7e308, math.inf])
def test_ends_and_ties(node, tmp_path, value):
    given = [["formatted", "inf" if math.isinf(value) else value, spec] for spec in SPECS[2:]]
    (tmp_path / "cases.json").write_text(json.dumps(given))
    assert node("texts.mjs", tmp_path / "cases.json") == [format(value, each) for each in SPECS[2:]]


def of_a_loop(values):
    """A function that has no translation."""
    while values:
        values = values[1:]


def of_a_call(values):
    """Another one."""
    return sorted(values)


LIMIT = 3


def of_a_constant(value):
    """A constant of this module, and a mapping."""
    return [value < LIMIT, value in (2, LIMIT)]


@pytest.mark.parametrize("function", [of_a_loop, of_a_call])
def test_what_has_no_translation_is_refused(function):
    with pytest.raises(TypeError, match="expected Python that has a JavaScript here, got"):
        script_of([function])


def test_constants_and_called_functions_are_in_the_module():
    said = script_of([of_a_constant])
    assert "const LIMIT = 3;" in said
    assert "export function of_a_constant(value)" in said
    assert "export function exponent(" in texts_script()
