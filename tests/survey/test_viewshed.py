"""Viewsheds against fractions, the general engine, published cases; files and the command."""

import json
import struct
import zlib
from contextlib import suppress
from fractions import Fraction
from math import sqrt
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from commands import call, refusal
from nightly import amount
from PIL import Image
from pyproj import Geod
from viewshed_by_fractions import is_over, plane_below, shares, triangles

import rastercov as rc
from rastercov.core.camera.conventions import panorama
from rastercov.core.mesh.terrain import Raster
from rastercov.engine import survey_viewshed as kernels
from rastercov.survey import viewshed
from rastercov.survey.geo import geotiff

ORIGIN = (500000.0, 5300000.0)


def test_more_observers_than_memory_holds_are_refused_before_any_is_read():
    with pytest.raises(rc.ResourceError, match="expected observers to fit in"):
        viewshed.observers_of(np.broadcast_to(np.int8(0), (2**40, 3)), 1.7)


@pytest.mark.parametrize("observers", [[[np.longdouble("1e4000"), 0]], (1e308, 0), (0, 1e10)])
def test_observers_out_of_this_world_are_refused(observers):
    with pytest.raises(rc.ConfigError, match=r"within 1e\+09 m"):
        rc.viewshed(np.zeros((3, 3)), observers, spacing=1.0)
    with pytest.raises(rc.ConfigError, match=r"within 1e\+09 m"):
        rc.viewshed(np.zeros((3, 3)), (1, -1), height=1e308, spacing=1.0)


@pytest.mark.parametrize("spacing", [5e-324, 1e-10, 0.0, -1.0, np.nan, 1e7])
def test_a_spacing_of_nothing_or_of_everything_is_refused(spacing):
    with pytest.raises(rc.MeshError, match="expected a spacing from"):
        rc.viewshed(np.zeros((3, 3)), (0, 0), spacing=spacing)


@pytest.mark.parametrize("none", [1e160, -1e160, 3.4e38, -3.4e38, np.inf, 1e20, -99999.9e1])
def test_what_is_no_height_is_a_hole(none):
    heights = np.zeros((4, 4))
    heights[0, 0] = none
    seen = rc.viewshed(heights, (2, -2), spacing=1.0)
    assert np.isnan(seen.raster.heights[0, 0])
    assert seen.seen[0].of_area == 8  # of two triangles of the corner none has all its samples
    assert seen.seen[0].area == 8


def random_grid(rng):
    """Heights in quarters, many of them equal, some missing."""
    shape = rng.integers(2, 5, 2)
    heights = np.round(rng.normal(0, 1, shape) * rng.choice([0, 1, 3, 10, 40])) / rng.choice([1, 4])
    if rng.random() < 0.2:
        heights[tuple(rng.integers(0, shape))] = np.nan
    return heights


def ground_below(heights, spacing, eye, inverse_radius):
    """Height of the surface at a place in fractions; None over a hole."""
    x, y = eye[0] / spacing[0], eye[1] / spacing[1]
    rows, columns = len(heights), len(heights[0])
    j, i = min(int(x), columns - 2), min(int(y), rows - 2)
    u, v = x - j, y - i

    def z(row, column):
        away = (column * spacing[0] - eye[0]) ** 2 + (row * spacing[1] - eye[1]) ** 2
        height = heights[row][column]
        return None if height is None else height - away * inverse_radius / 2

    corners = [z(i, j), z(i, j + 1), z(i + 1, j), z(i + 1, j + 1)]
    if None in corners:
        return None
    nw, ne, sw, se = corners
    return nw + u * (ne - nw) + v * (se - ne) if u >= v else nw + v * (sw - nw) + u * (se - sw)


def points_from(heights, spacing, eye, inverse_radius, target):
    """Points as the engine takes them, (H, W, 4), of a grid from an eye."""
    rows, columns = heights.shape
    x, y = np.arange(columns) * spacing[0] - eye[0], np.arange(rows)[:, None] * spacing[1] - eye[1]
    fall = inverse_radius * (x**2 + y**2) / 2
    above = heights - eye[2]
    parts = np.broadcast_arrays(x, y, above - fall, abs(above) + fall + target)
    return np.stack(parts, axis=2)


def random_view(seed, eyes):
    """Points of a random grid from above its ground, the cell below, and a height of targets."""
    rng = np.random.default_rng(seed)
    array = random_grid(rng)
    rows, columns = array.shape
    spacing = np.array([[1.0, 1.0], [2.0, 1.5]][rng.integers(2)])
    parts = int(rng.choice([1, 2, 8, 1024]))  # on samples, on sides, anywhere
    at = [rng.integers(0, parts * (n - 1) + 1) / parts for n in (columns, rows)] * spacing
    heights = [[None if np.isnan(x) else Fraction(x) for x in row] for row in array.tolist()]
    exact_spacing = tuple(map(Fraction, spacing.tolist()))
    inverse_radius = Fraction(int(rng.integers(2)), 64)
    eye = tuple(map(Fraction, at.tolist()))
    ground = ground_below(heights, exact_spacing, eye, inverse_radius)
    if ground is None:
        pytest.skip("the observer is over a hole")
    z = float(ground + Fraction(float(rng.choice(eyes))))
    target = float(rng.choice([0, 0, 0.5, 2]))
    points = points_from(array, spacing, (*at, z), float(inverse_radius), target)
    cell = [min(int(at[k] / spacing[k]), n - 2) for k, n in ((1, rows), (0, columns))]
    return points, cell, target


def seen_from(points, cell, target):
    """Shares of triangles with their bounds, and the visible pieces."""
    both = np.full((2, *np.subtract(points.shape[:2], 1), 2), np.nan)
    n = kernels.viewshed((points, *cell, target, np.inf, *both, np.empty((0, 4, 2))))
    pieces = np.zeros((n, 4, 2))
    kernels.viewshed((points, *cell, target, np.inf, *np.zeros(both.shape), pieces))
    return both, pieces


