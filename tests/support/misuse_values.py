"""Values that hardly any argument is meant for, and the scene of calls that are right."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import rastercov as rc
from rastercov.mesh import shapes

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


VALUES = {
    "nothing": None,
    "true": True,
    "false": False,
    "numpy true": np.bool_(True),
    "zero": 0,
    "one": 1,
    "minus one": -1,
    "half": 0.5,
    "one and a half": 1.5,
    "2^31": 2**31,
    "2^70": 2**70,
    "10^400": 10**400,
    "nan": float("nan"),
    "inf": float("inf"),
    "-inf": -float("inf"),
    "1e-9": 1e-9,
    "1e160": 1e160,
    "1e308": 1e308,
    "least": 5e-324,
    "float32": np.float32(2),
    "int8": np.int8(3),
    "numpy nan": np.float64("nan"),
    "long": np.longdouble("1e4000"),
    "complex": 1j,
    "date": np.datetime64("2020-01-01"),
    "empty text": "",
    "digit": "2",
    "two lines": "a\nb",
    "device": "/dev/zero",
    "mesh file": "part.stl",
    "bytes": b"x",
    "empty list": [],
    "empty tuple": (),
    "empty table": {},
    "table": {"a": 1},
    "set": {1},
    "object": object(),
    "hostile": Hostile(),
    "list in itself": endless(),
    "ragged": [[1, 2], [3]],
    "texts": ["a"],
    "range": range(3),
    "iterator": iter(()),
    "function": len,
    "type": int,
    "class": rc.Mesh,
    "mesh": MESH,
    "camera": CAMERA,
    "task": TASK,
    "groups": [rc.Group("a")],
    "0-d array": np.array(3),
    "no numbers": np.array([]),
    "three": np.array([1.0, 2.0, 3.0]),
    "eye": np.eye(4),
    "complex eye": np.eye(4) * 1j,
    "text eye": np.eye(4).astype(str),
    "object eye": np.eye(4).astype(object),
    "bool eye": np.eye(4, dtype=bool),
    "swapped eye": np.eye(4, dtype=">f8"),
    "masked eye": np.ma.masked_array(np.eye(4), np.eye(4) > 0),
    "nan eye": np.full((4, 4), np.nan),
    "far eye": np.eye(4) + np.array([[0, 0, 0, 1e160]] + [[0] * 4] * 3),
    "no rows": np.zeros((0, 3)),
    "no poses": np.zeros((0, 4, 4)),
    "no columns": np.zeros((3, 0)),
    "2^31 faces": np.broadcast_to(np.int8(0), (2**31, 3)),
    "2^31 poses": np.broadcast_to(np.eye(4, dtype=np.int8), (2**31, 4, 4)),
    "words": np.array(["a", "b"]),
    "memory": memoryview(b"abc"),
}
