"""Carriers of the cameras of a plan by joints, and hooks for it.

`carrier_of` has that of a plan.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

from rastercov.base import BoolArray, ByName, FloatArray, hooks_of
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.table import Regions
from rastercov.core.camera import Poses
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import Refined
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.generator import Generator


class CarriedPoses(Protocol):
    """K chosen poses as they are carried."""

    @property
    def joints(self) -> FloatArray:
        """(K, J) values of the joints of the carrier."""

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
        """Texts of files, by the names of `CarrierHooks.files`."""

    def line(self) -> str:
        """The joints in words."""


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

    def reaches(self, pose: FloatArray, camera: int) -> bool:
        """True where it brings a camera, by its row, to a world_from_camera without a collision."""


class CarrierHooks:
    """Hooks of a feature that carries cameras, where `Generator.is_carried`."""

    key: str
    """Its entry in the outcome of a plan."""
    files: Sequence[str] = ()
    """Names of files of a placement."""

    def make(
        self,
        plan: Plan,
        mesh: Mesh,
        entry: Generator,
        make: Callable[[Generator], Iterator[Candidates]],
    ) -> Iterator[Candidates]:
        """Candidates that it can carry, of those that an entry names."""
        raise NotImplementedError  # each feature has its own

    def carrier(self, plan: Plan, mesh: Mesh) -> Carrier | None:
        """Carrier of the cameras of a plan; None where they are placed one by one."""
        raise NotImplementedError  # each feature has its own


def carriers() -> tuple[CarrierHooks, ...]:
    """Hooks of all features."""
    return hooks_of(CarrierHooks)


def carrier_of(plan: Plan, mesh: Mesh) -> Carrier | None:
    """Carrier of the cameras of a plan; None where they are placed one by one."""
    result = (each.carrier(plan, mesh) for each in carriers())
    return next((carrier for carrier in result if carrier is not None), None)
