"""COLMAP models: a folder with cameras and images, as text or binary; rigs and frames since 3.12.

Poses are camera_from_world, quaternions scalar first; axes and pixels are ours; there is no unit.
An image has its own pose in every version, so that rigs are read for the places of cameras only,
and frames for the images that were taken at the same instant.

Source: COLMAP documentation, "Output Format"; src/colmap/scene/reconstruction_io.cc.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from rastercov.base.checks import image_side, shown
from rastercov.base.errors import CameraError, PoseError
from rastercov.base.files import StrPath, UnreadableError, open_file, printable
from rastercov.camera.camera import Camera
from rastercov.camera.formats.colmap_models import BY_ID, IDS, ColmapModel, camera_of
from rastercov.camera.formats.conventions import Border, inverse_of
from rastercov.camera.formats.rotations import from_quaternions
from rastercov.camera.views import Views

LARGEST_FILE = 1 << 36
"""Bytes of a file; points of images, the bulk of it, are passed over."""
LONGEST_LINE = 1 << 28
"""Bytes of a line of points."""
LONGEST_NAME = 4096
LONGEST_COMMENT = 1000
PROMISE = re.compile(r"#\s*number of (\w+)\s*[:=]\s*([0-9]{1,15})\b", re.IGNORECASE)
"""Line by which COLMAP begins a text: # Number of images: 12, mean observations ..."""
SUBFOLDERS = ("sparse/0", "sparse", "0")
"""Folders of a project that COLMAP's pipelines put a model in."""


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


def read(path: Path, border: Border) -> Views:
    """Cameras and poses of a folder; cameras alone of a file `cameras.bin` or `cameras.txt`."""
    if path.is_file():
        table = _one_file(path, _cameras_of(path.suffix == ".bin"), border)
        cameras, _ = _ordered(table)
        return border.views(cameras, _names(sorted(table)))
    if not path.exists():
        raise CameraError("cannot be read (No such file or directory)")
    folder = model_folder(path)
    if folder is None:
        raise CameraError("a COLMAP model wanted, got a folder without cameras.bin or cameras.txt")
    is_binary = (folder / "cameras.bin").is_file()
    suffix = ".bin" if is_binary else ".txt"
    table = _one_file(folder / f"cameras{suffix}", _cameras_of(is_binary), border)
    cameras, row_of = _ordered(table)
    images: list[Image] = []
    if (folder / f"images{suffix}").is_file():
        images = _one_file(
            folder / f"images{suffix}", _binary_images if is_binary else _text_images, border
        )
    else:
        border.note(f"there is no images{suffix}: cameras alone")
    numbers: set[int] = set()
    for image in images:
        if image.image_id in numbers:
            raise CameraError(f"image {image.image_id} comes twice in images{suffix}; leave one")
        numbers.add(image.image_id)
        if image.camera_id not in row_of:
            raise CameraError(
                f"image {shown(image.name)} is of camera {image.camera_id}, which is not in "
                f"cameras{suffix}; export the model again"
            )
    places = None
    if (folder / f"rigs{suffix}").is_file():
        parse = _binary_rigs if is_binary else _text_rigs
        found = _one_file(folder / f"rigs{suffix}", parse, border)
        places = _places(found, row_of, border)
    frames: list[tuple[int, list[int]]] = []
    if (folder / f"frames{suffix}").is_file():
        frames = _one_file(
            folder / f"frames{suffix}", _binary_frames if is_binary else _text_frames, border
        )
    frame_of = {image: frame for frame, images_of_it in frames for image in images_of_it}
    motions = from_quaternions([i.quaternion for i in images], [i.translation for i in images])
    return border.views(
        cameras,
        _names(sorted(table)),
        world_from_camera=inverse_of(motions),
        camera=[row_of[image.camera_id] for image in images],
        images=[image.name for image in images],
        frames=_names_of_frames(images, frame_of),
        rig_from_camera=places,
    )


