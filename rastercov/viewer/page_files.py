"""Files of the page: its modules, style and shaders, which hold no data."""

import base64
import hashlib
import re
from importlib.resources import files
from pathlib import Path

TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".glsl": "text/plain",
         ".svg": "image/svg+xml"}  # fmt: skip


def page_text() -> str:
    """The page, index.html."""
    return (files("rastercov.viewer") / "page" / "index.html").read_text("utf-8")


def static_file(name: str) -> bytes | None:
    """A module, style or shader of the page by its name; None for anything else."""
    if not re.fullmatch(r"(shaders/viewer_)?[a-z0-9_]+(\.(vert|frag))?\.[a-z]+", name):
        return None
    if Path(name).suffix not in TYPES:
        return None
    folder = "rastercov" if name.startswith("shaders/") else "rastercov.viewer"
    place = files(folder) / name if folder == "rastercov" else files(folder) / "page" / name
    return place.read_bytes() if place.is_file() else None


def digest_of(text: str) -> str:
    """Source of a content security policy: a text inside the page itself."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
