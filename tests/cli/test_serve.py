"""Another program asks by lines of JSON: what it gets is what Python gets, whatever it writes."""

import ast
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import ENTRY, call
from goals_to_view import PLAN as VIEWED
from goals_to_view import plan_in
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from nightly import examples
from processes import TESTS

import rastercov as rc
from rastercov.base import json_bytes
from rastercov.cli import serve as serving
from rastercov.cli.serve import Service
from rastercov.core.mesh import shapes
from rastercov.placement.plan.check import to_json

CLIENT = TESTS.parent / "examples" / "serve_client.py"
CAMERA = {"width": 640, "height": 480, "hfov_deg": 60.0}
PLAN = {
    "meshes": [{"built_in": "box"}],
    "camera": CAMERA,
    "task": {"max_incidence_deg": 70.0},
    "candidates": [{"generator": "on_sphere", "count": 6}],
    "selection": {"goal": "best_coverage", "cameras": 2},
}
POSES = rc.look_at([(2.5, 1.0, 0.7), (-1.0, 2.5, 1.5), (0.2, 0.1, -3.0)], (0, 0, 0))
OPEN = {"do": "open", "plan": PLAN}


SCHEMA = json.loads((TESTS.parent / "docs" / "answers.schema.json").read_text(encoding="utf-8"))
ANSWERS = Draft202012Validator(SCHEMA | {"$ref": "#/$defs/serve"})


def ask(service, entries):
    answer = json.loads(json_bytes(service.answer(json.dumps(entries).encode())))
    ANSWERS.validate(answer)
    return answer


@pytest.fixture
def service():
    opened = Service()
    assert ask(opened, OPEN)["result"]["scene"] == 1
    return opened


