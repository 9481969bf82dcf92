"""A flash is an argument, an option and an entry of plans."""

import json

import rastercov as rc


def check(command, folder):
    """A short flash leaves what a long one reaches."""
    (folder / "flash.toml").write_text("reach = 0.1\n")
    command("evaluate box -c khepra -p sphere:2 --pictures 0 --flash flash.toml --json -o dark")
    dark = json.loads((folder / "dark" / "summary.json").read_text())
    assert "not_flashed" in json.dumps(dark)
    assert dark["covered_area"]["m2"] == 0
    scene = (
        rc.shapes.box(),
        rc.Camera.from_fov(64, 48, hfov_deg=60),
        rc.look_at((0, 0, 3), (0, 0, 0)),
    )
    near, far = (
        rc.evaluate(*scene, flash=folder / name).areas.covered.area.sum()
        for name in ("flash.toml", "far.toml")
        if (folder / "far.toml").write_text("reach = 9\nbeam_deg = 60\n")
    )
    assert near == 0 < far
    assert "flash" in command("place --schema")
