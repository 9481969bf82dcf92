"""Selection problem: candidates, the faces they cover, the needs of a face, and the goal.

A `Problem` is the plain value that every `select_*` takes, and a `Selection` the result. It comes
from a visibility matrix (`problem_of`) or from a 0/1 array (`problem_of_matrix`), and holds no mesh
and no camera. Covered pairs are bits, one row per camera; what needs lists of pairs makes them of
the bits (`presolve`).

Shares are of weight: faces count by number or by area. They are compared in integers
(`Problem.integer_weights`), so that no requirement depends on the order of summation.
"""

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike
from typing_extensions import Doc

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    check_choice,
    check_limits,
    frozen_record,
    shown,
)
from rastercov.base.arguments import ray_angle
from rastercov.base.format import distinct_percents
from rastercov.base.typed import check_fields, typed
from rastercov.core.area.cells import Cells
from rastercov.core.camera import eyes_of
from rastercov.core.coverage.network import ViewSpread, least_cosine
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import list_names, rows_of
from rastercov.placement.bits import CoveredBits
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.mounts import Mounts
from rastercov.placement.required import SHARE_TOLERANCE

TOTAL_WEIGHT = 1 << 40
"""Total of `Problem.integer_weights`, unless the weights are integers with a smaller sum."""

Shares = Mapping[str, Annotated[float, Ge(0), Le(1)]]


def empty_goal(coverage: float, groups: Mapping[str, float]) -> str:
    """A line on a share of 0, which any network reaches; "" where there is none.

    That of the whole task may be 0 where groups have shares of their own.
    """
    zero = [name for name, share in groups.items() if share == 0]
    if not zero and (coverage > 0 or groups):
        return ""
    name = f"group {zero[0]!r}" if zero else "the task"
    return f"expected a share of {name} above 0, got 0, which always holds; increase it"


@dataclass(frozen=True)
class FewestCameras:
    """Reach a coverage with the fewest cameras, or at the least cost.

    Attributes
    ----------
    coverage : float
        Share of the weight of all faces to cover, [0, 1].
    groups : mapping of str to float
        Share to cover of the weight of single groups and parts by name, [0, 1].
    of_reachable : bool
        True if shares are of the weight that all candidates together cover, not of the total.

    Raises
    ------
    ConfigError
        For a share outside [0, 1], and for a share of 0, which always holds; `coverage` may be 0 if
        there are `groups`.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import FewestCameras, problem_of_matrix, select_greedy
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> few = select_greedy(problem_of_matrix(covers, FewestCameras(coverage=1.0)))
    >>> few.chosen.tolist(), few.share
    ([0, 2], 1.0)
    """

    coverage: Annotated[float, Ge(0), Le(1), Doc("Share of the evaluated surface to cover.")] = 1.0
    groups: Annotated[Shares, Doc("Share to cover by group or part.")] = field(default_factory=dict)
    of_reachable: Annotated[
        bool, Doc("True to take shares of what all candidates together cover.")
    ] = False

    def __post_init__(self) -> None:
        check_fields(self)
        for name, share in {"coverage": self.coverage, **self.groups}.items():
            if not 0 <= share <= 1:
                raise ConfigError(
                    f"expected {name} from 0 to 1, got {share!r}; give the share to cover"
                )
        if line := empty_goal(self.coverage, self.groups):
            raise ConfigError(line)


@dataclass(frozen=True)
class BestCoverage:
    """Cover the most with a number of cameras, within a budget, or both.

    Attributes
    ----------
    cameras : int, optional
        Maximum number of cameras.
    budget : float, optional
        Maximum total cost.

    Raises
    ------
    ConfigError
        If neither is given.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import BestCoverage, problem_of_matrix, select_greedy
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> best = select_greedy(problem_of_matrix(covers, BestCoverage(cameras=1)))
    >>> best.share, best.bound
    (0.5, 0.5)
    """

    cameras: Annotated[int, Ge(0)] | None = None
    budget: Annotated[float, Ge(0), Doc("Maximum total cost.")] | None = None

    def __post_init__(self) -> None:
        check_limits(self)
        if self.cameras is None and self.budget is None:
            raise ConfigError("expected cameras, budget or both, got neither; give one")


