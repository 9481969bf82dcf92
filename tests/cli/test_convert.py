"""The command `convert`, and cameras and poses of other programs in all others."""

import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import answer, call, done, refusal

import rastercov as rc
from rastercov.formats.cameras import read_views, write_views
from rastercov.placement.plan.file import read_plan


def rig(n=4):
    cameras = [rc.Camera(width=64, height=48, fx=50.0 + row, fy=50) for row in range(2)]
    poses = rc.look_at(eyes=[(3.0, row, 1) for row in range(n)], targets=(0, 0, 0))
    poses = rc.Poses.of(poses, camera=np.arange(n) % 2)
    return rc.Views(
        rc.Rig(cameras, ["left", "right"]), poses, tuple(f"{row}.png" for row in range(n))
    )


@pytest.fixture(autouse=True)
def files():
    write_views("model", rig())


def test_a_list_of_matrices_is_a_pose_file(here, capsys):
    poses = rig().poses.world_from_camera
    Path("list.json").write_text(json.dumps(poses.tolist()), encoding="utf-8")
    assert answer(capsys, "convert list.json rig.json")["poses"] == 4
    np.testing.assert_array_equal(read_views("rig.json").poses.world_from_camera, poses)


def test_a_model_passes_through_every_format_with_poses(here, capsys):
    line = "convert model transforms.json && convert transforms.json text --to colmap-text"
    assert all(call(capsys, command)[0] == 0 for command in line.split(" && "))
    result = answer(capsys, "convert text rig.json --pose-unit mm")
    assert (result["poses"], result["has_unit"], result["format"]) == (4, True, "rastercov")
    wanted = rig().poses.world_from_camera
    poses = read_views("rig.json").poses.world_from_camera
    np.testing.assert_allclose(poses[:, :3, 3], wanted[:, :3, 3] / 1000, atol=1e-15)
    np.testing.assert_allclose(poses[:, :3, :3], wanted[:, :3, :3], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("convert nothing.json out.json", "nothing.json: no such file"),
        ("convert model rig.json", "expected poses with a unit, .*; give --pose-unit"),
        (
            "convert model out.yaml",
            "expected one of 2 cameras, 'camera 1', 'camera 2', got no name; choose one with",
        ),
        ("convert model out.yaml --camera-name up", "got 'up'"),
        ("convert model out.tif", "name the format"),
        ("convert model x --to colmp", "--to: expected format to be rastercov, colmap, "),
        ("convert model model", "expected another file than IN"),
        ("convert model taken", "got an existing cameras.bin"),
        ("convert bare.json text --to colmap", "text: expected cameras to write, got only poses"),
        (
            "convert model taken.json --pose-unit m",
            "taken.json: expected a new file, got an existing one",
        ),
        ("convert model nowhere/out.json --pose-unit m", "got a folder that does not exist"),
        ("convert model nowhere/out", "nowhere/out: no such file"),
        ("convert model x --image-size 640", "--image-size: expected WIDTHxHEIGHT"),
        ("convert model x --pixel-centre 1", "--pixel-centre: expected 0 or 0.5"),
        ("convert model rig.json --from opencv", "model: .*got a folder"),
    ],
)
def test_each_bad_line_is_refused_and_leaves_nothing(here, capsys, line, words):
    write_views("taken", rig())
    write_views("taken.json", rig())
    rc.write_poses("bare.json", rig().poses.world_from_camera)
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
    assert re.search(words, refusal(capsys, line))
    assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before


def test_overwrite_replaces_a_model_as_a_whole(here, capsys):
    write_views("taken", rig(2), format="colmap-text")
    assert call(capsys, "convert model taken --overwrite")[0] == 0
    names = {path.name for path in (here / "taken").iterdir()}
    assert names == {"cameras.bin", "images.bin", "points3D.bin"}
    assert len(read_views("taken").poses) == 4


# --- cameras and poses of other commands ----------------------------------------------------------

RENDER = "render box --device cpu -o out "


def rendered(capsys, line):
    return answer(capsys, RENDER + line)["pixels_covered"]


@pytest.mark.slow
def test_one_file_gives_camera_and_poses_to_a_command(here, capsys):
    right = "--camera-name 'camera 2' --pose-unit m"
    wanted = rendered(capsys, f"-c model -p model {right}")
    assert wanted > 0
    assert rendered(capsys, f"-p model {right}") == wanted
    write_views("right.json", rig().of_camera("right"))
    assert rendered(capsys, "-p right.json") == wanted
    rc.write_poses("p.npy", rig().of_camera("right").poses.world_from_camera)
    assert rendered(capsys, f"-c model -p p.npy {right.replace('--pose-unit m', '')}") == wanted


@pytest.mark.slow
def test_bare_poses_have_the_convention_that_is_named(here, capsys):
    poses = rig().poses.world_from_camera
    rc.write_poses("ours.npy", poses)
    np.save("opengl.npy", poses @ np.diag([1.0, -1, -1, 1]))
    wanted = rendered(capsys, "-c khepra -p ours.npy")
    assert rendered(capsys, "-c khepra -p opengl.npy --pose-convention opengl") == wanted
    assert rendered(capsys, "-c khepra -p opengl.npy") != wanted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("-p model", "expected poses in a known unit, got none; give --pose-unit"),
        ("-p model --pose-unit m", "expected one of 2 cameras, .*choose one with --camera-name"),
        ("-p sphere:3", "sphere:3: expected a camera, got none; give --camera"),
        ("-c model -p sphere:3", "expected one of 2 cameras"),
        ("-p ours.npy", "ours.npy: expected a camera with the poses, got none; give --camera"),
        ("-c ours.npy -p ours.npy", "ours.npy: expected a camera, got poses only"),
        ("-c khepra -p eye.json", "eye.json: expected poses, got cameras only"),
    ],
)
def test_what_a_command_lacks_is_one_line(here, capsys, line, words):
    rc.write_poses("ours.npy", rig().poses.world_from_camera)
    rig().cameras()[0].save("eye.json")
    assert re.search(words, refusal(capsys, RENDER + line))


