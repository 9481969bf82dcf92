"""Visibility matrix: coverage of each face by each candidate pose, sparse, in memory or on disk.

    poses -> `evaluate_batches` -> shards -> `VisibilityMatrix` -> `problem_of` -> `select_*`

Only pairs with coverage > 0 are kept, of faces that are scored. With `cells` the elements are cells
of the task surface, numbered like faces, and coverage is the covered share of the cell's area.
On disk a matrix is a folder:

header.json     inputs with hashes: mesh, camera, poses, task, method, version
scene.npz       mesh and cameras
poses.npz       poses, (C, 4, 4), the candidates, and the camera of each
pairs/*.npz     shards of consecutive poses, see `matrix_folder`
sha256/*.sha256 the checksum of each of these files

A shard is written to a temporary file, flushed to the disk and renamed, so a killed run loses at
most its current shard; run again with the same inputs it continues from there. Such a run makes a
damaged, exchanged or deleted file again, bit for bit; where a folder is only read it is refused.

A `BitMatrix` serves selections from more pairs than the memory holds: `measure_matrix` ->
`problem_of` -> `select_greedy`. Coverage itself stays on the disk.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import ConfigError
from rastercov.base.locks import locked
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.base.typed import typed
from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Cameras
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.observer import Observer, open_observer
from rastercov.coverage.shards import LOG
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.native import placement_bits as kernels
from rastercov.placement.bits import CoveredBits, n_words
from rastercov.placement.matrix_folder import (
    NOT_ON_RIGS,
    MatrixFolder,
    add_bounds,
    claim,
    describe,
    gathered,
    greatest,
    pairs_of,
    region_observer,
    totals_of,
)
from rastercov.placement.mounts import Mounts
from rastercov.placement.uncovered import CandidateBounds
from rastercov.shards import Made, Staff, Workers, fill
from rastercov.shards.run import counted
from rastercov.shards.store import Note, remove_halves

POSES_A_TURN = 256
"""Poses whose pairs are made bits at a time."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredPoses:
    """Candidate poses whose visibility was measured, and the inputs of the measurement.

    Attributes
    ----------
    placed : Poses
        The candidates, with the camera of each, 0 where there is one. Of rigs, that of the mount.
    header : dict
        Inputs of the matrix.
    """

    placed: Poses
    header: dict[str, Any]

    @property
    def poses(self) -> FloatArray:
        """(C, 4, 4) world_from_camera of the candidates."""
        return self.placed.world_from_camera

    @property
    def camera(self) -> NDArray[np.int32]:
        """(C,) index of the camera of each candidate."""
        return self.placed.camera

    @property
    def n_poses(self) -> int:
        """Number of candidates C."""
        return len(self.placed)

    @property
    def n_faces(self) -> int:
        """Faces F of the mesh; of a matrix of cells, their number."""
        return int(self.header["n_faces"])

    @property
    def n_task_faces(self) -> int:
        """Faces that are scored; of a matrix of cells, their number."""
        return int(self.header["n_task_faces"])

    @property
    def task(self) -> Task:
        """Thresholds of coverage."""
        return Task(**self.header["task"])

    @property
    def is_of_cells(self) -> bool:
        """True where the elements are cells, not faces."""
        return "cells" in self.header

    def _placed_with(self, other: "MeasuredPoses") -> Poses:
        """Candidates of both."""
        poses = np.concatenate((self.poses, other.poses))
        return Poses.of(poses, camera=np.concatenate((self.camera, other.camera)))


