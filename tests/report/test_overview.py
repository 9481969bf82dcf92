"""Pictures of networks: what their colours claim, the view into an interior, dead zones."""

import io
import re
from functools import partial, reduce
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import examples
from PIL import Image, ImageDraw
from scenes import joined, square
from surface_cases import room
from target_scenes import beside, sheet_at, some_as_targets

import rastercov as rc
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.zones import zones_at
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.camera.viewpoints import upwards
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import REASONS, reason_rows
from rastercov.core.mesh import Group, Mesh, shapes, unseeable
from rastercov.placement.uncovered import what_is_left
from rastercov.reference.regions import covers_points, points_on
from rastercov.report import overview, panorama, theme
from rastercov.report.images import place_labels, png, png_in_the_dark
from rastercov.report.modes import mode_picture
from rastercov.report.overview import (
    Overview,
    best_covering,
    middle_of,
    zone_close_up,
    zones_picture,
)
from rastercov.report.pages import describe_mesh
from rastercov.report.panorama import (
    DIRECTIONS,
    Line,
    back_faces,
    best_directions,
    draw_in_space,
    in_picture,
    is_enclosed,
    is_inside,
    look,
    neutral,
    on_pixels,
    outer_skin,
    paint,
    points_of_pixels,
    scene_keys,
    sides,
    upright,
)

TASK = rc.Task(max_incidence_deg=75)
MESH, CAMERA, POSES = room()


def overview_of(poses=POSES, camera=CAMERA, *, regions=True):
    """Overview of the room, by area or of cameras without coverage."""
    result = rc.regions(MESH, camera, poses, TASK) if regions else None
    names = [str(row + 1) for row in range(len(poses))]
    nothing = np.full(MESH.n_faces, -1)
    return Overview(MESH, camera, rc.Poses.of(poses), names, nothing, result)


def in_fixture():
    """A ball with a plate before it and a wide table below it, which only hide."""
    ball, plate = shapes.sphere(2, 0.5), shapes.box((0.6, 0.05, 2.0), 1, (0.2, -0.8, 0.3))
    table = shapes.box((20, 20, 0.2), 1, (0, 0, -0.8))
    whole = reduce(joined, (ball, plate, table))
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
    shown = overview_of()
    scene = look(MESH, direction, scale=0.5, eyes=shown.eyes)
    pixels = paint(scene, neutral(MESH), partial(shown.of_image, scene))
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(scene.face >= 0)
    some = rng.choice(len(rows), 2_000, replace=False)
    rows, columns = rows[some], columns[some]
    face = scene.face[rows, columns]
    points = points_of_pixels(MESH, scene.camera, scene.pose, face, rows, columns)
    covers = covers_points(MESH, CAMERA, POSES, TASK, points, face.astype(np.int64))
    hue = hue_of(pixels[rows, columns], [*shown.colours, theme.UNCOVERED])
    claimed = np.vstack((covers, ~covers.any(axis=0)))[hue, np.arange(len(hue))]
    assert claimed.mean() > 0.98  # the rest lies on an outline: blocks have one colour
    assert len(np.unique(hue)) >= len(POSES)  # from each side, all but one camera


def test_every_pixel_of_the_task_has_a_colour_of_the_legend_beside_what_hides_it():
    mesh, poses = in_fixture(), rc.look_at([(3.0, 0, 0), (0, -3.0, 0)], (0, 0, 0))
    regions = rc.regions(mesh, CAMERA, poses, TASK)
    nothing = np.full(mesh.n_faces, -1)
    shown = Overview(mesh, CAMERA, rc.Poses.of(poses), ["1", "2"], nothing, regions)
    scene = look(mesh, (0.1, -1, 0.2), scale=0.5)
    colours = shown.of_image(
        scene, scene.face, np.flatnonzero(on_pixels(mesh.task_mask, scene.face))
    )
    used = {tuple(colour) for colour in colours.tolist()}
    assert used <= {*shown.colours, theme.UNCOVERED}
    assert len(used) > 1


