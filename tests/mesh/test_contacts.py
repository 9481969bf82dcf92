"""Which faces touch: what exact arithmetic says of every pair, and what may not change it."""

from types import SimpleNamespace

import numpy as np
import pytest
from exact_cases import grid
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from nightly import examples
from scenes import joined
from solids import tessellated_plane

from rastercov.core.mesh import Mesh, contacts, shapes
from rastercov.core.mesh.contacts import touching_faces
from rastercov.reference.rational import cross, difference, dot, mpq

pytestmark = pytest.mark.native
HAIR = 1e-9


def touching(vertices, faces, tolerance=HAIR, **options):
    return touching_faces(np.asarray(vertices, float), np.asarray(faces), tolerance, **options)


def of_mesh(mesh, relative=1e-8, **options):
    extent = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    mask = mesh.degenerate_mask
    return touching(mesh.vertices, mesh.faces, relative * extent, degenerate_mask=mask, **options)


def of_soup(triangles, tolerance=HAIR, **options):
    triangles = np.asarray(triangles, float)
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return touching(triangles.reshape(-1, 3), faces, tolerance, **options)


def rotation(seed=0):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def tube(n, length):
    """Open cylinder of 2 n needles along z."""
    angle = 2 * np.pi / n * np.arange(n)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    low, next_low = np.arange(n), (np.arange(n) + 1) % n
    one = np.stack([low, next_low, n + next_low], axis=1)
    other = np.stack([low, n + next_low, n + low], axis=1)
    return Mesh(
        vertices=np.concatenate([ring, ring + np.array((0, 0, length))]),
        faces=np.concatenate([one, other]),
    )


# --- the oracle: what two triangles have in common, in rational numbers


def kept(polygon, normal, offset):
    """Part of a convex polygon where normal . p >= offset."""
    heights = [dot(normal, p) - offset for p in polygon]
    result = []
    for i, here in enumerate(heights):
        p, q, there = polygon[i - 1], polygon[i], heights[i - 1]
        if there * here < 0:
            t = there / (there - here)
            result.append(tuple(a + t * (b - a) for a, b in zip(p, q, strict=True)))
        if here >= 0:
            result.append(q)
    return result


def in_common(one, other):
    """Corners of the intersection of two triangles, of rational points."""
    a, b, c = other
    normal = cross(difference(b, a), difference(c, a))
    planes = [normal, tuple(-x for x in normal)]
    polygon = one
    for plane, at in [(plane, a) for plane in planes] + [
        (cross(normal, difference(q, p)), p) for p, q in ((a, b), (b, c), (c, a))
    ]:
        polygon = kept(polygon, plane, dot(plane, at))
    return polygon


def meet_elsewhere(one, other):
    """Whether two triangles have more in common than their common corners span."""
    shared = [p for p in one if p in other]
    if len(shared) == 3:
        return True
    for p in in_common(one, other):
        if not shared:
            return True
        along = difference(shared[-1], shared[0])
        off = difference(p, shared[0])
        on_line = not any(cross(along, off)) if any(along) else not any(off)
        if not on_line or not 0 <= dot(off, along) <= dot(along, along):
            return True
    return False


def exactly_touching(vertices, faces):
    """(F,) the same in rational numbers, pair by pair; no face may be degenerate."""
    triangles = [
        [tuple(mpq(*float(x).as_integer_ratio()) for x in vertices[v]) for v in face]
        for face in faces
    ]
    corners = np.asarray(vertices, float)[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    mask = np.zeros(len(faces), bool)
    for i in range(len(faces)):
        near = np.all((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i]), axis=1)
        for j in i + 1 + np.flatnonzero(near):
            if not mask[[i, j]].all() and meet_elsewhere(triangles[i], triangles[j]):
                mask[[i, j]] = True
    return mask


def solid(vertices, faces):
    """The faces that have area."""
    p, q, r = np.moveaxis(np.asarray(vertices)[faces], 1, 0)
    return faces[np.any(np.cross(q - p, r - p), axis=1)]


