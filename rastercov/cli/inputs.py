"""Values that the command line names: a scene, and poses around it.

Between `cli` and the chain: files and built-in meshes. `views` has cameras and pose files.
"""

import os
import tomllib
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov import shapes
from rastercov._arguments import MOST_POSES
from rastercov.camera import Camera
from rastercov.errors import ConfigError, MeshError, PoseError
from rastercov.mesh import Mesh
from rastercov.mesh.formats import READERS
from rastercov.viewpoints import enclosing_distance, sphere_of_poses


def read_scene(
    meshes: list[Path],
    unit: list[str],
    transform: list[str],
    occluders: list[str],
    two_sided: list[str],
    drop_invalid: bool,
    targets: list[str] | None = None,
) -> Mesh:
    """Scene of the named files; an occluder or target may be a further file or a group of these.

    Entries of `unit` and `transform` are for all files, or for one: FILE:UNIT.
    """
    roles = {"--occluder": occluders, "--target": targets or []}
    files = {role: [name for name in names if _is_file(name)] for role, names in roles.items()}
    groups_of = {role: [n for n in names if n not in files[role]] for role, names in roles.items()}
    further = [name for names in files.values() for name in names]
    for name in map(str, meshes):
        if _is_file(name):
            continue
        if name not in shapes.NAMES and Path(name).suffix.lower() not in READERS:
            raise MeshError(
                f"{name}: there is no such file, nor a built-in mesh of that name; "
                f"built in are {', '.join(shapes.NAMES)}"
            )
        if name in shapes.NAMES and (len(meshes) > 1 or further or unit != ["m"]):
            raise ConfigError(f"{name} is built in: it takes no --unit and no other mesh files")
    if str(meshes[0]) in shapes.NAMES and not _is_file(meshes[0]):
        mesh = shapes.by_name(str(meshes[0]))
        mesh = _placed(mesh, [meshes[0]], [mesh.n_faces], transform)
    else:
        paths = [*meshes, *map(Path, further)]
        units = [_unit(each) for each in _for_each("unit", unit, paths, "m")]
        mesh = Mesh.load(paths, units, drop_invalid=drop_invalid)
        mesh = _placed(mesh, paths, [source.n_faces for source in mesh.sources], transform)
        ends = np.cumsum([0, *(source.n_faces for source in mesh.sources)])
        start = len(meshes)
        for role, names in files.items():
            faces = slice(ends[start], ends[start + len(names)])
            rows = np.unique(mesh.face_group[faces])
            groups_of[role] += [mesh.groups[index].name for index in rows]
            start += len(names)
    groups = [group.name for group in mesh.groups]
    for role, names in groups_of.items():
        if unknown := [name for name in names if name not in groups]:
            raise MeshError(
                f"{role} {unknown[0]}: there is no such file, nor a group of that name; "
                f"groups are {', '.join(groups)}"
            )
    both = "all" if "all" in two_sided else two_sided
    mesh = mesh.with_groups(groups_of["--occluder"], both, groups_of["--target"])
    if not mesh.task_mask.any():
        raise MeshError("every group is an occluder; leave at least one to be covered")
    return mesh


def arguments_of(out: Path, meshes: list[Path], **options: Any) -> dict[str, Any]:
    """Arguments of `read_scene`, with the working folder, for the report in a folder.

    The working folder is named as it is seen from there, so that both may move together.
    """
    folder = str(Path.cwd())
    with suppress(ValueError):  # on another drive
        folder = os.path.relpath(folder, out.resolve())
    return {"folder": folder, "meshes": list(map(str, meshes)), **options}


def are_arguments(value: Any) -> bool:
    """True for what `arguments_of` gives, after a way through JSON."""
    lists = {"meshes", "unit", "transform", "occluders", "two_sided", "targets"}
    return (
        isinstance(value, dict)
        and value.keys() == lists | {"folder", "drop_invalid"}
        and isinstance(value["folder"], str)
        and isinstance(value["drop_invalid"], bool)
        and all(isinstance(value[name], list) for name in lists)
        and all(isinstance(entry, str) for name in lists for entry in value[name])
    )


