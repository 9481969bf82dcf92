"""The commands `evaluate`, coverage of every pose and a report, `demo` and `render`.

`demo` is the same on a built-in mesh; `render` gives a picture, the face index and the depth of one
pose.
"""

import json
import re
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from typer import Option

from rastercov.advice import before as differences
from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    PoseError,
    ReadByName,
    errors_as,
    json_text,
    plural,
)
from rastercov.base.format import percent, verb
from rastercov.base.output import write_npz
from rastercov.cli import options
from rastercov.cli.console import out_option, print_lines, report_skips, say, warn
from rastercov.cli.inputs import SceneOptions, poses_around, read_eyes, read_sheet
from rastercov.cli.terminal import Console, print_network, progress_bar
from rastercov.core.area.features import narrow
from rastercov.core.camera import Camera, Cameras, Conventions, Poses, names_of_poses, unit_warnings
from rastercov.core.camera.rig import with_equipment
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh, shapes
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.result_files import OUTPUT_HELP
from rastercov.shards import Staff, Tally, Workers

if TYPE_CHECKING:
    from rastercov.core.coverage.evaluation import Phases, Query
    from rastercov.core.raster.contract import VisibilityBuffer
    from rastercov.report.coverage import Options


USUAL: list[str] = []
"""Default of --output: the usual files."""


class ReportOptions(NamedTuple):
    """Options of the unit of a result, of what measures it, and of its files."""

    by: Annotated[
        str | None,
        Option(
            help="Basis of the result: area (exact, independent of the triangulation) or face "
            "(whole faces).",
            show_default="area, unless a threshold applies to faces, --min-angle-deg is given or "
            "--method is sampled",
        ),
    ] = None
    method: Annotated[
        str,
        Option(
            help="Visibility method: certified (proves faces visible or hidden where it can, "
            "computes the rest), exact (computes every face; slower) or sampled (counts samples of "
            "whole faces)."
        ),
    ] = "certified"
    supersample: Annotated[
        int, Option(help="S for S x S samples per pixel, with --method sampled.")
    ] = 1
    device: options.Device = "auto"
    table: Annotated[
        str,
        Option(
            help="Pose-face pairs in coverage.parquet: covered, seen (front-facing and in the "
            "image, occluded or not) or all, and by area areas.parquet, with figures of faces; "
            "none writes neither; groups writes groups.parquet instead of pairs: visible and "
            "truncated shares of each group's silhouette per image.",
        ),
    ] = "none"
    pictures: Annotated[
        int,
        Option(min=0, help="Number of poses on the contact sheet; 0 for no PNG or HTML files."),
    ] = 12
    full: Annotated[
        str,
        Option(
            help="Full-size pictures per pose: poses (coverage), faces (face indices), all or none."
        ),
    ] = "none"
    pdf: options.Pdf = False
    level: options.Level = None
    output: Annotated[list[str], Option(help=OUTPUT_HELP, metavar="FILE")] = USUAL


BITS = "Folder for the covered pairs by face, a bit each, in place of a report."
BEFORE = "Earlier poses to compare with; prints the area and regions lost and gained."


@options.expand_options
def evaluate(
    meshes: options.Meshes,
    poses: options.PosesOption,
    scene: SceneOptions,
    files: options.SceneFiles,
    conventions: Conventions,
    task: Task,
    report: ReportOptions,
    processes: options.ProcessOptions,
    camera: options.CameraOptions,
    equipment: options.EquipmentOptions,
    out: options.Out = Path("report"),
    before: Annotated[str | None, Option(help=BEFORE, metavar="POSES")] = None,
    bits: Annotated[Path | None, Option("--bits", help=BITS, metavar="FOLDER")] = None,
    sheet: options.Sheet = None,
    as_json: options.AsJson = False,
) -> None:
    """Evaluate the coverage of a mesh by camera poses, and write a report.

    Example: rastercov evaluate part.stl --unit mm -c camera.toml -p poses.json -o report/

    Two cameras: rastercov evaluate part.stl -c left=l.yaml -c right=r.yaml -p poses.json

    Without files: rastercov evaluate teapot -c khepra -p sphere:40 -o report/
    """
    from rastercov.core.coverage.evaluation import Query
    from rastercov.report.coverage import Options

    workers, mesh = processes.open(), scene.read(meshes)
    eyes = read_eyes(mesh, camera, poses, conventions, several=True)
    warn(*eyes.notes)
    kept = scene.entries(out, meshes, **files, **equipment)
    skips = conventions.skip_bad_poses
    settings = Options(
        **report._asdict(),
        skip_bad_poses=skips,
        scene=kept,
        sheet=read_sheet(sheet),
        names=eyes.images,
    )
    assert eyes.rig is not None
    rig = with_equipment(eyes.rig, equipment, mesh)
    task = narrow(rig, task)
    phases = files.phases(mesh, report.method)
    if bits is not None:
        unused = report._replace(method="", supersample=1, device="", level=None)
        if any((unused != ReportOptions(method="", device=""), before, phases)):
            raise ConfigError(
                "expected --bits with --method, --supersample and --device alone, got options of "
                "a report; leave them out"
            )
        query = Query(mesh, rig, eyes.poses, task, settings.engine, by="face")
        _print_bits(query, bits, settings, workers, as_json=as_json)
        return
    find_losses: Callable[[], ByName] | None = None
    if before is not None:
        if phases is not None or report.by == "face":
            got = "--by face" if phases is None else "a moving scene"
            raise ConfigError(
                f"expected a static scene and --by area with --before, got {got}; leave one out"
            )
        earlier = read_eyes(mesh, camera, before, conventions, several=True)
        assert earlier.rig is not None
        rigs = (rig, eyes.poses), (with_equipment(earlier.rig, equipment, mesh), earlier.poses)
        with errors_as(ConfigError, "--before"):
            differences.check(*rigs, task)

        def find_losses() -> ByName:
            with progress_bar("comparison") as progress:
                return {"poses": before, **differences.compare(mesh, *rigs, task, progress)}

    run_and_print(
        (mesh if phases is None else phases.mesh, rig, eyes.poses),
        task,
        out,
        settings,
        as_json,
        find_losses,
        workers,
        None if phases is None else phases.asked,
    )


