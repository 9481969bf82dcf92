"""The certificate: no face is ever called seen whole, or hidden, that is not."""

import numpy as np
import pytest
from exact_cases import AHEAD, grid, hostile, window
from exact_views import (
    PATHS,
    SEEDS,
    Certificate,
    HalfPlanes,
    assert_agree,
    assert_within_bounds,
    look,
    on_both_paths,
    regions_of,
    wrong_certificates,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet, square

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes

CAMERA = Camera(width=320, height=240, fx=260, fy=270)


# --- zero wrong certificates ----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", shapes.NAMES)
def test_no_certificate_is_wrong_on_a_built_in_mesh(name):
    wrong, certified, _ = wrong_certificates(shapes.by_name(name), 28, np.random.default_rng(7))
    assert wrong == []
    assert certified > 20


def folded(rng):
    """Two layers from 1e-9 to a half apart: apart, or joined along one or all of their borders."""
    flat, faces = grid(int(rng.integers(1, 7)))
    u, v = flat.T
    height = rng.choice((0, 0.3)) * np.sin(3 * u + rng.uniform(0, 6)) * np.cos(3 * v)
    gap = 10 ** rng.uniform(-9, -0.3)
    joint = rng.integers(3)
    if joint == 0:
        below = height - gap
    elif joint == 1:
        below = height - gap * (u + 1)
    else:
        below = height - gap * (1 - u**2) * (1 - v**2)
    points = np.concatenate((np.column_stack((flat, height)), np.column_stack((flat, below))))
    return Mesh(vertices=points, faces=np.concatenate((faces, faces[:, ::-1] + len(flat))))


@pytest.mark.slow
@given(seed=SEEDS)
@examples(10, at_night=25)
def test_no_certificate_is_wrong_on_folded_and_hostile_meshes(seed):
    rng = np.random.default_rng(seed)
    mesh = (folded(rng), hostile(seed).mesh, joined(folded(rng), shapes.sphere(1, 0.4)))[seed % 3]
    assert wrong_certificates(mesh, 14, rng)[0] == []


@pytest.mark.slow
@given(seed=SEEDS)
@example(seed=581)  # a seam of two faces in the plane of a third: one before it, one behind
@example(seed=2236038)  # a face passes through another one along one of its own edges
@examples(83, at_night=50000)
def test_no_certificate_is_wrong_between_points_of_a_lattice(seed):
    # Edges over edges and corners over corners in the image, at all depths, from a welded mesh.
    rng = np.random.default_rng(seed)
    z = np.array((1, 2, 4))[rng.integers(0, 3, 27)]
    plane = rng.integers(-2, 3, (27, 2)) * 0.25
    points = np.column_stack((plane * z[:, None], z))
    faces = rng.integers(0, 27, (int(rng.integers(2, 30)), 3))
    assert_agree(Mesh(vertices=points, faces=faces), window(150, 150, 120), AHEAD)


# --- edges that must be seen to cross -------------------------------------------------------------


def layers(offset, behind=4.0, before=2.0):
    """A square, and before it one whose left side passes `offset` px inside the square's right."""
    rear = square(1, behind)  # 25 px to either side at depth 4
    at = (100 / behind - offset) * before / 100
    return joined(rear, sheet((at, -3), (at + 2, 3), before))


@pytest.mark.parametrize(
    ("offset", "is_certified"),
    [(offset, False) for offset in (1e-3, 1e-5, 1e-6, 0.0, 1e-12, -1e-12, 1e-10, -1e-10)]
    + [(offset, True) for offset in (-1e-3, -1e-5)],
)
def test_an_edge_inside_a_face_or_along_its_edge_crosses_it(offset, is_certified):
    # Along an edge rounding decides on which side it runs, so nothing is claimed.
    view = assert_agree(layers(offset), window(), AHEAD)
    assert view.is_certified[:2].all() == is_certified
    if offset >= 1e-6:
        assert not view.is_certified[1 if view.visible[1] < view.area[1] else 0]
        assert view.visible[:2].sum() == pytest.approx(2500 - offset * 50, abs=1e-9)


@pytest.mark.parametrize(
    ("mesh", "eye", "least"),
    [
        (shapes.sphere(2), (3, 0.4, 0.2), 0.9),  # edges only touch faces at contour vertices
        (joined(shapes.sphere(3), shapes.sphere(3, 0.5)), (3, 0.4, 0.2), 0.9),
        (shapes.torus(), (2.2, 1.3, 1.0), 0.75),
    ],
    ids=["sphere", "shells", "torus"],
)
def test_most_of_a_mesh_is_certified_by_few_regions(mesh, eye, least):
    view = assert_agree(mesh, CAMERA, look_at(eye, (0, 0, 0))[0])
    live = view.area > 0
    assert view.is_certified[live].mean() > least
    assert view.n_regions < 0.02 * live.sum()


# --- the near plane and the border of the image ---------------------------------------------------


@given(seed=SEEDS)
@settings(max_examples=20)
def test_regions_do_not_spread_beyond_the_image_and_back(seed):
    # Strips that leave the image and come back; what hides their return begins outside of it.
    rng = np.random.default_rng(seed)
    flat, faces = grid(6)
    points = np.column_stack((flat * rng.uniform(1, 2.5), np.full(len(flat), 4.0)))
    points[:, 2] += 0.3 * np.sin(points[:, 0] * 3)
    screen = sheet((rng.uniform(0.2, 1.2), -2), (3, rng.uniform(-1, 2)), 2.0)
    width = int(rng.integers(20, 90))
    camera = Camera(width=width, height=90, fx=90, fy=90, cx=rng.uniform(-30, 60), cy=45)
    assert_agree(joined(Mesh(vertices=points, faces=faces), screen), camera, AHEAD)


# --- contacts, seams, odd edges -------------------------------------------------------------------


@pytest.mark.parametrize("gap", [0.0, 1e-13, 1e-9, -1e-9])
def test_faces_on_one_another_are_never_certified(gap):
    mesh = joined(square(2, 4), square(1, 4 + gap))
    assert not look(mesh, window(), AHEAD).is_certified.any()


@pytest.mark.parametrize("distance", [1, 30, 300, 3e4, 3e6])
@pytest.mark.parametrize("factor", [0.5, -0.5, 4, -4])
def test_surfaces_that_distance_makes_one_are_not_certified(distance, factor):
    # Sheets 1e-10 of the distance apart are one surface there: the lower index is seen, whichever
    # is nearer. They fill the image, so that no edge crosses either.
    flat, faces = grid(2)
    sheets = [
        Mesh(vertices=np.column_stack((flat, np.full(len(flat), z))), faces=faces)
        for z in (0, factor * 1e-10 * distance)
    ]
    pose = np.eye(4)
    pose[2, 3] = -distance
    camera = Camera(width=200, height=200, fx=120 * distance, fy=120 * distance)
    view, truth = (look(joined(*sheets), camera, pose, path) for path in PATHS[::-1])
    assert np.abs(view.visible - truth.visible).max() <= 1e-9 * view.area.max()
    assert (view.visible[:8] > 0).all() == (factor > -1)
    assert abs(factor) > 1 or not view.is_certified.any()


# --- regions --------------------------------------------------------------------------------------


@given(seed=st.integers(0, 100_000))
@settings(max_examples=20)
def test_faces_of_a_region_share_its_answer(seed):
    case = hostile(seed)
    view = look(case.mesh, case.camera, case.pose)
    assert np.array_equal(view.is_certified, regions_of(view) >= 0)
    assert (view.area[view.is_certified] > 0).all()
    for number in np.unique(regions_of(view)[regions_of(view) >= 0]):
        members = regions_of(view) == number
        part = view.visible[members] / view.area[members]
        assert np.isin(part, (0.0, 1.0)).all()
        assert np.ptp(part) == 0


# --- where it failed once -------------------------------------------------------------------------


@pytest.mark.parametrize(("angle", "z", "inside"), [(1e-5, 2, 1e-4), (1e-3, 60, 1e-4)])
def test_a_fold_of_which_the_border_leaves_a_strip_is_decided_by_index_there(angle, z, inside):
    # Two sheets of two faces each, joined along x = 0, where they are 0 apart; the image ends
    # `inside` px from there. Within it their depths differ by less than 1e-10: the lower index is
    # in front, which is one sheet's face here and the other's there.
    points = [(0, -1, 0), (0, 0, 0), (0, 1, 0), (-1, 0, 0), (-1, 0, angle)]
    faces = [(0, 3, 1), (1, 2, 4), (0, 1, 4), (1, 3, 2)]
    camera = Camera(width=200, height=200, fx=40 * z, fy=40 * z)
    pose = np.eye(4)
    pose[:3, 3] = 100 / 40 - inside / 40, 0, -z
    view = assert_agree(Mesh(vertices=points, faces=faces), camera, pose)
    truth = look(Mesh(vertices=points, faces=faces), camera, pose, HalfPlanes)
    part = view.visible / view.area
    assert part == pytest.approx(truth.visible / truth.area, abs=1e-6)


BEFORE, ABOVE, BEHIND = (0.3, -0.4, 3.0), (1.0, -2.2, 1.5), (-1.5, 1.5, -2.0)


def compared(vertices, faces, path, eye=BEFORE, middle=(0, 0, 0)):
    """Faces compared with event edges, or taken from others, by a camera before a mesh."""
    pose = look_at(eye, middle)[0]
    return look(Mesh(vertices, faces), window(1280, 960, 1200), pose, path).n_compared


def nearly_coincident(n, moved=1e-16):
    """Triangles that differ by rounding: each edge is one of all of them."""
    corners = np.array([(-1.0, -0.7, 0.1), (1.1, -0.6, -0.2), (0.1, 0.9, 0.3)])
    noise = moved * np.random.default_rng(n).standard_normal((n, 3, 3))
    return (corners + noise).reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)


