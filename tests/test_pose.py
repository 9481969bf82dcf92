"""Poses: where look-at points, which matrices are refused, and pose files."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rastercov.base.errors import PoseError
from rastercov.camera.camera import Camera
from rastercov.camera.pose import check_poses, inverse, valid_poses
from rastercov.camera.pose_file import read_poses, write_poses
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.viewpoints import look_at, sphere_of_poses

CAMERA = Camera(width=640, height=480, fx=500, fy=500, cx=300, cy=250)

lengths = st.floats(-100, 100).map(lambda x: round(x, 3))
points = hnp.arrays(np.float64, 3, elements=lengths)


def image(point: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return to_image(to_camera(np.asarray(point, float), pose), CAMERA)


def assert_rigid(poses: np.ndarray, tolerance: float = 1e-12) -> None:
    R = poses[:, :3, :3]
    assert np.allclose(R.transpose(0, 2, 1) @ R, np.eye(3), rtol=0, atol=tolerance)
    assert np.allclose(np.linalg.det(R), 1, rtol=0, atol=tolerance)
    assert np.array_equal(poses[:, 3], np.tile((0, 0, 0, 1), (len(poses), 1)))


# --- look_at --------------------------------------------------------------------------------------


@pytest.mark.slow
@given(points, points, points)
def test_look_at_shows_the_target_at_the_principal_point_and_up_above_it(eye, target, up):
    view = target - eye
    across = np.linalg.norm(np.cross(view, up))
    assume(across > 1e-3 * np.linalg.norm(view) * np.linalg.norm(up))
    assume(across > 0)
    (pose,) = look_at(eye, target, up)
    assert_rigid(pose[None])
    assert np.array_equal(pose[:3, 3], eye)
    assert image(target, pose) == pytest.approx((300, 250), abs=1e-6)

    step = 0.01 * np.linalg.norm(view) / np.linalg.norm(up)
    u, v = image(target + step * up, pose)
    assert u == pytest.approx(300, abs=1e-5)
    assert v < 250


def test_look_at_along_y_has_x_to_the_right_and_z_upwards():
    (pose,) = look_at((0, 0, 0), (0, 5, 0))
    #          right, down, forward
    assert np.array_equal(pose[:3, :3], np.transpose([(1, 0, 0), (0, 0, -1), (0, 1, 0)]))
    assert image((1, 5, 0), pose)[0] > 300
    assert image((0, 5, 1), pose)[1] < 250


@pytest.mark.slow
@given(points, points)
def test_look_at_is_the_thesis_frame_turned_half_round_its_view(eye, target):
    # (6.8)-(6.11): Z along the view, X = Up x Z to the left, Y = Z x X upwards.
    up = np.array((0.0, 0.0, 1.0))
    assume(np.linalg.norm((target - eye)[:2]) > 1e-3 * np.linalg.norm(target - eye))
    Z = (target - eye) / np.linalg.norm(target - eye)
    X = np.cross(up, Z) / np.linalg.norm(np.cross(up, Z))
    Y = np.cross(Z, X) / np.linalg.norm(np.cross(Z, X))
    thesis = np.column_stack((X, Y, Z))
    (pose,) = look_at(eye, target)
    assert pose[:3, :3] @ np.diag((-1, -1, 1)) == pytest.approx(thesis, abs=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("along", "spare"), [("x", "z"), ("y", "z"), ("z", "y")])
@pytest.mark.parametrize("up", ["with", "against", "zero"])
def test_where_up_says_nothing_another_axis_is_up(sign, along, spare, up):
    axes = dict(zip("xyz", np.eye(3), strict=True))
    view = sign * axes[along]
    (pose,) = look_at(
        (1, 2, 3), np.add((1, 2, 3), view), {"with": 1, "against": -1, "zero": 0}[up] * view
    )
    assert_rigid(pose[None])
    assert np.array_equal(pose[:3, 2], view)
    assert np.array_equal(pose[:3, 1], -axes[spare])


@pytest.mark.slow
@given(hnp.arrays(np.float64, 3, elements=st.floats(-1e-10, 1e-10)))
def test_noise_does_not_decide_which_axis_is_up(noise):
    # Straight down, as over a table: y is up, however the last digits of the target fall.
    (pose,) = look_at((0, 0, 2), noise)
    assert pose[:3, 1] == pytest.approx((0, -1, 0), abs=1e-9)


@pytest.mark.parametrize("digits", range(17))
def test_look_at_is_rigid_however_nearly_up_is_parallel_to_the_view(digits):
    rng = np.random.default_rng(digits)
    view, aside = rng.normal(size=(2, 200, 3))
    assert_rigid(look_at((0, 0, 0), view, view + 10.0**-digits * aside))


def test_look_at_single_and_many_broadcast():
    eyes = np.array([[3, 0, 0], [0, 3, 1], [2, 2, 2]])
    many = look_at(eyes, (0, 0, 0))
    assert many.shape == (3, 4, 4)
    assert look_at((3, 0, 0), (0, 0, 0)).shape == (1, 4, 4)
    assert np.array_equal(many, np.concatenate([look_at(eye, [(0, 0, 0)]) for eye in eyes]))
    assert np.array_equal(look_at((9, 9, 9), eyes)[:, :3, 3], np.full((3, 3), 9))
    ups = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    assert np.array_equal(look_at(eyes, (0, 0, 0), ups)[2], look_at(eyes[2], (0, 0, 0), ups[2])[0])
    assert look_at(np.zeros((0, 3)), (1, 0, 0)).shape == (0, 4, 4)


def test_look_at_refuses_an_eye_on_its_target_and_names_the_rows():
    eyes = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]])
    with pytest.raises(PoseError, match=r"pose 1: .* same point \(and 1 more poses\)") as caught:
        look_at(eyes, (1, 0, 0))
    assert caught.value.pose_ids == (1, 3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(3))
def test_look_at_refuses_what_is_not_finite(place, value):
    arguments = [np.zeros((4, 3)), np.ones((4, 3)), np.tile((0.0, 0, 1), (4, 1))]
    arguments[place][2, 1] = value
    with pytest.raises(PoseError, match="pose 2: eye, target or up is not finite") as caught:
        look_at(*arguments)
    assert caught.value.pose_ids == (2,)


def test_opposite_infinities_are_refused_without_a_warning():
    with pytest.raises(PoseError, match="not finite"):
        look_at((np.inf, 0, 0), (-np.inf, 0, 0))


@pytest.mark.parametrize(
    ("eyes", "match"),
    [
        ((1, 2), r"eyes must have shape \(3,\) or \(P, 3\), got \(1, 2\)"),
        (np.zeros((2, 2, 3)), r"eyes must have shape .* got \(2, 2, 3\)"),
        ("eye", "eyes must be numbers"),
        (None, "eyes must"),
        ([(1, 2, 3), (4, 5)], "eyes must be numbers"),
        ((10**400, 0, 0), "eyes must be numbers"),
        (np.zeros((2, 3)), r"must broadcast to \(P, 3\), got \(2, 3\), \(3, 3\), \(1, 3\)"),
    ],
)
def test_look_at_says_which_shape_is_wrong(eyes, match):
    with pytest.raises(PoseError, match=match):
        look_at(eyes, np.ones((3, 3)))


# --- sphere_of_poses ------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 7, 500])
def test_sphere_of_poses_looks_at_its_centre(count):
    centre = np.array((1.0, -2.0, 3.0))
    poses = sphere_of_poses(centre, 4, count)
    assert_rigid(poses)
    assert np.allclose(np.linalg.norm(poses[:, :3, 3] - centre, axis=1), 4)
    assert np.allclose(poses[:, :3, 3] + 4 * poses[:, :3, 2], centre)


def test_sphere_of_poses_is_even():
    eyes = sphere_of_poses((0, 0, 0), 1, 1000)[:, :3, 3]
    assert np.linalg.norm(eyes.mean(axis=0)) < 1e-3
    assert np.allclose(eyes.T @ eyes / 1000, np.eye(3) / 3, atol=1e-3)
    cosines = eyes @ eyes.T - 3 * np.eye(1000)
    to_neighbour = np.arccos(cosines.max(axis=1))
    # A hexagonal lattice of 1000 points over 4 pi would have them 0.120 apart.
    assert to_neighbour.min() > 0.08
    assert to_neighbour.max() < 0.13


def test_sphere_of_no_poses_is_empty():
    assert sphere_of_poses((0, 0, 0), 1, 0).shape == (0, 4, 4)


@pytest.mark.parametrize(
    ("centre", "distance", "count", "match"),
    [
        ((0, 0, 0), 0, 5, "distance must be positive"),
        ((0, 0, 0), -1, 5, "distance must be positive"),
        ((0, 0, 0), np.nan, 5, "distance must be positive"),
        ((0, 0, 0), np.inf, 5, "distance must be positive"),
        ((0, 0, 0), 1, -1, "count must be a whole number"),
        ((0, 0, 0), 1, 2.5, "count must be a whole number"),
        ((0, 0), 1, 5, "centre must have shape"),
        (np.zeros((5, 3)), 1, 5, "centre must have shape"),
        ((0, np.nan, 0), 1, 5, "not finite"),
    ],
)
def test_sphere_of_poses_refuses_what_is_no_sphere(centre, distance, count, match):
    with pytest.raises(PoseError, match=match):
        sphere_of_poses(centre, distance, count)


# --- check_poses, valid_poses ---------------------------------------------------------------------


def scaled(pose: np.ndarray, factor: float) -> np.ndarray:
    return pose @ np.diag((factor, factor, factor, 1))


FAULTS = {
    "nan": (lambda pose: np.where(pose == pose[0, 3], np.nan, pose), "is not finite"),
    "infinite": (lambda pose: np.where(pose == pose[1, 3], np.inf, pose), "is not finite"),
    "scale": (lambda pose: scaled(pose, 2), "is not a rotation"),
    "huge scale": (lambda pose: scaled(pose, 1e200), "is not a rotation"),
    "no rotation": (lambda pose: scaled(pose, 0), "is not a rotation"),
    "shear": (lambda pose: pose + 1e-3 * np.eye(4, k=1) * (1, 1, 1, 0), "is not a rotation"),
    "drift": (lambda pose: scaled(pose, 1 + 1e-3), "is not a rotation"),
    "small drift": (lambda pose: scaled(pose, 1 + 1e-6), "is not a rotation"),
    "mirror": (lambda pose: pose @ np.diag((-1, 1, 1, 1)), "is a reflection"),
    "point mirror": (lambda pose: scaled(pose, -1), "is a reflection"),
    "last row": (lambda pose: pose * np.array([[1], [1], [1], [2]]), "must end in the row 0 0 0 1"),
    "transposed": (lambda pose: pose.T, "must end in the row 0 0 0 1"),
}


@pytest.mark.parametrize(("spoil", "text"), FAULTS.values(), ids=FAULTS)
def test_a_pose_that_is_not_rigid_is_found_and_the_others_stay(spoil, text):
    good = sphere_of_poses((1, 2, 3), 4, 6)
    poses = good.copy()
    for row in (1, 4):
        poses[row] = spoil(poses[row])
    spoiled = poses.copy()

    checked, faults = check_poses(poses)
    assert sorted(faults) == [1, 4]
    assert all(fault.startswith(text) for fault in faults.values())
    assert np.array_equal(checked, spoiled, equal_nan=True)
    assert np.array_equal(poses, spoiled, equal_nan=True)  # the input is not touched

    with pytest.raises(PoseError, match=f"pose 1 {text}.* \\(and 1 more poses\\)") as caught:
        valid_poses(poses)
    assert caught.value.pose_ids == (1, 4)
    assert "\n" not in str(caught.value)


def test_good_poses_pass_bit_for_bit():
    good = sphere_of_poses((1, 2, 3), 4, 100)
    checked, faults = check_poses(good)
    assert not faults
    assert checked is not good
    assert np.array_equal(checked, good)


@pytest.mark.slow
@given(st.floats(-1e-7, 1e-7), st.integers(0, 8))
def test_small_drift_is_taken_out(size, entry):
    good = look_at((1, 2, 3), (0, 0, 0))
    drifted = good.copy()
    drifted[0, entry // 3, entry % 3] += size
    mended = valid_poses(drifted)
    assert_rigid(mended, 1e-14)
    assert np.allclose(mended, good, rtol=0, atol=1.1e-7)
    assert np.array_equal(mended[:, :3, 3], good[:, :3, 3])
    assert np.array_equal(valid_poses(mended), mended)


def test_one_pose_and_none_are_poses():
    assert valid_poses(np.eye(4)).shape == (1, 4, 4)
    assert valid_poses(np.eye(4).tolist()).shape == (1, 4, 4)
    assert valid_poses(np.zeros((0, 4, 4))).shape == (0, 4, 4)
    assert valid_poses([]).shape == (0, 4, 4)


@pytest.mark.parametrize(
    ("poses", "match"),
    [
        (np.zeros(16), r"must have shape \(P, 4, 4\), got \(16,\)"),
        (np.zeros((2, 3, 4)), r"got \(2, 3, 4\)"),
        (np.zeros((3, 3)), r"got \(1, 3, 3\)"),
        (np.zeros((1, 2, 4, 4)), r"got \(1, 2, 4, 4\)"),
        (5, r"got \(\)"),
        ("poses", "must be numbers"),
        ([[1, 2], [3]], "must be numbers"),
        ([np.eye(4), np.eye(3)], "must be numbers"),
        ([[[10**400]]], "must be numbers"),
        ({}, "must be numbers"),
    ],
)
def test_what_is_no_array_of_poses_is_refused(poses, match):
    with pytest.raises(PoseError, match=match):
        check_poses(poses)


@pytest.mark.slow
@given(hnp.arrays(np.float64, (2, 4, 4)))
def test_any_matrix_is_checked_without_a_warning(poses):
    checked, faults = check_poses(poses)
    sound = [row for row in range(2) if row not in faults]
    assert_rigid(checked[sound], 1e-13)


# --- inverse --------------------------------------------------------------------------------------


@pytest.mark.slow
@given(points, points)
def test_inverse_undoes_the_pose(eye, target):
    assume(np.linalg.norm(target - eye) > 1e-3)
    poses = look_at([eye, target], [target, eye])
    assert inverse(poses) @ poses == pytest.approx(np.tile(np.eye(4), (2, 1, 1)), abs=1e-12)
    assert inverse(inverse(poses)) == pytest.approx(poses, abs=1e-12)
    assert np.array_equal(inverse(poses[0]), inverse(poses)[0])
    assert inverse(poses[:0]).shape == (0, 4, 4)


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["poses.npy", "poses.json", "POSES.NPY", "Poses.Json"])
@pytest.mark.parametrize("count", [0, 1, 100])
def test_poses_come_back_from_a_file_bit_for_bit(tmp_path, name, count):
    poses = sphere_of_poses((1 / 3, 1e7, -1e-9), np.pi, count)
    write_poses(tmp_path / name, poses)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    back = read_poses(str(tmp_path / name))
    assert back.dtype == np.float64
    assert back.tobytes() == poses.tobytes()


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i8", "u1"])
def test_any_real_npy_is_read_as_float64(tmp_path, dtype):
    np.save(tmp_path / "poses.npy", np.eye(4).astype(dtype))
    back = read_poses(tmp_path / "poses.npy")
    assert back.dtype == np.dtype(np.float64)
    assert np.array_equal(back, np.eye(4)[None])


def test_one_pose_may_stand_alone_in_a_file(tmp_path):
    (tmp_path / "poses.json").write_text(json.dumps({"world_from_camera": np.eye(4).tolist()}))
    assert read_poses(tmp_path / "poses.json").shape == (1, 4, 4)


def test_a_file_is_read_unchecked_so_that_each_fault_is_reported_with_its_row(tmp_path):
    np.save(tmp_path / "poses.npy", np.stack((np.eye(4), np.full((4, 4), np.nan))))
    assert sorted(check_poses(read_poses(tmp_path / "poses.npy"))[1]) == [1]


def test_poses_are_checked_before_they_are_written(tmp_path):
    for name, poses, match in (
        ("poses.npy", 2 * np.eye(4), "pose 0 must end"),
        ("poses.json", np.zeros((2, 4, 4)), "pose 0 must end"),
        ("poses.txt", np.eye(4), r"poses\.txt: a pose file ends in \.npy or \.json"),
    ):
        with pytest.raises(PoseError, match=match):
            write_poses(tmp_path / name, poses)
    assert not list(tmp_path.iterdir())


def refused(path, match: str) -> None:
    with pytest.raises(PoseError, match=match) as caught:
        read_poses(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


JSON = {
    "not json": ("{", "not a pose file"),
    "empty": ("", "not a pose file"),
    "deep": ("[" * 100_000, "not a pose file"),
    "list": ("[]", "a pose file holds"),
    "wrong key": ('{"poses": []}', 'holds {"world_from_camera"'),
    "ragged rows": ('{"world_from_camera": [[[1, 2], [3]]]}', "not a pose file"),
    "ragged poses": ('{"world_from_camera": [[[1]], [[1, 2]]]}', "not a pose file"),
    "null": ('{"world_from_camera": null}', r"must have shape \(P, 4, 4\)"),
    "text": ('{"world_from_camera": "abc"}', "not a pose file"),
    "table": ('{"world_from_camera": {"a": 1}}', "not a pose file"),
    "number": ('{"world_from_camera": 5}', r"got \(\)"),
    "huge": ('{"world_from_camera": [[[1' + "0" * 400 + "]]]}", "not a pose file"),
    "digits": ('{"world_from_camera": [[[1' + "0" * 5000 + "]]]}", "not a pose file"),
    "3 x 4": ('{"world_from_camera": [[[1,0,0,0],[0,1,0,0],[0,0,1,0]]]}', r"got \(1, 3, 4\)"),
    "hollow": ('{"world_from_camera": [[]]}', r"got \(1, 0\)"),
}


@pytest.mark.parametrize(("text", "match"), JSON.values(), ids=JSON)
def test_json_that_holds_no_poses_is_refused(tmp_path, text, match):
    (tmp_path / "poses.json").write_text(text)
    refused(tmp_path / "poses.json", match)


def test_an_empty_list_is_no_poses(tmp_path):
    (tmp_path / "poses.json").write_text('{"world_from_camera": []}')
    assert read_poses(tmp_path / "poses.json").shape == (0, 4, 4)


class Trap:
    """Raises when unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("a pose file was executed",))


