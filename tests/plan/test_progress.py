"""Progress of the steps of `place` and `check`, and their results after an interrupt."""

from collections import defaultdict
from contextlib import contextmanager

import cavity_scenes
import numpy as np
import pytest

from rastercov.camera.pose_file import write_poses
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.placement.improve import objective as objective_module
from rastercov.placement.plan import check as plan_check
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.run import place

PLAN = """
[[meshes]]
path = "part.obj"
[camera]
width = 64
height = 48
fx = 64
fy = 64
[task]
views = 2
min_angle_deg = 10
[[candidates]]
generator = "on_sphere"
count = 12
distances = [9]
[[candidates]]
generator = "per_cavity"
[selection]
goal = "best_coverage"
cameras = 3
refine = true
[selection.optimise]
method = "random"
budget = 60
population = 4
[selection.tolerance]
position_mm = 1
draws = 3
"""


@pytest.fixture
def plan(tmp_path):
    """Plan with every step, for a part with a blind hole."""
    mesh = cavity_scenes.blind_hole()
    lines = ["v {!r} {!r} {!r}".format(*point) for point in mesh.vertices.tolist()]
    lines += ["f {} {} {}".format(*face) for face in (mesh.faces + 1).tolist()]
    (tmp_path / "part.obj").write_text("\n".join(lines))
    (tmp_path / "plan.toml").write_text(PLAN)
    return read_plan(tmp_path / "plan.toml")


class Watcher:
    """Progress of each step: (done, total) of each call."""

    def __init__(self):
        self.calls = defaultdict(list)

    @contextmanager
    def __call__(self, name):
        yield lambda done, total: self.calls[name].append((done, total))


def is_steady(calls):
    """True if the work done grows, to a total that is there from the first call on."""
    done = [done for done, _ in calls]
    return done == sorted(done) and all(total > 0 and n <= total for n, total in calls)


@pytest.mark.slow
def test_every_long_step_of_place_has_a_total(plan, tmp_path):
    steps = Watcher()
    placed = place(plan, tmp_path, steps)
    long = ("visibility matrix", "cavities", "search", "refinement", "tolerance", "what is left")
    for name in long:
        assert is_steady(steps.calls[name]), (name, steps.calls[name])
    for name in ("visibility matrix", "cavities", "search", "tolerance", "what is left"):
        done, total = steps.calls[name][-1]
        assert done == total, name
    assert steps.calls["refinement"][-1][0] <= placed.refined.evaluations


def test_both_steps_of_check_have_a_total(plan, tmp_path):
    poses = sphere_of_poses(np.zeros(3), 9.0, 4)
    write_poses(tmp_path / "rig.json", poses)
    steps = Watcher()
    found = plan_check.check(plan, tmp_path / "rig.json", {None: 0.9}, step=steps)
    assert len(found.cameras.poses) == len(poses)
    for name in ("coverage", "what is left"):
        assert is_steady(steps.calls[name])
        assert steps.calls[name][-1][0] == steps.calls[name][-1][1] > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "poses"), [("search", 0), ("search", 13), ("refinement", 200), ("tolerance", 4)]
)
def test_an_interrupt_in_a_step_ends_it_with_the_best_until_then(
    plan, tmp_path, monkeypatch, step, poses
):
    plain, measured = objective_module.evaluate_batches, []

    def limited(observer, given, task, **options):
        if steps.running == step:
            measured.append(len(given))
            if sum(measured) > poses:
                raise KeyboardInterrupt
        return plain(observer, given, task, **options)

    class Running(Watcher):
        running = ""

        @contextmanager
        def __call__(self, name):
            self.running = name
            with super().__call__(name) as progress:
                yield progress
            self.running = ""

    steps = Running()
    monkeypatch.setattr(objective_module, "evaluate_batches", limited)
    placed = place(plan, tmp_path, steps)
    assert placed.interrupted == step
    assert placed.leftover is None
    if step == "search" and not poses:
        assert placed.optimised is None
    elif step == "search":
        assert placed.optimised.is_interrupted
        assert placed.optimised.evaluations == len(placed.optimised.trace) * 3 == 12
        assert placed.cameras.share == placed.optimised.share >= placed.selection.share
    if step == "refinement":
        assert placed.refined.status == "interrupted"
        assert not placed.refined.is_local_optimum
        assert placed.cameras.share == placed.refined.share >= placed.refined.start_share
    if step == "tolerance":
        assert placed.tolerance is None
        assert placed.refined is not None
