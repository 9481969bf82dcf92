"""Parts that all pictures share: frame, title and legend, labels, sheets, stripes, target layers.

Targets are hatched in their own colours, with outlines, so that all behind them shows: a mixture of
two colours would be a third one.
"""

import io
import math
import unicodedata
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw, ImageFont

from rastercov.base import (
    TINY,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    WholeArray,
    decimals_of,
    dots,
    norm,
)
from rastercov.base.output import writing
from rastercov.core.camera import Camera
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.topology import components_of
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import VisibilityBuffer
from rastercov.report.theme import (
    DARKEST,
    GREY_SPAN,
    INK,
    OF_CAMERA,
    OUTLINE_3D,
    PAPER,
    Colour,
    Pixels,
    in_the_dark,
    index_colours,
)

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
FaceImage = Int32Array
"""(H, W) face at each pixel, -1 for none."""
OwnColours = Callable[[FaceImage, IntArray], Pixels]
"""Colours (N, 3) of some pixels (N,) of a face image, row by row."""

LEAST_WIDTH = 320
"""Narrower images are enlarged by a whole factor, to make room for text."""
LEAST_FRAME = 720
"""Width that the font of a narrower picture suits, too."""
SMALLEST_TITLE = 0.75
"""Size of the font of a long title, relative to that of the legend, before it is cut."""
LEAST_WITH_LINES = 12
"""Pixels of a face from which on its creases are drawn."""
CREASE_DEG = 30.0
"""Angle between normals above which an edge is a crease."""
STEP_REL = 1e-3
"""Least step in depth that is drawn, relative to the depth."""
SHORTEST = 1 / 40
"""Least length of a line, with all that it meets, relative to the picture."""
WIDE = 960
"""Pixels above which lines are two pixels wide."""
LINE = 0.45
"""Brightness of a line, relative to its surface."""
HATCH_PERIOD, HATCH_PALE = 4, 0.45
"""Widths of a line of a hatch from one to the next; part of white in it."""
GAP = 5
"""Pixels between plates of labels, at the size of a page."""
MOST_ENLARGED = 3.2
"""Widths of a thumbnail that the font of its caption suits."""
DIRECTIONS, RINGS = 16, 14
"""Places that are tried around the point of a label: directions, and rings of them."""
TIE_REL = 1e-5
"""Depth by which a surface must be in front of a target to hide it, relative."""
KEPT_PARTS = 4
"""Parts of a mesh that are kept: a picture draws surfaces, targets, and faces behind occluders."""
_PARTS: WeakKeyDictionary[Mesh, dict[bytes, Mesh]] = WeakKeyDictionary()
"""Of each mesh, the parts that were drawn last: its next picture mostly has the same."""


def face_index_picture(buffer: VisibilityBuffer) -> Image.Image:
    """Picture with a colour for each face, the same in every picture, on black; (H, W) RGB.

    Faces whose indices are near each other, as neighbours on a surface tend to be, have colours
    far apart: at least 28 of 255 in some channel for indices less than 100 apart.
    """
    palette = np.zeros((int(buffer.face.max(initial=-1)) + 2, 3), np.uint8)
    palette[:-1] = index_colours(np.arange(len(palette) - 1))
    return Image.fromarray(palette[buffer.face])


def depth_picture(buffer: VisibilityBuffer) -> Image.Image:
    """Picture of depth, near bright and far dark, with its scale in metres; RGB.

    Grey is linear in camera z from the nearest to the furthest surface of this image, in 8 bits.
    The exact depths are in `buffer.depth`.
    """
    seen = np.isfinite(buffer.depth)
    depths = buffer.depth[seen].astype(np.float64)
    pixels = np.full((*buffer.depth.shape, 3), OF_CAMERA.background, np.uint8)
    keys = []
    if depths.size:
        near, far = depths.min(), depths.max()
        share = (depths - near) / max(far - near, TINY)
        pixels[seen] = greys(1 - share)
        digits = decimals_of(max(far - near, near * 1e-6))
        ends = f"{near:.{digits}f} m", f"{far:.{digits}f} m"
        keys = [Key.scale("depth", greys(np.linspace(1, 0, 256)), *ends)]
    return add_frame(pixels, "", keys)


