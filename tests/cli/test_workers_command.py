"""The options --workers and --scheduler of place, evaluate and audit."""

import json
from pathlib import Path

import pytest
from commands import call, done, refusal

pytestmark = pytest.mark.slow
PLAN = """
meshes = [{ built_in = "teapot-5" }]
camera = { preset = "icube-ns4133bu-8mm" }
candidates = [{ generator = "on_sphere", count = 30 }]
selection = { goal = "fewest_cameras", coverage = 0.5, of_reachable = true }
outputs = { page = false }
"""


@pytest.fixture(autouse=True)
def files():
    Path("plan.toml").write_text(PLAN)


def figures(path):
    content = json.loads(Path(path).read_text())
    seconds = content.pop("seconds")
    return content, seconds


def test_place_by_workers_is_place(capsys):
    assert call(capsys, "place plan.toml -o plain")[0] == 0
    _, err = done(capsys, "place plan.toml -o workers --workers 2")
    (one, _), (other, seconds) = figures("plain/plan.json"), figures("workers/plan.json")
    assert one == other
    assert sum(each["poses"] for each in seconds["workers"].values()) == 30
    lines = err.splitlines()
    assert any(line.startswith("worker ") and "30 poses" in line for line in lines)


@pytest.mark.parametrize("command", ["place plan.toml", "evaluate teapot-5 -c khepra -p sphere:3"])
@pytest.mark.parametrize(
    ("words", "line"),
    [("--workers 0", "--workers: expected a number from 1 to 1024, got 0"),
     ("--workers 2 --scheduler tcp://127.0.0.1:1", "got 2 of them"),
     ("--scheduler tcp://10.1.2.3:8786", "anyone can run programs on the workers")],
)  # fmt: skip
def test_wrong_choices_are_one_line_and_leave_nothing(capsys, command, words, line):
    assert line in refusal(capsys, f"{command} -o out {words}")
    assert not Path("out").exists()
