"""`rastercov place` and `rastercov check`, as a person, a script and a build server meet them."""

import json
import os
import re
import subprocess
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import Mock
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import answer, call, content, done, refusal, write_part
from short_search import short_search  # noqa: F401 # a fixture

import rastercov as rc
from rastercov.base.locks import lock
from rastercov.core.camera.conventions import read_poses, write_poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.placement.plan import run as plan_run
from rastercov.placement.plan.file import plan_of, schema
from rastercov.report import plan as plan_report
from rastercov.shards import silent

EXAMPLES = Path(__file__).parents[2] / "examples" / "plans"
SCENE = """
meshes = [{ path = "part.obj" }]
camera = { width = 96, height = 72, fx = 90, fy = 90 }
[task]
min_pixels = 2
"""
CANDIDATES = '[[candidates]]\ngenerator = "on_sphere"\ncount = 20\ndistances = [3.5]\n'
SELECTION = '[selection]\ngoal = "fewest_cameras"\ncoverage = 1.0\n'
QUICK = SCENE + CANDIDATES + SELECTION + "[outputs]\npage = false\n"
CHECK = "check plan.toml -p rig.json"


@pytest.fixture(autouse=True)
def files():
    """A folder of its own with a part of two groups and a rig of six around it."""
    write_part("part.obj")
    write_poses("rig.json", axis_poses())
    Path("plan.toml").write_text(QUICK)


def axis_poses():
    """Cameras on both ends of the three axes: each sees one side of the part."""
    ends = np.concatenate((np.eye(3), -np.eye(3)))
    return rc.look_at(3.5 * ends, np.zeros(3))


def figures(folder="plan"):
    """`plan.json` of a folder."""
    return json.loads(Path(folder, "plan.json").read_text())


def placed(capsys, text):
    """Exit code, standard output and figures of `place` on a plan."""
    Path("plan.toml").write_text(text)
    code, out, _ = call(capsys, "place plan.toml")
    return code, out, figures()


# --- place ----------------------------------------------------------------------------------------


def test_warnings_are_in_the_answers_and_a_plan_without_requirements_is_not_met(capsys):
    best = '[selection]\ngoal = "best_coverage"\ncameras = 2\n'
    small = QUICK.replace(SELECTION, best).replace('"part.obj"', '"part.obj", unit = "um"')
    Path("plan.toml").write_text(small)
    code, out, err = call(capsys, "place plan.toml --json")
    told = json.loads(out)
    assert (code, told["met"], told["cameras"]) == (0, None, [])
    assert told["doubts"]
    assert all(line in err for line in (*told["doubts"], *told["warnings"]))
    code, out, err = call(capsys, f"{CHECK} --min-coverage 0.1 --json")
    told = json.loads(out)
    assert (code, told["met"]) == (1, False)
    assert told["doubts"]
    assert all(line in err for line in (*told["doubts"], *told["warnings"]))


def test_a_plan_gives_poses_that_evaluate_reads_and_figures(capsys):
    code, out, err = call(capsys, "place plan.toml")
    assert (code, err) == (0, "")
    assert "plan/plan.json" in out.splitlines()[:5]
    assert "20 candidates, by source: sphere 20" in out
    told = figures()
    assert told["met"]
    assert told["share"] == 1
    x, y, z = np.transpose([each["direction"] for each in told["cameras"]])
    headings, downs = (
        [each[key] for each in told["cameras"]] for key in ("heading_deg", "down_deg")
    )
    np.testing.assert_allclose(headings, np.degrees(np.arctan2(y, x)))
    np.testing.assert_allclose(downs, np.degrees(np.arcsin(-z)))
    poses = read_poses("plan/poses.json")
    assert len(poses) == len(told["cameras"]) == told["selection"]["cameras"]
    sphere = sphere_of_poses((0, 0, 0), 3.5, 20)
    assert np.abs(poses - sphere[told["selection"]["chosen"]]).max() < 1e-12
    camera = "-c 'width = 96, height = 72, fx = 90, fy = 90'"
    line = f"evaluate part.obj {camera} -p plan/poses.json --min-pixels 2 --pictures 0"
    assert answer(capsys, line)["covered"]["faces"] == 12
    assert call(capsys, "check plan.toml -p plan/poses.json")[0] == 0


