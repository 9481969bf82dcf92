"""transforms.json of nerfstudio, instant-ngp and the NeRF synthetic scenes.

Poses are world_from_camera with OpenGL axes; pixels are ours; there is no unit. Intrinsics belong
to the file or to each frame. `applied_transform` says what was done to the world of the program the
poses came from: poses are read as they are, unless the original world is asked for.

Sources: nerfstudio documentation, "Data conventions", and nerfstudio_dataparser.py; instant-ngp,
docs/nerf_dataset_tips.md and nerf_loader.cu.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.formats.conventions import (
    OPENGL_AXES,
    Border,
    as_fisheye,
    as_opencv,
    is_whole_panorama,
    lens_camera,
    no_model,
    panorama,
)
from rastercov.camera.formats.source import Entries, Source
from rastercov.camera.models import PROGRAMS, coefficients_by_name
from rastercov.camera.rig import Views

MODELS = PROGRAMS["nerfstudio"]
INTRINSICS = (
    *("fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2"),
    *("camera_model", "camera_angle_x", "camera_angle_y", "distortion_params"),
    *("is_fisheye", "x_fov", "y_fov"),
)


ALTERNATIVES = (
    ({"fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "x_fov", "y_fov"},) * 2,
    ({"camera_model", "is_fisheye"},) * 2,
    ({"k1", "k2", "k3", "k4", "p1", "p2"}, {"distortion_params"}),
)
"""Entries of a frame, and those of the file that they replace."""


_OTHERS = (
    *("aabb_scale", "aabb", "scale", "offset", "from_na", "up", "ply_file_path", "render_aabb"),
    *("orientation_override", "auto_scale_poses_factor", "fisheye_crop_radius", "sharpness"),
    *("train_filenames", "val_filenames", "test_filenames", "depth_unit_scale_factor"),
    *(
        "integer_depth_scale",
        "enable_depth_loading",
        "enable_ray_loading",
        "n_extra_learnable_dims",
    ),
    *("white_transparent", "black_transparent", "mask_color", "sh_degree", "sensor_width"),
    *("depth_file_path", "mask_path", "colmap_im_id", "rotation", "exposure", "light_direction"),
    *("rolling_shutter", "semantic_path", "timestamp", "camera_index", "frame_index", "is_hdr"),
)
HARMLESS = frozenset(_OTHERS)
KNOWN = HARMLESS.union(
    INTRINSICS,
    ("frames", "applied_transform", "applied_scale", "is_latlong"),
    (f"ftheta_p{row}" for row in range(5)),
)
KNOWN_OF_FRAME = HARMLESS.union(INTRINSICS, ("file_path", "transform_matrix", "time"))
"""Entries of a file and of a frame; `HARMLESS` says nothing of cameras and poses."""


def is_mine(content: Any) -> bool:
    """True for JSON with frames that have a transform_matrix."""
    return isinstance(content, dict) and isinstance(content.get("frames"), list)


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of a transforms.json: one camera for each set of intrinsics."""
    content = Entries(source.json, "transforms.json")
    if "ftheta_p0" in content or content.get("is_latlong"):
        raise CameraError("instant-ngp's f-theta and latlong lenses are not read; undistort first")
    border.unknown.look("the file", content.names(), KNOWN, HARMLESS)
    shared = {name: content.get(name) for name in INTRINSICS if name in content}
    cameras: dict[Camera, int] = {}
    index, images, matrices = [], [], []
    times: list[float | None] = []
    for row, frame in content.tables("frames"):
        border.unknown.look(frame.where, frame.names(), KNOWN_OF_FRAME, HARMLESS | {"file_path"})
        own = {name: frame.get(name) for name in INTRINSICS if name in frame}
        replaced = {name for given, others in ALTERNATIVES if given & own.keys() for name in others}
        inherited = {name: value for name, value in shared.items() if name not in replaced}
        camera = _camera(Entries(inherited | own, frame.where if own else content.where), border)
        index.append(cameras.setdefault(camera, len(cameras)))
        images.append(frame.text("file_path", f"frame {row}"))
        times.append(frame.number("time") if "time" in frame else None)
        matrix = frame.array("transform_matrix", (4, 4), (3, 4))
        matrices.append(np.vstack([matrix, [0, 0, 0, 1]]) if len(matrix) == 3 else matrix)
    if not matrices:
        raise CameraError("frames with a transform_matrix wanted, got none")
    poses = np.array(matrices) @ OPENGL_AXES
    if "applied_transform" in content:
        poses = _in_world(poses, content, border)
    scale = content.number("applied_scale", 1.0)
    if not scale > 0:
        raise CameraError(f"applied_scale must be positive, got {scale:g}")
    undone = 1.0
    if scale != 1.0:
        if border.undoes_world():
            undone = 1.0 / scale
        else:
            border.note(f"lengths are as the file has them, after applied_scale {scale:g}")
    if "scale" in content or "offset" in content:
        border.note("scale and offset, which place the scene in instant-ngp's cube, are not used")
    return border.views(
        list(cameras),
        world_from_camera=poses,
        camera=index,
        images=images,
        frames=_frames(times),
        scale=undone,
    )


