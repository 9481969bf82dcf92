"""Viewsheds of rasters: CPU seconds an observer, memory, and wrong samples of other programs.

python benchmarks/terrain.py [heights along a side] [--raster dem.tif] [--python P] [--json]

GDAL, GRASS and xarray-spatial (of the interpreter P) are asked where they are installed, on the
plane earth, from the middle of the raster (one of mountains unless given) and 10 m above it. Their
samples are compared with exact lines of sight over the same surface, in integers.
"""

import resource
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
from PIL import Image
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh.files import raster_of
from rastercov.core.mesh.terrain import Raster
from rastercov.survey.geo import geotiff

SPACING = 30.0
HEIGHT = 10.0
"""Of the eyes above the ground, m."""
LINES = 400
"""Random samples to which exact lines of sight are drawn."""
XARRAY = """
import sys, time
import numpy as np, xarray, xrspatial
from PIL import Image
heights = np.asarray(Image.open(sys.argv[1]), float)
x, y, dx, dy, column, row = map(float, sys.argv[3:9])
xs = x + dx * (np.arange(heights.shape[1]) - column)
ys = y - dy * (np.arange(heights.shape[0]) - row)
raster = xarray.DataArray(heights, coords={"y": ys, "x": xs}, dims=("y", "x"))
for _ in range(2):  # numba compiles in the first
    began = time.process_time()
    angles = xrspatial.viewshed(raster, x=x, y=y, observer_elev=float(sys.argv[9]))
Image.fromarray((angles.values != -1).astype(np.uint8)).save(sys.argv[2])
print(time.process_time() - began)
"""
"""Program that writes what xarray-spatial sees, and prints its CPU seconds without compilation."""


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


def is_visible(heights: list[list[int]], eye: tuple[int, int, int], i: int, j: int) -> bool:
    """True where no side of a triangle crosses the line from the eye to a sample, exactly.

    The line crosses rows, columns and diagonals of the grid at parts n / d of its length.
    """
    down, right, rise = i - eye[0], j - eye[1], heights[i][j] - eye[2]
    for steps, side in ((down, (0, 1)), (right, (1, 0)), (down - right, (1, 1))):
        d = abs(steps)
        for n in range(1, d):
            row, down_part = divmod(eye[0] * d + n * down, d)
            column, right_part = divmod(eye[1] * d + n * right, d)
            part = down_part if side[0] else right_part
            step = part > 0
            following = heights[row + side[0] * step][column + side[1] * step]
            ground = heights[row][column] * (d - part) + following * part
            if ground > eye[2] * d + n * rise:
                return False
    return True


def exact_samples(heights: np.ndarray, row: int, column: int) -> dict[tuple[int, int], bool]:
    """True of random samples that are visible from above another one, on triangles."""
    scaled = [[int(each) for each in line] for line in (heights * 2.0**80).tolist()]
    eye = (row, column, scaled[row][column] + int(HEIGHT * 2**80))
    rng = np.random.default_rng(0)
    places = rng.integers((0, 0), heights.shape, (LINES, 2)).tolist()
    return {(i, j): is_visible(scaled, eye, i, j) for i, j in places if (i, j) != (row, column)}


