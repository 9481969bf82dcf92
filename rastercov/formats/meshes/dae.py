"""COLLADA files (.dae): nodes with their transforms, and the polygons of their geometries.

Read are the meshes that the nodes of the scene name, one group per node, in the coordinates of the
file: its up axis is not turned. Skins are placed by their joints at rest, morphed by their weights.
No other file is ever opened; content that is not read is a note, or an error where the rest would
be wrong without it.

Source: Khronos Group. COLLADA - Digital Asset Schema Release 1.4.1. 2008.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import FloatArray, IntArray, MeshError, UnknownNames, Vocabulary, matmul
from rastercov.core.mesh.arrays import rotation_about
from rastercov.formats.meshes.polygons import (
    Assembly,
    PolygonElement,
    Polygons,
    PolygonShape,
    broken,
    check,
    check_affine,
    check_budget,
    check_indices,
    reverse_rows,
    strip_triangles,
)
from rastercov.formats.meshes.skins import BYTES_PER_JOINT, BYTES_PER_POINT, Influences, place_skin
from rastercov.formats.meshes.xml_tree import (
    below,
    children,
    floats,
    integers,
    local_name,
    look_at_names,
    parse_xml,
    transform_numbers,
)

POLYGONS = ("triangles", "polylist", "polygons")
STRIPS = ("trifans", "tristrips")
LINES = ("lines", "linestrips")
TRANSFORMS = ("matrix", "translate", "rotate", "scale", "lookat", "skew")
NAMES = Vocabulary(
    "COLLADA scene asset unit meter instance_visual_scene library_visual_scenes visual_scene "
    "library_nodes node instance_node instance_geometry instance_controller url "
    "library_geometries geometry mesh source vertices input offset semantic triangles polylist "
    "polygons tristrips trifans lines linestrips technique_common accessor count stride "
    "library_controllers controller skin morph joints vertex_weights targets",
    "matrix translate rotate scale lookat skew p ph v vcount float_array Name_array IDREF_array "
    "param bind_shape_matrix skeleton method",
    "name sid id type layer proxy version base schemaLocation set material extra contributor "
    "created coverage keywords modified revision subject title up_axis "
    "SIDREF_array token_array int_array bool_array technique evaluate_scene bind_material "
    "instance_camera instance_light instance_physics_scene "
    "instance_kinematics_scene library_animations library_animation_clips library_cameras "
    "library_effects library_force_fields library_images library_lights library_materials "
    "library_physics_materials library_physics_models library_physics_scenes "
    "library_articulated_systems library_formulas library_joints library_kinematics_models "
    "library_kinematics_scenes",
)


def read(data: bytes, budget: int) -> Polygons:
    """Polygons of a COLLADA file in metres, one group per node, in scene order."""
    root = parse_xml(data, "the file", budget)
    name = local_name(root)
    check(name == "COLLADA", f"expected an element COLLADA, got {name[:40]!r}")
    return _Scene(root, budget).polygons()


Skeletons = tuple[str, ...]
"""URLs of the nodes below which the joints of a skin are."""


class _Scene:
    """Elements of a file by their ids, and what its nodes have been made of so far."""

    def __init__(self, root: Element, budget: int) -> None:
        self._root, self._budget = root, budget
        self._by_id: dict[str, list[Element]] = {}
        for element in root.iter():
            if (key := element.get("id")) is not None:
                self._by_id.setdefault(key, []).append(element)
        self._shapes: dict[str, PolygonShape] = {}
        self._controlled: dict[tuple[Element, Skeletons], tuple[FloatArray, PolygonShape, str]] = {}
        self._joints: dict[str, dict[str, Element]] = {}
        self._numbers: dict[Element, FloatArray] = {}
        self._sources: dict[object, FloatArray] = {}  # by array, rows and columns
        self._n_lines = self._n_bytes = 0
        self._skinned: dict[str, None] = {}
        self._more_notes: dict[str, None] = {}
        self._unknown = UnknownNames(MeshError)
        look_at_names(root, NAMES, self._unknown)

    def polygons(self) -> Polygons:
        """All polygons that the nodes of the scene name."""
        roots = [(np.eye(4), node) for node in children(self._visual_scene(), "node")]
        polygons = Assembly(self._node, self._budget).polygons(roots, self._metres_per_unit())
        return replace(polygons, notes=self._notes())

    def _metres_per_unit(self) -> float | None:
        """Metres in a unit of the file, None where it states none."""
        units = below(self._root, "asset", "unit")
        text = units[0].get("meter") if units else None
        if text is None:
            return None
        value = floats(text)
        is_length = value.shape == (1,) and 0 < value[0] < np.inf
        check(is_length, f"expected a unit of a positive number of metres, got {text[:40]!r}")
        return float(value[0])

    def _visual_scene(self) -> Element:
        """The scene that is to be shown, or the only one."""
        for instance in below(self._root, "scene", "instance_visual_scene"):
            return self._target(instance.attrib["url"], "visual_scene")
        scenes = below(self._root, "library_visual_scenes", "visual_scene")
        check(len(scenes) == 1, f"expected one scene, or the name of one, got {len(scenes)}")
        return scenes[0]

    def _target(self, url: str, *kinds: str) -> Element:
        """Element that a URL names, of one of these kinds."""
        shown = repr(url[:80])
        is_here = url.startswith("#")
        check(is_here, f"expected an element of this file, got {shown}, which is never opened")
        entry = self._by_id.get(url[1:], [])
        got = f"an element {local_name(entry[0])}" if entry else "nothing of that id"
        check(
            entry and local_name(entry[0]) in kinds, f"expected {shown} to be {kinds[0]}, got {got}"
        )
        check(len(entry) == 1, f"expected the id {shown} once, got it twice")
        return entry[0]

    def _node(self, node: Element) -> PolygonElement:
        """A node: the geometries and the nodes that it holds or names."""
        step = _parent_from_node(node)
        pieces: list[tuple[FloatArray | None, Any]] = []
        name = _name(node)
        for each in node:
            kind, url = local_name(each), each.get("url", "")
            if kind == "node":
                pieces.append((step, each))
            elif kind == "instance_node":
                pieces.append((step, self._target(url, "node")))
            elif kind == "instance_geometry":
                geometry = self._target(url, "geometry")
                name = name or _name(geometry)
                pieces.append((step, self._shape(geometry)))
            elif kind == "instance_controller":
                roots = tuple((root.text or "").strip() for root in children(each, "skeleton"))
                place, shape, own = self._of_controller(self._target(url, "controller"), roots)
                name = name or own
                pieces.append((None if step is None else matmul(step, place), shape))
        why = "lookat or skew; export it with matrices"
        return PolygonElement(name, f"node {name!r}", pieces, why)

    def _of_controller(
        self, controller: Element, roots: Skeletons
    ) -> tuple[FloatArray, PolygonShape, str]:
        """Place of a controller in its node, its shape, and the name of its geometry; found once.

        One that is a part of itself is nested too deeply.
        """
        if (controller, roots) in self._controlled:
            return self._controlled[controller, roots]
        (changed,) = children(controller, "skin", "morph")
        target = self._target(changed.attrib["source"], "geometry", "controller")
        place: FloatArray = np.eye(4)
        if local_name(target) == "controller":
            place, shape, name = self._of_controller(target, roots)
        else:
            shape, name = self._shape(target), _name(target)
        for matrix in children(changed, "bind_shape_matrix"):
            place = matmul(_matrix(matrix.text), place)
        if shape.n_faces and (of_targets := children(changed, "targets")):
            shape = self._morph(shape, of_targets[0], changed.get("method") == "RELATIVE")
        elif shape.n_faces and (of_vertices := children(changed, "vertex_weights")):
            what = f"controller {_name(controller)!r}"
            check(not shape.is_placed, f"{what}: expected a geometry, got another skin")
            shape = self._pose_shape(what, shape, place, changed, of_vertices[0], roots)
        elif shape.n_faces:
            self._skinned[_name(controller)] = None
        self._controlled[controller, roots] = place, shape, name
        return place, shape, name

    def _morph(self, shape: PolygonShape, targets: Element, is_relative: bool) -> PolygonShape:
        """Shape with its morph targets by their weights."""
        inputs = _sources_in(targets)
        names = self._words(inputs["MORPH_TARGET"])
        weights = self._source(inputs["MORPH_WEIGHT"], 1)[:, 0]
        check(len(names) == len(weights), "expected a weight of each morph target, got others")
        points = shape.points * (1.0 if is_relative else 1.0 - weights.sum())
        for name, weight in zip(names, weights.tolist(), strict=True):
            if not weight:
                continue
            own = self._shape(self._target(f"#{name}", "geometry")).points
            check(
                len(own) == len(points),
                f"morph target {name[:40]!r}: expected {len(points)} points, got {len(own)}",
            )
            points = points + weight * own
        return shape._replace(points=points)

    def _pose_shape(
        self,
        what: str,
        shape: PolygonShape,
        place: FloatArray,
        skin: Element,
        vertices: Element,
        roots: Skeletons,
    ) -> PolygonShape:
        """Shape in the world, as the joints of a skin place it."""
        (joints,) = children(skin, "joints")
        inputs = _sources_in(joints)
        names, n = self._words(inputs["JOINT"]), len(shape.points)
        self._n_bytes += n * BYTES_PER_POINT + len(names) * BYTES_PER_JOINT
        check_budget(0, self._budget, n_bytes=self._n_bytes)  # many skins may share their joints
        joint_from_shape = self._source(inputs["INV_BIND_MATRIX"], 16).reshape(-1, 4, 4)
        check(
            len(names) == len(joint_from_shape),
            f"{what}: expected a bind matrix for each of {len(names)} joints, got "
            f"{len(joint_from_shape)}",
        )
        world_from_joint = np.array([self._world_from_joint(what, name, roots) for name in names])
        for each in joint_from_shape:
            check_affine(each, what)
        given = {each.get("semantic"): each for each in children(vertices, "input")}
        n_each = _numbers_of(vertices, "vcount")
        values = _numbers_of(vertices, "v")
        stride = max(int(each.get("offset", "0")) for each in given.values()) + 1
        check(
            len(n_each) == n
            and n_each.min(initial=0) >= 0
            and n_each.sum() * stride == len(values),
            f"{what}: expected joints and weights of {n} points, got {len(n_each)} with "
            f"{n_each.sum()} and {len(values)} indices; truncated",
        )
        at = {key: values[int(each.get("offset", "0")) :: stride] for key, each in given.items()}
        weights = self._source(given["WEIGHT"].attrib["source"], 1)[:, 0]
        check_indices(at["WEIGHT"], len(weights), what)
        by = Influences(np.repeat(np.arange(n), n_each), at["JOINT"], weights[at["WEIGHT"]])
        points, is_mirrored, note = place_skin(
            what, shape.points, matmul(matmul(world_from_joint, joint_from_shape), place), by
        )
        if note:
            self._more_notes[note] = None
        first = np.cumsum(shape.n_corners) - shape.n_corners
        turns = np.repeat(is_mirrored[shape.corners[first]], shape.n_corners)
        rows = np.where(turns, reverse_rows(shape.n_corners), np.arange(len(turns)))
        return shape._replace(points=points, corners=shape.corners[rows], is_placed=True)

    def _world_from_joint(self, what: str, name: str, roots: Skeletons) -> FloatArray:
        """Place of a joint: the node with that sid below the skeletons, or with that id."""
        for root in (*roots, ""):
            if root not in self._joints:
                top = self._target(root, "node") if root else self._visual_scene()
                elements: dict[str, Element] = {}
                for key in ("sid", "id"):
                    for node in top.iter():
                        if local_name(node) == "node" and (own := node.get(key)):
                            elements.setdefault(own, node)
                self._joints[root] = elements
            if (joint := self._joints[root].get(name)) is not None:
                break
        matrix = None if joint is None else self._world_from_nodes.get(joint)
        if matrix is None:
            raise broken(
                f"{what}: expected joint {name[:40]!r} to be a node of the scene, got none"
            )
        check(
            np.isfinite(matrix).all(), f"{what}: expected joints with matrices, got lookat or skew"
        )
        return matrix

    @cached_property
    def _world_from_nodes(self) -> dict[Element, FloatArray]:
        """Place of each node of the scene, of its first instance; NaN for lookat and skew."""
        values_by_key: dict[Element, FloatArray] = {}
        stack = [(np.eye(4), node) for node in reversed(children(self._visual_scene(), "node"))]
        while stack:
            above, node = stack.pop()
            if node in values_by_key:
                continue
            step = _parent_from_node(node)
            values_by_key[node] = matmul(above, np.full((4, 4), np.nan) if step is None else step)
            below_it = [
                each if local_name(each) == "node" else self._target(each.get("url", ""), "node")
                for each in children(node, "node", "instance_node")
            ]
            stack += [(values_by_key[node], each) for each in reversed(below_it)]
        return values_by_key

    def _words(self, url: str) -> list[str]:
        """Names of a source, by its array."""
        (array,) = children(self._target(url, "source"), "Name_array", "IDREF_array")
        return (array.text or "").split()

    def _shape(self, geometry: Element) -> PolygonShape:
        """Shape of a geometry, read once."""
        key = geometry.get("id", "")
        if key in self._shapes:
            return self._shapes[key]
        points, corners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        n_corners = [np.empty(0, np.int64)]
        first_of: dict[int, int] = {}  # by arrays of `_sources`: many `vertices` may share one
        n_points = n_faces = 0
        for primitive in (each for mesh in children(geometry, "mesh") for each in mesh):
            self._n_lines += local_name(primitive) in LINES
            if local_name(primitive) not in (*POLYGONS, *STRIPS):
                continue
            indices, counts, url = self._primitive(primitive, _name(geometry))
            if not len(counts):
                continue
            own = self._source(_sources_in(self._target(url, "vertices"))["POSITION"])
            n_faces += int((counts - 2).sum())
            is_new = id(own) not in first_of
            check_budget(n_faces, self._budget, n_points + is_new * len(own))
            check_indices(indices, len(own), f"geometry {_name(geometry)!r}")
            if is_new:
                first_of[id(own)] = n_points
                points.append(own)
                n_points += len(own)
            corners.append(indices + first_of[id(own)])
            n_corners.append(counts)
        self._shapes[key] = PolygonShape(
            np.concatenate(points), np.concatenate(corners), np.concatenate(n_corners), n_faces
        )
        return self._shapes[key]

    def _primitive(self, primitive: Element, owner: str) -> tuple[IntArray, IntArray, str]:
        """Vertex of each corner, corners of each polygon, and the URL of the vertices."""
        kind = local_name(primitive)
        where = f"geometry {owner!r}"
        check(
            not children(primitive, "ph"),
            f"{where}: expected polygons without holes, got holes",
            "triangulate them",
        )
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
        check(
            min(offsets) >= 0 and not any(len(row) % stride for row in rows),
            f"{where}: expected {kind} of {stride} indices per corner, got "
            f"{sum(map(len, rows))} indices; truncated",
        )
        rows = [row[at[0] :: stride] for row in rows]
        indices = np.concatenate([np.empty(0, np.int64), *rows])
        if kind == "triangles":
            counts = np.full(len(indices) // 3, 3)
        elif kind == "polylist":
            counts = _numbers_of(primitive, "vcount")
        else:
            counts = np.array([len(row) for row in rows], np.int64)
        promised = int(primitive.attrib["count"])
        check(
            promised == len(counts) and counts.sum() == len(indices),
            f"{where}: expected {promised} {kind}, as declared, got {len(counts)} with "
            f"{counts.sum()} corners and {len(indices)} indices; truncated",
        )
        least = counts.min(initial=3)
        check(least >= 3, f"{where}: expected {kind} of 3 corners or more, got {least}")
        if kind in STRIPS:
            is_fan = kind == "trifans"
            corners = [row[strip_triangles(len(row), is_fan=is_fan)].ravel() for row in rows]
            indices = np.concatenate([np.empty(0, np.int64), *corners])
            counts = np.full(len(indices) // 3, 3)
        return indices, counts, at[1]

    def _source(self, url: str, n_columns: int = 3) -> FloatArray:
        """(V, n_columns) numbers of a source, by its accessor; one array for equal accessors."""
        source = self._target(url, "source")
        (accessor,) = below(source, "technique_common", "accessor")
        array = self._target(accessor.attrib["source"], "float_array")
        if array not in self._numbers:
            self._numbers[array] = floats(array.text)
        values = self._numbers[array]
        where, n = f"source {url[:80]!r}", len(values)
        promised = int(array.attrib["count"])
        check(
            n == promised, f"{where}: expected {promised} numbers, as declared, got {n}; truncated"
        )
        names = [each.get("name") for each in children(accessor, "param")]
        columns = [column for column, name in enumerate(names) if name]
        if not columns or n_columns > len(names):  # a matrix has one name
            columns = list(range(n_columns))
        check(
            len(columns) == n_columns,
            f"{where}: expected {n_columns} coordinates, got {len(columns)}",
        )
        count, offset = int(accessor.attrib["count"]), int(accessor.get("offset", "0"))
        stride = int(accessor.get("stride", "1"))
        end = offset + count * stride
        check(
            count >= 0 and offset >= 0 and stride > max(columns) and end <= n,
            f"{where}: expected {count} points of {stride} numbers from {offset} on, got {n} "
            "numbers; truncated",
        )
        key = array, range(offset, end, stride), tuple(columns)
        if key not in self._sources:
            self._sources[key] = values[offset:end].reshape(count, stride)[:, columns]
        return self._sources[key]

    def _notes(self) -> list[str]:
        """Notes on content of the file that was not read."""
        notes = []
        if self._skinned:
            more = f" (and {len(self._skinned) - 1} others)" if len(self._skinned) > 1 else ""
            notes.append(
                f"read skinned or morphed {next(iter(self._skinned))!r}{more} without weights"
            )
        notes += self._more_notes
        notes += self._unknown.notes()
        for axis in below(self._root, "asset", "up_axis"):
            if (text := (axis.text or "").strip()) in ("X_UP", "Y_UP"):
                notes.append(f"its up axis, {text[0]}, is not turned to z")
        if self._n_lines:
            notes.append(f"ignored {self._n_lines} sets of lines")
        if moved := below(self._root, "library_animations", "animation"):
            notes.append(f"ignored {len(moved)} animations: the nodes are at rest")
        known = below(self._root, "library_geometries", "geometry")
        if n_unused := sum(each.get("id", "") not in self._shapes for each in known):
            notes.append(f"ignored {n_unused} geometries, which belong to no node of the scene")
        return notes


def _name(element: Element) -> str:
    """Name of an element for people, or its id."""
    return (element.get("name") or element.get("id") or "")[:80]


def _sources_in(element: Element) -> dict[str | None, str]:
    """URLs of the sources of an element by their semantics."""
    return {each.get("semantic"): each.attrib["source"] for each in children(element, "input")}


def _numbers_of(element: Element, kind: str) -> IntArray:
    """Whole numbers of all elements of a kind in another one."""
    return integers(" ".join(each.text or "" for each in children(element, kind)))


def _parent_from_node(node: Element) -> FloatArray | None:
    """Product of the transforms of a node, in their order; None for lookat and skew."""
    product: FloatArray = np.eye(4)
    for each in children(node, *TRANSFORMS):
        kind = local_name(each)
        if kind in ("lookat", "skew"):
            return None
        step: FloatArray = np.eye(4)
        if kind == "matrix":
            step = _matrix(each.text)
        elif kind == "translate":
            step[:3, 3] = transform_numbers(each.text, 3)
        elif kind == "scale":
            step[[0, 1, 2], [0, 1, 2]] = transform_numbers(each.text, 3)
        else:
            *axis, angle_deg = transform_numbers(each.text, 4)
            if angle_deg:  # the axis of no rotation is often 0 0 0
                step[:3, :3] = rotation_about(axis, np.radians(angle_deg))
        product = matmul(product, step)
    return product


def _matrix(text: str | None) -> FloatArray:
    """(4, 4) matrix by rows; its last row must be 0 0 0 1."""
    matrix = transform_numbers(text, 16).reshape(4, 4)
    check_affine(matrix, "a node")
    return matrix