def contact_sheet(
    pictures: Sequence[Image.Image],
    captions: Sequence[str],
    columns: int | None = None,
    thumbnail_width: int = 320,
) -> Image.Image:
    """Pictures side by side in reading order, each above its caption; RGB.

    Parameters
    ----------
    pictures : sequence of N PIL.Image.Image
        At least one, of any size.
    captions : sequence of N str
        Lines below each, cut to fit.
    columns : int, optional
        Pictures in a row; about as many as rows by default.
    thumbnail_width : int
        Width that each is scaled to, pixels.
    """
    columns = min(len(pictures), columns or math.ceil(math.sqrt(len(pictures))))
    thumbnails = []
    for picture in pictures:
        height = max(1, round(picture.height * thumbnail_width / picture.width))
        way = Image.Resampling.LANCZOS if picture.width > thumbnail_width else 0
        thumbnails.append(picture.convert("RGB").resize((thumbnail_width, height), way))
    # A page shows the whole sheet in a column.
    font = font_for(round(thumbnail_width * min(0.8 * columns, MOST_ENLARGED)))
    gap, line = max(4, thumbnail_width // 40), round(line_height(font) * 1.4)
    lines = [text.split("\n") for text in captions]
    below = line * max(map(len, lines)) + gap
    starts = range(0, len(thumbnails), columns)
    heights = [max(t.height for t in thumbnails[at : at + columns]) + below for at in starts]
    sheet = Image.new("RGB", (columns * (thumbnail_width + gap) + gap, sum(heights) + gap), PAPER)
    draw = ImageDraw.Draw(sheet)
    for index, (thumbnail, texts) in enumerate(zip(thumbnails, lines, strict=True)):
        row, column = divmod(index, columns)
        left, top = gap + column * (thumbnail_width + gap), gap + sum(heights[:row])
        sheet.paste(thumbnail, (left, top))
        for number, text in enumerate(texts):
            middle = (left, top + thumbnail.height + line // 2 + number * line)
            draw.text(middle, cut(text, font, thumbnail_width), INK, font, anchor="lm")
    return sheet


def save_picture(image: Image.Image, path: str | Path) -> None:
    """Write a picture as `.png`; it appears there only when it is whole."""
    with writing(Path(path)) as part:
        image.save(part, format="PNG", compress_level=3)  # half the time of 6, 7 % larger


def png(image: Image.Image, choice: Image.Quantize | None = None) -> bytes:
    """Content of a PNG file.

    A choice reduces the picture to 255 colours, which halves its size: the median cut keeps the
    soft edges of lines, the octree small areas of a colour of their own. Without one all colours
    are kept.
    """
    file = io.BytesIO()
    if choice is not None:
        image = image.quantize(255, choice, dither=Image.Dither.NONE)
    image.save(file, format="PNG")  # optimised it is 5 % smaller, in six times the time
    return file.getvalue()


def png_in_the_dark(content: bytes) -> bytes:
    """A PNG file in 255 colours as it is for a dark page: the same pixels, another palette."""
    at = content.index(b"PLTE")
    end = at + 4 + int.from_bytes(content[at - 4 : at])
    palette = np.frombuffer(content[at + 4 : end], np.uint8).reshape(-1, 3)
    chunk = b"PLTE" + in_the_dark(palette).tobytes()
    return content[:at] + chunk + zlib.crc32(chunk).to_bytes(4) + content[end + 4 :]


@dataclass(frozen=True, eq=False)
class Key:
    """Entry of a legend: a swatch or a scale, its meaning, and the ends of the scale.

    `colours` are those of a swatch, the one in its corner first; `hatch` is as in `reasons.Words`.
    """

    name: str
    pixels: Pixels
    low: str = ""
    high: str = ""
    colours: Sequence[Sequence[int]] = ()
    hatch: int = 0

    @classmethod
    def of(
        cls,
        name: str,
        colour: ArrayLike,
        stripe: ArrayLike | None = None,
        width: int = 6,
        period: int = 2,
        hatch: int = 0,
    ) -> "Key":
        """Entry for a colour, or for one striped with another, with a hatch."""
        colours = np.array([colour] if stripe is None else [colour, stripe], np.uint8)
        row = stripes((24, 24), width, period) & (len(colours) > 1)
        flat = colours[row.ravel().astype(np.int64)]
        pixels = hatch_pixels(
            flat, np.full(len(flat), hatch, np.uint8), np.arange(len(flat)), 24, 2
        )
        return cls(name, pixels.reshape(24, 24, 3), colours=colours.tolist(), hatch=hatch)

    @classmethod
    def of_reason(cls, name: str) -> "Key":
        """Entry for a reason, by its name."""
        words = REASONS[name]
        return cls.of(words.label, words.colour, hatch=words.hatch)

    @classmethod
    def scale(cls, name: str, colours: Pixels, low: str, high: str) -> "Key":
        """Entry for a scale of colours (N, 3) from its low end to its high one."""
        return cls(name, np.repeat(colours[None], 24, axis=0), low, high)


def target_key() -> Key:
    """Entry for targets, which are hatched along the other diagonal."""
    key = Key.of("targets are hatched this way, in their colours", OUTLINE_3D, PAPER, 4)
    return replace(key, pixels=key.pixels[:, ::-1])


def facing(mesh: Mesh, pose: ArrayLike) -> tuple[BoolArray, FloatArray]:
    """Mask of faces that show the camera a valid side, and |cos| of their incidence in [0, 1]."""
    ray = np.asarray(pose, np.float64)[:3, 3] - mesh.centroids
    reach = norm(ray)
    along = dots(mesh.normals, ray)
    cosine = along / np.maximum(reach, TINY)
    return (cosine >= 0) | mesh.two_sided_mask, np.minimum(np.abs(cosine), 1.0)


def greys(levels: ArrayLike) -> Pixels:
    """(..., 3) greys of levels of coverage in [0, 1], seen along the normal."""
    grey = np.rint(DARKEST + GREY_SPAN * np.asarray(levels, np.float64)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=-1)


def stripes(shape: tuple[int, int], width: int, period: int = 2) -> BoolArray:
    """Mask of diagonal stripes: `width` pixels each, one in `period` of them set."""
    diagonals = np.arange(sum(shape) - 1) // width % period == 1
    return np.lib.stride_tricks.sliding_window_view(diagonals, shape[1])


def hatch_pixels(
    colours: Pixels, hatch: ByteArray, at: IntArray, columns: int, width: int
) -> Pixels:
    """Colours (N, 3) of pixels with the paler lines of a hatch (N,), as in `reasons.Words`.

    The pixels are those `at` (N,) of a picture with some columns, row by row.
    """
    some = np.flatnonzero(hatch)
    row, column = np.array(np.divmod(at[some], columns)) % (HATCH_PERIOD * width)
    some = some[_marks(width)[hatch[some], row, column]]
    result = colours.copy()
    put(result, some, colours.take(some, axis=0) * (1 - HATCH_PALE) + 255 * HATCH_PALE)
    return result


@cache
def _marks(width: int) -> BoolArray:
    """(32, P, P) one period of each hatch."""
    period = HATCH_PERIOD * width
    row, column = np.ogrid[:period, :period]
    lines = np.stack([row + column, column - row, column + 0 * row, row + 0 * column])
    is_line = lines // width % HATCH_PERIOD == 0
    is_dot = np.maximum(row % period, column % period) < period / 2
    marks = np.stack([*is_line, is_dot])
    codes = np.arange(32)[:, None] >> np.arange(len(marks)) & 1 > 0
    return (codes[:, :, None, None] & marks).any(axis=1)


def put(
    pixels: Pixels, at: IntArray | BoolArray, colours: FloatArray | Float32Array | Pixels
) -> None:
    """Give pixels of a contiguous picture, `at` (N,) row by row, colours (N, 3), in place.

    In one piece each: numpy copies rows of three numbers at a third of this speed, and those of a
    mask `at` all, (H * W,), eight times as fast as by their numbers.
    """
    pixels.reshape(-1).view("V3")[at] = colours.astype(np.uint8).reshape(-1).view("V3")


def count_pixels(face: FaceImage, n: int) -> FloatArray:
    """(n,) number of pixels of each face of an image; those in a row are counted together."""
    flat = face.ravel()
    ends = np.append(np.flatnonzero(flat[1:] != flat[:-1]), flat.size - 1)
    return np.bincount(  # type: ignore[return-value] # with weights
        flat[ends] + 1, np.diff(ends, prepend=-1), n + 1
    )[1:]


def draw_lines(
    pixels: Pixels, face: Int32Array, mesh: Mesh, depth: Float32Array | None = None
) -> None:
    """Feature edges between neighbouring pixels of two faces, in place; never the triangulation.

    They are outlines, creases above `CREASE_DEG` between faces of at least `LEAST_WITH_LINES`
    pixels, and, with the depth, steps from a surface to one behind it. Colours too dark for a
    darker line get a lighter one.
    """
    flat, colours, width = face.ravel(), pixels.reshape(-1, 3), face.shape[1]
    # The index -1 of the background finds the last face, which changes nothing of its outline.
    is_large = count_pixels(face, mesh.n_faces) >= LEAST_WITH_LINES
    normals = mesh.normals.astype(np.float32)
    is_drawn = np.zeros(flat.size, bool)
    for step in (1, width):
        at = np.flatnonzero(flat[:-step] != flat[step:])
        if step == 1:
            at = at[(at + 1) % width > 0]
        one, other = flat[at], flat[at + step]
        cosine = dots(normals.take(one, 0, mode="wrap"), normals.take(other, 0, mode="wrap"))
        is_line = (one < 0) | (other < 0)
        is_line |= (
            (np.abs(cosine) < math.cos(math.radians(CREASE_DEG))) & is_large[one] & is_large[other]
        )
        if depth is not None:  # its reciprocal is linear on a plane
            places = at + np.array([-1, 0, 1, 2])[:, None] * step
            near = depth.ravel().take(places, mode="clip")
            before, jump, after = np.abs(np.diff(1 / near, axis=0))
            least = STEP_REL / np.minimum(*near[1:3])
            is_line |= jump > 3 * np.maximum(before, after) + least
        is_drawn[at[is_line]] = is_drawn[at[is_line] + step * (width > WIDE)] = True
    rows = _long(np.flatnonzero(is_drawn & (flat >= 0)), width)
    colour = colours[rows].astype(np.float32)
    is_dark = colour.mean(axis=1, keepdims=True) < 56
    colours[rows] = np.where(is_dark, colour + 40, LINE * colour).astype(np.uint8)


def _long(rows: IntArray, width: int) -> IntArray:
    """Pixels of lines without those of short ones, which are noise of scans; of some, sorted."""
    pairs = []
    for step in (1, width - 1, width, width + 1):
        next_one = np.minimum(np.searchsorted(rows, rows + step), len(rows) - 1)
        result = np.flatnonzero(rows[next_one] == rows + step)
        pairs.append(np.stack((result, next_one[result]), axis=1))
    line = components_of(len(rows), np.concatenate(pairs))
    return rows[np.bincount(line)[line] >= SHORTEST * width * (1 + (width > WIDE))]


def add_frame(pixels: Pixels, title: str, keys: Sequence[Key]) -> Image.Image:
    """Frame an image with its title above and its legend below."""
    height, width = pixels.shape[:2]
    zoom = max(1, min(-(-LEAST_WIDTH // width), 4096 // height))
    image = Image.fromarray(pixels).resize((zoom * width, zoom * height), 0)
    frame = max(LEAST_WIDTH, image.width)
    font = font_for(max(frame, LEAST_FRAME))
    line = line_height(font)
    bar, margin = round(line * 1.7), round(line * 0.6)
    room = frame - 2 * margin
    small = max(SMALLEST_TITLE, min(1.0, room / max(font.getlength(title), 1.0)))
    title_font = font_for(round(small * max(frame, LEAST_FRAME)))
    title = cut(title, title_font, room)
    top = bar if title else 0

    # Entries that do not fit in a row continue in the next.
    places, left, row = [], margin, 0
    for at, key in enumerate(keys := [*keys]):
        scale = (8 if key.high else 1) * line
        ends = (text for text in (key.low, key.high) if text)
        taken = scale + line * 0.5 + sum(font.getlength(text) + line * 0.5 for text in ends)
        keys[at] = replace(key, name=cut(key.name, font, room - taken))
        taken += font.getlength(keys[at].name)
        if left > margin and left + taken > room + margin:
            left, row = margin, row + 1
        places.append((left, row, scale))
        left += round(taken + line)
    bottom = (row + 1) * bar if keys else 0

    canvas = Image.new("RGB", (frame, top + image.height + bottom), PAPER)
    canvas.paste(image, ((frame - image.width) // 2, top))
    draw = ImageDraw.Draw(canvas)
    draw.text((margin, top / 2), title, INK, title_font, anchor="lm")
    for key, (left, row, scale) in zip(keys, places, strict=True):
        middle = top + image.height + bar * row + bar // 2
        x = float(left)
        for word in (key.low, None, key.high, key.name):
            if word is None:
                box = (round(x), middle - line // 2, round(x) + scale, middle - line // 2 + line)
                canvas.paste(Image.fromarray(key.pixels).resize((scale, line)), box)
                draw.rectangle(box, outline=INK)
                x += scale + line * 0.5
            elif word:
                draw.text((x, middle), drawable(word, font), INK, font, anchor="lm")
                x += font.getlength(word) + line * 0.5
    return canvas


def font_for(width: int) -> Font:
    """Font whose size suits an image of a width in pixels."""
    return ImageFont.load_default(float(np.clip(width / 50, 12, 72)))


def line_height(font: Font) -> int:
    """Height of a line, pixels."""
    return math.ceil(font.getbbox("Ag")[3])


def drawable(text: str, font: Font) -> str:
    """One line in letters that the font has: others like them, without their accents, or "?"."""
    box = bytes(font.getmask("\uffff"))  # of letters that it does not have

    def has(letter: str) -> bool:
        return letter.isprintable() and (letter.isascii() or bytes(font.getmask(letter)) != box)

    def drawn(letter: str) -> str:
        if has(letter):
            return letter
        return "".join(filter(has, unicodedata.normalize("NFKD", letter).strip())) or "?"

    text = unicodedata.normalize("NFC", " ".join(text.split())[:400])
    return "".join(map(drawn, text.translate(str.maketrans("\u2215µμ", "/uu"))))


def cut(text: str, font: Font, width: float) -> str:
    """One line of text, cut to fit."""
    text = drawable(text, font)
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "...") > width:
        text = text[:-1]
    return text + "..."


def place_labels(
    anchors: ArrayLike, sizes: ArrayLike, picture: tuple[int, int], beside: ArrayLike = False
) -> FloatArray:
    """Centres of labels that overlap no other and are within the picture, (N, 2).

    Each label is at its point, unless it is to be `beside` it, (N,), or on the first free place on
    rings around it, if possible where no plate is on a line; where all are taken, at its point.

    Parameters
    ----------
    anchors, sizes : (N, 2) array_like
        Points, and width and height of the labels, pixels.
    picture : (int, int)
        Width and height.
    """
    points, room = np.asarray(anchors, np.float64), np.asarray(sizes, np.float64)
    angles = 2 * np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    ring = np.stack((np.cos(angles), -np.sin(angles)), axis=1)
    placed, first = np.zeros_like(points), np.broadcast_to(beside, len(points)).astype(int)
    along = np.linspace(0, 1, DIRECTIONS)[:, None]
    for row, (point, size) in enumerate(zip(points, room, strict=True)):
        step = 0.5 * (size + size.min())
        before = points[:row, None] + along * (placed - points)[:row, None]
        best, placed[row] = 0, point
        for k in range(first[row], RINGS + 1):  # the first of the best
            places = point + k * step * ring
            inside = (places >= size / 2).all(axis=1) & (places <= picture - size / 2).all(axis=1)
            apart = np.abs(places[:, None] - placed[None, :row])
            is_free = (apart >= (room[:row] + size) / 2).any(axis=2).all(axis=1)
            lines = point + along * (places - point)[:, None]
            under = np.abs(lines[:, :, None] - placed[:row]) < room[:row] / 2
            over = np.abs(places[:, None, None] - before) < size / 2
            hidden = [each.all(axis=-1).any(axis=(1, 2)) for each in (under, over)]
            score = (inside & is_free) * (3 - np.sum(hidden, axis=0))
            if score.max() > best:
                best, placed[row] = score.max(), places[score.argmax()]
            if best == 3:
                break
    return placed


def write_labels(
    image: Image.Image,
    anchors: ArrayLike,
    names: Sequence[str],
    colours: Sequence[Colour],
    font: Font,
    fine: int,
    areas: ArrayLike = np.inf,
) -> None:
    """Write each name on a plate with a border of its colour, and a line to its point.

    Plates are beside what they name where it has less than twice their area, of `areas` (N,) px.
    """
    if not names:
        return
    draw, names = ImageDraw.Draw(image), [drawable(name, font) for name in names]
    boxes = np.array([draw.textbbox((0, 0), name, font, anchor="mm") for name in names])
    sizes = boxes[:, 2:] - boxes[:, :2] + np.array([9, 7]) * fine
    points = np.asarray(anchors, np.float64)
    is_small, gap = np.asarray(areas) < 2 * sizes.prod(axis=1), GAP * fine
    places = place_labels(points, sizes + gap, image.size, is_small)
    for point, place, size, colour in zip(points, places, sizes, colours, strict=True):
        if (np.abs(point - place) > size / 2).any():
            ends = [tuple(point.tolist()), tuple(place.tolist())]
            draw.line(ends, PAPER, 3 * fine)
            draw.line(ends, colour, round(1.5 * fine))
            draw.circle(point.tolist(), 2.5 * fine, colour, PAPER, fine)
    for place, size, name, colour in zip(places, sizes, names, colours, strict=True):
        low, high = (place - size / 2 + fine).tolist(), (place + size / 2 - fine).tolist()
        draw.rounded_rectangle((*low, *high), 3 * fine, PAPER, colour, round(1.5 * fine))
        draw.text(tuple(place.tolist()), name, INK, font, anchor="mm")


def draw_part(mesh: Mesh, camera: Camera, pose: ArrayLike, rows: IntArray) -> VisibilityBuffer:
    """Image of some faces of a mesh alone, on the CPU, with indices of the whole mesh."""
    if not len(rows):  # a scene of targets alone
        nothing = np.full((camera.height, camera.width), -1, np.int32)
        return VisibilityBuffer(nothing, np.full(nothing.shape, np.inf, np.float32))
    is_part = mesh.has_targets or len(rows) < mesh.n_faces  # targets of a mesh are not drawn
    part, key = mesh, rows.tobytes()
    if is_part:
        entry = _PARTS.get(mesh, {})  # taken once: another thread may put a part of its own there
        part = entry.get(key) or Mesh(vertices=mesh.vertices, faces=mesh.faces[rows])
        others = [each for each in entry.items() if each[0] != key]
        _PARTS[mesh] = dict([*others[1 - KEPT_PARTS :], (key, part)])
    with open_rasterizer(part, camera, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    if not is_part:
        return buffer
    return replace(buffer, face=np.append(rows, -1).astype(np.int32)[buffer.face])


def targets_in_view(
    mesh: Mesh, camera: Camera, pose: ArrayLike, depth: Float32Array
) -> Int32Array | None:
    """(H, W) nearest target at each pixel, -1 where there is none or a surface is in front of it.

    None for a mesh without targets. `depth`, (H, W), is that of the surfaces, as in a
    `VisibilityBuffer`.
    """
    if not mesh.has_targets:
        return None
    image = draw_part(mesh, camera, pose, np.flatnonzero(mesh.target_mask))
    is_hidden = image.depth > depth * np.float32(1 + TIE_REL)  # inf where there is neither
    return np.where(is_hidden, np.int32(-1), image.face)


def layers(
    mesh: Mesh, camera: Camera, pose: ArrayLike, buffer: VisibilityBuffer, task: IntArray
) -> tuple[Int32Array, Int32Array]:
    """Targets over an image, (H, W), and some evaluated faces behind occluders; -1 for none."""
    result = targets_in_view(mesh, camera, pose, buffer.depth)
    nothing = np.full_like(buffer.face, -1)
    targets = nothing if result is None else result
    if not len(task) or mesh.task_mask.all():
        return targets, nothing
    is_occluder = np.append(~mesh.task_mask, False)[buffer.face]
    behind = draw_part(mesh, camera, pose, task).face
    return targets, np.where(is_occluder, behind, np.int32(-1))


def hatch_over(pixels: Pixels, targets: Int32Array, own: OwnColours, width: int) -> None:
    """Hatch targets (H, W) over an image, in place, every other stripe in their own colours.

    Stripes are `width` pixels wide, and between them is the image.
    """
    rows, columns = np.ogrid[: targets.shape[0], : targets.shape[1]]
    at = np.flatnonzero((targets >= 0) & ((rows - columns) // width % 2 == 0))
    put(pixels, at, own(targets, at))
    pixels[outlines(np.minimum(targets, 0))] = OUTLINE_3D  # never the triangulation


def outlines(rows: WholeArray) -> BoolArray:
    """(H, W) pixels with a row, (H, W), beside one of another row or of none, -1."""
    is_border = np.zeros(rows.shape, bool)
    for row, border in ((rows, is_border), (rows.T, is_border.T)):
        differs = row[1:] != row[:-1]
        border[1:] |= differs
        border[:-1] |= differs
    return is_border & (rows >= 0)
