"""Observers: one mesh through one camera or several, measured in many poses by three methods.

certified
    Regions of faces that no event edge crosses are proved wholly visible or wholly hidden; the
    faces that are crossed are computed. See `rastercov.core.exact`. Needs no rasteriser.
exact
    Every face is computed, see `rastercov.core.exact`: the same answers several times
    slower, to check with.
sampled
    Counts of a rasteriser, with a statistical bound; see `rastercov.core.raster.observation`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress

from numpy.typing import ArrayLike

import rastercov
from rastercov.base import Closing, DeviceError, ReadByName, check_memory, thread_count
from rastercov.core.camera import Cameras, Poses, cameras_of, check_scene
from rastercov.core.coverage.exact_pass import ExactPass, room_for
from rastercov.core.coverage.face_pass import Measured
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Mesh
from rastercov.core.raster.bits import Criteria, Judged
from rastercov.core.raster.contract import FaceCounts, RasterizerInfo
from rastercov.core.raster.observation import Observation
from rastercov.core.raster.several import Rasterizers

ROLL = 0.4
"""Radians by which the grid of samples is turned against the image: 23 degrees, far from every
direction that is common in manufactured parts. Along rows of samples errors of counting add up."""
OBSERVED = 3 * 8 + 1
"""Bytes of a pair of pose and face in an `Observation`."""


class Observer(Closing, ABC):
    """Areas of one mesh that one camera, or several, see; open it with `open_observer`.

    Use it in a `with` block. Any number of threads may use one observer at once, except with method
    "sampled" on OpenGL: that observer belongs to the thread that opened it, and raises
    `DeviceError` in any other.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     near = observer.observe(rc.look_at((0.7, 0, 0), (0, 0, 0)))
    ...     far = observer.observe(rc.look_at((1.3, 0, 0), (0, 0, 0)))
    >>> round(near.visible_pixels.sum()), round(far.visible_pixels.sum())
    (40000, 10000)
    """

    mesh: Mesh
    camera: Cameras
    info: RasterizerInfo
    threads: int
    """Threads that share the poses of a call."""
    _is_open = True

    @abstractmethod
    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas of every face in each pose, (P, 4, 4) or (4, 4) world_from_camera.

        Raises
        ------
        PoseError
            For a pose that is not a rigid transform, and a camera index that does not exist.
        ResourceError
            Where the arrays need more memory than is free; checked before allocation.
        DeviceError
            After `close`.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
        >>> with rc.open_observer(mesh, camera) as observer:
        ...     seen = observer.observe(rc.look_at((0.7, 0, 0), (0, 0, 0)))
        >>> seen.visible_pixels[0, 2:4].round(3).tolist()  # of the two faces of a side
        [20000.0, 20000.0]
        """

    def measure(self, poses: ArrayLike | Poses) -> Measured:
        """Result of `observe`, or the sample counts behind it where those are cheaper."""
        return self._measure(self._accept(poses))

    def _measure(self, poses: Poses) -> Measured:
        """`measure` of poses that it accepts."""
        return self.observe(poses)

    @abstractmethod
    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`; a second `close` does nothing.

        Calls running in other threads complete normally.
        """

    def _accept(self, poses: ArrayLike | Poses, n_bytes: float = OBSERVED) -> Poses:
        """Poses that this observer can measure, with room for what it finds of each face."""
        if not self._is_open:
            raise DeviceError("expected an open observer, got a closed one; open a new one")
        accepted = Poses.of(poses)
        accepted.check_cameras(len(cameras_of(self.camera)))
        check_memory(
            f"figures of {len(accepted):,} poses x {self.mesh.n_faces:,} faces",
            int(n_bytes * len(accepted) * self.mesh.n_faces),
            "observe fewer poses at a time",
        )
        return accepted


class SampledObserver(Observer):
    """Observer that counts samples of a rasteriser, whose options it takes."""

    def __init__(
        self, mesh: Mesh, camera: Cameras, judging: int | None = None, /, **options: object
    ) -> None:
        self.threads, self.mesh, self.camera = thread_count(judging), mesh, camera
        self._supersample = options.get("supersample", 1)
        self._open(options)

    def _open(self, options: ReadByName) -> None:
        self._rasterizers = Rasterizers(self.mesh, cameras_of(self.camera), roll=ROLL, **options)
        self.info = self._rasterizers.info

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas from the counts of samples, see `Observer`."""
        return Observation.of_counts(self._measure(self._accept(poses)))

    def _measure(self, poses: Poses) -> FaceCounts:
        return self._rasterizers.count(poses)

    def why_not_judged(self, poses: Poses, criteria: Sequence[Criteria]) -> str:
        """Reason why the host has to judge what is counted; "" if `judge` can."""
        return self._rasterizers.why_not_judged(poses, criteria)

    def judge(self, poses: ArrayLike | Poses, criteria: Sequence[Criteria]) -> Judged:
        """Faces that poses cover, judged where they are counted.

        `measure` and `FacePass`, whose `criteria` these are, give the same bits.
        """
        return self._rasterizers.judge(self._accept(poses, n_bytes=1 / 8), criteria)

    def fall_back(self) -> None:
        """Count on the CPU from now on, in place of a device that fails."""
        with suppress(DeviceError):
            self._rasterizers.close()
        own = {"threads": self.threads, "supersample": self._supersample}
        self._open({"backend": "cpu", **own})

    def close(self) -> None:
        """Release the memory."""
        self._rasterizers.close()  # refuses in a thread that may not, and all stays open
        self._is_open = False


class ExactObserver(Observer):
    """Observer that computes areas by half planes, all of them or where no proof decides."""

    def __init__(self, solvers: ExactPass) -> None:
        self.mesh, self.camera, method = solvers.mesh, solvers.camera, solvers.method
        renderer = f"{method}, rastercov {rastercov.__version__}"
        self.info = RasterizerInfo("analytic", method, renderer, "", "cpu", "float64", "")
        self._pass, self.threads = solvers, solvers.threads

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Exact or certified areas, see `Observer`."""
        return self._measure(self._accept(poses))

    def _measure(self, poses: Poses) -> Observation:
        seen = room_for(len(poses), self.mesh.n_faces)
        self._pass.observe(poses, seen)
        return seen

    def close(self) -> None:
        """Release the memory."""
        self._is_open = False
        self._pass.close()


def open_observer(
    mesh: Mesh,
    camera: Cameras,
    method: str | Engine = "certified",
    *,
    threads: int | None = None,
) -> Observer:
    """Observer of a mesh through a camera, or several; use it in a `with` block.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera, Rig or sequence of Camera
        For several, `Poses.camera` has the index of the camera of each pose.
    method : {"certified", "exact", "sampled"}, or Engine
        "certified" proves most faces visible or hidden, and computes the others; "exact" computes
        every face, several times slower, as a check; "sampled" counts samples in the image, with a
        statistical bound. Or an `Engine`, or its text form, such as "sampled:cpu@4".
    threads : int, optional
        Number of threads on the CPU; that of the engine, or one per core, unless given.

    Raises
    ------
    ConfigError
        For an unknown method.
    DeviceError
        When the device of method "sampled" cannot be opened.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> with rc.open_observer(mesh, camera, "exact", threads=1) as observer:
    ...     seen = observer.observe(rc.sphere_of_poses((0, 0, 0), distance=0.7, count=3))
    >>> seen.visible_pixels.shape
    (3, 12)
    """
    check_scene(mesh, camera)
    engine = Engine.of(method, threads)
    if engine.method == "sampled":
        options = engine.rasterizer_options | {"supersample": engine.supersample}
        return SampledObserver(mesh, camera, engine.threads, **options)
    return ExactObserver(ExactPass(mesh, camera, engine))
