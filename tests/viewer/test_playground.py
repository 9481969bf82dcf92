"""The playground of the documentation: files become scenes, and its plans run."""

import json
import re
import sys
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from browser import Tab
from mesh_files import VALID, WRITERS
from nightly import IS_NIGHTLY
from processes import run_python
from test_live import downloaded

import rastercov as rc
from rastercov.cli import command
from rastercov.core.mesh import shapes
from rastercov.report import live

WITHOUT = pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
pytestmark = [pytest.mark.slow, WITHOUT]
PART = shapes.torus(16, 8)
ROOT = Path(__file__).parents[2]


@pytest.fixture
def address(tmp_path):
    path = tmp_path / "playground.html"
    path.write_text(live.playground(), encoding="utf-8")
    return path.as_uri()


@pytest.mark.every_day
def test_the_command_writes_it_and_opens_it_where_there_is_a_display(tmp_path, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert command(["playground"]) == 0
    said = capsys.readouterr()
    assert said.out == "playground.html\n"
    assert said.err == "no display found: open the file in a browser elsewhere\n"
    path = tmp_path / "own page.htm"
    monkeypatch.setenv("DISPLAY", ":0")
    assert command(["playground", "--out", path.name, "--no-browser"]) == 0
    assert opened == []
    assert command(["playground", "--out", path.name]) == 0
    assert opened == [path.as_uri()]
    texts = {each.read_text(encoding="utf-8") for each in tmp_path.iterdir()}
    assert texts == {live.playground()}
    assert command(["playground", "--out", "page.txt"]) == 2
    assert len([*tmp_path.iterdir()]) == 2


@pytest.mark.every_day
def test_an_installation_without_the_engine_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(live, "engine", lambda: None)
    assert command(["playground", "--out", str(tmp_path / "page.html")]) == 2
    assert capsys.readouterr().err == (
        "error: expected the engine of pages, got no engine in this installation; run make wasm\n"
    )
    assert not [*tmp_path.iterdir()]


@pytest.mark.skipif(not IS_NIGHTLY, reason="at night")
def test_pages_of_the_site_compute(context, tmp_path):
    run_python(ROOT / ".ci/site", tmp_path)
    assert {each.stem for each in tmp_path.iterdir()} == {"playground", "part", "room", "flight"}
    for name in ("part", "room", "flight"):
        page = Tab(context, (tmp_path / f"{name}.html").as_uri())
        before = page.area_percent()
        page.js("rastercov.session.act({do: 'delete', station: rastercov.state().stations[0].id})")
        page.idle()
        assert 0 < page.area_percent() < before
        assert {each.split(":")[0] for each in page.requests} <= {"file", "blob", "data"}


class Begun(Tab):
    """The playground with a file of the reader's, in a unit."""

    def __init__(self, context, url, name, data, unit="m"):
        self.page = context.new_page()
        self.faults, self.requests = [], []
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(url)
        self.page.locator("#mesh-file").set_input_files(
            {"name": name, "mimeType": "application/octet-stream", "buffer": data}
        )
        self.page.get_by_label("unit of the file").select_option(unit)
        self.page.get_by_role("button", name="Start").click()
        self.page.wait_for_function("window.rastercov?.session.figures !== undefined")
        self.idle()


def test_fewer_cameras_are_placed_where_no_more_are_needed_and_counted_as_placed(context, address):
    box = rc.shapes.box()
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](box.vertices, box.faces), "m")
    page.page.locator(".start .number").fill("30")
    page.page.get_by_role("button", name="Place", exact=True).click()
    page.page.wait_for_function("rastercov.state().stations.length > 0")
    state = page.state()
    n = len(state["stations"])
    assert 0 < n < 30
    assert state["undo_label"] == f"place {n} cameras"


@pytest.mark.parametrize("name", ["binary.stl", "a.obj", "little.ply", "a.glb"])
def test_a_file_of_each_format_becomes_a_scene_whose_plan_runs(
    context, address, tmp_path, monkeypatch, name
):
    data = WRITERS[name](PART.vertices, PART.faces)
    page = Begun(context, address, name, data, "cm")
    page.page.locator(".start .number").fill("2")
    page.page.get_by_role("button", name="Place", exact=True).click()
    page.page.wait_for_function("rastercov.state().stations.length === 2")
    page.idle()
    value = page.js("rastercov.summary().covered_area")
    assert value["percent"] > 50
    files = downloaded(page)
    monkeypatch.chdir(tmp_path)
    for each, text in files.items():
        (tmp_path / each).write_text(text)
    checked = rc.check("plan.toml", "rig.json", min_coverage=0.1)
    told = checked.summary()["covered_area"]
    assert (value["m2"], value["percent"]) == (told["m2"], told["percent"])
    assert checked.mesh.areas.sum() == pytest.approx(1e-4 * PART.areas.sum(), rel=1e-5)
    assert command(["place", "plan.toml", "--out", "placed"]) in (0, 1)
    placed = json.loads((tmp_path / "placed/plan.json").read_text())
    assert len(placed["cameras"]) == 2
    assert placed["covered_area"]["percent"] > 50
    assert page.faults == []
    assert {each.split(":")[0] for each in page.requests} <= {"file", "blob", "data"}


