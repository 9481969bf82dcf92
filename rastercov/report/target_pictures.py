"""Targets in pictures: translucent or hatched, with outlines, so that all behind them shows.

Over greys they are translucent. Over a surface in many hues they are hatched, since a mixture of
two hues would be a third one.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.report.theme import Pixels

OPACITY = 0.4
"""Of the nearest target at a pixel; others behind it do not show."""
OUTLINE = 0.9
"""Opacity of its outlines."""
TIE_REL = 1e-5
"""Depth by which a surface must be in front of a target to hide it, relative."""


def targets_in_view(
    mesh: Mesh, camera: Camera, pose: ArrayLike, depth: NDArray[np.float32]
) -> NDArray[np.int32] | None:
    """(H, W) nearest target at each pixel, -1 where there is none or a surface is in front of it.

    None for a mesh without targets. `depth`, (H, W), is that of the surfaces, as in a
    `VisibilityBuffer`.
    """
    if not mesh.has_targets:
        return None
    rows = np.flatnonzero(mesh.target_mask)
    part = Mesh(vertices=mesh.vertices, faces=mesh.faces[rows])
    with open_rasterizer(part, camera, "cpu") as rasterizer:
        image = rasterizer.render(pose)
    face = np.append(rows, -1).astype(np.int32)[image.face]
    with np.errstate(invalid="ignore"):  # inf where there is neither
        face[image.depth > depth * np.float32(1 + TIE_REL)] = -1
    return face


def lay_over(pixels: Pixels, targets: NDArray[np.int32], colours: Pixels) -> None:
    """Lay targets (H, W) over an image, in place, each face in its colour of (F, 3).

    Colours of shape (H, W, 3) are those of pixels.
    """
    share = np.where(targets >= 0, np.float32(OPACITY), np.float32(0))
    share[_outlines(targets)] = OUTLINE
    shown = targets >= 0
    opacity = share[shown, None]
    of_pixel = colours[shown] if colours.ndim == 3 else colours[targets[shown]]
    mixed = opacity * of_pixel + (1 - opacity) * pixels[shown]
    pixels[shown] = mixed.astype(np.uint8)


def hatch_over(pixels: Pixels, targets: NDArray[np.int32], colours: Pixels, width: int) -> None:
    """Hatch targets (H, W) over an image, in place, every other stripe in their own colours.

    `colours` are as for `lay_over`, stripes `width` pixels wide; between them is the image.
    """
    rows, columns = np.ogrid[: targets.shape[0], : targets.shape[1]]
    shown = (targets >= 0) & ((rows - columns) // width % 2 == 0)
    shown |= _outlines(targets)
    pixels[shown] = colours[shown] if colours.ndim == 3 else colours[targets[shown]]


def _outlines(targets: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(H, W) pixels of targets beside one of another target or of none."""
    found = np.zeros(targets.shape, np.bool_)
    for step in ((0, 1), (1, 0)):
        here = targets[: targets.shape[0] - step[0], : targets.shape[1] - step[1]]
        following = targets[step[0] :, step[1] :]
        found[: here.shape[0], : here.shape[1]] |= (here != following) & (here >= 0)
        found[step[0] :, step[1] :] |= (here != following) & (following >= 0)
    return found
