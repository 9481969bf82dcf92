"""Folder of shards: numbered files, each made from some consecutive poses.

Every file has a checksum, and appears under its name only when it is whole. The checksums are in
`sha256/`, in the format of `sha256sum -c`. A checksum is computed from the bytes that are then
decoded, so that no decoder reads damaged ones. It is written before its file: a run killed between
the two leaves a missing file, or one that is made again. Poses that kill the process which makes
their shard are left out of it; `quarantine/` has a note for each such shard.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import rastercov
from rastercov.base import ConfigError, name_file, own_folder, remove_folder
from rastercov.base.output import PART, is_own_folder, remove_file, replacing, sync

SUMS, QUARANTINE = "sha256", "quarantine"
"""Folders of the checksums of all files, and of the notes on poses that were left out."""
Note = Callable[[str], None]


class DamagedError(ConfigError):
    """A file of a folder has changed since it was written; the message names file and reason."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: expected the file as it was written, got {why}")


def contents(folder: Path, name: str) -> bytes | None:
    """Bytes of a file, None where it is missing.

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
        raise DamagedError(folder / name, f"a read error ({error.strerror})") from None
    try:
        is_whole = sum_file(folder, name).read_bytes() == _sum_line(name, data)
    except OSError:
        raise DamagedError(folder / name, "no checksum") from None
    if not is_whole:
        raise DamagedError(folder / name, "another checksum")
    return data


def whole(folder: Path, name: str) -> bytes:
    """Bytes of a file; DamagedError as for `contents`, and where it is missing."""
    data = contents(folder, name)
    if data is None:
        raise DamagedError(folder / name, "no such file")
    return data


def store(folder: Path, name: str, data: bytes | memoryview) -> None:
    """Write a file, and its checksum before it."""
    for path, content in ((sum_file(folder, name), _sum_line(name, data)), (folder / name, data)):
        if path.parent != folder:
            own_folder(path.parent)
        _write(path, content)


def renew(folder: Path, name: str, data: bytes, note: Note) -> None:
    """Write a file unless it is there with this content; `note` names a damaged one."""
    try:
        if contents(folder, name) == data:
            return
    except DamagedError as error:
        note(f"{error}; written again")
    store(folder, name, data)


def discard(folder: Path, name: str) -> None:
    """Remove a file and its checksum; again it does nothing."""
    for path in (folder / name, sum_file(folder, name)):
        if path.parent == folder or is_own_folder(path.parent):
            remove_file(path)


def sum_file(folder: Path, name: str) -> Path:
    """File with the checksum of a file."""
    return folder / SUMS / f"{Path(name).name}.sha256"


def _sum_line(name: str, data: bytes | memoryview) -> bytes:
    """Line of `sha256sum` for a file, relative to the folder."""
    return f"{hashlib.sha256(data).hexdigest()}  {name}\n".encode()


def _write(path: Path, data: bytes | memoryview) -> None:
    """Write a file atomically: it appears under its name when it is complete and on the disk."""
    with name_file(path):
        with replacing(path) as part:
            part.write_bytes(data)
            sync(part)
        sync(path.parent)  # makes the new name durable


def remove_halves(folder: Path) -> None:
    """Remove files that a run which was killed left half written."""
    inside = [path for path in folder.iterdir() if path.is_dir() and not path.is_symlink()]
    for part in (part for where in (folder, *inside) for part in where.iterdir()):
        if PART.fullmatch(part.name):
            remove_file(part)


def remove(folder: Path, names: Sequence[str]) -> None:
    """Remove files of these names, which may have wildcards, and their folders that are empty.

    ConfigError for a folder that is a link; nothing is removed then.
    """
    parents = sorted({(folder / name).parent for name in names}, reverse=True)
    for path in parents:
        is_own_folder(path)
    for name in names:
        for path in folder.glob(name):
            remove_file(path)
    for path in parents:
        remove_folder(path)


@dataclass(frozen=True)
class ShardStore:
    """Shards of a folder, whose other files have what they depend on.

    Attributes
    ----------
    folder : Path
        The same for all workers.
    pattern : str
        Name of the file of a shard, with braces for its number.
    n_poses, poses_a_shard : int
    function : str
        As "module:function", by which a worker makes the content of a shard:

            function(folder: Path, number: int | None, poses: (K,) int64) -> bytes

        Poses are numbers of poses. Without a number they are only tried out.
    version : str
        Version of rastercov that the shards are made with.
    device : str
        Device that processes of this machine open, by its label; "" for their own choice.
    """

    folder: Path
    pattern: str
    n_poses: int
    poses_a_shard: int
    function: str
    version: str = rastercov.__version__
    device: str = ""

    def __len__(self) -> int:
        """Number of shards, at least one."""
        return max(1, -(-self.n_poses // self.poses_a_shard))

    def rows(self, number: int) -> slice:
        """Poses of a shard."""
        start = number * self.poses_a_shard
        return slice(start, min(start + self.poses_a_shard, self.n_poses))

    def name(self, number: int) -> str:
        """Name of a shard in the folder."""
        return self.pattern.format(str(number).zfill(max(5, len(str(len(self) - 1)))))

    def missing(self) -> dict[int, int]:
        """Number of poses of each shard that is not there."""
        numbers = [n for n in range(len(self)) if not (self.folder / self.name(n)).exists()]
        return {number: self.rows(number).stop - self.rows(number).start for number in numbers}

    def read(self, number: int) -> bytes | None:
        """Bytes of a shard, None where it is missing; errors as of `contents`."""
        return contents(self.folder, self.name(number))

    def write(self, number: int, data: bytes | memoryview) -> None:
        """Write a shard."""
        store(self.folder, self.name(number), data)

    def mend(self, note: Note, check: Callable[[int], object], own: Sequence[int]) -> None:
        """Remove damaged shards, those beyond the last, and where notes on poses are damaged.

        Only shards of the numbers `own` are looked at, which no other process makes meanwhile.
        `check` reads a shard by its number, such as `read`, or raises `DamagedError`; it is called
        with all that are there. `note` is called with a line on each that is removed.
        """
        names = {self.folder / self.name(number) for number in range(len(self))}
        for stray in sorted(set(self.folder.glob(self.pattern.format("*"))) - names):
            note(f"{stray}: expected a shard of this job, got another file; removed")
            discard(self.folder, str(stray.relative_to(self.folder)))
        missing = self.missing()
        for number in own:
            try:
                self.missing_rows(number)
                if number not in missing:
                    check(number)
            except DamagedError as error:
                note(f"{error}; evaluated its poses again")
                self.note(number, {})
                discard(self.folder, self.name(number))

    def note(self, number: int, left_out: dict[int, str]) -> None:
        """Note the poses that a shard is without, by their number in it, and why; none of none."""
        if left_out:
            store(self.folder, _note(number), (json.dumps(left_out, indent=2) + "\n").encode())
        else:
            discard(self.folder, _note(number))

    def missing_rows(self, number: int) -> dict[int, str]:
        """Poses left out of a shard, by their number within it, and why.

        Raises
        ------
        DamagedError
            Where the note on them has changed, or was removed and its checksum was not.
        """
        name = _note(number)
        data = contents(self.folder, name)
        if data is None and sum_file(self.folder, name).exists():
            raise DamagedError(self.folder / name, "no such file")
        entries = {} if data is None else json.loads(data)
        return {int(pose): str(why) for pose, why in entries.items()}

    def quarantined(self) -> dict[int, str]:
        """Poses that all shards are without, and why; errors as of `missing_rows`."""
        return {
            self.rows(number).start + pose: why
            for number in range(len(self))
            for pose, why in self.missing_rows(number).items()
        }


def _note(number: int) -> str:
    return f"{QUARANTINE}/shard-{number}.json"
