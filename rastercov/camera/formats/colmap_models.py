"""COLMAP's camera models and ours.

J. L. Schoenberger et al. COLMAP 4.2, src/colmap/sensor/models.h. Pixels have the same origin as
ours: doc/cameras.rst, "the centre of the upper left pixel is (0.5, 0.5)".
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.formats.equivalents import (
    as_fisheye,
    as_opencv,
    brown,
    coefficients,
    is_whole_panorama,
    opencv_length,
)
from rastercov.camera.models import MODELS


class ColmapModel(NamedTuple):
    """Name, parameters in order, and our model, which is found by the coefficients where empty."""

    name: str
    parameters: str
    ours: str = ""


BY_ID = dict(
    enumerate(
        (
            ColmapModel("SIMPLE_PINHOLE", "f cx cy", "pinhole"),
            ColmapModel("PINHOLE", "fx fy cx cy", "pinhole"),
            ColmapModel("SIMPLE_RADIAL", "f cx cy k1"),
            ColmapModel("RADIAL", "f cx cy k1 k2"),
            ColmapModel("OPENCV", "fx fy cx cy k1 k2 p1 p2"),
            ColmapModel("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4", "opencv_fisheye"),
            ColmapModel("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
            ColmapModel("FOV", "fx fy cx cy omega", "fov"),
            ColmapModel("SIMPLE_RADIAL_FISHEYE", "f cx cy k1", "opencv_fisheye"),
            ColmapModel("RADIAL_FISHEYE", "f cx cy k1 k2", "opencv_fisheye"),
            ColmapModel(
                "THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s3", "thin_prism_fisheye"
            ),
            # Its p0 and p1 are OpenCV's p2 and p1.
            ColmapModel(
                "RAD_TAN_THIN_PRISM_FISHEYE",
                "fx fy cx cy k1 k2 k3 k4 k5 k6 p2 p1 s1 s2 s3 s4",
                "rad_tan_thin_prism_fisheye",
            ),
            ColmapModel("SIMPLE_DIVISION", "f cx cy k", "division"),
            ColmapModel("DIVISION", "fx fy cx cy k", "division"),
            ColmapModel("SIMPLE_FISHEYE", "f cx cy", "opencv_fisheye"),
            ColmapModel("FISHEYE", "fx fy cx cy", "opencv_fisheye"),
            ColmapModel("EUCM", "fx fy cx cy alpha beta", "eucm"),
            ColmapModel("EQUIRECTANGULAR", "w h", "equirectangular"),
        )
    )
)
"""COLMAP's models by id."""
IDS = {model.name: number for number, model in BY_ID.items()}


def camera_of(model: ColmapModel, width: int, height: int, parameters: Sequence[float]) -> Camera:
    """Camera of a model of COLMAP; CameraError for another number of parameters than it has."""
    names = model.parameters.split()
    if len(names) != len(parameters):
        raise CameraError(
            f"{model.name} must have {len(names)} parameters ({model.parameters}), "
            f"got {len(parameters)}"
        )
    p = dict(zip(names, parameters, strict=True))
    if model.ours == "equirectangular":
        return Camera(
            width=width,
            height=height,
            fx=p["w"] / (2 * math.pi),
            fy=p["h"] / math.pi,
            cx=p["w"] / 2,
            cy=p["h"] / 2,
            model=model.ours,
        )
    lens: tuple[str, tuple[float, ...]]
    if model.ours:
        wanted = MODELS[model.ours].coefficients.split()
        if model.ours == "eucm":
            wanted = wanted[:2]
        lens = model.ours, tuple(p.get(name, 0.0) for name in wanted)
    else:
        order = MODELS["opencv"].coefficients.split()
        lens = brown(tuple(p.get(name, 0.0) for name in order))
    return Camera(
        width=width,
        height=height,
        fx=p["fx"] if "fx" in p else p["f"],
        fy=p["fy"] if "fy" in p else p["f"],
        cx=p["cx"],
        cy=p["cy"],
        model=lens[0],
        distortion=lens[1],
    )


def colmap_of(camera: Camera, name: str) -> tuple[ColmapModel, tuple[float, ...]]:
    """Model of COLMAP and its parameters for a camera; `name` is for the error.

    Raises
    ------
    CameraError
        For a lens that COLMAP has no model for.
    """
    c = coefficients(camera)
    found: tuple[str, tuple[float, ...]] | None = None
    if (values := as_opencv(camera)) is not None:
        n = opencv_length(values, 0, 4, 8)
        if n is not None:
            found = {0: "PINHOLE", 4: "OPENCV", 8: "FULL_OPENCV"}[n], values[:n]
    elif (radial := as_fisheye(camera)) is not None:
        found = "OPENCV_FISHEYE", radial
    elif camera.model == "eucm" and not any(camera.distortion[2:]):
        found = "EUCM", (c["alpha"], c["beta"])
    elif is_whole_panorama(camera):
        return BY_ID[IDS["EQUIRECTANGULAR"]], (float(camera.width), float(camera.height))
    else:
        direct = {
            "fov": "FOV",
            "division": "DIVISION",
            "thin_prism_fisheye": "THIN_PRISM_FISHEYE",
            "rad_tan_thin_prism_fisheye": "RAD_TAN_THIN_PRISM_FISHEYE",
        }
        if camera.model in direct:
            found = direct[camera.model], tuple(c.values())
    if found is None or camera.skew:
        raise CameraError(
            f"{name}: COLMAP has no model for {camera.model}"
            f"{' with skew' if camera.skew else ' with these coefficients'}; undistort the images, "
            "or write another format"
        )
    return BY_ID[IDS[found[0]]], (camera.fx, camera.fy, camera.cx, camera.cy, *found[1])
