"""`check --baseline`: all pairs of rigs around a box, its files, and baselines that are none."""

import copy
import functools
import json
import math
import operator
import re
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import answer, call, refusal, write_part

import rastercov as rc
from rastercov.camera.pose_file import write_poses
from rastercov.placement.plan.baseline import compare, words
from rastercov.placement.plan.check import check, record
from rastercov.placement.plan.file import plan_of

SIDES = np.concatenate((np.eye(3), -np.eye(3)))
POSES = rc.look_at(3.5 * SIDES, np.zeros(3))
CAMERA = {"width": 96, "height": 72, "fx": 90, "fy": 90}
CHECK = "check plan.toml -p rig.json"


@pytest.fixture(scope="module")
def told():
    """Outcomes of all rigs that see some sides of a box, by the sides that none sees."""
    entries = {"meshes": [{"built_in": "box"}], "camera": CAMERA}
    plan, every, found = plan_of(entries, Path("plan.toml")), range(6), {}
    for seen in (rows for n in range(1, 7) for rows in combinations(every, n)):
        outcome = record(check(plan, Path("rig.json"), {}, poses=POSES[list(seen)]))
        found[frozenset(every) - set(seen)] = json.loads(json.dumps(outcome))
    return found


def test_a_rig_is_worse_exactly_if_a_side_is_lost(told):
    for before, now in ((before, now) for before in told for now in told):
        found = compare({**told[before], "file": "base.json"}, told[now])
        assert bool(found.losses()) == (not now <= before)
        (whole,) = found.shares
        assert whole["share"] - whole["before"] == pytest.approx((len(before) - len(now)) / 6)
        assert whole["status"] == ("better", "same", "worse")[1 + np.sign(len(now) - len(before))]
        assert sum(zone["more_m2"] for zone in found.zones) == pytest.approx(len(now - before))
        assert {zone["status"] for zone in found.zones} <= {"new"} or not now.isdisjoint(before)


@pytest.fixture
def files(tmp_path, monkeypatch, capsys):
    """A part of two groups, a rig that loses one side of it, and the outcome of the whole rig."""
    monkeypatch.chdir(tmp_path)
    write_part("part.obj")
    part = Path("part.obj")
    part.write_text(part.read_text().replace("g lid", "g a|<b>"))
    camera = ", ".join(f"{name} = {value}" for name, value in CAMERA.items())
    Path("plan.toml").write_text(f'meshes = [{{ path = "part.obj" }}]\ncamera = {{ {camera} }}\n')
    write_poses("rig.json", POSES)
    assert call(capsys, f"{CHECK} --min-coverage 1 --out base")[0] in (0, 1)
    write_poses("rig.json", POSES[:5])


def test_files_for_build_servers_say_what_the_terminal_does(files, capsys):
    line = f"{CHECK} --baseline base/check.json --junit j.xml --summary s.md"
    for _ in range(2):  # files of an earlier check are replaced
        code, out, err = call(capsys, line)
    assert (code, err) == (1, "")
    lines = out.splitlines()
    said = {each.get("message") for each in ElementTree.parse("j.xml").iter("failure")}
    assert said == {
        each.removeprefix("worse: ") for each in lines if re.match("worse: |new: ", each)
    }
    assert any(each.startswith("new: dead zone 1 m²") for each in said)
    title, _, *rows = Path("s.md").read_text().splitlines()
    assert title == "## rastercov check plan.toml: fails"
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {4}
    assert sum(row.startswith("| fails |") for row in rows) == len(said)
    told = answer(capsys, f"{CHECK} --baseline base/check.json --json", code=1)
    assert told["baseline"]["zones"][0]["status"] == "new"
    assert "not of an earlier check" in refusal(capsys, f"{CHECK} --summary plan.toml")


def test_what_is_no_baseline_is_one_line(files, capsys):
    whole = json.loads(Path("base/check.json").read_text())
    for name in ("task", "all", "groups", "covered_area", "dead_faces"):
        for value in (None, 3, [{}], "x", [[1]], *([], {}) * (name != "dead_faces")):
            Path("b.json").write_text(json.dumps(whole | {name: value}))
            assert refusal(capsys, f"{CHECK} --baseline b.json").startswith("error: b.json: ")
    assert "views = 1, and this one has 2" in refusal(
        capsys, f"{CHECK} --views 2 --baseline base/check.json"
    )


def numbers_of(tree, path=()):
    """Paths of all numbers of a tree of tables and lists."""
    if isinstance(tree, int | float):
        return [path]
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    inner = [pair for pair in items if isinstance(pair[1], dict | list | int | float)]
    return [found for key, each in inner for found in numbers_of(each, (*path, key))]


HOSTILE = (math.nan, math.inf, -math.inf, -1e99, 1e99, -1, 1e-320, True, "7", [], None)


@pytest.mark.parametrize("number", HOSTILE, ids=str)
def test_a_baseline_with_any_number_of_it_replaced_is_refused_or_gives_finite_lines(told, number):
    now = told[frozenset((1, 2))]
    names = ("all", "groups", "dead_faces", "covered_area")
    for path in numbers_of({name: now[name] for name in names}):
        before = copy.deepcopy(now) | {"file": "base.json"}
        *above, last = path
        owner = functools.reduce(operator.getitem, above, before)
        owner[last] = number
        try:
            lines = compare(before, now).lines()
        except rc.ConfigError as error:
            lines = [str(error).removeprefix("base.json: no check.json of")]
        assert not re.search(r"\b(nan|inf)\b", " ".join(lines)), path


def test_a_difference_has_the_digits_of_its_bound():
    share = {"name": "all", "share": 0.9085431, "before": 0.9147649}
    texts = [words(share | {"bound": bound}) for bound in (5.4e-6, 0.03, 0.0)]
    figures = ["0.62218 ± 0.00054", "0.6 ± 3", "0.622180 ± 0"]
    assert [text.split(": ")[2] for text in texts] == [f"{each} points less" for each in figures]
