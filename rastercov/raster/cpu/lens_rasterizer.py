"""CPU rasteriser of cameras with any lens: faces as they are, samples where the lens puts them.

    stage         reads                      writes                    file
    ------------  -------------------------  ------------------------  ------------
    once:         lens, sample grid          Patch for each plane      lens_samples
    for each band of rows, pose and plane:
    1 project     vertices, pose             Seen: plane, canvas       lens_kernels
    2 set up      points of a face           FacePlanes, Reach         lens_kernels
    3 cover       FacePlanes, Patch          Image: 1/z, face; counts  lens_cover

Nothing is rounded to a grid: samples are tested at the places that the lens gives them, to 2^-24 of
half a block, and depth is compared as float32 1/z. A sample without a ray meets no face and is
background.
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
from rastercov.errors import ConfigError, DeviceError
from rastercov.lenses.lane_kernels import lane_scratch
from rastercov.mesh import Mesh
from rastercov.near_plane import limits, picture_limits
from rastercov.pose import Poses as AcceptedPoses
from rastercov.pose import valid_poses
from rastercov.raster import self_test
from rastercov.raster.contract import (
    FaceCounts,
    RasterizerInfo,
    VisibilityBuffer,
    check_counts,
    check_picture,
)
from rastercov.raster.cpu import lens_kernels as kernels
from rastercov.raster.cpu.lens_records import (
    FACES_AT_A_TIME,
    SAMPLES,
    TILES_AT_A_TIME,
    Image,
    Listed,
    Patch,
    Seen,
)
from rastercov.raster.cpu.lens_samples import SampleTables, tables_of
from rastercov.raster.cpu.memory import LANES, aligned_zeros, bit_table
from rastercov.raster.tie_order import in_one_order

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class LensRasterizer(Closing):
    """Rasteriser of cameras with any lens, compiled by numba.

    Any number of threads may use one rasteriser at once, and so may a forked process.

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
        announce_compilation(kernels.draw)
        self._scene = _Scene(mesh)
        self._tables = tables_of(camera, supersample, roll)
        self._scratch = ScratchPool(partial(_Worker, self._scene), self._threads)
        self._check()

    def count(self, poses: ArrayLike, *, drawn: bool = True) -> FaceCounts:
        """Samples of each face in each pose; see `Rasterizer.count`."""
        self._check_open()
        matrices, drawn = valid_poses(poses), flag("drawn", drawn)
        return self._count(self._scratch, self._scene, self.camera, self._tables, matrices, drawn)

    def render(self, pose: ArrayLike) -> VisibilityBuffer:
        """Face index and depth at each pixel centre; see `Rasterizer.render`."""
        self._check_open()
        accepted = AcceptedPoses.of(pose)
        if len(accepted) != 1:
            raise ConfigError(f"render takes one pose, got {len(accepted)}")
        check_picture(self.camera)
        matrix = accepted.world_from_camera
        near, cull = picture_limits(self.mesh, self.camera, matrix)
        shape = self.camera.height, self.camera.width
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)
        tables = tables_of(self.camera, 1, 0.0)
        by_ray = len(tables.frames) > 1
        (worker,) = self._scratch.take(1)
        for band in range(tables.n_bands):
            for patch in tables.band(band, self._threads):
                image, _ = worker.draw(matrix[0], near[0], cull[0], patch, None)
                kernels.read_image(image, patch, by_ray, face, depth)
        self._scratch.give_back([worker])
        return VisibilityBuffer(self._scene.name_of[face], depth)

    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`, calls in other threads complete."""
        self._is_open = False
        self._scratch.close()

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceError("this rasteriser is closed; open a new one")

    def _count(
        self,
        scratch: "ScratchPool[_Worker]",
        scene: "_Scene",
        camera: Camera,
        tables: SampleTables,
        poses: FloatArray,
        with_drawn: bool,
    ) -> FaceCounts:
        mesh, kind = scene.mesh, tables.grid.count_type
        check_counts(len(poses), mesh.n_faces, np.dtype(kind).itemsize * (1 + with_drawn))
        near, cull, clipped = limits(mesh, camera, poses)
        shape = len(poses), mesh.n_faces
        visible: Any = np.zeros(shape, kind)
        drawn: Any = np.zeros(shape, kind) if with_drawn else None
        filled = np.zeros(len(poses), np.int64)
        workers = scratch.take(max(1, min(self._threads, len(poses))))
        for band in range(tables.n_bands):
            patches = tables.band(band, self._threads)

            def work_of(
                worker: _Worker, patches: tuple[Patch, ...] = patches
            ) -> Callable[[slice], None]:
                def work(turn: slice) -> None:
                    for row in range(turn.start, turn.stop):
                        counts = visible[row], None if drawn is None else drawn[row]
                        for patch in patches:
                            filled[row] += worker.count(
                                poses[row], near[row], cull[row], patch, *counts
                            )

                return work

            share_poses(len(poses), [work_of(worker) for worker in workers])
        scratch.give_back(workers)
        return FaceCounts(
            visible,
            drawn,
            tables.grid.n_samples - filled,
            clipped,
            tables.grid.supersample,
            self.info,
            self.roll,
        )

    def _check(self) -> None:
        """Count the self-test scene; DeviceError where a miscompiled loop counts it wrongly."""
        scene = _Scene(self_test.MESH)
        counts = self._count(
            ScratchPool(partial(_Worker, scene), 0),
            scene,
            self_test.CAMERA,
            tables_of(self_test.CAMERA, 1, 0.0),
            self_test.POSES,
            with_drawn=True,
        )
        assert counts.drawn is not None
        is_equal = np.array_equal(counts.visible, self_test.VISIBLE)
        if not is_equal or not np.array_equal(counts.drawn, self_test.DRAWN):
            raise DeviceError(
                f"{self.info.renderer} counted a known scene wrongly; its answers cannot be "
                "trusted: remove the numba cache"
            )


class _Scene:
    """Mesh with its opaque faces and its targets apart, corners in the order for ties."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        # The centre is that of `Mesh.opaque` in both, so that points are rounded alike.
        self.centre: FloatArray = mesh.opaque.bounds.mean(axis=0)
        self.vertices = np.ascontiguousarray(mesh.vertices - self.centre)
        ends = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        self.box: FloatArray = np.stack(np.meshgrid(*np.transpose(ends)), axis=-1).reshape(8, 3)
        opaque: IntArray = np.flatnonzero(~mesh.target_mask)
        # Adding to a slice takes a fifth of the time.
        self.opaque: Any = opaque if mesh.has_targets else slice(None)
        self.targets: IntArray = np.flatnonzero(mesh.target_mask)
        faces = in_one_order(mesh).astype(np.int32)
        if mesh.has_targets and mesh.opaque.can_cull_back_faces:
            faces = mesh.faces.astype(np.int32)  # winding decides which faces are left out
        self.faces = np.ascontiguousarray(faces[opaque])
        self.target_faces = np.ascontiguousarray(faces[self.targets])
        self.name_of = np.append(opaque, -1).astype(np.int32)


class _Worker:
    """Scratch memory of one thread, and its calls of the compiled loops."""

    def __init__(self, scene: _Scene) -> None:
        self.scene = scene
        n = len(scene.vertices)
        of_vertices = np.empty((n, 3)), np.empty((n, 2)), np.empty((n, 2)), np.empty(n, np.bool_)
        self.seen = Seen(*of_vertices, lane_scratch())
        self.image, self.listed = _image(0), _listed(0)
        self.visible, self.drawn = np.zeros((2, len(scene.faces)), np.int32)

    def draw(
        self,
        pose: FloatArray,
        near: float,
        cull: bool,
        patch: Patch,
        drawn: NDArray[np.int32] | None,
    ) -> tuple[Image, int]:
        """Draw the opaque faces; returns the image, and how many samples show a face.

        Adds what shows each face to `visible`, and what it covers to (F,) `drawn`.
        """
        scene, n = self.scene, len(patch.x)
        if len(self.image.is_touched) < n:
            self.image, self.listed = _image(n), _listed(n)
        inverse, face, is_touched = self.image
        image = Image(inverse[:n], face[:n], is_touched[:n])
        image.is_touched[:] = False
        axes = np.ascontiguousarray(pose[:3, :3] @ patch.frame)
        eye = pose[:3, 3] - scene.centre
        kernels.put_in_plane(scene.vertices, eye, axes, self.seen.points)
        kernels.put_on_canvas(float(near), patch, self.seen)
        with_drawn = drawn is not None
        filled = kernels.draw(
            self.seen, scene.faces, float(near), bool(cull), patch, self.listed, image,
            self.visible, self.drawn if drawn is None else drawn, with_drawn,
        )  # fmt: skip
        return image, int(filled)

    def count(
        self,
        pose: FloatArray,
        near: float,
        cull: bool,
        patch: Patch,
        visible: NDArray[np.integer],
        drawn: NDArray[np.integer] | None,
    ) -> int:
        """Add the samples of a patch to rows (F,) of counts; returns how many show a face."""
        scene = self.scene
        corners = (scene.box - pose[:3, 3]) @ (pose[:3, :3] @ patch.frame)
        if not kernels.sees(patch, float(near), corners):
            return 0
        self.visible[:], self.drawn[:] = 0, 0
        image, filled = self.draw(pose, near, cull, patch, None if drawn is None else self.drawn)
        visible[scene.opaque] += self.visible
        if drawn is not None:
            drawn[scene.opaque] += self.drawn
        if len(scene.targets):
            seen, covered = np.zeros((2, len(scene.targets)), np.int64)
            kernels.count_targets(
                self.seen,
                scene.target_faces,
                float(near),
                patch,
                self.listed,
                image,
                seen,
                covered,
            )
            visible[scene.targets] += seen
            if drawn is not None:
                drawn[scene.targets] += covered
        return filled


def _image(n: int) -> Image:
    """Memory for n tiles."""
    inverse, face = (aligned_zeros((n, SAMPLES), kind) for kind in (np.float32, np.int32))
    return Image(inverse, face, np.empty(n, np.bool_))


def _listed(n: int) -> Listed:
    """Memory for lists of tiles of an image of n."""
    faces, ends = np.empty((2, FACES_AT_A_TIME), np.int64)
    heights, sides = np.empty((2, FACES_AT_A_TIME))
    tiles = np.empty(n + TILES_AT_A_TIME + LANES, np.int32)
    is_drawn = np.empty(FACES_AT_A_TIME, np.bool_)
    return Listed(tiles, faces, ends, heights, sides, is_drawn, bit_table())