def _print_bits(
    query: "Query", folder: Path, settings: "Options", workers: Workers | None, *, as_json: bool
) -> None:
    """Write the bits of all poses, and print their figures or the JSON."""
    from rastercov.report.bits import write_bits

    warn(*query.mesh.warnings)
    with progress_bar() as progress:
        staff = Staff(workers, progress, note=warn)
        summary = write_bits(query, folder, settings.record(), staff)
    if as_json:
        print(json_text(summary))
        return
    share = percent(summary["covered"]["area_percent"] / 100)
    print_lines(
        f"covered: {share} of the area, in whole faces, by {plural(summary['poses'], 'pose')}",
        f"measured by {summary['run']['measured_by']['renderer']}",
        str(folder),
    )


def run_and_print(
    scene: tuple[Mesh, Cameras, FloatArray | Poses],
    task: Task,
    out: Path,
    settings: "Options",
    as_json: bool,
    lost: Callable[[], ByName] | None = None,
    workers: Workers | None = None,
    phases: "Phases | None" = None,
) -> None:
    """Evaluate all poses, leave the report, and print a summary or the JSON.

    `lost` gives differences from other poses, as of `before.compare`.
    """
    from rastercov.advice.headline import first_lines
    from rastercov.report.coverage import run

    mesh, camera, poses = scene
    accepted, tally = Poses.of(poses), Tally()
    warn(*mesh.warnings)
    if not len(accepted):
        warn("no poses, so nothing is covered")
    with ExitStack() as stack:
        bars = [stack.enter_context(progress_bar(then="report"))]

        def answer(summary: ReadByName) -> None:
            """Print the answer, over no bar."""
            stack.close()
            warn(*summary["result_warnings"])
            if not as_json:
                with suppress(OSError):  # no reader any more; the report is still written
                    print_lines(*first_lines(summary, level=settings.level))
            bars[0] = stack.enter_context(progress_bar("report"))

        staff = Staff(workers, lambda *n: bars[0](*n), tally.add, warn, answer)
        summary = run(mesh, camera, accepted, task, out, settings, staff, phases)
    if lost is not None and not summary["interrupted"]:
        summary["before"] = lost()
    if as_json:
        print(json_text(summary))
    else:
        _print_rest(summary, settings.level, out)
        for line in tally.lines():
            say(line)
    if summary["interrupted"]:
        total = plural(len(accepted), "pose")
        warn(f"interrupted: the report has {summary['poses']} of {total}, and may lack pictures")
        raise KeyboardInterrupt
    report_skips(summary["quarantined"], is_accepted=settings.skip_bad_poses)


def _print_rest(summary: ByName, level: int | None, out: Path) -> None:
    """Print what follows the answer of an evaluation as lines and tables."""
    from rastercov.advice.headline import other_lines
    from rastercov.report.tables import run_table

    pages = (out / name for name in ("report.html", "network.glb", "summary.json"))
    lines = [str(next(filter(Path.exists, pages))), *other_lines(summary, level)]
    if "before" in summary:
        lines += differences.lines_of(summary["before"])
    print_lines(*lines)
    print_network(summary, level)
    Console().print(run_table(summary))


