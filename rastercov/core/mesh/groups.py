"""Groups of faces: roles, flags, and names of groups and mesh files.

Names have one meaning in commands, plan files and functions: a name is a group, a part, or a file
by its path, its name or its stem; `*`, `?` and `[...]` are wildcards, unless something has just
that name. Of groups of one name, which have " #2" ... appended, all are meant. Groups are the
leaves of a tree: "/" separates the levels of a name, and each beginning of it that ends before a
"/" is a part, of all groups below it.
"""

import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    ByName,
    FloatArray,
    Int32Array,
    IntArray,
    MeshError,
    StrPath,
    check_kind,
    errors_as,
    flag,
    members,
    printable,
    shorten,
)
from rastercov.base.files import is_same_file
from rastercov.core.mesh.arrays import face_labels

Value = TypeVar("Value")
MOST_LISTED, LONGEST_LISTED = 5, 60
"""Names in a line about another one, and characters of each."""
REPEATED = re.compile(r" #\d+(?=/|$)")
"""End of a name, or of a level of it, that a scene has already."""


def quote(name: str) -> str:
    """A name in quotes, shortened."""
    return repr(shorten(name, LONGEST_LISTED))


def list_names(names: Iterable[str], near: str = "") -> str:
    """All names where they are few; else those that are similar to `near`, and how many there are.

    For errors: one line, whatever the number of names.
    """
    every = list(dict.fromkeys(names))
    chosen = every
    if len(every) > MOST_LISTED:
        similar = difflib.get_close_matches(near[:LONGEST_LISTED], every[:10_000], 3, 0.5)
        chosen = similar or every[:MOST_LISTED]
    more = f" and {len(every) - len(chosen):,} more" if len(every) > len(chosen) else ""
    return ", ".join(shorten(name, LONGEST_LISTED) for name in chosen) + more


def parts_above(group: str) -> list[str]:
    """Names of the parts that hold a group, the outermost first."""
    return [group[:at] for at, sign in enumerate(group) if sign == "/" and at]


def body_of(group: str) -> str:
    """Name of the part whose CAD face a group is; the group's own where it is none."""
    part, _, last = group.rpartition("/")
    return part if part and re.fullmatch(r"face \d+", last) else group


def blocker(hider: str | None, own: str) -> str:
    """Words on a group that blocks the view of another, `own`; "" for none."""
    body = body_of(hider or "")
    return "another part of the same body" if body == body_of(own) else body and f'"{body}"'


def stem_of(path: StrPath) -> str:
    """Name of a file in names of groups: its own, without folders and suffix."""
    return printable(Path(path).stem) or "mesh"


def names_beside(paths: Sequence[StrPath], names: Sequence[Sequence[str]]) -> list[str]:
    """Names in one scene of the groups of files, from those in each file.

    They stay as they are, whatever files follow; "stem/name" where a file before has a group or
    part of that first level.
    """
    texts: list[str] = []
    taken: set[str] = set()
    for path, own in zip(paths, names, strict=True):
        stem = stem_of(path)
        new = [f"{stem}/{n}" if n.split("/")[0] in taken and n != stem else n for n in own]
        taken.update(name.split("/")[0] for name in new)
        texts += new
    return texts


def files_of_group(name: str, paths: Sequence[StrPath]) -> tuple[list[int], bool]:
    """Rows of the files that a name means, and whether it means them without wildcards.

    A path before a name, and that before a stem. MeshError for a name that different files have.
    """
    files = [Path(path) for path in paths]
    for is_meant in (
        lambda path: name == str(path),
        lambda path: is_same_file(name, path),
        lambda path: name == path.name,
        lambda path: name == path.stem,
    ):
        rows = [row for row, path in enumerate(files) if is_meant(path)]
        if len({files[row] for row in rows}) > 1:
            raise MeshError(
                f"expected one file of the name {quote(name)}, got {len(rows)}; give a path"
            )
        if rows:
            return rows, True
    words = [(str(path), path.name, path.stem) for path in files]
    return [row for row, of in enumerate(words) if any(fnmatchcase(w, name) for w in of)], False


