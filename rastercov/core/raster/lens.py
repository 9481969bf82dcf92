"""Rasteriser of any lens: samples at their own rays in images of pinholes.

A lens moves samples, not edges: edges are straight in its ideal planes (`camera.lenses.planes`).
So faces are drawn in these planes as those of a pinhole, and compared at the places where the rays
of the samples meet the plane: the lanes of a block are up to 16 such places in it, in steps of
1/1024 sample, not the centres of a grid. Places are found once for a camera.

    camera -> rays of samples -> views: pinholes, and the places of these rays in them (once)
    pose -> faces at the places of each view -> counts, or a picture

A view is about as fine as the samples of the lens are: no block has more than 16 places, except for
few that get a view of their own. Where a lens shrinks one part of a plane and not another, the
samples are divided until their views are little larger than the image.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rastercov.base import (
    BoolArray,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    check_memory,
    cos,
    matmul,
    norm,
    share_poses,
    sin,
    sort_order,
)
from rastercov.core.camera import Camera
from rastercov.core.camera.lenses.of_camera import lens_of, planes_of, unit_of
from rastercov.core.camera.parallel import MODEL
from rastercov.core.camera.pose import limits
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import matrices_of
from rastercov.core.raster import self_test
from rastercov.core.raster.cpu import CPURasterizer, Drawn, InLoops, canvas_of
from rastercov.core.raster.sample_grid import SampleGrid
from rastercov.core.raster.targets import corners_of
from rastercov.engine.solver_raster import FINE_STEP_BITS, LANES, SIDE, STRIP_BITS, Canvas

DENSEST = 0.98
"""Share of the samples of a view that are no denser than those of its grid."""
FINENESS = (1.0, 1.04, 1.08, 1.15, 1.25, 1.4)
"""Resolutions of a view, a side, of which the first is taken that leaves no block too full."""
MOST_WASTE = 3.0
"""Area of a view to that of the samples it shows beyond which these are divided."""
LEAST_SIDE, MOST_SIDE = 256, 4096
"""Samples a side of a view that is not divided any more, and of the largest view."""
MOST_ROWS = 1 << 22
"""Samples of the lens whose rays are in memory at a time, `RAY_BYTES` each."""
RAY_BYTES = 120
MOST_KEPT = 1 << 23
"""Samples of the lens whose views are kept; those of all others are made for each call."""
ROWS_A_TURN = 8
"""Rows of samples a thread unprojects at a time."""
CELL, STEPS = SIDE * SIDE, 1 << FINE_STEP_BITS
"""Samples along the side of a cell, and steps along that of a sample."""

REGULAR = np.array(
    [STEPS // 2 + STEPS * x | (STEPS // 2 + STEPS * y) << 16 for y in range(4) for x in range(4)],
    np.int32,
)
"""Places of the lanes of a block without a sample of the lens: those of a pinhole."""


@dataclass(eq=False)
class LensView:
    """Pinhole at the place of a lens, and the places in it of rays of the lens.

    Attributes
    ----------
    camera : Camera
        The pinhole, of whole cells.
    turn : (4, 4) float64
        lens_from_view.
    offsets : (N,) int32
        Place of each lane of the blocks in memory, x + 65536 y in steps from the corner of the
        block; lanes that have no sample of the lens share the place of another.
    used : (B,) uint16
        Lanes of each block that have a sample of the lens.
    cell_bounds : (C,) float32
        0 for a cell with such a lane, else inf.
    lanes, samples : (S,) int32
        Lanes in rising order, and their samples, counted along the rows of the canvas of the lens;
        empty unless places are kept.
    places : (S, 2) float32
        X / Z and Y / Z of their rays, metres of parallel rays; empty unless places are kept.
    """

    camera: Camera
    turn: FloatArray
    offsets: Int32Array
    used: NDArray[np.uint16]
    cell_bounds: Float32Array
    lanes: Int32Array
    samples: Int32Array
    places: Float32Array

    @cached_property
    def canvas(self) -> Canvas:
        """Samples of the pinhole, in whose steps the places are."""
        own = self.offsets, self.used, self.cell_bounds, self.lanes, self.samples, self.places
        return canvas_of(SampleGrid(self.camera), own)


class SampleViews:
    """Views of the samples of a camera, in bands of rows.

    Parameters
    ----------
    camera : Camera
        Any lens.
    supersample, roll
        As for `open_rasterizer`.
    keeps_places : bool
        Whether the views have `lanes`, `samples` and `places`: for pictures.
    most_rows : int
        Samples of a band.
    """

    def __init__(
        self,
        camera: Camera,
        supersample: int = 1,
        roll: float = 0.0,
        *,
        keeps_places: bool = False,
        most_rows: int = MOST_ROWS,
    ) -> None:
        self.grid = grid = SampleGrid(camera, supersample, roll)
        self._keeps_places, self._lens, self._near = keeps_places, lens_of(camera), camera.near
        self._kind = MODEL if camera.is_parallel else "pinhole"
        self._unit = unit_of(camera) or 1.0  # of places, metres of parallel rays
        # Along the rows of samples, which then fill blocks evenly.
        c, s = cos(roll), sin(roll)
        turned = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))
        frames = [each.record.frame for each in planes_of(camera)]
        self.frames = tuple({frame.tobytes(): matmul(frame, turned) for frame in frames}.values())
        self.rows = max(1, most_rows // grid.width)
        self._kept: dict[int, tuple[LensView, ...]] = {}

    def bands(self, threads: int) -> Iterator[tuple[LensView, ...]]:
        """Yield the views of each band of rows."""
        for top in range(0, self.grid.height, self.rows):
            views = self._kept.get(top)
            if views is None:
                views = tuple(
                    self._make_views(top, min(top + self.rows, self.grid.height), threads)
                )
                if (top + self.rows) * self.grid.width <= MOST_KEPT or not top:
                    self._kept[top] = views
            yield views

    def _make_views(self, top: int, bottom: int, threads: int) -> Iterator[LensView]:
        width, height = self.grid.width, bottom - top
        check_memory(
            f"the places of {width * height:,} samples",
            RAY_BYTES * width * height,
            "lower supersample",
        )
        rays = self._rays(top, bottom, threads)
        along = np.stack([matmul(rays, frame[:, 2]) for frame in self.frames])
        plane = along.argmax(axis=0)
        z = np.take_along_axis(along, plane[None], axis=0)[0]
        plane[~(z > 0)] = -1
        parts = [(number, np.flatnonzero(plane == number)) for number in range(len(self.frames))]
        rays = rays.reshape(-1, 3)
        while parts:
            number, at = parts.pop()
            if not len(at):
                continue
            own, frame = rays[at], self.frames[number]
            places = matmul(own, frame[:, :2]) / matmul(own, frame[:, 2])[:, None]
            scale = self._scale(own, frame)
            # At a pole the lens is infinitely dense: a few samples have no larger view.
            extent = np.maximum(np.ptp(places, axis=0), 1e-9)
            scale = np.minimum(scale, (LEAST_SIDE + len(at)) / extent)
            size = extent * scale
            if size.max() > MOST_SIDE or (
                size.max() > LEAST_SIDE and size.prod() > MOST_WASTE * len(at)
            ):
                axis = int(size.argmax())
                is_first = places[:, axis] < places[:, axis].mean()
                parts += [(number, at[is_first]), (number, at[~is_first])]
                continue
            view, is_left = self._view(frame, places, scale)
            if self._keeps_places:
                view.samples = (at[view.samples] + top * width).astype(np.int32)
            yield view
            parts.append((number, at[is_left]))

    def _rays(self, top: int, bottom: int, threads: int) -> FloatArray:
        """Unit rays of some rows of the canvas, NaN without one and outside the image."""
        grid, lens = self.grid, self._lens
        rays = np.empty((bottom - top, grid.width, 3))
        column = np.arange(grid.width)

        def work(turn: slice) -> None:
            for first in range(ROWS_A_TURN * turn.start, ROWS_A_TURN * turn.stop, ROWS_A_TURN):
                rows = slice(first, min(first + ROWS_A_TURN, bottom - top))
                own = slice(top + rows.start, top + rows.stop)
                rays[rows] = lens.unproject(grid.positions(own.start, own.stop))
                begin, end = grid.runs[:, own, None]
                rays[rows][(column < begin) | (column >= end)] = np.nan

        n_turns = -(-(bottom - top) // ROWS_A_TURN)
        workers: list[Callable[[slice], None]] = [work] * max(1, min(threads, n_turns))
        share_poses(n_turns, workers)
        return rays

    def _scale(self, rays: FloatArray, frame: FloatArray) -> FloatArray:
        """Samples to a unit of each axis of a plane where the lens is as dense as `DENSEST`."""
        some = slice(None, None, max(1, len(rays) // 2000))
        # Derivatives by places are those by rays of length 1 / z.
        slopes = matmul(self._lens.jacobian(rays[some]), frame[:, :2])
        slopes *= matmul(rays[some], frame[:, 2])[:, None, None] * self.grid.supersample
        return np.nanquantile(norm(slopes), DENSEST, axis=0)

    def _view(
        self, frame: FloatArray, places: FloatArray, scale: FloatArray
    ) -> tuple[LensView, IntArray]:
        """View of some places, with their rows for samples, and the rows for which it has no room.

        It has room for 16 samples per block.
        """
        low, high = places.min(axis=0), places.max(axis=0)
        for fineness in FINENESS:
            focal = fineness * scale
            centre = 1.0 - low * focal
            blocks_a_cell = np.ceil(((high - low) * focal + 2) / CELL).astype(int)
            width, height = (CELL * blocks_a_cell).tolist()
            step = np.floor((places * focal + centre) * STEPS + 0.5).astype(np.int32)
            strips = -(-width // (SIDE << STRIP_BITS)) << STRIP_BITS
            at = step >> (FINE_STEP_BITS + 2)
            block = at[:, 1] * np.int32(strips) + at[:, 0]
            filled = np.bincount(block, minlength=strips * height // SIDE)
            if filled.max() <= LANES:
                break
        order = sort_order(block)
        rank = np.arange(len(block)) - (np.cumsum(filled) - filled)[block[order]]
        left, order = order[rank >= LANES], order[rank < LANES]
        lanes = (block[order] * LANES + rank[rank < LANES]).astype(np.int32)
        filled = np.minimum(filled, LANES)
        inside = step[order] & (STEPS * SIDE - 1)
        offsets = np.tile(REGULAR, len(filled))
        own = inside[:, 0] | inside[:, 1] << 16
        first = lanes % LANES == 0
        shared = offsets.reshape(-1, LANES)
        shared[lanes[first] // LANES] = own[first, None]
        offsets[lanes] = own
        cells = filled.reshape(height // CELL, SIDE, strips // SIDE, SIDE).any(axis=(1, 3))
        bounds = np.where(cells.ravel(), 0, np.inf).astype(np.float32)
        (fx, fy), (cx, cy) = focal.tolist(), centre.tolist()
        scales = {"fx": fx / self._unit, "fy": fy / self._unit, "cx": cx, "cy": cy}
        size = {"width": width, "height": height, "near": self._near}
        camera = Camera(**size, **scales, model=self._kind)
        kept = slice(None if self._keeps_places else 0)
        view = LensView(
            camera,
            matrices_of(frame),
            offsets,
            ((1 << filled) - 1).astype(np.uint16),
            bounds,
            lanes[kept],
            order[kept].astype(np.int32),
            (self._unit * places[order[kept]]).astype(np.float32),
        )
        return view, left


@lru_cache(maxsize=8)
def views_of(camera: Camera, supersample: int, roll: float, keeps_places: bool) -> SampleViews:
    """Views of a camera, which rasterisers of one camera share."""
    return SampleViews(camera, supersample, roll, keeps_places=keeps_places)


class LensRasterizer(InLoops):
    """Rasteriser of cameras with any lens, in compiled loops on the CPU.

    Any number of threads may use one rasteriser at once.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    threads : int, optional
        Number of threads, by default one for each core; each takes whole poses.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        supersample: int = 1,
        roll: float = 0.0,
        threads: int | None = None,
    ) -> None:
        self._views = views = views_of(camera, supersample, roll, keeps_places=False)
        super().__init__(mesh, camera, views.grid, threads)
        self._n_parts = -(-views.grid.height // views.rows)
        self.info = CPURasterizer(mesh, self_test.CAMERA, threads=1).info

    @cached_property
    def _corners(self) -> FloatArray:
        return corners_of(self.mesh.opaque)

    def _draw(self, poses: FloatArray, near: FloatArray, cull: BoolArray) -> Iterator[Drawn]:
        for views in self._views.bands(self._threads):
            yield _draw_views(views, poses, near, cull)

    def _draw_faces(self, poses: FloatArray) -> tuple[Int32Array, Float32Array]:
        shape = self.camera.height, self.camera.width
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)
        pictures = views_of(self.camera, 1, 0.0, keeps_places=True)
        near, cull, _ = limits(self.mesh, self.camera, poses, asks_cut=False)
        of_faces = self._corners, len(pictures.frames) > 1
        for views in pictures.bands(self._threads):
            seen, image = _draw_views(views, poses, near, cull), (face.ravel(), depth.ravel())
            self._drawing.render_lanes(*seen, *of_faces, *image, self._threads)
        return face, depth


def _draw_views(
    views: Sequence[LensView], poses: FloatArray, near: FloatArray, cull: BoolArray
) -> Drawn:
    """Canvases of views, and the poses of each, for the loops."""
    turns = np.array([view.turn for view in views]).reshape(-1, 1, 4, 4)
    return [view.canvas for view in views], (matmul(poses, turns), near, cull)
