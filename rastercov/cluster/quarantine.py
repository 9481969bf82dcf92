"""Poses that kill their process, found by halving a shard in processes of its own.

The worker itself lives on: `alone` runs in it and starts the processes. A shard whose worker died
by accident is made at the first attempt; otherwise the poses that kill are found one by one, noted
in the folder before the shard is written, and left out of it.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from rastercov.base.errors import RastercovError
from rastercov.cluster.files import DamagedError, contents, discard, has_sum, store
from rastercov.cluster.job import Job, Made, work
from rastercov.cluster.process import Process, ProcessEndedError

FOLDER = "quarantine"
"""Folder in that of the job; a file for each shard with poses that were left out."""


def alone(job: Job, number: int, n_poses: int) -> Made:
    """Make a shard in a process of its own, without the poses that kill it."""
    made = _in_process(job, number)
    if isinstance(made, Made):
        return made
    guilty = dict(_guilty(job, number, range(n_poses), made))
    if not guilty:
        raise RastercovError(
            f"shard {number}: its process {made}, with all poses but with none of them alone; run "
            "again with fewer workers, so that each has more memory"
        )
    _note(Path(job.folder), number, guilty)
    made = _in_process(job, number, leave_out=list(guilty))
    if not isinstance(made, Made):
        raise RastercovError(f"shard {number}: its process {made}, also without poses {guilty}")
    return made._replace(quarantined=guilty)


def _guilty(job: Job, number: int, poses: Sequence[int], end: str) -> list[tuple[int, str]]:
    """Poses of a part that kills its process, each with the end of the process."""
    if len(poses) == 1:
        return [(poses[0], end)]
    found = []
    for half in (poses[: len(poses) // 2], poses[len(poses) // 2 :]):
        outcome = _in_process(job, number, only=list(half))
        if not isinstance(outcome, Made):
            found += _guilty(job, number, half, outcome)
    return found


def _in_process(
    job: Job, number: int, leave_out: Sequence[int] = (), only: Sequence[int] | None = None
) -> Made | str:
    """Cost of a shard in a process of its own, or words on how the process was killed.

    Raises
    ------
    RastercovError, FolderLostError
        For an error that the process reports.
    """
    with Process() as process:
        try:
            made: Made = process.call(work, job, number, leave_out, only)
        except ProcessEndedError as error:
            if not error.was_killed:
                raise RastercovError(f"a worker failed: its process {error}") from None
            return str(error)
    return made


def _note(folder: Path, number: int, guilty: dict[int, str]) -> None:
    store(folder, _name(number), (json.dumps(guilty, indent=2) + "\n").encode())


def forget(folder: Path, number: int) -> None:
    """Remove the note on a shard that has all its poses."""
    discard(folder, _name(number))


def quarantined_of(folder: Path, number: int) -> dict[int, str]:
    """Poses left out of a shard, by their number within it, and why.

    Raises
    ------
    DamagedError
        Where the note on them has changed, or was removed and its checksum was not.
    """
    name = _name(number)
    data = contents(folder, name)
    if data is None and has_sum(folder, name):
        raise DamagedError(folder / name, "it is missing")
    entries = {} if data is None else json.loads(data)
    return {int(pose): str(why) for pose, why in entries.items()}


def quarantined(folder: Path, n_shards: int) -> dict[int, dict[int, str]]:
    """Poses left out of each shard of a folder that lacks some, as `quarantined_of`."""
    every = {number: quarantined_of(folder, number) for number in range(n_shards)}
    return {number: found for number, found in every.items() if found}


def drop_damaged(folder: Path, shards: Sequence[str], note: Callable[[str], None]) -> None:
    """Remove damaged notes with their shards, which are then made again; a line on each."""
    for number, shard in enumerate(shards):
        try:
            quarantined_of(folder, number)
        except DamagedError as error:
            note(f"{error}; its poses are measured again")
            forget(folder, number)
            discard(folder, shard)


def _name(number: int) -> str:
    return f"{FOLDER}/shard-{number}.json"
