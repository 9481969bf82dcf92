"""Attack on the exact methods: cameras on the surface, self-crossing solids, coplanar parts.

Every figure of `certified` and `exact` is compared with exact rational arithmetic: areas may be off
by their bound and no more, and a face that is certified must be wholly visible or wholly hidden.
"""

from dataclasses import dataclass

import numpy as np
from exact_cases import box
from rows import Report
from scenes import joined

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.core.raster.contract import BoundKind
from rastercov.reference import rational

SCENES, VIEWS = 5_000, 12
FACES_A_VIEW = 12
"""Faces of each view that are compared with fractions: all, or as many drawn at random."""
LEAST_SEEN = 1e-12
"""px^2 up to which the fractions of a certified figure may differ from all or nothing: ties count
as one surface over the whole of what two faces have in common."""


@dataclass
class Score:
    """Figures compared, and those that were wrong."""

    certified: int = 0
    wrong: int = 0
    computed: int = 0
    exceeded: int = 0
    worst: float = 0.0
    """Largest error of an area as a part of its bound."""


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 5,000 scenes of 12 views."""
    score = Score()
    for seed in range(max(len(SCENE_KINDS), round(SCENES * effort))):
        compare(seed, score)
    report.add("exact: certified figures compared with fractions", score.certified, "figures")
    report.add("exact: computed figures compared with fractions", score.computed, "figures")
    report.add("exact: largest error as a part of its bound", score.worst, "", at_most=1.0)
    report.check("exact: no wrong certificate", score.wrong == 0)
    report.check("exact: no bound exceeded", score.exceeded == 0)


def compare(seed: int, score: Score) -> list[str]:
    """Compare both methods with fractions on one scene; a line for each figure that is wrong."""
    rng = np.random.default_rng(seed)
    kind = SCENE_KINDS[seed % len(SCENE_KINDS)]
    mesh = kind(rng)
    camera = random_camera(rng)
    poses = np.array([_pose(mesh, number, rng) for number in range(VIEWS)])
    comparison = []
    for method in ("certified", "exact"):
        with rc.open_observer(mesh, camera, method, threads=1) as observer:
            seen = observer.observe(poses)
        picked = np.random.default_rng(seed)
        for row, pose in enumerate(poses):
            faces = np.arange(mesh.n_faces)
            if mesh.n_faces > FACES_A_VIEW:  # those with an image first
                order = picked.permutation(mesh.n_faces)
                has_image = seen.drawn_pixels[row, order] > 0
                faces = np.concatenate((order[has_image], order[~has_image]))[:FACES_A_VIEW]
            visible = rational.visible_area(mesh, camera, pose, faces)
            area = rational.image_area(mesh, camera, pose, faces)
            off = np.abs(seen.visible_pixels[row, faces] - visible)
            certified = seen.kind[row, faces] == BoundKind.CERTIFIED
            wrong = certified & is_partial(seen.visible_pixels[row, faces], visible, area)
            both = off + np.abs(seen.drawn_pixels[row, faces] - area)
            bound = seen.area_error[row, faces]
            exceeded = ~certified & (both > bound + LEAST_SEEN)
            # Culled: faces that cannot be seen are not drawn either.
            exceeded &= (seen.drawn_pixels[row, faces] > 0) | (visible > bound + LEAST_SEEN)
            score.certified += int(certified.sum())
            score.wrong += int(wrong.sum())
            score.computed += int((~certified).sum())
            score.exceeded += int(exceeded.sum())
            share = (both / (bound + LEAST_SEEN))[~certified & (seen.drawn_pixels[row, faces] > 0)]
            score.worst = max(score.worst, float(share.max(initial=0)))
            for f in np.flatnonzero(wrong | exceeded):
                comparison.append(
                    f"{kind.__name__} seed {seed} view {row} face {faces[f]} {method}: "
                    f"off {both[f]:.3g} bound {seen.area_error[row, faces[f]]:.3g} "
                    f"{'certified' if certified[f] else 'computed'} area {area[f]:.3g} "
                    f"visible {visible[f]:.3g} got {seen.visible_pixels[row, faces[f]]:.3g}"
                )
    return comparison


def is_partial(result, visible, area):
    """(F,) true where a face with something visible is not wholly visible, or one without is."""
    doubt = np.abs(visible - np.where(result > 0, area, 0.0))
    return doubt > LEAST_SEEN + 1e-12 * area


def random_camera(rng) -> rc.Camera:
    """A pinhole of 64 to 1,024 pixels a side, from a wide one to a long one."""
    width, height = (int(side) for side in rng.integers(64, 1025, 2))
    focal = width * 10 ** rng.uniform(-0.6, 0.6)
    return rc.Camera(width=width, height=height, fx=focal, fy=focal * rng.uniform(0.8, 1.25))


def _pose(mesh, number: int, rng):
    """A camera on a vertex, an edge or a face of the mesh, a unit in the last place off, or out."""
    face = mesh.vertices[mesh.faces[rng.integers(mesh.n_faces)]]
    kind = number % 6
    if kind == 0:
        eye = face[0].copy()
    elif kind == 1:
        eye = (
            (face[0] + face[1]) / 2
            if rng.random() < 0.5
            else face[0] + (face[1] - face[0]) * rng.choice((0.25, 0.375, rng.random()))
        )
    elif kind in (2, 3):
        eye = face.mean(axis=0) if rng.random() < 0.5 else rng.dirichlet((1, 1, 1)) @ face
    elif kind == 4:
        along = face[0] - face[1]
        eye = face[0] + along * rng.uniform(0.1, 2)  # in the plane of the face and of its edge
    else:
        away = rng.normal(size=3)
        middle = mesh.bounds.mean(axis=0)
        eye = middle + away / np.linalg.norm(away) * np.ptp(mesh.bounds) * rng.uniform(0.7, 3)
    if number % 2 and rng.random() < 0.7:  # a unit in the last place, or a few, or a little more
        axis = rng.integers(3)
        if rng.random() < 0.6:
            eye[axis] = np.nextafter(eye[axis], rng.choice((-np.inf, np.inf)))
        else:
            eye[axis] += 10.0 ** rng.uniform(-17, -6) * rng.choice((-1, 1))
    target = mesh.vertices[mesh.faces[rng.integers(mesh.n_faces)]].mean(axis=0)
    if rng.random() < 0.3 or np.linalg.norm(target - eye) < 1e-6 * np.ptp(mesh.bounds):
        target = eye + rng.normal(size=3)
    if rng.random() < 0.25:
        target = eye + np.eye(3)[rng.integers(3)] * rng.choice((-1, 1))
    up = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
    if np.linalg.norm(np.cross(up, target - eye)) < 1e-6 * np.linalg.norm(target - eye):
        up = rng.normal(size=3)
    return rc.look_at(eye, target, up)[0]


# --- scenes --------------------------------------------------------------------------------------


def moved(mesh, rng, size=1.0) -> rc.Mesh:
    """The mesh turned, scaled and shifted, or (one time in three) left on the axes."""
    if rng.random() < 1 / 3:
        return mesh
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    return rc.Mesh(vertices=mesh.vertices @ turn.T * size + rng.normal(size=3), faces=mesh.faces)


def prism(ring, low=-1.0, high=1.0) -> rc.Mesh:
    """Closed prism over a ring of points, which may cross itself; caps are fans."""
    ring = np.asarray(ring, float)
    n = len(ring)
    points = [(x, y, z) for z in (low, high) for x, y in ring]
    sides = [
        t for i in range(n) for j in ((i + 1) % n,) for t in ((i, j, n + j), (i, n + j, n + i))
    ]
    caps = [t for i in range(1, n - 1) for t in ((0, i + 1, i), (n, n + i, n + i + 1))]
    return rc.Mesh(vertices=points, faces=sides + caps)


def solid(rng):
    """A convex or a ring-shaped closed solid of few faces."""
    shape = rng.integers(3)
    if shape == 0:
        mesh = box(-rng.uniform(0.2, 2, 3), rng.uniform(0.2, 2, 3))
    elif shape == 1:
        mesh = shapes.torus(int(rng.integers(3, 7)), 3, 1.0, rng.uniform(0.2, 0.6))
    else:
        mesh = shapes.sphere(0, rng.uniform(0.5, 1.5))
    return moved(mesh, rng, 10.0 ** rng.uniform(-3, 3))


def dyadic_solids(rng):
    """Boxes with corners on a lattice, so that eyes on faces are on them exactly."""
    boxes = []
    for _ in range(int(rng.integers(1, 4))):
        low = rng.integers(-4, 4, 3) / 4
        boxes.append(box(low, low + rng.integers(1, 5, 3) / 4))
    return joined(*boxes)


def bow_tie(rng):
    """Prism over a ring that crosses itself: closed, consistently wound, inside out in part."""
    if rng.random() < 0.3:
        ring = [(-3, -3), (1, 1), (1, -1), (-3, 3)]
    else:
        ring = rng.normal(size=(int(rng.integers(4, 8)), 2))
    mesh = prism(ring)
    return mesh if rng.random() < 0.3 else moved(mesh, rng)


def crossing_solids(rng):
    """Closed solids through one another, outward or inward."""
    parts = [moved(box(-rng.uniform(0.2, 1.2, 3), rng.uniform(0.2, 1.2, 3)), rng) for _ in "ab"]
    if rng.random() < 0.5:
        parts.append(rc.Mesh(vertices=parts[0].vertices * 0.5, faces=parts[0].faces[:, ::-1]))
    return joined(*parts)


def assembly(rng):
    """Boxes stacked on one another, 1e-13 apart or touching."""
    base = box((-1, -1, -1), (1, 1, 0))
    parts = [base]
    for _ in range(int(rng.integers(1, 3))):
        low = np.append(rng.uniform(-1, 0.5, 2), rng.choice((0.0, 1e-13, -1e-13, 1e-16)))
        parts.append(box(low, low + rng.uniform(0.3, 1, 3)))
    return moved(joined(*parts), rng)


def room(rng):
    """A box seen from inside, with boxes on its floor and a sheet on its wall."""
    walls = box((-3, -2, 0), (3, 2, 2.5))
    parts = [rc.Mesh(vertices=walls.vertices, faces=walls.faces[:, ::-1])]
    for _ in range(int(rng.integers(1, 3))):
        low = np.append(rng.integers(-8, 6, 2) / 4, 0.0)
        parts.append(box(low, low + rng.integers(1, 5, 3) / 4))
    return moved(joined(*parts), rng) if rng.random() < 0.5 else joined(*parts)


def sheets(rng):
    """Open triangles and fans of needles around common points."""
    n = int(rng.integers(3, 12))
    hub = rng.normal(size=3)
    rim = hub + rng.normal(size=(n + 1, 3)) * 10.0 ** rng.uniform(-1, 1)
    rim[1:] = rim[:1] + (rim[1:] - rim[:1]) * 10.0 ** rng.uniform(-4, 0, (n, 1))
    points = np.concatenate((hub[None], rim, rng.normal(size=(6, 3)) * 2))
    faces = [(0, i + 1, i + 2) for i in range(n)] + [(n + 2, n + 3, n + 4), (n + 5, n + 6, n + 7)]
    return rc.Mesh(vertices=points, faces=faces)


def fine_solids(rng):
    """Smooth solids of many faces beside boxes: large regions that can be certified."""
    if rng.random() < 0.5:
        round_one = shapes.sphere(2, rng.uniform(0.5, 1.5))
    else:
        round_one = shapes.torus(int(rng.integers(8, 20)), int(rng.integers(5, 10)))
    parts = [moved(round_one, rng)]
    for _ in range(int(rng.integers(0, 3))):
        low = rng.uniform(-2, 1, 3)
        parts.append(moved(box(low, low + rng.uniform(0.2, 2, 3)), rng))
    return joined(*parts)


def fine_room(rng):
    """A finely divided room with its furniture: certified regions around a camera on a wall."""
    mesh = shapes.room(int(rng.integers(1, 4)))
    return moved(mesh, rng) if rng.random() < 0.5 else mesh


SCENE_KINDS = (
    solid,
    dyadic_solids,
    bow_tie,
    crossing_solids,
    assembly,
    room,
    sheets,
    fine_solids,
    fine_room,
)