def test_the_page_that_it_exports_opens_with_the_rig(context, address, tmp_path):
    page = Begun(context, address, "a.stl", VALID["binary.stl"])
    pose = rc.look_at((2.0, 2.0, 2.0), (0.2, 0.2, 0.2))[0].ravel().tolist()
    page.js("pose => rastercov.session.act({do: 'add', camera: '40° lens', pose})", pose)
    page.idle()
    text = page.js("rastercov.session.server.download('page').then(blob => blob.text())")
    path = tmp_path / "page.html"
    path.write_text(text, encoding="utf-8")
    other = Tab(context, path.as_uri())
    assert other.js("rastercov.summary().covered_area") == page.js(
        "rastercov.summary().covered_area"
    )
    assert other.state()["stations"] == page.state()["stations"]
    assert other.faults == []


@pytest.mark.parametrize(
    ("name", "data", "line"),
    [
        ("a.stl", VALID["binary.stl"][:100], "truncated"),
        ("a.obj", VALID["a.obj"].replace(b"v 1.0", b"v nan", 1), "finite coordinates"),
        ("a.dae", b"<x/>", "expected an .stl, .obj, .ply, .off or .glb file, got .dae"),
        ("<img src=x onerror=alert(1)>.ply", b"ply", "<img src=x onerror=alert(1)>.ply: expected"),
        (
            "a.stl",
            b"\0" * 80 + (10**6).to_bytes(4, "little") + b"\0" * 50 * 10**6,
            "300000 triangles",
        ),
    ],
)
def test_what_is_no_mesh_is_refused_in_a_line(context, address, name, data, line):
    page = context.new_page()
    page.goto(address)
    content = {"name": name, "mimeType": "application/octet-stream", "buffer": data}
    if len(data) < 40 << 20:
        page.locator("#mesh-file").set_input_files(content)
    else:  # more than Playwright sends
        page.evaluate(
            "() => { const bytes = new Uint8Array(50000084); new DataView(bytes.buffer)"
            ".setUint32(80, 1000000, true); const held = new DataTransfer();"
            "held.items.add(new File([bytes], 'a.stl')); const input ="
            "document.getElementById('mesh-file'); input.files = held.files;"
            "input.dispatchEvent(new Event('change')); }"
        )
    page.wait_for_selector(".fault:not(:empty)")
    said = page.locator(".fault").first.inner_text()
    assert line in said
    assert page.locator("[onerror], [src=x]").count() == 0
    assert page.get_by_role("button", name="a room").is_enabled()


HOSTILE = [
    ("a.off", VALID["a.off"].replace(b"4 4 0", b"4 9 0")),
    ("a.obj", VALID["a.obj"].replace(b"f 1//1", b"f 1/x/1", 1)),
    ("a.ply", VALID["big.ply"][:-9]),
    ("a.stl", VALID["ascii.stl"].replace(b"endloop", b"endless")),
    ("b.obj", b"v 0 0 0\nv 1e999 0 0\nv 0 1 0\nf 1 2 3\n"),
]


def test_lines_of_the_page_are_those_of_the_command(context, address, load):
    page = context.new_page()
    page.goto(address)
    for name, data in HOSTILE:
        with pytest.raises(rc.MeshError) as wanted:
            load(name, data)
        page.locator("#mesh-file").set_input_files(
            {"name": name, "mimeType": "application/octet-stream", "buffer": data}
        )
        page.wait_for_function(f"document.querySelector('.fault').textContent.startsWith('{name}')")
        said = page.locator(".fault").first.inner_text()
        assert said == name + str(wanted.value).partition(name)[2]


def test_a_file_of_a_gigabyte_is_refused_before_it_is_read(context, address):
    page = context.new_page()
    page.goto(address)
    page.evaluate(
        "() => { const file = new File(['x'], 'a.obj');"
        "Object.defineProperty(file, 'size', {value: 2 ** 30});"
        "file.arrayBuffer = () => { throw new Error('read'); };"
        "const event = new Event('drop'); event.dataTransfer = {files: [file]};"
        "document.dispatchEvent(event); }"
    )
    page.wait_for_selector(".fault:not(:empty)")
    said = page.locator(".fault").first.inner_text()
    assert re.fullmatch("expected up to 200 MB, got 1074 MB; simplify the mesh, .*", said)


@pytest.mark.every_day
def test_the_built_in_scenes_open_and_cover(context, address):
    for title in ("a room", "a part"):
        page = context.new_page()
        page.goto(address)
        page.get_by_role("button", name=title).click()
        page.wait_for_function("window.rastercov?.session.figures !== undefined")
        page.evaluate("rastercov.whenIdle()")
        total = page.evaluate("rastercov.summary().covered_area.of_m2")
        mesh = shapes.room() if title == "a room" else shapes.aeroplane()
        assert total == pytest.approx(float(np.sum(mesh.areas)), rel=1e-12)
        assert page.locator("section.start").is_visible()
