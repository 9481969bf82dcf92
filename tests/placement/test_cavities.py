"""Cameras for hollows: where a face is open, where a camera can stand, what is proved shut."""

import math

import cavity_scenes as scenes
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet
from visible_fractions import visibility

import rastercov as rc
from rastercov.core.coverage.task import Reason
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.placement import in_solid
from rastercov.placement.candidates.cavities import Access, Hemicube, openings
from rastercov.placement.candidates.pool import Framing, per_face
from rastercov.placement.candidates.rooms import KeepOutBox, KeepOutSphere, filter_candidates

CAMERA = rc.Camera(width=320, height=240, fx=450, fy=450, cx=160, cy=120)
FAR = Framing(stand_off=(6.0, 30.0))


def covered_by(mesh, poses, faces):
    """Whether any of the poses covers each face."""
    reason = rc.evaluate(mesh, CAMERA, poses, by="face").reason[:, faces]
    return (reason == Reason.COVERED).any(axis=0)


def inner(mesh):
    """Faces that are on no side of the bounding box."""
    outside = np.isclose(mesh.centroids, mesh.bounds[0]) | np.isclose(
        mesh.centroids, mesh.bounds[1]
    )
    return np.flatnonzero(~outside.any(axis=1))


def outer_poses(count, centre, radius, seed=0):
    """Poses around a part that look into it."""
    rng = np.random.default_rng(seed)
    away = rng.normal(size=(count, 3))
    away *= radius / np.linalg.norm(away, axis=1, keepdims=True)
    return rc.look_at(centre + away, centre + rng.uniform(-1, 1, (count, 3)))


@pytest.mark.slow
@given(
    direction=st.tuples(*3 * [st.floats(-1, 1)]).filter(lambda d: np.linalg.norm(d) > 0.01),
    side=st.sampled_from([2, 4, 32]),
)
@examples(8)
def test_a_cone_as_wide_as_can_be_missed_holds_a_direction(direction, side):
    towards = np.array(direction) / np.linalg.norm(direction)
    towards[2] = abs(towards[2])
    with Hemicube(shapes.box(), side) as hemicube:
        nearest = np.arccos(np.clip(hemicube.directions @ towards, -1, 1)).min()
        assert nearest <= hemicube.missed


@pytest.mark.slow
def test_the_ground_of_a_blind_hole_is_reached_where_views_from_around_miss_it():
    mesh = scenes.blind_hole()
    ground = scenes.faces_at(mesh, (2.5, 2.5, 1.0), (0, 0, 1))
    assert len(ground) == 2
    around = per_face(mesh, CAMERA, FAR, faces=np.setdiff1d(np.arange(mesh.n_faces), inner(mesh)))
    beside = np.linalg.norm(around.poses[:, :2, 3] - 2.5, axis=1) > 2.5
    assert beside.sum() > 50
    assert not covered_by(mesh, around.poses[beside], ground).any()
    result = openings(mesh, CAMERA, FAR, faces=ground)
    assert (result.access == Access.REACHED).all()
    assert covered_by(mesh, result.candidates.poses, ground).all()
    # From the centroid one sees a square of side 1 at height 4: about 1/16 of a steradian.
    assert result.open_share == pytest.approx(1 / 16 / (2 * np.pi), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [scenes.blind_hole, scenes.overhang, scenes.bottle])
def test_a_face_with_candidates_of_its_own_is_covered_by_one(scene):
    mesh = scene()
    result = openings(mesh, CAMERA, FAR, faces=inner(mesh)[::3], finest=64)
    reached = result.face[result.access == Access.REACHED]
    assert len(reached) > 10
    covered = covered_by(mesh, result.candidates.poses, reached)
    assert covered.mean() > 0.97
    assert set(result.candidates.index) == set(reached)


@pytest.mark.slow
def test_through_a_narrow_neck_only_what_lies_before_it_is_reached():
    mesh = scenes.bottle()
    farther = Framing(stand_off=(8.0, 30.0))  # than the chamber is wide
    below = scenes.faces_at(mesh, (3.5, 3.5, 1.0), (0, 0, 1))
    # The shoulder of the chamber turns away from the neck: no camera outside can see it.
    ceiling = scenes.faces_at(mesh, (1.5, 1.5, 4.0), (0, 0, -1))
    result = openings(mesh, CAMERA, farther, faces=[*below, *ceiling])
    assert result.access.tolist() == 2 * [Access.REACHED] + 2 * [Access.CLOSED]
    outside = outer_poses(200, np.array([3.5, 3.5, 3.0]), 9.0)
    assert (visibility(mesh, CAMERA, outside).visibility[:, ceiling] == 0).all()
    assert (result.missed_deg[2:] < 0.7).all()
    assert result.proof == ("",) * 4  # it is open to the outside: nothing to prove
    assert "open cones are narrower than 0.63°" in result.words(2)


