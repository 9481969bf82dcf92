"""Plan sheets: to scale, bands by density, lines of sight by rays, and files that read back."""

import datetime
import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
import shapely
from bungalow import bungalow
from commands import call, enter, write_part
from ezdxf import bbox
from goals_to_view import plan_in
from hypothesis import given, settings
from hypothesis import strategies as st

import rastercov as rc
from rastercov.building.plan_sheet import SheetSite, _hatching, frame_of, plan_sheet
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.coverage.task import LEVELS
from rastercov.core.mesh import shapes
from rastercov.core.mesh.sections import section, solid
from rastercov.placement.plan.sections import SheetSection
from rastercov.report.drawing import SheetFrame
from rastercov.report.plan_geometry import (
    distances_to_walls,
    is_foliage,
    plan_lines,
    rooms_of,
    scene_of_plan,
    views_on_plan,
)
from rastercov.report.tables import lens_text, mounting_angles

CAMERA = rc.Camera(width=1280, height=720, fx=640, fy=640)
LENS = rc.Camera(width=1280, height=720, fx=640, fy=640, model="opencv", distortion=(0, 0, 0, 0))
EYES = ((-2.9, -2.4, 2.5), (2.9, 2.4, 2.5), (2.9, -2.4, 2.5))
BOX = np.array(((-3.0, -3.0), (3.0, 3.0)))
AROUND = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 4.0, 3))
POINT = st.tuples(*[st.integers(-29, 29).map(lambda tenth: tenth / 10)] * 2)


def seen_by(camera, poses, density, cut, walls=(), box=BOX):
    placed = rc.Poses.of(poses)
    scene = scene_of_plan(np.reshape(walls, (-1, 2, 2)), box, cut, placed)
    return views_on_plan(scene, [camera], placed, density)


@given(st.lists(st.tuples(POINT, POINT), max_size=8), POINT, POINT, st.integers(0, 9))
@settings(max_examples=60, deadline=None)
def test_a_point_is_seen_in_the_image_and_near_where_its_ray_crosses_no_wall(walls, eye, to, seed):
    lines = [shapely.LineString(ends) for ends in walls if ends[0] != ends[1]]
    if eye == to or any(line.distance(shapely.Point(eye)) < 1e-3 for line in lines):
        return
    pose = rc.look_at((*eye, 2.0), (*to, 1.2))
    (seen,) = seen_by(CAMERA, pose, 250, 1.0, [line.coords for line in lines])
    points = shapely.points(np.random.default_rng(seed).uniform(-2.99, 2.99, (300, 2)))
    points = points[~(shapely.distance(points, shapely.boundary(seen)) <= 1e-5)]  # none: NaN
    xy = shapely.get_coordinates(points)
    rays = shapely.linestrings([(eye, end) for end in xy])
    is_hidden = shapely.intersects(rays, shapely.union_all(lines)) if lines else False
    of_camera = to_camera(np.insert(xy, 2, 1.0, axis=1), pose[0])
    with np.errstate(all="ignore"):
        places = to_image(of_camera, CAMERA)
    is_seen = (places >= 0).all(axis=1) & (places <= (1280, 720)).all(axis=1)
    is_seen &= (of_camera[:, 2] > 0) & (of_camera[:, 2] <= 640 / 250)
    np.testing.assert_array_equal(shapely.contains(seen, points), is_seen & ~np.asarray(is_hidden))


@pytest.mark.parametrize("camera", [CAMERA, LENS], ids=["pinhole", "lens"])
@pytest.mark.parametrize("level", ["identify", "recognise", "observe", "detect"])
def test_a_band_ends_where_the_facing_density_falls_to_its_level(camera, level):
    depth = 640 / LEVELS[level]
    box = np.array([(-1.0, -depth - 9), (depth + 9, depth + 9)])
    (seen,) = seen_by(camera, rc.look_at((0, 0, 2), (5, 0, 2)), LEVELS[level], 2.0, box=box)
    wedge = shapely.Polygon([(0, 0), (depth, -depth), (depth, depth)])
    assert seen.symmetric_difference(wedge).area < 1e-4 * wedge.area
    (pose,) = rc.look_at((1, 2, 2.5), (4, 3, 1.5)).reshape(-1, 4, 4)
    (seen,) = seen_by(camera, pose, LEVELS[level], 1.2, box=2 * box)
    x, y, z = to_camera(np.insert(shapely.get_coordinates(seen), 2, 1.2, axis=1), pose).T
    assert z.max() == pytest.approx(depth, rel=1e-4)
    assert (np.maximum(abs(x), abs(y) * 16 / 9) <= z * (1 + 1e-5)).all()


