"""Plans with telecentric cameras: what is placed holds in a check, and what is out of reach."""

import pytest
from nightly import nightly

import rastercov as rc
from rastercov.placement.required import HOLDS
from rastercov.report.plan import summary

LENS = {"width": 640, "height": 480, "magnification": 0.004, "pixel_size": 5e-6}
CAMERA = LENS | {"model": "telecentric", "working_distance": 4.0, "depth_of_field": 2.0}
PLAN = {
    "meshes": [{"built_in": "torus"}],
    "camera": CAMERA,
    "task": {"max_incidence_deg": 75},
    "candidates": [
        {"generator": "on_sphere", "count": 14},
        {"generator": "per_segment", "alpha_deg": 40, "beta_deg": 60},
    ],
    "selection": {"goal": "fewest_cameras", "of_reachable": True, "method": "greedy"}
    | {"coverage": 0.9, "refine": True, "refine_budget": 20},
}
BY_FACE = PLAN["task"] | {"by": "face", "min_pixels": 0.5}
TWO = {"views": 2, "min_angle_deg": 10}


@pytest.mark.parametrize(
    "task",
    [
        PLAN["task"],
        pytest.param(BY_FACE, marks=(pytest.mark.slow, nightly)),
        pytest.param(BY_FACE | TWO, marks=pytest.mark.slow),
    ],
    ids=["area", "face", "angle"],
)
def test_what_is_placed_with_a_telecentric_lens_holds_in_a_check(task):
    plan = PLAN | {"task": task}
    placement = rc.place(plan)
    assert placement.is_met
    (share,) = (each.share for each in rc.check(plan, placement.cameras.poses).requirements)
    assert share > 0.5
    checked = rc.check(plan, placement.cameras.poses, min_coverage=share - 0.02)
    assert {each.status for each in checked.requirements} == {HOLDS}
    assert not rc.check(plan, placement.cameras.poses, min_coverage=min(1, share + 0.02)).is_met
    if "by" not in task:
        lens, mesh = rc.Camera.from_dict(CAMERA), rc.shapes.by_name("torus")
        seen = rc.evaluate(mesh, lens, placement.cameras.poses, task=rc.Task(**task))
        assert seen.covered.share() == pytest.approx(share, abs=1e-6)


def test_a_goal_out_of_reach_of_a_lens_says_so(caplog):
    flat = CAMERA | {"depth_of_field": 0.05}
    goal = PLAN["selection"] | {"coverage": 0.99, "of_reachable": False, "refine": False}
    around = PLAN["candidates"][:1]
    placement = rc.place(PLAN | {"camera": flat, "selection": goal, "candidates": around})
    assert not placement.is_met
    assert "% out of focus" in caplog.text
    of = "the fewest cameras for 99.0 % of what the candidates can cover: the goal is out of reach"
    assert summary(placement)["selection"]["status_of"] == of
    most = {"goal": "best_coverage", "cameras": 2}
    placement = rc.place(PLAN | {"camera": flat, "selection": most, "candidates": around})
    of = "the best coverage, not the fewest cameras"
    assert summary(placement)["selection"]["status_of"] == of


@pytest.mark.slow
def test_layers_of_a_shallow_depth_of_field_reach_what_is_not_occluded():
    flat = CAMERA | {"depth_of_field": 0.05}
    goal = PLAN["selection"] | {"coverage": 0.85, "of_reachable": False, "refine": False}
    placement = rc.place(PLAN | {"camera": flat, "selection": goal})
    assert placement.is_met
    assert len(placement.cameras.poses) > 50


def test_a_magnification_that_reaches_a_goal_is_named(caplog):
    fine = CAMERA | {"magnification": 0.003, "working_distance": 6.0, "depth_of_field": 5.0}
    around = [{"generator": "on_sphere", "count": 12}]
    goal = PLAN["selection"] | {"coverage": 0.85, "of_reachable": False, "refine": False}
    assert not rc.place(PLAN | {"camera": fine, "candidates": around, "selection": goal}).is_met
    assert "within reach with 0.7 times the magnification" in caplog.text


def test_mixed_cameras_are_chosen_among():
    cameras = {"lens": CAMERA | {"cost": 1.0}, "pinhole": {"width": 640, "height": 480, "fx": 640}}
    cameras["pinhole"]["cost"] = 3.0
    plan = {key: value for key, value in PLAN.items() if key != "camera"} | {"cameras": cameras}
    plan["selection"] = PLAN["selection"] | {"refine": False, "coverage": 0.8}
    placement = rc.place(plan)
    assert placement.is_met
    assert rc.check(plan, placement.cameras.placed).is_met
