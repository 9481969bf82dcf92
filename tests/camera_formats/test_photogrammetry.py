"""Metashape, OpenSfM, Bundler, BAL and MVSNet files, against their equations."""

import json

import numpy as np
import pytest
from view_files import (
    ALICEVISION,
    ODM,
    OPENMVG,
    OPENSFM,
    RAYS,
    SIZE,
    bent,
    by_angle,
    has_note,
    motion,
    pixels,
    pixels_of,
    projects,
    refused,
    same,
    slopes,
)

import rastercov as rc
from rastercov.formats.cameras import read_views

RNG = np.random.default_rng(7)
TURN, SHIFT = motion([0.3, -0.2, 0.5], [0, 0, 0])[:3, :3], np.array([1.0, -2.0, 3.0])


def words(array):
    return " ".join(map(repr, np.ravel(array).tolist()))


# --- Metashape ------------------------------------------------------------------------------------

METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1"><sensor id="0" label="unknown" type="{kind}">
      <resolution width="640" height="480"/>
      <bands><band label="Red"/></bands>
      <calibration type="{kind}" class="initial">
        <resolution width="640" height="480"/><f>999</f>
      </calibration>
      <calibration type="{kind}" class="adjusted">
        <resolution width="640" height="480"/>
        <f>500</f><cx>3.5</cx><cy>-2.25</cy><b1>1.5</b1><b2>-0.75</b2>
        <k1>-0.1</k1><k2>0.02</k2><k3>0.003</k3><k4>{k4}</k4><p1>0.001</p1><p2>-0.002</p2>
      </calibration>
    </sensor></sensors>
    <components next_id="1"><component id="0" label="Component 1"><transform>
      <rotation locked="true">{rotation}</rotation>
      <translation locked="true">{translation}</translation>
      <scale locked="true">0.5</scale></transform></component></components>
    <cameras next_id="3" next_group_id="1"><group id="0" label="Group" type="folder">
      <camera id="0" sensor_id="0" component_id="0" label="IMG_0"><transform>{pose}</transform>
      </camera></group>
      <camera id="1" sensor_id="0" component_id="0" label="IMG_1"><transform>{pose}</transform>
      </camera>
      <camera id="2" sensor_id="0" label="IMG_2"/>
    </cameras>
    <reference>LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0]]</reference>
  </chunk>
