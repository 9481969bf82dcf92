"""Rules of rigs, lamps and highlights where the rays of some cameras are parallel."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import joined
from surface_cases import in_regions
from test_light import TASK, enough_light
from test_rules import assert_as_by_points

import rastercov as rc
from rastercov.core.area.features import deviations_of
from rastercov.core.area.stages import failures_of_rows
from rastercov.core.camera.rig import eyes_of, with_equipment
from rastercov.core.coverage.task import SEVERAL, nearness
from rastercov.reference.regions import points_on, reasons_of_points, rig_covers_points

pytestmark = [pytest.mark.native, pytest.mark.slow]

POST = rc.shapes.box((0.02, 0.03, 0.06))
BOXES = [
    rc.shapes.box((0.1, 0.1, 0.02)),
    rc.Mesh(np.add(POST.vertices, (0.02, 0, 0.03)), POST.faces),
]
SHEET = rc.Mesh(
    [(-0.03, -0.02, 0.05), (-0.01, -0.02, 0.05), (-0.01, 0.03, 0.05), (-0.03, 0.03, 0.06)],
    [(0, 1, 2), (0, 2, 3)],
)
PART = joined(*BOXES, SHEET)
SCENE = rc.Mesh(
    PART.vertices, PART.faces, [rc.Group("part"), rc.Group("leaf", is_two_sided=True)],
    np.arange(PART.n_faces) // 24,
)  # fmt: skip
LENS = rc.Camera.telecentric(
    600, 500, magnification=0.02, pixel_size=5e-6, working_distance=0.3, depth_of_field=0.15
)
POSES = rc.look_at([(0.2, 0.1, 0.3), (-0.1, -0.2, 0.25), (0.05, 0, -0.3)], (0, 0, 0.01))


def pair(*cameras, rule):
    places = np.repeat(np.eye(4)[None], len(cameras), axis=0)
    for row, place in enumerate(places):
        turn = np.radians(14 * row)
        place[:3, :3] = [
            (np.cos(turn), 0, np.sin(turn)),
            (0, 1, 0),
            (-np.sin(turn), 0, np.cos(turn)),
        ]
        place[:3, 3] = (-0.06 * row, 0, 0)
    return rc.Rig(cameras, [f"c{k}" for k in range(len(cameras))], places, rule=rule)


RULES = {
    "all": (rc.All(), 2),
    "apart by": (rc.All(min_baseline_deg=10), 2),
    "too far apart": (rc.All(max_baseline_deg=13.9), 2),
    "two of three": (rc.AtLeast(2), 3),
}


@pytest.mark.parametrize("kind", ["both", "one"])
@pytest.mark.parametrize("name", RULES)
def test_what_a_rig_with_parallel_rays_sees_together_is_as_by_points(name, kind):
    rule, n = RULES[name]
    pinhole = rc.Camera(width=600, height=500, fx=1500, fy=1500)
    rig = pair(LENS, *([LENS if kind == "both" else pinhole] * (n - 1)), rule=rule)
    regions = assert_as_by_points(SCENE, rig, POSES, rc.Task(max_incidence_deg=80), 3000)
    if kind == "both":
        assert (regions.area.sum() > 0) == (name != "too far apart")
    points, face = points_on(SCENE, 800)
    poses = rig.poses(POSES)
    ours = [reason for _, reason, _ in failures_of_rows(SCENE, rig, rc.Task(), poses, points, face)]
    truth = reasons_of_points(SCENE, rig, POSES, rc.Task(), points, face)
    rows = nearness(np.array(ours)).argmax(axis=0)
    best = np.array(ours)[rows, np.arange(len(rows))]
    of_cameras = truth < SEVERAL  # conditions are asked where all cameras see a point
    assert (best != truth)[of_cameras].sum() <= 0.02 * len(points)


@pytest.mark.parametrize("task", [{}, {"min_illuminance": 30}, {"max_highlight_deg": 25}])
def test_light_of_lamps_is_as_by_points(task):
    lamps = rc.Lamps(
        [rc.Lamp.point(intensity=5), rc.Lamp.ring(0.1, points=3, intensity=3)],
        rc.look_at([(0.2, 0.2, 0.4), (-0.2, 0.1, 0.3)], (0, 0, 0)),
    )
    thresholds = replace(TASK, **task)
    regions = rc.regions(SCENE, with_equipment(LENS, {"lamps": lamps}, SCENE), POSES, thresholds)
    points, face = points_on(SCENE, 4000)
    eyes = POSES.copy()
    eyes[:, :3, 3] = eyes_of(LENS, rc.Poses.of(POSES))
    truth = enough_light(SCENE, lamps, LENS, POSES, thresholds, points, face, eyes=eyes)
    for row, covered in enumerate(truth):
        wrong = int((in_regions(regions, row, points, face) != covered).sum())
        assert wrong <= 2 + regions.bounds()[row].sum() / SCENE.areas.sum() * len(points)
    assert truth.any()


def deviation_of(rig, pose, points, noise_px):
    """Standard deviation in the worst direction, m, by the sum of the information of each image."""
    information = np.zeros((len(points), 3, 3))
    for camera, place in zip(rig.cameras, pose @ rig.rig_from_camera, strict=True):
        away = points - place[:3, 3]
        ray = np.broadcast_to(place[:3, 2], away.shape) if camera.is_parallel else away
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        far = 1.0 if camera.is_parallel else np.linalg.norm(away, axis=1)
        across = np.eye(3) - ray[:, :, None] * ray[:, None]
        weight = (min(camera.fx, camera.fy) / (noise_px * far)) ** 2
        information += across * np.reshape(weight, (-1, 1, 1))
    return 1 / np.sqrt(np.maximum(np.linalg.eigvalsh(information)[:, 0], 1e-300))


@pytest.mark.parametrize("kind", ["both", "one"])
@pytest.mark.parametrize("share", [0.7, 1.001])
def test_the_uncertainty_of_a_pair_is_that_of_its_axes(kind, share):
    pinhole = rc.Camera(width=600, height=500, fx=1500, fy=1500)
    other, task = LENS if kind == "both" else pinhole, rc.Task(max_incidence_deg=80)
    points, face = points_on(SCENE, 3000)
    free = pair(LENS, other, rule=rc.All())
    seen = rig_covers_points(SCENE, free, POSES, task, points, face)
    every = [deviation_of(free, pose, points, 0.2) for pose in POSES]
    limit = share * np.median(np.concatenate(every)[seen.ravel()])
    rig = pair(LENS, other, rule=rc.All(max_uncertainty=limit, noise_px=0.2))
    regions = rc.regions(SCENE, rig, rig.poses(POSES), task)
    n_held = 0
    for row, deviation in enumerate(every):
        truth = seen[row] & (deviation <= limit)
        n_held += int(truth.sum())
        wrong = int((in_regions(regions, row, points, face) != truth).sum())
        assert wrong <= 2 + regions.bounds()[row].sum() / SCENE.areas.sum() * len(points)
    assert (n_held > 0) == (kind == "one" or share > 1)
    placed = rig.poses(POSES)
    ours = deviations_of(rig, placed[: len(rig)], points)
    np.testing.assert_allclose(ours, every[0], rtol=1e-6)


@pytest.mark.parametrize("kind", ["shallow", "narrow", "mixed"])
def test_advice_on_dead_zones_of_parallel_rays_holds_when_it_is_tried(kind):
    mesh = rc.shapes.torus(20, 14)
    size = mesh.diagonal
    lens = {"magnification": 0.001, "pixel_size": 600 * 1e-6 / size, "working_distance": 1.2 * size}
    width = 300 if kind == "narrow" else 600
    depth = 0.25 * size if kind == "shallow" else 2 * size
    camera = rc.Camera.telecentric(width, width, depth_of_field=depth, **lens)
    cameras = [camera, rc.Camera.from_fov(600, 500, hfov_deg=50)] if kind == "mixed" else [camera]
    middle = mesh.bounds.mean(axis=0)
    poses = rc.look_at(middle + size * np.array([(0.3, 0.2, 1), (1, 0.4, 0.3)]), middle)
    placed = rc.Poses.of(poses, camera=np.arange(2) % len(cameras))
    result = rc.evaluate(mesh, cameras, placed)
    before, n_tried = result.covered.area[0], 0
    for zone in result.summary()["dead_zones"]:
        if not zone["tried"] or "focus_distance_m" in zone["tried"]:
            continue
        n_tried += 1
        near, tried = zone["nearest"], zone["tried"]
        own = 0 if near is None else int(placed.camera[near["pose"]])
        new = rc.look_at(tried["position"], tried["looking_at"])
        both = rc.Poses.of(np.concatenate((poses, new)), camera=[*placed.camera, own])
        more = rc.evaluate(mesh, cameras, both).covered.area[0] - before
        assert more.sum() >= 0.45 * zone["area_m2"]
    assert n_tried
