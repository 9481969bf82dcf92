"""Scenes and thresholds of faces that a device judges, beside what the host finds."""

import math
from dataclasses import replace

import hostile_scenes
import numpy as np

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.coverage import FIGURES
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import Criteria, area_units
from rastercov.gl import GLRasterizer

LENSES = (
    {"model": "opencv", "distortion": (-0.1, 0.02, 0.001, -0.001, 0.0)},
    {"model": "opencv_fisheye", "distortion": (0.05, -0.01, 0.0, 0.0)},
    {"model": "telecentric"},
)
DENSITIES = ("min_pixel_density", "min_facing_density", "min_pixels_per_m2")


def criteria_of(mesh, rules):
    return Criteria(rules._asdict(), ~mesh.degenerate_mask)


def figures_of(mesh, camera, rules, counts, poses, *names):
    """Figures of all pairs by the host, from counts of the CPU."""
    judge = FacePass(mesh, camera, 1)
    judge.rules = [rules]
    arrays = {name: np.empty((len(poses), mesh.n_faces), FIGURES[name]) for name in names}
    judge.fill(counts, Poses.of(poses), arrays)
    return arrays


def depths_of(mesh, poses):
    """Depths of the corners of faces, (P, F, 3), by the operations of the engine."""
    x, y, z = np.moveaxis(mesh.vertices - poses[:, None, :3, 3], -1, 0)
    axis = poses[:, :3, 2, None]
    return (x * axis[:, 0] + y * axis[:, 1] + z * axis[:, 2])[:, mesh.faces]


def random_rules(rng, mesh, camera, counts, poses):
    """Thresholds, many of them equal to the figure of some face to the last bit."""
    rules = Task().rules(camera)
    names = "drawn_pixels", "visibility", "pixel_density", "facing_density", "incidence", "coverage"
    found = figures_of(mesh, camera, rules, counts, poses, *names)
    covered = found["coverage"] > 0
    of_corners = depths_of(mesh, poses)
    found["depth"] = of_corners[covered]
    found["centre"] = ((of_corners[..., 0] + of_corners[..., 1] + of_corners[..., 2]) / 3)[covered]

    def pick(name):
        values = found[name][covered] if found[name].shape == covered.shape else found[name]
        return float(rng.choice(values.ravel())) if values.size else 1.0

    is_of_centroid = bool(rng.random() < 0.3)
    depth = "centre" if is_of_centroid else "depth"
    angle, density = min(pick("incidence"), math.pi / 2), pick("facing_density")
    near, far = sorted((pick(depth), pick(depth)))
    changes = {
        "min_pixels": pick("drawn_pixels"),
        "min_visibility": pick("visibility"),
        "min_coverage": float(rng.choice((0.0, 0.2, pick("coverage")))),
        "min_pixel_density": pick("pixel_density"),
        "min_facing_density": density,
        "min_pixels_per_m2": density**2 * rng.uniform(0.1, 1),
        "z_n": near,
        "z_f": far,
        "max_incidence": angle,
        "cap_resolution": False,
    }
    left = DENSITIES if camera.is_parallel else ()
    names = [name for name in changes if name not in left]
    chosen = rng.choice(names, rng.integers(0, 4), replace=False).tolist()
    if "max_incidence" in chosen:
        chosen += ["cos_incidence", "tan_incidence"]
        changes |= {"cos_incidence": math.cos(angle), "tan_incidence": math.tan(angle)}
    changes["focus_of_centroid"] = is_of_centroid
    return rules._replace(**{name: changes[name] for name in [*chosen, "focus_of_centroid"]})