def test_evaluate_leaves_out_bad_poses_of_any_file(here, capsys):
    write_views("transforms.json", rig(12).of_camera("left"))
    content = json.loads((here / "transforms.json").read_text())
    content["frames"][1]["transform_matrix"][0][0] = 9
    content["frames"][4]["transform_matrix"][1][1] = 9
    (here / "transforms.json").write_text(json.dumps(content))
    line = "evaluate box -p transforms.json --pose-unit m --pictures 2 --table all --json -o out"
    assert re.search(
        r"image '2\.png': pose 1 \(from 0\): expected a rigid transform", refusal(capsys, line)
    )
    assert not Path("out").exists()
    out, err = done(capsys, line + " --skip-bad-poses")
    assert "pose 1 (from 0) skipped: it is not a rotation" in err
    told = json.loads(out)
    assert [row["pose"] for row in told["per_pose"]] == [0, 2, 3, 5]
    assert told["skipped_poses"].keys() == {"1", "4"}
    assert set(pq.read_table("out/coverage.parquet")["pose"].to_pylist()) == {0, 2, 3, 5}


def test_convert_says_which_poses_it_leaves_out(here, capsys):
    write_views("rig.json", rig(16).of_camera("left"))
    content = json.loads(Path("rig.json").read_text(encoding="utf-8"))
    for row in range(7):
        content["world_from_camera"][row][0][0] = 9
    (here / "rig.json").write_text(json.dumps(content))
    code, out, err = call(capsys, "convert rig.json out.json --skip-bad-poses --json")
    result = json.loads(out)
    assert (code, result["poses"]) == (0, 1)
    for text in ("pose 0 (from 0) skipped: it is not a rotation", "2 more poses skipped"):
        assert text in err
        assert any(text in note for note in result["notes"])
    assert "camera and image names: .npy holds" in call(capsys, "convert out.json o.npy")[2]


OPTICS = "pixel_size = 5e-6, f_number = 4, focus_distance = 2.5"


@pytest.mark.slow
def test_a_camera_may_be_entries_on_the_command_line(here, capsys):
    matrix = f"K1: {MATRIX.format(50)}\nimage_width: 64\nimage_height: 48\n"
    (here / "k.yaml").write_text(matrix)
    entries = ['preset = "khepra"', "near = 0.5", "hfov_deg = 40"]
    (here / "c.toml").write_text("\n".join(entries))
    line = f"-c '{', '.join(entries)}' -p sphere:3"
    assert rendered(capsys, line) == rendered(capsys, "-c c.toml -p sphere:3")
    for entry, words in (
        ("widht = 3", "--camera widht = 3: expected known entries of a camera (width"),
        ("near = ", "a file, a preset, or entries such as"),
        ("left=none.yaml", "none.yaml: no such file"),
        ('file = "none.yaml"', "none.yaml: no such file"),
        ('file = "k.yaml", fx = 3', "with file, got fx"),
    ):
        assert words in refusal(capsys, f"{RENDER} -c '{entry}' -p sphere:3")
    (here / "f.toml").write_text(f'file = "k.yaml"\n{OPTICS.replace(", ", chr(10))}')
    for given in (f'file = "k.yaml", {OPTICS}', f'left={{file = "k.yaml", {OPTICS}}}'):
        assert rendered(capsys, f"-c '{given}' -p sphere:3") == rendered(
            capsys, "-c f.toml -p sphere:3"
        )


PLAN = """
meshes = [{{ built_in = "box" }}]
[camera]
file = "calibration.yaml"
{answers}
"""
MATRIX = "[[{}.0, 0, 31.5], [0, 50, 23.5], [0, 0, 1]]"
CALIBRATION = f"K1: {MATRIX.format(50)}\nK2: {MATRIX.format(60)}\n"
SIZE = "image_size = [64, 48]\n"


@pytest.mark.parametrize(
    ("answers", "words"),
    [("", r"plan\.toml: camera: .*an image size, got none .*; give image_size = \[width, height\]"),
     (SIZE, "expected one of 2 cameras, 'camera 1', 'camera 2', got no name; choose one with name"),
     (SIZE + 'name = "left"', "got 'left'"),
     (SIZE + 'name = "camera 2"\nfx = 1', "with file, got fx"),
     (SIZE + 'name = "camera 2"', None)],
)  # fmt: skip
def test_a_plan_takes_files_of_other_programs_and_its_own_answers(here, capsys, answers, words):
    lines = "%YAML:1.0\n---\n" + CALIBRATION + "D1: [0, 0, 0, 0, 0]\nD2: [0, 0, 0, 0, 0]\n"
    (here / "calibration.yaml").write_text(lines)
    (here / "plan.toml").write_text(PLAN.format(answers=answers))
    if words is None:
        assert read_plan("plan.toml").rig.cameras[0].fx == 60
    else:
        assert re.search(words, refusal(capsys, "check plan.toml -p model"))
