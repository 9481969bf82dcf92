"""Selection problem: candidates, the faces they cover, the needs of a face, and the goal.

A `Problem` is the plain value that every `select_*` takes. It comes from a visibility matrix
(`problem_of`) or from a 0/1 array (`problem_of_matrix`), and holds no mesh and no camera. One that
is too large for lists of pairs is a `BitProblem`; both have the needs of an `AnyProblem`.

Shares are of weight: faces count by number or by area. They are compared in integers
(`Problem.integer_weights`), so that no requirement depends on the order of summation.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import ConfigError
from rastercov.base.typed import typed
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.spread import least_cosine
from rastercov.kernels import placement_selection as kernels
from rastercov.mesh import Mesh
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.bit_matrix import BitMatrix
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.mounts import Mounts
from rastercov.placement.select.any_problem import (
    SHARE_TOLERANCE,
    TOTAL_WEIGHT,
    AnyProblem,
    check_shapes,
    in_whole_numbers,
)
from rastercov.placement.select.goals import BestCoverage, FewestCameras, Goal

__all__ = [
    "SHARE_TOLERANCE",
    "TOTAL_WEIGHT",
    "AnyProblem",
    "BestCoverage",
    "FewestCameras",
    "Goal",
    "Problem",
    "check_shapes",
    "in_whole_numbers",
    "needs_of",
    "problem_of",
    "problem_of_matrix",
    "views_of",
    "weights_of",
]


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(AnyProblem):
    """Faces that each candidate covers, in compressed rows, and the goal of the selection.

    A face is covered when at least `views` of the chosen cameras cover it and, where `min_angle`
    is more than 0, the rays to two of these differ by that angle. A candidate that is a rig has a
    face once for each of its cameras that covers it.

    Attributes
    ----------
    indptr : (C + 1,) int64
        Candidate c covers the faces `face[indptr[c]:indptr[c + 1]]`.
    face : (N,) int32
        Equal faces of a candidate follow one another.
    weights, views, costs, goal, groups, face_group, mean_coverage
        As in `AnyProblem`.
    min_angle : float
        Radians, [0, pi].
    eyes, centroids : (K, 3), (F, 3) float64, optional
        Camera centres and centroids of faces, metres; needed for `min_angle`.
    eye : (N,) int32, optional
        Row in `eyes` of the camera of each pair; that of its candidate unless given.
    """

    indptr: IntArray
    face: NDArray[np.int32]
    min_angle: float = 0.0
    eyes: FloatArray | None = None
    centroids: FloatArray | None = None
    eye: NDArray[np.int32] | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.min_angle <= math.pi:
            raise ConfigError(
                f"the angle must be 0 to 180 degrees, got {math.degrees(self.min_angle):g}"
            )
        if self.min_angle > 0:
            if self.eyes is None or self.centroids is None:
                raise ConfigError("an angle between views needs eyes and centroids; give both")
            n_eyes = self.n_candidates if self.eye is None else len(self.eyes)
            check_shapes(
                eyes=(self.eyes, (n_eyes, 3)),
                centroids=(self.centroids, (self.n_faces, 3)),
            )
            if self.eye is not None and not (
                self.eye.shape == self.face.shape
                and (not len(self.eye) or 0 <= self.eye.min() <= self.eye.max() < n_eyes)
            ):
                raise ConfigError(f"eye must be {len(self.face)} rows of {n_eyes} eyes")
        if len(self.face) and not 0 <= self.face.min() <= self.face.max() < self.n_faces:
            raise ConfigError(f"face must lie in 0 ... {self.n_faces - 1}")
        super().__post_init__()

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""
        return len(self.indptr) - 1

    @property
    def min_cosine(self) -> float:
        """Largest cosine of two rays that differ by `min_angle`; 2 where any two do."""
        return least_cosine(self.min_angle)

    @cached_property
    def has_rigs(self) -> bool:
        """True where a candidate covers a face with several cameras, or has another's eye."""
        return self.eye is not None or bool(self._is_repeated.any())

    @property
    def _is_repeated(self) -> BoolArray:
        """(N,) pairs of the face and the candidate of the pair before."""
        again = np.zeros(len(self.face), np.bool_)
        again[1:] = self.face[1:] == self.face[:-1]
        again[self.indptr[:-1][self.indptr[:-1] < len(again)]] = False
        return again

    def faces_of(self, candidate: int) -> NDArray[np.int32]:
        """(N,) faces that a candidate covers; of a rig, once for each of its cameras."""
        return self.face[self.indptr[candidate] : self.indptr[candidate + 1]]

    def eyes_of(self, candidate: int) -> IntArray:
        """(N,) row in `eyes` of the camera of each of `faces_of`."""
        pairs = slice(self.indptr[candidate], self.indptr[candidate + 1])
        if self.eye is None:
            return np.full(pairs.stop - pairs.start, candidate, np.int64)
        return self.eye[pairs].astype(np.int64)

    def covered_by(self, chosen: ArrayLike) -> tuple[IntArray, BoolArray]:
        """(F,) number of chosen cameras that cover each face, and (F,) faces that are covered."""
        views, covered = super().covered_by(chosen)
        if self.min_angle > 0:
            eyes, centroids = self.eyes, self.centroids
            covered &= kernels.spread_faces(
                self.indptr, self.face, self._eye_of_pair, np.asarray(chosen, np.int64), views,
                eyes, centroids, self.min_cosine,
            )  # fmt: skip
        return views, covered

    @cached_property
    def _eye_of_pair(self) -> NDArray[np.int32]:
        """(N,) row in `eyes` of the camera of each pair."""
        if self.eye is not None:
            return self.eye
        return np.repeat(np.arange(self.n_candidates, dtype=np.int32), np.diff(self.indptr))


