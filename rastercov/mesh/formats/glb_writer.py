"""Binary glTF 2 files: the binary chunk with its views and accessors, and the container.

Source: Khronos Group. glTF 2.0 Specification. 2021, sections 3.6 and 4.
"""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.mesh.formats.glb_container import BINARY_CHUNK, COMPONENTS, JSON_CHUNK, N_COLUMNS

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turn from z up to glTF's y up."""
COMPONENT_OF = {kind: number for number, kind in COMPONENTS.items()}
KIND_OF_COLUMNS = {columns: kind for kind, columns in N_COLUMNS.items()}


class GlbBuffer:
    """Binary chunk of a file, with its views and accessors."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._n_bytes = 0
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add_bytes(self, data: bytes) -> int:
        """Index of a new view, which begins at a multiple of 4 bytes."""
        view = {"buffer": 0, "byteOffset": self._n_bytes, "byteLength": len(data)}
        self._views.append(view)
        piece = _padded(data, b"\0")
        self._pieces.append(piece)
        self._n_bytes += len(piece)
        return len(self._views) - 1

    def add(self, array: NDArray[Any]) -> int:
        """Index of a new accessor of float32 or uint32 values, (N,) or (N, columns), N > 0."""
        kind = KIND_OF_COLUMNS[1 if array.ndim == 1 else array.shape[1]]
        accessor: dict[str, Any] = {
            "bufferView": self.add_bytes(array.astype(array.dtype.newbyteorder("<")).tobytes()),
            "componentType": COMPONENT_OF[f"{array.dtype.kind}{array.dtype.itemsize}"],
            "count": len(array),
            "type": kind,
        }
        if kind == "VEC3":  # required of positions
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def file(self, scene: dict[str, Any]) -> bytes:
        """The file of a glTF scene, which refers to the views and accessors of this buffer."""
        header = {
            "asset": {"version": "2.0", "generator": "rastercov"},
            **scene,
            "buffers": [{"byteLength": self._n_bytes}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }
        text = _padded(json.dumps(header, allow_nan=False).encode(), b" ")
        total = 12 + 8 + len(text) + 8 + self._n_bytes
        return b"".join(
            (
                struct.pack("<4sII", b"glTF", 2, total),
                struct.pack("<II", len(text), JSON_CHUNK),
                text,
                struct.pack("<II", self._n_bytes, BINARY_CHUNK),
                *self._pieces,
            )
        )


def _padded(data: bytes, filler: bytes) -> bytes:
    """Data whose length is a multiple of 4."""
    return data + filler * (-len(data) % 4)
