"""Dead zones drawn by exact pieces, numbered as in the list."""

import numpy as np
import pytest
from surface_cases import room

import rastercov as rc
from rastercov.base.format import area
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.points import views_at, zones_at
from rastercov.mesh import shapes
from rastercov.reference.regions import covers_points, points_on
from rastercov.report import theme
from rastercov.report.zone_pictures import _middle, numbered, zone_rows, zones_picture

TASK = rc.Task(max_incidence_deg=75, views=2)
MESH, CAMERA, POSES = room()


@pytest.fixture(scope="module")
def network():
    found = AreaNetwork(MESH, TASK)
    found.add(rc.regions(MESH, CAMERA, POSES, TASK))
    return found


def test_points_know_their_views_and_their_zone(network):
    points, face = points_on(MESH, 3_000, 0)
    truth = covers_points(MESH, CAMERA, POSES, TASK, points, face).sum(axis=0)
    views = views_at(network.covered, face, points)
    assert (views == np.minimum(truth, 2)).mean() > 0.999
    zones = network.zones()
    zone = zones_at(zones, face, points, 3)
    assert ((zone >= 0) == (truth < 2)).mean() > 0.999
    assert zone.max() == 3
    # Points are spread evenly: their share of a zone is that of its area.
    for row in range(2):
        share = zones.area[row] / MESH.areas.sum()
        assert (zone == row).mean() == pytest.approx(share, abs=0.02)


def test_the_list_adds_up_to_all_that_is_not_covered(network):
    summary = network.dead_zones(CAMERA, POSES)
    rows = zone_rows(summary)
    shown = numbered(summary)
    assert [row[0] for row in rows[: len(shown)]] == [str(n + 1) for n in range(len(shown))]
    assert rows[0][1] == area(shown[0]["area_m2"])
    listed = sum(zone["area_m2"] for zone in summary["dead_zones"])
    everything = listed + summary["other_dead_zones"]["area_m2"]
    left = MESH.areas.sum() - network.covered.area[1].sum()
    assert everything == pytest.approx(left)
    numbers = sum(zone["area_m2"] for zone in shown)
    if everything - numbers > 0:
        assert rows[-1][0].endswith("more")
        assert rows[-1][1] == area(everything - numbers)


@pytest.mark.slow
def test_zones_have_the_colour_of_their_reason_and_what_is_covered_has_none():
    mesh = shapes.sphere(3)
    camera = rc.Camera(width=640, height=480, fx=400, fy=400)
    pose = rc.look_at((0, -4, 0), (0, 0, 0))
    network = AreaNetwork(mesh, rc.Task())
    network.add(rc.regions(mesh, camera, pose))
    summary = network.dead_zones(camera, pose)
    assert summary["dead_zones"][0]["reason"] == "back_facing"
    picture = zones_picture(network.zones(), summary, pose[:, :3, 3])
    pixels = np.asarray(picture)[60:600].astype(int)
    purple = np.abs(pixels - 0.9 * np.array(theme.REASONS["back_facing"])).max(axis=2) < 30
    grey = np.abs(pixels - 0.9 * np.array(theme.COVERED)).max(axis=2) < 30
    assert purple.mean() > 0.05
    # Both views together show each part of a sphere; less than half of it is covered.
    assert purple.sum() > 0.5 * grey[..., None].sum() * 0.1


def test_a_number_is_in_the_middle_of_its_zone():
    mask = np.zeros((40, 60), bool)
    mask[5:35, 10:15] = True  # a thin bar with a wide end
    mask[20:35, 10:40] = True
    x, y = _middle(mask)
    assert mask[int(y), int(x)]
    assert 15 < x < 35
    assert 22 < y < 33
