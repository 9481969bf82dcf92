"""The command `sun`: hours and energy of sunlight on a model, for a day or a year."""

from datetime import date, datetime, timedelta, timezone
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from typer import Option

from rastercov.base import ByName, CameraError, ConfigError, shorten, shown
from rastercov.base.arguments import positive
from rastercov.base.format import coordinates, text_with_bound
from rastercov.cli import options
from rastercov.cli.console import out_option, print_lines, progress_bar, warn
from rastercov.cli.inputs import SceneOptions
from rastercov.core.camera import size_warnings
from rastercov.core.mesh.groups import names_of_groups
from rastercov.core.mesh.mesh import Mesh, names_of
from rastercov.light.sun import NORTH_DEG, angle, sun_directions

MOST_LINES = 12
"""Groups that are printed."""


class PeriodOptions(NamedTuple):
    """Times, and what counts of the sun."""

    day: Annotated[str | None, Option(help="Day: YYYY-MM-DD.")] = None
    year: Annotated[int | None, Option(help="Year, instead of a day.", min=1950, max=2050)] = None
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
    irradiance: Annotated[float, Option(help="Direct normal irradiance, W/m2.")] = 1000.0
    penumbra: Annotated[
        bool,
        Option(help="Also compute hours lit by all of the solar disc, and by at least part."),
    ] = False

    def times(self, longitude: float) -> tuple[str, int, list[datetime]]:
        """Period in words, minutes of a step, and the middles of its steps from solar midnight."""
        if (self.day is None) == (self.year is None):
            both = "neither" if self.day is None else "both"
            raise ConfigError(f"expected --day or --year, got {both}; give one")
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
            help="Minimum sunlight hours per piece of a group, such as 1.5h; exits with 1 if not "
            "reached. A piece is a set of faces whose bounding box touches no other; over 100 "
            "count as one."
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
    from rastercov.light.sun_report import Study, write
    from rastercov.light.sunlight import LIT_BY, sunlit

    least = _hours(surface.at_least)
    period.times(0.0)  # errors before the mesh is read
    mesh = scene.read(meshes)
    given = {"north_deg": period.north, **site._asdict()}
    north, latitude, longitude = mesh.site.known_values(given, "--north")
    if latitude is None or longitude is None:
        raise ConfigError(
            "expected --latitude and --longitude, got one or none, and none of a file; give both"
        )
    words, step, times = period.times(longitude)
    north = NORTH_DEG if north is None else north
    towards = sun_directions(latitude, longitude, times, north)
    mesh = _select_targets(mesh, surface.of, surface.resolution)
    lowest = max(angle("min_elevation", period.min_elevation, 90.0), 0.0)
    is_up = towards[:, 2] > np.sin(np.radians(lowest))
    if not is_up.any():
        warn(f"the sun stays below {lowest:g} degrees of elevation ({words}): 0 h")
    towards, chosen = towards[is_up], [times[row] for row in np.flatnonzero(is_up)]
    hours, at = np.full(len(towards), step / 60), np.array([time.timestamp() for time in chosen])
    starts = np.diff(at, prepend=-np.inf) > 90 * step  # after a night
    how: ByName = {"irradiance": period.irradiance, "step": step / 60, "starts": starts}
    with progress_bar("sunlight", then="report") as progress:

        def make_study() -> Study:
            ways = {
                way: sunlit(mesh, towards, hours, **how, lit_by=way, progress=progress)
                for way in (LIT_BY if period.penumbra else ["middle"])
            }
            return Study(ways, chosen, words, step, least)

        given = {"latitude": latitude, "longitude": longitude, **period._asdict()}
        given |= {"north": north, **surface._asdict()}
        given["scene"] = scene.entries(out, meshes)
        study, summary = write(make_study, out, given, pdf=pdf)
    if len(mesh.groups) == 1 == study.ways["middle"].n_pieces[0]:
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
    from rastercov.light.sunlight import divide_targets

    if of:
        kept = names_of_groups("--of", of, names_of(mesh)) or set()
        mesh = mesh.with_groups(occluders={group.name for group in mesh.groups} - kept)
    # Before it is divided, where sides of different faces do not match; of a model or a town.
    warn(*mesh.warnings, *size_warnings(mesh, 0.03, 5e3))
    if resolution is not None:
        mesh = divide_targets(mesh, resolution)
    return mesh


def _hours(text: str | None) -> float | None:
    """Hours of text such as "1.5h" or "1.5"."""
    if text is None:
        return None
    try:
        return positive("--at-least", float(text.strip().removesuffix("h")))
    except (ValueError, CameraError):
        raise ConfigError(
            f"--at-least: expected hours such as 1.5h, got {shown(text)}; correct it"
        ) from None


def _print(summary: ByName, out: Path) -> None:
    """Print the answer, and the groups with the least hours."""
    groups = [each for each in summary["parts"] if each["is_group"]]
    print_lines(summary["answer"])
    for each in groups[:MOST_LINES]:
        hours = f"{text_with_bound(each['hours'], each['bound_hours'])} h"
        energy = f"{text_with_bound(each['energy_kwh'], each['bound_kwh'])} kWh"
        if "hours_lit_by_all" in each:
            disc = [
                text_with_bound(each[f"hours_lit_by_{way}"], each[f"bound_hours_lit_by_{way}"])
                for way in ("all", "some")
            ]
            hours += f" (whole disc {disc[0]} h, at least part {disc[1]} h)"
        least = ""
        if each["pieces"] > 1:
            at = coordinates(each["least_piece_at"], 2)
            worst = text_with_bound(each["least_piece_hours"], each["least_piece_bound_hours"])
            least = f"; worst of {each['pieces']} pieces: {worst} h at ({at}) m"
        print_lines(f"{hours}, {energy}: {shorten(each['name'], 60)}{least}")
    if groups[MOST_LINES:]:
        print_lines(
            f"and {len(groups) - MOST_LINES} more groups, whose pieces get as much sun or more"
        )
    print_lines(out / "sun.html")
