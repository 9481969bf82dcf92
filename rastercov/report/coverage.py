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

A run that fails keeps the earlier report; one that ends replaces all of it. `report.folder`
describes runs that are killed.
"""

import logging
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_json
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.cluster import Made, Workers
from rastercov.coverage.area.network import AreaNetwork, unit_of_result
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.criteria import face_geometry
from rastercov.coverage.engine import Engine
from rastercov.coverage.judged_poses import JudgedPoses
from rastercov.coverage.network import Network
from rastercov.coverage.pairs import CHOICES
from rastercov.coverage.provenance import Provenance
from rastercov.coverage.shards import (
    UNFINISHED,
    EvaluationShards,
    Source,
    Wanted,
    is_long,
    open_for,
    remove,
)
from rastercov.coverage.task import Task
from rastercov.kernels.stopwatch import Stopwatch
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import Rasterizer
from rastercov.report.by_camera import ByCamera
from rastercov.report.coloured_mesh import write_coloured_mesh, write_covered_mesh
from rastercov.report.coverage_table import CoverageTable, write_areas, write_rig
from rastercov.report.doubts import dead_pixels, doubts
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.half_covered import half_covered
from rastercov.report.pose_pictures import FULL, ShownRegions, draw_network, draw_poses

LOG = logging.getLogger("rastercov")
MOST_ROWS = 10_000_000
"""Rows of a table that was not asked for: about 250 MB."""
EVALUATION = ReportKind(
    "evaluate",
    re.compile(
        r"coverage\.parquet|areas\.parquet|(summary|rig)\.json|network\.glb"
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
    full: str = "none"  # full pictures of each of them, of `pose_pictures.FULL`
    skip_bad_poses: bool = False  # leave out poses that are no rigid motion
    scene: Mapping[str, Any] | None = None  # arguments of the command that give the mesh again

    def __post_init__(self) -> None:
        if self.table is not None and self.table not in CHOICES:
            raise ConfigError(f"table must be one of {', '.join(CHOICES)}, got {shown(self.table)}")
        if self.full not in FULL:
            raise ConfigError(f"full must be one of {', '.join(FULL)}, got {shown(self.full)}")
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
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task,
    out: Path,
    options: Options,
    progress: Callable[[int, int], None] = lambda done, total: None,
    workers: Workers | None = None,
    watch: Callable[[Made], None] = lambda made: None,
    note: Callable[[str], None] = LOG.warning,
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
    progress : callable
        Called with the poses done and the poses in all.
    workers : Workers, optional
        Processes that measure; this one unless given.
    watch : callable
        Called with each shard that a worker made.
    note : callable
        Called with a line on what went wrong and was mended; logs it as a warning unless given.

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
        staff = _Staff(workers, watch, note)
        return _run(folder, mesh, camera, accepted, task, options, progress, staff)


class _Staff(NamedTuple):
    """Processes that measure, and the functions that report on them."""

    workers: Workers | None
    watch: Callable[[Made], None]
    note: Callable[[str], None]


def _run(
    folder: ReportFolder,
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    task: Task,
    options: Options,
    progress: Callable[[int, int], None],
    staff: _Staff,
) -> dict[str, Any]:
    total = len(poses)
    network = Network(mesh, task)
    unit, reason = unit_of_result(options.by, task, options.engine)
    areas = AreaNetwork(mesh, task) if unit == "area" else None
    evenly = np.linspace(0, total - 1, min(options.pictures, total)).astype(int)
    cameras = cameras_of(camera)
    poses.check_cameras(len(cameras))
    rows = np.unique(evenly)
    chosen = set(poses.ids[rows].tolist())
    drawn: dict[int, NDArray[np.float64]] = {}
    if chosen and options.device not in ("auto", "cpu"):
        options.open_rasterizer(
            mesh, cameras[poses.camera[rows[0]]]
        ).close()  # a broken device fails before the work
    pairs = table_of(mesh, camera, poses) if options.table is None else options.table
    apart = ByCamera(mesh, task, camera, poses, by_area=areas is not None)
    interrupted = False
    with ExitStack() as opened:
        wanted = Wanted(
            options.engine, areas is not None, pairs, tuple(sorted(chosen)), apart.is_asked
        )
        observer = opened.enter_context(open_for(mesh, camera, task, wanted))
        shards = None
        if staff.workers is not None or is_long(total, mesh.n_faces):
            shards = EvaluationShards(folder.path / UNFINISHED, observer, poses, task, wanted)
        header = Provenance(
            mesh, camera, poses.given, task, asdict(options), observer.info
        ).as_dict()
        table = None
        if pairs != "none":
            path = folder.file("coverage.parquet")
            table = opened.enter_context(
                CoverageTable(
                    path,
                    mesh,
                    header,
                    by_area=areas is not None,
                    cameras=_cameras_of_poses(camera, poses),
                )
            )
        clock = Stopwatch()
        compiled: dict[str, float] = defaultdict(float)  # seconds of each worker

        def watch(made: Made) -> None:
            compiled[made.worker] += made.compiled_s
            staff.watch(made)

        source = Source(network, observer, poses, wanted, shards)
        try:
            parts = source.parts(progress, staff.workers, watch, staff.note)
            for batch, found in parts:
                with interrupts_held():
                    if table is not None:
                        table.add(batch.rows, None if found is None else _of_rows(batch, found))
                    network.add(batch)
                    apart.add(batch, found)
                    if areas is not None and found is not None:
                        areas.add(found)
                        # The table has the area of every pair, also of faces that need no more.
                        # Shards do not depend on one another.
                        if table is None and shards is None:
                            observer.closed = apart.closed(areas.closed)
                    drawn |= batch.kept
        except KeyboardInterrupt:
            if not network.pose_ids:
                raise
            interrupted = True
        try:
            with interrupts_held():
                opened.close()
        except KeyboardInterrupt:
            interrupted = True
        seconds = clock.seconds - max(compiled.values(), default=0.0)
    stopped, shown = False, None
    measured_poses = poses[np.isin(poses.ids, network.pose_ids)]
    if drawn:
        if areas is not None:
            shown = ShownRegions(mesh, camera, task, options.engine, measured_poses)
        stopped = draw_poses(
            mesh, camera, measured_poses, folder, options.engine, task, drawn, options.full, shown
        )
    done = len(network.pose_ids)
    summary = network.summary() | {"by": unit, "by_face_because": reason}
    halves: list[str] = []
    if areas is None:
        halves = half_covered(network, camera, measured_poses, options.method)
    else:
        areas.add_to(summary)
        with interrupts_held():
            summary |= areas.dead_zones(camera, measured_poses)
        write_areas(folder.file("areas.parquet"), mesh, areas.covered)
    if drawn and not stopped:
        stopped = draw_network(folder, network, camera, measured_poses, areas, summary, shown)
    if shown is not None:
        shown.close()
    interrupted |= stopped
    summary |= {
        "interrupted": interrupted,
        "table": {"pairs": pairs, "rows": table.n_rows if table is not None else 0},
        "quarantined": {} if shards is None else {str(k): v for k, v in shards.quarantined.items()},
        "skipped_poses": {str(row): text for row, text in poses.rejected.items()},
        "seconds": seconds,
        "poses_per_second": done / seconds if done else 0.0,
        "run": header,
        "size_m": np.ptp(mesh.bounds, axis=0).tolist(),
        "warnings": list(mesh.warnings),
        "dead_pixels": dead_pixels(camera),
        "doubts": [*doubts(network, camera, measured_poses), *halves],
        "per_pose": [
            {"pose": pose, "covered_faces": covered, "mean_coverage": mean}
            for pose, covered, mean in zip(
                network.pose_ids, network.covered_faces, network.mean_coverage, strict=True
            )
        ],
    }
    if len(cameras) > 1:
        summary |= _of_cameras(apart, measured_poses, summary["per_pose"])
    with interrupts_held():
        if areas is None:
            write_coloured_mesh(folder.file("network.glb"), mesh, network.best)
        else:
            write_covered_mesh(folder.file("network.glb"), areas.covered)
        write_rig(folder.file("rig.json"), camera, measured_poses)
        write_json(folder.file("summary.json"), summary)
        folder.publish()
        if shards is not None and not interrupted:
            remove(folder.path / UNFINISHED)
    return summary


def _cameras_of_poses(
    camera: Cameras, poses: Poses
) -> tuple[Sequence[str], NDArray[np.int32]] | None:
    """Names of several cameras, and the index of the camera of each pose of the input."""
    if len(cameras_of(camera)) == 1:
        return None
    index = np.zeros(len(poses.given), np.int32)
    index[poses.ids] = poses.camera
    return names_of(camera), index


def _of_cameras(
    apart: ByCamera, poses: Poses, per_pose: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Entries of a summary by camera, and those of each pose with the name of its camera."""
    named = [
        dict(entry) | {"camera": apart.names[index]}
        for entry, index in zip(per_pose, poses.camera.tolist(), strict=True)
    ]
    return {"by_camera": apart.summary(), "per_pose": named}