def coincident(n):
    """The same, farther apart than rounding."""
    return nearly_coincident(n, 1e-12)


def stack(n):
    """Triangles behind one another, which hardly differ."""
    corners = np.array([(-1.0, -0.7, 0.1), (1.1, -0.6, -0.2), (0.1, 0.9, 0.3)])
    gaps = 1e-7 * np.arange(n)[:, None, None] * np.array([0.0, 0.0, 1.0])
    return (corners + gaps).reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)


def thin_on_one_side(n, slant=0.0):
    """Thin faces along one side of a triangle."""
    x = np.linspace(-1, 1, n + 1)
    side = np.column_stack((x, np.zeros((n + 1, 2))))
    tips = np.column_stack((x[:-1] + slant, np.full(n, 0.8), np.zeros(n)))
    row = np.arange(n)
    thin = np.column_stack((4 + row, 3 + row, 4 + n + row))
    vertices = np.concatenate(([(-1, 0, 0), (1, 0, 0), (0, -1, 0)], side, tips))
    return vertices, np.concatenate(([(0, 1, 2)], thin))


def slanted_needles(n):
    """Parallel needles beside one another, whose boxes overlap."""
    x = np.linspace(-1, 1, n)
    along = np.array([(0, -0.8, 0), (1 / n, -0.8, 0), (0.6, 0.8, 0)])
    corners = along + np.column_stack((x, 0 * x, 0 * x))[:, None]
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)


