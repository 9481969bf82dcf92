"""Reason of one face: what each camera gets of it, what hides it, and what would help."""

import math
from typing import Any

import numpy as np

from rastercov.base.errors import ConfigError
from rastercov.base.format import area, length, percent, plural
from rastercov.camera.camera import Camera
from rastercov.coverage.coverage import Coverage, evaluate_batches
from rastercov.coverage.job import evaluate
from rastercov.coverage.reasons import NAMES, REASONS
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Mesh
from rastercov.placement.uncovered import in_front
from rastercov.viewer.measurements import Measurements, NetworkFigures, of_one_camera
from rastercov.viewer.rig_state import RigState, Station

OF_THE_SCENE = ("coverage", "reason", "visibility", "visibility_bound")
"""Figures that depend on what hides the face."""


def why(measurements: Measurements, figures: NetworkFigures, face: int) -> dict[str, Any]:
    """Reason of a face in each camera that is on, ready for JSON.

    `cameras` are in the order of the stations; `occluder` is the group that hides most of the
    face's image (`rastercov.placement.uncovered`), where the face is hidden.

    Raises
    ------
    ConfigError
        For a face that does not exist.
    """
    mesh = measurements.mesh
    if not 0 <= face < mesh.n_faces:
        raise ConfigError(f"face must be 0 to {mesh.n_faces - 1}, got {face}")
    state, group = figures.state, mesh.groups[mesh.face_group[face]]
    found = {
        "face": face,
        "group": group.name,
        "area": float(mesh.areas[face]),
        "centre": mesh.centroids[face].tolist(),
        "normal": mesh.normals[face].tolist(),
        "words": _words(mesh, figures, face),
        "cameras": [],
    }
    if group.is_occluder:
        return found
    alone = _alone(mesh, face)
    found["cameras"] = [
        _of_station(measurements, alone, state, station, face) for station in state.on
    ]
    return found


def _alone(mesh: Mesh, face: int) -> Mesh:
    """The face as a mesh of its own, for figures that do not depend on what hides it."""
    return Mesh(
        vertices=mesh.vertices[mesh.faces[face]],
        faces=[[0, 1, 2]],
    ).with_groups(two_sided="all" if mesh.two_sided_mask[face] else ())


def _words(mesh: Mesh, figures: NetworkFigures, face: int) -> str:
    """One line on the face."""
    size = area(float(mesh.areas[face]))
    if not mesh.task_mask[face]:
        return f"An occluder, {size}: it hides, and is not to be covered."
    views, task = int(figures.views[face]), figures.state.task
    if figures.covered[face]:
        return f"Covered by {plural(views, 'camera')}, {size}."
    if not figures.rows:
        return f"Not covered, {size}: there are no cameras."
    if views:
        asked = plural(int(figures.need[face]), "camera")
        if task.min_angle_deg > 0:
            asked += f" that differ by {task.min_angle_deg:g} deg"
        return f"Not covered, {size}: by {views} of {asked}."
    return f"Not covered, {size}: at best {REASONS[NAMES[figures.reasons[face]]].label}."


def _of_station(
    measurements: Measurements, alone: Mesh, state: RigState, station: Station, face: int
) -> dict[str, Any]:
    """Figures of the face in one camera."""
    mesh, camera, task = measurements.mesh, state.camera_of(station), of_one_camera(state.task)
    single = evaluate(alone, camera, station.pose[None], task)
    whole = next(
        evaluate_batches(
            measurements.observer(camera), station.pose[None], task, fields=OF_THE_SCENE
        )
    )
    reason = Reason(int(whole.reason[0, face]))
    depth = (mesh.vertices[mesh.faces[face]] - station.pose[:3, 3]) @ station.pose[:3, 2]
    words, occluder = REASONS[reason.name.lower()].label, None
    if reason == Reason.OCCLUDED:
        occluder = _occluder(mesh, station, face)
    if occluder is not None:
        own = occluder["group"] == mesh.face_group[face]
        by = "its own group" if own else occluder["name"]
        words = f"hidden by {by}: {percent(occluder['share'])} of its image"
    visible, bound = float(whole.visibility[0, face]), float(whole.visibility_bound[0, face])
    entries = {
        "visible part": f"{percent(visible)} ± {100 * bound:.1g} %",
        "coverage": f"{float(whole.coverage[0, face]):.3g}",
        "pixels if nothing hides it": f"{float(single.drawn_pixels[0, 0]):.3g} px",
        "angle of incidence": f"{math.degrees(float(single.incidence[0, 0])):.3g} deg",
        "pixel density": f"{float(single.pixel_density[0, 0]):.4g} px/m",
        "depth": f"{length(float(depth.min()))} to {length(float(depth.max()))} m",
        "in the image": percent(float(single.in_view_fraction[0, 0])),
    }
    return {
        "station": station.id,
        "name": station.name,
        "reason": reason.name.lower(),
        "words": words,
        "help": _help(reason, single, task, depth, occluder, camera),
        "figures": [{"label": label, "value": value} for label, value in entries.items()],
        "occluder": occluder,
    }


def _finer(single: Coverage, task: Task) -> tuple[str, str]:
    """What a face gets by the threshold that is farthest off, and the factor that is missing."""
    pixels = float(single.drawn_pixels[0, 0])
    densities = (
        (float(single.pixel_density[0, 0]), task.min_pixel_density),
        (float(single.facing_density[0, 0]), task.min_facing_density),
    )
    # Lengths in the image grow with the focal length and with nearness, areas with their squares.
    wanted = [(math.sqrt(task.min_pixels / pixels), f"{pixels:.3g} of {task.min_pixels:g} px")] * (
        0 < pixels < task.min_pixels
    )
    wanted += [
        (least / found, f"{found:.3g} of {least:g} px/m")
        for found, least in densities
        if 0 < found < least
    ]
    factor, words = max(wanted, default=(0.0, ""))
    return words, f"{factor:.2g} times"


def _occluder(mesh: Mesh, station: Station, face: int) -> dict[str, Any] | None:
    """Group that hides most of the face's image; None where nothing is found before it."""
    shares = in_front(mesh, station.pose[None, :3, 3], np.array([face]))[0]
    group = int(shares.argmax())
    if shares[group] <= 0:
        return None
    return {"group": group, "name": mesh.groups[group].name, "share": float(shares[group])}


def _help(
    reason: Reason,
    single: Coverage,
    task: Task,
    depth: np.ndarray[Any, Any],
    occluder: dict[str, Any] | None,
    camera: Camera,
) -> str:
    """Advice for a camera to cover the face: that of `REASONS` with the figures of the face."""
    z_n, z_f = camera.depth_of_field(task.max_blur)
    finer, times = _finer(single, task)
    if reason == Reason.TOO_COARSE and not finer:
        return "come nearer, or take a longer lens"
    return REASONS[reason.name.lower()].advice.format(
        wider=", or take a wider lens" if (depth > 0).all() else "",
        depth=f"{length(float(depth.min()))} to {length(float(depth.max()))} m",
        in_focus=f"{length(float(z_n))} m to "
        + ("any depth" if math.isinf(z_f) else f"{length(float(z_f))} m"),
        finer=finer,
        times=times,
        hider="what is before it" if occluder is None else occluder["name"],
        angle=f"{math.degrees(float(single.incidence[0, 0])):.3g}",
        max_angle=f"{task.max_incidence_deg:g}",
    )
