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

from abc import abstractmethod
from collections.abc import Iterator
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
from rastercov.core.camera.pose import limits
from rastercov.core.coverage.face_pass import lens_of, scene_of
from rastercov.core.coverage.task import Reason, Rules
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.contract import (
    Criteria,
    FaceCounts,
    Judged,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
    area_units,
    bits_of,
    check_counts,
    room_for_bits,
)
from rastercov.core.raster.sample_grid import SampleGrid
from rastercov.core.raster.targets import in_one_order
from rastercov.engine import solver_raster
from rastercov.engine.solver_raster import MAX_BAND, RADIUS

Looks = tuple[FloatArray, FloatArray, BoolArray]
"""Poses (V, P, 4, 4) of V canvases, the depths of their near planes, and whether back faces are
hidden, (P,)."""
Drawn = tuple[list[solver_raster.Canvas], Looks]

MAX_SIDE = 1 << 20
"""Largest image side in samples: edge functions are 64-bit integers of 1/256 sample."""

MAX_PART = 1 << 30
"""Most samples of an image that are counted in 32 bits."""

LARGE_POSE = 1 << 18
"""Faces, plus an eighth of the samples, from which on a pose is shared by threads."""

REGULAR = (
    *(np.empty(0, kind) for kind in (np.int32, np.uint16, np.float32, np.int32, np.int32)),
    np.empty((0, 2), np.float32),
)
"""For a canvas: samples that are not scattered."""

NO_TARGETS = (*(np.empty(0, np.int64),) * 2, *(np.empty((0, 0), np.int64),) * 2)
"""Rows, rows of opaque faces, and counts of targets where there are none."""


