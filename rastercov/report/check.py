"""Report of `rastercov check`: `check.html`, `check.pdf` on paper, `view.html`, `check.json`.

With a demand of a feature, `worst_poses.json` has the poses that are furthest below it.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rastercov.base import write_json, write_text
from rastercov.base.format import points
from rastercov.core.coverage.shards import folder_of_shards, provenance_of, remove
from rastercov.placement.plan.check import Checked, record, to_json
from rastercov.placement.plan.phases import Judged
from rastercov.placement.plan.prepare import Step, quiet
from rastercov.placement.plan.rig_parts import Kept
from rastercov.placement.required import FAILS
from rastercov.report.coverage import Options
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.network_page import NetworkPage
from rastercov.report.placement import change_of, network_of, verdicts, with_features
from rastercov.report.printing import browser, write_page
from rastercov.shards import ALONE, Progress, Staff, silent

WORST = "worst_poses.json"
"""File of these poses."""
CHECK = ReportKind(
    "check",
    re.compile(r"check\.(html|pdf|json)|view\.html|(worst_)?poses\.json"),
    last="check.json",
)


def write(
    made: Callable[..., Checked],
    out: Path,
    step: Step = quiet,
    staff: Staff = ALONE,
    *,
    pdf: bool = False,
    level: int | None = None,
) -> Checked:
    """Make a check and write its report, once the folder can be used.

    By the workers of `staff`, and where such a run is unfinished, it is `kept` in shards.
    """
    with ReportFolder(out, CHECK, is_shared=staff.part is not None) as folder:
        if pdf:
            browser()  # none fails before the work
        shards = folder_of_shards(folder.path)
        is_kept = staff.workers is not None or shards.exists()
        result = made(kept=Kept(shards, staff) if is_kept else None)
        with step("page") as progress:
            shown = replace(network_of(result, to_json(result)), level=level)
            page = page_of(result, shown, has_view=shown.view is not None, progress=progress)
            write_page(folder, "check", page, pdf=pdf)
            if shown.view is not None:
                write_text(folder.file("view.html"), shown.view)
        if result.assured is not None and (worst := result.assured.worst()) is not None:
            write_json(folder.file(WORST), worst)
        write_json(folder.file("check.json"), with_features(result, record(result)))
        folder.publish()
        remove(folder.path)
    return result


def html_of(checked: Checked) -> str:
    """The page of a check that no `view.html` lies beside."""
    return page_of(checked, network_of(checked, to_json(checked)), has_view=None)


def page_of(
    checked: Checked,
    shown: NetworkPage,
    *,
    has_view: bool | None,
    progress: Progress = silent,
) -> str:
    """HTML of a check, and of its network; `progress` in pictures."""
    plan, told, level = checked.plan, to_json(checked), shown.level
    options = Options(method=plan.task.method, supersample=plan.task.supersample, pictures=0)
    own = checked.cameras.poses, checked.task, options.record()
    run = provenance_of(checked.mesh, plan.rig, *own)
    assured = checked.assured
    judged: list[Judged] = [*checked.requirements]
    judged += assured.verdicts if assured else ()
    short = [each for each in checked.requirements if each.status == FAILS]
    answer = "The rig fails" if FAILS in {each.status for each in judged} else "Undecided"
    answer = "All requirements are met" if checked.is_met else answer
    every = [] if checked.against is None else checked.against.losses(level)
    losses = [line for line in every if not line.startswith("advice: ")]
    if losses and not short:
        answer = "Worse than the baseline"
    if len(short) == 1:
        answer += f" {short[0].name}".removesuffix(" whole task")
        answer += f" by {points(short[0].short_by)}"
    return shown.page(
        "network.html",
        shown.draw(progress),
        answer=f"{answer}: {shown.answer}",
        passed=checked.is_met,
        title_block=plan.sheet.words(plan=plan.name),
        lines=[
            *change_of(checked),
            *verdicts(judged),
            *((line, "fails") for line in losses),
        ],
        notes=[*told["warnings"], *told["result_warnings"]],
        log=checked.lines(level),
        summary=told | {"quarantined": {}},
        run=run,
        views=checked.asked_views or plan.task.views,
        has_view=has_view,
        under=assured.of if assured else "",
        more=assured.pictures() if assured else {},
    )
