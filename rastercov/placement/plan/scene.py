"""Scene of a plan, its meshes and targets joined, and its candidates within the constraints.

Errors that need the meshes, such as an unknown group, are found here and reported like all errors
of a plan. The entries of a `Plan` call the generators of `pool` and `mounting`; `PoseSpace` judges
their candidates.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from rastercov.base import (
    ByName,
    ByteArray,
    FloatArray,
    MeshError,
    RastercovError,
    frozen_record,
    norm,
    plural,
    sort_order,
)
from rastercov.core.area.remedies import IsFree, Places, outside_of_matter
from rastercov.core.camera.conventions import unique_names
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.groups import FileGroups, Names, names_beside, refuse_twice
from rastercov.placement.candidates import mounting
from rastercov.placement.candidates.pool import Candidates, Framing, Refusal, by_words, in_words
from rastercov.placement.candidates.rooms import (
    KeepOutBox,
    KeepOutSphere,
    Place,
    around_faces,
    between_heights,
    clip_sheet,
    nearest_obstacle,
)
from rastercov.placement.candidates.segments import Segmentation
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.plan.entries import Entry, no_limit, value_of
from rastercov.placement.plan.file import Plan, PlanError, errors_at, moving_bodies
from rastercov.placement.plan.generator import Framed, Generator, GeneratorScene
from rastercov.placement.plan.generators import PerCavity, PerSegment
from rastercov.placement.plan.phases import carriers, hooks
from rastercov.placement.plan.sections import MeshEntry, TargetEntry, TransformEntry
from rastercov.placement.targets import (
    LAYERS,
    box_grid,
    count_for,
    faces_on,
    sheet_above,
    with_target,
)

AnyEntry = TypeVar("AnyEntry", bound=Entry)


def scene(plan: Plan) -> Mesh:
    """All meshes and targets of a plan as one, see `name_scene`."""
    return name_scene(plan)[0]


def name_scene(plan: Plan) -> tuple[Mesh, Plan, Names]:
    """All meshes and targets of a plan as one, with the roles of their groups.

    Groups keep their names where there is one mesh; of several they are `file/group`. Each target
    is a group behind them.

    Returns
    -------
    Mesh, Plan, Names
        The scene, the plan with names of groups wherever it names files or has wildcards, and the
        names that it may use. The scene beside the turntable of an arm is in `Plan.table`.

    Raises
    ------
    PlanError
        With a line for each file that is not a mesh, each unknown group, each target that cannot be
        made, and each mesh that is there twice.
    """
    parts: list[Mesh] = []
    entries: list[MeshEntry] = []
    lines: list[str] = []
    for row, entry in enumerate(plan.meshes):
        try:
            parts.append(_load_entry(plan, entry))
            own = [group.name for group in parts[-1].groups]
            names = Names(own, [FileGroups(str(entry.built_in or entry.path), own)])
            entries.append(_with_names(entry, f"meshes[{row}]", names, lines))
        except RastercovError as error:
            lines.append(f"meshes[{row}]: {error}")
    if lines:
        raise PlanError(plan.name, lines)
    plan = plan.model_copy(update={"meshes": entries})
    files = [entry.built_in or str(entry.path) for entry in entries]
    with errors_at(plan.name, "meshes", MeshError):
        refuse_twice((f, part.vertices, part.faces) for f, part in zip(files, parts, strict=True))
    mesh = parts[0] if len(parts) == 1 else _join_meshes(plan, parts)
    groups = iter(mesh.groups)
    of_files = [
        FileGroups(
            file,
            [group.name for group in islice(groups, len(part.groups))],
        )
        for file, part in zip(files, parts, strict=True)
    ]
    mesh = _with_roles(plan, mesh, [[group.name for group in part.groups] for part in parts])
    plan = plan.with_rooms(mesh)
    is_carried = any(each.is_carried for each in plan.candidates)
    bodies = moving_bodies(() if is_carried else plan.bodies, plan.folder, plan.name)
    mesh = Mesh.joined([mesh, *(each.mesh for each in bodies)]) if bodies else mesh
    mesh, failed = _with_targets(plan, mesh, of_files)
    lines = list(failed.values())
    # Other entries may name targets that could not be made: one line on these is enough.
    names = Names((*(group.name for group in mesh.groups), *failed), of_files)
    changes: ByName = {"task": _with_names(plan.task, "task", names, lines)}
    if plan.selection is not None:
        changes["selection"] = _with_names(plan.selection, "selection", names, lines)
    changes["candidates"] = [
        _with_names(entry, f"candidates[{row}]", names, lines)
        for row, entry in enumerate(plan.candidates)
    ]
    changes["goals"] = {
        name: _with_names(goal, f"goals.{name}", names, lines) for name, goal in plan.goals.items()
    }
    plan = plan.model_copy(update=changes)
    if not mesh.task_mask.any() and not failed:
        lines.append(
            'meshes: expected a group to cover, got occluders only; give one role = "task"'
        )
    if lines:
        raise PlanError(plan.name, lines)
    for each in hooks() if is_carried else ():
        with errors_at(plan.name, next(iter(each.sections), each.key)):
            if (result := each.table(plan, mesh)) is not None:
                mesh, table = result
                plan = plan.with_table(table)
    return mesh, plan, names


def _load_entry(plan: Plan, entry: MeshEntry) -> Mesh:
    if entry.built_in is not None:
        mesh = shapes.by_name(entry.built_in)
    else:
        assert entry.path is not None
        path = plan.folder / entry.path
        mesh = Mesh.load(
            path,
            entry.unit,
            drop_invalid=entry.drop_invalid,
            deflection_mm=entry.deflection_mm,
        )
    place = entry.transform
    return mesh if place == TransformEntry() else mesh.moved(**place.model_dump())


def _join_meshes(plan: Plan, parts: Sequence[Mesh]) -> Mesh:
    """One mesh of several, in their order."""
    files = [entry.built_in or plan.folder / str(entry.path) for entry in plan.meshes]
    own = [
        [entry.built_in]
        if entry.built_in and len(part.groups) == 1
        else [g.name for g in part.groups]
        for entry, part in zip(plan.meshes, parts, strict=True)
    ]
    return Mesh.joined(parts, unique_names(names_beside(files, own), "group"))


def _with_roles(plan: Plan, mesh: Mesh, names: Sequence[Sequence[str]]) -> Mesh:
    """The mesh with each group an occluder, a target, or two-sided, as the entry of its file says.

    Entries use the group names of the file.
    """
    hiding: list[str] = []
    two_sided: list[str] = []
    transparent: list[str] = []
    groups = iter(mesh.groups)
    for entry, own in zip(plan.meshes, names, strict=True):
        for name in own:
            group = next(groups)
            has_role = not entry.groups or name in entry.groups
            if entry.role == "target":
                transparent += [group.name] if has_role else []
            elif has_role == (entry.role == "occluder"):
                hiding.append(group.name)
            if entry.two_sided is True or (entry.two_sided and name in entry.two_sided):
                two_sided.append(group.name)
    return mesh.with_groups(hiding, two_sided, transparent)


def _with_targets(
    plan: Plan, mesh: Mesh, files: Sequence[FileGroups]
) -> tuple[Mesh, dict[str, str]]:
    """The mesh with the targets of the plan, and a line for each that cannot be made, by its name.

    Targets refer to groups of the meshes, not to each other.
    """
    failed, scene_of_meshes = dict[str, str](), mesh
    names = Names((group.name for group in mesh.groups), files)
    for row, entry in enumerate(plan.targets):
        taken = [*(group.name for group in mesh.groups), *failed]
        name = unique_names([*taken, _name_of(entry)], "target")[-1]
        try:
            target = _target(plan, entry, scene_of_meshes, names)
        except RastercovError as error:
            failed[name] = f"targets[{row}]: {error}"
            continue
        both = entry.box is not None if entry.two_sided is None else entry.two_sided
        mesh = with_target(mesh, target, name, two_sided=both)
    return mesh, failed


def _name_of(entry: TargetEntry) -> str:
    """Name of the group of a target."""
    if entry.name or entry.box is not None:
        return entry.name or "volume"
    return Path(entry.file).stem if entry.file else f"{entry.above} + {entry.height:g} m"


def _target(plan: Plan, entry: TargetEntry, mesh: Mesh, names: Names) -> Mesh:
    """Faces of a target."""
    if entry.above is not None:
        assert entry.height is not None
        sheet = sheet_above(mesh, names.groups_of(entry.above), entry.height)
        outlines = []
        if entry.room is not None:
            room = plan.room(entry.room)
            low, high = room.bounds[:, 2].tolist()
            # Not above floors of storeys below, whose sheets pass through the room.
            own = low + max(entry.height - LAYERS, 0.0)
            is_there = (own <= sheet.vertices[:, 2]) & (sheet.vertices[:, 2] <= high)
            sheet = between_heights(sheet, own if is_there.any() else low, high)
            outlines.append(room.outline(float(sheet.bounds[:, 2].mean())))
        if entry.near:
            near = [group for each in entry.near for group in names.groups_of(each)]
            outlines.append(around_faces(mesh, near, entry.within or 1.0))
        sheet = clip_sheet(sheet, outlines) if outlines else sheet
        if entry.facing is None:
            return sheet
        lengths = {"spacing": entry.spacing, "size": entry.size}
        return faces_on(sheet, entry.facing, **{name: x for name, x in lengths.items() if x})
    if entry.file is not None:
        return Mesh.load(plan.folder / entry.file, entry.unit)
    assert entry.box is not None
    low, high = entry.box
    count = entry.count or [1, 1, 1]
    if entry.spacing:
        count = count_for(low, high, entry.spacing).tolist()
    return box_grid(low, high, count, entry.size)


ANYWHERE = [([-1e100] * 3, [1e100] * 3)]
"""Box of all places."""
OF_GROUPS = ("groups", "two_sided", "nearest", "views")
"""Entries with names of groups: lists of them, or values by them."""


def _with_names(entry: AnyEntry, path: str, names: Names, lines: list[str]) -> AnyEntry:
    """An entry with names of groups where it has others; `lines` gets one for each unknown name."""

    def find_known(at: str, value: object, find: Callable[[Any], Any]) -> Any:
        try:
            return find(value)
        except MeshError as error:
            lines.append(f"{at}: {error}")
            return []

    changes: ByName = {}
    for field in type(entry).model_fields:
        value, at = getattr(entry, field), f"{path}.{field}"
        if isinstance(value, list) and field in OF_GROUPS:
            items = [each for name in value for each in find_known(at, name, names.groups_of)]
            changes[field] = list(dict.fromkeys(items))
        elif isinstance(value, dict) and field in OF_GROUPS:
            find = names.places_of if field == "groups" else names.groups_of
            changes[field] = find_known(at, value, partial(names.by_group, find=find))
        elif isinstance(value, Entry):
            changes[field] = _with_names(value, at, names, lines)
        elif isinstance(value, list) and any(isinstance(each, Entry) for each in value):
            changes[field] = [
                _with_names(each, f"{at}[{row}]", names, lines) for row, each in enumerate(value)
            ]
    return entry.model_copy(update=changes)


Part = tuple[Candidates, float]
DROPPED = {
    "too_far": "further than the stand-off",
    "too_near": "nearer than the stand-off or the clearance",
    "kept_out": "inside keep-out volume '{}'",
    "in_solid": "in or behind {}",
    "outside": "outside the spaces",
}
"""Words for the constraint that candidates violate, by the name of `Place`."""


@frozen_record
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
    refused : tuple of Refusal
        Views that nothing can carry, and candidates at forbidden positions.
    space : PoseSpace
        Constraints for optimisation and refinement.
    parts : tuple of (Candidates, float)
        Candidates of each entry before the filter, with the cost of one of them.
    """

    candidates: Candidates
    costs: FloatArray
    made: dict[str, int]
    proposed: Candidates
    refused: tuple[Refusal, ...]
    space: PoseSpace
    parts: tuple[Part, ...]

    def lines(self) -> list[str]:
        """Counts of candidates made and dropped, in words."""
        total = plural(sum(self.made.values()), "candidate")
        made = ", ".join(f"{source} {count:,}" for source, count in self.made.items())
        if not self.refused:
            return [f"{total}{', by source: ' * bool(made)}{made}"]
        lines = [f"generated, by source: {made}"] if len(self.made) > 1 else []
        line = f"{total}: {in_words(self.refused)}; {len(self.candidates)} remain"
        behind = [each.source for each in self.refused if each.reason == "in_solid"]
        if 2 * sum(map(behind.count, ("walls", "ceiling"))) > sum(self.made.values()):
            line += "; these walls are of the bounding box: generator in_room takes the mesh's"
        return [line, *lines]

    def summary(self) -> ByName:
        """Counts, ready for JSON."""
        left = self.candidates
        is_row = np.char.startswith(left.source, "poses") & (left.index >= 0)
        rows = {"rows_left": np.unique(left.index[is_row]).tolist()} if is_row.any() else {}
        why = {"why": by_words(self.refused), **rows} if self.refused else {}
        return {
            "made": self.made,
            "dropped": dict(Counter(each.reason for each in self.refused)),
            **why,
            "left": left.counts(),
        }


