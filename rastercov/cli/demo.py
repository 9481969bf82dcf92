"""The command `demo`: `evaluate` on a built-in mesh."""

from pathlib import Path
from typing import Annotated

import typer

from rastercov.camera.camera import Camera
from rastercov.cli.evaluate import run_and_print
from rastercov.cli.inputs import poses_around
from rastercov.cli.options import AsJson, Device, Out
from rastercov.coverage.task import Task
from rastercov.mesh import shapes


def demo(
    out: Out = Path("report"),
    shape: Annotated[str, typer.Option(help=f"One of {', '.join(shapes.NAMES)}.")] = "aeroplane",
    poses: Annotated[int, typer.Option(min=1, help="Poses around it.")] = 12,
    device: Device = "auto",
    as_json: AsJson = False,
) -> None:
    """Run the main job on a built-in mesh.

    [bold]Example[/]: rastercov demo --shape teapot --out report/
    """
    from rastercov.report.coverage import Options

    mesh, camera = shapes.by_name(shape), Camera.preset("icube-ns4133bu-8mm")
    matrices = poses_around(f"sphere:{poses}", mesh, camera)
    task = Task(max_incidence_deg=75)
    run_and_print(mesh, camera, matrices, task, out, Options(device=device), as_json)
