"""Files that a viewer saves: rig, plan that holds it, report, or a page without a server."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.format import plural
from rastercov.base.output import write_bytes, write_text
from rastercov.camera.formats.own import content_of
from rastercov.coverage.task import Task
from rastercov.report.modes import MODES as EVERY
from rastercov.report.pages import embedded, levels_of
from rastercov.viewer.rig_state import RigState
from rastercov.viewer.scene import Scene
from rastercov.viewer.session import Session, unframed

NAMES = {"rig": "rig.json", "plan": "plan.toml", "report": "report"}
MODES = tuple(name for name in EVERY if name not in ("model", "single"))
"""Ways to colour the faces that the file has."""


class Saving:
    """Saves what a session has.

    Parameters
    ----------
    session : Session
    out : Path, optional
        Folder for the files; without one they can be downloaded only.
    """

    def __init__(self, session: Session, out: Path | None = None) -> None:
        self.session, self.out = session, out

    def content(self, what: str) -> tuple[str, bytes]:
        """Name and bytes of the rig, the plan, or a page that needs no server."""
        if what == "page":
            return "rig.html", exported(self.session).encode()
        if what not in ("rig", "plan"):
            raise ConfigError(f"what must be rig, plan or page, got {shown(what)}")
        with self.session.lock:
            state = self.session.state
            self.session.history.saved()
        text = rig_text(state) if what == "rig" else plan_text(self.session.scene, state)
        return NAMES[what], text.encode()

    def save(self, asked: Mapping[str, Any]) -> dict[str, str]:
        """Save what {"what": ...} asks for: the rig, the plan with the rig, or a report.

        Gives the place, and words on it.

        Raises
        ------
        ConfigError
            For anything else, and where no folder was given.
        """
        what = asked.get("what")
        if set(asked) != {"what"} or not isinstance(what, str) or what not in NAMES:
            raise ConfigError(f"what must be one of {', '.join(NAMES)}, got {shown(what)}")
        if self.out is None:
            raise ConfigError("no folder was given to save into; start with --out, or download it")
        self.out.mkdir(parents=True, exist_ok=True)
        with self.session.lock:
            state = self.session.state
            path = self.out / NAMES[what]
            if what == "report":
                return {"path": str(path), "words": self._report(state, path)}
            texts = {"rig": rig_text(state)}
            if what == "plan":
                texts["plan"] = plan_text(self.session.scene, state)
            for name, text in texts.items():
                write_bytes(self.out / NAMES[name], text.encode())
            self.session.history.saved()
        return {"path": str(path), "words": f"saved {path}"}

    def _report(self, state: RigState, path: Path) -> str:
        from rastercov.report.coverage import Options, run  # loads pyarrow

        if not state.on:
            raise ConfigError("there is no camera that is on; add one for a report")
        options = Options(method=self.session.measurements.method)
        run(self.session.scene.mesh, state.rig(), state.poses(), state.task, path, options)
        return f"a report of {plural(len(state.on), 'camera')} is in {path}"


def rig_text(state: RigState) -> str:
    """The rig as our own JSON: cameras, poses, and the names of the stations.

    Raises
    ------
    ConfigError
        For a rig without cameras.
    """
    if not state.stations:
        raise ConfigError("there is no camera to save; add one")
    return json.dumps(content_of(state.views())) + "\n"


def plan_text(scene: Scene, state: RigState) -> str:
    """A plan with the thresholds of a state, and the rig in `rig.json` as its only candidates."""
    entries: dict[str, Any] = {"meshes": list(scene.meshes)}
    if scene.plan is not None:
        entries = scene.plan.model_dump(exclude_unset=True, mode="json", exclude_none=True)
        for name in ("camera", "cameras", "rigs"):
            entries.pop(name, None)
    if not entries.get("meshes"):
        raise ConfigError("the mesh is of no file, so no plan can name it; save the rig")
    task, defaults = asdict(state.task), asdict(Task())
    own = {name: value for name, value in task.items() if value != defaults[name]}
    kept = {k: v for k, v in entries.get("task", {}).items() if k not in defaults}
    entries["task"] = kept | own
    if state.needed is not None:
        entries["task"]["views"] = dict(state.needed)
    cameras = content_of(state.views())["cameras"]
    entries["cameras"] = {each.pop("name"): each for each in cameras}
    entries["candidates"] = [{"generator": "poses", "file": NAMES["rig"]}]
    entries.setdefault("selection", {"goal": "best_coverage", "cameras": len(state.stations)})
    return toml_text(entries)


def toml_text(entries: Mapping[str, Any], path: tuple[str, ...] = ()) -> str:
    """A table as TOML: values, then tables, then lists of tables. None is left out."""
    lines: list[str] = []
    tables: list[str] = []
    for name, value in entries.items():
        if value is None:
            continue
        inner = (*path, name)
        key = ".".join(map(_quoted, inner))
        if isinstance(value, Mapping):
            tables.append(f"\n[{key}]\n{toml_text(value, inner)}")
        elif isinstance(value, list) and value and all(isinstance(e, Mapping) for e in value):
            tables += [f"\n[[{key}]]\n{toml_text(each, inner)}" for each in value]
        else:
            lines.append(f"{_quoted(name)} = {_value(value)}\n")
    return "".join([*lines, *tables])


def _quoted(name: str) -> str:
    is_bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if is_bare else _value(name)


def _value(value: Any) -> str:
    """A value as JSON has it except tables and numbers that are not finite."""
    if isinstance(value, float):
        return json.dumps(value).replace("Infinity", "inf").replace("NaN", "nan")
    if isinstance(value, str | int):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_quoted(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return f"{{{inside}}}"
    return "[" + ", ".join(_value(each) for each in value) + "]"


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
    scene = session.scene.described(is_kept=session.is_kept, can_edit=False)
    frames: dict[str, Any] = {}
    for mode in modes:
        try:
            head, levels = unframed(session.frame(mode, {}))
        except RastercovError:
            continue  # by exact area where a threshold is of a face
        frames[mode] = head | levels_of(levels)
    scene["modes"] = [each for each in scene["modes"] if each["id"] in frames]
    zones: list[Any] = session.zones() if "area" in frames else []
    state = session.described_state()
    data = {"scene": scene, "state": state, "frames": frames, "zones": zones}
    return embedded(session.scene.mesh, data)
