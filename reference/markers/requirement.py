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
from dataclasses import dataclass

import numpy as np

from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_image
from rastercov.coverage.coverage import Coverage
from rastercov.coverage.job import evaluate
from rastercov.coverage.reasons import Reason
from rastercov.coverage.task import Task
from rastercov.reference.markers.scene import CELLS, MARKER_SIDE, PlateScene

CLEAR = 0.1
"""Least slack of a clear case, see `PlateFigures.slack`."""
ROUNDING = 1e-9
"""Tolerance of coverage below its threshold."""


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """Thresholds of the marker task."""

    name: str  # in tables
    min_pixels: float = 1.0  # R_min of a whole marker, px
    min_contour: float = 0.0  # length of its outline as a detector counts it, `contour_length`
    min_cell: float = 0.0  # width of a cell's image, along its worst direction, px
    min_border: float = 0.0  # distance of the corners from the border of the image, px
    max_blur: float = math.inf  # c, px
    max_blur_cells: float = math.inf  # the same over a cell's side, the root of its area
    min_visibility: float = 1.0  # V_min

    @property
    def threshold(self) -> float:
        """Least coverage of a marker whose detection is predicted."""
        return self.min_visibility - ROUNDING

    def blur_limit(self, pixels: float) -> float:
        """Largest blur circle for a marker by its area in pixels, px."""
        return max(min(self.max_blur, self.max_blur_cells * math.sqrt(pixels) / CELLS), 1e-6)

    def task(self, pixels: float) -> Task:
        """Task for the faces of a marker by its area in pixels, the input of every model."""
        limit = self.blur_limit(pixels)
        side = max(math.sqrt(self.min_pixels), self.min_contour / 4)
        return Task(
            min_pixels=side**2 / 2,
            min_pixel_density=self.min_cell * CELLS / MARKER_SIDE,
            max_blur=limit if math.isfinite(limit) else 1e6,
            min_coverage=self.threshold,
        )


THESIS = Requirement(name="thesis", min_pixels=1024.0, max_blur=5.755, min_visibility=1.0)
"""Table 5.1 to the letter."""
DETECTOR = Requirement(
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
Both limits and the least width of a cell were fitted on scenes of their own, see `fit`.
"""


@dataclass(frozen=True)
class PlateFigures:
    """Figures of the engine for one marker."""

    is_front: bool  # True when its front faces the camera
    in_view: bool  # C_FOV
    border: float  # least distance of its corners from the image's border, px; < 0 outside
    pixels: float  # area of its image inside the picture, px^2
    visible_pixels: float  # area of the visible part, px^2
    contour: float  # length of its outline as a detector counts it, px
    cell: float  # least width of the image of a cell, along its worst direction, px
    blur: float  # greatest diameter of the blur circle at its corners, px
    visibility: float  # C_V
    visibility_bound: float  # its error bound

    def resolution(self, requirement: Requirement) -> float:
        """C_R, not capped."""
        shares = [self.pixels / requirement.min_pixels]
        if requirement.min_contour:
            shares.append(self.contour / requirement.min_contour)
        if requirement.min_cell:
            shares.append(self.cell / requirement.min_cell)
        return min(shares)

    @property
    def blur_cells(self) -> float:
        """The blur circle over the side of a cell, the root of its image's area; 0 without one."""
        return CELLS * self.blur / math.sqrt(self.pixels) if self.pixels > 0 else 0.0

    def coverage(self, requirement: Requirement) -> float:
        """C, (3.6), graded; the depth of field is where the blur circle stays within its limit."""
        is_inside = self.is_front and self.in_view and self.border >= requirement.min_border
        if not is_inside or self.blur > requirement.blur_limit(self.pixels):
            return 0.0
        return min(1.0, self.resolution(requirement)) * self.visibility

    def is_met(self, requirement: Requirement) -> bool:
        """True when the model predicts a detection."""
        return self.coverage(requirement) >= requirement.threshold

    def slack(self, requirement: Requirement) -> dict[str, float]:
        """Distance of each criterion from its threshold; negative where it fails.

        The unit is a factor e for resolution and focus, 30 px for the border, a half for
        visibility. 0.1 is a clear case: 10 %, 3 px or 5 % of area.
        """
        limit = requirement.blur_limit(self.pixels)
        short = self.visibility - requirement.min_visibility
        behind = {} if self.is_front else {"back": -1.0}
        return behind | {
            "field of view": (self.border - requirement.min_border) / 30,
            "resolution": math.log(max(self.resolution(requirement), 1e-9)),
            "focus": math.log(limit / self.blur) if self.blur > 0 else 1.0,
            # A wholly visible marker is a clear case for any threshold.
            "visibility": 1.0 if self.visibility >= 1 - ROUNDING else min(2 * short, 0.0999),
        }

    def decisive(self, requirement: Requirement) -> tuple[str, float]:
        """The criterion with the least slack, and its slack."""
        return min(self.slack(requirement).items(), key=lambda item: item[1])

    def is_clear(self, requirement: Requirement) -> bool:
        """True when no small change would alter the prediction."""
        return abs(self.decisive(requirement)[1]) >= CLEAR


def plate_figures(scene: PlateScene, camera: Camera) -> dict[int, PlateFigures]:
    """Figures of every marker of a scene by its position in `scene.plates`, method certified."""
    found = evaluate(scene.mesh, camera, np.eye(4)[None], Task(), by="face")
    return {index: _figures(found, scene, camera, index) for index in scene.targets}


def _figures(found: Coverage, scene: PlateScene, camera: Camera, index: int) -> PlateFigures:
    faces, corners = scene.faces_of(index), scene.plates[index].corners
    image, size = to_image(corners, camera), np.array((camera.width, camera.height))
    pixels = float(found.drawn_pixels[0, faces].sum())
    seen = float(found.visible_pixels[0, faces].sum())
    bound = float((found.visibility_bound[0, faces] * found.drawn_pixels[0, faces]).sum())
    return PlateFigures(
        is_front=bool((found.reason[0, faces] > Reason.BACK_FACING).all()),
        in_view=bool(found.in_view[0, faces].all()),
        border=float(min(image.min(), (size - image).min())),
        pixels=pixels,
        visible_pixels=seen,
        contour=contour_length(image),
        cell=float(found.pixel_density[0, faces].min()) * scene.plates[index].side / CELLS,
        blur=float(blur_of(camera, corners[:, 2]).max()),
        visibility=seen / pixels if pixels > 0 else 0.0,
        visibility_bound=bound / pixels if pixels > 0 else 1.0,
    )


def contour_length(corners: FloatArray) -> float:
    """Length of an outline in steps from pixel to pixel, along sides or diagonals: (4, 2) -> px.

    A step of a contour is a pixel along the longer of its two directions, so that an edge (du, dv)
    takes max(|du|, |dv|) of them: a square on its tip has 1 / sqrt 2 of the steps it has upright.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    return float(np.abs(edges).max(axis=1).sum())


def blur_of(camera: Camera, depth: FloatArray) -> FloatArray:
    """Diameter of the blur circle at some depths, px, limited by (3.10) and (3.11).

    A f |z - z_s| / (z (z_s - f)) over the smaller side of a pixel; 0 for a camera without a lens.
    """
    if camera.aperture is None or camera.focus_distance is None:
        return np.zeros_like(depth)
    assert camera.focal_length is not None
    assert camera.pixel_size is not None
    f, z_s = camera.focal_length, camera.focus_distance
    size = camera.aperture * f / (z_s - f) / min(camera.pixel_size)
    return size * np.abs(depth - z_s) / depth
