"""Report of an evaluation: measure poses batch by batch and write their figures to a folder.

coverage.parquet   every figure of the pairs of pose and face that were asked for
areas.parquet      covered area of each face by 1 ... k cameras, where the result is by area
summary.json       figures of the network, and their provenance
network.glb        the mesh coloured by the best coverage of any camera
overview.png       the mesh in the colours of the cameras, and a floor plan
zones.png          dead zones, where the result is by area and there are any
contact_sheet.png  the poses side by side
pose_*.png         the mesh as one camera sees it, grey by coverage
faces_*.png        the face index image of the same pose

A run that fails keeps the earlier report; one that ends replaces all of it. `report.folder`
describes runs that are killed.
"""

import logging
import re
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov._checks import shown
from rastercov._interrupts import interrupts_held
from rastercov._output import write_json
from rastercov.area.network import AreaNetwork, unit_of_result
from rastercov.area.observer import RegionObservation, RegionObserver
from rastercov.area.regions import RegionPass, Regions
from rastercov.camera import Camera
from rastercov.criteria import face_geometry
from rastercov.engine import Engine
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.network import JudgedPoses, Network
from rastercov.observer import open_observer
from rastercov.pairs import CHOICES
from rastercov.pose import Poses
from rastercov.provenance import Provenance
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import Rasterizer
from rastercov.report.area_pictures import SeenArea, best_and_views
from rastercov.report.areas import write_areas
from rastercov.report.coloured_mesh import write_coloured_mesh, write_covered_mesh
from rastercov.report.coverage_table import CoverageTable
from rastercov.report.doubts import doubts
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.half_covered import half_covered
from rastercov.report.images import (
    area_title,
    contact_sheet,
    coverage_picture,
    coverage_pixels,
    face_index_picture,
    pose_title,
    save_picture,
)
from rastercov.report.overview import best_covering, camera_colours, overview_picture
from rastercov.report.placement_pictures import coverage_picture as whole_faces_picture
from rastercov.report.placement_pictures import views_picture
from rastercov.report.target_pictures import targets_in_view
from rastercov.report.zone_pictures import zones_picture
from rastercov.rig import Cameras
from rastercov.task import Task

