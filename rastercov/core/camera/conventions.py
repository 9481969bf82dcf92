"""Conventions that a file leaves open, and the border where a file's values become ours.

A reader hands over what the file has. `Border` turns axes, direction, pixel centre and unit of it
into those of this package, once; where the file does not say, it asks for the option that answers,
and refuses without it. Motions of quaternions and rotation vectors are here, too, and lenses of one
camera in the models of several programs: writers ask here in which of `models.PROGRAMS` that their
format has a camera can be expressed without loss, and what no format keeps.

Pose files: `.npy` or JSON of (P, 4, 4), or `{"world_from_camera": [...], "camera": [...]}`.

`camera`, the name of the camera of each pose, may be left out.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    ByName,
    CameraError,
    ConfigError,
    FloatArray,
    MeshError,
    PoseError,
    ResourceError,
    StrPath,
    UnknownNames,
    UnreadableError,
    check_choice,
    cos,
    errors_as,
    finite_number,
    flag,
    image_side,
    matmul,
    members,
    norm,
    one_line,
    printable,
    read_json,
    shown,
    sin,
    suffix_of,
)
from rastercov.base.arguments import two
from rastercov.base.files import LARGEST_ARRAY, open_file, write_file
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.models import MODELS, PROGRAMS, coefficients_by_name, lens_of_parameters
from rastercov.core.camera.pose import (
    DRIFT_TOLERANCE,
    Poses,
    as_matrices,
    real_numbers,
    valid_poses,
)
from rastercov.core.camera.rig import Rig, Views
from rastercov.core.mesh import files
from rastercov.core.mesh.arrays import (
    inverse,
    matrices_of,
    nearest_rotations,
    rotations_of_quaternions,
)

POSE_CONVENTIONS = {
    "opencv": (False, False),
    "opengl": (True, False),
    "camera-from-world": (False, True),
    "opengl-camera-from-world": (True, True),
}
"""Conventions of bare matrices: camera axes of OpenGL (y up, looking along -z), and whether the
matrix is camera_from_world. "opencv" is ours."""
LENS_MODELS = ("brown", "fisheye")
OPENGL_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL camera axes (x right, y up, z backward) from ours, and the reverse."""
DRIFT_OF_FILES = 1e-3
"""A rotation of a file further than this from orthonormal is refused: a file in float32 or with
six digits is within 1e-5."""


@dataclass(frozen=True, kw_only=True)
class Conventions:
    """Conventions that a camera or pose file does not state; None where not given.

    Parameters
    ----------
    pixel_centre : float, optional
        Coordinate of the centre of the top-left pixel in the file: 0 or 0.5.
    lens_model : str, optional
        "brown" or "fisheye", for four coefficients of OpenCV.
    pose_unit : str or float, optional
        Unit of lengths in the file: "m", "mm", ..., or metres per unit.
    image_size : (int, int), optional
        Width and height, px.
    pose_convention : str, optional
        Convention of bare matrices: "opencv" (default), "opengl", "camera-from-world" or
        "opengl-camera-from-world".
    original_world : bool
        Undo `applied_transform` of a transforms.json, so that poses are in the world of the
        program that it was made from.
    skip_bad_poses : bool
        Leave out poses that are not rigid transforms.

    Raises
    ------
    ConfigError
        For an invalid value.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=600, count=3)  # of a file in mm
    >>> views = rc.Views(rc.Rig([camera], ["cam"]), rc.Poses.of(poses), ("a", "b", "c"))
    >>> _ = rc.write_views("model", views, format="colmap")
    >>> views = rc.read_views("model", conventions=rc.Conventions(pose_unit="mm"))
    >>> np.linalg.norm(views.poses.world_from_camera[0, :3, 3]).round(6).item()  # metres
    0.6
    """

    pixel_centre: float | None = None
    lens_model: str | None = None
    pose_unit: str | float | None = None
    image_size: tuple[int, int] | None = None
    pose_convention: str | None = None
    original_world: bool = False
    skip_bad_poses: bool = False

    def __post_init__(self) -> None:
        if self.pixel_centre is not None and finite_number(self.pixel_centre) not in (0, 0.5):
            raise ConfigError(
                f"expected pixel centre to be 0 or 0.5, got {shown(self.pixel_centre)}"
            )
        for name, words in (("lens_model", LENS_MODELS), ("pose_convention", POSE_CONVENTIONS)):
            if (given := getattr(self, name)) is not None:
                check_choice(name.replace("_", " "), given, tuple(words))
        if self.pose_unit is not None:
            metres_per(self.pose_unit)
        for name in ("original_world", "skip_bad_poses"):
            object.__setattr__(self, name, flag(name, getattr(self, name)))
        if self.image_size is not None:
            with errors_as(ConfigError, caught=CameraError):
                width, height = two("image size", self.image_size)
                size = image_side("image width", width), image_side("image height", height)
            object.__setattr__(self, "image_size", size)


