"""Candidate pool of a plan: poses of all its entries that satisfy its constraints.

The entries of a `Plan` call the generators of `pool` and `mounting`; `filter_candidates` and
`PoseSpace` drop candidates, with reasons.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.errors import RastercovError
from rastercov.mesh import Mesh
from rastercov.placement.candidates import mounting
from rastercov.placement.candidates import pool as generators
from rastercov.placement.candidates.clearance import (
    Dropped,
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    filter_candidates,
)
from rastercov.placement.candidates.framing import Framing
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.improve.pose_space import Place, PoseSpace
from rastercov.plan.entry import no_limit
from rastercov.plan.errors import PlanError
from rastercov.plan.file import Plan
from rastercov.plan.generators import (
    Aim,
    Around,
    Framed,
    Mounted,
    OnBox,
    OnCeiling,
    OnWalls,
    PerCavity,
    PerConvexRegion,
    PerFace,
    PerSegment,
    PoseFile,
    Square,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CandidatePool:
    """Candidates of a plan at allowed positions, and reasons for the dropped ones.

    Attributes
    ----------
    candidates : Candidates
    costs : (C,) float64
        Cost of each candidate.
    made : dict of str to int
        Candidates of each source before the filter.
    dropped : Dropped
        Reasons of the candidates dropped by clearance and keep-out volumes.
    misplaced : dict of str to int
        Counts of the others that violate limits of the plan, by the name of `Place`.
    space : PoseSpace
        Constraints for optimisation and refinement.
    boxes : tuple of (2, 3) float64
        Its boxes.
    """

    candidates: Candidates
    costs: FloatArray
    made: dict[str, int]
    dropped: Dropped
    misplaced: dict[str, int]
    space: PoseSpace
    boxes: tuple[FloatArray, ...]

    def lines(self) -> list[str]:
        """Counts of candidates made and dropped, for people."""
        total = sum(self.made.values())
        made = ", ".join(f"{count} {source}" for source, count in self.made.items())
        words = {"too_far": "further than the stand-off", "too_near": "nearer than the stand-off"}
        words |= {"outside": "outside the spaces"}
        lines = [f"{total} candidates: {made}"]
        if total > self.dropped.kept_mask.sum():
            lines.append(str(self.dropped))
        if self.misplaced:
            why = ", ".join(f"{n} {words.get(name, name)}" for name, n in self.misplaced.items())
            lines.append(f"{sum(self.misplaced.values())} more dropped: {why}")
        return lines

    def summary(self) -> dict[str, Any]:
        """Counts, ready for JSON."""
        return {
            "made": self.made,
            "dropped": self.dropped.summary(),
            "misplaced": self.misplaced,
            "left": self.candidates.counts(),
        }


def segmentation_of(plan: Plan, mesh: Mesh) -> Segmentation | None:
    """Segments for the first `per_segment` entry; None where there is no such entry."""
    for entry in plan.candidates:
        if isinstance(entry, PerSegment):
            return _segmented(mesh, entry)
    return None


def candidate_pool(plan: Plan, mesh: Mesh, camera: Camera) -> CandidatePool:
    """Candidates of all entries but `per_cavity`, which depends on the visibility of the others.

    Raises
    ------
    PlanError
        With a line for every entry that fails.
    """
    parts: list[tuple[Candidates, float]] = []
    lines: list[str] = []
    for row, entry in enumerate(plan.candidates):
        if isinstance(entry, PerCavity):
            continue
        try:
            parts += [(part, entry.cost) for part in _made(plan, mesh, camera, entry)]
        except RastercovError as error:
            lines.append(f"candidates[{row}]: {error}")
    if lines:
        raise PlanError(plan.name, lines)
    return _filtered(plan, mesh, parts, [])


def extended_pool(
    plan: Plan, mesh: Mesh, before: CandidatePool, found: Candidates, cost: float
) -> CandidatePool:
    """The pool with further candidates at the same cost each."""
    fresh = _filtered(plan, mesh, [(found, cost)], before.boxes)
    return replace(
        fresh,
        candidates=before.candidates + fresh.candidates,
        costs=np.concatenate((before.costs, fresh.costs)),
        made=before.made | fresh.made,
        dropped=before.dropped,
        misplaced={
            name: before.misplaced.get(name, 0) + fresh.misplaced.get(name, 0)
            for name in before.misplaced | fresh.misplaced
        },
    )


def _filtered(
    plan: Plan, mesh: Mesh, parts: Sequence[tuple[Candidates, float]], known: Sequence[FloatArray]
) -> CandidatePool:
    """Pool of the candidates that satisfy the constraints of the plan.

    Without spaces of its own, a plan allows `known` boxes and those around its candidates.
    """
    limits = plan.constraints
    found = Candidates(np.zeros((0, 4, 4)), np.zeros(0, np.int16), np.zeros(0, np.int64), ())
    costs: list[FloatArray] = [np.zeros(0)]
    for part, cost in parts:
        found += part
        costs.append(np.full(len(part), cost))
    left, dropped = filter_candidates(found, mesh, limits.clearance, keep_outs(plan))
    if limits.spaces:
        boxes = [np.array([space.low, space.high]) for space in limits.spaces]
    else:
        boxes = [*known, *(box for part, _ in parts for box in _boxes(part))]
    space = PoseSpace(
        mesh=mesh,
        boxes=np.array(boxes) if boxes else mesh.bounds,
        stand_off=no_limit(limits.stand_off),
        clearance=limits.clearance,
        keep_out=keep_outs(plan),
    )
    place = space.judge(left.poses[:, :3, 3])
    misplaced = {
        each.name.lower(): int((place == each).sum())
        for each in Place
        if each != Place.ALLOWED and (place == each).any()
    }
    allowed = place == Place.ALLOWED
    return CandidatePool(
        candidates=left.take(allowed),
        costs=np.concatenate(costs)[dropped.kept_mask][allowed],
        made=found.counts(),
        dropped=dropped,
        misplaced=misplaced,
        space=space,
        boxes=tuple(boxes),
    )


def keep_outs(plan: Plan) -> list[KeepOut]:
    """Keep-out volumes of a plan."""
    volumes: list[KeepOut] = []
    for entry in plan.constraints.keep_out:
        if entry.centre is not None:
            assert entry.radius is not None
            volumes.append(KeepOutSphere(_triple(entry.centre), entry.radius, entry.name))
        else:
            assert entry.low is not None
            assert entry.high is not None
            volumes.append(KeepOutBox(_triple(entry.low), _triple(entry.high), entry.name))
    return volumes


def framing_of(plan: Plan, entry: Any) -> Framing:
    """Framing of the candidates of an entry.

    An entry without a stand-off of its own has that of the constraints.
    """
    own: dict[str, Any] = {"rolls_deg": tuple(entry.rolls_deg), "up": _triple(entry.up)}
    if isinstance(entry, Framed):
        own["stand_off"] = no_limit(entry.stand_off or plan.constraints.stand_off)
        own["margin"] = entry.margin
    if isinstance(entry, Square):
        own["fit"] = entry.fit
    return Framing(**own, max_blur=plan.task.max_blur)


def _made(plan: Plan, mesh: Mesh, camera: Camera, entry: Any) -> Iterator[Candidates]:
    """Candidates of an entry; several times for a mount with several aims."""
    view = (mesh, camera, framing_of(plan, entry))
    match entry:
        case PerSegment():
            yield generators.per_segment(*view, segmentation=_segmented(mesh, entry))
        case PerFace():
            wanted = [g.name in entry.groups or not entry.groups for g in mesh.groups]
            faces = mesh.task_mask & np.array(wanted)[mesh.face_group]
            yield generators.per_face(*view, faces=faces)
        case PerConvexRegion():
            yield generators.per_convex_region(*view, least_bend_deg=entry.least_bend_deg)
        case Around():
            around = getattr(mounting, entry.generator)
            sizes = {"count": entry.count, "centre": entry.centre, "distances": entry.distances}
            yield around(*view, **sizes)
        case PoseFile():
            yield generators.from_poses(*view, poses=plan.folder / entry.file)
        case Mounted():
            for aim in entry.aim:
                yield _mounted(view, entry, _rule(aim))


def _mounted(view: tuple[Mesh, Camera, Framing], entry: Mounted, aim: mounting.Aim) -> Candidates:
    bounds = None if entry.low is None else np.array([entry.low, entry.high])
    own: dict[str, Any] = {"spacing": entry.spacing, "aim": aim, "bounds": bounds}
    match entry:
        case OnWalls():
            heights = None if entry.heights is None else (entry.heights[0], entry.heights[1])
            return mounting.on_walls(*view, **own, inset=entry.inset, heights=heights)
        case OnCeiling():
            return mounting.on_ceiling(*view, **own, inset=entry.inset)
        case OnBox():
            return mounting.on_box(*view, **own, outward=entry.outward, sides=entry.sides)
    raise AssertionError(entry)


def _rule(aim: Aim) -> mounting.Aim:
    if aim.point is not None:
        return mounting.at_point(aim.point)
    if aim.direction is not None:
        return mounting.along(aim.direction)
    if aim.nearest is not None:
        return mounting.at_nearest_surface(aim.nearest or None)
    return mounting.at_middle()


def _segmented(mesh: Mesh, entry: PerSegment) -> Segmentation:
    if entry.merge == "none":
        return segment(mesh, entry.alpha_deg, None)
    return segment(
        mesh, entry.alpha_deg, entry.beta_deg, adjacent=entry.adjacent, merge=entry.merge
    )


def _boxes(part: Candidates) -> Iterator[FloatArray]:
    """(2, 3) boxes of the allowed positions of an entry, where the plan has no spaces.

    Mounted cameras stay on the sides of their box; others may move within their bounding box.
    """
    eyes = part.poses[:, :3, 3]
    mounts = {"walls": mounting.WALLS, "ceiling": mounting.CEILING, "box": mounting.SIDES}
    if len(eyes) and part.sources[0] in mounts:
        for side in mounts[part.sources[0]]:
            axis, end = mounting.SIDES.index(side) // 2, mounting.SIDES.index(side) % 2
            level = (eyes.min(axis=0), eyes.max(axis=0))[end][axis]
            on_side = eyes[eyes[:, axis] == level]
            yield np.stack((on_side.min(axis=0), on_side.max(axis=0)))
    elif len(eyes):
        yield np.stack((eyes.min(axis=0), eyes.max(axis=0)))


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    return (values[0], values[1], values[2])
