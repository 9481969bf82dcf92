"""Calibrations of OpenCV: FileStorage as YAML, XML or JSON, with whatever names the matrices have.

Pixels are counted from their centres. A file may have one camera or several (`M1 D1 M2 D2`), with
`R` and `T` from the first to the second, and the poses of the pattern in each image
(`extrinsic_parameters`, as OpenCV's sample program writes them).

Source: OpenCV 5 documentation, "File Input and Output using XML / YAML / JSON files", "Camera
calibration With OpenCV"; samples/cpp/tutorial_code/calib3d/camera_calibration.
"""

import math
import re
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from rastercov._checks import finite_number, shown
from rastercov.camera import Camera
from rastercov.camera_formats.conventions import Border
from rastercov.camera_formats.equivalents import as_fisheye, as_opencv, opencv_length
from rastercov.camera_formats.rotations import from_vectors, motions
from rastercov.camera_formats.source import Source
from rastercov.errors import CameraError
from rastercov.mesh.formats.xml_tree import local_name
from rastercov.pose import inverse
from rastercov.views import Views

FloatArray = NDArray[np.float64]

SIDES = ("left", "right", "l", "r", "rgb", "color", "depth", "ir")
"""Words of a name that tell cameras apart, beside numbers."""
COEFFICIENT_NAME = re.compile(r"(?i)dist|coef|^d_?[0-9]*$|^kc")
"""Names that distortion coefficients usually have."""
WIDTHS = ("image_width", "imageWidth", "image_Width", "width", "cols", "img_width")
HEIGHTS = ("image_height", "imageHeight", "image_Height", "height", "rows", "img_height")
SIZES = ("image_size", "imageSize", "img_size", "size", "resolution")
MOST_VALUES = 10_000_000
"""Values of a matrix that is looked at."""


def is_mine(content: Any) -> bool:
    """True for a table with a matrix of OpenCV."""
    return isinstance(content, Mapping) and any(_is_matrix(value) for value in content.values())


def _is_matrix(value: Any) -> bool:
    is_one = isinstance(value, Mapping) and {"dt", "data"} <= value.keys()
    return is_one and ({"rows", "cols"} <= value.keys() or "sizes" in value)


def of_xml(root: Element) -> dict[str, Any]:
    """Table of an XML storage, with its values as those of YAML."""
    return {local_name(each): _xml_value(each, 0) for each in root}


def _xml_value(element: Element, depth: int) -> Any:
    if depth > 50:
        raise CameraError("nested deeper than 50")
    text = (element.text or "").strip()
    if len(element):
        if all(local_name(each) == "_" for each in element):
            return [_xml_value(each, depth + 1) for each in element]
        table = {local_name(each): _xml_value(each, depth + 1) for each in element}
        if "data" in table and element.get("type_id", "").startswith("opencv"):
            data = table["data"]
            table["data"] = data if isinstance(data, list) else [data]
        return table
    words = [_number(word) for word in text.split()]
    if words and all(not isinstance(word, str) for word in words):
        return words if len(words) > 1 else words[0]
    return text.strip('"')


def _number(word: str) -> Any:
    try:
        value = float(word if "_" not in word else "x")
    except ValueError:
        return word
    return int(word) if word.lstrip("+-").isdecimal() and len(word) < 20 else value


def read(content: Mapping[str, Any], border: Border) -> Views:
    """Cameras of a storage, and the poses of its images where it has them."""
    found = _arrays(content)
    matrices = {name: value for name, value in found.items() if _is_camera_matrix(value)}
    if not matrices:
        raise CameraError(
            "a camera matrix [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] wanted, got none among "
            f"{', '.join(map(shown, found)) or 'no matrices'}"
        )
    vectors = {
        name: value.ravel()
        for name, value in found.items()
        if 1 in value.shape and value.size in (4, 5, 8, 12, 14)
    }
    labelled = {_label(name): name for name in matrices}
    if len(labelled) < len(matrices):
        raise CameraError(
            f"one camera matrix a camera wanted, got {', '.join(matrices)}; rename those to use "
            "camera_matrix1, camera_matrix2"
        )
    of_label = {_label(name): name for name in vectors}
    cameras, names = [], []
    for label, name in sorted(labelled.items()):
        key = of_label.get(label)
        if key is None and len(matrices) == 1 and len(vectors) == 1:
            key = next(iter(vectors))
        if key is None and vectors:
            raise CameraError(
                f"distortion of {name} wanted, got {', '.join(vectors)}; rename it "
                f"distortion_coefficients{label}"
            )
        if key is None:
            if others := [name for name in content if COEFFICIENT_NAME.search(name)]:
                raise CameraError(
                    f"4, 5, 8, 12 or 14 distortion coefficients wanted, got {others[0]}: "
                    f"{shown(content[others[0]])}; correct it"
                )
            border.note(f"{name} has no distortion coefficients beside it: a pinhole")
        coefficients = vectors[key] if key is not None else np.zeros(0)
        cameras.append(_camera(content, label, matrices[name], coefficients, key, border))
        names.append(f"camera {label}" if label else "camera")
    return _views(content, found, cameras, names, border)


