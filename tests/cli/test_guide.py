"""The guide for assistants, and the map of the documentation: what they name is there and runs."""

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest
from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
from commands import call
from nightly import nightly
from reader import write_files
from short_search import short_search  # noqa: F401 # a fixture for every test

import rastercov as rc
from rastercov.cli.console import COMMANDS, LazyCommand
from rastercov.placement.plan.file import read_plan

ROOT = Path(__file__).parents[2]
DOCS, DATA = ROOT / "docs", ROOT / "rastercov" / "data"
GUIDE = (DATA / "SKILL.md").read_text(encoding="utf-8")
SCHEMA = json.loads((DOCS / "answers.schema.json").read_text(encoding="utf-8"))
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)
PART, ROOM, MORE = (text for language, text in BLOCKS if language == "toml")
LINES = [line for language, text in BLOCKS if language == "sh" for line in text.splitlines()]


def options(name):
    """Options of a command, and of those in it."""
    command = LazyCommand(name).loaded
    parameters = [command, *getattr(command, "commands", {}).values()]
    return {option for each in parameters for entry in each.params for option in entry.opts}


def keys(schema):
    """Names of all entries of a schema."""
    if isinstance(schema, list):
        return set().union(*map(keys, schema))
    if not isinstance(schema, dict):
        return set()
    return set(schema.get("properties", ())).union(*map(keys, schema.values()))


def table(title):
    """Rows of a table by the heading of its first column, cells of each."""
    rows = GUIDE.partition(f"\n| {title} |")[2].partition("\n\n")[0].splitlines()[2:]
    return [row.strip("| ").split(" | ") for row in rows]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.toml").write_text(PART, encoding="utf-8")
    return tmp_path


def test_the_doctor_prints_the_guide(capsys):
    assert call(capsys, "doctor --guide") == (0, GUIDE, "")


def test_commands_and_options_of_the_guide_exist():
    asked = [text for _, cell in table("question") for text in re.findall(r"`([^`]+)`", cell)]
    named = {line.split()[0]: line for line in asked}
    assert set(named) == set(COMMANDS) - {"demo", "compare", "validate"}
    for name, line in named.items():
        assert set(re.findall(r"--[\w-]+", line)) <= options(name)
    every = set().union(*map(options, COMMANDS))
    found = set(re.findall(r"--[a-z][\w-]+", GUIDE)) - {"--help"}
    assert len(found) > 15
    assert found <= every


def test_keys_of_the_guide_are_in_the_schema():
    named = [name for row in table("key") for name in re.findall(r"`(\w+)`", row[0])]
    assert len(named) > 15
    assert [name for name in named if name not in keys(SCHEMA["$defs"])] == []


@pytest.mark.slow
@pytest.mark.parametrize("row", range(len(LINES)))
def test_a_line_of_the_guide_runs_and_prints_json(row, folder, capsys):
    if "plan/poses.json" in LINES[row]:
        call(capsys, shlex.split(LINES[row - 1])[1:])
    code, out, err = call(capsys, shlex.split(LINES[row])[1:])
    assert code == 0, err
    assert json.loads(out)


def test_plans_of_the_guide_are_read(folder):
    assert read_plan(folder / "plan.toml").selection.coverage == 0.95
    (folder / "room.toml").write_text(ROOM, encoding="utf-8")
    assert read_plan(folder / "room.toml").selection.cameras == 6
    mesh, selection = PART.partition("[camera]")[0], PART.partition("[selection]")[2]
    text = f"{mesh}[selection]{selection}{MORE}"
    (folder / "more.toml").write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "examples" / "arm.urdf", "robot.urdf")
    rc.write_poses("views.npy", rc.sphere_of_poses((0, 0, 0), distance=0.3, count=3))
    more = read_plan(folder / "more.toml")
    assert more.goals["private"].at_most == 0
    assert more.rigs["stereo"].max_uncertainty == "50 um"


@nightly
@pytest.mark.slow
def test_the_room_of_the_guide_is_watched(folder, capsys):
    (folder / "room.toml").write_text(ROOM, encoding="utf-8")
    code, out, err = call(capsys, "place room.toml --out room --json")
    assert code == 0, err
    assert len(json.loads(out)["cameras"]) <= 6


def test_the_map_is_small_and_leads_to_pages():
    assert (DOCS / "llms.txt").resolve() == DATA / "llms.txt"
    text = (DATA / "llms.txt").read_text(encoding="utf-8")
    assert len(text.encode()) <= 2048
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert len(links) == len(set(links)) > 30
    assert [name for name in links if not (DOCS / name).is_file()] == []
