"""Values that the command line names: a scene, cameras and poses.

Between `cli` and the chain: files of this and other programs, built-in meshes, presets, poses on a
sphere; one file may give both cameras and poses.
"""

import os
import re
import tomllib
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, get_type_hints

import numpy as np
from typer import Option

from rastercov.base import (
    ByName,
    CameraError,
    ConfigError,
    FloatArray,
    MeshError,
    PoseError,
    ReadByName,
    UnreadableError,
    plural,
    printable,
    read_toml,
    shorten,
    shown,
)
from rastercov.base.arguments import MOST_POSES
from rastercov.base.files import is_file, is_same_file, path_from
from rastercov.base.typed import fits
from rastercov.cli import options
from rastercov.core.camera import (
    Border,
    Camera,
    Conventions,
    Poses,
    Rig,
    Views,
    equipment_words,
    look_at,
    names_of_poses,
)
from rastercov.core.camera.catalogue import is_head, is_name
from rastercov.core.camera.rig import phased_features
from rastercov.core.camera.viewpoints import enclosing_distance, sphere_of_poses
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.mesh.groups import by_file, files_of_group, names_of_groups
from rastercov.core.mesh.mesh import names_of
from rastercov.formats.cameras import read_through, read_with_optics

if TYPE_CHECKING:
    from rastercov.page.scene import Shown

AROUND = ("sphere:", "turntable:")
"""Beginnings of poses around a mesh; see `poses_around`."""
MOST_WARNINGS = 5
"""Rejected poses that are named one by one."""


MAY_LACK = ("deflection_mm",)
"""Options of a scene that results may lack."""
UNIT = ["m"]
"""Default of the unit of meshes; typer copies it."""


class SceneOptions(NamedTuple):
    """Options of the mesh files of a command."""

    unit: Annotated[
        list[str],
        Option(
            help="Unit of the mesh files: m, mm, cm, um, in, ft, or metres per unit; NAME:UNIT for "
            "one file. Ignored for files that state their unit."
        ),
    ] = UNIT
    transform: Annotated[
        list[str],
        Option(
            help="Transform of the mesh, as in plan files: any of 'scale = 1, axis = [0, 0, 1], "
            "angle_deg = 90, translation = [0, 0, 1.5]', in metres, applied after --unit; "
            "NAME:TRANSFORM for one file."
        ),
    ] = []  # noqa: RUF012 - typer copies it
    occluders: Annotated[
        list[str],
        Option(
            "--occluder",
            help="Mesh file or group (wildcards allowed) that occludes but is not evaluated.",
        ),
    ] = []  # noqa: RUF012 - typer copies it
    two_sided: Annotated[
        list[str], Option(help="Mesh file or group whose faces are two-sided; 'all' for all.")
    ] = []  # noqa: RUF012 - typer copies it
    drop_invalid: Annotated[bool, Option(help="Drop faces with invalid coordinates, and warn.")] = (
        False
    )
    targets: Annotated[
        list[str],
        Option("--target", help="Mesh file or group that is evaluated but does not occlude."),
    ] = []  # noqa: RUF012 - typer copies it
    deflection_mm: Annotated[
        float | None,
        Option(
            help="Largest distance of triangles from curved surfaces of STEP files, mm "
            "[default: 0.1, or less for small parts]."
        ),
    ] = None

    def read(self, meshes: list[Path]) -> Mesh:
        """Scene of these files; an occluder or target may be a further file or a group of these.

        Entries of `unit` and `transform` are for all files, or by name: NAME:UNIT; see
        `mesh.groups`.
        """
        roles = {"--occluder": self.occluders, "--target": self.targets}
        further = [name for names in roles.values() for name in names if _is_further(name, meshes)]
        paths = [*meshes, *dict.fromkeys(map(Path, further))]
        transforms = by_file("--transform", _split_names(self.transform), paths, "")
        units = by_file("--unit", _split_names(self.unit), paths, "m")
        mesh = Mesh.load(
            paths,
            list(map(options.number_or_name, units)),
            transforms=list(map(_transform, transforms)),
            drop_invalid=self.drop_invalid,
            deflection_mm=self.deflection_mm,
        )
        names = names_of(mesh, paths)
        both = (
            "all"
            if "all" in self.two_sided
            else names_of_groups("--two-sided", self.two_sided, names)
        )
        hiding, transparent = (names_of_groups(role, given, names) for role, given in roles.items())
        mesh = mesh.with_groups(hiding, both, transparent)
        check_targets(mesh)
        return mesh

    def entries(self, out: Path, meshes: list[Path], **others: Path | None) -> ByName:
        """The options, the files and the working folder, for the report in a folder.

        `others` are the files of `further_files`.
        """
        files = {name: str(path) for name, path in others.items() if path is not None}
        given = {name: value for name, value in self._asdict().items() if value is not None}
        own = {"meshes": list(map(str, meshes)), **files, **given}
        return {"folder": path_from(out, Path()), **own}


