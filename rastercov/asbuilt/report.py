"""Report of installed cameras.

locate.html     photographs under the edges of the plan and of the pose as built; what is lost
locate.json     poses, covariances, verdicts
poses.json      the rig as built, for `check`, where a pose was found
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from rastercov.asbuilt.edges import MeshEdges, visible_points
from rastercov.asbuilt.photograph import read_photograph
from rastercov.asbuilt.resection import pixels_of
from rastercov.asbuilt.rig import AsBuilt, scene_of
from rastercov.base import write_json
from rastercov.core.camera.conventions import write_poses
from rastercov.core.raster import open_rasterizer
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.pages import Picture, render
from rastercov.report.printing import browser, write_page

LOCATE = ReportKind(
    "locate", re.compile(r"locate\.(html|pdf|json)|poses\.json"), last="locate.json"
)
PLANNED, BUILT = (230, 60, 40), (20, 150, 60)
"""Colours of edges as planned and as built."""
LARGEST = 1_200
"""Longer side of a picture, px."""


def write(made: Callable[[], AsBuilt], out: Path, *, pdf: bool) -> AsBuilt:
    """Locate cameras and write the report, once the folder can be used."""
    with ReportFolder(out, LOCATE) as folder:
        if pdf:
            browser()  # none fails before the work
        result = made()
        text = render(
            "locate.html",
            "rastercov.asbuilt",
            title="Cameras as built",
            heading="Cameras as built",
            result=result,
            pictures={row: _picture(result, row) for row in result.found},
        )
        write_page(folder, "locate", text, pdf=pdf)
        placed = result.built.cameras.placed
        names = result.built.plan.rig.names
        cameras = [names[at] for at in placed.camera.tolist()] if len(names) > 1 else None
        if result.is_located:
            write_poses(folder.file("poses.json"), placed.world_from_camera, cameras)
        write_json(folder.file("locate.json"), result.to_json())
        folder.publish()
    return result


def _picture(result: AsBuilt, row: int) -> Picture:
    """Photograph of a camera under its edges as planned and as built."""
    mesh, poses, cameras = scene_of(result.planned)
    found, camera = result.found[row], cameras[row]
    scale = min(1.0, LARGEST / max(camera.width, camera.height))
    grey = read_photograph(result.photos[row], camera)
    image = Image.fromarray((255 * grey).astype(np.uint8)).convert("RGB")
    image = image.resize((round(camera.width * scale), round(camera.height * scale)))
    draw, small, edges = ImageDraw.Draw(image), camera.resized(scale), MeshEdges.of(mesh)
    with open_rasterizer(mesh, small, "cpu") as rasterizer:
        for pose, colour in ((poses[row], PLANNED), (found.pose, BUILT))[: 1 + found.accepted]:
            points = visible_points(edges, rasterizer, pose, 1.5).points
            pixels = pixels_of(points, small, pose)
            for x, y in pixels[np.isfinite(pixels).all(axis=1)].tolist():
                draw.ellipse((x - 1, y - 1, x + 1, y + 1), fill=colour)
    built = ", as built in green" * found.accepted
    return Picture.of(f"{result.planned.names[row]}: edges as planned in red{built}", image)
