"""Strategy of the plan "compute" for cameras that are no pinholes.

The steps are those of `compute`. What differs is where samples are: not in rows of an image plane,
but at the places of ideal planes whose rays they see (`lens_places`). `shaders/lens.comp.glsl`
draws a face in each plane on the samples of that plane, and tests them as the CPU does
(`rastercov.kernels.raster_lens`). Tiles of an image are bands of rows, as the CPU's tables are.

Targets are drawn by the same program, which then counts their samples against the depths that the
other faces have left on the device.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ResourceError
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import limits as limits_of
from rastercov.kernels.raster_lens_records import BLOCK
from rastercov.mesh import Mesh
from rastercov.raster import self_test
from rastercov.raster.cpu.lens_samples import MAX_TABLE, SampleTables, tables_of
from rastercov.raster.gl.compute import (
    KEY_BYTES,
    Compute,
    ComputeScene,
    Sizes,
)
from rastercov.raster.gl.lens_places import BLOCK_RECORD, VIEW, Band, Places
from rastercov.raster.gl.resources import Resources
from rastercov.raster.gl.strategy import (
    DrawLimits,
    FloatArray,
    IntArray,
    face_ranges,
    without_background,
)
from rastercov.raster.sample_grid import Box, SampleGrid
from rastercov.raster.targets import TargetFaces

SMALL = 512
"""Samples of the largest rectangle of a face that one invocation fills; it tests whole tiles."""
PIECE_BLOCKS = 1024
"""Blocks of a larger face that one workgroup fills."""
LOOKUPS = 6
"""Cells of a side that are looked up for a face."""
MOST_PLANES = 6
"""Sides of a cube."""
PIECE_BYTES = 288
"""Bytes of a struct `Piece` of lens.comp."""
CELLS, BLOCKS = 1, 7
"""Bindings of storage buffers beside those of `compute`; `RUNS` and `CELLS` are not used at once,
for OpenGL promises eight."""


class LensPoses:
    """Poses of a scene, for a grid of samples.

    Attributes
    ----------
    places : Places
        Samples of the grid.
    poses : (P, 4, 4) float64
        world_from_camera.
    eyes : (P, 3) float64
        Camera centres, relative to the centre of the mesh.
    near, cull, clipped : (P,) float64, bool, bool
        Near plane, whether back faces can be left out, and whether a surface in view is cut.
    runs : (height, 2) int32
        First sample of each row inside the image, and the one after its last.
    """

    def __init__(
        self, scene: ComputeScene, places: Places, poses: FloatArray, grid: SampleGrid
    ) -> None:
        self.places, self.poses = places, poses
        self.eyes: FloatArray = poses[:, :3, 3] - scene.centre
        self.near, self.cull, self.clipped = limits_of(scene.mesh, scene.camera, poses)
        self.runs: NDArray[np.int32] = np.stack((grid.first, grid.last), axis=1)

    def views(self, rows: slice, band: Band) -> NDArray[np.void]:
        """Views of some of the poses in each plane of a band, (B, N) VIEW."""
        found = np.zeros((rows.stop - rows.start, len(band.views)), VIEW)
        found[:] = band.views
        axes = self.poses[rows, None, :3, :3] @ band.frames  # the same products as on the CPU
        found["axes"][..., :3] = axes.swapaxes(-1, -2)
        found["eye"][..., :3] = self.eyes[rows, None]
        found["near"], found["cull"] = self.near[rows, None], self.cull[rows, None]
        found["pose"] = np.arange(len(found))[:, None]
        return found


@dataclass(frozen=True)
class _TargetScene:
    """Targets on the device: their corners, and faces that number them."""

    vertices: Any
    faces: Any


class LensCompute(Compute):
    """`rastercov.raster.gl.strategy.Strategy` on compute shaders, for any lens.

    ResourceError when the device has no storage block for the mesh, or for eight rows of samples.
    """

    shader, piece_bytes, record_bytes = "lens", PIECE_BYTES, VIEW.itemsize
    most_views = MOST_PLANES

    def __init__(
        self, resources: Resources, mesh: Mesh, camera: Camera, grid: SampleGrid, limits: DrawLimits
    ) -> None:
        self._places: dict[tuple[Camera, int, float], Places] = {}
        self._targets: tuple[_TargetScene, tuple[Any, Any]] | None = None
        super().__init__(resources, mesh, camera, grid, limits)

    def _sizes(self, camera: Camera, grid: SampleGrid, limits: DrawLimits, block: int) -> Sizes:
        # Six planes may each have a rectangle as large as the band, with less than 4 bytes of cells
        # on the 9.5 of a sample.
        of_sample = MOST_PLANES * 2 * BLOCK_RECORD.itemsize // BLOCK**2
        self._max_table = min(MAX_TABLE, limits.max_tile**2, block // max(KEY_BYTES, of_sample))
        grids = (grid, SampleGrid(camera))
        bands = [(each.width, self._tables(camera, each).rows(0)[1]) for each in grids]
        widest = max(width for width, _ in bands)
        if widest * BLOCK * KEY_BYTES > block:
            raise ResourceError(
                f"plan 'compute' needs eight rows of samples in storage blocks of "
                f"{widest * BLOCK * KEY_BYTES:,} bytes, {self._resources.context.info.renderer} "
                f"has {block:,}; lower supersample, or take --device cpu (backend cpu)"
            )
        blocks = max(-(-width // BLOCK) * -(-rows // BLOCK) for width, rows in bands)
        # A face that is seen edge-on is drawn twice.
        pieces = 2 * -(-max(blocks, self_test.WIDTH * self_test.HEIGHT) // PIECE_BLOCKS)
        return Sizes(max(width * rows for width, rows in bands), pieces)

    def _constants(self) -> dict[str, int]:
        return {"SMALL": SMALL, "PIECE_BLOCKS": PIECE_BLOCKS, "LOOKUPS": LOOKUPS}

    def _tables(self, camera: Camera, grid: SampleGrid) -> SampleTables:
        return tables_of(camera, grid.supersample, grid.roll, self._max_table)

    def _places_of(self, camera: Camera, grid: SampleGrid) -> Places:
        key = camera, grid.supersample, grid.roll
        if key not in self._places:
            self._places[key] = Places(self._resources, self._tables(camera, grid))
        return self._places[key]

    def tiles(self, scene: ComputeScene, grid: SampleGrid) -> Iterator[Box]:
        """Bands of a grid."""
        return iter(self._places_of(scene.camera, grid).tiles())

    def prepare(self, scene: ComputeScene, poses: FloatArray, grid: SampleGrid) -> LensPoses:
        """Compute the near planes of the poses."""
        return LensPoses(scene, self._places_of(scene.camera, grid), poses, grid)

    def begin(self, prepared: LensPoses, rows: slice) -> None:
        """Upload the rows of samples; views depend on the tile."""
        self._runs.write(prepared.runs)

    def _bind(self, prepared: LensPoses, rows: slice, tile: Box) -> int:
        band = prepared.places.band(tile)
        self._records.write(prepared.views(rows, band))
        band.cells.bind_to_storage_buffer(CELLS)
        band.blocks.bind_to_storage_buffer(BLOCKS)
        return len(band.views)

    def _depth(self, prepared: LensPoses, tile: Box, inverse: FloatArray) -> NDArray[np.float32]:
        with np.errstate(divide="ignore"):
            depth = 1 / inverse
        distances = prepared.places.distances(tile)
        return (depth if distances is None else depth * distances).astype(np.float32)

    def count_targets(
        self, scene: ComputeScene, targets: TargetFaces, poses: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Visible and drawn samples of the targets, (P, N) each."""
        if self._targets is None:
            points = targets.corners.reshape(-1, 3)
            numbers = np.arange(len(points), dtype=np.uint32)
            buffer = self._resources.buffer
            self._targets = (
                _TargetScene(buffer("targets", points), buffer("corners of targets", numbers)),
                self._programs(TARGETS=1),
            )
        n_targets = len(targets.rows)
        visible, drawn = np.zeros((2, len(poses), n_targets), np.int64)
        prepared = self.prepare(scene, poses, scene.grid)
        for rows in self.batches(prepared):
            self.begin(prepared, rows)
            n_poses = rows.stop - rows.start
            for tile in self.tiles(scene, scene.grid):
                while True:
                    self._draw(scene, prepared, rows, tile, drawn=False)
                    found = self._count_targets(prepared, rows, tile, n_targets)
                    if self._queue_sufficed(max(scene.mesh.n_faces, n_targets), n_poses):
                        break
                drawn[rows] += found[0]
                visible[rows] += found[1]
        return visible, drawn

    def _count_targets(
        self, prepared: LensPoses, rows: slice, tile: Box, n_targets: int
    ) -> list[NDArray[np.uint32]]:
        """Samples of a tile that each target covers, and those that no surface is in front of."""
        assert self._targets is not None
        scene, programs = self._targets
        n_poses, windows = rows.stop - rows.start, []
        views = self._bind(prepared, rows, tile)
        for first, n in face_ranges(n_targets, max(1, self._most_faces // 2)):
            self._fill_part(
                programs, scene, (first, n), (n_poses, views), tile, 2 * n + 1,
                with_drawn=True, first_seen=n,
            )  # fmt: skip
            found = self._resources.read_words(self._counters, n_poses, 2 * n + 1)
            windows.append(without_background([found]).reshape(n_poses, 2, n))
        return list(np.moveaxis(np.concatenate(windows, axis=2), 1, 0))
