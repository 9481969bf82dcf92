"""Pictures through lenses: what the lens shows, frusta with curved borders, reports with poses."""

from dataclasses import replace

import numpy as np
import pytest
from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
from lens_cameras import CAMERAS
from PIL import Image, ImageDraw
from surface_cases import room

import rastercov as rc
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.doubts import doubts
from rastercov.coverage.task import Reason
from rastercov.mesh import shapes
from rastercov.report import overview
from rastercov.report.camera_pictures import camera_image, camera_picture, camera_pixels
from rastercov.report.coverage import Options, run
from rastercov.report.images import draw_text, font_for
from rastercov.report.overview import camera_colours, network_picture, overview_picture
from rastercov.report.panorama import points_of_pixels

MESH, CAMERA, POSES = room()
TASK = rc.Task(max_incidence_deg=70, min_pixel_density=60)
FLAT = replace(CAMERA, max_angle_deg=85)
"""The pinhole, computed as a lens."""
COLOUR = (200, 30, 200)
every_lens = pytest.mark.parametrize(
    "lens",
    [
        "brown",
        *(
            pytest.param(lens, marks=pytest.mark.slow)
            for lens in ("wide fisheye", "thin prism fisheye", "equirectangular")
        ),
    ],
)


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 5])
def test_without_distortion_a_picture_is_that_of_the_pinhole(row):
    images = [camera_image(MESH, each, POSES[row], TASK, side=320) for each in (CAMERA, FLAT)]
    one, other = (camera_pixels(image, COLOUR).astype(int) for image in images)
    assert (one == other).all(axis=2).mean() > 0.98  # but at edges
    assert images[0].faces == images[1].faces


@pytest.mark.slow
@every_lens
def test_a_pixel_of_a_camera_picture_has_the_state_of_the_face_that_its_ray_meets(lens):
    camera, pose = CAMERAS[lens], POSES[4]
    image = camera_image(MESH, camera, pose, TASK, side=200)
    assert image.camera.width == 200
    found = rc.evaluate(MESH, camera, pose[None], TASK)
    rows, columns = np.nonzero(image.face >= 0)
    assert len(rows) > 0.98 * image.face.size
    assert (image.state[rows, columns] == found.reason[0][image.face[rows, columns]]).all()
    assert image.faces == (found.reason[0] == Reason.COVERED).sum()
    points = points_of_pixels(MESH, image.camera, pose, image.face[rows, columns], rows, columns)
    pixels = to_image(to_camera(points, pose), image.camera)
    np.testing.assert_allclose(pixels, np.column_stack((columns, rows)) + 0.5, atol=1e-6)
    beyond = np.maximum(-points, points - np.array((8, 5, 3))).max(axis=1)
    assert (beyond < 1e-9).mean() > 0.995  # pixels at an edge may show either side
    assert beyond.max() < 0.7


@pytest.mark.slow
@every_lens
def test_a_report_draws_its_poses_through_the_lens(tmp_path, lens):
    camera = CAMERAS[lens].resized(0.1)
    mesh = shapes.room(2)
    poses = rc.look_at([(2.5, 2, 2), (-2, -2, 1)], (0, 0, 1))
    summary = run(mesh, camera, poses, TASK, tmp_path, Options(pictures=2, full="faces", by="face"))
    assert not any("picture" in line for line in summary["doubts"])
    for row in range(2):
        with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
            expected = rasterizer.render(poses[row]).face
        with Image.open(tmp_path / f"faces_{row}.png") as picture:
            drawn = np.asarray(picture)
        assert drawn.shape[:2] == expected.shape
        colours = {}
        for face, colour in zip(expected.ravel(), map(tuple, drawn.reshape(-1, 3)), strict=True):
            assert colours.setdefault(int(face), colour) == colour
        assert len(set(colours.values())) == len(colours) > 20
    assert (tmp_path / "overview.png").exists()


