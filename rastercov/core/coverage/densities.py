"""Pixel densities by the names of the standards, and as text with a unit.

EN 62676-4. Video surveillance systems for use in security applications - Part 4: Application
guidelines. 2015 (of IEC 62676-4:2014).
IEC 62676-4. Video surveillance systems for use in security applications - Part 4: Application
guidelines. 2025.
"""

import re

from rastercov.base import shown
from rastercov.base.arguments import Reads
from rastercov.base.format import number
from rastercov.core.mesh.groups import list_names

EDITIONS = {
    "EN 62676-4:2015": {
        "monitor": 12.5,
        "detect": 25.0,
        "observe": 62.5,
        "recognise": 125.0,
        "identify": 250.0,
        "inspect": 1000.0,
    },
    "IEC 62676-4:2025": {
        "overview": 20.0,
        "outline": 40.0,
        "discern": 80.0,
        "perceive": 125.0,
        "characterise": 250.0,
        "validate": 500.0,
        "scrutinise": 1500.0,
    },
}
"""Least pixels per metre of each level, on a target that faces the camera; names differ."""
_AMERICAN = ("recognize", "characterize", "scrutinize")
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "in": 0.0254}
"""Metres in the unit of "px/UNIT"."""
LEVELS = {name: value for levels in EDITIONS.values() for name, value in levels.items()}
"""Pixels per metre of every level."""
DORI_EDITION = "EN 62676-4:2015"
DORI = {
    name: EDITIONS[DORI_EDITION][name] for name in ("detect", "observe", "recognise", "identify")
}
"""Levels for camera plans: in legends of images, and offered as thresholds."""
_BY_NAME = LEVELS | {name: LEVELS[name.replace("ize", "ise")] for name in _AMERICAN}
_QUANTITY = re.compile(r"([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)\s*(?:px\s*/\s*(\w+))?")


def pixels_per_metre(text: str) -> float:
    """Pixels per metre of a level of `EDITIONS`, or of text such as "250 px/m" or "0.25 px/mm".

    Raises
    ------
    ValueError
        For other text; the message names similar levels.
    """
    words = text.strip().lower()
    if words in _BY_NAME:
        return _BY_NAME[words]
    result = _QUANTITY.fullmatch(words)
    try:
        if result and (result[2] or "m") in _LENGTHS:
            return float(result[1]) / _LENGTHS[result[2] or "m"]
    except ValueError:  # several points
        pass
    raise ValueError(
        f"px/{', px/'.join(_LENGTHS)} or a level, got {shown(text)}; levels: "
        f"{list_names(LEVELS, words)}"
    )


PX_PER_M = Reads(pixels_per_metre, tuple(_BY_NAME), _QUANTITY.pattern, "PX/M|NAME")
"""Metadata of a field that is a density, px/m."""


def density_text(value: float, unit: str = "px/m", beside: float = 0.0) -> str:
    """A density, or another figure with a unit, as text: "1.3 px/mm".

    It is in the unit of the larger of it and one `beside` it.
    """
    for power, name in ((1, "px/m"), (2, "px/m²")):
        if unit == name and max(value, beside) >= 10 ** (3 * power):
            value, unit = value / 10 ** (3 * power), name.replace("/m", "/mm")
    return f"{number(value)} {unit}"
