"""Each stage of the CPU rasteriser gives what its numpy twin in the reference gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rastercov.native import raster_stages as stages
from rastercov.native.engine_raster import BOUNDS_OF_CLUSTER, LANES, SIDE, STEPS
from rastercov.reference import raster_stages as twin

pytestmark = pytest.mark.native
SEEDS = st.integers(0, 2**32 - 1)


def bits_of(mask):
    return int((np.asarray(mask, np.int64) << np.arange(LANES)).sum())


def split(bits, n):
    """Masks (n, LANES) that stand side by side."""
    return np.int64(bits) >> np.arange(n * LANES).reshape(n, LANES) & 1 > 0


def assert_equal(found, expected):
    """Bit for bit, but for the sign of zero and which NaN it is."""
    assert np.array_equal(found, expected, equal_nan=np.asarray(found).dtype.kind == "f")


# --- projection and culling of clusters -----------------------------------------------------------


def camera_of(rng):
    """Camera record with any rotation, near plane and focal length."""
    camera = np.zeros(18)
    camera[:9] = np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel()
    camera[9:12] = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 3)
    focal = 10.0 ** rng.uniform(-2, 5, 2)
    camera[12:] = *focal, *rng.uniform(-300, 900, 2), 10.0 ** rng.uniform(-6, 1), focal.max()
    return camera


@given(SEEDS, st.integers(1, 8), st.booleans())
@settings(max_examples=25)
@np.errstate(all="ignore")  # points in the plane of the camera
def test_vertices_are_projected_alike(seed, n_vectors, is_safe):
    rng = np.random.default_rng(seed)
    camera, n, first = camera_of(rng), 8 * n_vectors, 24
    points = rng.normal(size=(3, n)) * 10.0 ** rng.uniform(-4, 4, n)
    if is_safe:  # the caller vouches for it: before the camera, and not far from its axis
        away = np.stack((rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), rng.uniform(1, 3, n)))
        points = camera[:9].reshape(3, 3) @ away + camera[9:12, None]
    memory = np.concatenate((np.zeros(3 * first), points.ravel(), np.zeros(LANES)))
    exact, whole = np.zeros((3, 64)), np.zeros((2, 64), np.int32)
    box = np.zeros(4, np.int64)
    stages.project_vertices(memory, first, n, camera, is_safe, exact, whole, box)
    expected = twin.project_vertices(points, camera, is_safe)
    for found, values in zip((*exact, *whole), expected, strict=True):
        assert_equal(found[:n], values)
    x, y = expected[3:]
    assert box.tolist() == [x.min(), x.max(), y.min(), y.max()]


@given(SEEDS, st.booleans())
@settings(max_examples=25)
def test_clusters_are_culled_alike(seed, hides_backs):
    rng = np.random.default_rng(seed)
    camera, size = camera_of(rng), (640.0, 100.0, 480.0)
    bounds = np.zeros((BOUNDS_OF_CLUSTER, LANES))
    bounds[:3] = rng.normal(size=(3, LANES)) * 10.0 ** rng.uniform(-3, 3)
    bounds[3] = 10.0 ** rng.uniform(-3, 1, LANES)
    axis, angle = rng.normal(size=(3, LANES)), rng.uniform(0, 1.5, LANES)
    bounds[4:7], bounds[7:9] = axis / np.linalg.norm(axis, axis=0), (np.cos(angle), np.sin(angle))
    bounds[9], bounds[10] = -bounds[3] * rng.random(LANES), bounds[3] * rng.random(LANES)
    frustum, centres = np.zeros((5, 4)), np.zeros((2, LANES))
    stages.put_frustum(camera, *size, frustum)
    magnification = camera[12:14].min()
    bits = stages.cull_clusters(bounds, camera, frustum, magnification, hides_backs, centres)
    kept, safe, middles = twin.cull_clusters(bounds, camera, frustum, magnification, hides_backs)
    assert_equal(split(bits, 2), (kept, safe))
    assert_equal(centres, middles)
    fy, cy = camera[13], camera[15]
    band = fy, cy - size[1], frustum[2, 3], size[2] - cy, frustum[3, 3]
    expected = twin.clusters_in_band(bounds[3], middles, *band)
    assert stages.clusters_in_band(bounds[3], centres, *band) == bits_of(expected)


# --- triangles ------------------------------------------------------------------------------------


def triangles(seed, scale, is_flawed=False):
    """A vector of faces with corners about a window, on quarters of samples now and then."""
    rng = np.random.default_rng(seed)
    size = STEPS * scale * 10.0 ** rng.uniform(-2, 0, (LANES, 1))
    middle = rng.uniform(-20, 140, (2, LANES, 1)) * STEPS
    u, v = middle + size * rng.uniform(-1, 1, (2, LANES, 3))
    is_round = rng.random((LANES, 1)) < 0.5
    u, v = (np.where(is_round, np.round(one / 64) * 64, one) for one in (u, v))
    x, y = np.floor(u + 0.5), np.floor(v + 0.5)
    if is_flawed:
        flaws = 0, stages.BEHIND, stages.NEEDS_CLIPPING
        flaw = rng.choice(flaws, (LANES, 3), p=(0.7, 0.2, 0.1))
        x, y = np.where(flaw, flaw, x), np.where(flaw, flaw, y)
    exact = np.stack((u, v, 1 / rng.uniform(1, 3, (LANES, 3))))
    positions = np.zeros((3, 64)), np.zeros((2, 64), np.int32)
    order = rng.permutation(3 * LANES)
    positions[0][:, order] = exact.reshape(3, -1)
    positions[1][:, order] = x.ravel(), y.ravel()
    corners = (order.reshape(LANES, 3) @ (1, 256, 65536)).astype(np.int32)
    right, top, bottom = rng.integers((20, 0, 50), (130, 12, 120)).tolist()
    window = twin.Window(
        right, SIDE * top, bottom, bool(rng.integers(0, 2)), 48, 128, (right + 1) // SIDE, 32
    )
    return positions, corners, window, exact, np.stack((x, y), axis=-1).astype(np.int64)


@given(SEEDS, st.sampled_from((1, 3, 12, 60)), st.booleans())
@settings(max_examples=25)
def test_faces_are_culled_and_binned_alike(seed, scale, is_flawed):
    positions, corners, window, _, places = triangles(seed, scale, is_flawed)
    listed, coverage = np.zeros((6, LANES), np.int32), np.zeros((2, LANES), np.int32)
    stages.cull_and_bin(positions, corners, window, not is_flawed, listed, coverage)
    masks, covered = twin.bin_faces(places, corners > 0, window, not is_flawed)
    small, larger, wide, clipped, hidden_small, hidden_larger = masks
    expected = small, larger, hidden_small, hidden_larger, wide, clipped
    for row, mask in zip(listed, expected, strict=True):
        assert row[row >= 0].tolist() == np.flatnonzero(mask).tolist()
    for row, mask in zip(coverage, (small, hidden_small), strict=True):
        assert row[: mask.sum()].tolist() == covered[mask].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("kind", [stages.Stages32, stages.Stages64])
@given(SEEDS, st.sampled_from((1, 3, 12, 60)))
@settings(max_examples=25)
@np.errstate(all="ignore")  # degenerate triangles have no plane
def test_triangles_are_set_up_covered_and_located_alike(kind, seed, scale):
    if kind is stages.Stages64:
        scale *= 100
    positions, corners, window, exact, places = triangles(seed, scale)
    rng = np.random.default_rng(seed)
    chosen, faces = (rng.permutation(LANES).astype(np.int32) for _ in range(2))
    setup = kind(positions, corners, faces, chosen, window)
    edges, plane64 = np.zeros((9, LANES), np.int64), np.zeros((3, LANES))
    bounds, plane32 = np.zeros((5, LANES), np.int32), np.zeros((4, LANES), np.float32)
    sides = np.zeros(5, np.int64)
    setup.figures((edges, bounds, plane64, plane32, sides))
    places, exact = places[chosen], exact[:, chosen].swapaxes(1, 2)
    its_edges, its_bounds, *planes = twin.set_up_triangles(exact, places, window)
    area = twin.signed_area(places)
    can_cover = (its_bounds[1] >= its_bounds[0]) & (its_bounds[3] >= its_bounds[2])
    hidden = can_cover & (area > 0) & window.hides_back
    shown = can_cover & (area != 0) & ~hidden
    blocks = its_bounds // SIDE
    columns, n_rows = blocks[1] - blocks[0], blocks[3] - blocks[2]
    in_2x2 = (columns <= 1) & (n_rows <= 1)
    assert sides.tolist() == [*map(bits_of, (in_2x2, columns > 0, n_rows > 0, shown, hidden))]
    assert_equal(bounds, (*its_bounds, faces[chosen]))
    is_whole = area != 0
    assert_equal(edges[:, can_cover], its_edges[:, can_cover])
    assert_equal(plane64[:, is_whole], planes[0][:, is_whole])
    assert_equal(plane32[:, is_whole], planes[1][:, is_whole])
    ok = can_cover & is_whole
    out = np.zeros(LANES, np.int32), np.zeros(LANES, np.int32), np.zeros(LANES, np.float32)
    if kind is stages.Stages32:
        covered_alike(setup, places, its_bounds, window, planes, ok, in_2x2, out)
    for k in np.flatnonzero(ok)[:3].tolist():
        x, y = blocks[0, k] + np.arange(LANES) % SIDE, blocks[2, k] + np.arange(LANES) // SIDE
        bound, found = float(plane32[2:, k].mean()), np.zeros(3, np.int64)
        least = setup.tile(k, bound, found, out)
        reached, whole, hides = split(found[0], 1)[0], split(found[1], 1)[0], split(found[2], 1)[0]
        masks, sample, start = out
        assert_equal(masks, twin.cover_block(np.tile(places[k], (LANES, 1, 1)), x, y))
        assert_equal(reached, twin.reach_blocks(its_edges[:, k], 0, 0))
        assert not masks[~reached].any()
        assert_equal((sample, start), twin.block_starts(x, y, window, plane64[:, k]))
        assert_equal(whole, twin.whole_blocks(its_edges[:, k], 0, 0))
        assert (masks[whole] == 0xFFFF).all()
        assert_equal(hides, twin.hidden_blocks(plane32[:, k], start, np.float32(bound)))
        assert_equal(np.float32(least), twin.least_in_tile(plane32[:, k], start))


def covered_alike(setup, places, bounds, window, planes, ok, in_2x2, out):
    """Hold what triangles of up to `LARGE` steps cover against the twins."""
    masks, sample, depth = out
    for k in range(4):
        found = split(setup.cover_blocks(k, out), 2)
        expected = twin.cover_blocks(k, places, bounds, window, planes[0])
        for one, other in zip((*found, *out), expected, strict=True):
            assert_equal(np.asarray(one)[ok & in_2x2], np.asarray(other)[ok & in_2x2])
        setup.depth_of_samples(k, out)
        its_sample, its_depth = twin.depth_of_samples(k, bounds, window, *planes)
        assert_equal(sample[ok], its_sample[ok])
        assert_equal(depth[ok], its_depth[ok])
    fits = twin.fit_count_samples(bounds)
    assert_equal(split(setup.fit_count_samples(), 1)[0], fits)
    setup.count_samples(bits_of(ok & fits), masks)
    expected = twin.count_samples(places[ok & fits], bounds[:, ok & fits])
    assert_equal(masks[ok & fits], expected)
    for k in np.flatnonzero(ok).tolist():
        for start in range(0, int(bounds[3, k] - bounds[2, k]) + 1, LANES):
            expected = twin.count_rows(places[k], bounds[:, k], start)
            assert setup.count_rows(k, start) == expected


# --- depths ---------------------------------------------------------------------------------------


@given(SEEDS)
@settings(max_examples=25)
def test_cells_and_clusters_are_bounded_alike(seed):
    rng = np.random.default_rng(seed)
    exact, n = rng.random((3, 64)), 8 * int(rng.integers(1, 9))
    nearest = stages.nearest_vertex((exact, np.zeros((2, 64), np.int32)), n)
    assert_equal(np.float32(nearest), twin.nearest_vertex(exact[2, :n]))
    columns, n_rows = 16, int(rng.integers(1, 5))
    block = SIDE * int(rng.integers(0, 4)) + SIDE * columns
    depth = rng.random((SIDE + n_rows) * columns * LANES).astype(np.float32)
    least = stages.least_depth(depth, block, columns, n_rows)
    assert_equal(np.float32(least), twin.least_depth(depth, block, columns, n_rows))


@given(SEEDS)
@settings(max_examples=25)
def test_depths_are_tested_alike(seed):
    rng = np.random.default_rng(seed)
    depth = (rng.integers(0, 6, 3 * LANES) / 4).astype(np.float32)
    steps, ends = rng.integers(-2, 3, 2) / 4, np.sort(rng.integers(0, 8, 2) / 4)
    plane = np.concatenate((steps, ends)).astype(np.float32)
    covered, start = rng.random(LANES) < 0.7, np.float32(0.75)
    old, found = depth.reshape(3, LANES).copy(), np.zeros(3, np.int64)
    stages.depth_test(depth, bits_of(covered), plane, float(start), found)
    expected, *masks = twin.depth_test(old[1], covered, plane, start)
    assert_equal(depth.reshape(3, LANES), (old[0], expected, old[2]))
    assert found.tolist() == [bits_of(mask) for mask in masks]


# --- bits and lists of lanes ----------------------------------------------------------------------


def test_every_mask_is_listed_in_order_behind_what_was_there():
    starts = np.random.default_rng(0).integers(0, 8, 1 << LANES).tolist()
    for mask in range(0, 1 << LANES, 7):  # any value of either byte is among them
        listed, start, is_set = np.full(3 * LANES, -1, np.int32), starts[mask], split(mask, 1)[0]
        n = stages.append_set_bits(mask, 3 * mask, listed, start)
        assert n == start + is_set.sum()
        expected = twin.append_set_bits(np.full(start, -1), is_set, 3 * mask)
        assert np.array_equal(listed[:n], expected)
        assert (listed[start + LANES :] == -1).all()  # no more than it has room for
