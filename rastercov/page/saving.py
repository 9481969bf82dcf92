"""Files that a viewer saves: rig and thresholds, as its page writes them; report, or a page."""

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from rastercov.base import (
    ByName,
    ConfigError,
    RastercovError,
    ReadByName,
    UnreadableError,
    check_choice,
    check_place,
    one_line,
    own_folder,
    plural,
    read_json,
    write_bytes,
    write_json,
    write_text,
)
from rastercov.base.output import name_folder
from rastercov.page.actions import MOST_OF_DRAWING, Drawing, Of, check_entries
from rastercov.page.live import live_page, record_cause
from rastercov.page.rig_state import RigState
from rastercov.page.scene import OF_A_RIG, describe_state
from rastercov.page.session import Session, Stations, remove_head
from rastercov.report.feature import MOST_LEVELS
from rastercov.report.pages import embed_scene, levels_of

NAMES = {"rig": "rig.json", "task": "task.toml"}
DRAWING = "viewer_drawing.json"
"""Drawing under the floor plan."""
MODES = tuple(name for name in OF_A_RIG if name != "single")
"""Ways to colour the faces that the file has, but those that the thresholds do not allow."""


class Save(Of):
    """Request of a page for files of its rig; `texts` are those that it has written."""

    what: Literal["rig", "report", "page"]
    texts: dict[Literal["rig", "task"], str] = Field(default_factory=dict)


class Saving:
    """Saves the rigs of the pages of a session.

    Parameters
    ----------
    session : Session
    out : Path, optional
        Folder for the files; without one they can be downloaded only.
    """

    def __init__(self, session: Session, out: Path | None = None) -> None:
        self.session, self.out = session, out

    def _read_question(self, entries: ReadByName, *known: str) -> tuple[Save, RigState]:
        asked = check_entries(Save, entries)
        check_choice("what", asked.what, known)
        return asked, self.session.take(asked.rig, asked.at, asked.goal).state

    def content(self, entries: ReadByName) -> bytes:
        """A page that needs no server."""
        with self.session.lock:
            return page_of(self.session, self._read_question(entries, "page")[1]).encode()

    def save(self, entries: ReadByName) -> dict[str, str]:
        """Save the rig with its thresholds, or a report.

        Gives the place, and words on it.

        Raises
        ------
        ConfigError
            For anything else, and where no folder was given.
        """
        if self.out is None:
            raise ConfigError(
                "expected a folder to save to, got none; start with --out, or download"
            )
        with self.session.lock:
            asked, state = self._read_question(entries, "rig", "report")
            name_folder(self.out)
            if asked.what == "report":
                path = own_folder(self.out / "report")
                return {"path": str(path), "words": self._report(state, path)}
            drawing, path = self.session.drawing, self.out / NAMES["rig"]
            if not asked.texts and drawing is None:
                raise ConfigError("expected a camera to save, got none; add one")
            for name, text in asked.texts.items():
                write_bytes(self.out / NAMES[name], text.encode())
            if asked.texts:
                for word, each in state.whole.equipment.items():
                    write_json(self.out / f"{word}.json", each.to_json())
            if drawing is not None or (self.out / DRAWING).is_file():
                path = path if asked.texts else self.out / DRAWING
                content = None if drawing is None else drawing.model_dump()
                own = {"scene": self.session.scene.title, "drawing": content}
                write_bytes(self.out / DRAWING, json.dumps(own).encode())
        n_off = len(state.stations) - len(state.on)
        off = f"; commands count the cameras that are off here, too ({n_off})" if n_off else ""
        return {"path": str(path), "words": f"saved {path}{off}"}

    def _report(self, state: RigState, path: Path) -> str:
        from rastercov.report.coverage import Options, run  # loads pyarrow

        if not state.on:
            raise ConfigError("expected a camera that is on, got none; add one")
        if state.unit != "m":
            raise ConfigError("expected lengths in metres, got no scale; use rastercov audit")
        state.check_whole(state.on)
        scene, poses = self.session.scene, state.poses()
        options = Options(method=self.session.method, sheet=scene.sheet.words())
        rig = state.rig(poses)
        phases = scene.phases_with(rig)
        asked = None if phases is None else phases.asked
        run(scene.mesh, rig, poses, state.task, path, options, phases=asked)
        return f"wrote a report of {plural(len(state.on), 'camera')} to {path}"


