"""The command `sun`: hours and energy of sun on a model, for a day or a year."""

import re
from datetime import date, datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import number, shortened
from rastercov.base.memory import FloatArray
from rastercov.camera.sun import NORTH_DEG, angle, clear_sky, sun_directions
from rastercov.cli import options
from rastercov.cli.console import out_option, progress_bar, warn
from rastercov.cli.inputs import SceneOptions
from rastercov.mesh import Mesh
from rastercov.mesh.groups import named
from rastercov.mesh.mesh import names_of
from rastercov.shards import Progress

if TYPE_CHECKING:
    from rastercov.report.sunlight import Study

MOST_LINES = 12
"""Groups that are printed."""


class PeriodOptions(NamedTuple):
    """Times, and what counts of the sun."""

    day: Annotated[str | None, typer.Option(help="Day: YYYY-MM-DD.")] = None
    year: Annotated[int | None, typer.Option(help="Year, in place of a day.")] = None
    step: Annotated[
        int | None,
        typer.Option(
            help="Minutes from one direction to the next.", show_default="10, 60 in a year"
        ),
    ] = None
    north: Annotated[float, typer.Option(help="Direction of north, deg from +x towards +y.")] = (
        NORTH_DEG
    )
    min_elevation: Annotated[
        float, typer.Option(help="Least height of the sun that counts, deg.")
    ] = 0.0
    irradiance: Annotated[
        float | None,
        typer.Option(help="Irradiance across the rays, W/m2.", show_default="a clear sky"),
    ] = None
    penumbra: Annotated[
        bool, typer.Option(help="Also compute what all and what some of the sun's disc lights.")
    ] = False

    def times(self, longitude: float) -> tuple[str, int, list[datetime]]:
        """Period in words, minutes of a step, and the middles of its steps from solar midnight."""
        if (self.day is None) == (self.year is None):
            both = "neither" if self.day is None else "both"
            raise ConfigError(f"expected --day or --year, got {both}; give one")
        try:
            first = date(self.year, 1, 1) if self.year else date.fromisoformat(self.day or "")
        except ValueError:
            given = self.day or self.year
            raise ConfigError(
                f"expected --day YYYY-MM-DD or a year, got {shown(given)}; correct it"
            ) from None
        step = (10 if self.day else 60) if self.step is None else self.step
        if not 1 <= step <= 60 or 60 % step:
            raise ConfigError(f"--step: expected minutes that divide an hour, got {step}; give 10")
        zone = timezone(timedelta(hours=round(angle("longitude", longitude, 180.0) / 15)))
        start = datetime(first.year, first.month, first.day, tzinfo=zone)
        days = 1 if self.day else (date(first.year, 12, 31) - first).days + 1
        steps = range(days * 1440 // step)
        middles = [start + timedelta(minutes=step * (row + 0.5)) for row in steps]
        return self.day or str(self.year), step, middles


@options.expanded
def sun(
    meshes: options.Meshes,
    latitude: Annotated[float, typer.Option(help="Latitude, deg, north positive.")],
    longitude: Annotated[float, typer.Option(help="Longitude, deg, east positive.")],
    scene: SceneOptions,
    period: PeriodOptions,
    of: Annotated[
        list[str],
        typer.Option(
            help="Group or part to evaluate (wildcards allowed); all others occlude. Repeatable.",
            show_default="all but occluders",
        ),
    ] = [],  # noqa: B006 - typer copies it
    at_least: Annotated[
        str | None,
        typer.Option(help="Hours that each group must get, such as 1.5h: else exit with 1."),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(help="Longest side of the faces of the map, m.", show_default="as they are"),
    ] = None,
    out: Annotated[Path, out_option("Folder for the report.")] = Path("sun"),
    pdf: options.Pdf = False,
    as_json: options.AsJson = False,
) -> None:
    """Compute hours and energy of sun on faces, groups and storeys, for a day or a year.

    Example: rastercov sun house.ifc --latitude 49.1 --longitude 8.4 --day 2026-03-21

    EN 17037: rastercov sun house.ifc --latitude 49.1 --longitude 8.4 --day 2026-03-21 --at-least 3h
    """
    from rastercov.base.output import json_text
    from rastercov.report.sunlight import write

    least = _hours(at_least)
    words, step, times = period.times(longitude)
    towards = sun_directions(latitude, longitude, times, period.north)
    mesh = _scene(scene.read(meshes), of, resolution)
    warn(*mesh.warnings)
    is_up = towards[:, 2] > np.sin(np.radians(max(period.min_elevation, 0.0)))
    if not is_up.any():
        warn(f"the sun stays below {period.min_elevation:g} degrees, {words}: 0 h")
    chosen = [time for time, own in zip(times, is_up.tolist(), strict=True) if own]
    with progress_bar("views", then="report") as progress:
        on = mesh, towards[is_up], chosen, (words, step)
        study = _study(*on, period, least, progress)
        given = {"latitude": latitude, "longitude": longitude, **period._asdict(), "of": of}
        kept = given | {"at_least": at_least, "resolution": resolution}
        kept |= {"scene": scene.entries(out, meshes)}
        summary = write(study, out, kept, pdf=pdf)
    if as_json:
        print(json_text(summary))
    else:
        _print(summary, out)
    if study.passed is False:
        raise typer.Exit(1)


def _hours(text: str | None) -> float | None:
    """Hours of text such as "1.5h", "90 min" or "1.5"."""
    if text is None:
        return None
    found = re.fullmatch(r"([0-9]*\.?[0-9]+)\s*(h|min)?", text.strip())
    if found is None:
        raise ConfigError(f"--at-least: expected hours such as 1.5h, got {shown(text)}; correct it")
    return float(found[1]) / (60 if found[2] == "min" else 1)


def _scene(mesh: Mesh, of: list[str], resolution: float | None) -> Mesh:
    """Mesh with the groups to evaluate, in faces up to a size."""
    if of:
        kept = named("--of", of, names_of(mesh)) or set()
        names = [group.name for group in mesh.groups]
        occluders = [name for name in names if name not in kept]
        mesh = mesh.with_groups(occluders=occluders)
    if resolution is None:
        return mesh
    from rastercov.coverage.sunlight import divided

    return divided(mesh, resolution)


def _study(
    mesh: Mesh,
    towards: FloatArray,
    times: list[datetime],
    words: tuple[str, int],
    period: PeriodOptions,
    least: float | None,
    progress: Progress,
) -> "Study":
    """Sunlight of the directions; by all and by some of the disc where they are asked for."""
    from rastercov.coverage.sunlight import sunlit
    from rastercov.report.sunlight import Study

    power = clear_sky(towards) if period.irradiance is None else period.irradiance
    hours = np.full(len(towards), words[1] / 60)
    ways = ["middle", *(["all", "some"] if period.penumbra else [])]
    found = [sunlit(mesh, towards, hours, power, lit_by=each, progress=progress) for each in ways]
    return Study(*found, times=times, period=words[0], step=words[1], least=least)


def _print(summary: dict[str, Any], out: Path) -> None:
    """Print the answer, and the groups with the least hours."""
    groups = [each for each in summary["parts"] if each["is_group"]]
    lines = []
    for each in groups[:MOST_LINES]:
        disc = ""
        if "hours_lit_by_all" in each:
            disc = f" ({number(each['hours_lit_by_all'])} to {number(each['hours_lit_by_some'])})"
        energy = number(each["energy_kwh"])
        lines.append(
            f"{number(each['hours'])} h{disc}, {energy} kWh: {shortened(each['name'], 60)}"
        )
    if groups[MOST_LINES:]:
        lines.append(f"and {len(groups) - MOST_LINES} more with as many hours or more")
    print(summary["answer"], *lines, out / "sun.html", sep="\n")