@typed
def problem_of(
    matrix: VisibilityMatrix,
    mesh: Mesh | Cells,
    goal: Goal,
    *,
    weight_by: str = "area",
    views: int | Mapping[str, int] | None = None,
    min_angle_deg: float | None = None,
    costs: ArrayLike | None = None,
    min_coverage: float | None = None,
    mounts: Mounts | None = None,
) -> Problem:
    """Selection problem of a visibility matrix.

    Parameters
    ----------
    mesh : Mesh or Cells
        Those that the matrix was made for; a problem of cells has them as its faces.
    weight_by : {"area", "count"}
        Weight of a face; only task faces count.
    views : int or mapping of str to int, optional
        Cameras that must cover a face, for all or by group (1 for other groups);
        `matrix.task.views` unless given.
    min_angle_deg : float, optional
        Least angle between the rays to two of them, degrees, 0 for any;
        `matrix.task.min_angle_deg` unless given.
    costs : (C,) array_like, optional
        Of each candidate; 1 unless given.
    min_coverage : float, optional
        Least coverage, above 0, at which a camera covers a face; as in the matrix unless given.
        0 is the thesis' Table 6.1.
    mounts : Mounts, optional
        As for `build_matrix`; each camera of a rig counts as a view of its own.

    Raises
    ------
    ConfigError
        For a matrix of rigs without `mounts`, where the places of cameras matter.
    """
    elements, needs = needs_of(matrix, mesh, weight_by, views, costs)
    angle = math.radians(matrix.task.min_angle_deg if min_angle_deg is None else min_angle_deg)
    # Where one view is enough, it does not matter which cameras of a rig cover a face.
    is_counted = angle > 0 or bool((needs["views"] > 1).any())
    if len(matrix.on_rig) and not is_counted:
        matrix = matrix.united()
    covers = matrix.covered if min_coverage is None else matrix.coverage >= np.float64(min_coverage)
    indptr, face, on_rig = matrix.indptr, matrix.face, matrix.on_rig
    if not covers.all():
        # Row by row, microseconds each: sums over all pairs would take more memory than the pairs.
        counts = [np.count_nonzero(covers[a:b]) for a, b in pairwise(indptr)]
        indptr, face = np.concatenate(([0], np.cumsum(counts, dtype=np.int64))), face[covers]
        on_rig = on_rig[covers] if len(on_rig) else on_rig
    eyes, eye = matrix.poses[:, :3, 3].copy(), None
    if len(on_rig):
        if mounts is None:
            raise ConfigError("the matrix is of rigs; give their mounts, as for build_matrix")
        placed, owner = mounts.cameras(matrix.placed)
        first = np.searchsorted(owner, np.arange(matrix.n_poses))
        eyes = placed.world_from_camera[:, :3, 3].copy()
        eye = (np.repeat(first, np.diff(indptr)) + on_rig).astype(np.int32)
    return Problem(
        indptr=indptr,
        face=face,
        goal=goal,
        min_angle=angle,
        eyes=eyes,
        centroids=elements.centroids,
        eye=eye,
        **needs,
    )


