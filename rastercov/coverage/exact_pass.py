"""Pass over poses by the exact methods: solvers, shared among threads, and the arrays they fill."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.threads import ScratchPool, share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import limits_of_poses
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, shared_rows
from rastercov.coverage.engine import Engine
from rastercov.mesh import Mesh
from rastercov.raster.observation import BoundKind, Observation

if TYPE_CHECKING:
    from rastercov.exact.lens_solver import Visit


def room_for(n_poses: int, n_faces: int) -> Observation:
    """Memory for the figures of some poses.

    Not one array of three: the allocator uses memory of less than 32 MiB again, where fresh pages
    take a tenth of the time of a large pose.
    """
    shape = n_poses, n_faces
    kind, clipped = np.empty(shape, np.uint8), np.empty(n_poses, np.bool_)
    return Observation(np.empty(shape), np.empty(shape), kind, np.empty(shape), clipped)


def _figures(seen: Observation) -> tuple[NDArray[Any], ...]:
    """Figures of faces, a row a pose."""
    return seen.visible_pixels, seen.drawn_pixels, seen.kind, seen.area_error


class PoseSolver:
    """Solver of a surface through its cameras, one pose at a time, for one thread.

    Parameters
    ----------
    mesh, cameras
        The surface, and what sees it.
    is_certified : bool
        Compute faces only where no proof decides.
    """

    def __init__(self, mesh: Mesh, cameras: Sequence[Camera], is_certified: bool) -> None:
        from rastercov.exact.certificate import CertificateSolver
        from rastercov.exact.half_planes import HalfPlaneSolver
        from rastercov.exact.surface import surface_of

        solver_type = CertificateSolver if is_certified else HalfPlaneSolver
        self.mesh = mesh
        self.camera, self.index = cameras[0], 0
        """Camera of the poses from now on, and its index."""
        self.solver = solver_type(surface_of(mesh), cameras[0])
        self._lent: Any = self.solver
        """Solver that may write to the arrays of a result; not to those of planes of a lens."""
        self._own: Any = np.empty((3, 0))
        if not all(each.is_pinhole for each in cameras):
            from rastercov.exact.lens_solver import LensSolver

            self._lent = LensSolver(self.solver)

    def set_mesh(self, mesh: Mesh) -> None:
        """Take the mesh in another frame of its motion, with the same bodies."""
        if mesh is self.mesh:
            return
        from rastercov.exact.surface import surface_of

        self.mesh, surface = mesh, surface_of(mesh)
        self.solver.set_surface(surface)
        if self._lent is not self.solver:
            self._lent.set_surface(surface)

    @property
    def figures(self) -> Any:
        """Solver that has the figures of the camera."""
        return self.solver if self.camera.is_pinhole else self._lent

    def find(self, *pose: Any, is_measured: bool = True, visit: "Visit | None" = None) -> Any:
        """Solve a pose, with the arguments of `HalfPlaneSolver.set_pose`; subclasses have a result.

        `visit` and `is_measured` are those of `LensSolver.solve`.
        """
        if not self.camera.is_pinhole:
            self._lent.solve(self.camera, *pose, visit=visit, is_measured=is_measured)
            return
        self.solver.solve_pose(self.camera, *pose)
        if visit is not None:
            visit(0, self.solver)

    def measure(self, *pose: Any, seen: Observation, row: int) -> Any:
        """Solve a pose, and put its figures, in the order of the mesh, into a row of `seen`."""
        solver, places = self.figures, self.solver.surface.rows
        areas = seen.visible_pixels[row], seen.drawn_pixels[row], seen.area_error[row]
        is_lent = solver is self._lent and solver.write_to(*areas)
        found = self.find(*pose)
        if not is_lent:  # it keeps its own arrays
            own = solver.visible, solver.area, solver.area_error
            for array, area in zip(own, areas, strict=True):
                if isinstance(places, slice):
                    area[:] = array
                else:  # all rows are in range: with another mode `take` makes a copy first
                    array.take(places, out=area, mode="clip")
        # `EXACT` less 1 is `CERTIFIED`; assignment by a mask takes far longer.
        is_certified = solver.is_certified[places].view(np.uint8)
        np.subtract(np.uint8(BoundKind.EXACT), is_certified, out=seen.kind[row])
        return found

    def take_back(self) -> None:
        """Have the solver write to its own arrays again, so that it keeps no result alive."""
        self._lent.write_to(*self._own)


SolverType = Callable[[Mesh, Sequence[Camera], bool], PoseSolver]


class ExactPass:
    """Pass over poses by solvers; any number of threads may use it.

    Parameters
    ----------
    mesh, camera
        The surface, and the camera that sees it, or several.
    engine : Engine
        Its method is certified or exact.
    solver_type : callable
        Makes a solver of mesh, cameras and `is_certified`.
    """

    def __init__(
        self, mesh: Mesh, camera: Cameras, engine: Engine, solver_type: SolverType = PoseSolver
    ) -> None:
        cameras = cameras_of(camera)
        self.mesh, self.camera, self.cameras = mesh, camera, cameras
        self.threads, self.method = thread_count(engine.threads), engine.method
        is_certified = self.method == "certified"
        self._scratch: ScratchPool[Any] = ScratchPool(
            lambda: solver_type(mesh, cameras, is_certified), self.threads
        )  # without self: a cycle would keep the memory until garbage is collected

    def run(
        self,
        poses: Poses,
        seen: Observation | None,
        prepare: Callable[[Any], None] = lambda solver: None,
    ) -> list[Any]:
        """Results of the solvers for each pose; `seen`, of `room_for`, is filled where given.

        A fixed camera is solved once, and its other poses have the same result. `prepare` is called
        with each solver before its first pose.
        """
        matrices = poses.world_from_camera
        n_poses = len(matrices)
        poses.check_cameras(len(self.cameras))
        near, front_only, clipped = limits_of_poses(self.mesh, self.cameras, poses)
        if seen is not None:
            seen.clipped[:] = clipped
        found: list[Any] = [None] * n_poses
        first = shared_rows(self.camera, poses)
        own = np.flatnonzero(first == np.arange(n_poses)).tolist()

        def worker(solver: PoseSolver) -> Callable[[slice], None]:
            solver.set_mesh(self.mesh)
            prepare(solver)

            def work(turn: slice) -> None:
                for row in own[turn]:
                    solver.index = int(poses.camera[row])
                    solver.camera = self.cameras[solver.index]
                    of_pose = matrices[row], near[row], front_only[row]
                    if seen is None:
                        found[row] = solver.find(*of_pose, is_measured=False)
                    else:
                        found[row] = solver.measure(*of_pose, seen=seen, row=row)

            return work

        solvers = self._scratch.take(max(1, min(self.threads, len(own))))
        share_poses(len(own), [worker(solver) for solver in solvers])
        for solver in solvers:
            solver.take_back()
        self._scratch.give_back(solvers)
        for row in np.flatnonzero(first != np.arange(n_poses)).tolist():
            found[row] = found[first[row]]
            for array in () if seen is None else _figures(seen):
                array[row] = array[first[row]]
        return found

    def set_mesh(self, mesh: Mesh) -> None:
        """See `PoseSolver.set_mesh`; for the poses from now on."""
        self.mesh = mesh

    def close(self) -> None:
        """Release the scratch memory."""
        self._scratch.close()