def test_by_face_only_covered_faces_have_a_colour():
    mesh = in_fixture()
    network = Network(mesh, rc.Task(min_coverage=0.9))
    poses = rc.Poses.of(rc.look_at([(3.0, 0, 0), (0, -3.0, 0)], (0, 0, 0)))
    with rc.open_observer(mesh, CAMERA) as observer:
        for batch in network.judge(observer, poses):
            network.add(batch)
    best = best_covering(network)
    assert ((best >= 0) == (network.best >= 0.9)).all()
    assert (network.best_pose[best < 0] >= 0).any()


def test_the_task_fills_the_picture_whatever_stands_around_it():
    mesh = in_fixture()
    scene = look(mesh, (1, -1.5, 1), scale=0.3)
    rows, columns = np.nonzero(np.append(mesh.task_mask, False)[scene.face] | (scene.beneath >= 0))
    height, width = scene.face.shape
    assert max(np.ptp(rows) / height, np.ptp(columns) / width) > 0.85


def test_outliers_do_not_shrink_the_task():
    ball, rng = shapes.sphere(4, 0.5), np.random.default_rng(0)
    tip = shapes.box((0.1, 0.1, 0.6), 1, (0, 0, 0.6))  # is no outlier
    far = rng.normal(size=(20, 3)) * 50
    corners = (far[:, None] + rng.normal(size=(20, 3, 3)) * 0.02).reshape(-1, 3)
    mesh = joined(joined(ball, tip), Mesh(corners, np.arange(60).reshape(-1, 3)))
    for direction in DIRECTIONS[:2]:
        scene = look(mesh, direction, scale=0.3, eyes=[(3.0, 0, 0)])
        assert not scene.backs[scene.face].all()
        rows, places = in_picture(scene, mesh.centroids)
        assert mesh.areas[rows].sum() >= 0.99 * mesh.areas.sum()
        assert set(rows) >= set(range(mesh.n_faces - 20))
        places = places[rows < mesh.n_faces - 20]
        assert (np.ptp(places, axis=0) / (scene.camera.width, scene.camera.height)).max() > 0.8
    assert not is_inside(mesh, [(3.0, 0, 0)])


@pytest.mark.parametrize("up", [*np.eye(3), *-np.eye(3)])
def test_pictures_have_up_what_the_cameras_have_up(up):
    """Cameras on a ring that look down a little; on their sides they still look down."""
    axes = np.stack((np.roll(up, 1), np.cross(up, np.roll(up, 1)), up))
    eyes = np.array([(3, 0, 2), (-3, 0, 2), (0, 3, 2), (0, -3, 2)]) @ axes
    poses = rc.look_at(eyes, (0, 0, 0), up)
    along = look(MESH, (1, -1.5, 1), eyes=poses).pose[:3].T @ up
    np.testing.assert_allclose(along[:3], [0, -0.874, -0.485], atol=1e-3)
    assert (upwards(poses[:, :, [1, 0, 2, 3]] * (1, -1, 1, 1)) == up).all()
    assert (upwards(rc.look_at(-3 * up + eyes, (0, 0, 0), up)) == up).all()  # from below
    assert (upwards(poses @ np.diag([-1, -1, 1, 1])) == -up).all()
    assert upwards(np.concatenate((poses, poses @ np.diag([1, -1, -1, 1])))).tolist() == [0, 0, 1]


@pytest.mark.parametrize("shape", [shapes.box, shapes.room])
def test_a_picture_does_not_show_the_triangulation(shape):
    """The triangles of a plane have one shade, and lines are at its borders alone."""
    one, other = (
        paint(scene, np.full((mesh.n_faces, 3), 200, np.uint8)).astype(int)
        for mesh in (shape(n=1), shape(n=5))
        for scene in [look(mesh, DIRECTIONS[0], scale=1.0)]
    )
    assert len(np.unique(one)) > 5
    assert (one != other).any(axis=2).mean() < 2e-3  # samples on an edge


