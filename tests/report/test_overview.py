"""Overview of a network: what its colours claim, the view into an interior, the floor plan."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from PIL import Image
from scenes import joined
from surface_cases import room
from target_scenes import beside, sheet_at

import rastercov as rc
from rastercov.coverage.network import Network
from rastercov.mesh import Group, Mesh, shapes
from rastercov.reference.regions import covers_points
from rastercov.report import overview, theme
from rastercov.report.images import draw_scale_bar, font_for, length_of_bar, place_labels
from rastercov.report.overview import best_covering, camera_colours
from rastercov.report.panorama import (
    floor_plan,
    is_enclosed,
    is_inside,
    look,
    neutral,
    outer_skin,
    outline,
    paint,
    paint_plan,
    points_of_pixels,
    turned_away,
)

TASK = rc.Task(max_incidence_deg=75)
MESH, CAMERA, POSES = room()


def shown_of(mesh=MESH, camera=CAMERA, poses=POSES, task=TASK):
    return camera_colours(mesh, poses, regions=rc.regions(mesh, camera, poses, task))


def in_fixture():
    """A ball with a plate before it and a wide table below it, which only hide."""
    ball, plate = shapes.sphere(2, 0.5), shapes.box((0.6, 0.05, 2.0), 1, (0.2, -0.8, 0.3))
    table = shapes.box((20, 20, 0.2), 1, (0, 0, -0.8))
    whole = joined(joined(ball, plate), table)
    groups = (Group("ball"), Group("plate", is_occluder=True), Group("table", is_occluder=True))
    return Mesh(whole.vertices, whole.faces, groups, np.repeat([0, 1, 2], [ball.n_faces, 12, 12]))


def hue_of(pixels, colours):
    """Row of the colour that each pixel is a shade of, (N,)."""
    pixels, table = pixels.astype(float), np.array(colours, float)
    along = pixels @ table.T / np.linalg.norm(table, axis=1)
    return (along / np.maximum(np.linalg.norm(pixels, axis=1), 1)[:, None]).argmax(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(1, -1.5, 1), (-1, 1.5, -1)])
def test_every_pixel_of_a_cameras_colour_is_of_a_point_that_it_covers(direction):
    shown = shown_of()
    scene = look(MESH, direction, scale=0.5, eyes=shown.eyes)

    def own(face):
        pixel = np.nonzero(face >= 0)
        points = points_of_pixels(MESH, scene.camera, scene.pose, face[pixel], *pixel)
        colours = np.zeros((*face.shape, 3), np.uint8)
        colours[pixel] = shown.of_points(face[pixel], points)
        return colours

    pixels = paint(scene, neutral(MESH), own=own)
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(scene.face >= 0)
    some = rng.choice(len(rows), 2_000, replace=False)
    rows, columns = rows[some], columns[some]
    face = scene.face[rows, columns]
    points = points_of_pixels(MESH, scene.camera, scene.pose, face, rows, columns)
    covers = covers_points(MESH, CAMERA, POSES, TASK, points, face.astype(np.int64))
    hue = hue_of(pixels[rows, columns], [*shown.colours, theme.UNCOVERED])
    claimed = np.vstack((covers, ~covers.any(axis=0)))[hue, np.arange(len(hue))]
    assert claimed.mean() > 0.999  # the rest lies on an outline
    assert len(np.unique(hue)) >= len(POSES)  # from each side, all but one camera


def test_by_face_only_covered_faces_have_a_colour():
    mesh = in_fixture()
    network = Network(mesh, rc.Task(min_coverage=0.9))
    with rc.open_observer(mesh, CAMERA) as observer:
        network.add_poses(observer, rc.look_at([(3.0, 0, 0), (0, -3.0, 0)], (0, 0, 0)))
    best = best_covering(network)
    assert ((best >= 0) == (network.best >= 0.9)).all()
    assert (network.best_pose[best < 0] >= 0).any()


def test_the_task_fills_the_picture_whatever_stands_around_it():
    mesh = in_fixture()
    scene = look(mesh, (1, -1.5, 1), scale=0.3)
    rows, columns = np.nonzero(np.append(mesh.task_mask, False)[scene.face] | (scene.beneath >= 0))
    height, width = scene.face.shape
    assert max(np.ptp(rows) / height, np.ptp(columns) / width) > 0.85


def test_an_occluder_hides_no_colour_of_the_task():
    mesh = in_fixture()
    scene = look(mesh, (0, -1, 0.2), scale=0.5)
    red = np.tile(np.array([[200, 20, 20]], np.uint8), (mesh.n_faces, 1))
    red[~mesh.task_mask] = theme.OCCLUDER_PALE
    pixels = paint(scene, red).astype(int)
    behind = scene.beneath >= 0
    is_red = pixels[..., 0] > 2 * pixels[..., 1]
    assert behind.sum() > 500
    assert 0.5 < is_red[behind].mean() < 0.8
    assert not is_red[~behind & ~np.append(mesh.task_mask, False)[scene.face]].any()


def test_a_target_hides_nothing():
    bare = shapes.room(4)
    mesh = beside(bare, sheet_at((-2, -2), (2, 2), 1.6))
    scene, without = (look(m, (1, -1.5, 1), scale=1.0) for m in (mesh, bare))
    colours = np.tile(np.array([[10, 200, 10]], np.uint8), (mesh.n_faces, 1))
    pixels = paint(scene, colours)
    expected = paint(without, colours[: bare.n_faces])
    changed = (pixels != expected).any(axis=2)
    assert changed.sum() <= 0.6 * (scene.targets >= 0).sum()
    assert not changed[scene.targets < 0].any()
    blocks = [mask[:560, :720].reshape(28, 20, 36, 20).mean(axis=(1, 3))
              for mask in (scene.targets >= 0, changed)]  # fmt: skip
    whole = blocks[0] == 1
    assert whole.sum() > 50
    assert blocks[1][whole].max() < 0.8  # what is behind shows everywhere


@pytest.mark.parametrize("two_sided", [[], ["room", "crates"]])
def test_an_interior_is_cut_open_and_a_part_is_not(two_sided):
    mesh = shapes.room(4).with_groups(two_sided=two_sided)
    eyes = [(2.5, 2, 2.5), (-2.5, -2, 2.5)]
    assert is_inside(mesh, eyes)
    scene = look(mesh, (1, -1.5, 1), scale=0.3, eyes=eyes)
    assert scene.is_cut
    walls = mesh.face_group[np.unique(scene.faces)] == 0
    away = np.einsum(
        "fi,fi->f", mesh.normals, scene.pose[:3, 3] - mesh.centroids
    )  # the room's normals point inwards
    assert (away[np.unique(scene.faces)[walls]] > 0).all()
    assert not look(shapes.box(), (1, -1.5, 1), scale=0.3, eyes=[(3, 3, 3)]).is_cut
    assert not is_inside(shapes.box(), [])


def thick_building():
    """A room with walls, floor and roof 0.3 m thick, a crate in it, and ground around it."""
    outside, crate = (
        shapes.box((6.6, 5.6, 3.4), 1, (0, 0, 1.4)),
        shapes.box((1, 1, 1), 1, (1, 1, 0.6)),
    )
    inside = shapes.box((6, 5, 2.8), 1, (0, 0, 1.4))
    inside = Mesh(inside.vertices, inside.faces[:, ::-1])
    return joined(joined(outside, inside), crate)


def test_the_outside_of_a_building_is_left_out_where_the_cameras_are_indoors():
    mesh = thick_building()
    eyes = [(2.5, 2, 2.5), (-2.5, -2, 2.5), (0, 0, 2.6)]
    assert is_enclosed(mesh, eyes)
    assert (np.flatnonzero(outer_skin(mesh, eyes)) == np.arange(12)).all()
    drawn = np.unique(look(mesh, (1, -1.5, 1), scale=0.3, eyes=eyes).faces)
    assert set(drawn.tolist()) & set(range(12, 24))
    assert set(drawn.tolist()) & set(range(24, 36))
    outdoors = [(9, 0, 3), (0, 9, 3.0), (4, 4, 2.5)]
    assert not outer_skin(mesh, outdoors).any()
    plan = floor_plan(mesh, eyes, scale=0.3)
    assert plan.cut == pytest.approx(2.6, abs=0.01)


def test_cameras_between_buildings_are_not_indoors():
    towers = [shapes.box((4, 4, 20), 1, (x, y, 10)) for x in (-10, 10) for y in (-10, 10)]
    mesh = joined(joined(towers[0], towers[1]), joined(towers[2], towers[3]))
    eyes = [(0, 0, 5), (3, 9, 6), (-3, 1, 8)]
    assert is_inside(mesh, eyes)
    assert not is_enclosed(mesh, eyes)
    assert floor_plan(mesh, eyes, scale=0.3).cut is None


def test_backs_of_the_task_have_no_cameras_colour():
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 2, 1)])  # faces down
    scene = look(mesh, (1, -1.5, 1), scale=0.3)
    pixels = paint(scene, np.array([[255, 0, 0]], np.uint8))[scene.face == 0].astype(int)
    assert scene.shows_backs()
    assert (np.ptp(pixels, axis=1) < 40).all()  # greyish
    assert turned_away(mesh, (0, 0, 5)).all()


# Floor plan


def top_below(mesh, rows, cut, x, y):
    """z of the highest point of some faces over (x, y), at most `cut`; -inf for none."""
    found = -np.inf
    for a, b, c in mesh.vertices[mesh.faces[rows]]:
        matrix = np.stack((b - a, c - a), axis=1)[:2]
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        u, v = np.linalg.solve(matrix, np.array((x, y)) - a[:2])
        z = a[2] + u * (b - a)[2] + v * (c - a)[2]
        if u >= 0 and v >= 0 and u + v <= 1 and (cut is None or z <= cut):
            found = max(found, z)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("mesh", [MESH, shapes.teapot(3), shapes.room(2)], ids=str)
def test_a_plan_shows_the_highest_surface_under_the_cut(mesh):
    low, high = mesh.bounds
    eyes = np.array([0.5 * (low + high) + (0.01, 0.02, 0.3 * (high - low)[2])])
    assert is_enclosed(mesh, eyes)
    plan = floor_plan(mesh, eyes, scale=0.5)
    assert plan.cut == pytest.approx(eyes[0, 2], abs=0.01 * (high - low)[2])
    rows = np.flatnonzero(mesh.normals[:, 2] > 0)
    faces, points, (i, j) = plan.points(plan.face)
    assert plan.places(points) == pytest.approx(np.stack((j + 0.5, i + 0.5), axis=1))
    rng = np.random.default_rng(1)
    wrong = 0
    for at in rng.choice(len(faces), 60, replace=False):
        x, y, z = points[at]
        wrong += abs(top_below(mesh, rows, plan.cut, x, y) - z) > 1e-3 * (high - low)[2]
        assert plan.height[i[at], j[at]] == pytest.approx(z, abs=1e-3 * (high - low)[2])
    assert wrong <= 1  # at an edge


def test_a_plan_of_a_part_is_not_cut():
    mesh = shapes.sphere(3)
    plan = floor_plan(mesh, [(5.0, 0, 0)], scale=0.3)
    assert plan.cut is None
    assert plan.height.max() == pytest.approx(1, abs=0.01)


def test_a_ceiling_is_cut_off_and_a_thick_roof_too():
    roof = shapes.box((6, 5, 0.5), 1, (0, 0, 3.2))
    mesh = joined(shapes.room(2), roof)
    plan = floor_plan(mesh, [(0, 0, 2.5), (1, 1, 2.6)], scale=0.3)
    assert plan.height.max() < 2.7
    assert plan.height[plan.face >= 0].min() == pytest.approx(0, abs=1e-3)


@pytest.mark.slow
def test_a_plan_has_the_colours_of_its_legend():
    shown = shown_of()
    keys = shown.keys()
    plan = floor_plan(MESH, shown.eyes, scale=1.0)

    def own(face):
        colours = np.zeros((*face.shape, 3), np.uint8)
        faces, points, pixel = plan.points(face)
        colours[pixel] = shown.of_points(faces, points)
        return colours

    pixels = np.asarray(paint_plan(plan, own))[plan.face >= 0]
    legend = {tuple(np.asarray(key.image)[12, 12].tolist()) for key in keys}
    in_legend = [tuple(pixel) in legend for pixel in pixels.tolist()]
    assert np.mean(in_legend) > 0.95  # the rest are lines


def test_the_outline_of_a_level_camera_encloses_its_horizontal_field_of_view():
    camera = rc.Camera(width=1280, height=720, fx=640, fy=640)
    pose = rc.look_at((0, 0, 1.0), (1, 0.3, 1.0))[0]
    corners = outline(overview._pyramid(camera, pose, 2.0)[:, :2])
    away = corners[np.linalg.norm(corners, axis=1) > 1e-9]
    angles = np.degrees(np.arctan2(away[:, 1], away[:, 0]))
    assert np.ptp(angles) == pytest.approx(90.0)


# Labels


@pytest.mark.slow
@examples(15)
@given(seed=st.integers(0, 2**32 - 1))
def test_labels_do_not_overlap_and_stay_in_the_picture(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 61))
    size = np.tile((30.0, 20.0), (count, 1))
    points = rng.uniform((0, 0), (700, 500), (count, 2)).round(-1)
    places = place_labels(points, size, (720, 520))
    apart = np.abs(places[:, None] - places[None])
    overlap = (apart < 0.999 * size[0]).all(axis=2) & ~np.eye(count, dtype=bool)
    assert not overlap.any()
    assert (places >= size / 2).all()
    assert (places <= np.array((720, 520)) - size / 2).all()


@pytest.mark.parametrize("scale", [3e-3, 0.7, 12.0, 9e4, 5e7])
def test_a_scale_bar_is_as_long_as_it_says(scale):
    image = Image.new("RGB", (800, 60), theme.PAPER)
    draw_scale_bar(image, (10, 50), scale, 300, font_for(600))
    dark = (np.asarray(image)[48] == theme.INK).all(axis=1)
    length = np.flatnonzero(dark[:311]).max() - 10
    assert 90 < length <= 300
    lengths = [d * 10.0**p for p in range(-9, 7) for d in (1, 2, 5)]
    (said,) = [metres for metres in lengths if abs(metres * scale - length) < 1.5]
    assert length_of_bar(said).split()[0] in ("1", "2", "5", "10", "20", "50", "100", "200", "500",
                                              "0.001", "0.002", "0.005")  # fmt: skip
    assert length_of_bar(0.5) == "50 cm"
    assert length_of_bar(2000) == "2 km"


@pytest.mark.slow
def test_an_overview_has_every_camera_and_says_when_colours_may_look_alike():
    shown = shown_of()
    keys = shown.keys()
    assert [key.name for key in keys[:2]] == ["camera 1", "2"]
    assert shown.caution() == ""
    image = overview.overview_picture(shown, CAMERA)
    plan = np.asarray(image)[60:560, 726:]
    for colour in shown.colours:
        assert (np.abs(plan.astype(int) - colour).max(axis=2) < 8).any()
    many = camera_colours(MESH, np.repeat(POSES, 3, axis=0))
    assert "13th on may look alike" in many.caution()
