"""Polygons in space around a lens, cut to its ideal planes."""

import numpy as np

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


def room(n, seed=0):
    """Walls of a turned cube around a lens that is not at its center, as triangles (M, 3, 3).

    Each side has n x n squares; seen from inside all triangles turn the same way.
    """
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    t = np.linspace(-1, 1, n + 1)
    triangles = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            for i in range(n):
                for j in range(n):
                    square = np.empty((4, 3))
                    square[:, axis] = sign
                    square[:, (axis + 1) % 3] = t[[i, i + 1, i + 1, i]]
                    square[:, (axis + 2) % 3] = t[[j, j, j + 1, j + 1]]
                    square = square[:: int(sign)]
                    triangles += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return (np.array(triangles) + rng.uniform(-0.4, 0.4, 3)) @ turn.T


def _cut(points, values):
    """Convex polygons (K, 3) where a linear form, known at the corners, is >= 0 and <= 0."""
    inside, outside = [], []
    for i, (point, value) in enumerate(zip(points, values, strict=True)):
        before = values[i - 1]
        if (before > 0) != (value > 0) and before != value:
            share = value / (value - before)
            crossing = point + share * (points[i - 1] - point)
            inside.append(crossing)
            outside.append(crossing)
        (inside if value > 0 else outside).append(point)
    return np.array(inside).reshape(-1, 3), np.array(outside).reshape(-1, 3)


def _forms(polygon):
    """Linear forms (K, 3) that are positive on rays through the inside of a polygon of a plane."""
    ends = np.roll(polygon, -1, axis=0)
    one = np.column_stack((polygon, np.ones(len(polygon))))
    two = np.column_stack((ends, np.ones(len(ends))))
    forms = np.cross(one, two)
    return forms[np.abs(forms).max(axis=1) > 1e-14]


def _inside(points, forms):
    """Part of a polygon where all forms are positive."""
    for form in forms[(points @ forms.T < 0).any(axis=0)]:
        points, _ = _cut(points, points @ form)
        if len(points) < 3:
            return points[:0]
    return points


def on_plane(plane, triangles):
    """Convex polygons (K, 2) of an ideal plane: triangles of space in its region."""
    forms = _forms(plane.region)
    holes = [] if plane.hole is None else _forms(plane.hole)
    polygons = []
    for triangle in triangles:
        points = _inside(triangle @ plane.frame, forms)
        if len(points) < 3:
            continue
        pieces = [points]
        if len(holes) and len(_inside(points, holes)) >= 3:
            pieces, left = [], points
            for form in holes:
                left, piece = _cut(left, left @ form)
                pieces.append(piece)
                if len(left) < 3:
                    break
        polygons += [piece[:, :2] / piece[:, 2:] for piece in pieces if len(piece) >= 3]
    return polygons
