"""The outcome of a check for build servers: JUnit, and a summary in Markdown.

A case is a requirement, a share against the baseline, or a dead zone. A dead zone fails where a
requirement of its group, or of the whole, does not hold, and where it is new or larger than in the
baseline; else it is within what is asked for, and passes.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rastercov.base.errors import ConfigError
from rastercov.base.output import check_place, write_bytes, write_text
from rastercov.coverage.area.zones import LEAST_PERCENT, zone_line
from rastercov.placement.plan.baseline import words
from rastercov.placement.plan.check import Checked
from rastercov.placement.plan.network import HOLDS

MOST_ZONES = 20
"""Dead zones with a case of their own, the largest, and those that differ from the baseline."""
TITLE, GOAL = "## rastercov check", "coverage of "
COLUMNS = "\n| | | why, and what would help |\n|--|--|--|"
KINDS = {"": "system-out", "error": "error"}
"""Elements of JUnit by status, where that is no failure."""
OURS = rb"<\?xml[^>]*>\s*<testsuites name=.rastercov.[ >]|" + TITLE.encode()
"""Start of a file that an earlier check wrote."""


class Case(NamedTuple):
    """A case: its name, its status, empty where it holds, and lines on it.

    Status "error" is of a check that could not be made.
    """

    name: str
    status: str
    lines: list[str]


def cases(checked: Checked) -> list[Case]:
    """Requirements, shares against the baseline, and dead zones of a check."""
    found, short, changed = [], set(), {}
    for each in checked.requirements:
        status = "" if each.status == HOLDS else each.status
        short |= {each.group} if status and not each.goal else set()
        lines = [each.words(), *checked.reasons(each)]
        found.append(Case(GOAL + (each.group or each.name), status, lines))
    if checked.against is not None:
        changed = {zone["row"]: zone for zone in checked.against.zones}
        for share in checked.against.shares:
            status = share["status"] if share["status"] == "worse" else ""
            name = f"{GOAL}{share['name'].removeprefix('group ')} against the baseline"
            found.append(Case(name, status, [words(share)]))
    for row, zone in enumerate(checked.summary().get("dead_zones", ())):
        if row in changed or (row < MOST_ZONES and zone["percent"] >= LEAST_PERCENT):
            status = "" if short.isdisjoint({None, *zone["groups"]}) else zone["reason"]
            told = {"status": status, "line": zone_line(zone)} | changed.get(row, {})
            lines = [told["line"], zone["advice"] or ""]
            found.append(Case(zone_line(zone), told["status"], lines))
    return found


def write(junit: Path | None, summary: Path | None, plan: Path, found: Sequence[Case]) -> None:
    """Write the files that are asked for."""
    if junit is not None:
        _write_junit(junit, plan, found)
    if summary is not None:
        _write_summary(summary, plan, found)


def _write_summary(path: Path, plan: Path, found: Sequence[Case]) -> None:
    """Write what fails, and each goal, in Markdown: a row of a table a case."""
    verdict = "fails" if any(case.status for case in found) else "holds"
    lines = [f"{TITLE} {plan.name}: {verdict}", COLUMNS]
    for case in sorted(found, key=lambda case: not case.status):
        if case.status or case.name.startswith(GOAL):
            cells = ["fails" if case.status else "holds", case.lines[0], "\n".join(case.lines[1:])]
            marked = [re.sub(r"[\\|`*_<>\[\]]", r"\\\g<0>", _printed(text)) for text in cells]
            lines.append(f"| {' | '.join(marked)} |".replace("\n", "<br>"))
    write_text(path, "\n".join(lines) + "\n")


def _write_junit(path: Path, plan: Path, found: Sequence[Case]) -> None:
    """Write the outcome as JUnit XML: a test case each."""
    kinds = [KINDS.get(case.status, "failure") for case in found]
    counts = {"tests": str(len(kinds)), "failures": str(kinds.count("failure"))}
    counts["errors"] = str(kinds.count("error"))
    suites = ElementTree.Element("testsuites", {"name": "rastercov"} | counts)
    about = {"name": _printed(f"rastercov check {plan.name}"), "skipped": "0"}
    suite = ElementTree.SubElement(suites, "testsuite", about | counts)
    for (name, status, lines), kind in zip(found, kinds, strict=True):
        about = {"classname": _printed(f"rastercov.{plan.stem}"), "name": _printed(name)}
        case = ElementTree.SubElement(suite, "testcase", about)
        outcome = {"type": status, "message": _printed(lines[0])} if status else {}
        ElementTree.SubElement(case, kind, outcome).text = _printed("\n".join(lines))
    ElementTree.indent(suites)
    document: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    write_bytes(path, document + b"\n")


def refuse_other(junit: Path | None, summary: Path | None) -> None:
    """Refuse to replace files that are not the output of an earlier check, such as inputs."""
    for path, option in ((junit, "--junit"), (summary, "--summary")):
        if path is None:
            continue
        check_place(path)
        start = b""
        if path.is_file():
            with path.open("rb") as file:
                start = file.read(200)
        if start and not re.match(OURS, start):
            raise ConfigError(
                f"{path}: not of an earlier check, and {option} would replace it; name another "
                "file, or move it away or delete it"
            )


def _printed(text: str) -> str:
    """`text` without characters that XML 1.0 cannot represent."""
    return "".join(c if c in "\n\t" or c.isprintable() else "?" for c in text)
