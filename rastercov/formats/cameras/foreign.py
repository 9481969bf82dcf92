"""Signatures of files that programs write and that are not read, with what to export instead.

A file that no reader knows is named by the first pattern that its beginning has. Sources: examples
of each program; JakobEngel/dso, README; stereolabs, zed-open-capture; PX4, QGroundControl manual,
"Plan File Format"; VisualSFM, "NView Match format"; Bentley, "BlocksExchange schema".
"""

import re

from rastercov.base import CameraError

BEGINNING = 1 << 16
"""Bytes of a file that are searched."""
NUMBERS = r"(?:[-+\d.eE]+[ \t]+){3,}[-+\d.eE]+[ \t]*\r?\n"
COLMAP = "export COLMAP or Bundler"
CAMERA_FILE = "write width, height, fx, fy, cx, cy and the lens into a camera file"
SIGNATURES = (
    ("RealityCapture", r"capturingreality|\bxcr:\w|^#?\s*name,x,y,(alt|z),\w", COLMAP),
    (
        "ContextCapture (BlocksExchange)",
        "<BlocksExchange",
        "export COLMAP or Bundler from it, or from a program that imports it",
    ),
    (
        "MicMac",
        r"<(ExportAPERO|OrientationConique|CalibrationInternConique|CalibrationInterneRadiale)\b",
        "undistort the images, and write poses as JSON: world_from_camera, in conventions.md",
    ),
    ("VisualSFM (NVM)", r"\ANVM_V\d", "save it as bundle.out"),
    (
        "DSO",
        rf"\A\s*((Pinhole|FOV|ATAN|RadTan|EquiDistant|KannalaBrandt)[ \t]+)?{NUMBERS}"
        r"[ \t]*\d+[ \t]+\d+[ \t]*\r?\n[ \t]*(crop|full|none|[-+\d.])",
        CAMERA_FILE,
    ),
    (
        "ZED",
        r"^\[(LEFT|RIGHT)_(CAM|DISTO)(_\w+)?\]",
        f"{CAMERA_FILE}, or save the camera_info of its ROS node",
    ),
    (
        "SDFormat (Gazebo)",
        r"<sdf\b|<horizontal_fov>",
        "write width, height and hfov_deg into a camera file, or save a camera_info",
    ),
    (
        "QGroundControl",
        r'"groundStation"\s*:|"fileType"\s*:\s*"Plan"|\AQGC WPL',
        "a mission has no poses of images; reconstruct its images, and export COLMAP",
    ),
    (
        "angles omega, phi, kappa",
        r"omega[^a-z\n]*(deg[^a-z\n]*)?phi[^a-z\n]*(deg[^a-z\n]*)?kappa"
        r"|\A[^\s,;]+\.(jpe?g|tiff?|png|dng)([\s,;]+[-+\d.eE]+){6}[ \t]*\r?$",
        "they have no lens; export COLMAP or Bundler, XML of Metashape, or "
        "*_calibrated_camera_parameters.txt of Pix4D",
    ),
    (
        "BOP (ground truth of objects)",
        r'"cam_[Rt]_m2c"|^\s*cam_[Rt]_m2c:',
        "name the scene_camera.json beside it",
    ),
    (
        "an IMU",
        r"^(gyro|gyroscope)_noise_density\s*:|^\s*sensor_type:\s*imu\b",
        "name the file of the cameras beside it",
    ),
    (
        "maplab",
        r"^sensors:[\s\S]*\bsensor_type:",
        "name a file with the table cameras of a sensor of type NCAMERA",
    ),
    ("SVO", r"^\s*T_B_C\s*:", "write the list cameras, each with camera and T_B_C"),
    ("Kimera-VIO", r"^\s*T_BS\s*:|^camera_id\s*:", "name LeftCameraParams.yaml, with intrinsics"),
)
"""Name of a program, pattern of its files, and advice."""


def refuse(data: bytes) -> None:
    """CameraError for a file of a known program, with what to export."""
    text = data[:BEGINNING].decode("utf-8-sig", "replace")
    for program, pattern, advice in SIGNATURES:
        if re.search(pattern, text, re.IGNORECASE | re.MULTILINE):
            raise CameraError(f"expected cameras that can be read, got {program}; {advice}")
