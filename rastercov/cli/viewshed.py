"""The command `viewshed`: the visible part of a terrain from one place or several."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from typer import Argument, Option

from rastercov.base import ConfigError, check_choice, check_place, json_text
from rastercov.cli.console import out_option, print_lines, say, warn
from rastercov.cli.options import AsJson, expand_options
from rastercov.cli.terminal import progress_bar


class EyeOptions(NamedTuple):
    """Observers."""

    at: Annotated[
        str | None,
        Option("--from", metavar="X,Y", help="Map coordinates of the observer."),
    ] = None
    observers: Annotated[
        Path | None,
        Option(help="CSV file of observers, instead: columns x, y and, if they differ, height."),
    ] = None
    beside: Annotated[
        list[Path] | None,
        Option(help="Mesh file in map coordinates, m, that hides ground, such as buildings."),
    ] = None


class SightOptions(NamedTuple):
    """Heights of eyes and of targets, the largest distance, and the shape of the earth."""

    height: Annotated[float, Option(help="Height of the eyes above the ground, m.")] = 1.7
    target: Annotated[float, Option(help="Height of what is to be seen above the ground, m.")] = 0.0
    radius: Annotated[
        float | None, Option(help="Largest distance on the map, m.", show_default="no limit")
    ] = None
    refraction: Annotated[float, Option(help="Coefficient of refraction.")] = 0.13
    curvature: Annotated[bool, Option("--curvature/--flat", help="Curvature of the earth.")] = True


@expand_options
def viewshed(
    raster: Annotated[
        Path,
        Argument(metavar="RASTER", help="GeoTIFF or ESRI ASCII grid of heights, in metres."),
    ],
    eyes: EyeOptions,
    sight: SightOptions,
    outlines: Annotated[
        Path | None, Option(help="Write outlines of the visible ground: .geojson.")
    ] = None,
    at_least: Annotated[
        float | None,
        Option(
            min=0,
            max=100,
            help="Minimum visible share of the ground, %, by each observer. Exits with 1 if not "
            "reached.",
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("Output folder for viewshed.tif, viewshed.png, observers.csv.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the visible part of each cell of a terrain, with the curvature of the earth.

    Example: rastercov viewshed dem.tif --from 500100,5300200 --radius 5000 --out seen/
    """
    from rastercov.core.mesh import Mesh
    from rastercov.placement.required import SHARE_TOLERANCE
    from rastercov.report.folder import ReportFolder
    from rastercov.survey import viewshed_files as files
    from rastercov.survey.viewshed import viewshed as viewshed_of

    observers = files.read_observers(eyes.at, eyes.observers)
    if outlines is not None:
        check_choice("the suffix of --outlines", outlines.suffix.lower(), (".geojson", ".json"))
        if eyes.beside:
            raise ConfigError("expected --outlines or --beside, got both; leave one out")
        check_place(outlines)
    meshes = [Mesh.load(path) for path in eyes.beside or ()]
    with ExitStack() as stack:
        folder = None if out is None else stack.enter_context(ReportFolder(out, files.VIEWSHED))
        with progress_bar("observers") as progress:
            result = viewshed_of(
                raster,
                observers,
                **sight._asdict(),
                beside=Mesh.joined(meshes) if meshes else None,
                progress=progress,
            )
        if (out or outlines) and not result.raster.crs:
            warn("the raster has no EPSG code: files have its coordinates without a CRS")
        if folder is not None:
            files.write_files(result, folder)
    if outlines is not None:
        files.write_outlines(result, outlines)
    if as_json:
        print(json_text(files.summary_of(result)))
    else:
        print_lines(*files.lines_of(result))
        if out is not None:
            say(str(out / "viewshed.png"))
    certain = [(seen.area - seen.area_bound) / seen.of_area for seen in result.seen]
    if at_least is not None and not 100 * (min(certain) + SHARE_TOLERANCE) >= at_least:
        raise typer.Exit(1)
