"""Coverage: the product recomputed, every reason by a scene made for it, runs of any size."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import joined, sheet, square

from rastercov.base.errors import ConfigError, PoseError, ResourceError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage import coverage as module
from rastercov.core.coverage import job
from rastercov.core.coverage.coverage import FIGURES, evaluate_batches, open_observer
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.task import NAMES, Reason, Task
from rastercov.core.coverage.visibility import FRACTION, visibility
from rastercov.core.mesh import Mesh, shapes

CAMERA = Camera(width=200, height=200, fx=100, fy=100)
SMALL = Camera(width=48, height=40, fx=45, fy=42, focus_range=(0.38, 0.48))
AHEAD = np.eye(4)  # at the origin, looking along +z
TEAPOT = shapes.teapot(3)
POSES = sphere_of_poses((0, 0, 0.08), 0.43, 6)


@pytest.fixture(params=["certified", "sampled:cpu"])
def how(request):
    """Options of `evaluate`."""
    return {"method": request.param}


def assert_same(one, other):
    for name in (*FIGURES, "pose_ids", "clipped"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
        assert getattr(one, name).dtype == getattr(other, name).dtype, name


@pytest.mark.parametrize("n", [0, 5])
def test_visibility_is_what_evaluate_has(how, n, monkeypatch):
    monkeypatch.setattr(module, "PAIRS_A_BATCH", 2 * TEAPOT.n_faces)
    observation, whole = (
        visibility(TEAPOT, SMALL, POSES[:n], **how),
        evaluate(TEAPOT, SMALL, POSES, **how, by="face"),
    )
    for name, value in zip(
        FRACTION, (observation.value, observation.bound, observation.kind), strict=True
    ):
        np.testing.assert_array_equal(value, getattr(whole, name)[:n])
        assert value.dtype == getattr(whole, name).dtype
    assert observation.info == whole.info


# --- the product ----------------------------------------------------------------------------------


# --- reasons, each by a scene made for it ---------------------------------------------------------

# A failing scene also fails every later criterion where it can: only the first one is named.
STRICT = {"min_pixels": 1e6, "min_visibility": 1, "max_incidence_deg": 10, "min_pixel_density": 1e6}
FLAT = Mesh(vertices=[(0, 0, 2), (1, 0, 2), (2, 0, 2)], faces=[(0, 1, 2)])
HIDDEN = joined(square(1, 4), square(1, 2))
NEEDLE = Mesh(vertices=[(0.001, 0, 1), (0.001, 0.5, 1), (0.0012, 0.5, 1)], faces=[(0, 1, 2)])
SLANTED = Mesh(vertices=[(-1, -0.5, 4), (-1, 0.5, 4), (1, 0, 9)], faces=[(0, 1, 2)])
FOCUSED = replace(CAMERA, focus_range=(3, 5))


@pytest.mark.slow
def several(name):
    """The reason of several criteria."""
    return Reason(NAMES.index(name))


@pytest.mark.parametrize(
    ("reason", "mesh", "camera", "task"),
    [
        (Reason.DEGENERATE, FLAT, FOCUSED, STRICT),
        (Reason.BACK_FACING, sheet((9, 9), (-9, 10), 2), FOCUSED, STRICT),
        (Reason.OUTSIDE, sheet((1, 1), (3, 2), 2), FOCUSED, STRICT),
        (Reason.OUTSIDE, sheet((1, -1), (-1, 1), -2), CAMERA, {}),
        (several("too_coarse+out_of_focus"), square(0.5, 2), FOCUSED, STRICT),
        (several("too_coarse+out_of_focus"), square(0.5, 6), FOCUSED, STRICT),
        (Reason.UNSAMPLED, NEEDLE, CAMERA, STRICT),
        (several("occluded+too_coarse"), HIDDEN, CAMERA, STRICT),
        (Reason.TOO_COARSE, square(1, 2), CAMERA, {"min_pixel_density": 50.1}),
        (Reason.TOO_COARSE, square(1, 2), CAMERA, {"min_pixels_per_m2": 2510}),
        (Reason.COVERED, square(1, 2), CAMERA, {"min_pixels_per_m2": 2490}),
        (Reason.TOO_COARSE, square(1, 2), CAMERA, {"min_pixels": 2e4}),
        (several("too_oblique+occluded"), HIDDEN, CAMERA, {"max_incidence_deg": 1}),
        (Reason.TOO_OBLIQUE, SLANTED, CAMERA, {"max_incidence_deg": 60}),
        (Reason.COVERED, SLANTED, CAMERA, {"max_incidence_deg": 80}),
        (Reason.COVERED, square(1, 2), CAMERA, {"min_pixel_density": 49.9, "min_pixels": 9e3}),
    ],
)
def test_reason(how, reason, mesh, camera, task):
    if reason == Reason.UNSAMPLED and how["method"] != "sampled:cpu":
        reason = several("too_oblique+too_coarse")  # however thin, it has an image
    result = evaluate(mesh, camera, AHEAD, Task(**task), **how, by="face")
    assert Reason(result.reason[0, 0]) == reason
    assert (result.coverage[0, 0] >= 0.5) == (reason == Reason.COVERED)


def test_a_threshold_that_is_just_met_is_met(how):
    mesh = square(0.5, 2)  # 1250 px a face, 50 px a metre, wholly visible
    first = evaluate(mesh, CAMERA, AHEAD, **how, by="face")
    drawn, density = first.drawn_pixels[0, 0], first.pixel_density[0, 0]
    just = {"min_visibility": 1, "min_coverage": 1, "min_pixels": drawn}
    met = evaluate(mesh, CAMERA, AHEAD, Task(**just, min_pixel_density=density), **how, by="face")
    assert met.reason[0, 0] == Reason.COVERED
    for more in ({"min_pixels": drawn + 1}, {"min_pixel_density": np.nextafter(density, 99)}):
        missed = evaluate(mesh, CAMERA, AHEAD, Task(**just | more), **how, by="face")
        assert missed.reason[0, 0] == Reason.TOO_COARSE


def test_near_clipped_poses_are_marked(how):
    mesh = sheet((-1, -1), (1, 1), 0.05)
    camera = replace(CAMERA, near=0.1)
    poses = np.stack((AHEAD, look_at((0, 0, -1), (0, 0, 0), (0, -1, 0))[0]))
    result = evaluate(mesh, camera, poses, **how, by="face")
    assert result.clipped.tolist() == [True, False]


# --- runs of any size -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("pairs", [1, 1 << 9, 1 << 11, 1 << 19])
def test_batches_make_up_the_whole(how, monkeypatch, pairs):
    whole = evaluate(TEAPOT, SMALL, POSES, **how, by="face")
    monkeypatch.setattr(module, "PAIRS_A_BATCH", pairs)
    assert_same(evaluate(TEAPOT, SMALL, POSES, **how, by="face"), whole)
    with open_observer(TEAPOT, SMALL, **how) as observer:
        batches = list(evaluate_batches(observer, POSES))
        step = module.batch_size(TEAPOT.n_faces, observer.threads)
    assert [len(batch.pose_ids) for batch in batches] == [
        len(POSES[start : start + step]) for start in range(0, len(POSES), step)
    ]
    for name in (*FIGURES, "pose_ids", "clipped"):
        together = np.concatenate([getattr(batch, name) for batch in batches])
        np.testing.assert_array_equal(together, getattr(whole, name), err_msg=name)


@pytest.mark.parametrize("none", [[], np.zeros((0, 4, 4))])
def test_no_poses_give_no_rows(how, none):
    result = evaluate(TEAPOT, SMALL, none, **how, by="face")
    for name, kind in FIGURES.items():
        assert getattr(result, name).shape == (0, TEAPOT.n_faces), name
        assert getattr(result, name).dtype == kind, name
    assert result.clipped.shape == result.pose_ids.shape == (0,)


def test_skipped_poses_keep_the_rows_of_the_input(how):
    poses = np.insert(POSES[:3], (0, 2), np.nan, axis=0)
    poses = np.concatenate((poses, 2 * POSES[:1]))
    result = evaluate(TEAPOT, SMALL, Poses.of(poses, skip_bad=True), **how, by="face")
    assert result.pose_ids.tolist() == [1, 2, 4]
    clean = evaluate(TEAPOT, SMALL, POSES[:3], **how, by="face")
    for name in FIGURES:
        assert np.array_equal(getattr(result, name), getattr(clean, name)), name
    none = evaluate(TEAPOT, SMALL, Poses.of(poses[:1], skip_bad=True), **how, by="face")
    assert none.coverage.shape == (0, TEAPOT.n_faces)


def test_a_bad_pose_is_named_before_anything_runs(monkeypatch):
    poses = POSES.copy()
    poses[4, 0, 0] = np.nan
    monkeypatch.setattr(job, "open_for", lambda *_, **__: pytest.fail("opened"))
    for attempt in (
        lambda: evaluate(TEAPOT, SMALL, poses, by="face"),
        lambda: evaluate_batches(None, poses),
    ):
        with pytest.raises(
            PoseError, match="expected a rigid transform, got one that is not finite"
        ) as caught:
            attempt()
        assert caught.value.pose_ids == (4,)


def test_only_a_run_within_the_budget_is_returned(how, monkeypatch):
    # Of counts of samples all figures are derived.
    each = sum(np.dtype(kind).itemsize for kind in FIGURES.values())
    size = (8 if how["method"].startswith("sampled") else each) * 6 * TEAPOT.n_faces
    monkeypatch.setattr(job, "EVALUATE_BUDGET", size)
    poses = np.concatenate((POSES, POSES * np.nan))
    assert (
        len(evaluate(TEAPOT, SMALL, Poses.of(poses, skip_bad=True), **how, by="face").pose_ids) == 6
    )
    monkeypatch.setattr(job, "EVALUATE_BUDGET", size - 1)
    result = evaluate(TEAPOT, SMALL, POSES, fields=["covered"], **how, by="face")
    assert result.bits.dense().shape == (6, 552)
    # What is advised is there: sums without figures of pairs.
    sums = evaluate(TEAPOT, SMALL, POSES, fields=(), **how, by="face").network.summary()
    assert sums == result.network.summary()
    monkeypatch.setattr(job, "open_for", lambda *_, **__: pytest.fail("opened"))
    with pytest.raises(ResourceError, match=r"6 poses x 552 faces.*fields=\(\)"):
        evaluate(TEAPOT, SMALL, POSES, **how, by="face")


# --- Task -----------------------------------------------------------------------------------------

LIMITS = {
    "min_pixels": ([0, -1, math.nan, True], [1e-3, 1e9]),
    "min_visibility": ([-0.1, 1.1, None], [0, 1]),
    "max_blur": ([0, -2, "1"], [1e-9, 1e9, None]),
    "max_incidence_deg": ([0, -10, 90.1], [1e-3, 90]),
    "min_pixel_density": ([-1, "-1 px/m", math.inf], [0, 1e9]),
    "min_facing_density": ([-1, "-1 px/m", 1j], [0, 1e9]),
    "min_pixels_per_m2": ([-1, 10**400], [0, 1e9]),
    "min_coverage": ([-0.1, 1.1, [0.5]], [0, 1]),
    "views": ([0, -1, 1.5], [1, 10**4]),
    "min_angle_deg": ([-1, 181], [0, 180]),
    "focus_rule": (["centre", "", None, ["vertices"]], ["vertices", "centroid"]),
    "cap_resolution": (["no", 0, 1, None], [False, True]),
}
"""Values of a threshold that are refused, and its ends."""


@pytest.mark.parametrize("name", LIMITS)
def test_a_threshold_outside_its_range_is_refused_and_its_ends_are_not(name):
    refused, ends = LIMITS[name]
    for value in refused:
        with pytest.raises(ConfigError, match=f"^expected {name} to be .{{,140}}$"):
            Task(**{name: value})
    for value in ends:
        assert getattr(Task(**{name: value}), name) == value


def test_a_task_sets_the_blur_limit(how):
    lens = {"focal_length": 5e-3, "pixel_size": 5e-6, "aperture": 5e-3, "focus_distance": 2}
    camera = Camera.from_lens(width=200, height=200, **lens)
    mesh = square(0.2, camera.depth_of_field(1)[1] * 1.001)
    for task, reason in ((Task(), Reason.OUT_OF_FOCUS), (Task(max_blur=2), Reason.COVERED)):
        assert (evaluate(mesh, camera, AHEAD, task, **how, by="face").reason == reason).all()


# --- some of the figures --------------------------------------------------------------------------


def test_only_what_is_asked_for_is_computed(how):
    whole = evaluate(TEAPOT, SMALL, POSES, **how, by="face")
    some = evaluate(TEAPOT, SMALL, POSES, fields=["reason", "coverage"], **how, by="face")
    kept = {"coverage", "reason"} if how["method"] == "certified" else set()  # read later
    assert set(vars(some)) & set(FIGURES) == kept
    for name in ("coverage", "reason", "pose_ids", "clipped"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name))
    with pytest.raises(ConfigError, match="expected incidence among the fields"):
        _ = some.incidence
    assert not hasattr(some, "nonsense")
    assert repr(some) == "Evaluation(6 poses x 552 faces: coverage, reason)"
    np.testing.assert_array_equal(copy.copy(some).reason, some.reason)


@pytest.mark.parametrize("fields", ["coverage", ["coverge"], [1], 3])
def test_an_unknown_figure_is_refused(fields):
    with pytest.raises(ConfigError, match="expected arrays of Coverage, got "):
        evaluate(TEAPOT, SMALL, POSES, fields=fields, by="face")


def test_a_face_far_smaller_than_a_pixel_counts_as_covered_if_it_contains_a_sample():
    camera = Camera(width=8, height=8, fx=8, fy=8)
    places = np.stack(np.meshgrid(*[np.arange(0, 1, 0.05)] * 2), axis=2).reshape(-1, 1, 2)
    corners = places + 0.02 * np.array([(-1, -1), (1, -1), (0, 1)])  # px
    points = np.concatenate((corners.reshape(-1, 2) / 8, np.ones((3 * len(places), 1))), axis=1)
    mesh = Mesh(points, np.arange(len(points)).reshape(-1, 3)[:, [0, 2, 1]])
    given = mesh, camera, np.eye(4)[None]
    sampled = evaluate(*given, by="face", method="sampled")
    is_covered = sampled.coverage[0] >= 0.5
    assert 0 < is_covered.sum() < 10
    assert (sampled.reason[0, ~is_covered] == Reason.UNSAMPLED).all()
    assert evaluate(*given, by="face").coverage.max() < 0.01