def _names_of_frames(images: Sequence[Image], frame_of: dict[int, int]) -> list[str]:
    """Frame of each image; none where every frame has one image, as COLMAP makes them itself."""
    found = [frame_of.get(image.image_id) for image in images]
    known = [number for number in found if number is not None]
    if len(set(known)) == len(known):
        return []
    return [
        f"frame {number}" if number is not None else f"image {image.image_id}"
        for number, image in zip(found, images, strict=True)
    ]


def _names(ids: Sequence[int]) -> list[str]:
    return [f"camera {number}" for number in ids]


def _ordered(table: dict[int, Camera]) -> tuple[list[Camera], dict[int, int]]:
    """Cameras by id, and the row of each id."""
    if not table:
        raise CameraError("a COLMAP model wanted, got one without cameras")
    ids = sorted(table)
    return [table[number] for number in ids], {number: row for row, number in enumerate(ids)}


def _one_file(path: StrPath, parse: Any, border: Border) -> Any:
    """Result of `parse` on a file; errors name the file."""
    name = printable(Path(path).name)
    try:
        with open_file(path, LARGEST_FILE) as file:
            found = parse(file)
            if Path(path).suffix == ".txt":
                file.seek(0)
                _check_promise(_promised(file), len(found), name, border)
            return found
    except UnreadableError as error:
        raise CameraError(f"{name}: {error}") from None
    except (CameraError, PoseError) as error:
        raise CameraError(f"{name}: {error}") from None


def _cameras_of(is_binary: bool) -> Any:
    return _binary_cameras if is_binary else _text_cameras


def _add(table: dict[int, Camera], number: int, model: ColmapModel, *values: Any) -> None:
    if number in table:
        raise CameraError(f"camera {number} comes twice; leave one")
    width, height, parameters = values
    try:
        size = image_side("width", width), image_side("height", height)
        table[number] = camera_of(model, *size, parameters)
    except CameraError as error:
        raise CameraError(f"camera {number}: {error}") from None


# Text.


def _promised(file: BinaryIO) -> tuple[int, str]:
    """Number that the comments at the start of a file promise, and of what; -1 without any."""
    while (line := file.readline(LONGEST_COMMENT)).startswith(b"#") or line.isspace():
        if found := PROMISE.match(line.decode("utf-8", errors="replace")):
            return int(found[2]), found[1]
    return -1, ""


def _check_promise(promised: tuple[int, str], count: int, name: str, border: Border) -> None:
    """Hold the number in a file's header against what was read."""
    number, what = promised
    if number > count:
        raise CameraError(
            f"the header promises {number} {what}, {count} are there; the file is truncated or "
            "damaged, export it again, or correct its header"
        )
    if 0 <= number < count:
        border.note(f"{name}: the header promises {number} {what}, {count} are there and read")


def _lines(file: BinaryIO) -> Iterator[tuple[int, str]]:
    """Number and text of each line that is no comment; empty ones as well, which may be points."""
    number = 0
    while raw := file.readline(LONGEST_LINE):
        number += 1
        if len(raw) == LONGEST_LINE:
            raise CameraError(f"line {number} is longer than {LONGEST_LINE} bytes")
        if number == 1 and raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise CameraError("text in UTF-8 wanted, got UTF-16; save it as UTF-8")
        text = raw.decode("utf-8-sig" if number == 1 else "utf-8", errors="replace").strip()
        if not text.startswith("#"):
            yield number, text


class _Words:
    """Words of a line, taken one after the other."""

    def __init__(self, number: int, text: str) -> None:
        self._where, self._words, self._at = f"line {number}", text.split(), 0

    def take(self, what: str) -> str:
        if self._at >= len(self._words):
            raise CameraError(f"{self._where} ends before {what}; the file is truncated")
        self._at += 1
        return self._words[self._at - 1]

    def whole(self, what: str) -> int:
        word = self.take(what)
        # The longest: -2^63 and 2^64 - 1.
        if not word.removeprefix("-").isdecimal() or len(word) > 20:
            raise CameraError(f"{self._where}: {what} must be a whole number, got {shown(word)}")
        return int(word)

    def reals(self, what: str, count: int) -> tuple[float, ...]:
        return tuple(self._real(what, self.take(what)) for _ in range(count))

    def others(self, what: str) -> tuple[float, ...]:
        rest, self._at = self._words[self._at :], len(self._words)
        return tuple(self._real(what, word) for word in rest)

    def _real(self, what: str, word: str) -> float:
        try:
            value = float(word if "_" not in word else "")  # Python reads 1_0 as ten
        except ValueError:
            raise CameraError(
                f"{self._where}: {what} must be a number, got {shown(word)}"
            ) from None
        return value


