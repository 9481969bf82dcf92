"""Position of the sun against the algorithm of the NREL, frames, and what is refused."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rastercov as rc
from rastercov.base.errors import CameraError, ConfigError
from rastercov.core.camera.sun import PARALLAX, towards
from rastercov.core.camera.viewpoints import cone_of_directions

# Latitude, longitude, time, azimuth and elevation without refraction by pvlib 0.16 (I. Reda,
# A. Andreas. Solar Position Algorithm for Solar Radiation Applications. 2004.)
POSITIONS = [
    (48.0, 11.5, "1990-10-03T04:14+00:00", 83.38104, -11.07678),
    (48.0, 11.5, "1990-03-22T20:34+00:00", 310.27899, -29.30234),
    (-33.9, 151.2, "1990-01-03T07:25+00:00", 254.95355, 19.35431),
    (-33.9, 151.2, "1990-08-13T06:09+00:00", 298.39491, 13.42687),
    (69.6, 18.9, "1990-09-20T00:06+00:00", 23.11202, -17.59609),
    (69.6, 18.9, "1990-06-11T21:31+00:00", 343.21977, 3.63863),
    (48.0, 11.5, "2008-06-12T15:35+00:00", 268.47239, 33.37533),
    (48.0, 11.5, "2008-03-20T18:57+00:00", 288.39213, -15.58191),
    (-33.9, 151.2, "2008-10-08T07:38+00:00", 265.60794, 4.34161),
    (-33.9, 151.2, "2008-08-19T20:17+00:00", 77.12606, -3.17113),
    (69.6, 18.9, "2008-12-01T01:58+00:00", 60.07162, -33.48093),
    (69.6, 18.9, "2008-12-09T03:18+00:00", 79.8293, -28.17331),
    (48.0, 11.5, "2026-01-25T15:35+00:00", 236.94722, 3.18112),
    (48.0, 11.5, "2026-03-13T04:46+00:00", 84.97115, -8.4491),
    (-33.9, 151.2, "2026-06-01T06:42+00:00", 298.00387, 1.43099),
    (-33.9, 151.2, "2026-07-11T06:05+00:00", 304.72986, 9.33239),
    (69.6, 18.9, "2026-08-18T12:55+00:00", 216.21524, 29.97153),
    (69.6, 18.9, "2026-12-06T14:37+00:00", 235.04195, -11.54644),
    (48.0, 11.5, "2049-03-09T11:44+00:00", 186.18397, 37.60175),
    (48.0, 11.5, "2049-04-20T15:13+00:00", 255.06887, 28.62124),
    (-33.9, 151.2, "2049-05-23T20:39+00:00", 66.36749, -2.29666),
    (-33.9, 151.2, "2049-01-19T05:49+00:00", 270.53853, 39.11527),
    (69.6, 18.9, "2049-11-12T22:45+00:00", 4.96578, -38.33805),
    (69.6, 18.9, "2049-04-24T09:06+00:00", 152.1863, 31.44502),
    # The worst of 3 million without the parallax of the sun, 0.0118 to 0.0125 degrees.
    (11.6379, -125.01, "2037-05-07T01:50:48+00:00", 285.43328, 9.42484),
    (8.0241, -111.022, "2026-04-10T01:04:10+00:00", 277.11026, 6.32887),
    (40.7761, -45.6486, "2023-02-12T20:34:12+00:00", 252.84846, -0.99689),
    (12.2891, -61.6409, "2025-04-20T22:01:09+00:00", 281.36779, 3.498),
    (47.3135, -158.3527, "2037-05-07T20:51:19-09:00", 296.39902, -0.46745),
]  # fmt: skip
MOMENTS = st.datetimes(datetime(1950, 1, 2), datetime(2050, 12, 30)).map(
    lambda time: time.replace(tzinfo=UTC)
)
PLACES = st.tuples(st.floats(-90, 90), st.floats(-180, 180))


def apart(first, second):
    """Degrees between unit vectors."""
    return np.degrees(2 * np.arcsin(np.linalg.norm(np.subtract(first, second)) / 2))


@pytest.mark.parametrize("row", POSITIONS)
def test_the_position_is_that_of_the_nrel_to_a_fiftieth_of_the_disc(row):
    latitude, longitude, time, azimuth, elevation = row
    sun_directions = rc.sun_directions(latitude, longitude, [time])[0]
    assert apart(sun_directions, towards(azimuth, elevation, 90.0)) < 0.012


@given(PLACES, MOMENTS, st.floats(-360, 360))
def test_north_turns_the_scene_about_its_vertical(place, time, north):
    sun_directions = rc.sun_directions(*place, [time])[0]
    turned = rc.sun_directions(*place, [time], north_deg=north)[0]
    angle = np.radians(north - 90)
    x, y = turned[:2]
    back = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle), turned[2]
    assert back == pytest.approx(sun_directions, abs=1e-12)
    assert np.linalg.norm(sun_directions) == pytest.approx(1, abs=1e-12)


@given(PLACES, MOMENTS, st.integers(-14, 14))
def test_a_zone_changes_no_moment(place, time, hours):
    other = (time + timedelta(hours=hours)).replace(tzinfo=None).isoformat()
    text = f"{other}{'-' if hours < 0 else '+'}{abs(hours):02d}:00"
    assert np.array_equal(rc.sun_directions(*place, [text]), rc.sun_directions(*place, [time]))


@given(PLACES, MOMENTS)
def test_opposite_places_have_the_sun_on_opposite_sides_of_the_horizon(place, time):
    latitude, longitude = place
    other = longitude + (180 if longitude <= 0 else -180)
    up = rc.sun_directions(latitude, longitude, [time])[0, 2]
    lower = 2 * PARALLAX * (1 - up**2)  # the Earth is between them
    below = rc.sun_directions(-latitude, other, [time])[0, 2]
    assert below == pytest.approx(-up - lower, abs=1e-7)


def test_angles_are_a_compass_and_a_height():
    assert towards(0, 0, 90.0) == pytest.approx([0, 1, 0], abs=1e-15)
    assert towards(90, 0, 90.0) == pytest.approx([1, 0, 0], abs=1e-15)
    assert towards([0, 10], 90, 40.0) == pytest.approx(np.array([[0, 0, 1], [0, 0, 1]]), abs=1e-15)
    assert towards(0, 0, 0.0) == pytest.approx([1, 0, 0])  # north along +x


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_the_octagon_is_around_the_disc_and_touches_it(vector):
    middle = np.array(vector) / np.linalg.norm(vector)
    corners = cone_of_directions(middle[None], 8, 0.2666)[0]
    sides = np.cross(corners, np.roll(corners, -1, axis=0))
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    assert np.degrees(np.arcsin(np.abs(sides @ middle))) == pytest.approx(0.2666, abs=1e-6)
    assert [apart(each, middle) for each in corners] == pytest.approx(
        [0.2666 / 0.92388] * 8, rel=1e-4
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rc.sun_directions(91, 0, []), "expected latitude of -90 to 90 degrees, got 91"),
        (lambda: rc.sun_directions(0, 181, []), "expected longitude of -180 to 180 degrees"),
        (lambda: rc.sun_directions(0, 0, ["2026-06-21"]), "expected times with a zone, such as"),
        (lambda: rc.sun_directions(0, 0, ["noon"]), "expected times with a zone, such as"),
        (lambda: rc.sun_directions(0, 0, [datetime(2026, 1, 1)]), "expected times with a zone"),
        (lambda: rc.sun_directions(0, 0, ["2060-01-01T00:00Z"]), "of the years 1950 to 2050"),
        (
            lambda: rc.sunlit(rc.shapes.box(), [(0, 0, 0)]),
            "expected directions of a length above 0",
        ),
        (lambda: rc.sunlit(rc.shapes.box(), [(0, 0)]), "expected directions to be vectors"),
        (lambda: rc.sunlit(rc.shapes.box(), [(0, 0, 1)], [-1]), "expected weights to be 1 numbers"),
        (lambda: rc.sunlit(rc.shapes.box(), [(0, 0, 1)], [1, 1]), "expected weights to be 1 numb"),
        (
            lambda: rc.sunlit(rc.shapes.box(), [(0, 0, 1)], lit_by="rim"),
            "expected lit_by to be mid",
        ),
    ],
)
def test_wrong_values_are_refused_in_one_line(call, words):
    with pytest.raises((CameraError, ConfigError), match=words) as caught:
        call()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) <= 160
