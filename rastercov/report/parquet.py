"""Tables of pairs and areas in Parquet, which needs pyarrow: `rastercov[tables]`.

The table of pairs has one row for every pair of pose and face that was asked for. It appears under
its name only when it is whole. An error of the disk is an `OSError` that names the file.

Callers ask `coverage_files.has_parquet` first and import this file in a function: most commands run
without pyarrow, which takes 0.1 s to load.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rastercov.base import (
    FloatArray,
    Int32Array,
    IntArray,
    ReadByName,
    json_bytes,
    name_file,
)
from rastercov.base.output import replacing, writing
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.table import Regions
from rastercov.core.area.union import Covered
from rastercov.core.coverage.face_pass import FIGURES
from rastercov.core.coverage.task import NAMES
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import BoundKind

if TYPE_CHECKING:
    from rastercov.core.coverage.face_pass import PairRows

COVERED_M2 = "covered_m2"
"""Column by area only."""
UNITS = {
    **dict.fromkeys(("visible_pixels", "drawn_pixels"), "px"),
    "projected_area": "px^2",
    "pixel_density": "px/m",
    "facing_density": "px/m",
    "incidence": "rad",
    COVERED_M2: "m^2",
}
"""Units of columns that have one."""
CODES = {"visibility_kind": [each.name.lower() for each in BoundKind], "reason": NAMES}
"""Columns that are written by name."""
ROWS_A_GROUP = 1 << 18
"""Rows of a Parquet row group: about 13 MB of columns."""


class CoverageTable:
    """Parquet file of pairs of pose and face.

    Columns: `pose` and `face` (int32), `group` (its name, dictionary-encoded: a category in pandas
    and polars), then `coverage.FIGURES`, floats as float32, `incidence` in radians, `reason` and
    `visibility_kind` by name in lower case, dictionary-encoded. `visibility_bound` includes the
    rounding of `visibility` to float32, so that it still holds.

    Parameters
    ----------
    path : path
        Of the file, which appears when the `with` block ends well; otherwise nothing changes.
    mesh : Mesh
        Whose faces the rows are of.
    header : mapping, optional
        Description of the run (inputs with hashes, settings, device), kept as JSON under the key
        "rastercov" of the schema's metadata.
    by_area : bool
        Adds the column `covered_m2`, float32: the part of the face that the pose covers.
    cameras : (sequence of str, (N,) int32), optional
        Names of several cameras, and the index of the camera of each pose of the input: adds the
        column `camera`, the name, dictionary-encoded.

    Notes
    -----
    Memory does not grow with the run: at most `ROWS_A_GROUP` rows and a batch are held. A run
    without rows gives a valid file.

    One thread at a time may use a table: measure in several, add rows in one.
    """

    def __init__(
        self,
        path: str | Path,
        mesh: Mesh,
        header: ReadByName | None = None,
        *,
        by_area: bool = False,
        cameras: tuple[Sequence[str], Int32Array] | None = None,
    ) -> None:
        self.path, self.mesh = Path(path), mesh
        names = pa.dictionary(pa.int32(), pa.string())
        kinds = {"pose": pa.int32(), "face": pa.int32(), "group": names}
        if cameras is not None:
            kinds["camera"] = names
        for name, kind in FIGURES.items():
            kinds[name] = pa.bool_() if kind is np.bool_ else pa.float32()
        kinds |= dict.fromkeys(CODES, names)
        if by_area:
            kinds[COVERED_M2] = pa.float32()
        fields = [
            pa.field(name, kind, False, {"unit": UNITS[name]} if name in UNITS else None)
            for name, kind in kinds.items()
        ]
        self.schema = pa.schema(fields, {"rastercov": json_bytes(header or {})})
        self.n_rows = 0
        self._group_of_face = mesh.face_group.astype(np.int32)
        self._names = {"group": _names(group.name for group in mesh.groups)} | {
            name: _names(codes) for name, codes in CODES.items()
        }
        if cameras is not None:
            self._names["camera"], self._camera_of_pose = _names(cameras[0]), cameras[1]
        self._writer: Any = None
        self._pending: Any = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack, name_file(self.path):
            part = stack.enter_context(replacing(self.path))
            # Opened by us, because pyarrow takes only paths that are UTF-8.
            file = stack.enter_context(part.open("wb"))
            # Floats are split into their bytes, which compress better side by side. Statistics and
            # zstd would take as long again as the rest: 111 in place of 49 ns a row, for 10 % of
            # the size.
            floats = [field.name for field in self.schema if field.type == pa.float32()]
            self._writer = stack.enter_context(
                pq.ParquetWriter(
                    file,
                    self.schema,
                    compression="snappy",
                    use_dictionary=["pose", *self._names],
                    use_byte_stream_split=floats,
                    column_encoding={"face": "DELTA_BINARY_PACKED"},
                    write_statistics=["pose", "face"],
                )
            )
            self._pending = self.schema.empty_table()
            self._stack = stack.pop_all()
        return self

    def add(self, rows: "PairRows", regions: Regions | None = None) -> None:
        """Append rows; they are not copied, so must not change any more.

        `regions` of their poses are needed by area.
        """
        columns = dict(rows)
        if regions is not None:
            pose = np.searchsorted(regions.pose_ids, rows["pose"])
            columns[COVERED_M2] = regions.areas()[pose, rows["face"]].astype(np.float32)
        self.n_rows += len(rows["pose"])
        columns["group"] = self._group_of_face[rows["face"]]
        if "camera" in self._names:
            columns["camera"] = self._camera_of_pose[rows["pose"]]
        for name, names in self._names.items():
            columns[name] = pa.DictionaryArray.from_arrays(columns[name], names)
        self._pending = pa.concat_tables([self._pending, pa.table(columns, schema=self.schema)])
        whole = len(self._pending) // ROWS_A_GROUP * ROWS_A_GROUP
        if whole:
            groups, rest = self._pending.slice(0, whole), self._pending.slice(whole)
            self._pending = rest.take(np.arange(len(rest)))  # a copy releases the memory of batches
            with name_file(self.path):
                self._writer.write_table(groups, row_group_size=ROWS_A_GROUP)

    def __exit__(self, *error: Any) -> None:
        pending, self._pending = self._pending, None
        if error[0] is not None:
            with suppress(OSError):  # of the full disk that ended the block
                self._stack.__exit__(*error)
            return
        with name_file(self.path), self._stack:
            if len(pending):
                self._writer.write_table(pending)


def _names(names: Iterable[str]) -> Any:
    return pa.array(list(names), pa.string())


def group_names(mesh: Mesh, faces: IntArray) -> Any:
    """Arrow column of the names of the groups of some faces."""
    names = _names(group.name for group in mesh.groups)
    return pa.DictionaryArray.from_arrays(mesh.face_group[faces].astype(np.int32), names)


def write_areas(
    path: Path, mesh: Mesh, covered: Covered, of_faces: Mapping[str, FloatArray]
) -> None:
    """Write a table of the evaluated faces: Parquet, a row for each face and number of views.

    Columns: `face` (int32), `group` (its name), `views` (int32), `m2` that at least this number of
    cameras covers, `bound_m2` of its error, and `area_m2` of the face (float64). Each
    figure of faces, (2, F), has two, NAME_UNIT and NAME_bound_UNIT, NaN where there is none.
    """
    faces = np.flatnonzero(mesh.task_mask)
    k = len(covered.area)
    columns = {
        "face": np.repeat(faces, k).astype(np.int32),
        "group": group_names(mesh, np.repeat(faces, k)),
        "views": np.tile(np.arange(1, k + 1, dtype=np.int32), len(faces)),
        "m2": covered.area[:, faces].T.ravel(),
        "bound_m2": np.repeat(covered.bound[faces], k),
        "area_m2": np.repeat(frames_of(mesh).areas[faces], k),
    }
    for name, values in of_faces.items():
        known = np.where(values[0] > 0, values, np.nan)[:, faces].repeat(k, axis=1)
        figure, _, unit = name.rpartition("_")
        columns |= {name: known[0], f"{figure}_bound_{unit}": known[1]}
    write_columns(path, columns)


def write_columns(path: Path, columns: ReadByName) -> None:
    """Write columns as Parquet, by a file of ours: pyarrow takes only paths in UTF-8."""
    with writing(path) as part, part.open("wb") as file:
        pq.write_table(pa.table(columns), file)
