"""Files of motions: tables of poses in JSON and CSV, animations of glTF.

JSON: {"bodies": {"head": {"poses": [4 x 4, ...], "present": [true, ...]}}, "durations": [...]};
poses are rigid transforms from the rest pose, and all except the names may be left out. "times", at
which frames begin, may replace durations; the last frame is as long as the one before.

CSV: one row per frame. Columns are `time` or `duration`, and for each body NAME.x, NAME.y, NAME.z,
metres, NAME.qw ... NAME.qz, a quaternion of length 1 within `OFF_UNIT`, and NAME.present, 0 or 1.
Columns that are left out mean 0 m, no rotation, and present.
"""

from functools import partial
from pathlib import Path

import numpy as np

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    RastercovError,
    StrPath,
    UnreadableError,
    errors_as,
    file_bytes,
    norm,
    printable,
    read_json,
    shown,
    suffix_of,
)
from rastercov.base.files import LARGEST_ARRAY
from rastercov.core.mesh.arrays import rotations_of_quaternions, unit
from rastercov.core.mesh.columns import TIMES, columns_of, durations_of
from rastercov.core.mesh.files import metres_per
from rastercov.core.mesh.mesh import Mesh
from rastercov.formats.meshes import of_gltf
from rastercov.motion.gltf_animation import read_animation
from rastercov.motion.motion import Motion, check_steps

PLACE, TURN = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
COLUMNS = (*PLACE, *TURN, "present")
OF_GLTF = (".glb", ".gltf")
OFF_UNIT = 1e-3
"""Difference of the length of a quaternion from 1 that is rounding."""
OFF_RIGID, STILL = 1e-5, 1e-7
"""Scale, and difference from the rest pose, up to which they are rounding of float32."""


def load_motion(
    mesh: Mesh,
    path: StrPath,
    *,
    animation: str = "",
    steps: int = 50,
    unit: str | float = "m",
) -> Motion:
    r"""Motion of a mesh from a file: a table of poses, JSON or CSV, or a glTF animation.

    Parameters
    ----------
    mesh : Mesh
        The mesh in its rest pose; bodies in the file are named by its groups or files.
    path : path
        .json, {"bodies": {NAME: {"poses": [4 x 4, ...], "present": [...]}}, "durations": [...]};
        .csv, a row per frame with the columns `time` or `duration`, NAME.x, NAME.y, NAME.z in
        metres, NAME.qw ... NAME.qz, a unit quaternion, and NAME.present; or .glb or .gltf.
    animation : str
        Name of the animation of a glTF file; "" for the only one.
    steps : int
        Number of frames of a glTF animation, equally spaced in time.
    unit : str or float
        Unit of a glTF file, as for `Mesh.load`.

    Raises
    ------
    ConfigError
        For a file that cannot be read or holds something else; the message has its name.
    MeshError
        For a name that is neither a group nor a file of the mesh, and for an invalid glTF file.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rastercov as rc
    >>> _ = Path("motion.csv").write_text("time,mesh.x\n0,0\n1,0.1\n2,0.2\n")
    >>> motion = rc.load_motion(rc.shapes.box((0.2, 0.2, 0.2)), "motion.csv")
    >>> motion.poses_of("mesh")[:, 0, 3].tolist()  # metres
    [0.0, 0.1, 0.2]
    """
    with errors_as(ConfigError, caught=UnreadableError):
        suffix = suffix_of(path)
    if suffix in OF_GLTF:
        gltf_motion = read_gltf_motion(mesh, path, animation, steps, unit)
    else:
        gltf_motion = read_motion(path)
    try:
        return Motion(mesh, **gltf_motion)
    except RastercovError as error:
        raise type(error)(f"{printable(Path(path).name)}: {error}") from None


