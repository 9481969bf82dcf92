"""Cameras of glTF 2 scenes (.gltf, .glb).

A camera looks along -z of its node with y up; lengths are metres. The format has a vertical angle
and no image size, principal point or distortion: the size is asked for.

Source: Khronos Group. glTF 2.0 Specification. 2021, sections 3.5.3 and 3.10.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import CameraError, MeshError
from rastercov.camera.camera import Camera
from rastercov.camera.formats.conventions import OPENGL_AXES, Border
from rastercov.camera.formats.entries import Entries
from rastercov.camera.formats.rotations import from_quaternions
from rastercov.camera.formats.source import Source
from rastercov.camera.views import Views
from rastercov.mesh.formats.gltf_file import chunks, unknown_names

FloatArray = NDArray[np.float64]

WORLD = "rastercov_world"
"""Entry in `extras` of the node whose frame is the world: viewers have y up, and we have not."""

MOST_ASPECT = 1.1
"""Largest ratio of fx and fy: a larger one is an image size that does not belong to the scene."""


def is_mine(content: Any) -> bool:
    """True for the JSON of a scene."""
    return isinstance(content, dict) and isinstance(content.get("asset"), dict)


def read(source: Source, border: Border) -> Views:
    """Perspective cameras of a scene, one pose for each node with a camera."""
    if source.data[:4] == b"glTF":
        try:
            content, _, _ = chunks(source.data)
        except (MeshError, AttributeError) as error:
            raise CameraError(str(error)) from None
    else:
        content = source.json
    scene = Entries(content, "scene")
    for note in unknown_names(content, CameraError):
        border.note(note)
    lenses = [each for _, each in scene.tables("cameras")] if "cameras" in scene else []
    nodes = [each for _, each in scene.tables("nodes")] if "nodes" in scene else []
    found = _nodes_with_cameras(nodes)
    if not found:
        raise CameraError("a node with a camera wanted, got none")
    size = border.image_size("a glTF scene")
    cameras: dict[int, tuple[int, Camera]] = {}
    index, images, poses = [], [], []
    for node, name, matrix in found:
        number = _index(node, "camera", lenses)
        if lenses[number].text("type", "perspective") != "perspective":
            border.note("orthographic cameras left out")
            continue
        row, _ = cameras.setdefault(number, (len(cameras), _camera(lenses[number], size)))
        index.append(row)
        images.append(name)
        poses.append(matrix)
    if not poses:
        raise CameraError("perspective cameras wanted, got orthographic ones only")
    return border.views(
        [camera for _, camera in cameras.values()],
        [lenses[number].text("name", f"camera {number}") for number in cameras],
        world_from_camera=_without_scale(np.array(poses)) @ OPENGL_AXES,
        camera=index,
        images=images,
        metres=1.0,
    )


def _nodes_with_cameras(nodes: list[Entries]) -> list[tuple[Entries, str, FloatArray]]:
    """Nodes with a camera, their names or those of the nodes above, and world_from_node."""
    children = [_children(node, len(nodes)) for node in nodes]
    is_child = {child for each in children for child in each}
    stack = [(row, "", np.eye(4)) for row in range(len(nodes)) if row not in is_child][::-1]
    seen: set[int] = set()
    found = []
    while stack:
        row, name, parent = stack.pop()
        if row in seen:
            raise CameraError(f"nodes must form a tree, node {row} has two parents; correct it")
        seen.add(row)
        node = nodes[row]
        extras = node.get("extras")
        is_world = isinstance(extras, dict) and extras.get(WORLD) is True
        matrix = np.eye(4) if is_world else parent @ _matrix(node)
        name = node.text("name", name or f"node {row}")
        if "camera" in node:
            found.append((node, name, matrix))
        stack += [(child, name, matrix) for child in reversed(children[row])]
    if len(seen) < len(nodes):
        raise CameraError("nodes must form a tree, some form a ring; correct it")
    return found


def _children(node: Entries, n_nodes: int) -> list[int]:
    given = node.get("children", [])
    if not isinstance(given, list) or not all(
        type(child) is int and 0 <= child < n_nodes for child in given
    ):
        raise CameraError(f"{node.where}: children must be indices of nodes, got {shown(given)}")
    return given


def _index(node: Entries, name: str, items: list[Entries]) -> int:
    value = node.need(name)
    if type(value) is not int or not 0 <= value < len(items):
        raise CameraError(f"{node.where}: {name} must be one of {len(items)}, got {shown(value)}")
    return value


def _matrix(node: Entries) -> FloatArray:
    """parent_from_node."""
    if "matrix" in node:
        matrix: FloatArray = node.array("matrix", (16,)).reshape(4, 4).T
        if not np.array_equal(matrix[3], (0, 0, 0, 1)):
            raise CameraError(f"{node.where}: its matrix must end in 0 0 0 1")
        return matrix
    translation = node.array("translation", (3,)) if "translation" in node else np.zeros(3)
    rotation = node.array("rotation", (4,)) if "rotation" in node else np.array([0, 0, 0, 1.0])
    matrix = from_quaternions([rotation[[3, 0, 1, 2]]], [translation])[0]
    if "scale" in node:
        matrix[:3, :3] *= node.array("scale", (3,))
    return matrix


def _without_scale(matrices: FloatArray) -> FloatArray:
    """Matrices whose axes have length 1, as cameras are not scaled by their nodes."""
    with np.errstate(all="ignore"):
        matrices[:, :3, :3] /= np.linalg.norm(matrices[:, :3, :3], axis=1, keepdims=True)
    return matrices


def _camera(entries: Entries, size: tuple[int, int]) -> Camera:
    lens = entries.table("perspective")
    yfov = lens.number("yfov")
    if not 0 < yfov < math.pi:
        raise CameraError(f"{lens.where}: yfov must be above 0 and below pi, got {yfov:g}")
    width, height = size
    aspect = lens.number("aspectRatio", width / height)
    if not aspect > 0:
        raise CameraError(f"{lens.where}: aspectRatio must be positive, got {aspect:g}")
    square = width / height / aspect
    if not 1 / MOST_ASPECT <= square <= MOST_ASPECT:
        raise CameraError(
            f"{lens.where}: an image of aspectRatio {aspect:.6g} wanted, got --image-size "
            f"{width}x{height}; give one that fits, such as {round(aspect * height)}x{height}"
        )
    fy = height / 2 / math.tan(yfov / 2)
    return Camera(width=width, height=height, fx=fy * square, fy=fy)
