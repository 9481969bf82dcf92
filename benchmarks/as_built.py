"""Poses of installed cameras from rendered photographs, against the true ones.

Photographs of `as_built_photos` are rendered into --photos where they are missing; without Mitsuba
those that are there are used, and none skips the program. Each is located four times: by edges from
a plan that errs by 1 degree and 1 % of the distance; from its true pose; from one turned by 1 to 3
degrees, where an alarm is due; and by eight corners of the mesh, clicked with an error of 1 px. An
accepted pose is right where every visible point of an edge lies within 2 px of its true pixel.
The share of the area that a camera covers at the pose found must lie, from that at the true one,
within what is possible and sure under the covariance. At last the time of a photograph of 12 Mpx
of 100,000 faces is measured.
"""

import json
import time
from collections import defaultdict
from importlib.util import find_spec
from pathlib import Path

import as_built_photos
import numpy as np
from installed_scenes import CAMERA, SCENES, pose_in
from rows import Report, arguments

import rastercov as rc
from rastercov.asbuilt.alignment import Aligner
from rastercov.asbuilt.located import Tolerance
from rastercov.asbuilt.photograph import read_photograph
from rastercov.asbuilt.resection import displaced, pixels_of, rotation_vector
from rastercov.asbuilt.rig import errors_of

RIGHT = 2.0
"""Largest error of a pixel of an accepted pose, px."""
TASK = rc.Task(max_incidence_deg=75)
Rows = dict[str, list[float]]


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, default=Path("build/photos"))
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 60), metavar=("FIRST", "END"))
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    args = parser.parse_args()
    report = Report()
    seeds = range(*args.seeds)
    if find_spec("mitsuba"):
        as_built_photos.render(args.photos, seeds, args.scenes)
    found: Rows = defaultdict(list)
    for name in args.scenes:
        mesh = SCENES[name]()
        for seed in seeds:
            path = args.photos / f"{name}_{seed}.jpg"
            if path.exists():
                measure(found, name, mesh, path, seed)
    if not found:
        print(f"skipped: Mitsuba is not there, and no photographs in {args.photos}")
        return
    summarise(report, found)
    report.add("12 Mpx, 100,000 faces", time_of_large(), "CPU-s", at_most=5)
    report.finish(args.json)


def time_of_large() -> float:
    """CPU seconds of a photograph of 12 Mpx: the cell, and balls of 102,400 faces, shaded."""
    balls = [
        rc.shapes.sphere(level).moved(scale=0.1, translation=(0.3 * level - 1.6, 0.3, 0.5))
        for level in (5, 6)
    ]
    mesh = rc.Mesh.joined([SCENES["cell"](), *balls])
    camera = CAMERA.resized(6.25)
    true = pose_in("cell", mesh, np.random.default_rng(0))
    with rc.open_rasterizer(mesh, camera, "cpu", supersample=1) as rasterizer:
        face = rasterizer.render(true).face
    photo = np.append(0.55 + 0.4 * mesh.normals @ (0.3, 0.5, 0.8), 0.5)[face]
    near = displaced(true, np.full(6, 0.005))
    start = time.process_time()
    rc.locate(mesh, camera, photo, near)
    return time.process_time() - start


def measure(found: Rows, name: str, mesh: rc.Mesh, path: Path, seed: int) -> None:
    """Locate a photograph in all ways, and print what comes of it."""
    true = np.load(path.with_suffix(".npy"))
    aligner = Aligner(mesh, CAMERA, read_photograph(path, CAMERA))
    seen = aligner.points_at(aligner.levels[-1], true, 2.0).points
    if len(seen) < 12:
        found["accepted"].append(False)
        found[f"accepted {name}"].append(False)
        print(json.dumps([name, seed, False, "sees no edges"]), flush=True)
        return
    distance = float(np.median(np.linalg.norm(seen - true[:3, 3], axis=1)))
    rng = np.random.default_rng((seed, 1))

    def error(pose: np.ndarray) -> float:
        """Largest error of a pixel, px."""
        apart = pixels_of(seen, CAMERA, pose) - pixels_of(seen, CAMERA, true)
        return float(np.nanmax(np.linalg.norm(apart, axis=1)))

    def off(degrees: float, share: float) -> np.ndarray:
        """True pose with errors in random directions."""
        turn, step = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
        return displaced(
            true, np.concatenate((turn * np.radians(degrees), step * share * distance))
        )

    edges = rc.locate(mesh, CAMERA, path, off(1, 0.01))
    is_right = error(edges.pose) <= RIGHT
    found["accepted"].append(edges.accepted)
    found[f"accepted {name}"].append(edges.accepted)
    found["right" if edges.accepted else "right of the others"].append(is_right)
    if not is_right:
        found["accepted of the wrong"].append(edges.accepted)
    if edges.accepted:
        found["share"].append(_holds_share(mesh, edges, true))
    tolerance = Tolerance(0.01 * distance, 0.5)
    same = tolerance.verdict(rc.locate(mesh, CAMERA, path, true))
    turned = tolerance.verdict(rc.locate(mesh, CAMERA, path, off(rng.uniform(1, 3), 0)))
    found["false alarm"].append(same == "moved")
    found["undecided"].append(same == "undecided")
    found["missed"].append(turned == "as planned")
    if turned != "undecided":
        found["alarm"].append(turned == "moved")
    by_points(found, mesh, path, true, seen, rng)
    told = error(edges.pose), edges.spread, edges.explained, same, turned, edges.why
    print(json.dumps([name, seed, edges.accepted, *told]), flush=True)


