"""Coverage (3.6) of each face in some poses, compiled by numba.

`judge_poses` takes what an observer measured and gives every figure of `rastercov.Coverage`. Its
twin is in `rastercov.reference.coverage`.

Faces are judged in blocks of eight. Where all of them are wholly in the image of a pinhole,
`judge_eight` measures them together by SIMD; elsewhere `measure_face` puts the measures of one face
after another into the block, by the same order of operations.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import functools
import math
import operator
from collections import namedtuple
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from rastercov.kernels import decision as code
from rastercov.kernels.cameras import (
    BEHIND,
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
from rastercov.kernels.criteria import (
    MOST_DOUBTFUL,
    SIDE_ROUNDING,
    camera_normal,
    cut_to_image,
    facing_density,
    focus_depth_of,
    image_beyond,
    image_of_face,
    incidence_angle,
    incidence_cosine,
    perimeter,
    pixel_density,
    pixels_per_m2,
    project,
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
    decide_block,
    put_row,
    row_of,
)
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays
from rastercov.kernels.simd import DOUBLE, LONG, load
from rastercov.kernels.simd_kernel import Variable, loop, pointer, pointers, simd, when

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


@simd(returns=types.void)
def copy_block(block, n, at, out):
    """Put the figures of n faces where they are asked for, into flat arrays from `at` on.

    Arrays are pointers to their data.
    """
    for bit, (name, row) in enumerate(ROWS.items()):
        array = getattr(out, name)
        with when((out.asked >> bit & 1) > 0):
            with when(n.equals(AT_A_TIME)):
                row_of(block, row).to(array.kind).store(array.at(at).pointer)
            with when(n < AT_A_TIME), loop(n & 0, n, 1) as k:
                array.put(at + k, block.value(k + row * AT_A_TIME))


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
    """Visible and drawn area of faces, px^2; see `coverage.areas_of`."""
    found = []
    for array in (visible, drawn):
        area = Variable(load(at.builder, array.at(at).pointer, AT_A_TIME).to(DOUBLE))
        with when(~scale.equals(1.0)):
            area.now = area.now / scale
        found.append(area.now)
    return found


def _bound_of_areas(at, drawn, area_error, has_error, kind):
    """See `coverage.bound_of_fraction`, for areas."""
    exact = Variable(drawn.like(ROUNDING))
    with when(has_error > 0):
        error = load(at.builder, area_error.at(at).pointer, AT_A_TIME)
        least = drawn - error
        exact.now = (error / least).where(least > 0, 1.0) + ROUNDING
    bound = exact.now.where(kind.equals(EXACT), 0.0).where(drawn > 0, 1.0)
    return bound.minimum(1.0)


def _bound_of_counts(length, drawn, samples):
    """See `coverage.bound_of_fraction`, for counts in faces of a perimeter, px."""
    root = length.like(samples).sqrt()
    length = length * root
    deviation = (length * 1.25 + 1.0).sqrt() * (3 * 0.27) + length / 20.0
    return (deviation / (drawn * samples)).where(drawn > 0, 1.0).minimum(1.0)


BORDER_ROUNDING = 2.0**-46
"""Greater than the error of a position in the image, relative to the numbers it is made from."""


class Seen(NamedTuple):
    """An observation, read-only; see `rastercov.Observation`.

    Areas are `visible / scale` and `drawn / scale`, px^2: counts of samples are float64 or int32.
    `kind` is (0, 0) where all figures are counted, and `area_error` where it is 0 everywhere.
    """

    poses: NDArray[np.float64]
    near: NDArray[np.float64]
    visible: NDArray[Any]
    drawn: NDArray[Any]
    scale: float
    kind: NDArray[np.uint8]
    area_error: NDArray[np.float64]
    samples_per_pixel: float


Figures = namedtuple(
    "Figures",
    "in_view in_view_fraction projected_area visible_pixels drawn_pixels resolution pixel_density "
    "facing_density in_focus visibility visibility_bound visibility_kind incidence coverage reason "
    "asked",
)
"""The (P, F) arrays of `Coverage`, in its order; (0, 0) where a figure is not asked for.

