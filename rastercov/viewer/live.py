"""Page that computes: the engine as WebAssembly, the mesh and the rig in one file.

Its modules are those of `page/live*.js`; `make wasm` compiles the engine, and a wheel has it. What
the page cannot compute, such as equipment, is shown as it was recorded.
"""

import zlib
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.errors import ConfigError
from rastercov.base.format import base64_of
from rastercov.camera.camera import Camera
from rastercov.coverage.advice import general_advice
from rastercov.coverage.area.network import unit_of_result
from rastercov.coverage.engine import Engine
from rastercov.coverage.reasons import NAMES
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.unseeable import unseeable_areas
from rastercov.report import theme
from rastercov.report.modes import by_level, by_reason, by_share
from rastercov.report.pages import bundled, soup_origin, with_live_data
from rastercov.viewer.rig_state import RigState
from rastercov.viewer.session import Session

MOST_FACES = 300_000
"""Faces of a page that computes: a drag of one camera takes half a second."""
MOST_CANDIDATES = 200
"""Poses of a plan that the page tries for the next camera."""
PLACEMENT = {
    "is_by_plan": False,
    "cameras": 4,
    "words": "one by one, each where it adds most",
    "tries": 120,
}
"""The page's way to place cameras, see `page/live_jobs.js`."""
ENGINE = "engine.wasm"
NO_ENGINE = "the page shows recorded figures: this checkout has no engine.wasm; run make wasm"
COLOURS = 64
"""Colours of cameras, which begin again after the last."""


def engine() -> bytes | None:
    """The engine as WebAssembly; None in a checkout that has not compiled it."""
    place = files("rastercov.viewer") / "page" / ENGINE
    return place.read_bytes() if place.is_file() else None


def why_recorded(session: Session) -> str:
    """Reason for which a page of a session is recorded and does not compute; "" where it does."""
    scene, state = session.scene, session.state
    if engine() is None:
        return NO_ENGINE
    if scene.mesh.n_faces > MOST_FACES:
        return f"the page shows recorded figures: {scene.mesh.n_faces:,} faces of {MOST_FACES:,}"
    has_own = {
        **dict.fromkeys(state.whole.equipment, True),
        "a scene of several phases": scene.phases is not None,
        "goals of the plan": bool(scene.goals),
        "the rule of a rig": bool(state.whole.gates),
        "angles between views": state.task.min_angle_deg > 0,
        "whole faces": _is_by_face(session),
        "pixels per square metre of this lens": state.task.min_pixels_per_m2 > 0
        and any(_has_closed_form(each) for each in state.cameras.values()),
    }
    found = next((name for name, has_it in has_own.items() if has_it), "")
    return f"the page shows recorded figures: it does not compute {found}" if found else ""


def _is_by_face(session: Session) -> bool:
    engine_of = Engine.of(session.measurements.method)
    if engine_of.method != "certified":
        return True
    try:
        unit = unit_of_result(session.scene.by, session.state.task, engine_of, None, 0)[0]
    except ConfigError:
        return True
    return unit == "face"


def _has_closed_form(camera: Camera) -> bool:
    from rastercov.coverage.area.regions import _has_closed_form as has_closed_form

    return has_closed_form(camera)


def live_page(session: Session) -> str:
    """Text of a page that computes; see `why_recorded`."""
    scene, state, mesh = session.scene, session.described_state(), session.scene.mesh
    entries = scene.described(is_kept=False, can_edit=True)
    entries |= {"catalogue": [], "constraints": {}, "placement": PLACEMENT}
    entries["modes"] = [each | {"options": []} for each in entries["modes"]]
    lenses: dict[str, str] = {}
    for name, camera in session.state.cameras.items():
        own = state["cameras"][name]
        own["task"] = _thresholds(session.state, name)
        if not camera.is_pinhole:
            from rastercov.viewer.packed_lens import packed

            own["lens"] = name
            lenses[name] = _deflated(packed(camera))
    names = ("stations", "cameras", "task")
    needed = session.state.needed
    data = {
        "scene": entries,
        "state": {name: state[name] for name in names}
        | {"needed": None if needed is None else dict(needed)},
        "engine": _deflated(np.frombuffer(engine() or b"", np.uint8)),
        "worker": bundled("live_worker") + "live_worker_js.listen(self);\n",
        "mesh": _surface(mesh),
        "lenses": lenses,
        "origin": soup_origin(mesh).tolist(),
        "colours": _colours(mesh),
        "advice": {name: general_advice(name) for name in NAMES},
        "candidates": _candidates(session),
        "densityUnit": f"px/{session.state.unit}",
        "defaults": _defaults(),
    }
    return with_live_data(data)


def _candidates(session: Session) -> dict[str, list[list[float]]]:
    """Poses of the candidates of a plan by camera, at equal steps of many."""
    scene = session.scene
    if scene.plan is None or scene.pool is None or not len(scene.pool.candidates):
        return {}
    mounts = scene.plan.mounts
    placed = mounts.cameras(scene.pool.candidates.placed)[0]
    found = {}
    for row, name in enumerate(mounts.rig.names):
        own = placed.world_from_camera[placed.camera == row]
        step = -(-len(own) // MOST_CANDIDATES) or 1
        found[name] = own[::step].reshape(-1, 16).tolist()
    return {name: each for name, each in found.items() if each}


def _defaults() -> dict[str, Any]:
    return {name: getattr(Task(), name) for name in Task.__dataclass_fields__}


def _thresholds(state: RigState, camera: str) -> dict[str, Any] | None:
    """Thresholds that a camera has for itself."""
    own = state.whole.tasks.get(camera)
    return None if own is None else {name: getattr(own, name) for name in Task.__dataclass_fields__}


def _surface(mesh: Mesh) -> dict[str, Any]:
    """Vertices, faces, groups, roles of groups, and faces that are never seen."""
    roles = [each.is_occluder + 2 * each.is_target + 4 * each.is_two_sided for each in mesh.groups]
    areas = unseeable_areas(mesh)
    return {
        "vertices": _deflated(np.asarray(mesh.vertices, "<f8")),
        "faces": _deflated(np.asarray(mesh.faces, "<i4")),
        "groups": _deflated(np.asarray(mesh.face_group, "<u2")),
        "roles": roles,
        "unseeable": [[face, float(areas[face])] for face in np.flatnonzero(areas).tolist()],
    }


def _colours(mesh: Mesh) -> dict[str, Any]:
    """Palettes of the modes that the page paints."""
    nothing = np.zeros(mesh.n_faces)
    return {
        "scale": base64_of(by_share(mesh, nothing).palette.tobytes()),
        "reasons": base64_of(by_reason(mesh, np.zeros(mesh.n_faces, np.uint8)).palette.tobytes()),
        "levels": base64_of(by_level(mesh, nothing).palette.tobytes()),
        "hatches": theme.REASON_HATCHES.tolist(),
        "cameraColours": theme.camera_colours(COLOURS).tolist(),
        "uncovered": list(theme.UNCOVERED),
        "occluder": list(theme.OCCLUDER_PALE),
    }


def _deflated(values: ArrayLike) -> str:
    """Bytes of an array as base64 of zlib, whose checksum tells damage."""
    return base64_of(zlib.compress(np.ascontiguousarray(values).tobytes(), 9))
