"""Lamps in tests of all public names."""

from functools import partial

import numpy as np
from misuse_values import FOLDER, POSES

import rastercov as rc
from rastercov.core.camera.rig import phased_features

LAMPS = rc.Lamps([rc.Lamp.point(intensity=5), rc.Lamp.ring(0.1, points=3, intensity=5)], POSES)
OF_SENSOR = {"exposure_time": 0.01, "f_number": 4.0, "pixel_size": 3e-6, "full_well": 1e4} | {
    "quantum_efficiency": 0.6
}
NAMES = ["Exposure", "Highlight", "Illuminance", "Lamp", "Lamps", "load_lamps"]
FIRST = ["Exposure.band", "Lamp.area", "Lamp.bar", "Lamp.ring", "Lamp.spot", "Lamp.sun"]
OBJECTS = [rc.Exposure(**OF_SENSOR), LAMPS, LAMPS.lamps[0]]
SHOWN = [*OBJECTS, rc.Illuminance(np.eye(3), 1.0), rc.Highlight((0, 0, 1), np.eye(3), 10)]
COMPARED = [("Lamp", "kind")]
FILES = {
    "lamp.ies": "IES\nTILT=NONE\n1 9 1 2 1 1 2 0 0 0 1 1 9\n0 90\n0\n9 0\n",
    "lamps.toml": "[lamps.a]\nintensity_cd = 5\nrig = true\n",
}
ALONE = {"method": rc.Engine("exact", threads=1)} | dict.fromkeys(
    each.word for each in phased_features()
)
CALLS = {
    "evaluate, lit": ALONE | {"by": "area", "fields": [], "lamps": LAMPS},
    "regions, lit": ALONE | {"lamps": LAMPS},
    "Illuminance": {"positions": [(0, 0, 1)], "limit": 1.0, "axes": (0, 0, -1)},
    "Highlight": {"eyes": (0, 0, 1), "positions": [(1, 0, 1)], "degrees": 10.0},
    "Exposure": OF_SENSOR | {"gain": 0.1, "min_snr": 20.0},
    "Exposure.band": {"unit": "W/m2"},
    "Exposure.in_words": {"unit": "lx"},
    "Task.exposed": {"exposure": rc.Exposure(**OF_SENSOR), "unit": "lx"},
    "Lamp.from_ies": {"path": FOLDER / "lamp.ies", "tilt_deg": 10.0},
    "Lamps.carried_by": {"cameras": ["a", "b"]},
    "Lamp": {"intensity": 5.0, "size": (0.0, 0.0), "points": 1},
    "Lamp, of size": {
        "kind": "area",
        "intensity": None,
        "power_w_sr": 5.0,
        "size": (1.0, 2.0),
        "points": 4,
    }
    | {"half_angle_deg": 90.0, "exponent": 1.0},
    "Lamp.point": {"intensity": 5.0},
    "Lamp.spot": {"half_angle_deg": 30.0, "power_w_sr": 5.0},
    "Lamp.bar": {"length": 0.5, "intensity": 5.0, "points": 4},
    "Lamp.ring": {"diameter": 0.5, "intensity": 5.0, "points": 4},
    "Lamp.dome": {"diameter": 0.5, "intensity": 5.0, "points": 4},
    "Lamp.area": {"width": 0.5, "height": 0.2, "intensity": 5.0, "points": 4},
    "Lamp.sun": {"illuminance": 8e4, "points": 4, "share": 0.5, "radius_deg": 0.27},
    "Lamps": {"lamps": LAMPS.lamps, "places": POSES, "names": ["a", "b"], "rides": [True, False]},
    "load_lamps": {"path": FOLDER / "lamps.toml"},
    "Lamps.at": {"row": 1, "place": POSES[0]},
}
PAGES = {"light": "lamps.toml"}
LINES = {"evaluate, lamps": "{scene} --lamps lamps.toml --min-illuminance 100"}
OF_LAMP = "[lamps.{}]\nintensity_cd = 100\nposition = [{}, 0, 0.5]\n"
OF_LINES = {"lamps.toml": OF_LAMP.format("a", 0) + OF_LAMP.format("b", 0.5)}
HALF_ANGLES = (10.0, 17.3, 28.9, 40.0)
"""Of spots, degrees; few, because the lens of each is made but once."""


def lamps_of_table(kind, rng):
    """Entries of one or two lamps in the cell, or beside the cameras of the rig."""
    return {"lamps": {f"lamp {row}": lamp(rng, kind) for row in range(rng.integers(1, 3))}}


def lamp(rng, kind):
    """A point or a spot in the cell, or beside the cameras of the rig."""
    own = {"kind": "point"}
    if rng.random() < 0.5:
        own = {"kind": "spot", "half_angle_deg": float(rng.choice(HALF_ANGLES))}
    at = rng.normal(size=3)
    place = {"position": (3 * at / np.linalg.norm(at)).tolist(), "aim": [0.0, 0.0, 0.0]}
    if kind == "riding":
        beside = rng.uniform(-1.5, 1.5, 2).tolist()
        place = {"position": [*beside, 0.0], "aim": [0.0, 0.0, 3.5], "rig": "head"}
    return {"intensity_cd": 50.0, **own, **place}


CROSSED = {kind: partial(lamps_of_table, kind) for kind in ("fixed", "riding")}
