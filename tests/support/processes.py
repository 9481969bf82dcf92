"""Python programs in processes of their own."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]


def run_python(*command, paths=(), timeout=300, **environment):
    """Run `python *command` with this checkout, tests/support and `paths` to import, to success."""
    paths = map(str, (TESTS.parent, TESTS / "support", *paths))
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)} | environment,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done
