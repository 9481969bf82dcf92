"""Motion in tests of all public names."""

import numpy as np
from misuse_values import CAMERA, FOLDER, MESH, POSES

import rastercov as rc

MOTION = rc.Motion(MESH, {"mesh": rc.conveyor(2, direction=(1, 0, 0), distance=0.1)})
QUERY = rc.MotionQuery(MOTION)
NAMES = ["Motion", "MotionQuery", "OverTime", "conveyor", "load_motion", "turntable"]
FIRST = ["Evaluation.over_time", "Motion.frame"]
OBJECTS = [MOTION, QUERY]
SHOWN = [*OBJECTS, rc.evaluate(MESH, CAMERA, POSES, motion=QUERY).over_time]
COMPARED = [("Motion.poses_of", "body")]
EARLY = {"MotionQuery.long_enough": "views"}
FILES = {"frames.csv": "time,mesh.x,mesh.y,mesh.z\n0,0,0,0\n1,0.1,0,0\n"}
USUAL = {"motion": MOTION}
UNTRIED = {"OverTime": "is made by evaluate"}
ALONE = {"method": rc.Engine("exact", threads=1)}
CALLS = {
    "evaluate, moving": ALONE | {"fields": [], "motion": rc.MotionQuery(MOTION, 0.5)},
    "Motion": {"bodies": {"mesh": np.stack([np.eye(4)] * 2)}, "present": {"mesh": [True, False]}},
    "Motion.poses_of": {"body": "mesh"},
    "Motion.frame": {"row": 1},
    "load_motion": {"path": FOLDER / "frames.csv"},
    "turntable": {"steps": 3},
    "conveyor": {"steps": 3, "distance": 0.1},
    "MotionQuery.long_enough": {"regions": rc.regions(MESH, CAMERA, POSES, motion=MOTION)},
}
LINES = {"evaluate, motion": "{scene} --motion motion.csv"}
OF_LINES = {"motion.csv": "time,part.x\n0,0\n1,0.01\n2,0.02\n"}
