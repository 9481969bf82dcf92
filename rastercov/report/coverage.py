"""Report of an evaluation: measure poses batch by batch and write their figures to a folder.

coverage.parquet   every figure of the pairs of pose and face that were asked for
groups.parquet     with --table groups: visible and truncated share of each group in each image;
                   scene_gt_info.json and coco.json, for annotators
summary.json       figures of the network, and their provenance
overview.png       the mesh in the colours of the cameras, and a floor plan
zones.png          dead zones, where the result is by area and there are any
contact_sheet.png  the poses side by side
pose_*.png         the mesh as one camera sees it, by the reason of each part, if asked for
faces_*.png        the face index image of the same pose, if asked for
report.html        the results as a page for people; report.pdf on paper, if asked for
view.html          all cameras to look around in and to move, without a server

`result_files` has the others.

A run that fails keeps the earlier report; one that ends replaces all of it. `report.folder`
describes runs that are killed.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov.base import (
    ByName,
    ConfigError,
    ReadByName,
    check_choice,
    first_of,
    write_json,
    write_text,
)
from rastercov.base.interrupts import hold_interrupts
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.table import Regions
from rastercov.core.camera import (
    Cameras,
    Poses,
    cameras_of,
    gates_of,
    heads_of,
    names_of,
    names_of_poses,
)
from rastercov.core.coverage.evaluation import Evaluation, Phases, Query, lines_of, regions
from rastercov.core.coverage.job import answer, evaluate
from rastercov.core.coverage.judging import CHOICES
from rastercov.core.coverage.shards import folder_of_shards, remove
from rastercov.core.coverage.task import Engine, Reason, Task, tasks_of
from rastercov.core.coverage.visibility import GroupViews, check_groups
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer
from rastercov.report.coverage_files import INSTALL_PYARROW, has_parquet
from rastercov.report.feature import part_of
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import Key, add_frame, contact_sheet, face_index_picture, save_picture
from rastercov.report.live import Asked
from rastercov.report.modes import REPORTS
from rastercov.report.network_page import NetworkPage, pictures_in_words
from rastercov.report.overview import (
    by_faces,
    by_points,
    camera_keys,
    camera_pixels,
    camera_scene,
)
from rastercov.report.pages import image_name
from rastercov.report.panorama import FINE
from rastercov.report.printing import browser, write_page
from rastercov.report.result_files import FILES, ResultFile, files_of
from rastercov.shards import ALONE, Progress, Staff

if TYPE_CHECKING:
    from rastercov.report.parquet import CoverageTable

MOST_POSES, MOST_AREAS = 60, 1_500_000
"""Poses, or pairs of pose and face, up to which the page has the area of each pose."""
TILE = 320
"""Width of a tile of the sheet, pixels."""
PICTURE_SIDE = 1280
"""Full pictures are drawn at the camera's size, or smaller where it exceeds this many pixels."""
FULL = ("none", "poses", "faces", "all")
"""Full pictures of each pose: of its coverage, of face indices, or both."""
OF_GROUPS = "groups"
"""Table of groups and images, in place of that of pairs of pose and face."""
TABLES = ("coverage", "groups", *(name for each in REPORTS for name in each.tables))
EVALUATION = ReportKind(
    "evaluate",
    re.compile(
        "|".join(re.escape(each.name) for each in FILES) + "|"
        rf"({'|'.join(TABLES)})\.parquet|(summary|scene_gt_info|coco)\.json|view\.html"
        rf"|report\.(html|pdf)|({'|'.join(pictures_in_words())})\.png|(pose|faces)_\d+\.png"
    ),
    last="summary.json",
)


def need_parquet(option: str) -> None:
    """Raise ConfigError for an option that needs pyarrow, where there is none."""
    if not has_parquet():
        raise ConfigError(f"{option}: expected pyarrow, got no package; run: {INSTALL_PYARROW}")


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
    table: str = "none"  # of `CHOICES`, or `OF_GROUPS`; tables need pyarrow
    pictures: int = 12  # poses to draw, spread evenly over the run; 0 for none
    full: str = "none"  # full pictures of each of them, of `FULL`
    skip_bad_poses: bool = False  # leave out poses that are not rigid transforms
    pdf: bool = False  # the page on paper, too
    scene: ReadByName | None = None  # arguments of the command that give the mesh again
    sheet: Mapping[str, str] | None = None  # title block of the page
    level: int | None = None  # of the parts in its table, as of `coverage.parts.entries_at`
    names: Sequence[str] = ()  # images of the poses without fault, see `names_of_poses`
    output: Sequence[str] = ()  # words of `result_files.FILES`; the usual files if none

    def __post_init__(self) -> None:
        check_choice("table", self.table, (*CHOICES, OF_GROUPS))
        if self.table != "none":
            need_parquet(f"--table {self.table}")
        check_choice("full", self.full, FULL)
        if self.pdf and not self.pictures:
            raise ConfigError("--pdf: expected a page, got --pictures 0; leave out one")
        engine = Engine.of(self.method)
        if engine.method != self.method:
            if (self.device, self.supersample) != ("auto", 1):
                raise ConfigError(
                    f"expected device and samples in --method {engine} alone, got them twice; "
                    "leave out --device and --supersample"
                )
            for name in ("method", "device", "supersample"):
                object.__setattr__(self, name, getattr(engine, name))

    def record(self) -> ByName:
        """Options for the provenance, ready for JSON; a title block where there is one."""
        kept = {
            name: own
            for name, own in asdict(self).items()
            if own or name not in ("sheet", "output")
        }
        return {name: own for name, own in kept.items() if name not in ("level", "names", "output")}

    @property
    def engine(self) -> Engine:
        """Engine that measures visibility, and whose device draws."""
        return Engine(self.method, self.device, self.supersample)


