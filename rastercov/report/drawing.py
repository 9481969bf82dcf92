"""Frame of a drawing to scale, its scale bar, and devices beside the cameras."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from rastercov.base import FloatArray, IntArray
from rastercov.core.camera import Cameras, Poses, Rig
from rastercov.core.coverage.task import Task

PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
"""Width and height of landscape sheets, mm."""
MARGIN, PANEL, GAP = 10.0, 142.0, 8.0
"""Border of the sheet, width of the column with tables, and least room around the drawing, mm."""
LONGEST_BAR = 60.0
"""Length of the scale bar at most, mm."""
LEAST, LARGEST = np.array((90.0, 40.0)), np.array((180.0, 140.0))
"""Width and height of a map in a page, mm."""
DOT = 0.5
"""Radius of a place on a map, mm."""
HALF, SPACE, NEAR = np.array((0.9, 1.3)), 0.6, 1.9
"""Half the size of a character, and half a space between labels; distance of a label from the
middle of its place, mm."""
AROUND = np.array([(1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (-1, -1), (1, 1), (-1, 1)])
"""Directions to a label from its place, the best first."""


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


def frame_around(points: FloatArray, ends: FloatArray, beside: float) -> SheetFrame:
    """Frame in a page with points (N, 2), and with what `ends` (2, 2) bound so far beside them."""
    low, high = points.min(axis=0), points.max(axis=0)
    beside = beside or 1.0
    low = np.minimum(low, np.maximum(ends[0], low - beside))
    high = np.maximum(high, np.minimum(ends[1], high + beside))
    scale = max(float(((high - low) / (LARGEST - 2 * MARGIN)).max()), 1e-9)  # metres a millimetre
    width, height = np.maximum((high - low) / scale + 2 * MARGIN, LEAST).tolist()
    corner = (low + high) / 2 + np.array((-width, height)) / 2 * scale
    return SheetFrame("", 1e3 * scale, corner, size=(width, height))


def scale_bar(frame: SheetFrame) -> tuple[float, str]:
    """Length of the scale bar, mm, and its words: 1, 2 or 5 times a power of 10, m."""
    metre = 1e3 / frame.scale
    power = 10.0 ** math.floor(math.log10(LONGEST_BAR / metre))
    bar = max(n * power for n in (1, 2, 5) if n * power * metre <= LONGEST_BAR)
    return bar * metre, f"{bar:g} m"


def crowding(
    boxes: FloatArray, taken: FloatArray, lines: shapely.STRtree
) -> tuple[IntArray, IntArray]:
    """Numbers of boxes `taken` (K, 4), and of lines, that each of some boxes (N, 4) meets."""
    is_met = (boxes[:, None, :2] < taken[:, 2:]) & (boxes[:, None, 2:] > taken[:, :2])
    rows, _ = lines.query(shapely.box(*boxes.T), "intersects")
    return is_met.all(axis=2).sum(axis=1), np.bincount(rows, minlength=len(boxes))


def labels_beside(
    texts: Sequence[str], points: FloatArray, at: FloatArray, far: int, lines: object = ()
) -> list[tuple[float, float, str]]:
    """Labels beside points, clear of each other and of lines, mm, above few places.

    Up to one without room.
    """
    taken, tree, labels = np.empty((0, 4)), shapely.STRtree(lines), []
    for text, point in zip(texts, points, strict=True):
        half = HALF * (len(text), 1) + (SPACE, 0)
        ways = (point + np.arange(1, far + 1)[:, None, None] * AROUND * (half + NEAR)).reshape(
            -1, 2
        )
        boxes = np.hstack((ways - half, ways + half))
        n_met, n_crossed = crowding(boxes, taken, tree)
        if n_met.all():
            break
        n_below = (np.abs(ways[:, None] - at) < half + DOT).all(axis=2).sum(axis=1)
        best = np.lexsort((n_below, np.arange(len(ways)) // len(AROUND), n_crossed, n_met > 0))[0]
        taken = np.vstack((taken, boxes[best]))
        labels.append((*ways[best].tolist(), text))
    return labels


class SheetDevice(NamedTuple):
    """A device beside the cameras: name, pose, whether it rides on one, and words on it.

    The position of a device at infinity counts for nothing.
    """

    name: str
    pose: FloatArray
    rides: bool
    words: str
    has_position: bool = True


def devices_of(rig: Cameras, placed: Poses, task: Task) -> Iterator[tuple[str, SheetDevice]]:
    """Equipment by its word in its places; of pieces that ride on cameras, one for each."""
    if not isinstance(rig, Rig):
        return
    world = rig._rigs(placed)
    for kind, own in rig.equipment.items():
        for row, on in enumerate(own.carried_by(rig.names)):
            name, words = own.names[row], own._words(row, vars(task))
            if not own.rides[row]:
                yield kind, SheetDevice(name, own.places[row], False, words, own._has_position(row))
            for pose, index in zip(world, placed.camera, strict=True):
                if on[index] and not rig.is_fixed[index]:
                    at = pose @ own.places[row]
                    yield kind, SheetDevice(name, at, True, words)
