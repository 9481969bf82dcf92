"""Plans in the light of the sun: cameras and lamps that it helps, checks, and what is refused."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from bungalow import bungalow, on_earth
from commands import done, enter

import rastercov as rc
from rastercov.base.errors import RastercovError
from rastercov.placement.plan.file import plan_of
from rastercov.placement.plan.scene import name_scene

TEXT = """
[[meshes]]
built_in = "icosahedron"
[camera]
width = 96
height = 72
fx = 90.0
fy = 90.0
[lamps.sun]
kind = "sun"
illuminance_lx = 80e3
latitude = 48.0
longitude = 11.5
time = 2026-06-21T11:00:00Z
[task]
max_incidence_deg = 75.0
min_illuminance = "20000 lx"
[[candidates]]
generator = "on_sphere"
count = 12
distances = [4.0]
[selection]
goal = "best_coverage"
cameras = 2
[outputs]
page = false
"""
PLAN = tomllib.loads(TEXT)
CAMERA, SUN, SPHERE = PLAN["camera"], PLAN["lamps"]["sun"], PLAN["candidates"][0]
LAMPS = rc.Lamps(
    [rc.Lamp.sun(illuminance=80e3)],
    rc.look_at(rc.sun_directions(48.0, 11.5, ["2026-06-21T13:00+02:00"]), (0, 0, 0)),
    ["sun"],
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)


def test_cameras_are_placed_and_checked_in_the_sun(capsys):
    Path("plan.toml").write_text(TEXT)
    placed = rc.place("plan.toml", out="out")
    mesh, task = placed.prepared.mesh, placed.prepared.task
    regions = rc.regions(mesh, rc.Camera(**CAMERA), placed.cameras.placed, task, lamps=LAMPS)
    assert placed.cameras.share == pytest.approx(rc.unite(regions).share(), abs=1e-12)
    dark = rc.regions(
        mesh, rc.Camera(**CAMERA), placed.cameras.placed, rc.Task(max_incidence_deg=75)
    )
    assert 0.1 < placed.cameras.share < rc.unite(dark).share() - 0.01
    checked = rc.check("plan.toml", "out/poses.json", min_coverage=0.1)
    assert checked.whole.share == pytest.approx(placed.cameras.share, abs=1e-12)
    line = "evaluate icosahedron -p out/poses.json --max-incidence-deg 75 --min-illuminance 20000"
    Path("sun.toml").write_text(TEXT[TEXT.index("[lamps") : TEXT.index("[task]")])
    done(capsys, f"{line} --lamps sun.toml -o lit --pictures 0")
    summary = json.loads(Path("lit/summary.json").read_text())
    assert summary["covered_area"]["percent"] == pytest.approx(100 * placed.cameras.share, abs=1e-9)
    done(capsys, "sheet plan.toml -p out/poses.json -o sheet.svg")
    sheet = Path("sheet.svg").read_text()
    assert sheet.count(">sun<") == 1  # in the table, with its direction; it has no place
    assert ">65.2°<" in sheet


@pytest.mark.slow
def test_a_sun_shines_as_at_the_place_of_the_building(capsys):
    """In a plan, whenever its rig is built, in `evaluate`, and in a file of lamps."""
    place = {"place": ((48, 0, 0), (11, 30, 0)), "north": (-0.6, 0.8)}
    Path("house.ifc").write_bytes(on_earth(bungalow(), **place).to_string().encode())
    mesh = rc.Mesh.load("house.ifc")
    north = np.degrees(np.arctan2(0.8, -0.6))
    entries = {name: value for name, value in SUN.items() if name not in ("latitude", "longitude")}
    entries |= {"time": entries["time"].isoformat()}
    for own in (entries, {**entries, "north_deg": north}, {**SUN, **entries}):
        wanted = rc.sun_directions(48.0, 11.5, [entries["time"]], north)[0]
        plan = plan_of(PLAN | {"meshes": [{"path": "house.ifc"}], "lamps": {"sun": own}})
        early = plan.rig.equipment["lamps"]
        lines = [
            "[lamps.sun]",
            *(f"{name} = {json.dumps(value, default=float)}" for name, value in own.items()),
        ]
        Path("sun.toml").write_text("\n".join(lines))
        result = rc.evaluate(
            mesh,
            rc.Camera(width=9, height=9, fx=9, fy=9),
            rc.look_at((5.0, 3, 9), (5.0, 3.1, 0)),
            rc.Task(min_illuminance=10),
            lamps="sun.toml",
        )
        rigs = (name_scene(plan)[1].rig, result.camera)
        for lamps in (rc.load_lamps("sun.toml", mesh.site), *(r.equipment["lamps"] for r in rigs)):
            np.testing.assert_allclose(-lamps.places[0, :3, 2], wanted, atol=1e-12)
        assert len(early) == 1
    for own in ({**entries, "north_deg": 90.0}, {**SUN, "north_deg": north + 1.5}):
        plan = plan_of(PLAN | {"meshes": [{"path": "house.ifc"}], "lamps": {"sun": own}})
        with pytest.raises(RastercovError, match=r"north_deg: expected north at 126\.87 degrees"):
            _ = name_scene(plan)[1].rig
    plan = plan_of(PLAN | {"lamps": {"sun": entries}})
    with pytest.raises(RastercovError, match="of a sun, got time; give"):
        _ = name_scene(plan)[1].rig


def test_lamps_are_chosen_that_add_to_the_sun():
    fill = {"kind": "spot", "intensity_cd": 9e5, "half_angle_deg": 40.0}
    eyes = rc.look_at([(0, -4, 1.5), (3.5, 0, 2)], (0, 0, 0))
    Path("eyes.json").write_text(json.dumps({"world_from_camera": np.asarray(eyes).tolist()}))
    own = {"lamps": {"sun": SUN, "fill": fill}, "existing": "eyes.json"}
    own |= {"candidates": [SPHERE | {"count": 4, "lamp": "fill"}]}
    own |= {"selection": {"goal": "best_coverage", "lamps": 1}}
    placed = rc.place(PLAN | own)
    lamps = placed.choices["lamps"].lamps
    assert (lamps.names[0], len(lamps), lamps.lamps[0]) == ("sun", 2, LAMPS.lamps[0])
    regions = rc.regions(
        placed.prepared.mesh, rc.Camera(**CAMERA), eyes, placed.prepared.task, lamps=lamps
    )
    assert placed.cameras.share == pytest.approx(rc.unite(regions).share(), abs=1e-9)
    alone = rc.regions(
        placed.prepared.mesh, rc.Camera(**CAMERA), eyes, placed.prepared.task, lamps=LAMPS
    )
    assert placed.cameras.share > rc.unite(alone).share() + 0.01


@pytest.mark.parametrize(
    ("lamp", "words"),
    [
        ({**SUN, "position": [0.0, 0.0, 1.0]}, "expected entries of a sun"),
        ({**SUN, "time": "2026-06-21T11:00"}, "expected time with a zone"),
        ({**SUN, "time": "2026-12-21T23:00Z"}, "expected a sun above the horizon"),
        ({**SUN, "azimuth_deg": 3.0}, "expected azimuth_deg and elevation_deg, or latitude"),
        ({"kind": "sun", "illuminance_lx": 8e4}, "of a sun, got none; give one"),
        ({**SUN, "rig": True}, "expected entries of a sun"),
        ({"kind": "point", "intensity_cd": 5.0, "latitude": 4.0}, "expected entries of a lamp"),
    ],
)
def test_wrong_entries_of_a_sun_are_refused_in_one_line(lamp, words):
    with pytest.raises(RastercovError, match=words) as caught:
        plan_of(PLAN | {"lamps": {"sun": lamp}})
    assert "\n" not in str(caught.value)
    assert str(caught.value).count("lamps.sun: ") == 1


def test_a_sun_is_not_chosen_among_candidates():
    candidates = [SPHERE, SPHERE | {"lamp": "sun"}]
    with pytest.raises(RastercovError, match="expected a lamp with a position, got a sun"):
        plan_of(PLAN | {"candidates": candidates})


@pytest.mark.parametrize(("distance", "is_near"), [(3.0, True), (3000.0, False)])
def test_lamps_are_chosen_beside_the_sun_over_time(distance, is_near):
    fill = {"kind": "spot", "intensity_cd": 9e5, "half_angle_deg": 40.0}
    belt = {
        "conveyor": {"body": "part", "steps": 2, "direction": [1.0, 0, 0], "distance": distance}
    }
    eyes = rc.look_at([(0, -4, 1.5)], (0, 0, 0))
    Path("eyes.json").write_text(json.dumps({"world_from_camera": np.asarray(eyes).tolist()}))
    own = {"lamps": {"sun": SUN, "fill": fill}, "existing": "eyes.json", "motion": belt}
    own |= {"bodies": [{"name": "part", "groups": ["mesh"]}]}
    own |= {"task": PLAN["task"] | {"over": 0.4}}
    own |= {"candidates": [SPHERE | {"count": 2, "lamp": "fill"}]}
    own |= {"selection": {"goal": "best_coverage", "lamps": 1}}
    if is_near:
        assert rc.place(PLAN | own).cameras.share > 0.01
    else:
        with pytest.raises(RastercovError, match="expected bodies within"):
            rc.place(PLAN | own)
