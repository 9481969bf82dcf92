"""CameraInfo of ROS: YAML or .ini of camera_calibration, and messages of `rostopic echo`.

Pixels are counted from their centres, and there are no poses. K and D belong to the raw image,
which is the camera that is read; R and P, of the rectified one, are left out.

Sources: ROS sensor_msgs/CameraInfo; REP 104; camera_calibration_parsers.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rastercov.base import ByName, CameraError, printable
from rastercov.core.camera import Border, Camera, Views, model_in
from rastercov.core.camera.conventions import yaml_matrix
from rastercov.formats.cameras.source import Entries, Source, check_array_of, keys_of, number_of

BROWN = (0, 4, 5, 8, 12, 14)
COUNTS = {
    "": (0,),
    "none": (0,),
    "plumb_bob": BROWN,
    "rational_polynomial": BROWN,
    "thin_prism": (12, 14),
    "equidistant": (4,),
    "fisheye": (4,),
}
"""Numbers of coefficients by distortion_model; ROS hands them to OpenCV, where only it counts."""


HARMLESS = frozenset(
    {"camera_name", "header", "R", "r", "rectification_matrix", "P", "p", "projection_matrix"}
)
KNOWN = HARMLESS | {
    *("image_width", "image_height", "width", "height", "camera_matrix", "K", "k"),
    *("distortion_model", "distortion_coefficients", "D", "d", "binning_x", "binning_y", "roi"),
}
"""Entries of a camera_info."""


def is_mine(content: object) -> bool:
    """True for a camera_info, as a file or as a message."""
    return "distortion_model" in keys_of(content) and bool(
        {"camera_matrix", "K", "k"} & keys_of(content)
    )


INI = re.compile(r"^\s*\[image\]\s*$", re.MULTILINE)
INI_NAMES = {
    "width": "image_width",
    "height": "image_height",
    "camera matrix": "camera_matrix",
    "distortion": "distortion_coefficients",
    "rectification": "rectification_matrix",
    "projection": "projection_matrix",
}
"""Names of an .ini and of camera_info; numbers are in the lines below a name."""


def is_ini(text: str) -> bool:
    """True for an .ini with the section of an image and a camera matrix."""
    return INI.search(text) is not None and "camera matrix" in text


def _of_ini(text: str, border: Border) -> Views:
    """Cameras of the sections of an .ini, each with the size of the image before it."""
    sections = _sections(text, border)
    names, cameras = [], []
    size = next(values for name, values in sections if name == "image")
    for name, values in sections:
        if name == "image":
            size = values
        elif "camera_matrix" in values:
            sides = {side: number[0] for side, number in size.items() if len(number) == 1}
            n = len(values.get("distortion_coefficients", []))
            is_fisheye = n == 4 and border.is_fisheye(f"the distortion of [{name}]")
            model = "fisheye" if is_fisheye else "rational_polynomial"
            own = Entries(sides | values | {"distortion_model": model}, f"[{name}]")
            cameras.append(_camera(own, border))
            names.append(name)
    if not cameras:
        raise CameraError("expected a section with a camera matrix, got none; save it again")
    return border.views(cameras, names)


def _sections(text: str, border: Border) -> list[tuple[str, ByName]]:
    """Names of the sections of an .ini, with lists of the numbers of each entry."""
    sections: list[tuple[str, ByName]] = []
    numbers: list[float | str] = []
    for given in text.splitlines():
        line = re.split("[#;]", given)[0].strip()
        if header := re.fullmatch(r"\[(.*)\]", line):
            sections.append((header[1].strip(), {}))
            numbers = []
        elif sections and (name := INI_NAMES.get(line.lower())):
            if name in sections[-1][1]:
                raise CameraError(f"[{sections[-1][0]}]: expected {line} once, got it twice")
            numbers = sections[-1][1].setdefault(name, [])
        elif line[:1].isalpha():  # translation and rotation of [externals]
            numbers = []
            border.note(f"{printable(line, 40)} is not read")
        else:
            numbers.extend(map(number_of, line.split()))
    return sections


def read(source: Source, border: Border) -> Views:
    """The camera of a camera_info, or the cameras of an .ini."""
    if is_ini(source.text):
        return _of_ini(source.text, border)
    info = Entries(source.table, "camera_info")
    border.unknown.look("camera_info", info.names(), KNOWN, HARMLESS)
    camera = _part(_camera(info, border), info, border)
    return border.views([camera], [info.text("camera_name", "camera") or "camera"])


def _camera(info: Entries, border: Border) -> Camera:
    """Camera of the whole sensor."""
    is_file = "camera_matrix" in info
    width, height = ("image_width", "image_height") if is_file else ("width", "height")
    matrix = _numbers(info, info.any_of("camera_matrix", "K", "k") or "K", 9).reshape(3, 3)
    key = info.any_of("distortion_coefficients", "D", "d")
    model = info.choice("distortion_model", COUNTS, "")
    coefficients = _numbers(info, key, *COUNTS[model]) if key else np.zeros(0)
    is_fisheye = model in ("equidistant", "fisheye")
    if not is_fisheye:
        coefficients = coefficients[: next(n for n in BROWN if not coefficients[n:].any())]
        if model == "plumb_bob" and len(coefficients) > 5:
            border.note(f"plumb_bob with {len(coefficients)} coefficients is rational_polynomial")
    camera = Camera.from_opencv(
        matrix,
        info.side(width),
        info.side(height),
        coefficients.tolist(),
        fisheye=is_fisheye,
    )
    if "projection_matrix" in info or info.any_of("P", "p"):
        border.note(
            "rectification_matrix and projection_matrix are not needed: the camera is that of the "
            "raw image"
        )
    return camera


def _part(camera: Camera, info: Entries, border: Border) -> Camera:
    """Camera of the region of interest, in pixels of the full image, with its pixels binned."""
    x, y, width, height = 0.0, 0.0, camera.width, camera.height
    if "roi" in info and (roi := info.table("roi")).number("width", 0.0):
        x, y = (roi.number(name, 0.0) for name in ("x_offset", "y_offset"))
        width, height = roi.side("width"), roi.side("height")
        if not (0 <= x <= camera.width - width and 0 <= y <= camera.height - height):
            raise info.wrong("roi", f"within {camera.width} x {camera.height} px", info.get("roi"))
    across, down = (max(1.0, info.number(f"binning_{axis}", 0.0)) for axis in "xy")
    part = replace(
        camera,
        width=max(1, int(width // across)),
        height=max(1, int(height // down)),
        fx=camera.fx / across,
        fy=camera.fy / down,
        cx=(camera.cx - x) / across,
        cy=(camera.cy - y) / down,
        skew=camera.skew / across,
    )
    if part != camera:
        border.is_part = True
        border.note(
            f"binning and roi applied: {part.width} x {part.height} px, of {camera.width} x "
            f"{camera.height}"
        )
    return part


def _numbers(info: Entries, name: str, *counts: int) -> Any:
    """Numbers of a list, or of a table with rows, cols and data."""
    value = info.need(name)
    if isinstance(value, Mapping):
        table = Entries(value, f"{info.where}, {name}")
        value = table.need("data")
        n = len(value) if isinstance(value, list) else 1
        rows, cols = table.number("rows", 1.0), table.number("cols", float(n))
        if rows * cols != n:
            raise CameraError(
                f"{info.where}: {name}: expected {rows:g} x {cols:g} numbers, got {n}"
            )
    if isinstance(value, list) and not value and 0 in counts:
        return np.zeros(0)
    return check_array_of(value, f"{info.where}: {name}", *((count,) for count in counts))


def text_of(views: Views) -> str:
    """A camera_info of one camera; CameraError for a lens that ROS has no model for."""
    camera = views.camera()
    assert views.rig is not None
    name, p = model_in("opencv", camera)
    model = {"5": "plumb_bob", "fisheye": "equidistant"}.get(name, "rational_polynomial")
    k = camera.opencv_K
    k[0, 1] = camera.skew
    name = "".join(c if c.isalnum() else "_" for c in views.rig.names[0])
    lines = [f"image_width: {camera.width}", f"image_height: {camera.height}"]
    lines += [f'camera_name: "{name}"', f"distortion_model: {model}"]
    for key, array in (
        ("camera_matrix", k),
        ("distortion_coefficients", np.array([[*p.values()]])),
        ("rectification_matrix", np.eye(3)),
        ("projection_matrix", np.hstack([k, np.zeros((3, 1))])),
    ):
        lines += yaml_matrix(key, array)
    return "\n".join([*lines, ""])
