"""Observers: one mesh through one camera or several, measured in many poses by three methods.

certified
    Regions of faces that no event edge crosses are proved wholly visible or wholly hidden; the
    faces that are crossed are computed. See `rastercov.exact.certificate`. Needs no rasteriser.
exact
    Every face is computed, see `rastercov.exact.half_planes`: the same answers several times
    slower, to check with.
sampled
    Counts of a rasteriser, with a statistical bound; see `rastercov.raster.observation`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import DeviceError
from rastercov.base.memory import check_memory
from rastercov.base.threads import Closing, ScratchPool, share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import limits_of_poses
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, check_scene
from rastercov.coverage.engine import Engine, settled
from rastercov.coverage.face_pass import FacePass, Measured
from rastercov.mesh import Mesh
from rastercov.raster import backend_of
from rastercov.raster.contract import FaceCounts, RasterizerInfo
from rastercov.raster.observation import BoundKind, Observation, Visibility
from rastercov.raster.several import Rasterizers

FloatArray = NDArray[np.float64]

ROLL = 0.4
"""Radians by which the grid of samples is turned against the image: 23 degrees, far from every
direction that is common in manufactured parts. Along rows of samples errors of counting add up."""


class Observer(Closing, ABC):
    """Areas of one mesh that one camera sees; open it with `open_observer`, use it in a `with`.

    Any number of threads may use one observer at once, except method "sampled" on OpenGL: that
    one belongs to the thread that opened it, and says so in any other.
    """

    mesh: Mesh
    camera: Cameras
    info: RasterizerInfo
    threads: int
    """Threads that share the poses of a call."""
    _is_open = True

    @abstractmethod
    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Measure every face in each pose.

        Parameters
        ----------
        poses : (P, 4, 4) or (4, 4) array_like, or Poses
            world_from_camera.

        Raises
        ------
        PoseError
            For a pose that is no rigid motion.
        ResourceError
            Where the arrays take more memory than is free, before any is taken.
        DeviceError
            After `close`.
        """

    def measure(self, poses: ArrayLike | Poses) -> Measured:
        """Result of `observe`, or the counts that it is made of where these are less work."""
        return self.observe(poses)

    def visibility(self, poses: ArrayLike | Poses) -> Visibility:
        """Visible fraction of each face in each pose, with a bound; errors as for `observe`."""
        accepted = self._accepted(poses, OBSERVED + FRACTION)
        measured = self.measure(accepted)
        found = FacePass(self.mesh, self.camera, self.threads).fractions(measured, accepted)
        return Visibility(*found, self.info)

    @abstractmethod
    def close(self) -> None:
        """Give back what it holds: later calls raise `DeviceError`; again it does nothing.

        A call that another thread is in ends as ever.
        """

    def _accepted(self, poses: ArrayLike | Poses, bytes_a_pair: int = 0) -> Poses:
        """Poses that this observer can measure, with room for what it finds of each face."""
        if not self._is_open:
            raise DeviceError("this observer is closed; open a new one")
        accepted = Poses.of(poses)
        accepted.check_cameras(len(cameras_of(self.camera)))
        if bytes_a_pair:
            _check_figures(len(accepted), self.mesh.n_faces, bytes_a_pair)
        return accepted


OBSERVED, FRACTION = 3 * 8 + 1, 2 * 8 + 1
"""Bytes of a pair of pose and face in an `Observation` and in a `Visibility`."""


def _check_figures(n_poses: int, n_faces: int, bytes_a_pair: int) -> None:
    check_memory(
        f"figures of {n_poses:,} poses x {n_faces:,} faces",
        bytes_a_pair * n_poses * n_faces,
        "observe fewer poses at a time",
    )


