"""Rasterisers to test, and a headless context for the whole run that nothing is left behind on."""

import gc
import os
import signal
from collections import Counter
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import moderngl
import pytest
from by_day import all_places, coarse_pictures, few_kicks, few_places  # noqa: F401 # fixtures
from gl_device import DEVICE
from hypothesis import settings
from matters import note_names, skip_what_did_not_change
from nightly import amount
from page_in_node import node  # noqa: F401 # a fixture

from rastercov.base.errors import DeviceError
from rastercov.core.mesh import Mesh
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl import PLANS, GLRasterizer, libraries
from rastercov.gl.context import open_context

# New examples on every run at a desk, the same ones where a run decides over a change. No time
# limit for one example: these machines are shared.
EXAMPLES = amount(40, at_night=100)
settings.register_profile("desk", deadline=None, max_examples=EXAMPLES)
settings.register_profile("ci", deadline=None, max_examples=EXAMPLES, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "desk")

USES, UNFROZEN = count(), 100
"""Tests on the device; one in so many collects garbage among all objects."""


def pytest_configure(config):
    """Make errors of warnings in our own files, and take Ctrl-C again where a shell ignores it.

    What another package does wrong inside comes with any release of it, and breaks no test here.
    What a shell starts in the background ignores SIGINT, and so would the tests of interrupts.
    """
    note_names(config)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    root, folders = Path(__file__).parents[1], ("tests", "benchmarks", "examples")
    ours = {path.stem for folder in folders for path in (root / folder).rglob("*.py")}
    names = "|".join(["__main__", *sorted(ours)])
    config.addinivalue_line("filterwarnings", rf"error:::(rastercov\b|({names})$)")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Keep the collector off the million objects of all tests, which live as long as the run."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items):
    """Leave what did not change to the night; begin with browsers, whose tests are long."""
    skip_what_did_not_change(items)
    items.sort(key=lambda item: "browser" not in item.fixturenames)


def pytest_terminal_summary(terminalreporter):
    """Say at the end what was not tested here, and why."""
    skipped = terminalreporter.stats.get("skipped", [])
    terminalreporter.section(f"not tested here: {len(skipped)}")
    reasons = (report.longrepr[2].removeprefix("Skipped: ") for report in skipped)
    for reason, n in Counter(" ".join(reason.split()) for reason in reasons).most_common():
        terminalreporter.write_line(f"{n:5} {reason}")


@pytest.fixture
def load(tmp_path):
    """Write bytes under a name and load them as a mesh."""

    def write_and_load(name, data, **options):
        path = tmp_path / name
        path.write_bytes(data)
        return Mesh.load(path, **options)

    return write_and_load


@pytest.fixture(scope="session")
def gl_context():
    """Mesa in software; it must be there, because a skipped rasteriser test proves nothing."""
    try:
        context = open_context(DEVICE)
    except DeviceError as error:
        pytest.fail(f"the rasteriser tests need OpenGL on {DEVICE}: {error}", pytrace=False)
    with context:
        yield context


@pytest.fixture
def no_library(monkeypatch):
    """A machine without any graphics library."""
    cached = (libraries.egl_library, libraries.osmesa_library)
    for load in cached:
        load.cache_clear()
    monkeypatch.setattr(libraries, "find_library", lambda names: None)
    yield
    for load in cached:
        load.cache_clear()


@pytest.fixture(scope="module")
def osmesa_context(gl_context):
    """OSMesa, which Mesa 25.1 was the last to have."""
    try:
        context = open_context("osmesa")
    except DeviceError as error:
        pytest.skip(f"no OSMesa here: {error}")
    with context:
        yield context
    gl_context.make_current()


@pytest.fixture
def device(gl_context):
    """The context, in good order before and after, with nothing of the test left alive in it."""
    gl_context.make_current()
    if next(USES) % UNFROZEN == 0:
        gc.unfreeze()
    gc.collect()
    gc.freeze()  # What was there before costs no collection any more; it is a million objects.
    yield gl_context
    gl = gl_context.gl
    assert gl.error == "GL_NO_ERROR"
    gc.collect()
    left = [thing for thing in gl.objects if not isinstance(thing, moderngl.InvalidObject)]
    gl.objects.clear()
    assert left == []


@pytest.fixture(params=PLANS)
def plan(request):
    """All ways for the OpenGL rasteriser to run; the software device can do them all."""
    return request.param


@pytest.fixture
def open_gl(device, plan):
    """Open OpenGL rasterisers under the plan; they are closed when the test ends."""
    with ExitStack() as stack:
        yield lambda mesh, camera, **options: stack.enter_context(
            GLRasterizer(mesh, camera, device=device, plan=plan, **options)
        )


@pytest.fixture(params=[*PLANS, "cpu"])
def open_raster(request, device):
    """Open rasterisers of every kind, for the laws that all of them keep."""
    with ExitStack() as stack:

        def open_one(mesh, camera, **options):
            if request.param == "cpu":
                return stack.enter_context(CPURasterizer(mesh, camera, **options))
            return stack.enter_context(
                GLRasterizer(mesh, camera, device=device, plan=request.param, **options)
            )

        yield open_one