FLAT = [(0, 0, 0), (4, 0, 0), (0, 4, 0)]


# --- exact arithmetic on many faces

GRID = hnp.arrays(np.int64, st.tuples(st.integers(6, 24), st.just(3)), elements=st.integers(0, 3))


@given(vertices=GRID)
@settings(max_examples=50)
def test_a_soup_touches_where_exact_arithmetic_says(vertices):
    faces = solid(vertices, np.arange(len(vertices) // 3 * 3).reshape(-1, 3))
    assert np.array_equal(touching(vertices, faces), exactly_touching(vertices, faces))


@pytest.mark.slow
@given(vertices=GRID, data=st.data())
@examples(17, at_night=50)
def test_a_mesh_touches_where_exact_arithmetic_says(vertices, data):
    # Few vertices for many faces: fans, folds, copies and seams.
    rows = hnp.arrays(
        np.int64, st.tuples(st.integers(2, 12), st.just(3)), elements=st.integers(0, 7)
    )
    faces = solid(vertices, data.draw(rows) % len(vertices))
    assert np.array_equal(touching(vertices, faces), exactly_touching(vertices, faces))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["teapot", "spheres", "noisy"])
def test_a_part_that_crosses_itself_does_so_where_exact_arithmetic_says(name):
    ball = shapes.sphere(2)
    mesh = {
        "teapot": shapes.teapot(3),
        "spheres": joined(
            ball, Mesh(vertices=ball.vertices + np.array((0.9, 0.3, 0.2)), faces=ball.faces)
        ),
        "noisy": shapes.icosahedron(noise=0.35, subdivisions=2, seed=1),
    }[name]
    expected = exactly_touching(mesh.vertices, mesh.faces)
    assert 0 < expected.sum() < mesh.n_faces / 2
    assert np.array_equal(of_mesh(mesh), expected)


# --- distances


def nearest(one, other):
    """Distance of two triangles that do not cross, from corners and edges; (3, 3) each."""
    items = []
    for a, b in ((one, other), (other, one)):
        for p in a:
            u, v = b[1] - b[0], b[2] - b[0]
            (s, t), *_ = np.linalg.lstsq(np.stack([u, v], axis=1), p - b[0], rcond=None)
            if s >= 0 and t >= 0 and s + t <= 1:
                items.append(np.linalg.norm(p - b[0] - s * u - t * v))
    for i in range(3):
        for j in range(3):
            p, u, q, v = one[i], one[i - 1] - one[i], other[j], other[j - 1] - other[j]
            r = q - p
            k = np.cross(u, v)
            if k @ k > 1e-20 * (u @ u) * (v @ v):
                s, t = np.cross(r, v) @ k / (k @ k), np.cross(r, u) @ k / (k @ k)
                if 0 <= s <= 1 and 0 <= t <= 1:
                    items.append(np.linalg.norm(p + s * u - q - t * v))
            for start, way, point in ((p, u, q), (p, u, q + v), (q, v, p), (q, v, p + u)):
                s = np.clip((point - start) @ way / (way @ way), 0, 1)
                items.append(np.linalg.norm(start + s * way - point))
    return min(items)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32), thin=st.floats(0, 6), flat=st.booleans())
@examples(17, at_night=50)
def test_no_pair_within_the_tolerance_is_missed(seed, thin, flat):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(2, 3, 3))
    for triangle in (one, other):  # needles, as thin as the tolerance
        triangle[2] = triangle[rng.integers(2)] + (triangle[2] - triangle[0]) * 10.0**-thin
    if flat:
        one[:, 2] = other[:, 2] = 0
    # Push them together until they nearly meet.
    other += 3 * (one.mean(axis=0) - other.mean(axis=0))
    distance = nearest(one, other)
    assume(distance > 1e-9)
    assert of_soup([one, other], 1.0001 * distance).all()


