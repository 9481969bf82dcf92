"""The commands `place` and `check`: cameras for a plan file, and a rig compared with one."""

import json
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from typer import Argument, Option

from rastercov.base import (
    ConfigError,
    RastercovError,
    errors_as,
    json_bytes,
    json_text,
    plural,
    shown,
)
from rastercov.base.errors import PartMadeError
from rastercov.cli.console import out_option, print_lines, say, size_line, warn
from rastercov.cli.inputs import read_rig
from rastercov.cli.options import (
    AsJson,
    CameraOptions,
    Level,
    Pdf,
    ProcessOptions,
    expand_options,
)
from rastercov.cli.terminal import Console, print_network, progress_bar
from rastercov.core.camera import Conventions
from rastercov.core.mesh.groups import list_names

if TYPE_CHECKING:
    from rastercov.placement.plan.check import Checked
    from rastercov.placement.plan.run import Placement

PlanFile = Annotated[Path, Argument(metavar="PLAN", help="Plan file (.toml).")]


WIDTH = 300
"""Of a part of a schema on one line: a key with its description."""


def _print_schema(wanted: bool | str | None) -> None:
    """Print the schema of plans, or of a section with all that it refers to."""
    if not wanted:
        return
    from rastercov.placement.plan.file import schema

    values = schema()
    if isinstance(wanted, str):
        whole = values.pop("$defs")
        if wanted not in (sections := values["properties"]):
            known = list_names(list(sections), wanted)
            raise ConfigError(
                f"--schema-of: expected one of {known}, got {shown(wanted)}; correct it"
            )
        values = sections[wanted] | {"$defs": {}}
        while more := {*re.findall(r"#/\$defs/(\w+)", json.dumps(values))} - values["$defs"].keys():
            values["$defs"] |= {each: whole[each] for each in more}
    print(json_bytes(values, indent=2, width=WIDTH).decode())
    raise typer.Exit


@expand_options
def place(
    plan: PlanFile,
    processes: ProcessOptions,
    out: Annotated[
        Path | None,
        out_option("Output folder.", "beside the plan: its outputs.folder, else its name"),
    ] = None,
    schema: Annotated[
        bool,
        Option(
            "--schema",
            callback=_print_schema,
            is_eager=True,
            help="Print the JSON schema of plan files, for editors.",
        ),
    ] = False,
    schema_of: Annotated[
        str | None,
        Option(
            callback=_print_schema,
            is_eager=True,
            metavar="SECTION",
            help="Print the JSON schema of one section, such as selection.",
        ),
    ] = None,
    skip_bad_poses: Annotated[
        bool,
        Option(
            "--skip-bad-poses",
            help="Exit with 0 even if candidates were skipped because they crashed a worker.",
        ),
    ] = False,
    level: Level = None,
    pdf: Pdf = False,
    as_json: AsJson = False,
) -> None:
    """Place cameras from a plan file.

    Writes poses (poses.json), all results (plan.json) and an HTML report (page.html). If
    interrupted, run it again to resume.

    Example: rastercov place examples/plans/inspect_part.toml --out plan/
    """
    from rastercov.placement.plan.file import read_plan

    asked = read_plan(plan)
    from rastercov.report import plan as report  # once the plan is sound

    folder = out or asked.results()
    placed = report.run_into(asked, folder, _step, processes.open(), pdf=pdf, level=level)
    prepared = placed.prepared
    warn(*prepared.mesh.warnings, *placed.doubts)
    if as_json:
        from rastercov.report.placement import with_features

        told = report.summary(placed)
        has_page = prepared.plan.outputs.page and not placed.interrupted
        print(json_text(with_features(placed, told) if has_page else told))
    else:
        _print_placement(placed, folder, level)
    if placed.interrupted:
        raise KeyboardInterrupt
    left_out = {} if skip_bad_poses else prepared.quarantined
    if left_out:
        words = f"{plural(len(left_out), 'candidate')} skipped"
        warn(f"{words}: each crashed its worker; pass --skip-bad-poses to accept this")
    if left_out or not placed.is_met or not all(each.files() for each in placed.products):
        raise typer.Exit(1)


def _print_placement(placed: "Placement", folder: Path, level: int | None) -> None:
    """Print the answer, tables of cameras and parts, and what no table has."""
    from rastercov.core.area.zones import ZONES
    from rastercov.report import plan as report

    page = folder / "page.html"  # a second interrupt may have left it out
    file = page if page.exists() else folder / "plan.json"
    print_lines(*report.head_lines(placed, level), file)
    if len(placed.cameras.placed):
        Console().print(report.cameras_table(placed))
    summary = report.summary(placed)
    network = summary["network"] | {name: summary[name] for name in ZONES if name in summary}
    network["goal_of_groups"] = placed.prepared.plan.goal_of_groups
    print_network(network, level)
    lines = [*report.lines(placed, level), *report.lines_of_uncovered(placed)]
    print_lines(*lines, f"scene: {size_line(placed.prepared.mesh)}")
    for line in placed.prepared.tally.lines():
        say(line)


