"""Camera files of many formats, pixels by published equations, and checks that the tests share."""

import json

import cv2
import numpy as np
import pytest

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.mesh.arrays import inverse
from rastercov.formats.cameras import read_views, write_views

SIZE = rc.Conventions(image_size=(640, 480))
ANSWERS = rc.Conventions(image_size=(640, 480), pixel_centre=0.5, lens_model="brown", pose_unit="m")
RAYS = np.column_stack([np.random.default_rng(0).uniform(-0.4, 0.4, (20, 2)), np.ones(20)])


def pixels_of(views, points):
    """(P, N, 2) pixels of world points (N, 3) in each pose of views."""
    lenses = [lens_of(camera) for camera in views.cameras()]
    out = []
    for pose, row in zip(inverse(views.poses.world_from_camera), views.poses.camera, strict=True):
        out.append(lenses[row].project(points @ pose[:3, :3].T + pose[:3, 3]))
    return np.array(out)


def same_pixels(one, other, points):
    """Assert that two views give the same pixels of these points, and that some are seen."""
    a, b = pixels_of(one, points), pixels_of(other, points)
    both = np.isfinite(a).all(axis=-1) & np.isfinite(b).all(axis=-1)
    # At the border of the valid region one may end earlier; inside the image none does.
    sizes = np.array([(c.width, c.height) for c in one.cameras()])[one.poses.camera][:, None]
    inside = np.isfinite(a).all(axis=-1) & (a >= 0).all(axis=-1) & (a <= sizes).all(axis=-1)
    assert inside.any()
    assert both[inside].all()
    np.testing.assert_allclose(a[inside], b[inside], rtol=0, atol=1e-6)


def some_points(rng, n=60):
    """Points around the origin, for cameras some metres away."""
    return rng.uniform(-1, 1, (n, 3))


def same(result, wanted, atol=1e-12):
    """Assert that two arrays agree."""
    np.testing.assert_allclose(result, wanted, rtol=0, atol=atol)


def projects(camera, wanted, rays=RAYS):
    """Assert the pixels of rays through the lens of a camera."""
    same(lens_of(camera).project(rays), wanted, 1e-9)


def refused(path, *words, conventions=None):
    """Assert that a file is refused in one line with these words; the error."""
    with pytest.raises((rc.CameraError, rc.PoseError)) as caught:
        read_views(path, conventions=conventions)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 700
    assert all(word in text for word in words), text
    return caught.value


def has_note(views, words):
    """True where a note of views, or a line of several, has these words."""
    return any(words in note for note in getattr(views, "notes", views))


def motion(rvec, translation):
    """(4, 4) of a rotation vector and a translation."""
    out = np.eye(4)
    out[:3, :3], _ = cv2.Rodrigues(np.array(rvec, dtype=float))
    out[:3, 3] = translation
    return out


# --- pixels by equations --------------------------------------------------------------------------


def slopes(rays):
    """x / z and y / z of rays (N, 3)."""
    return rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]


def by_angle(rays, law):
    """Slopes whose distance from the axis is a law of the angle, which is a fisheye's."""
    x, y = slopes(rays)
    r = np.hypot(x, y)
    return x * law(np.arctan(r)) / r, y * law(np.arctan(r)) / r


def bent(xy, k=(), p=(0, 0), s=(0, 0, 0, 0)):
    """Radial, tangential and prism terms of slopes, as OpenCV has them."""
    x, y = xy
    r2 = x * x + y * y
    f = 1 + sum(each * r2**power for power, each in enumerate(k, 1))
    return (
        x * f + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x) + s[0] * r2 + s[1] * r2**2,
        y * f + 2 * p[1] * x * y + p[0] * (r2 + 2 * y * y) + s[2] * r2 + s[3] * r2**2,
    )


def pixels(xy, fx, fy, cx, cy):
    """(N, 2) pixels of slopes."""
    return np.column_stack([fx * xy[0] + cx, fy * xy[1] + cy])


def cv_pixels(rays, k, d, fisheye=False):
    """Pixels by cv2, counted from their centres, plus a half."""
    zero, d = np.zeros(3), np.array(d)
    if fisheye:
        projectPoints, _ = cv2.fisheye.projectPoints(rays[None], zero, zero, k, d)
    else:
        projectPoints, _ = cv2.projectPoints(rays, zero, zero, k, d)
    return projectPoints.reshape(-1, 2) + 0.5


# --- a good file of each format -------------------------------------------------------------------

KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  resolution: [752, 480]
cam1:
  camera_model: ds
  intrinsics: [-0.2, 0.6, 458.6, 457.3, 367.2, 248.4]
  distortion_model: none
  distortion_coeffs: []
  resolution: [752, 480]
  T_cn_cnm1: [[1.0, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""
METASHAPE = """<document version="2.0.0"><chunk label="c"><sensors><sensor id="0" label="s"
type="frame"><resolution width="640" height="480"/><calibration class="adjusted">
<resolution width="640" height="480"/><f>500</f><k1>-0.1</k1></calibration></sensor></sensors>
<transform><scale>0.5</scale></transform>
<cameras><camera id="0" sensor_id="0" label="a">
<transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera></cameras></chunk></document>"""
OPENSFM = {
    "cameras": {"c": {"projection_type": "brown", "width": 640, "height": 480, "focal_x": 0.8,
                      "focal_y": 0.8, "k1": 0.1}},
    "shots": {"a": {"rotation": [0.1, 0.2, 0.3], "translation": [1, 2, 3], "camera": "c"}},
}  # fmt: skip
SCENE = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"camera": 0}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 4 / 3}}],
}
OPEN3D = {"width": 640, "height": 480, "intrinsic_matrix": [500, 0, 0, 0, 501, 0, 319.5, 239.5, 1]}
BASALT = {
    "T_imu_cam": [{"px": 1.0, "py": 2.0, "pz": 3.0, "qx": 0.0, "qy": 0.0, "qz": 0.6, "qw": 0.8}],
    "intrinsics": [{"camera_type": "ds", "intrinsics": {"fx": 500.0, "fy": 501.0, "cx": 319.5,
                                                         "cy": 239.5, "xi": -0.2, "alpha": 0.6}}],
    "resolution": [[640, 480]],
}  # fmt: skip
VINS = """%YAML:1.0
---
model_type: KANNALA_BRANDT
camera_name: front
image_width: 640
image_height: 480
projection_parameters: {k2: -0.02, k3: 0.06, k4: -0.03, k5: -0.03, mu: 277.3, mv: 277.4, u0: 308.8,
                        v0: 247.5}
"""
ORB_SLAM = """%YAML:1.0
---
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.9
Camera1.fy: 190.8
Camera1.cx: 254.9
Camera1.cy: 256.8
Camera1.k1: 0.0034
Camera2.fx: 190.4
Camera2.fy: 190.3
Camera2.cx: 252.5
Camera2.cy: 255.0
Camera.width: 512
Camera.height: 512
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [1, 0, 0, 0.1, 0, 1, 0, 0.02, 0, 0, 1, 0, 0, 0, 0, 1]
ORBextractor.nFeatures: 1500
"""
EUROC = """sensor_type: camera
T_BS: {rows: 4, cols: 4, data: [0, -1, 0, -0.02, 1, 0, 0, -0.06, 0, 0, 1, 0.01, 0, 0, 0, 1]}
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.6, 457.3, 367.2, 248.4]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""
AZURE = {
    "Intrinsics": {"ModelParameterCount": 14, "ModelType":
                   "CALIBRATION_LensDistortionModelBrownConrady", "ModelParameters":
                   [0.5, 0.51, 0.48, 0.64, 0.58, -2.49, 1.36, 0.46, -2.33, 1.3, 0, 0, 1e-4, -2e-4]},
    "Location": "CALIBRATION_CameraLocationPV0",
    "MetricRadius": 1.7,
    "Rt": {"Rotation": [1, 0, 0, 0, 0, -1, 0, 1, 0], "Translation": [-0.032, -0.002, 0.004]},
    "SensorWidth": 4096,
    "SensorHeight": 3072,
}  # fmt: skip
REALSENSE = """Device info:
    Name                          : \tIntel RealSense D405

 Intrinsic of "Depth" / 640x480 / {Z16}
  Width:      \t640
  Height:     \t480
  PPX:        \t324.5
  PPY:        \t233.5
  Fx:         \t390.25
  Fy:         \t390.5
  Distortion: \tBrown Conrady
  Coeffs:     \t0.1  \t0  \t0.01  \t0  \t0
  FOV (deg):  \t78.7 x 63.17

 Intrinsic of "Color" / 1280x720 / {YUYV/RGB8}
  Width:      \t1280
  Height:     \t720
  PPX:        \t641.5
  PPY:        \t369.5
  Fx:         \t912.75
  Fy:         \t912.5
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0
  FOV (deg):  \t70.07 x 43.05

Extrinsic from "Color"\t  To\t  "Depth" :
 Rotation Matrix:
   0.999749        -0.021599        -0.00590855
