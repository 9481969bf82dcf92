"""A typical year of radiation, and what shades it: EPW, TMY3 and PVGIS files.

Beam: of each hour the lit share of the silhouette of a group, from the sun in the middle of the
hour. Diffuse: the sky view factor of a group for a sky of the same radiance everywhere,

    F = 1 / (pi A)  integral of cos(incidence) over the visible sky, the area A of its faces,

from two lattices of directions; their difference is an estimate of its error, not a bound.

D. B. Crawley, J. W. Hand, L. K. Lawrie. Improving the weather information available to simulation
programs. 1999 (EPW). S. Wilcox, W. Marion. Users Manual for TMY3 Data Sets. NREL/TP-581-43156,
2008. B. Y. H. Liu, R. C. Jordan. The long-term average performance of flat-plate solar-energy
collectors. 1963, for the isotropic sky.
"""

import csv
import itertools
import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rastercov.base import BoolArray, ByName, ConfigError, FloatArray, check_place, write_text
from rastercov.base.output import csv_text
from rastercov.core.camera.viewpoints import fibonacci_sphere
from rastercov.core.mesh import Mesh
from rastercov.sun.sunlight import Sunlight, sunlit

HOURS = 8760
"""Hours of a typical year, which has no 29 February."""
SKY_DIRECTIONS = 500
"""Directions of a lattice over the sky."""
EPW_HEADER, EPW_COLUMNS = 8, (0, 1, 2, 3, 14, 15)
"""Lines before the hours; year, month, day, hour, direct normal and diffuse radiation."""
TMY3_NAMES = "Date (MM/DD/YYYY)", "Time (HH:MM)", "DNI (W/m^2)", "DHI (W/m^2)"
PVGIS_NAMES = "time(UTC)", "Gb(n)", "Gd(h)"
PVGIS_PLACE = "Latitude", "Longitude"


class Weather(NamedTuple):
    """Radiation of the hours of a typical year at a place.

    Attributes
    ----------
    name : str
    latitude, longitude : float
        Degrees.
    times : list of datetime
        At which the sun of an hour is taken.
    beam, diffuse : (N,) float64
        Direct normal and diffuse horizontal irradiance, W/m^2.
    """

    name: str
    latitude: float
    longitude: float
    times: list[datetime]
    beam: FloatArray
    diffuse: FloatArray


def read_weather(path: Path) -> Weather:
    """Weather of an EPW file, or of a CSV file of TMY3 or PVGIS.

    Raises
    ------
    ConfigError
        For another file, and one without the 8,760 hours of a year.
    """
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig", errors="replace").splitlines()))
        weather = Weather(path.name, *_weather(rows))
    except (OSError, ValueError, LookupError, StopIteration, csv.Error) as error:
        raise ConfigError(
            f"--weather: expected an EPW, TMY3 or PVGIS file, got: {error or 'its end'}; download "
            "one of these"
        ) from None
    values = np.stack((weather.beam, weather.diffuse))
    if len(weather.times) != HOURS or not ((values >= 0) & (values < 2000)).all():
        raise ConfigError(
            f"--weather: expected {HOURS} hours with 0 to 2000 W/m2, got {len(weather.times)}, or "
            "other values; download the file again"
        )
    return weather


Content = tuple[float, float, list[datetime], FloatArray, FloatArray]


def _weather(rows: list[list[str]]) -> Content:
    if rows[0][0] == "LOCATION":
        return _of_epw(rows)
    return _of_tmy3(rows) if set(TMY3_NAMES) <= set(rows[1]) else _of_pvgis(rows)


def _of_epw(rows: list[list[str]]) -> Content:
    hours = [[float(row[k]) for k in EPW_COLUMNS] for row in rows[EPW_HEADER:] if row]
    zone = timezone(timedelta(hours=float(rows[0][8])))
    days = [datetime(int(each[0]), int(each[1]), int(each[2]), tzinfo=zone) for each in hours]
    times = [_middle(day, each[3]) for day, each in zip(days, hours, strict=True)]
    return _of(float(rows[0][6]), float(rows[0][7]), times, [each[4:] for each in hours])


