"""Poses that kill their process, found by halving a shard in processes of its own.

The worker itself lives on: `alone` runs in it and starts the processes. A shard whose worker died
by accident is made at the first attempt; otherwise the poses that kill are found one by one, noted
in the folder before the shard is written, and left out of it.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from rastercov.cluster.job import FolderLostError, Job, Made, work
from rastercov.errors import ConfigError, RastercovError

FOLDER = "quarantine"
"""Folder in that of the job; a file for each shard with poses that were left out."""
FAILED, LOST = 3, 4
"""Exit codes of a process that ended by itself, with an error; of a folder that is lost."""


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
    poses = None if only is None else list(only)
    asked = json.dumps([list(job), number, list(leave_out), poses])
    command = [sys.executable, "-m", "rastercov.cluster.quarantine"]
    done = subprocess.run(
        command, input=asked, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    last = (done.stderr.strip().splitlines() or ["without a word"])[-1]
    if done.returncode == 0:
        return Made(*json.loads(done.stdout.splitlines()[-1]))
    if done.returncode < 0:
        return f"was killed by {signal.Signals(-done.returncode).name}"
    if done.returncode == FAILED:
        raise ConfigError(last)
    if done.returncode == LOST:
        raise FolderLostError(last)
    raise RastercovError(f"a worker failed: {last}")


def _note(folder: Path, number: int, guilty: dict[int, str]) -> None:
    path = folder / FOLDER / f"shard-{number}.json"
    path.parent.mkdir(exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(guilty, indent=2) + "\n", encoding="utf-8")
    part.replace(path)


def forget(folder: Path, number: int) -> None:
    """Remove the note on a shard that has all its poses."""
    (folder / FOLDER / f"shard-{number}.json").unlink(missing_ok=True)


def quarantined_of(folder: Path, number: int) -> dict[int, str]:
    """Poses left out of a shard, by their number within it, and why."""
    path = folder / FOLDER / f"shard-{number}.json"
    if not path.exists():
        return {}
    entries = json.loads(path.read_text(encoding="utf-8"))
    return {int(pose): str(why) for pose, why in entries.items()}


def quarantined(folder: Path, n_shards: int) -> dict[int, dict[int, str]]:
    """Poses left out of each shard of a folder that lacks some, as `quarantined_of`."""
    numbers = range(n_shards) if (folder / FOLDER).is_dir() else ()
    return {number: found for number in numbers if (found := quarantined_of(folder, number))}


def _main() -> int:
    job, number, leave_out, only = json.loads(sys.stdin.read())
    try:
        made = work(Job(*job), number, leave_out, only)
        if not leave_out and only is None:
            forget(Path(job[0]), number)
    except RastercovError as error:
        sys.stderr.write(f"{error}\n")
        return FAILED
    except OSError as error:
        sys.stderr.write(f"{error}\n")
        return LOST
    sys.stdout.write(json.dumps(list(made)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(_main())
