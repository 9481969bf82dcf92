"""Where the samples of a count stand: a square grid over the image, rolled about its centre.

Counts over a grid miss an area by much more where an edge runs along the rows of the grid than
where it crosses them at an odd angle, and the edges of manufactured parts run along the rows of the
image. So the grid can be rolled against the image. With c, s the cosine and sine of the roll and
W x H the image, a point (u, v) in pixels stands at

    x = S ( c (u - W/2) + s (v - H/2)) + width/2,
    y = S (-s (u - W/2) + c (v - H/2)) + height/2

of a canvas of width x height samples that holds the rolled image, and samples stand at the middles
of the canvas's unit squares. A row of samples meets the image in one run, because the image is
convex; samples beyond the runs are drawn like the others and not counted, so no face has to be cut
at the border of the image.

Rolling costs the rasterisers nothing else: x = fx' X/Z + cx' and y = fy' Y/Z + cy' hold for camera
axes X and Y that are mixed beforehand.
"""

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Box = tuple[int, int, int, int]
"""Part of a canvas: left, top, width, height, in samples."""


class SampleGrid:
    """S^2 samples a pixel in rows that are turned by an angle against those of the image.

    Parameters
    ----------
    camera : Camera
        Image size and intrinsics.
    supersample : int
        S.
    roll : float
        Radians from the image's u axis to the rows of samples, towards its v axis. A square grid
        repeats every quarter turn, so only the rest of that counts.

    Attributes
    ----------
    width, height : int
        Size of the canvas in samples; without a roll, S times that of the image.
    lens : (4,) float64
        fx, fy, cx, cy of the canvas in samples, for the axes of `axes`.
    """

    def __init__(self, camera: Camera, supersample: int = 1, roll: float = 0.0) -> None:
        self.supersample = scale = int(supersample)
        angle = math.remainder(roll, math.pi / 2)
        self._c, self._s = c, s = math.cos(angle), math.sin(angle)
        self._ratio = camera.fy / camera.fx
        self.is_rolled = angle != 0
        half = scale * camera.width / 2, scale * camera.height / 2
        # A hair less, so that rounding adds no row to an image that fills its canvas.
        self.width = math.ceil(2 * (c * half[0] + abs(s) * half[1]) - 1e-9)
        self.height = math.ceil(2 * (abs(s) * half[0] + c * half[1]) - 1e-9)
        self._middle = self.width / 2, self.height / 2
        self._half = half
        self.lens: FloatArray = np.array(
            (
                scale * camera.fx,
                scale * camera.fy,
                scale * (c * camera.cx + s * camera.cy) + self._from_corner[0],
                scale * (c * camera.cy - s * camera.cx) + self._from_corner[1],
            )
        )

    @property
    def _from_corner(self) -> tuple[float, float]:
        """Where the corner (0, 0) of the image stands on the canvas."""
        c, s, (a, b) = self._c, self._s, self._half
        return self._middle[0] - (c * a + s * b), self._middle[1] - (c * b - s * a)

    @property
    def mix(self) -> FloatArray:
        """How `axes` mixes the first two camera axes, (2, 2)."""
        c, s = self._c, self._s
        return np.array(((c, s * self._ratio), (-s / self._ratio, c)))

    @property
    def first(self) -> NDArray[np.int32]:
        """The first sample of each row inside the image, (height,)."""
        return self._runs[0]

    @property
    def last(self) -> NDArray[np.int32]:
        """The sample after the last one of each row inside the image, (height,)."""
        return self._runs[1]

    @cached_property
    def n_samples(self) -> int:
        """Samples inside the image; without a roll, S^2 times its pixels."""
        return self.n_inside((0, 0, self.width, self.height))

    @property
    def count_type(self) -> type[np.int32] | type[np.int64]:
        """A type in which all samples can be counted: half the memory where 32 bits are enough."""
        return np.int32 if self.n_samples < 1 << 31 else np.int64

    @cached_property
    def _runs(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        c, s = self._c, self._s
        x = self._middle[0]
        y = np.arange(self.height) + 0.5 - self._middle[1]
        # From the middle, u is (c x - s y) / S and v is (s x + c y) / S: |c x - s y| <= S W/2 here,
        low, high = (s * y - self._half[0]) / c, (s * y + self._half[0]) / c
        if s:  # and |s x + c y| <= S H/2 here
            with np.errstate(over="ignore"):
                one, other = (-c * y - self._half[1]) / s, (-c * y + self._half[1]) / s
            low = np.maximum(low, np.minimum(one, other))
            high = np.minimum(high, np.maximum(one, other))
        first = np.clip(np.ceil(low + x - 0.5), 0, self.width).astype(np.int32)
        last = np.clip(np.floor(high + x - 0.5) + 1, 0, self.width).astype(np.int32)
        return first, np.maximum(first, last)

    def tiles(self, size: tuple[int, int]) -> Iterator[Box]:
        """Parts of the canvas, none larger than `size`."""
        for y in range(0, self.height, size[1]):
            for x in range(0, self.width, size[0]):
                yield x, y, min(size[0], self.width - x), min(size[1], self.height - y)

    def axes(self, poses: FloatArray) -> FloatArray:
        """Poses (P, 4, 4) whose first two axes are mixed so that `lens` gives canvas positions.

        X = c right + s fy/fx down and Y = c down - s fx/fy right, at right angles only where fx is
        fy. What the poses are otherwise used for wants them as they were.
        """
        if not self.is_rolled:
            return poses
        mixed = poses.copy()
        right, down = poses[:, :3, 0], poses[:, :3, 1]
        mixed[:, :3, 0] = self._c * right + self._s * self._ratio * down
        mixed[:, :3, 1] = self._c * down - self._s / self._ratio * right
        return mixed

    def boxes(self, boxes: IntArray) -> IntArray:
        """Parts of the canvas, (P, 4) left, top, right, bottom, that hold these parts of the image.

        Parameters
        ----------
        boxes : (P, 4) int
            left, top, right, bottom in pixels.
        """
        if not self.is_rolled:
            scaled: IntArray = boxes * self.supersample
            return scaled
        u = self.supersample * boxes[:, [0, 2, 0, 2]]
        v = self.supersample * boxes[:, [1, 1, 3, 3]]
        x = self._c * u + self._s * v + self._from_corner[0]
        y = self._c * v - self._s * u + self._from_corner[1]
        found = np.stack((x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)), axis=1)
        found = np.concatenate((np.floor(found[:, :2]) - 1, np.ceil(found[:, 2:]) + 1), axis=1)
        size = (self.width, self.height, self.width, self.height)
        whole: IntArray = np.clip(found, 0, size).astype(np.int64)
        return whole

    def n_inside(self, box: Box) -> int:
        """How many samples of a part of the canvas are inside the image."""
        if not self.is_rolled:
            return box[2] * box[3]
        first, last = self._of(box)
        return int((last - first).sum(dtype=np.int64))

    def inside(self, values: NDArray[np.uint32], box: Box) -> NDArray[np.uint32]:
        """Of the values (height, width) of a part of the canvas, those inside the image, flat."""
        if not self.is_rolled:
            return values.ravel()
        column = np.arange(box[2], dtype=np.int32)
        first, last = self._of(box)
        return values[(column >= first[:, None]) & (column < last[:, None])]

    def _of(self, box: Box) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """First and last inside the image of each row of a part of the canvas, from its left."""
        left, top, width, height = box
        rows = slice(top, top + height)
        return (self.first[rows] - left).clip(0, width), (self.last[rows] - left).clip(0, width)
