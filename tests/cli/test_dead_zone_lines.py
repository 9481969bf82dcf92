"""Dead zones in the answers of evaluate, place and check: JSON, and lines for people."""

import re

import numpy as np
import pytest
from commands import answer, call

import rastercov as rc

ZONE = "area_m2 percent centroid extent groups m2_by_views reason hidden_by nearest advice tried"
CAMERA = "width = 96\nheight = 72\nfx = 90\nfy = 90\n"
PLAN = f"""
meshes = [{{ built_in = "box" }}]
task = {{ min_facing_density = "detect" }}
candidates = [{{ generator = "on_sphere", count = 12, distances = [3.0] }}]
selection = {{ goal = "best_coverage", cameras = 1 }}
outputs = {{ page = false }}
[camera]
{CAMERA}
"""
LINE = re.compile(
    r"dead zone .* m² around \(-?[\d.]+, -?[\d.]+, -?[\d.]+\) m in group mesh: back-facing"
)


@pytest.fixture(autouse=True)
def files(here):
    (here / "camera.toml").write_text(CAMERA)
    (here / "plan.toml").write_text(PLAN)
    rc.write_poses("rig.json", rc.look_at([(3, 0, 0), (0, 3, 0)], np.zeros(3)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    ["evaluate box -c camera.toml -p rig.json --pictures 0 -o out", "place plan.toml -o out",
     "check plan.toml -p rig.json --min-coverage 0.1"],
)  # fmt: skip
def test_every_command_lists_dead_zones_that_add_up(capsys, line):
    result = answer(capsys, line)
    zones, others, covered = (
        result["dead_zones"],
        result["other_dead_zones"],
        result["covered_area"],
    )
    assert zones
    assert all(set(zone) == set(ZONE.split()) for zone in zones)
    total = sum(zone["area_m2"] for zone in zones) + others["area_m2"]
    missing = covered["of_m2"] - covered["m2"]
    assert abs(total - missing) <= covered["bound_m2"] + 1e-12 * covered["of_m2"]
    assert "dead_zones" not in result.get("network", {})
    assert LINE.search(call(capsys, line)[1])


def test_by_face_there_are_no_dead_zones(capsys):
    line = "evaluate box -c camera.toml -p rig.json --pictures 0 -o out --by face"
    assert "dead_zones" not in answer(capsys, line)
