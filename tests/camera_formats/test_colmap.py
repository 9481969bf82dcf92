"""COLMAP models, written by pycolmap and by us, against pycolmap's projection."""

import struct

import numpy as np
import pycolmap
import pytest
from view_files import pixels_of, same_pixels, some_points

import rastercov as rc
from rastercov.camera.formats import read_views, write_views
from rastercov.camera.formats.conventions import Conventions
from rastercov.camera.models import PROGRAMS

PARAMETERS = {
    "SIMPLE_PINHOLE": [500, 321, 239],
    "PINHOLE": [500, 510, 321, 239],
    "SIMPLE_RADIAL": [500, 321, 239, -0.05],
    "RADIAL": [500, 321, 239, -0.05, 0.01],
    "OPENCV": [500, 510, 321, 239, -0.05, 0.01, 0.001, -0.002],
    "OPENCV_FISHEYE": [400, 410, 321, 239, 0.02, -0.01, 0.003, 0.001],
    "FULL_OPENCV": [500, 510, 321, 239, -0.05, 0.01, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001],
    "FOV": [500, 510, 321, 239, 0.5],
    "SIMPLE_RADIAL_FISHEYE": [400, 321, 239, 0.02],
    "RADIAL_FISHEYE": [400, 321, 239, 0.02, -0.01],
    "THIN_PRISM_FISHEYE": [400, 410, 321, 239, 0.02, -0.01, 0.001, -0.002, 0.01, 0.001, 2e-3, 3e-3],
    "RAD_TAN_THIN_PRISM_FISHEYE": [
        *(400, 410, 321, 239, 0.02, -0.01, 0.003, 0.001, 2e-4, 1e-4),
        *(0.001, -0.002, 1e-3, 2e-3, 3e-3, 4e-3),
    ],
    "SIMPLE_DIVISION": [500, 321, 239, -0.05],
    "DIVISION": [500, 510, 321, 239, -0.05],
    "SIMPLE_FISHEYE": [400, 321, 239],
    "FISHEYE": [400, 410, 321, 239],
    "EUCM": [400, 410, 321, 239, 0.6, 1.1],
    "EQUIRECTANGULAR": [640, 480],
}


def motion(rng, most, translation):
    """Motion with a small rotation."""
    q = np.array([*rng.uniform(-most, most, 3), 1.0])
    return pycolmap.Rigid3d(pycolmap.Rotation3d(q / np.linalg.norm(q)), translation)


def model_of(names, rng):
    """Reconstruction with a rig of cameras of these models, and three frames."""
    model = pycolmap.Reconstruction()
    rig = pycolmap.Rig()
    rig.rig_id = 1
    sensors = []
    for number, name in enumerate(names, 1):
        camera = pycolmap.Camera.create_from_model_name(number, name, 500, 640, 480)
        camera.params = PARAMETERS[name]
        model.add_camera(camera)
        sensors.append(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number))
        if number == 1:
            rig.add_ref_sensor(sensors[0])
        else:
            rig.add_sensor(sensors[-1], motion(rng, 0.05, rng.uniform(-0.1, 0.1, 3)))
    model.add_rig(rig)
    for number in range(1, 4):
        frame = pycolmap.Frame()
        frame.frame_id, frame.rig_id = number, 1
        frame.rig_from_world = motion(rng, 0.1, [*rng.uniform(-0.3, 0.3, 2), 4.0])
        for row, sensor in enumerate(sensors):
            frame.add_data_id(pycolmap.data_t(sensor, 100 * number + row))
        model.add_frame(frame)
        for row in range(len(sensors)):
            image = pycolmap.Image()
            image.image_id, image.camera_id = 100 * number + row, row + 1
            image.name, image.frame_id = f"cam{row}/my image {number}.png", number
            points = [pycolmap.Point2D(np.array([1.5, 2.5]))] * (row % 3)
            image.points2D = pycolmap.Point2DList(points)
            model.add_image(image)
        model.register_frame(number)
    return model


def expected(model, points):
    """(P, N, 2) pixels by pycolmap, NaN where it gives none, of images by id."""
    rows = []
    for number in sorted(model.images):
        image = model.images[number]
        found = [image.project_point(point) for point in points]
        rows.append([np.full(2, np.nan) if each is None else each for each in found])
    return np.array(rows)


