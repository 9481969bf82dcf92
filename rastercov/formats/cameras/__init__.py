"""Camera and pose files of other programs, in and out: docs/camera_files.md.

A format is a module with a function that makes `Views` of a file through a `Border`, where its
axes, direction, pixel centre and unit become ours. Formats are recognised by content, and by name
where the content says nothing. Nothing is guessed: a file that leaves a convention open is refused
with the option that answers.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from rastercov.base import (
    CameraError,
    ConfigError,
    PoseError,
    RastercovError,
    ReadByName,
    ResourceError,
    StrPath,
    check_choice,
    flag,
    json_bytes,
    plural,
    printable,
    shorten,
    shown,
    write_bytes,
)
from rastercov.base.files import PROJECTS, reason_of
from rastercov.core.camera import Border, Conventions, Views
from rastercov.core.camera.conventions import POSE_CONVENTIONS, read_poses, what_is_lost
from rastercov.core.camera.rig import check_central
from rastercov.formats.cameras import (
    alicevision,
    azure,
    basalt,
    bop,
    bundler,
    camodocal,
    colmap,
    euroc,
    foreign,
    gltf,
    kalibr,
    kitti,
    llff,
    metashape,
    odm,
    okvis,
    open3d,
    opencv,
    openmvg,
    opensfm,
    orbslam,
    own,
    pix4d,
    realsense,
    ros,
    transforms,
    tum,
    zivid,
)
from rastercov.formats.cameras.source import Source, keys_of

__all__ = ["POSE_CONVENTIONS", "READERS", "WRITERS", "Conventions", "read_views", "write_views"]

Reader = Callable[[Source, Border], Views]


def _own(source: Source, border: Border) -> Views:
    suffix = source.path.suffix.lower()
    if suffix == ".npy" or (suffix == ".json" and isinstance(source.json, list)):
        return own.of_matrices(read_poses(source.path), border)
    content = source.toml if suffix == ".toml" else source.table
    if isinstance(content, Mapping) and "file" in content:
        return read_with_optics(source.path.parent, content, border)
    if isinstance(content, list):  # bare matrices, as a script writes them
        content = {"world_from_camera": content}
    return own.read(content, border)


def read_with_optics(folder: Path, content: ReadByName, border: Border) -> Views:
    """Views of the file that entries name, whose camera has the optics beside it."""
    file, others = content["file"], {k: v for k, v in content.items() if k != "file"}
    if not isinstance(file, str) or Path(file).suffix.lower() == ".toml":
        raise CameraError(
            f"expected file to name a file of another program, got {shown(file)}; correct it"
        )
    views = read_through(folder / file, border)
    cameras = tuple(camera.with_optics(others) for camera in views.cameras())
    assert views.rig is not None
    return replace(views, rig=views.rig._with(cameras=cameras))


def _mvsnet_files(folder: Path) -> list[Path]:
    return bundler.mvsnet_files(folder) or bundler.mvsnet_files(folder / "cams")


def _mvsnet(source: Source, border: Border) -> Views:
    files = _mvsnet_files(source.path) if source.path.is_dir() else [source.path]
    if not files:
        raise CameraError(
            f"expected files {bundler.PATTERN}, got a folder without any; name another folder"
        )
    return bundler.read_mvsnet([Source(path) for path in files], border)


MODULES: ReadByName = {
    "colmap": colmap,
    "nerfstudio": transforms,
    "opencv": opencv,
    "ros": ros,
    "kalibr": kalibr,
    "euroc": euroc,
    "camodocal": camodocal,
    "orbslam": orbslam,
    "basalt": basalt,
    "open3d": open3d,
    "azure": azure,
    "realsense": realsense,
    "zivid": zivid,
    "bop": bop,
    "llff": llff,
    "pix4d": pix4d,
    "tum": tum,
    "kitti": kitti,
    "okvis": okvis,
    "metashape": metashape,
    "opensfm": opensfm,
    "odm": odm,
    "openmvg": openmvg,
    "alicevision": alicevision,
}
"""Modules of one format each, with a function `read`."""
READERS: Mapping[str, Reader] = {
    "rastercov": _own,
    **{name: module.read for name, module in MODULES.items()},
    "bundler": bundler.read_bundler,
    "bal": bundler.read_bal,
    "gltf": gltf.read,
    "mvsnet": _mvsnet,
}
"""Readers by the name of the format."""
OF_LINES = "bundler", "bal", "kitti", "pix4d", "tum"
"""Formats of lines of numbers, whose last one may be cut."""
TABLES = (
    *("nerfstudio", "opensfm", "odm", "openmvg", "alicevision", "gltf", "kalibr", "euroc"),
    *("camodocal", "orbslam", "okvis", "basalt", "open3d", "azure", "realsense", "zivid", "bop"),
    *("ros", "opencv", "rastercov"),
)
"""Formats of JSON and YAML, each recognised by `is_mine`, in this order."""
WRITERS = ("rastercov", "colmap", "colmap-text", "nerfstudio", "opencv", "ros", "gltf")
"""Formats that are written."""
BY_SUFFIX = dict.fromkeys((".json", ".npy", ".toml"), "rastercov") | {
    ".glb": "gltf",
    ".yaml": "opencv",
    ".yml": "opencv",
}
"""Formats of files to be written by the ends of their names."""
LONGEST_FAULT = 500
"""Characters of an error, which may have names of the file in it."""
IN_METRES = ("rastercov", "gltf")
"""Formats whose lengths are metres; the others have no unit."""
OF_ONE_CAMERA = ("opencv", "ros")
"""Formats that hold one camera and no pose."""
PARTS_OF_COLMAP = ("images", "rigs", "frames", "points3D")
"""Files of a model beside its cameras; the whole model is read where one is named."""
IN_FOLDERS = {
    "transforms.json": "nerfstudio",
    "reconstruction.json": "opensfm",
    llff.NAME: "llff",
}
"""Files by which a folder of a project is recognised."""


def read_views(
    path: StrPath, *, format: str | None = None, conventions: Conventions | None = None
) -> Views:
    """Cameras and poses of a file of this or another program.

    Parameters
    ----------
    path : str or Path
        A file, or the folder of a COLMAP model, of a Nerfstudio, OpenSfM or LLFF project, or of
        MVSNet cameras.
    format : str, optional
        A name of docs/camera_files.md; detected from the content unless given.
    conventions : Conventions, optional
        Conventions that the file does not state.

    Returns
    -------
    Views
        In conventions of rastercov: axes x right, y down, z forward, world_from_camera, centre of
        the top-left pixel at (0.5, 0.5), metres if the unit is known (`has_unit`).

    Raises
    ------
    CameraError, PoseError
        For an unreadable file, and for one that leaves open a convention that `conventions` does
        not give.
    ConfigError
        For a format that does not exist.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), distance=1, count=2))
    >>> views = rc.Views(rc.Rig([camera], ["cam"]), poses, images=("a.jpg", "b.jpg"))
    >>> _ = rc.write_views("rig.json", views)
    >>> views = rc.read_views("rig.json")
    >>> views.rig.names, len(views.poses)
    (('cam',), 2)
    """
    border = Border(Conventions() if conventions is None else conventions)
    views = read_through(path, border, format)
    return replace(views, notes=(*views.notes, *border.unused_keys()))


def read_through(path: StrPath, border: Border, format: str | None = None) -> Views:
    """Views of a file as `read_views` reads it, with answers that other files may share."""
    place = _path(path)
    if format is not None:
        check_choice("format", format, tuple(READERS))
    # What overflows is not finite, and is refused by a line of its own, not by numpy's warning.
    with _naming(path, CameraError), np.errstate(all="ignore"):
        place, result = _recognise(place, format)
        source = Source(place)
        if result in OF_LINES and not source.data.endswith(b"\n"):
            border.note("it ends within a line: its last number may be cut, and lines missing")
        return READERS[result](source, border)


@contextmanager
def _naming(path: StrPath, kind: type[RastercovError]) -> Iterator[None]:
    """Let errors name a file, once; those of the system become of that kind."""
    name = printable(str(path))
    try:
        yield
    except RastercovError as error:
        text = shorten(str(error).removeprefix(f"{name}: "), LONGEST_FAULT)
        text = f"{name}: {text}"
        if isinstance(error, PoseError):
            raise PoseError(text, error.pose_ids) from None
        raise type(error)(text) from None
    except MemoryError:
        raise ResourceError(
            f"{name}: expected views that fit in memory, got more; split the file"
        ) from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
        raise kind(f"{name}: {reason_of(error)}") from None


def _path(path: StrPath) -> Path:
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise CameraError(f"expected a path, got {type(path).__name__}; pass a str or a Path")
    return Path(path)


def _recognise(path: Path, format: str | None) -> tuple[Path, str]:
    """The file or folder to read, and its format."""
    if path.is_dir():
        return _of_folder(path, format)
    stem, suffix = path.stem, path.suffix.lower()
    if suffix in (".bin", ".txt") and stem in PARTS_OF_COLMAP and format in (None, "colmap"):
        return path.parent, "colmap"
    if format is not None:
        return path, format
    if suffix in PROJECTS:
        raise CameraError(
            f"expected cameras, got a project of {PROJECTS[suffix]}; export cameras as COLMAP, "
            "Bundler or XML"
        )
    if path.name == llff.NAME:
        return path, "llff"
    if suffix in (".npy", ".toml", ".glb", ".gltf"):
        return path, "gltf" if suffix.startswith(".gl") else "rastercov"
    if stem == "cameras" and suffix in (".bin", ".txt"):
        return path, "colmap"
    return path, _of_content(Source(path))


def _of_folder(path: Path, format: str | None) -> tuple[Path, str]:
    if format in (None, "colmap") and colmap.model_folder(path) is not None:
        return path, "colmap"
    for name, its in IN_FOLDERS.items():
        if format in (None, its) and (path / name).is_file():
            return path / name, its
    if format is None and not _mvsnet_files(path):
        raise CameraError(
            f"expected a COLMAP model, {', '.join(IN_FOLDERS)}, or {bundler.PATTERN} of MVSNet, "
            "got a folder without any; name the file itself"
        )
    return path, format or "mvsnet"


def _of_content(source: Source) -> str:
    start = source.data[:4000].removeprefix(b"\xef\xbb\xbf").lstrip()
    suffix = source.path.suffix.lower()
    if source.is_xml:
        if metashape.is_mine(source.xml):
            return "metashape"
        foreign.refuse(source.data)
        return "opencv"
    if source.is_json or suffix in (".yaml", ".yml") or start.startswith((b"%YAML", b"---")):
        return _of_table(source)
    if start.startswith(bundler.HEADER.encode()):
        return "bundler"
    for name, is_mine in (
        ("ros", ros.is_ini),
        ("mvsnet", bundler.is_mvsnet),
        ("bal", bundler.is_bal),
        ("pix4d", pix4d.is_mine),
        ("realsense", realsense.is_mine),
        ("tum", tum.is_mine),
        ("kitti", kitti.is_mine),
    ):
        if is_mine(source.text):
            return name
    foreign.refuse(source.data)
    raise CameraError(
        f"expected a camera or pose file in one of {len(READERS)} formats, got another file; to "
        "name its format, use rastercov convert --from FORMAT"
    )


def _of_table(source: Source) -> str:
    content = source.table
    modules = {**MODULES, "gltf": gltf, "rastercov": own}
    for name in TABLES:
        if modules[name].is_mine(content):
            return name
    foreign.refuse(source.data)
    if "imu0" in keys_of(content):
        raise CameraError("expected cameras, got IMUs of Kalibr; name the camchain beside it")
    # Plain lists of numbers, as a script may have left them; else a camera with a slip in it.
    has_lists = isinstance(content, dict) and any(isinstance(v, list) for v in content.values())
    return "opencv" if has_lists or not source.is_json else "rastercov"


def format_of(path: StrPath) -> str:
    """Format that a file to be written has by its name; ConfigError where the name says nothing."""
    place = Path(path)
    suffix = place.suffix.lower()
    if suffix == ".json" and place.stem.startswith("transforms"):
        return "nerfstudio"
    if not suffix or place.is_dir():
        return "colmap"
    if suffix in BY_SUFFIX:
        return BY_SUFFIX[suffix]
    raise ConfigError(
        f"{printable(str(path))}: expected a name that ends in .json, .toml, .npy, .glb or .yaml, "
        f"or a folder, got {shown(suffix)}; name the format (format=, --to)"
    )


def write_views(
    path: StrPath, views: Views, *, format: str | None = None, overwrite: bool = False
) -> list[str]:
    """Write cameras and poses in the format of rastercov or another program.

    Parameters
    ----------
    path : str or Path
        File to write, or the folder of a COLMAP model.
    views : Views
        What to write.
    format : str, optional
        A name of docs/camera_files.md; from the file name unless given.
    overwrite : bool
        Replace existing files.

    Returns
    -------
    list of str
        What the format cannot represent, one line each.

    Raises
    ------
    CameraError
        For a lens model that the format lacks, and several cameras in a format for a single one.
    ConfigError
        For an existing file unless `overwrite` is true, poses without a unit for a format in
        metres, and a format that does not exist.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), distance=1, count=3))
    >>> views = rc.Views(rc.Rig([camera], ["cam"]), poses, images=("a.jpg", "b.jpg", "c.jpg"))
    >>> rc.write_views("model", views, format="colmap")  # what COLMAP cannot hold, in words
    ['lengths are in metres; the format has no unit']
    """
    place = _path(path)
    overwrite = flag("overwrite", overwrite)
    if place.suffix and place.is_symlink() and place.is_dir():
        raise ConfigError(
            f"{path}: expected a file, got a symbolic link to a folder; delete the link"
        )
    target = format_of(place) if format is None else format
    check_choice("format", target, tuple(WRITERS))
    if target in IN_METRES and not views.has_unit:
        raise ConfigError(
            f"expected poses with a unit, to write {shown(str(path))} in metres, got poses without "
            "one; give --pose-unit"
        )
    with _naming(path, ConfigError):
        contents, notes = _contents(place, views, target)
        if "" not in contents:
            colmap.write(place, contents, overwrite=overwrite)
        elif place.exists() and not overwrite:
            raise ConfigError(
                "expected a new file, got an existing one; give another name, or overwrite"
            )
        else:
            write_bytes(place, contents[""])
    rig, has_all = views.rig, target == "rastercov" and place.suffix.lower() == ".json"
    if rig is not None and not has_all and (rig.gates or rig.tasks or rig.equipment):
        notes.append("the rule of the rig, thresholds of its cameras and equipment are left out")
    return notes


def _contents(path: Path, views: Views, target: str) -> tuple[dict[str, bytes], list[str]]:
    """Bytes of each file by its name, "" for the only one, and what is lost."""
    notes: list[str] = []
    if target == "rastercov":
        return {"": own.bytes_of(views, path.suffix.lower(), notes)}, notes
    if views.rig is None:
        raise CameraError(
            "expected cameras to write, got only poses; write a rastercov .json, or read a file "
            "with both"
        )
    if target != "gltf":
        check_central(views.rig, f"format {target}")
    n_poses = len(views.poses)
    if target in OF_ONE_CAMERA and n_poses:
        notes.append(f"written without {plural(n_poses, 'pose')}; the format has none")
    if views.frames and target in ("nerfstudio", "gltf"):
        notes.append("frames are left out: the sets of images taken at the same instant")
    if views.has_unit and n_poses and target not in IN_METRES + OF_ONE_CAMERA:
        notes.append("lengths are in metres; the format has no unit")
    for camera, name in zip(views.rig.cameras, views.rig.names, strict=True):
        fields = what_is_lost(camera) + (gltf.what_is_lost(camera) if target == "gltf" else [])
        if fields:
            notes.append(f"written without the {', '.join(fields)} of {name!r}")
    if target.startswith("colmap"):
        return colmap.contents_of(views, as_text=target == "colmap-text", notes=notes), notes
    contents = {
        "opencv": lambda: opencv.text_of(views).encode(),
        "ros": lambda: ros.text_of(views).encode(),
        "gltf": lambda: gltf.glb_of(views),
        "nerfstudio": lambda: json_bytes(transforms.content_of(views), indent=1) + b"\n",
    }
    return {"": contents[target]()}, notes