def _open_table(
    folder: ReportFolder,
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    by_area: bool,
    header: ReadByName,
) -> "CoverageTable":
    """Table of all pairs of pose and face, in the folder of a report."""
    from rastercov.report.parquet import CoverageTable

    of_poses = np.zeros(len(poses.given), np.int32)
    of_poses[poses.ids] = poses.camera
    cameras = (names_of(camera), of_poses) if len(cameras_of(camera)) > 1 else None
    path = folder.file("coverage.parquet")
    return CoverageTable(path, mesh, header, by_area=by_area, cameras=cameras)


def run(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task,
    out: Path,
    options: Options,
    staff: Staff = ALONE,
    phases: Phases | None = None,
) -> ByName:
    """Evaluate every pose and write the report.

    An interrupt (Ctrl-C) ends the run in the current batch; the finished batches are written,
    without pictures and page, and the summary says `"interrupted": true`. A batch counts in every
    file or none; before the first is done, the interrupt is raised and nothing is written. An
    interrupt while pictures are drawn leaves out the rest of them, and the summary says the same.

    A long run, and one by workers, is kept in shards until its report is whole
    (`rastercov.core.coverage.shards`): ended in any way, it continues from there when it is run
    again.

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
    phases : Phases, optional
        Areas are over these then; figures by face and of single poses, and their pictures, are
        those at rest.

    Returns
    -------
    dict
        Content of `summary.json`.

    Raises
    ------
    PoseError
        For a pose that is not a rigid transform, unless bad poses are skipped.
    ConfigError
        For a folder that cannot be used, before the work begins.
    """
    accepted, cameras = Poses.of(poses, skip_bad=options.skip_bad_poses), cameras_of(camera)
    with ReportFolder(out, EVALUATION, is_shared=staff.part is not None) as folder:
        query = Query(mesh, camera, accepted, task, options.engine, phases, options.by)
        files = files_of(options.output, by_area=query.by_area, has_tables=options.table != "none")
        if any(each.is_table for each in files):
            need_parquet("--output")
        if options.pdf:
            browser()  # none fails before the work
        some = np.linspace(0, len(accepted) - 1, min(options.pictures, len(accepted)))
        rows = np.unique(some.astype(int))
        if len(rows) and options.device not in ("auto", "cpu"):
            first = cameras[accepted.camera[rows[0]]]
            # A broken device fails before the work.
            open_rasterizer(mesh, first, **options.engine.rasterizer_options).close()
        has_groups = options.table == OF_GROUPS
        if has_groups:
            check_groups(options.engine)
        pairs = "none" if has_groups else options.table
        table = partial(_open_table, folder, mesh, camera, accepted, query.by_area)
        is_kept = staff.workers is not None or query.is_long
        result = answer(
            query,
            pairs=pairs,
            options=options.record(),
            open_table=None if pairs == "none" else table,
            folder=folder_of_shards(folder.path) if is_kept else None,
            staff=staff,
        )
        named = dict(
            zip(accepted.ids.tolist(), names_of_poses(accepted, options.names), strict=True)
        )
        drawn = result.poses[np.isin(result.poses.ids, accepted.ids[rows])]
        groups = result.group_views() if has_groups and not result.interrupted else None
        return _write(folder, result, named, drawn, options, groups, staff, files)


