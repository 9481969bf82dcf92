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

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._observers import ExactObserver
from rastercov._typed import typed
from rastercov.area.cells import Cells
from rastercov.area.frames import check_same_mesh
from rastercov.area.observer import RegionObserver
from rastercov.coverage import Coverage, evaluate_batches, judged, measurements
from rastercov.coverage_pass import CoveragePass
from rastercov.engine import Engine
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.observer import Observer, open_observer
from rastercov.placement._arrays import BoolArray, FloatArray
from rastercov.placement.explain.candidate_visibility import FIGURES, CandidateBounds
from rastercov.placement.mounts import Mounts
from rastercov.placement.shards import (
    DamagedError,
    Note,
    claim,
    describe,
    locked,
    log_warning,
    open_shard,
    read_header,
    read_poses,
    schema_of,
    shards_of,
    store,
)
from rastercov.pose import Poses, renumbered
from rastercov.rig import Cameras
from rastercov.task import Task

Batch = tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32], BoolArray, int]
"""Row, face, coverage and covered mask of each pair of some poses; and the number of poses."""


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
    """

    poses: FloatArray
    n_faces: int
    n_task_faces: int
    task: Task
    indptr: NDArray[np.int64]
    face: NDArray[np.int32]
    coverage: NDArray[np.float32]
    header: dict[str, Any] = field(default_factory=dict)

    @property
    def n_poses(self) -> int:
        """Number of candidates C."""
        return len(self.poses)

    @property
    def camera(self) -> NDArray[np.int32]:
        """(C,) index of the camera of each pose; 0 where there is one."""
        return np.array(self.header.get("pose_camera", [0] * self.n_poses), np.int32)

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
        return cls._of(poses, header, counts, face, coverage)

    @classmethod
    def _of(
        cls,
        poses: FloatArray,
        header: dict[str, Any],
        counts: NDArray[np.int64],
        face: NDArray[np.int32],
        coverage: NDArray[np.float32],
    ) -> Self:
        """Matrix of all pairs, from the number of pairs of each pose."""
        return cls(
            poses=poses,
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
    mounts: Mounts | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
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
        Takes in the poses that are measured, not those of shards that are there; of rigs, those of
        their cameras.
    mounts : Mounts, optional
        Rigs of the cameras of the view, which `Poses.camera` counts then; a rig has the greatest
        coverage of any of its cameras.
    progress : callable
        Called with the poses done and the total.
    note : callable
        Called with a line on each damaged file; logs it as a warning unless given.

    Raises
    ------
    ConfigError
        When the folder holds a matrix of other inputs, or another process is writing to it; for
        cells, also for a task with a threshold that is of a face, or method "sampled".
    PoseError
        For a pose that is no rigid motion.
    """
    placed, task, done = renumbered(poses), task or Task(), 0

    def batches(rows: slice) -> Iterator[Batch]:
        nonlocal done
        part, owner = placed[rows], None
        if mounts is not None and mounts.has_rigs:
            n = len(part)
            part, owner = mounts.cameras(part)
        found = (
            _of_faces(observer, part, task, bounds)
            if cells is None
            else _of_cells(observer, cells, part, task, bounds)
        )
        for batch in found if owner is None else _united(found, owner, n):
            if batch[-1]:
                yield batch
                done += batch[-1]
                progress(done, len(placed))

    with ExitStack() as opened:
        observer: Observer = (
            opened.enter_context(open_observer(*view)) if isinstance(view, tuple) else view
        )
        if cells is not None:
            observer = opened.enter_context(_region_observer(observer, cells, task))
        header = describe(observer, placed, task, poses_a_shard, cells, mounts)
        matrices = placed.world_from_camera
        if folder is None:
            progress(0, len(placed))
            return VisibilityMatrix._of(matrices, header, *_gathered(batches(slice(None))))
        with locked(Path(folder)) as place:
            kept = claim(place, header, matrices, poses_a_shard is not None, note)
            shards = list(shards_of(len(matrices), kept["poses_a_shard"]))
            sizes = {shard: _rows_in(place, shard, kept, note) for shard, _ in shards}
            missing = [(shard, rows) for shard, rows in shards if sizes[shard] is None]
            done = len(matrices) - sum(rows.stop - rows.start for _, rows in missing)
            progress(done, len(matrices))
            for shard, rows in missing:
                sizes[shard] = _write_shard(place, shard, kept, batches(rows), rows.start)
            return VisibilityMatrix._read(place, kept, sum(size or 0 for size in sizes.values()))


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