</document>
"""
POSE = motion([-0.3, 0.2, -0.5], 2 * SHIFT)
FRAME = METASHAPE.format(
    kind="frame", k4=0.04, rotation=words(TURN), translation=words(SHIFT), pose=words(POSE)
)


def metashape(folder, *changes):
    """Views of a file in which each text is replaced by the one after it."""
    text = FRAME
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    path = folder / "c.xml"
    path.write_text(text)
    return read_views(path)


@pytest.mark.parametrize("kind", ["frame", "fisheye", "equisolid_fisheye"])
@pytest.mark.parametrize("k4", [0.04, 0.0])
def test_metashape_lenses_follow_the_manual(tmp_path, kind, k4):
    laws = {"fisheye": lambda t: t, "equisolid_fisheye": lambda t: 2 * np.sin(t / 2)}
    xy = by_angle(RAYS, laws[kind]) if kind in laws else slopes(RAYS)
    a, b = bent(xy, (-0.1, 0.02, 0.003, k4), (-0.002, 0.001))  # its p1 and p2 are turned around
    wanted = np.column_stack([320 + 3.5 + a * 501.5 + b * -0.75, 240 - 2.25 + b * 500])
    views = metashape(tmp_path, 'type="frame"', f'type="{kind}"', "<k4>0.04", f"<k4>{k4}")
    projects(views.camera(), wanted)


def test_metashape_poses_pass_through_the_transform_of_the_component(tmp_path):
    views = metashape(tmp_path)
    assert views.images == ("IMG_0", "IMG_1")
    assert views.has_unit
    assert has_note(views, "1 images left out")
    # world = 0.5 TURN chunk + SHIFT, chunk = TURN^T camera + 2 SHIFT.
    wanted = np.eye(4)
    wanted[:3, 3] = 0.5 * TURN @ (2 * SHIFT) + SHIFT
    same(views.poses.world_from_camera[0], wanted)
    assert has_note(metashape(tmp_path, "LOCAL_CS", "GEOCCS"), "geocentric")
    bare = metashape(tmp_path, '<scale locked="true">0.5</scale>', "")
    assert not bare.has_unit


def test_what_metashape_has_disabled_is_left_out(tmp_path):
    views = metashape(tmp_path, 'label="IMG_0">', 'label="IMG_0" enabled="false">')
    assert views.images == ("IMG_1",)
    assert "1 images left out: they are disabled" in views.notes
    views = metashape(tmp_path, 'label="IMG_2"', 'label="IMG_2" master_id="1"')
    assert has_note(views, "1 images of further cameras of a rig left out")
    start, end = FRAME.index("  <chunk"), FRAME.index("</document>")
    chunk = FRAME[start:end]
    other = chunk.replace('enabled="true"', 'enabled="false"').replace("IMG_", "OLD_")
    views = metashape(tmp_path, chunk, other + chunk)
    assert views.images == ("IMG_0", "IMG_1")
    assert "the first enabled one of 2 chunks; each has its own frame" in views.notes
    assert metashape(tmp_path, chunk, other).images == ("OLD_0", "OLD_1")


def test_metashape_panoramas_are_of_all_directions(tmp_path):
    views = metashape(tmp_path, '"frame"', '"spherical"', 'height="480"', 'height="320"')
    rays = [[0, 0, 1.0], [1, 0, 0], [0, 1, 1]]
    projects(views.camera(), [[320, 160], [480, 160], [320, 240]], rays)


def test_metashape_groups_may_be_within_groups_and_terms_may_be_0(tmp_path):
    outer = ("<group ", '<group id="9" label="outer"><group ', "</group>", "</group></group>")
    views = metashape(tmp_path, *outer, "<p1>", "<p3>0</p3><p1>")
    assert views.images == ("IMG_0", "IMG_1")
    assert views.cameras() == metashape(tmp_path).cameras()


# --- OpenSfM --------------------------------------------------------------------------------------


def opensfm(path, camera, name="v2 cam"):
    shot = {"rotation": [0.3, -0.2, 0.5], "translation": SHIFT.tolist(), "camera": name}
    content = {"cameras": {name: {"width": 640, "height": 480, **camera}}}
    content |= {"shots": {"01.jpg": shot}, "points": {"1": {"coordinates": [0, 0, 1]}}}
    path.write_text(json.dumps([content]))
    return read_views(path)


def opensfm_pixels(camera):
    """OpenSfM's equations: camera_projections_functions.h and camera_distortions_functions.h."""
    c = dict.fromkeys([*SIX, "s0", "s1", "s2", "s3", "c_x", "c_y"], 0.0) | camera
    is_fisheye = c["projection_type"].startswith("fisheye")
    xy = by_angle(RAYS, lambda t: t) if is_fisheye else slopes(RAYS)
    terms = [[c[f"{name}{i}"] for i in range(*span)] for name, span in (
        ("k", (1, 7)), ("p", (1, 3)), ("s", (0, 4)))]  # fmt: skip
    fx = c.get("focal_x", c.get("focal"))
    # Pixels are counted from their centres: (w - 1) / 2 is the middle.
    centre = 640 * c["c_x"] + 319.5, 640 * c["c_y"] + 239.5
    return pixels(bent(xy, *terms), 640 * fx, 640 * c.get("focal_y", fx), *centre)


TWO = {"k1": -0.1, "k2": 0.02}
BOTH = {"focal_x": 0.8, "focal_y": 0.82, "c_x": 0.01, "c_y": -0.02}
SIX = {"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": 0.001, "k5": 2e-4, "k6": 1e-4}
SIX |= {"p1": 0.001, "p2": -0.002}
PRISM = {"s0": 1e-3, "s1": 2e-3, "s2": 3e-3, "s3": 4e-3}


