"""Viewsheds of rasters: CPU seconds an observer, memory, and wrong cells of lines of samples.

python benchmarks/terrain.py [heights along a side] [--json]
"""

import resource
import time

import numpy as np
from rows import Report, arguments

import rastercov as rc

SPACING = 30.0


def relief(side: int, seed: int = 0) -> np.ndarray:
    """Heights of a rough mountain range, metres, (side, side)."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side))
    wave = np.hypot(x, y)
    wave[0, 0] = 1
    heights = np.fft.ifft2(np.fft.fft2(rng.normal(size=(side, side))) / wave**1.8).real
    return heights / heights.std() * 150


def by_samples(heights: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Samples whose slope is above that of all nearest samples along the line to them."""
    rows, columns = heights.shape
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    horizon = np.full(heights.shape, -np.inf)
    n = np.maximum(abs(i - eye[0]), abs(j - eye[1])).astype(int)
    for step in range(1, int(n.max())):
        part = np.minimum(step / np.maximum(n, 1), 1)
        at_i, at_j = eye[0] + part * (i - eye[0]), eye[1] + part * (j - eye[1])
        near = heights[np.rint(at_i).astype(int), np.rint(at_j).astype(int)] - eye[2]
        slope = near / np.maximum(part * np.hypot(i - eye[0], j - eye[1]), 1e-9)
        horizon = np.where(step < n, np.maximum(horizon, slope), horizon)
    return (heights - eye[2]) / np.maximum(np.hypot(i - eye[0], j - eye[1]), 1e-9) >= horizon


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("side", type=int, nargs="?", default=1001, help="heights along a side")
    args = parser.parse_args()
    report = Report()
    kinds = {
        "mountains": relief(args.side),
        "rough": np.random.default_rng(1).normal(0, 5, (args.side, args.side)),
        "plane": np.zeros((args.side, args.side)),
    }
    middle = args.side // 2 * SPACING
    for name, heights in kinds.items():
        times = []
        for _ in range(3):
            began = time.process_time()
            seen = rc.viewshed(heights, (middle + 5, -middle - 7, 10.0), spacing=SPACING)
            times.append(time.process_time() - began)
        name = f"{name}, {args.side} x {args.side}"
        report.add(f"{name}, an observer", float(np.median(times)), "CPU-s", at_most=3.0)
        report.add(f"{name}: visible", 100 * seen.seen[0].area / seen.seen[0].of_area, "%")
        report.add(f"{name}: bound", 100 * seen.seen[0].area_bound / seen.seen[0].of_area, "%")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    report.add("greatest memory", memory, "GB")
    small = relief(min(args.side, 300))
    half = len(small) // 2
    eye = np.array((half, half, small[half, half] + 10))
    seen = rc.viewshed(
        small, (half * SPACING, -half * SPACING, 10.0), spacing=SPACING, curvature=False
    )
    usual = by_samples(small, eye)[:-1, :-1]
    wrong = (usual & (seen.share == 0)).sum() / max(1, usual.sum())
    report.add("hidden of the cells that lines of nearest samples call visible", 100 * wrong, "%")
    report.finish(args.json)


if __name__ == "__main__":
    main()
