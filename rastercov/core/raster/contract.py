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

Covered pairs of pose and face as bits, with the covered area of each pose.

A million poses of 10,000 faces take 1.25 GB. Areas are sums of integers, which do not depend on
their order: any device and any number of threads gives the same bits.

Areas of each face in the image, visible fractions (3.14) and their bounds.

Every fraction is (value, bound, kind): the true one lies within `bound` of `value`, in the sense
that `kind` names. Where samples were counted the bound is statistical,

    b = min(1, (3 * 0.27 * sqrt(1.25 L + 1) + L / 20) / N),

with N the samples the face would own alone and L its perimeter in sample spacings: the classical
error of counting lattice points in a shape, and a term for edges along a row of samples, whose
error grows with their length.

D. G. Kendall. On the Number of Lattice Points Inside a Random Oval. 1948, for the square-root law.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    TINY,
    AnyArray,
    BoolArray,
    ByteArray,
    Closing,
    ConfigError,
    DeviceError,
    Float32Array,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    ResourceError,
    StrPath,
    check_kind,
    check_memory,
    flag,
    frozen_record,
    once_each,
    read_json,
    read_only,
    shown,
)
from rastercov.core.camera import Camera, valid_poses
from rastercov.core.mesh import Mesh
from rastercov.core.raster.targets import CountArray, TargetFaces
from rastercov.engine.coverage_network import as_bytes

COVERED = "covered"
"""Name of the bits among the fields of `evaluate`."""
UNITS = 1 << 44
"""Units of area in the evaluated area of a mesh."""
PACKED, AREAS, VIEWS, HEADER = "packed.npy", "area_units.npy", "views.npy", "bits.json"
"""Files of a folder of bits."""
WORD = 8
"""Bytes of a word: rows are whole words."""


@once_each
def whole_area(mesh: Mesh) -> float:
    """Evaluated area, m^2, as one correctly rounded sum."""
    return max(math.fsum(mesh.areas[mesh.task_mask].tolist()), TINY)


def unit_of(mesh: Mesh) -> float:
    """Square metres of a unit of area."""
    return whole_area(mesh) / UNITS


@once_each
def area_units(mesh: Mesh) -> IntArray:
    """(F,) area of each face in units of 2^-44 of `whole_area`, rounded; 0 if it is not evaluated.

    The area of covered faces is the sum of their units, whatever the order.
    """
    share = np.where(mesh.task_mask, mesh.areas, 0.0) / whole_area(mesh)
    return read_only(np.rint(share * UNITS), np.int64)


