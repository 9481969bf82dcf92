"""Build a visibility matrix under `kill -9`: python kill_matrix.py KILLS POSES FOLDER [SEED].

One matrix is built undisturbed; another is killed at random moments and started again each time,
then finished. Prints one line of JSON: whether the two are the same, the kills that hit, how many
whole shards were written again, and what was left lying about.
"""

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

import numpy as np

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement.matrix import VisibilityMatrix, build_matrix

POSES_A_SHARD = 8


MESH = shapes.aeroplane()
CAMERA = rc.Camera(width=256, height=256, fx=300, fy=300)


def build(folder, poses):
    """Run a build in a process of its own; its id."""
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        build_matrix((MESH, CAMERA), poses, rc.Task(), folder, poses_a_shard=POSES_A_SHARD)
        status = 0
    finally:
        os._exit(status)


def whole_shards(folder):
    """Names and times of the shards that are there."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "pairs").glob("*.npz")}


def main():
    kills, n_poses, base = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    random.seed(int(sys.argv[4]) if len(sys.argv) > 4 else 0)
    poses = rc.sphere_of_poses(MESH.bounds.mean(axis=0), 38.0, n_poses)
    quiet, killed = base / "quiet", base / "killed"
    # Load what is compiled before the first fork; one thread, because threads do not survive it.
    with rc.open_observer(MESH, CAMERA, threads=1) as observer:
        build_matrix(observer, poses[:1])
    # What a folder needs is compiled in this one, so that the time of the next is that of others.
    assert os.waitpid(build(base / "first", poses[:1]), 0)[1] == 0
    started = time.perf_counter()
    assert os.waitpid(build(quiet, poses), 0)[1] == 0
    seconds = time.perf_counter() - started
    hits = rewritten = 0
    for _ in range(kills):
        before = whole_shards(killed)
        process = build(killed, poses)
        time.sleep(random.uniform(0, 1.5 * seconds / kills))
        os.kill(process, signal.SIGKILL)
        hits += os.waitpid(process, 0)[1] == signal.SIGKILL
        after = whole_shards(killed)
        rewritten += sum(after.get(name) != stamp for name, stamp in before.items())
    before = whole_shards(killed)
    assert os.waitpid(build(killed, poses), 0)[1] == 0
    after = whole_shards(killed)
    rewritten += sum(after[name] != stamp for name, stamp in before.items())
    one, other = VisibilityMatrix.load(quiet), VisibilityMatrix.load(killed)
    names = ("poses", "indptr", "face", "coverage")
    same = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
    left = [path.name for path in killed.rglob("*.part")]
    result = {"same": same, "kills": hits, "rewritten": rewritten, "left": left}
    print(json.dumps(result))


if __name__ == "__main__":
    main()
