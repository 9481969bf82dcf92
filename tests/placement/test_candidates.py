"""Candidate poses: where they stand, what they frame, and which of them cannot be."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet

import rastercov as rc
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.placement import (
    Candidates,
    Framing,
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Place,
    filter_candidates,
    from_poses,
    in_solid,
    per_face,
    per_segment,
    segment,
)
from rastercov.placement.candidates.mounting import (
    along,
    at_middle,
    at_nearest_surface,
    at_point,
    on_box,
    on_ceiling,
    on_hemisphere,
    on_sphere,
    on_walls,
)
from rastercov.reference.coverage import face_geometry

CAMERA = rc.Camera(width=640, height=400, fx=800, fy=700)
SHARP = rc.Camera(width=640, height=400, fx=800, fy=700, focus_range=(0.5, 3.0))
NOISY = shapes.icosahedron(0.04, 2, edge_length=0.3)
SEGMENTS = segment(NOISY, 15, 15)


def eyes_of(candidates):
    return candidates.poses[:, :3, 3]


def views_of(candidates):
    return candidates.poses[:, :3, 2]


def moved(mesh, shift):
    return Mesh(mesh.vertices + shift, mesh.faces, mesh.groups, mesh.face_group)


def standing_at(points):
    points = np.asarray(points, float)
    return Candidates.of(look_at(points, points + np.array((1, 0, 0))), "point")


ORIGIN = standing_at([(0, 0, 0)])


# Views square to a surface.


@pytest.mark.parametrize("roll", [0.0, 90.0, -30.0])
def test_the_eye_stands_along_the_average_normal_at_the_corrected_distance(roll):
    """eye = T_S + d n, d = max(z_n, W/2 cot(HFOV/2), H/2 cot(VFOV/2))."""
    segments = per_segment(NOISY, CAMERA, Framing(rolls_deg=(roll,)), segmentation=SEGMENTS)
    assert segments.index.tolist() == list(range(20))
    for label in range(20):
        corners = NOISY.vertices[NOISY.faces[SEGMENTS.labels == label]].reshape(-1, 3)
        target, normal = corners.mean(axis=0), SEGMENTS.normals[label]
        pose = segments.poses[label]
        np.testing.assert_allclose(pose[:3, 2], -normal, atol=1e-12)
        in_camera = (corners - target) @ pose[:3, :3]
        width, height, _ = np.ptp(in_camera, axis=0)
        d = max(width * CAMERA.fx / CAMERA.width, height * CAMERA.fy / CAMERA.height)
        np.testing.assert_allclose(pose[:3, 3], target + d * normal, atol=1e-12)
        # Clockwise seen from behind: x turns towards y.
        right, down = look_at(target + normal, target)[0, :3, :2].T
        turned = np.cos(np.radians(roll)) * right + np.sin(np.radians(roll)) * down
        np.testing.assert_allclose(pose[:3, 0], turned, atol=1e-12)


@pytest.mark.parametrize("fit", ["extent", "vertices"])
def test_the_stand_off_stays_in_its_range_and_in_the_depth_of_field(fit):
    ranges = [(SHARP, (0, np.inf), (0.5, 3.0)), (SHARP, (0.8, 2.0), (0.8, 2.0))]  # z_n, z_f
    for camera, stand_off, wanted in (*ranges, (CAMERA, (0.8, 2.0), (0.8, 2.0))):
        for edge, distance in zip((0.01, 50), wanted, strict=True):
            flat = sheet((0, 0), (edge, edge), 0.0)
            framing = Framing(stand_off=stand_off, fit=fit)
            pose = per_segment(flat, camera, framing, segmentation=segment(flat, 1, 1)).poses[0]
            assert abs(pose[2, 3]) == pytest.approx(distance, rel=1e-8)


def test_a_looser_blur_limit_lets_the_camera_nearer():
    lens = {"width": 640, "height": 400, "focal_length": 8e-3, "pixel_size": 5e-6}
    camera = rc.Camera.from_lens(**lens, f_number=2.0, focus_distance=1.0)
    for blur in (1.0, 4.0):
        result = per_face(NOISY, camera, Framing(max_blur=blur), faces=[0])
        distance = np.linalg.norm(eyes_of(result)[0] - NOISY.centroids[0])
        assert distance == pytest.approx(camera.depth_of_field(blur)[0])


@given(
    noise=st.floats(0, 0.15),
    seed=st.integers(0, 10**6),
    roll=st.floats(-180, 180),
    margin=st.floats(1, 2),
    cx=st.floats(200, 440),
    near=st.floats(0.1, 6),
)
@examples(15)
def test_all_vertices_are_in_view_and_focus_when_vertices_are_to_fit(
    noise, seed, roll, margin, cx, near
):
    mesh = shapes.icosahedron(noise, 1, seed)
    camera = rc.Camera(width=640, height=400, fx=500, fy=700, cx=cx, focus_range=(near, 1e6))
    segments = segment(mesh, 20, 30)
    framing = Framing(fit="vertices", rolls_deg=(roll,), margin=margin)
    result = per_segment(mesh, camera, framing, segmentation=segments)
    for label, pose in enumerate(result.poses):
        mine = segments.labels == label
        assert face_geometry(mesh, camera, pose).in_view[mine].all()
        depths = (mesh.vertices[mesh.faces[mine]].reshape(-1, 3) - pose[:3, 3]) @ pose[:3, 2]
        assert depths.min() >= near


def test_fitting_vertices_goes_no_farther_than_it_must():
    for label, pose in enumerate(
        per_segment(NOISY, CAMERA, Framing(fit="vertices"), segmentation=SEGMENTS).poses
    ):
        pose = pose.copy()
        pose[:3, 3] += 1e-4 * pose[:3, 2]
        assert not face_geometry(NOISY, CAMERA, pose).in_view[SEGMENTS.labels == label].all()


def test_the_farthest_vertex_is_in_focus_where_not_all_can_be_in_view():
    points = [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0), (4.5, 4.5, 1)]
    roof = Mesh(points, [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    camera = rc.Camera(width=640, height=400, fx=800, fy=700, focus_range=(0.5, 4.0))
    segments = segment(roof, 30, None)
    pose = per_segment(roof, camera, Framing(fit="vertices"), segmentation=segments).poses[0]
    depths = (roof.vertices - pose[:3, 3]) @ pose[:3, 2]
    assert depths.max() == pytest.approx(4.0)


@pytest.mark.parametrize("fit", ["extent", "vertices"])
def test_far_from_the_origin_views_are_the_same(fit):
    shift = np.array([2.0**23, -(2.0**22), 2.0**21])
    far = moved(NOISY, shift)
    here = per_segment(NOISY, CAMERA, Framing(fit=fit), segmentation=SEGMENTS)
    there = per_segment(far, CAMERA, Framing(fit=fit), segmentation=segment(far, 15, 15))
    np.testing.assert_allclose(eyes_of(there) - shift, eyes_of(here), atol=1e-7)


def test_one_face_a_segment_gives_one_view_a_face():
    solid = shapes.icosahedron()
    by_face = per_face(solid, CAMERA)
    by_segment = per_segment(solid, CAMERA, segmentation=segment(solid, 15, None))
    np.testing.assert_allclose(by_face.poses, by_segment.poses, atol=1e-12)
    assert by_face.source.tolist() == ["face"] * 20
    some = per_face(solid, CAMERA, faces=[7, 3])
    assert some.index.tolist() == [7, 3]
    np.testing.assert_array_equal(some.poses, by_face.poses[[7, 3]])


def test_views_of_faces_leave_out_occluders_and_what_has_no_area():
    points, faces = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 2), (0, 1, 1), (1, 3, 2)]
    mesh = Mesh(points, faces, (Group("part"), Group("clamp", is_occluder=True)), [0, 0, 1])
    for chosen, wanted in ((None, [0]), (np.array([True, True, True]), [0, 2]), ([], [])):
        assert per_face(mesh, CAMERA, faces=chosen).index.tolist() == wanted


# Mounting.


def test_cameras_around_a_part_see_all_of_it_and_look_at_its_middle():
    middle = np.array([5, 0, 1])
    part = moved(shapes.torus(20, 10), middle)
    points = on_sphere(part, CAMERA, count=50)
    assert all(face_geometry(part, CAMERA, pose).in_view.all() for pose in points.poses)
    away = eyes_of(points) - middle
    directions = away / np.linalg.norm(away[0])
    np.testing.assert_allclose(views_of(points), -directions, atol=1e-9)
    nearest = (directions @ directions.T - 2 * np.eye(50)).max(axis=1)
    assert np.degrees(np.arccos(nearest)).min() > 20  # evenly: 50 caps of 16 degrees fill a sphere
    assert np.allclose(directions.mean(axis=0), 0, atol=0.02)


def test_cameras_around_a_part_stand_beyond_the_near_limit_of_focus():
    ball = shapes.sphere(2, radius=0.1)
    points = on_sphere(ball, SHARP, count=7)
    np.testing.assert_allclose(np.linalg.norm(eyes_of(points), axis=1), 0.6)
    points = on_sphere(ball, SHARP, Framing(stand_off=(0.7, 0.9)), count=7)
    np.testing.assert_allclose(np.linalg.norm(eyes_of(points), axis=1), 0.8)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, -2, 0.5), (0, 0, -1)])
def test_a_hemisphere_is_where_up_is_up(up):
    result = on_hemisphere(NOISY, CAMERA, Framing(up=up), count=40, distances=(1.0, 2.5))
    away = eyes_of(result) - NOISY.bounds.mean(axis=0)
    heights = away @ up / np.linalg.norm(up)
    assert (heights > 0).all()
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), np.repeat((1.0, 2.5), 40))
    np.testing.assert_allclose(heights[:40].mean(), 0.5, atol=1e-9)
    assert (result.poses[:, :3, 1] @ up < 1e-9).all()  # down in the image is not up


def test_positions_on_a_box_are_on_its_sides_once_and_close_enough():
    points = on_box(NOISY, CAMERA, spacing=0.5, bounds=[(0, 0, 0), (2, 1, 1.2)], outward=0.25)
    eyes = eyes_of(points)
    low, high = np.array([-0.25] * 3), np.array([2.25, 1.25, 1.45])
    assert ((eyes == low) | (eyes == high)).any(axis=1).all()
    assert ((eyes >= low) & (eyes <= high)).all()
    assert len(np.unique(eyes, axis=0)) == len(eyes) == 6 * 4 * 5 - 4 * 2 * 3
    for axis, (n, side) in enumerate(((5, 2.5), (3, 1.5), (4, 1.7))):
        ticks = np.unique(eyes[:, axis])
        np.testing.assert_allclose(ticks, np.linspace(low[axis], high[axis], n + 1))
        assert side / n <= 0.5 + 1e-9


def test_positions_fit_in_spite_of_rounding_and_none_is_its_own_target():
    assert len(on_box(NOISY, CAMERA, spacing=0.1, bounds=[(0, 0, 0), (0.1 * 3, 0.1 * 3, 0)])) == 16
    cube, aim = [(0, 0, 0), (2, 2, 2)], at_point((1, 1, 2))
    assert len(on_box(NOISY, CAMERA, spacing=1.0, bounds=cube, aim=aim)) == 26 - 1


def test_cameras_look_where_the_rule_says():
    room = shapes.room()
    crates = room.face_group == 1

    def looking(aim):
        points = on_box(room, CAMERA, spacing=1.0, bounds=[(-2, -2, 1), (2, 2, 3)], aim=aim)
        return eyes_of(points), views_of(points)

    middle = (0, 0, 1.4)
    for aim, target in ((at_point((1, 0, 0)), (1, 0, 0)), (at_middle(), middle), (None, middle)):
        eyes, views = looking(aim)
        rays = target - eyes
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        np.testing.assert_allclose(views, rays, atol=1e-12)
    np.testing.assert_allclose(looking(along((0, 3, -4)))[1] - (0, 0.6, -0.8), 0, atol=1e-12)
    eyes, views = looking(at_nearest_surface("crates"))
    nearest = NearestSurface(room, crates).query(eyes)
    assert crates[nearest.face].all()
    along_view = np.einsum("ni,ni->n", nearest.point - eyes, views)
    np.testing.assert_allclose(along_view, nearest.distance)


def test_walls_and_ceiling_of_a_room():
    room = shapes.room()
    walls = on_walls(room, CAMERA, spacing=1.0, heights=(2.0, 2.5), inset=0.2)
    x, y, z = eyes_of(walls).T
    np.testing.assert_allclose(np.maximum(np.abs(x) / 2.8, np.abs(y) / 2.3), 1)
    assert (z.min(), z.max()) == (2.0, 2.5)
    ceiling = on_ceiling(room, CAMERA, spacing=1.0, inset=0.2)
    np.testing.assert_allclose(eyes_of(ceiling)[:, 2], 2.6)
    assert np.ptp(eyes_of(ceiling), axis=0)[:2] == pytest.approx((5.6, 4.6))
    both = walls + ceiling
    assert both.counts() == {"walls": len(walls), "ceiling": len(ceiling)}
    assert len(filter_candidates(both, room, 0.15)[0]) == len(both)


def test_a_pose_file_gives_its_poses(tmp_path):
    poses = rc.sphere_of_poses((0, 0, 0), 2.0, 5)
    rc.write_poses(tmp_path / "rig.json", poses)
    np.testing.assert_array_equal(
        from_poses(NOISY, CAMERA, poses=tmp_path / "rig.json").poses, poses
    )
    rolled = from_poses(NOISY, CAMERA, Framing(rolls_deg=(0, 90)), poses=poses)
    assert rolled.index.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    np.testing.assert_array_equal(eyes_of(rolled), np.repeat(poses[:, :3, 3], 2, axis=0))


def test_candidates_add_up_and_remember_where_they_come_from():
    faces, ball = per_face(NOISY, CAMERA, faces=[3, 4]), on_sphere(NOISY, CAMERA, count=2)
    parts = (faces, ball, per_face(NOISY, CAMERA, faces=[9]))
    for total in ((parts[0] + parts[1]) + parts[2], parts[0] + (parts[1] + parts[2])):
        assert total.source.tolist() == ["face", "face", "sphere", "sphere", "face"]
        assert total.index.tolist() == [3, 4, -1, -1, 9]
        assert total.counts() == {"face": 3, "sphere": 2}
        np.testing.assert_array_equal(total.poses, np.concatenate([each.poses for each in parts]))
    chosen = total.take([4, 2])
    assert list(zip(chosen.source, chosen.index, strict=True)) == [("face", 9), ("sphere", -1)]
    with pytest.raises(ValueError, match="read-only"):
        total.poses[0] = 0


# Where a camera can stand.


def solid_angle(mesh, point, faces=slice(None)):
    """How often faces enclose a point (A. van Oosterom, J. Strackee, 1983)."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[faces]] - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    over = np.einsum("ij,ij->i", a, np.cross(b, c))
    under = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (a * c).sum(1) * lb
    return np.arctan2(over, under).sum() / (2 * np.pi)


