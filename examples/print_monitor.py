"""Cameras that watch a 3-D printer: how much of the newest 10 mm they see while the head moves.

Bed, gantry and head are boxes, the print is a star-shaped tower at four heights. The head moves
around the contour of each. Faults of a print appear in its newest layers. A point counts if a
camera sees it 90 % of the time, because the head passes in front of every camera. Lamps are then
chosen for these cameras; the head also blocks their light.
"""

import json
import tempfile
from pathlib import Path

import numpy as np

import rastercov as rc

HEIGHTS = (0.03, 0.05, 0.07, 0.09)  # of the print, m
NEW = 0.01  # m that are watched
POINTS = 6  # of the star; the head stops at each and between two
OVER = 0.9  # of the time
SPACING = 0.068  # of places for cameras on the frame of the printer, m: 204
LAMPS = 2  # at corners of the frame


def ring(z):
    """Contour of the tower at a height."""
    angle = np.arange(2 * POINTS) * np.pi / POINTS
    radius = np.where(np.arange(2 * POINTS) % 2, 0.03, 0.05) * (1 - 4 * z)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, z)), 1)


def slab(low, high):
    """Part of the tower between two heights, without its bottom, which lies on what is below."""
    n = 2 * POINTS
    points = np.concatenate((ring(low), ring(high), [(0, 0, high)]))
    k, after = np.arange(n), np.roll(np.arange(n), -1)
    top = np.full(n, 2 * n)
    sides = [(k, after, n + after), (k, n + after, n + k), (n + k, n + after, top)]
    return points, np.concatenate([np.stack(each, axis=1) for each in sides])


def box(low, high):
    made = rc.shapes.box(np.subtract(high, low), centre=np.add(low, high) / 2)
    return made.vertices, made.faces


def printer():
    """Parts by name, the head above the origin; and their motion, as a table of poses."""
    parts = {"bed": box((-0.15, -0.15, -0.01), (0.15, 0.15, -0.001))}
    for z in HEIGHTS:
        parts[f"old_{1e3 * z:.0f}"] = slab(0.0, z - NEW)
        parts[f"new_{1e3 * z:.0f}"] = slab(z - NEW, z)
    parts["head"] = box((-0.03, -0.03, 0.012), (0.03, 0.03, 0.09))
    parts["nozzle"] = box((-0.004, -0.004, 0.0005), (0.004, 0.004, 0.0119))
    parts["gantry"] = box((-0.2, 0.035, 0.04), (0.2, 0.065, 0.07))
    stops = np.concatenate([ring(z) for z in HEIGHTS])
    layer = np.repeat(np.arange(len(HEIGHTS)), 2 * POINTS)
    head = np.tile(np.eye(4), (len(stops), 1, 1))
    head[:, :3, 3] = stops
    gantry = head.copy()
    gantry[:, 0, 3] = 0.0  # a beam along x
    bodies = {
        "head": {"poses": head.tolist()},
        "nozzle": {"poses": head.tolist()},
        "gantry": {"poses": gantry.tolist()},
    }
    for row, z in enumerate(HEIGHTS):
        for name in ("old", "new"):
            bodies[f"{name}_{1e3 * z:.0f}"] = {"present": (layer == row).tolist()}
    return parts, {"bodies": bodies}


def obj(parts):
    """Text of an OBJ file of parts."""
    lines, first = [], 1
    for name, (points, faces) in parts.items():
        lines += [f"o {name}", *(f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist())]
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + first).tolist()]
        first += len(points)
    return "\n".join(lines) + "\n"


def plan(folder, selection):
    """Plan of the printer: places for cameras are on the frame around it."""
    parts, motion = printer()
    (folder / "printer.obj").write_text(obj(parts))
    (folder / "frames.json").write_text(json.dumps(motion))
    middle = (HEIGHTS[0] + HEIGHTS[-1]) / 2
    return {
        "meshes": [{
            "path": str(folder / "printer.obj"),
            "groups": [name for name in parts if name.startswith("new")],
        }],
        "motion": {"poses": str(folder / "frames.json")},
        "camera": {"width": 1920, "height": 1080, "hfov_deg": 70.0},
        "task": {"max_incidence_deg": 75.0, "over": OVER, "resolution_of_result": 0.005},
        "candidates": [{
            "generator": "on_box", "low": [-0.22, -0.22, 0.02], "high": [0.22, 0.22, 0.32],
            "sides": ["-x", "+x", "-y", "+y", "+z"], "spacing": SPACING,
            "aim": [{"point": [0.0, 0.0, middle]}],
        }],
        "selection": selection,
    }  # fmt: skip


def under_lamps(folder, placed):
    """The placed cameras in the light of the best lamps at corners of the frame."""
    (folder / "eyes.json").write_text(
        json.dumps({"world_from_camera": placed.cameras.poses.tolist()})
    )
    asked = plan(folder, {"goal": "best_coverage", "lamps": LAMPS})
    asked["existing"] = str(folder / "eyes.json")
    asked["lamps"] = {"led": {"kind": "spot", "half_angle_deg": 60.0, "intensity_cd": 60.0}}
    asked["task"]["min_illuminance"] = "100 lx"
    asked["candidates"][0] |= {"lamp": "led", "sides": ["-x", "+x"], "spacing": 1.0}
    return rc.place(asked)


def main():
    wanted = {"goal": "fewest_cameras", "coverage": OVER, "of_reachable": True}
    with tempfile.TemporaryDirectory() as folder:
        placed = rc.place(plan(Path(folder), wanted))
        motion = placed.prepared.phases.motion
        lit = under_lamps(Path(folder), placed)
    chosen, every = placed.cameras.areas.over_time, placed.prepared.reachable.over_time
    print(f"{len(placed.prepared.pool.candidates)} places, {len(motion)} stops of the head")
    camera = placed.cameras.areas.over_time.camera
    above = rc.look_at(eyes=[(-0.16, -0.16, 0.28)], targets=(0, 0, 0.06))
    asked = rc.MotionQuery(motion, OVER)
    usual = rc.evaluate(motion.mesh, camera, above, chosen.task, motion=asked).over_time
    for name, item in (
        ("all places", every), ("one above a corner, as is common", usual),
        (f"{len(placed.cameras.placed)} chosen", chosen),
        (f"with lamps {', '.join(lit.choices['lamps'].lamps.names)}", lit.cameras.areas.over_time),
    ):  # fmt: skip
        said = item.summary()
        print(
            f"{name}: {said['covered']['percent']:.1f} % of the newest {1e3 * NEW:.0f} mm covered "
            f"{100 * OVER:.0f} % of the time, {said['ever_percent']:.1f} % at some time"
        )
    print(f"{100 * chosen.share() / every.share():.1f} % of what all places together see")
    for zone in chosen.dead_zones()["dead_zones"][:2]:
        print(
            f"not seen for long enough: {1e6 * zone['area_m2']:.0f} mm2, occluded by",
            zone["hidden_by"],
        )
    return chosen, every, lit


if __name__ == "__main__":
    main()
