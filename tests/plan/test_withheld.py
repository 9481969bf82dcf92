"""Views that would cover a dead zone and are no candidates: against each view evaluated alone."""

import numpy as np
import pytest
from plans import placed, told

import rastercov as rc
from rastercov.core.area.regions import covering_poses
from rastercov.core.area.zones import points_of

PLAN = {
    "meshes": [{"built_in": "icosahedron"}],
    "camera": {"width": 320, "height": 256, "hfov_deg": 40},
    "task": {"max_incidence_deg": 65, "resolution_of_result": 0.3},
    "candidates": [{"generator": "on_sphere", "count": 40, "distances": [4.0]}],
    "constraints": {
        "keep_out": [{"name": "machine", "low": [-9, -9, 0.6], "high": [9, 9, 9]}],
        "stand_off": [0.1, 5.0],
    },
    "selection": {"goal": "best_coverage", "cameras": 4},
    "outputs": {"page": False},
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_views_left_out_that_cover_half_of_a_zone_are_counted():
    placement = placed(PLAN)
    zones = placement.cameras.areas.zones(placement.prepared.plan.rig, placement.cameras.placed)
    refused = placement.prepared.pool.refused
    assert {each.reason for each in refused} == {"kept_out"}
    camera, task = rc.Camera.from_fov(320, 256, hfov_deg=40), rc.Task(max_incidence_deg=65)
    regions = rc.regions(placement.prepared.mesh, camera, np.array([e.pose for e in refused]), task)
    points, piece = points_of(zones, len(placement.withheld), 32)
    covers = covering_poses(regions, zones.face[piece], points)
    for row, views in enumerate(placement.withheld):
        share = covers[zones.zone[piece] == row].mean(axis=0)
        wanted = np.flatnonzero(share >= 0.5)
        assert {id(each.pose) for each in views} == {id(refused[at].pose) for at in wanted}
    assert placement.withheld[0]
    entry = told()["dead_zones"][0]["refused"]
    assert sum(each["views"] for each in entry) == len(placement.withheld[0])
    assert entry[0]["what"] == "inside keep-out volume 'machine'"
    from rastercov.report.plan import lines

    words = f"{len(placement.withheld[0])} rejected candidates would cover at least half of it "
    assert any(
        words in line and "inside keep-out volume 'machine'" in line for line in lines(placement)
    )


def test_zones_that_no_view_would_cover_have_none():
    none = placed(PLAN, constraints={"stand_off": [0.1, 5.0]})
    assert not any(none.withheld)
    assert "refused" not in told()["dead_zones"][0]


def test_advice_of_a_plan_takes_places_that_it_allows():
    """Those of its candidates for `place`, those within its constraints for `check`."""
    placement = placed(PLAN | {"selection": {"goal": "best_coverage", "cameras": 2}})
    eyes = placement.prepared.pool.candidates.poses[:, :3, 3]
    zones = placement.cameras.areas.dead_zones(
        placement.prepared.plan.rig, placement.cameras.placed
    )
    moved = [each["tried"] for each in zones["dead_zones"] if each["tried"]]
    assert moved
    for each in moved:
        assert np.linalg.norm(eyes - each["position"], axis=1).min() < 0.01  # to its digits
    checked = rc.check(placement.prepared.plan, placement.cameras.poses, min_coverage=0.9)
    tried = [each["tried"] for each in checked.summary()["dead_zones"] if each["tried"]]
    assert tried
    assert all(each["position"][2] < 0.6 for each in tried)
