"""`evaluate`, `place`, `check` and `audit` as functions: results of the commands, and no files."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import call, enter, write_part
from test_golden import differences

import rastercov as rc
from rastercov.core.camera.rig import equipment_words
from rastercov.core.coverage.coverage import FIGURES, ExactObserver
from rastercov.report import plan as report
from rastercov.report.coverage import Options, run

CAMERA = {"width": 96, "height": 72, "fx": 90, "fy": 90}
TOML = """
meshes = [{ path = "part.obj" }]
camera = { width = 96, height = 72, fx = 90, fy = 90 }
task = { min_pixels_per_m2 = 100 }
candidates = [{ generator = "on_sphere", count = 20, distances = [3.5] }]
selection = { goal = "fewest_cameras", coverage = 0.9 }
"""
PLAN = tomllib.loads(TOML)
NAMED = PLAN | {"candidates": [PLAN["candidates"][0] | {"cameras": ["camera"]}]}
POSES = rc.sphere_of_poses((0, 0, 0), 3.5, 6)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with a part and nothing else."""
    enter(tmp_path, monkeypatch)
    write_part("part.obj")
    return tmp_path


def files():
    return {path.name for path in Path().rglob("*")}


def written(name):
    """Content of a file of the command and of the function."""
    return [json.loads(Path(where, name).read_text()) for where in ("command", "function")]


def as_stored(figures):
    return json.loads(json.dumps(figures, default=lambda value: np.asarray(value).tolist()))


@pytest.mark.slow
def test_place_writes_nothing_and_finds_what_the_command_finds(capsys):
    placed = rc.place(PLAN)
    assert placed.is_met
    assert files() == {"part.obj"}
    Path("plan.toml").write_text(TOML)
    code, _, err = call(capsys, "place plan.toml -o command --json")
    assert code == 0, err
    rc.place("plan.toml", out="function")
    command, function = written("plan.json")
    assert command.pop("seconds").keys() == function.pop("seconds").keys()
    assert command == function
    assert as_stored(report.summary(placed)["cameras"]) == function["cameras"]
    assert files() >= {"poses.json", "page.html", "plan.json"}


RIG = rc.Rig([rc.Camera(**CAMERA), rc.Camera(**CAMERA | {"fx": 60, "fy": 60})], ["long", "wide"])
PLACED = {
    "one": (RIG.cameras[0], POSES),
    "two": (RIG, rc.Poses.of(POSES, camera=[0, 1, 0, 1, 0, 1])),
}


@pytest.mark.parametrize("placed", PLACED)
@pytest.mark.parametrize("by", ["area", "face"])
@pytest.mark.parametrize("fields", [None, (), ["visibility"]])
def test_evaluate_is_the_command(placed, by, fields, folder):
    mesh, task = rc.Mesh.load("part.obj"), rc.Task(max_incidence_deg=70, views=2)
    camera, poses = PLACED[placed]
    result = rc.evaluate(mesh, camera, poses, task, by=by, fields=fields)
    assert files() == {"part.obj"}
    written = as_stored(run(mesh, camera, poses, task, folder / "out", Options(by=by, pictures=0)))
    summary = as_stored(result.summary())
    assert written["by"] == summary["by"] == by
    assert list(differences(*map(without_run_times, (written, summary)))) == []
    coverage = rc.evaluate(mesh, camera, poses, task, by="face")
    for name in FIGURES if fields is None else fields:
        np.testing.assert_array_equal(getattr(result, name), getattr(coverage, name))
    if by == "area":
        exact = rc.unite(rc.regions(mesh, camera, poses, task), 2)
        np.testing.assert_allclose(result.covered.area, exact.area, atol=1e-9)
    else:
        with pytest.raises(rc.ConfigError, match='give by="area"'):
            _ = result.covered


def without_run_times(summary):
    """A summary without times, and without options and files, which a function does not have."""
    summary = summary | {"run": summary["run"] | {"options": None}}
    return {
        name: value
        for name, value in summary.items()
        if name not in ("seconds", "poses_per_second", "table")
    }


def test_evaluate_says_why_it_is_by_face():
    mesh, camera = rc.Mesh.load("part.obj"), RIG.cameras[0]
    assert rc.evaluate(mesh, camera, POSES).by == "area"
    result = rc.evaluate(mesh, camera, POSES, rc.Task(min_pixels=3))
    assert result.by == "face"
    assert "min_pixels applies to faces" in result.summary()["by_face_because"]


