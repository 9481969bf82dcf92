"""A job whose shards cost nothing, with faults that a file in its folder asks for.

job.json: {"poses": 8, "seconds": 0.1, "kill": [3], "raise": {"5": "config" | "disk" | "other"}}
"kill" and "raise" count poses and shards of the whole job.
"""

import errno
import json
import os
import signal
import time
from pathlib import Path

from rastercov.base.errors import ConfigError
from rastercov.cluster import Job

FUNCTION = "cluster_job:make"


def prepared(folder, n_shards=10, poses=8, **settings):
    """Job of a new folder, and a function that gives the missing shards."""
    folder.mkdir()
    (folder / "shards").mkdir()
    (folder / "job.json").write_text(json.dumps({"poses": poses, **settings}))

    def missing():
        return {
            number: poses
            for number in range(n_shards)
            if not (folder / f"shards/{number}").exists()
        }

    return Job.of(folder, FUNCTION), missing


def make(folder, number, *, leave_out=(), only=None):
    settings = json.loads((Path(folder) / "job.json").read_text())
    n_poses = settings["poses"]
    chosen = [pose for pose in range(n_poses) if pose not in leave_out]
    if only is not None:
        chosen = list(only)
    for pose in chosen:
        if number * n_poses + pose in settings.get("kill", ()):
            os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(settings.get("seconds", 0))
    what = settings.get("raise", {}).get(str(number))
    if what == "config":
        raise ConfigError("shard 5 is not to be had")
    if what == "disk":
        raise OSError(errno.ENOSPC, "No space left on device", f"{folder}/shards/{number}")
    if what == "other":
        raise ZeroDivisionError("a defect")
    if only is None:
        part = Path(folder) / f"shards/.{number}-{os.getpid()}.part"
        part.write_text(json.dumps(chosen))
        part.replace(Path(folder) / f"shards/{number}")
    return n_poses
