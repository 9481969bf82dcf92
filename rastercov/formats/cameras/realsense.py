"""Intrinsics of Intel RealSense: what `rs-enumerate-devices -c` prints, and JSON of rs2_intrinsics.

Pixels are counted from their centres. Places of the sensors are not read.

Source: librealsense 2.56, tools/enumerate-devices; its documentation "Projection in RealSense SDK".
"""

import re

from rastercov.core.camera import Border, Camera, Views, centre_camera
from rastercov.formats.cameras.source import Entries, Source, keys_of, number_of

BLOCK = re.compile(r'Intrinsic of "([^"\n]+)"[^\n]*\n((?:[ \t]*\w[\w ()]*:[^\n]*\n?)+)')
LINE = re.compile(r"[ \t]*(\w+)[^:\n]*:[ \t]*([^\n]*)")
LENSES = {
    "none": ("opencv", ()),
    "brown conrady": ("opencv", ("k1", "k2", "p1", "p2", "k3")),
    "kannala brandt4": ("opencv_fisheye", ("k1", "k2", "k3", "k4")),
}
"""Models by librealsense's names; others are read where all their coefficients are 0."""


def is_mine(content: object) -> bool:
    """True for the text of rs-enumerate-devices, and for the fields of rs2_intrinsics."""
    if isinstance(content, str):
        return BLOCK.search(content) is not None
    return {"ppx", "ppy", "fx", "fy"} <= keys_of(content)


def read(source: Source, border: Border) -> Views:
    """Cameras of the streams."""
    if BLOCK.search(source.text) is None:
        return border.views([_camera(Entries(source.table))])
    cameras: dict[str, Camera] = {}
    for name, block in BLOCK.findall(source.text):
        table: dict[str, object] = {}
        for key, value in LINE.findall(block):
            words = [*map(number_of, value.split())]
            of_name = {"distortion": value.strip(), "coeffs": words}
            table[key.lower()] = of_name.get(key.lower(), next(iter(words), None))
        camera = _camera(Entries(table, f"stream {name}"))
        cameras[f"{name} {camera.width}x{camera.height}"] = camera
    border.note("extrinsics of the sensors are not read")
    return border.views([*cameras.values()], [*cameras])


def _camera(entries: Entries) -> Camera:
    given = entries.get("distortion", entries.get("model", "none"))
    model = str(given).rpartition(".")[2].replace("_", " ").lower()
    has_lens = "coeffs" in entries
    coefficients: list[float] = entries.array("coeffs", (5,)).tolist() if has_lens else []
    if "brown" in model and not any(coefficients):
        model = "none"
    if model not in LENSES:
        raise entries.wrong("distortion", f"one of {', '.join(LENSES)}", given)
    ours, names = LENSES[model]
    p = dict(zip(names, coefficients, strict=False))
    p |= {"fx": entries.number("fx"), "fy": entries.number("fy")}
    p |= {"cx": entries.number("ppx"), "cy": entries.number("ppy")}
    return centre_camera(ours, (entries.side("width"), entries.side("height")), p)
