"""Cones of lamps through the commands, by areas of circles, pi (h tan a)^2."""

import json
from pathlib import Path

import pytest
from commands import call, done, refusal
from test_cones_in_commands import HEIGHT, SIDE, circle, files  # noqa: F401 # for every test

PLACE = "position = [0.2, -0.1, 2]\naim = [0.2, -0.1, 0]\n"


LAMPS = {
    "spot": '[lamps.key]\nkind = "spot"\nintensity_cd = 900\nhalf_angle_deg = 60\n' + PLACE,
    "bar": '[lamps.key]\nkind = "bar"\nsize = 0.5\npoints = 1\nintensity_cd = 900\n'
    "half_angle_deg = 60\n" + PLACE,
    "ies": '[lamps.key]\nies = "lamp.ies"\n' + PLACE,
}


IES = """IESNA:LM-63-2002
TILT=NONE
1 1000 2 4 1 1 2 0 0 0 1 1 50
0 20 40 60
0
400 380 300 200
"""


@pytest.fixture(autouse=True)
def luminaire(files):  # noqa: F811
    Path("lamp.ies").write_text(IES)


@pytest.mark.parametrize("kind", LAMPS)
def test_what_a_lamp_lights_is_a_circle(capsys, kind):
    Path("lamps.toml").write_text(LAMPS[kind])
    line = "evaluate floor.obj -c camera.json -p poses.json --lamps lamps.toml --pictures 0 --json"
    content = json.loads(done(capsys, line)[0])
    true, most = circle(HEIGHT, 60)
    covered, light = content["covered_area"], content["light"]
    assert abs(covered["m2"] - true) <= covered["bound_m2"] <= most
    own = light["lamps"][0]
    bound = own["bound_percent"] / 100 * SIDE**2
    assert abs(own["lit_percent"] / 100 * SIDE**2 - true) <= bound + 1e-9 <= most
    dead = SIDE**2 - true
    assert abs(light["unlit"]["m2"] - dead) <= light["unlit"]["bound_m2"] <= most
    assert [zone["reason"] for zone in content["dead_zones"]] == ["unlit"]
    assert abs(content["dead_zones"][0]["area_m2"] - dead) <= most


def test_a_plan_is_made_by_the_circle_that_a_lamp_lights(capsys):
    camera = "{ width = 900, height = 900, fx = 600, fy = 600 }"
    Path("plan.toml").write_text(
        f'meshes = [{{ path = "floor.obj" }}]\ncamera = {camera}\n{LAMPS["spot"]}'
        '[[candidates]]\ngenerator = "poses"\nfile = "poses.json"\n'
        '[selection]\ngoal = "best_coverage"\ncameras = 1\n[outputs]\npage = false\n'
    )
    code, _, _ = call(capsys, "place plan.toml")
    assert code == 0
    plan = json.loads(Path("plan", "plan.json").read_text())
    true, most = circle(HEIGHT, 60)
    covered = plan["covered_area"]
    assert abs(covered["m2"] - true) <= covered["bound_m2"] <= most


@pytest.mark.parametrize("angle", ["175.5", "179.9"])
def test_an_angle_that_no_lamp_has_is_refused(capsys, angle):
    Path("lamps.toml").write_text(LAMPS["spot"].replace("60", angle))
    line = "evaluate floor.obj -c camera.json -p poses.json --lamps lamps.toml --by area"
    assert f"up to 175, or 180 for all directions, got {angle}" in refusal(capsys, line)
