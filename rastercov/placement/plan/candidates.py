"""Candidate pool of a plan: poses of all its entries that satisfy its constraints.

The entries of a `Plan` call the generators of `pool` and `mounting`; `filter_candidates` and
`PoseSpace` drop candidates, with reasons.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import RastercovError
from rastercov.base.format import plural
from rastercov.camera.formats import read_views
from rastercov.camera.rig import Rig
from rastercov.mesh import Mesh
from rastercov.placement.candidates import mounting, pool
from rastercov.placement.candidates.clearance import Dropped, KeepOut, filter_candidates
from rastercov.placement.candidates.framing import Framing
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.improve.pose_space import Place, PoseSpace
from rastercov.placement.plan import sections as entries
from rastercov.placement.plan.file import Plan, PlanError
from rastercov.placement.plan.sections import no_limit, value_of

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
    proposed : Candidates
        Those candidates.
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
    proposed: Candidates
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
        lines = [f"{plural(total, 'candidate')}: {made}"]
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
    own = (entry for entry in plan.candidates if isinstance(entry, entries.PerSegment))
    return next((_segmented(mesh, entry) for entry in own), None)


def candidate_pool(plan: Plan, mesh: Mesh) -> CandidatePool:
    """Candidates of all entries but `per_cavity`, which depends on the visibility of the others.

    There are some for each camera and rig of an entry.

    Raises
    ------
    PlanError
        With a line for every entry that fails.
    """
    parts: list[tuple[Candidates, float]] = []
    lines: list[str] = []
    for row, entry in enumerate(plan.candidates):
        if isinstance(entry, entries.PerCavity):
            continue
        try:
            for index, cost in mounts_of_entry(plan, entry):
                made = _made(plan, mesh, entry, index)
                parts += [(part.of_camera(index), cost) for part in made]
        except RastercovError as error:
            lines.append(f"candidates[{row}]: {error}")
    if lines:
        raise PlanError(plan.name, lines)
    return _filtered(plan, mesh, parts, [])


def mounts_of_entry(plan: Plan, entry: entries.Generator) -> list[tuple[int, float]]:
    """Index of each camera and rig of an entry, and its cost at a place of it."""
    names = plan.mounts.names
    return [
        (index, plan.cost_of(names[index], entry.cost)) for index in plan.mounts_of(entry.cameras)
    ]


def extended_pool(
    plan: Plan, mesh: Mesh, before: CandidatePool, parts: Sequence[tuple[Candidates, float]]
) -> CandidatePool:
    """The pool with further candidates, each part with the cost of one of them."""
    fresh = _filtered(plan, mesh, parts, before.boxes)
    return replace(
        fresh,
        candidates=before.candidates + fresh.candidates,
        costs=np.concatenate((before.costs, fresh.costs)),
        made=before.made | fresh.made,
        proposed=before.proposed + fresh.proposed,
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
        proposed=found,
        dropped=dropped,
        misplaced=misplaced,
        space=space,
        boxes=tuple(boxes),
    )


def keep_outs(plan: Plan) -> list[KeepOut]:
    """Keep-out volumes of a plan."""
    return [entry.volume() for entry in plan.constraints.keep_out]


def framing_of(plan: Plan, entry: entries.Generator) -> Framing:
    """Framing of the candidates of an entry.

    An entry without a stand-off of its own has that of the constraints.
    """
    others: dict[str, Any] = {"max_blur": plan.task.max_blur}
    if isinstance(entry, entries.Framed):
        others["stand_off"] = no_limit(entry.stand_off or plan.constraints.stand_off)
    return value_of(entry, Framing, **others)


def _made(
    plan: Plan, mesh: Mesh, entry: entries.CandidateEntry, index: int
) -> Iterator[Candidates]:
    """Candidates of an entry for a mount by its index; once for each aim.

    Fields of an entry that its base class lacks are the arguments of its generator.
    """
    mounts = plan.mounts
    view = (mesh, mounts.first_camera(index), framing_of(plan, entry))
    match entry:
        case entries.PerSegment():
            yield pool.per_segment(*view, segmentation=_segmented(mesh, entry))
        case entries.PerFace():
            wanted = [g.name in entry.groups or not entry.groups for g in mesh.groups]
            faces = mesh.task_mask & np.array(wanted)[mesh.face_group]
            yield pool.per_face(*view, faces=faces)
        case entries.PerConvexRegion():
            yield pool.per_convex_region(*view, least_bend_deg=entry.least_bend_deg)
        case entries.Around():
            around = getattr(mounting, entry.generator)
            yield around(*view, **_own(entry, entries.Framed))
        case entries.PoseFile():
            found = pool.from_poses(*view, poses=plan.folder / entry.file)
            views = read_views(plan.folder / entry.file)
            if len(mounts) > 1 and views.camera_names:  # each pose has its own camera
                firsts = [mounts.first_camera(row) for row in range(len(mounts))]
                of_pose = views.with_cameras(Rig(firsts, mounts.names)).poses.camera
                found = found.take(of_pose[found.index] == index)
            yield found
        case entries.Mounted():
            mount = getattr(mounting, entry.generator)
            bounds = None if entry.low is None else np.array([entry.low, entry.high])
            given = {"spacing": entry.spacing, "bounds": bounds} | _own(entry, entries.Mounted)
            for aim in entry.aim:
                yield mount(*view, aim=_rule(aim), **given)


def _own(entry: entries.Generator, base: type[entries.Generator]) -> dict[str, Any]:
    return entry.model_dump(exclude={"generator", *base.model_fields})


def _rule(aim: entries.Aim) -> mounting.Aim:
    if aim.point is not None:
        return mounting.at_point(aim.point)
    if aim.direction is not None:
        return mounting.along(aim.direction)
    if aim.nearest is not None:
        return mounting.at_nearest_surface(aim.nearest or None)
    return mounting.at_middle()


def _segmented(mesh: Mesh, entry: entries.PerSegment) -> Segmentation:
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