@pytest.mark.slow
@given(noise=st.floats(0, 0.5), seed=st.integers(0, 10**6), scale=st.sampled_from((1e-3, 1, 1e4)))
@examples(10)
def test_inside_is_where_the_surface_fills_the_view(noise, seed, scale):
    mesh = shapes.icosahedron(noise, 2, seed, edge_length=scale)
    rng = np.random.default_rng(seed)
    points = rng.uniform(*mesh.bounds, (60, 3))
    wanted = [solid_angle(mesh, point) > 0.5 for point in points]
    far = NearestSurface(mesh).query(points).distance > 1e-9 * scale
    assert np.array_equal(in_solid(mesh, points)[far], np.array(wanted)[far])


@given(seed=st.integers(0, 10**6), n=st.integers(1, 200), shift=st.sampled_from((0.0, 1e5)))
@examples(15)
def test_nearest_points_are_those_of_brute_force(seed, n, shift):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(n, 1, 3)) + rng.normal(size=(n, 3, 3)) * rng.uniform(0.01, 1)
    mesh = Mesh((corners + shift).reshape(-1, 3), np.arange(3 * n).reshape(n, 3))
    points = rng.normal(size=(20, 3)) * 2 + shift
    query, triangles = NearestSurface(mesh).query(points), mesh.vertices[mesh.faces]
    for point, face, near, distance in zip(
        points, query.face, query.point, query.distance, strict=True
    ):
        of_all = trimesh.triangles.closest_point(triangles, np.broadcast_to(point, (n, 3)))
        distances = np.linalg.norm(of_all - point, axis=1)
        assert distance == pytest.approx(distances.min(), abs=1e-12 * max(1, shift))
        assert distances[face] == pytest.approx(distance, abs=1e-9)
        assert np.linalg.norm(near - point) == pytest.approx(distance, abs=1e-10)


