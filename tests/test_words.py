"""Counts in sentences for people."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rastercov.base.format import area, percent, plural, verb


@given(share=st.floats(1e-11, 1 - 1e-11))
@example(share=1 - 1e-11)
@example(share=0.9995)
def test_a_share_is_rounded_neither_to_all_nor_to_nothing(share):
    shown = float(percent(share).removesuffix(" %"))
    assert 0 < shown < 100
    assert abs(shown - 100 * share) <= 0.05 + 1e-9
    assert (percent(0.0), percent(1.0), percent(1 - 1e-15)) == ("0.0 %", "100.0 %", "100.0 %")


@given(st.floats(1e-12, 1e6))
@example(0.828)
def test_an_area_is_in_its_unit_and_within_its_digits(square_metres):
    text, unit = area(square_metres).split(" ")
    assert area(np.float64(square_metres)) == f"{text} {unit}"
    factor = {"m²": 1.0, "cm²": 1e-4, "mm²": 1e-6, "µm²": 1e-12}[unit]
    assert float(text.replace(",", "")) * factor == pytest.approx(square_metres, rel=5.1e-3)
    assert (unit == "m²") == (square_metres >= 0.09995)


@pytest.mark.parametrize(
    ("noun", "action", "words"),
    [
        ("image", "see", ("0 images see", "1 image sees", "2 images see")),
        ("camera", "cover", ("0 cameras cover", "1 camera covers", "2 cameras cover")),
        ("face", "are", ("0 faces are", "1 face is", "2 faces are")),
        ("face", "may be", ("0 faces may be", "1 face may be", "2 faces may be")),
        ("candidate", "have", ("0 candidates have", "1 candidate has", "2 candidates have")),
        ("mesh", "belong", ("0 meshes belong", "1 mesh belongs", "2 meshes belong")),
        ("vertex", "", ("0 vertices", "1 vertex", "2 vertices")),
    ],
)
def test_a_counted_noun_and_its_verb_agree(noun, action, words):
    assert tuple(plural(count, noun, action) for count in (0, 1, 2)) == words
    assert verb(1, "are left out") == "is left out"
