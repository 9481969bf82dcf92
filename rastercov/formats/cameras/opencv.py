"""Calibrations of OpenCV: FileStorage as YAML, XML or JSON, with whatever names the matrices have.

Pixels are counted from their centres. A file may have one camera or several (`M1 D1 M2 D2`), with
`R` and `T` from the first to the second, and the poses of the pattern in each image
(`extrinsic_parameters`, as OpenCV's sample program writes them).

Source: OpenCV 5 documentation, "File Input and Output using XML / YAML / JSON files", "Camera
calibration With OpenCV"; samples/cpp/tutorial_code/calib3d/camera_calibration.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import ByName, CameraError, FloatArray, ReadByName, finite_number, matmul, shown
from rastercov.core.camera import Border, Camera, Views, from_vectors, inverse_of, model_in
from rastercov.core.camera.conventions import motions, yaml_matrix
from rastercov.formats.cameras.source import Source, check_ids, keys_of, number_of
from rastercov.formats.meshes.xml_tree import local_name

SIDES = ("left", "right", "l", "r", "rgb", "color", "depth", "ir")
"""Words of a name that tell cameras apart, beside numbers."""
FIRST_AND_SECOND = (("left", "right"), ("l", "r"))
"""Sides whose order is OpenCV's; numbers have one as well."""
COEFFICIENT_WORD = re.compile(r"d|k|kc|dist(?!ance).*|coef.*")
"""Words of the names that distortion coefficients usually have."""
NOT_FINITE = re.compile(r"(^|\s|[+-])\.(nan|inf)\b", re.IGNORECASE)
"""As YAML writes what is no number."""
LENGTHS = (4, 5, 8, 12, 14)
"""Numbers of coefficients of Brown's model; a fisheye has the first."""
WIDTHS = ("image_width", "imageWidth", "image_Width", "width", "cols", "img_width")
HEIGHTS = ("image_height", "imageHeight", "image_Height", "height", "rows", "img_height")
SIZES = ("image_size", "imageSize", "img_size", "size", "resolution")
POSES = ("R", "T", "extrinsic_parameters", "Extrinsic_Parameters")
"""Matrices that say where cameras are."""
OTHERS = (
    *("E", "F", "H", "Q", "R1", "R2", "P", "P1", "P2", "roi1", "roi2", "rvecs", "tvecs"),
    *("image_points", "grid_points", "per_view_reprojection_errors"),
    *("Image_points", "Grid_points", "Per_View_Reprojection_Errors"),
)
"""Matrices that often come beside those of cameras."""
RECTIFIED = ("rectification_matrix", "projection_matrix")
"""Matrices of the rectified image."""


def is_mine(content: object) -> bool:
    """True for a table with a matrix of OpenCV."""
    return isinstance(content, Mapping) and any(_is_matrix(value) for value in content.values())


def _is_matrix(value: object) -> bool:
    names = keys_of(value)
    return {"dt", "data"} <= names and ({"rows", "cols"} <= names or "sizes" in names)


def of_xml(root: Element) -> ByName:
    """Table of an XML storage, with its values as those of YAML."""
    check_ids("name in a table", [local_name(each) for each in root])
    return {local_name(each): _xml_value(each, 0) for each in root}


def _xml_value(element: Element, depth: int) -> Any:
    if depth > 50:
        raise CameraError("expected at most 50 nested elements, got more; flatten the file")
    if len(element):
        if all(local_name(each) == "_" for each in element):
            return [_xml_value(each, depth + 1) for each in element]
        table = {local_name(each): _xml_value(each, depth + 1) for each in element}
        if table.get("data") == "":
            table["data"] = []
        return table
    text = (element.text or "").strip()
    words = [number_of(word) for word in NOT_FINITE.sub(r"\1\2", text).split()]
    if words and all(isinstance(word, float) for word in words):
        return words if len(words) > 1 else words[0]
    return text.strip('"')


