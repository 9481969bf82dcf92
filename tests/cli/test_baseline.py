"""`check --baseline`: all pairs of rigs around a box, its files, and baselines that are none."""

import copy
import functools
import json
import math
import operator
import re
from itertools import combinations
from operator import and_
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import answer, call, refusal, write_part

import rastercov as rc
from rastercov.core.camera.conventions import write_poses
from rastercov.core.mesh import shapes
from rastercov.core.mesh.groups import parts_above
from rastercov.placement.plan.baseline import Tolerated, compare, words
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
    plan, every, table = plan_of(entries, Path("plan.toml")), range(6), {}
    for seen in (rows for n in range(1, 7) for rows in combinations(every, n)):
        outcome = record(check(plan, Path("rig.json"), {}, poses=POSES[list(seen)]))
        table[frozenset(every) - set(seen)] = json.loads(json.dumps(outcome))
    return table


def test_a_rig_is_worse_exactly_if_a_side_is_lost(told):
    for before, now in ((before, now) for before in told for now in told):
        comparison = compare({**told[before], "file": "base.json"}, told[now])
        assert bool(comparison.losses()) == (not now <= before)
        (whole,) = comparison.shares
        assert whole["share"] - whole["before"] == pytest.approx((len(before) - len(now)) / 6)
        assert whole["status"] == ("better", "same", "worse")[1 + np.sign(len(now) - len(before))]
        assert sum(zone["more_m2"] for zone in comparison.zones) == pytest.approx(len(now - before))
        assert {zone["status"] for zone in comparison.zones} <= {"new"} or not now.isdisjoint(
            before
        )


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
    failures = [*ElementTree.parse("j.xml").iter("failure")]
    said = {each.get("message") for each in failures}
    every = {line for each in failures for line in each.text.splitlines()}
    wanted = {each.removeprefix("worse: ") for each in lines if re.match("worse: |new: ", each)}
    assert said <= wanted <= every
    assert any(each.startswith("new: dead zone 1 m²") for each in every - said)  # of a worse group
    title, _, *rows = Path("s.md").read_text().splitlines()
    assert title == "## rastercov check plan.toml: fails"
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {4}
    assert sum(row.startswith("| fails |") for row in rows) == len(said)
    told = answer(capsys, f"{CHECK} --baseline base/check.json --json", code=1)
    assert told["baseline"]["zones"][0]["status"] == "new"
    worse = [each["name"] for each in told["baseline"]["shares"] if each["status"] == "worse"]
    assert sorted(told["baseline"]["worse"]) == sorted(worse) != []
    assert told["unmet"] == ["baseline"]
    assert "expected a file by `rastercov check`" in refusal(capsys, f"{CHECK} --summary plan.toml")


def test_what_is_no_baseline_is_one_line(files, capsys):
    whole = json.loads(Path("base/check.json").read_text())
    for name in ("task", "all", "groups", "covered_area", "dead_faces"):
        for value in (None, 3, [{}], "x", [[1]], *([], {}) * (name != "dead_faces")):
            Path("b.json").write_text(json.dumps(whole | {name: value}))
            assert refusal(capsys, f"{CHECK} --baseline b.json").startswith("error: b.json: ")
    assert "expected a check with views = 2, got 1" in refusal(
        capsys, f"{CHECK} --views 2 --baseline base/check.json"
    )


def numbers_of(tree, path=()):
    """Paths of all numbers of a tree of tables and lists."""
    if isinstance(tree, int | float):
        return [path]
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    inner = [pair for pair in items if isinstance(pair[1], dict | list | int | float)]
    return [number for key, each in inner for number in numbers_of(each, (*path, key))]


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
            lines = [str(error).removeprefix("base.json: ")]
        assert not re.search(r"\b(nan|inf)\b", " ".join(lines)), path


def test_a_difference_is_in_percentage_points_and_square_metres():
    share = {"name": "all", "share": 0.9085431, "before": 0.9147649, "is_area": True, "lost": 3.664}
    assert words(share) == "whole task: down 0.622 percentage points (3.66 m²) to 90.9 %"
    share |= {"before": 0.9085, "is_area": False}
    assert words(share) == "whole task: up 0.00431 percentage points to 90.9 %"


