"""The CPU rasteriser: the contract of `rastercov.raster.contract` without a graphics library.

Each pose is independent and runs in one thread, start to end, through the compiled loops of
`kernels`, which hold no lock; many poses run side by side. Every thread has its own scratch memory,
so results do not depend on their number, nor on other threads that use the same rasteriser.
"""

from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import flag
from rastercov._closing import Closing
from rastercov._jit import announce_compilation
from rastercov._threads import ScratchPool, share_poses, thread_count
from rastercov.camera import Camera
from rastercov.errors import ConfigError, DeviceError, ResourceError
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.raster import self_test as canary
from rastercov.raster.contract import (
    FaceCounts,
    RasterizerInfo,
    VisibilityBuffer,
    check_counts,
    check_picture,
)
from rastercov.raster.cpu import loops as kernels
from rastercov.raster.cpu import memory as layout
from rastercov.raster.cpu.clusters import in_clusters
from rastercov.raster.rules import in_one_order, limits
from rastercov.raster.sample_grid import SampleGrid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
WordArray = NDArray[np.int32]

MAX_SIDE = 1 << 20
"""Largest image side in samples: edges are walked in 64-bit whole numbers of 1/256 sample."""

MAX_BAND = 1 << 17
"""Most samples of an image that are kept at a time."""

MOST_A_PART = 1 << 30
"""Most samples of an image that are counted in 32 bits."""

LARGE_POSE = 1 << 18
"""Faces, and eighths of samples, of a pose that is worth more than one thread."""


class CPURasterizer(Closing):
    """The contract of `rastercov.raster.contract` in numba.

    Any number of threads may use one rasteriser at once, and a forked process may go on with it.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    threads : int, optional
        Poses counted side by side; one for each core unless given.
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
        self._grid = SampleGrid(camera, supersample, roll)
        side = max(self._grid.width, self._grid.height)
        if side > MAX_SIDE:
            raise ResourceError(
                f"an image side must be at most {MAX_SIDE:,} samples, got {side:,}; "
                "lower supersample or use gl"
            )
        self._threads = thread_count(threads)
        self.mesh, self.camera, self.supersample, self.roll = mesh, camera, supersample, roll
        self.info = RasterizerInfo(
            backend="cpu",
            plan="threads",
            renderer=f"numba {version('numba')}",
            driver="",
            device="cpu",
            depth="float32 1/z",
            shaders="",
        )
        self._is_open = True
        announce_compilation(kernels.count_poses)
        self._scene = _Scene(mesh)
        self._scratch = ScratchPool(partial(_View, self._scene, self._grid), self._threads)
        self._check()

    def count(self, poses: ArrayLike, *, drawn: bool = True) -> FaceCounts:
        """Samples of each face in each pose; see `Rasterizer.count`."""
        self._check_open()
        matrices, drawn = valid_poses(poses), flag("drawn", drawn)
        return self._count(self._scratch, self._scene, self.camera, self._grid, matrices, drawn)

    def render(self, pose: ArrayLike) -> VisibilityBuffer:
        """Face index and depth at each pixel centre; see `Rasterizer.render`."""
        self._check_open()
        matrices = valid_poses(pose)
        if len(matrices) != 1:
            raise ConfigError(f"render takes one pose, got {len(matrices)}")
        check_picture(self.camera)
        near, cull, _ = limits(self.mesh, self.camera, matrices)
        view = _View(self._scene, SampleGrid(self.camera))
        face, depth = view.render(matrices, near, cull)
        # A face cut at the near plane can own a sample 1/512 of one beyond its rim.
        return VisibilityBuffer(face, np.maximum(depth, np.float32(near[0]), out=depth))

    def close(self) -> None:
        """End its use: later calls raise `DeviceError`, calls in other threads end as ever.

        It holds nothing but memory.
        """
        self._is_open = False
        self._scratch.close()

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceError("this rasteriser is closed; open a new one")

    def _count(
        self,
        scratch: "ScratchPool[_View]",
        scene: "_Scene",
        camera: Camera,
        grid: SampleGrid,
        poses: FloatArray,
        with_drawn: bool,
    ) -> FaceCounts:
        # A few large poses are shared out by bands of their rows, each into counts of its own.
        is_large = scene.mesh.n_faces + grid.n_samples // 8 >= LARGE_POSE
        n_parts = -(-self._threads // max(1, len(poses))) if is_large else 1
        n_parts = max(n_parts, -(-grid.n_samples // MOST_A_PART))
        n_turns = n_parts * len(poses)
        sums = np.dtype(grid.count_type).itemsize if n_parts > 1 else 0
        check_counts(len(poses), scene.mesh.n_faces, (4 * n_parts + sums) * (1 + with_drawn))
        # The threads clear their rows, while these are about to be used.
        shape = (n_parts, len(poses), scene.mesh.n_faces)
        visible = np.empty(shape, np.int32)
        drawn = np.empty(shape, np.int32) if with_drawn else None
        filled = np.empty(shape[:2], np.int64)
        near, cull, clipped = limits(scene.mesh, camera, poses)

        def worker(view: _View) -> Callable[[slice], None]:
            def work(turn: slice) -> None:
                while turn.start < turn.stop:  # as many poses of one part as there are
                    part, start = divmod(turn.start, len(poses))
                    stop = min(len(poses), start + turn.stop - turn.start)
                    view.count(
                        poses[start:stop], near[start:stop], cull[start:stop], (part, n_parts),
                        visible[part, start:stop],
                        None if drawn is None else drawn[part, start:stop],
                        filled[part, start:stop],
                    )  # fmt: skip
                    turn = slice(turn.start + stop - start, turn.stop)

            return work

        n_threads = max(1, min(self._threads, n_turns))
        views = scratch.take(n_threads)
        share_poses(n_turns, [worker(view) for view in views])
        scratch.give_back(views)
        return FaceCounts(
            _total(visible, grid.count_type),
            None if drawn is None else _total(drawn, grid.count_type),
            grid.n_samples - _total(filled, np.int64),
            clipped,
            grid.supersample,
            self.info,
            self.roll,
        )

    def _check(self) -> None:
        """Count a scene whose counts are known: a compiler that errs is not trusted."""
        scene = _Scene(canary.MESH)
        grid = SampleGrid(canary.CAMERA)
        scratch = ScratchPool(partial(_View, scene, grid), 0)
        counts = self._count(scratch, scene, canary.CAMERA, grid, canary.POSES, with_drawn=True)
        assert counts.drawn is not None
        right = np.array_equal(counts.visible, canary.VISIBLE)
        if not right or not np.array_equal(counts.drawn, canary.DRAWN):
            raise DeviceError(
                f"{self.info.renderer} counted a known scene wrongly; its answers cannot be "
                "trusted: remove the numba cache or use gl"
            )


class _Scene:
    """A mesh as the loops want it: vertices from the middle, corners in the order for ties."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.centre: FloatArray = mesh.bounds.mean(axis=0)
        vertices = np.ascontiguousarray(mesh.vertices - self.centre)
        faces = np.ascontiguousarray(in_one_order(mesh), dtype=np.int32)
        self.clusters = in_clusters(vertices, faces, mesh.can_cull_back_faces)


