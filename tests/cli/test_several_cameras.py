"""Several cameras in one command: by a file of all, or each by its name."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import answer, done, refusal, write_part

import rastercov as rc
from rastercov.core.camera.conventions import read_poses, write_poses
from rastercov.formats.cameras import read_views, write_views

WIDE = rc.Camera(width=64, height=48, fx=50, fy=50)
LONG = rc.Camera(width=96, height=72, fx=120, fy=120)
NAMES = ["wide", "long", "long", "wide", "long"]
MATRICES = rc.sphere_of_poses((0, 0, 0), 3.5, 5)
INDICES = [0, 1, 1, 0, 1]
EVALUATE = "evaluate box --min-pixels-per-m2 250 --pictures 0 --table none -o out "
PLAN = """
meshes = [{{ built_in = "box" }}]
task = {{ min_pixels_per_m2 = 250 }}
selection = {{ goal = "fewest_cameras", coverage = 0.5 }}
{cameras}
"""
WIDE_ENTRIES = "width = 64\nheight = 48\nfx = 50\nfy = 50\n"
LONG_ENTRIES = "width = 96\nheight = 72\nfx = 120\nfy = 120\n"
TYPES = f"[cameras.long]\n{LONG_ENTRIES}[cameras.wide]\n{WIDE_ENTRIES}"


@pytest.fixture(autouse=True)
def files():
    """Two cameras, poses that name them, and the same in one file."""
    write_part("part.obj")
    WIDE.save("wide.json")
    LONG.save("long.json")
    write_poses("named.json", MATRICES, NAMES)
    write_poses("bare.json", MATRICES)
    rig = rc.Rig([WIDE, LONG], ["wide", "long"])
    poses = rc.Poses.of(MATRICES, camera=INDICES)
    write_views("rig.json", rc.Views(rig=rig, poses=poses, images=tuple("abcde")))


def figures(summary):
    """What a summary says of coverage."""
    return {name: summary[name] for name in ("by_camera", "covered_area", "covered", "per_pose")}


def test_poses_may_name_their_cameras():
    views = read_views("named.json")
    write_views("again.json", views)
    for each in (views, read_views("again.json")):
        assert each.rig is None
        assert (each.camera_names, each.poses.camera.tolist()) == (("wide", "long"), INDICES)
    np.testing.assert_array_equal(read_poses("named.json"), MATRICES)


@pytest.mark.slow
def test_named_cameras_are_those_of_one_file(capsys):
    by_name = answer(capsys, EVALUATE + "-c long=long.json -c wide=wide.json -p named.json")
    of_file = answer(capsys, EVALUATE + "-p rig.json")
    assert [each["camera"] for each in by_name["by_camera"]] == ["long", "wide"]
    by_name["by_camera"].reverse()
    assert figures(by_name) == figures(of_file)
    other = answer(capsys, EVALUATE + "-c rig.json -p named.json")
    assert figures(other) == figures(of_file)


@pytest.mark.slow
def test_one_camera_may_be_chosen_of_several(capsys):
    chosen = answer(capsys, EVALUATE + "-p rig.json --camera-name long")
    assert "by_camera" not in chosen
    assert chosen["poses"] == 3
    entry = answer(capsys, EVALUATE + "-p rig.json")["by_camera"][1]
    assert entry["covered"] == chosen["covered"]
    again = answer(capsys, EVALUATE + "-c rig.json -p named.json --camera-name long")
    assert again["per_pose"] == chosen["per_pose"]


def test_a_terminal_has_a_line_for_each_camera(capsys):
    out, _ = done(capsys, "evaluate box --pictures 0 -o out -p rig.json")
    assert "Covered by each camera type alone" in out
    assert all(name in out for name in ("wide", "long"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("-c wide=wide.json -p named.json", "expected poses of cameras 'wide', got camera 'long'"),
        ("-c rig.json -p bare.json", "expected the camera of each pose"),
        (
            "-c wide.json -c long.json -p named.json",
            "expected NAME=FILE for each of several cameras",
        ),
        ("-c a=wide.json -c a=long.json -p named.json", "expected distinct names, got 'a' twice"),
        ("-c wide=wide.json -c long=gone.toml -p named.json", "gone.toml: no such file"),
        ("-p rig.json --camera-name tall", "got 'tall'"),
        ("-p named.json", "expected a camera with the poses, got none; give --camera"),
        ("-c bad=bare.json -p named.json", "expected a camera, got poses only; give a camera file"),
    ],
)
def test_what_cannot_be_matched_is_one_line(capsys, line, words):
    assert words in refusal(capsys, EVALUATE + line)


@pytest.mark.parametrize("names", [["wide"] * 4, [""] * 5, "wide"])
def test_names_in_a_pose_file_that_are_none_are_refused(capsys, names):
    table = {"world_from_camera": MATRICES.tolist(), "camera": names}
    Path("bad.json").write_text(json.dumps(table))
    line = EVALUATE + "-c wide.json -p bad.json"
    assert "camera to be 5 names of cameras" in refusal(capsys, line)
    for path, wrong in (("other.json", list(names)), ("poses.npy", NAMES)):
        with pytest.raises(rc.PoseError, match=r"a name for each of 5|got \.npy"):
            write_poses(path, MATRICES, wrong)


def checked(capsys, cameras, line):
    Path("plan.toml").write_text(PLAN.format(cameras=cameras))
    return answer(capsys, "check plan.toml " + line)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cameras", "line"),
    [(TYPES, "-p named.json"), (TYPES, "-p rig.json"), ("", "-p rig.json"),
     ("", "-p named.json -c wide=wide.json -c long=long.json"),
     (f"[camera]\n{LONG_ENTRIES}", "-p named.json -c rig.json")],  # --camera replaces the plan's
)  # fmt: skip
def test_check_takes_cameras_of_the_plan_of_the_file_or_of_options(capsys, cameras, line):
    result, wanted = checked(capsys, cameras, line), answer(capsys, EVALUATE + "-p rig.json")
    percents = [each["covered_area"]["percent"] for each in (result, wanted)]
    assert percents[0] == pytest.approx(percents[1], abs=1e-9)
    assert {each["camera"] for each in result["network"]["by_camera"]} == {"wide", "long"}
    one = "[camera]\n" + LONG_ENTRIES
    assert checked(capsys, one, "-p rig.json --camera-name long")["cameras"] == 3


@pytest.mark.parametrize("head", ["[camera]", "[cameras.a]"])
def test_a_camera_that_the_pose_file_states_goes_before_that_of_the_plan(capsys, head):
    """As `view` shows it: its own lens, with a line; one that was given goes before both."""
    name = head.strip("[]").removeprefix("cameras.")
    rig = rc.Rig([LONG], ["a"])
    write_views("own.json", rc.Views(rig=rig, poses=rc.Poses.of(MATRICES), images=tuple("abcde")))
    own = checked(capsys, f"{head}\n{WIDE_ENTRIES}", "-p own.json")
    area = rc.check("plan.toml", "own.json").summary()["covered_area"]
    assert own["covered_area"] == area
    assert own["result_warnings"][0] == (
        f"{name}: the pose file's camera is used; it differs from the plan's"
    )
    same = checked(capsys, f"{head}\n{LONG_ENTRIES}", "-p own.json")
    assert (same["covered_area"], same["result_warnings"]) == (area, [])
    given = rc.check("plan.toml", "own.json", camera=WIDE).summary()["covered_area"]
    assert given != area


def test_existing_cameras_are_those_of_the_plan(capsys):
    write_views(
        "there.json",
        rc.Views(rig=rc.Rig([LONG], ["wide"]), poses=rc.Poses.of(MATRICES), images=tuple("abcde")),
    )
    more = 'existing = "there.json"\ncandidates = [{ generator = "on_sphere", count = 4 }]\n'
    text = more + PLAN.format(cameras=f"[cameras.wide]\n{WIDE_ENTRIES}")
    Path("plan.toml").write_text(text)
    assert "existing: expected cameras of the plan, got another" in refusal(
        capsys, "place plan.toml -o out"
    )
    Path("plan.toml").write_text(text.replace(WIDE_ENTRIES, LONG_ENTRIES))
    done(capsys, "place plan.toml -o out --json")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cameras", "line", "words"),
    [
        ("", "-p bare.json", "camera: expected an entry, got none; add it, or"),
        (
            "[camera]\n" + WIDE_ENTRIES,
            "-p rig.json",
            "expected poses of one camera, as plan.toml, got 2: wide, long",
        ),
        (
            "[camera]\n" + WIDE_ENTRIES,
            "-p named.json",
            "as plan.toml, got 2: wide, long; name them as",
        ),
        (TYPES.replace("wide", "fish"), "-p named.json", "got camera 'wide'"),
        ("[camera]\n" + WIDE_ENTRIES + TYPES, "-p named.json", "expected camera or cameras"),
    ],
)
def test_check_names_what_does_not_match(capsys, cameras, line, words):
    Path("plan.toml").write_text(PLAN.format(cameras=cameras))
    assert words in refusal(capsys, "check plan.toml " + line)
