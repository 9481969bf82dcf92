"""Audits of cameras with parallel rays: angles of axes, densities, advice that is tried."""

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.placement.reconstruction import suggest

MESH = rc.shapes.torus(16, 10)
SIZE = MESH.diagonal
LENS = {"magnification": 200 / SIZE * 5e-6, "pixel_size": 5e-6, "working_distance": 1.5 * SIZE}
CAMERA = rc.Camera.telecentric(200, 160, depth_of_field=0.8 * SIZE, **LENS)
PINHOLE = rc.Camera.from_fov(200, 160, hfov_deg=50)
POSES = rc.sphere_of_poses(MESH.bounds.mean(axis=0), 1.5 * SIZE, 12)
TASK = rc.Task(min_pixels=0.5, max_incidence_deg=70, views=2, min_angle_deg=20)


def test_figures_of_faces_are_those_of_axes_and_normals():
    audit = rc.audit(MESH, CAMERA, POSES, task=TASK, by="face")
    single = rc.Task(min_pixels=0.5, max_incidence_deg=70)
    with rc.open_observer(MESH, CAMERA, "certified") as observer:
        seen = np.concatenate(
            [each.coverage >= 0.5 for each in evaluate_batches(observer, POSES, single)]
        )
    axes, cosine = POSES[:, :3, 2], np.abs(POSES[:, :3, 2] @ MESH.normals.T)
    assert (audit.views == seen.sum(axis=0)).all()
    density = np.where(seen, CAMERA.fx * cosine, 0.0).max(axis=0)
    assert audit.best_density == pytest.approx(density, rel=1e-12)
    angle = np.degrees(np.arccos(np.clip(axes @ axes.T, -1, 1)))
    both = seen[:, None] & seen[None]
    widest = np.where(both, angle[..., None], 0.0).max(axis=(0, 1))
    assert np.degrees(audit.widest_angle) == pytest.approx(widest, abs=1e-5)
    assert (audit.covered == ((audit.views > 1) & (widest >= 20))).all()


def test_the_smallest_subset_covers_what_all_cover():
    audit = rc.audit(MESH, [CAMERA, PINHOLE], rc.Poses.of(POSES, camera=np.arange(12) % 2))
    chosen = audit.subset.chosen
    part = rc.Poses.of(POSES[chosen], camera=chosen % 2)
    again = rc.audit(MESH, [CAMERA, PINHOLE], part)
    assert again.percent(again.views > 0) == pytest.approx(audit.percent(audit.views > 0))


@pytest.mark.slow
def test_suggested_images_cover_more_of_what_is_weak():
    audit = rc.audit(MESH, CAMERA, POSES[:4], task=TASK)
    given = suggest(audit, 3)
    assert len(given.poses) == 3
    assert given.steps[-1].percent(given.steps[-1].covered) > audit.percent(audit.covered) + 5
