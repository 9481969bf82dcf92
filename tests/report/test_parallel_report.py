"""The commands with a telecentric lens: a report with boxes, a picture, and what refuses it."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import done, enter, refusal

import rastercov as rc
from rastercov.report.pages import describe_camera
from rastercov.report.tables import camera_words, lens_text

LINES = """
model = "telecentric"
width = 320
height = 240
magnification = 0.02
pixel_size = 5e-6
working_distance = 0.3
depth_of_field = 0.2
"""
BENT = "distortion = [-3e3, 0, 0.1, 0.1]\nskew = -200.0\n"
"""Moves the corners, 1 mm from the middle of the sensor, by 0.3 %, and lines by a twentieth."""
each_lens = pytest.mark.parametrize("job", ["", BENT], indirect=True)


@pytest.fixture
def job(request, tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    (tmp_path / "lens.toml").write_text(LINES + getattr(request, "param", ""))
    rc.write_poses("poses.json", rc.look_at([(0.3, 0.05, 0.1), (0, 0.1, 0.3)], (0, 0, 0)))
    box = rc.shapes.box((0.03, 0.02, 0.01))
    lines = [f"v {x} {y} {z}" for x, y, z in box.vertices]
    lines += ["f " + " ".join(map(str, face)) for face in box.faces + 1]
    (tmp_path / "part.obj").write_text("\n".join([*lines, ""]))
    return "part.obj --unit m -c lens.toml -p poses.json"


def test_words_and_page_say_what_the_lens_is(job):
    lens = rc.Camera.load("lens.toml")
    assert lens_text(lens) == "0.02x"
    assert camera_words(lens) == "320 x 240 px, 0.02x, field of view 80 x 60 mm"
    assert lens_text(rc.Camera.orthographic(64, 48, px_per_m=1500)) == "1500 px/m"
    entries = describe_camera(lens)
    rays, starts = np.array(entries["border"]), np.array(entries["origins"])
    assert (rays == (0, 0, 1)).all()
    assert np.ptp(starts, axis=0) == pytest.approx((0.08, 0.06, 0))
    assert rc.Camera.from_dict(entries["plain"]) == lens
    assert describe_camera(rc.Camera.from_fov(64, 48, hfov_deg=40))["origins"] is None


@pytest.mark.slow
@each_lens
def test_evaluate_leaves_the_figures_of_python_and_pictures(job, capsys):
    done(capsys, f"evaluate {job} -o out")
    summary = json.loads(Path("out/summary.json").read_text())
    mesh, lens = rc.Mesh.load("part.obj", unit="m"), rc.Camera.load("lens.toml")
    result = rc.evaluate(mesh, lens, rc.read_poses("poses.json"))
    share = 100 * result.covered.share()
    assert summary["covered_area"]["percent"] == pytest.approx(share, abs=1e-6)
    assert 20 < share < 60
    page = Path("out/view.html").read_text()
    assert '"origins": [[' in page or '"origins":[[' in page
    done(capsys, f"render {job} -o picture")
    seen = np.load("picture/buffers.npz")
    assert (seen["face"] >= 0).any()


@pytest.mark.slow
def test_methods_are_compared_with_whole_numbers(job, capsys):
    done(capsys, f"compare {job} --against rational --no-convergence -o compare")
    content = json.loads(Path("compare/compare.json").read_text())
    assert (content["against"], content["passed"]) == ("rational", True)
    assert "telecentric" in refusal(capsys, f"compare {job} --models")


@pytest.mark.slow
@each_lens
def test_place_check_and_audit_take_it_from_a_plan_to_pages(job, capsys):
    camera = "\n" + Path("lens.toml").read_text()
    Path("plan.toml").write_text(
        f'[[meshes]]\npath = "part.obj"\nunit = "m"\n[camera]{camera}'
        '[task]\nmax_incidence_deg = 80\n[[candidates]]\ngenerator = "per_segment"\n'
        '[selection]\ngoal = "fewest_cameras"\ncoverage = 0.99\n'
    )
    done(capsys, "place plan.toml -o plan")
    plan = json.loads(Path("plan/plan.json").read_text())
    assert len(plan["cameras"]) == 6
    page = Path("plan/view.html").read_text()
    assert '"origins": [[' in page or '"origins":[[' in page
    done(capsys, "check plan.toml -p plan/poses.json --min-coverage 0.99 -o check")
    rig, poses = rc.Rig([rc.Camera.load("lens.toml")]), rc.read_poses("plan/poses.json")
    images = [f"image{row}" for row in range(6)]
    rc.write_views("cameras.glb", rc.Views(rig, rc.Poses.of(poses), images=images))
    assert "parallel rays" in refusal(
        capsys, 'check plan.toml -p plan/poses.json --min-coverage 0.9 --tolerance "1 mm"'
    )
    done(capsys, "audit cameras.glb part.obj --unit m --image-size 320x240 -o audit")
    assert json.loads(Path("audit/audit.json").read_text())["covered_percent"] == (
        pytest.approx(100)
    )
