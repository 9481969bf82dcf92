"""Compiled loops of `objective`: faces that some cameras cover, by number and angle of the views.

Face by face over the cameras that cover it: the unit rays to them are kept, and a camera is
compared with the ones before it until two differ by the angle. `rastercov.reference.views` is the
twin.
"""

import math

import numpy as np

from rastercov.kernels.jit import compiled, part_with_arrays

TINY = float(np.finfo(np.float64).tiny)
ANGLE_TOLERANCE = 1e-9
"""Cosine; greater than the error of half an angle."""


@part_with_arrays
def keep_ray(eyes, c, centroids, f, rays, n):
    """Set row n of `rays`, (K, 3): the unit ray from the centroid of a face to a camera centre."""
    x = eyes[c, 0] - centroids[f, 0]
    y = eyes[c, 1] - centroids[f, 1]
    z = eyes[c, 2] - centroids[f, 2]
    length = max(math.sqrt(x * x + y * y + z * z), TINY)
    rays[n, 0], rays[n, 1], rays[n, 2] = x / length, y / length, z / length


@part_with_arrays
def differs(rays, n, min_cosine):
    """True if ray n differs from an earlier one by the angle."""
    x, y, z = rays[n, 0], rays[n, 1], rays[n, 2]
    for other in range(n):
        if x * rays[other, 0] + y * rays[other, 1] + z * rays[other, 2] <= min_cosine:
            return True
    return False


@part_with_arrays
def is_near_first(rays, n, half_cosine):
    """True if ray n is within half the angle of the first: two such rays cannot differ by it."""
    return rays[n, 0] * rays[0, 0] + rays[n, 1] * rays[0, 1] + rays[n, 2] * rays[0, 2] > half_cosine


@compiled
def cameras_until_covered(covers, eyes, centroids, need, min_cosine, counts):
    """Count the first cameras that together cover each face.

    Parameters
    ----------
    covers : (K, F) bool
        Faces that each camera covers.
    eyes, centroids : (K, 3), (F, 3) float64
        Camera centres and centroids of the faces, metres.
    need : (F,) int64
        Cameras that must cover a face, 1 or more.
    min_cosine : float
        Largest cosine of two rays that differ enough; above 1 where any two do.
    counts : (F,) int64
        Out: the least n for which the first n cameras cover the face; K + 1 for none.
    """
    n_cameras = covers.shape[0]
    rays = np.empty((n_cameras, 3))
    half_cosine = math.cos(math.acos(min(max(min_cosine, -1.0), 1.0)) / 2) + ANGLE_TOLERANCE
    for f in range(covers.shape[1]):
        counts[f] = n_cameras + 1
        n, is_spread, all_near = 0, min_cosine > 1, True
        for c in range(n_cameras):
            if not covers[c, f]:
                continue
            if not is_spread:
                keep_ray(eyes, c, centroids, f, rays, n)
                is_near = is_near_first(rays, n, half_cosine)
                if not (is_near and all_near):
                    is_spread = differs(rays, n, min_cosine)
                all_near &= is_near
            n += 1
            if is_spread and n >= need[f]:
                counts[f] = c + 1
                break


@compiled
def covered_with_one(
    rest, rest_eyes, trials, trial_eyes, centroids, need, min_cosine, covered
):  # fmt: skip
    """Faces that some cameras cover together with each of M others.

    Parameters
    ----------
    rest, trials : (K, F), (M, F) bool
        Faces that each camera covers.
    rest_eyes, trial_eyes : (K, 3), (M, 3) float64
        Camera centres, metres.
    centroids, need, min_cosine
        As for `cameras_until_covered`.
    covered : (M, F) bool
        Out: faces covered by all of `rest` with one of `trials`.
    """
    rays = np.empty((rest.shape[0] + 1, 3))
    for f in range(rest.shape[1]):
        n, is_spread = 0, min_cosine > 1
        for c in range(rest.shape[0]):
            if rest[c, f]:
                keep_ray(rest_eyes, c, centroids, f, rays, n)
                is_spread = is_spread or differs(rays, n, min_cosine)
                n += 1
        for m in range(trials.shape[0]):
            covered[m, f] = is_spread and n >= need[f]
            if trials[m, f] and not covered[m, f] and n + 1 >= need[f]:
                if is_spread:
                    covered[m, f] = True
                else:
                    keep_ray(trial_eyes, m, centroids, f, rays, n)
                    covered[m, f] = differs(rays, n, min_cosine)


