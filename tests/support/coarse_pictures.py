"""Small pictures of networks, for tests that are about something else."""

import pytest

from rastercov.report import panorama


@pytest.fixture(autouse=True)
def coarse_pictures(monkeypatch):
    """A ninth of the pixels: they take seconds of an evaluation, and all else a tenth of one."""
    monkeypatch.setattr(panorama, "WIDTH", 240)
    monkeypatch.setattr(panorama, "HEIGHT", 186)