@pytest.mark.parametrize("form", ["text", "binary"])
def test_every_model_and_pose_projects_as_pycolmap_does(tmp_path, form):
    rng = np.random.default_rng(1)
    model = model_of(list(PARAMETERS), rng)
    getattr(model, f"write_{form}")(tmp_path)
    views = read_views(tmp_path)
    points = some_points(rng)
    pixels, wanted = pixels_of(views, points), expected(model, points)
    inside = ((wanted > 0) & (wanted < (640, 480))).all(axis=-1)
    assert inside.mean() > 0.5
    np.testing.assert_allclose(pixels[inside], wanted[inside], rtol=0, atol=1e-9)
    assert views.images == tuple(model.images[number].name for number in sorted(model.images))
    assert not views.has_unit
    assert views.notes == ()


def test_every_model_of_colmap_is_tested():
    assert set(PARAMETERS) == set(PROGRAMS["colmap"])
    known = pycolmap.CameraModelId.__members__
    assert {name: number for number, name in enumerate(PROGRAMS["colmap"])} == {
        name: int(each) for name, each in known.items() if name != "INVALID"
    }


def test_places_of_cameras_are_those_of_the_rig(tmp_path):
    model = model_of(["PINHOLE", "OPENCV", "FISHEYE"], np.random.default_rng(2))
    model.write_binary(tmp_path)
    rig = read_views(tmp_path).rig
    for row, place in enumerate(rig.rig_from_camera):
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, row + 1)
        wanted = np.eye(4)
        if row:
            wanted[:3] = model.rigs[1].sensor_from_rig(sensor).inverse().matrix()
        np.testing.assert_allclose(place, wanted, atol=1e-12)


@pytest.mark.parametrize("form", ["colmap", "colmap-text"])
def test_written_models_are_read_by_pycolmap_and_by_us(tmp_path, form):
    rng = np.random.default_rng(3)
    model = model_of(list(PARAMETERS), rng)
    (tmp_path / "in").mkdir()
    model.write_binary(tmp_path / "in")
    views = read_views(tmp_path / "in")
    notes = write_views(tmp_path / "out", views, format=form)
    points = some_points(rng)
    again = pycolmap.Reconstruction(tmp_path / "out")
    wanted, found = expected(model, points), expected(again, points)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
    same_pixels(views, read_views(tmp_path / "out"), points)
    names = {image.name for image in again.images.values()}
    assert read_views(tmp_path / "out").images == views.images
    if form == "colmap":
        assert names == set(views.images)
    else:  # COLMAP reads a name of a text model up to its first space
        assert names == {name.split()[0] for name in views.images}
        assert any("spaces" in note for note in notes)


def test_a_unit_scales_centres_and_places(tmp_path):
    model = model_of(["PINHOLE", "OPENCV"], np.random.default_rng(4))
    model.write_text(tmp_path)
    bare = read_views(tmp_path)
    scaled = read_views(tmp_path, conventions=Conventions(pose_unit="mm"))
    assert scaled.has_unit
    for one, other in (
        (bare.poses.world_from_camera, scaled.poses.world_from_camera),
        (bare.rig.rig_from_camera, scaled.rig.rig_from_camera),
    ):
        np.testing.assert_array_equal(one[:, :3, 3] * 1e-3, other[:, :3, 3])
        np.testing.assert_array_equal(one[:, :3, :3], other[:, :3, :3])


def test_a_project_folder_and_files_of_a_model_lead_to_the_model(tmp_path):
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    model_of(["PINHOLE"], np.random.default_rng(5)).write_text(folder)
    for path in (tmp_path, folder, folder / "images.txt", folder / "rigs.txt"):
        assert len(read_views(path).poses) == 3
    assert len(read_views(folder / "cameras.txt").poses) == 0
    assert read_views(folder / "cameras.txt").camera().fx == 500


IMAGE = "1 1 0 0 0 0 0 1 1 a.png"