def pages(n):
    """Faces about one edge, their corners and themselves in any order."""
    rng = np.random.default_rng(n)
    angle = np.linspace(0, np.pi, n)
    outer = np.column_stack((np.cos(angle), np.zeros(n), np.sin(angle)))
    faces = np.column_stack((np.zeros(n, int), np.ones(n, int), 2 + np.arange(n)))
    return np.concatenate(([(0, -1, 0), (0, 1, 0)], outer)), rng.permuted(faces, axis=1)


def in_any_order(scene):
    """The same with its faces in any order."""

    def made(n):
        vertices, faces = scene(n)
        return vertices, np.random.default_rng(n).permutation(faces)

    return made


@on_both_paths
@pytest.mark.parametrize("eye", [BEFORE, ABOVE, BEHIND])
@pytest.mark.parametrize("made", [lambda scene: scene, in_any_order])
@pytest.mark.parametrize(
    "scene", [nearly_coincident, coincident, thin_on_one_side, slanted_needles, pages]
)
def test_an_edge_is_compared_with_as_many_faces_in_any_number(scene, made, eye, path):
    few, many = (compared(*made(scene)(n), path, eye) for n in (2040, 8040))
    assert many < 9 * few + 8040  # of all pairs, 16 times


@on_both_paths
@pytest.mark.parametrize("eye", [BEFORE, ABOVE, BEHIND])
@pytest.mark.parametrize("moved", [1e-10, 1e-9, 1e-6])
def test_a_face_of_a_stack_is_compared_with_few_of_those_it_passes_through(moved, eye, path):
    for n in (2040, 8040):
        vertices, faces = in_any_order(lambda n: nearly_coincident(n, moved))(n)
        assert compared(vertices, faces, path, eye) < 20 * n * np.log2(n)


