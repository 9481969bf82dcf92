"""Plans with lamps and bodies that move."""

import json
from pathlib import Path

import pytest
from commands import done
from test_motion_plan import PLAN, TOML, cell, changed, evaluated  # noqa: F401 # for every test
from timed import evaluate_over_time

import rastercov as rc
from rastercov.motion.plan_over_time import PlanMotion
from rastercov.placement.plan.file import plan_of
from rastercov.placement.plan.scene import name_scene

LAMPS = {"lamps": {"key": {"kind": "spot", "intensity_cd": 900.0, "half_angle_deg": 40.0,
                           "position": [0.0, -1.5, 3.0], "aim": [0.0, 0.0, 0.0]}}}  # fmt: skip


def test_cameras_are_chosen_for_what_is_lit_while_they_see_it():
    placement, dark = rc.place(changed(**LAMPS)), rc.place(PLAN)
    assert placement.cameras.share < dark.cameras.share - 0.05
    mesh, plan, _ = name_scene(plan_of(changed(**LAMPS)))
    lamps = rc.Lamps(
        [rc.Lamp.spot(40, intensity=900)], rc.look_at((0, -1.5, 3), (0, 0, 0), up=(0, -1, 0))
    )
    exact_share = evaluate_over_time(
        PlanMotion.of(plan, mesh).motion, plan_of(PLAN).rig, placement.cameras.placed,
        plan.build_task(), 0.9,
        lamps=lamps,
    ).share()  # fmt: skip
    assert placement.cameras.share == pytest.approx(exact_share, abs=1e-6)


@pytest.mark.slow
def test_the_command_evaluates_light_over_time(capsys):
    Path("m.toml").write_text(TOML)
    Path("lamps.toml").write_text(
        '[lamps.key]\nkind = "spot"\nintensity_cd = 900\nhalf_angle_deg = 40\n'
        "position = [0, -1.5, 3]\naim = [0, 0, 0]\n"
    )
    shares = []
    for more in (
        ("--pictures", "0"),
        ("--lamps", "lamps.toml", "--pictures", "0"),
        ("--lamps", "lamps.toml", "--min-illuminance", "60"),
    ):
        done(capsys, evaluated("m.toml", *more))
        summary = json.loads(Path("report/summary.json").read_text())
        assert "light" not in summary  # that of the rest pose
        shares.append(summary["over_time"]["covered"]["percent"])
    assert shares[0] > shares[1] > shares[2] > 0
