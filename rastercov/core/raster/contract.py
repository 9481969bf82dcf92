"""Contract of every rasteriser, and the results it returns.

A rasteriser takes a mesh and a camera once and many poses after that. It answers with counts per
face (`FaceCounts`), or for one pose with the image they were counted on (`VisibilityBuffer`).

The promise: samples sit at pixel centres, or on a regular S x S grid in each pixel, or on a grid as
dense that is rolled about the image centre; a sample on an edge shared by two faces belongs to
exactly one of them; faces are cut at the near plane, not dropped; depth is compared in float32 or
better; of two surfaces at equal depth the face with the lower index wins. Targets hide nothing,
and what is at their depth does not hide them (`rastercov.core.raster.targets`).

A CPU rasteriser may be used from several threads at once. An OpenGL rasteriser belongs to the
thread that opened it, and raises `DeviceError` in any other.
"""

from abc import abstractmethod
from dataclasses import dataclass, replace

from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    Closing,
    ConfigError,
    DeviceError,
    Float32Array,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    ResourceError,
    check_memory,
    flag,
    frozen_record,
)
from rastercov.core.camera import Camera, valid_poses
from rastercov.core.mesh import Mesh
from rastercov.core.raster.bits import Criteria, Judged
from rastercov.core.raster.targets import CountArray, TargetFaces

MAX_SUPERSAMPLE = 64
"""Largest S: beyond it the exact methods are both cheaper and better."""
MAX_RENDERED = 1 << 31
"""Most pixels of a `VisibilityBuffer`, 16 GiB. Counts have no such limit."""


@dataclass(frozen=True)
class RasterizerInfo:
    """Method and device that measured a result: kept with it, because drivers differ.

    Attributes
    ----------
    backend : str
        `"gl"` or `"cpu"` for rasterisers; `"analytic"` for methods certified and exact.
    plan : str
        `"threads"` on the CPU; on OpenGL `"pipeline"` or `"compute"` (without the graphics
        pipeline); the method if the backend is `"analytic"`.
    renderer, driver, device : str
        The device's own names.
    depth : str
        Type of the depth values, such as `"float32 reversed"`.
    shaders : str
        SHA-256 of the shader sources; empty without shaders.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
    >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
    ...     info = rasterizer.info
    >>> info.backend, info.plan
    ('cpu', 'threads')
    """

    backend: str
    plan: str
    renderer: str
    driver: str
    device: str
    depth: str
    shaders: str


@frozen_record(repr=False)
class FaceCounts(InOneLine):
    """Number of samples of each face in each pose; see `Rasterizer.count`.

    Attributes
    ----------
    visible : (P, F) int32
        Samples where the face is the nearest surface, or an unoccluded target; int64 where an image
        has 2^31 or more.
    drawn : (P, F) int32 or None
        Samples the face would own if it were alone in the scene, inside the image, from either
        side; None when not requested.
    background : (P,) int64
        Samples that hit nothing or only targets, or for which the lens model has no ray; with the
        visible samples of all other faces they add up to all samples inside the image.
    clipped : (P,) bool
        True where the near plane cuts away a surface, not a target, inside the viewing pyramid.
    supersample : int
        S; a pixel holds S^2 samples.
    info : RasterizerInfo
        Device that counted.
    roll : float
        Rotation of the sample grid relative to the image, radians.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
    >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
    ...     counts = rasterizer.count(rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> counts.visible.shape, int((counts.visible > 0).sum())  # a side has two faces
    ((1, 12), 2)
    >>> int(counts.visible.sum() + counts.background.sum()) == 64 * 48
    True
    """

    visible: CountArray
    drawn: CountArray | None
    background: IntArray
    clipped: BoolArray
    supersample: int
    info: RasterizerInfo
    roll: float = 0.0

    @property
    def visible_pixels(self) -> FloatArray:
        """`visible` as an area in px^2, (P, F)."""
        return self.visible / self.supersample**2

    @property
    def drawn_pixels(self) -> FloatArray:
        """`drawn` as an area in px^2, (P, F); ConfigError if it was not counted."""
        if self.drawn is None:
            raise ConfigError(
                "expected drawn to be counted, got no counts; use count(poses, drawn=True)"
            )
        return self.drawn / self.supersample**2


@frozen_record(repr=False)
class VisibilityBuffer(InOneLine):
    """Image of face indices and depths in one pose; see `Rasterizer.render`.

    Attributes
    ----------
    face : (H, W) int32
        Index of the nearest face at each pixel centre, never of a target; -1 where there is none.
    depth : (H, W) float32
        Camera z of that surface in metres, inf where there is none. For a lens too wide for one
        ideal plane (`rastercov.core.camera.lenses.planes`), the distance along the ray.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
    >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
    ...     picture = rasterizer.render(rc.look_at((0.7, 0, 0), (0, 0, 0))[0])
    >>> picture.face.shape, int((picture.face >= 0).sum())
    ((48, 64), 400)
    >>> round(float(picture.depth.min()), 4)  # metres
    0.6
    """

    face: Int32Array
    depth: Float32Array


