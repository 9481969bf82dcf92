"""Dead zones in the answers of evaluate, place and check: JSON, and lines for people."""

import json
import re

import numpy as np
import pytest
from commands import call

import rastercov as rc

ZONE = {
    *("area_m2", "percent", "centroid", "extent", "groups", "m2_by_views", "reason", "hidden_by")
}
CAMERA = "width = 96\nheight = 72\nfx = 90\nfy = 90\n"
PLAN = f"""
[[meshes]]
built_in = "box"
[camera]
{CAMERA}
[task]
min_facing_density = "detect"
[[candidates]]
generator = "on_sphere"
count = 12
distances = [3.0]
[selection]
goal = "best_coverage"
cameras = 1
[outputs]
page = false
"""
LINE = re.compile(
    r"dead zone .* m² at \(-?[\d.]+, -?[\d.]+, -?[\d.]+\) in group mesh: seen from behind"
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "camera.toml").write_text(CAMERA)
    (tmp_path / "plan.toml").write_text(PLAN)
    rc.write_poses("rig.json", rc.look_at([(3, 0, 0), (0, 3, 0)], np.zeros(3)))


def assert_adds_up(found):
    zones, others = found["dead_zones"], found["other_dead_zones"]
    covered = found["covered_area"]
    assert zones
    assert all(set(zone) == ZONE for zone in zones)
    total = sum(zone["area_m2"] for zone in zones) + others["area_m2"]
    missing = covered["of_m2"] - covered["m2"]
    assert abs(total - missing) <= covered["bound_m2"] + 1e-12 * covered["of_m2"]


def test_evaluate_lists_dead_zones(capsys):
    line = "evaluate box -c camera.toml -p rig.json --pictures 0 -o out"
    code, out, _ = call(capsys, f"{line} --json")
    assert code == 0
    assert_adds_up(json.loads(out))
    _, out, _ = call(capsys, line)
    assert len(LINE.findall(out)) == 1
    _, out, _ = call(capsys, f"{line} --by face --json")
    assert "dead_zones" not in json.loads(out)


@pytest.mark.slow
def test_place_and_check_list_dead_zones(capsys):
    code, out, _ = call(capsys, "place plan.toml --json -o out")
    assert code == 0
    found = json.loads(out)
    assert found["plan"]["task"]["min_facing_density"] == 25
    assert_adds_up(found)
    assert "dead_zones" not in found["network"]
    _, out, _ = call(capsys, "place plan.toml -o out")
    assert LINE.search(out)
    code, out, _ = call(capsys, "check plan.toml -p rig.json --min-coverage 0.1 --json")
    assert code == 0
    assert_adds_up(json.loads(out))
    _, out, _ = call(capsys, "check plan.toml -p rig.json --min-coverage 0.1")
    assert len(LINE.findall(out)) == 1
