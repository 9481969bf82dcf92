"""The outcome of a check for build servers: JUnit, and a summary in Markdown.

A case is a requirement, one under installation errors, a share against the baseline, or a dead
zone. A dead zone fails where a
requirement of its group, or of the whole, does not hold, and where it is new or larger than in the
baseline; else it is within what is asked for, and passes.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rastercov.advice.headline import advice_line, with_parts
from rastercov.base import ConfigError, check_place, plural, write_bytes, write_text
from rastercov.core.area.zones import LEAST_PERCENT, n_unlisted, zone_line
from rastercov.placement.plan.baseline import MOST_OF_KIND, MOST_WORST, Against, words
from rastercov.placement.plan.check import Checked
from rastercov.placement.required import HOLDS

MOST_ZONES = 20
"""Dead zones with a case of their own, the largest, and those that differ from the baseline."""
MOST_ROWS = MOST_OF_KIND | {"dead zone": MOST_WORST}
"""Failing cases of each kind that have a row for a reviewer, those that lose most."""
TITLE, GOAL = "## rastercov check", "coverage of "
AGAINST = f"{GOAL}{{}} against the baseline"
FACE = re.compile(r"\bface[ _]?\d+\b")
"""In the name of a group that is a face of a CAD part."""
COLUMNS = "\n| status | requirement or dead zone | cause and advice |\n|--|--|--|"
KINDS = {"": "system-out", "error": "error"}
"""Elements of JUnit by status, where that is no failure."""
WORDS = {"": "", "error": "error", "undecided": "undecided"}
"""Words of a summary by status, where that is not "fails"."""
OURS = rb"<\?xml[^>]*>\s*<testsuites name=.rastercov.[ >]|" + TITLE.encode()
"""Start of a file that an earlier check wrote."""


class Case(NamedTuple):
    """A case: its name, its status, empty where it holds, and lines on it.

    Status "error" is of a check that could not be made. The kind is one of `MOST_OF_KIND`; `zones`
    is the number of dead zones without a case of their own, which JUnit leaves out.
    """

    name: str
    status: str
    lines: list[str]
    kind: str = "goal"
    zones: int = 0


def cases(checked: Checked, level: int | None = None) -> list[Case]:
    """Requirements, also under errors, shares against the baseline, and dead zones of a check.

    Parts and groups below a level have one case together.
    """
    items, short, changed = [], set(), {}
    for each in checked.requirements:
        status = "" if each.status == HOLDS else each.status
        short |= {each.group} if status and not each.goal else set()
        lines = [each.words(), *checked.reasons(each, level)]
        items.append(Case(GOAL + (each.group or each.name), status, lines))
    if (assured := checked.assured) is not None:
        for verdict in assured.verdicts:
            status = "" if verdict.status.startswith(HOLDS) else verdict.status
            name = f"{GOAL}{verdict.name.removeprefix('group ')} under {assured.of}"
            items.append(Case(name, status, [verdict.words()]))
    if checked.against is not None:
        changed = {zone["row"]: zone for zone in checked.against.zones}
        items += _against(checked.against, level)
    zones, n_told = (summary := checked.summary()).get("dead_zones", ()), 0
    worse = {case.name: case for case in items if case.status}
    for row in dict.fromkeys([*changed, *range(len(zones))]):
        zone = zones[row]
        if row in changed or (row < MOST_ZONES and zone["percent"] >= LEAST_PERCENT):
            status = "" if short.isdisjoint({None, *zone["groups"]}) else zone["reason"]
            named = with_parts(zone, level)
            lines = [zone_line(named), *filter(None, [advice_line(zone)])]
            if row in changed:
                status = changed[row]["status"]
                lines = Against.words_of_zone(changed[row], level)
            n_told += 1
            if case := worse.get(AGAINST.format(zone["groups"][0])) if row in changed else None:
                case.lines.extend(lines)  # one failure, not two
            else:
                items.append(Case(zone_line(named), status, lines, "dead zone"))
    n = len(zones) - n_told + (n_unlisted(summary) if zones else 0)
    if n > 0 and None in short:
        items.append(Case("others", "others", [plural(n, "other dead zone")], "dead zone", n))
    return items


def _against(against: Against, level: int | None) -> list[Case]:
    """Shares against the baseline: those that are worse first, those that lost most before."""
    worse = against.worse()
    others = [share for share in against.shares if share["status"] != "worse"]
    result, below = list[Case](), list[Case]()
    for share in [*worse, *others]:
        line = words(share)
        name = AGAINST.format(line.partition(":")[0].removeprefix("group "))
        status = share["status"] if share["status"] == "worse" else ""
        is_below = level is not None and share["level"] > level
        (below if is_below else result).append(Case(name, status, [line], share["kind"]))
    if lines := [case.lines[0] for case in below if case.status]:
        name, count = f"parts below level {level}", plural(len(lines), "part", "are worse")
        more = [f"and {len(lines) - MOST_WORST} more"] if len(lines) > MOST_WORST else []
        lines = [f"below level {level}, {count}", *lines[:MOST_WORST], *more]
        result.append(Case(AGAINST.format(name), "worse", lines, "part"))
    return result


def write(junit: Path | None, summary: Path | None, plan: Path, cases: Sequence[Case]) -> None:
    """Write the files that are asked for."""
    if junit is not None:
        _write_junit(junit, plan, cases)
    if summary is not None:
        _write_summary(summary, plan, cases)


def _write_summary(path: Path, plan: Path, cases: Sequence[Case]) -> None:
    """Write the worst failures in Markdown, a table row per case."""
    failing = _worst(cases)
    words = [WORDS.get(case.status, "fails") for case in failing]
    lines = [f"{TITLE} {plan.name}: {min(filter(None, words), default='holds')}"]
    lines += [COLUMNS] if failing else ["", *(_mark(case.lines[0]) for case in cases[:1])]
    for word, case in zip(words, failing, strict=True):
        cells = [word, case.lines[0], "\n".join(case.lines[1:])]
        lines.append(f"| {' | '.join(map(_mark, cells))} |".replace("\n", "<br>"))
    write_text(path, "\n".join(lines) + "\n")


def _worst(cases: Sequence[Case], rows: Mapping[str, int] = MOST_ROWS) -> list[Case]:
    """Failures of each kind that lose most, and a line that counts the others.

    Groups are fewer by one where all of them together have a failure.
    """
    worst = list[Case]()
    for kind, most in rows.items():
        own = [case for case in cases if case.status and case.kind == kind]
        most -= kind == "group" and any(case.kind == "all" for case in worst)
        worst += own[:most]
        if own[most:]:
            count = sum(case.zones or 1 for case in own[most:])
            are_faces = all(FACE.search(case.name) for case in own[most:])
            line = f"and {plural(count, 'face' if are_faces else f'more {kind}')}"
            worst.append(Case(line, "", [line], kind))
    return worst


def _mark(text: str) -> str:
    """A text with the marks of Markdown as they are."""
    return re.sub(r"[\\|`*_<>\[\]]", r"\\\g<0>", _printable(text))


def _write_junit(path: Path, plan: Path, cases: Sequence[Case]) -> None:
    """Write the worst failures and what holds as JUnit XML, with a test case for each.

    Each zone has one, so that a test keeps its name where it fails.
    """
    named = [case for case in cases if not case.zones]
    rows = MOST_ROWS | {"dead zone": len(named)}
    cases = [*_worst(named, rows), *(case for case in named if not case.status)]
    kinds = [KINDS.get(case.status, "failure") for case in cases]
    counts = {"tests": str(len(kinds)), "failures": str(kinds.count("failure"))}
    counts["errors"] = str(kinds.count("error"))
    suites = ElementTree.Element("testsuites", {"name": "rastercov"} | counts)
    about = {"name": _printable(f"rastercov check {plan.name}"), "skipped": "0"}
    suite = ElementTree.SubElement(suites, "testsuite", about | counts)
    for (name, status, lines, *_), kind in zip(cases, kinds, strict=True):
        about = {"classname": _printable(f"rastercov.{plan.stem}"), "name": _printable(name)}
        case = ElementTree.SubElement(suite, "testcase", about)
        outcome = {"type": status, "message": _printable(lines[0])} if status else {}
        ElementTree.SubElement(case, kind, outcome).text = _printable("\n".join(lines))
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
                f"{path}: expected a file by `rastercov check` to overwrite, got another; name "
                f"another file for {option}"
            )


def _printable(text: str) -> str:
    """`text` without characters that XML 1.0 cannot represent."""
    return "".join(c if c in "\n\t" or c.isprintable() else "?" for c in text)