def _write(
    folder: ReportFolder,
    evaluation: Evaluation,
    named: Mapping[int, str],
    drawn: Poses,
    options: Options,
    groups: GroupViews | None,
    staff: Staff,
    files: Sequence[ResultFile],
) -> ByName:
    """Write what was found with poses by their names, some drawn; content of `summary.json`.

    `staff.progress` counts dead zones, and then pictures.
    """
    camera, poses, areas = evaluation.camera, evaluation.poses, evaluation.areas
    progress = staff.progress
    names = [named[row] for row in poses.ids.tolist()]
    n = len(drawn)
    with hold_interrupts():
        if areas is not None:
            areas.dead_zones(camera, poses, None, progress)
        summary = evaluation.summary()
        if groups is not None:
            from rastercov.report.annotations import annotations
            from rastercov.report.parquet import write_columns

            table = groups.columns()
            write_columns(folder.file("groups.parquet"), table)
            rows = zip(*(np.asarray(column).tolist() for column in table.values()), strict=True)
            summary["group_views"] = [dict(zip(table, row, strict=True)) for row in rows]
            for name, content in annotations(evaluation, groups, names).items():
                write_json(folder.file(name), content)
    try:
        staff.answer(summary)
        if len(drawn) and not evaluation.interrupted:
            own = regions_of(evaluation)
            # Otherwise the page does without the area of each.
            has_all = part_of(areas) is None and (areas is None or own is not None)
            has_all = has_all and not gates_of(camera)
            some, parts = (poses, own) if has_all else (drawn, alone_of(evaluation, drawn))
            title = title_of(summary["run"])
            shown = replace(network_of(evaluation, summary, title, own, names), level=options.level)
            of_drawn = None if parts is None else parts.of_poses(np.isin(some.ids, drawn.ids))
            sheet = _draw_poses(folder, shown, drawn, of_drawn, options, named, progress)
            if listed := shown.features:
                summary["features"] = list(map(asdict, listed))
            more = shown.draw(lambda done, total: progress(n + done, n + total))
            _draw_network(folder, shown, summary, sheet, more, options)
    except KeyboardInterrupt:
        summary["interrupted"] = True
    with hold_interrupts():
        if (part := part_of(areas)) and has_parquet():
            from rastercov.report.parquet import write_columns

            for name, of_part in part.tables().items():
                write_columns(folder.file(f"{name}.parquet"), of_part)
        for each in files:
            each.write(folder.file(each.name), evaluation, names)
        write_json(folder.file("summary.json"), summary)
        folder.publish()
        if not summary["interrupted"]:
            remove(folder.path)
    return summary


def _draw_poses(
    folder: ReportFolder,
    shown: NetworkPage,
    drawn: Poses,
    parts: Regions | None,
    options: Options,
    named: Mapping[int, str],
    progress: Progress,
) -> Image.Image | None:
    """Draw some poses side by side, which is returned, and what `full` names of each.

    By area with their regions. An interrupt leaves out the rest.
    """
    mesh, cameras = shown.mesh, cameras_of(shown.camera)
    task, engine = shown.network.task, options.engine
    tasks = tasks_of(shown.camera, task)
    tiles: dict[int, tuple[Image.Image, str]] = {}
    sheet = None
    keys: dict[str, Key] = {}
    progress(0, 1 + len(drawn))
    digits = len(str(drawn.ids.max()))
    captions = {n: image_name(name, shown.noun).replace("/", ", ") for n, name in named.items()}
    captions |= zip(shown.poses.ids.tolist(), shown.captions(), strict=True)
    reasons = {} if parts is not None else _reasons(shown, drawn, engine)
    try:
        for index, rows in drawn.by_camera():
            eye = cameras[index]
            size = FINE * TILE / eye.width
            if options.full != "none":  # the sheet has these in small
                size = PICTURE_SIDE / max(eye.width, eye.height)
            camera = eye.resized(min(1.0, size))
            with open_rasterizer(mesh, camera, **engine.rasterizer_options) as view:
                for pose in drawn[rows].ids.tolist():
                    is_own = drawn.ids == pose
                    own = drawn[is_own]
                    buffer = view.render(replace(own, camera=np.zeros(1, np.int32)))
                    scene = camera_scene(mesh, camera, own.world_from_camera[0], buffer)
                    if parts is not None:
                        some = parts.of_poses(is_own)
                        image = by_points(scene, eye, tasks[index], some, (shown.camera, own))
                    else:
                        image = by_faces(scene, reasons[pose])
                    pixels = camera_pixels(image)
                    keys |= {key.name: key for key in camera_keys(image)}
                    tiles[pose] = Image.fromarray(pixels), captions[pose]
                    tiles[pose][0].thumbnail((TILE, PICTURE_SIDE), reducing_gap=1.0)
                    progress(len(tiles), 1 + len(drawn))
                    name = f"_{pose:0{digits}d}.png"
                    if options.full in ("poses", "all"):
                        title = ": ".join(captions[pose].split("\n"))
                        picture = add_frame(pixels, title, camera_keys(image))
                        save_picture(picture, folder.file("pose" + name))
                    if options.full in ("faces", "all"):
                        save_picture(face_index_picture(buffer), folder.file("faces" + name))
    finally:
        with hold_interrupts():
            if tiles:
                pictures, words = zip(*(tiles[pose] for pose in sorted(tiles)), strict=True)
                sheet = contact_sheet(pictures, words)
                sheet = add_frame(np.asarray(sheet), "", list(keys.values()))
                save_picture(sheet, folder.file("contact_sheet.png"))
    return sheet