def test_what_hides_the_task_is_opened_and_named():
    mesh = in_fixture()
    scene = look(mesh, (0, -1, 0.2), scale=0.5)
    assert scene.opened == ["plate"]
    assert not (scene.beneath >= 0).any()
    assert "not shown: plate" in {key.name for key in scene_keys([scene])}
    assert look(mesh, (0, 1, 0.2), scale=0.5).opened == []
    house = thick_building()
    groups = (Group("task"), Group("shell", is_occluder=True))
    shell = Mesh(house.vertices, house.faces, groups, np.repeat([1, 0], [12, 24]))
    for direction in DIRECTIONS[:4]:
        scene = look(shell, direction, scale=0.3, eyes=[(0, 0, 2.6)])
        assert (scene.face >= 12).mean() > 0.3  # the room, not its roof
        assert (scene.face < 12)[scene.face >= 0].mean() < 0.2


def test_an_occluder_hides_no_colour_of_the_task(monkeypatch):
    mesh = in_fixture()
    monkeypatch.setattr(panorama, "OPENED", 1.0)
    scene = look(mesh, (0, -1, 0.2), scale=0.5)
    colours = np.where(mesh.task_mask[:, None], (200, 20, 20), theme.OCCLUDER_PALE).astype(np.uint8)
    pixels = paint(scene, colours).astype(int)
    behind, is_red = scene.beneath >= 0, pixels[..., 0] > 2 * pixels[..., 1]
    assert behind.sum() > 500
    assert 0.5 < is_red[behind].mean() < 0.8
    assert not is_red[~behind & ~np.append(mesh.task_mask, False)[scene.face]].any()


def test_a_target_hides_nothing():
    bare = shapes.room(4)
    mesh = beside(bare, sheet_at((-2, -2), (2, 2), 1.6))
    scene, without = (look(m, (1, -1.5, 1), scale=1.0) for m in (mesh, bare))
    colours = np.tile(np.array([[10, 200, 10]], np.uint8), (mesh.n_faces, 1))
    changed = (paint(scene, colours) != paint(without, colours[: bare.n_faces])).any(axis=2)
    is_target = scene.targets >= 0
    assert scene.face.max() < bare.n_faces <= scene.targets.max()
    assert changed.sum() <= 0.6 * is_target.sum()
    assert not changed[~is_target].any()
    whole, shares = (
        mask[:560, :720].reshape(28, 20, 36, 20).mean(axis=(1, 3)) for mask in (is_target, changed)
    )
    assert (whole == 1).sum() > 50
    assert shares[whole == 1].max() < 0.8  # what is behind shows everywhere
    alone = some_as_targets(square(1, 2), np.ones(2, bool))
    assert (look(alone, (0, 0, -1), scale=0.3).targets >= 0).any()


@pytest.mark.slow
@pytest.mark.parametrize("two_sided", [[], ["room", "crates"]])
@pytest.mark.parametrize("eyes", [(), [(2.5, 2, 2.5), (-2.5, -2, 2.5)]])
def test_an_interior_is_cut_open_and_a_part_is_not(two_sided, eyes):
    mesh, box = shapes.room(4).with_groups(two_sided=two_sided), shapes.box()
    assert is_inside(mesh, eyes) == bool(eyes)
    for direction in DIRECTIONS if eyes or not two_sided else ():
        scene = look(mesh, direction, scale=0.2, eyes=eyes)
        seen = np.flatnonzero(scene.counts)
        walls = seen[mesh.face_group[seen] == 0]  # whose normals point inwards
        ray = scene.pose[:3, 3] - mesh.centroids[walls]
        assert (np.einsum("fi,fi->f", mesh.normals[walls], ray) > 0).all()
        assert set(mesh.face_group[seen]) == {0, 1}
        whole = np.flatnonzero(look(box, direction, scale=0.2, eyes=[(3, 3, 3)]).counts)
        assert {tuple(each) for each in box.normals[whole].round().tolist()} == {
            tuple(each) for each in (np.diag(np.sign(direction))).tolist()
        }


