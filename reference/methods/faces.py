"""Close-up of one face of a comparison: its visible and hidden parts, and the samples over it.

The polygons are the truth by `rastercov.reference.polygons`.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from rastercov.base import FloatArray, RastercovError, frozen_record
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.reference.methods.error_statistics import FaceError
from rastercov.reference.pages import LIGHT, new_axes
from rastercov.reference.polygons import images_of, visible_in
from rastercov.reference.samples import grid_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Box = tuple[float, float, float]
"""Square part of the image: left, top, side, px."""
MAX_FACES = 800
"""Largest number of faces that are drawn around one: more are slow and cannot be read."""
MAX_PIXELS = 40
"""Largest side of a picture, in pixels of the image, with their borders."""
MAX_SAMPLES = 90
"""Largest number of samples across a picture that are drawn."""
HEIGHT = 6.6
"""Of a picture, inches."""


@frozen_record
class Neighbourhood:
    """True polygons of the faces around one face."""

    image: BaseGeometry  # the part of the face inside the image
    seen: BaseGeometry  # its visible part
    hidden: BaseGeometry  # the rest
    others: list[BaseGeometry]  # visible parts of other faces


def neighbourhood(mesh: Mesh, camera: Camera, pose: FloatArray, face: int) -> Neighbourhood | None:
    """True polygons around a face; None where it has no image, or there are no polygons."""
    if camera.is_curved:
        return None
    images = images_of(mesh, camera, pose)
    image = images.polygons[face]
    if image.is_empty:
        return None
    tree = shapely.STRtree(images.polygons)
    left, top, side = square(image.bounds)
    near = np.sort(tree.query(shapely.box(left, top, left + side, top + side)))
    asked = near if len(near) <= MAX_FACES else np.array([face])
    try:
        shapes = dict(zip(asked.tolist(), visible_in(images, tree, asked), strict=True))
    except RastercovError:
        return None
    seen = shapes.pop(face)
    others = [shape for other, shape in shapes.items() if not mesh.target_mask[other]]
    return Neighbourhood(image, seen, image.difference(seen), others)


def square(bounds: Sequence[float]) -> Box:
    """Square about a box (left, top, right, bottom), a third larger."""
    left, top, right, bottom = bounds
    side = 1.35 * max(right - left, bottom - top, 1e-9)
    return (left + right - side) / 2, (top + bottom - side) / 2, side


def face_picture(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    of_face: FaceError,
    method: str,
    supersample: int = 1,
    roll: float | None = None,
) -> "Figure | None":
    """Picture of a face and the figure of a method; None where nothing can be drawn.

    `supersample` and `roll` give the sample grid of the method, which has none without `roll`.
    """
    around = neighbourhood(mesh, camera, pose, of_face.face)
    if around is None:
        return None
    error = fraction(abs(of_face.value - of_face.truth))
    title = (
        f"{method}: face {of_face.face} in pose {of_face.pose}, {of_face.area:.3g} "
        f"px²{'' if of_face.held else ', BOUND VIOLATED'}\n{fraction(of_face.value)} ± "
        f"{fraction(of_face.bound)}, reference {fraction(of_face.truth)}, error {error}"
    )
    left, top, side = square(around.image.bounds)
    figure, axes = new_axes(title, LIGHT, HEIGHT)
    axes.set(xlim=(left, left + side), ylim=(top + side, top), aspect="equal")
    axes.ticklabel_format(useOffset=False)
    if side <= MAX_PIXELS:
        axes.set_xticks(range(math.ceil(left), math.floor(left + side) + 1), minor=True)
        axes.set_yticks(range(math.ceil(top), math.floor(top + side) + 1), minor=True)
        axes.grid(which="minor", color=LIGHT.soft, linewidth=0.4)
        axes.set_axisbelow(False)
        axes.xaxis.remove_overlapping_locs = axes.yaxis.remove_overlapping_locs = False
    for shape in around.others:
        _add(axes, shape, facecolor=LIGHT.grid, edgecolor=LIGHT.paper)
    _add(axes, around.seen, facecolor="#14a37f", label="visible")
    _add(axes, around.hidden, facecolor="#f0803c", edgecolor="#c2571a", hatch="//", label="hidden")
    _add(axes, around.image, facecolor="none", edgecolor=LIGHT.ink, linewidth=2)
    if roll is not None and side * supersample <= MAX_SAMPLES:
        points = grid_points(camera, supersample, roll, (left, top, left + side, top + side))
        is_seen = shapely.contains_xy(around.seen, *points.T)
        is_hidden = shapely.contains_xy(around.image, *points.T) & ~is_seen
        axes.plot(*points[~is_seen & ~is_hidden].T, ".", color=LIGHT.soft, markersize=2)
        kinds = (is_seen, LIGHT.ink, "visible"), (is_hidden, "white", "hidden")
        for of_kind, fill, name in kinds:
            where = points[of_kind].T
            axes.plot(*where, "o", color=LIGHT.ink, mfc=fill, ms=5, label=f"sample, {name}")
    figure.legend(loc="outside lower left", ncols=4, frameon=False)
    return figure


def _add(axes: "Axes", shape: BaseGeometry, **style: object) -> None:
    """Draw a polygon, or several."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    polygons = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    rings = [ring for part in polygons for ring in (part.exterior, *part.interiors)]
    paths = [Path(np.asarray(ring.coords), closed=True) for ring in rings]
    if paths:
        axes.add_patch(PathPatch(Path.make_compound_path(*paths), **style))


def fraction(value: float) -> str:
    """A visible fraction or its error in a few digits."""
    if value in (0.0, 1.0):
        return f"{value:.0f}"
    if 5e-4 <= value <= 1 - 5e-5:
        return f"{value:.4f}"
    return f"{value:.10g}" if value > 0.5 else f"{value:.1e}"
