"""CPU rasteriser: the contract of `rastercov.core.raster.contract` without a graphics library.

Poses are shared among threads of the engine (`engine/solver/raster.hpp`), which owns the mesh in
clusters, canvases and scratch memory: results depend neither on the number of threads nor on other
threads that use the same rasteriser.

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

The files are in `rastercov/engine/raster`: `band.hpp` has the loop over the clusters of a band,
`fill.hpp` those over faces and blocks, `coverage.hpp` those that count without depth,
`occlusion.hpp` skips clusters and faces behind what is drawn; `records.hpp` defines the records.
`rastercov.reference.samples` works the counts out another way, a ray a sample.

Positions are integers of 1/256 sample, and edge functions are exact. A sample on a left or upper
edge is inside and one on a right or lower edge outside, so every sample belongs to exactly one of
two triangles that share an edge.
"""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

import rastercov
from rastercov.base import (
    BoolArray,
    DeviceError,
    Float32Array,
    FloatArray,
    Int32Array,
    ResourceError,
    once_each,
    thread_count,
)
from rastercov.core.camera import Camera, valid_poses
from rastercov.core.camera.near_plane import limits, picture_limits
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.contract import (
    FaceCounts,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
    check_counts,
)
from rastercov.core.raster.sample_grid import SampleGrid
from rastercov.core.raster.tie_order import in_one_order
from rastercov.engine import solver_raster
from rastercov.engine.solver_raster import MAX_BAND, RADIUS

Looks = tuple[FloatArray, FloatArray, BoolArray]
"""Poses (V, P, 4, 4) of V canvases, the depths of their near planes, and whether back faces are
hidden, (P,)."""

MAX_SIDE = 1 << 20
"""Largest image side in samples: edge functions are 64-bit integers of 1/256 sample."""

MAX_PART = 1 << 30
"""Most samples of an image that are counted in 32 bits."""

BOUNDS_OF_CLUSTERS = 7
"""Index of the bounds among what describes the clusters of a scene."""

LARGE_POSE = 1 << 18
"""Faces, plus an eighth of the samples, from which on a pose is shared by threads."""

