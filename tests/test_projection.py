"""Projection, clipping, and the depths and boxes in view, against exact and brute-force answers."""

from dataclasses import replace
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import NEAR_TO_FAR, limits, near_limit
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh
from rastercov.reference.coverage import clip_near, clip_polygons, clip_to_image, polygon_area

# The pyramid of this camera has the sides x = z, x = -z, y = z and y = -z.
CAMERA = Camera(width=200, height=200, fx=100, fy=100)
SKEWED = Camera(width=640, height=480, fx=500, fy=400, cx=100, cy=350)

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
# Whole numbers: areas of small polygons are then right to the last digits.
triangles = hnp.arrays(np.int64, (4, 3, 2), elements=st.integers(-50, 50)).map(np.float64)
lines = hnp.arrays(np.int64, 3, elements=st.integers(-50, 50)).map(np.float64)


def three(polygons: np.ndarray) -> np.ndarray:
    return np.full(len(polygons), 3)


def side_of(line: np.ndarray, corners: np.ndarray) -> np.ndarray:
    return corners @ line[:2] + line[2]


def random_pose(rng: np.random.Generator, spread: float = 3.0) -> np.ndarray:
    return look_at(rng.normal(size=3) * spread, rng.normal(size=3), rng.normal(size=3))[0]


# --- projection -----------------------------------------------------------------------------------


@pytest.mark.slow
@given(seeds)
def test_projection_is_k_times_r_t_in_exact_arithmetic(rng):
    pose, point = random_pose(rng), rng.normal(size=3) * 3
    R = [[Fraction(x) for x in row] for row in pose[:3, :3].tolist()]
    offset = [Fraction(p) - Fraction(c) for p, c in zip(point, pose[:3, 3], strict=True)]
    x, y, z = (sum(R[row][axis] * offset[row] for row in range(3)) for axis in range(3))
    local = to_camera(point, pose)
    assert local == pytest.approx([float(x), float(y), float(z)], abs=1e-14)
    if abs(z) < 0.1:
        return
    camera = SKEWED
    u = Fraction(camera.fx) * x / z + Fraction(camera.cx)
    v = Fraction(camera.fy) * y / z + Fraction(camera.cy)
    assert to_image(local, camera) == pytest.approx([float(u), float(v)], rel=1e-12, abs=1e-9)
    homogeneous = camera.K @ local
    assert to_image(local, camera) == pytest.approx(homogeneous[:2] / homogeneous[2], abs=1e-9)


@given(seeds)
def test_a_far_offset_costs_no_precision(rng):
    # Whole multiples of 1/1024 m, which stay exact 10 000 km away.
    points = rng.integers(-4096, 4096, size=(20, 3)) / 1024
    pose = random_pose(rng)
    pose[:3, 3] = np.round(pose[:3, 3] * 1024) / 1024
    near = to_camera(points, pose)
    moved = pose.copy()
    moved[:3, 3] += 1e7
    assert np.array_equal(to_camera(points + 1e7, moved), near)


# --- area and clipping ----------------------------------------------------------------------------


def test_area_is_positive_clockwise_in_the_image():
    #  0---1 -> u      0 -> 1 -> 2 is clockwise where v runs down.
    #  |  /
    #  2
    #  v
    triangle = np.array([[[0.0, 0], [4, 0], [0, 3]]])
    assert polygon_area(triangle, np.array([3])) == [6]
    assert polygon_area(triangle[:, ::-1], np.array([3])) == [-6]
    assert polygon_area(triangle + 1e9, np.array([3])) == [6]


@pytest.mark.slow
@given(triangles, lines, lines)
def test_the_parts_of_two_cuts_make_up_the_whole(corners, line, second):
    distance = side_of(line, corners)
    total = 0
    for side in (1, -1):
        part, counts = clip_polygons(corners, three(corners), side * distance)
        assert part.shape == (4, 4, 2)
        assert (counts <= 4).all()
        for polygon, count in zip(part, counts, strict=True):
            assert (side * side_of(line, polygon[:count]) >= -1e-9).all()
            assert count == 0 or (polygon[count:] == polygon[count - 1]).all()
        # A second cut divides what is left.
        for other in (1, -1):
            total += polygon_area(*clip_polygons(part, counts, other * side_of(second, part)))
    if line[:2].any() and second[:2].any():
        assert total == pytest.approx(polygon_area(corners, three(corners)), abs=1e-8)


def test_a_cut_through_corners_keeps_what_touches_it():
    #     2
    #    / \       d = v - 2: corner 2 lies on the cut, 0 and 1 beyond it
    #   0---1
    triangle = np.array([[[0.0, 0], [4, 0], [2, 2]]])
    part, counts = clip_polygons(triangle, np.array([3]), triangle[..., 1] - 2)
    assert polygon_area(part, counts) == 0
    part, counts = clip_polygons(triangle, np.array([3]), 2 - triangle[..., 1])
    assert counts == [3]
    assert np.array_equal(part[0, :3], triangle[0])


