"""Open directions of one side of a face, and the rays along which a camera may see it.

Serves `cavities`. From a face and a hemicube, a few promising rays, each with the interval of
distances within which nothing blocks it and the whole face is in view.
"""

import math

import numpy as np

from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import look_at
from rastercov.mesh import Mesh
from rastercov.placement._arrays import FloatArray, IntArray
from rastercov.placement.candidates.framing import Framing, fit_vertices, rolled_frames
from rastercov.placement.candidates.hemicube import Hemicube

INSET = 0.5
"""Relative position of three more points of a face, from the centroid towards each corner."""
STEPS = 8
"""Number of distances tried along a direction, from the nearest that frames the face."""
APART_DEG = 15.0
"""Least angle between two views of a face."""
FIRST_RAYS, MORE_RAYS = 8, 256
"""Directions tried for a face, and further ones where no position on those is allowed."""
FARTHEST = 2.0
"""Greatest distance relative to the mesh's diagonal, where nothing else limits it."""


class OpenDirections:
    """Search for open directions in front of one side of a face.

    Attributes
    ----------
    proof : str
        Reason why no camera can see it, "" without a proof.
    n_points, n_directions, open_share, missed_deg, n_places
        As in `Openings`.
    rays : (M, 8) float64 or None
        Origin, direction, nearest and farthest distance; the best first. None where no direction
        is open.
    n_first : int
        Number of rays to try first.
    poses : list of (4, 4) float64
        Poses at allowed positions.
    """

    def __init__(
        self, mesh: Mesh, camera: Camera, framing: Framing, clearance: float, face: int, sign: float
    ) -> None:
        self.camera, self.framing, self.clearance, self.face = camera, framing, clearance, face
        self.limits = framing.limits(camera)
        self.normal: FloatArray = sign * mesh.normals[face]
        self.target: FloatArray = mesh.centroids[face]
        self.corners: FloatArray = mesh.vertices[mesh.faces[face]]
        self.reach = FARTHEST * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        self.proof = ""
        self.n_points, self.n_directions, self.n_places = 0, 0, 0
        self.open_share, self.missed_deg = 0.0, 0.0
        self.rays: FloatArray | None = None
        self.n_first = 0
        self.poses: list[FloatArray] = []

    def origins(self, n_points: int) -> FloatArray:
        """(n_points, 3) points of the face: the centroid, and three towards the corners."""
        inset = self.target + INSET * (self.corners - self.target)
        points: FloatArray = np.concatenate((self.target[None], inset))[:n_points]
        return points

    def search(self, hemicube: Hemicube, frame: FloatArray, free: FloatArray) -> None:
        """Find the open directions, and rank the rays to try.

        `free`, (n_points, D), are the free distances at the first `origins`.
        """
        origins = self.origins(len(free))
        is_open = free > self.limits[0]
        self.n_points, self.n_directions = len(free), len(hemicube.directions)
        self.missed_deg = math.degrees(2 * hemicube.missed)
        if not is_open.any():
            return
        self.open_share = float((is_open @ hemicube.solid_angles).max() / (2 * np.pi))
        # Rank: open from all points of the face, within a wide opening, close to the normal.
        share = is_open.mean(axis=0)
        wide = sum(hemicube.blurred(share, max(1, hemicube.side // n)) for n in (32, 8))
        score = share * wide * hemicube.directions[:, 2]
        order = np.argsort(-score, kind="stable")
        order = order[share[order] > 0]
        chosen = far_apart(hemicube.directions, order, math.radians(APART_DEG), FIRST_RAYS)
        more = order[:: max(1, len(order) // MORE_RAYS)]
        picks = np.concatenate((chosen, more))
        point = is_open[:, picks].argmax(axis=0)
        self.rays = np.empty((len(picks), 8))
        self.rays[:, :3] = origins[point]
        self.rays[:, 3:6] = hemicube.directions[picks] @ frame.T
        self.rays[:, 6] = self._nearest(self.rays[:, 3:6])
        top = np.minimum(self.limits[1], np.maximum(self.reach, 2 * self.rays[:, 6]))
        self.rays[:, 7] = np.minimum(top, free[point, picks] - self.clearance)
        self.n_first = len(chosen)

    def _nearest(self, directions: FloatArray) -> FloatArray:
        """(M,) distance from which the whole face is in view for every roll."""
        camera, framing = self.camera, self.framing
        upright = look_at(directions, np.zeros(3), framing.up)[:, :3, :3]
        frames = rolled_frames(upright, framing.rolls_deg)
        starts = np.arange(len(directions))
        seen = np.einsum("ki,mrij->rmkj", self.corners - self.target, frames)
        distances = [fit_vertices(camera, framing, of_roll, starts) for of_roll in seen]
        farthest: FloatArray = np.maximum(np.max(distances, axis=0), self.limits[0])
        return farthest

    def eyes(self, rays: slice) -> tuple[FloatArray, IntArray]:
        """(N, 3) positions along some of the rays, nearest first, and the ray of each."""
        if self.rays is None:
            return np.zeros((0, 3)), np.zeros(0, np.int64)
        chosen = self.rays[rays]
        fits = np.flatnonzero(chosen[:, 7] >= chosen[:, 6])
        low, high = chosen[fits, 6:7], chosen[fits, 7:8]
        distance = low * (high / low) ** (np.arange(STEPS) / (STEPS - 1))
        eyes = chosen[fits, None, :3] + distance[..., None] * chosen[fits, None, 3:6]
        eyes = eyes.reshape(-1, 3)
        # Rays may start off the centroid, to which the limits refer.
        away = np.linalg.norm(eyes - self.target, axis=1)
        tolerance = 1e-9 * away
        within = away >= self.limits[0] - tolerance
        within &= away <= self.limits[1] + tolerance
        return eyes[within], np.repeat(fits, STEPS)[within]


def far_apart(directions: FloatArray, order: IntArray, angle: float, most: int) -> IntArray:
    """First directions of an order, each at least `angle` apart from those before it."""
    chosen: list[int] = []
    left = order
    while len(left) and len(chosen) < most:
        chosen.append(int(left[0]))
        left = left[directions[left] @ directions[left[0]] < math.cos(angle)]
    return np.array(chosen, np.int64)
