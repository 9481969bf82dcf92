"""Folder of a report: one command at a time, own files only, replaced as a whole.

Every command that writes files to a folder does it through `ReportFolder`:

1. The folder is locked until the command ends. A second one is refused, and changes nothing.
2. A file that a report of this kind could replace, and that no manifest names as ours, is refused
   before the work begins. So is one of ours whose content has been changed since.
3. New files are written to a hidden folder inside it, and are on the disk before any of them moves.
4. `publish` puts the manifest to come beside them, twice: the second begins the swap. It removes
   the files of the earlier report, its last file first; renames the new ones, then the manifest,
   then the last file; and ends with the second manifest, over the first.

The last file of a kind (`summary.json`, say) is therefore there only beside all others of the same
report, and files of two reports are never there together. A run that is killed, or whose disk
fails,

- before the swap begins leaves the earlier report as it was;
- in the swap leaves some files of one report, without the last one; the next command that opens the
  folder ends it, and the new report is whole;
- after it leaves the new report whole.

What killed runs left in the hidden folder under the names of a kind is deleted by the next command
of that kind; nothing else in the folder is looked into, moved or deleted. A hidden folder that is a
link is refused (`rastercov.base.output`).
"""

import hashlib
import os
import re
import stat
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from io import BufferedReader
from itertools import chain, count
from pathlib import Path
from typing import Self

import rastercov
from rastercov.base import (
    ByName,
    ConfigError,
    json_bytes,
    name_file,
    own_folder,
    parse_json,
    printable,
    remove_folder,
)
from rastercov.base.interrupts import hold_end, hold_interrupts
from rastercov.base.locks import lock
from rastercov.base.output import PART, is_own_folder, move, remove_file, replacing, sync

STAGING = ".rastercov-report.part"
"""Hidden folder of a running command: its files, and those it replaces."""
NEW = "new"
"""Within it: files to come. The manifest to come joins them to begin a swap."""
FORMAT = 1
PLAIN = re.compile(r"[\w-][\w.-]*")
"""Names of files in a manifest of any kind."""
JOURNAL = re.compile(r"\.rastercov-[\w-]+\.json")
"""Names of records of a swap, in the hidden folder."""


@dataclass(frozen=True)
class ReportKind:
    """The files of a report.

    Reports of different names may share a folder; their files have different names.
    """

    name: str
    files: re.Pattern[str]  # names that a file of it can have
    last: str  # the file that is there only when all others are

    @property
    def manifest(self) -> str:
        """Name of the file that lists the files of a report with their sizes and hashes."""
        return f".rastercov-{self.name}.json"


Files = dict[str, ByName]
"""Size in bytes and SHA-256 of the files of a report, by name."""


