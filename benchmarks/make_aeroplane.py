"""Remake rastercov/data/aeroplane.npz: superellipsoids, united and decimated to given counts.

Needs the `shapes` extra (manifold3d, fast-simplification). Without `--write` the file is left
alone, and what it holds is compared with what was remade. Exits 1 when a mesh is not what
`rastercov.core.mesh.shapes.aeroplane` promises.

    python benchmarks/make_aeroplane.py [--write] [--json]
"""

from pathlib import Path
from typing import Any

import fast_simplification
import numpy as np
from manifold3d import Manifold
from manifold3d import Mesh as ManifoldMesh
from numpy.typing import NDArray
from rows import Report, arguments

from rastercov.core.mesh import Mesh

Points = NDArray[np.float64]
STORED = Path(__file__).parents[1] / "rastercov" / "data" / "aeroplane.npz"
# Faces wanted: density of the rings before the union. Few faces more than wanted make the union,
# so that decimation only takes the slivers and the flattest spots.
DENSITY = {1970: 0.9, 9856: 2.05}
SLIVER = 0.005  # metres; moves that the clean-up after the union may make at density 1


def loft(axis: int, centres: Points, semi_axes: Points, n_around: int) -> Manifold:
    """Solid through ellipses across `axis`; the first and last are points.

    `centres` (S, 3), increasing along `axis`; `semi_axes` (S, 2) along the next two axes in the
    order x, y, z, x; metres.
    """
    u, v = (axis + 1) % 3, (axis + 2) % 3
    turn = 2 * np.pi / n_around * np.arange(n_around)
    rings = np.repeat(centres[1:-1, None], n_around, axis=1)
    rings[..., u] += semi_axes[1:-1, :1] * np.cos(turn)
    rings[..., v] += semi_axes[1:-1, 1:] * np.sin(turn)
    a = np.arange(rings[..., 0].size).reshape(-1, n_around)
    b = np.roll(a, -1, axis=1)
    first, last = np.full(n_around, a.size), np.full(n_around, a.size + 1)
    faces = [
        np.stack([a[:-1], b[:-1], b[1:]], axis=-1).reshape(-1, 3),
        np.stack([a[:-1], b[1:], a[1:]], axis=-1).reshape(-1, 3),
        np.stack([b[0], a[0], first], axis=-1),
        np.stack([a[-1], b[-1], last], axis=-1),
    ]
    points = np.concatenate([rings.reshape(-1, 3), centres[:1], centres[-1:]])
    return to_manifold(points, np.concatenate(faces))


def to_manifold(vertices: NDArray[Any], faces: NDArray[Any]) -> Manifold:
    return Manifold(ManifoldMesh(vertices.astype(np.float32), faces.astype(np.uint32)))


