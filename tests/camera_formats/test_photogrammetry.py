"""Metashape, OpenSfM, Bundler, BAL and MVSNet files, against their equations."""

import json

import cv2
import numpy as np
import pytest
from view_files import lens_of

import rastercov as rc
from rastercov.camera.formats import read_views
from rastercov.camera.formats.conventions import Conventions

SIZE = Conventions(image_size=(640, 480))
RNG = np.random.default_rng(7)
RAYS = np.column_stack([RNG.uniform(-0.4, 0.4, (20, 2)), np.ones(20)])
TURN, _ = cv2.Rodrigues(np.array([0.3, -0.2, 0.5]))
SHIFT = np.array([1.0, -2.0, 3.0])

# --- Metashape ------------------------------------------------------------------------------------

METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">
      <sensor id="0" label="unknown" type="{kind}">
        <resolution width="640" height="480"/>
        <property name="layer_index" value="0"/>
        <bands><band label="Red"/></bands>
        <calibration type="{kind}" class="initial">
          <resolution width="640" height="480"/><f>999</f>
        </calibration>
        <calibration type="{kind}" class="adjusted">
          <resolution width="640" height="480"/>
          <f>500</f><cx>3.5</cx><cy>-2.25</cy><b1>1.5</b1><b2>-0.75</b2>
          <k1>-0.1</k1><k2>0.02</k2><k3>0.003</k3>{k4}<p1>0.001</p1><p2>-0.002</p2>
        </calibration>
      </sensor>
    </sensors>
    <components next_id="1">
      <component id="0" label="Component 1">
        <transform>
          <rotation locked="true">{rotation}</rotation>
          <translation locked="true">{translation}</translation>
          <scale locked="true">0.5</scale>
        </transform>
      </component>
    </components>
    <cameras next_id="3" next_group_id="1">
      <group id="0" label="Group" type="folder">
        <camera id="0" sensor_id="0" component_id="0" label="IMG_0"><transform>{pose}</transform>
        </camera>
      </group>
      <camera id="1" sensor_id="0" component_id="0" label="IMG_1"><transform>{pose}</transform>
      </camera>
      <camera id="2" sensor_id="0" label="IMG_2"/>
    </cameras>
    <reference>LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],
      UNIT["metre",1,AUTHORITY["EPSG","9001"]]]</reference>
  </chunk>
