"""Every example runs by itself, without a warning, and says something."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from notices import without_notices

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))


def test_there_are_examples():
    assert EXAMPLES


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_runs(path, tmp_path):
    result = subprocess.run(
        [sys.executable, "-W", "error", str(path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (result.returncode, without_notices(result.stderr)) == (0, "")
    shares = [float(share) for share in re.findall(r"([-\d.]+) %", result.stdout)]
    assert shares
    assert all(0 < share <= 100 for share in shares)
    assert "nan" not in result.stdout.lower()
    assert list(tmp_path.iterdir()) == []
