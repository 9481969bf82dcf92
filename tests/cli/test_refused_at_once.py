"""Wrong calls of all commands are refused before the engine works: here it raises if it is used."""

from pathlib import Path

import pytest
from commands import call, content, refusal, write_part

from rastercov import engine as loops
from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.viewpoints import sphere_of_poses

WORK = {
    "area_cell": ["fill_cells", "find_shares"],
    "coverage_figures": ["judge_poses"],
    "coverage_pairs": ["list_pairs"],
    "solver_contacts": ["find_partners"],
    "solver_raster": ["Rasterizer", "Scene"],
    "solver_tolerance": ["find", "sweep"],
    "solver_union": ["Union"],
    "solver_visibility": ["Pass"],
    "mesh_clearance": ["distances"],
    "mesh_tree": ["behind", "first_hits", "nearest", "winding"],
    "placement_segments": ["grow_segments"],
}
"""Compiled functions and classes that measure."""
SCENE = '[[meshes]]\npath = "part.obj"\n[camera]\nwidth = 64\nheight = 48\nfx = 60\n'
SPHERE = '[[candidates]]\ngenerator = "on_sphere"\ncount = 8\n'
FEWEST = '[selection]\ngoal = "fewest_cameras"\ncoverage = 0.5\n'
FACES = '[task]\nby = "face"\n'
PLANS = {
    "plan": FEWEST,
    "faces": FEWEST + FACES,
    "views": SPHERE + FEWEST + "[task]\nviews = 11000\n",
    "samples": SPHERE + FEWEST + '[task]\nby = "area"\nmethod = "sampled"\n',
    "visible": SPHERE + FEWEST + '[task]\nby = "area"\nmin_visibility = 0.4\n',
    "no_poses": SPHERE + '[[candidates]]\ngenerator = "poses"\nfile = "part.obj"\n' + FEWEST,
    "proof": SPHERE + FEWEST + "[selection.tolerance]\nangle_deg = 100\nproof = true\n",
    "group": SPHERE + FEWEST + "groups = { top = 0.4 }\n",
    "goal": SPHERE + FEWEST + '[goals.x]\ngroups = ["lid", "rest"]\ncoverage = 0.4\n',
    "moved": SPHERE + FEWEST + '[existing]\nfile = "rig.json"\nmove = [7]\n',
    "sound": SPHERE + FEWEST,
}
EVALUATE = "evaluate part.obj -c camera.toml -p rig.json"
AUDIT = "audit base/rig.json part.obj"
CHECK = "check plan.toml -p rig.json"
SUN = "sun part.obj --latitude 49 --longitude 8 --day 2026-03-21"
SHEET = "sheet part.obj -c camera.toml -p rig.json"
VIEW = "view part.obj -c camera.toml -p rig.json"
COMPARE = "compare part.obj -c camera.toml -p rig.json"
RENDER = "render part.obj -c camera.toml -p rig.json"
LINES = {
    EVALUATE: ["--out mine", "--before rig.json --out mine", "--before no.json", "--views 11000",
               "--before rig.json --by face", "--before rig.json --min-visibility 0.4",
               "--before rig.json --table groups --method sampled", "--by area --method sampled",
               "--by area --min-visibility 0.4", "--method sampled --supersample 99",
               "--device none", "--min-illuminance 3", "--pictures 0 --pdf", "--sheet no.toml"],
    AUDIT: ["--out mine", "--footprints no/x.kml", "--overlap-map x.foo", "--method none",
            "--footprints x.dxf --surface top", "--footprints x.dxf --min-visibility 0.4",
            "--footprints x.dxf --method sampled", "--footprints x.dxf --map-cell -1",
            "--surface lid", "--by none", "--resolution-of-result 0", "--views 11000"],
    CHECK: ["--out mine", "--out part.obj", "--pdf", "--baseline no.json", "--views 99999",
            "--baseline base/check.json --views 2", "--baseline base/check.json --allow-worse x",
            "--junit no/x.xml", "--summary rig.json", "--group top=0.4", "--tolerance 3"],
    "check faces.toml -p rig.json": ["--baseline base/check.json", "--tolerance '2 mm'",
                                     "--baseline faces.json --allow-worse 3cm2"],
    SUN: ["--out mine", "--penumbra --out part.obj", "--of top", "--irradiance -1", "--step 7",
          "--resolution 0", "--min-elevation 100", "--at-least 0"],
    SHEET: ["--out no/x.svg", "--out x.png", "--scale 1:0", "--max-uncertainty 0.1"],
    VIEW: ["--export no/x.html", "--export x.png", "--still", "--method none --export x.html"],
    COMPARE: ["--out mine", "--method sampled:none", "--models --against up"],
    RENDER: ["--out mine", "--pose 7", "--device none"],
    "demo": ["--out mine", "--device none"],
    **{f"place {name}.toml": [f"--out {name}"] for name in PLANS if name != "sound"},
    "place sound.toml": ["--out mine", "--out part.obj", "--workers none"],
}  # fmt: skip


@pytest.fixture
def files(here, capsys):
    """Input files, a folder of results, and one with files of somebody else."""
    write_part("part.obj")
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 4, 3))
    Path("camera.toml").write_text(SCENE.partition("[camera]\n")[2])
    for name, text in PLANS.items():
        Path(f"{name}.toml").write_text(SCENE + text)
    assert call(capsys, f"{CHECK} --out base")[0] == 0
    assert call(capsys, "check faces.toml -p rig.json --out faces")[0] == 0
    Path("faces/check.json").rename("faces.json")
    write_poses("base/rig.json", sphere_of_poses((0, 0, 0), 4, 3))
    assert call(capsys, "evaluate part.obj -c camera.toml -p rig.json --pictures 0")[0] == 0
    Path("report/rig.json").replace("base/rig.json")
    Path("mine").mkdir()
    for kind in ("report", "audit", "check", "sun", "page", "compare"):
        Path(f"mine/{kind}.html").write_text("mine")
    Path("mine/picture.png").write_text("mine")


@pytest.fixture
def engine(monkeypatch):
    """Calls of the engine, which are errors here."""
    used = []

    def raising(name):
        def work(*arguments, **options):
            used.append(name)
            raise AssertionError(name)

        return work

    for topic, names in WORK.items():
        for name in names:
            monkeypatch.setattr(loops.TOPICS[topic], name, raising(f"{topic}.{name}"))
    return used


def test_a_wrong_call_is_refused_without_the_engine(files, engine, capsys):
    before = content(".")
    for command, options in LINES.items():
        for each in options:
            line = refusal(capsys, f"{command} {each}")
            assert "a defect of rastercov" not in line, (command, each)
            assert engine == [], (command, each)
    assert content(".") == before
    assert call(capsys, EVALUATE)[0] == 2
    assert engine != []
