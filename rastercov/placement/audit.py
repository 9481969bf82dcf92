"""Audit of a set of cameras over a surface: elements, cameras, groups, and the smallest subset.

    poses -> regions or coverage -> pairs of camera and element -> figures of both -> subset

The elements are faces, or cells where the result is by area (`coverage.area.cells`); an element is
covered by a camera that covers half of it or more. Density and angle are those at its centroid.

Groups of poses are the frames of a rig, and the poses of each camera. A frame has the images that
the cameras of a rig took at the same instant; in it each camera is a view of its own. So the
smallest subset of frames is a selection of rigs (`Problem.starts`).
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    frozen_record,
    members,
    offsets_of,
    owners_of,
    sort_order,
)
from rastercov.base.format import percent_of
from rastercov.base.limits import limit_time
from rastercov.core.area.cells import Cells, cells, usual_size
from rastercov.core.area.network import AreaNetwork, unit_of_result
from rastercov.core.area.polygons import quantile
from rastercov.core.camera import (
    Cameras,
    Poses,
    cameras_of,
    check_scene,
    eyes_of,
    gates_of,
    names_of,
)
from rastercov.core.coverage.evaluation import cameras_apart
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.shards import EvaluationShards, Wanted, classify_parts, open_for
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.engine import coverage_spread
from rastercov.placement.bits import CoveredBits, by_face
from rastercov.placement.matrix_folder import shorten_coverage
from rastercov.placement.select.methods import MOST_PAIRS, select_greedy, select_integer
from rastercov.placement.select.problem import (
    PROVED,
    FewestCameras,
    Problem,
    Selection,
    finish,
    views_of,
    weights_of,
)
from rastercov.shards import ALONE, Progress, Staff

PROOF_SECONDS = 30.0
"""Wall time in which the smallest subset is to be proved."""


@frozen_record
class Groups:
    """Figures of G groups of poses.

    Attributes
    ----------
    names : tuple of str
        Name of each group.
    of_pose : (P,) int64
        Group of each pose.
    seen_m2, lost_m2, alone_m2 : (G,) float64
        Area that any pose of the group covers, area that is not covered without the group, and area
        that no other group covers, m^2.
    subset : Selection or None
        Fewest groups found that cover the same as all, with a bound; None if it was not requested.
    """

    names: tuple[str, ...]
    of_pose: IntArray
    seen_m2: FloatArray
    lost_m2: FloatArray
    alone_m2: FloatArray
    subset: Selection | None = None

    @property
    def redundant(self) -> BoolArray:
        """(G,) mask of the groups that can be left out, one at a time, without losing area."""
        return self.lost_m2 <= 0

    def figures(self, row: int) -> dict[str, float]:
        """Areas of a group, ready for JSON."""
        return {
            name: float(getattr(self, name)[row]) for name in ("seen_m2", "lost_m2", "alone_m2")
        }

    def entries(self, what: str) -> list[ByName]:
        """Figures of each group, with its name as entry `what`, ready for JSON."""
        counts = np.bincount(self.of_pose, minlength=len(self.names)).tolist()
        return [
            {what: name, "poses": counts[row]} | self.figures(row)
            for row, name in enumerate(self.names)
        ]

    def smallest(self, by: str) -> ByName:
        """The smallest subset with the names of its groups, ready for JSON; `by` as of `Audit`."""
        assert self.subset is not None
        chosen = [self.names[row] for row in self.subset.chosen]
        on = {"area": "patches", "face": "faces"}[by] if self.subset.status == "optimal" else None
        return self.subset.summary() | {"names": chosen, "proved_on": on}


def groups_of(
    problem: Problem,
    covered: BoolArray,
    label: Sequence[str | int],
    *,
    has_subset: bool = False,
    progress: Progress = ALONE.progress,
) -> Groups:
    """Groups of the poses of a problem with equal labels, in the order in which they come.

    Parameters
    ----------
    problem : Problem
        Elements that each of P poses covers.
    covered : (E,) bool
        Elements that all poses together cover.
    label : (P,) sequence of str or int
    has_subset : bool
        True where the smallest subset of groups is wanted.
    progress : callable
        Called with the groups done and their total, where directions matter.
    """
    index = {name: row for row, name in enumerate(dict.fromkeys(label))}
    names, of_pose = tuple(map(str, index)), np.array([index[name] for name in label], np.int64)
    indptr, face = problem.bits.pairs()
    # A pair of group and element, and the poses of the group that cover it.
    key = np.repeat(of_pose, np.diff(indptr)) * problem.n_faces + face
    pairs, times = np.unique(key, return_counts=True)
    group, element = np.divmod(pairs, max(1, problem.n_faces))
    weights = problem.weights[element]
    views = np.bincount(face, minlength=problem.n_faces)

    def total(is_counted: BoolArray | float) -> FloatArray:
        return np.bincount(group, weights * is_counted, len(names)).astype(np.float64)

    if problem.is_spread:  # directions matter: as much work as all pairs, for each group
        lost = np.zeros(len(names))
        for row in range(len(names)):
            progress(row, len(names))
            left = covered & ~problem.covered_by(np.flatnonzero(of_pose != row))[1]
            lost[row] = problem.weights[left].sum()
        progress(len(names), len(names))
    else:
        lost = total(covered[element] & (views[element] - times < problem.views[element]))
    alone, subset = total(times == views[element]), None
    if has_subset:
        subset = fewest(_choice(problem, of_pose, len(names)), int((lost > 0).sum()))
    return Groups(names, of_pose, total(1.0), lost, alone, subset)


def fewest(problem: Problem, needed: int) -> Selection:
    """Fewest candidates that cover the same as all, each at a cost of 1, with a bound.

    Proved by an integer program where highspy is installed, within `PROOF_SECONDS`. `needed` is the
    number of candidates without which, one at a time, something is not covered any more.
    """
    # Elements count one each: a share of the area would leave out the smallest.
    alike = replace(problem, weights=(problem.weights > 0).astype(np.float64))
    selection, pairs = select_greedy(alike), len(problem.bits.pairs()[1])
    if selection.gap > PROVED and needed < len(selection.chosen) and pairs <= MOST_PAIRS:
        with suppress(ConfigError), limit_time("smallest subset", PROOF_SECONDS):  # without highspy
            proved = select_integer(alike, time_limit=PROOF_SECONDS, threads=1)
            if proved.status == "interrupted":
                raise KeyboardInterrupt
            fewer = proved if len(proved.chosen) < len(selection.chosen) else selection
            selection = replace(proved, chosen=fewer.chosen)
    bound = max(selection.bound, float(needed))
    return finish(
        selection.method, problem, selection.chosen, bound, selection.seconds, selection.status
    )


def _choice(problem: Problem, of_pose: IntArray, n_groups: int) -> Problem:
    """The problem with groups as candidates, whose poses are views of their own; each costs 1."""
    order, counts = sort_order(of_pose), np.bincount(of_pose, minlength=n_groups)
    assert problem.eyes is not None
    return replace(
        problem,
        bits=problem.bits.take(order),
        starts=offsets_of(counts),
        eyes=problem.eyes[order],
        costs=np.ones(n_groups),
    )


@frozen_record(repr=False, kw_only=True)
class Audit(Groups, InOneLine):
    """Figures of P cameras over E elements of the evaluated surface, patches or faces.

    Attributes
    ----------
    mesh, camera, task
        Scene, cameras and thresholds.
    by : {"area", "face"}
        Basis of the result; the elements are patches by area, and faces otherwise.
    names : tuple of str
        Name of each pose.
    poses : Poses
        Valid poses, with the index of the camera of each.
    cells : Cells or None
        The patches of a result by area.
    problem : Problem
        Elements that each pose covers, with weights in m^2.
    subset : Selection
        Fewest poses found that cover the same elements, with a bound: no fewer can.
    views : (E,) int64
        Number of cameras that cover each element.
    best_density : (E,) float64
        Greatest pixel density at the centroid of an element by any camera that covers it, px/m; 0
        for none.
    best_camera : (E,) int32
        Row of that camera in `poses`; -1 for none.
    widest_angle : (E,) float64
        Greatest angle between the rays from the centroid to two cameras that cover the element,
        radians.
    covered : (E,) bool
        True for elements with enough cameras, from directions that differ as required.
    network : Network
        Views, best coverage and reason of each face.
    areas : AreaNetwork or None
        Exact covered area of a result by area.
    frames, by_camera : Groups or None
        Figures of each frame of images taken at the same instant, if the poses have frames; and of
        the poses of each camera, if there are several.
    quarantined : mapping of int to str
        Poses, by row in the input, that were left out because they crash the process that measures
        them, and how it ended.
    """

    mesh: Mesh
    camera: Cameras
    task: Task
    by: str
    poses: Poses
    cells: Cells | None
    problem: Problem
    subset: Selection
    views: IntArray
    best_density: FloatArray
    best_camera: Int32Array
    widest_angle: FloatArray
    covered: BoolArray
    network: Network
    areas: AreaNetwork | None
    frames: Groups | None = None
    by_camera: Groups | None = None
    quarantined: Mapping[int, str] = field(default_factory=dict)

    def percent(self, mask: BoolArray) -> float:
        """Percentage of the area in the elements of a mask, (E,)."""
        weights = self.problem.weights
        return percent_of(float(weights[mask].sum()), float(weights.sum()))

    @property
    def elements(self) -> Mesh:
        """The E elements as faces of a mesh."""
        return self.mesh if self.cells is None else self.cells.elements

    def with_poses(self, new: Poses, bits: CoveredBits) -> "Audit":
        """The audit with further poses, and the elements that each of them covers.

        Only problem, poses, and figures of elements are of all poses.
        """
        matrices = np.concatenate((self.poses.world_from_camera, new.world_from_camera))
        poses = Poses.of(matrices, camera=np.concatenate((self.poses.camera, new.camera)))
        eyes = eyes_of(self.camera, poses)
        both = self.problem.bits.joined(bits)
        problem = replace(self.problem, bits=both, costs=np.ones(len(poses)), eyes=eyes)
        return replace(
            self,
            problem=problem,
            poses=poses,
            **element_figures(problem, self.elements, poses, cameras_of(self.camera)),
        )

    def summary(self) -> ByName:
        """Figures of the audit, ready for JSON."""
        weights, total = self.problem.weights, float(self.problem.weights.sum())
        is_seen, several = self.views > 0, self.views > 1
        summary: ByName = {
            "by": self.by,
            "cameras": len(self.poses),
            "elements": len(self.views),
            "cell_size_m": None if self.cells is None else self.cells.size,
            "required_views": self.task.views,
            "covered_percent": self.percent(self.covered),
            "covered_percent_on": "faces" if self.cells is None else "patches",
            "seen_percent": self.percent(is_seen),
            "mean_views": float(np.average(self.views, weights=weights)) if total > 0 else 0.0,
            "median_density_px_per_m": quantile(self.best_density, weights, is_seen),
            "median_widest_angle_deg": math.degrees(quantile(self.widest_angle, weights, several)),
            "redundant_cameras": int(self.redundant.sum()),
            "subset": self.smallest(self.by),
            "per_camera": [
                {"pose": pose, "name": self.names[row], "camera": camera} | self.figures(row)
                for row, (pose, camera) in enumerate(
                    zip(self.poses.ids.tolist(), self.poses.camera.tolist(), strict=True)
                )
            ],
        }
        if self.frames is not None:
            summary["frames"] = {
                "count": len(self.frames.names),
                "redundant": int(self.frames.redundant.sum()),
                "subset": self.frames.smallest(self.by),
                "per_frame": self.frames.entries("frame"),
            }
        if self.by_camera is not None:
            summary["by_camera"] = self.by_camera.entries("camera")
        summary["quarantined"] = {str(pose): end for pose, end in self.quarantined.items()}
        network = self.network.summary()
        if self.areas is not None:
            self.areas.add_to(network, self.camera, self.poses)
            summary["covered_area"] = network["covered_area"]
        return summary | {"network": network}


def audit(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task | None = None,
    *,
    names: Sequence[str] | None = None,
    frames: Sequence[str] | None = None,
    by: str | None = None,
    resolution_of_result: float | None = None,
    method: str | Engine = "certified",
    folder: str | Path | None = None,
    staff: Staff = ALONE,
) -> Audit:
    """Coverage of a surface by existing cameras, and the contribution of each.

    Parameters
    ----------
    mesh : Mesh
        The surface.
    camera : Camera, Rig or sequence of Camera
        The cameras; for several, `Poses.camera` has the index of the camera of each pose.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    task : Task, optional
        Thresholds; `Task()` unless given.
    names : sequence of str, optional
        Name of each pose, such as that of its image, or of each valid one; "0", "1", ... unless
        given.
    frames : sequence of str, optional
        Name of the frame of each pose, as for `names`: poses of one frame are simultaneous.
    by : {"area", "face"}, optional
        Basis of the result; "area" unless a threshold applies to faces or the method counts
        samples.
    resolution_of_result : float, optional
        Longest side of the cells, metres; `rastercov.core.area.cells.usual_size` unless given.
    method : {"certified", "exact", "sampled"}, or Engine
        As for `open_observer`.
    folder : path, optional
        Folder for shards (`rastercov.core.coverage.shards`), from which an audit that was ended
        continues; they stay there.
    staff : Staff
        Processes that measure, with a folder that all of them share; this one unless given.

    Raises
    ------
    ConfigError
        For workers without a folder, names or frames of another number than the poses, and where
        workers fail.
    PoseError
        For a pose that is not a rigid transform.
    """
    check_scene(mesh, camera)
    if gates_of(camera):
        raise ConfigError(
            "expected images of single cameras, got a rig with a rule; leave the rule out"
        )
    if staff.workers is not None and folder is None:
        raise ConfigError("expected a folder for workers, got none; name one, or leave out workers")
    task = Task() if task is None else task
    accepted = Poses.of(poses)
    words = _texts("names", names, accepted)
    instants = _texts("frames", frames, accepted) if frames else ()
    engine = Engine.of(method)
    # The angle is judged at the centroids of the elements, cells too.
    single = replace(task, min_angle_deg=0.0)
    unit, _ = unit_of_result(by, single, engine)
    elements = None
    if unit == "area":
        size = usual_size(mesh) if resolution_of_result is None else resolution_of_result
        elements = cells(mesh, size)
    wanted = Wanted(engine, unit == "area", "covered" if unit == "face" else "none")
    measures = _measure_cameras(mesh, camera, accepted, single, wanted, elements, folder, staff)
    is_measured = np.isin(accepted.ids, measures.network.pose_ids)
    accepted = accepted[is_measured]
    instants = tuple(np.array(instants, object)[is_measured]) if instants else ()
    on = mesh if elements is None else elements.elements
    problem = _problem(on, eyes_of(camera, accepted), task, measures.bits)
    figures = element_figures(problem, on, accepted, cameras_of(camera))
    groups = partial(groups_of, problem, figures["covered"], progress=staff.progress)
    each = groups(list(range(len(accepted))), has_subset=True)
    of_camera = of_frame = None
    if cameras_apart(camera, accepted):
        labels = np.array(names_of(camera), object)[accepted.camera]
        of_camera = groups(labels.tolist())
    if instants:
        of_frame = groups(instants, has_subset=True)
    own = vars(each) | {"names": tuple(np.array(words, object)[is_measured])}
    return Audit(
        **own, mesh=mesh, camera=camera, task=task, by=unit, poses=accepted, cells=elements,
        problem=problem, network=measures.network, areas=measures.areas, **figures, frames=of_frame,
        by_camera=of_camera, quarantined=measures.quarantined,
    )  # fmt: skip


class _Measured(NamedTuple):
    """Coverage of all poses together, and the elements that each of them covers."""

    network: Network
    areas: AreaNetwork | None
    bits: CoveredBits
    quarantined: Mapping[int, str]


def _measure_cameras(
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    task: Task,
    wanted: Wanted,
    elements: Cells | None,
    folder: str | Path | None,
    staff: Staff,
) -> _Measured:
    """Measure poses, by way of shards in a folder where one is given."""
    network = Network(mesh, task)
    areas = AreaNetwork(mesh, task) if elements is not None else None
    n_measured, rows_of, elements_of = 0, [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
    with open_for(mesh, camera, task, wanted) as observer:
        shards = None
        if folder is not None:
            shards = EvaluationShards(Path(folder), observer, poses, task, wanted)
        for batch in classify_parts(network, observer, poses, wanted, shards, staff):
            network.add(batch)
            if areas is None or elements is None or batch.regions is None:
                is_scored = mesh.task_mask[batch.rows["face"]]
                row = np.searchsorted(batch.poses.ids, batch.rows["pose"][is_scored])
                own = batch.rows["face"][is_scored]
            else:
                areas.add(batch.regions)
                shares = elements.share(batch.regions)
                row = owners_of(np.diff(shares.starts))
                enough = shorten_coverage(shares.share, task.min_coverage)[1]
                row, own = row[enough], shares.cell[enough]
            rows_of.append(n_measured + row)
            elements_of.append(own.astype(np.int32))
            n_measured += len(batch.poses)
    row, element = np.concatenate(rows_of), np.concatenate(elements_of)
    n_elements = mesh.n_faces if elements is None else len(elements)
    bits = CoveredBits.from_pairs(row, element, n_measured, n_elements)
    return _Measured(network, areas, bits, {} if shards is None else shards.quarantined)


def _problem(on: Mesh, eyes: FloatArray, task: Task, bits: CoveredBits) -> Problem:
    """The fewest images, from eyes (P, 3), that cover the same elements as all."""
    return Problem(
        bits=bits,
        weights=weights_of(on, "area"),
        views=views_of(on, task.views),
        costs=np.ones(len(eyes)),
        goal=FewestCameras(1.0, of_reachable=True),
        groups=tuple(group.name for group in on.groups),
        face_group=on.face_group,
        min_angle=math.radians(task.min_angle_deg),
        eyes=eyes,
        centroids=on.centroids,
    )


def element_figures(
    problem: Problem, elements: Mesh, poses: Poses, cameras: Sequence[Any]
) -> ByName:
    """Views, best density and its camera, widest angle and whether it is covered, (E,), by name."""
    from rastercov.placement.footprints import best_densities  # with shapely

    starts, camera = by_face(*problem.bits.pairs(), problem.n_faces)
    points = elements.centroids
    best, by = best_densities(starts, camera, (points, elements.normals), poses, cameras)
    widest = np.empty(problem.n_faces)
    eyes = np.ascontiguousarray(problem.eyes)
    coverage_spread.widest_angles(starts, camera, np.ascontiguousarray(points), eyes, widest)
    views, covered = problem.covered_by(np.arange(len(poses)))
    return {
        "views": views, "covered": covered & (problem.weights > 0), "best_density": best,
        "best_camera": by, "widest_angle": widest,
    }  # fmt: skip


def _texts(what: str, texts: Sequence[str] | None, poses: Poses) -> tuple[str, ...]:
    """Text of each accepted pose; the number of the pose unless given."""
    if texts is None:
        return tuple(map(str, poses.ids))
    result = members(what, texts, str, "a list of strings", ConfigError)
    if len(result) == len(poses):
        return result
    if len(result) != len(poses.given):
        raise ConfigError(
            f"expected {what} for {len(poses.given)} poses, got {len(result)}; give a string for "
            "each"
        )
    return tuple(result[row] for row in poses.ids)
