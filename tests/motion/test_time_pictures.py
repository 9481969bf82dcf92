"""Curve of area by time, and frames side by side."""

import numpy as np
import pytest
from timed import evaluate_over_time

import rastercov as rc
from rastercov.motion import report as over_time

PART = rc.shapes.by_name("icosahedron")
CAMERA = rc.Camera(width=160, height=120, fx=150, fy=150)


@pytest.fixture
def strip(monkeypatch):
    """Pictures and captions of the frames of a motion in which the part is turned."""

    def drawn(steps, durations=None, degrees=360):
        turned = rc.turntable(steps, degrees=degrees)
        motion = rc.Motion(PART, {PART.groups[0].name: turned}, durations=durations)
        pose = rc.look_at(eyes=[(4, 0, 3)], targets=(0, 0, 0), up=(0, 0, 1))
        result = evaluate_over_time(motion, CAMERA, pose, rc.Task(max_incidence_deg=60))
        kept = []
        whole = over_time.contact_sheet
        monkeypatch.setattr(
            over_time, "contact_sheet", lambda *given: kept.append(given) or whole(*given)
        )
        image = over_time.frames_picture(result)
        monkeypatch.setattr(over_time, "contact_sheet", whole)
        return result, *kept[0], image

    return drawn


def test_the_curve_has_a_step_for_each_unit_of_time():
    curve = [{"share": 0.5, "percent": 100.0}, {"share": 1.0, "percent": 25.0}]
    curve_points = over_time.curve_points(curve, 400, 120)
    assert curve_points == "0.0,0.0 200.0,0.0 200.0,90.0 400.0,90.0"
    assert over_time.curve_points([], 400, 120) == ""


def test_a_strip_has_twelve_small_frames_at_most_and_the_worst_of_them(strip):
    result, pictures, captions, image = strip(37)
    assert len(pictures) == len(captions) == over_time.FRAMES == 12
    assert all(picture.width < 400 for picture in pictures)
    shares = [each["percent"] for each in result.table()]
    numbers = [int(text.split(":")[0].removeprefix("frame ")) for text in captions]
    assert numbers == sorted(set(numbers))
    worst = [text for text in captions if "the worst" in text]
    assert worst
    assert worst[0].startswith(f"frame {int(np.argmin(shares))}: {min(shares):.1f} %, the worst")
    assert not any("time" in text for text in captions)
    assert image.width < 1500


def test_frames_have_their_time_where_they_last_for_different_times(strip):
    _, _, captions, _ = strip(3, [0.5, 1, 2], degrees=300)
    times = [text.split(":")[0] for text in captions]
    assert times == ["frame 0, time 0", "frame 1, time 0.5", "frame 2, time 1.5"]


def test_none_of_equal_frames_is_the_worst(strip):
    _, _, captions, _ = strip(4, degrees=0)
    assert len(captions) == 4
    assert not any("worst" in text for text in captions)
