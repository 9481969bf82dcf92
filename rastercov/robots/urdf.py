"""URDF files (.urdf): links of a robot with their shapes, and the joints between them.

Read are trees of links by fixed, revolute, continuous and prismatic joints, `mimic`, and shapes
that are boxes, cylinders, spheres or mesh files. What moves otherwise is refused; what has no place
in geometry (masses, transmissions, colours) is left out.

Source: Open Robotics. Unified Robot Description Format, XML. 2009.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import (
    LARGEST_COORDINATE,
    FloatArray,
    MeshError,
    ResourceError,
    StrPath,
    UnknownNames,
    UnreadableError,
    Vocabulary,
    file_bytes,
    norm,
    printable,
    shown,
    suffix_of,
)
from rastercov.base.files import LARGEST_TEXT, is_file
from rastercov.formats.meshes.polygons import LONGEST_NAME, check, refuse_broken_files
from rastercov.formats.meshes.xml_tree import (
    children,
    local_name,
    look_at_names,
    parse_xml,
    transform_numbers,
)

TURNING, MOVING = ("revolute", "continuous", "prismatic"), ("floating", "planar")
MOST_LINKS = 1_000
MEMORY = 1 << 30
"""Bytes of the tree of a file."""
SIZES = {"box": ("size", 3), "cylinder": ("radius", 1), "sphere": ("radius", 1)}
"""Attribute of a shape, and its count of numbers; a cylinder has a length, too."""
NAMES = Vocabulary(
    "robot link joint collision visual geometry mesh box cylinder sphere",
    "origin parent child axis limit mimic xyz rpy lower upper filename scale size radius length "
    "multiplier offset name type joint",
    "version material color texture rgba inertial mass inertia value ixx ixy ixz iyy iyz izz "
    "effort velocity transmission gazebo sensor dynamics damping friction calibration rising "
    "falling safety_controller soft_lower_limit soft_upper_limit k_position k_velocity verbose "
    "contact ros2_control ros2_control_interface plugin capsule acceleration deceleration jerk "
    "noNamespaceSchemaLocation schemaLocation group self_collision_checking contact_coefficients "
    "lateral_friction",
)


class LinkShape(NamedTuple):
    """A shape of a link.

    Attributes
    ----------
    kind : str
        "mesh", "box", "cylinder" or "sphere".
    origin : (4, 4) float64
        link_from_shape.
    sizes : tuple of float
        Extents of a box, radius and length of a cylinder, radius of a sphere, scales of a mesh.
    file : str
        Name of a mesh file as it is written.
    """

    kind: str
    origin: FloatArray
    sizes: tuple[float, ...]
    file: str = ""


class Joint(NamedTuple):
    """A joint; its value is `factor` times an entry of the joint angles, plus `offset`.

    Attributes
    ----------
    kind : str
        "fixed", "revolute", "continuous" or "prismatic".
    parent, child : str
        Links.
    origin : (4, 4) float64
        parent_from_joint.
    axis : (3,) float64
        Unit vector in the frame of the joint.
    column : int
        Entry of the joint angles, -1 of a fixed joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: FloatArray
    axis: FloatArray
    column: int = -1
    factor: float = 1.0
    offset: float = 0.0


class Description(NamedTuple):
    """Content of a file.

    Attributes
    ----------
    links : dict of str to list of Shape
        The root is the first.
    joints : tuple of Joint
        A joint comes after the one that moves its parent.
    names : tuple of str
        Joints that move by themselves, in the order of the file.
    limits : (J, 2) float64
        Least and greatest value of these, radians or metres.
    """

    name: str
    links: dict[str, list[LinkShape]]
    joints: tuple[Joint, ...]
    names: tuple[str, ...]
    limits: FloatArray
    notes: tuple[str, ...]


def read(path: StrPath, geometry: str) -> Description:
    """Links and joints of a file; MeshError, with its name, for what is no robot of rigid links."""
    name = printable(str(path))
    try:
        data, own = file_bytes(path, LARGEST_TEXT), Path(path)
        with refuse_broken_files():
            is_xacro = suffix_of(path) == ".xacro"
            root = Element("robot") if is_xacro else parse_xml(data, "the file", MEMORY)
            is_xacro |= any("xacro}" in each.tag for each in root)
            out = f"{printable(own.name.split('.')[0])}{'.whole' * (own.suffix == '.urdf')}.urdf"
            fault = "expected a URDF file, got a xacro file, which generates one"
            check(not is_xacro, fault, f"run xacrodoc {printable(own.name)} -o {out}")
            return _describe_robot(root, geometry, own.stem)
    except UnreadableError as error:
        raise MeshError(f"{name}: {error}") from None
    except (MeshError, ResourceError) as error:
        raise type(error)(f"{name}: {error}") from error