def metres_per(unit: str | float) -> float:
    """Metres in one `unit`, a name or a positive number; ConfigError for anything else."""
    with errors_as(ConfigError, caught=MeshError):
        return files.metres_per(unit)


MOST_OFF_MIDDLE, MOST_OFF_FACTOR = 0.25, 0.1
"""Distance of a principal point from the middle, by the side of the image, and its difference from
that of another size, by that, up to which it is usual."""
LIKELY_FACTORS = np.unique([n / d for n in range(1, 13) for d in range(1, 5)])
"""Sides of the image of a calibration by those of the one that is given."""


class Border:
    """Conversion of one file: answers to what it leaves open, and notes about what was done.

    Attributes
    ----------
    notes : dict of str
        Notes for the user, in order.
    unknown : UnknownNames
        Names that the formats of the files do not have.
    drift : float
        Largest |s^2 - 1|, of singular values s, of a rotation that is made orthonormal: no element
        of R^T R - I, in any axes, is larger.
    """

    drift = DRIFT_OF_FILES
    is_part = False
    """True for a camera of which the file says that it is cropped."""

    def __init__(self, given: Conventions) -> None:
        self._given = given
        self._asked = {"skip_bad_poses"}
        self.notes: dict[str, None] = {}
        self.unknown = UnknownNames(CameraError)

    def note(self, text: str) -> None:
        """Add a line, once."""
        self.notes[text] = None

    def _answer(self, name: str, question: str = "") -> Any:
        """Answer of that name; the question is the error where there must be one."""
        self._asked.add(name)
        answer = getattr(self._given, name)
        if answer is None and question:
            raise CameraError(question)
        return answer

    def image_size(
        self, what: str = "the file", default: tuple[int, int] | None = None
    ) -> tuple[int, int]:
        """Width and height, where the file has none, unless another file has a default."""
        question = f"expected an image size, got none in {what}; give --image-size WIDTHxHEIGHT"
        if default is None:
            return self._answer("image_size", question)
        return self._answer("image_size") or default

    def pixel_shift(self, what: str = "the file") -> float:
        """Pixels to add to image coordinates, where the file does not say what they start from."""
        question = (
            f"expected the origin of pixels, got none in {what}; give --pixel-centre 0 for the "
            "centre of the top-left pixel, as in OpenCV, or 0.5 for its corner"
        )
        return 0.5 - float(self._answer("pixel_centre", question))

    def is_fisheye(self, what: str) -> bool:
        """True for a fisheye, where four coefficients may be either."""
        question = (
            f"expected a lens model for {what}, got none; give --lens-model brown (k1 k2 p1 "
            "p2) or fisheye (k1 k2 k3 k4)"
        )
        return bool(self._answer("lens_model", question) == "fisheye")

    def metres(self, default: float | None = None) -> float | None:
        """Metres in the unit of lengths that was given, where the file may have another one."""
        unit = self._answer("pose_unit")
        return default if unit is None else metres_per(unit)

    def undoes_world(self) -> bool:
        """True where the transform that a file says was applied to its world is to be undone."""
        return bool(self._answer("original_world"))

    def of_convention(self, matrices: FloatArray) -> FloatArray:
        """world_from_camera of matrices in a file that does not state their convention."""
        return in_convention(matrices, self._answer("pose_convention") or "opencv")

    def views(
        self,
        cameras: Sequence[Camera] | None,
        names: Sequence[str] | None = None,
        *,
        world_from_camera: ArrayLike = (),
        camera: ArrayLike | None = None,
        images: Sequence[str] | None = None,
        frames: Sequence[str] = (),
        rig_from_camera: ArrayLike | None = None,
        metres: float | None = None,
    ) -> Views:
        """Views in metres, of what a reader has found.

        Parameters
        ----------
        cameras : sequence of Camera, or None
            The cameras; None for a file of poses alone.
        names : sequence of str, optional
            Their names; numbers are added where two are the same.
        world_from_camera : (P, 4, 4)
            In our axes, and in the file's unit.
        camera : (P,) int, optional
            Index of the camera of each pose.
        images : sequence of str, optional
            Names of the images; "camera 1", ... unless given.
        frames : sequence of str
            Name of the frame of each pose, where the file has frames.
        rig_from_camera : (N, 4, 4), optional
            Places of the cameras.
        metres : float, optional
            Metres in the file's unit; None where the file does not say, and `pose_unit`
            is asked.
        """
        matrices = np.asarray(world_from_camera, np.float64).reshape(-1, 4, 4)
        has_lengths = len(matrices) > 0 or rig_from_camera is not None
        if metres is None and has_lengths:
            metres = self.metres()
        factor = 1.0 if metres is None else metres
        rigid, skip_bad = self._rigid(matrices, factor), self._given.skip_bad_poses
        try:
            poses = Poses.of(rigid, camera=camera, skip_bad=skip_bad)
        except PoseError as error:
            if images is None or not error.pose_ids:
                raise
            name = shown(printable(images[error.pose_ids[0]]))
            raise PoseError(f"image {name}: {error}", error.pose_ids) from None
        rig, places = None, None
        if rig_from_camera is not None:
            given = np.asarray(rig_from_camera, np.float64).reshape(-1, 4, 4)
            places = self._rigid(given, factor)
        if cameras is not None:
            known = unique_names(names or [""] * len(cameras))
            for name, each in zip(known, () if self.is_part else cameras, strict=False):
                self.notes |= dict.fromkeys(centre_warning(name, each))
            try:
                rig = Rig(cameras, known, places)
            except PoseError as error:
                camera_at = shown(known[error.pose_ids[0]]) if error.pose_ids else "a camera"
                raise PoseError(f"rig_from_camera of {camera_at}: {error}") from None
        if images is None:
            images = [f"camera {row + 1}" for row in range(len(matrices))]
        names_of_frames = _apart(frames)
        return Views(
            rig=rig,
            poses=poses,
            images=tuple(printable(images[row]) for row in poses.ids),
            notes=(*self.notes, *self.unknown.notes()),
            has_unit=metres is not None or not has_lengths,
            frames=tuple(names_of_frames[row] for row in poses.ids) if frames else (),
        )

    def views_of_rig(
        self,
        cameras: Sequence[Camera],
        names: Sequence[str],
        places: FloatArray,
        frame: str,
        metres: float | None = 1.0,
    ) -> Views:
        """Views of cameras at their places (N, 4, 4) in a frame, whose name is noted."""
        self.note(f"poses are in the frame of {frame}")
        return self.views(
            cameras,
            names,
            world_from_camera=places,
            camera=range(len(cameras)),
            images=names,
            rig_from_camera=places,
            metres=metres,
        )

    def views_of_images(
        self, cameras: Sequence[Camera], images: Sequence[str], **others: Any
    ) -> Views:
        """Views of images with the camera of each, which may be the same; `others` as `views`."""
        row_of = {camera: row for row, camera in enumerate(dict.fromkeys(cameras))}
        index = [row_of[camera] for camera in cameras]
        return self.views(list(row_of), camera=index, images=images, **others)

    def _rigid(self, matrices: FloatArray, factor: float) -> FloatArray:
        """Matrices with lengths times `factor`; rotations that a file has in few digits repaired.

        Others are left as they came, for `Poses` to name.
        """
        out = matrices.copy()
        rotation = out[:, :3, :3]
        with np.errstate(all="ignore"):
            out[:, :3, 3] *= factor
            drift = np.abs(matmul(rotation.transpose(0, 2, 1), rotation) - np.eye(3)).max(
                axis=(1, 2), initial=0
            )
        rows = np.flatnonzero((drift > DRIFT_TOLERANCE) & (drift <= self.drift))
        stretch = np.linalg.svd(rotation[rows], compute_uv=False)
        off = np.abs(stretch**2 - 1).max(axis=1, initial=0)  # the same of its inverse and products
        near = off <= self.drift
        if near.any():
            out[rows[near], :3, :3] = nearest_rotations(rotation[rows[near]])
            self.note(f"rotations made orthonormal, off by up to {off[near].max():.1g}")
        return out

    def unused_keys(self) -> list[str]:
        """A line for each answer that nothing in the files asked for."""
        return [
            f"--{field.name.replace('_', '-')} was not used: the file states or does not need it"
            for field in fields(self._given)
            if getattr(self._given, field.name) not in (None, False)
            and field.name not in self._asked
        ]