class SampledObserver(Observer):
    """Observer that counts samples of a rasteriser."""

    def __init__(self, mesh: Mesh, camera: Cameras, options: Mapping[str, Any]) -> None:
        self.threads = thread_count(options.get("threads"))
        own = {"backend", "supersample", "threads"}
        others = {name: value for name, value in options.items() if name not in own}
        if backend_of(options["backend"], others)[0] == "gl":  # which takes none: they judge counts
            options = {k: v for k, v in options.items() if k != "threads"}
        self._rasterizers = Rasterizers(mesh, cameras_of(camera), roll=ROLL, **options)
        self.mesh, self.camera, self.info = mesh, camera, self._rasterizers.info

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas from the counts of samples, see `Observer`."""
        return Observation.of_counts(self.measure(self._accepted(poses, OBSERVED)))

    def measure(self, poses: ArrayLike | Poses) -> FaceCounts:
        """The counts of samples themselves."""
        return self._rasterizers.count(self._accepted(poses))

    def close(self) -> None:
        """Release the memory."""
        self._rasterizers.close()  # refuses in a thread that may not, and all stays open
        self._is_open = False


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
        """What the solvers find of each pose; `figures`, where given, are filled.

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


class ExactObserver(Observer):
    """Observer that computes areas by half planes, all of them or where no proof decides."""

    def __init__(self, mesh: Mesh, camera: Cameras, engine: Engine) -> None:
        method = engine.method
        self.mesh, self.camera = mesh, camera
        self.info = RasterizerInfo(
            backend="analytic",
            plan=method,
            renderer=f"{method}, numba {version('numba')}",
            driver="",
            device="cpu",
            depth="float64",
            shaders="",
        )
        self._pass = self._open(engine)
        self.threads = self._pass.threads

    def _open(self, engine: Engine) -> ExactPass:
        return ExactPass(self.mesh, self.camera, engine)

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Exact or certified areas, see `Observer`."""
        accepted = self._accepted(poses, OBSERVED)
        figures = Figures.room(len(accepted), self.mesh.n_faces)
        self._pass.run(accepted, figures)
        return Observation(
            figures.visible, figures.area, figures.kind, figures.error, figures.clipped
        )

    def close(self) -> None:
        """Release the memory."""
        self._is_open = False
        self._pass.close()


def open_observer(
    mesh: Mesh,
    camera: Cameras,
    method: str | Engine = "certified",
    *,
    backend: str = "auto",
    supersample: int = 1,
    **options: Any,
) -> Observer:
    """Observer of a mesh through a camera, or several; use it in a `with` block.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera, Rig or sequence of Camera
        Where there are several, `Poses.camera` says which of them is in each pose.
    method : {"certified", "exact", "sampled"}, or Engine
        Method, see this module; or an `Engine` or its text form, such as "sampled:cpu@4", which
        then replaces the other arguments.
    backend, supersample, **options
        As for `open_rasterizer`, for method "sampled"; with OpenGL, `threads` are those that judge
        what it counts. The others take `threads`, and no `supersample`: they have no samples.

    Raises
    ------
    ConfigError
        For a method or an option that does not exist.
    """
    check_scene(mesh, camera)
    engine, options = settled(method, backend, supersample, options)
    if engine.method == "sampled":
        return SampledObserver(mesh, camera, options)
    return ExactObserver(mesh, camera, engine)


def visibility(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    method: str | Engine = "certified",
    *,
    backend: str = "auto",
    supersample: int = 1,
    **options: Any,
) -> Visibility:
    """Visible fraction of each face in each pose, with a bound.

    Parameters
    ----------
    mesh, camera
        Scene and camera, or cameras.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    method, backend, supersample, **options
        As for `open_observer`.

    Raises
    ------
    ResourceError
        Where the arrays take more memory than is free, before any is taken.
    """
    check_scene(mesh, camera)
    accepted = Poses.of(poses)
    _check_figures(len(accepted), mesh.n_faces, OBSERVED + FRACTION)
    with open_observer(
        mesh, camera, method, backend=backend, supersample=supersample, **options
    ) as observer:
        return observer.visibility(accepted)
