"""A threshold is an argument, an option, a key of plans, a slider and words of a report."""

import json

import rastercov as rc
from rastercov.core.area.advice import task_in_words
from rastercov.report.live import task_fields


def check(command, folder):
    """What is deeper than the limit is not covered, by area and by face."""
    scene = (
        rc.shapes.box(),
        rc.Camera.from_fov(64, 48, hfov_deg=60),
        rc.sphere_of_poses((0, 0, 0), 4, 2),
    )
    for most, is_covered in ((5.0, True), (1.0, False)):
        task = rc.Task(max_depth=most)
        assert (rc.evaluate(*scene, task).areas.covered.area.sum() > 0) == is_covered
        assert rc.evaluate(*scene, task, by="face").network.covered.any() == is_covered
    command("evaluate box -c khepra -p sphere:2 --pictures 0 --max-depth 0.01 --json -o deep")
    summary = json.loads((folder / "deep" / "summary.json").read_text())
    assert summary["covered_area"]["m2"] == 0
    assert "max_depth" in command("place --schema")
    assert next(each for each in task_fields() if each["name"] == "max_depth")["unit"] == "m"
    assert "at a depth of 2 m or less" in task_in_words({"max_depth": 2.0}, None, by_face=False)