def by_file(
    what: str, entries: Iterable[tuple[str | None, Value]], paths: Sequence[StrPath], other: Value
) -> list[Value]:
    """Value of each file from pairs of name and value; None and "*" are all other files.

    A name goes before one with wildcards. MeshError, which begins with `what`, for an unknown name
    and for two values of one file.
    """
    items: list[dict[int, Value]] = [{} for _ in paths]
    for name, value in entries:
        rows, rank = list(range(len(paths))), 0
        if name not in (None, "*"):
            with errors_as(MeshError, f"{what} {quote(name)}"):
                rows, is_exact = files_of_group(name, paths)
            if not rows:
                known = list_names(map(str, paths), name)
                raise MeshError(
                    f"{what}: expected one of the mesh files {known}, got {quote(name)}"
                )
            rank = 2 if is_exact else 1
        for row in rows:
            if rank in items[row]:
                of = Path(paths[row]).name if rank else "all files"
                raise MeshError(
                    f"expected {what} once for {of}, got it twice; remove one, or name the file"
                )
            items[row][rank] = value
    return [values[max(values)] if values else other for values in items]


def of_files(what: str, given: object, paths: Sequence[StrPath], other: object) -> list[Any]:
    """Value of each file: the one given, one of a list for each, or one by its name."""
    if isinstance(given, Mapping):
        return by_file(what, given.items(), paths, other)
    values = list(given) if isinstance(given, (list, tuple)) else [given] * len(paths)
    if len(values) != len(paths):
        raise MeshError(f"{what}: expected one for each of {len(paths)} files, got {len(values)}")
    return values


def parts_of(groups: Sequence["Group"]) -> dict[str, list[int]]:
    """Rows of the groups of each part, the outermost first; a group may have the name of a part."""
    numbers_by_key: dict[str, list[int]] = {
        name: [] for each in groups for name in parts_above(each.name)
    }
    for row, group in enumerate(groups):
        for name in (*parts_above(group.name), group.name):
            if name in numbers_by_key:
                numbers_by_key[name].append(row)
    return numbers_by_key


def rows_of(groups: Iterable[str], place: str) -> list[int]:
    """Rows of the names of groups that a part holds, or that are just that name."""
    return [row for row, name in enumerate(groups) if f"{name}/".startswith(f"{place}/")]


def names_in(groups: Sequence["Group"], place: str | None) -> set[str]:
    """Names of the groups of a part, or of that name; all for None."""
    names = [each.name for each in groups]
    return {*names} if place is None else {names[row] for row in rows_of(names, place)}


def rows_at(
    groups: Sequence["Group"], level: int | None = None, rows: Iterable[int] | None = None
) -> dict[str, list[int]]:
    """Rows of evaluated groups, all or some, by the first levels of their names, or by these."""
    numbers_by_key: dict[str, list[int]] = {}
    for row in range(len(groups)) if rows is None else rows:
        if not groups[row].is_occluder:
            numbers_by_key.setdefault(at_level(groups[row].name, level), []).append(row)
    return numbers_by_key


def at_level(group: str, level: int | None) -> str:
    """The first levels of the name of a group; all of it for None."""
    return "/".join(group.split("/")[:level])


class FileGroups(NamedTuple):
    """A mesh file and its groups, by their names in the scene."""

    path: StrPath
    groups: Sequence[str]


def _words(name: str) -> tuple[str, ...]:
    """The name, and that which others have too, where something is appended."""
    return tuple(dict.fromkeys((name, REPEATED.sub("", name)))) if " #" in name else (name,)


