"""Coverage models of the literature: each against numbers worked out by hand, and laws for all."""

import dataclasses
import inspect
import itertools
import json
import math
import sys

import numpy as np
import pytest
from commands import call, refusal
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pages import read_alone
from scenes import joined, sheet, square

from rastercov.base.errors import ConfigError, PoseError
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import look_at, sphere_of_poses
from rastercov.coverage.job import evaluate
from rastercov.coverage.observer import visibility
from rastercov.coverage.task import Task
from rastercov.mesh import Group, Mesh, shapes
from rastercov.reference.criteria import measured_geometry as face_geometry
from rastercov.reference.models import (
    MODELS,
    alarcon,
    image_space,
    mavrinac,
    scott,
    tarabanis,
    zhang,
)
from rastercov.reference.models.base import ramp, required_density
from rastercov.reference.models.comparison import compare_models, covers
from rastercov.reference.models.line_of_sight import MARGIN, TOLERANCE, LineOfSight, OwnTracer
from rastercov.reference.models.report import (
    difference_picture,
    look_at_part,
    look_closer,
    models_sheet,
    occlusion_sheet,
    page,
    write_model_comparison,
)
from rastercov.report.images import coverage_pixels
from rastercov.report.theme import MISSED

CAMERA = Camera(width=400, height=300, fx=200, fy=200)
LENS = Camera.from_lens(
    width=400, height=300, focal_length=2e-3, pixel_size=1e-5, f_number=0.5, focus_distance=4.0
)
AHEAD = np.eye(4)[None]
# The camera looks along +z. Depths 3, 5 and 4; normal (1, 0, -1) / sqrt 2; centroid on the axis.
TILTED = Mesh(vertices=[(-1, -1, 3), (1, -1, 5), (0, 2, 4)], faces=[(0, 2, 1)])
BIVALENT = ("mavrinac", "alarcon", "zhang")
"""Models that trace segments."""
every_model = pytest.mark.parametrize("name", list(MODELS))
every_tracer = pytest.mark.parametrize("tracer", ["embree", "own"])
seeds = st.integers(0, 10**9)


def covered(name, mesh, camera=CAMERA, poses=AHEAD, task=None, **parameters):
    """Coverage by a model; unless said otherwise nothing is too small, and float64 traces."""
    if name in BIVALENT:
        parameters = {"tracer": "own"} | parameters
    chosen = parameters_of(name)(**parameters)
    return MODELS[name](mesh, camera, poses, task or Task(min_pixels=1e-9), parameters=chosen)


def visible(mesh, camera=CAMERA, poses=AHEAD, tracer="own"):
    parameters = zhang.ZhangParameters(tracer=tracer)
    return zhang.visible(mesh, camera, poses, parameters=parameters)


def parameters_of(name):
    return type(inspect.signature(MODELS[name]).parameters["parameters"].default)


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
def test_all_models_are_called_alike(name):
    names = list(inspect.signature(MODELS[name]).parameters.values())
    assert [each.name for each in names] == ["mesh", "camera", "poses", "task", "parameters"]
    assert names[-1].kind is inspect.Parameter.KEYWORD_ONLY
    assert dataclasses.is_dataclass(names[-1].default)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(names[-1].default, dataclasses.fields(names[-1].default)[0].name, None)


@every_model
def test_coverage_has_a_row_for_each_pose_and_a_column_for_each_face(name):
    poses = look_at([(0, 0, 0), (0.2, 0, 0), (0, 0, 20)], (0, 0, 5))
    values = MODELS[name](soup(1), CAMERA, poses)
    assert values.shape == (3, soup(1).n_faces)
    assert values.dtype == np.float64
    assert MODELS[name](soup(1), CAMERA, np.empty((0, 4, 4))).shape == (0, soup(1).n_faces)


@every_model
def test_a_pose_that_is_no_rigid_motion_is_refused(name):
    with pytest.raises(PoseError):
        MODELS[name](soup(1), CAMERA, 2 * AHEAD)


def test_ours_is_the_engine():
    mesh, task = soup(5), Task(min_pixels=40, max_incidence_deg=70)
    poses = look_at([(0, 0, 0), (0.5, 0.2, -1)], (0, 0, 5))
    assert np.array_equal(
        covered("image_space", mesh, poses=poses, task=task),
        evaluate(mesh, CAMERA, poses, task).coverage,
    )


# --- by hand -------------------------------------------------------------------------------------


def test_tarabanis_takes_the_edge_that_the_image_shortens_most():
    # Image points (133.3, 83.3), (240, 110), (200, 250): px of each edge over its metres.
    edges = [
        math.hypot(320 / 3, 80 / 3) / math.sqrt(8),
        math.hypot(200 / 3, 500 / 3) / math.sqrt(11),
        math.hypot(40, 140) / math.sqrt(11),
    ]
    found = covered("tarabanis", TILTED, required_density=100.0)
    assert found == pytest.approx(min(edges) / 100, rel=1e-12)
    assert min(edges) == edges[0]


def test_tarabanis_resolution_is_the_papers():
    # D |((A - o) x u) x v| / ((A - o).v (B - o).v), o the origin, v the axis, D = f in pixels.
    a, b, axis = np.array((-1.0, -1, 3)), np.array((1.0, -1, 5)), np.array((0.0, 0, 1))
    u = (b - a) / np.linalg.norm(b - a)
    paper = 200 * np.linalg.norm(np.cross(np.cross(a, u), axis)) / (a @ axis * (b @ axis))
    assert covered("tarabanis", TILTED, required_density=100.0) == pytest.approx(paper / 100)


