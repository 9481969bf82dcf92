"""Tables of the places of samples in the ideal planes of a lens, on the device.

They are those of the CPU (`rastercov.raster.cpu.lens_samples`), made once for a camera, in another
order: by blocks of 8 x 8 samples, one workgroup each. The samples that a face may cover are looked
up in a grid of cells over the plane that is finer than the CPU's and has ranges of samples in place
of tiles, so that a face of few samples is filled without a test of many others.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.threads import thread_count
from rastercov.kernels.raster_lens_records import BLOCK, TILE, Patch
from rastercov.raster.cpu.lens_samples import SAMPLES_A_CELL as SAMPLES_A_CELL_OF_CPU
from rastercov.raster.cpu.lens_samples import SampleTables
from rastercov.raster.gl.resources import Resources
from rastercov.raster.sample_grid import Box

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

VIEW = np.dtype(
    [
        ("axes", np.float64, (3, 4)),
        ("eye", np.float64, 4),
        ("low", np.float64, 2),
        ("high", np.float64, 2),
        ("near", np.float64),
        ("cull", np.float64),
        ("cells_a_unit", np.float64),
        ("farthest", np.float64),
        ("half_side", np.float64),
        ("pose", np.uint32),
        ("first_block", np.uint32),
        ("origin", np.int32, 2),
        ("columns", np.int32),
        ("first_cell", np.int32),
        ("cells", np.int32, 2),
        ("", np.uint32, 6),
    ]
)
"""Struct `View` of lens.comp."""
BLOCK_RECORD = np.dtype(
    [
        ("middle", np.float64, 2),
        ("reach", np.float32, 2),
        ("", np.float32, 2),
        ("tiles", np.float32, (4, 4)),
        ("places", np.float32, (BLOCK * BLOCK, 2)),
    ]
)
"""Struct `Block` of lens.comp."""
NO_PLACE = np.float32(3e38)
"""First coordinate of a sample of another plane, or of none; above NO_PLACE of lens.comp."""
NO_SAMPLE = np.float32(-1)
"""Reach of a block or tile without samples."""
SAMPLES_A_CELL = 4.0
"""Samples in a cell of the grid, on average."""
EMPTY = np.int32(1 << 30)
TABLES = "places of samples"
MAX_RESIDENT = 1 << 30
"""Bytes of the tables of a grid that stay on the device; those of further bands are sent anew."""


class Band(NamedTuple):
    """Tables of a band of rows on the device.

    Attributes
    ----------
    frames : (N, 3, 3) float64
        lens_from_plane of each plane with samples in the band.
    views : (N,) VIEW
        What of a view does not depend on the pose.
    blocks, cells : moderngl.Buffer
        Of all planes, with one that is not used before them.
    """

    frames: FloatArray
    views: NDArray[np.void]
    blocks: Any
    cells: Any


class Places:
    """Tables of a grid of samples, sent to the device band by band.

    Parameters
    ----------
    resources : Resources
        Owner of the buffers.
    tables : SampleTables
        Tables of the CPU.
    """

    def __init__(self, resources: Resources, tables: SampleTables) -> None:
        self.tables, self._resources = tables, resources
        self._bands: dict[int, Band] = {}
        self._resident = 0
        self._spare: list[Any] = []

    def tiles(self) -> list[Box]:
        """Bands as boxes of the canvas."""
        rows = [self.tables.rows(index) for index in range(self.tables.n_bands)]
        return [(0, top, self.tables.grid.width, bottom - top) for top, bottom in rows]

    def band(self, tile: Box) -> Band:
        """Tables of one of `tiles`; valid until the next call."""
        index = self._index(tile)
        found = self._bands.get(index)
        if found is not None:
            return found
        frames, views, arrays = _arrays(self._patches(tile), tile[1])
        n_bytes = sum(array.nbytes for array in arrays)
        if self._resident + n_bytes > MAX_RESIDENT:
            return Band(frames, views, *self._sent_anew(arrays))
        found = Band(frames, views, *(self._resources.buffer(TABLES, each) for each in arrays))
        self._bands[index], self._resident = found, self._resident + n_bytes
        return found

    def distances(self, tile: Box) -> FloatArray | None:
        """Distance along the ray of a point of depth 1 at each sample of a tile, (height, width).

        None for a lens of one plane, through which depth is z; 1 at a sample without a ray.
        """
        if len(self.tables.frames) == 1:
            return None
        found = np.ones((tile[3], tile[2]))
        for patch in self._patches(tile):
            x, y = _in_blocks(patch)
            is_live = ~np.isnan(x)
            rows, columns = (each[is_live] for each in _samples_of(patch))
            x, y = x[is_live], y[is_live]
            left, top = _origin_of(patch, tile[1])
            found[top + rows, left + columns] = np.sqrt(1.0 + x * x + y * y)
        return found

    def _index(self, tile: Box) -> int:
        return tile[1] // self.tables.rows(0)[1]

    def _patches(self, tile: Box) -> tuple[Patch, ...]:
        return self.tables.band(self._index(tile), thread_count(None))

    def _sent_anew(self, arrays: list[NDArray[Any]]) -> list[Any]:
        """Buffers with the arrays, the same for all bands."""
        if not self._spare:
            self._spare = [self._resources.buffer(TABLES, size=1) for _ in arrays]
        for buffer, array in zip(self._spare, arrays, strict=True):
            buffer.orphan(array.nbytes)
            buffer.write(np.ascontiguousarray(array))
        return self._spare


def _arrays(
    patches: tuple[Patch, ...], top: int
) -> tuple[FloatArray, NDArray[np.void], list[NDArray[Any]]]:
    """Frames, views, blocks and cells of a band, see `Band`; `top` is its first row."""
    frames, views = np.empty((len(patches), 3, 3)), np.zeros(len(patches), VIEW)
    blocks, cells = [np.zeros(1, BLOCK_RECORD)], [np.zeros((1, 4), np.int32)]  # never empty
    n_blocks, n_cells = 1, 1
    for patch, frame, view in zip(patches, frames, views, strict=True):
        frame[:] = patch.frame
        blocks.append(_blocks_of(patch))
        its_cells, view["cells_a_unit"], view["cells"] = _cells_of(patch)
        cells.append(its_cells)
        view["low"], view["high"] = patch.low, patch.high
        view["farthest"], view["half_side"] = patch.reach, patch.half
        view["first_block"], view["first_cell"] = n_blocks, n_cells
        view["origin"] = _origin_of(patch, top)
        view["columns"] = _shape_of(patch)[1]
        n_blocks, n_cells = n_blocks + len(blocks[-1]), n_cells + len(its_cells)
    return frames, views, [np.concatenate(blocks), np.concatenate(cells)]


def _shape_of(patch: Patch) -> tuple[int, int]:
    """Rows and columns of blocks."""
    several = BLOCK // TILE
    return len(patch.x) // patch.columns // several, patch.columns // several


def _origin_of(patch: Patch, top: int) -> tuple[int, int]:
    """Column and row of the first sample of a patch, in a band whose first row is `top`."""
    return TILE * patch.first_column, TILE * patch.first_row - top


def _by_blocks(of_tiles: NDArray[Any], patch: Patch) -> NDArray[Any]:
    """Values (T, 16) of samples in tiles as (N, 64), block by block and row by row in each."""
    several, (rows, columns) = BLOCK // TILE, _shape_of(patch)
    cut = of_tiles.reshape(rows, several, columns, several, TILE, TILE)
    return np.ascontiguousarray(cut.transpose(0, 2, 1, 4, 3, 5)).reshape(-1, BLOCK * BLOCK)


def _in_blocks(patch: Patch) -> list[FloatArray]:
    """Places x and y (N, 64) of the samples in the plane."""
    return [
        _by_blocks(patch.centres[:, k, None] + each, patch)
        for k, each in enumerate((patch.x, patch.y))
    ]


def _samples_of(patch: Patch) -> tuple[IntArray, IntArray]:
    """Row and column (N, 64) of the samples, from the first of the patch."""
    (rows, columns), of_block = _shape_of(patch), np.arange(BLOCK * BLOCK)
    block = np.arange(rows * columns)[:, None]
    return (
        BLOCK * (block // columns) + of_block // BLOCK,
        BLOCK * (block % columns) + of_block % BLOCK,
    )


def _blocks_of(patch: Patch) -> NDArray[np.void]:
    """Structs `Block` of a patch."""
    places = np.stack([_by_blocks(each, patch) for each in (patch.x, patch.y)], axis=2)
    found = np.zeros(len(places), BLOCK_RECORD)
    centres = patch.centres[:, None].repeat(TILE * TILE, axis=1)
    for k in range(2):
        found["middle"][:, k] = _by_blocks(centres[..., k], patch)[:, 0]
    reach = np.fmax.reduce(np.abs(places), axis=1)
    found["reach"] = np.where(np.isnan(reach), NO_SAMPLE, reach)
    several = BLOCK // TILE
    of_tiles = places.reshape(-1, several, TILE, several, TILE, 2).swapaxes(2, 3)
    of_tiles = of_tiles.reshape(-1, several**2, TILE**2, 2)
    low, high = (limit.reduce(of_tiles, axis=2) for limit in (np.fmin, np.fmax))
    middle = low / 2 + high / 2
    reach = np.nextafter(np.maximum(high - middle, middle - low), np.float32(np.inf))
    is_empty = np.isnan(middle)
    found["tiles"][..., :2] = np.where(is_empty, 0, middle)
    found["tiles"][..., 2:] = np.where(is_empty, NO_SAMPLE, reach)
    found["places"] = np.where(np.isnan(places), NO_PLACE, places)
    return found


def _cells_of(patch: Patch) -> tuple[NDArray[np.int32], float, tuple[int, int]]:
    """Cells (N, 4) of all levels, cells in a unit of the plane, and columns and rows of the first.

    As `Patch.cells`, of samples in place of tiles.
    """
    a_unit = patch.cells_a_unit * float(np.sqrt(SAMPLES_A_CELL_OF_CPU / SAMPLES_A_CELL))
    width, height = (max(1, int(np.ceil(size * a_unit))) for size in patch.high - patch.low)
    x, y = _in_blocks(patch)
    is_live = ~np.isnan(x)
    rows, columns = (each[is_live].astype(np.int32) for each in _samples_of(patch))
    i, j = (
        np.clip((each[is_live] - low) * a_unit, 0.0, n - 1.0).astype(np.int64)
        for each, low, n in zip((x, y), patch.low, (width, height), strict=True)
    )
    level: NDArray[np.int32] = np.full((4, height * width), EMPTY, np.int32)
    for least, values in zip(level, (columns, -columns, rows, -rows), strict=True):
        np.minimum.at(least, j * width + i, values)
    level = level.reshape(4, height, width)
    levels = [level]
    while max(level.shape[1:]) > 1:
        odd = [(0, 0)] + [(0, side % 2) for side in level.shape[1:]]
        level = np.pad(level, odd, constant_values=EMPTY)
        level = level.reshape(4, level.shape[1] // 2, 2, level.shape[2] // 2, 2).min(axis=(2, 4))
        levels.append(level)
    return np.concatenate([each.reshape(4, -1).T for each in levels]), a_unit, (width, height)