def locate(file: str, folder: Path, packages: Mapping[str, StrPath]) -> Path:
    """Path of a mesh file of a robot: beside its URDF, or in the folder of a package."""
    name = shown(printable(file))
    scheme, _, rest = file.rpartition("://")
    result = folder / rest
    if scheme == "package":
        package, _, rest = rest.lstrip("/").partition("/")
        advice = f'set packages = {{"{printable(package)}" = "its folder"}}'
        check(
            package in packages, f"expected the folder of the package of {name}, got none", advice
        )
        is_inside = rest and ".." not in re.split(r"[/\\]", rest) and not Path(rest).is_absolute()
        check(is_inside, f"expected a file in a package, got {name}", "correct it")
        result = Path(packages[package]) / rest
    elif scheme == "file":
        result = Path(rest)
    check(
        scheme in ("", "file", "package"),
        f"expected a file or package://, got {name}",
        "download it first",
    )
    check(
        is_file(result),
        f"expected the mesh {name}, got no file {printable(str(result))}",
        "correct the name, or the folders of packages",
    )
    return result


def _describe_robot(root: Element, geometry: str, stem: str) -> Description:
    tag = local_name(root)
    check(tag == "robot", f"expected an element robot, got {shown(tag)}", "name a URDF file")
    unknown = UnknownNames(MeshError)
    look_at_names(root, NAMES, unknown)
    links = _by_name(children(root, "link"), "link")
    elements = _by_name(children(root, "joint"), "joint")
    check(links, "expected links, got none", "name a URDF file")
    check(
        len(links) <= MOST_LINKS,
        f"expected at most {MOST_LINKS} links, got {len(links)}",
        "leave some out",
    )
    ordered = _from_root(list(links), [_joint(name, each) for name, each in elements.items()])
    joints, names, limits, notes = _driving_joints(ordered, elements)
    root_link = (set(links) - {each.child for each in joints}).pop()
    shapes = {root_link: _shapes(links.pop(root_link), geometry)}
    shapes |= {name: _shapes(each, geometry) for name, each in links.items()}
    name = printable(root.get("name") or stem, LONGEST_NAME).replace("/", "_") or "robot"
    return Description(name, shapes, joints, names, limits, (*unknown.notes(), *notes))


def _by_name(elements: list[Element], kind: str) -> dict[str, Element]:
    names = [each.get("name") or "" for each in elements]
    twice = [name for name, count in Counter(names).items() if count > 1]
    check(all(names), f"expected a name of every {kind}, got none", "name it")
    check(not twice, f"expected each {kind} once, got {shown(twice[:1])[1:-1]} twice", "rename one")
    return dict(zip(names, elements, strict=True))


def _shapes(link: Element, geometry: str) -> list[LinkShape]:
    shapes = []
    where = f"link {shown(link.get('name'))}"
    for owner in children(link, geometry):
        for each in [one for element in children(owner, "geometry") for one in element]:
            kind, sizes = local_name(each), (1.0, 1.0, 1.0)
            if kind in SIZES:
                name, count = SIZES[kind]
                sizes = tuple(_numbers(each, name, count, where))
                sizes += tuple(_numbers(each, "length", 1, where)) if kind == "cylinder" else ()
                is_right = min(sizes) > 0
                check(is_right, f"{where}: expected a {kind} of sizes above 0, got {list(sizes)}")
            else:
                check(
                    kind == "mesh",
                    f"{where}: expected a mesh, box, cylinder or sphere, got {shown(kind)}",
                    "replace it by a mesh",
                )
                sizes = tuple(_numbers(each, "scale", 3, where, "1 1 1"))
                check(all(sizes), f"{where}: expected a scale other than 0, got {list(sizes)}")
                check(each.get("filename"), f"{where}: expected a filename, got none")
            shapes.append(LinkShape(kind, _origin(owner, where), sizes, each.get("filename") or ""))
    return shapes


def _joint(name: str, element: Element) -> Joint:
    where, kind = f"joint {shown(name)}", element.get("type") or ""
    if kind in MOVING:
        fault = f"{where}: expected a joint of one axis, got {kind}"
        check(False, fault, "make it fixed, and move the robot by a table of poses")
    wanted = ("fixed", *TURNING)
    check(
        kind in wanted,
        f"{where}: expected type to be one of {', '.join(wanted)}, got {shown(kind)}",
    )
    ends = [
        each.get("link") or "" for tag in ("parent", "child") for each in children(element, tag)
    ]
    check(len(ends) == 2 and all(ends), f"{where}: expected one parent and one child, got {ends}")
    axis = np.array([1.0, 0.0, 0.0])
    for each in children(element, "axis")[:1]:
        axis = _numbers(each, "xyz", 3, where, "1 0 0")
    length = norm(axis)
    check(kind == "fixed" or length > 0, f"{where}: expected an axis, got 0 0 0")
    axis = axis / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return Joint(name, kind, ends[0], ends[1], _origin(element, where), axis)


