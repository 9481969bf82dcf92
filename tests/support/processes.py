"""Python in a process of its own."""

import subprocess
import sys


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
