"""Visibility matrix: coverage of each face by each candidate pose, sparse, in memory or on disk.

    poses -> `evaluate_batches` -> shards -> `VisibilityMatrix` -> `problem_of` -> `select_*`

Only pairs with coverage > 0 are kept, of faces that are scored. With `cells` the elements are cells
of the task surface, numbered like faces, and coverage is the covered share of the cell's area.
On disk a matrix is a folder:

header.json     inputs with hashes: mesh, camera, poses, task, method, version
poses.npy       (C, 4, 4) the candidates
pairs/*.parquet shards of consecutive poses, columns pose, face, coverage, covered
sha256/*.sha256 the checksum of each of these files

`pandas.read_parquet(folder / "pairs")` and `polars.read_parquet(folder / "pairs")` read the pairs.
A shard is written to a temporary file, flushed to the disk and renamed, so a killed run loses at
most its current shard; run again with the same inputs it continues from there. Such a run makes a
damaged, exchanged or deleted file again, bit for bit; where a folder is only read it is refused.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._typed import typed
from rastercov.area.cells import Cells
from rastercov.cluster import Job, Made, Workers, make_shards
from rastercov.cluster.files import DamagedError
from rastercov.cluster.quarantine import forget, quarantined
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.observer import Observer, open_observer
from rastercov.placement._arrays import BoolArray, FloatArray
from rastercov.placement.explain.candidate_visibility import CandidateBounds
from rastercov.placement.matrix_shards import (
    Batch,
    add_bounds,
    batches_of,
    gathered,
    region_observer,
    write_scene,
    write_shard,
)
from rastercov.placement.shards import (
    Note,
    claim,
    describe,
    locked,
    log_warning,
    open_shard,
    read_header,
    read_poses,
    shards_of,
)
from rastercov.pose import Poses, renumbered
from rastercov.rig import Cameras
from rastercov.task import Task

SHARD_FUNCTION = "rastercov.placement.shard_work:make"
"""Function by which workers make a shard."""


@dataclass(frozen=True, eq=False)
class VisibilityMatrix:
    """Coverage of faces by candidate poses, in compressed rows; row c is pose c.

    The faces of pose c are `face[indptr[c]:indptr[c + 1]]`, in ascending order; every other face
    has coverage 0, and so have faces of occluders.

    Attributes
    ----------
    poses : (C, 4, 4) float64
        world_from_camera of the candidates.
    n_faces, n_task_faces : int
        Faces F of the mesh, and how many of them are scored; of a matrix of cells, their number.
    task : Task
        Thresholds of coverage.
    indptr : (C + 1,) int64
        Row limits of the pairs of each pose.
    face : (N,) int32
    coverage : (N,) float32
        (3.6), more than 0; rounded such that a comparison with `task.min_coverage` gives exactly
        the covered pairs.
    header : dict
        Inputs of the matrix.
    camera : (C,) int32
        Index of the camera of each pose; 0 where there is one.
    quarantined : dict of int to str
        Poses without pairs because they kill the process that measures them, each with its end.
    """

    poses: FloatArray
    n_faces: int
    n_task_faces: int
    task: Task
    indptr: NDArray[np.int64]
    face: NDArray[np.int32]
    coverage: NDArray[np.float32]
    header: dict[str, Any] = field(default_factory=dict)
    camera: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    quarantined: dict[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.camera) != len(self.poses):
            object.__setattr__(self, "camera", np.zeros(len(self.poses), np.int32))

    @property
    def n_poses(self) -> int:
        """Number of candidates C."""
        return len(self.poses)

    @property
    def is_of_cells(self) -> bool:
        """True where the elements are cells, not faces."""
        return "cells" in self.header

    @property
    def covered(self) -> BoolArray:
        """(N,) pairs in which the pose covers the face: `Reason.COVERED`."""
        enough: BoolArray = self.coverage >= np.float64(self.task.min_coverage)
        return enough

    @property
    def mean_coverage(self) -> FloatArray:
        """(C,) mean coverage of each pose over the faces that are scored."""
        # Pose by pose, 10 us each: `reduceat` does not give 0 for a pose without pairs.
        sums = [
            float(self.coverage[start:end].sum(dtype=np.float64))
            for start, end in pairwise(self.indptr)
        ]
        return np.array(sums, np.float64) / max(1, self.n_task_faces)

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Matrix that `build_matrix` left in a folder.

        Raises
        ------
        ConfigError
            When there is none, when it is incomplete, or when one of its files is damaged.
        """
        folder = Path(folder)
        try:
            header = read_header(folder)
            if header is None:
                raise ConfigError(f"{folder}: there is no matrix in this folder")
            shards = list(shards_of(header["n_poses"], header["poses_a_shard"]))
            sizes = [_rows_in(folder, shard, header) for shard, _ in shards]
            if None in sizes:
                raise ConfigError(
                    f"{folder}: {sizes.count(None)} of {len(shards)} shards are missing; "
                    "call build_matrix with the same inputs to make them"
                )
            return cls._read(folder, header, sum(size or 0 for size in sizes))
        except DamagedError as error:
            raise ConfigError(
                f"{error}; call build_matrix with the same inputs to make it again"
            ) from None

    @classmethod
    def _read(cls, folder: Path, header: dict[str, Any], n_pairs: int) -> Self:
        """Matrix of a complete folder with `n_pairs` pairs."""
        poses = read_poses(folder, header)
        if poses is None:
            raise DamagedError(folder / "poses.npy", "it is missing")
        face, coverage = np.empty(n_pairs, np.int32), np.empty(n_pairs, np.float32)
        counts = np.zeros(len(poses), np.int64)
        done = 0
        for shard, rows in shards_of(len(poses), header["poses_a_shard"]):
            file = open_shard(folder, shard, header)
            if file is None or done + file.metadata.num_rows > n_pairs:
                raise DamagedError(folder / shard, "it changed while it was read")
            table = file.read(["pose", "face", "coverage"], use_threads=False)
            part = slice(done, done + len(table))
            face[part], coverage[part] = table["face"].to_numpy(), table["coverage"].to_numpy()
            of_pose = table["pose"].to_numpy() - rows.start
            counts[rows] = np.bincount(of_pose, minlength=rows.stop - rows.start)
            done = part.stop
        found = cls._of(poses, header, counts, face, coverage)
        return replace(found, quarantined=_quarantined(folder, header))

    @classmethod
    def _of(
        cls,
        poses: Poses,
        header: dict[str, Any],
        counts: NDArray[np.int64],
        face: NDArray[np.int32],
        coverage: NDArray[np.float32],
    ) -> Self:
        """Matrix of all pairs, from the number of pairs of each pose."""
        return cls(
            poses=poses.world_from_camera,
            camera=poses.camera,
            n_faces=header["n_faces"],
            n_task_faces=header["n_task_faces"],
            task=Task(**header["task"]),
            indptr=np.concatenate(([0], np.cumsum(counts))),
            face=face,
            coverage=coverage,
            header=header,
        )


