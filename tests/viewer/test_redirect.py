"""The page that opens the browser: its token is in no list of processes."""

import os
import shutil
import signal
import stat
import time
from contextlib import suppress
from pathlib import Path

import pytest
from viewer_doors import Viewer

from rastercov.page.server import redirect

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
    items = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            items.append(path.read_bytes())
    return items


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="needs the processes of Linux")
@pytest.mark.parametrize("name", ["BROWSER", "firefox"])
def test_the_token_is_in_no_list_of_processes(tmp_path, name):
    """Whatever opens the browser: $BROWSER, or a program that Python finds."""
    folder, private, seen = (tmp_path / each for each in ("bin", "private", "seen"))
    folder.mkdir()
    private.mkdir()
    program, page = folder / name, Path(f"{seen}.page")
    program.write_text(BROWSER)
    program.chmod(0o755)
    for each in ("cp", "sleep"):
        (folder / each).symlink_to(shutil.which(each))
    own = {"BROWSER": str(program)} if name == "BROWSER" else {}
    viewer = Viewer(DISPLAY=":0", SEEN=str(seen), PATH=str(folder), TMPDIR=str(private), **own)
    end = time.monotonic() + 20
    while time.monotonic() < end and not (page.exists() and page.stat().st_size):
        time.sleep(0.1)
    lines = command_lines()
    modes = [stat.S_IMODE(path.stat().st_mode) for path in private.rglob("*")]
    viewer.process.send_signal(signal.SIGINT)
    assert viewer.ended()[0] == 130
    assert any(str(program).encode() in line for line in lines)
    assert not any(viewer.token.encode() in line for line in lines)
    assert viewer.token not in seen.read_text()
    assert f"{viewer.url}/#{viewer.token}" in page.read_text()
    assert (modes, list(private.iterdir())) == ([0o700, 0o600], [])


def test_the_file_is_made_anew_and_removed(tmp_path, monkeypatch):
    """A link of another user in its place is not followed, since its folder is new."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    previous = os.umask(0)
    with redirect("http://127.0.0.1:1/#a&b") as path:
        os.umask(previous)
        modes = [stat.S_IMODE(each.stat().st_mode) for each in (path, path.parent)]
        assert modes == [0o600, 0o700]
        assert 'content="0;url=http://127.0.0.1:1/#a&amp;b"' in path.read_text()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.every_day
@pytest.mark.slow
def test_a_browser_follows_the_page(browser, program):
    arrived = []
    program.stop()
    program.arrived = lambda: arrived.append(True)
    program.start()
    with redirect(program.url) as path:
        page = browser.new_page(bypass_csp=True)
        page.goto(path.as_uri())
        page.wait_for_function("window.rastercov?.session.figures !== undefined")
        assert page.url == f"http://127.0.0.1:{program.port}/"
    assert arrived == [True]
