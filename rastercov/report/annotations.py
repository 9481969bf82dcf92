"""Annotations of groups in images: scene_gt_info.json of BOP, coco.json of COCO.

Objects are the groups with faces, in their order, from 1. Shares and counts of BOP are those of
`GroupViews`, areas rounded to pixels; masks and their boxes are of pixels by their centres. Boxes
of whole objects are those of their faces in an image of three times the width and height, cut at
its border and at the near plane; through a lens those of their edges.

Sources: BOP toolkit, docs/bop_datasets_format.md. COCO, "Data format"; its masks are runs down the
columns, first of what is outside.
"""

from collections.abc import Sequence

import numpy as np

from rastercov.base import ByName, FloatArray, IntArray, frozen_record, sort_order
from rastercov.core.camera import Camera, cameras_of, near_limit, to_camera, to_image
from rastercov.core.camera.pose import sides_of
from rastercov.core.coverage.evaluation import Evaluation
from rastercov.core.coverage.visibility import GroupViews, camera_around, places_of
from rastercov.core.raster import open_rasterizer

BOP, COCO = "scene_gt_info.json", "coco.json"
NONE = [-1, -1, -1, -1]
"""Box of an object that is not there."""
ROUNDING = 1e-9
"""Pixels by which a corner may be off the border that it is cut at."""
STEPS = 9
"""Points of an edge: it is curved in the image of a lens, or goes behind the camera."""


