"""Ray tracers: visible shares of faces by random points, and face-index images.

Shares: points spread evenly over a face, by chance, and a ray from each to the eye, in Mitsuba 3
(which needs the library of LLVM), Open3D and Embree (by embreex); ours is `rc.regions`. The bound
of a share is six standard deviations of the sampling. Rays in float32 leave out both their ends, so
that small faces and creases look more visible; rays in float64 judge where shares differ. Images:
the face at the centre of each pixel, of our rasteriser and of a tracer; `same_faces` says which
differences rounding explains.
"""

import ctypes.util
import os
from collections.abc import Callable
from functools import partial

import numpy as np
from attack_exact import assembly, crossing_solids, fine_room, fine_solids, room, solid
from attack_lenses import first_faces
from compared import Compared, Comparison, amount
from numpy.typing import NDArray
from peers import Embreex, Open3D
from same_faces import wrong_pixels

import rastercov as rc
from rastercov.core.mesh import shapes

Points = NDArray[np.float64]
Visible = Callable[[Points, Points], NDArray[np.bool_]]
"""Function of points (N, 3) and an eye: true where nothing is between them."""

SCENES, FACES, SAMPLES = 20, 5, 100_000
IMAGES = 10
JUDGED = 40_000
"""Rays in float64 for a face whose shares differ."""
DEVIATIONS = 6
NEAR_REL = 2e-5
SHORTENED = 1e-4
"""Parts of a ray next to its point and next to its eye that hit nothing."""
KINDS = (solid, room, crossing_solids, fine_room, assembly, fine_solids)
CAMERA = rc.Camera.from_fov(640, 512, hfov_deg=70)