Goal = FewestCameras | BestCoverage


@frozen_record(kw_only=True)
class Problem:
    """Faces that each candidate covers, needs of each face, costs, and the goal of a selection.

    Make it with `problem_of` or `problem_of_matrix`. A face is covered if at least `views` of the
    chosen cameras cover it and, where `min_angle` is more than 0, the rays to two of these differ
    by that angle. A candidate is a camera, or a rig of several, each of which is a view of its own.
    ConfigError for inconsistent arrays, and for a goal that all candidates together do not reach.

    Attributes
    ----------
    bits : CoveredBits
        Faces that each of K cameras covers.
    starts : (C + 1,) int64, optional
        Candidate c has the cameras `starts[c]` ... `starts[c + 1] - 1`; camera c unless given.
    weights : (F,) float64
        Weight of each face; 0 leaves it out.
    views : (F,) int64
        Number of cameras that must cover each face, 1 or more.
    costs : (C,) float64
        Cost of each candidate, 0 or more.
    goal : FewestCameras or BestCoverage
        Goal of the selection.
    groups : tuple of str
        Names of the groups of faces.
    face_group : (F,) int32
        Index into `groups` of each face.
    min_angle : float
        Minimum angle between the rays to two cameras, radians, [0, pi].
    eyes, centroids : (K, 3), (F, 3) float64, optional
        Camera centres and centroids of faces, metres; required with `min_angle`.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import FewestCameras, problem_of_matrix
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> problem = problem_of_matrix(covers, FewestCameras(0.75), costs=[2, 1, 1])
    >>> problem.costs.tolist(), problem.views.tolist()
    ([2.0, 1.0, 1.0], [1, 1, 1, 1])
    """

    bits: CoveredBits
    starts: IntArray | None = None
    weights: FloatArray
    views: IntArray
    costs: FloatArray
    goal: Goal
    groups: tuple[str, ...]
    face_group: Int32Array
    min_angle: float = 0.0
    eyes: FloatArray | None = None
    centroids: FloatArray | None = None

    def __post_init__(self) -> None:
        _check(self)
        goal = self.goal
        if isinstance(goal, BestCoverage):
            return
        if unknown := sorted(name for name in goal.groups if not rows_of(self.groups, name)):
            raise ConfigError(
                f"expected a group, got {unknown[0]!r}; groups are {list_names(self.groups)}"
            )
        reached = self.by_requirement(self.reachable)
        shares = zip(self.wanted.items(), reached, *self.required, strict=True)
        for (name, share), most, whole, least in shares:
            if most < least:
                raise _unreachable(name or "", most / whole, share, self)

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""
        return self.bits.n_rows if self.starts is None else len(self.starts) - 1

    @property
    def has_rigs(self) -> bool:
        """True where a candidate has several cameras."""
        return self.n_candidates < self.bits.n_rows

    @property
    def is_spread(self) -> bool:
        """True where the rays to two cameras of a face must differ by an angle."""
        return self.min_angle > 0

    @property
    def min_cosine(self) -> float:
        """Largest cosine of two rays that differ by `min_angle`; 2 where any two do."""
        return least_cosine(self.min_angle)

    @cached_property
    def rows(self) -> IntArray:
        """(C + 1,) limits of the cameras of each candidate."""
        return np.arange(self.bits.n_rows + 1) if self.starts is None else self.starts

    @property
    def n_faces(self) -> int:
        """Number of faces F."""
        return len(self.weights)

    @cached_property
    def integer_weights(self) -> IntArray:
        """(F,) weights as integers: their own values, or parts of `TOTAL_WEIGHT`."""
        return in_whole_numbers(self.weights)

    @cached_property
    def reachable(self) -> BoolArray:
        """(F,) faces that all candidates together cover."""
        if self.is_spread:
            return self.covered_by(np.arange(self.n_candidates))[1]
        return self.bits.counts_up_to(int(self.views.max(initial=1))) >= self.views

    @cached_property
    def places(self) -> list[str]:
        """Groups and parts of `FewestCameras`, each part directly before those in it."""
        return sorted(getattr(self.goal, "groups", ()), key="{}/".format)

    @cached_property
    def wanted(self) -> dict[str | None, float]:
        """Share that each of R requirements asks for: of all, None, and of each of `places`.

        0 for `BestCoverage`.
        """
        if isinstance(self.goal, BestCoverage):
            return {None: 0.0}
        return {None: self.goal.coverage} | {name: self.goal.groups[name] for name in self.places}

    @cached_property
    def members(self) -> list[Sequence[int]]:
        """Rows in `groups` of each requirement."""
        return [range(len(self.groups)), *(rows_of(self.groups, name) for name in self.places)]

    @cached_property
    def required(self) -> tuple[IntArray, IntArray]:
        """(R,) integer weight of all that each requirement is of, and (R,) what it asks for."""
        counted = np.ones(self.n_faces, bool)
        if isinstance(self.goal, FewestCameras) and self.goal.of_reachable:
            counted = self.reachable
        whole, shares = self.by_requirement(counted), np.array([*self.wanted.values()])
        return whole, np.ceil((shares - SHARE_TOLERANCE).clip(0) * whole).astype(np.int64)

    def by_group(self, faces: BoolArray) -> IntArray:
        """(G,) integer weight of the given faces of each group."""
        # Sums of up to 2^40 are exact as float64.
        weights, n_groups = self.integer_weights[faces], len(self.groups)
        return np.bincount(self.face_group[faces], weights, n_groups).astype(np.int64)

    def by_requirement(self, faces: BoolArray) -> IntArray:
        """(R,) integer weight of the given faces that count towards each requirement."""
        of_group = self.by_group(faces)
        return np.array([of_group[rows].sum() for rows in self.members])

    def share(self, faces: BoolArray) -> float:
        """Share of the total weight, [0, 1]; 1 where there is no weight."""
        total = int(self.integer_weights.sum())
        return int(self.integer_weights[faces].sum()) / total if total else 1.0

    def faces_of(self, candidate: int) -> Int32Array:
        """(N,) faces that a candidate covers; of a rig, once for each of its cameras."""
        rows = range(self.rows[candidate], self.rows[candidate + 1])
        return np.concatenate([self.bits.faces_of(row) for row in rows])

    def covered_by(self, chosen: ArrayLike) -> tuple[IntArray, BoolArray]:
        """(F,) number of chosen cameras that cover each face, and (F,) faces that are covered."""
        views, spread = np.zeros(self.n_faces, np.int64), self.spread()
        for candidate in np.asarray(chosen, np.int64):  # microseconds each
            self.add(candidate, views, spread)
        return views, (views >= self.views) & spread.is_spread

    def spread(self) -> ViewSpread:
        """Angles between views, of no camera yet, for `add`."""
        on = np.zeros((self.n_faces, 3)) if self.centroids is None else self.centroids
        return ViewSpread(on, self.min_angle)

    def add(self, candidate: int, views: IntArray, spread: ViewSpread) -> None:
        """Add the cameras of a candidate to the number of views of each face, and their angles."""
        for row in range(self.rows[candidate], self.rows[candidate + 1]):
            faces = self.bits.faces_of(row)
            views[faces] += 1
            if self.eyes is not None:
                spread.add(self.eyes[row], faces)


