"""Coverage of a network, measured once, with its bounds, for `place` and `check`.

Visibility has an error bound, and so has coverage: faces are covered as measured, certainly, or
possibly. The bound is that of visibility alone; where pixels are counted (method sampled),
resolution has an error without a bound too.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Rig
from rastercov.coverage.area.by_camera import AreasByCamera, cameras_apart
from rastercov.coverage.area.network import AreaNetwork, in_words
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.area.zone_report import zone_lines
from rastercov.coverage.coverage import Coverage, evaluate_batches
from rastercov.coverage.network import Network, share_of_faces
from rastercov.coverage.observer import Observer, open_observer
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Mesh
from rastercov.placement.explain.candidate_visibility import CandidateBounds
from rastercov.placement.explain.uncovered import (
    NETWORK_FIGURES,
    Leftover,
    NearestCameras,
    left_by,
)
from rastercov.placement.improve.objective import Objective
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.requirements import whole_faces

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class PlanNetwork(Network):
    """A `Network` whose faces may need views that differ by group, or by an angle."""

    def __init__(self, mesh: Mesh, task: Task) -> None:
        super().__init__(mesh, task)
        self.is_covered: BoolArray = np.zeros(mesh.n_faces, np.bool_)

    @property
    def covered(self) -> BoolArray:
        """(F,) faces that are covered as the plan counts it."""
        return self.is_covered


def observer_of(plan: Plan, mesh: Mesh) -> Observer:
    """Observer of a mesh by the camera and the method of a plan; to be closed."""
    own = plan.task
    return open_observer(mesh, plan.rig, own.method, supersample=own.supersample)


@dataclass(frozen=True, eq=False)
class Measured:
    """A network of K cameras and the faces it covers.

    Attributes
    ----------
    mounted : Poses
        Poses of M cameras or rigs as they were chosen.
    placed : Poses
        Poses of their K cameras, with the camera of each.
    owner : (K,) int64
        Row in `mounted` of each of them.
    network : PlanNetwork
    nearest : (F,) int64
        Camera that comes nearest to covering each face, as for `Leftover.nearest_camera`.
    covers : (K, F) bool
        Faces that each camera covers, as measured.
    covered, certain, possible : (F,) bool
        Faces that the network covers as measured, certainly, and possibly.
    curve : (K,) float64
        Share covered by the first 1, 2, ..., K cameras; with `areas`, of the exact area.
    share : float
        Share covered by all cameras; with `areas`, of the exact area.
    areas : AreaNetwork or None
        Exact covered area; None where the plan counts faces.
    apart : AreasByCamera or None
        That of each camera, where there are several.
    """

    mounted: Poses
    placed: Poses
    owner: NDArray[np.int64]
    network: PlanNetwork
    nearest: NDArray[np.int64]
    covers: BoolArray
    covered: BoolArray
    certain: BoolArray
    possible: BoolArray
    curve: FloatArray
    share: float
    areas: AreaNetwork | None = None
    apart: AreasByCamera | None = None

    @property
    def poses(self) -> FloatArray:
        """(K, 4, 4) world_from_camera."""
        return self.placed.world_from_camera


def areas_of(
    plan: Plan,
    mesh: Mesh,
    cameras: Measured,
    views: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Measured:
    """The network with its exact covered area; as it is where the plan counts faces.

    `views` replaces those of the plan.
    """
    if plan.unit_of_result()[0] == "face":
        return cameras
    most, poses = most_views(plan, views), cameras.placed
    areas = AreaNetwork(mesh, plan.build_task(most))
    apart = AreasByCamera(mesh, areas.task, cameras_apart(plan.rig, poses))
    finder = RegionPass(mesh, plan.rig, plan.build_task(most), method=plan.task.method)
    done = 0
    try:
        for regions in finder.batches(poses):
            areas.add(regions)
            apart.add(regions, poses.camera[done : done + len(regions.pose_ids)])
            done += len(regions.pose_ids)
            progress(done, len(poses))
    finally:
        finder.close()
    return replace(cameras, areas=areas, apart=apart)


def with_areas(
    plan: Plan,
    finder: RegionPass,
    cameras: Measured,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Measured:
    """The network with its exact covered area, and the share of it after each camera.

    `finder` counts as many views as `plan` needs at most (`most_views`).
    """
    wanted, poses = plan.task.views, cameras.placed
    by_group = wanted if isinstance(wanted, dict) else None
    areas, curve = AreaNetwork(finder.mesh, plan.build_task(most_views(plan))), []
    apart = AreasByCamera(finder.mesh, areas.task, cameras_apart(plan.rig, poses))
    for row in range(len(poses)):
        found = finder.find(poses[row : row + 1], closed=apart.closed(areas.closed))
        areas.add(found)
        apart.add(found, poses.camera[row : row + 1])
        curve.append(areas.summary(by_group)["percent"] / 100)
        progress(row + 1, len(poses))
    share = curve[-1] if curve else 0.0
    curve_of_area = np.array(curve, np.float64)
    return replace(cameras, areas=areas, apart=apart, curve=curve_of_area, share=share)


def most_views(plan: Plan, views: int | None = None) -> int:
    """Largest number of views that a plan counts; `views` replaces its own."""
    wanted = views or plan.task.views
    return max([1, *wanted.values()]) if isinstance(wanted, dict) else wanted


def summary_of(plan: Plan, cameras: Measured, views: int | None = None) -> dict[str, Any]:
    """Summary of the network with its covered area, ready for JSON; `views` as for `areas_of`."""
    unit, reason = plan.unit_of_result()
    found = cameras.network.summary() | {"by": unit, "by_face_because": reason}
    if cameras.areas is not None:
        wanted = views or plan.task.views
        by_group = wanted if isinstance(wanted, dict) else None
        cameras.areas.add_to(found, by_group)
        found |= cameras.areas.dead_zones(plan.rig, cameras.placed, by_group)
    if apart := _by_camera(plan.rig, cameras):
        found["by_camera"] = apart
    return found


def _by_camera(rig: Rig, cameras: Measured) -> list[dict[str, Any]]:
    """Coverage by the poses of each of several cameras, ready for JSON."""
    mesh, of_pose = cameras.network.mesh, cameras.placed.camera
    found = []
    for index in cameras_apart(rig, cameras.placed):
        own = of_pose == index
        covered = share_of_faces(
            mesh, cameras.covers[own].any(axis=0) & mesh.task_mask, mesh.task_mask
        )
        entry = {"camera": rig.names[index], "poses": int(own.sum()), "covered": covered}
        found.append(entry | (cameras.apart.entry(index) if cameras.apart else {}))
    return found


def area_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines about the covered area and the largest dead zones, or why there are none.

    `summary` is one of `summary_of`.
    """
    if "covered_area" in summary:
        return [f"covered: {in_words(summary['covered_area'])}", *zone_lines(summary)]
    return [f"by face, because {reason}" for reason in [summary["by_face_because"]] if reason]


