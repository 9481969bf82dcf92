"""Coverage (3.6) of each face in some poses, compiled by numba.

`judge_poses` takes what an observer measured and gives every figure of `rastercov.Coverage`. Its
twin is in `rastercov.reference.coverage`.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

from collections import namedtuple
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numpy.typing import NDArray

from rastercov.kernels import decision as code
from rastercov.kernels.cameras import INSIDE
from rastercov.kernels.criteria import (
    densities,
    focus_depth_of,
    image_of_face,
    incidence_angle,
    incidence_cosine,
    project,
    turned,
)
from rastercov.kernels.decision import AT_A_TIME, decide_block, row_of
from rastercov.kernels.face_blocks import COSINE_ROUNDING, judge_eight
from rastercov.kernels.face_bounds import kind_of, put_bound
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays
from rastercov.kernels.simd_kernel import loop, pointer, pointers, simd, when


@simd(returns=types.void)
def copy_block(block, n, at, out):
    """Put the figures of n faces where they are asked for, into flat arrays from `at` on.

    Arrays are pointers to their data.
    """
    for name, row in ROWS.items():
        array = getattr(out, name)
        with when((out.asked >> row & 1) > 0):
            with when(n.equals(AT_A_TIME)):
                row_of(block, row).to(array.kind).store(array.at(at).pointer)
            with when(n < AT_A_TIME), loop(n & 0, n, 1) as k:
                array.put(at + k, block.value(k + row * AT_A_TIME))


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

`asked` has a bit for each that is, see `ROWS`.
"""


ROWS = {name: row for row, name in enumerate(Figures._fields[:-1])}
"""Row of a block of each figure."""


TYPES: dict[str, type] = {
    name: np.bool_ if name in ("in_view", "in_focus") else np.float64 for name in ROWS
} | dict.fromkeys(("visibility_kind", "reason"), np.uint8)
"""Types of the arrays."""


def record(arrays: Mapping[str, NDArray[Any]]) -> Figures:
    """Record of the (P, F) arrays that are given, by their names."""
    asked = sum(1 << ROWS[name] for name in arrays)
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
def measure_face(
    lane, f, scene, lens, seen, row, rules, work, asks_area, asks_density, asks_facing
):
    """Put the measures of a face in one pose into a lane of a block.

    A density that is not asked for is 0, an area may be any positive number in place of itself, and
    the bound is 1, see `put_bound`. A face is seen, by definition, not from behind or outside the
    image.
    """
    points, block, near = work.points, work.block, seen.near[row]
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    visible, drawn = seen.visible[row, f] / seen.scale, seen.drawn[row, f] / seen.scale
    # A count is no area.
    known = drawn if seen.kind.size or not asks_area else -1.0
    state, part, area = image_of_face(points, i, j, k, near, lens, work, known)
    normal = turned(scene.normals[f], seen.poses[row])
    cosine = incidence_cosine(points, i, j, k, normal, scene.two_sided[f])
    is_front = cosine > 0 and not scene.degenerate[f]
    asks_density = asks_density and is_front and part > 0
    density, facing, per_m2 = densities(
        points, i, j, k, normal, lens, asks_density, asks_facing, rules.min_pixels_per_m2 > 0
    )
    is_seen = is_front and (part != 0 or state == INSIDE)
    side = 1.0 if is_front else 0.0
    block[code.SIDE, lane] = -1.0 if scene.degenerate[f] else side
    block[code.COSINE, lane] = cosine
    block[code.OBLIQUE, lane] = 1.0 if exceeds_incidence(cosine, rules) else 0.0
    block[code.STATE_OF_FACE, lane] = state
    block[code.IN_VIEW, lane] = 1.0 if state == INSIDE else 0.0
    block[code.PART, lane], block[code.AREA, lane] = part, area
    block[code.VISIBLE, lane], block[code.DRAWN, lane] = visible, drawn
    block[code.DENSITY, lane], block[code.FACING, lane] = density, facing
    block[code.PER_M2, lane] = per_m2
    block[code.FOCUSED, lane] = 1.0 if in_focus(points, i, j, k, lens, rules) else 0.0
    block[code.BOUND, lane] = 1.0
    block[code.KIND, lane] = kind_of(seen, row, f) if is_seen else code.EXACT


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
    asks_area = out.asked & 1 << code.AREA > 0
    asks_density = out.asked & 1 << code.DENSITY > 0 or rules.min_pixel_density > 0
    asks_facing = out.asked & 1 << code.FACING > 0 or rules.min_facing_density > 0
    asks_bound = out.asked & (1 << code.BOUND | 1 << code.KIND) > 0
    n_faces, block, figures = scene.faces.shape[0], work.block, pointers(out)
    for row in range(rows[0], rows[1]):
        project(scene.vertices, seen.poses[row], seen.near[row], lens, work.points)
        first = 0
        while first < n_faces:
            at = row * n_faces + first
            n = min(AT_A_TIME - (skew + at) % AT_A_TIME, n_faces - first)
            if n == AT_A_TIME and judge_eight(
                first, scene, lens, seen, row, rules, work, asks_density, asks_facing, asks_bound
            ):
                copy_block(pointer(block), AT_A_TIME, at, figures)
            else:
                for lane in range(n):
                    f = first + lane
                    measure_face(
                        lane, f, scene, lens, seen, row, rules, work, asks_area, asks_density,
                        asks_facing,
                    )  # fmt: skip
                    if asks_bound:
                        put_bound(lane, f, scene, lens, seen, row, work)
                decide_block(rules, pointer(block))
                copy_block(pointer(block), n, at, figures)
            first += n
