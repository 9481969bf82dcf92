"""Picture of one face of a comparison: what is seen of it, what is hidden, and the samples over it.

Part of `page`. What is drawn is the truth, by the polygons of `rastercov.reference`, at
whatever zoom fills the picture; a small part of the face that matters is enlarged in an inset.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.validation.methods.closeup import Box, Neighbourhood, Samples, neighbourhood, square
from rastercov.validation.methods.results import FaceError

FloatArray = NDArray[np.float64]

SIDE, CAPTION = 640, 132
"""Size of the picture and of the words below it, pixels."""
FINE = 3
"""Pixels drawn for one of those."""
INSET = 250
"""Side of the inset."""
PAPER, INK, WARN = "#ffffff", "#1b2129", "#c0182b"
SEEN, HIDDEN, STRIPE = "#14a37f", "#f0803c", "#c2571a"
NOTHING, OUTLINE = "#dfe6ee", "#fafbfc"
THIN = 0.03
"""Of the side of the picture: what is thinner than this is enlarged."""
LEAST_SPACING = 7
"""Pixels of the picture between samples below which they are not drawn."""
LEAST_PIXEL = 14
"""Pixels of the picture a pixel of the image below which its border is not drawn."""


def face_picture(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    of_face: FaceError,
    method: str,
    supersample: int = 1,
    roll: float | None = None,
) -> Image.Image | None:
    """Picture of a face beside the figure of a method; None where there is nothing to draw.

    Parameters
    ----------
    mesh, camera
        The scene.
    pose : (4, 4) float64
        world_from_camera.
    of_face : FaceError
        The face and what was said of it.
    method : str
        Who said it.
    supersample, roll
        Its samples, if it has any; without, the borders of pixels are drawn.
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
    return canvas.resize((SIDE, SIDE + CAPTION), Image.Resampling.BOX)


def _worth_enlarging(around: Neighbourhood, whole: Box, samples: Samples | None) -> Box | None:
    """The surroundings of what is seen, or of what is hidden, where it is small or thin."""
    least = 1e-6 * around.image.area
    parts = [part for part in (around.seen, around.hidden) if part.area > least]
    if not parts:
        return None
    part = min(parts, key=lambda shape: float(shape.area))
    # The largest piece, in case there are crumbs elsewhere.
    piece = max(getattr(part, "geoms", [part]), key=lambda shape: float(shape.area))
    thickness = 2 * piece.area / max(piece.length, 1e-12)
    if thickness > THIN * whole[2]:
        return None
    box = square(piece.bounds, 1.6)
    if box[2] > 0.3 * whole[2]:
        # Long and thin: only a stretch of it, so that its width is seen, and a few samples.
        middle = piece.representative_point()
        side = 8 * thickness
        if samples is not None:
            side = max(side, 3 / samples.supersample)
        box = (middle.x - side / 2, middle.y - side / 2, side)
    return box if box[2] <= 0.3 * whole[2] else None


def _panel(around: Neighbourhood, box: Box, side: int, samples: Samples | None) -> Image.Image:
    """A square part of the image, `side` pixels of the picture wide."""
    size = side * FINE
    zoom = size / box[2]
    panel = Image.new("RGB", (size, size), NOTHING)
    draw = ImageDraw.Draw(panel)
    for shape, squarely in around.others:
        grey = round(172 + 60 * squarely)
        _fill(draw, shape, box, zoom, (grey, grey, min(255, grey + 4)), OUTLINE, FINE)
    pixel = zoom / FINE
    if pixel >= LEAST_PIXEL:
        _draw_pixels(panel, box, zoom)
    # Hidden parts in stripes: the colours alone are not told apart by everybody.
    _paint(panel, around.seen, box, zoom, Image.new("RGB", panel.size, SEEN), 0.8)
    _paint(panel, around.hidden, box, zoom, _stripes(panel.size), 0.8)
    if pixel >= LEAST_PIXEL:
        _draw_pixels(panel, box, zoom, 0.22)
    draw = ImageDraw.Draw(panel)
    _fill(draw, around.seen, box, zoom, None, "#0a5a46", 2 * FINE)
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
    for polygon in getattr(shape, "geoms", [shape]):
        if polygon.is_empty or polygon.geom_type != "Polygon":
            continue
        for i, ring in enumerate((polygon.exterior, *polygon.interiors)):
            points = _placed(np.asarray(ring.coords), box, zoom)
            if fill is not None and i == 0:  # what fills a hole is drawn over it, or it is empty
                draw.polygon(points, fill)
            if outline is not None:
                draw.line([*points, points[1]], outline, width, "curve")


