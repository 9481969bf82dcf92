"""The playground of the documentation: files become scenes, and its plans run."""

import json
import re
import sys
import webbrowser
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Tab
from goals_to_view import QUADS, plan_in
from lens_cases import COLMAP, HEIGHT, WIDTH
from mesh_files import VALID, WRITERS
from nightly import IS_NIGHTLY, amount
from PIL import Image
from processes import run_python
from scipy.spatial.transform import Rotation
from test_live import downloaded

import rastercov as rc
from rastercov.cli import command
from rastercov.core.camera import parallel
from rastercov.core.camera.catalogue import catalogue
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
        others = "rastercov.state().stations.slice(1)"  # of a flight one alone changes nothing
        page.js(others + ".forEach(({id}) => rastercov.session.act({do: 'delete', station: id}))")
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


@pytest.mark.parametrize(
    ("name", "size", "unit"),
    [("a.stl", 80, "mm"), ("a.stl", 5, "m"), ("a.obj", 80, "m"), ("a.obj", 5000, "mm")],
)
def test_the_unit_that_is_proposed_is_that_of_a_printed_part_or_a_building(
    context, address, name, size, unit
):
    page = context.new_page()
    page.goto(address)
    data = WRITERS["binary.stl" if name == "a.stl" else name](
        PART.vertices * size / np.ptp(PART.bounds, axis=0).max(), PART.faces
    )
    content = {"name": name, "mimeType": "application/octet-stream", "buffer": data}
    page.locator("#mesh-file").set_input_files(content)
    assert page.get_by_label("unit of the file").input_value() == unit


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


OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.5e+02, 0., 320.25, 0., 551.5, 239.,
       0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.1, 0.02, 0.001, -0.0005, 0.003 ]
avg_reprojection_error: 3.0e-01
"""
ROS = """image_width: 800
image_height: 600
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [420.0, 0.0, 400.5, 0.0, 421.0, 299.5, 0.0, 0.0, 1.0]
distortion_model: LAW
distortion_coefficients:
  rows: 1
  cols: 4
  data: [0.01, -0.02, 0.003, -0.001]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
CAMERA_FILES = {
    "opencv.yaml": OPENCV,
    "none.yml": re.sub("distortion_coefficients(.|\n)*", "", OPENCV),
    "ros.yaml": ROS.replace("LAW", "plumb_bob"),
    "quoted.yaml": ROS.replace("LAW", '"plumb_bob"'),
    "fisheye.yaml": ROS.replace("LAW", "equidistant"),
    "one.json": '{"width": 640, "height": 480, "fx": 500.5}',
    "lens.json": json.dumps({"width": 640, "height": 480, "fx": 500.5, "fy": 501, "cx": 330.0,
                             "model": "opencv", "distortion": [-0.1, 0.01, 0, 0]}),
}  # fmt: skip
LABEL = "Open a rig, plan or camera…"


def open_file(page, name, text):
    page.open("Cameras")
    content = {"name": name, "mimeType": "text/plain", "buffer": text.encode()}
    page.page.get_by_label(LABEL).set_input_files(content)
    page.page.wait_for_timeout(50)
    page.idle()


def fault_of(page):
    return page.page.get_by_role("alert").locator("visible=true").all_inner_texts()


@pytest.mark.every_day
def test_files_of_cameras_open_as_python_reads_them(context, address, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    for name, text in CAMERA_FILES.items():
        Path(name).write_text(text)
        (camera,) = rc.read_views(name).cameras()
        open_file(page, name, text)
        plain = page.state()["cameras"][name]["plain"]
        for each in ("width", "height", "fx", "fy", "cx", "cy"):
            assert plain[each] == getattr(camera, each), (name, each)
        given = plain.get("distortion", [])
        own = [*camera.distortion, *[0.0] * len(given)][: max(len(given), len(camera.distortion))]
        assert [*given, *[0.0] * (len(own) - len(given))] == own
        assert page.page.get_by_label("Type", exact=True).input_value() == name
    cameras = rc.Rig((rc.Camera.load("one.json"), rc.Camera.load("lens.json")), ("left", "right"))
    poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 5.0, 3), camera=[1, 0, 1])
    rc.write_views("rig.json", rc.Views(cameras, poses, ("p", "q", "r")))
    open_file(page, "rig.json", Path("rig.json").read_text())
    stations = page.state()["stations"]
    assert [each["camera"] for each in stations] == ["right", "left", "right"]
    assert np.array_equal(
        [each["pose"] for each in stations], poses.world_from_camera.reshape(3, 16)
    )
    covered = page.js("rastercov.summary().covered_area")
    for name, text in downloaded(page).items():
        Path(name).write_text(text)
    told = rc.check("plan.toml", "rig.json", min_coverage=0.1).summary()["covered_area"]
    assert (covered["m2"], covered["bound_m2"]) == (told["m2"], told["bound_m2"])
    page.button("Undo")
    assert page.state()["stations"] == []
    assert page.faults == []


KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
"""
WRONG_FILES = {
    "empty.json": ("", "empty.json: expected JSON"),
    "text.yaml": ("a: b\n", "^text.yaml: expected one camera as of OpenCV"),
    "kalibr.yaml": (KALIBR, "^kalibr.yaml: expected one camera"),
    "stereo.yml": (OPENCV.replace("camera_matrix", "M1"), "^stereo.yml: expected one camera"),
    "two.yaml": (OPENCV + OPENCV, "^two.yaml: expected one camera"),
    "bad.json": ("{", "JSON"),
    "list.json": ('{"cameras": 3}', "list.json: expected lists of cameras and poses, got 3"),
    "null.json": ('{"cameras": [null]}', "null.json: expected lists of cameras and poses"),
    "three.json": ("3", "expected image size and focal length, got no width"),
    "many.json": (json.dumps({"world_from_camera": [np.eye(4).tolist()] * 5001}), "up to 5000"),
    "binned.yaml": (ROS.replace("LAW", "plumb_bob\nbinning_x: 2"), "got binning or roi"),
    "roi.yaml": (ROS.replace("LAW", "plumb_bob\nroi:\n  y: 2\n  width: 300"), "binning or roi"),
    "rule.json": ('{"rule": {}, "cameras": []}', "expected cameras and poses, got rule"),
    "law.yaml": (ROS.replace("distortion_model: LAW\n", ""), "expected distortion_model"),
    "size.yaml": (OPENCV.replace("640", "-640"), "expected width to be a whole number"),
    "nan.yaml": (OPENCV.replace("5.5e+02", ".nan"), "^nan.yaml: expected one camera"),
    **{f"{name}.json": (json.dumps({"cameras": [
           {"name": "a", "width": 640, "height": 480, "fx": 1000, "fy": 1000, "model": name}],
           "world_from_camera": [np.eye(4).tolist()], "camera": [0]}),
           f"expected a lens model that this page supports, got {name}; use rastercov view")
       for name in parallel.MODELS},
    "parallel.toml": ('[[meshes]]\npath = "a.obj"\n[camera]\nwidth = 640\nheight = 480\nfx = 90\n'
                      'model = "telecentric"', "this page supports, got telecentric; use"),
    **{f"{key} {len(own)}.json": (json.dumps({
           "cameras": [{"name": "a", "width": 6, "height": 4, "fx": 5}],
           "world_from_camera": [np.eye(4).tolist()], key: own}),
           f"expected the {word} of each of 1 poses, got {len(own)}")
       for key, word in (("camera", "camera"), ("images", "image")) for own in ([], ["a", "a"])},
    "model.json": ('{"width": 6, "height": 4, "fx": 5, "model": "lens"}', "a lens model"),
    "name.json": ('{"cameras": [{"name": "a", "width": 6, "height": 4, "fx": 5}], "camera": ["b"],'
                  ' "world_from_camera": [[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]}', "camera b"),
    "pose.json": ('{"cameras": [{"name": "a", "width": 6, "height": 4, "fx": 5}],'
                  ' "world_from_camera": [[[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]}', "rigid"),
    "bend.json": (CAMERA_FILES["lens.json"].replace("-0.1", "1e30"), ""),
    "<img src=x onerror=alert(1)>.json": ("{}", "expected image size and focal length"),
}  # fmt: skip


def test_what_is_no_file_of_cameras_is_one_line_and_changes_nothing(context, address):
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    before = page.state()
    for name, (text, words) in WRONG_FILES.items():
        open_file(page, name, text)
        assert page.state()["stations"] == before["stations"]
        assert page.state()["cameras"].keys() == before["cameras"].keys(), name
        said = "\n".join(fault_of(page))
        assert re.search(words, said, re.MULTILINE), (name, said)
    assert page.page.locator("[onerror]").count() == 0
    assert page.faults == []


class Opened(Begun):
    """The playground with files that are opened together, a plan among them."""

    def __init__(self, context, url, files):
        self.page = context.new_page()
        self.faults, self.requests = [], []
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.goto(url)
        self.page.locator("#mesh-file").set_input_files(sent(files))
        self.page.wait_for_function("window.rastercov?.session.figures !== undefined")
        self.page.wait_for_timeout(50)
        self.idle()


def sent(files):
    """Files as Playwright hands them over."""
    every = {
        name: data if isinstance(data, bytes) else data.encode() for name, data in files.items()
    }
    return [{"name": k, "mimeType": "text/plain", "buffer": data} for k, data in every.items()]


def obj_of(mesh, names):
    """The groups of a mesh as OBJ."""
    lines = [f"v {' '.join(map(repr, each))}" for each in mesh.vertices.tolist()]
    for row, name in enumerate(names):
        lines.append(f"g {name}")
        own = mesh.faces[np.arange(mesh.n_faces) % len(names) == row] + 1
        lines += [f"f {' '.join(map(str, face))}" for face in own.tolist()]
    return "\n".join(lines) + "\n"


def random_plan(rng):
    """Files of a plan with two or three meshes, cameras and thresholds, and a rig."""
    lines = []
    files = {}
    roles = rng.permutation(["task", "occluder", "target"])[: rng.integers(1, 4)].tolist()
    for row, role in enumerate(["task", *roles]):
        centre = rng.uniform(-0.2, 0.2, 3) + np.array((row, 0, 0))
        mesh = shapes.box((0.5, 0.4, 0.3), centre=centre.tolist())
        unit, factor = [("mm", 1e3), ("m", 1.0), (0.25, 4.0)][rng.integers(3)]
        name = f"part {row}.obj"
        files[name] = obj_of(replace(mesh, vertices=mesh.vertices * factor), ["door", "wall"])
        lines += ["[[meshes]]", f"path = 'parts/{name}'", f"unit = {unit!r}", f'role = "{role}"']
        if rng.random() < 0.5:
            lines += ['groups = ["door"]']
        if rng.random() < 0.5:
            lines += ["two_sided = " + ("true", '["wall"]')[rng.integers(2)]]
    lines += [
        "[cameras.wide]",
        "width = 640\nheight = 480\nhfov_deg = 70\ncost = 3",
        "[cameras.long]",
        "width = 640\nheight = 480\nfx = 900.5\nfocal_length = 8e-3\npixel_size = 5e-6",
        f"f_number = 4\nfocus_distance = {rng.uniform(0.5, 4)!r}",
        "[task]",
        f"max_incidence_deg = {int(rng.integers(50, 80))}",
        'min_facing_density = "detect"' if rng.random() < 0.5 else "min_pixel_density = 40",
        "views = " + ("1", "2", '{ "doo?" = 2 }')[rng.integers(3)],
        "[[candidates]]",
        'generator = "on_sphere"\ncount = 20',
        "[selection]",
        'goal = "fewest_cameras"\ncoverage = 0.3',
    ]
    files["plan.toml"] = "\n".join(lines) + "\n"
    if rng.random() < 0.7:
        if rng.random() < 0.7:
            lines += ["[goals.doors]", 'groups = ["doo?"]', "coverage = 0.4"]
            lines += ["max_incidence_deg = 66"]
        lines += ["[goals.rest]", "coverage = 0.7", "min_pixel_density = 55"]
    if rng.random() < 0.7:
        lines += ["[goals.private]", 'groups = ["*part 1/*wall*"]', "at_most = 0.1"]
    poses = rc.Poses.of(rc.sphere_of_poses((1, 0, 0), 3.0, 3), camera=rng.integers(0, 2, 3))
    content = {
        "world_from_camera": poses.world_from_camera.tolist(),
        "camera": [["wide", "long"][row] for row in poses.camera],
        "images": ["p", "q", "r"],
    }
    files["rig.json"] = json.dumps(content)
    return files


def leaves_of(value):
    """Keys and values of nested objects and lists, in the order of keys."""
    if isinstance(value, dict | list):
        for key, each in sorted(value.items()) if isinstance(value, dict) else enumerate(value):
            yield key
            yield from leaves_of(each)
    else:
        yield value


def are_near(value, other):
    """Equal but for the rounding of sums."""
    both = zip(leaves_of(value), leaves_of(other), strict=True)
    return all(one == each or abs(one - each) <= 1e-12 * abs(each) for one, each in both)


def without_file(figures):
    """Figures with groups without the name of the file of targets that the page saves."""
    return json.loads(json.dumps(figures).replace("targets/", ""))


@pytest.mark.parametrize("seed", range(amount(4, at_night=40)))
def test_plans_open_with_their_meshes_and_figures_are_those_of_check(
    context, address, tmp_path, monkeypatch, seed
):
    files = random_plan(np.random.default_rng(seed))
    page = Opened(context, address, files)
    assert "plan.toml: left out candidates\n" in page.page.locator("body").inner_text()
    covered = page.js("rastercov.summary().covered_area")
    required = page.js("rastercov.summary().required")
    assert len(required) == 1 + files["plan.toml"].count("[goals.")
    for folder, own in (("given", files), ("saved", downloaded(page))):
        (tmp_path / folder / "parts").mkdir(parents=True)
        monkeypatch.chdir(tmp_path / folder)
        for name, text in own.items():
            Path("parts" if name.startswith("part ") else ".", name).write_text(text)
        checked = rc.check("plan.toml", "rig.json")
        told = checked.summary()["covered_area"]
        assert {each.words() for each in checked.requirements} == {e["words"] for e in required}
        # Python knows that bodies are closed, which can only make bounds smaller.
        assert 0 <= told["bound_m2"] <= 1.0001 * covered["bound_m2"], folder
        own = {key: each for key, each in covered.items() if "bound" not in key}
        told = without_file({key: told[key] for key in own})
        # Saved faces are in another order, that of their roles, and so are sums.
        assert told == own if folder == "given" else are_near(told, own)
    again = Opened(context, address, downloaded(page))
    found = again.js("rastercov.summary().covered_area")
    assert are_near(without_file({key: found[key] for key in own}), own)
    assert again.js("rastercov.summary().required.length") == len(required)
    assert page.faults == again.faults == []


WRONG_PLANS = {
    "missing": ({"part 1.obj": None}, "part 1.obj with the plan, got no such file; open both"),
    "entry": ({"plan.toml": ("role =", "transform = {}\nrole =")}, "a mesh file and its role"),
    "unit": ({"plan.toml": ("unit = ", "unit = -")}, "expected"),
    "role": ({"plan.toml": ("role = ", "role = 3 #")}, "role task, occluder or target, got 3"),
    "group": ({"plan.toml": ('groups = ["door"]', "groups = ['<b>x']")}, "a group, got <b>x; use"),
    "roles": ({"plan.toml": ('groups = ["door"]', 'groups = { door = "task" }')},
              'names of groups, got {"door":"task"}; correct it'),
    "sides": ({"plan.toml": ('["wall"]', "{ wall = 1 }")}, 'names of groups, got {"wall":1}'),
    "toml": ({"plan.toml": ("[task]", "[task")}, "plan.toml: line"),
    "meshes": ({"plan.toml": ("[[meshes]]", "[[none]]")}, "expected"),
    "prototype": ({"plan.toml": ("role =", "__proto__ = 1\nrole =")}, "got __proto__"),
    "mesh": ({"part 1.obj": ("f ", "f x")}, "part 1.obj: line"),
    "deep": ({"plan.toml": ("[task]", "a = " + 10000 * "[" + "\n[task]")}, "up to 100 levels"),
}  # fmt: skip


def test_what_is_no_plan_is_one_line(context, address):
    page = context.new_page()
    page.goto(address)
    for name, (changes, words) in WRONG_PLANS.items():
        files = random_plan(np.random.default_rng(1))
        for file, change in changes.items():
            files[file] = files[file].replace(*change) if change else None
        page.evaluate("() => { document.querySelector('.fault').textContent = ''; }")
        page.locator("#mesh-file").set_input_files(
            sent({file: text for file, text in files.items() if text is not None})
        )
        page.wait_for_selector(".fault:not(:empty)")
        said = page.locator(".fault").first.inner_text()
        assert words in said, (name, said)
        assert "\n" not in said
        assert len(said) < 400
    assert page.get_by_role("button", name="a room").is_enabled()


def test_a_plan_of_several_cameras_wants_that_of_each_pose(context, address):
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    files = random_plan(np.random.default_rng(1))
    pose = np.eye(4).tolist()
    plan = {"plan.toml": files["plan.toml"]}
    for rig, n in (
        ({"world_from_camera": [pose]}, 0),
        ({"world_from_camera": pose, "camera": ["long"]}, 1),
    ):
        page.open("Cameras")
        page.page.get_by_label(LABEL).set_input_files(sent(plan | {"rig.json": json.dumps(rig)}))
        page.page.wait_for_timeout(50)
        page.idle()
        said = "\n".join(fault_of(page))
        assert "rig.json: expected the camera of each of 1 poses, got 0; correct" in said
        assert [each["camera"] for each in page.state()["stations"]] == ["long"] * n
        assert [each["pose"] for each in page.state()["stations"]] == [
            np.eye(4).ravel().tolist()
        ] * n
    assert page.faults == []


LEFT_OUT = """
[[meshes]]
path = "other.stl"
[camera]
preset = "PRESET"
[task]
max_incidence_deg = 60
weight_by = "area"
by = "face"
min_angle_deg = 20
min_facing_density = "300 px/m"
[constraints]
clearance = 0.3
[selection]
goal = "best_coverage"
cameras = 2
[goals.x]
coverage = 0.5
"""


def test_a_plan_in_an_open_scene_gives_cameras_and_thresholds_and_says_the_rest(context, address):
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    name, camera = next((n, rc.Camera.from_dict({"preset": n})) for n in catalogue(None).names())
    open_file(page, "own.toml", LEFT_OUT.replace("PRESET", name))
    state = page.state()
    assert state["cameras"]["camera"]["plain"]["fx"] == camera.fx
    assert state["task"]["max_incidence_deg"] == 60
    assert state["task"]["min_facing_density"] == 0
    (line,) = re.findall("^own.toml: .*$", page.page.locator("body").inner_text(), re.MULTILINE)
    assert "left out task.by, " in line
    for word in ("task.min_facing_density", "constraints", "selection", "goals", "meshes"):
        assert word in line
    assert "weight_by" not in line
    page.button("Undo")
    assert page.state()["task"]["max_incidence_deg"] != 60


def colmap_files(folder, suffix):
    """A model with several lenses, and its views."""
    names = ("PINHOLE", "SIMPLE_RADIAL", "OPENCV", "FULL_OPENCV")
    cameras = [
        f"{row} {name} {WIDTH} {HEIGHT} {' '.join(map(repr, COLMAP[name]))}"
        for row, name in enumerate(names, 1)
    ]
    folder.mkdir()
    (folder / "cameras.txt").write_text("\n".join(cameras))
    motions = np.linalg.inv(rc.sphere_of_poses((0, 0, 0), 4.0, 4))
    turns = Rotation.from_matrix(motions[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]].round(7)
    lines = [
        f"{row} {' '.join(map(repr, [*q, *t]))} {row} a {row}.png\n"
        for row, q, t in zip(range(1, 5), turns.tolist(), motions[:, :3, 3].tolist(), strict=True)
    ]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    views = rc.read_views(folder)
    if suffix == "bin":
        rc.write_views(folder / "binary", views, format="colmap")
        folder = folder / "binary"
        views = rc.read_views(folder)
    return {p.name: p.read_bytes() for p in folder.glob(f"*.{suffix}")}, views


@pytest.mark.parametrize("suffix", ["txt", "bin"])
def test_colmap_models_open_as_python_reads_them(context, address, tmp_path, monkeypatch, suffix):
    monkeypatch.chdir(tmp_path)
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    files, views = colmap_files(tmp_path / "model", suffix)
    page.open("Cameras")
    page.page.get_by_label(LABEL).set_input_files(sent(files))
    page.page.wait_for_function("rastercov.state().stations.length === 4")
    page.idle()
    stations = page.state()["stations"]
    assert [each["name"] for each in stations] == list(views.images)
    poses = np.reshape([each["pose"] for each in stations], (4, 4, 4))
    assert np.array_equal(poses, views.poses.world_from_camera)
    assert "no unit of length" in page.page.locator("body").inner_text()
    assert_as_checked(page)


def assert_as_checked(page, rel=0.0):
    """The figures of the page are those of `check` on the files that it saves, in this folder."""
    covered = page.js("rastercov.summary().covered_area")
    for name, text in downloaded(page).items():
        Path(name).write_text(text)
    told = rc.check("plan.toml", "rig.json", min_coverage=0.1).summary()["covered_area"]
    assert covered["m2"] > 0
    for key in ("m2", "bound_m2"):
        assert covered[key] == pytest.approx(told[key], rel=rel, abs=0), key
        rel *= 1e6
    assert page.faults == []


ODD_RIGS = {
    "drifted": {"drift": 3e-9},
    "far focus": {"focus_range": [0.1, float("inf")]},
    "no distortion": {"model": "opencv", "distortion": [0, 0, 0, 0]},
    "field of a pinhole": {"max_angle_deg": 20.0},  # whose border has a tangent
    "f-number": {"focal_length": 16e-3, "pixel_size": 4e-6, "f_number": 1.4, "focus_distance": 3},
}


@pytest.mark.parametrize("name", ODD_RIGS)
@pytest.mark.parametrize("form", ["json", "toml"])
def test_what_a_rig_leaves_to_rastercov_the_page_does_alike(
    context, address, tmp_path, monkeypatch, name, form
):
    monkeypatch.chdir(tmp_path)
    entries = {"width": 640, "height": 480, "fx": 500.5} | ODD_RIGS[name]
    poses = rc.sphere_of_poses((0, 0, 0), 3.0, 3)
    poses[:, 0, 1] += entries.pop("drift", 0.0)
    content = {"cameras": [{"name": "a", **entries}], "world_from_camera": poses.tolist()}
    if form == "json":
        text = json.dumps(content)
    else:
        camera = [f"{key} = {value!r}".replace("'", '"') for key, value in entries.items()]
        text = "\n".join(
            [f"world_from_camera = {poses.tolist()}", "[[cameras]]", 'name = "a"', *camera]
        )
    Path(f"own.{form}").write_text(text)
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    open_file(page, f"own.{form}", text)
    views = rc.read_views(f"own.{form}")
    stations = page.state()["stations"]
    assert [each["pose"] for each in stations] == views.poses.world_from_camera.reshape(
        3, 16
    ).tolist()
    assert_as_checked(page, rel=1e-12 if "max_angle_deg" in entries else 0)
    kept = rc.read_views("rig.json")
    assert kept.rig.cameras == views.rig.cameras


def test_a_drawing_lies_under_the_plan_of_a_page_without_a_program(context, address, tmp_path):
    Image.new("RGB", (800, 600), "white").save(tmp_path / "plan.png")
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    page.button("Floor plan")
    page.page.get_by_label("Choose a PNG, JPEG or SVG…").set_input_files(tmp_path / "plan.png")
    shown = page.page.locator("img.drawing:visible")
    assert shown.get_attribute("src").startswith("data:image/png;base64,")
    assert page.faults == []


WAYS = ("cover", "only hides others", "no camera may see")
AREAS = {"floor": 16.0, "north": 12.0, "window": 1.0, "west": 12.0}


def chosen(context, address, folder, ways, size=(1280, 800)):
    """The playground with a room whose groups are for something each."""
    plan_in(folder)
    page = Begun.__new__(Begun)
    page.page, page.faults = context.new_page(), []
    page.page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
    page.page.goto(address)
    page.page.locator("#mesh-file").set_input_files(folder / "room.obj")
    page.page.get_by_text("Choose which groups").click()
    for name, way in zip(QUADS, ways, strict=True):
        page.page.get_by_label(name, exact=True).select_option(way)
    page.page.get_by_role("button", name="Start").click()
    return page


@pytest.mark.parametrize("seed", range(amount(3, at_night=20)))
def test_chosen_groups_are_covered_and_private_ones_stay_unseen(
    context, address, tmp_path, monkeypatch, seed
):
    """Placed cameras keep the goal, whatever groups are for, and `check` has the same figures."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(seed)
    ways = rng.permutation([WAYS[0], WAYS[2], *rng.choice(WAYS, 2)]).tolist()
    page = chosen(context, address, tmp_path, ways)
    page.page.locator(".start .number").fill("2")
    page.page.get_by_role("button", name="Place", exact=True).click()
    page.page.wait_for_function("rastercov.state().stations.length > 0")
    page.idle()
    (goal,) = page.js("rastercov.summary().required")
    covered = page.js("rastercov.summary().covered_area")
    assert goal["status"] == "holds"
    assert covered["m2"] > 0
    for name, text in downloaded(page).items():
        Path(name).write_text(text)
    checked = rc.check("plan.toml", "rig.json", min_coverage=0.1)
    told = checked.summary()["covered_area"]
    assert (covered["m2"], covered["of_m2"]) == (told["m2"], told["of_m2"])
    (own,) = (each for each in checked.requirements if each.goal)
    assert (own.words(), own.status) == (goal["words"], goal["status"])
    wanted = [AREAS[name] for name, way in zip(QUADS, ways, strict=True) if way == WAYS[0]]
    assert told["of_m2"] == pytest.approx(sum(wanted))


