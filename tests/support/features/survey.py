"""Viewsheds in tests of all public names."""

import rastercov as rc

HEIGHTS = [[3.0, 4.0, 3.0], [5.0, 9.0, 5.0], [3.0, 4.0, 3.0]]
NAMES = ["Viewshed", "viewshed"]
OBJECTS = [rc.viewshed(HEIGHTS, [(10, -20)], spacing=30.0)]
SHOWN = OBJECTS
CALLS = {
    "viewshed": {"heights": HEIGHTS, "observers": [(10, -20)], "spacing": 30.0, "height": 2.0}
    | {"target": 1.0, "radius": 100.0, "refraction": 0.2},
}
OF_LINES = {"dem.asc": "ncols 3\nnrows 3\ncellsize 30\n" + "3 4 3\n5 9 5\n3 4 3\n"}
LINES = {"viewshed": "viewshed dem.asc --from 20,20 --target 1 --radius 100"}
