"""Attack on pictures through lenses: the face at a pixel against that of the pixel's own ray.

Random lenses (Brown, rational, tangential, fisheye) before random scenes. Rays come from Newton's
method on the equations of OpenCV, faces from a ray caster in float64; neither shares code with
rastercov. A pixel is wrong where it shows a face that is
first neither on its own ray nor on one of eight rays 4e-3 px beside it.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rows import Report

import rastercov as rc
from rastercov.core.mesh import shapes

SCENES, LENSES, PIXELS = 24, 4, 400
EDGE_PX = 4e-3
"""Distance of an edge within which a pixel may show either side."""
SHIFTS = [(x * EDGE_PX, y * EDGE_PX) for y in (-1, 0, 1) for x in (-1, 0, 1) if x or y]
Points = NDArray[np.float64]


def radial(c: NDArray[np.float64], points: Points) -> Points:
    """Images of X / Z, Y / Z by the 5 or 8 coefficients of OpenCV."""
    x, y = points.T
    r = x * x + y * y
    k = np.pad(c, (0, 8 - len(c)))
    scale = 1 + r * (k[0] + r * (k[1] + r * k[4]))
    scale = scale / (1 + r * (k[5] + r * (k[6] + r * k[7])))
    u = x * scale + 2 * k[2] * x * y + k[3] * (r + 2 * x * x)
    v = y * scale + k[2] * (r + 2 * y * y) + 2 * k[3] * x * y
    return np.column_stack((u, v))


def fisheye(c: NDArray[np.float64], points: Points) -> Points:
    """Images of angles from the axis, in two components, by the 4 coefficients of OpenCV."""
    t = (points**2).sum(axis=1, keepdims=True)
    return points * (1 + t * (c[0] + t * (c[1] + t * (c[2] + t * c[3]))))


def random_lens(rng: np.random.Generator, kind: int) -> rc.Camera:
    """Camera of a kind of lens: Brown, rational, strongly tangential, fisheye."""
    width, height = (int(4 * n) for n in rng.integers(60, 260, 2))
    focal = float(rng.uniform(0.5, 1.5)) * max(width, height)
    k = rng.normal(size=8) * (0.15, 0.05, 0.001, 0.001, 0.01, 0.05, 0.02, 0.005)
    model, distortion = "opencv", tuple(k[:5].tolist())
    if kind == 1:
        distortion = tuple(k.tolist())
    elif kind == 2:
        distortion = (*k[:2].tolist(), *rng.normal(scale=0.01, size=2).tolist())
    elif kind == 3:
        model, distortion = "opencv_fisheye", tuple((rng.normal(size=4) * 0.02).tolist())
        focal *= 0.5
    return rc.Camera(
        width=width, height=height, fx=focal, fy=focal * float(rng.uniform(0.9, 1.1)),
        cx=width * float(rng.uniform(0.4, 0.6)), cy=height * float(rng.uniform(0.4, 0.6)),
        model=model, distortion=distortion,
    )  # fmt: skip


def solved(image: Callable[[Points], Points], wanted: Points) -> Points:
    """Points whose images are wanted, by Newton's method from the axis; NaN where it fails."""
    points, step = wanted.copy(), 1e-6
    with np.errstate(all="ignore"):
        for _ in range(60):
            off = image(points) - wanted
            dx, dy = ((image(points + s) - image(points - s)) / (2 * step)
                      for s in ((step, 0), (0, step)))  # fmt: skip
            det = dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]
            move = np.column_stack((
                off[:, 0] * dy[:, 1] - off[:, 1] * dy[:, 0],
                off[:, 1] * dx[:, 0] - off[:, 0] * dx[:, 1],
            ))  # fmt: skip
            points = points - np.clip(move / det[:, None], -0.2, 0.2)
        is_right = np.abs(image(points) - wanted).max(axis=1) < 1e-11
    return np.where(is_right[:, None], points, np.nan)


def rays_of(camera: rc.Camera, pixels: Points) -> Points:
    """Rays (N, 3) in camera axes of positions in the image."""
    wanted = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    c = np.array(camera.distortion)
    if camera.model == "opencv":
        return np.column_stack((solved(lambda p: radial(c, p), wanted), np.ones(len(wanted))))
    points = solved(lambda p: fisheye(c, p), wanted)
    angle = np.linalg.norm(points, axis=1)
    return np.column_stack((points * np.sinc(angle / np.pi)[:, None], np.cos(angle)))


def first_faces(corners: Points, eye: Points, rays: Points) -> NDArray[np.int64]:
    """Face that each ray meets first, -1 for none, by the signs of three volumes."""
    a, b, c = np.moveaxis(corners - eye, 1, 0)
    sides = [np.cross(p, q) @ rays.T for p, q in ((a, b), (b, c), (c, a))]
    total = sides[0] + sides[1] + sides[2]
    is_in = np.all([side * np.sign(total) >= 0 for side in sides], axis=0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))[:, None]
    with np.errstate(all="ignore"):
        depth = volume / total
    depth[~is_in | ~(depth > 0)] = np.inf
    first = depth.argmin(axis=0)
    return np.where(np.isfinite(depth.min(axis=0)), first, -1)


def random_scene(rng: np.random.Generator, number: int) -> tuple[rc.Mesh, Points]:
    """Mesh and pose: a soup of faces of many sizes, or a shape, near or far, at any angle."""
    if number % 2:
        name = ("torus", "teapot", "box", "room")[number // 2 % 4]
        mesh = shapes.torus(40, 24) if name == "torus" else shapes.by_name(name)
    else:
        n = int(rng.integers(20, 400))
        size = 10 ** rng.uniform(-2, 0, (n, 1, 1))
        corners = rng.uniform(-1, 1, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3))
        mesh = rc.Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    low, high = mesh.bounds
    way = rng.normal(size=3)
    distance = float(np.linalg.norm(high - low)) * float(rng.uniform(0.3, 1.5))
    eye = (low + high) / 2 + way / np.linalg.norm(way) * distance
    return mesh, rc.look_at([eye], [(low + high) / 2 + rng.normal(size=3) * distance / 20])


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 24 scenes, each through 4 lenses."""
    rng = np.random.default_rng(22)
    n, shown, moved, wrong = 0, 0, 0, 0
    for number in range(max(2, round(SCENES * effort))):
        mesh, poses = random_scene(rng, number)
        corners = mesh.vertices[mesh.faces]
        for kind in range(LENSES):
            camera = random_lens(rng, kind)
            at = rng.integers(0, (camera.width, camera.height), (PIXELS, 2))
            with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
                face = rasterizer.render(poses[0]).face[at[:, 1], at[:, 0]]
            own = rays_of(camera, at + 0.5)
            known = np.isfinite(own).all(axis=1)
            at, face = at[known], face[known]
            eye, rotation = poses[0, :3, 3], poses[0, :3, :3]
            other = face != first_faces(corners, eye, own[known] @ rotation.T)
            is_near = np.zeros(other.sum(), bool)
            for shift in SHIFTS:
                beside = rays_of(camera, at[other] + 0.5 + shift) @ rotation.T
                is_near |= face[other] == first_faces(corners, eye, beside)
            n += len(at)
            shown += int((face >= 0).sum())
            moved += int(is_near.sum())
            wrong += int((~is_near).sum())
    report.add("lenses: pixels against their own rays", n, "pixels")
    report.add("lenses: pixels that show a face", shown, "pixels")
    report.add("lenses: pixels that show what a ray within 4e-3 px meets", moved, "pixels")
    report.add("lenses: wrong", wrong, "pixels", at_most=0)
