"""The guide for assistants, and the map of the documentation: what they name is there and runs."""

import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import call
from nightly import nightly
from reader import ASSEMBLY, write_files
from short_search import short_search  # noqa: F401 # a fixture for every test

import rastercov as rc
from rastercov.cli.console import COMMANDS, LazyCommand
from rastercov.placement.plan.file import read_plan
from rastercov.placement.targets import box_grid

ROOT = Path(__file__).parents[2]
DOCS, DATA = ROOT / "docs", ROOT / "rastercov" / "data"
GUIDE = (DATA / "SKILL.md").read_text(encoding="utf-8")
SCHEMA = json.loads((DOCS / "answers.schema.json").read_text(encoding="utf-8"))
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)
PART, ROOM, FLIGHT, MOTION, LAMP, MORE = (text for language, text in BLOCKS if language == "toml")
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
    values = set(re.findall(r"--[a-z][\w-]+", GUIDE)) - {"--help"}
    assert len(values) > 15
    assert values <= every


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


def test_a_spot_of_the_guide_is_a_cube_that_fills_its_box(folder):
    entry = tomllib.loads(MORE)["targets"][0]
    np.testing.assert_allclose(box_grid(*entry["box"], size=entry["size"]).bounds, entry["box"])


@pytest.mark.slow
def test_motion_and_lamp_of_the_guide_are_evaluated(folder, capsys):
    part = (folder / "as1.obj").read_text(encoding="utf-8")
    for name, group in zip(ASSEMBLY, ("base", "boss", "pin"), strict=True):
        part = part.replace(f"g {name}", f"g {group}")
    (folder / "turned.obj").write_text(part, encoding="utf-8")
    (folder / "motion.toml").write_text(MOTION.replace("36", "4"), encoding="utf-8")
    (folder / "lamps.toml").write_text(LAMP, encoding="utf-8")
    scene = "evaluate turned.obj -c 'width = 64, height = 48, hfov_deg = 60' -p sphere:2 --json"
    code, out, err = call(capsys, f"{scene} --motion motion.toml -o moved")
    assert code == 0, err
    assert len(json.loads(out)["over_time"]["by_frame"]) == 4
    code, out, err = call(capsys, f"{scene} --lamps lamps.toml -o lit")
    assert code == 0, err
    assert json.loads(out)["light"]["lamps"][0]["lamp"] == "ir"


def test_a_line_scan_camera_has_two_resolutions(folder, capsys):
    rc.write_poses("down.npy", rc.look_at([[0, 0, 0.2]], np.zeros(3)))
    scan = 'model = "telecentric", width = 64, height = 64, pixel_size = [7e-6, 5e-6]'
    camera = shlex.quote(f"{scan}, magnification = 0.1")
    code, out, err = call(capsys, f"evaluate part.ply -c {camera} -p down.npy -o scan")
    assert code == 0, err
    assert "14.3 px/mm along the width, 20 px/mm along the height" in " ".join(out.split())


@pytest.mark.slow
def test_the_flight_of_the_guide_is_planned(folder, capsys):
    trimesh.creation.box((40, 30, 1)).export("terrain.obj")
    (folder / "flight.toml").write_text(FLIGHT, encoding="utf-8")
    code, out, err = call(capsys, "place flight.toml -o flight --json")
    assert code == 0, err
    told = json.loads(out)
    flight, beside = told["flight"], "down beside the surface"
    assert flight["beside_surface"] > 0
    of_both = (
        [line for line in told_in if beside in line]
        for told_in in (flight["sentences"], told["notes"])
    )
    sentences, notes = of_both
    assert len(sentences) == 1
    assert sentences == notes
    assert (
        f"{1e3 * flight['gsd_per_px']:.3g} mm/px (median of the images)" in flight["sentences"][1]
    )
    assert told["selection"]["status_of"] == "all candidates, without a choice"


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
