"""Fixtures of the tests of the viewer's page, which need Chromium and Playwright."""

import pytest
from browser import CHROMIUM, Program, Tab, chromium, context_of
from rigs_to_view import session_of_room


@pytest.fixture(scope="module")
def browser():
    pytest.importorskip("playwright", reason="the page's tests need Playwright; `make test` has it")
    pytest.importorskip("uvicorn", reason="the viewer needs rastercov[view]")
    if CHROMIUM is None:
        pytest.skip("the page's tests need the system's Chromium; see `make chromium`")
    with chromium() as opened:
        yield opened


@pytest.fixture
def program():
    running = Program(session_of_room())
    running.start()
    yield running
    running.stop()
    running.session.close()


@pytest.fixture
def context(browser):
    with context_of(browser) as made:
        yield made


@pytest.fixture
def tab(context, program):
    made = Tab(context, program.url)
    yield made
    assert made.faults == []