@pytest.mark.parametrize("seed", sorted({*range(amount(30, 400)), 119}))  # 119: ground level
def test_shares_are_those_of_fractions(seed):
    points, cell, target = random_view(seed, [0.25, 1.5, 3, 20])
    both, pieces = seen_from(points, cell, target)
    for triangle, corners in check_shares(points, target, *both):
        is_edge_on = abs(float(plane_below(corners)) + target) < 1e-9
        assert is_edge_on or both[1][triangle] < 1e-9
    share = np.nansum(both[0], axis=2) / 2
    area = shapely.area(shapely.make_valid(shapely.polygons(pieces))).sum()
    assert area == pytest.approx(share.sum(), abs=1e-9)


@pytest.mark.parametrize("seed", range(amount(20, 400)))
def test_ground_below_eyes_that_are_on_it_is_edge_on(seed):
    points, cell, target = random_view(seed, [0.0])
    both, _ = seen_from(points, cell, target)
    check_shares(points, target, *both)


def test_the_surface_is_not_seen_from_a_height_of_0():
    flat = np.full((5, 5), 3000.1)
    seen = viewshed.viewshed(flat, (1.3, -2.2), spacing=1.0, height=0, curvature=False)
    assert (seen.share <= seen.bound).all()
    seen = viewshed.viewshed(flat, (1.3, -2.2), spacing=1.0, height=0, target=1, curvature=False)
    assert (seen.share >= 1 - 1e-12).all()


def check_shares(points, target, share, bound):
    """Shares of triangles are those of fractions, within their bounds; returns all triangles."""
    exact = [
        [None if np.isnan(q[2]) else tuple(map(Fraction, q)) for q in r]
        for r in points[..., :3].tolist()
    ]
    for triangle, value in shares(exact, Fraction(target)).items():
        error = abs(Fraction(share[triangle]) - value)
        assert error <= bound[triangle], (triangle, share[triangle], float(value))
    return list(triangles(exact))


@pytest.mark.parametrize("seed", range(amount(20, 600)))
def test_triangles_that_are_seen_edge_on_have_the_shares_of_fractions(seed):
    """Planes of far targets go through the observer, to rounding; what is nearer hides parts."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(3, 6, 2)
    spacing = [(1000.0, 1.0), (1.0, 1000.0), (30.0, 0.25), (0.001, 5.0), (1.0, 1.0)][seed % 5]
    at = np.array([rng.integers(0, n) for n in shape[::-1]])
    x, y = np.meshgrid(
        *((np.arange(n) - k) * s for n, k, s in zip(shape[::-1], at, spacing, strict=True))
    )
    target = float(rng.choice([0, 0.5, 2]))
    heights = np.round(rng.normal(0, 3, shape) * 4) / 4
    slopes = rng.normal(0, 2, 2) / spacing
    plane = (slopes[0] * x + slopes[1] * y) * (1 + 2.0**-52 * rng.integers(-4, 5, shape)) - target
    cells = abs(x / spacing[0]) + abs(y / spacing[1])
    heights = np.where(cells > 1, plane, heights)
    heights[cells == 0] = -1.0
    points = np.stack((x, y, heights, abs(heights) + target), axis=2)
    row, column = (min(int(k), n - 2) for k, n in zip(at[::-1], shape, strict=True))
    both = np.full((2, *(shape - 1), 2), np.nan)
    kernels.viewshed((points, row, column, target, np.inf, *both, np.empty((0, 4, 2))))
    check_shares(points, target, *both)
    assert (both[1] >= 0).all()


@pytest.mark.parametrize("seed", range(amount(5, 200)))
def test_rows_a_rounding_above_the_horizon_are_not_taken_as_below_it(seed):
    """Each row of a slope through the observer is higher than the one before by a few roundings."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:9, :4].astype(np.float64) + rng.uniform(0.1, 0.9)
    rises = np.cumsum(rng.integers(0, 3, 9))
    heights = rng.normal() * y * (1 + 2.0**-52 * rises[:, None])
    x -= rng.choice([1, 2])
    heights[:2] = -5.0
    points = np.stack((x, y - 1, heights, abs(heights)), axis=2)
    both = np.full((2, 8, 3, 2), np.nan)
    column = int(np.searchsorted(x[0], 0)) - 1
    kernels.viewshed((points, 0, column, 0.0, np.inf, *both, np.empty((0, 4, 2))))
    check_shares(points, 0.0, *both)


def long_degrees(rng):
    """Raster in degrees with cells thousands of times as wide as high, or the reverse."""
    fine, coarse = 10 ** rng.uniform(-4, -1), rng.choice([0.1, 1, 2, 5])
    spacing = [(coarse, fine), (fine, coarse), (coarse, coarse / 2)][rng.integers(3)]
    shape = rng.integers(2, 5, 2)
    heights = rng.normal(0, 1, shape) * rng.choice([0, 1, 30, 400])
    north = rng.choice([-60, -1, 60, 75, 88.9])
    return Raster(heights, tuple(map(float, spacing)), (10.0, float(north)), "", True)


