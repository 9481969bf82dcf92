"""Scenes for every exact method: some with answers worked out on paper, the others to be hostile.

`known_cases()` are the first kind: their coordinates are exact in binary, so the visible areas hold
in exact arithmetic and not just to rounding. `hostile(seed)` are the second: small scenes of a kind
that `seed` picks, on which methods are compared with one another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
from scenes import joined, sheet, square

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes

AHEAD = np.eye(4)
"""Camera at the origin that looks along +z, y down."""


def window(width=200, height=200, focal=100, **others):
    return Camera(width=width, height=height, fx=focal, fy=focal, **others)


WINDOW = window()


@dataclass(frozen=True, eq=False)
class Case:
    """A mesh, a camera and a pose; `expected` is the visible area of each face, exact, in px^2."""

    name: str
    mesh: Mesh
    expected: Sequence[Fraction] | None = None
    camera: Camera = WINDOW
    pose: np.ndarray = field(default_factory=lambda: AHEAD)

    def __post_init__(self):
        if self.expected is not None:
            areas = tuple(Fraction(area) for area in self.expected)
            assert len(areas) == self.mesh.n_faces, self.name
            object.__setattr__(self, "expected", areas)

    def __repr__(self):
        return self.name


def triangles(*faces):
    """Mesh of faces given by their corners, none shared."""
    points = np.asarray(faces, dtype=np.float64).reshape(-1, 3)
    return Mesh(vertices=points, faces=np.arange(len(points)).reshape(-1, 3))


def whole(mesh, camera):
    """Image area of each face seen from AHEAD, none of which may be cut or hidden: exact, px^2."""
    fx, fy = Fraction(camera.fx), Fraction(camera.fy)
    points = [[Fraction(x) for x in point.tolist()] for point in mesh.vertices]
    image = [(fx * x / z, fy * y / z) for x, y, z in points]
    areas = []
    for a, b, c in mesh.faces.tolist():
        (au, av), (bu, bv), (cu, cv) = image[a], image[b], image[c]
        areas.append(abs((bu - au) * (cv - av) - (bv - av) * (cu - au)) / 2)
    return areas


def known_cases():
    """All scenes whose answer is known."""
    return [
        *_screens(),
        *_cut_cases(),
        *_crossing_cases(),
        *_sheet_cases(),
        *_solid_cases(),
        *_nothing_cases(),
        slivers(),
    ]


# --- one thing in front of another ---------------------------------------------------------------


def _screens():
    rear = square(2, 4)  # 100 px wide
    front = square(0.5, 2)  # 50 px wide
    #   +-------+
    #   | +---+ |
    #   | |   | |
    #   +-+---+-+
    yield Case("square before square", joined(rear, front), [3750] * 2 + [1250] * 2)
    yield Case("square first", joined(front, rear), [1250] * 2 + [3750] * 2)
    yield Case("square behind square", joined(square(2, 1), rear), [20000] * 2 + [0] * 2)

    # Four bars in a ring, each before the next.
    bar = np.array([(-3, -1, 5), (3, -0.75, 7), (-3, -0.5, 5)])
    turn = np.array([(0, 1, 0), (-1, 0, 0), (0, 0, 1)])
    wheel = triangles(bar, bar @ turn, bar @ turn @ turn, bar @ turn @ turn @ turn)
    part = Fraction(1742750798191, 1796713050031)
    yield Case("pinwheel", wheel, [part * Fraction(3600, 7)] * 4)


# --- the near plane and the image border ---------------------------------------------------------


def _cut_cases():
    through = triangles([(-0.5, 0.25, 3), (0.5, 0.25, 3), (0, 0.25, -1)])
    wide = window(1000, 1000, near=0.125)
    yield Case("through the near plane", through, [Fraction(445625, 18)], wide)
    # 25/z px below the centre the face is 25 + 25/z px wide; the border is at 100 px.
    low, high = Fraction(25, 3), 100
    area = 25 * (high - low) + (high**2 - low**2) / 2
    yield Case("through near plane and border", through, [area], window(near=0.125))
    # The cut away part hides nothing: a wall at z = 1/16 that is open towards the camera.
    sheets = joined(square(1, 0.0625), square(0.5, 2))
    yield Case("nearer than near", sheets, [0, 0, 1250, 1250], window(near=0.125))
    yield Case("behind the camera", joined(square(1, -2), square(0.5, 2)), [0, 0, 1250, 1250])
    yield Case("at near", square(0.5, 2), [1250] * 2, window(near=2))

    half = window(width=100, cx=100, cy=100)
    yield Case("half in the image", square(1, 1), [15000, 5000], half)
    yield Case("larger than the image", square(64, 1), [20000] * 2)
    yield Case("border along the border", square(1, 1), [20000] * 2)
    yield Case("outside", sheet((1, -1), (2, 1), 1), [0, 0])
    # A face through the eye's level, from behind the camera to far ahead, left of the camera.
    side = triangles([(-1, -8, 8), (-1, 8, 8), (-1, 0, -8)])
    # In the image u = 100 - 100/z, which is 0 ... 87.5; |y| <= (8 + z)/2 ends beyond the border.
    yield Case("wall beside the camera", side, [Fraction(175, 2) * 200])


# --- faces that cut one another ------------------------------------------------------------------


def _crossing_cases():
    floor = Mesh(
        vertices=[(-1, 1, 2), (1, 1, 2), (1, 1, 8), (-1, 1, 8)], faces=[(0, 1, 2), (0, 2, 3)]
    )
    wall = square(4, 4)  # fills the image
    visible = [Fraction(5000, 3), Fraction(625, 3)]
    yield Case("wall through floor", joined(floor, wall), [*visible, 18125, 20000])
    yield Case("floor through wall", joined(wall, floor), [18125, 20000, *visible])

    one = [(-2, -2, 4), (-2, 2, 4), (2.5, 0, 6)]
    pair = triangles(one, [(-x, y, z) for x, y, z in one])
    yield Case("crossing pair", pair, [Fraction(13750, 3) * Fraction(96, 121)] * 2)

    # x = 0 is where both have z = 4: the left half of one and the right half of the other is seen.
    slope = triangles([(-2, -2, 3), (-2, 2, 3), (2, 0, 5)], [(2, -2, 3), (2, 2, 3), (-2, 0, 5)])
    images = whole(slope, WINDOW)
    # The part of each beyond x = 0 is hidden: 50 px high at x = 0 and 40 px long.
    far = Fraction(50 * 40, 2)
    yield Case("crossing slopes", slope, [area - far for area in images])


# --- sheets at one depth -------------------------------------------------------------------------


def _sheet_cases():
    yield Case(
        "coplanar, first wins",
        joined(sheet((-2, -2), (2, 2), 4), sheet((0, 0), (4, 4), 4)),
        [5000, 5000, 3750, 3750],
        window(300, 300),
    )
    # Three times the same plane z = 4 + x/2, x and y in steps that are exact.
    tilted = np.array([(-2, -2, 3), (-2, 2, 3), (2, 0, 5)], dtype=np.float64)
    inner = np.array([(-1, -0.5, 3.5), (-1, 0.5, 3.5), (0, 0, 4)])
    mesh = triangles(inner, tilted, inner)
    part, everything, _ = whole(mesh, WINDOW)
    yield Case("tilted decal", mesh, [part, everything - part, 0])
    mesh = triangles(tilted, inner)
    yield Case("decal behind its sheet", mesh, [everything, 0])

    base = square(2, 4)
    turned = {
        "as it is": lambda faces: faces,
        "reversed": lambda faces: faces[:, ::-1],
        "rolled": lambda faces: np.roll(faces, 1, axis=1),
        "reversed and rolled": lambda faces: np.roll(faces[:, ::-1], 1, axis=1),
    }
    # Nearer by 0, 1.1e-13, 1.5e-11, 5.8e-11 | 1.2e-10, 9.3e-10 and 7.5e-9 of the depth.
    for power in (None, 43, 36, 34, 33, 30, 27):
        nearer = 0.0 if power is None else 2.0**-power
        for name, turn in turned.items():
            copy = Mesh(vertices=base.vertices * (1 - nearer), faces=turn(base.faces))
            expected = [5000, 5000, 0, 0] if nearer < 1e-10 else [0, 0, 5000, 5000]
            yield Case(f"second sheet {name}, nearer by {nearer:.1e}", joined(base, copy), expected)
    # What is a tie is a matter of the depth there; two other sheets lie close to the camera.
    copy = Mesh(vertices=base.vertices * (1 - 2.0**-33), faces=base.faces)
    corner = sheet((-1 / 64, -1 / 64), (-3 / 256, -3 / 256), 1 / 64)
    hidden = Mesh(vertices=corner.vertices * 2, faces=corner.faces)
    mesh = joined(base, copy, corner, hidden)
    small = Fraction(625, 2)
    expected = [0, 0, 5000, 5000, small, small, 0, 0]
    yield Case("a near tie far behind", mesh, expected)
    third = joined(base, base, base)
    yield Case("three sheets", third, [5000, 5000] + [0] * 4)


# --- solids --------------------------------------------------------------------------------------


def box(low, high):
    """Closed box, wound outwards, from corner to corner."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    points = np.where(corners, high, low).astype(np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return Mesh(vertices=points, faces=faces)


