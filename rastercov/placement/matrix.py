"""Visibility matrix: coverage of each face by each candidate pose, sparse, in memory or on disk.

    poses -> `evaluate_batches` -> shards -> `VisibilityMatrix` -> `problem_of` -> `select_*`

Only pairs with coverage > 0 are kept, of faces that are scored. On disk a matrix is a folder:

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
from contextlib import nullcontext
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._typed import typed
from rastercov.camera import Camera
from rastercov.coverage import Coverage, evaluate_batches
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.observer import Observer, open_observer
from rastercov.placement._arrays import BoolArray, FloatArray
from rastercov.placement.explain.candidate_visibility import FIGURES, CandidateBounds
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
from rastercov.pose import valid_poses
from rastercov.task import Task


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
        Faces F of the mesh, and how many of them are scored.
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
    view: Observer | tuple[Mesh, Camera],
    poses: ArrayLike,
    task: Task | None = None,
    folder: str | Path | None = None,
    *,
    poses_a_shard: int | None = None,
    bounds: CandidateBounds | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    note: Note = log_warning,
) -> VisibilityMatrix:
    """Visibility matrix of the poses, measured in batches.

    Parameters
    ----------
    view : Observer or (Mesh, Camera)
        An open observer, or the arguments to open one with method "certified".
    poses : (C, 4, 4) array_like
        world_from_camera of the candidates.
    task : Task, optional
        Thresholds; `Task()` unless given.
    folder : path, optional
        Folder of the shards; made when it is missing. An interrupted run continues from its shards;
        a complete matrix is only read; damaged files are made again. Without a folder the matrix is
        in memory.
    poses_a_shard : int, optional
        Poses of each file; the number that gives `PAIRS_A_SHARD` pairs unless given.
    bounds : CandidateBounds, optional
        Takes in the poses that are measured, not those of shards that are there.
    progress : callable
        Called with the poses done and the total.
    note : callable
        Called with a line on each damaged file; logs it as a warning unless given.

    Raises
    ------
    ConfigError
        When the folder holds a matrix of other inputs, or another process is writing to it.
    PoseError
        For a pose that is no rigid motion.
    """
    matrices, task = valid_poses(poses), task or Task()
    done, figures = 0, ("coverage", *(FIGURES if bounds is not None else ()))

    def batches(rows: slice) -> Iterator[Coverage]:
        nonlocal done
        for batch in evaluate_batches(observer, matrices[rows], task, fields=figures):
            if len(batch.pose_ids):
                yield batch
                if bounds is not None:
                    bounds.add(batch)
                done += len(batch.pose_ids)
                progress(done, len(matrices))

    opened = open_observer(*view) if isinstance(view, tuple) else nullcontext(view)
    with opened as observer:
        header = describe(observer, matrices, task, poses_a_shard)
        if folder is None:
            progress(0, len(matrices))
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


def _gathered(
    batches: Iterable[Coverage],
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """Pairs of each pose, and face and coverage of each pair."""
    counts, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
    values = [np.zeros(0, np.float32)]
    for batch in batches:
        pose, face, value, _ = _pairs(batch)
        counts.append(np.bincount(pose, minlength=len(batch.pose_ids)))
        faces.append(face)
        values.append(value)
    return np.concatenate(counts), np.concatenate(faces), np.concatenate(values)


def _pairs(
    batch: Coverage,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32], BoolArray]:
    """Row in the batch, face, coverage and covered mask of all pairs with coverage > 0."""
    pose, face = np.nonzero((batch.coverage > 0) & batch.mesh.task_mask)
    short, covered = shortened(batch.coverage[pose, face], batch.task.min_coverage)
    return pose, face.astype(np.int32), short, covered


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
    folder: Path, shard: str, header: dict[str, Any], batches: Iterable[Coverage], first: int
) -> int:
    """Write the shard of the poses from number `first` on; the number of its pairs."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, sink, n_pairs = schema_of(shard, header), pa.BufferOutputStream(), 0
    with pq.ParquetWriter(sink, schema, compression="zstd", write_page_checksum=True) as writer:
        for batch in batches:
            pose, face, value, covered = _pairs(batch)
            of_all = (first + batch.pose_ids[pose]).astype(np.int32)
            writer.write_table(pa.table([of_all, face, value, covered], schema=schema))
            n_pairs += len(face)
    store(folder, shard, memoryview(sink.getvalue()))
    return n_pairs
