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
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_json
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.area.network import unit_of_result
from rastercov.coverage.engine import Engine
from rastercov.coverage.evaluation import Evaluation
from rastercov.coverage.face_pass import faces_in_view
from rastercov.coverage.job import ALONE, Staff, measure
from rastercov.coverage.network import CHOICES
from rastercov.coverage.shards import UNFINISHED, Wanted, open_for, remove
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import Rasterizer
from rastercov.report.coloured_mesh import write_coloured_mesh, write_covered_mesh
from rastercov.report.coverage_table import CoverageTable, write_areas, write_rig
from rastercov.report.folder import ReportFolder, ReportKind
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
    table: str | None = None  # of `judged_poses.CHOICES`; None: "seen", but none above `MOST_ROWS`
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
        rows = np.unique(
            np.linspace(0, len(accepted) - 1, min(options.pictures, len(accepted))).astype(int)
        )
        if len(rows) and options.device not in ("auto", "cpu"):
            options.open_rasterizer(
                mesh, cameras[accepted.camera[rows[0]]]
            ).close()  # a broken device fails before the work
        pairs = table_of(mesh, camera, accepted) if options.table is None else options.table

        def open_table(header: Mapping[str, Any]) -> CoverageTable:
            of_poses = _cameras_of_poses(camera, accepted)
            path, by_area = folder.file("coverage.parquet"), unit == "area"
            return CoverageTable(path, mesh, header, by_area=by_area, cameras=of_poses)

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
    stopped, shown = False, None
    if found.kept:
        if areas is not None:
            shown = ShownRegions(mesh, camera, found.task, found.engine, poses)
        stopped = draw_poses(
            mesh, camera, poses, folder, found.engine, found.task, dict(found.kept), options.full,
            shown,
        )  # fmt: skip
    with interrupts_held():
        summary = found.summary()
    if found.kept and not stopped:
        stopped = draw_network(folder, found.network, camera, poses, areas, summary, shown)
    if shown is not None:
        shown.close()
    summary["interrupted"] |= stopped
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


def _cameras_of_poses(
    camera: Cameras, poses: Poses
) -> tuple[Sequence[str], NDArray[np.int32]] | None:
    """Names of several cameras, and the index of the camera of each pose of the input."""
    if len(cameras_of(camera)) == 1:
        return None
    index = np.zeros(len(poses.given), np.int32)
    index[poses.ids] = poses.camera
    return names_of(camera), index


def table_of(mesh: Mesh, camera: Cameras, poses: Poses) -> str:
    """Pairs of the table by default: "seen", but "none" above `MOST_ROWS`, with a line.

    Rows are estimated from one pose in 64, at most 16 of them, spread evenly over the run.
    """
    total = len(poses)
    if total * mesh.n_faces <= MOST_ROWS:
        return "seen"
    some = np.linspace(0, total - 1, min(16, 1 + total // 64)).astype(int)
    seen = faces_in_view(mesh, camera, poses[some])
    rows = round(np.count_nonzero(seen) / len(some) * total)
    if rows <= MOST_ROWS:
        return "seen"
    LOG.warning(
        "no coverage.parquet: it would have about %s rows; pass --table seen to write it",
        f"{rows:,}",
    )
    return "none"
