"""Arguments and options that several commands share."""

import functools
import inspect
import os
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    NamedTuple,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from typer import Argument, Option

from rastercov.base import ByName, ConfigError, hooks_of
from rastercov.base.arguments import annotations_of, document_fields, reader_of
from rastercov.base.threads import THREADS, thread_count
from rastercov.cli.console import out_option
from rastercov.core.camera import Conventions, EquipmentKind
from rastercov.core.camera.conventions import POSE_CONVENTIONS
from rastercov.core.camera.rig import Phased, phased_features
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh, shapes
from rastercov.shards import Workers

if TYPE_CHECKING:
    from rastercov.placement.plan.phases import PlanPhases

Meshes = Annotated[
    list[Path],
    Argument(
        metavar="MESH",
        help="Mesh files (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, DAE, STEP, IFC) of one scene, "
        f"or a built-in mesh: {', '.join(shapes.NAMES)}.",
    ),
]
CamerasOption = Annotated[
    list[str],
    Option(
        "--camera",
        "-c",
        help="Camera file of rastercov (.toml, .json), COLMAP, nerfstudio, OpenCV, ROS, Kalibr, "
        "Metashape or others; NAME or NAME+LENS of the catalogue (`rastercov cameras`); or "
        "entries of a camera file, "
        "'preset = \"khepra\", near = 0.1' or 'width = 1280, height = 800, hfov_deg = 60'. For "
        "several cameras, repeat NAME=FILE; poses refer to the names.",
        show_default="those of --poses, or of the plan for commands that take one",
    ),
]
PosesOption = Annotated[
    str,
    Option(
        "--poses",
        "-p",
        help="Pose file of rastercov (.json, .npy), COLMAP, nerfstudio or others; sphere:N for N "
        "poses around the mesh, at the distance where it fills the image (farther if focus_range "
        "requires it); or turntable:N@DEG,N@DEG for rings of N poses at an elevation of DEG.",
    ),
]
Out = Annotated[Path, out_option("Folder for the report.")]
Pdf = Annotated[
    bool, Option("--pdf", help="Also print the page to PDF (needs Chromium or Chrome).")
]
Device = Annotated[
    str,
    Option(
        help="Device for sampling and pictures: auto, cpu, hardware (a GPU), or a name from "
        "rastercov doctor, such as egl:0."
    ),
]
Sheet = Annotated[
    Path | None,
    Option(
        "--sheet",
        help="TOML file, such as a plan, whose table [sheet] fills the title block of the page: "
        "project, customer, author, revision, date.",
    ),
]
AsJson = Annotated[bool, Option("--json", help="Print the result as JSON.")]
Level = Annotated[
    int | None,
    Option(
        min=1, help="Depth of the part tree in tables: 1 for assemblies, 2 for their children, ..."
    ),
]
Thesis = Annotated[
    bool,
    Option(
        "--thesis",
        help="Use eq. (3.6) of E. S. Eissa (2020) exactly, without --min-coverage; see "
        "docs/appendix/equations.md.",
    ),
]
CameraName = Annotated[
    str | None, Option(help="Name of the camera to use, for files with several.")
]


class SceneFiles(dict[str, Path | None]):
    """Further files of a scene, by the names of their options, None for those not given."""

    def phases(self, mesh: Mesh, method: str = "certified") -> "PlanPhases | None":
        """Phases of a scene by the file that gives some; None without."""
        for each in phased_features():
            if (path := self.get(each.word)) is not None:
                phases: PlanPhases = each.read(path, mesh, method)
                return phases
        return None


class EquipmentOptions(dict[str, Path | None]):
    """Files of equipment, by its word."""


class ProcessOptions(NamedTuple):
    """Processes that measure."""

    workers: Annotated[
        int | None,
        Option(
            help="Number of worker processes on this machine.",
            show_default="threads only",
        ),
    ] = None
    scheduler: Annotated[
        str | None,
        Option(
            help="Address of a Dask scheduler: tcp://127.0.0.1:8786, or tls://HOST:PORT.",
        ),
    ] = None

    only: Annotated[
        str | None,
        Option(
            metavar="I/N",
            help="Make only the shards whose number is I modulo N, without a report; the command "
            "without it finishes. N such commands may share the folder, as in a SLURM array.",
        ),
    ] = None

    threads: Annotated[
        int | None,
        Option(help="Number of threads of a process.", show_default="one per core"),
    ] = None

    def open(self) -> Workers | None:
        """Choice of workers; None for this process. Sets the number of threads."""
        if self.threads is not None:
            os.environ[THREADS] = str(thread_count(self.threads))
        return Workers.of(self.workers, self.scheduler, self.only)


class CameraOptions(NamedTuple):
    """Cameras, and the one to use."""

    camera: CamerasOption = []  # noqa: RUF012 - typer copies it
    camera_name: CameraName = None


CONVENTIONS = {
    "pixel_centre": (
        float | None,
        "Coordinate of the first pixel's centre, px, 0 or 0.5, if the camera file states none.",
    ),
    "lens_model": (
        str | None,
        "Lens model for four distortion coefficients, brown or fisheye, if the file states none.",
    ),
    "pose_unit": (
        str | None,
        "Unit of poses, m, mm, cm, um, in, ft, or metres per unit, if their file states none.",
    ),
    "image_size": (str | None, "WIDTHxHEIGHT, px, if the camera file states none."),
    "pose_convention": (
        str | None,
        f"Convention of plain 4 x 4 matrices: {', '.join(POSE_CONVENTIONS)}.",
    ),
    "original_world": (bool, "Undo applied_transform of a transforms.json."),
    "skip_bad_poses": (
        bool,
        "Skip poses that are not rigid transforms or that crash a worker process.",
    ),
}
"""Types and words of the options of `Conventions`."""


