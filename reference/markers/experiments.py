"""The four experiments of the thesis, compared with their printed tables.

    field of view   15 markers at 4 m: five in the image, five across its border, five outside
    resolution      one at each of 4, 5, ... 18 m, seen sharply
    focus           2 to 18 m at f/0.25, focused at 4 m
    visibility      one before the other, hiding 25, 50, 75 or 100 % of it

The thesis does not give its focus distance: 4 m reproduces its table; distances outside 3.82 to
4.09 m do not.

E. S. Eissa. Image Space Coverage Model. 2020, section 5.2, Tables 5.3 to 5.5.

Requirements for the detection of a marker, and figures of the image space model.

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
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rastercov.base import ByName, ByteArray, FloatArray, frozen_record
from rastercov.core.camera import Camera, to_image
from rastercov.core.camera.catalogue import entries_of
from rastercov.core.coverage.coverage import Coverage
from rastercov.core.coverage.job import evaluate
from rastercov.reference.coverage import blur_circle
from rastercov.reference.markers.detect import MIN_PERIMETER, detect, patterns
from rastercov.reference.markers.picture import reflect, sensor
from rastercov.reference.markers.scene import BOARD_SIDE, CELLS, MARKER_SIDE, Plate, mesh_of
from rastercov.shards import Progress

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


ICUBE = "icube-ns4133bu-8mm"
FOCUS_DEPTHS = (*range(2, 15), 17, 18)
"""Metres; the printed table leaves out 15 and 16."""
HIDDEN = {
    **{1: (0, 0.25), 3: (2, 0.5), 5: (4, 0.75), 7: (6, 0.25)},
    **{8: (9, 0.75), 10: (11, 0.25), 12: (13, 1.0)},
}
"""Occluding marker and hidden share by marker, Table 5.5."""
PRINTED_PIXELS = (
    *(13389, 8281, 5776, 4225, 3136, 2500, 2116, 1764),
    *(1482, 1296, 961, 900, 841, 784, 676),
)
"""Pixels of each marker, the first Table 5.4."""
PRINTED_RESOLUTION = (
    *("13.07", "8.08", "5.64", "4.12", "3.06", "2.44", "2.06", "1.72"),
    *("1.44", "1.26", "0.94", "0.89", "0.82", "0.76", "0.66"),
)
"""C_R of each marker beside them, as printed: the pixels over R_min = 1024, (3.8).

Cut to two digits, except 0.94, which is rounded (961 / 1024 = 0.938), and 0.89, which is neither
(900 / 1024 = 0.879).
"""
SMALL = 38.0
"""P_min of the focus experiment, px."""


@dataclass(frozen=True)
class MarkerRow:
    """One marker of an experiment."""

    marker: int  # its number
    setting: str  # its position
    printed: str  # figures of the thesis' table
    ours: str  # figures of the engine
    printed_coverage: float  # the criterion of the experiment, as printed
    coverage: float  # the same by the engine
    predicted: bool  # detection predicted by Table 5.1
    predicted_by_detector: bool  # detection predicted by `requirement.DETECTOR`
    printed_detected: bool  # detection in the thesis
    detected: bool


@frozen_record
class Experiment:
    """One of the four."""

    name: str
    title: str
    criterion: str  # heading of the figures
    rows: tuple[MarkerRow, ...]  # one a marker
    image: ByteArray  # the picture, (H, W)
    found: dict[int, FloatArray]  # corners (4, 2) of the markers found in it, by number
    seconds: float

    @property
    def right(self) -> int:
        """Markers that the model predicts rightly by Table 5.1."""
        return sum(row.predicted == row.detected for row in self.rows)

    @property
    def as_printed(self) -> int:
        """Markers with the same result here and in the thesis."""
        return sum(row.printed_detected == row.detected for row in self.rows)


def run_experiments(seed: int, progress: Progress) -> list[Experiment]:
    """All four, in the order of the thesis; the seed is that of the sensor's noise."""
    experiments = []
    for done, run in enumerate((field_of_view, resolution, focus, visibility)):
        progress(done, 4)
        experiments.append(run(seed))
    progress(4, 4)
    return experiments


def field_of_view(seed: int = 0) -> Experiment:
    """Table 5.3."""
    camera = Camera.preset(ICUBE)
    inside = [(640, 512), (200, 200), (1080, 200), (200, 824), (1080, 824)]
    partly = [(0, 512), (1280, 400), (640, 0), (420, 1024), (1270, 1010)]
    outside = [(-150, 300), (1430, 700), (300, -150), (900, 1174), (1430, 1174)]
    places = [*inside, *partly, *outside]
    where = ["inside"] * 5 + ["partly"] * 5 + ["outside"] * 5

    def row(index: int, figures: PlateFigures) -> ByName:
        printed = float(index < 5)
        return {
            "setting": where[index],
            "printed": f"{printed:g}",
            "ours": f"{figures.in_view:d}",
            "printed_coverage": printed,
            "coverage": float(figures.in_view),
            "printed_detected": index < 5,
        }

    about = ("field of view", "Field of view, Table 5.3", "C_FOV")
    return _run(camera, _plates(camera, places, [4.0] * 15), about, row, seed)


