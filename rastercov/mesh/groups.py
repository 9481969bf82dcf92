"""Groups of faces: names, roles, and the flag for two-sided faces."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind, flag, members
from rastercov.base.errors import MeshError
from rastercov.mesh.arrays import face_labels
from rastercov.mesh.names import Names


@dataclass(frozen=True)
class Group:
    """A named set of faces.

    Attributes
    ----------
    name : str
        Unique within a mesh.
    is_occluder : bool
        Its faces hide others but are not scored.
    is_two_sided : bool
        Either side of its faces counts as covered.
    is_target : bool
        Its faces are scored but hide nothing: neither other faces nor each other.
    """

    name: str
    is_occluder: bool = False
    is_two_sided: bool = False
    is_target: bool = False

    def __post_init__(self) -> None:
        check_kind("the name of a group", self.name, str, "a text", MeshError)
        for name in ("is_occluder", "is_two_sided", "is_target"):
            object.__setattr__(self, name, flag(name, getattr(self, name)))
        if self.is_occluder and self.is_target:
            raise MeshError(
                f"group {self.name!r} must have one role, got occluder and target; an occluder "
                "hides and is not scored, a target is scored and hides nothing"
            )

    @property
    def role(self) -> str:
        """`"task"` (scored, hides), `"occluder"` (hides) or `"target"` (scored, hides nothing)."""
        return "occluder" if self.is_occluder else "target" if self.is_target else "task"

    def to_json(self) -> dict[str, Any]:
        """Arguments of the constructor, ready for JSON; `is_target` only where it is set.

        So that hashes of scenes without targets, which name matrices on the disk, stay the same.
        """
        fields = asdict(self)
        if not self.is_target:
            del fields["is_target"]
        return fields


def checked_groups(
    groups: Iterable[Group] | None, face_group: ArrayLike | None, n_faces: int
) -> tuple[tuple[Group, ...], NDArray[np.int32]]:
    """Groups of a mesh, by default one, and the (F,) index of each face's group, or MeshError."""
    default = (Group("mesh"),)
    wanted = 'Group values such as [Group("part")]'
    groups = members("groups", default if groups is None else groups, Group, wanted, MeshError)
    names = [group.name for group in groups]
    if not names or len(set(names)) < len(names):
        raise MeshError(f"group names must be unique and at least one, got {names}; rename")
    if face_group is None and len(groups) > 1:
        raise MeshError(f"{len(groups)} groups need face_group, got none; pass (F,) indices")
    labels = face_labels("face_group", 0 if face_group is None else face_group, n_faces)
    if ((labels < 0) | (labels >= len(groups))).any():
        raise MeshError(
            f"face_group must lie in 0 ... {len(groups) - 1}, got {labels.min()} ... "
            f"{labels.max()}; list every group in groups"
        )
    return groups, labels.astype(np.int32)


def flagged(
    names: Names,
    groups: Sequence[Group],
    occluders: Iterable[str] | None,
    two_sided: Iterable[str] | None,
    targets: Iterable[str] | None,
) -> tuple[Group, ...]:
    """Groups with a flag set on exactly the named ones; None keeps that flag."""
    hiding, transparent = named("occluders", occluders, names), named("targets", targets, names)
    is_all = isinstance(two_sided, str) and two_sided == "all"
    both = set(names.groups) if is_all else named("two_sided", two_sided, names)
    return tuple(
        replace(
            group,
            is_occluder=group.is_occluder if hiding is None else group.name in hiding,
            is_two_sided=group.is_two_sided if both is None else group.name in both,
            is_target=group.is_target if transparent is None else group.name in transparent,
        )
        for group in groups
    )


def named(argument: str, given: Iterable[str] | None, names: Names) -> set[str] | None:
    """Groups of the given names; None for None."""
    if given is None:
        return None
    wanted = "names of groups or files"
    each = [given] if isinstance(given, str) else members(argument, given, str, wanted, MeshError)
    try:
        return {group for name in each for group in names.groups_of(name)}
    except MeshError as error:
        raise MeshError(f"{argument}: {error}") from None