</document>
"""


def metashape(path, kind="frame", k4="<k4>0.04</k4>", **changes):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = TURN.T, 2 * SHIFT
    words = {"rotation": TURN, "translation": SHIFT, "pose": pose} | changes
    words = {k: " ".join(map(repr, np.ravel(v).tolist())) for k, v in words.items()}
    path.write_text(METASHAPE.format(kind=kind, k4=k4, **words))
    return path


@pytest.mark.parametrize("kind", ["frame", "fisheye", "equisolid_fisheye"])
@pytest.mark.parametrize("k4", [0.04, 0.0])
def test_metashape_lenses_follow_the_manual(tmp_path, kind, k4):
    views = read_views(metashape(tmp_path / "c.xml", kind, f"<k4>{k4}</k4>"))
    X, Y, Z = RAYS.T
    x, y = X / Z, Y / Z
    r = np.sqrt(x * x + y * y)
    theta = np.arctan(r)
    if kind == "fisheye":
        x, y = x * theta / r, y * theta / r
    elif kind == "equisolid_fisheye":
        x, y = x * 2 * np.sin(theta / 2) / r, y * 2 * np.sin(theta / 2) / r
    r2 = x * x + y * y
    k1, k2, k3, p1, p2 = -0.1, 0.02, 0.003, 0.001, -0.002
    factor = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
    a = x * factor + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    b = y * factor + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    wanted = np.column_stack([320 + 3.5 + a * 500 + a * 1.5 + b * -0.75, 240 - 2.25 + b * 500])
    np.testing.assert_allclose(lens_of(views.camera()).project(RAYS), wanted, rtol=0, atol=1e-9)


def test_metashape_poses_pass_through_the_transform_of_the_component(tmp_path):
    views = read_views(metashape(tmp_path / "c.xml"))
    assert views.images == ("IMG_0", "IMG_1")
    assert views.has_unit
    assert any("1 images left out" in note for note in views.notes)
    # world = 0.5 TURN chunk + SHIFT, chunk = TURN^T camera + 2 SHIFT.
    wanted = np.eye(4)
    wanted[:3, 3] = 0.5 * TURN @ (2 * SHIFT) + SHIFT
    np.testing.assert_allclose(views.poses.world_from_camera[0], wanted, atol=1e-12)


def test_metashape_images_and_chunks_that_are_disabled_are_left_out(tmp_path):
    path = metashape(tmp_path / "c.xml")
    whole, text = read_views(path), path.read_text()
    path.write_text(text.replace('label="IMG_0">', 'label="IMG_0" enabled="false">'))
    views = read_views(path)
    assert views.images == ("IMG_1",)
    assert "1 images left out: they are disabled" in views.notes
    path.write_text(text.replace('label="IMG_0">', 'label="IMG_0" enabled="true">'))
    assert read_views(path).images == whole.images
    # The first chunk is disabled, and has other images.
    start, end = text.index("  <chunk"), text.index("</document>")
    chunk = text[start:end]
    other = chunk.replace('enabled="true"', 'enabled="false"').replace("IMG_", "OLD_")
    path.write_text(text[:start] + other + chunk + text[end:])
    views = read_views(path)
    assert views.images == whole.images
    assert "the first enabled one of 2 chunks; each has its own frame" in views.notes
    path.write_text(text[:start] + other + text[end:])
    assert read_views(path).images == ("OLD_0", "OLD_1")


def test_metashape_panoramas_are_of_all_directions(tmp_path):
    path = metashape(tmp_path / "c.xml", "spherical")
    with pytest.raises(rc.CameraError, match=r"a spherical image of 2:1 wanted, .*got 640 x 480"):
        read_views(path)
    path.write_text(path.read_text().replace('height="480"', 'height="320"'))
    found = lens_of(read_views(path).camera()).project([[0, 0, 1.0], [1, 0, 0], [0, 1, 1]])
    np.testing.assert_allclose(found, [[320, 160], [480, 160], [320, 240]], atol=1e-9)


def test_metashape_groups_may_be_within_groups(tmp_path):
    path = metashape(tmp_path / "c.xml")
    whole, text = read_views(path), path.read_text()
    text = text.replace("<group ", '<group id="9" label="outer"><group ')
    path.write_text(text.replace("</group>", "</group></group>"))
    assert read_views(path).images == whole.images == ("IMG_0", "IMG_1")


def test_metashape_terms_without_a_model_are_not_left_out(tmp_path):
    path = metashape(tmp_path / "c.xml")
    whole, text = read_views(path), path.read_text()
    path.write_text(text.replace("<p1>", "<p3>0</p3><p1>"))
    assert read_views(path).cameras() == whole.cameras()
    path.write_text(text.replace("<p1>", "<p3>0.25</p3><p1>"))
    with pytest.raises(rc.CameraError, match=r"its term p3 has no model here, got 0\.25"):
        read_views(path)


def test_metashape_cameras_of_a_rig_without_a_transform_are_counted(tmp_path):
    path = metashape(tmp_path / "c.xml")
    path.write_text(path.read_text().replace('label="IMG_2"', 'label="IMG_2" master_id="1"'))
    views = read_views(path)
    assert views.images == ("IMG_0", "IMG_1")
    assert any("1 images of further cameras of a rig left out" in note for note in views.notes)


def test_metashape_without_a_transform_has_no_unit(tmp_path):
    path = metashape(tmp_path / "c.xml")
    text = path.read_text()
    start, end = text.index("<components"), text.index("<cameras")
    path.write_text(text[:start] + text[end:])
    assert not read_views(path).has_unit


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('type="frame">\n', 'type="rpc">\n', "its type must be one of frame"),
        ("<f>500</f>", "", "f must be 1 finite numbers"),
        ("<f>500</f>", "<f>five</f>", "f must be 1 finite numbers"),
        ("<f>500</f>", "<fx>500</fx>", "before 1.3"),
        ('width="640"', 'width="-640"', "its width and height wanted"),
        ('<scale locked="true">0.5', "<scale>-1", "scale of the chunk must be positive"),
        ("<sensors", "<nothing", "not well-formed|no XML|mismatched"),
        ("</document>", "", "no XML"),
    ],
)
def test_each_fault_of_a_metashape_file_is_one_line(tmp_path, old, new, words):
    path = metashape(tmp_path / "c.xml")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(rc.CameraError, match=rf"^[^\n]*({words})[^\n]*$"):
        read_views(path)


# --- OpenSfM --------------------------------------------------------------------------------------


def opensfm(path, its, **changes):
    shot = {"rotation": [0.3, -0.2, 0.5], "translation": SHIFT.tolist(), "camera": "v2 cam"}
    content = {"cameras": {"v2 cam": {"width": 640, "height": 480, **its}}}
    content |= {"shots": {"01.jpg": shot | changes}, "points": {"1": {"coordinates": [0, 0, 1]}}}
    path.write_text(json.dumps([content]))
    return path


def theta_of(rays):
    x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    r = np.hypot(x, y)
    return x, y, r, np.arctan(r)


def opensfm_pixels(camera, rays):
    """OpenSfM's equations: camera_projections_functions.h and camera_distortions_functions.h."""
    c = dict.fromkeys([*SIX, "s0", "s1", "s2", "s3", "c_x", "c_y"], 0.0) | camera
    x, y, r, theta = theta_of(rays)
    if c["projection_type"].startswith("fisheye"):
        x, y = x * theta / r, y * theta / r
    r2 = x * x + y * y
    factor = 1 + sum(c[f"k{i}"] * r2**i for i in range(1, 7))
    a = x * factor + 2 * c["p1"] * x * y + c["p2"] * (r2 + 2 * x * x) + c["s0"] * r2
    b = y * factor + 2 * c["p2"] * x * y + c["p1"] * (r2 + 2 * y * y) + c["s2"] * r2
    a, b = a + c["s1"] * r2**2, b + c["s3"] * r2**2
    fx = c.get("focal_x", c.get("focal"))
    fy = c.get("focal_y", fx)
    # Pixels are counted from their centres: (w - 1) / 2 is the middle.
    return np.column_stack([640 * (fx * a + c["c_x"]) + 319.5, 640 * (fy * b + c["c_y"]) + 239.5])


