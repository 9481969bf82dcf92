"""Criteria of the surface itself, independent of cameras, such as its slope.

A camera covers no part of a face that fails one. A criterion is a function here, whose reason has
its words in `rastercov.coverage.reasons`, and its entry in `CRITERIA`; its threshold is a field of
`Task`. Faces, areas, points and cells, shards, plans and the viewer have it by themselves.
"""

from collections.abc import Callable, Collection
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import BoolArray
from rastercov.coverage.reasons import NAMES, Reason
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh

CRITERIA: dict[str, Callable[[Mesh, Task], BoolArray]] = {}
"""Faces that fail what a task asks, (F,), by the name of their reason. A mesh that moves is that of
the frame."""


def own_reasons(mesh: Mesh, task: Task | None = None) -> NDArray[np.uint8]:
    """(F,) row of `REASONS` of each face: `DEGENERATE`, the criterion it fails, or `COVERED`."""
    found = np.where(mesh.degenerate_mask, np.uint8(Reason.DEGENERATE), np.uint8(Reason.COVERED))
    if task is not None:
        for name, fails in CRITERIA.items():
            found[(found == Reason.COVERED) & fails(mesh, task)] = NAMES.index(name)
    return found


def key_of(mesh: Mesh, tasks: Collection[Task]) -> bytes:
    """Bytes that differ where faces fail other criteria of the surface; none where none fails."""
    plain, found = own_reasons(mesh), [own_reasons(mesh, each) for each in dict.fromkeys(tasks)]
    return b"".join(sha256(own.tobytes()).digest() for own in found if (own != plain).any())
