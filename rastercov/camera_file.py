"""Camera files, JSON or TOML, and the presets of the thesis."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rastercov._checks import shown
from rastercov._files import (
    StrPath,
    UnreadableError,
    printable,
    read_json,
    read_toml,
    suffix_of,
    written_file,
)
from rastercov.errors import CameraError

PRESETS: dict[str, dict[str, Any]] = {
    # Table 5.2, used for the marker experiments of chapter 5.
    "icube-ns4133bu-8mm": {
        "width": 1280,
        "height": 1024,
        "focal_length": 8e-3,
        "pixel_size": 5.3e-6,
    },
    # Figure A.3: Khepra's default, given as a sensor of 3.6 x 2.01 mm.
    "khepra": {
        "width": 1280,
        "height": 800,
        "focal_length": 1.93e-3,
        "pixel_size": (3.6e-3 / 1280, 2.01e-3 / 800),
        "focus_range": (0.1, 5.0),
    },
}
"""Arguments of `Camera.from_lens` for the cameras of the thesis."""


@contextmanager
def naming(path: StrPath) -> Iterator[None]:
    """Name the file in errors of the block."""
    try:
        yield
    except (UnreadableError, CameraError) as error:
        raise CameraError(f"{printable(str(path))}: {error}") from None


def read_entries(path: StrPath) -> Any:
    """Content of a camera file."""
    suffix = suffix_of(path)
    if suffix not in (".json", ".toml"):
        raise CameraError("a camera file ends in .json or .toml")
    return read_json(path) if suffix == ".json" else read_toml(path)


def write_entries(path: StrPath, entries: Mapping[str, Any]) -> None:
    """Write a camera file, `.json`."""
    try:
        if suffix_of(path) != ".json":
            raise CameraError("a camera is saved as .json")
        with written_file(path) as file:
            file.write((json.dumps(entries, indent=2) + "\n").encode())
    except ValueError as error:
        raise CameraError(f"{printable(str(path))}: {error}") from None


def arguments_of(entries: Any, fields: Sequence[str]) -> dict[str, Any]:
    """Arguments of `Camera`, or of `Camera.from_lens` without `fx`, from the entries of a file.

    "preset" adds the entries of a preset. CameraError for an entry that does not exist, is missing,
    or belongs to the other constructor.
    """
    if not isinstance(entries, Mapping):
        raise CameraError(f"a camera is a table of names and values, got {shown(entries)}")
    if "preset" in entries:
        name = str(entries["preset"])
        if name not in PRESETS:
            raise CameraError(f"no camera preset {shown(name)}; there are {', '.join(PRESETS)}")
        entries = PRESETS[name] | {k: v for k, v in entries.items() if k != "preset"}
    of_lens = {"principal_point", "f_number"}
    known = {*fields, *of_lens}
    if unknown := sorted(map(shown, entries.keys() - known)):
        raise CameraError(
            f"unknown entry {', '.join(unknown)}; a camera has {', '.join(sorted(known))}"
        )
    by_lens = entries.keys().isdisjoint({"fx", "fy"})
    wanted = ["width", "height"]
    wanted += ["focal_length", "pixel_size"] if by_lens else ["fx", "fy"]
    if missing := [name for name in wanted if name not in entries]:
        raise CameraError(f"missing {', '.join(missing)}; give fx, fy or focal_length, pixel_size")
    if not by_lens and (mixed := sorted(of_lens & entries.keys())):
        raise CameraError(f"{', '.join(mixed)} goes with focal_length and pixel_size, not fx, fy")
    return {k: tuple(v) if isinstance(v, list) else v for k, v in entries.items()}