def test_tarabanis_sees_with_the_smaller_angle_only():
    aside = square(0.1, 4.0, centre=(3.5, 0.0))  # in the image, at 0.9 z; half the height is 0.75 z
    assert (covered("tarabanis", aside) == 0).all()
    assert (covered("scott", aside) == 1).all()
    assert (covered("tarabanis", square(0.1, 4.0, centre=(2.8, 0.0))) == 1).all()


def test_tarabanis_does_not_look_for_what_hides():
    hidden = joined(square(0.5, 4.0), square(1.0, 2.0))
    assert (covered("tarabanis", hidden)[0, :2] == 1).all()
    assert (covered("scott", hidden)[0, :2] == 1).all()


def test_scott_has_the_cosine_at_the_centroid():
    found = covered("scott", TILTED, required_density=100.0)
    assert found == pytest.approx(200 / math.sqrt(2) / 4 / 100, rel=1e-12)


def test_scott_and_zhang_want_focus_and_tarabanis_does_not():
    camera = dataclasses.replace(CAMERA, focus_range=(3.5, 9.0))
    assert covered("scott", TILTED, camera) == 0
    assert covered("zhang", TILTED, camera) == 0
    assert covered("alarcon", TILTED, camera) == 0
    assert covered("tarabanis", TILTED, camera) == 1
    by_centroid = Task(min_pixels=1e-9, focus_rule="centroid")
    assert covered("scott", TILTED, camera, task=by_centroid) == 1


def test_zhang_has_the_mean_over_vertices_of_one_cosine_over_depth():
    found = covered("zhang", TILTED, required_density=100.0)
    mean = (1 / 3 + 1 / 5 + 1 / 4) / 3
    assert found == pytest.approx(200 / math.sqrt(2) * mean / 100, rel=1e-12)


def test_zhang_takes_the_angle_to_the_axis_and_scott_to_the_ray():
    # The face looks forward by 11 degrees, and is seen from the side at 57.
    wall = Mesh(vertices=[(-2, -0.5, 2), (-2.1, 0, 2.5), (-2, 0.5, 2)], faces=[(0, 2, 1)])
    assert face_geometry(wall, CAMERA, AHEAD[0]).is_front.all()
    wide = dataclasses.replace(CAMERA, fx=100, fy=100)
    assert covered("zhang", wall, wide, required_density=1.0) == 0
    assert covered("scott", wall, wide, required_density=100.0) > 0.2


def test_mavrinac_averages_the_cosines_at_the_vertices():
    cosines = [4 / math.sqrt(2 * 11), 4 / math.sqrt(2 * 27), 4 / math.sqrt(2 * 20)]
    assert covered("mavrinac", TILTED) == pytest.approx(np.mean(cosines), rel=1e-12)
    # Between 60 degrees (0) and 30 (1), clipped at both ends.
    low, high = 0.5, math.sqrt(3) / 2
    graded = [min(1.0, max(0.0, (c - low) / (high - low))) for c in cosines]
    found = covered("mavrinac", TILTED, ideal_incidence_deg=30.0, acceptable_incidence_deg=60.0)
    assert found == pytest.approx(np.mean(graded), rel=1e-12)


FLAT = {"ideal_incidence_deg": 90.0}
"""The angle has no part in it."""


def test_mavrinac_grades_the_distance_to_the_border():
    # Image points (100, 50), (100, 250), (300, 250): 50 px from the border at the least.
    mesh = Mesh(vertices=[(-2, -2, 4), (-2, 2, 4), (2, 2, 4)], faces=[(0, 1, 2)])
    assert covered("mavrinac", mesh, **FLAT) == 1
    assert covered("mavrinac", mesh, padding=200.0, **FLAT) == pytest.approx(0.25)
    moved = Mesh(
        vertices=mesh.vertices + np.array((0, 0.5, 0)), faces=mesh.faces
    )  # v is 75, 275, 275
    assert covered("mavrinac", moved, padding=100.0, **FLAT) == pytest.approx((0.75 + 0.5) / 3)


def test_mavrinac_counts_the_vertices_that_are_in_the_image():
    mesh = Mesh(vertices=[(-2, -2, 4), (-2, 2, 4), (9, 2, 4)], faces=[(0, 1, 2)])
    assert covered("mavrinac", mesh, **FLAT) == pytest.approx(2 / 3)
    assert covered("scott", mesh) == 0


def test_mavrinac_grades_millimetres_a_pixel():
    mesh = square(0.5, 4.0)  # 4 m / 200 px: 20 mm per px
    found = covered("mavrinac", mesh, ideal_mm_per_px=15.0, acceptable_mm_per_px=25.0, **FLAT)
    assert found == pytest.approx(0.5)
    assert (covered("mavrinac", mesh, acceptable_mm_per_px=19.9, **FLAT) == 0).all()
    assert (covered("mavrinac", mesh, acceptable_mm_per_px=20.0, **FLAT) == 1).all()


