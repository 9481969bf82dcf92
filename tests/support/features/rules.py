"""Rules of rigs, and the laser line, in tests of all public names."""

import numpy as np
from misuse_values import CAMERA, MESH, POSES

import rastercov as rc

NAMES = ["All", "Any", "AtLeast", "LaserLine"]
LINE = rc.Rig(
    [CAMERA] * 2, ["laser", "a"], rule=rc.All(), tasks={"laser": {"max_incidence_deg": 80}}
)
SHIFTED = np.stack([np.eye(4)] * 2)
SHIFTED[1, 0, 3] = 0.1
SHOWN = [rc.All(), rc.Any(), rc.AtLeast(2), rc.LaserLine(rc.regions(MESH, CAMERA, POSES), 3, 1, 1)]
COMPARED = [("LaserLine", "stations")]
EARLY = {"LaserLine.of": "laser"}
IN_WORDS = ["LaserLine"]
CALLS = {
    "LaserLine.of": {"rig": LINE, "world_from_rig": SHIFTED},
    "AtLeast": {"k": 1},
    "LaserLine": {"stations": 3, "percent": 1.0, "doubled_percent": 1.5},
}
LINES = {"evaluate, rule": "evaluate part.ply -c rule.toml -p sphere:2 --max-incidence-deg 75"}
PLACES = [np.eye(4).tolist(), np.eye(4).tolist()]
PLACES[1][0][3] = 0.02
OF_LINES = {
    "rule.toml": f'rule = "all"\nmin_baseline_deg = 1\nrig_from_camera = {PLACES}\n'
    + "".join(
        f'[[cameras]]\nname = "{name}"\nwidth = 320\nheight = 240\nhfov_deg = 40\n'
        for name in ("camera", "projector")
    )
}
