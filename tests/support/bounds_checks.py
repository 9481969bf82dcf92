"""Hostile scenes for the loops of exact/ and mesh/; run with numba's bounds checks."""

import numpy as np
from exact_cases import hostile
from exact_views import PATHS, look

from rastercov.mesh.contacts import touching_faces

SCENES = 100


def look_at_scenes():
    """Look in both ways; sizes of scratch memory start as small as they can."""
    for seed in range(SCENES):
        case = hostile(seed)
        one, other = (look(case.mesh, case.camera, case.pose, path) for path in PATHS)
        assert np.allclose(one.visible, other.visible, rtol=0, atol=1e-9), case


def find_contacts():
    rng = np.random.default_rng(0)
    for n in [1, 2, 3, 4, 5, 8, 9, 31, 32, 33, 500, *rng.integers(1, 70, 200)]:
        points = rng.normal(size=(3 * n, 3)) * 10.0 ** rng.uniform(-9, 9, (3 * n, 1))
        if rng.random() < 0.5:
            points = rng.integers(0, 3, (3 * n, 3)) * 1.0
        faces = rng.integers(0, 3 * n, (n, 3))
        for tolerance in (0, 1e-3, np.inf):
            assert touching_faces(points, faces, tolerance).sum() != 1


if __name__ == "__main__":
    find_contacts()
    look_at_scenes()
