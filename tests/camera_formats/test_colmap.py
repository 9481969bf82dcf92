"""COLMAP models, written by pycolmap and by us, against pycolmap's projection."""

import struct
from operator import attrgetter

import numpy as np
import pytest
from lens_cases import COLMAP, HEIGHT, WIDTH
from view_files import has_note, pixels_of, refused, same, same_pixels, some_points, two_views
from wheels import with_wheel

import rastercov as rc
from rastercov.core.camera.models import PROGRAMS
from rastercov.formats.cameras import read_views, write_views

pycolmap = with_wheel("pycolmap")


def motion(rng, most, translation):
    """A rigid transform with a small rotation."""
    q = np.array([*rng.uniform(-most, most, 3), 1.0])
    return pycolmap.Rigid3d(pycolmap.Rotation3d(q / np.linalg.norm(q)), translation)


def model_of(names, rng):
    """Reconstruction with a rig of cameras of these models, and three frames."""
    model = pycolmap.Reconstruction()
    rig = pycolmap.Rig()
    rig.rig_id = 1
    sensors = []
    for number, name in enumerate(names, 1):
        camera = pycolmap.Camera.create_from_model_name(number, name, 500, WIDTH, HEIGHT)
        camera.params = COLMAP[name]
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
        project_points = [image.project_point(point) for point in points]
        rows.append([np.full(2, np.nan) if each is None else each for each in project_points])
    return np.array(rows)


@pytest.mark.parametrize("form", ["text", "binary"])
def test_every_model_and_pose_projects_as_pycolmap_does(tmp_path, form):
    rng = np.random.default_rng(1)
    model = model_of(list(COLMAP), rng)
    getattr(model, f"write_{form}")(tmp_path)
    views = read_views(tmp_path)
    points = some_points(rng)
    pixels, wanted = pixels_of(views, points), expected(model, points)
    inside = ((wanted > 0) & (wanted < (WIDTH, HEIGHT))).all(axis=-1)
    assert inside.mean() > 0.5
    same(pixels[inside], wanted[inside], 1e-9)
    assert views.images == tuple(model.images[number].name for number in sorted(model.images))
    assert not views.has_unit
    assert views.notes == ()
    frames = [f"frame {model.images[number].frame_id}" for number in sorted(model.images)]
    assert list(views.frames) == frames
    assert views.of_camera("camera 2").frames == ("frame 1", "frame 2", "frame 3")


def test_every_model_of_colmap_is_tested():
    assert set(COLMAP) == set(PROGRAMS["colmap"])
    known = pycolmap.CameraModelId.__members__
    assert {name: number for number, name in enumerate(PROGRAMS["colmap"])} == {
        name: int(each) for name, each in known.items() if name != "INVALID"
    }


def test_places_of_cameras_are_those_of_the_rig_and_a_unit_scales_lengths(tmp_path):
    model = model_of(["PINHOLE", "OPENCV", "FISHEYE"], np.random.default_rng(2))
    model.write_binary(tmp_path)
    views = read_views(tmp_path)
    for row, place in enumerate(views.rig.rig_from_camera):
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, row + 1)
        wanted = np.eye(4)
        if row:
            wanted[:3] = model.rigs[1].sensor_from_rig(sensor).inverse().matrix()
        same(place, wanted)
    scaled = read_views(tmp_path, conventions=rc.Conventions(pose_unit="mm"))
    assert scaled.has_unit
    scale = np.ones((4, 4))
    scale[:3, 3] = 1e-3
    for name in ("poses.world_from_camera", "rig.rig_from_camera"):
        one, other = (attrgetter(name)(each) for each in (views, scaled))
        np.testing.assert_array_equal(one * scale, other)


