"""Frame of a drawing to scale, and its scale bar."""

import math
from typing import NamedTuple

import numpy as np
import shapely

from rastercov.base import FloatArray

PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
"""Width and height of landscape sheets, mm."""
MARGIN, PANEL, GAP = 10.0, 142.0, 8.0
"""Border of the sheet, width of the column with tables, and least room around the drawing, mm."""
LONGEST_BAR = 60.0
"""Length of the scale bar at most, mm."""


class SheetFrame(NamedTuple):
    """Paper with its scale, the place of its upper left corner in the world, and two heights, m.

    Of a drawing in a page there is its width and height, mm, instead.
    """

    paper: str
    scale: float
    corner: FloatArray
    floor: float = 0.0
    cut: float = 0.0
    size: tuple[float, float] | None = None

    @property
    def ends(self) -> FloatArray:
        """Lower left and upper right corner of the drawing on the paper, y down, mm."""
        if self.size is not None:
            return np.array(((0.0, self.size[1]), (self.size[0], 0.0)))
        width, height = PAPERS[self.paper]
        return np.array(((MARGIN, height - MARGIN), (width - MARGIN - PANEL, MARGIN)))

    @property
    def box(self) -> FloatArray:
        """The same corners in the world."""
        return self.ends * (1, -1) * self.scale / 1e3 + self.corner

    def on_paper(self, xy: FloatArray) -> FloatArray:
        """Points (..., 2) of the world on the paper, mm."""
        return (xy - self.corner) * (1e3, -1e3) / self.scale

    def holds(self, xy: FloatArray) -> bool:
        """True where the drawing has all of some points (..., 2) of the world."""
        low, high = self.box
        return bool(((low <= xy) & (xy <= high)).all())

    def path(self, value: object) -> str:
        """Lines, and the borders of areas, of the world in the drawing as an SVG path."""
        parts = shapely.get_parts(shapely.clip_by_rect(value, *self.box.ravel()))
        parts = parts[~shapely.is_empty(parts)]
        lines = [part for part in parts if part.geom_type == "LineString"]
        texts = []
        for line in (*lines, *shapely.get_rings(parts)):
            xy = self.on_paper(shapely.get_coordinates(line))
            ring = line.geom_type == "LinearRing"
            points = [f"{x:.4f},{y:.4f}" for x, y in (xy[:-1] if ring else xy).tolist()]
            texts.append("M" + "L".join(points) + "Z" * ring)
        return "".join(texts)


def scale_bar(frame: SheetFrame) -> tuple[float, str]:
    """Length of the scale bar, mm, and its words: 1, 2 or 5 times a power of 10, m."""
    metre = 1e3 / frame.scale
    power = 10.0 ** math.floor(math.log10(LONGEST_BAR / metre))
    bar = max(n * power for n in (1, 2, 5) if n * power * metre <= LONGEST_BAR)
    return bar * metre, f"{bar:g} m"
