"""Figures for photogrammetry of an audit, and the images to take next.

    audit -> weak zones -> candidates around them -> greedy with exchanges -> views, measured again

An element is weak where fewer than k images cover it, where the rays to all of these are within a
small angle, or where its ground sampling distance (GSD), the inverse of the best pixel density, is
much more than the median. Two images overlap by the area that both cover.

A `Reconstruction` is an audit with these figures, the unit of its lengths, and the images to take
next. They see what is weak from the distance of the existing images. They are chosen
with these as one candidate without cost, so that a view that is there counts, but not of what is
coarse. A new view counts where it is not coarse. What they cover is then measured by the task.

Advice for weak zones of an audit: images that are tried, and named where they cover most of one.

Images look at points along a zone from around the normal there, at the distance of the existing
ones and others, with the camera of most of them. They are taken one after the other until points of
the zone, evenly over its area, have the views, the angle and the resolution that they lack.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InNotebook,
    IntArray,
    ReadByName,
    arccos,
    dots,
    first_of,
    frozen_record,
    matmul,
    norm,
    owners_of,
    percent,
    plural,
    sampling,
    shown,
    sort_order,
)
from rastercov.base.arguments import is_number
from rastercov.base.format import distance
from rastercov.core.area.advice import general_advice
from rastercov.core.area.point_pass import PointPass
from rastercov.core.area.polygons import quantile
from rastercov.core.area.remedies import SURE, round_point
from rastercov.core.area.zones import MOST_LINES, TRIED_PERCENT
from rastercov.core.camera import (
    Poses,
    cameras_of,
    distance_to_keep,
    eyes_of,
    fibonacci_sphere,
    look_at,
    upwards,
)
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.coverage.task import NAMES, REASONS, Engine, Reason
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.topology import components_of, first_equal_row
from rastercov.placement.audit import Audit, audit
from rastercov.placement.bits import CoveredBits, by_face
from rastercov.placement.candidates.cavities import face_frames
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.rooms import filter_candidates
from rastercov.placement.footprints import Footprints, footprints, surface_of_footprints
from rastercov.placement.georeference import GeoReference
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.select.methods import select_greedy
from rastercov.placement.select.problem import BestCoverage, Problem
from rastercov.shards import ALONE, Progress, silent

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
SQUARINGS = 8
"""Of a matrix, until its columns are along the longest axis of a zone."""


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
        spread = dots(away.T[:, None], away.T)
        for _ in range(SQUARINGS):
            spread = matmul(spread, spread / max(np.abs(spread).max(), TINY))
        axis = spread[np.abs(spread).sum(axis=1).argmax()]
        return rows[sort_order(matmul(away, axis))]

    def _round_point(self, point: FloatArray, away: float) -> tuple[FloatArray, str]:
        """A point to three digits of a distance, and its text with the unit."""
        place, text = round_point(point, max(away, 1e-12))
        return place, text if self.unit == "m" else f"{text.removesuffix(' m')} units"

    def _around(self, at: IntArray, away: float) -> tuple[Poses, FloatArray]:
        """Poses around some elements, clear of surfaces, and the points that they look at."""
        result, on = self.found, self.found.elements
        targets = np.array([self._round_point(each, away)[0] for each in on.centroids[at]])
        rays = matmul(face_frames(on.normals[at]), fibonacci_sphere(WAYS, 1 - LEAST_COSINE).T)
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
        if not len(poses):
            return [], 0.0
        covers = PointPass(result.mesh, result.camera, self._task, points, face).covers(poses)
        ways = eyes_of(result.camera, poses)[:, None] - points
        ways /= norm(ways)[..., None]
        angles = _angles(self._to_existing(rows, points, ways), covers)
        need, least = self.wanted.views[rows], self.wanted.min_angle
        views, widest = result.views[rows], result.widest_angle[rows]
        is_sharp = result.best_density[rows] >= self.density
        chosen, share = list[int](), 0.0
        for _ in range(min(int(need.max()) + MORE_IMAGES, len(poses))):
            more = views + covers
            wider = np.maximum(widest, angles)
            strong = (more >= need) & (wider >= least) & (is_sharp | covers)
            gains = np.minimum(more / need, 1) + np.minimum(wider / least, 1)
            score = strong.mean(axis=1) + 1e-3 * gains.mean(axis=1)
            score[chosen] = -1.0
            chosen.append(best := int(score.argmax()))
            views, widest = more[best], wider[best]
            is_sharp, share = is_sharp | covers[best], float(strong[best].mean())
            if share >= SURE:
                break
            to_new = _angles(dots(ways, ways[best]), covers & covers[best])
            angles = np.maximum(angles, to_new)
        return chosen, share

    def _to_existing(self, rows: IntArray, points: FloatArray, ways: FloatArray) -> FloatArray:
        """(C, N) cosine of the widest angle of rays to each new eye and to images of an element."""
        eyes = eyes_of(self.found.camera, self.found.poses)
        cosines = np.ones(ways.shape[:2])
        for at, row in enumerate(rows.tolist()):
            own = eyes[self._camera[self._starts[row] : self._starts[row + 1]]] - points[at]
            if len(own):
                own /= norm(own)[:, None]
                cosines[:, at] = dots(ways[:, at, None], own).min(axis=1)
        return cosines


def _angles(cosines: FloatArray, mask: BoolArray) -> FloatArray:
    """Angles of cosines where a mask holds, 0 elsewhere."""
    angles = np.zeros(mask.shape)
    angles[mask] = arccos(np.clip(cosines[mask], -1.0, 1.0))
    return angles


LEAST_VIEWS, LEAST_ANGLE_DEG = 2, 5.0
"""Images that a point needs to have a place, and an angle between them; the task may ask more."""
COARSE = 2.0
"""GSD above which an element is coarse, in medians."""
LEAST_OVERLAP = 0.2
"""Part of the smaller area of two images that both cover, from which they are linked."""
LEAST_LINKS = 2
"""Other images that an image is to be linked with."""
MOST_IMAGES, MOST_PAIRS, MOST_ZONES = 2000, 10_000, 100
"""Images with an overlap graph; pairs and zones that a summary lists."""
KINDS = ("few_views", "small_angle", "coarse")
"""Kinds of weakness; an element has the first that is true of it."""
FACTS = {
    "few_views": "{views}{why}",
    "small_angle": "views span {angle}",
    "coarse": "{found} from {distance} (medians over the zone, best image of each point), weak "
    "above {wanted}",
}
"""Lack of a zone of each kind, in numbers."""
SEPARATE = "on a separate component of the mesh ({} of the area){}; "
"""Words before the advice for a zone that is not on the largest component."""
NOISE_PERCENT = 5.0
"""Part of the area below which a component may be noise."""
PLACES = 48
"""Places in weak zones around which there are candidates, `DIRECTIONS` from each."""
LEAST_GAIN = 1e-5
"""Part of the area that the last of the images to take next adds at least."""


@frozen_record
class Weak:
    """Weak elements of an audit: `kind`, a row of `KINDS`, and `zone` of each, (E,); -1 for none.

    Zones are connected elements of one kind, the largest first; `area`, (Z,), is that of each.
    """

    kind: IntArray
    zone: IntArray
    area: FloatArray


@frozen_record
class Suggested:
    """Images to take next.

    Attributes
    ----------
    poses : Poses
        world_from_camera, with the index of the camera of each.
    names : tuple of str
        Name of each image.
    steps : list of Audit
        The audit with the first 0, 1, ... of these images added: its problem, poses and values of
        elements include them; its figures of each image and its exact area do not.
    requested : int
        Number of images that were asked for.
    """

    poses: Poses
    names: tuple[str, ...]
    steps: list[Audit]
    requested: int

    def summary(self) -> ByName:
        """Covered and weak percentage before, after each image, and after all; for JSON."""
        shares = [
            {"covered_percent": step.percent(step.covered),
             "weak_percent": step.percent(weak(step).kind >= 0)}
            for step in self.steps
        ]  # fmt: skip
        eyes = self.poses.eyes.tolist()
        images = [
            {"name": name, "position": eye} | share
            for name, eye, share in zip(self.names, eyes, shares[1:], strict=True)
        ]
        return {"before": shares[0], "images": images, "after": shares[-1]}


@frozen_record(repr=False, kw_only=True)
class Reconstruction(Audit, InNotebook):
    """An audit with figures for photogrammetry, as `rastercov.audit` returns it.

    Attributes
    ----------
    unit : {"m", "unit"}
        Unit of lengths: metres, or that of a reconstruction without scale.
    suggested : Suggested or None
        The images to take next, if they were requested.
    footprints : Footprints or None
        Polygons that each image covers, if they were requested.
    place : GeoReference or None
        Georeference of the footprints; None for local coordinates.
    """

    unit: str = "m"
    suggested: Suggested | None = None
    footprints: Footprints | None = None
    place: GeoReference | None = None

    def summary(self) -> ByName:
        """Figures of the audit, those of `summary_of`, and those of the suggested images."""
        summary = super().summary() | {"unit": self.unit} | summary_of(self, self.unit)
        if self.footprints is not None:
            crs = None if self.place is None else self.place.words
            summary["footprints"] = {"crs": crs} | self.footprints.summary()
        if self.suggested is None:
            return summary
        zone, weights = weak(self).zone, self.problem.weights
        left = weights * (weak(self.suggested.steps[-1]).kind >= 0)
        for row, entry in enumerate(summary["weak"]["zones"]):
            entry["left_percent"] = 100 * float(left[zone == row].sum()) / entry["m2"]
        return summary | {"suggested": self.suggested.summary()}


def reconstruction(
    *scene: Any,
    unit: str = "m",
    suggested: int | None = None,
    surface: Sequence[str] | None = None,
    place: GeoReference | None = None,
    **options: Any,
) -> Reconstruction:
    """An audit as a `Reconstruction`, with some images to take next.

    Parameters
    ----------
    scene, options
        Arguments of `rastercov.placement.audit.audit`.
    unit
        As of `Reconstruction`.
    suggested : int, optional
        Number of images to take next, from 1.
    surface : sequence of str, optional
        Groups of the surface of footprints, none for what is seen from above; no footprints unless
        given.
    place : GeoReference, optional
        That of the coordinates, for footprints.
    """
    if suggested is not None and not (is_number(suggested) and suggested >= 1):
        raise ConfigError(
            f"expected 1 image or more to suggest, got {shown(suggested)}; increase it"
        )
    method = options.get("method", "certified")
    if surface is not None:
        surface_of_footprints(scene[0], replace(scene[3], min_angle_deg=0.0), surface, method)
    result, more = audit(*scene, **options), None
    if suggested is not None:
        step = options.get("staff", ALONE).progress
        more = suggest(result, suggested, unit=unit, progress=step, method=method)
    made = Reconstruction(**vars(result), unit=unit, suggested=more)
    if surface is None:
        return made
    mesh, poses = result.mesh, result.poses
    if place is not None:
        place, mesh, poses = place.level(mesh, poses)
    task = replace(result.task, min_angle_deg=0.0)
    scene_of = mesh, result.camera, poses, task
    own = footprints(*scene_of, names=result.names, groups=surface, method=method)
    return replace(made, footprints=own, place=place)


def strict(problem: Problem) -> Problem:
    """The problem with views and angle below which an element is weak."""
    angle = problem.min_angle or math.radians(LEAST_ANGLE_DEG)
    return replace(problem, views=np.maximum(problem.views, LEAST_VIEWS), min_angle=angle)


def coarse_density(audit: Audit) -> float:
    """Best density below which an element is coarse, px per unit of length."""
    return quantile(audit.best_density, audit.problem.weights, audit.views > 0) / COARSE


def weak(audit: Audit) -> Weak:
    """Weak elements of an audit and their zones."""
    wanted, is_task, on = strict(audit.problem), audit.problem.weights > 0, audit.elements
    kind = np.full(len(audit.views), -1)
    kind[is_task & (audit.best_density < coarse_density(audit))] = 2
    kind[is_task & (audit.widest_angle < wanted.min_angle)] = 1
    kind[is_task & (audit.views < wanted.views)] = 0
    rows = np.flatnonzero(kind >= 0)
    zone = _connected_parts(on, rows, kind[rows] + len(KINDS) * _is_unseeable(audit)[rows])
    area = np.bincount(zone, audit.problem.weights[rows]).astype(np.float64)
    order = sort_order(-area)
    zones = np.full(len(kind), -1, np.int64)
    zones[rows] = sort_order(order)[zone]
    return Weak(kind, zones, area[order])


def _connected_parts(on: Mesh, rows: IntArray, kind: IntArray) -> IntArray:
    """Number of the connected part of each of some elements, (N,), of those of the same kind.

    Kinds are below twice the length of `KINDS`.
    """
    # Cells of two faces have a corner in common up to rounding.
    step = 1e-9 * max(float(np.abs(on.vertices).max(initial=0)), TINY)
    corner = first_equal_row(np.rint(on.vertices / step).astype(np.int64).view(np.uint64))
    key = (corner[on.faces[rows]] * (2 * len(KINDS)) + kind[:, None]).ravel()
    around = sort_order(key)  # elements of one kind around a corner in turn
    turn = np.stack((around[:-1], around[1:]), axis=1)[np.diff(key[around]) == 0] // 3
    return components_of(len(rows), turn)


def overlap(audit: Audit) -> ByName:
    """Overlap graph of the images, ready for JSON; empty for none, and more than `MOST_IMAGES`.

    `components` are linked images, `weakest` the links of the strongest tree that holds each
    together, the weakest first, and `too_few` the images with fewer than `LEAST_LINKS` links.
    """
    n, bits, names = len(audit.poses), audit.problem.bits, audit.names
    if not 0 < n <= MOST_IMAGES:
        return {}
    whole = audit.problem.integer_weights
    values = np.append(whole, np.zeros(-len(whole) % 64, np.int64))[None]
    rows = [bits.sums(values, bits.row(row)[None])[:, 0] for row in range(n)]  # compiled
    shared = np.array(rows) * (float(audit.problem.weights.sum()) / max(1, int(whole.sum())))
    least = np.minimum.outer(shared.diagonal(), shared.diagonal())
    share = np.divide(shared, least, out=np.zeros_like(shared), where=least > 0)
    np.fill_diagonal(share, 0.0)
    part, parent = _strongest_tree(share)

    def entry(one: int, other: int) -> ByName:
        pair = {"shared_m2": float(shared[one, other]), "percent": 100 * float(share[one, other])}
        return {"images": [names[one], names[other]]} | pair

    tree = sorted(np.flatnonzero(parent >= 0).tolist(), key=lambda row: share[row, parent[row]])
    one, other = np.nonzero(np.triu(share) > 0)
    order = sort_order(-share[one, other])[:MOST_PAIRS]
    links = (share >= LEAST_OVERLAP).sum(axis=1)
    return {
        "least_percent": 100 * LEAST_OVERLAP,
        "components": [
            [names[row] for row in np.flatnonzero(part == each)] for each in range(part.max() + 1)
        ],
        "weakest": [entry(row, parent[row]) for row in tree[:MOST_ZONES]],
        "too_few": [
            {"name": names[row], "links": int(links[row])} | entry(row, int(share[row].argmax()))
            for row in np.flatnonzero(links < LEAST_LINKS).tolist()
        ],
        "pairs": [entry(one[row], other[row]) for row in order],
    }


def _strongest_tree(share: FloatArray) -> tuple[IntArray, IntArray]:
    """Component of each image, (P,), and the image that it is linked to in the strongest tree.

    Links are shares, (P, P), of `LEAST_OVERLAP` or more; the first image of a component has -1.

    R. C. Prim. Shortest connection networks and some generalizations. 1957.
    """
    n = len(share)
    part, parent, best = np.zeros(n, np.int64), np.full(n, -1), np.full(n, -1.0)
    is_left, count = np.ones(n, bool), -1
    for _ in range(n):
        row = int(np.where(is_left, best, -2.0).argmax())
        if best[row] < LEAST_OVERLAP:
            count, parent[row] = count + 1, -1
        part[row], is_left[row] = count, False
        is_better = is_left & (share[row] > best)
        best[is_better], parent[is_better] = share[row, is_better], row
    return part, parent


def summary_of(audit: Audit, unit: str = "m") -> ByName:
    """GSD, area by number of views, weak zones with advice, and overlap, ready for JSON.

    Lengths are in the unit of the mesh, and so is the GSD, of a pixel. The unit, as of
    `Reconstruction`, is that of the words.
    """
    weights, is_seen = audit.problem.weights, audit.views > 0
    of_area = 100 / max(float(weights.sum()), TINY)
    zones, wanted, entries = weak(audit), strict(audit.problem), []
    centroids, reach = audit.elements.centroids, _reach(audit)
    usual = quantile(reach, weights, is_seen)
    least = {
        "views": int(wanted.views.max(initial=LEAST_VIEWS)),
        "angle_deg": math.degrees(wanted.min_angle),
        "coarse_gsd_per_px": 1 / coarse_density(audit) if is_seen.any() else None,
    }

    def gsd(mask: BoolArray, share: float = 0.5) -> float | None:
        density = quantile(audit.best_density, weights, mask & is_seen, share)
        return 1 / density if density > 0 else None

    of_element = _connected_parts(
        audit.elements, np.arange(len(weights)), np.zeros(len(weights), np.int64)
    )
    pieces = np.bincount(of_element, weights)
    largest, piece = int(pieces.argmax()), np.zeros(len(zones.area), np.int64)
    remedies = WeakRemedies(audit, wanted, coarse_density(audit), unit)
    n_tried = max(MOST_LINES, int((of_area * zones.area >= TRIED_PERCENT).sum()))
    piece[zones.zone[zones.zone >= 0]] = of_element[zones.zone >= 0]
    for row, m2 in enumerate(zones.area[:MOST_ZONES].tolist()):
        own = zones.zone == row
        entry = {
            "kind": KINDS[int(zones.kind[own][0])], "m2": m2, "percent": of_area * m2,
            "centroid": (matmul(weights[own], centroids[own]) / m2).tolist(),
            "mean_views": float(dots(weights[own], audit.views[own]) / m2), "gsd_per_px": gsd(own),
            "angle_deg": math.degrees(quantile(audit.widest_angle, weights, own)),
            "distance": quantile(reach, weights, own & is_seen) or usual,
            "unseen_because": _unseen_because(audit, own & ~is_seen),
        }  # fmt: skip
        apart = None if piece[row] == largest else of_area * float(pieces[piece[row]])
        entry["separate_percent"] = apart
        words = [_facts(entry, least, unit)]
        entry["tried"] = None
        if row < n_tried and entry["distance"] and entry["unseen_because"] != "unseeable":
            said, entry["tried"] = remedies.say(np.flatnonzero(own), entry["distance"])
            words.append(said)
        entries.append(entry | {"advice": "; ".join(words)})
    of_kind = np.bincount(zones.kind[zones.kind >= 0], weights[zones.kind >= 0], len(KINDS))
    return {
        "gsd_per_px": {
            "least": gsd(is_seen, 1.0), "median": gsd(is_seen), "percentile_95": gsd(is_seen, 0.05)
        },
        "by_views": [
            {"views": views, "m2": m2, "percent": of_area * m2}
            for views, m2 in enumerate(np.bincount(audit.views, weights).tolist())
        ],
        "weak": {
            **least,
            "percent": audit.percent(zones.kind >= 0),
            "by_kind": dict(zip(KINDS, (of_area * of_kind).tolist(), strict=True)),
            "zones": entries,
            "other_zones": max(0, len(zones.area) - MOST_ZONES),
        },
        "overlap": overlap(audit),
    }  # fmt: skip


def _reach(audit: Audit) -> FloatArray:
    """(E,) distance of each element to its best camera, of those that are seen."""
    eyes = np.append(audit.poses.eyes, np.zeros((1, 3)), axis=0)
    return norm(eyes[audit.best_camera] - audit.elements.centroids)


def _unseen_because(audit: Audit, mask: BoolArray) -> str | None:
    """Name of the reason of most of the area of some elements; None for no reason."""
    if mask.any() and _is_unseeable(audit)[mask].all():
        return "unseeable"
    of_face = audit.network.reason[mask if audit.cells is None else audit.cells.source_face[mask]]
    areas = np.bincount(of_face, audit.problem.weights[mask], len(NAMES))[: Reason.COVERED]
    return NAMES[int(areas.argmax())] if areas.any() else None


def _is_unseeable(audit: Audit) -> BoolArray:
    """(E,) elements of faces that no camera can see: proved."""
    of_face = audit.network.unseeable_areas > 0
    return of_face if audit.cells is None else of_face[audit.cells.source_face]


def _facts(zone: ReadByName, least: ReadByName, unit: str) -> str:
    """Lack of a weak zone, in numbers."""
    gsd, why = zone["gsd_per_px"] or 0.0, zone["unseen_because"]
    times = gsd / (least["coarse_gsd_per_px"] or math.inf) or 1.0
    size = zone["separate_percent"]
    views = zone["mean_views"]
    seen = f"seen by {views:.1f} images on average" if views >= 0.05 else "seen by no image"
    if why == "unseeable":
        return f"{REASONS[why].label}: {general_advice(why)}"
    noise = "" if size is None or size >= NOISE_PERCENT else ", which may be noise"
    apart_from = "" if size is None else SEPARATE.format(percent(size / 100), noise)
    return apart_from + FACTS[zone["kind"]].format(
        views=f"{seen}, {least['views']} required",
        why="; main cause where unseen: "
        f"{'too few pixels' if why == 'too_coarse' else REASONS[why].label}"
        if why
        else "",
        angle=f"{zone['angle_deg']:.2g}°, at least {least['angle_deg']:.3g}° required",
        found=sampling(gsd, unit),
        wanted=sampling(gsd / times, unit),
        distance=distance(zone["distance"], unit),
    )


def suggest(
    audit: Audit,
    count: int,
    *,
    method: str | Engine = "certified",
    unit: str = "m",
    progress: Progress = silent,
) -> Suggested:
    """Images to take next, at most `count`, fewer where no more adds anything.

    Parameters
    ----------
    audit : Audit
        What the existing images cover; the new ones have the camera of most of these.
    count : int
        0 or more.
    method : {"certified", "exact", "sampled"}, or Engine
        That of the audit.
    unit : str
        As of `Reconstruction`: in metres the new images keep the size of a camera from surfaces.
    progress : callable
        Called with the candidates done and the total.

    Raises
    ------
    ConfigError
        For a negative count, and an audit whose images see nothing.
    """
    if not audit.views.any():
        raise ConfigError(
            f"expected images that see the surface, got none of {len(audit.poses)}; check the "
            "poses and their unit"
        )
    zones, problem, n = weak(audit), strict(audit.problem), len(audit.poses)
    task = replace(audit.task, min_angle_deg=0.0)
    sharp = max(task.min_pixel_density, coarse_density(audit))
    limits, face = problem.bits.pairs()
    kept = zones.kind[face] != KINDS.index("coarse")
    counted = owners_of(np.diff(limits))[kept], face[kept]
    camera = int(np.bincount(audit.poses.camera).argmax())
    candidates = _around(audit, zones, unit).of_camera(camera)
    with open_observer(audit.mesh, audit.camera, method) as observer:
        measured = partial(build_matrix, observer, cells=audit.cells)
        sharply = replace(task, min_pixel_density=sharp)
        matrix = measured(candidates.placed, sharply, progress=progress)
        assert problem.eyes is not None
        joined = replace(
            problem,
            bits=CoveredBits.from_pairs(*counted, n, problem.n_faces).joined(_bits(matrix)),
            starts=np.append(0, np.arange(n, n + len(candidates) + 1)),
            costs=np.append(0.0, np.ones(len(candidates))),
            goal=BestCoverage(budget=float(min(count, PLACES * DIRECTIONS))),
            eyes=np.concatenate((problem.eyes, eyes_of(audit.camera, candidates.placed))),
        )
        found_best = select_greedy(joined)
        chosen = found_best.chosen[: 1 + np.sum(found_best.curve < found_best.share - LEAST_GAIN)]
        new = candidates.take(chosen[chosen > 0] - 1).placed
        bits = _bits(measured(new, task))
    names = tuple(f"suggested_{row + 1}" for row in range(len(new)))
    steps = [audit.with_poses(new[:row], bits.take(np.arange(row))) for row in range(len(new) + 1)]
    return Suggested(new, names, steps, count)


def _bits(matrix: VisibilityMatrix) -> CoveredBits:
    return matrix.bits(max(matrix.task.min_coverage, TINY))


def _around(audit: Audit, zones: Weak, unit: str) -> Candidates:
    """Candidates around weak zones: places spread over their area, each from some directions."""
    on, weights = audit.elements, audit.problem.weights
    order = np.lexsort((zones.zone, zones.kind))[np.sum(zones.kind < 0) :]
    below = np.cumsum(weights[order])
    steps = (np.arange(PLACES if len(order) else 0) + 0.5) / PLACES
    at = order[np.searchsorted(below, steps * below[-1:].sum())]
    away = quantile(_reach(audit), weights, audit.views > 0)
    rays = matmul(face_frames(on.normals[at]), fibonacci_sphere(DIRECTIONS, 1 - MOST_OBLIQUE).T)
    targets = np.repeat(on.centroids[at], DIRECTIONS, axis=0)
    eyes = targets + away * rays.transpose(0, 2, 1).reshape(-1, 3)
    made = Candidates.of(look_at(eyes, targets, upwards(audit.poses)), "weak")
    kept = distance_to_keep(cameras_of(audit.camera)) if unit == "m" else 0.0
    return filter_candidates(made, audit.mesh, max(CLEARANCE * away, kept))[0]
