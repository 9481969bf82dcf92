"""CPU rasteriser: the contract of `rastercov.raster.contract` without a graphics library.

A pose runs in one thread from start to end; many poses run side by side. Compiled loops hold no
lock, and every thread has its own scratch memory, so results depend neither on the number of
threads nor on other threads that use the same rasteriser.

    stage             reads                            writes                      file
    ----------------  -------------------------------  --------------------------  ------------
    group (once)      mesh                             Clusters: <= 64 faces each  clusters.cpp
    for each pose:
    1 cull clusters   Clusters.bounds, pose            bits of clusters to draw    cull.hpp
    for each band of rows, for each cluster in it, from front to back (occlusion.hpp):
    2 project         Clusters.points, pose            Vertices: x, y, 1/z         vertices.hpp
    3 cull and bin    Vertices, Clusters.corners       Bins: faces by path         cull.hpp
      clip            faces in Bins.clipped            triangles in a fan          clipping.hpp
    4 set up          a vector of faces in Bins        Setup: edges, planes        setup.hpp
    5 cover           Setup                            coverage masks of blocks    cover.hpp
    6 depth test      masks, planes                    Image: 1/z, face; Counts    depth.hpp

The files are in `rastercov/native/raster`: `loops.cpp` has the loops over poses, `band.hpp` those
over clusters, `fill.hpp` those over faces and blocks, `coverage.hpp` those that count without
depth, `occlusion.hpp` skips clusters and faces behind what is drawn; `records.hpp` defines the
records. `rastercov.reference.raster_stages` has each stage in numpy.

Positions are integers of 1/256 sample, and edge functions are exact. A sample on a left or upper
edge is inside and one on a right or lower edge outside, so every sample belongs to exactly one of
two triangles that share an edge.
"""

from collections.abc import Iterator
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import DeviceError, ResourceError
from rastercov.base.memory import FloatArray, Int32Array, IntArray
from rastercov.base.threads import ScratchPool, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import limits, picture_limits
from rastercov.camera.pose import valid_poses
from rastercov.mesh import Mesh
from rastercov.native import raster_loops
from rastercov.native.raster_loops import LANES, SIDE, STRIP_BITS
from rastercov.raster import self_test
from rastercov.raster.contract import (
    FaceCounts,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
    check_counts,
)
from rastercov.raster.cpu.clusters import Clusters, group_faces
from rastercov.raster.sample_grid import Box, SampleGrid
from rastercov.raster.targets import TargetFaces
from rastercov.raster.tie_order import in_one_order

if TYPE_CHECKING:
    from rastercov.raster.lens import Look, View

Looks = tuple[FloatArray, FloatArray, NDArray[np.bool_]]
"""Poses (P, 4, 4), the depths of their near planes, and whether back faces are hidden, (P,)."""

MAX_SIDE = 1 << 20
"""Largest image side in samples: edge functions are 64-bit integers of 1/256 sample."""

MAX_BAND = 1 << 17
"""Most samples of an image that are in memory at a time."""

MAX_PART = 1 << 30
"""Most samples of an image that are counted in 32 bits."""

LARGE_POSE = 1 << 18
"""Faces, plus an eighth of the samples, from which on a pose is shared by threads."""

NO_COUNTS, NO_WEIGHTS = np.empty((0, 0), np.int32), np.empty(0, np.uint8)
NO_BOUNDS = np.empty(0, np.float32)
"""For the loops: what is not wanted."""

_CLUSTERS: WeakKeyDictionary[Mesh, tuple[Clusters, raster_loops.Scene]] = WeakKeyDictionary()
"""Of each mesh that is in use: most of the time of a small picture, of which a page wants many."""


