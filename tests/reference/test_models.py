"""Coverage models of the literature: each against numbers worked out by hand, and laws for all."""

import dataclasses
import itertools
import json
import math

import numpy as np
import pytest
from commands import call
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pages import read_alone
from scenes import joined, square

from rastercov.base.errors import ConfigError, PoseError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.reference.coverage import measure_geometry as face_geometry
from rastercov.reference.models import (
    MODELS,
    zhang,
)
from rastercov.reference.models.base import ramp, required_density
from rastercov.reference.models.line_of_sight import MARGIN, LineOfSight
from rastercov.reference.models.report import (
    compare_models,
    covers,
    look_at_part,
    occlusion_sheet,
    write_model_comparison,
)

CAMERA = Camera(width=400, height=300, fx=200, fy=200)
LENS = Camera.from_lens(
    width=400, height=300, focal_length=2e-3, pixel_size=1e-5, f_number=0.5, focus_distance=4.0
)
AHEAD = np.eye(4)[None]
# The camera looks along +z. Depths 3, 5 and 4; normal (1, 0, -1) / sqrt 2; centroid on the axis.
TILTED = Mesh(vertices=[(-1, -1, 3), (1, -1, 5), (0, 2, 4)], faces=[(0, 2, 1)])
seeds = st.integers(0, 10**9)
every_model = pytest.mark.parametrize("name", list(MODELS))


def law_of_every_model(test):
    """A law on random scenes, for each model."""
    return pytest.mark.slow(every_model(settings(max_examples=10)(given(seed=seeds)(test))))


def covered(name, mesh, camera=CAMERA, poses=AHEAD, task=None):
    """Coverage by a model; unless said otherwise nothing is too small."""
    return MODELS[name](mesh, camera, poses, task or Task(min_pixels=1e-9))


def soup(seed, n=14):
    """Triangles in disorder between depths 3 and 7, within one box whatever the seed."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (n, 1, 3)) + rng.normal(0, 0.5, (n, 3, 3))
    corners = np.clip(corners, (-2, -1.5, 3), (2, 1.5, 7))
    ends = [np.array(end) + np.eye(3) * 1e-3 for end in ((-2, -1.5, 3), (1.999, 1.499, 6.999))]
    corners = np.concatenate((corners, ends))
    return Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(len(corners) * 3).reshape(-1, 3))


def without(mesh, faces):
    """The same mesh without some faces, in a box as large."""
    return Mesh(vertices=mesh.vertices, faces=np.delete(mesh.faces, faces, axis=0))


# --- the one signature ---------------------------------------------------------------------------


@every_model
def test_coverage_has_a_row_for_each_pose_and_a_column_for_each_face(name):
    poses = look_at([(0, 0, 0), (0.2, 0, 0), (0, 0, 20)], (0, 0, 5))
    values = MODELS[name](soup(1), LENS, poses)
    assert values.shape == (3, soup(1).n_faces)
    assert values.dtype == np.float64
    assert ((values >= 0) & (values <= 1)).all()
    assert MODELS[name](soup(1), CAMERA, np.empty((0, 4, 4))).shape == (0, soup(1).n_faces)
    with pytest.raises(PoseError):
        MODELS[name](soup(1), CAMERA, 2 * AHEAD)


def test_ours_is_the_engine():
    mesh, task = soup(5), Task(min_pixels=40, max_incidence_deg=70)
    poses = look_at([(0, 0, 0), (0.5, 0.2, -1)], (0, 0, 5))
    assert np.array_equal(
        covered("image_space", mesh, poses=poses, task=task),
        evaluate(mesh, CAMERA, poses, task, by="face").coverage,
    )


# --- by hand -------------------------------------------------------------------------------------


def one(*corners):
    """One triangle."""
    return Mesh(vertices=corners, faces=[(0, 1, 2)])


def at_least(density):
    return {"task": Task(min_pixels=1e-9, min_pixel_density=density)}


def within(degrees):
    return {"task": Task(min_pixels=1e-9, max_incidence_deg=degrees)}


def blurred(limit):
    return {"task": Task(min_pixels=1e-9, max_blur=limit)}


def paper_density(a, b):
    """Tarabanis' D |((A - o) x u) x v| / ((A - o).v (B - o).v), o the origin, v the axis."""
    along = (b - a) / np.linalg.norm(b - a)
    return 200 * np.linalg.norm(np.cross(np.cross(a, along), (0, 0, 1))) / (a[2] * b[2])


