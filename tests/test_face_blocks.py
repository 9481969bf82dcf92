"""Faces judged eight at a time by SIMD, against the same faces one by one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov import Camera, Mesh, Task, evaluate, open_observer, sphere_of_poses
from rastercov.base.memory import CACHE_LINE, aligned_array
from rastercov.camera.pose import Poses
from rastercov.coverage import records
from rastercov.coverage.coverage import FIGURES
from rastercov.coverage.coverage_pass import CoveragePass
from rastercov.coverage.network import Network
from rastercov.coverage.pairs import CHOICES
from rastercov.coverage.task import Reason
from rastercov.kernels import face_blocks as blocks
from rastercov.mesh import shapes
from rastercov.raster.observation import BoundKind

CAMERA = Camera(width=200, height=160, fx=170, fy=150, focus_range=(0.5, 6.0))
BY_FACE = 1e-300
"""Least pixels on a square metre that every face in view has; a task with it is judged face by
face."""
KIND_OF_BOUND = {"certified": {}, "exact": {}, "sampled": {"backend": "cpu", "supersample": 2}}


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
        found = evaluate(mesh, CAMERA, poses, Task(), fields=("incidence",)).incidence
        angles = np.degrees(found[found < math.pi / 2])
        limit = float(rng.choice(angles)) if len(angles) else limit
    return Task(
        min_pixels=float(10 ** rng.uniform(-1, 3)),
        min_visibility=float(rng.choice([0.0, 0.5, 1.0])),
        max_incidence_deg=float(limit),
        min_pixel_density=float(rng.choice([0.0, 20.0, 80.0])),
        min_facing_density=float(rng.choice([0.0, 40.0, 60.0])),
        min_coverage=float(rng.choice([0.0, 0.3])),
        focus_rule=str(rng.choice(["centroid", "vertices"])),
        cap_resolution=bool(rng.uniform() < 0.5),
    )


def sums(network):
    return {n: v for n, v in vars(network).items() if isinstance(v, np.ndarray | list | float)}


@pytest.mark.slow
@pytest.mark.parametrize("method", KIND_OF_BOUND)
@examples(25, at_night=400)
@given(seed=st.integers(0, 2**32 - 1))
def test_eight_faces_are_judged_as_one_is(method, seed):
    rng = np.random.default_rng(seed)
    mesh, options = scene(rng), KIND_OF_BOUND[method]
    distance = float(10 ** rng.uniform(0, 1))
    poses = Poses.of(sphere_of_poses((0, 0, 0), distance, 4))
    once = task(rng, poses, mesh)
    one_by_one = replace(once, min_pixels_per_m2=BY_FACE)
    found, expected = (
        evaluate(mesh, CAMERA, poses, each, method=method, **options) for each in (once, one_by_one)
    )
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)
    some = tuple(rng.choice(list(FIGURES), 3, replace=False))
    few = evaluate(mesh, CAMERA, poses, once, method=method, fields=some, **options)
    for name in some:
        np.testing.assert_array_equal(getattr(few, name), getattr(expected, name), name)
    with open_observer(mesh, CAMERA, method, threads=1, **options) as observer:
        for pairs in CHOICES:
            networks, rows = [], []
            for each in (once, one_by_one):
                networks.append(Network(mesh, each))
                for batch in networks[-1].judge(observer, poses, pairs=pairs, keep=(0, 2)):
                    rows.append((batch.rows, batch.kept))
                    networks[-1].add(batch)
            whole = Network(mesh, once)
            whole.add(found)
            np.testing.assert_equal(sums(networks[0]), sums(networks[1]))
            np.testing.assert_equal(sums(networks[0]), sums(whole))
            np.testing.assert_equal(rows[0], rows[1])


def test_codes_are_those_of_the_package():
    for code in BoundKind:
        assert getattr(blocks, code.name) == code
    for code in Reason:
        assert getattr(blocks, code.name) == code


@pytest.mark.parametrize("skew", [0, 1, 3, 7])
def test_figures_are_the_same_in_any_place(skew):
    """Blocks begin at cache lines, wherever the arrays of the figures do."""
    mesh = shapes.torus(9, 7)
    poses = Poses.of(sphere_of_poses(mesh.bounds.mean(axis=0), 3 * np.ptp(mesh.bounds), 5))
    with open_observer(mesh, CAMERA) as observer:
        seen = observer.observe(poses)
        judge, expected = CoveragePass(observer, Task()), evaluate(mesh, CAMERA, poses)
        shape = len(poses), mesh.n_faces
        figures = {
            name: aligned_array((8 + shape[0] * shape[1],), kind)[skew : skew - 8].reshape(shape)
            for name, kind in FIGURES.items()
        }
        judge.fill(seen, poses, figures)
    for name, found in figures.items():
        np.testing.assert_array_equal(found, getattr(expected, name))
        assert getattr(expected, name).ctypes.data % CACHE_LINE == 0


def test_faces_in_the_image_are_judged_in_blocks(monkeypatch):
    """Otherwise this file would compare the same loop with itself."""
    mesh = shapes.torus(16, 8)
    workspaces, workspace = [], records.workspace

    def kept(*arguments):
        workspaces.append(workspace(*arguments))
        workspaces[-1].block[:] = np.nan
        return workspaces[-1]

    monkeypatch.setattr(records, "workspace", kept)
    radius = 4 * float(np.abs(mesh.bounds).max())
    poses = sphere_of_poses(mesh.bounds.mean(axis=0), radius, 1)
    for limit, is_filled in ((0.0, True), (BY_FACE, False)):
        workspaces.clear()
        evaluate(mesh, CAMERA, poses, Task(min_pixels_per_m2=limit), threads=1)
        assert np.isfinite(workspaces[0].block).all() == is_filled
