"""`view` of a result needs none of the options that the result was made with."""

import json
import re
import shutil
from contextlib import closing
from pathlib import Path

import pytest
from browser import Tab
from commands import answer, done, enter, refusal
from edited import Saving, Session
from rigs_to_view import CAMERA, acted, around, part

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.page.scene import open_result

SCENES = {
    "plain": "part.stl",
    "unit": "parts/part.stl --unit mm",
    "transform": "part.stl --transform 'axis = [1, 0, 0], angle_deg = 90'",
    "occluder": "part.stl --occluder parts/wall.stl",
    "all": "parts/part.stl floor.stl --unit mm --unit floor.stl:m --occluder parts/wall.stl"
    " --transform 'parts/part.stl:translation = [0, 0, 0.01]' --transform 'wall:scale = 2'"
    " --target floor --two-sided all",
    "built in": "teapot-5 --transform 'angle_deg = 30'",
}


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A working folder with meshes, a camera and poses."""
    made = tmp_path / "project"
    (made / "parts").mkdir(parents=True)
    wall, floor = part().moved(translation=(0.5, 0, 0)), shapes.box((1, 1, 0.1))
    meshes = {"part": part(), "parts/part": part(), "parts/wall": wall, "floor": floor}
    for name, mesh in meshes.items():
        mesh.to_trimesh().export(made / f"{name}.stl")
    views = rc.Views(rc.Rig([CAMERA], ["eye"]), rc.Poses.of(around(part())), tuple("abcd"))
    rc.write_views(made / "rig.json", views)
    enter(made, monkeypatch)
    return made


def made_report(capsys, name):
    """Faces that a report of a scene covers."""
    own = "-p rig.json --pictures 0 --by face -o report"
    return answer(capsys, f"evaluate {SCENES[name]} {own}")["covered"]


def line_of(capsys, report, *more):
    return ["view", str(report), *map(str, more), "--export", "page.html", "--still"]


def seen(capsys, report, *more):
    """Percent of the area that the page of a report shows."""
    done(capsys, line_of(capsys, report, *more))
    page = Path("page.html").read_text("utf-8")
    data = page.partition('id="export">')[2].partition("</script>")[0]
    return json.loads(data)["frames"]["reason"]["summary"]["covered"]


def refused(capsys, report, *more):
    return refusal(capsys, line_of(capsys, report, *more))


@pytest.mark.parametrize("name", SCENES)
def test_a_result_is_opened_without_its_options(room, name, capsys, monkeypatch, tmp_path):
    """From the working folder of the run, and from another one."""
    covered = made_report(capsys, name)
    assert seen(capsys, "report") == covered
    monkeypatch.chdir(tmp_path)
    assert seen(capsys, room / "report") == covered


def test_a_project_may_move(room, capsys, monkeypatch, tmp_path):
    covered = made_report(capsys, "all")
    monkeypatch.chdir(tmp_path)
    room.rename(tmp_path / "moved")
    assert seen(capsys, "moved/report") == covered


def test_a_report_may_move_away_from_its_meshes(room, capsys, monkeypatch, tmp_path):
    """They are found in the working folder, or named after the report."""
    covered = made_report(capsys, "transform")
    assert "expected the mesh of report" in refused(capsys, "report", "--unit", "mm")
    away = tmp_path / "a" / "b"
    away.mkdir(parents=True)
    shutil.move(room / "report", away / "report")
    assert seen(capsys, away / "report") == covered
    monkeypatch.chdir(away)
    assert re.search(r"part\.stl.*list it after the result folder", refused(capsys, "report"))
    shutil.copy(room / "part.stl", away / "renamed.stl")
    for mesh in (room / "part.stl", "renamed.stl"):
        assert seen(capsys, "report", mesh) == covered


def test_a_mesh_that_has_changed_is_named(room, capsys):
    made_report(capsys, "occluder")
    shapes.box((1, 1, 1)).to_trimesh().export(room / "parts" / "wall.stl")
    assert "expected the mesh of report, part.stl, wall.stl, got another" in refused(
        capsys, "report"
    )
    (room / "parts" / "wall.stl").unlink()
    assert "expected mesh file parts/wall.stl of report" in refused(capsys, "report")
    (room / "parts" / "wall.stl").write_text("nonsense")
    assert "wall.stl" in refused(capsys, "report")


@pytest.mark.parametrize(
    "arguments", [None, [], {}, {"meshes": 1}, {"folder": "..", "meshes": ["x.stl"]}]
)
def test_a_result_without_its_arguments_is_opened_by_the_names_of_its_meshes(
    room, capsys, arguments
):
    """One of an earlier version, or with an entry that is damaged."""
    made_report(capsys, "plain")
    path = room / "report" / "summary.json"
    summary = json.loads(path.read_text())
    for options in (summary["run"]["options"] | {"scene": arguments}, None):
        summary["run"]["options"] = options
        if options is None:
            del summary["run"]["options"]
        path.write_text(json.dumps(summary))
        assert seen(capsys, "report") == summary["covered"]


def test_an_audit_without_a_scale_is_in_units(room, capsys):
    rig = json.loads((room / "rig.json").read_text())
    (room / "rig.json").write_text(json.dumps(rig | {"has_unit": False}))
    done(capsys, "audit rig.json part.stl -o audit")
    scene = open_result(Path("audit"), lambda names: (rc.Mesh.load(names, unit="m"), {}))
    with closing(Session(scene)) as session:
        acted(session, do="task", changes={"min_pixel_density": 1e5})
        said = [session.why(face) for face in range(0, scene.mesh.n_faces, 7)]
        head, _ = acted(session, "density")
        saved = Saving(session, room).content("rig")
    assert "units²" in said[0]["words"]
    texts = json.dumps([scene.describe()["modes"], head["scale"], said])
    assert re.findall(r"[0-9] ?(m|mm|cm)²?\b|px/m", texts) == []
    assert "px/unit" in texts
    assert json.loads(saved)["has_unit"] is False


def test_an_audit_is_opened_without_its_options(room, capsys):
    done(capsys, f"audit rig.json {SCENES['all']} -o audit")
    assert seen(capsys, "audit")["faces"] >= 0


@pytest.mark.parametrize(
    "change",
    [
        lambda run: run.update(mesh=[{}]),
        lambda run: run.update(mesh=3),
        lambda run: run["scene"].update(groups=[1.5]),
        lambda run: run.update(scene=[]),
        lambda run: run.update(task=0.5),
    ],
    ids=range(5),
)
def test_entries_that_no_command_wrote_are_refused_in_one_line(change, room, capsys):
    made_report(capsys, "plain")
    path = Path("report", "summary.json")
    content = json.loads(path.read_text())
    change(content["run"])
    path.write_text(json.dumps(content))
    said = refusal(capsys, line_of(capsys, "report"))
    assert "report" in said
    assert "defect" not in said
    assert not Path("page.html").exists()


@pytest.mark.slow
def test_a_page_of_sunlight_has_no_figures_of_cameras_and_no_fault(context, capsys, room):
    done(capsys, "sun parts/part.stl --latitude 49 --longitude 8 --day 2026-06-21 --step 60")
    page = Tab(context, Path("sun/view.html").resolve().as_uri())
    assert page.page.get_by_role("alert").all_inner_texts() == []
    assert not page.page.locator(".summary").is_visible()
    assert page.page.title() == "Sunlight, 2026-06-21 – rastercov"