def aeroplane(density: float) -> Manifold:
    def stations(n: int) -> Points:  # -1 ... 1, closer at the ends
        s = np.linspace(-1, 1, round(n * density) + 1)
        return 0.5 * s + 0.5 * np.sin(np.pi / 2 * s)

    def columns(*values: Any) -> Points:
        return np.stack(np.broadcast_arrays(*values), axis=-1).astype(np.float64)

    def fuselage() -> Manifold:
        t = stations(30)
        tail = np.clip((4 - 15 * t) / 19, 0, 1)
        radius = 1.95 * np.sqrt(1 - np.clip(t, 0, 1) ** 3.2) * (1 - tail**2.6) ** 0.8
        centres = columns(15 * t, 0, 0.9 * tail**2)
        return loft(0, centres, columns(radius, radius), round(20 * density))

    def wings(
        span: float, root: list[float], tip: list[float], chords: list[float], counts: list[int]
    ) -> Manifold:
        """Both wings: (x, z) of root and tip, chords there, (stations, points around)."""
        t = stations(counts[0])
        u, bow = np.abs(t), span / 2 * t**2
        taper = (1 - u) ** 1.4
        chord = (chords[1] + (chords[0] - chords[1]) * taper) * np.sqrt(1 - u**6)
        x = root[0] + (tip[0] - root[0]) * u - 0.05 * bow
        z = root[1] + (tip[1] - root[1]) * u + 0.02 * bow
        semi_axes = columns(0.07 * chord, 0.5 * chord)
        return loft(1, columns(x, span / 2 * t, z), semi_axes, round(counts[1] * density))

    def upright(
        y: float, foot: list[float], top: list[float], chords: list[float], counts: list[int]
    ) -> Manifold:
        """Fin or engine pylon: (x, z) of foot and top, chords there, (stations, around)."""
        t = stations(counts[0])
        w = (t + 1) / 2
        chord = (chords[0] + (chords[1] - chords[0]) * w) * np.sqrt(1 - t**6)
        z = foot[1] + (top[1] - foot[1]) * w
        x = foot[0] + (top[0] - foot[0]) * w + 0.08 * (top[1] - foot[1]) * w * (1 - w)
        semi_axes = columns(0.5 * chord, 0.06 * chord)
        return loft(2, columns(x, y, z), semi_axes, round(counts[1] * density))

    def engine(y: float) -> Manifold:
        t = stations(10)
        radius = np.sqrt(1 - t**6) * (1.15 - 0.25 * (t < 0) * t**2)
        nacelle = loft(
            0, columns(2.9 + 2.3 * t, y, -2.3), columns(radius, radius), round(14 * density)
        )
        return nacelle + upright(y, [2.6, -2.3], [0.4, -0.3], [2.4, 3.2], [6, 12])

    parts = [
        fuselage(),
        wings(29, [1.5, -0.9], [-4, 0.5], [6.4, 1.8], [26, 16]),
        wings(10.8, [-11.6, 1.0], [-13.6, 1.5], [3.8, 1.6], [14, 12]),
        upright(0, [-10.8, 0.6], [-14, 7], [5.4, 2.2], [10, 12]),
        engine(5.2),
        engine(-5.2),
    ]
    united = parts[0]
    for part in parts[1:]:
        united += part
    return united.as_original().simplify(SLIVER / density)


def decimated(n_faces: int) -> Mesh:
    fine = aeroplane(DENSITY[n_faces]).to_mesh()
    points = np.array(fine.vert_properties[:, :3], dtype=np.float32)
    corners = np.array(fine.tri_verts, dtype=np.int32)
    vertices, faces = fast_simplification.simplify(points, corners, target_count=n_faces)
    return Mesh(vertices=vertices.astype(np.float32), faces=faces)


def check(report: Report, n_faces: int, mesh: Mesh) -> None:
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flawed = mesh.degenerate_mask | mesh.duplicate_mask
    what = f"aeroplane {n_faces}"
    for figure, value, wanted in (
        ("faces", mesh.n_faces, n_faces),
        ("vertices", mesh.n_vertices, n_faces // 2 + 2),  # closed, genus 0: V = F/2 + 2
        ("closed, wound alike, outward", mesh.can_cull_back_faces, True),
        ("bodies", len(to_manifold(mesh.vertices, mesh.faces).decompose()), 1),
        ("degenerate or duplicate", int(flawed.sum()), 0),
        ("faces that touch or cut another", int(mesh.contacts.faces_for().sum()), 0),
    ):
        report.check(f"{what}: {figure}, {value}: must be {wanted}", value == wanted)
    report.add(f"{what}: smallest face", float(mesh.areas.min()), "m^2")
    report.add(f"{what}: median slenderness", float(np.median(longest**2 / mesh.areas)), "")


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"overwrite {STORED.name}")
    args = parser.parse_args()
    report = Report()
    arrays: dict[str, NDArray[Any]] = {}
    for n_faces in DENSITY:
        mesh = decimated(n_faces)
        arrays[f"vertices_{n_faces}"] = mesh.vertices.astype(np.float32)
        arrays[f"faces_{n_faces}"] = mesh.faces.astype(np.uint16)
        check(report, n_faces, mesh)
    if args.write and not report.failed:
        np.savez_compressed(STORED, allow_pickle=False, **arrays)
    with np.load(STORED, allow_pickle=False) as stored:
        is_same = all(np.array_equal(stored[name], array) for name, array in arrays.items())
    # Library versions may differ.
    report.add("stored file equals remade one", int(is_same), "", aim=1)
    report.finish(args.json)


if __name__ == "__main__":
    main()