def _is_front(mesh):
    corners = mesh.vertices[mesh.faces]
    return np.linalg.det(corners) < 0  # the eye is the origin: n . a is the determinant


def _solid_cases():
    solids = {
        "box ahead": box((-1, -1, 4), (1, 1, 6)),
        "box aside": box((1, 0.5, 4), (2, 2, 8)),
        "box around the axis of the camera": box((-1, -3, 8), (5, 2, 16)),
    }
    for name, solid in solids.items():
        seen = np.where(_is_front(solid), whole(solid, WINDOW), 0)
        yield Case(name, solid, seen)
    room = box((-4, -4, -4), (4, 4, 4))
    ends = [20000 if (room.vertices[face, 2] == 4).all() else 0 for face in room.faces]
    yield Case("camera in a box", room, ends)


# --- faces that see and hide nothing -------------------------------------------------------------


def _nothing_cases():
    behind = square(0.5, 2)
    nothings = {
        "edge-on": [(0, -1, 1), (0, 1, 1), (0, 0, 3)],
        "edge-on, oblique": [(-1, -1, 1), (1, 1, 1), (0.5, 0.5, 4)],
        "through the eye": [(-1, 0, 1), (1, 0, 1), (0, 0, -1)],
        "a segment": [(-1, 0, 1), (1, 0, 1), (0, 0, 1)],
        "a segment, twice a vertex": [(-1, 0, 1), (1, 0, 1), (1, 0, 1)],
        "a point": [(0, 0, 1)] * 3,
        "a vertex at the eye": [(0, 0, 0), (-1, -1, 1), (1, 1, 1)],
        "the eye, thrice": [(0, 0, 0)] * 3,
    }
    for name, corners in nothings.items():
        mesh = joined(triangles(corners), behind)
        yield Case(f"nothing to see: {name}", mesh, [0, 1250, 1250])