def demo(
    out: options.Out = Path("report"),
    shape: Annotated[str, Option(help=f"Built-in mesh: {', '.join(shapes.NAMES)}.")] = "aeroplane",
    poses: Annotated[int, Option(min=1, help="Number of poses around the mesh.")] = 4,
    device: options.Device = "auto",
    as_json: options.AsJson = False,
) -> None:
    """Run `evaluate` on a built-in mesh.

    With the camera icube-ns4133bu-8mm, and --max-incidence-deg 75.

    Example: rastercov demo --shape teapot --out report/
    """
    from rastercov.report.coverage import Options

    mesh, camera = shapes.by_name(shape), Camera.preset("icube-ns4133bu-8mm")
    matrices = poses_around(f"sphere:{poses}", mesh, camera)
    task = Task(max_incidence_deg=75)
    kept = SceneOptions().entries(out, [Path(shape)])
    scene, settings = (mesh, camera, matrices), Options(device=device, scene=kept)
    run_and_print(scene, task, out, settings, as_json)


RENDERED = ("picture.png", "faces.png", "depth.png", "buffers.npz")
"""Files of a pose that is drawn."""


def _save(
    folder: ReportFolder,
    mesh: Mesh,
    eye: Camera,
    pose: FloatArray,
    buffer: "VisibilityBuffer",
    title: str,
) -> None:
    """Write the files of a pose."""
    from rastercov.report import images
    from rastercov.report.panorama import draw_scene, neutral, paint, scene_keys
    from rastercov.report.theme import COVERED

    drawn = draw_scene(mesh, eye, pose, buffer)
    keys = [images.Key.of("front faces", COVERED), *scene_keys([drawn])]
    picture = images.add_frame(paint(drawn, neutral(mesh, drawn.setting)), title, keys)
    pictures = picture, images.face_index_picture(buffer), images.depth_picture(buffer)
    for name, each in zip(RENDERED, pictures, strict=False):
        images.save_picture(each, folder.file(name))
    write_npz(folder.file(RENDERED[-1]), face=buffer.face, depth=buffer.depth)


@options.expand_options
def render(
    meshes: options.Meshes,
    poses: options.PosesOption,
    scene: SceneOptions,
    conventions: Conventions,
    camera: options.CameraOptions,
    pose: Annotated[int, Option(min=0, help="Row of the pose file, from 0.")] = 0,
    out: Annotated[Path, out_option("Folder for the files.")] = Path("render"),
    device: options.Device = "auto",
    as_json: options.AsJson = False,
) -> None:
    """Render one pose: a picture, and the face index and depth of every pixel (PNG, NPZ).

    Example: rastercov render part.stl --unit mm -c camera.toml -p poses.json --pose 3
    """
    from rastercov.core.coverage.task import Engine
    from rastercov.core.raster import open_rasterizer

    mesh = scene.read(meshes)
    eyes = read_eyes(mesh, camera, poses, conventions)
    eye, matrices = eyes.camera(), eyes.poses.world_from_camera
    if pose >= len(matrices):
        raise PoseError(
            f"--pose: expected an index from 0 to {len(matrices) - 1} in {poses}, got {pose}; "
            "correct it"
        )
    files_of_it = re.compile(r"(picture|faces|depth)\.png|buffers\.npz")
    with ReportFolder(out, ReportKind("render", files_of_it, last=RENDERED[-1])) as folder:
        warn(*mesh.warnings, *eyes.notes, *unit_warnings(mesh, eye, Poses.of(matrices)))
        with open_rasterizer(mesh, eye, **Engine(device=device).rasterizer_options) as rasterizer:
            buffer = rasterizer.render(matrices[pose])
            info = rasterizer.info
            is_seen = np.isin(np.arange(mesh.n_faces), buffer.face)
            if mesh.has_targets:  # the image has none
                is_seen |= rasterizer.count(matrices[pose]).visible[0] > 0
        n_seen = int(is_seen.sum())
        name = names_of_poses(eyes.poses, eyes.images)[pose]
        title = f"{name} (--pose {pose}): {n_seen:,} of {plural(mesh.n_faces, 'face')} "
        title += f"{verb(n_seen, 'are')} visible in at least one pixel"
        _save(folder, mesh, eye, matrices[pose], buffer, title)
        folder.publish()
    files = [str(out / name) for name in RENDERED]
    result = {
        "pose": pose,
        "faces": mesh.n_faces,
        "size_m": np.ptp(mesh.bounds, axis=0).tolist(),
        "faces_with_a_pixel": n_seen,
        "pixels_covered": int((buffer.face >= 0).sum()),
        "renderer": info.renderer,
        "files": files,
    }
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        print_lines(f"{title} ({info.renderer}), {mesh.size_in_words}", *files)
