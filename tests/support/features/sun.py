"""The sun in tests of all public names."""

from misuse_values import MESH

import rastercov as rc

NAMES = ["Sunlight", "sun_directions", "sunlit"]
TOWARDS = [(0, 0, 1), (1, 0, 1)]
OBJECTS = [rc.sunlit(MESH, TOWARDS)]
SHOWN = OBJECTS
COMPARED = [("sunlit", "lit_by")]
CALLS = {
    "sunlit": {"directions": TOWARDS, "weights": [1, 2], "irradiance": 900.0, "lit_by": "all"},
    "sun_directions": {"latitude": 48.0, "longitude": 11.5, "north_deg": 40.0}
    | {"times": ["2026-06-21T12:00+02:00"]},
}
LINES = {
    "sun": "sun part.ply --latitude 48 --longitude 11 --day 2026-03-21 --step 60 --penumbra",
    "sun, a year": "sun part.ply --latitude 48 --longitude 11 --year 2026 --at-least 10h",
}