def _read(content: ReadByName, border: Border) -> Views:
    """Cameras of a storage, and the poses of its images where it has them."""
    arrays = _arrays(content)
    matrices = {name: value for name, value in arrays.items() if _is_camera_matrix(value)}
    if not matrices:
        raise CameraError(
            "expected a camera matrix [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], or poses as "
            f"world_from_camera, got {', '.join(map(shown, arrays)) or 'neither'}; add or "
            "rename one"
        )
    labelled = {_label(name): name for name in matrices}
    if len(labelled) < len(matrices):
        raise CameraError(
            f"expected one camera matrix per camera, got {', '.join(matrices)}; rename them "
            "camera_matrix1, camera_matrix2"
        )
    known = {*matrices, *POSES, *OTHERS, *SIZES, *RECTIFIED}
    cameras, labels = [], sorted(labelled, key=_order)
    named = [name for name, value in content.items() if _is_of_coefficients(name, value)]
    # A number by itself is none, such as n_coeffs beside D; k1 and k2 alone are not understood.
    named = [name for name in named if isinstance(content[name], Mapping | list)] or named
    of_label: dict[str, list[str]] = {}
    for name in named:
        of_label.setdefault(_label(name), []).append(name)
    for label in labels:
        name = labelled[label]
        own = of_label.get(label) or (named if len(matrices) == 1 else [])
        if len(own) > 1 or (named and not own):
            raise CameraError(
                f"expected one vector of distortion coefficients for {name}, got "
                f"{', '.join(own or named)}; keep one, named distortion_coefficients{label}"
            )
        known.update(own)
        key = _key_of_coefficients(content, arrays, own)
        coefficients = np.zeros(0) if key is None else arrays[key].ravel()
        cameras.append(_camera(content, label, matrices[name], coefficients, key or name, border))
    border.unknown.look("the file", [*arrays], frozenset(known), frozenset(known.difference(POSES)))
    if unneeded := [name for name in RECTIFIED if name in arrays]:
        border.note(f"{', '.join(unneeded)} not needed: the camera is that of the raw image")
    return _views(arrays, cameras, labels, border)


def _order(label: str) -> tuple[bool, int, str]:
    """Numbers by their value, and before words."""
    is_number = label.isdecimal() and len(label) < 20
    return not is_number, int(label) if is_number else 0, label


def _key_of_coefficients(
    content: ReadByName, values_by_key: Mapping[str, FloatArray], own: Sequence[str]
) -> str | None:
    """Name of the coefficients of a camera, of one name or none; None where the file has none.

    Other vectors may have as many numbers, such as the reprojection errors of 12 images: only a
    name like D or distortion_coefficients is taken for one of coefficients.
    """
    if not own:
        nameless = [name for name, value in values_by_key.items() if _is_vector(value, LENGTHS)]
        if nameless:
            raise CameraError(
                f"expected distortion under a name like D or dist, got {nameless[0]}; rename it "
                "distortion_coefficients, or remove it"
            )
        return None
    (key,) = own
    if content[key] in (None, "", []) or (key in values_by_key and not values_by_key[key].size):
        return None  # empty, as OpenCV writes what is not there
    if key not in values_by_key or not _is_vector(values_by_key[key], LENGTHS):
        raise CameraError(
            f"expected 4, 5, 8, 12 or 14 distortion coefficients, got {key}: "
            f"{shown(content[key])}; correct it"
        )
    return key


def _is_of_coefficients(name: str, value: object) -> bool:
    """True for a value that is no text or flag, and a name that coefficients usually have."""
    is_named = any(COEFFICIENT_WORD.fullmatch(word.lower()) for word in _words(name))
    is_matrix = isinstance(value, Mapping | list | int | float) and not isinstance(value, bool)
    return is_named and (is_matrix or value in (None, "")) and not _is_square(value)


def _is_square(value: object) -> bool:
    """True for a matrix of 3 rows, such as K, or `K_dist` of a distorted image."""
    if isinstance(value, Mapping):
        return value.get("rows") == value.get("cols") == 3
    return isinstance(value, list) and len(value) == 3 and isinstance(value[0], list)


def _is_vector(value: FloatArray, lengths: Sequence[int]) -> bool:
    return 1 in value.shape and value.size in lengths


def _arrays(content: ReadByName) -> dict[str, FloatArray]:
    """Matrices of numbers by their names; lists of numbers, or of rows, are some as well."""
    values_by_key: dict[str, FloatArray] = {}
    for name, value in content.items():
        if isinstance(value, Mapping) and (
            _is_matrix(value) or {"rows", "cols", "data"} <= value.keys()
        ):
            values_by_key[name] = _matrix(name, value)
        elif isinstance(value, list) and len(value) <= 100:
            rows = [row if isinstance(row, list) else [row] for row in value]
            if len({len(row) for row in rows}) == 1 and len(rows[0]) <= 100:
                array = np.array([[finite_number(each) for each in row] for row in rows])
                if np.isfinite(array).all():
                    values_by_key[name] = array
    return values_by_key


