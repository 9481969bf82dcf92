"""The command `doctor`: diagnosis of the CPU and of every graphics device.

The rasterisers are imported when the command runs: 40 ms of every other command.
"""

import json
from collections.abc import Sequence
from importlib.resources import files
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from rastercov.base import ByName, shorten
from rastercov.base.arguments import free_memory
from rastercov.cli.options import AsJson
from rastercov.cli.terminal import Console

Report = ByName
Rows = Sequence[tuple[str, ...]]


def exit_code(report: Report) -> int:
    """0 when the default device passes its self-test, 1 when it fails."""
    return 0 if _passes(_rows(report)[report["default"]["device"]]) else 1


def print_report(report: Report, console: Console) -> None:
    """Print the result of `examine`; the last sentence names the default device."""
    rows = _rows(report)
    *packages, (_, system) = report["versions"].items()
    versions = ", ".join(f"{name} {number}" for name, number in packages)
    console.print(Text(f"{versions}\n{system}, shaders {report['shaders'][:12]}", "dim"))
    console.print(_devices(rows))
    able = [(label, row["context"]) for label, row in rows.items() if _passes(row)]
    judging = [
        (label, f"tiles with atomics of {64 if context['has_int64_atomics'] else 32} bits")
        for label, context in able
        if context.get("has_int64")
    ]
    _section(console, "Devices that judge faces where they count them", judging)
    _section(console, "This machine", list(report["cpu"].get("about", {}).items()))
    failed = [(label, row) for label, row in rows.items() if not _passes(row)]
    problems = [(row["problem"] or f"{label}: {row['self_test']}",) for label, row in failed]
    _section(console, "Problems", problems, "red")
    listed = {row["device"]["kind"] for row in report["reports"]}
    absent = [(kind, why) for kind, why in report["kinds"].items() if kind not in listed]
    _section(console, "Missing devices, needed only for OpenGL", absent)
    settings = [(f"{k}={shorten(v, 80)}",) for k, v in report["environment"].items()]
    _section(console, "Environment", settings)
    _section(console, "Versions that were not tested", [(line,) for line in report["untested"]])
    _section(
        console,
        "Why there is no hardware device",
        [("-", hint) for hint in report["hardware_hints"]],
    )
    console.print(Text(_verdict(report), "bold" if exit_code(report) == 0 else "bold red"))


def _verdict(report: Report) -> str:
    """Sentence that names the default device and the reason."""
    rows, default = _rows(report), report["default"]
    if not _passes(rows[default["device"]]):
        passing = [f"pass `--device {other}`" for other in rows if _passes(rows[other])]
        use = (passing or ["nothing else passes"])[0]
        return f"The default device, the CPU, fails its self-test; {use}"
    renderer, threads = (report["cpu"][key] for key in ("renderer", "threads"))
    how = f"the CPU, {renderer}, {threads} thread{'s' * (threads > 1)}"
    cards = [row for row in report["reports"] if _passes(row) and not row["device"]["is_software"]]
    card = "".join(f"; `--device hardware` is {each['context']['renderer']}" for each in cards[:1])
    return f"The default device is {how}: {default['why']}{card}."


def _rows(report: Report) -> dict[str, Report]:
    """Values of `--device`, by label: the CPU in the form of a device, then the devices."""
    device = {"is_software": True, "cuda_index": None}
    about = {"device": device, "context": report["cpu"], "problem": ""}
    rows = {row["device"]["label"]: row for row in report["reports"]}
    return {"cpu": report["cpu"] | about} | rows


def _passes(row: Report) -> bool:
    from rastercov.core.raster.self_test import PASSED

    return bool(row["self_test"] == PASSED)


def _devices(rows: dict[str, Report]) -> Table:
    names = "device", "renderer", "OpenGL and driver", "rendering", "self-test"
    table = Table(*names, box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for label, row in rows.items():
        device, context = row["device"], row["context"] or {}
        cuda = "" if device["cuda_index"] is None else f"\nCUDA {device['cuda_index']}"
        is_software = context.get("is_software", device["is_software"])
        result = (
            row["self_test"] if _passes(row) else "failed" if row["self_test"] else "does not open"
        )
        cells = [label + cuda, context.get("renderer") or device["name"]]
        cells += [context.get("version", "-"), "software" if is_software else "hardware"]
        style = "green" if _passes(row) else "red"
        table.add_row(*(Text(cell, overflow="fold") for cell in cells), Text(result, style))
    return table


def _section(console: Console, title: str, rows: Rows, style: str = "") -> None:
    """Print a title and aligned rows; nothing without rows."""
    if rows:
        grid = Table.grid(padding=(0, 2))
        for row in rows:
            grid.add_row(*(Text(cell, style, overflow="fold") for cell in row))
        console.print(Text(title, "bold"), Padding(grid, (0, 0, 1, 2)), sep="\n")


def doctor(
    as_json: AsJson = False,
    guide: Annotated[
        bool, typer.Option("--guide", help="Print the guide for AI assistants and scripts.")
    ] = False,
) -> None:
    """List and test graphics devices, and name missing packages.

    Example: rastercov doctor --json
    """
    if guide:
        print((files("rastercov") / "data" / "SKILL.md").read_text("utf-8"), end="")
        return
    from rastercov.core.raster import drawer
    from rastercov.engine import LEVEL, built_modules
    from rastercov.report import live

    report = drawer().examine()
    report["cpu"]["about"] = {
        "levels": f"{', '.join(built_modules())}; in use {LEVEL}",
        "memory": f"{free_memory() / 2**30:.1f} GiB free",
        "pages": live.WITHOUT if live.engine() is None else "compute by the engine",
    }
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        print_report(report, Console())
    raise typer.Exit(exit_code(report))