def test_figures_hold_everything_that_made_them(capsys):
    table = 'name = "table"\nlow = [-9, -9, -9]\nhigh = [9, 9, -3]\n'
    Path("plan.toml").write_text(f"{QUICK}[[constraints.keep_out]]\n{table}")
    told = answer(capsys, "place plan.toml")
    assert told | {"folder": "..", "file": "plan.toml"} == figures()
    result, selection = told["candidates"], told["selection"]
    assert result["left"]["sphere"] + result["dropped"]["kept_out"] == 20 > result["left"]["sphere"]
    assert selection["gap"] == pytest.approx(1 - selection["bound"] / selection["objective"])
    (source,) = told["made_from"]["mesh"]
    assert (source["name"], len(source["sha256"])) == ("part.obj", 64)
    assert {"rastercov", "numpy", "pydantic", "python"} <= told["made_from"]["versions"].keys()
    assert {group["name"] for group in told["network"]["groups"]} == {"lid", "rest"}
    assert (told["left"]["left"]["faces"], told["seed"]) == (0, 0)
    assert "selection" in told["seconds"]["steps"]


@pytest.mark.slow
def test_the_same_plan_gives_the_same_bytes_but_for_the_time(capsys):
    text = QUICK.replace("[outputs]", "refine = true\n[outputs]").replace("1.0", "0.7")
    text += "[selection.tolerance]\nposition_mm = 50\nangle_deg = 2\ndraws = 10\n"
    text += "[selection.optimise]\nbudget = 200\n"
    Path("plan.toml").write_text(text)
    for out in ("one", "two"):
        call(capsys, f"place plan.toml --out {out}")
    assert Path("one/poses.json").read_bytes() == Path("two/poses.json").read_bytes()
    one, two = figures("one"), figures("two")
    assert one.pop("seconds").keys() == two.pop("seconds").keys()
    assert json.dumps(one) == json.dumps(two)
    assert "seconds" not in json.dumps(one)
    assert one["improvement"].keys() == {"search", "refinement"}
    assert one["tolerance"]["draws"] == 10


def test_a_goal_that_is_out_of_reach_gives_what_can_be_had_and_code_1(capsys):
    code, out, told = placed(capsys, QUICK.replace("count = 20", "count = 2"))
    assert code == 1
    assert not told["met"]
    assert 0 < told["share"] < 1
    assert re.search(
        r"All 2 candidates together reach [\d.]+ % of the area, expected 100.0 %", told["notes"][0]
    )
    assert "goal for the whole task fails: " in out
    text = QUICK.replace("count = 20", "count = 2").replace("1.0", "1.0\nof_reachable = true")
    assert placed(capsys, text)[0] == 0


def test_cavity_candidates_are_added_where_the_others_see_nothing(capsys):
    above = '[[candidates]]\ngenerator = "on_box"\nspacing = 9\noutward = 2.5\nsides = ["+z"]\n'
    code, _, alone = placed(capsys, QUICK.replace(CANDIDATES, above))
    assert (code, alone["cavities"]) == (1, None)
    more = above + '[[candidates]]\ngenerator = "per_cavity"\nstand_off = [3.0, 4.0]\n'
    code, out, told = placed(capsys, QUICK.replace(CANDIDATES, more))
    assert code == 0
    assert told["share"] == 1 > alone["share"]
    assert told["candidates"]["made"]["cavity"] > 0
    assert told["cavities"]["faces"] == told["cavities"]["reached"] == 2  # the underside
    assert "look into cavities cover" in told["notes"][0]
    assert told["notes"][0] in out


def test_a_part_in_the_wrong_unit_is_told_by_its_size_and_by_why_nothing_covers_it(capsys):
    code, out, _ = placed(capsys, QUICK.replace('"part.obj"', '"part.obj", unit = "um"'))
    assert code == 1
    assert "100.0 % resolution too low; the scene measures 1 x 1 x 1 µm, see meshes.unit" in out
    assert "no candidate covers any face" in out


