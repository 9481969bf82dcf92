"""Segments: what the thesis found, what brute force finds, and what the order may not change."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet
from solids import tessellated_plane

from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.placement.candidates.segments import ANGLE_TOLERANCE_DEG, segment

pytestmark = pytest.mark.native
angles = st.floats(0.5, 85)
merges = pytest.mark.parametrize("merge", ["leader", "closest"])


@st.composite
def bumpy(draw):
    """An icosahedron of 80 or 320 faces, from nearly flat sides to a crumpled ball."""
    return shapes.icosahedron(
        draw(st.floats(0.01, 0.19)), draw(st.integers(1, 2)), draw(st.integers(0, 10**6))
    )


def neighbours_of(mesh):
    members = [set() for _ in range(mesh.n_faces)]
    for a, b in mesh.topology.neighbours.tolist():
        members[a].add(b)
        members[b].add(a)
    return members


def grown_by_comparing_all(mesh, alpha_deg):
    """(6.1) and (6.2) word by word: every normal of the segment is compared."""
    least, neighbours = np.cos(np.radians(alpha_deg + ANGLE_TOLERANCE_DEG)), neighbours_of(mesh)
    labels, count = np.full(mesh.n_faces, -1), 0
    for seed in range(mesh.n_faces):
        if labels[seed] >= 0:
            continue
        members, queue = [seed], deque([seed])
        labels[seed] = count
        while queue:
            for face in sorted(neighbours[queue.popleft()]):
                if labels[face] < 0 and (mesh.normals[members] @ mesh.normals[face]).min() >= least:
                    labels[face] = count
                    members.append(face)
                    queue.append(face)
        count += 1
    return labels


def averages(mesh, labels):
    sums = np.stack([mesh.normals[labels == s].sum(axis=0) for s in range(labels.max() + 1)])
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def degrees_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def same_parts(one, other):
    return len(set(zip(one.tolist(), other.tolist(), strict=True))) == one.max() + 1


def cone(n_sides, slope):
    """Sides of a cone, two faces each: a cylinder at slope 0."""
    angle = 2 * np.pi / n_sides * np.arange(n_sides)
    ring = np.stack((np.cos(angle), np.sin(angle), np.zeros(n_sides)), axis=1)
    points = np.concatenate((ring, ring * (1 - slope / 4) + (0, 0, 1 + slope)))
    here, there = np.arange(n_sides), (np.arange(n_sides) + 1) % n_sides
    lower = np.stack((here, there, there + n_sides), 1)
    upper = np.stack((here, there + n_sides, here + n_sides), 1)
    return Mesh(vertices=points, faces=np.concatenate((lower, upper)))


# What the thesis reports.


def test_an_icosahedron_falls_into_its_twenty_sides():  # figure 6.2
    assert segment(shapes.icosahedron(), 15, None).labels.tolist() == list(range(20))
    divided = segment(shapes.icosahedron(subdivisions=3), 15, 15)
    assert np.array_equal(divided.labels, np.arange(1280) // 64)
    flat = segment(shapes.icosahedron(subdivisions=3), 0, None)
    assert np.array_equal(flat.labels, divided.labels)


@pytest.mark.parametrize("seed", range(4))
@merges
def test_noise_breaks_sides_and_merging_mends_them(seed, merge):  # figures 6.3 and 6.4
    noisy = shapes.icosahedron(noise=0.04, subdivisions=3, seed=seed)
    assert segment(noisy, 15, None).n_segments > 40
    mended = segment(noisy, 15, 15, merge=merge)
    assert mended.n_segments == 20
    assert same_parts(mended.labels, np.arange(1280) // 64)


# Growing.


@given(
    mesh=bumpy() | st.sampled_from([cone(500, slope) for slope in (0.0, 0.2, 3.0)]), alpha=angles
)
@examples(20)
def test_growing_equals_comparing_with_every_normal(mesh, alpha):
    """Cylinder and cones have normals on a great circle and on smaller ones."""
    assert np.array_equal(segment(mesh, alpha, None).labels, grown_by_comparing_all(mesh, alpha))


def test_angles_that_round_to_the_limit_pass():
    """24 sides, 15 degrees from each to the next: rounding must not decide."""
    labels = segment(cone(24, 0.0), 15, None).labels
    assert labels.max() + 1 == 12
    assert (np.bincount(labels) == 4).all()


def test_growth_passes_through_a_face_without_area():
    """A T-junction: the long edge of one face meets two faces, a face without area fills it."""
    points = [(0, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 0), (0.5, -1, 0), (1.5, -1, 0)]
    mesh = Mesh(points, [(0, 1, 2), (0, 3, 1), (0, 4, 3), (3, 5, 1)])
    assert segment(mesh, 10, None).labels.tolist() == [0, -1, 0, 0]


def test_seams_of_repeated_vertices_do_not_stop_growth():
    whole = shapes.icosahedron(0.05, 2)
    seams = Mesh(whole.vertices[whole.faces].reshape(-1, 3), np.arange(960).reshape(-1, 3))
    assert np.array_equal(segment(seams, 15, 25).labels, segment(whole, 15, 25).labels)


def test_occluders_have_no_segment_and_stop_growth():
    strip = tessellated_plane(3, 1, jitter=0.0)
    groups = (Group("part"), Group("clamp", is_occluder=True))
    mesh = Mesh(strip.vertices, strip.faces, groups, [0, 0, 1, 1, 0, 0])
    assert segment(mesh, 10, None).labels.tolist() == [0, 0, -1, -1, 1, 1]
    assert segment(mesh, 10, 10).labels.tolist() == [0, 0, -1, -1, 0, 0]
    nothing = segment(strip.with_groups(occluders=["mesh"]), 15, 25)
    assert nothing.n_segments == 0
    assert (nothing.labels == -1).all()
    assert nothing.normals.shape == nothing.centroids.shape == (0, 3)


# Merging.


@pytest.mark.slow
@given(mesh=bumpy(), alpha=st.floats(3, 40), beta=angles)
@examples(5)
def test_merging_takes_all_within_beta_of_an_average(mesh, alpha, beta):
    grown, greatest = segment(mesh, alpha, None), beta + ANGLE_TOLERANCE_DEG
    owner = np.full(grown.n_segments, -1)
    for leader in range(grown.n_segments):  # a leader takes those near its own average
        if owner[leader] < 0:
            near = degrees_between(grown.normals, grown.normals[leader]) <= greatest
            owner[near & (owner < 0)] = leader
    assert same_parts(segment(mesh, alpha, beta).labels, owner[grown.labels])
    labels = grown.labels.copy()
    while labels.max():  # or the closest are merged, until none are near
        means = averages(mesh, labels)
        cosines = means @ means.T - 3 * np.eye(len(means))
        one, other = sorted(divmod(int(cosines.argmax()), len(means)))
        if cosines[one, other] < np.cos(np.radians(greatest)):
            break
        labels[labels == other] = one
        labels[labels > other] -= 1
    assert same_parts(segment(mesh, alpha, beta, merge="closest").labels, labels)


@merges
def test_patches_that_face_one_way_are_one_segment(merge):
    apart = joined(sheet((0, 0), (1, 1), 1.0), sheet((3, 0), (4, 1), 1.0))
    assert segment(apart, 15, 25, merge=merge).labels.tolist() == [0, 0, 0, 0]


# Laws of the whole.


@merges
def test_the_same_mesh_gives_the_same_segments_turned_and_scaled(merge):
    mesh = shapes.icosahedron(0.15, 3)
    turned = Mesh(mesh.vertices[:, [1, 2, 0]] * 2.0**20, mesh.faces)
    here, there = (segment(m, 20, 30, merge=merge) for m in (mesh, turned))
    assert np.array_equal(here.labels, there.labels)
    np.testing.assert_allclose(there.normals, here.normals[:, [1, 2, 0]], atol=1e-12)
    np.testing.assert_allclose(there.areas, here.areas * 2.0**40, rtol=1e-12)


def test_a_segment_has_the_averages_of_its_faces():
    mesh = shapes.aeroplane()
    result = segment(mesh, 15, 25)
    np.testing.assert_allclose(result.normals, averages(mesh, result.labels), atol=1e-12)
    assert (np.diff(np.unique(result.labels, return_index=True)[1]) > 0).all()  # in their order
    for label in range(result.n_segments):
        mine = result.labels == label
        corners = mesh.vertices[mesh.faces[mine]].reshape(-1, 3)
        np.testing.assert_allclose(result.centroids[label], corners.mean(axis=0), atol=1e-9)
        assert result.sizes[label] == mine.sum()
        assert result.areas[label] == pytest.approx(mesh.areas[mine].sum())
    with pytest.raises(ValueError, match="read-only"):
        result.labels[0] = 1


@merges
def test_angles_up_to_the_right_angle_are_allowed(merge):
    most = np.nextafter(90, 0)
    result = segment(shapes.sphere(1), most, most, merge=merge)
    assert 2 <= result.n_segments <= 8
    assert np.isfinite(result.normals).all()
