"""Stages of the rasteriser of lenses before samples: clusters, vertices, and planes of faces.

A vector of `LANES` clusters, vertices or faces at a time. See `raster_lens` for the planes, and
`lens_records` for the rows that are written.
"""

from functools import partial

from numba.core import types

from rastercov.kernels.raster_lens_records import (
    AXES,
    BEHIND,
    BEND,
    CANVAS,
    CHORD,
    CHORD_X,
    CHORD_Y,
    CORNER,
    CUT,
    EYE,
    FACE,
    FIRST_COLUMN,
    FIRST_ROW,
    GREATEST,
    HALF,
    HIGH,
    LAST_COLUMN,
    LAST_ROW,
    LEAST,
    LIMIT,
    LOW,
    NEAR,
    RADIUS2,
    REACH,
    SAMPLES_HIGH,
    SAMPLES_LOW,
    SIDE,
    SLOPE_X,
    SLOPE_Y,
    SLOTS,
    TILE,
    TILE_BITS,
    VALUE,
    VIEW_VALUES,
)
from rastercov.kernels.raster_memory import (
    ALTITUDE,
    CENTRE,
    CONE_AXIS,
    CONE_COS,
    CONE_SIN,
    LANES,
    PLANE_OFFSET,
    RADIUS,
    VERTICES,
)
from rastercov.kernels.simd import SINGLE, WORD
from rastercov.kernels.simd_kernel import Variable, loop, simd

SLACK = 1e-7
"""Margin of boxes and spheres for rounding, relative, in units of the plane."""
BACK_REL = 1e-13
"""Least volume 2 A h of a face of area A whose plane is h from the eye, relative to the cube of its
distance, for it to be seen from behind by more than `ROUNDING_REL`."""
ROUNDING_REL = 1e-14
"""Rounding of n.a relative to the cube of the largest coordinate, with a factor of 5."""
DOUBT_REL = 1e-14
"""Rounding of an edge at a sample relative to both its corners and the sample, with a factor of
5."""
DOUBT32_REL = 1e-6
"""Rounding to float32 of an edge at a sample relative to its change within a block, where the edge
crosses the block: 2^-24 for each of its value at the center, two products and two sums, all of them
at most three times the change, with a factor of 2."""
MARGIN_REL = 1e-6
"""Margin of a tile beside an edge, relative to its slopes and to 1 + |x| + |y|, for rounding to
float32: 2^-24 for each of three numbers of an edge, the box, two products and two sums, with a
factor of 2."""
CANVAS_MARGIN = 0.01
"""Samples: margin of the box of a face on the canvas, for rounding of places to float32, 1e-6, and
of the lens, 1e-9."""
CANVAS_REL, PLANE_REL = 2.0**-20, 2.0**-21
"""The same relative to a place on the canvas, and to one of the plane, for their own rounding to
float32: 2^-24 for each of a number, its sums and its products."""
MOST_STRAY = 8.0
"""Samples that sides of a face may leave their chords by, for its box to be made from its corners.
"""
MOST_CHORD_STRAY = 1.0
"""The same for its tiles to be found by the chords."""
LEAST_LENGTH = 1e-30
"""Length of a chord at least, in samples: a shorter one has no direction, and is 0 everywhere."""
LEAST_DOUBT = 1e-300
"""Doubt of an edge at least: that of an edge from the eye is 0, and so are its slopes."""
MOST_SLOPE = 1e30
"""Change of 1/z at most, in 1/m to the unit of the plane: all sums of it are float32, never NaN. A
face beyond it is seen from its side, and its 1/z is that of its nearest corner."""
MOST_PLACE = float(1 << 24)
"""Samples from the origin of a canvas: more than any image has."""