def test_where_all_is_out_of_focus_the_depth_of_field_is_given(capsys):
    plan = QUICK.replace("fy = 90 }", "fy = 90, focus_range = [90, 91] }")
    _, out, _ = placed(capsys, plan.replace('"part.obj"', '"part.obj", unit = "m"'))
    assert "out of focus (depth of field 90 m to 91 m); the scene measures" in out
    assert "meshes.unit" not in out
    _, out, _ = placed(capsys, plan)
    assert "see meshes.unit" in out


def test_a_part_that_has_no_unit_to_change_is_told_none(capsys):
    plan = QUICK.replace('path = "part.obj"', 'built_in = "box"')
    _, out, _ = placed(capsys, plan.replace("min_pixels = 2", "min_pixels_per_m2 = 1e12"))
    assert "can be covered by any candidate" in out
    assert "meshes.unit" not in out


@pytest.mark.parametrize("limit", ["min_pixels = 1e9", 'min_pixel_density = "15 px/mm"'])
def test_a_share_of_what_candidates_cover_fails_where_they_cover_nothing(capsys, limit):
    """A camera that is in focus only where its images are too coarse is named."""
    text = f"""
        meshes = [{{ built_in = "box" }}]
        candidates = [{{ generator = "on_sphere", count = 6, distances = [0.9] }}]
        selection = {{ goal = "fewest_cameras", coverage = 0.9, of_reachable = true }}
        outputs = {{ page = false }}
        [camera]
        preset = "flir-bfs-u3-51s5+fujinon-hf12xa-5m"
        focus_distance = 0.5
        [task]
        {limit}
    """
    code, out, told = placed(capsys, text)
    assert code == 1
    assert "goal for the whole task fails: no candidate covers any of it, 90.0 % of what " in out
    assert not told["met"]
    named = re.search(
        r"the camera is in focus from 0\.4\d+ m on, and has 15 px/mm up to 0\.232 m;", out
    )
    assert bool(named) == ("density" in limit)


@pytest.mark.slow
def test_the_page_is_written_and_a_stale_one_removed(capsys):
    pages = [Path("plan/page.html"), Path("plan/view.html")]
    code, out, _ = placed(capsys, QUICK.replace("page = false", ""))
    assert code == 0
    assert str(pages[0]) in out.splitlines()[:5]
    texts = [page.read_text(encoding="utf-8") for page in pages]
    assert texts[0].lower().startswith("<!doctype html>")
    assert all("plan.toml" in text for text in texts)
    placed(capsys, QUICK)
    assert not any(page.exists() for page in pages)


def test_the_schema_can_be_had_without_a_plan(capsys):
    whole = json.loads(done(capsys, "place --schema")[0])
    assert whole == schema()
    for name, section in whole["properties"].items():
        text = done(capsys, f"place --schema-of {name}")[0]
        own = json.loads(text)
        defs = own.pop("$defs")
        assert own == section
        assert {*re.findall(r"#/\$defs/(\w+)", text)} == defs.keys()
        assert defs.items() <= whole["$defs"].items()
    assert "--schema-of: expected one of sel" in refusal(capsys, "place --schema-of selectoin")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "lines"),
    [
        (None, ["no.toml: no such file or directory"]),
        (SCENE, ["plan.toml: candidates: expected one", "plan.toml: selection: expected a goal"]),
        (QUICK.replace("[3.5]", "[0.2]"),
         ["plan.toml: expected candidates, got none (20 candidates: 17 in or behind rest, 3 in"]),
        (re.sub(r"(?s)\[\[candidates.*?(?=\n\[[a-z])", "[existing]\nfile = 'rig.json'", QUICK),
         ["plan.toml: expected candidates, got none (0 candidates); relax"]),
        (QUICK + 'folder = "part.obj"\n', ["part.obj: expected a folder, got a file"]),
    ],
)  # fmt: skip
def test_each_error_of_a_plan_is_a_line_and_nothing_is_written(capsys, text, lines):
    if text is not None:
        Path("plan.toml").write_text(text)
    before = {*Path().rglob("*")}
    code, out, err = call(capsys, "place " + ("no.toml" if text is None else "plan.toml"))
    assert (code, out) == (2, "")
    for one, line in zip(err.splitlines(), lines, strict=True):
        assert one.startswith(f"error: {line}")
    assert {*Path().rglob("*")} == before


