"""Cameras of a plan that are moved by joints, such as those of an arm; see `scene.carrier_of`."""

from dataclasses import dataclass
from typing import Any, Protocol

from rastercov.base.format import distance, plural
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.camera.pose import Poses
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.area.table import Regions
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import Refined

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