@pytest.mark.parametrize("gap", [1e-10, 1e-8, 1e-6, 1e-2])
@pytest.mark.parametrize("seed", range(4))
def test_sheets_touch_up_to_the_tolerance_and_not_beyond(gap, seed):
    flat = np.array(FLAT, float)
    pairs = [
        (flat, flat / 2 + (0.5, 0.5, gap)),  # face to face
        (flat, [(1, 1, gap), (1, 1, 3), (2, 1, 3)]),  # corner to face
        (flat, [(2, -1, -1 + 2**0.5 * gap), (2, 1, 1 + 2**0.5 * gap), (2, -3, 0)]),  # edge to edge
        (flat, flat + np.array((0, 4 + 1e-6, gap))),  # beside each other
    ]
    for one, other in pairs[:3]:
        pair = np.array([one, other]) @ rotation(seed) + (5, -3, 2)
        assert of_soup(pair, 1.001 * gap).all()
        assert not of_soup(pair, 0.97 * gap).any()
    assert not of_soup(pairs[3], 1e-7).any()


@pytest.mark.parametrize("seed", range(20))
def test_a_tolerance_of_none_is_raised_above_the_rounding(seed):
    # Turned and moved, the sheets meet only to within 1e-16.
    pair = np.array([FLAT, [(1, 1, 0), (1, 1, 3), (2, 1, 3)]], float) @ rotation(seed)
    assert of_soup(pair, 0).all()
    assert of_soup(pair + np.array((0.1, 0.2, 0.3)), 0).all()
    assert not of_soup(pair + np.array([[[0, 0, 0]], [[0, 0, 1e-9]]]) @ rotation(seed), 0).any()


# --- laws


@pytest.fixture(scope="module")
def teapot():
    mesh = shapes.teapot(5)
    return mesh, of_mesh(mesh)


def other_order(mesh, rng):
    """Faces in another order, each from another corner and some turned over, and their rows."""
    order = rng.permutation(mesh.n_faces)
    starts = rng.integers(3, size=mesh.n_faces)
    faces = np.take_along_axis(mesh.faces, (starts[:, None] + np.arange(3)) % 3, axis=1)
    faces = np.where(rng.random((mesh.n_faces, 1)) < 0.5, faces, faces[:, ::-1])
    return Mesh(mesh.vertices, faces[order]), order


def other_vertices(mesh, rng):
    """Corners with vertices of their own, and zeros of both signs."""
    order = rng.permutation(3 * mesh.n_faces)
    points = np.empty((3 * mesh.n_faces, 3))
    points[order] = mesh.vertices[mesh.faces].reshape(-1, 3)
    points[points == 0] = np.where(np.arange((points == 0).sum()) % 2, 0.0, -0.0)
    return Mesh(points, order.reshape(-1, 3)), slice(None)


def placed(scale):
    def change(mesh, rng):
        return Mesh((mesh.vertices @ rotation(5) + (1, -2, 3)) * scale, mesh.faces), slice(None)

    return change


def unused_vertices(scale):
    def change(mesh, rng):
        points = np.concatenate([mesh.vertices * scale, [(1e30, -1e30, 1e30), (0, 0, 5)]])
        return Mesh(points, mesh.faces), slice(None)

    return change


CHANGES = [other_order, other_vertices, *map(placed, (1e-150, 1e-6, 1e6, 1e25))]
CHANGES += map(unused_vertices, (1e-290, 1, 1e20))


@pytest.mark.parametrize("change", CHANGES, ids=range(len(CHANGES)))
def test_order_indices_place_and_size_change_nothing(teapot, change):
    mesh, marks = teapot
    other, rows = change(mesh, np.random.default_rng(0))
    assert np.array_equal(of_mesh(other), marks[rows])


