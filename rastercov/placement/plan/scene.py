"""Scene of a plan: its meshes joined, with the roles of their groups, and its targets.

Errors that need the meshes, such as an unknown group, are found here and reported like all errors
of a plan.
"""

from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np

from rastercov.base.errors import MeshError, RastercovError
from rastercov.mesh import Group, Mesh, shapes
from rastercov.mesh.groups import FileGroups, Names, refuse_twice
from rastercov.mesh.targets import box_grid, count_for, sheet_above, with_target
from rastercov.placement.plan.file import Plan, PlanError
from rastercov.placement.plan.sections import (
    FewestSelection,
    MeshEntry,
    Mounted,
    PerFace,
    TargetEntry,
    TransformEntry,
)


def scene(plan: Plan) -> Mesh:
    """All meshes and targets of a plan as one, see `named_scene`."""
    return named_scene(plan)[0]


def named_scene(plan: Plan) -> tuple[Mesh, Plan, Names]:
    """All meshes and targets of a plan as one, with the roles of their groups.

    Groups keep their names where there is one mesh; of several they are `file/group`. Each target
    is a group behind them.

    Returns
    -------
    Mesh, Plan, Names
        The scene, the plan with names of groups wherever it names files or has wildcards, and the
        names that it may use.

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
            parts.append(_loaded(plan, entry))
            entries.append(_with_groups(entry, parts[-1], f"meshes[{row}]", lines))
        except RastercovError as error:
            lines.append(f"meshes[{row}]: {error}")
    if lines:
        raise PlanError(plan.name, lines)
    plan = plan.model_copy(update={"meshes": entries})
    files = [entry.built_in or str(entry.path) for entry in entries]
    try:
        refuse_twice((f, part.vertices, part.faces) for f, part in zip(files, parts, strict=True))
    except MeshError as error:
        raise PlanError(plan.name, [f"meshes: {error}"]) from None
    mesh = parts[0] if len(parts) == 1 else _joined(plan, parts)
    groups = iter(mesh.groups)
    of_files = [
        FileGroups(file, [group.name for group in islice(groups, len(part.groups))])
        for file, part in zip(files, parts, strict=True)
    ]
    mesh = _with_roles(plan, mesh, [[group.name for group in part.groups] for part in parts])
    mesh, lines = _with_targets(plan, mesh, of_files)
    names = Names((group.name for group in mesh.groups), of_files)
    plan = _with_names(plan, names, lines)
    if not mesh.task_mask.any():
        lines.append('meshes: every group is an occluder; leave at least one with role = "task"')
    if lines:
        raise PlanError(plan.name, lines)
    return mesh, plan, names


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


def _with_targets(plan: Plan, mesh: Mesh, files: Sequence[FileGroups]) -> tuple[Mesh, list[str]]:
    """The mesh with the targets of the plan, and a line for each that cannot be made.

    Targets refer to groups of the meshes, not to each other.
    """
    lines, scene_of_meshes = [], mesh
    names = Names((group.name for group in mesh.groups), files)
    for row, entry in enumerate(plan.targets):
        field = next(name for name in ("above", "box", "file") if getattr(entry, name) is not None)
        try:
            target, name = _target(plan, entry, scene_of_meshes, names)
        except RastercovError as error:
            lines.append(f"targets[{row}].{field}: {error}")
            continue
        name = _free(name, [group.name for group in mesh.groups])
        both = entry.box is not None if entry.two_sided is None else entry.two_sided
        mesh = with_target(mesh, target, name, two_sided=both)
    return mesh, lines


def _target(plan: Plan, entry: TargetEntry, mesh: Mesh, names: Names) -> tuple[Mesh, str]:
    """Faces of a target, and the name of its group."""
    if entry.above is not None:
        assert entry.height is not None
        name = entry.name or f"{entry.above} + {entry.height:g} m"
        return sheet_above(mesh, names.groups_of(entry.above), entry.height), name
    if entry.file is not None:
        path = plan.folder / entry.file
        return Mesh.load(path, entry.unit), entry.name or path.stem
    assert entry.box is not None
    low, high = entry.box
    count = entry.count or [1, 1, 1]
    if entry.spacing:
        count = count_for(low, high, entry.spacing).tolist()
    return box_grid(low, high, count, entry.size), entry.name or "volume"


def _with_groups(entry: MeshEntry, mesh: Mesh, path: str, lines: list[str]) -> MeshEntry:
    """The entry of a mesh with names of groups of its file; `lines` as for `_groups`."""
    own = [group.name for group in mesh.groups]
    names = Names(own, [FileGroups(str(entry.built_in or entry.path), own)])
    changes: dict[str, Any] = {"groups": _groups(f"{path}.groups", entry.groups, names, lines)}
    if isinstance(entry.two_sided, list):
        changes["two_sided"] = _groups(f"{path}.two_sided", entry.two_sided, names, lines)
    return entry.model_copy(update=changes)


def _with_names(plan: Plan, names: Names, lines: list[str]) -> Plan:
    """The plan with names of groups where it has others; `lines` gets one for each unknown name."""
    changes: dict[str, Any] = {}

    def by_group(path: str, values: Any) -> Any:
        try:
            return names.by_group(values)
        except MeshError as error:
            lines.append(f"{path}: {error}")

    if isinstance(plan.task.views, dict):
        views = by_group("task.views", plan.task.views)
        changes["task"] = plan.task.model_copy(update={"views": views})
    if isinstance(plan.selection, FewestSelection):
        shares = by_group("selection.groups", plan.selection.groups)
        changes["selection"] = plan.selection.model_copy(update={"groups": shares})
    candidates = []
    for row, entry in enumerate(plan.candidates):
        at = f"candidates[{row}]"
        if isinstance(entry, PerFace):
            groups = _groups(f"{at}.groups", entry.groups, names, lines)
            entry = entry.model_copy(update={"groups": groups})
        elif isinstance(entry, Mounted):
            aims = []
            for place, aim in enumerate(entry.aim):
                near = _groups(f"{at}.aim[{place}].nearest", aim.nearest or [], names, lines)
                aims.append(
                    aim if aim.nearest is None else aim.model_copy(update={"nearest": near})
                )
            entry = entry.model_copy(update={"aim": aims})
        candidates.append(entry)
    return plan.model_copy(update=changes | {"candidates": candidates})


def _groups(path: str, given: Sequence[str], names: Names, lines: list[str]) -> list[str]:
    """Groups of the given names; `lines` gets one for each unknown name."""
    found: list[str] = []
    for name in given:
        try:
            found += names.groups_of(name)
        except MeshError as error:
            lines.append(f"{path}: {error}")
    return list(dict.fromkeys(found))