def measured(
    objective: Objective,
    poses: ArrayLike | Poses,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Measured:
    """Coverage of a network, with its bounds.

    Parameters
    ----------
    objective : Objective
        Weights and an open observer.
    poses : (K, 4, 4) array_like, or Poses
        world_from_camera, with the camera of each; K may be 0. Of rigs, those of the rigs.
    progress : callable
        Called with the poses done and the total.
    """
    mesh, mounted = objective.observer.mesh, renumbered(poses)
    placed, owner = objective.cameras(mounted)
    network, nearest = PlanNetwork(mesh, objective.task), NearestCameras(mesh.n_faces)
    masks = np.zeros((3, len(placed), mesh.n_faces), np.bool_)
    if len(placed):
        figures = (*NETWORK_FIGURES, "projected_area", "pixel_density", "facing_density")
        for batch in evaluate_batches(objective.observer, placed, objective.task, fields=figures):
            network.add(batch)
            nearest.add(batch)
            masks[0, batch.pose_ids] = batch.reason == Reason.COVERED
            masks[1:, batch.pose_ids] = certain_and_possible(batch)
            progress(len(network.pose_ids), len(placed))
    eyes = placed.world_from_camera[:, :3, 3]
    covered, certain, possible = (objective.covered(mask, eyes) for mask in masks)
    network.is_covered = covered
    until = objective.cameras_until_covered(masks[0], eyes)
    worth = [objective.worth(until <= n) for n in range(1, len(placed) + 1)]
    return Measured(
        mounted=mounted,
        placed=placed,
        owner=owner,
        network=network,
        nearest=nearest.camera,
        covers=masks[0],
        covered=covered,
        certain=certain,
        possible=possible,
        curve=np.array([float(objective.share(each)) for each in worth]),
        share=float(objective.share(objective.worth(covered))),
    )


def left_over(
    observer: Observer,
    cameras: Measured,
    progress: Callable[[int, int], None],
    candidates: Poses | None = None,
    bounds: CandidateBounds | None = None,
    views: int | Mapping[str, int] = 1,
) -> Leftover:
    """Faces that a measured network does not cover, with reasons; arguments as for `left_by`.

    By area, those that it does not cover as a whole; `views` are needed there.
    """
    covered = cameras.covered
    if cameras.areas is not None:
        covered = covered | whole_faces(cameras.areas, views)
    return left_by(
        observer,
        cameras.placed,
        cameras.network,
        cameras.nearest,
        candidates=renumbered(np.zeros((0, 4, 4)) if candidates is None else candidates),
        covered=covered,
        progress=progress,
        bounds=bounds,
    )


def certain_and_possible(batch: Coverage) -> BoolArray:
    """(2, P, F) pairs covered at the lower and at the upper bound of their visibility.

    A pair that fails a criterion before occlusion, or for its angle, fails at both. A pair without
    a sample is judged by the computed area of its image, not by its pixels per m^2.
    """
    task = batch.task
    drawn = np.where(batch.reason == Reason.UNSAMPLED, batch.projected_area, batch.drawn_pixels)
    enough = drawn / task.min_pixels
    if task.cap_resolution:
        enough = np.minimum(enough, 1.0)
    open_ones = (batch.reason == Reason.OCCLUDED) | (batch.reason == Reason.UNSAMPLED)
    open_ones &= batch.incidence <= math.radians(task.max_incidence_deg)
    open_ones &= batch.pixel_density >= task.min_pixel_density
    open_ones &= batch.facing_density >= task.min_facing_density
    covered = batch.reason == Reason.COVERED
    ends = (
        (covered, np.maximum(batch.visibility - batch.visibility_bound, 0.0)),
        (covered | open_ones, np.minimum(batch.visibility + batch.visibility_bound, 1.0)),
    )
    found = np.empty((2, *batch.reason.shape), np.bool_)
    for row, (asked, visibility) in enumerate(ends):
        product = np.where(visibility >= task.min_visibility, visibility, 0.0) * enough
        found[row] = asked & (product >= task.min_coverage) & (product > 0)
    # The measured result is between the two, in spite of rounding of the products.
    found[1] |= covered
    return found
