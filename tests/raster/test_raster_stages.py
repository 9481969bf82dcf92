"""Each stage of the CPU rasteriser gives what its numpy twin in the reference gives."""

from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numba import njit
from numba.core import cgutils, types
from numba.extending import intrinsic

from rastercov.kernels import raster_memory
from rastercov.kernels import raster_stage_cover as cover
from rastercov.kernels import raster_stage_cull as cull
from rastercov.kernels import raster_stage_depth as depths
from rastercov.kernels import raster_stage_setup as set_up
from rastercov.kernels.raster_loops import put_frustum
from rastercov.kernels.raster_memory import (
    LANES,
    SIDE,
    STEPS,
    Cluster,
    Faces,
    Image,
    Mesh,
    Setup,
    Vertices,
    Window,
    make_scratch,
)
from rastercov.kernels.raster_stage_vertices import project_vertices
from rastercov.kernels.simd_kernel import append_set_bits, count_bits, lowest_bit
from rastercov.reference import raster_stages as twin

SEEDS = st.integers(0, 2**32 - 1)
NONE = np.zeros(1, np.int32)


def of_memory(kind):
    """Type of an argument with pointers for its arrays."""
    if isinstance(kind, types.BaseNamedTuple):
        return types.NamedTuple([of_memory(each) for each in kind], kind.instance_class)
    return types.CPointer(kind.dtype) if isinstance(kind, types.Array) else kind


def memory(context, builder, kind, value):
    if isinstance(kind, types.BaseNamedTuple):
        parts = zip(kind, cgutils.unpack_tuple(builder, value), strict=True)
        values = [memory(context, builder, *part) for part in parts]
        return context.make_tuple(builder, of_memory(kind), values)
    is_array = isinstance(kind, types.Array)
    return context.make_array(kind)(context, builder, value).data if is_array else value


@intrinsic
def in_memory(typing, args):
    """Arguments with pointers for their arrays."""

    def generate(context, builder, signature, values):
        parts = zip(args, cgutils.unpack_tuple(builder, values[0]), strict=True)
        found = [memory(context, builder, *part) for part in parts]
        return context.make_tuple(builder, signature.return_type, found)

    return types.Tuple([of_memory(kind) for kind in args])(args), generate


@cache
def loop_of(stage):
    @njit
    def loop(*args):
        return stage(*in_memory(args))

    return loop


def run(stage, *args):
    """Result of a stage, which takes pointers, for arrays."""
    return loop_of(stage)(*args)


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
    camera = np.zeros(raster_memory.CAMERA_VALUES)
    camera[:9] = np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel()
    camera[9:12] = rng.normal(size=3) * 10.0 ** rng.uniform(-3, 3)
    focal = 10.0 ** rng.uniform(-2, 5, 2)
    camera[12:] = *focal, *rng.uniform(-300, 900, 2), 10.0 ** rng.uniform(-6, 1), focal.max()
    return camera


@pytest.mark.slow
@given(SEEDS, st.integers(1, 8), st.booleans())
@settings(max_examples=25, deadline=None)
@np.errstate(all="ignore")  # points in the plane of the camera
def test_vertices_are_projected_alike(seed, n_vectors, is_safe):
    rng = np.random.default_rng(seed)
    camera, n, first = camera_of(rng), 8 * n_vectors, 24
    points = rng.normal(size=(3, n)) * 10.0 ** rng.uniform(-4, 4, n)
    if is_safe:  # the caller vouches for it: before the camera, and not far from its axis
        away = np.stack((rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), rng.uniform(1, 3, n)))
        points = camera[:9].reshape(3, 3) @ away + camera[9:12, None]
    scratch = make_scratch()
    memory_of = np.concatenate((np.zeros(3 * first), points.ravel(), np.zeros(LANES)))
    mesh = Mesh(memory_of, NONE, NONE, NONE)
    cluster = Cluster(first, first + n, 0, 0, 0, 0, int(is_safe))
    vertices = Vertices(scratch.u, scratch.v, scratch.w, scratch.x, scratch.y)
    box = run(project_vertices, mesh, cluster, camera, vertices)
    expected = twin.project_vertices(points, camera, is_safe)
    for found, values in zip(vertices, expected, strict=True):
        assert_equal(found[:n], values)
    x, y = expected[3:]
    assert box == (x.min(), x.max(), y.min(), y.max())