@pytest.mark.slow
def test_the_end_of_a_bent_channel_is_closed_to_cameras_outside_and_reached_from_within():
    mesh = scenes.bent_channel(blind=True)
    end = scenes.faces_at(mesh, (6.0, 2.5, 1.5), (-1, 0, 0))
    assert len(end) == 2
    result = openings(mesh, CAMERA, FAR, faces=end)
    assert (result.access == Access.CLOSED).all()
    outside = outer_poses(100, np.array([3.5, 2.5, 3.5]), 10.0)
    assert (visibility(mesh, CAMERA, outside).visibility[:, end] == 0).all()
    near = openings(mesh, CAMERA, Framing(stand_off=(0.5, 3.0)), faces=end)
    assert (near.access == Access.REACHED).all()
    assert covered_by(mesh, near.candidates.poses, end).all()


@pytest.mark.parametrize(
    ("framing", "limits", "words"),
    [
        (FAR, {}, "cameras are at least 6 m away"),
        (Framing(), {"clearance": 1.6}, "at most 3 m wide, and cameras keep a clearance of 1.6 m"),
        (Framing(), {"keep_out": [KeepOutBox((0.5, 0.5, 0.5), (4.5, 4.5, 4.5), "core")]}, "core"),
        (Framing(), {"keep_out": [KeepOutSphere((2.5, 2.5, 2.5), 2.7, "ball")]}, "ball"),
    ],
)
def test_a_closed_cavity_is_proved_out_of_reach_where_limits_exclude_it(framing, limits, words):
    mesh = scenes.closed_cavity()
    result = openings(mesh, CAMERA, framing, faces=inner(mesh), **limits)
    assert len(result.face) == 108
    assert (result.access == Access.ENCLOSED).all()
    assert not len(result.candidates)
    assert words in result.words(0)
    assert "proved" in result.words(0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "limits",
    [
        {"least": 2.5},
        {"clearance": 0.4},
        {"keep_out": [KeepOutBox((1.5, 0.5, 0.5), (4.5, 4.5, 4.5))]},
        {"keep_out": [KeepOutSphere((2.5, 2.5, 2.5), 2.5)]},
    ],
)
def test_nothing_is_proved_of_a_cavity_in_which_a_camera_may_stand(limits):
    limits = dict(limits)
    mesh = scenes.closed_cavity()
    framing = Framing(stand_off=(limits.pop("least", 0.0), 30.0))
    result = openings(mesh, CAMERA, framing, faces=inner(mesh)[::4], finest=64, **limits)
    assert (result.access != Access.ENCLOSED).all()
    assert (result.access == Access.REACHED).any()
    assert not filter_candidates(result.candidates, mesh, **limits)[1].any()


@pytest.mark.parametrize(
    ("n", "height", "x", "n_shut"),
    [(2, 1.5, -0.75, 4), (1, 1.4, -0.6, 0)],  # on it, over half of its top; sunk into it
)
def test_a_face_on_which_matter_lies_as_a_whole_is_out_of_reach(n, height, x, n_shut):
    low = shapes.box((2.0, 2.0, 1.0), n, (0, 0, 0.5))
    mesh = joined(low, shapes.box((-2 * x, 4.0, 1.0), 1, (x, 0, height)))
    top = np.flatnonzero((mesh.centroids[:, 2] == 1.0) & (mesh.normals[:, 2] > 0.9))
    result = openings(mesh, CAMERA, Framing(stand_off=(0.5, 20)), faces=top)
    under = (mesh.centroids[result.face, 0] < 0) & (n == 2)
    assert (under.sum(), len(result.face)) == (n_shut, 2 * n**2)
    assert ((result.access == Access.ENCLOSED) == under).all()
    assert n == 1 or (result.access[~under] == Access.REACHED).all()
    assert all(
        "solid material covers it" in result.words(int(row)) for row in np.flatnonzero(under)
    )