def test_mavrinac_grades_the_blur_circle():
    # A f |z - z_s| / (z (z_s - f)) / s with A = 4 mm, f = 2 mm, z_s = 4 m, s = 10 um, at 2 m.
    blur = 4e-3 * 2e-3 * 2 / (2 * 3.998) / 1e-5
    found = covered("mavrinac", square(0.1, 2.0), LENS, acceptable_blur=2 * blur, **FLAT)
    assert found == pytest.approx(0.5, rel=1e-12)
    ideal = covered(
        "mavrinac", square(0.1, 2.0), LENS, ideal_blur=blur, acceptable_blur=2 * blur, **FLAT
    )
    assert ideal == pytest.approx(1.0)
    assert (covered("mavrinac", square(0.1, 2.0), LENS, acceptable_blur=0.9 * blur) == 0).all()


def test_the_blur_circle_is_the_cameras_depth_of_field():
    for limit in (0.05, 0.1, 0.19):
        z_n, z_f = LENS.depth_of_field(limit)
        blur, in_range = mavrinac.blur_circle(LENS, np.array((z_n, 4.0, z_f)))
        assert blur == pytest.approx((limit, 0.0, limit), abs=1e-12)
        assert in_range.all()


def test_mavrinac_has_a_step_where_the_camera_gives_its_depth_of_field_itself():
    camera = dataclasses.replace(CAMERA, focus_range=(3.5, 9.0))  # not the vertex at depth 3
    assert covered("mavrinac", TILTED, camera, **FLAT) == pytest.approx(2 / 3)


def test_mavrinac_keeps_the_vertices_that_are_not_hidden():
    # Vertex 1 of the sheet, at (-.5, .5, 4), belongs to its first face only.
    mesh = joined(square(0.5, 4.0), square(0.05, 2.0, centre=(-0.25, 0.25)))
    found = covered("mavrinac", mesh, **FLAT)[0, :2]
    assert found == pytest.approx((2 / 3, 1.0))


def test_k_ocular_is_the_best_subsets_weakest():
    rng = np.random.default_rng(4)
    values = rng.integers(0, 5, (6, 7, 3)) / 4
    for k in range(1, 7):
        subsets = itertools.combinations(range(6), k)
        brute = np.max([values[list(subset)].min(axis=0) for subset in subsets], axis=0)
        assert np.array_equal(mavrinac.k_ocular(values, k), brute)
    assert not mavrinac.k_ocular(values, 7).any()
    for wrong in (0, 1.5, True):
        with pytest.raises(ConfigError, match="k must be a whole number"):
            mavrinac.k_ocular(values, wrong)


def test_a_network_is_judged_point_by_point():
    # Each camera has the vertex that the other lacks; together they have all three once.
    mesh = Mesh(vertices=[(-2, 0, 4), (0, 2, 4), (2, 0, 4)], faces=[(0, 1, 2)])
    assert face_geometry(mesh, CAMERA, AHEAD[0]).is_front.all()
    poses = np.repeat(AHEAD, 2, axis=0)
    poses[:, 0, 3] = (3, -3)
    by_camera = covered("mavrinac", mesh, poses=poses, **FLAT)
    assert by_camera[:, 0] == pytest.approx((2 / 3, 2 / 3))
    options = mavrinac.MavrinacParameters(**FLAT)
    one, two = (
        mavrinac.network_coverage(
            mesh, CAMERA, poses, Task(min_pixels=1e-9, views=k), parameters=options
        )
        for k in (1, 2)
    )
    assert (one, two) == (pytest.approx(1.0), pytest.approx(1 / 3))


def test_the_frustum_has_its_centre_and_half_axes():
    centre, tensor = alarcon.frustum(CAMERA, 2.0, 6.0)
    assert centre == pytest.approx((0, 0, 4))
    assert tensor == pytest.approx(np.array([(0, 4, 0), (0, 0, 3), (2, 0, 0)]))
    assert alarcon.schatten_norm(tensor, 2) == pytest.approx(np.linalg.norm(tensor))
    assert alarcon.schatten_norm(tensor, math.inf) == pytest.approx(4)
    assert alarcon.schatten_norm(tensor, 1) == pytest.approx(9)


def test_alarcon_is_whole_at_the_centre_and_falls_with_distance_and_turn():
    def found(mesh, **more):
        return covered("alarcon", mesh, depth_range=(2.0, 6.0), **more)[0, 0]

    def triangle(x, z):
        return Mesh(
            vertices=[(x - 0.3, -0.2, z), (x, 0.4, z), (x + 0.3, -0.2, z)], faces=[(0, 1, 2)]
        )

    assert found(triangle(0, 4)) == pytest.approx(1)
    assert found(triangle(1, 4)) == pytest.approx(math.sqrt(1 - 1 / math.sqrt(29)))
    assert found(triangle(0, 3)) == pytest.approx(found(triangle(0, 5)))  # nearer is no better
    assert found(triangle(1, 4), norm_power=2.0) == pytest.approx(math.sqrt(1 - 1 / 29))
    assert found(triangle(1, 4), schatten_order=math.inf) == pytest.approx(math.sqrt(3 / 4))
    turn = 1 - math.hypot(1 / math.sqrt(2), 1 - 1 / math.sqrt(2)) / math.sqrt(2)
    assert found(TILTED) == pytest.approx(math.sqrt(turn))