class ReportFolder:
    """Folder of a report, for one command at a time; use it in a `with` block.

    Files are written to the paths that `file` gives, and take their places when `publish` is
    called, which may be done several times. A block that ends without it changes nothing.

    Parameters
    ----------
    path : path
        Made when it is missing, and removed again when the block leaves nothing in it.
    kind : ReportKind
        Kind of the report.
    is_shared : bool
        True for one of several commands that make shards in it, and no report.

    Attributes
    ----------
    has_earlier : bool
        True when a report of this kind was there when the block began.

    Raises
    ------
    ConfigError
        For a folder that cannot be used: a file, one in use by another process, or one with files
        that a report could replace and that are not of an unchanged earlier one.
    OSError
        For a disk error, with the name of the file of the report.
    """

    def __init__(self, path: str | Path, kind: ReportKind, *, is_shared: bool = False) -> None:
        if not os.fspath(path).strip():
            raise ConfigError(
                "expected a folder for the report, got an empty name; use '.' for the current one"
            )
        self.path, self.kind = Path(path), kind
        self.has_earlier, self.is_shared = False, is_shared
        self._staging, self._new = self.path / STAGING, self.path / STAGING / NEW
        self._files: Files = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(lock(self.path, is_shared=self.is_shared))
            if self.is_shared:
                self._stack = stack.pop_all()
                return self
            if not os.access(self.path, os.W_OK | os.X_OK):
                raise ConfigError(
                    f"{_name(self.path)}: expected a writable folder, got another; name one"
                )
            for journal in self._journals():  # of killed runs
                self._files = _read(self.path / journal.name)[1]
                if others := self._not_ours({*chain(*self._moves(journal))} - {journal.name}):
                    raise ConfigError(
                        f"{_name(others[0])}: expected a file of an interrupted report, got "
                        "another file; move it away"
                    )
                self._swap(journal)
            self._clean()
            self._files = _read(self.path / self.kind.manifest, self.kind.files)[1]
            if _is_of_another(self.path, self._files):
                raise ConfigError(
                    f"{_name(self.path)}: expected a report of your own in a shared folder, got "
                    "one of another user; name another folder"
                )
            self.has_earlier = any(os.path.lexists(self.path / name) for name in self._files)
            self._refuse_what_is_not_ours()
            stack.callback(self._clean)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()
        fault = error[1]
        if isinstance(fault, OSError) and fault.filename:
            where = Path(os.fsdecode(fault.filename))
            if where.parent == self._new:
                raise OSError(fault.errno, fault.strerror, str(self.path / where.name)) from fault

    def file(self, name: str) -> Path:
        """Path to write a file of the report to; `publish` gives it its place and its name."""
        if not self.kind.files.fullmatch(name):
            raise ValueError(
                f"expected a file of a {self.kind.name} report, got {name!r}; correct the name"
            )
        with name_file(self.path / name):
            path = own_folder(own_folder(self._staging) / NEW) / name
            if path.is_symlink():
                remove_file(path)
        return path

    def publish(self) -> None:
        """Put the files that were written in the place of the earlier report; all of them or none.

        Raises
        ------
        ConfigError
            When a file has come to the place of one of them, or one of the earlier report has been
            changed, since the block began. The new report is in a folder of its own then.
        OSError
            For a disk error. The earlier report is unchanged then, or the next command ends the
            swap.
        """
        with hold_interrupts():
            files: Files = {}
            for path in sorted(self._find_leftovers(self._new, self.kind.files)):
                with name_file(self.path / path.name), path.open("rb") as file:
                    sync(path)
                    files[path.name] = _digest(file)
            self._keep_what_has_come(files)
            with hold_end():
                with name_file(self.path / self.kind.manifest):
                    journal = self._begin_swap(files)
                self._swap(journal)
                self._files = files
                self._clean()

    def _begin_swap(self, files: Files) -> Path:
        """Record on the disk that the new report replaces the old one; the file that says so."""
        journal = self._staging / self.kind.manifest
        content = {
            "format": FORMAT,
            "rastercov": rastercov.__version__,
            "report": self.kind.name,
            "last": self.kind.last,
            "files": files,
        }
        for path in (self._new / journal.name, journal):
            with replacing(path) as part:
                part.write_bytes(json_bytes(content, indent=2) + b"\n")
                sync(part)
                sync(self._new)
        sync(self._staging)
        return journal

    def _journals(self) -> list[Path]:
        """Records of swaps that a killed run left; ConfigError for links in their places."""
        if not is_own_folder(self._staging):
            return []
        is_own_folder(self._new)
        return self._find_leftovers(self._staging, JOURNAL)

    def _find_leftovers(self, folder: Path, names: re.Pattern[str]) -> list[Path]:
        """Files with matching names in a hidden folder; ConfigError for a link among them."""
        left = [path for path in folder.iterdir() if names.fullmatch(path.name)]
        for path in left:
            if not stat.S_ISREG(path.lstat().st_mode):
                raise ConfigError(
                    f"{_name(path)}: expected a file of a report, got a special file; delete it"
                )
        return left

    def _moves(self, journal: Path) -> tuple[list[str], list[str]]:
        """Files to remove and files to rename that are left of a recorded swap, each in order.

        The last file of a report goes first and comes last, after the manifest.
        """
        last, new = _read(journal)
        coming = [name for name in (*new, journal.name) if os.path.lexists(self._new / name)]
        going = [name for name in self._files if name not in new or name in coming]
        going.sort(key=lambda name: name != last)
        coming.sort(key=lambda name: name == last)
        return going, coming

    def _swap(self, journal: Path) -> None:
        """Remove the earlier report and put the recorded one in its place."""
        going, coming = self._moves(journal)
        for name in going:
            with name_file(self.path / name):
                remove_file(self.path / name)
        for name in coming:
            with name_file(self.path / name):
                move(self._new / name, self.path / name)
        with name_file(self.path / journal.name):
            move(journal, self.path / journal.name)
            sync(self.path)

    def _clean(self) -> None:
        """Delete files of killed runs in the hidden folder, except those of an unfinished swap."""
        if self._journals():
            return
        names = self.kind.files, JOURNAL, PART
        for folder in (self._new, self._staging):
            with suppress(OSError):
                for path in folder.iterdir():
                    if any(own.fullmatch(path.name) for own in names):
                        remove_file(path)
            remove_folder(folder)

    def _not_ours(self, names: Iterable[str]) -> list[Path]:
        """Files of some names that are there and are no unchanged ones of an earlier report."""
        paths = [self.path / name for name in sorted(set(names))]
        return [
            path
            for path in paths
            if os.path.lexists(path) and not _is(path, self._files.get(path.name))
        ]

    def _refuse_what_is_not_ours(self) -> None:
        """Refuse files that a new report could replace, unless they are those of an earlier one."""
        there = filter(self.kind.files.fullmatch, (path.name for path in self.path.iterdir()))
        if others := self._not_ours([*there, *self._files]):
            first, more = others[0], f" and {len(others) - 1} more" if others[1:] else ""
            why = f"one that {self.kind.manifest} does not list"
            if first.name in self._files:
                why = "one changed since it was written"
            raise ConfigError(
                f"{_name(first)}{more}: expected a file of an earlier report, got {why}; name "
                "another folder, or move the file"
            )

    def _keep_what_has_come(self, new: Files) -> None:
        """Refuse files that came or were changed since the block began, and set ours aside."""
        if others := self._not_ours([*new, *self._files]):
            name = f"new-{self.kind.name}"
            tries = (self.path / (name if n == 1 else f"{name}-{n}") for n in count(1))
            aside = next(path for path in tries if not os.path.lexists(path))
            move(self._new, aside)
            raise ConfigError(
                f"{_name(others[0])}: expected no changes during the run, got a new or changed "
                f"file; kept it, the new report is in {_name(aside)}"
            )