@typed
def build_matrix(
    view: Observer | tuple[Mesh, Cameras],
    poses: ArrayLike | Poses,
    task: Task | None = None,
    folder: str | Path | None = None,
    *,
    cells: Cells | None = None,
    poses_a_shard: int | None = None,
    bounds: CandidateBounds | None = None,
    workers: Workers | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    watch: Callable[[Made], None] = lambda made: None,
    note: Note = log_warning,
) -> VisibilityMatrix:
    """Visibility matrix of the poses, measured in batches.

    Parameters
    ----------
    view : Observer or (Mesh, Camera)
        An open observer, or the arguments to open one with method "certified"; several cameras are
        a Rig or a sequence.
    poses : (C, 4, 4) array_like, or Poses
        world_from_camera of the candidates; `Poses.camera` is the camera of each.
    task : Task, optional
        Thresholds; `Task()` unless given.
    folder : path, optional
        Folder of the shards; made when it is missing. An interrupted run continues from its shards;
        a complete matrix is only read; damaged files are made again. Without a folder the matrix is
        in memory.
    cells : Cells, optional
        Elements of the matrix, in place of the faces; a pose covers a cell where it covers
        `task.min_coverage` of its area, one half. The mesh hides, and the method is certified or
        exact.
    poses_a_shard : int, optional
        Poses of each file; the number that gives `PAIRS_A_SHARD` pairs unless given.
    bounds : CandidateBounds, optional
        Takes in the poses that are measured by this process, not those of shards that are there.
    workers : Workers, optional
        Processes that make the shards, in a folder that all of them share; this one unless given.
        The bytes of the shards are the same. Poses that kill their process are left out, see
        `VisibilityMatrix.quarantined`.
    progress : callable
        Called with the poses done and the total.
    watch : callable
        Called with each shard that a worker made.
    note : callable
        Called with a line on each damaged file; logs it as a warning unless given.

    Raises
    ------
    ConfigError
        When the folder holds a matrix of other inputs, or another process is writing to it; for
        cells, also for a task with a threshold that is of a face, or method "sampled"; for workers
        without a folder, and where a worker or its scheduler fails.
    PoseError
        For a pose that is no rigid motion.
    """
    if workers is not None and folder is None:
        raise ConfigError("workers make shards in a folder; name one, or leave out workers")
    placed, task, done = renumbered(poses), task or Task(), 0

    def batches(rows: slice) -> Iterator[Batch]:
        nonlocal done
        for batch in batches_of(observer, placed[rows], task, cells, bounds):
            yield batch
            done += batch[-1]
            progress(done, len(placed))

    with ExitStack() as opened:
        observer: Observer = (
            opened.enter_context(open_observer(*view)) if isinstance(view, tuple) else view
        )
        if cells is not None:
            observer = opened.enter_context(region_observer(observer, cells, task))
        header = describe(observer, placed, task, poses_a_shard, cells)
        if folder is None:
            progress(0, len(placed))
            return VisibilityMatrix._of(placed, header, *gathered(batches(slice(None)))[:3])
        with locked(Path(folder)) as place:
            kept = claim(place, header, placed, poses_a_shard is not None, note)
            shards = list(shards_of(len(placed), kept["poses_a_shard"]))
            sizes = {shard: _rows_in(place, shard, kept, note) for shard, _ in shards}
            missing = [(shard, rows) for shard, rows in shards if sizes[shard] is None]
            done = len(placed) - sum(rows.stop - rows.start for _, rows in missing)
            progress(done, len(placed))
            if workers is not None and missing:

                def made(shard: Made) -> None:
                    nonlocal done
                    done += shard.n_poses
                    progress(done, len(placed))
                    watch(shard)

                write_scene(place, observer)
                _make_by_workers(workers, place, shards, dict(missing), made, note)
                if bounds is not None:
                    add_bounds(place, range(len(shards)), bounds)
                sizes = {shard: _rows_in(place, shard, kept) for shard, _ in shards}
                missing = []
            for shard, rows in missing:
                numbers = np.arange(rows.start, rows.stop)
                sizes[shard] = write_shard(place, shard, kept, batches(rows), numbers)
                forget(place, shards.index((shard, rows)))
            return VisibilityMatrix._read(place, kept, sum(size or 0 for size in sizes.values()))


