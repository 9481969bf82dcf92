"""Scene of a plan: its meshes joined, with the roles of their groups, and its targets.

Errors that need the meshes, such as an unknown group, are found here and reported like all errors
of a plan.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rastercov import shapes
from rastercov.errors import RastercovError
from rastercov.mesh import Group, Mesh
from rastercov.mesh.targets import box_grid, count_for, sheet_above, with_target
from rastercov.plan.errors import PlanError
from rastercov.plan.file import Plan
from rastercov.plan.generators import Mounted, PerFace
from rastercov.plan.sections import FewestSelection, MeshEntry, TargetEntry, TransformEntry


def scene(plan: Plan) -> Mesh:
    """All meshes and targets of a plan as one, with the roles of their groups.

    Groups keep their names where there is one mesh; of several they are `file/group`. Each target
    is a group behind them.

    Raises
    ------
    PlanError
        With a line for each file that is not a mesh, each unknown group and each target that
        cannot be made.
    """
    parts: list[Mesh] = []
    lines: list[str] = []
    for row, entry in enumerate(plan.meshes):
        try:
            parts.append(_loaded(plan, entry))
        except RastercovError as error:
            lines.append(f"meshes[{row}]: {error}")
            continue
        known = [group.name for group in parts[-1].groups]
        two_sided = entry.two_sided if isinstance(entry.two_sided, list) else []
        for field, names in (("groups", entry.groups), ("two_sided", two_sided)):
            lines += _unknown_names(f"meshes[{row}].{field}", names, known)
    if lines:
        raise PlanError(plan.name, lines)
    mesh = parts[0] if len(parts) == 1 else _joined(plan, parts)
    mesh = _with_roles(plan, mesh, [[group.name for group in part.groups] for part in parts])
    mesh, lines = _with_targets(plan, mesh)
    lines += _unknown_groups(plan, [group.name for group in mesh.groups])
    if not mesh.task_mask.any():
        lines.append('meshes: every group is an occluder; leave at least one with role = "task"')
    if lines:
        raise PlanError(plan.name, lines)
    return mesh


def _loaded(plan: Plan, entry: MeshEntry) -> Mesh:
    if entry.built_in is not None:
        mesh = shapes.by_name(entry.built_in)
    else:
        assert entry.path is not None
        path = plan.folder / entry.path
        mesh = Mesh.load(path, entry.unit, drop_invalid=entry.drop_invalid)
    place = entry.transform
    return mesh if place == TransformEntry() else mesh.moved(**place.model_dump())


def _joined(plan: Plan, parts: Sequence[Mesh]) -> Mesh:
    """One mesh of several, in their order."""
    names: list[str] = []
    for entry, part in zip(plan.meshes, parts, strict=True):
        stem = entry.built_in or (plan.folder / str(entry.path)).stem
        lone = len(part.groups) == 1
        fresh = [stem if lone else f"{stem}/{group.name}" for group in part.groups]
        names += [_free(name, names) for name in fresh]
    n_vertices = np.cumsum([0] + [part.n_vertices for part in parts])
    n_groups = np.cumsum([0] + [len(part.groups) for part in parts])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + n for p, n in zip(parts, n_vertices, strict=False)]),
        groups=[Group(name) for name in names],
        face_group=np.concatenate(
            [p.face_group + n for p, n in zip(parts, n_groups, strict=False)]
        ),
        source_face=np.concatenate([part.source_face for part in parts]),
        sources=[source for part in parts for source in part.sources],
        notes=[note for part in parts for note in part.notes],
    )


def _free(name: str, taken: Sequence[str]) -> str:
    """`name`, or the first of `name #2`, `name #3` ... that is not taken, as in one file."""
    number, free = 2, name
    while free in taken:
        number, free = number + 1, f"{name} #{number}"
    return free


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


def _with_targets(plan: Plan, mesh: Mesh) -> tuple[Mesh, list[str]]:
    """The mesh with the targets of the plan, and a line for each that cannot be made.

    Targets refer to groups of the meshes, not to each other.
    """
    lines, scene_of_meshes = [], mesh
    for row, entry in enumerate(plan.targets):
        field = next(name for name in ("above", "box", "file") if getattr(entry, name) is not None)
        try:
            target, name = _target(plan, entry, scene_of_meshes)
        except RastercovError as error:
            lines.append(f"targets[{row}].{field}: {error}")
            continue
        name = _free(name, [group.name for group in mesh.groups])
        both = entry.box is not None if entry.two_sided is None else entry.two_sided
        mesh = with_target(mesh, target, name, two_sided=both)
    return mesh, lines


def _target(plan: Plan, entry: TargetEntry, mesh: Mesh) -> tuple[Mesh, str]:
    """Faces of a target, and the name of its group."""
    if entry.above is not None:
        assert entry.height is not None
        name = entry.name or f"{entry.above} + {entry.height:g} m"
        return sheet_above(mesh, entry.above, entry.height), name
    if entry.file is not None:
        path = plan.folder / entry.file
        return Mesh.load(path, entry.unit), entry.name or path.stem
    assert entry.box is not None
    low, high = entry.box
    count = entry.count or [1, 1, 1]
    if entry.spacing:
        count = count_for(low, high, entry.spacing).tolist()
    return box_grid(low, high, count, entry.size), entry.name or "volume"


def _unknown_groups(plan: Plan, known: Sequence[str]) -> Iterator[str]:
    """A line for every group of a plan that no mesh has."""
    if isinstance(plan.task.views, dict):
        yield from _unknown_names("task.views", plan.task.views, known)
    if isinstance(plan.selection, FewestSelection):
        yield from _unknown_names("selection.groups", plan.selection.groups, known)
    for row, entry in enumerate(plan.candidates):
        if isinstance(entry, PerFace):
            yield from _unknown_names(f"candidates[{row}].groups", entry.groups, known)
        if isinstance(entry, Mounted):
            for place, aim in enumerate(entry.aim):
                at = f"candidates[{row}].aim[{place}].nearest"
                yield from _unknown_names(at, aim.nearest or [], known)


def _unknown_names(path: str, names: Any, known: Sequence[str]) -> Iterator[str]:
    for name in names:
        if name not in known:
            yield f"{path}: there is no group {name!r}; groups are {', '.join(known)}"
