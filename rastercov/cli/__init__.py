"""The `rastercov` command: evaluate, render, compare, place, check, validate, demo, doctor.

Exit codes: 0 done, 1 a check failed, 2 bad usage or input, 130 interrupted. Results go to standard
output; warnings, errors and progress to standard error, an error as one line.
"""

import json
import re
import signal
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console

import rastercov
from rastercov import shapes
from rastercov.camera import PRESETS, Camera
from rastercov.cli import place as commands
from rastercov.cli import validate as markers
from rastercov.cli.console import (
    exit_code,
    leave,
    notices_shown,
    out_option,
    progress_bar,
    warn,
)
from rastercov.cli.inputs import read_camera, read_scene, read_view_points
from rastercov.coverage import Task
from rastercov.errors import ConfigError, PoseError
from rastercov.mesh import Mesh
from rastercov.pose import check_poses

MOST_WARNINGS = 5
"""Poses left out that are named one by one."""
COMPARED = ["certified", "sampled", "sampled@4"]

app = typer.Typer(
    help="Which faces of a mesh does each camera see, how well, and why not.\n\n"
    "[bold]Example[/]: rastercov demo --out report/",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)

Meshes = Annotated[
    list[Path],
    typer.Argument(
        help="Mesh files (STL, OBJ, PLY, OFF, GLB), together one scene; "
        f"or a built-in mesh: {', '.join(shapes.NAMES)}.",
        show_default=False,
    ),
]
CameraOption = Annotated[
    str,
    typer.Option(
        "--camera", "-c", help=f"Camera file (.toml, .json) or preset: {', '.join(PRESETS)}."
    ),
]
PosesOption = Annotated[
    str,
    typer.Option(
        "--poses",
        "-p",
        help="Pose file (.json, .npy), or sphere:N for N poses around the mesh that look at it "
        "from where it fills the image.",
    ),
]
Out = Annotated[Path, out_option("Folder for the report.")]
Unit = Annotated[str, typer.Option(help="Unit of the mesh files: m, mm, cm, um, in, ft.")]
Occluders = Annotated[
    list[str],
    typer.Option("--occluder", help="Mesh file, or group, that hides but is not scored."),
]
TwoSided = Annotated[
    list[str], typer.Option(help="Group that counts from either side; 'all' for every group.")
]
DropInvalid = Annotated[bool, typer.Option(help="Drop faces that are not finite, with a warning.")]
Device = Annotated[str, typer.Option(help="auto, cpu, or OpenGL: egl:0, surfaceless, osmesa.")]
Method = Annotated[
    str, typer.Option(help="How occlusion is found: certified, exact (slower) or sampled.")
]
Supersample = Annotated[int, typer.Option(help="S: S x S samples a pixel, for --method sampled.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Pictures = Annotated[int, typer.Option(min=0, help="Poses to draw, spread over the run.")]


@app.callback(invoke_without_command=True)
def _start(
    context: typer.Context,
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if show_version:
        print(rastercov.__version__)
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(2)


@app.command()
def evaluate(
    meshes: Meshes,
    camera: CameraOption,
    poses: PosesOption,
    out: Out = Path("report"),
    unit: Unit = "m",
    occluder: Occluders = [],  # noqa: B006 - typer copies it
    two_sided: TwoSided = [],  # noqa: B006 - the same
    drop_invalid: DropInvalid = False,
    min_pixels: Annotated[float, typer.Option(help="R_min: pixels for full resolution.")] = 1.0,
    min_visibility: Annotated[
        float, typer.Option(help="V_min: less visible counts as hidden.")
    ] = 0.0,
    max_blur: Annotated[
        float | None, typer.Option(help="Largest blur circle, px; the camera's unless given.")
    ] = None,
    max_incidence_deg: Annotated[float, typer.Option(help="Flattest angle of view.")] = 90.0,
    min_pixel_density: Annotated[float, typer.Option(help="Least px per metre.")] = 0.0,
    min_coverage: Annotated[float, typer.Option(help="Coverage that counts as covered.")] = 0.5,
    views: Annotated[int, typer.Option(help="Cameras that must cover a face.")] = 1,
    thesis: Annotated[
        bool, typer.Option("--thesis", help="(3.6) to the letter; any coverage counts.")
    ] = False,
    skip_bad_poses: Annotated[
        bool, typer.Option("--skip-bad-poses", help="Leave out poses that are no rigid motion.")
    ] = False,
    pictures: Pictures = 12,
    method: Method = "certified",
    supersample: Supersample = 1,
    device: Device = "auto",
    as_json: AsJson = False,
) -> None:
    """Evaluate every pose and leave a report: a table, figures, pictures, a coloured mesh.

    [bold]Example[/]: rastercov evaluate part.stl --unit mm -c camera.toml -p poses.json -o report/

    [bold]Without files[/]: rastercov evaluate teapot -c khepra -p sphere:40 -o report/
    """
    thresholds: dict[str, Any] = {
        "min_pixels": min_pixels,
        "min_visibility": min_visibility,
        "max_blur": max_blur,
        "max_incidence_deg": max_incidence_deg,
        "min_pixel_density": min_pixel_density,
        "views": views,
    }
    task = Task.thesis(**thresholds) if thesis else Task(**thresholds, min_coverage=min_coverage)
    from rastercov.report.coverage import (
        Options,  # pyarrow and pictures load only when they are wanted
    )

    scene = read_scene(meshes, unit, occluder, two_sided, drop_invalid)
    eye = read_camera(camera)
    options = Options(
        method=method,
        supersample=supersample,
        device=device,
        pictures=pictures,
        skip_bad_poses=skip_bad_poses,
    )
    _run(scene, eye, read_view_points(poses, scene, eye), task, out, options, as_json)


@app.command()
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
    matrices = read_view_points(f"sphere:{poses}", mesh, camera)
    task = Task(min_pixels=10, max_incidence_deg=75)
    _run(mesh, camera, matrices, task, out, Options(device=device), as_json)


@app.command()
def render(
    meshes: Meshes,
    camera: CameraOption,
    poses: PosesOption,
    pose: Annotated[int, typer.Option(min=0, help="Row of the pose file.")] = 0,
    out: Annotated[Path, out_option("Folder for the files.")] = Path("render"),
    unit: Unit = "m",
    drop_invalid: DropInvalid = False,
    device: Device = "auto",
    as_json: AsJson = False,
) -> None:
    """Draw one pose: a picture, the face index and the depth of every pixel (PNG and NPZ).

    [bold]Example[/]: rastercov render part.stl --unit mm -c camera.toml -p poses.json --pose 3
    """
    from rastercov._output import write_npz
    from rastercov.report.coverage import Options
    from rastercov.report.folder import ReportFolder, ReportKind
    from rastercov.report.images import (
        coverage_picture,
        depth_picture,
        face_index_picture,
        save_picture,
    )

    scene, eye = read_scene(meshes, unit, [], [], drop_invalid), read_camera(camera)
    matrices = read_view_points(poses, scene, eye)
    if pose >= len(matrices):
        raise PoseError(f"--pose {pose} is not there: {poses} has {len(matrices)} poses, from 0")
    warn(scene.warnings)
    names = ("picture.png", "faces.png", "depth.png", "buffers.npz")
    files_of_it = re.compile("|".join(map(re.escape, names)))
    with ReportFolder(out, ReportKind("render", files_of_it, last=names[-1])) as folder:
        with Options(device=device).open_rasterizer(scene, eye) as rasterizer:
            buffer = rasterizer.render(matrices[pose])
            info = rasterizer.info
        seen = np.unique(buffer.face[buffer.face >= 0])
        shown = np.zeros(scene.n_faces)
        shown[seen] = 1.0
        title = f"pose {pose}: {len(seen)} of {scene.n_faces} faces have a pixel"
        picture = coverage_picture(buffer, shown, scene, eye, matrices[pose], title)
        save_picture(picture, folder.file("picture.png"))
        save_picture(face_index_picture(buffer), folder.file("faces.png"))
        save_picture(depth_picture(buffer), folder.file("depth.png"))
        write_npz(folder.file("buffers.npz"), face=buffer.face, depth=buffer.depth)
        folder.publish()
    files = [str(out / name) for name in names]
    result = {
        "pose": pose,
        "faces": scene.n_faces,
        "faces_with_a_pixel": len(seen),
        "pixels_covered": int((buffer.face >= 0).sum()),
        "renderer": info.renderer,
        "files": files,
    }
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        print(f"{title} ({info.renderer})")
        print("\n".join(files))


@app.command()
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


commands.register(app)
markers.register(app)


@app.command()
def doctor(as_json: AsJson = False) -> None:
    """List graphics devices, test each, and say what to install.

    [bold]Example[/]: rastercov doctor --json
    """
    from rastercov.cli import doctor as graphics

    report = graphics.examine()
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        graphics.print_report(report, Console())
    raise typer.Exit(graphics.exit_code(report))


def main() -> None:
    """Run the command as a process of its own."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` ends it without a word
    # As Ctrl-C: what is done is kept.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # Names of files may hold what the terminal cannot show.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    leave(command(sys.argv[1:]))


def command(arguments: Sequence[str]) -> int:
    """Exit code of the command; see `console.exit_code`."""
    with notices_shown():
        return exit_code(app, arguments)


def _run(
    mesh: Mesh,
    camera: Camera,
    poses: NDArray[np.float64],
    task: Task,
    out: Path,
    options: Any,
    as_json: bool,
) -> None:
    from rastercov._output import json_text
    from rastercov.report.coverage import run
    from rastercov.report.tables import run_table, summary_table

    faults = check_poses(poses)[1]
    if faults and not options.skip_bad_poses:
        row, text = min(faults.items())
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise PoseError(f"pose {row} {text}{more}; correct it or pass --skip-bad-poses")
    warn(mesh.warnings)
    skipped = sorted(faults.items())
    warn(f"pose {row} left out: it {text}" for row, text in skipped[:MOST_WARNINGS])
    if skipped[MOST_WARNINGS:]:
        warn([f"{len(skipped) - MOST_WARNINGS} more poses left out, see summary.json"])
    if len(faults) == len(poses):
        warn(["there are no poses, so nothing is covered"])
    with progress_bar() as progress:
        summary = run(mesh, camera, poses, task, out, options, progress)
    if any(summary["visibility_figures"].values()) and summary["largest_image_pixels"] < 1:
        across = float(np.ptp(mesh.bounds, axis=0).max())
        warn([f"less than a pixel in every image: {across:.2g} m across; see --unit"])
    if as_json:
        print(json_text(summary))
    else:
        console = Console()
        console.print(summary_table(summary))
        console.print(run_table(summary))
        sheet = out / "contact_sheet.png"
        print(sheet if sheet.exists() else out / "network.glb")
    if summary["interrupted"]:
        done, total = summary["poses"], len(poses) - len(faults)
        if done < total:
            warn([f"the report holds the {done} of {total} poses that were done"])
        else:
            warn([f"the report holds all {total} poses; pictures may be missing"])
        raise KeyboardInterrupt