def in_whole_numbers(weights: FloatArray) -> IntArray:
    """(F,) weights as integers: their own values, or parts of `TOTAL_WEIGHT`."""
    total = float(weights.sum())
    if total < TOTAL_WEIGHT and bool((weights == np.floor(weights)).all()):
        return weights.astype(np.int64)
    return np.rint(weights / total * TOTAL_WEIGHT).clip(weights > 0).astype(np.int64)


def _unreachable(group: str, most: float, share: float, problem: Problem) -> ConfigError:
    """Error for a share of a group, or of all for "", that all candidates do not reach."""
    able = sum(bool(len(problem.faces_of(row))) for row in range(problem.n_candidates))
    if not able:
        return ConfigError("expected candidates that cover something, got none; add others")
    remedy = "" if group else ", give of_reachable,"
    reached, wanted = distinct_percents(most, share)
    every = f"All {able} candidates together reach" if able > 1 else "The only candidate reaches"
    return ConfigError(
        f"{every} {reached} of {group or 'the area'}, expected {wanted}; reduce it{remedy} or add "
        "candidates"
    )


def _check(problem: Problem) -> None:
    """Raise ConfigError when the arrays of a problem are inconsistent."""
    n_candidates, n_faces, n_rows = problem.n_candidates, problem.n_faces, problem.bits.n_rows
    if problem.bits.n_faces != n_faces:
        raise ConfigError(
            f"expected bits of {n_faces} faces, as weights, got {problem.bits.n_faces}; rebuild "
            "them"
        )
    rows = problem.rows
    if rows[0] != 0 or rows[-1] != n_rows or (np.diff(rows) < 1).any():
        raise ConfigError(
            f"expected starts of one or more of {n_rows} cameras, got {shown(rows)}; correct them"
        )
    ray_angle("min_angle_deg", math.degrees(problem.min_angle))
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("views", "face_group"), (n_faces,))
    shapes["costs"] = (n_candidates,)
    if problem.is_spread:
        if problem.eyes is None or problem.centroids is None:
            raise ConfigError("expected eyes and centroids for an angle, got none; give both")
        shapes |= {"eyes": (n_rows, 3), "centroids": (n_faces, 3)}
    for name, shape in shapes.items():
        if (result := getattr(problem, name).shape) != shape:
            raise ConfigError(f"expected {name} {shape}, got shape {result}; reshape it")
    for name, values in (("weights", problem.weights), ("costs", problem.costs)):
        if not (np.isfinite(values) & (values >= 0)).all():
            raise ConfigError(
                f"expected finite {name} of 0 or more, got other values; correct them"
            )
    if (problem.views < 1).any():
        raise ConfigError(f"expected views of 1 or more, got {problem.views.min()}; increase it")
    within = (problem.face_group >= 0) & (problem.face_group < len(problem.groups))
    if not within.all() or len(set(problem.groups)) < len(problem.groups):
        raise ConfigError(
            "expected face_group as rows of unique groups, got other values; correct it"
        )


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
    matrix : VisibilityMatrix
        Result of `build_matrix`; the bits of a matrix in a folder stay on the disk.
    mesh : Mesh or Cells
        The mesh or the patches that the matrix was made for; patches take the place of faces.
    goal : FewestCameras or BestCoverage
        Goal of the selection.
    weight_by : {"area", "seeable", "count"}
        Weight of an evaluated face: its area, its area without what no camera can ever see, or 1.
    views : int or mapping of str to int, optional
        Number of cameras that must cover a face, for all faces or by group (1 for other groups);
        `matrix.task.views` unless given.
    min_angle_deg : float, optional
        Minimum angle between the rays to two of these cameras, degrees; 0 for any angle.
        `matrix.task.min_angle_deg` unless given.
    costs : (C,) array_like, optional
        Cost of each candidate; 1 unless given.
    min_coverage : float, optional
        Minimum coverage at which a camera covers a face; as in the matrix unless given. With 0, any
        coverage above 0 counts, as in Table 6.1 of Eissa (2020).
    mounts : Mounts, optional
        As for `build_matrix`; each camera of a rig counts as a view of its own.

    Raises
    ------
    ConfigError
        For a mesh that the matrix was not made for, a goal that the candidates do not reach, and a
        matrix of rigs without `mounts` where several views are required.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import FewestCameras, Framing, build_matrix, on_sphere
    >>> from rastercov.placement import problem_of, select_greedy
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> points = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=12)
    >>> matrix = build_matrix((mesh, camera), points.poses, rc.Task(max_incidence_deg=70))
    >>> few = select_greedy(problem_of(matrix, mesh, FewestCameras()))
    >>> len(few.chosen), few.share
    (3, 1.0)
    """
    elements = _elements_of(matrix, mesh)
    needed = views_of(elements, matrix.task.views if views is None else views)
    angle = math.radians(matrix.task.min_angle_deg if min_angle_deg is None else min_angle_deg)
    # Where one view is enough, it does not matter which cameras of a rig cover a face.
    is_counted = angle > 0 or bool((needed > 1).any())
    starts = None
    eyes = matrix.poses[:, :3, 3].copy() if mounts is None else mounts.eyes(matrix.placed)
    least = matrix.task.min_coverage if min_coverage is None else min_coverage
    needs_mounts = "mounts" in matrix.header and is_counted
    if mounts is None and (needs_mounts or (angle > 0 and "parallel" in matrix.header)):
        raise ConfigError("expected the mounts of the rigs, got none; give them as to build_matrix")
    if needs_mounts and mounts is not None:
        placed, owner = mounts.cameras(matrix.placed)
        starts = np.searchsorted(owner, np.arange(matrix.n_poses + 1))
        eyes = eyes_of(mounts.rig, placed)
    problem = Problem(
        bits=matrix.bits(least, starts),
        starts=starts,
        weights=weights_of(mesh, weight_by),
        views=needed,
        costs=np.ones(matrix.n_poses) if costs is None else np.asarray(costs, np.float64),
        goal=BestCoverage(cameras=0),
        groups=tuple(group.name for group in elements.groups),
        face_group=elements.face_group,
        min_angle=angle,
        eyes=eyes,
        centroids=elements.centroids,
    )
    return replace(problem, goal=goal)


def _elements_of(matrix: VisibilityMatrix, mesh: Mesh | Cells) -> Mesh:
    """Mesh whose faces are the elements of a matrix."""
    if matrix.is_of_cells != isinstance(mesh, Cells):
        wanted, got = ("patches", "a mesh") if matrix.is_of_cells else ("a mesh", "patches")
        raise ConfigError(f"expected {wanted}, got {got}; give what the matrix was made for")
    if isinstance(mesh, Cells):
        mesh = mesh.elements
    if matrix.n_faces != mesh.n_faces:
        raise ConfigError(
            f"expected the mesh of {matrix.n_faces} faces, got one of {mesh.n_faces}; give its own"
        )
    return mesh


def weights_of(on: Mesh | Cells, weight_by: str, hidden: FloatArray | None = None) -> FloatArray:
    """(F,) weight of each face or cell; 0 where it is not evaluated.

    By "area", by "count", or by "seeable", the area without what no camera can ever see: `hidden`,
    m^2 of each face of the mesh, unless that of the mesh as it is.
    """
    check_choice("weight_by", weight_by, ("area", "seeable", "count"))
    mesh = on.elements if isinstance(on, Cells) else on
    weights = np.ones(mesh.n_faces) if weight_by == "count" else mesh.areas
    if weight_by == "seeable":
        from rastercov.core.mesh.unseeable import unseeable_areas

        whole, rows = (on.mesh, on.source_face) if isinstance(on, Cells) else (on, slice(None))
        hidden = unseeable_areas(whole) if hidden is None else hidden
        shares = hidden / np.maximum(whole.areas, TINY)
        weights = weights * (1 - shares[rows])
    return np.where(mesh.task_mask, weights, 0.0)


def views_of(mesh: Mesh, views: int | Mapping[str, int]) -> IntArray:
    """(F,) cameras that must cover each face: a number, or one by the name of some groups."""
    if not isinstance(views, Mapping):
        return np.full(mesh.n_faces, views)
    names = [group.name for group in mesh.groups]
    if unknown := sorted(set(views) - set(names)):
        raise ConfigError(f"expected a group, got {unknown[0]!r}; groups are {list_names(names)}")
    return np.array([views.get(name, 1) for name in names])[mesh.face_group]


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
        1 where candidate c covers face f, otherwise 0.
    goal : FewestCameras or BestCoverage, optional
        Goal of the selection; all faces with the fewest candidates unless given.
    weights : (F,) array_like, optional
        Weight of each face; 1 unless given.
    views, face_group : int or (F,) int array_like
        As in `Problem`; one number for all faces, or one for each.
    costs : (C,) array_like, optional
        Cost of each candidate; 1 unless given.
    groups, min_angle_deg, eyes, centroids
        As in `Problem`; the angle is in degrees here.

    Raises
    ------
    ConfigError
        For inconsistent arrays, and for a goal that the candidates do not reach.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import FewestCameras, problem_of_matrix
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> problem = problem_of_matrix(covers, FewestCameras(0.75), costs=[2, 1, 1])
    >>> problem.n_candidates, problem.n_faces
    (3, 4)
    """
    array = np.asarray(covers)
    if array.ndim != 2 or not ((array == 0) | (array == 1)).all():
        raise ConfigError(
            f"expected covers (C, F) of 0 and 1, got {array.dtype} {array.shape}; convert it"
        )
    n_candidates, n_faces = array.shape
    return Problem(
        bits=CoveredBits.from_dense(array),
        weights=np.ones(n_faces) if weights is None else np.asarray(weights, np.float64),
        views=_of_each(views, n_faces, "views"),
        costs=np.ones(n_candidates) if costs is None else np.asarray(costs, np.float64),
        goal=FewestCameras() if goal is None else goal,
        groups=tuple(groups),
        face_group=_of_each(face_group, n_faces, "face_group").astype(np.int32),
        min_angle=math.radians(min_angle_deg),
        eyes=None if eyes is None else np.asarray(eyes, np.float64),
        centroids=None if centroids is None else np.asarray(centroids, np.float64),
    )


