"""Python programs in processes of their own."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]


def python(*words, timeout=300, **options):
    """Result of this Python with these words; what it says is text, and an error is no error."""
    return subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
        **options,
    )


def run_python(*words, paths=(), timeout=300, **environment):
    """Run Python to success with this checkout, tests/support and `paths` to import."""
    paths = os.pathsep.join(map(str, (TESTS.parent, TESTS / "support", *paths)))
    done = python(*words, timeout=timeout, env=os.environ | {"PYTHONPATH": paths} | environment)
    assert done.returncode == 0, done.stderr
    return done
