"""The jobs of the commands `place`, `check` and `audit` as functions, which return their results.

Nothing is written unless `out` names a folder, which then gets the files of the command. They load
their modules when they are called.
"""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, cast

from numpy.typing import ArrayLike

from rastercov.base import ConfigError, PoseError, ReadByName, StrPath, check_kind
from rastercov.core.camera import Cameras, Poses, Rig, Views, cameras_of, names_of
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.shards import Progress, Staff, Workers, silent

if TYPE_CHECKING:
    from rastercov.placement.plan.check import Checked
    from rastercov.placement.plan.file import Plan
    from rastercov.placement.plan.run import Placement
    from rastercov.placement.reconstruction import Reconstruction


def place(
    plan: "StrPath | ReadByName | Plan",
    *,
    camera: Cameras | None = None,
    out: StrPath | None = None,
    workers: Workers | None = None,
) -> "Placement":
    """Place cameras from a plan, like the command `place`.

    Parameters
    ----------
    plan : path, mapping or Plan
        A plan file, its entries as a mapping with files relative to the working directory, or what
        `rastercov.placement.plan.file.read_plan` gives.
    camera : Camera, Rig or sequence of Camera, optional
        Instead of the cameras of the plan. Costs are still those of the plan, by camera name.
    out : path, optional
        Folder for the files of the command; without it nothing is written, and the visibility
        matrix is held in memory.
    workers : Workers, optional
        Worker processes, which need `out`; this process unless given.

    Returns
    -------
    Placement
        `cameras.placed` are the poses with the camera of each, `cameras.share` the share of the
        surface that they cover, `selection` the choice with its bound, `requirements` the required
        shares, and `is_met` is true if all of them hold.

    Raises
    ------
    PlanError
        For an invalid plan, or a file in it that cannot be used; a `ConfigError` whose `lines` has
        an entry for each fault.
    ConfigError
        If the constraints leave no candidate, and for workers without `out`. A goal that the
        candidates cannot reach raises nothing: then `is_met` is false.

    Examples
    --------
    >>> import rastercov as rc
    >>> plan = {
    ...     "meshes": [{"built_in": "teapot-5"}],
    ...     "camera": {"preset": "khepra"},  # a camera of the catalogue
    ...     "selection": {"goal": "best_coverage", "cameras": 2},
    ...     "candidates": [{"generator": "on_sphere", "count": 4}],
    ... }
    >>> placed = rc.place(plan)
    >>> len(placed.cameras.placed), placed.is_met
    (2, True)
    """
    from rastercov.placement.plan.run import place as run

    asked = _plan(plan, camera)
    folder = _folder(out, workers)
    if folder is None:
        return run(asked, None)
    from rastercov.report.plan import run_into

    return run_into(asked, folder, workers=workers)


def check(
    plan: "StrPath | ReadByName | Plan",
    poses: StrPath | ArrayLike | Poses | Views,
    *,
    camera: Cameras | None = None,
    min_coverage: float | None = None,
    groups: Mapping[str, float] | None = None,
    views: int | None = None,
    baseline: StrPath | None = None,
    allow_worse: str | float | None = None,
    tolerance: str | None = None,
    out: StrPath | None = None,
) -> "Checked":
    """Check camera poses against a plan, like the command `check`.

    Parameters
    ----------
    plan : path, mapping or Plan
        As for `place`; its candidates and constraints are not used.
    poses : path, (P, 4, 4) array_like, Poses or Views
        The cameras to check: a file of poses or views, or world_from_camera. `Poses.camera` is the
        index of a camera of the plan; views name theirs.
    camera : Camera, Rig or sequence of Camera, optional
        Instead of the cameras of the plan.
    min_coverage : float, optional
        Share of the surface to cover, [0, 1], instead of the plan's.
    groups : mapping of str to float, optional
        Share to cover of each of these groups, [0, 1], instead of the plan's.
    views : int, optional
        Number of cameras required per face or point, instead of the plan's.
    baseline : path, optional
        `check.json` of an earlier check; the result must not be worse.
    allow_worse : float or str, optional
        Accepted loss against the baseline: percentage points, or an area such as "2 cm2".
    tolerance : str, optional
        Installation errors under which the requirements must hold, such as "2 mm, 0.2 deg"; see
        docs/check.md.
    out : path, optional
        Folder for the files of the command; without it nothing is written.

    Returns
    -------
    Checked
        `is_met` is true if all requirements hold and nothing is worse than in the baseline;
        `requirements` have the share reached and its bounds, `against` the differences from the
        baseline, `lines()` the result as text, and `summary()` all figures.

    Raises
    ------
    PlanError
        As for `place`, and for a plan that does not fit its meshes.
    PoseError, CameraError
        For an unreadable file, an invalid pose, or a pose of an unknown camera.
    ConfigError
        For no requirement, a share outside [0, 1], an unknown group, and an invalid baseline file.

    Examples
    --------
    >>> import rastercov as rc
    >>> plan = {
    ...     "meshes": [{"built_in": "teapot-5"}],
    ...     "camera": {"preset": "khepra"},  # a camera of the catalogue
    ...     "selection": {"goal": "fewest_cameras", "coverage": 0.5},
    ...     "candidates": [{"generator": "on_sphere", "count": 4}],
    ... }
    >>> check_result = rc.check(plan, rc.sphere_of_poses((0, 0, 0.05), distance=0.6, count=6))
    >>> check_result.is_met, [requirement.status for requirement in check_result.requirements]
    (True, ['holds'])
    """
    from rastercov.formats.cameras import read_views
    from rastercov.placement.plan import check as plan_check
    from rastercov.placement.plan.baseline import read_baseline
    from rastercov.placement.plan.phases import demand_of

    asked = _plan(plan, camera)
    Task(views=1 if views is None else views)  # refuses what is no number of views
    limits = plan_check.limits(asked, min_coverage, groups or {}, may_be_none=baseline is not None)
    before = read_baseline(baseline, allow_worse)
    file, given = Path("poses"), cast("Any", poses)
    if isinstance(poses, str | os.PathLike):
        file, given = Path(poses), read_views(poses)
    demand = demand_of("tolerance", tolerance)
    made = partial(
        plan_check.check, asked, file, limits, views, poses=given, baseline=before, demand=demand
    )
    if out is None:
        return made()
    from rastercov.report.check import write  # with the first page only

    return write(made, Path(out))