@simd(returns=types.int64)
def cull_clusters(bounds, stride, first, view, hides_backs, forward):
    """Bits of a vector of clusters that may show a face to a sample; `forward` gets their depths.

    A cluster is left out that is beside the box of all samples or before the near plane, or, where
    `hides_backs` is not 0, of whose faces the planes are so far before the eye that each is known
    to be seen from behind. For `bounds`, (11, stride), see `Clusters.bounds`.
    """

    def row(k):
        return bounds.at(stride * k + first)[0]

    eye = [row(CENTRE + k) - view.value(EYE + k) for k in range(3)]
    x, y, z = (
        eye[0] * view.value(AXES + k)
        + eye[1] * view.value(AXES + 3 + k)
        + eye[2] * view.value(AXES + 6 + k)
        for k in range(3)
    )
    forward.at(first)[0] = z
    squared = eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2]
    distance = squared.sqrt()
    radius = row(RADIUS)
    reach = distance + radius
    slack = reach * (view.value(REACH) * SLACK)
    is_outside = z + radius + reach * SLACK < view.value(NEAR)
    for k, place in enumerate((x, y)):
        for limit, sign in ((view.value(LOW + k), 1.0), (view.value(HIGH + k), -1.0)):
            length = (limit * limit + 1.0).broadcast(LANES).sqrt()
            is_outside = is_outside | ((place - z * limit) * sign + radius * length < -slack)
    along = eye[0] * row(CONE_AXIS) + eye[1] * row(CONE_AXIS + 1) + eye[2] * row(CONE_AXIS + 2)
    across = (squared - along * along).maximum(0).sqrt()
    # The greatest n . d over the normals n of the cone, d to the eye: |d| where d is in it.
    is_in_cone = -along >= distance * row(CONE_COS)
    highest = distance.where(is_in_cone, across * row(CONE_SIN) - along * row(CONE_COS))
    below = row(PLANE_OFFSET) - highest - reach * SLACK
    altitude = row(ALTITUDE)
    is_back = below * altitude * altitude > reach * reach * reach * BACK_REL
    is_back = is_back & (hides_backs > 0).broadcast(LANES)
    return (~(is_outside | is_back)).bits()


@simd(returns=types.void)
def place_vertices(points, first_vertex, n, view, vertices, x, y):
    """Write n vertices of a cluster, from one on, in axes of a plane, and their places in it.

    Places also go to the lists `x` and `y` for the lens, 0 where it may not be evaluated; there
    `vertices.unknown` is NaN, elsewhere 0. For `points` see `Clusters.points`.
    """
    values = [view.value(k).broadcast(LANES) for k in range(VIEW_VALUES)]
    with loop(n.like(0), n, LANES) as first:
        starts = [first_vertex * 3 + n * axis + first for axis in range(3)]
        a, b, c = (points.at(start)[0] - values[EYE + k] for k, start in enumerate(starts))
        right, down, z = (
            a * values[AXES + k] + b * values[AXES + 3 + k] + c * values[AXES + 6 + k]
            for k in range(3)
        )
        w = z.like(1.0) / z
        across, along = right * w, down * w
        is_known = (z >= values[NEAR]) & (across * across + along * along < values[RADIUS2])
        across, along = across.where(is_known, 0.0), along.where(is_known, 0.0)
        for rows, value in (
            (vertices.x, right),
            (vertices.y, down),
            (vertices.z, z),
            (vertices.across, across),
            (vertices.along, along),
            (vertices.unknown, z.like(0.0).where(is_known, float("nan"))),
            (x, across),
            (y, along),
        ):
            rows.at(first)[0] = value


@simd(returns=types.UniTuple(types.float32, 7))
def put_on_canvas(n, view, vertices, u, v):
    """Write the places on the canvas of n vertices, from their pixels `u` and `v`.

    Returns the box of the cluster, and how far its faces may leave it: least and greatest u, least
    and greatest v, the stray, the greatest 1/z, and a sum that is NaN if a vertex has no place.
    """
    to = [view.value(CANVAS + k).broadcast(LANES) for k in range(6)]
    lane = n.broadcast(LANES).like(range(LANES))
    start = vertices.u[0]
    limits = [Variable(start.like(value)) for value in (1e38, -1e38) * 4]
    nearest, total = Variable(start.like(0.0)), Variable(start.like(0.0))
    with loop(n.like(0), n, LANES) as first:
        a, b = u.at(first)[0], v.at(first)[0]
        unknown = vertices.unknown.at(first)[0]
        found = [
            (a * to[k] + b * to[k + 1] + to[k + 2]).to(SINGLE) + unknown for k in (0, 3)
        ]  # fmt: skip
        vertices.u.at(first)[0], vertices.v.at(first)[0] = found
        is_vertex = lane < n - first
        found += [vertices.across.at(first)[0], vertices.along.at(first)[0]]
        for k, value in enumerate(found):
            low, high = limits[2 * k], limits[2 * k + 1]
            low.now = low.now.minimum(value).where(is_vertex, low.now)
            high.now = high.now.maximum(value).where(is_vertex, high.now)
        z = vertices.z.at(first)[0]
        inverse = (z.like(1.0) / z).to(SINGLE)
        nearest.now = nearest.now.maximum(inverse).where(is_vertex, nearest.now)
        total.now = (total.now + unknown).where(is_vertex, total.now)
    ends = [limit.now.reduce("maximum" if k & 1 else "minimum") for k, limit in enumerate(limits)]
    slack = (view.value(REACH) * PLANE_REL).to(SINGLE)
    wide, high = ends[5] - ends[4] + slack, ends[7] - ends[6] + slack
    stray = (wide * wide + high * high) * view.value(BEND)
    rest = stray, nearest.now.reduce("maximum"), total.now.reduce("__add__")
    return (*ends[:4], *rest)


