"""Programs whose loops are compiled with bounds checks, for a processor without long vectors.

Both at once, so that one compilation serves the laws of memory and the law that every processor
gives the same results. Compiled loops are kept beside pytest's cache, for all tests and later runs;
`rastercov._jit` compiles those again whose source has changed. One program runs at a time: two that
start together would both compile everything.
"""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
KEPT = TESTS.parent / ".pytest_cache" / "bounds-checked"
SETTINGS = {
    "NUMBA_BOUNDSCHECK": "1",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_CACHE_DIR": str(KEPT),
}


def run_checked(code, *arguments, folder="."):
    """Run a program, which may import from tests/support and tests/`folder`; it must succeed."""
    KEPT.mkdir(parents=True, exist_ok=True)
    paths = [TESTS.parent, TESTS / "support", TESTS / folder]
    with (KEPT / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)],
            env=os.environ | SETTINGS | {"PYTHONPATH": os.pathsep.join(map(str, paths))},
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stderr