def frustum_part(x, z):
    """A triangle whose centroid is x to the right of the axis of the frustum."""
    return one((x - 0.3, -0.2, z), (x, 0.4, z), (x + 0.3, -0.2, z))


COSINES = np.array([4 / math.sqrt(2 * square) for square in (11, 27, 20)])
"""Of the rays to the vertices of `TILTED` and its normal."""
ASIDE_OF_AXIS = math.sqrt(1 - 1 / math.sqrt(29))
TURN = math.sqrt(1 - math.hypot(1 / math.sqrt(2), 1 - 1 / math.sqrt(2)) / math.sqrt(2))
BLUR = 4e-3 * 2e-3 * 2 / (2 * 3.998) / 1e-5
"""A f |z - z_s| / (z (z_s - f)) / s with A = 4 mm, f = 2 mm, z_s = 4 m, s = 10 um, at 2 m."""
FOCUSED = {"camera": dataclasses.replace(CAMERA, focus_range=(3.5, 9.0))}
"""Not the vertex of `TILTED` at depth 3."""
DENSITY = at_least(100.0)
ENDS = joined(square(0.01, 2.0, centre=(1.5, 1.0)), square(0.01, 6.0, centre=(4.5, 3.0)))
"""Depths 2 and 6, where the frustum of Alarcon ends, in a corner."""
WIDE = {"camera": dataclasses.replace(CAMERA, fx=100, fy=100)}
ASIDE = square(0.1, 4.0, centre=(3.5, 0.0))  # in the image, at 0.9 z; half the height is 0.75 z
HIDDEN = joined(square(0.5, 4.0), square(1.0, 2.0))
# It looks forward by 11 degrees, and is seen from the side at 57.
WALL = one((-2, -0.5, 2), (-2, 0.5, 2), (-2.1, 0, 2.5))
PARTLY = one((-2, -2, 4), (-2, 2, 4), (9, 2, 4))
FAR = square(0.5, 4.0)  # at 4 m / 200 px: 20 mm per px
SPOT = square(1e-6, 2.0)
# Vertex 1 of the sheet, at (-.5, .5, 4), belongs to its first face only.
SPECK = joined(square(0.5, 4.0), square(0.05, 2.0, centre=(-0.25, 0.25)))
FACE = frustum_part(0, 4)
MIDDLE, TIP = square(0.01, 2.0), square(0.01, 2.0, centre=(0.0, 0.2))
BY_HAND = [
    ("tarabanis", TILTED, DENSITY, paper_density(*TILTED.vertices[:2]) / 100),
    # The smaller angle of view only; and nothing hides.
    ("tarabanis", ASIDE, {}, 0),
    ("tarabanis", square(0.1, 4.0, centre=(2.8, 0.0)), {}, 1),
    ("tarabanis", HIDDEN, {}, 1),
    ("tarabanis", TILTED, FOCUSED, 1),
    # The cosine at the centroid; focus counts.
    ("scott", TILTED, DENSITY, 200 / math.sqrt(2) / 4 / 100),
    ("scott", ASIDE, {}, 1),
    ("scott", HIDDEN, {}, 1),
    ("scott", PARTLY, {}, 0),
    ("scott", TILTED, FOCUSED, 0),
    ("scott", TILTED, FOCUSED | {"task": Task(min_pixels=1e-9, focus_rule="centroid")}, 1),
    # The mean over vertices of one cosine, to the axis, over depth.
    ("zhang", TILTED, DENSITY, 200 / math.sqrt(2) * (1 / 3 + 1 / 5 + 1 / 4) / 3 / 100),
    ("zhang", TILTED, FOCUSED, 0),
    ("zhang", WALL, WIDE, 0),
    ("zhang", joined(FACE, MIDDLE), {}, [1, 1, 1]),
    ("zhang", joined(FACE, TIP), {}, [0, 1, 1]),
    # The mean of the cosines at the vertices that are in the image, graded to the task's limit.
    ("mavrinac", TILTED, {}, COSINES.mean()),
    ("mavrinac", TILTED, within(60.0), np.clip((COSINES - 0.5) / 0.5, 0, 1).mean()),
    ("mavrinac", PARTLY, {}, 2 / 3 * math.sqrt(2 / 3)),
    ("mavrinac", FAR, at_least(50.1), 0),
    ("mavrinac", FAR, at_least(50.0), 4 / math.sqrt(16.5)),
    ("mavrinac", SPOT, {"camera": LENS, **blurred(2 * BLUR)}, 0.5),
    ("mavrinac", SPOT, {"camera": LENS, **blurred(0.9 * BLUR)}, 0),
    ("mavrinac", TILTED, FOCUSED, COSINES[1:].sum() / 3),
    ("mavrinac", SPECK, {}, [2 / 3 * 4 / math.sqrt(16.5), 4 / math.sqrt(16.5), None, None]),
    # Whole at the centre of the frustum; falls with distance and turn; the centroid is traced.
    ("alarcon", joined(FACE, ENDS), {}, [1, *[None] * 4]),
    ("alarcon", joined(frustum_part(1, 4), ENDS), {}, [ASIDE_OF_AXIS, *[None] * 4]),
    ("alarcon", joined(TILTED, ENDS), {}, [TURN, *[None] * 4]),
    ("alarcon", TILTED, FOCUSED, 0),
    ("alarcon", joined(FACE, ENDS, MIDDLE), {}, [0, *[None] * 6]),
    ("alarcon", joined(FACE, ENDS, TIP), {}, [1, *[None] * 6]),
]  # fmt: skip


