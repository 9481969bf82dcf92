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

from typing import Any, Protocol, Self

from numpy.typing import ArrayLike

from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, check_scene
from rastercov.coverage.engine import METHODS, Engine
from rastercov.coverage.observers import ExactObserver, SampledObserver, check_visibility
from rastercov.mesh import Mesh
from rastercov.raster.contract import RasterizerInfo
from rastercov.raster.observation import Observation, Visibility


class Observer(Protocol):
    """Areas of one mesh that one camera sees; open it with `open_observer`, use it in a `with`.

    Any number of threads may use one observer at once, except method "sampled" on OpenGL: that
    one belongs to the thread that opened it, and says so in any other.
    """

    mesh: Mesh
    camera: Cameras
    info: RasterizerInfo

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
        ...

    def visibility(self, poses: ArrayLike | Poses) -> Visibility:
        """Visible fraction of each face in each pose, with a bound; errors as for `observe`."""
        ...

    def close(self) -> None:
        """Give back what it holds: later calls raise `DeviceError`; again it does nothing.

        A call that another thread is in ends as ever.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...


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
    engine = Engine.of(method)
    if method not in METHODS:
        if backend != "auto" or supersample != 1 or options.keys() & {"threads", "device"}:
            raise ConfigError(
                f"engine {engine} has its device, samples and threads; leave out the arguments "
                "backend, device, supersample and threads"
            )
        supersample = engine.supersample
        if engine.method == "sampled":
            options = engine.rasterizer_options | options
            backend = options.pop("backend")
        if engine.threads is not None:
            options = options | {"threads": engine.threads}
    if engine.method == "sampled":
        return SampledObserver(mesh, camera, backend, supersample, options)
    if finite_number(supersample) != 1:
        raise ConfigError(
            f"method {engine.method} has no samples, so supersample must be 1, "
            f"got {shown(supersample)}; use method sampled"
        )
    unknown = options.keys() - {"threads"}
    if unknown:
        raise ConfigError(f"method {engine.method} takes no option {', '.join(sorted(unknown))}")
    return ExactObserver(mesh, camera, engine.method, options.get("threads"))


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
    check_visibility(len(accepted), mesh.n_faces)
    with open_observer(
        mesh, camera, method, backend=backend, supersample=supersample, **options
    ) as observer:
        return observer.visibility(accepted)