def centre_warning(name: str, camera: Camera) -> list[str]:
    """A line on a principal point far from the middle, as of a calibration for another size."""
    size, centre = np.array((camera.width, camera.height)), np.array((camera.cx, camera.cy))
    if camera.is_parallel or (np.abs(centre / size - 0.5) <= MOST_OFF_MIDDLE).all():
        return []
    factors = 2 * centre / size
    likely = LIKELY_FACTORS[np.abs(LIKELY_FACTORS - factors.mean()).argmin()]
    if np.abs(factors / likely - 1).max() < MOST_OFF_FACTOR:
        factors = np.array((likely, likely))
    other = " x ".join(f"{side:.0f}" for side in factors * size)
    question = f"is it of {other}, or cropped" if (centre > 0).all() else "is it of another size"
    where = "outside" if ((centre < 0) | (centre > size)).any() else "far from the middle of"
    at = ", ".join(f"{x:.6g}" for x in centre)
    return [
        f"the principal point of {name}, ({at}), is {where} its image of {camera.width} x "
        f"{camera.height} px: {question}?"
    ]


def in_convention(matrices: FloatArray, name: str) -> FloatArray:
    """world_from_camera of matrices in one of `POSE_CONVENTIONS`."""
    has_opengl_axes, is_inverse = POSE_CONVENTIONS[name]
    inverse = inverse_of(matrices) if is_inverse else matrices
    return matmul(inverse, OPENGL_AXES) if has_opengl_axes else inverse


