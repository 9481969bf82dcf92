"""Wrong arguments, several at once, and extreme but legal scenes: no traceback, no warning, no NaN.

The calls and values are those of tests/support/misuse_calls.py; here they are combined at random.
"""

import contextlib
import sys
import tempfile
import warnings

import numpy as np
from misuse_calls import calls, is_wish_for_much_work
from misuse_values import VALUES
from rows import Report

import rastercov as rc
from rastercov.core.mesh import shapes

SPOILED = 4_000
"""Calls with wrong arguments of a whole campaign."""
SCENES = 1_500
"""Extreme scenes of a whole campaign."""
FIGURES = (
    *("coverage", "visibility", "visibility_bound", "resolution", "pixel_density", "incidence"),
    *("projected_area", "in_view_fraction", "visible_pixels", "drawn_pixels"),
)


def attack(report: Report, effort: float) -> None:
    """Both campaigns, each fault printed with its seed."""
    n_calls, n_scenes = max(1, int(SPOILED * effort)), max(1, int(SCENES * effort))
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        faults = [(seed, fault) for seed in range(n_calls) if (fault := spoiled_call(seed))]
    wrong = [(seed, fault) for seed in range(n_scenes) if (fault := extreme_scene(seed))]
    for seed, fault in faults + wrong:
        print(f"seed {seed}: {fault}", file=sys.stderr)
    report.add("calls with wrong arguments", n_calls, "calls")
    report.add(
        "calls that end in anything but a result or one line", len(faults), "calls", at_most=0
    )
    report.check("every wrong argument is used or refused in one line", not faults)
    report.add("extreme scenes", n_scenes, "scenes")
    report.add("scenes that warn, fail or give NaN", len(wrong), "scenes", at_most=0)
    report.check("every extreme scene has an answer without a warning", not wrong)


_calls: dict = {}


def spoiled_call(seed: int) -> str:
    """Fault of a call with one to three wrong arguments, empty if there is none."""
    if not _calls:
        _calls.update(calls())
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(_calls)))
    call = _calls[name]
    n_spoiled = min(len(call.arguments), int(rng.integers(1, 4)))
    chosen = rng.choice(list(call.arguments), n_spoiled, replace=False)
    kinds = rng.choice(list(VALUES), len(chosen))
    values = {str(argument): VALUES[kind] for argument, kind in zip(chosen, kinds, strict=True)}
    if any(is_wish_for_much_work(name, argument, value) for argument, value in values.items()):
        return ""
    fault = call.spoiled(**values).fault()
    words = ", ".join(f"{name}: {kind}" for name, kind in zip(chosen, kinds, strict=True))
    return fault and f"{call.name} with {words}: {fault}"


def extreme_scene(seed: int) -> str:
    """Fault of the figures of a scene of any size from any distance, empty if there is none."""
    rng = np.random.default_rng(seed)
    part = [shapes.box((1, 1, 1)), _soup(), shapes.sphere()][rng.integers(3)]
    size = 10.0 ** rng.choice([-300, -160, -100, -30, -9, -3, 0, 3, 9, 20, 29])
    offset = 10.0 ** rng.choice([-300, -20, 0, 5, 20, 28]) * (rng.random() < 0.4)
    centre = rng.normal(size=3) * offset
    lens = 10.0 ** rng.choice([-11.9, -6, 0, 2, 6, 11.9])
    side = [1, 2, 3, 64, 500]
    vertices = part.vertices * size + centre
    direction = rng.normal(size=3)
    away = 10.0 ** rng.choice([-160, -9, -3, 0, 0.5, 3, 9, 20, 29.5]) * rng.choice([1, size])
    eye = centre + away * direction / np.linalg.norm(direction)
    near = rng.choice([0, 0, size, 1e-300, 1e29])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = rc.Mesh(vertices, part.faces)
            camera = rc.Camera(
                width=int(rng.choice(side)), height=int(rng.choice(side)), fx=lens,
                fy=lens * rng.choice([1, 1, 1.1]), near=near,
                cx=rng.choice([0, 32, -1e6, 1e12]),
            )  # fmt: skip
            poses = rc.look_at(eye, centre)
            return _figures(mesh, camera, poses, rng)
    except rc.RastercovError:
        return ""
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _figures(mesh: rc.Mesh, camera: rc.Camera, poses: np.ndarray, rng: np.random.Generator) -> str:
    mesh.warnings  # noqa: B018 - computed when it is asked for
    task = rc.Task(
        min_pixels=10.0 ** rng.choice([-323, -90, 0, 300]), cap_resolution=rng.random() < 0.5
    )
    for method in ("certified", "exact", "sampled:cpu"):
        coverage = rc.evaluate(mesh, camera, poses, task, method=rc.Engine.of(method, 1))
        for name in FIGURES:
            if np.isnan(getattr(coverage, name)).any():
                return f"{method}: {name} is NaN"
        network = rc.Network(mesh, task)
        network.add(coverage)
        network.summary()
    with rc.open_rasterizer(mesh, camera, "cpu", threads=1) as rasterizer:
        rasterizer.render(poses[0])
    return ""


def _soup() -> rc.Mesh:
    rng = np.random.default_rng(0)
    return rc.Mesh(rng.normal(size=(60, 3)), np.arange(60).reshape(20, 3))
