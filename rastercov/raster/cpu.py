"""The CPU rasteriser: the contract of `rastercov.raster.contract` without a graphics library.

Each pose is independent and runs in one thread, start to end, through the compiled loops of
`kernels`, which hold no lock; many poses run side by side. Every thread has its own scratch memory,
so results do not depend on their number.
"""

from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera import Camera
from rastercov.closing import Closing
from rastercov.compiled import announce_compilation
from rastercov.errors import ConfigError, DeviceError, ResourceError
from rastercov.mesh import Mesh
from rastercov.parallel import share_poses, thread_count
from rastercov.pose import valid_poses
from rastercov.raster import canary, kernels
from rastercov.raster.contract import FaceCounts, RasterizerInfo, VisibilityBuffer
from rastercov.raster.grid import SampleGrid
from rastercov.raster.rules import in_one_order, limits

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MAX_SIDE = 1 << 20
"""Largest image side in samples: edges are walked in 64-bit whole numbers of 1/256 sample."""


class CPURasterizer(Closing):
    """The contract of `rastercov.raster.contract` in numba.

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
        announce_compilation(kernels.fill_tiles)
        self._scene = _Scene(mesh)
        self._check()

    def count(self, poses: ArrayLike, *, drawn: bool = True) -> FaceCounts:
        """Samples of each face in each pose; see `Rasterizer.count`."""
        matrices = valid_poses(poses)
        if not self._is_open:
            raise DeviceError("this rasteriser is closed; open a new one")
        return self._count(self._scene, self.camera, self._grid, matrices, drawn)

    def render(self, pose: ArrayLike) -> VisibilityBuffer:
        """Face index and depth at each pixel centre; see `Rasterizer.render`."""
        matrices = valid_poses(pose)
        if len(matrices) != 1:
            raise ConfigError(f"render takes one pose, got {len(matrices)}")
        if not self._is_open:
            raise DeviceError("this rasteriser is closed; open a new one")
        shape = (self.camera.height, self.camera.width)
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)
        near, cull, _ = limits(self.mesh, self.camera, matrices)
        visible = np.zeros((1, self.mesh.n_faces), np.int64)
        _View(self._scene, SampleGrid(self.camera)).count(
            matrices, near, cull, visible, None, (face, depth)
        )
        # A face cut at the near plane can own a sample 1/512 of one beyond its rim.
        return VisibilityBuffer(face, np.maximum(depth, np.float32(near[0])))

    def close(self) -> None:
        """End its use: later calls raise `DeviceError`. It holds nothing but memory."""
        self._is_open = False

    def _count(
        self,
        scene: "_Scene",
        camera: Camera,
        grid: SampleGrid,
        poses: FloatArray,
        with_drawn: bool,
    ) -> FaceCounts:
        shape = (len(poses), scene.mesh.n_faces)
        visible = np.zeros(shape, np.int64)
        drawn = np.zeros(shape, np.int64) if with_drawn else None
        near, cull, clipped = limits(scene.mesh, camera, poses)

        def worker(view: _View) -> Callable[[slice], None]:
            def work(turn: slice) -> None:
                rows = None if drawn is None else drawn[turn]
                view.count(poses[turn], near[turn], cull[turn], visible[turn], rows)

            return work

        n_threads = max(1, min(self._threads, len(poses)))
        share_poses(len(poses), [worker(_View(scene, grid)) for _ in range(n_threads)])
        background = grid.n_samples - visible.sum(axis=1)
        return FaceCounts(
            visible, drawn, background, clipped, grid.supersample, self.info, self.roll
        )

    def _check(self) -> None:
        """Count a scene whose counts are known: a compiler that errs is not trusted."""
        scene = _Scene(canary.MESH)
        grid = SampleGrid(canary.CAMERA)
        counts = self._count(scene, canary.CAMERA, grid, canary.POSES, with_drawn=True)
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
        self.vertices = np.ascontiguousarray(mesh.vertices - self.centre)
        self.faces = np.ascontiguousarray(in_one_order(mesh), dtype=np.int32)


class _View:
    """Scratch memory of one thread, which grows as poses need it."""

    def __init__(self, scene: _Scene, grid: SampleGrid) -> None:
        self.scene, self.grid = scene, grid
        self.size = np.array((grid.width, grid.height), np.int64)
        columns = -(-int(self.size[0]) // kernels.TILE_WIDTH)
        rows = -(-int(self.size[1]) // kernels.TILE_HEIGHT)
        self.starts = np.zeros(columns * rows + 1, np.int64)
        self.places = np.empty_like(self.starts)
        self.listed = np.empty(len(scene.faces), np.int32)
        n_samples = kernels.TILE_WIDTH * kernels.TILE_HEIGHT + kernels.LANES
        self.depth = np.empty(n_samples, np.float32)
        self.owner = np.empty(n_samples, np.int32)
        self._make_room(0)

    def _make_room(self, corners: int) -> None:
        """Arrays for every vertex and face, and this many corners that clipping adds."""
        self.room = corners
        vertices, faces = len(self.scene.vertices) + corners, len(self.scene.faces) + corners
        self.u, self.v, self.w = np.empty((3, vertices))
        self.steps = np.empty((vertices, 2), np.int32)
        self.triangles = np.empty((faces, 4), np.int32)
        self.tiles = np.empty((faces, 4), np.int32)

    def count(
        self,
        poses: FloatArray,
        near: FloatArray,
        cull: NDArray[np.bool_],
        visible: IntArray,
        drawn: IntArray | None,
        image: tuple[NDArray[np.int32], NDArray[np.float32]] | None = None,
    ) -> None:
        """Count these poses into their rows of `visible` and `drawn`, whatever these held."""
        scene, grid = self.scene, self.grid
        moved = grid.axes(poses).copy()
        moved[:, :3, 3] -= scene.centre
        face, depth = image or (np.empty((0, 0), np.int32), np.empty((0, 0), np.float32))
        all_drawn = np.zeros((1, scene.mesh.n_faces), np.int64) if drawn is None else drawn
        done = 0
        while done < len(poses):
            stopped = int(
                kernels.count_poses(
                    moved, near, cull, done, len(poses), scene.vertices, scene.faces, grid.lens,
                    self.size, grid.first, grid.last, self.u, self.v, self.w, self.steps,
                    self.triangles, self.tiles, self.starts, self.places, self.listed, self.depth,
                    self.owner, self.room, visible, all_drawn, drawn is not None, face, depth,
                )
            )  # fmt: skip
            if stopped < len(poses):
                self._grow()
            done = stopped

    def _grow(self) -> None:
        """Make room for the pose that the loops stopped at, whose vertices they have projected."""
        corners = kernels.CLIP_CORNERS * int(kernels.count_clipped(self.scene.faces, self.u))
        if corners > self.room:
            self._make_room(corners)
        else:
            self.listed = np.empty(int(self.starts[-1] * 1.25), np.int32)
