"""COLMAP models: a folder with cameras and images, as text or binary; rigs and frames since 3.12.

Poses are camera_from_world, quaternions scalar first; axes and pixels are ours; there is no unit.
An image has its own pose in every version, so that rigs are read for the places of cameras only,
and frames for the images that were taken at the same instant.

A model that is written has rigs and frames where the views have frames; else COLMAP makes a rig of
each camera. The images of a frame were taken by cameras of one rig, and COLMAP takes their poses
from the frame: rig_from_world, and sensor_from_rig of each camera. The first camera of a rig is its
reference, at the rig's origin.

Source: COLMAP documentation, "Output Format"; src/colmap/scene/reconstruction_io.cc.
"""

import math
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np

from rastercov.base import (
    CameraError,
    ConfigError,
    FloatArray,
    PoseError,
    UnreadableError,
    errors_as,
    image_side,
    matmul,
    printable,
    remove_folder,
    shown,
)
from rastercov.base.files import open_file
from rastercov.base.output import name_folder, remove_file, writing
from rastercov.core.camera import (
    PROGRAMS,
    Border,
    Camera,
    Views,
    inverse_of,
    lens_camera,
    model_in,
    share_frames,
)
from rastercov.core.camera.conventions import from_quaternions, unique_names
from rastercov.core.mesh.arrays import inverse
from rastercov.formats.cameras.source import Source, number_of

T = TypeVar("T")
Record = tuple[str, Sequence[Any]]
"""Form of a record in `struct`, and its values."""

LARGEST_FILE = 1 << 36
"""Bytes of a file; points of images, the bulk of it, are passed over."""
LONGEST_LINE = 1 << 28
"""Bytes of a line of points."""
LONGEST_NAME = 4096
PROMISE = re.compile(r"#\s*number of (\w+)\s*[:=]\s*([0-9]{1,15})\b", re.IGNORECASE)
"""Line by which COLMAP begins a text: # Number of images: 12, mean observations ..."""
MODELS = tuple(PROGRAMS["colmap"])
"""Names of the models by their ids."""
OURS = {name: each.ours for name, each in PROGRAMS["colmap"].items()}
ORDERS = {name: each.parameters for name, each in PROGRAMS["colmap"].items()}
"""Names of the parameters of each model, in order."""
SENSORS = ("CAMERA", "IMU")
SUBFOLDERS = ("sparse/0", "sparse", "0")
"""Folders of a project that COLMAP's pipelines put a model in."""
HEADS = {
    "cameras": "# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: {}",
    "images": "# Image list: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; POINTS2D\n"
    "# Number of images: {}",
    "points3D": "# 3D point list: none",
    "rigs": "# Rigs: RIG_ID, NUM_SENSORS, REF_SENSOR, SENSORS[]: TYPE, ID, HAS_POSE, Q, T",
    "frames": "# Frames: FRAME_ID, RIG_ID, RIG_FROM_WORLD Q, T, NUM_DATA_IDS, TYPE, ID, DATA_ID",
}
"""Files of a model, and how each begins as text."""
PLACE_TOLERANCE = 1e-9
"""Difference of two poses of a rig by two of its cameras: of rotations, and of positions relative
to their extent. At it a point moves by less than 1e-5 px."""


class Image(NamedTuple):
    """An image: camera_from_world as a quaternion and a translation, camera, file name."""

    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera_id: int
    name: str
    image_id: int = 0