@pytest.mark.parametrize("seed", range(amount(30, 400)))
def test_long_cells_in_degrees_are_seen_from_above_their_straight_sides(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    raster, caught = long_degrees(rng), []

    def caught_viewshed(view):
        caught.append(view)
        return kernels.viewshed(view)

    monkeypatch.setattr(viewshed, "raster_of", lambda *_: raster)
    monkeypatch.setattr(viewshed, "kernels", SimpleNamespace(viewshed=caught_viewshed))
    part = np.array([each[-1] for each in raster.xy]) * rng.choice([0.25, 0.5, 0.61], 2)
    try:
        rc.viewshed("a.tif", part + raster.origin, height=5.0, target=rng.choice([0, 2]))
    except rc.ConfigError as error:
        pytest.skip(str(error))  # beside the straight sides
    points, _, _, target, _, share, bound, _ = caught[0]
    below = [
        plane_below(each) for _, each in check_shares(points, target, share, bound) if is_over(each)
    ]
    assert below
    assert max(abs(float(each) + 5) for each in below) < 1e-6


@pytest.mark.parametrize("north", [-80.0, 0.0, 60.0, 88.0])
def test_sides_and_outlines_of_long_cells_in_degrees_are_those_of_the_map(north, monkeypatch):
    raster = Raster(np.zeros((41, 5)), (0.5, 0.005), (10.0, north), "", True)
    monkeypatch.setattr(viewshed, "raster_of", lambda *_: raster)
    middle = north - 0.1
    sides = [
        Geod(ellps="WGS84").inv(10, middle, *each)[2]
        for each in ((10.5, middle), (10, middle + 0.005))
    ]
    assert raster.sides == pytest.approx(sides, rel=1e-4)
    seen = rc.viewshed("a.tif", (11.0, middle), height=9.0, curvature=False)
    (outline,) = viewshed.outlines_of(seen)
    assert outline.area == pytest.approx(2 * 0.2, rel=1e-6)  # all, with straight sides
    np.testing.assert_allclose(outline.bounds, (10, north - 0.2, 12, north), atol=1e-6)


@pytest.mark.parametrize("seed", range(amount(6, 60)))
def test_outlines_have_the_visible_share_of_the_area_of_cells_on_the_map(seed, monkeypatch):
    """In metres and in degrees, near a pole too, where parallels are no straight lines."""
    rng = np.random.default_rng(seed)
    heights = rng.normal(0, 30, (12, 9)).cumsum(axis=0)
    heights[tuple(rng.integers(0, 9, 2))] = np.nan
    kinds = [((30.0, 25.0), 0.0, False), ((0.2, 0.004), 88.0, True), ((0.01, 0.01), -60.0, True)]
    spacing, north, is_geographic = kinds[seed % 3]
    raster = Raster(heights, spacing, (10.0, north), "", is_geographic)
    monkeypatch.setattr(viewshed, "raster_of", lambda *_: raster)
    place = (10 + 3.3 * spacing[0], north - 5.2 * spacing[1], 20.0)
    caught = []
    solve = viewshed._solve

    def caught_solve(*given):
        caught.append(solve(*given))
        return caught[-1]

    monkeypatch.setattr(viewshed, "_solve", caught_solve)
    try:
        seen = rc.viewshed("a.tif", place)
    except rc.ConfigError as error:
        pytest.skip(str(error))  # over the hole
    (outline,) = viewshed.outlines_of(seen)
    cells = np.nansum(caught[0][0][0]) / 2
    assert outline.area == pytest.approx(cells * np.prod(spacing), rel=1e-5)
    x, y = 10 + 8 * spacing[0], north - 11 * spacing[1]
    np.testing.assert_array_less((10, y), np.add(outline.bounds[:2], 1e-6))
    np.testing.assert_array_less(outline.bounds[2:], np.add((x, north), 1e-6))


def test_slopes_beside_a_hole_have_an_area():
    heights = np.zeros((4, 5))
    heights[0, 4] = np.nan
    seen = rc.viewshed(heights, (5.0, -5.0, 2.0), spacing=10.0, curvature=False).seen[0]
    whole = 12 * 100 - 50  # one triangle, and one whole cell is of two
    assert seen.surface == pytest.approx(seen.area) == pytest.approx(seen.of_surface)
    assert seen.of_surface == pytest.approx(whole)


def test_an_observer_may_be_on_a_sample_beside_a_hole():
    heights = np.zeros((3, 3))
    heights[0, 1] = np.nan
    seen = rc.viewshed(heights, (20.0, 0.0, 2.0), spacing=10.0, curvature=False)
    assert seen.share[1, 1] == pytest.approx(1)


@pytest.mark.parametrize("seed", range(amount(3, 20)))
def test_areas_are_those_of_the_general_engine(seed):
    rng = np.random.default_rng(seed)
    spacing = (10.0, 12.0)
    heights = rng.normal(0, 3, (12, 14)).cumsum(axis=0)
    mesh = rc.Mesh.terrain(heights, spacing, curvature=False)
    observer = np.array((rng.uniform(5, 120), -rng.uniform(5, 120), 4.0))
    seen = rc.viewshed(heights, observer, spacing=spacing, curvature=False)
    corner = mesh.vertices[mesh.faces]
    eye = observer + np.array((0, 0, surface_at(corner, observer[:2])))
    pose = rc.look_at([eye], targets=eye + np.array((1, 0, 0)))
    covered = rc.evaluate(mesh, panorama(2000, 1000), pose).covered
    cells = heights[1:, 1:].size
    by_cell = np.bincount(mesh.source_face // 2, covered.area[0], cells)
    bound = np.bincount(mesh.source_face // 2, covered.bound, cells)
    total = seen.seen[0]
    assert abs(total.surface - by_cell.sum()) <= total.surface_bound + bound.sum() + 1e-9
    hidden = seen.share.ravel() + seen.bound.ravel() < 1e-12
    assert (by_cell[hidden] <= bound[hidden] + 1e-9).all()


@pytest.mark.parametrize("target", [0.0, 3.0])
def test_a_mesh_beside_hides_ground(target):
    rng = np.random.default_rng(3)
    heights = rng.normal(0, 2, (12, 14)).cumsum(axis=0)
    given = {"spacing": (10.0, 12.0), "target": target}
    observer = (43.0, -61.0, 6.0)
    far = rc.shapes.box((1, 1, 1), centre=(50.0, -70.0, -1e4))
    alone = rc.viewshed(heights, observer, **given)
    beside = rc.viewshed(heights, observer, **given, beside=far)
    error = alone.bound + beside.bound + 1e-9
    assert (np.abs(alone.share - beside.share) <= error).all()
    assert beside.seen[0].surface == pytest.approx(alone.seen[0].surface, rel=1e-6)
    wall = rc.shapes.box((0.5, 500, 1000), centre=(71.0, -61.0, 0.0))
    hidden = rc.viewshed(heights, observer, **given, beside=wall)
    assert (hidden.share[:, 8:] <= hidden.bound[:, 8:]).all()
    np.testing.assert_allclose(hidden.share[:, :6], beside.share[:, :6], atol=1e-6)


@pytest.mark.parametrize("seed", range(amount(40, 400)))
def test_a_mesh_under_the_ground_changes_nothing(seed):
    """Beside holes, and where the sheet of targets is level with the eyes."""
    rng = np.random.default_rng(seed)
    heights = rng.integers(0, 1 + rng.integers(4), (6, 8)).astype(np.float64)
    heights[rng.random(heights.shape) < 0.2 * rng.integers(2)] = np.nan
    heights[2:4, 3:5] = 1.0
    given = {"spacing": 10.0, "target": rng.choice([0.0, 1.7, 3.0]), "curvature": seed % 4 == 0}
    observer = (35.0, -25.0 - rng.integers(2), rng.choice([0.0, 1.7, 3.0]))
    below = rc.shapes.box((1, 1, 1), centre=(35.0, -25.0, -60))
    alone = rc.viewshed(heights, observer, **given)
    beside = rc.viewshed(heights, observer, **given, beside=below)
    wrong = np.abs(alone.share - beside.share) > alone.bound + beside.bound + 1e-9
    assert not wrong.any()
    one, other = alone.seen[0], beside.seen[0]
    assert abs(one.area - other.area) <= one.area_bound + other.area_bound + 1e-6


def test_undecided_ground_does_not_pass(tmp_path, capsys):
    rows = "\n".join(["5 5 5 5 5"] * 5)
    (tmp_path / "a.asc").write_text(f"ncols 5\nnrows 5\ncellsize 10\n{rows}")
    rc.shapes.box((1, 1, 2), centre=(35.0, 5.0, 5)).to_trimesh().export(tmp_path / "a.stl")
    line = ["viewshed", str(tmp_path / "a.asc"), "--from", "15,15", "--flat", "--at-least", "40"]
    assert call(capsys, [*line, "--target", "1.7"])[0] == 0
    assert call(capsys, [*line[:-1], "100"])[0] == 0  # to rounding
    beside = [*line, "--beside", str(tmp_path / "a.stl")]
    assert call(capsys, [*beside, "--target", "1.6"])[0] == 0
    assert call(capsys, [*beside, "--target", "1.7"])[0] == 1


def test_faces_off_the_raster_hide_nothing_and_clip_no_ground():
    """Of a mesh with parts far away, which would move the nearest depth above the ground."""
    heights = np.zeros((12, 14))
    given = {"spacing": 10.0, "height": 1.7, "curvature": False}
    wall = rc.shapes.box((0.5, 30, 9), centre=(71.0, -61.0, 0.0))
    for away in ((5e6, 0, 0), (-3e7, 8e6, 0), (0, 2e6, 9e5)):
        far = rc.shapes.box((9, 9, 9), centre=away)
        both = rc.Mesh.joined([wall, far], ["wall", "far"])
        one, other = (
            rc.viewshed(heights, (43.0, -61.0), **given, beside=each) for each in (wall, both)
        )
        np.testing.assert_allclose(one.share, other.share, rtol=0, atol=1e-7)
        with pytest.raises(rc.ConfigError, match="a mesh over the raster, got one beside it"):
            rc.viewshed(heights, (43.0, -61.0), **given, beside=far)
    sheet = rc.Mesh([(0, 0, 90), (5e6, 0, 90), (5e6, -9, 90)], [(0, 1, 2)])
    with pytest.raises(rc.ConfigError, match=r"more than 5 m above the ground.*, got 1.7 m; cut"):
        rc.viewshed(heights, (43.0, -61.0), **given, beside=sheet)


DEGREES = (1 / 1200, 1 / 1500)
"""Spacing of longitudes and latitudes."""


def write_degrees(path, heights, corner):
    """GeoTIFF of heights by longitude and latitude, with the corner of its first pixel."""
    tags = geotiff.tags_of(corner, DEGREES, 4326, "WGS 84", is_geographic=True)
    path.write_bytes(geotiff.encode(heights.astype(np.float32), tags))
    return path


@pytest.mark.parametrize("latitude", [-70.0, 0.01, 36.7])
def test_a_raster_in_degrees_is_seen_on_the_ellipsoid(tmp_path, capsys, latitude):
    rng = np.random.default_rng(int(latitude) % 7)
    heights = rng.normal(0, 12, (23, 31)).cumsum(axis=0) + 500
    path = write_degrees(tmp_path / "a.tif", heights, (10.0, latitude))
    place = 10 + 15.5 * DEGREES[0], latitude - 11.5 * DEGREES[1]  # the middle
    seen = rc.viewshed(path, (*place, 20.0))
    mesh = rc.Mesh.load(path)  # in metres from there
    east, north = Geod(ellps="WGS84").inv(*place, 10.0, latitude)[::2]
    corner = north * np.array((np.sin(np.radians(east)), np.cos(np.radians(east))))
    half = np.ptp(mesh.vertices[:, :2], axis=0) / 2 / (30, 22)
    np.testing.assert_allclose(mesh.vertices[0, :2] + half * (-1, 1), corner, atol=0.1)
    eye = np.array((0, 0, surface_at(mesh.vertices[mesh.faces], (0, 0)) + 20))
    covered = rc.evaluate(
        mesh, panorama(2000, 1000), rc.look_at([eye], [eye + np.array((1, 0, 0))])
    ).covered
    shares, bounds = (each / mesh.areas for each in (covered.area[0], covered.bound))
    near = abs(shares.reshape(-1, 2).mean(axis=1) - seen.share.ravel())
    assert (near <= bounds.reshape(-1, 2).sum(axis=1) + seen.bound.ravel() + 1e-4).all()
    line = ["viewshed", str(path), "--from", "{},{}".format(*place), "--height", "20"]
    out = ["--outlines", str(tmp_path / "a.json"), "--out", str(tmp_path / "out")]
    code, text, _ = call(capsys, [*line, *out, "--json"])
    assert code == 0
    sides = json.loads(text)["spacing_m"]
    assert sides == pytest.approx([2 * half[0], 2 * half[1]], rel=1e-3)
    outline = json.loads((tmp_path / "a.json").read_text())["features"][0]["geometry"]
    area = Geod(ellps="WGS84").geometry_area_perimeter(shapely.geometry.shape(outline))[0]
    assert abs(area) == pytest.approx(seen.seen[0].area, rel=1e-5)
    with Image.open(tmp_path / "out" / "viewshed.tif") as image:
        keys = image.tag_v2[34735]
        assert keys[4:8] == (1024, 0, 1, 2)
        assert keys[16:20] == (2048, 0, 1, 4326)
        assert image.tag_v2[33922][3:5] == pytest.approx(
            (10 + DEGREES[0] / 2, latitude - DEGREES[1] / 2), abs=1e-12
        )


def test_a_picture_shows_what_is_within_the_radius(tmp_path, capsys):
    path = write_raster(tmp_path / "a.tif", np.zeros((200, 300), np.float32))
    place = f"{ORIGIN[0] + 6009},{ORIGIN[1] - 1500}"
    out = ["--radius", "400", "--out", str(tmp_path / "out")]
    assert call(capsys, ["viewshed", str(path), "--from", place, *out])[0] == 0
    with Image.open(tmp_path / "out" / "viewshed.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    is_white = (pixels == 255).all(axis=2)
    assert 0.15 < is_white.mean() < 0.4  # around a circle
    assert min(pixels.shape[:2]) > 1000
    with Image.open(tmp_path / "out" / "viewshed.tif") as image:
        assert image.size == (299, 199)
    words = refusal(capsys, ["viewshed", str(path), "--from", place, "--radius", "1"])
    assert "expected ground within 1 m" in words


def test_a_folder_holds_one_viewshed_and_no_other_files_are_replaced(tmp_path, capsys):
    path = write_raster(tmp_path / "a.tif", np.zeros((9, 9), np.float32))
    line = ["viewshed", str(path), "--from", f"{ORIGIN[0] + 100},{ORIGIN[1] - 100}", "--out"]
    out = tmp_path / "out"
    for _ in range(2):
        assert call(capsys, [*line, str(out)])[0] == 0
    assert {each.name for each in out.iterdir()} == {
        "viewshed.tif", "viewshed.png", "observers.csv", ".rastercov-viewshed.json"
    }  # fmt: skip
    (out / "observers.csv").write_text("mine")
    before = (out / "viewshed.tif").stat().st_mtime_ns
    assert "observers.csv" in refusal(capsys, [*line, str(out)])
    assert (out / "observers.csv").read_text() == "mine"
    assert (out / "viewshed.tif").stat().st_mtime_ns == before


def surface_at(corners, place):
    """Height of the triangles (F, 3, 3) at a place on the map."""
    a, b, c = (corners[:, k, :2] - place for k in range(3))

    def cross(p, q):
        return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]

    parts = np.stack([cross(b, c), cross(c, a), cross(a, b)])
    row = int(np.argmax(parts.min(axis=0) / parts.sum(axis=0)))
    weights = parts[:, row] / parts[:, row].sum()
    return float(weights @ corners[row, :, 2])


REACH = sqrt(2 * 6371000 / 0.87)
"""Square root of twice the radius with refraction."""
CRITICAL = REACH * (sqrt(1.7) + sqrt(3.0))
"""Distance on a plane at which 1.7 m and 3 m lose sight of one another, m."""
LINES = {
    "plane, 3 km": (100, {}, 3.0, True),
    "wall of 50 m": (199, {100: 50}, 3.0, False),
    "wall of 1 m, 3 km": (99, {50: 1}, 3.0, True),
    "hollow": (99, dict.fromkeys(range(45, 55), -80), 3.0, True),
    "wall of 2 m, 3 km": (99, {50: 2}, 3.0, True),
    "wall of 2 m, 9 km": (299, {150: 2}, 3.0, False),
    "wall of 80 m, 3 km": (99, {50: 80}, 3.0, False),
    "ground behind a hill": (133, {67: 12}, 0.0, False),
    "30 m behind a hill": (133, {67: 12}, 30.0, True),
    "from a summit": (199, {0: 40}, 3.0, True),
    "to a summit": (199, {199: 40}, 3.0, True),
    "below the critical distance": (int(CRITICAL * 0.75 / 30), {}, 3.0, True),
    "beyond the critical distance": (int(CRITICAL * 1.6 / 30), {}, 3.0, False),
    "40 km": (int(40000 / 30), {}, 3.0, False),
    "1 km": (33, {}, 3.0, True),
}
"""Lines of sight of 30 m cells: last column, heights by column, target, whether it is seen.

V. L. Dimr. Silent failures of viewsheds. 2026, github.com/vl4dimr/silent-failures-viewshed.
"""


@pytest.mark.parametrize("name", LINES)
def test_published_lines_of_sight(name):
    last, changes, target, is_seen = LINES[name]
    heights = np.full((3, last + 2), 3800.0)
    for column, height in changes.items():
        heights[:, column] += height
    if last in changes:  # a summit at the end of the raster
        heights = heights[:, : last + 1]
    seen = rc.viewshed(heights, (0.0, -30.0, 1.7), spacing=30.0, target=target)
    assert (seen.share[:, last - 1 : last + 1] > 0).any() == is_seen


def test_sums_of_several_observers_and_the_radius():
    rng = np.random.default_rng(0)
    heights = rng.normal(0, 4, (30, 40)).cumsum(axis=1)
    observers = [(100.0, -80.0), (300.0, -200.0), (5.0, -5.0)]
    alone = [rc.viewshed(heights, each, spacing=10.0, radius=150.0) for each in observers]
    together = rc.viewshed(heights, observers, spacing=10.0, radius=150.0)
    parts = [np.nan_to_num(each.share) for each in alone]
    np.testing.assert_allclose(np.nan_to_num(together.share), sum(parts))
    assert together.seen == tuple(each.seen[0] for each in alone)
    whole = rc.viewshed(heights, observers[0], spacing=10.0)
    within = np.isfinite(alone[0].share)
    assert np.array_equal(whole.share[within], alone[0].share[within])
    x, y = np.arange(39) * 10 + 5 - 100.0, np.arange(29) * 10 + 5 - 80.0
    assert np.array_equal(within, np.hypot(x, y[:, None]) <= 150)


def test_the_curvature_is_that_of_a_sphere_for_every_observer():
    heights = np.zeros((3, 2002))
    for x in (0.0, 20000.0):
        seen = rc.viewshed(heights, (x, -30.0, 10.0), spacing=30.0, target=0.0)
        ahead = seen.share[0, int(x / 30) :]
        horizon = sqrt(2 * 10 * 6371000 / 0.87)
        assert ahead.sum() * 30 == pytest.approx(horizon, abs=60)
    flat = rc.viewshed(heights, (0.0, -30.0, 10.0), spacing=30.0, curvature=False)
    np.testing.assert_allclose(flat.share, 1, rtol=1e-12)


def write_raster(path, heights, more=None, nodata="-9999"):
    """GeoTIFF of heights with tags changed."""
    tags = geotiff.tags_of(ORIGIN, (25.0, 20.0), 32632, "UTM 32N") | {42113: (2, nodata)}
    path.write_bytes(geotiff.encode(heights, tags | (more or {})))
    return path


@pytest.mark.parametrize("dtype", [np.float32, np.int16, np.uint8, np.int32])
def test_rasters_of_files_are_those_of_arrays(tmp_path, dtype):
    heights = np.arange(20).reshape(4, 5).astype(dtype)
    heights[3, 4] = 99
    path = write_raster(tmp_path / "a.tif", heights, nodata="99")
    mesh = rc.Mesh.load(path)
    with_hole = np.where(heights == 99, np.nan, heights.astype(float))
    middle = (ORIGIN[0] + 12.5, ORIGIN[1] - 10.0)  # of the first pixel
    same = rc.Mesh.terrain(with_hole, (25.0, 20.0), origin=middle)
    assert np.array_equal(mesh.vertices, same.vertices)
    assert np.array_equal(mesh.faces, same.faces)
    assert mesh.n_faces == 2 * 12 - 2
    text = "".join(" ".join(map(str, row)) + "\n" for row in heights.tolist())
    head = f"ncols 5\nnrows 4\nxllcorner {ORIGIN[0]}\nyllcorner {ORIGIN[1] - 80}\ndx 25\ndy 20\n"
    (tmp_path / "a.asc").write_text(f"{head}NODATA_value 99\n{text}")
    assert np.array_equal(rc.Mesh.load(tmp_path / "a.asc").vertices, mesh.vertices)


@pytest.mark.parametrize("nodata", ["-9999.9", "-999.9", "-99999.99", "-32768"])
def test_no_data_is_compared_in_the_type_of_the_samples(tmp_path, nodata):
    """A text of float64 is no number of float32."""
    heights = np.arange(20, dtype=np.float32).reshape(4, 5)
    heights[1, 1] = np.float32(float(nodata))
    mesh = rc.Mesh.load(write_raster(tmp_path / "a.tif", heights, nodata=nodata))
    assert mesh.n_faces == 2 * 12 - 6
    assert mesh.bounds[0, 2] >= -0.01


def test_whole_numbers_of_32_bits_may_have_no_sign(tmp_path):
    heights = np.arange(20, dtype=np.uint32).reshape(4, 5)
    heights[1, 1] = 2**32 - 1
    path = write_raster(tmp_path / "a.tif", heights.view(np.int32), nodata=str(2**32 - 1))
    signed, unsigned = (struct.pack("<HHIH", 339, 3, 1, kind) for kind in (2, 1))
    data = path.read_bytes()
    assert data.count(signed) == 1
    path.write_bytes(data.replace(signed, unsigned))
    mesh = rc.Mesh.load(path)
    assert mesh.n_faces == 2 * 12 - 6
    assert mesh.bounds[0, 2] >= -0.01


def test_degrees_are_never_metres(tmp_path, capsys):
    """Of a file without keys, and of a geographic system without a code, written and read again."""
    heights, cell = np.zeros((4, 5), np.float32), (1 / 3600, 1 / 3600)
    tags = geotiff.tags_of((11.0, 48.0), cell)
    path = tmp_path / "a.tif"
    path.write_bytes(geotiff.encode(heights, {tag: tags[tag] for tag in (33550, 33922)}))
    with pytest.raises(rc.MeshError, match=r"expected metres, got cells of 0\.0002\d* as of"):
        rc.Mesh.load(path)
    path.write_bytes(geotiff.encode(heights, geotiff.tags_of((11.0, 48.0), cell, None, "d", True)))
    out = str(tmp_path / "out")
    assert call(capsys, ["viewshed", str(path), "--from", "11.0005,47.9995", "--out", out])[0] == 0
    again = rc.Mesh.load(tmp_path / "out" / "viewshed.tif")
    assert np.ptp(again.vertices[:, 0]) > 10


FEET = (1, 1, 0, 4, 1024, 0, 1, 1, 1025, 0, 1, 2, 3072, 0, 1, 32632, 3076, 0, 1, 9002)
"""Keys of a map in feet, whose pixels are points."""


def said(**items):
    """Tag of GDAL's metadata of the first band."""
    lines = [f'<Item name="X" sample="0" role="{key}">{each}</Item>' for key, each in items.items()]
    return {42112: (2, f"<GDALMetadata>{''.join(lines)}</GDALMetadata>")}


def test_a_pixel_that_is_a_point_and_feet(tmp_path):
    heights = np.full((3, 3), 10, np.float32)
    tags = {34735: (3, FEET)} | said(unittype="m")
    path = write_raster(tmp_path / "a.tif", heights, tags)
    mesh = rc.Mesh.load(path)
    foot = 0.3048
    assert rc.viewshed(path, mesh.bounds.mean(axis=0)[:2]).raster.crs == ""  # it is in metres
    assert mesh.bounds[0, 0] == pytest.approx(ORIGIN[0] * foot)
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(50 * foot)
    assert mesh.bounds[1, 2] == 10


@pytest.mark.parametrize(
    ("tags", "scale", "offset"),
    [
        (said(scale=0.5, offset=100), 0.5, 100),
        (said(unittype="ft"), 0.3048, 0),
        (said(unittype="US survey foot", scale=2), 2 * 1200 / 3937, 0),
        ({34735: (3, (1, 1, 0, 1, 4099, 0, 1, 9002))}, 0.3048, 0),
        ({34735: (3, (1, 1, 0, 1, 4096, 0, 1, 6360))}, 1200 / 3937, 0),
        ({34735: (3, (1, 1, 0, 1, 4096, 0, 1, 5703))}, 1, 0),
    ],
)
def test_heights_have_the_scale_and_unit_of_their_file(tmp_path, tags, scale, offset):
    heights = np.array([[1, 2, 3], [4, 5, 99]], np.int16)
    path = write_raster(tmp_path / "a.tif", heights, tags, nodata="99")
    mesh = rc.Mesh.load(path)
    wanted = np.array([1, 2, 4, 5]) * scale + offset
    np.testing.assert_allclose(mesh.vertices[:, 2], wanted, atol=1e-4)


def big_endian(values, packed):
    """TIFF of values, (H, W), most significant byte first."""
    data = values.astype(values.dtype.newbyteorder(">")).tobytes()
    data = zlib.compress(data) if packed else data
    kind = {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    rows, columns = values.shape
    short = {256: columns, 257: rows, 258: 8 * values.itemsize, 259: 8 if packed else 1}
    short |= {262: 1, 277: 1, 278: rows, 339: kind}
    long = {273: 8, 279: len(data)}
    place = 8 + len(data)
    after = place + 2 + 12 * (len(short) + len(long) + 2) + 4
    double = {33550: (25.0, 20.0, 0.0), 33922: (0.0, 0.0, 0.0, *ORIGIN, 0.0)}
    entries = {tag: struct.pack(">HHIHH", tag, 3, 1, value, 0) for tag, value in short.items()}
    entries |= {tag: struct.pack(">HHII", tag, 4, 1, value) for tag, value in long.items()}
    more = b""
    for tag, numbers in double.items():
        entries[tag] = struct.pack(">HHII", tag, 12, len(numbers), after + len(more))
        more += struct.pack(f">{len(numbers)}d", *numbers)
    table = struct.pack(">H", len(entries)) + b"".join(entries[tag] for tag in sorted(entries))
    return b"MM\0*" + struct.pack(">I", place) + data + table + bytes(4) + more


def test_bytes_may_have_a_sign(tmp_path):
    path = tmp_path / "a.tif"
    heights = np.array([[-10, 5], [127, -128]], np.int8)
    path.write_bytes(big_endian(heights, packed=False))
    mesh = rc.Mesh.load(path)
    np.testing.assert_allclose(mesh.vertices[:, 2], heights.ravel(), atol=1e-3)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "int32", "float32"])
def test_bytes_in_the_other_order_are_read_or_refused(tmp_path, dtype):
    heights = (np.arange(12).reshape(3, 4) * 7 + 3).astype(dtype)
    path = tmp_path / "a.tif"
    path.write_bytes(big_endian(heights, packed=False))
    mesh = rc.Mesh.load(path)
    np.testing.assert_allclose(mesh.vertices[:, 2], heights.ravel(), atol=1e-3)
    path.write_bytes(big_endian(heights, packed=True))
    with pytest.raises(rc.MeshError, match="expected a little-endian file"):
        rc.Mesh.load(path)


def test_a_mask_of_holes_is_refused(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.zeros((3, 3), np.float32))
    with Image.open(path) as image:
        more = Image.new("1", (3, 3))
        image.save(tmp_path / "b.tif", save_all=True, append_images=[more], tiffinfo=image.tag_v2)
    data = (tmp_path / "b.tif").read_bytes()
    at = data.rindex(struct.pack("<HHI", 262, 3, 1)) + 8
    (tmp_path / "b.tif").write_bytes(data[:at] + b"\4" + data[at + 1 :])
    with pytest.raises(rc.MeshError, match="gdalwarp"):
        rc.Mesh.load(tmp_path / "b.tif")


WRONG = {
    "geocentric": ({34735: (3, (1, 1, 0, 1, 1024, 0, 1, 3))}, "metres, feet or degrees"),
    "latitudes": ({34735: (3, (1, 1, 0, 1, 1024, 0, 1, 2))}, "latitudes within 89 degrees"),
    "no scale": ({33550: (12, (0.0, 0.0, 0.0))}, "expected a spacing from"),
    "rotated": ({34264: (12, (1.0,) * 16)}, "a transformation"),
    "Mercator": (
        {34735: (3, (1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 3857))},
        "expected a map with the lengths of the ground, got Mercator's, EPSG:3857; reproject it",
    ),
    "unit": ({34735: (3, (1, 1, 0, 1, 3076, 0, 1, 9999))}, "got unit 9999"),
    "feet alone": ({34735: (3, FEET)}, "expected the unit of heights of a map in feet"),
    "unit of heights": (said(unittype="cm"), "got unit 'cm'"),
    "scale": (said(scale="x"), "could not convert string to float: .*x"),
    "no heights": (said(scale="nan"), "expected heights, got none; check the value of no data"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_raster_of_another_kind_is_refused(tmp_path, name):
    tags, words = WRONG[name]
    path = write_raster(tmp_path / "a.tif", np.zeros((3, 3), np.float32), tags)
    with pytest.raises(rc.MeshError, match=words):
        rc.Mesh.load(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("ncols 3\n1 2 3\n", "nrows"),
        ("ncols 3\nnrows 2\ncellsize 1\n1 2 3 4 5", "2 x 3 heights, got 5"),
        ("ncols 3\nnrows 2\ncellsize 1\n1 2 a 4 5 6", "got (a word|2 numbers)"),
        ("ncols x\nnrows 2\ncellsize 1\n1 2 a 4 5 6", "could not convert string to float: .*x"),
        ("ncols 3\nnrows 1\ncellsize 1\n1 2 3", "2 x 2 heights"),
        ("ncols 3.5\nnrows 2\ncellsize 1\n1 2 3 4 5 6", "expected 2 x 3.5 heights, got 6"),
        ("ncols 2\nnrows 2\n1 2 3 4", "a spacing from"),
        (
            "ncols 2\nnrows 2\nxllcorner 11\nyllcorner 48\ncellsize 0.000277777\n1 2 3 4",
            r"expected metres, got cells of 0\.0002\d* as of degrees; say so: gdal_translate",
        ),
        ("ncols 2\nnrows 2\nyllcorner -90\ndx 0.005\ndy 0.004\n1 2 3 4", "as of degrees"),
    ],
)
def test_a_broken_grid_is_refused(tmp_path, content, words):
    (tmp_path / "a.asc").write_text(content)
    with pytest.raises(rc.MeshError, match=words):
        rc.Mesh.load(tmp_path / "a.asc")


@pytest.mark.parametrize(
    ("corner", "cell"), [((11, 48), 0.5), ((5e5, 5.3e6), 0.001), ((400, 0), 0.001)]
)
def test_a_small_grid_in_metres_is_read(tmp_path, corner, cell):
    head = "ncols 2\nnrows 2\nxllcorner {}\nyllcorner {}\n".format(*corner)
    (tmp_path / "a.asc").write_text(f"{head}cellsize {cell}\n1 2 3 4\n")
    assert rc.Mesh.load(tmp_path / "a.asc").n_faces == 2


def test_no_other_error_comes_of_a_damaged_raster(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.arange(42, dtype=np.float32).reshape(6, 7))
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(amount(300, 5000)):
        damaged = bytearray(data[: rng.integers(1, len(data) + 1)] if rng.random() < 0.2 else data)
        for _ in range(rng.integers(1, 4)):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        path.write_bytes(damaged)
        with suppress(rc.MeshError, rc.ResourceError):
            rc.Mesh.load(path)


def test_the_command_writes_what_python_computes(tmp_path, capsys):
    rng = np.random.default_rng(1)
    heights = (rng.normal(0, 4, (40, 50)).cumsum(axis=1) + 400).astype(np.float32)
    path = write_raster(tmp_path / "a.tif", heights)
    place = (ORIGIN[0] + 600.0, ORIGIN[1] - 400.0)
    line = ["viewshed", str(path), "--from", "{},{}".format(*place), "--height", "3"]
    out = ["--out", str(tmp_path / "out"), "--outlines", str(tmp_path / "a.geojson"), "--json"]
    code, text, err = call(capsys, [*line, *out])
    assert (code, "EPSG" in err) == (0, False)
    told = json.loads(text)["observers"][0]
    seen = rc.viewshed(path, (*place, 3.0))
    assert told["area_m2"] == seen.seen[0].area
    with Image.open(tmp_path / "out" / "viewshed.tif") as image:
        np.testing.assert_array_equal(np.asarray(image), seen.share.astype(np.float32))
    outline = json.loads((tmp_path / "a.geojson").read_text())["features"][0]["geometry"]
    assert outline["type"] == "MultiPolygon"
    assert shapely.geometry.shape(outline).area == pytest.approx(seen.seen[0].area, rel=1e-6)
    near = [*line, "--radius", "250", "--outlines", str(tmp_path / "b.geojson"), "--json"]
    code, text, _ = call(capsys, near)
    outline = json.loads((tmp_path / "b.geojson").read_text())["features"][0]["geometry"]
    area = json.loads(text)["observers"][0]["area_m2"]
    assert 0 < area < told["area_m2"]
    assert shapely.geometry.shape(outline).area == pytest.approx(area, rel=1e-6)
    assert call(capsys, [*line, "--at-least", "100"])[0] == 1
    (tmp_path / "a.asc").write_text("ncols 2\nnrows 2\ncellsize 1\n1 2\n3 4\n")
    local = ["viewshed", str(tmp_path / "a.asc"), "--from", "1,1", "--out", str(tmp_path / "local")]
    assert "warning: the raster has no EPSG code: files have its" in call(capsys, local)[2]
    (tmp_path / "o.csv").write_text("x,y,height\n{},{},3\n{},{},9\n".format(*place, *place))
    code, text, _ = call(capsys, ["viewshed", str(path), "--observers", str(tmp_path / "o.csv")])
    assert code == 0
    assert "2: " in text
    written = ["viewshed", str(path), "--observers", str(tmp_path / "out" / "observers.csv")]
    assert json.loads(call(capsys, [*written, "--json"])[1])["observers"][0] == told


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "got neither; give one"),
        (["--from", "1,2", "--observers", "o.csv"], "got both; give one"),
        (["--from", "1"], "expected --from X,Y, got: observer 1: expected 2 numbers"),
        (["--from", "1,a"], "column 'y', observer 1: expected a number"),
        (["--from", "1,2"], "an observer on the raster"),
        (["--from", "500100,5299900", "--height", "-1"], "a height of 0 or more"),
        (["--from", "500100,5299900", "--radius", "0"], "a radius above 0"),
        (["--from", "500100,5299900", "--target", "-1"], "a target of 0 m or more"),
        (["--from", "500100,5299900", "--refraction", "1"], "a number from -10 to below 1"),
        (["--from", "500100,5299900", "--outlines", "a.shp"], "to be .geojson or .json"),
        (["--observers", "nothing.csv"], "with a CSV file"),
        (["--observers", "/dev/zero"], "a regular file, got a device"),
        (["--from", "1,2", "--at-least", "101"], "a number of at most 100"),
        (["--from", "1,2", "--outlines", "a.json", "--beside", "a.obj"], "--outlines or --beside"),
    ],
)
def test_wrong_options_are_one_line(tmp_path, capsys, options, words):
    path = write_raster(tmp_path / "a.tif", np.zeros((9, 9), np.float32))
    assert words in refusal(capsys, ["viewshed", str(path), *options])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("x,y\n1,2\n3\n", "observer 2: expected 2 numbers, one per name, got 1"),
        ("x,y,height\n1,2,3\n3,4,z\n", "column 'height', observer 2: expected a number"),
        ("x,y\n", "1 to 10,000 observers, got 1 rows"),
        ("lon,lat\n1,2\n", "expected columns x and y, got lon, lat"),
        ("x,height\n1,2\n", "expected columns x and y, got x, height"),
    ],
)
def test_rows_of_observers_are_named_as_such(tmp_path, capsys, table, words):
    path = write_raster(tmp_path / "a.tif", np.zeros((9, 9), np.float32))
    (tmp_path / "o.csv").write_text(table)
    given = refusal(capsys, ["viewshed", str(path), "--observers", str(tmp_path / "o.csv")])
    assert words in given
    assert "--observers with a CSV file of x,y,height" in given
    assert "--from" not in given
    assert "frame" not in given