def needs_of(
    matrix: VisibilityMatrix | BitMatrix,
    mesh: Mesh | Cells,
    weight_by: str,
    views: int | Mapping[str, int] | None,
    costs: ArrayLike | None,
) -> tuple[Mesh, dict[str, Any]]:
    """Elements of a matrix, and the fields of an `AnyProblem` but its goal; see `problem_of`."""
    if matrix.is_of_cells != isinstance(mesh, Cells):
        wanted, got = ("cells", "a mesh") if matrix.is_of_cells else ("faces", "cells")
        raise ConfigError(f"the matrix is of {wanted}, got {got}; give what it was made for")
    if isinstance(mesh, Cells):
        mesh = mesh.elements
    if matrix.n_faces != mesh.n_faces:
        raise ConfigError(
            f"the matrix is of a mesh of {matrix.n_faces} faces, got one of {mesh.n_faces}"
        )
    return mesh, {
        "weights": weights_of(mesh, weight_by),
        "views": views_of(mesh, matrix.task.views if views is None else views),
        "costs": np.ones(matrix.n_poses) if costs is None else np.asarray(costs, np.float64),
        "groups": tuple(group.name for group in mesh.groups),
        "face_group": mesh.face_group,
        "mean_coverage": matrix.mean_coverage,
    }


def weights_of(mesh: Mesh, weight_by: str) -> FloatArray:
    """(F,) weight of each face, by "area" or "count"; 0 for faces that are not scored."""
    if weight_by not in ("area", "count"):
        raise ConfigError(f"weight_by must be area or count, got {weight_by!r}")
    weights = mesh.areas if weight_by == "area" else np.ones(mesh.n_faces)
    return np.where(mesh.task_mask, weights, 0.0)


def views_of(mesh: Mesh, views: int | Mapping[str, int]) -> IntArray:
    """(F,) cameras that must cover each face: a number, or one by the name of some groups."""
    if not isinstance(views, Mapping):
        return np.full(mesh.n_faces, views)
    names = [group.name for group in mesh.groups]
    if unknown := sorted(set(views) - set(names)):
        raise ConfigError(f"there is no group {unknown[0]!r}; groups are {', '.join(names)}")
    needed: IntArray = np.array([views.get(name, 1) for name in names])[mesh.face_group]
    return needed


@typed
def problem_of_matrix(
    covers: ArrayLike,
    goal: Goal | None = None,
    *,
    weights: ArrayLike | None = None,
    views: ArrayLike = 1,
    costs: ArrayLike | None = None,
    groups: Sequence[str] = ("all",),
    face_group: ArrayLike = 0,
    min_angle_deg: float = 0.0,
    eyes: ArrayLike | None = None,
    centroids: ArrayLike | None = None,
) -> Problem:
    """Selection problem of a plain array: any set cover.

    Parameters
    ----------
    covers : (C, F) array_like
        1 where candidate c covers face f.
    goal : FewestCameras or BestCoverage, optional
        Every face, by the fewest candidates, unless given.
    weights : (F,) array_like, optional
        1 unless given.
    views, face_group : int or (F,) array_like
    costs : (C,) array_like, optional
        1 unless given.
    groups, min_angle_deg, eyes, centroids
        As in `Problem`; the angle is in degrees here.
    """
    array = np.asarray(covers)
    if array.ndim != 2 or not ((array == 0) | (array == 1)).all():
        raise ConfigError(
            f"covers must be an array (C, F) of 0 and 1, got shape {array.shape} of {array.dtype}"
        )
    n_candidates, n_faces = array.shape
    candidate, face = np.nonzero(array)
    counts = np.bincount(candidate, minlength=n_candidates)
    return Problem(
        indptr=np.concatenate(([0], np.cumsum(counts))),
        face=face.astype(np.int32),
        weights=np.ones(n_faces) if weights is None else np.asarray(weights, np.float64),
        views=_of_each(views, n_faces, "views"),
        costs=np.ones(n_candidates) if costs is None else np.asarray(costs, np.float64),
        goal=FewestCameras() if goal is None else goal,
        groups=tuple(groups),
        face_group=_of_each(face_group, n_faces, "face_group").astype(np.int32),
        mean_coverage=counts / max(1, n_faces),
        min_angle=math.radians(min_angle_deg),
        eyes=None if eyes is None else np.asarray(eyes, np.float64),
        centroids=None if centroids is None else np.asarray(centroids, np.float64),
    )


def _of_each(value: ArrayLike, count: int, name: str) -> IntArray:
    numbers = np.asarray(value)
    if numbers.shape not in ((), (count,)) or not np.issubdtype(numbers.dtype, np.integer):
        raise ConfigError(
            f"{name} must be a whole number or {count} of them, "
            f"got {numbers.dtype} of shape {numbers.shape}"
        )
    return np.broadcast_to(numbers, count).astype(np.int64)
