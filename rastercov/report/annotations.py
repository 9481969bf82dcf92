"""Annotations of groups in images: scene_gt_info.json of BOP, coco.json of COCO.

Objects are the groups with faces, in their order, from 1. Shares and counts of BOP are those of
`GroupViews`, areas rounded to pixels; masks and their boxes are of pixels by their centres. Boxes
of whole objects are those of their faces in an image of three times the width and height, cut at
its border and at the near plane; through a lens those of their edges.

Sources: BOP toolkit, docs/bop_datasets_format.md. COCO, "Data format"; its masks are runs down the
columns, first of what is outside.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limit, sides_of
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.rig import cameras_of
from rastercov.coverage.evaluation import Evaluation
from rastercov.coverage.silhouettes import GroupViews, camera_around
from rastercov.raster import open_rasterizer

BOP, COCO = "scene_gt_info.json", "coco.json"
NONE = [-1, -1, -1, -1]
"""Box of an object that is not there."""
ROUNDING = 1e-9
"""Pixels by which a corner may be off the border that it is cut at."""
STEPS = 9
"""Points of an edge: it is curved in the image of a lens, or goes behind the camera."""


def annotations(
    found: Evaluation, views: GroupViews, images: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Content of both files by name, for images of some names, those of the poses."""
    mesh, cameras, poses = found.mesh, cameras_of(found.camera), found.poses
    known = [group.name for group in mesh.groups]
    rows = [known.index(name) for name in views.names]
    faces = [mesh.faces[mesh.face_group == row] for row in rows]
    info: dict[int, list[dict[str, Any]]] = {}
    own: dict[int, list[dict[str, Any]]] = {}
    for index, some in poses.by_camera():
        camera = cameras[index]
        with open_rasterizer(mesh, camera, "cpu") as rasterizer:
            for at in np.arange(len(poses))[some].tolist():
                pose = poses.world_from_camera[at]
                face = rasterizer.render(pose).face
                group = np.where(face < 0, -1, mesh.face_group[face])
                masks = [group == row for row in rows]
                boxes = [_box(mesh.vertices[own], camera, pose) for own in faces]
                info[at] = [
                    _bop(views, at, *each) for each in enumerate(zip(boxes, masks, strict=True))
                ]
                own[at] = [
                    {"image_id": int(poses.ids[at])} | _coco(views, at, column, mask)
                    for column, mask in enumerate(masks)
                    if mask.any()
                ]
    every = [annotation for at in sorted(own) for annotation in own[at]]
    sizes = [(cameras[row].width, cameras[row].height) for row in poses.camera.tolist()]
    files = zip(poses.ids.tolist(), images, sizes, strict=True)
    return {
        BOP: {str(poses.ids[at]): info[at] for at in sorted(info)},
        COCO: {
            "images": [
                {"id": image, "file_name": name, "width": width, "height": height}
                for image, name, (width, height) in files
            ],
            "categories": [{"id": at + 1, "name": name} for at, name in enumerate(views.names)],
            "annotations": [{"id": at + 1} | each for at, each in enumerate(every)],
        },
    }


def _coco(views: GroupViews, at: int, column: int, mask: BoolArray) -> dict[str, Any]:
    """Annotation of a group in an image, with its shares."""
    return {
        "category_id": column + 1,
        "bbox": _box_of(mask),
        "area": int(mask.sum()),
        "segmentation": {"counts": _runs(mask), "size": list(mask.shape)},
        "iscrowd": 0,
        "visib_fract": float(views.visible_share[at, column]),
        "truncated_share": float(views.truncated_share[at, column]),
    }


def _bop(
    views: GroupViews, at: int, column: int, seen: tuple[list[int], BoolArray]
) -> dict[str, Any]:
    """Entry of a group in an image, by the box of all of it and the mask of what is seen."""
    box, mask = seen
    box = box if views.silhouette[at, column] > 0 else NONE
    counts = views.silhouette, views.inside, views.visible
    share = float(views.visible_share[at, column])
    return {
        "bbox_obj": box,
        "bbox_visib": _box_of(mask),
        **{
            f"px_count_{name}": round(float(area[at, column]))
            for name, area in zip(("all", "valid", "visib"), counts, strict=True)
        },
        "visib_fract": 0.0 if np.isnan(share) else share,
    }


def _edges(corners: FloatArray) -> FloatArray:
    """(N, 3) points of the edges of triangles (F, 3, 3), `STEPS` of each."""
    along = np.linspace(0, 1, STEPS)[:, None, None, None]
    return (corners + along * (np.roll(corners, -1, axis=1) - corners)).reshape(-1, 3)


def _cut(corners: FloatArray, camera: Camera, near: float) -> FloatArray:
    """(N, 3) corners of triangles (F, 3, 3) within an image and beyond a depth, camera axes."""
    for a, b, c in sides_of(camera):
        side = (a, b, 0.0, c) if camera.is_parallel else (a, b, c, 0.0)
        corners = _half(corners, np.array(side))
    return _half(corners, np.array((0.0, 0.0, 1.0, -near))).reshape(-1, 3)


def _half(polygons: FloatArray, side: FloatArray) -> FloatArray:
    """Polygons (N, M, 3) where a x + b y + c z + d >= 0; shorter ones repeat a corner."""
    value = polygons @ side[:3] + side[3]
    if not len(value) or (value >= 0).all():
        return polygons
    following = np.roll(value, -1, axis=1)
    is_cut = (value < 0) != (following < 0)
    part = np.divide(value, value - following, np.zeros_like(value), where=is_cut)
    across = polygons + part[..., None] * (np.roll(polygons, -1, axis=1) - polygons)
    points = np.stack((polygons, across), axis=2).reshape(len(value), -1, 3)
    is_kept = np.stack((value >= 0, is_cut), axis=2).reshape(len(value), -1)
    order = np.argsort(~is_kept, axis=1, kind="stable")[:, : is_kept.sum(axis=1).max()]
    order = np.where(np.take_along_axis(is_kept, order, axis=1), order, order[:, :1])
    found = np.take_along_axis(points, order[..., None], axis=1)
    return found[is_kept.any(axis=1)]


def _box(corners: FloatArray, camera: Camera, pose: FloatArray) -> list[int]:
    """Left, top, width and height of triangles (F, 3, 3) in an image and as much around it."""
    points = corners.reshape(-1, 3)
    bounds = np.stack((points.min(axis=0), points.max(axis=0)))
    if camera.is_curved:
        inside = to_camera(_edges(corners), pose)
        if camera.is_parallel:
            inside = inside[inside[:, 2] >= camera.near]
    else:
        near = float(near_limit(camera, bounds, pose[None])[0])
        inside = _cut(to_camera(corners, pose), camera_around(camera), near)
    with np.errstate(all="ignore"):
        pixels = to_image(inside, camera)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(pixels):
        return NONE
    sides = np.array([camera.width, camera.height])
    low = np.clip(np.floor(pixels.min(axis=0) + ROUNDING), -sides, 2 * sides)
    high = np.clip(np.ceil(pixels.max(axis=0) - ROUNDING), -sides, 2 * sides)
    is_there = bool((high > low).all())
    return [*map(int, low), *map(int, high - low)] if is_there else NONE


def _box_of(mask: BoolArray) -> list[int]:
    """Left, top, width and height of a mask."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return NONE
    sides = int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1
    return [int(columns[0]), int(rows[0]), *sides]


def _runs(mask: BoolArray) -> list[int]:
    """Lengths of runs down the columns, the first outside the mask."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    ends = np.flatnonzero(flat[1:] != flat[:-1])
    return np.diff(np.r_[0, ends, mask.size]).tolist()