`asked` has a bit for each that is, the lowest for the first.
"""
ROWS = dict(
    zip(
        Figures._fields,
        (
            code.IN_VIEW, code.PART, code.AREA, code.VISIBLE, code.DRAWN, code.RESOLUTION,
            code.DENSITY, code.FACING, code.FOCUSED, code.VISIBILITY, code.BOUND, code.KIND,
            code.COSINE, code.COVERAGE, code.REASON,
        ),
        strict=False,
    )
)  # fmt: skip
"""Row of a block of each figure."""
ASKS_AREA, ASKS_DENSITY, ASKS_FACING, ASKS_BOUND, ASKS_KIND = (
    1 << list(ROWS).index(name)
    for name in (
        "projected_area", "pixel_density", "facing_density", "visibility_bound", "visibility_kind",
    )
)  # fmt: skip
TYPES: dict[str, type] = {
    name: np.bool_ if name in ("in_view", "in_focus") else np.float64 for name in ROWS
} | dict.fromkeys(("visibility_kind", "reason"), np.uint8)
"""Types of the arrays."""


def record(arrays: Mapping[str, NDArray[Any]]) -> Figures:
    """Record of the (P, F) arrays that are given, by their names."""
    asked = sum(1 << bit for bit, name in enumerate(ROWS) if name in arrays)
    none = np.empty((0, 0))
    whole = {name: arrays.get(name, none.astype(kind)) for name, kind in TYPES.items()}
    return Figures(**whole, asked=asked)


@part_of
def exceeds_incidence(cosine, rules):
    """True if the angle of incidence is greater than the task allows.

    The arccosine takes long, so cosines decide, except where they are equal to rounding.
    """
    if abs(cosine - rules.cos_incidence) < COSINE_ROUNDING:
        return not incidence_angle(cosine) <= rules.max_incidence
    return cosine < rules.cos_incidence


@part_with_arrays
def in_focus(points, i, j, k, lens, rules):
    """True if a face is within the depth of field, (3.12), by the rule of the task."""
    a, b = focus_depth_of(points, i, lens), focus_depth_of(points, j, lens)
    c = focus_depth_of(points, k, lens)
    if rules.focus_of_centroid:
        centre = (a + b + c) / 3
        return rules.z_n <= centre and centre <= rules.z_f
    return rules.z_n <= min(a, b, c) and max(a, b, c) <= rules.z_f


@part_with_arrays
def kind_of(seen, row, f):
    """Kind of the bound of a visible fraction."""
    return int(seen.kind[row, f]) if seen.kind.size else code.STATISTICAL


@part_with_arrays
def bound_of_fraction(seen, row, f, drawn, points, i, j, k, is_cut):
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
            samples = seen.samples_per_pixel
            length = math.inf if is_cut else perimeter(points, i, j, k) * math.sqrt(samples)
            deviation = 3 * 0.27 * math.sqrt(1.25 * length + 1) + length / 20
            bound = deviation / (drawn * samples)
        else:
            bound = 0.0
    return min(bound, 1.0)


@part_with_arrays
def cosine_of(scene, seen, points, row, f):
    """Cosine of the angle of incidence of a face in one pose."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    normal = camera_normal(scene.normals, f, seen.poses[row])
    return incidence_cosine(points, i, j, k, normal, scene.two_sided[f])


@part_with_arrays
def areas_of(seen, row, f):
    """Visible and drawn area of a face, px^2."""
    visible, drawn = float(seen.visible[row, f]), float(seen.drawn[row, f])
    if seen.scale != 1:
        visible, drawn = visible / seen.scale, drawn / seen.scale
    return visible, drawn


@part_with_arrays
def measure_face(
    lane, f, scene, lens, seen, row, rules, work, is_front, is_oblique, asks_area, asks_density,
    asks_facing,
):  # fmt: skip
    """Put the measures of a face in one pose into a lane of a block.

    A density that is not asked for is 0, an area may be any positive number in place of itself, and
    the bound is 1, see `put_bound`. A face is seen, by definition, not from behind or outside the
    image.
    """
    points, block, near = work.points, work.block, seen.near[row]
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    visible, drawn = areas_of(seen, row, f)
    # A count is no area.
    known = drawn if seen.kind.size or not asks_area else -1.0
    state, part, area = image_of_face(points, i, j, k, near, lens, work, known)
    per_m2 = 0.0
    if rules.min_pixels_per_m2 > 0:
        normal = camera_normal(scene.normals, f, seen.poses[row])
        per_m2 = pixels_per_m2(points, i, j, k, normal, lens)
    is_seen = is_front and (part != 0 or state == INSIDE)
    side = 1.0 if is_front else 0.0
    block[code.SIDE, lane] = -1.0 if scene.degenerate[f] else side
    block[code.OBLIQUE, lane] = 1.0 if is_oblique else 0.0
    block[code.STATE_OF_FACE, lane], block[code.IN_VIEW, lane] = (
        state,
        1.0 if state == INSIDE else 0.0,
    )
    block[code.PART, lane], block[code.AREA, lane] = part, area
    block[code.VISIBLE, lane], block[code.DRAWN, lane] = visible, drawn
    block[code.DENSITY, lane] = block[code.FACING, lane] = 0.0
    if asks_density:
        block[code.DENSITY, lane] = density_of(
            scene, lens, seen, points, row, f, is_front, state, part
        )
    if asks_facing:
        block[code.FACING, lane] = facing_density(points, i, j, k, lens)
    block[code.PER_M2, lane] = per_m2
    block[code.FOCUSED, lane] = 1.0 if in_focus(points, i, j, k, lens, rules) else 0.0
    block[code.BOUND, lane], block[code.KIND, lane] = (
        1.0,
        kind_of(seen, row, f) if is_seen else code.EXACT,
    )


