"""Measures of eight faces of a pose at a time by SIMD, and sums of them, for the loops of coverage.

Where all faces of a block are wholly in the image of a pinhole, `judge_eight` measures and judges
them; elsewhere the functions of `rastercov.kernels.coverage` put the measures of one face after
another into the block, by the same order of operations.
"""

import functools
import operator

import numpy as np
from llvmlite import ir
from numba.core import types

from rastercov.kernels.cameras import (
    COLUMNS,
    DOWN,
    INSIDE,
    RIGHT,
    STATE,
    U,
    V,
    X,
    Y,
    Z,
    by_lens,
    density_along,
    density_per_m2,
    transposed,
)
from rastercov.kernels.decision import (
    AREA,
    AT_A_TIME,
    BACK_FACING,
    BOUND,
    CERTIFIED,
    COSINE,
    COVERAGE,
    COVERED,
    DEGENERATE,
    DENSITY,
    DRAWN,
    EXACT,
    FACING,
    FOCUSED,
    IN_VIEW,
    KIND,
    PART,
    PER_M2,
    REASON,
    STATISTICAL,
    VISIBLE,
    decide,
    put_row,
    row_of,
)
from rastercov.kernels.simd import DOUBLE, LONG, load
from rastercov.kernels.simd_kernel import Variable, pointer, simd, when

ROUNDING = 2.0**-52
"""Rounding of a quotient."""


COSINE_ROUNDING = 1e-14
"""Greater than the error of a cosine, and of the cosine of its arccosine."""


BYTE = ir.IntType(8)


def _by_face(first, scene, lens, seen, row, rules, work, asks_density, asks_facing, asks_bound):
    """See `judge_eight`: through a lens faces are measured one by one."""
    return False


@by_lens(_by_face)
def judge_eight(first, scene, lens, seen, row, rules, work, asks_density, asks_facing, asks_bound):
    """Fill `work.block` with the figures of `AT_A_TIME` faces of a pose, from `first` on.

    Returns
    -------
    bool
        False where that must be done face by face: one is not wholly in the image, or at the limit
        of incidence; bounds of counts are asked for beside others. The block is undefined then.
    """
    n_faces, is_counted = scene.faces.shape[0], seen.kind.size == 0
    samples = 0.0
    if asks_bound and (is_counted or seen.kind[row, first] == STATISTICAL):
        samples = seen.samples_per_pixel
    return measure_block(
        first, pointer(scene.faces), pointer(scene.normals), pointer(scene.two_sided),
        pointer(work.points), pointer(seen.poses[row]), lens, rules,
        scene.doubtful_cosine if asks_bound else 0.0,
        np.int64(asks_density), np.int64(asks_facing), samples, pointer(work.block),
    ) and judge_areas(
        first, row * n_faces + first, pointer(scene.degenerate), pointer(seen.visible),
        pointer(seen.drawn), pointer(seen.kind), pointer(seen.area_error), seen.scale, rules,
        np.int64(asks_bound), np.int64(is_counted), np.int64(seen.area_error.size > 0),
        samples, pointer(work.block),
    )  # fmt: skip


@simd(returns=types.boolean)
def measure_block(
    first, faces, normals, two_sided, points, pose, lens, rules, doubtful_cosine, asks_density,
    asks_facing, samples, block,
):  # fmt: skip
    """Fill the rows of a block that follow from geometry; arrays are pointers to their data.

    BOUND is the perimeter, px, where there are `samples` a square pixel, 0 for areas.

    Returns False, and nothing, unless all vertices are inside the image, and no face is edge-on.
    """
    builder = first.builder
    x, y, z, right, down, u, v, state = _corners(faces.at(first * 3), points)
    is_inside = state[0].minimum(state[1]).minimum(state[2]).equals(INSIDE)
    is_clear = Variable(is_inside.bits())
    with when(is_clear.now.equals((1 << AT_A_TIME) - 1)):
        normal = _turned(load(builder, normals.at(first * 3).pointer, 3 * AT_A_TIME), pose)
        sums = [a + b + c for a, b, c in (x, y, z)]
        is_two_sided = load(builder, two_sided.at(first).pointer, AT_A_TIME) > 0
        cosine = _incidence_cosine(normal, sums)
        cosine = cosine.absolute().where(is_two_sided, cosine)
        (u0, u1, u2), (v0, v1, v2) = u, v
        area = ((u1 - u0) * (v2 - v1) - (v1 - v0) * (u2 - u1)).absolute() / 2
        has_image = area > 0
        nearest, farthest = z[0].minimum(z[1]).minimum(z[2]), z[0].maximum(z[1]).maximum(z[2])
        is_focused = Variable((nearest >= rules.z_n) & (farthest <= rules.z_f))
        with when(rules.focus_of_centroid):
            centre = sums[2] / 3
            is_focused.now = (centre >= rules.z_n) & (centre <= rules.z_f)
        facing, density = Variable(area.like(0.0)), Variable(area.like(0.0))
        with when(asks_facing > 0):
            facing.now = farthest.like(lens.fx.minimum(lens.fy)) / farthest
        is_front = cosine > 0
        with when((asks_density > 0) & (is_front.bits() > 0)):
            least = _worst(density_along, normal, right, down, z, lens)
            density.now = least.where(is_front & has_image, 0.0)
        with when(rules.min_pixels_per_m2 > 0):
            put_row(block, PER_M2, _worst(density_per_m2, normal, right, down, z, lens))
        p, q, r = sums
        height = cosine.absolute() * (p * p + q * q + r * r).sqrt()
        size = functools.reduce(operator.add, (each.absolute() for each in (*x, *y, *z)))
        is_clear.now = (height > size * doubtful_cosine).bits()
        put_row(block, COSINE, cosine)
        put_row(block, PART, area.like(1.0).where(has_image, 0.0))
        put_row(block, AREA, area)
        put_row(block, DENSITY, density.now)
        put_row(block, FACING, facing.now)
        put_row(block, FOCUSED, area.like(1.0).where(is_focused.now, 0.0))
        put_row(block, IN_VIEW, area.like(1.0))
        with when(samples > 0):
            length = area.like(0.0)
            for p, q in ((0, 1), (1, 2), (2, 0)):
                du, dv = u[q] - u[p], v[q] - v[p]
                length = length + (du * du + dv * dv).sqrt()
            put_row(block, BOUND, length)
    return is_clear.now.equals((1 << AT_A_TIME) - 1)


