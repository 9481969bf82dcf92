"""Visibility matrix: coverage of each face by each candidate pose, sparse, in memory or on disk.

    poses -> `evaluate_batches` -> shards -> `VisibilityMatrix` -> `problem_of` -> `select_*`

Only pairs with coverage > 0 are kept, of faces that are evaluated. With `cells` the elements are
cells of the evaluated surface, numbered like faces, and coverage is the covered share of the cell's
area. On disk a matrix is a folder:

header.json     inputs with hashes: mesh, camera, poses, task, method, version
scene.npz       mesh and cameras
poses.npz       poses, (C, 4, 4), the candidates, and the camera of each
pairs/*.npz     shards of consecutive poses, see `matrix_folder`
sha256/*.sha256 the checksum of each of these files

A shard is written to a temporary file, flushed to the disk and renamed, so a killed run loses at
most its current shard; run again with the same inputs it continues from there. Such a run makes a
damaged, exchanged or deleted file again, bit for bit; where a folder is only read it is refused.

Of more pairs than the memory holds coverage stays on the disk: a selection takes their bits.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cached_property, reduce
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    frozen_record,
    offsets_of,
)
from rastercov.base.locks import lock
from rastercov.base.typed import typed
from rastercov.core.area.cells import Cells
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera import Cameras, Poses, renumber
from rastercov.core.coverage.coverage import Observer, open_observer
from rastercov.core.coverage.shards import LOG, device_of
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.placement.bits import CoveredBits
from rastercov.placement.matrix_folder import (
    AnyPairs,
    MatrixFolder,
    Pairs,
    add_bounds,
    cameras_at,
    can_pack,
    claim,
    describe,
    gather_pairs,
    packed_pairs,
    pairs_of,
    pairs_of_cells,
    pairs_of_mounts,
    region_observer,
)
from rastercov.placement.mounts import Mounts
from rastercov.placement.uncovered import CandidateBounds
from rastercov.shards import Made, Progress, Staff, Workers, silent
from rastercov.shards.run import count_poses_of
from rastercov.shards.store import Note, remove_halves


@frozen_record(kw_only=True)
class VisibilityMatrix:
    """Coverage of faces by candidate poses, in compressed rows; row c is pose c.

    The faces of pose c are `face[indptr[c]:indptr[c + 1]]`, in ascending order; every other face
    has coverage 0, and so have faces of occluders. Pairs of folders are read when they are first
    asked for; `bits` does without them.

    Attributes
    ----------
    placed : Poses
        The candidates, with the index of the camera of each, or of its mount for rigs.
    header : dict
        Inputs of the matrix, with hashes.
    parts : tuple of Pairs, PackedPairs or MatrixFolder
        Pairs of consecutive candidates, in memory or in a folder.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, build_matrix, on_sphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> points = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=12)
    >>> matrix = build_matrix((mesh, camera), points.poses, rc.Task(max_incidence_deg=70))
    >>> matrix.covered.shape, matrix.n_pairs
    ((35,), 35)
    """

    placed: Poses
    header: ByName
    parts: tuple[AnyPairs | MatrixFolder, ...]

    @property
    def poses(self) -> FloatArray:
        """(C, 4, 4) world_from_camera of the candidates."""
        return self.placed.world_from_camera

    @property
    def camera(self) -> Int32Array:
        """(C,) index of the camera of each candidate, or of its mount for rigs."""
        return self.placed.camera

    @property
    def n_poses(self) -> int:
        """Number of candidates C."""
        return len(self.placed)

    @property
    def n_faces(self) -> int:
        """Number F of faces of the mesh; for a matrix of patches, of these."""
        return int(self.header["n_faces"])

    @property
    def n_task_faces(self) -> int:
        """Number of evaluated faces; for a matrix of patches, of these."""
        return int(self.header["n_task_faces"])

    @property
    def task(self) -> Task:
        """Thresholds of coverage."""
        return Task(**self.header["task"])

    @property
    def is_of_cells(self) -> bool:
        """True if the elements are patches (`rastercov.cells`), not faces."""
        return "cells" in self.header

    @property
    def n_pairs(self) -> int:
        """Number of pairs with coverage above 0, or of bits."""
        return sum(part.n_pairs for part in self.parts)

    @cached_property
    def pairs(self) -> Pairs:
        """All pairs, in memory; ConfigError if a shard has been damaged."""
        return gather_pairs(pairs for part in self.parts for pairs in part.pairs())

    @property
    def indptr(self) -> IntArray:
        """(C + 1,) row limits of the pairs of each pose."""
        return offsets_of(self.pairs.counts)

    @property
    def face(self) -> Int32Array:
        """(N,) face of each pair."""
        return self.pairs.face

    @property
    def coverage(self) -> Float32Array:
        """(N,) coverage of each pair, (3.6), more than 0.

        Rounded such that a comparison with `task.min_coverage` gives exactly the covered pairs.
        """
        return self.pairs.coverage

    @property
    def on_rig(self) -> NDArray[np.uint16]:
        """(N,) number of the camera on its rig; empty where poses are of single cameras.

        A pose has a pair with a face for each camera of its rig that covers it, one after the
        other.
        """
        return self.pairs.on_rig

    @property
    def covered(self) -> BoolArray:
        """(N,) mask of the pairs in which the pose covers the face: `Reason.COVERED`."""
        return self.coverage >= np.float64(self.task.min_coverage)

    @property
    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they crash the process that measures them; how it ended."""
        texts: dict[int, str] = {}
        first = 0
        for part in self.parts:
            left = part.quarantined() if isinstance(part, MatrixFolder) else {}
            texts |= {first + pose: end for pose, end in left.items()}
            first += part.n_poses
        return texts

    @property
    def mean_coverage(self) -> FloatArray:
        """(C,) mean coverage of each pose over the evaluated faces; not numbers for bits."""
        totals = [totals for _, totals in self._derive(self.task.min_coverage)]
        return np.concatenate(totals) / max(1, self.n_task_faces)

    def united(self) -> "VisibilityMatrix":
        """The matrix with the greatest coverage of any camera of a rig, each face once."""
        return replace(self, parts=(self.pairs.unite(),))

    def bits(self, least: float | None = None, starts: IntArray | None = None) -> CoveredBits:
        """Pairs with coverage of at least `least`, `Task.min_coverage` unless given, as bits.

        With `starts`, (C + 1,), the cameras of the rig of pose c have the rows from `starts[c]` on;
        without, a pose has one row, with the faces that any of them covers. Bits of a folder are
        derived once, and stay on the disk.

        Raises
        ------
        ConfigError
            When a shard is damaged.
        ResourceError
            When the disk has no room for the bits.
        """
        least = self.task.min_coverage if least is None else least
        if "bits" in self.header and least != self.task.min_coverage:
            raise ConfigError(
                f"expected a matrix with coverage for min_coverage {least:g}, got bits of "
                f"{self.task.min_coverage:g}; build it without bits"
            )
        if starts is None:
            return reduce(CoveredBits.joined, (bits for bits, _ in self._derive(least)))
        row = np.repeat(starts[:-1], self.pairs.counts) + self.on_rig
        enough = self.coverage >= np.float64(least)
        return CoveredBits.from_pairs(row[enough], self.face[enough], int(starts[-1]), self.n_faces)

    def _derive(self, least: float) -> Iterator[tuple[CoveredBits, FloatArray]]:
        """Bits, and total coverage of each pose, of the parts."""
        return (part.rows_and_areas(least, self.n_faces) for part in self.parts)

    def joined(self, other: "VisibilityMatrix") -> "VisibilityMatrix":
        """Matrix of the poses of both, of one mesh and one task."""
        if self.n_faces != other.n_faces or self.task != other.task:
            raise ConfigError(
                "expected matrices of one mesh and task, got several; build them from the same "
                "inputs"
            )
        poses = np.concatenate((self.poses, other.poses))
        placed = Poses.of(poses, camera=np.concatenate((self.camera, other.camera)))
        return replace(self, placed=placed, parts=(*self.parts, *other.parts))

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Matrix that `build_matrix` left in a folder.

        Raises
        ------
        ConfigError
            When there is none, when it is incomplete, or when one of its files is damaged.
        """
        result = MatrixFolder.open(folder)
        return cls(placed=result.poses(), header=result.header, parts=(result,))


@typed
def build_matrix(
    view: Observer | tuple[Mesh, Cameras],
    poses: ArrayLike | Poses,
    task: Task | None = None,
    folder: str | Path | None = None,
    *,
    cells: Cells | None = None,
    bits: bool = False,
    poses_a_shard: int | None = None,
    bounds: CandidateBounds | None = None,
    mounts: Mounts | None = None,
    workers: Workers | None = None,
    progress: Progress = silent,
    watch: Callable[[Made], None] = lambda made: None,
    note: Note = LOG.warning,
) -> VisibilityMatrix:
    """Visibility matrix of the poses, measured in batches.

    Parameters
    ----------
    view : Observer or (Mesh, Camera)
        An open observer, or the mesh and the camera, for one with method "certified"; several
        cameras are a Rig or a sequence.
    poses : (C, 4, 4) array_like, or Poses
        world_from_camera of the candidates; `Poses.camera` is the index of the camera of each.
    task : Task, optional
        Thresholds; `Task()` unless given.
    folder : path, optional
        Folder of the shards; made when it is missing. An interrupted run continues from its shards;
        a complete matrix is only read; damaged files are made again. Without a folder the matrix is
        in memory.
    cells : Cells, optional
        Patches of the mesh as elements of the matrix, instead of its faces; a pose covers a patch
        if it covers at least `task.min_coverage`, one half, of its area. The mesh itself occludes,
        and the method must be certified or exact.
    bits : bool
        Keep covered pairs alone, a bit each, where a rasteriser judges faces for single cameras;
        others keep coverage.
    poses_a_shard : int, optional
        Number of poses in each file; unless given, the one that gives about 4 million pairs, or 33
        million bits.
    bounds : CandidateBounds, optional
        Updated with the poses that this process measures, not with those of existing shards; for
        rigs, with the poses of their cameras.
    mounts : Mounts, optional
        Rigs of the cameras of the view; `Poses.camera` is then the index of the mount, and a rig
        has the pairs of each of its cameras.
    workers : Workers, optional
        Processes that make the shards, in a folder that all of them share; this one unless given.
        The bytes of the shards are the same. Poses that crash a worker are skipped, see
        `VisibilityMatrix.quarantined`.
    progress : callable, optional
        Called with the number of poses done and the total.
    watch : callable, optional
        Called with each shard that a worker made.
    note : callable, optional
        Called with a line on each damaged file; logs it as a warning unless given.

    Raises
    ------
    ConfigError
        If the folder holds a matrix of other inputs, or another process is writing to it; for
        patches, also with a threshold that applies to whole faces, or method "sampled"; and for
        workers without a folder, or workers that fail.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, build_matrix, on_sphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> points = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=12)
    >>> matrix = build_matrix((mesh, camera), points.poses, rc.Task(max_incidence_deg=70))
    >>> matrix.n_poses, matrix.n_faces, matrix.n_pairs
    (12, 12, 35)
    """
    if workers is not None and folder is None:
        raise ConfigError("expected a folder for workers, got none; name one, or leave out workers")
    placed, task = renumber(poses), task or Task()
    with _open_view(view, cells, task) as observer:
        bits = bits and can_pack(observer, placed, task, cells, mounts)
        header = describe(observer, placed, task, poses_a_shard, cells, mounts, bits)

        def pairs(rows: slice, did: Callable[[int], None]) -> AnyPairs:
            if bits:
                return packed_pairs(observer, placed[rows], task, bounds, did)
            return pairs_of(observer, placed[rows], task, cells, bounds, mounts, did)

        if folder is None:
            did, n_at_once = count_poses_of(len(placed), progress), header["poses_a_shard"]
            starts = range(0, max(1, len(placed)), n_at_once)
            parts = tuple(pairs(slice(at, at + n_at_once), did) for at in starts)
            return VisibilityMatrix(placed=placed, header=header, parts=parts)
        staff = Staff(workers, progress, watch, note)
        with lock(Path(folder), is_shared=staff.part is not None) as place:
            if staff.part is None:
                remove_halves(place)
            is_given = poses_a_shard is not None
            matrix = claim(place, header, observer, placed, is_given, note)
            whole = matrix.fill(pairs, staff, device_of(observer))
            if workers is not None and bounds is not None:
                add_bounds(matrix, bounds)
            return VisibilityMatrix(placed=placed, header=matrix.header, parts=(whole,))


def matrices_of_cells(
    observer: Observer,
    finder: RegionPass,
    placed: Poses,
    every: Sequence[Cells],
    mounts: Mounts | None,
    progress: Progress,
) -> list[VisibilityMatrix]:
    """Visibility matrices of patches of several parts of a scene: each pose is measured once.

    Parameters
    ----------
    observer : Observer
        Open, as of `build_matrix`.
    finder : RegionPass
        Open, for the same scene, in which all parts are evaluated.
    placed, mounts, progress
        As of `build_matrix`, in memory.
    every : sequence of Cells
        Patches of the scene with one part evaluated alone, of each part.
    """
    cameras, owner = cameras_at(placed, mounts)
    own, done = [each.mesh.task_mask for each in every], 0
    found: list[list[Pairs]] = [[] for _ in every]
    for regions in finder.batches(cameras):
        for some, each, faces in zip(found, every, own, strict=True):
            some.append(pairs_of_cells(each, regions._of_faces(faces), finder.task))
        done += len(regions.pose_ids)
        progress(done, len(owner))
    header = describe(observer, placed, finder.task, None, every[0], mounts)
    items = []
    for some, each in zip(found, every, strict=True):
        pairs = pairs_of_mounts(gather_pairs(some), owner, len(placed), mounts)
        sizes = {"cells": each.size, "n_faces": len(each), "n_task_faces": len(each)}
        items.append(VisibilityMatrix(placed=placed, header=header | sizes, parts=(pairs,)))
    return items


@contextmanager
def _open_view(
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
