"""Illuminances as colours of faces."""

import math
from dataclasses import replace

import numpy as np

from rastercov.base.format import number
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh import Mesh
from rastercov.light.points import OfLight
from rastercov.report.modes import (
    LAST,
    OCCLUDER,
    OCCLUDER_LABEL,
    Mode,
    OfUnit,
    Painted,
    ReportHooks,
    by_density,
    in_classes,
)


def by_illuminance(mesh: Mesh, light: OfLight) -> Painted:
    """Illuminances by factors, with what is too dark and too bright in the colours of these.

    The border of each is the line of the threshold, by face.
    """
    result = by_density(mesh, OfUnit(light.values, light.unit))
    levels, palette = (
        np.minimum(result.levels, LAST - 3),
        result.palette.copy(),
    )  # below the reasons
    lit, task = light.values > 0, mesh.task_mask
    most = math.inf if light.most is None else light.most
    words, hatches = {OCCLUDER: OCCLUDER_LABEL}, [0] * 256
    rows = {
        "unlit": (LAST - 2, ~lit, "unlit"),
        "too_dark": (LAST - 1, lit & (light.values < light.least), f"below {number(light.least)}"),
        "too_bright": (LAST, light.values > most, f"above {number(most)}"),
    }
    for name, (level, faces, text) in rows.items():
        if (own := faces & task).any():
            levels[own], palette[level] = level, REASONS[name].colour
            words[level] = text if name == "unlit" else f"{text} {light.unit}"
            hatches[level] = REASONS[name].hatch
    return replace(in_classes(mesh, levels, palette, words, hatches), scale=result.scale)


LUX = Mode(
    "Illuminance or irradiance",
    "Illuminance or irradiance by fixed lamps and any ambient light, at the centroid of each face.",
    by_illuminance,
)
HOOKS = ReportHooks(lux=LUX)
