"""Animations of the nodes of a glTF scene, as rigid motions of its groups from the rest pose.

Channels of translation and rotation are read, in steps, linear or by cubic splines. A scale that is
that of the rest pose or 0 says whether a node is there; other scales over time, skins and morph
targets are refused.

Source: Khronos Group. glTF 2.0 Specification. 2021. Section 3.11 and Appendix C, whose slerp is
that of K. Shoemake. Animating Rotation with Quaternion Curves. 1985.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rastercov.base import BoolArray, ByName, FloatArray, dots, norm, shown
from rastercov.formats.meshes.gltf import (
    affine,
    check_rotations,
    name_meshes,
    nodes_below,
    roots_of_scene,
)
from rastercov.formats.meshes.gltf_file import (
    Accessors,
    json_list,
    json_name,
    json_numbers,
    json_object,
    unknown_names,
)
from rastercov.formats.meshes.polygons import check

REST: dict[str, tuple[float, ...]] = {
    "translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)
}  # fmt: skip
"""Properties of a node that a channel may have, and their values unless given."""
LEAST_SINE = 1e-6
"""Sine of the half angle between two rotations below which their arc is a chord."""
SAME_SCALE = 1e-5
"""Difference of a scale from that at rest that is rounding, relative to it."""


class Animated(NamedTuple):
    """Frames of the groups of a scene.

    Attributes
    ----------
    names : list of str
        Groups, as `read_glb` names them.
    poses : (N, T, 4, 4) float64
        Motion of each from the rest pose, in the units of the file.
    present : (N, T) bool
    """

    names: list[str]
    poses: FloatArray
    present: BoolArray


def read_animation(
    header: ByName, buffers: Sequence[memoryview], budget: int, *, name: str, steps: int
) -> Animated:
    """Frames of an animation at equal steps of its time, the first and last key among them.

    `name` is that of the animation, "" for the only one.
    """
    unknown_names(header)  # an error for a slip; other names are notes of the mesh
    known = [json_name(each) for each in json_list(header, "animations")]
    check(known, "expected an animation, got none", "give a table of poses")
    check(
        known.count(name) == 1 or (not name and len(known) == 1),
        f"expected one of the animations {', '.join(map(shown, known))}, got {shown(name)}",
    )
    animation = json_object(header, "animations", known.index(name) if name in known else 0)
    rows = nodes_below(header, roots_of_scene(header))
    number = {id(node): index for index, node in enumerate(json_list(header, "nodes"))}
    reader = Accessors(header, buffers, budget)
    channels = _channels(animation, reader)
    starts = [keys[0] for keys, *_ in channels.values()]
    ends = [keys[-1] for keys, *_ in channels.values()]
    times = np.linspace(min(starts), max(ends), steps) if steps > 1 else np.array(starts[:1])
    matrices: list[FloatArray] = []
    there: list[BoolArray] = []
    used, names, paths = name_meshes(header, rows)
    for row, name in zip(used, names, strict=True):
        check("skin" not in rows[row][0], f"expected nodes without a skin, got {shown(name)}")
    for node, _, _, parent in rows:
        local, is_there = _local(node, number[id(node)], channels, times)
        matrices.append(local if parent < 0 else matrices[parent] @ local)
        there.append(is_there if parent < 0 else is_there & there[parent])
    at_rest = np.array([rows[row][2] for row in used]).reshape(-1, 1, 4, 4)
    check(
        (np.linalg.det(at_rest) != 0).all(),
        "expected nodes with a scale above 0 in the rest pose, got one of 0",
    )
    values = np.array([matrices[row] for row in used]).reshape(len(used), -1, 4, 4)
    poses = values @ np.linalg.inv(at_rest)
    return Animated([paths[row] for row in used], poses, np.array([there[row] for row in used]))


Channel = tuple[FloatArray, FloatArray, str]
"""Times of the keys, (K,), their values, (K, columns) or those with tangents, and the way."""


def _channels(animation: ByName, reader: Accessors) -> dict[tuple[int, str], Channel]:
    """Channels of an animation by node and property."""
    channels: dict[tuple[int, str], Channel] = {}
    for channel in json_list(animation, "channels"):
        target, path = channel["target"], channel["target"].get("path")
        if "node" not in target:  # of an extension
            continue
        check(
            path != "weights", "expected moving nodes, got morph targets", "give a table of poses"
        )
        check(path in REST, f"expected path to be one of {', '.join(REST)}, got {shown(path)}")
        sampler = json_object(animation, "samplers", channel["sampler"])
        way = sampler.get("interpolation", "LINEAR")
        check(
            way in WAYS, f"expected interpolation to be one of {', '.join(WAYS)}, got {shown(way)}"
        )
        keys = reader.read_times(sampler["input"])
        check(
            len(keys) and np.isfinite(keys).all() and (np.diff(keys) > 0).all(),
            "expected strictly increasing times of an animation, got other times",
        )
        kind = "VEC4" if path == "rotation" else "VEC3"
        values = reader.read(sampler["output"], kind).astype(np.float64)
        n = len(keys) * (3 if way == "CUBICSPLINE" else 1)
        check(
            len(values) == n and np.isfinite(values).all(),
            f"expected {n} finite values for {len(keys)} times, got {len(values)}",
        )
        if path == "rotation":
            at = values[1::3] if way == "CUBICSPLINE" else values
            check_rotations(at, f"node {target['node']} over time", reader.step(sampler["output"]))
        key = target["node"], path
        check(key not in channels, f"expected one channel of {path} for node {key[0]}, got two")
        channels[key] = keys, values, way
    check(channels, "expected an animation that moves a node, got none")
    return channels


def _local(
    node: ByName, index: int, channels: dict[tuple[int, str], Channel], times: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """parent_from_node in each frame, and whether the node is there."""
    own = {path for path in REST if (index, path) in channels}
    check(not own or "matrix" not in node, f"expected no matrix of animated node {index}, got one")
    is_there = np.ones(len(times), bool)
    if "matrix" in node:
        matrix = json_numbers(node, "matrix", (0,) * 16).reshape(4, 4).T
        return np.broadcast_to(matrix, (len(times), 4, 4)), is_there
    values = {}
    for path, rest in REST.items():
        still = json_numbers(node, path, rest)
        values[path] = np.broadcast_to(still, (len(times), len(rest)))
        if path not in own:
            continue
        given = WAYS[channels[index, path][2]](times, *channels[index, path][:2], path)
        if path == "scale":
            is_there = (given != 0).any(axis=1)
            same = np.abs(given - still) <= SAME_SCALE * np.abs(still).max()
            check(
                same[is_there].all(),
                f"expected the scale of node {index} to be constant, or 0 where it is absent, "
                "got another",
            )
        else:
            values[path] = given
    return affine(values["translation"], values["rotation"], values["scale"]), is_there


def _span(times: FloatArray, keys: FloatArray) -> tuple[Any, Any, FloatArray, FloatArray]:
    """Keys before and after each time, its place between them, [0, 1], and their distance."""
    after = np.clip(np.searchsorted(keys, times, side="right"), 1, max(len(keys) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(keys) - 1)
    width = keys[after] - keys[before]
    place = np.clip((times - keys[before]) / np.where(width > 0, width, 1.0), 0.0, 1.0)
    return before, after, place[:, None], width[:, None]


def _step(times: FloatArray, keys: FloatArray, values: FloatArray, path: str) -> FloatArray:
    at = np.clip(np.searchsorted(keys, times, side="right") - 1, 0, len(keys) - 1)
    return values[at]


def _linear(times: FloatArray, keys: FloatArray, values: FloatArray, path: str) -> FloatArray:
    before, after, t, _ = _span(times, keys)
    one, other = values[before], values[after]
    if path != "rotation":
        return one + t * (other - one)
    return slerp(one, other, t)


def slerp(one: FloatArray, other: FloatArray, t: FloatArray) -> FloatArray:
    """Rotations at t, (N, 1), on the short arcs between unit quaternions (N, 4)."""
    cosine = dots(one, other)[:, None]
    other, cosine = np.where(cosine < 0, -other, other), np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    is_chord = sine < LEAST_SINE
    safe = np.where(is_chord, 1.0, sine)
    a = np.where(is_chord, 1 - t, np.sin((1 - t) * angle) / safe)
    b = np.where(is_chord, t, np.sin(t * angle) / safe)
    return _unit(a * one + b * other)


def _spline(times: FloatArray, keys: FloatArray, values: FloatArray, path: str) -> FloatArray:
    """Cubic Hermite splines: values are in-tangent, value and out-tangent of each key."""
    into, at, out = np.moveaxis(values.reshape(len(keys), 3, -1), 1, 0)
    before, after, t, width = _span(times, keys)
    t2, t3 = t * t, t * t * t
    result: FloatArray = (
        (2 * t3 - 3 * t2 + 1) * at[before]
        + width * (t3 - 2 * t2 + t) * out[before]
        + (3 * t2 - 2 * t3) * at[after]
        + width * (t3 - t2) * into[after]
    )
    return _unit(result) if path == "rotation" else result


def _unit(quaternions: FloatArray) -> FloatArray:
    length = norm(quaternions)[..., None]
    check((length > 0).all(), "expected a rotation between two keys, got a quaternion of length 0")
    return quaternions / length


WAYS: dict[str, Callable[[FloatArray, FloatArray, FloatArray, str], FloatArray]] = {
    "STEP": _step,
    "LINEAR": _linear,
    "CUBICSPLINE": _spline,
}
"""Ways between keys, by their names in a file."""
