"""Tables of the places of samples in the ideal planes of a lens.

A lens moves samples, not edges: an edge is straight in an ideal plane (`camera.lenses.planes`),
and each sample is tested at the place of the plane whose ray it sees. Places are found once for a
camera, by the inverse of the lens, and kept in tiles of 4 x 4 samples with their boxes.

The tiles that a face may reach are looked up in a grid over the plane, whose cells have the range
of tiles with a sample in them. So no face is moved by the lens, and no bound of its bending is
needed.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import check_memory
from rastercov.base.threads import share_poses
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import lens_of, planes_of
from rastercov.kernels.lens_planes import PlaneRecord
from rastercov.kernels.raster_lens_cells import fill_cells, merge_cells
from rastercov.kernels.raster_lens_records import BLOCK, TILE, Patch
from rastercov.kernels.raster_memory import LANES, aligned_zeros
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
        records: dict[bytes, list[PlaneRecord]] = {}
        for plane, record in planes_of(camera):
            records.setdefault(plane.frame.tobytes(), []).append(record)
        self.frames = tuple(found[0].frame for found in records.values())
        self._planes = [(found[0], _free_radius(found)) for found in records.values()]
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

    def rows(self, index: int) -> tuple[int, int]:
        """First row of a band, and the one after its last."""
        top = BLOCK * self._rows * index
        return top, min(self.grid.height, top + BLOCK * self._rows)

    def _make(self, index: int, threads: int) -> tuple[Patch, ...]:
        grid = self.grid
        top, bottom = self.rows(index)
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
            patch = _patch(x, y, top // BLOCK, *self._planes[number], self.grid)
            if patch is not None:
                patches.append(patch)
        return tuple(patches)


@lru_cache(maxsize=8)
def tables_of(
    camera: Camera, supersample: int, roll: float, max_table: int = MAX_TABLE
) -> SampleTables:
    """Tables of a camera, which rasterisers of one camera share."""
    return SampleTables(camera, supersample, roll, max_table)


def _free_radius(records: list[PlaneRecord]) -> float:
    """Radius of a disc around the origin of a plane on which one continuous lens is bounded.

    0 where the image of the plane is divided, or has a pole or a hole.
    """
    record = records[0]
    if len(records) > 1 or len(record.hole) or not np.isfinite(record.bend):
        return 0.0
    side = np.roll(record.region, -1, axis=0) - record.region
    height = record.region[:, 0] * side[:, 1] - record.region[:, 1] * side[:, 0]
    return max(0.0, float((height / np.hypot(*side.T)).min()))


def _patch(
    x: FloatArray, y: FloatArray, top: int, plane: PlaneRecord, radius: float, grid: SampleGrid
) -> Patch | None:
    """Patch of places (rows, columns) of whole blocks; None where there is no sample."""
    n_rows, n_columns = x.shape[0] // BLOCK, x.shape[1] // BLOCK
    is_live = ~np.isnan(_cut(x, BLOCK)).all(axis=1).reshape(n_rows, n_columns)
    if not is_live.any():
        return None
    # The rectangle of blocks with samples.
    (r0, r1), (c0, c1) = (np.flatnonzero(is_live.any(axis=axis))[[0, -1]] for axis in (1, 0))
    part = slice(BLOCK * r0, BLOCK * (r1 + 1)), slice(BLOCK * c0, BLOCK * (c1 + 1))
    x, y, is_live = x[part], y[part], is_live[r0 : r1 + 1, c0 : c1 + 1]
    # Float32 from the middle of each block: within 2^-24 of half its side.
    middle = np.zeros((is_live.size, 2))
    for axis, each in enumerate((x, y)):
        of_block = _cut(each, BLOCK)[is_live.ravel()]
        middle[is_live.ravel(), axis] = (
            np.nanmin(of_block, axis=1) + np.nanmax(of_block, axis=1)
        ) / 2
    several = BLOCK // TILE
    centres = middle.reshape(*is_live.shape, 2).repeat(several, axis=0).repeat(several, axis=1)
    columns = centres.shape[1]
    centres = centres.reshape(-1, 2)
    x, y = _cut(x, TILE), _cut(y, TILE)
    from_x, from_y = (aligned_zeros(x.shape, np.float32) for _ in range(2))
    from_x[:], from_y[:] = x - centres[:, :1], y - centres[:, 1:]
    x, y = centres[:, :1] + from_x, centres[:, 1:] + from_y
    sides = [limit(each, axis=1) for each in (x, y) for limit in (np.fmin.reduce, np.fmax.reduce)]
    boxes = np.empty((4, len(x) + LANES), np.float32)
    boxes[0::2], boxes[1::2] = np.inf, -np.inf
    has_samples = ~np.isnan(sides[0])
    for row, (side, outwards) in enumerate(zip(sides, (-np.inf, np.inf) * 2, strict=True)):
        outer = np.nextafter(side.astype(np.float32), np.float32(outwards))
        boxes[row, : len(x)][has_samples] = outer[has_samples]
    low, high = (
        np.array([np.fmin.reduce(sides[0]), np.fmin.reduce(sides[2])]),
        np.array([np.fmax.reduce(sides[1]), np.fmax.reduce(sides[3])]),
    )
    size = high - low
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
    fill_cells(x, y, columns, low, 1 / side, width, height, cells)
    merge_cells(cells, starts[:-1], widths, heights)
    patch = Patch(
        frame=plane.frame,
        centres=centres,
        x=from_x,
        y=from_y,
        boxes=boxes,
        cells=cells,
        starts=starts[:-1].astype(np.int64),
        widths=widths,
        heights=heights,
        low=low,
        high=high,
        first_row=several * (top + int(r0)),
        first_column=several * int(c0),
        columns=columns,
        cells_a_unit=1 / side,
        reach=1 + float(np.maximum(np.abs(low), np.abs(high)).sum()),
        half=float(max(np.nanmax(np.abs(from_x)), np.nanmax(np.abs(from_y)))),
        plane=plane,
        radius2=radius * radius,
        canvas=grid.canvas_from_image,
        bend=grid.supersample * plane.bend / 8,
    )
    for array in patch:
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return patch


def _cut(places: FloatArray, side: int) -> FloatArray:
    """Places (rows, columns) of whole squares as (N, side^2), square by square in rows."""
    rows, columns = places.shape[0] // side, places.shape[1] // side
    squares = places.reshape(rows, side, columns, side).swapaxes(1, 2)
    return np.ascontiguousarray(squares).reshape(-1, side * side)
