"""Every example runs by itself, without a warning, and says something."""

import re
from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils import env_checker
from nightly import nightly
from processes import python

import rastercov as rc

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))
IN_PAGES = (
    "hold_under_errors",
    "inspect_by_robot",
    "plan_a_warehouse",
    "print_monitor",
    "scan_a_room",
)
"""Examples that take long: tests of a page or of their own run them by day."""


def test_there_are_examples():
    assert EXAMPLES


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=nightly if path.stem in IN_PAGES else (), id=path.stem)
        for path in EXAMPLES
    ],
)
def test_the_example_runs(path, tmp_path):
    result = python("-W", "error", path, cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    shares = [float(share) for share in re.findall(r"([-\d.]+) %", result.stdout)]
    assert shares
    assert all(0 < share <= 100 for share in shares)
    assert "nan" not in result.stdout.lower()
    assert list(tmp_path.iterdir()) == []


def test_cameras_of_a_printer_reach_nine_tenths_of_what_all_places_see(monkeypatch, capsys):
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.setattr("print_monitor.SPACING", 0.2)
    monkeypatch.setattr("print_monitor.HEIGHTS", (0.03, 0.07))
    monkeypatch.setattr("print_monitor.LAMPS", 1)
    from print_monitor import OVER, main

    chosen, every, lit = main()
    assert len(lit.choices["lamps"].chosen) == 1
    assert 0 < lit.cameras.share < chosen.share()
    assert chosen.asked.over == OVER == 0.9
    assert chosen.share() >= OVER * every.share() > 0
    assert len(chosen.poses) < 26
    assert "occluded by" in capsys.readouterr().out


@pytest.mark.filterwarnings("error")
def test_the_return_of_an_episode_is_what_its_views_cover(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    from next_best_view import NextBestView

    mesh, camera = rc.shapes.torus(20, 10), rc.Camera.load("khepra")
    environment = NextBestView(mesh, camera, rc.Task(max_incidence_deg=70), 4.0, views=4)
    env_checker.check_env(environment, skip_render_check=True)
    environment.reset()
    actions = np.random.default_rng(3).uniform(-1, 1, (4, 3))
    steps = [environment.step(action) for action in actions]
    eyes = 4 * actions / np.linalg.norm(actions, axis=1, keepdims=True) + mesh.bounds.mean(axis=0)
    poses = rc.look_at(eyes, mesh.bounds.mean(axis=0))
    result = rc.evaluate(mesh, camera, poses, environment.task, by="face")
    share = mesh.areas @ result.network.best / mesh.areas.sum()
    assert sum(step[1] for step in steps) == pytest.approx(share, abs=1e-12)
    assert 0 < share < 1
    assert steps[-1][3]
    environment.close()


@pytest.mark.filterwarnings("error")
def test_greedy_views_of_an_environment_cover_what_its_gains_say(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    import views_by_batches as example

    monkeypatch.setattr(example, "BATCH", 7)
    mesh, camera = rc.shapes.torus(20, 10), rc.Camera.load("khepra")
    poses = rc.sphere_of_poses((0, 0, 0), 4.0, 30)
    bits = rc.evaluate(mesh, camera, poses, method="sampled", fields=("covered",)).bits
    environment = example.ViewsByBatches(bits, views=4)
    env_checker.check_env(environment, skip_render_check=True)
    done, _ = environment.reset()
    covered = np.zeros(mesh.n_faces, bool)
    for _ in range(4):
        expected = (bits.dense() & ~covered).sum(axis=1)
        assert example.gains(bits, done).tolist() == expected.tolist()
        action = expected.argmax()
        done, reward, _, is_over, _ = environment.step(action)
        assert reward == expected.max() > 0
        covered |= bits.dense()[action]
    assert is_over


def test_torch_finds_the_same_gains(monkeypatch):
    pytest.importorskip("torch")
    monkeypatch.syspath_prepend(FOLDER)
    from views_by_batches import gains, gains_by_torch, of_a_teapot

    bits = of_a_teapot()
    done = np.array(bits.packed[3])
    assert gains_by_torch(bits, done).tolist() == gains(bits, done).tolist()
