"""Candidate poses: where they stand, what they frame, and which of them cannot be."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet
from solids import tessellated_plane

import rastercov as rc
from rastercov.base.errors import ConfigError, PoseError
from rastercov.camera.viewpoints import look_at
from rastercov.mesh import Group, Mesh, shapes
from rastercov.mesh.contacts import TriangleTree
from rastercov.placement import (
    Candidates,
    Framing,
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Rejection,
    filter_candidates,
    from_poses,
    in_solid,
    per_convex_region,
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
from rastercov.reference.criteria import face_geometry

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
    found = per_segment(NOISY, CAMERA, Framing(rolls_deg=(roll,)), segmentation=SEGMENTS)
    assert found.index.tolist() == list(range(20))
    for label in range(20):
        corners = NOISY.vertices[NOISY.faces[SEGMENTS.labels == label]].reshape(-1, 3)
        target, normal = corners.mean(axis=0), SEGMENTS.normals[label]
        pose = found.poses[label]
        np.testing.assert_allclose(pose[:3, 2], -normal, atol=1e-12)
        in_camera = (corners - target) @ pose[:3, :3]
        width, height, _ = np.ptp(in_camera, axis=0)
        d = max(width / 2 / np.tan(CAMERA.hfov / 2), height / 2 / np.tan(CAMERA.vfov / 2))
        np.testing.assert_allclose(pose[:3, 3], target + d * normal, atol=1e-12)
        upright = look_at(target + normal, target)[0, :3, 0]
        assert pose[:3, 0] @ upright == pytest.approx(np.cos(np.radians(roll)))


def test_poses_are_rigid_and_accepted_where_poses_are_taken():
    found = per_segment(NOISY, CAMERA, Framing(rolls_deg=(0, 45)), segmentation=SEGMENTS)
    np.testing.assert_allclose(rc.look_at((1, 0, 0), (0, 0, 0))[0, 3], found.poses[0, 3])
    rotations = found.poses[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (40, 3, 3)), atol=1e-12
    )
    assert (np.linalg.det(rotations) > 0).all()


def test_the_stand_off_follows_height_where_height_is_the_limit():
    wall = Mesh([(0, 0, 0), (0, 0.1, 0), (0, 0.1, 9), (0, 0, 9)], [(0, 1, 2), (0, 2, 3)])
    pose = per_segment(wall, CAMERA, segmentation=segment(wall, 1, 1)).poses[0]
    np.testing.assert_allclose(pose[:3, 3], (9 / 2 / np.tan(CAMERA.vfov / 2), 0.05, 4.5))
    lying = Framing(rolls_deg=(90,))
    pose = per_segment(wall, CAMERA, lying, segmentation=segment(wall, 1, 1)).poses[0]
    np.testing.assert_allclose(pose[0, 3], 9 / 2 / np.tan(CAMERA.hfov / 2))


def test_a_positive_roll_turns_the_camera_clockwise_seen_from_behind():
    wall = sheet((0, 0), (1, 1), 0.0)
    upright, rolled = per_segment(
        wall, CAMERA, Framing(rolls_deg=(0, 90)), segmentation=segment(wall, 1, 1)
    ).poses
    np.testing.assert_allclose(rolled[:3, 0], upright[:3, 1], atol=1e-12)
    np.testing.assert_allclose(rolled[:3, 1], -upright[:3, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("camera", "stand_off", "edge", "wanted"),
    [
        (SHARP, (0, np.inf), 0.01, 0.5),  # z_n
        (SHARP, (0, np.inf), 50, 3.0),  # z_f
        (SHARP, (0.8, 2.0), 0.01, 0.8),
        (SHARP, (0.8, 2.0), 50, 2.0),
        (CAMERA, (0.8, 2.0), 0.01, 0.8),
        (CAMERA, (0.8, 2.0), 50, 2.0),
    ],
)
@pytest.mark.parametrize("fit", ["extent", "vertices"])
def test_the_stand_off_stays_in_its_range_and_in_the_depth_of_field(
    camera, stand_off, edge, wanted, fit
):
    flat = sheet((0, 0), (edge, edge), 0.0)
    framing = Framing(stand_off=stand_off, fit=fit)
    pose = per_segment(flat, camera, framing, segmentation=segment(flat, 1, 1)).poses[0]
    assert abs(pose[2, 3]) == pytest.approx(wanted, rel=1e-8)


def test_a_looser_blur_limit_lets_the_camera_nearer():
    lens = {"width": 640, "height": 400, "focal_length": 8e-3, "pixel_size": 5e-6}
    camera = rc.Camera.from_lens(**lens, f_number=2.0, focus_distance=1.0)
    for blur in (1.0, 4.0):
        found = per_face(NOISY, camera, Framing(max_blur=blur), faces=[0])
        distance = np.linalg.norm(eyes_of(found)[0] - NOISY.centroids[0])
        assert distance == pytest.approx(camera.depth_of_field(blur)[0])


def test_a_stand_off_out_of_focus_is_refused():
    with pytest.raises(ConfigError, match=r"stand-off 5 ... 6 m must meet the depths 0.5 ... 3 m"):
        per_segment(NOISY, SHARP, Framing(stand_off=(5, 6)), segmentation=SEGMENTS)


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
    found = per_segment(mesh, camera, framing, segmentation=segments)
    for label, pose in enumerate(found.poses):
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
    here = per_segment(NOISY, CAMERA, Framing(fit=fit), segmentation=SEGMENTS)
    there_mesh = moved(NOISY, shift)
    segments = segment(there_mesh, 15, 15)
    assert np.array_equal(segments.labels, SEGMENTS.labels)
    there = per_segment(there_mesh, CAMERA, Framing(fit=fit), segmentation=segments)
    np.testing.assert_allclose(eyes_of(there) - shift, eyes_of(here), atol=1e-7)


def test_a_view_along_up_takes_another_up():
    floor = Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    pose = per_segment(floor, CAMERA, segmentation=segment(floor, 1, 1)).poses[0]
    np.testing.assert_allclose(pose[:3, 2], (0, 0, -1))
    sideways = Framing(up=(1, 0, 0))
    pose = per_segment(floor, CAMERA, sideways, segmentation=segment(floor, 1, 1)).poses[0]
    np.testing.assert_allclose(pose[:3, 1], (-1, 0, 0), atol=1e-12)


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
    mesh = Mesh(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)],
        [(0, 1, 2), (0, 1, 1), (1, 3, 2)],
        (Group("part"), Group("clamp", is_occluder=True)),
        [0, 0, 1],
    )
    assert per_face(mesh, CAMERA).index.tolist() == [0]
    assert per_face(mesh, CAMERA, faces=np.array([True, True, True])).index.tolist() == [0, 2]
    assert len(per_face(mesh, CAMERA, faces=[])) == 0
    with pytest.raises(ConfigError, match=r"faces must lie in 0 ... 2, got 1 ... 3"):
        per_face(mesh, CAMERA, faces=[1, 3])
    with pytest.raises(ConfigError, match="faces must be a mask of 3 or rows"):
        per_face(mesh, CAMERA, faces=[True])


def test_the_sides_of_a_pyramid_are_seen_together_from_above_its_tip():  # figure 2.3
    points = [(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0), (0, 0, 0.8)]
    sides = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    pyramid = Mesh(points, [*sides, (0, 2, 1), (0, 3, 2)])
    found = per_convex_region(pyramid, CAMERA)
    assert found.index.tolist() == [0, 1, 2, 3, 4]
    above = found.poses[4]
    np.testing.assert_allclose(above[:3, 2], (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(above[:2, 3], 0, atol=1e-12)
    average = eyes_of(per_face(pyramid, CAMERA, faces=range(4))).mean(axis=0)
    np.testing.assert_allclose(average[:2], 0, atol=1e-12)
    assert face_geometry(pyramid, CAMERA, above).is_front[:4].all()


def test_a_convex_corner_is_seen_along_its_diagonal_however_its_sides_are_divided():
    for n in (1, 3):
        found = per_convex_region(shapes.box(n=n), CAMERA, least_bend_deg=45)
        corners = np.abs(views_of(found)).min(axis=1) > 0.3
        assert corners.sum() == 8
        np.testing.assert_allclose(np.abs(views_of(found)[corners]), 3**-0.5, atol=1e-9)
    assert len(found) == 8 + 12 * 2  # and those along the edges


def test_hollow_open_and_smooth_corners_are_no_convex_regions():
    box = shapes.box()
    assert len(per_convex_region(Mesh(box.vertices, box.faces[:, ::-1]), CAMERA)) == 0
    assert len(per_convex_region(tessellated_plane(), CAMERA)) == 0
    assert len(per_convex_region(shapes.sphere(4), CAMERA)) == 0
    assert len(per_convex_region(shapes.sphere(4), CAMERA, least_bend_deg=0)) == 2562
    opened = Mesh(box.vertices, box.faces[2:])
    assert len(per_convex_region(opened, CAMERA)) == 4
    turned = Mesh(box.vertices, [box.faces[0, ::-1], *box.faces[1:]])
    assert len(per_convex_region(turned, CAMERA)) == 8 - 3
    folded = Mesh(box.vertices, [(0, 1, 2), (0, 2, 1)])
    assert len(per_convex_region(folded, CAMERA)) == 0
    with pytest.raises(ConfigError, match="least_bend_deg must lie in 0"):
        per_convex_region(box, CAMERA, least_bend_deg=200)


def test_an_optical_axis_beside_the_image_is_refused():
    shifted = rc.Camera(width=640, height=400, fx=800, fy=700, cx=-10)
    with pytest.raises(ConfigError, match=r"optical axis \(-10, 200\) px must meet the image"):
        per_segment(NOISY, shifted, segmentation=SEGMENTS)


def test_segments_of_another_mesh_are_refused():
    with pytest.raises(ConfigError, match="the segmentation has 320 faces, the mesh 20"):
        per_segment(shapes.icosahedron(), CAMERA, segmentation=SEGMENTS)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stand_off": (2, 1)}, "stand_off must be 0 <= least <= greatest"),
        ({"stand_off": (-1, 1)}, "stand_off must be"),
        ({"stand_off": (0, float("nan"))}, "stand_off must be"),
        ({"fit": "best"}, "fit must be extent or vertices, got 'best'"),
        ({"margin": 0}, "margin must be positive"),
        ({"rolls_deg": ()}, "rolls_deg must be one angle or more"),
        ({"rolls_deg": (np.inf,)}, "rolls_deg must be"),
        ({"up": (0, 0, 0)}, "up must be a direction"),
        ({"up": (0, 1)}, "up must be a direction"),
    ],
)
def test_a_framing_that_makes_no_sense_is_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        Framing(**options)


# Mounting.


def test_cameras_around_a_part_see_all_of_it_and_look_at_its_middle():
    part = moved(shapes.torus(20, 10), (5, 0, 1))
    found = on_sphere(part, CAMERA, count=50)
    for pose in found.poses:
        seen = face_geometry(part, CAMERA, pose)
        assert seen.in_view.all()
        np.testing.assert_allclose(
            pose[:3, 3] + pose[:3, 2] * (np.linalg.norm(pose[:3, 3] - (5, 0, 1))),
            (5, 0, 1),
            atol=1e-9,
        )
    directions = (eyes_of(found) - (5, 0, 1)) / np.linalg.norm(eyes_of(found)[0] - (5, 0, 1))
    nearest = (directions @ directions.T - 2 * np.eye(50)).max(axis=1)
    assert np.degrees(np.arccos(nearest)).min() > 20  # evenly: 50 caps of 16 degrees fill a sphere
    assert np.allclose(directions.mean(axis=0), 0, atol=0.02)


def test_cameras_around_a_part_stand_beyond_the_near_limit_of_focus():
    ball = shapes.sphere(2, radius=0.1)
    found = on_sphere(ball, SHARP, count=7)
    np.testing.assert_allclose(np.linalg.norm(eyes_of(found), axis=1), 0.6)
    found = on_sphere(ball, SHARP, Framing(stand_off=(0.7, 0.9)), count=7)
    np.testing.assert_allclose(np.linalg.norm(eyes_of(found), axis=1), 0.8)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, -2, 0.5), (0, 0, -1)])
def test_a_hemisphere_is_where_up_is_up(up):
    found = on_hemisphere(NOISY, CAMERA, Framing(up=up), count=40, distances=(1.0, 2.5))
    away = eyes_of(found) - NOISY.bounds.mean(axis=0)
    heights = away @ up / np.linalg.norm(up)
    assert (heights > 0).all()
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), np.repeat((1.0, 2.5), 40))
    np.testing.assert_allclose(heights[:40].mean(), 0.5, atol=1e-9)
    assert (found.poses[:, :3, 1] @ up < 1e-9).all()  # down in the image is not up


def test_positions_on_a_box_are_on_its_sides_once_and_close_enough():
    found = on_box(NOISY, CAMERA, spacing=0.5, bounds=[(0, 0, 0), (2, 1, 1.2)], outward=0.25)
    eyes = eyes_of(found)
    low, high = np.array([-0.25] * 3), np.array([2.25, 1.25, 1.45])
    assert ((eyes == low) | (eyes == high)).any(axis=1).all()
    assert ((eyes >= low) & (eyes <= high)).all()
    assert len(np.unique(eyes, axis=0)) == len(eyes) == 6 * 4 * 5 - 4 * 2 * 3
    for axis, (n, side) in enumerate(((5, 2.5), (3, 1.5), (4, 1.7))):
        ticks = np.unique(eyes[:, axis])
        np.testing.assert_allclose(ticks, np.linspace(low[axis], high[axis], n + 1))
        assert side / n <= 0.5 + 1e-9


def test_a_spacing_that_fits_but_for_rounding_fits():
    found = on_box(NOISY, CAMERA, spacing=0.1, bounds=[(0, 0, 0), (0.1 * 3, 0.1 * 3, 0)])
    assert len(found) == 4 * 4


def test_cameras_look_where_the_rule_says():
    place = {"spacing": 1.0, "bounds": [(-2, -2, 1), (2, 2, 3)]}
    room = shapes.room()
    for aim, target in (
        (at_point((1, 0, 0)), (1, 0, 0)),
        (at_middle(), (0, 0, 1.4)),
        (None, (0, 0, 1.4)),
    ):
        found = on_box(room, CAMERA, **place, aim=aim)
        to_target = target - eyes_of(found)
        np.testing.assert_allclose(
            views_of(found), to_target / np.linalg.norm(to_target, axis=1)[:, None], atol=1e-12
        )
    found = on_box(room, CAMERA, **place, aim=along((0, 3, -4)))
    np.testing.assert_allclose(views_of(found), np.broadcast_to((0, 0.6, -0.8), (len(found), 3)))
    found = on_box(room, CAMERA, **place, aim=at_nearest_surface("crates"))
    crates = np.flatnonzero(room.face_group == 1)
    nearest = NearestSurface(room, room.face_group == 1).query(eyes_of(found))
    assert np.isin(nearest.face, crates).all()
    along_view = np.einsum("ni,ni->n", nearest.point - eyes_of(found), views_of(found))
    np.testing.assert_allclose(along_view, nearest.distance)


def test_a_camera_on_its_own_target_is_left_out():
    found = on_box(
        NOISY, CAMERA, spacing=1.0, bounds=[(0, 0, 0), (2, 2, 2)], aim=at_point((1, 1, 2))
    )
    assert len(found) == 26 - 1


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
    found = from_poses(NOISY, CAMERA, poses=tmp_path / "rig.json")
    np.testing.assert_array_equal(found.poses, poses)
    assert found.index.tolist() == [0, 1, 2, 3, 4]
    rolled = from_poses(NOISY, CAMERA, Framing(rolls_deg=(0, 90)), poses=poses)
    assert rolled.index.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    np.testing.assert_array_equal(eyes_of(rolled), np.repeat(poses[:, :3, 3], 2, axis=0))
    with pytest.raises(PoseError):
        from_poses(NOISY, CAMERA, poses=np.zeros((2, 4, 4)))


def test_candidates_add_up_and_remember_where_they_come_from():
    faces, ball = per_face(NOISY, CAMERA, faces=[3, 4]), on_sphere(NOISY, CAMERA, count=2)
    more = per_face(NOISY, CAMERA, faces=[9])
    for total in ((faces + ball) + more, faces + (ball + more)):
        assert total.source.tolist() == ["face", "face", "sphere", "sphere", "face"]
        assert total.index.tolist() == [3, 4, -1, -1, 9]
        assert total.counts() == {"face": 3, "sphere": 2}
        np.testing.assert_array_equal(
            total.poses, np.concatenate((faces.poses, ball.poses, more.poses))
        )
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
    found = NearestSurface(mesh).query(points)
    triangles = mesh.vertices[mesh.faces]
    for row, point in enumerate(points):
        nearest = trimesh.triangles.closest_point(triangles, np.broadcast_to(point, (n, 3)))
        distance = np.linalg.norm(nearest - point, axis=1).min()
        assert found.distance[row] == pytest.approx(distance, abs=1e-12 * max(1, shift))
        assert np.linalg.norm(found.point[row] - point) == pytest.approx(
            found.distance[row], abs=1e-10 if shift else 1e-12
        )
        mine = trimesh.triangles.closest_point(triangles[[found.face[row]]], point[None])
        assert np.linalg.norm(mine - point) == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_no_ray_slips_through_where_faces_meet(axis):
    """Rays along the axes, right through vertices and edges of a box in a lattice."""
    box = shapes.box((1, 1, 1), n=4)
    ticks = np.arange(-3, 4) / 4 + 0.0
    points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[(np.abs(points) != 0.5).all(axis=1)]
    tree = TriangleTree.over(np.roll(box.vertices, axis, axis=1), box.faces)
    assert np.array_equal(tree.winding_numbers(points), (np.abs(points) < 0.5).all(axis=1))


def test_a_cavity_is_air_and_a_part_in_it_is_not():
    cavity = shapes.sphere(2, 2.0)
    nested = joined(
        shapes.sphere(2, 3.0), Mesh(cavity.vertices, cavity.faces[:, ::-1]), shapes.sphere(2, 1.0)
    )
    points = [(0, 0, r) for r in (0.5, 1.5, 2.5, 3.5)]
    assert in_solid(nested, points).tolist() == [True, False, True, False]


def test_overlapping_parts_are_solid_together():
    pair = joined(shapes.box(), shapes.box(centre=(0.5, 0, 0)))
    points = [(-0.3, 0, 0.1), (0.2, 0, 0.1), (0.8, 0, 0.1), (1.2, 0, 0.1)]
    assert in_solid(pair, points).tolist() == [True, True, True, False]


def test_a_room_is_air_and_its_crates_and_all_beyond_it_are_not():
    points = [(0, 0, 1), (-1.5, -1, 0.6), (4, 0, 1), (0, 0, -0.2), (0, 2, 2.7)]
    assert in_solid(shapes.room(), points).tolist() == [False, True, True, True, False]


def test_one_part_turned_inside_out_does_not_fill_the_world():
    flipped = shapes.sphere(1, 0.2)
    mesh = joined(shapes.box(), moved(Mesh(flipped.vertices, flipped.faces[:, ::-1]), (3, 0, 0)))
    assert in_solid(mesh, [(0, 0, 0.1), (2, 0, 0), (9, 0, 0)]).tolist() == [True, False, False]


def test_winding_that_means_nothing_makes_no_room():
    ball = shapes.sphere(1)
    inward = Mesh(ball.vertices, ball.faces[:, ::-1])
    assert in_solid(inward, [(3, 0, 0)]).all()
    assert not in_solid(inward.with_groups(two_sided="all"), [(3, 0, 0)]).any()


def test_an_open_surface_encloses_nothing_and_leaves_closed_ones_as_they_are():
    box = shapes.box()
    opened = Mesh(box.vertices, box.faces[1:])
    assert not in_solid(opened, [(0, 0, 0)]).any()
    both = joined(opened, shapes.box(centre=(3, 0, 0)))
    assert in_solid(both, [(0, 0, 0.1), (3, 0, 0.1)]).tolist() == [False, True]
    flap = Mesh(box.vertices, [*box.faces.tolist(), [0, 0, 1]])
    assert in_solid(flap, [(0, 0, 0.1)]).all()


def test_the_report_says_what_was_dropped_and_why():
    torus = shapes.torus(60, 30)
    points = [
        (1, 0, 0),  # in the tube
        (0, 0, 0),  # in the hub
        (0, 0, 0.9),  # in hub and ball: the first one given
        (0, 0, 2.0),
        (2.5, 0, 0),
        (1.45, 0, 0),  # 5 cm from the tube
        (1.55, 0, 0),
    ]
    volumes = (KeepOutBox((-0.1, -0.1, -1), (0.1, 0.1, 1), "hub"), KeepOutSphere((0, 0, 0), 0.95))
    left, dropped = filter_candidates(standing_at(points), torus, 0.1, volumes)
    none, near, kept_out, solid = Rejection
    assert dropped.rejection.tolist() == [solid, kept_out, kept_out, none, none, near, none]
    np.testing.assert_array_equal(eyes_of(left), np.array(points)[[3, 4, 6]])
    assert dropped.summary() == {
        "candidates": 7,
        "kept": 3,
        "in_solid": 1,
        "kept_out": {"hub": 2, "sphere": 0},
        "too_near": 1,
        "clearance": 0.1,
    }
    assert str(dropped) == (
        "4 of 7 candidates dropped: 1 in a solid, 2 in keep-out hub, "
        "1 nearer than 0.1 m to a surface"
    )
    everything, none = filter_candidates(standing_at(points[3:5]), torus)
    assert len(everything) == 2
    assert str(none) == "0 of 2 candidates dropped"


def test_clearance_counts_occluders_and_open_sheets_from_both_sides():
    wall = sheet((-1, -1), (1, 1), 0.0).with_groups(occluders=["mesh"])
    _, dropped = filter_candidates(
        standing_at([(0, 0, 0.2), (0, 0, -0.2), (0, 0, 0.4), (1.2, 0, 0)]), wall, 0.3
    )
    assert dropped.kept_mask.tolist() == [False, False, True, False]


def test_a_keep_out_volume_may_be_anything_that_contains_points():
    class Above:
        name = "above"

        def contains(self, points):
            return points[:, 2] > 1

    _, dropped = filter_candidates(
        standing_at([(5, 0, 0.5), (5, 0, 1.5)]), shapes.box(), 0, [Above()]
    )
    assert dropped.summary()["kept_out"] == {"above": 1}


def test_no_candidates_are_no_error():
    none = standing_at(np.zeros((1, 3))).take([])
    left, dropped = filter_candidates(none, shapes.box(), 0.1, [KeepOutSphere((0, 0, 0), 1)])
    assert len(left) == dropped.summary()["candidates"] == 0
    nothing = shapes.box().with_groups(occluders=["mesh"])
    assert len(per_segment(nothing, CAMERA, segmentation=segment(nothing, 15, 25))) == 0
    assert len(per_face(nothing, CAMERA)) == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: on_sphere(NOISY, CAMERA, count=0), "count must be a whole number"),
        (lambda: on_sphere(NOISY, CAMERA, count=True), "count must be"),
        (lambda: on_sphere(NOISY, CAMERA, count=3, distances=-1), "distances must be positive"),
        (lambda: on_sphere(NOISY, CAMERA, count=3, centre=(1, 2)), "centre must be three"),
        (lambda: on_box(NOISY, CAMERA, spacing=0), "spacing must be positive"),
        (lambda: on_box(NOISY, CAMERA, spacing=1e-5), "more than 10000000 positions"),
        (lambda: on_box(NOISY, CAMERA, spacing=1, sides=["top"]), "sides must be among .* got top"),
        (lambda: on_box(NOISY, CAMERA, spacing=1, bounds=[0, 1]), "bounds must be two finite"),
        (lambda: on_box(NOISY, CAMERA, spacing=1, outward=-5), "the box must have low <= high"),
        (lambda: along((0, 0, 0)), "direction must not be zero"),
        (
            lambda: on_box(NOISY, CAMERA, spacing=1, aim=at_nearest_surface("lid")),
            r"groups must be among \['mesh'\], got \['lid'\]",
        ),
        (lambda: filter_candidates(ORIGIN, NOISY, -1), "clearance must be 0 m or more"),
        (lambda: filter_candidates(ORIGIN, NOISY, np.inf), "clearance must be 0 m or more"),
        (lambda: KeepOutBox((0, 0, 1), (1, 1, 0)), "a keep-out box needs low <= high"),
        (lambda: KeepOutSphere((0, 0, 0), 0), "a keep-out sphere needs a centre and a radius > 0"),
        (lambda: NearestSurface(NOISY, np.zeros(NOISY.n_faces, bool)), "no face with an area is"),
    ],
)
def test_a_mounting_or_a_clearance_that_makes_no_sense_is_refused(call, message):
    with pytest.raises(ConfigError, match=message):
        call()
