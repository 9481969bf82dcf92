"""Folder of a report: one command at a time, own files only, replaced as a whole.

Every command that writes files to a folder does it through `ReportFolder`:

1. The folder is locked until the command ends. A second one is refused, and changes nothing.
2. A file that a report of this kind could replace, and that no manifest names as ours, is refused
   before the work begins. So is one of ours whose content has been changed since.
3. New files are written to a hidden folder inside it, and are on the disk before any of them moves.
4. `publish` moves the files of the earlier report out, its last file first; then the new ones in,
   its last file last; then it replaces the manifest. All of these are renames.

The last file of a kind (`summary.json`, say) is therefore there only beside all others of the same
report, and files of two reports are never there together. A run that is killed

- before step 4 leaves the earlier report as it was;
- between two renames of step 4 leaves some files of one report, without the last one. The swap is
  on record by then: the next command that opens the folder ends it, and the new report is whole;
- after step 4 leaves the new report whole.

A rename that fails is undone with all before it. What killed runs left in the hidden folder is
deleted by the next command; nothing else in the folder is looked into, moved or deleted.
"""

import errno
import fcntl
import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain, count
from pathlib import Path
from typing import Any, Self

from rastercov.base.errors import ConfigError
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import named

STAGING = ".rastercov-report.part"
"""Hidden folder of a running command: its files, and those it replaces."""
NEW, OLD = "new", "old"
"""Within it: files to come, and files that go. The manifest to come joins them to begin a swap."""
FORMAT = 1
NOT_A_MANIFEST = (ValueError, KeyError, TypeError, AttributeError)
"""Errors that reading something else as a manifest raises."""


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


