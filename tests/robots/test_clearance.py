"""Distances of bodies: those of all pairs of their triangles."""

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from rastercov.core.mesh.contacts import TriangleTree
from rastercov.engine import mesh_clearance

pytestmark = pytest.mark.native


def rigid(rng, away=1.0):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    pose[:3, 3] = rng.normal(size=3) * away
    return pose


def soup(rng, n):
    return (rng.normal(size=(n, 1, 3)) + 0.3 * rng.normal(size=(n, 3, 3))).reshape(-1, 3)


def distances(one, other, poses, reach=np.inf):
    """Distances of triangles (N, 3) of corners each."""
    trees = [TriangleTree.over(p, np.arange(len(p)).reshape(-1, 3)) for p in (one, other)]
    result = np.full(len(poses), float(reach))
    mesh_clearance.distances(
        trees[0].corners, trees[0].nodes, trees[1].corners, trees[1].nodes, poses, result
    )
    return result


def of_two_triangles(a, b):
    """Distance as least squares over the weights of corners, none negative, of sum 1 each."""
    heavy = 1e4
    rows = np.zeros((5, 6))
    rows[:3, :3], rows[:3, 3:], rows[3, :3], rows[4, 3:] = a.T, -b.T, heavy, heavy
    weights = nnls(rows, np.array([0, 0, 0, heavy, heavy]))[0]
    first, second = weights[:3] / weights[:3].sum(), weights[3:] / weights[3:].sum()
    return np.linalg.norm(first @ a - second @ b)


def test_distances_are_those_of_all_pairs_of_triangles():
    rng, n_apart = np.random.default_rng(0), 0
    for _ in range(40):
        one, other, pose = soup(rng, 6), soup(rng, 5), rigid(rng, 1.5)
        turned = other @ pose[:3, :3].T + pose[:3, 3]
        wanted = min(
            of_two_triangles(a, b) for a in one.reshape(-1, 3, 3) for b in turned.reshape(-1, 3, 3)
        )
        result = distances(one, other, pose[None])[0]
        assert abs(result - wanted) <= 1e-6
        n_apart += result > 0
        back = np.linalg.inv(pose)[None]
        assert abs(distances(other, one, np.ascontiguousarray(back))[0] - result) <= 1e-13
        assert distances(one, other, pose[None], result / 2)[0] == result / 2
        assert distances(one, other, pose[None], -1.0)[0] == -1
    assert 5 < n_apart < 40


def test_larger_bodies_are_as_far_as_their_parts():
    rng = np.random.default_rng(1)
    one, other = soup(rng, 60), soup(rng, 50) * 0.2
    poses = np.stack([rigid(rng, 3.0) for _ in range(20)])
    parts = [
        distances(a, b, poses)
        for a in np.split(one, 4)  # 15 triangles each
        for b in np.split(other, 5)
    ]
    assert np.abs(distances(one, other, poses) - np.min(parts, axis=0)).max() <= 1e-13
