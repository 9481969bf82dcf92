"""Triangle mesh: checked arrays, groups of faces, derived geometry, diagnosis.

A `Mesh` is checked once, at construction, and never changes, so all other modules may trust its
arrays. Topology is computed on positions, because files repeat vertices along seams.
"""

import math
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import filterfalse, pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InNotebook,
    Int32Array,
    IntArray,
    MeshError,
    ReadByName,
    StrPath,
    arctan2,
    check_kind,
    cos,
    dots,
    finite_number,
    finite_points,
    frozen_record,
    matmul,
    members,
    offsets_of,
    plural,
    printable,
    shorten,
    shown,
    sin,
    size_in_words,
    sort_order,
    suffix_of,
)
from rastercov.base.files import is_file, similar
from rastercov.base.format import verb
from rastercov.base.typed import check_type
from rastercov.core.mesh.arrays import (
    blocks,
    bounds_of,
    check_coordinates,
    check_faces,
    check_vertices,
    encloses_volume,
    face_labels,
    frozen,
    normals_and_areas,
    rotation_about,
)
from rastercov.core.mesh.files import (
    LARGEST_FILE,
    NOWHERE,
    Limits,
    Site,
    mesh_files,
    metres_per,
    paths_of,
    raster_of,
)
from rastercov.core.mesh.groups import (
    FileGroups,
    Group,
    Names,
    check_groups,
    flag_groups,
    list_names,
    names_of_groups,
    of_files,
    refuse_twice,
)
from rastercov.core.mesh.terrain import REFRACTION
from rastercov.core.mesh.topology import Topology, first_equal_row

if TYPE_CHECKING:
    from rastercov.core.mesh.contacts import Contacts


__all__ = ["Group", "Mesh", "MeshSource"]

DEPENDS_ON_TARGETS = {
    *("topology", "is_closed_outward", "can_cull_back_faces", "contacts", "inside_out_mask"),
    "moved_from",
}
"""Cached properties of a mesh that depend on which faces are targets."""
BUILT_IN: dict[str, Callable[[], "Mesh"]] = {}
"""Built-in meshes by their names; `mesh.shapes` fills it."""
TRIMESH_GROUPS = "rastercov_groups"
"""Key of the groups in the metadata of a `trimesh.Trimesh`."""


@dataclass(frozen=True)
class MeshSource:
    """Source file of a mesh: name without folders, SHA-256, number of faces, and its `Site`."""

    name: str
    sha256: str
    n_faces: int
    site: Site = NOWHERE

    def to_json(self) -> dict[str, str | int]:
        """Entries that name the file."""
        return {"name": self.name, "sha256": self.sha256, "n_faces": self.n_faces}

    def rotate(self, axis: ArrayLike, angle_deg: float) -> "MeshSource":
        """The same with north rotated about an axis; none where it becomes steep."""
        if self.site.north_deg is None or not angle_deg:
            return self
        north = np.radians(self.site.north_deg)
        way = np.array(((cos(north), sin(north), 0.0),))
        ((x, y, z),) = move_points(way, 1.0, axis, angle_deg, (0, 0, 0)).tolist()
        turned = None if abs(z) > 0.5 else float(np.degrees(arctan2(y, x)))
        return replace(self, site=self.site._replace(north_deg=turned))