def audit(
    mesh: Mesh,
    camera: Cameras | Views,
    poses: ArrayLike | Poses | None = None,
    task: Task | None = None,
    *,
    names: Sequence[str] | None = None,
    by: str | None = None,
    resolution_of_result: float | None = None,
    method: str | Engine = "certified",
    skip_bad_poses: bool = False,
    suggest: int | None = None,
    out: StrPath | None = None,
    workers: Workers | None = None,
    progress: Progress = silent,
) -> "Reconstruction":
    """Coverage of a surface by existing cameras, and what each of them adds.

    Parameters
    ----------
    mesh : Mesh
        The surface.
    camera : Camera, Rig, sequence of Camera, or Views
        The cameras; if there are several, `Poses.camera` has the index of the camera of each pose.
        Views also have the poses, image names and frames; their lengths must be in the unit of the
        mesh: metres, unless the unit of both is unknown.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera; left out with views.
    task : Task, optional
        Thresholds; `Task()` unless given.
    names : sequence of str, optional
        Name of each pose, such as that of its image; "0", "1", ... unless given.
    by : {"area", "face"}, optional
        Basis of the result, as for `evaluate`.
    resolution_of_result : float, optional
        Longest side of a surface patch of a result by area, metres; chosen for the scene unless
        given.
    method : {"certified", "exact", "sampled"}, or Engine
        As for `open_observer`.
    skip_bad_poses : bool
        Leave out poses that are not rigid transforms instead of raising.
    suggest : int, optional
        Number of images to take next, 1 or more; none unless given.
    out : path, optional
        Folder for the files of the command; without it nothing is written.
    workers : Workers, optional
        Worker processes, which need `out`; this process unless given.
    progress : callable, optional
        Called with the number of poses or candidates done and their total.

    Returns
    -------
    Reconstruction
        `summary()` is the content of `audit.json`, and `suggested` has the images to
        take next, their poses, and the area covered after each of them.

    Raises
    ------
    ConfigError
        For a number of names other than that of the poses, `suggest` below 1, and workers without
        `out`.
    PoseError
        For a pose that is not a rigid transform, and if none are given.
    CameraError
        For views without cameras.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=0.6, count=12)
    >>> audit = rc.audit(mesh, camera, poses, resolution_of_result=0.1)
    >>> summary = audit.summary()
    >>> round(summary["covered_percent"], 1), summary["cameras"], summary["subset"]["cameras"]
    (100.0, 12, 2)
    """
    from rastercov.placement.reconstruction import reconstruction

    frames: Sequence[str] = ()
    unit = "m" if not isinstance(camera, Views) or camera.has_unit else "unit"
    if isinstance(camera, Views):
        if poses is not None:
            raise PoseError("expected views or poses, got both; leave out poses, or give cameras")
        camera.cameras()
        assert camera.rig is not None
        names = camera.images or None if names is None else names
        frames, poses, camera = camera.frames, camera.poses, camera.rig
    if poses is None:
        raise PoseError("expected poses, got none; give them, or views in place of the cameras")
    made = partial(
        reconstruction,
        mesh,
        camera,
        Poses.of(poses, skip_bad=skip_bad_poses),
        task,
        names=names,
        frames=frames,
        by=by,
        method=method,
        resolution_of_result=resolution_of_result,
        staff=Staff(workers, progress),
        unit=unit,
        suggested=suggest,
    )
    folder = _folder(out, workers)
    if folder is None:
        return made()
    from rastercov.report.audit import write

    options = {"by": by, "resolution_of_result": resolution_of_result, "method": str(method)}
    return write(made, folder, options, is_kept=workers is not None)[0]


def _folder(out: StrPath | None, workers: Workers | None) -> Path | None:
    """Folder for the files of a command, if one is given."""
    check_kind("out", out, (str, os.PathLike, NoneType), "the path of a folder", ConfigError)
    if workers is not None and out is None:
        raise ConfigError("expected a folder for workers, got none; give out, or no workers")
    return None if out is None else Path(out)


def _plan(plan: "StrPath | ReadByName | Plan", camera: Cameras | None) -> "Plan":
    """The plan that is meant, with other cameras where these are given."""
    from rastercov.placement.plan.file import Plan, plan_of, read_plan

    if isinstance(plan, Mapping):
        plan = plan_of(plan)
    elif isinstance(plan, str | os.PathLike):
        plan = read_plan(plan)
    check_kind("plan", plan, Plan, "a plan file, a mapping or a Plan", ConfigError)
    if camera is None:
        return plan
    cameras = cameras_of(camera)
    if isinstance(camera, Rig):
        return plan.with_cameras(camera)
    names = plan.camera_names if len(plan.camera_names) == len(cameras) else names_of(camera)
    return plan.with_cameras(Rig(cameras, names))
