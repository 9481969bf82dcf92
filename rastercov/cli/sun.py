"""The command `sun`: hours and energy of sunlight on a model, for a day or a year."""

from datetime import date, datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer
from typer import Option

from rastercov.base import ByName, CameraError, ConfigError, shorten, shown
from rastercov.base.arguments import positive
from rastercov.base.format import text_with_bound
from rastercov.cli import options
from rastercov.cli.console import out_option, print_lines, warn
from rastercov.cli.inputs import SceneOptions, check_targets
from rastercov.cli.terminal import progress_bar
from rastercov.core.camera import size_warnings
from rastercov.core.camera.sun import NORTH_DEG, angle, sun_directions
from rastercov.core.mesh.files import Site
from rastercov.core.mesh.groups import names_of_groups
from rastercov.core.mesh.mesh import Mesh, names_of

if TYPE_CHECKING:
    from rastercov.sun.weather import Weather

MOST_LINES = 12
"""Pieces that are printed."""


class PeriodOptions(NamedTuple):
    """Times, and what counts of the sun."""

    day: Annotated[str | None, Option(help="Day: YYYY-MM-DD.")] = None
    year: Annotated[int | None, Option(help="Year, instead of a day.", min=1950, max=2050)] = None
    weather: Annotated[
        Path | None,
        Option(
            help="Radiation of a typical year, instead: EPW file, or CSV file of TMY3 or PVGIS, "
            "with its place."
        ),
    ] = None
    shade_factors: Annotated[
        Path | None,
        Option(help="Write hourly losses of beam radiation by shading, %, as SAM reads them: CSV."),
    ] = None
    step: Annotated[
        int | None,
        Option(help="Time step, minutes.", show_default="10; 60 with --year"),
    ] = None
    north: Annotated[
        float | None,
        Option(
            help="Direction of north, deg from +x towards +y.",
            show_default="that of an IFC file, or 90",
        ),
    ] = None
    min_elevation: Annotated[float, Option(help="Minimum elevation of the sun, deg.")] = 0.0
    irradiance: Annotated[
        float | None,
        Option(help="Direct normal irradiance, W/m2.", show_default="1000"),
    ] = None
    penumbra: Annotated[
        bool,
        Option(help="Also compute hours lit by all of the solar disc, and by at least part."),
    ] = False

    def entries(self) -> ByName:
        """Entries of the record of a run."""
        weather = None if self.weather is None else self.weather.name
        return self._replace(weather=None, shade_factors=None)._asdict() | {"weather": weather}

    def times(self, longitude: float, year: "Weather | None") -> tuple[str, int, list[datetime]]:
        """Period in words, minutes of a step, and the middles of its steps from solar midnight."""
        given = sum(each is not None for each in (self.day, self.year, self.weather))
        if given != 1:
            number = "none" if not given else f"{given} of them"
            raise ConfigError(f"expected --day, --year or --weather, got {number}; give one")
        if year is not None:
            return f"the year of {year.name}", 60, year.times
        try:
            first = date.fromisoformat(self.day or f"{self.year}-01-01")
        except ValueError:
            raise ConfigError(
                f"--day: expected an existing date YYYY-MM-DD, got {shown(self.day)}; correct it"
            ) from None
        step = (10 if self.day else 60) if self.step is None else self.step
        if not 1 <= step <= 60 or 60 % step:
            raise ConfigError(f"--step: expected minutes that divide an hour, got {step}; give 10")
        zone = timezone(timedelta(hours=round(angle("longitude", longitude, 180.0) / 15)))
        start = datetime(first.year, first.month, first.day, tzinfo=zone)
        days = 1 if self.day else (date(first.year, 12, 31) - first).days + 1
        steps = range(days * 1440 // step)
        middles = [start + timedelta(minutes=step * (row + 0.5)) for row in steps]
        return first.isoformat() if self.day else str(self.year), step, middles


class SiteOptions(NamedTuple):
    """Place on the earth."""

    latitude: Annotated[
        float | None,
        Option(help="Latitude, deg, north positive.", show_default="that of an IFC file"),
    ] = None
    longitude: Annotated[
        float | None,
        Option(help="Longitude, deg, east positive.", show_default="that of an IFC file"),
    ] = None


class SurfaceOptions(NamedTuple):
    """Groups that are evaluated, in faces of a size, and what each needs."""

    of: Annotated[
        list[str],
        Option(
            help="Group or part to evaluate (wildcards allowed); all others occlude. Repeatable.",
            show_default="all but occluders",
        ),
    ] = []  # noqa: RUF012 - typer copies it
    at_least: Annotated[
        str | None,
        Option(
            help="Minimum sunlight hours per piece of a group, such as 1.5h; or per room, by a "
            "level of EN 17037: minimum, medium, high. Exits with 1 if not reached. A piece is a "
            "set of faces whose bounding box touches no other."
        ),
    ] = None
    resolution: Annotated[
        float | None,
        Option(
            help="Maximum side of a face, m; larger faces are subdivided.",
            show_default="no subdivision",
        ),
    ] = None


@options.expand_options
def sun(
    meshes: options.Meshes,
    site: SiteOptions,
    scene: SceneOptions,
    period: PeriodOptions,
    surface: SurfaceOptions,
    out: Annotated[Path, out_option("Folder for the report.")] = Path("sun"),
    pdf: options.Pdf = False,
    as_json: options.AsJson = False,
) -> None:
    """Compute sunlight hours and solar irradiation on faces, groups and storeys for a day or year.

    Example: rastercov sun house.ifc --latitude 49.1 --longitude 8.4 --day 2026-03-21

    Windows: rastercov sun a.ifc --latitude 49 --longitude 8 --day 2026-03-21 --of '*IfcWindow*'
    """
    from rastercov.base import json_text
    from rastercov.sun import weather
    from rastercov.sun.sun_report import Study, write
    from rastercov.sun.sunlight import LIT_BY, pieces_of, sunlit

    weather.check_options(period.weather, period.shade_factors)
    year = None if period.weather is None else weather.read_weather(period.weather)
    given = {**site._asdict(), "step": period.step, "irradiance": period.irradiance}
    more = [name for name, value in given.items() if value is not None]
    if year is not None and more:
        raise ConfigError(f"expected --weather or --{more[0]}, got both; leave one out")
    if year is None is period.irradiance:
        period = period._replace(irradiance=1000.0)
    period.times(0.0, year)  # errors before the mesh is read
    least, level = _hours(surface.at_least, period)
    mesh = scene.read(meshes)
    place = Site(period.north, *(site if year is None else year[1:3]))
    if year is not None and None in Site.common([place, mesh.site])[1:]:
        warn(f"the place is that of {year.name}, far from that of the mesh file")
    north, latitude, longitude = mesh.site.known_values(place._asdict(), "--north")
    if latitude is None or longitude is None:
        raise ConfigError(
            "expected --latitude and --longitude, got one or none, and none that all files share; "
            "give both"
        )
    words, step, times = period.times(longitude, year)
    north = NORTH_DEG if north is None else north
    towards = sun_directions(latitude, longitude, times, north)
    mesh = _select_targets(mesh, surface.of, surface.resolution)
    if least is not None:
        pieces_of(mesh, are_judged=True)  # an error before the work
    lowest = max(angle("min_elevation", period.min_elevation, 90.0), 0.0)
    sine = np.sin(np.radians(lowest))
    is_up = towards[:, 2] > sine
    if not is_up.any():
        warn(f"the sun stays below {lowest:g} degrees of elevation ({words}): 0 h")
    is_before = ~is_up & np.roll(is_up, -1)
    kept = np.flatnonzero(is_up | is_before | np.roll(is_up, 1))  # with the ends of nights
    towards, chosen = towards[kept], [times[row] for row in kept]
    towards[:, 2] = np.maximum(towards[:, 2], sine)
    hours, starts = is_up[kept] * (step / 60), is_before[kept]
    power = period.irradiance if year is None else year.beam[kept]
    how: ByName = {"irradiance": power, "step": step / 60, "starts": starts}
    with progress_bar("sunlight", then="report") as progress:

        def make_study() -> Study:
            ways = {
                way: sunlit(mesh, towards, hours, **how, lit_by=way, progress=progress)
                for way in (LIT_BY if period.penumbra else ["middle"])
            }
            is_fine = surface.resolution is not None
            diffuse = None if year is None else weather.diffuse_of(ways["middle"], year)
            return Study(ways, chosen, starts, words, step, least, level, north, is_fine, diffuse)

        given = {
            "latitude": latitude,
            "longitude": longitude,
            **period.entries(),
            "north": north,
            **surface._asdict(),
            "scene": scene.entries(out, meshes),
        }
        study, summary = write(make_study, out, given, pdf=pdf)
    if period.shade_factors is not None:
        weather.write_shade_factors(study.ways["middle"], is_up, period.shade_factors)
    if len(mesh.groups) == 1 == len(study.ways["middle"].pieces.hours):
        warn(
            "one group in one piece cannot shade its silhouette: its hours are about those of the "
            "sun; for hours of faces see sun.html and sun.npz"
        )
    if as_json:
        print(json_text(summary))
    else:
        _print(summary, out)
    if summary["passed"] is False:
        raise typer.Exit(1)


def _select_targets(mesh: Mesh, of: list[str], resolution: float | None) -> Mesh:
    """The mesh of which some groups are evaluated, or all if none are named, in small faces."""
    from rastercov.sun.sunlight import divide_targets

    if of:
        names = names_of(mesh, [each.name for each in mesh.sources] or ["mesh"])
        kept = names_of_groups("--of", of, names) or set()
        mesh = mesh.with_groups(
            occluders=[g.name for g in mesh.groups if g.is_occluder or g.name not in kept]
        )
    check_targets(mesh)
    # Before it is divided, where sides of different faces do not match; of a model or a town.
    warn(*mesh.warnings, *size_warnings(mesh, 0.03, 5e3))
    if resolution is not None:
        mesh = divide_targets(mesh, resolution)
    return mesh


def _hours(text: str | None, period: PeriodOptions) -> tuple[float | None, str]:
    """Hours of text such as "1.5h" or "1.5", or of a level of EN 17037, and that level."""
    from rastercov.sun.sun_report import LEVELS

    if text is None:
        return None, ""
    if text in LEVELS:
        _check_en_17037(period)
        return LEVELS[text], text
    try:
        return positive("--at-least", float(text.strip().removesuffix("h"))), ""
    except (ValueError, CameraError):
        raise ConfigError(
            f"--at-least: expected hours such as 1.5h, or one of {', '.join(LEVELS)}, got "
            f"{shown(text)}; correct it"
        ) from None


def _check_en_17037(period: PeriodOptions) -> None:
    """Raise ConfigError for another day than EN 17037 asks for, or without a least elevation."""
    if not period.day or not (2, 1) <= date.fromisoformat(period.day).timetuple()[1:3] <= (3, 21):
        raise ConfigError(
            "--day: expected a day from 1 February to 21 March for EN 17037, got "
            f"{shown(period.day)}; give one, such as 2026-03-21"
        )
    if not period.min_elevation > 0:
        raise ConfigError(
            "--min-elevation: expected the minimum for the country of the building, EN 17037 annex "
            f"D, got {period.min_elevation:g}; give it, such as 11 in Germany or 13 in Czechia"
        )


def _print(summary: ByName, out: Path) -> None:
    """Print the answer, and the pieces with the least hours."""
    from rastercov.sun.sun_report import hours_text

    print_lines(summary["answer"])
    pieces = summary["pieces"]
    for each in pieces[:MOST_LINES]:
        energy = text_with_bound(each["energy_kwh"], each["bound_kwh"])
        words = [f"{hours_text(each)} h, {energy} kWh: {shorten(each['name'], 60)}"]
        words += [f" no. {each['number']}"] * (len(pieces) > 1)
        words += [f" faces {each['faces']}"] * bool(each["faces"])
        words += [f" shaded {own['hours']:.1f} h by {own['name']}" for own in each["shaded_by"]]
        print_lines(";".join(words))
    for each in summary.get("diffuse", ()):
        factor, error = each["sky_view_factor"], each["estimated_error"]
        print_lines(
            f"diffuse, isotropic sky: {each['energy_kwh']:.4g} kWh, sky view factor {factor:.3f} "
            f"(estimated error {error:.3f}): {shorten(each['name'], 60)}"
        )
    if pieces[MOST_LINES:]:
        print_lines(f"and {len(pieces) - MOST_LINES} more, which get as much sun or more")
    print_lines(out / "sun.html")
