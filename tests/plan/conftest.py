"""Plans are run in a folder of their own, with a room of walls and boxes."""

import pytest
from plans import write_obj
from surface_cases import room


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The folder."""
    monkeypatch.chdir(tmp_path)
    write_obj("room.obj", room()[0], {"walls": 0, "boxes": 12})