def segmentation_of(plan: Plan, mesh: Mesh) -> Segmentation | None:
    """Segments for the first `per_segment` entry; None where there is no such entry."""
    own = (entry for entry in plan.candidates if isinstance(entry, PerSegment))
    return next((entry.segment(mesh) for entry in own), None)


def candidate_pool(plan: Plan, mesh: Mesh) -> CandidatePool:
    """Candidates of all entries but `per_cavity`, which depends on the visibility of the others.

    There are some for each camera and rig of an entry.

    Raises
    ------
    PlanError
        With a line for every entry that fails.
    """
    parts: list[Part] = []
    lines: list[str] = []
    for row, entry in enumerate(plan.candidates):
        if isinstance(entry, PerCavity) or not entry.is_of_cameras:
            continue
        try:
            for index, cost in mounts_of_entry(plan, entry):
                made = _make_candidates(plan, mesh, entry, index)
                parts += [(part.of_camera(index), cost) for part in made]
        except RastercovError as error:
            lines.append(f"candidates[{row}]: {error}")
    if lines:
        raise PlanError(plan.name, lines)
    return filter_pool(plan, mesh, parts)


def mounts_of_entry(plan: Plan, entry: Generator) -> list[tuple[int, float]]:
    """Index of each camera and rig of an entry, and its cost at a place of it."""
    names = plan.mounts.names
    return [
        (index, plan.cost_of(names[index], entry.cost)) for index in plan.mounts_of(entry.cameras)
    ]