def annotations(
    evaluation: Evaluation, views: GroupViews, images: Sequence[str]
) -> dict[str, ByName]:
    """Content of both files by name, for images of some names, those of the poses."""
    mesh, cameras, poses = evaluation.mesh, cameras_of(evaluation.camera), evaluation.poses
    known = {group.name: row for row, group in enumerate(mesh.groups)}
    rows = np.array([known[name] for name in views.names])
    members = places_of(mesh.face_group, rows)
    corners = [mesh.vertices[mesh.faces[some]] for some in members]
    shares = views.visible_share, views.truncated_share
    info: dict[int, list[ByName]] = {}
    own: dict[int, list[ByName]] = {}
    for index, some in poses.by_camera():
        camera = cameras[index]
        with open_rasterizer(mesh, camera, "cpu") as rasterizer:
            for at in np.arange(len(poses))[some].tolist():
                pose = poses.world_from_camera[at]
                face = rasterizer.render(pose).face
                group = np.where(face < 0, -1, mesh.face_group[face])
                masks = [_Mask(pixels, group.shape) for pixels in places_of(group.T, rows)]
                boxes = _boxes(corners, camera, pose)
                columns = range(len(rows))
                of_image = *(share[at].tolist() for share in shares), boxes, masks
                each_group = list(zip(columns, *of_image, strict=True))
                info[at] = [
                    _bop(views, at, column, share, box, mask)
                    for column, share, _, box, mask in each_group
                ]
                own[at] = [
                    {"image_id": int(poses.ids[at])} | _coco(column, share, truncated, mask)
                    for column, share, truncated, _, mask in each_group
                    if len(mask.pixels)
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


@frozen_record
class _Mask:
    """Pixels of a group in an image of a size (rows, columns), in their order down the columns."""

    pixels: IntArray
    size: tuple[int, ...]

    def box(self) -> list[int]:
        """Left, top, width and height."""
        if not len(self.pixels):
            return NONE
        column, row = np.divmod(self.pixels, self.size[0])
        top = int(row.min())
        left, right = column[[0, -1]].tolist()
        return [left, top, right - left + 1, int(row.max()) - top + 1]

    def runs(self) -> list[int]:
        """Lengths of runs, the first outside the mask."""
        is_end = np.diff(self.pixels) > 1
        first = self.pixels[np.r_[True, is_end]]
        stop = self.pixels[np.r_[is_end, True]] + 1
        ends = np.r_[0, np.stack((first, stop), axis=1).ravel(), self.size[0] * self.size[1]]
        numbers: list[int] = np.diff(ends).tolist()
        return numbers if numbers[-1] else numbers[:-1]


def _coco(column: int, share: float, truncated: float, mask: _Mask) -> ByName:
    """Annotation of a group in an image, with its shares."""
    return {
        "category_id": column + 1,
        "bbox": mask.box(),
        "area": len(mask.pixels),
        "segmentation": {"counts": mask.runs(), "size": list(mask.size)},
        "iscrowd": 0,
        "visib_fract": share,
        "truncated_share": truncated,
    }


def _bop(
    views: GroupViews, at: int, column: int, share: float, box: list[int], mask: _Mask
) -> ByName:
    """Entry of a group in an image, by the box of all of it and the mask of what is seen."""
    counts = views.silhouette, views.inside, views.visible
    return {
        "bbox_obj": box if views.silhouette[at, column] > 0 else NONE,
        "bbox_visib": mask.box(),
        **{
            f"px_count_{name}": round(float(area[at, column]))
            for name, area in zip(("all", "valid", "visib"), counts, strict=True)
        },
        "visib_fract": 0.0 if np.isnan(share) else share,
    }


def _edges(corners: FloatArray) -> FloatArray:
    """(F, 3 `STEPS`, 3) points of the edges of triangles (F, 3, 3)."""
    along = np.linspace(0, 1, STEPS)[:, None, None, None]
    points = corners + along * (np.roll(corners, -1, axis=1) - corners)
    return np.moveaxis(points, 0, 1).reshape(len(corners), -1, 3)


def _cut(corners: FloatArray, camera: Camera, nears: FloatArray) -> FloatArray:
    """(F, M, 3) corners of triangles (F, 3, 3) within an image and beyond depths (F,)."""
    for a, b, c in sides_of(camera):
        side = (a, b, 0.0) if camera.is_parallel else (a, b, c)
        corners = _half(corners, np.array(side), c if camera.is_parallel else 0.0)
    return _half(corners, np.array((0.0, 0.0, 1.0)), -nears[:, None])


def _half(polygons: FloatArray, normal: FloatArray, offset: FloatArray | float) -> FloatArray:
    """Polygons (N, M, 3) where a x + b y + c z + d >= 0; shorter ones repeat a corner, NaN none."""
    value = polygons @ normal + offset
    if not len(value) or (value >= 0).all():
        return polygons
    following = np.roll(value, -1, axis=1)
    is_cut = (value < 0) != (following < 0)
    part = np.divide(value, value - following, np.zeros_like(value), where=is_cut)
    across = polygons + part[..., None] * (np.roll(polygons, -1, axis=1) - polygons)
    points = np.stack((polygons, across), axis=2).reshape(len(value), -1, 3)
    is_kept = np.stack((value >= 0, is_cut), axis=2).reshape(len(value), -1)
    order = sort_order(~is_kept)[:, : max(1, is_kept.sum(axis=1).max())]
    order = np.where(np.take_along_axis(is_kept, order, axis=1), order, order[:, :1])
    values: FloatArray = np.take_along_axis(points, order[..., None], axis=1)
    values[~is_kept.any(axis=1)] = np.nan
    return values


def _boxes(groups: Sequence[FloatArray], camera: Camera, pose: FloatArray) -> list[list[int]]:
    """Left, top, width and height of triangles (F, 3, 3) of groups, in an image and around it."""
    corners, counts = np.concatenate(groups), np.array([len(each) for each in groups])
    if camera.is_curved:
        inside = to_camera(_edges(corners), pose)
        if camera.is_parallel:
            inside[inside[..., 2] < camera.near] = np.nan
    else:
        bounds = [(each.min(axis=(0, 1)), each.max(axis=(0, 1))) for each in groups]
        nears = [near_limit(camera, np.array(box), pose[None])[0] for box in bounds]
        around = camera_around(camera)
        inside = _cut(to_camera(corners, pose), around, np.repeat(nears, counts))
    with np.errstate(all="ignore"):
        pixels = to_image(inside, camera)
    pixels[~np.isfinite(pixels).all(axis=-1)] = np.nan
    starts, sides = np.cumsum(counts) - counts, np.array([camera.width, camera.height])
    low = np.fmin.reduceat(np.fmin.reduce(pixels, axis=1), starts)
    high = np.fmax.reduceat(np.fmax.reduce(pixels, axis=1), starts)
    low = np.clip(np.floor(low + ROUNDING), -sides, 2 * sides)
    high = np.clip(np.ceil(high - ROUNDING), -sides, 2 * sides)
    boxes = np.hstack((low, high - low))
    boxes[~(high > low).all(axis=1)] = NONE
    whole: list[list[int]] = boxes.astype(np.int64).tolist()
    return whole
