"""Shards made by other processes: workers of this machine, or those of a Dask scheduler.

    head:   job folder -> numbers of missing shards -> scheduler -> results of a few numbers each
    worker: number -> shard, written into the job folder aside and renamed

Nothing but numbers passes through the scheduler. What a shard depends on lies in the folder, which
all processes share; so a worker that dies loses its shard at most, and the bytes of a shard do not
depend on the process that made it. A scheduler needs the extra `cluster` (dask, distributed).

address.py      the addresses that are safe to connect to
workers.py      `Workers`: the choice of processes, and their client
job.py          `Job`: a folder and a function; what a worker does with a number
run.py          `make_shards`: numbers in flight, retries, a scheduler that is lost
process.py      processes of this machine, called through pipes
quarantine.py   the poses of a shard that kill their process
tally.py        where the time went, by worker
files.py        files with checksums
scene_file.py   mesh and cameras in a job folder
"""

from rastercov.cluster.job import Job, Made
from rastercov.cluster.run import make_shards
from rastercov.cluster.tally import Tally
from rastercov.cluster.workers import Workers

__all__ = ["Job", "Made", "Tally", "Workers", "make_shards"]
