"""Map of a flight: its route from above, to scale, over the outline of the surface."""

from itertools import count

import numpy as np
import shapely

from rastercov.base import ByName, FloatArray, cos, norm, plural, sin
from rastercov.base.format import length
from rastercov.report.drawing import DOT, SheetFrame, frame_around, labels_beside, scale_bar
from rastercov.report.plan_geometry import edges_between, outline_from_above
from rastercov.survey.flight import Flight

MOST_EDGES = 20_000
"""Edges of the surface up to which a map has them."""
LEAST_DOT = 0.12
"""Least radius of a waypoint without a number, mm; see `DOT`."""
MOST_NUMBERS = 60
"""Waypoints that have a number."""
FAR = 4
"""Times its distance at which the label of home, or of the first or last waypoint, may be."""


def route_of(flight: Flight) -> ByName:
    """Parts of the map, in mm, for `route.svg`.

    Waypoints are their place, radius and words in the order of flight; labels are place and text.
    """
    frame, mesh, n = _frame(flight), flight.mesh.opaque, len(flight.rows)
    at, home = frame.on_paper(flight.places[:, :2]), frame.on_paper(flight.home[:2])
    every, labels = _labels(home, at)
    ways = [
        (row in (0, len(each.rows)), each.over[row] is None, each.way_to(row)[:, :2])
        for each in flight.flown
        for row in range(len(each.rows) + 1)
    ]
    edges = edges_between(mesh, np.ones(mesh.n_faces, bool), -np.inf, np.inf)
    lines = {
        "edges": edges if len(edges) <= MOST_EDGES else [],
        "legs": [way for is_home, is_blocked, way in ways if not (is_home or is_blocked)],
        "home_legs": [way for is_home, is_blocked, way in ways if is_home and not is_blocked],
        "blocked": [way for _, is_blocked, way in ways if is_blocked],
    }
    north = _north(flight)
    turn = np.radians(90.0 if north is None else north)
    red = "; red: blocked" if lines["blocked"] else ""
    some = f", every {every}{'nd' if every == 2 else 'th'} numbered" if every > 1 else ""
    step = float(norm(np.diff(at, axis=0)).sum()) / n
    return {
        "dot": min(max(step / 4, LEAST_DOT), DOT),
        "size": frame.size,
        "surface": frame.path(outline_from_above(mesh).simplify(1e-4 * frame.scale)),
        **{name: frame.path(shapely.MultiLineString(list(own))) for name, own in lines.items()},
        "home": home.tolist(),
        "waypoints": [
            (
                *xy,
                _is_numbered(row, every, n),
                f"{row + 1}: position {position + 1} at {', '.join(map(length, place))} m",
            )
            for row, (xy, position, place) in enumerate(
                zip(at.tolist(), flight.rows.tolist(), flight.places.tolist(), strict=True)
            )
        ],
        "labels": labels,
        "up": (cos(turn), -sin(turn)),
        "up_words": "y" if north is None else "N",
        "bar": scale_bar(frame),
        "words": f"Route from above: {plural(n, 'waypoint')} in the order of flight, not of cameras"
        f"{some}. Square: home; dashed: from and to home{red}.",
    }


def _frame(flight: Flight) -> SheetFrame:
    """Window with the route, and with the surface up to a third of its extent beside it."""
    ways = [each.way_to(row) for each in flight.flown for row in range(len(each.over))]
    stops = np.concatenate(ways)
    beside = float(np.ptp(stops, axis=0).max()) / 3
    return frame_around(stops[:, :2], np.asarray(flight.mesh.opaque.bounds)[:, :2], beside)


def _north(flight: Flight) -> float | None:
    """Direction of north, degrees from +x towards +y; None where it is unknown."""
    if (place := flight.asked.place) is None:
        return flight.mesh.site.north_deg
    return 90.0 + float(place.headings_deg(flight.home[None], np.array([(0.0, 10.0, 0.0)]))[0])


def _is_numbered(row: int, every: int, n: int) -> bool:
    """True for the first, the last, and every n-th of the waypoints."""
    return (row + 1) % every == 0 or row in (0, n - 1)


def _labels(home: FloatArray, at: FloatArray) -> tuple[int, list[tuple[float, float, str]]]:
    """Every how many waypoints have a number, and the labels of these and of home."""
    n, usual = len(at), (step * 10**power for power in count() for step in (1, 2, 5))
    while True:
        if n > MOST_NUMBERS * (every := next(usual)):
            continue
        rows = [row for row in range(n) if _is_numbered(row, every, n)]
        texts = ["home", *(str(row + 1) for row in rows)]
        labels = labels_beside(texts, np.stack((home, *at[rows])), at, FAR if every >= n else 1)
        if len(labels) == len(texts):
            return every, labels
