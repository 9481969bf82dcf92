"""What `rastercov doctor` runs: tries and tests every device, and says what will be used.

Beside the chain, for the person at its end: `examine` gathers plain values, `print_report` shows
them, `exit_code` tells a script. Each device opens and is tested in a process of its own, because
drivers can crash or hang; this process opens none and works without any graphics library.
"""

import platform
import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from rastercov import __version__, shaders
from rastercov.raster.devices import candidates, is_software_wanted
from rastercov.raster.diagnose import ENVIRONMENT, ask, diagnose, self_test
from rastercov.raster.libraries import install_line

Report = dict[str, Any]
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
    missing = [library for library, file in report["libraries"].items() if file is None]
    report["install"] = {
        library: install_line("osmesa" if library == "OSMesa" else "egl") for library in missing
    }
    report["shaders"] = shaders.digest()
    report["versions"] = {"rastercov": __version__, "Python": platform.python_version()}
    for package in ("moderngl", "numpy", "trimesh"):
        try:
            report["versions"][package] = version(package)
        except PackageNotFoundError:
            report["versions"][package] = "not installed"
    report["versions"]["OS"] = platform.platform()
    return report


def _default(rows: list[Report]) -> dict[str, str | None]:
    """Label of the device that "auto" opens, None without one, and why that one."""
    opens = {row["device"]["label"] for row in rows if not row["problem"]}
    device = next((known for known in candidates("auto")[0] if known.label in opens), None)
    if device is None:
        return {"device": None, "why": f"no OpenGL device opens; to get one: {install_line('egl')}"}
    if not device.is_software:
        return {"device": device.label, "why": "it is the first that draws in hardware"}
    forbidden = "LIBGL_ALWAYS_SOFTWARE forbids hardware"
    why = forbidden if is_software_wanted() else "no hardware device opens"
    return {"device": device.label, "why": why}


def exit_code(report: Report) -> int:
    """0 when a device passes its self-test, 1 when none of them does, 2 when there is none."""
    results = [row["self_test"] for row in report["reports"]]
    return 0 if PASSED in results else 1 if results else 2


def print_report(report: Report, console: Console) -> None:
    """Print what `examine` found, for a person; the last sentence says what will be used."""
    rows, install = report["reports"], report["install"]
    *packages, (_, system) = report["versions"].items()
    versions = ", ".join(f"{name} {number}" for name, number in packages)
    console.print(Text(f"{versions}\n{system}, shaders {report['shaders'][:12]}", "dim"))
    console.print(_devices(rows) if rows else "")
    failed = [row for row in rows if not _passes(row)]
    problems = [(row["problem"] or f"{_label(row)}: {row['self_test']}",) for row in failed]
    _section(console, "Problems", problems, "red")
    for row in rows:
        if _label(row) == report["default"]["device"]:
            _section(console, f"Limits of {_label(row)}", _limits(row))
    _section(console, "Missing libraries", list(install.items()))
    # Without a library its kinds are missing too; a kind that is missing all the same has a reason.
    explained = {row["device"]["kind"] for row in rows}
    explained |= {"egl-device", "egl-surfaceless"} if "EGL" in install else set()
    explained |= {"osmesa"} if "OSMesa" in install else set()
    absent = [(kind, why) for kind, why in report["kinds"].items() if kind not in explained]
    _section(console, "Missing devices", absent)
    environment = report["environment"].items()
    settings = [(f"{name}={value}", ENVIRONMENT[name]) for name, value in environment]
    _section(console, "Environment", settings)
    _section(console, "Why no hardware", [("-", hint) for hint in report["hardware_hints"]])
    console.print(Text(_verdict(report), "bold" if exit_code(report) == 0 else "bold red"))


def _verdict(report: Report) -> str:
    """One sentence: what will be used by default."""
    label, why = report["default"]["device"], report["default"]["why"]
    if label is None:
        return f"Nothing can be drawn here: {why}"
    row = next(row for row in report["reports"] if _label(row) == label)
    passing = [_label(row) for row in report["reports"] if _passes(row)]
    if _passes(row):
        renderer, plan = row["context"]["renderer"], row["plan"]
        return f"By default rastercov draws on {label}, {renderer}, plan {plan}, because {why}."
    else_ = (
        f"use device {passing[0]!r}"
        if passing
        else f"no device passes; for another: {install_line('egl')}"
    )
    return f"By default rastercov would use {label}, which fails its self-test; {else_}"


def _label(row: Report) -> str:
    return str(row["device"]["label"])


def _passes(row: Report) -> bool:
    return bool(row["self_test"] == PASSED)


def _devices(rows: list[Report]) -> Table:
    names = "device", "renderer", "driver", "OpenGL", "draws in", "plan", "self-test"
    table = Table(*names, box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for row in rows:
        device, context = row["device"], row["context"] or {}
        cuda = "" if device["cuda_index"] is None else f"\nCUDA {device['cuda_index']}"
        # GL_VERSION: the version of OpenGL, perhaps a word on the profile, then the driver's own.
        profile = r"^[\d.]+( \(Core Profile\)| Core Profile Context)? ?"
        driver = re.sub(profile, "", context.get("version", ""))
        opengl = f"{context['gl_version'] / 100:.1f}" if context else ""
        is_software = context.get("is_software", device["is_software"])
        result = PASSED if _passes(row) else "failed" if row["self_test"] else "does not open"
        cells = [_label(row) + cuda, context.get("renderer", device["name"]), driver, opengl]
        cells += ["software" if is_software else "hardware", row["plan"] or ""]
        table.add_row(
            *(Text(cell, overflow="fold") for cell in cells),
            Text(result, "green" if _passes(row) else "red"),
        )
    return table


def _limits(row: Report) -> list[tuple[str, ...]]:
    limits = row["context"]["limits"]
    side = min(limits["max_texture_size"], *limits["max_viewport_dims"])
    return [
        ("image side", f"{side:,} samples", "larger images are drawn in tiles"),
        ("image layers", f"{limits['max_array_layers']:,}", "poses in one batch, plan hardware"),
        ("storage block", f"{limits['max_ssbo_bytes'] >> 20:,} MiB", "4 bytes a face counter"),
        ("sub-pixel bits", str(limits["subpixel_bits"]), "8 or more are wanted"),
        ("depth", row["depth"] or "unknown", "reversed float32 separates surfaces best"),
    ]


def _section(
    console: Console, title: str, rows: Sequence[tuple[str, ...]], style: str = ""
) -> None:
    """Title and aligned rows, or nothing when there are none."""
    if rows:
        grid = Table.grid(padding=(0, 2))
        for row in rows:
            grid.add_row(*(Text(cell, style, overflow="fold") for cell in row))
        console.print(Text(title, "bold"), Padding(grid, (0, 0, 1, 2)), sep="\n")
