"""What any feature makes of placed cameras in a step, and demands of checked ones."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.base.features import FEATURES
from rastercov.placement.plan import check, outcome
from rastercov.placement.plan.file import plan_of
from rastercov.placement.plan.phases import Demand, Product, Verdicts, demand_of
from rastercov.placement.plan.run import Products
from rastercov.report.plan import lines, summary

PLAN = {
    "meshes": [{"built_in": "teapot-5"}],
    "camera": {"preset": "khepra"},
    "selection": {"goal": "best_coverage", "cameras": 2},
    "candidates": [{"generator": "on_sphere", "count": 6}],
}
RIG = rc.sphere_of_poses((0, 0, 0.05), distance=0.6, count=5)


@dataclass(frozen=True)
class Fence:
    name: str
    status: str

    def words(self):
        return f"{self.name}: {self.status}"


class Fenced(Verdicts):
    word, of, as_planned = "fence", "a fence", " (without a fence)"

    def __init__(self, status, requirements):
        self.verdicts = tuple(Fence(each.name, status) for each in requirements)

    def lines(self):
        return [each.words() for each in self.verdicts]

    def summary(self):
        return {"verdicts": [each.status for each in self.verdicts]}


@dataclass
class Around(Demand):
    status: str = ""

    word, of = "fence", "a fence"

    def read(self, text):
        return replace(self, status=text)

    def check(self, plan, rig):
        if len(rig) > 9:
            raise ConfigError("expected at most 9 cameras in a fence, got more; leave some out")

    def verdicts(self, plan, mesh, rig, requirements, views):
        return Fenced(self.status, requirements)


class Length(Product):
    word = "length"

    def summary(self):
        return {"m": 3}

    def lines(self):
        return ["a fence of 3 m"]

    def section(self):
        return "<h2>Fence</h2>"


class Lengths(Products):
    demand = Around()
    steps = (
        (
            "length",
            lambda found: found.prepared.plan.selection.seed,
            lambda found, *_: replace(found, made={**found.made, "length": Length()}),
        ),
    )


@pytest.fixture(autouse=True)
def feature(monkeypatch):
    monkeypatch.setitem(sys.modules, "rastercov.fence", SimpleNamespace(HOOKS=Lengths()))
    monkeypatch.setitem(FEATURES, "fence", {"PlanFeature": "fence"})


def checked(demand):
    return check.check(plan_of(PLAN), Path("rig"), {None: 0.01}, poses=RIG, demand=demand)


@pytest.mark.parametrize("status", ["holds in a fence", "fails", "undecided"])
def test_a_rig_must_hold_under_what_a_feature_demands(status):
    found, is_met = checked(demand_of("fence", status)), status.startswith("holds")
    assert found.is_met == is_met
    assert found.unmet == ([] if is_met else ["fence"])
    assert f"whole task: {status}" in (found.lines() if is_met else found.first_lines())
    assert any("(without a fence)" in line for line in found.lines())
    told = json.loads(json.dumps(check.to_json(found), default=list))
    assert told["fence"] == {"verdicts": [status]}
    (case,) = (each for each in outcome.cases(found) if "under a fence" in each.name)
    assert case.status == ("" if is_met else status)


def test_nothing_more_is_demanded_unless_it_is_asked_for():
    found = checked(demand_of("fence", None))
    assert found.assured is None
    assert found.is_met
    assert "fence" not in check.to_json(found)


def test_a_demand_refuses_a_rig_before_the_work():
    plan, many = plan_of(PLAN), rc.sphere_of_poses((0, 0, 0.05), distance=0.6, count=10)
    with pytest.raises(ConfigError, match="at most 9 cameras in a fence"):
        check.check(plan, Path("rig"), {}, poses=many, demand=demand_of("fence", "fails"))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_step_of_a_feature_adds_what_it_makes_where_a_plan_asks_for_it(seed):
    placed = rc.place(PLAN | {"selection": PLAN["selection"] | {"seed": seed}})
    assert (placed.product("length") is not None) == bool(seed)
    assert summary(placed)["length"] == ({"m": 3} if seed else None)
    assert ("a fence of 3 m" in lines(placed)) == bool(seed)
    assert ("length" in placed.steps) == bool(seed)
