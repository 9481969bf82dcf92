"""Edges of a mesh that a photograph shows: borders, creases and silhouettes, as points on them.

An edge is drawn where the surface ends (one face), where it is nonmanifold, where its two faces
meet at more than `CREASE_DEG`, and where one faces the camera and the other does not. A point of it
is visible where an image of depths holds nothing nearer around its pixel.
"""

from dataclasses import dataclass

import numpy as np

from rastercov.asbuilt.resection import pixels_in_axes
from rastercov.base import BoolArray, FloatArray, IntArray, dots, norm, owners_of
from rastercov.core.camera import Camera
from rastercov.core.camera.lenses.of_camera import planes_of
from rastercov.core.camera.projection import to_camera
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.topology import edge_table
from rastercov.core.raster.contract import Rasterizer

CREASE_DEG = 25.0
"""Angle between the normals of two faces above which their edge is drawn, degrees."""
MOST_POINTS = 6_000
"""Most points of edges; of more, every nth."""
DEPTH_SLACK = 2e-3
"""Part of its depth by which a point may lie behind the nearest surface and still be visible."""


@dataclass(frozen=True)
class MeshEdges:
    """Edges that can be drawn, each with the planes of its two faces.

    Attributes
    ----------
    start, end : (E, 3) float64
        World points, metres.
    normals : (E, 2, 3) float64
        Of the first two faces; twice the same where there is one.
    is_drawn : (E,) bool
        True of borders and creases, drawn from everywhere.
    height : (E, 2) float64
        Of the planes of its faces above the origin, along their normals, metres.
    """

    start: FloatArray
    end: FloatArray
    normals: FloatArray
    is_drawn: BoolArray
    height: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> "MeshEdges":
        """Edges of a mesh; those within a plane are left out, they are never drawn."""
        table = edge_table(mesh.welded_faces, mesh.n_vertices)
        first, n_uses = table.first, table.n_uses
        pair = table.faces[np.stack((first, first + (n_uses > 1)), axis=1)]
        normals = mesh.normals[pair]
        cosine = dots(normals[:, 0], normals[:, 1])
        is_drawn = (n_uses != 2) | (cosine < np.cos(np.radians(CREASE_DEG)))
        kept = is_drawn | (cosine < 1 - 1e-9)
        ends = mesh.vertices[table.vertices[kept].astype(np.int64)]
        start, normals = ends[:, 0], normals[kept]
        height = np.einsum("ei,eki->ek", start, normals)
        return cls(start, ends[:, 1], normals, is_drawn[kept], height)


@dataclass(frozen=True)
class EdgePoints:
    """Points of visible edges.

    Attributes
    ----------
    points : (N, 3) float64
        World points, metres.
    tangents : (N, 3) float64
        Unit vectors along their edges.
    edge : (N,) int64
        Number of the edge of each.
    """

    points: FloatArray
    tangents: FloatArray
    edge: IntArray

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: "IntArray | BoolArray | slice") -> "EdgePoints":
        """Some of the points."""
        return EdgePoints(self.points[rows], self.tangents[rows], self.edge[rows])

    def thinned(self, most: int) -> "EdgePoints":
        """Every nth of the points, so that there are at most as many as given."""
        return self.take(slice(None, None, max(1, -(-len(self) // most))))


def visible_points(
    edges: MeshEdges, rasterizer: Rasterizer, pose: FloatArray, step: float
) -> EdgePoints:
    """Points of the edges that are visible in a pose, about `step` pixels apart.

    The image of depths is that of the rasteriser's camera, whose pixels the step counts.
    """
    camera = rasterizer.camera
    rows = np.flatnonzero(edges.is_drawn | _is_silhouette(edges, camera, pose))
    local = to_camera(np.stack((edges.start[rows], edges.end[rows])), pose)
    low, high = _part_in_front(local, camera)
    count, starts = _counts(local, low, high, camera, step)
    owner = owners_of(count)
    place = np.arange(len(owner)) - starts[owner] + 0.5
    share = low[owner] + (high - low)[owner] * place / count[owner]
    start, end = edges.start[rows[owner]], edges.end[rows[owner]]
    along = end - start
    points = start + share[:, None] * along
    tangents = along / np.maximum(norm(along)[..., None], 1e-300)
    found = EdgePoints(points, tangents, rows[owner]).thinned(4 * MOST_POINTS)
    return found.take(_is_visible(found.points, rasterizer, pose)).thinned(MOST_POINTS)


def _is_silhouette(edges: MeshEdges, camera: Camera, pose: FloatArray) -> BoolArray:
    """True where one face of an edge faces the camera and the other does not."""
    towards, height = (-pose[:3, 2], 0) if camera.is_parallel else (pose[:3, 3], edges.height)
    faces = np.einsum("i,eki->ek", towards, edges.normals) > height
    return np.asarray(faces[:, 0] != faces[:, 1])


def _part_in_front(local: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Part of each edge, 0 to 1, that is in front of a camera with an ideal plane; whole else."""
    if not camera.is_pinhole or camera.is_parallel:
        return np.zeros(local.shape[1]), np.ones(local.shape[1])
    nearest = max(camera.near, 1e-4 * float(np.abs(local[..., 2]).max(initial=1e-9)))
    first, last = local[0, :, 2] - nearest, local[1, :, 2] - nearest
    with np.errstate(all="ignore"):
        crossing = first / (first - last)
    low = np.where(first < 0, crossing, 0)
    high = np.where(last < 0, crossing, 1)  # both are the same where both ends are behind
    return np.nan_to_num(low), np.nan_to_num(high)


def _counts(
    local: FloatArray, low: FloatArray, high: FloatArray, camera: Camera, step: float
) -> tuple[IntArray, IntArray]:
    """Points of each edge, by the length of its image, and the number of the first of each."""
    parts = [low + (high - low) * share for share in (0.0, 0.5, 1.0)]
    places = np.stack([local[0] + part[:, None] * (local[1] - local[0]) for part in parts])
    pixels = pixels_in_axes(places, camera)
    limits = np.array((camera.width, camera.height))
    middle = np.clip(np.nan_to_num(pixels, nan=-1e6), -limits, 2 * limits)
    length = norm(np.diff(middle, axis=0)).sum(axis=0)
    count = np.where(high > low, np.ceil(length / step), 0).astype(np.int64)
    return count, np.cumsum(count) - count


def _is_visible(points: FloatArray, rasterizer: Rasterizer, pose: FloatArray) -> BoolArray:
    """True of points within the image before which an image of depths has nothing nearer."""
    camera = rasterizer.camera
    farthest = np.pad(rasterizer.render(pose).depth, 1, mode="edge")
    for _ in range(2):
        farthest = np.maximum(np.maximum(farthest[:-2], farthest[1:-1]), farthest[2:]).T
    local = to_camera(points, pose)
    pixels = pixels_in_axes(local, camera)
    inside = np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(np.int64).T
    is_wide = camera.is_curved and len(planes_of(camera)) > 1  # of depths along rays
    own = norm(local) if is_wide else local[:, 2]
    return inside & (own <= farthest[row, column] * (1 + DEPTH_SLACK))
