"""Audit of a set of cameras over a surface: elements, cameras, and the smallest subset.

    poses -> regions or coverage -> pairs of camera and element -> figures of both -> subset

The elements are faces, or cells where the result is by area (`rastercov.area.cells`); an element is
covered by a camera that covers half of it or more. Density and angle are those at its centroid.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import check_kind, members
from rastercov._checks import finite_number, shown
from rastercov.area.cells import Cells, cells, usual_size
from rastercov.area.network import AreaNetwork, unit_of_result
from rastercov.area.observer import RegionObservation, RegionObserver
from rastercov.coverage import judged, measurements
from rastercov.coverage_pass import CoveragePass
from rastercov.engine import Engine
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.network import Network
from rastercov.observer import open_observer
from rastercov.placement.matrix import shortened
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.problem import FewestCameras, Problem, views_of, weights_of
from rastercov.placement.select.selection import Selection
from rastercov.pose import Poses
from rastercov.rig import Cameras, cameras_of, check_scene
from rastercov.task import Task

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FIGURES = (
    *("coverage", "reason", "visibility_bound", "visibility_kind"),
    *("in_view_fraction", "drawn_pixels"),
)
"""Figures that a `Network` adds up."""


@dataclass(frozen=True, eq=False)
class Audit:
    """Figures of P cameras over E elements of the task surface, faces or cells.

    Attributes
    ----------
    by : {"area", "face"}
        Unit of the result; the elements are cells or faces.
    poses : Poses
        The cameras, those without fault.
    names : tuple of str
        Name of each, (P,).
    cells : Cells or None
        The elements, where the result is by area.
    problem : Problem
        Elements that each camera covers, in compressed rows, with weights in m^2.
    views : (E,) int64
        Cameras that cover each element.
    best_density : (E,) float64
        Greatest pixel density at its centroid by any of them, px/m; 0 for none.
    best_camera : (E,) int32
        Row of that camera in `poses`; -1 for none.
    widest_angle : (E,) float64
        Greatest angle between the rays from its centroid to two of them, radians.
    covered : (E,) bool
        Elements with enough cameras, from directions that differ as asked.
    seen_m2, lost_m2, alone_m2 : (P,) float64
        Area that each camera covers, that is covered no more without it, and that no other covers.
    subset : Selection
        Fewest cameras found that cover the same elements, with a bound: no fewer can.
    network : Network
        By face: views, best coverage and reasons.
    areas : AreaNetwork or None
        Exact covered area, where the result is by area.
    """

    mesh: Mesh
    camera: Cameras
    task: Task
    by: str
    poses: Poses
    names: tuple[str, ...]
    cells: Cells | None
    problem: Problem
    views: IntArray
    best_density: FloatArray
    best_camera: NDArray[np.int32]
    widest_angle: FloatArray
    covered: BoolArray
    seen_m2: FloatArray
    lost_m2: FloatArray
    alone_m2: FloatArray
    subset: Selection
    network: Network
    areas: AreaNetwork | None

    @property
    def redundant(self) -> BoolArray:
        """(P,) cameras without which, one at a time, all remains covered."""
        return self.lost_m2 <= 0

    def summary(self) -> dict[str, Any]:
        """Figures of the audit, ready for JSON."""
        weights, total = self.problem.weights, float(self.problem.weights.sum())
        percent = 100 / total if total > 0 else 0.0
        is_seen, several = self.views > 0, self.views > 1
        summary: dict[str, Any] = {
            "by": self.by,
            "cameras": len(self.poses),
            "elements": len(self.views),
            "cell_size_m": None if self.cells is None else self.cells.size,
            "required_views": self.task.views,
            "covered_percent": percent * float(weights[self.covered].sum()),
            "seen_percent": percent * float(weights[is_seen].sum()),
            "mean_views": _mean(self.views, weights, weights > 0),
            "median_density_px_per_m": _median(self.best_density, weights, is_seen),
            "median_widest_angle_deg": math.degrees(_median(self.widest_angle, weights, several)),
            "redundant_cameras": int(self.redundant.sum()),
            "subset": self.subset.summary()
            | {"names": [self.names[row] for row in self.subset.chosen]},
            "per_camera": [
                {
                    "pose": int(self.poses.ids[row]),
                    "name": self.names[row],
                    "camera": int(self.poses.camera[row]),
                    "seen_m2": float(self.seen_m2[row]),
                    "lost_m2": float(self.lost_m2[row]),
                    "alone_m2": float(self.alone_m2[row]),
                }
                for row in range(len(self.poses))
            ],
        }
        network = self.network.summary()
        if self.areas is not None:
            self.areas.add_to(network)
            summary["covered_area"] = network["covered_area"]
        return summary | {"network": network}


def audit(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task | None = None,
    *,
    names: Sequence[str] | None = None,
    by: str | None = None,
    resolution_of_result: float | None = None,
    min_angle_deg: float = 0.0,
    method: str | Engine = "certified",
    skip_bad_poses: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Audit:
    """Coverage of a surface by existing cameras, and what each of them adds.

    Parameters
    ----------
    mesh : Mesh
        The surface.
    camera : Camera, Rig or sequence of Camera
        The cameras; where there are several, `Poses.camera` says which is in each pose.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    task : Task, optional
        Thresholds; `Task()` unless given.
    names : sequence of str, optional
        Name of each pose, such as of its image, or of each without fault; "0", "1", ... unless
        given.
    by : {"area", "face"}, optional
        Unit of the result; "area" unless a threshold is of a face or the method counts samples.
    resolution_of_result : float, optional
        Longest side of the cells, metres; `rastercov.area.cells.usual_size` unless given.
    min_angle_deg : float
        Least angle between the rays to two of the cameras that cover an element, degrees.
    method : {"certified", "exact", "sampled"}, or Engine
        As for `open_observer`.
    skip_bad_poses : bool
        Leave out poses that are no rigid motion instead of raising.
    progress : callable
        Called with the poses done and the total.

    Raises
    ------
    ConfigError
        For names of another number than the poses, or an angle that is none.
    PoseError
        For a pose that is no rigid motion.
    """
    check_scene(mesh, camera)
    task = Task() if task is None else task
    check_kind("task", task, Task, "a Task or None", ConfigError)
    accepted = Poses.of(poses, skip_bad=skip_bad_poses)
    words = _names(names, accepted)
    angle = finite_number(min_angle_deg)
    if not 0 <= angle <= 180:
        raise ConfigError(f"min_angle_deg must be 0 to 180, got {shown(min_angle_deg)}")
    engine = Engine.of(method)
    unit, _ = unit_of_result(by, task, engine)
    elements = None
    if unit == "area":
        size = usual_size(mesh) if resolution_of_result is None else resolution_of_result
        elements = cells(mesh, size)
    network = Network(mesh, task)
    areas = AreaNetwork(mesh, task) if elements is not None else None
    pairs = _Pairs()
    observer: Any = (
        open_observer(mesh, camera, engine)
        if elements is None
        else RegionObserver(mesh, camera, task, engine)
    )
    with observer:
        judge = CoveragePass(observer, task)
        progress(0, len(accepted))
        for part, seen in measurements(observer, accepted):
            coverage = judged(observer, judge, task, part, seen, FIGURES)
            network.add(coverage)
            if elements is None or areas is None or not isinstance(seen, RegionObservation):
                row, face = np.nonzero((coverage.coverage > 0) & mesh.task_mask)
                pairs.add(row, face, coverage.coverage[row, face], len(part))
            else:
                areas.add(seen.regions)
                found = elements.share(seen.regions)
                row = np.repeat(np.arange(len(part)), np.diff(found.starts))
                pairs.add(row, found.cell, found.share, len(part))
            progress(len(network.pose_ids), len(accepted))
    on = mesh if elements is None else elements.elements
    indptr, element = pairs.covered(task.min_coverage)
    problem = Problem(
        indptr=indptr,
        face=element,
        weights=weights_of(on, "area"),
        views=views_of(on, task.views),
        costs=np.ones(len(accepted)),
        goal=FewestCameras(1.0, of_reachable=True),
        groups=tuple(group.name for group in on.groups),
        face_group=on.face_group,
        mean_coverage=np.zeros(len(accepted)),
        min_angle=math.radians(angle),
        eyes=accepted.world_from_camera[:, :3, 3].copy(),
        centroids=on.centroids,
    )
    every = np.arange(len(accepted))
    views, covered = problem.covered_by(every)
    best, by_camera, widest, lost, alone = _figures(problem, on, accepted, cameras_of(camera))
    if angle > 0:
        lost = _lost_one_by_one(problem, covered)
    weights = problem.weights
    seen_m2 = np.array([float(weights[element[a:b]].sum()) for a, b in pairwise(indptr)])
    return Audit(
        mesh=mesh, camera=camera, task=task, by=unit, poses=accepted, names=words, cells=elements,
        problem=problem, views=views, best_density=best, best_camera=by_camera,
        widest_angle=widest, covered=covered & (weights > 0), seen_m2=seen_m2, lost_m2=lost,
        alone_m2=alone, subset=select_greedy(problem), network=network, areas=areas,
    )  # fmt: skip


class _Pairs:
    """Pairs of camera and element, batch by batch."""

    def __init__(self) -> None:
        self._counts, self._elements = [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
        self._values = [np.zeros(0)]

    def add(self, row: NDArray[Any], element: NDArray[Any], value: FloatArray, n: int) -> None:
        """Take in the pairs of `n` further poses, by row."""
        self._counts.append(np.bincount(row, minlength=n))
        self._elements.append(element.astype(np.int32))
        self._values.append(value)

    def covered(self, least: float) -> tuple[IntArray, NDArray[np.int32]]:
        """Row limits (P + 1,), and the elements (N,), of pairs with at least that coverage."""
        counts, element = np.concatenate(self._counts), np.concatenate(self._elements)
        covers = shortened(np.concatenate(self._values), least)[1]
        pose = np.repeat(np.arange(len(counts)), counts)[covers]
        starts = np.concatenate(([0], np.cumsum(np.bincount(pose, minlength=len(counts)))))
        return starts.astype(np.int64), element[covers]


def _figures(
    problem: Problem, elements: Mesh, poses: Poses, cameras: Sequence[Any]
) -> tuple[FloatArray, NDArray[np.int32], FloatArray, FloatArray, FloatArray]:
    """Best density and its camera, widest angle (E,); lost weight, and that of one camera (P,)."""
    from rastercov._jit import announce_compilation
    from rastercov.audit import kernels
    from rastercov.criteria_kernels import lens_of, read_only
    from rastercov.placement.select.presolve_kernels import by_face

    announce_compilation(kernels.widest_angles)
    n = problem.n_faces
    starts, camera = by_face(problem.indptr, problem.face, n)
    points, normals = (
        read_only(elements.centroids, np.float64),
        read_only(elements.normals, np.float64),
    )
    matrices = read_only(poses.world_from_camera, np.float64)
    best, by = np.zeros(n), np.full(n, -1, np.int32)
    for index, _ in poses.by_camera():
        kernels.best_densities(
            starts, camera, points, normals, matrices, poses.camera, index,
            lens_of(cameras[index]), best, by,
        )  # fmt: skip
    widest, lost, alone = np.empty(n), np.zeros(len(poses)), np.zeros(len(poses))
    kernels.widest_angles(starts, camera, points, np.ascontiguousarray(problem.eyes), widest)
    kernels.lost_weights(
        starts, camera, np.diff(starts), problem.views, problem.weights, lost, alone
    )
    return best, by, widest, lost, alone


def _lost_one_by_one(problem: Problem, covered: BoolArray) -> FloatArray:
    """Weight that is covered no more without each camera, where directions matter, (P,)."""
    every = np.arange(len(problem.costs))
    lost = np.zeros(len(every))
    for row in every:  # as much work as all pairs, each
        without = problem.covered_by(np.delete(every, row))[1]
        lost[row] = problem.weights[covered & ~without].sum()
    return lost


def _names(names: Sequence[str] | None, poses: Poses) -> tuple[str, ...]:
    """Name of each accepted pose."""
    if names is None:
        return tuple(map(str, poses.ids))
    found = members("names", names, str, "a list of texts", ConfigError)
    if len(found) == len(poses):
        return found
    if len(found) != len(poses.given):
        raise ConfigError(
            f"names must have one text for each of {len(poses.given)} poses, got {len(found)}"
        )
    return tuple(found[row] for row in poses.ids)


def _mean(values: NDArray[Any], weights: FloatArray, mask: BoolArray) -> float:
    total = float(weights[mask].sum())
    return float((values[mask] * weights[mask]).sum()) / total if total > 0 else 0.0


def _median(values: FloatArray, weights: FloatArray, mask: BoolArray) -> float:
    """Median by weight; 0 for nothing."""
    chosen = np.flatnonzero(mask & (weights > 0))
    if not len(chosen):
        return 0.0
    order = chosen[np.argsort(values[chosen], kind="stable")]
    below = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(below, below[-1] / 2)]])
