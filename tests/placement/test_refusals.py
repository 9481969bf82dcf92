"""What makes no sense is refused in one line that names it, by every function of placement."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_candidates import CAMERA, NOISY, ORIGIN, SEGMENTS, SHARP
from test_search import CAMERA as SMALL
from test_search import MESH, SPACE, TASK

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement import (
    BestCoverage,
    FewestCameras,
    Framing,
    InstallationError,
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Objective,
    PoseSpace,
    along,
    at_nearest_surface,
    build_matrix,
    filter_candidates,
    on_box,
    on_sphere,
    openings,
    optimise,
    per_face,
    per_segment,
    problem_of,
    problem_of_matrix,
    refine,
    segment,
    select_greedy,
    select_integer,
    tolerance,
    what_is_left,
)
from rastercov.placement.audit import audit
from rastercov.placement.bits import CoveredBits

BOX = shapes.box()
EYE = np.eye(4)
RNG = np.random.default_rng(0)
LENS = rc.Camera(width=640, height=400, fx=800, fy=700, cx=-10)
RIGS = replace(
    problem_of_matrix([[1], [1]], min_angle_deg=6, eyes=np.eye(3)[:2], centroids=[[0, 0, 0]]),
    bits=CoveredBits.from_dense(np.ones((3, 1))),
    starts=np.array([0, 2, 3]),
    eyes=np.eye(3),
)
ONE = problem_of_matrix([[1, 0]], BestCoverage(1))
POSES = rc.sphere_of_poses((0, 0, 0), 3.0, 2)


def candidates(maker, **options):
    return lambda o: maker(NOISY, CAMERA, **options)


def searched(**options):
    own = {"cameras": 2, "budget": 16} | options
    return lambda o: optimise(o, SPACE, **own)


def refined(**options):
    return lambda o: refine(o, replace(SPACE, boxes=None, keep_out=()), POSES, **options)


def framed(**options):
    return lambda o: Framing(**options)


def space(**options):
    return lambda o: PoseSpace(mesh=MESH, **options)


def counted(**options):
    return lambda o: Objective.of(o.observer, TASK, **options)


def covered(covers, **options):
    return lambda o: problem_of_matrix(covers, **options)


def audited(**options):
    return lambda o: audit(MESH, SMALL, POSES, **options)


REFUSED = [
    # framing and generators
    (framed(stand_off=(2, 1)), "expected stand_off 0 <= least <= greatest"),
    (framed(fit="best"), "fit to be extent or vertices, got 'best'"),
    (framed(margin=0), "expected margin above 0"),
    (framed(rolls_deg=()), "expected rolls_deg of one"),
    (framed(up=(0, 0, 0)), "expected up as a direction"),
    (lambda o: per_segment(NOISY, LENS, segmentation=SEGMENTS), "optical axis"),
    (lambda o: per_segment(BOX, CAMERA, segmentation=SEGMENTS), "expected 12 faces, got 320"),
    (
        lambda o: per_segment(NOISY, SHARP, Framing(stand_off=(5, 6)), segmentation=SEGMENTS),
        "depth of field 0.5 to 3 m, got 5 to 6 m",
    ),
    (
        lambda o: per_face(BOX, CAMERA, faces=[1, 12]),
        "expected face indices from 0 to 11, got 1 to 12",
    ),
    (lambda o: per_face(BOX, CAMERA, faces=[True]), "faces as a mask of 12 or as rows"),
    (candidates(on_sphere, count=0), "expected count from 1"),
    (candidates(on_sphere, count=3, distances=-1), "expected distances above 0"),
    (candidates(on_sphere, count=3, centre=(1, 2)), "centre to be three"),
    (candidates(on_box, spacing=0), "expected spacing above 0"),
    (candidates(on_box, spacing=1e-5), "at most 10000000 positions"),
    (candidates(on_box, spacing=1, sides=["top"]), "got 'top'"),
    (candidates(on_box, spacing=1, bounds=[0, 1]), "bounds to be two finite"),
    (candidates(on_box, spacing=1, outward=-5), "expected a box with low <= high"),
    (candidates(on_box, spacing=1, aim=at_nearest_surface("lid")), "got 'lid'"),
    (lambda o: along((0, 0, 0)), "got one of length 0"),
    (candidates(openings, faces=[0], views=0), "expected views of 1 or more, even side"),
    (candidates(openings, faces=[0], side=7), "even side and finest"),
    (lambda o: segment(BOX, -1, 25), "alpha_deg from 0 to below 90 degrees, got -1"),
    (lambda o: segment(BOX, 15, 90), "beta_deg from 0 to below 90 degrees, got 90"),
    (lambda o: segment(BOX, 15, 25, merge="last"), "merge to be leader or closest"),
    # positions
    (lambda o: filter_candidates(ORIGIN, NOISY, -1), "expected clearance of 0 m or more"),
    (lambda o: KeepOutBox((0, 0, 1), (1, 1, 0)), "corners low <= high of a keep-out box"),
    (lambda o: KeepOutSphere((0, 0, 0), 0), "a radius above 0 of a keep-out sphere"),
    (lambda o: NearestSurface(BOX, np.zeros(12, bool)), "expected a face with an area"),
    (space(stand_off=(2, 1)), "expected stand_off"),
    (space(), "expected boxes or a greatest"),
    (space(clearance=-1.0, stand_off=(0, 1)), "expected clearance"),
    (space(boxes=[(0, 0, 0), (1, 1, -1)]), "low <= high"),
    (space(boxes=[(0, 0, 0)]), "two corners"),
    (space(up=(0, 0, 0), stand_off=(0, 1)), "expected up"),
    (
        lambda o: PoseSpace(mesh=MESH, boxes=[(8, 8, 8), (9, 9, 9)], stand_off=(0, 1)).sample(
            5, RNG
        ),
        "expected places for 5 cameras",
    ),
    # problems and selections
    (covered([[1, 2]]), "0 and 1"),
    (covered([1, 0]), "got int64 (2,)"),
    (covered([[1]], costs=[-1]), "finite costs of 0 or more"),
    (covered([[1]], costs=[1, 2]), "expected costs (1,), got shape (2,)"),
    (covered([[1]], weights=[math.nan]), "finite weights of 0 or more"),
    (covered([[1]], views=0), "expected views of 1 or more"),
    (covered([[1]], min_angle_deg=20), "expected eyes and centroids"),
    (covered([[1]], min_angle_deg=200), "from 0.001 to 180"),
    (covered([[1]], face_group=1), "expected face_group as rows"),
    (covered([[1]], goal=FewestCameras(groups={"rim": 1})), "expected a group, got 'rim'"),
    (
        covered([[1, 0]]),
        "The only candidate reaches 50.0 % of the area, expected 100.0 %; reduce it, give of",
    ),
    (covered(np.ones((3, 2)), views=4), "All 3 candidates together reach 0.0 % of the area"),
    (lambda o: FewestCameras(1.5), "expected coverage from 0 to 1"),
    (lambda o: FewestCameras(groups={"rim": -1}), "expected rim from 0 to 1"),
    (lambda o: BestCoverage(), "expected cameras, budget or both"),
    (lambda o: BestCoverage(-1), "cameras to be a whole number, 0 or more"),
    (lambda o: BestCoverage(budget=math.inf), "budget to be 0 or more"),
    (lambda o: replace(RIGS, eyes=RIGS.eyes[:2]), "expected eyes (3, 3), got shape (2, 3)"),
    (lambda o: replace(RIGS, starts=np.array([0, 0, 3])), "starts of one or more of 3 cameras"),
    (lambda o: replace(ONE, weights=np.ones(3)), "expected bits of 3 faces"),
    (lambda o: select_greedy(ONE, core_pairs=-1), "core_pairs of 0 or more, got -1"),
    (lambda o: select_integer(ONE, time_limit=0), "expected time_limit above 0"),
    (lambda o: build_matrix((MESH, SMALL), POSES, poses_a_shard=0), "expected poses_a_shard of 1"),
    (
        lambda o: problem_of(build_matrix((MESH, SMALL), POSES), BOX, BestCoverage(1)),
        "the mesh of 120 faces, got one of 12",
    ),
    # improvement
    (counted(weight_by="colour"), "weight_by to be"),
    (counted(views=0), "expected views of 1"),
    (counted(views={"x": 1}), "expected a group, got 'x'"),
    (counted(min_angle_deg=200), "expected min_angle_deg to be 0, or from 0.001 to 180"),
    (searched(method="pso"), "unknown argument 'method'"),
    (searched(cameras=0), "expected cameras of 1 or more"),
    (searched(budget=1), "expected budget of 2"),
    (searched(start=EYE), "expected start (2, 4, 4)"),
    (searched(start=np.tile(EYE, (2, 1, 1))), "expected camera 0 in an allowed place"),
    (refined(turn_deg=0), "expected turn_deg of"),
    (refined(step=-1.0), "expected step above 0"),
    (refined(step=[1.0, 1.0, 1.0]), "expected step as one number or 2"),
    (refined(halvings=1.5), "halvings to be"),
    (refined(budget=1), "expected budget of 2"),
    (lambda o: refine(o, SPACE, EYE[None]), "expected camera 0 in an allowed place, got one"),
    (lambda o: InstallationError(position_mm=-1), "position_mm to be"),
    (lambda o: InstallationError(angle_deg=math.inf), "angle_deg to be"),
    (lambda o: InstallationError(distribution="cauchy"), "distribution to be normal or uniform"),
    (lambda o: tolerance(o, POSES, InstallationError(), draws=0), "expected draws of 1"),
    # what is left, and audits
    (lambda o: what_is_left((BOX, CAMERA), POSES, covered=[True]), "mask of 12 faces"),
    (lambda o: what_is_left((BOX, CAMERA), POSES, covered=np.ones(12)), "got float64"),
    (audited(names=["a"]), "expected names for 2 poses, got 1"),
    (audited(frames=["a"]), "expected frames for 2 poses, got 1"),
    (audited(names="ab"), "list of strings"),
    (audited(by="volume"), "expected 'by' to be area or face"),
    (audited(by="area", method="sampled"), "by area, use certified"),
]


@pytest.fixture(scope="module")
def objective():
    with rc.open_observer(MESH, SMALL) as observer:
        yield Objective.of(observer, TASK)


@pytest.mark.parametrize(("call", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_what_makes_no_sense_is_named_in_one_line(objective, call, words):
    with pytest.raises(rc.RastercovError) as caught:
        call(objective)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
