"""The page that opens the browser: its token is in no list of processes."""

import os
import shutil
import signal
import stat
import time
from pathlib import Path

import pytest
from browser import CHROMIUM, Program, chromium
from rigs_to_view import session_of_room
from viewer_doors import Viewer

from rastercov.viewer.server import redirect

pytest.importorskip("uvicorn", reason="the viewer needs rastercov[view]")
BROWSER = """#!/bin/sh
exec > "$SEEN.said" 2>&1
for page; do :; done
printf '%s\\n' "$*" > "$SEEN"
cp "${page#file://}" "$SEEN.page"
sleep 3
"""
"""A browser that notes its arguments, and the file that is the last of them."""


def command_lines():
    """Argument lists of all processes, as every user of the machine can read them."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            found.append(path.read_bytes())
        except OSError:  # it has ended
            continue
    return found


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="needs the processes of Linux")
@pytest.mark.parametrize("name", ["BROWSER", "firefox"])
def test_the_token_is_in_no_list_of_processes(tmp_path, name):
    """Whatever opens the browser: $BROWSER, or a program that Python finds."""
    folder, private, seen = tmp_path / "bin", tmp_path / "private", tmp_path / "seen"
    folder.mkdir()
    private.mkdir()
    program = folder / name
    program.write_text(BROWSER)
    program.chmod(0o755)
    for each in ("cp", "sleep"):
        (folder / each).symlink_to(shutil.which(each))
    own = {"BROWSER": str(program)} if name == "BROWSER" else {}
    viewer = Viewer(DISPLAY=":0", SEEN=str(seen), PATH=str(folder), TMPDIR=str(private), **own)
    page, end = Path(f"{seen}.page"), time.monotonic() + 20
    while time.monotonic() < end and not (page.exists() and page.stat().st_size):
        time.sleep(0.1)
    lines = command_lines()
    made = [(path, stat.S_IMODE(path.stat().st_mode)) for path in private.rglob("*")]
    viewer.process.send_signal(signal.SIGINT)
    code, _ = viewer.ended()
    assert any(str(program).encode() in line for line in lines)
    assert not any(viewer.token.encode() in line for line in lines)
    assert viewer.token not in seen.read_text()
    assert f"{viewer.url}/#{viewer.token}" in page.read_text()
    assert [mode for _, mode in made] == [0o700, 0o600]
    assert code == 130
    assert list(private.iterdir()) == []


def test_the_file_is_made_anew_and_removed(tmp_path, monkeypatch):
    """A link of another user in its place is not followed, since its folder is new."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    previous = os.umask(0)
    try:
        with redirect("http://127.0.0.1:1/#a&b") as path:
            assert stat.S_IMODE(path.stat().st_mode) == 0o600
            assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
            assert 'content="0;url=http://127.0.0.1:1/#a&amp;b"' in path.read_text()
    finally:
        os.umask(previous)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs the system's Chromium; see `make chromium`")
def test_a_browser_follows_the_page():
    pytest.importorskip("playwright", reason="the page's tests need Playwright; `make test` has it")
    program = Program(session_of_room())
    arrived = []
    program.arrived = lambda: arrived.append(True)
    program.start()
    try:
        with chromium() as browser, redirect(program.url) as path:
            page = browser.new_page(bypass_csp=True)
            page.goto(path.as_uri())
            page.wait_for_function("window.rastercov?.session.figures !== undefined")
            assert page.url == f"http://127.0.0.1:{program.port}/"
    finally:
        program.stop()
        program.session.close()
    assert arrived == [True]
