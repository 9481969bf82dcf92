"""Plans with lamps: a fringe sensor and a satin part from place to check, and what is refused."""

import re
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from commands import done, enter, refusal
from plans import told

import rastercov as rc
from rastercov.core.coverage.task import name_of
from rastercov.placement.plan.file import PlanError, plan_of

PLAN = """
ambient = "5 lx"

[[meshes]]
built_in = "icosahedron"

[cameras.cam]
width = 96
height = 72
fx = 90
fy = 90

[rigs.fringe]
rule = "all"

[[rigs.fringe.cameras]]
camera = "cam"

[[rigs.fringe.cameras]]
camera = "cam"
name = "proj"
translation = [0.5, 0, 0]
task = { max_incidence_deg = 60.0 }

[lamps.key]
kind = "spot"
intensity_cd = 900
half_angle_deg = 40
position = [0, -3, 2]
aim = [0, 0, 0]

[lamps.ring]
kind = "ring"
size = 0.3
points = 4
intensity_cd = 600
rig = "fringe"

[task]
max_incidence_deg = 75
min_illuminance = "25 lx"
gloss = "satin"

[[candidates]]
generator = "on_sphere"
count = 12
distances = [4.0]

[selection]
goal = "fewest_cameras"
coverage = 0.3
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    Path("plan.toml").write_text(PLAN)


def test_a_fringe_sensor_with_two_lamps_and_a_satin_part_from_place_to_check(capsys):
    out, _ = done(capsys, "place plan.toml -o out")
    assert "unlit" in out
    content = told()
    zones = content["dead_zones"]
    assert {"unlit", "too_dark", "highlight"} & {zone["reason"] for zone in zones}
    named = [zone for zone in zones if "device" in zone]
    assert {zone["device"] for zone in named} <= {"fringe/cam", "fringe/proj", "key", "ring"}
    assert all(zone in named or "+" in zone["reason"] for zone in zones)
    page = Path("out/page.html").read_text()
    assert all(f"({zone['device']})" in page for zone in zones[:5] if zone in named)
    light = content["network"]["light"]
    assert [each["lamp"] for each in light["lamps"]] == ["key", "ring"]
    assert light["out_of_limits"]["percent"] > 1
    assert "visible but badly lit: " in page
    done(
        capsys, "check plan.toml -p out/poses.json --min-coverage 0.3 --junit junit.xml -o checked"
    )
    suite = ET.parse("junit.xml").getroot()
    assert not suite.findall(".//failure")
    checked = rc.check("plan.toml", "out/poses.json")
    assert checked.whole.share == pytest.approx(content["share"], abs=1e-12)
    prepared, placed = rc.place("plan.toml").prepared, checked.cameras.placed
    poses = rc.Poses.of(placed.world_from_camera, camera=placed.camera)
    task = prepared.task
    assert (task.min_illuminance, task.max_highlight_deg) == (25, 12)
    exact = rc.unite(rc.regions(prepared.mesh, prepared.plan.rig, poses, task)).share()
    assert content["share"] == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("intensity_cd = 900", "intensity_cd = 0"),
            "lamps.key.intensity_cd: expected a number ab",
        ),
        (("intensity_cd = 900", "power_w_sr = 3"), "lx and W/m2 do not add up"),
        (("intensity_cd = 900\n", ""), "expected intensity (cd), power_w_sr (W/sr)"),
        (("half_angle_deg = 40\n", ""), "expected half_angle_deg for a lamp of kind spot"),
        (('rig = "fringe"', 'rig = "arm"'), "expected lamp 'ring' to be mounted on one of"),
        (('"25 lx"', '"3 W/m2"'), "expected min_illuminance in lx"),
        (('gloss = "satin"', 'gloss = "wet"'), "gloss"),
        (('"5 lx"', '"5 W/m2"'), "expected ambient in lx"),
        (("points = 4", "points = 40"), "points of a lamp of kind ring to be from 1 to 36"),
    ],
)
def test_wrong_lamps_of_a_plan_are_one_line(change, words, capsys):
    Path("plan.toml").write_text(PLAN.replace(*change))
    assert words in refusal(capsys, "place plan.toml -o out")
    assert not Path("out").exists()


def test_a_part_that_no_lamp_reaches_is_unlit():
    """Whatever cameras see of it: no other criterion is named where meeting it would not help."""
    away = PLAN.replace("aim = [0, 0, 0]", "aim = [0, -60, 0]").replace('rig = "fringe"\n', "", 1)
    away = away.replace("size = 0.3", "size = 0.3\nposition = [0, 0, 30]\naim = [0, 0, 60]")
    placement = rc.place(plan_of(tomllib.loads(away.replace('ambient = "5 lx"\n', ""))))
    (why,) = [each for each in placement.prepared.notes if each.startswith("no patch")]
    assert re.search("reasons of its area: 100.0 % unlit;", why)
    zones = placement.cameras.areas.zones(placement.prepared.plan.rig, placement.cameras.placed)
    assert {name_of(code) for code in zones.reason.tolist()} == {"unlit"}


@pytest.mark.parametrize(
    ("degrees", "words"),
    [(80.0, "no patch can be covered by any candidate; reasons .* 100.0 % in a specular highlight"),
     (31.0, "30.8 % of the area is covered by no candidate and does not count here. Not covered: "
      "204 cm² in a specular highlight")],
)  # fmt: skip
def test_a_page_says_why_candidates_reach_nothing_or_not_all(degrees, words):
    """A goal of_reachable was as if highlights took nothing, or had no candidate without a why."""
    around = 2 * np.concatenate([np.eye(3), -np.eye(3)])
    lamp = {"kind": "point", "intensity_cd": 100, "positions": around.tolist()}
    candidates = {"generator": "on_sphere", "count": 6, "distances": [0.5]}
    plan = {
        "meshes": [{"built_in": "box", "transform": {"scale": 0.1}}],
        "camera": {"width": 320, "height": 240, "fx": 300, "fy": 300},
        "task": {"max_highlight_deg": degrees},
        "candidates": [candidates],
        "selection": {"goal": "fewest_cameras", "coverage": 0.9, "of_reachable": True},
        "lamps": {"sky": lamp},
        "outputs": {"page": True},
    }
    rc.place(plan, out="out")
    page = Path("out/page.html").read_text("utf-8")
    assert re.search(words, page[: page.index("<figure>")], re.IGNORECASE)


def test_thresholds_of_light_without_lamps_are_refused():
    plan = {"meshes": [{"built_in": "box"}], "task": {"min_illuminance": 300}}
    with pytest.raises(
        PlanError, match="expected lamps for min_illuminance, got none; add them as"
    ):
        plan_of(plan)
    with pytest.raises(PlanError, match="expected lamps for ambient, got none; add them"):
        plan_of({"meshes": [{"built_in": "box"}], "ambient": 3})


EXPOSURE = """
[exposure]
exposure_time = 0.2
f_number = 4
pixel_size = 3.45e-6
quantum_efficiency = 0.65
full_well = 10500
min_snr = 40