def inverse_of(matrices: FloatArray) -> FloatArray:
    """Inverse of motions whose rotation may have drifted.

    What is no motion stays none, for the check of `Poses` to name it: the transpose of a matrix is
    as far from orthonormal as the matrix, and the last row is kept.
    """
    result = inverse(matrices)
    result[:, 3] = matrices[:, 3]
    return result


def share_frames(texts: Sequence[str | None], images: Sequence[Any]) -> list[str]:
    """Frame of each image, its own where it has none; no frames where no two images share one."""
    known = [name for name in texts if name is not None]
    if len(set(known)) == len(known):
        return []
    return [name or f"image {image}" for name, image in zip(texts, images, strict=True)]


def _apart(frames: Sequence[str]) -> list[str]:
    """Printable names, as different from one another as those of the file."""
    names = list(dict.fromkeys(frames))
    printed = dict(zip(names, unique_names(names, "frame"), strict=True))
    return [printed[frame] for frame in frames]


def unique_names(names: Sequence[str], what: str = "camera") -> list[str]:
    """Printable names, none of them empty or twice: " #2" is appended to the second."""
    table: dict[str, None] = {}
    repeats: dict[str, int] = {}
    for row, given in enumerate(names):
        name = base = printable(given) or f"{what} {row + 1}"
        while name in table:
            repeats[base] = repeats.get(base, 1) + 1
            name = f"{base} #{repeats[base]}"
        table[name] = None
    return list(table)


def from_quaternions(wxyz: ArrayLike, translation: ArrayLike) -> FloatArray:
    """(N, 4, 4) motions of unit quaternions (N, 4), scalar first, and of translations (N, 3).

    A rotation R of a quaternion of length l further than `DRIFT_TOLERANCE` from 1 has
    R^T R = l I, so that it is made orthonormal or refused as other rotations are; NaN for 0.
    """
    q = np.asarray(wxyz, np.float64).reshape(-1, 4)
    with np.errstate(all="ignore"):
        largest = np.abs(q).max(axis=1, keepdims=True)  # no square overflows
        length = norm(q / largest)[..., None]
        turns = rotations_of_quaternions(np.roll(q / largest / length, -1, axis=1))
        length = (length * largest)[:, :, None]
        turns *= np.where(np.abs(length - 1) > DRIFT_TOLERANCE, np.sqrt(length), 1.0)
    return motions(turns, translation)


