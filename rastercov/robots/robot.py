"""Robots of rigid links: a mesh with a group for each link, and its poses by the joint angles.

A file in URDF names shapes and mesh files. These are read by the readers of meshes, with their
limits. A robot occludes and is not evaluated; a camera may be fixed to one of its links.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    MeshError,
    ResourceError,
    StrPath,
    UnreadableError,
    check_array,
    check_choice,
    check_seed,
    errors_as,
    finite_number,
    finite_points,
    first_of,
    frozen_record,
    is_one_of,
    printable,
    shown,
)
from rastercov.base.files import file_text
from rastercov.base.typed import check_type
from rastercov.core.mesh.arrays import apply_pose, check_poses, frozen, inverse, unit
from rastercov.core.mesh.bodies import JointPath
from rastercov.core.mesh.columns import TIMES, columns_of, durations_of
from rastercov.core.mesh.groups import Group
from rastercov.core.mesh.mesh import Mesh
from rastercov.core.mesh.shapes import box, sphere
from rastercov.formats.meshes import FREE_FACES, MEMORY_BUDGET
from rastercov.formats.meshes.polygons import LONGEST_NAME, PEAK_BYTES_PER_FACE, check_budget
from rastercov.robots import urdf
from rastercov.robots.kinematics import Kinematics, Solutions
from rastercov.robots.urdf import Joint, LinkShape

FLOOR = "turntable/floor"
"""Link that carries a robot beside a turntable."""
GEOMETRIES = ("collision", "visual")
SIDES = 32
"""Sides of the prism in place of a cylinder; its edges lie on it."""
SUBDIVISIONS = 2
"""Of the icosphere in place of a sphere."""
FACES = {"box": 12, "cylinder": 4 * SIDES, "sphere": 20 * 4**SUBDIVISIONS}
MOST_INSTANCES = 50
"""Uses of each mesh file on average, beyond `FREE_FACES` in all."""
BYTES_PER_SHAPE = 5000
LABELS = frozenset({"position", "camera"})
"""Columns of text in a table of joints."""
STARTS = 16
"""Of the inverse kinematics for all poses."""
ROUNDING = 1e-9
"""Radians or metres beyond a limit that are taken for rounding of a file."""


@frozen_record(init=False, repr=False)
class Robot(InOneLine):
    """Rigid links on joints, from a URDF file; read by `Robot.load`.

    Attributes
    ----------
    name : str
        Name of the robot in its file.
    mesh : Mesh
        All links in the rest pose; each link with a shape is a group "name/link", an occluder.
    links : tuple of str
        Names of all links; the root is the first.
    joint_names : tuple of str
        The J independent joints: revolute, continuous and prismatic, without mimic joints.
    limits : (J, 2) float64
        Lowest and highest value of each joint, radians, or metres for prismatic joints; infinite if
        it has none.
    rest : (J,) float64
        Configuration of `mesh`.
    shapes : dict of str to Mesh
        Links with shapes, each in its own frame.
    kinematics : Kinematics
        Joints, without meshes.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rastercov as rc
    >>> box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    >>> _ = Path("gate.urdf").write_text(
    ...     f'<robot name="gate"><link name="rail"/><link name="head">{box}</link>'
    ...     '<joint name="x" type="prismatic"><parent link="rail"/><child link="head"/>'
    ...     '<axis xyz="1 0 0"/><limit lower="0" upper="0.3"/></joint></robot>'
    ... )
    >>> robot = rc.Robot.load("gate.urdf")
    >>> robot.joint_names, robot.limits.tolist()
    (('x',), [[0.0, 0.3]])
    >>> robot.frames([0.2])["head"][0, :3, 3].tolist()  # metres
    [0.2, 0.0, 0.0]
    """

    name: str
    mesh: Mesh
    links: tuple[str, ...]
    joint_names: tuple[str, ...]
    limits: FloatArray
    rest: FloatArray
    shapes: dict[str, Mesh]
    kinematics: Kinematics

    def __init__(
        self,
        description: urdf.Description,
        shapes: Mapping[str, Mesh],
        base: ArrayLike | None = None,
        rest: ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        limits = frozen(description.limits)
        root = np.eye(4) if base is None else check_poses("base", base)[0]
        kinematics = Kinematics(tuple(description.links), description.joints, limits, root)
        if unknown := [link for link in shapes if link not in description.links]:
            raise MeshError(f"expected shapes of links of the robot, got {shown(unknown)}")
        self.__dict__.update(
            name=name or description.name,
            links=tuple(description.links),
            joint_names=description.names,
            limits=limits,
            kinematics=kinematics,
            shapes=dict(shapes),
        )
        still = np.clip(np.zeros(len(limits)), *limits.T)
        if rest is not None:
            still = self._configurations("rest", rest)[0]
        self.__dict__["rest"] = frozen(still)
        frames = kinematics.frames(still[None])
        placed = [
            _place_mesh(shape, f"{self.name}/{link}", frames[link][0])
            for link, shape in shapes.items()
        ]
        mesh = Mesh.joined(placed)
        notes = (*description.notes, *mesh.notes)
        fields = (mesh.vertices, mesh.faces, mesh.groups, mesh.face_group, mesh.source_face)
        self.__dict__["mesh"] = Mesh(*fields, mesh.sources, notes)

    @classmethod
    def load(
        cls,
        path: StrPath,
        packages: Mapping[str, StrPath] | None = None,
        geometry: Literal["collision", "visual"] = "collision",
        *,
        base: ArrayLike | None = None,
        rest: ArrayLike | None = None,
        name: str | None = None,
    ) -> "Robot":
        """Robot of a URDF file.

        Parameters
        ----------
        path : path
            URDF file with fixed, revolute, continuous, prismatic and mimic joints, and meshes,
            boxes, cylinders and spheres. No files other than its meshes are opened.
        packages : mapping of str to path, optional
            Folder of each package it refers to, as in `package://ur_description/...`.
        geometry : {"collision", "visual"}
            Shapes to read: simplified, or detailed for display.
        base : (4, 4) array_like, optional
            world_from_base, the pose of the root link; the identity unless given.
        rest : (J,) array_like, optional
            Joint values of the rest pose, `mesh`; 0, or the nearest limit, unless given.
        name : str, optional
            Name to use instead of that in the file.

        Raises
        ------
        MeshError
            For a file without a robot, kinematic loops, other kinds of joints, missing meshes, and
            xacro files.
        ConfigError
            For another geometry, an invalid base, or a rest outside the limits.
        """
        check_choice("geometry", geometry, GEOMETRIES)
        read, folders = urdf.read(path, geometry), dict(packages or {})
        all_shapes = [shape for each in read.links.values() for shape in each]
        with errors_as(MeshError, printable(str(path))):
            files = _files_of(all_shapes, Path(path).parent, folders)
            with errors_as(ResourceError, printable(str(path))):
                _check_size(all_shapes, files)
            shapes = {
                link: _link_of(link, each, files) for link, each in read.links.items() if each
            }
        if not shapes:
            other = GEOMETRIES[geometry == "collision"]
            raise MeshError(
                f"{printable(str(path))}: expected {geometry} shapes, got none; "
                f'try geometry="{other}"'
            )
        return cls(read, shapes, base, rest, name)

    def on_turntable(
        self, axis: ArrayLike, centre: ArrayLike = (0, 0, 0), degrees: float = 360.0
    ) -> "Robot":
        """The robot in the frame of a turntable, which becomes its last joint, "turntable".

        The value of this joint is the angle of the table, radians.

        Parameters
        ----------
        axis, centre : (3,) array_like
            Axis of the table, and a point on it, metres; angles are right-handed about the axis
            (counter-clockwise when it points at you).
        degrees : float
            Range of rotation, from 0 to this; 360 or more is unlimited.

        Raises
        ------
        ConfigError
            For an axis of length 0, and values that are not finite.
        """
        to_centre, back = np.eye(4), np.eye(4)
        to_centre[:3, 3] = finite_points("centre", centre, (3,), "three coordinates")
        back[:3, 3] = -to_centre[:3, 3]
        along = -finite_points("axis", axis, (3,), "a direction")
        turn = finite_number(degrees)
        if not along.any() or not np.isfinite(turn):
            raise ConfigError(
                f"expected axis to be a direction and degrees finite, got {shown(degrees)}"
            )
        n, ends = len(self.joint_names), sorted((0.0, float(np.radians(turn))))
        is_free = abs(turn) >= 360
        limits = np.concatenate([self.limits, [(-np.inf, np.inf) if is_free else ends]])
        kind = "continuous" if is_free else "revolute"
        fixed = "turntable/platter", FLOOR
        joints = (
            Joint("turntable", kind, *fixed, to_centre, unit(along), n),
            Joint("stand", "fixed", fixed[1], self.links[0], back @ self.kinematics.base, along),
            *self.kinematics.joints,
        )
        links: dict[str, list[LinkShape]] = {each: [] for each in (*fixed, *self.links)}
        names = (*self.joint_names, "turntable")
        description = urdf.Description(self.name, links, joints, names, limits, self.mesh.notes)
        return Robot(description, self.shapes, rest=np.append(self.rest, 0.0))

    def frames(self, joints: ArrayLike) -> dict[str, FloatArray]:
        """world_from_link of all links, (T, 4, 4) each, in (T, J) or (J,) configurations.

        Parameters
        ----------
        joints : (T, J) or (J,) array_like
            Radians, or metres of prismatic joints, within the limits.

        Raises
        ------
        ConfigError
            For other shapes, and values outside the limits.
        """
        return self.kinematics.frames(self._configurations("joints", joints))

    def poses(self, joints: ArrayLike) -> dict[str, FloatArray]:
        """(T, 4, 4) transforms of each moving link from its rest pose, in the world.

        Keys are groups of `mesh`; links without shapes have none. Arguments as for `frames`.
        """
        frames, still = self.frames(joints), self.frames(self.rest)
        return {
            f"{self.name}/{link}": frames[link] @ inverse(still[link])
            for link in self.shapes
            if self.is_moving(link)
        }

    @property
    def joint_kinds(self) -> tuple[str, ...]:
        """Kind of each of `joint_names`: "revolute", "continuous" or "prismatic"."""
        kinds = {each.name: each.kind for each in self.kinematics.joints}
        return tuple(kinds[name] for name in self.joint_names)

    def is_moving(self, link: str) -> bool:
        """True for a link that some joint moves; ConfigError for an unknown link."""
        self._check_link(link)
        return any(each.column >= 0 for each in self.kinematics.chain(link))

    def read_path(self, path: StrPath) -> JointPath:
        """Configurations of a CSV file: one column per joint, and optionally `duration` or `time`.

        Parameters
        ----------
        path : path
            Comma-separated, with a header and one row per frame; radians, or metres for prismatic
            joints. All joints of `joint_names`, in any order; `position` and `camera`, as `place`
            writes them, are ignored.

        Raises
        ------
        ConfigError
            For an unreadable file, other columns, and values outside the limits; the message has
            the line or frame.
        """
        shown_path = printable(str(path))
        try:
            ignored = LABELS - set(self.joint_names)
            columns = columns_of(file_text(path), ignored)
            durations = durations_of({f"{n}s": columns[n] for n in TIMES if n in columns})
        except UnicodeDecodeError:
            raise ConfigError(
                f"{shown_path}: expected text in UTF-8, got another encoding; save it as UTF-8"
            ) from None
        except (UnreadableError, ConfigError) as error:
            raise ConfigError(f"{shown_path}: {error}") from None
        joints, got = ", ".join(self.joint_names), shown(", ".join(map(printable, columns)))
        if set(columns) - {*TIMES} != set(self.joint_names):
            raise ConfigError(
                f"{shown_path}: expected columns {joints}, and duration or time if any, got {got}"
            )
        rows = np.array([columns[name] for name in self.joint_names]).T
        duration = np.array(durations.get("durations", np.ones(len(rows))))
        if not (duration > 0).all():
            line = int((duration <= 0).argmax())
            raise ConfigError(
                f"{shown_path}: frame {line}: expected a duration above 0, got {duration[line]:g}"
            )
        return JointPath(self._configurations(shown_path, rows), duration)

    def solve(
        self,
        poses: ArrayLike,
        link: str,
        link_from_tip: ArrayLike | None = None,
        *,
        starts: int = 256,
        most: int = 8,
        seed: int = 0,
    ) -> Solutions:
        """Joint angles that bring a frame of a link to poses, by damped least squares.

        Parameters
        ----------
        poses : (N, 4, 4) array_like
            world_from_tip.
        link : str
            Link to which the frame is fixed.
        link_from_tip : (4, 4) array_like, optional
            Pose of the frame, such as a camera, on the link; the link's own unless given.
        starts, seed : int
            Maximum number of random start configurations, and their seed; all poses use the first
            16, and only those reached outside the limits use more.
        most : int
            Maximum number of solutions per pose; they differ by more than 0.01 in some joint.

        Returns
        -------
        Solutions
            Each within the limits, its pose to 1e-6 m and rad. Unreachable poses, and those that no
            start converged to, have no row.

        Raises
        ------
        ConfigError
            For an unknown link or invalid poses.
        """
        self._check_link(link)
        tip = np.eye(4) if link_from_tip is None else check_poses("link_from_tip", link_from_tip)[0]
        for name, value in {"starts": starts, "most": most}.items():
            if not 1 <= finite_number(value) <= 10_000:
                raise ConfigError(f"expected {name} to be from 1 to 10,000, got {shown(value)}")
        check_type("seed", seed, int)
        check_seed(seed)
        given = check_poses("poses", poses)
        first = min(int(starts), STARTS)
        rounds = [first, *([int(starts) - first] if starts > first else [])]
        return self.kinematics.solve(given, link, tip, rounds, seed, int(most))

    def _check_link(self, link: str) -> None:
        if not is_one_of(link, self.links):
            known = first_of(self.links, 12)
            raise ConfigError(f"expected a link of the robot ({known}), got {shown(link)}")

    def _configurations(self, name: str, joints: ArrayLike) -> FloatArray:
        """(T, J) configurations within the limits, or ConfigError."""
        n = len(self.joint_names)
        wanted = f"(T, {n}) values of {', '.join(self.joint_names)}"
        array = check_array(name, joints, "iuf", wanted, ConfigError)
        array = array[None] if array.ndim == 1 else array
        points = finite_points(name, array, (-1, n), wanted)
        over = np.maximum(self.limits[:, 0] - points, points - self.limits[:, 1])
        is_within = over <= ROUNDING
        if not is_within.all():
            row, joint = np.argwhere(~is_within)[0].tolist()
            low, high = self.limits[joint]
            raise ConfigError(
                f"{name}: row {row}: expected {self.joint_names[joint]} in {low:g} ... {high:g}, "
                f"got {points[row, joint]:g}"
            )
        return np.clip(points, *self.limits.T)


def _files_of(
    shapes: Iterable[LinkShape], folder: Path, packages: Mapping[str, StrPath]
) -> dict[str, Mesh]:
    """Meshes by the names of their files in a URDF; a file of several names is read once."""
    known: dict[tuple[int, int], Mesh] = {}
    meshes: dict[str, Mesh] = {}
    for name in dict.fromkeys(shape.file for shape in shapes if shape.kind == "mesh"):
        path = urdf.locate(name, folder, packages)
        entry = path.stat()
        key = entry.st_dev, entry.st_ino
        if key not in known:
            known[key] = Mesh.load(path)
        meshes[name] = known[key]
    return meshes


def _check_size(shapes: Sequence[LinkShape], files: Mapping[str, Mesh]) -> None:
    """ResourceError, before any is made, for more faces than files and a short text may become."""
    distinct = {id(mesh): max(mesh.n_faces, mesh.n_vertices) for mesh in files.values()}
    most = max(FREE_FACES, MOST_INSTANCES * sum(distinct.values()))
    own = [files[each.file] for each in shapes if each.kind == "mesh"]
    n_faces = sum(mesh.n_faces for mesh in own)
    n_faces += sum(FACES.get(each.kind, 0) for each in shapes)
    n_vertices, n_bytes = sum(mesh.n_vertices for mesh in own), BYTES_PER_SHAPE * len(shapes)
    budget = min(MEMORY_BUDGET, PEAK_BYTES_PER_FACE * most)
    check_budget(n_faces, budget, n_vertices, n_bytes, "simplify its meshes, or use fewer")


def _link_of(name: str, shapes: Sequence[LinkShape], files: Mapping[str, Mesh]) -> Mesh:
    """Shapes in the frame of their link."""
    points, faces, n_points = list[FloatArray](), list[IntArray](), 0
    for shape in shapes:
        mesh = _mesh_of(shape, files)
        is_mirrored = shape.kind == "mesh" and np.prod(shape.sizes) < 0
        corners = mesh.vertices * (shape.sizes if shape.kind == "mesh" else 1.0)
        points.append(apply_pose(corners, shape.origin))
        faces.append((mesh.faces[:, ::-1] if is_mirrored else mesh.faces) + n_points)
        n_points += mesh.n_vertices
    read = list(dict.fromkeys(each.file for each in shapes if each.kind == "mesh"))
    sources = dict.fromkeys(source for file in read for source in files[file].sources)
    notes = dict.fromkeys(note for file in read for note in files[file].notes)
    groups = [Group(name[:LONGEST_NAME], is_occluder=True)]
    fields = (np.concatenate(points), np.concatenate(faces), groups)
    return Mesh(*fields, sources=list(sources), notes=list(notes))


def _mesh_of(shape: LinkShape, files: Mapping[str, Mesh]) -> Mesh:
    """A shape in its own frame; that of a file without its scales."""
    sizes = shape.sizes
    if shape.kind == "box":
        return box((sizes[0], sizes[1], sizes[2]))
    if shape.kind == "sphere":
        return sphere(SUBDIVISIONS, sizes[0])
    return _prism(*sizes) if shape.kind == "cylinder" else files[shape.file]


def _place_mesh(mesh: Mesh, name: str, pose: FloatArray) -> Mesh:
    """A mesh as one group that hides, where a pose brings it."""
    vertices = apply_pose(mesh.vertices, pose)
    groups = [Group(name[:LONGEST_NAME], is_occluder=True)]
    return Mesh(vertices, mesh.faces, groups, sources=mesh.sources, notes=mesh.notes)


def _prism(radius: float, length: float) -> Mesh:
    """Prism of `SIDES` sides in a cylinder about the z axis, closed, outward."""
    angle = 2 * np.pi / SIDES * np.arange(SIDES)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low, high = (np.column_stack([ring, np.full(SIDES, z)]) for z in (-length / 2, length / 2))
    ends = np.array([(0, 0, -length / 2), (0, 0, length / 2)])
    a, b = np.arange(SIDES), np.roll(np.arange(SIDES), -1)
    bottom, top = np.full(SIDES, 2 * SIDES), np.full(SIDES, 2 * SIDES + 1)
    corners = [(a, b, b + SIDES), (a, b + SIDES, a + SIDES), (bottom, b, a)]
    corners.append((top, a + SIDES, b + SIDES))
    faces = np.concatenate([np.stack(each, axis=1) for each in corners])
    return Mesh(np.concatenate([low, high, ends]), faces)
