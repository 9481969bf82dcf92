"""Report of an evaluation: measure poses batch by batch and write their figures to a folder.

coverage.parquet   every figure of the pairs of pose and face that were asked for
rig.json           cameras and poses, where there are up to 5,000
areas.parquet      covered area of each face by 1 ... k cameras, where the result is by area
summary.json       figures of the network, and their provenance
network.glb        the mesh coloured by the best coverage of any camera
overview.png       the mesh in the colours of the cameras, and a floor plan
zones.png          dead zones, where the result is by area and there are any
contact_sheet.png  the poses side by side
pose_*.png         the mesh as one camera sees it, grey by coverage, if asked for
faces_*.png        the face index image of the same pose, if asked for
report.html        the results as a page for people; report.pdf on paper, if asked for
view.html          all cameras and figures to look around in, without a server

A run that fails keeps the earlier report; one that ends replaces all of it. `report.folder`
describes runs that are killed.
"""

import logging
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_json, write_text
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.cluster import ALONE, Staff
from rastercov.coverage.area.network import unit_of_result
from rastercov.coverage.area.regions import Regions, regions
from rastercov.coverage.engine import Engine
from rastercov.coverage.evaluation import Evaluation
from rastercov.coverage.job import measure
from rastercov.coverage.network import CHOICES
from rastercov.coverage.shards import UNFINISHED, Wanted, open_for, remove
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.report.camera_pictures import coverage_keys, coverage_picture, coverage_pixels
from rastercov.report.coverage_files import (
    CoverageTable,
    write_areas,
    write_coloured_mesh,
    write_covered_mesh,
    write_rig,
)
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import Key, contact_sheet, face_index_picture, framed, save_picture
from rastercov.report.network_page import NetworkPage, pictures_of
from rastercov.report.panorama import seen
from rastercov.report.printing import browser, write_page

