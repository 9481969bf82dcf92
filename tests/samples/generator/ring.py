"""Candidates on a level ring around the part."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from rastercov.core.camera.viewpoints import look_at
from rastercov.placement.candidates.pool import Candidates, roll_candidates
from rastercov.placement.plan.entries import Count, Number, Positive
from rastercov.placement.plan.generator import Generator, GeneratorScene


class Ring(Generator):
    """Views from a level ring around the part, looking at its centre."""

    generator: Literal["ring"]
    count: Count
    """Positions on the ring."""
    radius: Positive
    """Its radius, m."""
    height: Number = 0.0
    """Its height above the centre of the part, m."""

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        angle = np.arange(self.count) * (2 * np.pi / self.count)
        level = np.full(self.count, self.height)
        ring = np.stack((self.radius * np.cos(angle), self.radius * np.sin(angle), level), axis=1)
        poses = look_at(spot.mesh.centre + ring, spot.mesh.centre, spot.framing.up)
        yield roll_candidates(poses, "ring", np.arange(self.count), spot.framing)