def _cross(one, other):
    """Product of two vectors; -(a x b) is b x a to the bit."""
    (ax, ay, az), (bx, by, bz) = one, other
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def _largest(point):
    """Largest coordinate of a point."""
    x, y, z = (value.absolute() for value in point)
    return x.maximum(y).maximum(z)


def _put_chords(put, places, stray, margin):
    """Write the chords of a vector of faces, whose corners on the canvas are `places`.

    A side of a face is within `stray` of its chord, at each of its points. So is the border of its
    image as a whole of the triangle, and winds around a place that is farther from it once if the
    triangle does, else not at all. A place that is beyond one chord by more than that is outside
    the image; one that is before all three by as much is inside. `margin` is for rounding.
    """
    (ax, ay), (bx, by), (cx, cy) = places
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    sign = area.like(1.0).where(area > 0.0, -1.0)
    half = (TILE - 1) / 2  # from the middle of a tile to its outermost samples
    for k, ((x, y), (to_x, to_y)) in enumerate(
        (((ax, ay), (bx, by)), ((bx, by), (cx, cy)), ((cx, cy), (ax, ay)))
    ):
        slope_x, slope_y = y - to_y, to_x - x
        length = slope_x.absolute() + slope_y.absolute()
        scale = sign / (length * (stray + margin + half)).maximum(LEAST_LENGTH)
        slope_x, slope_y = slope_x * scale, slope_y * scale
        put(CHORD_X + k, slope_x * TILE)
        put(CHORD_Y + k, slope_y * TILE)
        put(CHORD + k, slope_x * (-x + TILE / 2) + slope_y * (-y + TILE / 2))


