"""Sections of a plan file, their entries and the limits of each.

Fields that belong to a dataclass of the package, such as `Task`, are taken from it. Limits that
need the mesh are checked later; every field carries the description that an editor shows from
`docs/plan.schema.json`.

Types of entries are numbers with limits, files, directions and boxes. `fields_of` makes entries of
the fields of a dataclass, so that a threshold and its limits are declared once. Lengths are metres,
files are relative to the plan.

Sections on cameras are the one camera, types of cameras with costs, and rigs. Each `[[candidates]]`
entry names a generator of `pool`, `mounting` or `cavities` and holds its arguments.
"""

import datetime
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    create_model,
    model_validator,
)

from rastercov.base import ByName, CameraError, RastercovError, ReadByName
from rastercov.core.area.regions import OF_A_FACE
from rastercov.core.camera import Camera, Conventions, Rig, look_at
from rastercov.core.camera.camera import check_optics
from rastercov.core.camera.catalogue import price_of
from rastercov.core.camera.rig import entries_of_rig, preset_rig, rig_with
from rastercov.core.coverage.device import devices
from rastercov.core.coverage.task import NEEDED, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import matrices_of, rotation_about
from rastercov.core.mesh.files import METRES, metres_per
from rastercov.core.mesh.shapes import NAMES
from rastercov.formats.cameras import read_views
from rastercov.formats.meshes import READERS
from rastercov.placement.candidates.rooms import KeepOutBox, KeepOutSphere, Room, space_of_name
from rastercov.placement.improve.refine import BUDGET
from rastercov.placement.plan.candidate_entry import CandidateEntry
from rastercov.placement.plan.entries import (
    BaseEntry,
    Count,
    Direction,
    Entry,
    File,
    Limits,
    Name,
    NotNegative,
    Number,
    Pair,
    Positive,
    Some,
    Triple,
    among,
    both_or_none,
    extend_entry,
    fields_of,
    only_one,
    together,
    value_of,
)
from rastercov.placement.select.problem import BestCoverage, FewestCameras, empty_goal

OF_FILES = ("pixel_centre", "lens_model", "image_size")
"""Entries that answer what a camera file leaves open."""

# Ignored types below: mypy does not follow the classes that `fields_of` makes.


OF_A_LIST = ("pixel_size", "focus_range", "distortion")
"""Entries of a camera that are arrays in a file, and tuples in a `Camera`."""


def _catalogue(info: ValidationInfo) -> Path | None:
    """The catalogue of the plan."""
    return (info.context or {}).get("catalogue")


OF_FEATURES = extend_entry("cameras")


