"""Report of an evaluation: measure poses batch by batch and write their figures to a folder.

coverage.parquet   every figure of every pair of pose and face in view
summary.json       figures of the network, and their provenance
network.glb        the mesh coloured by the best coverage of any camera
contact_sheet.png  the poses side by side
pose_*.png         the mesh as one camera sees it, grey by coverage
faces_*.png        the face index image of the same pose

A run that fails keeps the earlier report; one that ends replaces all of it. `report.folder`
describes runs that are killed.
"""

import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov._interrupts import interrupts_held
from rastercov._output import write_json
from rastercov.camera import Camera
from rastercov.coverage import Coverage, evaluate_batches
from rastercov.engine import Engine
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.network import Network
from rastercov.observer import open_observer
from rastercov.pose import Poses
from rastercov.provenance import Provenance
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import Rasterizer
from rastercov.report.coloured_mesh import write_coloured_mesh
from rastercov.report.coverage_table import CoverageTable
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import (
    contact_sheet,
    coverage_picture,
    coverage_pixels,
    face_index_picture,
    pose_title,
    save_picture,
)
from rastercov.task import Task

PICTURE_SIDE = 1280
"""Pictures are drawn at the camera's size, or smaller where it exceeds this many pixels."""
EVALUATION = ReportKind(
    "evaluate",
    re.compile(
        r"coverage\.parquet|summary\.json|network\.glb|contact_sheet\.png|(pose|faces)_\d+\.png"
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
    pictures: int = 12  # poses to draw, spread evenly over the run; 0 for none
    skip_bad_poses: bool = False  # leave out poses that are no rigid motion

    def __post_init__(self) -> None:
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
    evenly = np.linspace(0, total - 1, min(options.pictures, total)).astype(int)
    chosen = poses.ids[np.unique(evenly)]
    drawn: dict[int, tuple[NDArray[np.float64], str]] = {}
    if len(chosen) and options.device not in ("auto", "cpu"):
        options.open_rasterizer(mesh, camera).close()  # a broken device fails before the work
    interrupted = False
    with ExitStack() as opened:
        observer = opened.enter_context(open_observer(mesh, camera, options.engine))
        header = Provenance(
            mesh, camera, poses.given, task, asdict(options), observer.info
        ).as_dict()
        table = opened.enter_context(CoverageTable(folder.file("coverage.parquet"), header))
        started = time.perf_counter()
        batches = evaluate_batches(observer, poses, task)
        try:
            progress(0, total)
            for batch in batches:
                with interrupts_held():
                    table.add(batch)
                    network.add(batch)
                    _keep(batch, chosen, drawn)
                progress(len(network.pose_ids), total)
        except KeyboardInterrupt:
            if not network.pose_ids:
                raise
            interrupted = True
        seconds = time.perf_counter() - started
        try:
            with interrupts_held():
                opened.close()
        except KeyboardInterrupt:
            interrupted = True
    if drawn:
        interrupted |= _draw(mesh, camera, poses, folder, options, drawn)
    done = len(network.pose_ids)
    summary = network.summary() | {
        "interrupted": interrupted,
        "skipped_poses": {str(row): text for row, text in poses.rejected.items()},
        "seconds": seconds,
        "poses_per_second": done / seconds if done else 0.0,
        "run": header,
        "warnings": list(mesh.warnings),
        "per_pose": [
            {"pose": pose, "covered_faces": covered, "mean_coverage": mean}
            for pose, covered, mean in zip(
                network.pose_ids, network.covered_faces, network.mean_coverage, strict=True
            )
        ],
    }
    with interrupts_held():
        write_coloured_mesh(folder.file("network.glb"), mesh, network.best)
        write_json(folder.file("summary.json"), summary)
        folder.publish()
    return summary


def _keep(
    batch: Coverage, chosen: NDArray[np.int64], drawn: dict[int, tuple[NDArray[np.float64], str]]
) -> None:
    """Keep the coverage and the title of the poses to draw."""
    for row in np.flatnonzero(np.isin(batch.pose_ids, chosen)).tolist():
        drawn[int(batch.pose_ids[row])] = batch.coverage[row].copy(), pose_title(batch, row)


def _draw(
    mesh: Mesh,
    camera: Camera,
    poses: Poses,
    folder: ReportFolder,
    options: Options,
    drawn: dict[int, tuple[NDArray[np.float64], str]],
) -> bool:
    """Draw the chosen poses and a sheet of them; True when interrupted."""
    digits = len(str(max(drawn)))
    pictures: list[Image.Image] = []
    titles: list[str] = []
    interrupted = False
    small = camera.resized(min(1.0, PICTURE_SIDE / max(camera.width, camera.height)))
    try:
        with options.open_rasterizer(mesh, small) as rasterizer:
            for pose, (values, title) in drawn.items():
                matrix = poses.given[pose]
                buffer = rasterizer.render(poses[poses.ids == pose])
                picture = coverage_picture(buffer, values, mesh, small, matrix, title)
                pixels = coverage_pixels(buffer, values, mesh, matrix)
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
