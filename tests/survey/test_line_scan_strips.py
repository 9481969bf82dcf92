"""Perspective line scan by strips: shadows beside those of the moving sensor, and what refuses."""

import numpy as np
import pytest
from scenes import joined

import rastercov as rc

FAR, RELIEF = 0.5, 0.1
SENSOR = {"focal_length": 0.05, "pixel_size": 5e-5, "vy": 1e-3, "depths": (FAR - RELIEF, FAR)}
PLATE = rc.Mesh(
    [(-0.1, -0.1, FAR), (0.1, -0.1, FAR), (0.1, 0.1, FAR), (-0.1, 0.1, FAR)], [(0, 2, 1), (0, 3, 2)]
)
BLOCK = rc.shapes.box((0.04, 0.08, RELIEF))
SCENE = joined(PLATE, rc.Mesh(np.add(BLOCK.vertices, (0.04, 0, FAR - RELIEF / 2)), BLOCK.faces))


def seen_of_plate(strips, scene=SCENE, task=None):
    rig = rc.Rig.line_scan(400, 200, strips=strips, **SENSOR)
    result = rc.evaluate(scene, rig, rig.poses(np.eye(4)[None]), task)
    return float(result.covered.area[0][:2].sum()), result


@pytest.mark.parametrize("strips", [1, 4, 16, 64, 200])
def test_shadows_move_along_the_travel_by_less_than_is_said(strips, caplog):
    """The sensor sees the plate beyond x = 0.06 only from 0.06 Z / (Z - H) on, at any time.

          o
         /|      block from x = 0.02 to 0.06, its shadow to 0.075
    ____/_[]_x____
    """
    truth = 0.04 - (0.075 - 0.02) * 0.08
    area, _ = seen_of_plate(strips)
    shift = 0.2 / (2 * strips) * RELIEF / (FAR - RELIEF)
    assert abs(area - truth) <= 2 * shift * (0.075 - 0.02) + 1e-9
    assert "strips of the line scan shift shadows by up to" in caplog.text
    if strips == 4:
        assert "by up to 6.25 mm" in caplog.text


def test_no_gap_is_left_between_strips_at_any_depth():
    for depth in (FAR - RELIEF, FAR - 0.03, FAR):
        plate = rc.Mesh(PLATE.vertices * (0.8, 1, 1) - (0, 0, FAR - depth), PLATE.faces)
        area, _ = seen_of_plate(7, plate)
        assert area == pytest.approx(0.032)


def test_walls_across_the_travel_are_left_out_by_their_incidence():
    across = np.abs(SCENE.normals[:, 1]) > 0.9
    _, result = seen_of_plate(16)
    assert result.covered.area[0][across].sum() > 0
    _, result = seen_of_plate(16, task=rc.Task(max_incidence_deg=85))
    assert result.covered.area[0][across].sum() == 0


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"vy": 0.0}, "expected magnitude of vy to be positive"),
        ({"depths": (0.5, 0.4)}, "expected increasing depths and up to 200 strips"),
        ({"depths": 0.5}, "expected depths to be two numbers"),
        ({"strips": 201}, "expected increasing depths and up to 200 strips"),
        ({"focal_length": -1}, "expected focal_length to be positive"),
    ],
)
def test_a_wrong_line_scan_is_refused_in_one_line(changes, line):
    with pytest.raises(rc.CameraError) as raises:
        rc.Rig.line_scan(400, 200, **(SENSOR | {"strips": 4} | changes))
    assert line in str(raises.value)
    assert "\n" not in str(raises.value)
