"""Camera files, JSON or TOML, and the presets of the thesis."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rastercov.base.checks import image_side, number, pair, positive, principal_point_px, shown
from rastercov.base.errors import CameraError
from rastercov.base.files import (
    StrPath,
    UnreadableError,
    printable,
    read_json,
    read_toml,
    suffix_of,
    written_file,
)

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
OF_LENS = ("principal_point", "f_number")
OPTICS = (
    *("near", "focal_length", "pixel_size", "aperture", "f_number", "focus_distance"),
    *("max_blur", "focus_range"),
)
"""Entries that a calibration lacks, and that are accepted beside `file`."""
ANGLES = ("hfov_deg", "vfov_deg")
"""Entries that give fx and fy by the angles between opposite sides of the image."""
MOST_DIFFERENCE_REL = 0.05
"""Difference of the focal lengths across and down the image that is taken for calibration."""


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
        raise CameraError(
            "a camera file ends in .json or .toml; rastercov.read_views reads those of other "
            "programs"
        )
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

    "preset" adds the entries of a preset; "hfov_deg" and "vfov_deg" give fx and fy; "f_number" is
    of the focal length, which fx and "pixel_size" give where it is not there. CameraError for an
    entry that does not exist, is missing, or contradicts another one.
    """
    if not isinstance(entries, Mapping):
        raise CameraError(f"a camera is a table of names and values, got {shown(entries)}")
    if "preset" in entries:
        entries = _changed_preset(entries)
    known = {*fields, *OF_LENS, *ANGLES}
    if unknown := sorted(map(shown, entries.keys() - known)):
        raise CameraError(
            f"unknown entry {', '.join(unknown)}; a camera has {', '.join(sorted(known))}"
        )
    given = {k: tuple(v) if isinstance(v, list) else v for k, v in entries.items()}
    for name in (*OF_LENS, *ANGLES):
        if given.get(name, 0) is None:
            del given[name]
    return _checked(given)


def check_optics(entries: Mapping[str, Any]) -> None:
    """CameraError for an entry beside `file` that a calibration has itself."""
    if others := ", ".join(sorted(map(str, entries.keys() - set(OPTICS)))):
        raise CameraError(
            f"file stands beside {', '.join(OPTICS)}, got {others} too; put them into the file"
        )


def _checked(entries: dict[str, Any]) -> dict[str, Any]:
    """Arguments of a constructor, from entries that exist."""
    if not entries.keys().isdisjoint(ANGLES):
        entries = _with_focal_lengths(entries)
    by_lens = entries.keys().isdisjoint({"fx", "fy"})
    wanted = ["width", "height"]
    wanted += ["focal_length", "pixel_size"] if by_lens else ["fx", "fy"]
    if missing := [name for name in wanted if name not in entries]:
        raise CameraError(
            f"missing {', '.join(missing)}; give fx, fy or focal_length, pixel_size or hfov_deg"
        )
    if not by_lens and "principal_point" in entries:
        raise CameraError("principal_point goes with focal_length and pixel_size, not fx, fy")
    if not by_lens and ("f_number" in entries or entries.get("aperture") is not None):
        entries = _with_aperture(entries)
    return entries


def _changed_preset(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of a preset, changed by others."""
    name = str(entries["preset"])
    if name not in PRESETS:
        raise CameraError(f"no camera preset {shown(name)}; there are {', '.join(PRESETS)}")
    base = dict(PRESETS[name])
    if not entries.keys().isdisjoint({"fx", "fy", *ANGLES}):
        del base["focal_length"]  # it is of another lens then
    return base | {k: v for k, v in entries.items() if k != "preset"}


def _with_focal_lengths(entries: dict[str, Any]) -> dict[str, Any]:
    """Entries with fx and fy in place of hfov_deg and vfov_deg; one of these is of both."""
    given = [name for name in ("fx", "fy", "focal_length", "principal_point") if name in entries]
    if given:
        raise CameraError(f"give hfov_deg and vfov_deg, or {', '.join(given)}, not both")
    if entries.get("model", "pinhole") != "pinhole":
        raise CameraError("hfov_deg and vfov_deg are of a pinhole; give fx and fy of other lenses")
    found = {}
    for name, focal, side, centre in (
        ("hfov_deg", "fx", "width", "cx"),
        ("vfov_deg", "fy", "height", "cy"),
    ):
        if name not in entries:
            continue
        if side not in entries:
            raise CameraError(f"missing {side}; {name} needs it")
        length = image_side(side, entries[side])
        at = entries.get(centre)
        at = length / 2 if at is None else principal_point_px(centre, at)
        found[focal] = _focal_length(name, number(name, entries[name]), length, at)
    both = {"fx": found.get("fx", found.get("fy")), "fy": found.get("fy", found.get("fx"))}
    return {k: v for k, v in entries.items() if k not in ANGLES} | both


def _focal_length(name: str, angle: float, side: int, centre: float) -> float:
    """Focal length in pixels by which a side of the image spans an angle, in degrees.

    atan(c / f) + atan((w - c) / f) = a, so that f^2 sin a - f w cos a - c (w - c) sin a = 0.
    """
    radians = math.radians(angle)  # 0 for the least angles
    if not 0 < radians < math.pi:
        raise CameraError(f"{name} must be above 0 and below 180, got {angle:g}")
    if not 0 < centre < side:
        raise CameraError(f"{name} needs a principal point inside the image, got {centre:g}")
    sine, cosine = math.sin(radians), math.cos(radians)
    root = math.sqrt((side * cosine) ** 2 + 4 * sine * sine * centre * (side - centre))
    return (side * cosine + root) / (2 * sine)


def _with_aperture(entries: dict[str, Any]) -> dict[str, Any]:
    """Entries with the focal length that fx, fy and pixel_size give, and with an aperture."""
    if "f_number" in entries and entries.get("aperture") is not None:
        raise CameraError("give f_number or aperture, not both")
    if entries.get("focal_length") is None:
        if entries.get("pixel_size") is None:
            raise CameraError(
                "f_number and aperture need the focal length in metres; give pixel_size or "
                "focal_length"
            )
        s_u, s_v = pair("pixel_size", entries["pixel_size"])
        across = positive("fx", entries["fx"]) * s_u
        down = positive("fy", entries["fy"]) * s_v
        if not abs(across - down) <= MOST_DIFFERENCE_REL * max(across, down):
            raise CameraError(
                f"fx, fy and pixel_size give focal lengths of {across:g} m and {down:g} m; "
                "correct pixel_size"
            )
        entries = entries | {"focal_length": (across + down) / 2}
    if "f_number" not in entries:
        return entries
    f, n = positive("focal_length", entries["focal_length"]), entries["f_number"]
    others = {k: v for k, v in entries.items() if k != "f_number"}
    return others | {"aperture": f / positive("f_number", n)}
