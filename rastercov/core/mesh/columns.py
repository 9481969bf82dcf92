"""Tables of numbers in CSV, one row per frame, and their times."""

import csv
import io
from collections.abc import Collection
from itertools import pairwise
from typing import Any

import numpy as np

from rastercov.base import ByName, ConfigError, ReadByName, finite_number, shown
from rastercov.base.files import LARGEST_NUMBER

MOST_FRAMES = 10_000
"""Rows of a table."""
TIMES = ("time", "duration")
"""Columns that say when a frame begins, or its weight."""


def durations_of(content: ReadByName) -> ByName:
    """`durations` of a table that has some, or from its `times`, at which frames begin."""
    if "times" not in content:
        return {"durations": content["durations"]} if "durations" in content else {}
    if "durations" in content:
        raise ConfigError("expected times or durations, got both; remove one")
    given = content["times"]
    if not isinstance(given, list) or not given:
        raise ConfigError(f"expected times to be a list of numbers, got {shown(given)}")
    times = [finite_number(each) for each in given]
    if not np.isfinite(times).all():
        raise ConfigError(f"expected times to be finite numbers, got {shown(given)}")
    for row, (before, after) in enumerate(pairwise(times), start=1):
        if not after > before:
            raise ConfigError(
                f"expected times to be strictly increasing, got {after:g} after {before:g} in "
                f"frame {row}"
            )
    lengths = np.diff(times).tolist() or [1.0]
    return {"durations": [*lengths, lengths[-1]][: len(times)]}


def columns_of(
    text: str, ignored: Collection[str] = (), each: str = "frame", first: int = 0
) -> dict[str, list[float]]:
    """Columns of a CSV table by name, one row per frame; ConfigError for another file.

    Columns with names among `ignored` may be of text. Messages call a row by another word, and
    count rows from the `first`.
    """
    try:
        rows = [row for row in csv.reader(io.StringIO(text), strict=True) if any(row)]
    except csv.Error as error:
        raise ConfigError(f"expected a CSV table, got: {error}") from None
    if len(rows) < 2 or len(rows) > MOST_FRAMES + 1:
        raise ConfigError(
            f"expected a row of names and 1 to {MOST_FRAMES:,} {each}s, got {len(rows)} rows"
        )
    names = [name.strip() for name in rows[0]]
    if len(set(names)) < len(names):
        raise ConfigError(f"expected columns with different names, got {shown(names)}; rename one")
    if uneven := [number for number, row in enumerate(rows[1:]) if len(row) != len(names)]:
        raise ConfigError(
            f"{each} {uneven[0] + first}: expected {len(names)} numbers, one per name, got "
            f"{len(rows[1 + uneven[0]])}"
        )
    columns: dict[str, list[float]] = {}
    for at, name in enumerate(names):
        if name in ignored:
            continue
        columns[name] = [finite_number(_number(row[at])) for row in rows[1:]]
        is_usable = np.abs(columns[name]) <= LARGEST_NUMBER
        if not is_usable.all():
            row = int(is_usable.argmin())
            raise ConfigError(
                f"column {shown(name)}, {each} {row + first}: expected a number within "
                f"±{LARGEST_NUMBER:g}, got {shown(rows[1 + row][at])}"
            )
    return columns


def _number(text: str) -> Any:
    try:
        return None if "_" in text else float(text)  # Python's 1_000
    except ValueError:
        return None