def _make_by_workers(
    workers: Workers,
    folder: Path,
    shards: list[tuple[str, slice]],
    missing: dict[str, slice],
    made: Callable[[Made], None],
    note: Note,
) -> None:
    """Have the missing shards made by workers."""
    for shard in missing:
        (folder / shard).unlink(missing_ok=True)  # a damaged one

    def left() -> dict[int, int]:
        return {
            number: rows.stop - rows.start
            for number, (shard, rows) in enumerate(shards)
            if shard in missing and not (folder / shard).exists()
        }

    make_shards(workers, Job.of(folder, SHARD_FUNCTION), left, made, note)


def _quarantined(folder: Path, header: dict[str, Any]) -> dict[int, str]:
    """Poses of a folder that were left out, by their number in the matrix."""
    shards = list(shards_of(header["n_poses"], header["poses_a_shard"]))
    return {
        shards[number][1].start + pose: why
        for number, poses in quarantined(folder, len(shards)).items()
        for pose, why in poses.items()
    }


def _rows_in(
    folder: Path, shard: str, header: dict[str, Any], note: Note | None = None
) -> int | None:
    """Pairs in a shard, None where it is missing, or damaged and `note` is given."""
    try:
        file = open_shard(folder, shard, header)
    except DamagedError as error:
        if note is None:
            raise
        note(f"{error}; its poses are measured again")
        return None
    return None if file is None else int(file.metadata.num_rows)