def check_targets(mesh: Mesh) -> None:
    """Raise `MeshError` where every group occludes."""
    if not mesh.task_mask.any():
        raise MeshError(
            "expected a group to evaluate, got occluders only; leave one out of --occluder"
        )


def further_files() -> list[str]:
    """Words of further files of a scene that a result may have."""
    return [*(each.word for each in phased_features()), *equipment_words()]


def are_arguments(value: object) -> bool:
    """True for what `SceneOptions.entries` gives, after a way through JSON."""
    hints: ByName = {"folder": str, "meshes": list[str], **get_type_hints(SceneOptions)}
    others: ByName = dict.fromkeys(further_files(), str)
    others |= {name: hints.pop(name) for name in MAY_LACK}
    if not isinstance(value, dict) or hints.keys() != value.keys() - others.keys():
        return False
    return all(fits(each, (others | hints)[name]) for name, each in value.items())


def read_again(
    result: Path, arguments: ReadByName, names: Collection[str], given: list[Path]
) -> "Shown":
    """Scene of the entries in a result's folder, whose meshes have these names, and its equipment.

    Files that are not where they were are looked for by their names in the working folder, in the
    result's and beside it; `given` ones, in the order of the names or with the same, come first.
    """
    kept = dict(arguments)
    places = [result.resolve() / kept.pop("folder"), Path.cwd(), result, result.resolve().parent]
    files = [*kept["meshes"], *kept["occluders"], *kept["targets"]]
    files = [file for file in files if Path(file).name in names and file not in shapes.NAMES]
    others = {name: kept.pop(name) for name in further_files() if name in kept}
    files += others.values()
    table = {path.name: path for path in given}
    if len(given) in (len(files) - len(others), len(files)):
        table = dict(zip([Path(file).name for file in files], given, strict=False)) | table
    now: dict[str, str] = {}
    for file in files:
        name = Path(file).name
        tries = [places[0] / file, *(place / name for place in places)]
        if name in table:
            tries = [table[name]]
        near = next(filter(is_file, tries), None)
        if near is None:
            raise MeshError(
                f"expected mesh file {file} of {result}, got no such file; "
                "list it after the result folder, or leave out options such as --unit"
            )
        now[file] = str(near.resolve())

    def move(entry: str) -> str:
        name, colon, value = entry.rpartition(":")
        return now[name] + colon + value if name in now else now.get(entry, entry)

    for name, entries in kept.items():
        if isinstance(entries, list):
            kept[name] = [move(entry) for entry in entries]
    meshes = [Path(mesh) for mesh in kept.pop("meshes")]
    mesh = SceneOptions(**kept).read(meshes)
    read = options.SceneFiles({name: Path(now[file]) for name, file in others.items()})
    equipment = {word: read[word] for word in equipment_words() if word in read}
    return read.phases(mesh) or mesh, equipment


def read_sheet(path: Path | None) -> dict[str, str] | None:
    """Entries of the title block in the [sheet] of a file; None for no file."""
    if path is None:
        return None
    from pydantic import ValidationError

    from rastercov.placement.plan.file import PlanError, lines_of
    from rastercov.placement.plan.sections import SheetSection

    name, table = printable(path.name), ByName()
    try:
        table = read_toml(path)
        if not isinstance(table.get("sheet"), dict):
            raise ConfigError(f"{name}: expected a table [sheet] with the title block, got none")
        return SheetSection.model_validate(table["sheet"]).words()
    except ValidationError as error:
        raise PlanError(f"{name}: sheet", lines_of(error, table["sheet"], SheetSection)) from None
    except UnreadableError as error:
        raise ConfigError(f"{name}: {error}") from None


