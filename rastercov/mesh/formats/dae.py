"""COLLADA files (.dae): nodes with their transforms, and the polygons of their geometries.

Read are the meshes that the nodes of the scene name, one group a node, in the coordinates of the
file: its up axis is not turned. Skins are read unposed. No other file is ever opened; content that
is not read is a note, or an error where the rest would be wrong without it.

Source: Khronos Group. COLLADA - Digital Asset Schema Release 1.4.1. 2008.
"""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError
from rastercov.mesh.arrays import rotation_about
from rastercov.mesh.formats.glb import broken_files_refused
from rastercov.mesh.formats.polygons import Polygons, check_budget, fan_polygons
from rastercov.mesh.formats.xml_tree import (
    children,
    floats,
    integers,
    local_name,
    parsed,
    unknown_children,
)

POLYGONS = ("triangles", "polylist", "polygons")
STRIPS = ("trifans", "tristrips")
LINES = ("lines", "linestrips")
NO_SURFACE = ("source", "vertices", "extra")
TRANSFORMS = ("matrix", "translate", "rotate", "scale", "lookat", "skew")
INSTANCES = ("instance_node", "instance_geometry", "instance_controller")
NO_PART = ("asset", "extra", "instance_camera", "instance_light")
BYTES_PER_INSTANCE = 1000
"""Memory and work that a node counts for; a short file may ask for many instances."""
AFFINE_ROW_TOLERANCE = 1e-6

IntArray = NDArray[np.int64]
_Shape = tuple[NDArray[np.float64], IntArray, IntArray]
"""Points of a geometry, corners of all its polygons, and the number of corners of each."""


def read(data: bytes, budget: int) -> Polygons:
    """Polygons of a COLLADA file in metres, one group a node, in the order of the scene's tree."""
    root = parsed(data, "the file", budget)
    if local_name(root) != "COLLADA":
        raise MeshError(f"an element COLLADA wanted, got {local_name(root)[:40]!r}; export again")
    try:
        with broken_files_refused():
            return _Scene(root, budget).polygons()
    except RecursionError:
        raise MeshError("nodes are nested too deeply; export it again") from None


