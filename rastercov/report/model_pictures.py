"""Pictures of one pose by several models, side by side in the grey scale of the thesis.

White is covered and black is not, as in figures 4.2 to 4.6 of E. S. Eissa. Image Space Coverage
Model. 2020. A third picture shows the difference of bivalent and graded occlusion in two hues; the
region where they differ most is enlarged.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rastercov.camera.camera import Camera
from rastercov.camera.image_boxes import image_boxes
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import VisibilityBuffer
from rastercov.report.images import (
    OPACITY,
    Key,
    contact_sheet,
    coverage_picture,
    coverage_pixels,
    framed,
    targets_in_view,
)
from rastercov.report.theme import ENLARGED, FALSELY_SEEN, MISSED

FloatArray = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""Left, top, right, bottom in pixels of the camera's image."""

WIDTH = 720
"""Pixels of a picture in a sheet of two or three."""
SMALL = 560
"""The same in a sheet of all models."""
MAX_ASPECT = 1.0
"""Largest height of a picture, relative to its width."""
MARGIN = 0.03
"""Margin around the part, relative to its size in the image."""
DETAIL = 0.28
"""Side of the enlarged region, relative to the picture."""
MIN_DIFFERENCE = 0.01
"""Difference below which a face keeps its grey."""


@dataclass(frozen=True, eq=False)
class Look:
    """A part of one pose's image at some size: its camera and its nearest faces."""

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    buffer: VisibilityBuffer


def look_at_part(mesh: Mesh, camera: Camera, pose: FloatArray, width: int = WIDTH) -> Look:
    """The part of the image that holds the mesh, `width` pixels wide."""
    return _look(mesh, camera, pose, _box_of(mesh, camera, pose), width)


def look_closer(mesh: Mesh, camera: Camera, pose: FloatArray, weights: FloatArray) -> Look:
    """The region of the image with the largest sum of weights (F,), enlarged."""
    whole = _box_of(mesh, camera, pose)
    look = _look(mesh, camera, pose, whole, WIDTH)
    height, width = look.buffer.face.shape
    weight = np.append(weights, 0.0)[look.buffer.face]
    side = max(8, round(DETAIL * width)), max(8, round(DETAIL * height))
    total = np.zeros((height + 1, width + 1))
    total[1:, 1:] = weight.cumsum(axis=0).cumsum(axis=1)
    across, down = min(side[0], width), min(side[1], height)
    sums = total[down:, across:] - total[:-down, across:] - total[down:, :-across]
    sums = sums + total[:-down, :-across]
    top, left = np.unravel_index(int(sums.argmax()), sums.shape)
    zoom = (whole[2] - whole[0]) / width
    corner = whole[0] + float(left) * zoom, whole[1] + float(top) * zoom
    box = (*corner, corner[0] + across * zoom, corner[1] + down * zoom)
    return _look(mesh, camera, pose, box, WIDTH)


def occlusion_sheet(
    whole: Look, closer: Look, bivalent: FloatArray, graded: FloatArray
) -> Image.Image:
    """Bivalent occlusion, graded occlusion and their difference, a row for each look.

    Parameters
    ----------
    whole, closer : Look
        All of one pose, and a region of it.
    bivalent, graded : (F,) float64
        Visible fraction of each face.
    """
    pictures, captions = [], []
    for look, more in zip((whole, closer), ("", ", enlarged"), strict=True):
        three = [
            coverage_picture(look.buffer, values, look.mesh, look.camera, look.pose)
            for values in (bivalent, graded)
        ]
        three.append(difference_picture(look, bivalent, graded))
        pictures += three if more else [_with_frame(each, whole, closer) for each in three]
        names = ("(a) bivalent occlusion", "(b) graded occlusion", "(c) where they differ")
        captions += [f"{name}{more}" for name in names]
    return _sheet(pictures, captions)


