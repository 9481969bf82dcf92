"""Lamps of glTF 2 scenes, by its extension KHR_lights_punctual.

Point lights and spots are in cd, directional lights, which are suns, in lx. A light shines along -z
of its node. Lamps of size are written as their points, those that are even within their cone with a
mark in `extras`, as a spot of glTF falls off. A range, which is a hint, and animations are noted.

Source: Khronos Group. KHR_lights_punctual. 2018.
"""

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rastercov.base import (
    ByName,
    CameraError,
    FloatArray,
    MeshError,
    UnknownNames,
    errors_as,
    first_of,
    shown,
)
from rastercov.base.arguments import number, positive
from rastercov.formats.meshes.gltf import Node, nodes_below, root_nodes
from rastercov.formats.meshes.gltf_file import (
    WORLD,
    header_of,
    json_list,
    json_object,
    unknown_names,
    world_node,
)
from rastercov.formats.meshes.polygons import refuse_broken_files

EXTENSION = "KHR_lights_punctual"
FORWARDS = np.diag([1.0, -1.0, -1.0, 1.0])
"""node_from_lamp: a lamp looks along z, a light along -z."""


HARMLESS = frozenset(("name", "color", "extras", "extensions"))
NAMES = HARMLESS | {"light", "lights", "type", "intensity", "range", "spot"}
NAMES |= {"innerConeAngle", "outerConeAngle"}
"""Names of the extension; lamps do not depend on the harmless ones."""


EVEN = "rastercov_even"
"""Entry in `extras` of a light whose spot is even within its cone."""
ROUNDED = 1 + 1e-6
"""Factor of an angle that is rounding to float32."""
POINTER = re.compile(rf"/(?:nodes|extensions/{EXTENSION}/lights)/(\d+)/")
"""Start of what KHR_animation_pointer changes: a node or a light, and its number."""


class GltfLight(NamedTuple):
    """A light: name, world_from_lamp, intensity, and the angles of its cone, degrees.

    The outer angle is 180 for a point; of a sun it is 0, and the intensity in lx in place of cd.
    The inner one is that up to which a spot is even, None for all of its cone.
    """

    name: str
    place: FloatArray
    intensity: float
    half_angle_deg: float
    inner_angle_deg: float | None


def read_lights(data: bytes) -> tuple[list[GltfLight], list[str]]:
    """Lights of a scene, and notes; CameraError for a file without any."""
    with errors_as(CameraError, caught=MeshError), refuse_broken_files():
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
        rows = nodes_below(header, root_nodes(header), WORLD)
        used = {
            row: _extension(node)["light"]
            for row, (node, *_) in enumerate(rows)
            if "light" in _extension(node)
        }
        lights = [
            _light(json_object(known, "lights", light), rows[row][1], rows[row][2] @ FORWARDS)
            for row, light in used.items()
        ]
        notes = _notes(header, rows, used, json_list(known, "lights"))
    if not lights:
        raise CameraError(f"expected lights of {EXTENSION}, got none; export them as well")
    return lights, notes


def _notes(
    header: ByName, rows: Sequence[Node], used: dict[int, Any], lights: list[ByName]
) -> list[str]:
    """Notes on lights, by the rows of their nodes, that move in an animation or have a range."""
    nodes, changed = json_list(header, "nodes"), set()
    for animation in json_list(header, "animations"):
        for channel in json_list(animation, "channels"):
            target = channel["target"]
            more = target.get("extensions", {}).get("KHR_animation_pointer", {})
            match = POINTER.match(str(more.get("pointer", "")))
            items, index = (
                (nodes, target.get("node"))
                if match is None
                else (nodes if match[0].startswith("/nodes") else lights, int(match[1]))
            )
            if index is not None and index < len(items):
                changed.add(id(items[index]))
    moves: list[bool] = []
    for node, _, _, parent in rows:
        moves.append(id(node) in changed or (parent >= 0 and moves[parent]))
    moved = [rows[row][1] for row, own in used.items() if moves[row] or id(lights[own]) in changed]
    ranged = [rows[row][1] for row, own in used.items() if "range" in lights[own]]
    words = {
        "are animated: they are read as at rest": moved,
        "have a range, which is a hint: it does not end their light": ranged,
    }
    return [f"lights {first_of(list(map(shown, own)))} {why}" for why, own in words.items() if own]


def _extension(owner: ByName) -> ByName:
    every = owner.get("extensions", {})
    own = every.get(EXTENSION, {}) if isinstance(every, dict) else {}
    return own if isinstance(own, dict) else {}


def _light(entries: ByName, name: str, place: FloatArray) -> GltfLight:
    kind = entries.get("type")
    if kind not in ("point", "spot", "directional"):
        raise CameraError(
            f"expected light {shown(name)} to be of type point, spot or directional, got "
            f"{shown(kind)}"
        )
    angle: float = 0.0 if kind == "directional" else math.pi
    inner: float | None = None
    if kind == "spot":
        cone = entries.get("spot", {})
        angle, inner = (
            number(f"{key} of light {shown(name)}", cone.get(key, default))
            for key, default in (("outerConeAngle", math.pi / 4), ("innerConeAngle", 0.0))
        )
        if not 0 <= inner <= angle * ROUNDED or not 0 < angle <= math.pi / 2 * ROUNDED:
            raise CameraError(
                f"expected light {shown(name)} to have an innerConeAngle from 0 to outerConeAngle, "
                f"and that above 0, up to pi / 2, got {inner:g} and {angle:g}"
            )
        angle = min(angle, math.pi / 2)
        extras = entries.get("extras")
        is_even = isinstance(extras, dict) and extras.get(EVEN) is True
        inner = None if is_even else math.degrees(min(inner, angle))
    scale = np.linalg.norm(place[:3, :3], axis=0)
    if not (scale > 0).all():
        raise CameraError(
            f"expected light {shown(name)} in a node of scale above 0, got 0; correct the node"
        )
    rotation = place.copy()
    rotation[:3, :3] /= scale
    intensity = positive(f"intensity of light {shown(name)}", entries.get("intensity", 1.0))
    return GltfLight(name, rotation, intensity, math.degrees(angle), inner)


def scene_of(lights: Sequence[GltfLight], first_node: int) -> tuple[list[ByName], Any]:
    """Nodes of lights, of which the first is that of the world, and the extension of the scene."""
    nodes = [world_node("lamps", range(first_node + 1, first_node + 1 + len(lights)))]
    entries: list[ByName] = []
    for row, light in enumerate(lights):
        matrix = (light.place @ FORWARDS).T.ravel().tolist()
        own = {EXTENSION: {"light": row}}
        nodes.append({"name": light.name, "matrix": matrix, "extensions": own})
        entry: ByName = {"type": "point", "intensity": light.intensity, "name": light.name}
        if not light.half_angle_deg:
            entry["type"] = "directional"
        elif light.half_angle_deg <= 90:
            inner, outer = light.inner_angle_deg, math.radians(light.half_angle_deg)
            cone = {"innerConeAngle": math.radians(inner or 0.0), "outerConeAngle": outer}
            entry |= {"type": "spot", "spot": cone}
            if inner is None:
                entry["extras"] = {EVEN: True}
        entries.append(entry)
    return nodes, {EXTENSION: {"lights": entries}}
