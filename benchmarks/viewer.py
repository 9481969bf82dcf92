"""Cost of a drag that Python answers: from the message to the bytes of the faces.

    python benchmarks/viewer.py [--faces 10000 100000 1000000] [--cameras 6] [--json]

CPU milliseconds of a message with one of some cameras moved a little, all of its way through
`Session.ask`: checks, measurement, sums, levels, legend, JSON. The median of the drags; the first,
which measures all cameras, is named apart. A drag must take at most 30 ms at 10,000 faces and 100
ms at 100,000 (CPU). `bytes` is what goes to the page: one a face, and the JSON.
"""

import statistics
import time

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.mesh import shapes
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene, describe_state
from rastercov.page.session import Session

MUST = {10_000: 30.0, 100_000: 100.0}
MODES = ("reason", "coverage", "camera", "views", "density", "angle")


def main():
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--faces", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--cameras", type=int, default=6)
    parser.add_argument("--drags", type=int, default=15)
    asked = parser.parse_args()
    report = Report(prints=not asked.json)
    for faces in asked.faces:
        for row in measured(faces, asked.cameras, asked.drags):
            what = f"{row['faces']:,} faces, {row['mode']}"
            report.add(f"{what}: first, CPU", row["first_cpu_ms"], "ms")
            report.add(f"{what}: drag, CPU", row["drag_cpu_ms"], "ms", at_most=MUST.get(faces))
            report.add(f"{what}: drag, wall", row["drag_wall_ms"], "ms")
            report.add(f"{what}: answer", row["bytes"], "bytes")
    report.finish(asked.json)


def measured(asked, cameras, drags):
    """A row for each way to colour a torus of about the number of faces."""
    side = round((asked / 2) ** 0.5)
    mesh = shapes.torus(side, side)
    camera = rc.Camera(width=1280, height=1024, fx=1200, fy=1200)
    low, high = np.asarray(mesh.bounds)
    poses = sphere_of_poses((low + high) / 2, 1.6 * float(np.linalg.norm(high - low)), cameras)
    rows = []
    for mode in MODES:
        state = RigState.of(Rig([camera], ["eye"]), Poses.of(poses))
        session = Session(Scene("torus", mesh, state))
        sent(session, mode, poses[0])  # compiles
        session.close()
        session = Session(Scene("torus", mesh, state))
        first, *_ = sent(session, mode, poses[0])
        times = []
        for step in range(drags):
            pose = poses[0].copy()
            pose[0, 3] += 1e-3 * (step + 1)
            times.append(sent(session, mode, pose))
        cpu, wall, size = zip(*times, strict=True)
        session.close()
        rows.append(
            {
                "faces": mesh.n_faces, "mode": mode,
                "first_cpu_ms": first, "drag_cpu_ms": statistics.median(cpu),
                "drag_wall_ms": statistics.median(wall), "bytes": size[-1],
            }
        )  # fmt: skip
    return rows


def sent(session, mode, pose):
    """CPU and wall milliseconds of a drag, and the bytes of the answer."""
    rig = describe_state(session.scene, session.scene.start)
    rig["stations"][0]["pose"] = pose.ravel().tolist()
    entries = {"question": "frame", "rig": rig, "mode": mode, "is_drag": True}
    cpu, wall = time.process_time(), time.perf_counter()
    frame = session.ask(entries)
    return 1e3 * (time.process_time() - cpu), 1e3 * (time.perf_counter() - wall), len(frame)


if __name__ == "__main__":
    main()
