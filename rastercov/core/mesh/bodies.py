"""Rigid bodies of a mesh: what their rest pose decides once, and all other poses share.

Welding, topology, faces without area and contacts within a body are the same in every pose. A frame
is the product of vertices and poses, and contacts between bodies, which are kept by relative pose.
Vertices of two bodies are never welded, even where they coincide: edges between bodies are borders.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import field
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    LARGEST_COORDINATE,
    BoolArray,
    ByName,
    FloatArray,
    Int32Array,
    IntArray,
    MeshError,
    Once,
    StrPath,
    WholeArray,
    cos,
    dots,
    frozen_record,
    matmul,
    norm,
    offsets_of,
    owners_of,
    read_only,
    sort_order,
)
from rastercov.core.mesh.arrays import apply_pose, frozen, inverse
from rastercov.core.mesh.contacts import (
    MOST_PARTNERS,
    PAIRS_A_FACE,
    ROUNDING_FACTOR,
    Contacts,
    Partners,
    TriangleTree,
    contact_partners,
    touching_faces,
)
from rastercov.core.mesh.mesh import Mesh
from rastercov.core.mesh.topology import edge_table, first_equal_row
from rastercov.engine import mesh_bodies, mesh_contacts, mesh_tree

OF_EVERY_POSE = (
    *("welded_faces", "topology", "degenerate_mask", "is_closed_outward", "inside_out_mask"),
    *("task_mask", "two_sided_mask", "target_mask"),
)
"""Derived arrays of a mesh that no rigid motion of its bodies changes."""
LEAST_ROOM = 1024
"""Pairs of faces of two bodies that are listed at least."""


class JointPath(NamedTuple):
    """Configurations of joints, one per frame.

    Attributes
    ----------
    joints : (T, J) float64
        Radians, or metres for prismatic joints, in the order of the joint names.
    duration : (T,) float64
        Duration of each frame; 1 unless the file has durations or times.
    """

    joints: FloatArray
    duration: FloatArray


class Jointed(Protocol):
    """Bodies on joints: groups of `mesh`."""

    @property
    def name(self) -> str:
        """Its name, before those of its bodies."""

    @property
    def mesh(self) -> Mesh:
        """All bodies at rest."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, J of them."""

    @property
    def joint_kinds(self) -> tuple[str, ...]:
        """Kind of each joint: "revolute", "continuous" or "prismatic"."""

    @property
    def limits(self) -> FloatArray:
        """(J, 2) least and greatest value of each."""

    @property
    def rest(self) -> FloatArray:
        """(J,) values at rest."""

    def poses(self, joints: ArrayLike) -> dict[str, FloatArray]:
        """Poses of each body that moves, from rest, by (T, J) values of joints."""

    def read_path(self, path: StrPath) -> JointPath:
        """Values of the joints by a file."""


class Moved(NamedTuple):
    """Bodies at rest that a mesh is made of, and their poses, (B, 4, 4)."""

    rest: "Rest"
    poses: FloatArray


