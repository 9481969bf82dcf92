"""Interface between the OpenGL rasteriser and the strategies that draw and count.

`rasterizer` owns the contract, the context and the self-test; a strategy owns the programs and the
images. `pipeline` implements it with the graphics pipeline, `compute` with compute shaders.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limit
from rastercov.mesh import Mesh
from rastercov.raster.sample_grid import Box, SampleGrid
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


class Strategy(Protocol):
    """Programs and images on a device, for one mesh and camera.

    Constructed from `Resources` in use, the mesh, camera and grid of the largest scene to draw, and
    `DrawLimits`.

    Attributes
    ----------
    depth : str
        Description of the depth buffer, as in `RasterizerInfo`.
    """

    depth: str

    def scene(self, mesh: Mesh, camera: Camera, grid: SampleGrid) -> Any:
        """Upload a mesh; the result has `mesh`, `camera` and `grid`."""

    def tiles(self, scene: Any, grid: SampleGrid) -> Iterator[Box]:
        """Parts of a canvas that are drawn at once; together they are all of it."""

    def prepare(self, scene: Any, poses: FloatArray, grid: SampleGrid) -> Any:
        """Compute the per-pose data of the shaders; the result has `clipped`, (P,) bool."""

    def batches(self, prepared: Any) -> Iterator[Any]:
        """Rows of the poses of each batch, as indices or as a slice."""

    def begin(self, prepared: Any, rows: Any) -> None:
        """Upload the poses of a batch."""

    def count(
        self, scene: Any, prepared: Any, rows: Any, tile: Box, *, drawn: bool
    ) -> tuple[Counts, Any, Counts | None]:
        """Draw a batch into a tile: visible samples (B, F), background (B,), drawn samples."""

    def image(
        self, scene: Any, prepared: Any, tile: Box
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Draw the first pose into a tile: faces and depths, as in `VisibilityBuffer`."""

    def count_targets(
        self, scene: Any, targets: TargetFaces, poses: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Visible and drawn samples of the targets, (P, N) each."""


def count_targets_by_images(
    strategy: Strategy, scene: Any, targets: TargetFaces, poses: FloatArray
) -> tuple[IntArray, IntArray]:
    """`Strategy.count_targets` of pinholes, on the CPU: the depths of each pose are read back."""
    visible, drawn = np.empty((2, len(poses), len(targets.rows)), np.int64)
    grid, near = scene.grid, near_limit(scene.camera, scene.mesh.bounds, poses)
    for row in range(len(poses)):

        def depths(
            top: int, bottom: int, row: int = row
        ) -> Iterator[tuple[Box, NDArray[np.float32]]]:
            prepared = strategy.prepare(scene, poses[row : row + 1], grid)
            strategy.begin(prepared, np.array([0]))
            for tile in strategy.tiles(scene, grid):
                if tile[1] < bottom and tile[1] + tile[3] > top:
                    yield tile, strategy.image(scene, prepared, tile)[1]

        visible[row], drawn[row] = targets.count(grid, poses[row], near[row], depths)
    return visible, drawn


def face_ranges(n_faces: int, max_faces: int) -> list[tuple[int, int]]:
    """Ranges (first, n) that cover all faces with at most `max_faces` each."""
    return [(first, min(max_faces, n_faces - first)) for first in range(0, n_faces, max_faces)]


def workgroups(tile: Box) -> tuple[int, int]:
    """Workgroups of `count.comp` in x and y that cover a tile."""
    return -(-tile[2] // COUNT_COLUMNS), -(-tile[3] // COUNT_ROWS)


def without_background(windows: list[WordArray]) -> WordArray:
    """Counters (B, F) of all faces, from windows of faces that each start with the background."""
    if len(windows) == 1:
        return windows[0][:, 1:]  # a view: copies dominate the host's time
    return np.concatenate([window[:, 1:] for window in windows], axis=1)
