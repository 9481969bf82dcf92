"""Rasterisers of several cameras, counted as one."""

import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rastercov.base import ByName, IntArray
from rastercov.core.camera import Camera, Poses
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import FaceCounts, Rasterizer
from rastercov.core.raster.judged import Criteria, Judged

MOST_OPEN = 16
"""Rasterisers that are open at a time."""


def _in_order(
    parts: Sequence[tuple[int, slice | IntArray]],
    results: Sequence[FaceCounts | Judged],
    names: str,
) -> ByName:
    """Rows of the results of each camera, in the order of the poses, by the names of the arrays."""
    order = np.argsort(np.concatenate([rows for _, rows in parts]))
    return {
        name: np.concatenate([getattr(each, name) for each in results])[order]
        for name in names.split()
    }


class Rasterizers:
    """A rasteriser for each of some cameras, opened when a pose has it.

    Parameters
    ----------
    mesh : Mesh
        The faces.
    cameras : sequence of Camera
        At least one; the first is opened at once.
    *arguments, **options
        As for `open_rasterizer`.

    Attributes
    ----------
    info : RasterizerInfo
        Of the first.
    """

    def __init__(
        self, mesh: Mesh, cameras: Sequence[Camera], *arguments: Any, **options: Any
    ) -> None:
        def open_one(index: int) -> Rasterizer:
            return open_rasterizer(mesh, cameras[index], *arguments, **options)

        first = open_one(0)
        self.info, self._opened, self._open = first.info, open_one, {0: first}
        self._lock = threading.Lock()

    def count(self, poses: Poses) -> FaceCounts:
        """Samples of each face in each pose, through the camera of the pose."""
        parts = list(poses.by_camera())
        if len(parts) <= 1:
            return self._of(parts[0][0] if parts else 0).count(poses)
        counts = [self._of(index).count(poses[rows]) for index, rows in parts]
        return replace(counts[0], **_in_order(parts, counts, "visible drawn background clipped"))

    def why_not_judged(self, poses: Poses, criteria: Sequence[Criteria]) -> str:
        """Reason why `judge` has to be left to the host, by the criteria of each camera; or ""."""
        used = [index for index, _ in poses.by_camera()]
        whys = (self._of(index)._why_not_judged(criteria[index]) for index in used)
        return next(filter(None, whys), "")

    def judge(self, poses: Poses, criteria: Sequence[Criteria]) -> Judged:
        """Faces that each pose covers, by the criteria of its camera; see `Rasterizer.judge`."""
        parts, matrices = list(poses.by_camera()), poses.world_from_camera
        if len(parts) <= 1:
            index = parts[0][0] if parts else 0
            return self._of(index)._judge(matrices, criteria[index])
        bits = [self._of(index)._judge(matrices[rows], criteria[index]) for index, rows in parts]
        views = np.sum([each.views for each in bits], axis=0)
        return Judged(**_in_order(parts, bits, "words area_units clipped"), views=views)

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
