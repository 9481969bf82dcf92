"""Goals under installation errors: `check --tolerance`, and the proof of `place`."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import done, enter, refusal
from nightly import amount

import rastercov as rc
from rastercov.base.errors import ConfigError, RastercovError
from rastercov.placement.plan import outcome
from rastercov.placement.plan.file import PlanError
from rastercov.tolerances import assured
from rastercov.tolerances.passes import Errors, errors_in

PLAN = {
    "meshes": [{"built_in": "teapot-5"}],
    "camera": {"width": 1280, "height": 1024, "fx": 1970.0, "fy": 1970.0},
    "task": {"max_incidence_deg": 70},
    "selection": {"goal": "best_coverage", "cameras": 4},
    "candidates": [{"generator": "on_sphere", "count": 24}],
}
RIG = rc.sphere_of_poses((0, 0, 0.05), distance=0.6, count=5)
ERRORS = "2 mm, 0.2 deg"
SURE_COVERAGE = assured.sure_coverage


@pytest.fixture(scope="module", autouse=True)
def few_draws():
    """Installations that are drawn take most of the time of a proof."""

    def drawn(*scene, draws, seed):
        return SURE_COVERAGE(*scene, draws=min(draws, amount(40, at_night=200)), seed=seed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(assured, "sure_coverage", drawn)
        yield


def checked(share, **options):
    return rc.check(PLAN, RIG, min_coverage=share, tolerance=ERRORS, **options)


@pytest.fixture(scope="module")
def shares():
    """Share that is sure, and least and nominal shares."""
    result = checked(0.1).assured.found
    return [
        value / result.sure.whole for value in (result.sure.m2, result.least, result.nominal.m2)
    ]


def test_a_goal_that_is_sure_holds_under_errors(shares):
    result = checked(shares[0] - 1e-5)
    assert result.is_met
    assert [each.status for each in result.assured.verdicts] == ["holds under errors"]


def test_a_goal_that_a_drawn_installation_misses_fails(shares, tmp_path):
    result = checked((shares[1] + shares[2]) / 2, out=tmp_path)
    assert [each.status for each in result.requirements] == ["holds"]
    assert [each.status for each in result.assured.verdicts] == ["fails"]
    assert not result.is_met
    told = json.loads((tmp_path / "check.json").read_text())
    assert told["tolerance"]["verdicts"][0]["status"] == "fails"
    page = (tmp_path / "check.html").read_text()
    assert "Covered under all errors up to" in page
    assert "Parts that installation errors may leave uncovered" in page


def test_a_goal_in_between_is_undecided(shares, tmp_path):
    result = checked((shares[0] + shares[1]) / 2, out=tmp_path)
    assert [each.status for each in result.assured.verdicts] == ["undecided"]
    assert not result.is_met
    again = rc.check(PLAN, tmp_path / "worst_poses.json", min_coverage=0.1)
    assert again.whole.share == pytest.approx(result.assured.verdicts[0].least, abs=1e-9)
    worst = result.assured.summary()["worst"]
    assert worst == json.loads((tmp_path / "worst_poses.json").read_text())
    assert worst["draw"] == int(np.argmin(result.assured.found.draws))


def test_a_verdict_of_normal_errors_is_of_the_installations_that_count(monkeypatch):
    monkeypatch.setattr(assured, "sure_coverage", SURE_COVERAGE)
    result = rc.check(PLAN, RIG[:1], min_coverage=0.1, tolerance=f"{ERRORS}, normal").assured
    (verdict,) = result.verdicts
    draws = np.sort(result.found.draws) / result.found.sure.whole
    assert draws[0] < draws[2] == pytest.approx(verdict.least)
    assert " or more in 99.0 % of random installations: " in verdict.words()
    assert "random installation" not in replace(verdict, draw=-1).words()


@pytest.mark.slow
def test_a_plan_that_meets_its_goal_may_not_under_errors_until_a_camera_is_added(shares):
    goal = (shares[0] + 2 * shares[1]) / 3
    more = np.concatenate([RIG, rc.sphere_of_poses((0, 0, 0.05), distance=0.55, count=4)])
    assert not checked(goal).is_met
    assert rc.check(PLAN, RIG, min_coverage=goal).is_met
    assert rc.check(PLAN, more, min_coverage=goal, tolerance=ERRORS).is_met


def test_the_command_says_what_holds(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    rc.write_poses("rig.json", RIG)
    (tmp_path / "plan.toml").write_text(
        '[[meshes]]\nbuilt_in = "teapot-5"\n[camera]\nwidth = 1280\nheight = 1024\nfx = 1970\n'
        "fy = 1970\n[task]\nmax_incidence_deg = 70\n"
    )
    line = "check plan.toml -p rig.json --min-coverage 0.3 --tolerance"
    out, _ = done(capsys, f'{line} "{ERRORS}"')
    assert "Covered under all errors up to 2 mm, 0.2 deg per camera: at least" in out
    assert "holds under errors" in out
    out, _ = done(capsys, f'{line} "{ERRORS}" --out report')
    assert (
        f"poses of the random installation that decides: {Path('report/worst_poses.json')}\n" in out
    )
    assert Path("report/worst_poses.json").is_file()
    assert "2 mm, 0.2 deg" in refusal(capsys, f'{line} "2 furlongs"')


def test_files_for_build_servers_fail_with_the_goal_that_errors_may_break(tmp_path, shares):
    failing = (shares[1] + shares[2]) / 2
    for share, status in ((shares[0] - 1e-5, ""), (failing, "fails")):
        result = checked(share)
        planned, under = (case for case in outcome.cases(result) if case.kind == "goal")
        assert (planned.status, under.status) == ("", status)
        assert under.name == "coverage of whole task under installation errors"
        outcome.write(tmp_path / "j.xml", tmp_path / "s.md", Path("plan.toml"), [planned, under])
        suite = ElementTree.parse(tmp_path / "j.xml").getroot()
        assert suite.get("failures") == str(int(not result.is_met))
        title, *rows = (tmp_path / "s.md").read_text().splitlines()
        assert title == f"## rastercov check plan.toml: {status or 'holds'}"
        assert any("in the worst random installation: fails" in row for row in rows) == bool(status)
    verdict, *_ = result.assured.lines()
    assert result.lines()[1] == verdict
    assert any(
        line.startswith("goal for the whole task holds (rig as planned, without errors): ")
        for line in result.lines()
    )


def test_a_placement_has_the_area_that_is_sure():
    tolerance = {"position_mm": 2, "angle_deg": 0.2, "draws": 2, "distribution": "uniform"}
    plan = PLAN | {"selection": PLAN["selection"] | {"tolerance": tolerance}}
    tolerance["proof"] = True
    placed = rc.place(plan)
    result = placed.product("tolerance").proved.found
    assert result.sure.m2 < result.nominal.m2
    areas = placed.cameras.areas
    nominal = areas.of_faces(areas.mesh.task_mask, 1)["m2"]
    assert result.nominal.m2 == pytest.approx(nominal, rel=1e-9)
    without = rc.place(PLAN)
    assert np.array_equal(placed.cameras.poses, without.cameras.poses)


@pytest.mark.parametrize(
    "change",
    [
        {"task": {"max_incidence_deg": 70, "weight_by": "count"}},
        {"task": {"max_incidence_deg": 70, "views": 2, "min_angle_deg": 20}},
    ],
)
def test_a_proof_of_what_has_none_is_refused_before_the_run(change):
    selection = PLAN["selection"] | {"tolerance": {"position_mm": 1, "proof": True}}
    with pytest.raises(PlanError, match=r"selection\.tolerance\.proof: expected"):
        rc.place(PLAN | change | {"selection": selection})


def test_an_angle_between_rays_is_proved_by_area():
    task = {"max_incidence_deg": 75, "views": 2, "min_angle_deg": 20, "by": "area"}
    check_result = rc.check(PLAN | {"task": task}, RIG, min_coverage=0.1, tolerance="1 mm")
    assert check_result.assured.holds
    assert check_result.assured.found.sure.share() < check_result.whole.share


def test_of_normal_errors_one_in_a_hundred_installations_may_fail(shares, monkeypatch):
    monkeypatch.setattr(assured, "sure_coverage", SURE_COVERAGE)  # all 200
    normal = rc.check(PLAN, RIG, min_coverage=0.1, tolerance=f"{ERRORS}, normal").assured
    own = np.sort(normal.found.draws) / normal.found.sure.whole
    assert normal.verdicts[0].least == pytest.approx(own[2])
    assert own[0] < own[2]
    assert normal.found.sure.m2 < shares[0] * normal.found.sure.whole
    assert normal.lines()[1].startswith(
        "Covered in 99.0 % of installations (standard deviation 2 mm"
    )


@pytest.mark.slow
def test_a_room_that_is_covered_as_planned_is_not_for_certain_until_a_camera_is_added(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "examples")
    from hold_under_errors import SHARE, main

    planned, added = main()
    assert planned.whole.share > SHARE > planned.assured.verdicts[0].sure
    assert planned.assured.verdicts[0].status != "holds under errors"
    assert added.is_met


def test_errors_of_cameras_differ_by_name():
    errors = errors_in("2 mm, camera 2 0.5 mm, bracket 0.1 deg, part 3 mm")
    assert errors.position_mm == {"camera 2": 0.5, "*": 2}
    assert errors.angle_deg == {"bracket": 0.1, "*": 0}
    assert errors.part_mm == 3
    checked = rc.check(PLAN, RIG, min_coverage=0.1, tolerance="2 mm, camera 0.5 mm")
    assert checked.assured.found.sizes[:, 0].tolist() == [0.0005] * 5
    with pytest.raises(ConfigError, match="bracket"):
        rc.check(PLAN, RIG, min_coverage=0.1, tolerance="2 mm, bracket 0.5 mm")


def test_goals_of_their_own_are_refused_by_their_names():
    lid = {"groups": ["box"], "coverage": 0.1, "max_incidence_deg": 50}
    meshes = [*PLAN["meshes"], {"built_in": "box", "transform": {"translation": [2, 0, 0]}}]
    goals = {"meshes": meshes, "goals": {"lid": lid}}
    selection = {"selection": {"goal": "fewest_cameras", "coverage": 0.1}}
    with pytest.raises(ConfigError, match=r"no \[goals\] with installation errors, got lid; "):
        rc.check(PLAN | selection | goals, RIG, tolerance=ERRORS)


def test_errors_are_read_from_a_text():
    assert errors_in("2 mm, 0.2 deg") == Errors(position_mm=2, angle_deg=0.2)
    assert errors_in("1cm, 0.5 %, part 3 mm, part 1 deg, normal") == Errors(
        position_mm=10, focal_percent=0.5, part_mm=3, part_deg=1, distribution="normal"
    )
    assert errors_in("* 20 mm") == Errors(position_mm=20)
    assert errors_in("a 5 mm; * 20 mm") == Errors(position_mm={"a": 5, "*": 20})
    with pytest.raises(ConfigError, match="once, in mm, cm, m, deg, degrees, %"):
        errors_in("2 in")
    for text in (
        "1e400 mm",
        "1e mm",
        "2 mm, * 3 mm",
        "",
        "2",
        "2 mm, 3 mm",
        "-1 mm",
        "part 2 %",
        "2 m m",
        "normal",
        "normal, uniform",
    ):
        with pytest.raises(ConfigError):
            errors_in(text)


WITHOUT_PROOF = {
    "got one by face": {"task": {"min_visibility": 0.9}},
    "expected no \\[goals\\] with": {"goals": {"doors": {"groups": ["mesh"], "coverage": 0.1}}},
    "expected errors of a camera with a pose": {},
    "expected no equipment": {
        "lamps": {"key": {"intensity_cd": 9.0, "position": [0.0, 0.0, 2.0]}},
        "task": {"min_illuminance": "5 lx"},
    },
}


@pytest.mark.parametrize("words", WITHOUT_PROOF)
def test_what_has_no_proof_is_refused_before_any_work(words, monkeypatch):
    def works(*_):
        raise AssertionError("it was measured first")

    monkeypatch.setattr("rastercov.placement.plan.check._check_rig", works)
    errors = ERRORS if WITHOUT_PROOF[words] else f"{ERRORS}, bracket 2 mm"
    with pytest.raises(RastercovError, match=words):
        rc.check(PLAN | WITHOUT_PROOF[words], RIG, min_coverage=0.1, tolerance=errors)
