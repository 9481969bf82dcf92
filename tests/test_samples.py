"""Frequent additions of CONTRIBUTING.md have samples, which are added, work, and are removed."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from samples import entries_of, names, size_of

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "CONTRIBUTING.md"
MOST_FILES, MOST_LINES = 3, 120
pytestmark = pytest.mark.skipif(not PAGE.is_file(), reason="a wheel has no page of additions")


def test_samples_work_together_wherever_their_rows_say_and_leave_nothing(tmp_path):
    line = [sys.executable, str(ROOT / "tests" / "support" / "samples.py"), str(ROOT)]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert sorted(re.findall(r"^checked (\w+)$", done.stdout, re.MULTILINE)) == names()


@pytest.mark.parametrize("name", names())
def test_a_sample_is_small_and_is_named_by_its_row(name):
    n_files, n_lines = size_of(name)
    assert (n_files <= MOST_FILES, n_lines <= MOST_LINES) == (True, True), (n_files, n_lines)
    rows = [row for row in PAGE.read_text(encoding="utf-8").splitlines() if row.startswith("| ")]
    (row,) = [row for row in rows if row.startswith(f"| {entries_of(name)['row']}")]
    assert f"tests/samples/{name}" in row


def test_every_sample_that_a_row_names_exists():
    named = re.findall(r"tests/samples/(\w+)", PAGE.read_text(encoding="utf-8"))
    assert sorted(named) == names()
