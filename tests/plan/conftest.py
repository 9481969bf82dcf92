"""Plans are read and run in a folder of their own, which has a room."""

from pathlib import Path

import pytest
from mesh_files import obj
from surface_cases import room

MESH = room()[0]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The folder."""
    monkeypatch.chdir(tmp_path)
    Path("room.obj").write_bytes(obj(MESH.vertices, MESH.faces))
