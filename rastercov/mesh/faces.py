"""Quantities of faces that follow from the arrays of a mesh; each is computed once.

`rastercov.mesh.Mesh` inherits them.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rastercov.mesh.arrays import blocks, frozen, normals_and_areas
from rastercov.mesh.diagnosis import size_in_words
from rastercov.mesh.groups import Group
from rastercov.mesh.topology import first_equal_row


class Faces:
    """Faces with groups; arrays as of `Mesh`."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    groups: tuple[Group, ...]
    face_group: NDArray[np.int32]

    @property
    def n_faces(self) -> int:
        """Number of faces F."""
        return len(self.faces)

    @property
    def n_vertices(self) -> int:
        """Number of vertices V."""
        return len(self.vertices)

    @cached_property
    def task_mask(self) -> NDArray[np.bool_]:
        """(F,) faces that are scored, of the task or a target: all but the occluders."""
        scored = np.array([not group.is_occluder for group in self.groups])
        return frozen(scored[self.face_group])

    @cached_property
    def two_sided_mask(self) -> NDArray[np.bool_]:
        """(F,) faces that count as covered from either side."""
        two_sided = np.array([group.is_two_sided for group in self.groups])
        return frozen(two_sided[self.face_group])

    @cached_property
    def target_mask(self) -> NDArray[np.bool_]:
        """(F,) faces that are scored but hide nothing."""
        transparent = np.array([group.is_target for group in self.groups])
        return frozen(transparent[self.face_group])

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest coordinates of the vertices that faces use, metres."""
        is_used = np.zeros(self.n_vertices, dtype=bool)
        is_used[self.faces] = True
        used = self.vertices[is_used]
        return frozen(np.stack([used.min(axis=0), used.max(axis=0)]))

    @property
    def size_in_words(self) -> str:
        """Extent along x, y and z with its unit, such as "85 x 62 x 20 m"."""
        return size_in_words(np.ptp(self.bounds, axis=0))

    @cached_property
    def centroids(self) -> NDArray[np.float64]:
        """(F, 3) mean of each face's vertices, metres."""
        centroids = np.empty((self.n_faces, 3))
        for block in blocks(self.n_faces):
            centroids[block] = self.vertices[self.faces[block]].mean(axis=1)
        return frozen(centroids)

    @cached_property
    def _normals_and_areas(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        normals, areas, least_sine = normals_and_areas(self.vertices, self.faces)
        return frozen(normals), frozen(areas), least_sine

    @property
    def normals(self) -> NDArray[np.float64]:
        """(F, 3) unit normals, right-hand rule; 0 for degenerate faces."""
        return self._normals_and_areas[0]

    @cached_property
    def plane_offsets(self) -> NDArray[np.float64]:
        """(F,) scalar product of the normal and the centroid of each face, metres."""
        return frozen(np.einsum("fi,fi->f", self.normals, self.centroids))

    @property
    def areas(self) -> NDArray[np.float64]:
        """(F,) areas, m^2; exactly 0 for degenerate faces."""
        return self._normals_and_areas[1]

    @property
    def least_sine(self) -> float:
        """Least sine of the angle between the first two edges of a face that is not degenerate."""
        return self._normals_and_areas[2]

    @cached_property
    def degenerate_mask(self) -> NDArray[np.bool_]:
        """(F,) faces without area, to within rounding, or with a repeated vertex."""
        return frozen(~np.any(self.normals, axis=1))

    @cached_property
    def welded_faces(self) -> NDArray[np.int64]:
        """(F, 3) vertex indices like `faces`, the same one for all vertices at one point."""
        same = first_equal_row((self.vertices + 0.0).view(np.uint64))  # -0.0 + 0.0 is 0.0
        return frozen(same[self.faces])

    @cached_property
    def duplicate_mask(self) -> NDArray[np.bool_]:
        """(F,) later copies of a face: the same three positions, in any order."""
        same = first_equal_row(np.sort(self.welded_faces, axis=1).view(np.uint64))
        return frozen(same != np.arange(self.n_faces))
