"""Bivalent occlusion: a point is hidden if the segment to the camera centre meets another face.

The segment begins at distance `MARGIN` from the point, so faces that only touch it there hide
nothing: neither faces that share a vertex, nor a face on which the point lies, nor a copy of its
own face. It ends at the near plane of `near_limit`, as for the engine. All faces hide,
including occluders and back faces, except faces without area or seen edge-on.

The models that sample points use it: `zhang`, `mavrinac`, `alarcon`. Their papers leave open the
case of a point on a face, as every vertex is.
"""

from functools import cached_property

import numpy as np

from rastercov.base import BoolArray, FloatArray
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.contacts import BOX_MARGIN, TriangleTree
from rastercov.reference.coverage import depth_from_near

MARGIN = 1e-4
"""Distance from the point, in diagonals of the mesh, up to which a surface hides nothing."""


class LineOfSight:
    """Occlusion of points by the faces of a mesh, except those of targets."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh.opaque
        self._faces = self._mesh.faces[~self._mesh.degenerate_mask]

    @cached_property
    def _tree(self) -> TriangleTree:
        """The faces, in a scene of diagonal 1 about the origin."""
        return TriangleTree.over(self._place(self._mesh.vertices), self._faces, margin=BOX_MARGIN)

    def _place(self, points: FloatArray) -> FloatArray:
        return (points - self._mesh.centre) / self._mesh.diagonal

    def find_hidden(
        self, points: FloatArray, pose: FloatArray, near: float, camera: Camera
    ) -> BoolArray:
        """Points with a face between them and the camera centre.

        Parameters
        ----------
        points : (N, 3) float64
            World points, metres.
        pose : (4, 4) float64
            world_from_camera.
        near : float
            Depth of the near plane, metres; points in front of it are not hidden.
        camera : Camera
            One of a wide lens has a cube of near planes, see `criteria.depth_from_near`.

        Returns
        -------
        (N,) bool
        """
        if not len(self._faces) or not len(points):
            return np.zeros(len(points), bool)
        to_eye = pose[:3, 3] - points
        length = np.linalg.norm(to_eye, axis=1)
        depth = depth_from_near(-to_eye @ pose[:3, :3], camera)
        ahead = depth > near
        # The part of the segment beyond the near plane, in diagonals.
        reach = np.where(ahead, length * (1 - near / np.where(ahead, depth, 1.0)), 0.0)
        reach = reach / self._mesh.diagonal - MARGIN
        direction = to_eye / np.where(length > 0, length, 1.0)[:, None]
        origin = self._place(points) + MARGIN * direction
        own = np.full(len(points), -1)
        return self._tree.first_hits(origin, direction, reach, own) >= 0
