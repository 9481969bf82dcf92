"""A criterion of the surface itself takes its faces from every result, and changes nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.core.area.advice import general_advice
from rastercov.core.coverage import task as surface
from rastercov.core.coverage.task import NAMES, Reason

NAME = "uncertain"
"""Reason of the criterion, of those that have words."""
CAMERA = rc.Camera(width=120, height=90, fx=90, fy=90)
OTHER = rc.Camera(width=90, height=120, fx=60, fy=60, model="opencv", distortion=(-0.1, 0, 0, 0))


@pytest.fixture
def asked():
    """Adds a criterion, and takes it away again."""
    with pytest.MonkeyPatch.context() as patch:
        yield lambda fails: patch.setitem(surface.OWN_CRITERIA, NAME, fails)


def scene_of(seed):
    rng = np.random.default_rng(seed)
    mesh = rc.shapes.by_name(rng.choice(["teapot", "torus", "aeroplane"]))
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.2 * mesh.diagonal, 3)
    fails = rng.random(mesh.n_faces) < rng.choice([0.0, 0.3, 1.0])
    rig = rc.Rig([CAMERA, OTHER])
    return mesh, rig, rc.Poses.of(poses, camera=rng.integers(0, 2, len(poses))), fails


@examples(13, at_night=100)
@given(st.integers(0, 2**32 - 1))
def test_what_fails_is_covered_by_nothing_and_all_else_is_as_before(seed):
    mesh, rig, poses, fails = scene_of(seed)
    before = rc.evaluate(mesh, rig, poses, by="face")
    regions = rc.regions(mesh, rig, poses).areas()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(surface.OWN_CRITERIA, NAME, lambda task, mesh: fails)
        after = rc.evaluate(mesh, rig, poses, by="face")
        assert np.array_equal(rc.regions(mesh, rig, poses).areas(), np.where(fails, 0, regions))
        area = rc.evaluate(mesh, rig, poses, by="area", fields=()).areas.covered
        assert np.array_equal(after.coverage, np.where(fails, 0, before.coverage))
        is_seen = fails & (before.reason == Reason.COVERED)
        assert np.array_equal(after.reason, np.where(is_seen, NAMES.index(NAME), before.reason))
    assert not area.area[0][fails].any()
    assert not after.network.covered[fails].any()
    for name in ("visibility", "visibility_bound", "drawn_pixels", "incidence"):
        assert getattr(after, name).tobytes() == getattr(before, name).tobytes()


def test_a_threshold_of_one_camera_alone_fails_for_it_and_for_its_rig(asked):
    mesh = rc.Mesh([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], [(0, 1, 2)])
    pose = rc.look_at((0.2, 0.3, 4), (0, 0, 0))
    asked(lambda task, mesh: np.full(mesh.n_faces, task.max_incidence_deg < 90))
    own = {"camera 1": rc.Task(max_incidence_deg=80)}
    for rule, covers in ((rc.Any(), True), (rc.All(), False)):
        rig = rc.Rig([CAMERA, CAMERA], rule=rule, tasks=own)
        result = rc.evaluate(mesh, rig, rig.poses(pose), by="area")
        assert (result.areas.summary()["m2"] > 0) == covers
        zones = [(each["reason"], each["advice"]) for each in result.summary()["dead_zones"]]
        assert zones == ([] if covers else [(NAME, general_advice(NAME))])