@part_with_arrays
def put_bound(lane, f, scene, lens, seen, row, work, cosine):
    """Put the bound of the visible fraction of a measured face, and its kind, into its lane."""
    block = work.block
    state, part, drawn = (
        block[code.STATE_OF_FACE, lane],
        block[code.PART, lane],
        block[code.DRAWN, lane],
    )
    is_seen = block[code.SIDE, lane] > 0 and (part != 0 or state == INSIDE)
    block[code.BOUND, lane], block[code.KIND, lane] = bound_and_kind(
        scene, lens, seen, work.points, row, f, drawn, cosine, state, part, is_seen, work
    )


@part_with_arrays
def density_of(scene, lens, seen, points, row, f, is_front, state, part):
    """Pixel density of a face, px/m; 0 unless it is seen and wholly beyond the near plane."""
    if not is_front or state == BEHIND or not part > 0:
        return 0.0
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    return pixel_density(points, i, j, k, camera_normal(scene.normals, f, seen.poses[row]), lens)


@part_with_arrays
def is_edge_on(scene, points, f, cosine, state):
    """True if rounding may decide which side of a face the camera sees."""
    if scene.degenerate[f]:
        return True
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    size = abs(points[i, X]) + abs(points[i, Y]) + abs(points[i, Z])
    size += abs(points[j, X]) + abs(points[j, Y]) + abs(points[j, Z])
    size += abs(points[k, X]) + abs(points[k, Y]) + abs(points[k, Z])
    x = points[i, X] + points[j, X] + points[k, X]
    y = points[i, Y] + points[j, Y] + points[k, Y]
    z = points[i, Z] + points[j, Z] + points[k, Z]
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
def is_in_doubt(scene, lens, seen, points, row, f, drawn, cosine, state, part, work):
    """True if rounding may decide whether a face is seen from the front and in the image."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    has_part = part != 0 or state == INSIDE
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


@part_with_arrays
def bound_and_kind(scene, lens, seen, points, row, f, drawn, cosine, state, part, is_seen, work):
    """Bound of the visible fraction of a face, and its kind: 1 where rounding decides its side."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    bound, kind = 0.0, code.EXACT
    if is_seen:
        bound = bound_of_fraction(seen, row, f, drawn, points, i, j, k, state == BEHIND)
        kind = kind_of(seen, row, f)
    if is_in_doubt(scene, lens, seen, points, row, f, drawn, cosine, state, part, work):
        bound = 1.0
    return bound, kind


@allocation_free
def replace_by_angles(cosines):
    """Put angles of incidence in place of their cosines, (P, F): a loop that is vectorised."""
    for row in range(cosines.shape[0]):
        for f in range(cosines.shape[1]):
            cosines[row, f] = incidence_angle(cosines[row, f])


@allocation_free
def judge_poses(rows, scene, lens, seen, work, rules, out, skew):
    """Fill rows of `out` with the figures of poses `rows[0]` to `rows[1] - 1`.

    A `coverage.task.Rules` holds the thresholds. What is not asked for is not computed, unless
    the coverage depends on it. `incidence` becomes the cosine, see `replace_by_angles`.

    Blocks begin at cache lines: `skew` float64 lie between one and the arrays of float64 of `out`.
    """
    asks_area = out.asked & ASKS_AREA > 0
    asks_density = out.asked & ASKS_DENSITY > 0 or rules.min_pixel_density > 0
    asks_facing = out.asked & ASKS_FACING > 0 or rules.min_facing_density > 0
    asks_bound = out.asked & (ASKS_BOUND | ASKS_KIND) > 0
    n_faces, block = scene.faces.shape[0], work.block
    for row in range(rows[0], rows[1]):
        project(scene.vertices, seen.poses[row], seen.near[row], lens, work.points)
        first = 0
        while first < n_faces:
            at = row * n_faces + first
            n = min(AT_A_TIME - (skew + at) % AT_A_TIME, n_faces - first)
            if n == AT_A_TIME and judge_eight(
                first, scene, lens, seen, row, rules, work, asks_density, asks_facing, asks_bound
            ):
                copy_block(pointer(block), AT_A_TIME, at, pointers(out))
            else:
                for lane in range(n):
                    f = first + lane
                    cosine = cosine_of(scene, seen, work.points, row, f)
                    measure_face(
                        lane, f, scene, lens, seen, row, rules, work,
                        cosine > 0 and not scene.degenerate[f], exceeds_incidence(cosine, rules),
                        asks_area, asks_density, asks_facing,
                    )  # fmt: skip
                    block[code.COSINE, lane] = cosine
                    if asks_bound:
                        put_bound(lane, f, scene, lens, seen, row, work, cosine)
                decide_block(rules, pointer(block))
                copy_block(pointer(block), n, at, pointers(out))
            first += n
