"""The `rastercov` command, with a module for each of its commands.

Exit codes: 0 done, 1 a check failed, 2 bad usage or input, 130 interrupted. Results go to standard
output; warnings, errors and progress to standard error, an error as one line. SIGTERM ends a
command as Ctrl-C does, with exit code 143.
"""

import gc
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from rastercov.base.interrupts import (
    announce_end,
    code_of_interrupt,
    ignore_signals,
    is_announced,
    take_signals,
    was_interrupted,
)
from rastercov.base.streams import own_output

LEAST_MEMORY = 700 << 20
"""Bytes of address space below which Python or numpy may end the process, or fail to be loaded."""
LEAST_PRODUCT = 128
"""Rows of matrices whose product OpenBLAS takes its memory for."""
GARBAGE = 200_000
"""Objects that are made between two looks for garbage."""


def main() -> None:
    """Run the command as a process of its own."""
    take_signals()  # before anything that takes long to import
    # Modules leave many objects and no garbage: it is looked for hardly ever.
    gc.set_threshold(GARBAGE)
    own_output()
    # Names of files may hold what the terminal cannot show.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = _refuse_for_memory() or command(sys.argv[1:])
    except BaseException as error:
        # An interrupt before a command began, of which an import may have made another error, or a
        # second one while the first is reported.
        if not (isinstance(error, KeyboardInterrupt) or was_interrupted()):
            raise
        ignore_signals()
        code = code_of_interrupt()
        if not is_announced():
            announce_end()
            print("interrupted", file=sys.stderr, flush=True)
    from rastercov.cli.console import leave

    gc.freeze()  # the process ends, and a look for garbage would take 0.1 s
    leave(code)


def _refuse_for_memory() -> int:
    """Exit code for a limit of memory that is too low, 0 for another; before numpy is imported.

    OpenBLAS has one thread: others only wait at products of matrices with three columns. It ends
    the process for want of memory: under a limit its 40 MB are taken while they are there.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        import resource
    except ImportError:  # not on Windows
        return 0
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return 0
    if limit >= LEAST_MEMORY:
        import numpy as np

        matrix = np.ones((LEAST_PRODUCT, LEAST_PRODUCT))
        matrix @ matrix
        return 0
    from rastercov.cli.console import say

    return say(
        f"error: expected at least {LEAST_MEMORY >> 20} MB of memory, got a limit of "
        f"{limit >> 20} MB; raise it: ulimit -v unlimited"
    )


def command(arguments: Sequence[str]) -> int:
    """Exit code of the command; see `console.exit_code`."""
    from rastercov.cli.console import exit_code, group, show_notices

    with show_notices():
        return exit_code(group(), arguments)