def expand_options(command: Callable[..., None]) -> Callable[..., None]:
    """Replace parameters of a command that are several options together by these options.

    They are of type `Conventions`, `Task`, `SceneFiles`, `EquipmentOptions`, or a named tuple. With
    `--thesis` the fields that `Task.thesis` sets keep its values.
    """
    signature = inspect.signature(command)
    parameters: list[inspect.Parameter] = []
    made: dict[str, tuple[list[str], Callable[[ByName], object]]] = {}
    make: Callable[[ByName], object]
    for each in signature.parameters.values():
        kind = each.annotation
        if kind is Conventions:
            own, make = _of_conventions(), _conventions
        elif kind is Task:
            own, make = _of_task(), _task
        elif kind is SceneFiles:
            own, make = _of_files(phased_features()), SceneFiles
        elif kind is EquipmentOptions:
            own, make = _of_files(hooks_of(EquipmentKind)), EquipmentOptions
        elif hasattr(kind, "_fields"):
            own, make = _of_tuple(kind), functools.partial(_tuple, kind)
        else:
            parameters.append(each)
            continue
        for option in own:
            panel = kind.__name__.removesuffix("Options").removesuffix("Files")
            option.annotation.__metadata__[0].rich_help_panel = panel
        parameters += own
        made[each.name] = [option.name for option in own], make

    @functools.wraps(command)
    def with_options(**values: object) -> None:
        for name, (names, make) in made.items():
            values[name] = make({option: values.pop(option) for option in names})
        command(**values)

    with_options.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined] # of Callable
    with_options.__annotations__ = {each.name: each.annotation for each in parameters}
    return with_options


def _parameter(name: str, default: object, annotation: object) -> inspect.Parameter:
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _of_tuple(kind: type[NamedTuple]) -> list[inspect.Parameter]:
    hints = get_type_hints(kind, include_extras=True)
    defaults = dict.fromkeys(kind._fields, inspect.Parameter.empty) | kind._field_defaults
    return [_parameter(name, defaults[name], hints[name]) for name in kind._fields]


def _tuple(kind: Callable[..., object], values: ByName) -> object:
    return kind(**values)


def _of_files(kinds: Iterable[Phased | EquipmentKind]) -> list[inspect.Parameter]:
    return [
        _parameter(each.word, None, Annotated[Path | None, Option(help=each.help)])
        for each in kinds
    ]


def _of_conventions() -> list[inspect.Parameter]:
    of_conventions = []
    for name, (hint, text) in CONVENTIONS.items():
        words = (f"--{name.replace('_', '-')}",) if hint is bool else ()
        option: Any = Annotated[hint, Option(*words, help=text)]
        of_conventions.append(_parameter(name, False if hint is bool else None, option))
    return of_conventions


def _conventions(answers: ByName) -> Conventions:
    answers["image_size"] = _image_size(answers["image_size"])
    if answers["pose_unit"] is not None:
        answers["pose_unit"] = number_or_name(answers["pose_unit"])
    return Conventions(**answers)


def _image_size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    if (match := re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", text.strip())) is None:
        raise ConfigError(f"--image-size: expected WIDTHxHEIGHT, got {text!r}; write 1280x1024")
    return int(match[1]), int(match[2])


def number_or_name(text: str) -> str | float:
    """A unit: a number of metres, or the name as it is."""
    with suppress(ValueError):
        return float(text)
    return text


def _of_task() -> list[inspect.Parameter]:
    """An option for each number of `Task`, and `--thesis`."""
    hints, defaults = annotations_of(Task), {field.name: field.default for field in fields(Task)}
    numbers = {name for name, hint in hints.items() if _plain(hint) in (int, float, float | None)}
    parameters = [
        _parameter(name, defaults[name], _option(hints[name], text))
        for name, text in document_fields(Task).items()
        if name in numbers
    ]
    return [*parameters, _parameter("thesis", False, Thesis)]


def _task(thresholds: ByName) -> Task:
    if thresholds.pop("thesis"):
        if (given := thresholds.pop("min_coverage")) != Task().min_coverage:
            words = f"expected --thesis or --min-coverage, got both ({given:g}); give one"
            raise ConfigError(words)
        return Task.thesis(**thresholds)
    return Task(**thresholds)


def _option(hint: object, text: str) -> Any:
    """Annotation of an option for a number; text where names and units are read, too."""
    if (reader := reader_of(hint)) is not None:
        return Annotated[str, Option(help=text, metavar=reader.metavar)]
    return Annotated[_plain(hint), Option(help=text)]


def _plain(hint: object) -> Any:
    """Annotation without metadata."""
    if get_origin(hint) is Annotated:
        return get_args(hint)[0]
    if get_origin(hint) in (Union, UnionType):
        return Union[tuple(_plain(member) for member in get_args(hint))]  # noqa: UP007 - members in a tuple
    return hint
