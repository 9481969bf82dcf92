"""Calibrations of OpenCV written by cv2.FileStorage, and by us, against cv2.projectPoints."""

import cv2
import numpy as np
import pytest
from view_files import RAYS, bent, cv_pixels, has_note, motion, pixels, projects, refused, same

import rastercov as rc
from rastercov.formats.cameras import read_views, write_views

K = np.array([[700.0, 0, 318.25], [0, 710.0, 241.5], [0, 0, 1]])
BROWN = np.array([-0.2, 0.05, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001, 1e-3, 2e-3, 3e-3, 1e-3])
FISHEYE = np.array([0.02, -0.01, 0.003, 0.001])
GIVEN = rc.Conventions(image_size=(640, 480), pose_unit=1)
FORMS = pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
SIZE = {"image_width": 640, "image_height": 480}
SIZED = SIZE | {"camera_matrix": K}
PAIR = {"M1": K, "D1": BROWN[:5], "M2": K * [[2, 0, 1], [0, 2, 1], [0, 0, 1]], "D2": BROWN[:8]}
STEP = motion([0.02, -0.1, 0.03], [-0.12, 0.01, 0.002])
PLACES = {"R": STEP[:3, :3], "T": STEP[:3, 3:]}


def storage(path, **values):
    """Write values as cv2 does."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml", ".json"])
@pytest.mark.parametrize("n", [5, 8, 12])
@pytest.mark.parametrize("shape", [(1, -1), (-1, 1)])
def test_a_storage_of_any_form_projects_as_cv2_does(tmp_path, suffix, n, shape):
    d = BROWN[:n].reshape(shape)
    path = storage(tmp_path / f"calib{suffix}", **SIZE, cameraMatrix=K, distCoeffs=d)
    camera = read_views(path).camera()
    assert (camera.width, camera.height) == (640, 480)
    projects(camera, cv_pixels(RAYS, K, d))


@FORMS
@pytest.mark.parametrize("d", [FISHEYE, np.zeros(4)])
def test_four_coefficients_are_asked_for_unless_the_file_says(tmp_path, suffix, d):
    """Also where all are 0: such a fisheye is no pinhole."""
    path = storage(tmp_path / f"c{suffix}", **SIZED, D=d)
    refused(path, "for the coefficients in D", "--lens-model brown (k1")
    for model, flag in (("brown", 0), ("fisheye", 1)):
        wanted = cv_pixels(RAYS, K, d, fisheye=flag == 1)
        projects(read_views(path, conventions=rc.Conventions(lens_model=model)).camera(), wanted)
        # The flag of OpenCV's sample program.
        flagged = storage(tmp_path / f"f{suffix}", **SIZED, D=d, fisheye_model=flag)
        projects(read_views(flagged).camera(), wanted)
    for word, wanted in (("equidistant", True), ("plumb_bob", False)):
        named = storage(tmp_path / f"n{suffix}", **SIZED, D=d, camera_model=word)
        assert (read_views(named).camera().model == "opencv_fisheye") == wanted


def test_a_missing_size_is_asked_for_and_an_answer_that_is_not_needed_is_noted(tmp_path):
    path = storage(tmp_path / "c.yml", K=K, D=BROWN[:5])
    refused(path, "expected an image size, got none in")
    camera = read_views(path, conventions=rc.Conventions(image_size=(640, 480))).camera()
    assert (camera.width, camera.height) == (640, 480)
    storage(path, **SIZED, D=BROWN[:5])
    answers = rc.Conventions(image_size=(9, 9), pixel_centre=0.5, pose_unit="mm")
    views = read_views(path, conventions=answers)
    assert (views.camera().width, views.camera().cx) == (640, 318.75)
    assert sum("was not used" in note for note in views.notes) == 3


@pytest.mark.parametrize("names", ["K1 K2 D1 D2", "K_left K_right D_left D_right", "M1 M2 D1 D2",
                                   "cameraMatrix1 cameraMatrix2 distCoeffs1 distCoeffs2",
                                   "leftCameraMatrix rightCameraMatrix leftDistCoeffs "
                                   "rightDistCoeffs"])  # fmt: skip
def test_two_cameras_are_paired_by_their_names(tmp_path, names):
    values = [PAIR[name] for name in ("M1", "M2", "D1", "D2")]
    own = dict(zip(names.split(), values, strict=True))
    views = read_views(storage(tmp_path / "stereo.yml", **SIZE, **own, **PLACES))
    assert [len(camera.distortion) for camera in views.cameras()] == [5, 8]
    assert [camera.fx for camera in views.cameras()] == [700, 1400]
    same(np.linalg.inv(views.rig.rig_from_camera[1]), STEP, 1e-14)  # x2 = R x1 + T
    np.testing.assert_array_equal(views.poses.world_from_camera, views.rig.rig_from_camera)
    assert not views.has_unit


@FORMS
def test_a_pair_whose_order_the_file_does_not_say_has_no_places(tmp_path, suffix):
    names = {"M1": "K_rgb", "D1": "D_rgb", "M2": "K_depth", "D2": "D_depth"}
    own = {names[name]: value for name, value in PAIR.items()}
    views = read_views(storage(tmp_path / f"c{suffix}", **own, **PLACES), conventions=GIVEN)
    assert [camera.fx for camera in views.cameras()] == [1400, 700]
    assert len(views.poses) == 0
    assert has_note(views, "does not say whether depth is the first; rename depth and rgb to 1")


@FORMS
def test_places_of_a_pair_are_read_with_the_matrices_beside_them(tmp_path, suffix):
    # P1 and P2 are 3 x 4, R1, R2 and Q of the rectified pair.
    rest = PLACES | {"R1": STEP[:3, :3], "P1": np.hstack([K, STEP[:3, 3:]]), "Q": np.eye(4)}
    whole = read_views(storage(tmp_path / f"pair{suffix}", **PAIR, **rest), conventions=GIVEN)
    path = storage(tmp_path / f"extrinsics{suffix}", **rest)
    refused(path, f"put it and 'intrinsics{suffix}' into one file", conventions=GIVEN)
    beside = storage(tmp_path / f"intrinsics{suffix}", **PAIR)
    views = read_views(path, conventions=GIVEN)
    assert views.cameras() == whole.cameras()
    np.testing.assert_array_equal(views.poses.world_from_camera, whole.poses.world_from_camera)
    np.testing.assert_array_equal(views.rig.rig_from_camera, whole.rig.rig_from_camera)
    assert has_note(views, "those of 'intrinsics")
    assert len(read_views(beside, conventions=GIVEN).poses) == 0  # the other is read by itself


def test_extrinsic_parameters_are_poses_in_the_frame_of_the_pattern(tmp_path):
    rng = np.random.default_rng(1)
    boards = np.column_stack([rng.uniform(-0.3, 0.3, (4, 5)), np.full(4, 2.0)])
    values = {"distortion_coefficients": BROWN[:5], "extrinsic_parameters": boards}
    views = read_views(storage(tmp_path / "c.yml", **SIZED, **values))
    wanted = [np.linalg.inv(motion(board[:3], board[3:])) for board in boards]
    same(views.poses.world_from_camera, wanted)
    older = {"image_Width": 640, "image_Height": 480, "Camera_Matrix": K}
    older |= {"Distortion_Coefficients": BROWN[:5], "Extrinsic_Parameters": boards}
    old = read_views(storage(tmp_path / "old.xml", **older))
    assert old.cameras() == views.cameras()
    np.testing.assert_array_equal(old.poses.world_from_camera, views.poses.world_from_camera)


@pytest.mark.parametrize(
    ("model", "distortion"),
    [
        ("pinhole", ()),
        ("opencv", BROWN[:8]),
        ("opencv", BROWN[:5]),
        ("opencv_fisheye", FISHEYE),
        ("opencv_fisheye", [0.0] * 4),
    ],
)
def test_what_we_write_is_read_by_cv2_and_by_us(tmp_path, model, distortion):
    camera = rc.Camera(
        width=640, height=480, fx=700, fy=710.5, cx=318.75, cy=242,
        model=model, distortion=tuple(distortion), skew=0.25,
    )  # fmt: skip
    path = tmp_path / "c.yaml"
    assert write_views(path, rc.Views(rc.Rig([camera]), rc.Poses.of([]))) == []
    assert read_views(path).camera() == camera
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    k, d = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    np.testing.assert_array_equal(k[0], [700, 0.25, 318.25])
    np.testing.assert_array_equal(d.ravel()[: len(distortion)], distortion)
    assert file.getNode("image_width").real() == 640


MATRIX = "K: [[7e2, 0, 320], [0, 7E+2, 240], [0, 0, 1]]\n"


def test_numbers_are_those_of_yaml_1_2_and_other_values_are_plain(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(
        f"size: [640, 480]\n{MATRIX}D: [1e-5, 0, 0, 0, -.5]\nnote: !!str 5\nis_on: true\nnone: ~\n"
    )
    camera = read_views(path).camera()
    assert (camera.fx, camera.distortion) == (700, (1e-5, 0, 0, 0, -0.5))
    path.write_text(f"{MATRIX}D: []\n")
    assert read_views(path, conventions=GIVEN).camera().is_pinhole


def test_texts_that_are_deep_or_that_aliases_multiply_are_refused(tmp_path):
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    path = tmp_path / "c.yaml"
    for text, words in (("\n".join(lines), "values, with those that aliases repeat"),
                        ("[" * 5000, ""), ("- " * 5000, "")):  # fmt: skip
        path.write_text(text)
        refused(path, words)


@FORMS
@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_other_vectors_are_no_coefficients(tmp_path, suffix, n):
    """Such as the errors of as many images as there are coefficients."""
    errors = {"per_view_reprojection_errors": np.ones((n, 1))}
    others = errors | {"roi": np.ones((1, 4)), "n_coeffs": 5}
    path = storage(tmp_path / f"c{suffix}", **SIZED, D=BROWN[:5], **others)
    assert read_views(path).camera().distortion == tuple(BROWN[:5])
    refused(storage(path, **SIZED, **errors), "a name like D or dist, got per_view_reprojection")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"D": np.ones(6)}, "4, 5, 8, 12 or 14 distortion coefficients"),
        ({"D": BROWN[:5], "distCoeffs": BROWN[:5]}, ", got D, distCoeffs"),
        ({"k1": 0.1, "k2": 0.2}, "one vector of distortion"),
        ({"D": np.full(5, np.nan)}, "D to have finite"),
        ({"D": BROWN[:5], "xi": 0.9}, "xi and 4 coefficients of cv2.omnidir"),
        ({"D": BROWN[:4], "xi": "wide"}, "cv2.omnidir, got 'wide' and 4"),
        (
            {"D": BROWN[:5], "camera_matrix": np.where(K == 700, 1e308, K)},
            "expected fx to be from 1e-12 to 1e+12 px, got 1e+308",
        ),
    ],
)
@pytest.mark.filterwarnings("error")
def test_values_that_are_not_understood_are_not_left_out(tmp_path, values, words):
    refused(storage(tmp_path / "c.xml", **SIZED | values), words)


@FORMS
def test_an_empty_matrix_of_coefficients_is_a_pinhole(tmp_path, suffix):
    views = read_views(storage(tmp_path / f"c{suffix}", **SIZED, D=np.zeros((0, 0))))
    assert views.camera().is_pinhole
    assert has_note(views, "has no distortion coefficients")


@FORMS
@pytest.mark.parametrize("xi", [0.9, np.array([[1.4]])])
def test_calibrations_of_omnidir_have_their_own_model(tmp_path, suffix, xi):
    d = BROWN[:4]
    path = storage(tmp_path / f"c{suffix}", **SIZED, distortion_coefficients=d[None], xi=xi)
    # C. Mei, P. Rives. 2007: onto the unit sphere, then by a pinhole xi behind its centre.
    sphere = RAYS / np.linalg.norm(RAYS, axis=1, keepdims=True)
    xy = (sphere[:, :2] / (sphere[:, 2:] + np.asarray(xi).ravel())).T
    wanted = pixels(bent(xy, d[:2], d[2:]), 700, 710, 318.25, 241.5) + 0.5
    projects(read_views(path).camera(), wanted)


@FORMS
def test_matrices_of_the_rectified_image_are_not_needed(tmp_path, suffix):
    more = {"D": BROWN[:5], "rectification_matrix": np.eye(3), "projection_matrix": np.eye(3, 4)}
    views = read_views(storage(tmp_path / f"c{suffix}", **SIZED, **more))
    assert has_note(views, "rectification_matrix, projection_matrix not needed: the camera is")
    assert not has_note(views, "content may be missing")
