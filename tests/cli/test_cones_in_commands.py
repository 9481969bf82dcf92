"""Cones of lenses through the commands, by areas of circles, pi (h tan a)^2."""

import json
import math
from pathlib import Path

import pytest
from commands import done, refusal

import rastercov as rc
from rastercov.core.camera.conventions import write_poses

SIDE, HEIGHT, EYE = 8.0, 2.0, 6.0
DIAGONAL = math.sqrt(2) * SIDE
CAMERA = {"width": 900, "height": 900, "fx": 600, "fy": 600}


@pytest.fixture(autouse=True)
def files():
    """A floor of 8 x 8 m, a camera 6 m above that sees all of it."""
    corners = [(-4, -4), (4, -4), (4, 4), (-4, 4)]
    lines = [f"v {x} {y} 0" for x, y in corners]
    Path("floor.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4"]))
    write_poses("poses.json", rc.look_at([(0, 0, EYE)], [(0, 0, 0)], (0, 1, 0)))
    Path("camera.json").write_text(json.dumps(CAMERA))


def circle(height, half_deg):
    """Area, and the most that a figure may be off it: 1e-6 of the diagonal along the circle."""
    radius = height * math.tan(math.radians(half_deg))
    return math.pi * radius**2, 2 * math.pi * radius * 1.1e-6 * DIAGONAL


@pytest.mark.parametrize(
    "lens", [{}, {"model": "opencv_fisheye"}, {"model": "opencv", "distortion": [-0.1, 0.02, 0, 0]}]
)
def test_what_a_lens_is_trusted_with_is_a_circle(capsys, lens):
    Path("camera.json").write_text(json.dumps(CAMERA | lens | {"max_angle_deg": 25}))
    line = "evaluate floor.obj -c camera.json -p poses.json --pictures 0 --json"
    content = json.loads(done(capsys, line)[0])
    true, most = circle(EYE, 25)
    covered = content["covered_area"]
    assert abs(covered["m2"] - true) <= covered["bound_m2"] <= most
    assert abs(sum(zone["area_m2"] for zone in content["dead_zones"]) - (SIDE**2 - true)) <= most


@pytest.mark.parametrize("angle", ["175.5", "179.9"])
def test_an_angle_that_no_lens_sees_is_refused(capsys, angle):
    lens = {"model": "opencv_fisheye", "max_angle_deg": float(angle)}
    Path("camera.json").write_text(json.dumps(CAMERA | lens))
    line = "evaluate floor.obj -c camera.json -p poses.json --by area"
    assert f"up to 175, or 180 for all directions, got {angle}" in refusal(capsys, line)


BORDERS = [
    {"max_angle_deg": 19},
    {"model": "opencv_fisheye", "fx": 120, "fy": 120},
    {"model": "fov", "distortion": [0.9], "max_angle_deg": 19},
    {"model": "omni", "distortion": [0.5, 0, 0, 0, 0], "max_angle_deg": 19},
    {"model": "equirectangular", "fx": 120, "fy": 120},
]
LINES = [
    "evaluate floor.obj -c camera.json -p poses.json -o out",
    "place plan.toml -o out",
    "check plan.toml -p poses.json -o out --min-coverage 0.01",
    "sheet floor.obj -c camera.json -p poses.json -o out.svg",
]
PLAN = """meshes = [{ path = "floor.obj" }]
camera = { file = "camera.json" }
candidates = [{ generator = "poses", file = "poses.json" }]
selection = { goal = "best_coverage", cameras = 1 }
"""


@pytest.mark.parametrize("line", LINES, ids=[line.split()[0] for line in LINES])
@pytest.mark.parametrize("lens", BORDERS, ids=[str(lens.get("model")) for lens in BORDERS])
def test_reports_of_a_lens_that_ends_before_its_image_are_written(capsys, lens, line):
    Path("camera.json").write_text(json.dumps(CAMERA | lens))
    Path("plan.toml").write_text(PLAN)
    done(capsys, line)