def compare(rasterizer, poses, rules=None, rng=None):
    """Assert that a device judges as the host does; the number of covered pairs."""
    mesh, camera, poses = rasterizer.mesh, rasterizer.camera, np.asarray(poses, np.float64)
    options = {"supersample": rasterizer.supersample, "roll": rasterizer.roll}
    with open_rasterizer(mesh, camera, "cpu", threads=1, **options) as cpu:
        counts = cpu.count(poses)
    if rng is not None:
        rules = random_rules(rng, mesh, camera, counts, poses)
    rules = rules or Task().rules(camera)
    (reason,) = figures_of(mesh, camera, rules, counts, poses, "reason").values()
    criteria, covered = criteria_of(mesh, rules), reason == Reason.COVERED
    assert rasterizer._why_not_judged(criteria) == ""
    judged, clipped = rasterizer._judge(poses, criteria)
    expected = np.packbits(covered, axis=1, bitorder="little")
    np.testing.assert_array_equal(judged.packed, expected, err_msg=str(rules))
    np.testing.assert_array_equal(judged.area_units, covered @ area_units(mesh))
    np.testing.assert_array_equal(judged.views, covered.sum(axis=0))
    np.testing.assert_array_equal(clipped, counts.clipped)
    return int(covered.sum())


def scene(rng):
    """Small triangles, some in a grid, and poses around or among them."""
    n, size = int(rng.integers(20, 300)), 10.0 ** rng.uniform(-3, 3)
    corners = rng.normal(size=(n, 1, 3)) + rng.uniform(0.02, 0.4) * rng.normal(size=(n, 3, 3))
    if rng.random() < 0.3:
        corners = np.round(corners * 4) / 4
    is_closed = rng.random() < 0.2
    mesh = (
        shapes.sphere(2)
        if is_closed
        else Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    )
    mesh = Mesh(mesh.vertices * size, mesh.faces)
    if rng.random() < 0.3:
        mesh = mesh.with_groups(two_sided="all")
    width, height = (int(side) for side in rng.integers(20, 200, 2))
    focal = width * rng.uniform(0.4, 2)
    camera = Camera(
        width=width, height=height, fx=focal, fy=focal * rng.choice((1.0, rng.uniform(0.5, 2)))
    )
    eyes = rng.normal(size=(6, 3)) * size * rng.choice((0.5, 3, 6))
    poses = look_at(eyes, rng.normal(size=(6, 3)) * 0.3 * size)
    return mesh, camera, poses, int(rng.integers(1, 4))


def scene_of(rng):
    """A scene of faces among cameras or around them, with roles and copies of some of its faces."""
    make = (hostile_scenes.scene, scene)[int(rng.random() < 0.6)]
    mesh, camera, poses, supersample = make(rng)
    faces, n = mesh.faces, mesh.n_faces
    if rng.random() < 0.3:  # in one plane, from either side
        copies = faces[rng.integers(0, n, n // 2)]
        faces = np.concatenate([faces, copies[:, :: rng.choice((1, -1))]])
    groups = [
        Group("plain"),
        Group("leaf", is_two_sided=True),
        Group("wall", is_occluder=True),
        *([Group("points", is_target=True)] if rng.random() < 0.4 else []),
    ]
    mesh = Mesh(mesh.vertices, faces, groups, rng.integers(0, len(groups), len(faces)))
    kind = int(rng.integers(0, 12))
    if kind < len(LENSES):
        focal = camera.width * rng.uniform(0.5, 1.5)
        centre = {"cx": camera.width / 2, "cy": camera.height / 2}
        camera = replace(camera, fx=focal, fy=focal, **centre, **LENSES[kind])
        if kind == 2:
            scale = camera.width / mesh.diagonal
            camera = replace(camera, fx=scale, fy=scale)
    return mesh, camera, poses, supersample


def compare_all(device, rng, n_scenes):
    """`compare` on hostile scenes, with random thresholds, grids and rolls; covered pairs."""
    total = 0
    for k in range(n_scenes):
        mesh, camera, poses, supersample = (hostile_scenes.scene, scene)[k % 3 > 0](rng)
        roll = rng.choice((0.0, 0.4))
        options = {"supersample": supersample, "roll": float(roll), "plan": "compute"}
        with GLRasterizer(mesh, camera, device=device, **options) as rasterizer:
            for _ in range(3):
                total += compare(rasterizer, poses, rng=rng)
    return total