@pytest.mark.parametrize(("name", "mesh", "options", "expected"), BY_HAND)
def test_a_model_has_the_figure_worked_out_by_hand(name, mesh, options, expected):
    is_covered = covered(name, mesh, **options)[0]
    for value, wanted in zip(is_covered, np.broadcast_to(expected, len(is_covered)), strict=True):
        assert wanted is None or value == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_faces_of_the_table_are_seen_from_the_front_and_nearer_is_no_better():
    assert face_geometry(WALL, CAMERA, AHEAD[0]).is_front.all()
    assert covered("scott", WALL, **WIDE, **DENSITY) > 0.2
    parts = (joined(frustum_part(0, z), ENDS) for z in (3, 5))
    nearer, farther = (covered("alarcon", part)[0, 0] for part in parts)
    assert nearer == pytest.approx(farther)


def test_what_is_required_is_the_tasks_pixels_seen_head_on():
    mesh = Mesh(vertices=[(0, 0, 4), (0, 1, 4), (0.5, 0, 4)], faces=[(0, 1, 2), (0, 0, 1)])
    for pixels, least, density in ((1, 0, 2.0), (400, 0, 40.0), (1, 30, 30.0), (400, 30, 40.0)):
        task = Task(min_pixels=pixels, min_pixel_density=least)  # on 0.25 m^2
        assert required_density(mesh, task)[0] == pytest.approx(density)
        assert np.isinf(required_density(mesh, task)[1])  # no area, no pixels


@pytest.mark.parametrize("name", ["tarabanis", "scott", "zhang", "image_space"])
def test_a_face_seen_head_on_with_the_tasks_pixels_is_covered_whole(name):
    # 0.5 m^2 at 50 px/m: 1,250 px.
    mesh = Mesh(vertices=[(-0.5, -1 / 3, 4), (0, 2 / 3, 4), (0.5, -1 / 3, 4)], faces=[(0, 1, 2)])
    assert covered(name, mesh, task=Task(min_pixels=1250)) == pytest.approx(1.0)
    part = 0.25 if name == "image_space" else 0.5  # pixels, or pixels a metre
    assert covered(name, mesh, task=Task(min_pixels=5000)) == pytest.approx(part)