class GoalOptions(NamedTuple):
    """Goals in place of those of the plan."""

    min_coverage: Annotated[
        float | None,
        Option(
            help="Goal: required share of the area, 0 to 1 (not the min_coverage of a face).",
            show_default="from the plan",
        ),
    ] = None
    group: Annotated[
        list[str], Option(help="NAME=SHARE: required share of a group. Repeatable.")
    ] = []  # noqa: RUF012 - typer copies it
    views: Annotated[
        int | None,
        Option(min=1, help="Required number of cameras per point.", show_default="from the plan"),
    ] = None
    tolerance: Annotated[
        str | None,
        Option(
            help='Require coverage under installation errors up to these, such as "2 mm, 0.2 deg".',
            metavar="ERRORS",
            show_default="none",
        ),
    ] = None


class OutcomeOptions(NamedTuple):
    """Files on what holds."""

    junit: Annotated[
        Path | None,
        Option(
            help="Write JUnit XML: one test per requirement, per share against the baseline, and "
            "per dead zone that is new, has grown, or is among the 20 largest."
        ),
    ] = None
    baseline: Annotated[
        Path | None,
        Option(help="check.json of an earlier check; a worse result fails."),
    ] = None
    allow_worse: Annotated[
        str | None,
        Option(
            help="Accepted loss against the baseline: percentage points, or an area such as 2cm2.",
            metavar="POINTS|AREA",
            show_default="0",
        ),
    ] = None
    summary: Annotated[
        Path | None, Option(help="Write a Markdown summary of goals and failures.")
    ] = None


@expand_options
def check(
    plan: PlanFile,
    poses: Annotated[
        str,
        Option(
            "--poses",
            "-p",
            help="Pose file of the rig: rastercov (.json, .npy), COLMAP or others.",
        ),
    ],
    conventions: Conventions,
    goal: GoalOptions,
    outcomes: OutcomeOptions,
    camera: CameraOptions,
    processes: ProcessOptions,
    out: Annotated[
        Path | None,
        out_option("Output folder for a page (check.html) and all results (check.json)."),
    ] = None,
    level: Level = None,
    pdf: Pdf = False,
    as_json: AsJson = False,
) -> None:
    """Check a rig against a plan.

    Needs no display and no GPU. A requirement that the error bound leaves undecided fails.

    Example: rastercov check plan.toml --poses rig.json --min-coverage 0.98 --views 2
    """
    from rastercov.placement.plan import check as plan_check
    from rastercov.placement.plan import outcome
    from rastercov.placement.plan.baseline import read_baseline
    from rastercov.placement.plan.file import read_plan
    from rastercov.placement.plan.phases import demand_of

    files = outcomes.junit, outcomes.summary
    outcome.refuse_other(*files)
    workers = processes.open()
    for name, is_asked in (("--pdf", pdf), ("workers or --only", workers is not None)):
        if is_asked and out is None:
            raise ConfigError(f"{name}: expected a folder, got none; name it with --out")
    try:
        asked = read_plan(plan)
        before = read_baseline(outcomes.baseline, outcomes.allow_worse)
        limits = plan_check.limits(asked, *goal[:2], may_be_none=before is not None)
        eyes = read_rig(camera, Path(poses), conventions)
        asked = asked.without_cameras() if camera.camera and eyes.rig is not None else asked
        asks = asked, Path(poses), limits, goal.views, _step
        with errors_as(ConfigError, "--tolerance"):
            demand = demand_of("tolerance", goal.tolerance)
        made = partial(plan_check.check, *asks, poses=eyes, baseline=before, demand=demand)
        if out is None:
            result = made()
        else:
            from rastercov.report.check import write  # with the first page only
            from rastercov.shards import Staff

            staff = Staff(workers, note=warn)
            result = write(made, out, _step, staff, pdf=pdf, level=level)
    except PartMadeError:
        raise
    except (RastercovError, OSError) as error:
        case = outcome.Case("input", "error", getattr(error, "lines", [str(error)]))
        outcome.write(*files, plan, [case])
        raise
    outcome.write(*files, plan, outcome.cases(result, level))
    told = plan_check.to_json(result)
    warn(*eyes.notes, *told["warnings"], *told["result_warnings"])
    if as_json:
        from rastercov.report.placement import with_features

        print(json.dumps(with_features(result, told), indent=2))
    else:
        _print_check(result, level, out)
    if not result.is_met:
        raise typer.Exit(1)


def _print_check(checked: "Checked", level: int | None, out: Path | None) -> None:
    """Print what holds, and tables of parts and cameras."""
    page = [] if out is None else [str(out / "check.html")]
    if out is not None and checked.assured is not None and checked.assured.worst() is not None:
        page.append(f"poses of the random installation that decides: {out / 'worst_poses.json'}")
    lines = [*checked.first_lines(level), *page, *checked.other_lines(level)]
    print_lines(*lines, f"scene: {size_line(checked.mesh)}")
    network = checked.summary() | {"goal_of_groups": checked.plan.goal_of_groups}
    print_network(network, level, has_parts=level is not None)


@contextmanager
def _step(name: str) -> Iterator[Callable[[int, int], None]]:
    """A step and its progress, see `progress_bar`; its name stays on a terminal."""
    if sys.stderr.isatty():
        say(name, 0)
    with progress_bar(name) as progress:  # poses or faces
        yield progress