"""
ZIVID = """__version__: {serializer: 1, data: 2}
CameraIntrinsics:
  CameraMatrix: {CX: 957.25, CY: 594.5, FX: 2765.0, FY: 2767.0}
  Distortion: {K1: -0.27, K2: 0.12, K3: -0.03, P1: 0.0001, P2: -0.0002}
"""
PIX4D = """fileName imageWidth imageHeight
camera matrix K [3x3]
radial distortion [3x1]
tangential distortion [2x1]
camera position t [3x1]
camera rotation R [3x3]
camera model m = K [R|-Rt] X

DJI 0954.JPG 4608 3456
3952.5 0 2233.25
0 3953.5 1667.75
0 0 1
0.038 -0.017 0.02
0.0024 0.0029
21.5 -29.5 30.75
0 -1 0
-1 0 0
0 0 -1
"""
LLFF = np.array([[0, 1, 0, 4, 480, 0, 0, -1, 5, 640, -1, 0, 0, 6, 500, 0.5, 9]], np.float64)
ALICEVISION = {
    "version": ["1", "2", "8"],
    "views": [{"viewId": "7", "poseId": "7", "intrinsicId": "3", "path": "/i/a.jpg"}],
    "intrinsics": [{"intrinsicId": "3", "width": "640", "height": "480", "sensorWidth": "32",
                    "type": "pinhole", "distortionType": "brown", "undistortionType": "none",
                    "focalLength": "25", "pixelRatio": "1.02", "principalPoint": ["3.5", "-2.25"],
                    "distortionParams": ["-0.1", "0.02", "0.003", "0.001", "-0.002"]}],
    "poses": [{"poseId": "7", "pose": {"transform": {
        "rotation": ["1", "0", "0", "0", "0", "1", "0", "-1", "0"], "center": ["1", "2", "3"]}}}],
}  # fmt: skip
OPENMVG = {
    "sfm_data_version": "0.3",
    "views": [{"key": 0, "value": {"polymorphic_id": 1073741824, "ptr_wrapper": {"id": 1, "data": {
        "filename": "a.jpg", "width": 640, "height": 480, "id_view": 0, "id_intrinsic": 0,
        "id_pose": 0}}}}],
    "intrinsics": [{"key": 0, "value": {
        "polymorphic_id": 2147483649, "polymorphic_name": "pinhole_brown_t2",
        "ptr_wrapper": {"id": 2, "data": {
            "width": 640, "height": 480, "focal_length": 500, "principal_point": [323.5, 237.75],
            "disto_t2": [-0.1, 0.02, 0.003, 0.001, -0.002]}}}}],
    "extrinsics": [{"key": 0, "value": {
        "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], "center": [1, 2, 3]}}],
}  # fmt: skip
ODM = {
    "type": "FeatureCollection",
    "features": [{"type": "Feature", "properties": {
        "filename": "a.jpg", "camera": "c", "focal": 0.8, "width": 640, "height": 480,
        "translation": [482751.75, 1557505.5, 1155.0], "rotation": [0.1, 0.2, 0.3]}}],
}  # fmt: skip
OKVIS = """%YAML:1.0
cameras:
    - {T_SC: [0, -1, 0, -0.02, 1, 0, 0, -0.06, 0, 0, 1, 0.01, 0, 0, 0, 1],
       image_dimension: [752, 480], distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002],
       distortion_type: radialtangential, focal_length: [458.6, 457.3],
       principal_point: [367.2, 248.4]}
    - {T_SC: [0, -1, 0, -0.02, 1, 0, 0, 0.05, 0, 0, 1, 0.01, 0, 0, 0, 1],
       image_dimension: [752, 480], distortion_coefficients: [0.01, 0.02, 0, 0],
       distortion_type: equidistant, focal_length: [458.6, 457.3], principal_point: [367.2, 248.4]}
imu_params: {a_max: 176.0}
"""
KITTI = "1 0 0 1.5 0 0 -1 2.5 0 1 0 3.5\n0 -1 0 4 1 0 0 5 0 0 1 6\n"
BOP = {
    "0": {"cam_K": [572.4, 0, 325.3, 0, 573.6, 242.0, 0, 0, 1], "depth_scale": 1.0,
          "cam_R_w2c": [1, 0, 0, 0, -1, 0, 0, 0, -1], "cam_t_w2c": [10.0, 20.0, 900.0]},
}  # fmt: skip
ROS_INI = """# oST version 5.0 parameters
[image]
width
640

