"""Table of the covered area of each face."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rastercov.base.output import writing
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.area.union import Covered
from rastercov.mesh import Mesh


def write_areas(path: Path, mesh: Mesh, covered: Covered) -> None:
    """Write a table of the task faces: Parquet, a row for each face and number of views.

    Columns: `face` (int32), `group` (its name), `views` (int32), `m2` that at least this number of
    cameras covers, `bound_m2` of its error, and `area_m2` of the face (float64).
    """
    faces = np.flatnonzero(mesh.task_mask)
    k = len(covered.area)
    names = pa.array([group.name for group in mesh.groups])
    groups = pa.array(np.repeat(mesh.face_group[faces], k).astype(np.int32))
    table = pa.table(
        {
            "face": np.repeat(faces, k).astype(np.int32),
            "group": pa.DictionaryArray.from_arrays(groups, names),
            "views": np.tile(np.arange(1, k + 1, dtype=np.int32), len(faces)),
            "m2": covered.area[:, faces].T.ravel(),
            "bound_m2": np.repeat(covered.bound[faces], k),
            "area_m2": np.repeat(frames_of(mesh).areas[faces], k),
        }
    )
    with writing(path) as part:
        pq.write_table(table, part)
