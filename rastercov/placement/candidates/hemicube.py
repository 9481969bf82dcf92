"""Hemicube over a point of a face: free distance in every direction of the half space.

Serves `cavities`. A rasteriser at the point renders along the normal and to four sides: the upper
half of a cube of images, whose pixel centres are the directions. On a face of the cube
samples are 2 / N apart and no point is farther than sqrt(2) / N from one, so that a cone whose
half angle is

    rho = 2 asin(sqrt(2) / (2 N))

or more, about a direction above the horizon, holds a sample: no opening of that width is missed.

M. F. Cohen, D. P. Greenberg. The Hemi-Cube: A Radiosity Solution for Complex Environments. 1985.
"""

import math

import numpy as np

from rastercov.base.threads import Closing
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import look_at
from rastercov.mesh import Mesh
from rastercov.placement._arrays import FloatArray
from rastercov.raster.cpu import CPURasterizer

LIFT_REL = 1e-6
"""Height of the camera above its face, relative to the mesh's diagonal."""


class Hemicube(Closing):
    """Rasterisers of the five images; use it in a `with` block.

    Attributes
    ----------
    directions : (D, 3) float64
        Unit vectors in the axes of a face, z along its normal; D = 3 N^2.
    solid_angles : (D,) float64
        Solid angle of the pixel of each, steradians; their sum is 2 pi.
    missed : float
        Half angle of a cone that certainly holds a direction, radians.
    """

    def __init__(self, mesh: Mesh, side: int) -> None:
        half = side / 2
        whole = Camera(width=side, height=side, fx=half, fy=half, cx=half, cy=half)
        # The horizon lies between two rows of pixels and halves the image exactly.
        upper = Camera(width=side, height=side // 2, fx=half, fy=half, cx=half, cy=half)
        self.side = side
        self.missed = 2 * math.asin(math.sqrt(2) / (2 * side))
        self._lift = LIFT_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        self._whole, self._upper = (CPURasterizer(mesh, camera) for camera in (whole, upper))
        self._axes = _five_axes()
        step = (np.arange(side) + 0.5 - half) / half
        y, x = np.meshgrid(step, step, indexing="ij")
        rays = np.stack((x, y, np.ones_like(x)), axis=-1)
        length = np.linalg.norm(rays, axis=-1)
        parts = [rays, *4 * [rays[: side // 2]]]
        self.directions = np.concatenate(
            [(part @ axes.T).reshape(-1, 3) for part, axes in zip(parts, self._axes, strict=True)]
        )
        self._stretch = np.concatenate([length.ravel(), *4 * [length[: side // 2].ravel()]])
        self.directions /= self._stretch[:, None]
        self.solid_angles = half**-2 / self._stretch**3
        self.solid_angles *= 2 * math.pi / self.solid_angles.sum()

    def free_distances(self, points: FloatArray, frames: FloatArray) -> FloatArray:
        """(N, D) metres to the first surface in each direction, inf where there is none.

        Parameters
        ----------
        points : (N, 3) float64
            Points on faces.
        frames : (N, 3, 3) float64
            Their axes as columns, the third the normal.
        """
        n = len(points)
        free = np.empty((n, len(self.directions)))
        poses = np.tile(np.eye(4), (n, len(self._axes), 1, 1))
        poses[..., :3, 3] = (points + self._lift * frames[:, :, 2])[:, None]
        poses[..., :3, :3] = frames[:, None] @ np.stack(self._axes)
        whole = self._whole.render_all(poses[:, 0]).depth.reshape(n, -1)
        upper = self._upper.render_all(poses[:, 1:].reshape(-1, 4, 4)).depth.reshape(n, -1)
        free[:, : whole.shape[1]], free[:, whole.shape[1] :] = whole, upper
        free *= self._stretch
        return free

    def blurred(self, values: FloatArray, reach: int) -> FloatArray:
        """(D,) mean over the (2 reach + 1)^2 nearest pixels of the same image."""
        out, start = np.empty_like(values), 0
        for rows in (self.side, *4 * [self.side // 2]):
            part = slice(start, start + rows * self.side)
            image = values[part].reshape(rows, self.side)
            for axis in (0, 1):
                image = _running_mean(image, reach, axis)
            out[part], start = image.ravel(), part.stop
        return out

    def close(self) -> None:
        """Close both rasterisers."""
        self._whole.close()
        self._upper.close()


def face_frames(normals: FloatArray) -> FloatArray:
    """(N, 3, 3) right-handed axes whose third columns are unit normals (N, 3)."""
    return look_at(-normals, np.zeros(3))[:, :3, :3]


def _five_axes() -> list[FloatArray]:
    """Camera axes as columns, in those of a face: along the normal, and to four sides, z up."""
    axes = [np.eye(3)]
    down = np.array([0.0, 0.0, -1.0])
    for x, y in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        ahead = np.array([x, y, 0.0])
        axes.append(np.stack((np.cross(down, ahead), down, ahead), axis=1))
    return axes


def _running_mean(image: FloatArray, reach: int, axis: int) -> FloatArray:
    """Mean over `reach` values before and after each, fewer at the ends."""
    lines = np.moveaxis(image, axis, 0)
    count = len(lines)
    total = np.zeros((count + 1, lines.shape[1]))
    np.cumsum(lines, axis=0, out=total[1:])
    last = np.minimum(np.arange(count) + reach + 1, count)
    first = np.maximum(np.arange(count) - reach, 0)
    mean: FloatArray = (total[last] - total[first]) / (last - first)[:, None]
    return np.moveaxis(mean, 0, axis)
