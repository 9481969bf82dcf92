"""Angle at a face between the rays to cameras: the one decision on whether two rays differ by it.

For selection, networks and the objective of pose optimisation; and for an audit, the widest angle
of each element, and the best density. Arguments of one name are the same
in all functions:

eyes, centroids : (K, 3), (F, 3) float64
    Camera centres and centroids of the faces, metres.
min_cosine : float
    Largest cosine of two rays that differ by the angle; above 1 where any two do.
starts, camera : (E + 1,) int64, (N,) int32
    Cameras of each element in compressed rows, as `placement_presolve.by_face` gives them.
"""

import math

import numpy as np

from rastercov.kernels.cameras import along, by_lens, jacobian
from rastercov.kernels.criteria import turned
from rastercov.kernels.jit import allocation_free, compiled, part_with_arrays
from rastercov.kernels.lens import is_valid

HALF_TOLERANCE = 1e-9
"""Cosine; greater than the error of half an angle."""


@part_with_arrays
def products(eyes, a, b, centroids, f):
    """Product of the rays from a face to two cameras, and of their lengths."""
    ax, bx = eyes[a, 0] - centroids[f, 0], eyes[b, 0] - centroids[f, 0]
    ay, by = eyes[a, 1] - centroids[f, 1], eyes[b, 1] - centroids[f, 1]
    az, bz = eyes[a, 2] - centroids[f, 2], eyes[b, 2] - centroids[f, 2]
    lengths = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    return ax * bx + ay * by + az * bz, lengths


@part_with_arrays
def rays_differ(eyes, a, b, centroids, f, min_cosine):
    """True where the rays from a face to two cameras differ by the angle; without length none."""
    product, lengths = products(eyes, a, b, centroids, f)
    return lengths > 0 and product <= min_cosine * lengths


@part_with_arrays
def differs_from_any(c, cameras, n, eyes, centroids, f, min_cosine):
    """True where the ray to camera c differs from that to one of the first n of some cameras."""
    i = 0
    while i < n and not rays_differ(eyes, c, cameras[i], centroids, f, min_cosine):
        i += 1
    return i < n


@part_with_arrays
def any_differ(cameras, first, last, eyes, centroids, f, min_cosine):
    """True where the rays to two of `cameras[first:last]` differ."""
    for i in range(first, last):
        for j in range(i + 1, last):
            if rays_differ(eyes, cameras[i], cameras[j], centroids, f, min_cosine):
                return True
    return False


@part_with_arrays
def half_angle(min_cosine):
    """Cosine of half the angle: rays nearer than that to one ray cannot differ by the angle."""
    return math.cos(math.acos(min(max(min_cosine, -1.0), 1.0)) / 2) + HALF_TOLERANCE


@part_with_arrays
def are_near(eyes, a, b, centroids, f, half):
    """True where the rays from a face to two cameras have a cosine above `half`."""
    product, lengths = products(eyes, a, b, centroids, f)
    return product > half * lengths


@compiled
def add_rays(
    c, faces, eyes, centroids, min_cosine, first, is_near, last, before, camera, n_seen, is_spread
):  # fmt: skip
    """Add a camera to the lists of the faces it covers; number of pairs of camera and face.

    Parameters
    ----------
    c : int
        Row of the camera in `eyes`.
    faces : (N,) int32
        Faces that it covers, none twice.
    first, is_near : (F,) int64, (F,) bool
        In and out: first camera that sees each face, -1 for none; True where the rays to all others
        lie within half the angle of that to the first, so that no two differ by the angle.
    last : (F,) int64
        In and out: the pair of the last camera that sees each face, -1 for none.
    before, camera : (M,) int64
        In and out: of each pair, the pair before it of the same face, and its camera; room for N
        more.
    n_seen : int
        Pairs so far.
    is_spread : (F,) bool
        In and out: True where the rays to two cameras of a face differ by the angle.
    """
    half = half_angle(min_cosine)
    for f in faces:
        if is_spread[f]:
            continue
        if first[f] < 0:
            first[f] = c
        elif not are_near(eyes, c, first[f], centroids, f, half):
            is_near[f] = False
        pair = last[f] if not is_near[f] else -1
        while pair >= 0:
            if rays_differ(eyes, c, camera[pair], centroids, f, min_cosine):
                is_spread[f] = True
                break
            pair = before[pair]
        before[n_seen], camera[n_seen] = last[f], c
        last[f] = n_seen
        n_seen += 1
    return n_seen


@compiled
def cameras_until_covered(covers, eyes, centroids, need, min_cosine, counts):
    """Count the first cameras that together cover each face.

    Parameters
    ----------
    covers : (K, F) bool
        Faces that each camera covers.
    need : (F,) int64
        Cameras that must cover a face, 1 or more.
    counts : (F,) int64
        Out: the least n for which the first n cameras cover the face; K + 1 for none.
    """
    n_cameras = covers.shape[0]
    seen = np.empty(n_cameras, np.int64)
    half = half_angle(min_cosine)
    for f in range(covers.shape[1]):
        counts[f] = n_cameras + 1
        n, is_spread, is_near = 0, min_cosine > 1, True
        for c in range(n_cameras):
            if not covers[c, f]:
                continue
            if not is_spread:
                is_near &= n == 0 or are_near(eyes, c, seen[0], centroids, f, half)
                if not is_near:
                    is_spread = differs_from_any(c, seen, n, eyes, centroids, f, min_cosine)
                seen[n] = c
            n += 1
            if is_spread and n >= need[f]:
                counts[f] = c + 1
                break


