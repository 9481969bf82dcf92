"""A job whose shards cost nothing, with faults that a file in its folder asks for.

job.json: {"poses": 8, "seconds": 0.1, "kill": [3], "raise": {"5": "config" | "disk" | "other"}}
"kill" and "raise" count poses and shards of the whole job.
"""

import errno
import json
import os
import signal
import sys
import time
from pathlib import Path

from rastercov.base.errors import ConfigError
from rastercov.shards import ShardStore

FUNCTION = "cluster_job:make"


def prepared(folder, n_shards=10, poses=8, **settings):
    """Store of a new folder."""
    folder.mkdir()
    (folder / "job.json").write_text(json.dumps({"poses": poses, **settings}))
    return store_of(folder, n_shards)


def store_of(folder, n_shards):
    poses = json.loads(Path(folder, "job.json").read_text())["poses"]
    return ShardStore(Path(folder), "shards/{}", n_shards * poses, poses, FUNCTION)


def make(folder, number, chosen):
    settings = json.loads((folder / "job.json").read_text())
    n_poses = settings["poses"]
    for pose in chosen:
        if pose in settings.get("kill", ()):
            os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(settings.get("seconds", 0))
    what = settings.get("raise", {}).get(str(chosen[0] // n_poses))
    if what == "config":
        raise ConfigError("shard 5 is not to be had")
    if what == "disk":
        raise OSError(errno.ENOSPC, "No space left on device", f"{folder}/shards/{number}")
    if what == "other":
        raise ZeroDivisionError("a defect")
    return json.dumps((chosen % n_poses).tolist()).encode()


HEAD = """
import sys
import cluster_job
from rastercov.shards import Workers, make_shards
store = cluster_job.store_of(sys.argv[1], int(sys.argv[2]))
make_shards(Workers(2), store, lambda made: None, print)
"""
SUPPORT = Path(__file__).parent
ENVIRONMENT = {"PYTHONPATH": os.pathsep.join([str(SUPPORT.parents[1]), str(SUPPORT)])}
"""Path on which a process finds the package and this module."""


def head(folder, n_shards):
    """Words of a program that makes all shards of a job by two workers."""
    program = folder.with_name("head.py")
    program.write_text(HEAD)
    return [sys.executable, program, folder, str(n_shards)]
