"""CPU rasteriser of cameras with any lens: faces as they are, samples where the lens puts them.

    stage         reads                      writes                    file
    ------------  -------------------------  ------------------------  ------------
    once:         lens, sample grid          Patch for each plane      lens_samples
    for each band of rows, pose and plane:
    1 cull        Clusters.bounds, pose      clusters, about by depth  lens_setup
    for each cluster, from front to back:
    2 project     Clusters.points, pose      Vertices: plane, canvas   lens_setup
    3 set up      a vector of faces          Setup: planes, tiles      lens_setup
    4 list        Setup, Patch.boxes         Listed: tiles             lens_listing
    5 cover       tiles, Patch               Image: 1/z, face; counts  lens_cover

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

from rastercov.base.arguments import flag
from rastercov.base.errors import ConfigError, DeviceError
from rastercov.base.threads import Closing, ScratchPool, share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import limits, picture_limits
from rastercov.camera.pose import Poses as AcceptedPoses
from rastercov.camera.pose import valid_poses
from rastercov.kernels import raster_lens as kernels
from rastercov.kernels.raster_lens_records import SAMPLES, Image, Patch, make_workspace
from rastercov.kernels.raster_memory import LANES, aligned_zeros
from rastercov.mesh import Mesh
from rastercov.raster import self_test
from rastercov.raster.contract import (
    FaceCounts,
    RasterizerInfo,
    VisibilityBuffer,
    check_counts,
    check_picture,
)
from rastercov.raster.cpu.clusters import Clusters, group_faces
from rastercov.raster.cpu.lens_samples import SampleTables, tables_of
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
                image = worker.draw(matrix[0], near[0], cull[0], patch)[0]
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
                    counts = visible[turn], None if drawn is None else drawn[turn]
                    for patch in patches:
                        worker.count(
                            poses[turn], near[turn], cull[turn], patch, *counts, filled[turn]
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
        vertices = np.ascontiguousarray(mesh.vertices - self.centre)
        ends = vertices.min(axis=0), vertices.max(axis=0)
        self.box: FloatArray = np.stack(np.meshgrid(*np.transpose(ends)), axis=-1).reshape(8, 3)
        opaque: IntArray = np.flatnonzero(~mesh.target_mask)
        # Adding to a slice takes a fifth of the time.
        self.opaque: Any = opaque if mesh.has_targets else slice(None)
        self.targets: IntArray = np.flatnonzero(mesh.target_mask)
        self.n_opaque = len(opaque)
        faces = in_one_order(mesh).astype(np.int32)
        if mesh.has_targets and mesh.opaque.can_cull_back_faces:
            faces = mesh.faces.astype(np.int32)  # winding decides which faces are left out
        is_wound = mesh.opaque.can_cull_back_faces
        self.clusters = group_faces(vertices, np.ascontiguousarray(faces[opaque]), is_wound)
        self.target_clusters: Clusters | None = None
        if mesh.has_targets:
            faces = np.ascontiguousarray(faces[self.targets])
            self.target_clusters = group_faces(vertices, faces, is_wound)
        self.name_of = np.append(opaque, -1).astype(np.int32)


class _Worker:
    """Scratch memory of one thread, and its calls of the compiled loops."""

    def __init__(self, scene: _Scene) -> None:
        self.scene = scene
        self.image = _image(0, 0)
        self.n_clusters = max(
            each.stride for each in (scene.clusters, scene.target_clusters) if each is not None
        )
        self.work = make_workspace(self.n_clusters, 0)
        self.unused = np.zeros((1, scene.n_opaque), np.int32)

    def draw(
        self, pose: FloatArray, near: float, cull: bool, patch: Patch, drawn: bool = False
    ) -> tuple[Image, int, NDArray[np.int32], NDArray[np.int32]]:
        """Draw the opaque faces of a pose.

        Returns the image, how many samples show a face, and the samples that show each, (F,), and
        that it covers.
        """
        image = self._image(patch)
        eye, axes = self._place(pose[None], patch)
        visible, covered = np.zeros((2, self.scene.n_opaque), np.int32)
        filled = kernels.draw(
            self.scene.clusters, eye[0], axes[0], float(near), bool(cull), patch, self.work, image,
            visible, covered, drawn,
        )  # fmt: skip
        return image, int(filled), visible, covered

    def count(
        self,
        poses: FloatArray,
        near: FloatArray,
        cull: NDArray[np.bool_],
        patch: Patch,
        visible: NDArray[Any],
        drawn: NDArray[Any] | None,
        filled: IntArray,
    ) -> None:
        """Add the samples of a patch in poses to (P, F) counts, and to (P,) those with a face."""
        scene, is_all = self.scene, not len(self.scene.targets)
        with_drawn, image = drawn is not None, self._image(patch)
        if is_all and visible.dtype == np.int32:
            kernels.count_poses(
                scene.clusters, scene.box, *self._place(poses, patch), near, cull, patch, self.work,
                image, visible, self.unused if drawn is None else drawn, with_drawn,
                filled,
            )  # fmt: skip
            return
        for row, pose in enumerate(poses):
            image, n, seen, covered = self.draw(pose, near[row], cull[row], patch, with_drawn)
            filled[row] += n
            visible[row, scene.opaque] += seen
            if drawn is not None:
                drawn[row, scene.opaque] += covered
            if not is_all:
                self._count_targets(pose, near[row], patch, image, visible[row],
                                    None if drawn is None else drawn[row])  # fmt: skip

    def _count_targets(
        self,
        pose: FloatArray,
        near: float,
        patch: Patch,
        image: Image,
        visible: NDArray[Any],
        drawn: NDArray[Any] | None,
    ) -> None:
        """Add the samples of targets to rows (F,) of counts."""
        scene = self.scene
        seen, covered = np.zeros((2, len(scene.targets)), np.int64)
        eye, axes = self._place(pose[None], patch)
        kernels.count_targets(
            scene.target_clusters, eye[0], axes[0], float(near), patch, self.work, image, seen,
            covered,
        )  # fmt: skip
        visible[scene.targets] += seen
        if drawn is not None:
            drawn[scene.targets] += covered

    def _image(self, patch: Patch) -> Image:
        """Memory for the tiles of a patch."""
        n, columns = len(patch.x), patch.columns
        if len(self.image.inverse) < n or len(self.image.bound) < _bounds(n, columns):
            self.image, self.work = _image(n, columns), make_workspace(self.n_clusters, n)
        inverse, face, bound = self.image
        return Image(inverse[:n], face[:n], bound[:n])

    def _place(self, poses: FloatArray, patch: Patch) -> tuple[FloatArray, FloatArray]:
        """The eyes (P, 3) from the centre of the mesh, and world_from_plane (P, 3, 3)."""
        axes = np.ascontiguousarray(poses[:, :3, :3] @ patch.frame)
        return poses[:, :3, 3] - self.scene.centre, axes


def _image(n: int, columns: int) -> Image:
    """Memory for n tiles in rows of some columns."""
    inverse, face = (aligned_zeros((n, SAMPLES), kind) for kind in (np.float32, np.int32))
    return Image(inverse, face, aligned_zeros(_bounds(n, columns), np.float32))


def _bounds(n: int, columns: int) -> int:
    """Length of `Image.bound`, of which whole vectors of four rows are read."""
    return n + 3 * columns + LANES
