"""A threshold of curvature is in option, plan, figures and report."""

import json

import numpy as np

import rastercov as rc
from rastercov.core.coverage.curvature import radii


def check(command, folder):
    """By area, by face, in a plan, in the page."""
    mesh = rc.shapes.by_name("sphere")
    radius = np.ptp(mesh.bounds, axis=0).max() / 2
    assert np.allclose(np.median(radii(mesh)), radius, rtol=0.3)
    camera, poses = rc.Camera.from_fov(64, 48, hfov_deg=60), rc.sphere_of_poses((0, 0, 0), 4, 2)
    for least, is_covered in ((0.5 * radius, True), (2 * radius, False)):
        task = rc.Task(min_radius=least)
        by_area = rc.evaluate(mesh, camera, poses, task)
        by_face = rc.evaluate(mesh, camera, poses, task, by="face")
        assert (by_area.areas.covered.area.sum() > 0) == is_covered
        assert by_face.network.covered.any() == is_covered
    command("evaluate sphere -c khepra -p sphere:2 --pictures 0 --min-radius 9 --json -o curved")
    summary = json.loads((folder / "curved" / "summary.json").read_text())
    assert "too_curved" in json.dumps(summary)
    assert "min_radius" in command("place --schema")
