"""Figures of each camera of a rig alone, for a terminal and a page."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table
from rich.text import Text

from rastercov.base.format import area, percent, plural


def camera_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Name, poses, covered area or faces, and its share, of each camera; often none."""
    rows = []
    for entry in summary.get("by_camera", ()):
        covered = entry.get("covered_area")
        size = plural(entry["covered"]["faces"], "face") if covered is None else area(covered["m2"])
        share = (covered or entry["covered"])["percent"]
        rows.append([entry["camera"], f"{entry['poses']:,}", size, percent(share / 100)])
    return rows


def camera_table(summary: Mapping[str, Any], most: int = 20) -> Table | None:
    """Figures by camera for a terminal of 80 columns; None where there are none."""
    rows = camera_rows(summary)
    if not rows:
        return None
    table = Table(title="Covered by each camera alone", title_justify="left")
    table.add_column("camera", no_wrap=True, max_width=30)
    for name in ("poses", "covered", "share"):
        table.add_column(name, justify="right", no_wrap=True)
    for name, *figures in rows[:most]:
        table.add_row(Text(name), *figures)
    if rows[most:]:
        table.add_row(f"... {len(rows) - most} more", style="dim")
    return table