def room_for_bits(n_poses: int, n_faces: int) -> ByteArray:
    """Memory (P, 8 W) of the bits of poses, all 0, in W words of 64 bits."""
    return np.zeros((n_poses, -(-n_faces // (8 * WORD)) * WORD), np.uint8)


@frozen_record(repr=False)
class CoverageBits(InOneLine):
    """Faces that each pose covers, one bit each: the pairs with `Reason.COVERED`.

    Attributes
    ----------
    packed : (P, ceil(F / 8)) uint8
        Face f is bit `f % 8`, the lowest first, of byte `f // 8`; bits beyond the last face are 0.
        A view of rows of whole 64-bit words.
    area_units : (P,) int64
        Covered area of each pose, in units of 2^-44 of the evaluated area. The area of each face is
        rounded to such units before it is added, so that sums do not depend on their order.
    views : (F,) int64
        Number of poses that cover each face.
    unit : float
        Square metres of a unit.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.look_at([(0.6, 0, 0), (0, 0, 0.6)], (0, 0, 0))
    >>> bits = rc.evaluate(mesh, camera, poses, method="sampled", fields=("covered",)).bits
    >>> bits.packed.tolist(), bits.areas.round(4).tolist()  # m^2
    ([[12, 0], [0, 12]], [0.04, 0.04])
    >>> bits.dense()[0].nonzero()[0].tolist()
    [2, 3]
    >>> int(np.unpackbits(bits.packed, axis=1, count=12, bitorder="little").sum())
    4
    """

    packed: ByteArray
    area_units: IntArray
    views: IntArray
    unit: float

    @classmethod
    def open(cls, folder: StrPath) -> Self:
        """Bits that `rastercov evaluate --bits` left in a folder; `packed` is mapped, not read.

        ConfigError where there are none.
        """
        try:
            unit = read_json(Path(folder) / HEADER)["unit_m2"]
            packed, areas, views = (
                np.load(Path(folder) / name, "r") for name in (PACKED, AREAS, VIEWS)
            )
            return cls(packed, areas, views, unit)
        except (OSError, ValueError, KeyError) as error:
            where = shown(str(folder))
            raise ConfigError(
                f"{where}: expected bits of evaluate --bits, got none ({error}); make them"
            ) from None

    @property
    def areas(self) -> FloatArray:
        """(P,) covered area of each pose, m^2."""
        return self.area_units * np.float64(self.unit)

    def dense(self, poses: slice = slice(None)) -> BoolArray:
        """(P, F) mask of the pairs of some poses; eight times as large."""
        check_kind("poses", poses, slice, "a slice", ConfigError)
        octets = self.packed[poses]
        return np.unpackbits(octets, axis=1, count=len(self.views), bitorder="little").view(
            np.bool_
        )


Judged = tuple[CoverageBits, BoolArray]
"""Faces that each pose covers by `Rasterizer._judge`, and `FaceCounts.clipped`."""


@frozen_record
class Criteria:
    """Thresholds, and facts of faces, by which a pose covers a face that was counted.

    Attributes
    ----------
    rules : mapping of str to float
        Thresholds of a task for a camera: `Rules` of `rastercov.core.coverage.task`, by name.
    may_be_covered : (F,) bool
        Faces that meet the criteria of the surface itself.
    """

    rules: Mapping[str, float]
    may_be_covered: BoolArray


def add_bits(whole: CoverageBits, batch: CoverageBits, rows: slice | IntArray) -> None:
    """Put the bits of a batch in some rows of all, and add its views."""
    whole.packed[rows] = batch.packed
    whole.area_units[rows] = batch.area_units
    whole.views[:] += batch.views


def bits_of_first(whole: CoverageBits, n: int) -> CoverageBits:
    """Bits of the first n poses, in which all views are."""
    return replace(whole, packed=whole.packed[:n], area_units=whole.area_units[:n])


def bits_of(mesh: Mesh, packed: ByteArray, area_units: IntArray, views: IntArray) -> CoverageBits:
    """Bits of a mesh; further bytes of rows, as of `room_for_bits`, are left out."""
    octets = packed[:, : -(-mesh.n_faces // 8)]
    return CoverageBits(octets, area_units, views, unit_of(mesh))


def bits_of_pairs(mesh: Mesh, covers: BoolArray) -> CoverageBits:
    """Bits of a mask (P, F)."""
    octets = np.packbits(covers, axis=1, bitorder="little")
    return bits_of(mesh, octets, covers @ area_units(mesh), covers.sum(axis=0))


def no_bits(mesh: Mesh, n_poses: int) -> CoverageBits:
    """Bits of poses before any is added, all 0."""
    areas, views = np.zeros(n_poses, np.int64), np.zeros(mesh.n_faces, np.int64)
    return bits_of(mesh, room_for_bits(n_poses, mesh.n_faces), areas, views)


BACKENDS = ("auto", "cpu", "gl")
"""Devices by which rasterisers may be chosen."""
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


def as_small(counts: AnyArray) -> AnyArray:
    """A copy of counts, in fewer bytes where they hold them."""
    small = np.empty(counts.shape, np.uint8)
    if as_bytes(counts, small):
        return small
    return counts.astype(np.uint16 if counts.max() < 1 << 16 else counts.dtype)


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


class BoundKind(IntEnum):
    """Kind of an error bound: STATISTICAL (samples), CERTIFIED (no error) or EXACT (rounding).

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> observation = rc.visibility(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> [rc.BoundKind(kind).name for kind in sorted(set(observation.kind.ravel().tolist()))]
    ['CERTIFIED', 'EXACT']
    """

    STATISTICAL = 0
    """Counted; the bound holds for 99.9 % of the partly visible faces."""
    CERTIFIED = 1
    """Proved to be exactly 0 or 1."""
    EXACT = 2
    """Computed; the bound is rounding."""


KIND_WORDS = {"certified": "proved", "exact": "computed", "statistical": "sampled"}
"""Words for the values of each kind, the most certain first."""


@frozen_record(repr=False)
class Observation(InOneLine):
    """Image areas of each face in each pose, also of back-facing faces; see `Observer.observe`.

    Attributes
    ----------
    visible_pixels, drawn_pixels : (P, F) float64
        Area of the face inside the image that is visible, and that would be without occlusion,
        px^2, whichever side the camera is on.
    kind : (P, F) uint8
        `rastercov.BoundKind` of each visible fraction.
    clipped : (P,) bool
        True where the near plane cuts away a surface in view.
    samples_per_pixel : int
        Samples per px^2 if areas were counted by samples; 1 otherwise.
    area_error : (P, F) float64
        Bound of the errors of both areas together, px^2, if they were computed; 0 otherwise.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     seen = observer.observe(rc.look_at((0.7, 0, 0), (0, 0, 0)))
    >>> round(seen.visible_pixels.sum())  # 200 x 200 pixels: 600 px x 0.2 m / 0.6 m
    40000
    """

    visible_pixels: FloatArray
    drawn_pixels: FloatArray
    kind: ByteArray
    area_error: FloatArray
    clipped: BoolArray
    samples_per_pixel: int = 1

    @classmethod
    def of_counts(cls, counts: FaceCounts) -> Self:
        """Observation of a rasteriser's counts, `drawn` included."""
        kind = np.full(counts.visible.shape, BoundKind.STATISTICAL, np.uint8)
        areas = counts.visible_pixels, counts.drawn_pixels
        area_error = np.broadcast_to(0.0, kind.shape)
        return cls(*areas, kind, area_error, counts.clipped, counts.supersample**2)
