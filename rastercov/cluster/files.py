"""Files of a job folder: each with its checksum, and under its name only when it is whole.

The checksums are in `sha256/`, in the format of `sha256sum -c`. A checksum is computed from the
bytes that are then decoded, so that no decoder reads damaged ones. It is written before its file: a
run killed between the two leaves a missing file, or one that is made again.
"""

import hashlib
import os
import secrets
from pathlib import Path

from rastercov.base.errors import ConfigError
from rastercov.base.output import named

SUMS = "sha256"
"""Folder of the checksums of all files."""


class DamagedError(ConfigError):
    """A file of a matrix has changed since it was written; the message names file and reason."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: damaged, {why}")


def has_sums(folder: Path) -> bool:
    """True when a file of a folder has a checksum, as every file of this format has."""
    return any((folder / SUMS).glob("*.sha256"))


def has_sum(folder: Path, name: str) -> bool:
    """True when there is the checksum of a file, which may be missing itself."""
    return _sum_file(folder, name).exists()


def contents(folder: Path, name: str) -> bytes | None:
    """Bytes of a file of a matrix, None where it is missing.

    Raises
    ------
    DamagedError
        When they cannot be read, or do not match the checksum.
    """
    try:
        data = (folder / name).read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DamagedError(folder / name, f"it cannot be read ({error.strerror})") from None
    try:
        is_whole = _sum_file(folder, name).read_bytes() == _sum_line(name, data)
    except OSError:
        raise DamagedError(folder / name, "its checksum is missing") from None
    if not is_whole:
        raise DamagedError(folder / name, "its checksum is not the one recorded")
    return data


def store(folder: Path, name: str, data: bytes | memoryview) -> None:
    """Write a file of a matrix, and its checksum before it."""
    _write(_sum_file(folder, name), _sum_line(name, data))
    _write(folder / name, data)


def discard(folder: Path, name: str) -> None:
    """Remove a file of a matrix, and its checksum; again it does nothing."""
    (folder / name).unlink(missing_ok=True)
    _sum_file(folder, name).unlink(missing_ok=True)


def _sum_file(folder: Path, name: str) -> Path:
    return folder / SUMS / f"{Path(name).name}.sha256"


def _sum_line(name: str, data: bytes | memoryview) -> bytes:
    """Line of `sha256sum` for a file, relative to the folder of the matrix."""
    return f"{hashlib.sha256(data).hexdigest()}  {name}\n".encode()


def _write(path: Path, data: bytes | memoryview) -> None:
    """Write a file atomically: it appears under its name when it is complete and on the disk."""
    part = path.with_name(f".{secrets.token_hex(6)}.part")
    with named(path):
        path.parent.mkdir(exist_ok=True)
        try:
            with part.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)  # noqa: PTH105 - the atomic one by name
        finally:
            part.unlink(missing_ok=True)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # makes the new name durable
        finally:
            os.close(folder)