height
480

[narrow_stereo/left]
camera matrix
400.5 0.0 320.5
0.0 401.5 239.25
0.0 0.0 1.0

distortion
-0.1 0.02 0.001 -0.002 0.003

rectification
1 0 0
0 1 0
0 0 1

projection
400 0 320.5 0
0 401 239.5 0
0 0 1 0
"""
RIG_OF_ASL = """label: rig
cameras:
- camera:
    label: cam0
    image_height: 480
    image_width: 640
    type: pinhole
    intrinsics: {cols: 1, rows: 4, data: [400, 401, 320.5, 239.5]}
    distortion:
      type: radial-tangential
      parameters: {cols: 1, rows: 4, data: [-0.1, 0.02, 0.001, -0.001]}
  T_B_C: {cols: 4, rows: 4, data: [0, -1, 0, 0.1, 1, 0, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]}
"""
TEXTS = {
    "bop": ("scene_camera.json", json.dumps(BOP)),
    "ini": ("ost.ini", ROS_INI),
    "rig": ("svo.yaml", RIG_OF_ASL),
    "okvis": ("okvis.yaml", OKVIS),
    "kitti": ("00.txt", KITTI),
    "alicevision": ("cameras.sfm", json.dumps(ALICEVISION)),
    "openmvg": ("sfm_data.json", json.dumps(OPENMVG)),
    "odm": ("shots.geojson", json.dumps(ODM)),
    "azure": ("azure.json", json.dumps({"CalibrationInformation": {"Cameras": [AZURE]}})),
    "realsense": ("realsense.txt", REALSENSE),
    "zivid": ("zivid.yml", ZIVID),
    "pix4d": ("p_calibrated_camera_parameters.txt", PIX4D),
    "open3d": ("open3d.json", json.dumps(OPEN3D)),
    "basalt": ("basalt.json", json.dumps({"value0": BASALT})),
    "camodocal": ("vins.yaml", VINS),
    "orbslam": ("orb.yaml", ORB_SLAM),
    "euroc": ("sensor.yaml", EUROC),
    "tum": ("tum.txt", "# time tx ty tz qx qy qz qw\n1.5 1 2 3 0 0 0.6 0.8\n2 1 2 3 0 0 0 1\n"),
    "kalibr": ("k.yaml", KALIBR),
    "metashape": ("m.xml", METASHAPE),
    "opensfm": ("o.json", json.dumps(OPENSFM)),
    "scene": ("s.gltf", json.dumps(SCENE)),
    "bundler": ("b.out", "# Bundle file v0.3\n1 0\n500 0.1 0.02\n1 0 0\n0 1 0\n0 0 1\n1 2 3\n"),
    "bal": ("bal.txt", "1 1 1\n0 0 1.5 2.5\n0.1\n0.2\n0.3\n1\n2\n3\n500\n0.1\n0.02\n0\n0\n1\n"),
    "mvsnet": (
        "cam.txt",
        "extrinsic\n1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n\nintrinsic\n5 0 3\n0 5 2\n0 0 1\n\n1 2\n",
    ),
}


def two_views():
    """Two poses of a camera with a lens."""
    camera = rc.Camera(
        width=640, height=480, fx=500, fy=500, model="opencv", distortion=(0.1, 0, 0, 0)
    )
    poses = rc.look_at(eyes=[(1.0, 2, 3), (3, 2, 1)], targets=(0, 0, 0))
    return rc.Views(rc.Rig([camera]), rc.Poses.of(poses), ("a.png", "b.png"))


def good_files(folder):
    """A good file of each format, by the format; those of a COLMAP model by "text cameras", ..."""
    written = {
        "rastercov": "own.json",
        "nerfstudio": "transforms.json",
        "opencv": "cv.yaml",
        "ros": "ros.yaml",
        "gltf": "rig.glb",
    }
    for form, name in written.items():
        write_views(folder / name, two_views(), format=form)
    write_views(folder / "text", two_views(), format="colmap-text")
    write_views(folder / "binary", two_views(), format="colmap")
    for name, text in TEXTS.values():
        (folder / name).write_text(text)
    np.save(folder / "poses_bounds.npy", LLFF)
    files = {form: folder / name for form, name in (written | {"llff": "poses_bounds.npy"}).items()}
    files |= {form: folder / name for form, (name, _) in TEXTS.items()}
    for part in ("cameras", "images"):
        files[f"text {part}"] = folder / "text" / f"{part}.txt"
        files[f"binary {part}"] = folder / "binary" / f"{part}.bin"
    return files