def _matrix(name: str, value: ReadByName) -> FloatArray:
    if "rows" in value:
        sides = [value["rows"], value.get("cols")]
    else:  # a matrix with one dimension, or with three and more
        first, *others = np.ravel(np.array(value.get("sizes", 0), object)).tolist() or [0]
        sides = [*others, first]
    dt = re.fullmatch(r"([1-4])[a-zA-Z]", str(value.get("dt")).strip('"'))
    channels = int(dt[1]) if dt else 1
    data = value["data"]
    data = data if isinstance(data, list) else [data] if data is not None else []
    count = channels * math.prod(map(finite_number, sides))  # NaN where one is no number
    if count != len(data) or not all(side == int(side) >= 0 for side in sides):
        raise CameraError(
            f"{name}: expected {' x '.join(map(shown, sides))} numbers, got {len(data)}; the file "
            "is truncated, export it again"
        )
    array = np.array([finite_number(each) for each in data])
    array = array.reshape(math.prod(map(int, sides[:-1])), int(sides[-1]) * channels)
    # Points of the pattern may be anything.
    if array.shape[1] <= 14 and not np.isfinite(array).all():
        raise CameraError(f"expected {name} to have finite numbers, got {shown(data)}; correct it")
    return array


def _is_camera_matrix(value: FloatArray) -> bool:
    """True for [[fx, s, cx], [0, fy, cy], [0, 0, 1]], unless it is a rotation."""
    if value.shape != (3, 3) or value[1, 0] or not np.array_equal(value[2], (0, 0, 1)):
        return False
    return min(value[0, 0], value[1, 1]) > 0 and not np.allclose(matmul(value, value.T), np.eye(3))


def _label(name: str) -> str:
    """Part of a name that tells cameras apart: "1" of cameraMatrix1, "left" of K_left."""
    words = _words(name)
    return " ".join(w.lower() for w in words if w.isdecimal() or w.lower() in SIDES)


def _words(name: str) -> list[str]:
    """Words and numbers of a name in any of the usual forms."""
    return re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+", name)


def _camera(
    content: ReadByName,
    label: str,
    matrix: FloatArray,
    coefficients: FloatArray,
    key: str,
    border: Border,
) -> Camera:
    """Camera of a matrix and its coefficients, named `key`; without any, `key` names the matrix."""
    size = _size(content, label)
    width, height = border.image_size() if size is None else size
    count = len(coefficients)
    fisheye = _says_fisheye(content)
    if fisheye and count not in (0, 4):
        raise CameraError(
            f"expected 4 coefficients of a fisheye, got {count} in {key}; correct them"
        )
    if "xi" in content and not fisheye:
        return _omnidirectional(content, matrix, (width, height), coefficients)
    if fisheye is None and count == 4:  # also where all are 0: such a fisheye is no pinhole
        fisheye = border.is_fisheye(f"the coefficients in {key}")
    if not count:
        lens = "a fisheye" if fisheye else "a pinhole"
        border.note(f"{key} has no distortion coefficients: assumed {lens}")
    values = coefficients.tolist() or ([0.0] * 4 if fisheye else [])
    return Camera.from_opencv(matrix, width, height, values, fisheye=bool(fisheye))


def _omnidirectional(
    content: ReadByName,
    matrix: FloatArray,
    size: tuple[Any, Any],
    coefficients: FloatArray,
) -> Camera:
    """Camera of cv2.omnidir, Mei's model: K, xi, and k1 k2 p1 p2."""
    given = content["xi"]
    numbers = _matrix("xi", given).ravel().tolist() if _is_matrix(given) else given
    xi = finite_number(numbers[0] if isinstance(numbers, list) and len(numbers) == 1 else numbers)
    if math.isnan(xi) or len(coefficients) not in (0, 4):
        raise CameraError(
            f"expected a number xi and 4 coefficients of cv2.omnidir, got {shown(given)} and "
            f"{len(coefficients)}; correct them, or remove xi"
        )
    values = (xi, *(coefficients.tolist() or [0.0] * 4))
    return replace(Camera.from_opencv(matrix, *size), model="omni", distortion=values)


def _says_fisheye(content: ReadByName) -> bool | None:
    """True for a fisheye, False for Brown's model, None where the file does not say."""
    for name in ("fisheye_model", "fisheye"):
        flag = content.get(name)
        if flag is not None:
            if flag not in (0, 1):
                raise CameraError(f"expected {name} to be 0 or 1, got {shown(flag)}; correct it")
            return bool(flag)
    model = str(content.get("distortion_model", content.get("camera_model", ""))).lower()
    if model in ("plumb_bob", "radtan", "brown", "pinhole", "rational_polynomial"):
        return False
    return "fisheye" in model or model in ("equidistant", "kannala_brandt") or None


