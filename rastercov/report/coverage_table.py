"""Parquet table of a run: one row for every pose-face pair in view.

The file appears under its name only when it is whole. An error of the disk is an `OSError` that
names the file.
"""

from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from rastercov._output import json_bytes, named, replacing
from rastercov.coverage import FIGURES, UNITS, Coverage
from rastercov.errors import ConfigError
from rastercov.observation import BoundKind
from rastercov.task import Reason

CODES = {"visibility_kind": BoundKind, "reason": Reason}
"""Columns that are written by name."""
ROWS_A_GROUP = 1 << 18
"""Rows of a Parquet row group: about 13 MB of columns."""


class CoverageTable:
    """Parquet file of every pose-face pair in view, written as the batches come.

    A pair is in view when any part of the face is inside the image (`in_view_fraction` > 0); faces
    seen from behind are among them. Columns: `pose` and `face` (int32), `group` (its name,
    dictionary-encoded: a category in pandas and polars), then `coverage.FIGURES`, floats as
    float32, `incidence` in radians, `reason` and `visibility_kind` by name in lower case,
    dictionary-encoded.
    `visibility_bound` includes the rounding of `visibility` to float32, so that it still holds.

    Parameters
    ----------
    path : path
        Of the file, which appears when the `with` block ends well; otherwise nothing changes.
    header : mapping, optional
        Description of the run (inputs with hashes, settings, device), kept as JSON under the key
        "rastercov" of the schema's metadata.

    Notes
    -----
    Memory does not grow with the run: at most `ROWS_A_GROUP` rows and one batch are held. A run
    without a pair in view gives a valid file without rows.

    One thread at a time may use a table: measure in several, add rows in one.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any] | None = None) -> None:
        self.path = Path(path)
        names = pa.dictionary(pa.int32(), pa.string())
        kinds = {"pose": pa.int32(), "face": pa.int32(), "group": names}
        for name, kind in FIGURES.items():
            kinds[name] = pa.bool_() if kind is np.bool_ else pa.float32()
        kinds |= dict.fromkeys(CODES, names)
        fields = [
            pa.field(name, kind, False, {"unit": UNITS[name]} if name in UNITS else None)
            for name, kind in kinds.items()
        ]
        self.schema = pa.schema(fields, {"rastercov": json_bytes(header or {})})
        self.n_rows = 0
        self._writer: Any = None
        self._pending: Any = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack, named(self.path):
            part = stack.enter_context(replacing(self.path))
            # Opened by us, because pyarrow takes only paths that are UTF-8.
            file = stack.enter_context(part.open("wb"))
            # Dictionaries suit columns with few values; the others are split into their bytes,
            # which compress better side by side.
            spread = ["projected_area", "visible_pixels", "drawn_pixels", "resolution"]
            spread += ["pixel_density", "incidence"]
            self._writer = stack.enter_context(
                pq.ParquetWriter(
                    file,
                    self.schema,
                    compression="zstd",
                    use_dictionary=[n for n in self.schema.names if n not in (*spread, "face")],
                    use_byte_stream_split=spread,
                    column_encoding={"face": "DELTA_BINARY_PACKED"},
                )
            )
            self._pending = self.schema.empty_table()
            self._stack = stack.pop_all()
        return self

    def add(self, coverage: Coverage) -> None:
        """Append the pairs in view of the next poses."""
        if self._writer is None:
            raise ConfigError("a table takes rows inside its with block only; open it there")
        mesh = coverage.mesh
        pairs = np.flatnonzero(coverage.in_view_fraction > 0)
        pose, face = np.divmod(pairs, mesh.n_faces)
        columns: dict[str, Any] = {
            "pose": coverage.pose_ids[pose].astype(np.int32),
            "face": face.astype(np.int32),
            "group": _category(mesh.face_group[face], [group.name for group in mesh.groups]),
        }
        with np.errstate(over="ignore"):  # values beyond float32 become inf
            for name, kind in FIGURES.items():
                values = getattr(coverage, name).ravel()[pairs]
                columns[name] = values if kind is np.bool_ else values.astype(np.float32)
        for name, codes in CODES.items():
            columns[name] = _category(columns[name], [code.name.lower() for code in codes])
        exact = coverage.visibility.ravel()[pairs]
        bound = coverage.visibility_bound.ravel()[pairs] + np.abs(columns["visibility"] - exact)
        short = bound.astype(np.float32)
        columns["visibility_bound"] = np.where(
            short < bound, np.nextafter(short, np.float32(np.inf)), short
        )
        rows = pa.table(columns, schema=self.schema)
        self.n_rows += len(rows)
        pending = pa.concat_tables([self._pending, rows])
        whole = len(pending) // ROWS_A_GROUP * ROWS_A_GROUP
        # The rest is kept before the writing: an interrupt comes after it and must not leave rows
        # to be written twice. The copy releases the memory of the batch.
        rest = pending.slice(whole)
        self._pending = rest.take(np.arange(len(rest))) if whole else rest
        if whole:
            with named(self.path):
                self._writer.write_table(pending.slice(0, whole), row_group_size=ROWS_A_GROUP)

    def __exit__(self, *error: Any) -> None:
        if error[0] is None:
            with named(self.path), self._stack:
                if len(self._pending):
                    self._writer.write_table(self._pending)
        else:
            with suppress(OSError):  # of the full disk that ended the block
                self._stack.__exit__(*error)
        self._writer = self._pending = None


def _category(indices: NDArray[Any], names: list[str]) -> Any:
    return pa.DictionaryArray.from_arrays(indices.astype(np.int32), pa.array(names, pa.string()))