def _is_further(name: str, meshes: list[Path]) -> bool:
    """True for a mesh file that is not among the meshes.

    ConfigError where it is a file of that name here, and one of the meshes has the name, too.
    """
    if not is_file(name) or any(path.exists() and path.samefile(name) for path in meshes):
        return False
    if Path(name).name == name and (rows := files_of_group(name, meshes)[0]):
        raise ConfigError(
            f"expected one file {name}, got {meshes[rows[0]]} and ./{name}; give the path"
        )
    return True


def _split_names(values: list[str]) -> list[tuple[str | None, str]]:
    """Names and values of entries NAME:VALUE; None for VALUE alone."""
    parts = (entry.rpartition(":") for entry in values)
    return [(name if colon else None, value) for name, colon, value in parts]


def _transform(text: str) -> ByName:
    """Arguments of `Mesh.moved`, from the entries of `transform` of a plan."""
    if not text:
        return {}
    from pydantic import ValidationError

    from rastercov.placement.plan.file import lines_of
    from rastercov.placement.plan.sections import TransformEntry

    try:
        table = _entries(text)
        return TransformEntry.model_validate(table).model_dump()
    except ValidationError as error:
        reason = lines_of(error, table, TransformEntry)[0]
    except (tomllib.TOMLDecodeError, RecursionError):
        reason = (
            "expected entries such as 'angle_deg = 90, scale = 2', got something else; correct it"
        )
    raise ConfigError(f"--transform {shown(text)}: {reason}")


def _entries(text: str) -> ByName:
    """Entries of a TOML table in one line, with or without braces."""
    inside = text.strip().removeprefix("{").removesuffix("}")
    return tomllib.loads(f"table = {{ {inside} }}")["table"]


def poses_around(source: str, mesh: Mesh, camera: Camera) -> FloatArray:
    """Poses of sphere:N or turntable:N@DEG, at the distance where the mesh fills the image.

    A camera with a `focus_range` looks from where all of it is beyond the nearest point in focus.

    The first are N around the mesh, the others N in a ring that many degrees above its middle, and
    more rings after commas.
    """
    kind, _, rest = source.partition(":")
    form = r"(\d{1,8})@(-?\d{1,2}(?:\.\d+)?)" if kind == "turntable" else r"(\d{1,8})()"
    matches = [re.fullmatch(form, part) for part in rest.split(",")]
    rings = [(int(each[1]), float(each[2] or 0)) for each in matches if each]
    is_meant = len(rings) == len(matches) and all(n > 0 and abs(deg) <= 90 for n, deg in rings)
    if not is_meant or sum(n for n, _ in rings) > MOST_POSES:
        raise PoseError(
            f"--poses: expected sphere:N or turntable:N@DEG,N@DEG, N from 1 to {MOST_POSES:,} in "
            f"all and DEG from -90 to 90, got {shown(source)}; correct it"
        )
    if camera.is_parallel:
        raise PoseError(
            f"--poses {kind}: expected a camera with a field of view, got a telecentric one; give "
            "a file of poses"
        )
    centre = mesh.centre
    try:
        radius, distance = enclosing_distance(mesh, camera, centre)
    except ConfigError:
        raise PoseError(
            f"--poses {kind}: expected a principal point in the image, got one outside; give a file"
        ) from None
    if camera.focus_range is not None:
        distance = max(distance, camera.focus_range[0] + radius)
    if kind == "sphere":
        return sphere_of_poses(centre, distance, rings[0][0])
    turns = np.concatenate([2 * np.pi / n * np.arange(n) for n, _ in rings])
    above = np.radians(np.repeat([deg for _, deg in rings], [n for n, _ in rings]))
    flat = np.stack((np.cos(turns), np.sin(turns)), axis=1) * np.cos(above)[:, None]
    return look_at(centre + distance * np.column_stack((flat, np.sin(above))), centre)


