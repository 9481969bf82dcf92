"""Lens models by name: the order of their coefficients, and the terms that these are.

Equations are in docs/appendix/lenses.md. A ray (x, y) = (X/Z, Y/Z), or its angle for a fisheye, is
moved by radial, tangential and thin-prism terms, and fx, fy, cx, cy and the skew make pixels of it.

`PROGRAMS` has the models of other programs with their parameters, which readers and writers of
`rastercov.formats.cameras` go by. Sources: COLMAP 4.2 `src/colmap/sensor/models.h`; Kalibr wiki,
"Supported models"; Agisoft Metashape Professional manual 2.1, appendix "Camera models"; OpenSfM
documentation, "Camera Models"; nerfstudio documentation, "Data conventions".
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rastercov.base import CameraError, shown
from rastercov.base.arguments import coefficients_of, number
from rastercov.core.mesh.groups import list_names
from rastercov.engine import solver_lens

BASES = tuple(solver_lens.BASES.lower().split(", "))
"""Names of the bases of lenses, by their codes."""


class Model(NamedTuple):
    """A lens model.

    Attributes
    ----------
    base : str
        Law of the lens before distortion, one of `rastercov.core.camera.lenses.BASES`.
    coefficients : str
        Names of its coefficients, in order.
    counts : tuple of int
        Permitted numbers of coefficients, the others being 0; if empty, all must be given.
    """

    base: str
    coefficients: str = ""
    counts: tuple[int, ...] = ()

    @property
    def is_planar(self) -> bool:
        """True if sharpness depends on the depth z, as for a lens with a plane in focus.

        Otherwise it depends on the distance.
        """
        return solver_lens.is_planar(BASES.index(self.base))


MODELS: Mapping[str, Model] = {
    **{
        name: Model(base, coefficients, tuple(map(int, counts.split())))
        for line in solver_lens.MODELS.lower().splitlines()
        for name, base, coefficients, counts in [line.split(";")]
    },
    "telecentric": Model("pinhole", "k1 k2 p1 p2 k3", (0, 1, 2, 4, 5)),
    "telecentric_division": Model("division", "kappa"),
}
"""Models by name, in the order of `engine/lens/models.hpp`, which has all but the last two.