def thick_building():
    """A room with walls, floor and roof 0.3 m thick, a crate in it, and ground around it."""
    outside, inside = (shapes.box(size, 1, (0, 0, 1.4)) for size in ((6.6, 5.6, 3.4), (6, 5, 2.8)))
    inside = Mesh(inside.vertices, inside.faces[:, ::-1])
    return reduce(joined, (outside, inside, shapes.box((1, 1, 1), 1, (1, 1, 0.6))))


def test_the_outside_of_a_building_is_left_out_where_the_cameras_are_indoors():
    mesh = thick_building()
    eyes = [(2.5, 2, 2.5), (-2.5, -2, 2.5), (0, 0, 2.6)]
    assert is_enclosed(mesh, eyes)
    assert set(np.flatnonzero(outer_skin(mesh, eyes))) == {*range(12), 32, 33}  # and a bottom
    drawn = np.flatnonzero(look(mesh, (1, -1.5, 1), scale=0.3, eyes=eyes).counts)
    assert set(np.unique(drawn // 12)) == {1, 2}
    assert not outer_skin(mesh, [(9, 0, 3), (0, 9, 3.0), (4, 4, 2.5)]).any()
    towers = [shapes.box((4, 4, 20), 1, (x, y, 10)) for x in (-10, 10) for y in (-10, 10)]
    city, between = reduce(joined, towers), [(0, 0, 5), (3, 9, 6), (-3, 1, 8)]
    assert is_inside(city, between)
    assert not is_enclosed(city, between)


def test_backs_of_the_task_have_no_cameras_colour():
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 2, 1)])  # faces down
    scene = look(mesh, (1, -1.5, 1), scale=0.3)
    pixels = paint(scene, np.array([[255, 0, 0]], np.uint8))[scene.face == 0].astype(int)
    assert scene.shows_backs()
    assert (np.ptp(pixels, axis=1) < 40).all()  # greyish
    assert back_faces(mesh, (0, 0, 5)).all()


# Labels


@pytest.mark.slow
@examples(5)
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


@pytest.mark.parametrize("lens", CAMERAS)
def test_a_view_pyramid_has_the_border_of_the_image_and_its_reach(lens):
    camera, pose = CAMERAS[lens], POSES[0]
    starts, border = pyramid = overview._pyramid(camera, pose, 2.0)
    assert len(border) % 4 == 0
    assert starts == pytest.approx(np.tile(pose[:3, 3], (len(border), 1)))
    assert np.linalg.norm(border - starts, axis=1).max() == pytest.approx(2.0)
    pixels = to_image(to_camera(border, pose) * (1 - 1e-12), camera)
    if lens == "equirectangular":
        assert pixels[:, 1] == pytest.approx(camera.height / 2)
    else:
        from_border = np.minimum(np.abs(pixels), np.abs(pixels - (camera.width, camera.height)))
        assert from_border.min(axis=1).max() < 1e-4
    lines = overview._edges(pyramid)
    ends = {tuple(end.tolist()) for line in lines for end in (line.start, line.end)}
    assert ends == {tuple(point) for point in pyramid.reshape(-1, 3).tolist()}


# Scenes


@pytest.mark.slow
@pytest.mark.parametrize("direction", DIRECTIONS.tolist())
def test_all_of_the_mesh_is_in_the_picture_from_everywhere(direction):
    plane = shapes.aeroplane()
    mesh = Mesh(plane.vertices * 1e-3 + 100, plane.faces)
    scene = look(mesh, direction, scale=0.2)
    rows, places = in_picture(scene, mesh.vertices)
    assert len(rows) == mesh.n_vertices
    assert (np.ptp(places, axis=0) / (scene.camera.width, scene.camera.height)).max() > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_one_looks_from_where_the_faces_in_question_are_seen(axis, sign):
    mesh = shapes.box()
    faces = mesh.normals[:, axis] * sign > 0.9
    towards = best_directions(mesh, faces)[0]
    assert towards[axis] * sign > 0
    seen = np.flatnonzero(look(mesh, towards, scale=0.2).counts)
    assert faces[seen].any()


