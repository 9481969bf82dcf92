"""Commands run in a folder of their own; `tests/report` tests their pictures."""

import pytest
from commands import enter


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A folder to work in."""
    enter(tmp_path, monkeypatch)
    return tmp_path