def test_the_image_of_all_directions_is_a_disc_on_the_plan():
    camera = rc.Camera.preset("tls-360")
    (seen,) = seen_by(camera, rc.look_at((0, 0, 2), (1, 0, 2)), 1.0, 1.0)
    assert seen.contains(shapely.Point(2.9, 2.9))
    assert not seen.contains(shapely.Point(0.1, 0.1))  # below the scanner


@given(POINT, st.floats(1e-7, 0.3), st.floats(1e-3, 1))
def test_a_hatching_lies_in_its_zone_however_small(corner, size, step):
    zone = shapely.box(*corner, *np.add(corner, size))
    hatching = _hatching(zone, step)
    assert hatching.is_empty or zone.buffer(1e-9).contains(hatching)
    assert shapely.length(hatching) == pytest.approx(2**0.5 * size**2 / step, abs=9 * size)


def test_a_zone_too_small_for_a_hatching_adds_nothing_to_the_path():
    zone, frame = shapely.box(1, 1, 2, 2), SheetFrame("A3", 1e3, np.array((-20, 20)), 0.0, 1.2)
    parts = [zone, shapely.LineString(), shapely.Polygon()]
    assert frame.path(parts) == frame.path(zone)
    assert frame.path([shapely.LineString()]) == ""


def test_a_section_of_solids_is_filled_and_that_of_a_room_is_not():
    room = shapes.by_name("room")
    crates = solid(section(room.vertices, room.welded_faces, 0.5))
    assert crates.area == pytest.approx(1.2 * 0.8 + 0.8 * 0.8 + 0.8 * 1.2)
    outer, inner = shapes.box((4.0, 3.0, 2.0)), shapes.box((3.6, 2.6, 3.0))
    walls = [section(outer.vertices, outer.faces, 0.0)]
    walls.append(section(inner.vertices, inner.faces[:, ::-1], 0.0))
    assert solid(np.concatenate(walls)).area == pytest.approx(4.0 * 3.0 - 3.6 * 2.6)


