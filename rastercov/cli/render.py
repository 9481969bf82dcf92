"""The command `render`: a picture, the face index and the depth of one pose."""

import json
import re
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from rastercov.base.errors import PoseError
from rastercov.base.format import plural, verb
from rastercov.camera.formats.conventions import Conventions
from rastercov.camera.formats.doubts import unit_doubts
from rastercov.camera.pose import Poses
from rastercov.cli import options
from rastercov.cli.console import out_option, size_line, warn
from rastercov.cli.inputs import SceneOptions, read_eyes


@options.expanded
def render(
    meshes: options.Meshes,
    poses: options.PosesOption,
    scene: SceneOptions,
    conventions: Conventions,
    camera: options.CameraOption = None,
    camera_name: options.CameraName = None,
    pose: Annotated[int, typer.Option(min=0, help="Row of the pose file.")] = 0,
    out: Annotated[Path, out_option("Folder for the files.")] = Path("render"),
    device: options.Device = "auto",
    as_json: options.AsJson = False,
) -> None:
    """Draw one pose: a picture, the face index and the depth of every pixel (PNG and NPZ).

    [bold]Example[/]: rastercov render part.stl --unit mm -c camera.toml -p poses.json --pose 3
    """
    from rastercov.base.output import write_npz
    from rastercov.report.coverage import Options
    from rastercov.report.folder import ReportFolder, ReportKind
    from rastercov.report.images import (
        coverage_picture,
        depth_picture,
        face_index_picture,
        save_picture,
    )

    mesh = scene.read(meshes)
    eyes = read_eyes(mesh, camera, poses, conventions, camera_name)
    eye, matrices = eyes.camera(), eyes.poses.world_from_camera
    if pose >= len(matrices):
        raise PoseError(f"--pose {pose} is not there: {poses} has {len(matrices)} poses, from 0")
    names = ("picture.png", "faces.png", "depth.png", "buffers.npz")
    files_of_it = re.compile("|".join(map(re.escape, names)))
    with ReportFolder(out, ReportKind("render", files_of_it, last=names[-1])) as folder:
        warn([*mesh.warnings, *eyes.notes, *unit_doubts(mesh, eye, Poses.of(matrices))])
        with Options(device=device).open_rasterizer(mesh, eye) as rasterizer:
            buffer = rasterizer.render(matrices[pose])
            info = rasterizer.info
            is_seen = np.isin(np.arange(mesh.n_faces), buffer.face)
            if mesh.has_targets:  # the image has none
                is_seen |= rasterizer.count(matrices[pose]).visible[0] > 0
        n_seen = int(is_seen.sum())
        title = f"pose {pose}: {n_seen} of {plural(mesh.n_faces, 'face')} "
        title += f"{verb(n_seen, 'have')} a pixel"
        picture = coverage_picture(
            buffer, is_seen, mesh, eye, matrices[pose], title, named=("seen from the front",)
        )
        save_picture(picture, folder.file("picture.png"))
        save_picture(face_index_picture(buffer), folder.file("faces.png"))
        save_picture(depth_picture(buffer), folder.file("depth.png"))
        write_npz(folder.file("buffers.npz"), face=buffer.face, depth=buffer.depth)
        folder.publish()
    files = [str(out / name) for name in names]
    result = {
        "pose": pose,
        "faces": mesh.n_faces,
        "size_m": np.ptp(mesh.bounds, axis=0).tolist(),
        "faces_with_a_pixel": n_seen,
        "pixels_covered": int((buffer.face >= 0).sum()),
        "renderer": info.renderer,
        "files": files,
    }
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        print(f"{title} ({info.renderer}); {size_line(mesh)}")
        print("\n".join(files))
