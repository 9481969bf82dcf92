"""Entries on motion in the sections of a plan."""

from typing import Annotated, Literal

from pydantic import Field

from rastercov.placement.plan.entries import (
    Count,
    Direction,
    Entry,
    File,
    Name,
    Number,
    PlanSections,
    Triple,
)

Over = Literal["some", "all"] | Annotated[float, Field(gt=0, le=1)]
"""Time in which a point must be covered."""


class Turned(Entry):
    """A body that is rotated in equal steps."""

    body: Name
    """Name of the body."""
    steps: Count
    """Frames; the first is the rest pose."""
    axis: Direction = Field(default=[0.0, 0.0, 1.0])
    """Axis of the rotation, which is counter-clockwise when it points at you."""
    centre: Triple = Field(default=[0.0, 0.0, 0.0])
    """Point on the axis, m."""
    degrees: Number = 360.0
    """Total angle, degrees."""


class Conveyed(Entry):
    """A body that is translated in equal steps."""

    body: Name
    """Name of the body."""
    steps: Count
    """Frames; the first is the rest pose, the last at the distance."""
    direction: Direction
    """Direction of travel."""
    distance: Number
    """Total distance, m."""


class MotionSection(Entry):
    """Poses of bodies, frame by frame; a single pose holds for all frames."""

    turntable: Turned | None = None
    """A body on a turntable."""
    conveyor: Conveyed | None = None
    """A body on a conveyor."""
    poses: File | None = None
    """Table of poses: JSON or CSV."""
    joints: File | None = None
    """Path of the one body with joints: CSV with a column per joint, and optionally duration."""
    animation: str | None = None
    """Animation of a glTF file of the plan, by name; "" for its only one."""
    steps: Count = 50
    """Frames of the animation, at equal steps of its time."""


class MotionOfPlan(Entry):
    """Entries of a plan."""

    motion: MotionSection | None = None
    """Poses of the bodies, frame by frame."""


class TimeOfTask(Entry):
    """Entries of its task."""

    over: Over | None = None
    """Time in which a point must be covered, if bodies move: some, all, or a share."""
    views_at: Literal["one time", "any time"] = "one time"
    """Times at which the required cameras must cover a point: one for all, or any for each."""


class BodyOfCamera(Entry):
    """Entries of a camera."""

    body: Name = "world"
    """Body that carries it, if bodies move; candidates are poses at rest."""


HOOKS = PlanSections(plan=MotionOfPlan, counting=TimeOfTask, cameras=BodyOfCamera)