class CameraSection(fields_of(Camera, base=OF_FEATURES, is_optional=True, leave_out=OF_A_LIST)):  # type: ignore[misc]
    """The camera: a preset, a file, or the entries of a camera file, which also change a preset."""

    file: File | None = None
    """Camera file, of rastercov or another program; other entries add what it lacks."""
    name: str | None = None
    """Name of the camera in a file with several."""
    pixel_centre: float | None = None
    """Coordinate of the first pixel's centre in the file: 0 or 0.5."""
    lens_model: Literal["brown", "fisheye"] | None = None
    """Lens model of four distortion coefficients, if the file states none."""
    image_size: list[Count] | None = None
    """[width, height], px, for a file that lacks it."""
    preset: Name | None = None
    """Camera of the catalogue, NAME or NAME+LENS; other entries change it."""
    pixel_size: Number | list[Number] | None = None
    """Pixel pitch, m; one number or [x, y]."""
    principal_point: Pair | None = None
    """[x, y] from the top-left corner, m."""
    f_number: Number | None = None
    """N of f/N; with focus_distance, and with pixel_size if fx and fy are given."""
    magnification: Number | None = None
    """Size in the image over size of the object, of a telecentric lens; instead of fx."""
    working_distance: Number | None = None
    """Distance from the front of a telecentric lens to its plane of focus, m."""
    depth_of_field: Number | None = None
    """Depth of field of a telecentric lens, around its focus, m; instead of f_number."""
    px_per_m: Number | None = None
    """Pixels per metre of an orthographic view; instead of fx."""
    hfov_deg: Number | None = None
    """Horizontal field of view, deg; instead of fx."""
    vfov_deg: Number | None = None
    """Vertical field of view, deg; instead of fy."""
    focus_range: list[float] | None = None
    """[near, far] depths in focus, m; instead of an aperture."""
    distortion: list[float] | None = None
    """Coefficients of the lens model, in its order."""

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        self.build(Path((info.context or {}).get("folder", ".")), _catalogue(info))
        return self

    def build(self, folder: Path, catalogue: Path | None = None) -> Camera:
        """The camera; CameraError where the entries do not make one."""
        entries = self.model_dump(exclude_none=True, exclude={"cost", *OF_FEATURES.model_fields})
        if self.preset is not None:
            entries["catalogue"] = catalogue
        if self.file is None:
            return Camera.from_dict(entries)
        optics = {k: v for k, v in entries.items() if k not in ("file", "name", *OF_FILES)}
        check_optics(optics)
        try:
            given = {name: entries[name] for name in OF_FILES if name in entries}
            conventions = Conventions(**given)
            views = read_views(folder / self.file, conventions=conventions)
            camera, own = views.camera(self.name), views.of_camera(self.name).rig
            if own and own.tasks:
                raise CameraError(
                    f"{self.file}: expected a camera without thresholds, got some of "
                    f"{own.names[0]}; take it by [rigs.NAME] file =, or move them to [task]"
                )
            return camera.with_optics(optics)
        except RastercovError as error:
            text = str(error).replace("--camera-name", "name")
            for name in OF_FILES:
                text = text.replace(f"--{name.replace('_', '-')}", f"{name} =")
            raise CameraError(text.replace("= WIDTHxHEIGHT", "= [width, height]")) from None


ONE_CAMERA = "camera"
"""Name of the camera of a plan with one."""


class CameraType(CameraSection):
    """One of several types of cameras, by its name."""

    cost: NotNegative | None = None
    """Cost of one, added to that of its place; by default the price of a preset, or 1."""

    @model_validator(mode="after")
    def _with_price(self, info: ValidationInfo) -> Self:
        if self.cost is None and self.preset is not None:
            object.__setattr__(self, "cost", price_of(self.preset, _catalogue(info)))
        return self


OF_NO_DEVICE = ("views", *OF_A_FACE)
"""Thresholds that no single camera of a rig has."""


class DeviceTask(fields_of(Task, is_optional=True, leave_out=OF_NO_DEVICE)):  # type: ignore[misc] # a base made of fields
    """Thresholds of a camera of a rig in place of those of the task, such as of a projector."""


