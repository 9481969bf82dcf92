"""Pictures of an evaluation: some of its poses, all of them together, and dead zones."""

from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rastercov.base.interrupts import interrupts_held
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.regions import RegionPass, Regions
from rastercov.coverage.engine import Engine
from rastercov.coverage.network import Network
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import VisibilityBuffer
from rastercov.report.camera_pictures import covered_pixels
from rastercov.report.folder import ReportFolder
from rastercov.report.images import (
    area_title,
    contact_sheet,
    coverage_picture,
    coverage_pixels,
    face_index_picture,
    pose_title,
    save_picture,
    targets_in_view,
)
from rastercov.report.overview import (
    best_covering,
    best_picture,
    camera_colours,
    overview_picture,
    views_picture,
)
from rastercov.report.theme import Pixels
from rastercov.report.zone_pictures import zones_picture

MOST_COLOURS = 60
"""Cameras that have a colour each in the overview."""
PICTURE_SIDE = 1280
"""Full pictures are drawn at the camera's size, or smaller where it exceeds this many pixels."""
TILE = 320
"""Width of a tile of the sheet, pixels."""
FULL = ("none", "poses", "faces", "all")
"""Full pictures of each pose: of its coverage, of face indices, or both."""


def draw_poses(
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    folder: ReportFolder,
    engine: Engine,
    task: Task,
    drawn: dict[int, NDArray[np.float64]],
    full: str,
    shown: "ShownRegions | None",
) -> bool:
    """Draw a sheet of the chosen poses, and what `full` names of each; True when interrupted.

    `drawn` has the coverage of each face by pose, `full` is one of `FULL`, and `shown` has the
    regions of a result by area.
    """
    digits = len(str(max(drawn)))
    tiles: dict[int, tuple[Image.Image, str]] = {}
    interrupted = False
    some, cameras = poses[np.isin(poses.ids, list(drawn))], cameras_of(camera)
    try:
        for index, rows in some.by_camera():
            eye, of_camera = cameras[index], f", {names_of(camera)[index]}"
            scales = [TILE / eye.width]
            if full != "none":
                scales.append(PICTURE_SIDE / max(eye.width, eye.height))
            with ExitStack() as opened:
                views = [
                    opened.enter_context(
                        open_rasterizer(
                            mesh, eye.resized(min(1.0, scale)), **engine.rasterizer_options
                        )
                    )
                    for scale in scales
                ]
                for pose in some[rows].ids.tolist():
                    own = replace(poses[poses.ids == pose], camera=np.zeros(1, np.int32))
                    regions = None if shown is None else shown.of_pose(pose)
                    of_pose = OfPose(mesh, poses.given[pose], drawn[pose], regions)
                    title = of_pose.title(f"{pose}{of_camera if len(cameras) > 1 else ''}", task)
                    buffers = [(view.camera, view.render(own)) for view in views]
                    tile, found = of_pose.pixels(*buffers[0]), {}
                    for size, buffer in buffers[1:]:
                        if full in ("poses", "all"):
                            found["pose"] = of_pose.picture(size, buffer, title)
                        if full in ("faces", "all"):
                            found["faces"] = face_index_picture(buffer)
                    with interrupts_held():
                        for name, picture in found.items():
                            save_picture(picture, folder.file(f"{name}_{pose:0{digits}d}.png"))
                        tiles[pose] = Image.fromarray(tile), title
    except KeyboardInterrupt:
        interrupted = True
    if tiles:
        pictures, titles = zip(*(tiles[pose] for pose in sorted(tiles)), strict=True)
        sheet = contact_sheet(list(pictures), list(titles))
        save_picture(sheet, folder.file("contact_sheet.png"))
    return interrupted


class ShownRegions:
    """Covered regions of the cameras in pictures, found once for the sheet and the overview.

    Those of all cameras are kept where the overview shows them; of more than `MOST_COLOURS`, one
    pose is found at a time.
    """

    def __init__(
        self, mesh: Mesh, camera: Cameras, task: Task, engine: Engine, poses: Poses
    ) -> None:
        self._finder, self._poses = RegionPass(mesh, camera, task, method=engine), poses

    @cached_property
    def all(self) -> Regions:
        """Those of all poses."""
        return self._finder.find(self._poses)

    def of_pose(self, pose: int) -> Regions:
        """Those of the pose of this number."""
        is_it = self._poses.ids == pose
        if len(self._poses) <= MOST_COLOURS:
            return self.all.of_poses(is_it)
        return self._finder.find(self._poses[is_it])

    def close(self) -> None:
        """Release the scratch memory."""
        self._finder.close()


class OfPose(NamedTuple):
    """Content of the pictures of a pose: coverage of each face, (F,), and of points, if by area."""

    mesh: Mesh
    matrix: NDArray[np.float64]
    values: NDArray[np.float64]
    regions: Regions | None

    def title(self, name: str, task: Task) -> str:
        """Title with the name of the pose and its share of the task."""
        covers = (self.values >= task.min_coverage) & (self.values > 0)
        if self.regions is None:
            return pose_title(self.mesh, name, covers)
        return area_title(self.mesh, name, float(self.regions.area.sum()), covers)

    def pixels(self, camera: Camera, buffer: VisibilityBuffer) -> Pixels:
        """(H, W, 3) pixels of an image of the pose by its camera, at any size."""
        covered = on_targets = None
        if self.regions is not None:
            covered = covered_pixels(self.regions, camera, self.matrix, buffer.face)
            targets = targets_in_view(self.mesh, camera, self.matrix, buffer.depth)
            if targets is not None:
                on_targets = covered_pixels(self.regions, camera, self.matrix, targets)
        return coverage_pixels(
            buffer, self.values, self.mesh, self.matrix, camera, covered, on_targets
        )

    def picture(self, camera: Camera, buffer: VisibilityBuffer, title: str) -> Image.Image:
        """The same with a title and a legend."""
        pixels = self.pixels(camera, buffer)
        named = () if self.regions is None else ("covered", "not covered")
        return coverage_picture(
            buffer, self.values, self.mesh, camera, self.matrix, title, pixels, named=named
        )


def draw_network(
    folder: ReportFolder,
    network: Network,
    camera: Cameras,
    poses: Poses,
    areas: AreaNetwork | None,
    summary: dict[str, Any],
    shown: ShownRegions | None,
) -> bool:
    """Draw what all cameras cover together, and dead zones; True when interrupted.

    Of more than `MOST_COLOURS` cameras, it is the number of them that cover each point. A result by
    area has `areas`, and `shown` of the same poses.
    """
    mesh, eyes = network.mesh, poses.world_from_camera[:, :3, 3]
    try:
        if len(poses) <= MOST_COLOURS:
            found = None if shown is None else shown.all
            names = [str(row) for row in poses.ids.tolist()]
            best = best_covering(network)
            picture = overview_picture(camera_colours(mesh, poses, best, names, found), camera)
        elif areas is not None:
            picture = views_picture(areas.covered, eyes)
        else:
            picture = best_picture(mesh, network.best, eyes)
        zones = None
        if areas is not None and len(areas.zones()):
            zones = zones_picture(areas.zones(), summary, eyes)
    except KeyboardInterrupt:
        return True
    with interrupts_held():
        save_picture(picture, folder.file("overview.png"))
        if zones is not None:
            save_picture(zones, folder.file("zones.png"))
    return False