def lines_of_lost_poses(poses: Poses) -> list[str]:
    """Lines on poses that are not rigid transforms and were left out."""
    rejected = sorted(poses.rejected.items())
    lines = [f"pose {row} (from 0) skipped: it {text}" for row, text in rejected[:MOST_WARNINGS]]
    others = len(rejected) - MOST_WARNINGS
    return lines + ([f"{plural(others, 'more pose')} skipped"] if others > 0 else [])


def read_eyes(
    mesh: Mesh,
    given: options.CameraOptions,
    poses: str,
    conventions: Conventions,
    *,
    several: bool = False,
) -> Views:
    """Camera of a command, or its cameras, and the poses.

    Parameters
    ----------
    mesh : Mesh
        The scene, for poses around it.
    given : CameraOptions
        A preset, a head or a file, or NAME=FILE for each of several, the file of the poses where
        empty; and perhaps the camera of a file with several.
    poses : str
        A file, or poses around the mesh as of `poses_around`.
    conventions : Conventions
        Answers to what the files leave open.
    several : bool
        Take all cameras unless one is named; the poses then name theirs.

    Raises
    ------
    CameraError
        Where there is no camera, or several to choose from.
    PoseError
        For poses without a unit, and for what is no pose file.
    """
    border = Border(conventions)
    camera, camera_name = given
    cameras = read_cameras(camera, border)
    if poses.startswith(AROUND):
        if cameras is None:
            raise CameraError(f"--poses {poses}: expected a camera, got none; give --camera")
        cameras = add_unused(cameras, border)
        if several and camera_name is None and cameras.rig is not None and cameras.rig.is_one:
            moving = cameras.rig.cameras[int(np.argmin(cameras.rig.is_fixed))]
            around = Poses.of(poses_around(poses, mesh, moving))
            of_rig = Views(None, around, names_of_poses(around))
            return replace(of_rig.with_cameras(cameras.rig), notes=cameras.notes)
        of_camera = cameras.of_camera(camera_name)
        around = Poses.of(poses_around(poses, mesh, of_camera.camera()))
        return replace(of_camera, poses=around, images=names_of_poses(around), has_unit=True)
    _check_source(poses, "a file, sphere:N or turntable:N@DEG")
    is_same = len(camera) == 1 and is_same_file(camera[0], poses)
    views = cameras if is_same and cameras else read_through(poses, border)
    _check_poses(views, poses)
    if cameras is None and views.rig is None:
        raise CameraError(f"{poses}: expected a camera with the poses, got none; give --camera")
    bad = lines_of_lost_poses(in_metres(views, poses).poses)
    if cameras is not None and cameras is not views:
        views = views.through(cameras, camera_name, by_name=several and _by_name(cameras, camera))
        camera_name = None
    if camera_name is not None or not several or views.n_used == 1:
        views = views.of_camera(camera_name)
    notes = list(dict.fromkeys([*views.notes, *bad, *border.unused_keys()]))
    return replace(views, notes=tuple(notes))


def read_rig(given: options.CameraOptions, poses: Path, conventions: Conventions) -> Views:
    """Poses of a file in metres, with cameras where any are given or the file has them.

    Given ones replace the cameras of the file; arguments as for `read_eyes`.
    """
    border = Border(conventions)
    camera, camera_name = given
    cameras = read_cameras(camera, border)
    _check_source(str(poses), "a pose file, such as rig.json of evaluate --out")
    views = in_metres(read_through(poses, border), poses)
    _check_poses(views, poses)
    bad = lines_of_lost_poses(views.poses)
    if cameras is not None:
        views = views.through(cameras, camera_name, by_name=_by_name(cameras, camera))
        views = views.of_camera() if views.n_used == 1 else views
    elif camera_name is not None:
        views = views.of_camera(camera_name)
    return add_unused(replace(views, notes=(*views.notes, *bad)), border)


def add_unused(views: Views, border: Border) -> Views:
    """The views with a note on each answer that no file asked for."""
    return replace(views, notes=(*views.notes, *border.unused_keys()))


