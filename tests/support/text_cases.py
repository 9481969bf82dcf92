"""Numbers and functions of which a page and Python make texts, and the texts of Python."""

import inspect
import math

import numpy as np

from rastercov.base import format as texts
from rastercov.core.area.advice import hidden_by, verdict_of, verdict_of_rigs
from rastercov.core.camera.camera import depths_in_focus
from rastercov.core.camera.viewpoints import distances_to_try
from rastercov.core.coverage.task import density_text
from rastercov.placement import required

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
"""Formats, of which the first two are of whole numbers."""
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
    views, need, cameras = (int(each) for each in rng.integers(0, 3, 3))
    label, device = str(rng.choice(("", "occluded", "occluded and too far"))), rng.choice(("", "a"))
    hider = None if rng.random() < 0.5 else str(device)
    statuses = (required.HOLDS, required.FAILS, required.UNDECIDED)
    is_most, plan = bool(rng.random() < 0.5), other if rng.random() < 0.5 else None
    status = str(rng.choice(statuses))
    cases = [
        (depths_in_focus, other + 1, other / 2 + 1e-9, bound + 1e-9, share),
        (distances_to_try, other, bound, [share, value], share, bound),
        (texts.number, value, digits),
        (texts.percent, share),
        (texts.with_bound, 100 * share, bound),
        (texts.area, abs(value), unit, other),
        (texts.distance, value, unit),
        (texts.text_with_sign, value, digits),
        (density_text, abs(value), f"px/{unit}", other),
        (hidden_by, label, hider, share),
        (verdict_of, "1 m²", views, need, cameras, label, is_most),
        (verdict_of_rigs, "1 m²", str(device), label),
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
    """Result of a function of arguments in their order, those by name alone, too."""
    return function(**dict(zip(inspect.signature(function).parameters, given, strict=False)))


def of_kinds(rng):
    """A further case: a format of Python itself, or a function of a panel."""
    value, row = drawn(rng), int(rng.integers(3))
    if row == 0:
        spec = str(rng.choice(SPECS))
        return ["formatNumber", round(value), spec], format(round(value), spec)
    if row == 1:
        spec = str(rng.choice(SPECS[2:]))
        return ["formatNumber", value, spec], format(value, spec)
    name = str(rng.choice(list(PARTS)))
    value = abs(value) if name != "page metres" else value
    return [name, value], PARTS[name](value)