def test_an_interrupt_is_raised_by_the_function(monkeypatch):
    def stop(observer, poses):
        raise KeyboardInterrupt

    monkeypatch.setattr(ExactObserver, "_measure", stop)
    with pytest.raises(KeyboardInterrupt):
        rc.evaluate(rc.Mesh.load("part.obj"), RIG.cameras[0], POSES, by="face")


def test_place_takes_other_cameras():
    wide = rc.Camera(width=96, height=72, fx=60, fy=60)
    placed = rc.place(PLAN, camera=wide)
    own = rc.place(PLAN | {"camera": {**CAMERA, "fx": 60, "fy": 60}})
    np.testing.assert_array_equal(placed.cameras.poses, own.cameras.poses)
    assert placed.prepared.camera.cameras == (wide,)


def test_check_takes_poses_of_any_kind(capsys):
    checked = rc.check(PLAN, POSES)
    rc.write_poses("rig.json", POSES)
    Path("plan.toml").write_text(TOML)
    code, out, _ = call(capsys, "check plan.toml -p rig.json --json")
    command = json.loads(out)
    assert checked.is_met == command["met"] == (code == 0)
    for each, said in zip(checked.requirements, command["requirements"], strict=True):
        assert as_stored(vars(each)).items() <= said.items()
    for poses in (rc.Poses.of(POSES), rc.read_views("rig.json"), "rig.json", Path("rig.json")):
        assert rc.check("plan.toml", poses).requirements == checked.requirements
    assert files() == {"part.obj", "plan.toml", "rig.json"}


def test_check_replaces_what_is_wanted():
    assert rc.check(PLAN, POSES, min_coverage=0.1).is_met
    assert not rc.check(PLAN, POSES[:1], min_coverage=0.9).is_met
    check_result = rc.check(PLAN, POSES, groups={"lid": 0.2}, views=3)
    assert [(each.group, each.limit) for each in check_result.requirements] == [
        (None, 0.9),
        ("lid", 0.2),
    ]
    assert check_result.views == 3


def test_check_holds_a_rig_against_the_baseline_that_it_wrote(capsys):
    check_result = rc.check(NAMED, POSES, out="base")
    assert {"check.html", "check.json"} < files()
    worse = rc.check(PLAN, POSES[:2], min_coverage=0.1, baseline="base/check.json")
    assert (check_result.is_met, worse.is_met) == (True, False)
    Path("plan.toml").write_text(TOML)
    rc.write_poses("rig.json", POSES[:2])
    line = "check plan.toml -p rig.json --min-coverage 0.1 --baseline base/check.json --json"
    code, out, _ = call(capsys, line)
    assert code == 1
    assert json.loads(out)["baseline"] == as_stored(worse.against.to_json())


def test_check_takes_several_cameras():
    wide, long = (rc.Camera(width=96, height=72, fx=f, fy=f) for f in (60, 120))
    index = [0, 1, 0, 1, 0, 1]
    poses = rc.Poses.of(POSES, camera=index)
    rig = rc.Rig([wide, long], ["wide", "long"])
    check_result = rc.check(PLAN, poses, camera=rig)
    views = rc.Views(rig=rig, poses=poses, images=tuple("abcdef"))
    bare = {name: value for name, value in PLAN.items() if name != "camera"}
    for other in (rc.check(PLAN, poses, camera=[wide, long]), rc.check(bare, views)):
        assert other.requirements == check_result.requirements
    areas = {
        entry["camera"]: entry["covered_area"] for entry in check_result.summary()["by_camera"]
    }
    areas["all"] = check_result.cameras.areas.summary()
    rows = {"wide": poses.camera == 0, "long": poses.camera == 1, "all": poses.camera >= 0}
    for name, area in areas.items():
        exact = rc.unite(rc.regions(check_result.mesh, rig, poses[rows[name]], check_result.task))
        assert area["m2"] == pytest.approx(exact.area[0].sum(), abs=1e-9)


