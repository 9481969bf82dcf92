"""What users type first, and the line or the result that they get for it."""

import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
from commands import call, refusal, write_part

import rastercov as rc
from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.formats.cameras import read_views
from rastercov.placement.plan.file import plan_of

YAML = (
    "image_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n  rows: 3\n  cols: 3\n"
    "  dt: d\n  data: [80.0, 0.0, 32.0, 0.0, 81.0, 24.0, 0.0, 0.0, 1.0]\n"
    "distortion_coefficients: !!opencv-matrix\n  rows: 1\n  cols: 5\n  dt: d\n"
    "  data: [-0.1, 0.01, 0.0, 0.0, 0.0]\n"
)
PLAN = '[[meshes]]\npath = "part.obj"\n[camera]\nwidth = 64\nheight = 48\nfx = 60\nfy = 60\n'
OPTICS = {"pixel_size": 5e-6, "f_number": 4.0, "focus_distance": 0.5}


@pytest.fixture(autouse=True)
def files():
    write_part("part.obj")
    Path("cal.yaml").write_text("%YAML:1.0\n---\n" + YAML)
    Path("plan.toml").write_text(PLAN)
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 4, 3))


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_convert_writes_our_own_camera_file(suffix, capsys):
    code, _, err = call(capsys, f"convert cal.yaml camera.{suffix} --pixel-centre 0")
    assert (code, err) == (0, "")
    wanted = read_views("cal.yaml", conventions=rc.Conventions(pixel_centre=0)).camera()
    assert read_views(f"camera.{suffix}").camera() == wanted
    if suffix == "toml":
        assert tomllib.loads(Path("camera.toml").read_text())["fx"] == 80.0
        assert rc.Camera.load("camera.toml") == wanted


def test_optics_stand_beside_the_file_of_a_calibration():
    """In an entry of a plan, and in a camera file."""
    entries = {"file": "cal.yaml", "pixel_centre": 0.5, **OPTICS}
    plan = plan_of({"meshes": [{"path": "part.obj"}], "camera": entries})
    lines = [f"{name} = {value}" for name, value in OPTICS.items()]
    Path("camera.toml").write_text("\n".join(['file = "cal.yaml"', *lines]))
    views = read_views("camera.toml", conventions=rc.Conventions(pixel_centre=0.5))
    for camera in (plan.rig.cameras[0], views.camera()):
        assert (camera.focus_distance, camera.aperture) == (0.5, pytest.approx(80.5 * 5e-6 / 4))
        assert camera.model != "pinhole"


@pytest.mark.parametrize("heights", [2.2, [2.2]])
def test_a_single_height_is_the_lowest_and_the_highest(heights):
    entry = {"generator": "on_walls", "spacing": 1.0, "aim": [{"point": [0, 0, 0]}]}
    entries = [entry | {"heights": heights}]
    plan = plan_of({"meshes": [{"path": "part.obj"}], "candidates": entries})
    assert tuple(plan.candidates[0].heights) == (2.2, 2.2)


CHECK, EVALUATE = "check plan.toml -p rig.json", "evaluate part.obj -c khepra -p rig.json"


@pytest.mark.parametrize(
    "line",
    [f"{CHECK} --min-coverage 98", f"{CHECK} --group lid=98", f"{EVALUATE} --min-coverage 98",
     f"{EVALUATE} --min-visibility 98", "place share.toml"],
)  # fmt: skip
def test_a_share_in_percent_is_asked_for(line, capsys):
    goal = '[selection]\ngoal = "fewest_cameras"\ncoverage = 98.0\n'
    Path("share.toml").write_text(PLAN + goal)
    assert "pass 0.98 for 98 %" in call(capsys, line)[2]


@pytest.mark.parametrize(
    ("name", "line"),
    [*((name, "plan.toml -p rig.json --min-coverage 0.5") for name in ("part.obj", "plan.toml")),
     ("", "plan.toml -p none.json --min-coverage 0.5"),
     ("", "none.toml -p rig.json --min-coverage 0.5"),
     ("", "plan.toml -p rig.json --min-coverage 98"),
     ("", "plan.toml -p rig.json --group led=0.5")],
)  # fmt: skip
def test_junit_is_written_for_bad_input(name, line, capsys):
    if name:
        Path(name).write_text("x")
    said = refusal(capsys, f"check {line} --junit check.xml --summary check.md")
    suites = ElementTree.parse("check.xml").getroot()
    assert (suites.get("tests"), suites.get("errors"), suites.get("failures")) == ("1", "1", "0")
    assert suites.find("testsuite/testcase/error").get("message") in said
    assert "| error | " in Path("check.md").read_text()
