"""The job of `evaluate`: poses are measured batch by batch and added up, without a file or picture.

`measure` does it for `rastercov.evaluate`, which keeps the figures of every pair of pose and face,
and for the command, which writes chosen pairs to a table while it runs.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.errors import ResourceError
from rastercov.base.interrupts import interrupts_held
from rastercov.camera.lamps import Lamps
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, check_scene, is_joint, with_lamps
from rastercov.cluster import ALONE, Staff
from rastercov.coverage.area.network import AreaNetwork, ByCamera, unit_of_result
from rastercov.coverage.area.sensors import gated
from rastercov.coverage.coverage import (
    FIGURES,
    arrays_for,
    checked_fields,
    measurements,
)
from rastercov.coverage.engine import Engine
from rastercov.coverage.evaluation import Evaluation
from rastercov.coverage.face_pass import FacePass
from rastercov.coverage.network import SUMMED, JudgedPoses, Network, sums_of
from rastercov.coverage.provenance import provenance_of
from rastercov.coverage.shards import (
    EvaluationShards,
    Wanted,
    is_long,
    judged_parts,
    kept_in,
    open_for,
)
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh

BYTES = {name: np.dtype(kind).itemsize for name, kind in FIGURES.items()}
"""Bytes of a figure of a pair of pose and face."""
NONE_ASKED: dict[str, Any] = dict.fromkeys(FIGURES)
EVALUATE_BUDGET = 4 << 30
"""Bytes of figures that `evaluate` may return; longer runs go through `evaluate_batches`."""


def evaluate(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    by: str | None = None,
    lamps: Lamps | None = None,
    method: str | Engine = "certified",
    threads: int | None = None,
    skip_bad_poses: bool = False,
    fields: Sequence[str] | None = None,
) -> Evaluation:
    """Coverage of each face in each pose, and by all of them: what the command `evaluate` finds.

    Parameters
    ----------
    mesh : Mesh
        What is looked at.
    camera : Camera, Rig or sequence of Camera
        What looks; where there are several, `Poses.camera` says which of them is in each pose.
    poses, task : (P, 4, 4) array_like, or Poses; Task, optional
        world_from_camera, and thresholds, `Task()` unless given.
    by : {"area", "face"}, optional
        Unit of the result: exact area, with the unions and dead zones of docs/area.md, or whole
        faces as in the thesis. Area unless given, or face where a threshold is of a face or the
        method counts samples.
    lamps : Lamps, optional
        Lamps that must light what is covered, by area; see docs/light.md.
    method, threads
        As for `open_observer`.
    skip_bad_poses : bool
        Leave out poses that are no rigid motion instead of raising; see `Coverage.pose_ids`.
    fields : sequence of str, optional
        Names of the (P, F) arrays to keep, such as ("coverage", "reason"); all unless given, and
        none for (). Any other array of the result raises `ConfigError` when it is read.

    Raises
    ------
    ConfigError
        For a field that does not exist, and by area where that cannot be.
    PoseError
        For a pose that is no rigid motion.
    ResourceError
        When the arrays would exceed `EVALUATE_BUDGET`; use `evaluate_batches`.
    """
    check_scene(mesh, camera)
    camera = with_lamps(camera, lamps)
    accepted, names = Poses.of(poses, skip_bad=skip_bad_poses), checked_fields(fields)
    task = (Task() if task is None else task).lit_by(lamps)
    engine = Engine.of(method, threads)
    unit, reason = unit_of_result(by, task, engine, camera, len(accepted))
    size = sum(map(BYTES.__getitem__, names)) * len(accepted) * mesh.n_faces
    if size > EVALUATE_BUDGET:
        raise ResourceError(
            f"{len(accepted)} poses x {mesh.n_faces} faces would take {size / 2**30:.1f} GiB; "
            "use evaluate_batches, which holds a few poses at a time"
        )
    wanted = Wanted(engine, unit == "area")
    names_of_engine = "method", "device", "supersample"
    given = {"by": by} | {name: getattr(engine, name) for name in names_of_engine}
    with open_for(mesh, camera, task, wanted) as observer:
        found = measure(
            observer, accepted, task, wanted, fields=names, reason=reason, options=given
        )
    if found.interrupted:
        raise KeyboardInterrupt
    return found


def measure(
    observer: Any,
    poses: Poses,
    task: Task,
    wanted: Wanted,
    *,
    fields: Sequence[str] = (),
    reason: str = "",
    options: Mapping[str, Any] | None = None,
    open_table: Callable[[Mapping[str, Any]], Any] | None = None,
    folder: Path | None = None,
    staff: Staff = ALONE,
) -> Evaluation:
    """Measure all poses and add them up.

    An interrupt ends the run after the current batch; what was finished is the result. A batch
    counts everywhere or nowhere; before the first is done, the interrupt is raised.

    Parameters
    ----------
    observer, poses, task, wanted
        The observer is open, of `open_for` by the same engine; `wanted.apart` is decided here.
    fields : sequence of str
        Figures to keep of all pairs of pose and face, of `FIGURES`.
    reason : str
        Reason of a result by face that was not asked for.
    options : mapping, optional
        Options of the run, for its provenance.
    open_table : callable, optional
        Opens a table of the wanted pairs, such as a `CoverageTable`, from their
        `provenance_of`.
    folder : Path, optional
        Folder for the shards of a long run, and of one by workers, without fields; they stay there.
    staff : Staff
        Processes that measure.
    """
    mesh, camera = observer.mesh, observer.camera
    network, areas = Network(mesh, task), AreaNetwork(mesh, task) if wanted.by_area else None
    apart = ByCamera(mesh, task, camera, poses, by_area=wanted.by_area)
    wanted = replace(wanted, apart=apart.is_asked)
    whole: dict[str, Any] = arrays_for(fields, (len(poses), mesh.n_faces))
    judge = FacePass(mesh, camera, observer.threads, task) if whole else None
    # Otherwise the figures are added up; not the rays to cameras, of which the network keeps rows.
    is_summed = task.min_angle_deg > 0 or not SUMMED.keys() <= set(fields)
    is_summed |= is_joint(camera)
    shards = None
    if folder is not None and (staff.workers or is_long(len(poses), mesh.n_faces)):
        shards = EvaluationShards(kept_in(folder), observer, poses, task, wanted)
    done, interrupted, table = 0, False, None
    ids, clipped = [poses.ids[:0]], [np.zeros(0, np.bool_)]
    with ExitStack() as opened:
        if open_table is not None:
            header = provenance_of(mesh, camera, poses.given, task, options, observer.info)
            table = opened.enter_context(open_table(header))
        began = time.perf_counter()
        if is_summed:
            parts = judged_parts(network, observer, poses, wanted, shards, staff)
        else:
            nothing: Any = ()  # no rows
            parts = (
                JudgedPoses.of(part, seen, nothing, {}, camera)
                for part, seen in measurements(observer, poses)
            )
        try:
            for batch in parts:
                with interrupts_held():
                    if judge is not None and batch.measured is not None:
                        rows = slice(done, done + len(batch.poses))
                        figures = {name: array[rows] for name, array in whole.items()}
                        judge.fill(batch.measured, batch.poses, figures)
                        if not is_summed:
                            cameras, is_apart = batch.poses.camera, apart.is_asked
                            batch.sums.update(sums_of(mesh, figures, cameras, apart=is_apart))
                    if table is not None:
                        table.add(batch.rows, batch.regions)
                    network.add(batch)
                    apart.add_batch(batch)
                    if areas is not None and batch.regions is not None:
                        areas.add(gated(batch.regions, camera, batch.poses))
                        # The table has the area of every pair, also of faces that need no more.
                        # Shards do not depend on one another.
                        if table is None and shards is None:
                            observer.closed = apart.closed(areas.closed)
                    ids.append(batch.poses.ids)
                    clipped.append(batch.clipped)
                    done += len(batch.poses)
        except KeyboardInterrupt:
            if not done:
                raise
            interrupted = True
        if table is not None:
            try:
                with interrupts_held():
                    opened.close()
            except KeyboardInterrupt:
                interrupted = True
        seconds = time.perf_counter() - began
    if done < len(poses):
        left = poses[np.isin(poses.ids, np.concatenate(ids))]
        poses = replace(left, rejected=poses.rejected)
        whole = {name: array[:done] for name, array in whole.items()}
    return Evaluation(
        mesh, camera, task, observer.info, poses.ids, np.concatenate(clipped),
        **(NONE_ASKED | whole), eyes=poses.world_from_camera[:, :3, 3], poses=poses,
        engine=wanted.engine, options=options, network=network, by_face_because=reason, areas=areas,
        apart=apart, pairs=wanted.pairs, n_rows=0 if table is None else table.n_rows,
        is_kept=shards is not None, quarantined={} if shards is None else shards.quarantined,
        seconds=seconds, interrupted=interrupted,
    )  # fmt: skip
