"""Goals of one plan as the terminal, the page, the sheet, JSON and JUnit tell them."""

import html
import json
import re
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
import shapely
from commands import call
from goals_to_view import PLAN, plan_in

import rastercov as rc

EYES = [(2.0, 1.5, 1.5), (3.5, 0.5, 2.5), (3.0, 1.0, 1.5)]
TO = {"seen": (1.5, 4, 1.5), "unseen": (3.5, 0, 0.5), "doors": (0.0, 2.0, 1.5)}


def plain(text):
    """A text without breaks of lines, and as a page has it without marks."""
    text = html.unescape(re.sub(r"<(style|script).*?</\1>|<[^>]+>", " ", text, flags=re.DOTALL))
    return re.sub(r"\s+", " ", text).casefold()


def outline(path):
    """Lines of a layer of DXF."""
    lines = [shapely.LineString(each.get_points("xy")) for each in path]
    return shapely.union_all(lines)


@pytest.mark.parametrize(
    "aims", [("seen", "doors"), ("unseen", "doors"), ("seen", "seen"), ("unseen",)]
)
def test_every_door_tells_the_same_of_each_goal(capsys, tmp_path, monkeypatch, aims):
    monkeypatch.chdir(tmp_path)
    plan_in(tmp_path, PLAN.replace("views = 2\n", "").replace("at_most = 0.1", "at_most = 0.0"))
    rc.write_poses("rig.json", rc.look_at(EYES[: len(aims)], [TO[each] for each in aims]))
    asks = "check plan.toml -p rig.json"
    code, printed, _ = call(capsys, f"{asks} --junit j.xml --out out")
    assert code == 1
    told = json.loads(call(capsys, f"{asks} --json")[1])
    call(capsys, "sheet plan.toml -p rig.json --out s.svg")
    call(capsys, "sheet plan.toml -p rig.json --out s.dxf")
    sheet = "".join(
        f"{each.text} " for each in ElementTree.parse("s.svg").getroot().iter() if each.text
    )
    cases = {each.get("name"): each[0] for each in ElementTree.parse("j.xml").iter("testcase")}
    doors = {
        "terminal": plain(printed.replace("\n", " ")),
        "page": plain((tmp_path / "out/check.html").read_text()),
    }
    by_goal = {each["goal"]: each for each in told["requirements"] if each["goal"]}
    assert {each["goal"] for each in told["goals"]} == by_goal.keys() == {"doors", "window"}
    for goal in told["goals"]:
        name, lines, required = goal["goal"], goal["lines"], by_goal[goal["goal"]]
        assert required["status"] == goal["status"]
        case = cases[f"coverage of goal {name}"]
        assert (case.tag == "failure") == (goal["status"] == "fails")
        lost = [each for each in goal["cameras"] if each["lost_m2"] > 1e-9]
        seen = [each["name"] for each in goal["cameras"]]
        if name == "doors":
            assert any(line.startswith("lost without it: ") for line in lines) == bool(lost)
            assert all(f"{each['name']} " in lines[-1] for each in lost)
            assert bool(goal["dead_zones"]) == (required["share"] < 1)
        else:
            assert lines[0] == "no camera covers any of it (proved)" or all(
                each in lines[0] for each in seen
            )
            assert not goal["is_unseen"]  # from too far away to recognise it
        for line in lines:  # a page has sentences: "Advice: ..."
            assert all(plain(line) in text for text in doors.values()), (line, doors)
            assert plain(line) in plain(case.text)
        signed = ("dead zone", "lost without it", "seen by", "no camera")
        assert all(plain(line) in plain(sheet) for line in lines if line.startswith(signed))
        assert f"{goal['status']}: goal {name}" in sheet
    drawing = ezdxf.readfile("s.dxf").modelspace()
    private = outline(drawing.query("LWPOLYLINE[layer=='PRIVATE']"))
    window = shapely.LineString(((1, 3.99), (2, 3.99)))
    assert shapely.hausdorff_distance(private, window) < 2e-3
    goals = drawing.query("LWPOLYLINE[layer=='GOALS']")
    is_drawn = bool(goals) and outline(goals).intersection(window.buffer(1e-2)).length > 0.5
    assert is_drawn == (by_goal["window"]["share"] > 0)
    assert np.isclose(private.length, 1, atol=1e-2)


def test_a_goal_that_holds_names_the_cameras_that_it_needs(capsys, tmp_path, monkeypatch):
    """One that adds nothing to the task looked as if it were in vain."""
    monkeypatch.chdir(tmp_path)
    text = PLAN.replace("views = 2\n", "").replace("coverage = 0.7", "coverage = 0.01")
    plan_in(tmp_path, text)
    rc.write_poses("rig.json", rc.look_at(EYES[:2], [TO["seen"], TO["doors"]]))
    _, printed, _ = call(capsys, "check plan.toml -p rig.json")
    said = re.search(r"goal doors holds: .*\n +lost without it: (camera \d) \(", printed)
    assert said is not None, printed
