"""Pass over poses and faces that judges them: what an observer measured becomes coverage.

`coverage` keeps the figures, `network` adds them up; `kernels.coverage` computes them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.threads import thread_count
from rastercov.camera.pose import Poses
from rastercov.coverage.face_pass import FacePass, Measured, Scope, Worker
from rastercov.coverage.observer import Observer
from rastercov.coverage.task import Task


class CoveragePass(FacePass):
    """Figures of the poses of one observer by one task; any number of threads may use it."""

    def __init__(self, observer: Observer, task: Task) -> None:
        threads = getattr(observer, "threads", None)
        if not isinstance(threads, int):
            threads = thread_count(None)
        super().__init__(observer.mesh, observer.camera, threads)
        self.rules = [task.rules(camera) for camera in self.cameras]

    def fill(self, measured: Measured, poses: Poses, figures: Mapping[str, NDArray[Any]]) -> None:
        """Fill (P, F) arrays with the figures of the poses of a measurement."""
        out = self.kernels.record(figures)
        # Faces before the first at a cache line, in each array of float64 that `evaluate` makes.
        places = (array.ctypes.data for array in figures.values() if array.dtype == np.float64)
        skew = next(places, 0) // 8

        def worker(scope: Scope) -> Worker:
            def work(rows: slice, index: int) -> None:
                rules = self.rules[index]
                self.kernels.judge_poses((rows.start, rows.stop), *scope(index), rules, out, skew)
                if out.incidence.size:
                    self.kernels.replace_by_angles(out.incidence[rows])

            return work

        self.share(measured, poses, worker)