def filter_pool(plan: Plan, mesh: Mesh, parts: Sequence[Part]) -> CandidatePool:
    """Pool of the candidates that satisfy the constraints of the plan.

    Without spaces of its own, a plan allows boxes around its candidates.
    """
    limits = plan.constraints
    candidates = Candidates(np.zeros((0, 4, 4)), np.zeros(0, np.int16), np.zeros(0, np.int64), ())
    given = Candidates.of(plan.there.world_from_camera, "existing", plan.there.ids)
    given = replace(given, camera=frozen(plan.there.camera))
    candidates = sum((part for part, _ in parts), given if len(given) else candidates)
    costs = [np.full(len(part), cost) for part, cost in parts]
    if limits.spaces and not plan.table:
        boxes = [np.array([space.low, space.high]) for space in limits.spaces]
    else:
        boxes = [box for part, _ in parts for box in _boxes(part)]
    space = space_of(plan, mesh, np.array(boxes) if boxes else mesh.bounds)
    place = space.judge(candidates.poses[:, :3, 3])
    place[: len(given)] = Place.ALLOWED
    allowed = place == Place.ALLOWED
    made = candidates.counts()
    for each in candidates.refused:
        made[each.source] = made.get(each.source, 0) + 1
    return CandidatePool(
        candidates=candidates.take(allowed),
        costs=np.concatenate([np.zeros(len(given)), *costs])[allowed],
        made=made,
        proposed=candidates,
        refused=(*candidates.refused, *_refusals_of(mesh, space, candidates, place)),
        space=space,
        parts=tuple(parts),
    )


