"""Unions of many small pieces: cells divide a face, and change no area."""

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.area import polygons
from rastercov.core.area.polygons import polygon_areas
from rastercov.core.area.table import Regions
from rastercov.core.area.union import RegionUnion

pytestmark = pytest.mark.native

MESH = rc.Mesh(vertices=[(0, 0, 0), (7, 0, 0), (2, 4, 0)], faces=[(0, 1, 2)])
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def grid(rng, n, size=1.9, filled=0.63):
    """Squares in rows and columns."""
    side = int(np.sqrt(n))
    pitch = size / (side + 1)
    corner = np.stack(np.divmod(np.arange(side * side), side), axis=1) + rng.uniform(0, 0.5, 2)
    return (corner * pitch)[:, None] + SQUARE * pitch * filled


def cluster(rng, n):
    """The same in a thousandth of the face."""
    return grid(rng, n, 2e-3) + 0.7


def tiles(rng, n):
    """Squares that have their corners in common."""
    return grid(rng, n, 1.7, 1.0)


def band(rng, n):
    """Pieces along a circle, as of a border of the field of view."""
    angle = np.linspace(0.1, 1.4, n + 1) + rng.uniform(0, 1e-3)
    ring = np.stack((np.cos(angle), np.sin(angle)), axis=1) * (1.8 + rng.uniform(0, 0.01))
    return np.stack((ring[:-1], ring[:-1] * 1.0001, ring[1:] * 1.0001, ring[1:]), axis=1)


def slivers(rng, n):
    """Parallel strips along no axis, as long as all of them are wide."""
    along, across = np.array((0.8, 0.6)), np.array((-0.6, 0.8))
    start = (0.8, 0.1) + np.arange(n)[:, None] * across / n + rng.uniform(0, 1e-4)
    wide = across * 0.6 / n
    return np.stack((start, start + along, start + along + wide, start + wide), axis=1)


KINDS = grid, cluster, tiles, band, slivers


def regions_of(parts):
    """Regions of a pose for each (N, 4, 2) array of squares in the face."""
    xy = np.concatenate(parts).reshape(-1, 2) + np.array((2.0, 0.0))
    counts = [len(part) for part in parts]
    n, rows = sum(counts), np.arange(len(parts), dtype=np.int32)
    areas = polygon_areas(xy, np.arange(n + 1) * 4)
    pose = np.repeat(rows, counts)
    return Regions(
        mesh=MESH, camera=rc.Camera(width=64, height=64, fx=64, fy=64), task=rc.Task(),
        pose_ids=np.arange(len(parts)), xy=xy, starts=np.arange(n + 1) * 4,
        face=np.zeros(n, np.int32), pose=pose,
        pair_pose=rows, pair_face=np.zeros(len(parts), np.int32),
        area=np.bincount(pose, areas), bound=np.zeros(len(parts)), excess=None,
        eyes=np.zeros((len(parts), 3)),
    )  # fmt: skip


def some(kind, n, poses=3, seed=0):
    rng = np.random.default_rng(seed)
    return regions_of([kind(rng, n) for _ in range(poses)])


def pairs_compared(regions):
    """Pairs of pieces in one cell: those that a union compares."""
    union = RegionUnion(MESH)
    union.add(regions)
    return union._overlay.united.n_pairs()


@pytest.mark.parametrize("kind", KINDS)
def test_twice_as_many_pieces_have_little_more_than_twice_as_many_pairs_to_compare(kind):
    one, two, four = (pairs_compared(some(kind, n)) for n in (4_000, 8_000, 16_000))
    assert one < 4_000 * 3 * 2 * polygons.MOST_PIECES
    assert two < 2.6 * one
    assert four < 2.6 * two


@pytest.mark.parametrize("views", [1, 2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_divided_face_has_the_union_of_a_whole_one(kind, views, monkeypatch):
    regions = some(kind, 400)
    divided = rc.unite(regions, views)
    monkeypatch.setattr(polygons, "MOST_PIECES", 10**9)
    whole = rc.unite(regions, views)
    assert (np.abs(divided.area - whole.area) <= divided.bound + whole.bound + 1e-15).all()
    assert divided.bound[0] < 1e-6 * whole.area[0, 0]
    pieces = polygon_areas(divided.xy, divided.starts)
    assert pieces.min() > 0
    assert np.isclose(pieces.sum(), whole.area[0, 0], rtol=1e-9)


def test_poses_one_by_one_cut_no_piece_again_and_again():
    rng = np.random.default_rng(0)
    parts = [grid(rng, 900) for _ in range(12)]
    union = RegionUnion(MESH, 1)
    for part in parts:
        union.add(regions_of([part]))
    whole = rc.unite(regions_of(parts))
    one_by_one = union.covered()
    assert np.isclose(one_by_one.area[0, 0], whole.area[0, 0], rtol=0, atol=whole.bound[0] * 3)
    assert len(one_by_one) < 2 * len(whole)


def test_equal_pieces_that_no_line_separates_are_united():
    square = grid(np.random.default_rng(0), 1)
    covered = rc.unite(regions_of([square] * 1_000), 2)
    assert len(covered) == 1
    assert np.isclose(covered.area[1, 0], polygon_areas(square[0], np.array([0, 4]))[0])


def test_a_face_that_many_pieces_cover_is_one_piece():
    n = 40  # of a fan of needles from the bottom to the top of the face
    low = np.stack((np.linspace(0, 7, 600), np.zeros(600)), axis=1)
    top = np.full((599, 2), (2.0, 4.0))
    quads = np.stack((low[:-1], low[1:], (low[1:] + top) / 2, top), axis=1) - (2, 0)
    union = RegionUnion(MESH, 1)
    for start in range(0, len(quads), n):
        union.add(regions_of([quads[start : start + n]]))
    covered = union.covered()
    assert union.closed.all()
    assert len(covered) == 1
    assert np.isclose(covered.area[0, 0], MESH.areas[0], rtol=1e-9)


def test_a_union_says_how_far_it_is_and_can_be_stopped():
    regions, said = some(grid, 4_000), []
    rc.unite(regions, progress=lambda done, total: said.append((done, total)))
    done = [done for done, _ in said]
    assert len(said) > 2
    assert done == sorted(done)
    assert said[-1][0] == said[-1][1]

    def stop(done, total):
        raise KeyboardInterrupt

    union = RegionUnion(MESH, 1)
    union.add(some(grid, 400, seed=1))
    before = union.covered()
    with pytest.raises(KeyboardInterrupt):
        union.add(regions, stop)
    after = union.covered()
    assert np.array_equal(before.area, after.area)
    union.add(regions)
    assert union.covered().area[0, 0] > before.area[0, 0]


def test_what_nothing_covers_of_a_divided_face_is_its_rest():
    covered = rc.unite(some(grid, 2_000, poses=2))
    zones = rc.dead_zones(covered)
    assert np.isclose(zones.area.sum() + covered.area[0, 0], MESH.areas[0], rtol=1e-9)