# --- ended runs -----------------------------------------------------------------------------------


EACH_STEP = QUICK.replace(
    "[outputs]\npage = false",
    "refine = true\n[selection.tolerance]\nposition_mm = 1\nangle_deg = 0.1\ndraws = 3\n",
)


STEPS = {
    "rastercov.placement.plan.run.refine": "refinement",
    "rastercov.tolerances.plan_step.tolerance": "tolerance",
    "rastercov.placement.plan.run.find_uncovered": "uncovered faces",
    "rastercov.report.placement.pages_of": "page",
}


@pytest.fixture
def no_pages(monkeypatch):
    """A word for the page, which takes a second or two, where a test is about other files."""
    monkeypatch.setattr("rastercov.report.placement.pages_of", lambda *_: {"page.html": "a page"})


def stopped(capsys, monkeypatch, step, error, line="place plan.toml"):
    """A command when a step of it raises something; what nothing catches is as a kill."""
    with monkeypatch.context() as patch, suppress(SystemExit):
        patch.setattr(step, Mock(side_effect=error))
        return call(capsys, line)
    return None


@pytest.mark.slow
@pytest.mark.parametrize(("step", "name"), STEPS.items())
def test_a_kill_in_a_step_leaves_a_report_that_names_it_where_there_was_none(
    capsys, monkeypatch, step, name
):
    Path("plan.toml").write_text(EACH_STEP)
    monkeypatch.setattr("rastercov.report.plan.WORTH_SAVING", 0.0)
    assert stopped(capsys, monkeypatch, step, SystemExit(9)) is None
    assert figures()["interrupted"] == name
    assert len(read_poses("plan/poses.json")) == len(figures()["cameras"])
    assert not Path("plan/page.html").exists()


@pytest.mark.slow
def test_a_kill_or_an_error_in_a_step_leaves_an_earlier_report_as_it_was(
    capsys, monkeypatch, no_pages
):
    assert placed(capsys, EACH_STEP)[0] == 0
    assert figures()["interrupted"] is None
    before = content("plan")
    for step in STEPS:
        assert stopped(capsys, monkeypatch, step, SystemExit(9)) is None, step
        assert content("plan") == before, step
        code, _, err = stopped(capsys, monkeypatch, step, OSError(28, "No space left on device"))
        assert (code, err.count("\n")) == (2, 1), step
        assert content("plan") == before, step


@pytest.mark.slow
@pytest.mark.parametrize("step", STEPS)
def test_an_interrupt_in_a_step_replaces_an_earlier_report_and_names_the_step(
    capsys, monkeypatch, step
):
    assert placed(capsys, EACH_STEP)[0] == 0
    code, out, err = stopped(capsys, monkeypatch, step, KeyboardInterrupt())
    assert (code, err) == (130, "interrupted\n")
    words, page = (
        f"interrupted before {STEPS[step]}: result so far",
        Path("plan/page.html"),
    )
    assert words in out
    told = figures()
    assert told["interrupted"] == STEPS[step]
    assert len(read_poses("plan/poses.json")) == len(told["cameras"]) > 0
    assert page.exists() == (STEPS[step] != "page")
    assert not page.exists() or words in page.read_text()
    assert f"plan/{'page.html' if page.exists() else 'plan.json'}" in out.splitlines()[:5]


def test_an_interrupt_in_the_cavities_keeps_the_matrix(capsys, monkeypatch):
    text = EACH_STEP.replace("count = 20", "count = 2")  # leaves faces to the cavities
    Path("plan.toml").write_text(text + '[[candidates]]\ngenerator = "per_cavity"\n')
    step = "rastercov.placement.plan.prepare.openings"
    stop = stopped(capsys, monkeypatch, step, KeyboardInterrupt())
    assert stop == (130, "", "interrupted\n")
    assert len(list(Path("plan/matrix").glob("*/pairs/pairs-*.npz"))) == 1
    assert not Path("plan/plan.json").exists()


