"""The loops of the CPU rasteriser, compiled by numba.

They stand in one file because numba keeps what it compiled by file: a loop that calls into another
file would not notice a change there.

A mesh comes in clusters of up to 64 faces (`rastercov.raster.clusters`). A pose takes one at a
time, and leaves out those that lie outside the image or turn their back, without a look at their
faces. `project` brings the vertices of a cluster to the image, in steps of 1/256 of a sample.
`sift` looks at sixteen faces at once and keeps those that can own a sample. `set_up_lanes` makes
edge functions and planes of 1/z for sixteen that were kept. Those that reach at most 2 x 2 samples
are still taken together, by `fill_tiny`; of others `fill_blocks` takes one at a time, and sixteen
samples, a block of 4 x 4. Faces that are large in the image, or reach behind the camera, go the
same way with more digits.

A sample on a left or upper edge is inside, on a right or lower one outside, and all of it is
reckoned in whole numbers, so every sample belongs to exactly one of two triangles that share an
edge.

A sample counts for its face when it is written and is taken from the face that held it before, so
what remains at the end are the visible samples, and nobody has to look at the image again.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988, for edge functions.
M. Abrash. Rasterization on Larrabee. 2009, for blocks within blocks, sixteen at once.
"""

from collections import namedtuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from rastercov.compiled import compiled, forced
from rastercov.raster.lanes import (
    DOUBLE, LONG, SINGLE, WORD, Lanes, constants, from_bits, gather, load, looked_up, prefetch, spread,
)  # fmt: skip

BITS = 8
STEPS = 1 << BITS
HALF = STEPS // 2
"""Sub-sample steps, as many as graphics devices have. Shifts divide: `//` would test for zero."""
FAR_OUT = 1 << 29
"""Steps from the origin beyond which a vertex is clipped: edges then fit 64 bits with room."""
CLIPPED = 2**31 - 1
"""Steps of a vertex that is."""
CLIP_CORNERS = 8
"""A triangle cut by five planes has at most this many corners."""
LARGE = 100 * STEPS
"""Steps across a triangle beyond which 32 bits do not hold its edge functions."""

