"""Pictures of a placement: segments, cameras around the part, coverage, uncovered faces.

Each shows the part from two sides, in colours that its legend explains.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, figures 6.2
to 6.11.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov._format import percent
from rastercov.area.regions import Regions
from rastercov.camera import Camera
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.placement.candidates.segments import Segmentation
from rastercov.placement.explain.uncovered import WORDS, Leftover
from rastercov.report import theme
from rastercov.report.area_pictures import SeenArea, best_and_views
from rastercov.report.images import Key, font_for, framed, stripes
from rastercov.report.panorama import (
    DIRECTIONS,
    FINE,
    Line,
    Scene,
    best_directions,
    draw_in_space,
    fill_in_space,
    look,
    paint,
    place_in_image,
    smooth,
)
from rastercov.report.theme import Colour, Pixels

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

ALL_SIDES = DIRECTIONS[[0, 5]]
"""Two opposite corners: every side of a box is in one of the two pictures."""
FRUSTUM = 0.16
"""Depth of a drawn frustum, relative to half the diagonal of the scene."""


def segments_picture(mesh: Mesh, segmentation: Segmentation) -> Image.Image:
    """The part with one colour a segment; figures 6.2 to 6.9."""
    if len(segmentation.labels) != mesh.n_faces:
        raise ConfigError(
            f"the segmentation has {len(segmentation.labels)} faces, the mesh {mesh.n_faces}; "
            "segment this mesh"
        )
    colours = _neutral(mesh)
    inside = segmentation.labels >= 0
    colours[inside] = theme.index_colours(segmentation.labels[inside])
    beta = "" if segmentation.beta_deg is None else f", beta {segmentation.beta_deg:g}°"
    title = f"{segmentation.n_segments} segments (alpha {segmentation.alpha_deg:g}°{beta})"
    return _two_sides(mesh, colours, title, _occluder_key(mesh, theme.OCCLUDER), ALL_SIDES)


def coverage_picture(mesh: Mesh, best: ArrayLike) -> Image.Image:
    """The part coloured by the best coverage of any camera, red where it is 0."""
    values = np.asarray(best, np.float64)
    scale = theme.coverage_colours()
    colours = scale[theme.colour_rows(mesh, values)]  # checks the shape
    zero = mesh.task_mask & (values <= 0)
    bar = np.repeat(scale[None, 2:], 24, axis=0)
    keys = [Key("best coverage of any camera", bar, "0", "1")]
    keys += [_key("0 in every camera", tuple(scale[0]))] if zero.any() else []
    keys += _occluder_key(mesh, tuple(scale[1]))
    return _two_sides(mesh, colours, "Best coverage of each face", keys, ALL_SIDES, zero)


def views_picture(mesh: Mesh, poses: ArrayLike, regions: Regions, views: int) -> Image.Image:
    """The part coloured by the number of cameras that cover each point, up to the required one."""
    matrices = np.asarray(poses, np.float64).reshape(-1, 4, 4)
    scale = theme.coverage_colours()
    levels = scale[theme.level_rows(np.arange(views + 1) / views)]
    keys = [_key("covered by none", tuple(levels[0]))]
    keys += [
        _key(f"by {n}" + (" or more" if n == views else ""), tuple(levels[n]))
        for n in range(1, views + 1)
    ]
    keys += _occluder_key(mesh, theme.OCCLUDER)
    images = []
    for direction in ALL_SIDES:
        scene = look(mesh, direction)
        _, counts = best_and_views(
            SeenArea(regions, matrices), scene.camera, scene.pose, scene.buffer
        )
        own = levels[np.minimum(counts, views)]
        images.append(smooth(Image.fromarray(paint(scene, _neutral(mesh), own=own))))
    return framed(_beside(images), "Cameras that cover each point of the surface", keys)


def leftover_picture(leftover: Leftover) -> Image.Image:
    """Faces that no camera covers, by reason, from the directions that show most of them."""
    mesh = leftover.mesh
    names, colours = leftover.reason_names(), _neutral(mesh)
    summary = leftover.summary()
    share = summary["left"]
    keys = [_key("covered", theme.COVERED)]
    for name, of_reason in sorted(summary["reasons"].items(), key=lambda item: -item[1]["faces"]):
        colours[names == name] = theme.REASONS[name]
        keys.append(_key(f"{of_reason['faces']:,} faces {WORDS[name]}", theme.REASONS[name]))
    keys += _occluder_key(mesh, theme.OCCLUDER)
    title = (
        f"Not covered: {share['faces']:,} faces, {percent(share['area_percent'] / 100)} of the area"
    )
    directions = best_directions(mesh, leftover.left)
    return _two_sides(mesh, colours, title, keys, directions, leftover.left)


def network_picture(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    best_pose: ArrayLike | None = None,
    names: Sequence[str] = (),
    regions: Regions | None = None,
) -> Image.Image:
    """The cameras of poses (K, 4, 4) around the part as view pyramids, figures 6.10 and 6.11.

    `best_pose`, (F,), is the camera that covers each face best and gives its colour, -1 for none;
    the labels of the cameras are 1, 2, ... unless K names are given. With `regions` of the poses,
    exactly the covered surface is coloured, by the camera with most pixels on it.
    """
    matrices = np.asarray(poses, np.float64).reshape(-1, 4, 4)
    count = len(matrices)
    of_camera = theme.camera_colours(count)
    colours = _neutral(mesh)
    keys: list[Key] = []
    swatch = np.repeat(np.repeat(of_camera[None, :4], 24, axis=0), 6, axis=1)
    if regions is not None:
        keys = [Key("covered, in the colour of the camera with most pixels", swatch)]
        keys.append(_key("covered by none", theme.UNCOVERED))
    elif best_pose is not None:
        best = np.asarray(best_pose)
        lit = mesh.task_mask & (best >= 0)
        colours[lit] = of_camera[best[lit]]
        colours[mesh.task_mask & (best < 0)] = theme.UNCOVERED
        keys = (
            [Key("each face in the colour of the camera that has it best", swatch)] if count else []
        )
        if (mesh.task_mask & (best < 0)).any():
            keys.append(_key("covered by none", theme.UNCOVERED))
    keys += _occluder_key(mesh, theme.OCCLUDER)
    corners = np.concatenate((mesh.bounds, matrices[:, :3, 3]))
    reach = FRUSTUM * float(np.linalg.norm(np.ptp(corners, axis=0))) / 2
    pyramids = [_pyramid(camera, pose, reach) for pose in matrices]
    more = np.concatenate([*pyramids, np.zeros((0, 3))])
    titles = names or [str(row + 1) for row in range(count)]
    images = []
    for direction in DIRECTIONS[:2]:
        scene = look(mesh, direction, more)
        own = None
        if regions is not None:
            best, _ = best_and_views(
                SeenArea(regions, matrices), scene.camera, scene.pose, scene.buffer
            )
            own = np.vstack((of_camera, theme.UNCOVERED)).astype(np.uint8)[best]
        image = Image.fromarray(paint(scene, colours, own=own))
        for pyramid, colour in zip(pyramids, of_camera.tolist(), strict=True):
            fill_in_space(image, scene, pyramid[1:], tuple(colour))
            draw_in_space(image, scene, _edges(pyramid, tuple(colour)))
        _write(image, scene, matrices[:, :3, 3], titles, of_camera)
        images.append(smooth(image))
    noun = "camera" if count == 1 else "cameras"
    return framed(_beside(images), f"{count} {noun}, seen from two sides", keys)


def _two_sides(
    mesh: Mesh,
    colours: Pixels,
    title: str,
    keys: Sequence[Key],
    directions: FloatArray,
    through: BoolArray | None = None,
) -> Image.Image:
    """Two views side by side, with title and legend; faces of `through` show through the part."""
    scenes = [look(mesh, direction) for direction in directions]
    hidden = np.zeros(mesh.n_faces, np.bool_)
    if through is not None:
        drawn = np.concatenate([np.unique(scene.faces) for scene in scenes])
        hidden = through & ~np.isin(np.arange(mesh.n_faces), drawn)
    images = [smooth(Image.fromarray(paint(scene, colours, hidden))) for scene in scenes]
    if any(scene.targets is not None and (scene.targets >= 0).any() for scene in scenes):
        keys = [*keys, _key("targets are translucent, with outlines", _translucent())]
    if hidden.any():
        colour = colours[np.flatnonzero(hidden)[0]]
        keys = [*keys, _key("hidden from both sides, shown through", theme.COVERED, stripe=colour)]
    return framed(_beside(images), title, keys)


def _beside(images: Sequence[Image.Image]) -> Pixels:
    """Pixels of pictures of equal height, side by side."""
    gap = np.full((images[0].height, 6, 3), theme.PAPER, np.uint8)
    parts = [np.asarray(images[0])]
    for image in images[1:]:
        parts += [gap, np.asarray(image)]
    return np.concatenate(parts, axis=1)


def _neutral(mesh: Mesh) -> Pixels:
    """(F, 3) colours: the task in light grey, occluders in theirs."""
    colours = np.empty((mesh.n_faces, 3), np.uint8)
    colours[:] = theme.COVERED
    colours[~mesh.task_mask] = theme.OCCLUDER
    return colours


def _key(name: str, colour: ArrayLike, stripe: ArrayLike | None = None) -> Key:
    swatch = np.empty((24, 24, 3), np.uint8)
    swatch[:] = np.asarray(colour)
    if stripe is not None:
        swatch[stripes((24, 24), 6)] = np.asarray(stripe)
    return Key(name, swatch)


def _translucent() -> Pixels:
    """Swatch of a target: two pale colours with an outline."""
    swatch = np.empty((24, 24, 3), np.uint8)
    swatch[:, :12], swatch[:, 12:] = theme.COVERED, theme.EXTERIOR
    swatch[[0, 1, -2, -1]] = swatch[:, [0, 1, -2, -1]] = theme.OUTLINE_3D
    return swatch


def _occluder_key(mesh: Mesh, colour: ArrayLike) -> list[Key]:
    return [] if mesh.task_mask.all() else [_key("occluder", colour)]


def _pyramid(camera: Camera, pose: FloatArray, reach: float) -> FloatArray:
    """(5, 3) camera centre and the corners of its image; the edges are `reach` long."""
    u = np.array([0, camera.width, camera.width, 0]) - camera.cx
    v = np.array([0, 0, camera.height, camera.height]) - camera.cy
    rays = np.stack((u / camera.fx, v / camera.fy, np.ones(4)), axis=1)
    # The same length for every field of view.
    rays *= reach / np.linalg.norm(rays, axis=1).max()
    corners: FloatArray = rays @ pose[:3, :3].T + pose[:3, 3]
    return np.concatenate((pose[None, :3, 3], corners))


def _edges(pyramid: FloatArray, colour: Colour) -> list[Line]:
    """The eight edges of a view pyramid; the upper edge of its base is the widest."""
    points = [tuple(point) for point in pyramid.tolist()]
    lines = [Line(points[0], corner, colour, 1.6) for corner in points[1:]]
    for row in range(4):
        lines.append(Line(points[1 + row], points[1 + (row + 1) % 4], colour, 1.6 if row else 4.0))
    return lines


def _write(
    image: Image.Image, scene: Scene, eyes: FloatArray, names: Sequence[str], colours: Pixels
) -> None:
    """Label each camera in a box with a border of its colour."""
    draw = ImageDraw.Draw(image)
    font = font_for(round(FINE * (850 if len(names) <= 30 else 500)))
    for (x, y), name, colour in zip(place_in_image(scene, eyes), names, colours, strict=True):
        left, top, right, bottom = draw.textbbox((x, y), name, font, anchor="mm")
        plate = (left - 3 * FINE, top - 2 * FINE, right + 3 * FINE, bottom + 2 * FINE)
        draw.rounded_rectangle(plate, 3 * FINE, theme.PAPER, tuple(colour.tolist()), FINE)
        draw.text((x, y), name, theme.INK, font, anchor="mm")
