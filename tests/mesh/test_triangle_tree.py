"""The tree of boxes: every triangle is in its boxes, and a query finds what single triangles do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rastercov.core.mesh.contacts import LEAF, TriangleTree

pytestmark = pytest.mark.native


def soup(seed, n):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 1, 3)) + rng.normal(size=(n, 3, 3)) * rng.uniform(0, 1)
    return points.reshape(-1, 3), rng.permutation(3 * n).reshape(n, 3)


@given(seed=st.integers(0, 10**6), n=st.integers(1, 70), margin=st.sampled_from((0.0, 2.0**-20)))
@settings(max_examples=15)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_node_holds_the_triangles_below_it(seed, n, margin, dtype):
    points, faces = soup(seed, n)
    if dtype == np.float32:
        margin = 1e-5
    tree = TriangleTree.over(points, faces, margin=margin, dtype=dtype)
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(n))
    np.testing.assert_array_equal(tree.faces, faces[tree.order])
    leaves = len(tree.nodes) // 2
    for t, corners in enumerate(tree.corners):
        low, high = corners.min(axis=0), corners.max(axis=0)
        node = leaves + t // LEAF
        while node:
            assert (tree.nodes[node, :3] <= low).all()
            assert (-tree.nodes[node, 3:] >= high).all()
            node //= 2
    assert np.isinf(tree.nodes[leaves + -(-n // LEAF) :]).all()


@given(seed=st.integers(0, 10**6), n=st.integers(1, 70))
@settings(max_examples=15)
def test_a_segment_is_hit_where_a_triangle_alone_is_hit(seed, n):
    points, faces = soup(seed, n)
    points /= np.abs(points).max() * 2
    rng = np.random.default_rng(seed)
    origins, ends = rng.uniform(-0.6, 0.6, (2, 30, 3))
    reaches = np.linalg.norm(ends - origins, axis=1)
    segments = (origins, (ends - origins) / reaches[:, None], reaches, np.full(30, -1))
    tree = TriangleTree.over(points, faces)
    first_hits = tree.first_hits(*segments)
    alone = [TriangleTree.over(points, face[None]).first_hits(*segments) >= 0 for face in faces]
    np.testing.assert_array_equal(first_hits >= 0, np.any(alone, axis=0))
    for row in np.flatnonzero(first_hits >= 0):  # without the first one, another or none
        others = tree.first_hits(*(part[[row]] for part in (*segments[:3], first_hits)))
        assert others != first_hits[row]
        assert (others >= 0) == (np.sum(alone, axis=0)[row] > 1)