def resolution(seed: int = 0) -> Experiment:
    """Table 5.4, the first of that number."""
    camera = Camera.preset(ICUBE)
    depths = [4.0 + step for step in range(15)]
    places = [(128 + 256 * (step % 5), 171 + 341 * (step // 5)) for step in range(15)]

    def row(index: int, figures: PlateFigures) -> ByName:
        pixels, share = PRINTED_PIXELS[index], PRINTED_RESOLUTION[index]
        return {
            "setting": f"{depths[index]:g} m",
            "printed": f"{pixels} {share}",
            "ours": f"{figures.pixels:.0f} {figures.resolution(THESIS):.2f}",
            "printed_coverage": float(share),
            "coverage": figures.resolution(THESIS),
            "printed_detected": index < 10,
        }

    about = ("resolution", "Resolution, Table 5.4", "pixels, C_R")
    return _run(camera, _plates(camera, places, depths), about, row, seed)


def focus(seed: int = 0) -> Experiment:
    """Table 5.4, the second of that number, with P_min = 38 px and so R_min = (38 / 4)^2 px."""
    camera = Camera.from_lens(**entries_of(ICUBE, {}), f_number=0.25, focus_distance=4.0)
    top = [(170, 180), (440, 180), (650, 180), (830, 180), (990, 180)]
    places = top + [(170 + 240 * (step % 5), 500 + 260 * (step // 5)) for step in range(10)]

    def row(index: int, figures: PlateFigures) -> ByName:
        is_sharp = figures.blur <= THESIS.max_blur
        return {
            "setting": f"{FOCUS_DEPTHS[index]} m",
            "printed": f"{int(1 <= index <= 5)}",
            "ours": f"{is_sharp:d}, {figures.blur:.1f} px, {figures.blur_cells:.2f} cells",
            "printed_coverage": float(1 <= index <= 5),
            "coverage": float(is_sharp),
            "printed_detected": index <= 5,
        }

    plates = _plates(camera, places, FOCUS_DEPTHS)
    about = ("focus", "Focus, the second Table 5.4", "C_F, blur")
    return _run(camera, plates, about, row, seed, SMALL)


def visibility(seed: int = 0) -> Experiment:
    """Table 5.5: a marker at 3.5 m hides a part of one at 4 m."""
    camera = Camera.preset(ICUBE)
    before, behind = 3.5, 4.0
    plates = {}
    for cell, (marker, (occluder, part)) in enumerate([*HIDDEN.items(), (14, (-1, 0.0))]):
        place = (190 + 320 * (cell % 4), 256 + 512 * (cell // 4))
        x, y, _ = centre = _centre(camera, place, behind)
        plates[marker] = Plate(marker, centre)
        if occluder >= 0:
            # The right edge of the front board ends the hidden part of the marker behind it;
            # where all of it is hidden, the boards are concentric.
            edge = (x + MARKER_SIDE * (part - 0.5)) * before / behind
            left = edge - BOARD_SIDE / 2 if part < 1 else x * before / behind
            plates[occluder] = Plate(occluder, (left, y * before / behind, before))
    ordered = [plates[marker] for marker in range(15)]

    def row(index: int, figures: PlateFigures) -> ByName:
        printed = 1 - HIDDEN.get(index, (0, 0.0))[1]
        return {
            "setting": f"{1 - printed:.0%} hidden",
            "printed": f"{printed:g}",
            "ours": f"{figures.visibility:.4g} ({figures.visible_pixels:.0f} px)",
            "printed_coverage": printed,
            "coverage": figures.visibility,
            "printed_detected": printed == 1,
        }

    about = ("visibility", "Visibility, Table 5.5", "C_V")
    return _run(camera, ordered, about, row, seed)


def _run(
    camera: Camera,
    plates: Sequence[Plate],
    about: tuple[str, str, str],
    row: Callable[[int, PlateFigures], ByName],
    seed: int,
    min_perimeter: float = MIN_PERIMETER,
) -> Experiment:
    """Predict, draw and detect the markers of one experiment."""
    began = time.perf_counter()
    light = reflect(plates, patterns(), camera)
    image = sensor(light, np.random.default_rng(seed))
    detections = detect(image, min_perimeter)
    by_table, by_detector = _relax(THESIS, min_perimeter), _relax(DETECTOR, min_perimeter)
    rows = tuple(
        MarkerRow(
            marker=index,
            predicted=figures.is_met(by_table),
            predicted_by_detector=figures.is_met(by_detector),
            detected=index in detections,
            **row(index, figures),
        )
        for index, figures in enumerate(plate_figures(plates, camera))
    )
    return Experiment(*about, rows, image, detections, time.perf_counter() - began)


def _relax(requirement: MarkerRequirement, min_perimeter: float) -> MarkerRequirement:
    """The requirement for another P_min: R_min is (P_min / 4)^2."""
    share = min_perimeter / MIN_PERIMETER
    contour = requirement.min_contour and requirement.min_contour - MIN_PERIMETER + min_perimeter
    return replace(requirement, min_pixels=requirement.min_pixels * share**2, min_contour=contour)


def _plates(
    camera: Camera, places: Sequence[tuple[float, float]], depths: Sequence[float]
) -> list[Plate]:
    """Markers 0, 1, ... with centres at some pixels and depths."""
    return [
        Plate(marker, _centre(camera, place, depth))
        for marker, (place, depth) in enumerate(zip(places, depths, strict=True))
    ]


def _centre(camera: Camera, place: tuple[float, float], depth: float) -> tuple[float, float, float]:
    """Point at a pixel and a depth, metres."""
    u, v = place
    return (u - camera.cx) / camera.fx * depth, (v - camera.cy) / camera.fy * depth, depth
