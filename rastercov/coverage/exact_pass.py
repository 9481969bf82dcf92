"""Pass over poses by the exact methods: solvers, shared among threads, and the arrays they fill."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.threads import ScratchPool, share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import limits_of_poses
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.engine import Engine
from rastercov.mesh import Mesh
from rastercov.raster.observation import BoundKind

FloatArray = NDArray[np.float64]


class Figures(NamedTuple):
    """Figures of P poses and F faces, and whether the near plane cuts each pose.

    Attributes
    ----------
    visible, area, error : (P, F) float64
        Visible area, area in the image and the bound of both, px^2.
    kind : (P, F) uint8
        `BoundKind`.
    clipped : (P,) bool
    """

    visible: FloatArray
    area: FloatArray
    error: FloatArray
    kind: NDArray[np.uint8]
    clipped: NDArray[np.bool_]

    @classmethod
    def room(cls, n_poses: int, n_faces: int) -> Self:
        """Memory for them.

        Not one array of three: the allocator uses memory of less than 32 MiB again, where fresh
        pages take a tenth of the time of a large pose.
        """
        visible, area, error = (np.empty((n_poses, n_faces)) for _ in range(3))
        kind = np.empty((n_poses, n_faces), np.uint8)
        return cls(visible, area, error, kind, np.empty(n_poses, np.bool_))

    def lend(self, solver: Any, row: int) -> bool:
        """Have a solver write a pose here; False if it keeps its own arrays."""
        is_lent: bool = solver.write_to(self.visible[row], self.area[row], self.error[row])
        return is_lent

    def take(self, solver: Any, row: int, *, is_lent: bool) -> None:
        """Take what a solver has found of a pose, in the order of the mesh."""
        rows = solver.surface.rows
        if not is_lent:
            # All rows are in range: with another mode `take` makes a copy first.
            solver.visible.take(rows, out=self.visible[row], mode="clip")
            solver.area.take(rows, out=self.area[row], mode="clip")
            solver.area_error.take(rows, out=self.error[row], mode="clip")
        # `EXACT` less 1 is `CERTIFIED`; assignment by a mask takes far longer.
        is_certified = solver.is_certified[rows].view(np.uint8)
        np.subtract(np.uint8(BoundKind.EXACT), is_certified, out=self.kind[row])


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
        self.solver: Any
        if all(each.is_pinhole for each in cameras):  # these need no solver of lenses
            self.solver = solver_type(surface_of(mesh), cameras[0])
        else:
            from rastercov.exact.lens_solver import LensSolver

            self.solver = LensSolver(surface_of(mesh), cameras[0], solver_type)
        self.cameras = cameras
        self._own: Any = np.empty((3, 0))

    def take_camera(self, index: int) -> None:
        """Solve poses of one of the cameras from now on."""
        self.solver.set_camera(self.cameras[index])

    def find(self, pose: FloatArray, near: float, front_only: bool, *, is_measured: bool) -> Any:
        """Solve a pose; the result is that of a subclass. Without `is_measured` no figures."""
        self.solver.set_pose(pose, near, front_only)
        self.solver.solve_all()

    def take_back(self) -> None:
        """Have the solver write to its own arrays again, so that it keeps no result alive."""
        self.solver.write_to(*self._own)


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
    threads : int, optional
        Threads that share the poses of a call; those of the engine unless given.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Cameras,
        engine: Engine,
        solver_type: Callable[..., PoseSolver] = PoseSolver,
        threads: int | None = None,
    ) -> None:
        # These compile, or load what was compiled.
        from rastercov.exact import certificate

        certificate.compile_once()
        cameras = cameras_of(camera)
        self.mesh, self.camera, self.cameras = mesh, camera, cameras
        self.threads = thread_count(engine.threads if threads is None else threads)
        is_certified = engine.method == "certified"
        self._scratch: ScratchPool[Any] = ScratchPool(
            lambda: solver_type(mesh, cameras, is_certified), self.threads
        )

    def run(
        self,
        poses: Poses,
        figures: Figures | None,
        prepare: Callable[[Any], None] = lambda solver: None,
    ) -> list[Any]:
        """Results of the solvers for each pose; `figures`, where given, are filled.

        `prepare` is called with each solver before its first pose.
        """
        matrices = poses.world_from_camera
        n_poses = len(matrices)
        poses.check_cameras(len(self.cameras))
        near, front_only, clipped = limits_of_poses(self.mesh, self.cameras, poses)
        if figures is not None:
            figures.clipped[:] = clipped
        found: list[Any] = [None] * n_poses

        def worker(solver: PoseSolver) -> Callable[[slice], None]:
            prepare(solver)

            def work(turn: slice) -> None:
                for row in range(n_poses)[turn]:
                    is_lent = figures is not None and figures.lend(solver.solver, row)
                    solver.take_camera(poses.camera[row])
                    found[row] = solver.find(
                        matrices[row], near[row], front_only[row], is_measured=figures is not None
                    )
                    if figures is not None:
                        figures.take(solver.solver, row, is_lent=is_lent)

            return work

        solvers = self._scratch.take(max(1, min(self.threads, n_poses)))
        share_poses(n_poses, [worker(solver) for solver in solvers])
        for solver in solvers:
            solver.take_back()
        self._scratch.give_back(solvers)
        return found

    def close(self) -> None:
        """Release the scratch memory."""
        self._scratch.close()