def read_gltf_motion(
    mesh: Mesh,
    path: StrPath,
    animation: str = "",
    steps: int = 50,
    unit: str | float = "m",
    world_from_file: FloatArray | None = None,
) -> ByName:
    """Arguments of `Motion` beside the mesh from an animation of glTF; see `load_motion`.

    `world_from_file`, (4, 4), is where the mesh has the file, in metres; groups that move alike are
    one body.
    """
    count = check_steps(steps)
    result = of_gltf(path, partial(read_animation, name=animation, steps=count))
    name, stem = printable(Path(path).name), printable(Path(path).stem)
    poses = result.poses.copy()
    poses[:, :, :3, 3] *= metres_per(unit)
    if world_from_file is not None:
        poses = world_from_file @ poses @ np.linalg.inv(world_from_file)
    u, sizes, vt = np.linalg.svd(poses[:, :, :3, :3])
    if not (np.abs(sizes - 1) <= OFF_RIGID).all():
        raise ConfigError(
            f"{name}: expected rigid bodies, got a node that is scaled over time; remove its scale"
        )
    poses[:, :, :3, :3] = u @ vt
    groups = {group.name for group in mesh.groups}
    bodies: dict[bytes, list[int]] = {}
    for row in range(len(poses)):
        if (np.abs(poses[row] - np.eye(4)).max() > STILL) or not result.present[row].all():
            key = np.round(poses[row], 9).tobytes() + result.present[row].tobytes()
            bodies.setdefault(key, []).append(row)
    if not bodies:
        raise ConfigError(f"{name}: expected an animation that moves a mesh, got none")

    def group_of(path: str) -> str:
        known = [each for each in (f"{stem}/{path}", path, stem) if each in groups]
        if not known:
            raise ConfigError(
                f"{name}: expected groups of the mesh, got {shown(path)} in the animation; rename "
                "it"
            )
        return known[0]

    named = {rows[0]: [group_of(result.names[row]) for row in rows] for rows in bodies.values()}
    return {
        "bodies": {own[0]: poses[row] for row, own in named.items()},
        "present": {own[0]: result.present[row] for row, own in named.items()},
        "groups": {own[0]: own for own in named.values()},
    }


def read_motion(path: StrPath) -> ByName:
    """Arguments of `Motion` beside the mesh; errors as of `load_motion`."""
    try:
        suffix = suffix_of(path)
        if suffix == ".json":
            return _of_json(read_json(path, LARGEST_ARRAY))
        if suffix == ".csv":
            return _of_csv(file_bytes(path, LARGEST_ARRAY).decode("utf-8-sig"))
        raise ConfigError(
            "expected a motion in .json, .csv, .glb or .gltf (.toml for --motion), got "
            f"{shown(suffix)}; rename or convert it"
        )
    except UnicodeDecodeError:
        raise ConfigError(
            f"{printable(str(path))}: expected text in UTF-8, got another encoding; save it as "
            "UTF-8"
        ) from None
    except (UnreadableError, ConfigError) as error:
        raise ConfigError(f"{printable(Path(path).name)}: {error}") from None


def _of_json(content: object) -> ByName:
    known = {"bodies", "durations", "times"}
    if not isinstance(content, dict) or not isinstance(content.get("bodies"), dict):
        raise ConfigError(
            'expected {"bodies": {NAME: {"poses": [4 x 4, ...]}}}, got other entries; correct '
            "the file"
        )
    if unknown := sorted(content.keys() - known):
        raise ConfigError(
            f"expected entries {', '.join(sorted(known))}, got {shown(unknown[0])}; correct the "
            "name"
        )
    bodies, present = {}, {}
    for name, entry in content["bodies"].items():
        if not isinstance(entry, dict) or entry.keys() - {"poses", "present"}:
            raise ConfigError(
                f"expected poses and present of body {shown(name)}, got {shown(entry)}"
            )
        bodies[name] = entry.get("poses", np.eye(4))
        if "present" in entry:
            present[name] = entry["present"]
    return {"bodies": bodies, "present": present} | durations_of(content)


def _of_csv(text: str) -> ByName:
    columns = columns_of(text)
    table: ByName = {}
    bodies: dict[str, dict[str, list[float]]] = {}
    for name, values in columns.items():
        body, _, field = name.rpartition(".")
        if name in TIMES:
            table[f"{name}s"] = values
        elif body and field in COLUMNS:
            bodies.setdefault(body, {})[field] = values
        else:
            raise ConfigError(
                f"expected columns time, duration, NAME.{', NAME.'.join(COLUMNS)}, got "
                f"{shown(name)}; rename it"
            )
    if not bodies:
        raise ConfigError("expected a column of a body, got none; name one BODY.x")
    n = len(next(iter(columns.values())))
    poses = {name: _poses_of(name, own, n) for name, own in bodies.items()}
    present = {
        name: np.array(own["present"]) != 0 for name, own in bodies.items() if "present" in own
    }
    return {"bodies": poses, "present": present} | durations_of(table)


def _poses_of(name: str, own: dict[str, list[float]], n: int) -> FloatArray:
    poses = np.tile(np.eye(4), (n, 1, 1))
    for axis, field in enumerate(PLACE):
        poses[:, axis, 3] = own.get(field, 0.0)
    if any(field in own for field in TURN):
        turns = np.stack([np.broadcast_to(own.get(field, 0.0), n) for field in TURN], axis=1)
        with np.errstate(over="ignore"):
            length = norm(turns)
        is_turn = np.abs(length - 1) <= OFF_UNIT
        if not is_turn.all():
            frame = int(is_turn.argmin())
            raise ConfigError(
                f"body {shown(name)}, frame {frame}: expected a quaternion of length 1, got "
                f"{length[frame]:g}"
            )
        poses[:, :3, :3] = rotations_of_quaternions(unit(turns)[:, [1, 2, 3, 0]])
    return poses