def test_a_pose_file_is_never_executed(tmp_path):
    path = tmp_path / "poses.npy"
    np.save(path, np.array([Trap()], dtype=object), allow_pickle=True)
    refused(path, "not a pose file")
    path.write_bytes(pickle.dumps(Trap()))
    refused(path, "not a pose file")


def test_a_renamed_archive_is_no_pose_file(tmp_path):
    path = tmp_path / "poses.npy"
    with path.open("wb") as file:
        np.savez(file, poses=np.eye(4))
    refused(path, "not a pose file")
    path.write_bytes(b"PK\x03\x04")
    refused(path, "not a pose file")


@pytest.mark.parametrize("kept", [0, 3, 6, 20, 127, 128, 200, -1])
def test_a_truncated_npy_is_refused(tmp_path, kept):
    path = tmp_path / "poses.npy"
    write_poses(path, sphere_of_poses((0, 0, 0), 1, 5))
    path.write_bytes(path.read_bytes()[:kept])
    refused(path, "not a pose file")


@pytest.mark.parametrize(
    ("array", "match"),
    [
        (np.zeros((2, 3, 4)), r"got \(2, 3, 4\)"),
        (np.zeros((0, 7)), r"got \(0, 7\)"),
        (np.float64(1), r"got \(\)"),
        (np.eye(4) * 1j, "must be real numbers, got complex128"),
        (np.eye(4).astype(str), "must be real numbers"),
        (np.eye(4, dtype=bool), "must be real numbers, got bool"),
        (np.zeros((4, 4), dtype=[("a", float)]), "must be real numbers"),
        (np.zeros((4, 4), dtype="M8[s]"), "must be real numbers"),
    ],
)
def test_an_npy_of_something_else_is_refused(tmp_path, array, match):
    np.save(tmp_path / "poses.npy", array)
    refused(tmp_path / "poses.npy", match)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("poses")


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(0, 127), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_damaged_header_gives_poses_or_a_pose_error(folder, damage):
    path = folder / "poses.npy"
    write_poses(path, np.eye(4))
    content = bytearray(path.read_bytes())
    for place, byte in damage:
        content[place] = byte
    path.write_bytes(content)
    try:
        poses = read_poses(path)
    except PoseError as error:
        assert str(path) in str(error)  # noqa: PT017 - some damage is harmless
    else:
        assert poses.shape[1:] == (4, 4)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "folder.npy").mkdir()
    (tmp_path / "poses.csv").write_text("1,0,0,0")
    refused(tmp_path / "none.npy", "cannot be read")
    refused(tmp_path / "none.json", "cannot be read")
    refused(tmp_path / "folder.npy", "cannot be read")
    refused(tmp_path / "poses.csv", r"ends in \.npy or \.json")
    refused(tmp_path / "none", r"ends in \.npy or \.json")
