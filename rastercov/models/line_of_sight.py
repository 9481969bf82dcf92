"""Bivalent occlusion: whether the segment from a point to the camera centre meets another face.

Serves the models that decide by points: `zhang`, `mavrinac`, `alarcon`. Their papers leave open
what happens where the point itself lies on faces, as every vertex does. Here the segment begins
`MARGIN` before the point, so that faces which only touch it there hide nothing: neither those that
share a vertex, nor one that the point rests on, nor a second copy of its own. It ends where the
near plane of `projection.near_limit` cuts surfaces away, as for the engine. All faces hide,
occluders and back faces included, but not those without area or seen edge-on.

Two tracers answer: Embree (package embreex, float32) and loops of our own (float64, about five
times slower). They may differ where a segment passes within `TOLERANCE` of an edge of a face, or
begins that near to the plane of one: on the parts in `rastercov.shapes` at one vertex in a hundred
thousand.

I. Wald et al. Embree: A Kernel Framework for Efficient CPU Ray Tracing. 2014.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import ConfigError
from rastercov.mesh import Mesh, contact_kernels
from rastercov.models import line_of_sight_kernels as kernels

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MARGIN = 1e-4
"""Of the mesh's diagonal: what is nearer to the point than this, towards the camera, hides nothing.
A tenth of that and float32, in which Embree works, takes ten times as many faces that are seen at a
grazing angle for hidden by themselves."""
TOLERANCE = 1e-6
"""Of the mesh's diagonal: how near to an edge or a plane the tracers may disagree."""
TRACERS = ("auto", "embree", "own")


class Tracer(Protocol):
    """Finds the segments that meet a face; the scene measures 1 about the origin."""

    name: str

    def meets(self, origins: FloatArray, directions: FloatArray, reaches: FloatArray) -> BoolArray:
        """Whether each of N segments meets a face: (N, 3), (N, 3) unit vectors, (N,) lengths."""
        ...


class LineOfSight:
    """Which points of a scene its own faces hide from a camera centre.

    Parameters
    ----------
    mesh : Mesh
        The faces that hide.
    tracer : {"auto", "embree", "own"}
        "auto" is Embree where embreex is installed, our own loops elsewhere.

    Raises
    ------
    ConfigError
        For a tracer that does not exist or is not installed.
    """

    def __init__(self, mesh: Mesh, tracer: str = "auto") -> None:
        check_tracer(tracer)
        self._centre = mesh.bounds.mean(axis=0)
        self._diagonal = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        faces = mesh.faces[~mesh.degenerate_mask]
        self._tracer: Tracer | None = None
        if len(faces):
            self._tracer = _open(tracer, self._placed(mesh.vertices)[faces])

    def _placed(self, points: FloatArray) -> FloatArray:
        placed: FloatArray = (points - self._centre) / self._diagonal
        return placed

    def hidden(self, points: FloatArray, pose: FloatArray, near: float) -> BoolArray:
        """Whether a face stands between each point and the camera centre.

        Parameters
        ----------
        points : (N, 3) float64
            World points, metres.
        pose : (4, 4) float64
            world_from_camera.
        near : float
            Depth of the near plane, metres; points before it are not hidden.

        Returns
        -------
        (N,) bool
        """
        if self._tracer is None or not len(points):
            return np.zeros(len(points), dtype=bool)
        to_eye = pose[:3, 3] - points
        length = np.linalg.norm(to_eye, axis=1)
        depth = -(to_eye @ pose[:3, 2])
        ahead = depth > near
        # The part of the segment beyond the near plane, in diagonals.
        reach = np.where(ahead, length * (1 - near / np.where(ahead, depth, 1.0)), 0.0)
        direction = to_eye / np.where(length > 0, length, 1.0)[:, None]
        origin = self._placed(points) + MARGIN * direction
        return self._tracer.meets(origin, direction, reach / self._diagonal - MARGIN)

    @property
    def tracer(self) -> str:
        """Name of the tracer that answers."""
        return self._tracer.name if self._tracer else "own"


def check_tracer(tracer: str) -> None:
    """Raise `ConfigError` for a tracer that does not exist."""
    if tracer not in TRACERS:
        raise ConfigError(
            f"tracer must be {', '.join(TRACERS[:-1])} or {TRACERS[-1]}, got {tracer!r}"
        )


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


class OwnTracer:
    """Segments by compiled loops over a tree of boxes, in float64."""

    name = "own"

    def __init__(self, corners: FloatArray) -> None:
        points = np.ascontiguousarray(corners.reshape(-1, 3))
        faces = np.arange(len(points)).reshape(-1, 3)
        keys = np.empty(len(faces), np.uint64)
        contact_kernels.order_keys(points, faces, keys)
        order = np.argsort(keys, kind="stable")
        self._corners = np.ascontiguousarray(corners[order])
        last = -(-len(faces) // contact_kernels.LEAF)
        n_nodes = 2 << max((last - 1).bit_length(), 1)
        boxes, self._nodes = np.empty((len(faces), 6)), np.empty((n_nodes, 6))
        contact_kernels.grow_boxes(
            points, faces[order], boxes, self._nodes, np.empty(n_nodes, dtype=bool)
        )

    def meets(self, origins: FloatArray, directions: FloatArray, reaches: FloatArray) -> BoolArray:
        """See `Tracer.meets`."""
        found = np.empty(len(origins), dtype=bool)
        kernels.mark_hidden(
            origins, directions, reaches, self._corners, self._nodes, contact_kernels.LEAF, found
        )
        return found
