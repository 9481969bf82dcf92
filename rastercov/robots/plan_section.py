"""Entries on robots in the sections of a plan."""

from typing import Literal, Self

from pydantic import Field, model_validator

from rastercov.placement.plan.entries import BaseEntry, Entry, File, Name, PlanSections


class RobotOfBody(Entry):
    """Entries of a body: a robot, whose links are the bodies NAME/LINK."""

    urdf: File | None = None
    """Robot, instead of groups: a URDF file."""
    packages: dict[Name, Name] = Field(default={})
    """Folder of each package of the URDF, by its name."""
    geometry: Literal["collision", "visual"] = "collision"
    """Shapes of the links."""
    base: BaseEntry = BaseEntry()
    """Place of the robot."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.urdf is not None and getattr(self, "groups", None):
            raise ValueError("expected urdf or groups, got both; leave one out")
        of_robot = self.model_fields_set & {"packages", "geometry", "base"}
        if self.urdf is None and of_robot:
            raise ValueError(f"expected urdf with {sorted(of_robot)[0]}, got none; give urdf")
        return self


def _carried() -> tuple[type[Entry], ...]:
    from rastercov.robots.generators import OnArm  # which carries views of all others

    return (OnArm,)


HOOKS = PlanSections(bodies=RobotOfBody, carried=_carried)
