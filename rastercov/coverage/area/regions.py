"""Exact regions: the parts of each face that a camera covers, as convex polygons.

A point is covered by a camera when it is in the image, beyond the near plane, seen from the front
or on a two-sided face, hidden by nothing, in focus, within the largest angle of incidence, and has
enough pixels per m^2 and along its worst direction. Each of these is decided point by point, so
that the covered area does not depend on the triangles that the surface is cut into. See
docs/area.md.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray, check_memory, read_only
from rastercov.camera.camera import Camera
from rastercov.camera.lamps import Lamps
from rastercov.camera.models import MODELS
from rastercov.camera.pose import Poses
from rastercov.camera.rig import (
    Cameras,
    Rig,
    cameras_of,
    check_scene,
    lamps_of,
    rows_of_result,
    with_lamps,
)
from rastercov.coverage.area import polygons
from rastercov.coverage.area.criteria import PixelDensity
from rastercov.coverage.area.frames import frames_of, rows_at
from rastercov.coverage.area.light import Light
from rastercov.coverage.area.records import Criteria, Found, LensCriteria, Planes, Seen
from rastercov.coverage.area.sensors import gated, tasks_of
from rastercov.coverage.area.table import Regions
from rastercov.coverage.coverage import in_batches
from rastercov.coverage.engine import Engine
from rastercov.coverage.exact_pass import ExactPass, PoseSolver, room_for
from rastercov.coverage.observer import ExactObserver
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.native import area_region
from rastercov.raster.observation import Observation

if TYPE_CHECKING:
    from rastercov.exact.half_planes import HalfPlaneSolver


GAP_REL = 1e-6
"""Largest distance between the arc of the incidence criterion and its chords, and the mean width
of what no test of the pixel density decides, relative to the diagonal of the mesh."""
STRIP_REL = 2e-5
"""Mean width of undecided parts along the border of the image of a lens, and of densities
through it, relative to the same."""
EQUAL_AREA = "metashape_equisolid"
"""Model of lenses of equal area, without distortion."""
OF_A_FACE = {
    "min_pixels": "min_pixels is of a face; give min_pixels_per_m2",
    "min_visibility": "min_visibility is of a face; by area a point is seen or hidden",
    "min_coverage": "min_coverage is of a face; by area a point is covered or not",
    "focus_rule": "focus_rule is of a face; by area each point must be in focus",
    "cap_resolution": "cap_resolution is of a face; by area nothing is graded",
}
"""Thresholds of a task that depend on the triangles: by area they must have their defaults."""


_NOTHING_FOUND = (
    np.empty((0, 2)), np.empty(0, np.int64), np.empty(0, np.int32),
    np.empty(0, np.int32), np.empty(0), np.empty(0),
)  # fmt: skip
"""Pieces, and faces with an area or a bound, of a pose that sees none; see `_Finder.find`."""


def check_pointwise(task: Task) -> None:
    """Raise `ConfigError` for a task with a threshold that no point can meet or fail."""
    for name, text in OF_A_FACE.items():
        if getattr(task, name) != getattr(Task(), name):
            raise ConfigError(f"{text}, got {name} {getattr(task, name)}")


def regions(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task | None = None,
    *,
    lamps: Lamps | None = None,
    method: str | Engine = "certified",
    threads: int | None = None,
) -> Regions:
    """Parts of the task faces that each pose covers, as convex polygons in their planes.

    Parameters
    ----------
    mesh, camera
        The surface, and the camera that sees it, or several: see `Poses.camera`. Of a `Rig` with a
        rule, a row of the result is a pose of the rig, and has what its cameras cover together.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    task : Task, optional
        Thresholds; `Task()` unless given. Those that are of a face must have their defaults:
        `min_pixels`, `min_visibility`, `min_coverage`, `focus_rule`, `cap_resolution`; `views` and
        `min_angle_deg` are of several poses, and left out here.
    lamps : Lamps, optional
        Lamps that must light what is covered, on the side of the face that the camera is on.
    method : {"certified", "exact"}, or Engine
        Method of visibility, as for `open_observer`.
    threads : int, optional
        Poses measured in parallel; by default one per core.

    Raises
    ------
    ConfigError
        For a threshold that is of a face, or method "sampled".
    PoseError
        For a pose that is no rigid motion.
    """
    check_scene(mesh, camera)
    camera, placed = with_lamps(camera, lamps), Poses.of(poses)
    task = (Task() if task is None else task).lit_by(lamps)
    finder = RegionPass(mesh, camera, task, method=method, threads=threads)
    return gated(finder.find(placed), camera, placed)


def covering_poses(regions: Regions, face: ArrayLike, points: ArrayLike) -> NDArray[np.bool_]:
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
        "ask for fewer points at a time",
    )
    return rows_at(regions, regions.pose, n_poses, face, points)


class RegionPass(ExactPass):
    """Regions of one mesh through its cameras by one task; any number of threads may use it.

    Parameters are those of `regions`, and `only_task`: occluders need no figures in `find`. Where
    faces need neither regions nor figures, their visibility is not computed, which is most of the
    work in a scene of many occluders.
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
    ) -> None:
        check_scene(mesh, camera)
        self.task = Task() if task is None else task
        tasks = tasks_of(camera, self.task)
        for each in dict.fromkeys((self.task, *tasks)):
            check_pointwise(each)
        self.task.check_light(lamps_of(camera))
        engine = Engine.of(method, threads)
        if engine.method == "sampled":
            raise ConfigError("regions are exact; use method certified or exact, got sampled")
        cameras = cameras_of(camera)
        self._least = np.array([
            each.min_pixels_per_m2 * _has_closed_form(own)
            for own, each in zip(cameras, tasks, strict=True)
        ])  # fmt: skip
        self._scales = np.array([each.fx * each.fy for each in cameras])
        make = partial(_Finder, tasks=tasks, only_task=only_task)
        super().__init__(mesh, camera, engine, make)
        self.light: Light | None = None
        """Light of the lamps of the cameras; regions of `find` know it, and are not cut by it."""
        self._of_lamps: RegionPass | None = None
        if (lamps := lamps_of(camera)) is not None and isinstance(camera, Rig):
            self._of_lamps = RegionPass(mesh, lamps.eyes, method=engine, only_task=True)
            self.light = Light(lamps, self.task, camera, self._of_lamps.find)

    def set_mesh(self, mesh: Mesh) -> None:
        """As of `ExactPass`; light is that of the mesh from now on."""
        if mesh is self.mesh:
            return
        super().set_mesh(mesh)
        if self.light is not None and self._of_lamps is not None:
            self._of_lamps.set_mesh(mesh)
            self.light = self.light.anew()

    def lit_by(self, find: Callable[["RegionPass", Poses], Regions]) -> Light | None:
        """Light of the mesh, with regions of points of lamps by a function of their pass."""
        if self.light is None or self._of_lamps is None:
            return None
        return self.light.anew(partial(find, self._of_lamps))

    def close(self) -> None:
        """Release the scratch memory."""
        super().close()
        if self._of_lamps is not None:
            self._of_lamps.close()

    def find(
        self, poses: Poses, closed: NDArray[np.bool_] | None = None, seen: Observation | None = None
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

        def prepare(finder: "_Finder") -> None:
            finder.leave_out(closed, is_measured=seen is not None)

        return self._joined(poses, self.run(poses, seen, prepare))

    def batches(self, poses: Poses) -> Iterator[Regions]:
        """Regions of rows of the result a few at a time; at least one batch."""
        rows = rows_of_result(self.camera, poses)
        for part in in_batches(poses, self.mesh.n_faces, self.threads, rows):
            yield gated(self.find(part), self.camera, part)

    def _joined(self, poses: Poses, found: Sequence[Any]) -> Regions:
        """Regions of all poses in one table."""
        columns = zip(_NOTHING_FOUND, *found, strict=True)  # of the right types, whatever follows
        xy, counts, face, pair_face, area, bound = map(np.concatenate, columns)
        rows = np.arange(len(poses), dtype=np.int32)
        regions = Regions(
            self.mesh, xy, polygons.starts_of(counts), face, self.camera, self.task, poses.ids,
            pose=np.repeat(rows, [len(each[2]) for each in found]),
            pair_pose=np.repeat(rows, [len(each[3]) for each in found]),
            pair_face=pair_face, area=area, bound=bound, eyes=poses.world_from_camera[:, :3, 3],
            light=self.light,
            columns=poses.world_from_camera[:, :3, 1],
        )  # fmt: skip
        if not (limits := self._least[poses.camera]).any():
            return regions
        axes, cameras = poses.world_from_camera[:, :3, 1].copy(), cameras_of(self.camera)
        axes[[cameras[at].model != "equirectangular" for at in poses.camera]] = 0.0
        scales = self._scales[poses.camera]
        return regions.where(PixelDensity(regions.eyes, axes, scales, limits))


class _Finder(PoseSolver):
    """Regions one pose at a time, with the scratch memory of one thread."""

    def __init__(
        self,
        mesh: Mesh,
        cameras: Sequence[Camera],
        is_certified: bool,
        tasks: Sequence[Task],
        only_task: bool,
    ) -> None:
        super().__init__(mesh, cameras, is_certified)
        self.solver.keep_pieces()
        self._own = self._lent.visible, self._lent.area, self._lent.area_error
        surface = self.solver.surface
        # The solver has the targets behind the opaque faces, and may have sorted these.
        rows = np.arange(surface.n_faces)[surface.rows]
        self._rows = read_only(rows, np.int64)
        self._is_asked = mesh.task_mask & (frames_of(mesh).areas > 0)
        # Figures through a lens are sums over planes, of all faces.
        has_lens = not all(camera.is_pinhole for camera in cameras)
        has_figures = mesh.task_mask | (not only_task or has_lens)
        self._has_no_figures = None if has_figures.all() else ~has_figures
        self.planes = self._planes()
        self._tasks, self._criteria_of = tasks, cache(_criteria)
        self._rooms = [Found.of_room(1024, 8192, mesh.n_faces) for _ in range(2)]

    def _planes(self) -> Planes:
        arrays: list[Any] = [read_only(array, np.float64) for array in frames_of(self.mesh)]
        masks = self.mesh.two_sided_mask, self._is_asked
        return Planes._make(arrays + [read_only(mask, np.bool_) for mask in masks])

    def set_mesh(self, mesh: Mesh) -> None:
        """As of `PoseSolver`."""
        if mesh is not self.mesh:
            super().set_mesh(mesh)
            self.planes = self._planes()

    def leave_out(self, closed: NDArray[np.bool_] | None, *, is_measured: bool) -> None:
        """Find no regions of some faces, (F,) bool, from now on; or, not measured, nothing else."""
        is_asked = self._is_asked if closed is None else self._is_asked & ~closed
        self.planes = self.planes._replace(is_asked=read_only(is_asked, np.bool_))
        self._asks_nothing = not is_asked.any()
        self.solver.leave_out(self._has_no_figures if is_measured else ~is_asked)

    def find(self, *pose: Any, is_measured: bool = True, visit: Any = None) -> Any:
        """Corners, corner counts and faces of the pieces of a pose; faces, areas and bounds.

        Without `is_measured` there may be no figures of faces.
        """
        parts: list[tuple[Any, ...]] = []

        def cut(plane: int, solver: "HalfPlaneSolver") -> None:
            error, size = solver.camera.pixel_error, solver.surface.diagonal
            criteria = self._criteria_of(self.camera, self._tasks[self.index], plane, error, size)
            parts.append(self._cut(solver, criteria))

        if is_measured or not self._asks_nothing:
            super().find(*pose, is_measured=is_measured, visit=None if self._asks_nothing else cut)
        if not parts:
            return _NOTHING_FOUND
        return parts[0] if len(parts) == 1 else _of_planes(parts, self.planes.areas)

    def _cut(self, solver: "HalfPlaneSolver", criteria: Any) -> tuple[Any, ...]:
        """Regions in one solved plane; see `find`."""
        seen = Seen(
            solver.camera.rotation, solver.camera.centre, solver.camera.near, self._rows,
            solver.image_of_all.state, solver.visible, solver.area, solver.area_error,
            solver.is_certified, solver.kept_pieces,
        )  # fmt: skip
        if self.camera.is_pinhole:
            found = self._run(area_region.cut_regions, criteria, seen)
        else:
            rules, by_distance, cut = criteria.rules, criteria.by_distance, area_region.cut_pieces
            found = self._run(area_region.cut_regions, criteria.pinhole, seen)
            if by_distance and rules.z_f < np.inf:
                found = self._run(cut, criteria, seen, found, area_region.TO_DISCS)
            found = self._run(cut, criteria, seen, found, area_region.TO_VIEW)
            if max(
                rules.min_pixels_per_m2, rules.min_pixel_density, rules.min_facing_density
            ) > 0 or (by_distance and rules.z_n > 0):
                found = self._run(cut, criteria, seen, found, area_region.TO_DENSITIES)
        n, corners = found.used.tolist()
        listed = np.flatnonzero((found.area > 0) | (found.bound > 0)).astype(np.int32)
        return (
            found.xy[:corners].copy(), np.diff(found.starts[: n + 1]), found.face[:n].copy(),
            listed, found.area[listed], found.bound[listed],
        )  # fmt: skip

    def _run(self, kernel: Any, criteria: Any, seen: Any, *source: Any) -> Any:
        """Pieces that a loop finds, or makes of the pieces of another one."""
        slot = 1 if source and source[0] is self._rooms[0] else 0
        while True:
            out = self._rooms[slot]
            kernel(self.planes, criteria, seen, *source, out)
            n, corners = out.used.tolist()
            if n <= len(out.face) and corners <= len(out.xy):
                return out
            self._rooms[slot] = Found.of_room(n * 5 // 4, corners * 5 // 4, len(out.area))


def _of_planes(parts: Sequence[tuple[Any, ...]], face_areas: FloatArray) -> tuple[Any, ...]:
    """Regions of the planes of one pose in one table, by face; see `_Finder.find`."""
    xy, counts, face, listed, area, bound = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(face, kind="stable")
    xy = polygons.chosen(xy, polygons.starts_of(counts), order)[0]
    faces, where = np.unique(listed, return_inverse=True)
    areas, bounds = (np.bincount(where, each, len(faces)) for each in (area, bound))
    return (
        xy, counts[order], face[order],
        faces, areas, np.minimum(bounds, face_areas[faces]),
    )  # fmt: skip


def _has_closed_form(camera: Camera) -> bool:
    """True where pixels a m^2 have one: a panorama, and a lens of equal area."""
    is_plain = not any(camera.distortion)
    return camera.model == "equirectangular" or (camera.model == EQUAL_AREA and is_plain)


def _criteria(camera: Camera, task: Task, index: int, pixel_error: float, size: float) -> Any:
    """Pointwise criteria in ideal plane `index` of a camera, or in a pinhole, for the loops.

    `pixel_error` is the largest error of a position in the pinhole, px, `size` the diagonal of the
    mesh, metres.
    """
    from rastercov.camera.lenses.of_camera import fields_of, planes_of, slopes_of
    from rastercov.coverage.records import pinhole_of

    rules, gap = task.rules(camera), GAP_REL * size
    if _has_closed_form(camera):
        rules = rules._replace(min_pixels_per_m2=0.0)  # see `PixelDensity`
    if camera.is_pinhole:
        return Criteria(pinhole_of(camera), rules, gap, pixel_error)
    plane, record = planes_of(camera)[index]
    # What else there is in the plane, the lens decides.
    of_pinhole = rules._replace(
        z_n=0.0, z_f=np.inf, min_pixel_density=0.0, min_facing_density=0.0, min_pixels_per_m2=0.0
    )
    return LensCriteria(
        pinhole=Criteria(pinhole_of(plane.camera), of_pinhole, gap, pixel_error),
        rules=rules,
        by_distance=not MODELS[camera.model].is_planar,
        axis=read_only(plane.frame[2], np.float64),
        gap=STRIP_REL * size,
        tree=fields_of(camera, STRIP_REL / 4)[index],
        code=record.code,
        params=record.params,
        frame=record.frame,
        slopes=slopes_of(camera)[index],
    )


@dataclass(frozen=True, eq=False)
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
        self.light = self._finder.light
        self.closed: NDArray[np.bool_] = np.zeros(mesh.n_faces, np.bool_)

    def observe(self, poses: ArrayLike | Poses) -> RegionObservation:
        """Areas and regions of every face in each pose."""
        accepted = self._accepted(poses)
        seen = room_for(len(accepted), self.mesh.n_faces)
        found = self._finder.find(accepted, closed=self.closed, seen=seen)
        return RegionObservation(**vars(seen), regions=found)
