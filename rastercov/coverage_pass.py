"""Pass over poses and faces that judges them: what an observer measured becomes coverage.

`coverage` keeps the figures, `network` adds them up; `coverage_kernels` computes them.
"""

from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import NDArray

from rastercov._threads import thread_count
from rastercov.face_pass import FacePass, Measured
from rastercov.observer import Observer
from rastercov.pose import Poses
from rastercov.task import Task


class CoveragePass(FacePass):
    """Figures of the poses of one observer by one task; any number of threads may use it."""

    def __init__(self, observer: Observer, task: Task) -> None:
        threads = getattr(observer, "threads", None)
        if not isinstance(threads, int):
            threads = thread_count(None)
        super().__init__(observer.mesh, observer.camera, threads)
        self.limits = task.limits(observer.camera)

    def fill(self, measured: Measured, poses: Poses, figures: Mapping[str, NDArray[Any]]) -> None:
        """Fill (P, F) arrays with the figures of the poses of a measurement."""
        from rastercov._jit import announce_compilation

        announce_compilation(self.kernels.judge_poses)
        out = self.kernels.record(figures)

        def worker(scope: tuple[Any, ...]) -> Callable[[slice], None]:
            return lambda turn: self.kernels.judge_poses(
                (turn.start, turn.stop), *scope, self.limits, out
            )

        self.share(measured, poses, worker)