def run(command: list[str]) -> float:
    """CPU seconds of a program, as it prints them or as counted."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if XARRAY in command:
        return float(printed)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def commands(
    path: Path, raster: Raster, at: tuple[int, int], python: str, out: Path
) -> dict[str, list[str]]:
    """Commands of the programs that are here, which write whether each sample is visible."""
    row, column = at
    place = raster.origin[0] + raster.xy[0][column], raster.origin[1] + raster.xy[1][row]
    x, y = (f"{each:.10g}" for each in place)
    found = {}
    if subprocess.run([python, "-c", "import xrspatial"], capture_output=True).returncode == 0:
        numbers = *place, *raster.spacing, column, row, HEIGHT
        files = str(path), str(out / "xarray-spatial.tif")
        found["xarray-spatial"] = [python, "-c", XARRAY, *files, *map(str, numbers)]
    if shutil.which("gdal_viewshed"):
        eye = ["-ox", x, "-oy", y, "-oz", str(HEIGHT), "-cc", "0", "-md", "0"]
        found["GDAL"] = ["gdal_viewshed", "-q", *eye, str(path), str(out / "GDAL.tif")]
    if shutil.which("grass"):
        steps = (
            f"r.in.gdal -o -e input={path} output=d",
            "g.region raster=d",
            f"r.viewshed -b input=d output=v coordinates={x},{y} observer_elevation={HEIGHT}",
            f"r.out.gdal input=v type=Byte output={out / 'GRASS.tif'}",
        )
        shell = ["sh", "-c", " && ".join(steps)]
        found["GRASS"] = ["grass", "--tmp-location", str(path), "--exec", *shell]
    return found


def compare(report: Report, path: Path, python: str) -> None:
    """Samples of others against exact lines of sight, and against the visible area around them."""
    raster = raster_of(path)
    row, column = (each // 2 for each in raster.heights.shape)
    place = [raster.origin[k] + raster.xy[k][at] for k, at in enumerate((column, row))]
    began = time.process_time()
    seen = rc.viewshed(path, place, height=HEIGHT, curvature=False)
    report.add(f"{path.name}: rastercov", time.process_time() - began, "CPU-s")
    padded = np.pad(seen.share, 1, constant_values=np.nan)
    rows, columns = raster.heights.shape
    around = [padded[i : i + rows, j : j + columns] for i in (0, 1) for j in (0, 1)]
    with warnings.catch_warnings(action="ignore"):  # of holes
        most, least = np.nanmax(around, axis=0), np.nanmin(around, axis=0)
    exact = {} if np.isnan(raster.heights).any() else exact_samples(raster.heights, row, column)
    # A visible point has something visible around it, a hidden one something hidden.
    wrong = sum(most[at] < 1e-12 if seen else least[at] > 1 - 1e-12 for at, seen in exact.items())
    report.add(f"rastercov: against {len(exact)} exact lines of sight", wrong, "wrong", at_most=0)
    with tempfile.TemporaryDirectory() as name:
        found = commands(path, raster, (row, column), python, Path(name))
        for program in sorted({"GDAL", "GRASS", "xarray-spatial"} - set(found)):
            print(f"{program}: not installed, not compared")
        for program, command in found.items():
            report.add(f"{path.name}: {program}", run(command), "CPU-s")
            with Image.open(Path(name, f"{program}.tif")) as image:
                visible = (np.asarray(image) > 0) & np.isfinite(most)
            wrong = sum(bool(visible[at]) != seen for at, seen in exact.items())
            share = 100 * wrong / max(len(exact), 1)
            report.add(f"{program}: samples unlike exact lines of sight", share, "%")
            wrong = 100 * (visible & (most == 0)).sum() / visible.sum()
            report.add(f"{program}: nothing visible around visible samples", wrong, "%")
            missed = 100 * (~visible & (least > 1 - 1e-9)).sum() / (least > 1 - 1e-9).sum()
            report.add(f"{program}: hidden samples within what is visible", missed, "%")
            area = visible.sum() * raster.spacing[0] * raster.spacing[1]
            report.add(f"{program}: area", 100 * (area / seen.seen[0].area - 1), "% off")


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("side", type=int, nargs="?", default=1001, help="heights along a side")
    parser.add_argument("--raster", type=Path, action="append", help="compare other programs on it")
    parser.add_argument("--python", default=sys.executable, help="that imports xarray-spatial")
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
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "mountains.tif")
        tags = geotiff.tags_of((500000, 5300000), (SPACING, SPACING), 32632, "UTM 32N")
        path.write_bytes(geotiff.encode(kinds["mountains"].astype(np.float32), tags))
        for each in args.raster or [path]:
            compare(report, each, args.python)
    report.finish(args.json)


if __name__ == "__main__":
    main()
