"""Printed lengths, areas, angles and times: each has a digit that is not 0, however small it is."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.advice.before import Changed
from rastercov.base import format
from rastercov.core.coverage.doubts import name_places
from rastercov.report.tables import camera_words, lens_text
from rastercov.sensors.figures import _metres

SIZES = st.floats(-13, 13).map(lambda power: 10.0**power)
FACTORS = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "m²": 1.0, "cm²": 1e-4, "mm²": 1e-6, "µm²": 1e-12}


def value_of(text):
    """Number of a text with a unit."""
    number, unit = text.rsplit(" ", 1)
    return float(number.replace(",", "")) * FACTORS[unit]


@given(SIZES)
@examples(300)
def test_a_length_or_an_area_is_printed_to_a_tenth(value):
    for text in (format.size_in_words(value), format.distance(value), format.area(value)):
        assert value_of(text) == pytest.approx(value, rel=0.1)
    assert value_of(format.sampling(value).replace("/px", "")) == pytest.approx(value, rel=0.1)


@given(st.lists(SIZES, min_size=2, max_size=3))
@examples(200)
def test_no_side_that_is_there_is_printed_as_0(sides):
    numbers = format.size_in_words(sides).rsplit(" ", 1)[0].split(" x ")
    assert all(float(each.replace(",", "")) > 0 for each in numbers)
    assert format.size_in_words([*sides, 0.0]).split(" x ")[-1].split()[0] == "0"


@given(SIZES, st.integers(0, 4))
@examples(200)
def test_decimals_never_round_to_0(value, digits):
    for sign in (1, -1):
        result = float(format.in_decimals(sign * value, digits).replace(",", ""))
        assert result * sign > 0
        assert abs(result - sign * value) <= max(0.5 * 10.0**-digits, 0.05 * value) * (1 + 1e-9)
    assert format.in_decimals(0.0, digits) == "0"


@given(st.lists(SIZES, min_size=3, max_size=3), st.integers(1, 4))
@examples(200)
def test_coordinates_have_two_digits_of_the_largest(point, least):
    if max(point) < 1e-7:  # below the ninth decimal
        return
    numbers = [float(each) for each in format.coordinates(point, least).split(", ")]
    largest = int(np.argmax(point))
    assert numbers[largest] == pytest.approx(point[largest], rel=0.05)
    (line,) = name_places("there", np.array([point]), np.ones(1, bool))
    shown = [float(each) for each in re.search(r"\((.*)\)", line)[1].split(", ")]
    assert shown[largest] == pytest.approx(point[largest], rel=0.05)
    assert "(0.00, 0.00, 0.00)" not in Changed(None, 0, point).in_words


@pytest.mark.parametrize("limit", [1e-9, 3e-8, 2e-6, 4e-4, 0.05, 7.0])
def test_a_limit_is_printed_as_it_is(limit):
    assert value_of(_metres(limit)) == pytest.approx(limit, rel=0.01)


@pytest.mark.parametrize("degrees", [0.002, 0.03, 0.4, 5, 60, 120])
def test_a_narrow_field_of_view_is_not_0(degrees):
    camera = rc.Camera.from_fov(640, 480, hfov_deg=degrees)
    for text in (lens_text(camera), camera_words(camera).rsplit(", ", 1)[-1]):
        across, down = map(float, re.findall(r"\d[\d.]*", text)[-2:])
        assert across == pytest.approx(degrees, rel=0.2)
        assert 0 < down < across