def difference_picture(look: Look, bivalent: FloatArray, graded: FloatArray) -> Image.Image:
    """The look in soft grey, with colour on faces whose bivalent and graded occlusion differ.

    The strength of the colour grows with the difference.
    """
    mesh = look.mesh
    shown = coverage_pixels(look.buffer, graded, mesh, look.pose, look.camera)
    pixels = 0.55 * shown + 0.45 * 205
    differs = np.append(np.where(mesh.task_mask, graded - bivalent, 0.0), 0.0)
    targets = targets_in_view(mesh, look.camera, look.pose, look.buffer.depth)
    layers = [(look.buffer.face, 1.0)] + ([] if targets is None else [(targets, OPACITY)])
    for face, opacity in layers:
        off = differs[face]
        for sign, colour in ((1, MISSED), (-1, FALSELY_SEEN)):
            rows = sign * off > MIN_DIFFERENCE
            strength = opacity * (0.35 + 0.65 * np.abs(off[rows])[:, None])
            pixels[rows] = (1 - strength) * pixels[rows] + strength * np.array(colour)
    keys = [
        Key("seen, but called hidden", _swatch(MISSED), "0", "1"),
        Key("hidden, but called seen", _swatch(FALSELY_SEEN), "0", "1"),
    ]
    return framed(pixels.astype(np.uint8), "", keys)


def models_sheet(look: Look, values: dict[str, FloatArray], captions: Sequence[str]) -> Image.Image:
    """Coverage by every model, side by side."""
    pictures = [
        coverage_picture(look.buffer, of_model, look.mesh, look.camera, look.pose)
        for of_model in values.values()
    ]
    return _sheet(pictures, captions)


def _sheet(pictures: Sequence[Image.Image], captions: Sequence[str]) -> Image.Image:
    """Pictures in rows of three, at their own size."""
    return contact_sheet(pictures, captions, 3, max(picture.width for picture in pictures))


def _with_frame(picture: Image.Image, look: Look, closer: Look) -> Image.Image:
    """Picture of a look with a frame around the region that another look enlarges."""
    if picture.width != look.camera.width:  # a narrow one, which `framed` has enlarged
        return picture
    zoom = look.camera.fx / closer.camera.fx
    left = look.camera.cx - closer.camera.cx * zoom
    top = look.camera.cy - closer.camera.cy * zoom
    box = (left, top, left + closer.camera.width * zoom, top + closer.camera.height * zoom)
    ImageDraw.Draw(picture).rectangle(box, outline=ENLARGED, width=3)
    return picture


def _box_of(mesh: Mesh, camera: Camera, pose: FloatArray) -> Box:
    """Bounding box of the mesh in the image with a margin; the image where there is none."""
    left, top, right, bottom = image_boxes(mesh.vertices, camera, pose[None])[0].tolist()
    if right <= left or bottom <= top:
        return 0.0, 0.0, float(camera.width), float(camera.height)
    margin = MARGIN * (right - left)
    return (
        max(0.0, left - margin),
        max(0.0, top - margin),
        min(float(camera.width), right + margin),
        min(float(camera.height), bottom + margin),
    )


def _look(mesh: Mesh, camera: Camera, pose: FloatArray, box: Box, width: int) -> Look:
    """Draw a part of the image, `width` pixels wide or `MAX_ASPECT * width` high."""
    across, down = box[2] - box[0], box[3] - box[1]
    scale = min(width / across, MAX_ASPECT * width / down)
    cut = replace(
        camera,
        width=max(1, round(across * scale)),
        height=max(1, round(down * scale)),
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx - box[0]) * scale,
        cy=(camera.cy - box[1]) * scale,
        skew=camera.skew * scale,
    )
    with open_rasterizer(mesh, cut, "cpu") as rasterizer:
        return Look(mesh, cut, pose, rasterizer.render(pose))


def _swatch(colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    """Ramp of a colour from its strength at a small difference to that at 1."""
    strength = np.linspace(0.35, 1.0, 256)[:, None]
    line = (1 - strength) * 205 + strength * np.array(colour)
    return np.broadcast_to(line.astype(np.uint8), (24, 256, 3)).copy()
