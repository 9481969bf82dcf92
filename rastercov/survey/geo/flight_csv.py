"""Waypoints of a flight as CSV: local metres, and longitudes and latitudes where there is a CRS.

A row without a position is a point on the way to the waypoint, without an image: the first is home,
and the way back home follows the last waypoint.
"""

import csv
import io

from rastercov.survey.flight import Flight


def content(flight: Flight) -> bytes:
    """The file."""
    place = flight.asked.place
    columns = ["waypoint", "position", "mount", "x_m", "y_m", "z_m", "heading_deg", "pitch_deg"]
    columns += ["leg_m"] + ([] if place is None else ["longitude", "latitude", "height_m"])
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(columns)
    n = len(flight.rows)
    for row in range(n + 1):
        way = flight.way_to(row)[1 if row else 0 :]
        image, views = ["", ""], ["", ""]
        if row < n:
            image = [str(flight.rows[row] + 1), flight.mounts.names[flight.poses.camera[row]]]
            views = [f"{flight.headings_deg[row]:.4f}", f"{flight.views[1][row]:.4f}"]
        degrees = None if place is None else place.geodetic(way)
        for at, point in enumerate(way):
            is_end = at == len(way) - 1
            entry = [flight.first + row + 1, *(image if is_end else ("", ""))]
            entry += [*(f"{value:.6f}" for value in point), *views]
            entry.append(f"{flight.legs[row]:.3f}" if is_end else "")
            if degrees is not None:
                longitude, latitude, height = degrees[at]
                entry += [f"{longitude:.9f}", f"{latitude:.9f}", f"{height:.3f}"]
            table.writerow(entry)
    return file.getvalue().encode()