@pytest.mark.slow
@examples(4)
@given(st.integers(0, 2**32 - 1))
def test_the_first_view_of_a_front_is_from_before_it_however_it_is_turned(seed):
    rng = np.random.default_rng(seed)
    wall = shapes.box((3, 2, 0.3), 3)
    rows = np.flatnonzero(wall.normals[:, 2] > -0.9)  # a scan has no back
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    mesh = Mesh(wall.vertices @ turn.T + rng.normal(0, 10, 3), wall.faces[rows])
    front = (mesh.normals * mesh.areas[:, None]).sum(axis=0)
    for eyes in (
        (),
        rc.look_at(mesh.bounds.mean(axis=0) + 9 * turn[:, 2], mesh.bounds.mean(axis=0)),
    ):
        for towards in sides(mesh, eyes):
            assert upright(eyes) @ front @ towards > 0.3 * np.linalg.norm(front)
        scene = look(mesh, sides(mesh, eyes)[0], scale=0.3, eyes=eyes)
        assert (mesh.normals[scene.face[scene.face >= 0]] @ front > 0.9).mean() > 0.5
        towards = np.array(describe_mesh(mesh, eyes)["towards"])
        np.testing.assert_allclose(towards, sides(mesh, eyes)[0] @ upright(eyes))


def test_the_first_view_of_a_closed_body_is_from_the_side_of_its_cameras():
    ball = shapes.sphere(2)
    for side in rc.look_at(np.array([(5, 0, 1), (-5, 1, 0), (0, -5, 1)]), (0, 0, 0)):
        for towards in sides(ball, side[None]):
            assert towards @ side[:3, 3] > 0
    assert (sides(ball, -DIRECTIONS) == sides(ball)).all()


# Close-ups


def touching(gap):
    """Two boxes with a slit between them, narrower than any view into it."""
    return joined(
        shapes.box((1, 0.5, 1), 2, (0, -0.25 - gap, 0)),
        shapes.box((1, 0.5, 1), 2, (0, 0.25 + gap, 0)),
    )


def hollow(_):
    """A box with a hole inside."""
    inner = shapes.box((0.4, 0.4, 0.4), 2)
    return joined(shapes.box((1, 1, 1), 2), Mesh(inner.vertices, inner.faces[:, ::-1]))


def on_a_table(gap):
    """A box above a table, which only hides."""
    whole = joined(
        shapes.box((1, 1, 1), 2, (0, 0, 0.5 + gap)), shapes.box((9, 9, 0.2), 1, (0, 0, -0.1))
    )
    groups = Group("box"), Group("table", is_occluder=True)
    return Mesh(whole.vertices, whole.faces, groups, np.repeat([0, 1], [whole.n_faces - 12, 12]))


@pytest.mark.slow
@pytest.mark.parametrize("made", [touching, hollow, on_a_table])
@pytest.mark.parametrize("gap", [1e-6, 2e-3])
def test_a_card_shows_its_zone_even_where_no_side_does(made, gap):
    mesh = made(gap)
    poses = rc.look_at([(5, 0, 1.5), (-4, 4, 1.5), (-4, -4, 1.5)], (0, 0, 0))
    area_network = AreaNetwork(mesh, TASK)
    area_network.add(rc.regions(mesh, CAMERA, poses, TASK))
    zones = area_network.zones(CAMERA, poses)
    said = area_network.dead_zones(CAMERA, poses)
    for row in range(min(3, len(zones))):
        picture = zone_close_up(zones, said, row, poses)
        colour = REASONS[said["dead_zones"][row]["reason"]].colour
        assert share_of_hue(picture, colour) > 0.005, row  # hatched


# Modes


def share_of_hue(image, colour):
    """Part of the pixels of a picture that are some shade of a colour."""
    pixels, colour = np.asarray(image.convert("RGB")).astype(int), np.asarray(colour, float)
    norm = np.linalg.norm(pixels, axis=2) * np.linalg.norm(colour)
    cosine = (pixels @ colour) / np.maximum(norm, 1)
    bright = pixels.sum(axis=2) / colour.sum()
    return float(((cosine > 0.997) & (bright > 0.5) & (bright < 1.1)).mean())


