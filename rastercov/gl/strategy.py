"""Base of the strategies that draw and count for the OpenGL rasteriser.

`rasterizer` owns the contract, the context and the self-test; a strategy owns the programs and the
images: `pipeline` with the graphics pipeline, `compute` with compute shaders.
"""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rastercov.base import IntArray, ResourceError
from rastercov.core.mesh import Mesh
from rastercov.gl.resources import Resources

Counts = IntArray | NDArray[np.uint32]

COUNTER_BYTES = 4


class Strategy:
    """Programs and images on a device, for one mesh and camera: what both plans share.

    `Pipeline` and `Compute` add these methods; `scene` and `prepared` are records of their own.

    - `scene(resources, mesh, camera, grid)` uploads a mesh; the result has the last three.
    - `prepare(scene, poses, grid)` computes what shaders need of poses; the result has `clipped`,
      (P,) bool.
    - `begin(prepared, rows)` uploads the poses of a batch.
    - `count(scene, prepared, rows, tile, drawn=...)` draws a batch into a tile: samples of
      faces, (L, B, F), visible ones and perhaps drawn ones; background (B,).
    - `image(scene, prepared, tile)` draws the first pose into a tile: faces and depths, as in
      `VisibilityBuffer`.

    Attributes
    ----------
    depth : str
        Description of the depth buffer, as in `RasterizerInfo`.
    most_poses : int
        Poses of a batch.
    tile : (width, height)
        Largest part of a canvas that is drawn at once.
    max_tile : int
        Largest side of one image on the device, in samples; larger images are drawn in tiles.
    image_budget : int
        Bytes of face indices and depth in one batch of poses.
    """

    max_tile: ClassVar = 8192
    image_budget: ClassVar = 512 << 20
    most_poses: int = 1
    depth: str
    tile: tuple[int, int]
    scene: Any
    prepare: Any
    begin: Any
    image: Any

    def __init__(self, resources: Resources, mesh: Mesh, face_bytes: int, least_bytes: int) -> None:
        """Take resources whose storage blocks hold `face_bytes` a face, and `least_bytes`."""
        self._resources = resources
        info = resources.context.info
        needed = max(face_bytes * (mesh.n_faces + 1), least_bytes)
        self.block = int(info.limits["max_ssbo_bytes"])
        if needed > self.block:
            raise ResourceError(
                f"expected a storage block of at most {self.block:,} bytes on {info.renderer}, "
                f"got {needed:,} for this mesh; use backend 'cpu'"
            )

    def batches(self, n_poses: int) -> Iterator[slice]:
        """Rows of the poses of each batch."""
        for start in range(0, n_poses, self.most_poses):
            yield slice(start, min(start + self.most_poses, n_poses))
