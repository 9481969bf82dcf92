"""Camera catalogue: cameras and lenses by name, NAME with its own lens or NAME+LENS; heads, lamps.

`data/cameras.toml` has them, one line a model, in the tables `cameras`, `lenses`, `lamps`, and
`heads`: two cameras side by side, NAME, NAME:BASELINE or NAME:BASELINE:CAMERA. Entries of a lamp
are those of a file of lamps, and `OF_SHOP`. Its `families` have what models share, by table and
begin of their names. A file of the same form, without families, adds
models and changes entries of those that are there: one that is given, or that RASTERCOV_CATALOGUE
names in the environment. Entries of a camera are those of a camera file, and `OF_SHOP`. Lengths are
metres, prices of one currency.
"""

import math
import os
import re
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import NamedTuple

from rastercov.base import (
    ByName,
    CameraError,
    ReadByName,
    StrPath,
    UnreadableError,
    hypot,
    printable,
    read_toml,
    shown,
)
from rastercov.base.arguments import is_number, pair, positive
from rastercov.core.camera.parallel import MODEL
from rastercov.core.mesh.groups import list_names

Entries = ByName
Table = dict[str, Entries]

NUMBERS = ("price", "f_numbers", "image_circle", "nearest", "baseline")
OF_SHOP = ("maker", "product", "sensor", "mount", "source", *NUMBERS)
"""Entries that a camera file does not have."""
OF_VIEW = ("fx", "fy", "focal_length", "hfov_deg", "vfov_deg", "magnification")
"""Entries of a camera with a lens of its own; any of them replaces that of the catalogue."""
NEEDED = {
    "cameras": ("width", "height", "pixel_size"),
    "lenses": ("focal_length",),
    "heads": ("baseline",),
    "lamps": (),
}
"""Entries of all; a camera with a lens of its own may do without pixel_size."""
KINDS = ("point", "spot", "bar", "ring", "dome", "area", "sun")
"""Kinds of lamps. All but the first two may be of several points; the last one has no place."""
MOST_BASELINE = 10.0
"""Of a head, m; more are millimetres."""
WITH_RING = {("CS", "C")}
"""Mounts of a camera and a lens that a ring of 5 mm connects."""
CIRCLE_TOLERANCE_REL = 0.01
"""Part of the diagonal of a sensor that may exceed the image circle, whose formats are rounded."""


class Catalogue(NamedTuple):
    """Entries of cameras, lenses, heads and lamps by name."""

    cameras: Table
    lenses: Table
    heads: Table
    lamps: Table

    def lenses_of(self, camera: str) -> list[str]:
        """Names of the lenses that fit a camera."""
        return [name for name in self.lenses if not misfit(self.cameras[camera], self.lenses[name])]

    def names(self) -> Iterator[str]:
        """Names of cameras with a lens of their own, and of pairs of a camera and a lens."""
        for name, camera in self.cameras.items():
            if has_lens(camera):
                yield name
            else:
                yield from (f"{name}+{lens}" for lens in self.lenses_of(name))

    def parts(self, name: object) -> list[Entries]:
        """Entries of a camera, and of its lens where the name has one.

        Raises
        ------
        CameraError
            For a name that is not there, and for a lens that does not fit.
        """
        parts, words = [], str(name).split("+", 1)
        for part, what, table in zip(words, Catalogue._fields, self, strict=False):
            if part not in table:
                if part in self.lenses:
                    raise CameraError(
                        f"expected a camera of the catalogue, got lens {shown(part)}; give "
                        f"CAMERA+{part}, see rastercov cameras"
                    )
                near = [each for each in table if part and part in each]
                near = near or get_close_matches(part.lower()[:40], table, 1)
                raise CameraError(
                    f"expected a name among the {len(table)} {what} of the catalogue, got "
                    f"{shown(part)}; {f'try {near[0]}, or ' if near else ''}see rastercov cameras"
                )
            parts.append(table[part])
        if len(parts) == 2 and (why := misfit(*parts)):
            fitting = list_names(self.lenses_of(words[0])) or f"none, name {words[0]} alone"
            raise CameraError(
                f"expected a lens that fits {words[0]}, got {words[1]}: {why}; lenses that fit: "
                f"{fitting}"
            )
        return parts


