"""Annotations of groups in images: scene_gt_info.json of BOP, coco.json of COCO.

Objects are the groups with faces, in their order, from 1. Shares and counts of BOP are those of
`GroupViews`, areas rounded to pixels; masks and their boxes are of pixels by their centres. Boxes
of whole objects are those of their edges in the image, three times its width and height at most.

Sources: BOP toolkit, docs/bop_datasets_format.md. COCO, "Data format"; its masks are runs down the
columns, first of what is outside.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.rig import cameras_of
from rastercov.coverage.evaluation import Evaluation
from rastercov.coverage.silhouettes import GroupViews
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer

BOP, COCO = "scene_gt_info.json", "coco.json"
NONE = [-1, -1, -1, -1]
"""Box of an object that is not there."""
STEPS = 9
"""Points of an edge: it is curved in the image of a lens, or goes behind the camera."""


def annotations(
    found: Evaluation, views: GroupViews, images: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Content of both files by name, for images of some names, those of the poses."""
    mesh, cameras, poses = found.mesh, cameras_of(found.camera), found.poses
    known = [group.name for group in mesh.groups]
    rows = [known.index(name) for name in views.names]
    edges = [_edges(mesh, np.flatnonzero(mesh.face_group == row)) for row in rows]
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
                boxes = [_box(points, camera, pose) for points in edges]
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


def _edges(mesh: Mesh, faces: IntArray) -> FloatArray:
    """(N, 3) points of the edges of faces, `STEPS` of each."""
    corners = mesh.faces[faces]
    pairs = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
    ends = mesh.vertices[np.unique(pairs, axis=0)]
    along = np.linspace(0, 1, STEPS)[:, None, None]
    return np.asarray((ends[:, 0] + along * (ends[:, 1] - ends[:, 0])).reshape(-1, 3))


def _box(points: FloatArray, camera: Camera, pose: FloatArray) -> list[int]:
    """Left, top, width and height of points in an image and as much around it."""
    inside = to_camera(points, pose)
    if camera.is_pinhole:
        inside = inside[inside[:, 2] > 0]
    with np.errstate(all="ignore"):
        pixels = to_image(inside, camera)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(pixels):
        return NONE
    sides = np.array([camera.width, camera.height])
    low = np.clip(np.floor(pixels.min(axis=0)), -sides, 2 * sides)
    high = np.clip(np.ceil(pixels.max(axis=0)), -sides, 2 * sides)
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
