"""Speed of this checkout against another one, in one run: `before_after.py PATH_TO_THE_OTHER`.

Each round starts a process in either checkout, in turn, which times the cells of `CELLS` in CPU
seconds of one thread; the ratio of a cell is the median over the rounds of this checkout's time to
the other's. Both must see the same number of samples and the same area, or the exit code is 1.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rows import Report, arguments

MOST = 1.03
"""Ratio that a change may cost."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="root of the other checkout")
    parser.add_argument("--rounds", type=int, default=7, help="processes of each checkout")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.measure:
        print(json.dumps(_measure()))
        return
    here = Path(__file__).resolve().parents[1]
    if not (args.other / "rastercov").is_dir():
        parser.error(f"{args.other} is no checkout of rastercov")
    rounds = []
    for number in range(args.rounds + 1):
        order = [here, args.other.resolve()]
        found = {root: _run(root) for root in (order if number % 2 else order[::-1])}
        rounds.append((found[order[0]], found[order[1]]))
        print(f"round {number} of {args.rounds}", file=sys.stderr, flush=True)
    report = Report()
    for cell in rounds[0][0]:
        (_, sums), (_, others) = rounds[0][0][cell], rounds[0][1][cell]
        report.check(f"{cell}: the same answers", bool(np.allclose(sums, others, rtol=1e-9)))
        ratios = [ours[cell][0] / theirs[cell][0] for ours, theirs in rounds[1:]]
        report.add(f"{cell}: time to the other's", statistics.median(ratios), "", MOST,
                   at_most=True)  # fmt: skip
    report.finish(args.json)


def _run(root: Path) -> dict[str, tuple[float, list[float]]]:
    """What a process of one checkout measures: CPU seconds and sums of the answers of each cell."""
    command = [sys.executable, __file__, "--measure", str(root)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run(
        command, env=environment, cwd=root, check=True, stdout=subprocess.PIPE, text=True
    )
    return json.loads(done.stdout)


def _measure() -> dict[str, tuple[float, list[float]]]:
    import rastercov as rc
    from rastercov import shapes

    figures = {}
    teapot = shapes.teapot(12)
    scenes = {
        "torus, 10,000 faces": (shapes.torus(), 4.2, 24),
        "torus, 99,856 faces": (shapes.torus(316, 158), 4.2, 8),
        "teapot, 9,120 faces": (teapot, 2.2 * np.ptp(teapot.bounds), 8),
        "room, from inside": (shapes.room(), None, 16),
    }
    for name, (mesh, distance, n) in scenes.items():
        poses = _poses(rc, mesh, distance, n)
        camera = rc.Camera(width=1280, height=960, fx=1200, fy=1200)
        for method in ("certified", "exact"):
            with rc.open_observer(mesh, camera, method, threads=1) as observer:
                seconds, seen = _least(lambda o=observer, p=poses: o.observe(p))
            figures[f"{method}, {name}"] = seconds, [float(seen.visible_pixels.sum())]
    scenes["torus, 1,000,000 faces"] = (shapes.torus(1000, 500), 4.2, 4)
    for name, (mesh, distance, n) in scenes.items():
        poses = _poses(rc, mesh, distance, n)
        for width, height in ((1280, 1024), (256, 256)):
            camera = rc.Camera(width=width, height=height, fx=0.9 * width, fy=0.9 * width)
            with rc.open_rasterizer(mesh, camera, "cpu", threads=1) as rasterizer:
                seconds, counts = _least(lambda r=rasterizer, p=poses: r.count(p, drawn=False))
            figures[f"counts, {name}, {width} x {height}"] = seconds, [float(counts.visible.sum())]
    return figures


def _poses(rc, mesh, distance, n):
    centre = mesh.bounds.mean(axis=0)
    if distance is not None:
        return rc.sphere_of_poses(centre, distance, n)
    rng = np.random.default_rng(0)
    low, high = mesh.bounds
    return rc.look_at(*(low + (high - low) * rng.uniform(0.2, 0.8, (2, n, 3))))


def _least(run):
    """Least CPU seconds of some calls after a first one, and the answer."""
    answer = run()
    times = []
    for _ in range(5):
        started = time.process_time()
        answer = run()
        times.append(time.process_time() - started)
    return min(times), answer


if __name__ == "__main__":
    main()