def run(monkeypatch, capfdbinary, data, most=None):
    """Answers of the command to bytes on its standard input."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    if most is not None:
        monkeypatch.setattr(serving, "LARGEST_TEXT", most)
    assert call_bytes(["serve", "--stdio"]) == 0
    out, err = capfdbinary.readouterr()
    assert err == b""
    return [json.loads(line) for line in out.splitlines()]


def call_bytes(words):
    from rastercov.cli import command

    return command(words)


@pytest.mark.parametrize("form", ["matrices", "table", "file", "own cameras"])
def test_figures_are_those_of_python_to_the_last_bit(service, tmp_path, form):
    camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    poses = POSES.tolist()
    asked = {
        "matrices": poses,
        "table": {"world_from_camera": poses},
        "file": str(tmp_path / "rig.npy"),
        "own cameras": {
            "cameras": [{"name": "a", "width": 320, "height": 240, "hfov_deg": 30}],
            "world_from_camera": poses,
        },
    }[form]
    np.save(tmp_path / "rig.npy", POSES)
    task = rc.Task(max_incidence_deg=70)
    if form == "own cameras":
        assert (
            ask(service, {"do": "open", "plan": {"meshes": PLAN["meshes"]}})["result"]["cameras"]
            == []
        )
        camera, task = rc.Camera.from_fov(320, 240, hfov_deg=30), rc.Task()
    number = 2 if form == "own cameras" else 1
    entries = {"scene": number, "poses": asked, "arrays": str(tmp_path)}
    found = ask(service, {"id": "x", "do": "evaluate", **entries})
    wanted = rc.evaluate(shapes.box(), camera, POSES, task)
    assert found["id"] == "x"
    assert found["result"]["covered_area"] == wanted.summary()["covered_area"]
    for name in ("area", "bound"):
        read = np.load(tmp_path / f"{name}.npy")
        assert read.tobytes() == getattr(wanted.covered, name).tobytes()
    whole = ask(service, {"do": "evaluate", "summary": True, **entries})["result"]
    plain = json.loads(json_bytes(wanted.summary()))
    for name in ("covered_area", "dead_zones", "per_pose", "not_covered_because"):
        assert whole[name] == plain[name]
    parts = rc.regions(shapes.box(), camera, POSES, task)
    sums = ask(service, {"do": "regions", **entries})["result"]
    assert sums["m2"] == parts.areas().sum(axis=1).tolist()
    assert np.array_equal(np.load(tmp_path / "points.npy"), parts.points())
    assert np.array_equal(np.load(tmp_path / "starts.npy"), parts.starts)


def test_place_and_check_answer_as_the_commands(service):
    placed = ask(service, {"do": "place"})["result"]
    wanted = rc.place(PLAN)
    assert placed["share"] == wanted.cameras.share
    assert placed["poses"]["world_from_camera"] == wanted.cameras.poses.tolist()
    checked = ask(service, {"do": "check", "poses": placed["poses"], "min_coverage": 0.2})["result"]
    poses = rc.Poses.of(wanted.cameras.poses)
    plain = json.loads(json_bytes(to_json(rc.check(PLAN, poses, min_coverage=0.2))))
    assert {**checked, "poses": ""} == {**plain, "poses": ""}
    assert checked["met"] is True


def test_results_by_face_have_their_summary_and_views(service, tmp_path):
    by_face = PLAN | {"task": {"by": "face"}}
    assert ask(service, {"do": "open", "plan": by_face})["result"]["scene"] == 2
    entries = {"scene": 2, "poses": POSES.tolist(), "arrays": str(tmp_path)}
    found = ask(service, {"do": "evaluate", **entries})["result"]
    assert found["by"] == "face"
    assert np.load(tmp_path / "views.npy").shape == (12,)


@pytest.mark.parametrize("by", ["area", "face"])
def test_groups_of_goals_are_not_of_the_task(service, tmp_path, by):
    target = '[[targets]]\nabove = "floor"\nheight = 1.6\nname = "heads"\n[goals.heads]\n'
    target += f'groups = ["heads"]\ncoverage = 0.1\n[task]\nby = "{by}"'
    path = plan_in(tmp_path, VIEWED.replace("[task]", target))
    poses = rc.look_at([(2.0, 1.5, 1.5), (3.5, 0.5, 2.5)], [(1.5, 4, 1.5), (0.0, 2.0, 1.5)])
    opened = ask(service, {"do": "open", "plan": str(path)})["result"]
    asked = {"scene": 2, "poses": poses.tolist()}
    written = {"arrays": str(tmp_path), "summary": True, **asked}
    found = ask(service, {"do": "evaluate", **written})["result"]
    checked = ask(service, {"do": "check", **asked})["result"]
    assert found["covered"] == checked["network"]["covered"]
    name = "views" if by == "face" else "area"
    assert np.load(tmp_path / f"{name}.npy").shape[-1] == opened["faces"]
    own = [each["name"] for each in found["groups"] if each["role"] != "occluder"]
    assert own == ["floor", "north"]
    if by == "area":
        both = found["covered_area"], checked["covered_area"]
        assert both[0]["m2"] == pytest.approx(both[1]["m2"])
        assert both[0]["of_m2"] == both[1]["of_m2"]
        bare = ask(service, {"do": "evaluate", **asked})["result"]["covered_area"]
        assert bare == both[0]
        single = ask(service, {"do": "regions", **asked})["result"]
        assert sum(single["m2"]) >= bare["m2"] >= max(single["m2"])


def test_scenes_have_numbers_of_their_own_and_close(service):
    assert ask(service, OPEN)["result"]["scene"] == 2
    assert ask(service, {"do": "close", "scene": 1})["result"] == {}
    assert ask(service, OPEN)["result"]["scene"] == 3
    for number in (0, 1, 4, -1):
        said = ask(service, {"id": 5, "do": "evaluate", "scene": number})
        line = f"scene: expected one that is open, [2, 3], got {number}; open it"
        assert said == {"id": 5, "error": [line]}


LINES = {
    b"": "expected valid JSON",
    b"nonsense": "expected valid JSON, got something else at line 1, column 1",
    b"[]": "expected a request in { }, got something else",
    b"3": "expected a request in { }",
    b'{"do": "open", "do": "open"}': "twice in one table",
    b'{"do": "fly"}': "do: expected 'open', 'evaluate'",
    b'{"do": "_scene"}': "do: expected",
    b'{"id": 1}': "do: expected",
    b'{"do": "evaluate", "pose": 3}': "pose: expected one of arrays, do, id,",
    b'{"do": "evaluate", "scene": 1.5}': "scene: expected a whole number, got 1.5",
    b'{"do": "open", "plan": 3}': "plan: expected a string in quotes or a table, got 3",
    b'{"do": "close", "id": []}': "id: expected a string in quotes or a whole number, got []",
    b'{"do": "evaluate", "poses": %a, "arrays": "no such"}' % np.eye(4).tolist(): (
        "arrays: expected a folder, got 'no such'; make it first"
    ),
    b'{"do": "evaluate", "scene": true}': "scene: expected",
    b'{"do": "evaluate", "poses": [[NaN]]}': "NaN is not JSON",
    b'{"do": "evaluate", "poses": [[Infinity]]}': "Infinity is not JSON",
    b'{"do": "evaluate", "poses": [[1e400]]}': "expected",
    b'{"do": "evaluate", "poses": [1, 2]}': "expected poses of shape (P, 4, 4), got (2,)",
    b'{"do": "evaluate", "poses": [["a"]]}': "expected",
    b'{"do": "evaluate", "poses": {"a": 1}}': "expected",
    b'{"do": "evaluate", "poses": "none.json"}': "none.json: no such file or directory",
    b'{"do": "open", "plan": "none.toml"}': "none.toml: no such file or directory",
    b'{"do": "open", "plan": {}}': "meshes: expected an entry, got none",
    b'{"do": "open", "plan": {"meshes": []}}': "meshes",
    b'{"do": "check", "poses": %a, "min_coverage": 2}' % np.eye(4).tolist(): "expected",
    b"[" * 5000 + b"]" * 5000: "nested too deeply",
    b"\xff\xfe": "save it as UTF-8",
    b'{"do": "\\ud800"}': "do: expected a string",
    b"\0": "expected valid JSON",
}


@pytest.mark.parametrize("line", LINES)
def test_a_hostile_line_has_one_answer_in_a_line_and_ends_nothing(
    service, line, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    answer = service.answer(line + b"\n")
    data = json_bytes(answer)
    assert b"\n" not in data
    (said, *_) = json.loads(data)["error"]
    assert LINES[line] in said
    assert "defect" not in said
    assert "Traceback" not in said
    assert "result" in ask(service, {"do": "evaluate", "poses": POSES[0].tolist()})


PIECES = st.sampled_from(
    [b'{"do": "evaluate", "poses": ', b'"open"', b"[", b"]", b"{", b"}", b",", b":", b"1e999",
     b'"', b"null", b"true", b'"plan"', b'"\\u0000"', b"\xc3", b"NaN", b'"id"', b"1", b'"do"']
)  # fmt: skip
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=12,
)
NAMES = st.sampled_from(["id", "scene", "plan", "poses", "arrays", "summary", "min_coverage", "x"])
REQUESTS = st.builds(
    lambda do, rest: json.dumps({"do": do, **rest}).encode(),
    st.sampled_from(["open", "evaluate", "regions", "check", "close", "place", "answer"]),
    st.dictionaries(NAMES, VALUES, max_size=3),
)


@examples(150)
@given(st.binary(max_size=40) | st.lists(PIECES, max_size=9).map(b"".join) | REQUESTS)
def test_random_lines_have_one_answer_each_and_name_no_defect(line):
    service = Service()
    answer = service.answer(line)
    data = json_bytes(answer)
    assert b"\n" not in data
    ANSWERS.validate(json.loads(data))
    assert "defect" not in str(answer.get("error"))


def test_lines_that_are_too_long_are_refused_whole(monkeypatch, capfdbinary):
    long = json.dumps({"id": 1, "do": "open", "plan": {"a": "x" * 500}}).encode()
    last = json.dumps({"id": 3, "do": "close"}).encode()  # without an end of line
    data = long * 7 + b"\n" + json.dumps({"id": 2, "do": "close"}).encode() + b"\n" + last
    answers = run(monkeypatch, capfdbinary, data, most=200)
    assert [each["id"] for each in answers] == [None, 2, 3]
    assert answers[0]["error"] == ["expected up to 200 bytes a line, got more; name files instead"]


def test_without_stdio_it_says_what_to_add(capsys, monkeypatch):
    wanted = "error: expected --stdio and an open standard input, got none; give both\n"
    assert call(capsys, "serve") == (2, "", wanted)
    monkeypatch.setattr(sys, "stdin", None)
    assert call(capsys, "serve --stdio") == (2, "", wanted)


def start(**options):
    return subprocess.Popen(
        [sys.executable, "-c", ENTRY, "serve", "--stdio"],
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, **options,
    )  # fmt: skip


def test_a_process_ends_with_its_input_or_its_reader():
    with start(stdout=subprocess.PIPE) as process:
        out, err = process.communicate(json.dumps(OPEN).encode() + b"\nx\n")
    assert (process.returncode, err) == (0, b"")
    assert [list(json.loads(line)) for line in out.splitlines()] == [
        ["id", "result"],
        ["id", "error"],
    ]
    reading, writing = os.pipe()
    with start(stdout=writing) as process:
        os.close(writing)
        os.close(reading)
        process.stdin.write(b"x\n" * 3)
        process.stdin.close()
        err = process.stderr.read()
    assert (process.returncode % 256 in (141, 256 - 13), err) == (True, b"")  # of SIGPIPE


def test_the_client_needs_python_3_9_alone():
    text = CLIENT.read_text(encoding="utf-8")
    ast.parse(text, feature_version=(3, 9))
    imported = {
        name.name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import)
        for name in node.names
    }
    assert imported <= sys.stdlib_module_names
    assert len(text.splitlines()) <= 70
    folder = Path(sys.executable).parent
    path = os.pathsep.join([str(folder), os.environ["PATH"]])
    plain = getattr(sys, "_base_executable", sys.executable)
    done = subprocess.run(
        [plain, "-I", "-S", "-W", "error", str(CLIENT)], check=False, text=True,
        capture_output=True, env=os.environ | {"PATH": path},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    percent = rc.evaluate(
        shapes.by_name("teapot-5"), rc.Camera.load("khepra"),
        np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.6], [0, 0, 0, 1.0]])[None],
    ).summary()["covered_area"]["percent"]  # fmt: skip
    assert done.stdout.startswith(f"{percent:.3f} % of ")
