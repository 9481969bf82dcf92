"""Tracers of bivalent occlusion, see `rastercov.coverage.line_of_sight`.

The models that sample points use it: `zhang`, `mavrinac`, `alarcon`. Their papers leave open the
case of a point on a face, as every vertex is.

There are two tracers: Embree (package embreex, float32) and our own triangle tree (float64, about
five times slower). They may differ if a segment passes within `TOLERANCE` of an edge of a face, or
begins as near to its plane: on the meshes in `rastercov.mesh.shapes`, one vertex in 100,000.

I. Wald et al. Embree: A Kernel Framework for Efficient CPU Ray Tracing. 2014.
"""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.coverage import line_of_sight as own
from rastercov.coverage.line_of_sight import OwnTracer, Tracer
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TOLERANCE = 1e-6
"""Distance from an edge or a plane, in diagonals, within which the tracers may disagree."""
TRACERS = ("auto", "embree", "own")


class LineOfSight(own.LineOfSight):
    """Occlusion of points by the faces of a mesh, by a tracer of choice.

    Parameters
    ----------
    mesh : Mesh
        Its faces hide, except those of targets.
    tracer : {"auto", "embree", "own"}
        "auto" is Embree if embreex is installed, our own tree otherwise.

    Raises
    ------
    ConfigError
        For a tracer that does not exist or is not installed.
    """

    def __init__(self, mesh: Mesh, tracer: str = "auto") -> None:
        check_tracer(tracer)
        super().__init__(mesh, partial(_open, tracer))


def check_tracer(tracer: str) -> None:
    """Raise `ConfigError` for a tracer that does not exist."""
    check_choice("tracer", tracer, TRACERS)


def _open(tracer: str, corners: FloatArray) -> Tracer:
    if tracer == "own":
        return OwnTracer(corners)
    try:
        return EmbreeTracer(corners)
    except ImportError:
        if tracer == "auto":
            return OwnTracer(corners)
        raise ConfigError(
            "tracer embree needs the package embreex: pip install 'rastercov[models]', or take own"
        ) from None


class EmbreeTracer:
    """Segments by Embree, in float32; `corners` (T, 3, 3) are its triangles."""

    name = "embree"

    def __init__(self, corners: FloatArray) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene: Any = EmbreeScene(robust=True)
        TriangleMesh(self._scene, corners.astype(np.float32))

    def meets(self, origins: FloatArray, directions: FloatArray, reaches: FloatArray) -> BoolArray:
        """See `Tracer.meets`."""
        found = np.zeros(len(origins), dtype=bool)
        chosen = np.flatnonzero(reaches > 0)
        if chosen.size:
            start, along, reach = (
                values[chosen].astype(np.float32) for values in (origins, directions, reaches)
            )
            found[chosen] = self._scene.run(start, along, reach, query="OCCLUDED") >= 0
        return found