class Rasterizer(Closing):
    """Counts and images of one mesh through one camera; open it with `open_rasterizer`.

    Use it in a `with` block.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
    >>> with rc.open_rasterizer(mesh, camera, "cpu", supersample=2) as rasterizer:
    ...     counts = rasterizer.count(rc.look_at((0.7, 0, 0), (0, 0, 0)))
    >>> float(counts.visible_pixels.sum())
    400.0
    """

    info: RasterizerInfo
    _threads = 1

    def __init__(self, mesh: Mesh, camera: Camera, supersample: int, roll: float) -> None:
        self.mesh, self.camera, self.supersample, self.roll = mesh, camera, supersample, roll
        self._targets = TargetFaces.of(mesh)
        self._is_open = True

    def count(self, poses: ArrayLike, *, drawn: bool = True) -> FaceCounts:
        """Number of samples of each face in each pose.

        Parameters
        ----------
        poses : (P, 4, 4) or (4, 4) array_like
            world_from_camera.
        drawn : bool
            Count `drawn` too, which takes a second pass.

        Raises
        ------
        PoseError
            For a pose that is not a rigid transform, before anything is drawn.
        DeviceError
            When the device fails a check: counts that do not add up, an error, wrong results for a
            known scene; and after `close`.
        ResourceError
            When the counts need more memory than is free; checked before allocation.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
        >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        ...     counts = rasterizer.count(rc.look_at((0.7, 0, 0), (0, 0, 0)), drawn=False)
        >>> int(counts.visible[0].sum()), counts.drawn
        (400, None)
        """
        self._check_open()
        return self._count_faces(valid_poses(poses), flag("drawn", drawn))

    def render(self, pose: ArrayLike) -> VisibilityBuffer:
        """Face index and depth at each pixel centre: one sample per pixel.

        `supersample` and `roll` have no effect.

        Parameters
        ----------
        pose : (4, 4) array_like
            world_from_camera.

        Raises
        ------
        ConfigError
            For several poses.
        PoseError, DeviceError
            As for `count`.
        ResourceError
            For more than 2^31 pixels or too little free memory; checked before
            allocation.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
        >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        ...     picture = rasterizer.render(rc.look_at((0.7, 0, 0), (0, 0, 0))[0])
        >>> int(picture.face[0, 0]), round(float(picture.depth[24, 32]), 4)  # no face; metres
        (-1, 0.6)
        """
        self._check_open()
        poses = valid_poses(pose)
        if len(poses) != 1:
            raise ConfigError(f"expected one pose to render, got {len(poses)}")
        check_picture(self.camera)
        return self._buffer_of(*self._draw_faces(poses))

    def _why_not_judged(self, criteria: Criteria) -> str:
        """Reason why the host has to judge faces from their counts; "" if `_judge` can."""
        self._check_open()
        return f"{self.info.renderer} counts, and judges nothing"

    def _judge(self, poses: FloatArray, criteria: Criteria) -> Judged:
        """Faces that poses, (P, 4, 4), cover; the same bits as by their counts."""
        raise NotImplementedError  # asked where `_why_not_judged` has no reason

    def close(self) -> None:
        """Release the memory of the device: later calls raise `DeviceError`.

        A second `close` does nothing. Calls running in other threads complete normally.
        """
        self._is_open = False

    @abstractmethod
    def _count_faces(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        """Counts of all faces in poses, (P, 4, 4), and of faces alone where `drawn` is true."""

    @abstractmethod
    def _draw_faces(self, poses: FloatArray) -> tuple[Int32Array, Float32Array]:
        """Face of the opaque part and depth at each pixel centre in one pose, (1, 4, 4)."""

    def _buffer_of(self, face: Int32Array, depth: Float32Array) -> VisibilityBuffer:
        """Image by the faces of the mesh, from that by the faces of its opaque part."""
        return VisibilityBuffer(self._targets.face_of(face) if self._targets else face, depth)

    def _result(
        self,
        visible: CountArray,
        drawn: CountArray | None,
        background: IntArray,
        clipped: BoolArray,
    ) -> FaceCounts:
        sampling = self.supersample, self.info, self.roll
        return FaceCounts(visible, drawn, background, clipped, *sampling)

    def _with_targets(self, counts: FaceCounts, visible: IntArray, drawn: IntArray) -> FaceCounts:
        """Counts of the whole mesh from those of its opaque part and of its targets, (P, N)."""
        assert self._targets is not None
        merged, alone = self._targets.merge, counts.drawn
        all_drawn = None if alone is None else merged(alone, drawn)
        return replace(counts, visible=merged(counts.visible, visible), drawn=all_drawn)

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceError("expected an open rasteriser, got a closed one; open another one")


def check_counts(n_poses: int, n_faces: int, bytes_a_pair: int) -> None:
    """Raise `ResourceError` where the counts take too much memory."""
    check_memory(
        f"counts of {n_poses:,} poses x {n_faces:,} faces",
        bytes_a_pair * n_poses * n_faces,
        "count fewer poses at a time",
    )


def check_picture(camera: Camera) -> None:
    """Raise `ResourceError` where a `VisibilityBuffer` of this camera takes too much memory."""
    n_bytes = 8 * camera.width * camera.height
    remedy = "use a smaller camera, such as camera.resized(0.1)"
    if camera.width * camera.height > MAX_RENDERED:
        raise ResourceError(
            f"expected a picture of at most {MAX_RENDERED:,} pixels, got {camera.width:,} x "
            f"{camera.height:,} ({n_bytes / 2**30:,.1f} GiB); {remedy}"
        )
    check_memory(f"{camera.width:,} x {camera.height:,} pixels", n_bytes, remedy)
