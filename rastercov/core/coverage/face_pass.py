"""Passes over poses and faces, in threads: what an observer measured becomes figures of each face.

A network adds them up. The loops are in `engine/coverage`.
"""

from collections.abc import Callable, Mapping
from itertools import groupby
from typing import Any

import numpy as np

from rastercov.base import AnyArray, read_only, share_poses
from rastercov.core.camera import Cameras, Poses, cameras_of, near_limits
from rastercov.core.coverage.records import (
    ObservationRecord,
    figures_of,
    lens_of,
    scene_of,
    workspace,
)
from rastercov.core.coverage.task import Reason, Task, check_equipment, own_reasons, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.core.raster.bits import Criteria
from rastercov.core.raster.contract import FaceCounts
from rastercov.core.raster.observation import Observation
from rastercov.engine.coverage_figures import judge_poses

TASK, NONE = Task(), np.empty((0, 0))
"""Thresholds that leave out no face; and no figures."""
Measured = Observation | FaceCounts
"""Measurement of some poses: areas, or the counts of a rasteriser, which become areas face by face:
arrays of them would take as long as half the judging."""
Scope = tuple[Any, Any, Any, Any]
"""Arguments scene, lens, seen and points of the loops."""
Worker = Callable[[slice, int, Scope], None]
"""Does the work of consecutive poses of one camera, given by its index."""


class FacePass:
    """Figures of faces by a task, through the cameras of an observer; for any number of threads.

    The poses of a call are shared among `threads`.
    """

    def __init__(self, mesh: Mesh, camera: Cameras, threads: int, task: Task = TASK) -> None:
        self.mesh, self.cameras, self._threads = mesh, cameras_of(camera), threads
        check_equipment(camera, task)
        tasks = tasks_of(camera, task)
        self.rules = [own.rules(each) for each, own in zip(self.cameras, tasks, strict=True)]
        scene = scene_of(mesh)
        own = {each: read_only(own_reasons(mesh, each), np.uint8) for each in tasks}
        self._scenes = [scene._replace(own=own[each]) for each in tasks]
        self._lenses = [lens_of(each) for each in self.cameras]

    def fill(self, measured: Measured, poses: Poses, figures: Mapping[str, AnyArray]) -> None:
        """Fill (P, F) arrays with the figures of the poses of a measurement."""
        out = figures_of(figures)

        def work(rows: slice, index: int, scope: Scope) -> None:
            judge_poses(rows.start, rows.stop, scope, self.rules[index], out)

        self.share(measured, poses, lambda: work)

    def criteria(self) -> list[Criteria]:
        """Criteria of each camera for `SampledObserver.judge`."""
        return [
            Criteria(rules._asdict(), scene.own == Reason.COVERED)
            for rules, scene in zip(self.rules, self._scenes, strict=True)
        ]

    def share(self, measured: Measured, poses: Poses, make_worker: Callable[[], Worker]) -> None:
        """Share poses among workers, one made for each thread."""
        seen = self._record_of(measured, poses)

        def worker() -> Callable[[slice], None]:
            work, spaces = make_worker(), dict[type, Any]()

            def work_in_turn(turn: slice) -> None:
                start = turn.start
                for index, run in groupby(poses.camera[turn].tolist()):
                    stop = start + len(list(run))
                    lens = self._lenses[index]
                    if type(lens) not in spaces:
                        spaces[type(lens)] = workspace(self.mesh.n_vertices, lens)
                    scope = self._scenes[index], lens, seen, spaces[type(lens)]
                    work(slice(start, stop), index, scope)
                    start = stop

            return work_in_turn

        share_poses(len(poses), [worker() for _ in range(max(1, min(self._threads, len(poses))))])

    def _record_of(self, measured: Measured, poses: Poses) -> ObservationRecord:
        """Measurement of an observer, for the loops."""
        visible: AnyArray
        drawn: AnyArray
        kind: AnyArray
        kind = error = NONE
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
        near = near_limits(self.cameras, self.mesh.opaque.bounds, poses)
        dense = np.ascontiguousarray
        matrices = dense(poses.world_from_camera, np.float64)
        visible, drawn = dense(visible, dtype), dense(drawn, dtype)
        errors = dense(kind, np.uint8), dense(error, np.float64)
        return ObservationRecord(matrices, near, visible, drawn, scale, *errors, samples)