REGULAR = (
    *(np.empty(0, kind) for kind in (np.int32, np.uint16, np.float32, np.int32, np.int32)),
    np.empty((0, 2), np.float32),
)
"""For a canvas: samples that are not scattered."""


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

    _of_known_scene: ClassVar["Counts | None"] = None

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        supersample: int = 1,
        roll: float = 0.0,
        threads: int | None = None,
    ) -> None:
        if camera.is_curved:
            camera.check_pinhole(
                "expected a pinhole for CPURasterizer", "use open_rasterizer, which draws any lens"
            )
        self._grid = SampleGrid(camera, supersample, roll)
        side = max(self._grid.width, self._grid.height)
        if side > MAX_SIDE:
            raise ResourceError(
                f"expected an image side of at most {MAX_SIDE:,} samples, got {side:,}; "
                "lower supersample or use gl"
            )
        super().__init__(mesh, camera, supersample, roll)
        self._threads = thread_count(threads)
        self.info = RasterizerInfo(
            backend="cpu",
            plan="threads",
            renderer=f"rastercov {rastercov.__version__}",
            driver="",
            device="cpu",
            depth="float32 1/z",
            shaders="",
        )
        self._canvas, self._picture = canvas_of(self._grid), canvas_of(SampleGrid(camera))
        self._drawing = drawing_of(mesh, self._threads)
        self._check()

    def _count_faces(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        grid, mesh, targets = self._grid, self.mesh.opaque, self._targets
        # A few large poses are split into parts, bands of rows, each with its own counts.
        is_large = mesh.n_faces + grid.n_samples // 8 >= LARGE_POSE
        n_parts = -(-self._threads // max(1, len(poses))) if is_large else 1
        n_parts = max(n_parts, -(-grid.n_samples // MAX_PART))
        counts = Counts(len(poses), mesh.n_faces, grid, drawn, (n_parts, self._threads))
        near, cull, clipped = limits(mesh, self.camera, poses)
        looks = poses[None], near, cull
        counts.add(self._drawing, [self._canvas], looks)
        background = grid.n_samples - counts.filled
        result = self._result(counts.visible, counts.drawn, background, clipped)
        if targets is None:
            return result
        seen = np.zeros((2, len(poses), len(targets.rows)), np.int64)
        of_targets = targets.corners, seen[0], seen[1]
        self._drawing.count_targets([self._canvas], looks, *of_targets, self._threads)
        return self._with_targets(result, *seen)

    def _draw_faces(self, poses: FloatArray) -> tuple[Int32Array, Float32Array]:
        face, depth = self._draw_all(poses)
        return face[0], depth[0]

    def render_all(self, poses: ArrayLike) -> VisibilityBuffer:
        """`render` of many poses, (P, H, W), in threads; for images that are small."""
        self._check_open()
        return self._buffer_of(*self._draw_all(valid_poses(poses)))

    def _draw_all(self, poses: FloatArray) -> tuple[Int32Array, Float32Array]:
        shape = len(poses), self.camera.height, self.camera.width
        face, depth = np.empty(shape, np.int32), np.empty(shape, np.float32)
        looks = poses[None], *picture_limits(self.mesh, self.camera, poses)
        self._drawing.render(self._picture, looks, face, depth, self._threads)
        return face, depth

    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`, calls in other threads complete."""
        super().close()
        self._drawing.close()

    def _check(self) -> None:
        """Raise DeviceError where a miscompiled loop counts the self-test scene wrongly.

        It is counted once in a process.
        """
        if CPURasterizer._of_known_scene is None:
            mesh, camera, poses = self_test.MESH, self_test.CAMERA, self_test.POSES
            grid, (near, cull, _) = SampleGrid(camera), limits(mesh, camera, poses)
            counts = Counts(len(poses), mesh.n_faces, grid, True, (1, 1))
            counts.add(drawing_of(mesh, 0), [canvas_of(grid)], (poses[None], near, cull))
            CPURasterizer._of_known_scene = counts
        counts = CPURasterizer._of_known_scene
        is_equal = np.array_equal(counts.visible, self_test.VISIBLE)
        if not is_equal or not np.array_equal(counts.drawn, self_test.DRAWN):
            raise DeviceError(
                "expected correct counts of a known scene, got wrong ones from "
                f"{self.info.renderer}; compile the modules again (`make native`) or use gl"
            )


def drawing_of(mesh: Mesh, threads: int) -> solver_raster.Rasterizer:
    """Rasteriser of the opaque faces of a mesh, that keeps memory for some threads.

    It is of no use after the mesh, which keeps its scene.
    """
    return solver_raster.Rasterizer(_scene_of(mesh.opaque), threads)


@once_each
def _scene_of(mesh: Mesh) -> solver_raster.Scene:
    """A mesh in clusters: most of the time of a small picture, of which a page wants many.

    One for all threads: another would free what the first draws.
    """
    vertices, centre = np.ascontiguousarray(mesh.vertices), mesh.centre
    faces = np.ascontiguousarray(in_one_order(mesh), np.int32)
    return solver_raster.Scene(vertices, faces, centre, bool(mesh.can_cull_back_faces))


def farthest_depths(mesh: Mesh, poses: FloatArray, near: FloatArray) -> FloatArray:
    """Depths C of parallel rays, (P,), metres: surfaces are compared by C - z, as pinholes by 1/z.

    They are beyond the mesh by its size, so that rounding is relative to that.
    """
    bounds = _scene_of(mesh.opaque).clusters[BOUNDS_OF_CLUSTERS]
    x, y, z = bounds[:3]
    radius = float((np.sqrt(x * x + y * y + z * z) + bounds[RADIUS]).max(initial=0.0)) or 1.0
    x, y, z = ((mesh.centre - poses[:, :3, 3]) * poses[:, :3, 2]).T
    return np.maximum(x + y + z + radius, near) + 2 * radius


def canvas_of(grid: SampleGrid, scattered: tuple[Any, ...] = REGULAR) -> solver_raster.Canvas:
    """Canvas of the samples of a grid, or of those that are scattered in it."""
    size, kind = (grid.width, grid.height), (grid.is_rolled, grid.is_parallel)
    return solver_raster.Canvas(scattered, (*size, grid.lens, grid.mix, grid.runs, *kind), MAX_BAND)


class Counts:
    """Counts of poses through canvases, which threads add to.

    Parameters
    ----------
    n_poses, n_faces : int
    grid : SampleGrid
        All samples.
    drawn : bool
        Whether they are counted, too.
    shares : (int, int)
        Parts that a canvas is counted in, and threads.

    Attributes
    ----------
    visible, drawn : (P, F) int32 or int64
        As of `FaceCounts`.
    filled : (P,) int64
        Samples with a face in them; of scattered ones also those that do not count.
    """

    def __init__(
        self, n_poses: int, n_faces: int, grid: SampleGrid, drawn: bool, shares: tuple[int, int]
    ) -> None:
        self._shares, kind = shares, grid.count_type
        rows = 4 * min(shares[1], shares[0] * n_poses) if shares[0] > 1 else 0  # of threads
        check_counts(n_poses, n_faces, (np.dtype(kind).itemsize + rows) * (1 + drawn))
        # Not cleared here: each thread clears its rows while they are in its cache.
        self.visible: Any = np.empty((n_poses, n_faces), kind)
        self.drawn: Any = np.empty_like(self.visible) if drawn else None
        self.filled, self._adds = np.empty(n_poses, np.int64), False

    def add(
        self, drawing: solver_raster.Rasterizer, canvases: list[solver_raster.Canvas], looks: Looks
    ) -> None:
        """Add the samples of canvases; the first call clears what was there."""
        drawn = self.visible[:0] if self.drawn is None else self.drawn
        count = drawing.count if self.visible.dtype == np.int32 else drawing.count_long
        out = self.visible, drawn, self.filled, self._adds
        count(canvases, looks, out, *self._shares)
        self._adds = True
