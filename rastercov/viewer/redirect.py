"""A file that opens the page in a browser, so that the token is in no list of processes.

A browser gets what it opens as an argument, which every user of the machine can read. So it gets
the name of a file that only this user can read, in a new folder that only this user can enter.
"""

import html
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

PAGE = """<!DOCTYPE html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0;url={url}">
<title>rastercov</title>
<a href="{url}">Open the viewer</a>
"""


@contextmanager
def redirect(url: str) -> Iterator[Path]:
    """File that leads a browser to a URL; it exists until the block ends."""
    # Browsers packaged by snap read neither /tmp nor hidden folders.
    place = Path.home() if shutil.which("snap") else None
    with TemporaryDirectory(prefix="rastercov-", dir=place, ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "open.html"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(PAGE.format(url=html.escape(url)))
        yield path
