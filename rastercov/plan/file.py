"""Plan files: read `plan.toml` and check it; all its errors are raised at once.

plan.toml -> `read_plan` -> `scene` (mesh, candidates) -> `run` (place), `check`
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import PrivateAttr, ValidationError

from rastercov._files import StrPath, UnparsedError, UnreadableError, printable, read_toml
from rastercov.area.network import unit_of_result
from rastercov.camera import Camera
from rastercov.engine import Engine
from rastercov.plan.errors import PlanError, lines_of
from rastercov.plan.sections import ONE_CAMERA, PlanModel
from rastercov.rig import Rig, only_camera
from rastercov.task import Task

NO_CAMERA = "camera: missing; add it, or cameras by name as [cameras.NAME]"


class Plan(PlanModel):
    """A plan file; entries as in `sections`."""

    _path: Path = PrivateAttr(default=Path("plan.toml"))
    _rig: Rig | None = PrivateAttr(default=None)

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def name(self) -> str:
        """Name of the file, without folders."""
        return self._path.name

    @property
    def folder(self) -> Path:
        """Folder that relative paths start from."""
        return self._path.parent

    @property
    def has_cameras(self) -> bool:
        """True where there are cameras, in the plan or given to it."""
        return self._rig is not None or bool(self.camera_names)

    @property
    def rig(self) -> Rig:
        """The cameras with their names.

        Raises
        ------
        PlanError
            For a plan without cameras.
        """
        if self._rig is None:
            types = dict(self.cameras) if self.camera is None else {ONE_CAMERA: self.camera}
            if not types:
                raise PlanError(self.name, [NO_CAMERA])
            built = [each.build(self.folder) for each in types.values()]
            self._rig = Rig(built, list(types))
        return self._rig

    def with_cameras(self, rig: Rig) -> Self:
        """The same plan with other cameras."""
        other = self.model_copy()
        other._rig = rig
        return other

    def without_cameras(self) -> Self:
        """The same plan without cameras of its own, for those that are given to it."""
        other = self.model_copy(update={"camera": None, "cameras": {}})
        other._rig = None
        return other

    def build_camera(self) -> Camera:
        """The camera of all poses; CameraError where there are several."""
        return only_camera(self.rig)

    def cost_of(self, camera: str, place: float | None) -> float:
        """Cost of a camera by its name at a place with a cost of its own; 1 where none has one."""
        own = self.cameras[camera].cost if camera in self.cameras else None
        given = [cost for cost in (own, place) if cost is not None]
        return sum(given) if given else 1.0

    def unit_of_result(self) -> tuple[str, str]:
        """Unit of results, "area" or "face"; and what makes it "face" if the plan does not."""
        if self.task.by is None and self.task.weight_by == "count":
            return "face", "weight_by count is of faces"
        engine = Engine(self.task.method, supersample=self.task.supersample)
        return unit_of_result(self.task.by, self.build_task(), engine, self.rig)

    def build_task(self, views: int | None = None) -> Task:
        """The task; `views` cameras a face for all groups where that is given."""
        own = self.task.model_dump(include=set(Task.__dataclass_fields__))
        # A table by group matters for counting views only, not for what one camera covers.
        by_group = isinstance(self.task.views, dict)
        own["views"] = views or (1 if by_group else self.task.views)
        return Task(**own)


def read_plan(path: StrPath) -> Plan:
    """Plan of a TOML file.

    Raises
    ------
    PlanError
        With a line for everything that is wrong: unknown and missing entries, values outside their
        limits, files that are not there.
    """
    try:
        table = read_toml(path)
    except UnreadableError as error:
        name = path if not isinstance(error, UnparsedError) else Path(path).name
        raise PlanError(printable(str(name)), [str(error)]) from None
    return plan_of(table, Path(path))


def plan_of(table: Mapping[str, Any], path: Path = Path("plan")) -> Plan:
    """Plan of the entries of a file, or of a mapping with the same; errors as of `read_plan`.

    Files are relative to the folder of `path`, which names the plan.
    """
    try:
        plan = Plan.model_validate(table, context={"folder": path.parent})
    except ValidationError as error:
        raise PlanError(path.name, lines_of(error, table, PlanModel)) from None
    plan._path = path
    return plan


def schema() -> dict[str, Any]:
    """JSON schema of plan files, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | (
        PlanModel.model_json_schema() | {"title": "rastercov plan"}
    )