def _of_each(value: ArrayLike, count: int, name: str) -> IntArray:
    numbers = np.asarray(value)
    if numbers.shape not in ((), (count,)) or not np.issubdtype(numbers.dtype, np.integer):
        raise ConfigError(
            f"expected {name} as a whole number or {count} of them, got {numbers.dtype} of shape "
            f"{numbers.shape}; convert it"
        )
    return np.broadcast_to(numbers, count).astype(np.int64)


PROVED = 1e-6
"""Relative gap up to which a selection counts as optimal: the tolerance of HiGHS."""
PROGRESS_BITS = 20
"""Fractional bits below the unit of weight, for progress that does not yet cover a face."""


@frozen_record
class Selection:
    """Chosen cameras, and a bound on the objective of any other choice.

    Attributes
    ----------
    method : str
        "greedy", "integer", or "thesis" for the selection of Eissa (2020).
    chosen : (K,) int64
        Indices of the chosen candidates, in greedy order: each adds the most to those before it.
    curve : (K,) float64
        Share of the weight covered by the first 1, 2, ..., K of them.
    views : (F,) int64
        Number of chosen cameras that cover each face.
    covered : (F,) bool
        Faces covered by the required number of cameras, from directions that differ as required.
    share : float
        Share of the weight that is covered, [0, 1].
    cost : float
        Total cost of the chosen candidates.
    objective : float
        `cost` for `FewestCameras`, `share` for `BestCoverage`.
    bound : float
        Bound of the objective: no selection has a lower cost, or a greater share, than this.
    gap : float
        Difference between objective and bound, relative to the objective; 0 for the optimum.
    seconds : float
        Time of the selection.
    status : {"optimal", "feasible", "time_limit", "interrupted"}
        Proved to be the optimum; found by a heuristic; or the best result of an exact method when
        the time limit or an interrupt stopped it.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import FewestCameras, problem_of_matrix, select_greedy
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> few = select_greedy(problem_of_matrix(covers, FewestCameras()))
    >>> few.chosen.tolist(), few.bound, few.gap, few.status
    ([0, 2], 2.0, 0.0, 'optimal')
    """

    method: str
    chosen: IntArray
    curve: FloatArray
    views: IntArray
    covered: BoolArray
    share: float
    cost: float
    objective: float
    bound: float
    gap: float
    seconds: float
    status: str

    def summary(self) -> ByName:
        """Figures and cameras, ready for JSON, without the arrays over faces."""
        figures = ("share", "cost", "objective", "bound", "gap", "seconds")
        return {
            "method": self.method,
            "status": self.status,
            "cameras": len(self.chosen),
            "chosen": self.chosen.tolist(),
            "curve": self.curve.tolist(),
            "faces_covered": int(self.covered.sum()),
            **{name: getattr(self, name) for name in figures},
        }