@frozen_record
class Rest:
    """Bodies in their rest pose, and what does not change when they move.

    Attributes
    ----------
    mesh : Mesh
        Their faces, welded within each body.
    body : (F,) int32
        Body of each face.
    vertex_body : (V,) int32
    n_bodies : int
        B, with those that are not there.
    whole, kept : Mesh, (F,) int64
        Mesh of all bodies, and the face of it that each face is.
    """

    mesh: Mesh
    body: Int32Array
    vertex_body: Int32Array
    n_bodies: int
    whole: Mesh
    kept: IntArray

    @classmethod
    def of(cls, mesh: Mesh, body: IntArray, is_there: BoolArray) -> Self:
        """Bodies of a mesh, by the body (F,) of each face, that are there, (B,) bool."""
        kept = np.flatnonzero(is_there[body])
        own, n = body[kept], len(is_there)
        keys, corners = np.unique(mesh.faces[kept] * n + own[:, None], return_inverse=True)
        vertex, of_vertex = np.divmod(keys, n)
        made = Mesh(
            mesh.vertices[vertex],
            corners.reshape(-1, 3),
            mesh.groups,
            mesh.face_group[kept],
            mesh.source_face[kept],
        )
        return cls(made, own.astype(np.int32), of_vertex.astype(np.int32), n, mesh, kept)

    def __post_init__(self) -> None:
        self.mesh.__dict__["welded_faces"] = frozen(self._weld())
        self.mesh.__dict__["moved_from"] = Moved(self, np.empty((0, 4, 4)))

    def _weld(self) -> IntArray:
        """Faces by the first vertex of their body at each point."""
        position = np.arange(self.mesh.n_vertices)
        rows = (self.mesh.vertices + 0.0).view(np.uint64)  # -0.0 + 0.0 is 0.0
        for index in np.unique(self.vertex_body):
            own = np.flatnonzero(self.vertex_body == index)
            position[own] = own[first_equal_row(rows[own])]
        return position[self.mesh.faces]

    @cached_property
    def opaque(self) -> "Rest | None":
        """The same of the faces that hide; None where no face does, or no target is there."""
        mesh = self.mesh
        if not mesh.has_targets or mesh.target_mask.all():
            return None
        hides = ~mesh.target_mask
        used = np.unique(mesh.faces[hides])
        return Rest(
            mesh.opaque,
            self.body[hides],
            self.vertex_body[used],
            self.n_bodies,
            self.whole,
            self.kept[hides],
        )

    @cached_property
    def boxes(self) -> FloatArray:
        """(B, 8, 3) corners of the box of each body, NaN for one that is not there."""
        return corners_of(*boxes_of(self.vertex_body, self.mesh.vertices[:, None], self.n_bodies))

    def at(self, poses: FloatArray, diagonal: float, *, of_occluders: bool = True) -> Mesh:
        """The mesh by poses (B, 4, 4) of its bodies.

        Parameters
        ----------
        poses : (B, 4, 4) float64
            Rigid motions from the rest pose.
        diagonal : float
            Greatest of all frames, metres: contacts have one tolerance.
        of_occluders : bool
            False where contacts between two bodies without an evaluated face are not asked for:
            they change no figure of an evaluated face.
        """
        mesh, moved, bounds = self.mesh, np.empty_like(self.mesh.vertices), np.empty((2, 3))
        poses = read_only(poses, np.float64)
        mesh_bodies.move_points(mesh.vertices, self.vertex_body, poses, moved, bounds)
        if not np.abs(bounds).max() <= LARGEST_COORDINATE:
            raise MeshError(
                f"expected poses that keep bodies within ±{LARGEST_COORDINATE:g} m, got one that "
                "moves them farther"
            )
        own: ByName = {"moved_from": Moved(self, poses), "_opaque": None}
        if mesh.has_targets and self.opaque is None:
            del own["_opaque"]
        elif self.opaque is not None:
            # Its own bounding box is that of what hides.
            own["_opaque"] = self.opaque.at(poses, diagonal, of_occluders=of_occluders)
        else:
            within, is_asked = self._within, None if of_occluders else self._has_task
            own["contacts"] = BodyContacts(
                moved,
                mesh.faces,
                mesh.degenerate_mask,
                diagonal,
                mesh.topology.components,
                within,
                poses,
                is_asked,
            )
        shared = {name: getattr(mesh, name) for name in OF_EVERY_POSE}
        return mesh._with_vertices(frozen(moved), bounds=frozen(bounds), **shared, **own)

    @cached_property
    def _has_task(self) -> BoolArray:
        """(B,) bodies with an evaluated face."""
        has_task = np.zeros(self.n_bodies, bool)
        has_task[self.body[self.mesh.task_mask]] = True
        return has_task

    @cached_property
    def _within(self) -> "Within":
        mesh = self.mesh
        return Within(mesh.vertices, mesh.faces, mesh.degenerate_mask, self.body, self.boxes)