def has_lens(camera: Entries) -> bool:
    """True for a camera with a lens of its own."""
    return not camera.keys().isdisjoint(OF_VIEW)


def misfit(camera: Entries, lens: Entries) -> str:
    """Reason why a lens does not fit a camera; empty if it does."""
    if has_lens(camera):
        return "the camera has a lens of its own"
    mounts = camera.get("mount"), lens.get("mount")
    if mounts[0] != mounts[1] and mounts not in WITH_RING:
        return f"the mount of the camera is {mounts[0]}, that of the lens is {mounts[1]}"
    s_u, s_v = pair("pixel_size", camera["pixel_size"])
    diagonal = hypot(camera["width"] * s_u, camera["height"] * s_v)
    circle = lens.get("image_circle", math.inf)
    if circle < diagonal * (1 - CIRCLE_TOLERANCE_REL):
        sizes = f"{1e3 * circle:.3g} mm is smaller than the sensor, {1e3 * diagonal:.3g} mm"
        return f"the image circle of {sizes} across its corners"
    return ""


@cache
def _sold() -> Catalogue:
    """The catalogue of the package, with the entries of the families of each name."""
    tables = read_toml(Path(__file__).parents[2] / "data" / "cameras.toml")
    for what, families in tables.pop("families").items():
        for begin, shared in families.items():
            own = {
                name: shared | each for name, each in tables[what].items() if name.startswith(begin)
            }
            tables[what] |= own
    return Catalogue(**tables)


def catalogue(file: StrPath | None = None) -> Catalogue:
    """The catalogue with the file of a user, `file` or that of the environment.

    Raises
    ------
    CameraError
        For a file that is not a catalogue.
    """
    tables = {name: dict(table) for name, table in _sold()._asdict().items()}
    path = file or os.environ.get("RASTERCOV_CATALOGUE")
    try:
        for what, more in (read_toml(path) if path else {}).items():
            for name, entry in more.items():
                whole = tables[what][name] = tables[what].get(name, {}) | entry
                for text in (name, whole.get("mount", "")):
                    if not isinstance(text, str) or not text.isprintable():
                        why = (
                            f"{what}: expected printable names and mounts, got {shown(text)}; "
                            "correct it"
                        )
                        raise CameraError(why)
                needed = NEEDED[what][: 2 if has_lens(whole) else 3]
                if what == "lenses" and "magnification" in whole:
                    needed = ("magnification",)
                for each in (*needed, *(each for each in NUMBERS if each in whole)):
                    checked = pair if each in ("pixel_size", "f_numbers") else positive
                    whole[each] = checked(f"{what}.{name}.{each}", whole.get(each))
    except (UnreadableError, CameraError) as error:
        raise CameraError(f"{printable(str(path))}: {error}") from None
    except (KeyError, AttributeError, TypeError):
        words = (
            "expected tables of cameras, lenses, heads and lamps by NAME, got another layout of "
            f"{shown(what)}; correct it"
        )
        raise CameraError(f"{printable(str(path))}: {words}") from None
    return Catalogue(**tables)


def is_name(text: object) -> bool:
    """True for a text that may be a name in the catalogue, and is no file."""
    if not isinstance(text, str) or not re.fullmatch(r"[A-Za-z][\w+-]*", text):
        return False
    return not os.path.exists(text)  # noqa: PTH110 - of a text


def is_head(text: object) -> bool:
    """True for a text that names a head of the catalogue, and is no file."""
    if not isinstance(text, str) or not re.fullmatch(r"[A-Za-z][\w-]*(:[^:/]*){0,2}", text):
        return False
    if os.path.exists(text):  # noqa: PTH110 - of a text
        return False
    return text.split(":")[0] in catalogue().heads