def slivers():
    """Slivers 0.9 px wide between the sample columns; the square behind shows a tenth of itself."""
    # u = X/10 at z = 1000 and X/20 at 2000 (fx = 100), so that each hundredth of a pixel is exact.
    rear = sheet((10, 10), (2010, 2010), 2000)
    strips = [sheet((10 * i + 5.5, 0), (10 * i + 14.5, 1010), 1000) for i in range(100)]
    expected = [500, 500] + [Fraction(9, 10) * 101 / 2] * 200
    return Case("slivers", joined(rear, *strips), expected, window(101, 101, cx=0, cy=0))


# --- hostile scenes ------------------------------------------------------------------------------
# Each takes a generator and returns mesh, camera and pose. Some 10 to 80 faces: the exact rational
# answer of one takes a fraction of a second.


def _soup_faces(rng, n, size, spread=1.0):
    """Triangles about points of the unit ball times `spread`, (n, 3, 3)."""
    return rng.normal(size=(n, 1, 3)) * spread + rng.normal(size=(n, 3, 3)) * size


def _view(rng, distance, centre=(0, 0, 0)):
    """Pose in any direction, `distance` away, rolled."""
    away = rng.normal(size=3)
    eye = np.asarray(centre) + distance * away / np.linalg.norm(away)
    return look_at(eye, centre, rng.normal(size=3))[0]


def _lens(rng, focal=(60, 250)):
    width, height = (int(side) for side in rng.integers(64, 257, 2))
    fx = rng.uniform(*focal)
    fy, cx, cy = fx * rng.uniform(0.8, 1.2), width * rng.uniform(0.3, 0.7), rng.uniform(0.3, 0.7)
    return Camera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=height * cy)


def soup(rng):
    n = int(rng.integers(5, 50))
    return triangles(*_soup_faces(rng, n, rng.uniform(0.2, 1))), _lens(rng), _view(rng, 5)


def interpenetrating(rng):
    n = int(rng.integers(3, 16))
    return triangles(*_soup_faces(rng, n, 1.5, 0.2)), _lens(rng), _view(rng, 6)


def shells(rng):
    """Closed surfaces inside one another, some sharing faces of the same plane."""
    boxes = [box((-s, -s, -s), (s, s, s)) for s in rng.choice((0.25, 0.5, 1.0, 1.25), 3)]
    return joined(*boxes, shapes.sphere(1, 0.8)), _lens(rng), _view(rng, rng.uniform(2.5, 6))


