"""The command `compare`: methods, or coverage models, against a reference."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from rastercov.cli.console import out_option, progress_bar, warn
from rastercov.cli.inputs import read_camera, read_scene, read_view_points
from rastercov.cli.options import (
    AsJson,
    CameraOption,
    DropInvalid,
    Meshes,
    PosesOption,
    TwoSided,
    Unit,
)
from rastercov.errors import ConfigError

COMPARED = ["certified", "sampled", "sampled@4"]


def compare(
    meshes: Meshes,
    camera: CameraOption,
    poses: PosesOption,
    method: Annotated[
        list[str],
        typer.Option(
            help="What to compare: certified, exact, sampled; sampled:cpu or another device, "
            "sampled@4 for 4 x 4 samples a pixel, sampled:cpu@4 for both. Repeat it for more."
        ),
    ] = COMPARED,
    against: Annotated[
        str,
        typer.Option(help="The truth: exact, or polygons or rational, which take seconds a pose."),
    ] = "exact",
    out: Annotated[Path, out_option("Folder for the page.")] = Path("compare"),
    unit: Unit = "m",
    two_sided: TwoSided = [],  # noqa: B006 - the same
    drop_invalid: DropInvalid = False,
    faces: Annotated[int, typer.Option(min=0, help="Worst faces to draw for each method.")] = 6,
    convergence: Annotated[
        bool, typer.Option(help="Measure how errors fall with denser samples, too.")
    ] = True,
    models: Annotated[
        bool, typer.Option("--models", help="Compare coverage models instead of methods.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Compare ways to find visibility with the truth; 1 when a bound does not hold.

    It leaves a page for people (compare.html) and all figures (compare.json).

    [bold]Example[/]: rastercov compare part.stl -c camera.toml -p poses.json

    [bold]Without files[/]: rastercov compare teapot -c khepra -p sphere:4 --method sampled@2
    """
    from rastercov._output import json_text
    from rastercov.report.folder import ReportFolder
    from rastercov.report.methods import (
        COMPARISON,
        check_lines,
        comparison_table,
        write_comparison,
    )
    from rastercov.validation.methods import compare as compared

    scene, eye = read_scene(meshes, unit, [], two_sided, drop_invalid), read_camera(camera)
    matrices = read_view_points(poses, scene, eye)
    if models:
        from rastercov.cli.compare_models import run_models

        if method != COMPARED or against != "exact":
            raise ConfigError("--models takes neither --method nor --against; leave them out")
        run_models(scene, eye, matrices, out, as_json)
        return
    warn(scene.warnings)
    with ReportFolder(out, COMPARISON) as folder:
        with progress_bar() as progress:
            found = compared(
                scene,
                eye,
                matrices,
                method,
                against,
                worst=faces,
                convergence=convergence,
                progress=progress,
            )
        with progress_bar() as progress:
            path = write_comparison(folder, found, scene, eye, matrices, progress)
    if as_json:
        print(json_text(found))
    else:
        Console().print(comparison_table(found))
        print("\n".join(check_lines(found.checks)))
        print(path)
    if found.interrupted:
        done = found.poses_done
        warn([f"it covers the {done} of {found.poses} poses that were done"])
        raise KeyboardInterrupt
    if not found.passed:
        raise typer.Exit(1)