def test_alarcon_looks_at_the_centroid_alone():
    mesh = Mesh(vertices=[(-0.3, -0.2, 4), (0, 0.4, 4), (0.3, -0.2, 4)], faces=[(0, 1, 2)])
    centroid, corner = square(0.01, 2.0), square(0.01, 2.0, centre=(0.0, 0.2))
    options = {"depth_range": (2.0, 6.0)}
    assert covered("alarcon", joined(mesh, centroid), **options)[0, 0] == 0
    assert covered("alarcon", joined(mesh, corner), **options)[0, 0] > 0.9
    assert covered("zhang", joined(mesh, centroid))[0, 0] == 1
    assert covered("zhang", joined(mesh, corner))[0, 0] == 0


@every_tracer
def test_bivalent_occlusion_takes_all_or_nothing(tracer):
    # A speck over one vertex hides a face whole; a cover over its middle hides nothing of it.
    face = Mesh(vertices=[(-1, -0.75, 4), (0, 1.5, 4), (1, -0.75, 4)], faces=[(0, 1, 2)])
    # At the depth of the face, whose area is 2.25, the speck hides its tip and the cover 0.8^2.
    tip = 0.02 * (0.02 * 2 / 2.25) / 2
    for other, bivalent, hidden in (
        (square(0.01, 2.0, centre=(0.0, 0.75)), 0, tip),
        (square(0.2, 2.0), 1, 0.64),
    ):
        mesh = joined(face, other)
        assert visible(mesh, tracer=tracer)[0, 0] == bivalent
        assert covered("zhang", mesh, tracer=tracer)[0, 0] == bivalent
        seen = visibility(mesh, CAMERA, AHEAD).value[0, 0]
        assert seen == pytest.approx(1 - hidden / 2.25, abs=1e-9)


@pytest.mark.parametrize(
    ("task", "density"),
    [
        (Task(min_pixels=1), 2.0),  # 1 px on 0.25 m^2
        (Task(min_pixels=400), 40.0),
        (Task(min_pixels=1, min_pixel_density=30), 30.0),
        (Task(min_pixels=400, min_pixel_density=30), 40.0),
    ],
)
def test_what_is_required_is_the_tasks_pixels_seen_head_on(task, density):
    mesh = Mesh(vertices=[(0, 0, 4), (0, 1, 4), (0.5, 0, 4)], faces=[(0, 1, 2), (0, 0, 1)])
    assert required_density(mesh, task)[0] == pytest.approx(density)
    assert np.isinf(required_density(mesh, task)[1])  # no area, no pixels
    assert required_density(mesh, task, 7.0) == pytest.approx(7.0)


@pytest.mark.parametrize("name", ["tarabanis", "scott", "zhang", "image_space"])
def test_a_face_seen_head_on_with_the_tasks_pixels_is_covered_whole(name):
    # 0.5 m^2 at 50 px/m: 1,250 px.
    mesh = Mesh(vertices=[(-0.5, -1 / 3, 4), (0, 2 / 3, 4), (0.5, -1 / 3, 4)], faces=[(0, 1, 2)])
    assert covered(name, mesh, task=Task(min_pixels=1250)) == pytest.approx(1.0)
    part = 0.25 if name == "image_space" else 0.5  # pixels, or pixels a metre
    assert covered(name, mesh, task=Task(min_pixels=5000)) == pytest.approx(part)


def test_a_ramp_is_linear_between_its_limits_and_a_step_where_they_are_one():
    inf = math.inf
    values = np.array((0.0, 1.0, 1.5, 2.0, 3.0))
    assert ramp(values, 2.0, 1.0).tolist() == [1, 1, 0.5, 0, 0]
    assert ramp(values, 2.0, 2.0).tolist() == [1, 1, 1, 1, 0]
    assert ramp(values, inf, inf).tolist() == [1] * 5
    assert ramp(values, inf, 1.0).tolist() == [1] * 5


# --- laws ----------------------------------------------------------------------------------------


@pytest.mark.slow
@every_model
@settings(max_examples=10)
@given(seed=seeds)
def test_coverage_lies_between_0_and_1(name, seed):
    values = MODELS[name](soup(seed), LENS, look_at([(0, 0, 0), (1, 1, 1)], (0, 0, 5)))
    assert (values >= 0).all()
    assert (values <= 1).all()


@pytest.mark.slow
@every_model
@settings(max_examples=10)
@given(seed=seeds)
def test_faces_seen_from_behind_are_not_covered(name, seed):
    mesh = soup(seed)
    values = covered(name, mesh)[0]
    behind = ~face_geometry(mesh, CAMERA, AHEAD[0]).is_front
    assert (values[behind] == 0).all()
    assert ((values == 0) | (covered(name, turned(mesh))[0] == 0)).all()


@pytest.mark.slow
@every_model
@settings(max_examples=10)
@given(seed=seeds)
def test_a_two_sided_face_is_covered_from_either_side_alike(name, seed):
    mesh = soup(seed)
    two_sided = [Group("mesh", is_two_sided=True)]
    found = [
        covered(name, Mesh(vertices=mesh.vertices, faces=faces, groups=two_sided))
        for faces in (mesh.faces, mesh.faces[:, ::-1])
    ]
    assert found[0] == pytest.approx(found[1], abs=1e-9)
    # From the front it counts as it did.
    front = face_geometry(mesh, CAMERA, AHEAD[0]).is_front
    assert found[0][0, front] == pytest.approx(covered(name, mesh)[0, front], abs=1e-9)


