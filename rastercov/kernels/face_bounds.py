"""Bounds of the visible fraction of a face, and what rounding may decide, compiled by numba.

`put_bound` completes the measures of a face that `rastercov.kernels.coverage` puts into a block.
`rastercov.kernels.face_blocks` has the same bounds for eight faces at a time.
"""

import math

from rastercov.kernels import decision as code
from rastercov.kernels.cameras import BEHIND, INSIDE, STATE, U, V, X, Y, Z, by_lens
from rastercov.kernels.criteria import (
    MOST_DOUBTFUL,
    SIDE_ROUNDING,
    corner_sums,
    cut_to_image,
    image_beyond,
)
from rastercov.kernels.face_blocks import ROUNDING
from rastercov.kernels.jit import part_with_arrays

BORDER_ROUNDING = 2.0**-46
"""Greater than the error of a position in the image, relative to the numbers it is made from."""


@part_with_arrays
def perimeter(points, i, j, k):
    """Length of the outline of a face beyond the near plane, px."""
    total = 0.0
    for s in range(3):
        p = i if s == 0 else j if s == 1 else k
        q = j if s == 0 else k if s == 1 else i
        u, v = points[q, U] - points[p, U], points[q, V] - points[p, V]
        total += math.sqrt(u * u + v * v)  # hypot is a call, 5 times as slow
    return total


@part_with_arrays
def kind_of(seen, row, f):
    """Kind of the bound of a visible fraction."""
    return int(seen.kind[row, f]) if seen.kind.size else code.STATISTICAL


@part_with_arrays
def bound_of_fraction(seen, row, f, drawn, points, faces, is_cut):
    """Bound of visible / drawn of a face that is seen, at most 1.

    |v/d - v'/d'| <= (|v - v'| + |d - d'|) / d with d the true area; see `raster.observation`
    for counts. Nothing is known of a face whose image rounds to nothing, or that owns no sample.
    """
    bound = 1.0
    if drawn > 0:
        kind = kind_of(seen, row, f)
        if kind == code.EXACT:
            error = seen.area_error[row, f] if seen.area_error.size else 0.0
            least = drawn - error
            bound = (error / least if least > 0 else 1.0) + ROUNDING
        elif kind == code.STATISTICAL:
            samples, length = seen.samples_per_pixel, math.inf
            if not is_cut:
                length = perimeter(points, faces[f, 0], faces[f, 1], faces[f, 2])
                length *= math.sqrt(samples)
            deviation = 3 * 0.27 * math.sqrt(1.25 * length + 1) + length / 20
            bound = deviation / (drawn * samples)
        else:
            bound = 0.0
    return min(bound, 1.0)


@part_with_arrays
def put_bound(lane, f, scene, lens, seen, row, work):
    """Put the bound of the visible fraction of a measured face, and its kind, into its lane.

    The bound is 1 where rounding decides which side of the face is seen.
    """
    block, points, cosine = work.block, work.points, work.block[code.COSINE, lane]
    state, part = block[code.STATE_OF_FACE, lane], block[code.PART, lane]
    drawn, has_part = block[code.DRAWN, lane], part != 0 or state == INSIDE
    bound, kind = 0.0, code.EXACT
    if block[code.SIDE, lane] > 0 and has_part:
        bound = bound_of_fraction(seen, row, f, drawn, points, scene.faces, state == BEHIND)
        kind = kind_of(seen, row, f)
    if is_in_doubt(scene, lens, seen, points, row, f, drawn, cosine, state, has_part, work):
        bound = 1.0
    block[code.BOUND, lane], block[code.KIND, lane] = bound, kind


@part_with_arrays
def is_edge_on(scene, points, f, cosine, state):
    """True if rounding may decide which side of a face the camera sees."""
    if scene.degenerate[f]:
        return True
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    size = abs(points[i, X]) + abs(points[i, Y]) + abs(points[i, Z])
    size += abs(points[j, X]) + abs(points[j, Y]) + abs(points[j, Z])
    size += abs(points[k, X]) + abs(points[k, Y]) + abs(points[k, Z])
    x, y, z = corner_sums(points, i, j, k)
    height = abs(cosine) * math.sqrt(x * x + y * y + z * z)
    has_needles = scene.doubtful_cosine == MOST_DOUBTFUL
    if height > scene.doubtful_cosine * size and not (has_needles and state != INSIDE):
        return False
    corners = scene.vertices
    ax, ay, az = (
        corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1], corners[j, 2] - corners[i, 2],
    )  # fmt: skip
    bx, by, bz = (
        corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1], corners[k, 2] - corners[i, 2],
    )  # fmt: skip
    scale = max(abs(ax), abs(ay), abs(az), abs(bx), abs(by), abs(bz))
    ax, ay, az, bx, by, bz = ax / scale, ay / scale, az / scale, bx / scale, by / scale, bz / scale
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    cross = math.sqrt(nx * nx + ny * ny + nz * nz)
    product = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    return height * cross <= SIDE_ROUNDING * size * product


def _through_lens(points, i, j, k, near, lens, work, is_edge_on):
    """See `may_reach_image`: areas through a lens have bounds that hold at the border, too."""
    return is_edge_on


@by_lens(_through_lens)
def may_reach_image(points, i, j, k, near, lens, work, is_edge_on):
    """True if a face without area in the image of a pinhole may have some within rounding.

    Through another lens: where it `is_edge_on`.
    """
    numbers = lens.width + lens.height + lens.fx + lens.fy + abs(lens.cx) + abs(lens.cy)
    numbers += lens.width * lens.width / lens.fx + lens.height * lens.height / lens.fy
    margin = BORDER_ROUNDING * numbers
    if min(points[i, STATE], points[j, STATE], points[k, STATE]) != BEHIND:
        u0, v0, u1, v1 = points[i, U], points[i, V], points[j, U], points[j, V]
        u2, v2 = points[k, U], points[k, V]
        if (
            max(u0, u1, u2) < -1
            or max(v0, v1, v2) < -1
            or min(u0, u1, u2) > lens.width + 1
            or min(v0, v1, v2) > lens.height + 1
        ):
            return False
    here = work.polygon
    n = image_beyond(points, i, j, k, near * (1 - BORDER_ROUNDING), lens, here)
    for p in range(n):
        margin = max(margin, BORDER_ROUNDING * max(abs(here[p, 0]), abs(here[p, 1])))
    return cut_to_image(here, n, lens, margin, work.spare) > 0


@part_with_arrays
def is_in_doubt(scene, lens, seen, points, row, f, drawn, cosine, state, has_part, work):
    """True if rounding may decide whether a face is seen from the front and in the image."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    if not has_part and not drawn > 0:
        edge_on = is_edge_on(scene, points, f, cosine, state)
        return (cosine > 0 or edge_on) and may_reach_image(
            points, i, j, k, seen.near[row], lens, work, edge_on
        )
    is_computed = kind_of(seen, row, f) == code.EXACT and seen.area_error.size > 0
    if is_computed and drawn <= seen.area_error[row, f]:
        return True
    if cosine > 0 and (scene.two_sided[f] or not has_part):
        return not has_part
    return is_edge_on(scene, points, f, cosine, state)