def read_again(
    result: Path, arguments: Mapping[str, Any], names: Collection[str], given: list[Path]
) -> Mesh:
    """Scene of `arguments_of` a result's folder, whose files have these names.

    Files that are not where they were are looked for by their names in the working folder, in the
    result's and beside it; `given` ones, in the order of the names or with the same, come first.
    """
    kept = dict(arguments)
    places = [result.resolve() / kept.pop("folder"), Path.cwd(), result, result.resolve().parent]
    files = [*kept["meshes"], *kept["occluders"], *kept["targets"]]
    files = [file for file in files if Path(file).name in names and file not in shapes.NAMES]
    found = {path.name: path for path in given}
    if len(given) == len(files):
        found = dict(zip([Path(file).name for file in files], given, strict=True)) | found
    now: dict[str, str] = {}
    for file in files:
        name = Path(file).name
        tries = [places[0] / file, *(place / name for place in places)]
        if name in found:
            tries = [found[name]]
        near = next(filter(_is_file, tries), None)
        if near is None:
            raise MeshError(
                f"{file} of {result} is neither where it was nor near; name it after the folder"
            )
        now[file] = str(near.resolve())

    def moved(entry: str) -> str:
        name, colon, value = entry.rpartition(":")
        return now[name] + colon + value if name in now else now.get(entry, entry)

    for name, entries in kept.items():
        if isinstance(entries, list):
            kept[name] = [moved(entry) for entry in entries]
    kept["meshes"] = [Path(mesh) for mesh in kept["meshes"]]
    return read_scene(**kept)


def _is_file(name: str | Path) -> bool:
    """True for a file of that name, and no folder; False for a name too long."""
    try:
        return Path(name).is_file()
    except OSError:
        return False


def _for_each(option: str, values: list[str], paths: list[Path], default: str) -> list[str]:
    """Value of an option for each file, from entries VALUE for all files and FILE:VALUE for one."""
    found: dict[int | None, str] = {}
    for entry in values:
        name, colon, value = entry.rpartition(":")
        row = _row(option, entry, name, paths) if colon else None
        if row in found:
            of = "all files" if row is None else paths[row].name
            raise ConfigError(f"--{option} is given twice for {of}; leave one, or name the file")
        found[row] = value
    return [found.get(row, found.get(None, default)) for row in range(len(paths))]


def _row(option: str, entry: str, name: str, paths: list[Path]) -> int:
    """Row of the file that an entry names by its path, its name, or its name without suffix."""
    for own in (str, lambda path: path.name, lambda path: path.stem):
        rows = [row for row, path in enumerate(paths) if own(path) == name]
        if len(rows) == 1:
            return rows[0]
        if rows:
            raise ConfigError(f"--{option} {entry}: {len(rows)} files have that name; give a path")
    known = ", ".join(map(str, paths))
    raise ConfigError(f"--{option} {entry}: there is no mesh file {name!r}; files are {known}")


def _placed(mesh: Mesh, paths: list[Path], n_faces: list[int], transform: list[str]) -> Mesh:
    """The mesh with the faces of each file where its transform puts them."""
    if not transform:
        return mesh
    first = 0
    for text, count in zip(_for_each("transform", transform, paths, ""), n_faces, strict=True):
        if text:
            rows = np.unique(mesh.face_group[first : first + count])
            mesh = mesh.moved(**_transform(text), groups=[mesh.groups[row].name for row in rows])
        first += count
    return mesh


def _transform(text: str) -> dict[str, Any]:
    """Arguments of `Mesh.moved`, from the entries of `transform` of a plan."""
    from pydantic import ValidationError

    from rastercov.plan.errors import lines_of
    from rastercov.plan.sections import TransformEntry

    inside = text.strip().removeprefix("{").removesuffix("}")
    try:
        table = tomllib.loads(f"transform = {{ {inside} }}")["transform"]
        return TransformEntry.model_validate(table).model_dump()
    except ValidationError as error:
        reason = lines_of(error, table, TransformEntry)[0]
    except (tomllib.TOMLDecodeError, RecursionError):
        reason = "wanted entries such as 'angle_deg = 90, translation = [0, 0, 1]'"
    raise ConfigError(f"--transform {text}: {reason}; correct it")


def _unit(unit: str) -> str | float:
    try:
        return float(unit)
    except ValueError:
        return unit


def poses_around(source: str, mesh: Mesh, camera: Camera) -> NDArray[np.float64]:
    """Poses of sphere:N: N around the mesh, at the distance where it fills the image."""
    count = source.removeprefix("sphere:")
    if not count.isdecimal() or not 1 <= float(count) <= MOST_POSES:
        raise PoseError(f"--poses sphere:N wants a whole number 1 to {MOST_POSES}, got {source!r}")
    centre = mesh.bounds.mean(axis=0)
    try:
        _, distance = enclosing_distance(mesh, camera, centre)
    except ConfigError:
        raise PoseError("--poses sphere:N needs a principal point inside the image") from None
    return sphere_of_poses(centre, distance, int(count))