@simd(returns=types.UniTuple(types.int64, 5))
def set_up_faces(mesh, first_slot, at, front_only, vertices, view, setup):
    """Write the planes of a vector of faces, and the tiles that they may reach.

    The faces are those of slots `at` on, of the cluster from `first_slot` on in `mesh`.
    Returns 5 masks: faces that may be seen or counted; those of them that are drawn, which with
    `front_only` are not those seen from behind; those whose tiles are not known, because a corner
    has no place on the canvas, or a side may leave its chord by more than `MOST_STRAY`; those that
    are seen from the side, whose sign is not known; those that have chords.
    """
    packed = mesh.corners.at(first_slot + at)[0]
    index = [packed >> 8 * k & 255 for k in range(3)]
    corners = [
        [rows.lookup(VERTICES, i) for rows in (vertices.x, vertices.y, vertices.z)] for i in index
    ]
    p, q, r = corners
    side_b = [q[k] - p[k] for k in range(3)]
    side_c = [r[k] - p[k] for k in range(3)]
    normal = _cross(side_b, side_c)
    height = normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2]
    sizes = [_largest(corner) for corner in corners]
    size = sizes[0].maximum(sizes[1]).maximum(sizes[2])
    rounding = size * ROUNDING_REL * size * size
    far, nearest = p[2].maximum(q[2]).maximum(r[2]), p[2].minimum(q[2]).minimum(r[2])
    near = view.value(NEAR)
    is_ahead = (packed > 0) & (far >= near)  # 0 fills up the last vector
    is_back = (front_only > 0).broadcast(LANES) & (height > rounding)
    is_edge_on = height.absolute() <= rounding

    def put(rows, k, value):
        rows.at(at + k * SLOTS)[0] = value

    # Tiles by the box of the corners on the canvas. No side is longer than the diagonal of a box.
    boxes, places = [], []
    for rows in (vertices.u, vertices.v, vertices.across, vertices.along):
        a, b, c = (rows.lookup(VERTICES, i) for i in index)
        boxes.append((a.minimum(b).minimum(c), a.maximum(b).maximum(c)))
        places.append((a, b, c))
    slack = (view.value(REACH) * PLANE_REL).to(SINGLE)
    wide, high = (box[1] - box[0] + slack for box in boxes[2:])
    stray = (wide * wide + high * high) * view.value(BEND)
    total = places[0][0] + places[0][1] + places[0][2]
    is_placed = total.equals(total) & (stray <= MOST_STRAY)
    can_cover, origin = is_placed, []
    largest = stray.like(0.0)
    for low, most in boxes[:2]:
        largest = largest.maximum(low.absolute()).maximum(most.absolute())
    margin = largest * CANVAS_REL + CANVAS_MARGIN
    for k, (low, most) in enumerate(boxes[:2]):
        first_place, last_place = (
            view.value(each + k).to(SINGLE) for each in (SAMPLES_LOW, SAMPLES_HIGH)
        )
        origin.append(first_place)
        # Samples are at halves: ceil(low - 1/2) up to floor(high - 1/2).
        start = -((stray + margin - low + 0.5).floor())
        end = (most + stray + margin - 0.5).floor()
        start, end = start.maximum(first_place), end.minimum(last_place)
        can_cover = can_cover & (start <= end)
        start, end = (each - first_place for each in (start, end))
        start, end = (each.maximum(0.0).minimum(MOST_PLACE).to(WORD) for each in (start, end))
        put(setup.tiles, FIRST_COLUMN if k == 0 else FIRST_ROW, start >> TILE_BITS)
        put(setup.tiles, LAST_COLUMN if k == 0 else LAST_ROW, end >> TILE_BITS)
    from_first = [(u - origin[0], v - origin[1]) for u, v in zip(*places[:2], strict=True)]
    _put_chords(partial(put, setup.bounds), from_first, stray, margin)
    put(setup.tiles, FACE, mesh.faces.at(first_slot + at)[0])
    is_wanted = is_ahead & (can_cover | ~is_placed)

    # The planes, with the inner side of edges positive. One unit of an edge is its doubt.
    side = height.like(1.0).where(height > 0.0, -1.0)
    put(setup.planes, SIDE, side)
    doubt, doubt32 = view.value(REACH) * DOUBT_REL, view.value(HALF) * DOUBT32_REL
    for k in range(3):
        one, other = corners[k], corners[(k + 1) % 3]
        edge = _cross(one, other)
        slope = edge[0].absolute() + edge[1].absolute()
        least = doubt * sizes[k] * sizes[(k + 1) % 3] + slope * doubt32
        scale = side / least.maximum(LEAST_DOUBT)
        for row, value in zip((SLOPE_X, SLOPE_Y, VALUE), edge, strict=True):
            put(setup.planes, row + k, value * scale)
        length = (slope + edge[2].absolute()) * scale.absolute()
        put(setup.bounds, LIMIT + k, length * (view.value(REACH) * MARGIN_REL) + 1.0)
        for axis in range(3):
            put(setup.planes, CORNER + 3 * k + axis, one[axis])
    greatest = height.like(1.0) / nearest.maximum(near)
    depth = [value / height for value in normal]
    is_finite = depth[0].like(0.0) < 1.0
    for value in depth:
        is_finite = is_finite & (value.absolute() <= MOST_SLOPE)
    is_cut = nearest < near
    # Of a face with the eye in it every sample is at the eye, before the near plane.
    instead = greatest + greatest.where(is_cut, 0.0)
    depth = [value.where(is_finite, 0.0) for value in depth[:2]] + [
        depth[2].where(is_finite, instead)
    ]
    for row, value in zip((SLOPE_X, SLOPE_Y, VALUE), depth, strict=True):
        put(setup.planes, row + 3, value)
    infinite = float("inf")
    put(setup.bounds, LEAST, height.like(1.0) / far)
    put(setup.bounds, GREATEST, greatest)
    put(setup.bounds, BEHIND, height.like(0.0).where(is_cut, -infinite))
    put(setup.bounds, CUT, greatest.where(is_cut, infinite))
    return (
        is_wanted.bits(),
        (is_wanted & ~is_back).bits(),
        (is_wanted & ~is_placed).bits(),
        (is_wanted & is_edge_on).bits(),
        (can_cover & ~is_edge_on & (stray <= MOST_CHORD_STRAY)).bits(),
    )


@simd(returns=types.void)
def put_twin(slot, twin, setup):
    """Copy a face to another slot with its edges the other way round."""
    for row in (*(first + k for first in (SLOPE_X, SLOPE_Y, VALUE) for k in range(3)), SIDE):
        setup.planes.at(twin + row * SLOTS).put(0, -setup.planes.value(slot + row * SLOTS))
    for row in (*(first + 3 for first in (SLOPE_X, SLOPE_Y, VALUE)), *range(CORNER, CORNER + 9)):
        setup.planes.at(twin + row * SLOTS).put(0, setup.planes.value(slot + row * SLOTS))
    for rows, n in ((setup.bounds, LIMIT + 3), (setup.tiles, FACE + 1)):
        for row in range(n):
            rows.at(twin + row * SLOTS).put(0, rows.value(slot + row * SLOTS))
