"""Exact regions: the parts of each face that a camera covers, as convex polygons.

A point is covered by a camera when it is in the image, beyond the near plane, front-facing or on a
two-sided face, hidden by nothing, in focus, within the largest angle of incidence, and has enough
pixels per m^2 and along its worst direction. Each of these is decided point by point, so that the
covered area does not depend on the triangles that the surface is cut into. See docs/area.md.
"""

from collections.abc import Collection, Iterator
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import BoolArray, ConfigError, check_memory, frozen_record, read_only
from rastercov.base.arguments import offsets_of
from rastercov.core.area.criteria import PixelDensity
from rastercov.core.area.features import FEATURES
from rastercov.core.area.polygons import frames_of, rows_at
from rastercov.core.area.relaxed import without_borders, without_occlusion
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Criteria, LensCriteria, Planes, Regions, any_of
from rastercov.core.camera import (
    MODELS,
    Camera,
    Cameras,
    Poses,
    cameras_of,
    equipment_on,
    eyes_of,
    rows_of_result,
)
from rastercov.core.camera.pose import engine_camera, pinhole_numbers
from rastercov.core.coverage.coverage import ExactObserver, in_batches
from rastercov.core.coverage.exact_pass import ExactPass, Figures, PlacedPoses, mask_of, room_for
from rastercov.core.coverage.task import STEEP, Engine, Reason, Rules, Task, own_reasons, rules_of
from rastercov.core.exact.surface import surface_of
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import Observation
from rastercov.engine import solver_visibility

GAP_REL = 1e-6
"""Largest distance between the arc of the incidence criterion and its chords, and the mean width
of what no test of the pixel density decides, relative to the diagonal of the mesh."""
STRIP_REL = 2e-5
"""The same of undecided parts along the border of the image of a lens, and of its densities."""
OF_A_FACE = {
    "focus_rule": "applies to faces (--thesis sets it); by area, leave out --thesis",
    "min_pixels": "applies to faces; by area, use min_pixels_per_m2",
    "min_visibility": "applies to faces; a point is visible or hidden",
    "min_coverage": "applies to faces; a point is covered or not",
    "cap_resolution": "applies to faces; results by area have no grades",
}
"""Thresholds of a task that depend on the triangles: by area they must have their defaults."""


def _nothing_in(n_poses: int) -> tuple[Any, ...]:
    """Regions of poses that see none, as `solver_visibility.Pass.find` has them."""
    none, areas = np.zeros(n_poses, np.int64), (np.empty(0),) * 4
    faces = np.empty(0, np.int32)
    return np.empty((0, 2)), np.empty(0, np.int64), faces, none, faces, none, *areas


def check_pointwise(task: Task, method: str = "exact") -> None:
    """Raise `ConfigError` for a threshold that applies to whole faces, and for a method by face."""
    for name, text in OF_A_FACE.items():
        if getattr(task, name) != getattr(Task, name):  # its default
            raise ConfigError(
                f"expected thresholds of points for a result by area, got {name}: {name} {text}"
            )
    if method == "sampled":
        raise ConfigError("expected method certified or exact, got sampled; regions are exact")


def covering_poses(regions: Regions, face: ArrayLike, points: ArrayLike) -> BoolArray:
    """Poses that cover points of the surface.

    Parameters
    ----------
    regions : Regions
        Of P poses.
    face : (N,) int array_like
        Face of each point.
    points : (N, 3) array_like
        Points on the faces, metres.

    Returns
    -------
    (N, P) bool
        Row i, column j: the pose `regions.pose_ids[j]` covers point i.
    """
    n_points, n_poses = len(np.asarray(face)), len(regions.pose_ids)
    check_memory(
        f"coverage of {n_points:,} points by {n_poses:,} poses",
        n_points * n_poses,
        "use fewer points at a time",
    )
    return rows_at(regions, regions.pose, n_poses, face, points)


