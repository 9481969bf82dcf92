"""Advice for weak zones of an audit: images that are tried, and named where they cover most of one.

Images look at points along a zone from around the normal there, at the distance of the existing
ones and others, with the camera of most of them. They are taken one after the other until points of
the zone, evenly over its area, have the views, the angle and the resolution that they lack.
"""

from dataclasses import replace

import numpy as np

from rastercov.base import ByName, FloatArray, IntArray, first_of, plural
from rastercov.base.format import distance
from rastercov.core.area.failures import failures_of_rows
from rastercov.core.area.remedies import SURE, round_point
from rastercov.core.camera import (
    Poses,
    cameras_of,
    distance_to_keep,
    eyes_of,
    fibonacci_sphere,
    look_at,
    upwards,
)
from rastercov.core.coverage.reasons import Reason
from rastercov.placement.audit import Audit
from rastercov.placement.bits import by_face
from rastercov.placement.candidates.cavities import face_frames
from rastercov.placement.candidates.clearance import filter_candidates
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.select.problem import Problem

POINTS = 64
"""Of a zone."""
DIRECTIONS, MOST_OBLIQUE = 9, 0.5
"""Directions from a place, and least cosine of their angle to its normal."""
REACHES = (1.0, 0.7, 0.4, 0.2, 1.5, 2.5)
"""Times the distance of the existing images that are tried."""
PLACES, WAYS, LEAST_COSINE = 7, 16, 0.25
"""Elements along the longest axis of a zone that images look at, from how many directions each, and
the least cosine of their angle to the normal."""
MORE_IMAGES = 3
"""Images that are taken for a zone, beyond the views that it needs."""
CLEARANCE = 0.25
"""Least distance of a candidate to the surface, in distances of the existing images."""
MOST_NAMED = 3
"""Images in a sentence."""