def boxes_of(
    label: WholeArray, corners: FloatArray, n: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest coordinates, (n, D), of corners (N, C, D) by their labels, (N,).

    Without n there are as many as labels. inf and -inf where nothing has a label.
    """
    count = int(label.max(initial=-1)) + 1 if n is None else n
    low, high = np.full((2, count, corners.shape[2]), np.inf)
    np.minimum.at(low, label, corners.min(axis=1))
    np.minimum.at(high, label, -corners.max(axis=1))
    return low, -high


def corners_of(low: FloatArray, high: FloatArray) -> FloatArray:
    """(..., 8, 3) corners of boxes (..., 3); NaN for empty ones."""
    is_empty = ~(low <= high).all(axis=-1)
    ends = np.stack((low, high), axis=-2)
    ends[is_empty] = np.nan
    at = np.indices((2, 2, 2)).reshape(3, 8)
    return np.stack([ends[..., at[k], k] for k in range(3)], axis=-1)


class Body(NamedTuple):
    """One body: rows of its faces, its own points, faces, tree and faces without area."""

    rows: IntArray
    points: FloatArray
    faces: Int32Array
    flat: BoolArray


class Between(NamedTuple):
    """Contacts of two bodies: faces that touch, and the pairs, None where there are too many."""

    touching: IntArray
    pairs: IntArray | None


NO_CONTACTS = Between(np.empty(0, np.int64), np.empty((0, 2), np.int64))


@frozen_record
class Within:
    """Contacts within bodies, once for all frames, and those between two at their last pose.

    Attributes
    ----------
    vertices, faces, degenerate_mask
        As of `Contacts`, at rest.
    body : (F,) int32
    boxes : (B, 8, 3) float64
    """

    vertices: FloatArray
    faces: IntArray
    degenerate_mask: BoolArray
    body: Int32Array
    boxes: FloatArray
    _known: dict[Any, Once[Any]] = field(default_factory=dict, init=False)
    _last: dict[tuple[int, int, float], tuple[bytes, Between]] = field(
        default_factory=dict, init=False
    )

    def _once(self, key: Hashable, make: Callable[[], object]) -> Any:
        once: Once[Any] = self._known.setdefault(key, Once())
        return once.get(make)

    def touching(self, tolerance: float) -> BoolArray:
        """(F,) faces in contact with another one of their body."""
        return self._once(
            ("touching", tolerance),
            lambda: touching_faces(
                self.vertices,
                self.faces,
                tolerance,
                degenerate_mask=self.degenerate_mask,
                labels=self.body,
            ),
        )

    def of_components(self, tolerance: float, components: Callable[[], Any]) -> BoolArray:
        """(F,) faces in contact with another one of their component, of numbers (F,)."""

        def make() -> BoolArray:
            any_contact = self.touching(tolerance)
            if not any_contact.any():
                return any_contact
            return touching_faces(
                self.vertices,
                self.faces,
                tolerance,
                degenerate_mask=self.degenerate_mask,
                labels=components(),
            )

        return self._once(("components", tolerance), make)

    def partners(self, tolerance: float) -> Partners:
        """Faces of its body in contact with each face; see `Contacts.partners_for`."""
        return self._once(("partners", tolerance), lambda: self._partners(tolerance))

    def _partners(self, tolerance: float) -> Partners:
        touching, counts = self.touching(tolerance), np.zeros(len(self.faces), np.int64)
        lists = [np.empty((0, 2), np.int64)]
        for index in np.unique(self.body[touching]).tolist():
            part = self.part(index)
            own = contact_partners(part.points, part.faces, tolerance, touching[part.rows])
            counts[part.rows] = np.diff(own.starts)
            lists.append(
                np.stack((np.repeat(part.rows, np.diff(own.starts)), part.rows[own.faces]), axis=1)
            )
        pairs = np.concatenate(lists)
        order = sort_order(pairs[:, 0])
        starts = offsets_of(counts)
        return Partners(starts.astype(np.int64), pairs[order, 1].astype(np.int32))

    def part(self, index: int) -> Body:
        """A body by itself."""

        def make() -> Body:
            rows = np.flatnonzero(self.body == index)
            used, corners = np.unique(self.faces[rows], return_inverse=True)
            faces = corners.reshape(-1, 3).astype(np.int32)
            return Body(rows, self.vertices[used], faces, self.degenerate_mask[rows])

        return self._once(("part", index), make)

    def tree(self, index: int) -> tuple[TriangleTree, IntArray]:
        """Tree over the faces with an area of a body, and the face of each of its triangles."""

        def make() -> tuple[TriangleTree, IntArray]:
            part = self.part(index)
            solid = np.flatnonzero(~part.flat)
            tree = TriangleTree.over(part.points, part.faces[solid])
            return tree, part.rows[solid[tree.order]]

        return self._once(("tree", index), make)

    def between(
        self, one: int, other: int, poses: FloatArray, tolerance: float, diagonal: float
    ) -> Between:
        """Contacts of two bodies by their poses."""
        relative = np.eye(4)
        if not np.array_equal(poses[one], poses[other]):
            relative = matmul(inverse(poses[one]), poses[other])
        rounded = relative.copy()
        rounded[:3, 3] /= max(diagonal, 1e-300)
        key, place = np.round(rounded, 12).tobytes(), (one, other, tolerance)
        last = self._last.get(place)
        if last is not None and last[0] == key:
            return last[1]
        between = self._between(one, other, relative, tolerance, diagonal)
        self._last[place] = key, between
        return between

    def _between(
        self, one: int, other: int, relative: FloatArray, tolerance: float, diagonal: float
    ) -> Between:
        if not (_overlap(self.boxes[one], apply_pose(self.boxes[other], relative), tolerance)):
            return NO_CONTACTS
        if not _overlap(
            self.boxes[other], apply_pose(self.boxes[one], inverse(relative)), tolerance
        ):
            return NO_CONTACTS
        if self.part(one).flat.all() or self.part(other).flat.all():
            return NO_CONTACTS
        (tree, face), (other_tree, other_face) = self.tree(one), self.tree(other)
        points = apply_pose(other_tree.points, relative)
        boxes, nodes = np.empty_like(other_tree.boxes), np.empty_like(other_tree.nodes)
        mesh_tree.grow_boxes(points, other_tree.faces, 0.0, boxes, nodes)
        marks, other_marks = np.zeros(len(face), bool), np.zeros(len(other_face), bool)
        pairs = np.empty((LEAST_ROOM + PAIRS_A_FACE * min(len(face), len(other_face)), 2), np.int32)
        scale = 1 / max(diagonal, 1e-300)
        n = mesh_contacts.list_between(
            (tree.points, tree.faces, tree.boxes, tree.nodes),
            (points, other_tree.faces, boxes, nodes),
            scale,
            ROUNDING_FACTOR * tolerance * scale,
            marks,
            other_marks,
            pairs,
        )
        touching = np.concatenate((face[marks], other_face[other_marks]))
        if n > len(pairs):
            return Between(touching, None)
        return Between(touching, np.stack((face[pairs[:n, 0]], other_face[pairs[:n, 1]]), axis=1))


@frozen_record
class BodyContacts(Contacts):
    """Contacts of bodies in a frame.

    Parameters
    ----------
    within : Within
    poses : (B, 4, 4) float64
    asked : (B,) bool or None
        Only pairs of bodies with one of these; None for all.
    """

    within: Within
    poses: FloatArray
    asked: BoolArray | None

    def faces_for(self, distance: float = 0.0) -> BoolArray:
        """As of `Contacts`."""
        return self._once("all", distance, self._all)

    def partners_for(self, distance: float = 0.0) -> Partners:
        """As of `Contacts`."""
        return self._once("partners", distance, self._with_partners)

    def faces_within_components(self, distance: float = 0.0) -> BoolArray:
        """As of `Contacts`; no component is of two bodies."""
        return self._once(
            "within",
            distance,
            lambda tolerance: self.within.of_components(tolerance, self.components),
        )

    def _all(self, tolerance: float) -> BoolArray:
        within, between = self.within.touching(tolerance), self._between(tolerance)
        if not between:
            return within
        result = within.copy()
        for each in between:
            result[each.touching] = True
        return result

    def _with_partners(self, tolerance: float) -> Partners:
        """Partners within and between bodies; none of a face whose list would not be whole."""
        own, between = self.within.partners(tolerance), self._between(tolerance)
        if not between:
            return own
        n = len(self.faces)
        is_whole = ~(self.within.touching(tolerance) & (np.diff(own.starts) == 0))
        lists = [np.stack((owners_of(np.diff(own.starts)), own.faces), axis=1)]
        for each in between:
            if each.pairs is None:
                is_whole[each.touching] = False
            else:
                lists += [each.pairs, each.pairs[:, ::-1]]
        both = np.concatenate(lists)
        counts = np.bincount(both[:, 0], minlength=n)
        is_whole &= counts <= MOST_PARTNERS
        both = both[is_whole[both[:, 0]]]
        both = both[np.lexsort(both.T[::-1])]
        counts[~is_whole] = 0
        starts = offsets_of(counts)
        return Partners(starts.astype(np.int64), np.ascontiguousarray(both[:, 1], np.int32))

    def _between(self, tolerance: float) -> list[Between]:
        """Contacts of each pair of bodies that has any."""
        boxes = move_boxes(self.within.boxes, self.poses)
        there = np.flatnonzero(~np.isnan(boxes[:, 0, 0]))
        low, high = boxes.min(axis=1) - tolerance, boxes.max(axis=1) + tolerance
        between = []
        for one, other in combinations(there.tolist(), 2):
            if self.asked is not None and not (self.asked[one] or self.asked[other]):
                continue
            if (low[one] <= high[other]).all() and (low[other] <= high[one]).all():
                each = self.within.between(one, other, self.poses, tolerance, self.diagonal)
                if len(each.touching):
                    between.append(each)
        return between


def place_bodies(mesh: Mesh, poses: Mapping[str, FloatArray]) -> tuple[Mesh, IntArray]:
    """A mesh with some groups at other poses, (4, 4), and the face at rest of each of its faces."""
    rows = {name: row for row, name in enumerate(poses, start=1)}
    body = np.array([rows.get(group.name, 0) for group in mesh.groups])[mesh.face_group]
    tables = np.stack([np.eye(4), *poses.values()])
    rest = Rest.of(mesh, body, np.ones(len(tables), bool))
    return rest.at(tables, diagonal_of(rest.boxes, tables), of_occluders=False), rest.kept


def diagonal_of(boxes: FloatArray, poses: FloatArray) -> float:
    """Diagonal of the box around all boxes (B, 8, 3) by poses (B, 4, 4), metres."""
    corners = move_boxes(boxes, poses).reshape(-1, 3)
    return float(norm(np.nanmax(corners, axis=0) - np.nanmin(corners, axis=0)))


def move_boxes(boxes: FloatArray, poses: FloatArray) -> FloatArray:
    """Corners (..., 8, 3) moved by poses (..., 4, 4)."""
    return matmul(boxes, np.swapaxes(poses[..., :3, :3], -1, -2)) + poses[..., None, :3, 3]


def _overlap(box: FloatArray, points: FloatArray, tolerance: float) -> bool:
    """True unless the corners of a box and the box of points are more than a tolerance apart."""
    low, high = box.min(axis=0) - tolerance, box.max(axis=0) + tolerance
    return bool((points.min(axis=0) <= high).all() and (points.max(axis=0) >= low).all())


CREASE = cos(np.deg2rad(30))
"""Cosine of the angle between two faces from which their edge is drawn."""


def crease_edges(mesh: Mesh, drawn: BoolArray) -> FloatArray:
    """(N, 2, 3) ends of creases above 30 degrees, and of borders, of the faces `drawn`, (F,)."""
    table = edge_table(mesh.welded_faces[drawn], mesh.n_vertices)
    rows = np.flatnonzero(drawn)[table.faces]
    one, other = (rows[table.first + rest] for rest in (0, table.n_uses - 1))
    is_crease = dots(mesh.normals[one], mesh.normals[other]) < CREASE
    ends: FloatArray = mesh.vertices[
        table.vertices[is_crease | (table.n_uses != 2)].astype(np.int64)
    ]
    return ends
