"""Values that the command line names: a scene, and poses around it.

Between `cli` and the chain: files and built-in meshes. `views` has cameras and pose files.
"""

import os
import tomllib
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.arguments import MOST_POSES
from rastercov.base.errors import ConfigError, MeshError, PoseError
from rastercov.base.files import is_file
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import enclosing_distance, sphere_of_poses
from rastercov.cli import options
from rastercov.mesh import Mesh, shapes
from rastercov.mesh.groups import named
from rastercov.mesh.mesh import names_of
from rastercov.mesh.names import by_file, files_named


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

    Entries of `unit` and `transform` are for all files, or by name: NAME:UNIT; see `mesh.names`.
    """
    roles = {"--occluder": occluders, "--target": targets or []}
    further = [name for names in roles.values() for name in names if _is_further(name, meshes)]
    paths = [*meshes, *dict.fromkeys(map(Path, further))]
    places = [_transform(each) for each in by_file("--transform", _named(transform), paths, "")]
    units = [_unit(each) for each in by_file("--unit", _named(unit), paths, "m")]
    mesh = Mesh.load(paths, units, transforms=places, drop_invalid=drop_invalid)
    names = names_of(mesh, paths)
    both = "all" if "all" in two_sided else named("--two-sided", two_sided, names)
    hiding, transparent = (named(role, given, names) for role, given in roles.items())
    mesh = mesh.with_groups(hiding, both, transparent)
    if not mesh.task_mask.any():
        raise MeshError("every group is an occluder; leave at least one to be covered")
    return mesh


class SceneOptions(NamedTuple):
    """Options of the mesh files of a command."""

    unit: options.Unit = options.UNIT
    transform: options.Transform = []  # noqa: RUF012 - typer copies it
    occluders: options.Occluders = []  # noqa: RUF012 - the same
    two_sided: options.TwoSided = []  # noqa: RUF012 - the same
    drop_invalid: options.DropInvalid = False
    targets: options.Targets = []  # noqa: RUF012 - the same

    def read(self, meshes: list[Path]) -> Mesh:
        """Scene of these files or the built-in mesh."""
        return read_scene(meshes, *self)

    def entries(self, out: Path, meshes: list[Path]) -> dict[str, Any]:
        """Arguments of `read_scene`, with the working folder, for the report in a folder.

        The working folder is named as it is seen from there, so that both may move together.
        """
        folder = str(Path.cwd())
        with suppress(ValueError):  # on another drive
            folder = os.path.relpath(folder, out.resolve())
        return {"folder": folder, "meshes": list(map(str, meshes)), **self._asdict()}


def are_arguments(value: Any) -> bool:
    """True for what `SceneOptions.entries` gives, after a way through JSON."""
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
    """Scene of the entries in a result's folder, whose files have these names.

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
        near = next(filter(is_file, tries), None)
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


def _is_further(name: str, meshes: list[Path]) -> bool:
    """True for a mesh file that is not among the meshes.

    ConfigError where it is a file of that name here, and one of the meshes has the name, too.
    """
    if not is_file(name) or any(path.exists() and path.samefile(name) for path in meshes):
        return False
    if Path(name).name == name and (rows := files_named(name, meshes)[0]):
        raise ConfigError(f"{name} may be {meshes[rows[0]]} or ./{name}; give the path")
    return True


def _named(values: list[str]) -> list[tuple[str | None, str]]:
    """Names and values of entries NAME:VALUE; None for VALUE alone."""
    parts = (entry.rpartition(":") for entry in values)
    return [(name if colon else None, value) for name, colon, value in parts]


def _transform(text: str) -> dict[str, Any]:
    """Arguments of `Mesh.moved`, from the entries of `transform` of a plan."""
    if not text:
        return {}
    from pydantic import ValidationError

    from rastercov.placement.plan.errors import lines_of
    from rastercov.placement.plan.sections import TransformEntry

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