class RigCamera(Entry):
    """Pose of a camera on a rig: rotation about an axis through its origin, then translation.

    Axes of rig and camera: x right, y down, z forward. A fixed camera is placed in the world.
    """

    camera: Name
    """Name of the camera."""
    name: Name | None = None
    """Its name on the rig; that of the camera unless given."""
    axis: Direction = [0.0, 1.0, 0.0]
    """Axis of the rotation, in the axes of the rig."""
    angle_deg: Number = 0.0
    """Angle of the rotation, degrees."""
    translation: Triple = [0.0, 0.0, 0.0]
    """Translation after the rotation, m."""
    fixed: bool = False
    """True if it does not move with the rig, such as a projector of the work cell."""
    target: Triple | None = None
    """Point that a fixed camera looks at, m; instead of axis and angle_deg."""
    task: DeviceTask | None = None
    """Thresholds of this camera, which replace all those of the task."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.target is not None and (not self.fixed or self.angle_deg):
            raise ValueError(
                "expected target of a fixed camera without angle_deg, got another; correct it"
            )
        return self

    def rig_from_camera(self) -> NDArray[np.float64]:
        """(4, 4) place on the rig; world_from_camera of a fixed camera."""
        if self.target is not None:
            return look_at([self.translation], self.target)[0]
        turn = rotation_about(self.axis, math.radians(self.angle_deg))
        return matrices_of(turn, self.translation)


OF_NO_GOAL = ("views", "min_angle_deg", *NEEDED, *OF_A_FACE)
"""Thresholds that are the same in all goals of a plan."""


class ExistingSection(Entry):
    """Existing cameras."""

    file: File
    """Pose file, as for candidates."""
    move: list[Annotated[int, Field(ge=0)] | Name] = []
    """Rows, or names of images, of cameras that may move; the others stay."""


class GoalSection(fields_of(Task, is_optional=True, leave_out=OF_NO_GOAL)):  # type: ignore[misc] # a base made of fields
    """Goal for some groups, with thresholds in place of those of the task."""

    groups: Some[Name] | None = None
    """Groups of the goal, which the task then leaves out; all of the task unless given."""
    coverage: Annotated[float, Field(gt=0, le=1)] | None = None
    """Minimum share to cover."""
    at_most: Annotated[float, Field(ge=0, lt=1)] | None = None
    """Maximum share that may be covered, such as 0 for what must not be seen."""
    views: Count | None = None
    """Required number of cameras per point or face; by default that of the task."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("coverage", "at_most"))
        return self


class RigSection(extend_entry("rig")):  # type: ignore[misc] # a base made of fields
    """Cameras that move together: of the plan, all of a file with their poses, or a preset."""

    cameras: Some[RigCamera] | None = None
    """Cameras of the plan with their poses on the rig."""
    file: File | None = None
    """File of cameras with their poses, such as a Kalibr camchain."""
    preset: Name | None = None
    """Sensor head: NAME:BASELINE or NAME:BASELINE:CAMERA of the catalogue, such as stereo:0.12."""
    cost: NotNegative | None = None
    """Cost of the rig; by default that of its cameras together."""

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        only_one(self, ("cameras", "file", "preset"))
        if self.cameras is None:
            self.build(Path((info.context or {}).get("folder", ".")), {}, _catalogue(info))
        return self

    def _with(self, rig: Rig, tasks: ReadByName, fixed: Sequence[str] = ()) -> Rig:
        """A rig with these entries, thresholds of its cameras, and those that stay."""
        given = self.model_dump(include=set(entries_of_rig()), exclude_none=True)
        given |= {"tasks": tasks} if tasks else {}
        given |= {"fixed": fixed} if fixed else {}
        return rig_with(rig, given)

    def build(
        self, folder: Path, cameras: Mapping[str, Camera], catalogue: Path | None = None
    ) -> Rig:
        """The rig of the cameras of a plan, of its file or preset; CameraError for none."""
        if self.preset is not None:
            return self._with(preset_rig(self.preset, catalogue), {})
        if self.file is not None:
            views = read_views(folder / self.file)
            if views.rig is None or not views.has_unit:
                lacks = "cameras" if views.rig is None else "a unit of places"
                raise CameraError(
                    f"{self.file}: expected {lacks}, got none; convert it with its unit"
                )
            return self._with(views.rig, {})
        own = self.cameras or []
        names = [each.name or each.camera for each in own]
        places = [each.rig_from_camera() for each in own]
        tasks = {
            name: each.task.model_dump(exclude_none=True)
            for name, each in zip(names, own, strict=True)
            if each.task is not None
        }
        fixed = [name for name, each in zip(names, own, strict=True) if each.fixed]
        return self._with(Rig([cameras[each.camera] for each in own], names, places), tasks, fixed)


def _unit(unit: str | float) -> str | float:
    metres_per(unit)
    return unit