@frozen_record(init=False, repr=False)
class Mesh(InNotebook):
    """Immutable triangle mesh with groups of faces; its arrays are read-only.

    Threads may share a mesh. A derived property is computed at its first use, possibly in several
    threads at once, with the same result.

    Parameters
    ----------
    vertices : (V, 3) float
        Metres, finite, at most 1e30 in magnitude.
    faces : (F, 3) int
        Vertex indices, counter-clockwise seen from outside. Faces without area are kept.
    groups : sequence of Group, optional
        One group named "mesh" by default.
    face_group : (F,) int, optional
        Index into `groups` of each face; required when there are several groups.
    source_face : (F,) int, optional
        Index in its file of the polygon from which each face was cut; 0 ... F-1 by default.
    sources : sequence of MeshSource, optional
        Files from which the arrays were read.
    notes : sequence of str, optional
        Remarks on the files; listed first in `warnings`.
    spaces : sequence of (Product, Mesh), optional
        Spaces of a building (IFC files), each as its IFC entry and its solid; the lowest first.

    Raises
    ------
    MeshError
        For invalid arrays; the message names the first invalid faces.
    ResourceError
        For 2^31 faces or more.

    Examples
    --------
    >>> import rastercov as rc
    >>> vertices = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    >>> mesh = rc.Mesh(vertices, [(0, 1, 2), (0, 2, 3)])
    >>> mesh.n_faces, mesh.areas.tolist()
    (2, [0.5, 0.5])
    >>> mesh.normals[0].tolist()
    [0.0, 0.0, 1.0]
    """

    vertices: FloatArray
    faces: IntArray
    groups: tuple[Group, ...]
    face_group: Int32Array
    source_face: IntArray
    sources: tuple[MeshSource, ...]
    notes: tuple[str, ...]
    spaces: tuple[tuple[Any, "Mesh"], ...]

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        groups: Sequence[Group] | None = None,
        face_group: ArrayLike | None = None,
        source_face: ArrayLike | None = None,
        sources: Sequence[MeshSource] = (),
        notes: Sequence[str] = (),
        spaces: Sequence[tuple[Any, "Mesh"]] = (),
    ) -> None:
        corners = check_faces(faces)
        points = check_vertices(vertices)
        n_faces = len(corners)
        outside = np.any((corners < 0) | (corners >= len(points)), axis=1)
        if outside.any():
            raise MeshError(
                f"expected face indices in 0 ... {len(points) - 1}, got "
                f"{corners[outside.argmax()].tolist()} in face {outside.argmax()} "
                f"({plural(outside.sum(), 'such face')}); correct the indices"
            )
        check_coordinates(points, corners)
        groups, labels = check_groups(groups, face_group, n_faces)
        origin = np.arange(n_faces) if source_face is None else source_face
        fields: ByName = {
            "vertices": points,
            "faces": corners,
            "groups": groups,
            "face_group": labels,
            "source_face": face_labels("source_face", origin, n_faces),
            "sources": members("sources", sources, MeshSource, "MeshSource values", MeshError),
            "notes": members("notes", notes, str, "a list of strings", MeshError),
            "spaces": members("spaces", spaces, tuple, "pairs of product and Mesh", MeshError),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, frozen(value) if hasattr(value, "flags") else value)

    def __repr__(self) -> str:
        names = " ".join(", ".join(group.name for group in self.groups).split())
        return f"Mesh({self.n_faces} faces, {self.n_vertices} vertices; {shorten(names, 200)})"

    def __reduce__(self) -> tuple[Any, ...]:  # arrays from a pickle must be read-only, too
        return Mesh, tuple(getattr(self, name) for name in self.__dataclass_fields__)

    @classmethod
    def load(
        cls,
        path: StrPath | Sequence[StrPath],
        unit: str | float | Sequence[str | float] | Mapping[str, str | float] = "m",
        *,
        transforms: Sequence[ReadByName] | Mapping[str, ReadByName] = (),
        occluders: Iterable[str] = (),
        two_sided: Iterable[str] = (),
        targets: Iterable[str] = (),
        drop_invalid: bool = False,
        deflection_mm: float | None = None,
        max_bytes: int = LARGEST_FILE,
        memory_budget: int | None = None,
    ) -> "Mesh":
        r"""Mesh of one file, or of several as one scene.

        Parameters
        ----------
        path : path or sequence of paths
            STL, OBJ, PLY, OFF, GLB, glTF, 3MF, DAE, STEP or IFC files; regular files (or links
            to them) on this machine. STEP requires the extra `formats` of this package, IFC
            `building`. Or the name of a built-in mesh, such as "teapot", unless there is a file of
            that name.
        unit : str or float, or a list or mapping of them
            Unit of the coordinates: m, mm, cm, um, in, ft, or metres per unit; one for all files, a
            list, or a mapping by file name ("m" for others). 3MF, STEP, IFC and most DAE files
            state their own.
        transforms : list or mapping of mappings
            Arguments of `moved`, one for each file or by names of files.
        occluders, two_sided, targets : names of groups or files
            Flags of the groups, see `with_groups`.
        drop_invalid : bool
            Drop faces whose coordinates are not finite, with a warning; `source_face` numbers the
            remaining ones.
        deflection_mm : float, optional
            Largest distance between curved surfaces of STEP files and their triangles, millimetres;
            by default 0.1, or 4e-4 of the size of the largest part if less.
        max_bytes : int
            Largest size of a file, bytes.
        memory_budget : int, optional
            Bytes that reading a file may need, estimated before memory is allocated. By default 8
            GiB or, if less, enough for max(2^20, bytes of the file) triangles, which only files
            with instancing or shared data can exceed.

        Returns
        -------
        Mesh
            Faces in the order of the files. Groups are the named groups, objects or nodes of the
            file ("stem/name" if an earlier file has that name), otherwise the file's stem.
            `source_face` counts the polygons of each file from 0.

        Raises
        ------
        MeshError
            For an unusable file; the message has its name, the fault, and the line or byte. Also
            for two files with the same mesh in the same place.
        ResourceError
            For more faces than the budget allows.

        Examples
        --------
        >>> from pathlib import Path
        >>> import rastercov as rc
        >>> _ = Path("part.obj").write_text("v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n")
        >>> mesh = rc.Mesh.load("part.obj", unit="mm")
        >>> mesh.vertices.max(axis=0).tolist()  # metres
        [0.1, 0.1, 0.0]
        >>> mesh.groups[0].name
        'part'
        """
        check_type("max_bytes", max_bytes, int)
        check_type("memory_budget", memory_budget, int | None)
        if deflection_mm is not None and not 1e-6 <= finite_number(deflection_mm) <= 1e6:
            raise MeshError(f"expected deflection_mm from 1e-6 to 1e6, got {shown(deflection_mm)}")
        paths = paths_of(path)
        scales = [metres_per(each) for each in of_files("unit", unit, paths, "m")]
        places = of_files("transforms", transforms if len(transforms) else {}, paths, {})
        if name := _built_in_mesh(paths):
            if len(paths) > 1 or scales != [1.0]:
                others = [printable(str(each)) for each in paths]
                others.remove(name)
                got = f"{others[0]}, too; give one mesh" if others else "a unit; remove it"
                raise MeshError(f"expected the built-in mesh {name} alone, got {got}")
            mesh = BUILT_IN[name]()
        else:
            limits = Limits(drop_invalid, max_bytes, memory_budget, deflection_mm)
            scene, files = mesh_files().read(paths, scales, limits)
            spaces = [
                (product, Mesh(points, corners).moved(**places[row]))
                for (row, product), points, corners in scene.spaces
            ]
            spaces.sort(key=lambda space: (space[1].bounds[0, 2].round(1), space[0].label))
            mesh = cls(
                spaces=spaces,
                vertices=scene.vertices,
                faces=scene.faces,
                groups=[Group(str(name)) for name in scene.group_names],
                face_group=scene.face_group,
                source_face=scene.source_face,
                sources=[
                    MeshSource(*file).rotate(
                        place.get("axis", (0, 0, 1)), place.get("angle_deg", 0)
                    )
                    for file, place in zip(files, places, strict=True)
                ],
                notes=scene.notes,
            )
        names = names_of(mesh, paths)
        for each, place in zip(names.files, places, strict=True):
            mesh = mesh.moved(**place, groups=each.groups) if place else mesh
        parts = np.split(mesh.faces, np.cumsum([file.n_faces for file in mesh.sources])[:-1])
        refuse_twice((str(p), mesh.vertices, own) for p, own in zip(paths, parts, strict=True))
        return mesh._with_flags(flag_groups(names, mesh.groups, occluders, two_sided, targets))

    @classmethod
    def terrain(
        cls,
        heights: StrPath | ArrayLike,
        spacing: float | tuple[float, float] | None = None,
        *,
        origin: tuple[float, float] = (0.0, 0.0),
        refraction: float = REFRACTION,
        curvature: bool = True,
    ) -> "Mesh":
        """Surface of a raster of heights, on the round earth.

        Parameters
        ----------
        heights : path or (H, W) array_like
            GeoTIFF or ESRI ASCII grid; or metres, north up, NaN where there are none: holes,
            which hide nothing.
        spacing : float or (float, float)
            Distance of columns and of rows of an array, metres.
        origin : (float, float)
            Map coordinates of the north-west sample of an array, metres.
        refraction : float
            Coefficient k of refraction: rays are straight on an earth of radius R / (1 - k).
        curvature : bool
            False for a flat earth.

        Returns
        -------
        Mesh
            Vertices in map coordinates, or of a raster in degrees metres from its middle, from
            which heights fall with the curvature. Each cell is divided from its north-west to its
            south-east corner; `source_face` counts two triangles a cell, also those of holes.

        Raises
        ------
        MeshError
            For an unusable raster.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.Mesh.terrain([[3, 4, 3], [5, 9, 5], [3, 4, 3]], spacing=30.0)
        >>> mesh.n_faces, mesh.bounds[1].round(3).tolist()
        (8, [60.0, 0.0, 9.0])
        """
        raster = raster_of(heights, spacing, origin)
        points, faces, cells, notes = raster.curved(refraction, curvature=curvature).surface()
        return cls(points, faces, [Group("terrain")], source_face=cells, notes=notes)

    @classmethod
    def joined(cls, parts: Sequence["Mesh"], names: Sequence[str] | None = None) -> "Mesh":
        """One mesh of several, with their groups one after the other.

        Parameters
        ----------
        parts : sequence of Mesh
            At least one.
        names : sequence of str, optional
            Names of all groups, in order. Unless given, groups keep their names, and those of the
            same name are merged.

        Raises
        ------
        MeshError
            For no parts, a wrong number of names, and groups of one name with different roles.

        Examples
        --------
        >>> import rastercov as rc
        >>> part = rc.shapes.box((0.2, 0.2, 0.2))
        >>> table = rc.shapes.box((1, 1, 0.1), centre=(0, 0, -0.15))
        >>> scene = rc.Mesh.joined([part, table], ["part", "table"])
        >>> [group.name for group in scene.groups], scene.n_faces
        (['part', 'table'], 24)
        """
        parts = members("parts", parts, Mesh, "Mesh values", MeshError)
        groups = [group for part in parts for group in part.groups]
        words = "a name for each group"
        new = members("names", names, str, words, MeshError) if names is not None else None
        if not parts or (new is not None and len(new) != len(groups)):
            raise MeshError(f"expected parts and {words}, got {len(parts)} parts")
        named = [replace(g, name=n) for g, n in zip(groups, new or (), strict=False)] or groups
        rows = {group: row for row, group in enumerate(dict.fromkeys(named))}
        row_of = np.array([rows[group] for group in named])
        n_vertices, n_groups = (
            offsets_of(counts).tolist()
            for counts in ([p.n_vertices for p in parts], [len(p.groups) for p in parts])
        )
        return cls(
            vertices=np.concatenate([part.vertices for part in parts]),
            faces=np.concatenate([p.faces + n for p, n in zip(parts, n_vertices, strict=False)]),
            groups=[*rows],
            face_group=row_of[
                np.concatenate([p.face_group + n for p, n in zip(parts, n_groups, strict=False)])
            ],
            source_face=np.concatenate([part.source_face for part in parts]),
            sources=[source for part in parts for source in part.sources],
            notes=[note for part in parts for note in part.notes],
            spaces=[space for part in parts for space in part.spaces],
        )

    @classmethod
    def from_trimesh(cls, tri: Any, *, name: str = "mesh", unit: str | float = "m") -> "Mesh":
        """Mesh of a `trimesh.Trimesh`, as for formats that `load` does not read.

        The constructor checks the arrays, but no file is checked as by `load`. Groups and source
        faces that `to_trimesh` stored are kept, all other attributes are ignored.

        Parameters
        ----------
        tri : trimesh.Trimesh
            Not a Scene. `tri.units` is ignored.
        name : str
            Name of the group, unless groups are stored.
        unit : str or float
            Unit of the coordinates, as for `load`.

        Raises
        ------
        MeshError
            For an object that is no Trimesh, and for arrays that are not a valid mesh.

        Examples
        --------
        >>> import trimesh
        >>> import rastercov as rc
        >>> box = trimesh.creation.box((100, 100, 100))
        >>> mesh = rc.Mesh.from_trimesh(box, name="part", unit="mm")
        >>> mesh.bounds.round(6).tolist()  # metres
        [[-0.05, -0.05, -0.05], [0.05, 0.05, 0.05]]
        """
        import trimesh

        wanted = "a trimesh.Trimesh (of a Scene, pass scene.to_mesh())"
        check_kind("tri", tri, trimesh.Trimesh, wanted, MeshError)
        stored, labels = tri.metadata.get(TRIMESH_GROUPS), tri.face_attributes.get("face_group")
        has_groups = stored is not None and labels is not None
        return cls(
            vertices=np.asarray(tri.vertices) * metres_per(unit),
            faces=np.asarray(tri.faces),
            groups=[Group(**each) for each in stored] if has_groups else [Group(name)],
            face_group=labels if has_groups else None,
            source_face=tri.face_attributes.get("source_face"),
        )

    def to_trimesh(self) -> Any:
        """`trimesh.Trimesh` of the same vertices and faces, in metres, in the same order.

        `face_attributes` has `face_group` and `source_face`, `metadata` the groups, from which
        `from_trimesh` restores them.
        """
        import trimesh

        return trimesh.Trimesh(
            vertices=self.vertices.copy(),
            faces=self.faces.copy(),
            process=False,
            face_attributes={
                "face_group": self.face_group.copy(),
                "source_face": self.source_face.copy(),
            },
            metadata={TRIMESH_GROUPS: [group.to_json() for group in self.groups]},
        )

    def with_groups(
        self,
        occluders: Iterable[str] | None = None,
        two_sided: Iterable[str] | None = None,
        targets: Iterable[str] | None = None,
    ) -> Self:
        """Mesh of the same faces with other group flags.

        Parameters
        ----------
        occluders : names of groups or files, optional
            Exactly these occlude without being evaluated; None keeps the flags. A file is named by
            its name or its stem; `*`, `?` and `[...]` are wildcards.
        two_sided : names of groups or files, or "all", optional
            Exactly these are covered from either side; None keeps the flags.
        targets : names of groups or files, optional
            Exactly these are evaluated without occluding anything; None keeps the flags.

        Returns
        -------
        Mesh
            Shares this mesh's arrays.

        Raises
        ------
        MeshError
            For an unknown name, or a group that would be both occluder and target.

        Examples
        --------
        >>> import rastercov as rc
        >>> scene = rc.Mesh.joined([rc.shapes.box(), rc.shapes.sphere(1)], ["part", "ball"])
        >>> scene = scene.with_groups(occluders=["ball"])
        >>> [(group.name, group.role) for group in scene.groups]
        [('part', 'task'), ('ball', 'occluder')]
        """
        return self._with_flags(
            flag_groups(names_of(self), self.groups, occluders, two_sided, targets)
        )

    def _check_same(self, other: "Mesh") -> None:
        """Raise `ConfigError` unless another mesh has the same faces at the same places."""
        # A copy may have other flags of its groups.
        if self.vertices is not other.vertices or self.faces is not other.faces:
            raise ConfigError(
                f"expected one Mesh, got two of {self.n_faces} and {other.n_faces} faces; use the "
                "same Mesh"
            )

    def _with_flags(self, groups: tuple[Group, ...]) -> Self:
        """Mesh with other flags of the same groups; shares this mesh's arrays."""
        other = object.__new__(type(self))
        stale = {"task_mask", "two_sided_mask", "target_mask", "_opaque", "warnings"}
        shared: ByName = {"groups": groups, "_normals_and_areas": self._normals_and_areas}
        if any(a.is_target != b.is_target for a, b in zip(groups, self.groups, strict=True)):
            stale |= DEPENDS_ON_TARGETS
        else:
            shared["contacts"] = self.contacts
        # Copied in one step: another thread may be adding a cached property.
        cached = vars(self).copy() | shared
        other.__dict__.update({name: cached[name] for name in cached.keys() - stale})
        return other

    def _with_vertices(self, vertices: FloatArray, **derived: object) -> Self:
        """Mesh of the same faces with other vertices, which are not checked, and derived values."""
        other = object.__new__(type(self))
        own = {name: getattr(self, name) for name in self.__dataclass_fields__}
        other.__dict__.update(own, vertices=vertices, **derived)
        return other

    def moved(
        self,
        *,
        scale: float = 1.0,
        axis: ArrayLike = (0.0, 0.0, 1.0),
        angle_deg: float = 0.0,
        translation: ArrayLike = (0.0, 0.0, 0.0),
        groups: Iterable[str] | None = None,
    ) -> "Mesh":
        """Mesh scaled about the origin, then rotated about an axis through it, then translated.

        The faces, groups, sources and notes are those of this mesh.

        Parameters
        ----------
        scale : float
            Above 0.
        axis : (3,) float
            Direction of any length; a positive angle is right-handed about it
            (counter-clockwise when it points at you).
        angle_deg : float
            Degrees.
        translation : (3,) float
            Metres.
        groups : names of groups or files, optional
            Those that move; all by default. Vertices shared with the others are duplicated.

        Raises
        ------
        MeshError
            For a value that is not finite or outside its range, an unknown name, and a result that
            is not a valid mesh.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> placed = mesh.moved(axis=(0, 0, 1), angle_deg=45, translation=(0, 0, 1))
        >>> placed.bounds.round(3).tolist()
        [[-0.141, -0.141, 0.9], [0.141, 0.141, 1.1]]
        """
        faces = self.faces
        vertices = move_points(self.vertices, scale, axis, angle_deg, translation)
        if groups is not None:
            moving = names_of_groups("groups", groups, names_of(self)) or set()
            is_moved = faces_of_groups(self, moving)
            rows = faces + self.n_vertices * is_moved[:, None]
            used, corners = np.unique(rows, return_inverse=True)
            vertices = np.concatenate([self.vertices, vertices])[used]
            faces = corners.reshape(-1, 3)
        others = {name: getattr(self, name) for name in self.__dataclass_fields__}
        others |= {"vertices": vertices, "faces": faces}
        if groups is None:
            place = scale, axis, angle_deg, translation
            others["sources"] = [each.rotate(axis, angle_deg) for each in self.sources]
            others["spaces"] = [
                (product, Mesh(move_points(each.vertices, *place), each.faces))
                for product, each in self.spaces
            ]
        return Mesh(**others)

    @property
    def site(self) -> Site:
        """North, latitude and longitude of its files, where they agree."""
        return Site.common((NOWHERE, *(each.site for each in self.sources)))

    @cached_property
    def n_faces(self) -> int:
        """Number of faces F."""
        return len(self.faces)

    @cached_property
    def n_vertices(self) -> int:
        """Number of vertices V."""
        return len(self.vertices)

    def _faces_of(self, groups: Sequence[int]) -> IntArray:
        """Faces of the groups in some rows, at least one, in ascending order."""
        return np.sort(np.concatenate([self._by_group[row] for row in groups]))

    @cached_property
    def _by_group(self) -> list[IntArray]:
        """Faces of each group."""
        ends = np.cumsum(np.bincount(self.face_group, minlength=len(self.groups)))
        return np.split(sort_order(self.face_group), ends[:-1])

    @cached_property
    def task_mask(self) -> BoolArray:
        """(F,) mask of the evaluated faces: all except occluders."""
        scored = np.array([not group.is_occluder for group in self.groups])
        return frozen(scored[self.face_group])

    @cached_property
    def two_sided_mask(self) -> BoolArray:
        """(F,) mask of the faces that may be covered from either side."""
        two_sided = np.array([group.is_two_sided for group in self.groups])
        return frozen(two_sided[self.face_group])

    @cached_property
    def target_mask(self) -> BoolArray:
        """(F,) mask of the faces of targets, which are evaluated but do not occlude."""
        transparent = np.array([group.is_target for group in self.groups])
        return frozen(transparent[self.face_group])

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) lowest and highest coordinates of the vertices that faces use, metres."""
        return frozen(bounds_of(self.vertices, self.faces))

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box, metres; the same bits on every machine."""
        x, y, z = np.ptp(self.bounds, axis=0).tolist()
        return math.sqrt(x * x + y * y + z * z)

    @property
    def centre(self) -> FloatArray:
        """(3,) middle of the bounding box, metres."""
        return self.bounds.mean(axis=0)

    @property
    def size_in_words(self) -> str:
        """Extent along x, y and z with its unit, such as "85 x 62 x 20 m"."""
        return size_in_words(np.ptp(self.bounds, axis=0))

    @cached_property
    def centroids(self) -> FloatArray:
        """(F, 3) mean of each face's vertices, metres."""
        centroids = np.empty((self.n_faces, 3))
        for block in blocks(self.n_faces):
            centroids[block] = self.vertices[self.faces[block]].mean(axis=1)
        return frozen(centroids)

    @cached_property
    def _normals_and_areas(self) -> tuple[FloatArray, FloatArray, float]:
        normals, areas, least_sine = normals_and_areas(self.vertices, self.faces)
        return frozen(normals), frozen(areas), least_sine

    @property
    def normals(self) -> FloatArray:
        """(F, 3) unit normals, right-hand rule; 0 for degenerate faces."""
        return self._normals_and_areas[0]

    @cached_property
    def plane_offsets(self) -> FloatArray:
        """(F,) scalar product of the normal and the centroid of each face, metres."""
        return frozen(dots(self.normals, self.centroids))

    @property
    def areas(self) -> FloatArray:
        """(F,) areas, m^2; exactly 0 for degenerate faces."""
        return self._normals_and_areas[1]

    @property
    def least_sine(self) -> float:
        """Minimum sine of the angle between the first two edges of any non-degenerate face."""
        return self._normals_and_areas[2]

    @cached_property
    def degenerate_mask(self) -> BoolArray:
        """(F,) mask of the faces without area, to within rounding, or with a repeated vertex."""
        return frozen(~np.any(self.normals, axis=1))

    @cached_property
    def welded_faces(self) -> IntArray:
        """(F, 3) vertex indices like `faces`, the same one for all vertices at one point."""
        same = first_equal_row((self.vertices + 0.0).view(np.uint64))  # -0.0 + 0.0 is 0.0
        return frozen(same[self.faces])

    @cached_property
    def duplicate_mask(self) -> BoolArray:
        """(F,) mask of later copies of a face: the same three positions, in any order."""
        same = first_equal_row(np.sort(self.welded_faces, axis=1).view(np.uint64))
        return frozen(same != np.arange(self.n_faces))

    @property
    def has_targets(self) -> bool:
        """True if some face belongs to a target."""
        return self._opaque is not None

    @property
    def opaque(self) -> "Mesh":
        """Mesh of the faces that occlude, in their order: this mesh if it has no targets.

        Near limit, back-face culling, contacts and obstacles are derived from it. Where all faces
        are targets it is one face without area, with the same bounding box.
        """
        return self if self._opaque is None else self._opaque

    @cached_property
    def _opaque(self) -> "Mesh | None":
        """`opaque`, or None for this mesh: a mesh that held itself would not be freed at once."""
        is_target = self.target_mask
        if not is_target.any():
            return None
        if is_target.all():
            low, high = self.bounds
            return Mesh([low, high], [(0, 1, 0)], [Group("no surface", is_occluder=True)])
        return self._of_faces(~is_target, np.arange(len(self.groups)))

    def _of_faces(self, chosen: BoolArray, groups: IntArray | None = None) -> "Mesh":
        """Mesh of some faces, (F,), without the vertices and groups of the others alone.

        Or with these groups, ascending rows of all that the faces have.
        """
        faces, face_group = self.faces[chosen], self.face_group[chosen]
        used = np.unique(face_group) if groups is None else groups
        is_kept = np.ones(self.n_vertices, bool)
        is_kept[self.faces[~chosen]] = False
        is_kept[faces] = True
        return Mesh(
            vertices=self.vertices[is_kept],
            faces=(np.cumsum(is_kept) - 1)[faces],
            groups=[self.groups[row] for row in used],
            face_group=np.searchsorted(used, face_group),
            source_face=self.source_face[chosen],
            sources=self.sources,
            notes=self.notes,
        )

    @cached_property
    def moved_from(self) -> Any:
        """Rest pose and body poses from which a frame of a motion is made; None for other meshes.

        A `rastercov.core.mesh.bodies.Moved`.
        """
        return None

    @cached_property
    def topology(self) -> Topology:
        """Edge counts and adjacency of the faces; targets share no edge with other faces."""
        if not self.has_targets:
            return Topology.of(self.welded_faces, self.n_vertices)
        apart = np.where(self.target_mask, self.n_vertices, 0)[:, None]
        return Topology.of(self.welded_faces + apart, 2 * self.n_vertices)

    @property
    def n_boundary_edges(self) -> int:
        """Number of edges with one face."""
        return self.topology.n_boundary_edges

    @property
    def n_nonmanifold_edges(self) -> int:
        """Number of edges with more than two faces."""
        return self.topology.n_nonmanifold_edges

    @property
    def is_closed(self) -> bool:
        """True if every edge has exactly two faces; faces with repeated vertices do not count."""
        return self.topology.is_closed

    @property
    def is_consistently_wound(self) -> bool:
        """True if the two faces of every shared edge traverse it in opposite directions."""
        return self.topology.n_inconsistent_edges == 0

    @cached_property
    def can_cull_back_faces(self) -> bool:
        """True if a back face is never the nearest surface for a camera outside.

        This holds if the mesh is watertight, consistently wound, and each edge-connected component
        encloses positive volume and neither cuts nor touches itself. False when in doubt, as for a
        cavity. A camera inside the part is not considered.

        Proof by winding numbers. A connected closed surface that does not meet itself divides space
        into an outside with winding number 0 and an inside with 1 if its volume is positive. The
        winding number of the whole mesh, the sum over its components, is therefore nowhere
        negative, though components may cut each other. Along a ray it increases by 1 at a front and
        decreases by 1 at a back; from outside, at 0, the first surface is therefore a front.
        """
        return self.is_closed_outward and not self.self_contact_mask.any()

    @cached_property
    def is_closed_outward(self) -> bool:
        """True if watertight, consistently wound, and no component is inside out."""
        return bool(
            self.is_closed and self.is_consistently_wound and not self.inside_out_mask.any()
        )

    @cached_property
    def contacts(self) -> "Contacts":
        """Faces that touch or cut another face."""
        from rastercov.core.mesh.contacts import Contacts

        own = self.vertices, self.faces, self.degenerate_mask, self.diagonal
        return Contacts(*own, self.topology.components)

    @property
    def self_contact_mask(self) -> BoolArray:
        """(F,) mask of faces that touch or cut another one of their edge-connected component."""
        return self.contacts.faces_within_components()

    @cached_property
    def inside_out_mask(self) -> BoolArray:
        """(C,) mask of the components without positive volume.

        Valid for a watertight, consistently wound mesh.
        """
        part = self.topology.components()
        has_edges = np.zeros(int(part.max()) + 1, bool)
        has_edges[part[self.topology.neighbours[:, 0]]] = True
        return frozen(~encloses_volume(self.vertices, self.faces, part)[has_edges])

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """One line for each fault or oddity that may affect the results.

        Open, overlapping or inconsistently wound targets are no faults: they do not occlude.
        """
        items = list(self.notes)
        if self.has_targets:
            if not self.target_mask.all():
                items += self.opaque.warnings
            n_flat = int((self.degenerate_mask & self.target_mask).sum())
            if n_flat:
                items.append(f"{n_flat} degenerate faces of targets, without area")
            return tuple(items)
        edges = self.topology
        if edges.n_boundary_edges:
            items.append(
                f"open surface: {edges.n_boundary_edges} edges with a face on one side only"
            )
        if n := edges.n_nonmanifold_edges:
            items.append(f"{plural(n, 'edge', 'have')} more than two faces")
        if n := edges.n_inconsistent_edges:
            items.append(
                f"inconsistent winding at {n} of {edges.n_shared_edges} shared edges "
                f"({n / edges.n_shared_edges:.1%}); declare the groups two-sided"
            )
        elif self.is_closed and (n := int(self.inside_out_mask.sum())):
            items.append(
                f"inside out: {n} of {len(self.inside_out_mask)} watertight components "
                f"{verb(n, 'have')} non-positive signed volume (expected for a cavity)"
            )
        if self.is_closed_outward and self.self_contact_mask.any():
            items.append(
                "the watertight surface intersects or touches itself at "
                f"{plural(self.self_contact_mask.sum(), 'face')}, such as face "
                f"{self.self_contact_mask.argmax()}: its back faces may be visible"
            )
        if self.degenerate_mask.any():
            items.append(f"{self.degenerate_mask.sum()} degenerate faces without area")
        if self.duplicate_mask.any():
            items.append(
                f"{self.duplicate_mask.sum()} duplicate faces: the lowest face index is used"
            )
        extent = float(np.ptp(self.bounds, axis=0).max())
        if not 1e-6 <= extent <= 1e4:
            items.append(f"the mesh measures {extent:.3g} m; check its unit")
        return tuple(items)


