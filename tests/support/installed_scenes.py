"""Scenes in which cameras are installed, and poses of these: room, part, aeroplane, cell, house."""

import numpy as np

import rastercov as rc

CAMERA = rc.Camera.from_fov(640, 480, hfov_deg=60)
"""Camera of their photographs."""
SECTIONS = 32
"""Corners of a circle."""


def box(size: tuple[float, ...], centre: tuple[float, ...], turned_deg: float = 0.0) -> rc.Mesh:
    """Box, turned about its vertical axis."""
    return rc.shapes.box(size).moved(axis=(0, 0, 1), angle_deg=turned_deg, translation=centre)


def extruded(points: np.ndarray, faces: np.ndarray, height: float) -> rc.Mesh:
    """Solid above flat faces (F, 3), counter-clockwise, of points (V, 2)."""
    n = len(points)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    a, b = edges[first[count == 1]].T
    sides = np.concatenate((np.stack((a, b, b + n), 1), np.stack((a, b + n, a + n), 1)))
    solid = np.concatenate((faces[:, ::-1], faces + n, sides))
    levels = [np.column_stack((points, np.full(n, z))) for z in (0.0, height)]
    return rc.Mesh(np.concatenate(levels), solid)


def cylinder(radius: float, height: float, centre: tuple[float, ...]) -> rc.Mesh:
    """Upright cylinder."""
    angles = np.arange(SECTIONS) * 2 * np.pi / SECTIONS
    points = radius * np.column_stack((np.cos(angles), np.sin(angles)))
    k = np.arange(1, SECTIONS - 1)
    fan = np.column_stack((np.zeros_like(k), k, k + 1))
    low = np.subtract(centre, (0, 0, height / 2))
    return extruded(points, fan, height).moved(translation=tuple(low))


def plate(cell: float, radii: np.ndarray, height: float) -> rc.Mesh:
    """Plate of square cells, each with a hole of a radius (rows, columns); 0 for none."""
    angles = (np.arange(SECTIONS) + 0.5) * 2 * np.pi / SECTIONS
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    square = circle / np.abs(circle).max(axis=1, keepdims=True) * cell / 2
    square = np.insert(square, np.arange(3, SECTIONS, 8) + 1, _CORNERS * cell / 2, axis=0)
    m = len(square)
    ring = np.arange(m)
    following = (ring + 1) % m
    points, faces = [], []
    for (row, column), radius in np.ndenumerate(radii):
        inner = square / np.linalg.norm(square, axis=1, keepdims=True) * radius
        start = sum(map(len, points))
        points.append(np.concatenate((square, inner)) + np.array((column, row)) * cell)
        quads = [(ring, following, following + m), (ring, following + m, ring + m)]
        faces += [np.stack(each, 1) + start for each in quads[: 2 if radius else 1]]
    place, triangles = np.concatenate(points), np.concatenate(faces)
    _, one, of = np.unique(place.round(9), axis=0, return_index=True, return_inverse=True)
    middle = (np.array(radii.shape[::-1]) - 1) * cell / 2
    return extruded(place[one] - middle, of.ravel()[triangles], height)


_CORNERS = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1)))


def part() -> rc.Mesh:
    """Bracket of two plates with holes, a rib and a stud, 140 mm wide."""
    base = plate(0.035, np.array(((0, 0.012, 0, 0), (0.008, 0, 0, 0.008), (0, 0, 0, 0))), 0.01)
    back = plate(0.035, np.array(((0, 0, 0, 0), (0, 0.01, 0.01, 0))), 0.01)
    back = back.moved(axis=(1, 0, 0), angle_deg=90, translation=(0, 0.0525, 0.045))
    flat = np.array(((0, 0), (0.06, 0), (0, 0.06)))
    rib = extruded(flat, np.array(((0, 1, 2),)), 0.008)
    rib = rib.moved(axis=(1, 0, 0), angle_deg=90).moved(axis=(0, 0, 1), angle_deg=-90)
    stud = cylinder(0.014, 0.03, (0.045, -0.03, 0.025))
    return rc.Mesh.joined([base, back, rib.moved(translation=(0.004, 0.0425, 0.01)), stud])


