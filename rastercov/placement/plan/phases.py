"""Hooks of plans for features: phases of the scene, carriers of cameras, and products.

Phases are such as frames in which bodies of the scene move: `phases_of` has those of a plan. A
carrier moves cameras by joints: `carrier_of` has that of a plan. Products are made for placed
cameras, and demands check them.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol, Self

from rastercov.base import BoolArray, ByName, FloatArray, IntArray, hooks_of
from rastercov.core.area.cells import Cells
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses
from rastercov.core.coverage.coverage import Observer
from rastercov.core.coverage.evaluation import Phases
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import Refined
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.plan.entries import Table
from rastercov.placement.plan.file import Plan, PlanFeature
from rastercov.placement.plan.generator import Generator
from rastercov.placement.plan.network import Requirement
from rastercov.placement.plan.rig_parts import Kept
from rastercov.placement.required import HOLDS
from rastercov.shards import Progress


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


class Phase(NamedTuple):
    """The scene and the cameras in a phase; `at_rest` brings regions there to those at rest."""

    mesh: Mesh
    placed: Poses
    at_rest: Callable[[Regions], Regions]


class PhaseMatrix(NamedTuple):
    """Visibility matrix of candidates in all phases, and what all of them cover together.

    Attributes
    ----------
    weights : (N,) float64
        Of its elements.
    reachable : AreaNetwork or None
        Area that all candidates cover together, where the plan asks for a share of it.
    """

    matrix: VisibilityMatrix
    elements: Mesh
    weights: FloatArray
    reachable: AreaNetwork | None


class PlanPhases(Protocol):
    """Phases of the scene of a plan, and the number of them in which a point must be covered."""

    @property
    def asked(self) -> Phases:
        """The same for a query."""

    @property
    def mesh(self) -> Mesh:
        """The scene at rest."""

    @property
    def count(self) -> int:
        """Number of phases."""

    def body_of(self, camera: str) -> str:
        """Body that carries a camera, by its name."""

    def carrying(self, cameras: Sequence[str]) -> Self:
        """The same for cameras of some names."""

    def place(self, at: Sequence[float]) -> tuple[Mesh, IntArray, dict[str, FloatArray]]:
        """The mesh in a phase, the face at rest of each of its faces, and poses of bodies by name.

        `at` has the number of a phase, and perhaps values of joints in place of those that they
        have there; ConfigError for a phase that is none, and joints outside their limits.
        """

    def describe(self) -> ByName:
        """Entries for the scene of a page, ready for JSON."""

    def values(self, camera: Cameras, placed: Poses, task: Task) -> Mapping[str, FloatArray]:
        """Values of faces, (F,), over all phases by the names of `rastercov.report.modes`."""

    def each(self, camera: Cameras, placed: Poses) -> Iterator[Phase]:
        """Each phase, with the cameras of poses at rest."""

    def areas(
        self,
        camera: Cameras,
        placed: Poses,
        task: Task,
        regions: Regions | None = None,
        kept: Kept | None = None,
    ) -> AreaNetwork:
        """Area that is covered in enough phases; `regions` are regions that are known."""

    def long_enough(self, regions: Regions, views: int) -> Regions:
        """Parts that at least `views` cameras cover in enough phases; one row."""

    def first(self, areas: AreaNetwork, count: int) -> AreaNetwork:
        """The same as `areas` by the first rows of each phase."""

    def is_mean(self, task: Task) -> bool:
        """True where elements of `matrix` are of single phases: their mean is not what is asked."""

    def matrix(
        self,
        plan: Plan,
        observer: Observer,
        cells: Cells,
        poses: Poses,
        task: Task,
        progress: Progress,
    ) -> PhaseMatrix:
        """Visibility matrix of candidates in all phases; poses are those of mounts."""


class CarriedPoses(Protocol):
    """K chosen poses as they are carried."""

    @property
    def joints(self) -> FloatArray:
        """(K, J) values of the joints of the carrier."""

    @property
    def order(self) -> IntArray:
        """(K,) poses in the order in which it comes to them."""

    @property
    def is_hidden(self) -> BoolArray:
        """(K,) True where the carrier hides too much of the image, whatever its joints."""

    def with_joints(self, joints: FloatArray) -> "CarriedPoses":
        """The same with other values of joints."""

    def hides(self) -> str:
        """Note where it hides too much of an image."""

    def to_json(self) -> ByName:
        """Joints of each pose, and figures of the carrier."""

    def files(self) -> Mapping[str, str]:
        """Texts of files, by the names of `PlanScene.files`."""

    def line(self) -> str:
        """The joints in words."""

    def table(self) -> tuple[Sequence[str], list[list[str]]]:
        """Headings, and rows: at rest, and for each pose in their `order`."""


class Carrier(Protocol):
    """Moves the cameras of a plan by joints, and occludes a part of their images."""

    def measure(
        self, finder: RegionPass, mounted: Poses, known: FloatArray | None
    ) -> tuple[list[Regions], CarriedPoses]:
        """Regions of each of K mounts with it in the image, and its joints.

        Parameters
        ----------
        finder : RegionPass
            Of the scene without it.
        known : (N, J) float64, optional
            Joints that are taken for poses that they lead to, before any other.
        """

    def refine(
        self, objective: Objective, mounted: Poses, joints: FloatArray, budget: int
    ) -> tuple[Refined, FloatArray]:
        """Cameras after moves of single joints that gain, and the joint angles."""

    def parts(self, joints: FloatArray) -> Sequence[Mesh | None]:
        """Parts that a drawing tells apart at joints (J,): links in turn, tool; None if empty."""

    def reaches(self, pose: FloatArray, camera: int) -> bool:
        """True where it brings a camera, by its row, to a world_from_camera without a collision."""


class PlanScene(PlanFeature):
    """Hooks of a feature that gives a plan phases, or carries cameras; they do nothing here."""

    sections: tuple[str, ...] = ()
    """Sections of a plan that phases are made of, the one that has to be there first."""
    key = ""
    """Entry in the outcome of a plan, of what carries cameras."""
    files: Sequence[str] = ()
    """Names of files of a placement."""

    def phases(self, plan: Plan, mesh: Mesh) -> PlanPhases | None:
        """Phases of the scene of a plan; PlanError for what goes with none."""
        return None

    def table(self, plan: Plan, mesh: Mesh) -> tuple[Mesh, Table] | None:
        """Scene that turns, and its axis for a carrier; ConfigError for a task beside it."""
        return None

    def make(
        self,
        plan: Plan,
        mesh: Mesh,
        entry: Generator,
        make: Callable[[Generator], Iterator[Candidates]],
    ) -> Iterator[Candidates]:
        """Candidates that it can carry, of those of an entry; see `Generator.is_carried`."""
        raise NotImplementedError  # each feature has its own

    def carrier(self, plan: Plan, mesh: Mesh) -> Carrier | None:
        """Carrier of the cameras of a plan; None where they are placed one by one."""
        return None


def hooks() -> tuple[PlanScene, ...]:
    """Hooks of all features."""
    return hooks_of(PlanScene)


def phases_of(plan: Plan, mesh: Mesh) -> PlanPhases | None:
    """Phases of the scene of a plan; None where it has one."""
    result = (each.phases(plan, mesh) for each in hooks())
    return next((phases for phases in result if phases is not None), None)


def carriers() -> list[PlanScene]:
    """Hooks of features that carry cameras."""
    return [each for each in hooks() if each.key]


def carrier_of(plan: Plan, mesh: Mesh) -> Carrier | None:
    """Carrier of the cameras of a plan; None where they are placed one by one."""
    result = (each.carrier(plan, mesh) for each in hooks())
    return next((carrier for carrier in result if carrier is not None), None)