def inside(rng):
    """Camera within a closed box that holds other things."""
    room = box((-3, -2, -2), (3, 2, 2))
    things = triangles(*_soup_faces(rng, int(rng.integers(1, 20)), 0.6))
    eye, target = rng.uniform(-1.5, 1.5, (2, 3))
    return joined(room, things), _lens(rng), look_at(eye, target, rng.normal(size=3))[0]


def coplanar_stack(rng):
    """Integer triangles on two planes: whole stacks at exactly the same depth."""
    faces = []
    for _ in range(int(rng.integers(5, 30))):
        corners = rng.integers(-4, 5, (3, 3)).astype(np.float64)
        corners[:, 2] = rng.choice((4, 4, 8))
        faces.append(corners)
    return triangles(*faces), window(180, 160, 80), AHEAD


def lattice(rng):
    """Triangles between points of a small lattice about the camera: all coincidences at once."""
    n = int(rng.integers(5, 30))
    points = rng.integers(-3, 4, (n, 3, 3)) + np.array((0, 0, 5 * int(rng.integers(0, 2))))
    return triangles(*points), window(128, 128, 64), AHEAD


def decals(rng):
    """Sheets that lie on one another, turned, so that rounding alone parts their depths."""
    size = int(rng.integers(3, 12))
    flat = rng.normal(size=(size, 3, 2))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose = _view(rng, 6)
    mesh = triangles(*(flat @ axes[:2]), *_soup_faces(rng, 4, 0.5))
    return mesh, _lens(rng), pose


def needles(rng):
    n = int(rng.integers(5, 30))
    start, along = rng.normal(size=(2, n, 3))
    width = 10.0 ** rng.uniform(-7, -1, (n, 1))
    side = rng.normal(size=(n, 3)) * width
    faces = np.stack(
        (start - along, start + along, start + along * rng.uniform(-1, 1) + side), axis=1
    )
    return triangles(*faces), _lens(rng), _view(rng, 5)


def near_plane(rng):
    """Faces on all sides of the camera, many through its near plane."""
    n = int(rng.integers(3, 25))
    camera = _lens(rng, (40, 120))
    if rng.random() < 0.7:
        camera = replace(camera, near=10.0 ** rng.uniform(-3, -0.3), cx=None, cy=None)
    return triangles(*_soup_faces(rng, n, 1.5)), camera, _view(rng, rng.uniform(0.1, 1.5))


def t_junctions(rng):
    """Layers of one square each, cut into different strips: no vertex of one is on the next."""
    layers = []
    for depth in range(3):
        cuts = np.unique(rng.integers(1, 16, 3)) / 8 - 1
        ends = [-1.0, *cuts.tolist(), 1.0]
        z = 4.0 * 2.0**depth
        for low, high in pairwise(ends):
            span = ((low, -1), (high, 1)) if rng.random() < 0.5 else ((-1, low), (1, high))
            layers.append(sheet(*((u * z / 4, v * z / 4) for u, v in span), z))
    order = rng.permutation(len(layers))
    return joined(*(layers[i] for i in order)), window(160, 160, 200), AHEAD


def aligned_tilings(rng):
    """Tilings at depths 1, 2, 4, each an exact multiple: edges over edges, corners over corners."""
    faces = []
    for z in (1, 2, 4):
        step = int(rng.choice((1, 2)))
        for u in range(-2, 2, step):
            for v in range(-2, 2, step):
                if rng.random() < 0.6:
                    faces.append(
                        sheet((u * z / 4, v * z / 4), ((u + step) * z / 4, (v + step) * z / 4), z)
                    )
    faces.append(square(4, 8))
    order = rng.permutation(len(faces))
    return joined(*(faces[i] for i in order)), window(150, 150, 120), AHEAD


def duplicates(rng):
    """Faces repeated as they are, rolled and reversed, in any order."""
    faces = _soup_faces(rng, int(rng.integers(3, 12)), 0.7)
    copies = np.concatenate((faces, np.roll(faces, 1, axis=1), faces[:, ::-1]))
    return triangles(*rng.permutation(copies)), _lens(rng), _view(rng, 5)


def degenerate(rng):
    """Points, segments and faces seen edge-on among others."""
    faces = _soup_faces(rng, int(rng.integers(8, 30)), 0.8)
    pose = _view(rng, 5)
    eye = pose[:3, 3]
    for face in faces:
        match rng.integers(6):
            case 0:
                face[1] = face[0]
            case 1:
                face[:] = face[0]
            case 2:
                face[2] = (face[0] + face[1]) / 2
            case 3:
                face[2] = eye + (face[0] - eye) * rng.uniform(0.5, 2)
    return triangles(*faces), _lens(rng), pose


