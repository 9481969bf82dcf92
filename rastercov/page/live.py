"""Live page, of the session of a viewer; see `rastercov.report.live`."""

from rastercov.base import ByName, ConfigError
from rastercov.core.area.network import unit_of_result
from rastercov.core.coverage.task import Engine
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene, describe_state
from rastercov.page.session import Session
from rastercov.placement.plan.network import limits_of
from rastercov.report import live
from rastercov.report.pages import with_live_data

MOST_CANDIDATES = 200
"""Poses of a plan that the page tries for the next camera."""


def record_cause(session: Session, state: RigState) -> str:
    """Reason for which a page of a rig is recorded and does not compute; "" where it does."""
    scene = session.scene
    others = {
        "results over time": scene.phases is not None,
        "results by face": _is_by_face(session, state),
    }
    goals = _goals(session)
    return live.record_cause(scene.mesh, state.whole, len(state.on), state.task, others, goals)


def _goals(session: Session) -> live.Goals | None:
    scene = session.scene
    return (
        live.Goals(scene.mesh, scene.task_mesh, scene.goals)
        if scene.task_mesh and scene.goals
        else None
    )


def _is_by_face(session: Session, state: RigState) -> bool:
    engine_of = Engine.of(session.method)
    if engine_of.method != "certified":
        return True
    try:
        unit = unit_of_result(session.scene.by, state.task, engine_of, None, 0)[0]
    except ConfigError:
        return True
    return unit == "face"


def live_page(session: Session, state: RigState) -> str:
    """Text of a live page of a rig; see `record_cause`."""
    entries = session.scene.describe()
    entries["modes"] = [each | {"options": []} for each in entries["modes"]]
    return with_live_data(_data(session, state, entries))


def open_live(session: Session) -> ByName:
    """Data that a served page opens, ready for JSON: the scene, its first rig, and the engine.

    `served` names the session, and says why the engine is not there and Python answers all.
    """
    scene = session.scene
    start, entries, why = scene.start, scene.describe(), record_cause(session, scene.start)
    if not why:
        data = _data(session, start, entries)
    else:
        entries["notes"] += [live.BY_PYTHON] * (why == live.NO_ENGINE)
        state = describe_state(scene, start) | live.describe_union(start.whole)
        data = live.describe_surface(scene.mesh) | {"state": state}
        data["goals"] = [{"name": each.name, "is_most": each.is_most} for each in scene.goals]
    data["candidates"] = _candidates(scene)
    own = {"session": session.name, "why": why, "has_places": scene.pool is not None}
    return data | {"scene": entries, "served": own}


def _data(session: Session, start: RigState, entries: ByName) -> ByName:
    """Data that a page computes a rig from."""
    scene, state, plan = session.scene, describe_state(session.scene, start), session.scene.plan
    limits = limits_of(plan.selection) if plan and plan.task.weight_by == "area" else {}
    entries["required"] = live.describe_limits(scene.task_mesh or scene.mesh, limits)
    return live.data_of(
        entries,
        {name: each for name, each in state.items() if name != "devices"}
        | live.describe_union(start.whole),
        scene.mesh,
        start.cameras,
        _candidates(session.scene, MOST_CANDIDATES),
        _goals(session),
    )


def _candidates(scene: Scene, most: int | None = None) -> dict[str, list[list[float]]]:
    """Poses of the candidates of a plan by camera; of more than `most` some at equal steps."""
    if scene.plan is None or scene.pool is None or not len(scene.pool.candidates):
        return {}
    mounts, table = scene.plan.mounts, {}
    placed = mounts.cameras(scene.pool.candidates.placed)[0]
    for row, name in enumerate(mounts.rig.names):
        own = placed.world_from_camera[placed.camera == row]
        step = 1 if most is None else -(-len(own) // most) or 1
        table[name] = own[::step].reshape(-1, 16).tolist()
    return {name: each for name, each in table.items() if each}