@pytest.mark.parametrize(
    ("kind", "camera"),
    [
        ("perspective", {"focal": 0.8, **TWO}),
        ("simple_radial", {**BOTH, "k1": -0.1}),
        ("radial", {**BOTH, **TWO}),
        ("brown", {**BOTH, **TWO, "k3": 0.01, "p1": 0.001, "p2": -0.002}),
        ("fisheye", {"focal": 0.6, **TWO}),
        ("fisheye_opencv", {**BOTH, **TWO, "k3": 0.003, "k4": 0.001}),
        ("fisheye62", {**BOTH, **SIX}),
        ("fisheye624", {**BOTH, **SIX, **PRISM}),
    ],
)
def test_every_lens_of_opensfm_follows_its_equations(tmp_path, kind, camera):
    camera = {"projection_type": kind} | camera
    views = opensfm(tmp_path / "reconstruction.json", camera)
    projects(views.camera(), opensfm_pixels(camera) + 0.5)
    # Poses are camera_from_world.
    pose = views.poses.world_from_camera[0]
    same(pose[:3, :3], TURN.T)
    same(pose[:3, 3], -TURN.T @ SHIFT)
    # The table of cameras alone.
    (tmp_path / "camera_models.json").write_text(
        json.dumps({"v2 cam": {"width": 640, "height": 480, **camera}})
    )
    alone = read_views(tmp_path / "camera_models.json")
    assert (alone.rig.names, alone.cameras()) == (("v2 cam",), views.cameras())
    assert len(alone.poses) == 0
    assert alone.has_unit


@pytest.mark.parametrize("size", [(1000, 500), (1000, 400), (640, 480)])
def test_panoramas_of_opensfm_have_one_scale_across_and_down(tmp_path, size):
    camera = {"projection_type": "spherical", "width": size[0], "height": size[1]}
    views = opensfm(tmp_path / "reconstruction.json", camera)
    rays = RAYS * (1, 1, -1)
    X, Y, Z = rays.T
    across, down = np.arctan2(X, Z), np.arctan2(Y, np.hypot(X, Z))
    # Parts of the longer side, from the middle of the pixels: (w - 1) / 2 is 0.
    wanted = np.column_stack([across, down]) / (2 * np.pi) * max(size) + (np.array(size) - 1) / 2
    projects(views.camera(), wanted + 0.5, rays)


# --- Bundler and BAL ------------------------------------------------------------------------------


def snavely(points, rvec, f, k1, k2):
    """Bundler's manual: P = R X + t, p = -P / P.z, p' = f r(p) p, from the middle, y up."""
    P = points @ motion(rvec, AWAY)[:3, :3].T + AWAY
    x, y = -P[:, 0] / P[:, 2], -P[:, 1] / P[:, 2]
    return pixels(bent((x, y), (k1, k2)), f, -f, 320, 240)


POINTS = RNG.uniform(-1, 1, (20, 3))
CAMERAS = [(500.0, -0.1, 0.02, [0.1, 0.2, 0.3]), (600.0, 0.0, 0.0, [-0.1, 0.0, 0.2])]
AWAY = np.array([0.1, 0.2, -5.0])


def bundler(path):
    lines = ["# Bundle file v0.3", "3 1"]
    for f, k1, k2, rvec in CAMERAS:
        rows = motion(rvec, AWAY)[:3, :3]
        lines += [f"{f!r} {k1!r} {k2!r}", *map(words, rows), words(AWAY)]
    lines += ["0 0 0"] * 5 + ["0 0 1", "255 0 0", "1 0 3 1.5 2.5"]
    path.write_text("\n".join(lines) + "\n")
    return path


