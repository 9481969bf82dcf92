"""Close-up of one face of a comparison: its visible and hidden parts, and the samples over it.

The polygons are the truth by `rastercov.reference.polygons`, at the zoom that fills the picture. An
inset enlarges a part of the face that is small but decides the result.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rastercov.base.errors import RastercovError
from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limit
from rastercov.camera.projection import to_camera, to_image
from rastercov.mesh import Mesh
from rastercov.raster.sample_grid import SampleGrid
from rastercov.reference.methods.error_statistics import FaceError
from rastercov.report.images import stripes
from rastercov.report.theme import INK, PAPER

Box = tuple[float, float, float]
"""Square part of the image: left, top, side, px."""
SEEN, SEEN_EDGE = (20, 163, 127), (10, 90, 70)
HIDDEN, HIDDEN_STRIPE = (240, 128, 60), (194, 87, 26)
BROKEN = (192, 24, 43)
EMPTY, OUTLINE = (223, 230, 238), (250, 251, 252)
PIXEL_BORDER, SAMPLE = (49, 69, 92), (109, 121, 135)

MAX_FACES = 800
"""Largest number of faces that are drawn around one: more are slow and cannot be read."""
SIDE, CAPTION = 640, 132
"""Sides of the picture and of the caption below it, pixels."""
FINE = 3
"""Oversampling: pixels drawn along one of those."""
INSET = 250
"""Side of the inset."""
MAX_THICKNESS = 0.03
"""Thickness up to which a part is enlarged, relative to the side of the picture."""
MIN_SPACING = 7
"""Least distance of samples that are drawn, pixels of the picture."""
MIN_PIXEL = 14
"""Least side of an image pixel whose border is drawn, pixels of the picture."""


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """True polygons of the faces around one face, by shapely."""

    image: Any  # the part of the face inside the image
    seen: Any  # its visible part
    hidden: Any  # the rest
    others: list[tuple[Any, float]]  # of opaque faces: visible part, |cos| of the incidence


def neighbourhood(mesh: Mesh, camera: Camera, pose: FloatArray, face: int) -> Neighbourhood | None:
    """True polygons around a face, from the faces that overlap its surroundings.

    None for a lens that is no pinhole, whose image has no polygons.
    """
    if not camera.is_pinhole:
        return None
    from rastercov.reference.polygons import visible_polygons

    near = float(near_limit(camera, mesh.opaque.bounds, pose[None])[0])
    points = to_camera(mesh.vertices, pose)
    ahead = points[:, 2] >= near
    image = to_image(np.where(ahead[:, None], points, (0.0, 0.0, 1.0)), camera)
    corners, is_ahead = image[mesh.faces], ahead[mesh.faces]
    is_cut = np.logical_and(is_ahead.any(axis=1), ~is_ahead.all(axis=1))
    if is_cut[face]:
        box = (0.0, 0.0, float(max(camera.width, camera.height)))
    else:
        low, high = corners[face].min(axis=0), corners[face].max(axis=0)
        edge = (camera.width, camera.height)
        low, high = np.clip(low, 0, edge), np.clip(high, 0, edge)
        box = square((*low.tolist(), *high.tolist()), 1.35)
    low, high = np.array(box[:2]), np.array(box[:2]) + box[2]
    is_beyond = (corners.max(axis=1) < low).any(axis=1) | (corners.min(axis=1) > high).any(axis=1)
    kept = np.flatnonzero((~is_beyond & is_ahead.all(axis=1)) | is_cut)
    place = int(np.searchsorted(kept, face))
    if place == len(kept) or kept[place] != face:
        return None
    part = Mesh(mesh.vertices, mesh.faces[kept], mesh.groups, mesh.face_group[kept])
    asked = np.arange(len(kept)) if len(kept) <= MAX_FACES else np.array([place])
    try:
        alone = Mesh(vertices=mesh.vertices, faces=mesh.faces[[face]])
        outline = visible_polygons(alone, camera, pose, near=near)[0]
        shapes = visible_polygons(part, camera, pose, asked, near=near)
    except RastercovError:
        return None
    if outline.is_empty:
        return None
    seen = shapes[int(np.searchsorted(asked, place))]
    ray = part.centroids - pose[:3, 3]
    reach = np.maximum(np.linalg.norm(ray, axis=1), 1e-300)
    squarely = np.abs((part.normals * ray).sum(axis=1)) / reach
    others = [
        (shape, float(squarely[i]))
        for i, shape in zip(asked, shapes, strict=True)
        if i != place and not part.target_mask[i]
    ]
    return Neighbourhood(outline, seen, outline.difference(seen), others)


def square(bounds: Sequence[float], room: float) -> Box:
    """Square about a box (left, top, right, bottom), larger by a factor."""
    left, top, right, bottom = bounds
    side = max(right - left, bottom - top, 1e-9) * room
    return (left + right - side) / 2, (top + bottom - side) / 2, side


class Samples:
    """Sample positions of a rasteriser, see `raster.sample_grid`."""

    def __init__(self, camera: Camera, supersample: int, roll: float) -> None:
        grid = SampleGrid(camera, supersample, roll)
        angle = math.remainder(roll, math.pi / 2)
        self.supersample = supersample
        self._size = np.array((camera.width, camera.height), np.float64)
        self._centre = np.array((grid.width, grid.height)) / 2
        self._turn = np.array(
            ((math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle)))
        )

    def inside(self, box: Box) -> FloatArray:
        """Samples in a square part of the image, (N, 2) px."""
        left, top, side = box
        corners = np.array([(u, v) for u in (left, left + side) for v in (top, top + side)])
        places = self.supersample * (corners - self._size / 2) @ self._turn.T + self._centre
        low, high = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
        x, y = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True)))
        local = np.stack((x.ravel(), y.ravel()), axis=1) - self._centre
        points = local @ self._turn / self.supersample + self._size / 2
        least = np.maximum((left, top), 0.0)
        most = np.minimum((left + side, top + side), self._size)
        is_below, is_above = (points < least).any(axis=1), (points > most).any(axis=1)
        return points[~(is_below | is_above)]


def face_picture(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    of_face: FaceError,
    method: str,
    supersample: int = 1,
    roll: float | None = None,
) -> Image.Image | None:
    """Picture of a face and the figure of a method; None where nothing can be drawn.

    `supersample` and `roll` give the sample grid of the method; without `roll` only the borders of
    pixels are drawn.
    """
    around = neighbourhood(mesh, camera, pose, of_face.face)
    if around is None:
        return None
    canvas = Image.new("RGB", (SIDE * FINE, (SIDE + CAPTION) * FINE), PAPER)
    whole = square(around.image.bounds, 1.35)
    samples = None if roll is None else Samples(camera, supersample, roll)
    panel = _panel(around, whole, SIDE, samples)
    small = _worth_enlarging(around, whole, samples)
    if small is not None:
        _add_inset(panel, around, whole, small, samples)
    canvas.paste(panel, (0, 0))
    _write_caption(canvas, of_face, method, samples is not None)
    return canvas.reduce(FINE)


def _worth_enlarging(around: Neighbourhood, whole: Box, samples: Samples | None) -> Box | None:
    """Square around the visible or the hidden part where it is small or thin, else None."""
    least = 1e-6 * around.image.area
    parts = [part for part in (around.seen, around.hidden) if part.area > least]
    if not parts:
        return None
    part = min(parts, key=lambda shape: float(shape.area))
    # The largest piece; tiny ones elsewhere do not count.
    piece = max(getattr(part, "geoms", [part]), key=lambda shape: float(shape.area))
    thickness = 2 * piece.area / max(piece.length, 1e-12)
    if thickness > MAX_THICKNESS * whole[2]:
        return None
    box = square(piece.bounds, 1.6)
    if box[2] > 0.3 * whole[2]:
        # Long and thin: only a stretch of it, so that its width and a few samples can be seen.
        middle = piece.representative_point()
        side = 8 * thickness
        if samples is not None:
            side = max(side, 3 / samples.supersample)
        box = (middle.x - side / 2, middle.y - side / 2, side)
    return box if box[2] <= 0.3 * whole[2] else None


def _panel(around: Neighbourhood, box: Box, side: int, samples: Samples | None) -> Image.Image:
    """Draw a square part of the image, `side` pixels of the picture wide."""
    size = side * FINE
    zoom = size / box[2]
    panel = Image.new("RGB", (size, size), EMPTY)
    draw = ImageDraw.Draw(panel)
    for shape, squarely in around.others:
        grey = round(172 + 60 * squarely)
        _fill(draw, shape, box, zoom, (grey, grey, min(255, grey + 4)), OUTLINE, FINE)
    pixel = zoom / FINE
    if pixel >= MIN_PIXEL:
        _draw_pixels(panel, box, zoom)
    # Stripes: not every reader can distinguish the two colours.
    _paint(panel, around.seen, box, zoom, Image.new("RGB", panel.size, SEEN), 0.8)
    _paint(panel, around.hidden, box, zoom, _hidden_stripes(panel.size), 0.8)
    if pixel >= MIN_PIXEL:
        _draw_pixels(panel, box, zoom, 0.22)
    draw = ImageDraw.Draw(panel)
    _fill(draw, around.seen, box, zoom, None, SEEN_EDGE, 2 * FINE)
    _fill(draw, around.image, box, zoom, None, INK, 3 * FINE)
    if samples is not None:
        _draw_samples(draw, around, box, zoom, samples)
    _draw_scale(draw, box, zoom, size)
    return panel


def _fill(
    draw: ImageDraw.ImageDraw,
    shape: Any,
    box: Box,
    zoom: float,
    fill: Any,
    outline: Any,
    width: int,
) -> None:
    """Draw a polygon, or several, and their borders."""
    for points, is_hole in _rings(shape, box, zoom):
        if fill is not None and not is_hole:  # holes are empty, or filled by a later polygon
            draw.polygon(points, fill)
        if outline is not None:
            draw.line([*points, points[1]], outline, width, "curve")


def _rings(
    shape: object, box: Box, zoom: float
) -> Iterator[tuple[list[tuple[float, float]], bool]]:
    """Outlines of a polygon, or several, each followed by its holes; True for a hole."""
    for polygon in getattr(shape, "geoms", [shape]):
        if not polygon.is_empty and polygon.geom_type == "Polygon":
            for i, ring in enumerate((polygon.exterior, *polygon.interiors)):
                yield _placed(np.asarray(ring.coords), box, zoom), i > 0


def _placed(points: FloatArray, box: Box, zoom: float) -> list[tuple[float, float]]:
    """Image points as pixels of the picture, clipped far outside."""
    local = np.clip((points - box[:2]) * zoom, -1e6, 1e6)
    return [(x, y) for x, y in local.tolist()]


def _paint(
    panel: Image.Image, shape: object, box: Box, zoom: float, colours: Image.Image, share: float
) -> None:
    """Blend colours over a polygon; `share` is their opacity."""
    mask = Image.new("L", panel.size, 0)
    draw = ImageDraw.Draw(mask)
    for points, is_hole in _rings(shape, box, zoom):
        draw.polygon(points, 0 if is_hole else round(255 * share))
    panel.paste(colours, (0, 0), mask)


def _hidden_stripes(size: tuple[int, int]) -> Image.Image:
    """Diagonal stripes in the two colours of hidden parts."""
    is_dark = stripes((size[1], size[0]), 5 * FINE, 3)[..., None]
    return Image.fromarray(np.where(is_dark, HIDDEN_STRIPE, HIDDEN).astype(np.uint8))


def _draw_pixels(panel: Image.Image, box: Box, zoom: float, strength: float = 0.25) -> None:
    """Draw the borders of the pixels of the image."""
    mask = Image.new("L", panel.size, 0)
    draw = ImageDraw.Draw(mask)
    size = panel.size[0]
    for axis in (0, 1):
        start = box[axis]
        for border in range(math.ceil(start), math.floor(start + box[2]) + 1):
            at = (border - start) * zoom
            line = ((at, 0), (at, size)) if axis == 0 else ((0, at), (size, at))
            draw.line(line, round(255 * strength), FINE)
    panel.paste(Image.new("RGB", panel.size, PIXEL_BORDER), (0, 0), mask)


def _draw_samples(
    draw: ImageDraw.ImageDraw,
    around: Neighbourhood,
    box: Box,
    zoom: float,
    samples: Samples,
) -> None:
    """Draw samples: full on the visible face, hollow on its hidden part, small elsewhere."""
    import shapely

    spacing = zoom / samples.supersample / FINE
    if spacing < MIN_SPACING:
        return
    points = samples.inside(box)
    is_seen = shapely.contains_xy(around.seen, *points.T)
    is_on = shapely.contains_xy(around.image, *points.T)
    radius = min(6.0, max(2.2, spacing / 6)) * FINE
    for (x, y), on, seen in zip(_placed(points, box, zoom), is_on, is_seen, strict=True):
        if on:
            r = radius
            draw.ellipse((x - r, y - r, x + r, y + r), INK if seen else PAPER, INK, FINE * 3 // 2)
        else:
            r = radius / 2
            draw.ellipse((x - r, y - r, x + r, y + r), SAMPLE)


def _draw_scale(draw: ImageDraw.ImageDraw, box: Box, zoom: float, size: int) -> None:
    """Draw a bar with its length in pixels of the image, at the lower left."""
    most = 0.3 * box[2]
    power = 10.0 ** math.floor(math.log10(most))
    length = max(m * power for m in (1, 2, 5) if m * power <= most)
    font = ImageFont.load_default(17.0 * FINE)
    text = f"{length:g} px"
    left, bottom, bar = 14 * FINE, size - 14 * FINE, length * zoom
    room = max(bar, font.getlength(text)) + 16 * FINE
    place = (left - 8 * FINE, bottom - 34 * FINE, left - 8 * FINE + room, bottom + 8 * FINE)
    draw.rounded_rectangle(place, 5 * FINE, PAPER)
    draw.text((left, bottom - 18 * FINE), text, INK, font, anchor="lm")
    draw.rectangle((left, bottom - 4 * FINE, left + bar, bottom), INK)


def _add_inset(
    panel: Image.Image,
    around: Neighbourhood,
    whole: Box,
    small: Box,
    samples: Samples | None,
) -> None:
    """Enlarge a small part in the corner of the picture that overlaps the face least."""
    import shapely

    share = INSET / SIDE * whole[2]
    ends = [(x, y) for x in (0.0, whole[2] - share) for y in (0.0, whole[2] - share)]
    middle = small[0] + small[2] / 2, small[1] + small[2] / 2
    boxes = [
        shapely.box(whole[0] + x, whole[1] + y, whole[0] + x + share, whole[1] + y + share)
        for x, y in ends
    ]
    free = [i for i, b in enumerate(boxes) if not b.contains(shapely.Point(middle))]
    # The lower left has the scale bar.
    best = min(free, key=lambda i: (boxes[i].intersection(around.image).area, i == 1))
    x, y = (round(v / whole[2] * panel.size[0]) for v in ends[best])
    inset = _panel(around, small, INSET, samples)
    draw = ImageDraw.Draw(panel)
    zoom = panel.size[0] / whole[2]
    low, high = _placed(np.array([small[:2], np.array(small[:2]) + small[2]]), whole, zoom)
    grow = max(0.0, 5 * FINE - (high[0] - low[0]) / 2)
    frame = (low[0] - grow, low[1] - grow, high[0] + grow, high[1] + grow)
    centre = (x + inset.size[0] / 2, y + inset.size[1] / 2)
    draw.line(((frame[0] + frame[2]) / 2, (frame[1] + frame[3]) / 2, *centre), PAPER, 4 * FINE)
    draw.line(((frame[0] + frame[2]) / 2, (frame[1] + frame[3]) / 2, *centre), INK, 2 * FINE)
    draw.rectangle(frame, None, PAPER, 4 * FINE)
    draw.rectangle(frame, None, INK, 2 * FINE)
    panel.paste(inset, (x, y))
    draw.rectangle((x, y, x + inset.size[0], y + inset.size[1]), None, INK, 3 * FINE)


def _write_caption(canvas: Image.Image, of_face: FaceError, method: str, has_samples: bool) -> None:
    draw = ImageDraw.Draw(canvas)
    error = abs(of_face.value - of_face.truth)
    says = f"says {fraction(of_face.value)} ± {fraction(of_face.bound)}"
    lines = [
        f"{method}: face {of_face.face} in pose {of_face.pose}, {of_face.area:.3g} px^2",
        f"{says}, truth {fraction(of_face.truth)}, error {fraction(error)}",
    ]
    y = SIDE + 24.0
    font = ImageFont.load_default(21.0 * FINE)
    for text in lines:
        draw.text((14 * FINE, y * FINE), text, INK, font, anchor="lm")
        y += 32
    if not of_face.held:
        right = (SIDE - 14) * FINE
        draw.text((right, (SIDE + 24) * FINE), "bound broken", BROKEN, font, anchor="rm")
    font = ImageFont.load_default(18.0 * FINE)
    x, striped = 14.0, _hidden_stripes((20 * FINE, 20 * FINE))
    for name, swatch in (("seen", None), ("hidden", striped)):
        left, top = round(x * FINE), round((y - 10) * FINE)
        box = (left, top, left + 20 * FINE, top + 20 * FINE)
        if swatch is None:
            draw.rectangle(box, SEEN)
        else:
            canvas.paste(swatch, (left, top))
        draw.rectangle(box, None, INK, FINE)
        draw.text(((x + 27) * FINE, y * FINE), name, INK, font, anchor="lm")
        x += 27 + font.getlength(name) / FINE + 20
    if has_samples:
        for name, fill in (("sample on it, seen", INK), ("sample on it, hidden", PAPER)):
            box_ = ((x + 2) * FINE, (y - 6) * FINE, (x + 14) * FINE, (y + 6) * FINE)
            draw.ellipse(box_, fill, INK, FINE * 3 // 2)
            draw.text(((x + 22) * FINE, y * FINE), name, INK, font, anchor="lm")
            x += 22 + font.getlength(name) / FINE + 16


def fraction(value: float) -> str:
    """A visible fraction or its error in a few digits."""
    if value in (0.0, 1.0):
        return f"{value:.0f}"
    if 5e-4 <= value <= 1 - 5e-5:
        return f"{value:.4f}"
    return f"{value:.10g}" if value > 0.5 else f"{value:.1e}"
