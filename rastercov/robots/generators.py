"""Generator of candidates on an arm, in plan files."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rastercov.placement.plan.entries import BaseEntry, Name, NotNegative, Number, Some
from rastercov.placement.plan.generator import Generator
from rastercov.placement.plan.generators import Reachable


class OnArm(Generator):
    """Views of another generator that the arm of a robot reaches without a collision."""

    generator: Literal["on_arm"]
    body: Name
    """Link that carries the camera: NAME/LINK of a body with urdf."""
    of: Annotated[Reachable, Field(discriminator="generator")]
    """Generator of the poses, without entries for rolls, up, cost and cameras."""
    rolls_deg: Some[Number] = [0.0, 90.0, 180.0, 270.0]
    """Roll angles, degrees; one candidate for each."""
    mount: BaseEntry = BaseEntry()
    """Pose of the camera on the link; axes: x right, y down, z forward."""
    clearance: NotNegative = 0.0
    """Minimum distance of links from the scene and keep-out volumes, m."""
    link_clearance: NotNegative = 0.0
    """Minimum distance of links from each other, m; at 0 they may not touch."""
    allowed: list[Annotated[list[Name], Field(min_length=2, max_length=2)]] = []
    """Pairs of links that may touch, besides neighbours."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if own := sorted(self.of.model_fields_set & set(Generator.model_fields)):
            raise ValueError(f"expected {own[0]} in on_arm, got it in its generator; move it")
        return self

    @property
    def is_carried(self) -> bool:
        """See `Generator`."""
        return True

    def views(self) -> Reachable:
        """The other generator, with rolls and up of this one."""
        return self.of.model_copy(update={"rolls_deg": self.rolls_deg, "up": self.up})