def finish(
    method: str,
    problem: Problem,
    chosen: IntArray,
    bound: float,
    seconds: float,
    status: str = "feasible",
) -> Selection:
    """Selection of candidates of a problem, evaluated in it and not after presolve.

    `status` becomes "optimal" where the bound proves it.
    """
    order, curve = in_order(problem, chosen)
    views, covered = problem.covered_by(order)
    share, cost = problem.share(covered), float(np.sort(problem.costs[order]).sum())
    if isinstance(problem.goal, BestCoverage):
        objective, bound = share, max(bound, share)
    else:
        objective, bound = cost, min(bound, cost)
    gap = relative_gap(objective, bound)
    return Selection(
        method=method,
        chosen=order,
        curve=curve,
        views=views,
        covered=covered,
        share=share,
        cost=cost,
        objective=objective,
        bound=bound,
        gap=gap,
        seconds=seconds,
        status="optimal" if gap <= PROVED else status,
    )


def relative_gap(objective: float, bound: float) -> float:
    """|objective - bound| / |objective|; 0 where both are equal, inf where the objective is 0."""
    if objective == bound:
        return 0.0
    return abs(objective - bound) / abs(objective) if objective else math.inf


def curve_of(problem: Problem, order: IntArray) -> FloatArray:
    """Cumulative shares that candidates cover in an order."""
    count, spread = np.zeros(problem.n_faces, np.int64), problem.spread()
    curve: list[float] = []
    for camera in order.tolist():
        problem.add(camera, count, spread)
        curve.append(problem.share((count >= problem.views) & spread.is_spread))
    return np.array(curve, np.float64)


