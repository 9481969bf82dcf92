"""Dead zones: connected parts that too few cameras cover, their areas, places and reasons."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, square
from surface_cases import building, cut_at_random, room

import rastercov as rc
from rastercov.advice.headline import advice_line
from rastercov.base.errors import ConfigError
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.polygons import frames_of, polygon_areas
from rastercov.core.area.remedies import Allowed
from rastercov.core.area.stages import ReasonPieces, first_failures
from rastercov.core.area.union import RegionUnion
from rastercov.core.area.zones import dead_zones, linked, summary_of, zone_line, zone_place
from rastercov.core.coverage.task import BITS, REASONS
from rastercov.core.mesh.topology import components_of
from rastercov.formats.meshes.ifc import Product
from rastercov.placement import NearestSurface, in_solid
from rastercov.reference.regions import covers_points, points_on

AHEAD = np.eye(4)[None]
CAMERA = rc.Camera(width=200, height=200, fx=100, fy=100)
TASK = rc.Task(max_incidence_deg=75, min_pixels_per_m2=2000)


def covered_by(mesh, camera, poses, task=TASK, views=1):
    return rc.unite(rc.regions(mesh, camera, poses, task), views)


def sheet(*cells):
    """Unit squares in the plane z = 4, facing the camera, by the places of their lower corners.

    +--+--+
    | /| /|    two faces a square, vertices not shared
    +--+--+
    """
    vertices, faces = [], []
    for x, y in cells:
        at = len(vertices)
        vertices += [(x, y, 4), (x + 1, y, 4), (x + 1, y + 1, 4), (x, y + 1, 4)]
        faces += [(at, at + 2, at + 1), (at, at + 3, at + 2)]
    return rc.Mesh(vertices, faces)


def alone(mesh):
    """Zones of a mesh without cameras."""
    return dead_zones(RegionUnion(mesh).covered())


# --- areas ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("views", [1, 2, 3])
@pytest.mark.parametrize("scene", [room, building])
def test_areas_of_zones_add_up_to_the_uncovered_area(scene, views):
    mesh, camera, poses = scene()
    covered = covered_by(mesh, camera, poses, views=views)
    zones = dead_zones(covered)
    missing = mesh.areas.sum() - covered.area[views - 1].sum()
    assert abs(zones.area.sum() - missing) <= covered.bound.sum() + 1e-12 * mesh.areas.sum()
    assert math.isclose(zones.piece_area.sum(), zones.area.sum(), rel_tol=1e-12)
    assert (np.diff(zones.area) <= 0).all()
    assert (zones.views < views).all()
    assert np.allclose(polygon_areas(zones.xy, zones.starts), zones.piece_area)
    sums = np.bincount(zones.zone, zones.piece_area)
    assert np.allclose(sums, zones.area, rtol=1e-12)


def test_what_small_zones_leave_out_is_within_the_bound():
    """Shadows of loose triangles on few faces, whose bounds are about the areas of the shadows."""
    rng = np.random.default_rng(7)
    n_left_out = 0
    for _ in range(200):
        wall = sheet(*rng.integers(-1, 1, (rng.integers(1, 4), 2)).tolist())
        n = int(rng.integers(3, 12))
        bars = rng.uniform(-0.6, 0.6, (n, 1, 3)) + rng.normal(scale=0.05, size=(n, 3, 3))
        bars[..., 2] = rng.uniform(2, 3, (n, 3))
        mesh = joined(wall, rc.Mesh(bars.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)))
        covered = covered_by(mesh, CAMERA, AHEAD, rc.Task())
        is_wall = np.arange(mesh.n_faces) < wall.n_faces
        dead = frames_of(mesh).areas - covered.area[0]
        bound = covered.bound + rng.uniform(0, 0.5, mesh.n_faces) * dead * is_wall
        zones = dead_zones(replace(covered, bound=bound, excess=bound))
        left_out = dead - np.bincount(zones.face, zones.piece_area, mesh.n_faces)
        n_left_out += int((left_out > 1e-9).sum())
        assert left_out.sum() <= bound.sum() + 1e-12
    assert n_left_out > 100


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize("scene", [room, building])
def test_another_cut_of_the_same_surface_has_the_same_zones(scene, views):
    mesh, camera, poses = scene()
    whole = dead_zones(covered_by(mesh, camera, poses, views=views))
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    for other in (cut_at_random(mesh, 1, 150)[0], rc.cells(mesh, size / 12).elements):
        zones = dead_zones(covered_by(other, camera, poses, views=views))
        n = whole.listed()  # without slivers of 1e-16 m^2, which are rounding
        assert zones.listed() == n
        assert np.allclose(zones.area[:n], whole.area[:n], atol=1e-6 * mesh.areas.sum())
        for one, same in zip(zones.places(3), whole.places(3), strict=True):
            assert np.allclose(one["centroid"], same["centroid"], atol=1e-4 * size)
            assert np.allclose(one["extent"], same["extent"], atol=1e-4 * size)


# --- what is connected ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cells", "n"),
    [
        ([(0, 0)], 1),
        ([(0, 0), (1, 0)], 1),
        ([(0, 0), (1, 1)], 2),  # a corner does not connect
        ([(0, 0), (2, 0)], 2),
        ([(0, 0), (1, 0.5)], 1),  # a part of an edge does
        ([(0, 0), (1, 0), (2, 0.25), (5, 0), (5, 1)], 2),
        ([(0, 0), (1 + 1e-8, 0.5)], 1),  # a vertex of a float32 file
        ([(0, 0), (1.001, 0)], 2),
    ],
)
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_faces_are_connected_along_edges(cells, n, offset):
    mesh = sheet(*cells)
    for each in (mesh, rc.Mesh(mesh.vertices + offset, mesh.faces)):
        assert len(alone(each)) == n


def test_a_small_face_at_the_edge_of_a_large_one_is_connected():
    # One edge of length 4 beside four of length 1
    mesh = rc.Mesh(
        [(0, 0, 0), (4, 0, 0), (2, 3, 0), *((x, 0, 0) for x in range(5)), (2, -1, 0)],
        [(0, 1, 2), *((3 + k, 8, 4 + k) for k in range(4))],
    )
    assert len(alone(mesh)) == 1


def test_a_covered_strip_divides_a_wall_into_two_zones():
    # The image is a strip of width 1.6 down the middle of a wall of side 8.
    camera = rc.Camera(width=40, height=400, fx=100, fy=100)
    zones = dead_zones(covered_by(square(4, 4), camera, AHEAD, rc.Task()))
    assert zones.area.tolist() == pytest.approx([25.6, 25.6])
    centroids = sorted(place["centroid"] for place in zones.places(2))
    assert np.allclose(centroids, [(-2.4, 0, 4), (2.4, 0, 4)])


def test_every_group_may_want_its_own_number_of_cameras():
    mesh = sheet((-1, -1), (0, 0))
    mesh = rc.Mesh(mesh.vertices, mesh.faces, [rc.Group("a"), rc.Group("b")], [0, 0, 1, 1])
    covered = covered_by(mesh, CAMERA, AHEAD, rc.Task(), views=2)
    assert covered.area[0].sum() == pytest.approx(2)
    assert len(dead_zones(covered, 1)) == 0
    assert dead_zones(covered).area.tolist() == pytest.approx([1, 1])
    zones = dead_zones(covered, [1, 1, 2, 2])
    assert zones.area.tolist() == pytest.approx([1])
    assert zones.places(1)[0]["groups"] == ["b"]
    assert zones.places(1)[0]["m2_by_views"] == pytest.approx([0, 1])


def test_occluders_are_no_part_of_a_zone():
    mesh, groups = sheet((0, 0), (1, 0)), [rc.Group("floor"), rc.Group("crates", is_occluder=True)]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, [0, 0, 1, 1])
    assert alone(mesh).area.tolist() == pytest.approx([1])


@pytest.mark.parametrize("views", [0, 3, 1.5, "1", [1, 2, 1]])
def test_views_beyond_those_that_are_counted_are_refused(views):
    covered = covered_by(sheet((0, 0)), CAMERA, AHEAD, rc.Task(), views=2)
    with pytest.raises(ConfigError, match="1 to 2, for all faces or for each"):
        dead_zones(covered, views)


# --- reasons --------------------------------------------------------------------------------------


def named(mesh, camera, poses, task):
    """Summary of the zones of a network."""
    network = AreaNetwork(mesh, task)
    if len(poses):
        network.add(rc.regions(mesh, camera, poses, task))
    return network.dead_zones(camera, poses)


@pytest.mark.parametrize(
    ("reason", "task", "change"),
    [
        ("back_facing", {}, {"flip": True}),
        ("outside", {}, {"move": (9, 0, 0)}),
        ("out_of_focus", {}, {"focus_range": (0.5, 1)}),
        ("too_coarse", {"min_facing_density": 26}, {}),
        ("too_coarse", {"min_pixel_density": 26}, {}),
        ("too_coarse", {"min_pixels_per_m2": 626}, {}),
        ("too_oblique", {"max_incidence_deg": 1}, {"move": (0.2, 0.2, 0)}),
        ("too_few_views", {"views": 2}, {}),
    ],
)
def test_the_reason_of_a_zone(reason, task, change):
    mesh = sheet((-0.1, -0.1))
    faces = mesh.faces[:, ::-1] if "flip" in change else mesh.faces
    mesh = rc.Mesh(mesh.vertices + change.get("move", 0), faces)
    camera = rc.Camera(width=200, height=200, fx=100, fy=100, focus_range=change.get("focus_range"))
    (zone,) = named(mesh, camera, AHEAD, rc.Task(**task))["dead_zones"]
    assert (zone["reason"], zone["hidden_by"]) == (reason, None)
    assert zone["area_m2"] == pytest.approx(1)
    assert zone["reason"] in REASONS


def test_without_cameras_the_reason_is_that():
    names = named(sheet((0, 0)), CAMERA, np.empty((0, 4, 4)), rc.Task())
    assert names["dead_zones"][0]["reason"] == "no_cameras"
    assert names["other_dead_zones"] == {"zones": 0, "area_m2": 0.0, "percent": 0.0}


def hidden_scene():
    """A floor of side 4 at depth 4, seen from the origin, behind two sheets of other groups."""
    low = np.array([(-1, -1, 2), (0, -1, 2), (0, 0, 2), (-1, 0, 2)], float)
    vertices = np.concatenate([[(-2, -2, 4), (2, -2, 4), (2, 2, 4), (-2, 2, 4)], low, low / 2])
    faces = [(k, k + 2, k + 1) for k in (0, 4, 8)] + [(k, k + 3, k + 2) for k in (0, 4, 8)]
    groups = [rc.Group("floor"), *(rc.Group(name, is_occluder=True) for name in ("far", "near"))]
    return rc.Mesh(vertices, faces, groups, [0, 1, 2, 0, 1, 2])


def test_a_hidden_zone_names_the_group_in_front():
    (zone,) = named(hidden_scene(), CAMERA, AHEAD, rc.Task())["dead_zones"]
    assert zone["area_m2"] == pytest.approx(4)
    assert (zone["reason"], zone["hidden_by"], zone["groups"]) == ("occluded", "near", ["floor"])
    assert zone["centroid"] == pytest.approx([-1, -1, 4])
    assert np.allclose(zone["extent"], [(-2, -2, 4), (0, 0, 4)])
    assert (
        zone_line(zone)
        == "dead zone 4 m² around (-1.0, -1.0, 4.0) m in group floor: occluded by near"
    )


def test_where_nothing_is_covered_the_largest_zone_has_figures():
    names = named(hidden_scene(), CAMERA, AHEAD, rc.Task(min_pixel_density=5000))
    zone = names["dead_zones"][0]
    assert "resolution too low" in zone_line(zone)
    assert re.fullmatch(
        r"advice: camera 1 comes closest to covering the zone's middle: .* px/m at .*, 5 px/mm "
        "required.*",
        advice_line(zone),
    )


def test_a_zone_names_its_cad_face_and_the_part_that_hides_it():
    """Both sheets are faces of one part, and so is the zone behind them of its own."""
    mesh = hidden_scene()
    names = ("arm/floor/face 1", "arm/sheet/face 2", "arm/sheet/face 13")
    groups = [replace(group, name=name) for group, name in zip(mesh.groups, names, strict=True)]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, mesh.face_group)
    result = named(mesh, CAMERA, AHEAD, rc.Task())
    (zone,) = result["dead_zones"]
    assert (zone["groups"], zone["hidden_by"]) == (["arm/floor/face 1"], "arm/sheet/face 13")
    assert zone_line(zone) == (
        "dead zone 4 m² around (-1.0, -1.0, 4.0) m in group arm/floor/face 1: occluded by arm/sheet"
    )


def test_a_camera_at_the_place_that_is_advised_covers_what_was_hidden():
    mesh = hidden_scene()
    (zone,) = named(mesh, CAMERA, AHEAD, rc.Task())["dead_zones"]
    place = r"\((.*), (.*), (.*)\) m"
    said = (
        "no present camera has a clear line of sight to even half of it; "
        f"add a camera at {place}, aimed at {place}: about (.*) % of "
    )
    *numbers, share = map(float, re.match(said, zone["advice"]).groups())
    there = rc.look_at(numbers[:3], numbers[3:])
    regions = rc.regions(mesh, CAMERA, there)
    assert regions.area.sum() >= 0.5 * zone["area_m2"]
    assert zone["nearest"] is None
    tried = zone["tried"]
    assert (tried["pose"], tried["position"], tried["looking_at"]) == (
        None, numbers[:3], numbers[3:]
    )  # fmt: skip
    assert tried["covers_percent"] == pytest.approx(share, abs=0.5)


def test_one_camera_gives_a_view_to_a_zone_that_needs_two():
    (zone,) = named(hidden_scene(), CAMERA, AHEAD, rc.Task(views=2))["dead_zones"][:1]
    assert re.search(r"of the zone would gain a view, 2 required$", zone["advice"])


def test_what_no_place_shows_is_said_to_be_so():
    box = np.array([(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]) * (3, 3, 3)
    vertices = np.concatenate([box, box - (0, 0, 1e-3), 1e3 * (box - (0, 0, 3)) + (0, 0, 3.1)])
    faces = [(k, k + 2, k + 1) for k in (0, 4, 8)] + [(k, k + 3, k + 2) for k in (0, 4, 8)]
    groups = [rc.Group("floor"), *(rc.Group(name, is_occluder=True) for name in ("lid", "rest"))]
    mesh = rc.Mesh(vertices, faces, groups, [0, 1, 2, 0, 1, 2])
    (zone,) = named(mesh, CAMERA, AHEAD, rc.Task())["dead_zones"]
    assert zone["tried"] is None
    assert re.fullmatch(
        r"no present camera has a clear line of sight to even half of it; none of the "
        r"\d+ positions tried within .* m of the zone's middle would cover at least half of it",
        zone["advice"],
    )

    network = AreaNetwork(mesh, rc.Task())
    network.allowed = Allowed(lambda at, places: places[:0])
    (zone,) = network.dead_zones(CAMERA, AHEAD)["dead_zones"]
    assert zone["advice"].endswith("of it; no position that may hold a camera was found")


def test_advice_names_no_place_inside_a_body():
    """A camera inside the cupboard would see all of the floor below it."""
    shell = rc.shapes.box((8, 5, 3), centre=(4, 2.5, 1.5))
    inwards = rc.Mesh(shell.vertices, shell.faces[:, ::-1])
    mesh = joined(inwards, rc.shapes.box((0.8, 1, 2.2), centre=(4, 2.5, 1.1)))
    corners = [(x, y, 2.4) for x in (0.1, 7.9) for y in (0.1, 4.9)]
    zones = named(mesh, CAMERA, rc.look_at(corners, (4, 2.5, 0)), rc.Task())["dead_zones"]
    (below,) = [zone for zone in zones if zone["reason"] == "occluded"]
    assert below["area_m2"] == pytest.approx(0.8)
    assert below["tried"] is None
    words = (
        r"none of the \d+ positions tried within .* m of the zone's middle that are clear of bodies"
    )
    assert re.search(rf"{words} would cover at least half of it$", below["advice"])


@examples(6, at_night=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_advised_places_are_outside_open_bodies_and_clear_of_surfaces(seed):
    """Bodies without some of their faces, seen by one camera that may be within 5 cm itself."""
    rng = np.random.default_rng(seed)
    whole = rc.shapes.by_name(str(rng.choice(["sphere", "box", "torus"])))
    rows = rng.permutation(whole.n_faces)[: int(rng.uniform(0.6, 0.95) * whole.n_faces)]
    mesh = rc.Mesh(rng.uniform(0.3, 1) * whole.vertices, whole.faces[np.sort(rows)])
    pose = rc.look_at(rng.normal(size=3) * mesh.diagonal, (0, 0, 0))
    for zone in named(mesh, CAMERA, pose, rc.Task())["dead_zones"]:
        if (tried := zone["tried"]) is None or np.array_equal(tried["position"], pose[0, :3, 3]):
            continue
        eye = np.array([tried["position"]])
        assert not in_solid(mesh, eye).any()
        assert NearestSurface(mesh).query(eye).distance >= 0.05


@pytest.mark.parametrize(
    ("limit", "reason"),
    [({"focus_range": (0.495, 0.505)}, "out_of_focus"), ({"near": 0.5}, "outside")],
)
def test_a_camera_is_tried_where_a_zone_is_in_focus_and_not_too_near(limit, reason):
    camera = replace(CAMERA, **limit)
    plate = rc.Mesh([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)], [(0, 1, 2), (0, 2, 3)])
    pose = rc.look_at((0.05, 0.05, 0.2), (0.05, 0.05, 0))
    (zone,) = named(plate, camera, pose, rc.Task())["dead_zones"]
    assert zone["reason"] == reason
    tried = zone["tried"]
    placed = rc.look_at(tried["position"], tried["looking_at"])
    assert rc.regions(plate, camera, placed).area.sum() >= 0.5 * zone["area_m2"]


def test_a_zone_of_parallel_rays_has_the_figures_of_its_camera():
    camera = rc.Camera.telecentric(100, 100, magnification=1.0, pixel_size=1e-4)
    plate = rc.Mesh([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)], [(0, 1, 2), (0, 2, 3)])
    pose = rc.look_at((0, 0, 0.2), (0, 0, 0))
    (zone,) = named(plate, camera, pose, rc.Task())["dead_zones"]
    assert zone["advice"].startswith("the middle is outside the image; none of the ")
    figures = zone["nearest"]
    assert (figures["distance_m"], figures["pixel_density"]) == pytest.approx((0.2, 1e4))


REACHED = (
    "that can be reached would cover at least half of it; "
    "for a second run turn the part over: this side faces down"
)


def test_advice_names_no_pose_that_is_not_reached():
    mesh, asked = hidden_scene(), []
    (free,) = named(mesh, CAMERA, AHEAD, rc.Task())["dead_zones"]

    def reaches(pose, camera):
        asked.append((pose[:3, 3].tolist(), camera))
        return pose[0, 3] < free["tried"]["position"][0] - 0.5

    network = AreaNetwork(mesh, rc.Task())
    network.add(rc.regions(mesh, CAMERA, AHEAD))
    network.allowed = Allowed(reaches=reaches)
    (zone,) = network.dead_zones(CAMERA, AHEAD)["dead_zones"]
    assert asked[0] == (free["tried"]["position"], 0)
    if zone["tried"] is None:
        assert REACHED in zone["advice"]
    else:
        assert zone["tried"]["position"][0] < free["tried"]["position"][0] - 0.5
    network.allowed = Allowed(reaches=lambda pose, camera: False)
    network.add(rc.regions(mesh, CAMERA, AHEAD))
    (zone,) = network.dead_zones(CAMERA, AHEAD)["dead_zones"]
    assert zone["tried"] is None
    assert REACHED in zone["advice"]


def wall_of(n, *, focal=100.0):
    """A wall of side n at x = 0 that faces +x, and a camera for it."""
    mesh = rc.Mesh([(0, 0, 0), (0, n, 0), (0, n, n), (0, 0, n)], [(0, 1, 2), (0, 2, 3)])
    return mesh, rc.Camera(width=400, height=400, fx=focal, fy=focal)


def test_the_camera_with_a_line_of_sight_is_named_before_a_nearer_one():
    """One camera is near behind a screen, the other far and sees too few pixels."""
    wall, camera = wall_of(2)
    screen = rc.Mesh(np.array([(1, -2, -2), (1, 4, -2), (1, 4, 4), (1, -2, 4)]), wall.faces)
    behind = rc.Mesh(screen.vertices + np.array((0.01, 0, 0)), wall.faces[:, ::-1])
    mesh = joined(wall, screen, behind)
    groups = [rc.Group("wall"), rc.Group("screen", is_occluder=True)]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, [0, 0, 1, 1, 1, 1])
    eyes = [(1.5, 1, 1), (0.8, 7, 1)]
    for order in (eyes, eyes[::-1]):
        poses = rc.look_at(order, (0, 1, 1))
        task = rc.Task(min_pixel_density=60)
        for zone in named(mesh, camera, poses, task)["dead_zones"]:
            assert zone["nearest"]["pose"] == order.index((0.8, 7, 1))
            other = (
                r" \(another camera meets more criteria and gives the zone's reason, occluded\)"
                if zone["reason"] == "occluded"
                else ""
            )
            assert re.match(rf"[\d.]+ .* required{other}(;|$)", zone["advice"])


def test_of_two_cameras_in_sight_the_one_that_misses_least_is_named():
    mesh, camera = wall_of(2)
    eyes = [(10, 1, 1), (40, 1, 1), (12, 1, 1)]
    poses = rc.look_at(eyes, [(0, 1, 1), (0, 1, 1), (90, 1, 1)])
    (zone,) = named(mesh, camera, poses, rc.Task(min_facing_density=15))["dead_zones"]
    assert (zone["reason"], zone["nearest"]["pose"]) == ("too_coarse", 0)
    text = r"10.\d* px/m at 10 m, 15 px/m required; .* 1.58 times the focal length.*"
    tried = zone["tried"]
    assert re.fullmatch(text, zone["advice"]) or tried["pose"] is not None
    assert tried["covers_percent"] > 50


@pytest.mark.parametrize("focus", [0.5, 20.0])
def test_a_camera_that_can_be_focused_is(focus):
    mesh, _ = wall_of(1)
    camera = rc.Camera(
        width=2000, height=2000, fx=1600, fy=1600, focal_length=8e-3, pixel_size=(5e-6, 5e-6),
        aperture=8e-3, focus_distance=focus,
    )  # fmt: skip
    poses = rc.look_at((4, 0.5, 0.5), (0, 0.5, 0.5))
    names = named(mesh, camera, poses, rc.Task())
    for zone in names["dead_zones"]:
        assert zone["reason"] == "out_of_focus"
        assert zone["tried"]["focus_distance_m"] == pytest.approx(4, rel=0.05)
        assert zone["tried"]["pose"] == 0


def test_no_lens_is_focused_nearer_than_its_focal_length():
    camera = rc.Camera(
        width=128, height=102, fx=943.4, fy=943.4, focal_length=0.05, pixel_size=(5.3e-5, 5.3e-5),
        aperture=0.0125, focus_distance=0.3,
    )  # fmt: skip
    poses = rc.look_at((0, 0, 0.045), (0, 0, 0.005))
    zones = named(rc.shapes.box((0.1, 0.1, 0.01)), camera, poses, rc.Task())["dead_zones"]
    assert any("out_of_focus" in zone["reason"] for zone in zones)
    assert not any("focus the camera" in zone["advice"] for zone in zones)


def test_a_change_that_would_cover_less_in_all_is_one_of_another_camera():
    """Turned to the small wall, the camera would lose the large one."""
    large, camera = wall_of(4, focal=300.0)
    small = rc.Mesh(large.vertices * (1, 0.25, 0.25) + (0, 12, 0), large.faces)
    mesh = joined(large, small)
    poses = rc.look_at((8, 2, 2), (0, 2, 2))
    names = named(mesh, camera, poses, rc.Task())
    zone = next(each for each in names["dead_zones"] if each["centroid"][1] > 10)
    assert zone["tried"]["pose"] is None
    assert "add a second camera at the same place" in zone["advice"]


def test_no_camera_of_a_bracket_is_moved_alone():
    mesh, camera = wall_of(1, focal=300.0)
    away = rc.look_at([(8, 0.5, 0.5)] * 2, [(8, 9, 0.5), (9, 9, 0.5)])
    places = np.stack([np.eye(4)] * 2)
    for offset, is_moved in ((0.0, True), (0.1, False)):
        places[1, 0, 3] = offset
        rig = rc.Rig([camera, camera], ["left", "right"], places)
        zone = named(mesh, rig, rc.Poses.of(away, camera=[0, 1]), rc.Task())["dead_zones"][0]
        assert (zone["tried"]["pose"] is not None) == is_moved
        assert ("add a second camera" in zone["advice"]) != is_moved


@pytest.mark.parametrize("scene", [room, building])
def test_points_fail_as_the_pointwise_reference_says(scene):
    mesh, camera, poses = scene()
    task = rc.Task(max_incidence_deg=70, min_facing_density=90, min_pixel_density=20)
    points, face = points_on(mesh, 3000)
    covers = covers_points(mesh, camera, poses, task, points, face)
    failures = list(first_failures(mesh, camera, task, poses, points, face))
    values = np.array([reason == rc.Reason.COVERED for reason, _ in failures])
    assert (values != covers).mean() < 1e-3
    assert covers.any()
    for reason, hidden_by in failures:
        assert ((hidden_by >= 0) == (BITS[reason] & BITS[rc.Reason.OCCLUDED] > 0)).all()


def test_the_summary_lists_a_hundred_zones_and_the_sum_of_the_rest():
    mesh = sheet(*((2 * k % 40, 2 * (k // 20)) for k in range(150)))
    summary = summary_of(alone(mesh), CAMERA, rc.Task(), np.empty((0, 4, 4)))
    assert len(summary["dead_zones"]) == 100
    assert summary["other_dead_zones"]["zones"] == 50
    total = sum(zone["area_m2"] for zone in summary["dead_zones"])
    assert total + summary["other_dead_zones"]["area_m2"] == pytest.approx(150)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_zones_of_a_plane_are_the_parts_of_its_union_by_geos(seed):
    shapely = pytest.importorskip("shapely", reason="GEOS is not installed")
    rng = np.random.default_rng(seed)
    # A floor of one face below 40 triangles that hide it from four cameras
    low = rng.uniform(-3, 3, (40, 1, 3)) * (1, 1, 0) + rng.uniform(-1, 1, (40, 3, 3))
    low[..., 2] = 3 + 0.5 * rng.uniform(-1, 1, (40, 3))
    vertices = np.concatenate([[(-9, -9, 5), (0, 9, 5), (9, -9, 5)], low.reshape(-1, 3)])
    groups = [rc.Group("floor"), rc.Group("clutter", is_occluder=True)]
    mesh = rc.Mesh(vertices, np.arange(123).reshape(-1, 3), groups, [0] + [1] * 40)
    eyes = np.column_stack([rng.uniform(-2, 2, (4, 2)), np.zeros(4)])
    poses = rc.look_at(eyes, eyes * (1, 1, 0) + (0, 0, 5), (0, 1, 0))
    zones = dead_zones(covered_by(mesh, CAMERA, poses, rc.Task(), views=2))
    parts = [
        shapely.Polygon(zones.xy[a:b])
        for a, b in zip(zones.starts[:-1], zones.starts[1:], strict=True)
    ]
    # Closed by 1e-7 where rounding left gaps; a corner in common does not connect.
    union = shapely.unary_union([part.buffer(1e-7, join_style="mitre") for part in parts])
    union = union.buffer(-2e-7, join_style="mitre")
    areas = sorted((part.area for part in getattr(union, "geoms", [union])), reverse=True)
    n = int((zones.area > 1e-3).sum())
    assert n > 3
    assert np.allclose(zones.area[:n], areas[:n], atol=1e-4)


def test_a_zone_ends_where_a_group_ends():
    groups = [rc.Group("small"), rc.Group("large")]
    mesh = rc.Mesh(
        [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 3, 0)], [(0, 1, 2), (0, 2, 3)], groups, [0, 1]
    )
    camera = rc.Camera(width=64, height=64, fx=64, fy=64)
    away = rc.regions(mesh, camera, rc.look_at((0, 0, 5), (0, 0, 9)))
    places = dead_zones(rc.unite(away)).places(2)
    assert [place["groups"] for place in places] == [["large"], ["small"]]
    assert [place["area_m2"] for place in places] == pytest.approx([3, 1])


def folded(degrees, apart=0.0):
    """Two unit squares that meet at a fold, whose edges may be a little apart, or shifted."""
    turn = math.radians(degrees)
    along, up = math.cos(turn), math.sin(turn)
    vertices = [(-1, 0, 0), (0, 0, 0), (0, 1, 0), (-1, 1, 0)]
    vertices += [(0, apart, 0), (along, apart, up), (along, 1 + apart, up), (0, 1 + apart, 0)]
    return rc.Mesh(vertices, [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])


@pytest.mark.parametrize("apart", [0.0, 1e-9, 0.25])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("degrees", "n"), [(0, 1), (29, 1), (31, 2), (90, 2), (179, 2)])
def test_a_zone_ends_at_a_crease_of_30_degrees(degrees, n, sign, apart):
    mesh = folded(sign * degrees, apart)
    assert len(alone(mesh)) == n
    flipped = mesh.faces.copy()
    flipped[2:] = flipped[2:, ::-1]  # whichever way the normals point
    assert len(alone(rc.Mesh(mesh.vertices, flipped))) == n


def test_a_smooth_surface_is_one_zone_and_a_box_six():
    assert len(alone(rc.shapes.sphere(2))) == 1
    assert len(alone(rc.shapes.box((1, 2, 3), 3))) == 6


def test_what_no_camera_can_see_has_a_reason_of_its_own():
    """A box on a table that hides: its lower side, in contact all over, and the four beside it."""
    box, table = rc.shapes.box((1, 1, 1), 1, (0, 0, 0.5)), rc.shapes.box((9, 9, 1), 1, (0, 0, -0.5))
    mesh = joined(box, table)
    groups = [rc.Group("box"), rc.Group("table", is_occluder=True)]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, np.repeat([0, 1], 12))
    result = rc.evaluate(mesh, CAMERA, rc.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0)), by="area")
    summary = result.summary()
    found_m2 = {name: each["m2"] for name, each in summary["not_covered_because"].items()}
    assert found_m2 == pytest.approx({"back_facing": 4.0, "unseeable": 1.0})
    assert "unseeable" not in summary["seeable_not_covered_because"]
    (below,) = [zone for zone in summary["dead_zones"] if zone["reason"] == "unseeable"]
    assert below["centroid"] == pytest.approx([0, 0, 0], abs=1e-9)
    assert below["nearest"] is None
    by_face = rc.evaluate(mesh, CAMERA, result.poses, by="face").summary()
    assert by_face["not_covered_because"]["unseeable"]["faces"] == 2


def test_a_zone_is_advised_a_camera_of_its_own_room():
    """Two rooms beside each other; the floor below a table in one is nearer to the other's camera.

    A-----+B----+
    |  ___|     |      A and B: cameras under the ceiling
    |  | ||     |
    +-----+-----+
    """
    walls = [rc.shapes.box((2, 2, 2), 4, (x, 0, 1)) for x in (-1, 1.1)]
    rooms = [rc.Mesh(each.vertices, each.faces[:, ::-1]) for each in walls]
    table = rc.shapes.box((0.8, 1.0, 0.05), 1, (-0.5, 0, 0.5))
    camera = rc.Camera.from_fov(800, 600, hfov_deg=110)
    eyes, target = [(0.15, 0, 1.9), (-1.8, 0, 1.9)], (-0.5, 0, 0)
    result = rc.evaluate(
        joined(*rooms, table), camera, rc.look_at(eyes, target), by="area", fields=()
    )
    zones = [zone for zone in result.summary()["dead_zones"] if zone["area_m2"] > 0.1]
    assert {zone["reason"] for zone in zones} >= {"occluded", "outside"}
    for zone in zones:
        x = zone["centroid"][0]
        if zone["nearest"] is not None and abs(x - 0.05) > 0.1:
            assert zone["nearest"]["pose"] == (x < 0)
        if zone["tried"] is not None and abs(x - 0.05) > 0.1:
            assert (zone["tried"]["position"][0] < 0.05) == (x < 0.05)


def test_a_coincident_surface_in_front_is_said_to_hide():
    """Two walls at the same place, back to back: neither is seen, and advice has its figures."""
    walls = [rc.shapes.box((2, 2, 2), 4, (x, 0, 1)) for x in (-1, 1)]
    rooms = joined(*(rc.Mesh(each.vertices, each.faces[:, ::-1]) for each in walls))
    f = 180 / np.pi
    camera = rc.Camera(width=360, height=180, fx=f, fy=f, model="equirectangular")
    poses = rc.look_at([(-1.8, 0, 1.9), (0.15, 0, 1.9)], (-0.5, 0, 0))
    summary = rc.evaluate(rooms, camera, poses, by="area", fields=()).summary()
    for zone in summary["dead_zones"]:
        assert "{" not in zone["advice"]
        assert zone["reason"] != "too_oblique"  # no such limit is set


def test_the_room_before_a_zone_and_of_a_camera_is_named():
    # Two rooms in a row under one floor; the camera is above the floor of the west.
    floor = rc.shapes.box((8, 4, 0.2), centre=(0, 0, -0.1))
    texts = [("Ground", "IfcSpace", str(row), name, "") for row, name in enumerate(("Hall", ""))]
    rooms = [rc.shapes.box((4, 4, 6), centre=(x, 0, 3)) for x in (-2, 2)]
    spaces = [(Product(*text), room) for text, room in zip(texts, rooms, strict=True)]
    mesh = rc.Mesh(floor.vertices, floor.faces, [rc.Group("slab")], spaces=spaces)
    camera, task = rc.Camera.from_fov(400, 400, hfov_deg=90), rc.Task(max_incidence_deg=45)
    poses = rc.look_at((-2, 0, 2.5), (-2, 0, 0))
    result = rc.evaluate(mesh, camera, poses, task)
    zones = [each for each in result.summary()["dead_zones"] if each["centroid"][2] == 0]
    east, both = ([each for each in zones if len(each["rooms"]) == n] for n in (1, 2))
    assert zone_place(both[0]) == "slab, room Ground/1 and 1 more"
    assert f"in group {zone_place(both[0])}: " in zone_line(both[0])
    (zone,) = (each for each in east if each["centroid"][0] > 2)
    assert zone_place(zone) == "slab, room Ground/1"
    assert "in room Ground/0 Hall and aim it at" in zone["advice"]
    below = [each for each in result.summary()["dead_zones"] if each["centroid"][2] < -0.15]
    assert [each["rooms"] for each in below] == [[]]
    assert zone_place(below[0]) == "slab"


def test_a_zone_on_one_cad_face_names_it():
    groups = [f"bracket/face {row + 1}" for row in range(12)]
    assert zone_place({"groups": groups[2:3]}) == "bracket/face 3"
    assert zone_place({"groups": groups}) == "bracket"
    assert zone_place({"groups": [*groups, "arm"]}) == "bracket and 1 more"


@pytest.mark.parametrize("seed", range(20))
def test_whole_faces_are_linked_as_by_their_neighbours(seed):
    rng = np.random.default_rng(seed)
    ball = rc.shapes.sphere(2)
    bumps = rng.uniform(0.7, 1.3, (ball.n_vertices, 1))  # creases on either side of 30 degrees
    groups = [rc.Group("a"), rc.Group("b")]
    own = rng.integers(2, size=ball.n_faces)
    mesh = rc.Mesh(ball.vertices * bumps, ball.faces, groups, own)
    face = np.flatnonzero(rng.random(mesh.n_faces) < 0.8).astype(np.int32)
    reason = rng.integers(3, size=len(face)).astype(np.uint32)
    frames, n = frames_of(mesh), len(face)
    corners = frames.corners[face].reshape(-1, 2)
    none = np.zeros(n, np.int32)
    parts = ReasonPieces(corners, 3 * np.arange(n + 1), face, none, reason)
    excess = np.where(rng.random(mesh.n_faces) < 0.3, 1.5, 0.0) * frames.areas
    zone, sizes = linked(mesh, parts, frames.areas[face], excess)

    row = np.full(mesh.n_faces, -1)
    row[face] = np.arange(n)
    one, other = mesh.topology.neighbours.T
    is_near = (row[one] >= 0) & (row[other] >= 0) & (own[one] == own[other])
    is_near &= (reason[row[one]] == reason[row[other]]) & (
        np.einsum("ni,ni->n", frames.normal[one], frames.normal[other]) >= math.sqrt(0.75)
    )
    root = components_of(n, np.stack([row[one], row[other]], axis=1)[is_near])
    areas = np.bincount(root, frames.areas[face])
    is_kept = areas > np.bincount(root, excess[face])
    assert np.array_equal(zone >= 0, is_kept[root])
    assert np.allclose(sizes, np.sort(areas[is_kept])[::-1])
    assert np.allclose(sizes[zone[zone >= 0]], areas[root][zone >= 0])
    pairs = np.unique(np.stack([zone, root])[:, zone >= 0], axis=1)
    assert pairs.shape[1] == is_kept.sum() == len(sizes)
