"""What the CPU rasteriser does to sixteen vertices, faces, clusters or samples at once.

Formulas over `Lanes`, of which numba makes vector code; `kernels` has the loops around them. They
take pointers, since what takes an array in numba counts a reference to it each time.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988, for edge functions.
M. Abrash. Rasterization on Larrabee. 2009, for blocks within groups, sixteen at once.
"""

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from rastercov.raster.cpu.memory import (
    ACROSS,
    ALL_LANES,
    BEHIND,
    BITS,
    CACHE_LINE,
    CLIPPED,
    CORNER,
    DOWN,
    EYE,
    FACE,
    FACES,
    FAR_OUT,
    FIRST_X,
    FIRST_Y,
    GREATEST,
    HALF,
    INNER,
    LANE_X,
    LANE_Y,
    LANES,
    LARGE,
    LAST_X,
    LAST_Y,
    LEAST,
    LENS,
    LINE_BITS,
    NEAR,
    ORIGIN,
    OWNED,
    ROOM,
    SIDE,
    SIDE_BITS,
    SLOPE_X,
    SLOPE_Y,
    STEP_X,
    STEP_Y,
    STEPS,
    VERTICES,
    VIEW,
    WIDEST,
    E,
)  # fmt: skip
from rastercov.raster.cpu.simd import (
    DOUBLE,
    LONG,
    SINGLE,
    WORD,
    Lanes,
    constants,
    from_bits,
    load,
    looked_up,
    prefetch,
    spread,
)  # fmt: skip


