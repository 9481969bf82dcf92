"""`view` of a result needs none of the options that the result was made with."""

import json
import shutil
from pathlib import Path

import pytest
from commands import call, enter, refusal
from rigs_to_view import CAMERA, around, part

import rastercov as rc
from rastercov import cli
from rastercov.mesh import shapes

SCENES = {
    "plain": (["part.stl"], []),
    "unit": (["parts/part.stl"], ["--unit", "mm"]),
    "transform": (["part.stl"], ["--transform", "axis = [1, 0, 0], angle_deg = 90"]),
    "occluder": (["part.stl"], ["--occluder", "parts/wall.stl"]),
    "all": (
        ["parts/part.stl", "floor.stl"],
        [
            *("--unit", "mm", "--unit", "floor.stl:m", "--occluder", "parts/wall.stl"),
            *("--transform", "parts/part.stl:translation = [0, 0, 0.01]"),
            *("--transform", "wall:scale = 2", "--target", "floor", "--two-sided", "all"),
        ],
    ),
    "built in": (["teapot-5"], ["--transform", "angle_deg = 30"]),
}


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A working folder with meshes, a camera and poses."""
    made = tmp_path / "project"
    (made / "parts").mkdir(parents=True)
    part().to_trimesh().export(made / "part.stl")
    part().to_trimesh().export(made / "parts" / "part.stl")
    part().moved(translation=(0.5, 0, 0)).to_trimesh().export(made / "parts" / "wall.stl")
    shapes.box((1, 1, 0.1)).to_trimesh().export(made / "floor.stl")
    rc.write_poses(made / "rig.json", around(part()))
    CAMERA.save(made / "camera.json")
    enter(made, monkeypatch)
    return made


def made_report(meshes, options, out="report"):
    own = ["-c", "camera.json", "-p", "rig.json", "--pictures", "0", "--by", "face", "-o", out]
    assert cli.command(["evaluate", *meshes, *options, *own]) == 0


def line_of(capsys, report, *more):
    capsys.readouterr()
    return ["view", str(report), *map(str, more), "--export", "page.html"]


def seen(capsys, report, *more):
    """Percent of the area that the page of a report shows."""
    code, _, err = call(capsys, line_of(capsys, report, *more))
    assert code == 0, err
    page = Path("page.html").read_text("utf-8")
    data = page.partition('id="export">')[2].partition("</script>")[0]
    return json.loads(data)["frames"]["reason"]["summary"]["covered"]


def refused(capsys, report, *more):
    return refusal(capsys, line_of(capsys, report, *more))


@pytest.mark.parametrize("name", SCENES)
def test_a_result_is_opened_without_its_options(room, name, capsys, monkeypatch, tmp_path):
    """From the working folder of the run, and from another one."""
    made_report(*SCENES[name])
    covered = json.loads((room / "report" / "summary.json").read_text())["covered"]
    assert seen(capsys, "report") == covered
    other = tmp_path / "elsewhere"
    other.mkdir()
    monkeypatch.chdir(other)
    assert seen(capsys, room / "report") == covered


def test_a_project_may_move(room, capsys, monkeypatch, tmp_path):
    made_report(*SCENES["all"])
    covered = json.loads((room / "report" / "summary.json").read_text())["covered"]
    monkeypatch.chdir(tmp_path)
    room.rename(tmp_path / "moved")
    assert seen(capsys, "moved/report") == covered


def test_a_report_may_move_away_from_its_meshes(room, capsys, monkeypatch, tmp_path):
    """They are found in the working folder, or named after the report."""
    made_report(*SCENES["transform"])
    covered = json.loads((room / "report" / "summary.json").read_text())["covered"]
    assert "the mesh is not that of report" in refused(capsys, "report", "--unit", "mm")
    away = tmp_path / "a" / "b"
    away.mkdir(parents=True)
    shutil.move(room / "report", away / "report")
    assert seen(capsys, away / "report") == covered
    monkeypatch.chdir(away)
    err = refused(capsys, "report")
    assert "part.stl" in err
    assert "name it after the folder" in err
    shutil.copy(room / "part.stl", away / "renamed.stl")
    assert seen(capsys, "report", room / "part.stl") == covered
    assert seen(capsys, "report", "renamed.stl") == covered


def test_a_mesh_that_has_changed_is_named(room, capsys):
    made_report(*SCENES["occluder"])
    shapes.box((1, 1, 1)).to_trimesh().export(room / "parts" / "wall.stl")
    err = refused(capsys, "report")
    assert "wall.stl is not the file that report was made of" in err
    (room / "parts" / "wall.stl").unlink()
    assert "parts/wall.stl of report is neither where it was nor near" in refused(capsys, "report")
    (room / "parts" / "wall.stl").write_text("nonsense")
    assert "wall.stl" in refused(capsys, "report")


@pytest.mark.parametrize(
    "arguments", [None, [], {}, {"meshes": 1}, {"folder": "..", "meshes": ["x.stl"]}]
)
def test_a_result_without_its_arguments_is_opened_by_the_names_of_its_meshes(
    room, capsys, arguments
):
    """One of an earlier version, or with an entry that is damaged."""
    made_report(*SCENES["plain"])
    path = room / "report" / "summary.json"
    summary = json.loads(path.read_text())
    summary["run"]["options"]["scene"] = arguments
    path.write_text(json.dumps(summary))
    assert seen(capsys, "report") == summary["covered"]
    del summary["run"]["options"]
    path.write_text(json.dumps(summary))
    assert seen(capsys, "report") == summary["covered"]


def test_an_audit_is_opened_without_its_options(room, capsys):
    meshes, options = SCENES["all"]
    views = rc.Views(rc.Rig([CAMERA], ["eye"]), rc.Poses.of(around(part())), tuple("abcd"))
    rc.write_views(room / "views.json", views)
    line = ["audit", "views.json", *meshes, *options, "-o", "audit"]
    assert cli.command(line) == 0
    assert seen(capsys, "audit")["faces"] >= 0
