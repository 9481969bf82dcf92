"""Lines about a wrong unit and faces that are turned around."""

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.doubts import BEYOND, dead_pixels, find_warnings
from rastercov.core.coverage.network import Network
from rastercov.core.mesh import Mesh, shapes

CAMERA = rc.Camera(width=200, height=200, fx=200, fy=200)
FOCUSED = rc.Camera(width=200, height=200, fx=200, fy=200, focus_range=(0.1, 0.5))


def lines(mesh, poses, camera=CAMERA):
    network = Network(mesh, rc.Task())
    network.add(rc.evaluate(mesh, camera, poses, network.task, by="face"))
    return find_warnings(network, camera, poses)


def turned(mesh):
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.groups, mesh.face_group)


def around(mesh, n=20, distance=3.0):
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    return sphere_of_poses(mesh.bounds.mean(axis=0), distance * size, n)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "sphere", "teapot", "torus"])
def test_only_a_mesh_that_is_inside_out_has_a_line(name):
    mesh = shapes.by_name(name)
    assert lines(mesh, around(mesh)) == []
    (line,) = lines(turned(mesh), around(mesh))
    assert "flip its normals, or declare it two-sided" in line


def test_a_room_seen_from_inside_has_a_line_only_with_its_normals_outwards():
    mesh = shapes.by_name("box")
    centre = mesh.bounds.mean(axis=0)
    wide = rc.Camera(width=200, height=200, fx=40, fy=40)
    pose = rc.look_at(centre, centre + np.array([1, 0, 0]))
    assert "back-facing" in lines(mesh, pose, wide)[0]
    assert lines(turned(mesh), pose, wide) == []


def test_cameras_that_look_away_have_a_line_about_their_convention_and_no_other():
    mesh = shapes.by_name("sphere")
    poses = around(mesh)
    poses[:, :3, [0, 2]] *= -1
    (line,) = lines(turned(mesh), poses)
    assert line.startswith("0 of 20 cameras look at the mesh, and 20 would with another")
    assert "--pose-convention opengl, or leave it out" in line


def test_two_sided_faces_and_one_camera_that_sees_a_side_have_no_line():
    mesh = shapes.by_name("sphere")
    both = turned(mesh).with_groups(two_sided="all")
    assert lines(both, around(both)) == []
    for distance in (0.6, 1, 3):
        assert lines(mesh, around(mesh, distance=distance)[:1]) == []


@pytest.mark.parametrize(
    ("factor", "text"),
    [(1000, ": --unit mm?"), (1, None), (1e-3, "check --unit")],
)
def test_a_mesh_in_the_wrong_unit_asks_for_it(factor, text):
    mesh = shapes.by_name("box")
    poses = around(mesh, distance=2.0)
    scaled = mesh.moved(scale=factor)
    result = lines(scaled, poses)
    assert result == [] if text is None else text in result[0]
    assert text is None or scaled.size_in_words in result[0]


def test_a_part_in_metres_read_as_mm_asks_for_its_unit_whatever_the_distance():
    part = shapes.by_name("torus").moved(scale=2e-5)
    (line,) = lines(part, around(part))
    assert line.endswith("µm: check --unit")
    part = part.moved(scale=1e3)
    assert lines(part, around(part)) == []


def test_a_mesh_far_beyond_the_depth_of_field_asks_for_its_unit():
    mesh = shapes.by_name("box")
    big = mesh.moved(scale=500 / np.ptp(mesh.bounds, axis=0).max())
    (line, *_) = lines(big, around(big), FOCUSED)
    assert "1000 times the 500 mm up to which the camera is in focus: --unit mm?" in line


def test_a_lens_of_the_catalogue_without_a_focus_has_a_line():
    mesh, poses = rc.shapes.box((0.2, 0.2, 0.2)), rc.look_at((3, 0, 0), (0, 0, 0))
    lens = {"preset": "rpi-hq+rpi-16mm"}
    for entries, n in ((lens, 1), (lens | {"focus_distance": 3.0}, 0), ({"preset": "rpi-cm2"}, 0)):
        summary = rc.evaluate(mesh, rc.Camera.from_dict(entries), poses).summary()["doubts"]
        said = [line for line in summary if "is assumed to be in focus everywhere" in line]
        assert len(said) == n, entries


PLAIN = {"width": 200, "height": 160, "hfov_deg": 40}
OF_RANGE = (
    "ir_range of camera 1 is drawn on plan sheets only and changes no coverage: give an "
    "infrared lamp with rig = true and a range"
)


def doubts_of_entries(entries, **given):
    """Lines about entries of a camera that have no effect."""
    mesh, pose = rc.shapes.box((0.2, 0.2, 0.2)), rc.look_at((3, 0, 0), (0, 0, 0))
    camera = rc.Camera.from_dict(entries)
    summary = rc.evaluate(mesh, camera, pose, by="area", **given).summary()["doubts"]
    return [line for line in summary if "ir_range" in line or "max_blur" in line]


