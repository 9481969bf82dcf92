"""What cameras cover, as binary STL in metres."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rastercov.base.output import write_bytes

if TYPE_CHECKING:
    from rastercov.core.coverage.evaluation import Evaluation


def write_covered_stl(path: Path, own: "Evaluation", names: Sequence[str]) -> None:
    """Write the parts that enough cameras cover, as fans of triangles."""
    assert own.areas is not None
    covered = own.areas.covered
    corners = covered.points()
    has_enough = covered.views >= len(covered.area)
    triangles = [
        points[[0, k, k + 1]]
        for row in np.flatnonzero(has_enough)
        for points in [corners[covered.starts[row] : covered.starts[row + 1]]]
        for k in range(1, len(points) - 1)
    ]
    table = np.zeros(
        len(triangles), np.dtype([("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    )
    if triangles:
        table["p"] = triangles
    write_bytes(path, bytes(80) + np.uint32(len(table)).tobytes() + table.tobytes())