@pytest.mark.slow
def test_faces_that_are_left_have_the_colour_of_their_reason():
    mesh = in_fixture()

    def drawn(poses):
        left = what_is_left((mesh, CAMERA), poses)
        return mode_picture("reason", mesh, reason_rows(left.reason, ~left.left, left.n_cameras))

    nothing = drawn(np.zeros((0, 4, 4)))
    assert share_of_hue(nothing, REASONS["no_cameras"].colour) > 0.1
    image = drawn(rc.look_at([0, 0, 4.0], [0, 0, 9.0]))
    assert share_of_hue(image, REASONS["outside"].colour) > 0.03
    assert share_of_hue(image, REASONS["back_facing"].colour) > 0.03
    for level, colour in ((0.0, theme.ZERO_COVERAGE), (1.0, theme.COVERAGE_SCALE[-1])):
        picture = mode_picture("coverage", shapes.box(), np.full(12, level))
        assert share_of_hue(picture, colour) > 0.2


SINGLE = [each for name, each in REASONS.items() if "+" not in name]


@pytest.mark.parametrize(
    ("colours", "least"),
    [([each.colour for each in SINGLE], 30), (theme.camera_colours(12), 25)],
)
def test_colours_of_reasons_and_of_cameras_are_told_apart(colours, least):
    assert len(np.unique(theme.camera_colours(40), axis=0)) == 40
    colours = np.array(colours).astype(int)
    apart = np.abs(colours[:, None] - colours[None]).max(axis=2) + 999 * np.eye(len(colours))
    assert apart.min() > least
    hatches = [each.hatch for each in SINGLE]
    assert len(set(hatches)) == len(hatches)
    shown = {(each.colour, each.hatch) for each in REASONS.values()}
    assert len(shown) == len(REASONS)  # several have the colour of one of them
    assert REASONS["covered"].hatch == 0


# Dead zones

TWICE = rc.Task(max_incidence_deg=75, views=2)


@pytest.fixture(scope="module")
def network():
    area_network = AreaNetwork(MESH, TWICE)
    area_network.add(rc.regions(MESH, CAMERA, POSES, TWICE))
    return area_network


def test_points_know_their_zone(network):
    points, face = points_on(MESH, 3_000, 0)
    truth = covers_points(MESH, CAMERA, POSES, TWICE, points, face).sum(axis=0)
    zones = network.zones(CAMERA, POSES)
    zone = zones_at(zones, face, points, 3)
    assert ((zone >= 0) == (truth < 2)).mean() > 0.999
    assert zone.max() == 3
    # Points are spread evenly: their share of a zone is that of its area.
    for row in range(2):
        share = zones.area[row] / MESH.areas.sum()
        assert (zone == row).mean() == pytest.approx(share, abs=0.02)


@pytest.mark.slow
def test_zones_have_the_colour_of_their_reason_and_what_is_covered_has_none():
    mesh = shapes.sphere(3)
    camera = rc.Camera(width=640, height=480, fx=400, fy=400)
    pose = rc.look_at((0, -4, 0), (0, 0, 0))
    network = AreaNetwork(mesh, rc.Task())
    network.add(rc.regions(mesh, camera, pose))
    summary = network.dead_zones(camera, pose)
    assert summary["dead_zones"][0]["reason"] == "back_facing"
    picture = zones_picture(network.zones(camera, pose), summary, pose)
    assert share_of_hue(picture, REASONS["back_facing"].colour) > 0.05
    assert share_of_hue(picture, theme.COVERED) > 0.01


def test_the_label_of_a_small_thing_is_beside_it():
    at, other = place_labels([(50, 50)] * 2, [(8, 8)] * 2, (100, 100), [False, True])
    assert np.abs(other - 50).max() >= 8 > np.abs(at - 50).max() == 0


def test_short_lines_are_noise():
    mesh = joined(square(1, 2), square(0.007, 1.9))  # a fleck before a square
    scene = look(mesh, (0, 0, -1), scale=1.0)
    pixels = paint(scene, np.full((4, 3), 200, np.uint8))
    fleck = pixels[scene.face >= 2]
    assert len(np.unique(pixels[scene.face >= 0])) == 2 > len(np.unique(fleck))