@simd(returns=types.boolean)
def judge_areas(
    first, at, degenerate, visible, drawn, kind, area_error, scale, rules, asks_bound, is_counted,
    has_error, samples, block,
):  # fmt: skip
    """Complete a block by what an observer measured, and decide; arrays are pointers.

    `at` is the place of the first face in the arrays of the observation. Returns False for a face
    at the limit of incidence, and for a bound of counts among others.
    """
    builder = first.builder
    cosine = row_of(block, COSINE)
    is_degenerate = load(builder, degenerate.at(first).pointer, AT_A_TIME) > 0
    is_front = (cosine > 0) & ~is_degenerate
    visible, drawn = _areas(at, visible, drawn, scale)
    code = Variable(cosine.to(LONG).like(STATISTICAL))
    with when(~(is_counted > 0)):
        code.now = load(builder, kind.at(at).pointer, AT_A_TIME).zero_extended(LONG)
    bound, is_seen = Variable(cosine.like(0.0)), Variable(cosine > 0)
    is_seen.now = is_front
    with when(asks_bound > 0):
        bound.now = _bound_of_areas(at, drawn, area_error, has_error, code.now)
        with when(samples > 0):
            of_counts = _bound_of_counts(row_of(block, BOUND), drawn, samples)
            bound.now = of_counts.where(code.now.equals(STATISTICAL), bound.now)
        # Nothing is known of an image within its rounding, whichever side is seen.
        with when(has_error > 0):
            error = load(builder, area_error.at(at).pointer, AT_A_TIME)
            is_in_doubt = (drawn <= error) & code.now.equals(EXACT)
            is_seen.now = is_front | is_in_doubt
    density = row_of(block, DENSITY).where(is_front, 0.0)
    densities = density, row_of(block, FACING), row_of(block, PER_M2)
    everywhere = is_front.like(1)
    decision = decide(
        rules, is_degenerate, is_front, everywhere, everywhere, row_of(block, FOCUSED) > 0, visible,
        drawn, densities, cosine < rules.cos_incidence,
    )  # fmt: skip
    for row, values in (
        (VISIBLE, visible), (DRAWN, drawn), (BOUND, bound.now.where(is_seen.now, 0.0)),
        (KIND, code.now.where(is_front, EXACT).to(DOUBLE)), (DENSITY, density), *decision,
    ):  # fmt: skip
        put_row(block, row, values)
    is_unclear = (cosine - rules.cos_incidence).absolute() < COSINE_ROUNDING
    is_left_out = code.now.equals(STATISTICAL) & ((asks_bound > 0) & ~(samples > 0))
    is_unclear = is_unclear | (is_front & is_left_out)
    return is_unclear.bits().equals(0)


@simd(returns=types.boolean)
def are_behind(first, normals, offsets, two_sided, x, y, z, rounding):
    """True if a camera at (x, y, z) is behind `AT_A_TIME` faces; arrays are pointers."""
    builder = first.builder
    normal = load(builder, normals.at(first * 3).pointer, 3 * AT_A_TIME)
    a, b, c = (normal.every(3, axis) for axis in range(3))
    height = a * x + b * y + c * z - load(builder, offsets.at(first).pointer, AT_A_TIME)
    is_one_sided = load(builder, two_sided.at(first).pointer, AT_A_TIME).equals(0)
    is_behind = (height < -rounding) & is_one_sided
    return is_behind.bits().equals((1 << AT_A_TIME) - 1)


