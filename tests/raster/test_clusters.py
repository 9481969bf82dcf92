"""Clusters hold the mesh bit for bit, their bounds hold, and leaving them out changes no count."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import tessellated_plane

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster import cpu
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.engine.raster_parts import ALTITUDE, FACES, LINE_BITS, VERTEX_STEP, VERTICES
from rastercov.engine.solver_raster import LANES, RADIUS, Scene

pytestmark = pytest.mark.native


class Clusters(NamedTuple):
    """Arrays of a scene; see `engine/raster/records.hpp`."""

    points: np.ndarray
    corners: np.ndarray
    faces: np.ndarray
    lines: np.ndarray
    vertex_starts: np.ndarray
    face_starts: np.ndarray
    line_starts: np.ndarray
    bounds: np.ndarray


def soup(rng, n, scale=1.0, offset=0.0):
    vertices = offset + scale * rng.normal(size=(3 * n, 3))
    return vertices, np.arange(3 * n).reshape(n, 3)


def of_mesh(mesh):
    return mesh.vertices, mesh.faces


def folded(rng):
    """Few vertices in many faces: some twice in a face, some in every face, some in none."""
    return rng.normal(size=(90, 3)), rng.integers(0, 80, (900, 3))


def flat(rng):
    vertices = rng.normal(size=(300, 3))
    vertices[:, 2] = 4
    return vertices, rng.integers(0, 300, (200, 3))


def nearly_flat(rng):
    vertices, faces = of_mesh(tessellated_plane())
    return vertices + rng.normal(size=vertices.shape) * (0, 0, 2e-10), faces


def fan(rng):
    """One vertex in each of 200 faces."""
    vertices = rng.normal(size=(201, 3))
    return vertices, np.stack(
        (np.zeros(200, int), np.arange(1, 201), np.arange(1, 201) % 200 + 1)
    ).T


HOSTILE = {
    "65 equal faces": lambda rng: (rng.normal(size=(3, 3)), np.tile((2, 0, 1), (65, 1))),
    "one point": lambda rng: (np.full((4, 3), 0.1), rng.integers(0, 4, (100, 3))),
    "folded": folded,
    "flat": flat,
    "nearly flat": nearly_flat,
    "fan": fan,
    "closed": lambda rng: of_mesh(shapes.torus(30, 20)),
    "far": lambda rng: soup(rng, 100, offset=1e12),
    "tiny": lambda rng: soup(rng, 100, scale=1e-300),
    "huge": lambda rng: soup(rng, 100, scale=1e150),
    "a grain on a plate": lambda rng: (
        np.concatenate((soup(rng, 50)[0] * 1e-12, soup(rng, 50)[0] * 1e6)),
        np.arange(300).reshape(100, 3),
    ),
}

NORMALS = st.integers(-4, 4).map(float)
SOUPS = st.tuples(
    st.lists(st.tuples(NORMALS, NORMALS, NORMALS), min_size=1, max_size=40),
    st.lists(st.tuples(*[st.integers(0, 10**6)] * 3), min_size=1, max_size=200),
).map(lambda drawn: (np.array(drawn[0]), np.array(drawn[1]) % len(drawn[0])))


def made(vertices, faces, is_wound):
    vertices = np.array(vertices, np.float64)
    faces = np.array(faces, np.int32, order="C")
    return vertices, faces, Clusters(*Scene(vertices, faces, np.zeros(3), is_wound).clusters)


def taken_apart(clusters):
    """Of each cluster: its vertices (N, 3), its slots' corners (M, 3) and faces (M,)."""
    n = len(clusters.face_starts) - 1
    for k in range(n):
        begin, end = clusters.vertex_starts[k : k + 2]
        points = clusters.points[3 * begin : 3 * end].reshape(3, -1).T
        slots = slice(*clusters.face_starts[k : k + 2])
        packed = clusters.corners[slots, None]
        yield k, points, packed >> np.array((0, 8, 16)) & 255, clusters.faces[slots]


def assert_holds_the_mesh(vertices, faces, clusters):
    """Every face once, as it was; clusters as small as they can be for what is in them."""
    held = []
    for k, points, corners, names in taken_apart(clusters):
        is_face = corners.any(axis=1)
        # Fillers come last, and are all zero; a face that is one vertex may look like one.
        count = np.flatnonzero(is_face)[-1] + 1 if is_face.any() else 1
        collapsed = (np.ptp(faces, axis=1) == 0)[names]
        assert (is_face | collapsed)[:count].all()
        assert corners.max() < len(points) <= VERTICES
        assert len(names) <= FACES
        assert len(names) % LANES == 0
        assert len(points) % VERTEX_STEP == 0
        assert corners.max() + 1 > len(points) - VERTEX_STEP
        assert np.array_equal(np.unique(corners), np.arange(corners.max() + 1))
        last = points[corners.max() :]
        assert (last.view(np.int64) == last[0].view(np.int64)).all()
        names, corners = names[is_face], corners[is_face]
        assert np.array_equal(points[corners].view(np.int64), vertices[faces[names]].view(np.int64))
        held.append(names)
        lines = clusters.lines[slice(*clusters.line_starts[k : k + 2])]
        assert set(lines) >= set(names >> LINE_BITS)
        assert len(np.unique(lines)) == len(lines) <= len(is_face)
    kept = np.flatnonzero(np.ptp(faces, axis=1) > 0)
    names = np.concatenate(held)
    assert np.array_equal(np.sort(names[np.isin(names, kept)]), kept)
    assert len(np.unique(names)) == len(names)
    # All that a cluster can have are read at once.
    assert len(clusters.faces) == len(clusters.corners) >= clusters.face_starts[-2] + FACES
    assert len(clusters.points) == 3 * clusters.vertex_starts[-1] + LANES
    assert clusters.face_starts[-1] >= len(faces)