@pytest.mark.slow
@every_model
@settings(max_examples=10)
@given(seed=seeds)
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
    options = {"depth_range": (3.0, 7.0)} if name == "alarcon" else {}
    easy = covered(name, mesh, LENS, task=Task(**kind), **options)
    hard = covered(name, mesh, LENS, task=Task(**{what: harder}), **options)
    assert (hard <= easy + 1e-12).all()


@pytest.mark.parametrize("name", ["tarabanis", "scott", "zhang"])
@settings(max_examples=10)
@given(seed=seeds, density=st.floats(1, 500), more=st.floats(1, 10))
def test_coverage_is_inverse_to_the_density_that_is_required(name, seed, density, more):
    mesh = soup(seed)
    easy = covered(name, mesh, required_density=density)
    hard = covered(name, mesh, required_density=density * more)
    assert (hard <= easy).all()
    below = easy < 1
    assert hard[below] == pytest.approx(easy[below] / more)


@settings(max_examples=10)
@given(
    seed=seeds,
    ideal=st.floats(0, 30),
    between=st.floats(0.1, 30),
    what=st.sampled_from(["mm_per_px", "blur", "incidence_deg"]),
)
def test_mavrinac_falls_as_its_limits_tighten(seed, ideal, between, what):
    mesh = soup(seed)

    def found(low, high):
        limits = {f"ideal_{what}": low, f"acceptable_{what}": high}
        return covered("mavrinac", mesh, LENS, **limits)

    base = found(ideal, ideal + between)
    assert (found(ideal / 2, ideal + between) <= base + 1e-12).all()
    assert (found(ideal, ideal + between / 2) <= base + 1e-12).all()


@pytest.mark.slow
@every_model
@settings(max_examples=10)
@given(seed=seeds)
def test_more_faces_cover_no_other_better(name, seed):
    mesh = soup(seed)
    options = {"depth_range": (3.0, 7.0)} if name == "alarcon" else {}
    fewer = without(mesh, [0, 1, 2, 3])
    all_of_them = covered(name, mesh, **options)[:, 4:]
    # To rounding for ours, which computes what is seen.
    assert (all_of_them <= covered(name, fewer, **options) + 1e-9).all()


@pytest.mark.slow
@settings(max_examples=10)
@given(seed=seeds)
def test_occlusion_is_0_or_1_where_it_is_bivalent(seed):
    mesh = soup(seed)
    seen = visible(mesh)
    assert set(np.unique(seen)) <= {0.0, 1.0}
    single = [Mesh(mesh.vertices, [face]) for face in mesh.faces]
    alone = [covered("zhang", each, task=Task())[0, 0] for each in single]
    assert covered("zhang", mesh, task=Task())[0] == pytest.approx(alone * seen[0])
    own = mavrinac.MavrinacParameters(tracer="own")
    points, *each = (
        mavrinac.strength_of_points(scene, CAMERA, AHEAD, Task(), parameters=own)[0]
        for scene in (mesh, *single)
    )
    assert ((points == 0) | np.isclose(points, np.concatenate(each))).all()


@settings(max_examples=10)
@given(seed=seeds)
def test_a_face_of_which_all_is_seen_has_no_hidden_vertex(seed):
    mesh = soup(seed)
    whole = visibility(mesh, CAMERA, AHEAD).value[0] == 1
    inside = face_geometry(mesh, CAMERA, AHEAD[0]).in_view
    assert visible(mesh)[0, whole & inside].all()


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
@given(seed=seeds)
@example(seed=3)
def test_our_segments_are_those_of_a_linear_system(seed):
    mesh = soup(seed, 9)
    found = LineOfSight(mesh, "own").hidden(mesh.vertices, AHEAD[0], 1e-9)
    assert np.array_equal(found, brute(mesh, mesh.vertices, np.zeros(3)))


def doubtful(mesh, point, eye):
    """Whether a segment passes within `TOLERANCE` of an edge, or of a plane where it begins."""
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    reach = np.linalg.norm(eye - point)
    along = (eye - point) / reach
    start = point + MARGIN * size * along
    for corners in mesh.vertices[mesh.faces]:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        if abs(normal @ (start - corners[0])) <= TOLERANCE * size:
            return True
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            across = np.cross(along, b - a)
            if np.linalg.norm(across) == 0:
                return True
            gap = abs((a - start) @ across) / np.linalg.norm(across)
            if gap <= TOLERANCE * size:
                return True
    return False