@pytest.mark.slow
@given(seed=st.integers(0, 100_000), share=st.floats(0.5, 0.8))
@example(seed=9589, share=0.5)  # cells that touch along edges, where four faces meet
@examples(4, 20)
def test_no_camera_within_the_limits_sees_a_face_that_is_proved_out_of_reach(seed, share):
    rng = np.random.default_rng(seed)
    solid = np.ones((5, 5, 5), bool)
    solid[1:4, 1:4, 1:4] = rng.random((3, 3, 3)) < share
    mesh = scenes.of_cubes(solid)
    least = 4.5
    result = openings(mesh, CAMERA, Framing(stand_off=(least, 20)), faces=inner(mesh), finest=32)
    shut = result.face[result.access == Access.ENCLOSED]
    eyes = np.concatenate((rng.uniform(0, 5, (60, 3)), rng.uniform(-8, 13, (60, 3))))
    targets = mesh.centroids[rng.choice(result.face, len(eyes))] if len(result.face) else eyes + 1
    seen = visibility(mesh, CAMERA, rc.look_at(eyes, targets)).visibility
    away = np.linalg.norm(eyes[:, None] - mesh.centroids[None], axis=2) >= least
    assert not (seen[:, shut][away[:, shut]] > 0).any()


def test_what_is_within_an_open_body_is_not_proved_to_be_out_of_reach():
    """Most directions from there meet backs, so no camera may be there; others look in."""
    cup = shapes.box((4, 4, 4))
    cup = Mesh(cup.vertices, cup.faces[cup.centroids[:, 2] > -1.9])
    mesh = joined(cup, shapes.box((1, 1, 1), centre=(0, 0, 0.5)))
    inside = np.arange(cup.n_faces, mesh.n_faces)
    above = mesh.centroids[inside] + 0.01 * mesh.normals[inside]
    assert in_solid(mesh, above).any()
    result = openings(mesh, CAMERA, Framing(stand_off=(1, 20)), faces=inside)
    assert (result.access != Access.ENCLOSED).all()
    eyes = np.random.default_rng(0).uniform((-3, -3, -8), (3, 3, -2.05), (200, 3))
    assert not in_solid(mesh, eyes).any()
    seen = visibility(mesh, CAMERA, rc.look_at(eyes, (0, 0, 0.5))).visibility[:, inside]
    assert (seen.max(axis=0) > 0.9).sum() == 10  # all but the two on top


@pytest.mark.slow
@given(seed=st.integers(0, 100_000), kind=st.integers(0, 6))
@examples(30, 500)
def test_nothing_is_proved_of_faces_that_a_place_outside_matter_sees(seed, kind):
    """Of cells as they come: twice, turned, missing, inside out, moved by rounding, two-sided."""
    rng = np.random.default_rng(seed)
    side = int(rng.integers(3, 6))
    solid = rng.random((side, side, side)) < rng.uniform(0.3, 0.95)
    if kind % 2:
        for axis in range(3):
            np.moveaxis(solid, axis, 0)[[0, -1]] = True
    solid[0, 0, 0] = True
    mesh = scenes.of_cubes(solid)
    vertices, faces = mesh.vertices, mesh.faces.copy()
    some = rng.choice(len(faces), 3, replace=False)
    match kind:
        case 1:
            faces = np.concatenate((faces, faces[some]))
        case 2:
            faces = np.delete(faces, some, axis=0)
        case 3:
            faces = faces[:, ::-1].copy()
        case 4:
            faces[some] = faces[some, ::-1]
        case 5:
            faces = np.concatenate((faces, faces[some, ::-1]))
        case 6:
            vertices = vertices + rng.normal(0, 1e-9, vertices.shape)
    groups = (Group("sheet", is_two_sided=bool(rng.random() < 0.2)), Group("block"))
    mesh = Mesh(vertices, faces, groups, rng.integers(0, 2, len(faces)))
    least = float(rng.choice([0.05, 0.5, 1.5, 3]))
    asked = rng.choice(mesh.n_faces, min(20, mesh.n_faces), replace=False)
    result = openings(mesh, CAMERA, Framing(stand_off=(least, 20)), faces=asked, finest=32)
    shut = result.face[result.access == Access.ENCLOSED]
    if len(shut):
        eyes = rng.uniform(np.repeat([0, -5], [120, 30])[:, None], (side,) * 3, (150, 3))
        poses = rc.look_at(eyes, mesh.centroids[rng.choice(shut, len(eyes))])
        seen = visibility(mesh, CAMERA, poses).visibility[:, shut]
        away = np.linalg.norm(eyes[:, None] - mesh.centroids[shut], axis=2) >= least
        assert not (seen[away & ~in_solid(mesh, eyes)[:, None]] > 0).any()


