"""Limits of rules at points: the angle between rays."""

import numpy as np

from rastercov.base import BoolArray, FloatArray
from rastercov.core.camera import Gate
from rastercov.core.camera.rule import Limited
from rastercov.reference.regions import PointTwin


class AngleAtPoints(PointTwin):
    """Rules, see `rastercov.core.camera.rule`."""

    reason = "baseline"

    def holds_together(self, gate: Gate, rays: FloatArray) -> BoolArray:
        """See `PointTwin`."""
        if not isinstance(gate, Limited) or not gate.has_baseline:
            return np.ones(rays.shape[1:3], bool)
        u = rays / np.linalg.norm(rays, axis=3, keepdims=True)
        cosines = [(u[a] * u[b]).sum(axis=2) for b in range(len(u)) for a in range(b)]
        angle = np.degrees(np.arccos(np.clip(cosines, -1, 1))).max(axis=0)
        return np.asarray((angle >= gate.least_deg) & (angle <= gate.most_deg))


TWIN = AngleAtPoints()
