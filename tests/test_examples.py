"""Every example runs by itself, without a warning, and says something."""

import re
from pathlib import Path

import pytest
from notices import without_notices
from processes import python

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))


def test_there_are_examples():
    assert EXAMPLES


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_runs(path, tmp_path):
    result = python("-W", "error", path, cwd=tmp_path)
    assert (result.returncode, without_notices(result.stderr)) == (0, "")
    shares = [float(share) for share in re.findall(r"([-\d.]+) %", result.stdout)]
    assert shares
    assert all(0 < share <= 100 for share in shares)
    assert "nan" not in result.stdout.lower()
    assert list(tmp_path.iterdir()) == []
