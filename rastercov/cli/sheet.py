"""The command `sheet`: a plan of a building with its cameras, to scale, as SVG, PDF or DXF."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from typer import Option

from rastercov.base import ConfigError
from rastercov.cli import options
from rastercov.cli.console import out_option, print_lines, say, warn
from rastercov.cli.inputs import SceneOptions
from rastercov.cli.terminal import progress_bar
from rastercov.cli.view import RigOption, Sources, open_scene
from rastercov.core.camera import Conventions, Rig, unit_warnings
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.shards import Progress, Staff

if TYPE_CHECKING:
    from rastercov.core.coverage.evaluation import Evaluation
    from rastercov.page.rig_state import RigState


class TitleOptions(NamedTuple):
    """Entries of the title block; those of the plan, or of the result, unless given."""

    project: Annotated[
        str | None, Option(help="Title of the sheet.", show_default="name of the result")
    ] = None
    customer: Annotated[str | None, Option(help="Customer named on the sheet.")] = None
    author: Annotated[str | None, Option(help="Author named on the sheet.")] = None
    revision: Annotated[str | None, Option(help="Revision of the sheet.")] = None
    date: Annotated[str | None, Option(help="Date on the sheet.", show_default="today")] = None


@options.expand_options
def sheet(
    sources: Sources,
    files: SceneOptions,
    conventions: Conventions,
    task: Task,
    entries: TitleOptions,
    camera: options.CameraOptions,
    equipment: options.EquipmentOptions,
    out: Annotated[Path, out_option("Output file: .svg, .pdf or .dxf.")] = Path("plan.svg"),
    poses: RigOption = None,
    paper: Annotated[str, Option(help="Paper size: A4, A3, A2, A1 or A0, landscape.")] = "A3",
    scale: Annotated[
        str, Option(help="Scale: 1:50, 1:100, ...; auto for the largest that fits.")
    ] = "auto",
    floor: Annotated[
        float | None, Option(help="Height z of the floor, m.", show_default="lowest floor")
    ] = None,
    cut: Annotated[
        float | None,
        Option(
            help="Height z of the section through the walls, m.",
            show_default="1.2 m above the floor, or at half height",
        ),
    ] = None,
    north: Annotated[
        float | None,
        Option(
            min=-360,
            max=360,
            help="Direction of north, deg from +x towards +y.",
            show_default="that of an IFC file",
        ),
    ] = None,
) -> None:
    """Draw a floor plan with cameras to scale: SVG, PDF or DXF.

    Example: rastercov sheet result/ --out plan.pdf --scale 1:50

    Without a result: rastercov sheet room -c khepra -p rig.json --out plan.dxf
    """
    from rastercov.building import plan_sheet as report
    from rastercov.page.scene import goals_of_place
    from rastercov.placement.plan.check import CheckedGoals

    report.check_sheet_name(out)
    scene = open_scene(sources, files, conventions, task, camera, poses, equipment)
    start, mesh = scene.start, scene.task_mesh or scene.mesh
    if not start.on:
        raise ConfigError("expected a camera to draw, got none; give --poses")
    title = {"project": scene.title} | scene.sheet.model_dump(exclude_none=True)
    title |= {} if north is None else {"north": north}
    turn, *_ = scene.mesh.site.known_values(
        {"north_deg": title.pop("north", None)}, "north of the sheet"
    )
    frame = report.frame_of(mesh, start.poses(), paper, scale, floor, cut)
    warn(*mesh.warnings, *scene.notes, *unit_warnings(mesh, start.rig(), start.poses()))
    if scene.plan_file:
        title["plan"] = scene.plan_file
    title |= {name: value for name, value in entries._asdict().items() if value is not None}
    own, required = scene.goals, scene.required
    if scene.result:
        own, required = goals_of_place(Path(sources[0]))
    site = report.SheetSite(
        scene.rooms(frame.cut),
        np.array(scene.limits["boxes"], np.float64).reshape(-1, 2, 3),
        scene.limits["keep_out"],
        turn,
        required,
    )
    names, rig = [each.name for each in start.on], start.rig(start.poses())
    with progress_bar(then="sheet") as progress:
        measures = _evaluate_rig(start, rig, mesh, progress)
        goals = CheckedGoals(
            [replace(each, plan=each.plan.with_cameras(each.rig_of(rig))) for each in own],
            start.poses(),
            names,
        )
        text = report.plan_sheet(measures, names, frame, title, site, start.needed, progress, goals)
        report.write_sheet(text, frame, out)
    say(f"{report.scale_text(frame.scale)} on {paper}; print it at 100 %")
    print_lines(out)


def _evaluate_rig(start: "RigState", rig: Rig, mesh: Mesh, progress: Progress) -> "Evaluation":
    """Coverage by the cameras of a scene, with their rules, as `evaluate` measures it."""
    from rastercov.core.coverage.evaluation import Query
    from rastercov.core.coverage.job import answer

    task = replace(start.task, views=start.most_views)
    result = answer(Query(mesh, rig, start.poses(), task), staff=Staff(None, progress))
    if result.interrupted:
        raise KeyboardInterrupt
    return result