def _refusals_of(
    mesh: Mesh, space: PoseSpace, candidates: Candidates, place: ByteArray
) -> Iterator[Refusal]:
    """Candidates at forbidden positions."""
    rows = np.flatnonzero(place != Place.ALLOWED)
    if not len(rows):
        return
    eyes, source, surface = (
        candidates.poses[rows, :3, 3],
        candidates.source[rows],
        nearest_obstacle(mesh),
    )
    near = np.zeros(len(rows), np.int64) if surface is None else surface.query(eyes).face
    for row, name, face in zip(rows, source, near, strict=True):
        kind = Place(place[row])
        what = mesh.groups[mesh.face_group[face]].name
        if kind == Place.KEPT_OUT:
            eye = candidates.poses[row : row + 1, :3, 3]
            what = next(each.name for each in space.keep_out if each.contains(eye)[0])
        key = kind.name.lower()
        words = DROPPED[key].format(what)
        yield Refusal(
            candidates.poses[row], str(name), key, words, camera=int(candidates.camera[row])
        )


def places_of(plan: Plan, mesh: Mesh, *, is_anywhere: bool = False) -> Places:
    """Of places for a camera that advice would name, those that satisfy the constraints.

    With `is_anywhere` those outside of the spaces for cameras, too.
    """
    space = space_of(plan, mesh, np.array(ANYWHERE) if is_anywhere else None)
    return lambda at, places: places[space.allows(places)]


