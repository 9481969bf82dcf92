"""Points within open bodies: those from which most directions first meet the back of one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.placement import Place, PoseSpace, in_solid

GOLDEN = (1 + 5**0.5) / 2


def directions():
    """Corners of an icosahedron and of its dual, (32, 3)."""
    signs = np.array(np.meshgrid([1, -1], [1, -1])).T.reshape(-1, 2)
    own = [np.roll([0, a, b * GOLDEN], k) for k in range(3) for a, b in signs]
    own += [np.roll([0, a / GOLDEN, b * GOLDEN], k) for k in range(3) for a, b in signs]
    own += [(a, b, c) for a, b in signs for c in (1, -1)]
    return np.array(own) / np.linalg.norm(own, axis=1, keepdims=True)


def first_hit(corners, point, way):
    """Row of the first triangle that a ray meets, by the parameters of Moeller and Trumbore."""
    a, b, c = corners.transpose(1, 0, 2)
    across = np.cross(way, c - a)
    size = np.einsum("ni,ni->n", b - a, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ni,ni->n", point - a, across) / size
        q = np.cross(point - a, b - a)
        v, t = q @ way / size, np.einsum("ni,ni->n", c - a, q) / size
    meets = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return int(np.where(meets, t, np.inf).argmin()) if meets.any() else -1


@examples(60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_enclosed_points_are_those_of_single_rays(seed, n):
    rng = np.random.default_rng(seed)
    corners = 0.5 * rng.uniform(-0.5, 0.5, (n, 1, 3)) + rng.uniform(-0.25, 0.25, (n, 3, 3))
    counts, points = rng.random(n) < 0.8, rng.uniform(-0.4, 0.4, (20, 3))
    tree = TriangleTree.over(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    behind = tree.behind(points, counts)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for point, is_enclosed in zip(points, behind, strict=True):
        hits = [first_hit(corners, point, way) for way in directions()]
        rows = zip(hits, directions(), strict=True)
        backs = sum(hit >= 0 and counts[hit] and normals[hit] @ way > 0 for hit, way in rows)
        assert is_enclosed == (2 * backs > 32)


def opened(mesh, height):
    """A mesh without its faces above a height."""
    return rc.Mesh(mesh.vertices, mesh.faces[mesh.centroids[:, 2] < height])


@pytest.mark.parametrize("name", ["sphere", "box", "torus", "aeroplane"])
@pytest.mark.parametrize("part", [0.85, 0.95])
def test_an_open_body_encloses_what_the_closed_one_does(name, part):
    """Far from the opening: where most directions would leave a body, it encloses nothing."""
    whole = rc.shapes.by_name(name)
    low, high = whole.bounds
    mesh = opened(whole, low[2] + part * (high[2] - low[2]))
    rng = np.random.default_rng(3)
    points = rng.uniform(low, high, (400, 3))
    if not in_solid(whole, points).any():
        points = rng.uniform(-0.2, 0.2, (400, 3)) * (high - low) + (low + high) / 2
    inside, result = in_solid(whole, points), in_solid(mesh, points)
    assert not result[~inside].any() or name == "aeroplane"
    deep = inside & (points[:, 2] < low[2] + 0.5 * (high[2] - low[2]))
    assert result[deep].mean() > 0.9 if deep.any() else True
    away = points + 2 * (high - low)
    assert not in_solid(mesh, away).any()


def room():
    """A room of six walls that face inwards, without its ceiling."""
    box = rc.shapes.box()
    return opened(rc.Mesh(box.vertices, box.faces[:, ::-1]), 0.4)


def test_a_room_seen_from_within_is_allowed_and_so_is_a_two_sided_sheet():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.49, 0.49, (200, 3))
    assert not in_solid(room(), points).any()
    body = opened(rc.shapes.box(), 0.4)
    assert in_solid(body, points[points[:, 2] < 0]).all()
    two_sided = body.with_groups(two_sided=[group.name for group in body.groups])
    assert not in_solid(two_sided, points).any()


def test_a_place_on_a_wall_or_in_a_corner_of_a_room_is_not_enclosed():
    walls = room()
    corners = walls.vertices
    edges = corners[walls.faces].mean(axis=1)
    middle = (corners[walls.faces[:, 0]] + corners[walls.faces[:, 1]]) / 2
    assert not in_solid(walls, np.concatenate((corners, edges, middle))).any()


def test_places_within_an_open_body_are_not_allowed():
    body = opened(rc.shapes.box(), 0.4)
    space = PoseSpace(mesh=body, stand_off=(0, 5), clearance=0.1)
    assert space.judge([(0, 0, 0), (2, 0, 0)]).tolist() == [Place.IN_SOLID, Place.ALLOWED]
    moved, result = space.project_to_allowed([(0.1, 0, 0)])
    assert result.all()
    assert space.allows(moved).all()