@simd(returns=types.void)
def add_backs(first, degenerate, reasons, coverage):
    """Add faces that a pose sees from behind to the sums of a network; arrays are pointers."""
    builder = first.builder
    is_degenerate = load(builder, degenerate.at(first).pointer, AT_A_TIME) > 0
    before = load(builder, reasons.at(first).pointer, AT_A_TIME)
    reason = before.like(DEGENERATE).where(is_degenerate, BACK_FACING)
    reason.maximum(before).store(reasons.at(first).pointer)
    before.like(0).to(DOUBLE).store(coverage.at(first).pointer)


@simd(returns=types.int64)
def add_lanes(first, pose, is_scored, sums, coverage, block):
    """Add a block to the sums of a network and to the coverage of a pose; arrays are pointers.

    See `network.add_pair`. Returns the number of faces that are scored and covered.
    """
    builder = first.builder

    def of_faces(array):
        return load(builder, array.at(first).pointer, AT_A_TIME)

    product, reason, bound = (row_of(block, row) for row in (COVERAGE, REASON, BOUND))
    is_covered, counts = reason.equals(COVERED), of_faces(is_scored) > 0
    (of_faces(sums.views) + is_covered.to(LONG)).store(sums.views.at(first).pointer)
    best, best_row = of_faces(sums.best), of_faces(sums.best_row)
    is_tie = product.equals(best) & (best_row > pose)
    is_best = (product > 0) & ((product > best) | is_tie)
    product.where(is_best, best).store(sums.best.at(first).pointer)
    best_row.like(pose).where(is_best, best_row).store(sums.best_row.at(first).pointer)
    before = of_faces(sums.reason)
    code = reason.to(BYTE)
    code.maximum(before).store(sums.reason.at(first).pointer)
    product.store(coverage.at(first).pointer)
    in_view = counts & (reason > BACK_FACING) & (row_of(block, PART) > 0)
    kind = row_of(block, KIND)
    for value in (STATISTICAL, CERTIFIED, EXACT):
        found = (in_view & kind.equals(value)).bits().count_bits()
        sums.kinds.put(value, sums.kinds.value(value) + found)
    is_covered = is_covered & counts
    for place, chosen in ((0, in_view), (1, is_covered)):
        largest = bound.where(chosen, 0.0).reduce("maximum")
        sums.bounds.put(place, largest.maximum(sums.bounds.value(place)))
    return is_covered.bits().count_bits()


def _corners(faces, points):
    """Columns of the projected vertices of faces, three vectors each."""
    found = []
    for s in range(3):
        places = (faces.value(3 * k + s) * COLUMNS for k in range(AT_A_TIME))
        rows = [load(points.builder, points.at(at).pointer, COLUMNS) for at in places]
        found.append(transposed(rows))
    return [[corner[column] for corner in found] for column in (X, Y, Z, RIGHT, DOWN, U, V, STATE)]


def _turned(normals, pose):
    """Unit normals of faces in camera axes."""
    a, b, c = (normals.every(3, axis) for axis in range(3))
    return [a * pose.value(k) + b * pose.value(4 + k) + c * pose.value(8 + k) for k in range(3)]


def _incidence_cosine(normal, sums):
    """Cosine of the angle of incidence of one-sided faces, from sums of their vertices."""
    (a, b, c), (x, y, z) = normal, sums
    reach = (x * x + y * y + z * z).sqrt()
    return (-(a * x + b * y + c * z) / reach).where(reach > 0, 0.0)


def _worst(density, normal, right, down, z, lens):
    """Least of the densities at three vertices; see `cameras.density_along`."""
    worst = None
    for s in range(3):
        here = density(lens.fx, lens.fy, right[s], down[s], z[s], *normal)
        worst = here if worst is None else worst.where(worst <= here, here)
    return worst


def _areas(at, visible, drawn, scale):
    """Visible and drawn area of faces, px^2; see `coverage.measure_face`."""
    found = []
    for array in (visible, drawn):
        area = Variable(load(at.builder, array.at(at).pointer, AT_A_TIME).to(DOUBLE))
        with when(~scale.equals(1.0)):
            area.now = area.now / scale
        found.append(area.now)
    return found


def _bound_of_areas(at, drawn, area_error, has_error, kind):
    """See `face_bounds.bound_of_fraction`, for areas."""
    exact = Variable(drawn.like(ROUNDING))
    with when(has_error > 0):
        error = load(at.builder, area_error.at(at).pointer, AT_A_TIME)
        least = drawn - error
        exact.now = (error / least).where(least > 0, 1.0) + ROUNDING
    bound = exact.now.where(kind.equals(EXACT), 0.0).where(drawn > 0, 1.0)
    return bound.minimum(1.0)


def _bound_of_counts(length, drawn, samples):
    """See `face_bounds.bound_of_fraction`, for counts in faces of a perimeter, px."""
    root = length.like(samples).sqrt()
    length = length * root
    deviation = (length * 1.25 + 1.0).sqrt() * (3 * 0.27) + length / 20.0
    return (deviation / (drawn * samples)).where(drawn > 0, 1.0).minimum(1.0)
