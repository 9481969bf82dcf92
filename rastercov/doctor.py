"""What `rastercov doctor` runs: tries and tests every device, and says what will be used.

Beside the chain, for the person at its end: `examine` gathers plain values, `print_report` shows
them, `exit_code` tells a script. Each device opens and is tested in a process of its own, because
drivers can crash or hang; this process opens none and works without any graphics library.
"""

import platform
import re
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from rastercov import __version__, shaders, shapes
from rastercov.camera import Camera
from rastercov.errors import DeviceError, RastercovError
from rastercov.pose import sphere_of_poses
from rastercov.raster import canary
from rastercov.raster.contract import FaceCounts
from rastercov.raster.devices import candidates, is_software_wanted
from rastercov.raster.diagnose import ENVIRONMENT, ask, diagnose
from rastercov.raster.libraries import install_line

PASSED = "passed"
_CAMERA, _SCALE, _POSES = Camera(width=61, height=48, fx=60, fy=60), 2, sphere_of_poses(0, 3, 5)
_SCENES = {  # name: mesh, camera, poses, supersample
    "the known scene": (canary.MESH, canary.CAMERA, canary.POSES, 1),
    "a box": (shapes.box(n=2), _CAMERA, _POSES, _SCALE),
    "a sphere": (shapes.sphere(2), _CAMERA, _POSES, _SCALE),
}


# --- gathering ------------------------------------------------------------------------------------


def examine(timeout_s: float = 30.0) -> dict[str, Any]:
    """Everything about the devices of this machine, in values that JSON can hold.

    Parameters
    ----------
    timeout_s : float
        Seconds a device may take to open, and again to pass its self-test.

    Returns
    -------
    dict
        `Diagnosis.to_dict()`, where each of "reports" also has "self_test" ("passed", the line that
        says what failed, or None where the device does not open), "plan" (what "auto" runs) and
        "depth"; further "default" ("device" and "why"), "install" (a line for each missing
        library), "shaders" (SHA-256) and "versions".
    """
    report = diagnose(timeout_s=timeout_s).to_dict()
    for row in report["reports"]:
        row |= {"self_test": None, "plan": None, "depth": None}
        if not row["problem"]:
            answer = ask(self_test, row["device"]["label"], timeout_s)
            row |= {"self_test": answer.pop("problem", PASSED)} | answer
    report["default"] = _default(report["reports"])
    report["install"] = {
        library: install_line("osmesa" if library == "OSMesa" else "egl")
        for library, file in report["libraries"].items()
        if file is None
    }
    report["shaders"] = shaders.digest()
    report["versions"] = _versions()
    return report


def _default(rows: list[dict[str, Any]]) -> dict[str, str | None]:
    """Label of the device that "auto" opens, None without one, and why that one."""
    opens = {row["device"]["label"] for row in rows if not row["problem"]}
    device = next((known for known in candidates("auto")[0] if known.label in opens), None)
    if device is None:
        return {"device": None, "why": "no device opens"}
    if not device.is_software:
        return {"device": device.label, "why": "it is the first device that draws in hardware"}
    forbidden = "LIBGL_ALWAYS_SOFTWARE forbids hardware"
    why = forbidden if is_software_wanted() else "no hardware device opens"
    return {"device": device.label, "why": why}


def _versions() -> dict[str, str]:
    """Versions of what draws and counts, and of what that runs on."""
    versions = {"rastercov": __version__, "Python": platform.python_version()}
    for package in ("moderngl", "numpy", "trimesh"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    try:
        system = platform.freedesktop_os_release()["PRETTY_NAME"] + ", "
    except OSError:
        system = ""
    return versions | {"OS": f"{system}{platform.system()} {platform.release()}"}


# --- the self-test of one device, in a child process ----------------------------------------------


def self_test(label: str) -> dict[str, Any]:
    """Count scenes with known answers on one device, under every plan it can run; for `ask`.

    Returns
    -------
    dict
        "plan" that "auto" runs and "depth".

    Raises
    ------
    DeviceError
        Naming the plan, the scene and what was wrong.
    """
    from rastercov.raster.egl import open_context
    from rastercov.raster.gl import GLRasterizer

    with open_context(label) as context:
        plans = ("software", "hardware") if context.info.has_batches else ("software",)
        for name, (mesh, camera, poses, scale) in _SCENES.items():
            counted: list[FaceCounts] = []
            for plan in plans:
                options: Any = {"device": context, "plan": plan, "supersample": scale}
                try:
                    with GLRasterizer(mesh, camera, **options) as rasterizer:
                        counted.append(rasterizer.count(poses))
                    _check(counted[-1], name, scale**2 * camera.width * camera.height)
                    _compare(counted[0], counted[-1])
                except RastercovError as error:
                    raise DeviceError(f"plan {plan}, {name}: {error}") from error
        with GLRasterizer(canary.MESH, canary.CAMERA, device=context) as rasterizer:
            return {"plan": rasterizer.info.plan, "depth": rasterizer.info.depth}


def _check(counts: FaceCounts, scene: str, samples: int) -> None:
    """Compare counts with what is known of them before anything is drawn."""
    assert counts.drawn is not None
    totals = counts.visible.sum(axis=1) + counts.background
    if wrong := int((totals != samples).sum()):
        raise DeviceError(f"visible and background do not add up to {samples} in {wrong} poses")
    wrong_faces = (counts.visible > counts.drawn) | (counts.visible < 0)
    if scene == "the known scene":
        wrong_faces = (counts.visible != canary.VISIBLE) | (counts.drawn != canary.DRAWN)
    elif scene == "a box":  # convex: each side is wholly seen or wholly hidden
        wrong_faces = (counts.visible != 0) & (counts.visible != counts.drawn)
    if wrong_faces.any() or not counts.visible.any():
        pose, face = np.argwhere(wrong_faces | (counts.visible.sum() == 0))[0]
        raise DeviceError(
            f"{wrong_faces.sum()} of {wrong_faces.size} counts are wrong, first pose {pose} face "
            f"{face}: {counts.visible[pose, face]} of {counts.drawn[pose, face]} samples visible"
        )


def _compare(one: FaceCounts, other: FaceCounts) -> None:
    """Check that two plans give the same counts."""
    for name in ("visible", "drawn", "background"):
        differ = getattr(one, name) != getattr(other, name)
        if differ.any():
            raise DeviceError(
                f"{differ.sum()} of {differ.size} {name} counts differ between the plans"
            )


# --- showing --------------------------------------------------------------------------------------


def exit_code(report: dict[str, Any]) -> int:
    """0 when a device passes its self-test, 1 when none of them does, 2 when there is none."""
    results = [row["self_test"] for row in report["reports"]]
    return 0 if PASSED in results else 1 if results else 2


def print_report(report: dict[str, Any], console: Console) -> None:
    """Print what `examine` found, for a person; the last sentence says what will be used."""
    rows = report["reports"]
    versions = [f"{name} {number}" for name, number in report["versions"].items() if name != "OS"]
    _print(console, ", ".join(versions) + f", {report['versions']['OS']}")
    _print(console, f"shaders {report['shaders'][:16]}", style="dim")
    if rows:
        console.print(_table(rows), _limits(report), sep="\n")
    for row in rows:
        label, problem = row["device"]["label"], row["problem"] or row["self_test"]
        if problem != PASSED:
            _print(console, problem if row["problem"] else f"{label}: {problem}", style="red")
    _section(console, "Missing libraries", [f"{k}: {v}" for k, v in report["install"].items()])
    ...