@settings(max_examples=10)
@given(seed=seeds, n=st.integers(1, 60))
def test_both_tracers_agree_but_for_a_hair_s_breadth(seed, n):
    mesh = soup(seed, n)
    found = [LineOfSight(mesh, t).hidden(mesh.vertices, AHEAD[0], 1e-9) for t in ("embree", "own")]
    eye = np.zeros(3)
    assert all(doubtful(mesh, mesh.vertices[i], eye) for i in np.flatnonzero(found[0] != found[1]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["teapot", "aeroplane", "torus", "room"])
def test_both_tracers_agree_on_parts(name):
    mesh = shapes.by_name(name)
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    different = total = 0
    for pose in sphere_of_poses(mesh.bounds.mean(axis=0), 2 * size, 4):
        found = [LineOfSight(mesh, t).hidden(mesh.vertices, pose, 1e-6) for t in ("embree", "own")]
        assert 0.05 < found[1].mean() < 0.95
        different += int((found[0] != found[1]).sum())
        total += mesh.n_vertices
    assert different <= 1 + 1e-4 * total


@every_tracer
@pytest.mark.parametrize("name", ["box", "icosahedron", "sphere"])
def test_a_convex_solid_hides_none_of_its_front_faces(name, tracer):
    # Each vertex is shared: were faces that touch there to hide, none would be seen.
    mesh = shapes.by_name(name)
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    poses = sphere_of_poses(mesh.bounds.mean(axis=0) + 0.01 * size, 1.7 * size, 6)
    found = visible(mesh, poses=poses, tracer=tracer)
    for row, pose in enumerate(poses):
        view = face_geometry(mesh, CAMERA, pose)
        clear = view.is_front & (view.incidence < math.radians(85))
        assert clear.sum() > 1
        assert found[row, clear].all()
        assert not found[row, ~view.is_front].any()


@every_tracer
def test_a_face_that_only_touches_a_vertex_hides_nothing(tracer):
    wall = square(1.0, 4.0)
    assert visible(joined(wall, wall), tracer=tracer).all()  # a copy
    # A fin that leans from the wall to the camera, on its tip in the middle of a face.
    fin = Mesh(vertices=[(0.2, 0.3, 4), (0.6, 0.9, 3.4), (-0.2, 0.9, 3.4)], faces=[(0, 2, 1)])
    assert face_geometry(fin, CAMERA, AHEAD[0]).is_front.all()
    assert visible(joined(wall, fin), tracer=tracer)[0].tolist() == [1, 1, 1]


def turned(mesh):
    return Mesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])


@every_tracer
def test_what_lies_before_the_near_plane_hides_nothing(tracer):
    mesh = joined(square(0.5, 4.0), square(1.0, 2.0))
    for near, expected in ((0.0, 0), (2.1, 1)):
        camera = dataclasses.replace(CAMERA, near=near)
        assert (covered("zhang", mesh, camera, tracer=tracer)[0, :2] == expected).all()


@every_tracer
def test_occluders_and_back_faces_hide(tracer):
    wall, cover = square(0.5, 4.0), turned(square(1.0, 2.0))
    both = joined(wall, cover)
    groups = [Group("part"), Group("fixture", is_occluder=True)]
    mesh = Mesh(both.vertices, both.faces, groups=groups, face_group=[0, 0, 1, 1])
    assert (covered("zhang", mesh, tracer=tracer)[0, :2] == 0).all()
    assert (covered("mavrinac", mesh, tracer=tracer)[0, :2] == 0).all()
    assert (covered("alarcon", mesh, tracer=tracer)[0, :2] == 0).all()


def test_a_face_seen_edge_on_hides_nothing():
    fin = Mesh(vertices=[(0, -1, 2), (0, 1, 2), (0, 0, 3)], faces=[(0, 1, 2)])  # in a plane x = 0
    point = np.array([(0.0, 0.0, 5.0)])
    assert not LineOfSight(joined(fin, square(1, 6.0)), "own").hidden(point, AHEAD[0], 1e-9).any()
    assert LineOfSight(joined(square(1, 3.0), fin), "own").hidden(point, AHEAD[0], 1e-9).all()


def test_no_segment_slips_between_two_faces():
    # Through the common edge of two faces, and through the vertex that six of them share.
    fan = shapes.by_name("icosahedron")
    corners = fan.vertices[fan.faces]
    tracer = OwnTracer(corners - fan.vertices.mean(axis=0))
    middles = (corners + np.roll(corners, -1, axis=1)).reshape(-1, 3) / 2
    aims = np.concatenate((corners.reshape(-1, 3), middles)) - fan.vertices.mean(axis=0)
    for origin in np.random.default_rng(0).normal(0, 0.02, (50, 3)):
        d = aims - origin
        reach = np.linalg.norm(d, axis=1)
        assert tracer.meets(np.repeat(origin[None], len(d), 0), d / reach[:, None], 2 * reach).all()


def test_without_embreex_our_own_loops_answer(monkeypatch):
    mesh = soup(2)
    expected = LineOfSight(mesh, "own").hidden(mesh.vertices, AHEAD[0], 1e-9)
    assert LineOfSight(mesh).tracer == "embree"
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    sight = LineOfSight(mesh)
    assert sight.tracer == "own"
    assert np.array_equal(sight.hidden(mesh.vertices, AHEAD[0], 1e-9), expected)
    with pytest.raises(ConfigError, match=r"tracer embree needs the package embreex: pip install"):
        LineOfSight(mesh, "embree")