def test_a_ramp_is_linear_between_its_limits_and_a_step_where_they_are_one():
    values = np.array((0.0, 1.0, 1.5, 2.0, 3.0))
    for acceptable, ideal, expected in (
        (2.0, 1.0, [1, 1, 0.5, 0, 0]), (2.0, 2.0, [1, 1, 1, 1, 0]),
        (math.inf, math.inf, [1] * 5), (math.inf, 1.0, [1] * 5),
    ):  # fmt: skip
        assert ramp(values, acceptable, ideal).tolist() == expected


# --- laws ----------------------------------------------------------------------------------------


@law_of_every_model
def test_faces_seen_from_behind_are_not_covered(name, seed):
    mesh = soup(seed)
    values = covered(name, mesh)[0]
    behind = ~face_geometry(mesh, CAMERA, AHEAD[0]).is_front
    assert (values[behind] == 0).all()
    assert ((values == 0) | (covered(name, turned(mesh))[0] == 0)).all()


@law_of_every_model
def test_a_two_sided_face_is_covered_from_either_side_alike(name, seed):
    mesh, groups = soup(seed), [Group("mesh", is_two_sided=True)]
    sides = (Mesh(each.vertices, each.faces, groups) for each in (mesh, turned(mesh)))
    one, other = (covered(name, side)[0] for side in sides)
    # The angle of a face that is edge-on to rounding is known to the root of that, radians.
    assert one == pytest.approx(other, abs=3e-8)
    # From the front it counts as it did.
    front = face_geometry(mesh, CAMERA, AHEAD[0]).is_front
    assert one[front] == pytest.approx(covered(name, mesh)[0, front], abs=1e-9)


@law_of_every_model
def test_moving_mesh_and_camera_together_changes_nothing(name, seed):
    rng = np.random.default_rng(seed)
    # Turns by quarters, so that the box and with it `MARGIN` keep their size.
    turn = np.eye(3)[rng.permutation(3)] * rng.choice((-1, 1), 3)
    turn[0] *= np.linalg.det(turn)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn, rng.uniform(-50, 50, 3)
    mesh = soup(seed)
    moved = Mesh(vertices=mesh.vertices @ turn.T + motion[:3, 3], faces=mesh.faces)
    task = Task(min_pixels=500, max_incidence_deg=70)
    poses = look_at([(0, 0, 0), (0.7, 0.3, -1)], (0, 0, 5))
    before = covered(name, mesh, LENS, poses, task)
    after = covered(name, moved, LENS, motion @ poses, task)
    assert after == pytest.approx(before, abs=1e-7)


@pytest.mark.slow
@every_model
@pytest.mark.parametrize("kind", [{"min_pixels": 50.0}, {"max_blur": 0.5}])
@settings(max_examples=10)
@given(seed=seeds, stricter=st.floats(1.01, 50))
def test_a_stricter_task_covers_nothing_more(name, kind, seed, stricter):
    ((what, value),) = kind.items()
    harder = value * stricter if what == "min_pixels" else value / stricter
    mesh = soup(seed)
    if (name, what) == ("alarcon", "max_blur"):  # its frustum ends with the depth of field
        return
    easy = covered(name, mesh, LENS, task=Task(**kind))
    hard = covered(name, mesh, LENS, task=Task(**{what: harder}))
    assert (hard <= easy + 1e-12).all()


@pytest.mark.parametrize("name", ["tarabanis", "scott", "zhang"])
@settings(max_examples=10)
@given(seed=seeds, density=st.floats(1, 500), more=st.floats(1, 10))
def test_coverage_is_inverse_to_the_density_that_is_required(name, seed, density, more):
    mesh = soup(seed)
    easy, hard = (covered(name, mesh, **at_least(least)) for least in (density, density * more))
    assert (hard <= easy).all()
    below = easy < 1
    assert hard[below] == pytest.approx(easy[below] / more)