class Names:
    """Groups of a scene by the names of groups and files.

    Parameters
    ----------
    groups : iterable of str
        All groups.
    files : sequence of FileGroups
    group_first : bool
        A group goes before files whose stem is its name, and others of its name; else it is an
        error where these are several. Of `fixture.stl` and `fixture.obj`, a group is called
        `fixture`.
    """

    def __init__(
        self, groups: Iterable[str], files: Sequence[FileGroups] = (), *, group_first: bool = False
    ) -> None:
        self.files, self._group_first = tuple(files), group_first
        self.groups = tuple(dict.fromkeys(groups))
        self._known: dict[str, dict[str, None]] = {}  # groups by each word that is their name
        self._own: dict[str, dict[int, list[str]]] = {}  # of each file
        for group in self.groups:
            for word in _words(group):
                self._known.setdefault(word, {})[group] = None
        for row, file in enumerate(files):
            stem = stem_of(file.path)
            for group in file.groups:
                name = group.removeprefix(f"{stem}/")
                for word in _words(name):
                    self._own.setdefault(word, {}).setdefault(row, []).append(group)
                for word in _words(f"{stem}/{name}"):  # whether or not it is called so in the scene
                    if word not in self._known.setdefault(word, {}):
                        self._known[word][group] = None

    def groups_of(self, name: str) -> list[str]:
        """Groups that a name means, in the order of the scene; MeshError where there is none."""
        known = list(self._known.get(name, ()))
        if known and self._group_first:
            return [name] if name in known else known
        rows, is_exact = files_of_group(name, [each.path for each in self.files])
        of_file = {} if rows else self._own.get(name, {})
        own = [group for groups in of_file.values() for group in groups]
        if len(of_file) > 1:  # its name in a file, as if that were alone
            names = (
                word for word, groups in self._known.items() if word != name and groups.keys() & own
            )
            raise MeshError(
                f"expected one file with a group {quote(name)}, got {len(own)}; give one of "
                f"{list_names(names)}, or {quote(f'*/{name}')} for all"
            )
        if known:
            return known
        items = {group for row in rows for group in self.files[row].groups}
        below = {
            g for word in self._known if word.startswith(f"{name}/") for g in self._known[word]
        }
        if own and not below:
            return own
        items |= below if below or is_exact else self._like(name)
        items = items or self._like(f"*/{name}")  # the levels above may be left out
        if not items:
            raise MeshError(
                f"expected a mesh file or a group, got {quote(name)}; correct the name (groups: "
                f"{list_names(self.groups, name)})"
            )
        return [group for group in self.groups if group in items]

    def _like(self, name: str) -> set[str]:
        """Groups that a name with wildcards means, by themselves or by a part that holds them."""
        return {
            group
            for word, groups in self._known.items()
            if any(fnmatchcase(each, name) for each in (word, *parts_above(word)))
            for group in groups
        }

    def places_of(self, name: str) -> list[str]:
        """Groups and parts that a name means, each as a whole; MeshError where there is none.

        Of a name with wildcards the outermost that fit it: all that "arm/*" means are in "arm". Of
        a file without a part of its own, the outermost in it.
        """
        own = self.groups_of(name)
        whole, meant = (
            Counter(part for group in groups for part in parts_above(group))
            for groups in (self.groups, own)
        )
        items = []
        for group in own:
            levels = [*parts_above(group), group]
            fits = [each for each in levels if fnmatchcase(f"/{each}", f"*/{name}")]
            all_meant = [each for each in levels if whole[each] == meant[each]]
            items.append(group if name in self._known else (fits or all_meant)[0])
        return list(dict.fromkeys(items))

    def by_group(
        self, values: Mapping[str, Value], find: Callable[[str], list[str]] | None = None
    ) -> dict[str, Value]:
        """Value of each group from values by name; the name of a group goes before all others.

        Of each group or part with `find=self.places_of`. MeshError for an unknown name, and for two
        other names that give one group two values.
        """
        find, result = find or self.groups_of, dict[str, Value]()
        for name, value in values.items():
            for place in find(name):
                if place != name and result.get(place, value) != value and place not in values:
                    raise MeshError(
                        f"expected one value for group {quote(place)}, got two from other names; "
                        "name the group itself"
                    )
                result[place] = values.get(place, value)
        return result


def refuse_twice(
    parts: Iterable[tuple[str, FloatArray, IntArray]],
) -> None:
    """MeshError where two meshes are the same, in the same place.

    Parameters
    ----------
    parts : iterable of (str, (V, 3) float64, (F, 3) int64)
        Name, vertices and faces of each; the corners of all faces are compared, bit by bit.
    """
    parts = list(parts)
    n_alike = Counter(len(faces) for _, _, faces in parts)
    first: dict[bytes, str] = {}
    for name, vertices, faces in parts:
        if n_alike[len(faces)] > 1:
            corners = vertices[faces] + 0.0  # zeros of either sign are equal
            digest = blake2b(corners.tobytes()).digest()
            if digest in first:
                other = "given twice" if first[digest] == name else f"the mesh of {first[digest]}"
                raise MeshError(
                    f"expected different meshes, got {name}, {other}, in the same place; remove or "
                    "move one"
                )
            first[digest] = name


