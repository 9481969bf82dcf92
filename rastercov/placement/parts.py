"""Rows of a table of parts, at a level of the tree of groups, from the summary of a network.

The levels of the name of a group are separated by "/": level 1 are the outermost parts, and the
groups are the leaves.
"""

from typing import NamedTuple

from rastercov.base import ReadByName
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh.groups import parts_above

MOST_ROWS = 12
"""Rows of a table at first sight."""


def entries_at(summary: ReadByName, level: int | None) -> list[ReadByName]:
    """Figures of the parts at a level, and of the groups that are above it or at it.

    Unless given, the level is the deepest with at most `MOST_ROWS` of them to be seen, or 1.
    """
    depth = {group["name"]: 1 + len(parts_above(group["name"])) for group in summary["groups"]}
    deepest = max(depth.values())
    for each in range(deepest, 0, -1) if level is None else [min(level, deepest)]:
        table = {
            group["name"]: group for group in summary["groups"] if depth[group["name"]] <= each
        }
        table |= {part["name"]: part for part in summary["parts"] if part["level"] == each}
        if sum("covered" in entry for entry in table.values()) <= MOST_ROWS:
            break
    return list(table.values())


class PartRow(NamedTuple):
    """Row of a table of parts.

    Attributes
    ----------
    name : str
    area_m2 : float
    percent, bound_percent : float
        Covered, of its area, or of its faces where the result is by face, which have no bound.
    of_seeable_percent : float or None
        Covered, of its area that can be seen; None where none can be.
    reason : str
        Words on the reason of most of the area that can be seen and is not covered, or of what
        cannot; none where all is covered.
    """

    name: str
    area_m2: float
    percent: float
    bound_percent: float
    of_seeable_percent: float | None
    reason: str

    @classmethod
    def of(cls, entry: ReadByName) -> "PartRow":
        """Row of the figures of a part, a group or the whole task."""
        name = entry.get("name", "whole task")
        name += " (target)" if entry.get("role") == "target" else ""
        figures = entry.get("covered_area", entry["covered"])
        percent, bound = figures["percent"], figures.get("bound_percent", 0.0)
        why = entry.get("seeable_not_covered_because", {})
        is_hidden = entry.get("unseeable_m2", 0) > 0
        most = max(why, key=lambda each: float(why[each]["area_percent"]), default="")
        most = most or "unseeable" * is_hidden
        reason = REASONS[most].label if most and percent < 100 else ""
        of_seeable = entry["covered_of_seeable_percent"]
        return cls(name, entry["area_m2"], percent, bound, of_seeable, reason)


def part_rows(summary: ReadByName, level: int | None = None) -> list[PartRow]:
    """Rows of the parts to be seen at a level, the least covered first; see `entries_at`.

    `summary` is `summary.json`, or `network` of `plan.json`.
    """
    rows = [PartRow.of(entry) for entry in entries_at(summary, level) if "covered" in entry]
    return sorted(rows, key=lambda row: row.percent)