def test_a_mesh_without_area_hides_nothing():
    line = Mesh(vertices=[(0, 0, 4), (0, 1, 4), (0, 2, 4)], faces=[(0, 1, 2)])
    assert not LineOfSight(line).hidden(np.array([(0.0, 0, 8)]), AHEAD[0], 1e-9).any()
    for name in MODELS:
        assert not covered(name, line).any()
    assert not covered("mavrinac", line, acceptable_mm_per_px=1e9, **FLAT).any()


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "values", "words"),
    [
        (tarabanis.TarabanisParameters, {"required_density": -1.0}, "required_density must be 0"),
        (scott.ScottParameters, {"required_density": math.nan}, "required_density must be 0 or"),
        (zhang.ZhangParameters, {"required_density": "x"}, "required_density must be 0 or more"),
        (zhang.ZhangParameters, {"tracer": "optix"}, "tracer must be auto, embree or own, got"),
        (mavrinac.MavrinacParameters, {"padding": -1}, "padding must be 0 or more pixels, got -1"),
        (mavrinac.MavrinacParameters, {"ideal_blur": True}, "ideal_blur must be 0 or more pixels"),
        (
            mavrinac.MavrinacParameters,
            {"ideal_mm_per_px": 3, "acceptable_mm_per_px": 2},
            "ideal_mm_per_px must not exceed acceptable_mm_per_px, got 3 and 2",
        ),
        (mavrinac.MavrinacParameters, {"acceptable_incidence_deg": 91}, "0 to 90, or None, got 91"),
        (alarcon.AlarconParameters, {"schatten_order": 0.5}, "schatten_order must be 1 or more"),
        (alarcon.AlarconParameters, {"depth_range": (3, 2)}, "near < far, got 3 and 2"),
        (alarcon.AlarconParameters, {"tracer": ""}, "tracer must be"),
        (image_space.ImageSpaceParameters, {"method": "guessed"}, "method must be one of"),
    ],
)
def test_parameters_that_mean_nothing_are_refused(model, values, words):
    with pytest.raises(ConfigError, match=words):
        model(**values)


# --- side by side --------------------------------------------------------------------------------

TEAPOT = shapes.teapot(3)
EYE = Camera(width=160, height=120, fx=190, fy=190)
AROUND = sphere_of_poses(TEAPOT.bounds.mean(axis=0), 0.5, 4)


@pytest.fixture(scope="module")
def found():
    return compare_models(TEAPOT, EYE, AROUND)


def test_disagreements_are_counted_over_all_poses(found):
    task = Task()
    values = {name: model(TEAPOT, EYE, AROUND, task) for name, model in MODELS.items()}
    seen = evaluate(TEAPOT, EYE, AROUND, task)
    by_pair = {(each.covers, each.does_not): each for each in found.disagreements}
    for first, second in itertools.permutations(MODELS, 2):
        only = covers(values[first], task) & ~covers(values[second], task)
        entry = by_pair.get((first, second))
        assert (entry.faces if entry else 0) == only.sum()
        if entry:
            assert entry.mean_visibility == pytest.approx(seen.visibility[only].mean())
            assert entry.hidden + entry.partly + entry.whole == entry.faces
            area = (seen.visibility * seen.drawn_pixels)[only].sum()
            assert entry.visible_pixels == pytest.approx(area)
            assert entry.image_pixels == pytest.approx(seen.drawn_pixels[only].sum())
    assert by_pair  # the models do disagree
    for score in found.models:
        assert score.covered == covers(values[score.name], task).sum()
        assert score.mean == pytest.approx(values[score.name].mean())


def test_the_bivalent_test_is_held_against_what_is_seen(found):
    seen = evaluate(TEAPOT, EYE, AROUND)
    bivalent = zhang.visible(TEAPOT, EYE, AROUND) > 0
    front = np.array([face_geometry(TEAPOT, EYE, pose).is_front for pose in AROUND])
    judged = seen.in_view & front & (seen.drawn_pixels > 0)
    lost = judged & ~bivalent & (seen.visibility > seen.visibility_bound)
    false = judged & bivalent & (seen.visibility < 1 - seen.visibility_bound)
    test = found.bivalence
    assert (test.faces, test.called_hidden, test.called_seen) == (
        judged.sum(),
        lost.sum(),
        false.sum(),
    )
    assert test.called_hidden_visibility == pytest.approx(seen.visibility[lost].mean())
    assert 0 < test.called_hidden <= test.faces
    off = np.where(judged, np.abs(bivalent - seen.visibility) * seen.drawn_pixels, 0)
    assert found.misjudged == pytest.approx(off.sum(axis=1))
    worst = found.worst[0]
    assert off[worst.pose, worst.face] == off.max()
    assert worst.visibility == seen.visibility[worst.pose, worst.face]
    assert list(worst.coverage) == list(MODELS)


def test_what_has_no_coverage_is_never_covered():
    values = np.array((0.0, 0.1, 0.5, 1.0))
    assert covers(values, Task.thesis()).tolist() == [False, True, True, True]
    assert covers(values, Task()).tolist() == [False, False, True, True]


def test_batches_change_nothing(found, monkeypatch):
    monkeypatch.setattr("rastercov.reference.models.comparison.POSES_A_BATCH", 3)
    again = compare_models(TEAPOT, EYE, AROUND)
    assert again.disagreements == found.disagreements
    assert again.worst == found.worst
    assert again.misjudged == found.misjudged


def test_occluders_are_not_compared():
    both = joined(square(0.5, 4.0), square(0.3, 2.0))
    groups = [Group("part"), Group("fixture", is_occluder=True)]
    mesh = Mesh(both.vertices, both.faces, groups=groups, face_group=[0, 0, 1, 1])
    result = compare_models(mesh, CAMERA, AHEAD)
    assert result.task_faces == 2
    assert {score.name: score.covered for score in result.models}["tarabanis"] == 2
    assert result.bivalence.faces == 2


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"names": ["zhang", "li"]}, "there is no model 'li'; there are tarabanis, scott"),
        ({"names": []}, "name at least one model"),
        ({"names": ["zhang", "zhang"]}, "zhang is named twice"),
        ({"poses": np.empty((0, 4, 4))}, "there are no poses"),
    ],
)
def test_what_cannot_be_compared_is_refused(changes, words):
    with pytest.raises(ConfigError, match=words):
        compare_models(TEAPOT, EYE, **({"poses": AROUND} | changes))