class RegionPass(ExactPass):
    """Regions of one mesh through its cameras by one task; any number of threads may use it.

    Parameters are those of `rastercov.regions`; `relaxed`, reasons whose criteria are not asked, as
    those of the surface (`Rules.without`); and `only_task`: occluders need no figures in `find`.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Cameras,
        task: Task | None = None,
        *,
        method: str | Engine = "certified",
        threads: int | None = None,
        only_task: bool = False,
        relaxed: Collection[str] | None = None,
    ) -> None:
        self.task = Task() if task is None else task
        cameras, tasks, rules = zip(*rules_of(camera, self.task), strict=True)
        engine = Engine.of(method, threads)
        for each in dict.fromkeys((self.task, *tasks)):
            check_pointwise(each, engine.method)
        pairs = zip(rules, cameras, strict=True)
        self._rules = [own.without(relaxed or (), each) for own, each in pairs]
        least = [own.min_pixels_per_m2 for own in self._rules]
        self._least = np.array(least) * [each._has_closed_form for each in cameras]
        self._scales = np.array([each.fx * each.fy for each in cameras])
        self._tasks, self._of_surface = tasks, relaxed is None
        super().__init__(mesh, camera, engine, keeps_pieces=True)
        self._is_bare = relaxed is not None and "occluded" in relaxed
        if relaxed and "outside" in relaxed:
            self.cameras = tuple(map(without_borders, self.cameras))
        self._flat: tuple[RegionPass, ...] = ()  # as this one, of views within the allowed angle
        if relaxed and STEEP in relaxed:
            own = {*relaxed} - {STEEP}
            flat = RegionPass(mesh, camera, task, method=engine, only_task=only_task, relaxed=own)
            self._flat = (flat,)
        self._look_at(mesh)
        # Figures through a lens are sums over planes, of all faces.
        has_lens = any(each.is_curved for each in cameras)
        has_figures = mesh.task_mask | (not only_task or has_lens)
        self._has_no_figures = None if has_figures.all() else ~has_figures
        make = partial(RegionPass, mesh, method=engine, only_task=True)
        features = FEATURES if equipment_on(camera) else ()
        conditions = (each.condition(mesh, camera, self.task, make) for each in features)
        self.conditions = tuple(each for each in conditions if each is not None)
        """Of the cameras; regions of `find` know them, and are not cut by them."""

    @property
    def _surface(self) -> Any:
        return surface_of(without_occlusion(self.mesh) if self._is_bare else self.mesh)

    def set_mesh(self, mesh: Mesh) -> None:
        """As of `ExactPass`; conditions are those in the mesh from now on."""
        if mesh is self.mesh:
            return
        super().set_mesh(mesh)
        self._look_at(mesh)
        for each in self._flat:
            each.set_mesh(mesh)
        self.conditions = tuple(each.in_scene(mesh) for each in self.conditions)

    def _look_at(self, mesh: Mesh) -> None:
        """Set the faces that the surface itself lets be covered: by some camera, and by each."""
        tasks = self._tasks if self._of_surface else [None] * len(self._tasks)
        is_left = {each: own_reasons(mesh, each) == Reason.COVERED for each in tasks}
        self._is_left = np.array([is_left[each] for each in tasks])
        has_area = frames_of(mesh).areas > 0
        self._is_asked = mesh.task_mask & has_area & self._is_left.any(axis=0)

    def close(self) -> None:
        """Release the scratch memory."""
        super().close()
        for each in self.conditions:
            each.close()
        for flat in self._flat:
            flat.close()

    def find(
        self, poses: Poses, closed: BoolArray | None = None, seen: Observation | None = None
    ) -> Regions:
        """Regions of some poses, each by itself, whatever the rule of their rig.

        Parameters
        ----------
        poses : Poses
            P poses.
        closed : (F,) bool, optional
            Faces whose regions are left out.
        seen : Observation, optional
            Out: figures of all faces; of `room_for`. With `only_task` nothing is known of
            occluders, by their bounds.
        """
        is_asked = self._is_asked if closed is None else self._is_asked & ~closed
        if not is_asked.any():
            poses.check_cameras(len(self.cameras))
            if seen is not None:
                self.observe(poses, seen, self._has_no_figures)
            return self._join(poses, _nothing_in(len(poses)))
        left_out = self._has_no_figures if seen is not None else ~is_asked
        planes = self._planes(is_asked)

        def run(placed: PlacedPoses, figures: Figures) -> tuple[Any, ...]:
            mask = mask_of(left_out)
            return self._solvers.find(self._surface, planes, mask, placed, figures, self.threads)

        result = self._join(poses, self._run(poses, seen, run))
        for each in self._flat:
            union = any_of([result, each.find(poses, closed)])
            result = replace(union, eyes=result.eyes, columns=result.columns)
        return result

    def _planes(self, is_asked: BoolArray) -> Planes:
        return Planes(*frames_of(self.mesh), self.mesh.two_sided_mask, is_asked)

    def _set_camera(self, index: int) -> None:
        camera = self.cameras[index]
        own = _criteria(camera, self._rules[index])
        self._solvers.set_camera(index, engine_camera(camera), own)

    def batches(self, poses: Poses) -> Iterator[Regions]:
        """Regions of rows of the result a few at a time; at least one batch."""
        rows = rows_of_result(self.camera, poses)
        for part in in_batches(poses, self.mesh.n_faces, self.threads, rows):
            yield with_rule(self.find(part), self.camera, part)

    def _join(self, poses: Poses, values: tuple[Any, ...]) -> Regions:
        """Regions of all poses, of what the engine finds."""
        xy, counts, face, n_pieces, pair_face, n_pairs, area, bound, excess, cut_short = values
        rows = np.arange(len(poses), dtype=np.int32)
        regions = Regions(
            self.mesh,
            xy,
            offsets_of(counts),
            face,
            self.camera,
            self.task,
            poses.ids,
            pose=np.repeat(rows, n_pieces),
            pair_pose=np.repeat(rows, n_pairs),
            pair_face=pair_face,
            area=area,
            bound=bound,
            eyes=eyes_of(self.camera, poses),
            conditions=self.conditions,
            excess=excess,
            columns=poses.world_from_camera[:, :3, 1],
            cut_short=float(cut_short.sum()),
        )
        if len(set(self._tasks)) > 1:
            own = self._is_left[poses.camera]
            pieces, pairs = (
                np.flatnonzero(own[row, faces])
                for row, faces in ((regions.pose, face), (regions.pair_pose, pair_face))
            )
            regions = regions._with(pieces, pairs)
        if not (limits := self._least[poses.camera]).any():
            return regions
        axes, cameras = poses.world_from_camera[:, :3, 1].copy(), cameras_of(self.camera)
        axes[[cameras[at].model != "equirectangular" for at in poses.camera]] = 0.0
        scales = self._scales[poses.camera]
        return regions.where(PixelDensity(regions.eyes, axes, scales, limits))


def _criteria(camera: Camera, rules: Rules) -> Any:
    """Pointwise criteria in a pinhole, or in each ideal plane of a camera, for the engine."""
    from rastercov.core.camera.lenses.of_camera import ideal_camera, planes_of, unit_of

    own = solver_visibility.CameraTask()
    if camera._has_closed_form:
        rules = rules._replace(min_pixels_per_m2=0.0)  # see `PixelDensity`
    if not camera.is_curved:
        own.add_pinhole(Criteria(pinhole_numbers(camera), rules, GAP_REL))
        return own
    # What else there is in the plane, the lens decides.
    of_pinhole = rules._replace(
        z_n=0.0, z_f=np.inf, min_pixel_density=0.0, min_facing_density=0.0, min_pixels_per_m2=0.0
    )
    for each in planes_of(camera):
        record = each.record
        own.add_plane(
            LensCriteria(
                pinhole=Criteria(pinhole_numbers(ideal_camera(camera, each)), of_pinhole, GAP_REL),
                rules=rules,
                by_distance=not MODELS[camera.model].is_planar,
                axis=read_only(record.frame[2], np.float64),
                gap=STRIP_REL,
                tree=each.field,
                code=record.code,
                params=record.params,
                frame=record.frame,
                slopes=each.slopes,
                has_border=record.arc_half > 0,
                unit=unit_of(camera),
            )
        )
    return own


@frozen_record
class RegionObservation(Observation):
    """An `Observation`, and the regions that the same poses cover."""

    regions: Regions = field(kw_only=True)


class RegionObserver(ExactObserver):
    """Observer by method "certified" or "exact" whose observations are `RegionObservation`.

    One thread at a time may use it. With `only_task`, nothing is known of the visibility of
    occluders, by their bounds.

    Attributes
    ----------
    closed : (F,) bool
        Faces whose regions are left out from now on, such as those of `RegionUnion.closed`.
    """

    def __init__(
        self, mesh: Mesh, camera: Cameras, task: Task, engine: Engine, *, only_task: bool = False
    ) -> None:
        self._finder = RegionPass(mesh, camera, task, method=engine, only_task=only_task)
        super().__init__(self._finder)
        self.conditions = self._finder.conditions
        self.closed: BoolArray = np.zeros(mesh.n_faces, bool)

    def _measure(self, poses: Poses) -> RegionObservation:
        seen = room_for(len(poses), self.mesh.n_faces)
        result = self._finder.find(poses, closed=self.closed, seen=seen)
        return RegionObservation(**vars(seen), regions=result)