@law_of_every_model
def test_more_faces_cover_no_other_better(name, seed):
    mesh = soup(seed)
    fewer = without(mesh, [0, 1, 2, 3])
    all_of_them = covered(name, mesh)[:, 4:]
    # To rounding for ours, which computes what is seen.
    assert (all_of_them <= covered(name, fewer) + 1e-9).all()


@pytest.mark.slow
@settings(max_examples=10)
@given(seed=seeds)
def test_occlusion_is_0_or_1_where_it_is_bivalent(seed):
    mesh = soup(seed)
    seen = zhang.visible(mesh, CAMERA, AHEAD)
    assert set(np.unique(seen)) <= {0.0, 1.0}
    single = [Mesh(mesh.vertices, [face]) for face in mesh.faces]
    alone = [covered("zhang", each, task=Task())[0, 0] for each in single]
    assert covered("zhang", mesh, task=Task())[0] == pytest.approx(alone * seen[0])


# --- segments ------------------------------------------------------------------------------------


def brute(mesh, points, eye):
    """Segments against all faces by solving for barycentric coordinates, (N,) bool."""
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    hidden = np.zeros(len(points), dtype=bool)
    for i, point in enumerate(points):
        d = eye - point
        start = MARGIN * size / np.linalg.norm(d)
        for a, b, c in mesh.vertices[mesh.faces]:
            matrix = np.stack((b - a, c - a, -d), axis=1)
            if abs(np.linalg.det(matrix)) < 1e-14:
                continue
            u, v, t = np.linalg.solve(matrix, point - a)
            hidden[i] |= u >= 0 and v >= 0 and u + v <= 1 and start <= t <= 1
    return hidden


@settings(max_examples=10)
@given(seed=seeds, n=st.integers(1, 40))
@example(seed=3, n=9)
def test_segments_are_those_of_a_linear_system(seed, n):
    mesh, eye = soup(seed, n), np.zeros(3)
    hidden = LineOfSight(mesh).find_hidden(mesh.vertices, AHEAD[0], 1e-9, CAMERA)
    assert np.array_equal(hidden, brute(mesh, mesh.vertices, eye))


@pytest.mark.parametrize("name", ["box", "icosahedron", "sphere"])
def test_a_convex_solid_hides_none_of_its_front_faces(name):
    # Each vertex is shared: were faces that touch there to hide, none would be seen.
    mesh = shapes.by_name(name)
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    poses = sphere_of_poses(mesh.bounds.mean(axis=0) + 0.01 * size, 1.7 * size, 6)
    visible = zhang.visible(mesh, CAMERA, poses)
    for row, pose in enumerate(poses):
        view = face_geometry(mesh, CAMERA, pose)
        clear = view.is_front & (view.incidence < math.radians(85))
        assert clear.sum() > 1
        assert visible[row, clear].all()
        assert not visible[row, ~view.is_front].any()


def test_a_face_that_only_touches_a_vertex_hides_nothing():
    wall = square(1.0, 4.0)
    assert zhang.visible(joined(wall, wall), CAMERA, AHEAD).all()  # a copy
    # A fin that leans from the wall to the camera, on its tip in the middle of a face.
    fin = Mesh(vertices=[(0.2, 0.3, 4), (0.6, 0.9, 3.4), (-0.2, 0.9, 3.4)], faces=[(0, 2, 1)])
    assert face_geometry(fin, CAMERA, AHEAD[0]).is_front.all()
    assert zhang.visible(joined(wall, fin), CAMERA, AHEAD)[0].tolist() == [1, 1, 1]


def turned(mesh):
    return Mesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])


def test_what_lies_before_the_near_plane_hides_nothing():
    mesh = joined(square(0.5, 4.0), square(1.0, 2.0))
    for near, expected in ((0.0, 0), (2.1, 1)):
        camera = dataclasses.replace(CAMERA, near=near)
        assert (covered("zhang", mesh, camera)[0, :2] == expected).all()


