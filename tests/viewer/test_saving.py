"""What the viewer saves and opens: rigs, plans, reports, results, and pages of one file."""

import base64
import hashlib
import json
import re
import time
import tomllib
from contextlib import closing
from dataclasses import replace
from importlib.resources import files
from unittest.mock import Mock

import numpy as np
import pytest
from commands import call, enter, refusal
from edited import Saving, Session
from hypothesis import example, given
from hypothesis import strategies as st
from nightly import IS_NIGHTLY, examples
from rigs_to_view import CAMERA, acted, around, moved, part, session_of

import rastercov as rc
from rastercov import cli
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.mesh import shapes
from rastercov.formats.cameras import read_views
from rastercov.formats.cameras.own import content_of
from rastercov.page.rig_state import RigState
from rastercov.page.saving import export_state, with_drawing
from rastercov.page.scene import Scene, open_plan, open_result
from rastercov.page.session import remove_head


def test_a_saved_rig_is_the_rig(tmp_path):
    session = session_of()
    acted(session, do="camera", camera="eye", changes={"fx": 333})
    acted(session, do="new_camera", name="second", source="khepra")
    acted(session, do="use", station=2, camera="second")
    acted(session, do="pose", station=0, pose=moved(around(part())[0], (0, 0.1, 0)))
    views, state = (
        read_views(Saving(session, tmp_path / "out").save({"what": "rig"})["path"]),
        session.state,
    )
    assert views.images == tuple(each.name for each in state.stations)
    assert np.array_equal(views.poses.world_from_camera, [each.pose for each in state.stations])
    assert views.rig.names == ("eye", "second")
    assert views.rig.cameras == tuple(state.cameras.values())
    assert session.history.is_saved
    session.close()


def test_a_drawing_is_saved_with_the_rig_and_comes_back_with_its_scene(tmp_path):
    drawing = {"name": "a.png", "place": [[0.1, 0.2], [3.0, -4.0]], "opacity": 0.5, "image": "iVBO"}
    with closing(session_of(count=0)) as first, closing(session_of(count=0)) as second:
        first.draw(drawing)
        first.draw({"opacity": 0.25})
        assert not first.described_state()["is_saved"]
        Saving(first, tmp_path).save({"what": "rig"})  # without a camera, too
        assert first.described_state()["is_saved"]
        with_drawing(second, [tmp_path / "none", tmp_path])
        assert second.drawing.model_dump() == drawing | {"opacity": 0.25}
        for wrong in ({"place": [[1, 2]]}, {"opacity": 2.0}, {"image": "<svg>"}, {"path": "/"}):
            with pytest.raises(rc.ConfigError, match=next(iter(wrong))):
                second.draw(wrong)
        other = Session(replace(second.scene, title="another"))
        assert with_drawing(other, [tmp_path]).drawing is None
        second.draw({})
        acted(second, do="add", camera="eye", pose=np.ravel(around(part())[0]).tolist())
        Saving(second, tmp_path).save({"what": "rig"})
        assert with_drawing(Session(second.scene), [tmp_path]).drawing is None
        (tmp_path / "viewer_drawing.json").write_text('{"scene": "part", "name": 1')
        with pytest.raises(
            rc.ConfigError, match=r"drawing\.json: expected a drawing .*; remove it"
        ):
            with_drawing(second, [tmp_path])


def test_a_camera_of_the_catalogue_of_a_plan_is_used_and_saved(tmp_path):
    (tmp_path / "own.toml").write_text(
        '[cameras]\nours = { width = 400, height = 300, pixel_size = 2e-6, mount = "C" }\n'
    )
    plan = 'catalogue = "own.toml"\nmeshes = [{ built_in = "box" }]\ncamera = { preset = "khepra" }'
    (tmp_path / "plan.toml").write_text(plan)
    with closing(Session(open_plan(tmp_path / "plan.toml"))) as session:
        names = [name for name, _ in session.describe()["catalogue"]]
        name = next(each for each in names if each.startswith("ours+"))
        acted(session, do="add", camera=name, pose=np.ravel(around(shapes.box())[0]).tolist())
        sold = rc.Camera.from_dict({"preset": name, "catalogue": tmp_path / "own.toml"})
        assert session.state.camera_of(session.state.stations[0]) == sold
        rig = Saving(session, tmp_path / "out").save({"what": "rig"})["path"]
    assert read_views(rig).rig.cameras == (sold,)


