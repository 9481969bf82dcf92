"""Poses: where look-at points, which matrices are refused, and pose files."""

import io
import json
import pickle

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rastercov.base.errors import PoseError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.conventions import read_poses, write_poses
from rastercov.core.camera.pose import (
    DRIFT_TOLERANCE,
    ROUNDING,
    check_poses,
    valid_poses,
)
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh.arrays import inverse

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
    eyes, origin = np.array([[3, 0, 0], [0, 3, 1], [2, 2, 2]]), (0, 0, 0)
    many = look_at(eyes, origin)
    assert np.array_equal(many, np.concatenate([look_at(eye, [origin]) for eye in eyes]))
    assert np.array_equal(look_at((9, 9, 9), eyes)[:, :3, 3], np.full((3, 3), 9))
    ups = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    assert np.array_equal(look_at(eyes, origin, ups)[2], look_at(eyes[2], origin, ups[2])[0])
    assert look_at(np.zeros((0, 3)), (1, 0, 0)).shape == (0, 4, 4)


@pytest.mark.parametrize(
    ("change", "text", "rows"),
    [
        ({}, r"different points, got the same \(and 1 more pose\)", (1, 3)),
        *(({(place, 2): value}, "expected finite eye, target and up", (2,))
          for place in range(3) for value in (np.nan, np.inf, -np.inf)),
        ({(0, 2): np.inf, (1, 2): -np.inf}, "expected finite eye", (2,)),
        ({(0, 0): 1e31}, "within ±", (0,)),
    ],
)  # fmt: skip
def test_look_at_names_the_rows_that_are_no_views(change, text, rows):
    eyes, ups = (
        np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]]),
        np.tile((0.0, 0, 1), (4, 1)),
    )
    arguments = [eyes, np.tile((1.0, 0, 0), (4, 1)), ups]
    if change:
        arguments[1] += 3
    for (place, row), value in change.items():
        arguments[place][row, 1] = value
    with pytest.raises(PoseError, match=f"pose {rows[0]} .from 0.: .*{text}") as caught:
        look_at(*arguments)  # without a warning
    assert caught.value.pose_ids == rows


# --- sphere_of_poses ------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 2, 7, 500])
def test_sphere_of_poses_looks_at_its_centre(count):
    centre = np.array((1.0, -2.0, 3.0))
    poses = sphere_of_poses(centre, 4, count)
    assert poses.shape == (count, 4, 4)
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


# --- check_poses, valid_poses ---------------------------------------------------------------------


def scaled(pose: np.ndarray, factor: float) -> np.ndarray:
    return pose @ np.diag((factor, factor, factor, 1))