def _text_cameras(file: BinaryIO) -> dict[int, Camera]:
    table: dict[int, Camera] = {}
    for number, text in _lines(file):
        if not text:
            continue
        words = _Words(number, text)
        camera_id, name = words.whole("the camera's id"), words.take("the model")
        if name not in IDS:
            raise CameraError(
                f"line {number}: the model must be one of {', '.join(IDS)}, got {shown(name)}"
            )
        size = words.whole("the width"), words.whole("the height")
        _add(table, camera_id, BY_ID[IDS[name]], *size, words.others("a parameter"))
    return table


def _text_images(file: BinaryIO) -> list[Image]:
    images: list[Image] = []
    lines = _lines(file)
    for number, text in lines:
        if not text:
            continue  # between two images only: the line of points after each is taken below
        # The name is the rest of the line, and may have spaces.
        head = text.split(maxsplit=9)
        words = _Words(number, " ".join(head[:9]))
        image_id = words.whole("the image's id")
        quaternion = words.reals("the quaternion", 4)
        translation = words.reals("the translation", 3)
        camera_id = words.whole("the camera's id")
        name = head[9] if head[9:] else ""
        images.append(Image(quaternion, translation, camera_id, name, image_id))
        after, points = next(lines, (number + 1, ""))
        found = points.split()
        # The ids of the first points and of the last: a line of an image may look like points.
        if len(found) % 3 or not all(_is_whole(word) for word in (*found[2:9:3], *found[-1:])):
            raise CameraError(
                f"line {after}: the points of image {shown(images[-1].name)} wanted, got "
                f"{shown(points)}; leave an empty line where an image has none"
            )
    return images


def _is_whole(word: str) -> bool:
    return word.removeprefix("-").isdecimal()


Rigs = list[dict[int, tuple[float, ...] | None]]
"""For each rig, sensor_from_rig of its cameras: a quaternion and a translation; None if unknown,
and () for the reference."""


def _text_rigs(file: BinaryIO) -> Rigs:
    rigs: Rigs = []
    for number, text in _lines(file):
        if not text:
            continue
        words, rig = _Words(number, text), dict[int, tuple[float, ...] | None]()
        words.whole("the rig's id")
        count = words.whole("the number of sensors")
        for row in range(count):
            kind, sensor = words.take("a sensor"), words.whole("the sensor's id")
            place: tuple[float, ...] | None = ()
            if row:
                has_pose = words.whole("HAS_POSE")
                place = words.reals("sensor_from_rig", 7) if has_pose else None
            if kind == "CAMERA":
                rig[sensor] = place
        rigs.append(rig)
    return rigs


def _text_frames(file: BinaryIO) -> list[tuple[int, list[int]]]:
    """Number of each frame, and the ids of its images."""
    frames: list[tuple[int, list[int]]] = []
    for number, text in _lines(file):
        if not text:
            continue
        words = _Words(number, text)
        frame_id = words.whole("the frame's id")
        words.whole("the rig's id")
        words.reals("rig_from_world", 7)
        frames.append((frame_id, []))
        for _ in range(words.whole("the number of images")):
            kind, _, image_id = (words.take("a sensor"), *(words.whole("an id") for _ in "12"))
            if kind == "CAMERA":
                frames[-1][1].append(image_id)
    return frames


# Binary, little-endian.


def _unpack(file: BinaryIO, form: str, what: str) -> tuple[Any, ...]:
    size = struct.calcsize("<" + form)
    data = file.read(size)
    if len(data) != size:
        raise CameraError(f"the file ends within {what}; it is truncated, export it again")
    return struct.unpack("<" + form, data)