@pytest.mark.slow
def test_a_saved_rig_or_report_gives_the_same_coverage(tmp_path):
    plan = 'meshes = [{ built_in = "teapot-5" }]\n[camera]\npreset = "khepra"\nnear = 0.001\n'
    (tmp_path / "plan.toml").write_text(plan + '[task]\nmin_pixels = 2.0\nby = "face"\n')
    session, out = Session(open_plan(tmp_path / "plan.toml")), tmp_path / "out"
    for pose in around(shapes.by_name("teapot-5"), 3):
        acted(session, do="add", camera="camera", pose=pose.ravel().tolist())
    acted(session, do="task", changes={"max_incidence_deg": 60.0})
    covered = acted(session)[0]["summary"]["covered"]
    saving = Saving(session, out)
    saving.save({"what": "rig"})
    (out / "plan.toml").write_text(plan + (out / "task.toml").read_text())
    again = Session(open_plan(out / "plan.toml", read_views(out / "rig.json")))
    assert acted(again)[0]["summary"]["covered"] == covered
    assert saving.save({"what": "report"})["path"] == str(out / "report")
    assert json.loads((out / "report" / "summary.json").read_text())["covered"] == covered
    for each in (session, again):
        each.close()


@examples(7)
@example({"a b": 3, '"\x7f': 2}, 0.3, None)
@given(
    st.dictionaries(st.text(), st.integers(1, 9)) | st.none(), st.floats(0, 1),
    st.sampled_from(["vertices", "centroid"]) | st.none(),
)  # fmt: skip
def test_saved_thresholds_are_read_back(needed, share, rule):
    own = {"min_visibility": share, "cap_resolution": False, "views": 4}
    own |= {} if rule is None else {"focus_rule": rule}
    session = session_of(count=1)
    rig = session.call("asked")["rig"] | {"needed": needed}
    rig["task"] |= own
    read = tomllib.loads(session.call("texts", rig)["task"])["task"]
    assert read.pop("views") == (4 if needed is None else needed)
    assert replace(rc.Task(**read), views=4) == rc.Task(**own)
    session.close()


NAMES = ("eye", "2", "10", 'a "b" \\', "ä / é", "left", "right", "lamp")
LENSES = (
    CAMERA,
    replace(CAMERA, model="opencv", distortion=(-0.1, 0.01, 1e-5, -1e-17), skew=0.125),
    replace(CAMERA, focus_range=(0.1, np.inf), near=1e-7),
    replace(CAMERA, cx=0.1 + 0.2, pixel_size=(3.45e-6,) * 2, focal_length=0.012, aperture=1e-3,
            focus_distance=1 / 3),
)  # fmt: skip


def random_rig(rng):
    """Rigs and single cameras, with their rules, places and thresholds, and poses of them."""
    names, parts = rng.permutation(NAMES).tolist(), []
    for n in rng.integers(1, 4, 3)[: rng.integers(1, 4)]:
        own = rng.integers(len(LENSES), size=n)
        places = rc.look_at(rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) + 9)
        rules = (
            rc.All(min_baseline_deg=0.1, max_uncertainty=1e-3, noise_px=1 / 3),
            rc.AtLeast(max(1, n - 1)),
        )
        rule = {"rule": rules[rng.integers(2)]} if n > 1 and rng.random() < 0.7 else {}
        parts.append(Rig([LENSES[row] for row in own], names[:n], places, **rule))
        del names[:n]
    rig = parts[0] if len(parts) == 1 else Rig.of_several(parts, sum((p.names for p in parts), ()))
    tasks = {name: rc.Task(min_pixels=rng.random()) for name in rig.names if rng.random() < 0.3}
    fixed = [] if rig.gates else [name for name in rig.names[1:] if rng.random() < 0.3]
    rig = Rig(rig.cameras, rig.names, rig.rig_from_camera, tasks=tasks, fixed=fixed)._with(
        rule=rig.rule, gates=rig.gates
    )
    starts, rows = np.cumsum([0, *map(len, parts)]), list[int]()
    for one in rng.integers(len(parts), size=rng.integers(1, 5)):
        rows += [*range(starts[one], starts[one + 1])]
    return rig, Poses.of(rc.look_at(rng.normal(size=(len(rows), 3)), (9, 9, 9)), camera=rows)