def test_the_files_of_the_command_are_to_scale(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rc.write_poses("rig.json", np.concatenate([rc.look_at(eye, (0, 0, 0.8)) for eye in EYES]))
    line = "sheet room -c khepra -p rig.json --project Store --date 2020-02-20 --north 60 --out"
    for suffix in ("svg", "pdf", "dxf"):
        code, out, err = call(capsys, f"{line} plan.{suffix}")
        assert (code, out) == (0, f"plan.{suffix}\n"), err
    assert "1:25 on A3" in err
    svg = ElementTree.parse("plan.svg").getroot()
    assert (svg.get("width"), svg.get("viewBox")) == ("420mm", "0 0 420 297")
    paths = {group.get("id"): group.findall("{*}path") for group in svg.iterfind("{*}g[@id]")}
    numbers = re.findall(r"([-\d.]+),([-\d.]+)", paths["WALLS"][1].get("d"))
    walls = np.array(numbers, np.float64)
    np.testing.assert_allclose(np.ptp(walls, axis=0), (6e3 / 25, 5e3 / 25), atol=0.01)
    assert {"Store", "2020-02-20", "camera 1"} <= {text.text for text in svg.iter() if text.text}
    assert re.search(rb"/MediaBox \[0 0 1190\.55 841\.89\]", Path("plan.pdf").read_bytes())
    drawing = ezdxf.readfile("plan.dxf")
    assert not drawing.audit().has_errors
    assert drawing.header["$INSUNITS"] == 6
    entities = drawing.modelspace().query("LWPOLYLINE[layer=='WALLS']")
    corners = np.concatenate([line.get_points("xy") for line in entities])
    np.testing.assert_allclose(abs(corners).max(axis=0), (3, 2.5), atol=1e-5)
    layers = {entity.dxf.layer for entity in drawing.modelspace()}
    assert {"WALLS", "CAMERAS", "FOV", "FOV_IDENTIFY", "FOV_DETECT", "DEAD", "TEXT"} <= layers
    border = bbox.extents(drawing.modelspace().query("*[layer=='SHEET']")).extmin.x
    panel = border + (420 - 10 - 10 - 142) * 25 / 1e3
    for entity in drawing.modelspace().query("*[layer!='SHEET' & layer!='LEGEND' & layer!='TEXT']"):
        assert bbox.extents([entity]).extmax.x <= panel + 1e-6, entity.dxf.layer
    swatches = drawing.modelspace().query("LWPOLYLINE[layer=='LEGEND']")
    assert len(swatches) == 1 + 1 + 4 + 1 + 4
    assert len({entity.dxf.get("true_color") for entity in swatches}) == 8


ANYWHERE = """
meshes = [{ path = "part.obj", role = "occluder", unit = "mm", transform = { scale = 1e3 } }]
targets = [{ box = [[-2, -2, 1], [2, 2, 1.1]], count = [3, 3, 1] }]
camera = { preset = "khepra" }
candidates = [{ generator = "on_sphere", count = 6, distances = [6] }]
selection = { goal = "best_coverage", cameras = 2 }
outputs = { page = false }
sheet = { customer = "Store Ltd" }
constraints = { keep_out = [{ name = "pipe", low = [-1, -1, 2], high = [1, 1, 3] }] }
"""


@pytest.mark.slow
def test_results_open_in_any_folder(capsys, tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    Path("mine").mkdir()
    write_part("mine/part.obj")
    Path("mine/plan.toml").write_text(ANYWHERE)
    parts = "mine/part.obj -c khepra -p sphere:3 --unit mm"
    rc.write_views(
        "rig.json", rc.Views(rc.Rig([rc.Camera.preset("khepra")], ["a"]), AROUND, tuple("abc"))
    )
    for line in (f"evaluate {parts} --pictures 0 -o out/evaluate",
                 "place mine/plan.toml -o out/place",
                 "audit rig.json mine/part.obj -o out/audit"):  # fmt: skip
        assert call(capsys, line)[0] == 0
    rc.place("mine/plan.toml", out="out/function")
    for at in ("mine", ".", "/"):
        monkeypatch.chdir(tmp_path / at)
        for result in ("evaluate", "audit", "place", "function"):
            text = tmp_path / f"{result}.svg"
            line = f"sheet {tmp_path}/out/{result} --date x --out {text} --cut 0"
            code, _, err = call(capsys, line)
            assert code == 0, err
            is_planned = result in ("place", "function")
            assert ("Store Ltd" in text.read_text()) == is_planned
            assert (">plan.toml<" in text.read_text()) == is_planned
            assert ('id="KEEP_OUT"' in text.read_text()) == is_planned
            assert (", and targets facing up" in text.read_text()) == is_planned


@pytest.mark.parametrize(
    ("words", "told"),
    [("plan.png", ".svg, .pdf or .dxf"), ("plan.svg --cut 9", "the mesh, 0 to 2.8 m"),
     ("plan.svg --scale 1:5", "a larger one at 1:5; use --scale 1:100")],
)  # fmt: skip
def test_what_cannot_be_drawn_is_one_line_and_no_file(capsys, tmp_path, monkeypatch, words, told):
    monkeypatch.chdir(tmp_path)
    code, out, err = call(capsys, f"sheet room -c khepra -p sphere:2 --out {words}")
    assert (code, out) == (2, "")
    assert told in err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["svg", "pdf", "dxf"])
def test_names_beyond_xml_and_utf_8_are_drawn(capsys, tmp_path, monkeypatch, suffix):
    monkeypatch.chdir(tmp_path)
    name = "part \x1b\udcff\ufffe.obj"
    if sys.platform == "linux":
        write_part(name)
    else:
        write_part(name := "part.obj")
    told = ["-c", "khepra", "-p", "sphere:2", "--project", "a\x00b\x08<&é\U0001f4f7", "--out"]
    code, _, err = call(capsys, ["sheet", name, *told, f"plan.{suffix}"])
    assert code == 0, err
    if suffix == "svg":
        words = {each.text for each in ElementTree.parse("plan.svg").getroot().iter()}
        assert "a?b?<&é\U0001f4f7" in words
    if suffix == "dxf":
        assert not ezdxf.readfile("plan.dxf").audit().has_errors


def test_a_pdf_on_which_no_band_is_reached_is_drawn(capsys, tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    words = ["sheet", "box", "-p", "sphere:3", "--cut", "0", "--out", "plan.pdf", "-c"]
    code, _, err = call(capsys, [*words, "width = 9, height = 9, hfov_deg = 90"])
    assert code == 0, err


def test_a_result_of_place_needs_no_file_but_its_meshes(capsys, tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    rc.write_views("rig.json", rc.Views(rc.Rig([CAMERA], ["a"]), AROUND, tuple("abc")))
    files = (
        'camera = { file = "rig.json" }\ncandidates = [{ generator = "poses", file = "rig.json" }]'
    )
    lines = ANYWHERE.splitlines()
    lines[1] = 'meshes = [{ built_in = "box", role = "occluder" }]'
    lines[3:5] = files.splitlines()
    Path("plan.toml").write_text("\n".join(lines))
    assert call(capsys, "place plan.toml -o out")[0] == 0
    Path("rig.json").unlink()
    code, _, err = call(capsys, "sheet out --out plan.svg --cut 0")
    assert code == 0, err


def test_lenses_without_metres_are_named_by_their_field_of_view():
    assert lens_text(rc.Camera.preset("hikvision-2143g2-28mm")) == "103 x 55°"
    assert lens_text(rc.Camera.preset("tls-360")) == "360 x 150°"
    assert lens_text(rc.Camera.preset("khepra")) == "1.93 mm"


@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(-179, 180), st.floats(-360, 360))
def test_a_camera_is_mounted_by_its_angles(heading, tilt, roll, north):
    """Turned from a level camera along x: by heading, then down by tilt, then rolled."""
    h, t, r = np.radians((heading, tilt, roll))
    ahead = np.array((np.cos(h) * np.cos(t), np.sin(h) * np.cos(t), -np.sin(t)))
    right = np.array((np.sin(h), -np.cos(h), 0.0))
    down = np.cross(ahead, right)
    turned = np.stack((np.cos(r) * right + np.sin(r) * down, np.cos(r) * down - np.sin(r) * right))
    pose = np.eye(4)
    pose[:3, :3] = np.stack((*turned, ahead), axis=1)
    values = np.array(mounting_angles(pose))
    if abs(tilt) > 89.9:  # straight: both turn about one axis
        values[0] -= np.sign(tilt) * values[2]
        heading, roll, values[2] = heading - np.sign(tilt) * roll, 0.0, 0.0
        np.testing.assert_allclose(values[1], tilt, atol=1e-2)
        values[1] = tilt
    apart = (values - (heading, tilt, roll) + 180) % 360 - 180
    assert abs(apart).max() < 1e-5 + 1e-6 / max(np.cos(t), 1e-5)
    compass = mounting_angles(pose, north)[0]
    assert 0 <= compass < 360
    assert abs((north - mounting_angles(pose)[0] - compass + 180) % 360 - 180) <= 0.0501


@given(st.lists(st.tuples(POINT, POINT), min_size=1, max_size=8), POINT)
def test_distances_are_those_of_rays_along_the_nearest_wall_and_across(walls, at):
    walls = np.array([each for each in walls if np.ptp(each, axis=0).max() > 0.06] or [EYES[:2]])
    walls, at = walls[:, :, :2], np.add(at, (0.0137, 0.0071))
    lines = shapely.linestrings(walls)
    away = shapely.distance(lines, shapely.Point(at))
    if away.min() < 5e-3:
        return
    distances = distances_to_walls(walls, at)
    for start, end in distances:
        np.testing.assert_array_equal(start, at)
        assert shapely.distance(lines, shapely.Point(end)).min() < 1e-9
        way = shapely.LineString((start, end - 1e-6 * (end - start)))
        assert not shapely.intersects(lines, way).any()
    if (away < away.min() + 1e-9).sum() == 1 and len(distances) == 2:
        nearest = np.diff(walls[away.argmin()], axis=0)[0]
        along, across = distances[0][1] - at, distances[1][1] - at
        assert abs(nearest[0] * along[1] - nearest[1] * along[0]) < 1e-6
        assert abs(nearest @ across) < 1e-6


def tree(at, leaves=300, seed=0):
    """A trunk, and leaves of two triangles each."""
    random = np.random.default_rng(seed)
    corners = np.array(((0, 0, 0), (0.1, 0, 0), (0.1, 0, 0.1), (0, 0, 0.1)))
    middles = random.uniform((-2, -2, 0.5), (2, 2, 4), (leaves, 1, 3)) + at
    points = (corners + middles).reshape(-1, 3)
    faces = (np.array(((0, 1, 2), (0, 2, 3))) + 4 * np.arange(leaves)[:, None, None]).reshape(-1, 3)
    trunk = shapes.box((0.3, 0.3, 4.0)).moved(translation=(*at[:2], 2.0))
    joined = rc.Mesh.joined(
        [trunk, rc.Mesh(points, faces, [rc.Group("crown")])], ["trunk", "crown"]
    )
    return joined.moved(translation=(0, 0, 0))


@pytest.mark.parametrize("role", ["task", "occluder"])
@pytest.mark.parametrize("seed", range(4))
def test_trees_and_terrain_do_not_shrink_the_house(role, seed):
    random = np.random.default_rng(seed)
    house = rc.Mesh.joined([shapes.by_name("room")])
    ground = np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0.0))) * (80, 60, 0) - (
        0,
        0,
        0.1,
    )
    terrain = rc.Mesh(ground, [(0, 1, 2), (0, 2, 3)], [rc.Group("terrain", role == "occluder")])
    at = (*random.uniform(15, 40, 2), 0.0)
    site = rc.Mesh.joined([house, terrain, tree(at, seed=seed).with_groups(
        occluders=["*"] if role == "occluder" else [])])  # fmt: skip
    poses = rc.Poses.of(np.concatenate([rc.look_at(eye, (0, 0, 0.8)) for eye in EYES]))
    alone, frame = frame_of(house, poses, floor=0.0), frame_of(site, poses, floor=0.0)
    assert (frame.scale, frame.paper) == (alone.scale, alone.paper)
    np.testing.assert_allclose(plan_lines(site, poses, 1.2), ((-3, -2.5), (3, 2.5)), atol=1e-6)
    names = [site.groups[row].name for row in np.unique(site.face_group[is_foliage(site)])]
    assert names == ["crown"]
    assert is_foliage(site).sum() == 600


