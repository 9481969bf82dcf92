"""The ray tracer that others would use: Open3D's RaycastingScene, which is Embree."""

import importlib.util
import sys
import time

import numpy as np

from rastercov.core.mesh.arrays import inverse


def need_open3d() -> None:
    """Leave with 2 where Open3D is not installed."""
    if importlib.util.find_spec("open3d") is None:
        print("open3d is missing: pip install 'rastercov[bench]'", file=sys.stderr)
        sys.exit(2)


class Tracer:
    """Open3D's RaycastingScene (Embree)."""

    def __init__(self, mesh, camera, poses, threads) -> None:
        import open3d as o3d

        self.threads, self.mesh, self.camera = threads, mesh, camera
        self.camera_from_world = inverse(poses)
        self.scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
        self.scene.add_triangles(
            o3d.core.Tensor(mesh.vertices.astype(np.float32)),
            o3d.core.Tensor(mesh.faces.astype(np.uint32)),
        )

    def _rays(self, row: int):
        size = (self.camera.width, self.camera.height)
        return self.scene.create_rays_pinhole(self.camera.K, self.camera_from_world[row], *size)

    def faces(self, row: int) -> np.ndarray:
        """Face that the ray through each pixel centre meets, -1 for none."""
        ids = self.scene.cast_rays(self._rays(row))["primitive_ids"].numpy()
        return np.where(ids == self.scene.INVALID_ID, -1, ids.astype(np.int64))

    def round(self, rows=None) -> tuple[float, float]:
        """Seconds to make, cast and count these poses, or all, and without the making."""
        making = casting = 0.0
        for row in range(len(self.camera_from_world)) if rows is None else rows:
            started = time.perf_counter()
            rays = self._rays(row)
            made = time.perf_counter()
            ids = self.scene.cast_rays(rays, nthreads=self.threads)["primitive_ids"].numpy().ravel()
            np.bincount(ids[ids != self.scene.INVALID_ID], minlength=self.mesh.n_faces)
            making += made - started
            casting += time.perf_counter() - made
        return making + casting, casting
