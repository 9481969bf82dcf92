"""20,000 poses in one context: resident memory must stay flat and the answers the same."""

import hashlib

import numpy as np
from rows import Report, arguments, resident_mib

import rastercov as rc
from rastercov.core.mesh import shapes

WARM_UP = 1_000
BATCH = 100


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--poses", type=int, default=20_000)
    args = parser.parse_args()
    mesh, camera = shapes.aeroplane(), rc.Camera(width=256, height=256, fx=300, fy=300)
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 38.0, args.poses)
    report = Report()
    with rc.open_rasterizer(mesh, camera, "gl") as rasterizer:
        first = _digest(rasterizer, poses[:BATCH])
        resident = []
        for start in range(0, len(poses), BATCH):
            rasterizer.count(poses[start : start + BATCH])
            if start >= WARM_UP:
                resident.append(resident_mib())
        last = _digest(rasterizer, poses[:BATCH])
        renderer = rasterizer.info.renderer
    report.add(f"poses in one context on {renderer}", len(poses), "poses")
    report.add(
        "resident memory, growth after the warm-up",
        resident[-1] - resident[0],
        "MiB",
        at_most=5,
        aim=1,
    )
    report.add("resident memory at the end", resident[-1], "MiB")
    report.check("the first poses give the same counts at the end", first == last)
    report.finish(args.json)


def _digest(rasterizer: rc.Rasterizer, poses: np.ndarray) -> str:
    counts = rasterizer.count(poses)
    assert counts.drawn is not None
    return hashlib.sha256(counts.visible.tobytes() + counts.drawn.tobytes()).hexdigest()


if __name__ == "__main__":
    main()
