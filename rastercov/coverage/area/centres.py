"""Cells whose centre a pose covers: an estimate of the cells that it covers.

It takes a fraction of the time of exact regions, and serves searches over poses, which measure the
best of them exactly.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.memory import Lists
from rastercov.base.threads import share_poses, thread_count
from rastercov.camera.near_plane import near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.area.failures import PointPass
from rastercov.coverage.area.regions import check_pointwise
from rastercov.coverage.task import Reason, Task


class CentrePass:
    """Cells whose centre a pose covers; any number of threads may use it.

    A point is judged as in `rastercov.coverage.area.failures`: coincident surfaces hide nothing.

    Parameters
    ----------
    cells : Cells
        Cells of the scene.
    camera, task
        Camera or cameras, and thresholds of `rastercov.regions`.
    threads : int, optional
        Poses judged in parallel; by default one per core.
    """

    def __init__(
        self, cells: Cells, camera: Cameras, task: Task, threads: int | None = None
    ) -> None:
        check_pointwise(task)
        self._n_cells, self._mesh, cameras = len(cells), cells.mesh, cameras_of(camera)
        centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
        self._judge = PointPass(cells.mesh, cameras, task, centres, cells.source_face)
        self._threads = thread_count(threads)

    def find(self, poses: ArrayLike | Poses) -> Lists:
        """Cells whose centre each of (P, 4, 4) poses covers."""
        placed, cameras = Poses.of(poses), self._judge.cameras
        placed.check_cameras(len(cameras))
        found = [np.empty(0, np.int32)] * len(placed)
        near = near_limits(cameras, self._mesh.opaque.bounds, placed)

        def worker() -> Callable[[slice], None]:
            judge = self._judge.worker(placed, near, is_nearest=False)
            reason, hider = np.empty(self._n_cells, np.uint8), np.empty(self._n_cells, np.int64)

            def work(turn: slice) -> None:
                for row in range(len(placed))[turn]:
                    judge(row, reason, hider)
                    found[row] = np.flatnonzero(reason == Reason.COVERED).astype(np.int32)

            return work

        n_workers = max(1, min(self._threads, len(placed)))
        share_poses(len(placed), [worker() for _ in range(n_workers)])
        return Lists.of(found)
