"""Hostile scenes for the CPU rasteriser, and what its counts and images of them must satisfy."""

import numpy as np

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh
from rastercov.core.raster.cpu import CPURasterizer


def check_scenes(n_scenes, is_rolled):
    """Count and draw hostile scenes; counts, images and the sums of both agree."""
    rng = np.random.default_rng(int(is_rolled))
    for _ in range(n_scenes):
        mesh, camera, poses, scale = scene(rng)
        roll = rng.uniform(-2, 2) if is_rolled else 0.0
        with CPURasterizer(mesh, camera, threads=1, supersample=scale, roll=roll) as rasterizer:
            both, alone = rasterizer.count(poses), rasterizer.count(poses, drawn=False)
            image = rasterizer.render(poses[0])
        assert np.array_equal(both.visible, alone.visible)
        assert (both.visible >= 0).all()
        assert (both.visible <= both.drawn).all()
        assert (both.background >= 0).all()
        assert np.array_equal(np.isinf(image.depth), image.face < 0)
        if scale == 1 and not is_rolled:
            owned = np.bincount(image.face.ravel() + 1, minlength=mesh.n_faces + 1)[1:]
            assert np.array_equal(owned, both.visible[0])


def scene(rng):
    """Triangles of any size about a camera that may be among them, and views from both ends."""
    n, size = int(rng.integers(1, 30)), 10.0 ** rng.uniform(-6, 6)
    points = rng.normal(size=(3 * n, 3)) * size * 10.0 ** rng.uniform(-4, 4, (3 * n, 1))
    if rng.random() < 0.3:
        points = np.round(points / size * 4) / 4 * size  # coincident, aligned, degenerate
    if rng.random() < 0.2:
        points[rng.integers(3 * n)] = 0
    mesh = Mesh(vertices=points, faces=np.arange(3 * n).reshape(n, 3))
    width, height = (int(side) for side in rng.integers(1, 300, 2))
    camera = Camera(
        width=width,
        height=height,
        fx=10.0 ** rng.uniform(-2, 5),
        fy=10.0 ** rng.uniform(-2, 5),
        cx=width * rng.uniform(-3, 4),
        cy=height * rng.uniform(-3, 4),
        near=float(rng.choice((0, size * 10.0 ** rng.uniform(-3, 1)))),
    )
    here, there = rng.normal(size=(2, 3)) * size * ((rng.choice((0, 0.1, 1, 30)),), (1,))
    return mesh, camera, look_at((here, there), (there, here)), int(rng.integers(1, 4))
