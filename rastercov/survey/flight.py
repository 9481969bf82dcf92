"""Flight of a plan: its entries, and the waypoints of the chosen positions in a short order.

The order is that of the patterns that made the candidates, or, where it is shorter, a tour through
all of them from the home position; `legs.py` finds the ways over obstacles. The vehicle climbs
straight up at home, and lands there straight down. Overlap and ground
sampling distance are those of the exact footprints of the planned images.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    arctan2,
    errors_as,
    first_of,
    hypot,
    norm,
    once_each,
    plural,
    sampling,
    sort_order,
)
from rastercov.base.format import distance, in_decimals, verb
from rastercov.core.camera import Poses
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.ground import heights_at
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.legs import SAME_REL, Airspace, course_of, is_straight, length_of
from rastercov.placement.plan.phases import Product
from rastercov.survey.plan_section import FlightSection

if TYPE_CHECKING:
    from rastercov.placement.footprints import Footprints

STRAIGHT = 1e-6
"""Sine of the angle to the vertical below which a view has no heading of its own."""
LEAST_OF_LINE, SAME_STEP_REL, SAME_ANGLE_DEG = 3, 1e-3, 0.1
"""Waypoints of a straight line at least; its steps and headings differ by less."""
MOST_ABOVE = 1.0
"""Height of home above the surface, or below it, from which on a line says so, metres."""
HIGHEST = {
    120.0: "the 120 m of the open category in the EU",
    121.92: "the 400 ft of FAA part 107",
}
"""Limits of the height above ground, m."""
MOST_TIMES = 6
"""Missions whose times are printed."""
LOOKS_DOWN_DEG = -45.0
"""Pitch below which a view is meant for what is below it."""


@dataclass(frozen=True, eq=False)
class Flight(Product):
    """Waypoints in the order of flight.

    Attributes
    ----------
    asked : FlightSection
    mesh : Mesh
    mounts : Mounts
        Cameras and rigs that fly.
    poses : Poses
        Pose of the mount at each of N waypoints.
    rows : (N,) int64
        Position of each, a row of the placement.
    home : (3,) float64
        Place of take-off, metres.
    over : sequence of (K, 3) float64 or None
        Points that are passed on each of N + 1 legs: from home to the first waypoint, with the top
        of the climb, to each other, and back; None where every way that was tried comes too near to
        something.
    first : int
        Waypoints of the missions before this one.
    missions : sequence of Flight
        Parts from and to home, each for a battery, where there is a limit.
    """

    asked: FlightSection
    mesh: Mesh
    mounts: Mounts
    poses: Poses
    rows: IntArray
    home: FloatArray
    over: Sequence[FloatArray | None]
    first: int = 0
    missions: Sequence["Flight"] = ()

    word = "flight"

    @property
    def flown(self) -> Sequence["Flight"]:
        """Missions, or this flight."""
        return self.missions or (self,)

    @property
    def length(self) -> float:
        """Length from home through all waypoints and back, metres."""
        return sum(float(each.legs.sum()) for each in self.flown)

    @property
    def places(self) -> FloatArray:
        """(N, 3) positions, metres."""
        return self.poses.eyes

    @cached_property
    def views(self) -> tuple[FloatArray, FloatArray]:
        """(N, 3) horizontal directions that the images head for, and pitch of the views, degrees.

        That of a view straight down is the direction of the upper edge of its image.
        """
        matrices = self.poses.world_from_camera
        forward, upper = matrices[:, :3, 2], -matrices[:, :3, 1]
        level = hypot(forward[:, 0], forward[:, 1])
        pitch = np.degrees(arctan2(forward[:, 2], level))
        ahead = np.where((level < STRAIGHT)[:, None], -np.sign(forward[:, 2:]) * upper, forward)
        ahead = ahead * (1, 1, 0)
        return ahead / norm(ahead)[..., None], pitch

    @cached_property
    def headings_deg(self) -> FloatArray:
        """(N,) headings, clockwise from north, or from +y without a CRS."""
        ahead, _ = self.views
        if (place := self.asked.place) is not None:
            return place.headings_deg(self.places, 10 * ahead)
        return np.degrees(arctan2(ahead[:, 0], ahead[:, 1])) % 360

    @property
    def north(self) -> float:
        """Direction of north at the first waypoint, degrees from +x towards +y."""
        x, y, _ = self.views[0][0]
        return float((self.headings_deg[0] + np.degrees(arctan2(y, x))) % 360)

    def way_to(self, row: int) -> FloatArray:
        """(K + 2, 3) points of the way to a waypoint from the one before or home; N is home."""
        stops = (self.home, *self.places, self.home)
        over = self.over[row]
        return np.array((stops[row], *(() if over is None else over), stops[row + 1]))

    @cached_property
    def legs(self) -> FloatArray:
        """(N + 1,) lengths of the way from home through the waypoints and back, metres."""
        return np.array([length_of(*self.way_to(row)) for row in range(len(self.over))])

    @cached_property
    def n_beside(self) -> int:
        """Waypoints that look down with no surface below."""
        is_down = self.views[1] < LOOKS_DOWN_DEG
        return int(np.isnan(heights_at(self.mesh, self.places[is_down, :2])).sum())

    @property
    def n_over(self) -> int:
        """Legs that lead over the scene."""
        n_legs = sum(len(each.over) - sum(is_straight(each.over)) for each in self.flown)
        return n_legs - len(self.blocked)

    @property
    def blocked(self) -> list[int]:
        """Waypoints that no way leads to, from 1; one more than the last is home."""
        return [
            each.first + row + 1
            for each in self.flown
            for row, over in enumerate(each.over)
            if over is None
        ]

    @property
    def seconds(self) -> float:
        """Time at the speed of the plan, with the stops, without turns."""
        return self.length / self.asked.speed + self.asked.hover * len(self.rows)

    @property
    def too_far(self) -> list[int]:
        """Waypoints that a battery does not reach, from 1."""
        limit = 60 * (self.asked.battery or np.inf)
        return [each.first + 1 for each in self.missions if each.seconds > limit]

    @cached_property
    def lines_flown(self) -> list[tuple[int, int]]:
        """First waypoint of each straight line of equal steps and equal views, and the one after.

        Lines and steps are those on the map, whatever the height, which may follow the ground.
        Lines have `LEAST_OF_LINE` waypoints or more; others are alone.
        """
        n, ways = len(self.rows), np.diff(self.places[:, :2], axis=0)
        pitch = self.views[1]
        turn = np.abs((np.diff(self.headings_deg) + 180) % 360 - 180)
        is_same = (turn < SAME_ANGLE_DEG) & (np.abs(np.diff(pitch)) < SAME_ANGLE_DEG)
        is_same &= np.array([len(self.way_to(row)) == 2 for row in range(1, n)], bool)
        found, first = list[tuple[int, int]](), 0
        while first < n:
            end = first + 1
            while end < n and is_same[end - 1]:
                away = norm(ways[end - 1] - ways[first])
                if away > SAME_STEP_REL * norm(ways[first]):
                    break
                end += 1
            end = end if end - first >= LEAST_OF_LINE else first + 1
            found.append((first, end))
            first = end
        return found

    def table(self) -> list[ByName]:
        """Each mission: waypoints, photographs, length, time, heights, and its straight lines."""
        entries, n_images = list[ByName](), len(self.footprints.names) // max(len(self.rows), 1)
        for each in self.flown:
            ends, ground = [each.first + 1, each.first + len(each.rows)], self._above(each)
            lines = [
                {
                    "waypoints": [each.first + a + 1, each.first + b],
                    "images": n_images * (b - a),
                    "length_m": float(each.legs[a + 1 : b].sum()),
                    "heading_deg": float(each.headings_deg[a]),
                }
                for a, b in each.lines_flown
            ]
            entries.append(
                {
                    "waypoints": ends,
                    "images": n_images * len(each.rows),
                    "length_m": each.length,
                    "duration_s": each.seconds,
                    "lines": lines,
                    "z_m": [float(pick(each.places[:, 2])) for pick in (np.min, np.max)],
                    "above_ground_m": ground,
                }
            )
        return entries

    def _above(self, flight: "Flight") -> list[float] | None:
        """Least and greatest height of waypoints above the surface below; None beside it."""
        heights = flight.places[:, 2] - heights_at(self.mesh, flight.places[:, :2])
        known = heights[~np.isnan(heights)]
        return [float(known.min()), float(known.max())] if len(known) else None

    @cached_property
    def clearance(self) -> tuple[float, int]:
        """Least distance to the surface between the tops above home, metres, and after which leg.

        That is the number of the waypoint before it, 0 for home.
        """
        if self.missions:
            away, leg, first = min((*each.clearance, each.first) for each in self.missions)
            return away, leg + first
        ways = [self.way_to(row) for row in range(len(self.over))]
        ways[0], ways[-1] = ways[0][1:], ways[-1][:-1]
        space = Airspace(self.mesh)
        best, low, high = space.distance(np.concatenate(ways)), 0, len(ways)
        while np.isfinite(best) and high - low > 1:  # which of them comes so near
            middle = (low + high) // 2
            near = space.distance(np.concatenate(ways[low:middle])) <= best * (1 + SAME_REL)
            low, high = (low, middle) if near else (middle, high)
        return best, low

    @cached_property
    def footprints(self) -> "Footprints":
        """Footprints of all images, in the order of flight."""
        from rastercov.placement.footprints import footprints

        placed, owner = self.mounts.cameras(self.poses)
        names = [str(row + 1) for row in owner.tolist()]
        return footprints(self.mesh, self.mounts.rig, placed, Task(), names=names)

    @cached_property
    def _figures(self) -> dict[str, Any]:
        return self.footprints.summary()

    @property
    def unwritten(self) -> list[str]:
        """A sentence on why none of its files is written, and on what to change."""
        home = "move home in [flight]"
        if self.asked.home is None:
            home = "give home = [x, y, z] in [flight], with its height z"
        if far := self.too_far:
            why = f"waypoint {far[0]} and back takes more than the battery; {home}, or increase "
            return [f"flight: none is written, {why}battery or speed"]
        if not (blocked := self.blocked):
            return []
        first, last = blocked[0], len(self.over)
        return [
            "flight: none is written, the scene or a no-fly zone blocks "
            f"{plural(len(blocked), 'leg')}, the first "
            + (f"to waypoint {first}" if first < last else "back home")
            + f", and also the ways over it; {home if first in (1, last) else 'move the positions'}"
            + ", or decrease clearance in [constraints]"
        ]

    @property
    def refused(self) -> list[str]:
        """Sentences on why nothing is written, and on limits of height and what keeps to them."""
        ways = np.concatenate(
            [each.way_to(row) for each in self.flown for row in range(len(each.over))]
        )
        high = float(np.nanmax(ways[:, 2] - heights_at(self.mesh, ways[:, :2]), initial=0.0))
        over = [most for most in HIGHEST if high > most]
        if not over:
            return self.unwritten
        said = " and ".join(HIGHEST[most] for most in over)
        lower = math.ceil(high - min(over))
        text = f"height above ground: up to {in_decimals(high, 0)} m, above {said}; get a permit, "
        text += f"or fly {lower} m lower (height or gsd in [[candidates]])"
        gsd, ends = self._figures["gsd_per_px"], self._above(self)
        if gsd is not None and ends is not None and (self.views[1] < LOOKS_DOWN_DEG).all():
            part = max(1 - 2 * lower / sum(ends), 0.1)
            text += f": GSD then about {sampling(gsd * part)}, and up to about "
            text += f"{1 / part**2:.1f} times the photographs at the same overlap"
        return [*self.unwritten, text]

    @property
    def notes(self) -> list[str]:
        """Sentences on heights, time, and what is beside the surface, where there is some."""
        notes = [
            *self.refused,
            "time is without wind, turns and a reserve of the battery"
            if self.asked.battery is not None
            else "no battery is given: neither its limit nor a reserve is checked",
            "airspace and a failsafe return are not checked",
        ]
        above = self.home[2] - heights_at(self.mesh, self.home[None, :2])[0]
        if not abs(above) <= MOST_ABOVE:
            how = "the lowest of the surface: check it; from higher ground all is as much higher"
            where = "has no surface" if math.isnan(above) else f"is {above:.3g} m above the surface"
            notes.append(
                f"home, for take-off and landing, {where} below; its height is "
                f"{'as in [flight]' if self.asked.home else how}"
            )
        if n := self.n_beside:
            notes.append(
                f"{n} of {plural(len(self.rows), 'waypoint')} {verb(n, 'look')} down beside the "
                "surface, so that its border is in as many images as its middle; strips keep there "
                "to its mean height: the median GSD may differ from what the height or gsd of the "
                "plan gives"
            )
        return notes

    def summary(self) -> dict[str, Any]:
        """Figures, ready for JSON; `order` are rows of the positions."""
        away, leg = self.clearance
        own = {name: self._figures[name] for name in ("strips", "gsd_per_px")}
        place = self.asked.place
        return {
            "waypoints": len(self.rows),
            "images": len(self.footprints.names),
            "length_m": self.length,
            "duration_s": self.seconds,
            "missions": self.table(),
            "clearance_m": away if np.isfinite(away) else None,
            "nearest_after": leg,
            "beside_surface": self.n_beside,
            "detours": self.n_over,
            "blocked": self.blocked,
            "crs": None if place is None else place.words,
            "home": self.home,
            "order": self.rows,
            **own,
            **self.footprints.overlap_figures(),
            "sentences": self.lines(),
        }

    def lines(self) -> list[str]:
        """Sentences on the flight."""
        from rastercov.placement.footprints import overlap_words

        away, leg = self.clearance
        figures = self._figures
        text = f"flight: {plural(len(self.rows), 'waypoint')}, {in_decimals(self.length, 0)} m"
        hover = self.asked.hover
        text += f", about {in_decimals(self.seconds / 60, 1)} min at {self.asked.speed:g} m/s"
        text += f"{f', with {hover:g} s at each waypoint' if hover else ''}"
        if np.isfinite(away):
            text += f"; at least {distance(away)} from the surface, nearest after "
            text += f"waypoint {leg}" if leg else "take-off"
        if self.n_over:
            text += f"; {plural(self.n_over, 'leg')} over the scene"
        if (battery := self.asked.battery) is not None:
            times = [in_decimals(each.seconds / 60, 1) for each in self.flown]
            text += f"; {plural(len(times), 'mission')} within {battery:g} min of a battery: "
            text += f"{first_of(times, MOST_TIMES)} min"
        own = [overlap_words(figures)]
        if figures["gsd_per_px"] is not None:
            own.insert(0, f"GSD {sampling(figures['gsd_per_px'])} (median of the images)")
        lines = [text, *filter(None, [", ".join(filter(None, own))]), *self.notes]
        if not self.unwritten and self.asked.place is None:
            lines.append("flight.csv is in local metres; give crs in [flight] for .plan and .kml")
        return lines


class FlightNetwork(Protocol):
    """Cameras that are chosen."""

    @property
    def mounted(self) -> Poses:
        """Poses of the mounts."""


@once_each
def flight_of(
    cameras: FlightNetwork,
    asked: FlightSection,
    space: Airspace,
    mounts: Mounts,
    candidates: IntArray,
) -> Flight:
    """Flight through the poses of a network, each made for a candidate by its number."""
    mounted, mesh = cameras.mounted, space.mesh
    eyes = mounted.eyes
    rows = sort_order(candidates)
    home = np.array(asked.home or _home(mesh, eyes[rows[0]]))
    if (place := asked.place) is not None:
        stops = np.concatenate((home[None], eyes))
        with errors_as(ConfigError, "flight"):
            place.check_scene(np.stack((stops.min(axis=0), stops.max(axis=0))))
    first, (rows, over) = rows[0], course_of(space, home, eyes, rows)
    for _ in eyes:
        if asked.home is not None or rows[0] == first:
            break
        first = rows[0]
        home = _home(mesh, eyes[first])
        rows, over = course_of(space, home, eyes, rows)
    flight = Flight(asked, mesh, mounts, mounted[rows], rows, home, over)
    if asked.battery is None or flight.seconds <= 60 * asked.battery:
        return flight
    return replace(flight, missions=_missions(flight, space, 60 * asked.battery))


def _missions(flight: Flight, space: Airspace, seconds: float) -> list[Flight]:
    """Parts of a flight in its order, each from and to home within a time.

    The fewest: each has as many waypoints as there is time for, and one at least.
    """
    asked, home, places, first = flight.asked, flight.home, flight.places, 0
    missions = list[Flight]()
    while first < len(places):
        away = space.from_home(home, places[first])

        def part(end: int, start: int = first, out: FloatArray | None = away) -> Flight:
            back = space.from_home(home, places[end - 1])
            over = [out, *flight.over[start + 1 : end], None if back is None else back[::-1]]
            rows = flight.rows[start:end]
            poses = flight.poses[np.arange(start, end)]
            return replace(flight, poses=poses, rows=rows, over=over, first=start)

        # The way back is straight at best.
        level = norm(places[first:] - home)
        done = np.concatenate(([0.0], np.cumsum(flight.legs[first + 1 : len(places)])))
        least = (done + level) / asked.speed + asked.hover * np.arange(1, len(done) + 1)
        end = first + max(1, int(np.searchsorted(least, seconds, "right")))
        while (mission := part(end)).seconds > seconds and end > first + 1:
            end -= 1
        missions.append(mission)
        first = end
    return missions


def _home(mesh: Mesh, eye: FloatArray) -> FloatArray:
    """Place on the ground below a position; on the lowest level of the mesh beside it."""
    below = float(heights_at(mesh, eye[None, :2])[0])
    return np.array((eye[0], eye[1], mesh.bounds[0, 2] if np.isnan(below) else below))
