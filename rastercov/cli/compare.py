"""The commands of the laboratory: `compare`, methods or models, and `validate markers`.

The first compares them with a reference, the second predictions with a marker detector.
"""

from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from rich.console import RenderableType
from typer import Option

from rastercov.base import ByName, ConfigError, FloatArray, json_text
from rastercov.cli import options
from rastercov.cli.console import (
    SETTINGS,
    Command,
    CommandGroup,
    out_option,
    print_lines,
    size_line,
    warn,
)
from rastercov.cli.inputs import SceneOptions, read_eyes
from rastercov.cli.options import AsJson
from rastercov.cli.terminal import Console, progress_bar
from rastercov.core.camera import Camera, Conventions, Poses, unit_warnings
from rastercov.core.camera.rig import check_central
from rastercov.core.mesh import Mesh
from rastercov.report.folder import ReportFolder

COMPARED = ["certified", "sampled", "sampled@4"]


class ComparisonOptions(NamedTuple):
    """Options on what is compared and drawn."""

    method: Annotated[
        list[str],
        Option(
            help="Method to compare: certified, exact or sampled; sampled:cpu selects a device, "
            "sampled@4 takes 4 x 4 samples per pixel, sampled:cpu@4 does both. Repeatable."
        ),
    ] = COMPARED
    against: Annotated[
        str,
        Option(
            help="Reference: exact (method `exact`, floating point), polygons (polygon clipping), "
            "rational (rational arithmetic, no rounding); the last two take seconds per pose."
        ),
    ] = "exact"
    faces: Annotated[int, Option(min=0, help="Number of worst faces to draw for each method.")] = 6
    convergence: Annotated[bool, Option(help="Also measure convergence with denser sampling.")] = (
        True
    )
    models: Annotated[
        bool, Option("--models", help="Compare coverage models instead of methods.")
    ] = False


@options.expand_options
def compare(
    meshes: options.Meshes,
    poses: options.PosesOption,
    scene: SceneOptions,
    camera: options.CameraOptions,
    conventions: Conventions,
    asked: ComparisonOptions,
    out: Annotated[Path, out_option("Folder for the page.")] = Path("compare"),
    as_json: options.AsJson = False,
) -> None:
    """Compare visibility methods with a reference.

    Writes a page (compare.html) and all values (compare.json). Needs the extra `compare`.

    Example: rastercov compare part.stl -c camera.toml -p poses.json

    Without files: rastercov compare teapot -c khepra -p sphere:4 --method sampled@2
    """
    mesh = scene.read(meshes)
    eyes = read_eyes(mesh, camera, poses, conventions)
    viewed = mesh, eyes.camera(), eyes.poses.world_from_camera
    if asked.models and (asked.method != COMPARED or asked.against != "exact"):
        raise ConfigError("expected --models alone, got --method or --against; leave them out")
    if asked.models:
        check_central(eyes.cameras(), "coverage models")
    warn(*eyes.notes, *unit_warnings(*viewed[:2], Poses.of(viewed[2])), *mesh.warnings)
    if asked.models:
        _compare_models(*viewed, out, as_json)
        return
    from rastercov.reference.methods import compare as compared
    from rastercov.reference.methods import report

    with ReportFolder(out, report.COMPARISON) as folder:
        with progress_bar("comparison steps") as progress:
            how: ByName = {"worst": asked.faces, "convergence": asked.convergence}
            differences = compared(*viewed, asked.method, asked.against, **how, progress=progress)
        with progress_bar("pictures") as progress:
            path = report.write_comparison(folder, differences, *viewed, progress)
    lines = [f"scene: {size_line(mesh)}", *report.check_lines(differences.checks), str(path)]
    _print(differences, as_json, report.comparison_table(differences), lines)
    if differences.interrupted:
        warn(f"interrupted: compared {differences.poses_done} of {differences.poses} poses")
        raise KeyboardInterrupt
    if not differences.passed:
        raise typer.Exit(1)


def _compare_models(
    mesh: Mesh, camera: Camera, poses: FloatArray, out: Path, as_json: bool
) -> None:
    """Compare all coverage models, leave the page, and print a table or the JSON."""
    from rastercov.reference.models import report
    from rastercov.reference.models.report import compare_models, names_without_model

    for name, reason in names_without_model(camera).items():
        warn(f"{name} skipped: it needs a pinhole camera, because {reason}")
    with ReportFolder(out, report.MODEL_COMPARISON) as folder:
        with progress_bar() as progress:
            comparison = compare_models(mesh, camera, poses, progress=progress)
        with progress_bar("pictures") as progress:
            path = report.write_model_comparison(
                folder, comparison, mesh, camera, poses, progress=progress
            )
    lines = [f"scene: {size_line(mesh)}", *report.bivalence_lines(comparison), str(path)]
    _print(comparison, as_json, report.score_table(comparison), lines)


def _print(value: object, as_json: bool, table: RenderableType, lines: list[str]) -> None:
    """Print a comparison as JSON, or its table and lines."""
    if as_json:
        print(json_text(value))
        return
    Console().print(table)
    print_lines(*lines)


validate = typer.Typer(cls=CommandGroup, **SETTINGS)


@validate.callback()
def _group() -> None:
    """Validate the coverage model against marker detection in rendered images."""


@validate.command(cls=Command)
def markers(
    out: Annotated[Path, out_option("Folder for the page.")] = Path("markers"),
    seed: Annotated[int, Option(min=0, help="Seed of the sensor noise.")] = 2020,
    as_json: AsJson = False,
) -> None:
    """Predict which ArUco markers OpenCV detects.

    Runs the four experiments of E. S. Eissa (2020), and writes a page (markers.html) and all
    values (markers.json). Needs the extra `markers`.

    Example: rastercov validate markers --out markers/
    """
    from rastercov.reference.markers import report
    from rastercov.reference.markers.experiments import run_experiments

    with ReportFolder(out, report.VALIDATION) as folder:
        with progress_bar("experiments") as progress:
            experiments = run_experiments(seed, progress)
        path = report.write_validation(folder, experiments)
    if as_json:
        print(json_text(report.as_json(experiments)))
    else:
        for experiment in experiments:
            Console().print(report.experiment_table(experiment))
        print_lines(
            "5.1, det.: detection predicted by Table 5.1, by the detector requirement",
            "print, here: detected in the thesis, by OpenCV; model: verdict on 5.1",
            *report.verdict_lines(experiments),
            path,
        )
    if not report.do_all_pass(experiments):
        raise typer.Exit(1)
