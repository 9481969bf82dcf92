"""What a plan of the OpenGL rasteriser does for it: draw a scene into a tile and count the faces.

`gl` keeps the contract, the context and the trust; a plan keeps the programs and the images. There
are two: `pipeline`, which draws with the graphics pipeline, and `compute`, which does not.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.raster.sample_grid import Box, SampleGrid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
WordArray = NDArray[np.uint32]
Counts = IntArray | WordArray

MAX_TILE = 8192
"""Largest side of one image on the device, in samples; larger images are drawn in tiles."""
MAX_FACES_A_DRAW = 1 << 26
"""Keeps the indices of one draw, and its counters, within 32-bit sizes."""
IMAGE_BUDGET = 512 << 20
"""Bytes of ids and depth that one batch of poses may take."""


@dataclass(frozen=True)
class Limits:
    """Limits below those of the device: samples a side, faces a draw, bytes of images a batch."""

    tile: int = MAX_TILE
    faces: int = MAX_FACES_A_DRAW
    images: int = IMAGE_BUDGET


class Plan(Protocol):
    """Programs and images on a device, for one mesh and camera.

    Attributes
    ----------
    depth : str
        Depth buffer in use, as in `RasterizerInfo`.
    tile : (int, int)
        Width and height of the largest part of a canvas that is drawn at once.
    """

    depth: str
    tile: tuple[int, int]

    def scene(self, mesh: Mesh, camera: Camera, grid: SampleGrid) -> Any:
        """Send a mesh to the device; the scene has `mesh`, `camera` and `grid`."""
        ...

    def views(self, scene: Any, poses: FloatArray, grid: SampleGrid) -> Any:
        """Make poses ready to be drawn; the views have `clipped`, (P,) bool."""
        ...

    def batches(self, views: Any) -> Iterator[Any]:
        """Rows of poses to draw together, as indices or as a slice."""
        ...

    def begin(self, views: Any, rows: Any) -> None:
        """Send the poses of a batch to the device."""
        ...

    def count(
        self, scene: Any, views: Any, rows: Any, tile: Box, *, drawn: bool
    ) -> tuple[Counts, Any, Counts | None]:
        """Draw a batch into a tile: visible samples (B, F), background (B,), drawn samples."""
        ...

    def image(
        self, scene: Any, views: Any, tile: Box
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Draw the first of the views into a tile: faces and depths, as in `VisibilityBuffer`."""
        ...


def side_by_side(windows: list[WordArray]) -> WordArray:
    """Counters (B, F) of windows of faces, each with one for background before its first."""
    if len(windows) == 1:
        return windows[0][:, 1:]  # as it is: copies are what the host spends its time on
    return np.concatenate([window[:, 1:] for window in windows], axis=1)
