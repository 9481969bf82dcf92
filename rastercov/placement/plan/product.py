"""Products of features for placed cameras, and their demands on checked ones."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, Self

from rastercov.base import ByName, hooks_of
from rastercov.core.camera import Poses
from rastercov.core.mesh import Mesh
from rastercov.placement.plan.file import Plan, PlanFeature
from rastercov.placement.plan.network import Requirement
from rastercov.placement.required import HOLDS


class Figure(NamedTuple):
    """A drawing of a page: heading, HTML and caption."""

    heading: str
    drawing: str
    caption: str


class Product:
    """Product of a feature for placed cameras."""

    word = ""
    """Its entry of JSON."""

    @property
    def north(self) -> float | None:
        """Direction from which it has headings, as of `mounting_angles`, if any."""
        return None

    @property
    def refused(self) -> list[str]:
        """Sentences, with their subject before a colon, for which a page is not to be signed."""
        return []

    @property
    def notes(self) -> list[str]:
        """Sentences on what to look at."""
        raise NotImplementedError  # each feature has its own

    def summary(self) -> ByName:
        """Figures, ready for JSON."""
        raise NotImplementedError  # each feature has its own

    def lines(self) -> list[str]:
        """Sentences."""
        raise NotImplementedError  # each feature has its own

    def files(self) -> dict[str, bytes]:
        """Content of its files by their names."""
        raise NotImplementedError  # each feature has its own

    def figure(self) -> Figure:
        """Its drawing."""
        raise NotImplementedError  # each feature has its own

    def section(self) -> str:
        """HTML of its tables, of a step."""
        raise NotImplementedError  # each feature has its own


class Judged(Protocol):
    """A requirement with its status, "fails", or what begins with "holds", or another."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def status(self) -> str:
        """Its status."""

    def words(self) -> str:
        """It in one line."""


class Verdicts(Product):
    """Requirements of a rig under what a feature demands.

    Attributes
    ----------
    of : str
        Words on the demand.
    as_planned : str
        Words on goals that hold without it.
    verdicts : sequence of Judged
    """

    of = as_planned = ""
    verdicts: Sequence[Judged]

    @property
    def holds(self) -> bool:
        """True where each requirement holds."""
        return all(each.status.startswith(HOLDS) for each in self.verdicts)

    def worst(self) -> ByName | None:
        """Poses that are furthest below a requirement, or nearest to it, as a pose file."""

    def pictures(self) -> Mapping[str, object]:
        """Pictures of a page by their names."""
        return {}


class Demand:
    """A demand of a feature; nothing here."""

    word = ""
    """Its argument of `check`."""
    of = ""
    """Words on it."""

    def read(self, text: str) -> Self:
        """The demand of a text; ConfigError for another one."""
        raise NotImplementedError  # each feature has its own

    def check(self, plan: Plan, rig: Poses) -> None:
        """ConfigError for a plan that it does not go with, before the work."""

    def check_scene(self, plan: Plan, mesh: Mesh) -> None:
        """ConfigError for a scene that it does not go with."""

    def verdicts(
        self,
        plan: Plan,
        mesh: Mesh,
        rig: Poses,
        requirements: Sequence[Requirement],
        views: int | None,
    ) -> Verdicts:
        """The verdict of each requirement."""
        raise NotImplementedError  # each feature has its own


def demand_of(word: str, text: str | None) -> Demand:
    """Demand of a text, by the argument that it was given for; none for None."""
    if text is None:
        return Demand()
    demands = (each.demand for each in hooks_of(PlanFeature))
    return next(each for each in demands if each and each.word == word).read(text)