SIDE_BITS = 2
SIDE = 1 << SIDE_BITS
"""Samples across a block; and blocks across a group of them."""
LANES, ALL_LANES = SIDE * SIDE, 0xFFFF
"""Samples of a block, blocks of a group, or faces at once."""
LANE_X, LANE_Y = [k % SIDE for k in range(LANES)], [k // SIDE for k in range(LANES)]
PATCH_BITS = 4
"""Blocks in a row that are cleared together, as a power of 2."""

FACES, VERTICES = 64, 64
"""Of a cluster, at most. Corners of clipped faces follow its vertices."""
SAMPLES_A_CLUSTER = 128
"""Samples of an image for each cluster below which all of it is cleared at once."""
FEW = 4
"""Triangles from which on it pays to take sixteen together."""
CACHE_LINE = 64
"""Bytes that are fetched together; where it is more, some are asked for twice."""
ROOM = 256
"""Vertices that a byte can tell apart; and enough for all else that a cluster wants."""
E, ACROSS, DOWN, CORNER, INNER = 0, 3, 6, 9, 12
EDGE_ROWS = 15
"""Rows of `edges`, for each of three edge functions, in units of `STEPS`: its value at the first
sample of the first block that a triangle reaches, its step to the next sample and to the next row.
Then those of one triangle: its values at the first samples of sixteen blocks, and what it gains from
there to the other samples of a block."""
FIRST_X, LAST_X, FIRST_Y, LAST_Y, FACE = 0, 1, 2, 3, 4
WHOLE_ROWS = 5
"""Rows of `whole`: the samples that the triangle reaches, and its face."""
ORIGIN, SLOPE_X, SLOPE_Y = 0, 1, 2
EXACT_ROWS = 3
"""Rows of `exact`: 1/z at the first sample of the image, its steps to the next sample and row."""
STEP_X, STEP_Y, LEAST, GREATEST = 0, 1, 2, 3
PLANE_ROWS = 4
"""Rows of `plane`: the steps again, and 1/z of the farthest and of the nearest corner."""
EYE, LENS, NEAR, WIDEST = 9, 12, 16, 17
VIEW = 18
"""Figures of a pose: rotation (9), eye (3), lens (4), near plane, and the most that a length parallel
to the image, over its depth, is magnified to, in samples."""

Shape = namedtuple("Shape", "points corners faces")
"""A mesh in clusters: pointers, as in all of these, to what `rastercov.raster.clusters` made."""
Placed = namedtuple("Placed", "u v w x y both")
"""Vertices of a cluster in the image: exact steps, 1/z, and whole steps, alone and together."""
Window = namedtuple(
    "Window", "right top bottom hides_back columns height full_x full_y inner first last"
)
"""What of the image is drawn: the last column, the first and last row, whether faces that turn their
back are hidden, blocks in a row of memory, rows of the image; columns and rows of blocks before which all blocks are inside, blocks of each row
of blocks that are, and samples of each row."""
Batch = namedtuple("Batch", "whole exact plane sample here masks")
"""Sixteen triangles: rows of what the constants above name. Then one sample or block of each: where
in memory, and 1/z at its first sample; and bits of sixteen blocks."""
Lists = namedtuple("Lists", "tiny small hidden large clipped")
"""Faces of a cluster, see `sift`."""
Image = namedtuple("Image", "depth owner")
"""Blocks of samples: 1/z, 0 where nothing is; and the face."""
Counts = namedtuple("Counts", "visible drawn with_drawn")
"""Samples of each face to add to; `drawn` only where asked for."""


@intrinsic
def pointer(typing, array):
    """Where the data of an array stands. What takes an array counts a reference, and at its end."""

    def generate(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


# --- sixteen at once ------------------------------------------------------------------------------


@intrinsic
def project(typing, points, begin, end, view, placed):
    """Bring the vertices of a cluster to the image; returns the box that they fill, in steps.

    Least and greatest x, least and greatest y.

    Parameters
    ----------
    points : float64
        x of the cluster's vertices from 3 `begin` on, then their y, then their z, from the same
        origin as the eye.
    begin, end : int
        First vertex of the cluster, and of the next one.
    view : (17,) float64
        world_from_camera, eye, fx, fy, cx, cy in samples, and the depth below which a vertex is cut
        off.
    placed : Placed
        Out. `u`, `v`: steps of 1/256 sample, not rounded. `w`: 1/z. `x`, `y`, and `both` together:
        where the vertex stands when samples are given out, `CLIPPED` where it needs clipping. What
        comes after the cluster's vertices means nothing.
    """

    def generate(context, builder, signature, args):
        points, begin, end, view, placed = args
        figures = [
            spread(builder, builder.load(builder.gep(view, [LONG(k)])), LANES) for k in range(VIEW)
        ]
        n = builder.sub(end, begin)
        lanes = constants(builder, LONG, range(LANES))
        words = lanes.to(WORD)
        box = []
        for start in (CLIPPED, -CLIPPED) * 2:
            box.append(cgutils.alloca_once_value(builder, words.like(start).value))
        with cgutils.for_range_slice(builder, LONG(0), n, LONG(LANES), LONG) as (to, _):
            at = [
                builder.add(builder.add(builder.mul(begin, LONG(3)), builder.mul(n, LONG(axis))), to)
                for axis in range(3)
            ]
            steps = _project_lanes(builder, points, at, figures, placed, to)
            is_vertex = lanes < spread(builder, builder.sub(n, to), LANES)
            for k, found in enumerate(box):
                old, new = Lanes(builder, builder.load(found)), steps[k >> 1]
                closest = new.greatest(old) if k & 1 else new.least(old)
                builder.store(closest.where(is_vertex, old).value, found)
        found = [
            Lanes(builder, builder.load(found)).reduced("greatest" if k & 1 else "least")
            for k, found in enumerate(box)
        ]
        return context.make_tuple(builder, signature.return_type, found)

    box = types.UniTuple(types.int32, 4)
    return box(points, types.int64, types.int64, view, placed), generate


def _project_lanes(builder, points, at, figures, placed, to):
    """Place sixteen vertices; returns their whole steps."""
    u, v, w, x, y, both = (builder.extract_value(placed, k) for k in range(6))
    away = [
        load(builder, builder.gep(points, [at[axis]]), LANES) - figures[EYE + axis]
        for axis in range(3)
    ]
    right, down, z = (
        away[0] * figures[k] + away[1] * figures[3 + k] + away[2] * figures[6 + k] for k in range(3)
    )
    inverse = z.like(1.0) / z
    is_seen = z >= figures[NEAR]
    exact = (
        (figures[LENS] * right * inverse + figures[LENS + 2]) * float(STEPS),
        (figures[LENS + 1] * down * inverse + figures[LENS + 3]) * float(STEPS),
    )
    for position in exact:
        is_seen = is_seen & (position.magnitude() <= float(FAR_OUT))
    inverse.store(builder.gep(w, [to]))
    steps = []
    for position, u_or_v, x_or_y in zip(exact, (u, v), (x, y), strict=True):
        position.store(builder.gep(u_or_v, [to]))
        rounded = (position.where(is_seen, 0.0) + 0.5).floor().to(WORD)
        steps.append(rounded.where(is_seen, CLIPPED))
        steps[-1].store(builder.gep(x_or_y, [to]))
    together = (steps[1].to(LONG) << 32) | (steps[0].to(LONG) & 0xFFFFFFFF)
    together.store(builder.gep(both, [to]))
    return steps


@intrinsic
def cull_lanes(typing, bounds, stride, at, view, sides, focal, leaves_out_backs):
    """Bits of sixteen clusters, from `at` on, of which something may have to be drawn.

    A cluster lies outside where its sphere is beyond one of the planes of `frustum`. All of its
    faces turn their back, and still do once rounded to steps, where their planes are far enough
    from the eye: with D the distance of the cluster's farthest point and h that of the eye behind
    the plane of a face, the altitudes of the face are in the image at least focal h / D^2 of what
    they are in space. Rounding moves a corner by at most 0.71 steps, so it turns no face whose
    altitudes are 3 steps or more. Faces that are clipped are cut and rounded again, so they stay.
    """

    def generate(context, builder, signature, args):
        bounds, stride, at, view, sides, focal, leaves_out_backs = args

        def row(k):
            place = builder.add(builder.mul(stride, LONG(k)), at)
            return load(builder, builder.gep(bounds, [place]), LANES)

        def figure(pointer, k):
            return spread(builder, builder.load(builder.gep(pointer, [LONG(k)])), LANES)

        away = [row(k) - figure(view, EYE + k) for k in range(3)]
        radius, near = row(3), figure(view, NEAR)
        for k in range(5):
            normal = [figure(sides, 4 * k + axis) for axis in range(3)]
            distance = normal[0] * away[0] + normal[1] * away[1] + normal[2] * away[2]
            limit = near if k == 4 else radius.like(0)
            beyond = distance + radius * figure(sides, 4 * k + 3) < limit
            is_outside = beyond if k == 0 else is_outside | beyond
        nearest = distance - radius  # along the axis of the camera
        squared = away[0] * away[0] + away[1] * away[1] + away[2] * away[2]
        along = away[0] * row(4) + away[1] * row(5) + away[2] * row(6)
        across = (squared - along * along).greatest(0).root()
        height = across * row(8) - along * row(7) - row(9)  # the greatest over its normals
        reach = squared.root() + radius
        magnified = spread(builder, focal, LANES) * float(STEPS)
        is_back = height * row(10) * magnified < reach * reach * -3.1
        is_back = is_back & (nearest >= near)
        is_back = is_back & (reach * figure(view, WIDEST) <= nearest * float(FAR_OUT >> BITS >> 1))
        wanted = from_bits(builder, leaves_out_backs, LANES)
        return (~(is_outside | (is_back & wanted))).bits()

    whole = types.int64
    return whole(bounds, whole, whole, view, sides, types.float64, whole), generate


def _corners(context, builder, packed, placed, kind):
    """Indices of the three corners of sixteen faces, and their places in the image.

    A processor with registers of sixteen lanes looks places of vertices up in them; others fetch
    each place, and so do triangles that may have been clipped.
    """
    indices = [packed >> 8 * k & (ROOM - 1) for k in range(3)]
    places = []
    if kind == WORD and "+avx512f" in context.codegen().magic_tuple()[2]:
        tables = []
        for k in (3, 4):
            array = builder.extract_value(placed, k)
            parts = range(0, VERTICES, LANES)
            tables.append([load(builder, builder.gep(array, [LONG(at)]), LANES) for at in parts])
        for index in indices:
            places.append(tuple(looked_up(table, index).to(kind) for table in tables))
    else:
        both = builder.extract_value(placed, 5)
        for index in indices:
            together = gather(builder, both, index.each())
            places.append((together.to(WORD).to(kind), (together >> 32).to(WORD).to(kind)))
    return [index.each() for index in indices], places


def _reach(places, right, top, bottom):
    """Samples that triangles reach, from first to last, and their extent in steps."""
    (ax, ay), (bx, by), (cx, cy) = places
    low_x, high_x = ax.least(bx).least(cx), ax.greatest(bx).greatest(cx)
    low_y, high_y = ay.least(by).least(cy), ay.greatest(by).greatest(cy)
    first_x = ((low_x + (HALF - 1)) >> BITS).greatest(0)
    last_x = ((high_x - HALF) >> BITS).least(right)
    first_y = ((low_y + (HALF - 1)) >> BITS).greatest(top)
    last_y = ((high_y - HALF) >> BITS).least(bottom)
    return first_x, last_x, first_y, last_y, high_x - low_x, high_y - low_y


def _edges(places, area, at_x, at_y):
    """Edge functions of triangles at samples, each with its steps to the next sample and row.

    They are 0 or more inside, in units of `STEPS`.
    """
    (ax, ay), (bx, by), (cx, cy) = places
    turned = area < 0
    px, py = cx.where(turned, bx), cy.where(turned, by)
    qx, qy = bx.where(turned, cx), by.where(turned, cy)
    found = []
    for from_x, from_y, to_x, to_y in ((ax, ay, px, py), (px, py, qx, qy), (qx, qy, ax, ay)):
        dx, dy = to_x - from_x, to_y - from_y
        value = dx * ((at_y << BITS) + HALF - from_y) - dy * ((at_x << BITS) + HALF - from_x)
        is_left_or_upper = (dy < 0) | (dy.equals(0) & (dx > 0))
        value = value.where(is_left_or_upper, value - 1)
        found.append((value >> BITS, dy.like(0) - dy, dx))
    return found


def _sign(values):
    """Less than 0 where one of three is."""
    return values[0] | values[1] | values[2]


@intrinsic
def sift_lanes(typing, corners, at, placed, window, batch):
    """Which of sixteen faces can own a sample: 4 x 16 bits, and 2 x 16 bits of hidden ones.

    The lowest reach at most 2 x 2 samples and own one, the next ones reach more, the next ones are
    large, and the last want clipping; these two were not looked at further. Hidden are those that
    turn their back where that hides them. How many samples the lowest own goes to `batch.masks`.
    """

    def generate(context, builder, signature, args):
        corners, at, placed, window, batch = args
        packed = load(builder, builder.gep(corners, [at]), LANES)
        _, places = _corners(context, builder, packed, placed, WORD)
        right, top, bottom, hides_back = (
            spread(builder, builder.extract_value(window, k), LANES) for k in (0, 1, 2, 3)
        )
        first_x, last_x, first_y, last_y, width, height = _reach(places, right, top, bottom)
        (ax, ay), (bx, by), (cx, cy) = places
        wide, tall = last_x - first_x, last_y - first_y
        can_own = (wide >= 0) & (tall >= 0)
        is_clipped = ax.greatest(bx).greatest(cx).equals(CLIPPED) & (packed > 0)
        is_large = (width >= LARGE) | (height >= LARGE)
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        edges = _edges(places, area, first_x, first_y)
        owned = wide.like(0)
        for k in range(4):
            i, j = k & 1, k >> 1
            values = [value + across * i + down * j for value, across, down in edges]
            is_owned = (_sign(values) >= 0) & (wide >= i) & (tall >= j)
            owned = (owned + 1).where(is_owned, owned)
        owned.store(builder.extract_value(batch, 5))
        is_tiny = (wide <= 1) & (tall <= 1)
        is_small = can_own & ~(is_large | is_clipped)
        classes = is_small & is_tiny & (owned > 0), is_small & ~is_tiny
        is_large = is_large & can_own & ~is_clipped
        is_hidden = (area > 0) & (hides_back > 0)
        is_shown = (area < 0) | ((area > 0) & (hides_back <= 0))
        found = []
        for side in is_shown, is_hidden:
            bits = (classes[0] & side).bits()
            next_bits = builder.shl((classes[1] & side).bits(), LONG(LANES))
            found.append(builder.or_(bits, next_bits))
        for k, group in ((2, is_large), (3, is_clipped)):
            found[0] = builder.or_(found[0], builder.shl(group.bits(), LONG(k * LANES)))
        return context.make_tuple(builder, signature.return_type, found)

    both = types.UniTuple(types.int64, 2)
    return both(corners, types.int64, placed, window, batch), generate


def _planes(builder, placed, indices, places, area, put, batch):
    """Put planes of 1/z into the rows of a batch."""
    exact, plane = (builder.extract_value(batch, k) for k in (1, 2))
    # 1/z is affine in the image: w = w_a + slope_x (u - u_a) + slope_y (v - v_a), from the
    # corners as they are; as rounded where the triangle is too thin for that.
    arrays = [builder.extract_value(placed, k) for k in range(3)]
    (au, av, aw), (bu, bv, bw), (cu, cv, cw) = (
        [gather(builder, array, index) for array in arrays] for index in indices
    )
    rounded = area.to(DOUBLE)
    is_thin = ((bu - au) * (cv - av) - (cu - au) * (bv - av) - rounded).magnitude()
    is_thin = is_thin > rounded.magnitude() * 0.25
    (au, av), (bu, bv), (cu, cv) = (
        (x.to(DOUBLE).where(is_thin, u), y.to(DOUBLE).where(is_thin, v))
        for (x, y), (u, v) in zip(places, ((au, av), (bu, bv), (cu, cv)), strict=True)
    )
    ab_x, ab_y, ac_x, ac_y = bu - au, bv - av, cu - au, cv - av
    w_ab, w_ac = bw - aw, cw - aw
    scale = aw.like(float(STEPS)) / (ab_x * ac_y - ac_x * ab_y)
    slope_x = (w_ab * ac_y - w_ac * ab_y) * scale
    slope_y = (w_ac * ab_x - w_ab * ac_x) * scale
    away = slope_x * (au.like(HALF) - au) + slope_y * (av.like(HALF) - av)
    put(exact, ORIGIN, aw + away * (1.0 / STEPS))
    put(exact, SLOPE_X, slope_x)
    put(exact, SLOPE_Y, slope_y)
    put(plane, STEP_X, slope_x)
    put(plane, STEP_Y, slope_y)
    # Rounding lets a sample lie a hair beyond the corners; its depth does not.
    put(plane, LEAST, aw.least(bw).least(cw))
    put(plane, GREATEST, aw.greatest(bw).greatest(cw))


def _set_up(with_planes):
    """The intrinsic that sets up triangles, with or without their planes of 1/z."""

    @intrinsic
    def set_up_lanes(
        typing, chosen, at, shape, placed, window, edges, batch, visible
    ):  # fmt: skip
        """Edge functions and planes of sixteen triangles, in as many bits as `edges` has.

        Returns bits of those that reach at most 2 x 2 blocks; above them those that reach two columns,
        and two rows: of samples, if they reach at most 2 x 2, else of blocks. And bits of those that
        can own a sample, as far as their corners tell; above them those of these that are hidden.
        """

        def generate(context, builder, signature, args):
            chosen, at, shape, placed, window, edges, batch, visible = args
            corners, faces = (builder.extract_value(shape, k) for k in (1, 2))
            whole = builder.extract_value(batch, 0)
            kind = edges.type.pointee

            def put(array, row, value):
                value.to(array.type.pointee).store(builder.gep(array, [LONG(row * LANES)]))

            slots = []
            for lane in range(LANES):
                slot = builder.load(builder.gep(chosen, [builder.add(at, LONG(lane))]))
                slots.append(builder.sext(slot, LONG))
            packed = gather(builder, corners, slots)
            indices, places = _corners(context, builder, packed, placed, kind)
            right, top, bottom = (
                spread(builder, builder.extract_value(window, k), LANES).to(kind) for k in (0, 1, 2)
            )
            first_x, last_x, first_y, last_y, _, _ = _reach(places, right, top, bottom)
            (ax, ay), (bx, by), (cx, cy) = places
            area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
            for k, (value, across, down) in enumerate(
                _edges(
                    places,
                    area,
                    first_x >> SIDE_BITS << SIDE_BITS,
                    first_y >> SIDE_BITS << SIDE_BITS,
                )
            ):
                put(edges, E + k, value)
                put(edges, ACROSS + k, across)
                put(edges, DOWN + k, down)
            for row, value in enumerate((first_x, last_x, first_y, last_y)):
                put(whole, row, value)
            put(whole, FACE, gather(builder, faces, slots))

            if with_planes:
                for slot in slots:
                    face = builder.sext(builder.load(builder.gep(faces, [slot])), LONG)
                    prefetch(builder, builder.gep(visible, [face]), is_written=True)
                _planes(builder, placed, indices, places, area, put, batch)
            is_tiny = (last_x - first_x <= 1) & (last_y - first_y <= 1)
            wide, tall = (
                (last >> SIDE_BITS) - (first >> SIDE_BITS)
                for first, last in ((first_x, last_x), (first_y, last_y))
            )
            groups = (
                (wide <= 1) & (tall <= 1),
                (is_tiny & (last_x > first_x)) | (~is_tiny & (wide > 0)),
                (is_tiny & (last_y > first_y)) | (~is_tiny & (tall > 0)),
            )
            found = LONG(0)
            for k, group in enumerate(groups):
                found = builder.or_(found, builder.shl(group.bits(), LONG(k * LANES)))
            hides = spread(builder, builder.extract_value(window, 3), LANES) > 0
            can_own = (last_x >= first_x) & (last_y >= first_y)
            shown = can_own & ((area < 0) | ((area > 0) & ~hides))
            hidden = can_own & (area > 0) & hides
            sides = builder.or_(shown.bits(), builder.shl(hidden.bits(), LONG(LANES)))
            return context.make_tuple(builder, signature.return_type, (found, sides))

        arguments = chosen, types.int64, shape, placed, window, edges, batch, visible
        return types.UniTuple(types.int64, 2)(*arguments), generate

    return set_up_lanes


set_up_lanes, set_up_edges = _set_up(with_planes=True), _set_up(with_planes=False)


@intrinsic
def tiny_lanes(typing, k, window, edges, batch):
    """Bits of those of sixteen triangles that own sample k of at most 2 x 2.

    Where in memory it stands goes to `batch.sample`, and its 1/z to `batch.here`.
    """

    def generate(context, builder, signature, args):
        k, window, edges, batch = args
        whole, exact, plane, sample, here = (builder.extract_value(batch, n) for n in range(5))
        top, columns = (spread(builder, builder.extract_value(window, n), LANES) for n in (1, 4))

        def get(array, row):
            return load(builder, builder.gep(array, [LONG(row * LANES)]), LANES)

        first_x, first_y = get(whole, FIRST_X), get(whole, FIRST_Y)
        x = first_x + spread(builder, builder.and_(k, WORD(1)), LANES)
        y = first_y + spread(builder, builder.lshr(k, WORD(1)), LANES)
        in_x, in_y = x - (first_x >> SIDE_BITS << SIDE_BITS), y - (first_y >> SIDE_BITS << SIDE_BITS)
        values = [
            get(edges, E + n) + get(edges, ACROSS + n) * in_x + get(edges, DOWN + n) * in_y
            for n in range(3)
        ]
        owns = (x <= get(whole, LAST_X)) & (y <= get(whole, LAST_Y)) & (_sign(values) >= 0)
        block_x, block_y = x >> SIDE_BITS, y >> SIDE_BITS
        in_x, in_y = x & (SIDE - 1), y & (SIDE - 1)
        block = (block_y - (top >> SIDE_BITS)) * columns + block_x
        ((((block << SIDE_BITS) + in_y) << SIDE_BITS) + in_x).store(sample)
        corner_x, corner_y = (block_x << SIDE_BITS).to(DOUBLE), (block_y << SIDE_BITS).to(DOUBLE)
        start = get(exact, ORIGIN) + get(exact, SLOPE_Y) * corner_y + get(exact, SLOPE_X) * corner_x
        away = get(plane, STEP_X) * in_x.to(SINGLE) + get(plane, STEP_Y) * in_y.to(SINGLE)
        nearness = (start.to(SINGLE) + away).greatest(get(plane, LEAST)).least(get(plane, GREATEST))
        nearness.store(here)
        return owns.bits()

    return types.int64(types.int32, window, edges, batch), generate


@intrinsic
def few_lanes(typing, k, window, edges, batch):
    """Bits of those of sixteen triangles that have samples in block k of 2 x 2; above, border ones.

    Which samples goes to `batch.masks`, where in memory the block stands to `batch.sample`, and 1/z
    at its first sample to `batch.here`.
    """

    def generate(context, builder, signature, args):
        k, window, edges, batch = args
        whole, exact, _, sample, here, masks = (builder.extract_value(batch, n) for n in range(6))
        top, columns, full_x, full_y = (
            spread(builder, builder.extract_value(window, n), LANES) for n in (1, 4, 6, 7)
        )

        def get(array, row):
            return load(builder, builder.gep(array, [LONG(row * LANES)]), LANES)

        i = spread(builder, builder.and_(k, WORD(1)), LANES)
        j = spread(builder, builder.lshr(k, WORD(1)), LANES)
        block_x = (get(whole, FIRST_X) >> SIDE_BITS) + i
        block_y = (get(whole, FIRST_Y) >> SIDE_BITS) + j
        across, below = ([get(edges, row + n) for n in range(3)] for row in (ACROSS, DOWN))
        first = [
            get(edges, E + n) + (across[n] * i + below[n] * j << SIDE_BITS) for n in range(3)
        ]
        inside = i.like(0)
        for y in range(SIDE):
            values = first
            for x in range(SIDE):
                bit = i.like(1 << (y * SIDE + x))
                inside = (inside | bit).where(_sign(values) >= 0, inside)
                values = [value + step for value, step in zip(values, across, strict=True)]
            first = [value + step for value, step in zip(first, below, strict=True)]
        inside.store(masks)
        block = (block_y - (top >> SIDE_BITS)) * columns + block_x
        (block << (2 * SIDE_BITS)).store(sample)
        corner_x, corner_y = (block_x << SIDE_BITS).to(DOUBLE), (block_y << SIDE_BITS).to(DOUBLE)
        start = get(exact, ORIGIN) + get(exact, SLOPE_Y) * corner_y + get(exact, SLOPE_X) * corner_x
        start.to(SINGLE).store(here)
        found = (block_x <= get(whole, LAST_X) >> SIDE_BITS) & (inside > 0)
        found = found & (block_y <= get(whole, LAST_Y) >> SIDE_BITS)
        at_border = (block_x >= full_x) | (block_y >= full_y)
        return builder.or_(found.bits(), builder.shl(at_border.bits(), LONG(LANES)))

    return types.int64(types.int32, window, edges, batch), generate


@intrinsic
def owned_lanes(typing, edges, batch):
    """Count the samples that sixteen triangles of at most 2 x 2 blocks own, into `batch.masks`."""

    def generate(context, builder, signature, args):
        edges, batch = args
        whole, masks = (builder.extract_value(batch, n) for n in (0, 5))

        def get(array, row):
            return load(builder, builder.gep(array, [LONG(row * LANES)]), LANES)

        first = [get(edges, E + n) for n in range(3)]
        across, below = ([get(edges, row + n) for n in range(3)] for row in (ACROSS, DOWN))
        first_x, first_y = (get(whole, row) >> SIDE_BITS << SIDE_BITS for row in (FIRST_X, FIRST_Y))
        columns, rows = get(whole, LAST_X) - first_x, get(whole, LAST_Y) - first_y
        owned = columns.like(0)
        for y in range(2 * SIDE):
            values = first
            for x in range(2 * SIDE):
                beyond = (columns - x) | (rows - y)  # less than 0 beyond the last column or row
                owned = (owned + 1).where((_sign(values) | beyond) >= 0, owned)
                values = [value + step for value, step in zip(values, across, strict=True)]
            first = [value + step for value, step in zip(first, below, strict=True)]
        owned.store(masks)
        return context.get_dummy_value()

    return types.void(edges, batch), generate


@intrinsic
def group_lanes(typing, edges, k, right, down):
    """Bits of the blocks of a group that triangle k reaches, and a few more near its corners.

    The group starts `right` and `down` blocks from the first one that the triangle reaches. Its
    values go to the rows `CORNER` and `INNER`.
    """

    def generate(context, builder, signature, args):
        edges, k, right, down = args
        kind = edges.type.pointee
        if kind == WORD:
            right, down = builder.trunc(right, WORD), builder.trunc(down, WORD)
        lane_x, lane_y = constants(builder, kind, LANE_X), constants(builder, kind, LANE_Y)
        x = (spread(builder, right, LANES) + lane_x) * SIDE
        y = (spread(builder, down, LANES) + lane_y) * SIDE
        highest = []
        for n in range(3):
            value, across, below = (
                spread(
                    builder, builder.load(builder.gep(edges, [builder.add(k, LONG(row * LANES))])), LANES
                )
                for row in (E + n, ACROSS + n, DOWN + n)
            )
            value = value + (across * x + below * y)
            value.store(builder.gep(edges, [LONG((CORNER + n) * LANES)]))
            inner = across * lane_x + below * lane_y
            inner.store(builder.gep(edges, [LONG((INNER + n) * LANES)]))
            highest.append(value + (across.greatest(0) + below.greatest(0)) * (SIDE - 1))
        return (_sign(highest) >= 0).bits()

    whole = types.int64
    return whole(edges, whole, whole, whole), generate


@intrinsic
def group_starts(typing, k, group_x, group_y, window, batch):
    """Where the blocks of a group stand in memory, and 1/z of triangle k at their first samples.

    To `batch.sample` and `batch.here`.
    """

    def generate(context, builder, signature, args):
        k, group_x, group_y, window, batch = args
        exact, sample, here = (builder.extract_value(batch, n) for n in (1, 3, 4))
        top, columns = (spread(builder, builder.extract_value(window, n), LANES) for n in (1, 4))
        x = spread(builder, builder.trunc(group_x, WORD), LANES) + constants(builder, WORD, LANE_X)
        y = spread(builder, builder.trunc(group_y, WORD), LANES) + constants(builder, WORD, LANE_Y)
        (((y - (top >> SIDE_BITS)) * columns + x) << (2 * SIDE_BITS)).store(sample)
        origin, slope_x, slope_y = (
            spread(
                builder, builder.load(builder.gep(exact, [builder.add(k, LONG(row * LANES))])), LANES
            )
            for row in (ORIGIN, SLOPE_X, SLOPE_Y)
        )
        x, y = (x << SIDE_BITS).to(DOUBLE), (y << SIDE_BITS).to(DOUBLE)
        (origin + slope_y * y + slope_x * x).to(SINGLE).store(here)
        return context.get_dummy_value()

    whole = types.int64
    return types.void(whole, whole, whole, window, batch), generate


@intrinsic
def inside_lanes(typing, edges, block):
    """Bits of the samples inside the triangle of `group_lanes`, in a block of its group."""

    def generate(context, builder, signature, args):
        edges, block = args
        values = []
        for n in range(3):
            corner = builder.gep(edges, [builder.add(block, LONG((CORNER + n) * LANES))])
            inner = load(builder, builder.gep(edges, [LONG((INNER + n) * LANES)]), LANES)
            values.append(spread(builder, builder.load(corner), LANES) + inner)
        return (_sign(values) >= 0).bits()

    return types.int64(edges, types.int64), generate


@intrinsic
def write_lanes(typing, image, at, bits, batch, k, start):
    """Write the depth of triangle k into the samples of a block where it is nearest, of `bits`.

    1/z at the block's first sample is `start`. Returns bits of the samples that were written; above
    them those of these that were not empty before; and above them those at the same depth.
    """

    def generate(context, builder, signature, args):
        image, at, bits, batch, k, start = args
        where = builder.gep(builder.extract_value(image, 0), [at])
        plane = builder.extract_value(batch, 2)
        step_x, step_y, least, greatest = (
            spread(
                builder, builder.load(builder.gep(plane, [builder.add(k, LONG(row * LANES))])), LANES
            )
            for row in (STEP_X, STEP_Y, LEAST, GREATEST)
        )
        away = step_x * constants(builder, SINGLE, LANE_X)
        away = away + step_y * constants(builder, SINGLE, LANE_Y)
        here = (spread(builder, start, LANES) + away).greatest(least).least(greatest)
        old = load(builder, where, LANES)
        active = from_bits(builder, bits, LANES)
        wins = (here > old) & active
        full = wins & (old > 0.0)
        ties = here.equals(old) & active
        here.where(wins, old).store(where)
        found = builder.or_(wins.bits(), builder.shl(full.bits(), LONG(LANES)))
        return builder.or_(found, builder.shl(ties.bits(), LONG(2 * LANES)))

    arguments = image, types.int64, types.int64, batch, types.int64, types.float32
    return types.int64(*arguments), generate


@intrinsic
def owned_by(typing, owner, at, face):
    """Bits of the samples of a block that a face holds."""

    def generate(context, builder, signature, args):
        owner, at, face = args
        held = load(builder, builder.gep(owner, [at]), LANES)
        return held.equals(spread(builder, face, LANES)).bits()

    return types.int64(owner, types.int64, types.int32), generate


@intrinsic
def own_lanes(typing, owner, at, bits, face):
    """Give samples of a block to a face."""

    def generate(context, builder, signature, args):
        owner, at, bits, face = args
        where = builder.gep(owner, [at])
        mask = from_bits(builder, bits, LANES)
        spread(builder, face, LANES).where(mask, load(builder, where, LANES)).store(where)
        return context.get_dummy_value()

    return types.void(owner, types.int64, types.int64, types.int32), generate


@intrinsic
def list_lanes(typing, octets, bits, base, listed, n):
    """Put base + index of each of sixteen bits behind the n numbers of a list, in order.

    Without a branch, which would be guessed wrong: by a table that has, for eight bits, the indices
    of those that are set. What comes after them in the list is overwritten.
    """

    def generate(context, builder, signature, args):
        octets, bits, base, listed, n = args
        half = LANES // 2
        for k in range(2):
            mask = builder.and_(builder.lshr(bits, LONG(k * half)), LONG(0xFF))
            indices = builder.gep(octets, [builder.mul(mask, LONG(half))])
            indices = load(builder, indices, half).widened(WORD)
            start = builder.trunc(builder.add(base, LONG(k * half)), WORD)
            (indices + spread(builder, start, half)).store(builder.gep(listed, [n]))
            n = builder.add(n, builder.ctpop(mask))
        return n

    whole = types.int64
    return whole(octets, whole, whole, listed, whole), generate


@intrinsic
def fetch_lines(typing, data, begin, end):
    """Ask for the cache lines from element `begin` up to `end`, before they are needed."""

    def generate(context, builder, signature, args):
        data, begin, end = args
        size = context.get_abi_sizeof(data.type.pointee)
        with cgutils.for_range_slice(builder, begin, end, LONG(CACHE_LINE // size), LONG) as (at, _):
            prefetch(builder, builder.gep(data, [at]))
        return context.get_dummy_value()

    return types.void(data, types.int64, types.int64), generate


@intrinsic
def fetch_counts(typing, data, faces, begin, end):
    """Ask for the counts of the faces in these slots, before they are needed."""

    def generate(context, builder, signature, args):
        data, faces, begin, end = args
        with cgutils.for_range_slice(builder, begin, end, LONG(1), LONG) as (at, _):
            face = builder.sext(builder.load(builder.gep(faces, [at])), LONG)
            prefetch(builder, builder.gep(data, [face]), is_written=True)
        return context.get_dummy_value()

    return types.void(data, faces, types.int64, types.int64), generate


@intrinsic
def count_bits(typing, bits):
    """How many bits are set."""

    def generate(context, builder, signature, args):
        return builder.ctpop(args[0])

    return types.int64(types.int64), generate


@intrinsic
def lowest_bit(typing, bits):
    """Index of the lowest bit that is set, of a number that is not 0."""

    def generate(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


# --- the passes -----------------------------------------------------------------------------------


@forced
def sift(shape, begin, end, placed, window, batch, counts, octets, lists):
    """List the faces of a cluster that can own a sample; returns the lengths of the lists.

    Parameters
    ----------
    begin, end : int
        Slots of the cluster's faces.
    counts : Counts
        Samples of hidden faces that reach at most 2 x 2 are added to `drawn` where it is asked for.
    octets : uint8
        See `list_lanes`.
    lists : Lists
        Out: slots of faces that reach at most 2 x 2 samples and own one, that reach more, that
        reach more and are hidden, that are large, and that want clipping.
    """
    tiny, small, hidden, large, clipped = lists
    n_tiny = n_small = n_hidden = n_large = n_clipped = 0
    for at in range(begin, end, LANES):
        shown, back = sift_lanes(shape.corners, at, placed, window, batch)
        n_tiny = list_lanes(octets, shown & ALL_LANES, at, tiny, n_tiny)
        n_small = list_lanes(octets, shown >> LANES & ALL_LANES, at, small, n_small)
        if shown >> 2 * LANES:
            n_large = list_lanes(octets, shown >> 2 * LANES & ALL_LANES, at, large, n_large)
            n_clipped = list_lanes(octets, shown >> 3 * LANES & ALL_LANES, at, clipped, n_clipped)
        if counts.with_drawn:
            if window.full_x > 0:
                tiny_back = back & ALL_LANES
                while tiny_back:
                    lane = lowest_bit(tiny_back)
                    counts.drawn[shape.faces[at + lane]] += batch.masks[lane]
                    tiny_back &= tiny_back - 1
                back >>= LANES
            else:
                back = (back | back >> LANES) & ALL_LANES
            n_hidden = list_lanes(octets, back, at, hidden, n_hidden)
    return n_tiny, n_small, n_hidden, n_large, n_clipped


@compiled
def border(block_x, block_y, window):
    """Bits of the samples of a block that are inside the image."""
    inside = 0
    for j in range(SIDE):
        row = (block_y << SIDE_BITS) + j
        if row < window.height:
            begin = min(max(np.int64(window.first[row]) - (block_x << SIDE_BITS), 0), SIDE)
            end = min(max(np.int64(window.last[row]) - (block_x << SIDE_BITS), 0), SIDE)
            inside |= (((1 << end) - 1) & ~((1 << begin) - 1)) << (SIDE * j)
    return inside


@forced
def fill_tiny(tiny, wide, tall, window, edges, batch, image, counts):
    """Fill those of sixteen triangles that reach at most 2 x 2 samples, and have their bits in tiny.

    Those with bits in `wide` reach two columns, those with bits in `tall` two rows. Returns how
    many samples were empty.
    """
    filled = 0
    for k in range(4):
        if (k & 1 and tiny & wide == 0) or (k >> 1 and tiny & tall == 0):
            continue
        owners = tiny_lanes(np.int32(k), window, edges, batch) & tiny
        while owners:
            lane = lowest_bit(owners)
            owners &= owners - 1
            face, sample = batch.whole[FACE * LANES + lane], batch.sample[lane]
            if window.full_x == 0:
                x = np.int64(batch.whole[FIRST_X * LANES + lane] + (k & 1))
                y = batch.whole[FIRST_Y * LANES + lane] + (k >> 1)
                if x < window.first[y] or x >= window.last[y]:
                    continue
            if counts.with_drawn:
                counts.drawn[face] += 1
            here, old = batch.here[lane], image.depth[sample]
            if here > old or (here == old and image.owner[sample] > face):
                if old > 0:
                    counts.visible[image.owner[sample]] -= 1
                else:
                    filled += 1
                counts.visible[face] += 1
                image.depth[sample] = here
                image.owner[sample] = face
    return filled


@forced
def resolve(at, bits, batch, k, start, face, image, visible):
    """Write what is nearer in a block; returns how many samples, and how many were empty."""
    found = write_lanes(image, at, bits, batch, k, start)
    won = found & ALL_LANES
    lost = found >> LANES & ALL_LANES
    ties = found >> 2 * LANES
    while ties:  # the lower face wins
        lane = lowest_bit(ties)
        if image.owner[at + lane] > face:
            won |= 1 << lane
            lost |= 1 << lane
        ties &= ties - 1
    if won == 0:
        return 0, 0
    n_won = count_bits(won)
    n_new = n_won - count_bits(lost)
    while lost:
        loser = image.owner[at + lowest_bit(lost)]
        its = owned_by(image.owner, at, loser) & lost
        visible[loser] -= count_bits(its)
        lost &= ~its
    own_lanes(image.owner, at, won, face)
    return n_won, n_new


@forced
def fill_few(few, wide, tall, window, edges, batch, image, counts):
    """Fill those of sixteen triangles that reach at most 2 x 2 blocks, and have their bits in few.

    Otherwise as `fill_tiny`.
    """
    filled = 0
    for k in range(4):
        if (k & 1 and few & wide == 0) or (k >> 1 and few & tall == 0):
            continue
        found = few_lanes(np.int32(k), window, edges, batch)
        at_border = found >> LANES
        found &= few
        while found:
            lane = lowest_bit(found)
            found &= found - 1
            face, bits = batch.whole[FACE * LANES + lane], np.int64(batch.masks[lane])
            if at_border >> lane & 1:
                block_x = np.int64(batch.whole[FIRST_X * LANES + lane] >> SIDE_BITS) + (k & 1)
                block_y = np.int64(batch.whole[FIRST_Y * LANES + lane] >> SIDE_BITS) + (k >> 1)
                bits &= border(block_x, block_y, window)
            if counts.with_drawn:
                counts.drawn[face] += count_bits(bits)
            n_won, n_new = resolve(
                np.int64(batch.sample[lane]), bits, batch, lane, batch.here[lane], face, image,
                counts.visible,
            )  # fmt: skip
            counts.visible[face] += n_won
            filled += n_new
    return filled


@forced
def blocks_of(k, batch):
    """Blocks that a triangle reaches: the first and last column, the first and last row."""
    return (
        np.int64(batch.whole[FIRST_X * LANES + k] >> SIDE_BITS),
        np.int64(batch.whole[LAST_X * LANES + k] >> SIDE_BITS),
        np.int64(batch.whole[FIRST_Y * LANES + k] >> SIDE_BITS),
        np.int64(batch.whole[LAST_Y * LANES + k] >> SIDE_BITS),
    )


@forced
def group_blocks(k, group_x, group_y, reached, edges):
    """Bits of the blocks of a group that triangle k may have samples in, see `group_lanes`."""
    first_x, last_x, first_y, last_y = reached
    blocks = group_lanes(edges, k, group_x - first_x, group_y - first_y)
    n_columns, n_rows = min(last_x - group_x + 1, SIDE), min(last_y - group_y + 1, SIDE)
    return blocks & ((1 << n_columns) - 1) * 0x1111 & ((1 << (SIDE * n_rows)) - 1)


@forced
def in_image(bits, block_x, block_y, window):
    """Of the samples of a block those inside the image."""
    if block_x < window.inner[2 * block_y] or block_x >= window.inner[2 * block_y + 1]:
        return bits & border(block_x, block_y, window)
    return bits


@compiled
def fill_blocks(chosen, window, edges, batch, image, counts):
    """Fill those of sixteen triangles whose bits are set, of any size.

    Returns how many samples were empty.
    """
    filled = 0
    while chosen:
        k = lowest_bit(chosen)
        chosen &= chosen - 1
        reached = blocks_of(k, batch)
        first_x, last_x, first_y, last_y = reached
        face = batch.whole[FACE * LANES + k]
        is_cut = last_x >= window.full_x or last_y >= window.full_y
        gained, owned = 0, 0
        for group_y in range(first_y, last_y + 1, SIDE):
            for group_x in range(first_x, last_x + 1, SIDE):
                blocks = group_blocks(k, group_x, group_y, reached, edges)
                group_starts(k, group_x, group_y, window, batch)
                while blocks:
                    lane = lowest_bit(blocks)
                    blocks &= blocks - 1
                    bits = inside_lanes(edges, lane)
                    if is_cut:
                        block_x, block_y = group_x + (lane & (SIDE - 1)), group_y + (lane >> SIDE_BITS)
                        bits = in_image(bits, block_x, block_y, window)
                    if bits == 0:
                        continue
                    owned += count_bits(bits)
                    n_won, n_new = resolve(
                        np.int64(batch.sample[lane]), bits, batch, k, batch.here[lane], face, image,
                        counts.visible,
                    )  # fmt: skip
                    gained += n_won
                    filled += n_new
        if gained:
            counts.visible[face] += gained
        if counts.with_drawn:
            counts.drawn[face] += owned
    return filled


@compiled
def covered(k, window, edges, batch):
    """Samples that triangle k owns, of any size."""
    reached = blocks_of(k, batch)
    first_x, last_x, first_y, last_y = reached
    is_cut = last_x >= window.full_x or last_y >= window.full_y
    owned = 0
    for group_y in range(first_y, last_y + 1, SIDE):
        for group_x in range(first_x, last_x + 1, SIDE):
            blocks = group_blocks(k, group_x, group_y, reached, edges)
            while blocks:
                lane = lowest_bit(blocks)
                blocks &= blocks - 1
                bits = inside_lanes(edges, lane)
                if is_cut:
                    block_x, block_y = group_x + (lane & (SIDE - 1)), group_y + (lane >> SIDE_BITS)
                    bits = in_image(bits, block_x, block_y, window)
                owned += count_bits(bits)
    return owned


@forced
def fill(lists, n_tiny, n_small, shape, placed, window, edges, batch, image, counts):
    """Fill the small triangles that `sift` listed; returns how many samples were empty."""
    listed = lists.tiny  # and the others behind them, so that few lanes stay empty
    for i in range(n_small):
        listed[n_tiny + i] = lists.small[i]
    n = n_tiny + n_small
    filled = 0
    for i in range(0, n, LANES):
        sizes, _ = set_up_lanes(listed, i, shape, placed, window, edges, batch, counts.visible)
        wide, tall = sizes >> LANES, sizes >> 2 * LANES
        tiny = ALL_LANES >> min(max(LANES - (n_tiny - i), 0), LANES)
        others = (ALL_LANES >> max(LANES - (n - i), 0)) & ~tiny
        if tiny:
            filled += fill_tiny(tiny, wide, tall, window, edges, batch, image, counts)
        few = sizes & others
        if count_bits(few) < FEW:
            few = 0
        else:
            filled += fill_few(few, wide, tall, window, edges, batch, image, counts)
        many = others & ~few
        if many:
            filled += fill_blocks(many, window, edges, batch, image, counts)
    return filled


@compiled
def count_hidden(listed, n, shape, placed, window, edges, batch, counts):
    """Add the samples of the triangles of a list to `drawn`, without a look at their depths."""
    for i in range(0, n, LANES):
        few, _ = set_up_edges(listed, i, shape, placed, window, edges, batch, counts.visible)
        few &= ALL_LANES >> max(LANES - (n - i), 0)
        if window.full_x == 0 or count_bits(few) < FEW:
            few = 0
        if few:
            owned_lanes(edges, batch)
        for k in range(min(n - i, LANES)):
            if few >> k & 1:
                counts.drawn[batch.whole[FACE * LANES + k]] += batch.masks[k]
        for k in range(min(n - i, LANES)):  # after those, whose counts this overwrites
            if not few >> k & 1:
                counts.drawn[batch.whole[FACE * LANES + k]] += covered(k, window, edges, batch)


@compiled
def frustum(view, width, top, bottom, planes):
    """Planes around what can own a sample of the rows from `top` to `bottom`: (5, 4) float64.

    A normal and its length. A point p from the eye is outside where normal . p < 0; by the last
    plane, where it is < near.
    """
    for i in range(3):
        right, down, forward = view[3 * i], view[3 * i + 1], view[3 * i + 2]
        planes[0, i] = view[LENS] * right + view[LENS + 2] * forward
        planes[1, i] = (width - view[LENS + 2]) * forward - view[LENS] * right
        planes[2, i] = view[LENS + 1] * down + (view[LENS + 3] - top) * forward
        planes[3, i] = (bottom - view[LENS + 3]) * forward - view[LENS + 1] * down
        planes[4, i] = forward
    for k in range(5):
        planes[k, 3] = np.sqrt(planes[k, 0] ** 2 + planes[k, 1] ** 2 + planes[k, 2] ** 2)


@forced
def clear(low_x, high_x, low_y, high_y, window, is_clear, marks, depth):
    """Clear the blocks that a box reaches, unless they are; returns whether there are any."""
    first_x = max((np.int64(low_x) + HALF - 1) >> BITS, 0)
    last_x = min((np.int64(high_x) - HALF) >> BITS, np.int64(window.right))
    first_y = max((np.int64(low_y) + HALF - 1) >> BITS, np.int64(window.top))
    last_y = min((np.int64(high_y) - HALF) >> BITS, np.int64(window.bottom))
    if first_x > last_x or first_y > last_y:
        return False
    if is_clear:
        return True
    shift = SIDE_BITS + PATCH_BITS
    for row in range((first_y - window.top) >> SIDE_BITS, ((last_y - window.top) >> SIDE_BITS) + 1):
        for patch in range(first_x >> shift, (last_x >> shift) + 1):
            block = row * window.columns + (patch << PATCH_BITS)
            if marks[block >> PATCH_BITS] == 0:
                marks[block >> PATCH_BITS] = 1
                for sample in range(block << (2 * SIDE_BITS), (block << (2 * SIDE_BITS)) + (LANES << PATCH_BITS)):
                    depth[sample] = 0.0
    return True


@compiled
def clip(corners, n, plane, offset, out):
    """Keep the part of a convex polygon where plane . p >= offset; returns its corner count.

    A cut is always reckoned from the corner inside to the corner outside, so the two faces that
    share an edge cut it at the same point, bit for bit.
    """
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = (
            plane[0] * corners[i, 0] + plane[1] * corners[i, 1] + plane[2] * corners[i, 2] - offset
        )
        there = (
            plane[0] * corners[j, 0] + plane[1] * corners[j, 1] + plane[2] * corners[j, 2] - offset
        )
        if here >= 0:
            if kept == CLIP_CORNERS:
                return kept
            out[kept] = corners[i]
            kept += 1
        if (here >= 0) != (there >= 0):
            if kept == CLIP_CORNERS:
                return kept
            p, q = (i, j) if here >= 0 else (j, i)
            inside, beyond = (here, there) if here >= 0 else (there, here)
            t = inside / (inside - beyond)
            for k in range(3):
                out[kept, k] = corners[p, k] + t * (corners[q, k] - corners[p, k])
            kept += 1
    return kept


@compiled
def clip_face(points, begin, stride, packed, view, window, placed, polygon, other):
    """Clip a face to what is in front of the near plane and not far out; returns its corners.

    They are placed from `VERTICES` on.
    """
    for i in range(3):
        vertex = 3 * begin + (packed >> (8 * i) & (ROOM - 1))
        away = (
            points[vertex] - view[EYE],
            points[vertex + stride] - view[EYE + 1],
            points[vertex + 2 * stride] - view[EYE + 2],
        )
        for k in range(3):
            polygon[i, k] = away[0] * view[k] + away[1] * view[3 + k] + away[2] * view[6 + k]
    if max(polygon[0, 2], max(polygon[1, 2], polygon[2, 2])) < view[NEAR]:
        return 0  # all behind, as most of these are for a camera in a room
    plane = other[CLIP_CORNERS]
    plane[0], plane[1], plane[2] = 0.0, 0.0, 1.0
    n = clip(polygon, 3, plane, view[NEAR], other)
    # The border of what is drawn, beyond which nothing owns a sample; and that of what is far out.
    reach = 0.99 * FAR_OUT / STEPS
    lows, highs = (0.0, float(window.top)), (window.right + 1.0, window.bottom + 1.0)
    is_far = False
    for axis in range(2):
        n_below, n_above = 0, 0
        for i in range(n):
            z = other[i, 2]
            at = view[LENS + axis] * other[i, axis] + view[LENS + 2 + axis] * z
            n_below += at < lows[axis] * z
            n_above += at > highs[axis] * z
            is_far |= abs(at) > reach * z
        if n_below == n or n_above == n:
            return 0
    for side in range(4 if is_far else 0):
        # |u| <= reach, |v| <= reach: +-(f x + c z) <= reach z
        sign, axis = 1.0 - 2.0 * (side & 1), side >> 1
        plane[0], plane[1] = 0.0, 0.0
        plane[axis] = sign * view[LENS + axis]
        plane[2] = sign * view[LENS + 2 + axis] + reach
        for i in range(n):
            polygon[i] = other[i]
        n = clip(polygon, n, plane, 0.0, other)
    for i in range(n):
        to = VERTICES + i
        w = 1.0 / other[i, 2]
        placed.w[to] = w
        placed.u[to] = (view[LENS] * other[i, 0] * w + view[LENS + 2]) * STEPS
        placed.v[to] = (view[LENS + 1] * other[i, 1] * w + view[LENS + 3]) * STEPS
        x, y = np.int64(np.floor(placed.u[to] + 0.5)), np.int64(np.floor(placed.v[to] + 0.5))
        placed.x[to], placed.y[to] = x, y
        placed.both[to] = y << 32 | (x & 0xFFFFFFFF)
    return n


@compiled
def fan_out(shape, slot, begin, stride, view, window, placed, fan, polygon, other):
    """Clip a face and put the triangles that are left into a shape of their own: how many."""
    packed = shape.corners[slot]
    n = clip_face(shape.points, begin, stride, packed, view, window, placed, polygon, other) - 2
    for k in range(n):
        fan.corners[k] = VERTICES | (VERTICES + k + 1) << 8 | (VERTICES + k + 2) << 16
        fan.faces[k] = shape.faces[slot]
    return max(n, 0)


@compiled
def fill_large(listed, n, shape, placed, window, edges, batch, image, counts):
    """Fill triangles of any size; returns how many samples were empty."""
    filled = 0
    for i in range(0, n, LANES):
        _, sides = set_up_lanes(listed, i, shape, placed, window, edges, batch, counts.visible)
        valid = ALL_LANES >> max(LANES - (n - i), 0)
        filled += fill_blocks(sides & valid, window, edges, batch, image, counts)
        hidden = sides >> LANES & valid
        while hidden and counts.with_drawn:
            k = lowest_bit(hidden)
            counts.drawn[batch.whole[FACE * LANES + k]] += covered(k, window, edges, batch)
            hidden &= hidden - 1
    return filled


def make_scratch():
    """Memory for `count_poses` in one thread, as it takes it apart."""
    return (
        np.zeros((14, ROOM), np.int32),
        np.zeros((2, ROOM), np.int64),
        np.zeros((5, ROOM)),
        np.zeros((2, ROOM), np.float32),
        np.array(
            [sorted(range(8), key=lambda k: not bits >> k & 1) for bits in range(256)], np.uint8
        ).ravel(),
        *np.zeros((2, CLIP_CORNERS + 1, 3)),
        np.zeros((5, 4)),
    )


@compiled
def count_poses(
    poses, nears, culls, focal, lens, size, bands, clusters, inner, first, last, is_rolled, marks,
    depth, owner, visible, drawn, filled, with_drawn, seen, scratch,
):  # fmt: skip
    """Count the samples of poses.

    Parameters
    ----------
    poses : (P, 4, 4) float64
        world_from_camera, from the same origin as the vertices. The first two axes need not be at
        right angles to each other: `rastercov.raster.grid` mixes them to roll the samples.
    nears : (P,) float64
        Near plane of each pose.
    culls : (P,) bool
        Whether the faces that turn their back can be left out.
    focal : (2,) float64
        The least and the most that a length parallel to the image, over its depth, is magnified to,
        in samples.
    lens : (4,) float64
        fx, fy, cx, cy in samples.
    size : (2,) int64
        Width and height in samples.
    bands : (B, 2) int64
        First row of each band of the image, and the row after its last. They are multiples of
        `SIDE`, but for the end of the image.
    clusters : tuple of arrays
        points, corners, faces, vertex_starts, face_starts, bounds of `Clusters`.
    inner : (rows of blocks, 2) int64
        The first block of each row that is wholly inside the image, and the one after the last.
    first, last : (height,) int32
        Samples of each row that count: from the first up to the last.
    is_rolled : bool
        Whether other samples than those beyond the width and the height do not count.
    marks : (M,) uint8
        Scratch: whether the blocks of a patch are cleared.
    depth, owner : (M * samples of a patch,) float32, int32
        Scratch; afterwards the last band of the last pose, in blocks: 1/z where it is marked, 0
        where nothing is, and the face.
    visible, drawn : (P, F) int64
        Out: samples; `drawn` only with `with_drawn`, else one row that is left alone.
    filled : (P,) int64
        Out: samples with a face in them.
    seen : (K + LANES,) int32
        Scratch: the clusters that are looked at.
    scratch : tuple of arrays
        From `make_scratch`.
    """
    points, corners, faces, vertex_starts, face_starts, bounds = clusters
    shape = Shape(pointer(points), pointer(corners), pointer(faces))
    words, longs, doubles, singles, lane_octets, polygon, clipped, sides = scratch
    octets = pointer(lane_octets)
    placed = Placed(
        pointer(doubles[0]), pointer(doubles[1]), pointer(doubles[2]), pointer(words[0]),
        pointer(words[1]), pointer(longs[0]),
    )  # fmt: skip
    lists = Lists(
        pointer(words[2]), pointer(words[3]), pointer(words[4]), pointer(words[11]),
        pointer(words[12]),
    )  # fmt: skip
    fan = Shape(shape.points, pointer(words[5]), pointer(words[6]))
    one_by_one = pointer(words[7])
    for k in range(LANES):
        one_by_one[k] = k
    edges, long_edges = pointer(words[8]), pointer(longs[1])
    batch = Batch(
        pointer(words[9]), pointer(doubles[3]), pointer(singles[0]), pointer(words[10]),
        pointer(singles[1]), pointer(words[13]),
    )  # fmt: skip
    figures = doubles[4]
    view = pointer(figures)
    n_clusters = len(vertex_starts) - 1
    image = Image(pointer(depth), pointer(owner))
    columns = np.int32((size[0] + (SIDE << PATCH_BITS) - 1) >> (SIDE_BITS + PATCH_BITS) << PATCH_BITS)
    full_x = 0 if is_rolled else size[0] >> SIDE_BITS
    full_y = 0 if is_rolled else size[1] >> SIDE_BITS
    for p in range(len(poses)):
        figures[:EYE] = poses[p, :3, :3].ravel()
        figures[EYE:LENS] = poses[p, :3, 3]
        figures[LENS:NEAR] = lens
        figures[NEAR], figures[WIDEST] = nears[p], focal[1]
        counts = Counts(
            pointer(visible[p]), pointer(drawn[p if with_drawn else 0]), with_drawn
        )
        visible[p] = 0
        if with_drawn:
            drawn[p] = 0
        new = 0
        for band in range(len(bands)):
            top, bottom = bands[band]
            window = Window(
                np.int32(size[0] - 1), np.int32(top), np.int32(bottom - 1), np.int32(culls[p]),
                columns, size[1], np.int32(full_x), np.int32(full_y), pointer(inner), pointer(first), pointer(last),
            )  # fmt: skip
            frustum(view, size[0], top, bottom, sides)
            leaves_out_backs = ALL_LANES if culls[p] and not with_drawn else 0
            n_seen = 0
            for at in range(0, n_clusters, LANES):
                found = cull_lanes(
                    pointer(bounds), bounds.shape[1], at, view, pointer(sides), focal[0],
                    leaves_out_backs,
                )  # fmt: skip
                found &= ALL_LANES >> max(LANES - (n_clusters - at), 0)
                n_seen = list_lanes(octets, found, at, pointer(seen), n_seen)
            is_clear = len(depth) < SAMPLES_A_CLUSTER * n_seen
            marks[:] = is_clear
            if is_clear:
                depth[:] = 0.0
            for i in range(n_seen):
                cluster = seen[i]
                if i + 1 < n_seen:
                    begin, end = vertex_starts[seen[i + 1]], vertex_starts[seen[i + 1] + 1]
                    fetch_lines(shape.points, 3 * np.int64(begin), 3 * np.int64(end))
                    begin, end = face_starts[seen[i + 1]], face_starts[seen[i + 1] + 1]
                    fetch_lines(shape.corners, np.int64(begin), np.int64(end))
                    fetch_lines(shape.faces, np.int64(begin), np.int64(end))
                begin, end = np.int64(vertex_starts[cluster]), np.int64(vertex_starts[cluster + 1])
                if with_drawn:
                    fetch_counts(
                        counts.drawn, shape.faces, np.int64(face_starts[cluster]),
                        np.int64(face_starts[cluster + 1]),
                    )  # fmt: skip
                box = project(shape.points, begin, end, view, placed)
                if box[1] == CLIPPED:
                    box = (0, np.int32(size[0] << BITS), np.int32(top << BITS), np.int32(bottom << BITS))
                if not clear(
                    box[0], box[1], box[2], box[3], window, is_clear, pointer(marks), image.depth
                ):
                    continue
                n_tiny, n_small, n_hidden, n_large, n_clipped = sift(
                    shape, face_starts[cluster], face_starts[cluster + 1], placed, window, batch,
                    counts, octets, lists,
                )  # fmt: skip
                new += fill(
                    lists, n_tiny, n_small, shape, placed, window, edges, batch, image, counts
                )
                if n_hidden:
                    count_hidden(
                        lists.hidden, n_hidden, shape, placed, window, edges, batch, counts
                    )
                if n_large:
                    new += fill_large(
                        lists.large, n_large, shape, placed, window, long_edges, batch, image, counts
                    )
                for k in range(n_clipped):
                    n = fan_out(
                        shape, lists.clipped[k], begin, end - begin, view, window, placed, fan,
                        polygon, clipped,
                    )  # fmt: skip
                    new += fill_large(
                        one_by_one, n, fan, placed, window, long_edges, batch, image, counts
                    )
        filled[p] = new


@compiled
def read_band(top, bottom, columns, marks, depth, owner, image_face, image_depth):
    """Put what `count_poses` left in its memory into the rows of an image."""
    for row in range(top, bottom):
        for column in range(image_face.shape[1]):
            block = ((row - top) >> SIDE_BITS) * columns + (column >> SIDE_BITS)
            if marks[block >> PATCH_BITS]:
                sample = (block << SIDE_BITS) + (row & (SIDE - 1))
                sample = (sample << SIDE_BITS) + (column & (SIDE - 1))
                if depth[sample] > 0:
                    image_face[row, column] = owner[sample]
                    image_depth[row, column] = np.float32(1.0 / depth[sample])