def space_of(plan: Plan, mesh: Mesh, boxes: FloatArray | None = None) -> PoseSpace:
    """Constraints of a plan on camera centres, in boxes, (B, 2, 3), or in its spaces if any.

    Where a turntable turns the scene before them, neither volumes nor spaces are of them.
    """
    limits = plan.constraints
    spaces = [(each.low, each.high) for each in limits.spaces if not plan.table]
    return PoseSpace(
        mesh=mesh,
        boxes=np.array(spaces or ANYWHERE) if boxes is None else boxes,
        stand_off=no_limit(limits.stand_off),
        clearance=limits.clearance,
        keep_out=[] if plan.table else keep_outs(plan),
    )


def free_places(plan: Plan, mesh: Mesh, kept: float) -> IsFree:
    """Places outside bodies of a scene that keep the clearance of a plan, else `kept`, metres."""
    limits = plan.constraints
    return outside_of_matter(
        mesh, limits.clearance if "clearance" in limits.model_fields_set else kept
    )


def places_of_candidates(eyes: FloatArray) -> Places:
    """For places that advice would name, as many of those of candidates, (N, 3), the nearest."""
    eyes = np.unique(eyes, axis=0)
    return lambda at, places: eyes[sort_order(norm(eyes - at))[: len(places)]]


def keep_outs(plan: Plan) -> Sequence[KeepOutBox | KeepOutSphere]:
    """Keep-out volumes of a plan."""
    return [entry.volume() for entry in plan.constraints.keep_out]


def framing_of(plan: Plan, entry: Generator) -> Framing:
    """Framing of the candidates of an entry.

    An entry without a stand-off of its own has that of the constraints.
    """
    others: ByName = {"max_blur": plan.task.max_blur}
    if isinstance(entry, Framed):
        others["stand_off"] = no_limit(entry.stand_off or plan.constraints.stand_off)
    return value_of(entry, Framing, **others)


def _make_candidates(plan: Plan, mesh: Mesh, entry: Generator, index: int) -> Iterator[Candidates]:
    """Candidates of an entry for a mount by its index; once for each aim."""
    for each in carriers() if entry.is_carried else ():
        yield from each.make(
            plan, mesh, entry, lambda other: _make_candidates(plan, mesh, other, index)
        )
        return
    own = plan.folder, plan.room, plan.constraints.clearance
    spot = GeneratorScene(mesh, plan.mounts, index, framing_of(plan, entry), *own)
    yield from entry.make(spot)


def _boxes(part: Candidates) -> Iterator[FloatArray]:
    """(2, 3) boxes of the allowed positions of an entry, where the plan has no spaces.

    Mounted cameras stay on the sides of their box, and those on the mesh in a room where they are;
    others may move within their bounding box.
    """
    eyes = part.poses[:, :3, 3]
    mounts = {"walls": mounting.WALLS, "ceiling": mounting.CEILING, "box": mounting.SIDES}
    if len(eyes) and part.sources[0] in mounts:
        for side in mounts[part.sources[0]]:
            axis, end = mounting.SIDES.index(side) // 2, mounting.SIDES.index(side) % 2
            level = (eyes.min(axis=0), eyes.max(axis=0))[end][axis]
            on_side = eyes[eyes[:, axis] == level]
            yield np.stack((on_side.min(axis=0), on_side.max(axis=0)))
    elif part.sources[0].startswith(mounting.IN_ROOM):
        yield from np.stack((eyes, eyes), axis=1)
    elif len(eyes):
        yield np.stack((eyes.min(axis=0), eyes.max(axis=0)))
