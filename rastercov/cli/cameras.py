"""The command `cameras`: search of the catalogue of cameras, lenses, sensor heads and lamps."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from rich.table import Table
from typer import Argument, Option

from rastercov.base import ByName, ConfigError, check_choice, first_of, json_text
from rastercov.cli import options
from rastercov.cli.console import print_lines
from rastercov.cli.terminal import print_rows
from rastercov.core.camera import Camera
from rastercov.core.camera.catalogue import KINDS, Catalogue, catalogue, price_of
from rastercov.core.camera.projection import angles_of_view

Row = ByName
NEAR_REL = 0.1
"""Difference of a field of view from that which is asked for."""
COLUMNS = {
    "cameras": "name width height pixel_size mount hfov_deg field px_per_mm price",
    "lenses": "name focal_length magnification working_distance f_numbers image_circle nearest "
    "mount price",
    "heads": "name camera baseline product price",
    "lamps": "name kind size intensity_cd power_w_sr range half_angle_deg price",
}
UNITS = {
    "pixel_size": ("pixel pitch, µm", 1e6),
    "focal_length": ("f, mm", 1e3),
    "image_circle": ("image circle, mm", 1e3),
    "hfov_deg": ("hfov, deg", 1.0),
    "field": ("field, m", 1.0),
    "px_per_mm": ("px/mm", 1.0),
    "nearest": ("min. focus, m", 1.0),
    "working_distance": ("working distance, m", 1.0),
    "baseline": ("baseline, m", 1.0),
    "size": ("size, m", 1.0),
    "intensity_cd": ("intensity, cd", 1.0),
    "half_angle_deg": ("cut-off, deg", 1.0),
    "power_w_sr": ("radiant intensity, W/sr", 1.0),
}
"""Headings and factors of quantities in a table."""


NO_ENTRY = "no entry matches; give no words to list all, or --hfov for camera-lens pairs by angle"


def cameras(
    words: Annotated[
        list[str] | None,
        Argument(
            metavar="WORDS",
            help="Words in the name, maker, product or sensor; telecentric, or a kind of lamp: "
            + ", ".join(KINDS),
        ),
    ] = None,
    hfov: Annotated[
        float | None,
        Option(
            min=0.01,
            max=360,
            help="Horizontal field of view, deg, within 10 %; lists camera-lens pairs.",
        ),
    ] = None,
    wd: Annotated[
        float | None,
        Option(min=1e-4, help="Working distance, m, for --fov; lists lenses that focus there."),
    ] = None,
    fov: Annotated[
        float | None,
        Option(min=1e-5, help="Width of the field of view at --wd, m, within 10 %."),
    ] = None,
    min_pixels: Annotated[
        float, Option(min=0, help="Minimum number of pixels per image, such as 5e6.")
    ] = 0.0,
    mount: Annotated[str | None, Option(help="Lens mount: C, CS, S, E or F.")] = None,
    max_price: Annotated[
        float | None,
        Option(
            min=0,
            help="Maximum price: USD for built-in entries, the currency of your catalogue for "
            "others. Leaves out entries without a price.",
        ),
    ] = None,
    own: Annotated[Path | None, Option("--catalogue", help="Your own catalogue file.")] = None,
    as_json: options.AsJson = False,
) -> None:
    """Search the catalogue of cameras, lenses, sensor heads and lamps.

    Example: rastercov cameras rpi --hfov 60

    Lenses for a field: rastercov cameras --wd 0.35 --fov 0.1
    """
    shop = catalogue(own)
    every = {what: list(table) for what, table in shop._asdict().items()}
    _check_mount(shop, mount)
    if (wd is None) != (fov is None):
        got = "--fov" if wd is None else "--wd"
        raise ConfigError(f"expected --wd with --fov, got {got} alone; give both")
    if hfov is not None or wd is not None:
        every = {"cameras": list(shop.names())}
    rows_by_key: dict[str, list[Row]] = {what: [] for what in every}

    def is_asked(row: Row) -> bool:
        return (mount or "").upper() in ("", row.get("mount")) and _has_words(row, words or ())

    for what, name in [(what, name) for what, names in every.items() for name in names]:
        parts = shop.parts(name) if what == "cameras" else [getattr(shop, what)[name]]
        row = {"name": name} | {k: v for part in reversed(parts) for k, v in part.items()}
        row["price"] = price_of(name, own) if what == "cameras" else row.get("price")
        row |= _prices_of(name, parts)
        row["hfov_deg"] = None
        if hfov is not None or wd is not None:
            camera = Camera.from_dict({"preset": name, "catalogue": own})
            row["hfov_deg"] = math.nan if camera.is_parallel else angles_of_view(camera)[0]
        if wd is not None:
            row |= _field_at(wd, camera, row)
        if (
            is_asked(row)
            and row.get("width", math.inf) * row.get("height", math.inf) >= min_pixels
            and (max_price is None or (row["price"] or math.nan) <= max_price)
            and (hfov is None or abs(row["hfov_deg"] - hfov) <= NEAR_REL * hfov)
            and (fov is None or abs(row["field"] - fov) <= NEAR_REL * fov)
        ):
            rows_by_key[what].append(row)
    if as_json:
        print(json_text(rows_by_key))
        return
    if words and not any(rows_by_key.values()):
        print_lines(NO_ENTRY)
    for what, rows in rows_by_key.items():
        _print(what, rows, is_own=own is not None)
    paired = {name.partition("+")[2] for name in shop.names()}
    alone = [
        name
        for name, lens in shop.lenses.items()
        if name not in paired and is_asked({"name": name} | lens)
        if wd is None or abs(lens.get("working_distance", wd) - wd) <= NEAR_REL * wd
    ]
    if alone:
        print_lines(f"no camera of the catalogue fits: {first_of(alone)}")


def _field_at(wd: float, camera: Camera, row: Row) -> Row:
    """Width of the field at a distance, m, NaN beyond the focus of the lens, and its sampling.

    A telecentric lens has one working distance, to within `NEAR_REL`.
    """
    away = abs(wd - row.get("working_distance", wd))
    is_sharp = wd >= row.get("nearest", 0.0) and away <= NEAR_REL * wd
    scale = 1.0 if camera.is_parallel else wd
    field = scale * camera.width / camera.fx if is_sharp else math.nan
    return {"field": field, "px_per_mm": camera.width / field / 1e3}


def _prices_of(name: str, parts: list[Row]) -> Row:
    """Prices of a camera and its lens, by name; nothing for one entry."""
    prices = [part.get("price") for part in parts]
    return {"prices": dict(zip(name.split("+", 1), prices, strict=True))} if parts[1:] else {}


def _print(what: str, rows: list[Row], *, is_own: bool) -> None:
    """Print the entries of a kind, and their number."""
    if rows:
        print_rows(_table(rows, COLUMNS[what].split(), is_own=is_own))
    print_lines(f"{'sensor heads' if what == 'heads' else what}: {len(rows)}")


def _check_mount(shop: Catalogue, mount: str | None) -> None:
    """Raise `ConfigError` for a mount of no entry."""
    mounts = {str(row.get("mount", "")) for table in shop for row in table.values()}
    if mount is not None:
        check_choice("mount", mount.upper(), sorted(mounts - {""}))


def _has_words(row: Row, words: Sequence[str]) -> bool:
    """True if an entry is of the kinds among some words and has the others, in any case."""
    text = " ".join(str(row.get(each, "")) for each in ("name", "maker", "product", "sensor"))
    text += " telecentric" * ("magnification" in row)
    folded = [word.casefold() for word in words]
    return all(row.get("kind") == w if w in KINDS else w in text.casefold() for w in folded)


def _table(rows: list[Row], columns: list[str], *, is_own: bool) -> Table:
    """Rows as a table of those columns that have a value."""
    names = [name for name in columns if any(_cell(row, name) for row in rows)]
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for name in names:
        heading = "price, USD" if name == "price" and not is_own else name.replace("_", " ")
        heading = UNITS.get(name, (heading,))[0].replace(" ", "\n")  # narrow
        table.add_column(heading, no_wrap=name != "product", overflow="fold")
    for row in rows:
        table.add_row(*(_cell(row, name) for name in names))
    return table


def _cell(row: Row, name: str) -> str:
    value, factor = row.get(name), UNITS.get(name, ("", 1.0))[1]
    values = value if isinstance(value, list | tuple) else [] if value is None else [value]
    words = (f"{factor * v:.4g}" if isinstance(v, float) else str(v) for v in values if v == v)
    return (" x " if name in ("pixel_size", "size") else "-").join(dict.fromkeys(words))
