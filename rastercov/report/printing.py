"""Pages on paper: PDF by a browser that is on this machine."""

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from rastercov.base import ConfigError, shorten, write_text
from rastercov.base.format import to_install
from rastercov.report.folder import ReportFolder

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    # Where macOS and Windows install theirs, off the path.
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
INSTALL_CHROMIUM = to_install("Chromium", "chromium", "install Chromium or Chrome")
MOST_SECONDS = 120


def browser() -> str:
    """Program that prints pages; ConfigError without one."""
    item = next(filter(None, map(shutil.which, BROWSERS)), None)
    if item is not None:
        return item
    try:
        from playwright.sync_api import sync_playwright

        with sync_playwright() as driver:
            item = driver.chromium.executable_path
    except ImportError:
        pass
    if item is None or not Path(item).exists():
        raise ConfigError(
            f"--pdf: expected Chromium or Chrome, got none; {INSTALL_CHROMIUM}, or run "
            "`playwright install chromium`"
        )
    return item


def write_page(folder: ReportFolder, name: str, text: str, *, pdf: bool = False) -> None:
    """Write a page of a report, NAME.html, and with `pdf` the same on A4, NAME.pdf."""
    page = folder.file(f"{name}.html")
    write_text(page, text)
    if not pdf:
        return
    path = folder.file(f"{name}.pdf")
    program, is_root = browser(), hasattr(os, "geteuid") and os.geteuid() == 0
    said = "" if is_root else _print_with(program, page, path)
    if is_root or (not path.exists() and "sandbox" in said):  # root and containers have none
        said = _print_with(program, page, path, "--no-sandbox")
    if not path.exists():
        raise ConfigError(
            f"--pdf: expected a PDF by {program}, got {shorten(said, 60) or 'none'}; leave out "
            "--pdf, or print the page by hand"
        )


def _print_with(program: str, page: Path, path: Path, *options: str) -> str:
    """Print our own page to a PDF with a browser; its last words on standard error."""
    with TemporaryDirectory() as profile:
        command = [
            *(program, *options, "--headless", "--disable-gpu", "--no-pdf-header-footer"),
            *(f"--user-data-dir={profile}", f"--print-to-pdf={path}", page.resolve().as_uri()),
        ]
        try:
            done = subprocess.run(command, capture_output=True, timeout=MOST_SECONDS, check=False)
        except subprocess.TimeoutExpired:
            return f"no answer in {MOST_SECONDS} s"
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return next((line for line in lines if "sandbox" in line), "".join(lines[-1:]))