def test_no_group_to_cover_is_one_line(context, address, tmp_path):
    page = chosen(context, address, tmp_path, [WAYS[1]] * len(QUADS)).page
    page.wait_for_function("document.querySelector('.fault').textContent")
    assert page.locator(".fault").inner_text().startswith("expected a group without a goal")


def test_a_page_asks_before_it_forgets_a_rig(context, address):
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    asked = []
    page.page.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.dismiss()))
    page.page.get_by_role("button", name="Add one here").click()
    page.idle()
    page.page.close(run_before_unload=True)
    page.page.wait_for_timeout(500)
    assert asked == ["beforeunload"]
    page.js("rastercov.session.server.save('rig').then(() => rastercov.session.refresh())")
    page.page.close(run_before_unload=True)
    context.new_page().wait_for_timeout(500)
    assert page.page.is_closed()
    assert asked == ["beforeunload"]


def test_each_threshold_of_the_page_can_be_changed(context, address):
    """No slider is there to refuse: those of whole faces are left out."""
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    for each in page.js("rastercov.session.scene.task_fields"):
        value = 2 if each["kind"] == "int" else 0.25
        action = {"do": "task", "changes": {each["name"]: value}}
        assert page.js("action => rastercov.session.act(action)", action), each["name"]
    page.open("All cameras")
    shown = page.page.locator(".panel:visible").inner_text()
    assert "Max incidence" in shown
    for words in ("Min pixels\n", "Min visibility", "Min coverage", "Min angle", "Focus rule"):
        assert words not in shown


def test_boxes_of_a_pose_show_no_negative_zero(context, address):
    page = Begun(context, address, "a.obj", WRITERS["a.obj"](PART.vertices, PART.faces), "m")
    page.open("Cameras")
    page.page.get_by_role("button", name="Add one here").click()
    page.idle()
    for signs in np.random.default_rng(1).choice((-1e-9, 1e-9), (6, 4)):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", [-np.pi / 2, 0, signs[3]]).as_matrix()
        pose[:3, 3] = signs[:3]
        page.js(
            "pose => rastercov.session.act({do: 'pose', station: 0, pose})", pose.ravel().tolist()
        )
        page.idle()
        values = [each.input_value() for each in page.page.locator(".pose input").all()]
        assert len(values) == 6
        assert "-0" not in values


def test_a_small_screen_begins_at_the_top(context, address, tmp_path):
    """However far the reader had to scroll for Start."""
    page = chosen(context, address, tmp_path, [WAYS[0]] * len(QUADS), (390, 500))
    page.page.wait_for_function("window.rastercov?.session.figures !== undefined")
    assert page.js("scrollY") == 0
    assert page.page.locator("header.top").bounding_box()["y"] == 0