[outputs]
page = false
"""


def test_signal_and_saturation_of_a_plan_are_a_band_of_illuminance(capsys):
    Path("plan.toml").write_text(PLAN + EXPOSURE)
    out, _ = done(capsys, "place plan.toml -o out")
    band = plan_of(tomllib.loads(PLAN + EXPOSURE)).build_task()
    assert 25 < band.min_illuminance < band.max_illuminance
    assert f"SNR 40 or more and saturation 1 or less is {band.min_illuminance:.3g} to " in out
    Path("plan.toml").write_text(PLAN + EXPOSURE.replace("40", "400"))
    assert "exposure: expected min_snr to be reached" in refusal(capsys, "place plan.toml -o other")


def test_a_lamp_rides_on_the_rig_that_it_names():
    mesh = rc.shapes.icosahedron()
    camera = rc.Camera(width=96, height=72, fx=90, fy=90)
    rig = rc.Rig([camera, camera], ["a", "b"])
    poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 4.0, 4), camera=[0, 1, 0, 1])
    lamps = rc.Lamps([rc.Lamp.spot(60, 10)], rides=["b"])
    areas = rc.regions(mesh, rig, poses, lamps=lamps).areas().sum(axis=1)
    whole = rc.regions(mesh, rig, poses).areas().sum(axis=1)
    assert areas == pytest.approx(whole * [0, 1, 0, 1])
    assert np.count_nonzero(areas) == 2
