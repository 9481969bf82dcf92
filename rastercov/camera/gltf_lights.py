"""Lamps of glTF 2 scenes, by its extension KHR_lights_punctual.

Point lights and spots are in cd, directional lights, which are suns, in lx. A light shines along -z
of its node; a spot is even within its outer cone here. Lamps of size are written as their points.

Source: Khronos Group. KHR_lights_punctual. 2018.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rastercov.base.checks import number, positive, shown
from rastercov.base.errors import CameraError, MeshError, errors_as
from rastercov.base.files import UnknownNames
from rastercov.base.memory import FloatArray
from rastercov.mesh.formats.gltf import nodes_below, root_nodes
from rastercov.mesh.formats.gltf_file import (
    WORLD,
    header_of,
    json_list,
    json_object,
    unknown_names,
    world_node,
)
from rastercov.mesh.formats.polygons import broken_files_refused

EXTENSION = "KHR_lights_punctual"
FORWARDS = np.diag([1.0, -1.0, -1.0, 1.0])
"""node_from_lamp: a lamp looks along z, a light along -z."""


HARMLESS = frozenset(("name", "color", "range", "innerConeAngle", "extras", "extensions"))
NAMES = HARMLESS | {"light", "lights", "type", "intensity", "spot", "outerConeAngle"}
"""Names of the extension; lamps do not depend on the harmless ones."""


class Light(NamedTuple):
    """A light: name, world_from_lamp, intensity, and the angle of its cone.

    The angle is 180 for a point; of a sun it is 0, and the intensity in lx in place of cd.
    """

    name: str
    place: FloatArray
    intensity: float
    half_angle_deg: float


def read_lights(data: bytes) -> list[Light]:
    """Lights of a scene; CameraError for a file without any."""
    with errors_as(CameraError, caught=MeshError), broken_files_refused():
        header = header_of(data)
        unknown_names(header, CameraError)  # an error for a slip
        slips = UnknownNames(CameraError)
        for owner in (header, *json_list(header, "nodes")):
            slips.look("the scene", owner.get("extensions", {}), frozenset({EXTENSION}))
            slips.look(EXTENSION, _extension(owner), NAMES)
        known = _extension(header)
        for entries in json_list(known, "lights"):
            for each in (entries, entries.get("spot", {})):
                slips.look("a light", each, NAMES, HARMLESS)
        found = [
            _light(json_object(known, "lights", own["light"]), name, matrix @ FORWARDS)
            for node, name, matrix, _ in nodes_below(header, root_nodes(header), WORLD)
            if "light" in (own := _extension(node))
        ]
    if not found:
        raise CameraError(f"expected lights of {EXTENSION}, got none; export them as well")
    return found


def _extension(owner: dict[str, Any]) -> dict[str, Any]:
    every = owner.get("extensions", {})
    own = every.get(EXTENSION, {}) if isinstance(every, dict) else {}
    return own if isinstance(own, dict) else {}


def _light(entries: dict[str, Any], name: str, place: FloatArray) -> Light:
    kind = entries.get("type")
    if kind not in ("point", "spot", "directional"):
        raise CameraError(
            f"expected light {shown(name)} to be of type point, spot or directional, got "
            f"{shown(kind)}"
        )
    angle = 0.0 if kind == "directional" else math.pi
    if kind == "spot":
        cone = entries.get("spot", {})
        given = cone.get("outerConeAngle", math.pi / 4) if isinstance(cone, dict) else None
        angle = number(f"outerConeAngle of light {shown(name)}", given)
    scale = np.linalg.norm(place[:3, :3], axis=0)
    if not (scale > 0).all():
        raise CameraError(
            f"expected light {shown(name)} in a node of scale above 0, got 0; correct the node"
        )
    rotation = place.copy()
    rotation[:3, :3] /= scale
    intensity = positive(f"intensity of light {shown(name)}", entries.get("intensity", 1.0))
    return Light(name, rotation, intensity, math.degrees(angle))


def scene_of(lights: Sequence[Light], first_node: int) -> tuple[list[dict[str, Any]], Any]:
    """Nodes of lights, of which the first is that of the world, and the extension of the scene."""
    nodes = [world_node("lamps", range(first_node + 1, first_node + 1 + len(lights)))]
    entries: list[dict[str, Any]] = []
    for row, light in enumerate(lights):
        matrix = (light.place @ FORWARDS).T.ravel().tolist()
        own = {EXTENSION: {"light": row}}
        nodes.append({"name": light.name, "matrix": matrix, "extensions": own})
        entry: dict[str, Any] = {"type": "point", "intensity": light.intensity, "name": light.name}
        if not light.half_angle_deg:
            entry["type"] = "directional"
        elif light.half_angle_deg <= 90:
            cone = {"innerConeAngle": 0.0, "outerConeAngle": math.radians(light.half_angle_deg)}
            entry |= {"type": "spot", "spot": cone}
        entries.append(entry)
    return nodes, {EXTENSION: {"lights": entries}}
