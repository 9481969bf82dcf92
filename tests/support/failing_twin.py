"""Failures of a rig with a rule at points, by those of each of its devices there.

Twin of `area/rule.hpp`.
"""

import math
from itertools import combinations

import numpy as np

from rastercov.base.arguments import BoolArray, ByteArray, FloatArray, IntArray
from rastercov.core.camera.rule import RigRule
from rastercov.core.coverage.task import (
    BASELINE,
    BITS,
    CRITERIA,
    FIRST_OF_SEVERAL,
    ROW_OF,
    SETS,
    TOGETHER,
    UNCERTAIN,
    Reason,
)

ORDER = (
    *(Reason.DEGENERATE, Reason.BACK_FACING, Reason.OUTSIDE),
    *range(FIRST_OF_SEVERAL, FIRST_OF_SEVERAL + len(SETS)),
    *(Reason.OUT_OF_FOCUS, Reason.UNSAMPLED),
    *(Reason.TOO_COARSE, Reason.OCCLUDED, Reason.TOO_OBLIQUE),
    *(*CRITERIA[len(TOGETHER) :], Reason.COVERED),
)
"""Rows by how near a camera that has them is to covering."""


def failing(
    rule: RigRule, placed: FloatArray, points: FloatArray, normals: FloatArray, reasons: ByteArray
) -> tuple[IntArray, IntArray]:
    """(N,) row of `REASONS` of points, and the device that is missed most; -1 for none.

    Of devices (n, 4, 4), each with its reasons, (n, N).
    """
    fronts = np.einsum("nki,ki->nk", placed[:, None, :3, 3] - points, normals) >= 0
    failings = [_failing(rule, *each) for each in zip(reasons.T, fronts.T, strict=True)]
    for row, (reason, _) in enumerate(failings):
        if reason == Reason.COVERED:
            if not _have_angles(rule, placed[:, :3, 3] - points[row]):
                reason = BASELINE
            elif rule.most_deviation > 0:
                own = deviation(rule, placed, points[row])
                reason = Reason.COVERED if own <= rule.most_deviation else UNCERTAIN
            failings[row] = reason, -1
    both: IntArray = np.array(failings, np.int64).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _failing(rule: RigRule, reasons: ByteArray, front: BoolArray) -> tuple[int, int]:
    """Reason and device at one point."""
    every = []
    for side in (front, ~front):
        ranks = [ORDER.index(each) for each in reasons]
        behind = ORDER.index(Reason.BACK_FACING)
        own = [rank if sees else min(rank, behind) for rank, sees in zip(ranks, side, strict=True)]
        rest = sorted(np.flatnonzero(rule.needs == 0).tolist(), key=lambda each: -own[each])
        more = rule.k - int(rule.needs.sum())
        some = [*([rest[more - 1]] if more > 0 else []), *np.flatnonzero(rule.needs).tolist()]
        missed = min(some, key=lambda each: own[each])
        every.append((own[missed], missed))
    rank, device = max(every, key=lambda each: each[0])
    bits = [int(BITS[each]) if each != Reason.COVERED else 0 for each in reasons]
    asked = (BITS[reasons] > 0) | (reasons == Reason.COVERED)
    for n in range(len(TOGETHER) + 1):
        for some in combinations(range(len(TOGETHER) - 1, -1, -1), n):
            left = sum(1 << each for each in some)
            passes = asked & np.array([own & ~left == 0 for own in bits])
            for side in (front, ~front):
                sees = passes & side
                if sees.sum() >= rule.k and sees[rule.needs > 0].all():
                    return (ROW_OF[left] if left else int(Reason.COVERED)), device
    return int(ORDER[rank]), device


def _have_angles(rule: RigRule, rays: FloatArray) -> bool:
    """True where the angle between some two rays, and between any two, is within its limit."""
    units = rays / np.linalg.norm(rays, axis=1)[:, None]
    cosines = [one @ other for one, other in combinations(units, 2)]
    least, most = (math.cos(math.radians(each)) for each in (rule.least_deg, rule.most_deg))
    if not cosines:
        return True
    return (rule.most_deg == 180 or min(cosines) >= most) and (
        rule.least_deg == 0 or min(cosines) <= least
    )


def deviation(rule: RigRule, placed: FloatArray, point: FloatArray) -> float:
    """Standard deviation of a point in its worst direction by devices (n, 4, 4), metres."""
    information = np.zeros((3, 3))
    for pose, noise, is_stripe in zip(placed, rule.noise, rule.stripes, strict=True):
        away = point - pose[:3, 3]
        axis = np.cross(away, pose[:3, 1]) if is_stripe else away
        axis = axis / np.linalg.norm(axis)
        own = np.outer(axis, axis) if is_stripe else np.eye(3) - np.outer(axis, axis)
        information += own / (noise * np.linalg.norm(away)) ** 2
    with np.errstate(divide="ignore"):
        return float(1 / np.sqrt(max(np.linalg.eigvalsh(information)[0], 0.0)))
