"""Numbers as text: the one format of each quantity in tables, pages, plots and messages."""

import base64
import math
import re
import reprlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib import import_module
from typing import Any, dataclass_transform

ByName = dict[str, Any]
"""Values of any types by their names: an object of JSON, columns of a table."""
ReadByName = Mapping[str, Any]
"""The same, only read."""
LONGEST_SHOWN = 240
"""Characters of a value in a line."""
MOST_SHOWN, MOST_LETTERS = 8, 60
"""Entries of a field, and characters of it, that a value in one line shows as they are."""
NOT_OF_XML = re.compile(r"[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
AREAS = (("m²", 1.0), ("cm²", 1e4), ("mm²", 1e6), ("µm²", 1e12))
"""Units of areas, and how many of each are 1 m². The least areas in them are 0.1 m², 1 cm² and
1e-3 mm², and what rounds to these: 0.83 m², not 8,300 cm²."""


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def frozen_record(kind: type | None = None, **options: bool) -> Any:
    """Make a class a frozen dataclass that equals only itself: arrays have no single truth."""
    made = dataclass(frozen=True, eq=False, **options)
    return made if kind is None else made(kind)


class InOneLine:
    """Base of dataclasses whose `repr` is one line: arrays are shown by their shape and type."""

    def __repr__(self) -> str:
        own: Any = self
        named = [each.name for each in fields(own) if each.name in vars(self)]
        entries = ", ".join(f"{name}={_in_short(vars(self)[name])}" for name in named)
        return f"{type(self).__name__}({entries})"


class InNotebook:
    """Base of values that notebooks show with a table and a picture."""

    def _repr_html_(self) -> str | None:
        """HTML of `rastercov.report.notebook`; None, for the text alone, where none can be made."""
        try:
            return str(import_module("rastercov.report.notebook").html_of(self))
        except Exception:  # a value that cannot be drawn still has its text
            return None


def base64_of(data: Any) -> str:
    """Bytes as text of a page."""
    return base64.b64encode(data).decode("ascii")


def _in_short(value: object) -> str:
    if hasattr(value, "dtype") and hasattr(value, "shape"):
        return f"{value.shape} {value.dtype}"
    if isinstance(value, Mapping | tuple | list) and len(value) > MOST_SHOWN:
        return f"{len(value)} entries"
    return shorten(" ".join(repr(value).split()), MOST_LETTERS)


def to_install(what: str, packages: str, elsewhere: str) -> str:
    """Advice to install something, by packages of Debian on Linux, and `elsewhere`."""
    command = f"install {what} (on Debian apt-get install -y {packages})"
    return command if sys.platform == "linux" else elsewhere


def xml_text(text: str) -> str:
    """A text with "?" in place of characters that XML 1.0 and UTF-8 cannot represent."""
    return NOT_OF_XML.sub("?", text)


def exponent(value: float) -> int:
    """Decimal exponent of a number: 2 of 100 and of 999, 0 of 0."""
    return int(f"{value:.30e}".split("e")[1])


def number(value: float, digits: int = 3) -> str:
    """A number in some significant digits, or in two where it is below 1e-4: "7,640", "0.41"."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    text = f"{value:.1e}" if abs(value) < 1e-4 else f"{value:.{digits}g}"
    return f"{float(text):,.0f}" if "e+0" in text else text


def percent(share: float) -> str:
    """A share in percent, rounded neither to 100 nor to 0, beyond the rounding of doubles."""
    share = round(share, 12)
    for digits in (1, 2, 3, 6):
        text = f"{100 * share:.{digits}f}"
        if (float(text) < 100 or share >= 1) and (float(text) > 0 or share <= 0):
            return f"{text} %"
    return "99.999999 %" if share > 0.5 else "0.000001 %"


def percent_of(part: float, whole: float) -> float:
    """Percent of a whole, no more than 100 where the part is no larger; 0 of nothing."""
    return 100 * (part / whole) if whole > 0 else 0.0


def points(share: float) -> str:
    """A difference of shares in percentage points."""
    return f"{percent(share).removesuffix(' %')} percentage points"


def distinct_percents(*shares: float) -> list[str]:
    """Shares in percent, with the digits that tell shares apart that differ by 1e-8 or more."""
    percents, n = [percent(share) for share in shares], len({round(share, 8) for share in shares})
    for digits in (2, 3, 6):
        if len({*percents}) < n:
            percents = [f"{100 * share:.{digits}f} %" for share in shares]
    return percents


def with_bound(value: float, bound: float) -> str:
    """A percentage in three digits, with its bound where these are not certain: "97.1 ± 0.3 %".

    Without a bound the last digit is certain to one. A bound is that of the figure as it is shown,
    rounded up. Neither 0 nor 100 is rounded to.
    """
    if value in (0, 100) and bound <= 1e-9:
        return f"{value:.0f} %"
    places = 1 if value >= 10 else 2 if value >= 1 else 3
    for more in (places, max(places, 2), 3, 6):
        text = f"{value:.{more}f}"
        is_rounded = float(text) == 0 or (float(text) >= 100 and value < 100)
        if bound < 0.5 * float(f"1e-{more}") and (not is_rounded or (more == 6 and value > 0)):
            return percent(value / 100) if is_rounded else f"{text} %"
    digits = min(max(1, -exponent(max(bound, 1e-9))), 3)
    unit = float(f"1e-{digits}")
    shown = round(value, digits)
    if 0 < value < 100:
        shown = min(max(shown, unit), 100 - unit)
    steps = math.ceil((bound + abs(shown - value)) / unit - 1e-6)
    return f"{shown:.{digits}f} ± {max(1, steps) * unit:.{digits}f} %"


def text_with_bound(value: float, bound: float, digits: int = 4) -> str:
    """A number in the decimals that its bound leaves, and in some digits at most: "6.8", "0.00"."""
    decimals = digits - 1 - exponent(max(abs(value), bound, 1e-12))
    if bound > 0:
        decimals = min(decimals, -exponent(bound))
    return f"{round(value, decimals) + 0.0:,.{max(decimals, 0)}f}" if value else "0"


def length(metres: float) -> str:
    """A coordinate to a tenth of a millimetre, or in eight digits from 100 m on."""
    return text_with_sign(metres, 4) if abs(metres) < 100 else f"{metres:.8g}"


def area(square_metres: float, unit: str = "m", whole: float = 0.0) -> str:
    """Area as text, such as "85.2 m²": three digits. `unit` is "unit" where there is no scale.

    A part of a `whole` is in the unit of that.
    """
    if unit != "m":
        return f"{number(square_metres)} units²"
    largest = max(square_metres, whole) or 1.0
    small = 2 if largest >= 9.995e-10 else 3
    name, factor = AREAS[0 if largest >= 0.09995 else 1 if largest >= 9.995e-5 else small]
    value = square_metres * factor
    if value < 999.5 or not math.isfinite(value):
        return f"{number(value)} {name}"
    return f"{float(f'{value:.3g}'):,.0f} {name}"


def distance(value: float, unit: str = "m") -> str:
    """A distance as text, such as "0.41 m", "4.1 mm" or "0.41 units"; `unit` as of `area`."""
    if unit == "m" and 0 < value < 0.01:
        return f"{number(1e3 * value)} mm"
    return f"{number(value)} {'m' if unit == 'm' else 'units'}"


def sampling(value: float, unit: str = "m") -> str:
    """Ground sampling distance as text, of its value in a unit as of `area`: "1.2 mm/px"."""
    return f"{number(1e3 * value)} mm/px" if unit == "m" else f"{number(value)} units/px"


def size_in_words(extent: float | Iterable[float]) -> str:
    """Lengths in metres as text, such as "85 x 62 x 20 m": three digits, one unit for all."""
    lengths = [float(each) for each in (extent if isinstance(extent, Iterable) else [extent])]
    largest = max(lengths)
    unit, factor = next(
        (each for each in (("m", 1.0), ("mm", 1e3)) if largest * each[1] >= 1), ("µm", 1e6)
    )
    digits = decimals_of(largest * factor)
    return " x ".join(in_decimals(length * factor, digits) for length in lengths) + f" {unit}"


def in_decimals(value: float, digits: int) -> str:
    """`value` with at most these decimals and no zeros at their end; more where it would be 0."""
    text = f"{value:,.{digits}f}"
    if value and not text.rstrip("0").rstrip(".").rstrip("0").rstrip("-"):
        return number(value)
    return text.rstrip("0").rstrip(".") if "." in text else text


def decimals_of(largest: float) -> int:
    """Decimals that give three digits of the largest of some numbers, 0 to 9."""
    return min(9, max(0, 2 - exponent(max(largest, 1e-9))))


def text_with_sign(value: float, digits: int = 2) -> str:
    """A number with a fixed count of decimals, without the sign of -0.00."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def coordinates(point: Iterable[float], least: int) -> str:
    """Coordinates in at least some decimals, and in two digits of the largest."""
    values = [float(value) for value in point]
    digits = max(least, decimals_of(max(map(abs, values)) or 1.0) - 1)
    return ", ".join(text_with_sign(value, digits) for value in values)


def shorten(text: str, most: int) -> str:
    """A text of at most `most` characters: begin and end, with "..." for what is between."""
    if len(text) <= most:
        return text
    begin = (most - 3) // 2
    return f"{text[:begin]}...{text[len(text) - (most - 3 - begin) :]}"


def shown(value: object) -> str:
    """`value` in at most `LONGEST_SHOWN` characters on one line, whatever it is."""
    return shorten(" ".join(reprlib.repr(value).split()), LONGEST_SHOWN)


def first_of(names: Sequence[str], most: int = 5) -> str:
    """The first of some names, and how many more there are: "a, b and 3 more"."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def plural(count: int, noun: str, action: str = "") -> str:
    """A count, its noun, and its verb if any: "1 pose", "1,200 poses", "1 image sees"."""
    if count != 1:
        noun = noun.replace("vertex", "vertice").replace("mesh", "meshe") + "s"
    return f"{count:,} {noun}{' ' if action else ''}{verb(count, action)}"


def verb(count: int, action: str) -> str:
    """A verb, given for several, as it goes with a count: "covers" for 1, "cover" for others."""
    first, _, rest = action.partition(" ")
    if count != 1 or first in ("", "may", "could"):
        return action
    own = {"are": "is", "were": "was", "have": "has", "do": "does"}.get(first, f"{first}s")
    return f"{own} {rest}" if rest else own
