"""Results over time in reports: colours of faces, pictures and tables."""

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

from rastercov.motion.over_time import TimeAreas
from rastercov.report.modes import Mode, ReportHooks, by_share

TIME = "Share of the time in which each part is covered."
NEVER = "never covered, even in part"
NOW = "Share of each part that is covered in this frame."


class OfTime(ReportHooks):
    """Results over time."""

    pictures: Mapping[str, str] = MappingProxyType(
        {
            "time": "Share of the time in which each part is covered, from two sides",
            "frames": "Frames side by side, with what is covered in each",
        }
    )
    tables = ("frames",)

    def part(self, areas: object) -> Any:
        """See `ReportHooks`."""
        from rastercov.motion.report import TimePart  # with a page only

        return TimePart(areas.over_time) if isinstance(areas, TimeAreas) else None


HOOKS = OfTime(
    time=Mode("Share of time", TIME, partial(by_share, none=NEVER), of="phases"),
    now=Mode("Covered in this frame", NOW, by_share, of=""),
)
