"""Scene of a viewer: a mesh, the cameras to begin with, and the plan or result they are of."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

import rastercov
from rastercov.base.arguments import annotations_of, documented, metadata_of
from rastercov.camera.camera_file import PRESETS
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.models import MODELS
from rastercov.placement.candidates.clearance import KeepOutBox, in_solid
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.viewer import lens
from rastercov.viewer.colours import NETWORK_MODES
from rastercov.viewer.improve import default_space
from rastercov.viewer.rig_state import RigState

if TYPE_CHECKING:
    from rastercov.placement.plan.candidates import CandidatePool
    from rastercov.placement.plan.file import Plan

UNITS = {
    "min_pixels": "px", "max_blur": "px", "max_incidence_deg": "deg", "min_angle_deg": "deg",
    "min_pixel_density": "px/m", "min_facing_density": "px/m", "min_pixels_per_m2": "px/m²",
}  # fmt: skip
"""Units of thresholds."""
SEGMENT_OPTIONS: tuple[dict[str, Any], ...] = (
    {"name": "alpha_deg", "words": "Largest angle between two normals of a segment, (6.1).",
     "kind": "float", "low": 0.0, "high": 89.0, "choices": None, "default": 30.0,
     "is_optional": False, "unit": "deg"},
    {"name": "beta_deg", "words": "Largest angle between segments that are merged, (6.3).",
     "kind": "float", "low": 0.0, "high": 89.0, "choices": None, "default": 10.0,
     "is_optional": False, "unit": "deg"},
)  # fmt: skip
MODEL_OPTIONS: tuple[dict[str, Any], ...] = (
    {"name": "model", "words": "Coverage model of the literature, or ours.",
     "kind": "choice", "low": None, "high": None, "choices": list(MODELS),
     "default": "image_space", "is_optional": False, "unit": ""},
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Scene:
    """Mesh and context of a viewer.

    Attributes
    ----------
    title : str
    mesh : Mesh
    start : RigState
        Cameras and thresholds to begin with.
    plan : Plan or None
    pool : CandidatePool or None
        Candidates of the plan and its constraints, where it has any.
    meshes : tuple of dict
        Entries of a plan for the files of the mesh, where there is no plan.
    result : dict or None
        Kind of a result folder that was opened, and words on it.
    notes : tuple of str
        What was read and could not be kept.
    """

    title: str
    mesh: Mesh
    start: RigState
    plan: "Plan | None" = None
    pool: "CandidatePool | None" = None
    meshes: tuple[dict[str, Any], ...] = ()
    result: dict[str, str] | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def has_constraints(self) -> bool:
        """True where a plan limits the places of cameras."""
        if self.plan is None:
            return False
        limits = self.plan.constraints
        return bool(
            limits.spaces or limits.keep_out or limits.clearance or limits.stand_off or self.pool
        )

    def space(self, state: RigState) -> PoseSpace:
        """Allowed places of cameras: by the plan, or around the mesh."""
        return default_space(self.mesh, state) if self.pool is None else self.pool.space

    def described(self, *, is_kept: bool, can_edit: bool = True) -> dict[str, Any]:
        """Everything of the scene that does not change, ready for JSON."""
        mesh, firsts = self.mesh, _first_faces(self.mesh)
        faces = np.bincount(mesh.face_group, minlength=len(mesh.groups))
        return {
            "title": self.title,
            "version": rastercov.__version__,
            "n_faces": mesh.n_faces,
            "n_vertices": mesh.n_vertices,
            "bounds": np.asarray(mesh.bounds).tolist(),
            "up": [0.0, 0.0, 1.0],
            "is_room": self.is_room,
            "groups": [
                {
                    "name": group.name, "role": group.role, "is_two_sided": group.is_two_sided,
                    "faces": int(faces[row]), "first": firsts[row],
                }
                for row, group in enumerate(mesh.groups)
            ],
            "task_fields": task_fields(),
            "camera_fields": [
                each | {"low": lens.LIMITS[each["name"]][0], "high": lens.LIMITS[each["name"]][1]}
                for each in lens.FIELDS
            ],
            "presets": list(PRESETS),
            "modes": modes(),
            "constraints": self._constraints() | {"is_kept": is_kept},
            "can_edit": can_edit,
            "result": self.result,
            "notes": list(self.notes),
        }  # fmt: skip

    @property
    def is_room(self) -> bool:
        """True where most cameras are within the mesh, or its closed surface holds all of it."""
        low, high = np.asarray(self.mesh.bounds)
        eyes = np.array([each.pose[:3, 3] for each in self.start.stations]).reshape(-1, 3)
        if len(eyes) and ((eyes > low) & (eyes < high)).all(axis=1).mean() > 0.5:
            return True
        beyond = high + (high - low) + 1.0
        return bool(in_solid(self.mesh, beyond[None])[0])

    def soup(self) -> tuple[NDArray[np.float64], bytes]:
        """Origin (3,), and corners of each face relative to it, F x 9 float32."""
        origin = np.asarray(self.mesh.bounds).mean(axis=0)
        corners = self.mesh.vertices[self.mesh.faces] - origin
        return origin, corners.astype("<f4").tobytes()

    def groups(self) -> bytes:
        """Group of each face, F uint16."""
        return bytes(self.mesh.face_group.astype("<u2").tobytes())

    def _constraints(self) -> dict[str, Any]:
        if self.plan is None or self.pool is None:
            return {"boxes": [], "keep_out": []}
        boxes = np.asarray(self.pool.space.boxes).tolist() if self.has_constraints else []
        volumes = []
        for entry in self.plan.constraints.keep_out:
            volume = entry.volume()
            if isinstance(volume, KeepOutBox):
                corners = [list(map(float, volume.low)), list(map(float, volume.high))]
                volumes.append({"name": entry.name, "box": corners})
            else:
                centre = list(map(float, volume.centre))
                volumes.append({"name": entry.name, "centre": centre, "radius": volume.radius})
        return {"boxes": boxes, "keep_out": volumes}


def modes() -> list[dict[str, Any]]:
    """Ways to colour the faces, in the order of a page."""
    found = [
        {"id": name, "label": label, "words": words, "panel": "network", "options": []}
        for name, (label, words, _) in NETWORK_MODES.items()
    ]
    return [
        *found,
        {"id": "area", "label": "Exact area", "panel": "network", "options": [],
         "words": "Share of the exact area of each face that is covered."},
        {"id": "model", "label": "Model", "panel": "network", "options": list(MODEL_OPTIONS),
         "words": "Greatest coverage by any camera, by a model of the literature."},
        {"id": "single", "label": "One camera", "panel": "camera", "options": [],
         "words": "Coverage by the chosen camera: grey in proportion to it."},
        {"id": "segments", "label": "Segments", "panel": "object",
         "options": list(SEGMENT_OPTIONS), "words": "Segments by normals, (6.1) to (6.3)."},
    ]  # fmt: skip


def task_fields() -> list[dict[str, Any]]:
    """Thresholds of a task with their limits, for sliders."""
    words, default, found = documented(Task), Task(), []
    for name, hint in annotations_of(Task).items():
        if name not in words:
            continue
        limits = metadata_of(hint)
        members = get_args(hint) if type(None) in get_args(hint) else ()
        inner = members[0] if members else hint
        kind = get_args(inner)[0] if get_origin(inner) is not Literal else inner
        is_choice = get_origin(kind) is Literal
        # Ignored types: annotated_types declares limits as anything that can be compared.
        low = next((float(e.ge) for e in limits if isinstance(e, Ge)), None)  # type: ignore[arg-type]
        if low is None:
            low = next((float(e.gt) for e in limits if isinstance(e, Gt)), None)  # type: ignore[arg-type]
        high = next((float(e.le) for e in limits if isinstance(e, Le)), None)  # type: ignore[arg-type]
        found.append(
            {
                "name": name,
                "words": words[name],
                "kind": "choice" if is_choice else kind.__name__,
                "low": low,
                "is_low_open": any(isinstance(e, Gt) for e in limits),
                "high": high,
                "choices": list(get_args(kind)) if is_choice else None,
                "default": getattr(default, name),
                "is_optional": bool(members),
                "unit": UNITS.get(name, ""),
            }
        )
    return found


def _first_faces(mesh: Mesh) -> list[int]:
    """First face of each group, -1 for one without faces."""
    firsts = np.full(len(mesh.groups), -1, np.int64)
    group, first = np.unique(mesh.face_group, return_index=True)
    firsts[group] = first
    found: list[int] = firsts.tolist()
    return found


def described_state(scene: Scene, state: RigState, history: dict[str, Any]) -> dict[str, Any]:
    """The state of a rig, ready for JSON; `place` of a station is the constraint it violates."""
    eyes = np.array([each.pose[:3, 3] for each in state.stations]).reshape(-1, 3)
    places = ["allowed"] * len(eyes)
    if scene.pool is not None and len(eyes):
        from rastercov.placement.improve.pose_space import Place

        judged = scene.pool.space.judge(eyes)
        places = [Place(code).name.lower().replace("_", " ") for code in judged.tolist()]
    return history | {
        "stations": [
            {
                "id": each.id, "name": each.name, "camera": each.camera,
                "pose": each.pose.ravel().tolist(), "is_on": each.is_on, "place": place,
            }
            for each, place in zip(state.stations, places, strict=True)
        ],
        "cameras": {name: lens.described(camera) for name, camera in state.cameras.items()},
        "task": {each["name"]: getattr(state.task, each["name"]) for each in task_fields()},
    }  # fmt: skip