def _placed(points: FloatArray, box: Box, zoom: float) -> list[tuple[float, float]]:
    """Image points as pixels of the picture; far outside they stay just outside."""
    local = np.clip((points - box[:2]) * zoom, -1e6, 1e6)
    return [(x, y) for x, y in local.tolist()]


def _paint(
    panel: Image.Image, shape: Any, box: Box, zoom: float, colours: Image.Image, share: float
) -> None:
    """Cover a polygon with colours that what is below shines through."""
    mask = Image.new("L", panel.size, 0)
    draw = ImageDraw.Draw(mask)
    for polygon in getattr(shape, "geoms", [shape]):
        if polygon.is_empty or polygon.geom_type != "Polygon":
            continue
        draw.polygon(_placed(np.asarray(polygon.exterior.coords), box, zoom), round(255 * share))
        for ring in polygon.interiors:
            draw.polygon(_placed(np.asarray(ring.coords), box, zoom), 0)
    panel.paste(colours, (0, 0), mask)


def _stripes(size: tuple[int, int]) -> Image.Image:
    """Diagonal stripes in the two colours of what is hidden."""
    rows, columns = np.ogrid[: size[1], : size[0]]
    is_dark = (rows + columns) // (5 * FINE) % 3 == 0
    colours = [tuple(int(text[i : i + 2], 16) for i in (1, 3, 5)) for text in (HIDDEN, STRIPE)]
    pixels = np.where(is_dark[..., None], colours[1], colours[0])
    return Image.fromarray(pixels.astype(np.uint8))


def _draw_pixels(panel: Image.Image, box: Box, zoom: float, strength: float = 0.25) -> None:
    """Borders of the pixels of the image."""
    mask = Image.new("L", panel.size, 0)
    draw = ImageDraw.Draw(mask)
    size = panel.size[0]
    for axis in (0, 1):
        start = box[axis]
        for border in range(math.ceil(start), math.floor(start + box[2]) + 1):
            at = (border - start) * zoom
            line = ((at, 0), (at, size)) if axis == 0 else ((0, at), (size, at))
            draw.line(line, round(255 * strength), FINE)
    panel.paste(Image.new("RGB", panel.size, "#31455c"), (0, 0), mask)


def _draw_samples(
    draw: ImageDraw.ImageDraw,
    around: Neighbourhood,
    box: Box,
    zoom: float,
    samples: Samples,
) -> None:
    """Samples: full where the face is seen, hollow where it is hidden, small elsewhere."""
    import shapely

    spacing = zoom / samples.supersample / FINE
    if spacing < LEAST_SPACING:
        return
    points = samples.inside(box)
    is_seen = shapely.contains_xy(around.seen, *points.T)
    is_on = shapely.contains_xy(around.image, *points.T)
    radius = min(6.0, max(2.2, spacing / 6)) * FINE
    for (x, y), on, seen in zip(_placed(points, box, zoom), is_on, is_seen, strict=True):
        if on:
            r = radius
            draw.ellipse(
                (x - r, y - r, x + r, y + r), INK if seen else "#ffffff", INK, FINE * 3 // 2
            )
        else:
            r = radius / 2
            draw.ellipse((x - r, y - r, x + r, y + r), "#6d7987")


def _draw_scale(draw: ImageDraw.ImageDraw, box: Box, zoom: float, size: int) -> None:
    """A bar with its length in pixels of the image, at the lower left."""
    most = 0.3 * box[2]
    power = 10.0 ** math.floor(math.log10(most))
    length = max(m * power for m in (1, 2, 5) if m * power <= most)
    font = ImageFont.load_default(17.0 * FINE)
    words = f"{length:g} px"
    left, bottom, bar = 14 * FINE, size - 14 * FINE, length * zoom
    room = max(bar, font.getlength(words)) + 16 * FINE
    place = (left - 8 * FINE, bottom - 34 * FINE, left - 8 * FINE + room, bottom + 8 * FINE)
    draw.rounded_rectangle(place, 5 * FINE, PAPER)
    draw.text((left, bottom - 18 * FINE), words, INK, font, anchor="lm")
    draw.rectangle((left, bottom - 4 * FINE, left + bar, bottom), INK)


