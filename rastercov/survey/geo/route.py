"""Map of a flight: its route from above, to scale, over the outline of the surface."""

from collections.abc import Sequence
from itertools import count

import numpy as np
import shapely

from rastercov.base import ByName, FloatArray, plural, row_lengths
from rastercov.base.format import length
from rastercov.report.drawing import SheetFrame, scale_bar
from rastercov.report.plan_geometry import edges_between, outline_from_above
from rastercov.survey.flight import Flight

LEAST, LARGEST = np.array((90.0, 40.0)), np.array((180.0, 140.0))
"""Width and height of a map, mm."""
MARGIN = 10.0
"""Distance of the route from the border of the map at least, mm: the length of a label."""
MOST_EDGES = 20_000
"""Edges of the surface up to which a map has them."""
LEAST_DOT, DOT = 0.12, 0.5
"""Radius of a waypoint without a number, mm."""
HALF, GAP, NEAR = np.array((0.9, 1.3)), 0.6, 1.9
"""Half the size of a character, and half a space between labels; distance of a label from the
middle of its waypoint, mm."""
AROUND = np.array([(1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (-1, -1), (1, 1), (-1, 1)])
"""Directions to a label from its waypoint, the best first."""
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
    ways = [flight.way_to(row)[:, :2] for row in range(n + 1)]
    blocked = [row - 1 for row in flight.blocked]
    edges = edges_between(mesh, np.ones(mesh.n_faces, np.bool_), -np.inf, np.inf)
    lines = {
        "edges": edges if len(edges) <= MOST_EDGES else [],
        "legs": [ways[row] for row in range(1, n) if row not in blocked],
        "home_legs": [ways[row] for row in (0, n) if row not in blocked],
        "blocked": [ways[row] for row in blocked],
    }
    north = _north(flight)
    turn = np.radians(90.0 if north is None else north)
    some = f", every {every}{'nd' if every == 2 else 'th'} numbered" if every > 1 else ""
    step = float(row_lengths(np.diff(at, axis=0)).sum()) / n
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
        "up": (float(np.cos(turn)), -float(np.sin(turn))),
        "up_words": "y" if north is None else "N",
        "bar": scale_bar(frame),
        "words": f"Route from above: {plural(n, 'waypoint')} in the order of flight, not of cameras"
        f"{some}. Square: home; dashed: from and to home{'; red: blocked' if blocked else ''}.",
    }


def _frame(flight: Flight) -> SheetFrame:
    """Window with the route, and with the surface up to a third of its extent beside it."""
    stops = np.concatenate([flight.way_to(row) for row in range(len(flight.over))])
    low, high = stops.min(axis=0)[:2], stops.max(axis=0)[:2]
    beside = float(np.ptp(stops, axis=0).max()) / 3 or 1.0
    ends = np.asarray(flight.mesh.opaque.bounds)[:, :2]
    low = np.minimum(low, np.maximum(ends[0], low - beside))
    high = np.maximum(high, np.minimum(ends[1], high + beside))
    scale = max(float(((high - low) / (LARGEST - 2 * MARGIN)).max()), 1e-9)  # metres a millimetre
    width, height = np.maximum((high - low) / scale + 2 * MARGIN, LEAST).tolist()
    corner = (low + high) / 2 + np.array((-width, height)) / 2 * scale
    return SheetFrame("", 1e3 * scale, corner, size=(width, height))


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
        labels = _place_labels(texts, np.stack((home, *at[rows])), at, FAR if every >= n else 1)
        if len(labels) == len(texts):
            return every, labels


def _place_labels(
    texts: Sequence[str], points: FloatArray, at: FloatArray, far: int
) -> list[tuple[float, float, str]]:
    """Labels beside points, clear of each other, above few waypoints, up to one without room."""
    values, halves = np.empty((0, 2)), np.empty((0, 2))
    for text, point in zip(texts, points, strict=True):
        half = HALF * (len(text), 1) + (GAP, 0)
        ways = (point + np.arange(1, far + 1)[:, None, None] * AROUND * (half + NEAR)).reshape(
            -1, 2
        )
        is_free = (np.abs(ways[:, None] - values) >= half + halves).any(axis=2).all(axis=1)
        if not is_free.any():
            break
        n_below = (np.abs(ways[:, None] - at) < half + DOT).all(axis=2).sum(axis=1)
        best = np.lexsort((n_below, np.arange(len(ways)) // len(AROUND), ~is_free))[0]
        values, halves = np.vstack((values, ways[best])), np.vstack((halves, half))
    return [(x, y, text) for (x, y), text in zip(values.tolist(), texts, strict=False)]