def _frames(times: Sequence[float | None]) -> list[str]:
    """Frame of each image by its time, as scenes in motion have it; none where no two are equal."""
    known = [time for time in times if time is not None]
    if len(known) < len(times) or len(set(known)) == len(known):
        return []
    # All digits, as it may be seconds since 1970.
    return [f"time {time!r}".removesuffix(".0") for time in known]


def _in_world(poses: NDArray[np.float64], content: Entries, border: Border) -> Any:
    """Poses in the world that was asked for."""
    applied = np.eye(4)
    given = content.array("applied_transform", (3, 4), (4, 4))
    applied[:3] = given[:3]
    if np.array_equal(applied, np.eye(4)):
        return poses
    if not border.undoes_world():
        border.note(
            "poses are in the world of the file, after applied_transform; undo it by "
            "--original-world"
        )
        return poses
    try:
        return np.linalg.inv(applied) @ poses
    except np.linalg.LinAlgError:
        raise CameraError("applied_transform has no inverse; correct it") from None


def _camera(entries: Entries, border: Border) -> Camera:
    """Camera of a frame."""
    model = entries.text("camera_model", "OPENCV")
    if model not in MODELS:
        raise CameraError(
            f"{entries.where}: camera_model must be one of {', '.join(MODELS)}, got {model[:40]!r}"
        )
    ours = MODELS["OPENCV_FISHEYE" if entries.flag("is_fisheye") else model].ours
    if "w" in entries or "h" in entries:
        size = entries.side("w"), entries.side("h")
    else:
        size = border.image_size(entries.where)
    if ours == "equirectangular" and not entries.any_of("fl_x", "fl_y"):
        return panorama(*size)
    fx, fy = _focal_lengths(entries, *size)
    if ours == "equirectangular":
        # Longitude and latitude are pi (u - cx) / fl_x and pi (v - cy) / fl_y.
        p = {"fx": fx / math.pi, "fy": fy / math.pi}
    else:
        ours, p = _lens(entries, ours)
        p |= {"fx": fx, "fy": fy}
    p |= {"cx": entries.number("cx", size[0] / 2), "cy": entries.number("cy", size[1] / 2)}
    return lens_camera(ours, size, p)


def _focal_lengths(entries: Entries, width: int, height: int) -> tuple[float, float]:
    """Focal lengths, px, given directly or by an angle; one alone is both."""
    found = []
    for name, angle, degrees, side in (
        ("fl_x", "camera_angle_x", "x_fov", width),
        ("fl_y", "camera_angle_y", "y_fov", height),
    ):
        if name in entries:
            found.append(entries.number(name))
        elif angle in entries or degrees in entries:
            radians = (
                entries.number(angle) if angle in entries else math.radians(entries.number(degrees))
            )
            if not 0 < radians < math.pi:
                raise CameraError(
                    f"{entries.where}: {angle} must be above 0 and below pi, got {radians:g}"
                )
            found.append(side / 2 / math.tan(radians / 2))
        else:
            found.append(math.nan)
    fx, fy = found
    if math.isnan(fx) and math.isnan(fy):
        raise CameraError(
            f"{entries.where}: fl_x or camera_angle_x is missing; export the file again"
        )
    return (fy if math.isnan(fx) else fx), (fx if math.isnan(fy) else fy)


