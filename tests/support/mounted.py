"""Cameras with errors of mounting in hostile scenes, and draws that try to break their bounds."""

from dataclasses import replace

import numpy as np
from surface_cases import hostile_scene

import rastercov as rc
from rastercov.core.area import polygons
from rastercov.core.area.table import join, take_rows
from rastercov.tolerances.installation import displace
from rastercov.tolerances.passes import TolerancePass

DRAWS = 24
SLACK_REL = 1e-9
"""Of the square of the diagonal: area that unions of a face may lose in slivers."""


def errors_of(rng, reach):
    """(3,) errors of a camera at a distance: metres, radians, share of the focal length."""
    d, a = reach * 10 ** rng.uniform(-4.5, -1.5), np.radians(10 ** rng.uniform(-2, 0.3))
    return np.array([d * (rng.random() < 0.9), a * (rng.random() < 0.9), rng.choice([0, 0, 0.02])])


def aligned_boxes(rng):
    """Boxes and fins on a plate, seen from above, some sides nearly along the rays."""
    plate = rc.Mesh([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(0, 1, 2), (0, 2, 3)])
    eye, parts = rng.uniform([-1, -1, 1.5], [1, 1, 3]), [plate]
    for _ in range(4):
        size = rng.uniform(0.02, 0.6, 3) * (1, rng.choice([1, 0.02]), 1)
        low = eye[:2] + size[:2] * rng.choice([-1.5, -0.5, 0.5], 2) + rng.normal(0, 0.02, 2)
        parts.append(rc.shapes.box(size, centre=(*low, size[2] / 2)))
    mesh = rc.Mesh.joined(parts, ["plate", "a", "b", "c", "d"])
    pose = rc.look_at(eye, (*eye[:2] + rng.normal(0, 0.3, 2), 0), up=(0, 1, 0))[0]
    return mesh, rc.Camera(width=640, height=480, fx=400, fy=400), pose


def case_of(seed):
    """Mesh, camera, pose (1,), task and errors (1, 3) of a hostile scene."""
    rng = np.random.default_rng(seed)
    mesh, camera, pose = aligned_boxes(rng) if seed % 3 == 0 else hostile_scene(seed // 3)
    if rng.random() < 0.4:
        mesh = mesh.with_groups(two_sided="all")
    corners = (mesh.vertices[mesh.faces].reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]
    ahead = corners[corners[:, 2] > 0, 2]
    depth = float(np.median(ahead)) if len(ahead) else 1.0
    if rng.random() < 0.3:
        camera = replace(camera, focus_range=tuple(depth * rng.uniform([0.2, 1.0], [0.9, 4.0])))
    dense = camera.fx / depth
    task = rc.Task(
        max_incidence_deg=float(rng.choice([90, 75, 50])),
        min_facing_density=float(rng.choice([0, 0, 0.8 * dense])),
        min_pixels_per_m2=float(rng.choice([0, 0, 0.3 * dense**2])),
        min_pixel_density=float(rng.choice([0, 0, 0.5 * dense])),
    )
    reach = min(depth, mesh.diagonal)
    return mesh, camera, rc.Poses.of(pose[None]), task, errors_of(rng, reach)[None]


LENSES = (
    {"model": "opencv", "distortion": (-0.28, 0.09, 1e-3, -5e-4, -0.01)},
    {"model": "opencv_fisheye", "distortion": (0.02, -0.01, 0.0, 0.0)},
)


def lens_case_of(seed):
    """As `case_of`, through a lens, so near that the border of the image cuts the scene."""
    mesh, camera, poses, task, sizes = case_of(seed)
    lens = rc.Camera(width=640, height=480, fx=420, fy=420, **LENSES[seed % 2])
    if seed % 2 == 0 and camera.focus_range is not None:
        lens = replace(lens, focus_range=camera.focus_range)
    task = rc.Task(max_incidence_deg=task.max_incidence_deg)
    return mesh, lens, poses, task, sizes * (1, 1, seed % 5 == 0)


def drawn(camera, poses, size, rng, n=DRAWS):
    """n cameras and poses within the errors, every other one at the greatest."""
    matrix, vectors = np.tile(poses.world_from_camera[0], (n, 1, 1)), []
    for dims, most in zip((3, 3, 1), size, strict=True):
        each = rng.normal(size=(n, dims))
        radius = np.where(np.arange(n) % 2, 1.0, rng.random(n))[:, None]
        vectors.append(most * radius * each / np.linalg.norm(each, axis=1, keepdims=True))
    scale = 1 + vectors[2][:, 0]
    cameras = [replace(camera, fx=camera.fx * s, fy=camera.fy * s) for s in scale.tolist()]
    return cameras, rc.Poses.of(displace(matrix, *vectors[:2]), camera=np.arange(n))


def beyond(one, others):
    """(P, F) area of the regions of one pose outside those of each of P others, m^2."""
    n, mesh = len(others.pose_ids), one.mesh
    rows = np.concatenate([[0], np.arange(n) + 1])
    pairs = np.stack([np.zeros(n, np.int64), rows[1:]], axis=1).ravel()
    both = take_rows(join([one, others]), pairs).by_devices(np.repeat(np.arange(n), 2))
    areas = polygons.polygon_areas(both.xy, both.starts)
    alone, result = both.devices == 1, np.zeros((n, mesh.n_faces))
    np.add.at(result, (both.pose[alone], both.face[alone]), areas[alone])
    return result


def violations(seed, draws=DRAWS):
    """Area of each face that a draw loses of what is sure, or has beyond what is possible, m^2.

    Beyond all bounds; and what the engine says of the pose.
    """
    return violations_of(*case_of(seed), seed, draws)


def violations_of(mesh, camera, poses, task, sizes, seed=0, draws=DRAWS):
    """The same of a mesh, camera, pose, task and errors."""
    finder = TolerancePass(mesh, camera, task, threads=1)
    nominal = finder.nominal.find(poses)
    sure = finder.sure(poses, sizes, nominal)
    possible = finder.possible(poses, sizes, sure.nearest)
    finder.close()
    cameras, moved = drawn(camera, poses, sizes[0], np.random.default_rng(seed + 1), draws)
    regions = rc.regions(mesh, cameras, moved, task, threads=1)
    allowed = regions.bounds() + SLACK_REL * mesh.diagonal**2
    lost = beyond(sure.regions, regions) - allowed
    lost -= dense(sure.regions.pair_face, sure.regions.excess, mesh)
    more = np.stack(
        [beyond(take_rows(regions, np.array([k])), possible.regions)[0] for k in range(draws)]
    )
    more -= allowed + dense(possible.regions.pair_face, possible.regions.bound, mesh)
    return lost.max(), more.max(), sure.figures[0]


def dense(face, values, mesh):
    """(F,) values of pairs of one pose."""
    full = np.zeros(mesh.n_faces)
    full[face] = values
    return full