def in_order(problem: Problem, chosen: IntArray) -> tuple[IntArray, FloatArray]:
    """Chosen candidates in greedy order, and the cumulative shares they cover."""
    order: list[int] = []
    curve: list[float] = []
    # Progress per face, so that the first of several required cameras counts too.
    count, spread = np.zeros(problem.n_faces, np.int64), problem.spread()
    part = (problem.integer_weights << PROGRESS_BITS) // problem.views

    def loss(camera: int) -> int:
        faces, times = np.unique(problem.faces_of(camera), return_counts=True)
        left = np.maximum(problem.views[faces] - count[faces], 0)
        return -int((part[faces] * np.minimum(times, left)).sum())

    # Lazy evaluation: gains only fall as cameras are added, so the first one that is still the
    # greatest when computed again is taken. Ties go by number.
    stale = [(loss(camera), camera) for camera in map(int, chosen)]
    heapq.heapify(stale)
    while stale:
        known, camera = heapq.heappop(stale)
        now = (loss(camera) if known else 0, camera)
        if stale and now > stale[0]:
            heapq.heappush(stale, now)
            continue
        problem.add(camera, count, spread)
        order.append(camera)
        curve.append(problem.share((count >= problem.views) & spread.is_spread))
    return np.array(order, np.int64), np.array(curve, np.float64)
