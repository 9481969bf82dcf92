"""Faces judged in lanes, against the same faces one by one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov import Camera, Mesh, Task, evaluate, open_observer, sphere_of_poses
from rastercov.base.arguments import CACHE_LINE, align_array, read_only
from rastercov.core.camera.pose import Poses
from rastercov.core.coverage.coverage import FIGURES, LEAST_ALIGNED, arrays_for, measurements
from rastercov.core.coverage.face_pass import FacePass, figures_of
from rastercov.core.coverage.judging import CHOICES
from rastercov.core.coverage.network import Network
from rastercov.core.mesh import shapes
from rastercov.engine.coverage_figures import judge_poses

CAMERA = Camera(width=200, height=160, fx=170, fy=150, focus_range=(0.5, 6.0))
FEW = 1
"""Faces of a part of a mesh that are measured one by one: no level has as few lanes."""
pytestmark = pytest.mark.native
METHODS = "certified", "exact", "sampled:cpu@2"


def scene(rng):
    """A closed surface among loose faces of all sizes, some without area, some behind others."""
    torus = shapes.torus(rng.integers(6, 30), rng.integers(5, 12))
    n = int(rng.integers(1, 40))
    size = 10 ** rng.uniform(-3, 0.3, (n, 1, 1))
    size[rng.uniform(size=n) < 0.2] = 10 ** rng.uniform(-15.5, -11)  # next to no image
    corners = rng.normal(size=(n, 1, 3)) + size * rng.normal(size=(n, 3, 3))
    corners[rng.uniform(size=n) < 0.1, 1] = 0
    corners[rng.uniform(size=n) < 0.1, 2] = corners[0, 0]
    points = np.concatenate([torus.vertices / np.abs(torus.bounds).max(), corners.reshape(-1, 3)])
    loose = np.arange(3 * n).reshape(-1, 3) + len(torus.vertices)
    faces = np.concatenate([torus.faces, loose])
    mesh = Mesh(points, faces)
    return mesh.with_groups(two_sided="all") if rng.uniform() < 0.3 else mesh


def task(rng, poses, mesh):
    """Thresholds, of which some are met exactly."""
    limit = rng.choice([5.0, 40.0, 75.0, 90.0])
    if rng.uniform() < 0.5:
        incidence = evaluate(
            mesh, CAMERA, poses, Task(), fields=("incidence",), by="face"
        ).incidence
        angles = np.degrees(incidence[incidence < math.pi / 2])
        limit = float(rng.choice(angles)) if len(angles) else limit
    return Task(
        min_pixels=float(10 ** rng.uniform(-1, 3)),
        min_visibility=float(rng.choice([0.0, 0.5, 1.0])),
        max_incidence_deg=float(limit),
        min_pixel_density=float(rng.choice([0.0, 20.0, 80.0])),
        min_facing_density=float(rng.choice([0.0, 40.0, 60.0])),
        min_pixels_per_m2=float(rng.choice([0.0, 0.0, 900.0])),
        min_coverage=float(rng.choice([0.0, 0.3])),
        focus_rule=str(rng.choice(["centroid", "vertices"])),
        cap_resolution=bool(rng.uniform() < 0.5),
    )


def sums(network):
    return {n: v for n, v in vars(network).items() if isinstance(v, np.ndarray | list | float)}


def parts_of(judge, measured, poses):
    """Arguments scene, lens, seen and points of the loops, for a few faces at a time."""
    whole = []
    judge.share(measured, poses, lambda: lambda rows, index, scope: whole.append(scope))
    scene, lens, seen, points = whole[0]
    for first in range(0, judge.mesh.n_faces, FEW):
        part = slice(first, first + FEW)
        of_faces = {
            name: read_only(getattr(scene, name)[part].copy())
            for name in ("faces", "normals", "own", "two_sided", "offsets")
        }
        of_pairs = {
            name: read_only(getattr(seen, name)[:, part].copy())
            for name in ("visible", "drawn", "kind", "area_error")
            if getattr(seen, name).size
        }
        yield part, (scene._replace(**of_faces), lens, seen._replace(**of_pairs), points)


def one_by_one(judge, measured, poses):
    """Figures of all faces, each measured by itself."""
    shape = len(poses), judge.mesh.n_faces
    figures = {name: np.empty(shape, kind) for name, kind in FIGURES.items()}
    for part, scope in parts_of(judge, measured, poses):
        few = {n: np.empty_like(each[:, part], order="C") for n, each in figures.items()}
        judge_poses(0, len(poses), scope, judge.rules[0], figures_of(few))
        for name, each in few.items():
            figures[name][:, part] = each
    return figures


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@examples(9, at_night=400)
@given(seed=st.integers(0, 2**32 - 1))
def test_faces_in_lanes_are_judged_as_one_is(method, seed):
    rng = np.random.default_rng(seed)
    mesh = scene(rng)
    distance = float(10 ** rng.uniform(0, 1))
    poses = Poses.of(sphere_of_poses((0, 0, 0), distance, 4))
    chosen = task(rng, poses, mesh)
    result = evaluate(mesh, CAMERA, poses, chosen, method=method, by="face")
    with open_observer(mesh, CAMERA, method, threads=1) as observer:
        judge = FacePass(observer.mesh, CAMERA, observer.threads, chosen)
        measured = next(measurements(observer, poses))[-1]
        expected = one_by_one(judge, measured, poses)
        for name in FIGURES:
            np.testing.assert_array_equal(getattr(result, name), expected[name], name)
        observed = {name: np.empty_like(each) for name, each in expected.items()}
        judge.fill(observer.observe(poses), poses, observed)  # counts as areas, with their kinds
        np.testing.assert_equal(observed, expected)
        some = tuple(rng.choice(list(FIGURES), 3, replace=False))
        few = evaluate(mesh, CAMERA, poses, chosen, method=method, fields=some, by="face")
        for name in some:
            np.testing.assert_array_equal(getattr(few, name), expected[name], name)
        whole = Network(mesh, chosen)
        whole.add(result)
        for pairs in CHOICES:
            total = Network(mesh, chosen)
            (batch,) = total.judge(observer, poses, pairs=pairs)
            total.add(batch)
            np.testing.assert_equal(sums(total), sums(whole))


@pytest.mark.parametrize("skew", [0, 1, 3, 7])
def test_figures_are_the_same_in_any_place(skew):
    """Lanes begin at cache lines, wherever the arrays of the figures do."""
    mesh = shapes.torus(9, 7)
    poses = Poses.of(sphere_of_poses(mesh.bounds.mean(axis=0), 3 * np.ptp(mesh.bounds), 5))
    with open_observer(mesh, CAMERA) as observer:
        seen = observer.observe(poses)
        judge, expected = FacePass(mesh, CAMERA, 1), evaluate(mesh, CAMERA, poses, by="face")
        shape = len(poses), mesh.n_faces
        figures = {
            name: align_array((8 + shape[0] * shape[1],), kind)[skew : skew - 8].reshape(shape)
            for name, kind in FIGURES.items()
        }
        judge.fill(seen, poses, figures)
    for name, figure in figures.items():
        np.testing.assert_array_equal(figure, getattr(expected, name))
    for array in arrays_for(list(FIGURES), (1, LEAST_ALIGNED)).values():
        assert array.ctypes.data % CACHE_LINE == 0
