"""Lenses of real cameras: their models, certified valid regions, ideal planes and exact areas.

`of_camera` has the lens of a camera. docs/appendix/lenses.md has the equations.
"""

from rastercov.core.camera.lenses.of_camera import LensModel
from rastercov.core.camera.models import BASES

__all__ = ["BASES", "LensModel"]