Unit = Annotated[
    str | float,
    AfterValidator(_unit),
    Field(description=f"Unit of the file: {', '.join(METRES)}, or metres per unit."),
]
MeshFile = Annotated[File | None, Field(description=f"Mesh file: {', '.join(READERS)}.")]
BuiltIn = Annotated[str, *among(NAMES)]


class TransformEntry(BaseEntry):
    """Pose of a mesh in the scene: scaled about its origin, rotated, then translated."""

    scale: Positive = 1.0
    """Scale factor, after the unit."""


class MeshEntry(Entry):
    """A mesh of the scene: a file or a built-in part, and its role."""

    path: MeshFile = None
    built_in: BuiltIn | None = None
    """Built-in part, instead of a file."""
    unit: Unit = "m"
    transform: TransformEntry = TransformEntry()
    """Place of the mesh in the scene."""
    role: Literal["task", "occluder", "target"] = "task"
    """task is to be covered, occluder occludes only, target is covered but occludes nothing."""
    groups: list[Name] = []
    """Groups with this role, all if empty. Others are the task, or occluders for role task."""
    two_sided: bool | list[Name] = False
    """True if either side may be covered, for all groups or those named."""
    drop_invalid: bool = False
    """Drop faces with coordinates that are not finite."""
    deflection_mm: Positive | None = None
    """Largest distance of triangles from curved surfaces of a STEP file, millimetres."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("path", "built_in"))
        if self.built_in and self.unit != "m":
            raise ValueError(
                f"expected metres of a built-in part, got {self.unit!r}; leave out unit"
            )
        return self


class RoomSection(Entry):
    """A part of a building: what a point reaches, a polygon with heights, or a space of IFC."""

    inside: Triple | None = None
    """Point in the room; the room is all that it reaches without crossing the mesh."""
    opening: Positive = 1.0
    """Width up to which openings between rooms are closed, m; with inside."""
    polygon: list[Pair] | None = None
    """Corners [x, y] of the room in order, m."""
    z: Pair | None = None
    """[lowest, highest] z of the room, m; with polygon."""
    space: Name | None = None
    """IfcSpace: its name, long name or both, if needed after "STOREY/", or its GlobalId."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("inside", "polygon", "space"))
        together(self, "polygon", "z")
        return self

    def build(self, mesh: Mesh, name: str) -> Room:
        """The room in a mesh; an error where the entries do not make one."""
        if self.space is not None:
            return Room.of_solid(space_of_name(mesh.spaces, self.space), name)
        if self.polygon is None or self.z is None:
            return Room.at(mesh, self.inside or (), self.opening, name)
        return Room.of_polygon(self.polygon, (self.z[0], self.z[1]), name)


