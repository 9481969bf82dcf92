"""Frames of a motion share what their rest pose decides: they are meshes of moved vertices."""

import pickle

import numpy as np
import pytest
import swept_arm as arm
from nightly import amount
from scenes import joined as joined_meshes
from surfaces import surface_of
from timed import regions_over_time

import rastercov as rc
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.table import join
from rastercov.core.mesh.bodies import MOST_PARTNERS
from rastercov.motion.regions import ViewKeys
from rastercov.placement.targets import with_target

CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
TASK = rc.Task(max_incidence_deg=75)


def rebuilt(motion, row):
    """Mesh of a frame, made of moved vertices alone, and the face at rest of each of its faces."""
    there = motion.present[row][motion.body]
    mesh, body = motion.mesh, motion.body[there]
    points = mesh.vertices[mesh.faces[there]]
    poses = motion.world_from_body[row][body]
    moved = np.einsum("fij,fkj->fki", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    # Corners of faces of one body that coincide at rest are one vertex: turned apart, they round
    # in the same way, because each is the same sum.
    faces = np.arange(3 * len(points)).reshape(-1, 3)
    return rc.Mesh(moved.reshape(-1, 3), faces, mesh.groups, mesh.face_group[there]), there


def check(motion, camera, poses, task=TASK, rows=None):
    """Areas of every frame are those of the mesh of moved vertices."""
    regions = regions_over_time(motion, camera, poses, task, threads=1)
    areas, bounds, n = regions.areas(), regions.bounds(), len(regions.pose_ids) // len(motion)
    total = motion.mesh.areas[motion.mesh.task_mask].sum()
    for row in range(len(motion)) if rows is None else rows:
        mesh, there = rebuilt(motion, row)
        expected = rc.regions(mesh, camera, poses, task, threads=1)
        own = slice(row * n, row * n + n)
        assert np.abs(areas[own, there] - expected.areas()).max() <= 1e-9 * total
        assert np.abs(bounds[own, there] - expected.bounds()).max() <= 1e-9 * total
        assert not areas[own, ~there].any()
    return regions


def test_fifty_frames_of_a_robot_are_meshes_of_moved_vertices():
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(50)))
    check(motion, CAMERA, arm.CAMERAS, rc.Task())


def test_frames_through_a_lens_are_meshes_of_moved_vertices():
    lens = rc.Camera(
        width=320, height=240, fx=160, fy=160, model="opencv_fisheye", distortion=(0.02, 0, 0, 0)
    )
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(3)))
    regions = regions_over_time(motion, lens, arm.CAMERAS[:2], rc.Task(), threads=1)
    for row in range(3):
        mesh, _ = rebuilt(motion, row)
        expected = rc.regions(mesh, lens, arm.CAMERAS[:2], rc.Task(), threads=1)
        gap = np.abs(regions.areas()[2 * row : 2 * row + 2] - expected.areas())
        bounds = regions.bounds()[2 * row : 2 * row + 2] + expected.bounds()
        assert (gap <= bounds + 1e-12).all()


def test_targets_move_with_their_body_and_hide_nothing():
    mesh = arm.cell()
    mesh = with_target(mesh, rc.shapes.box().moved(scale=0.1, translation=(0.4, 0, 0.4)), "space")
    moves = arm.frames(arm.sweep(4)) | {"space": rc.conveyor(4, direction=(0, 1, 0), distance=0.2)}
    check(rc.Motion(mesh, moves), CAMERA, arm.CAMERAS, rc.Task())


def test_a_mesh_of_targets_alone_moves():
    part = rc.shapes.box().with_groups(targets=["mesh"])
    motion = rc.Motion(part, {"mesh": rc.conveyor(3, direction=(0, 1, 0), distance=0.2)})
    check(motion, CAMERA, AROUND, rc.Task())


def test_faces_in_contact_and_their_partners_are_those_of_a_rebuild():
    mesh, moves = hostile(9)
    motion = rc.Motion(mesh, moves)
    for row in range(4):
        frame, _ = motion.frame(row)
        other = rebuilt(motion, row)[0]
        faces, expected = frame.contacts.faces_for(3), other.contacts.faces_for(3)
        assert np.array_equal(faces, expected)
        own, theirs = frame.contacts.partners_for(3), other.contacts.partners_for(3)
        assert np.array_equal(own.starts, theirs.starts)
        assert np.array_equal(own.faces, theirs.faces)


def test_surfaces_that_lie_on_each_other_list_no_partners():
    mesh = two_bodies(rc.shapes.sphere(3), rc.shapes.sphere(3))
    motion = rc.Motion(mesh, {"b": rc.conveyor(2, direction=(1, 0, 0), distance=5)})
    frame, _ = motion.frame(0)
    assert frame.contacts.faces_for().all()
    counts = np.diff(frame.contacts.partners_for().starts)
    assert counts.max() <= MOST_PARTNERS
    assert not motion.frame(1)[0].contacts.faces_for().any()