def test_occluders_and_back_faces_hide():
    wall, cover = square(0.5, 4.0), turned(square(1.0, 2.0))
    both = joined(wall, cover)
    groups = [Group("part"), Group("fixture", is_occluder=True)]
    mesh = Mesh(both.vertices, both.faces, groups=groups, face_group=[0, 0, 1, 1])
    assert (covered("zhang", mesh)[0, :2] == 0).all()
    assert (covered("mavrinac", mesh)[0, :2] == 0).all()
    assert (covered("alarcon", mesh)[0, :2] == 0).all()


def test_a_face_seen_edge_on_hides_nothing():
    fin = Mesh(vertices=[(0, -1, 2), (0, 1, 2), (0, 0, 3)], faces=[(0, 1, 2)])  # in a plane x = 0
    point = np.array([(0.0, 0.0, 5.0)])
    assert (
        not LineOfSight(joined(fin, square(1, 6.0)))
        .find_hidden(point, AHEAD[0], 1e-9, CAMERA)
        .any()
    )
    assert LineOfSight(joined(square(1, 3.0), fin)).find_hidden(point, AHEAD[0], 1e-9, CAMERA).all()


def test_no_segment_slips_between_two_faces():
    # Through the common edge of two faces, and through the vertex that six of them share.
    fan = shapes.by_name("icosahedron")
    corners = fan.vertices[fan.faces]
    middles = (corners + np.roll(corners, -1, axis=1)).reshape(-1, 3) / 2
    targets, sight = np.concatenate((corners.reshape(-1, 3), middles)), LineOfSight(fan)
    for eye in np.random.default_rng(0).normal(0, 0.02, (50, 3)) + fan.bounds.mean(axis=0):
        beyond = 2 * targets - eye
        for pose, point in zip(look_at(eye, beyond), beyond, strict=True):
            assert sight.find_hidden(point[None], pose, 1e-9, CAMERA).all()


def test_a_mesh_without_area_hides_nothing():
    line = Mesh(vertices=[(0, 0, 4), (0, 1, 4), (0, 2, 4)], faces=[(0, 1, 2)])
    assert not LineOfSight(line).find_hidden(np.array([(0.0, 0, 8)]), AHEAD[0], 1e-9, CAMERA).any()
    for name in MODELS:
        assert not covered(name, line).any()


# --- side by side --------------------------------------------------------------------------------

TEAPOT = shapes.teapot(3)
EYE = Camera(width=160, height=120, fx=190, fy=190)
AROUND = sphere_of_poses(TEAPOT.bounds.mean(axis=0), 0.5, 4)


@pytest.fixture(scope="module")
def result():
    with pytest.MonkeyPatch.context() as patch:  # in batches of 3 and 1
        patch.setattr("rastercov.reference.models.report.POSES_A_BATCH", 3)
        return compare_models(TEAPOT, EYE, AROUND)


def test_disagreements_are_counted_over_all_poses(result):
    task = Task()
    values = {name: model(TEAPOT, EYE, AROUND, task) for name, model in MODELS.items()}
    seen = evaluate(TEAPOT, EYE, AROUND, task, by="face")
    by_pair = {(each.covers, each.does_not): each for each in result.disagreements}
    assert by_pair  # the models do disagree
    for first, second in itertools.permutations(MODELS, 2):
        only = covers(values[first], task) & ~covers(values[second], task)
        if not only.any():
            assert (first, second) not in by_pair
            continue
        entry = by_pair[first, second]
        assert entry.hidden + entry.partly + entry.whole == entry.faces == only.sum()
        assert entry.mean_visibility == pytest.approx(seen.visibility[only].mean())
        area = (seen.visibility * seen.drawn_pixels)[only].sum()
        assert entry.visible_pixels == pytest.approx(area)
        assert entry.image_pixels == pytest.approx(seen.drawn_pixels[only].sum())
    for score in result.models:
        assert score.covered == covers(values[score.name], task).sum()
        assert score.mean == pytest.approx(values[score.name].mean())