class TargetEntry(Entry):
    """A surface to be covered that occludes nothing: a sheet above a floor, boxes, or a file.

    Exactly one of above, box and file.
    """

    name: Name | None = None
    """Name of its group; by default made from the entry."""
    above: Name | None = None
    """Group whose upward faces are lifted to a sheet."""
    height: NotNegative | None = None
    """Height of the sheet above it, m."""
    room: Name | None = None
    """Room that the sheet is limited to."""
    near: list[Name] = []
    """Groups around which the sheet is cut out, such as doors."""
    within: Positive | None = None
    """Maximum horizontal distance from the groups of near, m; 1 by default."""
    facing: Count | Annotated[list[Triple], Field(min_length=1)] | None = None
    """Upright squares in place of the sheet, for the faces of people: the number of evenly spread
    directions that they face, or the directions."""
    box: Annotated[list[Triple], Field(min_length=2, max_length=2)] | None = None
    """Two corners of a volume with a grid of hollow boxes, m."""
    count: Annotated[list[Count], Field(min_length=3, max_length=3)] | None = None
    """Cells along x, y and z, with a box in the middle of each; 1 each by default."""
    spacing: Positive | None = None
    """Maximum distance between boxes, m, instead of count; with facing, between squares (0.5)."""
    size: Positive | None = None
    """Edge of each cube, m, at most that of its cell; by default, a box has half the length, width
    and height of its cell. With facing, side of each square; 0.2 m by default."""
    file: MeshFile = None
    unit: Unit = "m"
    two_sided: bool | None = None
    """True if either side may be covered; by default for boxes only."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("above", "box", "file"))
        together(self, "above", "height")
        if self.above is None and (self.room or self.near or self.facing):
            raise ValueError(
                "expected above with room, near or facing, got none; give it, or leave them out"
            )
        if self.within and not self.near:
            raise ValueError("expected near with within, got none; give it, or leave within out")
        of_boxes = [name for name in ("count", "spacing", "size") if getattr(self, name)]
        if of_boxes and self.box is None and (self.facing is None or self.count):
            raise ValueError(f"expected box with {' and '.join(of_boxes)}, got none; give it")
        if self.count and self.spacing:
            raise ValueError("expected count or spacing, got both; leave one out")
        if self.box and not all(a < b for a, b in zip(*self.box, strict=True)):
            raise ValueError(f"expected low < high, got {self.box[0]} and {self.box[1]}; swap them")
        if self.file is None and self.unit != "m":
            raise ValueError(f"expected unit with a file, got {self.unit!r}; leave it out")
        return self


class BodyEntry(extend_entry("bodies")):  # type: ignore[misc] # a base made of fields
    """Groups that move together."""

    name: Name
    """Name of the body."""
    groups: list[Name] = []
    """Names of groups or files; that of the body if empty."""


# Ignored types below: mypy does not follow the classes that `fields_of` makes.


OF_TASK = extend_entry("counting", extend_entry("task"))


class TaskSection(fields_of(Task, base=OF_TASK, leave_out=("views",))):  # type: ignore[misc]
    """Thresholds that a point or face must meet to be covered."""

    views: Count | dict[str, Count] = 1
    """Required number of cameras per point or face; or a table by group, 1 for the others."""
    weight_by: Literal["area", "seeable", "count"] = "area"
    """Total of shares: area, count (of faces), or seeable: area without what is never visible."""
    by: Literal["area", "face"] | None = None
    """Unit of results: exact area, or whole faces; by default area, if all thresholds allow it."""
    resolution_of_result: Positive | None = None
    """Longest side of the patches on which cameras are chosen, m; by area only."""
    method: Literal["certified", "exact", "sampled"] = "certified"
    """Visibility method."""
    supersample: Count = 1
    """S: S x S samples per pixel, for method sampled."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.supersample > 1 and self.method != "sampled":
            raise ValueError(
                f"expected method sampled with supersample, got {self.method}; change it"
            )
        if self.by == "area" and self.weight_by == "count":
            raise ValueError(
                'expected by = "face" for weight_by = "count", got "area"; leave it out'
            )
        if self.by == "face" and self.resolution_of_result is not None:
            raise ValueError(
                'expected by = "area" for resolution_of_result, got "face"; leave it out'
            )
        return self


class VolumeEntries(Entry):
    """Entries of every keep-out volume."""

    name: Name
    """Name in the report."""


BoxFields = fields_of(KeepOutBox, base=VolumeEntries, is_optional=True)


