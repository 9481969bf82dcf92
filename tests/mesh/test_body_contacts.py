"""Contacts between two bodies, by two trees: those of all their faces together."""

import numpy as np
import pytest

from rastercov.core.mesh.contacts import TriangleTree, contact_partners, touching_faces
from rastercov.engine import mesh_bodies, mesh_contacts

pytestmark = pytest.mark.native


def soup(rng, n, size):
    points = rng.normal(size=(n, 1, 3)) + size * rng.normal(size=(n, 3, 3))
    return points.reshape(-1, 3), np.arange(3 * n, dtype=np.int32).reshape(n, 3)


def between(one, other, tolerance, room):
    """Pairs, and faces that touch, in the order of the bodies."""
    trees = [TriangleTree.over(*each) for each in (one, other)]
    marks = [np.zeros(len(faces), np.bool_) for _, faces in (one, other)]
    pairs = np.empty((room, 2), np.int32)
    arrays = [(tree.points, tree.faces, tree.boxes, tree.nodes) for tree in trees]
    n = mesh_contacts.list_between(*arrays, 0.1, tolerance * 0.1, *marks, pairs)
    values = [np.zeros_like(each) for each in marks]
    for own, tree, mark in zip(values, trees, marks, strict=True):
        own[tree.order[mark]] = True
    listed = np.stack([tree.order[pairs[:n, at]] for at, tree in enumerate(trees)], axis=1)
    return n, listed if n <= room else None, values


@pytest.mark.parametrize("seed", range(12))
def test_pairs_of_two_bodies_are_those_of_all_faces_together(seed):
    rng = np.random.default_rng(seed)
    one, other = soup(rng, int(rng.integers(1, 90)), 0.3), soup(rng, int(rng.integers(1, 90)), 0.3)
    tolerance = (1e-9, 0.05)[seed % 2]
    n_one = len(one[1])
    points = np.concatenate((one[0], other[0]))
    faces = np.concatenate((one[1], other[1] + np.int32(len(one[0]))))
    touching = touching_faces(points, faces, tolerance)
    partners = contact_partners(points, faces, tolerance, touching)
    rows = np.repeat(np.arange(len(faces)), np.diff(partners.starts))
    expected = {
        (a, b - n_one)
        for a, b in zip(rows.tolist(), partners.faces.tolist(), strict=True)
        if a < n_one <= b
    }
    n, pairs, marks = between(one, other, 1.01 * tolerance, 20_000)
    assert {tuple(pair) for pair in pairs.tolist()} == expected
    assert n == len(expected)
    for at, mark in enumerate(marks):
        assert set(np.flatnonzero(mark).tolist()) == {pair[at] for pair in expected}
    # Without room for the pairs, the faces are the same.
    again = between(one, other, 1.01 * tolerance, 0)
    assert again[1] is None or n == 0
    assert all(np.array_equal(a, b) for a, b in zip(again[2], marks, strict=True))


def test_points_that_coincide_stay_together_to_the_bit():
    rng = np.random.default_rng(2)
    points = np.repeat(rng.normal(size=(40, 3)), 3, axis=0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, :3, :3], poses[1, :3, 3] = turn, rng.normal(size=3)
    body = np.ones(len(points), np.int32)
    moved, bounds = np.empty_like(points), np.empty((2, 3))
    mesh_bodies.move_points(points, body, poses, moved, bounds)
    assert (moved[::3] == moved[1::3]).all()
    assert np.allclose(moved, points @ turn.T + poses[1, :3, 3], atol=1e-14)
    assert np.array_equal(bounds, [moved.min(axis=0), moved.max(axis=0)])
    mesh_bodies.move_points(points, 0 * body, poses, moved, bounds)
    assert moved.tobytes() == points.tobytes()
    mesh_bodies.turn(points, body, poses, moved)
    assert np.allclose(moved, points @ turn.T, atol=1e-14)