def _reasons(shown: NetworkPage, drawn: Poses, engine: Engine) -> dict[int, NDArray[np.uint8]]:
    """(F,) reasons of faces by pose."""
    scene = shown.mesh, shown.camera, drawn, shown.network.task
    result = evaluate(*scene, by="face", method=engine, fields=("reason",))
    return dict(zip(drawn.ids.tolist(), result.reason, strict=True))


def _draw_network(
    folder: ReportFolder,
    shown: NetworkPage,
    summary: ReadByName,
    sheet: Image.Image | None,
    drawn: Mapping[str, Image.Image],
    options: Options,
) -> None:
    """Write the pages, with drawings of what all cameras cover together and what they leave."""
    images = dict(drawn) | ({} if sheet is None else {"contact_sheet": sheet})
    page = _page_of(shown, summary, images, has_view=shown.view is not None)
    with hold_interrupts():
        for name in pictures_in_words() if shown.areas is not None else ("overview",):
            if name in drawn:
                save_picture(drawn[name], folder.file(f"{name}.png"))
        if shown.view is not None:
            write_text(folder.file("view.html"), shown.view)
        write_page(folder, "report", page, pdf=options.pdf)


def html_of(evaluation: Evaluation) -> str:
    """The page of an evaluation, without the images of its poses."""
    summary = evaluation.summary()
    shown = network_of(evaluation, summary, title_of(summary["run"]), regions_of(evaluation))
    return _page_of(shown, summary, shown.draw(), has_view=None)


def regions_of(evaluation: Evaluation) -> Regions | None:
    """Parts of the faces that each pose covers, by area; None for very many poses."""
    most = max(MOST_POSES, MOST_AREAS // evaluation.mesh.n_faces)
    if evaluation.areas is None or len(evaluation.poses) > most:
        return None
    scene = evaluation.mesh, evaluation.camera, evaluation.poses, evaluation.task
    return evaluation.areas.parts(partial(regions, *scene, method=evaluation.engine))


def alone_of(evaluation: Evaluation, poses: Poses) -> Regions | None:
    """Parts of the faces that each pose covers by itself, by area, whatever the rule of its rig."""
    if evaluation.areas is None:
        return None
    with closing(
        RegionPass(evaluation.mesh, evaluation.camera, evaluation.task, method=evaluation.engine)
    ) as finder:
        return finder.find(poses)


def network_of(
    evaluation: Evaluation,
    summary: ReadByName,
    title: str = "",
    parts: Regions | None = None,
    names: Sequence[str] = (),
) -> NetworkPage:
    """Page of an evaluation by its summary, and the `parts` and names of all its poses."""
    mesh, poses, areas = evaluation.mesh, evaluation.poses, evaluation.areas
    names = names or names_of_poses(poses)
    placed = poses, names
    rows, names, noun = heads_of(evaluation.camera, poses, names)
    poses = poses[rows]
    return NetworkPage(
        title,
        mesh,
        evaluation.camera,
        poses,
        noun,
        names,
        evaluation.network,
        evaluation.network.covered,
        np.full(mesh.n_faces, evaluation.task.views),
        summary,
        areas,
        None if areas is None else areas.zones(evaluation.camera, evaluation.poses),
        parts,
        evaluation.reason == Reason.COVERED if evaluation._has("reason") else None,
        of_faces=evaluation.per_camera.of_faces,
        asked=Asked(evaluation.task, evaluation.engine.method, placed=placed),
    )


def _page_of(
    shown: NetworkPage,
    summary: ReadByName,
    images: Mapping[str, Image.Image],
    *,
    has_view: bool | None,
) -> str:
    return shown.page(
        "network.html",
        images,
        answer=shown.answer,
        lines=lines_of(summary),
        summary=summary,
        run=summary["run"],
        notes=[*summary["warnings"], *summary["result_warnings"]],
        has_view=has_view,
    )


def title_of(run: ReadByName) -> str:
    """Title with the names of the files, else of built-in meshes; "a mesh" without either."""
    names = [each["name"] for each in run["mesh"] if each["name"] != "arrays"]
    scene = (run["options"] or {}).get("scene") or {}
    return f"Coverage of {first_of(names or scene.get('meshes', ()), 3) or 'a mesh'}"