def _from_root(links: list[str], joints: list[Joint]) -> list[Joint]:
    """Joints in an order in which each comes after the one that moves its parent."""
    for each in joints:
        for end in (each.parent, each.child):
            fault = f"joint {shown(each.name)}: expected a link of the robot, got {shown(end)}"
            check(end in links, fault, "correct the name")
    twice = [link for link, n in Counter(each.child for each in joints).items() if n > 1]
    check(
        not twice,
        f"expected each link to have one parent, got two joints to {shown(twice[:1])[1:-1]}, a "
        "loop",
        "cut the loop at one of them",
    )
    roots = sorted(set(links) - {each.child for each in joints})
    check(roots, "expected a link without a parent, got a cycle", "leave one link free")
    check(
        len(roots) == 1,
        f"expected one link without a parent, got {shown(roots)}",
        "join them by fixed joints",
    )
    of_parent: dict[str, list[Joint]] = {}
    for each in joints:
        of_parent.setdefault(each.parent, []).append(each)
    items: list[Joint] = []
    reached = [roots[0]]
    for link in reached:  # grows as it is walked through
        items += of_parent.get(link, [])
        reached += [each.child for each in of_parent.get(link, [])]
    lost = sorted(set(links) - set(reached))
    check(not lost, f"expected no cycle, got one at {shown(lost[:1])[1:-1]}", "leave one link free")
    return items


def _driving_joints(
    joints: list[Joint], elements: dict[str, Element]
) -> tuple[tuple[Joint, ...], tuple[str, ...], FloatArray, list[str]]:
    """Joints with the entries that move them, the names of these, their limits, and notes.

    Limits hold for all joints that an entry moves. Those of a joint that mimics are left out where
    they leave no room: hands whose fingers mirror each other often give all of them one range.
    """
    kinds = {each.name: each.kind for each in joints}
    masters = {
        name: own[0]
        for name, each in elements.items()
        if kinds[name] != "fixed" and (own := children(each, "mimic"))
    }
    names = tuple(n for n in elements if kinds[n] != "fixed" and n not in masters)
    limits_of = {each.name: _limits(each, elements[each.name]) for each in joints}
    limits, notes = np.array([limits_of[name] for name in names]).reshape(-1, 2), []
    items: list[Joint] = []
    for each in joints:
        if each.kind == "fixed":
            items.append(each)
            continue
        name, factor, offset, steps = each.name, 1.0, 0.0, 0
        while name in masters:
            where, mimic = f"joint {shown(name)}", masters[name]
            offset += factor * float(_numbers(mimic, "offset", 1, where, "0")[0])
            factor *= float(_numbers(mimic, "multiplier", 1, where, "1")[0])
            name, steps = mimic.get("joint") or "", steps + 1
            is_moving = kinds.get(name, "fixed") != "fixed"
            check(is_moving, f"{where}: expected to mimic a joint that moves, got {shown(name)}")
            check(steps <= len(masters), f"{where}: expected to mimic another joint, got a cycle")
        column = names.index(name)
        if factor and name != each.name:
            ends = [(end - offset) / factor + 0.0 for end in limits_of[each.name]]
            low, high = max(limits[column, 0], min(ends)), min(limits[column, 1], max(ends))
            if low < high:
                limits[column] = low, high
            elif limits[column, 0] < limits[column, 1]:
                notes.append(
                    f"ignored limits of {shown(each.name)}, which leave no range to {shown(name)}"
                )
        items.append(each._replace(column=column, factor=factor, offset=offset))
    return tuple(items), names, limits, notes


def _limits(joint: Joint, element: Element) -> tuple[float, float]:
    if joint.kind in ("continuous", "fixed"):
        return -math.inf, math.inf
    where, given = f"joint {shown(joint.name)}", children(element, "limit")
    check(given, f"{where}: expected limits, got none", "add them")
    low, high = (float(_numbers(given[0], name, 1, where, "0")[0]) for name in ("lower", "upper"))
    check(
        low <= high,
        f"{where}: expected limits lower <= upper, got {low:g} and {high:g}",
        "correct them",
    )
    return low, high


def _numbers(
    element: Element, name: str, count: int, where: str, default: str | None = None
) -> FloatArray:
    """Finite numbers of an attribute."""
    try:
        result = transform_numbers(element.get(name, default), count)
    except ValueError:
        result = np.full(count, np.inf)
    got = shown(element.get(name, "nothing"))
    check(
        np.abs(result).max() <= LARGEST_COORDINATE,
        f"{where}: expected {name} to be {count} finite "
        f"{'number' if count == 1 else 'numbers'}, got {got}",
        "correct it",
    )
    return result


def _origin(owner: Element, where: str) -> FloatArray:
    """Pose of the element origin of another: fixed angles about x, y and z, then a translation."""
    pose = np.eye(4)
    for each in children(owner, "origin")[:1]:
        roll, pitch, yaw = _numbers(each, "rpy", 3, where, "0 0 0")
        (a, b), (c, d), (e, f) = ((math.cos(x), math.sin(x)) for x in (roll, pitch, yaw))
        pose[:3, :3] = [
            (e * c, e * d * b - f * a, e * d * a + f * b),
            (f * c, f * d * b + e * a, f * d * a - e * b),
            (-d, c * b, c * a),
        ]
        pose[:3, 3] = _numbers(each, "xyz", 3, where, "0 0 0")
    return pose
