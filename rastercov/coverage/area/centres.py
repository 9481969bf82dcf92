"""Cells whose centre a pose covers: an estimate of the cells that it covers.

It takes a fraction of the time of exact regions, and serves searches over poses, which measure the
best of them exactly.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.memory import Lists
from rastercov.base.threads import share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS
from rastercov.camera.near_plane import near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.area.failures import MARGIN_REL, Sight
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.area.regions import check_pointwise
from rastercov.coverage.task import Task


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
        from rastercov.base.memory import read_only
        from rastercov.kernels import area_centre as kernels

        check_pointwise(task)
        mesh = cells.mesh
        self._kernels, self._n_cells = kernels, len(cells)
        self._cameras, self._mesh = cameras_of(camera), mesh
        self._sight = sight = Sight(mesh)
        centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
        face = cells.source_face
        first = sight.corners[:, 0]
        edges = sight.corners[:, 1] - first, sight.corners[:, 2] - first
        self._triangles = read_only(np.concatenate([first, *edges], axis=1), np.float64)
        self._centres = kernels.Centres(
            points=read_only(sight.placed(centres), np.float64),
            normals=read_only(frames_of(mesh).normal[face], np.float64),
            two_sided=read_only(mesh.two_sided_mask[face], np.bool_),
            own=read_only(sight.row[face], np.int64),
        )
        self._rules = [_rules(each, task, sight.diagonal) for each in self._cameras]
        self._threads = thread_count(threads)

    def find(self, poses: ArrayLike | Poses) -> Lists:
        """Cells whose centre each of (P, 4, 4) poses covers."""
        placed = Poses.of(poses)
        placed.check_cameras(len(self._cameras))
        matrices = placed.world_from_camera
        sight, found = self._sight, [np.empty(0, np.int32)] * len(placed)
        near = near_limits(self._cameras, self._mesh.opaque.bounds, placed) / sight.diagonal
        eyes = sight.placed(matrices[:, :3, 3])

        def worker() -> Callable[[slice], None]:
            out = np.empty(self._n_cells, np.int32)

            def work(turn: slice) -> None:
                for row in range(len(placed))[turn]:
                    rules = self._rules[placed.camera[row]]
                    count = self._kernels.list_covered(
                        self._centres, rules, self._triangles, sight.nodes,
                        np.ascontiguousarray(matrices[row, :3, :3]), eyes[row], float(near[row]),
                        out,
                    )  # fmt: skip
                    found[row] = out[:count].copy()

            return work

        n_workers = max(1, min(self._threads, len(placed)))
        share_poses(len(placed), [worker() for _ in range(n_workers)])
        return Lists.of(found)


def _rules(camera: Camera, task: Task, scale: float) -> Any:
    """Thresholds at a point in a scene of diagonal 1, for the loops."""
    from rastercov.kernels import area_centre as kernels

    z_n, z_f = camera.depth_of_field(task.max_blur)
    facing, is_limited = task.min_facing_density, task.max_incidence_deg < 90
    common = {
        "width": float(camera.width),
        "height": float(camera.height),
        "min_per_m2": float(task.min_pixels_per_m2) * scale**2,
        "min_density": float(task.min_pixel_density) * scale,
        "cos_incidence": float(task.limits(camera).least_cosine) if is_limited else 0.0,
        "margin": MARGIN_REL,
    }
    if camera.is_pinhole:
        if facing > 0:
            z_f = min(z_f, min(camera.fx, camera.fy) / facing)
        return kernels.PointRules(
            fx=float(camera.fx), fy=float(camera.fy), cx=float(camera.cx), cy=float(camera.cy),
            z_n=float(z_n) / scale, z_f=float(z_f) / scale, **common,
        )  # fmt: skip
    from rastercov.base.memory import read_only
    from rastercov.camera.lenses.of_camera import lens_of

    lens = lens_of(camera)
    depths, distances = (z_n / scale, z_f / scale), (0.0, math.inf)
    if not MODELS[camera.model].is_planar:
        depths, distances = (-math.inf, math.inf), depths
    return kernels.LensPointRules(
        code=lens.code, params=read_only(lens.params, np.float64), is_wide=len(lens.planes) > 1,
        z_n=float(depths[0]), z_f=float(depths[1]),
        nearest=float(distances[0]), farthest=float(distances[1]),
        min_facing=float(facing) * scale, **common,
    )  # fmt: skip