@pytest.mark.parametrize("axis", range(3))
def test_no_ray_slips_through_where_faces_meet(axis):
    """Rays along the axes, right through vertices and edges of a box in a lattice."""
    box = shapes.box((1, 1, 1), n=4)
    ticks = np.arange(-3, 4) / 4 + 0.0
    points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[(np.abs(points) != 0.5).all(axis=1)]
    mesh = Mesh(np.roll(box.vertices, axis, axis=1), box.faces)
    assert np.array_equal(in_solid(mesh, points), (np.abs(points) < 0.5).all(axis=1))


def inside_out(mesh):
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


BOX, BALL = shapes.box(), shapes.sphere(1)
OPENED = Mesh(BOX.vertices, BOX.faces[1:])
SOLID = {
    "a cavity is air, and a part in it is not": (
        joined(shapes.sphere(2, 3.0), inside_out(shapes.sphere(2, 2.0)), BALL),
        {(0, 0, 0.5): True, (0, 0, 1.5): False, (0, 0, 2.5): True, (0, 0, 3.5): False},
    ),
    "overlapping parts are solid together": (
        joined(BOX, shapes.box(centre=(0.5, 0, 0))),
        {(-0.3, 0, 0.1): True, (0.2, 0, 0.1): True, (0.8, 0, 0.1): True, (1.2, 0, 0.1): False},
    ),
    "a room is air, its crates and all beyond it are not": (
        shapes.room(),
        {(0, 0, 1): False, (-1.5, -1, 0.6): True, (4, 0, 1): True, (0, 0, -0.2): True},
    ),
    "a part turned inside out does not fill the world": (
        joined(BOX, moved(inside_out(shapes.sphere(1, 0.2)), (3, 0, 0))),
        {(0, 0, 0.1): True, (2, 0, 0): False, (9, 0, 0): False},
    ),
    "an inward surface is a room": (inside_out(BALL), {(3, 0, 0): True}),
    "winding of two-sided faces means nothing": (
        inside_out(BALL).with_groups(two_sided="all"), {(3, 0, 0): False},
    ),
    "an open surface encloses what sees its back": (
        joined(OPENED, shapes.box(centre=(3, 0, 0))),
        {(0, 0, 0.1): True, (0, 0, 0.7): False, (3, 0, 0.1): True},
    ),
    "a face without area opens nothing": (
        Mesh(BOX.vertices, [*BOX.faces.tolist(), [0, 0, 1]]), {(0, 0, 0.1): True},
    ),
}  # fmt: skip