@pytest.mark.parametrize("step", ["measure_rig", "find_uncovered"])
def test_an_interrupt_of_check_writes_nothing(capsys, monkeypatch, step):
    line, step = f"{CHECK} --junit out.xml", f"rastercov.placement.plan.check.{step}"
    stop = stopped(capsys, monkeypatch, step, KeyboardInterrupt(), line)
    assert stop == (130, "", "interrupted\n")
    assert not Path("out.xml").exists()


def test_a_second_interrupt_leaves_out_the_page(capsys, monkeypatch):
    Path("plan.toml").write_text(EACH_STEP)
    refining, *_, drawing = STEPS
    monkeypatch.setattr(drawing, Mock(side_effect=KeyboardInterrupt))
    code, out, _ = stopped(capsys, monkeypatch, refining, KeyboardInterrupt())
    assert (code, figures()["interrupted"]) == (130, "refinement")
    assert "plan/plan.json" in out.splitlines()[:5]
    assert not Path("plan/page.html").exists()


@pytest.mark.parametrize("name", ["poses.json", "view.html"])
def test_a_file_of_nobody_is_refused_before_the_work_and_kept(capsys, monkeypatch, name):
    Path("out").mkdir()
    Path("out", name).write_text("mine")
    monkeypatch.setattr(plan_run, "place", lambda *_: 1 / 0)
    text = refusal(capsys, "place plan.toml --out out")
    assert text.startswith(f"error: out/{name}: expected a file of an earlier report, got")
    assert content("out") == {Path("out", name): b"mine"}


@pytest.mark.slow
def test_what_is_no_matrix_of_an_earlier_plan_stays(capsys):
    """Folders of such a name, files within one, and a matrix that another process is writing to."""
    for count in (20, 21):
        Path("plan.toml").write_text(QUICK.replace("count = 20", f"count = {count}"))
        call(capsys, f"place plan.toml --out out{count}")
    matrix = Path("out20/matrix")
    (matrix / "0123456789abcdef").mkdir()
    for name in ("0123456789abcdef/poses.npz", "fedcba9876543210"):
        (matrix / name).write_text("mine")
    (old,), (used,) = matrix.glob("*/header.json"), Path("out21/matrix").glob("*")
    old, used = old.parent, used.rename(matrix / used.name)
    (old / "pairs" / "notes.txt").write_text("mine")
    before = content(matrix)
    Path("plan.toml").write_text(QUICK.replace("count = 20", "count = 22"))
    with lock(used):
        assert call(capsys, "place plan.toml --out out20")[0] == 0
    gone = before.keys() - content(matrix).keys()
    assert gone == {path for path in before if path.is_relative_to(old)} - {old / "pairs/notes.txt"}
    assert call(capsys, "place plan.toml --out out20")[0] == 0
    assert not used.exists()
    assert list(content(matrix).values()).count(b"mine") == 3


# --- check ----------------------------------------------------------------------------------------


def test_a_rig_that_covers_enough_passes(capsys):
    code, out, err = call(capsys, CHECK)
    assert (code, err) == (0, "")
    assert out.startswith(
        "covered: 100.0 % of the faces, 100.0 % of the area\n"
        "goal for the whole task holds: 100.0 % covered, 100.0 % required\n"
        "evaluated by face, because min_pixels"
    )


@pytest.mark.slow
@pytest.mark.parametrize("n_gone", [1, 6])
def test_a_rig_that_lost_cameras_fails_by_as_much_as_they_covered(capsys, n_gone):
    write_poses("rig.json", axis_poses()[n_gone:])
    share = 1 - n_gone / 6
    (result,) = answer(capsys, f"{CHECK} --min-coverage 0.95", code=1)["requirements"]
    assert (result["status"], result["uncovered"]) == ("fails", 2 * n_gone)
    assert (result["share"], result["short_by"]) == pytest.approx((share, 0.95 - share))
    text = call(capsys, f"{CHECK} --min-coverage 0.95")[1]
    assert f"{2 * n_gone} faces uncovered" in text
    assert ("back-facing" if n_gone < 6 else "no cameras") in text
    assert call(capsys, f"{CHECK} --min-coverage {share}")[0] == (0 if share else 2)