def from_vectors(vectors: ArrayLike, translation: ArrayLike) -> FloatArray:
    """(N, 4, 4) motions of rotation vectors (N, 3), radians about their direction, and (N, 3)."""
    v = np.asarray(vectors, np.float64).reshape(-1, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        angle = norm(v)[..., None]
        half = angle / 2
        # sin(a / 2) / a, which is 1/2 at 0.
        factor = np.where(angle > 1e-9, sin(half) / np.where(angle > 0, angle, 1), 0.5)
        return from_quaternions(np.concatenate([cos(half), factor * v], axis=1), translation)


def motions(rotations: ArrayLike, translation: ArrayLike) -> FloatArray:
    """(N, 4, 4) of rotations (N, 3, 3) and translations (N, 3)."""
    r = np.asarray(rotations, np.float64).reshape(-1, 3, 3)
    return matrices_of(r, np.asarray(translation, np.float64).reshape(-1, 3))


def lens_camera(ours: str, size: Sequence[int], p: Mapping[str, float]) -> Camera:
    """Camera of a model of ours with parameters by name.

    They are f, or fx and fy; cx and cy, the middle if left out; skew; and the coefficients of the
    lens, 0 where they are left out. Metashape's p1 and p2 are taken for those of its model.
    """
    if ours == "metashape" and not p["k4"]:
        ours, p = "opencv", {**p, "p1": p["p2"], "p2": p["p1"]}
    model, distortion = lens_of_parameters(ours, p)
    fields: ByName = {name: p[name] for name in ("cx", "cy", "skew") if name in p}
    fields |= {name: p[name] if name in p else p["f"] for name in ("fx", "fy")}
    return Camera(width=size[0], height=size[1], **fields, model=model, distortion=distortion)


def centre_camera(ours: str, size: Sequence[int], p: Mapping[str, float]) -> Camera:
    """`lens_camera` of a file that counts pixels from their centres."""
    return lens_camera(ours, size, {**p, "cx": p["cx"] + 0.5, "cy": p["cy"] + 0.5})


def forms_of(camera: Camera) -> dict[str, dict[str, float]]:
    """Coefficients of a camera by name, in each of our models that is its lens."""
    own, names = coefficients_by_name(camera.model, camera.distortion), ("k1", "k2", "k3", "k4")
    forms, its = {camera.model: own}, MODELS[camera.model]
    if its.base == "equidistant" and not any(own[name] for name in own if name not in names):
        forms["opencv_fisheye"] = {name: own.get(name, 0.0) for name in names}
    if camera.model in ("pinhole", "opencv"):
        brown = {name: own.get(name, 0.0) for name in MODELS["opencv"].coefficients.split()}
        forms["opencv"] = brown
        if not any(list(brown.values())[5:]):  # its k4 is another one
            forms["metashape"] = brown | {"p1": brown["p2"], "p2": brown["p1"]}
    return forms


def model_in(program: str, camera: Camera, label: str = "") -> tuple[str, dict[str, float]]:
    """Name of a model of a program, not of square pixels, that is the lens of a camera.

    With it, values of its parameters by name. CameraError where there is none, or no skew; `label`
    is the name of the camera.
    """
    has_skew = camera.skew != 0 and program != "opencv"  # whose matrix has it
    forms = {} if has_skew else forms_of(camera)
    central = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    if is_whole_panorama(camera):
        central |= {"w": float(camera.width), "h": float(camera.height)}
    for ours in sorted(forms, key=["opencv", "opencv_fisheye", *MODELS].index):
        for name, foreign in PROGRAMS[program].items():
            wanted, c = foreign.parameters.split(), forms[ours]
            held = foreign.ours == ours and all(key in wanted for key in c if c[key])
            if held and "f" not in wanted and ("w" in central or "w" not in wanted):
                return name, {key: (central | c).get(key, 0.0) for key in wanted}
    beside = "skew" if has_skew else "other coefficients"
    text = f"expected a lens of {program}, got {camera.model} with {beside}; undistort the images"
    raise CameraError(f"{label}: {text}" if label else text)


def panorama(width: int, height: int) -> Camera:
    """Equirectangular image of all directions."""
    return Camera(
        width=width,
        height=height,
        fx=width / (2 * math.pi),
        fy=height / math.pi,
        model="equirectangular",
    )


def is_whole_panorama(camera: Camera) -> bool:
    """True for an equirectangular image of all directions around the middle."""
    whole = panorama(camera.width, camera.height)
    return (
        camera.model == whole.model
        and not camera.skew
        and math.isclose(camera.fx, whole.fx, rel_tol=1e-9)
        and math.isclose(camera.fy, whole.fy, rel_tol=1e-9)
        and (camera.cx, camera.cy) == (whole.cx, whole.cy)
    )


def what_is_lost(camera: Camera) -> list[str]:
    """Fields that are set and that no format but our own keeps, such as the aperture."""
    fields = ("focal_length", "pixel_size", "aperture", "focus_distance", "focus_range")
    items = [name for name in (*fields, "max_angle_deg") if getattr(camera, name) is not None]
    items += ["near"] if camera.near else []
    return items + (["max_blur"] if camera.max_blur != 1.0 else [])


def yaml_matrix(name: str, matrix: FloatArray, tag: str = "", *others: str) -> list[str]:
    """Lines of a matrix in YAML; numbers with a point, which OpenCV takes for real ones."""
    words = ", ".join(repr(float(value)) for value in matrix.ravel())
    rows, cols = matrix.shape
    entries = [f"rows: {rows}", f"cols: {cols}", *others, f"data: [{words}]"]
    return [f"{name}:{tag}", *(f"  {entry}" for entry in entries)]


def read_poses(path: StrPath) -> FloatArray:
    """Poses of a file, not checked to be rigid transforms.

    The file is `.npy` of (P, 4, 4), or `.json`: a list of matrices, or
    `{"world_from_camera": [...]}`.

    Returns
    -------
    (P, 4, 4) float64

    Raises
    ------
    PoseError
        For a file that cannot be read or holds something else.
    ResourceError
        For more poses than fit in memory.

    Examples
    --------
    >>> import rastercov as rc
    >>> rc.write_poses("poses.npy", rc.sphere_of_poses((0, 0, 0), distance=1, count=3))
    >>> rc.read_poses("poses.npy").shape
    (3, 4, 4)
    """
    try:
        array = read_npy(path) if _is_npy(path) else _read_json(path)
        return as_matrices(array[None] if array.shape == (4, 4) else array)
    except MemoryError:
        raise ResourceError(
            f"{printable(str(path))}: expected poses that fit in memory, got more; split the file"
        ) from None
    except (UnreadableError, PoseError) as error:
        raise PoseError(f"{printable(str(path))}: {error}") from None


def _is_npy(path: StrPath) -> bool:
    """True for a file of numpy, False for one of JSON, by its name; PoseError for another."""
    suffix = suffix_of(path)
    if suffix not in (".npy", ".json"):
        raise PoseError(
            f"expected a pose file .npy or .json, got {shown(suffix)}; rename or convert it"
        )
    return suffix == ".npy"


def read_npy(path: StrPath) -> AnyArray:
    """Array of real numbers of a `.npy` file, in any shape."""
    # Not np.load, which opens a zip archive or a pickle whatever its name.
    with open_file(path, LARGEST_ARRAY) as file:
        try:
            array: AnyArray = np.lib.format.read_array(file, allow_pickle=False)
        except (OSError, MemoryError):
            raise
        except Exception as error:  # the parser lets a dozen kinds through
            raise PoseError(f"expected a NumPy array, got: {one_line(error)}") from None
    if array.dtype.kind not in "iuf":
        raise PoseError(f"expected poses to be real numbers, got {array.dtype}")
    return array


def _read_json(path: StrPath) -> AnyArray:
    content = read_json(path, LARGEST_ARRAY)
    if isinstance(content, list) and content:
        return real_numbers("poses", content, "(P, 4, 4)")
    if not isinstance(content, dict) or "world_from_camera" not in content:
        raise PoseError(
            'expected {"world_from_camera": [4 x 4, ...]}, got other entries; correct the file'
        )
    return real_numbers("poses", content["world_from_camera"], "(P, 4, 4)")


def write_poses(path: StrPath, poses: ArrayLike, camera: Sequence[str] | None = None) -> None:
    """Write poses as `.npy` or `.json`; `read_poses` restores them bit for bit.

    Parameters
    ----------
    path : str or Path
        File to write.
    poses : (P, 4, 4) array_like
        world_from_camera.
    camera : sequence of str, optional
        Name of the camera of each pose, for JSON; `read_views` reads it.

    Raises
    ------
    PoseError
        For invalid poses, a wrong number of names, any names for a `.npy` file, and a file that
        cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=1, count=3)
    >>> rc.write_poses("poses.json", poses)
    >>> bool(np.allclose(rc.read_poses("poses.json"), poses))
    True
    """
    array = valid_poses(poses)
    content: ByName = {"world_from_camera": array.tolist()}
    if camera is not None:
        content["camera"] = members("camera", camera, str, "the name of each camera", PoseError)
        if len(content["camera"]) != len(array) or not all(content["camera"]):
            raise PoseError(
                f"expected camera to have a name for each of {len(array)} poses, got "
                f"{shown(camera)}"
            )
    with errors_as(PoseError, printable(str(path)), ValueError):
        is_npy = _is_npy(path)
        if camera is not None and is_npy:
            raise PoseError("expected a .json file for names of cameras, got .npy; rename it")
        with write_file(path) as file:
            if is_npy:
                np.save(file, array)
            else:
                file.write((json.dumps(content) + "\n").encode())