LOG = logging.getLogger("rastercov")
MOST_ROWS = 10_000_000
"""Rows of a table that was not asked for: about 250 MB."""
MOST_COLOURS = 60
"""Cameras that have a colour each in the overview."""
PICTURE_SIDE = 1280
"""Pictures are drawn at the camera's size, or smaller where it exceeds this many pixels."""
EVALUATION = ReportKind(
    "evaluate",
    re.compile(
        r"coverage\.parquet|areas\.parquet|summary\.json|network\.glb"
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
    table: str | None = None  # of `pairs.CHOICES`; None: "seen", but none above `MOST_ROWS`
    pictures: int = 12  # poses to draw, spread evenly over the run; 0 for none
    skip_bad_poses: bool = False  # leave out poses that are no rigid motion

    def __post_init__(self) -> None:
        if self.table is not None and self.table not in CHOICES:
            raise ConfigError(f"table must be one of {', '.join(CHOICES)}, got {shown(self.table)}")
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

    def open_rasterizer(self, mesh: Mesh, camera: Camera) -> Rasterizer:
        """Rasteriser that draws pictures."""
        return open_rasterizer(mesh, camera, **self.engine.rasterizer_options)


def run(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike | Poses,
    task: Task,
    out: Path,
    options: Options,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Any]:
    """Evaluate every pose and write the report.

    An interrupt (Ctrl-C) ends the run after the current batch; the finished batches are written,
    and the summary says `"interrupted": true`. A batch counts in every file or none; before the
    first is done, the interrupt is raised and nothing is written. An interrupt while pictures are
    drawn leaves out the rest of them, and the summary says the same.

    Parameters
    ----------
    mesh, camera, poses, task
        As for `evaluate`.
    out : Path
        Folder for the report, made when it is missing; see `ReportFolder` for its content.
    options : Options
        Choices of the run.
    progress : callable
        Called with the poses done and the poses in all.

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
    accepted = Poses.of(poses, skip_bad=options.skip_bad_poses)
    with ReportFolder(out, EVALUATION) as folder:
        return _run(folder, mesh, camera, accepted, task, options, progress)


def _run(
    folder: ReportFolder,
    mesh: Mesh,
    camera: Camera,
    poses: Poses,
    task: Task,
    options: Options,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    total = len(poses)
    network = Network(mesh, task)
    unit, reason = unit_of_result(options.by, task, options.engine)
    areas = AreaNetwork(mesh, task) if unit == "area" else None
    evenly = np.linspace(0, total - 1, min(options.pictures, total)).astype(int)
    chosen = set(poses.ids[np.unique(evenly)].tolist()) if camera.is_pinhole else set()
    drawn: dict[int, NDArray[np.float64]] = {}
    if chosen and options.device not in ("auto", "cpu"):
        options.open_rasterizer(mesh, camera).close()  # a broken device fails before the work
    pairs = table_of(mesh, camera, poses) if options.table is None else options.table
    interrupted = False
    with ExitStack() as opened:
        observer = opened.enter_context(_observer(mesh, camera, task, options.engine, areas))
        header = Provenance(
            mesh, camera, poses.given, task, asdict(options), observer.info
        ).as_dict()
        table = None
        if pairs != "none":
            path = folder.file("coverage.parquet")
            table = opened.enter_context(
                CoverageTable(path, mesh, header, by_area=areas is not None)
            )
        started = time.perf_counter()
        batches = network.judge(observer, poses, pairs=pairs, keep=chosen)
        try:
            progress(0, total)
            for batch in batches:
                with interrupts_held():
                    found = None
                    if isinstance(batch.measured, RegionObservation):
                        found = batch.measured.regions
                    if table is not None:
                        table.add(batch.rows, None if found is None else _of_rows(batch, found))
                    network.add(batch)
                    if areas is not None and found is not None:
                        areas.add(found)
                        # The table has the area of every pair, also of faces that need no more.
                        if table is None:
                            observer.closed = areas.closed
                    drawn |= batch.kept
                progress(len(network.pose_ids), total)
        except KeyboardInterrupt:
            if not network.pose_ids:
                raise
            interrupted = True
        try:
            with interrupts_held():
                opened.close()
        except KeyboardInterrupt:
            interrupted = True
        seconds = time.perf_counter() - started
    stopped = False
    if drawn:
        by_area = areas is not None
        stopped = _draw(mesh, camera, poses, folder, options, task, drawn, by_area=by_area)
    done = len(network.pose_ids)
    summary = network.summary() | {"by": unit, "by_face_because": reason}
    measured_poses = poses[np.isin(poses.ids, network.pose_ids)]
    measured = measured_poses.world_from_camera
    parts: list[str] = []
    if areas is None:
        parts = half_covered(network, camera, measured, options.method)
    else:
        areas.add_to(summary)
        with interrupts_held():
            summary |= areas.dead_zones(camera, measured)
        write_areas(folder.file("areas.parquet"), mesh, areas.covered)
    if drawn and not stopped:
        stopped = _draw_network(folder, network, camera, measured_poses, areas, summary)
    interrupted |= stopped
    summary |= {
        "interrupted": interrupted,
        "table": {"pairs": pairs, "rows": table.n_rows if table is not None else 0},
        "skipped_poses": {str(row): text for row, text in poses.rejected.items()},
        "seconds": seconds,
        "poses_per_second": done / seconds if done else 0.0,
        "run": header,
        "size_m": np.ptp(mesh.bounds, axis=0).tolist(),
        "warnings": list(mesh.warnings),
        "doubts": [*doubts(network, camera, measured), *parts, *no_pictures(camera, options)],
        "per_pose": [
            {"pose": pose, "covered_faces": covered, "mean_coverage": mean}
            for pose, covered, mean in zip(
                network.pose_ids, network.covered_faces, network.mean_coverage, strict=True
            )
        ],
    }
    with interrupts_held():
        if areas is None:
            write_coloured_mesh(folder.file("network.glb"), mesh, network.best)
        else:
            write_covered_mesh(folder.file("network.glb"), areas.covered)
        write_json(folder.file("summary.json"), summary)
        folder.publish()
    return summary


def _draw_network(
    folder: ReportFolder,
    network: Network,
    camera: Camera,
    poses: Poses,
    areas: AreaNetwork | None,
    summary: dict[str, Any],
) -> bool:
    """Draw what all cameras cover together, and dead zones; True when interrupted.

    Of more than `MOST_COLOURS` cameras, it is the number of them that cover each point.
    """
    mesh, matrices = network.mesh, poses.world_from_camera
    eyes = matrices[:, :3, 3]
    try:
        if len(poses) <= MOST_COLOURS:
            found = None
            if areas is not None:
                with closing(RegionPass(mesh, camera, network.task)) as finder:
                    found = finder.find(poses)
            names = [str(row) for row in poses.ids.tolist()]
            best = best_covering(network)
            picture = overview_picture(camera_colours(mesh, matrices, best, names, found), camera)
        elif areas is not None:
            picture = views_picture(areas.covered, eyes)
        else:
            picture = whole_faces_picture(mesh, network.best, eyes)
        zones = None
        if areas is not None and len(areas.zones()):
            zones = zones_picture(areas.zones(), summary, eyes)
    except KeyboardInterrupt:
        return True
    with interrupts_held():
        save_picture(picture, folder.file("overview.png"))
        if zones is not None:
            save_picture(zones, folder.file("zones.png"))
    return False


def _of_rows(batch: JudgedPoses, found: Regions) -> NDArray[np.float32]:
    """(R,) covered area of the pairs of a batch, m^2."""
    dense = np.zeros((len(found.pose_ids), found.mesh.n_faces), np.float32)
    dense[found.pair_pose, found.pair_face] = found.area
    row = np.searchsorted(found.pose_ids, batch.rows.pose)
    return dense[row, batch.rows.face]


def no_pictures(camera: Camera, options: Options) -> list[str]:
    """Line that no poses are drawn, where they were to be and cannot; often none."""
    if camera.is_pinhole or not options.pictures:
        return []
    return [f"no pictures: reports draw through pinholes, and the lens is {camera.model}"]


def _observer(
    mesh: Mesh, camera: Cameras, task: Task, engine: Engine, areas: AreaNetwork | None
) -> Any:
    """Observer by the method, which finds regions, too, where the result is by area."""
    if areas is None:
        return open_observer(mesh, camera, engine)
    return RegionObserver(mesh, camera, task, engine)


def table_of(mesh: Mesh, camera: Camera, poses: Poses) -> str:
    """Pairs of the table by default: "seen", but "none" above `MOST_ROWS`, with a line.

    Rows are estimated from one pose in 64, at most 16 of them, spread evenly over the run.
    """
    total = len(poses)
    if total * mesh.n_faces <= MOST_ROWS:
        return "seen"
    some = np.linspace(0, total - 1, min(16, 1 + total // 64)).astype(int)
    views = (face_geometry(mesh, camera, poses.world_from_camera[row]) for row in some)
    seen = [np.count_nonzero(view.is_front & (view.in_view_fraction > 0)) for view in views]
    rows = round(float(np.mean(seen)) * total)
    if rows <= MOST_ROWS:
        return "seen"
    LOG.warning(
        "no coverage.parquet: it would have about %s rows; pass --table seen to write it",
        f"{rows:,}",
    )
    return "none"


def _draw(
    mesh: Mesh,
    camera: Camera,
    poses: Poses,
    folder: ReportFolder,
    options: Options,
    task: Task,
    drawn: dict[int, NDArray[np.float64]],
    *,
    by_area: bool,
) -> bool:
    """Draw the chosen poses and a sheet of them; True when interrupted."""
    digits = len(str(max(drawn)))
    pictures: list[Image.Image] = []
    titles: list[str] = []
    interrupted = False
    named = ("covered", "not covered") if by_area else ()
    small = camera.resized(min(1.0, PICTURE_SIDE / max(camera.width, camera.height)))
    try:
        with ExitStack() as opened:
            rasterizer = opened.enter_context(options.open_rasterizer(mesh, small))
            finder = None
            if by_area:
                finder = RegionPass(mesh, camera, task, method=options.engine)
                opened.callback(finder.close)
            for pose, values in drawn.items():
                covers = (values >= task.min_coverage) & (values > 0)
                title = pose_title(mesh, pose, covers)
                matrix = poses.given[pose]
                own = poses[poses.ids == pose]
                buffer, covered, on_targets = rasterizer.render(own), None, None
                if finder is not None:
                    regions = finder.find(own)
                    seen = SeenArea(regions, own.world_from_camera)
                    covered = best_and_views(seen, small, matrix, buffer.face)[1] > 0
                    targets = targets_in_view(mesh, small, matrix, buffer.depth)
                    if targets is not None:
                        on_targets = best_and_views(seen, small, matrix, targets)[1] > 0
                    title = area_title(mesh, pose, float(regions.area.sum()), covers)
                pixels = coverage_pixels(buffer, values, mesh, matrix, small, covered, on_targets)
                picture = coverage_picture(
                    buffer, values, mesh, small, matrix, title, pixels, named=named
                )
                faces = face_index_picture(buffer)
                with interrupts_held():
                    save_picture(picture, folder.file(f"pose_{pose:0{digits}d}.png"))
                    save_picture(faces, folder.file(f"faces_{pose:0{digits}d}.png"))
                    pictures.append(Image.fromarray(pixels))
                    titles.append(title)
    except KeyboardInterrupt:
        interrupted = True
    if pictures:
        save_picture(contact_sheet(pictures, titles), folder.file("contact_sheet.png"))
    return interrupted