@pytest.mark.parametrize("sees_window", [True, False])
def test_goals_are_on_the_sheet_with_what_they_lack_and_who_sees_the_private(
    capsys, tmp_path, monkeypatch, sees_window
):
    """Upright parts are lines: of doors what nobody identifies, of a window what is seen."""
    monkeypatch.chdir(tmp_path)
    plan_in(tmp_path)
    at, to = ((2.0, 1.5, 1.5), (1.5, 4, 1.5)) if sees_window else ((2.0, 1.5, 1.5), (3.5, 0, 0.5))
    rc.write_poses("rig.json", rc.look_at([at], [to]))
    assert call(capsys, "sheet plan.toml -p rig.json --out s.svg")[0] == 0
    assert call(capsys, "sheet plan.toml -p rig.json --out s.dxf")[0] == 0
    texts = [text.text for text in ElementTree.parse("s.svg").getroot().iter() if text.text]
    words = " ".join(texts)
    assert "fails: goal doors: 0.0 % of the area covered, 70.0 % required" in words
    seen = "seen by camera 1 (1 m²)", "no camera covers any of it (proved)"
    assert seen[not sees_window] in words
    assert seen[sees_window] not in words
    lines = ezdxf.readfile("s.dxf").modelspace().query("LWPOLYLINE[layer=='GOALS']")
    drawn = shapely.union_all([shapely.LineString(line.get_points("xy")) for line in lines])
    wanted = [shapely.LineString(((0, 0), (0, 4)))]
    wanted += [shapely.LineString(((1, 3.99), (2, 3.99)))] * sees_window
    assert shapely.hausdorff_distance(drawn, shapely.union_all(wanted)) < 2e-3