def _name(path: Path) -> str:
    """A path in a line for people, whole."""
    return printable(str(path), most=len(str(path)))


def _read(path: Path, names: re.Pattern[str] = PLAIN) -> tuple[str, Files]:
    """Last file and all files of a manifest, whose names match a pattern; none without one."""
    try:
        content = parse_json(path.read_bytes())
        files = {
            name: {"bytes": int(entry["bytes"]), "sha256": str(entry["sha256"])}
            for name, entry in content["files"].items()
        }
        if all(names.fullmatch(name) for name in files):
            return str(content["last"]), files
    except FileNotFoundError:
        return "", {}
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        pass  # something else than a manifest
    raise ConfigError(
        f"{_name(path)}: expected a list of report files, got damaged content; name another "
        "folder, or delete it with the report"
    )


def _is_of_another(folder: Path, names: Iterable[str]) -> bool:
    """True in a folder such as /tmp, where only the owner may remove one of some files."""
    own = folder.stat()
    if not own.st_mode & stat.S_ISVTX or (user := os.geteuid()) in (0, own.st_uid):
        return False
    there = filter(os.path.lexists, map(folder.joinpath, names))
    return any(path.lstat().st_uid != user for path in there)


def _is(path: Path, of_file: ByName | None) -> bool:
    """True when a file is unchanged since it was written."""
    if of_file is None or not stat.S_ISREG(path.lstat().st_mode):
        return False
    with path.open("rb") as file:
        return _digest(file) == of_file


def _digest(file: BufferedReader) -> ByName:
    """Size and hash of a file that is open at its start."""
    sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": file.tell(), "sha256": sha256}