def _size(content: ReadByName, label: str) -> tuple[Any, Any] | None:
    """Width and height, for all cameras or for one."""
    for end in (label, f"_{label}", "") if label else ("",):
        for name in SIZES:
            value = content.get(name + end)
            if isinstance(value, Mapping) and {"width", "height"} <= value.keys():
                return value["width"], value["height"]
            if isinstance(value, Mapping) and isinstance(value.get("data"), list):
                value = value["data"]
            if isinstance(value, list) and len(value) == 2:
                return value[0], value[1]
        for width, height in zip(WIDTHS, HEIGHTS, strict=True):
            if width + end in content and height + end in content:
                return content[width + end], content[height + end]
    return None


def _views(
    values_by_key: dict[str, FloatArray], cameras: list[Camera], labels: list[str], border: Border
) -> Views:
    """Views with the poses that a storage may have beside its cameras."""
    names = [f"camera {label}" if label else "camera" for label in labels]
    rotation, translation = values_by_key.get("R"), values_by_key.get("T")
    # OpenCV 2.4 and 3.0 began the words with capitals.
    boards = values_by_key.get("extrinsic_parameters", values_by_key.get("Extrinsic_Parameters"))
    if len(cameras) == 2 and rotation is not None and translation is not None:
        if tuple(labels) in FIRST_AND_SECOND or all(map(str.isdecimal, labels)):
            if rotation.shape != (3, 3) or translation.size != 3:
                raise CameraError(
                    "expected R of 3 x 3 and T of 3 numbers, got other shapes; correct them"
                )
            second = inverse_of(motions([rotation], [translation.ravel()]))
            places = np.concatenate([np.eye(4)[None], second])
            return border.views_of_rig(cameras, names, places, "the first camera", metres=None)
        border.note(
            "left out R and T, from the first camera to the second: the file does not say "
            f"whether {labels[0]} is the first; rename {labels[0]} and {labels[1]} to 1 and 2"
        )
    elif boards is not None and boards.shape[1] == 6 and len(cameras) == 1:
        border.note("poses are those of extrinsic_parameters, in the frame of the pattern")
        poses = inverse_of(from_vectors(boards[:, :3], boards[:, 3:]))
        images = [f"view {row}" for row in range(len(poses))]
        return border.views(cameras, names, world_from_camera=poses, images=images)
    return border.views(cameras, names)


def read(source: Source, border: Border) -> Views:
    """Cameras of a YAML, XML or JSON storage.

    OpenCV's stereo sample writes the matrices of a pair to `intrinsics.yml` and their places to
    `extrinsics.yml`: the second is read with the first, which lies beside it.
    """
    content = _content(source)
    other = source.path.with_name(source.path.name.replace("extrinsic", "intrinsic"))
    if other.name == source.path.name or any(map(_is_camera_matrix, _arrays(content).values())):
        return _read(content, border)
    if not other.is_file():
        raise CameraError(
            "expected a camera matrix with the poses of cameras, got none; put it and "
            f"{shown(other.name)} into one file or folder"
        )
    border.note(f"camera matrices are those of {shown(other.name)} beside it")
    return _read({**_content(Source(other)), **content}, border)


def _content(source: Source) -> ReadByName:
    """Table of a storage."""
    if source.is_xml:
        return of_xml(source.xml)
    content = source.json if source.text.lstrip().startswith("{") else source.yaml
    if not isinstance(content, Mapping):
        raise CameraError(
            f"expected a table with a camera matrix, got {shown(content)}; name another file"
        )
    return content


def text_of(views: Views) -> str:
    """A YAML storage for one camera; CameraError for a lens that OpenCV has no model for."""
    camera = views.camera()
    model, p = model_in("opencv", camera)
    lines = ["%YAML:1.0", "---", f"image_width: {camera.width}", f"image_height: {camera.height}"]
    lines.append(f"fisheye_model: {int(model == 'fisheye')}")
    k = camera.opencv_K
    k[0, 1] = camera.skew
    lines += yaml_matrix("camera_matrix", k, " !!opencv-matrix", "dt: d")
    coefficients = np.array([*p.values()])[:, None]
    lines += yaml_matrix("distortion_coefficients", coefficients, " !!opencv-matrix", "dt: d")
    return "\n".join([*lines, ""])