@dataclass(frozen=True, eq=False, kw_only=True)
class VisibilityMatrix(MeasuredPoses):
    """Coverage of faces by candidate poses, in compressed rows; row c is pose c.

    The faces of pose c are `face[indptr[c]:indptr[c + 1]]`, in ascending order; every other face
    has coverage 0, and so have faces of occluders.

    Attributes
    ----------
    indptr : (C + 1,) int64
        Row limits of the pairs of each pose.
    face : (N,) int32
    coverage : (N,) float32
        (3.6), more than 0; rounded such that a comparison with `task.min_coverage` gives exactly
        the covered pairs.
    on_rig : (N,) uint16
        Of rigs, number of the camera on its rig: a pose has a pair with a face for each camera of
        its rig that covers it, one after the other. Empty where poses are of single cameras.
    quarantined : dict of int to str
        Poses without pairs because they kill the process that measures them, each with its end.
    """

    indptr: NDArray[np.int64]
    face: NDArray[np.int32]
    coverage: NDArray[np.float32]
    on_rig: NDArray[np.uint16]
    quarantined: dict[int, str] = field(default_factory=dict)

    @property
    def n_pairs(self) -> int:
        """Pairs with coverage above 0."""
        return len(self.face)

    @property
    def covered(self) -> BoolArray:
        """(N,) pairs in which the pose covers the face: `Reason.COVERED`."""
        return self.coverage >= np.float64(self.task.min_coverage)

    def united(self) -> "VisibilityMatrix":
        """The matrix with the greatest coverage of any camera of a rig, each face once."""
        if not len(self.on_rig):
            return self
        counts, face, coverage = greatest(np.diff(self.indptr), self.face, self.coverage)
        return replace(
            self, indptr=limits_of(counts), face=face, coverage=coverage, on_rig=NOT_ON_RIGS
        )

    def bits(self, least: float, starts: IntArray | None = None) -> CoveredBits:
        """Pairs with coverage of at least `least`, as bits.

        With `starts`, (C + 1,), the cameras of the rig of pose c have the rows from `starts[c]` on;
        without, a pose has one row, with the faces that any of them covers.
        """
        n_rows = self.n_poses if starts is None else int(starts[-1])
        words = np.zeros((n_rows, n_words(self.n_faces)), np.uint64)
        for first in range(0, self.n_poses, POSES_A_TURN):
            limits = self.indptr[first : first + POSES_A_TURN + 1]
            part = slice(limits[0], limits[-1])
            row = np.repeat(np.arange(first, first + len(limits) - 1), np.diff(limits))
            if starts is not None:
                row = starts[row] + self.on_rig[part]
            enough = self.coverage[part] >= np.float64(least)
            kernels.set_pairs(row[enough], self.face[part][enough], words)
        return CoveredBits.of(words, self.n_faces)

    @property
    def mean_coverage(self) -> FloatArray:
        """(C,) mean coverage of each pose over the faces that are scored."""
        alone = self.united()
        total = totals_of(np.diff(alone.indptr), alone.coverage)
        return total / max(1, self.n_task_faces)

    def joined(self, other: "VisibilityMatrix") -> "VisibilityMatrix":
        """Matrix of the poses of both, of one mesh and one task."""
        further = {self.n_poses + pose: end for pose, end in other.quarantined.items()}
        return replace(
            self,
            placed=self._placed_with(other),
            indptr=np.concatenate((self.indptr, self.indptr[-1] + other.indptr[1:])),
            face=np.concatenate((self.face, other.face)),
            coverage=np.concatenate((self.coverage, other.coverage)),
            on_rig=np.concatenate((self.on_rig, other.on_rig)),
            quarantined=self.quarantined | further,
        )

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Matrix that `build_matrix` left in a folder.

        Raises
        ------
        ConfigError
            When there is none, when it is incomplete, or when one of its files is damaged.
        """
        return cls.of(BitMatrix.load(folder))

    @classmethod
    def of(cls, matrix: "BitMatrix") -> Self:
        """Matrix of complete folders, in memory; errors as for `load`."""
        n_pairs, done = matrix.n_pairs, 0
        face, coverage = np.empty(n_pairs, np.int32), np.empty(n_pairs, np.float32)
        on_rig = np.empty(n_pairs if matrix.folders[0].is_of_rigs else 0, np.uint16)
        counts = [np.zeros(0, np.int64)]
        for folder, number in matrix.shards():
            of_poses, faces, values, cameras = folder.pairs_of(number)
            part = slice(done, done + len(faces))
            if part.stop > n_pairs:
                raise ConfigError(
                    f"{folder.path / folder.store.name(number)}: it changed while it was read"
                )
            face[part], coverage[part] = faces, values
            on_rig[part] = cameras
            counts.append(of_poses)
            done = part.stop
        return cls(
            placed=matrix.placed,
            header=matrix.header,
            indptr=limits_of(np.concatenate(counts)),
            face=face,
            coverage=coverage,
            on_rig=on_rig,
            quarantined=matrix.quarantined,
        )


def limits_of(counts: IntArray) -> IntArray:
    """(C + 1,) limits of rows of these lengths."""
    return np.concatenate(([0], np.cumsum(counts)))


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
    workers: Workers | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    watch: Callable[[Made], None] = lambda made: None,
    note: Note = LOG.warning,
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
        Takes in the poses that are measured by this process, not those of shards that are there; of
        rigs, those of their cameras.
    mounts : Mounts, optional
        Rigs of the cameras of the view, which `Poses.camera` counts then; a rig has the pairs of
        each of its cameras.
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
    if folder is not None:
        found = measure_matrix(
            view, poses, task, folder, cells=cells, poses_a_shard=poses_a_shard, bounds=bounds,
            mounts=mounts, workers=workers, progress=progress, watch=watch, note=note,
        )  # fmt: skip
        return VisibilityMatrix.of(found)
    placed, task = renumbered(poses), task or Task()
    with _opened(view, cells, task) as observer:
        header = describe(observer, placed, task, poses_a_shard, cells, mounts)
        did, n_at_once = counted(len(placed), progress), header["poses_a_shard"]
        pairs = gathered(
            pairs_of(observer, placed[at : at + n_at_once], task, cells, bounds, mounts, did)
            for at in range(0, len(placed), n_at_once)
        )
        return VisibilityMatrix(
            placed=placed,
            header=header,
            indptr=limits_of(pairs.counts),
            face=pairs.face,
            coverage=pairs.coverage,
            on_rig=pairs.on_rig,
        )


@typed
def measure_matrix(
    view: Observer | tuple[Mesh, Cameras],
    poses: ArrayLike | Poses,
    task: Task | None,
    folder: str | Path,
    *,
    cells: Cells | None = None,
    poses_a_shard: int | None = None,
    bounds: CandidateBounds | None = None,
    mounts: Mounts | None = None,
    workers: Workers | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    watch: Callable[[Made], None] = lambda made: None,
    note: Note = LOG.warning,
) -> "BitMatrix":
    """Visibility matrix of which nothing but the poses is in memory, in a folder.

    Arguments and errors are those of `build_matrix`.
    """
    placed, task = renumbered(poses), task or Task()
    with _opened(view, cells, task) as observer, locked(Path(folder)) as place:
        remove_halves(place)
        header = describe(observer, placed, task, poses_a_shard, cells, mounts)
        is_given = poses_a_shard is not None
        matrix = claim(place, header, observer, placed, is_given, note)
        shards, sizes = matrix.store, dict[int, int]()

        def check(number: int) -> None:
            sizes[number] = matrix.rows_in(number)

        def make(number: int, did: Callable[[int], None]) -> memoryview:
            rows = shards.rows(number)
            pairs = pairs_of(observer, placed[rows], task, cells, bounds, mounts, did)
            return matrix.shard_bytes(number, pairs, np.arange(rows.start, rows.stop))

        for number in fill(shards, make, check, Staff(workers, progress, watch, note)):
            if number not in sizes:
                check(number)
        if workers is not None and bounds is not None:
            add_bounds(matrix, bounds)
        whole = replace(matrix, n_pairs=sum(sizes.values()))
        return BitMatrix(placed=placed, header=matrix.header, folders=(whole,))


@contextmanager
def _opened(
    view: Observer | tuple[Mesh, Cameras], cells: Cells | None, task: Task
) -> Iterator[Observer]:
    """Observer of a view; of the regions in it where there are cells."""
    with ExitStack() as opened:
        observer: Observer = (
            opened.enter_context(open_observer(*view)) if isinstance(view, tuple) else view
        )
        if cells is not None:
            observer = opened.enter_context(region_observer(observer, cells, task))
        yield observer


@dataclass(frozen=True, eq=False, kw_only=True)
class BitMatrix(MeasuredPoses):
    """Faces, or cells, that each candidate pose covers, one bit each.

    Attributes
    ----------
    folders : tuple of MatrixFolder
        Folders of the matrices of consecutive candidates; the header is that of the first. Bits are
        derived from their shards when they are first asked for.
    """

    folders: tuple[MatrixFolder, ...]

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Matrix that `measure_matrix` or `build_matrix` left in a folder.

        Raises
        ------
        ConfigError
            When there is none, when it is incomplete, or when one of its files is damaged.
        """
        found = MatrixFolder.open(folder)
        return cls(placed=found.poses(), header=found.header, folders=(found,))

    @property
    def n_pairs(self) -> int:
        """Pairs with coverage above 0."""
        return sum(folder.n_pairs for folder in self.folders)

    @property
    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        found: dict[int, str] = {}
        first = 0
        for folder in self.folders:
            found |= {first + pose: end for pose, end in folder.quarantined().items()}
            first += folder.header["n_poses"]
        return found

    def shards(self) -> Iterator[tuple[MatrixFolder, int]]:
        """Folder and number of each shard."""
        for folder in self.folders:
            for number in range(len(folder.store)):
                yield folder, number

    @property
    def bits(self) -> CoveredBits:
        """Pairs that count as covered by `task`; errors as of `covered_at`."""
        return self.covered_at(self.task.min_coverage)

    @property
    def mean_coverage(self) -> FloatArray:
        """(C,) mean coverage of each pose over the faces that are scored."""
        least = self.task.min_coverage
        totals: FloatArray = np.concatenate([each.covered(least)[1] for each in self.folders])
        return totals / max(1, self.n_task_faces)

    def covered_at(self, least: float) -> CoveredBits:
        """Pairs with coverage of at least `least`.

        Raises
        ------
        ConfigError
            When a shard is damaged.
        ResourceError
            When the disk has no room for the bits.
        """
        return reduce(CoveredBits.joined, (each.covered(least)[0] for each in self.folders))

    def joined(self, other: "BitMatrix") -> "BitMatrix":
        """Matrix of the poses of both, of one mesh and one task."""
        if self.n_faces != other.n_faces or self.task != other.task:
            raise ConfigError("matrices of other faces or another task cannot be joined")
        folders = (*self.folders, *other.folders)
        return replace(self, placed=self._placed_with(other), folders=folders)