def assembly(tmp_path, n_parts, rng):
    """A plan of boxes whose faces are groups of parts, and its path."""
    lines, n = [], 0
    for part in range(n_parts):
        box = shapes.box(tuple(rng.uniform(0.2, 1.5, 3)))
        lines += [f"v {x} {y} {z}" for x, y, z in np.add(box.vertices, (3.0 * part, 0, 0)).tolist()]
        for row, face in enumerate(box.faces + 1 + n):
            lines += [f"g arm/box {part}/face {row // 2 + 1}"] * (row % 2 == 0)
            lines.append("f " + " ".join(map(str, face)))
        n += len(box.vertices)
    path = tmp_path / "parts.obj"
    path.write_text("\n".join([*lines, f"v 0 0 {-9}", f"g plate\nf 1 2 {n + 1}", ""]))
    entries = {"meshes": [{"path": str(path)}], "camera": CAMERA | {"fx": 60, "fy": 60}}
    return plan_of(entries, tmp_path / "plan.toml")


@pytest.mark.parametrize("seed", range(4))
def test_all_parts_and_the_worst_faces_that_lost_more_than_is_accepted(tmp_path, seed):
    """By shares of their own, recomputed from the areas of groups."""
    rng = np.random.default_rng(seed)
    plan = assembly(tmp_path, 3, rng)
    poses = rc.look_at(np.array([3.0, 0, 0]) + rng.uniform(6, 9) * SIDES, np.array([3.0, 0, 0]))
    kept = rng.choice(6, 4, replace=False)
    before, now = (
        record(check(plan, Path("r"), {}, poses=poses[rows])) for rows in ([*range(6)], kept)
    )

    def lost(told, other):
        areas = (
            {each["group"]: (each["m2"], each["of_m2"]) for each in one["groups"]}
            for one in (told, other)
        )
        then, new = areas
        for place in {"", *(above for name in then for above in [*parts_above(name), name])}:
            own = [name for name in then if f"{name}/".startswith(f"{place}/") or not place]
            whole = sum(new[name][1] for name in own)
            yield place, sum(then[name][0] - new[name][0] for name in own), whole

    losses = {place: (m2, whole) for place, m2, whole in lost(before, now)}
    sizes = [0.0, *rng.uniform(0, 60, 3), 100.0]
    for text in [*map(str, sizes), *(f"{1e4 * m2:.6f} cm2" for m2 in rng.uniform(0, 4, 4))]:
        value = float(text.split()[0])
        comparison = compare({**before, "file": "b", "tolerated": Tolerated.of(text)}, now)
        accepted = {
            place: 1e-4 * value if "cm2" in text else value / 100 * whole
            for place, (_, whole) in losses.items()
        }
        worse = {
            place for place, (m2, whole) in losses.items() if m2 > accepted[place] + 1e-6 * whole
        }
        said = {each["group"] or "" for each in comparison.shares if each["status"] == "worse"}
        several = {
            place
            for place in losses
            if place in {"", "plate"} or place.count("/") or place == "arm"
        }
        assert said == worse & several
        own = [each["kind"] for each in comparison.worse()]
        assert own == sorted(own, key=["all", "goal", "part", "group"].index)
        faces = [each["lost"] for each in comparison.worse() if each["kind"] == "group"]
        assert faces == sorted(faces, reverse=True)
        lines = [line for line in comparison.losses() if line.startswith("worse: group ")]
        assert len(lines) == min(5, len(faces))
        assert (f"worse: {len(faces) - 5} more groups" in comparison.losses()) == (len(faces) > 6)
        for level in (1, 2, 3):
            named = re.findall(
                r"worse: (?:part|group) (\S.*?): down", "\n".join(comparison.losses(level))
            )
            assert all(name.count("/") < level for name in named)
        assert comparison.is_worse == bool(worse or comparison.zones)
    much = Tolerated.of("1e6m2")
    assert not compare({**before, "file": "b", "tolerated": much}, now).is_worse
    assert not compare({**before, "file": "b"}, before).is_worse


