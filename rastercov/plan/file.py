"""Plan files: read `plan.toml` and check it; all its errors are raised at once.

plan.toml -> `read_plan` -> `scene` (mesh, candidates) -> `run` (place), `check`
"""

from pathlib import Path
from typing import Any

from pydantic import PrivateAttr, ValidationError

from rastercov._files import StrPath, UnparsedError, UnreadableError, printable, read_toml
from rastercov.area.network import unit_of_result
from rastercov.camera import Camera
from rastercov.engine import Engine
from rastercov.plan.errors import PlanError, lines_of
from rastercov.plan.sections import PlanModel
from rastercov.task import Task


class Plan(PlanModel):
    """A plan file; entries as in `sections`."""

    _path: Path = PrivateAttr(default=Path("plan.toml"))

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

    def build_camera(self) -> Camera:
        """The camera of all poses."""
        return self.camera.build(self.folder)

    def unit_of_result(self) -> tuple[str, str]:
        """Unit of results, "area" or "face"; and what makes it "face" if the plan does not."""
        if self.task.by is None and self.task.min_angle_deg > 0:
            return "face", "min_angle_deg is of a face"
        if self.task.by is None and self.task.weight_by == "count":
            return "face", "weight_by count is of faces"
        engine = Engine(self.task.method, supersample=self.task.supersample)
        return unit_of_result(self.task.by, self.build_task(), engine)

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
    path = Path(path)
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