def test_a_number_is_in_the_middle_of_its_zone():
    mask = np.zeros((40, 60), bool)
    mask[5:35, 10:15] = mask[20:35, 10:40] = True  # a thin bar with a wide end
    x, y = middle_of(np.argwhere(mask)[:, ::-1] + 0.5)
    assert mask[int(y), int(x)]
    assert (15 < x < 35, 22 < y < 33) == (True, True)


@pytest.mark.slow
def test_zones_that_neither_picture_shows_are_named(monkeypatch):
    """A core in a closed shell, as if it were not known that no camera can see it."""
    monkeypatch.setattr(unseeable, "unseeable_in_view", lambda mesh, seen: np.zeros(24))
    mesh = joined(shapes.box((0.6, 0.6, 0.6)), shapes.box((1, 1, 1)))
    poses = rc.look_at(
        5 * np.array([(1, -1.5, 1), (-1, 1.5, -1), (-2, -1, 1), (1, 2, 1)]), (0, 0, 0)
    )
    network, titles = AreaNetwork(mesh, rc.Task()), []
    network.add(rc.regions(mesh, CAMERA, poses))
    monkeypatch.setattr(overview, "add_frame", lambda pixels, title, keys: titles.append(title))
    summary = network.dead_zones(CAMERA, poses)
    zones = network.zones(CAMERA, poses)
    zones_picture(zones, summary, poses)
    core = np.unique(zones.zone[zones.face < 12]) + 1  # a zone a side
    shown = re.search(r"; not visible here: (.*)", titles[0])[1]
    named = set(map(int, re.findall(r"\d+(?= and|,|$)", shown)))
    more = re.search(r"and (\d+) more", shown)
    assert len(named) + int(more[1] if more else 0) >= len(core)
    assert named & set(core.tolist())
    for n, words in ((1, "the largest is"), (2, "the 2 largest are")):
        zones_picture(zones, summary | {"dead_zones": summary["dead_zones"][:n]}, poses)
        assert f"; {words} numbered" in titles[-1]


# --- in the dark ----------------------------------------------------------------------------------


def test_a_picture_in_the_dark_has_its_greys_reversed_and_its_colours_kept():
    vivid = [REASONS[name].colour for name in ("occluded", "too_oblique", "too_coarse")]
    greys = [theme.PAPER, theme.COVERED, theme.UNCOVERED, theme.INK]
    colours = np.array([*vivid, *greys], np.uint8)
    picture = Image.fromarray(np.repeat(colours[None], 4, axis=0))
    light = png(picture, Image.Quantize.FASTOCTREE)
    with Image.open(io.BytesIO(png_in_the_dark(light))) as file:
        dark = np.asarray(file.convert("RGB"))[0].astype(int)
    assert np.abs(dark[: len(vivid)] - vivid).max() <= 4  # as the palette has them
    lightness = dark[len(vivid) :].mean(axis=1)
    assert (np.diff(lightness) > 0).all()
    assert lightness[0] < 32
    assert lightness[-1] > 200
    assert len(light) == len(png_in_the_dark(light))


def test_a_line_is_drawn_at_once_as_far_as_it_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A border and the line itself, however many pieces it has: each would cost time."""
    scene = look(shapes.box(), (1, -1.5, 1))
    high = np.array([0.0, 0.0, scene.mesh.bounds[1][2] * 1.5])
    image, calls, drawn = Image.new("RGB", (1440, 1120)), list[object](), ImageDraw.ImageDraw.line

    def count(draw: ImageDraw.ImageDraw, *values: Any) -> None:
        calls.append(values)
        drawn(draw, *values)

    monkeypatch.setattr(ImageDraw.ImageDraw, "line", count)
    for pieces in (1, 7, 96):
        calls.clear()
        draw_in_space(image, scene, [Line(high, 1.1 * high, 2.0, pieces)], (255, 0, 0))
        assert len(calls) == 2
    assert (np.asarray(image) == (255, 0, 0)).all(axis=2).any()