HALF = joined(
    Mesh(vertices=[(-1, -1, 4), (-1, 1, 4), (1, 1, 4)], faces=[(0, 1, 2)]),
    sheet((-0.75, -0.25), (0.1, 0.75), 2.0),
)
"""A face of which a part is hidden, and with it a vertex."""


def test_bivalent_is_black_where_graded_is_grey_and_the_difference_has_a_colour():
    bivalent = zhang.visible(HALF, CAMERA, AHEAD)[0]
    graded = visibility(HALF, CAMERA, AHEAD).value[0]
    assert bivalent.tolist() == [0, 1, 1]
    assert 0.1 < graded[0] < 0.9
    whole = look_at_part(HALF, CAMERA, AHEAD[0])
    face = whole.buffer.face == 0
    assert face.mean() > 0.05
    black, grey = (
        coverage_pixels(whole.buffer, values, HALF, AHEAD[0])[face].mean()
        for values in (bivalent, graded)
    )
    assert black < 60
    assert grey > black + 0.6 * 205 * graded[0]
    # At 1, the colour itself; on faces that do not differ, a grey.
    coloured = difference_picture(whole, np.array([0.0, 1, 1]), np.array([1.0, 1, 1]))
    pixels = np.asarray(coloured)[: whole.camera.height, : whole.camera.width]
    assert np.abs(pixels[face] - np.array(MISSED)).max() <= 1
    others = pixels[whole.buffer.face > 0]
    assert np.ptp(others, axis=1).max() == 0


def test_the_place_that_is_enlarged_is_where_they_differ():
    graded = visibility(HALF, CAMERA, AHEAD).value[0]
    bivalent = zhang.visible(HALF, CAMERA, AHEAD)[0]
    closer = look_closer(HALF, CAMERA, AHEAD[0], np.abs(graded - bivalent))
    whole = look_at_part(HALF, CAMERA, AHEAD[0])
    assert (closer.buffer.face == 0).mean() > (whole.buffer.face == 0).mean()
    assert closer.camera.fx > 2 * whole.camera.fx


@pytest.mark.slow
def test_a_part_that_fills_more_than_the_image_is_drawn_as_far_as_it_goes():
    near = joined(square(9.0, 4.0), square(0.5, -3.0))
    look = look_at_part(near, CAMERA, AHEAD[0])
    assert (look.buffer.face >= 0).all()
    nothing = look_at_part(square(0.5, -3.0), CAMERA, AHEAD[0])
    assert (nothing.buffer.face < 0).all()
    looked = look_closer(near, CAMERA, AHEAD[0], np.zeros(near.n_faces))
    assert occlusion_sheet(look, looked, np.ones(4), np.ones(4)).width > 1000


@pytest.mark.slow
def test_sheets_have_a_picture_for_each_model():
    look = look_at_part(HALF, CAMERA, AHEAD[0])
    three = models_sheet(look, {str(i): np.ones(3) for i in range(3)}, ["a", "b", "c"])
    six = models_sheet(look, {str(i): np.ones(3) for i in range(6)}, list("abcdef"))
    assert six.width == three.width
    assert six.height > 1.8 * three.height


@pytest.mark.slow
def test_the_page_stands_alone_and_names_every_model(tmp_path, found):
    (tmp_path / "notes.txt").write_text("mine")
    path = write_model_comparison(tmp_path / "", found, TEAPOT, EYE, AROUND)
    text = path.read_text(encoding="utf-8")
    assert read_alone(text).loads
    assert all(name in text for name in MODELS)
    names = sorted(file.name for file in tmp_path.iterdir())
    assert "notes.txt" in names
    assert len([name for name in names if name.startswith("occlusion_")]) == 3
    data = json.loads((tmp_path / "models.json").read_bytes())
    assert [score["name"] for score in data["models"]] == list(MODELS)
    assert data["run"]["task"]["min_pixels"] == 1.0
    assert data["bivalence"]["faces"] == found.bivalence.faces


def test_the_page_escapes_names(found):
    run = found.run | {"mesh": [{"name": "<b>part</b>.stl"}]}
    text = page(dataclasses.replace(found, run=run), {})
    assert "<b>part" not in text
    assert "&lt;b&gt;part" in text


def test_a_share_is_never_rounded_up_to_all(found):
    score = dataclasses.replace(found.models[0], seen_percent=99.9999)
    text = page(dataclasses.replace(found, models=(score, *found.models[1:])), {})
    assert "99.99 %" in text
    assert "100.00 %" not in text


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


@pytest.mark.parametrize("name", ["models.json", "models.html", "models_9.png", "occlusion_0.png"])
def test_the_command_refuses_to_replace_files_of_nobody(capsys, tmp_path, monkeypatch, name):
    (tmp_path / name).write_text("mine")
    monkeypatch.setattr(
        "rastercov.reference.models.comparison.compare_models", lambda *_, **__: 1 / 0
    )
    error = refusal(capsys, f"compare box -c khepra -p sphere:2 --models -o {tmp_path}")
    assert error.startswith(f"error: {tmp_path / name}: not of an earlier report")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]