def by_points(
    found: Rows,
    mesh: rc.Mesh,
    path: Path,
    true: np.ndarray,
    seen: np.ndarray,
    rng: np.random.Generator,
) -> None:
    """Locate by sets of eight points of visible edges, with an error of 1 px."""
    for _ in range(SETS):
        points = seen[rng.choice(len(seen), 8, replace=False)]
        pixels = pixels_of(points, CAMERA, true) + rng.normal(size=(8, 2))
        near = displaced(true, rng.normal(size=6) * 0.01)
        got = rc.locate(mesh, CAMERA, path, near, np.hstack((pixels, points)))
        found["points accepted"].append(got.accepted)
        if got.accepted:
            turn = rotation_vector(got.pose[:3, :3].T @ true[:3, :3])
            error = np.concatenate((turn, got.pose[:3, :3].T @ (true[:3, 3] - got.pose[:3, 3])))
            square = error @ np.linalg.solve(got.covariance, error)
            found["ellipse"].append(square < CHI_95)
            found["three deviations"].append(
                bool(np.all(np.abs(error) < 3 * np.sqrt(np.diag(got.covariance))))
            )


SETS = 10
"""Sets of eight points of a photograph."""
CHI_95 = 12.592
"""Chi-squared of six degrees of freedom at 95 %."""


def _holds_share(mesh: rc.Mesh, edges: rc.Located, true: np.ndarray) -> bool:
    """True where the area at the true pose lies between what is sure and possible at that found."""
    place, turn = (float(each.split()[0]) for each in errors_of({0: edges}).split(",")[:2])
    errors = {"position_mm": place, "angle_deg": turn, "distribution": "normal"}
    got = rc.tolerance(mesh, CAMERA, rc.Poses.of(edges.pose[None]), TASK, **errors, draws=0)
    at_true = rc.tolerance(mesh, CAMERA, rc.Poses.of(true[None]), TASK, draws=0).nominal
    slack = at_true.bound + got.nominal.bound
    return got.sure.m2 - slack <= at_true.m2 <= got.possible.m2 + slack


def summarise(report: Report, found: Rows) -> None:
    """Rows of the table."""
    share = defaultdict(lambda: np.nan)  # where nothing was decided
    share |= {what: float(np.mean(values)) for what, values in found.items()}
    report.add("photographs", len(found["accepted"]), "")
    report.add("accepted by edges alone", share["accepted"], "of all", must=0.7)
    for what in sorted(found):
        if what.startswith("accepted ") and what.split()[1] in SCENES:
            report.add(f"  {what.split()[1]}", share[what], "of all")
    report.add("within 2 px everywhere", share["right"], "of the accepted", must=0.99)
    wrong = share.get("accepted of the wrong", 0.0)
    report.add("accepted", wrong, "of those not within 2 px", at_most=0.01)
    report.add("area within possible and sure", share["share"], "of the accepted", must=0.99)
    report.add("alarm when turned by 1 to 3 degrees", share["alarm"], "of the decided", must=0.99)
    report.add("taken as planned when turned", share["missed"], "of all", at_most=0.01)
    report.add("false alarm", share["false alarm"], "of all", at_most=0.01)
    report.add("undecided where nothing moved", share["undecided"], "of all")
    report.add("eight points: accepted", share["points accepted"], "of all")
    report.add("  all within three deviations", share["three deviations"], "of the accepted")
    report.add("  within the ellipse of 95 %", share["ellipse"], "of the accepted", must=0.92)
    report.add("  apart from 95 %", abs(share["ellipse"] - 0.95), "of them", at_most=0.03)


if __name__ == "__main__":
    main()
