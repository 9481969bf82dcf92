"""Plans by samples: the same choice on any device, and the certified area of what is chosen."""

from pathlib import Path

import numpy as np
import pytest
from gl_device import DEVICE
from plans import placed, told, write_obj

import rastercov as rc
from rastercov.core.coverage import network
from rastercov.gl import GLRasterizer

CAMERA = {"width": 64, "height": 48, "hfov_deg": 50}
PLAN = {
    "meshes": [{"path": "part.obj", "unit": "m"}],
    "camera": CAMERA,
    "task": {"method": "sampled", "max_incidence_deg": 65},
    "candidates": [{"generator": "on_sphere", "count": 60, "stand_off": [2, 4]}],
    "selection": {"goal": "best_coverage", "cameras": 3},
}


@pytest.fixture(autouse=True)
def part(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_obj("part.obj", rc.shapes.torus(14, 9))


def certified(task):
    mesh = rc.Mesh.load("part.obj", unit="m")
    camera = rc.Camera.from_fov(64, 48, hfov_deg=50)
    poses = np.array(told("poses.json")["world_from_camera"])
    return rc.evaluate(mesh, camera, poses, task).covered.share()


def test_both_figures_are_in_the_plan_the_page_and_the_lines():
    from rastercov.report.plan import lines

    asked = PLAN["selection"] | {"refine": True, "refine_budget": 20}
    placement = placed(PLAN, selection=asked)
    result = told()
    share = certified(rc.Task(max_incidence_deg=65))
    assert result["certified_area"]["percent"] == pytest.approx(100 * share, rel=1e-9)
    assert result["share"] == placement.cameras.share != share
    (line,) = (each for each in lines(placement) if "certified:" in each)
    assert line.startswith("sampled: ")
    assert line in Path("out", "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("task", [{"method": "certified"}, {"method": "sampled", "min_pixels": 2}])
def test_no_area_is_certified_where_it_is_known_or_means_nothing(task):
    assert placed(PLAN, task=task).certified is None
    assert "certified_area" not in told()


@pytest.mark.matter("opengl")
def test_a_gpu_judges_the_candidates_of_a_plan_to_the_same_choice(monkeypatch, caplog):
    placed(PLAN)
    host = told()
    monkeypatch.setattr(GLRasterizer, "_choose_plan", lambda self, plan: "compute")
    hooks = type("Hooks", (), {"find_gpu": lambda self: DEVICE})()
    monkeypatch.setattr(network, "drawer", lambda: hooks)
    monkeypatch.setattr(network, "LEAST_PAIRS", 1)
    placed(PLAN)
    device = told()
    assert f"device auto is {DEVICE}, for 60 poses" in caplog.messages
    backends = [each["made_from"]["measured_by"]["backend"] for each in (host, device)]
    assert backends == ["cpu", "gl"]
    for name in ("share", "certified_area", "requirements", "cameras"):
        assert device[name] == host[name], name
    for name in ("chosen", "bound", "share", "curve", "status"):
        assert device["selection"][name] == host["selection"][name], name