def _arrays(content: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Matrices of numbers by their names; lists of numbers, or of rows, are some as well."""
    found: dict[str, FloatArray] = {}
    for name, value in content.items():
        if _is_matrix(value) or (
            isinstance(value, Mapping) and {"rows", "cols", "data"} <= value.keys()
        ):
            found[name] = _matrix(name, value)
        elif isinstance(value, list) and len(value) <= 100:
            rows = [row if isinstance(row, list) else [row] for row in value]
            if len({len(row) for row in rows}) == 1 and len(rows[0]) <= 100:
                array = np.array([[finite_number(each) for each in row] for row in rows])
                if np.isfinite(array).all():
                    found[name] = array
    return found


def _matrix(name: str, value: Mapping[str, Any]) -> FloatArray:
    rows: Any = value.get("rows")
    cols: Any = value.get("cols")
    data = value["data"]
    sizes = value.get("sizes")  # of a matrix with one dimension, or with three and more
    if isinstance(sizes, int | list) and rows is None:
        sides = sizes if isinstance(sizes, list) else [sizes]
        is_whole = all(isinstance(side, int) and 0 < side <= MOST_VALUES for side in sides)
        rows, cols = (math.prod(sides[1:]), sides[0]) if is_whole and sides else (sizes, None)
    dt = value.get("dt", "d")
    channels = 1
    if isinstance(dt, str) and (match := re.fullmatch(r"([1-4]?)([a-zA-Z])", dt.strip('"'))):
        channels = int(match[1] or 1)
    whole = all(isinstance(each, int) and 0 <= each <= MOST_VALUES for each in (rows, cols))
    wanted = rows * cols * channels if whole else -1
    data = data if isinstance(data, list) else [data] if data is not None else []
    if not 0 <= wanted <= MOST_VALUES or len(data) != wanted:
        raise CameraError(
            f"{name}: {shown(rows)} x {shown(cols)} numbers wanted, got {len(data)}; the file is "
            "truncated or broken, export it again"
        )
    array = np.array([finite_number(each) for each in data]).reshape(rows, cols * channels)
    # Points of the pattern may be anything.
    if array.shape[1] <= 14 and not np.isfinite(array).all():
        raise CameraError(f"{name} must have finite numbers, got {shown(data)}; correct it")
    return array


def _is_camera_matrix(value: FloatArray) -> bool:
    """True for [[fx, s, cx], [0, fy, cy], [0, 0, 1]], unless it is a rotation."""
    if value.shape != (3, 3) or value[1, 0] or not np.array_equal(value[2], (0, 0, 1)):
        return False
    return min(value[0, 0], value[1, 1]) > 0 and not np.allclose(value @ value.T, np.eye(3))


def _label(name: str) -> str:
    """Part of a name that tells cameras apart: "1" of cameraMatrix1, "left" of K_left."""
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+", name)
    return " ".join(w.lower() for w in words if w.isdecimal() or w.lower() in SIDES)


def _camera(
    content: Mapping[str, Any],
    label: str,
    matrix: FloatArray,
    coefficients: FloatArray,
    key: str | None,
    border: Border,
) -> Camera:
    """Camera of a matrix and its coefficients, named `key`."""
    size = _size(content, label)
    width, height = border.image_size() if size is None else size
    fisheye = False
    if len(coefficients) == 4 and coefficients.any():
        fisheye = _is_fisheye(content, border, f"the coefficients in {key}")
    elif _says_fisheye(content) and len(coefficients) not in (0, 4):
        raise CameraError(f"a fisheye has 4 coefficients, got {len(coefficients)}")
    return Camera.from_opencv(matrix, width, height, coefficients.tolist(), fisheye=fisheye)


def _says_fisheye(content: Mapping[str, Any]) -> bool:
    return content.get("fisheye_model") in (1, True) or content.get("fisheye") in (1, True)


def _is_fisheye(content: Mapping[str, Any], border: Border, what: str) -> bool:
    if "fisheye_model" in content or "fisheye" in content:
        return _says_fisheye(content)
    model = str(content.get("distortion_model", content.get("camera_model", ""))).lower()
    if "fisheye" in model or model in ("equidistant", "kannala_brandt"):
        return True
    if model in ("plumb_bob", "radtan", "brown", "pinhole"):
        return False
    return border.is_fisheye(what)


def _size(content: Mapping[str, Any], label: str) -> tuple[Any, Any] | None:
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
    content: Mapping[str, Any],
    found: dict[str, FloatArray],
    cameras: list[Camera],
    names: list[str],
    border: Border,
) -> Views:
    """Views with the poses that a storage may have beside its cameras."""
    rotation, translation = found.get("R"), found.get("T")
    if len(cameras) == 2 and rotation is not None and translation is not None:
        if rotation.shape != (3, 3) or translation.size != 3:
            raise CameraError("R of 3 x 3 and T of 3 numbers wanted, from camera 1 to camera 2")
        second = inverse(motions([rotation], [translation.ravel()]))
        places = np.concatenate([np.eye(4)[None], second])
        border.note("poses are in the frame of the first camera")
        return border.views(
            cameras,
            names,
            world_from_camera=places,
            camera=[0, 1],
            images=names,
            rig_from_camera=places,
        )
    boards = found.get("extrinsic_parameters")
    if boards is not None and boards.shape[1] == 6 and len(cameras) == 1:
        border.note("poses are those of extrinsic_parameters, in the frame of the pattern")
        poses = inverse(from_vectors(boards[:, :3], boards[:, 3:]))
        return border.views(
            cameras,
            names,
            world_from_camera=poses,
            images=[f"view {row}" for row in range(len(poses))],
        )
    return border.views(cameras, names)


def read_source(source: Source, border: Border) -> Views:
    """Cameras of a YAML, XML or JSON storage.

    OpenCV's stereo sample writes the matrices of a pair to `intrinsics.yml` and their places to
    `extrinsics.yml`: the second is read with the first, which lies beside it.
    """
    content = _content(source)
    other = source.path.with_name(source.path.name.replace("extrinsic", "intrinsic"))
    if other.name == source.path.name or _has_camera(content):
        return read(content, border)
    if not other.is_file():
        raise CameraError(
            f"it has places of cameras, and no camera matrix; put {shown(other.name)} beside it, "
            "or both into one file"
        )
    border.note(f"camera matrices are those of {shown(other.name)} beside it")
    return read({**_content(Source(other)), **content}, border)


def _content(source: Source) -> Mapping[str, Any]:
    """Table of a storage."""
    start = source.data[:200].lstrip()
    if start.startswith((b"<", b"\xef\xbb\xbf<")):
        return of_xml(source.xml)
    content = source.json if start.startswith(b"{") else source.yaml
    if not isinstance(content, Mapping):
        raise CameraError(f"a table with a camera matrix wanted, got {shown(content)}")
    return content


def _has_camera(content: Mapping[str, Any]) -> bool:
    """True for a storage with a camera matrix."""
    return any(_is_camera_matrix(value) for value in _arrays(content).values())


def text_of(views: Views) -> str:
    """A YAML storage for one camera; CameraError for a lens that OpenCV has no model for."""
    camera = views.camera()
    values, radial = as_opencv(camera), as_fisheye(camera)
    if values is None and radial is None:
        raise CameraError(
            f"OpenCV has no model for {camera.model} with these coefficients; undistort the "
            "images, or write another format"
        )
    lines = ["%YAML:1.0", "---", f"image_width: {camera.width}", f"image_height: {camera.height}"]
    if values is None:
        assert radial is not None
        lines += ["fisheye_model: 1"]
        values = radial
    else:
        lines += ["fisheye_model: 0"]
        values = values[: opencv_length(values, 5, 8, 12, 14)]
    k = camera.opencv_K
    k[0, 1] = camera.skew
    lines += _block("camera_matrix", k)
    lines += _block("distortion_coefficients", np.array(values)[:, None])
    return "\n".join([*lines, ""])


def _block(name: str, matrix: FloatArray) -> list[str]:
    """Lines of a matrix; numbers with a point, which OpenCV takes for real ones."""
    rows, cols = matrix.shape
    words = ", ".join(repr(float(value)) for value in matrix.ravel())
    return [
        f"{name}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {cols}",
        "   dt: d",
        f"   data: [ {words} ]",
    ]
