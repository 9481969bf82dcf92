"""Random and hostile scenes on which a device is compared with the CPU: counts, images, bits.

`python scenes_of_devices.py DEVICE N SEED` compares N scenes of each kind and prints, in a line of
JSON, what it found: a process of its own can have other extensions of Mesa.
"""

import json
import sys
from dataclasses import replace
from functools import cache, partial

import coplanar_scenes
import hostile_scenes
import judged_scenes
import numpy as np

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl import GLRasterizer
from rastercov.gl.context import open_context

WIDE = 20_000
"""Samples along the long side of a large image."""
FIELDS = ("visible", "drawn", "background", "clipped")


def soup(rng, n, size=1.0):
    """Triangles of many sizes about the origin."""
    corners = rng.normal(size=(n, 1, 3)) + 10.0 ** rng.uniform(-2, 1, (n, 1, 1)) * rng.normal(
        size=(n, 3, 3)
    )
    return Mesh(corners.reshape(-1, 3) * size, np.arange(3 * n).reshape(-1, 3))


def around(rng, mesh, n=3, nearest=0.2, farthest=4.0):
    """Poses from a part of the diagonal of a mesh to several of it from its middle."""
    middle, size = mesh.bounds.mean(axis=0), mesh.diagonal
    away = rng.normal(size=(n, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    eyes = middle + size * away * 10 ** rng.uniform(*np.log10((nearest, farthest)), (n, 1))
    return look_at(eyes, middle + rng.normal(size=(n, 3)) * 0.1 * size)


def camera_of(rng, least=40, most=260):
    """Pinhole of any size, with a principal point about its middle."""
    width, height = (int(side) for side in rng.integers(least, most, 2))
    fx, fy = width * rng.uniform(0.3, 2, 2)
    cx, cy = width * rng.uniform(0.2, 0.8), height * rng.uniform(0.2, 0.8)
    return Camera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def hostile(rng):
    """Triangles of sizes from 1e-4 to 1e4 about a camera that may be among them."""
    mesh, camera, poses, supersample = hostile_scenes.scene(rng)
    return mesh, camera, poses, {"supersample": supersample}


def near_plane(rng):
    """Faces through the near plane, from within."""
    mesh = soup(rng, int(rng.integers(5, 120)))
    camera = replace(camera_of(rng), near=float(rng.uniform(0.01, 1.5)))
    eyes = rng.normal(size=(3, 3)) * 0.4
    return mesh, camera, look_at(eyes, eyes + rng.normal(size=(3, 3))), {}


def one_over_all(rng):
    """A face over the whole image, before and behind others and to both sides of the camera."""
    mesh, far = soup(rng, int(rng.integers(5, 200))), 10.0 ** rng.uniform(1, 7)
    over = rng.normal(size=(1, 3)) * 0.5 + far * rng.normal(size=(3, 3))
    points = np.concatenate((mesh.vertices, over))
    faces = np.concatenate((mesh.faces, len(points) - 3 + np.arange(3)[None]))
    mesh = Mesh(points, rng.permutation(faces))
    eyes = rng.normal(size=(3, 3)) * 2
    return mesh, camera_of(rng), look_at(eyes, rng.normal(size=(3, 3)) * 0.3), {}


@cache
def fine_torus():
    """100,000 faces."""
    return shapes.torus(316, 158)


def below_a_sample(rng):
    """100,000 faces in a few samples, and few of them in a whole image."""
    mesh = fine_torus()
    camera = camera_of(rng, 30, 80)
    return mesh, camera, around(rng, mesh, 2, 3, 30), {"roll": float(rng.choice((0.0, 0.4)))}


def copies(rng):
    """Faces of one plane that overlap, each once or twice more, turned and in any order."""
    mesh = list(coplanar_scenes.SCENES.values())[rng.integers(3)](rng)
    more = mesh.faces[rng.random(mesh.n_faces) < 0.6]
    faces = np.concatenate((mesh.faces, more, np.roll(more[:, ::-1], 1, axis=1)))
    mesh = Mesh(mesh.vertices, rng.permutation(faces))
    return mesh, coplanar_scenes.CAMERA, coplanar_scenes.views(rng, mesh, 3), {}


def two_sided(rng):
    """Faces that are covered from both sides, of an open part."""
    mesh, camera, poses, supersample = judged_scenes.scene(rng)
    return mesh.with_groups(two_sided="all"), camera, poses, {"supersample": supersample}


def rolled(rng):
    """Grids at any angle to the rows of the image."""
    mesh, camera, poses, _ = judged_scenes.scene(rng)
    return mesh, camera, poses, {"roll": float(rng.uniform(-2, 2))}


def supersampled(rng):
    """16 samples a pixel."""
    mesh, camera, poses, _ = judged_scenes.scene(rng)
    return mesh, camera, poses, {"supersample": 4, "roll": float(rng.choice((0.0, 0.4)))}


def far_away(rng):
    """Coordinates of 1e7 m and more."""
    mesh, camera, poses, _ = judged_scenes.scene(rng)
    shift = rng.normal(size=3) * 10.0 ** rng.uniform(7, 8)
    moved = poses.copy()
    moved[:, :3, 3] += shift
    return Mesh(mesh.vertices + shift, mesh.faces), camera, moved, {}


def large(rng):
    """Sides of 20,000 px."""
    mesh = soup(rng, int(rng.integers(5, 40)))
    width, height = (WIDE, int(rng.integers(1, 200)))[:: int(rng.choice((1, -1)))]
    camera = Camera(width=width, height=height, fx=WIDE * 0.6, fy=WIDE * 0.5)
    return mesh, camera, around(rng, mesh, 1), {}


def closed(rng):
    """Watertight parts, from their surface to afar: clusters of faces turn away."""
    kinds = (partial(shapes.torus, 60, 30), partial(shapes.sphere, 4), partial(shapes.box, n=12))
    mesh = kinds[rng.integers(3)]()
    stretched = mesh.vertices * 10.0 ** rng.uniform(-1, 1, 3)
    mesh = Mesh(stretched, mesh.faces)
    return (
        mesh,
        camera_of(rng),
        around(rng, mesh, 4, 0.5, 30),
        {"roll": float(rng.choice((0, 0.4)))},
    )


def parallel(rng):
    """Parallel rays, of parts and of triangles of many sizes."""
    mesh = closed(rng)[0] if rng.random() < 0.5 else soup(rng, 80)
    width, height = (int(side) for side in rng.integers(40, 260, 2))
    focal = width * 10 ** rng.uniform(-0.5, 1) / mesh.diagonal
    camera = Camera(
        width=width, height=height, fx=focal, fy=focal * rng.uniform(0.5, 2), model="telecentric",
        near=mesh.diagonal * 0.1,
    )  # fmt: skip
    return mesh, camera, around(rng, mesh), {"roll": float(rng.choice((0.0, 0.4)))}


KINDS = {
    "hostile": hostile,
    "near plane through faces": near_plane,
    "one face over all": one_over_all,
    "100,000 faces below a sample": below_a_sample,
    "coplanar copies": copies,
    "two-sided": two_sided,
    "rolled": rolled,
    "supersampled 4": supersampled,
    "coordinates of 1e7": far_away,
    "20,000 px": large,
    "watertight": closed,
    "parallel rays": parallel,
}


def huge():
    """An image of 20,000 x 20,000 px of a part."""
    camera = Camera(width=WIDE, height=WIDE, fx=WIDE * 0.6, fy=WIDE * 0.5)
    return shapes.torus(24, 12), camera, look_at((4, 2, 3), (0, 0, 0)), {}


def compare_counts(ours, poses):
    """Samples of a device in some poses, and those counts that are not the CPU's."""
    options = {"supersample": ours.supersample, "roll": ours.roll}
    with CPURasterizer(ours.mesh, ours.camera, threads=1, **options) as cpu:
        expected = cpu.count(poses)
    alone, found = ours.count(poses, drawn=False), ours.count(poses)
    wrong = int((alone.visible != expected.visible).sum())
    for name in FIELDS:
        wrong += int((getattr(found, name) != getattr(expected, name)).sum())
    return int(expected.visible.sum() + expected.background.sum()), wrong


FOUND = ("scenes", "samples", "wrong", "pairs", "covered", "wrong_bits")
"""Figures of a comparison; `wrong_bits` are scenes with a wrong bit, area or number of views."""


def compare_scene(device, kind, k, seed):
    """Findings on the k-th scene of a kind: counts, and bits by three random tasks."""
    rng = np.random.default_rng((seed, sorted(KINDS).index(kind), k))
    mesh, camera, poses, options = KINDS[kind](rng)
    found = dict.fromkeys(FOUND, 0) | {"scenes": 1}
    with GLRasterizer(mesh, camera, device=device, plan="compute", **options) as ours:
        found["samples"], found["wrong"] = compare_counts(ours, poses)
        try:
            found["covered"] = sum(judged_scenes.compare(ours, poses, rng=rng) for _ in range(3))
        except AssertionError:
            found["wrong_bits"] = 1
        found["pairs"] = 3 * len(poses) * mesh.n_faces
    return found


def compare_kind(device, kind, n, seed):
    """Findings on n scenes of a kind."""
    each = [compare_scene(device, kind, k, seed) for k in range(n)]
    return {name: sum(one[name] for one in each) for name in FOUND}


def main(label, n, seed):
    with open_context(label) as device:
        found = {kind: compare_kind(device, kind, n, seed) for kind in KINDS}
        atomics = 64 if device.info.has_int64_atomics else 32
    print(json.dumps({"atomics": atomics, "found": found}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
