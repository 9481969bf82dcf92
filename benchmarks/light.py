"""Light before bodies that move: CPU times of one thread, of frames with lamps that stay.

The scene is the large one of `motion`.
"""

from pathlib import Path

import numpy as np
from motion import CAMERA
from rows import Report, arguments, seconds
from swept_arm import CAMERAS, cell, frames, sweep

import rastercov as rc
from rastercov.light.lamps import points_of
from rastercov.motion.regions import ViewKeys

LAMPS = rc.Lamps(
    [rc.Lamp.point(intensity=100), rc.Lamp.spot(30, intensity=60)],
    rc.look_at([(0.9, 0.2, 1.6), (-0.3, -0.9, 1.2)], (0.45, 0, 0.1)),
)


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--mesh", type=Path, help="part of the scene, instead of a teapot")
    args = parser.parse_args()
    report = Report()
    part = rc.Mesh.load(args.mesh) if args.mesh else rc.shapes.teapot(25)
    lit(report, "large", cell(part, 2000), args.frames)
    report.finish(args.json)


def lit(report: Report, name: str, mesh: rc.Mesh, n: int) -> None:
    """Time of a frame by two cameras, without lamps and with two that stay in their places."""
    motion, task = rc.Motion(mesh, frames(sweep(n))), rc.Task(max_incidence_deg=75)
    for lamps, what in ((None, "without light"), (LAMPS, "with two lamps")):

        def find(lamps: rc.Lamps | None = lamps) -> rc.Regions:
            return rc.regions(
                mesh, CAMERA, CAMERAS[:2], task, lamps=lamps, motion=motion, threads=1
            )

        find()  # fields of view of the lamps are made once in a process
        size = f"{name} ({mesh.n_faces:,} faces)"
        report.add(f"{size}: a frame of 2 cameras {what}", 1e3 * seconds(find) / n, "ms")
    points, sights = points_of(LAMPS, np.ones(len(LAMPS), np.bool_)), ViewKeys(motion)
    axes = np.zeros((len(points), 3))  # no lamp has parallel rays
    near = np.full(len(points), 1e-5)
    keys = {key for row in range(n) for key in sights.of(row, points, near, axes)}
    report.add(f"{name}: pictures of {len(points) * n} by lamps that differ", len(keys), "pictures")


if __name__ == "__main__":
    main()
