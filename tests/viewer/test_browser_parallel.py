"""The page with a telecentric lens: a box, and the view along its parallel rays."""

import numpy as np
import pytest
from browser import Program, Tab
from edited import Session
from rigs_to_view import around, part

import rastercov as rc
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.report.coverage import Options, run
from rastercov.report.pages import describe_camera

pytestmark = pytest.mark.slow


def test_looking_through_a_telecentric_lens_shows_its_image_along_parallel_rays(context, tmp_path):
    mesh = rc.shapes.box((0.03, 0.02, 0.01))
    lens = rc.Camera.telecentric(
        320, 240, magnification=0.02, pixel_size=5e-6, working_distance=0.3, depth_of_field=0.2
    )
    poses = rc.look_at([(0.3, 0.05, 0.1), (0, 0.1, 0.3)], (0, 0, 0))
    run(mesh, lens, rc.Poses.of(poses), rc.Task(), tmp_path, Options(pictures=1))
    tab = Tab(context, (tmp_path / "view.html").as_uri())
    tab.page.evaluate("document.querySelector('button.name').click()")
    tab.keys("l")
    assert tab.js("rastercov.view.look().isParallel")
    size = np.array([tab.js(f"rastercov.view.canvas.client{side}") for side in ("Width", "Height")])
    pixels = np.array([(160, 120), (0, 0), (320, 0), (320, 240), (0, 240), (80, 30)], float)
    places = (pixels - (lens.cx, lens.cy)) / lens.fx
    seen = []
    for depth in (0.1, 0.3, 0.5):
        world = np.insert(places, 2, depth, axis=1) @ poses[0, :3, :3].T + poses[0, :3, 3]
        value = tab.js("all => all.map(each => rastercov.screenOf(each))", world.tolist())
        seen.append(np.array(value)[:, :2])
    assert np.abs(np.ptp(seen, axis=0)).max() < 0.01  # pixels of the screen, at any depth
    scale = np.ptp(seen[0][:, 0]) / 320
    np.testing.assert_allclose(seen[0], size / 2 + scale * (pixels - (160, 120)), atol=0.02)
    assert ((seen[0] >= 0) & (seen[0] <= size)).all()
    assert (np.ptp(seen[0], axis=0) > 0.9 * size).any()
    ends = tab.js(
        "rastercov.session.state.cameras[Object.keys(rastercov.session.state.cameras)[0]]"
    )
    assert np.ptp(ends["origins"], axis=0) == pytest.approx((0.08, 0.06, 0))
    assert tab.faults == []


@pytest.mark.every_day
def test_the_panel_of_a_telecentric_camera_has_its_magnification(context):
    lens = rc.Camera.telecentric(
        640, 480, magnification=0.004, pixel_size=5e-6, working_distance=1.0, f_number=8
    )
    state = RigState.of(rc.Rig([lens], ["lens"]), rc.Poses.of(around(part())))
    program = Program(Session(Scene("part", part(), state)))
    program.start()
    tab = Tab(context, program.url)
    tab.page.evaluate("document.querySelector('button.name').click()")
    tab.open("Cameras")
    text = tab.js("document.body.innerText")
    assert "Magnification" in text
    assert "Field of view" not in text
    blur = tab.js(
        "async ([camera, eye, depths]) => { const { blurAt } = await import('rastercov/frusta.js');"
        " return depths.map((depth) => blurAt(camera, eye, [0.1, 0.2, depth])); }",
        [describe_camera(lens), np.eye(4).ravel().tolist(), [*lens.depth_of_field(3.0), 1.0]],
    )
    np.testing.assert_allclose(blur, (3, 3, 0), atol=1e-9)
    program.stop()
    program.session.close()
    assert tab.faults == []