@compiled
def worth_added(
    rest, rest_eyes, starts, items, trial_eyes, n_rest, is_covered, weights, centroids, need,
    min_cosine, added,
):  # fmt: skip
    """Weight that each of M cameras adds to what some others cover.

    Parameters
    ----------
    rest, rest_eyes
        As for `covered_with_one`.
    starts, items : (M + 1,) int64, (N,) int32
        Faces of camera m: items[starts[m]] ... items[starts[m + 1] - 1].
    trial_eyes : (M, 3) float64
        Their centres, metres.
    n_rest, is_covered : (F,) int64, (F,) bool
        Number of the others that cover each face, and whether these are enough.
    weights : (F,) int64
        Weight of each face.
    centroids, need, min_cosine
        As for `cameras_until_covered`.
    added : (M,) int64
        Out: weight of the faces that are covered with the camera and not without.
    """
    rays = np.empty((rest.shape[0] + 1, 3))
    for m in range(trial_eyes.shape[0]):
        total = 0
        for at in range(starts[m], starts[m + 1]):
            f = items[at]
            if is_covered[f] or n_rest[f] + 1 < need[f]:
                continue
            is_enough = min_cosine > 1
            n = 0
            if not is_enough:
                for c in range(rest.shape[0]):
                    if rest[c, f]:
                        keep_ray(rest_eyes, c, centroids, f, rays, n)
                        is_enough = is_enough or differs(rays, n, min_cosine)
                        n += 1
                if not is_enough:
                    keep_ray(trial_eyes, m, centroids, f, rays, n)
                    is_enough = differs(rays, n, min_cosine)
            if is_enough:
                total += weights[f]
        added[m] = total


@compiled
def worth_added_by_rigs(
    rest, rest_eyes, starts, items, trial_eyes, n_rest, is_covered, weights, centroids, need,
    min_cosine, width, added,
):  # fmt: skip
    """Weight that each of M rigs of `width` cameras adds to what some others cover.

    Parameters
    ----------
    starts, items : (M width + 1,) int64, (N,) int32
        Faces of each camera; those of a rig follow one another, and may be empty.
    trial_eyes : (M width, 3) float64
    added : (M,) int64
        Out, as for `worth_added`, as the other arguments are.
    """
    rays = np.empty((rest.shape[0] + width, 3))
    times = np.zeros(rest.shape[1], np.int64)
    for m in range(len(added)):
        total = 0
        first, last = starts[m * width], starts[(m + 1) * width]
        for at in range(first, last):
            times[items[at]] += 1
        for camera in range(m * width, (m + 1) * width):
            for at in range(starts[camera], starts[camera + 1]):
                f = items[at]
                if times[f] == 0:
                    continue  # judged with an earlier camera
                n_more = times[f]
                times[f] = 0
                if is_covered[f] or n_rest[f] + n_more < need[f]:
                    continue
                is_enough = min_cosine > 1
                n = 0
                for c in range(rest.shape[0]):
                    if is_enough:
                        break
                    if rest[c, f]:
                        keep_ray(rest_eyes, c, centroids, f, rays, n)
                        is_enough = differs(rays, n, min_cosine)
                        n += 1
                for c in range(camera, (m + 1) * width):
                    if is_enough:
                        break
                    here = np.searchsorted(items[starts[c] : starts[c + 1]], f) + starts[c]
                    if here < starts[c + 1] and items[here] == f:
                        keep_ray(trial_eyes, c, centroids, f, rays, n)
                        is_enough = differs(rays, n, min_cosine)
                        n += 1
                if is_enough:
                    total += weights[f]
        added[m] = total
