"""Scenes that a viewer opens: a plan, a mesh with cameras, or the folder of a result."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rastercov.base.errors import ConfigError, PoseError
from rastercov.base.files import UnreadableError, printable, read_json
from rastercov.camera.camera import Camera
from rastercov.camera.formats import read_views
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Rig
from rastercov.camera.views import Views
from rastercov.coverage.provenance import sha256
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.placement.plan.candidates import candidate_pool
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.scene import named_scene
from rastercov.viewer.rig_state import RigState
from rastercov.viewer.scene import Scene

RESULTS = {
    "summary.json": ("evaluate", "Result of rastercov evaluate"),
    "plan.json": ("place", "Result of rastercov place"),
    "audit.json": ("audit", "Result of rastercov audit"),
}
"""File that marks the folder of each command's result; its kind, and words for it."""
RIGS = {"evaluate": "rig.json", "place": "poses.json", "audit": "rig.json"}
"""File of the cameras in each of them."""


def open_plan(path: Path, rig: Views | None = None) -> Scene:
    """Scene of a plan file, with the cameras of a rig where one is given.

    Raises
    ------
    PlanError
        With a line for everything that is wrong with the plan.
    PoseError
        For a rig of other cameras than the plan's.
    """
    plan = read_plan(path)
    mesh, plan, _ = named_scene(plan)
    pool = candidate_pool(plan, mesh) if plan.has_cameras else None
    cameras = plan.rig if plan.has_cameras else None
    if rig is not None:
        views = rig
        if rig.rig is None:
            if cameras is None:
                raise ConfigError(f"{plan.name} has no camera, nor has the rig; give one")
            named = bool(rig.camera_names)
            views = rig.with_cameras(cameras) if named else replace(rig, rig=cameras)
        start = _state(views, plan.build_task())
        # Cameras of the plan that the rig does not use may be added.
        for name, camera in zip(*_named(cameras), strict=True):
            if name not in start.cameras:
                start = start.with_camera(name, camera)
    elif cameras is None:
        raise ConfigError(f"{plan.name} has no camera; add one, or give --poses with cameras")
    else:
        start = RigState.of(cameras, Poses.of(np.zeros((0, 4, 4))), task=plan.build_task())
    if isinstance(plan.task.views, dict):
        start = replace(start, needed=dict(plan.task.views))
    return Scene(plan.name, mesh, start, plan, pool)


def open_mesh(
    mesh: Mesh, views: Views, task: Task, title: str, meshes: Sequence[Mapping[str, Any]] = ()
) -> Scene:
    """Scene of a mesh and cameras; `meshes` are entries of a plan for its files."""
    entries = tuple(dict(each) for each in meshes)
    return Scene(title, mesh, _state(views, task), meshes=entries, notes=views.notes)


def kind_of(folder: Path) -> str | None:
    """Kind of the result in a folder: "evaluate", "place", "audit"; None for another folder."""
    for name, (kind, _) in RESULTS.items():
        if (folder / name).is_file():
            return kind
    return None


def run_of(folder: Path) -> Mapping[str, Any]:
    """Provenance of the result in a folder; ConfigError where there is none."""
    name = next((name for name in RESULTS if (folder / name).is_file()), None)
    if name is None:
        known = ", ".join(RESULTS)
        raise ConfigError(f"{printable(str(folder))} is no result: it has none of {known}")
    content = _read(folder / name)
    run = content.get("run") or content.get("made_from") or {}
    if not isinstance(run, Mapping) or "scene" not in run:
        raise ConfigError(f"{folder / name} does not say what it is of; make it again")
    return run


def open_result(folder: Path, load: Callable[[list[str]], Mesh]) -> Scene:
    """Scene of the folder of a result.

    Parameters
    ----------
    folder : Path
        Of `evaluate`, `place` or `audit`.
    load : callable
        Gives the mesh; called with the names of its files.

    Raises
    ------
    ConfigError
        For another folder, one without its cameras, and a mesh that is not that of the result.
    """
    run = run_of(folder)
    kind, title = next(each for name, each in RESULTS.items() if (folder / name).is_file())
    files = [str(each["name"]) for each in run.get("mesh", ())]
    mesh = _with_roles(load(files), run["scene"])
    before = {(each["name"], each.get("sha256")) for each in run.get("mesh", ())}
    for now in mesh.sources:
        if now.name in files and (now.name, now.sha256) not in before:
            raise ConfigError(
                f"{now.name} is not the file that {folder} was made of; make it again, or name "
                "that file after the folder"
            )
    if sha256(mesh.vertices, mesh.faces, mesh.face_group) != run["scene"]["sha256"]:
        other = f"; or give the plan, with --poses {folder / RIGS[kind]}" if kind == "place" else ""
        raise ConfigError(
            f"the mesh is not that of {folder}: {', '.join(files)}, with its --unit and "
            f"--transform, is wanted{other}"
        )
    rig_file = folder / RIGS[kind]
    if not rig_file.is_file():
        raise ConfigError(f"{rig_file} is missing: a result of many poses has none; give --poses")
    views = read_views(rig_file)
    if views.rig is None:
        rig = _cameras(run)
        named = bool(views.camera_names)
        views = views.with_cameras(rig) if named else replace(views, rig=rig)
    task = Task(**{k: v for k, v in run.get("task", {}).items() if k in Task.__dataclass_fields__})
    words = f"{title} in {folder}"
    return Scene(
        folder.resolve().name, mesh, _state(views, task), result={"kind": kind, "words": words}
    )


def _read(path: Path) -> Mapping[str, Any]:
    try:
        content = read_json(path)
    except UnreadableError as error:
        raise ConfigError(f"{printable(str(path))}: {error}") from None
    if not isinstance(content, Mapping):
        raise ConfigError(f"{printable(str(path))} is no result; make it again")
    return content


def _with_roles(mesh: Mesh, scene: Mapping[str, Any]) -> Mesh:
    """The mesh with the groups' roles of a result; as it is where it has other groups."""
    groups = scene.get("groups", ())

    def named(role: str) -> list[str]:
        return [str(group["name"]) for group in groups if group.get(role)]

    if [group.name for group in mesh.groups] != [str(group["name"]) for group in groups]:
        return mesh  # another mesh, which its hash tells
    return mesh.with_groups(named("is_occluder"), named("is_two_sided"), named("is_target"))


def _cameras(run: Mapping[str, Any]) -> Rig:
    """Cameras that a result was made with."""
    if "camera" in run:
        return Rig([Camera.from_dict(run["camera"])], ["camera"])
    entries = [dict(each) for each in run.get("cameras", ())]
    names = [str(each.pop("name", f"camera {row}")) for row, each in enumerate(entries)]
    return Rig([Camera.from_dict(each) for each in entries], names)


def _named(rig: Rig | None) -> tuple[tuple[str, ...], tuple[Camera, ...]]:
    return ((), ()) if rig is None else (rig.names, rig.cameras)


def _state(views: Views, task: Task) -> RigState:
    """State of views; names of images are those of the stations where all differ."""
    if views.rig is None:
        raise PoseError("there are poses and no camera; give a camera as well")
    names = views.images if len(set(views.images)) == len(views.poses) and all(views.images) else ()
    return RigState.of(views.rig, views.poses, names, task)
