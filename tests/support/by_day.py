"""Searches, advice and pictures that are smaller in most tests by day: fixtures of all tests."""

import pytest
from nightly import IS_NIGHTLY

from rastercov.core.area import remedies, zones
from rastercov.placement import reconstruction
from rastercov.placement.improve import tour
from rastercov.placement.plan import fewer
from rastercov.placement.select import methods as greedy
from rastercov.report import panorama
from rastercov.report.network_page import NetworkPage

OF_SELECTIONS = {"placement", "test_golden", "test_examples_in_docstrings"}
"""Modules and folders about what selections find."""
ALL_PLACES = remedies.PLACES
OF_PLANS = {
    *("cli", "mesh", "plan", "report", "test_cross_table", "test_jobs", "test_lamp_jobs"),
    *("test_before", "test_examples", "test_lamps", "test_light", "test_misuse", "test_saving"),
    *("test_half_planes", "test_over_time", "test_session", "test_uncertainty"),
    "test_view_of_results",
}
"""Modules and folders of whole commands, in which advice is one part of many."""
OF_PICTURES = {
    *("test_camera_pictures", "test_overview", "test_pictures_in_threads", "test_report"),
    *("test_silhouettes", "test_target_pictures", "test_time_pictures"),
}
"""Modules about pixels of pictures of networks."""
WITHOUT_PICTURES = {
    *("test_baseline", "test_docs", "test_first_lines", "test_guide", "test_json_output"),
    *("test_json_schema", "test_misuse"),
}
"""Modules about what is printed or refused, whose pages have none by day."""


@pytest.fixture(scope="module", autouse=True)
def few_kicks(request):
    """Searches and a proof of selections and tours that end early, by day, in tests of whole plans.

    They take most of the time of a small plan. Tests of placement, and those of what was answered
    before, have all of it.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not ({request.path.stem, request.path.parent.name} & OF_SELECTIONS or IS_NIGHTLY):
            patch.setattr(greedy, "MOST_KICKS", 60)
            patch.setattr(fewer, "MOST_WORK", 20_000_000)
            patch.setattr(tour, "KICKS", 20)
        yield


@pytest.fixture(scope="module", autouse=True)
def few_places(request):
    """Advice that tries few places for a camera, for few zones, by day, in whole commands.

    It takes most of the time of a small scene with a dead zone. tests/area, pages and golden
    answers have all of it.
    """
    with pytest.MonkeyPatch.context() as patch:
        if {request.path.stem, request.path.parent.name} & OF_PLANS and not IS_NIGHTLY:
            patch.setattr(remedies, "PLACES", 8)
            for module in (zones, reconstruction):
                patch.setattr(module, "TRIED_PERCENT", 100.0)
                patch.setattr(module, "MOST_LINES", 2)
        yield


@pytest.fixture(scope="module", autouse=True)
def coarse_pictures(request):
    """Small pictures of networks, except in tests of these: a 36th of the pixels.

    They take seconds of an evaluation, and all else a tenth of one.
    """
    with pytest.MonkeyPatch.context() as patch:
        if request.path.stem not in OF_PICTURES:
            patch.setattr(panorama, "WIDTH", 120)
            patch.setattr(panorama, "HEIGHT", 93)
        if request.path.stem in WITHOUT_PICTURES and not IS_NIGHTLY:
            patch.setattr(NetworkPage, "draw", lambda *_: {})
        yield


@pytest.fixture
def all_places(monkeypatch):
    """Advice as users get it, for a test of what a page prints."""
    monkeypatch.setattr(remedies, "PLACES", ALL_PLACES)
