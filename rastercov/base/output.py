"""Output files, written beside their place and renamed, so that each appears only when whole.

The only module that makes, replaces and deletes files and folders [tests/test_links.py]. An error
of the disk is an `OSError` that names the file. `rastercov.report.folder` does the same for all
files of a report together.

An archive or a clone may carry symbolic links under any name that we use. A person may name a link
as the folder for output. Within it no link is followed: a folder of ours that is a link is refused,
and so is a file that leads out of its folder.
"""

import csv
import dataclasses
import errno
import io
import json
import math
import os
import re
import secrets
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from rastercov.base.arguments import AnyArray
from rastercov.base.errors import ConfigError
from rastercov.base.format import ReadByName


def write_json(path: str | Path, data: object) -> None:
    """Write data as JSON: numpy values as plain ones, numbers that are not finite as null."""
    write_bytes(path, json_bytes(data, indent=2) + b"\n")


def json_text(data: object) -> str:
    """Text that `write_json` writes, in ASCII, which any terminal or pipe takes."""
    return json.dumps(_plain(data), indent=2, allow_nan=False)


def json_bytes(data: object, indent: int | None = None, *, width: int = 0) -> bytes:
    """Content that `write_json` writes, without the line end; parts of that width on one line."""
    plain = _plain(data)
    text = _line(plain) if indent is None else _indent(plain, indent, width)
    # File names need not be Unicode; an undecodable byte becomes \udcXX, which is valid JSON.
    return text.encode("utf-8", errors="backslashreplace")


def write_text(path: str | Path, text: str) -> None:
    """Write text as UTF-8, including file names that are not Unicode."""
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file whose content is known."""
    with writing(Path(path)) as part:
        part.write_bytes(data)


def write_npz(path: str | Path, **arrays: AnyArray) -> None:
    """Write arrays by their names as compressed `.npz`."""
    with writing(Path(path)) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type] # numpy's own flag is typed


PART = re.compile(r"\.[0-9a-f]{12}\.part")
"""Names of files that are being written."""


def is_own_folder(path: Path) -> bool:
    """True for a folder of ours that is there; ConfigError for a link, or a file in its place."""
    try:
        mode = path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    if stat.S_ISDIR(mode):
        return True
    kind = "a symbolic link" if stat.S_ISLNK(mode) else "a file"
    raise ConfigError(f"{path}: expected a folder, got {kind}; move or delete it")


def own_place(path: Path) -> Path:
    """Path of a folder of ours, there or not; errors as of `is_own_folder`."""
    is_own_folder(path)
    return path


def own_folder(path: Path) -> Path:
    """The folder of ours, made when it is missing; errors as of `is_own_folder`."""
    own_place(path).mkdir(exist_ok=True)
    return own_place(path)


def name_folder(path: Path, *, parents: bool = True) -> Path:
    """The folder that a person named, perhaps as a link, made when it is missing."""
    path.mkdir(parents=parents, exist_ok=True)
    return path


def remove_file(path: Path) -> None:
    """Remove a file, or a link itself, in a folder that is no link; again it does nothing."""
    path.unlink(missing_ok=True)


def remove_folder(path: Path) -> None:
    """Remove an empty folder; one that is not, or is missing, stays as it is."""
    with suppress(OSError):
        path.rmdir()


def move(path: Path, place: Path) -> None:
    """Rename a file or folder; a file in its place is replaced, a link itself."""
    path.replace(place)


def check_place(path: Path) -> None:
    """Raise ConfigError where no file can be written: at a folder, and in one that is not there."""
    if path.is_dir() or not path.parent.is_dir():
        got = "a folder" if path.is_dir() else "a folder that does not exist"
        raise ConfigError(f"{path}: expected a file in an existing folder, got {got}")


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yield as `replacing` does; an error of the disk names `path`. For blocks that only write."""
    with name_file(path), replacing(path) as part:
        yield part


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a name beside `path` to write to; it replaces `path` if the block ends well.

    A link to a file in its own folder stays, and that file is replaced; ConfigError for any other.
    A pipe or a device is written to directly, and so is what `OF_SYSTEM` has, such as /dev/stdout.
    """
    check_place(path)
    is_open = str(path.absolute().parent) in OF_SYSTEM
    if not is_open:
        path = _follow_links(path)
    if is_open or (path.exists() and not path.is_file()):
        yield path
        return
    part = path.with_name(f".{secrets.token_hex(6)}.part")
    try:
        yield part
        move(part, path)
    finally:
        remove_file(part)


OF_SYSTEM = ("/dev", "/dev/fd", "/proc/self/fd")
"""Folders of the system, whose links lead to devices and to what this process has open."""


def _follow_links(path: Path) -> Path:
    """Path of a file, whole, after links within its folder."""
    folder = Path(os.path.realpath(path.parent))
    if not path.is_symlink():
        return folder / path.name
    there = Path(os.path.realpath(path))  # itself in a ring of links
    if there.parent != folder or there.is_symlink():
        raise ConfigError(
            f"{path}: expected a file, got a symbolic link to {path.readlink()}; pass that file, "
            "or delete the link"
        )
    return there


def sync(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk where its file system supports that."""
    is_folder = path.is_dir()
    if is_folder and sys.platform == "win32":  # which opens no folder
        return
    descriptor = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    finally:
        os.close(descriptor)


@contextmanager
def name_file(path: Path) -> Iterator[None]:
    """Raise errors of the disk again with the name of a file."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


SCALARS, NUMBERS = {str, int, bool, type(None)}, {int, float}
_line = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode


def _indent(plain: object, indent: int, width: int, depth: int = 0) -> str:
    """JSON over several lines, but a list of numbers, and what fits into the width, on one.

    The encoder of the standard library that indents is written in Python, and a report has as many
    matrices as poses.
    """
    if type(plain) in NUMBERS:
        return repr(plain)  # as the encoder writes finite numbers
    if width and len(line := _line(plain)) <= width:
        return line
    if isinstance(plain, dict) and plain:
        brackets = "{}"
        lines = [f"{_line(key)}: {_indent(plain[key], indent, width, depth + 1)}" for key in plain]
    elif isinstance(plain, list):
        if {*map(type, plain)} <= NUMBERS:
            return f"[{', '.join(map(repr, plain))}]"
        brackets = "[]"
        lines = [_indent(value, indent, width, depth + 1) for value in plain]
    else:
        return _line(plain)
    start = "\n" + " " * (indent * (depth + 1))
    return brackets[0] + start + f",{start}".join(lines) + start[:-indent] + brackets[1]


def _plain(data: object) -> Any:
    """The same data in types that JSON has."""
    if type(data) in SCALARS:
        return data
    if isinstance(data, (np.ndarray, np.generic)):
        data = data.tolist()
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        if {*map(type, data)} == {float} and all(map(math.isfinite, data)):
            return list(data)
        return [_plain(value) for value in data]
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        return {f.name: _plain(getattr(data, f.name)) for f in dataclasses.fields(data)}
    return str(data) if isinstance(data, Path) else data


def csv_text(columns: Iterable[str], rows: Iterable[ReadByName]) -> str:
    """Rows as CSV, with the entries of some columns; they may have others."""
    file = io.StringIO()
    table = csv.DictWriter(file, list(columns), extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return file.getvalue()