def _count(file: BinaryIO, what: str, least_bytes: int) -> int:
    """A count that the rest of the file has room for, each of `least_bytes` or more."""
    (count,) = _unpack(file, "Q", f"the number of {what}")
    at = file.tell()
    left = file.seek(0, 2) - at
    file.seek(at)
    if count * least_bytes > left:
        raise CameraError(
            f"the file promises {count} {what} and has room for {left // least_bytes}; it is "
            "truncated, export it again"
        )
    return int(count)


def _binary_cameras(file: BinaryIO) -> dict[int, Camera]:
    table: dict[int, Camera] = {}
    for _ in range(_count(file, "cameras", 24)):
        camera_id, model_id, width, height = _unpack(file, "IiQQ", "a camera")
        if model_id not in BY_ID:
            raise CameraError(
                f"camera {camera_id}: the model must be 0 to {len(BY_ID) - 1}, got {model_id}"
            )
        model = BY_ID[model_id]
        parameters = _unpack(file, f"{len(model.parameters.split())}d", "a camera")
        _add(table, camera_id, model, width, height, parameters)
    return table


def _binary_images(file: BinaryIO) -> list[Image]:
    images: list[Image] = []
    for _ in range(_count(file, "images", 73)):
        image_id, *motion, camera_id = _unpack(file, "I7dI", "an image")
        name = _name(file)
        n_points = _count(file, f"points of image {shown(name)}", 24)
        file.seek(24 * n_points, 1)
        images.append(Image(tuple(motion[:4]), tuple(motion[4:]), camera_id, name, image_id))
    return images


def _name(file: BinaryIO) -> str:
    start = file.tell()
    data = file.read(LONGEST_NAME)
    end = data.find(b"\0")
    if end < 0:
        raise CameraError("the name of an image has no end; the file is truncated or broken")
    file.seek(start + end + 1)
    return data[:end].decode("utf-8", errors="replace")


def _binary_rigs(file: BinaryIO) -> Rigs:
    rigs: Rigs = []
    for _ in range(_count(file, "rigs", 8)):
        _, n_sensors = _unpack(file, "II", "a rig")
        rig: dict[int, tuple[float, ...] | None] = {}
        for row in range(n_sensors):
            kind, sensor = _unpack(file, "iI", "a sensor")
            place: tuple[float, ...] | None = ()
            if row:
                (has_pose,) = _unpack(file, "B", "a sensor")
                place = _unpack(file, "7d", "a sensor") if has_pose else None
            if kind == 0:  # a camera; 1 is an IMU
                rig[sensor] = place
        rigs.append(rig)
    return rigs


def _binary_frames(file: BinaryIO) -> list[tuple[int, list[int]]]:
    """Number of each frame, and the ids of its images."""
    frames: list[tuple[int, list[int]]] = []
    for _ in range(_count(file, "frames", 68)):
        frame_id, _, *_, n_images = _unpack(file, "II7dI", "a frame")
        frames.append((frame_id, []))
        for _ in range(n_images):
            kind, _, image_id = _unpack(file, "iIQ", "a frame")
            if kind == 0:  # a camera
                frames[-1][1].append(image_id)
    return frames


def _places(rigs: Rigs, row_of: dict[int, int], border: Border) -> Any:
    """(N, 4, 4) rig_from_camera, or None where no rig has two cameras."""
    if all(len(rig) < 2 for rig in rigs):
        return None
    places = np.tile(np.eye(4), (len(row_of), 1, 1))
    without: list[int] = []
    for rig in rigs:
        for camera_id, place in rig.items():
            if camera_id not in row_of:
                raise CameraError(f"a rig has camera {camera_id}, which is not among the cameras")
            if place is None:
                without.append(camera_id)
            elif place:
                motion = from_quaternions([place[:4]], [place[4:]])
                places[row_of[camera_id]] = inverse_of(motion)[0]
    if without:
        more = f" (and {len(without) - 1} others)" if len(without) > 1 else ""
        border.note(f"camera {without[0]}{more} has no place on its rig; the rig's origin is used")
    if len(rigs) > 1:
        border.note(f"places of cameras are those on {len(rigs)} rigs, each with its own origin")
    return places