def _total(parts: Any, kind: type) -> Any:
    """Sum over the first axis, which is mostly 1."""
    return parts[0] if len(parts) == 1 else parts.sum(axis=0, dtype=kind)


class _View:
    """Scratch memory of one thread."""

    def __init__(self, scene: _Scene, grid: SampleGrid) -> None:
        self.scene, self.grid = scene, grid
        self.size = np.array((grid.width, grid.height), np.int64)
        side, patch = layout.SIDE, layout.SIDE << layout.PATCH_BITS
        n_patches = -(-grid.width // patch)
        n_block_rows = -(-grid.height // side)
        self.block_rows = min(n_block_rows, max(1, MAX_BAND // (n_patches * patch * side)))
        self.columns = n_patches << layout.PATCH_BITS
        self.marks = np.zeros(self.block_rows * n_patches, np.uint8)
        n_samples = self.marks.size * patch * side
        self.depth = layout.aligned_zeros(n_samples, np.float32)
        self.owner = layout.aligned_zeros(n_samples, np.int32)
        n_clusters = scene.clusters.bounds.shape[1]
        self.kept = np.empty(n_clusters // layout.LANES, np.int64)
        self.middles = layout.aligned_zeros((2, n_clusters), np.float64)
        self.seen = np.empty(n_clusters + layout.LANES, np.int32)
        self.scratch = kernels.make_scratch()
        self.no_drawn = np.zeros((1, 1), np.int32)
        firsts, lasts = np.zeros((2, n_block_rows, side), np.int32)
        firsts.ravel()[: grid.height], lasts.ravel()[: grid.height] = grid.first, grid.last
        inner = -(-firsts.max(axis=1) // side), lasts.min(axis=1) // side
        self.inner = np.stack(inner, axis=1).astype(np.int64)
        magnified = np.linalg.svd(np.diag(grid.lens[:2]) @ grid.mix, compute_uv=False)
        self.focal = np.sort(magnified)

    def bands(self, part: int, n_parts: int) -> IntArray:
        """First rows and rows after the last of the bands of a part of the image, (B, 2)."""
        ends = len(self.inner) * np.arange(part, part + 2) // n_parts
        tops = np.arange(ends[0], ends[1], self.block_rows)
        bottoms = np.minimum(tops + self.block_rows, ends[1])
        rows = layout.SIDE * np.stack((tops, bottoms), axis=1)
        bands: IntArray = np.minimum(rows, self.grid.height)
        return bands

    def count(
        self,
        poses: FloatArray,
        near: FloatArray,
        cull: NDArray[np.bool_],
        part: tuple[int, int],
        visible: WordArray,
        drawn: WordArray | None,
        filled: IntArray,
    ) -> None:
        """Count one part of so many of these poses into rows of `visible`, `drawn`, `filled`."""
        self._count(poses, near, cull, self.bands(*part), visible, drawn, filled)

    def render(
        self, pose: FloatArray, near: FloatArray, cull: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Face and depth at each sample of one pose, (1, 4, 4)."""
        shape = self.grid.height, self.grid.width
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)
        visible = np.empty((1, self.scene.mesh.n_faces), np.int32)
        for band in self.bands(0, 1):
            self._count(pose, near, cull, band[None], visible, None, np.empty(1, np.int64))
            kernels.read_band(
                band[0], band[1], self.columns, self.marks, self.depth, self.owner, face, depth
            )
        return face, depth

    def _count(
        self,
        poses: FloatArray,
        near: FloatArray,
        cull: NDArray[np.bool_],
        bands: IntArray,
        visible: WordArray,
        drawn: WordArray | None,
        filled: IntArray,
    ) -> None:
        scene, grid = self.scene, self.grid
        moved = grid.axes(poses).copy()
        moved[:, :3, 3] -= scene.centre
        kernels.count_poses(
            moved, near, cull, self.focal, grid.lens, self.size, bands, scene.clusters.arrays,
            self.inner, grid.first, grid.last, grid.is_rolled, self.marks, self.depth, self.owner,
            visible, self.no_drawn if drawn is None else drawn, filled, drawn is not None,
            self.kept, self.middles, self.seen, self.scratch,
        )  # fmt: skip
