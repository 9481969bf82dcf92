"""Visible fraction of each face, (3.13) and (3.14), with an error bound.

Every figure is (value, bound, kind): the true visible fraction lies within `bound` of `value`, in
the sense that `kind` names. There are three methods:

certified
    Patches of faces that no edge crosses are seen whole or not at all, which is proved; the faces
    that are crossed are computed. See `contour`. Needs no rasteriser.
exact
    Every face is computed, see `analytic`: the same answers several times slower, to check with.
sampled
    Two counts of a rasteriser are divided. The bound is statistical,

        b = min(1, (3 * 0.27 * sqrt(1.25 L + 1) + L / 20) / N),

    with N the samples the face would own alone and L its perimeter in sample spacings: the
    classical error of counting lattice points in a shape, and a part for edges that happen to run
    along a row of samples, whose error grows with their length.

D. G. Kendall. On the Number of Lattice Points Inside a Random Oval. 1948, for the square-root law.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from importlib.metadata import version
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import check_scene
from rastercov._checks import finite_number, shown
from rastercov._closing import Closing
from rastercov._memory import check_memory
from rastercov._threads import ScratchPool, share_poses, thread_count
from rastercov.camera import Camera
from rastercov.criteria import FaceGeometry, face_geometry
from rastercov.engine import METHODS, Engine
from rastercov.errors import ConfigError, DeviceError
from rastercov.mesh import Mesh
from rastercov.near_plane import limits
from rastercov.pose import Poses, valid_poses
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import FaceCounts, RasterizerInfo

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

ROLL = 0.4
"""Radians by which the grid of samples is turned against the image: 23 degrees, far from every
direction that is common in manufactured parts. Along rows of samples errors of counting add up."""
EPSILON = 2.0**-52
"""Rounding of a quotient."""


class Kind(IntEnum):
    """Meaning of the bound of a figure."""

    STATISTICAL = 0
    """Counted; the bound holds for all but one in a thousand faces that are seen in part."""
    CERTIFIED = 1
    """Proved to be exactly 0 or 1."""
    EXACT = 2
    """Computed; the bound is rounding."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Areas that an observer measured, of faces seen from behind too.

    Attributes
    ----------
    visible_pixels, drawn_pixels : (P, F) float64
        px^2 of the face's image inside the image border: what is seen of it, from either side, and
        what would be were it alone.
    kind : (P, F) uint8
        `Kind` of each visible fraction.
    clipped : (P,) bool
        Whether the near plane cut away a surface in view.
    samples : int
        Samples a px^2 where they were counted.
    blur : (P, F) float64
        Bound of the errors of both areas together where they were computed, px^2.
    """

    visible_pixels: FloatArray
    drawn_pixels: FloatArray
    kind: NDArray[np.uint8]
    blur: FloatArray
    clipped: BoolArray
    samples: int = 1

    @classmethod
    def of_counts(cls, counts: FaceCounts) -> Self:
        """Observation of a rasteriser's counts, `drawn` included."""
        kind = np.full(counts.visible.shape, Kind.STATISTICAL, np.uint8)
        areas = counts.visible_pixels, counts.drawn_pixels
        blur = np.broadcast_to(0.0, kind.shape)
        return cls(*areas, kind, blur, counts.clipped, counts.supersample**2)


@dataclass(frozen=True, eq=False)
class Visibility:
    """Visible fraction of each face in each pose.

    Attributes
    ----------
    value : (P, F) float64
        1 - occlusion, in [0, 1]; of the part inside the image. 0 for faces seen from behind, and
        for faces whose image rounds to nothing or owns no sample (`bound` is 1 there: nothing is
        known).
    bound : (P, F) float64
        Largest error of `value`.
    kind : (P, F) uint8
        `Kind` of each figure.
    info : RasterizerInfo
        What computed or counted.
    """

    value: FloatArray
    bound: FloatArray
    kind: NDArray[np.uint8]
    info: RasterizerInfo


