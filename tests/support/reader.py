"""Files that a reader of the documentation has: parts, cameras, poses, a plan, a house."""

import json
from pathlib import Path

import numpy as np
import trimesh
from bungalow import bungalow

import rastercov as rc
from rastercov.core.camera.conventions import write_poses

CAMERA = """width = 1280
height = 1024
focal_length = 8e-3
pixel_size = 5.3e-6
"""
PLAN = """[[meshes]]
path = "part.ply"
[camera]
width = 320
height = 240
hfov_deg = 46
[selection]
goal = "fewest_cameras"
coverage = 0.3
[[candidates]]
generator = "poses"
file = "poses.json"
"""
CALIBRATION = """%YAML:1.0
---
image_width: 1280
image_height: 1024
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1500., 0., 639.5, 0., 1500., 511.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.05, 0.02, 0., 0., 0. ]
"""
CHAIN = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.05, 0.02, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [900.0, 900.0, 639.5, 511.5]
  resolution: [1280, 1024]
"""
ASSEMBLY = ("plate_1", "l-bracket-assembly_1/l-bracket_1", "l-bracket-assembly_2/l-bracket_1")
"""Groups of as1.stp, a public assembly, that the pages name."""


def write_files(folder: Path) -> None:
    """Write all of them; lengths are those of a part of 60 mm."""
    part, fixture = trimesh.creation.icosphere(2, 30), trimesh.creation.box((80, 80, 4))
    fixture.apply_translation((0, 0, -40))
    small = part.copy().apply_scale(1e-3)
    for name, mesh in {
        "part.stl": part, "fixture.stl": fixture, "fixture.obj": fixture, "part.ply": small,
        "mesh.ply": small,
    }.items():  # fmt: skip
        mesh.export(folder / name)
    bodies = []
    for row, name in enumerate(ASSEMBLY):
        corners = small.vertices + np.array((0.1 * row, 0, 0))
        bodies += [f"g {name}", *("v {} {} {}".format(*corner) for corner in corners)]
        faces = small.faces + 1 + row * len(corners)
        bodies += ["f {} {} {}".format(*face) for face in faces]
    (folder / "as1.obj").write_text("\n".join(bodies), encoding="utf-8")
    (folder / "camera.toml").write_text(CAMERA, encoding="utf-8")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    for name in ("calib.yaml", "calibration.yaml", "l.yaml", "r.yaml"):
        (folder / name).write_text(CALIBRATION, encoding="utf-8")
    (folder / "camchain.yaml").write_text(CHAIN, encoding="utf-8")
    poses = rc.sphere_of_poses((0, 0, 0), distance=0.3, count=6)
    np.save(folder / "poses.npy", poses)
    write_poses(folder / "poses.json", poses)
    write_poses(folder / "stereo.json", poses, ["left", "right"] * 3)
    rig = {
        "cameras": [{"name": "own", "width": 320, "height": 240, "fx": 380, "fy": 380}],
        "world_from_camera": poses.tolist(),
        "camera": [0] * len(poses),
        "images": [f"{row}.png" for row in range(len(poses))],
    }
    (folder / "rig.json").write_text(json.dumps(rig), encoding="utf-8")
    (folder / "sparse").mkdir()
    rc.write_views(folder / "sparse/0", rc.read_views(folder / "rig.json"), format="colmap")
    house = bungalow().replace(b"Kitchen", rb"K\X2\00FC\X0\che").replace(b"'Hall'", b"'Flur'")
    (folder / "house.ifc").write_bytes(house.replace(b"'Ground'", b"'Erdgeschoss'"))