def _add_inset(
    panel: Image.Image,
    around: Neighbourhood,
    whole: Box,
    small: Box,
    samples: Samples | None,
) -> None:
    """Enlarge a small part in the corner of the picture that holds least of the face."""
    import shapely

    share = INSET / SIDE * whole[2]
    ends = [(x, y) for x in (0.0, whole[2] - share) for y in (0.0, whole[2] - share)]
    middle = small[0] + small[2] / 2, small[1] + small[2] / 2
    boxes = [
        shapely.box(whole[0] + x, whole[1] + y, whole[0] + x + share, whole[1] + y + share)
        for x, y in ends
    ]
    free = [i for i, b in enumerate(boxes) if not b.contains(shapely.Point(middle))]
    # The scale bar stands at the lower left.
    best = min(free, key=lambda i: (boxes[i].intersection(around.image).area, i == 1))
    x, y = (round(v / whole[2] * panel.size[0]) for v in ends[best])
    inset = _panel(around, small, INSET, samples)
    draw = ImageDraw.Draw(panel)
    zoom = panel.size[0] / whole[2]
    low, high = _placed(np.array([small[:2], np.array(small[:2]) + small[2]]), whole, zoom)
    grow = max(0.0, 5 * FINE - (high[0] - low[0]) / 2)
    frame = (low[0] - grow, low[1] - grow, high[0] + grow, high[1] + grow)
    centre = (x + inset.size[0] / 2, y + inset.size[1] / 2)
    draw.line(((frame[0] + frame[2]) / 2, (frame[1] + frame[3]) / 2, *centre), "#ffffff", 4 * FINE)
    draw.line(((frame[0] + frame[2]) / 2, (frame[1] + frame[3]) / 2, *centre), INK, 2 * FINE)
    draw.rectangle(frame, None, "#ffffff", 4 * FINE)
    draw.rectangle(frame, None, INK, 2 * FINE)
    panel.paste(inset, (x, y))
    draw.rectangle((x, y, x + inset.size[0], y + inset.size[1]), None, INK, 3 * FINE)


def _write_caption(canvas: Image.Image, of_face: FaceError, method: str, has_samples: bool) -> None:
    draw = ImageDraw.Draw(canvas)
    error = abs(of_face.value - of_face.truth)
    says = f"says {fraction(of_face.value)} ± {fraction(of_face.bound)}"
    lines = [
        (f"{method}: face {of_face.face} in pose {of_face.pose}, {of_face.area:.3g} px^2", 21, INK),
        (f"{says}, truth {fraction(of_face.truth)}, error {fraction(error)}", 21, INK),
    ]
    y = SIDE + 24.0
    for words, size, colour in lines:
        font = ImageFont.load_default(float(size * FINE))
        draw.text((14 * FINE, y * FINE), words, colour, font, anchor="lm")
        y += 32
    if not of_face.held:
        font = ImageFont.load_default(21.0 * FINE)
        right = (SIDE - 14) * FINE
        draw.text((right, (SIDE + 24) * FINE), "bound broken", WARN, font, anchor="rm")
    font = ImageFont.load_default(18.0 * FINE)
    x, stripes = 14.0, _stripes((20 * FINE, 20 * FINE))
    for name, swatch in (("seen", None), ("hidden", stripes)):
        box = (
            round(x * FINE),
            round((y - 10) * FINE),
            round((x + 20) * FINE),
            round((y + 10) * FINE),
        )
        if swatch is None:
            draw.rectangle(box, SEEN)
        else:
            canvas.paste(swatch, box[:2])
        draw.rectangle(box, None, INK, FINE)
        draw.text(((x + 27) * FINE, y * FINE), name, INK, font, anchor="lm")
        x += 27 + font.getlength(name) / FINE + 20
    if has_samples:
        for name, fill in (("sample on it, seen", INK), ("sample on it, hidden", "#ffffff")):
            box_ = ((x + 2) * FINE, (y - 6) * FINE, (x + 14) * FINE, (y + 6) * FINE)
            draw.ellipse(box_, fill, INK, FINE * 3 // 2)
            draw.text(((x + 22) * FINE, y * FINE), name, INK, font, anchor="lm")
            x += 22 + font.getlength(name) / FINE + 16


def fraction(value: float) -> str:
    """A visible fraction or its error in a few digits."""
    if value in (0.0, 1.0):
        return f"{value:.0f}"
    return (
        f"{value:.4f}"
        if 5e-4 <= value <= 1 - 5e-5
        else f"{value:.10g}"
        if value > 0.5
        else f"{value:.1e}"
    )