def _of_rows(batch: JudgedPoses, found: Regions) -> NDArray[np.float32]:
    """(R,) covered area of the pairs of a batch, m^2."""
    dense = np.zeros((len(found.pose_ids), found.mesh.n_faces), np.float32)
    dense[found.pair_pose, found.pair_face] = found.area
    row = np.searchsorted(found.pose_ids, batch.rows.pose)
    return dense[row, batch.rows.face]


def table_of(mesh: Mesh, camera: Cameras, poses: Poses) -> str:
    """Pairs of the table by default: "seen", but "none" above `MOST_ROWS`, with a line.

    Rows are estimated from one pose in 64, at most 16 of them, spread evenly over the run.
    """
    total = len(poses)
    if total * mesh.n_faces <= MOST_ROWS:
        return "seen"
    some = np.linspace(0, total - 1, min(16, 1 + total // 64)).astype(int)
    cameras = cameras_of(camera)
    views = (
        face_geometry(mesh, cameras[poses.camera[row]], poses.world_from_camera[row])
        for row in some
    )
    seen = [np.count_nonzero(view.is_front & (view.in_view_fraction > 0)) for view in views]
    rows = round(float(np.mean(seen)) * total)
    if rows <= MOST_ROWS:
        return "seen"
    LOG.warning(
        "no coverage.parquet: it would have about %s rows; pass --table seen to write it",
        f"{rows:,}",
    )
    return "none"
