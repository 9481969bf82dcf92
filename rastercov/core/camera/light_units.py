"""Illuminances and gloss as text: of files, plans and commands."""

import re

from rastercov.base import CameraError, shown
from rastercov.base.arguments import Quantity, Reads


def illuminance(text: str) -> Quantity:
    """Illuminance of text such as "300", "300 lx" or "5 W/m2"; ValueError for other text."""
    result = _ILLUMINANCE.fullmatch(text.strip())
    if not result:
        raise ValueError(f"a number, lx or W/m2, such as 300 lx, got {shown(text)}")
    return Quantity(float(result[1]), (result[2] or "").replace("²", "2"))


_ILLUMINANCE = re.compile(r"([-+]?[0-9]+(?:\.[0-9]*)?(?:e[-+]?[0-9]+)?)\s*(lx|W/m2|W/m²)?")
LIGHT = Reads(illuminance, (), _ILLUMINANCE.pattern, "LX")
"""Metadata of a field that is an illuminance, in the unit of the lamps."""


def check_unit(name: str, value: float, unit: str) -> None:
    """CameraError for an illuminance that was given in another unit than that of the lamps."""
    given = getattr(value, "unit", "")
    if given not in ("", unit):
        raise CameraError(
            f"expected {name} in {unit}, the unit of the lamps, got {given}; lx and W/m2 cannot be "
            "converted"
        )


GLOSSES = {"matt": 0.0, "satin": 12.0, "polished": 30.0}
"""Degrees off the mirror direction in which a surface shows a lamp, by its gloss."""


def gloss(text: str) -> float:
    """Angle of a name of `GLOSSES`, or of text that is a number, degrees; else ValueError."""
    try:
        return GLOSSES[text.strip()] if text.strip() in GLOSSES else float(text)
    except ValueError:
        raise ValueError(f"degrees, or one of {', '.join(GLOSSES)}, got {shown(text)}") from None


GLOSS = Reads(gloss, tuple(GLOSSES), r"[0-9.]+", "DEG|NAME")
"""Metadata of a field that is the angle of a highlight."""
