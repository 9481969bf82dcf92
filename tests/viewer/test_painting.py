"""A page that computes gives faces the colours, legends and scales of Python's modes."""

import json

import numpy as np
import pytest
from page_in_node import NEEDS_NODE
from page_in_node import node as node

from rastercov.core.coverage.task import DORI, NAMES
from rastercov.core.mesh import Mesh, shapes
from rastercov.report import live, theme
from rastercov.report.modes import MODES, MOST_VIEWS, OfCameras, OfUnit, of_devices


def mesh_of(rng):
    """A task with or without occluders, of unequal faces."""
    parts = [shapes.torus(int(rng.integers(4, 9)), 5), shapes.box(rng.uniform(0.5, 3, 3))]
    mesh = Mesh.joined(parts, ["task", "other"])
    return mesh.with_groups(occluders=["other"] * int(rng.integers(2)))


def listed(values):
    return ["inf" if np.isinf(value) else value for value in values.tolist()]


def some(rng, values):
    """The values, or none of them, or one value alone."""
    kind = rng.integers(5)
    return (
        values * (kind > 0) if kind < 2 else values[:1].repeat(len(values)) if kind == 2 else values
    )


def case_of(rng, mode):
    """Mesh, values for Python, and figures for the page."""
    mesh = mesh_of(rng)
    n = mesh.n_faces
    size = 10.0 ** rng.uniform(-3, 6)
    drawn = some(rng, size * rng.lognormal(size=n) * (rng.random(n) < 0.7))
    names = [f"camera {row}" for row in range(int(rng.choice((1, 3, 70, 300))))]
    row = rng.integers(-1, len(names), n)
    if mode in ("area", "coverage"):
        share = some(rng, rng.integers(-2, 507, n) / 506)
        return mesh, share, {{"area": "share", "coverage": "best"}[mode]: listed(share)}
    if mode == "reason":
        rows = rng.integers(0, len(NAMES), n).astype(np.uint8)
        return mesh, rows, {"rows": listed(rows)}
    if mode == "camera":
        every = theme.camera_colours(2 * len(names))[1::2]
        heads = [{"name": name, "row": 2 * at + 1} for at, name in enumerate(names)]
        return mesh, OfCameras(row, names, every), {"bestRow": listed(row), "heads": heads}
    if mode == "device":
        row = np.minimum(row, len(names) - 1) + (rng.random(n) < 0.1)
        measured = {"labels": [*names, "covered"], "device": listed(row)}
        return mesh, of_devices(row, names), {"measured": measured}
    if mode == "views":
        views = rng.integers(0, int(rng.integers(1, MOST_VIEWS + 6)), n)
        return mesh, views, {"views": listed(views)}
    if mode == "density":
        return mesh, OfUnit(drawn, "px/m"), {"densities": listed(drawn)}
    if mode == "uncertainty":
        return mesh, OfUnit(1e6 * drawn, "um"), {"measured": {"deviation": listed(drawn)}}
    if mode == "incidence":
        angle = np.where(rng.random(n) < 0.3, np.inf, rng.integers(0, 181, n) / 2)
        return mesh, angle, {"incidence": listed(angle)}
    exact = rng.choice([*DORI.values(), *drawn], n)
    return mesh, exact, {"facing": listed(exact), "levels": DORI}


@NEEDS_NODE
@pytest.mark.parametrize("mode", live.LIVE_MODES)
def test_faces_are_painted_as_python_does(node, tmp_path, mode):
    rng = np.random.default_rng(len(mode))
    cases, wanted = [], []
    for _ in range(24):
        mesh, values, figures = case_of(rng, mode)
        task = mesh.task_mask
        total = float(mesh.areas[task].sum())
        own = {"areas": mesh.areas.tolist(), "isTask": task.astype(int).tolist(), "total": total}
        cases.append({"own": own, "mode": mode, "figures": figures})
        wanted.append(MODES[mode].paint(mesh, values))
    colours = live._colours("m")
    if mode in ("camera", "device"):  # the page has fewer, which begin again
        colours = colours | {"cameraColours": theme.camera_colours(700).tolist()}
    for name, data in (("colours", colours), ("cases", cases)):
        (tmp_path / f"{name}.json").write_text(json.dumps(data))
    for pair, own in zip(
        node("painting.mjs", tmp_path / "colours.json", tmp_path / "cases.json"),
        wanted,
        strict=True,
    ):
        used = np.unique(own.levels)
        assert pair["levels"] == own.levels.tolist()
        palette = np.reshape(pair["palette"], (256, 3))
        np.testing.assert_array_equal(palette[used], own.palette[used])
        ends = [
            each and [each.pop(end) for end in ("low", "high")]
            for each in (pair["scale"], own.scale)
        ]
        assert pair["scale"] == own.scale
        assert ends[0] == (ends[1] and pytest.approx(ends[1], rel=1e-12))
        keys = ("level", "label", "colour", "hatch")
        order = sorted(pair["legend"], key=lambda each: each["level"])
        for one, other in zip(
            order, sorted(own.legend, key=lambda each: each["level"]), strict=True
        ):
            assert [one[key] for key in keys] == [other[key] for key in keys]
            share = other["percent"]
            assert one["percent"] == (share if share is None else pytest.approx(share, rel=1e-12))
        if mode == "level":  # others are by areas, which may be equal
            assert [one["level"] for one in pair["legend"]] == [one["level"] for one in own.legend]
