"""Bits of covered pairs, judged while their counts are in the cache, beside whole arrays in numpy.

Scenes are hostile or random (near planes through faces, one face over the image, coplanar copies,
two-sided faces, occluders, targets, lenses, parallel rays, 1 to 9 samples in a pixel), or a torus
of 10,000 faces seen from around and from within. Each task has one criterion, every criterion in
turn, or several. Counts come from the rasteriser; `rastercov.reference.coverage` has the reasons
of pinholes, and the pass over all figures those of other cameras. `--pairs` is the least number
of pairs for each criterion.
"""

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np
from rows import Report, arguments  # makes tests/support importable

# isort: split
from judged_scenes import scene_of

import rastercov as rc
from rastercov.core.coverage.coverage import ROLL
from rastercov.core.raster.contract import Observation, area_units
from rastercov.reference.coverage import figures_of_pose

TOLERANCE_REL = 1e-12
"""Of angles at a threshold, of which numpy rounds the arccosine otherwise."""
EVERY_NTH = 40
"""Scenes of which one is a torus: it has as many pairs as a thousand others."""

Scene = tuple[rc.Mesh, rc.Camera, np.ndarray, int]


def criteria(rng: np.random.Generator, mesh: rc.Mesh, camera: rc.Camera) -> dict[str, rc.Task]:
    """A random task for each criterion, by its name, and one for several."""
    density = camera.fx / (mesh.diagonal or 1.0) * 10.0 ** rng.uniform(-1, 1)
    least = {
        "min_pixels": rng.uniform(0.2, 9),
        "min_visibility": rng.uniform(0.05, 1),
        "min_coverage": rng.uniform(0.05, 1),
        "max_incidence_deg": rng.uniform(5, 90),
    }
    if not camera.is_parallel:
        least |= {
            "min_pixel_density": density,
            "min_facing_density": density,
            "min_pixels_per_m2": density**2,
        }
    tasks = {name: rc.Task(**{name: float(value)}) for name, value in least.items()}
    some = rng.choice(list(least), 3, replace=False).tolist()
    is_capped = bool(rng.random() < 0.5)
    several = {name: float(least[name]) for name in some}
    tasks["several"] = rc.Task(**several, cap_resolution=is_capped)
    return tasks | {"none": rc.Task()}


def scenes() -> Iterator[Scene]:
    """Scenes without end, by their numbers."""
    number = 0
    while True:
        rng = np.random.default_rng(number)
        number += 1
        if number % EVERY_NTH:
            yield scene_of(rng)
            continue
        mesh = rc.shapes.torus()
        eyes = rng.normal(size=(6, 3)) * mesh.diagonal * rng.choice((0.2, 1))
        camera = rc.Camera.from_fov(256, 256, hfov_deg=float(rng.uniform(30, 100)))
        yield mesh, camera, rc.look_at(eyes, rng.normal(size=(6, 3)) * 0.1 * mesh.diagonal), 1


def compare(scene: Scene, task: rc.Task) -> tuple[int, int, int]:
    """Pairs of a scene, those covered, and wrong bits, areas and views."""
    mesh, camera, poses, supersample = scene
    engine = rc.Engine("sampled", "cpu", supersample, threads=2)
    run = (mesh, camera, poses, task)
    bits = rc.evaluate(*run, method=engine, fields=("covered",)).bits
    covered = rc.evaluate(*run, method=engine).reason == rc.Reason.COVERED
    sure = np.ones_like(covered)
    if camera.model == "pinhole":
        options = {"supersample": supersample, "roll": ROLL, "threads": 1}
        with rc.open_rasterizer(mesh, camera, "cpu", **options) as rasterizer:
            seen = Observation.of_counts(rasterizer.count(poses))
        limit = math.radians(task.max_incidence_deg)
        for row, pose in enumerate(poses):
            figures = figures_of_pose(mesh, camera, task, pose, seen, row)
            covered[row] = figures["reason"] == rc.Reason.COVERED
            sure[row] = np.abs(figures["incidence"] - limit) > TOLERANCE_REL
    found = bits.dense()
    wrong = int(((found != covered) & sure).sum())
    wrong += int((bits.area_units != found @ area_units(mesh)).sum())
    wrong += int((bits.views != found.sum(axis=0)).sum())
    return covered.size, int(covered.sum()), wrong


def main() -> None:
    """Compare scene after scene until each criterion has its pairs."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=10_000_000)
    args = parser.parse_args()
    report, pairs, covered, wrong = Report(), Counter(), Counter(), Counter()
    for number, scene in enumerate(scenes()):
        mesh, camera, *_ = scene
        for name, task in criteria(np.random.default_rng(number), mesh, camera).items():
            if pairs[name] < args.pairs:
                found = compare(scene, task)
                for total, value in zip((pairs, covered, wrong), found, strict=True):
                    total[name] += value
        if min(pairs.values()) >= args.pairs:
            break
    for name in pairs:
        report.add(f"{name}: pairs judged", pairs[name], "pairs")
        report.add(f"{name}: of these covered", covered[name], "pairs")
        report.check(f"{name}: bits, areas and views of whole arrays", wrong[name] == 0)
    report.finish(args.json)


if __name__ == "__main__":
    main()
