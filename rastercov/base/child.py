"""Environment of the Python processes that this package starts: what they may import."""

import os
import sys
from contextlib import suppress
from pathlib import Path


def child_environment() -> dict[str, str]:
    """Environment of a process that finds the modules of this one, and none in the working folder.

    Python itself would put the working folder first for `-c` and `-m`, and takes an empty entry of
    PYTHONPATH for it. It stays only where this package lies in it.
    """
    return os.environ | {"PYTHONPATH": os.pathsep.join(_paths()), "PYTHONSAFEPATH": "1"}


def _paths() -> list[str]:
    """Entries of the path of this process, without the working folder."""
    here, root = None, Path(__file__).resolve().parents[2]
    with suppress(OSError):  # it was removed
        here = Path.cwd()
    paths = [Path(here or "", entry) for entry in sys.path]
    return [
        str(path)
        for path in paths
        if path.is_absolute() and (path.resolve() == root or path.resolve() != here)
    ]