@pytest.mark.parametrize(
    ("height", "near", "exact", "naive"),
    [(1 / 4, 1 / 8, 445625 / 18, -5000 / 9), (1 / 5, 1 / 10, 268250 / 9, -4000 / 9)],
)
def test_a_face_through_the_near_plane_is_cut_not_mirrored(height, near, exact, naive):
    # Two corners 3 m ahead, one 1 m behind: unclipped, that one lands above the horizon.
    face = [(-0.5, height, 3), (0.5, height, 3), (0, height, -1)]
    corners = np.array([face], dtype=np.float64)
    cut, counts = clip_near(corners, near)
    assert counts == [4]
    assert polygon_area(to_image(cut, CAMERA), counts) == pytest.approx([exact], rel=1e-12)
    unclipped = polygon_area(to_image(corners, CAMERA), np.array([3]))
    assert unclipped == pytest.approx([naive], rel=1e-12)


@pytest.mark.slow
@given(hnp.arrays(np.int64, (3, 3, 2), elements=st.integers(-200, 400)).map(np.float64))
def test_neighbouring_images_share_a_face_without_loss(corners):
    total = 0
    for u in (-200, 0, 200):
        for v in (-200, 0, 200):
            cut, counts = clip_to_image(corners - (u, v), three(corners), CAMERA)
            total += polygon_area(cut, counts)
    assert total == pytest.approx(polygon_area(corners, three(corners)), abs=1e-7)


# --- depths ---------------------------------------------------------------------------------------


def pyramid(camera: Camera, near: float) -> np.ndarray:
    """Rows (a, b, c, d) with a x + b y + c z + d >= 0 in view and beyond near."""
    w, h = camera.width - camera.cx, camera.height - camera.cy
    return np.array(
        [
            (camera.fx, 0, camera.cx, 0),
            (-camera.fx, 0, w, 0),
            (0, camera.fy, camera.cy, 0),
            (0, -camera.fy, h, 0),
            (0, 0, 1, -near),
        ]
    )


