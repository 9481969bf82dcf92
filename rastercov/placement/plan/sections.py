"""Sections of a plan file, their entries and the limits of each.

Fields that belong to a dataclass of the package, such as `Task`, are taken from it. Limits that
need the mesh are checked later; every field carries the description that an editor shows from
`docs/plan.schema.json`.
"""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from rastercov.coverage.task import Task
from rastercov.mesh.formats import METRES, READERS, metres_per
from rastercov.mesh.shapes import NAMES
from rastercov.placement.candidates.clearance import KeepOutBox, KeepOutSphere
from rastercov.placement.improve.refine import BUDGET
from rastercov.placement.improve.tolerance import InstallationError
from rastercov.placement.plan.cameras import ONE_CAMERA, CameraSection, CameraType, RigSection
from rastercov.placement.plan.entry import (
    Count,
    Direction,
    Entry,
    File,
    Limits,
    Name,
    NotNegative,
    Number,
    Positive,
    Triple,
    among,
    both_or_none,
    fields_of,
    only_one,
    value_of,
)
from rastercov.placement.plan.generators import CandidateEntry
from rastercov.placement.select.problem import BestCoverage, FewestCameras


def _unit(unit: str | float) -> str | float:
    metres_per(unit)
    return unit


BuiltIn = Annotated[
    str, AfterValidator(among(NAMES)), Field(json_schema_extra={"enum": list(NAMES)})
]


class TransformEntry(Entry):
    """Place of a mesh in the scene: scaled about its origin, then turned, then translated."""

    scale: Positive = Field(default=1.0, description="Factor, after the unit.")
    axis: Direction = Field(
        default=[0.0, 0.0, 1.0], description="Axis of the rotation, through the origin."
    )
    angle_deg: Number = Field(
        default=0.0, description="Angle of the rotation, counter-clockwise seen against the axis."
    )
    translation: Triple = Field(default=[0.0, 0.0, 0.0], description="Metres, after the rotation.")


