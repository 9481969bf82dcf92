"""A device on cameras: a flash, which `tests/area/test_devices.py` registers and runs."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from annotated_types import Gt, Le
from typing_extensions import Doc

from rastercov.base import features

features.FEATURES["flash"] = dict.fromkeys(features.DEVICE, "core.coverage.flash")
sys.modules["rastercov.core.coverage.flash"] = sys.modules["__main__"]

from rastercov.core.camera.camera import Camera  # noqa: E402 - after the registration
from rastercov.core.coverage.criterion import Words  # noqa: E402 - after the registration, too
from rastercov.core.coverage.device import Carried, Device  # noqa: E402


@dataclass(frozen=True)
class Flash(Carried):
    """A flash: its reach and the angle of its beam."""

    reach: Annotated[float, Gt(0), Doc("Depth that it reaches, m.")]
    beam_deg: Annotated[float, Gt(0), Le(120), Doc("Angle of its beam, deg.")] = 90.0

    @property
    def eye(self) -> Camera:
        """See `Carried`."""
        return Camera.from_fov(1000, 1000, hfov_deg=self.beam_deg, focus_range=(0.0, self.reach))


WORDS = Words("not flashed", "are not reached by the flash", "come closer", (40, 90, 40), 19)
HOOKS = Device(Flash, "not_flashed", WORDS)

from surface_cases import in_regions  # noqa: E402

import rastercov as rc  # noqa: E402
from rastercov import cli  # noqa: E402
from rastercov.core.area.stages import failures_of_rows  # noqa: E402
from rastercov.core.coverage.task import NAMES, Reason  # noqa: E402
from rastercov.reference.regions import points_on  # noqa: E402

N = 1000
NOT_FLASHED = NAMES.index("not_flashed")
CAMERAS = [Camera.from_fov(320, 240, hfov_deg=70), Camera.from_fov(240, 320, hfov_deg=50)]
ENTRIES = "expected entries of a flash (reach, beam_deg), got"
WRONG = {
    '{"range": 3}': f"{ENTRIES} 'range'; correct them",
    '{"beam_deg": 30}': "expected reach of a flash, got none; add it",
    "[3]": f"{ENTRIES} [3]; correct them",
    '{"reach": -1}': "flash: expected reach to be greater than 0, got -1",
}
"""Errors of files by their content."""
PLAN = {
    "meshes": [{"built_in": "torus"}],
    "camera": {"width": 320, "height": 240, "hfov_deg": 60},
    "candidates": [{"generator": "on_sphere", "count": 12}],
    "selection": {"goal": "best_coverage", "cameras": 2},
    "flash": "flash.toml",
}


def assert_points_agree(seed: int, rule: object) -> int:
    """Regions have the points that their reasons say; number of those that the flash misses."""
    rng = np.random.default_rng(seed)
    mesh = rc.shapes.by_name(rng.choice(["torus", "box", "aeroplane"]))
    if rng.random() < 0.5:
        mesh = mesh.with_groups((), [each.name for each in mesh.groups], ())
    size, middle = mesh.diagonal, mesh.bounds.mean(axis=0)
    aims = rc.look_at([(0, 0, 0), (0.05 * size, 0, 0)], [(0, 0, 9 * size)] * 2, up=(0, -1, 0))
    rig = rc.Rig(CAMERAS, rig_from_camera=aims, rule=rule)
    places = rc.look_at(middle + 0.7 * size * rng.normal(size=(3, 3)), middle)
    poses = rig.poses(places)
    own = Flash(reach=size * rng.uniform(0.5, 1.5), beam_deg=50)
    regions = rc.regions(mesh, rig, poses, flash=own)
    points, face = points_on(mesh, N)
    rig = rig._with(equipment={"flash": own})
    missed = 0
    for row, (_, reason, _) in enumerate(
        failures_of_rows(mesh, rig, rc.Task(), poses, points, face)
    ):
        inside = in_regions(regions, row, points, face)
        assert (inside != (reason == Reason.COVERED)).sum() <= 3, (seed, row)
        missed += int((reason == NOT_FLASHED).sum())
    assert len(regions.pose_ids) == row + 1
    return missed


def main(folder: Path) -> None:
    """Run all of it in a folder."""
    for rule in (rc.Any(), rc.All(), rc.AtLeast(1)):
        assert sum(assert_points_agree(seed, rule) for seed in range(4)) > N
    for entries, message in WRONG.items():
        file = folder / "wrong.json"
        file.write_text(entries, encoding="utf-8")
        with pytest.raises(rc.CameraError) as caught:
            rc.evaluate(rc.shapes.box(), CAMERAS[0], rc.look_at((0, 0, 3), (0, 0, 0)), flash=file)
        assert str(caught.value) == f"{file}: {message}"
    (folder / "flash.toml").write_text("reach = 3.5\nbeam_deg = 30\n", encoding="utf-8")
    placed = rc.place(PLAN).cameras
    checked = rc.check(PLAN, placed.placed, min_coverage=0.01).cameras.areas
    dark = {name: each for name, each in PLAN.items() if name != "flash"}
    assert placed.areas.summary() == checked.summary()
    without = rc.check(dark, placed.placed, min_coverage=0.01).cameras.areas
    assert 0 < checked.summary()["m2"] < without.summary()["m2"]
    line = "view torus -c khepra -p sphere:3 --flash flash.toml --export page.html"
    assert cli.command(shlex.split(line)) == 0
    assert "not flashed" in (folder / "page.html").read_text(encoding="utf-8")


main(Path.cwd())
