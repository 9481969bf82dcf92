"""Diagnosis of this machine for `rastercov doctor`: devices, libraries, settings, self-tests.

Drivers can crash or hang, so `ask` puts each question to a device in a child process with a time
limit. This process opens no device and needs no graphics library.
"""

import json
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from functools import cache, partial
from typing import get_args

import numpy as np

import rastercov
from rastercov import shaders
from rastercov.base import ByName, DeviceError, RastercovError, thread_count
from rastercov.base.threads import child_environment
from rastercov.base.versions import untested_versions, version_of
from rastercov.core.camera import Camera
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.contract import Criteria, Rasterizer
from rastercov.core.raster.self_test import PASSED
from rastercov.gl.devices import DeviceInfo, DeviceKind, list_devices, why_no_hardware
from rastercov.gl.libraries import INSTALL_EGL, egl_library, osmesa_library

Report = ByName
PACKAGES = ("moderngl", "numpy", "trimesh")
ENVIRONMENT = (
    *("LIBGL_", "GALLIUM_", "MESA_", "EGL_", "__EGL_", "LP_", "NVIDIA_"),
    "CUDA_VISIBLE_DEVICES",
)
"""Beginnings of the names of variables that graphics drivers read."""
# Convex meshes under this camera: no face is so edge-on, below 0.007, that rounding its corners
# could turn it.
CAMERA = Camera(width=61, height=48, fx=60, fy=60)
POSES = sphere_of_poses((0, 0, 0), 3, 4)


def examine(timeout_s: float = 30.0) -> Report:
    """Devices, libraries and settings of this machine, in values that JSON can hold.

    Parameters
    ----------
    timeout_s : float
        Seconds a device may take to open, and again to pass its self-test; a driver that hangs is
        reported as hanging.

    Returns
    -------
    dict
        "kinds": for each kind of context "available", or the reason why not and what to install.
        "reports": for each of `list_devices` "device" (fields of `DeviceInfo`, "label"), "problem"
        (reason and remedy, or ""), "context" (fields and features of `ContextInfo`, or None),
        "self_test" (`PASSED`, the line that says what failed, or None).
        "environment": the variables of `ENVIRONMENT` that are set.
        "hardware_hints": reasons why no hardware renderer works, empty when one does.
        "default": "device" that backend "auto" opens, and "why".
        "shaders": SHA-256. "versions": of packages and the system. "untested": a line for each
        package that is newer or older than what was tested.
        "cpu": "renderer", "threads", "self_test" of the CPU rasteriser.
    """
    devices = list_devices()
    # One after the other: processes that open one GPU at the same time can block each other.
    reports = [_examine_device(device, timeout_s) for device in devices]
    has_hardware = any(row["context"] and not row["context"]["is_software"] for row in reports)
    versions = {"rastercov": rastercov.__version__, "Python": platform.python_version()}
    versions |= {package: version_of(package) or "not installed" for package in PACKAGES}
    return {
        "kinds": {kind: _availability(kind, reports) for kind in get_args(DeviceKind)},
        "reports": reports,
        "environment": {k: v for k, v in sorted(os.environ.items()) if k.startswith(ENVIRONMENT)},
        "hardware_hints": [] if has_hardware else why_no_hardware(devices),
        "default": {"device": "cpu", "why": "it counts faster than OpenGL"},
        "shaders": shaders.digest(),
        "versions": versions | {"OS": platform.platform()},
        "untested": untested_versions(),
        "cpu": {
            "renderer": f"rastercov {versions['rastercov']}",
            "threads": thread_count(None),
            "self_test": _cpu_result(),
        },
    }


def _examine_device(device: DeviceInfo, timeout_s: float) -> Report:
    """Entry of "reports": open a device, then count known scenes on it."""
    row: Report = {
        "device": asdict(device) | {"label": device.label},
        "problem": "",
        "context": None,
        "self_test": None,
    }
    answer = ask(open_device, device.label, timeout_s)
    if "problem" in answer:
        return row | {"problem": f"{device}: {answer['problem']}"}
    row["context"] = answer["context"]
    answer = ask(verify_device, device.label, timeout_s)
    return row | {"self_test": answer.get("problem", PASSED)}


@cache
def find_gpu() -> str:
    """Label of the first hardware device that passes its self-test; "" without one."""
    for device in list_devices():
        if not device.is_software and ask(verify_device, device.label, 30.0) == {}:
            return device.label
    return ""


def _availability(kind: DeviceKind, reports: list[Report]) -> str:
    """Return "available", or the reason why no device of this kind opens and what to install."""
    own = [row for row in reports if row["device"]["kind"] == kind]
    if any(not row["problem"] for row in own):
        return "available"
    if own:
        return "; ".join(row["problem"] for row in own)
    try:
        osmesa_library() if kind == "osmesa" else egl_library()
    except DeviceError as error:
        return str(error)
    return f"EGL reports none; install the device's driver, or {INSTALL_EGL}"