@pytest.mark.parametrize("law", SOLID)
def test_a_point_is_in_matter_by_the_winding_of_closed_parts(law):
    mesh, points = SOLID[law]
    assert in_solid(mesh, list(points)).tolist() == list(points.values())


def test_candidates_are_dropped_for_the_place_where_they_stand():
    none, near, kept_out, solid = Place.ALLOWED, Place.TOO_NEAR, Place.KEPT_OUT, Place.IN_SOLID
    places = {
        (1, 0, 0): solid,  # in the tube
        (0, 0, 0): kept_out,  # in the hub
        (0, 0, 0.9): kept_out,  # in hub and ball
        (0, 0, 2.0): none,
        (2.5, 0, 0): none,
        (1.45, 0, 0): near,  # 5 cm from the tube
        (1.55, 0, 0): none,
    }
    volumes = (KeepOutBox((-0.1, -0.1, -1), (0.1, 0.1, 1), "hub"), KeepOutSphere((0, 0, 0), 0.95))
    torus, points = shapes.torus(60, 30), np.array(list(places))
    left, place = filter_candidates(standing_at(points), torus, 0.1, volumes)
    assert place.tolist() == list(places.values())
    np.testing.assert_array_equal(eyes_of(left), points[[3, 4, 6]])


def test_clearance_counts_occluders_and_open_sheets_from_both_sides():
    wall = sheet((-1, -1), (1, 1), 0.0).with_groups(occluders=["mesh"])
    _, place = filter_candidates(
        standing_at([(0, 0, 0.2), (0, 0, -0.2), (0, 0, 0.4), (1.2, 0, 0)]), wall, 0.3
    )
    assert (place == Place.ALLOWED).tolist() == [False, False, True, False]


def test_a_keep_out_volume_may_be_anything_that_contains_points():
    above = SimpleNamespace(name="above", contains=lambda points: points[:, 2] > 1)
    two = standing_at([(5, 0, 0.5), (5, 0, 1.5)])
    _, place = filter_candidates(two, shapes.box(), 0, [above])
    assert place.tolist() == [Place.ALLOWED, Place.KEPT_OUT]


def test_no_candidates_are_no_error():
    left, place = filter_candidates(ORIGIN.take([]), shapes.box(), 0.1)
    assert len(left) == len(place) == 0
    nothing = shapes.box().with_groups(occluders=["mesh"])
    assert len(per_segment(nothing, CAMERA, segmentation=segment(nothing, 15, 25))) == 0
    assert len(per_face(nothing, CAMERA)) == 0
