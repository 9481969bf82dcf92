"""Lenses of real cameras: their models, certified valid regions, ideal planes and exact areas.

`of_camera` has the lens of a camera. docs/cameras.md has the equations.
"""

from rastercov.camera.lenses.of_camera import Lens
from rastercov.camera.lenses.planes import IdealPlane
from rastercov.kernels.lens_formulas import BASES

__all__ = ["BASES", "IdealPlane", "Lens"]