@dataclass(frozen=True)
class Group:
    """A named set of faces.

    Attributes
    ----------
    name : str
        Unique within a mesh; "/" separates the levels of a tree of parts.
    is_occluder : bool
        Its faces occlude others but are not evaluated.
    is_two_sided : bool
        Its faces may be covered from either side.
    is_target : bool
        Its faces are evaluated but occlude nothing: neither other faces nor each other.

    Raises
    ------
    MeshError
        For a group that is both occluder and target.

    Examples
    --------
    >>> import rastercov as rc
    >>> groups = [rc.Group("part"), rc.Group("table", is_occluder=True)]
    >>> part = rc.shapes.box((0.2, 0.2, 0.2))
    >>> table = rc.shapes.box((1, 1, 0.1), centre=(0, 0, -0.2))
    >>> mesh = rc.Mesh.joined([part, table], ["part", "table"]).with_groups(occluders=["table"])
    >>> [group.role for group in mesh.groups] == [group.role for group in groups]
    True
    >>> int(mesh.task_mask.sum()), mesh.n_faces
    (12, 24)
    """

    name: str
    is_occluder: bool = False
    is_two_sided: bool = False
    is_target: bool = False

    def __post_init__(self) -> None:
        check_kind("the name of a group", self.name, str, "a string", MeshError)
        for name in ("is_occluder", "is_two_sided", "is_target"):
            object.__setattr__(self, name, flag(name, getattr(self, name)))
        if self.is_occluder and self.is_target:
            raise MeshError(f"expected one role of group {self.name!r}, got occluder and target")

    @property
    def role(self) -> str:
        """`"task"` (evaluated, occludes), `"occluder"` (occludes) or `"target"` (evaluated)."""
        return "occluder" if self.is_occluder else "target" if self.is_target else "task"

    def _flagged(self, flags: ByName) -> "Group":
        """The group with some flags."""
        return self if flags.items() <= vars(self).items() else replace(self, **flags)

    def to_json(self) -> ByName:
        """Arguments of the constructor, ready for JSON; `is_target` only if it is true."""
        fields = dict(vars(self))
        # Matrices on disk are named by hashes of scenes, which predate targets.
        if not self.is_target:
            del fields["is_target"]
        return fields


def check_groups(
    groups: Iterable[Group] | None, face_group: ArrayLike | None, n_faces: int
) -> tuple[tuple[Group, ...], Int32Array]:
    """Groups of a mesh, by default one, and the (F,) index of each face's group, or MeshError."""
    default = (Group("mesh"),)
    wanted = 'Group values such as [Group("part")]'
    groups = members("groups", default if groups is None else groups, Group, wanted, MeshError)
    names = [group.name for group in groups]
    if not names or len(set(names)) < len(names):
        raise MeshError(f"expected at least one group, and unique names, got {names}; rename them")
    if face_group is None and len(groups) > 1:
        raise MeshError(f"expected face_group of {len(groups)} groups, got none; pass (F,) indices")
    labels = face_labels("face_group", 0 if face_group is None else face_group, n_faces)
    if ((labels < 0) | (labels >= len(groups))).any():
        raise MeshError(
            f"expected face_group in 0 ... {len(groups) - 1}, got {labels.min()} ... "
            f"{labels.max()}; list every group in groups"
        )
    return groups, labels.astype(np.int32)


def flag_groups(
    names: Names,
    groups: Sequence[Group],
    occluders: Iterable[str] | None,
    two_sided: Iterable[str] | None,
    targets: Iterable[str] | None,
) -> tuple[Group, ...]:
    """Groups with a flag set on exactly the named ones; None keeps that flag."""
    is_all = isinstance(two_sided, str) and two_sided == "all"
    chosen: dict[str, set[str] | None] = {
        "is_occluder": names_of_groups("occluders", occluders, names),
        "is_two_sided": set(names.groups)
        if is_all
        else names_of_groups("two_sided", two_sided, names),
        "is_target": names_of_groups("targets", targets, names),
    }
    items = []
    for group in groups:
        flags: ByName = {flag: group.name in own for flag, own in chosen.items() if own is not None}
        items.append(group._flagged(flags))
    return tuple(items)


def names_of_groups(argument: str, given: Iterable[str] | None, names: Names) -> set[str] | None:
    """Groups of the given names; None for None."""
    if given is None:
        return None
    wanted = "names of groups or files"
    each = [given] if isinstance(given, str) else members(argument, given, str, wanted, MeshError)
    with errors_as(MeshError, argument):
        return {group for name in each for group in names.groups_of(name)}
