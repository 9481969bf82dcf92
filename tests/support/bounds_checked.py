"""Programs whose loops are compiled with bounds checks, for a processor without long vectors.

Both at once, so that one compilation serves the laws of memory and the law that every processor
gives the same results. Compiled loops are kept beside pytest's cache, for all tests and later runs;
`kernels.jit` compiles those again whose source has changed. One program runs at a time: two that
start together would both compile everything.
"""

import fcntl

from processes import TESTS, run_python

KEPT = TESTS.parent / ".pytest_cache" / "bounds-checked"
SETTINGS = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}


def run_checked(code, *arguments, paths=(), level=3):
    """Run a program, as `processes.run_python` does; it must succeed.

    Optimisation `level` 1 compiles in less time; of level 0 numba keeps nothing on disk.
    """
    kept = KEPT / f"level {level}"
    kept.mkdir(parents=True, exist_ok=True)
    settings = SETTINGS | {"NUMBA_OPT": str(level), "NUMBA_CACHE_DIR": str(kept)}
    with (kept / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        run_python("-c", code, *arguments, paths=paths, timeout=900, **settings)
