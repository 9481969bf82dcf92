"""Floor plan of a network: the scene from straight above, to scale, with its cameras.

The projection is orthographic. An interior is cut open below its roof: at the height of the highest
camera, and without faces that turn down. Each camera is at its number, with its view pyramid from
above, whose sides enclose its horizontal field of view where it is level.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.report.images import draw_lines, shade, stripes
from rastercov.report.interiors import is_enclosed, turned_away
from rastercov.report.panorama import (
    FINE,
    HEIGHT,
    LEAST_LIGHT,
    MARGIN,
    WIDTH,
    FaceImage,
    OwnColours,
    task_points,
)
from rastercov.report.target_pictures import hatch_over
from rastercov.report.theme import BACK, BACK_STRIPE, EXTERIOR, WALL_LINE, Pixels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FOOT = 34
"""Height of the strip below the plan, for its scale bar, pixels."""
ABOVE_REL = 1e-3
"""Height of the cut above the highest camera, relative to the height of the scene."""
UPRIGHT = 0.02
"""Vertical part of the normal up to which a face is a line of the plan."""
MOST_LINES = 20_000
"""Upright faces that are drawn."""


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """An orthographic view from above: the drawn faces, and the place of each pixel.

    Attributes
    ----------
    face, height : (H, W) int32, (H, W) float64
        Face at each pixel, and its z in metres; -inf where there is none.
    targets : (H, W) int32 or None
        Target at each pixel that no drawn surface is above.
    beneath : (H, W) int32 or None
        Task face below an occluder at each pixel.
    scale : float
        Pixels a metre.
    corner : (2,) float64
        x and y of the upper left corner of the picture, metres.
    cut : float or None
        z at which an interior is cut.
    """

    mesh: Mesh
    face: FaceImage
    height: FloatArray
    targets: FaceImage | None
    beneath: FaceImage | None
    scale: float
    corner: FloatArray
    cut: float | None

    def shows_task(self) -> NDArray[np.bool_]:
        """(H, W) pixels of a task face or a target."""
        found: NDArray[np.bool_] = np.append(self.mesh.task_mask, False)[self.face]
        for layer in (self.targets, self.beneath):
            if layer is not None:
                found = found | (layer >= 0)
        return found

    def backs(self) -> NDArray[np.bool_]:
        """(F,) task faces that are seen from behind from above."""
        mesh = self.mesh
        is_down = (mesh.normals[:, 2] < 0) & ~mesh.two_sided_mask & ~mesh.target_mask
        found: NDArray[np.bool_] = mesh.task_mask & is_down
        return found

    def shows_backs(self) -> bool:
        """True if a task face is seen from behind."""
        layers = [self.face] if self.beneath is None else [self.face, self.beneath]
        backs = np.append(self.backs(), False)
        return any(bool(backs[layer].any()) for layer in layers)

    def places(self, points: ArrayLike) -> FloatArray:
        """(N, 2) positions of points (N, 2 or 3) in the picture, pixels."""
        away = np.asarray(points, np.float64)[:, :2] - self.corner
        found: FloatArray = away * np.array([self.scale, -self.scale])
        return found

    def points(self, face: FaceImage) -> tuple[NDArray[np.int32], FloatArray, tuple[IntArray, ...]]:
        """Faces (N,) and points (N, 3) at the pixels of a face image, with rows and columns."""
        rows, columns = np.divmod(np.flatnonzero(face >= 0), face.shape[1])
        faces, normals = face[rows, columns], self.mesh.normals[face[rows, columns]]
        x = self.corner[0] + (columns + 0.5) / self.scale
        y = self.corner[1] - (rows + 0.5) / self.scale
        first = self.mesh.vertices[self.mesh.faces[faces, 0]]
        with np.errstate(all="ignore"):
            slope = normals[:, 0] * (x - first[:, 0]) + normals[:, 1] * (y - first[:, 1])
            z = first[:, 2] - np.nan_to_num(slope / normals[:, 2])
        return faces, np.stack((x, y, z), axis=1), (rows, columns)


def floor_plan(mesh: Mesh, eyes: ArrayLike, more: ArrayLike = (), scale: float = FINE) -> FloorPlan:
    """Draw the faces of a mesh from above, so that its task, the cameras and more points fit in.

    Parameters
    ----------
    mesh : Mesh
        Scene with z up.
    eyes, more : (P, 3), (N, 2) array_like
        Cameras, and other places that must be in the picture.
    scale : float
        Pixels drawn along one of the picture.
    """
    cameras = np.asarray(eyes, np.float64).reshape(-1, 3)
    others = np.asarray(more, np.float64).reshape(-1, 2)
    framed = np.concatenate((task_points(mesh)[:, :2], cameras[:, :2], others))
    low, high = framed.min(axis=0), framed.max(axis=0)
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    size = np.array([width, height - FOOT * scale])
    radius = max(float(np.linalg.norm(np.ptp(framed, axis=0))), 1e-12)
    per_metre = float(((1 - 2 * MARGIN) * size / np.maximum(high - low, 1e-3 * radius)).min())
    middle = (low + high) / 2
    corner = middle + size / per_metre / 2 * np.array([-1, 1])
    bounds = mesh.bounds
    cut, rows = None, np.arange(mesh.n_faces)
    above = bounds.mean(axis=0)
    above[2] += 1e6 * max(float(np.linalg.norm(np.ptp(bounds, axis=0))), 1e-12)
    if is_enclosed(mesh, cameras):
        cut = float(cameras[:, 2].max() + ABOVE_REL * np.ptp(bounds[:, 2]))
        rows = np.flatnonzero(~turned_away(mesh, above, cameras))
    surfaces = rows[~mesh.target_mask[rows]]
    image = _Upright(width, height, per_metre, middle, size / 2, bounds[:, 2])
    face, z = image.drawn(mesh, surfaces, cut)
    targets = None
    if mesh.has_targets:
        targets, target_z = image.drawn(mesh, np.flatnonzero(mesh.target_mask), None)
        slack = 1e-5 * max(float(np.ptp(bounds[:, 2])), 1e-12)
        targets = np.where(target_z >= z - slack, targets, -1).astype(np.int32)
    beneath = None
    of_task = surfaces[mesh.task_mask[surfaces]]
    if len(of_task) < len(surfaces):
        is_occluder = np.append(~mesh.task_mask, False)[face]
        beneath = np.where(is_occluder, image.drawn(mesh, of_task, cut)[0], -1).astype(np.int32)
    return FloorPlan(mesh, face, z, targets, beneath, per_metre, corner, cut)


def paint_plan(plan: FloorPlan, own: OwnColours) -> Image.Image:
    """Picture of a plan with the colours of its points, and lines for upright faces."""
    pixels = _painted(plan, plan.face, own)
    if plan.beneath is not None and (plan.beneath >= 0).any():
        shown = (plan.beneath >= 0) & ~stripes(plan.face.shape, 2 * FINE, 3)
        pixels[shown] = _painted(plan, plan.beneath, own)[shown]
    if plan.targets is not None:
        hatch_over(pixels, plan.targets, own(plan.targets), 3 * FINE)
    image = Image.fromarray(pixels)
    _draw_walls(image, plan)
    return image


def _painted(plan: FloorPlan, face: FaceImage, own: OwnColours) -> Pixels:
    """Pixels of the opaque faces of one image."""
    mesh = plan.mesh
    light = LEAST_LIGHT + (1 - LEAST_LIGHT) * np.abs(mesh.normals[:, 2])
    pixels = np.empty((*face.shape, 3), np.uint8)
    pixels[:] = EXTERIOR
    shade(pixels, own(face), face, light, face >= 0)
    behind = np.append(plan.backs(), False)[face]
    pixels[behind] = BACK
    pixels[behind & stripes(face.shape, 3 * FINE)] = BACK_STRIPE
    draw_lines(pixels, face, mesh.n_faces)
    return pixels


def outline(points: FloatArray) -> FloatArray:
    """Convex hull of points (N, 2), counter-clockwise from the lowest of the leftmost.

    A. M. Andrew. Another Efficient Algorithm for Convex Hulls in Two Dimensions. 1979.
    """
    order = np.unique(points, axis=0)
    chains: list[FloatArray] = []
    for row in (order, order[::-1]):
        chain: list[FloatArray] = []
        for point in row:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-1] - chain[-2], point - chain[-2]
                if ax * by - ay * bx > 0:
                    break
                chain.pop()
            chain.append(point)
        chains += chain[:-1]
    return np.array(chains) if chains else order


@dataclass(frozen=True)
class _Upright:
    """Image from above by a perspective rasteriser.

    The map (x, y, z) -> (x, -y, 1) / w with w = 1 + (z - low) / (high - low) keeps planes, and the
    perspective image of its result is the orthographic image: u = x, v = -y, 1 / depth = w.
    """

    width: int
    height: int
    scale: float
    middle: FloatArray
    centre: FloatArray
    z: FloatArray

    def drawn(self, mesh: Mesh, rows: IntArray, cut: float | None) -> tuple[FaceImage, FloatArray]:
        """Face of each pixel, of some faces below a height, and their z."""
        vertices, index, of = mesh.vertices, mesh.faces[rows], rows
        if cut is not None:
            corners, part = below(vertices[index], cut)
            of = rows[part]
            vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        nothing = np.full((self.height, self.width), -1, np.int32)
        if not len(of):
            return nothing, np.full(nothing.shape, -np.inf)
        low, span = self.z[0], max(float(np.ptp(self.z)), 1e-30)
        w = 1 + (vertices[:, 2] - low) / span
        unit = self.width / self.scale  # coordinates of about 1, whatever the scene's size
        flat = (vertices[:, :2] - self.middle) / unit
        placed = np.stack((flat[:, 0], -flat[:, 1], np.ones_like(w)), axis=-1) / w[:, None]
        part_mesh = Mesh(vertices=placed, faces=index.reshape(-1, 3))
        focal = self.scale * unit
        camera = Camera(
            width=self.width, height=self.height, fx=focal, fy=focal,
            cx=float(self.centre[0]), cy=float(self.centre[1]),
        )  # fmt: skip
        with open_rasterizer(part_mesh, camera, "cpu") as rasterizer:
            buffer = rasterizer.render(np.eye(4))
        face = np.append(of, -1).astype(np.int32).take(buffer.face, mode="wrap")
        z, at = np.full(face.shape, -np.inf), np.flatnonzero(face >= 0)
        z.ravel()[at] = low + span * (1 / buffer.depth.ravel()[at].astype(np.float64) - 1)
        return face, z


def below(corners: FloatArray, cut: float) -> tuple[FloatArray, IntArray]:
    """Parts of triangles (N, 3, 3) below a height, (M, 3, 3), and the triangle of each, (M,)."""
    z = corners[..., 2] - cut
    n_above = (z > 0).sum(axis=1)
    whole = np.flatnonzero(n_above == 0)
    parts, of = [corners[whole]], [whole]
    for count in (1, 2):
        rows = np.flatnonzero(n_above == count)
        if not len(rows):
            continue
        # The corner that is alone on its side comes first.
        lone = z[rows] > 0 if count == 1 else z[rows] <= 0
        turn = (lone.argmax(axis=1)[:, None] + np.arange(3)) % 3
        own = np.take_along_axis(corners[rows], turn[..., None], axis=1)
        height = np.take_along_axis(z[rows], turn, axis=1)
        shares = height[:, :1] / (height[:, :1] - height[:, 1:])
        cuts = own[:, :1] + shares[..., None] * (own[:, 1:] - own[:, :1])
        if count == 2:
            parts.append(np.stack((own[:, 0], cuts[:, 0], cuts[:, 1]), axis=1))
            of.append(rows)
        else:
            parts.append(np.stack((cuts[:, 0], own[:, 1], own[:, 2]), axis=1))
            parts.append(np.stack((cuts[:, 0], own[:, 2], cuts[:, 1]), axis=1))
            of += [rows, rows]
    return np.concatenate(parts), np.concatenate(of)


def _draw_walls(image: Image.Image, plan: FloorPlan) -> None:
    """Draw upright faces as lines, unless a surface is above them."""
    mesh = plan.mesh
    is_upright = np.abs(mesh.normals[:, 2]) < UPRIGHT
    rows = np.flatnonzero(is_upright & ~mesh.target_mask & ~mesh.degenerate_mask)
    corners = mesh.vertices[mesh.faces[rows]]
    if plan.cut is not None:
        corners = corners[corners[..., 2].min(axis=1) < plan.cut]
    corners = corners[:MOST_LINES]
    along = np.einsum("nki,ni->nk", corners[..., :2], _tangents(corners))
    each = np.arange(len(corners))
    ends = np.stack([corners[each, at, :2] for at in (along.argmin(1), along.argmax(1))], axis=1)
    places = np.rint(plan.places(ends.reshape(-1, 2))).reshape(-1, 4)
    top = corners[..., 2].max(axis=1)
    slack = 1e-3 * max(float(np.ptp(mesh.bounds[:, 2])), 1e-12)
    height, width = plan.face.shape
    draw = ImageDraw.Draw(image)
    for row in np.unique(places, axis=0, return_index=True)[1].tolist():
        line = places[row].reshape(2, 2)
        (j, i), reach = line.mean(axis=0).astype(int).tolist(), 2
        if not (0 <= j < width and 0 <= i < height):
            continue
        around = plan.height[max(0, i - reach) : i + reach + 1, max(0, j - reach) : j + reach + 1]
        if around.min() <= top[row] + slack:
            draw.line([tuple(end) for end in line.tolist()], WALL_LINE, FINE)


def _tangents(corners: FloatArray) -> FloatArray:
    """(N, 2) horizontal directions of upright triangles, with x or else y above 0."""
    sides = (np.roll(corners, -1, axis=1) - corners)[..., :2]
    longest = np.einsum("nki,nki->nk", sides, sides).argmax(axis=1)
    chosen = sides[np.arange(len(corners)), longest]
    is_reversed = (chosen[:, 0] < 0) | ((chosen[:, 0] == 0) & (chosen[:, 1] < 0))
    found: FloatArray = np.where(is_reversed[:, None], -chosen, chosen)
    return found
