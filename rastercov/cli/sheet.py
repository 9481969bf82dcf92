"""The command `sheet`: a plan of a building with its cameras, to scale, as SVG, PDF or DXF."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from rastercov.base.errors import ConfigError
from rastercov.camera.formats.conventions import Conventions
from rastercov.cli import options
from rastercov.cli.console import out_option, progress_bar, say, warn
from rastercov.cli.inputs import SceneOptions
from rastercov.cli.view import RigOption, Sources, open_scene
from rastercov.coverage.task import Task


@options.expanded
def sheet(
    sources: Sources,
    files: SceneOptions,
    conventions: Conventions,
    task: Task,
    out: Annotated[Path, out_option("The file: .svg, .pdf or .dxf.")] = Path("plan.svg"),
    camera: options.CamerasOption = [],  # noqa: B006 - typer copies it
    poses: RigOption = None,
    camera_name: options.CameraName = None,
    paper: Annotated[str, typer.Option(help="A4, A3, A2, A1 or A0, landscape.")] = "A3",
    scale: Annotated[
        str, typer.Option(help="1:50, 1:100, ...; auto: the largest that fits the paper.")
    ] = "auto",
    floor: Annotated[
        float | None, typer.Option(help="z of the floor, m.", show_default="the lowest floor")
    ] = None,
    cut: Annotated[
        float | None,
        typer.Option(help="z at which walls are cut, m.", show_default="1.2 m above the floor"),
    ] = None,
    north: Annotated[
        float | None,
        typer.Option(min=-360, max=360, help="Direction of the north, deg from +x towards +y."),
    ] = None,
    project: Annotated[
        str | None, typer.Option(help="Title of the sheet.", show_default="name of the result")
    ] = None,
    customer: Annotated[str | None, typer.Option(help="Whom the sheet is for.")] = None,
    author: Annotated[str | None, typer.Option(help="Whom the sheet is by.")] = None,
    revision: Annotated[str | None, typer.Option(help="Revision of the sheet.")] = None,
    date: Annotated[
        str | None, typer.Option(help="Date on the sheet.", show_default="today")
    ] = None,
    lamps: options.LampsOption = None,
) -> None:
    """Draw a plan of a building with its cameras to scale: SVG, PDF or DXF.

    Example: rastercov sheet result/ --out plan.pdf --scale 1:50

    Without a result: rastercov sheet room -c khepra -p rig.json --out plan.dxf
    """
    from rastercov.coverage.evaluation import Query
    from rastercov.coverage.job import answer
    from rastercov.report import plan_sheet as report
    from rastercov.shards import Staff

    report.check_sheet_name(out)
    scene = open_scene(sources, files, conventions, task, camera, poses, camera_name)
    if lamps is not None:
        scene = scene.lit_by(lamps)
    start, mesh = scene.start, scene.mesh
    if not start.on:
        raise ConfigError("there is no camera to draw; give --poses")
    frame = report.frame_of(mesh, start.poses(), paper, scale, floor, cut)
    warn([*mesh.warnings, *scene.notes])
    asked, names = replace(start.task, views=start.most_views), [each.name for each in start.on]
    with progress_bar() as progress:
        query = Query(mesh, start.rig(), start.poses(), asked)
        found = answer(query, staff=Staff(None, progress))
    if found.interrupted:
        raise KeyboardInterrupt
    limits, own = scene.limits, scene.sheet.model_dump(exclude_none=True)
    if scene.plan is not None:
        own["plan"] = scene.plan.name
    given = {"project": project, "customer": customer, "author": author, "revision": revision,
             "date": date, "north": north}  # fmt: skip
    own |= {name: value for name, value in given.items() if value is not None}
    site = report.Site(
        scene.rooms(frame.cut), np.array(limits["boxes"], np.float64).reshape(-1, 2, 3),
        limits["keep_out"], own.pop("north", None)
    )  # fmt: skip
    text = report.plan_sheet(
        found, names, frame, {"project": scene.title} | own, site, start.needed
    )
    report.write_sheet(text, frame, out)
    say(f"{report.scale_text(frame.scale)} on {paper}; print it at 100 %")
    print(out)
