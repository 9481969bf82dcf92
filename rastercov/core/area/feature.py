"""Conditions on what cameras see, of a feature that can be deleted; `features` has all of them.

A rig says which take part. What a feature lacks is as here, where it adds nothing.

Figures of areas in words, and those of a feature that can be deleted, beside a network's.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Protocol

from rastercov.base import (
    BoolArray,
    ByName,
    ByteArray,
    FloatArray,
    IntArray,
    ReadByName,
    WholeArray,
    percent,
    plural,
    with_bound,
)
from rastercov.core.area.table import Condition, Finder, Regions
from rastercov.core.camera import Camera, Cameras, Gate, Poses
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh

Alone = Callable[[int], ByName]
"""Covered area of a camera by itself, by its index."""
DOUBTFUL = ("doubtful_percent", "doubtful_m2")
"""Figures of what is seen edge-on."""
NEEDS = ": half of the zone needs "
"""Before changes of a rig itself in advice."""


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
    if percent(figures.get("doubtful_percent", 0.0) / 100) != percent(0):
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


Scene = tuple[Mesh, Cameras, Task]
"""Mesh, cameras and thresholds."""
Points = tuple[FloatArray, IntArray]
"""Points of faces, (N, 3) metres and (N,)."""
Judge = Callable[
    [Mesh, Cameras, Task, Poses, FloatArray, IntArray],
    Iterator[tuple[IntArray, ByteArray, IntArray]],
]
"""Function `rastercov.core.area.stages.failures_of_rows`."""


class PointCondition(Protocol):
    """A condition at points of faces, (N,); one thread may use it."""

    def reasons(self, own: Poses, sees: BoolArray | None = None) -> ByteArray:
        """(N,) row of `REASONS` for the poses of a row of the result, `COVERED` where it holds.

        On the side of the face that the first pose is on; or, of points that cameras of a rig with
        a rule see, (n, N), on the side from which they meet it, the better of two.
        """


class Feature:
    """Hooks of a feature, which do nothing here."""

    figures: type[Figures] = Figures
    """Further figures of a run by area."""

    def narrow(self, camera: Cameras, task: Task) -> Task:
        """The task within the limits that the equipment of cameras has."""
        return task

    def check_bodies(self, camera: Cameras, bodies: Sequence[str]) -> None:
        """Raise `ConfigError` where cameras cannot be on these bodies, one for each."""

    def condition(
        self,
        mesh: Mesh,
        camera: Cameras,
        task: Task,
        find: Callable[[Sequence[Camera]], Finder],
    ) -> Condition | None:
        """Condition on the regions of cameras; `find` makes a finder of regions of others."""

    def cut_rigs(self, regions: Regions, gate: Gate, devices: Regions) -> Regions:
        """Part of what rigs cover where their gate holds beyond its count."""
        return regions

    def stages(self, camera: Cameras, task: Task) -> Iterator[tuple[int, Cameras, Task]]:
        """Rows of `REASONS` of its criteria that are asked, with cameras and task without each."""
        yield from ()

    def at_points(
        self, mesh: Mesh, camera: Cameras, task: Task, points: FloatArray, face: WholeArray
    ) -> PointCondition | None:
        """The same at points of faces, (N, 3) metres."""

    def device(
        self, camera: Cameras, lead: Poses, point: FloatArray, normal: FloatArray, reason: int
    ) -> str | None:
        """Name of the device that fails a point, (3,), for a row of `REASONS`, in one pose."""

    def measure(
        self, scene: Scene, points: FloatArray, face: WholeArray, lead: Poses, reason: int
    ) -> tuple[str, ByName]:
        """Words and entries on what points miss, (N, 3), for a row of `REASONS`, in one pose."""
        return "", {}

    def unmet(self, judge: Judge, regions: Regions, scene: Scene, poses: Poses) -> list[str]:
        """Lines on limits that nothing meets, by the regions of each pose."""
        return []

    def advice(
        self, judge: Judge, scene: Scene, poses: Poses, on: Points, *, is_tried: bool
    ) -> str:
        """Text on how far rigs in these poses miss limits at points, and what helps.

        "" where no limit of it is missed.
        """
        return ""

    def deviations(self, camera: Cameras, own: Poses, points: FloatArray) -> FloatArray | None:
        """(N,) standard deviations of points, metres, by the poses of a row; None for no limit."""

    def values(self, mesh: Mesh, camera: Cameras, task: Task) -> ReadByName:
        """Values of faces by the names of `rastercov.report.modes`."""
        return {}
