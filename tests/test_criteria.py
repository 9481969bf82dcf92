"""The criteria that follow from geometry alone: by law, by hand, and on hostile meshes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import square

from rastercov import Task, evaluate
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import near_limit
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh
from rastercov.engine.coverage_angles import incidence_angle
from rastercov.reference import coverage
from rastercov.reference.coverage import clip_near, in_focus, polygon_area
from rastercov.reference.coverage import measure_geometry as face_geometry

CAMERA = Camera(width=200, height=200, fx=100, fy=100)
UNEVEN = Camera(width=640, height=480, fx=500, fy=400, cx=100, cy=350)
AHEAD = np.eye(4)  # at the origin, looking along +z

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def triangles(*corners, **options):
    points = np.array(corners, dtype=np.float64).reshape(-1, 3)
    return Mesh(vertices=points, faces=np.arange(len(points)).reshape(-1, 3), **options)


def tilted(angle, half=1e-6, z=2.0):
    """Small triangle with its centroid on the axis at depth z, turned by `angle` about x."""
    c, s = math.cos(angle), math.sin(angle)
    flat = half * np.array([(-1, -1), (-1, 1), (2, 0)])
    return triangles([(x, c * y, z + s * y) for x, y in flat])


def random_pose(rng):
    return look_at(rng.normal(size=3) * 3, rng.normal(size=3), rng.normal(size=3))[0]


def random_mesh(rng, n=40):
    return triangles(rng.normal(size=(3 * n, 3)))


# --- projected area -------------------------------------------------------------------------------


@pytest.mark.parametrize("z", [0.5, 2.0, 40.0])
@pytest.mark.parametrize("camera", [CAMERA, UNEVEN])
def test_area_of_a_frontal_square_is_fx_fy_area_over_depth_squared(camera, z):
    view = coverage.face_geometry(square(0.05, z), camera, AHEAD)
    assert view.projected_area.sum() == pytest.approx(camera.fx * camera.fy * 0.01 / z**2)
    assert view.perimeter[0] == pytest.approx(
        0.1 / z * (camera.fx + camera.fy + math.hypot(camera.fx, camera.fy))
    )


def test_area_through_the_near_plane_is_of_the_part_beyond_it():
    # Without clipping the corner behind the camera is mirrored, and the area is far too small.
    mesh = triangles((-0.5, 0.25, 3), (0.5, 0.25, 3), (0, 0.25, -1))
    camera = Camera(width=200, height=200, fx=100, fy=100, near=0.125)
    view = coverage.face_geometry(mesh, camera, AHEAD)
    assert view.projected_area == pytest.approx([445625 / 18], rel=1e-14)
    assert np.isposinf(view.perimeter).all()
    assert not view.in_view.any()
    assert view.pixel_density == [0]


# --- field of view --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("centre", "inside"),
    [((0, 0), True), ((1.5, 0), True), ((1.5, -1.5), True), ((1.501, 0), False), ((0, 9), False)],
)
def test_in_view_is_all_or_nothing_and_the_border_is_inside(centre, inside):
    # Half the image is 2 m wide at 2 m: a square of half 0.5 touches the border at 1.5.
    view = face_geometry(square(0.5, 2, centre), CAMERA, AHEAD)
    assert view.in_view.tolist() == [inside, inside]
    assert inside <= (view.in_view_fraction == 1).all()


@pytest.mark.slow
@given(seeds, st.integers(1, 639))
def test_fractions_of_two_half_images_add_up_to_the_whole(rng, middle):
    mesh, pose = random_mesh(rng), random_pose(rng)
    left = Camera(width=middle, height=480, fx=500, fy=400, cx=100, cy=350)
    right = Camera(width=640 - middle, height=480, fx=500, fy=400, cx=100 - middle, cy=350)
    whole, one, other = (
        face_geometry(mesh, camera, pose).in_view_fraction for camera in (UNEVEN, left, right)
    )
    assert one + other == pytest.approx(whole, abs=1e-9)


# --- resolution -----------------------------------------------------------------------------------


# --- facing ---------------------------------------------------------------------------------------


@pytest.mark.slow
@given(seeds)
def test_front_is_the_sign_of_the_projected_area(rng):
    mesh, pose = random_mesh(rng), random_pose(rng)
    near = near_limit(UNEVEN, mesh.bounds, pose[None])[0]
    polygons, counts = clip_near(to_camera(mesh.vertices, pose)[mesh.faces], near)
    # Counter-clockwise from outside runs counter-clockwise in the image, where v runs down.
    area = polygon_area(to_image(np.where(polygons == 0, 1, polygons), UNEVEN), counts)
    sure = np.abs(area) > 1e-3
    assert np.array_equal(face_geometry(mesh, UNEVEN, pose).is_front[sure], area[sure] < 0)


def test_front_follows_the_ray_and_not_the_optical_axis():
    # Definition 3 calls this face self-occluding: its normal is 79 degrees from the axis.
    mesh = triangles((1.9, -0.3, 4), (2.1, -0.3, 5), (1.96, 0.3, 4.3))
    view = face_geometry(mesh, CAMERA, AHEAD)
    assert np.degrees(np.arccos(mesh.normals[0, 2])) == pytest.approx(78.69, abs=0.01)
    assert view.is_front.all()
    assert view.in_view.all()
    assert view.incidence[0] < math.pi / 2


def test_a_two_sided_face_is_seen_at_the_same_angle_from_either_side():
    for angle in (0.0, 0.3, 1.2):
        mesh = tilted(angle).with_groups(two_sided="all")
        turned = Mesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1], groups=mesh.groups)
        for side in (mesh, turned):
            view = face_geometry(side, CAMERA, AHEAD)
            assert view.incidence == pytest.approx(angle, abs=1e-6)
            assert view.is_front.all()


def test_edge_on_is_front_from_neither_side():
    mesh = triangles((0, 0, 1), (0, 1, 2), (0, -1, 3))
    for sheet in (mesh, mesh.with_groups(two_sided="all")):
        view = face_geometry(sheet, CAMERA, AHEAD)
        assert not view.is_front.any()
        assert view.incidence == pytest.approx([math.pi / 2])
        assert view.projected_area == [0]


# --- incidence ------------------------------------------------------------------------------------


@pytest.mark.slow
@given(st.floats(-1, 1) | st.sampled_from([1 - 2.0**-52, 2.0**-52 - 1, 0.5, -0.5, 5e-324]))
def test_an_angle_of_incidence_is_the_arccosine(cosine):
    angle = incidence_angle(cosine)
    assert angle == pytest.approx(math.acos(cosine), rel=5e-16, abs=0)
    assert incidence_angle(math.nextafter(cosine, 2)) <= angle * (1 + 2.0**-51)


def test_incidence_is_measured_to_the_camera_centre():
    # A frontal face whose centroid is as far off the axis as it is deep.
    view = face_geometry(triangles((1, 0, 2), (2, 1, 2), (3, -1, 2)), CAMERA, AHEAD)
    assert np.degrees(view.incidence) == pytest.approx([45])


# --- pixel density --------------------------------------------------------------------------------


def numeric_density(corners, camera, step=1e-6):
    """Least singular value of the projection along a face, at its worst vertex."""
    basis = np.linalg.qr((corners[1:] - corners[0]).T)[0].T
    worst = np.inf
    for corner in corners:
        ahead, behind = (
            to_image(corner + sign * step * corner[2] * basis, camera) for sign in (1, -1)
        )
        jacobian = (ahead - behind) / (2 * step * corner[2])
        worst = min(worst, np.linalg.svd(jacobian, compute_uv=False)[-1])
    return worst


@pytest.mark.slow
@given(seeds)
def test_density_is_the_least_singular_value_of_finite_differences(rng):
    mesh = triangles(rng.uniform((-2, -2, 1), (2, 2, 5), size=(60, 3)))
    view = face_geometry(mesh.with_groups(two_sided="all"), UNEVEN, AHEAD)
    seen = np.flatnonzero((view.in_view_fraction > 0) & (np.abs(view.incidence - 1.57) > 0.05))
    expected = [numeric_density(mesh.vertices[mesh.faces[face]], UNEVEN) for face in seen]
    assert view.pixel_density[seen] == pytest.approx(expected, rel=1e-5)


# --- focus ----------------------------------------------------------------------------------------


def test_focus_of_all_vertices_is_stricter_than_of_the_centroid():
    depth = np.array([(1.0, 2, 3), (0.9, 2, 3), (1, 2, 3.1), (1.1, 1.2, 2.9), (9, 9, 9)])
    sides = np.tile((0.0, 0.0, 0.1), (5, 1)), np.tile((0.0, 0.1, 0.0), (5, 1))
    mesh = triangles(np.stack((*sides, depth), axis=-1))
    view = face_geometry(mesh, UNEVEN, AHEAD)
    assert in_focus(view, (1, 3)).tolist() == [True, False, False, True, False]
    assert in_focus(view, (1, 3), "centroid").tolist() == [True, True, True, True, False]
    assert in_focus(view, (0, math.inf)).all()


LENSES = {
    "pinhole": UNEVEN,
    "fov": Camera(width=640, height=480, fx=200, fy=200, model="fov", distortion=[0.9]),
    "fisheye": Camera(
        width=640, height=480, fx=150, fy=150, model="opencv_fisheye", distortion=[0] * 4
    ),
    "panorama": Camera(
        width=640, height=320, fx=640 / math.tau, fy=640 / math.tau, model="equirectangular"
    ),
}


@pytest.mark.parametrize("method", ["certified", "sampled"])
@pytest.mark.parametrize(("lens", "camera"), LENSES.items())
@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_centroid_is_in_focus_by_its_own_depth_or_distance(lens, camera, method, rng):
    camera, rule = replace(camera, focus_range=(1.5, 2.5)), Task(focus_rule="centroid")
    mesh = triangles(rng.uniform((-2, -2, 0.2), (2, 2, 3), (180, 3)))
    found = evaluate(mesh, camera, AHEAD[None], rule, method=method)
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    depth = centre[:, 2] if lens in ("pinhole", "fov") else np.linalg.norm(centre, axis=1)
    expected = (depth >= 1.5) & (depth <= 2.5)
    assert 3 < expected.sum() < 57
    assert (found.in_focus[0] == expected).all()
    assert (in_focus(face_geometry(mesh, camera, AHEAD), (1.5, 2.5), "centroid") == expected).all()


# --- meshes that try to break it ------------------------------------------------------------------
