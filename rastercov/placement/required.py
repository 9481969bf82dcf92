"""Required shares: their status by a share with its bounds, and the line on it."""

from rastercov.base import percent
from rastercov.base.format import points

HOLDS, FAILS, UNDECIDED = "holds", "fails", "undecided"
SHARE_TOLERANCE = 1e-9
"""Absolute tolerance of a required share: 0.98 is not a binary fraction."""


def status_of(low: float, high: float, limit: float, *, is_most: bool = False) -> str:
    """Status of a share between two bounds that is to reach a limit, or not to exceed it."""
    if is_most:
        low, high, limit = -high, -low, -limit
    needed = limit - SHARE_TOLERANCE
    return HOLDS if low >= needed else UNDECIDED if high >= needed else FAILS


def short_by(share: float, limit: float, status: str, *, is_most: bool) -> float:
    """Difference between limit and share; 0 if the requirement holds."""
    short = share - limit if is_most else limit - share
    return 0.0 if status == HOLDS else max(0.0, short)


def share_of(part: float, whole: float) -> float:
    """Share of an area, [0, 1]; 1 of nothing."""
    return min(max(part / whole, 0.0), 1.0) if whole > 0 else 1.0


def ends_in_words(low: float, high: float) -> str:
    """Words on the bounds of a share of an area."""
    return f"the error bound allows {100 * low:.9g} % to {100 * high:.9g} %"


def outcome_line(
    start: str,
    status: str,
    limits: tuple[float, float | None],
    short: float,
    uncovered: str,
    ends: str,
    *,
    is_most: bool,
) -> str:
    """Line on a requirement after its name and share.

    `limits` are the share that is required and, or None, that of the plan where it is another; the
    others are as of `Requirement`.
    """
    of_plan = "" if limits[1] is None else f" ({percent(limits[1])} in the plan)"
    asked = "permitted at most" if is_most else "required"
    text = f"{start}{percent(limits[0])} {asked}{of_plan}"
    if status == FAILS:
        end = "too much" if is_most else f"below the goal, {uncovered} uncovered"
        return f"{text}, {points(short)} {end}"
    if status == UNDECIDED:
        return f"{text}, undecided: {ends}"
    return f"{text}: proved" if is_most else text
