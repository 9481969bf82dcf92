"""Candidates for faces that no other candidate sees, along the directions that are open there.

Serves faces that `uncovered` finds. From the centroid of each face, and from three more points
where that finds nothing, a hemicube measures the free distance in all directions. A direction is
open where nothing blocks it up to the least distance of a camera; cameras are placed along the best
open directions, at the nearest allowed distance at which the face is in view. A face without an
open direction, or without an allowed position, is reported as out of reach: proved where possible
(`enclosure`), and else with the width of an opening that cannot have been missed.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 7.3.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import ConfigError
from rastercov.base.format import plural
from rastercov.base.typed import typed
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import half_angles, look_at
from rastercov.mesh import Mesh
from rastercov.mesh.arrays import frozen
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.candidates.clearance import KeepOut, check_clearance, filter_candidates
from rastercov.placement.candidates.enclosure import Enclosure
from rastercov.placement.candidates.framing import DEFAULT, Framing
from rastercov.placement.candidates.hemicube import Hemicube, face_frames
from rastercov.placement.candidates.open_directions import APART_DEG, OpenDirections, far_apart
from rastercov.placement.candidates.pool import Candidates, face_rows, rolled_candidates

PLACES_AT_ONCE = 20_000
DIRECTIONS_AT_ONCE = 1 << 21
"""Free distances in memory: 32 MB with the pictures that they are from."""

Vector = tuple[float, float, float]
Block = list[tuple[OpenDirections, FloatArray, IntArray]]
"""Sites with the positions to try, (N, 3), and the ray of each."""
Allowed = Callable[[FloatArray], BoolArray]
"""Mask of the poses at positions where a camera can be mounted."""


class Access(IntEnum):
    """Accessibility of a face for cameras."""

    ENCLOSED = 0
    """Proved: a camera that sees it is inside a solid, or in a closed space that limits exclude."""
    CLOSED = 1
    """No sampled direction is open."""
    NO_ROOM = 2
    """Directions are open, but no allowed position was found on them."""
    REACHED = 3
    """Candidates were made."""


@dataclass(frozen=True, eq=False)
class Openings:
    """Accessibility of N faces; a two-sided face counts with its better side.

    Attributes
    ----------
    face : (N,) int64
        The faces; faces without area are left out.
    access : (N,) uint8
        `Access`.
    points, directions : (N,) int64
        Sampled points of the face, 0 where there is a proof, and directions from each.
    open_share : (N,) float64
        Open share of the half space in front of the face, at the point where it is largest.
    missed_deg : (N,) float64
        Full angle of a cone of open directions that cannot be missed at these points, degrees.
    least : float
        Least distance from a camera to the face, metres: an open direction is free up to it. All
        results are for cameras at this distance or more.
    places : (N,) int64
        Number of positions tried.
    proof : tuple of str
        Reason why the face is out of reach, "" without a proof.
    candidates : Candidates
        Candidates at allowed positions; source "cavity", `index` is the face.
    """

    face: IntArray
    access: NDArray[np.uint8]
    points: IntArray
    directions: IntArray
    open_share: FloatArray
    missed_deg: FloatArray
    least: float
    places: IntArray
    proof: tuple[str, ...]
    candidates: Candidates

    def words(self, row: int) -> str:
        """One sentence on a face."""
        face, access = f"Face {self.face[row]}", self.access[row]
        if access == Access.ENCLOSED:
            return f"{face} cannot be seen (proved): {self.proof[row]}."
        if access == Access.CLOSED:
            far = f" for {self.least:.3g} m" if self.least else ""
            return (
                f"{face} has no direction that is free{far}, among {self.directions[row]:,} from "
                f"each of {self.points[row]} points: no open cone of {self.missed_deg[row]:.2g}° "
                "or more."
            )
        share = f"{100 * self.open_share[row]:.3g} % of the half space before it is open"
        if access == Access.NO_ROOM and not self.places[row]:
            return f"{face}: {share}, but not as far as one must stand to have the face in view."
        if access == Access.NO_ROOM:
            return (
                f"{face}: {share}, but at none of {self.places[row]:,} places a camera can stand."
            )
        count = int((self.candidates.index == self.face[row]).sum())
        return f"{face}: {share}; {plural(count, 'candidate')}."

    def summary(self) -> dict[str, Any]:
        """Counts, ready for JSON."""
        shut = self.access == Access.CLOSED
        return {
            "faces": len(self.face),
            **{each.name.lower(): int((self.access == each).sum()) for each in Access},
            "missed_deg": float(self.missed_deg[shut].max(initial=0.0)),
            "candidates": len(self.candidates),
        }


@typed
def per_cavity(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    faces: ArrayLike,
    clearance: float = 0.0,
    keep_out: Sequence[KeepOut] = (),
    views: int = 3,
) -> Candidates:
    """Views along the directions that are open at each face; arguments as for `openings`."""
    return openings(
        mesh, camera, framing, faces=faces, clearance=clearance, keep_out=keep_out, views=views
    ).candidates


@typed
def openings(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    faces: ArrayLike,
    clearance: float = 0.0,
    keep_out: Sequence[KeepOut] = (),
    views: int = 3,
    side: int = 32,
    finest: int = 256,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Openings:
    """Candidates for each face along its open directions, and its accessibility.

    The distance is that of `fit="vertices"` or the next of `STEPS` larger ones at an allowed
    position; `Framing.stand_off` and the depth of field limit it, from the camera centre to the
    centroid of the face. A direction is open where nothing blocks it up to the least of these
    distances. Views of one face differ by 15 degrees or more.

    Parameters
    ----------
    faces : (F,) bool or (N,) int array_like
        Faces to see, such as those that no candidate sees.
    clearance, keep_out
        Constraints on positions, as for `filter_candidates`.
    views : int
        Greatest number of candidates a face, times the rolls of `framing`.
    side, finest : int
        Pixels along each side of a hemicube, even: for all faces, and for those that seem closed.
    progress : callable
        Called with the faces done and the total.

    Raises
    ------
    ConfigError
        For a value outside its range, or limits that exclude each other.
    """
    rows = face_rows(mesh, faces)
    rows = rows[~mesh.degenerate_mask[rows]]
    if isinstance(views, bool) or views < 1 or side < 2 or side % 2 or finest % 2:
        raise ConfigError(
            f"views must be 1 or more, side and finest even, got {views}, {side} and {finest}"
        )
    least = framing.limits(camera)[0]
    half_angles(camera)  # raises for a camera that cannot be aimed
    two_sided = mesh.two_sided_mask[rows]
    owner = np.concatenate((np.arange(len(rows)), np.flatnonzero(two_sided)))
    sign = np.repeat([1.0, -1.0], [len(rows), int(two_sided.sum())])
    n_sites = len(owner)
    check_clearance(clearance)
    sites = [
        OpenDirections(mesh, camera, framing, clearance, int(rows[o]), s)
        for o, s in zip(owner, sign, strict=True)
    ]
    enclosure = Enclosure(mesh, least, clearance, keep_out)
    normals = np.array([site.normal for site in sites]).reshape(-1, 3)
    for site, proof in zip(sites, enclosure.proofs(rows[owner], normals), strict=True):
        site.proof = proof
    levels = [(side, 1), (side, 4)] + ([(finest, 4)] if finest > side else [])
    waiting = [site for site in sites if not site.proof]
    done = n_sites - len(waiting)
    for level in levels:
        if not waiting:
            break
        with Hemicube(mesh, level[0]) as hemicube:
            closed: list[OpenDirections] = []
            for site in _searched(hemicube, waiting, level[1]):
                if site.rays is None and level != levels[-1]:
                    closed.append(site)
                else:
                    done += 1
                    progress(done, n_sites)
            waiting = closed
    progress(n_sites, n_sites)

    def allowed(poses: FloatArray) -> BoolArray:
        candidates = Candidates.of(poses, "cavity")
        return filter_candidates(candidates, mesh, clearance, keep_out)[1].kept_mask

    _place([site for site in sites if site.rays is not None], allowed, framing.up, views)
    return _gathered(rows, owner, sites, framing, least)


def _searched(
    hemicube: Hemicube, sites: Sequence[OpenDirections], n_points: int
) -> Iterator[OpenDirections]:
    """Search `n_points` of each site, and yield it."""
    at_once = max(1, DIRECTIONS_AT_ONCE // (n_points * len(hemicube.directions)))
    for start in range(0, len(sites), at_once):
        some = sites[start : start + at_once]
        frames = face_frames(np.array([site.normal for site in some]))
        points = np.concatenate([site.origins(n_points) for site in some])
        free = hemicube.free_distances(points, np.repeat(frames, n_points, axis=0))
        for site, frame, of_site in zip(
            some, frames, free.reshape(len(some), n_points, -1), strict=True
        ):
            site.search(hemicube, frame, of_site)
            yield site


def _place(sites: Sequence[OpenDirections], allowed: Allowed, up: Vector, views: int) -> None:
    """Find allowed poses for each site, on the first rays before the others."""
    for first in (True, False):
        block: Block = []
        size = 0
        for site in (s for s in sites if not s.poses):
            part = slice(0, site.n_first) if first else slice(site.n_first, None)
            eyes, ray = site.eyes(part)
            site.n_places += len(eyes)
            block.append((site, eyes, ray))
            size += len(eyes)
            if size >= PLACES_AT_ONCE:
                _judge(block, allowed, up, views)
                block, size = [], 0
        _judge(block, allowed, up, views)


def _judge(block: Block, allowed: Allowed, up: Vector, views: int) -> None:
    """Keep the nearest allowed position on each ray, for the sites of one block."""
    eyes = np.concatenate([eyes for _, eyes, _ in block]) if block else np.zeros((0, 3))
    if not len(eyes):
        return
    targets = np.concatenate([np.broadcast_to(s.target, e.shape) for s, e, _ in block])
    poses = look_at(eyes, targets, up)
    is_allowed = allowed(poses)
    start = 0
    for site, of_site, ray in block:
        rows = np.flatnonzero(is_allowed[start : start + len(of_site)])
        _, nearest = np.unique(ray[rows], return_index=True)
        good = poses[start + rows[nearest]]
        start += len(of_site)
        chosen = far_apart(-good[:, :3, 2], np.arange(len(good)), math.radians(APART_DEG), views)
        site.poses = list(good[chosen])


def _gathered(
    rows: IntArray, owner: IntArray, sites: Sequence[OpenDirections], framing: Framing, least: float
) -> Openings:
    """Openings of the faces, each with its better side."""
    best: list[OpenDirections | None] = [None] * len(rows)
    poses: list[list[FloatArray]] = [[] for _ in rows]
    for row, site in zip(owner.tolist(), sites, strict=True):
        other = best[row]
        poses[row] += site.poses
        if other is None or _access(site) > _access(other):
            best[row] = site
    chosen = [site for site in best if site is not None]
    upright = np.array([pose for of_face in poses for pose in of_face]).reshape(-1, 4, 4)
    index = np.repeat(rows, [len(of_face) for of_face in poses])
    return Openings(
        face=frozen(rows),
        access=frozen(np.array([_access(site) for site in chosen], np.uint8)),
        points=frozen(np.array([site.n_points for site in chosen], np.int64)),
        directions=frozen(np.array([site.n_directions for site in chosen], np.int64)),
        open_share=frozen(np.array([site.open_share for site in chosen], np.float64)),
        missed_deg=frozen(np.array([site.missed_deg for site in chosen], np.float64)),
        least=least,
        places=frozen(np.array([site.n_places for site in chosen], np.int64)),
        proof=tuple(site.proof for site in chosen),
        candidates=rolled_candidates(upright, "cavity", index, framing),
    )


def _access(site: OpenDirections) -> Access:
    if site.proof:
        return Access.ENCLOSED
    if site.rays is None:
        return Access.CLOSED
    return Access.REACHED if site.poses else Access.NO_ROOM
