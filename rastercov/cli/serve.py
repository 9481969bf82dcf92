"""The command `serve`: answers another program, a line of JSON for each line of its own.

docs/serve.md has the requests. A scene is opened once, and then asked any number of times.
"""

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from typer import Option

import rastercov as rc
from rastercov.base import AnyArray, ByName, ConfigError, RastercovError, json_bytes, shown
from rastercov.base.files import (
    LARGEST_TEXT,
    UnreadableError,
    UnwritableError,
    parse_json,
    write_file,
)
from rastercov.cli.console import show_lines
from rastercov.core.camera import Border, Conventions, Poses, Views
from rastercov.core.mesh import Mesh
from rastercov.formats.cameras import own
from rastercov.page.actions import Action, check_entries
from rastercov.placement.plan.check import plan_of_cameras, to_json
from rastercov.placement.plan.file import Plan, plan_of, read_plan
from rastercov.placement.plan.goals import separate_goals
from rastercov.placement.plan.scene import name_scene


class Request(Action):
    """Request of a program; each verb takes some of the entries."""

    do: Literal["open", "evaluate", "regions", "check", "place", "close"]
    id: str | int | None = None
    scene: int = 1
    plan: str | ByName = "plan.toml"
    poses: str | ByName | list[Any] = "rig.json"
    arrays: str | None = None
    summary: bool = False
    min_coverage: float | None = None


class Service:
    """Open scenes by number: the plan as given, its mesh, and the plan in terms of the mesh.

    Groups of goals are not evaluated in the mesh, as they are not part of the task.
    """

    def __init__(self) -> None:
        self._opened = 0
        self._scenes: dict[int, tuple[Plan, Mesh, Plan]] = {}

    def answer(self, line: bytes) -> ByName:
        """Answer to a line: the `id` of its request, and a `result` or the lines of an `error`."""
        number = None
        try:
            if len(line) > LARGEST_TEXT:
                raise ConfigError(
                    f"expected up to {LARGEST_TEXT:,} bytes a line, got more; name files instead"
                )
            entries = parse_json(line, is_strict=True)
            if not isinstance(entries, dict):
                raise ConfigError(
                    "expected a request in { }, got something else; see docs/serve.md"
                )
            number = entries.get("id")
            asked: Request = check_entries(Request, entries)
            return {"id": number, "result": getattr(self, f"_{asked.do}")(asked)}
        except (RastercovError, UnreadableError, UnwritableError, OSError) as error:
            lines = getattr(error, "lines", [str(error)])
        except Exception as error:  # the next request may be another one
            lines = [f"{type(error).__name__}: {error} (a defect of rastercov)"]
        return {"id": number, "error": lines}

    def _open(self, asked: Request) -> ByName:
        given = read_plan(asked.plan) if isinstance(asked.plan, str) else plan_of(asked.plan)
        whole, plan, _ = name_scene(given)
        mesh, _ = separate_goals(plan, whole)
        self._opened += 1
        self._scenes[self._opened] = given, mesh, plan
        return {
            "scene": self._opened,
            "faces": mesh.n_faces,
            "groups": [group.name for group in mesh.groups],
            "cameras": plan.rig.names if plan.has_cameras else [],
            "warnings": mesh.warnings,
        }

    def _scene(self, asked: Request) -> tuple[Plan, Mesh, Plan]:
        if asked.scene not in self._scenes:
            raise ConfigError(
                f"scene: expected one that is open, {[*self._scenes]}, got {asked.scene}; open it"
            )
        return self._scenes[asked.scene]

    def _cameras(self, asked: Request) -> tuple[Mesh, Plan, Poses]:
        """Scene of a request, its plan with the cameras of the request, and their poses."""
        _, mesh, plan = self._scene(asked)
        if not plan.is_still:
            raise ConfigError(f"{asked.do}: expected a static scene, got another; use check")
        return mesh, *plan_of_cameras(plan, _views(asked))

    def _evaluate(self, asked: Request) -> ByName:
        mesh, plan, poses = self._cameras(asked)
        task, by = plan.build_task(), plan.task.by
        result = rc.evaluate(mesh, plan.rig, poses, task, by=by, method=plan.engine, fields=())
        if result.areas is None:
            _write(asked, views=result.network.views)
            return result.summary()
        _write(asked, area=result.covered.area, bound=result.covered.bound)
        return result.summary() if asked.summary else {"covered_area": result.areas.summary()}

    def _regions(self, asked: Request) -> ByName:
        mesh, plan, poses = self._cameras(asked)
        parts = rc.regions(mesh, plan.rig, poses, plan.build_task(), method=plan.engine)
        _write(asked, points=parts.points(), starts=parts.starts, face=parts.face, pose=parts.pose)
        return {"m2": parts.areas().sum(axis=1), "bound_m2": parts.bounds().sum(axis=1)}

    def _check(self, asked: Request) -> ByName:
        return to_json(
            rc.check(self._scene(asked)[0], _views(asked), min_coverage=asked.min_coverage)
        )

    def _place(self, asked: Request) -> ByName:
        from rastercov.report import plan as report

        placed = rc.place(self._scene(asked)[0])
        return report.summary(placed) | {"poses": report.poses_of(placed)}

    def _close(self, asked: Request) -> ByName:
        self._scene(asked)
        del self._scenes[asked.scene]
        return {}


def _views(asked: Request) -> Views:
    """Poses of a request: a file, or what a pose file in JSON has."""
    if isinstance(asked.poses, str):
        return rc.read_views(asked.poses)
    content = asked.poses if isinstance(asked.poses, dict) else {"world_from_camera": asked.poses}
    return own.read(content, Border(Conventions()))


def _write(asked: Request, **arrays: AnyArray) -> None:
    """Write arrays as .npy into the folder of the request, if any."""
    if asked.arrays is None:
        return
    if not (folder := Path(asked.arrays)).is_dir():
        raise ConfigError(f"arrays: expected a folder, got {shown(asked.arrays)}; make it first")
    for name, array in arrays.items():
        with write_file(folder / f"{name}.npy") as file:
            np.save(file, array)


def serve(
    stdio: Annotated[bool, Option("--stdio", help="Use standard input and output.")] = False,
) -> None:
    """Answer requests of another program, a line of JSON each.

    Example: rastercov serve --stdio
    """
    if not stdio or sys.stdin is None:
        raise ConfigError("expected --stdio and an open standard input, got none; give both")
    service, source = Service(), sys.stdin.buffer
    with show_lines(None):
        while line := source.readline(LARGEST_TEXT + 1):
            answer = service.answer(line)
            while not line.endswith(b"\n") and (line := source.readline(LARGEST_TEXT)):
                pass
            sys.stdout.buffer.write(json_bytes(answer) + b"\n")
            sys.stdout.buffer.flush()