class Observer(Protocol):
    """Areas of one mesh that one camera sees; open it with `open_observer`, use it in a `with`.

    Any number of threads may use one observer at once, but for method "sampled" on OpenGL: that
    one belongs to the thread that opened it, and says so in any other.
    """

    mesh: Mesh
    camera: Camera
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
    camera: Camera,
    method: str | Engine = "certified",
    *,
    backend: str = "auto",
    supersample: int = 1,
    **options: Any,
) -> Observer:
    """Observer of a mesh through a camera; use it in a `with` block.

    Parameters
    ----------
    mesh, camera
        Scene and camera.
    method : {"certified", "exact", "sampled"}, or Engine
        Method, see this module; or an `Engine` or its text form, such as "sampled:cpu@4", which
        then replaces the other arguments.
    backend, supersample, **options
        As for `open_rasterizer`, for method "sampled". The others take `threads`, and no
        `supersample`: they have no samples.

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
        elif engine.threads is not None:
            options = options | {"threads": engine.threads}
    if engine.method == "sampled":
        return _SampledObserver(mesh, camera, backend, supersample, options)
    if finite_number(supersample) != 1:
        raise ConfigError(
            f"method {engine.method} has no samples, so supersample must be 1, "
            f"got {shown(supersample)}; use method sampled"
        )
    unknown = options.keys() - {"threads"}
    if unknown:
        raise ConfigError(f"method {engine.method} takes no option {', '.join(sorted(unknown))}")
    return _AnalyticObserver(mesh, camera, engine.method, options.get("threads"))


def visibility(
    mesh: Mesh,
    camera: Camera,
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
        Scene and camera.
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
    _check_visibility(len(accepted), mesh.n_faces)
    with open_observer(
        mesh, camera, method, backend=backend, supersample=supersample, **options
    ) as observer:
        return observer.visibility(accepted)


def visible_fraction(
    geometry: FaceGeometry, seen: Observation, row: int
) -> tuple[FloatArray, FloatArray, NDArray[np.uint8]]:
    """Visible fraction (3.14) of each face in one pose: value, bound and kind, (F,) each.

    Where samples were counted, `visible / drawn` is exactly 1 for a face that nothing hides and
    exactly 0 for a hidden one, whatever the resolution: both counts come from the same samples.
    """
    drawn, kind = seen.drawn_pixels[row], seen.kind[row]
    has_image = drawn > 0
    value = np.divide(seen.visible_pixels[row], drawn, out=np.zeros(len(drawn)), where=has_image)
    # Nothing is known of a face whose image rounds to nothing, or that owns no sample.
    bound = np.where(has_image, 0.0, 1.0)
    computed = (kind == Kind.EXACT) & has_image
    # |v/d - v'/d'| <= (|v - v'| + |d - d'|) / d, with d the true area
    blur, least = seen.blur[row][computed], (drawn - seen.blur[row])[computed]
    bound[computed] = np.divide(blur, least, out=np.ones(len(blur)), where=least > 0) + EPSILON
    counted = (kind == Kind.STATISTICAL) & has_image
    length = geometry.perimeter[counted] * np.sqrt(seen.samples)
    deviation = 3 * 0.27 * np.sqrt(1.25 * length + 1) + length / 20
    bound[counted] = deviation / (drawn[counted] * seen.samples)
    # A face seen from behind is not seen, by definition, and one outside the image neither.
    nothing = ~geometry.is_front | ((geometry.in_view_fraction == 0) & ~geometry.in_view)
    value[nothing], bound[nothing] = 0.0, 0.0
    return value, np.minimum(bound, 1.0), np.where(nothing, Kind.EXACT, kind).astype(np.uint8)


class _Observer(Closing):
    """An observer that is open until it is closed."""

    mesh: Mesh
    camera: Camera
    info: RasterizerInfo
    _is_open = True

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        raise NotImplementedError

    def visibility(self, poses: ArrayLike | Poses) -> Visibility:
        """Visible fraction of each face in each pose; see `Observer.visibility`."""
        accepted = Poses.of(poses)
        _check_visibility(len(accepted), self.mesh.n_faces)
        seen = self.observe(accepted)
        shape = seen.kind.shape
        value, bound, kind = np.empty(shape), np.empty(shape), np.empty(shape, np.uint8)
        for row, pose in enumerate(accepted.world_from_camera):  # 1 ms for 10k faces
            geometry = face_geometry(self.mesh, self.camera, pose)
            value[row], bound[row], kind[row] = visible_fraction(geometry, seen, row)
        return Visibility(value, bound, kind, self.info)

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceError("this observer is closed; open a new one")

    def _check_memory(self, n_poses: int) -> None:
        """Raise `ResourceError` where an `Observation` of so many poses takes too much memory."""
        areas_and_kind = 3 * 8 + 1
        _check_figures(n_poses, self.mesh.n_faces, areas_and_kind)


def _check_visibility(n_poses: int, n_faces: int) -> None:
    """Raise `ResourceError` where an `Observation` and a `Visibility` take too much memory."""
    _check_figures(n_poses, n_faces, 25 + 17)


def _check_figures(n_poses: int, n_faces: int, bytes_a_pair: int) -> None:
    check_memory(
        f"figures of {n_poses:,} poses x {n_faces:,} faces",
        bytes_a_pair * n_poses * n_faces,
        "observe fewer poses at a time",
    )


class _SampledObserver(_Observer):
    def __init__(
        self, mesh: Mesh, camera: Camera, backend: str, supersample: int, options: dict[str, Any]
    ) -> None:
        self._rasterizer = open_rasterizer(
            mesh, camera, backend, supersample=supersample, roll=ROLL, **options
        )
        self.mesh, self.camera, self.info = mesh, camera, self._rasterizer.info

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        self._check_open()
        if isinstance(poses, np.ndarray) and poses.ndim == 3:  # few lists are as long as that
            self._check_memory(len(poses))
        return Observation.of_counts(self._rasterizer.count(poses))

    def close(self) -> None:
        self._rasterizer.close()  # refuses in a thread that may not, and all stays open
        self._is_open = False


class _AnalyticObserver(_Observer):
    def __init__(self, mesh: Mesh, camera: Camera, method: str, threads: int | None) -> None:
        # These compile, or load what was compiled.
        from rastercov.exact import certificate as contour
        from rastercov.exact import half_planes as analytic
        from rastercov.exact.surface import surface_of

        contour.compile_once()
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
        self._threads = thread_count(threads)
        view_type = contour.CertifiedView if method == "certified" else analytic.View
        make = partial(view_type, surface_of(mesh), camera)
        self._scratch: ScratchPool[analytic.View] = ScratchPool(make, self._threads)

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        self._check_open()
        matrices = valid_poses(poses)
        n_poses, n_faces = len(matrices), self.mesh.n_faces
        self._check_memory(n_poses)
        near, front_only, clipped = limits(self.mesh, self.camera, matrices)
        visible, area, blur = np.empty((3, n_poses, n_faces))
        kind = np.full((n_poses, n_faces), Kind.EXACT, np.uint8)

        def worker(view: Any) -> Any:
            def work(turn: slice) -> None:
                for row in range(n_poses)[turn]:
                    view.look(matrices[row], near[row], front_only[row])
                    view.measure_all()
                    visible[row], area[row], blur[row] = view.visible, view.area, view.blur
                    kind[row][view.is_certified] = Kind.CERTIFIED

            return work

        views = self._scratch.take(max(1, min(self._threads, n_poses)))
        share_poses(n_poses, [worker(view) for view in views])
        self._scratch.give_back(views)
        return Observation(visible, area, kind, blur, clipped)

    def close(self) -> None:
        self._is_open = False
        self._scratch.close()


figures = visible_fraction
