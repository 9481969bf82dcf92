"""Progress of the steps of `place` and `check`, and their results after an interrupt."""

from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path

import cavity_scenes
import numpy as np
import pytest
from plans import write_obj

from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.placement.improve import objective as objective_module
from rastercov.placement.plan.check import check
from rastercov.placement.plan.file import plan_of
from rastercov.placement.plan.run import place

PLAN = {
    "meshes": [{"path": "part.obj"}],
    "camera": {"width": 64, "height": 48, "fx": 64, "fy": 64},
    "task": {"views": 2, "min_angle_deg": 10},
    "candidates": [
        {"generator": "on_sphere", "count": 12, "distances": [9]},
        {"generator": "per_cavity"},
    ],
    "selection": {
        "goal": "best_coverage",
        "cameras": 3,
        "refine": True,
        "optimise": {"budget": 400},
        "tolerance": {"position_mm": 1, "draws": 3},
    },
}


@pytest.fixture
def plan(folder):
    """Plan with every step, for a part with a blind hole."""
    write_obj("part.obj", cavity_scenes.blind_hole())
    return plan_of(PLAN)


class Watcher:
    """Progress of each step: (done, total) of each call; and the name of the step that runs."""

    def __init__(self):
        self.calls, self.running = defaultdict(list), ""

    @contextmanager
    def __call__(self, name):
        self.running = name
        yield lambda done, total: self.calls[name].append((done, total))
        self.running = ""

    def is_steady(self, name, ends=True):
        """True if the work done grows, to a total that is there from the first call on."""
        done = [done for done, _ in self.calls[name]]
        return (
            done == sorted(done)
            and all(total > 0 and n <= total for n, total in self.calls[name])
            and (not ends or done[-1] == self.calls[name][-1][1])
        )


@pytest.mark.slow
def test_every_long_step_of_place_and_check_has_a_total(plan):
    steps = Watcher()
    placed = place(plan, Path("out"), steps)
    for name in ("visibility matrix", "cavities", "search", "tolerance", "uncovered faces"):
        assert steps.is_steady(name), (name, steps.calls[name])
    assert steps.is_steady("refinement", ends=False)
    assert steps.calls["refinement"][-1][0] <= placed.refined.evaluations
    steps = Watcher()
    poses = Poses.of(sphere_of_poses(np.zeros(3), 9.0, 4))
    check(plan, Path("rig.json"), {None: 0.9}, poses=poses, step=steps)
    assert steps.is_steady("coverage")
    assert steps.is_steady("uncovered faces")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "poses"), [("search", 0), ("search", 256), ("refinement", 200), ("tolerance", 4)]
)
def test_an_interrupt_in_a_step_ends_it_with_the_best_until_then(plan, monkeypatch, step, poses):
    plain, measured, steps = objective_module.evaluate_batches, [], Watcher()

    def limited(observer, given, task, **options):
        if steps.running == step:
            measured.append(len(given))
            if sum(measured) > poses:
                raise KeyboardInterrupt
        return plain(observer, given, task, **options)

    monkeypatch.setattr(objective_module, "evaluate_batches", limited)
    placed = place(plan, Path("out"), steps)
    assert (placed.interrupted, placed.leftover, placed.made) == (step, None, {})
    share, searched, refined = placed.cameras.share, placed.optimised, placed.refined
    assert (searched is None) == (step == "search" and not poses)
    if step == "search" and poses:
        assert searched.is_interrupted
        assert searched.evaluations == 256
        assert share == searched.share >= placed.selection.share
    if step == "refinement":
        assert refined.status == "interrupted"
        assert share == refined.share >= refined.start_share
    assert step != "tolerance" or refined is not None