@pytest.mark.slow
def test_views_and_groups_of_the_command_take_the_place_of_those_of_the_plan(capsys):
    line = f"{CHECK} --min-coverage 1e-9 --views 2"
    told = answer(capsys, line)
    assert told["views"] == told["network"]["required_views"] == 2
    code, out, _ = call(capsys, line + " --group lid=0.5 --group rest=1e-9")
    assert code == 1
    for words in ("goal for the whole task holds: 0.0 % covered", "goal for group rest holds",
                  "goal for group lid fails: 0.0 % covered, 50.0 % required, 50.0 percentage point",
                  "group lid: 2 faces uncovered: 2 too few cameras"):  # fmt: skip
        assert words in out
    write_poses("rig.json", np.concatenate((axis_poses(), axis_poses())))
    assert call(capsys, line + " --group lid=1")[0] == 0
    Path("plan.toml").write_text(QUICK.replace("[[cand", "views = { lid = 3 }\n[[cand", 1))
    code, out, _ = call(capsys, line.replace(" --views 2", "") + " --group lid=1 --group rest=1")
    assert code == 1
    assert "goal for group lid fails" in out
    assert "goal for group rest holds" in out
    said = "\nrequired views: 2 for all groups (the plan sets them by group)\n"
    assert said in call(capsys, line)[1]


def test_a_limit_within_the_bound_is_said_to_be_undecided(capsys):
    text = QUICK.replace("min_pixels = 2", 'min_pixels = 2\nmethod = "sampled"')
    line = f"{CHECK} --min-coverage 0.9"
    Path("plan.toml").write_text(text)
    assert call(capsys, line)[0] == 0
    # At 96 x 72 a sixth of the samples of a face may be wrong, and so may a limit of 0.99.
    Path("plan.toml").write_text(text.replace("[[cand", "min_coverage = 0.99\n[[cand", 1))
    code, out, _ = call(capsys, f"{line} --junit j.xml")
    assert code == 1
    said = "goal for the whole task is undecided: 100.0 % covered, 90.0 % required (100.0 % "
    assert out.splitlines()[1].startswith(said)
    told = answer(capsys, line, code=1)
    assert {(group["low"], group["high"]) for group in told["groups"]} == {(0, 1)}
    (failure,) = ElementTree.parse("j.xml").iter("failure")
    assert failure.get("type") == "undecided"


def test_junit_has_a_test_case_for_each_requirement(capsys):
    """A group may have a name that XML has no way to write."""
    write_poses("rig.json", axis_poses()[:5])
    part = Path("part.obj")
    part.write_text(part.read_text().replace("g lid", "g <\x01lid>&\"'"))
    line = f"{CHECK} --min-coverage 0.9 --group rest=0.5 --group '<*=1e-9'"
    assert call(capsys, line + " --junit out.xml")[0] == 1
    suites = ElementTree.parse("out.xml").getroot()
    (suite,) = suites
    assert (suites.tag, suite.tag) == ("testsuites", "testsuite")
    for element in (suites, suite):
        assert [element.get(n) for n in ("tests", "failures", "errors")] == ["3", "1", "0"]
    assert [case.find("failure") is not None for case in suite] == [True, False, False]
    assert {case.get("classname") for case in suite} == {"rastercov.plan"}
    names = [case.get("name") for case in suite]
    assert names[:2] == ["coverage of whole task", "coverage of rest"]
    failure = suite[0].find("failure")
    assert "6.7 percentage points below the goal" in failure.get("message")
    assert "faces uncovered: 2 back-facing" in failure.text


@pytest.mark.slow
def test_junit_replaces_an_outcome_and_nothing_else(capsys):
    Path("empty.xml").write_text("")
    for name in ("out.xml", "out.xml", "empty.xml"):
        done(capsys, f"{CHECK} --junit {name}")
        assert ElementTree.parse(name).getroot().get("name") == "rastercov"
    Path("of_others.xml").write_text("<?xml version='1.0'?><testsuites name='pytest'/>")
    before = content(".")
    for name in ("plan.toml", "rig.json", "part.obj", "of_others.xml"):
        said = refusal(capsys, f"{CHECK} --junit {name}")
        assert said.startswith(f"error: {name}: expected a file by `rastercov check`")
    assert content(".") == before