def test_cameras_that_no_moved_body_overlaps_keep_their_rows():
    mesh = two_bodies(rc.shapes.by_name("icosahedron"), rc.shapes.box())
    moves = {"b": rc.conveyor(6, direction=(0, 1, 0), distance=10) @ shifted((0, -5, 1.5))}
    motion = rc.Motion(mesh, moves)
    above = rc.look_at(eyes=[(0.1, 0.1, 6)], targets=(0, 0, 0), up=(0, 1, 0))
    keys = sight_keys(motion, above)
    is_beside = np.abs(np.linspace(-5, 5, 6)) > 2
    assert len({key for key, beside in zip(keys, is_beside, strict=True) if beside}) == 1
    assert len(set(keys)) == 1 + np.count_nonzero(~is_beside)
    check_result = check(motion, CAMERA, above, rc.Task())
    rows = [check_result.of_poses(np.arange(6) == row).xy.tobytes() for row in (0, 5)]
    assert rows[0] == rows[1]


def test_a_body_that_hides_the_part_is_no_earlier_row():
    rng = np.random.default_rng(7)
    mesh = two_bodies(rc.shapes.by_name("icosahedron"), rc.shapes.by_name("torus"))
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, :3, 3] = rng.normal(size=(40, 3)) * 2.5
    motion = rc.Motion(mesh, {"b": poses})
    keys, check_result = sight_keys(motion, AROUND[:1]), check(motion, CAMERA, AROUND[:1], rows=())
    last = {}
    for row, key in enumerate(keys):
        areas = RegionPass(motion.frame(row)[0], CAMERA, TASK).find(rc.Poses.of(AROUND[:1])).areas()
        assert np.allclose(areas[0, :20], check_result.areas()[row, :20], atol=1e-8)
        assert np.allclose(last.setdefault(key, areas), areas, atol=1e-8)
    assert 1 < len(last) < 40


def shifted(offset):
    pose = np.eye(4)
    pose[:3, 3] = offset
    return pose


def sight_keys(motion, poses):
    sights, placed = ViewKeys(motion), rc.Poses.of(poses)
    near = np.full(len(placed), 1e-5)
    return [sights.of(row, placed, near, np.zeros((1, 3)))[0] for row in range(len(motion))]


def test_frames_of_faces_are_those_at_rest_moved():
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(3)))
    rest, frame = frames_of(motion.mesh), frames_of(motion.frame(2)[0])
    pose = motion.world_from_body[2, motion.body]
    origin = np.einsum("fij,fj->fi", pose[:, :3, :3], rest.origin) + pose[:, :3, 3]
    assert np.allclose(origin, frame.origin, atol=1e-12)
    assert np.array_equal(rest.corners, frame.corners)


def test_a_pose_beyond_the_largest_coordinate_is_refused():
    mesh = rc.Mesh([(8e29, 0, 0), (8e29, 1e29, 0), (8e29, 0, 1e29)], [(0, 1, 2)])
    motion = rc.Motion(mesh, {"mesh": [np.eye(4), shifted((8e29, 0, 0))]})
    with pytest.raises(rc.MeshError, match="farther"):
        motion.frame(1)


def test_certified_kinds_of_task_faces_are_those_of_a_rebuild():
    motion = rc.Motion(arm.cell(rc.shapes.by_name("torus")), arm.frames(arm.sweep(4)))
    for row in range(4):
        frame, kept = motion.frame(row)
        mesh, there = rebuilt(motion, row)
        own = frame.task_mask
        assert np.array_equal(kept, np.flatnonzero(there))
        kinds = []
        for each in (frame, mesh):
            with rc.open_observer(each, CAMERA, method="certified") as observer:
                kinds.append(observer.observe(arm.CAMERAS))
        one, other = kinds
        assert np.array_equal(one.kind[:, own], other.kind[:, own])
        assert np.abs(one.visible_pixels - other.visible_pixels).max() <= 1e-6


def test_frames_share_what_their_rest_pose_decides():
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(3)))
    surfaces = [surface_of(motion.frame(row)[0]) for row in range(3)]
    for one, other in zip(*(
        (each.faces, each.rank, *each.edges, each.blocks.patch) for each in surfaces[1:]
    ), strict=True):  # fmt: skip
        assert np.shares_memory(one, other)
    assert not np.array_equal(surfaces[1].vertices, surfaces[2].vertices)


def test_vertices_of_two_bodies_are_never_welded():
    one, other = rc.shapes.box(), rc.shapes.box()
    mesh = two_bodies(one, other)  # at the same place
    motion = rc.Motion(mesh, {"b": rc.conveyor(2, direction=(1, 0, 0), distance=2)})
    for row in range(2):
        frame, _ = motion.frame(row)
        assert not np.intersect1d(frame.welded_faces[:12], frame.welded_faces[12:]).size
        assert frame.contacts.faces_for().all() == (row == 0)


def two_bodies(one, other, *, occluder=True):
    mesh = joined_meshes(one, other)
    groups = [rc.Group("a"), rc.Group("b", is_occluder=occluder)]
    return rc.Mesh(
        mesh.vertices, mesh.faces, groups, np.repeat([0, 1], [one.n_faces, other.n_faces])
    )


