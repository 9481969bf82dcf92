"""Values that the command line names: a scene, a camera, poses.

Between `cli` and the chain: files and built-in meshes, presets, poses on a sphere.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rastercov import shapes
from rastercov._arguments import MOST_POSES
from rastercov.camera import Camera
from rastercov.camera_file import PRESETS
from rastercov.errors import ConfigError, MeshError, PoseError
from rastercov.mesh import Mesh
from rastercov.mesh.formats import READERS
from rastercov.pose_file import read_poses
from rastercov.viewpoints import enclosing_distance, sphere_of_poses


def read_scene(
    meshes: list[Path],
    unit: str,
    occluders: list[str],
    two_sided: list[str],
    drop_invalid: bool,
    targets: list[str] | None = None,
) -> Mesh:
    """Scene of the named files; an occluder or target may be a further file or a group of these."""
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
        if name in shapes.NAMES and (len(meshes) > 1 or further or unit != "m"):
            raise ConfigError(f"{name} is built in: it takes no --unit and no other mesh files")
    if str(meshes[0]) in shapes.NAMES and not _is_file(meshes[0]):
        mesh = shapes.by_name(str(meshes[0]))
    else:
        mesh = Mesh.load([*meshes, *further], _unit(unit), drop_invalid=drop_invalid)
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


def _is_file(name: str | Path) -> bool:
    """True for a file of that name, and no folder; False for a name too long."""
    try:
        return Path(name).is_file()
    except OSError:
        return False


def _unit(unit: str) -> str | float:
    try:
        return float(unit)
    except ValueError:
        return unit


def read_camera(name: str) -> Camera:
    """Camera of that preset or file."""
    return Camera.preset(name) if name in PRESETS else Camera.load(name)


def read_view_points(source: str, mesh: Mesh, camera: Camera) -> NDArray[np.float64]:
    """Poses of a file, or sphere:N around the mesh at the distance where it fills the image."""
    if not source.startswith("sphere:"):
        return read_poses(source)
    count = source.removeprefix("sphere:")
    if not count.isdecimal() or not 1 <= float(count) <= MOST_POSES:
        raise PoseError(f"--poses sphere:N wants a whole number 1 to {MOST_POSES}, got {source!r}")
    centre = mesh.bounds.mean(axis=0)
    try:
        _, distance = enclosing_distance(mesh, camera, centre)
    except ConfigError:
        raise PoseError("--poses sphere:N needs a principal point inside the image") from None
    return sphere_of_poses(centre, distance, int(count))