"opencv" and "opencv_fisheye" are OpenCV's; the next two, "fov" and "division" COLMAP's
THIN_PRISM_FISHEYE, RAD_TAN_THIN_PRISM_FISHEYE, FOV and DIVISION; "fisheye62" OpenSfM's fisheye62
and fisheye624; "omni", "eucm" and "double_sphere" Kalibr's with radtan distortion. "telecentric"
and "telecentric_division" are of `rastercov.core.camera.parallel`, with coefficients of places on
the sensor in metres.
"""


class Foreign(NamedTuple):
    """Model of another program: ours, and its parameters in order, with our letters.

    One of Brown's model is "opencv" here, also where it has no coefficients.
    """

    ours: str
    parameters: str = ""


_FISHEYE_62 = "k1 k2 k3 k4 k5 k6 p1 p2"
_LATE = MODELS["rad_tan_thin_prism_fisheye"].coefficients
_TABLES: Mapping[str, Mapping[str, str]] = {
    "colmap": {  # in the order of their ids, from 0
        "SIMPLE_PINHOLE": "opencv f cx cy",
        "PINHOLE": "opencv fx fy cx cy",
        "SIMPLE_RADIAL": "opencv f cx cy k1",
        "RADIAL": "opencv f cx cy k1 k2",
        "OPENCV": "opencv fx fy cx cy k1 k2 p1 p2",
        "OPENCV_FISHEYE": "opencv_fisheye fx fy cx cy k1 k2 k3 k4",
        "FULL_OPENCV": "opencv fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
        "FOV": "fov fx fy cx cy omega",
        "SIMPLE_RADIAL_FISHEYE": "opencv_fisheye f cx cy k1",
        "RADIAL_FISHEYE": "opencv_fisheye f cx cy k1 k2",
        "THIN_PRISM_FISHEYE": "thin_prism_fisheye fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s3",
        # Its p0 and p1 are OpenCV's p2 and p1.
        "RAD_TAN_THIN_PRISM_FISHEYE": f"rad_tan_thin_prism_fisheye fx fy cx cy {_LATE}",
        "SIMPLE_DIVISION": "division f cx cy k",
        "DIVISION": "division fx fy cx cy k",
        "SIMPLE_FISHEYE": "opencv_fisheye f cx cy",
        "FISHEYE": "opencv_fisheye fx fy cx cy",
        "EUCM": "eucm fx fy cx cy alpha beta",
        "EQUIRECTANGULAR": "equirectangular w h",
    },
    "kalibr": {  # camera and distortion model; parameters after cy are those of distortion
        "pinhole-none": "opencv fx fy cx cy",
        "pinhole-radtan": "opencv fx fy cx cy k1 k2 p1 p2",
        "pinhole-equi": "opencv_fisheye fx fy cx cy k1 k2 k3 k4",
        "pinhole-equidistant": "opencv_fisheye fx fy cx cy k1 k2 k3 k4",
        "pinhole-fov": "fov fx fy cx cy omega",
        "omni-none": "omni xi fx fy cx cy",
        "omni-radtan": "omni xi fx fy cx cy k1 k2 p1 p2",
        "eucm-none": "eucm alpha beta fx fy cx cy",
        "eucm-radtan": "eucm alpha beta fx fy cx cy k1 k2 p1 p2",
        "ds-none": "double_sphere xi alpha fx fy cx cy",
        "ds-radtan": "double_sphere xi alpha fx fy cx cy k1 k2 p1 p2",
    },
    "opencv": {  # and ROS: by the number of coefficients
        **{
            str(n): " ".join(("opencv", *MODELS["opencv"].coefficients.split()[:n]))
            for n in (5, 8, 12, 14)
        },
        "fisheye": "opencv_fisheye k1 k2 k3 k4",
    },
    "metashape": {
        "frame": "metashape k1 k2 k3 k4 p1 p2",
        "fisheye": "metashape_fisheye k1 k2 k3 k4 p1 p2",
        "equidistant_fisheye": "metashape_fisheye k1 k2 k3 k4 p1 p2",
        "equisolid_fisheye": "metashape_equisolid k1 k2 k3 k4 p1 p2",
        "spherical": "equirectangular",
    },
    "nerfstudio": {
        # k4 is of r^8, as Metashape has it, whose p1 and p2 are turned around.
        **dict.fromkeys(
            ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"),
            "metashape k1 k2 k3 k4 p2 p1",
        ),
        "OPENCV_FISHEYE": "opencv_fisheye k1 k2 k3 k4",
        "EQUIRECTANGULAR": "equirectangular",
        "FISHEYE624": f"rad_tan_thin_prism_fisheye {_LATE}",
    },
    "opensfm": {
        "perspective": "opencv k1 k2",
        "simple_radial": "opencv k1",
        "radial": "opencv k1 k2",
        "brown": "opencv k1 k2 p1 p2 k3",
        "fisheye": "opencv_fisheye k1 k2",
        "fisheye_opencv": "opencv_fisheye k1 k2 k3 k4",
        "fisheye62": f"fisheye62 {_FISHEYE_62}",
        "fisheye624": f"fisheye62 {_FISHEYE_62} s1 s2 s3 s4",
        "spherical": "equirectangular",
        "equirectangular": "equirectangular",
    },
}
PROGRAMS: Mapping[str, Mapping[str, Foreign]] = {
    program: {name: Foreign(*text.split(" ", 1)) for name, text in table.items()}
    for program, table in _TABLES.items()
}
"""Models of other programs by the names that they have there."""

UNDISTORTED = {
    "opencv": "pinhole",
    "telecentric": "telecentric",
    "telecentric_division": "telecentric",
}
"""Models that are another one where all coefficients are 0."""
LARGEST = solver_lens.LARGEST_COEFFICIENT
RANGES = {
    ("opencv", "tau_x"): "within 1.05 rad",
    ("opencv", "tau_y"): "within 1.05 rad",
    ("fov", "omega"): "from 0 to below pi radians",
    ("omni", "xi"): "0 or more",
    ("eucm", "alpha"): "from 0 to 1",
    ("eucm", "beta"): "positive",
    ("double_sphere", "xi"): "above -1 and at most 1",
    ("double_sphere", "alpha"): "from 0 to 1",
}
"""Ranges of coefficients in which the equations of their model are a lens, in words; the engine
has their numbers."""


def check_model(model: object, distortion: object) -> tuple[str, tuple[float, ...]]:
    """Model and its coefficients; `UNDISTORTED` has the model where all of them are 0.

    Raises
    ------
    CameraError
        For a model that does not exist, another number of coefficients than it has, or one that is
        out of its range.
    """
    if not isinstance(model, str) or model not in MODELS:
        known = list_names(MODELS, str(model))
        raise CameraError(f"expected model to be one of {known}, got {shown(model)}")
    values = tuple(number("distortion", value) for value in coefficients_of(distortion))
    if model == "pinhole" and not any(values):
        return model, ()
    if model == "pinhole":
        raise CameraError(
            f"expected no distortion for a pinhole, got {shown(list(values))}; give model as well, "
            "such as opencv or opencv_fisheye"
        )
    its = MODELS[model]
    names = its.coefficients.split()
    counts = its.counts or (len(names),)
    if model in UNDISTORTED and not any(values):
        return UNDISTORTED[model], ()
    if len(values) not in counts:
        words = " or ".join(map(str, counts))
        own = f" ({its.coefficients})" if names else ""
        raise CameraError(
            f"expected {words} distortion coefficients{own} for model {model}, got {len(values)}"
        )
    row = list(MODELS).index(model)
    for k, (name, value) in enumerate(zip(names, values, strict=False)):
        if not abs(value) <= LARGEST:
            raise CameraError(
                f"expected {name} of model {model} to be within {LARGEST:g}, got {value:g}; check "
                "its unit"
            )
        wanted = RANGES.get((model, name))
        if wanted and not solver_lens.is_coefficient(row, k, value):
            raise CameraError(
                f"expected {name} of model {model} to be {wanted}, got {value:g}; correct "
                "distortion"
            )
    return model, values


def coefficients_by_name(model: str, distortion: Sequence[float]) -> dict[str, float]:
    """Coefficients of a model by name, 0 where they were left out."""
    names = MODELS[model].coefficients.split()
    return dict.fromkeys(names, 0.0) | dict(zip(names, distortion, strict=False))


def lens_of_parameters(ours: str, p: Mapping[str, float]) -> tuple[str, tuple[float, ...]]:
    """Model and coefficients of a lens with these parameters by name, 0 where they are left out.

    Brown's model has as few as hold all that are not 0, and is a pinhole where all are.
    """
    names = MODELS[ours].coefficients.split()
    values = tuple(p.get(name, 0.0) for name in names)
    if ours == "opencv":
        n = next((n for n in MODELS[ours].counts if not any(values[n:])), None)
        return (ours, values[:n]) if any(values) else ("pinhole", ())
    least = max((row + 1 for row, name in enumerate(names) if name in p), default=len(names[:1]))
    return ours, values[: next(n for n in MODELS[ours].counts or (len(names),) if n >= least)]
