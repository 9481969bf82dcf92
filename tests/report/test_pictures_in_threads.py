"""Pictures of parts of one mesh, drawn by several threads at once."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import look_at
from rastercov.mesh import shapes
from rastercov.report.images import part_drawn

CAMERA = Camera(width=60, height=40, fx=50, fy=50)


def test_threads_draw_their_own_parts():
    mesh, pose = shapes.torus(24, 12), look_at((4, 0, 0), (0, 0, 0))
    parts = [np.arange(n, dtype=np.int32) for n in (40, 500)]
    expected = [part_drawn(mesh, CAMERA, pose, rows).face for rows in parts]

    def draws_alike(number):
        face = part_drawn(mesh, CAMERA, pose, parts[number % 2]).face
        return np.array_equal(face, expected[number % 2])

    with ThreadPoolExecutor(6) as pool:
        assert all(pool.map(draws_alike, range(600)))
