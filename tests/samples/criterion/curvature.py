"""Curvature of the surface: a sensor cannot measure where the surface bends too sharply."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge
from typing_extensions import Doc

from rastercov.base.arguments import BoolArray, FloatArray
from rastercov.core.coverage.criterion import Criterion, Wording, Words
from rastercov.core.mesh import Mesh


def radii(mesh: Mesh) -> FloatArray:
    """(F,) least radius of curvature across the edges of each face, m; inf for plane ones.

    Two faces whose normals differ by an angle t, and whose centroids are d apart, lie on a circle
    of radius d / (2 sin(t / 2)).
    """
    one, other = mesh.topology.neighbours.T
    distance = np.linalg.norm(mesh.centroids[one] - mesh.centroids[other], axis=1)
    chord = np.linalg.norm(mesh.normals[one] - mesh.normals[other], axis=1)
    result = np.full(mesh.n_faces, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(chord > 1e-9, distance / chord, np.inf)
    np.minimum.at(result, one, radius)
    np.minimum.at(result, other, radius)
    return result


@dataclass(frozen=True, kw_only=True)
class Curvature(Criterion):
    """Faces that bend too sharply fail."""

    min_radius: Annotated[float, Ge(0), Doc("Least radius of curvature of the surface, m.")] = 0.0

    _wording = Wording(
        {
            "too_curved": Words(
                "too curved", "bend too sharply to be measured", "use a finer sensor", (90, 60, 20)
            )
        },
        {"min_radius": lambda value: f"with a radius of curvature of {value:g} m or more"},
    )

    def _fails(self, mesh: Mesh) -> BoolArray:
        return radii(mesh) < self.min_radius
