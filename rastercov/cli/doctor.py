"""What `rastercov doctor` runs: tests the CPU and every device, and says what will be used.

Beside the chain, for the person at its end: `examine` gathers plain values, `print_report` shows
them, `exit_code` tells a script. Each OpenGL device opens and is tested in a process of its own,
because drivers can crash or hang; this process opens none and works without any graphics library.
"""

import json
import os
import platform
import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from rastercov import __version__, shaders, shapes
from rastercov.camera import Camera
from rastercov.cli.options import AsJson
from rastercov.errors import DeviceError, RastercovError
from rastercov.pose import sphere_of_poses
from rastercov.raster.gl.devices import candidates, is_software_wanted
from rastercov.raster.gl.diagnose import ENVIRONMENT, ask, diagnose, self_test
from rastercov.raster.gl.libraries import install_line

Report = dict[str, Any]
Rows = Sequence[tuple[str, ...]]
PASSED = "passed"


def examine(timeout_s: float = 30.0) -> Report:
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
        "depth"; further "cpu" ("renderer", "threads", "self_test"), "default" ("device", "why"),
        "install" (a line for each library that OpenGL misses), "shaders" (SHA-256), "versions".
    """
    report = diagnose(timeout_s=timeout_s).to_dict()
    for row in report["reports"]:
        row |= {"self_test": None, "plan": None, "depth": None}
        if not row["problem"]:
            answer = ask(self_test, row["device"]["label"], timeout_s)
            row |= {"self_test": answer.pop("problem", PASSED)} | answer
    report["default"] = _default(report["reports"])
    missing = [library for library, file in report["libraries"].items() if file is None]
    report["install"] = {
        library: install_line("osmesa" if library == "OSMesa" else "egl") for library in missing
    }
    report["shaders"] = shaders.digest()
    report["versions"] = {"rastercov": __version__, "Python": platform.python_version()}
    for package in ("moderngl", "numba", "numpy", "trimesh"):
        try:
            report["versions"][package] = version(package)
        except PackageNotFoundError:
            report["versions"][package] = "not installed"
    report["versions"]["OS"] = platform.platform()
    renderer, threads = f"numba {report['versions']['numba']}", len(os.sched_getaffinity(0))
    report["cpu"] = {"renderer": renderer, "threads": threads, "self_test": PASSED}
    try:
        cpu_self_test()
    except Exception as error:  # what a compiler raises can have any type
        kind = "" if isinstance(error, RastercovError) else f"{type(error).__name__}: "
        report["cpu"]["self_test"] = " ".join(f"{kind}{error}".split())
    return report


def cpu_self_test() -> None:
    """Count convex meshes on the CPU; DeviceError when a sum, a face or an image does not agree."""
    from rastercov.raster.cpu import CPURasterizer  # not above: numba may be broken

    camera, poses = Camera(width=61, height=48, fx=60, fy=60), sphere_of_poses((0, 0, 0), 3, 4)
    for name, mesh in {"box": shapes.box(), "sphere": shapes.sphere(1)}.items():
        with CPURasterizer(mesh, camera) as rasterizer:
            counts = rasterizer.count(poses)
            background = [(rasterizer.render(pose).face < 0).sum() for pose in poses]
        wrong = counts.visible.sum(axis=1) + background != camera.width * camera.height
        wrong |= counts.background != background
        wrong |= ((counts.visible > 0) & (counts.visible != counts.drawn)).any(axis=1)
        if wrong.any():
            raise DeviceError(f"{name}: {wrong.sum()} of {len(poses)} poses are counted wrongly")


def _default(rows: list[Report]) -> dict[str, str]:
    """Label of what "auto" opens, a hardware device or "cpu", and why that one."""
    opens = {row["device"]["label"] for row in rows if not row["problem"]}
    for device in candidates("auto")[0]:
        if device.label in opens and not device.is_software:
            return {"device": device.label, "why": "it is the first that draws in hardware"}
    forbidden = "LIBGL_ALWAYS_SOFTWARE forbids hardware"
    why = forbidden if is_software_wanted() else "no hardware device opens"
    return {"device": "cpu", "why": f"{why}; it is several times as fast as OpenGL in software"}


def exit_code(report: Report) -> int:
    """0 when what is used by default passes its self-test, 1 when it does not."""
    return 0 if _passes(_rows(report)[report["default"]["device"]]) else 1


def print_report(report: Report, console: Console) -> None:
    """Print what `examine` found, for a person; the last sentence says what will be used."""
    rows, install = _rows(report), report["install"]
    *packages, (_, system) = report["versions"].items()
    versions = ", ".join(f"{name} {number}" for name, number in packages)
    console.print(Text(f"{versions}\n{system}, shaders {report['shaders'][:12]}", "dim"))
    console.print(_devices(rows))
    failed = [(label, row) for label, row in rows.items() if not _passes(row)]
    problems = [(row["problem"] or f"{label}: {row['self_test']}",) for label, row in failed]
    _section(console, "Problems", problems, "red")
    if (default := report["default"]["device"]) != "cpu":
        _section(console, f"Limits of {default}", _limits(rows[default]))
    _section(console, "Missing libraries, needed only for OpenGL", list(install.items()))
    # Without a library its kinds are missing too; a kind that is missing all the same has a reason.
    explained = {row["device"]["kind"] for row in report["reports"]}
    without = {"EGL": {"egl-device", "egl-surfaceless"}, "OSMesa": {"osmesa"}}
    explained = explained.union(*(without.get(library, ()) for library in install))
    absent = [(kind, why) for kind, why in report["kinds"].items() if kind not in explained]
    _section(console, "Missing devices", absent)
    settings = [(f"{k}={v}", ENVIRONMENT[k]) for k, v in report["environment"].items()]
    _section(console, "Environment", settings)
    _section(console, "Why no hardware", [("-", hint) for hint in report["hardware_hints"]])
    console.print(Text(_verdict(report), "bold" if exit_code(report) == 0 else "bold red"))


def _verdict(report: Report) -> str:
    """One sentence: what will be used by default."""
    rows, label = _rows(report), report["default"]["device"]
    row, why = rows[label], report["default"]["why"].partition(";")[0]
    if not _passes(row):
        passing = [f"pass `--device {other}`" for other in rows if _passes(rows[other])]
        use = (passing or ["nothing else passes"])[0]
        return f"By default rastercov tries {label}, which fails its self-test; {use}"
    how = f"draws on {label}, {row['context']['renderer']}, plan {row['plan']}"
    if label == "cpu":
        renderer, threads = (report["cpu"][key] for key in ("renderer", "threads"))
        how = f"counts on the CPU, {renderer}, {threads} thread{'s' * (threads > 1)}"
    return f"By default rastercov {how}, because {why}."


def _rows(report: Report) -> dict[str, Report]:
    """What can be chosen, by label: the CPU, told as a device, then the devices."""
    device = {"is_software": True, "cuda_index": None}
    about = {"device": device, "context": report["cpu"], "problem": "", "plan": "threads"}
    rows = {row["device"]["label"]: row for row in report["reports"]}
    return {"cpu": report["cpu"] | about} | rows


def _passes(row: Report) -> bool:
    return bool(row["self_test"] == PASSED)


def _devices(rows: dict[str, Report]) -> Table:
    names = "device", "renderer", "driver", "OpenGL", "draws in", "plan", "self-test"
    table = Table(*names, box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for label, row in rows.items():
        device, context = row["device"], row["context"] or {}
        cuda = "" if device["cuda_index"] is None else f"\nCUDA {device['cuda_index']}"
        # GL_VERSION: the version of OpenGL, perhaps a word on the profile, then the driver's own.
        profile = r"^[\d.]+( \(Core Profile\)| Core Profile Context)? ?"
        driver = re.sub(profile, "", context.get("version", "-"))
        opengl = f"{context['gl_version'] / 100:.1f}" if "gl_version" in context else "-"
        is_software = context.get("is_software", device["is_software"])
        result = PASSED if _passes(row) else "failed" if row["self_test"] else "does not open"
        cells = [label + cuda, context.get("renderer") or device["name"], driver, opengl]
        cells += ["software" if is_software else "hardware", row["plan"] or ""]
        style = "green" if _passes(row) else "red"
        table.add_row(*(Text(cell, overflow="fold") for cell in cells), Text(result, style))
    return table


def _limits(row: Report) -> Rows:
    limits = row["context"]["limits"]
    side = min(limits["max_texture_size"], *limits["max_viewport_dims"])
    return [
        ("image side", f"{side:,} samples", "larger images are drawn in tiles"),
        ("image layers", f"{limits['max_array_layers']:,}", "poses in one batch, plan hardware"),
        ("storage block", f"{limits['max_ssbo_bytes'] >> 20:,} MiB", "4 bytes a face counter"),
        (
            "64-bit atomics",
            "yes" if row["context"]["has_int64_atomics"] else "no",
            "plan compute fills faces once with them, twice without",
        ),
        ("sub-pixel bits", str(limits["subpixel_bits"]), "8 or more are wanted"),
        ("depth", row["depth"] or "unknown", "reversed float32 separates surfaces best"),
    ]


def _section(console: Console, title: str, rows: Rows, style: str = "") -> None:
    """Title and aligned rows, or nothing when there are none."""
    if rows:
        grid = Table.grid(padding=(0, 2))
        for row in rows:
            grid.add_row(*(Text(cell, style, overflow="fold") for cell in row))
        console.print(Text(title, "bold"), Padding(grid, (0, 0, 1, 2)), sep="\n")


def doctor(as_json: AsJson = False) -> None:
    """List graphics devices, test each, and say what to install.

    [bold]Example[/]: rastercov doctor --json
    """
    report = examine()
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        print_report(report, Console())
    raise typer.Exit(exit_code(report))
