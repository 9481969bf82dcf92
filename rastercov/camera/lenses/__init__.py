"""Lenses of real cameras: their models, certified valid regions, ideal planes and exact areas.

`sources` makes lenses from the parameters of other programs, `lens` from their terms.
docs/cameras.md has the equations.
"""

from rastercov.camera.lenses.lens import BASES, Lens, make_lens
from rastercov.camera.lenses.planes import IdealPlane

__all__ = ["BASES", "IdealPlane", "Lens", "make_lens"]
