"""A folder that one process at a time writes to."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rastercov.base.errors import ConfigError
from rastercov.base.output import name_folder, remove_folder

if sys.platform == "win32":
    # It opens no folder, so a file in it is locked. The system deletes the file when it is closed.
    import msvcrt

    LOCK, _FLAGS = ".rastercov-lock", os.O_RDWR | os.O_CREAT | os.O_TEMPORARY

    def _lock(descriptor: int, is_shared: bool) -> None:
        if is_shared:  # the system has no such locks
            return
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            raise BlockingIOError from None

else:
    import fcntl

    LOCK, _FLAGS = "", os.O_RDONLY | os.O_DIRECTORY

    def _lock(descriptor: int, is_shared: bool) -> None:
        kind = fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)


@contextmanager
def lock(path: Path, *, is_shared: bool = False) -> Iterator[Path]:
    """The folder, made when it is missing, for this process alone; a killed one leaves no lock.

    It is for all processes that share it, or for one that does not.
    A folder that was made, and in which there is nothing at the end, is removed.
    """
    made = [folder for folder in (path, *path.parents) if not os.path.lexists(folder)]
    try:
        name_folder(path)
        descriptor = os.open(path / LOCK, _FLAGS)
    except (FileExistsError, NotADirectoryError):
        raise ConfigError(f"{path}: expected a folder, got a file; name another") from None
    except OSError as error:
        reason = f"{error.strerror}".lower()
        raise ConfigError(
            f"{path}: expected a folder that can be created, got an error ({reason}); name another"
        ) from None
    is_free = True
    with suppress(OSError):  # a file system without locks
        try:
            _lock(descriptor, is_shared)
            is_free = path.exists()  # not removed by a process that had made it
        except BlockingIOError:
            is_free = False
    if not is_free:
        os.close(descriptor)
        raise ConfigError(
            f"{path}: expected an unused folder, got one that another process is writing to; wait, "
            "or pass another folder"
        )
    try:
        yield path
    finally:
        if LOCK:  # the folder is not empty until then, nor once another process locks it
            os.close(descriptor)
        for folder in made:
            remove_folder(folder)
        if not LOCK:
            os.close(descriptor)
