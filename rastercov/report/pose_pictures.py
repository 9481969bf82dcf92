"""Pictures of an evaluation: some of its poses, all of them together, and dead zones."""

from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rastercov._interrupts import interrupts_held
from rastercov.area.network import AreaNetwork
from rastercov.area.regions import RegionPass
from rastercov.engine import Engine
from rastercov.mesh import Mesh
from rastercov.network import Network
from rastercov.pose import Poses
from rastercov.raster import open_rasterizer
from rastercov.report.area_pictures import SeenArea, best_and_views
from rastercov.report.folder import ReportFolder
from rastercov.report.images import (
    area_title,
    contact_sheet,
    coverage_picture,
    coverage_pixels,
    face_index_picture,
    pose_title,
    save_picture,
)
from rastercov.report.overview import best_covering, camera_colours, overview_picture
from rastercov.report.placement_pictures import coverage_picture as whole_faces_picture
from rastercov.report.placement_pictures import views_picture
from rastercov.report.target_pictures import targets_in_view
from rastercov.report.zone_pictures import zones_picture
from rastercov.rig import Cameras, cameras_of, names_of
from rastercov.task import Task

MOST_COLOURS = 60
"""Cameras that have a colour each in the overview."""
PICTURE_SIDE = 1280
"""Pictures are drawn at the camera's size, or smaller where it exceeds this many pixels."""


def draw_poses(
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    folder: ReportFolder,
    engine: Engine,
    task: Task,
    drawn: dict[int, NDArray[np.float64]],
    *,
    by_area: bool,
) -> bool:
    """Draw the chosen poses and a sheet of them; True when interrupted."""
    digits = len(str(max(drawn)))
    found: dict[int, tuple[Image.Image, str]] = {}
    interrupted = False
    named = ("covered", "not covered") if by_area else ()
    some, cameras = poses[np.isin(poses.ids, list(drawn))], cameras_of(camera)
    try:
        for index, rows in some.by_camera():
            eye = cameras[index]
            small = eye.resized(min(1.0, PICTURE_SIDE / max(eye.width, eye.height)))
            with ExitStack() as opened:
                rasterizer = opened.enter_context(
                    open_rasterizer(mesh, small, **engine.rasterizer_options)
                )
                finder = None
                if by_area:
                    finder = RegionPass(mesh, eye, task, method=engine)
                    opened.callback(finder.close)
                for pose in some[rows].ids.tolist():
                    values, matrix = drawn[pose], poses.given[pose]
                    covers = (values >= task.min_coverage) & (values > 0)
                    name = f"{pose}, {names_of(camera)[index]}" if len(cameras) > 1 else pose
                    title = pose_title(mesh, name, covers)
                    own = replace(poses[poses.ids == pose], camera=np.zeros(1, np.int32))
                    buffer, covered, on_targets = rasterizer.render(own), None, None
                    if finder is not None:
                        regions = finder.find(own)
                        seen = SeenArea(regions, own)
                        covered = best_and_views(seen, small, matrix, buffer.face)[1] > 0
                        targets = targets_in_view(mesh, small, matrix, buffer.depth)
                        if targets is not None:
                            on_targets = best_and_views(seen, small, matrix, targets)[1] > 0
                        title = area_title(mesh, name, float(regions.area.sum()), covers)
                    pixels = coverage_pixels(
                        buffer, values, mesh, matrix, small, covered, on_targets
                    )
                    picture = coverage_picture(
                        buffer, values, mesh, small, matrix, title, pixels, named=named
                    )
                    faces = face_index_picture(buffer)
                    with interrupts_held():
                        save_picture(picture, folder.file(f"pose_{pose:0{digits}d}.png"))
                        save_picture(faces, folder.file(f"faces_{pose:0{digits}d}.png"))
                        found[pose] = Image.fromarray(pixels), title
    except KeyboardInterrupt:
        interrupted = True
    if found:
        pictures, titles = zip(*(found[pose] for pose in sorted(found)), strict=True)
        sheet = contact_sheet(list(pictures), list(titles))
        save_picture(sheet, folder.file("contact_sheet.png"))
    return interrupted


def draw_network(
    folder: ReportFolder,
    network: Network,
    camera: Cameras,
    poses: Poses,
    areas: AreaNetwork | None,
    summary: dict[str, Any],
) -> bool:
    """Draw what all cameras cover together, and dead zones; True when interrupted.

    Of more than `MOST_COLOURS` cameras, it is the number of them that cover each point.
    """
    mesh, eyes = network.mesh, poses.world_from_camera[:, :3, 3]
    try:
        if len(poses) <= MOST_COLOURS:
            found = None
            if areas is not None:
                with closing(RegionPass(mesh, camera, network.task)) as finder:
                    found = finder.find(poses)
            names = [str(row) for row in poses.ids.tolist()]
            best = best_covering(network)
            picture = overview_picture(camera_colours(mesh, poses, best, names, found), camera)
        elif areas is not None:
            picture = views_picture(areas.covered, eyes)
        else:
            picture = whole_faces_picture(mesh, network.best, eyes)
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