@pytest.mark.parametrize("form", ["colmap", "colmap-text"])
def test_written_models_are_read_by_pycolmap_and_by_us(tmp_path, form):
    rng = np.random.default_rng(3)
    model = model_of(list(COLMAP), rng)
    (tmp_path / "in").mkdir()
    model.write_binary(tmp_path / "in")
    views = read_views(tmp_path / "in")
    notes = write_views(tmp_path / "out", views, format=form)
    points = some_points(rng)
    again = pycolmap.Reconstruction(tmp_path / "out")
    wanted, result = expected(model, points), expected(again, points)
    same(result, wanted, 1e-9)
    read = read_views(tmp_path / "out")
    same_pixels(views, read, points)
    assert read.images == views.images
    names = {image.name for image in again.images.values()}
    if form == "colmap":
        assert names == set(views.images)
    else:  # COLMAP reads a name of a text model up to its first space
        assert names == {name.split()[0] for name in views.images}
        assert has_note(notes, "spaces")


def test_a_project_folder_and_files_of_a_model_lead_to_the_model(tmp_path):
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    model_of(["PINHOLE"], np.random.default_rng(5)).write_text(folder)
    for path in (tmp_path, folder, folder / "images.txt", folder / "rigs.txt"):
        assert len(read_views(path).poses) == 3
    assert len(read_views(folder / "cameras.txt").poses) == 0
    assert read_views(folder / "cameras.txt").camera().fx == 900


FILES = {
    "cameras": "1 PINHOLE 640 480 500 500 320 240\n",
    "images": "1 1 0 0 0 0 0 1 1 a.png\n\n",
}


def text_model(folder, **changes):
    for name, text in (FILES | changes).items():
        (folder / f"{name}.txt").write_text(text)
    return folder


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "motion",
    ["0 0 0 0 0 0 1", "nan 0 0 0 0 0 1", "1 0 0 0 inf 0 1"],
)
def test_motions_that_are_none_are_named(tmp_path, motion):
    refused(
        text_model(tmp_path, images=f"1 {motion} 1 a.png\n\n"),
        "pose 0 (from 0): expected a rigid transform, got one that is not finite",
    )


def test_the_last_image_may_lack_its_line_of_points_and_cameras_are_different(tmp_path):
    assert len(read_views(text_model(tmp_path, images=FILES["images"].strip())).poses) == 1
    refused(text_model(tmp_path, cameras=2 * FILES["cameras"]), "each camera once, got 1 twice")


@pytest.mark.parametrize("name", FILES)
def test_text_files_may_begin_with_a_byte_order_mark(tmp_path, name):
    wanted = read_views(text_model(tmp_path))
    for head in ("", "# a comment\n"):
        views = read_views(text_model(tmp_path, **{name: f"\ufeff{head}{FILES[name]}"}))
        assert (views.cameras(), views.images) == (wanted.cameras(), ("a.png",))
    (tmp_path / f"{name}.txt").write_bytes(FILES[name].encode("utf-16"))
    refused(tmp_path, f"{name}.txt: ", "got UTF-16; save it as UTF-8")


def test_a_header_that_promises_less_than_there_is_is_noted(tmp_path):
    views = read_views(text_model(tmp_path, images=f"# Number of images: 0\n{FILES['images']}"))
    assert has_note(views, "the header declares 0 images; read all 1")


def test_a_model_is_replaced_as_a_whole_if_at_all(tmp_path):
    write_views(tmp_path / "m", two_views(), format="colmap")
    with pytest.raises(rc.ConfigError, match=r"expected a new model, got an existing cameras\.bin"):
        write_views(tmp_path / "m", two_views(), format="colmap-text")
    write_views(tmp_path / "m", two_views(), format="colmap-text", overwrite=True)
    assert {path.suffix for path in (tmp_path / "m").iterdir()} == {".txt"}
    (tmp_path / "file").touch()
    with pytest.raises(rc.ConfigError, match="a folder for the COLMAP model"):
        write_views(tmp_path / "file", two_views(), format="colmap", overwrite=True)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "rigs.bin"])
def test_huge_counts_and_cut_files_are_refused_at_once(tmp_path, name):
    model_of(["PINHOLE", "OPENCV"], np.random.default_rng(6)).write_binary(tmp_path)
    path = tmp_path / name
    whole = path.read_bytes()
    for cut in (0, 4, 9, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        refused(tmp_path, f"{name}: ", "truncated")
    path.write_bytes(struct.pack("<Q", 2**63) + whole[8:])
    refused(tmp_path, "expected 9223372036854775808 ", ", got space for")
