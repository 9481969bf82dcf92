"""Figures of faces seen by parallel rays, and what `evaluate` finds with them."""

import numpy as np
import pytest
from nightly import amount

import rastercov as rc
from rastercov.core.area.stages import first_failures
from rastercov.core.coverage.network import Network
from rastercov.reference.regions import reasons_in_poses

pytestmark = pytest.mark.native

MESH = rc.shapes.torus(20, 12)
SIZE = float(np.linalg.norm(np.ptp(MESH.bounds, axis=0)))
CAMERA = rc.Camera(
    width=300,
    height=280,
    model="telecentric",
    fx=270 / SIZE,
    fy=330 / SIZE,
    cx=120,
    near=SIZE * 0.9,
)
POSES = rc.look_at(SIZE * np.array([(1, 0.2, 0.1), (0.3, -0.8, 0.6), (0, 0, -1)]), (0, 0, 0))


def test_figures_of_faces_follow_from_the_axis():
    result = rc.evaluate(
        MESH, CAMERA, POSES, rc.Task(min_pixel_density=1, min_facing_density=1), by="face"
    )
    with rc.open_observer(MESH, CAMERA, "exact") as observer:
        seen = observer.observe(POSES)
    axes, normals = POSES[:, :3, 2], MESH.normals
    cosine = -axes @ normals.T
    local = np.einsum("pvi,pij->pvj", MESH.vertices - POSES[:, None, :3, 3], POSES[:, :3, :3])
    u, v = CAMERA.fx * local[..., 0] + CAMERA.cx, CAMERA.fy * local[..., 1] + CAMERA.cy
    is_in = (u >= 0) & (u <= 300) & (v >= 0) & (v <= 280) & (local[..., 2] >= CAMERA.near)
    is_in = is_in[:, MESH.faces].all(axis=2)
    assert (result.in_view == is_in).all()
    assert np.abs(result.incidence - np.arccos(cosine)).max() <= 1e-7
    assert (result.in_view_fraction[is_in] == 1).all()
    flat = CAMERA.fx * CAMERA.fy * np.abs(cosine) * MESH.areas
    assert result.projected_area[is_in] == pytest.approx(flat[is_in], rel=1e-12)
    shares = result.in_view_fraction * result.projected_area
    assert shares == pytest.approx(seen.drawn_pixels, abs=1e-7)
    is_front = is_in & (cosine > 0)
    assert (result.facing_density[is_in] == CAMERA.fx).all()
    plane = np.eye(3) - normals[:, :, None] * normals[:, None]
    for row in range(len(POSES)):
        J = np.diag((CAMERA.fx, CAMERA.fy, 0)) @ POSES[row, :3, :3].T @ plane
        least = np.linalg.svd(J, compute_uv=False)[:, 1]
        own = is_front[row]
        assert result.pixel_density[row, own] == pytest.approx(least[own], rel=1e-9)
    share = seen.visible_pixels / np.maximum(seen.drawn_pixels, 1e-300)
    assert result.visibility[is_front] == pytest.approx(share[is_front], abs=1e-9)
    assert (result.visibility_bound[is_front] <= 1e-6).all()
    assert (result.reason[cosine < -1e-9] == rc.Reason.BACK_FACING).all()


def test_the_uncovered_area_has_the_reasons_of_its_points():
    task = rc.Task(max_incidence_deg=65)
    result = rc.evaluate(MESH, CAMERA, POSES[:1], task)
    rng = np.random.default_rng(1)
    face = rng.integers(MESH.n_faces, size=amount(600, 6000))
    weights = rng.dirichlet((1, 1, 1), len(face))
    points = np.einsum("nk,nki->ni", weights, MESH.vertices[MESH.faces[face]])
    truth = reasons_in_poses(MESH, CAMERA, POSES[:1], task, points, face)[0]
    ours, _ = next(first_failures(MESH, CAMERA, task, POSES[:1], points, face))
    assert (ours != truth).mean() <= 0.005
    shares = {zone["reason"]: 0.0 for zone in result.summary()["dead_zones"]}
    for zone in result.summary()["dead_zones"]:
        shares[zone["reason"]] += zone["area_m2"] / MESH.areas.sum()
    for reason in ("back_facing", "outside", "occluded", "too_oblique"):
        expected = (truth == rc.Reason[reason.upper()]).mean()
        assert shares.get(reason, 0.0) == pytest.approx(expected, abs=0.08)


def test_two_views_count_by_the_angle_between_their_axes():
    camera = rc.Camera.orthographic(300, 300, px_per_m=200 / SIZE)
    turned = [(np.sin(a), 0, np.cos(a)) for a in np.radians((0, 20))]
    poses = rc.look_at(SIZE * np.array(turned), (0, 0, 0))
    shares = []
    for degrees in (0.0, 19.99, 20.01):
        task = rc.Task(views=2, min_angle_deg=degrees)
        shares.append(rc.evaluate(MESH, camera, poses, task, by="area").covered.share(2))
        by_face = rc.evaluate(MESH, camera, poses, task, by="face").network
        assert (by_face.covered.any()) == (degrees < 20)
    assert shares[0] > 0.3
    assert shares[1] == pytest.approx(shares[0])
    assert shares[2] == 0


@pytest.mark.parametrize("distortion", [{}, {"pixel_size": 1e-3, "distortion": (0.05, 0.02)}])
def test_sums_of_poses_are_those_of_their_figures_wherever_the_centre_is(distortion):
    # Parallel rays see the front of faces that the camera centre is behind.
    rng, n_behind = np.random.default_rng(7), 0
    for _ in range(amount(3, 30)):
        corners = rng.normal(size=(40, 1, 3)) + 0.2 * rng.normal(size=(40, 3, 3))
        mesh = rc.Mesh(corners.reshape(-1, 3), np.arange(120).reshape(-1, 3))
        camera = rc.Camera(
            width=200, height=180, model="telecentric", fx=30, fy=30, near=0.1,
            **distortion,
        )  # fmt: skip
        poses = rc.look_at(4 * rng.normal(size=(4, 3)), rng.normal(size=(4, 3)))
        result = rc.evaluate(mesh, camera, poses, method="sampled", by="face")
        network = Network(mesh, rc.Task())
        with rc.open_observer(mesh, camera, "sampled") as observer:
            for batch in network.judge(observer, rc.Poses.of(poses)):
                network.add(batch)
        assert (network.views == (result.reason == rc.Reason.COVERED).sum(axis=0)).all()
        assert (network.reason == result.network.reason).all()
        ways = poses[:, None, :3, 3] - mesh.vertices[mesh.faces[:, 0]]
        is_behind = np.einsum("pfi,fi->pf", ways, mesh.normals) < -1e-6
        n_behind += (is_behind & (result.reason == rc.Reason.COVERED)).sum()
    assert n_behind > 0