class WeakRemedies:
    """Images that are tried for zones of an audit.

    Parameters
    ----------
    found : Audit
    wanted : Problem
        With the views and the angle that an element needs.
    density : float
        Least of the best densities, px per unit of length.
    unit : {"m", "unit"}
        Of lengths.
    """

    def __init__(self, audit: Audit, wanted: Problem, density: float, unit: str) -> None:
        self.found, self.wanted, self.density, self.unit = audit, wanted, density, unit
        self._starts, self._camera = by_face(*audit.problem.bits.pairs(), audit.problem.n_faces)
        sharp = max(audit.task.min_pixel_density, density)
        self._task = replace(audit.task, views=1, min_angle_deg=0.0, min_pixel_density=sharp)

    def say(self, rows: IntArray, away: float) -> tuple[str, ByName | None]:
        """Words on images for a zone, and their entries; those of none, and None.

        Parameters
        ----------
        rows : (N,) int
            Elements of the zone.
        away : float
            Distance of the existing images.
        """
        rows = self._along(rows)
        below = np.cumsum(self.found.problem.weights[rows])
        some, at = (
            rows[np.searchsorted(below, below[-1] * np.array(steps))]
            for steps in ((np.arange(n) + 0.5) / n for n in (POINTS, PLACES))
        )
        poses, targets = self._around(at, away)
        chosen, share = self._take(some, poses)
        if share < SURE:
            reach = distance(away * max(REACHES), self.unit)
            tried = f"none of the {len(poses):,} images tried within {reach}"
            return f"{tried} would improve at least half of it", None
        ends = poses.world_from_camera[chosen, :3, 3], targets[chosen]
        eyes, aims = ([self._round_point(each, away)[1] for each in points] for points in ends)
        named, last = eyes, f", {'all ' * (len(eyes) > 1)}aimed at {aims[0]}"
        if len(set(aims)) > 1:
            named, last = [f"{a} towards {b}" for a, b in zip(eyes, aims, strict=True)], ""
        words = (
            f"take {plural(len(chosen), 'more image')}, from "
            f"{first_of(named, MOST_NAMED).replace(', (', ' and from (')}{last}: "
            f"about {100 * share:.0f} % of the zone would no longer be weak (estimated)"
        )
        positions, looking_at = (each.tolist() for each in ends)
        return words, {
            "positions": positions,
            "looking_at": looking_at,
            "not_weak_percent": 100 * share,
        }

    def _along(self, rows: IntArray) -> IntArray:
        """Elements of a zone in the order along its longest axis."""
        centroids = self.found.elements.centroids[rows]
        away = centroids - centroids.mean(axis=0)
        axis = np.linalg.svd(away[:: max(1, len(away) // 1000)], full_matrices=False)[2][0]
        return rows[np.argsort(away @ axis, kind="stable")]

    def _round_point(self, point: FloatArray, away: float) -> tuple[FloatArray, str]:
        """A point to three digits of a distance, and its text with the unit."""
        place, text = round_point(point, max(away, 1e-12))
        return place, text if self.unit == "m" else f"{text.removesuffix(' m')} units"

    def _around(self, at: IntArray, away: float) -> tuple[Poses, FloatArray]:
        """Poses around some elements, clear of surfaces, and the points that they look at."""
        result, on = self.found, self.found.elements
        targets = np.array([self._round_point(each, away)[0] for each in on.centroids[at]])
        rays = face_frames(on.normals[at]) @ fibonacci_sphere(WAYS, 1 - LEAST_COSINE).T
        steps = away * np.array(REACHES)[:, None, None, None] * rays.transpose(0, 2, 1)
        every = (targets[:, None] + steps).reshape(-1, 3)
        eyes = np.array([self._round_point(eye, away)[0] for eye in every])
        eyes = np.tile(eyes, (2, 1))  # they look at the place before them, and at the middle
        middle = np.repeat(targets[[len(targets) // 2]], len(eyes) // 2, axis=0)
        own = np.tile(np.repeat(targets, WAYS, axis=0), (len(REACHES), 1))
        targets = np.concatenate([own, middle])
        kept = np.flatnonzero((eyes != targets).any(axis=1))
        made = look_at(eyes[kept], targets[kept], upwards(result.poses))
        keep_off = distance_to_keep(cameras_of(result.camera)) if self.unit == "m" else 0.0
        least = max(CLEARANCE * min(REACHES) * away, keep_off)
        left = filter_candidates(Candidates.of(made, "weak", kept), result.mesh, least)[0]
        camera = int(np.bincount(result.poses.camera).argmax())
        placed = Poses.of(left.poses, camera=np.full(len(left), camera))
        return placed, targets[left.index]

    def _take(self, rows: IntArray, poses: Poses) -> tuple[list[int], float]:
        """Poses that are taken for elements, and the share of these that is not weak then."""
        result, cells = self.found, self.found.cells
        points = result.elements.centroids[rows]
        face = rows if cells is None else cells.source_face[rows].astype(np.int64)
        scene = result.mesh, result.camera, self._task, poses
        judged = failures_of_rows(*scene, points, face)
        covers = np.array([reason == Reason.COVERED for _, reason, _ in judged])
        if not len(covers) or not len(poses):
            return [], 0.0
        ways = eyes_of(result.camera, poses)[:, None] - points
        ways /= np.linalg.norm(ways, axis=2, keepdims=True)
        angles = self._to_existing(rows, points, ways)
        need, least = self.wanted.views[rows], self.wanted.min_angle
        views, widest = result.views[rows], result.widest_angle[rows]
        is_sharp = result.best_density[rows] >= self.density
        chosen, share = list[int](), 0.0
        for _ in range(min(int(need.max()) + MORE_IMAGES, len(poses))):
            more = views + covers
            wider = np.maximum(widest, np.where(covers, angles, 0.0))
            strong = (more >= need) & (wider >= least) & (is_sharp | covers)
            gains = np.minimum(more / need, 1) + np.minimum(wider / least, 1)
            score = strong.mean(axis=1) + 1e-3 * gains.mean(axis=1)
            score[chosen] = -1.0
            chosen.append(best := int(score.argmax()))
            views, widest = more[best], wider[best]
            is_sharp, share = is_sharp | covers[best], float(strong[best].mean())
            if share >= SURE:
                break
            to_new = np.where(covers[best], _angles(ways, ways[best]), 0.0)
            angles = np.maximum(angles, to_new)
        return chosen, share

    def _to_existing(self, rows: IntArray, points: FloatArray, ways: FloatArray) -> FloatArray:
        """(C, N) widest angle of the ray to each new eye and those to images of each element."""
        eyes = eyes_of(self.found.camera, self.found.poses)
        existing = np.zeros(ways.shape[:2])
        for at, row in enumerate(rows.tolist()):
            own = eyes[self._camera[self._starts[row] : self._starts[row + 1]]] - points[at]
            if len(own):
                own /= np.linalg.norm(own, axis=1)[:, None]
                existing[:, at] = _angles(ways[:, at, None], own).max(axis=1)
        return existing


def _angles(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angles between unit vectors."""
    return np.arccos(np.clip((one * other).sum(axis=-1), -1.0, 1.0))
