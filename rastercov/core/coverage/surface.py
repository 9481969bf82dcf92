"""Faces that fail criteria of the surface itself, see `rastercov.core.coverage.criterion`."""

from collections.abc import Collection
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from rastercov.core.coverage.reasons import NAMES, Reason
from rastercov.core.coverage.task import CRITERIA_OF_TASK, Task
from rastercov.core.mesh import Mesh

CRITERIA = {name: each._fails for each in CRITERIA_OF_TASK for name in each._wording.reasons}
"""Functions of a task and a mesh for the faces that fail, by the name of their reason."""


def own_reasons(mesh: Mesh, task: Task | None = None) -> NDArray[np.uint8]:
    """(F,) row of `REASONS` of each face: `DEGENERATE`, the criterion it fails, or `COVERED`."""
    result = np.where(mesh.degenerate_mask, np.uint8(Reason.DEGENERATE), np.uint8(Reason.COVERED))
    if task is not None:
        for name, fails in CRITERIA.items():
            result[(result == Reason.COVERED) & fails(task, mesh)] = NAMES.index(name)
    return result


def key_of(mesh: Mesh, tasks: Collection[Task]) -> bytes:
    """Bytes that differ where faces fail other criteria of the surface; none where none fails."""
    plain, result = own_reasons(mesh), [own_reasons(mesh, each) for each in dict.fromkeys(tasks)]
    return b"".join(sha256(own.tobytes()).digest() for own in result if (own != plain).any())