def test_a_reviewer_reads_what_fails_only(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assembly(tmp_path, 9, np.random.default_rng(0))
    camera = ", ".join(f"{name} = {value}" for name, value in (CAMERA | {"fx": 30}).items())
    Path("plan.toml").write_text(f'meshes = [{{ path = "parts.obj" }}]\ncamera = {{ {camera} }}\n')
    write_poses("rig.json", rc.look_at(np.array([12.0, 0, 0]) + 20 * SIDES, np.array([12.0, 0, 0])))
    assert call(capsys, f"{CHECK} --min-coverage 0.01 --out base")[0] == 0
    line = f"{CHECK} --baseline base/check.json --summary s.md --junit j.xml"
    assert call(capsys, line)[0] == 0
    assert "|" not in Path("s.md").read_text()
    write_poses(
        "rig.json", rc.look_at(np.array([12.0, 0, 0]) - 20 * SIDES[:1], np.array([12.0, 0, 0]))
    )
    for level in ("", " --level 1"):
        code, out, _ = call(capsys, line + level)
        rows = Path("s.md").read_text().splitlines()[4:]
        assert code == 1
        assert rows[0].startswith("| fails | whole task: down ")
        assert not any(row.startswith("| holds") for row in rows)
        n_faces = sum("fails | group arm" in row for row in rows)
        assert n_faces == 0 if level else n_faces in (4, 5)
        assert any(re.match(r"\|  \| and \d+ (faces|more groups)", row) for row in rows) == (
            not level
        )
        (suite,) = ElementTree.parse("j.xml").getroot()
        failures = [case.find("failure") is not None for case in suite]
        names = [case.get("name") for case in suite]
        arms = [name.startswith("coverage of arm") for name in names]
        assert sum(map(and_, failures, arms)) == n_faces
        others = [name for name in names if re.fullmatch(r"and \d+ (faces|more groups)", name)]
        assert len(others) == (not level)
        below = r"worse: \d+ (more )?groups below level 1" if level else r"worse: \d+ more groups"
        assert re.search(below, out)
        assert out.count("dead zone") <= 12
        zones = [row for row in rows if "dead zone " in row]
        assert all("advice: " in row for row in zones)
        assert all("/face" not in row for row in zones) or not level
    assert "expected a baseline, got none" in refusal(
        capsys, f"{CHECK} --allow-worse 1 --min-coverage 0.1"
    )


WRONG = (
    "",
    "x",
    "-1",
    "101",
    "nan",
    "inf",
    "1e999",
    "1.2.3",
    "2m3",
    "1 2",
    "m2",
    "0x1",
    "5 %%",
    "²",
)


@pytest.mark.parametrize("text", WRONG)
def test_what_is_no_loss_is_refused(text):
    with pytest.raises(rc.ConfigError, match="expected 0 to 100 percentage points"):
        Tolerated.of(text)


@pytest.mark.parametrize(
    ("text", "share", "m2"),
    [("0.5", 0.005, 0), (3, 0.03, 0), ("1e-1 %", 0.001, 0), ("2 cm2", 0, 2e-4), ("1e3MM²", 0, 1e-3),
     ("2.5 points", 0.025, 0), ("1m^2", 0, 1)],
)  # fmt: skip
def test_a_loss_is_of_points_or_of_an_area(text, share, m2):
    result = Tolerated.of(text)
    assert (result.share, result.m2) == pytest.approx((share, m2))


def test_the_accepted_loss_is_beside_the_verdict(told):
    """Of a check that is better, "no worse ... by more than" would say that it is worse."""
    much = {**told[frozenset({1})], "file": "b", "tolerated": Tolerated.of(0.5)}
    first, second = compare(much, told[frozenset()]).lines()[:2]
    assert first == "no worse than b; accepted loss: 0.5 percentage points"
    assert Tolerated.of("2.4999").words() == "; accepted loss: 2.4999 percentage points"
    assert second.startswith("better: whole task: up 16.7 percentage points")


def test_the_summary_counts_the_same_other_zones_as_the_terminal(tmp_path, capsys):
    plans = Path(__file__).parents[2] / "examples" / "plans"
    line = f"check {plans / 'audit_rig.toml'} -p {plans / 'rig.json'} --views 2"
    code, out, _ = call(
        capsys, f"{line} --summary {tmp_path / 's.md'} --junit {tmp_path / 'j.xml'}"
    )
    assert code == 1
    (said,) = re.findall(r"^and \d+ more dead zones", out, re.M)
    assert (tmp_path / "s.md").read_text().endswith(f"|  | {said} |  |\n")
    names = [case.get("name") for case in ElementTree.parse(tmp_path / "j.xml").iter("testcase")]
    assert sum(name.startswith("dead zone") for name in names) == 20
    assert said not in names  # it would not say which fail


def test_the_summary_names_the_zones_that_grew_most(tmp_path, capsys):
    plans = Path(__file__).parents[2] / "examples" / "plans"
    rig = json.loads((plans / "rig.json").read_text())
    line = f"check {plans / 'audit_rig.toml'} --min-coverage 0.5"
    call(capsys, f"{line} -p {plans / 'rig.json'} -o {tmp_path / 'base'}")
    (tmp_path / "rig.json").write_text(
        json.dumps({"world_from_camera": rig["world_from_camera"][6:]})
    )
    line += f" -p {tmp_path / 'rig.json'} --baseline {tmp_path / 'base' / 'check.json'}"
    code, out, _ = call(capsys, f"{line} --summary {tmp_path / 's.md'}")
    said = re.findall(r"^larger by .*", out, re.M)
    rows = re.findall(r"\| fails \| (larger by .*?) \|", (tmp_path / "s.md").read_text())
    assert (code, rows) == (1, said)
    assert len(said) == 5


def test_a_goal_that_replaces_the_plans_is_stated_with_it(files, capsys):
    goal = '[selection]\ngoal = "fewest_cameras"\ncoverage = 0.9\ngroups = { rest = 0.3 }\n'
    text = Path("plan.toml").read_text()
    Path("plan.toml").write_text(f"{text}{goal}")
    line = f"{CHECK} --min-coverage 0.5 --group rest=0.3 --views 1"
    result = answer(capsys, line)
    assert [(each["limit"], each["plan_limit"]) for each in result["requirements"]] == [
        (0.5, 0.9),
        (0.3, None),
    ]
    assert "plan_views" not in result
    said = "goal for the whole task holds: 50.0 % required (90.0 % in the plan)"
    assert said in call(capsys, line)[1]
    line = f"{CHECK} --views 2"
    assert answer(capsys, line, code=1)["plan_views"] == 1
    assert "\nrequired views: 2 (1 in the plan)\n" in call(capsys, line)[1]


@pytest.mark.parametrize("change", ["size", "corner", "order", "none"])
def test_a_baseline_of_another_scene_of_the_same_groups_is_said(change, files, capsys):
    """Also where the size, the area or the number of faces is the same; never of the same scene."""
    part = Path("part.obj")
    text = part.read_text()
    lines = text.splitlines(keepends=True)
    first = next(row for row, line in enumerate(lines) if line.startswith("f "))
    changed = {
        "size": re.sub(r"^v (\S+)", lambda at: f"v {2 * float(at[1])}", text, flags=re.MULTILINE),
        "corner": text.replace(lines[0], "v -0.5 -0.5 -0.49\n"),
        "order": "".join([*lines[:first], lines[first + 1], lines[first], *lines[first + 2 :]]),
        "none": text + "# a comment\n",
    }[change]
    assert changed != text
    part.write_text(changed)
    code, out, _ = call(capsys, f"{CHECK} --baseline base/check.json")
    said = "worse than base/check.json, which has another scene: differences are of the rig"
    assert (said in out) == (change != "none")
    told = answer(capsys, f"{CHECK} --baseline base/check.json", code=code)
    assert told["baseline"]["is_other_scene"] == (change != "none")


@pytest.mark.parametrize("n", [87, 12])
def test_a_part_of_many_faces_and_a_lost_camera_are_five_failures(tmp_path, monkeypatch, capsys, n):
    """Each face that lost, and the dead zone on it, were failures of their own: 2 n."""
    monkeypatch.chdir(tmp_path)
    lines, rng = [], np.random.default_rng(n)
    for row in range(n):
        x, y = divmod(row, 12)
        lines += [f"v {x + dx} {y + dy} 0" for dx, dy in ((0, 0), (0.9, 0), (0.9, 0.9), (0, 0.9))]
        at = 4 * row
        lines += [f"g bracket/face {row + 1}", f"f {at + 1} {at + 2} {at + 3} {at + 4}"]
    Path("part.obj").write_text("\n".join([*lines, ""]))
    camera = "width = 640, height = 480, hfov_deg = 60"
    Path("plan.toml").write_text(f'meshes = [{{ path = "part.obj" }}]\ncamera = {{ {camera} }}\n')
    eyes = np.column_stack((rng.uniform(0, n / 12, 3), rng.uniform(0, 12, 3), [6.0, 20.0, 7.0]))
    poses = rc.look_at(eyes, eyes * (1, 1, 0), up=(0, 1, 0))
    rc.write_poses("all.json", poses)
    rc.write_poses("rig.json", poses[[0, 2]])
    assert call(capsys, "check plan.toml -p all.json --min-coverage 0.01 --out base")[0] == 0
    line = "check plan.toml -p rig.json --min-coverage 0.01 --baseline base/check.json"
    assert call(capsys, f"{line} --junit j.xml --summary s.md --out out")[0] == 1
    told = json.loads(Path("out/check.json").read_text())
    worse = [each for each in told["baseline"]["shares"] if each["status"] == "worse"]
    n_faces = sum(each["kind"] == "group" for each in worse)
    suites = ElementTree.parse("j.xml").getroot()
    shown = int(suites.get("failures"))
    assert shown == min(5, len(worse))
    rest = f"and {n_faces - (5 - (len(worse) - n_faces))} faces"
    names = [case.get("name") for case in suites.iter("testcase")]
    assert (rest in names) == (rest in Path("s.md").read_text()) == (len(worse) > 5)
    assert sum(row.startswith("| fails") for row in Path("s.md").read_text().splitlines()) == shown
