"""Lamps on plan sheets."""

from pathlib import Path

import ezdxf
import numpy as np
from commands import call
from ezdxf import bbox

import rastercov as rc

EYES = ((-2.9, -2.4, 2.5), (2.9, 2.4, 2.5), (2.9, -2.4, 2.5))


def test_lamps_are_drawn_and_listed(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("lamps.toml").write_text(LAMPS)
    rc.write_poses("rig.json", np.concatenate([rc.look_at(eye, (0, 0, 0.8)) for eye in EYES]))
    line = "sheet room -c khepra -p rig.json --lamps lamps.toml --min-illuminance 8 --out plan.dxf"
    code, _, err = call(capsys, line)
    assert code == 0, err
    space = ezdxf.readfile("plan.dxf").modelspace()
    texts = {text.dxf.text for text in space.query("TEXT")}
    assert {"key", "32 cd, reaches 2 m", "far", "lamp on 3 cameras, 8 cd, reaches 1 m"} <= texts
    lamps = space.query("LWPOLYLINE[layer=='LAMPS']")
    circles = [bbox.extents([each]).center for each in lamps if each.closed]
    at = sorted((round(each.x, 4), round(each.y, 4)) for each in circles)
    # The lamp beyond the drawing is only listed.
    assert at == sorted([(0.5, -0.5), *((x, y) for x, y, _ in EYES)])


LAMPS = """
[lamps.key]
kind = "spot"
intensity_cd = 32
half_angle_deg = 45
position = [0.5, -0.5, 2.6]

[lamps.own]
kind = "spot"
intensity_cd = 8
half_angle_deg = 50
rig = true

[lamps.far]
kind = "point"
intensity_cd = 50
position = [70.0, 0.5, 2.6]
"""
