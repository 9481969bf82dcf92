"""Observers of the three methods; opened by `rastercov.coverage.observer.open_observer`."""

from abc import ABC, abstractmethod
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.errors import DeviceError
from rastercov.base.memory import check_memory
from rastercov.base.threads import Closing, ScratchPool, share_poses, thread_count
from rastercov.camera.near_plane import limits_of_poses
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.face_pass import FacePass, Measured
from rastercov.exact.figures import Figures
from rastercov.mesh import Mesh
from rastercov.raster import backend_of
from rastercov.raster.contract import FaceCounts, RasterizerInfo
from rastercov.raster.observation import Observation, Visibility
from rastercov.raster.several import Rasterizers

ROLL = 0.4
"""Radians by which the grid of samples is turned against the image: 23 degrees, far from every
direction that is common in manufactured parts. Along rows of samples errors of counting add up."""


class OpenObserver(Closing, ABC):
    """An observer that is open until it is closed."""

    mesh: Mesh
    camera: Cameras
    info: RasterizerInfo
    threads: int
    """Threads that share the poses of a call."""
    _is_open = True

    @abstractmethod
    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas of every face in each pose; see `Observer.observe`."""

    def visibility(self, poses: ArrayLike | Poses) -> Visibility:
        """Visible fraction of each face in each pose; see `Observer.visibility`."""
        accepted = self._accepted(poses)
        check_visibility(len(accepted), self.mesh.n_faces)
        measured = self.measure(accepted)
        found = FacePass(self.mesh, self.camera, self.threads).fractions(measured, accepted)
        return Visibility(*found, self.info)

    def measure(self, poses: Poses) -> Measured:
        """Result of `observe`, or the counts it is made of where these are less work."""
        return self.observe(poses)

    def _accepted(self, poses: ArrayLike | Poses) -> Poses:
        """Poses that this observer can measure."""
        if not self._is_open:
            raise DeviceError("this observer is closed; open a new one")
        accepted = Poses.of(poses)
        accepted.check_cameras(len(cameras_of(self.camera)))
        return accepted

    def _check_memory(self, n_poses: int) -> None:
        """Raise `ResourceError` where an `Observation` takes too much memory."""
        areas_and_kind = 3 * 8 + 1
        _check_figures(n_poses, self.mesh.n_faces, areas_and_kind)


def check_visibility(n_poses: int, n_faces: int) -> None:
    """Raise `ResourceError` where an `Observation` and a `Visibility` take too much memory."""
    _check_figures(n_poses, n_faces, 25 + 17)


def _check_figures(n_poses: int, n_faces: int, bytes_a_pair: int) -> None:
    check_memory(
        f"figures of {n_poses:,} poses x {n_faces:,} faces",
        bytes_a_pair * n_poses * n_faces,
        "observe fewer poses at a time",
    )


class SampledObserver(OpenObserver):
    """Observer that counts samples of a rasteriser."""

    def __init__(
        self, mesh: Mesh, camera: Cameras, backend: str, supersample: int, options: dict[str, Any]
    ) -> None:
        self.threads = thread_count(options.get("threads"))
        others = {name: value for name, value in options.items() if name != "threads"}
        if backend_of(backend, others)[0] == "gl":  # which takes none; they judge what it counts
            options = others
        self._rasterizers = Rasterizers(
            mesh, cameras_of(camera), backend, supersample=supersample, roll=ROLL, **options
        )
        self.mesh, self.camera, self.info = mesh, camera, self._rasterizers.info

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas from the counts of samples, see `Observer`."""
        accepted = self._accepted(poses)
        self._check_memory(len(accepted))
        return Observation.of_counts(self.measure(accepted))

    def measure(self, poses: Poses) -> FaceCounts:
        """The counts of samples themselves."""
        return self._rasterizers.count(self._accepted(poses))

    def close(self) -> None:
        """Release the memory."""
        self._rasterizers.close()  # refuses in a thread that may not, and all stays open
        self._is_open = False


class ExactObserver(OpenObserver):
    """Observer that computes areas by half planes, all of them or where no proof decides."""

    def __init__(self, mesh: Mesh, camera: Cameras, method: str, threads: int | None) -> None:
        # These compile, or load what was compiled.
        from rastercov.exact import certificate, half_planes
        from rastercov.exact.surface import surface_of

        certificate.compile_once()
        self.mesh, self.camera, cameras = mesh, camera, cameras_of(camera)
        self.info = RasterizerInfo(
            backend="analytic",
            plan=method,
            renderer=f"{method}, numba {version('numba')}",
            driver="",
            device="cpu",
            depth="float64",
            shaders="",
        )
        self.threads = thread_count(threads)
        solver_type = (
            certificate.CertificateSolver if method == "certified" else half_planes.HalfPlaneSolver
        )
        self._surface = surface_of(mesh)
        if all(each.is_pinhole for each in cameras):
            make: Any = partial(solver_type, self._surface, cameras[0])
        else:
            from rastercov.exact.lens_solver import LensSolver

            make = partial(LensSolver, self._surface, cameras[0], solver_type)
        self._scratch: ScratchPool[half_planes.HalfPlaneSolver] = ScratchPool(make, self.threads)

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Exact or certified areas, see `Observer`."""
        accepted = self._accepted(poses)
        matrices = accepted.world_from_camera
        n_poses, n_faces = len(matrices), self.mesh.n_faces
        self._check_memory(n_poses)
        cameras = cameras_of(self.camera)
        figures = Figures.room(n_poses, n_faces)
        near, front_only, figures.clipped[:] = limits_of_poses(self.mesh, cameras, accepted)

        def worker(solver: Any) -> Any:
            def work(turn: slice) -> None:
                for row in range(n_poses)[turn]:
                    is_lent = figures.lend(solver, row)
                    solver.set_camera(cameras[accepted.camera[row]])
                    solver.set_pose(matrices[row], near[row], front_only[row])
                    solver.solve_all()
                    figures.take(solver, row, is_lent=is_lent)

            return work

        solvers = self._scratch.take(max(1, min(self.threads, n_poses)))
        share_poses(n_poses, [worker(solver) for solver in solvers])
        for solver in solvers:  # so that they keep no result alive
            solver.write_to(*np.empty((3, 0)))
        self._scratch.give_back(solvers)
        return Observation(
            figures.visible, figures.area, figures.kind, figures.error, figures.clipped
        )

    def close(self) -> None:
        """Release the memory."""
        self._is_open = False
        self._scratch.close()
