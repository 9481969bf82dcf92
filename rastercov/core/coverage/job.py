"""The answer to a `Query`: poses are measured batch by batch and added up, then phases.

It is for `evaluate`, which keeps figures of every pair of pose and face, and for the commands.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ByName, ConfigError, ReadByName, ResourceError, StrPath
from rastercov.base.interrupts import hold_interrupts
from rastercov.base.locks import lock
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.regions import RegionObserver
from rastercov.core.area.rows import with_rule
from rastercov.core.camera import Cameras, Poses, check_scene, is_joint
from rastercov.core.coverage.coverage import Observer, arrays_for, check_fields
from rastercov.core.coverage.evaluation import (
    ByCamera,
    Evaluation,
    KeptCounts,
    Query,
    asked,
    bits_of_a_pair,
    cameras_apart,
)
from rastercov.core.coverage.face_pass import FIGURES
from rastercov.core.coverage.judging import JudgedPoses
from rastercov.core.coverage.network import Network, can_judge, engine_for
from rastercov.core.coverage.shards import (
    EvaluationShards,
    Wanted,
    classify_parts,
    open_for,
    provenance_of,
)
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import COVERED, RasterizerInfo, add_bits, bits_of_first, no_bits
from rastercov.shards import ALONE, Staff, Workers

EVALUATE_BUDGET = 4 << 30
"""Bytes of figures of pairs that `evaluate` may return."""


def evaluate(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    by: str | None = None,
    method: str | Engine = "certified",
    fields: Sequence[str] | None = None,
    shards: StrPath | tuple[StrPath, Workers] | None = None,
    **given: object,
) -> Evaluation:
    """Coverage of each face in each pose and by all poses together, like the command `evaluate`.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera, Rig or sequence of Camera
        The cameras; for several, `Poses.camera` has the index of the camera of each pose.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera. `Poses.of(poses, skip_bad=True)` skips poses that are not rigid
        transforms; see `Coverage.pose_ids`.
    task : Task, optional
        Thresholds; `Task()` unless given.
    by : {"area", "face"}, optional
        Basis of the result: exact area, with the unions and dead zones of docs/area.md, or whole
        faces as in Eissa (2020). Unless given, "face" if a threshold applies to whole faces,
        `min_angle_deg` is set, or the method is "sampled", and "area" otherwise;
        `Evaluation.by_face_because` has the reason.
    method : {"certified", "exact", "sampled"}, or Engine
        As for `open_observer`.
    fields : sequence of str, optional
        Names of the (P, F) arrays of `Coverage` to keep, such as ("coverage", "reason"); all unless
        given, and none for () or with shards. Any other array raises `ConfigError` when it is read.
        "covered" keeps the covered pairs as `Evaluation.bits`, also with shards.
    shards : path, or (path, Workers), optional
        Folder for partial results, from which an interrupted run resumes; with `Workers`, processes
        that compute them: docs/scale.md. Required above 10,000 frames x cameras of a `motion`.
    **given
        Optional inputs: `lamps`, a `Lamps` or its file (docs/light.md); `motion`, a `Motion` or
        `MotionQuery` (docs/motion.md).

    Returns
    -------
    Evaluation
        `covered`, the exact covered area of a result by area; `network`, the coverage of each face
        by all cameras; the arrays of `Coverage` for each pose and face; and `summary()`, all
        figures, ready for JSON.

    Raises
    ------
    ConfigError
        For an unknown field or argument, or a result by area where that is impossible.
    PoseError
        For a pose that is not a rigid transform.
    ResourceError
        When the arrays would exceed 4 GiB; choose fewer `fields`.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))  # metres
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.look_at([(0.6, 0, 0), (0, 0.6, 0), (0, 0, 0.6)], (0, 0, 0))  # eyes, targets
    >>> result = rc.evaluate(mesh, camera, poses, rc.Task(max_incidence_deg=60))
    >>> round(result.covered.share(), 3)  # of the area: three sides of six
    0.5
    >>> result.network.views.tolist()  # cameras that cover each of the 12 faces as a whole
    [0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1]
    >>> rc.Reason(result.reason[0, 0]).name  # of the first face in the first pose
    'BACK_FACING'
    >>> zones = result.summary()["dead_zones"]
    >>> round(sum(zone["area_m2"] for zone in zones), 4), zones[0]["reason"]
    (0.12, 'back_facing')
    """
    check_scene(mesh, camera)
    accepted, engine = Poses.of(poses), Engine.of(method)
    camera, task, phases = asked(mesh, camera, task, given)
    query = Query(mesh, camera, accepted, task, engine, phases, by)
    folder, workers = shards if isinstance(shards, tuple) else (shards, None)
    if folder is not None:
        if fields and [*fields] != [COVERED]:
            raise ConfigError("expected fields or a folder for shards, got both; leave one out")
        fields = fields or ()
    elif phases is not None:
        phases.check_motion(accepted)
    names = check_fields(fields, COVERED)
    each = bits_of_a_pair(names, engine)
    size = each * len(accepted) * mesh.n_faces // 8
    if size > EVALUATE_BUDGET:
        raise ResourceError(
            f"expected fields of {EVALUATE_BUDGET / 2**30:g} GiB at most, got {size / 2**30:.1f} "
            f"GiB for {len(accepted)} poses x {mesh.n_faces} faces; name fewer, or fields=()"
        )
    options = vars(engine) | {"by": by, "threads": None}
    with nullcontext() if folder is None else lock(Path(folder)) as above:
        result = answer(query, fields=names, options=options, folder=above, staff=Staff(workers))
    if result.interrupted:
        raise KeyboardInterrupt
    return result


class QuerySums:
    """Sums over the poses of a query: a batch counts everywhere or nowhere.

    Parameters
    ----------
    query : Query
    observer : Observer
        Open, of `open_for`.
    fields : sequence of str
        Figures to keep of all pairs of pose and face, of `FIGURES`.
    wanted : Wanted
        As asked for; `wanted` of this is what the observer can do of it.
    """

    def __init__(
        self, query: Query, observer: Observer, fields: Sequence[str], wanted: Wanted
    ) -> None:
        mesh, camera, poses, task = query.mesh, query.camera, query.poses, query.task
        self.query, self.done = query, 0
        self.areas = AreaNetwork(mesh, task) if query.by_area else None
        self.per_camera = ByCamera(mesh, task, camera, poses, by_area=query.by_area)
        alone = wanted.alone and can_judge(observer, poses, task)
        self.wanted = replace(wanted, apart=self.per_camera.is_asked, alone=alone)
        self.network = self.wanted.network(mesh, task, self._measure)
        names = [name for name in fields if name != COVERED]
        # Counts are kept in place of figures.
        is_sampled = query.engine.method == "sampled"
        self.counts = KeptCounts(names if is_sampled else [])
        self.figures: ByName = arrays_for([] if is_sampled else names, (len(poses), mesh.n_faces))
        self.bits = no_bits(mesh, len(poses)) if COVERED in fields else None
        self.ids, self.clipped = [poses.ids[:0]], [np.zeros(0, bool)]
        self.eyes = [np.empty((0, 3))]

    def add(self, batch: JudgedPoses) -> None:
        """Take in a batch."""
        camera, poses = self.query.camera, batch.poses
        end = self.done + len(poses)
        if batch.counts is not None:
            self.counts.add(batch.counts)
        self.network.add(batch)
        self.per_camera.add_batch(batch)
        if self.areas is not None and batch.regions is not None:
            self.areas.add(with_rule(batch.regions, camera, poses))
        if self.bits is not None and batch.bits is not None:
            add_bits(self.bits, batch.bits, slice(self.done, end))
        self.ids.append(poses.ids)
        self.clipped.append(batch.clipped)
        self.eyes.append(batch.eyes)
        self.done = end

    def _measure(self) -> Network:
        """Network of the poses that are done, with all figures."""
        return answer(replace(self.query, poses=self.poses)).network

    @property
    def poses(self) -> Poses:
        """The poses that are done."""
        every = self.query.poses
        if self.done == len(every):
            return every
        left = every[np.isin(every.ids, np.concatenate(self.ids))]
        return replace(left, rejected=every.rejected)

    def evaluation(self, info: RasterizerInfo, poses: Poses, of_run: ReadByName) -> Evaluation:
        """Result of the `poses` that are done, measured by `info`, with entries on the run."""
        query = self.query
        figures: ByName = dict.fromkeys(FIGURES)
        figures |= {name: array[: self.done] for name, array in self.figures.items()}
        return Evaluation(
            query.mesh,
            query.camera,
            query.task,
            info,
            poses.ids,
            np.concatenate(self.clipped),
            **figures,
            eyes=np.concatenate(self.eyes),
            poses=poses,
            engine=query.engine,
            network=self.network,
            by_face_because=query.by_face_because,
            per_camera=self.per_camera,
            kept_counts=self.counts,
            kept_bits=None if self.bits is None else bits_of_first(self.bits, self.done),
            **of_run,
        )


def answer(
    query: Query,
    *,
    fields: Sequence[str] = (),
    pairs: str = "none",
    options: ReadByName | None = None,
    open_table: Callable[[ReadByName], Any] | None = None,
    folder: Path | None = None,
    staff: Staff = ALONE,
) -> Evaluation:
    """Measure all poses and add them up; then all phases of the scene.

    An interrupt ends the poses after the current batch; what was finished is the result. Before the
    first is done, and in phases, the interrupt is raised.

    Parameters
    ----------
    query : Query
    fields : sequence of str
        Figures to keep of all pairs of pose and face, of `FIGURES`.
    pairs : {"none", "covered", "seen", "all"}
        Pairs of the table.
    options : mapping, optional
        Options of the run, for its provenance.
    open_table : callable, optional
        Opens a table of the pairs, such as a `CoverageTable`, from their `provenance_of`.
    folder : Path, optional
        Folder for the shards of a run without fields; they stay there.
    staff : Staff
        Processes that measure.
    """
    camera, poses, task = query.camera, query.poses, query.task
    alone = [*fields] == [COVERED] and pairs == "none" and not cameras_apart(camera, poses)
    engine = query.engine
    if alone:
        engine = engine_for(engine, query.mesh, camera, task, len(poses))
    wanted = Wanted(engine, query.by_area, pairs, bits=COVERED in fields, alone=alone)
    interrupted, shards, table = False, None, None
    with open_for(query.mesh, camera, task, wanted) as observer, ExitStack() as opened:
        sums = QuerySums(query, observer, fields, wanted)
        wanted = sums.wanted
        if folder is not None:
            shards = EvaluationShards(folder, observer, poses, task, wanted)
        if open_table is not None:
            header = provenance_of(query.mesh, camera, poses.given, task, options, observer.info)
            table = opened.enter_context(open_table(header))
        began = time.perf_counter()
        try:
            more = {"figures": sums.figures, "counts": bool(sums.counts.names)}
            how = wanted, shards, staff, more
            batches = classify_parts(sums.network, observer, poses, *how)
            for batch in batches:
                with hold_interrupts():
                    if table is not None:
                        table.add(batch.rows, batch.regions)
                    sums.add(batch)
                    # Tables, faces of rigs with a rule, and shards, made apart, need all regions.
                    is_alone = table is None and shards is None and not is_joint(camera)
                    if sums.areas and is_alone and isinstance(observer, RegionObserver):
                        observer.closed = sums.per_camera.closed_by_camera(sums.areas.closed)
        except KeyboardInterrupt:
            if not sums.done:
                raise
            interrupted = True
        if table is not None:
            try:
                with hold_interrupts():
                    opened.close()
            except KeyboardInterrupt:
                interrupted = True
        seconds, info = time.perf_counter() - began, observer.info
    done = sums.poses
    of_run = {
        "areas": query.of_phases(done, folder, staff) or sums.areas,
        "options": options,
        "pairs": pairs,
        "n_rows": 0 if table is None else table.n_rows,
        "quarantined": {} if shards is None else shards.quarantined,
        "seconds": seconds,
        "interrupted": interrupted,
    }
    return sums.evaluation(info, done, of_run)
