"""A matrix that workers make, in which one pose kills the process that measures it."""

import os
import signal

from rastercov.placement import matrix, matrix_folder

POISONED, SMALL = 3, 2
"""The pose, and the poses of a shard."""
FUNCTION = "killing_shards:make"


def make(folder, number, chosen):
    """`matrix_folder.make`, which one pose kills."""
    if POISONED in chosen:
        os.kill(os.getpid(), signal.SIGKILL)
    return matrix_folder.make(folder, number, chosen)


def build(*arguments, **options):
    """`build_matrix` with such workers."""
    before = matrix_folder.FUNCTION
    matrix_folder.FUNCTION = FUNCTION
    try:
        return matrix.build_matrix(*arguments, poses_a_shard=SMALL, **options)
    finally:
        matrix_folder.FUNCTION = before