class InLoops(Rasterizer):
    """Rasteriser in compiled loops: what a pinhole and any other lens have in common.

    Parameters
    ----------
    mesh, camera, threads
        As for `CPURasterizer`.
    grid : SampleGrid
        Samples of the camera.
    """

    _n_parts = 1
    """Parts of an image that are counted one after another because it is large."""

    def __init__(self, mesh: Mesh, camera: Camera, grid: SampleGrid, threads: int | None) -> None:
        super().__init__(mesh, camera, grid.supersample, grid.roll)
        self._grid, self._threads = grid, thread_count(threads)
        self._drawing = drawing_of(mesh, self._threads)

    def _parts_of(self, n_poses: int) -> int:
        """Parts that a canvas is counted in."""
        return 1

    @abstractmethod
    def _draw(self, poses: FloatArray, near: FloatArray, cull: BoolArray) -> Iterator[Drawn]:
        """Yield the canvases that are drawn together, and the looks of poses at them."""

    def _count_faces(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        grid, targets, threads = self._grid, self._targets, self._threads
        n_poses, n_parts, kind = len(poses), self._parts_of(len(poses)), grid.count_type
        n_faces = self.mesh.opaque.n_faces
        rows = 4 * min(threads, n_parts * n_poses) if n_parts > 1 else 0  # of threads
        check_counts(n_poses, n_faces, (np.dtype(kind).itemsize + rows) * (1 + drawn))
        # Not cleared here: each thread clears its rows while they are in its cache.
        visible: Any = np.empty((n_poses, n_faces), kind)
        alone = np.empty_like(visible if drawn else visible[:0])
        filled = np.empty(n_poses, np.int64)
        count = self._drawing.count if kind == np.int32 else self._drawing.count_long
        seen = np.zeros((2, n_poses, len(targets.rows) if targets else 0), np.int64)
        visible_of, drawn_of = seen
        near, cull, clipped = limits(self.mesh, self.camera, poses)
        for number, (canvases, looks) in enumerate(self._draw(poses, near, cull)):
            count(canvases, looks, (visible, alone, filled, number > 0), n_parts, threads)
            if targets:
                self._drawing.count_targets(
                    canvases, looks, targets.corners, visible_of, drawn_of, threads
                )
        if self.camera.is_curved:  # some do not count
            filled = visible.sum(axis=1, dtype=np.int64)
        background = grid.n_samples - filled
        result = self._result(visible, alone if drawn else None, background, clipped)
        return self._with_targets(result, *seen) if targets else result

    def _why_not_judged(self, criteria: Criteria) -> str:
        """Reason why faces are judged from their counts; see `Rasterizer._why_not_judged`."""
        self._check_open()
        if self._n_parts > 1:
            return "parts of a large image are counted one after another"
        left = {name for name, value in criteria.rules.items() if value} - {*Rules._fields}
        return f"no loop judges {', '.join(left)}" if left else ""

    def _judge(self, poses: FloatArray, criteria: Criteria) -> Judged:
        """Faces that poses cover, while their counts are in the cache; see `Rasterizer._judge`."""
        self._check_open()
        mesh, dense = self.mesh, np.ascontiguousarray(poses)
        near, cull, clipped = limits(mesh, self.camera, dense)
        (shown,) = self._draw(dense, near, cull)
        own = np.where(criteria.may_be_covered, Reason.COVERED, Reason.DEGENERATE)
        scene = scene_of(mesh)._replace(own=own.astype(np.uint8))
        rules = Rules._make(criteria.rules[name] for name in Rules._fields)
        judged = dense, scene, rules, area_units(mesh), float(self.supersample**2)
        of_targets = NO_TARGETS
        if targets := self._targets:
            visible, drawn = np.zeros((2, len(poses), len(targets.rows)), np.int64)
            self._drawing.count_targets(*shown, targets.corners, visible, drawn, self._threads)
            of_targets = targets.rows, targets.opaque, visible, drawn
        words = room_for_bits(len(poses), mesh.n_faces)
        found = words, np.empty(len(poses), np.int64), np.zeros(mesh.n_faces, np.int64)
        self._drawing.judge(
            *shown, lens_of(self.camera), (*judged, of_targets, *found), self._threads
        )
        return bits_of(mesh, *found), clipped

    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`, calls in other threads complete."""
        super().close()
        self._drawing.close()


class CPURasterizer(InLoops):
    """Rasteriser of pinholes in compiled loops.

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
        if camera.is_curved:
            camera.check_pinhole(
                "expected a pinhole for CPURasterizer", "use open_rasterizer, which draws any lens"
            )
        grid = SampleGrid(camera, supersample, roll)
        side = max(grid.width, grid.height)
        if side > MAX_SIDE:
            raise ResourceError(
                f"expected an image side of at most {MAX_SIDE:,} samples, got {side:,}; "
                "lower supersample or use gl"
            )
        super().__init__(mesh, camera, grid, threads)
        self._n_parts = -(-grid.n_samples // MAX_PART)
        self.info = RasterizerInfo(
            backend="cpu",
            plan="threads",
            renderer=f"rastercov {rastercov.__version__}",
            driver="",
            device="cpu",
            depth="float32 1/z",
            shaders="",
        )
        self._canvas = self._picture = canvas_of(grid)
        if supersample > 1 or roll:
            self._picture = canvas_of(SampleGrid(camera))
        self._check()

    def _parts_of(self, n_poses: int) -> int:
        # A few large poses are split into parts, bands of rows, each with its own counts.
        is_large = self.mesh.opaque.n_faces + self._grid.n_samples // 8 >= LARGE_POSE
        return max(self._n_parts, -(-self._threads // max(1, n_poses)) if is_large else 1)

    def _draw(self, poses: FloatArray, near: FloatArray, cull: BoolArray) -> Iterator[Drawn]:
        yield [self._canvas], (poses[None], near, cull)

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
        looks = poses[None], *limits(self.mesh, self.camera, poses, asks_cut=False)[:2]
        self._drawing.render(self._picture, looks, face, depth, self._threads)
        return face, depth

    def _check(self) -> None:
        """Raise DeviceError where a miscompiled loop counts the self-test scene wrongly.

        It is counted once in a process.
        """
        if CPURasterizer._of_known_scene is None:
            known = _Known(self_test.MESH, self_test.CAMERA, threads=1)
            CPURasterizer._of_known_scene = known.count(self_test.POSES)
        counts = CPURasterizer._of_known_scene
        is_equal = np.array_equal(counts.visible, self_test.VISIBLE)
        if not is_equal or not np.array_equal(counts.drawn_pixels, self_test.DRAWN):
            raise DeviceError(
                "expected correct counts of a known scene, got wrong ones from "
                f"{self.info.renderer}; compile the modules again (`make native`) or use gl"
            )


class _Known(CPURasterizer):
    """Rasteriser of the known scene."""

    def _check(self) -> None:
        """Nothing: its counts are what is checked."""


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


def clusters_of(mesh: Mesh) -> tuple[Any, ...]:
    """Arrays of the clusters of the opaque faces, their bounds last; see `records.hpp`."""
    return _scene_of(mesh.opaque).clusters


def farthest_depths(mesh: Mesh, poses: FloatArray, near: FloatArray) -> FloatArray:
    """Depths C of parallel rays, (P,), metres: surfaces are compared by C - z, as pinholes by 1/z.

    They are beyond the mesh by its size, so that rounding is relative to that.
    """
    bounds = clusters_of(mesh)[-1]
    x, y, z = bounds[:3]
    radius = float((np.sqrt(x * x + y * y + z * z) + bounds[RADIUS]).max(initial=0.0)) or 1.0
    x, y, z = ((mesh.centre - poses[:, :3, 3]) * poses[:, :3, 2]).T
    return np.maximum(x + y + z + radius, near) + 2 * radius


def canvas_of(grid: SampleGrid, scattered: tuple[Any, ...] = REGULAR) -> solver_raster.Canvas:
    """Canvas of the samples of a grid, or of those that are scattered in it."""
    size, kind = (grid.width, grid.height), (grid.is_rolled, grid.is_parallel)
    return solver_raster.Canvas(scattered, (*size, grid.lens, grid.mix, grid.runs, *kind), MAX_BAND)
