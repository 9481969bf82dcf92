"""Pages that reports leave compute, with the figures of the report."""

import json
from pathlib import Path

import pytest
from browser import Tab

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.report import live
from rastercov.report.coverage import Options, run

WITHOUT = pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
pytestmark = [pytest.mark.slow, WITHOUT]
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
TELECENTRIC = rc.Camera.from_dict({"model": "telecentric", "width": 640, "height": 480, "fx": 90.0})
MESH = shapes.torus(24, 12)
POSES = rc.sphere_of_poses((0, 0, 0), 5.0, 4)
PLAN = {
    "meshes": [{"built_in": "room"}],
    "camera": {"width": 320, "height": 240, "hfov_deg": 90},
    "task": {"max_incidence_deg": 80, "views": {"crates": 2}},
    "candidates": [{"generator": "on_walls", "spacing": 2.0, "heights": [2.2]}],
    "selection": {"goal": "best_coverage", "cameras": 3},
}
TOML = """
meshes = [{ built_in = "room" }]
task = { max_incidence_deg = 80, views = { crates = 2 } }
"""


def edited(page):
    """Area before and after a camera is moved in a page, and after it is moved back."""
    before = page.js("rastercov.summary().covered_area")
    pose = page.pose()
    pose[:3, 3] += 0.1 * pose[:3, 2]
    page.js("pose => rastercov.session.act({do: 'pose', station: 0, pose})", pose.ravel().tolist())
    page.idle()
    moved = page.js("rastercov.summary().covered_area")
    page.js("rastercov.session.act({do: 'undo'})")
    page.idle()
    assert page.js("rastercov.summary().covered_area") == before
    assert page.faults == []
    return before, moved


def assert_near(result, expected, factor=1 + 1e-9):
    """Areas to the last digit; bounds nearly, those of `evaluate` within a factor."""
    assert result["m2"] == expected["m2"]
    assert result["percent"] == expected["percent"]
    assert expected["bound_m2"] / factor <= result["bound_m2"] <= expected["bound_m2"] * factor


def test_a_report_of_evaluate_opens_a_page_that_computes(context, tmp_path):
    task = rc.Task(max_incidence_deg=70)
    told = run(MESH, CAMERA, POSES, task, tmp_path, Options(pictures=1))
    page = Tab(context, (tmp_path / "view.html").as_uri())
    before, moved = edited(page)
    assert_near(before, told["covered_area"], 3)
    assert moved["m2"] != before["m2"]
    own = page.js("rastercov.summary().by_camera.map(each => each.alone_percent)")
    assert len(own) == len(POSES)
    report = context.new_page()
    report.goto((tmp_path / "report.html").as_uri())
    report.locator("details.scene summary").click()
    frame = report.frame_locator("details.scene iframe")
    share = f"{told['covered_area']['percent']:.1f} %"
    frame.locator(".summary .covered", has_text=share).wait_for(state="attached")
    assert frame.get_by_role("button", name="Undo").count() == 1


def test_place_and_check_leave_pages_that_compute(context, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plan.toml").write_text(TOML)
    rc.place(PLAN, out="placed")
    told = json.loads(Path("placed/plan.json").read_text())
    page = Tab(context, Path("placed/view.html").resolve().as_uri())
    placed = edited(page)[0]["m2"]  # whose cameras were added in another order
    assert placed == pytest.approx(told["covered_area"]["m2"], rel=1e-12)
    rc.check(PLAN, "placed/poses.json", min_coverage=0.1, out="checked")
    assert "view.html" in Path("checked/check.html").read_text() or "data-scene" in (
        Path("checked/check.html").read_text()
    )
    other = Tab(context, Path("checked/view.html").resolve().as_uri())
    told = json.loads(Path("checked/check.json").read_text())
    assert_near(other.js("rastercov.summary().covered_area"), told["covered_area"])


@pytest.mark.parametrize("views", [1, {"*": 2}, {"crates": 3}])
def test_pages_of_a_plan_with_goals_judge_them(context, tmp_path, monkeypatch, views):
    monkeypatch.chdir(tmp_path)
    crates = {"groups": ["crates"], "coverage": 0.2, "min_facing_density": 60.0}
    asked = {"selection": {"goal": "fewest_cameras", "coverage": 0.3}, "task": {"views": views}}
    plan = PLAN | asked | {"goals": {"crates": crates}}
    placed = rc.place(plan, out="placed")
    checked = rc.check(plan, "placed/poses.json", out="checked")
    for folder, item in (("placed", placed), ("checked", checked)):
        page = Tab(context, Path(folder, "view.html").resolve().as_uri())
        told = [each.words() for each in item.requirements]
        assert page.js("rastercov.summary().required.map(each => each.words)") == told
        assert len(told) == 2
        edited(page)


def test_an_audit_leaves_a_page_that_computes_beside_its_weak_zones(context, tmp_path):
    rc.audit(MESH, CAMERA, POSES, rc.Task(max_incidence_deg=70), out=tmp_path)
    told = json.loads((tmp_path / "audit.json").read_text())
    page = Tab(context, (tmp_path / "view.html").as_uri())
    assert_near(edited(page)[0], told["network"]["covered_area"], 3)
    assert "id=&quot;export" in (text := (tmp_path / "audit.html").read_text()) or (
        'id="export"' in text
    )


@pytest.mark.parametrize(
    ("rig", "task", "why"),
    [
        (rc.Rig([CAMERA])._equip("lamps", rc.Lamps([rc.Lamp.point(1)])), rc.Task(), "lamps"),
        (CAMERA, rc.Task(min_angle_deg=10), "angles between views"),
        (TELECENTRIC, rc.Task(), "telecentric lenses"),
        (CAMERA, rc.Task(min_visibility=0.5), "results by face"),
    ],
)
def test_what_a_page_cannot_compute_is_recorded(rig, task, why, tmp_path):
    others = {"results by face": task.min_visibility > 0}
    assert live.record_cause(MESH, rig, 4, task, others).endswith(f"cannot recompute {why}")
    if why == "results by face":
        run(MESH, rig, POSES, task, tmp_path, Options(pictures=1))
        text = (tmp_path / "view.html").read_text()
        assert 'id="export"' in text
        assert '"notes": ["the page shows static results: it cannot recompute results' in text


def test_a_page_of_too_many_pairs_is_recorded_with_its_number():
    said = live.record_cause(MESH, CAMERA, 4000, rc.Task(), {})
    assert f"{4000 * MESH.n_faces:,} pairs" in said
