"""A reason has one number in the engine and in Python, its words, and the decision for it."""

import subprocess
from pathlib import Path

import rastercov
from rastercov.core.coverage.task import BASELINE, FIRST_OF_SEVERAL, NAMES, REASONS, Reason


def check(command, folder):
    """Compile the decision of the copy, and compare its numbers."""
    engine = Path(rastercov.__file__).parent / "engine"
    program, source = folder / "reasons", Path(__file__).with_name("reasons.cpp")
    own = [f"-I{engine / name}" for name in ("", "include", "c/without_python")]
    line = ["c++", "-std=c++20", "-w", *own, str(source), "-o", str(program)]
    subprocess.run(line, check=True)
    done = subprocess.run([program], check=True, capture_output=True, text=True)
    *reasons, rows = done.stdout.splitlines()
    wanted = [Reason.UNSAMPLED, Reason.TOO_SMALL, Reason.COVERED]
    assert [int(each) for each in reasons] == wanted
    assert [int(each) for each in rows.split()] == [FIRST_OF_SEVERAL, BASELINE]
    assert NAMES[Reason.TOO_SMALL] == "too_small"
    assert REASONS["too_small"].label == "too small"