def assert_bounds_hold(clusters):
    """Sphere, cone, planes and altitudes, to rounding."""
    assert np.isfinite(clusters.bounds).all()
    n = len(clusters.face_starts) - 1
    assert clusters.bounds.shape[1] >= -(-n // LANES) * LANES  # whole vectors are read
    assert not clusters.bounds[:, n:].any()
    for k, points, corners, _ in taken_apart(clusters):
        *centre, radius = clusters.bounds[:4, k]
        size = np.abs(points).max()
        away = np.sqrt(((points - centre) ** 2).sum(axis=1))
        assert (away <= radius * (1 + 1e-12)).all()
        assert radius <= (np.ptp(points, axis=0) * (1 + 1e-12)).max() * 3**0.5 + 1e-15 * size
        axis, (cosine, sine, offset, altitude) = clusters.bounds[4:7, k], clusters.bounds[7:, k]
        assert altitude >= 0
        if altitude == 0:  # no pose leaves it out for its back
            continue
        assert np.isclose(cosine**2 + sine**2, 1, rtol=1e-15, atol=0)
        assert min(cosine, sine) >= 0
        assert np.isclose(np.linalg.norm(axis), 1, rtol=1e-15, atol=0)
        is_filler = ~corners.any(axis=1)
        a, b, c = points[corners[~is_filler]].swapaxes(0, 1)
        assert len(a) > len(corners) - LANES  # a face that is one vertex has no altitude
        normals = np.cross(b - a, c - a)
        doubled = np.linalg.norm(normals, axis=1)
        normals /= doubled[:, None]
        sides = np.linalg.norm((b - a, c - a, c - b), axis=2).max(axis=0)
        assert (normals @ axis >= cosine - 1e-15).all()
        assert (np.linalg.norm(np.cross(normals, axis), axis=1) <= sine + 1e-12).all()
        assert ((normals * (a - centre)).sum(axis=1) >= offset - 1e-12 * radius).all()
        assert (doubled / sides >= altitude * (1 - 1e-12)).all()


@pytest.mark.parametrize("is_wound", [False, True])
@pytest.mark.parametrize("name", HOSTILE)
def test_clusters_hold_the_mesh_bit_for_bit_and_bounds_hold_the_clusters(name, is_wound):
    mesh = made(*HOSTILE[name](np.random.default_rng(3)), is_wound)
    assert_holds_the_mesh(*mesh)
    if name != "tiny":  # see below
        assert_bounds_hold(mesh[2])


@given(SOUPS, st.booleans())
@settings(max_examples=25)
def test_clusters_and_bounds_hold_any_soup(mesh, is_wound):
    clustered = made(*mesh, is_wound)
    assert_holds_the_mesh(*clustered)
    assert_bounds_hold(clustered[2])


def test_what_is_too_small_to_square_is_a_point_that_is_never_left_out_for_its_back():
    clusters = made(*HOSTILE["tiny"](np.random.default_rng(3)), True)[2]
    assert np.isfinite(clusters.bounds).all()
    assert (clusters.bounds[10] == 0).all()


def test_clusters_of_a_smooth_mesh_are_full_compact_and_look_one_way():
    # Else nothing is wrong, but much is slow.
    mesh = shapes.torus(100, 50)
    clusters = made(mesh.vertices, mesh.faces, True)[2]
    n = len(clusters.face_starts) - 1
    assert n <= 1.05 * mesh.n_faces / FACES
    assert clusters.vertex_starts[-1] <= 55 * n
    radius, cosine, altitude = clusters.bounds[[3, 7, 10], :n]
    assert np.median(radius) < 0.35
    assert np.median(cosine) > 0.85
    assert np.mean(altitude > 0) > 0.9


def test_both_sides_of_a_face_are_one_direction_unless_the_mesh_is_wound():
    flat = tessellated_plane(4, 4)
    faces = np.concatenate((flat.faces, flat.faces[:, ::-1]))
    for is_wound, n_clusters in ((False, 1), (True, 2)):
        clusters = made(flat.vertices, faces, is_wound)[2]
        assert len(clusters.face_starts) - 1 == n_clusters


# --- leaving them out -----------------------------------------------------------------------------


def wound(vertices, faces):
    """A mesh whose back faces are hidden, closed or not: what is behind them shows all mistakes."""
    mesh = Mesh(vertices=vertices, faces=faces)
    mesh.__dict__.update(can_cull_back_faces=True, is_closed_outward=True)
    return mesh


MESHES = {
    "torus": lambda rng: shapes.torus(60, 30),
    "teapot": lambda rng: wound(*of_mesh(shapes.teapot(5))),
    "aeroplane": lambda rng: shapes.aeroplane(),
    "box": lambda rng: shapes.box((1, 2, 0.5), n=10),
    "soup": lambda rng: wound(*soup(rng, 300)),
}


def unit(rng, n):
    directions = rng.normal(size=(n, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def poses_about(mesh, rng, n=12):
    """From the outside of its box: close, far, edge-on, along its faces, and beside it."""
    low, high = mesh.bounds
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(high - low)
    face = mesh.vertices[mesh.faces[rng.integers(mesh.n_faces, size=n)]]
    middle = face.mean(axis=1)
    normal = np.cross(face[:, 1] - face[:, 0], face[:, 2] - face[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-300
    along = np.cross(normal, unit(rng, n))
    near_it = size * 10 ** rng.uniform(-3, 0, (n, 1))
    in_plane = size * 10 ** rng.uniform(-5, -1, (n, 1)) * rng.choice((-1, 1), (n, 1))
    all_round = centre + unit(rng, n) * size * 10 ** rng.uniform(-0.2, 2, (n, 1))
    beyond = np.where(rng.random((n, 3)) < 0.5, low, high) + 1e-3 * size * rng.normal(size=(n, 3))
    eyes = np.concatenate(
        (
            all_round,
            middle + normal * near_it,
            middle + along * near_it * 3 + normal * in_plane,
            beyond,
        )
    )
    targets = np.concatenate(
        (
            centre + 0.3 * size * rng.normal(size=(n, 3)),
            middle,
            middle,
            beyond + unit(rng, n),
        )
    )
    return look_at(eyes, targets)


def counts_agree(mesh, camera, poses, **options):
    """Counts with and without clusters left out, and with `drawn`; how many of these matter."""
    with CPURasterizer(mesh, camera, threads=1, **options) as rasterizer:
        result = rasterizer.count(poses, drawn=False)
        drawn = rasterizer.count(poses)
        scene = cpu._scene_of(mesh)
        bounds = Clusters(*scene.clusters).bounds.copy()
        bounds[ALTITUDE] = 0  # nothing is turned away
        scene.set_bounds(bounds)
        culled = rasterizer.count(poses, drawn=False)
        bounds[RADIUS] = 1e200  # nothing is outside
        scene.set_bounds(bounds)
        expected = rasterizer.count(poses, drawn=False)
        expected_drawn = rasterizer.count(poses)
    for counts in (result, drawn, culled, expected_drawn):
        wrong = (counts.visible != expected.visible).any(axis=1)
        assert not wrong.any(), f"{wrong.sum()} of {len(poses)} poses: {np.flatnonzero(wrong)}"
        assert np.array_equal(counts.background, expected.background)
    assert np.array_equal(drawn.drawn, expected_drawn.drawn)


CAMERAS = {
    "plain": (Camera(width=90, height=70, fx=80, fy=80), {}),
    "tiny": (Camera(width=12, height=9, fx=3, fy=4), {}),
    "large": (Camera(width=301, height=203, fx=900, fy=700), {}),
    "fine": (Camera(width=40, height=30, fx=38, fy=45), {"supersample": 5}),
    "rolled": (Camera(width=61, height=50, fx=90, fy=40), {"supersample": 2, "roll": 0.4}),
    "beside": (Camera(width=50, height=50, fx=60, fy=60, cx=-70, cy=110), {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("name", MESHES)
def test_leaving_out_clusters_changes_no_count(name, view):
    camera, options = CAMERAS[view]
    rng = np.random.default_rng(1)
    mesh = MESHES[name](rng)
    assert mesh.can_cull_back_faces
    counts_agree(mesh, camera, poses_about(mesh, rng), **options)


@pytest.mark.parametrize("scale", [1, 5])
def test_faces_that_rounding_turns_towards_the_camera_are_counted(scale):
    # A sheet from a hair behind it: corners move by half a step, and some faces turn over.
    rng = np.random.default_rng(6)
    sheet = wound(*of_mesh(tessellated_plane(20, 6)))
    n = 400
    targets = rng.uniform(-0.4, 0.4, (n, 3)) * (1, 1, 0)
    angle = rng.uniform(0, 2 * np.pi, n)
    eyes = targets + np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1)
    eyes[:, 2] = -(10 ** rng.uniform(-6, -1, n))
    poses = look_at(eyes, targets + 0.2 * rng.normal(size=(n, 3)))
    roll = rng.uniform(0, 2 * np.pi, n)
    turn = np.tile(np.eye(4), (n, 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(roll)
    turn[:, 1, 0] = np.sin(roll)
    turn[:, 0, 1] = -np.sin(roll)
    camera = Camera(width=90, height=70, fx=40, fy=40)
    counts_agree(sheet, camera, poses @ turn, supersample=scale)
    with CPURasterizer(sheet, camera, supersample=scale) as rasterizer:
        assert rasterizer.count(poses @ turn, drawn=False).visible.any()
