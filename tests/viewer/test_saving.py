"""What the viewer saves and opens: rigs, plans, reports, results, and pages of one file."""

import base64
import hashlib
import json
import math
import re
import time
import tomllib
from importlib.resources import files

import numpy as np
import pytest
from commands import call, enter
from hypothesis import example, given
from hypothesis import strategies as st
from nightly import examples
from rigs_to_view import CAMERA, acted, around, moved, part, session_of

import rastercov as rc
from rastercov import cli
from rastercov.camera.formats import read_views
from rastercov.mesh import shapes
from rastercov.viewer.saving import Saving, exported, toml_text
from rastercov.viewer.scene import open_plan, open_result
from rastercov.viewer.session import Session, unframed

SCALARS = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.text()
NAMES = st.text()
VALUES = st.recursive(
    SCALARS, lambda each: st.lists(each, max_size=3) | st.dictionaries(NAMES, each, max_size=3)
)


@examples(20)
@example({"far": math.inf, "near": -math.inf, "a b": [{}], "text": "\x7f"})
@given(st.dictionaries(st.text(), VALUES, max_size=4))
def test_toml_is_read_back(table):
    assert tomllib.loads(toml_text(table | {"left": None})) == {
        name: value for name, value in table.items() if name != "left"
    }


def test_a_saved_rig_is_the_rig(tmp_path):
    session = session_of()
    acted(session, do="camera", camera="eye", changes={"fx": 333})
    acted(session, do="new_camera", name="second", source="khepra")
    acted(session, do="use", station=2, camera="second")
    acted(session, do="pose", station=0, pose=moved(around(part())[0], (0, 0.1, 0)))
    said = Saving(session, tmp_path / "out").save({"what": "rig"})
    found = read_views(said["path"])
    assert found.images == tuple(each.name for each in session.state.stations)
    assert np.array_equal(
        found.poses.world_from_camera, [each.pose for each in session.state.stations]
    )
    assert found.rig.names == ("eye", "second")
    assert found.rig.cameras == tuple(session.state.cameras.values())
    assert session.history.is_saved
    session.close()


