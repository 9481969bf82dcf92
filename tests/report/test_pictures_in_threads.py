"""Pictures of parts of one mesh, drawn by two threads at once."""

from weakref import WeakKeyDictionary

import numpy as np

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import shapes
from rastercov.report import images

CAMERA = Camera(width=60, height=40, fx=50, fy=50)
MESH, POSE = shapes.torus(24, 12), look_at((4, 0, 0), (0, 0, 0))
FEW, MANY = (np.arange(n, dtype=np.int32) for n in (40, 500))


class Busy(WeakKeyDictionary):
    """Parts of meshes; once one is there, another thread draws its own."""

    is_new = True

    def __setitem__(self, mesh, result):
        super().__setitem__(mesh, result)
        if self.is_new:
            self.is_new = False
            images.draw_part(mesh, CAMERA, POSE, MANY)


def test_a_part_is_drawn_whatever_another_thread_draws(monkeypatch):
    expected = images.draw_part(MESH, CAMERA, POSE, FEW).face
    monkeypatch.setattr(images, "_PARTS", Busy())
    assert np.array_equal(images.draw_part(MESH, CAMERA, POSE, FEW).face, expected)
