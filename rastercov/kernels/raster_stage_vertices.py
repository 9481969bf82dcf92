"""Stage 2 of the CPU rasteriser: projection of vertices to fixed-point image positions."""

from numba.core import types

from rastercov.kernels.raster_memory import (
    BEHIND,
    CAMERA_VALUES,
    EYE,
    GUARD_BAND,
    INTRINSICS,
    LANES,
    NEAR,
    NEEDS_CLIPPING,
    STEPS,
)
from rastercov.kernels.simd import WORD
from rastercov.kernels.simd_kernel import Variable, loop, simd, when


@simd(returns=types.UniTuple(types.int32, 4))
def project_vertices(mesh, cluster, camera, vertices):
    """Project the vertices of a cluster; returns least and greatest x, least and greatest y.

    `mesh.points` has x of all vertices of the cluster, then y, then z; for `camera` see
    `CAMERA_VALUES`. Entries of `vertices` behind those of the cluster are undefined.
    """
    values = [camera.value(k).broadcast(LANES) for k in range(CAMERA_VALUES)]
    for k in range(INTRINSICS, NEAR):
        values[k] = values[k] * STEPS
    tests_clipping = cluster.is_safe.equals(0)
    n = cluster.end_vertex - cluster.first_vertex
    lane = n.broadcast(LANES).like(range(LANES))
    limits = [Variable(lane.to(WORD).like(k)) for k in (NEEDS_CLIPPING, -NEEDS_CLIPPING) * 2]
    with loop(n.like(0), n, LANES) as first:
        starts = [cluster.first_vertex * 3 + n * axis + first for axis in range(3)]
        point = [mesh.points.at(start)[0] - values[EYE + k] for k, start in enumerate(starts)]
        steps = _project(point, values, tests_clipping, vertices, first)
        is_vertex = lane < n - first
        for k, limit in enumerate(limits):
            extreme = steps[k >> 1]
            extreme = extreme.maximum(limit.now) if k & 1 else extreme.minimum(limit.now)
            limit.now = extreme.where(is_vertex, limit.now)
    return tuple(
        limit.now.reduce("maximum" if k & 1 else "minimum") for k, limit in enumerate(limits)
    )


def _project(point, camera, tests_clipping, vertices, first):
    """Project a vector of points relative to the camera centre; returns x and y in whole steps."""
    right, down, z = (
        point[0] * camera[k] + point[1] * camera[3 + k] + point[2] * camera[6 + k] for k in range(3)
    )
    inverse = z.like(1) / z
    exact = (
        camera[INTRINSICS] * right * inverse + camera[INTRINSICS + 2],
        camera[INTRINSICS + 1] * down * inverse + camera[INTRINSICS + 3],
    )
    rounded = [(position + 0.5).floor() for position in exact]
    vertices.w.at(first)[0] = inverse
    vertices.u.at(first)[0], vertices.v.at(first)[0] = exact
    steps = [Variable(position.to(WORD)) for position in rounded]
    with when(tests_clipping, likely=False):
        is_seen = is_beyond_near = z >= camera[NEAR]
        for position in exact:
            is_seen = is_seen & (position.absolute() <= GUARD_BAND)
        unseen = steps[0].now.like(NEEDS_CLIPPING).where(is_beyond_near, BEHIND)
        for position, step in zip(rounded, steps, strict=True):
            step.now = position.where(is_seen, 0).to(WORD).where(is_seen, unseen)
    found = [step.now for step in steps]
    vertices.x.at(first)[0], vertices.y.at(first)[0] = found
    return found
