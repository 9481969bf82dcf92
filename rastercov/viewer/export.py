"""One file that shows a rig without a server: the page with its modules and its data inside.

It can be looked at, picked and coloured anew, and not be edited.
"""

import base64
import json
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from rastercov.base.errors import ConfigError, RastercovError, ResourceError
from rastercov.base.output import write_text
from rastercov.report.modes import MODES as EVERY
from rastercov.viewer.page_files import digest_of, page_text, static_file
from rastercov.viewer.session import Session, unframed

MODES = tuple(name for name in EVERY if name not in ("model", "single"))
"""Ways to colour the faces that the file has."""
MOST_FACES = 1_500_000
"""Faces of an exported page: 36 bytes each, a third more as text."""


def export_page(session: Session, path: str | Path, modes: Sequence[str] = MODES) -> Path:
    """Write a page that needs no server.

    Parameters
    ----------
    session : Session
        What it shows.
    path : str or Path
        The file, .html.
    modes : sequence of str
        Ways to colour the faces; one that the thresholds do not allow is left out.

    Raises
    ------
    ConfigError
        For a file of another suffix.
    ResourceError
        For more than `MOST_FACES` faces.
    """
    check_name(path)
    write_text(path, exported(session, modes))
    return Path(path)


def check_name(path: str | Path) -> None:
    """Raise `ConfigError` unless a file is named as a page."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise ConfigError(f"the page is an .html file, got {path}")


def exported(session: Session, modes: Sequence[str] = MODES) -> str:
    """Text of a page that needs no server; ResourceError for more than `MOST_FACES` faces."""
    if session.scene.mesh.n_faces > MOST_FACES:
        raise ResourceError(
            f"a page of one file holds up to {MOST_FACES:,} faces, got "
            f"{session.scene.mesh.n_faces:,}; decimate the mesh, or use the server"
        )
    return _embedded(_data(session, modes))


def _data(session: Session, modes: Sequence[str]) -> dict[str, Any]:
    """Everything that the page shows."""
    scene = session.scene.described(is_kept=session.is_kept, can_edit=False)
    frames: dict[str, Any] = {}
    for mode in modes:
        try:
            head, levels = unframed(session.frame(mode, {}))
        except RastercovError:
            continue  # by exact area where a threshold is of a face
        frames[mode] = head | {"levels": base64.b64encode(levels).decode()}
    scene["modes"] = [each for each in scene["modes"] if each["id"] in frames]
    zones: list[Any] = session.zones() if "area" in frames else []
    origin, soup = session.scene.soup()
    return {
        "scene": scene,
        "state": session.described_state(),
        "origin": origin.tolist(),
        "soup": base64.b64encode(soup).decode(),
        "groups": base64.b64encode(session.scene.groups()).decode(),
        "frames": frames,
        "zones": zones,
    }


def _shaders() -> dict[str, str]:
    """Text of each shader of the page, by its name without .glsl."""
    return {
        each.name.removesuffix(".glsl"): each.read_text("utf-8")
        for each in (files("rastercov") / "shaders").iterdir()
        if each.name.startswith("viewer_") and each.name.endswith(".glsl")
    }


def _embedded(data: dict[str, Any]) -> str:
    """The page with its style, modules and data inside; its policy lets it load nothing."""
    style, script = (static_file("style.css") or b"").decode(), _script("main")
    policy = (
        f"default-src 'none'; script-src {digest_of(script)}; style-src {digest_of(style)}; "
        "img-src blob: data:; connect-src 'none'; base-uri 'none'; form-action 'none'"
    )
    inside, shaders = (_inside(each) for each in (data, _shaders()))
    parts = {
        '<meta charset="utf-8">': '<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        r'<link[^>]*href="/static/style\.css"[^>]*>': f"<style>{style}</style>",
        r'<script type="importmap">.*?</script>': (
            f'<script type="application/json" id="shaders">{shaders}</script>\n'
            f'<script type="application/json" id="export">{inside}</script>'
        ),
        r'<script type="module" src="/static/main\.js"></script>': (
            f'<script type="module">{script}</script>'
        ),
    }
    text = page_text()
    for pattern, part in parts.items():
        before, after = re.split(pattern, text, flags=re.DOTALL)
        text = before + part + after
    return text


_IMPORT = re.compile(r'^import (\{.*?\}) from "rastercov/(\w+)\.js";$', re.DOTALL | re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:class|function|const) (\w+))", re.MULTILINE)


def _script(name: str) -> str:
    """A module and those that it imports as one script, which a policy can name by its hash.

    A module becomes a function that gives its exports, called once, after those that it imports.
    """
    made: dict[str, str] = {}

    def add(module: str) -> None:
        text = (static_file(f"{module}.js") or b"").decode()
        for imported in _IMPORT.findall(text):
            if imported[1] not in made:
                add(imported[1])
        exports = ", ".join(found[1] for found in _EXPORT.findall(text))
        text = _IMPORT.sub(lambda found: f"const {found[1]} = {found[2]}_js;", text)
        made[module] = (
            f"const {module}_js = (() => {{\n{_EXPORT.sub(lambda found: found[1], text)}\n"
            f"return {{ {exports} }};\n}})();\n"
        )

    add(name)
    return "".join(made.values())


def _inside(data: Any) -> str:
    """JSON that no element of a page ends in."""
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")
