"""Table 6.1 of the thesis: networks from the segments of the 1970-face aeroplane, ten times each.

A face is not covered when its coverage, (3.6), is 0 in every camera. The thesis' aeroplane is not
public: ours has its face count, not its shape. "leader" is the order of merging that the thesis'
program follows, with the stand-off of (6.7) as corrected in docs/appendix/placement_methods.md;
"closest" is ours, with every vertex of a segment in view. Then the cameras of "closest" are
refined: the same number, moved one by one.
"""

import statistics
import time

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement.candidates.pool import Candidates, Framing, per_segment
from rastercov.placement.candidates.segments import segment
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import Refined, refine

PRINTED = {
    # alpha, beta: cameras, percent not covered, mean, best, worst and deviation of the seconds
    (15, 25): (30, 0.253, 549.769, 518.567, 570.156, 18.155),
    (25, 35): (18, 0.71, 274.418, 271.111, 279.799, 3.1734),
    (35, 45): (11, 2.99, 178.054, 170.0, 191.544, 7.664),
    (30, 60): (6, 5.63, 100.123, 91.745, 113.270, 6.293),
}
METHODS = {"leader": "extent", "closest": "vertices"}
"""Rule of merging, and how a camera is fitted to its segment."""
RUNS = 10
TASK = rc.Task.thesis()


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    args = parser.parse_args()
    report = Report()
    mesh, camera = shapes.aeroplane(), rc.Camera.preset("icube-ns4133bu-8mm")
    network(mesh, camera, 15, 25, "closest")  # compiles, or loads what was compiled
    for (alpha, beta), printed in PRINTED.items():
        cameras, percent, *seconds = printed
        report.add(f"({alpha}, {beta}) thesis: cameras", cameras, "cameras")
        report.add(f"({alpha}, {beta}) thesis: not covered", percent, "%")
        for name, figure in zip(("mean", "best", "worst", "deviation"), seconds, strict=True):
            report.add(f"({alpha}, {beta}) thesis: {name}", figure, "s")
        for merge in METHODS:
            row(report, mesh, camera, alpha, beta, merge, printed)
    report.finish(args.json)


def network(
    mesh: rc.Mesh, camera: rc.Camera, alpha: float, beta: float, merge: str
) -> tuple[Candidates, float]:
    """Cameras of a mesh by its segments, and the percentage of its faces that none covers."""
    segmentation = segment(mesh, alpha, beta, merge=merge)
    segments = per_segment(mesh, camera, Framing(fit=METHODS[merge]), segmentation=segmentation)
    best = rc.evaluate(mesh, camera, segments.poses, task=TASK, by="face").coverage.max(axis=0)
    return segments, 100 * float((best == 0).mean())


def refined(mesh: rc.Mesh, camera: rc.Camera, candidates: Candidates) -> Refined:
    """The same number of cameras, moved one by one."""
    eyes = candidates.poses[:, :3, 3]
    reach = 1.5 * float(np.abs(eyes - mesh.bounds.mean(axis=0)).max())
    with rc.open_observer(mesh, camera) as observer:
        objective = Objective.of(observer, TASK, weight_by="count")
        return refine(objective, PoseSpace(mesh=mesh, stand_off=(0.0, reach)), candidates.poses)


def row(
    report: Report,
    mesh: rc.Mesh,
    camera: rc.Camera,
    alpha: float,
    beta: float,
    merge: str,
    printed: tuple[float, ...],
) -> None:
    """One column of the table by one rule; for ours, what refinement makes of it."""
    seconds, answers = [], set()
    for _ in range(RUNS):
        started = time.perf_counter()
        result, percent = network(mesh, camera, alpha, beta, merge)
        seconds.append(time.perf_counter() - started)
        answers.add((len(result), percent))
    what, ours = f"({alpha}, {beta}) {merge}", merge == "closest"
    report.check(f"{what}: the same network every time", len(answers) == 1)
    most, least = printed[:2] if ours else (None, None)
    report.add(f"{what}: cameras", len(result), "cameras", at_most=most)
    report.add(f"{what}: not covered", percent, "%", at_most=least)
    report.add(f"{what}: mean", statistics.mean(seconds), "s", at_most=1.0)
    report.add(f"{what}: best", min(seconds), "s")
    report.add(f"{what}: worst", max(seconds), "s", at_most=1.0)
    report.add(f"{what}: deviation", statistics.stdev(seconds), "s")
    if ours and percent > 0:
        moved = refined(mesh, camera, result)
        start, end = (100 * (1 - share) for share in (moved.start_share, moved.share))
        report.check(f"{what}: refinement starts from that", abs(start - percent) < 1e-9)
        report.add(f"{what}, refined: not covered", end, "%", at_most=percent / 2)
        report.add(f"{what}, refined: time", moved.seconds, "s")
        report.add(f"{what}, refined: poses measured", moved.evaluations, "poses")


if __name__ == "__main__":
    main()
