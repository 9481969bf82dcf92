"""Words on light, and on what is not lit as a task asks."""

from rastercov.base.format import number
from rastercov.core.coverage.criterion import Wording, Words


def _light(value: float) -> str:
    unit = getattr(value, "unit", "")
    return f"with an {quantity(unit)} of {number(value)} {unit}".rstrip()


def quantity(unit: str) -> str:
    """Name of what a unit measures."""
    return "irradiance" if unit.startswith("W") else "illuminance"


REASONS = {
    "unlit": Words(
        "unlit",
        "are not lit by any lamp",
        "add a lamp that reaches this surface, or remove the obstacle",
        (51, 41, 70),
        11,
        nearest="nearest lamp: ",
    ),
    "too_dark": Words(
        "too dark",
        "get too little light",
        "move a lamp closer or increase its intensity",
        (109, 98, 200),
        13,
        nearest="nearest lamp: ",
    ),
    "too_bright": Words(
        "too bright",
        "get too much light",
        "move the lamps away or reduce their intensity",
        (248, 230, 62),
        14,
        nearest="nearest lamp: ",
    ),
    "highlight": Words(
        "in a specular highlight",
        "reflect a lamp into the camera",
        "move the lamp or the camera out of the specular direction",
        (255, 120, 111),
        15,
    ),
}
THRESHOLDS = {
    "min_illuminance": lambda value: f"{_light(value)} or more",
    "max_illuminance": lambda value: f"{_light(value)} or less",
    "max_highlight_deg": "outside highlights (up to {:g}° between normal and half vector)".format,
}
HOOKS = Wording(REASONS, THRESHOLDS)