LOG = logging.getLogger("rastercov")
MOST_POSES, MOST_AREAS = 60, 1_500_000
"""Poses, or pairs of pose and face, up to which the page has the area of each pose."""
TILE = 320
"""Width of a tile of the sheet, pixels."""
PICTURE_SIDE = 1280
"""Full pictures are drawn at the camera's size, or smaller where it exceeds this many pixels."""
FULL = ("none", "poses", "faces", "all")
"""Full pictures of each pose: of its coverage, of face indices, or both."""
MOST_PAIRS = 30_000_000
"""Pairs of pose and face up to which there is a table that was not asked for. About a third of them
are seen: 250 MB."""
EVALUATION = ReportKind(
    "evaluate",
    re.compile(
        r"(coverage|areas)\.parquet|(summary|rig)\.json|network\.glb|view\.html|report\.(html|pdf)"
        r"|(contact_sheet|overview|zones)\.png|(pose|faces)_\d+\.png"
    ),
    last="summary.json",
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Choices of a run: an `Engine`, whose device draws pictures, too, and files of the report.

    `method` may be the text form of an engine, such as "sampled:cpu@4", which then gives the device
    and the samples.
    """

    method: str = "certified"
    supersample: int = 1
    device: str = "auto"
    by: str | None = None  # unit of the result, of `area.network.UNITS`; None: area where it can be
    table: str | None = None  # of `judged_poses.CHOICES`; None: "seen", but none above `MOST_PAIRS`
    pictures: int = 12  # poses to draw, spread evenly over the run; 0 for none
    full: str = "none"  # full pictures of each of them, of `FULL`
    skip_bad_poses: bool = False  # leave out poses that are no rigid motion
    pdf: bool = False  # the page on paper, too
    scene: Mapping[str, Any] | None = None  # arguments of the command that give the mesh again

    def __post_init__(self) -> None:
        if self.table is not None:
            check_choice("table", self.table, CHOICES)
        check_choice("full", self.full, FULL)
        if self.pdf and not self.pictures:
            raise ConfigError("--pdf wants a page, got --pictures 0, which has none; leave out one")
        engine = Engine.of(self.method)
        if engine.method != self.method:
            if (self.device, self.supersample) != ("auto", 1):
                raise ConfigError(
                    f"method {engine} has its device and samples; leave out --device and "
                    "--supersample"
                )
            for name in ("method", "device", "supersample"):
                object.__setattr__(self, name, getattr(engine, name))

    @property
    def engine(self) -> Engine:
        """Engine that measures visibility, and whose device draws."""
        return Engine(self.method, self.device, self.supersample)


def run(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task,
    out: Path,
    options: Options,
    staff: Staff = ALONE,
) -> dict[str, Any]:
    """Evaluate every pose and write the report.

    An interrupt (Ctrl-C) ends the run after the current batch; the finished batches are written,
    and the summary says `"interrupted": true`. A batch counts in every file or none; before the
    first is done, the interrupt is raised and nothing is written. An interrupt while pictures are
    drawn leaves out the rest of them, and the summary says the same.

    A long run, and one by workers, is kept in shards until its report is whole
    (`rastercov.coverage.shards`): ended in any way, it continues from there when it is run again.

    Parameters
    ----------
    mesh, camera, poses, task
        As for `evaluate`.
    out : Path
        Folder for the report, made when it is missing; see `ReportFolder` for its content.
    options : Options
        Choices of the run.
    staff : Staff
        Processes that measure.

    Returns
    -------
    dict
        Content of `summary.json`.

    Raises
    ------
    PoseError
        For a pose that is no rigid motion, unless bad poses are skipped.
    ConfigError
        For a folder that cannot be used, before the work begins.
    """
    accepted, cameras = Poses.of(poses, skip_bad=options.skip_bad_poses), cameras_of(camera)
    with ReportFolder(out, EVALUATION) as folder:
        unit, reason = unit_of_result(options.by, task, options.engine)
        accepted.check_cameras(len(cameras))
        if options.pdf:
            browser()  # none fails before the work
        some = np.linspace(0, len(accepted) - 1, min(options.pictures, len(accepted)))
        rows = np.unique(some.astype(int))
        if len(rows) and options.device not in ("auto", "cpu"):
            first = cameras[accepted.camera[rows[0]]]
            # A broken device fails before the work.
            open_rasterizer(mesh, first, **options.engine.rasterizer_options).close()
        pairs = table_of(mesh, accepted) if options.table is None else options.table

        def open_table(header: Mapping[str, Any]) -> CoverageTable:
            of_poses = np.zeros(len(accepted.given), np.int32)
            of_poses[accepted.ids] = accepted.camera
            return CoverageTable(
                folder.file("coverage.parquet"), mesh, header, by_area=unit == "area",
                cameras=(names_of(camera), of_poses) if len(cameras) > 1 else None,
            )  # fmt: skip

        wanted = Wanted(options.engine, unit == "area", pairs, tuple(accepted.ids[rows].tolist()))
        with open_for(mesh, camera, task, wanted) as observer:
            found = measure(
                observer, accepted, task, wanted, reason=reason, options=asdict(options),
                folder=folder.path,
                open_table=None if pairs == "none" else open_table, staff=staff,
            )  # fmt: skip
        return _write(folder, found, options)


def _write(folder: ReportFolder, found: Evaluation, options: Options) -> dict[str, Any]:
    """Draw and write what was found; content of `summary.json`."""
    mesh, camera, poses, areas = found.mesh, found.camera, found.poses, found.areas
    with interrupts_held():
        summary = found.summary()
    try:
        if found.kept:
            some = poses
            if len(poses) > max(
                MOST_POSES, MOST_AREAS // mesh.n_faces
            ):  # the page does without the area of each
                some = poses[np.isin(poses.ids, list(found.kept))]
            parts = None
            if areas is not None:
                parts = regions(mesh, camera, some, found.task, method=found.engine)
            sheet = _draw_poses(folder, found, some, parts, options.full)
            own = parts if some is poses else None
            _draw_network(folder, found, summary, own, sheet, options)
    except KeyboardInterrupt:
        summary["interrupted"] = True
    with interrupts_held():
        if areas is None:
            write_coloured_mesh(folder.file("network.glb"), mesh, found.network.best)
        else:
            write_areas(folder.file("areas.parquet"), mesh, areas.covered)
            write_covered_mesh(folder.file("network.glb"), areas.covered)
        write_rig(folder.file("rig.json"), camera, poses)
        write_json(folder.file("summary.json"), summary)
        folder.publish()
        if found.is_kept and not summary["interrupted"]:
            remove(folder.path / UNFINISHED)
    return summary


def _draw_poses(
    folder: ReportFolder, found: Evaluation, poses: Poses, parts: Regions | None, full: str
) -> Image.Image | None:
    """Draw the poses to keep side by side, which is returned, and what `full` names of each.

    They are among some poses, by area with the regions of these. An interrupt leaves out the rest.
    """
    mesh, cameras = found.mesh, cameras_of(found.camera)
    named = () if parts is None else ("covered", "not covered")
    tiles: dict[int, tuple[Image.Image, str]] = {}
    sheet = None
    keys: dict[str, Key] = {}
    digits = len(str(max(found.kept)))
    some = poses[np.isin(poses.ids, list(found.kept))]
    try:
        for index, rows in some.by_camera():
            eye = cameras[index]
            size = TILE / eye.width
            if full != "none":  # the sheet has these in small
                size = PICTURE_SIDE / max(eye.width, eye.height)
            of_camera = f", {names_of(found.camera)[index]}" if len(cameras) > 1 else ""
            camera = eye.resized(min(1.0, size))
            with open_rasterizer(mesh, camera, **found.engine.rasterizer_options) as view:
                for pose in some[rows].ids.tolist():
                    is_own = poses.ids == pose
                    buffer = view.render(replace(poses[is_own], camera=np.zeros(1, np.int32)))
                    own = None if parts is None else parts.of_poses(is_own)
                    title = f"pose {pose}{of_camera}: covers {_covers(found, pose, own)}"
                    scene = seen(mesh, camera, poses.given[pose], buffer)
                    pixels = coverage_pixels(scene, found.kept[pose], own)
                    keys |= {key.name: key for key in coverage_keys(scene, named)}
                    tiles[pose] = Image.fromarray(pixels), title
                    tiles[pose][0].thumbnail((TILE, PICTURE_SIDE))
                    name = f"_{pose:0{digits}d}.png"
                    if full in ("poses", "all"):
                        picture = coverage_picture(
                            scene, found.kept[pose], title, pixels, named=named
                        )
                        save_picture(picture, folder.file("pose" + name))
                    if full in ("faces", "all"):
                        save_picture(face_index_picture(buffer), folder.file("faces" + name))
    finally:
        with interrupts_held():
            if tiles:
                pictures, titles = zip(*(tiles[pose] for pose in sorted(tiles)), strict=True)
                sheet = contact_sheet(list(pictures), list(titles))
                sheet = framed(np.asarray(sheet), "", list(keys.values()))
                save_picture(sheet, folder.file("contact_sheet.png"))
    return sheet


def _covers(found: Evaluation, pose: int, parts: Regions | None) -> str:
    """Words on the share of the task that a pose covers, and on whole faces."""
    mesh, values = found.mesh, found.kept[pose]
    task = mesh.task_mask
    whole = task & (values >= found.task.min_coverage) & (values > 0)
    total = max(mesh.areas[task].sum(), 1e-300)
    if parts is not None:
        return f"{100 * parts.area.sum() / total:.1f} % of the area, {whole.sum()} whole faces"
    return (
        f"{100 * whole.sum() / max(1, task.sum()):.1f} % of {task.sum()} faces, "
        f"{100 * mesh.areas[whole].sum() / total:.1f} % of area"
    )


def _draw_network(
    folder: ReportFolder,
    found: Evaluation,
    summary: Mapping[str, Any],
    parts: Regions | None,
    sheet: Image.Image | None,
    options: Options,
) -> None:
    """Draw what all cameras cover together and what they leave, and write the pages."""
    mesh, poses, network, areas = found.mesh, found.poses, found.network, found.areas
    names = [str(row) for row in poses.ids.tolist()]
    title = f"Coverage of {title_of(summary['run'], folder.path)}"
    shown = NetworkPage(
        title, mesh, found.camera, poses, "pose", names, network,
        network.covered, np.full(mesh.n_faces, found.task.views), summary, areas,
        None if areas is None else areas.zones(), parts,
    )  # fmt: skip
    drawn = shown.drawn()
    pictures = pictures_of(drawn | ({} if sheet is None else {"contact_sheet": sheet}))
    page = shown.page(
        "network.html", pictures, answer=shown.answer, lines=(), summary=summary,
        run=summary["run"], notes=[*summary["warnings"], *summary["doubts"]],
        files="summary.json and coverage.parquet", has_view=shown.view is not None,
    )  # fmt: skip
    with interrupts_held():
        for name, image in drawn.items():
            save_picture(image, folder.file(f"{name}.png"))
        if shown.view is not None:
            write_text(folder.file("view.html"), shown.view)
        write_page(folder, "report", page, pdf=options.pdf)


def title_of(run: Mapping[str, Any], path: Path) -> str:
    """Names of the files of the mesh; without any, as of a built-in one, that of the folder."""
    names = [each["name"] for each in run["mesh"] if "sha256" in each]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more or path.resolve().name


def table_of(mesh: Mesh, poses: Poses) -> str:
    """Pairs of the table by default: "seen", but "none" above `MOST_PAIRS`, with a line."""
    pairs = len(poses) * mesh.n_faces
    if pairs <= MOST_PAIRS:
        return "seen"
    LOG.warning(
        "no coverage.parquet of %s pairs of pose and face; pass --table seen to write it",
        f"{pairs:,}",
    )
    return "none"