def test_the_bivalent_test_is_held_against_what_is_seen(result):
    seen = evaluate(TEAPOT, EYE, AROUND, by="face")
    bivalent = zhang.visible(TEAPOT, EYE, AROUND) > 0
    front = np.array([face_geometry(TEAPOT, EYE, pose).is_front for pose in AROUND])
    judged = seen.in_view & front & (seen.drawn_pixels > 0)
    lost = judged & ~bivalent & (seen.visibility > seen.visibility_bound)
    false = judged & bivalent & (seen.visibility < 1 - seen.visibility_bound)
    test, sums = result.bivalence, (judged.sum(), lost.sum(), false.sum())
    assert (test.faces, test.called_hidden, test.called_seen) == sums
    assert test.called_hidden_visibility == pytest.approx(seen.visibility[lost].mean())
    assert 0 < test.called_hidden <= test.faces
    off = np.where(judged, np.abs(bivalent - seen.visibility) * seen.drawn_pixels, 0)
    assert result.misjudged == pytest.approx(off.sum(axis=1))
    worst = result.worst[0]
    assert off[worst.pose, worst.face] == off.max()
    assert worst.visibility == seen.visibility[worst.pose, worst.face]
    assert list(worst.coverage) == list(MODELS)


def test_what_has_no_coverage_is_never_covered():
    values = np.array((0.0, 0.1, 0.5, 1.0))
    assert covers(values, Task.thesis()).tolist() == [False, True, True, True]
    assert covers(values, Task()).tolist() == [False, False, True, True]


def test_occluders_are_not_compared():
    both = joined(square(0.5, 4.0), square(0.3, 2.0))
    groups = [Group("part"), Group("fixture", is_occluder=True)]
    mesh = Mesh(both.vertices, both.faces, groups=groups, face_group=[0, 0, 1, 1])
    result = compare_models(mesh, CAMERA, AHEAD)
    assert result.task_faces == 2
    assert {score.name: score.covered for score in result.models}["tarabanis"] == 2
    assert result.bivalence.faces == 2


def test_no_poses_are_refused():
    with pytest.raises(ConfigError, match="expected poses, got none"):
        compare_models(TEAPOT, EYE, np.empty((0, 4, 4)))


@pytest.mark.slow
def test_a_part_that_fills_more_than_the_image_is_drawn_as_far_as_it_goes():
    near = joined(square(9.0, 4.0), square(0.5, -3.0))
    look = look_at_part(near, CAMERA, AHEAD[0])
    assert (look.face >= 0).all()
    nothing = look_at_part(square(0.5, -3.0), CAMERA, AHEAD[0])
    assert (nothing.face < 0).all()
    assert occlusion_sheet(look, np.ones(4), np.ones(4)).width > 1000


@pytest.mark.slow
def test_the_page_stands_alone_and_names_every_model(tmp_path, result):
    (tmp_path / "notes.txt").write_text("mine")
    path = write_model_comparison(tmp_path / "", result, TEAPOT, EYE, AROUND)
    text = path.read_text(encoding="utf-8")
    assert read_alone(text).loads
    assert all(name in text for name in MODELS)
    names = sorted(file.name for file in tmp_path.iterdir())
    assert "notes.txt" in names
    assert len([name for name in names if name.startswith("occlusion_")]) == 3
    data = json.loads((tmp_path / "models.json").read_bytes())
    assert [score["name"] for score in data["models"]] == list(MODELS)
    assert data["run"]["task"]["min_pixels"] == 1.0
    assert data["bivalence"]["faces"] == result.bivalence.faces


@pytest.mark.slow
def test_the_command_compares_models(capsys, tmp_path):
    (tmp_path / "camera.toml").write_text("width = 48\nheight = 36\nfx = 60\nfy = 60\n")
    line = f"compare box -c {tmp_path}/camera.toml -p sphere:1 --models -o {tmp_path}"
    code, out, _ = call(capsys, line)
    assert code == 0
    assert "image_space (ours)" in out
    assert str(tmp_path / "models.html") in out.replace("\n", "")
    assert not (tmp_path / "compare.html").exists()
    code, out, _ = call(capsys, line + " --json")
    assert code == 0
    assert [score["name"] for score in json.loads(out)["models"]] == list(MODELS)