@pytest.mark.slow
@given(SEEDS, st.booleans())
@settings(max_examples=25, deadline=None)
def test_clusters_are_culled_alike(seed, hides_backs):
    rng = np.random.default_rng(seed)
    camera, size = camera_of(rng), np.array((640.0, 100.0, 480.0))
    bounds = np.zeros((raster_memory.BOUNDS_OF_CLUSTER, 3 * LANES))
    bounds[:3] = rng.normal(size=(3, 48)) * 10.0 ** rng.uniform(-3, 3)
    bounds[3] = 10.0 ** rng.uniform(-3, 1, 48)
    axis, angle = rng.normal(size=(3, 48)), rng.uniform(0, 1.5, 48)
    bounds[4:7], bounds[7:9] = axis / np.linalg.norm(axis, axis=0), (np.cos(angle), np.sin(angle))
    bounds[9], bounds[10] = -bounds[3] * rng.random(48), bounds[3] * rng.uniform(0, 1, 48)
    frustum, centres = np.zeros((5, 4)), np.zeros((2, 48))
    hides = raster_memory.ALL_LANES if hides_backs else 0
    run(put_frustum, camera, *size, frustum)
    clusters = bounds, bounds.shape[1]
    magnification = camera[12:14].min()
    bits = run(cull.cull_clusters, *clusters, LANES, camera, frustum, magnification, hides, centres)
    chosen = slice(LANES, 2 * LANES)
    kept, safe, middles = twin.cull_clusters(
        bounds[:, chosen], camera, frustum, magnification, hides_backs
    )
    assert_equal(split(bits, 2), (kept, safe))
    assert_equal(centres[:, chosen], middles)
    fy, cy = camera[13], camera[15]
    band = fy, cy - size[1], frustum[2, 3], size[2] - cy, frustum[3, 3]
    expected = twin.clusters_in_band(bounds[3, chosen], middles, *band)
    found = run(cull.clusters_in_band, *clusters, LANES, centres, *band)
    assert found == bits_of(expected)


# --- triangles ------------------------------------------------------------------------------------