def scene(seed: int) -> tuple[rc.Mesh, NDArray[np.float64]]:
    """Mesh and pose of a seed: outside of it, or in it for rooms."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    mesh = shapes.by_name("teapot") if seed % 10 == 9 else kind(rng)
    middle, size = mesh.bounds.mean(axis=0), np.ptp(mesh.bounds, axis=0)
    away = rng.normal(size=3)
    distance = 0.15 if kind in (room, fine_room) and seed % 10 != 9 else 1.3
    eye = middle + away / np.linalg.norm(away) * distance * np.linalg.norm(size)
    return mesh, rc.look_at(eye, middle + 0.05 * size * rng.normal(size=3))


def shares(
    open_tracer: Callable[[rc.Mesh], Visible], effort: float, most: int = SAMPLES
) -> list[Compared]:
    """Visible shares of partly visible faces, by random points."""
    samples = amount(most, effort, 10_000)
    compared = Compared(f"shares, {samples:,} points", "")
    for seed in range(amount(SCENES, effort, 4)):
        mesh, poses = scene(seed)
        is_visible = open_tracer(mesh)
        seen = rc.regions(mesh, CAMERA, poses)
        rng = np.random.default_rng(seed)
        share = seen.areas()[0] / np.maximum(mesh.areas, 1e-300)
        towards = poses[0, :3, 3] - mesh.vertices[mesh.faces[:, 0]]
        order = rng.permutation(np.flatnonzero((mesh.normals * towards).sum(axis=1) > 0))
        partly = (share[order] > 0.01) & (share[order] < 0.99)
        for face in np.concatenate((order[partly], order[~partly]))[:FACES]:
            points = spread(mesh.vertices[mesh.faces[face]], samples, rng)
            inside = in_image(points, poses[0])
            if inside.any():
                inside[inside] = is_visible(points[inside], poses[0, :3, 3])
            theirs, bound = inside.mean(), seen.bounds()[0, face] / mesh.areas[face]
            if compared.add(share[face], theirs, bound + sampling(theirs, samples) + NEAR_REL):
                judge = in_float64(mesh, int(face), poses[0], rng)
                if abs(share[face] - judge) <= bound + sampling(judge, JUDGED):
                    compared.explain("ours (float64 rays)", 1)
                else:
                    compared.faults.append(f"scene {seed}, face {face}: {share[face]}, {theirs}")
    return [compared]


def sampling(share: float, count: int) -> float:
    """Bound of a share by points."""
    return float(DEVIATIONS * np.sqrt((share * (1 - share) + 1 / count) / count))


def in_float64(mesh: rc.Mesh, face: int, pose: Points, rng: np.random.Generator) -> float:
    """Visible share of a face by fewer rays, which end at their points and not before."""
    corners, eye, seen = mesh.vertices[mesh.faces], pose[:3, 3], 0
    for _ in range(JUDGED // 2000):
        points = spread(corners[face], 2000, rng)
        first = first_faces(corners, eye, points - eye)
        seen += int(((first == face) & in_image(points, pose)).sum())
    return seen / JUDGED


def spread(corners: Points, count: int, rng: np.random.Generator) -> Points:
    """Points spread evenly over a triangle, by chance."""
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    return np.column_stack((1 - u, u * (1 - v), u * v)) @ corners


def in_image(points: Points, pose: Points) -> NDArray[np.bool_]:
    x, y, z = ((points - pose[:3, 3]) @ pose[:3, :3]).T
    with np.errstate(all="ignore"):
        u, v = CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy
    return (z > 0) & (u > 0) & (u < CAMERA.width) & (v > 0) & (v < CAMERA.height)


def mitsuba(mesh: rc.Mesh) -> Visible:
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        os.environ["DRJIT_LIBLLVM_PATH"] = llvm() or ""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    middle = mesh.bounds.mean(axis=0)  # where float32 is finest
    shape = mi.Mesh("mesh", mesh.n_vertices, mesh.n_faces)
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = mi.Float((mesh.vertices - middle).astype(np.float32).ravel())
    parameters["faces"] = mi.UInt32(mesh.faces.astype(np.uint32).ravel())
    parameters.update()
    world = mi.load_dict({"type": "scene", "mesh": shape})

    def is_visible(points: Points, eye: Points) -> NDArray[np.bool_]:
        origins, rays = shortened(points - middle, eye - middle)
        ray = mi.Ray3f(mi.Point3f(origins.T), mi.Vector3f(rays.T))
        ray.maxt = mi.Float(1.0)
        return ~np.array(world.ray_test(ray))

    return is_visible


def llvm() -> str | None:
    """Name of the library of LLVM."""
    names = (ctypes.util.find_library(f"LLVM-{version}") for version in range(21, 10, -1))
    return next(filter(None, names), None)


def open3d(mesh: rc.Mesh) -> Visible:
    import open3d as o3d

    middle = mesh.bounds.mean(axis=0)
    world = o3d.t.geometry.RaycastingScene(nthreads=1)
    world.add_triangles(
        o3d.core.Tensor((mesh.vertices - middle).astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )

    def is_visible(points: Points, eye: Points) -> NDArray[np.bool_]:
        rays = np.hstack(shortened(points - middle, eye - middle))
        return ~world.test_occlusions(o3d.core.Tensor(rays), 0.0, 1.0).numpy()

    return is_visible


def embree(mesh: rc.Mesh) -> Visible:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    middle = mesh.bounds.mean(axis=0)
    world = EmbreeScene()
    TriangleMesh(world, (mesh.vertices - middle).astype(np.float32), mesh.faces.astype(np.int32))

    def is_visible(points: Points, eye: Points) -> NDArray[np.bool_]:
        origins, rays = shortened(points - middle, eye - middle)
        run_result = world.run(origins, rays, dists=np.ones(len(rays), np.float32))
        return run_result < 0

    return is_visible


def shortened(points: Points, eye: Points) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Origins and vectors of rays from points to an eye, without both ends."""
    rays = eye - points
    return (points + SHORTENED * rays).astype(np.float32), ((1 - 2 * SHORTENED) * rays).astype(
        np.float32
    )


def images(open_tracer: Callable[..., Open3D | Embreex], effort: float) -> list[Compared]:
    """Faces at pixel centres."""
    compared = Compared("face per pixel", "", largest=np.nan)
    for seed in range(amount(IMAGES, effort)):
        mesh, poses = scene(seed)
        with rc.open_rasterizer(mesh, CAMERA, "cpu", threads=1) as rasterizer:
            ours = rasterizer.render(poses[0]).face
        theirs = open_tracer(mesh, CAMERA, poses).faces(0)
        differ, wrong = wrong_pixels(mesh, CAMERA, poses[0], ours, theirs)
        compared.figures += ours.size
        compared.beyond += differ
        compared.explain("pixels at an edge or of equal depth", differ - wrong)
        if wrong:
            compared.faults.append(f"scene {seed}: {wrong} pixels")
    return [compared]


def of_open3d(effort: float) -> list[Compared]:
    return shares(open3d, effort) + images(partial(Open3D, threads=1), effort)


def of_embree(effort: float) -> list[Compared]:
    return shares(embree, effort) + images(Embreex, effort)


COMPARISONS = [
    Comparison("Mitsuba", "mitsuba", partial(shares, mitsuba, most=1_000_000)),
    Comparison("Open3D", "open3d", of_open3d),
    Comparison("Embree", "embreex", of_embree),
]