def cone_around(n, height):
    """The mantle of a cone, its faces in any order, with the camera inside."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    rim = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(n)))
    row = np.arange(n)
    faces = np.column_stack((np.zeros(n, int), 1 + row, 1 + (row + 1) % n))
    return np.concatenate(([(0, 0, height)], rim)), np.random.default_rng(n).permutation(faces)


@on_both_paths
@pytest.mark.parametrize("height", [5.0, 20.0, 60.0])
@pytest.mark.parametrize("eye", [BEFORE, (-0.2, 0.1, -2.0), (0.1, 0.2, 4.0)])
def test_a_face_that_the_near_plane_clips_is_compared_with_few_others(eye, height, path):
    vertices, faces = cone_around(2010, height)
    assert compared(vertices, faces, path, eye) < 200 * 2010  # of all pairs, ten times


def fan(n, wave=0.0):
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    rim = np.column_stack((np.cos(angle), np.sin(angle), wave * np.sin(5 * angle)))
    row = np.arange(n)
    return np.concatenate(([(0, 0, 0)], rim)), np.column_stack(
        (0 * row, 1 + row, 1 + (row + 1) % n)
    )


CLOSE = ((-0.29, -0.74, 1.27), (0.11, 0.49, 0.13)), ((0.95, 0.94, -0.68), (-0.01, 0.27, -0.08))
"""Eyes, and what they look at, from which the image or the near plane clips many faces."""


@on_both_paths
@pytest.mark.parametrize(
    ("scene", "eye", "middle"),
    [(scene, *at) for scene in (pages, coincident) for at in CLOSE]
    + [(stack, *CLOSE[1]), (fan, (0.05, -0.1, 0.35), (0, 0, 0)), (fan, *CLOSE[0])]
    + [
        (lambda n: fan(n, 0.1), eye, middle)
        for eye, middle in (
            ((0.05, -0.1, 0.35), (0, 0, 0)),
            ((-0.08, -0.13, -0.02), (0.08, 0.23, 0.02)),
            ((-0.5, -0.62, 0.1), (-0.22, 0.23, 0.14)),
        )
    ],
)
def test_faces_that_the_image_clips_are_compared_with_few_of_those_they_touch(
    scene, eye, middle, path
):
    few, many = (compared(*in_any_order(scene)(n), path, eye, middle) for n in (2040, 8040))
    assert many < 9 * few + 8040  # of all pairs, 16 times


def test_an_edge_is_compared_with_few_faces_whose_boxes_hold_it():
    n = 16010
    vertices, faces = in_any_order(lambda n: thin_on_one_side(n, 0.5))(n)
    assert compared(vertices, faces, Certificate, *CLOSE[0]) < 8 * n * np.log2(n)


def folded_fan(n, rng):
    """Faces about a point of which one hides the next, and which the image cuts."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    wave = rng.uniform(0.02, 0.3) * np.sin(rng.integers(2, 9) * angle)
    rim, row = np.column_stack((np.cos(angle), np.sin(angle), wave)), np.arange(n)
    faces = np.column_stack((np.zeros(n, int), 1 + row, 1 + (row + 1) % n))
    return np.concatenate(([(0, 0, 0)], rim)), rng.permutation(faces)