def cuts_of(faces: np.ndarray, camera: Camera, *nears: float) -> list[bool]:
    """Whether near planes cut faces in view of a camera at the origin."""
    mesh = Mesh(faces.reshape(-1, 3), np.arange(faces.size // 3).reshape(-1, 3))
    cameras = (replace(camera, near=near) for near in nears)
    return [bool(limits(mesh, each, np.eye(4)[None])[2][0]) for each in cameras]


def least_depth_by_linear_program(face: np.ndarray, camera: Camera) -> float:
    """Least z over a face in view: the best feasible crossing of any two of its 8 limits."""
    a, edges = face[0], face[1:] - face[0]  # point = a + (s, t) @ edges
    rows = pyramid(camera, 0.0)
    gradients = np.concatenate((rows[:, :3] @ edges.T, [(1, 0), (0, 1), (-1, -1)]))
    constants = np.concatenate((rows[:, :3] @ a + rows[:, 3], (0, 0, 1)))
    best = np.inf
    for i, j in combinations(range(len(constants)), 2):
        pair = gradients[[i, j]]
        if abs(np.linalg.det(pair)) > 1e-12:
            st_ = np.linalg.solve(pair, -constants[[i, j]])
            if (gradients @ st_ + constants >= -1e-9).all():
                best = min(best, float(a[2] + st_ @ edges[:, 2]))
    return best


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, SKEWED])
@given(rng=seeds, n=st.integers(1, 6), size=st.sampled_from([0.1, 1.0, 10.0]))
def test_a_surface_is_cut_by_near_planes_beyond_its_least_depth_in_view(camera, rng, n, size):
    faces = rng.normal(size=(n, 1, 3)) * 2 + rng.normal(size=(n, 3, 3)) * size
    mesh = Mesh(faces.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    least = min(least_depth_by_linear_program(face, camera) for face in faces)
    assume(least > 2 * near_limit(camera, mesh.bounds, np.eye(4)[None])[0])
    if least == np.inf:
        assert cuts_of(faces, camera, 1e3) == [False]
    else:
        assert cuts_of(faces, camera, least * (1 - 1e-7), least * (1 + 1e-7)) == [False, True]


def samples(faces: np.ndarray, n: int = 12) -> np.ndarray:
    s, t = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    keep = s + t <= 1
    weights = np.stack((1 - s - t, s, t), axis=-1)[keep]
    return (weights @ faces).reshape(-1, 3)


def in_view(points: np.ndarray, camera: Camera, near: float) -> np.ndarray:
    rows = pyramid(camera, near)
    return points[(points @ rows[:, :3].T + rows[:, 3] >= 0).all(axis=1)]


@pytest.mark.slow
@given(rng=seeds, offset=st.sampled_from([0.0, 3.0, 100.0]), near=st.sampled_from([0.0, 0.3]))
def test_poses_that_cut_nothing_show_every_depth_in_view(rng, offset, near):
    camera = Camera(width=200, height=150, fx=100, fy=120, near=near)
    vertices, faces = rng.normal(size=(12, 3)), rng.integers(0, 12, size=(8, 3))
    eyes = rng.normal(size=(5, 3)) + offset * rng.choice([-1, 1], size=(5, 3))
    poses = look_at(eyes, rng.normal(size=(5, 3)))
    near, _, clipped = limits(Mesh(vertices, faces), camera, poses)
    for pose, cut, limit in zip(poses, clipped, near, strict=True):
        depths = in_view(to_camera(samples(vertices[faces]), pose), camera, 0)[:, 2]
        assert cut or (depths >= limit).all()


def test_cut_are_the_poses_that_cut_a_surface_in_view():
    # A floor of 20 x 20 m seen from 1 m above, from outside, and along it.
    vertices = np.array([[-10.0, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    poses = look_at(
        [(0, 0, 1), (0, -30, 5), (0, 0, 1), (0, 0, 0), (0, 0, 5)],
        [(0, 0, 0), (0, 0, 0), (0, 5, 1), (1, 0, 0), (0, 0, 10)],
    )
    mesh = Mesh(vertices, faces)
    clipped = limits(mesh, CAMERA, poses)[2]
    # The third passes beside the eye, but the view shows it from 1 m on only; the last is behind.
    assert np.array_equal(clipped, (False, False, False, True, False))
    nearer = Camera(width=200, height=200, fx=100, fy=100, near=2)
    clipped = limits(mesh, nearer, poses[[1, 2]])[2]
    assert np.array_equal(clipped, (False, True))


def test_a_surface_in_view_that_is_wholly_nearer_than_near_is_cut():
    # eye >   | 1 m   ' near, 2 m   | 4 m
    wall = np.array([[-50.0, -50, 1], [50, -50, 1], [0, 50, 1]])
    vertices, faces = np.concatenate((wall, wall * (1, 1, 4))), np.array([[0, 1, 2], [3, 4, 5]])
    camera = Camera(width=200, height=200, fx=100, fy=100, near=2)
    assert limits(Mesh(vertices, faces), camera, np.eye(4)[None])[2].all()


def test_near_limit_is_the_greater_of_the_camera_s_and_a_part_of_the_farthest():
    bounds = np.array([[-1.0, -1, -1], [1, 1, 1]])
    poses = look_at([(0, 0, 3), (0, 0, 0)], [(0, 1, 3), (0, 1, 0)])
    reach = np.sqrt((18, 3))  # to a corner 4 m off in z, and from the middle
    assert near_limit(CAMERA, bounds, poses) == pytest.approx(NEAR_TO_FAR * reach)
    camera = Camera(width=200, height=200, fx=100, fy=100, near=3e-6)
    assert near_limit(camera, bounds, poses) == pytest.approx((NEAR_TO_FAR * reach[0], 3e-6))


def test_no_faces_and_no_poses_give_nothing():
    bounds = np.array([[0.0, 0, 0], [1, 1, 1]])
    poses = look_at([(0, -5, 0), (0, 5, 0)], (0, 0, 0))
    cut, counts = clip_near(np.zeros((0, 3, 3)), 0.1)
    assert (cut.shape, counts.shape) == ((0, 4, 3), (0,))
    cut, counts = clip_to_image(cut[..., :2], counts, CAMERA)
    assert (cut.shape, polygon_area(cut, counts).shape) == ((0, 8, 2), (0,))

    mesh = Mesh(np.eye(3), [(0, 1, 2)])
    assert [each.shape for each in limits(mesh, CAMERA, poses[:0])] == [(0,)] * 3
    assert near_limit(CAMERA, bounds, poses[:0]).shape == (0,)


def test_faces_without_area_have_depths_and_no_area():
    point, needle = np.full((3, 3), 2.0), np.array([[0.0, 0, 1], [0, 0, 2], [0, 0, 3]])
    faces = np.stack((point * (0, 0, 1), needle))
    assert cuts_of(faces, CAMERA, 0.999, 1.001) == [False, True]
    cut, counts = clip_near(faces, 1.5)
    assert np.array_equal(polygon_area(to_image(cut, CAMERA), counts), (0, 0))


def test_a_polygon_in_the_plane_of_the_cut_may_alternate_in_sign():
    # What rounding leaves of a face seen edge-on at the image border: corners at 0 give or take.
    square = np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]])
    distance = np.array([[1.0, -1, 1, -1]]) * 1e-17
    part, counts = clip_polygons(square, np.array([4]), distance)
    assert counts[0] <= part.shape[1]
    part, counts = clip_polygons(part, counts, part[..., 0] + 1)
    assert counts[0] <= part.shape[1]


@pytest.mark.slow
@given(rng=seeds)
def test_walls_edge_on_at_the_image_border_have_a_depth(rng):
    # The wall x = -z of the view, turned into the world and back.
    pose = random_pose(rng)
    s = rng.uniform(-2, 5, size=(50, 3))
    local = np.stack((-s, rng.uniform(-5, 5, size=(50, 3)), s), axis=-1)
    walls = to_camera(local @ pose[:3, :3].T + pose[:3, 3], pose)
    cuts = cuts_of(walls, CAMERA, 0.1, 1, 10, 100)
    assert cuts == sorted(cuts)