Files = dict[str, dict[str, Any]]
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

    def __init__(self, path: str | Path, kind: ReportKind) -> None:
        if not os.fspath(path).strip():
            raise ConfigError("a folder for the report is wanted, got an empty name")
        self.path, self.kind = Path(path), kind
        self.has_earlier = False
        staging = self.path / STAGING
        self._staging, self._new, self._old = staging, staging / NEW, staging / OLD
        self._files: Files = {}
        self._stack = ExitStack()

    @classmethod
    def opened(
        cls, out: "str | Path | ReportFolder", kind: ReportKind
    ) -> "AbstractContextManager[ReportFolder]":
        """Context manager of a folder: of one that is open already, that one."""
        return nullcontext(out) if isinstance(out, ReportFolder) else cls(out, kind)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(_locked(self.path))
            if not os.access(self.path, os.W_OK | os.X_OK):
                raise ConfigError(f"{self.path}: nothing can be written to this folder")
            self._finish_swap()
            self._clean()
            if os.path.lexists(self._staging):
                raise ConfigError(
                    f"{self._staging}: holds what no run has left there; move it away"
                )
            self._files = _read_manifest(self.path / self.kind.manifest, self.kind)
            self._refuse_what_is_not_ours()
            self.has_earlier = any(os.path.lexists(self.path / name) for name in self._files)
            stack.callback(self._clean)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.close()
        fault = error[1]
        if isinstance(fault, OSError) and fault.filename:
            where = Path(os.fsdecode(fault.filename))
            if where.parent == self._new:
                raise OSError(fault.errno, fault.strerror, str(self.path / where.name)) from fault

    def file(self, name: str) -> Path:
        """Path to write a file of the report to; `publish` gives it its place and its name."""
        if not self.kind.files.fullmatch(name):
            raise ValueError(f"{name!r} is no file of a report of the kind {self.kind.name!r}")
        with named(self.path / name):
            self._new.mkdir(parents=True, exist_ok=True)
        return self._new / name

    def publish(self) -> None:
        """Put the files that were written in the place of the earlier report; all of them or none.

        Raises
        ------
        ConfigError
            When a file has come to the place of one of them, or one of the earlier report has been
            changed, since the block began. The new report is in a folder of its own then.
        OSError
            For a disk error. Nothing has changed then.
        """
        with interrupts_held():
            files: Files = {}
            for path in sorted(self._new.iterdir()):
                with named(self.path / path.name), path.open("rb") as file:
                    os.fsync(file.fileno())
                    files[path.name] = _digest(file)
            self._refuse_what_has_come(files)
            manifest, journal = (p / self.kind.manifest for p in (self.path, self._staging))
            done: list[tuple[Path, Path]] = []
            try:
                with named(manifest):
                    self._begin_swap(journal, files)
                for source, target in self._moves(self.kind.last, files, self._files):
                    done.append((source, target))
                    with named(self.path / source.name):
                        source.rename(target)
                with named(manifest):
                    journal.replace(manifest)
            except BaseException:
                with suppress(OSError):  # the next command continues a swap that cannot be undone
                    for source, target in reversed(done):
                        if not os.path.lexists(source):
                            target.rename(source)
                    journal.unlink(missing_ok=True)
                raise
            with suppress(OSError):
                _sync(self.path)
            self._files = files
            self._clean()

    def _begin_swap(self, journal: Path, files: Files) -> None:
        """Record on the disk that the new report replaces the old one."""
        self._old.mkdir(exist_ok=True)
        part = journal.with_suffix(".part")
        content = {
            "format": FORMAT,
            "rastercov": version("rastercov"),
            "report": self.kind.name,
            "last": self.kind.last,
            "files": files,
        }
        with part.open("wb") as file:
            file.write(json.dumps(content, indent=2).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        _sync(self._new)
        part.replace(journal)
        _sync(self._staging)

    def _moves(self, last: str, new: Files, old: Files) -> list[tuple[Path, Path]]:
        """Remaining renames of a swap: the earlier report out, the new one in.

        The last file of a report goes first and comes last.
        """
        coming = [name for name in new if os.path.lexists(self._new / name)]
        going = [
            name
            for name in old
            if (name not in new or name in coming) and os.path.lexists(self.path / name)
        ]
        going.sort(key=lambda name: (name != last, name))
        coming.sort(key=lambda name: (name == last, name))
        return [
            *((self.path / name, self._old / name) for name in going),
            *((self._new / name, self.path / name) for name in coming),
        ]

    def _finish_swap(self) -> None:
        """Complete the swap of a killed run."""
        delete = (
            f"the report that a killed run was putting here; delete {self._staging} and what is "
            "there of the report"
        )
        for journal in self._staging.glob(".rastercov-*.json"):
            manifest = self.path / journal.name
            try:
                content = json.loads(journal.read_bytes())
                last, new = str(content["last"]), _files_of(content)
                old = _files_of(json.loads(manifest.read_bytes())) if manifest.exists() else {}
            except NOT_A_MANIFEST:
                raise ConfigError(f"{journal}: damaged; it is of {delete}") from None
            for name in new:
                if not any(os.path.lexists(path / name) for path in (self._new, self.path)):
                    raise ConfigError(f"{self.path / name}: missing from {delete}")
            moves = self._moves(last, new, old)
            free = {source for source, _ in moves if _is(source, old.get(source.name))}
            for name in {source.name for source, _ in moves}:
                place = self.path / name
                if os.path.lexists(place) and place not in free:
                    raise ConfigError(
                        f"{place}: in the way of the report that a killed run was putting here, "
                        "and not of an earlier one; move it away"
                    )
            for source, target in moves:
                source.rename(target)
            journal.replace(manifest)

    def _clean(self) -> None:
        """Delete files of killed runs in the hidden folder, except those of an unfinished swap."""
        if any(self._staging.glob(".rastercov-*.json")):
            return
        for folder, names in ((self._new, "*"), (self._old, "*"), (self._staging, "*.part")):
            with suppress(OSError):
                for path in folder.glob(names):
                    path.unlink()
            with suppress(OSError):
                folder.rmdir()

    def _refuse_what_is_not_ours(self) -> None:
        """Refuse files that a new report could replace, unless they are those of an earlier one."""
        foreign = [
            path
            for path in sorted(self.path.iterdir())
            if self.kind.files.fullmatch(path.name) and path.name not in self._files
        ]
        if foreign:
            more = f" and {len(foreign) - 1} more" if foreign[1:] else ""
            raise ConfigError(
                f"{foreign[0]}{more}: not of an earlier report ({self.kind.manifest} lists those), "
                "and a new one may replace it; name another folder, or move or delete what is there"
            )
        for name, of_file in self._files.items():
            path = self.path / name
            if os.path.lexists(path) and not _is(path, of_file):
                raise ConfigError(
                    f"{path}: changed since it was written, and a new report would replace it; "
                    "name another folder, or move it away or delete it"
                )

    def _refuse_what_has_come(self, new: Files) -> None:
        """Refuse files that came, or were changed, since the block began."""
        for name in sorted(new.keys() | self._files.keys()):
            path = self.path / name
            if os.path.lexists(path) and not _is(path, self._files.get(name)):
                aside = self._free_name()
                self._new.rename(aside)
                raise ConfigError(
                    f"{path}: came or was changed during the run, and is kept; the new report is "
                    f"in {aside}"
                )

    def _free_name(self) -> Path:
        """Name for a folder that is not there yet."""
        first = self.path / f"new-{self.kind.name}"
        later = (first.with_name(f"{first.name}-{number}") for number in count(2))
        return next(path for path in chain([first], later) if not os.path.lexists(path))


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """The folder, made when it is missing, for this process alone; a killed one leaves no lock.

    A folder that was made, and in which there is nothing at the end, is removed.
    """
    made: list[Path] = []
    while True:
        made += _make_folder(path)
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # another process had made it, and has removed it
        except OSError as error:
            raise ConfigError(f"{path}: the folder cannot be read ({error.strerror})") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise ConfigError(
                f"{path}: another process is writing to this folder; wait or name another"
            ) from None
        except OSError:
            pass  # a file system without locks
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), path.stat()):
                break
        os.close(descriptor)  # the folder has been removed since
    try:
        yield
    finally:
        with suppress(OSError):  # not empty
            for folder in made:
                folder.rmdir()
        os.close(descriptor)


