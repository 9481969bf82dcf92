"""The command `view`: a page in the browser to see a rig, move its cameras, and understand it."""

import os
import sys
import webbrowser
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from rastercov.base import CameraError, ConfigError, MeshError, first_of, plural, write_text
from rastercov.cli import options
from rastercov.cli.console import out_option, print_lines, say, show_lines, size_line, warn
from rastercov.cli.inputs import (
    AROUND,
    SceneOptions,
    add_unused,
    are_arguments,
    read_again,
    read_cameras,
    read_eyes,
    read_rig,
)
from rastercov.core.camera import Border, Conventions, Poses, Views, unit_warnings
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import shapes

if TYPE_CHECKING:
    from rastercov.page.scene import Scene, Shown

Sources = Annotated[
    list[Path],
    Argument(
        metavar="PLAN|RESULT|MESH",
        help="Plan (.toml), result folder of evaluate, place or audit, mesh files, or a built-in "
        f"mesh: {', '.join(shapes.NAMES)}. Meshes after a result folder replace its meshes.",
    ),
]
RigOption = Annotated[
    str | None,
    Option(
        "--poses",
        "-p",
        help="Rig: a pose file of rastercov or another program, sphere:N or turntable:N@DEG.",
        show_default="none, or that of the result",
    ),
]
NoBrowser = Annotated[
    bool, Option("--no-browser", help="Print the address without opening a browser.")
]
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Variables of a desktop; without one, Python would open a browser in the terminal."""


@options.expand_options
def view(
    sources: Sources,
    files: SceneOptions,
    conventions: Conventions,
    task: Task,
    camera: options.CameraOptions,
    equipment: options.EquipmentOptions,
    poses: RigOption = None,
    out: Annotated[
        Path, Option("--out", "-o", help="Folder for files saved by the viewer.")
    ] = Path("view"),
    method: Annotated[
        str, Option(help="Visibility method: certified, exact or sampled.")
    ] = "certified",
    port: Annotated[int, Option(min=0, max=65535, help="Local port; 0 for any free port.")] = 0,
    no_browser: NoBrowser = False,
    export: Annotated[
        Path | None,
        Option(help="Write a self-contained, interactive .html file and exit."),
    ] = None,
    still: Annotated[
        bool, Option("--still", help="With --export: static results, no editing.")
    ] = False,
) -> None:
    """View a rig in the browser, move its cameras, and see what they cover.

    Example: rastercov view part.stl --unit mm -c camera.toml -p rig.json

    A plan: rastercov view plan.toml

    A page to share: rastercov view teapot -c khepra -p sphere:8 --export page.html
    """
    from rastercov.page.live import record_cause
    from rastercov.page.saving import check_name, export_page, with_drawing
    from rastercov.page.server import serve
    from rastercov.page.session import Session
    from rastercov.report import live

    if export is not None:
        check_name(export)
    elif still:
        raise ConfigError("expected --still with --export, got no --export; add it")

    scene = open_scene(sources, files, conventions, task, camera, poses, equipment)
    start = scene.start
    doubts = unit_warnings(scene.mesh, start.rig(), start.poses()) if start.unit == "m" else []
    warn(*scene.mesh.warnings, *scene.notes, *doubts)
    session = Session(scene, method)
    size = size_line(scene.mesh)
    if start.unit != "m":
        size = f"{plural(scene.mesh.n_faces, 'face')}, without a scale"
    print_lines(f"{scene.title}: {size}, {plural(len(start.stations), 'camera')}")
    if export is not None:
        page = export_page(session, export, is_still=still)
        if not still and (why := record_cause(session, start)):
            say(why)
        print_lines(page)
        return

    if live.engine() is None:
        say(live.BY_PYTHON)
    with_drawing(session, [out, sources[0], *([Path(poses).parent] if poses else [])])
    with ExitStack() as serving, ExitStack() as redirecting:
        started = partial(_start_page, serving, redirecting, not no_browser)
        serve(session, port, out, started, arrived=redirecting.close)


def _start_page(serving: ExitStack, redirecting: ExitStack, opens: bool, url: str) -> None:
    """Print the address of the page, and open it in a browser."""
    from rastercov.page.server import redirect

    serving.enter_context(show_lines(None))  # no wait, but until it is stopped
    print_lines(url)
    say("press Ctrl-C to stop")
    if not opens or not _has_display("forward the port with ssh -L and open the address elsewhere"):
        return
    try:
        page = redirecting.enter_context(redirect(url)).as_uri()
    except OSError as error:
        say(f"cannot open a browser ({error.strerror}); open the address yourself")
        return
    # The page is answered once this thread serves; a browser may hold its own.
    Thread(target=webbrowser.open, args=(page,), daemon=True).start()


def _has_display(remedy: str) -> bool:
    """True where a browser can be opened; says what to do instead."""
    # Those of other systems have no name.
    if sys.platform != "linux" or any(map(os.environ.get, DISPLAYS)):
        return True
    say(f"no display found: {remedy}")
    return False


def playground(
    out: Annotated[Path, out_option("File to write, .html.")] = Path("playground.html"),
    no_browser: NoBrowser = False,
) -> None:
    """Write a page that computes without rastercov, for a mesh of its reader.

    Example: rastercov playground --out page.html
    """
    from rastercov.page.saving import check_name
    from rastercov.report import live

    check_name(out)
    if live.engine() is None:
        raise ConfigError(f"expected the engine of pages, got {live.WITHOUT}")
    write_text(out, live.playground())
    print_lines(out)
    if not no_browser and _has_display("open the file in a browser elsewhere"):
        webbrowser.open(out.absolute().as_uri())


def open_scene(
    sources: list[Path],
    files: SceneOptions,
    conventions: Conventions,
    task: Task,
    camera: options.CameraOptions,
    poses: str | None,
    equipment: options.EquipmentOptions,
) -> "Scene":
    """Scene of a plan, of the folder of a result, or of mesh files, with equipment of files."""
    from rastercov.page.scene import open_plan

    first = sources[0]
    is_plan = first.suffix.lower() == ".toml"
    if is_plan or first.is_dir():
        if poses is not None and poses.startswith(AROUND):
            raise ConfigError(
                f"expected a pose file for {first}, got {poses}, which needs mesh files; "
                "give a pose file"
            )
        if task != Task():
            raise ConfigError(
                f"expected no threshold options with {first}, which has its own, got some; "
                "change those in `rastercov view`"
            )
        rig = read_cameras(camera.camera, border := Border(conventions))
        if poses is not None:
            rig = read_rig(camera, Path(poses), conventions)
        elif rig is not None:
            rig = add_unused(rig, border)
    if is_plan:
        if sources[1:]:
            raise ConfigError(
                "expected a plan alone, got mesh files as well; name them in the plan"
            )
        scene = open_plan(first, rig)
    elif first.is_dir():
        scene = _of_result(first, sources[1:], files, rig)
    else:
        rig, scene = None, _of_meshes(sources, files, camera, poses, conventions, task)
    if rig is not None:
        scene = replace(scene, notes=(*scene.notes, *rig.notes))
    return scene.equip(equipment) if any(equipment.values()) else scene


def _of_result(folder: Path, meshes: list[Path], given: SceneOptions, rig: Views | None) -> "Scene":
    """Scene of a result, from its own arguments unless others are given.

    Its meshes are looked for where they were, and beside it, unless they are given.
    """
    from rastercov.page.scene import open_result, run_of, scene_of_place, state_of

    def result(names: list[str]) -> "Shown":
        options = run_of(folder).get("options")
        arguments: Any = options.get("scene") if isinstance(options, Mapping) else None
        if are_arguments(arguments) and given == SceneOptions():
            return read_again(folder, arguments, names, meshes)
        if meshes:
            return given.read(meshes), {}
        if given == SceneOptions() and (shown := scene_of_place(folder)) is not None:
            return shown
        return read_again(folder, given.entries(folder, [Path(name) for name in names]), names, [])

    scene = open_result(folder, result)
    if rig is None:
        return scene
    if rig.rig is None:
        raise CameraError("expected a camera with the rig, got none; give --camera")
    return replace(scene, start=replace(state_of(rig, scene.start.task), unit=scene.start.unit))


def _of_meshes(
    sources: list[Path],
    given: SceneOptions,
    camera: options.CameraOptions,
    poses: str | None,
    conventions: Conventions,
    task: Task,
) -> "Scene":
    from rastercov.page.scene import open_mesh

    try:
        mesh = given.read(sources)
    except MeshError as error:
        words = "a plan, a folder of results, a mesh file or a built-in"
        raise MeshError(str(error).replace("a mesh file or a built-in", words)) from None
    if poses is not None:
        views = read_eyes(mesh, camera, poses, conventions, several=True)
    else:
        cameras = read_cameras(camera.camera, border := Border(conventions))
        if cameras is None:
            raise CameraError("expected a camera, got none; give --camera, a file or a preset")
        views = add_unused(replace(cameras, poses=Poses.of(()), images=()), border)
    return open_mesh(mesh, views, task, first_of([path.name for path in sources], 3))