def by_name(views):
    """What a file of cameras says of each of them, and of its poses, in whatever order."""
    rig = views.rig
    rows = {name: at for at, name in enumerate(rig.names)}
    gates = {rig.names[at : at + gate.n]: gate for at, gate in rig.gates.items()}
    places = {name: rig.rig_from_camera[row].tolist() for name, row in rows.items()}
    named = [rig.names[row] for row in views.poses.camera]
    cameras = {name: rig.cameras[row] for name, row in rows.items()}
    poses = views.poses.world_from_camera.tolist()
    own = (cameras, places, gates, dict(rig.tasks), {*rig.fixed})
    return *own, rig.rule if rig.is_one else None, named, poses, views.images, views.has_unit


@pytest.mark.parametrize("seed", range(25 if IS_NIGHTLY else 6))
def test_a_page_writes_the_file_that_rastercov_writes_of_the_same_rig(seed, tmp_path):
    rng = np.random.default_rng(seed)
    rig, poses = random_rig(rng)
    state = replace(RigState.of(rig, poses), unit=("m", "unit")[seed % 2])
    with closing(Session(Scene("part", part(), state))) as session:
        (tmp_path / "page.json").write_text(session.call("texts")["rig"], encoding="utf-8")
    names = tuple(each.name for each in state.stations)
    rows = state.poses(all_stations=True)
    wanted = rc.Views(state.rig(rows), rows, names, has_unit=state.unit == "m")
    (tmp_path / "own.json").write_text(json.dumps(content_of(wanted)))
    read = [by_name(rc.read_views(tmp_path / f"{name}.json")) for name in ("page", "own")]
    assert read[0] == read[1]
    sizes = [json.loads((tmp_path / f"{name}.json").read_text()).keys() for name in ("page", "own")]
    assert sizes[0] == sizes[1]  # of entries


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Folders of results of a mesh file that lies beside them."""
    folder = tmp_path_factory.mktemp("results")
    part().to_trimesh().export(folder / "part.stl")
    views = rc.Views(rc.Rig([CAMERA], ["eye"]), rc.Poses.of(around(part())), tuple("abcd"))
    rc.write_views(folder / "rig.json", views)
    line = f"{folder}/part.stl -p {folder}/rig.json --min-pixels 2 --pictures 0"
    assert cli.command(["evaluate", *line.split(), "-o", str(folder / "evaluated")]) == 0
    return folder


def test_a_result_is_opened_with_its_rig_and_thresholds(results):
    mesh = rc.Mesh.load(results / "part.stl")
    scene = open_result(results / "evaluated", lambda names: (mesh, {}))
    summary = json.loads((results / "evaluated" / "summary.json").read_text())
    with closing(Session(scene)) as session:
        assert acted(session)[0]["summary"]["covered"] == summary["covered"]
    assert (scene.start.task.min_pixels, scene.result["kind"]) == (2, "evaluate")
    summary["covered_area"] = {"views": {"lid": 2}}  # as a placement has them
    (results / "evaluated" / "summary.json").write_text(json.dumps(summary))
    assert open_result(results / "evaluated", lambda names: (mesh, {})).start.needed == {"lid": 2}


def test_another_mesh_is_told_by_its_hash(results):
    other = part().moved(translation=(0, 0, 1))
    with pytest.raises(rc.ConfigError, match="expected the mesh of"):
        open_result(results / "evaluated", lambda names: (other, None))
    (results / "none").mkdir()
    (results / "none" / "summary.json").write_text("[]")
    for folder in (results, results / "none"):
        with pytest.raises(rc.ConfigError, match="expected a result"):
            open_result(folder, lambda names: (other, None))


@pytest.mark.parametrize(
    ("has_out", "asked", "words"),
    [(False, {"what": "rig"}, "--out"), (True, {"what": "rig"}, "expected a camera"),
     (True, {"what": "../x"}, "what: expected"), (True, {}, "what: expected"),
     (True, {"what": "rig", "more": 1}, "more: expected")],
)  # fmt: skip
def test_nothing_is_saved_without_a_folder_or_a_camera(tmp_path, has_out, asked, words):
    saving = Saving(session_of(count=0), tmp_path if has_out else None)
    with pytest.raises(rc.ConfigError, match=words):
        saving.save(asked)


def test_a_page_of_one_file_has_all_its_modules_and_data():
    session = session_of()
    page = export_state(session, session.state)
    [script] = re.findall(r'<script type="module">(.*?)</script>', page, re.S)
    assert not re.search(r"^(?:import|export)\b", script, re.M)
    modules = re.findall(r"^const (\w+)_js = \(", script, re.M)
    folder = files("rastercov.page") / "web"
    made = {"features", "texts"}  # of what registers, and of functions of Python
    assert {*modules} == made | {x.name[:-3] for x in folder.iterdir() if x.suffix == ".js"}
    for row, name in enumerate(modules):  # each after those that it uses
        text = script.partition(f"const {name}_js = (")[2].partition("\n})();\n")[0]
        assert set(re.findall(r"^const \{[^}]*\} = (\w+)_js;", text, re.M)) <= {*modules[:row]}
    assert not re.search('(src|href)="/', page)
    data = json.loads(re.search(r'id="export">(.*?)</script>', page, re.S)[1])
    for mode, frame in data["frames"].items():
        assert base64.b64decode(frame["levels"]) == remove_head(session.frame(mode, {}))[1]
    assert set(data["frames"]) >= {"reason", "camera", "area"}
    assert not data["scene"]["can_edit"]
    session.close()


def test_the_policy_of_a_page_of_one_file_names_its_script_and_style():
    session = session_of()
    acted(session, do="rename", station=0, name="</script><script>alert(1)</script>")
    page = export_state(session, session.state)
    assert "<script>alert" not in page
    [policy] = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert page.index(policy) < page.index("<script")
    rules = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    for name in ("default-src", "connect-src", "base-uri", "form-action"):
        assert rules[name] == "'none'"
    for tag in ("script", "style"):
        run = re.findall(rf"<{tag}(?![^>]*application/json)[^>]*>(.*?)</{tag}>", page, re.S)
        digests = [base64.b64encode(hashlib.sha256(x.encode()).digest()).decode() for x in run]
        assert rules[f"{tag}-src"] == " ".join(f"'sha256-{each}'" for each in digests)
    session.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [("nothing.stl -c khepra", "no such file"), ("teapot-5", "expected a camera"),
     ("teapot-5 -c khepra --port 70000", "port"), ("nothing.toml", "nothing.toml"),
     ("teapot-5 -c khepra -p sphere:3 --export page.txt", ".html"), ("tests", "expected a result"),
     ("icosahedron -c khepra --method fast", "method"),
     ("tests --min-pixels 4", "no threshold options with tests")],
)  # fmt: skip
def test_a_wrong_call_is_one_line(line, words, capsys, monkeypatch, tmp_path):
    enter(tmp_path, monkeypatch)
    (tmp_path / "tests").mkdir()
    assert words in refusal(capsys, f"view {line}")


FULL = OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("display", "fault", "said"),
    [("", None, "no display found: forward the port"),
     (":0", FULL, "cannot open a browser (No space left on device); open the address"),
     (":0", None, "press Ctrl-C to stop\n")],
)  # fmt: skip
def test_a_browser_is_opened_where_one_can_be_and_the_address_is_printed(
    monkeypatch, capsys, display, fault, said
):
    opened, address = [], "http://127.0.0.1:1/#token"
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("webbrowser.open", opened.append)
    serve = Mock(side_effect=lambda *rest, arrived: rest[3](address))
    monkeypatch.setattr("rastercov.page.server.serve", serve)
    if fault:
        monkeypatch.setattr("rastercov.page.server.TemporaryDirectory", Mock(side_effect=fault))
    code, out, err = call(capsys, "view icosahedron -c khepra")
    assert (code, out.splitlines()[-1]) == (0, address)
    assert said in err
    time.sleep(0.1)
    is_opened = bool(display) and not fault
    assert [url.startswith("file://") for url in opened] == [True] * is_opened
    assert err == said or not is_opened
