"""Lamps of a plan: those that its entries describe, and the plan in their light or in any."""

from dataclasses import replace
from pathlib import Path

from rastercov.base import ByName, RastercovError, errors_as
from rastercov.core.camera import Rig
from rastercov.core.camera.exposure import GLOSSES
from rastercov.core.coverage.task import Task
from rastercov.light.lamp_file import lamps_of, lamps_on
from rastercov.light.lamps import SUN, Lamps
from rastercov.light.regions import OF_LIGHT, narrow_to_lamps
from rastercov.placement.plan.candidate_entry import CandidateEntry
from rastercov.placement.plan.file import Plan, PlanFeature
from rastercov.placement.plan.generators import PerCavity
from rastercov.placement.plan.sections import BestSelection


def lamp_entries(plan: Plan) -> list[CandidateEntry]:
    """Candidates that are places of lamps."""
    return [entry for entry in plan.candidates if entry.lamp is not None]


def build_lamps(plan: Plan, folder: Path) -> Lamps | None:
    """The lamps, with files of a folder, those of candidates at the origin; None for none."""
    if not plan.lamps:
        return None
    chosen = {entry.lamp for entry in lamp_entries(plan)}
    own = {name: each.entries(is_placed=name in chosen) for name, each in plan.lamps.items()}
    more = {} if plan.exposure is None else {"exposure": plan.exposure.model_dump()}
    return lamps_of({"ambient": plan.ambient, "lamps": own} | more, folder, plan.site)


def plan_with_lamps(plan: Plan, rig: Rig | None) -> Plan:
    """The same plan in the light of the lamps of a rig; None for any light, without lamps."""
    lamps = None if rig is None else lamps_on(rig)
    changes: ByName = {}
    if lamps is None:
        dark = {name: getattr(Task, name) for name in OF_LIGHT} | {"gloss": None}
        changes = {"lamps": {}, "ambient": 0.0, "exposure": None}
        changes["task"] = plan.task.model_copy(update=dark)
        changes["candidates"] = [entry for entry in plan.candidates if entry.lamp is None]
    other = plan.model_copy(update=changes)
    other._mounts = replace(plan.mounts, rig=plan.rig._equip("lamps", lamps))
    return other


class PlanLamps(PlanFeature):
    """Lamps of plans."""

    word = "lamps"

    def check(self, plan: Plan, folder: Path) -> None:
        """See `PlanFeature`."""
        task = plan.task
        if task.gloss is not None and task.max_highlight_deg > 0:
            raise ValueError("task: expected gloss or max_highlight_deg, got both; leave one out")
        if own := lamp_entries(plan):
            _check_places(plan, own)
            _check_selection(plan, is_alone=len(own) == len(plan.candidates))
        elif getattr(plan.selection, "lamps", None) is not None:
            raise ValueError("selection.lamps: expected candidates for lamps, got none; give them")
        with errors_as(ValueError, caught=RastercovError):
            lamps = build_lamps(plan, folder)
        if lamps is None:
            given = {name: getattr(task, name) for name in OF_LIGHT}
            given |= {"ambient": plan.ambient, "exposure": plan.exposure}
            for name in (name for name, value in given.items() if value):
                raise ValueError(f"expected lamps for {name}, got none; add them as [lamps.NAME]")

    def equipment(self, plan: Plan, folder: Path) -> Lamps | None:
        """See `PlanFeature`."""
        return build_lamps(plan, folder)

    def task(self, plan: Plan, task: Task) -> Task:
        """See `PlanFeature`: gloss as an angle, and what the lamps ask for."""
        if plan.task.gloss is not None:
            task = replace(task, max_highlight_deg=GLOSSES[plan.task.gloss])
        return narrow_to_lamps(task, build_lamps(plan, plan.folder))

    def site(self, plan: Plan, rig: Rig) -> Rig:
        """See `PlanFeature`."""
        lamps, built = lamps_on(rig), build_lamps(plan, plan.folder)
        if lamps is None or built is None:
            return rig
        for row, name in enumerate(lamps.names):
            if name in plan.lamps and plan.lamps[name].kind == SUN:
                lamps = lamps.at(row, built.places[built.names.index(name)])
        return rig._equip("lamps", lamps)

    def is_chosen(self, plan: Plan) -> bool:
        """See `PlanFeature`."""
        return bool(lamp_entries(plan))

    def add_choice(self, plan: Plan, rig: Rig | None) -> Plan:
        """See `PlanFeature`."""
        return plan_with_lamps(plan, rig)


def _check_places(plan: Plan, own: list[CandidateEntry]) -> None:
    """ValueError for candidates of lamps that cannot be placed there."""
    for entry in own:
        if entry.lamp not in plan.lamps:
            known = ", ".join(plan.lamps) or "none"
            raise ValueError(f"candidates: expected a lamp, got {entry.lamp!r}; lamps are {known}")
        if entry.cameras or isinstance(entry, PerCavity) or entry.is_carried:
            what = "cameras" if entry.cameras else f"generator {entry.generator}"
            raise ValueError(
                f"candidates: expected places of lamp {entry.lamp}, got {what}; leave it out"
            )
        if plan.lamps[entry.lamp].kind == SUN:
            raise ValueError("candidates: expected a lamp with a position, got a sun; leave it out")
        for name in plan.lamps[entry.lamp].places:
            raise ValueError(
                f"lamps.{entry.lamp}.{name}: expected a place or candidates, got both; leave one"
            )


def _check_selection(plan: Plan, *, is_alone: bool) -> None:
    """ValueError for a goal that lamps, alone or with cameras, cannot be chosen for."""
    asked = plan.selection
    limits = [getattr(plan.task, name) for name in (*OF_LIGHT, "gloss")]
    has_range = any(lamp.range is not None for lamp in plan.lamps.values())
    if plan.exposure is None and not has_range and not any(limits):
        raise ValueError(
            "candidates: expected a threshold of light for lamps, got none; give "
            "task.min_illuminance, max_illuminance, gloss, or exposure"
        )
    if plan.existing is not None:
        if not is_alone:
            raise ValueError("existing: expected candidates for lamps, got cameras; leave one out")
        names = "refine", "optimise", "tolerance", "cameras"
        plan.refuse(names, "for lamps of existing cameras")
    elif (
        not is_alone
        and isinstance(asked, BestSelection)
        and (asked.cameras is None or asked.lamps is None or asked.budget is not None)
    ):
        raise ValueError(
            "selection: expected only numbers of cameras and lamps, got other entries; remove those"
        )