class _Scene:
    """Elements of a file by their ids, and what its nodes have been made of so far."""

    def __init__(self, root: Element, budget: int) -> None:
        self._root, self._budget, self._bytes_left = root, budget, budget
        self._by_id: dict[str, Element] = {}
        self._repeated: set[str] = set()
        for element in root.iter():
            if (key := element.get("id")) is not None:
                if key in self._by_id:
                    self._repeated.add(key)
                self._by_id.setdefault(key, element)
        self._shapes: dict[str, _Shape] = {}
        self._points: dict[str, NDArray[np.float64]] = {}
        self._vertices, self._corners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        self._n_corners, self._labels = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        self._names: list[str] = []
        self._n_vertices = self._n_faces = self._n_lines = 0
        self._skinned: list[str] = []
        self._left_out: list[str] = []

    def polygons(self) -> Polygons:
        """All polygons that the nodes of the scene name."""
        scene = self._visual_scene()
        known = ("node", "asset", "extra", "evaluate_scene")
        self._left_out += [f"{name} of the scene" for name in unknown_children(scene, *known)]
        for node in children(scene, "node"):
            self._add(node, np.eye(4), ())
        metres = self._metres_per_unit()
        found = fan_polygons(
            np.concatenate(self._vertices) * (1.0 if metres is None else metres),
            np.concatenate(self._corners),
            np.concatenate(self._n_corners),
            self._budget,
        )
        return Polygons(
            found.vertices,
            found.faces,
            found.source_face,
            np.concatenate(self._labels)[found.source_face],
            self._names or [None],
            self._notes(),
            is_in_metres=metres is not None,
        )

    def _metres_per_unit(self) -> float | None:
        """Metres in a unit of the file, None where it states none."""
        units = [
            unit for asset in children(self._root, "asset") for unit in children(asset, "unit")
        ]
        text = units[0].get("meter") if units else None
        if text is None:
            return None
        value = floats(text)
        if value.shape != (1,) or not 0 < value[0] < np.inf:
            raise MeshError(f"a unit of a positive number of metres wanted, got {text[:40]!r}")
        return float(value[0])

    def _visual_scene(self) -> Element:
        """The scene that is to be shown, or the only one."""
        scenes = [
            scene
            for library in children(self._root, "library_visual_scenes")
            for scene in children(library, "visual_scene")
        ]
        for shown in children(self._root, "scene"):
            for instance in children(shown, "instance_visual_scene"):
                return self._target(instance.attrib["url"], "visual_scene")
        if len(scenes) != 1:
            raise MeshError(f"one scene wanted, got {len(scenes)} and none named; export it again")
        return scenes[0]

    def _target(self, url: str, *kinds: str) -> Element:
        """Element that a URL names, of one of these kinds."""
        if not url.startswith("#"):
            raise MeshError(
                f"an element of this file wanted, got {url[:80]!r}, which is never opened; export "
                "a single file"
            )
        key = url[1:]
        element = self._by_id.get(key)
        if element is None or local_name(element) not in kinds:
            got = "nothing of that id" if element is None else f"an element {local_name(element)}"
            raise MeshError(f"{url[:80]!r}: {kinds[0]} wanted, got {got}; export it again")
        if key in self._repeated:
            raise MeshError(f"the id {key[:80]!r} comes twice; correct it")
        return element

    def _add(
        self, node: Element, world_from_parent: NDArray[np.float64] | None, above: Sequence[Element]
    ) -> None:
        """Take in a node and those below it, as one group each."""
        self._bytes_left -= BYTES_PER_INSTANCE
        check_budget(0, self._bytes_left, n_bytes=BYTES_PER_INSTANCE)
        if any(node is each for each in above):
            raise MeshError(f"node {_name(node)!r} is a part of itself; correct it")
        above = (*above, node)
        step = _parent_from_node(node)
        is_known = world_from_parent is not None and step is not None
        world_from_node = world_from_parent @ step if is_known else None  # type: ignore[operator] # not None
        known = ("node", *TRANSFORMS, *INSTANCES, *NO_PART)
        self._left_out += [f"{name} of {_name(node)!r}" for name in unknown_children(node, *known)]
        label = len(self._names)
        self._names.append("")
        for each in node:
            kind, url = local_name(each), each.get("url", "")
            if kind == "node":
                self._add(each, world_from_node, above)
            elif kind == "instance_node":
                self._add(self._target(url, "node"), world_from_node, above)
            elif kind in ("instance_geometry", "instance_controller"):
                geometry, node_from_shape = self._geometry(url, kind == "instance_controller")
                self._names[label] = _name(node) or _name(geometry) or f"node{label}"
                if world_from_node is None:
                    raise MeshError(
                        f"node {self._names[label]!r} is placed by lookat or skew, which is not "
                        "supported; export it with matrices"
                    )
                self._place(self._shape(geometry), world_from_node @ node_from_shape, label)

    def _geometry(self, url: str, is_controlled: bool) -> tuple[Element, NDArray[np.float64]]:
        """Geometry of an instance, and its place in the node."""
        if not is_controlled:
            return self._target(url, "geometry"), np.eye(4)
        node_from_shape: NDArray[np.float64] = np.eye(4)
        seen: list[Element] = []
        element = self._target(url, "controller")
        while local_name(element) == "controller":  # a skin of a morph of a geometry
            if any(element is each for each in seen):
                raise MeshError(f"controller {_name(element)!r} is a part of itself; correct it")
            seen.append(element)
            (changed,) = children(element, "skin", "morph")
            for matrix in children(changed, "bind_shape_matrix"):
                node_from_shape = _matrix(matrix.text) @ node_from_shape
            self._skinned.append(_name(element))
            element = self._target(changed.attrib["source"], "geometry", "controller")
        return element, node_from_shape

    def _place(self, shape: _Shape, world_from_shape: NDArray[np.float64], label: int) -> None:
        points, corners, n_corners = shape
        self._n_faces += int((n_corners - 2).sum())
        check_budget(self._n_faces, self._budget, self._n_vertices + len(points))
        if np.linalg.det(world_from_shape[:3, :3]) < 0:  # mirrored: it would face inwards
            corners = corners[_reversed_rows(n_corners)]
        self._vertices.append(points @ world_from_shape[:3, :3].T + world_from_shape[:3, 3])
        self._corners.append(corners + self._n_vertices)
        self._n_corners.append(n_corners)
        self._labels.append(np.full(len(n_corners), label))
        self._n_vertices += len(points)

    def _shape(self, geometry: Element) -> _Shape:
        """Shape of a geometry, read once."""
        key = geometry.get("id", "")
        if key in self._shapes:
            return self._shapes[key]
        points, corners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        n_corners = [np.empty(0, np.int64)]
        first_of: dict[str, int] = {}
        n_points = n_faces = 0
        left_out = unknown_children(geometry, "mesh", "asset", "extra")
        for mesh in children(geometry, "mesh"):
            left_out += unknown_children(mesh, *POLYGONS, *STRIPS, *LINES, *NO_SURFACE)
        self._left_out += [f"{name} of {_name(geometry)!r}" for name in left_out]
        primitives = [each for mesh in children(geometry, "mesh") for each in mesh]
        for primitive in primitives:
            if local_name(primitive) in LINES:
                self._n_lines += 1
            if local_name(primitive) not in (*POLYGONS, *STRIPS):
                continue
            indices, counts, source = self._primitive(primitive, _name(geometry))
            if not len(counts):
                continue
            own = self._positions(source)
            n_faces += int((counts - 2).sum())
            check_budget(n_faces, self._bytes_left, n_points + (source not in first_of) * len(own))
            if not (indices.min() >= 0 and indices.max() < len(own)):
                raise MeshError(
                    f"geometry {_name(geometry)!r}: vertex indices must lie in 0 ... "
                    f"{len(own) - 1}, got {indices.min()} ... {indices.max()}; export it again"
                )
            if source not in first_of:
                first_of[source] = n_points
                points.append(own)
                n_points += len(own)
            corners.append(indices + first_of[source])
            n_corners.append(counts)
        shape = np.concatenate(points), np.concatenate(corners), np.concatenate(n_corners)
        self._shapes[key] = shape
        return shape

    def _primitive(self, primitive: Element, owner: str) -> tuple[IntArray, IntArray, str]:
        """Vertex of each corner, corners of each polygon, and the URL of the vertices."""
        kind = local_name(primitive)
        if children(primitive, "ph"):
            raise MeshError(f"geometry {owner!r} has polygons with holes; triangulate them first")
        inputs = children(primitive, "input")
        offsets = [int(each.get("offset", "0")) for each in inputs]
        stride = max(offsets) + 1
        (at,) = {
            (offset, each.attrib["source"])
            for offset, each in zip(offsets, inputs, strict=True)
            if each.get("semantic") == "VERTEX"
        }
        # `polygons` and strips have an element each: about 2 us of this loop and the next one.
        rows = [integers(each.text) for each in children(primitive, "p")]
        if min(offsets) < 0 or any(len(row) % stride for row in rows):
            raise MeshError(
                f"geometry {owner!r}: {kind} of {stride} indices a corner wanted, got "
                f"{sum(map(len, rows))} indices; the file is truncated, export it again"
            )
        rows = [row[at[0] :: stride] for row in rows]
        indices = np.concatenate([np.empty(0, np.int64), *rows])
        if kind == "triangles":
            counts = np.full(len(indices) // 3, 3)
        elif kind == "polylist":
            counts = integers(" ".join(each.text or "" for each in children(primitive, "vcount")))
        else:
            counts = np.array([len(row) for row in rows], dtype=np.int64)
        promised = int(primitive.attrib["count"])
        if promised != len(counts) or counts.sum() != len(indices):
            raise MeshError(
                f"geometry {owner!r} promises {promised} {kind}, {len(counts)} with {counts.sum()} "
                f"corners and {len(indices)} indices are there; it is truncated, export it again"
            )
        if len(counts) and counts.min() < 3:
            raise MeshError(
                f"geometry {owner!r}: {kind} of 3 corners or more wanted, got {counts.min()}; "
                "export it again"
            )
        if kind in STRIPS:
            indices = np.concatenate(
                [np.empty(0, np.int64), *(_strip(row, kind == "tristrips") for row in rows)]
            )
            counts = np.full(len(indices) // 3, 3)
        return indices, counts, at[1]

    def _positions(self, url: str) -> NDArray[np.float64]:
        """(V, 3) points of an element `vertices`, parsed once."""
        if url not in self._points:
            (entry,) = [
                each
                for each in children(self._target(url, "vertices"), "input")
                if each.get("semantic") == "POSITION"
            ]
            self._points[url] = self._source(entry.attrib["source"])
        return self._points[url]

    def _source(self, url: str) -> NDArray[np.float64]:
        """(V, 3) numbers of a source, by its accessor."""
        source = self._target(url, "source")
        (accessor,) = [
            each
            for common in children(source, "technique_common")
            for each in children(common, "accessor")
        ]
        array = self._target(accessor.attrib["source"], "float_array")
        values = floats(array.text)
        if len(values) != (promised := int(array.attrib["count"])):
            raise MeshError(
                f"source {url[:80]!r} promises {promised} numbers, {len(values)} are there; it is "
                "truncated, export it again"
            )
        names = [each.get("name") for each in children(accessor, "param")]
        columns = [column for column, name in enumerate(names) if name] or [0, 1, 2]
        if len(columns) != 3:
            raise MeshError(f"source {url[:80]!r}: 3 coordinates wanted, got {len(columns)}")
        count, offset = int(accessor.attrib["count"]), int(accessor.get("offset", "0"))
        stride = int(accessor.get("stride", "1"))
        if not (count >= 0 and offset >= 0 and stride > max(columns)) or (
            offset + count * stride > len(values)
        ):
            raise MeshError(
                f"source {url[:80]!r} asks for {count} points of {stride} numbers from {offset} "
                f"on, {len(values)} numbers are there; it is truncated, export it again"
            )
        return values[offset : offset + count * stride].reshape(count, stride)[:, columns]

    def _notes(self) -> list[str]:
        """Notes on content of the file that was not read."""
        notes = []
        if self._skinned:
            more = f" (and {len(self._skinned) - 1} others)" if len(self._skinned) > 1 else ""
            notes.append(f"{self._skinned[0]!r}{more} is skinned or morphed; it is read unposed")
        if self._left_out:
            notes.append(f"not read: {', '.join(self._left_out[:5])}; the shape may be incomplete")
        if self._n_lines:
            notes.append(f"{self._n_lines} sets of lines were not read")
        moved = [
            each
            for library in children(self._root, "library_animations")
            for each in children(library, "animation")
        ]
        if moved:
            notes.append(f"{len(moved)} animations were not played; the nodes are at rest")
        known = [
            each.get("id", "")
            for library in children(self._root, "library_geometries")
            for each in children(library, "geometry")
        ]
        if n_unused := sum(key not in self._shapes for key in known):
            notes.append(f"{n_unused} geometries belong to no node of the scene, not read")
        return notes


def _name(element: Element) -> str:
    """Name of an element for people, or its id."""
    return (element.get("name") or element.get("id") or "")[:80]


def _parent_from_node(node: Element) -> NDArray[np.float64] | None:
    """Product of the transforms of a node, in their order; None for lookat and skew."""
    product: NDArray[np.float64] = np.eye(4)
    for each in children(node, *TRANSFORMS):
        kind = local_name(each)
        if kind in ("lookat", "skew"):
            return None
        step: NDArray[np.float64] = np.eye(4)
        if kind == "matrix":
            step = _matrix(each.text)
        elif kind == "translate":
            step[:3, 3] = _numbers(each.text, 3)
        elif kind == "scale":
            step[[0, 1, 2], [0, 1, 2]] = _numbers(each.text, 3)
        else:
            *axis, angle_deg = _numbers(each.text, 4)
            if angle_deg:  # the axis of no rotation is often 0 0 0
                step[:3, :3] = rotation_about(axis, np.radians(angle_deg))
        product = product @ step
    return product


def _matrix(text: str | None) -> NDArray[np.float64]:
    """(4, 4) matrix by rows; its last row must be 0 0 0 1."""
    matrix = _numbers(text, 16).reshape(4, 4)
    if not np.allclose(matrix[3], (0, 0, 0, 1), rtol=0, atol=AFFINE_ROW_TOLERANCE):
        raise MeshError(
            f"a matrix whose last row is 0 0 0 1 wanted, got {matrix[3].tolist()}; export it again"
        )
    return matrix


def _numbers(text: str | None, count: int) -> NDArray[np.float64]:
    values = floats(text)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise MeshError(
            f"a transform of {count} finite numbers wanted, got {(text or '').strip()[:60]!r}; "
            "correct it"
        )
    return values


def _strip(row: IntArray, alternates: bool) -> IntArray:
    """Corners of the triangles of a strip, every other one reversed, or of a fan."""
    i = np.arange(len(row) - 2)
    if alternates:
        return row[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)].ravel()
    return row[np.stack([0 * i, i + 1, i + 2], axis=1)].ravel()


def _reversed_rows(n_corners: IntArray) -> IntArray:
    """Indices that reverse the corners of each polygon but its first one."""
    polygon = np.repeat(np.arange(len(n_corners)), n_corners)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    place = np.arange(len(polygon)) - first
    return first + (n_corners[polygon] - place) % n_corners[polygon]
