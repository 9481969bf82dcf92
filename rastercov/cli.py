"""The `rastercov` command: `demo`, `evaluate`, `render`, `doctor`.

Exit codes: 0 done, 1 a check failed, 2 bad usage or input, 130 interrupted.
"""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

import rastercov
from rastercov import shapes
from rastercov.camera import PRESETS, Camera
from rastercov.coverage import Task
from rastercov.errors import ConfigError, MeshError, PoseError, RastercovError
from rastercov.mesh import Mesh
from rastercov.pose import check_poses, read_poses, sphere_of_poses

app = typer.Typer(
    help="Which faces of a mesh does each camera see, how well, and why not.",
    no_args_is_help=True,
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
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for the report.")]
Unit = Annotated[str, typer.Option(help="Unit of the mesh files: m, mm, cm, um, in, ft.")]
Occluders = Annotated[
    list[str],
    typer.Option("--occluder", help="Mesh file, or group, that hides but is not scored."),
]
TwoSided = Annotated[
    list[str], typer.Option(help="Group that counts from either side; all for every group.")
]
DropInvalid = Annotated[bool, typer.Option(help="Drop faces that are not finite, with a warning.")]
Device = Annotated[str, typer.Option(help="auto, egl:0, surfaceless or osmesa.")]
Supersample = Annotated[int, typer.Option(help="S: S x S samples a pixel.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Pictures = Annotated[int, typer.Option(min=0, help="Poses to draw, spread over the run.")]


@app.callback(invoke_without_command=True)
def _start(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if show_version:
        print(rastercov.__version__)
        raise typer.Exit


@app.command()
def evaluate(
    meshes: Meshes,
    camera: CameraOption,
    poses: PosesOption,
    out: Out = Path("report"),
    unit: Unit = "m",
    occluder: Occluders = [],  # noqa: B006 - typer copies it
    two_sided: TwoSided = [],  # noqa: B006
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
    from rastercov.run import Options  # pyarrow and pictures load only when they are wanted

    scene = _scene(meshes, unit, occluder, two_sided, drop_invalid)
    eye = _camera(camera)
    options = Options(
        supersample=supersample, device=device, pictures=pictures, skip_bad_poses=skip_bad_poses
    )
    _run(scene, eye, _poses(poses, scene, eye), task, out, options, as_json)


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
    from rastercov.run import Options

    mesh, camera = shapes.by_name(shape), Camera.preset("icube-ns4133bu-8mm")
    matrices = _poses(f"sphere:{poses}", mesh, camera)
    task = Task(min_pixels=10, max_incidence_deg=75)
    _run(mesh, camera, matrices, task, out, Options(device=device), as_json)


@app.command()
def render(
    meshes: Meshes,
    camera: CameraOption,
    poses: PosesOption,
    pose: Annotated[int, typer.Option(min=0, help="Row of the pose file.")] = 0,
    out: Out = Path("render"),
    unit: Unit = "m",
    drop_invalid: DropInvalid = False,
    device: Device = "auto",
    as_json: AsJson = False,
) -> None:
    """Draw one pose: a picture, the face index and the depth of every pixel (PNG and NPZ).

    [bold]Example[/]: rastercov render part.stl --unit mm -c camera.toml -p poses.json --pose 3
    """
    from rastercov.pictures import (
        coverage_picture,
        depth_picture,
        face_index_picture,
        save_picture,
    )
    from rastercov.report import write_npz
    from rastercov.run import Options

    scene, eye = _scene(meshes, unit, [], [], drop_invalid), _camera(camera)
    matrices = _poses(poses, scene, eye)
    if pose >= len(matrices):
        raise PoseError(f"--pose must be 0 to {len(matrices) - 1}, got {pose}")
    with Options(device=device).open(scene, eye) as rasterizer:
        buffer = rasterizer.render(matrices[pose])
        info = rasterizer.info
    out.mkdir(parents=True, exist_ok=True)
    seen = np.unique(buffer.face[buffer.face >= 0])
    shown = np.zeros(scene.n_faces)
    shown[seen] = 1.0
    title = f"pose {pose}: {len(seen)} of {scene.n_faces} faces have a pixel"
    picture = coverage_picture(buffer, shown, scene, eye, matrices[pose], title)
    save_picture(picture, out / "picture.png")
    save_picture(face_index_picture(buffer), out / "faces.png")
    save_picture(depth_picture(buffer), out / "depth.png")
    write_npz(out / "buffers.npz", face=buffer.face, depth=buffer.depth)
    files = [str(out / name) for name in ("picture.png", "faces.png", "depth.png", "buffers.npz")]
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
def doctor(as_json: AsJson = False) -> None:
    """List graphics devices, test each, and say what to install.

    [bold]Example[/]: rastercov doctor --json
    """
    from rastercov.doctor import examine, exit_code, print_report

    report = examine()
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        print_report(report, Console())
    raise typer.Exit(exit_code(report))


def main() -> None:
    """Run the command; every error of ours is one line on standard error and exit code 2."""
    try:
        app()
    except RastercovError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        print(f"error: cannot use{where}: {error.strerror or error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)


def _run(
    mesh: Mesh,
    camera: Camera,
    poses: np.ndarray[Any, np.dtype[np.float64]],
    task: Task,
    out: Path,
    options: Any,
    as_json: bool,
) -> None:
    from rastercov.report import run_table, summary_table
    from rastercov.run import run

    faults = check_poses(poses)[1]
    if faults and not options.skip_bad_poses:
        row, text = min(faults.items())
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise PoseError(f"pose {row} {text}{more}; correct it or pass --skip-bad-poses")
    for line in (*mesh.warnings, *(f"pose {row} left out: it {t}" for row, t in faults.items())):
        print(f"warning: {line}", file=sys.stderr)
    with _progress() as progress:
        summary = run(mesh, camera, poses, task, out, options, progress)
    if as_json:
        print((out / "summary.json").read_text(encoding="utf-8"), end="")
    else:
        console = Console()
        console.print(summary_table(summary))
        console.print(run_table(summary))
        sheet = out / (
            "contact_sheet.png" if (out / "contact_sheet.png").exists() else "network.glb"
        )
        console.print(f"{sheet}", soft_wrap=True, highlight=False)
    if summary["interrupted"]:
        done = summary["poses"]
        print(f"interrupted: the report holds the {done} poses that were done", file=sys.stderr)
        raise typer.Exit(130)


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """Progress bar on a terminal, nothing elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    columns = (TextColumn("poses"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("poses", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _scene(
    meshes: list[Path],
    unit: str,
    occluders: list[str],
    two_sided: list[str],
    drop_invalid: bool,
) -> Mesh:
    """Scene of the named files; an occluder may be a further file or a group of these."""
    files = [name for name in occluders if Path(name).suffix]
    hiding = [name for name in occluders if name not in files]
    if len(meshes) == 1 and str(meshes[0]) in shapes.NAMES and not meshes[0].exists():
        mesh = shapes.by_name(str(meshes[0]))
        if unit != "m" or files:
            raise ConfigError(f"--unit and occluder files go with mesh files, not {meshes[0]}")
    else:
        mesh = Mesh.load([*meshes, *files], _unit(unit), drop_invalid=drop_invalid)
        n_faces = sum(source.n_faces for source in mesh.sources[: len(meshes)])
        hiding += [mesh.groups[index].name for index in np.unique(mesh.face_group[n_faces:])]
    mesh = mesh.with_groups(hiding, "all" if "all" in two_sided else two_sided)
    if not mesh.task_mask.any():
        raise MeshError("every group is an occluder; leave at least one to be covered")
    return mesh


def _unit(unit: str) -> str | float:
    try:
        return float(unit)
    except ValueError:
        return unit


def _camera(name: str) -> Camera:
    return Camera.preset(name) if name in PRESETS else Camera.load(name)


def _poses(source: str, mesh: Mesh, camera: Camera) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Poses of a file, or sphere:N around the mesh at the distance where it fills the image."""
    if not source.startswith("sphere:"):
        return read_poses(source)
    count = source.removeprefix("sphere:")
    if not count.isdigit() or int(count) < 1:
        raise PoseError(f"--poses sphere:N wants a whole number, got {source!r}")
    centre = mesh.bounds.mean(axis=0)
    used = mesh.vertices[np.unique(mesh.faces)]
    radius = float(np.linalg.norm(used - centre, axis=1).max())
    # The sphere around the mesh touches the sides of the narrower field of view.
    narrowest = min(
        min(camera.cx, camera.width - camera.cx) / camera.fx,
        min(camera.cy, camera.height - camera.cy) / camera.fy,
    )
    if narrowest <= 0:
        raise PoseError("--poses sphere:N needs a principal point inside the image")
    return sphere_of_poses(centre, radius / np.sin(np.arctan(narrowest)), int(count))
