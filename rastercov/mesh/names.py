"""Names of mesh files and groups: one meaning in commands, plan files and functions.

A name is a group, or a file by its path, its name or its stem; `*`, `?` and `[...]` are wildcards,
unless something has just that name.
"""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import MeshError
from rastercov.base.files import StrPath

Value = TypeVar("Value")
MOST_LISTED, LONGEST_LISTED = 5, 60
"""Names in a line about another one, and characters of each."""


def quoted(name: str) -> str:
    """A name in quotes, shortened."""
    return repr(_short(name))


def _short(name: str) -> str:
    return name if len(name) <= LONGEST_LISTED else f"{name[: LONGEST_LISTED - 3]}..."


def listed(names: Iterable[str], near: str = "") -> str:
    """All names where they are few; else those that are similar to `near`, and how many there are.

    For errors: one line, whatever the number of names.
    """
    every = list(dict.fromkeys(names))
    chosen = every
    if len(every) > MOST_LISTED:
        similar = difflib.get_close_matches(near[:LONGEST_LISTED], every[:10_000], MOST_LISTED, 0.5)
        chosen = similar or every[:MOST_LISTED]
    more = f" and {len(every) - len(chosen):,} more" if len(every) > len(chosen) else ""
    return ", ".join(map(_short, chosen)) + more


def files_named(name: str, paths: Sequence[StrPath]) -> tuple[list[int], bool]:
    """Rows of the files that a name means, and whether it means them without wildcards.

    A path before a name, and that before a stem. MeshError for a name that different files have.
    """
    files = [Path(path) for path in paths]
    for is_meant in (
        lambda path: name == str(path),
        lambda path: _is_same(name, path),
        lambda path: name == path.name,
        lambda path: name == path.stem,
    ):
        rows = [row for row, path in enumerate(files) if is_meant(path)]
        if len({files[row] for row in rows}) > 1:
            raise MeshError(f"{len(rows)} files have the name {quoted(name)}; give a path")
        if rows:
            return rows, True
    words = [(str(path), path.name, path.stem) for path in files]
    return [row for row, of in enumerate(words) if any(fnmatchcase(w, name) for w in of)], False


def _is_same(name: str, path: Path) -> bool:
    try:
        return path.samefile(name)
    except (OSError, ValueError):
        return False


def by_file(
    what: str, entries: Iterable[tuple[str | None, Value]], paths: Sequence[StrPath], other: Value
) -> list[Value]:
    """Value of each file from pairs of name and value; None and "*" are all other files.

    A name goes before one with wildcards. MeshError, which begins with `what`, for an unknown name
    and for two values of one file.
    """
    found: list[dict[int, Value]] = [{} for _ in paths]
    for name, value in entries:
        rows, rank = list(range(len(paths))), 0
        if name not in (None, "*"):
            try:
                rows, is_exact = files_named(name, paths)
            except MeshError as error:
                raise MeshError(f"{what} {quoted(name)}: {error}") from None
            if not rows:
                raise MeshError(
                    f"{what}: there is no mesh file {quoted(name)}; files are "
                    f"{listed(map(str, paths), name)}"
                )
            rank = 2 if is_exact else 1
        for row in rows:
            if rank in found[row]:
                of = Path(paths[row]).name if rank else "all files"
                raise MeshError(f"{what} is given twice for {of}; leave one, or name the file")
            found[row][rank] = value
    return [values[max(values)] if values else other for values in found]


def of_files(what: str, given: Any, paths: Sequence[StrPath], other: Any) -> list[Any]:
    """Value of each file: the one given, one of a list for each, or one by its name."""
    if isinstance(given, Mapping):
        return by_file(what, given.items(), paths, other)
    values = list(given) if isinstance(given, (list, tuple)) else [given] * len(paths)
    if len(values) != len(paths):
        raise MeshError(f"{what}: one for each of {len(paths)} files wanted, got {len(values)}")
    return values


class FileGroups(NamedTuple):
    """A mesh file and its groups."""

    path: StrPath
    groups: Sequence[str]


class Names:
    """Groups of a scene by the names of groups and files.

    Parameters
    ----------
    groups : iterable of str
        All groups.
    files : sequence of FileGroups
    group_first : bool
        A group goes before files whose stem is its name; else it is an error where these are
        several. Of `fixture.stl` and `fixture.obj`, a group is called `fixture`.
    """

    def __init__(
        self, groups: Iterable[str], files: Sequence[FileGroups] = (), *, group_first: bool = False
    ) -> None:
        self.files, self._group_first = tuple(files), group_first
        self._known = {group: group for group in groups}
        self.groups = tuple(self._known)
        if len(files) == 1:  # of several files, groups begin with the stem
            stem = Path(files[0].path).stem
            self._known = {f"{stem}/{each}": each for each in files[0].groups} | self._known

    def groups_of(self, name: str) -> list[str]:
        """Groups that a name means, in the order of the scene; MeshError where there is none."""
        if name in self._known and self._group_first:
            return [self._known[name]]
        rows, _ = files_named(name, [each.path for each in self.files])
        if name in self._known:
            return [self._known[name]]
        found = {group for row in rows for group in self.files[row].groups}
        found |= {group for word, group in self._known.items() if fnmatchcase(word, name)}
        if not found:
            raise MeshError(
                f"there is no group {quoted(name)}, nor a mesh file of that name; groups are "
                f"{listed(self.groups, name)}"
            )
        return [group for group in self.groups if group in found]

    def by_group(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Value of each group from values by name; the name of a group goes before all others.

        MeshError for an unknown name, and for two other names that give one group two values.
        """
        found: dict[str, Value] = {}
        for name, value in values.items():
            for group in self.groups_of(name):
                if group != name and found.get(group, value) != value and group not in values:
                    raise MeshError(f"group {quoted(group)} has two values by name; name it itself")
                found[group] = values.get(group, value)
        return found


def refuse_twice(
    parts: Iterable[tuple[str, NDArray[np.float64], NDArray[np.int64]]],
) -> None:
    """MeshError where two meshes are the same, in the same place.

    Parameters
    ----------
    parts : iterable of (str, (V, 3) float64, (F, 3) int64)
        Name, vertices and faces of each; the corners of all faces are compared, bit by bit.
    """
    alike: dict[int, list[tuple[str, NDArray[np.float64], NDArray[np.int64]]]] = {}
    for part in parts:
        alike.setdefault(len(part[2]), []).append(part)
    for each in alike.values():
        first: dict[bytes, str] = {}
        for name, vertices, faces in each if len(each) > 1 else ():
            corners = vertices[faces] + 0.0  # zeros of either sign are equal
            digest = blake2b(corners.tobytes()).digest()
            if digest in first:
                other = "given twice" if first[digest] == name else f"the mesh of {first[digest]}"
                raise MeshError(f"{name} is {other}, in the same place; leave one out, or move it")
            first[digest] = name
