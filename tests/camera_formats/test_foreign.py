"""BOP, ASL and .ini of ROS against their equations; programs whose files are not read, by name."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from view_files import (
    ANSWERS,
    BOP,
    KALIBR,
    RIG_OF_ASL,
    ROS_INI,
    cv_pixels,
    good_files,
    has_note,
    motion,
    projects,
    refused,
    same,
)

import rastercov as rc
from rastercov.formats.cameras import READERS, foreign, read_views

TURN = st.tuples(*[st.floats(-2, 2)] * 3)
SHIFT = st.tuples(*[st.floats(-3000, 3000)] * 3)
FOCAL, MIDDLE = st.floats(200, 900), st.floats(100, 400)
K = st.tuples(FOCAL, FOCAL, MIDDLE, MIDDLE)
SMALL = [-0.1, 0.02, 0.001, -0.002, 0.01, 0.002, -0.001, 0.003]


def matrix(fx, fy, cx, cy):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def of_text(folder, name, text, **conventions):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return read_views(path, conventions=rc.Conventions(**conventions))


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(K, TURN, SHIFT, st.booleans()), min_size=1, max_size=4), st.booleans())
def test_images_of_bop_are_at_their_places_in_metres(tmp_path_factory, images, as_yaml):
    folder = tmp_path_factory.mktemp("bop")
    content, poses = {}, []
    for row, (k, turn, shift, nested) in enumerate(images):
        pose = motion(turn, shift)
        r, t = pose[:3, :3], pose[:3, 3]
        rows = matrix(*k) if nested else matrix(*k).ravel()
        content[str(3 * row)] = {
            "cam_K": rows.tolist(), "depth_scale": 0.1, "view_level": 0,
            "cam_R_w2c": (r if nested else r.ravel()).tolist(), "cam_t_w2c": t.tolist(),
        }  # fmt: skip
        pose[:3, 3] /= 1000
        poses.append(np.linalg.inv(pose))
    name, text = "scene_camera.json", json.dumps(content)
    if as_yaml:  # as before 2019
        name, text = "scene_camera.yml", yaml.dump({int(k): v for k, v in content.items()})
    views = of_text(folder, name, text, image_size=(640, 480))
    same(views.poses.world_from_camera, poses, 1e-9)
    assert views.has_unit
    assert views.images == tuple(content)
    for row, (k, *_) in enumerate(images):
        camera = views.cameras()[views.poses.camera[row]]
        rays = np.array([[0.1, -0.2, 1.0], [0.3, 0.1, 1.0]])
        projects(camera, cv_pixels(rays, matrix(*k), [0.0] * 4), rays)
    alone = of_text(folder, "000003.camera.json", json.dumps(content["0"]), image_size=(640, 480))
    same(alone.poses.world_from_camera, poses[:1], 1e-9)
    refused(folder / "000003.camera.json", "--image-size")


def test_a_scene_of_bop_has_the_size_of_its_sensor_and_may_have_no_poses(tmp_path):
    sensor = {"cx": 325.3, "cy": 242.0, "depth_scale": 0.1, "fx": 572.4, "fy": 573.6}
    sensor |= {"height": 480, "width": 640}
    alone = of_text(tmp_path, "camera_tof.json", json.dumps(sensor))
    assert (alone.camera().width, alone.camera().cx, alone.camera().cy) == (640, 325.8, 242.5)
    assert has_note(alone, "depth_scale is not used")
    text = json.dumps(BOP)
    views = of_text(tmp_path, "test/000001/scene_camera_tof.json", text)
    assert views.camera() == alone.camera()
    assert has_note(views, "image size is that of the sensor, camera_tof.json")
    cropped = of_text(tmp_path, "test/000001/scene_camera_tof.json", text, image_size=(400, 300))
    assert cropped.camera().width == 400
    refused(tmp_path / "test" / "000001" / "other.json", "no such file")
    of_text(tmp_path, "test/000001/scene_camera.json", text, image_size=(9, 9))
    refused(tmp_path / "test/000001/scene_camera.json", "--image-size")  # of another sensor
    bare = {name: {"cam_K": BOP["0"]["cam_K"], "depth_scale": 1} for name in "12"}
    bare_views = of_text(tmp_path, "bare.json", json.dumps(bare), image_size=(640, 480))
    assert (len(bare_views.poses), len(bare_views.cameras())) == (0, 1)
    mixed = of_text(tmp_path, "mixed.json", json.dumps(bare | BOP), image_size=(640, 480))
    assert mixed.images == ("0",)
    assert has_note(mixed, "2 of 3 images have no cam_R_w2c")


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.tuples(K, st.sampled_from([4, 5, 8])), min_size=1, max_size=3),
    st.booleans(),
    st.booleans(),
)
def test_sections_of_an_ini_are_cameras(tmp_path_factory, cameras, repeats, is_fisheye):
    """Stereo files repeat [image]; comments, blank lines and [externals] come in between."""
    parts = []
    for row, (k, n) in enumerate(cameras):
        if repeats or not row:
            parts.append(f"# oST 5.0\n[image]\n\nwidth\n{640 + row}\n; px\nheight\n480 # rows\n")
        lines = ["\t".join(map(repr, line)) for line in matrix(*k).tolist()]
        parts += [f"[cam/{row}]", "", "camera matrix", lines[0], "", *lines[1:], "distortion"]
        parts += [" ".join(map(repr, SMALL[:n])), "rectification", "1 0 0\n0 1 0\n0 0 1", ""]
        parts += ["projection", "400 0 320 7\n0 401 239 0\n0 0 1 0"]
    parts += ["[externals]", "translation", "1 2 3", "rotation", "0 0 0"]
    model = "fisheye" if is_fisheye else "brown"
    folder = tmp_path_factory.mktemp("ini")
    views = of_text(folder, "ost.txt", "\r\n".join(parts), lens_model=model)
    assert views.rig.names == tuple(f"cam/{row}" for row in range(len(cameras)))
    assert not len(views.poses)
    assert has_note(views, "translation is not read")
    rays = np.array([[0.1, -0.2, 1.0], [0.3, 0.1, 1.0]])
    for row, (camera, (k, n)) in enumerate(zip(views.cameras(), cameras, strict=True)):
        assert (camera.width, camera.height) == (640 + row * repeats, 480)
        wanted = cv_pixels(rays, matrix(*k), SMALL[:n], fisheye=is_fisheye and n == 4)
        projects(camera, wanted, rays)
    if any(n == 4 for _, n in cameras):
        refused(folder / "ost.txt", "--lens-model")


def test_faults_of_an_ini_are_one_line(tmp_path):
    for old, new, words in (
        ("640", "640 1", "image_width"),
        ("480", "x", "image_height"),
        ("0.0 0.0 1.0", "0.0 0.0", "[narrow_stereo/left]: expected camera_matrix"),
        ("-0.1 ", "", "--lens-model"),
        ("-0.1 ", "_1 ", "distortion_coefficients"),
        ("rectification", "distortion", "expected distortion once"),
        ("camera matrix", "camera_matrix", "--from"),
    ):
        path = tmp_path / "o.ini"
        assert old in ROS_INI
        path.write_text(ROS_INI.replace(old, new, 1))
        refused(path, words)


WORDS_OF_ASL = {"radial-tangential": False, "radtan": False, "equidistant": True, "equi": True}


@settings(max_examples=20, deadline=None)
@given(K, TURN, st.sampled_from([*WORDS_OF_ASL, "none"]), st.sampled_from(["euroc", "kimera"]))
def test_a_sensor_of_asl_is_at_its_place_whoever_wrote_it(tmp_path_factory, k, turn, word, writer):
    place = motion(turn, (0.1, -0.2, 0.3))
    values = SMALL[:4] if word != "none" else [0, 0, 0, 0]
    first = "sensor_type: camera" if writer == "euroc" else "%YAML:1.0\ncamera_id: left_cam"
    text = (
        f"{first}\nT_BS:\n  cols: 4\n  rows: 4\n  data: {place.ravel().tolist()}\nrate_hz: 20\n"
        f"resolution: [640, 480]\ncamera_model: pinhole\nintrinsics: {list(k)}\n"
        f"distortion_model: {word}\ndistortion_coefficients: {values}\n"
    )
    rays = np.array([[0.1, -0.2, 1.0], [0.3, 0.1, 1.0]])
    wanted = cv_pixels(rays, matrix(*k), values, fisheye=WORDS_OF_ASL.get(word, False))
    views = of_text(tmp_path_factory.mktemp("asl"), "LeftCameraParams.yaml", text)
    same(views.poses.world_from_camera, [place], 1e-9)
    projects(views.camera(), wanted, rays)


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.tuples(K, TURN, st.sampled_from([*WORDS_OF_ASL, "none"])), min_size=1, max_size=3),
    st.booleans(),
    st.booleans(),
)
def test_rigs_of_svo_and_maplab_have_their_cameras_on_the_body(
    tmp_path_factory, cameras, is_flat, in_sensors
):
    entries, places = [], []
    for k, turn, word in cameras:
        place = motion(turn, (0.1, -0.2, 0.3))
        places.append(place)
        lens = SMALL[:4] if word != "none" else []
        parts = {"parameters": lens if is_flat else {"cols": 1, "rows": len(lens), "data": lens}}
        camera = {"image_height": 480, "image_width": 640, "type": "pinhole", "line-delay": 0}
        camera |= {"intrinsics": list(k) if is_flat else {"data": list(k)}}
        camera |= {"distortion": parts | {"type": word}}
        data = place.tolist() if is_flat else {"data": place.ravel().tolist()}
        entries.append({"camera": camera, "T_B_C": data})
    content = {"label": "rig", "cameras": entries, "imu_params": {"g": 9.8}}
    if in_sensors:
        imu = {"sensor_type": "IMU", "topic": "/imu0"}
        content = {"sensors": [imu, content | {"sensor_type": "NCAMERA"}], "extrinsics": []}
    views = of_text(tmp_path_factory.mktemp("rig"), "calib.yaml", yaml.dump(content))
    same(views.poses.world_from_camera, places, 1e-9)
    assert has_note(views, "extrinsics of sensors are not read") == in_sensors
    rays = np.array([[0.1, -0.2, 1.0], [0.3, 0.1, 1.0]])
    for camera, (k, _, word) in zip(views.cameras(), cameras, strict=True):
        d = SMALL[:4] if word != "none" else [0.0] * 4
        projects(camera, cv_pixels(rays, matrix(*k), d, WORDS_OF_ASL.get(word, False)), rays)
    omni = RIG_OF_ASL.replace("type: pinhole", "type: omni")
    with pytest.raises(rc.CameraError, match="type to be one of pinhole, unified-projection"):
        of_text(tmp_path_factory.mktemp("rig"), "omni.yaml", omni)


@pytest.mark.parametrize("below", [None, "cameras", "ncamera", "calibration"])
@pytest.mark.parametrize("names", [("left", "right"), ("camera0", "camera1"), ("cam0", "cam1")])
def test_a_chain_of_kalibr_may_be_under_other_names(tmp_path, names, below):
    wanted = of_text(tmp_path, "k.yaml", KALIBR)
    chain = dict(zip(names, yaml.safe_load(KALIBR).values(), strict=True))
    content = chain if below is None else {"rostopics": ["a"], below: chain}
    views = of_text(tmp_path, "other.yaml", yaml.dump(content, sort_keys=False))
    assert views.cameras() == wanted.cameras()
    same(views.poses.world_from_camera, wanted.poses.world_from_camera)
    assert has_note(views, f"took '{names[0]}', '{names[1]}' for cam0") == ("cam0" not in names)
    lone = of_text(tmp_path, "lone.yaml", yaml.dump(next(iter(chain.values()))))
    assert lone.cameras() == wanted.cameras()[:1]


def test_what_is_read_as_json_is_read_as_yaml(tmp_path):
    files = good_files(tmp_path)
    for path in {path for path in files.values() if path.suffix in (".json", ".geojson", ".sfm")}:
        other = path.with_suffix(".yaml")
        other.write_text(yaml.dump(json.loads(path.read_text())))
        one, two = (read_views(each, conventions=ANSWERS) for each in (path, other))
        assert one.images in (two.images, tuple(sorted(two.images)))
        same(one.poses.world_from_camera, two.poses.world_from_camera)
        assert one.rig is None or one.cameras() == two.cameras()


XML = '<?xml version="1.0" encoding="utf-8"?>\n'
SIX = "612000.1 5501000.2 130.3 0.1 -0.2 0.3"
PROGRAMS = {
    "RealityCapture": [
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><d xcr:Version="3" '
        'xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#"/></x:xmpmeta>',
        "#cameras 1\n#name,x,y,alt,heading,pitch,roll,f,px,py\na.jpg,1,2,3,4,5,6,7,8,9\n",
        "#name,x,y,z,omega,phi,kappa\na.jpg,1,2,3,4,5,6\n",
    ],
    "ContextCapture": [f'{XML}<BlocksExchange version="3.2"><Block/></BlocksExchange>'],
    "MicMac": [
        f"{XML}<ExportAPERO><OrientationConique/></ExportAPERO>",
        "<OrientationConique><OrIntImaM2C/></OrientationConique>",
        "<ExportAPERO>\n<CalibrationInternConique><F>3000</F></CalibrationInternConique>"
        "</ExportAPERO>",
    ],
    "VisualSFM": ["NVM_V3\n\n1\na.jpg\t2900 1 0 0 0 1 2 3 0 0\n\n0\n", "NVM_V3_R9T \n\n1\n"],
    "DSO": [
        "Pinhole 0.53 0.93 0.49 0.5 0\n640 480\ncrop\n640 480\n",
        "0.349 0.436 0.493 0.499 0.933\n1280 1024\nfull\n640 480\n",
        "FOV 0.34 0.43 0.49 0.49 0.93\r\n1280 1024\r\n0.4 0.53 0.5 0.5 0\r\n640 480\r\n",
        "RadTan 458 457 367 248 -0.28 0.07 0.0001 0.00001\n752 480\nnone\n752 480\n",
    ],
    "ZED": [
        "[LEFT_CAM_2K]\nfx=1400.1\nfy=1400.1\ncx=1100\ncy=620\nk1=-0.17\n\n[STEREO]\nBaseline=120\n",
        "[STEREO]\nBaseline=63\n[RIGHT_CAM_HD]\nfx=700\n",
    ],
    "SDFormat": [
        f'{XML}<sdf version="1.6"><model name="m"><sensor type="camera"/></model></sdf>',
        "<sensor><camera><horizontal_fov>1.047</horizontal_fov></camera></sensor>",
    ],
    "angles": [
        f"# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11\na.jpg, {SIX.replace(' ', ', ')}, 1\n",
        f"imageName X Y Z Omega Phi Kappa\na.jpg {SIX}\n",
        f"Label;X;Y;Z;omega [deg];phi [deg];kappa [deg]\na;{SIX.replace(' ', ';')}\n",
        f"a.jpg {SIX}\nb.jpg {SIX}\n",
    ],
    "QGroundControl": [
        '{"fileType": "Plan", "version": 1, "mission": {"items": []}}',
        '{"groundStation": "QGroundControl", "items": [], "version": 1}',
        "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47.4\t8.5\t488\t1\n",
    ],
    "BOP": [
        '{"0": [{"cam_R_m2c": [1, 0, 0], "cam_t_m2c": [0, 0, 9], "obj_id": 1}]}',
        "0:\n- cam_R_m2c: [1, 0, 0]\n  cam_t_m2c: [0, 0, 9]\n  obj_id: 1\n",
    ],
    "an IMU": ["%YAML:1.0\nrate_hz: 200\ngyroscope_noise_density: 1.7e-4\nT_BS: {data: [1]}\n"],
    "maplab": ["sensors:\n- id: a1\n  sensor_type: LIDAR\n  topic: /os1\n"],
    "SVO": ["rig:\n- camera: {a: 1}\n  T_B_C: {data: [1, 0]}\n"],
    "Kimera": ["%YAML:1.0\ncamera_id: left_cam\nT_BS: {data: [1, 0]}\nrate_hz: 20\n"],
}


def test_every_program_of_the_table_is_tested():
    assert len(PROGRAMS) == len(foreign.SIGNATURES)


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_file_of_another_program_is_named_with_what_to_export(tmp_path, program):
    for row, text in enumerate(PROGRAMS[program]):
        suffixes = (".json",) if text[0] == "{" else (".txt", ".conf", "")
        suffixes = (".xml", ".xmp") if text[0] == "<" else suffixes
        suffixes = (".yaml", ".yml") if ":\n" in text or text[0] == "%" else suffixes
        for suffix in suffixes:
            path = tmp_path / f"file{row}{suffix}"
            path.write_bytes(text.encode())
            error = str(refused(path, f"got {program}", "; "))
            assert not any(word in error for word in ("valid JSON", "valid YAML", "--from"))


def test_no_good_file_has_the_signature_of_another_program(tmp_path):
    """A reader comes first; this is for those that a reader does not know by its content."""
    for path in good_files(tmp_path).values():
        if path.suffix not in (".npy", ".bin", ".glb"):
            foreign.refuse(path.read_bytes().replace(b"T_B", b"").replace(b"camera_id", b""))
    assert "bop" in READERS


def test_what_photoscan_wrote_up_to_1_2_has_fx_and_a_principal_point_from_the_corner(tmp_path):
    old = (
        "<calibration><projection>frame</projection><width>4000</width><height>3000</height>"
        "<fx>2900</fx><fy>2910</fy><cx>2010</cx><cy>1490</cy><skew>1.5</skew><k1>-0.1</k1>"
        "<k2>0.02</k2>{}</calibration>"
    )
    new = (
        "<calibration><projection>frame</projection><width>4000</width><height>3000</height>"
        "<f>2910</f><b1>-10</b1><b2>1.5</b2><cx>10</cx><cy>-10</cy><k1>-0.1</k1><k2>0.02</k2>"
        "</calibration>"
    )
    cameras = [of_text(tmp_path, "c.xml", text).camera() for text in (old.format(""), new)]
    assert cameras[0] == cameras[1]
    assert cameras[0] == of_text(tmp_path, "c.xml", old.format("<p1>0</p1>")).camera()
    path = tmp_path / "c.xml"
    path.write_text(old.format("<p1>0.001</p1>"))
    refused(path, "expected no p1 and p2 beside fx")
