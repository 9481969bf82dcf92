"""Requirements of a plan, and their status for a network.

By face, shares are counted in integers, as in `Problem`. A measured share has bounds because
visibility has: `low` counts the certainly covered faces, `high` the possibly covered ones. By area
it is that of the exact area, with its bound.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.format import percent, plural
from rastercov.coverage.area.network import AreaNetwork
from rastercov.mesh import Mesh
from rastercov.placement.plan.entry import value_of
from rastercov.placement.plan.sections import FewestSelection, SelectionSection, TaskSection
from rastercov.placement.select.problem import (
    SHARE_TOLERANCE,
    BestCoverage,
    FewestCameras,
    Goal,
    views_of,
)

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

HOLDS, FAILS, UNDECIDED = "holds", "fails", "undecided"


@dataclass(frozen=True)
class Requirement:
    """A required share, and the share reached.

    Attributes
    ----------
    group : str or None
        None for the whole task.
    limit : float
        Required share, [0, 1].
    low, share, high : float
        Share certainly covered, covered as measured, and possibly covered.
    status : {"holds", "fails", "undecided"}
        undecided: the limit is between `low` and `high`.
    faces, uncovered : int
        Faces, and faces that are not covered as measured.
    of_reachable : bool
        True where shares are of the faces that some candidate covers, not of all.
    """

    group: str | None
    limit: float
    low: float
    share: float
    high: float
    status: str
    faces: int
    uncovered: int
    of_reachable: bool = False

    @property
    def name(self) -> str:
        """The group, or "all"."""
        return "all" if self.group is None else f"group {self.group}"

    @property
    def short_by(self) -> float:
        """Difference of limit and share; 0 where the requirement holds."""
        return max(0.0, self.limit - self.share) if self.status != HOLDS else 0.0

    def words(self) -> str:
        """The requirement and its outcome in one line."""
        of = " of what all candidates cover" if self.of_reachable else ""
        text = f"{self.name}: {percent(self.share)} covered{of}, {percent(self.limit)} wanted"
        if self.status == FAILS:
            points = percent(self.short_by).removesuffix(" %")
            return f"{text}: {points} points short, {plural(self.uncovered, 'face')} uncovered"
        if self.status == UNDECIDED:
            return (
                f"{text}: not decided, the bound of visibility allows {percent(self.low)} to "
                f"{percent(self.high)}"
            )
        return text


@dataclass(frozen=True)
class AreaRequirement(Requirement):
    """A required share of the exact area; `low` and `high` are the share less and plus its bound.

    Attributes
    ----------
    m2, bound_m2, of_m2 : float
        Covered area, the bound of its error, and the area that the share is of.
    faces, uncovered : int
        Faces, and faces that are not covered as a whole.
    """

    m2: float = 0.0
    bound_m2: float = 0.0
    of_m2: float = 0.0

    def words(self) -> str:
        """The requirement and its outcome in one line."""
        of = "of the area that all candidates cover" if self.of_reachable else "of the area covered"
        text = f"{self.name}: {percent(self.share)} {of}, {percent(self.limit)} wanted"
        if self.status == FAILS:
            points = percent(self.short_by).removesuffix(" %")
            return f"{text}: {points} points short, {self.of_m2 - self.m2:.3g} m² uncovered"
        if self.status == UNDECIDED:
            return (
                f"{text}: not decided, the bound of the area allows {100 * self.low:.9g} % to "
                f"{100 * self.high:.9g} %"
            )
        return text


@dataclass(frozen=True)
class CellRequirement(Requirement):
    """A required share of what all candidates cover; `faces` and `uncovered` are cells."""

    def words(self) -> str:
        """The requirement and its outcome in one line."""
        return f"{super().words().replace('faces', 'cells')} (on cells)"


OF = {"area": "the area", "count": "the faces"}
"""Words for the whole of a share, by `weight_by`."""


def goal_of(selection: SelectionSection) -> Goal:
    """Goal of a plan, as `problem_of` takes it."""
    if isinstance(selection, FewestSelection):
        return value_of(selection, FewestCameras)
    return value_of(selection, BestCoverage)


def judge(
    mesh: Mesh,
    integer_weights: IntArray,
    limits: Mapping[str | None, float],
    covered: BoolArray,
    certain: BoolArray | None = None,
    possible: BoolArray | None = None,
    reachable: BoolArray | None = None,
) -> tuple[Requirement, ...]:
    """Evaluate each required share.

    Parameters
    ----------
    integer_weights : (F,) int64
        Weights as of `Problem` or `Objective`.
    limits : mapping of group name or None to share
        None is the whole task.
    covered, certain, possible : (F,) bool
        Faces covered as measured, certainly and possibly; the same unless given.
    reachable : (F,) bool, optional
        Faces that the shares are of; all that are scored unless given.
    """
    parts = [covered if part is None else part for part in (certain, covered, possible)]
    names = [group.name for group in mesh.groups]
    found = []
    for group, limit in limits.items():
        faces = mesh.task_mask if reachable is None else mesh.task_mask & reachable
        if group is not None:
            faces = faces & (mesh.face_group == names.index(group))
        whole = int(integer_weights[faces].sum())
        needed = math.ceil(max(0.0, limit - SHARE_TOLERANCE) * whole)
        worth = [int(integer_weights[faces & part].sum()) for part in parts]
        status = HOLDS if worth[0] >= needed else UNDECIDED if worth[2] >= needed else FAILS
        low, share, high = (each / whole if whole else 1.0 for each in worth)
        n_faces, uncovered = int(faces.sum()), int((faces & ~covered).sum())
        is_partial = reachable is not None
        found.append(
            Requirement(group, limit, low, share, high, status, n_faces, uncovered, is_partial)
        )
    return tuple(found)


WHOLE_REL = 1e-6
"""Part of the area of a face that cameras may miss and still cover all of it, for people: the
chords of the angle of incidence cut off as much."""


def whole_faces(areas: AreaNetwork, views: int | Mapping[str, int]) -> BoolArray:
    """(F,) faces that a network covers as a whole."""
    from rastercov.coverage.area.frames import frames_of

    mesh, rows = areas.mesh, np.arange(areas.mesh.n_faces)
    level = np.minimum(views_of(mesh, views), areas.views) - 1
    found: BoolArray = areas.covered.area[level, rows] >= (1 - WHOLE_REL) * frames_of(mesh).areas
    return found


def judge_areas(
    areas: AreaNetwork,
    limits: Mapping[str | None, float],
    views: int | Mapping[str, int],
    reachable: AreaNetwork | None = None,
) -> tuple[AreaRequirement, ...]:
    """Evaluate each required share by exact area with its bound; arguments as for `judge`.

    A requirement holds where the certainly covered area reaches it, fails where the area with its
    bound does not. With `reachable`, shares are of the area that it covers, with its bound, too.
    """
    mesh, is_whole = areas.mesh, whole_faces(areas, views)
    found = []
    for group, limit in limits.items():
        faces, total, area, bound = np.zeros(mesh.n_faces, np.bool_), 0.0, 0.0, 0.0
        of_bound = 0.0
        for row, each in enumerate(mesh.groups):
            if each.is_occluder or group not in (None, each.name):
                continue
            members = mesh.face_group == row
            number = views.get(each.name, 1) if isinstance(views, Mapping) else views
            figures = areas.of_faces(members, number)
            faces |= members
            if reachable is None:
                total += figures["of_m2"]
            else:
                most = reachable.of_faces(members, number)
                total += most["m2"]
                of_bound += most["bound_m2"]
            area += figures["m2"]
            bound += figures["bound_m2"]
        ends = ((area - bound, total + of_bound), (area, total), (area + bound, total - of_bound))
        low, share, high = (
            min(max(part / whole, 0.0), 1.0) if whole > 0 else 1.0 for part, whole in ends
        )
        needed = limit - SHARE_TOLERANCE
        status = HOLDS if low >= needed else UNDECIDED if high >= needed else FAILS
        uncovered = int((faces & ~is_whole).sum())
        found.append(
            AreaRequirement(
                group,
                limit,
                low,
                share,
                high,
                status,
                int(faces.sum()),
                uncovered,
                reachable is not None,
                m2=area,
                bound_m2=bound,
                of_m2=total,
            )
        )
    return tuple(found)


def limits_of(selection: SelectionSection | None) -> dict[str | None, float]:
    """Required shares of a plan, of all (None) and of groups; none for the best coverage."""
    if not isinstance(selection, FewestSelection):
        return {}
    return {None: selection.coverage, **selection.groups}


def counting(task: TaskSection) -> dict[str, Any]:
    """Arguments of `problem_of` and `Objective.of` from the task of a plan."""
    return {name: getattr(task, name) for name in ("weight_by", "views")}
