"""Bodies that move: frames against meshes of moved vertices, layers against the whole, and costs.

An arm of boxes and cylinders over a part. Frames share what their rest pose decides; each is held
against a mesh that is made of its moved vertices alone. The parts that are seen past the scene are
those that are seen past each body alone. Costs are CPU times of one thread: of a frame beside its
regions, and of all frames with theirs, which cameras that no moved body overlaps keep.
"""

import statistics
from pathlib import Path

import numpy as np
from rows import Report, arguments, seconds
from swept_arm import CAMERAS, cell, frames, sweep

import rastercov as rc
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.table import join
from rastercov.core.exact.surface import surface_of
from rastercov.engine.solver_parts import contacts
from rastercov.motion.regions import ViewKeys

CAMERA = rc.Camera(width=1920, height=1200, fx=1500, fy=1500)
MOST_MS = {20_000: 5.0, 200_000: 20.0}
"""Time of a frame beside its regions, ms, by faces up to which it holds."""
REACH = 1.0
"""Distance of cameras for which contacts are asked, metres."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--mesh", type=Path, help="part of the large scene, instead of a teapot")
    args = parser.parse_args()
    report = Report()
    agree(report, cell(rc.shapes.by_name("torus")), args.frames)
    layers(report, cell(), min(args.frames, 12))
    teapot = rc.shapes.by_name("teapot")
    measure(report, "11,000 faces", cell(teapot, 200), args.frames)
    part = rc.Mesh.load(args.mesh) if args.mesh else rc.shapes.teapot(25)
    measure(report, "large", cell(part, 2000), min(args.frames, 10))
    report.finish(args.json)


def agree(report: Report, mesh: rc.Mesh, n: int) -> None:
    """Regions of every frame, and of a mesh of its moved vertices."""
    motion, task = rc.Motion(mesh, frames(sweep(n))), rc.Task()
    regions = rc.regions(mesh, CAMERA, CAMERAS, task, motion=motion, threads=1)
    areas, bounds = (each.reshape(n, 4, -1) for each in (regions.areas(), regions.bounds()))
    total, worst = mesh.areas[mesh.task_mask].sum(), 0.0
    for row in range(n):
        pose = motion.world_from_body[row, motion.body]
        corners = np.einsum("fij,fkj->fki", pose[:, :3, :3], mesh.vertices[mesh.faces])
        moved = (corners + pose[:, None, :3, 3]).reshape(-1, 3)
        faces = np.arange(len(moved)).reshape(-1, 3)
        plain = rc.Mesh(moved, faces, mesh.groups, mesh.face_group)
        own = rc.regions(plain, CAMERA, CAMERAS, task, threads=1)
        for one, other in ((areas[row], own.areas()), (bounds[row], own.bounds())):
            worst = max(worst, float(np.abs(one - other).max() / total))
    report.add(f"{n} frames: largest difference from moved vertices", worst, "of the area")
    report.check("frames are meshes of moved vertices, to 1e-9", worst <= 1e-9)


def layers(report: Report, mesh: rc.Mesh, n: int) -> None:
    """Parts seen past all bodies, and past the still scene and each body alone."""
    moves = frames(sweep(n))
    still = [group.name for group in mesh.groups if group.name not in moves]
    whole = rc.regions(mesh, CAMERA, CAMERAS, motion=rc.Motion(mesh, moves), threads=1)
    parts = []
    for body in moves:
        absent = {other: [False] * n for other in moves if other != body}
        motion = rc.Motion(mesh, moves, absent)
        parts.append(rc.regions(mesh, CAMERA, CAMERAS, motion=motion, threads=1))
    rows = np.tile(np.arange(4 * n), len(parts))
    both = join(parts).at_least(len(parts), rows, one_side=False)
    own = mesh.task_mask
    gap = np.abs(both.areas() - whole.areas())[:, own]
    allowed = (both.bounds() + whole.bounds())[:, own] + 1e-12
    worst = float(gap.max() / mesh.areas[own].sum())
    report.add(
        f"{len(parts)} layers on {', '.join(still)}: largest difference", worst, "of the area"
    )
    report.check("layers meet in the whole, within both bounds", bool((gap <= allowed).all()))


def measure(report: Report, name: str, mesh: rc.Mesh, n: int) -> None:
    """Times of frames, and of their regions."""
    motion, task = rc.Motion(mesh, frames(sweep(n))), rc.Task(max_incidence_deg=75)
    size = f"{name} ({mesh.n_faces:,} faces)"
    times = []
    for row in range(n):
        times.append(seconds(lambda row=row: built(motion, row)))
    most = next(limit for faces, limit in MOST_MS.items() if mesh.n_faces <= faces)
    frame = 1e3 * statistics.median(times[1:])
    report.add(f"{size}: a frame beside its regions", frame, "ms", at_most=most)
    report.add(f"{size}: the first frame, with the rest pose", 1e3 * times[0], "ms")
    whole = seconds(lambda: rc.regions(mesh, CAMERA, CAMERAS, task, motion=motion, threads=1))
    report.add(f"{size}: {n} frames of 4 cameras", whole, "s")
    sights, placed = ViewKeys(motion), rc.Poses.of(CAMERAS)
    axes = np.zeros((4, 3))  # no camera has parallel rays
    near = np.full(4, 1e-5)
    keys = {key for row in range(n) for key in sights.of(row, placed, near, axes)}
    report.add(f"{size}: pictures of {4 * n} that differ", len(keys), "pictures")


def built(motion: rc.Motion, row: int) -> None:
    """All of a frame that is not its regions."""
    mesh, _ = motion._at(row, of_occluders=False)
    surface = surface_of(mesh)
    frames_of(mesh)
    contacts(surface, REACH)


if __name__ == "__main__":
    main()