def test_kept_cameras_are_outlines_on_the_sheet_and_what_is_required_heads_it(
    capsys, tmp_path, monkeypatch
):
    """Cameras that were there are in a layer of their own; new ones in that of cameras."""
    monkeypatch.chdir(tmp_path)
    plan_in(tmp_path)
    poses = rc.look_at([(2.0, 1.5, 1.5), (3.0, 1.0, 2.0)], [(1.5, 4, 1.5)] * 2)
    rc.write_poses("rig.json", poses)
    written = json.loads(Path("rig.json").read_text())
    counts = {}
    for origin in (["existing 0", "walls 3"], ["walls 1", "walls 3"]):
        Path("rig.json").write_text(json.dumps(written | {"origin": origin}))
        assert call(capsys, "sheet plan.toml -p rig.json --out s.svg")[0] == 0
        assert call(capsys, "sheet plan.toml -p rig.json --out s.dxf")[0] == 0
        lines = ezdxf.readfile("s.dxf").modelspace()
        counts[origin[0]] = [
            len(lines.query(f"LWPOLYLINE[layer=='{layer}']")) for layer in ("KEPT", "CAMERAS")
        ]
        texts = [text.text for text in ElementTree.parse("s.svg").getroot().iter() if text.text]
        assert texts.count("camera 1 (kept)") == 2 * (origin[0] == "existing 0")
        words = " ".join(texts)
        checked = rc.check("plan.toml", "rig.json")
        for each in checked.requirements:
            assert f"{each.status}: {each.words()}" in words
        assert checked.best_change.line.removeprefix("change ") in words
        assert "with 250 px/m or more" in words  # of the goal of the doors
    assert counts == {"existing 0": [1, 1], "walls 1": [0, 2]}


