"""What makes no sense is refused in one line that names it, by every function of placement."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_candidates import CAMERA, NOISY, ORIGIN, SEGMENTS, SHARP
from test_search import CAMERA as SMALL
from test_search import MESH, SPACE, TASK

import rastercov as rc
from rastercov.mesh import shapes
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
    (framed(stand_off=(2, 1)), "stand_off must be 0 <= least <= greatest"),
    (framed(fit="best"), "fit must be extent or vertices, got 'best'"),
    (framed(margin=0), "margin must be positive"),
    (framed(rolls_deg=()), "rolls_deg must be"),
    (framed(up=(0, 0, 0)), "up must be a direction"),
    (lambda o: per_segment(NOISY, LENS, segmentation=SEGMENTS), "optical axis"),
    (lambda o: per_segment(BOX, CAMERA, segmentation=SEGMENTS), "has 320 faces, the mesh 12"),
    (
        lambda o: per_segment(NOISY, SHARP, Framing(stand_off=(5, 6)), segmentation=SEGMENTS),
        "stand-off 5 ... 6 m must meet the depths 0.5 ... 3 m",
    ),
    (lambda o: per_face(BOX, CAMERA, faces=[1, 12]), "faces must lie in 0 ... 11, got 1 ... 12"),
    (lambda o: per_face(BOX, CAMERA, faces=[True]), "faces must be a mask of 12 or rows"),
    (candidates(on_sphere, count=0), "count must be a whole number"),
    (candidates(on_sphere, count=3, distances=-1), "distances must be positive"),
    (candidates(on_sphere, count=3, centre=(1, 2)), "centre must be three"),
    (candidates(on_box, spacing=0), "spacing must be positive"),
    (candidates(on_box, spacing=1e-5), "more than 10000000 positions"),
    (candidates(on_box, spacing=1, sides=["top"]), "got top"),
    (candidates(on_box, spacing=1, bounds=[0, 1]), "bounds must be two finite"),
    (candidates(on_box, spacing=1, outward=-5), "the box must have low <= high"),
    (candidates(on_box, spacing=1, aim=at_nearest_surface("lid")), "got ['lid']"),
    (lambda o: along((0, 0, 0)), "direction must not be zero"),
    (candidates(openings, faces=[0], views=0), "views must be 1 or more"),
    (candidates(openings, faces=[0], side=7), "side and finest even"),
    (lambda o: segment(BOX, -1, 25), "alpha_deg must satisfy 0 <= alpha_deg < 90, got -1"),
    (lambda o: segment(BOX, 15, 90), "beta_deg must satisfy 0 <= beta_deg < 90, got 90"),
    (lambda o: segment(BOX, 15, 25, merge="last"), "merge must be leader or closest"),
    # positions
    (lambda o: filter_candidates(ORIGIN, NOISY, -1), "clearance must be 0 m or more"),
    (lambda o: KeepOutBox((0, 0, 1), (1, 1, 0)), "a keep-out box needs low <= high"),
    (lambda o: KeepOutSphere((0, 0, 0), 0), "a keep-out sphere needs a centre and a radius > 0"),
    (lambda o: NearestSurface(BOX, np.zeros(12, bool)), "no face with an area is"),
    (space(stand_off=(2, 1)), "stand_off must be"),
    (space(), "boxes are needed"),
    (space(clearance=-1.0, stand_off=(0, 1)), "clearance must be"),
    (space(boxes=[(0, 0, 0), (1, 1, -1)]), "low <= high"),
    (space(boxes=[(0, 0, 0)]), "two corners"),
    (space(up=(0, 0, 0), stand_off=(0, 1)), "up must be"),
    (
        lambda o: PoseSpace(mesh=MESH, boxes=[(8, 8, 8), (9, 9, 9)], stand_off=(0, 1)).sample(
            5, RNG
        ),
        "no place for 5 cameras",
    ),
    # problems and selections
    (covered([[1, 2]]), "0 and 1"),
    (covered([1, 0]), "shape"),
    (covered([[1]], costs=[-1]), "costs must be 0 or more"),
    (covered([[1]], costs=[1, 2]), "costs must have shape (1,)"),
    (covered([[1]], weights=[math.nan]), "weights must be 0 or more"),
    (covered([[1]], views=0), "views must be 1 or more"),
    (covered([[1]], min_angle_deg=20), "needs eyes and centroids"),
    (covered([[1]], min_angle_deg=200), "0 to 180"),
    (covered([[1]], face_group=1), "face_group must index"),
    (covered([[1]], goal=FewestCameras(groups={"rim": 1})), "no group 'rim'"),
    (covered([[1, 0]]), "all 1 candidates together cover 0.5;"),
    (covered(np.ones((3, 2)), views=4), "cannot be reached"),
    (lambda o: FewestCameras(1.5), "must be 0 to 1"),
    (lambda o: FewestCameras(groups={"rim": -1}), "of rim must be 0 to 1"),
    (lambda o: BestCoverage(), "a number of cameras or a budget"),
    (lambda o: BestCoverage(-1), "cameras must be a whole number, 0 or more"),
    (lambda o: BestCoverage(budget=math.inf), "budget must be 0 or more"),
    (lambda o: replace(RIGS, eyes=RIGS.eyes[:2]), "eyes must have shape (3, 3), got (2, 3)"),
    (lambda o: replace(RIGS, starts=np.array([0, 0, 3])), "starts must divide 3 cameras"),
    (lambda o: replace(ONE, weights=np.ones(3)), "bits must be of 3 faces"),
    (lambda o: select_greedy(ONE, core_pairs=-1), "core_pairs must be 0 or more, got -1"),
    (lambda o: select_integer(ONE, time_limit=0), "time_limit must be more than 0"),
    (lambda o: build_matrix((MESH, SMALL), POSES, poses_a_shard=0), "poses_a_shard must be 1"),
    (
        lambda o: problem_of(build_matrix((MESH, SMALL), POSES), BOX, BestCoverage(1)),
        "of a mesh of 120 faces, got one of 12",
    ),
    # improvement
    (counted(weight_by="colour"), "weight_by must be"),
    (counted(views=0), "views must be"),
    (counted(views={"x": 1}), "no group 'x'"),
    (counted(min_angle_deg=200), "min_angle_deg must be"),
    (searched(method="pso"), "unknown argument 'method'"),
    (searched(cameras=0), "cameras must be"),
    (searched(budget=1), "budget must be"),
    (searched(start=EYE), "start must have shape"),
    (searched(start=np.tile(EYE, (2, 1, 1))), "camera 0 must stand where cameras may"),
    (refined(turn_deg=0), "turn_deg must be"),
    (refined(step=-1.0), "step must be"),
    (refined(step=[1.0, 1.0, 1.0]), "step must be one number or 2"),
    (refined(halvings=1.5), "halvings must be"),
    (refined(budget=1), "budget must be"),
    (lambda o: refine(o, SPACE, EYE[None]), "camera 0 must stand where cameras may, but is"),
    (lambda o: InstallationError(position_mm=-1), "position_mm must be"),
    (lambda o: InstallationError(angle_deg=math.inf), "angle_deg must be"),
    (lambda o: InstallationError(distribution="cauchy"), "distribution must be normal or uniform"),
    (lambda o: tolerance(o, POSES, InstallationError(), draws=0), "draws must be"),
    # what is left, and audits
    (lambda o: what_is_left((BOX, CAMERA), POSES, covered=[True]), "mask of 12 faces"),
    (lambda o: what_is_left((BOX, CAMERA), POSES, covered=np.ones(12)), "got float64"),
    (audited(names=["a"]), "names must have one text for each of 2 poses, got 1"),
    (audited(frames=["a"]), "frames must have one text for each of 2 poses, got 1"),
    (audited(names="ab"), "list of texts"),
    (audited(by="volume"), "by must be one of"),
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
