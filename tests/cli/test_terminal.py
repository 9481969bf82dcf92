"""Text for the terminal has no control characters, and a plan names no folder beyond its own."""

import ast
import os
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from commands import call, content, refusal, write_part
from rich.table import Table
from rich.text import Text

import rastercov as rc
from rastercov.cli import console, terminal
from rastercov.core.camera.conventions import write_poses
from rastercov.placement.plan.file import Plan, PlanError
from rastercov.placement.plan.sections import Outputs

HOSTILE = "\x1b[31m\x1b]0;x\x07 \x9b2J\u202eend"
"""Escape codes of colour, title and cleared screen, and a change of direction."""
TOML = HOSTILE.replace("\x1b", "\\u001b").replace("\x07", "\\u0007").replace("\x9b", "\\u009b")
PLAN = f"""
meshes = [{{ path = "part.obj" }}]
candidates = [{{ generator = "on_sphere", count = 12, distances = [3.5] }}]
camera = {{ width = 96, height = 72, fx = 90, fy = 90 }}
selection = {{ goal = "best_coverage", cameras = 2 }}
outputs = {{ page = false }}
sheet = {{ project = "{TOML}" }}
"""
COMMANDS = (
    "place plan.toml",
    "check plan.toml -p rig.json --min-coverage 0.1 --level 1",
    "evaluate part.obj -c cam.toml -p rig.json -o {0} --table seen --pictures 0 --level 1",
    "render part.obj -c cam.toml -p rig.json -o {0}drawn",
    "convert named.json {0}.yaml",
    "convert cam.toml {0}2.yaml",
    "audit named.json part.obj -o {0}audited",
    "view part.obj -c cam.toml -p rig.json --export {0}.html",
    "sun part.obj --latitude 49 --longitude 8 --day 2026-03-21 --step 60 -o {0}sun",
    "sheet plan/ -o {0}.svg",
    "cameras --catalogue own.toml ours",
)
JSON = ("json_text", "json_bytes", "dumps")


def test_nothing_but_json_is_printed_past_the_console():
    for path in Path(console.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, ast.Call) or getattr(node.func, "id", "") != "print":
                continue
            text = ast.unparse(node.args[0])
            is_ours = isinstance(node.args[0], ast.Constant) or "SKILL.md" in text
            assert (
                path.name in ("console.py", "terminal.py")
                or is_ours
                or any(f"{name}(" in text for name in JSON)
            )


def test_tables_are_plain_but_for_their_own_styles(capsys):
    table = Table(HOSTILE, header_style="bold")
    table.add_row(Text(HOSTILE, "red"))
    for item in (table, HOSTILE, Text(f"a\n{HOSTILE}")):
        terminal.Console().print(item)
        assert not {c for c in capsys.readouterr().out if not (c.isprintable() or c == "\n")}
    terminal.Console(force_terminal=True, color_system="standard").print(table)
    out = capsys.readouterr().out
    assert "\x1b[31m" in out  # the style of the cell
    assert not re.search("\x1b(?!\\[[0-9;]*m)|\x07|\x9b|\u202e", out)


def test_no_control_character_of_a_name_or_folder_reaches_the_terminal(here, monkeypatch, capsys):
    folder = here / HOSTILE
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_part("part.obj", names={0: f"lid{HOSTILE}", 2: "rest"})
    poses = rc.look_at(3.5 * np.eye(3), np.zeros(3))
    write_poses("rig.json", poses)
    Path("cam.toml").write_text("width = 96\nheight = 72\nfx = 90\nfy = 90\n")
    camera = rc.Camera(width=96, height=72, fx=90, fy=90)
    views = rc.Views(rc.Rig([camera], ["a"]), rc.Poses.of(poses), images=("a", "b", "c"))
    rc.write_views("named.json", views)
    Path("plan.toml").write_text(PLAN)
    Path("own.toml").write_text(
        f'[cameras.ours]\nwidth = 96\nheight = 72\npixel_size = 2e-6\nproduct = "{TOML}"\n'
    )
    for line in COMMANDS:
        words = [word.format(str(folder / HOSTILE)) for word in line.split(" ")]
        code, out, err = call(capsys, words)
        assert code in (0, 1), (line, err)
        assert out, line
        assert not {c for c in out + err if not (c.isprintable() or c == "\n")}, line


PIECES = ["a", "..", ".", "b", "away", "inward", "\x1b[31m", "é"]
PATHS = ["../outside", "{}/outside", "away", "away/new", "a/../../x"]


@pytest.fixture
def plans(here):
    """Folder of a plan with a link out of it, one within it, and one in place of its results."""
    folder = here / "plans"
    (folder / "a" / "b").mkdir(parents=True)
    (here / "outside").mkdir()
    (folder / "away").symlink_to("../outside")
    (folder / "inward").symlink_to("a/b")
    (folder / "linked").symlink_to("../outside")
    return folder


def test_results_of_a_plan_are_in_its_folder_or_refused(here, plans):
    every = [name for n in (1, 2, 3) for name in map("/".join, product(PIECES, repeat=n))]
    outcomes = set()
    for name in [*every, *(f"{here}/{each}" for each in every), *PATHS]:
        plan = Plan.model_construct(outputs=Outputs(folder=name.format(here)))
        plan._path = plans / "plan.toml"
        base, there = (os.path.realpath(each) for each in (plans, plans / name.format(here)))
        is_within = os.path.commonpath([there, base]) == base and name.isprintable()
        outcomes.add(is_within)
        if is_within:
            assert plan.results() == plans / name.format(here)
            continue
        with pytest.raises(
            PlanError, match=r"outputs.folder: expected a folder below.* --out$"
        ) as e:
            plan.results()
        assert str(e.value).isprintable()
    assert outcomes == {True, False}


@pytest.mark.parametrize("name", PATHS)
def test_place_writes_nothing_to_a_folder_that_only_a_plan_names(capsys, here, plans, name):
    write_part(plans / "part.obj")
    text = PLAN.replace("page = false", f'page = false, folder = "{name.format(here)}"')
    (plans / "plan.toml").write_text(text)
    before = content(here)
    assert "outputs.folder: expected a folder below" in refusal(capsys, "place plans/plan.toml")
    assert content(here) == before
    assert call(capsys, "place plans/plan.toml --out outside")[0] == 0
    assert (here / "outside" / "poses.json").exists()
    (plans / "linked.toml").write_text(PLAN)
    assert "got 'linked'" in refusal(capsys, "place plans/linked.toml")
