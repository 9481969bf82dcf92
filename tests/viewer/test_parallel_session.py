"""The viewer with telecentric lenses: figures of the library, edits of the lens, added cameras."""

from contextlib import closing

import numpy as np
import pytest
from edited import Session, Work, changed
from rigs_to_view import acted, around, part

import rastercov as rc
from rastercov.core.coverage.task import Reason
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.reference import telecentric
from rastercov.report.pages import describe_camera

MESH = part()
LENS = {"magnification": 0.004, "pixel_size": 5e-6, "working_distance": 1.0, "f_number": 8}
CAMERA = rc.Camera.telecentric(640, 480, **LENS)
DEEP = rc.Camera.orthographic(640, 480, px_per_m=800)
POSES = around(MESH)


def state_with(camera, poses=POSES, task=None):
    return RigState.of(rc.Rig([camera], ["lens"]), rc.Poses.of(poses), task=task)


def test_angles_between_views_are_those_of_axes():
    state = state_with(DEEP)
    session = Session(Scene("part", MESH, state))
    with closing(session):
        head, levels = acted(session, "angle")
        covers = rc.evaluate(MESH, DEEP, POSES, by="face").reason == Reason.COVERED
        axes = POSES[:, :3, 2]
        both = covers[:, None] & covers
        cosines = np.where(both, (axes @ axes.T)[..., None], 1.0)
        widest = np.degrees(np.arccos(np.clip(cosines, -1, 1 - 1e-15).min(axis=(0, 1))))
        widest[covers.sum(axis=0) < 2] = 0
        assert head["scale"]["high"] == pytest.approx(widest.max())
        steps = np.where(widest > 0, 2 + np.rint(widest / widest.max() * 253), 0)
        assert np.abs(steps - levels).max() <= 1
        share = rc.evaluate(MESH, DEEP, POSES).covered.share()
        head, _ = acted(session, "area")
        assert head["summary"]["covered_area"]["percent"] == pytest.approx(100 * share)


def test_the_lens_of_a_telecentric_camera_is_edited_by_its_own_values():
    shown = describe_camera(CAMERA)
    assert (shown["fx"], shown["hfov_deg"], shown["can_focus"]) == (None, None, True)
    assert shown["magnification"] == pytest.approx(0.004)
    assert describe_camera(DEEP)["px_per_m"] == 800
    made = changed(CAMERA, {"magnification": 0.008, "focus_distance": 0.5, "f_number": 4})
    assert made == rc.Camera.telecentric(
        640, 480, **LENS | {"magnification": 0.008, "working_distance": 0.5, "f_number": 4}
    )
    sheet = rc.Camera.telecentric(640, 480, depth_of_field=0.2, **LENS | {"f_number": None})
    assert changed(sheet, {"focus_distance": 2.0}).depth_of_field() == pytest.approx((1.9, 2.1))
    assert changed(sheet, {"f_number": 8}) == CAMERA
    assert changed(CAMERA, {"focus_near": 0.9, "focus_far": 1.3}).depth_of_field() == (0.9, 1.3)
    assert changed(DEEP, {"px_per_m": 400}).fx == 400
    skewed = rc.Camera.telecentric(640, 480, **LENS, skew=80.0, distortion=(-60.0,))
    assert changed(skewed, {"magnification": 0.008}) == rc.Camera.telecentric(
        640, 480, **LENS | {"magnification": 0.008}, skew=160.0, distortion=(-60.0,)
    )
    with pytest.raises(rc.CameraError, match="expected a telecentric lens for magnification"):
        changed(rc.Camera.from_fov(64, 48, hfov_deg=40), {"magnification": 0.1})


def test_the_box_of_a_distorted_lens_ends_where_its_image_does():
    lens = {"magnification": 0.25, "pixel_size": 3.45e-6, "distortion": (-200.0,)}
    camera = rc.Camera.telecentric(4096, 3000, **lens)
    shown = describe_camera(camera)
    origins, border = np.array(shown["origins"]), np.array(shown["border"])
    assert shown["model"] == "telecentric"
    assert np.allclose(border, (0, 0, 1))
    u, v = telecentric.image_of(camera, *origins[:, :2].T)
    on_sides = [np.abs(each) < 1e-9 for each in (u, v, u - 4096, v - 3000)]
    assert np.logical_or.reduce(on_sides).all()
    assert all(each.sum() >= 2 for each in on_sides)
    assert rc.Camera.from_dict(shown["plain"]) == camera


def test_a_camera_that_is_added_is_in_focus():
    camera = changed(CAMERA, {"focus_near": 0.8, "focus_far": 1.2})
    state = state_with(camera, POSES[:1])
    with closing(Session(Scene("part", MESH, state))) as session:
        acted(session)
        work = Work(session)
        work.start({"kind": "add", "camera": "lens"})
        assert work.describe()["status"] == "done", work.describe()
        after = rc.evaluate(MESH, camera, session.state.poses()).covered.area[0].sum()
    before = rc.evaluate(MESH, camera, POSES[:1]).covered.area[0].sum()
    assert after > 1.2 * before