@pytest.mark.parametrize(
    ("cameras", "images", "words"),
    [
        ("1 PINHOL 640 480 1 1 1 1", "", "the model must be one of SIMPLE_PINHOLE"),
        ("1 PINHOLE 640 480 1 1 1", "", "PINHOLE must have 4 parameters"),
        ("1 PINHOLE 640", "", "line 1 ends before the height"),
        ("1 PINHOLE 640 480 1_0 1 1 1", "", "a parameter must be a number"),
        ("1 PINHOLE 640 480 nan 1 1 1", "", "fx must be finite"),
        ("1 PINHOLE 99999999 480 1 1 1 1", "", "width must be a whole number"),
        ("1 PINHOLE 9 9 1 1 1 1\n1 PINHOLE 9 9 1 1 1 1", "", "camera 1 comes twice"),
        ("# nothing", "", "without cameras"),
        (None, "1 1 0 0 0 0 0 1 7 a.png\n\n", "camera 7, which is not in cameras.txt"),
        (None, "1 0 0 0 0 0 0 1 1 a.png\n\n", "pose 0 is not finite"),
        (None, "1 nan 0 0 0 0 0 1 1 a.png\n\n", "pose 0 is not finite"),
        (None, "1 1 0 0 0 0 0 1 1", "is missing points"),
        (None, f"{IMAGE}\n{IMAGE}\n", "line 2: the points of image 'a.png' wanted"),
        # A line of 12 words whose every third could be the id of a point, but for the last.
        (None, f"{IMAGE} a b\n{IMAGE.replace('0 1 1', '1 2 7')} a b\n", "line 2: the points"),
    ],
)
def test_each_fault_of_a_text_model_is_one_line(tmp_path, cameras, images, words):
    (tmp_path / "cameras.txt").write_text(cameras or "1 PINHOLE 640 480 500 500 320 240\n")
    (tmp_path / "images.txt").write_text(images)
    if words == "is missing points":  # an image at the end of the file may lack its empty line
        assert len(read_views(tmp_path).poses) == 1
        return
    with pytest.raises((rc.CameraError, rc.PoseError), match=r"^[^\n]*$") as caught:
        read_views(tmp_path)
    assert words in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize("name", ["cameras", "images"])
def test_text_files_may_begin_with_a_byte_order_mark(tmp_path, name):
    files = {"cameras": "1 PINHOLE 640 480 500 500 320 240\n", "images": f"{IMAGE}\n\n"}
    for each, text in files.items():
        (tmp_path / f"{each}.txt").write_text(text)
    wanted = read_views(tmp_path)
    path = tmp_path / f"{name}.txt"
    for head in ("", "# a comment\n"):
        path.write_text(f"\ufeff{head}{files[name]}")
        assert read_views(tmp_path).cameras() == wanted.cameras()
        assert read_views(tmp_path).images == wanted.images == ("a.png",)
    path.write_bytes(files[name].encode("utf-16"))
    with pytest.raises(rc.CameraError, match=rf"{name}\.txt: .* got UTF-16; save it as UTF-8"):
        read_views(tmp_path)


@pytest.mark.filterwarnings("error")
def test_lengths_that_are_not_finite_are_one_line(tmp_path):
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 inf 0 1 1 a.png\n\n")
    with pytest.raises(rc.PoseError, match="pose 0 is not finite"):
        read_views(tmp_path)


@pytest.mark.parametrize("form", ["colmap", "colmap-text"])
def test_an_image_that_comes_twice_is_an_error(tmp_path, form):
    camera = rc.Camera(width=640, height=480, fx=500, fy=500)
    poses = rc.Poses.of(np.tile(np.eye(4), (2, 1, 1)))
    write_views(tmp_path / "m", rc.Views(rc.Rig([camera]), poses, ("a", "b")), format=form)
    path = next((tmp_path / "m").glob("images.*"))
    new, old = (b"\n1 1.0", b"\n2 1.0") if form == "colmap-text" else (b"\1\0\0\0", b"\2\0\0\0")
    before, found, after = path.read_bytes().rpartition(old)
    assert found
    path.write_bytes(before + new + after)
    with pytest.raises(rc.CameraError, match=r"image 1 comes twice in images\.\w+; leave one"):
        read_views(tmp_path / "m")


def test_huge_counts_and_cut_files_are_refused_at_once(tmp_path):
    model_of(["PINHOLE", "OPENCV"], np.random.default_rng(6)).write_binary(tmp_path)
    for name in ("cameras.bin", "images.bin", "rigs.bin"):
        path = tmp_path / name
        whole = path.read_bytes()
        for cut in (0, 4, 9, len(whole) // 2, len(whole) - 1):
            path.write_bytes(whole[:cut])
            with pytest.raises(rc.CameraError, match=f"{name}: .*truncated"):
                read_views(tmp_path)
        path.write_bytes(struct.pack("<Q", 2**63) + whole[8:])
        with pytest.raises(rc.CameraError, match=r"promises 9223372036854775808 .* has room for"):
            read_views(tmp_path)
        path.write_bytes(whole)
    read_views(tmp_path)
