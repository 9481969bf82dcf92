"""Base of the strategies that draw and count for the OpenGL rasteriser.

`rasterizer` owns the contract, the context and the self-test; a strategy owns the programs and the
images: `pipeline` with the graphics pipeline, `compute` with compute shaders.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.near_plane import near_limit
from rastercov.raster.gl.resources import Resources, set_uniforms
from rastercov.raster.sample_grid import Box
from rastercov.raster.targets import TargetFaces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
WordArray = NDArray[np.uint32]
Counts = IntArray | WordArray

MAX_TILE = 8192
"""Largest side of one image on the device, in samples; larger images are drawn in tiles."""
MAX_FACES_A_DRAW = 1 << 26
"""Keeps the indices of one draw, and its counters, within 32-bit sizes."""
IMAGE_BUDGET = 512 << 20
"""Bytes of face indices and depth in one batch of poses."""
COUNTER_BYTES = 4
COUNT_COLUMNS, COUNT_ROWS = 8 * 16, 8
"""Samples of a workgroup of `count.comp`: 8 x 8 invocations, each a run of 16 samples of a row."""


@dataclass(frozen=True)
class DrawLimits:
    """Limits below those of the device.

    Samples a side, faces a draw, bytes of images a batch, poses a draw of the pipeline.
    """

    max_tile: int = MAX_TILE
    max_faces: int = MAX_FACES_A_DRAW
    image_budget: int = IMAGE_BUDGET
    max_layers: int = 1


class Strategy:
    """Programs and images on a device, for one mesh and camera: what both plans share.

    `Pipeline` and `Compute` add these methods; `scene` and `prepared` are records of their own.

    - `scene(mesh, camera, grid)` uploads a mesh; the result has `mesh`, `camera` and `grid`.
    - `prepare(scene, poses, grid)` computes what shaders need of poses; the result has `clipped`,
      (P,) bool.
    - `batches(prepared)` yields the rows of the poses of each batch, as indices or as a slice.
    - `begin(prepared, rows)` uploads the poses of a batch.
    - `count(scene, prepared, rows, tile, drawn=...)` draws a batch into a tile: visible samples
      (B, F), background (B,), drawn samples.
    - `image(scene, prepared, tile)` draws the first pose into a tile: faces and depths, as in
      `VisibilityBuffer`.

    Attributes
    ----------
    depth : str
        Description of the depth buffer, as in `RasterizerInfo`.
    tile : (width, height)
        Largest part of a canvas that is drawn at once.
    """

    depth: str
    tile: tuple[int, int]
    prepare: Any
    begin: Any
    image: Any
    _counting: Any
    _counters: Any

    def __init__(self, resources: Resources) -> None:
        self._resources = resources

    def count_targets(
        self, scene: Any, targets: TargetFaces, poses: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Visible and drawn samples of the targets, (P, N) each.

        They are counted on the CPU: the depths of each pose are read back.
        """
        visible, drawn = np.empty((2, len(poses), len(targets.rows)), np.int64)
        grid, near = scene.grid, near_limit(scene.camera, scene.mesh.bounds, poses)
        for row in range(len(poses)):
            depths = partial(self._depths, scene, poses[row : row + 1])
            visible[row], drawn[row] = targets.count(grid, poses[row], near[row], depths)
        return visible, drawn

    def _depths(
        self, scene: Any, pose: FloatArray, top: int, bottom: int
    ) -> Iterator[tuple[Box, NDArray[np.float32]]]:
        """Depths of one pose, (1, 4, 4), in tiles that hold some rows; see `targets.Depths`."""
        prepared = self.prepare(scene, pose, scene.grid)
        self.begin(prepared, slice(0, 1))
        for tile in scene.grid.tiles(self.tile):
            if tile[1] < bottom and tile[1] + tile[3] > top:
                yield tile, self.image(scene, prepared, tile)[1]

    def _count_on_device(self, scene: Any, tile: Box, n_poses: int) -> tuple[WordArray, WordArray]:
        """Count the faces of a batch in a compute shader, in windows of faces that fit."""
        groups = -(-tile[2] // COUNT_COLUMNS), -(-tile[3] // COUNT_ROWS), n_poses
        windows = []
        for first, n in scene.parts:
            set_uniforms(
                self._counting, size=tile[2:], corner=tile[:2], stride=n + 1, first_face=first
            )
            self._resources.zero(self._counters, COUNTER_BYTES * n_poses * (n + 1))
            self._counting.run(*groups)
            windows.append(self._resources.read_words(self._counters, n_poses, n + 1))
        return without_background(windows), windows[0][:, 0]


def face_ranges(n_faces: int, max_faces: int) -> list[tuple[int, int]]:
    """Ranges (first, n) that cover all faces with at most `max_faces` each."""
    return [(first, min(max_faces, n_faces - first)) for first in range(0, n_faces, max_faces)]


def without_background(windows: list[WordArray]) -> WordArray:
    """Counters (B, F) of all faces, from windows of faces that each start with the background."""
    if len(windows) == 1:
        return windows[0][:, 1:]  # a view: copies dominate the host's time
    return np.concatenate([window[:, 1:] for window in windows], axis=1)