TWO = {"k1": -0.1, "k2": 0.02}
BOTH = {"focal_x": 0.8, "focal_y": 0.82, "c_x": 0.01, "c_y": -0.02}
SIX = {"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": 0.001, "k5": 2e-4, "k6": 1e-4}
SIX |= {"p1": 0.001, "p2": -0.002}


@pytest.mark.parametrize(
    "camera",
    [
        {"projection_type": "perspective", "focal": 0.8, **TWO},
        {"projection_type": "simple_radial", **BOTH, "k1": -0.1},
        {"projection_type": "radial", **BOTH, **TWO},
        {"projection_type": "brown", **BOTH, **TWO, "k3": 0.01, "p1": 0.001, "p2": -0.002},
        {"projection_type": "fisheye", "focal": 0.6, **TWO},
        {"projection_type": "fisheye_opencv", **BOTH, **TWO, "k3": 0.003, "k4": 0.001},
        {"projection_type": "fisheye62", **BOTH, **SIX},
        {
            "projection_type": "fisheye624",
            **(BOTH | SIX | {"s0": 1e-3, "s1": 2e-3, "s2": 3e-3, "s3": 4e-3}),
        },
    ],
    ids=lambda camera: camera["projection_type"],
)
def test_every_lens_of_opensfm_follows_its_equations(tmp_path, camera):
    views = read_views(opensfm(tmp_path / "reconstruction.json", camera))
    wanted = opensfm_pixels(camera, RAYS) + 0.5
    np.testing.assert_allclose(lens_of(views.camera()).project(RAYS), wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("size", [(1000, 500), (1000, 400), (640, 480)])
def test_panoramas_of_opensfm_have_one_scale_across_and_down(tmp_path, size):
    camera = {"projection_type": "spherical", "width": size[0], "height": size[1]}
    views = read_views(opensfm(tmp_path / "reconstruction.json", camera))
    X, Y, Z = (RAYS * (1, 1, -1)).T
    across, down = np.arctan2(X, Z), np.arctan2(Y, np.hypot(X, Z))
    # Parts of the longer side, from the middle of the pixels: (w - 1) / 2 is 0.
    wanted = np.column_stack([across, down]) / (2 * np.pi) * max(size) + (np.array(size) - 1) / 2
    found = lens_of(views.camera()).project(RAYS * (1, 1, -1))
    np.testing.assert_allclose(found, wanted + 0.5, rtol=0, atol=1e-9)


def test_camera_models_of_opensfm_are_cameras_alone(tmp_path):
    camera = {"projection_type": "brown", "width": 640, "height": 480, "focal_x": 0.8}
    camera |= {"focal_y": 0.82, "c_x": 0.01, "c_y": -0.02, "k1": -0.1, "k2": 0.01, "p1": 0.001}
    whole = read_views(opensfm(tmp_path / "reconstruction.json", camera))
    (tmp_path / "camera_models.json").write_text(
        json.dumps({"v2 a b 640 480 brown 0.8": camera, "other": camera | {"k1": 0.0}})
    )
    views = read_views(tmp_path / "camera_models.json")
    assert views.rig.names == ("v2 a b 640 480 brown 0.8", "other")
    assert views.cameras()[0] == whole.cameras()[0]
    assert len(views.poses) == 0
    assert views.has_unit


def test_opensfm_poses_are_camera_from_world(tmp_path):
    camera = {"projection_type": "spherical"}
    views = read_views(opensfm(tmp_path / "r.json", camera))
    pose = views.poses.world_from_camera[0]
    np.testing.assert_allclose(pose[:3, :3], TURN.T, atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], -TURN.T @ SHIFT, atol=1e-12)
    # u = w / 2 + w longitude / 2 pi, of a ray to the right and one straight up.
    found = lens_of(views.camera()).project([[1.0, 0, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(found, [[480, 240], [320, 240]], atol=1e-9)


@pytest.mark.parametrize(
    ("camera", "changes", "words"),
    [
        ({"projection_type": "dual", "focal": 1}, {}, "projection_type must be one of"),
        ({"projection_type": "perspective"}, {}, "focal is missing"),
        ({"focal": 1}, {"camera": "v3"}, "there is no camera 'v3'"),
        ({"focal": 1}, {"rotation": [1, 2]}, "rotation must be 3 finite numbers"),
        ({"focal": -1}, {}, "fx must be positive"),
    ],
)
def test_each_fault_of_opensfm_is_one_line(tmp_path, camera, changes, words):
    with pytest.raises(rc.CameraError, match=rf"^[^\n]*{words}[^\n]*$"):
        read_views(opensfm(tmp_path / "r.json", camera, **changes))


# --- Bundler and BAL ------------------------------------------------------------------------------


def snavely(points, rotation, translation, f, k1, k2):
    """Bundler's manual: P = R X + t, p = -P / P.z, p' = f r(p) p, from the middle, y up."""
    P = points @ rotation.T + translation
    p = -P[:, :2] / P[:, 2:]
    r2 = (p * p).sum(axis=1)
    pixel = f * (1 + k1 * r2 + k2 * r2 * r2)[:, None] * p
    return np.column_stack([320 + pixel[:, 0], 240 - pixel[:, 1]])


def pixels(views, points):
    out = []
    for pose, row in zip(views.poses.world_from_camera, views.poses.camera, strict=True):
        inside = (points - pose[:3, 3]) @ pose[:3, :3]
        out.append(lens_of(views.cameras()[row]).project(inside))
    return out


POINTS = RNG.uniform(-1, 1, (20, 3))
CAMERAS = [(500.0, -0.1, 0.02, [0.1, 0.2, 0.3]), (600.0, 0.0, 0.0, [-0.1, 0.0, 0.2])]
AWAY = np.array([0.1, 0.2, -5.0])


def bundler(path):
    lines = ["# Bundle file v0.3", "3 1"]
    for f, k1, k2, rvec in CAMERAS:
        rotation, _ = cv2.Rodrigues(np.array(rvec))
        rows = [f"{f!r} {k1!r} {k2!r}", *(" ".join(map(repr, row.tolist())) for row in rotation)]
        lines += [*rows, " ".join(map(repr, AWAY.tolist()))]
    lines += ["0 0 0"] * 5 + ["0 0 1", "255 0 0", "1 0 3 1.5 2.5"]
    path.write_text("\n".join(lines) + "\n")
    return path


def bal(path):
    lines = ["2 1 2", "0 0 1.5 2.5", "1 0 -3.5 4.5"]
    for f, k1, k2, rvec in CAMERAS:
        lines += [repr(float(value)) for value in (*rvec, *AWAY, f, k1, k2)]
    path.write_text("\n".join([*lines, "0.0", "0.0", "1.0"]) + "\n")
    return path


@pytest.mark.parametrize("write", [bundler, bal])
def test_bundler_and_bal_follow_the_manual(tmp_path, write):
    path = write(tmp_path / "cameras.out")
    with pytest.raises(rc.CameraError, match="no image size; give --image-size"):
        read_views(path)
    views = read_views(path, conventions=SIZE)
    assert not views.has_unit
    assert len(views.poses) == 2
    for found, (f, k1, k2, rvec) in zip(pixels(views, POINTS), CAMERAS, strict=True):
        rotation, _ = cv2.Rodrigues(np.array(rvec))
        wanted = snavely(POINTS, rotation, AWAY, f, k1, k2)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("unit", ["focal length", "pixels"])
@pytest.mark.parametrize("n_points", [20, 3])
def test_observations_of_bal_tell_the_unit_of_its_radii(tmp_path, unit, n_points):
    """A published problem has coefficients as small as -7e-8: of radii in pixels."""
    points, f, k1, k2, rvec = POINTS[:n_points], 500.0, -0.1, 0.02, [0.1, 0.2, 0.3]
    rotation, _ = cv2.Rodrigues(np.array(rvec))
    wanted = snavely(points, rotation, AWAY, f, k1, k2)
    noise = RNG.normal(scale=0.02, size=wanted.shape)
    seen = (wanted + noise - (320, 240)) * (1, -1)
    if unit == "pixels":
        k1, k2 = k1 / f**2, k2 / f**4
    lines = [f"1 {len(points)} {len(points)}"]
    lines += [f"0 {row} {u!r} {v!r}" for row, (u, v) in enumerate(seen.tolist())]
    lines += [repr(float(value)) for value in (*rvec, *AWAY, f, k1, k2, *points.ravel())]
    (tmp_path / "problem.txt").write_text("\n".join(lines) + "\n")
    views = read_views(tmp_path / "problem.txt", conventions=SIZE)
    is_told = unit == "pixels" and n_points > 8
    assert any("radii in pixels" in note for note in views.notes) == is_told
    found = lens_of(views.cameras()[0]).project(
        points @ rotation.T * (1, -1, -1) + AWAY * (1, -1, -1)
    )
    if is_told or unit == "focal length":
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
    else:  # too few to tell
        assert np.abs(found - wanted).max() > 0.02


@pytest.mark.parametrize("write", [bundler, bal])
def test_cut_and_broken_texts_are_one_line(tmp_path, write):
    path = write(tmp_path / "cameras.out")
    text = path.read_text()
    for broken in (
        text[: len(text) // 2],
        text.replace("500.0", "nan"),
        text.replace("500.0", "5_0"),
        text.replace("500.0", "-5"),
        text.replace("3 1\n", "999999999 1\n").replace("2 1 2\n", "999999999 1 2\n"),
        text.replace("2 1 2\n", "2 1 999999999\n").replace("3 1\n", "3\n"),
    ):
        path.write_text(broken)
        with pytest.raises(rc.CameraError, match=r"^[^\n]*$"):
            read_views(path, conventions=SIZE)


# --- MVSNet ---------------------------------------------------------------------------------------


def test_mvsnet_asks_for_size_and_pixel_centre_and_reads_a_folder(tmp_path):
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = TURN, SHIFT
    text = "extrinsic\n" + "\n".join(" ".join(map(repr, row.tolist())) for row in extrinsic)
    text += "\n\nintrinsic\n500 0 320\n0 510 240\n0 0 1\n\n425 2.5 192 933.8\n"
    (tmp_path / "cams").mkdir()
    for row in range(2):
        (tmp_path / "cams" / f"{row:08d}_cam.txt").write_text(text)
    with pytest.raises(rc.CameraError, match="--image-size"):
        read_views(tmp_path)
    with pytest.raises(rc.CameraError, match=r"--pixel-centre 0 if .* or 0.5"):
        read_views(tmp_path, conventions=SIZE)
    for centre, cx in ((0, 320.5), (0.5, 320.0)):
        answers = Conventions(image_size=(640, 480), pixel_centre=centre)
        views = read_views(tmp_path, conventions=answers)
        assert views.camera().cx == cx
        assert views.images == ("00000000", "00000001")
        np.testing.assert_allclose(
            views.poses.world_from_camera[0], np.linalg.inv(extrinsic), atol=1e-12
        )
        assert len(read_views(tmp_path / "cams" / "00000000_cam.txt", conventions=answers).poses)
