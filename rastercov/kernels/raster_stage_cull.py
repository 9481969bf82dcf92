"""Stages 1 and 3 of the CPU rasteriser: culling of clusters and of faces.

L. Shirman and S. Abi-Ezzi. The Cone of Normals Technique for Fast Processing of Curved
Patches. 1993.
"""

from numba.core import types

from rastercov.kernels.raster_memory import (
    ALTITUDE,
    BEHIND,
    CENTRE,
    CONE_AXIS,
    CONE_COS,
    CONE_SIN,
    EYE,
    FORWARD,
    FRUSTUM_PLANES,
    GUARD_BAND,
    LANES,
    LARGE,
    MAGNIFICATION,
    NEAR,
    NORMAL_LENGTH,
    PLANE,
    PLANE_OFFSET,
    RADIUS,
    STEP_BITS,
    STEPS,
)
from rastercov.kernels.raster_stage_setup import corners_of, edge_functions, sample_bounds, signs
from rastercov.kernels.simd import WORD, pack
from rastercov.kernels.simd_kernel import Variable, simd, when


@simd(returns=types.int64)
def cull_clusters(bounds, stride, first, camera, frustum, magnification, hides_backs, centres):
    """Bits of a vector of clusters that may have to be drawn; above them, of those that are safe.

    Safe clusters lie wholly beyond the near plane and within the guard band. The down and forward
    coordinates of the centres go to the two rows of `centres`.

    A cluster is outside where its sphere is beyond a plane of the frustum. It is back-facing, also
    after rounding to steps, where the planes of its faces are far enough from the camera: with D
    the greatest distance of the cluster and h that of the camera behind the plane of a face, the
    altitudes of the face in the image are at least magnification h / D^2 of those in space.
    Rounding moves a corner by at most 0.71 steps, so it turns no face whose altitudes are 3 steps
    or more. Faces that are clipped are rounded again, so their clusters are kept.

    For `bounds` (11, stride) see `Clusters.bounds`, for `camera` and `frustum` `CAMERA_VALUES` and
    `FRUSTUM_PLANES`. `magnification` is the least one of a length parallel to the image over its
    depth, in samples; `hides_backs` has the bits of lanes in which back-facing clusters are culled.
    """

    def row(k):
        return bounds.at(stride * k + first)[0]

    eye = [row(CENTRE + k) - camera.value(EYE + k) for k in range(3)]
    radius, near = row(RADIUS), camera.value(NEAR)
    is_outside = radius < 0
    for k in range(FRUSTUM_PLANES):
        plane = [frustum.value(PLANE * k + n) for n in range(PLANE)]
        distance = eye[0] * plane[0] + eye[1] * plane[1] + eye[2] * plane[2]
        limit = near if k == FORWARD else 0
        is_outside = is_outside | (distance + radius * plane[NORMAL_LENGTH] < limit)
    forward = distance  # the last plane is across the camera axis
    nearest = forward - radius
    down = eye[0] * camera.value(1) + eye[1] * camera.value(4) + eye[2] * camera.value(7)
    centres.at(first)[0], centres.at(stride + first)[0] = down, forward
    squared = eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2]
    along = eye[0] * row(CONE_AXIS) + eye[1] * row(CONE_AXIS + 1) + eye[2] * row(CONE_AXIS + 2)
    across = (squared - along * along).maximum(0).sqrt()
    distance = squared.sqrt()
    # The greatest n . d over the normals n of the cone, d to the camera: |d| where d is in it.
    is_in_cone = -along >= distance * row(CONE_COS)
    highest = distance.where(is_in_cone, across * row(CONE_SIN) - along * row(CONE_COS))
    height = highest - row(PLANE_OFFSET)
    reach = distance + radius
    is_back = height * row(ALTITUDE) * (magnification * STEPS) < reach * reach * -3.1
    is_safe = nearest >= near
    guard_band = nearest * (GUARD_BAND >> STEP_BITS >> 1)
    is_safe = is_safe & (reach * camera.value(MAGNIFICATION) <= guard_band)
    return pack(~(is_outside | (is_back & is_safe & hides_backs.as_mask(LANES))), is_safe)


@simd(returns=types.int64)
def clusters_in_band(bounds, stride, first, centres, fy, up, up_length, down, down_length):
    """Bits of a vector of clusters that may reach into a band of the image, see `cull_clusters`.

    `up` and `down` are samples from the principal point to the upper and to the lower rim of the
    band, `up_length` and `down_length` the lengths of the normals of the planes through the rims.
    """
    radius = bounds.at(stride * RADIUS + first)[0]
    below, forward = centres.at(first)[0] * fy, centres.at(stride + first)[0]
    is_below_rim = below + up * forward + radius * up_length >= 0
    is_above_rim = down * forward - below + radius * down_length >= 0
    return (is_below_rim & is_above_rim).bits()


@simd(returns=types.UniTuple(types.int64, 2))
def bin_faces(faces, at, window, is_plain):
    """Bins of the vector of faces from slot `at` on: masks of 4 bins, and of 2 for hidden faces.

    They are: covers a sample of at most 2 x 2; may cover a larger range; wide, for 64 bits;
    needs clipping. Hidden faces, which turn their back where that hides them, fall into the first
    two kinds. Wide faces and those that need clipping are not tested further. The masks of 2 x 2
    samples go to `faces.coverage_2x2`. With `is_plain` not 0, no face is wide or needs clipping.
    """
    packed = faces.mesh.corners.at(faces.first_slot + at)[0]
    _, places = corners_of(packed, faces.vertices, WORD)
    first_x, last_x, first_y, last_y, width, height = sample_bounds(places, window)
    (ax, ay), (bx, by), (cx, cy) = places
    columns, rows = last_x - first_x, last_y - first_y
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    edges = edge_functions(places, area, first_x, first_y)
    missed = columns.like(0)
    for k in reversed(range(4)):
        i, j = k & 1, k >> 1
        values = [value + dx * i + dy * j for value, dx, dy in edges]
        missed = missed.append_sign(signs(values) | (columns - i) | (rows - j))
    covered = missed.like(0xF) - missed
    faces.coverage_2x2.at(at)[0] = covered
    is_2x2, can_cover = columns.maximum(rows) <= 1, (columns | rows) >= 0
    samples_2x2, larger = (is_2x2 & (covered > 0)).bits(), (can_cover & ~is_2x2).bits()
    wide, clipped, others = (Variable(samples_2x2.like(0)) for _ in range(3))
    with when(is_plain.equals(0), likely=False):
        low, high = ax.minimum(bx).minimum(cx), ax.maximum(bx).maximum(cx)
        needs_clipping = (high >= BEHIND) & (packed > 0)
        is_behind = low.equals(BEHIND) & high.equals(BEHIND)
        is_wide = (width.maximum(height) >= LARGE) & can_cover & ~needs_clipping
        wide.now, clipped.now = is_wide.bits(), (needs_clipping & ~is_behind).bits()
        others.now = (is_wide | needs_clipping).bits()
    front, back = (area < 0).bits(), (area > 0).bits()
    hides_back, rest = window.hides_back > 0, ~others.now
    shown = front.where(hides_back, front | back) & rest
    hidden = (back & rest).where(hides_back, 0)
    shown, hidden = ((samples_2x2 & side) | ((larger & side) << LANES) for side in (shown, hidden))
    return shown | (wide.now << 2 * LANES) | (clipped.now << 3 * LANES), hidden
