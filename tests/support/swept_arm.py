"""An arm of six links, boxes and cylinders, over a part on a table; its joints and frames."""

import numpy as np

import rastercov as rc
from rastercov.core.mesh.arrays import rotation_about

AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1))
LENGTHS = (0.16, 0.42, 0.38, 0.1, 0.1, 0.08)
WIDTHS = (0.14, 0.11, 0.09, 0.08, 0.07, 0.06)


def box(size, centre):
    corners = np.array([(k & 1, k >> 1 & 1, k >> 2) for k in range(8)]) - 0.5
    faces = [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4)]
    faces += [(2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)]
    return corners * size + centre, np.array(faces)


def cylinder(radius, low, high, n):
    """Cylinder along z."""
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    points = [np.column_stack((ring, np.full(n, z))) for z in (low, high)]
    points = np.concatenate([*points, [(0, 0, low), (0, 0, high)]])
    k, after = np.arange(n), np.roll(np.arange(n), -1)
    sides = np.concatenate((
        np.column_stack((k, after, n + after)), np.column_stack((k, n + after, n + k)),
        np.column_stack((after, k, np.full(n, 2 * n))),
        np.column_stack((n + k, n + after, np.full(n, 2 * n + 1))),
    ))  # fmt: skip
    return points, sides


def meshes(parts):
    """One mesh of named parts, (name, points, faces, is_occluder)."""
    first = np.cumsum([0, *(len(points) for _, points, *_ in parts)])
    return rc.Mesh(
        np.concatenate([points for _, points, *_ in parts]),
        np.concatenate([f + at for (_, _, f, _), at in zip(parts, first, strict=False)]),
        [rc.Group(name, is_occluder=hides) for name, *_, hides in parts],
        np.repeat(np.arange(len(parts)), [len(f) for _, _, f, _ in parts]),
    )


def cell(part=None, n=24):
    """The part, the table, and the arm with its joints at 0; links run into each other."""
    part = rc.shapes.by_name("icosahedron") if part is None else part
    low, high = part.bounds
    points = (part.vertices - (*((low + high)[:2] / 2), low[2])) * 0.25 / (high - low).max()
    items = [("part", np.add(points, (0.45, 0, 0)), part.faces, False)]
    items.append(("table", *box((1.4, 1.2, 0.04), (0.3, 0, -0.02)), True))
    height = 0.0
    for k, (length, width) in enumerate(zip(LENGTHS, WIDTHS, strict=True)):
        tube, faces = cylinder(width / 2, 0, length, n)
        joint, others = box((width * 1.2, width * 1.3, width * 1.1), (0, 0, 0))
        points = np.add(np.concatenate((tube, joint)), (0, 0, height))
        items.append((f"link{k + 1}", points, np.concatenate((faces, others + len(tube))), True))
        height += length
    return meshes(items)


def frames(joints):
    """Poses (T, 4, 4) of each link from its rest pose, by (T, 6) angles."""
    pivots = np.cumsum((0, *LENGTHS))[:-1]
    table = {f"link{k + 1}": [] for k in range(6)}
    for row in joints:
        pose = np.eye(4)
        for k, (axis, pivot, angle) in enumerate(zip(AXES, pivots, row, strict=True)):
            turn = np.eye(4)
            turn[:3, :3] = rotation_about(np.array(axis, float), angle)
            turn[:3, 3] = (0, 0, pivot) - turn[:3, :3] @ (0, 0, pivot)
            pose = pose @ turn
            table[f"link{k + 1}"].append(pose)
    return {name: np.array(poses) for name, poses in table.items()}


def sweep(steps):
    """(T, 6) joint angles of a motion over the part and back beside it."""
    t = np.linspace(0, 1, steps)[:, None]
    start = np.array((-1.2, 0.4, 0.9, 0.0, 0.8, 0.0))
    return start + t * np.array((2.4, 0.3, 0.2, 1.0, 0.4, 2.0))


CAMERAS = rc.look_at(
    eyes=[(0.9, 0.8, 0.9), (-0.1, 0.9, 0.8), (0.95, -0.8, 0.7), (0.4, 0.1, 1.5)],
    targets=(0.45, 0, 0.08),
)
