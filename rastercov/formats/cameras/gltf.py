"""Cameras of glTF 2 scenes (.gltf, .glb), and frusta of cameras to look at a rig in any viewer.

A camera looks along -z of its node with y up; lengths are metres. The format has a vertical angle,
or half sides of an orthographic view, and no image size, principal point or distortion: the size is
asked for. Frusta that are written have a node for each pose, with its name and a pyramid of lines
whose base is the border of the image, or of the valid region of a lens that ends within it, curved
where the lens bends it, with a mark at its top, or a box of parallel rays; and, below it, its own
camera of glTF.

Source: Khronos Group. glTF 2.0 Specification. 2021, sections 3.5.3 and 3.10.
"""

import math

import numpy as np

from rastercov.base import (
    ByName,
    CameraError,
    FloatArray,
    IntArray,
    MeshError,
    arctan2,
    errors_as,
    matmul,
    norm,
    tan,
)
from rastercov.core.camera import Border, Camera, Views, parallel
from rastercov.core.camera.conventions import OPENGL_AXES
from rastercov.core.camera.projection import view_frame
from rastercov.formats.cameras.source import Entries, Source
from rastercov.formats.meshes.gltf import nodes_below, root_nodes
from rastercov.formats.meshes.gltf_file import (
    WORLD,
    GlbBuffer,
    header_of,
    json_list,
    json_object,
    unknown_names,
    world_node,
)
from rastercov.formats.meshes.polygons import refuse_broken_files

MOST_ASPECT = 1.1
"""Largest ratio of fx and fy: a larger one is an image size that does not belong to the scene."""
PARTS = 12
"""Parts of each side of the image, so that the border of a distorted image is a curve."""
LENGTH_REL = 0.4
"""Longest edge of a pyramid by the median distance of neighbouring cameras."""
LENGTH_ALONE = 0.1
"""Metres: longest edge of the pyramid of a camera by itself."""
MOST_NEIGHBOURS = 200
"""Cameras whose neighbours are looked for."""
TOP_REL = 0.15
"""Height of the mark by the height of the base."""


def is_mine(content: object) -> bool:
    """True for the JSON of a scene."""
    return isinstance(content, dict) and isinstance(content.get("asset"), dict)


def read(source: Source, border: Border) -> Views:
    """Cameras of a scene, one pose for each node with a camera."""
    with errors_as(CameraError, caught=MeshError), refuse_broken_files():
        header = header_of(source.data)
        notes = unknown_names(header, CameraError)
        nodes = nodes_below(header, root_nodes(header), WORLD)
        if len(nodes) < len(json_list(header, "nodes")):
            raise MeshError("expected nodes that form a tree, got a cycle; correct the file")
        items = [each for each in nodes if "camera" in each[0]]
        lenses = {
            node["camera"]: json_object(header, "cameras", node["camera"]) for node, *_ in items
        }
    for note in notes:
        border.note(note)
    if not items:
        raise CameraError("expected a node with a camera, got none; export the cameras as well")
    size = border.image_size("a glTF scene")
    entries = {number: Entries(lens, f"camera {number}") for number, lens in lenses.items()}
    used = list(entries)
    matrices = np.array([each[2] for each in items])
    with np.errstate(all="ignore"):  # cameras are not scaled by their nodes
        matrices[:, :3, :3] /= np.linalg.norm(matrices[:, :3, :3], axis=1, keepdims=True)
    return border.views(
        [_camera(entries[number], size) for number in used],
        [entries[number].text("name", entries[number].where) for number in used],
        world_from_camera=matmul(matrices, OPENGL_AXES),
        camera=[used.index(node["camera"]) for node, *_ in items],
        images=[name for _, name, *_ in items],
        metres=1.0,
    )


def _camera(entries: Entries, size: tuple[int, int]) -> Camera:
    if entries.text("type", "perspective") == "orthographic":
        return _orthographic(entries.table("orthographic"), size)
    lens = entries.table("perspective")
    width, height = size
    yfov, aspect = lens.angle("yfov"), lens.positive("aspectRatio", width / height)
    square = width / height / aspect
    _check_size(lens, aspect, size)
    fy = height / 2 / tan(yfov / 2)
    return Camera(width=width, height=height, fx=fy * square, fy=fy)


def _orthographic(lens: Entries, size: tuple[int, int]) -> Camera:
    """View along parallel rays, of half sides in metres."""
    x, y = lens.positive("xmag"), lens.positive("ymag")
    near, far = lens.number("znear"), lens.number("zfar")
    if not 0 <= near < far:
        raise CameraError(
            f"{lens.where}: expected 0 <= znear < zfar, got {near:g} and {far:g}; correct the file"
        )
    _check_size(lens, x / y, size)
    width, height = size
    own = {"width": width, "height": height, "fx": width / 2 / x, "fy": height / 2 / y}
    return Camera.from_dict(own | {"model": parallel.MODEL, "near": near})


