"""Commands run in a folder of their own, and draw coarsely; `tests/report` tests their pictures."""

import pytest
from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
from commands import enter


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A folder to work in."""
    enter(tmp_path, monkeypatch)
    return tmp_path