FAULTS = {
    "nan": (lambda pose: np.where(pose == pose[0, 3], np.nan, pose), "is not finite"),
    "scale": (lambda pose: scaled(pose, 2), "is not a rotation"),
    "huge scale": (lambda pose: scaled(pose, 1e200), "is not a rotation"),
    "shear": (lambda pose: pose + 1e-3 * np.eye(4, k=1) * (1, 1, 1, 0), "is not a rotation"),
    "small drift": (lambda pose: scaled(pose, 1 + 1e-6), "is not a rotation"),
    "mirror": (lambda pose: pose @ np.diag((-1, 1, 1, 1)), "is a reflection"),
    "far": (lambda pose: pose + np.diag([1e31], 3), "is beyond"),
    "last row": (
        lambda pose: pose * np.array([[1], [1], [1], [2]]),
        "does not end in the row 0 0 0 1",
    ),
    "transposed": (lambda pose: pose.T, "does not end in the row 0 0 0 1"),
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

    with pytest.raises(
        PoseError, match=f"pose 1 .from 0.: .* got one that {text}.* \\(and 1 more pose\\)"
    ) as caught:
        valid_poses(poses)
    assert caught.value.pose_ids == (1, 4)
    assert "\n" not in str(caught.value)


@given(seed=st.integers(0, 2**32 - 1))
def test_faults_and_drift_are_those_that_numpy_finds(seed):
    rng = np.random.default_rng(seed)
    poses = sphere_of_poses((1, 2, 3), 4, 40)
    poses[:, :3, :3] += rng.normal(size=(40, 3, 3)) * 10.0 ** rng.uniform(-16, -4, (40, 1, 1))
    poses[rng.random(40) < 0.2, :, 0] *= -1
    poses[rng.random(40) < 0.1, rng.integers(4), rng.integers(4)] = np.nan
    poses[rng.random(40) < 0.1, 3, rng.integers(4)] += 1
    rotation = np.where(np.isfinite(poses), poses, 0)[:, :3, :3]
    drift = np.abs(rotation.transpose(0, 2, 1) @ rotation - np.eye(3)).max(axis=(1, 2))
    is_fault = [
        ("is not finite", ~np.isfinite(poses).all(axis=(1, 2))),
        ("does not end in the row 0 0 0 1", (poses[:, 3] != (0, 0, 0, 1)).any(axis=1)),
        ("is not a rotation (scaled, sheared or drifted)", drift > DRIFT_TOLERANCE),
        ("is a reflection, not a rotation", np.linalg.det(rotation) < 0),
    ]
    expected = {row: text for text, mask in is_fault[::-1] for row in np.flatnonzero(mask).tolist()}
    checked, faults = check_poses(poses)
    assert faults == expected
    sound = np.array([row for row in range(40) if row not in faults], int)
    is_kept = (checked[sound] == poses[sound]).all(axis=(1, 2))
    assert is_kept[drift[sound] < 0.9 * ROUNDING].all()
    assert not is_kept[drift[sound] > 1.1 * ROUNDING].any()
    assert_rigid(checked[sound], 3e-14)


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
    for given_, n in ((np.eye(4), 1), (np.eye(4).tolist(), 1), (np.zeros((0, 4, 4)), 0), ([], 0)):
        assert valid_poses(given_).shape == (n, 4, 4)


SHAPES = [
    *(("look_at", (eyes, np.ones((3, 3))), match) for eyes, match in (
        ((1, 2), r"eyes of shape \(3,\) or \(P, 3\), got \(1, 2\)"),
        (np.zeros((2, 2, 3)), r"eyes of shape .* got \(2, 2, 3\)"),
        ("eye", "eyes to be numbers"),
        ([(1, 2, 3), (4, 5)], "eyes to be numbers"),
        ((10**400, 0, 0), "eyes to be numbers"),
        (np.zeros((2, 3)), r"that broadcast to \(P, 3\), got \(2, 3\), \(3"))),
    *(("sphere_of_poses", arguments, match) for arguments, match in (
        *((((0, 0, 0), each, 5), "distance to be above 0") for each in (0, np.nan, np.inf)),
        *((((0, 0, 0), 1, each), "count to be a whole number") for each in (-1, 2.5)),
        (((0, 0), 1, 5), "centre of shape"),
        ((np.zeros((5, 3)), 1, 5), "centre of shape"),
        (((0, np.nan, 0), 1, 5), r"expected finite eye, target and up, got inf or NaN \(an"))),
    *(("check_poses", (poses,), match) for poses, match in (
        (np.zeros(16), r"of shape \(P, 4, 4\), got \(16,\)"),
        (np.zeros((2, 3, 4)), r"got \(2, 3, 4\)"),
        (np.zeros((3, 3)), r"got \(1, 3, 3\)"),
        (5, r"got \(\)"),
        *((each, "to be numbers") for each in ("poses", [np.eye(4), np.eye(3)], [[[10**400]]])))),
]  # fmt: skip


@pytest.mark.parametrize(("name", "arguments", "match"), SHAPES)
def test_what_has_another_shape_or_range_is_refused(name, arguments, match):
    with pytest.raises(PoseError, match=match):
        globals()[name](*arguments)


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
def test_one_pose_may_stand_alone_in_a_file_of_any_real_numbers(tmp_path, dtype):
    np.save(tmp_path / "poses.npy", np.eye(4).astype(dtype))
    (tmp_path / "poses.json").write_text(json.dumps({"world_from_camera": np.eye(4).tolist()}))
    for name in ("poses.npy", "poses.json"):
        back = read_poses(tmp_path / name)
        assert back.dtype == np.dtype(np.float64)
        assert np.array_equal(back, np.eye(4)[None])


def test_a_file_is_read_unchecked_so_that_each_fault_is_reported_with_its_row(tmp_path):
    np.save(tmp_path / "poses.npy", np.stack((np.eye(4), np.full((4, 4), np.nan))))
    assert sorted(check_poses(read_poses(tmp_path / "poses.npy"))[1]) == [1]


def test_poses_are_checked_before_they_are_written(tmp_path):
    for name, poses, match in (
        ("poses.npy", 2 * np.eye(4), "expected a rigid transform, got one that does"),
        ("poses.json", np.zeros((2, 4, 4)), "expected a rigid transform, got one that does"),
        ("poses.txt", np.eye(4), r"poses\.txt: expected a pose file \.npy or \.json"),
    ):
        with pytest.raises(PoseError, match=match):
            write_poses(tmp_path / name, poses)
    assert not list(tmp_path.iterdir())


def refused(path, match: str) -> None:
    with pytest.raises(PoseError, match=match) as caught:
        read_poses(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def npy(array):
    """Bytes of an array in numpy's format."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


class Trap:
    """Raises when unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("a pose file was executed",))


def archive():
    buffer = io.BytesIO()
    np.savez(buffer, poses=np.eye(4))
    return buffer.getvalue()


def json_of(text):
    return f'{{"world_from_camera": {text}}}'.encode()


NO_POSES = [
    *(("json", content, "expected valid JSON, got") for content in (b"{", b"", b"[" * 100_000)),
    ("json", b"[]", r'expected \{"world_from_camera": \[4 x 4, \.\.\.\]\}, got other'),
    ("json", b'{"poses": []}', r'expected \{"world_from_camera": \[4 x 4, \.\.\.\]\}, got other'),
    ("json", json_of("null"), r"of shape \(P, 4, 4\)"),
    ("json", json_of("5"), r"got \(\)"),
    ("json", json_of("[[[1,0,0,0],[0,1,0,0],[0,0,1,0]]]"), r"got \(1, 3, 4\)"),
    ("json", json_of("[[]]"), r"got \(1, 0\)"),
    *(("json", json_of(text), r"poses to be|Exceeds|a number within") for text in (
        "[[[1, 2], [3]]]", "[[[1]], [[1, 2]]]", '"abc"', '{"a": 1}',
        "[[[1" + "0" * 400 + "]]]", "[[[1" + "0" * 5000 + "]]]")),
    ("npy", npy(np.zeros((2, 3, 4))), r"got \(2, 3, 4\)"),
    ("npy", npy(np.zeros((0, 7))), r"got \(0, 7\)"),
    ("npy", npy(np.float64(1)), r"got \(\)"),
    *(("npy", npy(array), "to be real numbers") for array in (
        np.eye(4) * 1j, np.eye(4).astype(str), np.eye(4, dtype=bool),
        np.zeros((4, 4), dtype=[("a", float)]), np.zeros((4, 4), dtype="M8[s]"))),
    # A pose file is never executed, and an archive is none.
    *(("npy", content, "expected a NumPy array") for content in (
        npy(np.array([Trap()], dtype=object)), pickle.dumps(Trap()), archive(), b"PK\x03\x04")),
    *(("npy", npy(sphere_of_poses((0, 0, 0), 1, 5))[:kept], "expected a NumPy array")
      for kept in (0, 3, 6, 20, 127, 128, 200, -1)),
    ("csv", b"1,0,0,0", r"expected a pose file \.npy or \.json, got '\.csv'"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("suffix", "content", "match"),
    NO_POSES,
    ids=[f"{s} {m} {k}" for k, (s, _, m) in enumerate(NO_POSES)],
)
def test_a_file_that_holds_no_poses_is_refused(tmp_path, suffix, content, match):
    path = tmp_path / f"poses.{suffix}"
    path.write_bytes(content)
    refused(path, match)


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
    for name in ("none.npy", "none.json", "folder.npy"):
        refused(tmp_path / name, "got a folder|no such file")
