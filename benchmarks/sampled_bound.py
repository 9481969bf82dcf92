"""Share of figures of method "sampled" whose bound holds, on generic and machined parts.

For every face that is partly hidden in truth (method "exact", checked against polygon Booleans), in
view from the front, the visible fraction from samples is compared with the true one: it must be
within the bound that `coverage.observer.figures` gives with it. Faces are sorted into classes by
the samples they would own alone. Generic meshes are turned at random; machined parts are seen
frontally, so that their edges run along pixel rows and columns, or at 30, 45 and 60 degrees to
them, which is where samples in rows of pixels fail. Both grids of samples are measured, and with
the rolled one the bound must hold for 99.9 % in every class.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from rows import Report, arguments
from scenes import joined

import rastercov as rc
from rastercov.core.coverage.coverage import ROLL
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.mesh import shapes
from rastercov.reference import polygons
from rastercov.reference.coverage import measure_geometry as face_geometry
from rastercov.reference.methods.convergence import fractions

CAMERA = rc.Camera(width=320, height=240, fx=310, fy=290, cx=163.7, cy=118.2)
SUPERSAMPLES = (1, 2, 3, 4, 6, 8, 12, 16)
CLASSES = (1, 4, 16, 64, 256, 1024, 4096, np.inf)
ENOUGH = 1000
"""Faces without which a class says nothing about 99.9 %."""
SCENES_CHECKED, FACES_CHECKED = 4, 40


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=20, help="scenes of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--roll", type=float, default=ROLL, help="radians")
    args = parser.parse_args()
    report = Report()
    for kind, make in {"generic": generic, "machined": machined}.items():
        rng = np.random.default_rng(args.seed)
        items_by_key: dict[str, list[np.ndarray]] = {"rows of pixels": [], "rolled": []}
        for number, (mesh, pose) in enumerate(make(rng, args.scenes)):
            true = truth(mesh, pose)
            if number < SCENES_CHECKED:
                _check(report, f"{kind}, scene {number}", mesh, pose, true)
            for name, roll in zip(items_by_key, (0.0, args.roll), strict=True):
                items_by_key[name] += [compare(mesh, pose, true, s, roll) for s in SUPERSAMPLES]
        for name, parts in items_by_key.items():
            _add(report, f"{kind}, {name}", np.concatenate(parts, axis=1), name == "rolled")
    report.finish(args.json)


def _check(report: Report, what: str, mesh: rc.Mesh, pose: np.ndarray, true: np.ndarray) -> None:
    """Is the truth that of polygon Booleans, on some faces of the scene."""
    faces = np.flatnonzero(np.isfinite(true) & face_geometry(mesh, CAMERA, pose).is_front)
    faces = faces[:: max(1, len(faces) // FACES_CHECKED)]
    area = polygons.image_area(mesh, CAMERA, pose, faces)
    seen = polygons.visible_area(mesh, CAMERA, pose, faces)
    report.check(f"{what}: truth", bool((np.abs(seen - true[faces] * area) <= 1e-6).all()))


def _add(report: Report, what: str, figures: np.ndarray, must_hold: bool) -> None:
    drawn, error, bound = figures
    for low, high in pairwise(CLASSES):
        chosen = (drawn >= low) & (drawn < high)
        if not chosen.any():
            continue
        size = f"{low:.0f} to {high - 1:.0f}" if np.isfinite(high) else f"{low:.0f} or more"
        label = f"{what}, {size} samples"
        held = error[chosen] <= bound[chosen]
        rms = np.sqrt(np.mean(error[chosen] ** 2))
        must = 99.9 if must_hold and chosen.sum() >= ENOUGH else None
        report.add(f"{label}: faces", int(chosen.sum()), "faces")
        report.add(f"{label}: bound holds", 100 * held.mean(), "%", must)
        report.add(f"{label}: rms error", rms, "of the face")
        report.add(f"{label}: mean bound", bound[chosen].mean(), "of the face")
        report.add(f"{label}: worst", (error[chosen] / bound[chosen]).max(), "bounds")


def truth(mesh: rc.Mesh, pose: np.ndarray) -> np.ndarray:
    """True visible fraction of each front face that is partly hidden, NaN for others, (F,)."""
    fraction = rc.evaluate(
        mesh, CAMERA, pose, method="exact", fields=["visibility"], by="face"
    ).visibility[0]
    return np.where((fraction > 1e-9) & (fraction < 1 - 1e-9), fraction, np.nan)


def compare(
    mesh: rc.Mesh, pose: np.ndarray, true: np.ndarray, supersample: int, roll: float
) -> np.ndarray:
    """Samples drawn, error and bound of each partly hidden face that owns samples, (3, N)."""
    with rc.open_rasterizer(mesh, CAMERA, "cpu", supersample=supersample, roll=roll) as rasterizer:
        counts = rasterizer.count(pose)
    view = face_geometry(mesh, CAMERA, pose)
    result = fractions(FacePass(mesh, CAMERA, 1), counts, rc.Poses.of(pose))
    value, bound = result[0][0], result[1][0]
    chosen = view.is_front & np.isfinite(true) & (counts.drawn[0] > 0)
    return np.stack((counts.drawn[0], np.abs(value - true), bound))[:, chosen]


def generic(rng: np.random.Generator, n: int) -> Iterator[tuple[rc.Mesh, np.ndarray]]:
    """Meshes seen from anywhere: open, closed, coarse, fine, and spheres that hide each other."""
    for _ in range(n):
        for mesh, distance in (
            (shapes.teapot(int(rng.integers(3, 8))), 1.1),
            (shapes.torus(int(rng.integers(12, 50)), int(rng.integers(6, 25))), 1.1),
            (shapes.aeroplane(), 0.8),
            (_spheres(rng, 12), 1.2),
        ):
            middle, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
            away = rng.normal(size=3)
            eye = middle + away / np.linalg.norm(away) * distance * size
            yield mesh, rc.look_at(eye, middle, up=rng.normal(size=3))[0]


def machined(rng: np.random.Generator, n: int) -> Iterator[tuple[rc.Mesh, np.ndarray]]:
    """Boxes before boxes, and hexagonal and octagonal bars before each other, seen end on."""
    for _ in range(n):
        for sides in (4, 4, 6, 8, 12):
            yield _bars(rng, sides, 40), rc.look_at((0, 0, -4), (0, 0, 0), up=(0, -1, 0))[0]


def _spheres(rng: np.random.Generator, n: int) -> rc.Mesh:
    parts = [shapes.sphere(int(rng.integers(1, 3)), rng.uniform(0.3, 0.9)) for _ in range(n)]
    return joined(*(rc.Mesh(p.vertices + rng.uniform(-1.5, 1.5, 3), p.faces) for p in parts))


def _bars(rng: np.random.Generator, sides: int, n: int) -> rc.Mesh:
    """Upright bars of random size; a regular base with a horizontal edge, rectangles for 4."""
    parts = []
    for _ in range(n):
        turn = (np.arange(sides) + 0.5) * 2 * np.pi / sides + np.pi / 2
        outline = np.stack((np.sin(turn), np.cos(turn)), axis=1)
        outline *= rng.uniform(0.1, 0.6, 2 if sides == 4 else 1)
        outline += rng.uniform(-1.8, 1.8, 2)
        rings = int(rng.integers(1, 5))
        parts.append(_bar(outline, rng.uniform(-1, 1), rng.uniform(0.05, 0.5), rings))
    return joined(*parts)


def _bar(outline: np.ndarray, z: float, depth: float, rings: int) -> rc.Mesh:
    """Ends of concentric rings of triangles, and the walls between them; outward."""
    n = len(outline)
    middle = outline.mean(axis=0)
    ends = []
    for height in (z, z + depth):
        scaled = [middle + (outline - middle) * k / rings for k in range(1, rings + 1)]
        flat = np.concatenate((middle[None], *scaled))
        ends.append(np.column_stack((flat, np.full(len(flat), height))))
    here = np.arange(n)
    there = (here + 1) % n
    faces = [np.stack((np.zeros(n, int), 1 + here, 1 + there), axis=1)]
    for ring in range(rings - 1):
        inner, outer = 1 + ring * n, 1 + (ring + 1) * n
        faces += [
            np.stack((inner + here, outer + here, outer + there), axis=1),
            np.stack((inner + here, outer + there, inner + there), axis=1),
        ]
    end = np.concatenate(faces)
    back = len(ends[0])
    rim = 1 + (rings - 1) * n
    walls = [
        np.stack((rim + here, back + rim + here, back + rim + there), axis=1),
        np.stack((rim + here, back + rim + there, rim + there), axis=1),
    ]
    return rc.Mesh(np.concatenate(ends), np.concatenate((end, back + end[:, ::-1], *walls)))


if __name__ == "__main__":
    main()
