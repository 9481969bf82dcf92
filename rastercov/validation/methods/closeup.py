"""Close-up of one face: true polygons around it, and positions of samples."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import RastercovError
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limit
from rastercov.camera.projection import to_camera, to_image
from rastercov.mesh import Mesh
from rastercov.raster.sample_grid import SampleGrid

FloatArray = NDArray[np.float64]
Box = tuple[float, float, float]
"""Square part of the image: left, top, side, px."""

MAX_FACES = 800
"""Largest number of faces that are drawn around one: more are slow and cannot be read."""


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """True polygons of the faces around one face, by shapely."""

    image: Any  # the part of the face inside the image
    seen: Any  # its visible part
    hidden: Any  # the rest
    others: list[tuple[Any, float]]  # of opaque faces: visible part, |cos| of the incidence


def neighbourhood(mesh: Mesh, camera: Camera, pose: FloatArray, face: int) -> Neighbourhood | None:
    """True polygons around a face, from the faces that overlap its surroundings.

    None for a lens that is no pinhole, whose image has no polygons.
    """
    if not camera.is_pinhole:
        return None
    from rastercov.reference.polygons import visible_polygons

    near = float(near_limit(camera, mesh.opaque.bounds, pose[None])[0])
    points = to_camera(mesh.vertices, pose)
    ahead = points[:, 2] >= near
    image = to_image(np.where(ahead[:, None], points, (0.0, 0.0, 1.0)), camera)
    corners, is_ahead = image[mesh.faces], ahead[mesh.faces]
    is_cut = np.logical_and(is_ahead.any(axis=1), ~is_ahead.all(axis=1))
    if is_cut[face]:
        box = (0.0, 0.0, float(max(camera.width, camera.height)))
    else:
        low, high = corners[face].min(axis=0), corners[face].max(axis=0)
        edge = (camera.width, camera.height)
        low, high = np.clip(low, 0, edge), np.clip(high, 0, edge)
        box = square((*low.tolist(), *high.tolist()), 1.35)
    low, high = np.array(box[:2]), np.array(box[:2]) + box[2]
    is_beyond = (corners.max(axis=1) < low).any(axis=1) | (corners.min(axis=1) > high).any(axis=1)
    kept = np.flatnonzero((~is_beyond & is_ahead.all(axis=1)) | is_cut)
    place = int(np.searchsorted(kept, face))
    if place == len(kept) or kept[place] != face:
        return None
    part = Mesh(mesh.vertices, mesh.faces[kept], mesh.groups, mesh.face_group[kept])
    asked = np.arange(len(kept)) if len(kept) <= MAX_FACES else np.array([place])
    try:
        alone = Mesh(vertices=mesh.vertices, faces=mesh.faces[[face]])
        outline = visible_polygons(alone, camera, pose, near=near)[0]
        shapes = visible_polygons(part, camera, pose, asked, near=near)
    except RastercovError:
        return None
    if outline.is_empty:
        return None
    seen = shapes[int(np.searchsorted(asked, place))]
    ray = part.centroids - pose[:3, 3]
    reach = np.maximum(np.linalg.norm(ray, axis=1), 1e-300)
    squarely = np.abs((part.normals * ray).sum(axis=1)) / reach
    others = [
        (shape, float(squarely[i]))
        for i, shape in zip(asked, shapes, strict=True)
        if i != place and not part.target_mask[i]
    ]
    return Neighbourhood(outline, seen, outline.difference(seen), others)


def square(bounds: Sequence[float], room: float) -> Box:
    """Square about a box (left, top, right, bottom), larger by a factor."""
    left, top, right, bottom = bounds
    side = max(right - left, bottom - top, 1e-9) * room
    return (left + right - side) / 2, (top + bottom - side) / 2, side


class Samples:
    """Sample positions of a rasteriser, see `raster.sample_grid`."""

    def __init__(self, camera: Camera, supersample: int, roll: float) -> None:
        grid = SampleGrid(camera, supersample, roll)
        angle = math.remainder(roll, math.pi / 2)
        self.supersample = supersample
        self._size = np.array((camera.width, camera.height), np.float64)
        self._centre = np.array((grid.width, grid.height)) / 2
        self._turn = np.array(
            ((math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle)))
        )

    def inside(self, box: Box) -> FloatArray:
        """Samples in a square part of the image, (N, 2) px."""
        left, top, side = box
        corners = np.array([(u, v) for u in (left, left + side) for v in (top, top + side)])
        places = self.supersample * (corners - self._size / 2) @ self._turn.T + self._centre
        low, high = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
        x, y = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True)))
        local = np.stack((x.ravel(), y.ravel()), axis=1) - self._centre
        points = local @ self._turn / self.supersample + self._size / 2
        least = np.maximum((left, top), 0.0)
        most = np.minimum((left + side, top + side), self._size)
        is_below, is_above = (points < least).any(axis=1), (points > most).any(axis=1)
        found: FloatArray = points[~(is_below | is_above)]
        return found
