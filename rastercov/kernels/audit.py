"""Compiled loops of an audit: best density and widest angle over pairs of camera and element.

Pairs come by element in compressed rows, as `placement_presolve.by_face` gives them.
"""

import math

from rastercov.kernels.cameras import along, by_lens, jacobian
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens import is_valid


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
    right = a * pose[0, 0] + b * pose[1, 0] + c * pose[2, 0]
    down = a * pose[0, 1] + b * pose[1, 1] + c * pose[2, 1]
    depth = a * pose[0, 2] + b * pose[1, 2] + c * pose[2, 2]
    if not is_ahead(lens, right, down, depth):
        return 0.0
    nx = normal[0] * pose[0, 0] + normal[1] * pose[1, 0] + normal[2] * pose[2, 0]
    ny = normal[0] * pose[0, 1] + normal[1] * pose[1, 1] + normal[2] * pose[2, 1]
    nz = normal[0] * pose[0, 2] + normal[1] * pose[1, 2] + normal[2] * pose[2, 2]
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
