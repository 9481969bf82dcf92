"""Little memory: one line that says so, exit code 2, for any limit and command."""

import subprocess
import sys
from pathlib import Path

import pytest
from commands import ENTRY, without_progress, write_part
from nightly import amount

from rastercov import cli
from rastercov.base.errors import is_out_of_memory

LINES = (
    "evaluate part.obj -c khepra -p sphere:2 -o out",
    "place plan.toml -o out",
    "doctor",
)
PLAN = """
meshes = [{path = "part.obj"}]
camera = {preset = "khepra"}
candidates = [{generator = "on_sphere", count = 9, distances = [3.5]}]
selection = {goal = "fewest_cameras", coverage = 0.5, method = "integer"}
"""


def limited(line, kilobytes):
    shell = f'ulimit -v {kilobytes}; exec "$@"'
    words = ["sh", "-c", shell, "sh", sys.executable, "-c", ENTRY, *line.split()]
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)


def check_line(result):
    assert result.returncode == 2, result.stderr
    said = without_progress(result.stderr)
    assert said.startswith("error: ")
    assert "memory" in said
    assert "defect" not in said
    assert said.count("\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other limits")
@pytest.mark.parametrize("megabytes", [100, 699])
def test_a_limit_below_what_is_needed_is_refused_in_one_line(here, megabytes):
    write_part("part.obj")
    result = limited(LINES[0], megabytes << 10)
    check_line(result)
    assert f"at least {cli.LEAST_MEMORY >> 20} MB of memory, got a limit of {megabytes} MB" in (
        result.stderr
    )
    assert not Path("out").exists()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other limits")
@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("megabytes", amount([150, 700], [150, 300, *range(700, 1000, 60)]))
def test_any_limit_gives_a_result_or_one_line(here, line, megabytes):
    write_part("part.obj")
    Path("plan.toml").write_text(PLAN)
    result = limited(line, megabytes << 10)
    if result.returncode != 0:
        check_line(result)


def test_an_import_that_fails_for_memory_is_told_from_others():
    error = ImportError("please read this")
    error.__cause__ = ImportError("libx.so: failed to map segment from shared object")
    assert is_out_of_memory(error)
    assert not is_out_of_memory(ImportError("no module named x"))
    assert is_out_of_memory(RuntimeError("can't start new thread"))