class MeshEntry(Entry):
    """A mesh of the scene: a file or a built-in part, and what it is for."""

    path: File | None = Field(default=None, description=f"Mesh file: {', '.join(READERS)}.")
    built_in: BuiltIn | None = Field(default=None, description="Built-in part, instead of a file.")
    unit: Annotated[str | float, AfterValidator(_unit)] = Field(
        default="m", description=f"Unit of the file: {', '.join(METRES)}, or metres per unit."
    )
    transform: TransformEntry = Field(
        default=TransformEntry(), description="Place of the mesh in the scene."
    )
    role: Literal["task", "occluder", "target"] = Field(
        default="task",
        description="To be seen; in the way and not scored; or to be seen and hiding nothing.",
    )
    groups: list[Name] = Field(
        default=[],
        description="Groups that have this role; the others are the task, or occluders where the "
        "role is task. All if empty.",
    )
    two_sided: bool | list[Name] = Field(
        default=False,
        description="Whether either side counts as covered, for all groups or those named.",
    )
    drop_invalid: bool = Field(default=False, description="Drop faces that are not finite.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("path", "built_in"))
        if self.built_in and self.unit != "m":
            raise ValueError(f"built-in parts are in metres; leave out unit, got {self.unit!r}")
        return self


class TargetEntry(Entry):
    """A surface to be seen that hides nothing: a sheet above a floor, a grid of boxes, or a file.

    Exactly one of above, box and file.
    """

    name: Name | None = Field(
        default=None, description="Name of its group; by default what it is made of."
    )
    above: Name | None = Field(
        default=None, description="Group whose faces that face up are lifted to a sheet."
    )
    height: NotNegative | None = Field(default=None, description="Of the sheet above it, m.")
    box: Annotated[list[Triple], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="Two corners of a volume with a grid of hollow boxes, m."
    )
    count: Annotated[list[Count], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="Boxes along x, y and z; 1 each by default."
    )
    spacing: Positive | None = Field(
        default=None, description="Distance between boxes at most, m, instead of count."
    )
    size: Positive | None = Field(
        default=None, description="Edge of a cube, m; by default half of its cell."
    )
    file: File | None = Field(default=None, description=f"Mesh file: {', '.join(READERS)}.")
    unit: Annotated[str | float, AfterValidator(_unit)] = Field(
        default="m", description=f"Unit of the file: {', '.join(METRES)}, or metres per unit."
    )
    two_sided: bool | None = Field(
        default=None,
        description="Whether either side counts as covered; by default for boxes only.",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("above", "box", "file"))
        if (self.above is None) != (self.height is None):
            raise ValueError("above and height come together; give both or neither")
        of_boxes = [name for name in ("count", "spacing", "size") if getattr(self, name)]
        if of_boxes and self.box is None:
            raise ValueError(f"{' and '.join(of_boxes)} is of a box; leave it out, or give box")
        if self.count and self.spacing:
            raise ValueError("count and spacing exclude each other; give one of them")
        if self.box and not all(a < b for a, b in zip(*self.box, strict=True)):
            raise ValueError(
                f"wanted low < high on every axis, got {self.box[0]} and {self.box[1]}"
            )
        if self.file is None and self.unit != "m":
            raise ValueError(f"unit is of a file; leave it out, got {self.unit!r}")
        return self


# Ignored types below: mypy does not follow the classes that `fields_of` makes.


class TaskSection(fields_of(Task, leave_out=("views",))):  # type: ignore[misc]
    """Thresholds that a face must meet to be covered."""

    views: Count | dict[str, Count] = Field(
        default=1,
        description="Cameras that must cover a face; or a table by group, 1 for the others.",
    )
    weight_by: Literal["area", "count"] = Field(default="area", description="What shares are of.")
    by: Literal["area", "face"] | None = Field(
        default=None,
        description="Unit of results: exact area, or whole faces; area unless a threshold is of a "
        "face.",
    )
    resolution_of_result: Positive | None = Field(
        default=None,
        description="Longest side of the cells that cameras are chosen on, m; by area only, chosen "
        "from the scene if left out.",
    )
    method: Literal["certified", "exact", "sampled"] = Field(
        default="certified", description="How occlusion is found."
    )
    supersample: Count = Field(
        default=1, description="S: S x S samples a pixel, for method sampled."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.supersample > 1 and self.method != "sampled":
            raise ValueError(f"supersample is for method sampled, got method {self.method}")
        if self.by == "area" and self.min_angle_deg > 0:
            raise ValueError('min_angle_deg is of a face; leave out by = "area"')
        if self.by == "area" and self.weight_by == "count":
            raise ValueError('weight_by = "count" is of faces; leave out by = "area"')
        if self.by == "face" and self.resolution_of_result is not None:
            raise ValueError('resolution_of_result is of cells; leave out by = "face"')
        return self


class Volume(Entry):
    """Entries of every keep-out volume."""

    name: Name = Field(description="What the report calls it.")


BoxFields = fields_of(KeepOutBox, base=Volume, is_optional=True)


class KeepOut(fields_of(KeepOutSphere, base=BoxFields, is_optional=True)):  # type: ignore[misc]
    """A volume without cameras: a box (low, high) or a sphere (centre, radius)."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        both_or_none(self)
        if (self.centre is None) != (self.radius is None):
            raise ValueError("centre and radius come together; give both or neither")
        if (self.low is None) == (self.centre is None):
            raise ValueError("wanted low and high, or centre and radius; give one of the two")
        return self

    def volume(self) -> KeepOutBox | KeepOutSphere:
        """The box or the sphere."""
        return value_of(self, KeepOutBox) if self.centre is None else value_of(self, KeepOutSphere)


class Space(Entry):
    """A box of camera positions; flat ones are walls and ceilings."""

    name: Name = Field(default="space", description="For people.")
    low: Triple = Field(description="Corner, m.")
    high: Triple = Field(description="The opposite corner.")
    _check = model_validator(mode="after")(both_or_none)


class Constraints(Entry):
    """Constraints on camera positions."""

    stand_off: Limits | None = Field(
        default=None, description="[least, greatest] distance to the nearest task face, m."
    )
    clearance: NotNegative = Field(default=0.0, description="Least distance from any surface, m.")
    keep_out: list[KeepOut] = Field(default=[], description="Volumes without cameras.")
    spaces: list[Space] = Field(
        default=[], description="Boxes where cameras may stand; anywhere if empty."
    )


class Optimise(Entry):
    """A search over free poses that starts from the selected cameras."""

    method: Literal["pso", "ga", "de", "random"] = Field(
        default="pso", description="How it searches."
    )
    budget: Count = Field(default=5_000, description="Poses to measure.")
    population: Annotated[int, Field(ge=4)] = Field(
        default=24, description="Networks in a generation."
    )


TOLERANCE = {
    "position_mm": "Error of the camera centre, mm.",
    "angle_deg": "Error of the direction, degrees.",
    "distribution": "Of the errors.",
}


class ToleranceSection(fields_of(InstallationError, TOLERANCE)):  # type: ignore[misc]
    """Installation errors, and the coverage they cost."""

    draws: Count = Field(default=200, description="Installations to draw.")


class SelectionBase(Entry):
    """Entries of every goal."""

    method: Literal["greedy", "integer"] = Field(
        default="greedy", description="Greedy with exchanges, or HiGHS started from it."
    )
    time_limit: Positive = Field(default=60.0, description="Of method integer, seconds.")
    refine: bool = Field(
        default=False, description="Move the selected cameras until no move gains."
    )
    refine_budget: Count = Field(
        default=BUDGET, description="Poses that refinement measures or estimates."
    )
    optimise: Optimise | None = Field(
        default=None, description="Search free poses, before refining."
    )
    tolerance: ToleranceSection | None = Field(
        default=None, description="Installation errors to try."
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        default=0, description="Of everything that is random."
    )


FEWEST = {
    "coverage": "Share of the task to cover.",
    "groups": "Share to cover of single groups.",
    "of_reachable": "Whether shares are of what all candidates together cover.",
}


class FewestSelection(fields_of(FewestCameras, FEWEST, base=SelectionBase)):  # type: ignore[misc]
    """The fewest, or cheapest, cameras that reach a coverage."""

    goal: Literal["fewest_cameras"]


BEST = {"budget": "Cost of all cameras at most."}


class BestSelection(fields_of(BestCoverage, BEST, base=SelectionBase)):  # type: ignore[misc]
    """The best coverage with a number of cameras, or within a budget."""

    goal: Literal["best_coverage"]
    cameras: Count | None = Field(default=None, description="Cameras at most.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.cameras is None and self.budget is None:
            raise ValueError("wanted cameras, budget or both, got neither; give one")
        return self


SelectionSection = Annotated[FewestSelection | BestSelection, Field(discriminator="goal")]


class Outputs(Entry):
    """Files that are written, and their folder."""

    folder: Name | None = Field(default=None, description="The plan file's name without .toml.")
    page: bool = Field(default=True, description="Whether to write the page with pictures.")


class PlanModel(Entry):
    """A camera-placement plan for `rastercov place` and `rastercov check`."""

    meshes: Annotated[list[MeshEntry], Field(min_length=1)] = Field(
        description="The scene: what is to be seen and what is in the way."
    )
    targets: list[TargetEntry] = Field(
        default=[], description="Further surfaces to be seen, which hide nothing."
    )
    camera: CameraSection | None = Field(
        default=None, description="The camera that all poses share."
    )
    cameras: dict[Name, CameraType] = Field(
        default={}, description="Types of cameras by name, instead of the one camera."
    )
    rigs: dict[Name, RigSection] = Field(
        default={}, description="Cameras that move together, by the name of the rig."
    )
    task: TaskSection = Field(
        default=TaskSection(), description="Thresholds that a face must meet to be covered."
    )
    candidates: list[CandidateEntry] = Field(default=[], description="Poses to choose from.")
    constraints: Constraints = Field(
        default=Constraints(), description="Constraints on camera positions."
    )
    selection: SelectionSection | None = Field(default=None, description="What is wanted.")
    outputs: Outputs = Field(
        default=Outputs(), description="Files that are written, and their folder."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.camera is not None and self.cameras:
            raise ValueError("camera and cameras exclude each other; put it among the cameras")
        for rig, section in self.rigs.items():
            if rig in self.camera_names:
                raise ValueError(f"rigs.{rig}: there is a camera of that name; rename it")
            for each in section.cameras or []:
                if each.camera not in self.camera_names:
                    raise ValueError(
                        f"rigs.{rig}.cameras: there is no camera {each.camera!r}; cameras are "
                        f"{', '.join(self.camera_names) or 'none'}"
                    )
        known = (*self.camera_names, *self.rigs)
        for row, entry in enumerate(self.candidates):
            for name in entry.cameras:
                if name not in known:
                    listed = ", ".join(known) or "none"
                    raise ValueError(
                        f"candidates[{row}].cameras: there is no camera {name!r}; cameras are "
                        f"{listed}"
                    )
        return self

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the cameras; "camera" of the one that all poses share."""
        return (ONE_CAMERA,) if self.camera is not None else tuple(self.cameras)