def _region_observer(observer: Observer, cells: Cells, task: Task) -> RegionObserver:
    """Observer of the regions in the mesh of some cells, by the method of another one."""
    check_same_mesh(cells.mesh, observer.mesh)
    if not isinstance(observer, ExactObserver):
        raise ConfigError("cells need method certified or exact, got sampled")
    engine = Engine(observer.info.plan, threads=observer.threads)
    return RegionObserver(observer.mesh, observer.camera, task, engine)


def _gathered(
    batches: Iterable[Batch],
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """Pairs of each pose, and face and coverage of each pair."""
    counts, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
    values = [np.zeros(0, np.float32)]
    for pose, face, value, _, n_poses in batches:
        counts.append(np.bincount(pose, minlength=n_poses))
        faces.append(face)
        values.append(value)
    return np.concatenate(counts), np.concatenate(faces), np.concatenate(values)


def _of_faces(
    observer: Observer, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Batch]:
    """Pairs of poses and faces with coverage > 0."""
    figures = ("coverage", *(FIGURES if bounds is not None else ()))
    for batch in evaluate_batches(observer, poses, task, fields=figures):
        yield _pairs(batch)
        if bounds is not None and len(batch.pose_ids):
            bounds.add(batch)


def _pairs(batch: Coverage) -> Batch:
    """Pairs of a batch with coverage > 0."""
    pose, face = np.nonzero((batch.coverage > 0) & batch.mesh.task_mask)
    short, covered = shortened(batch.coverage[pose, face], batch.task.min_coverage)
    return pose, face.astype(np.int32), short, covered, len(batch.pose_ids)


def _of_cells(
    observer: Any, cells: Cells, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Batch]:
    """Pairs of poses and cells with a covered share; visibility is computed once for both."""
    judge = CoveragePass(observer, task)
    for part, seen in measurements(observer, poses):
        found = cells.share(seen.regions)  # type: ignore[union-attr] # of a RegionObserver
        pose = np.repeat(np.arange(len(part)), np.diff(found.starts))
        short, covered = shortened(found.share, task.min_coverage)
        yield pose, found.cell, short, covered, len(part)
        if bounds is not None and len(part):
            bounds.add(judged(observer, judge, task, part, seen, FIGURES))


def _united(batches: Iterable[Batch], owner: NDArray[np.int64], n: int) -> Iterator[Batch]:
    """Batches of n mounts from those of their cameras, (K,) of which `owner` is the mount."""
    waiting: list[tuple[NDArray[Any], ...]] = []
    at = done = 0
    for pose, face, value, covered, count in batches:
        waiting.append((owner[at + pose], face, value, covered))
        at += count
        whole = int(owner[at]) if at < len(owner) else n  # mounts before this one are complete
        if whole == done:
            continue
        columns = [np.concatenate(column) for column in zip(*waiting, strict=True)]
        is_whole = columns[0] < whole
        waiting = [tuple(column[~is_whole] for column in columns)]
        mount, face, value, covered = (column[is_whole] for column in columns)
        order = np.lexsort((value, face, mount))
        mount, face = mount[order], face[order]
        # The last of each pair of mount and face has the greatest coverage.
        is_last = np.ones(len(order), np.bool_)
        is_last[:-1] = (mount[1:] != mount[:-1]) | (face[1:] != face[:-1])
        rows = order[is_last]
        yield mount[is_last] - done, face[is_last], value[rows], covered[rows], whole - done
        done = whole


def shortened(coverage: FloatArray, least: float) -> tuple[NDArray[np.float32], BoolArray]:
    """Coverage in float32, and the mask of values of at least `least`; both are consistent.

    No value is rounded across the threshold, nor down to 0. Thresholds other than 0 are 1e-30 or
    more, which is near the least float32.
    """
    covered: BoolArray = coverage >= least
    short = coverage.astype(np.float32)
    too_low = (covered & (short.astype(np.float64) < least)) | (short == 0)
    too_high = ~covered & (short.astype(np.float64) >= least) & ~too_low
    short[too_low] = np.nextafter(short[too_low], np.float32(np.inf))
    short[too_high] = np.nextafter(short[too_high], np.float32(-np.inf))
    return short, covered


def _write_shard(
    folder: Path, shard: str, header: dict[str, Any], batches: Iterable[Batch], first: int
) -> int:
    """Write the shard of the poses from number `first` on; the number of its pairs."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, sink, n_pairs = schema_of(shard, header), pa.BufferOutputStream(), 0
    with pq.ParquetWriter(sink, schema, compression="zstd", write_page_checksum=True) as writer:
        for pose, face, value, covered, n_poses in batches:
            of_all = (first + pose).astype(np.int32)
            first += n_poses
            writer.write_table(pa.table([of_all, face, value, covered], schema=schema))
            n_pairs += len(face)
    store(folder, shard, memoryview(sink.getvalue()))
    return n_pairs
