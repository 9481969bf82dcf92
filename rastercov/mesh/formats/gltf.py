"""glTF 2 files in JSON (.gltf), with buffers in files beside them or in data URIs.

The scene is read as that of a GLB file. A buffer is opened only if its name leads to a file in the
folder of the .gltf or below it. Images are never opened.

Source: Khronos Group. glTF 2.0 Specification. 2021, section 3.6.1.
"""

import base64
import binascii
import re
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

from rastercov.base.errors import MeshError
from rastercov.mesh.formats.glb import broken_files_refused, scene_polygons
from rastercov.mesh.formats.glb_container import json_count, json_header, json_list
from rastercov.mesh.formats.polygons import Polygons

DATA_URI = re.compile(r"data:[\w.+-]+/[\w.+-]+(?:;[^,;]*)*;base64,")
PADDING = 3
"""Bytes that a buffer may hold beyond its length without a note: padding to 4 bytes."""


def read(data: bytes, budget: int, bytes_beside: Callable[[str], bytes]) -> Polygons:
    """Triangles of a .gltf file in metres, one group a node, in the order of the scene's tree.

    Parameters
    ----------
    data : bytes
        The JSON.
    budget : int
        Bytes that reading may need.
    bytes_beside : callable
        Bytes of the file of that relative name; MeshError where it is outside the folder.
    """
    with broken_files_refused():
        header = json_header(data, "JSON")
        buffers: list[memoryview] = []
        notes: list[str] = []
        for index, buffer in enumerate(json_list(header, "buffers")):
            content, name = _content(index, buffer, bytes_beside)
            promised = json_count(buffer, "byteLength")
            if promised > len(content):
                raise MeshError(
                    f"buffer {index} promises {promised} bytes, {name} holds {len(content)}; "
                    "it is truncated, export it again"
                )
            if len(content) - promised > PADDING:
                notes.append(
                    f"buffer {index} promises {promised} bytes, {name} holds {len(content)}"
                )
            buffers.append(memoryview(content)[:promised])
        return scene_polygons(header, buffers, budget, notes)


def _content(
    index: int, buffer: dict[str, Any], bytes_beside: Callable[[str], bytes]
) -> tuple[bytes, str]:
    """Bytes of a buffer, and the name of their place for errors."""
    uri = buffer.get("uri")
    if not isinstance(uri, str):
        raise MeshError(
            f"buffer {index}: a file name or a data URI wanted, got {uri!r:.60}; export it again"
        )
    if not uri.startswith("data:"):
        return bytes_beside(unquote(uri)), unquote(uri)[:80]
    head = DATA_URI.match(uri)
    try:
        if head is None:
            raise ValueError("no base64 is declared")
        text = uri[head.end() :]
        return base64.b64decode(unquote(text) if "%" in text else text, validate=True), "its URI"
    except (ValueError, binascii.Error) as error:
        raise MeshError(
            f"buffer {index}: a data URI in base64 wanted, got {uri[:40]!r} ({error}); "
            "export it again"
        ) from None