@intrinsic
def pointer(typing, array):
    """Where the data of an array stands. What takes an array counts a reference, and at its end."""

    def generate(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


@intrinsic
def align_stack(typing):
    """Let the stack of the calling loop start with a cache line.

    LLVM keeps registers there that it has no room for. Without this it aligns them to 16 bytes, and
    most vectors of 64 then lie in two lines, which costs up to a twentieth.
    """

    def generate(context, builder, signature, args):
        line = cgutils.alloca_once(builder, ir.VectorType(WORD, LANES))
        line.align = CACHE_LINE
        address = builder.bitcast(line, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [address.type])
        builder.asm(kind, "", "r,~{memory}", [address], side_effect=True)  # keeps it there
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def project(typing, points, begin, end, view, is_safe, placed):
    """Bring the vertices of a cluster to the image; returns the box that they fill, in steps.

    Least and greatest x, least and greatest y.

    Parameters
    ----------
    points : float64
        x of the cluster's vertices from 3 `begin` on, then their y, then their z, from the same
        origin as the eye.
    begin, end : int
        First vertex of the cluster, and of the next one.
    view : (18,) float64
        See `VIEW`.
    is_safe : int
        Not 0 where no vertex can need clipping, see `cull_lanes`.
    placed : Placed
        Out. `u`, `v`: steps of 1/256 sample, not rounded. `w`: 1/z. `x`, `y`: where the vertex
        stands when samples are given out, `CLIPPED` or `BEHIND` where it needs clipping. What
        comes after the cluster's vertices means nothing.
    """

    def generate(context, builder, signature, args):
        points, begin, end, view, is_safe, placed = args
        figures = [
            spread(builder, builder.load(builder.gep(view, [LONG(k)])), LANES) for k in range(VIEW)
        ]
        for k in range(LENS, NEAR):
            figures[k] = figures[k] * float(STEPS)
        wants_tests = builder.icmp_signed("==", is_safe, LONG(0))
        n = builder.sub(end, begin)
        lanes = constants(builder, LONG, range(LANES))
        words = lanes.to(WORD)
        box = []
        for start in (CLIPPED, -CLIPPED) * 2:
            box.append(cgutils.alloca_once_value(builder, words.like(start).value))
        with cgutils.for_range_slice(builder, LONG(0), n, LONG(LANES), LONG) as (to, _):
            at = [
                builder.add(
                    builder.add(builder.mul(begin, LONG(3)), builder.mul(n, LONG(axis))), to
                )
                for axis in range(3)
            ]
            steps = _project_lanes(builder, points, at, figures, wants_tests, placed, to)
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
    whole = types.int64
    return box(points, whole, whole, view, whole, placed), generate


def _project_lanes(builder, points, at, figures, wants_tests, placed, to):
    """Place sixteen vertices; returns their whole steps."""
    u, v, w, x, y = (builder.gep(builder.extract_value(placed, k), [to]) for k in range(5))
    away = [
        load(builder, builder.gep(points, [at[axis]]), LANES) - figures[EYE + axis]
        for axis in range(3)
    ]
    right, down, z = (
        away[0] * figures[k] + away[1] * figures[3 + k] + away[2] * figures[6 + k] for k in range(3)
    )
    inverse = z.like(1.0) / z
    exact = (
        figures[LENS] * right * inverse + figures[LENS + 2],
        figures[LENS + 1] * down * inverse + figures[LENS + 3],
    )
    rounded = [(position + 0.5).floor() for position in exact]
    inverse.store(w)
    found = []
    for position, place, u_or_v in zip(exact, rounded, (u, v), strict=True):
        position.store(u_or_v)
        found.append(cgutils.alloca_once_value(builder, place.to(WORD).value))
    with builder.if_then(wants_tests, likely=False):
        is_seen = is_beyond_near = z >= figures[NEAR]
        for position in exact:
            is_seen = is_seen & (position.magnitude() <= float(FAR_OUT))
        unseen = spread(builder, WORD(CLIPPED), LANES).where(is_beyond_near, BEHIND)
        for place, at in zip(rounded, found, strict=True):
            builder.store(place.where(is_seen, 0.0).to(WORD).where(is_seen, unseen).value, at)
    steps = [Lanes(builder, builder.load(at)) for at in found]
    for place, x_or_y in zip(steps, (x, y), strict=True):
        place.store(x_or_y)
    return steps


@intrinsic
def cull_lanes(typing, bounds, stride, at, view, sides, focal, leaves_out_backs, middles):
    """Bits of sixteen clusters, from `at` on, of which something may have to be drawn.

    And above them those of clusters that are safe: wholly beyond the near plane and not far out.
    Where their middles are, down and forward from the eye, goes to two rows of `middles`.

    A cluster lies outside where its sphere is beyond one of the planes of `frustum`. All of its
    faces turn their back, and still do once rounded to steps, where their planes are far enough
    from the eye: with D the distance of the cluster's farthest point and h that of the eye behind
    the plane of a face, the altitudes of the face are in the image at least focal h / D^2 of what
    they are in space. Rounding moves a corner by at most 0.71 steps, so it turns no face whose
    altitudes are 3 steps or more. Faces that are clipped are cut and rounded again, so they stay.
    """

    def generate(context, builder, signature, args):
        bounds, stride, at, view, sides, focal, leaves_out_backs, middles = args

        def row(k):
            place = builder.add(builder.mul(stride, LONG(k)), at)
            return load(builder, builder.gep(bounds, [place]), LANES)

        def figure(pointer, k):
            return spread(builder, builder.load(builder.gep(pointer, [LONG(k)])), LANES)

        away = [row(k) - figure(view, EYE + k) for k in range(3)]
        radius, near = row(3), figure(view, NEAR)
        is_outside = radius < 0
        for k in range(5):
            normal = [figure(sides, 4 * k + axis) for axis in range(3)]
            distance = normal[0] * away[0] + normal[1] * away[1] + normal[2] * away[2]
            limit = near if k == 4 else radius.like(0)
            beyond = distance + radius * figure(sides, 4 * k + 3) < limit
            is_outside = is_outside | beyond
        nearest = distance - radius  # along the axis of the camera
        down = away[0] * figure(view, 1) + away[1] * figure(view, 4) + away[2] * figure(view, 7)
        down.store(builder.gep(middles, [at]))
        distance.store(builder.gep(middles, [builder.add(stride, at)]))
        squared = away[0] * away[0] + away[1] * away[1] + away[2] * away[2]
        along = away[0] * row(4) + away[1] * row(5) + away[2] * row(6)
        across = (squared - along * along).greatest(0).root()
        away_from = squared.root()
        # The greatest n . d over the normals n of the cone, d to the eye: |d| where d is in it.
        is_in_cone = along.like(0) - along >= away_from * row(7)
        highest = away_from.where(is_in_cone, across * row(8) - along * row(7))
        height = highest - row(9)
        reach = away_from + radius
        magnified = spread(builder, focal, LANES) * float(STEPS)
        is_back = height * row(10) * magnified < reach * reach * -3.1
        is_safe = nearest >= near
        is_safe = is_safe & (reach * figure(view, WIDEST) <= nearest * float(FAR_OUT >> BITS >> 1))
        wanted = from_bits(builder, leaves_out_backs, LANES)
        kept = (~(is_outside | (is_back & is_safe & wanted))).bits()
        return builder.or_(kept, builder.shl(is_safe.bits(), LONG(LANES)))

    whole, real = types.int64, types.float64
    return whole(bounds, whole, whole, view, sides, real, whole, middles), generate


@intrinsic
def band_lanes(typing, bounds, stride, at, middles, focal, up, up_length, down, down_length):
    """Bits of sixteen clusters, from `at` on, that may reach into a band of the image.

    Parameters
    ----------
    middles : float64
        From `cull_lanes`.
    focal : float
        fy.
    up, down : float
        Samples of the band above the principal point, and below it.
    up_length, down_length : float
        Lengths of the normals of the planes at its rims, see `frustum`.
    """

    def generate(context, builder, signature, args):
        bounds, stride, at, middles, *figures = args
        focal, up, up_length, down, down_length = (spread(builder, k, LANES) for k in figures)
        radius = builder.gep(bounds, [builder.add(builder.mul(stride, LONG(3)), at)])
        radius = load(builder, radius, LANES)
        below = load(builder, builder.gep(middles, [at]), LANES) * focal
        forward = load(builder, builder.gep(middles, [builder.add(stride, at)]), LANES)
        is_below_rim = below + up * forward + radius * up_length >= 0.0
        is_above_rim = down * forward - below + radius * down_length >= 0.0
        return (is_below_rim & is_above_rim).bits()

    whole, real = types.int64, types.float64
    return whole(bounds, whole, whole, middles, *[real] * 5), generate


def _corners(context, packed, placed, kind):
    """Exact and whole places of the three corners of sixteen faces: u, v, 1/z, and x, y.

    In words these are vertices of the cluster. Triangles in more digits may have been clipped, and
    have corners beyond those.
    """
    builder = packed.builder
    n = VERTICES if kind == WORD else ROOM
    exact, whole = [], []
    for k in range(3):
        index = packed >> 8 * k & (ROOM - 1)
        u, v, w, x, y = (
            looked_up(context, builder.extract_value(placed, at), n, index) for at in range(5)
        )
        exact.append((u, v, w))
        whole.append((x.to(kind), y.to(kind)))
    return exact, whole


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
    x, y = (at_x << BITS) + HALF, (at_y << BITS) + HALF
    bits = area.kind.width
    rest = (area.like(0) - area).where(turned, area)  # what the three of them add up to
    found = []
    for from_x, from_y, to_x, to_y in ((ax, ay, px, py), (px, py, qx, qy), (qx, qy, ax, ay)):
        dx, dy = to_x - from_x, to_y - from_y
        value = rest if len(found) == 2 else dx * (y - from_y) - dy * (x - from_x)
        rest = rest - value
        # -1 on a left or an upper edge, where y falls, or stays while x grows; else 0.
        is_left_or_upper = ((dy << bits // 2) - dx) >> bits - 1
        found.append(((value - 1 - is_left_or_upper) >> BITS, dy.like(0) - dy, dx))
    return found


def _sign(values):
    """Less than 0 where one of three is."""
    return values[0] | values[1] | values[2]


@intrinsic
def sift_lanes(typing, corners, begin, at, placed, window, is_plain, owned):
    """Which of sixteen faces can own a sample: 4 x 16 bits, and 2 x 16 bits of hidden ones.

    The lowest reach at most 2 x 2 samples and own one, the next ones reach more, the next ones are
    large, and the last want clipping; these two were not looked at further. Hidden are those that
    turn their back where that hides them. Which samples the lowest own goes to `owned`, as bits. A
    cluster is plain where none of its faces can be large or want clipping.
    """

    def generate(context, builder, signature, args):
        corners, begin, at, placed, window, is_plain, owned_by_face = args
        packed = load(builder, builder.gep(corners, [builder.add(begin, at)]), LANES)
        _, places = _corners(context, packed, placed, WORD)
        right, top, bottom = (
            spread(builder, builder.extract_value(window, k), LANES) for k in (0, 1, 2)
        )
        first_x, last_x, first_y, last_y, width, height = _reach(places, right, top, bottom)
        (ax, ay), (bx, by), (cx, cy) = places
        wide, tall = last_x - first_x, last_y - first_y
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        edges = _edges(places, area, first_x, first_y)
        missed = wide.like(0)
        for k in reversed(range(4)):
            i, j = k & 1, k >> 1
            values = [value + across * i + down * j for value, across, down in edges]
            missed = missed.with_sign_of(_sign(values) | (wide - i) | (tall - j))
        owned = missed.like(0xF) - missed
        owned.store(builder.gep(owned_by_face, [at]))
        is_tiny, can_own = wide.greatest(tall) <= 1, (wide | tall) >= 0
        tiny, small = (is_tiny & (owned > 0)).bits(), (can_own & ~is_tiny).bits()
        apart = [cgutils.alloca_once_value(builder, LONG(0)) for _ in range(2)]
        others = cgutils.alloca_once_value(builder, LONG(0))
        with builder.if_then(builder.icmp_signed("==", is_plain, LONG(0)), likely=False):
            low, high = ax.least(bx).least(cx), ax.greatest(bx).greatest(cx)
            wants_clipping = (high >= BEHIND) & (packed > 0)
            is_all_behind = low.equals(BEHIND) & high.equals(BEHIND)
            is_large = (width.greatest(height) >= LARGE) & can_own & ~wants_clipping
            groups = is_large, wants_clipping & ~is_all_behind
            for group, bits in zip(groups, apart, strict=True):
                builder.store(group.bits(), bits)
            builder.store((is_large | wants_clipping).bits(), others)
        rest = builder.not_(builder.load(others))
        front, back = (area < 0).bits(), (area > 0).bits()
        hides_back = builder.icmp_signed(">", builder.extract_value(window, 3), WORD(0))
        hidden = builder.select(hides_back, builder.and_(back, rest), LONG(0))
        shown = builder.select(hides_back, front, builder.or_(front, back))
        shown = builder.and_(shown, rest)
        found = []
        for side in shown, hidden:
            larger = builder.shl(builder.and_(small, side), LONG(LANES))
            found.append(builder.or_(builder.and_(tiny, side), larger))
        for k, bits in enumerate(apart):
            bits = builder.shl(builder.load(bits), LONG((2 + k) * LANES))
            found[0] = builder.or_(found[0], bits)
        return context.make_tuple(builder, signature.return_type, found)

    both = types.UniTuple(types.int64, 2)
    whole = types.int64
    return both(corners, whole, whole, placed, window, whole, owned), generate


def _planes(builder, exact_places, places, area, put, batch):
    """Put planes of 1/z into the rows of a batch."""
    exact, plane = (builder.extract_value(batch, k) for k in (1, 2))
    # 1/z is affine in the image: w = w_a + slope_x (u - u_a) + slope_y (v - v_a), from the
    # corners as they are; as rounded where the triangle is too thin for that.
    (au, av, aw), (bu, bv, bw), (cu, cv, cw) = exact_places
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
        typing, chosen, at, wants_edges, shape, begin, owned, placed, window, edges, batch
    ):
        """Edge functions and planes of sixteen triangles, in as many bits as `edges` has.

        Edge functions only where they are wanted. Returns bits of those that reach at most 2 x 2
        blocks, or without planes at most `LANES` columns and rows; above them those that reach two
        columns of blocks, and two rows. And bits of those that are shown and can own a sample, as
        far as their corners tell; above them those that are hidden.
        """

        def generate(context, builder, signature, args):
            chosen, at, wants_edges, shape, begin, owned, placed, window, edges, batch = args
            corners, faces = (builder.gep(builder.extract_value(shape, k), [begin]) for k in (1, 2))
            whole = builder.extract_value(batch, 0)
            kind = edges.type.pointee

            def put(array, row, value):
                value.to(array.type.pointee).store(builder.gep(array, [LONG(row * LANES)]))

            slot = load(builder, builder.gep(chosen, [at]), LANES)
            packed = looked_up(context, corners, FACES, slot)
            face = looked_up(context, faces, FACES, slot)
            exact_places, places = _corners(context, packed, placed, kind)
            right, top, bottom = (
                spread(builder, builder.extract_value(window, k), LANES).to(kind) for k in (0, 1, 2)
            )
            first_x, last_x, first_y, last_y, _, _ = _reach(places, right, top, bottom)
            (ax, ay), (bx, by), (cx, cy) = places
            area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
            with builder.if_then(builder.icmp_signed("!=", wants_edges, LONG(0))):
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
            put(whole, FACE, face)
            if with_planes:
                put(whole, OWNED, looked_up(context, owned, FACES, slot))
                _planes(builder, exact_places, places, area, put, batch)
            wide, tall = (
                (last >> SIDE_BITS) - (first >> SIDE_BITS)
                for first, last in ((first_x, last_x), (first_y, last_y))
            )
            is_few = (wide <= 1) & (tall <= 1)
            if not with_planes:
                is_few = (last_x - first_x < LANES) & (last_y - first_y < LANES)
            groups = is_few, wide > 0, tall > 0
            found = LONG(0)
            for k, group in enumerate(groups):
                found = builder.or_(found, builder.shl(group.bits(), LONG(k * LANES)))
            hides = spread(builder, builder.extract_value(window, 3), LANES) > 0
            can_own = (last_x >= first_x) & (last_y >= first_y)
            shown = can_own & ((area < 0) | ((area > 0) & ~hides))
            hidden = can_own & (area > 0) & hides
            sides = builder.or_(shown.bits(), builder.shl(hidden.bits(), LONG(LANES)))
            return context.make_tuple(builder, signature.return_type, (found, sides))

        long = types.int64
        arguments = chosen, long, long, shape, long, owned, placed, window, edges, batch
        return types.UniTuple(long, 2)(*arguments), generate

    return set_up_lanes


set_up_lanes, set_up_edges = _set_up(with_planes=True), _set_up(with_planes=False)


@intrinsic
def tiny_owners(typing, batch):
    """4 x 16 bits of those of sixteen triangles that own samples 0, 1, 2, 3 of at most 2 x 2."""

    def generate(context, builder, signature, args):
        whole = builder.extract_value(args[0], 0)
        owned = load(builder, builder.gep(whole, [LONG(OWNED * LANES)]), LANES)
        found = LONG(0)
        for k in range(4):
            owners = ((owned & (1 << k)) > 0).bits()
            found = builder.or_(found, builder.shl(owners, LONG(k * LANES)))
        return found

    return types.int64(batch), generate


def _of_four(builder, k):
    """Columns and rows of number k of 2 x 2 from the first one on, and where its row starts."""
    word = builder.trunc(k, WORD)
    i = spread(builder, builder.and_(word, WORD(1)), LANES)
    j = spread(builder, builder.lshr(word, WORD(1)), LANES)
    return i, j, builder.mul(k, LONG(LANES))


@intrinsic
def tiny_lanes(typing, k, window, batch):
    """Where sample k of 2 x 2 of sixteen triangles stands in memory, and its 1/z.

    To row k of `batch.sample` and of `batch.here`.
    """

    def generate(context, builder, signature, args):
        k, window, batch = args
        whole, exact, plane, sample, here = (builder.extract_value(batch, n) for n in range(5))
        top, columns = (spread(builder, builder.extract_value(window, n), LANES) for n in (1, 4))

        def get(array, row):
            return load(builder, builder.gep(array, [LONG(row * LANES)]), LANES)

        i, j, row = _of_four(builder, k)
        x, y = get(whole, FIRST_X) + i, get(whole, FIRST_Y) + j
        block_x, block_y = x >> SIDE_BITS, y >> SIDE_BITS
        in_x, in_y = x & (SIDE - 1), y & (SIDE - 1)
        block = (block_y - (top >> SIDE_BITS)) * columns + block_x
        ((((block << SIDE_BITS) + in_y) << SIDE_BITS) + in_x).store(builder.gep(sample, [row]))
        corner_x, corner_y = (block_x << SIDE_BITS).to(DOUBLE), (block_y << SIDE_BITS).to(DOUBLE)
        start = get(exact, ORIGIN) + get(exact, SLOPE_Y) * corner_y + get(exact, SLOPE_X) * corner_x
        away = get(plane, STEP_X) * in_x.to(SINGLE) + get(plane, STEP_Y) * in_y.to(SINGLE)
        nearness = (start.to(SINGLE) + away).greatest(get(plane, LEAST)).least(get(plane, GREATEST))
        nearness.store(builder.gep(here, [row]))
        return context.get_dummy_value()

    return types.void(types.int64, window, batch), generate


@intrinsic
def few_lanes(typing, k, window, edges, batch):
    """Bits of those of sixteen triangles that have samples in block k of 2 x 2; above, border ones.

    Which samples goes to row k of `batch.masks`, where in memory the block stands to that of
    `batch.sample`, and 1/z at its first sample to that of `batch.here`.
    """

    def generate(context, builder, signature, args):
        k, window, edges, batch = args
        whole, exact, _, sample, here, masks = (builder.extract_value(batch, n) for n in range(6))
        top, columns, full_x, full_y = (
            spread(builder, builder.extract_value(window, n), LANES) for n in (1, 4, 6, 7)
        )

        def get(array, row):
            return load(builder, builder.gep(array, [LONG(row * LANES)]), LANES)

        i, j, row = _of_four(builder, k)
        block_x = (get(whole, FIRST_X) >> SIDE_BITS) + i
        block_y = (get(whole, FIRST_Y) >> SIDE_BITS) + j
        across, below = ([get(edges, row + n) for n in range(3)] for row in (ACROSS, DOWN))
        first = [get(edges, E + n) + (across[n] * i + below[n] * j << SIDE_BITS) for n in range(3)]
        outside = i.like(0)
        last = [first[n] + (across[n] + below[n]) * (SIDE - 1) for n in range(3)]
        for _ in range(SIDE):
            values = last
            for _ in range(SIDE):
                outside = outside.with_sign_of(_sign(values))
                values = [value - step for value, step in zip(values, across, strict=True)]
            last = [value - step for value, step in zip(last, below, strict=True)]
        inside = outside.like(ALL_LANES) - outside
        inside.store(builder.gep(masks, [row]))
        block = (block_y - (top >> SIDE_BITS)) * columns + block_x
        (block << (2 * SIDE_BITS)).store(builder.gep(sample, [row]))
        corner_x, corner_y = (block_x << SIDE_BITS).to(DOUBLE), (block_y << SIDE_BITS).to(DOUBLE)
        start = get(exact, ORIGIN) + get(exact, SLOPE_Y) * corner_y + get(exact, SLOPE_X) * corner_x
        start.to(SINGLE).store(builder.gep(here, [row]))
        found = (block_x <= get(whole, LAST_X) >> SIDE_BITS) & (inside > 0)
        found = found & (block_y <= get(whole, LAST_Y) >> SIDE_BITS)
        at_border = (block_x >= full_x) | (block_y >= full_y)
        return builder.or_(found.bits(), builder.shl(at_border.bits(), LONG(LANES)))

    return types.int64(types.int64, window, edges, batch), generate


HAIR = {SINGLE: 2.0**-14, DOUBLE: 2.0**-20}
"""What is added to quotients: more than they are rounded, and less than the least that is not 0.
In float32 for edges of up to 17 samples, in float64 for all but large ones."""
BEYOND = 512.0
"""Half of it is more samples than any of them reaches, and a value times it fits 32 bits."""


def _last_owned(value, slope):
    """How far an edge function stays 0 or more: floor(value / |slope|), below 0 where it is not.

    Where slope > 0 it is 0 or more from minus that on. A quotient that is not whole is at least
    1/|slope| from the next whole number, far more than rounding and what is added for it.
    """
    kind = slope.kind
    value = value.to(kind)
    share = value * (slope.like(1.0) / slope.magnitude()) + HAIR[kind]
    # Along an edge that is level, all samples are on the same side.
    level = (value + 0.5) * BEYOND
    return share.where(slope.magnitude() > 0, level).floor().to(WORD)


@intrinsic
def owned_lanes(typing, few, edges, batch):
    """Count the samples that those of sixteen triangles own that have bits in `few`.

    To `batch.masks`. They reach at most `LANES` columns and rows; all are taken a row at a time.
    """

    def generate(context, builder, signature, args):
        few, edges, batch = args
        whole, masks = (builder.extract_value(batch, n) for n in (0, 5))

        def get(array, row):
            return load(builder, builder.gep(array, [LONG(row * LANES)]), LANES)

        first_x, last_x, first_y, last_y = (get(whole, row) for row in range(4))
        from_corner = first_x & (SIDE - 1)
        left, right = from_corner, last_x - first_x + from_corner
        across, down = ([get(edges, row + n) for n in range(3)] for row in (ACROSS, DOWN))
        slopes = [step.to(SINGLE) for step in across]
        rows = (last_y - first_y + 1).where(from_bits(builder, few, LANES), 0)
        n_rows = builder.sext(rows.reduced("greatest"), LONG)
        values = [
            cgutils.alloca_once_value(
                builder, (get(edges, E + n) + down[n] * (first_y & (SIDE - 1))).value
            )
            for n in range(3)
        ]
        total = cgutils.alloca_once_value(builder, rows.like(0).value)
        with cgutils.for_range_slice(builder, LONG(0), n_rows, LONG(1), LONG) as (y, _):
            begin, end = left, right
            for at, slope, step in zip(values, slopes, down, strict=True):
                value = Lanes(builder, builder.load(at))
                bound = _last_owned(value, slope)
                begin = begin.greatest(bound.like(0) - bound).where(slope > 0, begin)
                end = end.where(slope > 0, end.least(bound))
                builder.store((value + step).value, at)
            is_row = rows > spread(builder, builder.trunc(y, WORD), LANES)
            owned = Lanes(builder, builder.load(total))
            more = owned + (end - begin + 1).greatest(0)
            builder.store(more.where(is_row, owned).value, total)
        Lanes(builder, builder.load(total)).store(masks)
        return context.get_dummy_value()

    return types.void(types.int64, edges, batch), generate


@intrinsic
def owned_rows(typing, edges, k, start, batch):
    """How many samples triangle k owns in sixteen rows, from `start` rows below its first one."""

    def generate(context, builder, signature, args):
        edges, k, start, batch = args
        whole = builder.extract_value(batch, 0)

        def get(array, row):
            value = builder.load(builder.gep(array, [builder.add(k, LONG(row * LANES))]))
            return spread(builder, value, LANES)

        first_x, last_x, first_y, last_y = (get(whole, row) for row in range(4))
        corner_x, corner_y = (first >> SIDE_BITS << SIDE_BITS for first in (first_x, first_y))
        y = first_y + spread(builder, builder.trunc(start, WORD), LANES)
        y = y + constants(builder, WORD, range(LANES))
        left, right = first_x - corner_x, last_x - corner_x
        for n in range(3):
            value, across, down = (get(edges, row + n) for row in (E, ACROSS, DOWN))
            value = value + down * (y - corner_y)
            bound = _last_owned(value, across.to(DOUBLE))
            left = left.greatest(bound.like(0) - bound).where(across > 0, left)
            right = right.where(across > 0, right.least(bound))
        owned = (right - left + 1).greatest(0)
        owned = owned.where(y <= last_y, 0)
        return builder.sext(owned.reduced("__add__"), LONG)

    whole = types.int64
    return whole(edges, whole, whole, batch), generate


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
                    builder,
                    builder.load(builder.gep(edges, [builder.add(k, LONG(row * LANES))])),
                    LANES,
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
                builder,
                builder.load(builder.gep(exact, [builder.add(k, LONG(row * LANES))])),
                LANES,
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
                builder,
                builder.load(builder.gep(plane, [builder.add(k, LONG(row * LANES))])),
                LANES,
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
        with cgutils.for_range_slice(builder, begin, end, LONG(CACHE_LINE // size), LONG) as (
            at,
            _,
        ):
            prefetch(builder, builder.gep(data, [at]))
        return context.get_dummy_value()

    return types.void(data, types.int64, types.int64), generate


@intrinsic
def fetch_counts(typing, data, lines, begin, end):
    """Ask for these lines of counts, before they are needed."""

    def generate(context, builder, signature, args):
        data, lines, begin, end = args
        with cgutils.for_range_slice(builder, begin, end, LONG(1), LONG) as (at, _):
            line = builder.sext(builder.load(builder.gep(lines, [at])), LONG)
            face = builder.shl(line, LONG(LINE_BITS))
            prefetch(builder, builder.gep(data, [face]), is_written=True)
        return context.get_dummy_value()

    return types.void(data, lines, types.int64, types.int64), generate


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