def bal(
    path, cameras=CAMERAS, points=((0.0, 0.0, 1.0),), seen=((0, 0, 1.5, 2.5), (1, 0, -3.5, 4.5))
):
    lines = [f"{len(cameras)} {len(points)} {len(seen)}"]
    lines += [f"{int(camera)} {int(row)} {u!r} {v!r}" for camera, row, u, v in seen]
    for f, k1, k2, rvec in cameras:
        lines += [repr(float(value)) for value in (*rvec, *AWAY, f, k1, k2)]
    path.write_text("\n".join([*lines, *map(repr, np.ravel(points).tolist())]) + "\n")
    return path


@pytest.mark.parametrize("write", [bundler, bal])
def test_bundler_and_bal_follow_the_manual(tmp_path, write):
    path = write(tmp_path / "cameras.out")
    refused(path, "expected an image size, got none in")
    views = read_views(path, conventions=SIZE)
    assert not views.has_unit
    assert has_note(views, "1 image without a camera left out") == (write is bundler)
    wanted = [snavely(POINTS, rvec, *lens) for *lens, rvec in CAMERAS]
    same(pixels_of(views, POINTS), wanted, 1e-9)


@pytest.mark.parametrize("unit", ["focal length", "pixels"])
@pytest.mark.parametrize("n_points", [20, 3])
def test_observations_of_bal_tell_the_unit_of_its_radii(tmp_path, unit, n_points):
    """A published problem has coefficients as small as -7e-8: of radii in pixels."""
    points, f, k1, k2, rvec = POINTS[:n_points], 500.0, -0.1, 0.02, [0.1, 0.2, 0.3]
    wanted = snavely(points, rvec, f, k1, k2)
    seen = (wanted + RNG.normal(scale=0.02, size=wanted.shape) - (320, 240)) * (1, -1)
    if unit == "pixels":
        k1, k2 = k1 / f**2, k2 / f**4
    rows = [(0, row, *each) for row, each in enumerate(seen.tolist())]
    path = bal(tmp_path / "problem.txt", [(f, k1, k2, rvec)], points, rows)
    views = read_views(path, conventions=SIZE)
    is_told = unit == "pixels" and n_points > 8
    assert has_note(views, "radii in pixels") == is_told
    error = np.abs(pixels_of(views, points)[0] - wanted).max()
    if is_told or unit == "focal length":
        assert error <= 1e-9
    else:  # too few to tell
        assert error > 0.02


def test_mvsnet_asks_for_size_and_pixel_centre_and_reads_a_folder(tmp_path):
    extrinsic = motion([0.3, -0.2, 0.5], SHIFT)
    text = "extrinsic\n" + "\n".join(map(words, extrinsic))
    text += "\n\nintrinsic\n500 0 320\n0 510 240\n0 0 1\n\n425 2.5 192 933.8\n"
    (tmp_path / "cams").mkdir()
    for row in range(2):
        (tmp_path / "cams" / f"{row:08d}_cam.txt").write_text(text)
    refused(tmp_path, "--image-size")
    refused(tmp_path, "--pixel-centre 0 for ", "or 0.5", conventions=SIZE)
    for centre, cx in ((0, 320.5), (0.5, 320.0)):
        answers = rc.Conventions(image_size=(640, 480), pixel_centre=centre)
        views = read_views(tmp_path, conventions=answers)
        assert views.camera().cx == cx
        assert views.images == ("00000000", "00000001")
        same(views.poses.world_from_camera[0], np.linalg.inv(extrinsic))
        assert len(read_views(tmp_path / "cams" / "00000000_cam.txt", conventions=answers).poses)


def test_every_image_of_a_metashape_rig_is_placed_by_its_sensor(tmp_path):
    mount = motion([0.1, -0.4, 1.2], [0.5, 0.1, -0.2])
    sensor = FRAME[FRAME.index("<sensor ") : FRAME.index("</sensor>")]
    further = sensor.replace('<sensor id="0"', '<sensor id="7" master_id="0"')
    further += (
        f"<rotation>{words(mount[:3, :3])}</rotation><location>{words(mount[:3, 3])}</location>"
    )
    changes = ["</sensor>", f"</sensor>{further}</sensor>"]
    changes += ['sensor_id="0" label="IMG_2"', 'sensor_id="7" label="IMG_2" master_id="0"']
    views = metashape(tmp_path, *changes)
    assert views.images == ("IMG_0", "IMG_1", "IMG_2")
    assert views.frames[0] == views.frames[2] != views.frames[1]
    first, _, third = views.poses.world_from_camera
    scaled = mount.copy()
    scaled[:3, 3] *= 0.5  # the chunk's scale
    same(third, first @ scaled)
    same(views.rig.rig_from_camera, [np.eye(4), scaled])