class KeepOutVolume(fields_of(KeepOutSphere, base=BoxFields, is_optional=True)):  # type: ignore[misc]
    """A volume without cameras: a box (low, high) or a sphere (centre, radius)."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        both_or_none(self)
        together(self, "centre", "radius")
        if (self.low is None) == (self.centre is None):
            raise ValueError(
                "expected low and high, or centre and radius, got both or none; give one"
            )
        return self

    def volume(self) -> KeepOutBox | KeepOutSphere:
        """The box or the sphere."""
        return value_of(self, KeepOutBox) if self.centre is None else value_of(self, KeepOutSphere)


class Space(Entry):
    """A box of camera positions; flat ones are walls and ceilings."""

    name: Name = "space"
    """Name in the report."""
    low: Triple
    """Lowest corner, m."""
    high: Triple
    """Highest corner, m."""
    _check = model_validator(mode="after")(both_or_none)


class Constraints(Entry):
    """Constraints on camera positions."""

    stand_off: Limits | None = None
    """[least, greatest] distance to the nearest evaluated face, m."""
    clearance: NotNegative = 0.0
    """Minimum distance from any surface, m; also for the legs of a flight."""
    keep_out: list[KeepOutVolume] = []
    """Volumes without cameras."""
    spaces: list[Space] = []
    """Boxes that may hold cameras; anywhere if empty."""


class Optimise(Entry):
    """A search over free poses, which replace the selected cameras if they cover more."""

    budget: Count = 5_000
    """Number of poses to measure."""


class SelectionBase(extend_entry("selection")):  # type: ignore[misc] # a base made of fields
    """Entries of every goal."""

    method: Literal["greedy", "integer"] = "greedy"
    """Greedy with exchanges, or integer programming (HiGHS) from that start."""
    time_limit: Positive = 60.0
    """Time limit of method integer, s."""
    refine: bool = False
    """Move the selected cameras until no move improves the result."""
    refine_budget: Count = BUDGET
    """Number of poses that refinement measures or estimates."""
    optimise: Optimise | None = None
    """Search over free poses, before refinement."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of all random numbers."""


class FewestSelection(fields_of(FewestCameras, base=SelectionBase)):  # type: ignore[misc]
    """The fewest, or cheapest, cameras that reach a coverage."""

    goal: Literal["fewest_cameras"]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if line := empty_goal(self.coverage, self.groups):
            raise ValueError(line)
        return self


BESIDE_CAMERAS = extend_entry("best", SelectionBase)


class BestSelection(fields_of(BestCoverage, base=BESIDE_CAMERAS)):  # type: ignore[misc]
    """The best coverage with a number of cameras, or within a budget."""

    goal: Literal["best_coverage"]
    cameras: Count | None = None
    """Maximum number of cameras."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        beside = BESIDE_CAMERAS.model_fields.keys() - SelectionBase.model_fields
        if all(getattr(self, name) is None for name in ("cameras", "budget", *beside)):
            raise ValueError("expected cameras, budget or both, got neither; give one")
        return self


class AllSelection(SelectionBase):
    """Every candidate, such as all images of a flight."""

    goal: Literal["all"]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.refine or self.optimise is not None:
            raise ValueError("expected neither refine nor optimise with goal all, got one; omit it")
        return self


SelectionSection = Annotated[
    FewestSelection | BestSelection | AllSelection, Field(discriminator="goal")
]


class Outputs(Entry):
    """Files that are written, and their folder."""

    folder: Name | None = None
    """Folder of the results, below that of the plan; by default the plan's name without .toml."""
    page: bool = True
    """True to write the page with pictures."""


