"""Figures of areas in words, and those of a feature that can be deleted, beside a network's."""

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from rastercov.base import BoolArray, ByName, FloatArray, ReadByName, percent, plural, with_bound
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses
from rastercov.core.coverage.task import Task

Alone = Callable[[int], ByName]
"""Covered area of a camera by itself, by its index."""
DOUBTFUL = ("doubtful_percent", "doubtful_m2")
"""Figures of what is seen edge-on."""


class Areas(Protocol):
    """Covered area of regions that are added, an `AreaNetwork`."""

    @property
    def closed(self) -> BoolArray:
        """(F,) faces that need no further regions."""

    def add(self, regions: Regions) -> None:
        """Take in the regions of further poses."""

    def summary(self) -> ByName:
        """Covered area of all evaluated faces, ready for JSON."""


def most_off(figures: ReadByName, unit: str) -> float:
    """Largest error of a covered area, either way, "m2" or "percent"."""
    return float(figures[f"bound_{unit}"] + figures.get(f"doubtful_{unit}", 0.0))


def in_words(figures: ReadByName, noun: str = "camera") -> str:
    """Covered area with its bound, in words; `noun` is a word for a pose."""
    text = f"{with_bound(figures['percent'], figures['bound_percent'])} of the area"
    if "doubtful_percent" in figures:
        text += f", up to {percent(figures['doubtful_percent'] / 100)} more is visible edge-on"
    if isinstance(figures["views"], int) and figures["views"] > 1:
        fewer = [(each["percent"] / 100, each["views"]) for each in figures["by_views"][:-1]]
        text += f", by at least {plural(figures['views'], noun)}"
        some = (f"; {percent(share)} by at least {views}" for share, views in fewer if share > 0)
        text += "".join(some)
    return text


class Figures:
    """Figures of a run by area; `used` are the cameras with figures of their own."""

    def __init__(
        self, new: Callable[[], Areas], camera: Cameras, task: Task, used: Iterable[int]
    ) -> None: ...

    @property
    def needs_all(self) -> bool:
        """True where no face may be left out of regions."""
        return False

    def networks(self) -> Iterable[Areas]:
        """All that regions are added to."""
        return ()

    def add(self, regions: Regions, camera: Cameras, poses: Poses) -> None:
        """Take in the regions of further poses, each by itself."""

    def summary(self, alone: Alone) -> ByName:
        """Entries of a summary, ready for JSON."""
        return {}

    def of_faces(self) -> Mapping[str, FloatArray]:
        """(2, F) figures of faces and their bounds by names with units, 0 where there is none."""
        return {}

    @staticmethod
    def lines(summary: ReadByName) -> list[str]:
        """Lines for people on these entries of a summary."""
        return []

    @staticmethod
    def doubts(summary: ReadByName) -> list[str]:
        """Lines on entries that are likely to be mistakes."""
        return []
