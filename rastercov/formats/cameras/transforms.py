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

from rastercov.base import ByName, CameraError, FloatArray, matmul, tan
from rastercov.core.camera import (
    PROGRAMS,
    Border,
    Camera,
    Views,
    lens_camera,
    model_in,
    share_frames,
)
from rastercov.core.camera.conventions import OPENGL_AXES, panorama
from rastercov.formats.cameras.source import Entries, Source

MODELS = PROGRAMS["nerfstudio"]
FOCAL = ("fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "x_fov", "y_fov")
TERMS = ("k1", "k2", "k3", "k4", "p1", "p2")
LENS = ("camera_model", "is_fisheye")
PARAMS = "distortion_params"
INTRINSICS = (*FOCAL, *TERMS, *LENS, PARAMS, "cx", "cy", "w", "h")
ALTERNATIVES = ((FOCAL, FOCAL), (LENS, LENS), (TERMS, (PARAMS,)))
"""Entries of a frame, and those of the file that they replace."""
_OTHERS = """
aabb_scale aabb scale offset from_na up ply_file_path render_aabb orientation_override
auto_scale_poses_factor fisheye_crop_radius sharpness train_filenames val_filenames test_filenames
depth_unit_scale_factor integer_depth_scale enable_depth_loading enable_ray_loading
n_extra_learnable_dims white_transparent black_transparent mask_color sh_degree sensor_width
depth_file_path mask_path colmap_im_id rotation exposure light_direction rolling_shutter
semantic_path timestamp camera_index frame_index is_hdr
"""
HARMLESS = frozenset(_OTHERS.split())
KNOWN = HARMLESS.union(
    INTRINSICS,
    ("frames", "applied_transform", "applied_scale", "is_latlong"),
    (f"ftheta_p{row}" for row in range(5)),
)
KNOWN_OF_FRAME = HARMLESS.union(INTRINSICS, ("file_path", "transform_matrix", "time"))
"""Entries of a file and of a frame; `HARMLESS` says nothing of cameras and poses."""


def is_mine(content: object) -> bool:
    """True for JSON with frames that have a transform_matrix."""
    return isinstance(content, dict) and isinstance(content.get("frames"), list)


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of a transforms.json: one camera for each set of intrinsics."""
    content = Entries(source.table, "transforms.json")
    if "ftheta_p0" in content or content.get("is_latlong"):
        raise CameraError(
            "expected a pinhole, opencv or fisheye lens, got f-theta or latlong of instant-ngp; "
            "undistort the images"
        )
    border.unknown.look("the file", content.names(), KNOWN, HARMLESS)
    shared = {name: content.get(name) for name in INTRINSICS if name in content}
    cameras, images, matrices = [], [], []
    times: list[str | None] = []
    for row, frame in content.tables("frames"):
        border.unknown.look(frame.where, frame.names(), KNOWN_OF_FRAME, HARMLESS | {"file_path"})
        own = {name: frame.get(name) for name in INTRINSICS if name in frame}
        replaced = {name for given, all_ in ALTERNATIVES if own.keys() & given for name in all_}
        inherited = {name: value for name, value in shared.items() if name not in replaced}
        cameras.append(
            _camera(Entries(inherited | own, frame.where if own else content.where), border)
        )
        images.append(frame.text("file_path", f"frame {row}"))
        # All digits, as it may be seconds since 1970.
        time = f"time {frame.number('time')!r}".removesuffix(".0") if "time" in frame else None
        times.append(time)
        matrix = frame.array("transform_matrix", (4, 4), (3, 4))
        matrices.append(np.vstack([matrix, [0, 0, 0, 1]]) if len(matrix) == 3 else matrix)
    if not matrices:
        raise CameraError(
            "expected frames with a transform_matrix, got none; export the poses as well"
        )
    poses = matmul(np.array(matrices), OPENGL_AXES)
    if "applied_transform" in content:
        poses = _in_world(poses, content, border)
    scale = content.positive("applied_scale", 1.0)
    if scale != 1.0 and border.undoes_world():
        with np.errstate(all="ignore"):  # what is no number is refused later
            poses[:, :3, 3] *= 1.0 / scale
    elif scale != 1.0:
        border.note(f"lengths are those of the file, scaled by applied_scale {scale:g}")
    if "scale" in content or "offset" in content:
        border.note("scale and offset, which place the scene in instant-ngp's cube, are not used")
    return border.views_of_images(
        cameras,
        images,
        world_from_camera=poses,
        frames=share_frames(times, range(len(times))),
    )


def _in_world(poses: FloatArray, content: Entries, border: Border) -> Any:
    """Poses in the world that was asked for."""
    applied = np.eye(4)
    given = content.array("applied_transform", (3, 4), (4, 4))
    applied[:3] = given[:3]
    if np.array_equal(applied, np.eye(4)):
        return poses
    if not border.undoes_world():
        border.note(
            "left poses in the world frame of the file; --original-world undoes its "
            "applied_transform"
        )
        return poses
    try:
        return matmul(np.linalg.inv(applied), poses)
    except np.linalg.LinAlgError:
        raise CameraError(
            "expected an invertible applied_transform, got a singular one; correct it"
        ) from None


def _camera(entries: Entries, border: Border) -> Camera:
    """Camera of a frame."""
    model = entries.choice("camera_model", MODELS, "OPENCV")
    ours, order = MODELS["OPENCV_FISHEYE" if entries.flag("is_fisheye") else model]
    if "w" in entries or "h" in entries:
        size = entries.side("w"), entries.side("h")
    else:
        size = border.image_size(entries.where)
    if ours == "equirectangular" and not entries.any_of("fl_x", "fl_y"):
        return panorama(*size)
    fx, fy = _focal_lengths(entries, size)
    if ours == "equirectangular":
        # Longitude and latitude are pi (u - cx) / fl_x and pi (v - cy) / fl_y.
        fx, fy = fx / math.pi, fy / math.pi
    p = _coefficients(entries, ours, order.split()) | {"fx": fx, "fy": fy}
    p |= {"cx": entries.number("cx", size[0] / 2), "cy": entries.number("cy", size[1] / 2)}
    return lens_camera(ours, size, p)


def _focal_lengths(entries: Entries, size: tuple[int, int]) -> tuple[float, float]:
    """Focal lengths, px, given directly or by an angle; one alone is both."""
    values: list[float] = []
    for axis, side in zip("xy", size, strict=True):
        units = {f"camera_angle_{axis}": 1.0, f"{axis}_fov": math.radians(1)}
        angle = entries.any_of(*units)
        if f"fl_{axis}" in entries:
            values.append(entries.number(f"fl_{axis}"))
        elif angle is not None:
            values.append(side / 2 / tan(entries.angle(angle, units[angle]) / 2))
    if not values:
        entries.need("fl_x")
    return values[0], values[-1]


def _coefficients(entries: Entries, ours: str, names: Sequence[str]) -> dict[str, float]:
    """Coefficients of the lens by our names, which are in the order of the file's."""
    if ours == "rad_tan_thin_prism_fisheye":
        return entries.named(PARAMS, names)
    if PARAMS in entries:
        given = entries.array(PARAMS, (4,), (6,)).tolist()
    else:
        given = [entries.number(name, 0.0) for name in TERMS]
    if ours != "metashape" and any(given[4:]):
        raise entries.wrong("p1 and p2", "0 for such a lens", given[4:])
    return dict.fromkeys(names, 0.0) | dict(zip(names, given, strict=False))


def content_of(views: Views) -> ByName:
    """The file for these views; CameraError for a lens that it has no model for."""
    if not len(views.poses):
        raise CameraError(
            "expected poses for transforms.json, got none; add poses, or write another format"
        )
    rig = views.rig
    assert rig is not None
    tables = [_table(camera, name) for camera, name in zip(rig.cameras, rig.names, strict=True)]
    used = sorted(set(views.poses.camera.tolist()))
    matrices = matmul(views.poses.world_from_camera, OPENGL_AXES)
    frames = []
    for row, image in enumerate(views.images):
        frame: ByName = {"file_path": image}
        if len(used) > 1:
            frame |= tables[views.poses.camera[row]]
        frames.append(frame | {"transform_matrix": matrices[row].tolist()})
    shared = tables[used[0]] if len(used) == 1 else {}
    return shared | {"frames": frames}


def _table(camera: Camera, name: str) -> ByName:
    """Intrinsics of a camera under the names of the format."""
    model, p = model_in("nerfstudio", camera, name)
    fx, fy = camera.fx, camera.fy
    terms: ByName = dict(zip(TERMS, p.values(), strict=False))
    if model == "EQUIRECTANGULAR":
        fx, fy = fx * math.pi, fy * math.pi
    elif model == "FISHEYE624":
        terms = {PARAMS: list(p.values())}
    elif model == "OPENCV_FISHEYE":
        terms["is_fisheye"] = True  # read by instant-ngp
    elif not any(p.values()):
        model, terms = "PINHOLE", {}
    elif not p["k4"]:
        del terms["k4"]
    return {
        "camera_model": model,
        "fl_x": fx,
        "fl_y": fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
        **terms,
    }
