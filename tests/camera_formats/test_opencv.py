"""Calibrations of OpenCV written by cv2.FileStorage, and by us, against cv2.projectPoints."""

import cv2
import numpy as np
import pytest
from view_files import lens_of

import rastercov as rc
from rastercov.camera.formats import read_views, write_views
from rastercov.camera.formats.conventions import Conventions

K = np.array([[700.0, 0, 318.25], [0, 710.0, 241.5], [0, 0, 1]])
BROWN = np.array([-0.2, 0.05, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001, 1e-3, 2e-3, 3e-3, 1e-3])
FISHEYE = np.array([0.02, -0.01, 0.003, 0.001])


GIVEN = Conventions(image_size=(640, 480), pose_unit=1)


def storage(path, **values):
    """Write values as cv2 does."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


def rays():
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(-0.4, 0.4, (50, 2)), np.ones(50)])


def cv_pixels(rays, k, d, fisheye=False):
    """Pixels by cv2, counted from their centres, plus a half."""
    zero = np.zeros(3)
    if fisheye:
        found, _ = cv2.fisheye.projectPoints(rays[None], zero, zero, k, d)
    else:
        found, _ = cv2.projectPoints(rays, zero, zero, k, d)
    return found.reshape(-1, 2) + 0.5


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml", ".json"])
@pytest.mark.parametrize("n", [5, 8, 12])
@pytest.mark.parametrize("shape", ["row", "column"])
def test_a_storage_of_any_form_projects_as_cv2_does(tmp_path, suffix, n, shape):
    d = BROWN[:n].reshape((1, n) if shape == "row" else (n, 1))
    path = storage(
        tmp_path / f"calib{suffix}", image_width=640, image_height=480, cameraMatrix=K, distCoeffs=d
    )
    camera = read_views(path).camera()
    assert (camera.width, camera.height) == (640, 480)
    np.testing.assert_allclose(
        lens_of(camera).project(rays()), cv_pixels(rays(), K, d), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("model", ["brown", "fisheye"])
def test_four_coefficients_are_asked_for(tmp_path, model):
    path = storage(tmp_path / "c.yml", image_width=640, image_height=480, K=K, D=FISHEYE)
    with pytest.raises(rc.CameraError, match=r"in D are four.*--lens-model brown or fisheye"):
        read_views(path)
    camera = read_views(path, conventions=Conventions(lens_model=model)).camera()
    wanted = cv_pixels(rays(), K, FISHEYE, fisheye=model == "fisheye")
    np.testing.assert_allclose(lens_of(camera).project(rays()), wanted, rtol=0, atol=1e-9)


def test_the_flag_of_the_sample_program_answers_for_four(tmp_path):
    size = {"image_width": 640, "image_height": 480}
    for flag, model in ((1, "opencv_fisheye"), (0, "opencv")):
        path = storage(
            tmp_path / "c.yml", **size, fisheye_model=flag, camera_matrix=K,
            distortion_coefficients=FISHEYE,
        )  # fmt: skip
        assert read_views(path).camera().model == model


def test_a_missing_size_is_asked_for(tmp_path):
    path = storage(tmp_path / "c.yml", K=K, D=BROWN[:5])
    with pytest.raises(rc.CameraError, match="no image size; give --image-size"):
        read_views(path)
    camera = read_views(path, conventions=Conventions(image_size=(640, 480))).camera()
    assert (camera.width, camera.height) == (640, 480)


def test_an_answer_that_is_not_needed_is_noted_and_changes_nothing(tmp_path):
    path = storage(tmp_path / "c.yml", image_width=640, image_height=480, K=K, D=BROWN[:5])
    answers = Conventions(image_size=(9, 9), pixel_centre=0.5, pose_unit="mm")
    views = read_views(path, conventions=answers)
    assert (views.camera().width, views.camera().cx) == (640, 318.75)
    assert sum("was not used" in note for note in views.notes) == 3


@pytest.mark.parametrize("pair", [("K1 K2", "D1 D2"), ("K_left K_right", "D_left D_right"),
                                  ("M1 M2", "D1 D2"),
                                  ("cameraMatrix1 cameraMatrix2", "distCoeffs1 distCoeffs2"),
                                  ("leftCameraMatrix rightCameraMatrix",
                                   "leftDistCoeffs rightDistCoeffs")])  # fmt: skip
def test_two_cameras_are_paired_by_their_names(tmp_path, pair):
    matrices, vectors = (words.split() for words in pair)
    r, _ = cv2.Rodrigues(np.array([0.01, 0.2, -0.03]))
    t = np.array([[-0.12], [0.003], [0.004]])
    values = {matrices[0]: K, matrices[1]: 2 * K - np.diag([0, 0, 1.0])}
    values |= {vectors[0]: BROWN[:5], vectors[1]: BROWN[:8], "R": r, "T": t}
    path = storage(tmp_path / "stereo.yml", image_width=640, image_height=480, **values)
    views = read_views(path)
    assert [len(camera.distortion) for camera in views.cameras()] == [5, 8]
    assert [camera.fx for camera in views.cameras()] == [700, 1400]
    # OpenCV: x2 = R x1 + T.
    first = np.array([0.1, 0.2, 3.0, 1.0])
    second = np.linalg.inv(views.rig.rig_from_camera[1]) @ first
    np.testing.assert_allclose(second[:3], r @ first[:3] + t[:, 0], atol=1e-14)
    np.testing.assert_array_equal(views.poses.world_from_camera, views.rig.rig_from_camera)
    assert not views.has_unit


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_places_of_a_pair_are_read_with_the_matrices_beside_them(tmp_path, suffix):
    r, _ = cv2.Rodrigues(np.array([0.02, -0.1, 0.03]))
    t = np.array([[-0.12], [0.01], [0.002]])
    pair = {
        "M1": K,
        "D1": BROWN[:5],
        "M2": K * [[1.1, 0, 1], [0, 0.9, 1], [0, 0, 1]],
        "D2": BROWN[:8],
    }
    # P1 and P2 are 3 x 4, R1, R2 and Q of the rectified pair.
    rest = {"R": r, "T": t, "R1": r, "P1": np.hstack([K, t]), "Q": np.eye(4)}
    whole = read_views(storage(tmp_path / f"pair{suffix}", **pair, **rest), conventions=GIVEN)
    path = storage(tmp_path / f"extrinsics{suffix}", **rest)
    with pytest.raises(rc.CameraError, match=rf"put 'intrinsics\{suffix}' beside it"):
        read_views(path, conventions=GIVEN)
    storage(tmp_path / f"intrinsics{suffix}", **pair)
    views = read_views(path, conventions=GIVEN)
    assert views.cameras() == whole.cameras()
    assert len(views.poses) == 2
    np.testing.assert_array_equal(views.poses.world_from_camera, whole.poses.world_from_camera)
    np.testing.assert_array_equal(views.rig.rig_from_camera, whole.rig.rig_from_camera)
    assert any("those of 'intrinsics" in note for note in views.notes)
    # The other file is read by itself.
    assert len(read_views(tmp_path / f"intrinsics{suffix}", conventions=GIVEN).poses) == 0


def test_extrinsic_parameters_are_poses_in_the_frame_of_the_pattern(tmp_path):
    rng = np.random.default_rng(1)
    boards = np.column_stack([rng.uniform(-0.3, 0.3, (4, 5)), np.full(4, 2.0)])
    path = storage(
        tmp_path / "c.yml", image_width=640, image_height=480, camera_matrix=K,
        distortion_coefficients=BROWN[:5], extrinsic_parameters=boards,
    )  # fmt: skip
    views = read_views(path)
    points = rng.uniform(-0.3, 0.3, (20, 3))
    for board, pose in zip(boards, views.poses.world_from_camera, strict=True):
        inside = (points - pose[:3, 3]) @ pose[:3, :3]
        wanted, _ = cv2.projectPoints(points, board[:3], board[3:], K, BROWN[:5])
        found = lens_of(views.camera()).project(inside)
        np.testing.assert_allclose(found, wanted.reshape(-1, 2) + 0.5, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("pinhole", ()), ("opencv", BROWN[:8]), ("opencv", BROWN[:5]), ("opencv_fisheye", FISHEYE)],
)
def test_what_we_write_is_read_by_cv2_and_by_us(tmp_path, model, distortion):
    camera = rc.Camera(
        width=640, height=480, fx=700, fy=710.5, cx=318.75, cy=242,
        model=model, distortion=tuple(distortion), skew=0.25,
    )  # fmt: skip
    views = rc.Views(rc.Rig([camera]), rc.Poses.of(np.zeros((0, 4, 4))))
    path = tmp_path / "c.yaml"
    assert write_views(path, views) == []
    assert read_views(path).camera() == camera
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    k, d = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    np.testing.assert_array_equal(k[0], [700, 0.25, 318.25])
    np.testing.assert_array_equal(d.ravel()[: len(distortion)], distortion)
    assert file.getNode("image_width").real() == 640


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("image_width: 640\n", "a camera matrix .* wanted, got none"),
        ("K: [[700, 0, 320], [0, 700, 240], [0, 0, 1]]\nN: [[7, 0, 3], [0, 7, 2], [0, 0, 1]]\n",
         "one camera matrix a camera wanted, got K, N"),
        ("K: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data: [1, 2]\n",
         "K: 3 x 3 numbers wanted, got 2"),
        ("K: !!opencv-matrix\n  rows: 1000000\n  cols: 1000000\n  dt: d\n  data: [1]\n",
         "K: 1000000 x 1000000 numbers wanted, got 1"),
        ("K: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n"
         "  data: [.Nan, 0, 1, 0, 1, 1, 0, 0, 1]\n", "K must have finite numbers"),
        ("K: !!python/object/apply:os.system ['true']\n", "a plain value wanted, got one with tag"),
        ("K: 1\nK: 2\n", "'K' comes twice"),
        ("a: &a [1]\nb: &b [*a, *a]\n", "a camera matrix"),
        ("a: &a [*a]\n", "alias 'a' repeats nothing before it"),
        ("[" * 5000, "nested|not valid YAML"),
        ("- " * 5000, "nested|not valid YAML"),
        ("a: [1", "not valid YAML"),
        ("K: [[-7, 0, 3], [0, 7, 2], [0, 0, 1]]\n", "a camera matrix"),
    ],
)  # fmt: skip
def test_each_fault_of_a_storage_is_one_line(tmp_path, text, words):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(rc.CameraError, match=rf"^[^\n]*({words})[^\n]*$"):
        read_views(path)


def test_aliases_that_multiply_a_short_text_are_refused(tmp_path):
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    path = tmp_path / "c.yaml"
    path.write_text("\n".join(lines))
    with pytest.raises(rc.CameraError, match="values, with those that aliases repeat"):
        read_views(path)


def test_numbers_are_those_of_yaml_1_2(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(
        "image_width: 640\nimage_height: 480\nK: [[7e2, 0, 320], [0, 7E+2, 240], [0, 0, 1]]\n"
        "D: [1e-5, 0, 0, 0, -.5]\n"
    )
    camera = read_views(path).camera()
    assert (camera.fx, camera.distortion) == (700, (1e-5, 0, 0, 0, -0.5))


def test_coefficients_that_are_not_understood_are_not_left_out(tmp_path):
    path = storage(tmp_path / "c.yml", image_width=640, image_height=480, K=K, D=np.ones(6))
    with pytest.raises(rc.CameraError, match="4, 5, 8, 12 or 14 distortion coefficients wanted"):
        read_views(path)


def test_entities_of_xml_are_refused(tmp_path):
    path = tmp_path / "c.xml"
    path.write_text(
        '<?xml version="1.0"?><!DOCTYPE o [<!ENTITY a "1"><!ENTITY b SYSTEM "file:///etc/passwd">]>'
        "<opencv_storage><K>&a;&b;</K></opencv_storage>"
    )
    with pytest.raises(rc.CameraError, match="declares a document type"):
        read_views(path)


FORMS = pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
SIZED = {"image_width": 640, "image_height": 480, "camera_matrix": K}


@FORMS
@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_errors_of_as_many_images_as_there_are_coefficients_are_no_coefficients(
    tmp_path, suffix, n
):
    others = {
        "per_view_reprojection_errors": np.ones((n, 1)),
        "roi": np.ones((1, 4)),
        "n_coeffs": 5,
    }
    path = storage(tmp_path / f"c{suffix}", **SIZED, D=BROWN[:5], **others)
    assert read_views(path).camera().distortion == tuple(BROWN[:5])
    path = storage(tmp_path / f"d{suffix}", **SIZED, per_view_reprojection_errors=np.ones((n, 1)))
    with pytest.raises(rc.CameraError, match="a name like D or dist, got per_view_reprojection"):
        read_views(path)
    path = storage(tmp_path / f"e{suffix}", **SIZED, D=BROWN[:5], distCoeffs=BROWN[:5])
    with pytest.raises(rc.CameraError, match=r"one vector of distortion .*, got D, distCoeffs"):
        read_views(path)


@FORMS
def test_a_fisheye_whose_coefficients_are_0_is_no_pinhole(tmp_path, suffix):
    wanted = cv_pixels(rays(), K, np.zeros(4), fisheye=True)
    zeros, flag = {"D": np.zeros((4, 1))}, {"fisheye_model": 1}
    path = tmp_path / f"c{suffix}"
    for values, answer in ((zeros | flag, None), (flag, None), (zeros, "fisheye")):
        storage(path, **SIZED, **values)
        camera = read_views(path, conventions=Conventions(lens_model=answer)).camera()
        np.testing.assert_allclose(lens_of(camera).project(rays()), wanted, rtol=0, atol=1e-9)
    with pytest.raises(rc.CameraError, match=r"in D are four.*--lens-model"):
        read_views(path)
    brown = Conventions(lens_model="brown")
    assert read_views(path, conventions=brown).camera().is_pinhole
    storage(path, **SIZED, D=BROWN[:5], camera_model="equidistant")
    with pytest.raises(rc.CameraError, match="a fisheye has 4 coefficients, got 5 in D"):
        read_views(path)
    storage(path, **SIZED, D=np.ones(4), fisheye_model=2)
    with pytest.raises(rc.CameraError, match="fisheye_model must be 0 or 1, got 2"):
        read_views(path)


def test_a_fisheye_without_distortion_is_written_and_read_as_it_is(tmp_path):
    camera = rc.Camera(width=640, height=480, fx=300, fy=300, model="opencv_fisheye")
    views = rc.Views(rc.Rig([camera]), rc.Poses.of(np.zeros((0, 4, 4))))
    write_views(tmp_path / "c.yaml", views)
    found = lens_of(read_views(tmp_path / "c.yaml").camera()).project(rays())
    np.testing.assert_array_equal(found, lens_of(camera).project(rays()))


@FORMS
def test_an_empty_matrix_of_coefficients_is_a_pinhole(tmp_path, suffix):
    views = read_views(storage(tmp_path / f"c{suffix}", **SIZED, D=np.zeros((0, 0))))
    assert views.camera().is_pinhole
    assert any("has no distortion coefficients" in note for note in views.notes)


@FORMS
def test_matrices_that_are_not_finite_are_named(tmp_path, suffix):
    path = storage(tmp_path / f"c{suffix}", **SIZED, D=np.full(5, np.nan))
    with pytest.raises(rc.CameraError, match=r"D must have finite|not valid JSON"):
        read_views(path)


def test_single_coefficients_are_not_left_out(tmp_path):
    path = storage(tmp_path / "c.yml", **SIZED, k1=0.1, k2=0.2)
    with pytest.raises(rc.CameraError, match=r"one vector of distortion .*, got k1, k2"):
        read_views(path)
    path.write_text("image_size: [640, 480]\nK: [[9, 0, 3], [0, 9, 2], [0, 0, 1]]\nD: [1, 2, 3]\n")
    with pytest.raises(rc.CameraError, match=r"coefficients wanted, got D: \[1, 2, 3\]"):
        read_views(path)


@FORMS
def test_a_pair_whose_order_the_file_does_not_say_has_no_places(tmp_path, suffix):
    r, _ = cv2.Rodrigues(np.array([0.02, -0.1, 0.03]))
    t = np.array([[-0.12], [0.01], [0.002]])
    values = {
        "K_rgb": K,
        "D_rgb": BROWN[:5],
        "K_depth": 2 * K,
        "D_depth": BROWN[:8],
        "R": r,
        "T": t,
    }
    values["K_depth"][2, 2] = 1
    views = read_views(storage(tmp_path / f"c{suffix}", **values), conventions=GIVEN)
    assert [camera.fx for camera in views.cameras()] == [1400, 700]
    assert len(views.poses) == 0
    assert any(
        "does not say whether depth is the first; rename depth and rgb to 1 and 2" in note
        for note in views.notes
    )


def test_poses_of_older_samples_are_read(tmp_path):
    boards = np.array([[0.1, 0.2, 0.3, 0, 0, 2], [0, 0.1, 0, 0.1, 0, 3]])
    new = storage(tmp_path / "new.yml", **SIZED, D=BROWN[:5], extrinsic_parameters=boards)
    old = storage(
        tmp_path / "old.xml", image_Width=640, image_Height=480, Camera_Matrix=K,
        Distortion_Coefficients=BROWN[:5], Extrinsic_Parameters=boards,
    )  # fmt: skip
    views, wanted = (read_views(path, conventions=GIVEN) for path in (old, new))
    assert views.cameras() == wanted.cameras()
    np.testing.assert_array_equal(views.poses.world_from_camera, wanted.poses.world_from_camera)
    assert len(views.poses) == 2


@FORMS
@pytest.mark.parametrize("xi", [0.9, np.array([[1.4]])])
def test_calibrations_of_omnidir_have_their_own_model(tmp_path, suffix, xi):
    d = BROWN[:4]
    path = storage(tmp_path / f"c{suffix}", **SIZED, distortion_coefficients=d[None], xi=xi)
    camera = read_views(path).camera()
    # C. Mei, P. Rives. 2007: onto the unit sphere, then by a pinhole xi behind its centre.
    sphere = rays() / np.linalg.norm(rays(), axis=1, keepdims=True)
    x, y = (sphere[:, :2] / (sphere[:, 2:] + np.asarray(xi).ravel())).T
    r2 = x * x + y * y
    g = 1 + d[0] * r2 + d[1] * r2 * r2
    u = x * g + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x)
    v = y * g + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y
    wanted = np.column_stack([700 * u + 318.25, 710 * v + 241.5]) + 0.5
    np.testing.assert_allclose(lens_of(camera).project(rays()), wanted, rtol=0, atol=1e-9)
    storage(path, **SIZED, D=BROWN[:5], xi=xi)
    with pytest.raises(rc.CameraError, match=r"xi and 4 coefficients of cv2\.omnidir wanted"):
        read_views(path)
    storage(path, **SIZED, D=d, xi="wide")
    with pytest.raises(rc.CameraError, match=r"cv2\.omnidir wanted, got 'wide' and 4"):
        read_views(path)


@pytest.mark.filterwarnings("error")
def test_numbers_that_overflow_are_one_line(tmp_path):
    k = K.copy()
    k[0, 0] = 1e308
    path = storage(tmp_path / "c.yml", **SIZED | {"camera_matrix": k}, D=BROWN[:5])
    with pytest.raises(rc.CameraError, match=r"fx must be .*, got 1e\+308"):
        read_views(path)