@pytest.mark.slow
def test_a_report_through_a_lens_on_opengl_shows_what_it_shows_on_the_cpu(tmp_path, gl_context):
    camera, pictures = CAMERAS["brown"].resized(0.1), []
    for device in ("cpu", "surfaceless"):
        folder = tmp_path / device
        options = Options(device=device, pictures=1, full="faces", by="face")
        run(MESH, camera, POSES[:1], TASK, folder, options)
        with Image.open(folder / "faces_0.png") as picture:
            pictures.append(np.asarray(picture))
    assert (pictures[0] == pictures[1]).all(axis=-1).mean() > 0.998


@pytest.mark.parametrize("lens", CAMERAS)
def test_a_view_pyramid_has_the_border_of_the_image_and_its_reach(lens):
    camera, pose = CAMERAS[lens], POSES[0]
    pyramid = overview._pyramid(camera, pose, 2.0)
    assert (len(pyramid) - 1) % 4 == 0
    away = np.linalg.norm(pyramid[1:] - pyramid[0], axis=1)
    assert pyramid[0] == pytest.approx(pose[:3, 3])
    assert away.max() == pytest.approx(2.0)
    pixels = to_image(to_camera(pyramid[1:], pose) * (1 - 1e-12), camera)
    size = np.array((camera.width, camera.height))
    from_border = np.minimum(np.abs(pixels), np.abs(pixels - size)).min(axis=1)
    if lens == "equirectangular":
        assert pixels[:, 1] == pytest.approx(camera.height / 2)
    else:
        assert from_border.max() < 1e-4
    lines = overview._edges(pyramid, COLOUR)
    starts = {line.start for line in lines} | {line.end for line in lines}
    assert starts == {tuple(point) for point in pyramid.tolist()}


@pytest.mark.slow
def test_without_distortion_an_overview_is_that_of_the_pinhole():
    shown = camera_colours(MESH, POSES[:3])
    for draw in (overview_picture, network_picture):
        one, other = (np.asarray(draw(shown, each)).astype(int) for each in (CAMERA, FLAT))
        assert one.shape == other.shape
        assert (np.abs(one - other).max(axis=2) > 30).mean() < 0.003  # lines in other pieces


@pytest.mark.slow
def test_the_exponent_of_square_metres_is_drawn():
    regions = rc.regions(MESH, CAMERA, POSES[0], TASK)
    font = font_for(720)
    picture = camera_picture(MESH, CAMERA, POSES[0], TASK, "1", COLOUR, regions)

    def drawn(text):
        image = Image.new("RGB", (400, 40), "white")
        draw_text(ImageDraw.Draw(image), (5, 20), text, font)
        return np.asarray(image.convert("L"))

    box = Image.new("L", (400, 40), 255)  # of a sign that the font lacks
    ImageDraw.Draw(box).text((5, 20), "1 m²", 0, font, anchor="lm")
    assert (drawn("1 m²") != np.asarray(box)).any()
    assert (drawn("1 m²") != drawn("1 m2")).any()
    assert (drawn("1 m²")[:, :20] == drawn("1 m2")[:, :20]).all()
    ink = np.argwhere(drawn("1 m²") < 128)
    two = ink[ink[:, 1] > ink[:, 1].max() - 4]  # the end of the line is the exponent, raised
    assert two[:, 0].max() < ink[:, 0].max()
    title = np.asarray(picture)[: picture.height // 20]
    assert (title < 128).any()


@pytest.mark.slow
def test_faces_that_a_wide_lens_sees_from_behind_are_doubted():
    mesh = shapes.by_name("torus")
    turned = rc.Mesh(mesh.vertices, mesh.faces[:, ::-1])
    poses = sphere_of_poses((0, 0, 0), 4.0, 6)
    for camera in (CAMERAS["brown"], CAMERAS["wide fisheye"], CAMERAS["equirectangular"]):
        for each, expected in ((mesh, 0), (turned, 1)):
            network = rc.Network(each, rc.Task())
            network.add(rc.evaluate(each, camera, poses, network.task))
            lines = [line for line in doubts(network, camera, poses) if "behind" in line]
            assert len(lines) == expected
