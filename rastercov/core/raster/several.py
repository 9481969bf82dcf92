"""Rasterisers of several cameras, counted as one."""

import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rastercov.base import ByName
from rastercov.core.camera import Camera, Poses
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.bits import Criteria, Judged, add_bits, no_bits
from rastercov.core.raster.contract import FaceCounts, Rasterizer

MOST_OPEN = 16
"""Rasterisers that are open at a time."""


class Rasterizers:
    """A rasteriser for each of some cameras, opened when a pose has it.

    Parameters
    ----------
    mesh : Mesh
        The faces.
    cameras : sequence of Camera
        At least one; the first is opened at once.
    **options
        As for `open_rasterizer`.

    Attributes
    ----------
    info : RasterizerInfo
        Of the first.
    """

    def __init__(self, mesh: Mesh, cameras: Sequence[Camera], **options: Any) -> None:
        def open_one(index: int) -> Rasterizer:
            return open_rasterizer(mesh, cameras[index], **options)

        first = open_one(0)
        self.info, self._opened, self._open = first.info, open_one, {0: first}
        self._mesh = mesh
        self._lock = threading.Lock()

    def count(self, poses: Poses) -> FaceCounts:
        """Samples of each face in each pose, through the camera of the pose."""
        parts = list(poses.by_camera())
        if len(parts) <= 1:
            return self._of(parts[0][0] if parts else 0).count(poses)
        counts = [self._of(index).count(poses[rows]) for index, rows in parts]
        order = np.argsort(np.concatenate([rows for _, rows in parts]))
        names = "visible", "drawn", "background", "clipped"
        joined: ByName = {
            name: np.concatenate([getattr(each, name) for each in counts])[order] for name in names
        }
        return replace(counts[0], **joined)

    def why_not_judged(self, poses: Poses, criteria: Sequence[Criteria]) -> str:
        """Reason why `judge` has to be left to the host, by the criteria of each camera; or ""."""
        used = [index for index, _ in poses.by_camera()]
        whys = (self._of(index)._why_not_judged(criteria[index]) for index in used)
        return next(filter(None, whys), "")

    def judge(self, poses: Poses, criteria: Sequence[Criteria]) -> Judged:
        """Faces that each pose covers, by the criteria of its camera; see `Rasterizer.judge`."""
        whole, clipped = no_bits(self._mesh, len(poses)), np.zeros(len(poses), np.bool_)
        for index, rows in poses.by_camera():
            matrices = poses.world_from_camera[rows]
            bits, clipped[rows] = self._of(index)._judge(matrices, criteria[index])
            add_bits(whole, bits, rows)
        return whole, clipped

    def _of(self, index: int) -> Rasterizer:
        """Rasteriser of a camera; the one that was used least lately is closed for it."""
        with self._lock:
            one = self._open.pop(index, None)
            if one is None:
                if len(self._open) >= MOST_OPEN:
                    self._open.pop(next(iter(self._open))).close()
                one = self._opened(index)
            self._open[index] = one  # the latest is the last
            return one

    def close(self) -> None:
        """Close all of them."""
        for rasterizer in self._open.values():
            rasterizer.close()