def head_of(name: object, file: StrPath | None) -> tuple[str, str | None, float]:
    """Camera of a head, its projector, and the distance of their centres, metres.

    The projector, a camera of the catalogue, is None where there is a second camera.

    Raises
    ------
    CameraError
        For an unknown head, and an invalid distance.
    """
    first, *others = str(name).split(":")
    heads = catalogue(file).heads
    if first not in heads or len(others) > 2:
        known = list_names(heads, first)
        raise CameraError(
            f"expected a head NAME[:BASELINE[:CAMERA]] with NAME one of {known}, got {shown(name)}"
        )
    baseline, camera = heads[first]["baseline"], heads[first].get("camera")
    if others:
        try:
            baseline = positive("baseline", float(others[0].removesuffix("m")))
        except (ValueError, CameraError):
            raise CameraError(
                f"expected a baseline in metres, got {shown(others[0])}; write NAME:0.12"
            ) from None
    if not baseline <= MOST_BASELINE:
        raise CameraError(
            f"expected a baseline up to {MOST_BASELINE:g} m, got {baseline:g}; it is in metres, "
            f"{first}:{baseline / 1000:g} for {baseline:g} mm"
        )
    camera = str(others[1] if len(others) > 1 else camera)
    return camera, heads[first].get("projector"), baseline


def entries_of(name: str, changes: ReadByName, file: StrPath | None = None) -> Entries:
    """Entries of a camera file for a camera with its lens, changed by others.

    With `focus_distance` alone the lens is open, at its least f-number.
    """
    result = catalogue(file)
    parts = result.parts(name)
    entries = {k: v for part in parts for k, v in part.items()}
    if not changes.keys().isdisjoint(OF_VIEW):
        others = ("f_numbers", "nearest", "f_number", "working_distance", "depth_of_field")
        entries = {k: v for k, v in entries.items() if k not in (*OF_VIEW, *others)}
    elif not has_lens(entries):
        fitting = result.lenses_of(name)
        lens = f", such as {name}+{fitting[0]}" if fitting else ""
        raise CameraError(
            f"expected a lens for {name} (mount {entries.get('mount')}), got none; give "
            f"focal_length or {name}+LENS{lens}"
        )
    if "magnification" in entries:
        entries["model"] = MODEL
    low, high = entries.get("f_numbers", (0, math.inf))
    n, z = changes.get("f_number"), changes.get("focus_distance")
    if is_number(n) and not low <= n <= high:
        raise CameraError(
            f"expected f_number of {name} to be from {low:g} to {high:g}, got {shown(n)}"
        )
    nearest = entries.get("nearest", 0)
    if is_number(z) and not z >= nearest:
        raise CameraError(
            f"expected focus_distance of {name} to be {nearest:g} m or more, got {shown(z)} m"
        )
    if z is not None and low and changes.keys().isdisjoint({"f_number", "aperture"}):
        entries["f_number"] = low
    if changes.keys().isdisjoint(OF_VIEW) or not (has_lens(parts[0]) or parts[1:]):
        changes = {"product": product_of(parts)} | dict(changes)
    return {k: v for k, v in entries.items() if k not in OF_SHOP} | dict(changes)


def lamp_entries_of(name: object) -> Entries:
    """Entries of a lamp of the catalogue; CameraError for a name that is not there."""
    lamps = catalogue().lamps
    if not isinstance(name, str) or name not in lamps:
        near = list_names([each for each in lamps if str(name) in each] or lamps, str(name))
        raise CameraError(
            f"expected a lamp of the catalogue, such as {near}, got {shown(name)}; see rastercov "
            "cameras"
        )
    return {key: value for key, value in lamps[name].items() if key not in OF_SHOP}


def product_of(parts: Sequence[Entries]) -> str:
    """Product names of a camera and its lens."""
    names = (" ".join(filter(None, map(part.get, ("maker", "product")))) for part in parts)
    return " + ".join(filter(None, names))


def price_of(name: str, file: StrPath | None) -> float | None:
    """Price of a camera with its lens; None where one of them has none."""
    prices = [part.get("price", math.nan) for part in catalogue(file).parts(name)]
    return None if math.isnan(sum(prices)) else float(sum(prices))