def _make_folder(path: Path) -> list[Path]:
    """Make a folder; gives it and those above it that were missing."""
    try:
        missing = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ConfigError(f"{path}: a folder is wanted, but a file is in the way") from None
    except OSError as error:
        raise ConfigError(f"{path}: the folder cannot be made ({error.strerror})") from None
    return missing


def _read_manifest(path: Path, kind: ReportKind) -> Files:
    """Files of the report in a folder; none where there is none."""
    try:
        files = _files_of(json.loads(path.read_bytes()))
        if all(kind.files.fullmatch(name) for name in files):
            return files
    except FileNotFoundError:
        return {}
    except NOT_A_MANIFEST:
        pass
    raise ConfigError(
        f"{path}: damaged, so it does not say which files are of a report; name another folder, "
        "or delete it with the report"
    )


def _files_of(content: dict[str, Any]) -> Files:
    files = {
        name: {"bytes": int(entry["bytes"]), "sha256": str(entry["sha256"])}
        for name, entry in content["files"].items()
    }
    if not all(re.fullmatch(r"[\w-][\w.-]*", name) for name in files):
        raise ValueError("names of files only")
    return files


def _is(path: Path, of_file: dict[str, Any] | None) -> bool:
    """True when a file is unchanged since it was written."""
    if of_file is None or not stat.S_ISREG(path.lstat().st_mode):
        return False
    if path.stat().st_size != of_file["bytes"]:
        return False
    with path.open("rb") as file:
        return _digest(file) == of_file


def _digest(file: Any) -> dict[str, Any]:
    """Size and hash of a file that is open at its start."""
    sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": file.tell(), "sha256": sha256}


def _sync(folder: Path) -> None:
    """Flush the names in a folder to the disk, where its file system supports that."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    finally:
        os.close(descriptor)
