"""Flight as a plan of QGroundControl: simple items, heights relative to home.

Images in passing are triggered by distance along straight lines of equal steps, and one by one
elsewhere. The way back is written as waypoints and a landing: that of a return to launch depends on
the settings of the vehicle. Sources: QGroundControl, "Plan File Format"; MAVLink, common message
set, MAV_CMD.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rastercov.base import ByName, FloatArray, json_bytes
from rastercov.survey.flight import Flight

WAYPOINT, LAND, TAKE_OFF, SPEED = 16, 21, 22, 178
GIMBAL, TRIGGER_DISTANCE, CAPTURE = 205, 206, 2000
"""MAV_CMD_NAV_WAYPOINT, NAV_LAND, NAV_TAKEOFF, DO_CHANGE_SPEED, DO_MOUNT_CONTROL,
DO_SET_CAM_TRIGG_DIST and IMAGE_START_CAPTURE."""
OF_MISSION, RELATIVE = 2, 3
"""MAV_FRAME_MISSION, and MAV_FRAME_GLOBAL_RELATIVE_ALT."""
FIRMWARE = {"ardupilot": 3, "px4": 12}
"""MAV_AUTOPILOT_ARDUPILOTMEGA and MAV_AUTOPILOT_PX4."""
STRAIGHT = 0.1
"""Metres by which the heights of a line that is written by its ends alone may differ."""
MULTIROTOR, TARGETING = 2, 2
"""MAV_TYPE_QUADROTOR, and MAV_MOUNT_MODE_MAVLINK_TARGETING."""


class Items:
    """Items of a mission."""

    def __init__(self) -> None:
        self.list: list[ByName] = []

    def add(self, command: int, *params: float | None) -> None:
        """A command without a place."""
        given = [*params, *[0] * (7 - len(params))]
        self._append(command, OF_MISSION, given)

    def go(self, command: int, at: Sequence[float], hold: float, yaw: float | None) -> None:
        """A command at latitude, longitude and height above home."""
        height = {"AMSLAltAboveTerrain": None, "Altitude": at[2], "AltitudeMode": 1}
        self._append(command, RELATIVE, [hold, 0, 0, yaw, *at], height)

    def _append(
        self, command: int, frame: int, params: list[Any], more: ByName | None = None
    ) -> None:
        number = len(self.list) + 1
        own: ByName = {
            "autoContinue": True,
            "command": command,
            "doJumpId": number,
            "frame": frame,
            "params": params,
            "type": "SimpleItem",
        }
        self.list.append((more or {}) | own)


def content(flight: Flight) -> bytes:
    """The file, of a flight with a CRS."""
    place = flight.asked.place
    assert place is not None
    home = place.geodetic(flight.home[None])[0]
    mission = {
        "cruiseSpeed": flight.asked.speed,
        "firmwareType": FIRMWARE[flight.asked.firmware],
        "globalPlanAltitudeMode": 1,
        "hoverSpeed": flight.asked.speed,
        "items": _items(flight),
        "plannedHomePosition": [round(home[1], 9), round(home[0], 9), round(home[2], 3)],
        "vehicleType": MULTIROTOR,
        "version": 2,
    }
    whole = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": mission,
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    return json_bytes(whole, indent=2) + b"\n"


def _relative(flight: Flight, points: FloatArray) -> list[tuple[float, float, float]]:
    """Latitude, longitude and height above home of (N, 3) points."""
    assert flight.asked.place is not None
    degrees = flight.asked.place.geodetic(points)
    heights = np.round(points[:, 2] - flight.home[2], 3)
    at = np.column_stack((degrees[:, 1], degrees[:, 0])).round(9).tolist()
    return [(*row, height) for row, height in zip(at, heights.tolist(), strict=True)]


def _items(flight: Flight) -> list[ByName]:
    from pyproj import Geod

    asked, items = flight.asked, Items()
    stops = _relative(flight, flight.places)
    over = [_relative(flight, flight.way_to(row)[1:-1]) for row in range(len(stops) + 1)]
    yaw, pitch = flight.headings_deg.round(3).tolist(), flight.views[1].round(3).tolist()
    items.go(TAKE_OFF, over[0].pop(0), 0, None)
    items.add(SPEED, 1, asked.speed, -1)
    last = None
    single = [(row, row + 1) for row in range(len(stops))]
    for first, end in single if asked.hover else flight.lines_flown:
        if pitch[first] != last:
            last = pitch[first]
            items.add(GIMBAL, last, 0, 0, 0, 0, 0, TARGETING)
        for point in over[first]:
            items.go(WAYPOINT, point, 0, None)
        items.go(WAYPOINT, stops[first], asked.hover, yaw[first])
        if end - first == 1:
            items.add(CAPTURE, 0, 0, 1, 0)
            continue
        (y0, x0, _), (y1, x1, _) = stops[first], stops[end - 1]
        length = Geod(ellps="WGS84").inv(x0, y0, x1, y1)[2]
        # Level, as vehicles measure it; shorter, so that the last image is taken.
        step = math.floor(1000 * length / (end - 1 - first) - 0.5) / 1000
        items.add(TRIGGER_DISTANCE, step, 0, 1)
        is_level = np.ptp(flight.places[first:end, 2]) < STRAIGHT
        for row in range(end - 1 if is_level else first + 1, end):
            items.go(WAYPOINT, stops[row], 0, yaw[row])
        items.add(TRIGGER_DISTANCE, 0)
    for point in over[-1]:
        items.go(WAYPOINT, point, 0, None)
    items.go(LAND, (*over[-1][-1][:2], 0.0), 0, None)
    return items.list