@pytest.mark.slow
def test_audit_is_the_command(capsys):
    mesh, camera, frames = rc.Mesh.load("part.obj"), RIG.cameras[0], list("aabbcc")
    audit = rc.audit(mesh, camera, POSES, rc.Task(views=2))
    assert files() == {"part.obj"}
    rig, poses = rc.Rig([camera], ["one"]), rc.Poses.of(POSES)
    views = rc.Views(rig=rig, poses=poses, images=tuple("uvwxyz"), frames=frames)
    named = rc.audit(mesh, views, task=rc.Task(views=2), suggest=2, out="function")
    assert named.names == tuple("uvwxyz")
    assert named.suggested.names == ()  # nothing is weak
    assert rc.audit(mesh, WITHOUT_UNIT).summary()["unit"] == "unit"
    rc.write_views("views.json", views)
    code, _, err = call(capsys, "audit views.json part.obj --views 2 --suggest 2 -o command")
    assert code == 0, err
    command, function = written("audit.json")
    for each in (command, function):
        del each["subset"]["seconds"], each["run"]["mesh"], each["frames"]["subset"]["seconds"]
        each["run"]["options"].pop("scene", None)  # the words of the command
    assert command == function
    assert as_stored(audit.summary())["covered_percent"] == function["covered_percent"]
    assert [entry["frame"] for entry in function["frames"]["per_frame"]] == list("abc")
    assert "All 3 frames are needed." in Path("function", "audit.html").read_text()
    assert pq.read_table("function/cameras.parquet")["frame"].to_pylist() == frames


@pytest.mark.parametrize(
    ("name", "instead"),
    [
        ("workers", r"give shards=\(FOLDER, workers\)"),
        ("threads", r"give method=Engine\(METHOD, threads=N\)"),
        ("skip_bad_poses", r"give Poses.of\(poses, skip_bad=True\)"),
        ("light", "correct the name"),
    ],
)
def test_an_argument_that_is_not_there_is_named_with_what_is(name, instead):
    known = ", ".join(["motion", *equipment_words()])
    with pytest.raises(
        rc.ConfigError, match=f"^expected further arguments {known}, got '{name}'; {instead}$"
    ):
        evaluated(**{name: 1})()


def evaluated(**options):
    return lambda: rc.evaluate(rc.Mesh.load("part.obj"), RIG.cameras[0], POSES, **options)


WITHOUT_UNIT = rc.Views(
    rig=rc.Rig([RIG.cameras[0]], ["one"]), poses=rc.Poses.of(POSES), images=tuple("abcdef"),
    has_unit=False,
)  # fmt: skip


@pytest.mark.parametrize(
    ("job", "words"),
    [
        (evaluated(method="sampled", by="area"), "method sampled counts whole faces"),
        (evaluated(by="mesh"), "expected 'by' to be area or face, got 'mesh'"),
        (
            lambda: rc.check(PLAN, rc.Poses.of(POSES, camera=1)),
            "expected camera indices below 1, got 1 for pose 0",
        ),
        (lambda: rc.check(PLAN, WITHOUT_UNIT), "expected poses with a unit, got none"),
        (
            lambda: rc.audit(rc.Mesh.load("part.obj"), WITHOUT_UNIT, suggest=0),
            "expected 1 image or more",
        ),
        (lambda: rc.place({}), "plan: meshes: expected an entry, got none; add it"),
        (lambda: rc.place("gone.toml"), "gone.toml"),
        (lambda: rc.place(3), "plan to be a plan file, a mapping or a Plan, got 3"),
        (lambda: rc.place({**PLAN, "camera": None}), "camera: expected an entry"),
        (lambda: rc.place(PLAN, camera="khepra"), "camera to be a Camera"),
        (
            lambda: rc.place(NAMED, camera=rc.Rig([rc.Camera(**CAMERA)], ["other"])),
            r"candidates\[0\]: expected a camera \(other\), got 'camera'",
        ),
        (lambda: rc.check(PLAN, "gone.json"), "gone.json"),
        (lambda: rc.check(PLAN, POSES, baseline="part.obj"), "part.obj: "),
        (lambda: rc.check(PLAN, [[1, 2]]), r"expected poses of shape \(P, 4, 4\), got \(1, 1, 2\)"),
        (
            lambda: rc.check(PLAN, POSES, groups={"door": 0.5}),
            r"expected a mesh file or a group, got 'door'",
        ),
        (
            lambda: rc.check(PLAN, POSES, groups={"lid": 2}),
            "groups: expected a share from 0 to 1, got 'lid=2",
        ),
        (lambda: rc.audit(rc.Mesh.load("part.obj"), rc.Camera(**CAMERA)), "expected poses, got"),
        (lambda: rc.audit("part.obj", rc.Camera(**CAMERA), POSES), "mesh to be a Mesh"),
    ],
)
def test_wrong_arguments_are_one_line(job, words):
    with pytest.raises(rc.RastercovError, match=words) as error:
        job()
    assert "\n" not in str(error.value)