def test_faces_without_area_touch_nothing():
    vertices = np.array([*FLAT, (1, 1, 0), (2, 2, 0), (1, 1, 1)], float)
    faces = np.array([(0, 1, 2), (0, 0, 4), (0, 3, 4), (3, 3, 3), (5, 3, 5)])
    assert not touching(vertices, faces).any()
    mask = np.array([False, True, True, True, True])
    assert not touching(vertices, faces, degenerate_mask=mask).any()
    both = np.concatenate([faces, [(3, 4, 5)]])
    assert np.flatnonzero(touching(vertices, both)).tolist() == [0, 5]


# --- whole parts

CLEAN = {
    "aeroplane": shapes.aeroplane(9856),
    "noisy icosahedron": shapes.icosahedron(noise=0.1, subdivisions=5),
    "room": shapes.room(),
    "plane": tessellated_plane(50, 50),
    "torus": shapes.torus(),
    "thin torus": shapes.torus(2000, 3, 1.0, 1e-3),
    "tube": tube(2000, 50),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CLEAN)
def test_a_part_that_does_not_cross_itself_has_no_contacts(name):
    mesh = CLEAN[name]
    assert not of_mesh(mesh).any()
    turned = Mesh(vertices=mesh.vertices @ rotation(2), faces=mesh.faces)
    assert not of_mesh(turned).any()


@pytest.mark.parametrize("seed", range(12))
def test_fans_are_compared_by_directions_like_pairs(monkeypatch, seed):
    """Faces at one corner: flat, folded, crossing and wound twice, among others and far off."""
    random = np.random.default_rng(seed)
    n = int(random.integers(20, 90))
    angle = np.sort(random.uniform(0, random.choice([2, 6.28, 13.0]), n))
    length = random.choice([1.0, 1e-3, 1e3], n)
    height = random.choice([0, 0.3]) * np.sin(9 * angle)
    rim = length[:, None] * np.column_stack((np.cos(angle), np.sin(angle), height))
    crowd = random.uniform(-1, 1, (10, 3, 3))
    points = np.concatenate(([(0, 0, 0.5 * (seed % 3))], rim, crowd.reshape(-1, 3)))
    row = np.arange(n)
    fan = np.column_stack((np.zeros(n, int), 1 + row, 1 + (row + 1) % n))
    faces = np.concatenate((fan, n + 1 + np.arange(30).reshape(10, 3)))
    mesh = Mesh(vertices=points + random.choice([0, 1e4]), faces=faces)
    given = mesh.vertices, mesh.faces, random.choice([0.0, 1e-9, 1e-6])
    items, partners = [], []
    for most in (10**9, 8):
        monkeypatch.setattr(contacts, "MOST_AT_A_CORNER", most)
        items.append(contacts.touching_faces(*given))
        partners.append(contacts.contact_partners(*given, items[-1]))
    np.testing.assert_array_equal(*items)
    np.testing.assert_array_equal(*(each.starts for each in partners))
    np.testing.assert_array_equal(*(each.faces for each in partners))


# --- the loops


def steps(monkeypatch, mesh):
    """Steps along the tree."""
    count = []
    find = contacts.solver_contacts.find_touching

    def counted(*args):
        count.append(find(*args))

    monkeypatch.setattr(contacts, "solver_contacts", SimpleNamespace(find_touching=counted))
    of_mesh(mesh, threads=1)
    monkeypatch.undo()
    return sum(count)


@pytest.fixture
def needles():
    """Ten large triangles under a fine torus: their boxes overlap all of its boxes."""
    corners = np.array([(-9, -9, -0.41), (9, -9, -0.41), (0, 9, -0.41)])
    walls = np.concatenate([corners - (0, 0, k / 100) for k in range(10)])
    return Mesh(vertices=walls, faces=np.arange(30).reshape(10, 3))


def half_circle(n):
    angle = np.linspace(0, np.pi, n)
    return np.column_stack((np.cos(angle), 0 * angle, np.sin(angle)))


def pages(n):
    """Faces about the edge of vertices 0 and 1."""
    return np.column_stack((np.zeros(n, int), np.ones(n, int), 2 + np.arange(n)))