def _check_size(lens: Entries, aspect: float, size: tuple[int, int]) -> None:
    """Raise `CameraError` for an image size that does not belong to the ratio of its sides."""
    width, height = size
    if not 1 / MOST_ASPECT <= width / height / aspect <= MOST_ASPECT:
        raise CameraError(
            f"{lens.where}: expected aspectRatio {aspect:.6g}, got --image-size {width}x{height}; "
            f"give one that fits, such as {round(aspect * height)}x{height}"
        )


def what_is_lost(camera: Camera) -> list[str]:
    """Parts of this camera that glTF's own does not hold."""
    is_middle = (camera.cx, camera.cy) == (camera.width / 2, camera.height / 2)
    lost = ["image size"] + ([] if is_middle else ["principal point"])
    return lost + (["lens (only the lines show it)"] if camera.is_curved else [])


def glb_of(views: Views) -> bytes:
    """A scene with a node for each pose: a camera, and a pyramid of lines."""
    if not len(views.poses):
        raise CameraError("expected poses for a scene of frusta, got none; add poses")
    rig = views.rig
    assert rig is not None
    poses = views.poses.world_from_camera
    size = _usual_length(poses[:, :3, 3])
    used, lens_of = np.unique(views.poses.camera, return_inverse=True)
    buffer = GlbBuffer()
    meshes, cameras = [], []
    for name, camera in [(rig.names[row], rig.cameras[row]) for row in used]:
        points, lines = _pyramid(camera, size)
        primitive = {
            "attributes": {"POSITION": buffer.add(points.astype(np.float32))},
            "indices": buffer.add(lines.astype(np.uint32)),
            "mode": 1,  # lines
            "material": 0,
        }
        meshes.append({"name": name, "primitives": [primitive]})
        kind, lens = _lens_of(camera, size)
        cameras.append({"name": name, "type": kind, kind: lens})
    n, matrices = len(poses), matmul(poses, OPENGL_AXES).transpose(0, 2, 1).reshape(-1, 16)
    # The camera is a node below: some programs drop the mesh of a node that has a camera.
    nodes: list[ByName] = [
        world_node("rig", range(1, n + 1)),
        *(
            {"name": image, "matrix": matrix, "mesh": lens, "children": [n + 1 + row]}
            for row, (image, matrix, lens) in enumerate(
                zip(views.images, matrices.tolist(), lens_of.tolist(), strict=True)
            )
        ),
        *({"camera": lens} for lens in lens_of.tolist()),
    ]
    unlit: ByName = {"KHR_materials_unlit": {}}
    colour = {"baseColorFactor": [0.9, 0.35, 0.1, 1.0], "metallicFactor": 0.0}
    material = {"name": "frusta", "pbrMetallicRoughness": colour, "extensions": unlit}
    scene = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "cameras": cameras,
        "meshes": meshes,
        "materials": [material],
        "extensionsUsed": list(unlit),
    }
    return buffer.file(scene)


def _lens_of(camera: Camera, size: float) -> tuple[str, dict[str, float]]:
    """Type of glTF's own camera, and its entries; `size` is the length of the pyramids."""
    if camera.is_parallel:
        x, y = camera.width / 2 / camera.fx, camera.height / 2 / camera.fy
        deep = max(camera.depth_of_field()[0], camera.near) + 100 * max(x, y, size)
        return "orthographic", {"xmag": x, "ymag": y, "znear": camera.near, "zfar": deep}
    vertical = 2 * arctan2(camera.height / 2 / camera.fy, 1.0)
    ratio = camera.width / camera.height * camera.fy / camera.fx
    own = {"yfov": vertical, "aspectRatio": ratio, "znear": max(camera.near, size / 100)}
    return "perspective", own


def _usual_length(centres: FloatArray) -> float:
    """Length of the pyramids, so that neighbours do not hide each other."""
    rows = np.linspace(0, len(centres) - 1, min(len(centres), MOST_NEIGHBOURS)).astype(np.int64)
    nearest = []
    for row in rows:  # 200 at most
        distance = norm(centres - centres[row])
        nearest.append(float(distance[distance > 0].min(initial=np.inf)))
    items = [each for each in nearest if math.isfinite(each)]
    return LENGTH_REL * float(np.median(items)) if items else LENGTH_ALONE


def _pyramid(camera: Camera, length: float) -> tuple[FloatArray, IntArray]:
    """Points (N, 3) in OpenGL axes, and indices of their lines, two a line."""
    starts, base = view_frame(camera, PARTS, length)
    n = len(base)
    height = norm(base[PARTS // 2] - base[2 * PARTS + PARTS // 2])
    top = base[PARTS // 2] + (0.0, -TOP_REL * height, 0.0)
    corners = range(0, n, PARTS)
    lines = [[row, (row + 1) % n] for row in range(n)]
    if camera.is_parallel:
        first = n + 2
        lines += [[first + side, row] for side, row in enumerate(corners)]
        lines += [[first + side, first + (side + 1) % 4] for side in range(4)]
    else:
        lines += [[n, row] for row in corners]
    lines += [[PARTS // 4, n + 1], [n + 1, PARTS - PARTS // 4]]
    box = starts[::PARTS] if camera.is_parallel else starts[:0]
    points = np.concatenate([base, [[0.0, 0.0, 0.0], top], box])
    return points * (1.0, -1.0, -1.0), np.array(lines).ravel()
