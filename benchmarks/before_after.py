"""Speed of this checkout against another one, in one run: `before_after.py PATH_TO_THE_OTHER`.

Each round starts a process in either checkout, in turn, which times the cells of `CELLS` in CPU
seconds of one thread; the ratio of a cell is the median over the rounds of this checkout's time to
the other's. Both must see the same number of samples and the same area, or the exit code is 1; with
`--bits` every figure must be the same, bit for bit.
"""

import argparse
import hashlib
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
COVERAGE = (
    *("coverage", "reason", "visibility", "visibility_bound", "visibility_kind", "resolution"),
    *("pixel_density", "incidence", "in_focus", "in_view", "in_view_fraction", "projected_area"),
    *("visible_pixels", "drawn_pixels", "clipped"),
)
"""Fields of `Coverage` whose bits are compared."""
LENSES = {
    "Brown-Conrady": (-0.28, 0.09, 8e-4, -5e-4, -0.01),
    "fisheye": (0.03, -0.012, 0.004, -0.001),
}
"""Coefficients of OpenCV."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="root of the other checkout")
    parser.add_argument("--rounds", type=int, default=7, help="processes of each checkout")
    parser.add_argument("--bits", action="store_true", help="ask for the same bits")
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
        table = {root: _run(root) for root in (order if number % 2 else order[::-1])}
        rounds.append((table[order[0]], table[order[1]]))
        print(f"round {number} of {args.rounds}", file=sys.stderr, flush=True)
    report = Report()
    for cell in rounds[0][0]:
        (_, answer), (_, other_answer) = rounds[0][0][cell], rounds[0][1][cell]
        (seen, digest), (seen_by_other, digest_of_other) = answer, other_answer
        report.check(f"{cell}: the same sum", bool(np.isclose(seen, seen_by_other, rtol=1e-9)))
        if args.bits:
            report.check(f"{cell}: the same bits", digest == digest_of_other)
        ratios = [ours[cell][0] / theirs[cell][0] for ours, theirs in rounds[1:]]
        report.add(f"{cell}: time to the other's", statistics.median(ratios), "", at_most=MOST)
    report.finish(args.json)


def _run(root: Path) -> dict[str, tuple[float, tuple[float, str]]]:
    """CPU seconds, and the sum and digest of the answers, of each cell in a process of its own."""
    command = [sys.executable, __file__, "--measure", str(root)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run(
        command, env=environment, cwd=root, check=True, stdout=subprocess.PIPE, text=True
    )
    return json.loads(done.stdout)


def _measure() -> dict[str, tuple[float, tuple[float, str]]]:
    # An editable install finds its own tree before PYTHONPATH.
    sys.meta_path[:] = [each for each in sys.meta_path if "editable" not in type(each).__module__]
    import rastercov as rc
    from rastercov.core.mesh import shapes

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
            areas = seen.visible_pixels, seen.drawn_pixels, seen.kind, seen.clipped
            figures[f"{method}, {name}"] = seconds, _digest(*areas)
        task = rc.Task(min_pixels=4, max_incidence_deg=75)
        seconds, judged = _least(
            lambda m=mesh, c=camera, p=poses, t=task: rc.evaluate(m, c, p, t, by="face")
        )
        arrays = [getattr(judged, name) for name in COVERAGE]
        figures[f"evaluate, {name}"] = seconds, _digest(*arrays)
    scenes["torus, 1,000,000 faces"] = (shapes.torus(1000, 500), 4.2, 4)
    for name, (mesh, distance, n) in scenes.items():
        poses = _poses(rc, mesh, distance, n)
        for width, height in ((1280, 1024), (256, 256)):
            camera = rc.Camera(width=width, height=height, fx=0.9 * width, fy=0.9 * width)
            figures[f"counts, {name}, {width} x {height}"] = _counts(rc, mesh, camera, poses)
    mesh, distance, n = scenes["torus, 10,000 faces"]
    poses, matrix = (
        _poses(rc, mesh, distance, n),
        np.array([[900, 0, 640], [0, 900, 512], [0, 0, 1.0]]),
    )
    for lens, values in LENSES.items():
        fisheye = lens == "fisheye"
        camera = rc.Camera.from_opencv(matrix, 1280, 1024, values, fisheye=fisheye)
        figures[f"counts, torus, 10,000 faces, {lens}"] = _counts(rc, mesh, camera, poses)
        with rc.open_observer(mesh, camera, "certified", threads=1) as observer:
            seconds, seen = _least(lambda o=observer, p=poses: o.observe(p))
        areas = seen.visible_pixels, seen.drawn_pixels, seen.kind, seen.clipped
        figures[f"certified, torus, 10,000 faces, {lens}"] = seconds, _digest(*areas)
    return figures


def _counts(rc, mesh, camera, poses) -> tuple[float, tuple[float, str]]:
    with rc.open_rasterizer(mesh, camera, "cpu", threads=1) as rasterizer:
        seconds, counts = _least(lambda: rasterizer.count(poses, drawn=False))
    return seconds, _digest(counts.visible)


def _digest(*arrays: np.ndarray) -> tuple[float, str]:
    """Sum of the first array, and SHA-256 of all."""
    total = hashlib.sha256()
    for array in arrays:
        total.update(np.ascontiguousarray(array).data)
    return float(arrays[0].sum()), total.hexdigest()


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