@compiled
def worth_added(
    rest, starts, items, width, eyes, n_rest, is_spread, weights, centroids, need, min_cosine, added
):  # fmt: skip
    """Weight that each of M candidates, cameras or rigs of them, adds to what some others cover.

    Parameters
    ----------
    rest : (K, F) bool
        Faces that each of the others covers.
    starts, items : (M width + 1,) int64, (N,) int32
        Faces of each camera, ascending: items[starts[c]] ... items[starts[c + 1] - 1].
    width : int
        Cameras of each candidate, which follow one another and may be without faces.
    eyes : (K + M width, 3) float64
    n_rest, is_spread : (F,) int64, (F,) bool
        Number of the others that cover each face, and whether the rays to two of them differ.
    weights, need : (F,) int64
        Weight of each face, and cameras that must cover it.
    added : (M,) int64
        Out: weight of the faces that are covered with the candidate and not without.
    """
    n_others = rest.shape[0]
    seen = np.empty(n_others + width, np.int64)
    times = np.ones(rest.shape[1], np.int64)
    for m in range(len(added)):
        total, cameras = 0, range(m * width, (m + 1) * width)
        if width > 1:
            for at in range(starts[m * width], starts[(m + 1) * width]):
                times[items[at]] = 0
            for at in range(starts[m * width], starts[(m + 1) * width]):
                times[items[at]] += 1
        for camera in cameras:
            for at in range(starts[camera], starts[camera + 1]):
                f = items[at]
                n_more = times[f]
                if width > 1:
                    times[f] = 0
                if n_more == 0:
                    continue  # judged with an earlier camera
                is_covered = is_spread[f] and n_rest[f] >= need[f]
                if is_covered or n_rest[f] + n_more < need[f]:
                    continue
                is_enough, n = is_spread[f], 0
                if not is_enough:
                    for c in range(n_others):
                        if rest[c, f]:
                            seen[n] = c
                            n += 1
                    for c in range(camera, (m + 1) * width):
                        here = np.searchsorted(items[starts[c] : starts[c + 1]], f) + starts[c]
                        if here < starts[c + 1] and items[here] == f:
                            seen[n] = n_others + c
                            if differs_from_any(seen[n], seen, n, eyes, centroids, f, min_cosine):
                                is_enough = True
                                break
                            n += 1
                if is_enough:
                    total += weights[f]
        added[m] = total


def is_ahead_of_lens(lens, x, y, z):
    """The same for a lens that is no pinhole: True in its valid region."""
    return is_valid(lens.params, x, y, z)


@by_lens(is_ahead_of_lens)
def is_ahead(lens, x, y, z):
    """True for a point in camera axes that a camera has in front of it."""
    return z > 0


@part_with_arrays
def density_at(x, y, z, pose, normal, lens):
    """Pixels a metre along the worst direction of a surface at a point; 0 where it has no image."""
    a, b, c = x - pose[0, 3], y - pose[1, 3], z - pose[2, 3]
    right, down, depth = turned((a, b, c), pose)
    if not is_ahead(lens, right, down, depth):
        return 0.0
    nx, ny, nz = turned(normal, pose)
    return along(jacobian(lens, right, down, depth), nx, ny, nz)


@allocation_free
def best_densities(starts, camera, points, normals, poses, lens_of_pose, index, lens, best, by):
    """Take in the cameras with one lens: the greatest density of each element, and its camera.

    Parameters
    ----------
    starts, camera : (E + 1,) int64, (N,) int32
        Cameras that cover each element, in ascending order.
    points, normals : (E, 3) float64
        Where the density is taken.
    poses : (P, 4, 4) float64
    lens_of_pose : (P,) int32
        Poses whose value is `index` are taken in; `lens` is theirs.
    best, by : (E,) float64, (E,) int32
        In and out; the first of equals.
    """
    for e in range(starts.shape[0] - 1):
        for at in range(starts[e], starts[e + 1]):
            c = camera[at]
            if lens_of_pose[c] == index:
                density = density_at(
                    points[e, 0], points[e, 1], points[e, 2], poses[c], normals[e], lens
                )
                if density > best[e] or (density == best[e] and c < by[e]):
                    best[e], by[e] = density, c


@allocation_free
def widest_angles(starts, camera, points, eyes, widest):
    """Greatest angle between the rays from each element to two of its cameras, radians.

    The angle is atan2(|a x b|, a . b), which is accurate at 0 and at pi. Out: `widest`, (E,).
    """
    for e in range(starts.shape[0] - 1):
        widest[e] = 0.0
        for first in range(starts[e], starts[e + 1]):
            p = camera[first]
            ax, ay = eyes[p, 0] - points[e, 0], eyes[p, 1] - points[e, 1]
            az = eyes[p, 2] - points[e, 2]
            for second in range(first + 1, starts[e + 1]):
                q = camera[second]
                bx, by = eyes[q, 0] - points[e, 0], eyes[q, 1] - points[e, 1]
                bz = eyes[q, 2] - points[e, 2]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                across = math.sqrt(x * x + y * y + z * z)
                angle = math.atan2(across, ax * bx + ay * by + az * bz)
                widest[e] = max(widest[e], angle)
