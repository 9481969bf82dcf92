"""Inspection by a robot: a stereo head on an arm sees a part from as few poses as it needs.

Both cameras of the head must see a point, with rays at least 8 degrees apart. The arm of arm.urdf
must reach each pose without touching part, table or itself; each pose is measured again with the
arm in the image. The result is a list of poses with joint angles, in the order of a tour.
"""

from pathlib import Path

import numpy as np

import rastercov as rc

ARM = Path(__file__).with_name("arm.urdf")
PLACE = [0.5, 0.05, 0.0]  # of the part in front of the arm, m
MIDDLE = [0.5, 0.05, 0.08]
TABLE = [0.5, 0.05, -0.2555]  # 0.5 mm below the foot of the part
HEAD = [
    {"camera": "eye", "name": "left", "translation": [-0.06, 0, 0], "angle_deg": 9},
    {"camera": "eye", "name": "right", "translation": [0.06, 0, 0], "angle_deg": -9},
]
PLAN = {
    "meshes": [
        {"built_in": "teapot", "transform": {"translation": PLACE}},
        {"built_in": "box", "role": "occluder", "transform": {"scale": 0.51, "translation": TABLE}},
    ],
    "cameras": {"eye": {"width": 1280, "height": 1024, "hfov_deg": 38}},
    "rigs": {"head": {"cameras": HEAD, "rule": "all", "min_baseline_deg": 8}},
    "task": {"max_incidence_deg": 65, "resolution_of_result": 0.01},
    "bodies": [{"name": "arm", "urdf": str(ARM)}],
    "candidates": [
        {
            "generator": "on_arm",
            "body": "arm/head",
            "mount": {"translation": [0, 0, 0.06]},  # the lenses are 1 cm in front of the head
            "clearance": 0.01,
            "rolls_deg": [0, 90],
            "of": {
                "generator": "on_hemisphere",
                "centre": MIDDLE,
                "count": 60,
                "distances": [0.38],
            },
        }
    ],
    "selection": {"goal": "fewest_cameras", "coverage": 0.9, "of_reachable": True},
}


def main() -> None:
    placed = rc.place(PLAN)
    pool, reachable = placed.prepared.pool, placed.prepared.reachable
    share, of = placed.cameras.share, reachable.summary()["percent"] / 100
    print(f"{len(pool.candidates)} of 120 poses are within reach and free of collisions")
    print(f"{len(placed.cameras.mounted)} of them cover {100 * share:.1f} % of the part,")
    print(f"which is {100 * share / of:.1f} % of what all of them cover ({100 * of:.1f} %)")
    arm = placed.carried
    print(f"the arm hides at most {arm.lost.max():.2f} percentage points of an image")
    print("tour, joint angles in degrees, clearance in mm:")
    for row in arm.order:
        joints = " ".join(f"{angle:6.1f}" for angle in np.degrees(arm.joints[row]))
        print(f"  pose {row}: {joints}   {1e3 * arm.near['scene'][row].distance:.0f}")


if __name__ == "__main__":
    main()