def test_junit_goes_through_links_and_pipes(capsys):
    Path("link.xml").symlink_to("out.xml")
    assert call(capsys, f"{CHECK} --junit link.xml")[0] == 0
    assert Path("link.xml").is_symlink()
    assert ElementTree.parse("out.xml").getroot().get("name") == "rastercov"
    os.mkfifo("pipe")
    with subprocess.Popen(["timeout", "30", "cat", "pipe"], stdout=subprocess.PIPE) as reader:
        assert call(capsys, f"{CHECK} --junit pipe")[0] == 0
        assert ElementTree.fromstring(reader.communicate()[0]).get("name") == "rastercov"
    assert Path("pipe").is_fifo()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("check no.toml -p rig.json", "no.toml: no such file"),
        ("check plan.toml -p no.json", "no.json: no such file"),
        ("check plan.toml", "expected --poses, got none"),
        ("check plan.toml -p rig.json --group lid", "--group NAME=SHARE: expected a share"),
        ("check plan.toml -p rig.json --group lid=nan", "--group NAME=SHARE: expected a share"),
        ("check plan.toml -p rig.json --group led=1", "got 'led'"),
        ("check plan.toml -p rig.json --junit no/j.xml", "got a folder that does not exist"),
    ],
)
def test_each_bad_check_gets_one_line(capsys, line, words):
    assert words in refusal(capsys, line)


def test_a_plan_that_asks_for_nothing_needs_a_limit(capsys):
    Path("plan.toml").write_text(SCENE)
    assert "give --min-coverage" in refusal(capsys, "check plan.toml -p rig.json")
    assert call(capsys, f"{CHECK} --min-coverage 1")[0] == 0


# --- the examples ---------------------------------------------------------------------------------


def is_on_a_wall(eyes):
    """True where an eye is on a wall or the ceiling of the room, and not over its door."""
    is_over_door = (eyes[:, 0] >= 2) & (np.abs(eyes[:, 1]) <= 0.6)
    return (np.abs(np.abs(eyes) - (2.9, 2.4, 2.7)) < 1e-9).any(axis=1) & ~is_over_door


LAWS = {
    "inspect_part": lambda told, eyes: (
        told["requirements"][0]["share"] >= 0.98
        and told["candidates"]["dropped"]["kept_out"] > 0
        and told["tolerance"]["together"]["worst"] <= told["share"] + 1e-9
        and (eyes[:, 2] > -0.02).all()
    ),
    "watch_room": lambda told, eyes: (
        len(eyes) <= 6
        and told["selection"]["cost"] <= 7
        and told["share"] > told["selection"]["share"] - 0.01  # one is exact, the other on cells
        and is_on_a_wall(eyes).all()
    ),
    "mixed_cameras": lambda told, eyes: (
        told["selection"]["cost"] <= 3000
        and {each["camera"] for each in told["cameras"]} == {"long", "pair/left", "pair/right"}
    ),
    "gauge_ring": lambda told, eyes: (
        told["requirements"][0]["share"] >= 0.9
        and told["share"] > 0.8
        and len(eyes) <= 15
        and (np.abs(np.linalg.norm(eyes, axis=1) - 0.138) < 0.02).all()  # the working distance
    ),
    "eye_height": lambda told, eyes: (
        {group["role"] for group in told["network"]["groups"]} == {"occluder", "target"}
        and told["share"] > 0.5
        and len(eyes) == 4
    ),
}

DEAR = ("mixed_cameras", "watch_room", "gauge_ring")
"""Plans that run by day where examples changed."""


