"""Candidates for faces that no other candidate sees: cameras along the directions open at them.

Beside `candidates`, for what `leftover` finds. From the centroid of each face, and from three more
points where that finds nothing, one looks out in all directions (`hemicube`). A direction is open where
nothing stands in the way for as far as a camera needs; cameras are placed along the best of these,
as near as the face fits into the image and the camera stands clear. A face without an open
direction, or without a place, is declared out of reach: with proof where there is one
(`enclosure`), and else with the width of an opening that cannot have been missed.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 7.3.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._typed import typed
from rastercov.camera import Camera
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.mesh.arrays import frozen
from rastercov.placement.candidates.clearance import KeepOut, check_clearance, kept
from rastercov.placement.candidates.enclosure import Enclosure
from rastercov.placement.candidates.framing import DEFAULT, Framing, half_angles, rolled_frames
from rastercov.placement.candidates.hemicube import Hemicube
from rastercov.placement.candidates.open_directions import APART_DEG, OpenDirections, far_apart
from rastercov.placement.candidates.pool import Candidates, face_rows
from rastercov.pose import look_at

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

PLACES_AT_ONCE = 20_000


class Access(IntEnum):
    """Whether a camera can be brought before a face."""

    ENCLOSED = 0
    """Proved: who sees it stands in matter, or in a closed space that the limits exclude."""
    CLOSED = 1
    """No direction is open among those that were looked along."""
    NO_ROOM = 2
    """Directions are open, but on none a place was found where a camera can stand."""
    REACHED = 3
    """Candidates were made."""


@dataclass(frozen=True, eq=False)
class Openings:
    """What was found before each of N faces; a face that is two-sided counts with its better side.

    Attributes
    ----------
    face : (N,) int64
        The faces; those without area are left out.
    access : (N,) uint8
        `Access`.
    points, directions : (N,) int64
        Points of the face that one looked out from, 0 where there is a proof, and directions from
        each.
    open_share : (N,) float64
        Part of the half space before the face that is open, from the point where most is.
    missed_deg : (N,) float64
        Full angle of a cone of open directions that cannot have been missed at these points.
    least : float
        Least distance from a camera to the face, metres: so far a direction must be free. Proofs
        and findings are about cameras that keep it from this very face.
    places : (N,) int64
        Places for a camera that were tried.
    proof : tuple of str
        What proves that the face is out of reach, "" where nothing does.
    candidates : Candidates
        Where cameras can stand; source "cavity", `index` is the face.
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
        return f"{face}: {share}; {count} candidate{'s' if count != 1 else ''}."

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
    """Where cameras can stand that look at each face from where it is open.

    The distance is that of `fit="vertices"` or the next of `STEPS` larger ones at which the camera
    stands clear; `Framing.stand_off` and the depth of field limit it, from the camera centre to the
    centroid of the face. A direction is open where a camera could stand at the least of these
    distances with nothing between. Views of one face differ by 15 degrees or more.

    Parameters
    ----------
    mesh, camera, framing
        As for every generator.
    faces : (F,) bool or (N,) int array_like
        Those to bring cameras before, such as those that no candidate sees.
    clearance, keep_out
        Where cameras can stand, as for `clearance.kept`.
    views : int
        Candidates for each face at most, times the rolls of `framing`.
    side, finest : int
        Directions along each side of a half cube, even: for all faces, and for those that seem
        closed.
    progress : callable
        Called with the faces done and the faces in all.

    Raises
    ------
    ConfigError
        For a number that makes no sense, or limits that exclude each other.
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
    sites = [OpenDirections(mesh, int(rows[o]), s) for o, s in zip(owner, sign, strict=True)]

    check_clearance(clearance)
    enclosure = Enclosure(mesh)
    for site in sites:
        site.proof = enclosure.proof(site.face, site.normal, least, clearance, keep_out)
    levels = [(side, 1), (side, 4)] + ([(finest, 4)] if finest > side else [])
    waiting = [site for site in sites if not site.proof]
    done = n_sites - len(waiting)
    for level in levels:
        if not waiting:
            break
        with Hemicube(mesh, level[0]) as hemicube:
            closed: list[OpenDirections] = []
            for site in waiting:
                site.look_out(hemicube, level[1], camera, framing, clearance)
                if site.rays is None and level != levels[-1]:
                    closed.append(site)
                else:
                    done += 1
                    progress(done, n_sites)
            waiting = closed
    progress(n_sites, n_sites)
    _stand(sites, mesh, framing, clearance, keep_out, views)
    return _gathered(rows, owner, sites, framing, least)


def _stand(
    sites: Sequence[OpenDirections],
    mesh: Mesh,
    framing: Framing,
    clearance: float,
    keep_out: Sequence[KeepOut],
    views: int,
) -> None:
    """Give each site the poses at which a camera can stand, the first rays first."""
    open_sites = [site for site in sites if site.rays is not None]
    for first in (True, False):
        block: list[tuple[OpenDirections, FloatArray, IntArray]] = []
        size = 0
        for site in (s for s in open_sites if not s.poses):
            part = slice(0, site.n_first) if first else slice(site.n_first, None)
            eyes, ray = site.eyes(part)
            site.n_places += len(eyes)
            block.append((site, eyes, ray))
            size += len(eyes)
            if size >= PLACES_AT_ONCE:
                _judge(block, mesh, framing, clearance, keep_out, views)
                block, size = [], 0
        _judge(block, mesh, framing, clearance, keep_out, views)


def _judge(
    block: Sequence[tuple[OpenDirections, FloatArray, IntArray]],
    mesh: Mesh,
    framing: Framing,
    clearance: float,
    keep_out: Sequence[KeepOut],
    views: int,
) -> None:
    """Keep the nearest place on each ray where a camera can stand, for sites of one block."""
    eyes = np.concatenate([eyes for _, eyes, _ in block]) if block else np.zeros((0, 3))
    if not len(eyes):
        return
    targets = np.concatenate([np.broadcast_to(s.target, e.shape) for s, e, _ in block])
    poses = look_at(eyes, targets, framing.up)
    stands = kept(Candidates.of(poses, "cavity"), mesh, clearance, keep_out)[1].kept_mask
    start = 0
    for site, of_site, ray in block:
        rows = start + np.flatnonzero(stands[start : start + len(of_site)])
        start += len(of_site)
        _, nearest = np.unique(ray[rows - (start - len(of_site))], return_index=True)
        good = poses[rows[nearest]]
        chosen = far_apart(-good[:, :3, 2], np.arange(len(good)), math.radians(APART_DEG), views)
        site.poses = list(good[chosen])


def _gathered(
    rows: IntArray, owner: IntArray, sites: Sequence[OpenDirections], framing: Framing, least: float
) -> Openings:
    """Openings of the faces, each by its better side."""
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
    rolled = np.repeat(upright[:, None], len(framing.rolls_deg), axis=1)
    rolled[:, :, :3, :3] = rolled_frames(upright[:, :3, :3], framing.rolls_deg)
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
        candidates=Candidates.of(
            rolled.reshape(-1, 4, 4), "cavity", np.repeat(index, len(framing.rolls_deg))
        ),
    )


def _access(site: OpenDirections) -> Access:
    if site.proof:
        return Access.ENCLOSED
    if site.rays is None:
        return Access.CLOSED
    return Access.REACHED if site.poses else Access.NO_ROOM
