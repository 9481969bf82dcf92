"""Decision about a face, eight at a time by SIMD, and about a point; by numba.

A face is covered by (3.6) and our criteria beside it, from its measures, which
`rastercov.kernels.coverage` and `coverage` put into a block. A point of the surface is covered
by those of docs/area.md. Both go by the `Rules` of a task, and give a `Reason`.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import math

from numba.core import types

from rastercov.kernels.cameras import along, facing, focus_depth, jacobian, per_m2, place
from rastercov.kernels.criteria import turned
from rastercov.kernels.jit import part_with_arrays
from rastercov.kernels.simd import load
from rastercov.kernels.simd_kernel import simd

AT_A_TIME = 8
"""Faces of a block: doubles of the longest registers."""
BLOCK_ROWS = 19
"""Measures of a face in a block."""
(
    IN_VIEW, PART, AREA, VISIBLE, DRAWN, RESOLUTION, DENSITY, FACING, FOCUSED, VISIBILITY, BOUND,
    KIND, COSINE, COVERAGE, REASON, PER_M2, SIDE, OBLIQUE, STATE_OF_FACE,
) = range(BLOCK_ROWS)  # fmt: skip
"""Rows of a block: first the figures of `rastercov.Coverage` in order, with the cosine of the angle
of incidence, True and False and codes as 1, 0 and themselves; pixels a m^2; 1 for a face that is
seen from the front, 0 from behind, -1 for one without area; 1 where the angle of incidence is too
large; and the state of all vertices. What is not asked for is 0."""
LARGEST_RESOLUTION = 1e300
"""Of one face; a smaller R_min gives no more."""
STATISTICAL, CERTIFIED, EXACT = 0, 1, 2
"""Values of `rastercov.BoundKind`."""
DEGENERATE, BACK_FACING, OUTSIDE, OUT_OF_FOCUS = 0, 1, 2, 3
UNSAMPLED, TOO_COARSE, OCCLUDED, TOO_OBLIQUE, COVERED = 4, 5, 6, 7, 8
"""Values of `rastercov.Reason`."""


@simd(returns=types.void)
def decide_block(rules, block):
    """Complete a block of faces that were measured one by one."""
    side, has_part = row_of(block, SIDE), ~row_of(block, PART).equals(0.0)
    is_inside, is_focused = row_of(block, IN_VIEW) > 0, row_of(block, FOCUSED) > 0
    densities = row_of(block, DENSITY), row_of(block, FACING), row_of(block, PER_M2)
    for row, values in decide(
        rules, side < 0, side > 0, is_inside, is_inside | has_part, is_focused,
        row_of(block, VISIBLE), row_of(block, DRAWN), densities, row_of(block, OBLIQUE) > 0,
    ):  # fmt: skip
        put_row(block, row, values)


def decide(
    rules, is_degenerate, is_front, is_inside, has_part, is_focused, visible, drawn, densities,
    exceeds_angle,
):  # fmt: skip
    """Visible fraction, resolution, coverage (3.6) and `Reason` of faces, each after its row.

    One factor at a time: the reason is the first that brings the product below the threshold.
    """
    visibility = (visible / drawn).where(is_front & has_part & (drawn > 0), 0.0)
    resolution = (drawn / rules.min_pixels).minimum(LARGEST_RESOLUTION)
    product = resolution.minimum(1.0).where(rules.cap_resolution.broadcast(AT_A_TIME), resolution)
    limits = rules.min_pixel_density, rules.min_facing_density, rules.min_pixels_per_m2
    for density, least in zip(densities, limits, strict=True):
        product = product.where((density >= least) | ~(least > 0), 0.0)
    is_coarse = (product < rules.min_coverage) | product.equals(0.0)
    product = product * visibility.where(visibility >= rules.min_visibility, 0.0)
    is_hidden = (product < rules.min_coverage) | product.equals(0.0)
    is_oblique = exceeds_angle & ~product.equals(0.0)
    is_sampled = is_front & is_inside & is_focused & (drawn > 0)
    product = product.where(is_sampled & ~is_oblique, 0.0)
    reason = product.like(COVERED)
    for fails, value in (
        (is_oblique, TOO_OBLIQUE), (is_hidden, OCCLUDED), (is_coarse, TOO_COARSE),
        (~(drawn > 0), UNSAMPLED), (~is_focused, OUT_OF_FOCUS), (~is_inside, OUTSIDE),
        (~is_front, BACK_FACING), (is_degenerate, DEGENERATE),
    ):  # fmt: skip
        reason = reason.like(value).where(fails, reason)
    return (
        (VISIBILITY, visibility), (RESOLUTION, resolution), (COVERAGE, product), (REASON, reason),
    )  # fmt: skip


def row_of(block, row):
    """Values of a row of a block."""
    return load(block.builder, block.at(row * AT_A_TIME).pointer, AT_A_TIME)


def put_row(block, row, value):
    """Store the values of a row of a block."""
    value.store(block.at(row * AT_A_TIME).pointer)


@part_with_arrays
def judge_point(lens, rules, rotation, near, x, y, z, normals, i, is_two_sided):
    """First criterion but occlusion that a point fails, as its `Reason`, and its depth.

    (x, y, z) is the way from the camera in the axes of the world; `rules` and `near` are in its
    unit of length.
    """
    height = -(x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2])
    if is_two_sided:
        height = abs(height)
    if not height > 0.0:
        return BACK_FACING, 0.0
    X, Y, Z = turned((x, y, z), rotation)
    depth, is_inside = place(lens, near, X, Y, Z)
    if not is_inside:
        return OUTSIDE, depth
    if not rules.z_n <= focus_depth(lens, X, Y, Z) <= rules.z_f:
        return OUT_OF_FOCUS, depth
    if max(rules.min_pixels_per_m2, rules.min_pixel_density, rules.min_facing_density) > 0.0:
        a, b, c = turned(normals[i], rotation)
        slopes = jacobian(lens, X, Y, Z)
        if not (
            per_m2(slopes, a, b, c) >= rules.min_pixels_per_m2
            and facing(slopes) >= rules.min_facing_density
            and along(slopes, a, b, c) >= rules.min_pixel_density
        ):
            return TOO_COARSE, depth
    if height < math.sqrt(x * x + y * y + z * z) * rules.cos_incidence:
        return TOO_OBLIQUE, depth
    return COVERED, depth