def flipped(rng):
    """A closed box with some faces turned over, doubled or gone, and a wing on one of its edges."""
    solid = box((-1, -1, -1), (1, 1, 1))
    faces = np.array(solid.faces)
    turned = rng.random(12) < 0.3
    faces[turned] = faces[turned, ::-1]
    faces = np.concatenate((faces[rng.random(12) < 0.8], faces[rng.integers(0, 12, 3)]))
    points = np.concatenate((solid.vertices, [(2, -2, 0.5), (0.3, -0.2, 1.7)]))
    wings = [(0, 1, 8), (0, 1, 9), (0, 8, 9)]
    return Mesh(vertices=points, faces=[*faces, *wings]), _lens(rng), _view(rng, 4)


def self_intersecting(rng):
    """Closed boxes, turned, through one another."""
    boxes = []
    for _ in range(4):
        solid = box(rng.uniform(-1.2, -0.1, 3), rng.uniform(0.1, 1.2, 3))
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn[:, 0] *= np.sign(np.linalg.det(turn))
        boxes.append(Mesh(vertices=solid.vertices @ turn.T, faces=solid.faces))
    return joined(*boxes), _lens(rng), _view(rng, 5)


def grid(n):
    """Points (N, 2) of n x n quads over a square, and their triangles."""
    u, v = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return np.stack((u, v), axis=-1).reshape(-1, 2), faces


def _blanket(rng, n):
    """Height field of n x n quads over a square."""
    flat, faces = grid(n)
    u, v = flat.T
    height = 0.4 * np.sin(3 * u + rng.uniform(0, 6)) * np.cos(3 * v)
    height += rng.normal(size=len(u)) * 0.02
    return Mesh(vertices=np.column_stack((flat, height)), faces=faces)


def sub_pixel(rng):
    """Folds of faces far smaller than a pixel."""
    camera = _lens(rng, (20, 40))
    return _blanket(rng, 6), camera, _view(rng, rng.uniform(20, 60))


def grazing(rng):
    """A folded sheet seen nearly along itself: thin images, hidden by their neighbours."""
    angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, 0.6)
    eye = 3 * np.array((np.cos(angle), np.sin(angle), height))
    return _blanket(rng, 6), _lens(rng), look_at(eye, (0, 0, 0))[0]


def fans(rng):
    """Faces around common vertices, with common edges and others that run along them."""
    centres = rng.normal(size=(3, 3)) * 0.3
    rim = rng.normal(size=(6, 3))
    faces = [
        (centres[i], rim[rng.integers(6)], rim[rng.integers(6)])
        for i in (0, 0, 0, 1, 1, 1, 2, 2, 2)
    ]
    halves = [(a, (a + b) / 2, c) for a, b, c in faces[:4]]
    return triangles(*faces, *halves), _lens(rng), _view(rng, 4)


def borders(rng):
    """Faces far larger than the image, or just touching it."""
    camera = window(100, 80, 100)
    faces = _soup_faces(rng, int(rng.integers(4, 16)), 10.0 ** rng.uniform(-0.5, 3))
    faces[..., 2] = np.abs(faces[..., 2]) + rng.uniform(1, 3, (len(faces), 1))
    along = [
        [(-0.5, -0.4, 1), (0.5, -0.4, 1), (0, -4, 1)],
        [(-1, 0.8, 2), (1, 0.8, 2), (0, 0.4, 2)],
    ]
    return triangles(*faces, *along), camera, AHEAD


def far_away(rng):
    """Mesh and camera together a hundred kilometres from the origin."""
    mesh, camera, pose = soup(rng)
    offset = rng.normal(size=3) * 1e5
    moved = pose.copy()
    moved[:3, 3] += offset
    return Mesh(vertices=mesh.vertices + offset, faces=mesh.faces), camera, moved


KINDS = (
    soup, interpenetrating, shells, inside, coplanar_stack, lattice, decals,
    needles, near_plane, t_junctions, aligned_tilings, duplicates, degenerate, flipped,
    self_intersecting, sub_pixel, grazing, fans, borders, far_away,
)  # fmt: skip
"""Kinds of hostile scene: `hostile(seed)` takes number seed % len(KINDS)."""


def hostile(seed: int) -> Case:
    """Scene number `seed`; the kinds take turns."""
    kind = KINDS[seed % len(KINDS)]
    mesh, camera, pose = kind(np.random.default_rng(seed))
    return Case(f"{kind.__name__} {seed}", mesh, camera=camera, pose=pose)
