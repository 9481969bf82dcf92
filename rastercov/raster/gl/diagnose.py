"""Which devices of this machine open and count right, and what is missing where they do not.

Behind `rastercov doctor`, above everything that finds and opens devices. Drivers can crash or hang,
so `ask` puts each question to a device in a process of its own, with a time limit.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from rastercov import shapes
from rastercov.camera import Camera
from rastercov.errors import DeviceError, RastercovError
from rastercov.pose import sphere_of_poses
from rastercov.raster import self_test as canary
from rastercov.raster.contract import CountArray
from rastercov.raster.gl.devices import DeviceInfo, Kind, list_devices, why_no_hardware
from rastercov.raster.gl.libraries import (
    egl_library,
    install_line,
    library_names,
    osmesa_library,
)

ENVIRONMENT = {  # variable: what it does
    "LIBGL_ALWAYS_SOFTWARE": "1 forbids hardware",
    "GALLIUM_DRIVER": "chooses Mesa's driver",
    "EGL_PLATFORM": "chooses EGL's default display, which is not used here",
    "LIBGL_DRIVERS_PATH": "where Mesa looks for drivers",
    "__EGL_VENDOR_LIBRARY_DIRS": "where EGL looks for drivers",
    "__EGL_VENDOR_LIBRARY_FILENAMES": "the only drivers EGL loads",
    "MESA_GL_VERSION_OVERRIDE": "makes Mesa claim another OpenGL version",
    "MESA_EXTENSION_OVERRIDE": "makes Mesa claim other extensions",
    "NVIDIA_DRIVER_CAPABILITIES": "a container needs all or graphics",
    "NVIDIA_VISIBLE_DEVICES": "the GPUs a container sees",
    "CUDA_VISIBLE_DEVICES": "EGL ignores it",
    "LP_NUM_THREADS": "threads of llvmpipe",
}


@dataclass(frozen=True)
class DeviceReport:
    """What came of opening one device in a process of its own.

    Attributes
    ----------
    device : DeviceInfo
        The device tried.
    problem : str
        Why it cannot be used and what to do; empty when it can.
    context : dict or None
        The fields of `ContextInfo` and its features, but not the device; None with a problem.
    """

    device: DeviceInfo
    problem: str
    context: dict[str, Any] | None


@dataclass(frozen=True)
class Diagnosis:
    """Devices, libraries and settings of this machine.

    Attributes
    ----------
    kinds : dict
        For each kind of context "available", or why it is not and what to install.
    reports : tuple of DeviceReport
        One for each device of `list_devices`.
    libraries : dict
        The file loaded for "EGL", "OpenGL" and "OSMesa"; None for a missing one.
    environment : dict
        The variables of `ENVIRONMENT` that are set.
    hardware_hints : tuple of str
        Why no hardware renderer may be had; empty when one works.
    """

    kinds: dict[str, str]
    reports: tuple[DeviceReport, ...]
    libraries: dict[str, str | None]
    environment: dict[str, str]
    hardware_hints: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Everything as dicts, lists, strings and numbers, for JSON."""
        plain: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        for report, row in zip(self.reports, plain["reports"], strict=True):
            row["device"]["label"] = report.device.label
        return plain


def diagnose(*, timeout_s: float = 30.0) -> Diagnosis:
    """Try every device, each in a process of its own, and say what is missing.

    Parameters
    ----------
    timeout_s : float
        Seconds a device may take to open; a driver that hangs is reported, not waited for.
    """
    devices = list_devices()
    # One after the other: several processes that open one GPU at a time can block each other.
    reports = tuple(_try_device(device, timeout_s) for device in devices)
    has_hardware = any(r.context and not r.context["is_software"] for r in reports)
    return Diagnosis(
        kinds={kind: _availability(kind, reports) for kind in get_args(Kind)},
        reports=reports,
        libraries=library_names(),
        environment={name: os.environ[name] for name in ENVIRONMENT if name in os.environ},
        hardware_hints=() if has_hardware else tuple(why_no_hardware(devices)),
    )


def _availability(kind: Kind, reports: tuple[DeviceReport, ...]) -> str:
    """Say "available", or why no device of this kind opens and what to install."""
    own = [report for report in reports if report.device.kind == kind]
    if any(not report.problem for report in own):
        return "available"
    if own:
        return "; ".join(report.problem for report in own)
    try:
        osmesa_library() if kind == "osmesa" else egl_library()
    except DeviceError as error:
        return str(error)
    return f"EGL announces none; install the device's driver, or Mesa: {install_line('egl')}"


def _try_device(device: DeviceInfo, timeout_s: float) -> DeviceReport:
    answer = ask(describe, device.label, timeout_s)
    problem = f"{device}: {answer['problem']}" if "problem" in answer else ""
    return DeviceReport(device, problem, answer.get("context"))


# --- questions to a device, each answered in a process of its own ---------------------------------


