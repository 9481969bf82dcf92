"""A matrix that workers make, in which one pose kills the process that measures it."""

import os
import signal

import numpy as np

from rastercov.placement import matrix, shard_work

POISONED, SMALL = 3, 2
"""The pose, and the poses of a shard."""
FUNCTION = "killing_shards:make"


def make(folder, number, *, leave_out=(), only=None):
    """`shard_work.make`, which one pose kills."""
    chosen = np.arange(SMALL * number, SMALL * (number + 1))
    chosen = np.delete(chosen, list(leave_out)) if only is None else chosen[list(only)]
    if POISONED in chosen:
        os.kill(os.getpid(), signal.SIGKILL)
    return shard_work.make(folder, number, leave_out=leave_out, only=only)


def build(*arguments, **options):
    """`build_matrix` with such workers."""
    before = matrix.SHARD_FUNCTION
    matrix.SHARD_FUNCTION = FUNCTION
    try:
        return matrix.build_matrix(*arguments, poses_a_shard=SMALL, **options)
    finally:
        matrix.SHARD_FUNCTION = before