@on_both_paths
@given(seed=SEEDS)
@example(seed=1)
@examples(8, at_night=100)
def test_a_face_of_a_folded_fan_is_seen_in_part_within_its_bound(path, seed):
    # Pieces that are left of it have sides about the common point as short as rounding, or of no
    # length.
    rng = np.random.default_rng(seed)
    mesh, eye = Mesh(*folded_fan(600, rng)), (*rng.uniform(-1.2, 1.2, 2), rng.uniform(0.2, 0.6))
    camera, pose = window(1280, 960, 1200), look_at(eye, (0, 0, 0))[0]
    view = look(mesh, camera, pose, path)
    parts = np.flatnonzero((view.visible > 0) & (view.visible < view.area))[:4]
    assert_within_bounds(mesh, camera, pose, parts, [path])


@on_both_paths
def test_a_sliver_of_very_many_nearly_coincident_faces_is_within_its_bound(path):
    vertices, faces = nearly_coincident(2000, 1e-12)
    middle = vertices.mean(axis=0)
    pose, camera = look_at(middle + BEFORE, middle)[0], window(1280, 960, 1200)
    assert_within_bounds(Mesh(vertices, faces), camera, pose, [1896], [path])


def rough_pages(n, rng):
    """Faces about one edge, of any size, that pass through one another."""
    points, faces = pages(n)
    points[2:] *= rng.uniform(0.3, 1.5, (n, 1))
    points[2:] += 0.2 * rng.normal(size=(n, 3))
    return points, faces


def crossing_needles(n, rng):
    ends = rng.uniform(-0.7, 0.7, (n, 2, 3))
    tips = ends[:, :1] + 1e-2 * rng.normal(size=(n, 1, 3))
    return np.concatenate((ends, tips), 1).reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)


def close_layers(n, rng):
    """Large faces behind one another."""
    corners = np.array([(-1.0, -0.7, 0.1), (1.1, -0.6, -0.2), (0.1, 0.9, 0.3)])
    corners = corners + rng.uniform(-0.4, 0.4, (n, 1, 3)) + 0.1 * rng.normal(size=(n, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3)


@pytest.mark.parametrize("scene", [rough_pages, crossing_needles, close_layers])
@given(seed=SEEDS)
@examples(2, at_night=40)
def test_where_very_many_faces_share_a_place_areas_are_within_their_bounds(scene, seed):
    rng = np.random.default_rng(seed)
    mesh = Mesh(*scene(300, rng))  # more than a cell of the grid compares one by one
    eye = rng.normal(size=3)
    pose = look_at(3.2 * eye / np.linalg.norm(eye), (0, 0, 0))[0]
    assert_within_bounds(mesh, window(64, 48, 60), pose, rng.permutation(300)[:4])


def very_rough(n):
    """A grid whose vertices are moved so far that most of its faces are needles in the image."""
    side = round(np.sqrt(n / 2))
    x, y = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1))
    z = 0.3 * np.random.default_rng(n).standard_normal(x.size)
    row = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    one = np.column_stack((row, row + 1, row + side + 2))
    other = np.column_stack((row, row + side + 2, row + side + 1))
    return np.column_stack((x.ravel(), y.ravel(), z)), np.concatenate((one, other))


@pytest.mark.parametrize("eye", [BEFORE, (1.2, 0.7, 2.8), (0.4, -0.2, -3.1)])
def test_needles_in_any_direction_are_compared_with_few_of_those_before_them(eye):
    n = 32000  # up to 1,024 faces in a cell are a list: compared more often, in less time
    assert compared(*in_any_order(very_rough)(n), Certificate, eye) < 22 * n * np.log2(n)