def _lens(entries: Entries, ours: str) -> tuple[str, dict[str, float]]:
    """Model of the lens and its coefficients by name."""
    given: Sequence[float] = ()
    if "distortion_params" in entries:
        given = entries.array("distortion_params", (4,), (6,), (12,)).tolist()
    if ours == "rad_tan_thin_prism_fisheye":
        if len(given) != 12:
            raise CameraError(f"{entries.where}: FISHEYE624 needs 12 distortion_params")
        return ours, dict(zip(MODELS["FISHEYE624"].parameters.split(), given, strict=True))
    if len(given) == 12:
        raise CameraError(f"{entries.where}: 12 distortion_params belong to FISHEYE624")
    names = MODELS["OPENCV"].parameters.split()
    if not given:
        given = [entries.number(name, 0.0) for name in names]
    p = dict(zip(names, (*given, 0.0, 0.0), strict=False))
    p1, p2 = p["p1"], p["p2"]
    if ours == "opencv_fisheye" and (p1 or p2):
        raise CameraError(f"{entries.where}: a fisheye has no p1 and p2, got {p1:g}, {p2:g}")
    if ours == "opencv" and p["k4"]:
        # Of r^8, which OpenCV's model does not have; Metashape's p1 and p2 are turned around.
        ours, p = "metashape", p | {"p1": p2, "p2": p1}
    return ours, p


def content_of(views: Views) -> dict[str, Any]:
    """The file for these views; CameraError for a lens that it has no model for."""
    if not len(views.poses):
        raise CameraError("transforms.json holds poses, and there are none to write")
    rig = views.rig
    assert rig is not None
    tables = [_table(camera, name) for camera, name in zip(rig.cameras, rig.names, strict=True)]
    used = sorted(set(views.poses.camera.tolist()))
    matrices = views.poses.world_from_camera @ OPENGL_AXES
    frames = []
    for row, image in enumerate(views.images):
        frame: dict[str, Any] = {"file_path": image}
        if len(used) > 1:
            frame |= tables[views.poses.camera[row]]
        frames.append(frame | {"transform_matrix": matrices[row].tolist()})
    shared = tables[used[0]] if len(used) == 1 else {}
    return shared | {"frames": frames}


def _table(camera: Camera, name: str) -> dict[str, Any]:
    """Intrinsics of a camera under the names of the format."""
    c = coefficients_by_name(camera.model, camera.distortion)
    radial, values = as_fisheye(camera), as_opencv(camera)
    if camera.skew:
        raise no_model("transforms.json", camera, name)
    found: dict[str, Any] = {}
    if radial is not None:
        model, found = "OPENCV_FISHEYE", dict(zip(("k1", "k2", "k3", "k4"), radial, strict=True))
        found["is_fisheye"] = True  # read by instant-ngp
    elif camera.model == "rad_tan_thin_prism_fisheye":
        model, found = "FISHEYE624", {"distortion_params": list(c.values())}
    elif camera.model == "equirectangular":
        model = "EQUIRECTANGULAR"
    elif camera.model == "metashape":
        model, found = "OPENCV", c | {"p1": c["p2"], "p2": c["p1"]}
    elif values is not None and not any(values[5:]):
        found = (
            dict(zip(("k1", "k2", "p1", "p2", "k3"), values, strict=False)) if any(values) else {}
        )
        model = "OPENCV" if found else "PINHOLE"
    else:
        raise no_model("transforms.json", camera, name)
    fx, fy = camera.fx, camera.fy
    if model == "EQUIRECTANGULAR":
        fx, fy = fx * math.pi, fy * math.pi
        if is_whole_panorama(camera):
            fx, fy = camera.width / 2, float(camera.height)
    return {
        "camera_model": model,
        "fl_x": fx,
        "fl_y": fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
        **found,
    }