# --- AliceVision, OpenMVG, ODM --------------------------------------------------------------------

BROWN = (-0.1, 0.02, 0.003), (0.001, -0.002)
SEEN_ALONG_Y = np.array([[1.0, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 3], [0, 0, 0, 1]])


def written(folder, name, content):
    path = folder / name
    path.write_text(json.dumps(content))
    return path


def with_intrinsics(**entries):
    (own,) = ALICEVISION["intrinsics"]
    return ALICEVISION | {"intrinsics": [own | entries]}


@pytest.mark.parametrize(
    ("version", "entries", "focals"),
    [
        ("1 2 11", {}, (500 / 1.02, 500)),
        ("1 2 8", {}, (500, 510)),
        ("1 2 4", {"type": "brown"}, (500, 500 / 1.02)),
        ("1 2 1", {"type": "brown", "pxFocalLength": ["500", "510"]}, (500, 510)),
        ("1 2 0", {"type": "brown", "pxFocalLength": ["500", "510"],
                   "principalPoint": ["323.5", "237.75"]}, (500, 510)),
        ("1 0 0", {"type": "brown", "pxFocalLength": "500",
                   "principalPoint": ["323.5", "237.75"]}, (500, 500)),
    ],
)  # fmt: skip
def test_cameras_of_alicevision_are_those_of_each_version(tmp_path, version, entries, focals):
    content = with_intrinsics(**entries) | {"version": version.split()}
    views = read_views(written(tmp_path, "a.sfm", content), conventions=rc.Conventions())
    xy = bent(slopes(RAYS), *BROWN)
    projects(views.camera(), pixels(xy, *focals, 320 + 3.5 + 0.5, 240 - 2.25 + 0.5))
    same(views.poses.world_from_camera, [SEEN_ALONG_Y])
    assert views.images == ("a.jpg",)
    assert not views.has_unit


def test_views_of_a_rig_of_alicevision_are_at_their_places_on_it(tmp_path):
    view = ALICEVISION["views"][0] | {"rigId": "5", "isPoseIndependant": "0"}
    pose = {"status": "estimated", "pose": {"rotation": list("100010001"), "center": list("400")}}
    content = ALICEVISION | {
        "views": [view | {"subPoseId": "1"}, view | {"subPoseId": "0"}, view | {"poseId": "9"}],
        "rigs": [{"rigId": "5", "subPoses": [pose, pose | {"pose": pose["pose"] | {
            "center": list("070")}}]}],
    }  # fmt: skip
    views = read_views(written(tmp_path, "a.sfm", content))
    same(views.poses.world_from_camera[:, :3, 3], [[1, 2, 3 - 7], [5, 2, 3]])
    assert len(set(views.frames)) == 1
    assert has_note(views, "1 views left out: they have no pose, or no camera")


def test_lenses_of_alicevision_that_are_not_read_are_refused(tmp_path):
    for entries, words in (
        ({"distortionType": "radialk3pt"}, "got 'radialk3pt, none'; undistort"),
        ({"undistortionType": "3deradial4"}, "got 'brown, 3deradial4'; undistort"),
        ({"type": "equidistant"}, "got 'equidistant'; undistort"),
        ({"focalLength": "-1"}, "expected a focal length above 0"),
    ):
        refused(written(tmp_path, "a.sfm", with_intrinsics(**entries)), words)
    refused(written(tmp_path, "a.sfm", ALICEVISION | {"poses": ""}), "StructureFromMotion")