def with_drawing(session: Session, folders: Sequence[Path]) -> Session:
    """The session with the drawing of its scene in the first of some folders that has it.

    Raises
    ------
    ConfigError
        For a drawing that is damaged.
    """
    for path in (folder / DRAWING for folder in folders):
        if session.drawing is None and path.is_file():
            try:
                content = read_json(path, 2 * MOST_OF_DRAWING)
                if content["scene"] == session.scene.title and content["drawing"]:
                    session.drawing = check_entries(Drawing, content["drawing"])
            except (RastercovError, UnreadableError, LookupError, TypeError) as error:
                fault = (
                    f"{path}: expected a drawing of the viewer, got {one_line(error)}; remove it"
                )
                raise ConfigError(fault) from None
    return session


def export_page(session: Session, path: str | Path, *, is_still: bool = True) -> Path:
    """Write a page that needs no server.

    Parameters
    ----------
    session : Session
        What it shows.
    path : str or Path
        The file, .html.
    is_still : bool
        Figures are recorded; else the page computes them, where it can: see `live.record_cause`.

    Raises
    ------
    ConfigError
        For a file of another suffix.
    ResourceError
        For more than `MOST_FACES` faces.
    """
    check_name(path)
    state = session.scene.start
    write_text(path, export_state(session, state) if is_still else page_of(session, state))
    return Path(path)


def page_of(session: Session, state: RigState) -> str:
    """Text of a page that computes, or of recorded figures that says why it does not."""
    if why := record_cause(session, state):
        return export_state(session, state, [why])
    return live_page(session, state)


def check_name(path: str | Path) -> None:
    """Raise `ConfigError` unless a file is named as a page."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise ConfigError(f"expected an .html file, got {path}; rename it")
    check_place(Path(path))


def export_state(session: Session, state: RigState, notes: Sequence[str] = ()) -> str:
    """Text of a page of recorded figures; ResourceError for more than `MOST_FACES` faces."""
    scene = session.scene.describe(can_edit=False)
    scene["notes"] += notes
    own = [each for each in scene["modes"] if each["id"] in MODES]
    frames: ByName = {}
    phases = session.scene.phases
    n = 0 if phases is None else phases.count
    if phases is not None and n * len(own) * scene["n_faces"] > MOST_LEVELS:
        n = 0
        scene = {name: each for name, each in scene.items() if name not in phases.describe()}
    times: list[tuple[float, ...]] = [(row,) for row in range(n)] or [()]
    known = set()
    for at, mode in product(times, (each["id"] for each in own)):
        with session.lock:
            asked = session.of(state, at)
            try:
                head, levels = remove_head(asked.answer("frame", mode=mode))
            except RastercovError:
                continue  # by exact area where a threshold is of a face
            known.add(mode)
            head["state"] = _record_figures(session, asked)
            frames["@".join((mode, *map(str, at)))] = head | levels_of(levels)
    asked = session.of(state, times[0])
    zones: list[Any] = asked.answer("zones") if "area" in frames else []
    scene["modes"] = [each for each in own if each["id"] in known]
    data = {
        "scene": scene,
        "state": _record_figures(session, asked),
        "frames": frames,
        "zones": zones,
    }
    return embed_scene(session.scene.mesh, data)


def _record_figures(session: Session, asked: Stations) -> ByName:
    """The rig of a page of recorded figures at a time."""
    own = {"revision": 0, "at": asked.moment.at, "goal": ""}
    return describe_state(session.scene, asked.state, asked.shown) | own
