"""Picture of the dead zones of a network: numbered, each in the colour of its reason, exact."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov.base.format import area, percent, signed
from rastercov.coverage.area.points import zones_at
from rastercov.coverage.area.zones import DeadZones
from rastercov.coverage.reasons import REASONS
from rastercov.mesh import Mesh
from rastercov.report import theme
from rastercov.report.images import Key, font_for, framed, stripes, write_labels
from rastercov.report.panorama import (
    FINE,
    PIXELS_AT_A_TIME,
    FaceImage,
    Scene,
    beside,
    best_directions,
    drawn_faces,
    look,
    neutral,
    outer_skin,
    paint,
    scene_keys,
    smooth,
)
from rastercov.report.theme import Colour, Pixels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST = 30
"""Zones with a number."""
LEAST_PERCENT = 0.01
"""Part of the task, in percent, from which a zone has one."""


def numbered(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The zones of a summary that have a number in the picture and in the list: 1, 2, ..."""
    zones = summary.get("dead_zones", ())
    return [zone for zone in zones if zone["percent"] >= LEAST_PERCENT][:MOST]


def zone_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the list: number, area, share of the task, place, groups, reason; and the rest."""
    shown = numbered(summary)
    digits = _digits(summary)
    rows = []
    for number, zone in enumerate(shown, start=1):
        first, *others = zone["groups"]
        why = REASONS[zone["reason"]].label
        if zone["hidden_by"] is not None:
            why += f" by {'itself' if zone['hidden_by'] == first else zone['hidden_by']}"
        place = ", ".join(signed(value, digits) for value in zone["centroid"])
        rows.append(
            [
                str(number),
                area(zone["area_m2"]),
                percent(zone["percent"] / 100),
                place,
                first + (f" and {len(others)} more" if others else ""),
                why,
            ]
        )
    unlisted = summary.get("dead_zones", ())[len(shown) :]
    count = len(unlisted) + summary["other_dead_zones"]["zones"]
    if count:
        parts = [*unlisted, summary["other_dead_zones"]]
        square_metres = sum(part["area_m2"] for part in parts)
        share = sum(part["percent"] for part in parts) / 100
        rows.append([f"{count:,} more", area(square_metres), percent(share), "", "", ""])
    return rows


def _digits(summary: Mapping[str, Any]) -> int:
    """Decimals of places: three digits of the largest extent."""
    ends = [zone["extent"] for zone in summary.get("dead_zones", ())]
    far = max([float(np.abs(end).max()) for end in ends], default=1.0)
    return int(np.clip(2 - np.floor(np.log10(max(far, 1e-9))), 0, 9))


def zones_picture(
    zones: DeadZones, summary: Mapping[str, Any], eyes: ArrayLike = ()
) -> Image.Image:
    """The dead zones by exact pieces, from the two directions that show most of them.

    Parameters
    ----------
    zones : DeadZones
        Zones, the largest first.
    summary : mapping
        `rastercov.coverage.area.zones.summary_of` of them.
    eyes : (P, 3) array_like
        Cameras, as for `look`.
    """
    mesh, listed = zones.mesh, numbered(summary)
    colours = [theme.REASONS[zone["reason"]] for zone in listed]
    faces = np.zeros(mesh.n_faces, np.bool_)
    faces[zones.face[zones.zone < max(1, len(listed))]] = True
    faces &= ~outer_skin(mesh, eyes)
    directions = best_directions(mesh, faces, eyes=eyes)
    scenes = [look(mesh, direction, eyes=eyes) for direction in directions]
    views = [ZoneView(zones, scene, len(listed)) for scene in scenes]
    seen = np.zeros(len(listed) + 1, np.bool_)
    for view in views:
        for layer in view.scene.layers:
            found = view.numbers(layer)
            seen[found[found >= 0]] = True
    is_skin = outer_skin(mesh, eyes)[zones.face]
    inside = np.unique(zones.zone[~is_skin])
    unseen = np.flatnonzero(~seen[: len(listed)])
    hidden = unseen[np.isin(unseen, inside)]
    outside = unseen[~np.isin(unseen, inside)]
    pictures = [_drawn(view, colours, hidden) for view in views]
    keys = [Key.of("covered", theme.COVERED)]
    drawn = [zone["reason"] for row, zone in enumerate(listed) if row not in outside]
    for reason in dict.fromkeys(drawn):
        keys.append(Key.of(REASONS[reason].label, theme.REASONS[reason]))
    if len(zones) > len(listed):
        keys.append(Key.of("smaller zones, without a number", theme.UNCOVERED))
    if len(hidden):
        stripe = colours[hidden[0]]
        keys.append(Key.of("hidden from both sides, shown through", theme.COVERED, stripe))
    percents = [part["percent"] for part in (*summary["dead_zones"], summary["other_dead_zones"])]
    count = f"{len(zones):,} dead zone{'' if len(zones) == 1 else 's'}"
    share = percent(min(1.0, round(sum(percents) / 100, 9)))
    title = f"{count}, {share} of the area; numbered from the largest"
    if len(outside):
        numbers = ", ".join(str(row + 1) for row in outside.tolist())
        title += f"; not drawn, on the outside of the building: {numbers}"
    return framed(beside(pictures), title, [*keys, *scene_keys(scenes)])


class ZoneView:
    """Zones at the pixels of one view; each layer of faces is asked once.

    Parameters
    ----------
    zones : DeadZones
        Zones, the largest first.
    scene : Scene
        The view.
    n : int
        Zones with a number.
    """

    def __init__(self, zones: DeadZones, scene: Scene, n: int) -> None:
        self.zones, self.scene, self.n = zones, scene, n
        self._found: list[tuple[FaceImage, IntArray]] = []

    def numbers(self, face: FaceImage) -> IntArray:
        """(H, W) zone at each pixel: its row, n for those without a number, -1 for none."""
        for layer, known in self._found:
            if layer is face:
                return known
        mesh, scene = self.zones.mesh, self.scene
        found = np.full(face.shape, -1, np.int64)
        is_task = np.append(mesh.task_mask, False)[face]
        of_pixel, points, pixel = scene.points(np.where(is_task, face, np.int32(-1)))
        zone = np.full(len(points), -1, np.int64)
        for at in range(0, len(points), PIXELS_AT_A_TIME):
            part = slice(at, at + PIXELS_AT_A_TIME)
            zone[part] = zones_at(self.zones, of_pixel[part], points[part], self.n)
        found[pixel] = zone
        self._found.append((face, found))
        return found


def _drawn(view: ZoneView, colours: Sequence[Colour], hidden: IntArray) -> Image.Image:
    """One view of the zones, with their numbers."""
    zones, scene, n = view.zones, view.scene, view.n
    mesh = zones.mesh
    table = np.array([*colours, theme.UNCOVERED, theme.COVERED], np.uint8)

    def own(face: FaceImage) -> Pixels:
        return _coloured(mesh, face, table[view.numbers(face)])

    pixels = paint(scene, neutral(mesh), own=own)
    shown = view.numbers(scene.face)
    for layer in scene.layers[1:]:
        of_layer = view.numbers(layer)
        shown = np.where(of_layer >= 0, of_layer, shown)
    if len(hidden):
        faces = np.unique(zones.face[np.isin(zones.zone, hidden)]).astype(np.int64)
        behind = view.numbers(drawn_faces(scene, faces)).copy()
        behind[~np.isin(behind, hidden)] = -1
        through = (behind >= 0) & stripes(behind.shape, 3 * FINE)
        pixels[through] = table[behind[through]]
        shown = np.where(behind >= 0, behind, shown)
    _outline(pixels, shown, n)
    image = Image.fromarray(pixels)
    rows = [row for row in range(n) if (shown == row).any()]
    places = [_middle(shown == row) for row in rows]
    names = [str(row + 1) for row in rows]
    write_labels(
        image, np.array(places).reshape(-1, 2), names, [colours[row] for row in rows],
        font_for(round(FINE * 850)), FINE,
    )  # fmt: skip
    return smooth(image)


def _coloured(mesh: Mesh, face: FaceImage, colours: Pixels) -> Pixels:
    """Colours of points, where an occluder keeps its own."""
    colours[np.append(~mesh.task_mask, False)[face]] = theme.OCCLUDER_PALE
    return colours


def _outline(pixels: Pixels, zone: IntArray, n: int) -> None:
    """Draw the borders between zones with a number, in place."""
    for step in ((0, 1), (1, 0)):
        here = zone[: zone.shape[0] - step[0], : zone.shape[1] - step[1]]
        other = zone[step[0] :, step[1] :]
        is_numbered = ((here >= 0) & (here < n)) | ((other >= 0) & (other < n))
        rows, columns = np.nonzero((here != other) & is_numbered)
        pixels[rows, columns] = theme.INK


def _middle(mask: NDArray[np.bool_]) -> FloatArray:
    """Place (x, y) of the pixel of a mask that is furthest from its outline, in city blocks."""
    rows, columns = np.nonzero(mask.any(axis=1))[0], np.nonzero(mask.any(axis=0))[0]
    top, left = rows[0], columns[0]
    layer = np.pad(mask[top : rows[-1] + 1, left : columns[-1] + 1], 1)
    depth = np.where(layer, sum(layer.shape), 0)
    # City blocks add up along the axes: the least along one, then along the other.
    for axis in (0, 1):
        steps = np.arange(layer.shape[axis]).reshape((-1, 1) if axis == 0 else (1, -1))
        back = np.flip(np.minimum.accumulate(np.flip(depth + steps, axis), axis), axis) - steps
        depth = np.minimum(np.minimum.accumulate(depth - steps, axis) + steps, back)
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return np.array([left + column - 0.5, top + row - 0.5])
