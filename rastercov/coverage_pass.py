"""Pass over poses and faces: what an observer measured becomes figures, in threads.

`coverage` keeps the figures, `network` adds them up; `coverage_kernels` computes them.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov._threads import share_poses, thread_count
from rastercov.near_plane import near_limit
from rastercov.observation import Observation
from rastercov.observer import Observer
from rastercov.pose import Poses
from rastercov.raster.contract import FaceCounts
from rastercov.task import Task

Measured = Observation | FaceCounts
"""What is known of some poses: areas, or the counts of a rasteriser, which become areas face by
face: arrays of them would take as long as half the judging."""


class CoveragePass:
    """Figures of the poses of one observer by one task; any number of threads may use it."""

    def __init__(self, observer: Observer, task: Task) -> None:
        from rastercov import coverage_kernels, criteria_kernels  # load numba

        self.mesh, self.camera = observer.mesh, observer.camera
        self.kernels, self._geometry = coverage_kernels, criteria_kernels
        self._scene = criteria_kernels.scene_of(observer.mesh)
        self._lens = criteria_kernels.lens_of(observer.camera)
        self._limits = task.limits(observer.camera)
        threads = getattr(observer, "threads", None)
        self._threads = threads if isinstance(threads, int) else thread_count(None)

    def fill(self, seen: Measured, poses: Poses, figures: Mapping[str, NDArray[Any]]) -> None:
        """Fill (P, F) arrays with the figures of the poses of an observation."""
        from rastercov._jit import announce_compilation

        announce_compilation(self.kernels.judge_poses)
        out = self.kernels.record(figures)

        def worker(judged: tuple[Any, ...]) -> Callable[[slice], None]:
            return lambda turn: self.kernels.judge_poses((turn.start, turn.stop), *judged, out)

        self.share(seen, poses, worker)

    def share(
        self,
        seen: Measured,
        poses: Poses,
        make_worker: Callable[[tuple[Any, ...]], Callable[[slice], None]],
    ) -> None:
        """Share the poses of an observation among workers, one for each thread of the observer.

        Each is made from the arguments scene, lens, seen, limits and work of the loops.
        """
        shared = self._scene, self._lens, self._seen(seen, poses), self._limits
        workers = [
            make_worker((*shared, self._geometry.workspace(self.mesh.n_vertices)))
            for _ in range(max(1, min(self._threads, len(poses))))
        ]
        share_poses(len(poses), workers)

    def _seen(self, measured: Measured, poses: Poses) -> Any:
        """What an observer measured, for the loops."""
        read_only, matrices = self._geometry.read_only, poses.world_from_camera
        visible: NDArray[Any]
        drawn: NDArray[Any]
        kind: NDArray[Any]
        kind = error = np.empty((0, 0))
        if isinstance(measured, FaceCounts):
            assert measured.drawn is not None
            visible, drawn = measured.visible, measured.drawn
            # Larger counts than int32 are rare, and not worth loops of their own.
            dtype: type = np.int32 if visible.dtype == np.int32 else np.float64
            scale = samples = float(measured.supersample**2)
        else:
            visible, drawn, dtype = measured.visible_pixels, measured.drawn_pixels, np.float64
            scale, samples, kind = 1.0, float(measured.samples_per_pixel), measured.kind
            if any(measured.area_error.strides):
                error = measured.area_error
        return self.kernels.Seen(
            read_only(matrices, np.float64),
            read_only(near_limit(self.camera, self.mesh.bounds, matrices), np.float64),
            read_only(visible, dtype),
            read_only(drawn, dtype),
            scale,
            read_only(kind, np.uint8),
            read_only(error, np.float64),
            samples,
        )
