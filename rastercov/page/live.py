"""Live page, of the session of a viewer; see `rastercov.report.live`."""

from rastercov.base.errors import ConfigError
from rastercov.core.area.network import unit_of_result
from rastercov.core.coverage.engine import Engine
from rastercov.page.session import Session
from rastercov.placement.plan.network import limits_of
from rastercov.report import live

MOST_CANDIDATES = 200
"""Poses of a plan that the page tries for the next camera."""


def why_recorded(session: Session) -> str:
    """Reason for which a page of a session is recorded and does not compute; "" where it does."""
    scene, state = session.scene, session.state
    others = {
        "results over time": scene.phases is not None,
        "results by face": _is_by_face(session),
    }
    goals = _goals(session)
    return live.why_recorded(scene.mesh, state.whole, len(state.on), state.task, others, goals)


def _goals(session: Session) -> live.Goals | None:
    scene = session.scene
    return (
        live.Goals(scene.mesh, scene.task_mesh, scene.goals)
        if scene.task_mesh and scene.goals
        else None
    )


def _is_by_face(session: Session) -> bool:
    engine_of = Engine.of(session.measurements.method)
    if engine_of.method != "certified":
        return True
    try:
        unit = unit_of_result(session.scene.by, session.state.task, engine_of, None, 0)[0]
    except ConfigError:
        return True
    return unit == "face"


def live_page(session: Session) -> str:
    """Text of a live page; see `why_recorded`."""
    scene, state = session.scene, session.described_state()
    entries = scene.described(is_kept=False, can_edit=True)
    entries["modes"] = [each | {"options": []} for each in entries["modes"]]
    names, needed = ("stations", "cameras", "task"), session.state.needed
    plan = scene.plan
    limits = limits_of(plan.selection) if plan and plan.task.weight_by == "area" else {}
    entries["required"] = live.described_limits(scene.task_mesh or scene.mesh, limits)
    return live.page_of(
        entries,
        {name: state[name] for name in names}
        | {"needed": needed and dict(needed)}
        | live.described_together(session.state.whole),
        scene.mesh,
        session.state.cameras,
        session.state.whole.tasks,
        _candidates(session),
        _goals(session),
    )


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
