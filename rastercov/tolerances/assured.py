"""Requirements of a rig under installation errors, for `check` and `place`.

A requirement holds under errors where the sure area reaches it, fails where an installation that
was drawn misses it, and is undecided otherwise. See `rastercov.tolerances.sure`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Self

import numpy as np

from rastercov.base import ByName, ConfigError, first_of, frozen_record, shown, sort_order
from rastercov.base.format import distinct_percents, percent
from rastercov.core.camera import Poses, names_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import rows_of
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.network import AreaRequirement, Requirement, counting
from rastercov.placement.plan.phases import Demand, Verdicts, phases_of
from rastercov.placement.required import FAILS, SHARE_TOLERANCE, UNDECIDED
from rastercov.placement.select.problem import views_of
from rastercov.tolerances.passes import OTHERS, Errors, TolerancePass, check_provable, errors_in
from rastercov.tolerances.sure import SureCoverage, sure_coverage

HOLDS = "holds under errors"
LOST = "Parts that installation errors may leave uncovered, by number and reason"
WORDS = "uncertain zone", "certainly covered, or not covered even as planned"
"""Words of the picture of these parts."""


@dataclass(frozen=True)
class Verdict:
    """A requirement under errors.

    Attributes
    ----------
    name : str
        That of the requirement.
    limit, sure, least : float
        Share required, share that is sure, and least share of the installations drawn that count.
    chance : float
        Part of the installations that count: `Errors.chance` for normal errors, else 1.
    status : {"holds under errors", "fails", "undecided"}
    draw : int
        Draw of the least share.
    """

    name: str
    limit: float
    sure: float
    least: float
    chance: float
    status: str
    draw: int

    def words(self) -> str:
        """The verdict in one line."""
        limit, sure, least = distinct_percents(self.limit, self.sure, self.least)
        of = "in the worst random installation" if self.draw >= 0 else "as planned"
        if self.chance < 1 and self.draw >= 0:
            of = f"or more in {percent(self.chance)} of random installations"
        return f"{self.name}: {limit} required, {sure} certain, {least} {of}: {self.status}"


@frozen_record
class Assured(Verdicts):
    """Proved area of a rig, and the verdict of each requirement."""

    word, of = "tolerance", "installation errors"
    as_planned = " (rig as planned, without errors)"

    found: SureCoverage
    verdicts: tuple[Verdict, ...]

    def worst(self) -> ByName | None:
        """Random installation that is furthest below a requirement, or nearest to it if none is.

        It is ready for JSON, and for `read_views`: the requirement, `draw`, `share`, the poses with
        the names of several cameras, and focal lengths relative to those planned if some are off,
        which are not read.
        """
        drawn = [each for each in self.verdicts if each.draw >= 0]
        if not drawn:
            return None
        each = min(drawn, key=lambda verdict: verdict.least - verdict.limit)
        poses, scale = self.found.installation(each.draw)
        told: ByName = {"name": each.name, "draw": each.draw, "share": each.least}
        told["world_from_camera"] = poses.world_from_camera.tolist()
        if len(names := names_of(self.found.camera)) > 1:
            told["camera"] = [names[row] for row in poses.camera.tolist()]
        return told | ({"focal_scale": scale.tolist()} if (scale != 1).any() else {})

    def pictures(self) -> Mapping[str, object]:
        """Of what is covered as planned and not certain, where that is something."""
        from rastercov.report.overview import zones_picture  # with a page only
        from rastercov.report.pages import Picture

        zones, eyes = self.found.zones, self.found.poses.world_from_camera
        if not (listed := self.found.list_losses(zones.listed())):
            return {}
        said = {"dead_zones": listed, "other_dead_zones": zones.others()}
        return {"errors": Picture.draw(LOST, zones_picture(zones, said, eyes, *WORDS))}

    def lines(self) -> list[str]:
        """The result in words, the requirement of which most is not certain first."""
        ranked = sorted(self.verdicts, key=lambda each: each.sure - each.limit)
        return [*(each.words() for each in ranked), *self.found.lines()]

    def summary(self) -> ByName:
        """The result, ready for JSON."""
        told = self.found.summary() | {"verdicts": [asdict(each) for each in self.verdicts]}
        worst = self.worst()
        return told if worst is None else told | {"worst": worst}


@dataclass(frozen=True)
class UnderErrors(Demand):
    """Requirements that must hold under errors of installation."""

    errors: Errors = field(default_factory=Errors)

    word, of = Assured.word, Assured.of

    def read(self, text: str) -> Self:
        """See `Demand`."""
        return replace(self, errors=errors_in(text))

    def check(self, plan: Plan, rig: Poses) -> None:
        """ConfigError for a plan by face, with own goals or no proof; for names without a pose."""
        unit, why = plan.unit_of_result()
        if unit != "area":
            raise ConfigError(
                f"expected coverage by area with installation errors, got one by face: {why}"
            )
        if plan.goals:
            raise ConfigError(
                "expected no [goals] with installation errors, got "
                f"{first_of(list(plan.goals), 3)}; check a plan of each that has a coverage, with "
                "its groups and thresholds"
            )
        check_provable(plan.rig, plan.build_task())
        placed = {names_of(plan.rig)[row] for row in rig.camera.tolist()}
        given = self.errors.position_mm, self.errors.angle_deg, self.errors.focal_percent
        names = {name for each in given if isinstance(each, Mapping) for name in each}
        if unknown := names - placed - {OTHERS}:
            raise ConfigError(
                f"expected errors of a camera with a pose ({first_of(sorted(placed))}), got "
                f"those of {shown(min(unknown))}; correct the name, or separate errors by commas"
            )
        self.errors.sizes(plan.rig, rig, np.zeros(3))

    def check_scene(self, plan: Plan, mesh: Mesh) -> None:
        """ConfigError for a scene that moves, and for equipment."""
        if phases_of(plan, mesh) is not None:
            raise ConfigError(
                "expected a static scene with installation errors, got motion; leave one out"
            )
        TolerancePass(mesh, plan.rig, plan.build_task()).close()

    def verdicts(
        self,
        plan: Plan,
        mesh: Mesh,
        rig: Poses,
        requirements: Sequence[Requirement] = (),
        views: int | None = None,
        draws: int = 200,
    ) -> Assured:
        """Proved area of a rig that a plan measures by area; see `sure_coverage`.

        Raises
        ------
        ConfigError
            As of `check_scene`.
        """
        self.check_scene(plan, mesh)
        counted = counting(plan.task) | ({"views": views} if views else {})
        needed = np.asarray(views_of(mesh, counted["views"]), np.int64)
        task = plan.build_task(int(needed.max(initial=1)))
        seed = 0 if plan.selection is None else plan.selection.seed
        result = sure_coverage(
            mesh, plan.rig, rig, task, self.errors, needed, draws=draws, seed=seed
        )
        names = [group.name for group in mesh.groups]
        chance = self.errors.chance if self.errors.distribution == "normal" else 1.0
        verdicts = []
        for each in requirements:
            assert isinstance(each, AreaRequirement)
            rows = [*range(len(names))] if each.group is None else rows_of(names, each.group)
            whole = each.of_m2 if each.of_m2 > 0 else 1.0
            own = result.draws_by_group[:, rows].sum(axis=1) / whole
            sure = float(result.sure_by_group[rows].sum()) / whole
            draw = int(sort_order(own)[int((1 - chance) * len(own))]) if len(own) else -1
            least = float(own[draw]) if len(own) else each.share
            needs = each.limit - SHARE_TOLERANCE
            status = HOLDS if sure >= needs else FAILS if least < needs else UNDECIDED
            verdicts.append(Verdict(each.name, each.limit, sure, least, chance, status, draw))
        return Assured(result, tuple(verdicts))
