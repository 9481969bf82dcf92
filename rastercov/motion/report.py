"""Coverage over time in reports: the share of time, and frames side by side."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from PIL import Image

from rastercov.base import ByName, FloatArray, IntArray, ReadByName
from rastercov.core.area.polygons import frames_of
from rastercov.motion.frames import animate_motion, show_phases
from rastercov.motion.over_time import OverTime, time_words
from rastercov.report.coverage_files import Addition
from rastercov.report.feature import InPhases
from rastercov.report.images import add_frame, contact_sheet
from rastercov.report.modes import by_share, mode_picture
from rastercov.report.panorama import FINE, side_by_side, sides

FRAMES = 12
"""Frames of the strip, evenly spread; the worst is among them."""
UNEVEN = 0.1
"""Percent of the area by which frames differ where one of them is the worst."""
SMALL = 0.25 * FINE
"""Scale of a frame, half the width of a picture in a strip."""


def time_picture(over_time: OverTime) -> Image.Image:
    """Mesh at rest, by the share of time in which its faces are covered."""
    eyes = over_time.poses.world_from_camera
    return mode_picture("time", over_time.motion.mesh, over_time.share_of_time(), eyes)


def frames_picture(over_time: OverTime) -> Image.Image:
    """Frames side by side, each with its number and what is covered in it, above one legend."""
    motion, table, eyes = over_time.motion, over_time.table(), over_time.poses.world_from_camera
    shares = np.array([each["percent"] for each in table])
    worst, is_uneven = int(shares.argmin()), bool(np.ptp(shares) >= UNEVEN)
    rows = np.linspace(0, len(motion) - 1, min(FRAMES, len(motion))).astype(np.int64)
    rows[np.abs(rows - worst).argmin()] = worst
    covered, area = over_time.frames.areas(), frames_of(motion.mesh).areas
    directions, is_timed = sides(motion.mesh, eyes), bool((motion.durations != 1).any())
    pictures, captions, keys = [], [], {}
    for row in rows.tolist():
        mesh, kept = motion.frame(row)
        share = covered[row][kept] / np.maximum(area[kept], 1e-300)
        painted = by_share(mesh, share)
        legend = [each | {"percent": None} for each in painted.legend]
        pixels, more = side_by_side(mesh, painted.colours, painted.hatch, directions, eyes, SMALL)
        own = replace(painted, legend=legend).keys("covered share of a face")
        for key in (*own, *more):  # what is cut open is not the same in all
            name = key.name.partition(":")[0]
            keys[name] = replace(key, name=name)
        pictures.append(Image.fromarray(pixels))
        said = table[row]
        at = f", time {said['time']:g}" if is_timed else ""
        is_worst = ", the worst" if row == worst and is_uneven else ""
        hidden = f"\nmain occluder: {said['hidden_by']}" if said["hidden_by"] else ""
        captions.append(f"frame {row}{at}: {said['percent']:.1f} %{is_worst}{hidden}")
    sheet = contact_sheet(pictures, captions)
    return add_frame(np.asarray(sheet), "What is covered in single frames", list(keys.values()))


def curve_points(curve: Sequence[ReadByName], width: float, height: float) -> str:
    """Points of the curve of area by time of a summary, for SVG: a step for each unit of time."""
    points, before = [], 0.0
    for each in curve:
        y = height * (1 - each["percent"] / 100)
        points += [f"{width * x:.1f},{y:.1f}" for x in (before, each["share"])]
        before = each["share"]
    return " ".join(points)


class TimePart:
    """Additions of a result over time to a page."""

    def __init__(self, over_time: OverTime) -> None:
        self._found, self.most = over_time, "longest"
        self.package, self.template = "rastercov.motion", "over_time.html"
        self.words, self.is_any = time_words(over_time.asked.over), over_time.asked.over == "some"
        self.pictures: Mapping[str, Callable[[], Image.Image]] = {
            "time": partial(time_picture, over_time),
            "frames": partial(frames_picture, over_time),
        }

    def modes(self) -> dict[str, FloatArray]:
        """See `Part`."""
        return {"time": self._found.share_of_time()}

    def best(self) -> IntArray:
        """See `Part`."""
        return self._found.longest()

    def tables(self) -> dict[str, ByName]:
        """See `Part`: a row a frame, of the columns of `OverTime.table`."""
        frames = self._found.table()
        return {"frames": {name: [each[name] for each in frames] for name in frames[0]}}

    def additions(self) -> list[Addition]:
        """See `Part`: the animation of bodies."""
        return [animate_motion(self._found.motion)]

    def view(self) -> InPhases:
        """See `Part`."""
        return show_phases(self._found)

    def section(self, summary: ReadByName) -> ByName:
        """See `Part`."""
        own = summary["over_time"]
        return {"points": curve_points(own["curve"], 400, 120)} | own