class SheetSection(Entry):
    """Title block of pages and plan sheets."""

    project: Name | None = None
    """Name of the project."""
    customer: Name | None = None
    """Person or company that the plan is for."""
    author: Name | None = None
    """Person or company that made the plan."""
    revision: Name | None = None
    """Revision of the drawing."""
    date: Name | None = None
    """Date of the drawing; today unless given."""
    north: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Direction of north, degrees counter-clockwise from +x."""

    def words(self, **more: str) -> dict[str, str]:
        """Entries of a title block that are given, with a date; and more, such as the plan."""
        own = self.model_dump(exclude={"north"}, exclude_none=True)
        dated = {"date": self.date or datetime.date.today().isoformat()} if own else {}
        return own | dated | more


OF_DEVICES: ByName = {
    each.word: (File | None, Field(default=None, description=each.help)) for each in devices()
}
"""Entries of devices on cameras."""


class PlanModel(extend_entry("plan", create_model("devices", __base__=Entry, **OF_DEVICES))):  # type: ignore[misc]
    """A camera-placement plan for `rastercov place` and `rastercov check`."""

    meshes: Some[MeshEntry]
    """The scene: surfaces to be covered, and occluders."""
    rooms: dict[Name, RoomSection] = {}
    """Parts of a building by name: for candidates, targets and warnings."""
    targets: list[TargetEntry] = []
    """Further surfaces to be covered, which occlude nothing."""
    bodies: list[BodyEntry] = []
    """Groups that move together."""
    catalogue: File | None = None
    """Catalogue of cameras and lenses for presets, in addition to that of the package."""
    camera: CameraSection | None = None
    """The camera that all poses share."""
    cameras: dict[Name, CameraType] = {}
    """Types of cameras by name, instead of the one camera."""
    rigs: dict[Name, RigSection] = {}
    """Cameras that move together, by the name of the rig."""
    task: TaskSection = TaskSection()
    """Thresholds that a point or face must meet to be covered."""
    candidates: list[CandidateEntry] = []
    """Poses to choose from."""
    existing: (
        Annotated[
            ExistingSection,
            BeforeValidator(lambda value: {"file": value} if isinstance(value, str) else value),
        ]
        | None
    ) = None
    """Existing cameras, without cost, beside which others are chosen: a table or a pose file."""
    constraints: Constraints = Constraints()
    """Constraints on camera positions."""
    selection: SelectionSection | None = None
    """Goal of the selection."""
    goals: dict[Name, GoalSection] = {}
    """Goals by name, with their own thresholds, groups and views."""
    outputs: Outputs = Outputs()
    """Files that are written, and their folder."""
    sheet: SheetSection = SheetSection()
    """Title block of pages and plan sheets."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.camera is not None and self.cameras:
            raise ValueError("expected camera or cameras, got both; put camera among cameras")
        self._check_existing()
        types = self.cameras.items()
        if any(each.cost is not None and "cost" not in each.model_fields_set for _, each in types):
            for name in (name for name, each in types if each.cost is None):
                raise ValueError(
                    f"cameras.{name}: expected a cost, as of others, got none; give it"
                )
        used: dict[str, tuple[list[str], tuple[str, ...]]] = {}
        for rig, section in self.rigs.items():
            if rig in self.camera_names:
                raise ValueError(
                    f"rigs.{rig}: expected another name, got that of a camera; rename it"
                )
            own = [each.camera for each in section.cameras or []]
            used[f"rigs.{rig}"] = own, self.camera_names
        for row, entry in enumerate(self.candidates):
            used[f"candidates[{row}]"] = entry.cameras, (*self.camera_names, *self.rigs)
        for path, (names, known) in used.items():
            if missing := [name for name in names if name not in known]:
                raise ValueError(
                    f"{path}.cameras: expected a camera ({', '.join(known) or '[cameras.NAME]'}), "
                    f"got {missing[0]!r}; correct the name"
                )
        return self

    @property
    def chooses_cameras(self) -> bool:
        """True where cameras are chosen, False where they are all there."""
        return self.existing is None or any(each.is_of_cameras for each in self.candidates)

    def _check_existing(self) -> None:
        """ValueError for what does not go with cameras that stay while others are chosen."""
        if self.existing is None:
            return
        if not self.chooses_cameras:
            if self.existing.move:
                raise ValueError(
                    "existing.move: expected cameras to choose, got none; leave it out"
                )
            return
        self.refuse(("optimise",), "with existing cameras")
        best = self.selection
        if isinstance(best, BestSelection) and best.cameras is not None and best.budget is not None:
            raise ValueError(
                "selection: expected cameras or budget with existing, got both; leave one out"
            )

    def refuse(self, names: Sequence[str], why: str) -> None:
        """ValueError for a selection with one of some entries."""
        for name in names:
            if getattr(self.selection, name, None):
                raise ValueError(f"selection.{name}: expected none {why}, got one; leave it out")

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the cameras; "camera" of the one that all poses share."""
        return (ONE_CAMERA,) if self.camera is not None else tuple(self.cameras)
