"""Corners clicked in a photograph beside the model: the file of points gives the camera's pose."""

import numpy as np
import pytest
from PIL import Image
from rigs_to_view import ROOM, WIDE

import rastercov as rc
from rastercov.asbuilt.resection import pixels_of

pytestmark = pytest.mark.slow
TRUE = np.asarray(rc.look_at((2.4, 2.2, 2.5), (-0.2, -0.2, 0.5))[0])
VIEW = np.asarray(rc.look_at((2.6, 2.1, 2.6), (0, 0, 0.4))[0])
CRATES = [(-1.5, -1.0, 0.6), (1.2, 0.9, 0.5)]
HALF = [(0.6, 0.4, 0.5), (0.4, 0.4, 0.4)]
CORNERS = np.array(
    [
        np.add(centre, np.multiply(half, sides))
        for centre, half in zip(CRATES, HALF, strict=True)
        for sides in ((1, -1, 1), (-1, 1, 1), (1, 1, 1))
    ]
)
"""Corners of two crates of the room that are seen from there."""


@pytest.mark.every_day
def test_clicked_corners_give_the_pose(tab, tmp_path):
    page = tab.page
    size = WIDE.width, WIDE.height
    for name, shape in (("wrong.png", (50, 40)), ("photo.png", size)):
        Image.new("L", shape, 128).save(tmp_path / name)
    page.get_by_text("Photograph", exact=True).click()
    (tmp_path / "none.png").write_bytes(b"none")
    photo = page.get_by_alt_text("photograph")
    refused = page.get_by_text("Expected ")
    for name, words in (
        ("wrong.png", f"{size[0]} x {size[1]} px as"),
        ("none.png", "a photograph"),
    ):
        page.get_by_label("Open photograph").set_input_files(tmp_path / name)
        refused.filter(has_text=f"Expected {words}").wait_for()
        assert not photo.is_visible()
    page.get_by_label("Open photograph").set_input_files(tmp_path / "photo.png")
    photo.wait_for()
    assert refused.count() == 0
    tab.js("pose => rastercov.setView(pose, 80)", [float(x) for x in np.ravel(VIEW)])
    pixels = pixels_of(CORNERS, WIDE, TRUE)
    save = page.get_by_role("button", name="Save points")
    for number, (pixel, corner) in enumerate(zip(pixels, CORNERS, strict=True)):
        assert save.is_disabled() == (number < 4)
        photo.scroll_into_view_if_needed()
        box = photo.bounding_box()
        scale = box["width"] / size[0]
        photo.click(position={"x": pixel[0] * scale, "y": pixel[1] * scale})
        inner = corner + 0.04 * (np.array(CRATES)[number // 3] - corner)
        page.mouse.click(*tab.place(inner))
    with page.expect_download() as made:
        save.click()
    made.value.save_as(tmp_path / "points.csv")
    rows = np.loadtxt(tmp_path / "points.csv", delimiter=",", skiprows=1)
    assert np.abs(rows[:, 2:] - CORNERS).max() < 1e-5
    found = rc.locate(ROOM, WIDE, tmp_path / "photo.png", points=tmp_path / "points.csv")
    assert found.accepted, found.why
    assert np.linalg.norm(found.pose[:3, 3] - TRUE[:3, 3]) < 0.03
    page.get_by_role("button", name="Undo point").click()
    assert page.locator(".mark").count() == len(CORNERS) - 1
    page.set_viewport_size({"width": 390, "height": 844})
    photo.scroll_into_view_if_needed()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