def _built_in_mesh(paths: Sequence[StrPath]) -> str | None:
    """First of some paths that names a built-in mesh; MeshError for one that is no file either."""
    for path in filterfalse(is_file, paths):
        if str(path) in BUILT_IN:
            return str(path)
        if suffix_of(path) not in mesh_files().suffixes:
            is_folder = os.path.isdir(path)  # noqa: PTH112 - of a text
            got = "a folder" if is_folder else f"none{similar(path)}"
            raise MeshError(
                f"{printable(str(path))}: expected a mesh file or a built-in mesh, such as "
                f"{list_names(BUILT_IN, str(path).lower())}, got {got}"
            )
    return None


def faces_of_groups(mesh: Mesh, names: Collection[str]) -> BoolArray:
    """(F,) faces of the groups with these names."""
    of_group = np.array([group.name in names for group in mesh.groups], np.bool_)
    return of_group[mesh.face_group]


def names_of(mesh: Mesh, paths: Sequence[StrPath] | None = None) -> Names:
    """Names of a mesh whose faces are those of its sources; `paths` are these as the user typed."""
    groups = [group.name for group in mesh.groups]
    if paths is not None and not mesh.sources:
        return Names(groups, [FileGroups(paths[0], groups)])
    ends = offsets_of([source.n_faces for source in mesh.sources])
    if ends[-1] != mesh.n_faces:  # there are others
        return Names(groups)
    rows = [np.unique(mesh.face_group[a:b]) for a, b in pairwise(ends)]
    sources = [source.name for source in mesh.sources] if paths is None else paths
    files = [
        FileGroups(path, [groups[row] for row in own])
        for path, own in zip(sources, rows, strict=True)
    ]
    return Names(groups, files, group_first=paths is None)


def move_points(
    points: FloatArray,
    scale: float,
    axis: ArrayLike,
    angle_deg: float,
    translation: ArrayLike,
) -> FloatArray:
    """Points (N, 3) of `Mesh.moved`: scaled, then turned, then translated."""
    factor, angle = finite_number(scale), np.radians(finite_number(angle_deg))
    wanted = "three finite numbers"
    direction = finite_points("axis", axis, (3,), wanted, MeshError)
    offset = finite_points("translation", translation, (3,), wanted, MeshError)
    if not factor > 0:
        raise MeshError(f"expected scale to be a number above 0, got {shown(scale)}")
    if not np.isfinite(angle):
        raise MeshError(f"expected angle_deg to be a finite number, got {shown(angle_deg)}")
    if not direction.any():
        raise MeshError(f"expected axis to be a direction, got {direction.tolist()}")
    with np.errstate(over="ignore", invalid="ignore"):  # the constructor finds what overflows
        moved = points * factor
        if angle:
            moved = matmul(moved, rotation_about(direction, angle).T)
        return moved + offset
