"""Polygons that are not convex: triangles that cover them once, whatever their shape or place."""

import time

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mesh_files import WRITERS
from nightly import amount

from rastercov.engine.solver_readers import cut_concave

pytestmark = pytest.mark.native


def fan(n: int, first: int = 0) -> np.ndarray:
    """(n - 2, 3) triangles about the first corner."""
    i = np.arange(1, n - 1)
    return first + np.stack([0 * i, i, i + 1], axis=1)


def cut(points: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Triangles of one polygon, and notes."""
    faces = fan(len(points))
    notes = cut_concave(np.asarray(points, float), faces, np.zeros(len(faces), int))
    return faces, notes


def lifted(xy: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) corners of a polygon turned, scaled and moved at random, and its normal."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn[:, 0] *= np.linalg.det(turn)
    scale = 10.0 ** rng.integers(-3, 4)
    points = np.column_stack([xy, np.zeros(len(xy))]) * scale
    return points @ turn.T + scale * rng.normal(size=3), turn[:, 2]


def signed_area(xy: np.ndarray) -> float:
    x, y = (xy - xy[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def doubled_areas(points: np.ndarray, faces: np.ndarray, normal: np.ndarray) -> np.ndarray:
    p, q, r = np.moveaxis(points[faces], 1, 0)
    return np.cross(q - p, r - p) @ normal


def check_covers_once(xy: np.ndarray, seed: int = 0, *, are_apart: bool = True) -> None:
    """None of n - 2 triangles is wound backwards, their areas add up, each corner is used.

    For a polygon that does not cross itself the first two prove that it is covered exactly once.
    """
    points, normal = lifted(xy, seed)
    faces, notes = cut(points)
    assert faces.shape == (len(xy) - 2, 3)
    areas = doubled_areas(points, faces, normal)
    assert areas.min() >= -1e-9 * areas.sum()
    assert not are_apart or len(np.unique(faces)) == len(xy)
    assert notes == []
    ratio = areas.sum() / 2 / signed_area(points @ plane(normal).T)
    assert ratio == pytest.approx(1, rel=1e-7)


def plane(normal: np.ndarray) -> np.ndarray:
    """(2, 3) axes of the plane, counter-clockwise about the normal."""
    x = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x)])


def star(rng: np.random.Generator, n: int) -> np.ndarray:
    angle = (np.arange(n) + rng.uniform(0.05, 0.95, n)) * 2 * np.pi / n
    radius = rng.uniform(0.02, 1, n)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def comb(rng: np.random.Generator, n_teeth: int) -> np.ndarray:
    x = np.arange(2 * n_teeth + 1)
    y = np.where(x % 2, rng.uniform(2, 9, len(x)), rng.uniform(0.1, 1, len(x)))
    return np.concatenate([[[0, 0], [2 * n_teeth, 0]], np.stack([x, y], axis=1)[::-1]]).astype(
        float
    )


def spiral(rng: np.random.Generator, n: int) -> np.ndarray:
    turns = rng.uniform(1, 4)
    angle = np.linspace(0, 2 * np.pi * turns, n + 16 * int(turns + 1))
    radius = 1 + angle
    arm = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([arm * (radius + 0.9)[:, None], (arm * radius[:, None])[::-1]])


def simple_polygon(seed: int, n: int) -> np.ndarray:
    """A star, a comb or a spiral, with any corner first, wound counter-clockwise."""
    rng = np.random.default_rng(seed)
    xy = [star, comb, spiral][seed % 3](rng, n)
    return np.roll(xy, rng.integers(len(xy)), axis=0)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(4, amount(30, at_night=60)))
def test_simple_polygons_are_covered_exactly_once(seed, n):
    """Also with corners on their edges, and with corners that are repeated."""
    xy, rng = simple_polygon(seed, n), np.random.default_rng(seed)
    check_covers_once(xy, seed)
    parts = [np.arange(rng.integers(1, 5))[:, None] / 4 for _ in xy]
    pairs = zip(xy, np.roll(xy, -1, axis=0), parts, strict=True)
    check_covers_once(np.concatenate([a + part * (b - a) for a, b, part in pairs]), seed)
    doubled = np.repeat(xy, rng.integers(1, 4, len(xy)), axis=0)
    check_covers_once(doubled, seed, are_apart=False)


@pytest.mark.parametrize("seed", range(amount(20, at_night=2000)))
def test_polygons_of_a_grid_are_covered_exactly_once(seed):
    """Many corners are on a line with others, and with the sides of triangles."""
    rng = np.random.default_rng(seed)
    cells = {(0, 0)}
    while len(cells) < 6 + seed % 40:
        x, y = sorted(cells)[rng.integers(len(cells))]
        cells.add([(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)][rng.integers(4)])
    area = shapely.union_all([shapely.box(x, y, x + 1, y + 1) for x, y in cells])
    xy = shapely.get_coordinates(shapely.Polygon(area.exterior).normalize())[:-1]
    assert shapely.Polygon(xy).is_valid
    xy = xy if signed_area(xy) > 0 else xy[::-1]
    if seed % 2:
        xy = shapely.get_coordinates(shapely.segmentize(shapely.LinearRing(xy), 1.0))[:-1]
    check_covers_once(np.roll(xy, rng.integers(len(xy)), axis=0), seed)


@pytest.mark.parametrize("seed", range(10))
def test_a_hole_joined_by_a_cut_stays_open(seed):
    outer = np.array([[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]], float)
    inner = np.array([[3, 3], [3, 6], [6, 6], [6, 3], [3, 3]], float)
    xy = np.roll(np.concatenate([outer, inner]), seed, axis=0)
    points, normal = lifted(xy, seed)
    faces, notes = cut(points)
    areas = doubled_areas(points, faces, normal)
    assert areas.min() >= -1e-9 * areas.sum()
    assert areas.sum() / 2 == pytest.approx(signed_area(points @ plane(normal).T), rel=1e-9)
    assert all("touch themselves" in note for note in notes)


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(4, 12))
def test_polygons_that_cross_themselves_are_noted_and_no_others(seed, n):
    xy = np.random.default_rng(seed).uniform(-1, 1, (n, 2))
    polygon = shapely.Polygon(xy)
    if signed_area(xy) < 0:
        xy = xy[::-1]
    assume(polygon.is_valid or not shapely.LinearRing(xy).is_simple)
    faces, notes = cut(np.column_stack([xy, np.zeros(n)]))
    assert len(faces) == n - 2
    assert any("cross or touch" in note for note in notes) == (not polygon.is_valid)


def overlapping_strip():
    """No triangle of it need be wound backwards, so only its complement betrays it."""
    path = np.array([[0, 0], [10, 0], [10, 10], [5, 10], [5, -5]], float)
    left = path + np.array([[0, 1], [-1, 1], [-1, -1], [1, -1], [1, 0]])
    right = path + np.array([[0, -1], [1, -1], [1, 1], [-1, 1], [-1, 0]])
    return np.concatenate([right, left[::-1]])


def winding(turns):
    angle = np.arange(12) * turns * 2 * np.pi / 12 + 0.1
    return np.linspace(1, 2, 12)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


BOW_TIE = np.array([[0, 0], [1, 1], [1, 0], [0, 1]], float)  # its area cancels
CROSSING = [overlapping_strip(), winding(2), winding(3), BOW_TIE]


@pytest.mark.parametrize("xy", CROSSING, ids=["strip", "twice", "thrice", "bow tie"])
def test_a_polygon_that_crosses_itself_is_noted(xy):
    faces, [note] = cut(np.column_stack([xy, np.zeros(len(xy))]))
    assert len(faces) == len(xy) - 2
    assert note.startswith("1 polygons cross or touch themselves, the first is 0; their triangles")


def test_fans_that_do_not_fold_are_kept():
    """Convex polygons, and those that their first corner sees whole, keep their faces."""
    angle = np.arange(8) * np.pi / 4
    convex = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    faces, notes = cut(convex)
    np.testing.assert_array_equal(faces, fan(8))
    assert notes == []
    dart = np.array([[0.5, 0.2, 0], [1, 0, 0], [0.5, 1, 0], [0, 0, 0]])
    faces, notes = cut(dart)
    np.testing.assert_array_equal(faces, fan(4))
    assert notes == []


def test_polygons_that_are_not_flat_are_noted():
    saddle = np.array([[0, 0, 0], [1, 0, 0.3], [1, 1, 0], [0, 1, 0.3]])
    _, notes = cut(saddle)
    assert notes == [
        "1 polygons are not flat, the first is 0; other triangles would be another surface"
    ]
    assert cut(saddle * [1, 1, 1e-3])[1] == []


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(4, 40), n_points=st.integers(1, 40))
def test_any_corners_give_the_same_number_of_triangles(seed, n, n_points):
    rng = np.random.default_rng(seed)
    points = rng.integers(-2, 3, (n_points, 3)).astype(float) * 10.0 ** rng.integers(-12, 13)
    faces = rng.integers(0, n_points, n)[fan(n)]
    corners = set(faces.ravel())
    cut_concave(points, faces, np.zeros(len(faces), int))
    assert faces.shape == (n - 2, 3)
    assert set(faces.ravel()) == corners


@pytest.mark.parametrize("name", ["a.obj", "a.off", "ascii.ply", "little.ply"])
def test_files_with_concave_polygons_load_right_and_without_a_note(name, load):
    #    3          a dart: the fan about 0 would fold over at the dent 2
    #   / \
    #  / 1 \
    # 0     2
    points = [(0.0, 0, 0), (0.5, 0.2, 0), (1, 0, 0), (0.5, 1, 0)]
    mesh = load(name, WRITERS[name](points, [(0, 2, 1), (0, 1, 2, 3), (0, 1, 3)]))
    np.testing.assert_array_equal(mesh.source_face, [0, 1, 1, 2])
    np.testing.assert_array_equal(mesh.faces[[0, 3]], [[0, 2, 1], [0, 1, 3]])
    assert mesh.areas[1:3].sum() == pytest.approx(0.4)
    assert (mesh.normals[1:3, 2] == 1).all()
    assert mesh.notes == ()


def test_a_polygon_of_very_many_corners_is_covered_exactly_once():
    check_covers_once(comb(np.random.default_rng(0), 25_000))


def test_the_same_edges_again_and_again_are_noted_in_little_time():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    faces = np.random.default_rng(0).integers(0, 3, 20_000)[fan(20_000)]
    before = faces.copy()
    start = time.process_time()
    [note] = cut_concave(points, faces, np.zeros(len(faces), int))
    assert time.process_time() - start < 10
    assert "cross or touch" in note
    np.testing.assert_array_equal(faces, before)


def test_dropping_a_corner_leaves_polygons_that_are_cut_right(load):
    text = b"v 0 0 0\nv 4 0 0\nv 4 4 0\nv nan 0 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5 6\nf 1 2 3\n"
    mesh = load("a.obj", text, drop_invalid=True)
    np.testing.assert_array_equal(mesh.source_face, [0, 0, 1])
    assert (mesh.normals[:, 2] > 0).all()
