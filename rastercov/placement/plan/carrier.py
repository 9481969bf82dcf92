"""Motion in a plan: of the cameras, by joints such as those of an arm, or the scene over time.

`scene.carrier_of` and `scene.timed_of` have that of a plan.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self

from rastercov.base.format import distance, plural
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.area.table import Regions
from rastercov.coverage.observer import Observer
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import Refined
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.plan.file import Plan
from rastercov.shards import Progress

MOST_LOST = 0.5
"""Percentage points of the task area that it may occlude in the image of its camera."""


@dataclass(frozen=True, eq=False)
class CarriedPoses:
    """Joint angles of K chosen poses.

    Attributes
    ----------
    joint_names : tuple of str
    joints : (K, J) float64
    clearance, lost : (K,) float64
        Metres; points of the task's area that it hides.
    order : (K,) int64
        Poses in the order of a short tour from rest.
    length : float
        Of the tour: the largest move of a joint, radians or metres, of all its ways together.
    flips : int
        Ways in which a wrist joint, of the last three that turn, moves by more than 90 degrees.
    """

    joint_names: tuple[str, ...]
    joints: FloatArray
    clearance: FloatArray
    lost: FloatArray
    order: IntArray
    length: float
    flips: int

    @property
    def is_hidden(self) -> BoolArray:
        """(K,) True where too much is hidden, whichever solution is taken."""
        return self.lost > MOST_LOST

    def to_json(self) -> dict[str, Any]:
        """Joint angles of each pose, its clearance, what is hidden, and the tour."""
        return {
            "joint_names": self.joint_names,
            "joints": self.joints,
            "clearance_m": self.clearance,
            "hidden_by_arm_percent": self.lost,
            "tour": self.order,
            "tour_length": self.length,
            "wrist_flips": self.flips,
        }

    def hides(self) -> str:
        """Note where it hides too much of an image."""
        most = f"{self.lost.max():.2f} percentage points of the area"
        return (
            f"the arm hides up to {most} from its camera: check its mount; dead zones leave the "
            "arm out of reasons and advice"
        )

    def csv(self) -> str:
        """Joint angles in the order of the tour, as `Robot.read_path` reads them."""
        rows = [",".join(map(repr, row)) for row in self.joints[self.order].tolist()]
        return "\n".join([",".join(self.joint_names), *rows, ""])

    def line(self) -> str:
        """Joint angles in words."""
        if not len(self.clearance):
            return "no pose was chosen, so joints.csv is empty"
        least = distance(float(self.clearance.min()))
        most = float(self.lost.max(initial=0.0))
        flips = plural(self.flips, "wrist flip")
        text = f"joint angles along a tour with {flips}: joints.csv"
        text += f"; minimum link clearance {least}"
        text += f"; the arm hides up to {most:.2f} percentage points of an image"
        better = ", and no alternative is better"
        return text + (better if most > MOST_LOST else "")


class Carrier(Protocol):
    """Moves the cameras of a plan by joints, and occludes a part of their images."""

    def measured(
        self, finder: RegionPass, mounted: Poses, known: FloatArray | None
    ) -> tuple[list[Regions], CarriedPoses]:
        """Regions of each of K mounts with it in the image, and its joint angles.

        Parameters
        ----------
        finder : RegionPass
            Of the scene without it.
        known : (N, J) float64, optional
            Joint angles that are taken for poses that they lead to, before any other.
        """

    def refined(
        self, objective: Objective, mounted: Poses, joints: FloatArray, budget: int
    ) -> tuple[Refined, FloatArray]:
        """Cameras after moves of single joints that gain, and the joint angles."""

    def reaches(self, pose: FloatArray, camera: int) -> bool:
        """True where it brings a camera, by its row, to a world_from_camera without a collision."""


class Moment(NamedTuple):
    """The scene and the cameras at one time; `at_rest` brings regions there to those at rest."""

    mesh: Mesh
    placed: Poses
    at_rest: Callable[[Regions], Regions]


class TimeMatrix(NamedTuple):
    """Visibility matrix of candidates over time, and what all of them cover together.

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


class Timed(Protocol):
    """Moments of a scene, and for how long of them a point must be covered."""

    @property
    def mesh(self) -> Mesh:
        """The scene at rest."""

    def body_of(self, camera: str) -> str:
        """Body that carries a camera, by its name."""

    def carrying(self, cameras: Sequence[str]) -> Self:
        """The same for cameras of some names."""

    def placed(self, at: Sequence[float]) -> tuple[Mesh, IntArray, dict[str, FloatArray]]:
        """The mesh at a time, the face at rest of each of its faces, and poses of bodies by name.

        A time is a frame, and perhaps the joints of robots in place of those that they have there;
        ConfigError for a frame that is none, and joints outside their limits.
        """

    def described(self) -> dict[str, Any]:
        """Motion and joints for a page, ready for JSON."""

    def share_of_time(self, camera: Cameras, placed: Poses, task: Task) -> FloatArray:
        """(F,) mean share, over a face, of the time in which it is covered."""

    def moments(self, camera: Cameras, placed: Poses) -> Iterator[Moment]:
        """Each moment, with the cameras of poses at rest."""

    def areas(
        self, camera: Cameras, placed: Poses, task: Task, found: Regions | None = None
    ) -> AreaNetwork:
        """Area that is covered long enough; `found` are regions that are known."""

    def long_enough(self, regions: Regions, views: int) -> Regions:
        """Parts that at least `views` cameras cover for long enough; one row."""

    def first(self, areas: AreaNetwork, count: int) -> AreaNetwork:
        """The same as `areas` by the first rows of each moment."""

    def matrix(
        self,
        plan: Plan,
        observer: Observer,
        cells: Cells,
        poses: Poses,
        task: Task,
        progress: Progress,
    ) -> TimeMatrix:
        """Visibility matrix of candidates over time; poses are those of mounts."""
