"""Tables of the places of samples in the ideal planes of a lens.

A lens moves samples, not edges: an edge is straight in an ideal plane (`rastercov.lenses.planes`),
and each sample is tested at the place of the plane whose ray it sees. Places are found once for a
camera, by the inverse of the lens, and kept in blocks of 8 x 8 samples with their boxes.

The blocks that a face may reach are looked up in a grid over the plane, whose cells have the range
of blocks with a sample in them. So no face is moved by the lens, and no bound of its bending is
needed.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rastercov._memory import check_memory
from rastercov._threads import share_poses
from rastercov.camera import Camera
from rastercov.lenses.of_camera import lens_of, planes_of
from rastercov.raster.cpu import lens_kernels as kernels
from rastercov.raster.cpu.lens_records import BLOCK, SAMPLES, Patch
from rastercov.raster.sample_grid import SampleGrid

FloatArray = NDArray[np.float64]

MAX_TABLE = 1 << 22
"""Most samples of a table, of 8 bytes each; larger images are drawn in bands of rows."""
MOST_KEPT = 4
"""Tables of a camera that are kept; those of further bands are made again for each call."""
BYTES_A_SAMPLE = 100
"""Memory that making a table takes."""
SAMPLES_A_CELL = 16.0
"""Samples in a cell of the grid, on average."""
ROWS_A_TURN = 8
"""Rows of samples a thread unprojects at a time."""


class SampleTables:
    """Places of the samples of a camera, in bands of rows.

    Parameters
    ----------
    camera : Camera
        Any lens.
    supersample, roll
        As for `open_rasterizer`.
    max_table : int
        Most samples of a table.

    Attributes
    ----------
    grid : SampleGrid
    n_bands : int
    frames : tuple of (3, 3) float64
        lens_from_plane of each plane; each sample belongs to the one whose axis is nearest.
    """

    def __init__(
        self, camera: Camera, supersample: int, roll: float, max_table: int = MAX_TABLE
    ) -> None:
        self.grid = SampleGrid(camera, supersample, roll)
        self._lens = lens_of(camera)
        # Planes that share a frame divide its image for the sake of areas; samples need no such.
        frames = {plane.frame.tobytes(): plane.frame for plane, _ in planes_of(camera)}
        self.frames = tuple(frames.values())
        n_rows = -(-self.grid.height // BLOCK)
        width = BLOCK * -(-self.grid.width // BLOCK)
        self._rows = max(1, max_table // (width * BLOCK))
        self.n_bands = -(-n_rows // self._rows)
        self._kept: dict[int, tuple[Patch, ...]] = {}

    def band(self, index: int, threads: int) -> tuple[Patch, ...]:
        """Patches of a band of rows of the canvas, one for each plane that has samples there."""
        found = self._kept.get(index)
        if found is None:
            found = self._make(index, threads)
            if len(self._kept) < MOST_KEPT:
                self._kept[index] = found
        return found

    def _make(self, index: int, threads: int) -> tuple[Patch, ...]:
        grid = self.grid
        top = BLOCK * self._rows * index
        bottom = min(grid.height, top + BLOCK * self._rows)
        columns, rows = -(-grid.width // BLOCK), -(-(bottom - top) // BLOCK)
        check_memory(
            f"the places of {(bottom - top) * grid.width:,} samples",
            BYTES_A_SAMPLE * (bottom - top) * grid.width,
            "lower supersample",
        )
        rays = np.full((rows * BLOCK, columns * BLOCK, 3), np.nan)

        def work(turn: slice) -> None:
            for first in range(ROWS_A_TURN * turn.start, ROWS_A_TURN * turn.stop, ROWS_A_TURN):
                last = min(first + ROWS_A_TURN, bottom - top)
                found = self._lens.unproject(grid.positions(top + first, top + last))
                column = np.arange(grid.width)
                begin, end = (
                    grid.first[top + first : top + last],
                    grid.last[top + first : top + last],
                )
                found[(column < begin[:, None]) | (column >= end[:, None])] = np.nan
                rays[first:last, : grid.width] = found

        n_turns = -(-(bottom - top) // ROWS_A_TURN)
        workers: list[Callable[[slice], None]] = [work] * max(1, min(threads, n_turns))
        share_poses(n_turns, workers)
        along = np.stack([rays @ frame[:, 2] for frame in self.frames])
        nearest = along.argmax(axis=0)  # NaN gives 0, and stays NaN below
        patches = []
        for number, frame in enumerate(self.frames):
            with np.errstate(invalid="ignore", divide="ignore"):
                z = np.where((nearest == number) & (along[number] > 0), along[number], np.nan)
                x, y = (rays @ frame[:, 0]) / z, (rays @ frame[:, 1]) / z
            patch = _patch(frame, x, y, top // BLOCK)
            if patch is not None:
                patches.append(patch)
        return tuple(patches)


@lru_cache(maxsize=8)
def tables_of(camera: Camera, supersample: int, roll: float) -> SampleTables:
    """Tables of a camera, which rasterisers of one camera share."""
    return SampleTables(camera, supersample, roll)


def _patch(frame: FloatArray, x: FloatArray, y: FloatArray, top: int) -> Patch | None:
    """Patch of places (rows, columns) of whole blocks; None where there is no sample."""
    n_rows, n_columns = x.shape[0] // BLOCK, x.shape[1] // BLOCK
    blocked = (n_rows, BLOCK, n_columns, BLOCK)
    x, y = (each.reshape(blocked).swapaxes(1, 2).reshape(-1, SAMPLES) for each in (x, y))
    is_live = ~np.isnan(x).all(axis=1)
    if not is_live.any():
        return None
    x, y = np.ascontiguousarray(x[is_live]), np.ascontiguousarray(y[is_live])
    at = np.flatnonzero(is_live)
    places = np.stack((at // n_columns, at % n_columns), axis=1).astype(np.int32)
    block_at = np.full(n_rows * n_columns, -1, np.int32)
    block_at[at] = np.arange(len(at))
    # Float32 from the middle of each block: within 2^-24 of half its side.
    low_x, high_x, low_y, high_y = (
        limit(each, axis=1) for each in (x, y) for limit in (np.nanmin, np.nanmax)
    )
    centres = np.stack(((low_x + high_x) / 2, (low_y + high_y) / 2), axis=1)
    from_x = (x - centres[:, :1]).astype(np.float32)
    from_y = (y - centres[:, 1:]).astype(np.float32)
    x, y = centres[:, :1] + from_x, centres[:, 1:] + from_y
    sides = (np.nanmin(x, axis=1), np.nanmax(x, axis=1), np.nanmin(y, axis=1), np.nanmax(y, axis=1))
    boxes = np.stack(sides, axis=1)
    low = np.ascontiguousarray(boxes[:, [0, 2]].min(axis=0))
    size = boxes[:, [1, 3]].max(axis=0) - low
    n_cells = max(1.0, np.count_nonzero(~np.isnan(x)) / SAMPLES_A_CELL)
    # A row of samples, or one alone, has no area: then its longer side is divided.
    side = max(float(np.sqrt(size[0] * size[1] / n_cells)), float(size.max()) / n_cells, 1e-300)
    width, height = (max(1, int(np.ceil(length / side))) for length in size)
    shapes = [(width, height)]
    while max(shapes[-1]) > 1:
        shapes.append((-(-shapes[-1][0] // 2), -(-shapes[-1][1] // 2)))
    widths, heights = np.array(shapes, np.int64).T.copy()
    starts = np.concatenate(([0], np.cumsum(widths * heights)))
    cells = np.empty((starts[-1], 4), np.int32)
    kernels.fill_cells(x, y, places, low, 1 / side, width, height, cells)
    kernels.merge_cells(cells, starts[:-1], widths, heights)
    places[:, 0] += top
    patch = Patch(
        frame=np.ascontiguousarray(frame),
        centres=centres,
        x=from_x,
        y=from_y,
        boxes=boxes,
        places=places,
        block_at=block_at.reshape(n_rows, n_columns),
        cells=cells,
        starts=starts[:-1].astype(np.int64),
        widths=widths,
        heights=heights,
        low=low,
        cells_a_unit=1 / side,
        reach=1 + float(np.abs(boxes[:, :2]).max() + np.abs(boxes[:, 2:]).max()),
        half=float(max(np.nanmax(np.abs(from_x)), np.nanmax(np.abs(from_y)))),
    )
    for array in patch[:-3]:
        array.flags.writeable = False
    return patch