def test_walls_needles_copies_pages_and_spots_cost_as_much_as_other_faces(monkeypatch, needles):
    """By calls of the loop, each of about so many steps; turned, boxes of needles overlap."""
    fine, turned = shapes.torus(100, 100), rotation(6)
    spot = Mesh(vertices=fine.vertices * 1e-4, faces=fine.faces)
    triangle = Mesh(vertices=np.array(FLAT) - (2, 2, 1), faces=[(0, 1, 2)])
    ends = np.array([(0, -1, 0), (0, 1, 0)])
    scenes = {
        "pages": Mesh(vertices=np.concatenate((ends, half_circle(5000))), faces=pages(5000)),
        "walls first": joined(needles, fine),
        "walls last": joined(fine, needles),
        "needles": tube(10_000, 50),
        "copies": Mesh(vertices=FLAT, faces=np.tile([(0, 1, 2)], (20_000, 1))),
        "spot": joined(spot, triangle),
    }
    most = 2 * steps(monkeypatch, fine)
    for name, mesh in scenes.items():
        assert steps(monkeypatch, mesh) < most, name
        mesh = Mesh(vertices=mesh.vertices @ turned, faces=mesh.faces)
        assert steps(monkeypatch, mesh) < most, name
    assert of_mesh(scenes["copies"]).all()


def stack_of(n, gap, seed):
    """Parallel sheets of eight faces, slanted, so that their boxes overlap."""
    rng = np.random.default_rng(seed)
    flat, faces = grid(2)
    heights = gap * rng.permutation(n // 8)[:, None]
    layers = np.tile(flat, (n // 8, 1, 1))
    vertices = np.concatenate((layers, np.broadcast_to(heights, layers.shape[:2])[..., None]), 2)
    starts = len(flat) * np.arange(n // 8)[:, None, None]
    turned = rotation(seed)
    return Mesh(vertices=vertices.reshape(-1, 3) @ turned, faces=(starts + faces).reshape(-1, 3))


@pytest.mark.parametrize("gap", [1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_slanted_sheets_in_a_stack_cost_as_much_a_face_in_any_number(monkeypatch, gap, seed):
    few, many = (steps(monkeypatch, stack_of(n, gap, seed)) for n in (800, 6400))
    assert many < 20 * few  # n log n: 12 times; all pairs: 64 times


def steps_to_partners(n):
    """Steps along the trees, and pairs, of n thin faces of one corner on a side of a triangle."""
    x = np.linspace(-1, 1, n + 1)
    side = np.column_stack((x, np.zeros((n + 1, 2))))
    vertices = np.concatenate(([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)], side))
    thin = np.column_stack((5 + np.arange(n), 4 + np.arange(n), np.full(n, 3)))
    faces = np.concatenate(([(0, 1, 2)], thin))
    touching = contacts.touching_faces(vertices, faces, HAIR)
    assert touching.all()
    starts, partners = np.empty(n + 2, np.int64), np.empty(24 * n, np.int32)
    given = (vertices, faces.astype(np.int64)), HAIR, touching, contacts.MOST_AT_A_CORNER
    result, count = contacts.solver_contacts.find_partners(*given, starts, partners)
    assert result == n  # the triangle, of each thin face; it has too many itself
    return count


def test_partners_in_a_fan_cost_as_much_a_face_in_any_number():
    few, many = steps_to_partners(2000), steps_to_partners(8000)
    assert many < 8 * few  # n log n: 5 times; all pairs: 16 times


@pytest.mark.parametrize("threads", [1, 2, 7, None])
@pytest.mark.parametrize("leaves", [1, 3, 10**6])
def test_threads_and_turns_change_nothing(monkeypatch, teapot, threads, leaves):
    mesh, marks = teapot
    monkeypatch.setattr(contacts, "LEAVES_A_PART", leaves)
    assert np.array_equal(of_mesh(mesh, threads=threads), marks)