def describe(label: str) -> dict[str, Any]:
    """Open a device and say what it is, under "context"; for `ask`."""
    from rastercov.raster.gl.context import (
        open_context,  # not above: a child reports a broken moderngl
    )

    with open_context(label) as context:
        names = [name for name in dir(context.info) if name.startswith("has_")]
        features = {name: getattr(context.info, name) for name in names}
        fields = asdict(context.info) | features
        fields["extensions"] = sorted(context.info.extensions)
        del fields["device"]
        return {"context": fields}


def self_test(label: str) -> dict[str, Any]:
    """Plan and depth that "auto" gives one device, once it counted known scenes under every plan.

    The canary's counts are known; a convex mesh shows the whole of a face or nothing; samples add
    up; plan "hardware" must repeat plan "software", as both draw alike, while "compute" projects in
    double precision. `ask` runs this in a process of its own.

    Raises
    ------
    DeviceError
        Naming the plan, the scene and what was wrong.
    """
    from rastercov.raster.gl import GLRasterizer
    from rastercov.raster.gl.context import open_context  # as in `describe`

    # No face of these scenes is so edge-on, below 0.007, that rounding its corners could turn it.
    around = Camera(width=61, height=48, fx=60, fy=60), sphere_of_poses((0, 0, 0), 3, 4)
    scenes = {
        "known scene": (canary.MESH, canary.CAMERA, canary.POSES),
        "box": (shapes.box(n=2), *around),
        "sphere": (shapes.sphere(1), *around),
    }
    truth: dict[str, tuple[CountArray, CountArray]] = {
        "known scene": (canary.VISIBLE, canary.DRAWN)
    }
    drawn_alike, computed = truth.copy(), truth.copy()
    with open_context(label) as context:
        plans = {"software": drawn_alike}
        if context.info.has_batches:
            plans["hardware"] = drawn_alike
        if context.info.has_compute_raster:
            plans["compute"] = computed
        for plan, name in ((plan, name) for plan in plans for name in scenes):
            mesh, camera, poses = scenes[name]
            known = plans[plan]
            try:
                with GLRasterizer(mesh, camera, device=context, plan=plan) as rasterizer:
                    counts = rasterizer.count(poses)
                assert counts.drawn is not None
                whole = np.where(counts.visible > 0, counts.drawn, 0)
                visible, drawn = known.setdefault(name, (whole, counts.drawn))
                total = counts.visible.sum(axis=1) + counts.background
                _compare("visible", counts.visible, visible)
                _compare("drawn", counts.drawn, drawn)
                _compare("visible + background", total, camera.width * camera.height)
            except RastercovError as error:
                raise DeviceError(f"plan {plan}, {name}: {error}") from error
        with GLRasterizer(canary.MESH, canary.CAMERA, device=context) as rasterizer:
            return {"plan": rasterizer.info.plan, "depth": rasterizer.info.depth}


def _compare(what: str, got: Any, wanted: Any) -> None:
    wrong = np.argwhere(got != wanted)
    if wrong.size:
        at = tuple(int(index) for index in wrong[0])
        first = f"wanted {np.broadcast_to(wanted, got.shape)[at]}, got {got[at]} at {at}"
        raise DeviceError(f"{len(wrong)} of {got.size} counts '{what}' are wrong; {first}")


def ask(question: Callable[[str], dict[str, Any]], label: str, timeout_s: float) -> dict[str, Any]:
    """Answer of `question(label)` from a new process, or a "problem" when none comes.

    Parameters
    ----------
    question : callable
        A module's function, which returns what JSON can hold.
    label : str
        The device, as `open_context` takes it.
    timeout_s : float
        Seconds until the process is killed.

    Returns
    -------
    dict
        The answer; `{"problem": one line}` after an error, a crash (though it be after the answer,
        for it would end the user's process as well) or a hang.
    """
    code = f"from {question.__module__} import {question.__name__} as question\n"
    code += f"from {__name__} import _answer; _answer(question, {label!r})"
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", code],  # -P: no modules from the working directory
        env={**os.environ, "PYTHONPATH": path},
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
            with suppress(subprocess.TimeoutExpired):  # stuck in the driver, it may not even die
                child.communicate(timeout=1)
    how = f"ended with code {child.returncode}"
    if child.returncode < 0:
        how = f"crashed with {signal.Signals(-child.returncode).name}"
    elif child.returncode == 0:
        with suppress(IndexError, ValueError):
            answer: dict[str, Any] = json.loads(output.splitlines()[-1])
            return answer
        how += " and no answer"
    last = errors.decode("utf-8", "replace").strip().splitlines()[-1:]
    return {"problem": ": ".join([f"its process {how}", *last])}


def _answer(question: Callable[[str], dict[str, Any]], label: str) -> None:
    """Print the answer as one line of JSON; runs in the child process."""
    try:
        answer = question(label)
    except RastercovError as error:
        answer = {"problem": str(error)}
    print("\n" + json.dumps(answer, allow_nan=False), flush=True)
