"""Bivalent occlusion: a point is hidden if the segment to the camera centre meets another face.

The segment begins at distance `MARGIN` from the point, so faces that only touch it there hide
nothing: neither faces that share a vertex, nor a face on which the point lies, nor a copy of its
own face. It ends at the near plane of `near_plane.near_limit`, as for the engine. All faces hide,
including occluders and back faces, except faces without area or seen edge-on.

The models that sample points use it: `zhang`, `mavrinac`, `alarcon`. Their papers leave open the
case of a point on a face, as every vertex is.

There are two tracers: Embree (package embreex, float32) and our own triangle tree (float64, about
five times slower). They may differ if a segment passes within `TOLERANCE` of an edge of a face, or
begins as near to its plane: on the meshes in `rastercov.mesh.shapes`, one vertex in 100,000.

I. Wald et al. Embree: A Kernel Framework for Efficient CPU Ray Tracing. 2014.
"""

from typing import Any, Protocol

import numpy as np

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import BOX_MARGIN, TriangleTree
from rastercov.reference.criteria import depth_from_near

MARGIN = 1e-4
"""Distance from the point, in diagonals of the mesh, up to which a surface hides nothing. With a
tenth of it a tracer in float32 reports ten times as many faces at grazing angles as hidden by
themselves."""


class Tracer(Protocol):
    """Finder of segments that meet a face, in a scene of diagonal 1 about the origin."""

    name: str

    def meets(self, origins: FloatArray, directions: FloatArray, reaches: FloatArray) -> BoolArray:
        """(N,) segments that meet a face: start (N, 3), unit vector (N, 3), length (N,)."""
        ...


class OwnTracer:
    """Segments by the triangle tree, in float64; `corners` (T, 3, 3) are its triangles."""

    name = "own"

    def __init__(self, corners: FloatArray) -> None:
        points = corners.reshape(-1, 3)
        faces = np.arange(len(points)).reshape(-1, 3)
        self._tree = TriangleTree.over(points, faces, margin=BOX_MARGIN)

    def meets(self, origins: FloatArray, directions: FloatArray, reaches: FloatArray) -> BoolArray:
        """See `Tracer.meets`."""
        own = np.full(len(origins), -1)
        return self._tree.first_hits(origins, directions, reaches, own) >= 0


TOLERANCE = 1e-6
"""Distance from an edge or a plane, in diagonals, within which the tracers may disagree."""
TRACERS = ("auto", "embree", "own")


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


class LineOfSight:
    """Occlusion of points by the faces of a mesh, as seen from a camera centre.

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
        mesh = mesh.opaque
        self._centre = mesh.bounds.mean(axis=0)
        self._diagonal = mesh.diagonal
        faces = mesh.faces[~mesh.degenerate_mask]
        self._tracer: Tracer | None = None
        if len(faces):
            self._tracer = _open(tracer, self._placed(mesh.vertices)[faces])

    def _placed(self, points: FloatArray) -> FloatArray:
        return (points - self._centre) / self._diagonal

    def hidden(
        self, points: FloatArray, pose: FloatArray, near: float, camera: Camera | None = None
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
        camera : Camera, optional
            One of a wide lens has a cube of near planes, see `criteria.depth_from_near`.

        Returns
        -------
        (N,) bool
        """
        if self._tracer is None or not len(points):
            return np.zeros(len(points), dtype=bool)
        to_eye = pose[:3, 3] - points
        length = np.linalg.norm(to_eye, axis=1)
        depth = -(to_eye @ pose[:3, 2])
        if camera is not None and not camera.is_pinhole:
            depth = depth_from_near(-to_eye @ pose[:3, :3], camera)
        ahead = depth > near
        # The part of the segment beyond the near plane, in diagonals.
        reach = np.where(ahead, length * (1 - near / np.where(ahead, depth, 1.0)), 0.0)
        direction = to_eye / np.where(length > 0, length, 1.0)[:, None]
        origin = self._placed(points) + MARGIN * direction
        return self._tracer.meets(origin, direction, reach / self._diagonal - MARGIN)

    def hides(
        self,
        mesh: Mesh,
        wanted: BoolArray,
        pose: FloatArray,
        near: float,
        camera: Camera | None = None,
    ) -> BoolArray:
        """(F, 3) corners of the mesh at hidden vertices; only those of wanted corners are traced.

        `wanted` is (F,) or (F, 3).
        """
        vertices = np.unique(mesh.faces[wanted])
        hidden = np.zeros(mesh.n_vertices, dtype=bool)
        hidden[vertices] = self.hidden(mesh.vertices[vertices], pose, near, camera)
        return hidden[mesh.faces]

    @property
    def tracer(self) -> str:
        """Name of the tracer that answers."""
        return self._tracer.name if self._tracer else "own"


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
