"""Pictures of a placement: segments, coverage, uncovered faces.

Each shows the part from two sides, in colours that its legend explains.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, figures 6.2
to 6.11.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov.base.errors import ConfigError
from rastercov.base.format import percent, plural
from rastercov.coverage.area.points import views_at
from rastercov.coverage.area.union import Covered
from rastercov.mesh import Mesh
from rastercov.report import theme
from rastercov.report.area_pictures import points_of_pixels
from rastercov.report.floor_plan import FloorPlan
from rastercov.report.images import Key, framed, stripes
from rastercov.report.panorama import (
    DIRECTIONS,
    FaceImage,
    Scene,
    best_directions,
    look,
    paint,
    smooth,
)
from rastercov.report.target_pictures import hatch_over
from rastercov.report.theme import Pixels

if TYPE_CHECKING:
    from rastercov.placement.candidates.segments import Segmentation
    from rastercov.placement.explain.uncovered import Leftover

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

ALL_SIDES = DIRECTIONS[[0, 5]]
"""Two opposite corners: every side of a box is in one of the two pictures."""


def segments_picture(mesh: Mesh, segmentation: "Segmentation") -> Image.Image:
    """The part with one colour a segment; figures 6.2 to 6.9."""
    if len(segmentation.labels) != mesh.n_faces:
        raise ConfigError(
            f"the segmentation has {len(segmentation.labels)} faces, the mesh {mesh.n_faces}; "
            "segment this mesh"
        )
    colours = neutral(mesh)
    inside = segmentation.labels >= 0
    colours[inside] = theme.index_colours(segmentation.labels[inside])
    beta = "" if segmentation.beta_deg is None else f", beta {segmentation.beta_deg:g}°"
    title = f"{segmentation.n_segments} segments (alpha {segmentation.alpha_deg:g}°{beta})"
    return two_sides(mesh, colours, title, [], ALL_SIDES)


def coverage_picture(mesh: Mesh, best: ArrayLike, eyes: ArrayLike = ()) -> Image.Image:
    """The part coloured by the best coverage of any camera, red where it is 0."""
    values = np.asarray(best, np.float64)
    scale = theme.coverage_colours()
    colours = scale[theme.colour_rows(mesh, values)]  # checks the shape
    colours[~mesh.task_mask] = theme.OCCLUDER_PALE
    zero = mesh.task_mask & (values <= 0)
    bar = np.repeat(scale[None, 2:], 24, axis=0)
    keys = [Key("best coverage of any camera", bar, "0", "1")]
    keys += [key("0 in every camera", tuple(scale[0]))] if zero.any() else []
    return two_sides(mesh, colours, "Best coverage of each face", keys, ALL_SIDES, zero, eyes)


def views_picture(covered: Covered, eyes: ArrayLike = ()) -> Image.Image:
    """The part coloured by the number of cameras that cover each point, up to the required one."""
    mesh, views = covered.mesh, len(covered.area)
    scale = theme.coverage_colours()
    levels = scale[theme.level_rows(np.arange(views + 1) / views)]
    keys = [key("covered by none", tuple(levels[0]))]
    keys += [
        key(f"by {n}" + (" or more" if n == views else ""), tuple(levels[n]))
        for n in range(1, views + 1)
    ]
    scenes = [look(mesh, direction, eyes=eyes) for direction in ALL_SIDES]
    images = []
    for scene in scenes:

        def own(face: FaceImage, scene: Scene = scene) -> Pixels:
            pixel = np.nonzero(np.append(mesh.task_mask, False)[face])
            points = points_of_pixels(mesh, scene.camera, scene.pose, face[pixel], *pixel)
            found = np.zeros((*face.shape, 3), np.uint8)
            found[pixel] = levels[views_at(covered, face[pixel], points)]
            return found

        images.append(smooth(Image.fromarray(paint(scene, neutral(mesh), own=own))))
    title = "Cameras that cover each point of the surface"
    return framed(beside(images), title, [*keys, *scene_keys(scenes)])


def leftover_picture(leftover: "Leftover", eyes: ArrayLike = ()) -> Image.Image:
    """Faces that no camera covers, by reason, from the directions that show most of them."""
    from rastercov.placement.explain.uncovered import WORDS  # loads all of placement

    mesh = leftover.mesh
    names, colours = leftover.reason_names(), neutral(mesh)
    summary = leftover.summary()
    share = summary["left"]
    keys = [key("covered", theme.COVERED)]
    for name, of_reason in sorted(summary["reasons"].items(), key=lambda item: -item[1]["faces"]):
        colours[names == name] = theme.REASONS[name]
        keys.append(key(f"{plural(of_reason['faces'], 'face')} {WORDS[name]}", theme.REASONS[name]))
    title = f"Not covered: {plural(share['faces'], 'face')}, "
    title += f"{percent(share['area_percent'] / 100)} of the area"
    directions = best_directions(mesh, leftover.left, eyes=eyes)
    return two_sides(mesh, colours, title, keys, directions, leftover.left, eyes)


def two_sides(
    mesh: Mesh,
    colours: Pixels,
    title: str,
    keys: Sequence[Key],
    directions: FloatArray,
    through: BoolArray | None = None,
    eyes: ArrayLike = (),
) -> Image.Image:
    """Two views side by side, with title and legend; faces of `through` show through the part."""
    scenes = [look(mesh, direction, eyes=eyes) for direction in directions]
    hidden = np.zeros(mesh.n_faces, np.bool_)
    if through is not None:
        drawn = np.concatenate([np.unique(scene.faces) for scene in scenes])
        hidden = through & ~np.isin(np.arange(mesh.n_faces), drawn)
    images = [smooth(Image.fromarray(paint(scene, colours, hidden))) for scene in scenes]
    keys = [*keys, *scene_keys(scenes)]
    if hidden.any():
        colour = colours[np.flatnonzero(hidden)[0]]
        keys = [*keys, key("hidden from both sides, shown through", theme.COVERED, stripe=colour)]
    return framed(beside(images), title, keys)


def beside(images: Sequence[Image.Image]) -> Pixels:
    """Pixels of pictures of equal height, side by side."""
    gap = np.full((images[0].height, 6, 3), theme.PAPER, np.uint8)
    parts = [np.asarray(images[0])]
    for image in images[1:]:
        parts += [gap, np.asarray(image)]
    return np.concatenate(parts, axis=1)


def neutral(mesh: Mesh) -> Pixels:
    """(F, 3) colours: the task in light grey, occluders in theirs."""
    colours = np.empty((mesh.n_faces, 3), np.uint8)
    colours[:] = theme.COVERED
    colours[~mesh.task_mask] = theme.OCCLUDER_PALE
    return colours


def key(name: str, colour: ArrayLike, stripe: ArrayLike | None = None) -> Key:
    """Entry of a legend for a colour, or for one striped with another."""
    swatch = np.empty((24, 24, 3), np.uint8)
    swatch[:] = np.asarray(colour)
    if stripe is not None:
        swatch[stripes((24, 24), 6)] = np.asarray(stripe)
    return Key(name, swatch)


def scene_keys(scenes: Sequence[Scene | FloorPlan]) -> list[Key]:
    """Entries for what several pictures may have: occluders, backs, targets."""
    keys = []
    if not scenes[0].mesh.task_mask.all():
        keys.append(key("occluder", theme.OCCLUDER_PALE))
    if any(scene.beneath is not None and (scene.beneath >= 0).any() for scene in scenes):
        keys.append(key("occluder in front of the task", theme.OCCLUDER_PALE, theme.COVERED))
    if any(scene.shows_backs() for scene in scenes):
        keys.append(key("back of the task, from here", theme.BACK, theme.BACK_STRIPE))
    if any(scene.targets is not None and (scene.targets >= 0).any() for scene in scenes):
        keys.append(target_key())
    return keys


def target_key() -> Key:
    """Entry for targets: hatched, with an outline."""
    swatch = np.empty((24, 24, 3), np.uint8)
    swatch[:] = theme.PAPER
    hatch_over(swatch, np.zeros((24, 24), np.int32), np.array([theme.OUTLINE_3D], np.uint8), 4)
    swatch[[0, 1, -2, -1]] = swatch[:, [0, 1, -2, -1]] = theme.OUTLINE_3D
    return Key("targets are hatched this way, in their colours", swatch)