def cell() -> rc.Mesh:
    """Machine cell of 4 x 4 m: walls, a robot, a bench, a cabinet, a conveyor with parts."""
    parts = [
        box((4, 4, 0.05), (0, 0, -0.025)), box((4, 0.05, 2), (0, 2, 1)),
        box((0.05, 4, 2), (-2, 0, 1)), box((1.2, 0.8, 0.75), (0, 0, 0.375)),
        box((0.3, 0.3, 0.4), (0.3, 0.1, 0.95), 23), cylinder(0.12, 0.9, (-0.4, 0, 1.2)),
        box((0.7, 0.18, 0.18), (-0.1, 0, 1.6), 17), cylinder(0.1, 0.5, (0.2, 0.1, 1.45)),
        box((0.6, 0.5, 1.8), (-1.4, 1.5, 0.9)), box((0.5, 0.9, 0.9), (1.4, 1.2, 0.45), 11),
        box((2.5, 0.4, 0.6), (0, -1.4, 0.3)), box((0.1, 3.4, 0.1), (1.7, 0, 1.9)),
        cylinder(0.05, 2, (1.7, -1.7, 1)), cylinder(0.05, 2, (-1.7, -1.7, 1)),
    ]  # fmt: skip
    parts += [box((0.25, 0.25, 0.12), (x, -1.4, 0.66)) for x in np.linspace(-1, 1, 5)]
    return rc.Mesh.joined(parts)


def house() -> rc.Mesh:
    """Front of a house, 16 m wide: windows with frames, balconies, a door, a cornice, pipes."""
    parts = [box((16, 0.4, 10), (0, 0.3, 5)), box((20, 8, 0.1), (0, -3.9, -0.05))]
    for number, x in enumerate(np.linspace(-6.5, 6.5, 6).tolist()):
        for z in (1.5, 4.8, 8.1):
            parts += [box((1.5, 0.1, 0.12), (x, 0.05, z + step)) for step in (-0.9, 0.85)]
            parts += [box((0.12, 0.1, 1.7), (x + step, 0.05, z)) for step in (-0.7, 0.7)]
            if number % 2 and z > 2:
                parts.append(box((1.9, 0.9, 0.12), (x, -0.3, z - 1.1)))
                parts.append(box((1.9, 0.05, 0.9), (x, -0.72, z - 0.6)))
    parts += [box((2, 0.5, 2.6), (0, 0, 1.3)), box((16.4, 0.7, 0.3), (0, 0.2, 10.1))]
    parts += [cylinder(0.06, 9.8, (x, 0.05, 4.9)) for x in (-7.7, 7.7)]
    return rc.Mesh.joined(parts)


SCENES = {
    "room": rc.shapes.room,
    "part": part,
    "aeroplane": rc.shapes.aeroplane,
    "cell": cell,
    "house": house,
}


def pose_in(name: str, mesh: rc.Mesh, rng: np.random.Generator) -> np.ndarray:
    """Pose that a camera may have in a scene: it sees the mesh, and nothing of it too near."""
    lens = CAMERA.resized(0.25)
    with rc.open_rasterizer(mesh, lens, "cpu") as rasterizer:
        for _ in range(1000):
            pose = np.asarray(rc.look_at(*_view(name, mesh, rng))[0], dtype=float)
            depth = rasterizer.render(pose).depth
            seen = depth[np.isfinite(depth)]
            if seen.size > 0.1 * depth.size and seen.min() > 0.08 * np.median(seen):
                return pose
    raise RuntimeError(name)


def _view(name: str, mesh: rc.Mesh, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Place of a camera, and the point that it looks at."""
    low, high = mesh.bounds
    middle, size = (low + high) / 2, mesh.diagonal
    if name == "room":
        eye = low + (high - low) * rng.uniform((0.08, 0.08, 0.5), (0.92, 0.92, 0.9))
        return eye, low + (high - low) * rng.uniform(0.2, 0.8, 3) * (1, 1, 0.4)
    if name == "cell":
        eye = rng.uniform((0.3, -3, 1.3), (2.6, -0.2, 2.6))
        return eye, np.array((0, 0.2, 0.7)) + rng.normal(size=3) * 0.2
    if name == "house":
        eye = rng.uniform((-9, -14, 1.5), (9, -7, 7))
        return eye, np.array((rng.uniform(-3, 3), 0, rng.uniform(3, 6)))
    away = rng.normal(size=3)
    away[2] = abs(away[2]) - 0.2
    away *= rng.uniform(0.95, 1.5) * size / np.linalg.norm(away)
    return middle + away, middle + rng.normal(size=3) * size * 0.04
