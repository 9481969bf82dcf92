"""Views that a carrier or a constraint rejects, each with its reason."""

from collections.abc import Sequence
from typing import NamedTuple

from rastercov.base import ByName, FloatArray, size_in_words
from rastercov.base.format import number

MOST_REASONS = 6
"""Reasons that a line names."""


class Refusal(NamedTuple):
    """A rejected view.

    Attributes
    ----------
    pose : (4, 4) float64
        world_from_camera.
    source : str
        Its generator.
    reason : str
        Kind of the reason, such as "out_of_reach" or "collision".
    words : str
        In words, such as "head collides with table".
    lack : float
        Minimum amount by which the view fails; 0 if unknown.
    unit : {"m", "deg"}
    camera : int
        Index of the camera.
    """

    pose: FloatArray
    source: str
    reason: str
    words: str
    lack: float = 0.0
    unit: str = "m"
    camera: int = 0


def by_words(refusals: Sequence[Refusal]) -> list[ByName]:
    """Number of views by reason in words, and the smallest lack among them; most first."""
    figures_by_key: dict[str, ByName] = {}
    for each in refusals:
        new = {"reason": each.reason, "what": each.words, "views": 0, "unit": each.unit}
        entry = figures_by_key.setdefault(each.words, new | {"least_lack": each.lack})
        entry["views"] += 1
        entry["least_lack"] = min(entry["least_lack"], each.lack)
    return sorted(figures_by_key.values(), key=lambda each: -int(each["views"]))


def in_words(refusals: Sequence[Refusal]) -> str:
    """Counts of reasons: "22 out of reach, 8 head collides with table (by 3 mm or more)"."""
    parts, every = list[str](), by_words(refusals)
    for each in every[:MOST_REASONS]:
        least = each["least_lack"]
        by = size_in_words(least) if each["unit"] == "m" else f"{number(least)} degrees"
        parts.append(f"{each['views']} {each['what']}" + (f" (by {by} or more)" if least else ""))
    if len(every) > MOST_REASONS:
        parts.append(f"{sum(each['views'] for each in every[MOST_REASONS:])} for other reasons")
    return ", ".join(parts)