def _of_tmy3(rows: list[list[str]]) -> Content:
    at = [rows[1].index(name) for name in TMY3_NAMES]
    zone = timezone(timedelta(hours=float(rows[0][3])))
    times, radiation = [], []
    for row in filter(None, rows[2:]):
        day, end, *values = (row[k] for k in at)
        midnight = datetime.strptime(day, "%m/%d/%Y").replace(tzinfo=zone)
        times.append(_middle(midnight, float(end.split(":")[0])))
        radiation.append([float(each) for each in values])
    return _of(float(rows[0][4]), float(rows[0][5]), times, radiation)


def _of_pvgis(rows: list[list[str]]) -> Content:
    head = next(n for n, row in enumerate(rows) if row and row[0] == PVGIS_NAMES[0])
    place = dict("".join(row).split(":", 1) for row in rows[:head] if ":" in "".join(row))
    at = [rows[head].index(name) for name in PVGIS_NAMES]
    times, radiation = [], []
    for row in itertools.takewhile(bool, rows[head + 1 :]):
        time, *values = (row[k] for k in at)
        times.append(datetime.strptime(time, "%Y%m%d:%H%M").replace(tzinfo=UTC))
        radiation.append([float(each) for each in values])
    latitude, longitude = (float(place[f"{name} (decimal degrees)"]) for name in PVGIS_PLACE)
    return _of(latitude, longitude, times, radiation)


def _middle(day: datetime, end: float) -> datetime:
    """Middle of the hour of a day that ends at a number from 1 to 24."""
    return day + timedelta(hours=end - 0.5)


def _of(
    latitude: float, longitude: float, times: list[datetime], radiation: Sequence[Sequence[float]]
) -> Content:
    kept = [n for n, time in enumerate(times) if (time.month, time.day) != (2, 29)]
    beam, diffuse = np.array(radiation, np.float64).reshape(-1, 2)[kept].T
    return latitude, longitude, [times[n] for n in kept], beam, diffuse


def sky_factors(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """(K,) sky view factors of the groups of `Sunlight.names`, and estimates of their errors."""
    both = []
    for half in (0.0, 0.5):  # the second lattice is turned by half a step
        towards = fibonacci_sphere(SKY_DIRECTIONS, 1.0)
        angle = half * math.pi * (3 - math.sqrt(5))
        turn = np.array(((math.cos(angle), -math.sin(angle)), (math.sin(angle), math.cos(angle))))
        towards[:, :2] = towards[:, :2] @ turn.T
        solid = np.full(len(towards), 2 * math.pi / len(towards))
        result = sunlit(mesh, towards, solid)
        areas = np.array([area_of(mesh, result, row) for row in range(len(result.names))])
        both.append(result.part_energy / (math.pi * areas))
    return (both[0] + both[1]) / 2, abs(both[0] - both[1])


def area_of(mesh: Mesh, result: Sunlight, row: int) -> float:
    """Area of a group of `Sunlight.names`, m^2."""
    own = np.isin(result.pieces.of_face, result.part_pieces[row])
    return max(float(mesh.areas[own].sum()), 1e-300)


def diffuse_of(result: Sunlight, weather: Weather) -> list[ByName]:
    """Sky view factor of each group, and the diffuse energy of the year on it."""
    factors, errors = sky_factors(result.mesh)
    year = float(weather.diffuse.sum()) / 1e3
    return [
        {"name": name, "sky_view_factor": float(factor), "estimated_error": float(error)}
        | {"energy_kwh": factor * year * area_of(result.mesh, result, row)}
        for row, (name, factor, error) in enumerate(zip(result.names, factors, errors, strict=True))
    ]


def write_shade_factors(result: Sunlight, is_up: BoolArray, path: Path) -> None:
    """Write the loss of beam radiation by shading of each hour and group, %, as SAM reads it.

    A column a group, a row an hour of the year; 0 while the sun is down.
    """
    losses = np.zeros((HOURS, len(result.names)))
    losses[is_up] = 100 * (1 - np.clip(result.share, 0, 1))
    rows = [dict(zip(result.names, each, strict=True)) for each in losses.round(4).tolist()]
    write_text(path, csv_text(result.names, rows))


def check_options(weather: Path | None, shade_factors: Path | None) -> None:
    """Raise ConfigError for shade factors without weather, or in a place that cannot be written."""
    if shade_factors is not None:
        if weather is None:
            raise ConfigError("--shade-factors: expected --weather with it, got none; give a file")
        check_place(shade_factors)
