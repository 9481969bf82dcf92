"""Results in notebooks: a table and a picture, the page of the command in a frame, and tables."""

import json
import re
import sys
import tempfile
from html import unescape
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from browser import CHROMIUM, chromium
from pages import Page, read_alone
from test_pages import BALL, CAMERA, plan

import rastercov as rc
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.report import notebook

NAMES = ("faces", "cameras", "zones", "groups")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A result of every kind, one part of which has a name to escape, and the folder of reports."""
    out = tmp_path_factory.mktemp("out")
    goal = {"goal": "best_coverage", "cameras": 4}
    asked = plan(out, task={"max_incidence_deg": 70}, selection=goal)
    asked["meshes"][1].pop("role")
    mesh = rc.Mesh.load([each["path"] for each in asked["meshes"]])
    scene = mesh, CAMERA, rc.sphere_of_poses((0, 0, 0), 4.0, 7), rc.Task(max_incidence_deg=70)
    placed, result = rc.place(asked, out=out / "place"), rc.evaluate(*scene, by="face")
    with rc.open_observer(mesh, CAMERA) as observer:
        batch = next(evaluate_batches(observer, *scene[2:]))
    return {
        "mesh": mesh, "batch": batch, "network": result.network, "face": result, "out": out,
        "area": rc.evaluate(*scene, by="area", fields=()), "place": placed,
        "check": rc.check(asked, placed.cameras.poses, min_coverage=0.99),
        "audit": rc.audit(*scene, out=out / "audit"),
    }  # fmt: skip


def without_pictures(page):
    return re.sub("base64,[A-Za-z0-9+/=]*", "", page)


@pytest.mark.parametrize(
    "kind", ["mesh", "batch", "network", "face", "area", "place", "check", "audit"]
)
def test_a_value_has_its_figures_and_one_picture(results, kind):
    shown = Page()
    shown.feed(results[kind]._repr_html_())
    assert [load[:22] for load in shown.loads] == ["data:image/png;base64,"]
    assert shown.open == []
    assert BALL in shown.words
    if kind not in ("mesh", "batch", "network"):
        assert notebook.network_of(results[kind]).answer in shown.words
    assert any("✗" in word for word in shown.words) == (kind == "check")


def test_what_cannot_be_drawn_has_its_text_alone(results, monkeypatch):
    monkeypatch.setattr(notebook, "html_of", lambda value: 1 / 0)
    assert results["face"]._repr_html_() is None


def test_a_notebook_shows_the_page_of_the_command_and_others_get_a_file(
    results, tmp_path, monkeypatch, capsys
):
    page = (results["out"] / "place" / "page.html").read_text(encoding="utf-8")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    shown = rc.show(results["place"])
    assert capsys.readouterr().out == f"wrote {shown.path}\n"
    assert shown.html == shown.path.read_text(encoding="utf-8")
    page = page.replace(" All results are in plan.json.", "")
    assert without_pictures(shown.html) == without_pictures(page)
    assert shown.path.is_relative_to(tmp_path)
    assert opened == []
    rc.show(results["check"], tmp_path / "own.html", open_browser=True)
    assert opened == [(tmp_path / "own.html").as_uri()]
    kernel = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=1))
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    for kind in ("face", "area", "place", "check", "audit"):
        show = rc.show(results[kind], height=321)
        assert show.path is None
        frame = show._repr_html_()
        assert 'height="321"' in frame
        assert "allow-same-origin" not in frame
        page = read_alone(unescape(re.search('srcdoc="([^"]*)"', frame)[1]))
        assert notebook.network_of(results[kind]).answer in " ".join(page.words)


@pytest.mark.matter("page")
@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium and Playwright")
def test_the_scene_opens_inside_the_frame(results, tmp_path):
    frame = rc.show(results["area"], tmp_path / "page.html")._repr_html_()
    (tmp_path / "cell.html").write_text(f"<!DOCTYPE html><body>{frame}", encoding="utf-8")
    with chromium() as browser:
        page, errors = browser.new_page(bypass_csp=True), []
        page.on("pageerror", lambda error: errors.append(error))
        page.goto((tmp_path / "cell.html").as_uri())
        inside = page.frame_locator("iframe")
        inside.locator("details.scene summary").click()
        inside.frame_locator("iframe").get_by_text("camera 6").first.wait_for(state="attached")
        assert errors == []


@pytest.mark.parametrize("method", ["sampled", "exact"])
def test_areas_of_cameras_are_there_by_every_method(method):
    """Figures of samples are derived when they are read."""
    mesh, camera = rc.shapes.box(), rc.Camera(width=160, height=120, fx=150, fy=150)
    poses = rc.look_at([(3, 0, 0), (0, 3, 1)], (0, 0, 0))
    value = rc.evaluate(mesh, camera, poses, method=method, by="face")
    cameras = rc.table(value, "cameras").to_pydict()
    covered = value.reason == rc.Reason.COVERED
    assert cameras["covered_m2"] == pytest.approx((covered * mesh.areas).sum(axis=1).tolist())


@pytest.mark.parametrize("kind", ["face", "area", "place", "check"])
def test_tables_add_up_to_the_summary(results, kind):
    value = results[kind]
    faces, cameras, zones, groups = (rc.table(value, name).to_pydict() for name in NAMES)
    figures = (shown := notebook.network_of(value)).figures
    task, exact = figures["area_m2"], figures.get("covered_area")
    whole = np.array(faces["area_m2"])[np.array(faces["covered"])].sum()
    assert whole == pytest.approx(task * figures["covered"]["area_percent"] / 100)
    assert sum(faces["area_m2"]) == pytest.approx(task) == pytest.approx(sum(groups["area_m2"]))
    covered = np.dot(groups["covered_percent"], groups["area_m2"]) / 100
    assert covered == pytest.approx(whole if exact is None else exact["m2"])
    if exact is not None:
        assert sum(faces["covered_m2"]) == pytest.approx(exact["m2"])
    assert (np.array(cameras["only_by_it_m2"]) <= np.array(cameras["covered_m2"]) + 1e-12).all()
    assert np.array_equal([cameras[each] for each in "xyz"], shown.eyes.T)
    assert set(zones["group"]) <= set(groups["group"]) == {BALL, "table"}
    assert zones["zone"] == list(range(1, len(zones["zone"]) + 1))
    assert zones["area_m2"] == sorted(zones["area_m2"], reverse=True)
    assert set(faces["reason"]) > {"covered"}


def test_tables_of_an_audit_are_those_of_its_report(results):
    result, out = results["audit"], results["out"] / "audit"
    assert rc.table(result, "faces").equals(pq.read_table(out / "elements.parquet"))
    assert rc.table(result, "cameras").equals(pq.read_table(out / "cameras.parquet"))
    weak = json.loads((out / "audit.json").read_text(encoding="utf-8"))["weak"]["zones"]
    zones = rc.table(result, "zones").to_pylist()
    assert [(row["kind"], row["x"]) for row in zones] == [
        (x["kind"], x["centroid"][0]) for x in weak
    ]


def test_a_table_of_no_zones_has_its_columns():
    result = rc.evaluate(rc.shapes.box(), CAMERA, rc.sphere_of_poses((0, 0, 0), 4, 60), by="area")
    assert rc.table(result, "zones").to_pydict() == {name: [] for name in notebook.ZONES.split()}
