"""Shards of a job: files of a folder, made here or by other processes.

    head:   store -> numbers of missing shards -> pool of processes -> results of a few numbers each
    worker: number -> shard, written to a temporary file in the folder and renamed

Nothing but numbers passes through a pool. What a shard depends on lies in the folder, which all
processes share; so a worker that dies loses its shard at most, and the bytes of a shard do not
depend on the process that made it.

store.py        `ShardStore`: files with checksums, notes on poses that were left out, the lock
run.py          `fill`: all shards, made here or by workers, with retries
work.py         work on one shard by a worker; poses that kill their process; `Made`, `Tally`
workers.py      `Workers`: the processes of a pool
process.py      processes of this machine, called through pipes
inputs.py       header, mesh, cameras and poses in the folder of a store
"""

from rastercov.shards.run import ALONE, Progress, Staff, fill, make_shards, silent
from rastercov.shards.store import ShardStore
from rastercov.shards.work import Made, Tally
from rastercov.shards.workers import Workers

__all__ = [
    "ALONE",
    "Made",
    "Progress",
    "ShardStore",
    "Staff",
    "Tally",
    "Workers",
    "fill",
    "make_shards",
    "silent",
]