def hostile(seed):
    """Part and two bodies beside, in, around, on or against it, and motions of these."""
    rng = np.random.default_rng(seed)
    part = rc.shapes.by_name(("icosahedron", "box", "torus", "teapot")[seed % 4])
    low, high = part.bounds
    part = part.moved(translation=-(low + high) / 2).moved(scale=1 / (high - low).max())
    turn = rc.turntable(4, axis=rng.normal(size=3), degrees=rng.uniform(20, 200))
    shift = (0.0, 0.0, 0.0)
    kind = seed // 4
    if kind == 0:  # in contact: side on side
        one, shift = rc.shapes.box().moved(scale=0.5, translation=(0.5, -0.25, -0.25)), (0, 0, 0)
        turn = rc.conveyor(4, direction=(0, 1, 0), distance=0.4)
    elif kind == 1:  # inside, and out through the side
        one = rc.shapes.by_name("icosahedron").moved(scale=0.1)
        turn = rc.conveyor(4, direction=rng.normal(size=3), distance=1.3)
    elif kind == 2:  # a peg in its hole, with no gap
        one = rc.shapes.box().moved(scale=0.3, translation=(-0.15, -0.15, 0.35))
        turn = rc.conveyor(4, direction=(0, 0, 1), distance=0.45)
    elif kind == 3:  # the same part, at the same place, turned out of itself
        one = part
    else:  # through one another
        one = rc.shapes.box().moved(
            scale=0.6, axis=(1, 2, 3), angle_deg=40, translation=(0.2, 0, 0)
        )
    other = rc.shapes.by_name("box").moved(
        scale=0.4, translation=(-0.9, -0.2, 0.5) + rng.normal(size=3) * 0.1
    )
    meshes = [
        ("part", part, False),
        ("one", one.moved(translation=shift), True),
        ("other", other, True),
    ]
    mesh = arm.meshes([(name, each.vertices, each.faces, hides) for name, each, hides in meshes])
    moves = {"one": turn, "other": rc.conveyor(4, direction=(1, 0.2, -0.3), distance=1.6)}
    return mesh, moves


SEEDS = amount((0, 5, 10, 15, 16), at_night=range(20))
"""By day each kind with a part, at night with all of them."""
AROUND = rc.look_at(
    eyes=[(2.1, 0.9, 1.2), (-1.4, 2.0, 0.8), (0.3, -0.5, 2.6), (-1.9, -1.3, -0.6)],
    targets=(0, 0, 0),
)


@pytest.mark.parametrize("seed", SEEDS)
def test_layers_meet_in_the_whole(seed):
    """A point is seen past a scene where it is seen past each body alone."""
    mesh, moves = hostile(seed)
    motion = rc.Motion(mesh, moves)
    whole = regions_over_time(motion, CAMERA, AROUND, TASK, threads=1)
    layers = [
        regions_over_time(
            rc.Motion(mesh, moves, present={absent: [False] * 4}), CAMERA, AROUND, TASK, threads=1
        )
        for absent in ("one", "other")
    ]
    n = len(whole.pose_ids)
    both = join(layers).at_least(2, np.tile(np.arange(n), 2), one_side=False)
    own = mesh.task_mask
    gap = np.abs(both.areas() - whole.areas())[:, own]
    allowed = (both.bounds() + whole.bounds())[:, own]
    assert (gap <= allowed + 1e-12).all()
    assert gap.sum() <= 1e-6 * mesh.areas[own].sum() * n
    assert both.areas()[:, own].any()


@pytest.mark.parametrize("seed", SEEDS)
def test_hostile_scenes_are_meshes_of_moved_vertices(seed):
    mesh, moves = hostile(seed)
    check_within_bounds(rc.Motion(mesh, moves))


def check_within_bounds(motion):
    """Areas are those of a rebuild within both bounds: coincident surfaces may tie elsewhere."""
    regions = regions_over_time(motion, CAMERA, AROUND, TASK, threads=1)
    areas, bounds = regions.areas().reshape(4, 4, -1), regions.bounds().reshape(4, 4, -1)
    for row in range(len(motion)):
        mesh, there = rebuilt(motion, row)
        expected = rc.regions(mesh, CAMERA, AROUND, TASK, threads=1)
        gap = np.abs(areas[row][:, there] - expected.areas())
        assert (gap <= bounds[row][:, there] + expected.bounds() + 1e-9).all()


def test_a_motion_goes_to_another_process():
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(3)))
    frame, _ = motion.frame(1)
    again = pickle.loads(pickle.dumps(motion))
    assert np.array_equal(again.frame(1)[0].vertices, frame.vertices)
    assert again.frame(1)[0].moved_from is not None


def test_frames_are_drawn_and_counted_like_other_meshes():
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(3)))
    mesh, plain = motion.frame(2)[0], rebuilt(motion, 2)[0]
    for method in ("sampled:cpu", "certified"):
        one, other = (
            rc.evaluate(each, CAMERA, arm.CAMERAS, by="face", method=method, fields=("reason",))
            for each in (mesh, plain)
        )
        own = mesh.task_mask
        assert np.array_equal(one.reason[:, own], other.reason[:, own])
