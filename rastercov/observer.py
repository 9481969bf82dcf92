"""How much of each face a camera sees, (3.13) and (3.14), and how far that figure may be off.

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

from rastercov._arguments import check_choice, check_scene
from rastercov._checks import finite_number, shown
from rastercov._closing import Closing
from rastercov._memory import check_memory
from rastercov._threads import ScratchPool, share_poses, thread_count
from rastercov.camera import Camera
from rastercov.criteria import ViewOfFaces, view_faces
from rastercov.errors import ConfigError, DeviceError
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.raster.contract import FaceCounts, RasterizerInfo, open_rasterizer
from rastercov.raster.rules import limits

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

METHODS = ("certified", "exact", "sampled")
ROLL = 0.4
"""Radians by which the grid of samples is turned against the image: 23 degrees, far from every
direction that is common in manufactured parts. Along rows of samples errors of counting add up."""
EPSILON = 2.0**-52
"""Rounding of a quotient."""


class Kind(IntEnum):
    """What the bound of a figure means."""

    STATISTICAL = 0
    """Counted; the bound holds for all but one in a thousand faces that are seen in part."""
    CERTIFIED = 1
    """Proved to be exactly 0 or 1."""
    EXACT = 2
    """Computed; the bound is rounding."""


@dataclass(frozen=True, eq=False)
class Observation:
    """What an observer measured, before faces seen from behind are ruled out.

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
        """What a rasteriser counted, `drawn` included."""
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

    def observe(self, poses: ArrayLike) -> Observation:
        """Measure every face in each pose.

        Parameters
        ----------
        poses : (P, 4, 4) or (4, 4) array_like
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
    method: str = "certified",
    *,
    backend: str = "auto",
    supersample: int = 1,
    **options: Any,
) -> Observer:
    """Observer of a mesh through a camera.

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    method : {"certified", "exact", "sampled"}
        See this module.
    backend, supersample, **options
        As for `open_rasterizer`, for method "sampled". The others take `threads`, and no
        `supersample`: they have no samples.

    Raises
    ------
    ConfigError
        For a method or an option that does not exist.
    """
    check_scene(mesh, camera)
    check_choice("method", method, METHODS)
    if method == "sampled":
        return _SampledObserver(mesh, camera, backend, supersample, options)
    if finite_number(supersample) != 1:
        raise ConfigError(
            f"method {method} has no samples, so supersample must be 1, got {shown(supersample)}; "
            "use method sampled"
        )
    unknown = options.keys() - {"threads"}
    if unknown:
        raise ConfigError(f"method {method} takes no option {', '.join(sorted(unknown))}")
    return _AnalyticObserver(mesh, camera, method, options.get("threads"))


def visibility(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    method: str = "certified",
    *,
    backend: str = "auto",
    supersample: int = 1,
    **options: Any,
) -> Visibility:
    """Visible fraction of each face in each pose, with a bound.

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    poses : (P, 4, 4) array_like
        world_from_camera.
    method, backend, supersample, **options
        As for `open_observer`.

    Raises
    ------
    ResourceError
        Where the arrays take more memory than is free, before any is taken.
    """
    check_scene(mesh, camera)
    matrices = valid_poses(poses)
    observed_and_returned = 25 + 17
    _check_figures(len(matrices), mesh.n_faces, observed_and_returned)
    with open_observer(
        mesh, camera, method, backend=backend, supersample=supersample, **options
    ) as observer:
        seen = observer.observe(matrices)
    shape = seen.kind.shape
    value, bound, kind = np.empty(shape), np.empty(shape), np.empty(shape, np.uint8)
    for row, pose in enumerate(matrices):  # a millisecond for 10k faces
        value[row], bound[row], kind[row] = figures(view_faces(mesh, camera, pose), seen, row)
    return Visibility(value, bound, kind, observer.info)


def figures(
    view: ViewOfFaces, seen: Observation, row: int
) -> tuple[FloatArray, FloatArray, NDArray[np.uint8]]:
    """Visible fractions of one pose of an observation: value, bound and kind, (F,) each.

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
    length = view.perimeter[counted] * np.sqrt(seen.samples)
    deviation = 3 * 0.27 * np.sqrt(1.25 * length + 1) + length / 20
    bound[counted] = deviation / (drawn[counted] * seen.samples)
    # A face seen from behind is not seen, by definition, and one outside the image neither.
    nothing = ~view.is_front | ((view.in_view_fraction == 0) & ~view.in_view)
    value[nothing], bound[nothing] = 0.0, 0.0
    return value, np.minimum(bound, 1.0), np.where(nothing, Kind.EXACT, kind).astype(np.uint8)


class _Observer(Closing):
    """An observer that is open until it is closed."""

    mesh: Mesh
    camera: Camera
    info: RasterizerInfo
    _is_open = True

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceError("this observer is closed; open a new one")

    def _check_memory(self, n_poses: int) -> None:
        """Raise `ResourceError` where an `Observation` of so many poses takes too much memory."""
        areas_and_kind = 3 * 8 + 1
        _check_figures(n_poses, self.mesh.n_faces, areas_and_kind)


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

    def observe(self, poses: ArrayLike) -> Observation:
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
        view_type = contour.CertificateSolver if method == "certified" else analytic.HalfPlaneSolver
        make = partial(view_type, surface_of(mesh), camera)
        self._scratch: ScratchPool[analytic.HalfPlaneSolver] = ScratchPool(make, self._threads)

    def observe(self, poses: ArrayLike) -> Observation:
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
                    view.set_pose(matrices[row], near[row], front_only[row])
                    view.solve_all()
                    visible[row], area[row], blur[row] = view.visible, view.area, view.area_error
                    kind[row][view.is_certified] = Kind.CERTIFIED

            return work

        views = self._scratch.take(max(1, min(self._threads, n_poses)))
        share_poses(n_poses, [worker(view) for view in views])
        self._scratch.give_back(views)
        return Observation(visible, area, kind, blur, clipped)

    def close(self) -> None:
        self._is_open = False
        self._scratch.close()