class CPURasterizer(Rasterizer):
    """Rasteriser in compiled loops.

    Any number of threads may use one rasteriser at once, and so may a forked process.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    threads : int, optional
        Number of threads, by default one for each core.
    """

    _of_known_scene: ClassVar[FaceCounts | None] = None

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        supersample: int = 1,
        roll: float = 0.0,
        threads: int | None = None,
    ) -> None:
        camera.check_pinhole(
            "CPURasterizer draws pinholes only", "take open_rasterizer, which draws any lens"
        )
        self._grid = SampleGrid(camera, supersample, roll)
        side = max(self._grid.width, self._grid.height)
        if side > MAX_SIDE:
            raise ResourceError(
                f"an image side must be at most {MAX_SIDE:,} samples, got {side:,}; "
                "lower supersample or use gl"
            )
        super().__init__(mesh, camera, supersample, roll)
        self._threads = thread_count(threads)
        self.info = RasterizerInfo(
            backend="cpu",
            plan="threads",
            renderer=f"rastercov {version('rastercov')}",
            driver="",
            device="cpu",
            depth="float32 1/z",
            shaders="",
        )
        self._scene = _Scene(mesh.opaque)
        self._scratch, self._picture_scratch = (
            ScratchPool(partial(_Worker, self._scene, grid), self._threads)
            for grid in (self._grid, SampleGrid(camera))
        )
        self._check()

    def _counted(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        counts = self._count(self._scratch, self._scene, self.camera, self._grid, poses, drawn)
        if self._targets is None:
            return counts
        return self._with_targets(counts, *self._count_targets(self._targets, poses))

    def _drawn(self, poses: FloatArray) -> tuple[Int32Array, NDArray[np.float32]]:
        face, depth = self._draw_all(poses)
        return face[0], depth[0]

    def drawer(self, camera: Camera, beside: "_Worker | None" = None) -> "_Worker":
        """Draw the opaque faces of the mesh through another pinhole; see `raster.lens`."""
        self._check_open()
        largest = MAX_BAND // (LANES << STRIP_BITS)
        memory = (
            raster_loops.Worker(self._scene.checked, largest, 2 * largest)
            if beside is None
            else beside.memory
        )
        return _Worker(self._scene, SampleGrid(camera), memory)

    def render_all(self, poses: ArrayLike) -> VisibilityBuffer:
        """`render` of many poses, (P, H, W), in threads; for images that are small."""
        self._check_open()
        return self._named(*self._draw_all(valid_poses(poses)))

    def _draw_all(self, poses: FloatArray) -> tuple[Int32Array, NDArray[np.float32]]:
        near, cull = picture_limits(self.mesh, self.camera, poses)
        shape = len(poses), self.camera.height, self.camera.width
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)

        def work(worker: _Worker, turn: slice) -> None:
            for row in range(turn.start, turn.stop):
                one = slice(row, row + 1)
                worker.render((poses[one], near[one], cull[one]), face[row], depth[row])

        self._share(self._picture_scratch, len(poses), work)
        return face, depth

    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`, calls in other threads complete."""
        super().close()
        self._scratch.close()
        self._picture_scratch.close()

    def _count(
        self,
        scratch: "ScratchPool[_Worker]",
        scene: "_Scene",
        camera: Camera,
        grid: SampleGrid,
        poses: FloatArray,
        with_drawn: bool,
    ) -> FaceCounts:
        # A few large poses are split into parts, bands of rows, each with its own counts.
        is_large = scene.mesh.n_faces + grid.n_samples // 8 >= LARGE_POSE
        n_parts = -(-self._threads // max(1, len(poses))) if is_large else 1
        n_parts = max(n_parts, -(-grid.n_samples // MAX_PART))
        sums = np.dtype(grid.count_type).itemsize if n_parts > 1 else 0
        check_counts(len(poses), scene.mesh.n_faces, (4 * n_parts + sums) * (1 + with_drawn))
        # Not cleared here: each thread clears its rows while they are in its cache.
        shape = (n_parts, len(poses), scene.mesh.n_faces)
        visible = np.empty(shape, np.int32)
        drawn = np.empty(shape, np.int32) if with_drawn else None
        filled = np.empty(shape[:2], np.int64)
        near, cull, clipped = limits(scene.mesh, camera, poses)

        def work(worker: _Worker, turn: slice) -> None:
            while turn.start < turn.stop:  # all poses of one part that are in the turn
                part, start = divmod(turn.start, len(poses))
                stop = min(len(poses), start + turn.stop - turn.start)
                some = slice(start, stop)
                worker.count(
                    (poses[some], near[some], cull[some]), worker.bands(part, n_parts),
                    visible[part, some], None if drawn is None else drawn[part, some],
                    filled[part, some],
                )  # fmt: skip
                turn = slice(turn.start + stop - start, turn.stop)

        self._share(scratch, n_parts * len(poses), work)
        return self._result(
            _total(visible, grid.count_type),
            None if drawn is None else _total(drawn, grid.count_type),
            grid.n_samples - _total(filled, np.int64),
            clipped,
        )

    def _count_targets(self, targets: TargetFaces, poses: FloatArray) -> tuple[IntArray, IntArray]:
        """Visible and drawn samples of the targets, (P, N) each."""
        near, cull = picture_limits(self.mesh, self.camera, poses)
        visible, drawn = np.empty((2, len(poses), len(targets.rows)), np.int64)

        def work(worker: _Worker, turn: slice) -> None:
            for row in range(turn.start, turn.stop):
                one = slice(row, row + 1)
                depths = partial(worker.depths, (poses[one], near[one], cull[one]))
                visible[row], drawn[row] = targets.count(self._grid, poses[row], near[row], depths)

        self._share(self._scratch, len(poses), work)
        return visible, drawn

    def _check(self) -> None:
        """Raise DeviceError where a miscompiled loop counts the self-test scene wrongly.

        It is counted once in a process.
        """
        counts = CPURasterizer._of_known_scene
        if counts is None:
            scene, grid = _Scene(self_test.MESH), SampleGrid(self_test.CAMERA)
            scratch = ScratchPool(partial(_Worker, scene, grid), 0)
            counts = CPURasterizer._of_known_scene = self._count(
                scratch, scene, self_test.CAMERA, grid, self_test.POSES, with_drawn=True
            )
        assert counts.drawn is not None
        is_equal = np.array_equal(counts.visible, self_test.VISIBLE)
        if not is_equal or not np.array_equal(counts.drawn, self_test.DRAWN):
            raise DeviceError(
                f"{self.info.renderer} counted a known scene wrongly; its answers cannot be "
                "trusted: compile the loops anew (`make native`) or use gl"
            )


class _Scene:
    """Mesh in clusters: vertices relative to its centre, corners in the order for ties."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.centre: FloatArray = mesh.bounds.mean(axis=0)
        if mesh not in _CLUSTERS:
            vertices, faces = mesh.vertices - self.centre, in_one_order(mesh).astype(np.int32)
            clusters = group_faces(vertices, faces, mesh.can_cull_back_faces)
            _CLUSTERS[mesh] = clusters, raster_loops.Scene(clusters, mesh.n_faces)
        self.clusters, self.checked = _CLUSTERS[mesh]


def _total(parts: Any, kind: type) -> Any:
    """Sum over the first axis, which is mostly 1."""
    return parts[0] if len(parts) == 1 else parts.sum(axis=0, dtype=kind)


class Canvas(NamedTuple):
    """Samples of an image, for the loops.

    Attributes
    ----------
    magnification : (2,) float64
        Least and greatest magnification of a length parallel to the image over its depth, samples.
    intrinsics : (4,) float64
        fx, fy, cx, cy in samples.
    width, height : int
        Size in samples.
    inner : (rows of blocks, 2) int64
        First block of each row that is wholly inside the image, and the one after the last.
    first, last : (height,) int32
        Samples of each row that count, from the first up to the last.
    is_rolled : bool
        Whether samples within the width and the height may be outside the image.
    """

    magnification: FloatArray
    intrinsics: FloatArray
    width: int
    height: int
    inner: IntArray
    first: Int32Array
    last: Int32Array
    is_rolled: bool


class _Worker:
    """Calls of the compiled loops by one thread, with memory of its own unless it is given some."""

    def __init__(
        self, scene: _Scene, grid: SampleGrid, memory: raster_loops.Worker | None = None
    ) -> None:
        self.scene, self.grid = scene, grid
        strip = SIDE << STRIP_BITS
        n_strips = -(-grid.width // strip)
        n_block_rows = -(-grid.height // SIDE)
        self.block_rows = min(n_block_rows, max(1, MAX_BAND // (n_strips * strip * SIDE)))
        if n_block_rows > self.block_rows > SIDE:
            self.block_rows -= self.block_rows % SIDE  # whole cells
        self.columns = n_strips << STRIP_BITS
        n_marks = self.block_rows * n_strips
        n_cells = -(-self.block_rows // SIDE) * (self.columns // SIDE)
        self.memory = memory or raster_loops.Worker(scene.checked, n_marks, n_cells)
        firsts, lasts = np.zeros((2, n_block_rows, SIDE), np.int32)
        firsts.ravel()[: grid.height], lasts.ravel()[: grid.height] = grid.runs
        inner = -(-firsts.max(axis=1) // SIDE), lasts.min(axis=1) // SIDE
        magnification = np.linalg.svd(np.diag(grid.lens[:2]) @ grid.mix, compute_uv=False)
        self.canvas = Canvas(
            magnification=np.sort(magnification),
            intrinsics=grid.lens,
            width=grid.width,
            height=grid.height,
            inner=np.stack(inner, axis=1).astype(np.int64),
            first=grid.runs[0],
            last=grid.runs[1],
            is_rolled=grid.is_rolled,
        )
        self.all_bands = self.bands(0, 1)

    def bands(self, part: int, n_parts: int) -> IntArray:
        """First row of each band of a part of the image, and the row after its last, (B, 2)."""
        ends = len(self.canvas.inner) * np.arange(part, part + 2) // n_parts
        tops = np.arange(ends[0], ends[1], self.block_rows)
        bottoms = np.minimum(tops + self.block_rows, ends[1])
        rows = SIDE * np.stack((tops, bottoms), axis=1)
        return np.minimum(rows, self.grid.height)

    def count(
        self, looks: Looks, bands: IntArray, visible: Int32Array, drawn: Int32Array | None,
        filled: IntArray, weights: tuple[Any, Any] = (NO_WEIGHTS, NO_BOUNDS),
    ) -> None:  # fmt: skip
        """Count the bands of poses into the rows of `visible`, `drawn`, `filled`."""
        moved = self.grid.axes(looks[0]).copy()
        moved[:, :3, 3] -= self.scene.centre
        output = visible, NO_COUNTS if drawn is None else drawn, filled, *weights
        self.memory.count((moved, *looks[1:]), self.canvas, bands, output)

    def draw(self, look: Looks, band: IntArray) -> None:
        """Draw a band of one pose, (2,): first row, and the one after the last."""
        visible = np.empty((1, self.scene.mesh.n_faces), np.int32)
        self.count(look, band[None], visible, None, np.empty(1, np.int64))

    def depths(
        self, look: Looks, top: int, bottom: int
    ) -> Iterator[tuple[Box, NDArray[np.float32]]]:
        """Depths of one pose in bands that hold some rows; see `targets.Depths`."""
        for band in self.all_bands:
            first, last = band.tolist()
            if first < bottom and last > top:
                height, width = last - first, self.grid.width
                face, depth = (
                    np.empty((height, width), np.int32),
                    np.full((height, width), np.inf, np.float32),
                )
                self.draw(look, band)
                self.memory.read_band(0, height, face, depth)
                yield (0, first, width, height), depth

    def render(self, look: Looks, face: Int32Array, depth: NDArray[np.float32]) -> None:
        """Write the samples with a surface of one pose: face index, depth in metres."""
        for band in self.all_bands:
            self.draw(look, band)
            top, bottom = band.tolist()
            self.memory.read_band(top, bottom, face, depth)
        # A face cut at the near plane can own a sample 1/512 of one beyond its rim.
        np.maximum(depth, np.float32(look[1][0]), out=depth)

    def picture(self, look: "Look") -> tuple[Int32Array, NDArray[np.float32]]:
        """Face, -1 for none, and depth (H, W) at each sample of a look."""
        shape = self.grid.height, self.grid.width
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)
        self.render(look, face, depth)
        return face, depth

    def add_counts(self, look: "Look", view: "View", visible: Any, drawn: Any) -> None:
        """Add the samples of a lens in a view to (F,) counts; see `raster.lens.ViewDrawer`."""
        if view.of_drawer is None:
            view.of_drawer = self._by_block(view)
        n_faces, filled = self.scene.mesh.n_faces, np.empty(1, np.int64)
        found = np.empty((2 - (drawn is None), 1, n_faces), np.int32)
        own = None if drawn is None else found[1]
        self.count(look, self.all_bands, found[0], own, filled, view.of_drawer)
        if drawn is not None:
            drawn += found[1, 0]
        if filled[0]:
            visible += found[0, 0]

    def _by_block(self, view: "View") -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """`weights` and `cell_bounds` of a view, for `Output`."""
        n_rows, n_columns = -(-len(self.canvas.inner) // SIDE) * SIDE, self.columns
        whole = np.zeros((SIDE * n_rows, SIDE * n_columns), np.uint8)
        whole[: self.grid.height, : self.grid.width] = view.weights()
        blocks = whole.reshape(n_rows, SIDE, n_columns, SIDE).swapaxes(1, 2)
        cells = blocks.reshape(n_rows // SIDE, SIDE, n_columns // SIDE, SIDE, LANES)
        is_used = cells.any(axis=(1, 3, 4)).ravel()
        bounds = np.where(is_used, 0, np.inf).astype(np.float32)
        return np.ascontiguousarray(blocks).ravel(), bounds