def _check_source(poses: str, forms: str) -> None:
    """Raise PoseError for poses that are neither there nor named as a file, with a suffix."""
    is_there = os.path.exists(poses)  # noqa: PTH110 - of a text
    if not is_there and re.fullmatch(r"[\w-]*(:.*)?", poses.strip()):
        raise PoseError(f"--poses: expected {forms}, got {shown(poses)}; correct it")


def _check_poses(views: Views, source: str | Path) -> None:
    """Raise PoseError for a file of cameras alone."""
    if not len(views.poses) and not views.poses.rejected and views.rig is not None:
        raise PoseError(f"{source}: expected poses, got cameras only; give a file with poses")


def in_metres(views: Views, source: str | Path) -> Views:
    """The views of a file; PoseError where their unit is not known."""
    if not views.has_unit:
        raise PoseError(
            f"{source}: expected poses in a known unit, got none; give --pose-unit, such as m"
        )
    return views


def _by_name(cameras: Views, given: Sequence[str]) -> bool:
    """True where poses name their cameras: there are several, or one with a name."""
    return len(cameras.cameras()) > 1 or _name_camera(given[0]) is not None


def read_cameras(given: Sequence[str], border: Border) -> Views | None:
    """Cameras of the option --camera: of one file, or NAME=FILE for each; None where none is.

    Raises
    ------
    CameraError
        For several without names, for two of one name, and for files without a camera.
    """
    if not given:
        return None
    if len(given) == 1 and _name_camera(given[0]) is None:
        return _cameras(given[0], border)
    cameras: dict[str, Camera] = {}
    for text in given:
        if (pair := _name_camera(text)) is None:
            raise CameraError(
                f"--camera: expected NAME=FILE for each of several cameras, got {shown(text)}; "
                "write left=left.yaml"
            )
        name, source = pair
        if name in cameras:
            raise CameraError(
                f"--camera: expected distinct names, got {shown(name)} twice; rename one"
            )
        views = _cameras(source, border)
        assert views.rig is not None
        cameras[name] = views.camera(name if name in views.rig.names else None)
    return _without_poses(Rig(list(cameras.values()), list(cameras)))


def _name_camera(text: str) -> tuple[str, str] | None:
    """Name and file, preset or {entries} of NAME=FILE; None for anything else."""
    name, equals, source = text.partition("=")
    is_missing = re.fullmatch(r"\S+\.[a-z]+", source) is not None  # a file, by its ending
    is_there = os.path.exists(source)  # noqa: PTH110 - of a text
    is_known = is_name(source) or source.startswith("{") or is_there or is_missing
    is_file = os.path.exists(text)  # noqa: PTH110 - a name with = in it
    return (name, source) if name and equals and is_known and not is_file else None


def _cameras(camera: str, border: Border) -> Views:
    if (is_pair := is_head(camera)) or is_name(camera):
        try:
            rig = Rig.preset(camera) if is_pair else Rig([Camera.preset(camera)], [camera])
            return _without_poses(rig)
        except CameraError as error:
            raise CameraError(f"--camera: {error}, or give a file") from None
    if "=" in camera and not os.path.exists(camera):  # noqa: PTH110 - of a text
        try:  # entries of a camera file, as one line; files are in the working folder
            if "file" in (entries := _entries(camera)):
                return read_with_optics(Path(), entries, border)
            return _without_poses(Rig([Camera.from_dict(entries)], ["camera"]))
        except CameraError as error:
            raise CameraError(f"--camera {shorten(camera, 40)}: {error}") from None
        except (tomllib.TOMLDecodeError, RecursionError, AttributeError):
            raise CameraError(
                '--camera: expected a file, a preset, or entries such as \'preset = "khepra", '
                f"near = 0.1', got {shown(camera)}; correct it"
            ) from None
    through = read_through(camera, border)
    if through.rig is None:
        raise CameraError(f"{camera}: expected a camera, got poses only; give a camera file")
    return through


def _without_poses(rig: Rig) -> Views:
    return Views(rig=rig, poses=Poses.of(()))
