"""Requirements for the detection of a marker, and figures of the image space model.

A marker is two faces. Its figures are those of the thesis' tables, for the marker as a whole:

    C_FOV  all four corners are inside the image                                           (3.7)
    C_R    pixels of both faces / R_min                                                    (3.8)
    C_F    all four corners are within the depth of field                                 (3.12)
    C_V    visible pixels of both faces / their pixels                             (3.13, 3.14)
    C      C_FOV min(1, C_R) C_F C_V                                                       (3.6)

and the model predicts that the marker is found where C >= V_min.

E. S. Eissa. Image Space Coverage Model. 2020, Table 5.1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import Camera, to_image
from rastercov.core.coverage.coverage import Coverage
from rastercov.core.coverage.job import evaluate
from rastercov.reference.criteria import blur_circle
from rastercov.reference.markers.scene import CELLS, MARKER_SIDE, Plate, mesh_of

ROUNDING = 1e-9
"""Tolerance of coverage below its threshold."""


@dataclass(frozen=True, kw_only=True)
class MarkerRequirement:
    """Thresholds of the marker task."""

    name: str  # in tables
    min_pixels: float = 1.0  # R_min of a whole marker, px
    min_contour: float = 0.0  # length of its outline as a detector counts it, `contour_length`
    min_cell: float = 0.0  # width of a cell's image, along its worst direction, px
    min_border: float = 0.0  # distance of the corners from the border of the image, px
    max_blur: float = math.inf  # c, px
    max_blur_cells: float = math.inf  # the same over a cell's side, the root of its area
    min_visibility: float = 1.0  # V_min


THESIS = MarkerRequirement(name="thesis", min_pixels=1024.0, max_blur=5.755, min_visibility=1.0)
"""Exactly Table 5.1."""
DETECTOR = MarkerRequirement(
    name="detector",
    min_contour=132.0,
    min_cell=1.0,
    min_border=3.0,
    max_blur_cells=1.6,
    min_visibility=0.985,
)
"""The same criteria in the measures of OpenCV's detector.

Its perimeter counts the pixels of a contour, 4 (n - 1) for a square of n, so 128 of them take a
contour of length 132, and it drops what comes within 3 px of the border: that is in its settings.
It reads cells, so blur counts relative to the side of a cell; it tolerates a defect at a corner.
Both limits and the least width of a cell were fitted on random scenes, docs/appendix/markers.md.
"""


@dataclass(frozen=True)
class PlateFigures:
    """Figures of the engine for one marker."""

    in_view: bool  # C_FOV
    border: float  # least distance of its corners from the image's border, px; < 0 outside
    pixels: float  # area of its image inside the picture, px^2
    visible_pixels: float  # area of the visible part, px^2
    contour: float  # length of its outline as a detector counts it, px
    cell: float  # least width of the image of a cell, along its worst direction, px
    blur: float  # diameter of the blur circle, px

    @property
    def visibility(self) -> float:
        """C_V."""
        return self.visible_pixels / self.pixels if self.pixels > 0 else 0.0

    @property
    def blur_cells(self) -> float:
        """The blur circle over the side of a cell, the root of its image's area; 0 without one."""
        return CELLS * self.blur / math.sqrt(self.pixels) if self.pixels > 0 else 0.0

    def resolution(self, requirement: MarkerRequirement) -> float:
        """C_R, not capped."""
        shares = [self.pixels / requirement.min_pixels]
        if requirement.min_contour:
            shares.append(self.contour / requirement.min_contour)
        if requirement.min_cell:
            shares.append(self.cell / requirement.min_cell)
        return min(shares)

    def coverage(self, requirement: MarkerRequirement) -> float:
        """C, (3.6), graded; the depth of field is where the blur circle stays within its limit."""
        is_sharp = self.blur <= requirement.max_blur
        is_sharp &= self.blur_cells <= requirement.max_blur_cells
        if not (is_sharp and self.in_view and self.border >= requirement.min_border):
            return 0.0
        return min(1.0, self.resolution(requirement)) * self.visibility

    def is_met(self, requirement: MarkerRequirement) -> bool:
        """True when the model predicts a detection."""
        return self.coverage(requirement) >= requirement.min_visibility - ROUNDING


def plate_figures(plates: Sequence[Plate], camera: Camera) -> list[PlateFigures]:
    """Figures of each plate's marker, method certified."""
    result = evaluate(mesh_of(plates), camera, np.eye(4)[None], by="face")
    return [_figures(result, camera, plate, index) for index, plate in enumerate(plates)]


def _figures(coverage: Coverage, camera: Camera, plate: Plate, index: int) -> PlateFigures:
    faces = slice(2 * index, 2 * index + 2)
    image, size = to_image(plate.corners, camera), np.array((camera.width, camera.height))
    return PlateFigures(
        in_view=bool(coverage.in_view[0, faces].all()),
        border=float(min(image.min(), (size - image).min())),
        pixels=float(coverage.drawn_pixels[0, faces].sum()),
        visible_pixels=float(coverage.visible_pixels[0, faces].sum()),
        contour=contour_length(image),
        cell=float(coverage.pixel_density[0, faces].min()) * MARKER_SIDE / CELLS,
        blur=abs(float(blur_circle(camera, np.array(plate.centre[2])))),
    )


def contour_length(corners: FloatArray) -> float:
    """Length of an outline in steps from pixel to pixel, along sides or diagonals: (4, 2) -> px.

    A step of a contour is a pixel along the longer of its two directions, so that an edge (du, dv)
    takes max(|du|, |dv|) of them: a square on its tip has 1 / sqrt 2 of the steps it has upright.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    return float(np.abs(edges).max(axis=1).sum())