@pytest.mark.slow
def test_a_saved_plan_gives_the_same_coverage(tmp_path):
    (tmp_path / "plan.toml").write_text(
        'meshes = [{ built_in = "teapot-5" }]\n[camera]\npreset = "khepra"\nnear = 0.001\n'
        '[task]\nmin_pixels = 2.0\nby = "face"\n'
    )
    session = Session(open_plan(tmp_path / "plan.toml"))
    for pose in around(shapes.by_name("teapot-5"), 3):
        acted(session, do="add", camera="camera", pose=pose.ravel().tolist())
    acted(session, do="task", changes={"max_incidence_deg": 60.0})
    head, _ = acted(session)
    saving = Saving(session, tmp_path / "out")
    saving.save({"what": "plan"})
    found = rc.place(tmp_path / "out" / "plan.toml")
    assert found.prepared.task == session.state.task
    assert found.cameras.covered.sum() == head["summary"]["covered"]["faces"]
    again = Session(
        open_plan(tmp_path / "out" / "plan.toml", read_views(tmp_path / "out/rig.json"))
    )
    assert acted(again)[0]["summary"]["covered"] == head["summary"]["covered"]
    for each in (session, again):
        each.close()


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Folders of results of a mesh file that lies beside them."""
    folder = tmp_path_factory.mktemp("results")
    part().to_trimesh().export(folder / "part.stl")
    poses = folder / "rig.json"
    rc.write_poses(poses, around(part()))
    CAMERA.save(folder / "camera.json")
    arguments = [folder / "part.stl", "-c", folder / "camera.json", "-p", poses, "--min-pixels", 2]
    out = ["-o", folder / "evaluated", "--pictures", 0]
    assert cli.command(["evaluate", *map(str, [*arguments, *out])]) == 0
    return folder


def test_a_result_is_opened_with_its_rig_and_thresholds(results):
    mesh = rc.Mesh.load(results / "part.stl")
    scene = open_result(results / "evaluated", lambda names: mesh)
    session = Session(scene)
    head, _ = acted(session)
    summary = json.loads((results / "evaluated" / "summary.json").read_text())
    assert head["summary"]["covered"] == summary["covered"]
    assert scene.start.task.min_pixels == 2
    assert scene.result["kind"] == "evaluate"
    session.close()


def test_another_mesh_is_told_by_its_hash(results):
    other = part().moved(translation=(0, 0, 1))
    with pytest.raises(rc.ConfigError, match="not that of"):
        open_result(results / "evaluated", lambda names: other)
    (results / "none").mkdir()
    (results / "none" / "summary.json").write_text("[]")
    for folder in (results, results / "none"):
        with pytest.raises(rc.ConfigError, match="is no result"):
            open_result(folder, lambda names: other)


@pytest.mark.slow
def test_a_report_is_that_of_evaluate(tmp_path):
    session = session_of()
    head, _ = acted(session)
    said = Saving(session, tmp_path).save({"what": "report"})
    summary = json.loads((tmp_path / "report" / "summary.json").read_text())
    assert summary["covered"] == head["summary"]["covered"]
    assert said["path"] == str(tmp_path / "report")
    session.close()


def test_nothing_is_saved_without_a_folder_or_a_camera(tmp_path):
    session = session_of(count=0)
    for out, asked, words in (
        (None, {"what": "rig"}, "--out"),
        (tmp_path, {"what": "rig"}, "no camera"),
        (tmp_path, {"what": "../x"}, "what must be"),
        (tmp_path, {"what": "rig", "more": 1}, "what must be"),
        (tmp_path, {}, "what must be"),
    ):
        with pytest.raises(rc.ConfigError, match=words):
            Saving(session, out).save(asked)
    session.close()


def test_a_page_of_one_file_has_all_its_modules_and_data():
    session = session_of()
    page = exported(session)
    [script] = re.findall(r'<script type="module">(.*?)</script>', page, re.S)
    assert re.findall(r"^(?:import|export)\b.*", script, re.M) == []
    modules = re.findall(r"^const (\w+)_js = \(", script, re.M)
    folder = files("rastercov.viewer") / "page"
    assert sorted(modules) == sorted(x.name[:-3] for x in folder.iterdir() if x.suffix == ".js")
    for row, name in enumerate(modules):  # each after those that it uses
        text = script.partition(f"const {name}_js = (")[2].partition("\n})();\n")[0]
        assert set(re.findall(r"^const \{[^}]*\} = (\w+)_js;", text, re.M)) <= {*modules[:row]}
    assert 'src="/' not in page
    assert 'href="/' not in page
    inside = re.search(r'<script type="application/json" id="export">(.*?)</script>', page, re.S)[1]
    data = json.loads(inside)
    for mode, frame in data["frames"].items():
        _, levels = unframed(session.frame(mode, {}))
        assert base64.b64decode(frame["levels"]) == levels
    assert set(data["frames"]) >= {"reason", "camera", "area"}
    assert not data["scene"]["can_edit"]
    session.close()


def test_the_policy_of_a_page_of_one_file_names_its_script_and_style():
    session = session_of()
    acted(session, do="rename", station=0, name="</script><script>alert(1)</script>")
    page = exported(session)
    assert "<script>alert" not in page
    [policy] = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert page.index(policy) < page.index("<script")
    assert "unsafe" not in policy
    rules = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert rules["default-src"] == rules["connect-src"] == "'none'"
    assert rules["base-uri"] == rules["form-action"] == "'none'"
    for tag, rule in (("script", "script-src"), ("style", "style-src")):
        run = re.findall(rf"<{tag}(?![^>]*application/json)[^>]*>(.*?)</{tag}>", page, re.S)
        digests = [base64.b64encode(hashlib.sha256(x.encode()).digest()).decode() for x in run]
        assert rules[rule] == " ".join(f"'sha256-{each}'" for each in digests)
    session.close()


def test_the_command_writes_a_page(tmp_path, capsys):
    page = tmp_path / "page.html"
    line = ["view", "teapot-5", "-c", "khepra", "-p", "sphere:3", "--export", str(page)]
    code, out, _ = call(capsys, line)
    assert code == 0
    assert "export" in page.read_text()
    assert "3 cameras" in out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing.stl", "-c", "khepra"], "No such file"),
        (["teapot-5"], "no camera"),
        (["teapot-5", "-c", "khepra", "--host", "0.0.0.0"], "reachable from elsewhere"),
        (["teapot-5", "-c", "khepra", "--port", "70000"], "port"),
        (["teapot-5", "-c", "khepra", "-p", "sphere:3", "--export", "page.txt"], ".html"),
        (["nothing.toml"], "nothing.toml"),
        (["icosahedron", "-c", "khepra", "--method", "fast"], "method"),
        (["tests", "--min-pixels", "4"], "its own thresholds"),
        (["tests"], "is no result"),
    ],
)
def test_a_wrong_call_is_one_line(arguments, words, capsys, monkeypatch, tmp_path):
    enter(tmp_path, monkeypatch)
    (tmp_path / "tests").mkdir()
    code, _, err = call(capsys, ["view", *arguments])
    assert code == 2
    assert len(err.splitlines()) == 1, err
    assert words in err


@pytest.mark.parametrize(
    ("display", "fault", "words"),
    [
        ("", None, "there is no display: open the address elsewhere"),
        (":0", OSError(28, "No space left on device"),
         "no browser is opened (No space left on device); open the address"),
        (":0", None, None),
    ],
)  # fmt: skip
def test_a_browser_is_opened_where_one_can_be_and_the_address_is_printed(
    tmp_path, monkeypatch, capsys, display, fault, words
):
    opened = []

    def served(session, address, out, started, arrived):
        started("http://127.0.0.1:1/#token")

    def made(*arguments, **options):
        raise fault

    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("rastercov.viewer.server.serve", served)
    if fault:
        monkeypatch.setattr("rastercov.viewer.server.TemporaryDirectory", made)
    code, out, err = call(capsys, "view icosahedron -c khepra")
    assert (code, out.splitlines()[-1]) == (0, "http://127.0.0.1:1/#token")
    assert err == "Ctrl-C ends it\n" if words is None else words in err
    time.sleep(0.1)
    assert [url.startswith("file://") for url in opened] == ([True] if words is None else [])
