"""Values that hardly any argument is meant for, and the scene of calls that are right."""

import tempfile
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

import rastercov as rc
from rastercov.core.mesh import shapes

MESH = shapes.box((1, 1, 1))
CAMERA = rc.Camera(width=32, height=24, fx=30, fy=30)
POSES = rc.look_at([(0, 0.2, 3), (3, 0.1, 0)], (0, 0, 0))
TASK = rc.Task()
PLAN = {
    "meshes": [{"built_in": "box"}],
    "camera": {"width": 32, "height": 24, "fx": 30, "fy": 30},
    "task": {"resolution_of_result": 1.0},
    "candidates": [{"generator": "on_sphere", "count": 2}],
    "selection": {"goal": "best_coverage", "cameras": 1},
}
FOLDER = Path(tempfile.mkdtemp(prefix="rastercov-misuse-"))


class Hostile:
    """An object whose every operation fails, and whose name has two lines."""

    def __repr__(self):
        return "hostile\nobject"

    def __float__(self):
        raise RuntimeError("no number")

    def __array__(self, *_, **__):
        raise RuntimeError("no array")


def endless():
    """A list that contains itself."""
    values: list[Any] = []
    values.append(values)
    return values


EYE = np.eye(4)
TRUTHS = (None, True, False, np.bool_(True))
WHOLE = (0, 1, -1, 2**31, 2**70, 10**400)
REAL = (0.5, 1.5, 1e-9, 1e160, 1e308, 5e-324, float("nan"), float("inf"), -float("inf"))
OF_NUMPY = (np.float32(2), np.int8(3), np.float64("nan"), np.longdouble("1e4000"))
OTHERS = (1j, np.datetime64("2020-01-01"), object(), Hostile(), len, int, rc.Mesh)
TEXTS = ("", "2", "a\nb", "a\0b", "/dev/zero", "part.stl", b"x", memoryview(b"abc"))
ROWS = ([], (), {}, {"a": 1}, {1}, ["a"], endless(), [[1, 2], [3]], range(3), iter(()))
OBJECTS = (MESH, CAMERA, TASK, [rc.Group("a")])
ARRAYS = (np.array(3), np.array([]), np.array([1.0, 2.0, 3.0]), np.array(["a", "b"]))
EYES = (EYE, EYE * 1j, *(EYE.astype(kind) for kind in (str, object, bool, ">f8")))
OTHER_EYES = (
    np.ma.masked_array(EYE, EYE > 0),
    np.full((4, 4), np.nan),
    EYE + np.array([[0, 0, 0, 1e160]] + [[0] * 4] * 3),
)
NOTHING = (np.zeros((0, 3)), np.zeros((0, 4, 4)), np.zeros((3, 0)))
TOO_MANY = (
    np.broadcast_to(np.int8(0), (2**31, 3)),
    np.broadcast_to(np.eye(4, dtype=np.int8), (2**31, 4, 4)),
)
GROUPS = (TRUTHS, WHOLE, REAL, OF_NUMPY, OTHERS, TEXTS, ROWS, OBJECTS, ARRAYS, EYES, OTHER_EYES)
VALUES = {
    f"{number}: {type(value).__name__}": value
    for number, value in enumerate(chain(*GROUPS, NOTHING, TOO_MANY))
}
"""By their number and their type."""