@pytest.mark.slow
@pytest.mark.usefixtures("no_pages", "short_search")
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.matter("docs") if name in DEAR else ()) for name in LAWS],
)
def test_an_example_plan_does_what_it_is_for(capsys, name):
    code, out, _ = call(capsys, f"place {EXAMPLES / name}.toml --out placed")
    told = figures("placed")
    assert (code, told["met"]) == (0, True if told["requirements"] else None)
    assert LAWS[name](told, read_poses("placed/poses.json")[:, :3, 3])
    assert "nan" not in out.lower()
    assert {path.stem for path in EXAMPLES.glob("*.toml")} == {*LAWS, "audit_rig"}
    if name == "mixed_cameras":
        line = f"check {EXAMPLES / name}.toml -p placed/poses.json --min-coverage 0.4"
        assert answer(capsys, line)["covered_area"]["percent"] == pytest.approx(100 * told["share"])


@pytest.mark.slow
@pytest.mark.usefixtures("no_pages", "short_search", "all_places")
def test_the_rig_is_audited(capsys):
    plan, rig = EXAMPLES / "audit_rig.toml", EXAMPLES / "rig.json"
    assert call(capsys, f"check {plan} -p {rig}")[0] == 0
    code, out, _ = call(capsys, f"check {plan} -p {rig} --views 2")
    page = (EXAMPLES.parents[1] / "docs" / "check.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"--views 2\n(covered.*?)\$ echo", page, re.DOTALL)
    begin, _, end = shown.partition("[...]\n")
    assert code == 1
    assert out.startswith(begin)
    assert out.endswith(end)
    assert begin
    assert end
    assert call(capsys, f"place {plan} --out audit")[0] == 0
    assert len(figures("audit")["cameras"]) < len(read_poses(rig))


@pytest.mark.parametrize("option", ["--min-coverage 0", "--group rest=0", "--group lid=-0.0"])
def test_a_goal_of_0_is_refused_because_it_always_holds(capsys, option):
    write_poses("rig.json", axis_poses())
    code, out, err = call(capsys, f"{CHECK} {option}")
    assert (code, out) == (2, "")
    assert "always holds; increase it" in err


@pytest.mark.parametrize("shares", ["coverage = 0", "coverage = 0.5\ngroups = { lid = 0.0 }"])
def test_a_goal_of_0_in_a_plan_is_refused(capsys, shares):
    write_poses("rig.json", axis_poses())
    text = Path("plan.toml").read_text()
    assert "[selection]" in text
    Path("plan.toml").write_text(
        re.sub(r"\[selection\][^\[]*", f'[selection]\ngoal = "fewest_cameras"\n{shares}\n\n', text)
    )
    code, out, err = call(capsys, CHECK)
    assert (code, out) == (2, "")
    assert "got 0, which always holds" in err


def test_names_of_groups_stay_when_a_second_mesh_joins(capsys):
    write_poses("rig.json", axis_poses())
    share = f"{CHECK} --group lid=0.5 --group rest=0.5"
    assert call(capsys, share)[0] == 0
    Path("other.obj").write_text("v 50 0 0\nv 51 0 0\nv 50 1 0\ng shade\nf 1 2 3\n")
    text = Path("plan.toml").read_text()
    both = '{ path = "part.obj" }, { path = "other.obj", role = "occluder" }'
    Path("plan.toml").write_text(text.replace('{ path = "part.obj" }', both, 1))
    code, _, err = call(capsys, share)
    assert code == 0, err
    Path("other.obj").write_text(Path("other.obj").read_text().replace("shade", "lid"))
    Path("other.obj").write_text(Path("other.obj").read_text() + "g roof\nf 1 3 2\n")
    code, _, err = call(capsys, share)
    assert code == 2
    assert "expected one file with a group 'lid', got 2; give one of " in err


def test_figures_and_files_are_a_step_with_a_name(tmp_path, monkeypatch):
    """The flight, and dead zones of an intermediate result, took minutes of "place"."""
    names = []

    @contextmanager
    def step(name):
        names.append(name)
        yield silent

    monkeypatch.setattr(plan_report, "WORTH_SAVING", 0.0)
    plan = {"meshes": [{"built_in": "teapot-5"}], "camera": {"preset": "khepra"}}
    plan |= {"candidates": [{"generator": "on_sphere", "count": 6}], "outputs": {"page": True}}
    plan |= {"selection": {"goal": "best_coverage", "cameras": 1}}
    plan_report.run_into(plan_of(plan), tmp_path / "out", step)
    assert names[-3:] == ["figures", "page", "figures"]