@pytest.mark.slow
def test_every_place_is_clear_within_the_stand_off_and_out_of_keep_out_volumes():
    mesh = scenes.blind_hole()
    framing = Framing(stand_off=(5.0, 12.0), rolls_deg=(0.0, 90.0))
    volume = KeepOutBox((-20, -20, 5), (2.4, 20, 20), "half")
    result = openings(mesh, CAMERA, framing, faces=inner(mesh), clearance=0.3, keep_out=[volume])
    poses, index = result.candidates.poses, result.candidates.index
    assert len(poses) > 20
    assert len(filter_candidates(result.candidates, mesh, 0.3, [volume])[0]) == len(poses)
    away = np.linalg.norm(poses[:, :3, 3] - mesh.centroids[index], axis=1)
    assert ((away >= 5 - 1e-6) & (away <= 12 + 1e-6)).all()
    # Each view comes once for each roll.
    assert (poses[0::2, :3, 3] == poses[1::2, :3, 3]).all()
    assert (np.einsum("ni,ni->n", poses[0::2, :3, 0], poses[1::2, :3, 0]) < 1e-9).all()


def test_where_no_camera_can_stand_or_only_behind_what_hides_the_face_there_are_no_candidates():
    hole = scenes.blind_hole()
    ground = scenes.faces_at(hole, (2.5, 2.5, 1.0), (0, 0, 1))
    above = KeepOutBox((-50, -50, 5), (50, 50, 50), "ceiling")
    walls = joined(sheet((-1, -1), (1, 1), 0.0), sheet((-500, -500), (500, 500), -5.0))
    before = KeepOutBox((-500, -500, -5.1), (500, 500, 0.5), "all the room before the wall")
    near = Framing(stand_off=(3, 90))
    for mesh, framing, faces, volume in ((hole, FAR, ground, above), (walls, near, [0, 1], before)):
        result = openings(mesh, CAMERA, framing, faces=faces, keep_out=[volume])
        assert (result.access == Access.NO_ROOM).all()
        assert (result.places > 0).all()
        assert "places" in result.words(0)
        assert result.summary()["no_room"] == 2


@pytest.mark.slow
def test_the_open_side_of_a_two_sided_sheet_is_found():
    part = sheet((-1, -1), (1, 1), 0.0)  # faces -z, where the block is
    mesh = joined(part, shapes.box((4.0, 4.0, 1.0), centre=(0, 0, -0.5005)))
    groups = (Group("sheet", is_two_sided=True), Group("block"))
    mesh = Mesh(mesh.vertices, mesh.faces, groups, np.repeat([0, 1], [2, 12]))
    result = openings(mesh, CAMERA, Framing(stand_off=(3, 9)), faces=[0, 1])
    assert (result.access == Access.REACHED).all()
    assert (result.candidates.poses[:, 2, 3] > 0).all()
    one_sided = mesh.with_groups(two_sided=())
    shut = openings(one_sided, CAMERA, Framing(stand_off=(3, 9)), faces=[0, 1])
    assert (shut.access != Access.REACHED).all()


@pytest.mark.slow
def test_views_of_a_face_differ():
    mesh = scenes.overhang()
    result = openings(mesh, CAMERA, FAR, faces=inner(mesh)[::3], views=3)
    for face in np.unique(result.candidates.index):
        ahead = result.candidates.poses[result.candidates.index == face][:, :3, 2]
        cosines = (ahead @ ahead.T)[np.triu_indices(len(ahead), 1)]
        assert len(ahead) <= 3
        assert (cosines <= math.cos(math.radians(15)) + 1e-9).all()


@pytest.mark.slow
def test_a_mesh_far_away_has_the_openings_it_has_at_the_origin():
    mesh = scenes.blind_hole()
    faces = inner(mesh)[::4]
    there = Mesh(vertices=mesh.vertices + 1e6, faces=mesh.faces)
    one, other = (openings(m, CAMERA, FAR, faces=faces) for m in (mesh, there))
    assert (one.access == other.access).all()
    assert one.open_share == pytest.approx(other.open_share, abs=2e-3)


def test_no_faces_and_faces_without_area_give_nothing():
    mesh = Mesh(vertices=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], faces=[(0, 1, 2), (0, 1, 1)])
    assert len(openings(mesh, CAMERA, FAR, faces=[]).face) == 0
    assert openings(mesh, CAMERA, FAR, faces=[0, 1]).face.tolist() == [0]
    assert set(openings(mesh, CAMERA, FAR, faces=[0, 1]).candidates.source) == {"cavity"}