def test_openmvg_names_a_type_of_camera_once(tmp_path):
    first = OPENMVG["intrinsics"][0]
    again = {"key": 1, "value": {"polymorphic_id": 1, "ptr_wrapper": first["value"]["ptr_wrapper"]}}
    sphere = {"key": 2, "value": {
        "polymorphic_id": 2147483650, "polymorphic_name": "spherical",
        "ptr_wrapper": {"data": {"value0": {"width": 640, "height": 320}}}}}  # fmt: skip
    views = []
    for key in range(4):  # the last has no pose
        data = OPENMVG["views"][0]["value"]["ptr_wrapper"]["data"]
        data = data | {"id_intrinsic": min(key, 2), "id_pose": min(key, 2) if key < 3 else 9}
        views.append({"key": key, "value": {"ptr_wrapper": {"data": data}}})
    pose = OPENMVG["extrinsics"][0]
    content = OPENMVG | {"intrinsics": [first, again, sphere], "views": views,
                         "extrinsics": [pose | {"key": key} for key in range(3)]}  # fmt: skip
    views = read_views(written(tmp_path, "sfm_data.json", content))
    same(views.poses.world_from_camera, [SEEN_ALONG_Y] * 3)
    own, panorama = views.cameras()
    projects(own, pixels(bent(slopes(RAYS), *BROWN), 500, 500, 324, 238.25))
    rays = [[0, 0, 1.0], [1, 0, 0], [0, 1, 1]]
    projects(panorama, [[320, 160], [480, 160], [320, 240]], rays)
    assert views.poses.camera.tolist() == [0, 0, 1]
    assert has_note(views, "1 views left out")
    del content["intrinsics"][0]
    refused(written(tmp_path, "sfm_data.json", content), "expected a camera pinhole")


@pytest.mark.parametrize("has_name", [True, False])
def test_shots_of_odm_have_their_centers_and_the_lens_of_the_project(tmp_path, has_name):
    (tmp_path / "odm_report").mkdir()
    shot = ODM["features"][0]
    if not has_name:  # as before version 2.7
        own = {key: value for key, value in shot["properties"].items() if key != "camera"}
        shot = shot | {"properties": own}
    path = written(tmp_path, "odm_report/shots.geojson", ODM | {"features": [shot]})
    bare = read_views(path)
    assert bare.camera().distortion == ()
    assert has_note(bare, "ignored lens distortion: expected cameras.json of the project")
    written(tmp_path, "cameras.json", OPENSFM["cameras"])
    views = read_views(path)
    turn = motion([0.1, 0.2, 0.3], [0, 0, 0])[:3, :3].T
    same(views.poses.world_from_camera[0, :3, :3], turn)
    same(views.poses.world_from_camera[0, :3, 3], shot["properties"]["translation"])
    same_lens = read_views(written(tmp_path, "o.json", [OPENSFM])).camera()
    assert views.camera() == same_lens
    assert views.has_unit
    if has_name:
        names = [*OPENSFM["cameras"]]
        for before in ("", "v2 "):  # OpenSfM's prefix, which ODM leaves out in one of the files
            other = shot["properties"] | {"camera": before + names[0]}
            written(
                tmp_path, "odm_report/shots.geojson", ODM | {"features": [{"properties": other}]}
            )
            for prefix in ("", "v2 "):
                known = {prefix + name: each for name, each in OPENSFM["cameras"].items()}
                written(tmp_path, "cameras.json", known)
                result = read_views(path)
                assert result.camera() == same_lens
                assert result.notes == views.notes
        other = {"properties": shot["properties"] | {"camera": "v2 another"}}
        written(tmp_path, "odm_report/shots.geojson", ODM | {"features": [other]})
        result = read_views(path)
        assert has_note(result, f"distortion of 'another': cameras.json has {names[0]}")
        assert not result.camera().distortion
    refused(written(tmp_path, "none.geojson", {"type": "FeatureCollection", "features": []}),
            "none.geojson")  # fmt: skip