def test_entries_of_a_camera_without_effect_have_a_line():
    """A range for sheets; a blur without a plane in focus."""
    focused = PLAIN | {"pixel_size": 3e-6, "f_number": 2, "focus_distance": 3.0}
    of_blur = "max_blur of camera 1 has no effect: give f_number and focus_distance"
    assert doubts_of_entries(PLAIN) == []
    assert doubts_of_entries(PLAIN | {"ir_range": 12}) == [OF_RANGE]
    assert doubts_of_entries(PLAIN | {"max_blur": 2}) == [of_blur]
    assert doubts_of_entries(focused | {"max_blur": 2}) == []
    blurred = rc.Task(max_blur=0.5)
    assert doubts_of_entries(focused, task=blurred) == []
    assert doubts_of_entries(PLAIN, task=blurred) == [of_blur]
    assert doubts_of_entries(PLAIN | {"focus_range": (1, 4)}, task=blurred) == [of_blur]


def test_a_range_of_a_camera_that_carries_a_lamp_has_no_line(tmp_path):
    text = '[lamps.ir]\nkind = "spot"\nrange = "12 m"\nhalf_angle_deg = 30\nrig = true\n'
    (tmp_path / "lamps.toml").write_text(text)
    lamp = rc.load_lamps(tmp_path / "lamps.toml")
    assert doubts_of_entries(PLAIN | {"ir_range": 12}, lamps=lamp) == []


def test_no_poses_no_lines():
    mesh = shapes.by_name("box")
    assert find_warnings(Network(mesh, rc.Task()), CAMERA, np.empty((0, 4, 4))) == []


def test_a_lens_that_gives_no_rays_for_a_part_of_its_image_has_a_line():
    mesh, size = shapes.by_name("sphere"), {"width": 200, "height": 160}
    folding = rc.Camera(**size, fx=90, fy=90, model="opencv", distortion=(-0.35, 0, 0.002, -0.001))
    disc = rc.Camera(
        **size, fx=40, fy=40, model="opencv_fisheye", distortion=(0, 0, 0, 0), max_angle_deg=90
    )
    y, x = np.mgrid[:160, :200]
    rays = lens_of(folding).unproject(np.stack([x + 0.5, y + 0.5], axis=-1))
    dead = np.isnan(rays[..., 0]).sum()
    rig = rc.Rig([CAMERA, folding, disc], ["plain", "bent", "round"])
    result = dead_pixels(rig)
    assert list(result) == ["bent", "round"]
    assert result["bent"] == pytest.approx(dead, abs=100)  # counted by centres, a border of 500 px
    assert result["round"] == pytest.approx(200 * 160 - np.pi * (40 * np.pi / 2) ** 2, rel=1e-3)
    given = np.repeat(around(mesh)[:2], 3, axis=0)
    (line,) = lines(mesh, rc.Poses.of(given, camera=[0, 1, 2] * 2), rig)
    assert line.startswith(f"{dead / 320:.0f} % of the image of bent is outside ")
    assert dead_pixels(CAMERA) == {}
    assert lines(mesh, around(mesh)[:2], folding)[0].startswith("6")
    assert lines(mesh, around(mesh)[:2], disc) == []


def test_a_fisheye_that_sees_behind_itself_is_judged_without_a_warning():
    mesh = shapes.by_name("sphere")
    size = {"width": 177, "height": 756, "fx": 139, "fy": 139}
    lens = rc.Camera(**size, model="opencv_fisheye", distortion=(0.02, 0, 0, 0))
    assert lines(mesh, around(mesh)[:1], lens) == []


def test_a_lens_that_bends_more_than_lenses_do_has_a_line():
    mesh, size = shapes.by_name("sphere"), {"width": 1296, "height": 972, "fy": 1879.6}
    public = (-13.238113, -98.012135, 0.001444, 0.002849, 1357.782415, -13.050801, -102.363353)
    steep = rc.Camera(**size, fx=1874.6, model="opencv", distortion=(*public, 1383.055291))
    (line,) = lines(mesh, around(mesh)[:1], steep)
    assert "is implausibly strong at 16 degrees off axis (scale 1.5, usually 0.96" in line
    # The scale by differences along a radius, where that of a rectilinear lens is 1 / cos^2.
    t = np.radians(np.arange(16, 16.5, 0.001))
    r2 = np.tan(t) ** 2
    up, down = (1 + r2 * (a + r2 * (b + r2 * c)) for a, b, c in (
        (public[0], public[1], public[4]), (public[5], public[6], 1383.055291)))  # fmt: skip
    scale = np.diff(np.tan(t) * up / down) / np.diff(t)
    assert scale.max() > 1.2 / np.cos(t[0]) ** 2
    usual = (  # of EuRoC, and a fisheye
        rc.Camera(**size, fx=1250, model="opencv", distortion=(-0.28, 0.07, 0.0002, 0.00002)),
        rc.Camera(**size, fx=700, model="opencv_fisheye", distortion=(-0.02, 0.01, -0.01, 0.001)),
    )
    for camera in usual:
        assert lines(mesh, around(mesh)[:1], camera) == []


def test_cameras_in_a_body_or_beyond_the_walls_have_a_line():
    poses = rc.look_at(np.array([(0, 0, 0.9), (9, 0, 1)]), (2, 1, 1.0))
    (line,) = lines(shapes.by_name("room"), poses)
    assert line == f"1 camera is {BEYOND}: camera 2 at (9.0, 0.0, 1.0) m"
    box = shapes.box((1.0, 1.0, 1.0), 1)
    (line,) = lines(box, rc.look_at(np.array([(0.1, 0, 0), (0, 0, 2), (2, 2, 2)]), (0, 0, 0.4)))
    assert line.endswith(": camera 1 at (0.10, 0.00, 0.00) m")
