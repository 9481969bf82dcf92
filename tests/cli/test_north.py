"""North and place of an IFC file in `sun` and `sheet`: as if given, and a contradiction refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from bungalow import bungalow, on_earth
from commands import call, done, enter, refusal

import rastercov as rc

pytestmark = pytest.mark.slow
HOUSE = bungalow()
PLACE = ((49, 6, 0), (8, 26, 24))
NORTH = (1.0, 0.4)
ANGLE = float(np.degrees(np.arctan2(NORTH[1], NORTH[0])))


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    known = on_earth(HOUSE, north=NORTH, place=PLACE).to_string().encode()
    for name, data in {"house": HOUSE, "known": known}.items():
        Path(f"{name}.ifc").write_bytes(data)


def test_the_sun_takes_north_and_place_of_the_file(capsys):
    day = "--day 2026-03-21 --step 60 --json"
    _, err = done(capsys, f"sun known.ifc {day} -o a")
    words = f"north at {ANGLE:.6g} degrees from +x by TrueNorth; latitude 49.1, longitude 8.44 by"
    assert err.count(words) == 1
    given = f"--latitude 49.1 --longitude 8.44 --north {ANGLE!r}"
    done(capsys, f"sun house.ifc {day} {given} -o b")
    one, other = (json.loads(Path(f"{name}/sun.json").read_text()) for name in "ab")
    assert one["parts"] == other["parts"]
    assert one["run"]["options"]["north"] == pytest.approx(ANGLE)
    line = refusal(capsys, f"sun known.ifc --day 2026-03-21 --north {ANGLE + 2} -o c")
    assert f"--north: expected north at {ANGLE:.6g} degrees from +x, as in the mesh file" in line
    done(capsys, f"sun known.ifc {day} --north {ANGLE + 0.5 - 360} --latitude -49 -o d")
    turned = json.loads(Path("d/sun.json").read_text())
    assert turned["run"]["options"]["latitude"] == -49
    assert turned["parts"] != one["parts"]
    line = refusal(capsys, "sun house.ifc --day 2026-03-21 --latitude 3 -o c")
    assert "expected --latitude and --longitude, got one or none" in line
    assert not Path("c").exists()


def test_a_sheet_takes_north_of_the_file(capsys):
    rc.write_poses("rig.json", rc.look_at([(1.0, 1.0, 2.5)], [(4.0, 3.0, 1.0)]))
    texts = {}
    for name, option in {"known": "", "house": f"--north {ANGLE!r}"}.items():
        done(
            capsys, f"sheet {name}.ifc -c khepra -p rig.json --project P {option} --out {name}.svg"
        )
        texts[name] = Path(f"{name}.svg").read_text().replace("known.ifc", "house.ifc")
    assert texts["known"] == texts["house"]
    assert re.search(">N</text>", texts["known"])
    line = "sheet known.ifc -c khepra -p rig.json --north 90 --out c.svg"
    code, _, err = call(capsys, line)
    assert (code, Path("c.svg").exists()) == (2, False)
    assert f"north of the sheet: expected north at {ANGLE:.6g} degrees" in err