def model_folder(path: Path) -> Path | None:
    """The folder of a model: `path` itself, or the usual one below it; None without a model."""
    for folder in (path, *(path / name for name in SUBFOLDERS)):
        if any((folder / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt")):
            return folder
    return None


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of a folder; cameras alone of a file `cameras.bin` or `cameras.txt`."""
    path = source.path
    if path.is_file():
        cameras, row_of = _order_cameras(_one_file(path, "cameras", border))
        return border.views(cameras, _names(row_of))
    path.stat()  # OSError where there is none
    folder = model_folder(path)
    if folder is None:
        raise CameraError(
            "expected a COLMAP model, got a folder without cameras.bin or cameras.txt; name "
            "another one"
        )
    suffix = ".bin" if (folder / "cameras.bin").is_file() else ".txt"

    def part(name: str) -> Any:
        there = (folder / f"{name}{suffix}").is_file()
        return _one_file(folder / f"{name}{suffix}", name, border) if there else None

    cameras, row_of = _order_cameras(part("cameras"))
    images: list[Image] | None = part("images")
    if images is None:
        images = []
        border.note(f"no images{suffix}: read only cameras")
    for image in images:
        if image.camera_id not in row_of:
            raise CameraError(
                f"expected a camera of cameras{suffix} for image {shown(image.name)}, got "
                f"{image.camera_id}; export the model again"
            )
    places = _places(part("rigs") or [], row_of, border)
    frames = part("frames") or []
    frame_of = {image: f"frame {number}" for number, of_it in frames for image in of_it}
    numbers = [image.image_id for image in images]
    motions = from_quaternions([i.quaternion for i in images], [i.translation for i in images])
    return border.views(
        cameras,
        _names(row_of),
        world_from_camera=inverse_of(motions),
        camera=[row_of[image.camera_id] for image in images],
        images=[image.name for image in images],
        frames=share_frames([*map(frame_of.get, numbers)], numbers),
        rig_from_camera=places,
    )


def _names(ids: Iterable[int]) -> list[str]:
    return [f"camera {number}" for number in ids]


def _order_cameras(table: dict[int, Camera]) -> tuple[list[Camera], dict[int, int]]:
    """Cameras by id, and the row of each id."""
    if not table:
        raise CameraError("expected a COLMAP model, got one without cameras; export it again")
    ids = sorted(table)
    return [table[number] for number in ids], {number: row for row, number in enumerate(ids)}


def _one_file(path: Path, part: str, border: Border) -> Any:
    """Content of a file with a part of a model; errors name the file."""
    name, (what, least_bytes, parse) = printable(path.name), RECORDS[part]
    kinds = UnreadableError, CameraError, PoseError
    with errors_as(CameraError, name, kinds), open_file(path, LARGEST_FILE) as file:
        if path.suffix == ".bin":
            n_records = _count(file, part, least_bytes)
            return parse(_Bytes(file, what) for _ in range(n_records))
        promised: dict[str, int] = {}
        lines = _lines(file, promised)
        content = parse(_Words(*line, lines) for line in lines if line[1])
        for kind, number in promised.items():
            if number > len(content):
                raise CameraError(
                    f"expected {number} {kind}, as the header says, got {len(content)}; the file "
                    "is truncated, export it again"
                )
            if number < len(content):
                border.note(f"{name}: the header declares {number} {kind}; read all {len(content)}")
        return content


def parameters_of(model: str, parameters: Sequence[float]) -> dict[str, float]:
    """Parameters of a model of COLMAP by name; CameraError for another number than it has."""
    names = ORDERS[model].split(" ")
    if len(names) != len(parameters):
        raise CameraError(
            f"expected {len(names)} parameters ({ORDERS[model]}) for {model}, got "
            f"{len(parameters)}; export it again"
        )
    if OURS[model] == "equirectangular":
        w, h = parameters
        return {"fx": w / (2 * math.pi), "fy": h / math.pi, "cx": w / 2, "cy": h / 2}
    return {name: parameters[row] for row, name in enumerate(names)}


def camera_of(model: str, width: int, height: int, parameters: Sequence[float]) -> Camera:
    """Camera of a model of COLMAP; CameraError for another number of parameters than it has."""
    return lens_camera(OURS[model], (width, height), parameters_of(model, parameters))


# Records of both forms.


class _Words:
    """Values of a line of text, taken one after the other."""

    def __init__(self, number: int, text: str, following: Iterator[tuple[int, str]]) -> None:
        self._where, self._words, self._at = f"line {number}", text.split(), 0
        self._number, self._text, self._following = number, text, following

    def word(self, what: str, words: Sequence[str] = ()) -> str:
        if self._at >= len(self._words):
            raise CameraError(
                f"{self._where}: expected {what}, got the end of the line; the file is truncated"
            )
        self._at += 1
        return self._words[self._at - 1]

    def whole(self, what: str, form: str = "") -> int:
        word = self.word(what)
        # The longest: -2^63 and 2^64 - 1.
        if not _is_whole(word) or len(word) > 20:
            raise CameraError(
                f"{self._where}: expected {what} to be a whole number, got {shown(word)}; export "
                "it again"
            )
        return int(word)

    def reals(self, what: str, count: int, *, is_last: bool = False) -> tuple[float, ...]:
        count = len(self._words) - self._at if is_last else count
        numbers = [number_of(self.word(what)) for _ in range(count)]
        for value in numbers:
            if isinstance(value, str):
                raise CameraError(
                    f"{self._where}: expected {what} to be a number, got {shown(value)}; export it "
                    "again"
                )
        return tuple(map(float, numbers))

    def name(self) -> str:
        """The rest of the line, which may have spaces."""
        return "".join(self._text.split(maxsplit=self._at)[self._at :])

    def pass_points(self, name: str) -> None:
        """Pass the next line, of the points of an image."""
        after, points = next(self._following, (self._number + 1, ""))
        split = points.split()
        # The ids of the first points and of the last: a line of an image may look like points.
        if len(split) % 3 or not all(_is_whole(word) for word in (*split[2:9:3], *split[-1:])):
            raise CameraError(
                f"line {after}: expected the points of image {shown(name)}, got {shown(points)}; "
                "leave an empty line where an image has none"
            )


class _Bytes:
    """Values of a record of a binary file, taken one after the other; `record` is its name."""

    def __init__(self, file: BinaryIO, record: str) -> None:
        self._file, self._record = file, record

    def whole(self, what: str, form: str = "I") -> int:
        (unpack,) = _unpack(self._file, form, self._record)
        return int(unpack)

    def reals(self, what: str, count: int, *, is_last: bool = False) -> tuple[float, ...]:
        return _unpack(self._file, f"{count}d", self._record)

    def word(self, what: str, words: Sequence[str]) -> str:
        number = self.whole(what, "i")
        return words[number] if 0 <= number < len(words) else f"number {number}"

    def name(self) -> str:
        start = self._file.tell()
        data, end, _ = self._file.read(LONGEST_NAME).partition(b"\0")
        if not end:
            raise CameraError(
                "expected an image name of at most 1000 bytes, got no end; the file is damaged, "
                "export it again"
            )
        self._file.seek(start + len(data) + 1)
        return data.decode("utf-8", errors="replace")

    def pass_points(self, name: str) -> None:
        n_points = _count(self._file, f"points of image {shown(name)}", 24)
        self._file.seek(24 * n_points, 1)


Fields = Iterable[_Words | _Bytes]
Rigs = list[dict[int, tuple[float, ...] | None]]
"""For each rig, sensor_from_rig of its cameras: a quaternion and a translation; None if unknown,
and () for the reference."""


def read_cameras(records: Fields, make: Callable[..., T]) -> dict[int, T]:
    """Cameras by their ids, each made of its model, sides and parameters.

    The page has this function, and the next one, in JavaScript, with records of its own: see
    `report/script.py`.
    """
    table: dict[int, T] = {}
    for values in records:
        number, model = values.whole("the camera's id"), values.word("the model", MODELS)
        if model not in MODELS:
            raise CameraError(
                f"expected the model to be one of {', '.join(MODELS)}, got {shown(model)}"
            )
        width, height = values.whole("the width", "Q"), values.whole("the height", "Q")
        count = len(ORDERS[model].split(" "))
        parameters = values.reals("a parameter", count, is_last=True)
        if number in table:
            raise CameraError(f"expected each camera once, got {number} twice; remove one")
        with errors_as(CameraError, f"camera {number}"):
            size = image_side("width", width), image_side("height", height)
            table[number] = make(model, size[0], size[1], parameters)
    return table


def read_images(records: Fields) -> list[Image]:
    """Images in their order."""
    images: list[Image] = []
    known: dict[int, bool] = {}
    for values in records:
        number = values.whole("the image's id")
        motion = values.reals("the quaternion", 4), values.reals("the translation", 3)
        camera_id, name = values.whole("the camera's id"), values.name()
        values.pass_points(name)
        if number in known:
            raise CameraError(f"expected each image once, got {number} twice; remove one")
        known[number] = True
        images.append(Image(motion[0], motion[1], camera_id, name, number))
    return images


def _rigs(records: Fields) -> Rigs:
    rigs: Rigs = []
    for values in records:
        rig: dict[int, tuple[float, ...] | None] = {}
        values.whole("the rig's id")
        for row in range(values.whole("the number of sensors")):
            kind, sensor = values.word("a sensor", SENSORS), values.whole("the sensor's id")
            place: tuple[float, ...] | None = ()
            if row:
                has_pose = values.whole("HAS_POSE", "B")
                place = values.reals("sensor_from_rig", 7) if has_pose else None
            if kind == "CAMERA":
                rig[sensor] = place
        rigs.append(rig)
    return rigs


def _frames(records: Fields) -> list[tuple[int, list[int]]]:
    """Number of each frame, and the ids of its images."""
    frames: list[tuple[int, list[int]]] = []
    for values in records:
        frames.append((values.whole("the frame's id"), []))
        values.whole("the rig's id")
        values.reals("rig_from_world", 7)
        for _ in range(values.whole("the number of images")):
            kind, _ = values.word("a sensor", SENSORS), values.whole("an id")
            image = values.whole("an id", "Q")
            if kind == "CAMERA":
                frames[-1][1].append(image)
    return frames


RECORDS: dict[str, tuple[str, int, Any]] = {
    "cameras": ("a camera", 24, lambda records: read_cameras(records, camera_of)),
    "images": ("an image", 73, read_images),
    "rigs": ("a rig", 8, _rigs),
    "frames": ("a frame", 68, _frames),
}
"""Name of a record of each part, its least bytes, and what is made of the records."""


# Text.


def _lines(file: BinaryIO, promised: dict[str, int]) -> Iterator[tuple[int, str]]:
    """Number and text of each line that is no comment; empty ones as well, which may be points.

    The number that comments at the start promise is added to `promised`, by its word.
    """
    has_begun = False
    for number in count(1):
        if not (raw := file.readline(LONGEST_LINE)):
            return
        if len(raw) == LONGEST_LINE:
            raise CameraError(
                f"expected lines of at most {LONGEST_LINE} bytes, got a longer one in line "
                f"{number}; correct the file"
            )
        if number == 1 and raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise CameraError("expected text in UTF-8, got UTF-16; save it as UTF-8")
        text = raw.decode("utf-8-sig" if number == 1 else "utf-8", errors="replace").strip()
        if not text.startswith("#"):
            has_begun = has_begun or bool(text)
            yield number, text
        elif not has_begun and not promised and (match := PROMISE.match(text)):
            promised[match[1]] = int(match[2])


def _is_whole(word: str) -> bool:
    return word.removeprefix("-").isdecimal()


# Binary, little-endian.


def _unpack(file: BinaryIO, form: str, what: str) -> tuple[Any, ...]:
    size = struct.calcsize("<" + form)
    data = file.read(size)
    if len(data) != size:
        raise CameraError(
            f"expected {what}, got the end of the file; it is truncated, export it again"
        )
    return struct.unpack("<" + form, data)


def _count(file: BinaryIO, what: str, least_bytes: int) -> int:
    """A count that the rest of the file has room for, each of `least_bytes` or more."""
    (promised,) = _unpack(file, "Q", f"the number of {what}")
    at = file.tell()
    left = file.seek(0, 2) - at
    file.seek(at)
    if promised * least_bytes > left:
        raise CameraError(
            f"expected {promised} {what}, as declared, got space for {left // least_bytes}; the "
            "file is truncated, export it again"
        )
    return int(promised)


def _places(rigs: Rigs, row_of: dict[int, int], border: Border) -> Any:
    """(N, 4, 4) rig_from_camera, or None where no rig has two cameras."""
    if all(len(rig) < 2 for rig in rigs):
        return None
    places = np.tile(np.eye(4), (len(row_of), 1, 1))
    without: list[int] = []
    for rig in rigs:
        for camera_id, place in rig.items():
            if camera_id not in row_of:
                raise CameraError(
                    f"expected rigs of known cameras, got camera {camera_id}; export the model "
                    "again"
                )
            if place is None:
                without.append(camera_id)
            elif place:
                motion = from_quaternions([place[:4]], [place[4:]])
                places[row_of[camera_id]] = inverse_of(motion)[0]
    if without:
        more = f" (and {len(without) - 1} others)" if len(without) > 1 else ""
        border.note(f"camera {without[0]}{more} has no pose on its rig; used the rig's origin")
    if len(rigs) > 1:
        border.note(f"camera poses are relative to {len(rigs)} rigs, each with its own origin")
    return places


# Written.


class Word(NamedTuple):
    """A value that is another one in binary than in text."""

    code: Any
    text: str


CAMERA = Word(0, "CAMERA")


def _rigs_and_frames(views: Views, notes: list[str]) -> dict[str, list[Record]]:
    """Records of the rigs and frames of these views; none where they do not fit together.

    Cameras that share a frame are on one rig, whose reference is its first camera.
    """
    assert views.rig is not None
    index = views.poses.camera
    rows_of: dict[str, list[int]] = {}
    for row, frame in enumerate(views.frames):
        rows_of.setdefault(frame, []).append(row)
    if any(len(set(index[rows].tolist())) < len(rows) for rows in rows_of.values()):
        notes.append("frames are left out: one of them has two images of a camera")
        return {}
    first = np.arange(len(views.rig))
    for rows in rows_of.values():
        joined = first[index[rows]]
        first[np.isin(first, joined)] = joined.min()
    places = views.rig.rig_from_camera
    sensor_from_rig = matmul(inverse(places), places[first])
    world_from_rig = matmul(views.poses.world_from_camera, sensor_from_rig[index])
    centres = views.poses.eyes
    tolerance = np.full((4, 4), PLACE_TOLERANCE)
    tolerance[:3, 3] *= max(1e-30, np.ptp(centres, axis=0).max(), np.abs(places[:, :3, 3]).max())
    for rows in rows_of.values():
        if (np.abs(world_from_rig[rows] - world_from_rig[rows[0]]) > tolerance).any():
            notes.append(
                "frames are left out: their images do not agree with the poses of the cameras on "
                "the rig; each image keeps its own pose"
            )
            return {}
    motions = _motions(sensor_from_rig)
    heads, rig_of = np.unique(first, return_inverse=True)
    rigs: list[Record] = []
    for number, head in enumerate(heads.tolist(), 1):
        others = [row for row in np.flatnonzero(first == head).tolist() if row != head]
        values = [number, 1 + len(others), CAMERA, head + 1]
        for row in others:
            values += [CAMERA, row + 1, 1, *motions[row]]
        rigs.append((f"IIiI{'iIB7d' * len(others)}", values))
    motions, frames = _motions(inverse(world_from_rig)), list[Record]()
    for number, rows in enumerate(rows_of.values(), 1):
        values = [number, int(rig_of[index[rows[0]]]) + 1, *motions[rows[0]], len(rows)]
        for row in rows:
            values += [CAMERA, int(index[row]) + 1, row + 1]
        frames.append((f"II7dI{'iIQ' * len(rows)}", values))
    return {"rigs": rigs, "frames": frames}


def contents_of(views: Views, *, as_text: bool, notes: list[str]) -> dict[str, bytes]:
    """Bytes of each file of a model, by name; what is lost is added to `notes`."""
    rig = views.rig
    assert rig is not None
    cameras: list[Record] = []
    for number, (camera, label) in enumerate(zip(rig.cameras, rig.names, strict=True)):
        name, p = model_in("colmap", camera, label)
        model = Word(MODELS.index(name), name)
        values = [number + 1, model, camera.width, camera.height, *p.values()]
        cameras.append((f"IiQQ{len(p)}d", values))
    names = unique_names([printable(name).replace("\0", "") for name in views.images], "image")
    if names != list(views.images):
        notes.append("duplicate image names were renamed")
    index = views.poses.camera.tolist()
    images: list[Record] = []
    motions = _motions(inverse(views.poses.world_from_camera))
    for number, (motion, name) in enumerate(zip(motions, names, strict=True)):
        # A zero byte ends the name, and a count of points follows; in text, a line of them.
        end = Word(name.encode() + bytes(9), f"{name}\n")
        values = [number + 1, *motion, index[number] + 1, end]
        images.append((f"I7dI{len(end.code)}s", values))
    parts: dict[str, list[Record]] = {"cameras": cameras, "images": images, "points3D": []}
    if views.frames:
        parts |= _rigs_and_frames(views, notes)
    if (
        "rigs" not in parts
        and len(set(index)) > 1
        and (rig.rig_from_camera[1:] != rig.rig_from_camera[:1]).any()
    ):
        notes.append("places of cameras on the rig are left out: each image has its own pose")
    if as_text and any(" " in name for name in names):
        notes.append(
            "COLMAP cuts names of images at spaces in a text model; write the binary one instead"
        )
    suffix, write = ("txt", _as_text) if as_text else ("bin", _as_binary)
    return {f"{part}.{suffix}": write(part, records) for part, records in parts.items()}


def _as_text(part: str, records: Sequence[Record]) -> bytes:
    lines = [
        " ".join(value.text if isinstance(value, Word) else repr(value) for value in values)
        for _, values in records
    ]
    return "\n".join([HEADS[part].format(len(records)), *lines, ""]).encode()


def _as_binary(part: str, records: Sequence[Record]) -> bytes:
    packed = [
        struct.pack(f"<{form}", *(v.code if isinstance(v, Word) else v for v in values))
        for form, values in records
    ]
    return b"".join([struct.pack("<Q", len(records)), *packed])


def _motions(matrices: FloatArray) -> list[list[float]]:
    """Quaternion, scalar first, and translation of motions."""
    from trimesh.transformations import quaternion_from_matrix  # takes 0.3 s

    return [
        [*quaternion_from_matrix(matrix, isprecise=True).tolist(), *matrix[:3, 3].tolist()]
        for matrix in matrices  # 20 us each
    ]


def write(folder: Path, contents: Mapping[str, bytes], *, overwrite: bool) -> None:
    """Write the files of a model; a model that is there is replaced as a whole, if at all."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError("expected a folder for the COLMAP model, got a file; give another name")
    others = [folder / f"{name}.{end}" for name in HEADS for end in ("bin", "txt")]
    there = [path for path in others if path.exists()]
    if there and not overwrite:
        raise ConfigError(
            f"expected a new model, got an existing {there[0].name}; give another folder, or "
            "overwrite"
        )
    is_new = not folder.exists()
    name_folder(folder, parents=False)
    try:
        with ExitStack() as stack:  # all are written before any takes its place
            for name, data in contents.items():
                part = stack.enter_context(writing(folder / name))
                part.write_bytes(data)
    except BaseException:
        if is_new and not any(folder.iterdir()):
            remove_folder(folder)
        raise
    for path in there:
        if path.name not in contents:
            remove_file(path)  # of the model that was replaced: the new one has no such part