# --- self-tests -----------------------------------------------------------------------------------


def _cpu_result() -> str:
    """Result of `verify_cpu` as one line."""
    try:
        verify_cpu()
    except Exception as error:  # a compiler raises exceptions of any type
        kind = "" if isinstance(error, RastercovError) else f"{type(error).__name__}: "
        return " ".join(f"{kind}{error}".split())
    return PASSED


def verify_cpu() -> None:
    """Count known and convex scenes on the CPU; DeviceError when a count disagrees."""
    from rastercov.core.raster.cpu import CPURasterizer

    _verify(CPURasterizer)


def _verify(opened: Callable[[Mesh, Camera], Rasterizer]) -> None:
    """Count and judge convex meshes, of which each pose shows the whole of a face or nothing.

    A rasteriser counts the scene of `self_test` when it is opened.

    Raises
    ------
    DeviceError
        Where a sum, a face or an image disagrees.
    """
    for name, mesh in {"box": shapes.box(n=2), "sphere": shapes.sphere(1)}.items():
        rasterizer: Rasterizer
        with opened(mesh, CAMERA) as rasterizer:
            counts = rasterizer.count(POSES)
            background = [(rasterizer.render(pose).face < 0).sum() for pose in POSES]
            rules = Task().rules(CAMERA)._asdict()
            criteria = Criteria(rules, np.ones(mesh.n_faces, bool))
            covered = counts.visible > 0
            if not rasterizer._why_not_judged(criteria):
                covered = rasterizer._judge(POSES, criteria)[0].dense()
        wrong = counts.visible.sum(axis=1) + background != CAMERA.width * CAMERA.height
        wrong |= counts.background != background
        wrong |= ((counts.visible > 0) & (counts.visible != counts.drawn)).any(axis=1)
        wrong |= (covered != (counts.visible > 0)).any(axis=1)
        if wrong.any():
            raise DeviceError(
                f"expected correct counts of {name}, got {wrong.sum()} of {len(POSES)} poses wrong"
            )


def open_device(label: str) -> Report:
    """Fields and features of a device's `ContextInfo`, under "context"; for `ask`."""
    # Not above: the child process reports a broken moderngl.
    from rastercov.gl.context import open_context

    with open_context(label) as context:
        names = [name for name in dir(context.info) if name.startswith("has_")]
        features = {name: getattr(context.info, name) for name in names}
        fields = asdict(context.info) | features
        fields["extensions"] = sorted(context.info.extensions)
        del fields["device"]
        return {"context": fields}


def verify_device(label: str) -> Report:
    """Count known and convex scenes in every way; for `ask`.

    Raises
    ------
    DeviceError
        Names the way, and the scene or the count that is wrong.
    """
    # Not above, as in `open_device`.
    from rastercov.gl.context import open_context
    from rastercov.gl.rasterizer import PLANS, GLRasterizer

    with open_context(label) as context:
        for plan in PLANS:
            if plan == "compute" and not context.info.has_int64:
                continue
            try:
                _verify(partial(GLRasterizer, device=context, plan=plan))
            except RastercovError as error:
                raise DeviceError(f"plan {plan}: {error}") from error
    return {}


# --- child processes ------------------------------------------------------------------------------


def ask(question: Callable[[str], Report], label: str, timeout_s: float) -> Report:
    """Result of `question(label)` in a child process, or a "problem" when there is none.

    The question is a function of a module, and JSON can hold its result. `{"problem": one line}`
    after an error, a hang of `timeout_s`, or a crash, even one after the result was sent: it would
    end the user's process as well.
    """
    code = f"from {question.__module__} import {question.__name__} as question\n"
    code += f"from {__name__} import _answer; _answer(question, {label!r})"
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        env=child_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        output, errors = child.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        return {"problem": f"no answer in {timeout_s:g} s, it hangs"}
    finally:
        if child.poll() is None:
            child.kill()
            with suppress(subprocess.TimeoutExpired):  # a process stuck in the driver survives
                child.communicate(timeout=1)
    ending = f"ended with code {child.returncode}"
    if child.returncode < 0:
        ending = f"crashed with {signal.Signals(-child.returncode).name}"
    elif child.returncode == 0:
        with suppress(IndexError, ValueError):
            return json.loads(output.splitlines()[-1])
        ending += " and no answer"
    last_line = errors.decode("utf-8", "replace").strip().splitlines()[-1:]
    return {"problem": ": ".join([f"its process {ending}", *last_line])}


def _answer(question: Callable[[str], Report], label: str) -> None:
    """Print the result as one line of JSON; runs in the child process."""
    try:
        answer = question(label)
    except RastercovError as error:
        answer = {"problem": str(error)}
    print("\n" + json.dumps(answer, allow_nan=False), flush=True)