def test_what_a_plan_says_is_on_the_sheet(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = (Path(__file__).parents[2] / "examples/plans/watch_room.toml").read_text()
    Path("hall.toml").write_text(plan.replace("fx = 640\n", f"fx = 640\n{LENS_NAMES}") + SHEET)
    rc.write_poses("rig.json", np.concatenate([rc.look_at(eye, (0, 0, 0.8)) for eye in EYES]))
    line = "sheet hall.toml -p rig.json --revision D --out plan."
    for suffix in ("svg", "pdf", "dxf"):
        code, _, err = call(capsys, line + suffix)
        assert code == 0, err
    texts = [text.text for text in ElementTree.parse("plan.svg").getroot().iter() if text.text]
    wanted = [
        "Crates",
        "Store Ltd",
        "Ann",
        "D",
        "2026-02-03",
        "hall.toml",
        "door",
        "pipe",
        "N",
        "near",
    ]
    wanted += ["ACME 7 + wide", LENS_LINE]
    assert set(wanted) <= set(texts)
    assert "far" not in texts
    for eye in EYES:
        pose = rc.look_at(eye, (0, 0, 0.8))[0]
        assert {f"{angle:.1f}°" for angle in mounting_angles(pose, 75.0)[:2]} <= set(texts)
    drawing = ezdxf.readfile("plan.dxf")
    assert not drawing.audit().has_errors
    layers = {entity.dxf.layer for entity in drawing.modelspace()}
    assert {"KEEP_OUT", "SPACES", "IR", "DIMENSIONS", "ROOMS"} <= layers
    pipe = drawing.modelspace().query("LWPOLYLINE[layer=='KEEP_OUT']")
    corners = np.concatenate([line.get_points("xy") for line in pipe])
    np.testing.assert_allclose(corners.min(axis=0), (-2.1, -0.6), atol=1e-3)
    assert "None" not in {text.dxf.text for text in drawing.modelspace().query("TEXT")}


@pytest.mark.parametrize("seed", range(2))
def test_what_a_file_has_beyond_the_drawing_is_neither_drawn_nor_labelled(seed):
    random, mesh = np.random.default_rng(seed), shapes.by_name("room")
    poses = rc.Poses.of(np.concatenate([rc.look_at(eye, (0, 0, 0.8)) for eye in EYES]))
    frame = frame_of(mesh, poses, "A4")
    window = shapely.box(*frame.box.ravel())
    low = random.uniform(-60, 60, (60, 3)) * random.choice((0.05, 1), (60, 1))
    high = low + random.uniform(0, 6, (60, 3)) * random.choice((0, 1e-12, 1), (60, 3))
    boxes = [shapely.box(*one[:2], *other[:2]) for one, other in zip(low, high, strict=True)]
    outlines = [shapely.Polygon(), shapely.GeometryCollection(), shapely.MultiPolygon(), *boxes]
    outlines += [shapely.union(a, b) for a, b in zip(boxes[::2], boxes[1::2], strict=True)]
    ends = np.stack((low, high), axis=1)
    keep_out = [{"name": f"box {row}", "box": each} for row, each in enumerate(ends)]
    keep_out += [
        {"name": f"ball {row}", "centre": at, "radius": 3 * 10 ** random.uniform(-300, 0)}
        for row, at in enumerate(low)
    ]
    site = SheetSite(
        [(f"room {row}", "", each) for row, each in enumerate(outlines)], keep_out=keep_out
    )
    text = plan_sheet(rc.evaluate(mesh, CAMERA, poses), list("abc"), frame, {"project": ""}, site)
    groups = {group.get("id"): group for group in ElementTree.fromstring(text)}
    (left, top), (right, bottom) = frame.ends.tolist()  # y down
    labels = {
        each.text: each for each in groups["ROOMS"] if re.match("(room|box|ball) ", each.text)
    }
    for label in labels.values():
        assert left <= float(label.get("x")) <= right, label.text
        assert bottom <= float(label.get("y")) <= top, label.text
    rooms = {f"room {row}" for row, each in enumerate(outlines) if each.intersection(window).area}
    solid_ones = {f"box {row}" for row, each in enumerate(boxes) if each.intersects(window)}
    assert rooms == {name for name in labels if name.startswith("room ")}
    assert solid_ones <= set(labels)
    numbers = re.findall(r"([-\d.e]+),([-\d.e]+)", groups["KEEP_OUT"][0].get("d"))
    at = np.array(numbers, np.float64)
    assert (at >= (left - 1e-3, bottom - 1e-3)).all()
    assert (at <= (right + 1e-3, top + 1e-3)).all()


def test_rooms_of_a_building_are_named_and_numbered(tmp_path):
    path = tmp_path / "house.ifc"
    path.write_bytes(bungalow())
    rooms = rooms_of(rc.Mesh.load(path), 1.2)
    assert sorted((name, number) for name, number, _ in rooms) == [("Hall", "1"), ("Kitchen", "0")]
    areas = {name: outline.area for name, _, outline in rooms}
    assert areas == {"Kitchen": pytest.approx(5.7 * 5.6), "Hall": pytest.approx(3.7 * 5.6)}


LENS_LINE = "1280 x 720 px, field of view 90.0 x 58.7°, I / R / O / D 2.6 / 5.1 / 10 / 26 m, IR 4 m"
LENS_NAMES = """product = "ACME 7 + wide"
ir_range = 4.0
"""
SHEET = """
[sheet]
project = "Crates"
customer = "Store Ltd"
author = "Ann"
revision = "C"
date = "2026-02-03"
north = 75

[[constraints.keep_out]]
name = "pipe"
centre = [-1.5, 1.0, 2.5]
radius = 0.6

[rooms.near]
polygon = [[-2, -2], [2, -2], [2, 2]]
z = [0, 3]

[rooms.far]
polygon = [[50, 0], [60, 0], [60, 9]]
z = [0, 3]
"""


@pytest.mark.parametrize("line", ["room -p sphere:150 --paper A4", "teapot -p sphere:40"])
def test_labels_keep_clear_of_each_other_in_the_drawing(capsys, tmp_path, monkeypatch, line):
    monkeypatch.chdir(tmp_path)
    code, _, err = call(capsys, f"sheet {line} -c khepra --out plan.svg")
    assert code == 0, err
    root = ElementTree.parse("plan.svg").getroot()
    labels = [
        (float(text.get("x")), float(text.get("y")))
        for text in root.iter()
        if (text.text or "").startswith("camera ") and text.get("text-anchor") == "middle"
    ]
    assert len(labels) == int(line.split(":")[1].split()[0])
    at = np.array(labels)
    width, height = map(float, root.get("viewBox").split()[2:])
    assert (at >= 10).all()
    assert (at <= (width - 152, height - 12)).all()
    if len(at) <= 40:
        apart = abs(at[:, None] - at)[np.triu_indices(len(at), 1)]
        assert ((apart[:, 0] > 14) | (apart[:, 1] > 6.2)).all()


def test_title_blocks_have_the_date_of_today_unless_it_is_given():
    today = datetime.date.today().isoformat()
    assert SheetSection(customer="M").words(plan="p.toml")["date"] == today
    assert SheetSection(customer="M", date="May").words()["date"] == "May"
    assert SheetSection().words(plan="p.toml") == {"plan": "p.toml"}


@pytest.mark.parametrize("seed", range(4))
def test_labels_lie_on_no_wall_and_on_no_other_label(capsys, tmp_path, monkeypatch, seed):
    """Of rooms, cameras, their distances, what must not be seen, and who sees it."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(seed)
    plan_in(tmp_path)
    eyes = rng.uniform((0.3, 0.3, 1.0), (3.7, 3.6, 2.5), (1 + seed % 3, 3))
    rc.write_poses("rig.json", rc.look_at(eyes, [(1.5, 4.0, 1.5)] * len(eyes)))
    assert call(capsys, f"sheet plan.toml -p rig.json --paper {('A4', 'A3')[seed % 2]}")[0] == 0
    root = ElementTree.parse("plan.svg").getroot()
    width, height = map(float, root.get("viewBox").split()[2:])
    groups = {g.get("id"): g for g in root.iterfind("{*}g[@id]")}
    texts = [text for name in ("ROOMS", "TEXT") for text in groups[name].iterfind("{*}text")]
    boxes = []
    for text in texts:
        if not text.text or text.get("text-anchor") == "end":
            continue
        x, y, size = (float(text.get(name)) for name in ("x", "y", "font-size"))
        wide = 0.58 * size * len(text.text)  # of the mean letter
        left = {"start": x, "middle": x - wide / 2}[text.get("text-anchor")]
        if left + wide < width - 152 and height - 20 > y > 30:  # without those of the frame
            boxes.append(shapely.box(left, y - 0.75 * size, left + wide, y))
    assert len(boxes) >= 2 * len(eyes)
    named = [path for name in ("WALLS", "PRIVATE", "GOALS", "SPACES") for path in groups[name]]
    parts = "".join(path.get("d", "") for path in named).split("M")[1:]
    lines = [np.array(re.findall(r"[-\d.]+", part), float).reshape(-1, 2) for part in parts]
    walls = shapely.union_all([shapely.linestrings(line) for line in lines if len(line) > 1])
    for row, box in enumerate(boxes):
        assert not walls.intersects(box)
        assert not any(box.intersection(other).area > 0.05 for other in boxes[:row])
