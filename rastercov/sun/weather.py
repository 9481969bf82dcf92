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
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rastercov.base import BoolArray, ByName, ConfigError, FloatArray, check_place, write_text
from rastercov.base.files import LARGEST_TEXT, file_bytes
from rastercov.base.output import csv_text
from rastercov.core.camera.viewpoints import fibonacci_sphere
from rastercov.core.mesh import Mesh
from rastercov.sun.sunlight import Sunlight, sunlit

HOURS = 8760
"""Hours of a typical year, which has no 29 February."""
SKY_DIRECTIONS = 500
"""Directions of a lattice over the sky."""
EPW_COLUMNS = [14, 15]
"""Direct normal and diffuse radiation."""
TMY3_NAMES = "Date (MM/DD/YYYY)", "Time (HH:MM)", "DNI (W/m^2)", "DHI (W/m^2)"
PVGIS_PLACE = "Latitude", "Longitude"
PVGIS_OFFSET = "Irradiance Time Offset (h)"
"""Time of the sun after the stamp of a row."""
PVGIS_NAMES = ["time(UTC)", "Gb(n)", "Gd(h)"]


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
        lines = file_bytes(path, LARGEST_TEXT).decode("utf-8-sig", "replace").splitlines()
        weather = _weather(path.name, list(csv.reader(lines, skipinitialspace=True)))
    except (ValueError, LookupError, OverflowError, StopIteration, csv.Error) as error:
        raise ConfigError(
            f"--weather: expected an EPW, TMY3 or PVGIS file, got: {error or 'its end'}; download "
            "one of these"
        ) from None
    values = zip(weather.times, weather.beam, weather.diffuse, strict=True)
    wrong = (f"{own}: {b:g} and {d:g}" for own, b, d in values if not (0 <= b < 2000 > d >= 0))
    if got := next(wrong, len(weather.times) != HOURS and f"{len(weather.times)}"):
        raise ConfigError(
            f"--weather: expected {HOURS} hours with 0 to 2000 W/m2, got {got}; download the file "
            "again"
        )
    return weather


def _weather(name: str, rows: list[list[str]]) -> Weather:
    late = timedelta()
    if rows[0][0] == "LOCATION":
        latitude, longitude, zone = rows[0][6:9]
        body, columns, form = [row for row in rows[8:] if row], EPW_COLUMNS, "%Y/%m/%d"
        ends = [("/".join(row[:3]), float(row[3])) for row in body]
    elif set(TMY3_NAMES) <= set(rows[1]):
        zone, latitude, longitude = rows[0][3:6]
        day, end, *columns = map(rows[1].index, TMY3_NAMES)
        body, form = [row for row in rows[2:] if row], "%m/%d/%Y"
        ends = [(row[day], float(row[end].split(":")[0])) for row in body]
    else:
        head = next(n for n, row in enumerate(rows) if row[:1] == PVGIS_NAMES[:1])
        place = dict("".join(row).split(":", 1) for row in rows[:head] if ":" in "".join(row))
        late = timedelta(hours=float(place.get(PVGIS_OFFSET, 0)))
        latitude, longitude = (place[f"{each} (decimal degrees)"] for each in PVGIS_PLACE)
        columns = [rows[head].index(each) for each in PVGIS_NAMES[1:]]
        zone, body, form = "0", list(itertools.takewhile(bool, rows[head + 1 :])), "%Y%m%d:%H%M"
        ends = [(row[0], 0.5) for row in body]
    if wrong := [end for _, end in ends if not 0 < end <= 24]:
        raise ValueError(f"an hour {wrong[0]:g}, which are 1 to 24")
    if not abs(float(zone)) < 24:
        raise ValueError(f"a time zone of {zone} h")
    offset = timezone(timedelta(hours=float(zone)))
    times = [
        datetime.strptime(start, form).replace(tzinfo=offset) + timedelta(hours=end - 0.5)
        for start, end in ends
    ]
    values = np.array([[float(row[k]) for k in columns] for row in body])
    kept = [n for n, time in enumerate(times) if (time.month, time.day) != (2, 29)]
    beam, diffuse = values[kept].T
    sun_times = [times[n] + late for n in kept]
    return Weather(name, float(latitude), float(longitude), sun_times, beam, diffuse)


def sky_factors(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """(K,) sky view factors of the groups of `Sunlight.names`, and estimates of their errors."""
    both = []
    for n in (SKY_DIRECTIONS, SKY_DIRECTIONS + 1):
        result = sunlit(mesh, fibonacci_sphere(n, 1.0), np.full(n, 2 * math.pi / n))
        both.append(result.part_energy / (math.pi * areas_of(result)))
    return (both[0] + both[1]) / 2, abs(both[0] - both[1])


def areas_of(result: Sunlight) -> FloatArray:
    """(K,) areas of the groups of `Sunlight.names`, m^2."""
    own = [np.isin(result.pieces.of_face, pieces) for pieces in result.part_pieces]
    return np.maximum([result.mesh.areas[each].sum() for each in own], 1e-300)


def diffuse_of(result: Sunlight, weather: Weather) -> list[ByName]:
    """Sky view factor of each group, and the diffuse energy of the year on it."""
    factors, errors = sky_factors(result.mesh)
    year = float(weather.diffuse.sum()) / 1e3
    columns = result.names, factors, errors, factors * year * areas_of(result)
    names = "name", "sky_view_factor", "estimated_error", "energy_kwh"
    return [dict(zip(names, each, strict=True)) for each in zip(*columns, strict=True)]


def write_shade_factors(result: Sunlight, is_up: BoolArray, path: Path) -> None:
    """Write the loss of beam radiation by shading of each hour and group, %, as SAM reads it.

    A column a group, a row an hour of the year; 0 while the sun is down.
    """
    losses = np.zeros((HOURS, len(result.names)))
    losses[is_up] = 100 * (1 - np.clip(result.share[result.weights > 0], 0, 1))
    rows = [dict(zip(result.names, each, strict=True)) for each in losses.round(4).tolist()]
    write_text(path, csv_text(result.names, rows))


def check_options(weather: Path | None, shade_factors: Path | None) -> None:
    """Raise ConfigError for shade factors without weather, or in a place that cannot be written."""
    if shade_factors is not None:
        if weather is None:
            raise ConfigError("--shade-factors: expected --weather with it, got none; give a file")
        check_place(shade_factors)