def triangles(seed, scale, is_flawed=False):
    """A vector of faces with corners about a window, on quarters of samples now and then."""
    rng = np.random.default_rng(seed)
    scratch = make_scratch()
    size = STEPS * scale * 10.0 ** rng.uniform(-2, 0, (LANES, 1))
    middle = rng.uniform(-20, 140, (2, LANES, 1)) * STEPS
    u, v = middle + size * rng.uniform(-1, 1, (2, LANES, 3))
    is_round = rng.random((LANES, 1)) < 0.5
    u, v = (np.where(is_round, np.round(one / 64) * 64, one) for one in (u, v))
    x, y = np.floor(u + 0.5), np.floor(v + 0.5)
    if is_flawed:
        flaw = rng.choice(
            (0, raster_memory.BEHIND, raster_memory.NEEDS_CLIPPING), (LANES, 3), p=(0.7, 0.2, 0.1)
        )
        x, y = np.where(flaw, flaw, x), np.where(flaw, flaw, y)
    vertices = Vertices(scratch.u, scratch.v, scratch.w, scratch.x, scratch.y)
    w = 1 / rng.uniform(1, 3, (LANES, 3))
    order = rng.permutation(3 * LANES)
    for array, values in zip(vertices, (u, v, w, x, y), strict=True):
        array[order] = values.ravel()
    corners = order.reshape(LANES, 3) @ (1, 256, 65536)
    scratch.coverage_2x2[:LANES] = rng.integers(0, 16, LANES)
    scratch.larger[:LANES], scratch.wide[:LANES] = rng.permutation(LANES), range(LANES)
    mesh = Mesh(np.zeros(1), padded(corners), padded(rng.permutation(LANES)), NONE)
    top, bottom = SIDE * int(rng.integers(0, 12)), int(rng.integers(50, 120))
    right, hides = int(rng.integers(20, 130)), int(rng.integers(0, 2))
    window = Window(
        *np.array((right, top, bottom, hides, 48), np.int32), 128,
        *np.array(((right + 1) // SIDE, 128 // SIDE), np.int32), NONE, NONE, NONE,
    )  # fmt: skip
    exact = np.stack((u, v, w))
    return scratch, mesh, vertices, window, exact, np.stack((x, y), axis=-1).astype(np.int64)


def padded(values):
    """As many words as a cluster can have faces."""
    out = np.zeros(raster_memory.FACES, np.int32)
    out[: len(values)] = values
    return out


def setup_of(scratch, edges):
    return Setup(
        edges, scratch.bounds, scratch.plane64, scratch.plane32, scratch.sample, scratch.depth,
        scratch.masks,
    )  # fmt: skip


def rows(array, n):
    return array[: n * LANES].reshape(n, LANES)


@pytest.mark.slow
@given(SEEDS, st.sampled_from((1, 3, 12, 60)), st.booleans())
@settings(max_examples=25, deadline=None)
def test_faces_are_culled_and_binned_alike(seed, scale, is_flawed):
    scratch, mesh, vertices, window, _, places = triangles(seed, scale, is_flawed)
    faces = Faces(mesh, 0, vertices, scratch.coverage_2x2)
    shown, hidden = run(cull.bin_faces, faces, 0, window, int(not is_flawed))
    is_face = mesh.corners[:LANES] > 0
    expected, covered = twin.bin_faces(places, is_face, window, not is_flawed)
    assert_equal(np.concatenate((split(shown, 4), split(hidden, 2))), expected)
    small = expected[0] | expected[4]
    assert_equal(scratch.coverage_2x2[:LANES][small], covered[small])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["edges", "edges_64_bit"])
@given(SEEDS, st.sampled_from((1, 3, 12, 60)))
@settings(max_examples=25, deadline=None)
@np.errstate(all="ignore")  # degenerate triangles have no plane
def test_triangles_are_set_up_covered_and_located_alike(kind, seed, scale):
    if kind == "edges_64_bit":
        scale *= 100
    scratch, mesh, vertices, window, exact, places = triangles(seed, scale)
    slots, setup = scratch.larger, setup_of(scratch, getattr(scratch, kind))
    chosen = slots[:LANES]
    faces = Faces(mesh, 0, vertices, scratch.coverage_2x2)
    sizes, sides = run(set_up.set_up_triangles, slots, 0, 1, faces, window, setup)
    places, exact = places[chosen], exact[:, chosen].swapaxes(1, 2)
    edges, bounds, plane64, plane32 = twin.set_up_triangles(exact, places, window)
    area = twin.signed_area(places)
    can_cover = (bounds[1] >= bounds[0]) & (bounds[3] >= bounds[2])
    shown = can_cover & ((area < 0) | ((area > 0) & (window.hides_back == 0)))
    hidden = can_cover & (area > 0) & (window.hides_back > 0)
    assert_equal(split(sides, 2), (shown, hidden))
    columns, n_rows = bounds[1] // SIDE - bounds[0] // SIDE, bounds[3] // SIDE - bounds[2] // SIDE
    expected = (columns <= 1) & (n_rows <= 1), columns > 0, n_rows > 0
    assert_equal(split(sizes, 3), expected)
    assert_equal(rows(setup.bounds, 4), bounds)
    assert_equal(rows(setup.bounds, 5)[4], mesh.faces[chosen])
    is_whole = area != 0
    assert_equal(rows(setup.edges, 9)[:, can_cover], edges[:, can_cover])
    assert_equal(rows(setup.plane64, 3)[:, is_whole], plane64[:, is_whole])
    assert_equal(rows(setup.plane32, 4)[:, is_whole], plane32[:, is_whole])
    run(set_up.set_up_edges, slots, 0, faces, window, setup)
    small = run(cover.fit_count_samples, setup)
    fits = twin.fit_count_samples(bounds)
    assert_equal(split(small, 1)[0], fits)
    ok = can_cover & is_whole
    if kind == "edges":
        for k in range(4):
            found = split(run(cover.cover_blocks, k, window, setup), 2)
            has, border, masks, sample, start = twin.cover_blocks(
                k, places, bounds, window, plane64
            )
            written = [rows(a, 4)[k] for a in (setup.masks, setup.sample, setup.depth)]
            in_blocks = ok & expected[0]
            for one, other in zip(
                (*found, *written), (has, border, masks, sample, start), strict=True
            ):
                assert_equal(np.asarray(one)[in_blocks], np.asarray(other)[in_blocks])
            run(depths.depth_of_samples, k, window, setup)
            samples = run(cover.coverage_of_samples, setup)
            coverage = scratch.coverage_2x2[chosen]
            assert_equal(split(samples, 4), twin.coverage_of_samples(coverage))
            sample, depth = twin.depth_of_samples(k, bounds, window, plane64, plane32)
            assert_equal(rows(setup.sample, 4)[k][ok], sample[ok])
            assert_equal(rows(setup.depth, 4)[k][ok], depth[ok])
        run(cover.count_samples, bits_of(ok & fits), setup)
        expected = twin.count_samples(places[ok & fits], bounds[:, ok & fits])
        assert_equal(setup.masks[:LANES][ok & fits], expected)
        for k in np.flatnonzero(ok):
            for start in range(0, bounds[3, k] - bounds[2, k] + 1, LANES):
                found = run(cover.count_rows, k, start, setup)
                assert found == twin.count_rows(places[k], bounds[:, k], start)
    for k in np.flatnonzero(ok)[:3]:
        first_x, first_y = int(bounds[0, k]) // SIDE, int(bounds[2, k]) // SIDE
        bound = rows(scratch.plane32, 4)[2:, k].mean()
        reached = run(cover.reach_blocks, k, 0, 0, setup)
        run(cover.start_blocks, k, first_x, first_y, window, setup)
        masks = np.array([run(cover.cover_block, block, setup) for block in range(LANES)])
        whole, least = run(cover.whole_blocks, k, setup), run(depths.least_in_tile, k, setup)
        hidden = run(depths.hidden_blocks, k, bound, setup)
        x, y = first_x + np.arange(LANES) % SIDE, first_y + np.arange(LANES) // SIDE
        assert_equal(masks, twin.cover_block(np.tile(places[k], (LANES, 1, 1)), x, y))
        assert_equal(split(reached, 1)[0], twin.reach_blocks(edges[:, k], 0, 0))
        assert not masks[~split(reached, 1)[0]].any()
        sample, start = twin.block_starts(x, y, window, plane64[:, k])
        assert_equal(setup.sample[:LANES], sample)
        assert_equal(setup.depth[:LANES], start)
        assert_equal(split(whole, 1)[0], twin.whole_blocks(edges[:, k], 0, 0))
        assert (masks[split(whole, 1)[0]] == raster_memory.ALL_LANES).all()
        assert_equal(split(hidden, 1)[0], twin.hidden_blocks(plane32[:, k], start, bound))
        assert_equal(least, twin.least_in_tile(plane32[:, k], start))


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_cells_and_clusters_are_bounded_alike(seed):
    rng = np.random.default_rng(seed)
    scratch = make_scratch()
    vertices = Vertices(scratch.u, scratch.v, scratch.w, scratch.x, scratch.y)
    vertices.w[:] = rng.random(len(vertices.w))
    columns, n_rows, n = 16, int(rng.integers(1, 5)), 8 * int(rng.integers(1, 9))
    block = SIDE * int(rng.integers(0, 4)) + SIDE * columns
    depth = rng.random((SIDE + n_rows) * columns * LANES).astype(np.float32)
    owner, face = rng.integers(0, 5, LANES).astype(np.int32), int(rng.integers(5))
    least = run(depths.least_depth, depth, block, columns, n_rows)
    nearest = run(depths.nearest_vertex, vertices, n)
    later = run(depths.samples_of_later_faces, owner, 0, face)
    assert_equal(least, twin.least_depth(depth, block, columns, n_rows))
    assert_equal(nearest, twin.nearest_vertex(vertices.w[:n]))
    assert_equal(split(later, 1)[0], twin.samples_of_later_faces(owner, face))


@pytest.mark.slow
@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_depths_are_tested_alike(seed):
    rng = np.random.default_rng(seed)
    scratch = make_scratch()
    setup = setup_of(scratch, scratch.edges)
    depth = (rng.integers(0, 6, 3 * LANES) / 4).astype(np.float32)
    planes = rows(scratch.plane32, 4)
    planes[:2] = rng.integers(-2, 3, (2, LANES)) / 4
    planes[2], planes[3] = np.sort(rng.integers(0, 8, (2, LANES)) / 4, axis=0)
    k, covered, start = int(rng.integers(LANES)), rng.random(LANES) < 0.7, np.float32(0.75)
    old = depth[LANES : 2 * LANES].copy()
    others = depth[:LANES].copy(), depth[2 * LANES :].copy()
    image = Image(depth, NONE, NONE, NONE, False)
    found = run(depths.depth_test, image, LANES, bits_of(covered), setup, k, start)
    expected, *masks = twin.depth_test(old, covered, planes[:, k], start)
    assert_equal(depth[LANES : 2 * LANES], expected)
    assert_equal(split(found, 3), masks)
    assert_equal((depth[:LANES], depth[2 * LANES :]), others)


# --- bits and lists of lanes ----------------------------------------------------------------------


def test_every_mask_is_listed_in_order_behind_what_was_there():
    n_masks, room = 1 << LANES, 3 * LANES
    bit_indices = make_scratch().bit_indices
    starts = np.random.default_rng(0).integers(0, 8, n_masks)
    listed = np.full((n_masks, room), -1, np.int32)
    for mask in range(0, n_masks, 7):  # any value of either byte is among them
        start, is_set = starts[mask], split(mask, 1)[0]
        n = run(append_set_bits, bit_indices, mask, 3 * mask, listed[mask], start)
        assert n == start + is_set.sum()
        expected = twin.append_set_bits(np.full(start, -1), is_set, 3 * mask)
        assert np.array_equal(listed[mask, :n], expected)
    column = np.arange(room)
    assert (listed[column >= starts[:, None] + LANES] == -1).all()  # no more than it has room for


@given(st.integers(-(2**63), 2**63 - 1).filter(bool))
@example(1)
@example(-(2**63))
def test_bits_are_counted_and_the_lowest_is_found(number):
    digits = format(number % 2**64, "b")
    lowest = len(digits) - len(digits.rstrip("0"))
    assert (run(count_bits, number), run(lowest_bit, number)) == (digits.count("1"), lowest)


@given(arrays(np.uint8, LANES), st.integers(0, 65535))
def test_weights_of_a_block_are_bytes_without_a_sign(weights, bits):
    assert run(depths.count_block, bits, 0, weights) == weights[split(bits, 1)[0]].sum()
