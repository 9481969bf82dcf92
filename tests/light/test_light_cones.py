"""Cones of lamps."""

import math

import pytest
from test_cones import check, looking, sheet

import rastercov as rc


@pytest.mark.parametrize("kind", ["spot", "bar", "area"])
def test_regions_end_at_the_cones_of_lamps(kind):
    h, half = 2.0, math.radians(25)
    lamp = {
        "spot": rc.Lamp.spot(25, 100),
        "bar": rc.Lamp.bar(0.5, 100, points=1, half_angle_deg=25),
        "area": rc.Lamp.area(0.5, intensity=100, points=1, half_angle_deg=25),
    }[kind]
    mesh = sheet(6)
    lamps = rc.Lamps([lamp], looking(h, 0))
    camera = rc.Camera(width=400, height=400, fx=200, fy=200)
    regions = rc.regions(mesh, camera, looking(4, 0), rc.Task(), lamps=lamps)
    radius = h * math.tan(half)
    check(regions, math.pi * radius**2, mesh, 2 * math.pi * radius)
