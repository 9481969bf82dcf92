"""Waypoints of a flight as CSV: local metres, and longitudes and latitudes where there is a CRS."""

import csv
import io

from rastercov.placement.plan.flight import Flight


def content(flight: Flight) -> bytes:
    """The file."""
    place = flight.asked.place
    columns = ["waypoint", "position", "mount", "x_m", "y_m", "z_m", "heading_deg", "pitch_deg"]
    columns += ["leg_m"] + ([] if place is None else ["longitude", "latitude", "height_m"])
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(columns)
    degrees = None if place is None else place.geodetic(flight.places)
    for row, eye in enumerate(flight.places):
        mount = flight.mounts.names[flight.poses.camera[row]]
        entry = [row + 1, int(flight.rows[row]) + 1, mount, *(f"{value:.6f}" for value in eye)]
        entry += [f"{flight.headings_deg[row]:.4f}", f"{flight.views[1][row]:.4f}"]
        entry.append(f"{flight.legs[row]:.3f}")
        if degrees is not None:
            longitude, latitude, height = degrees[row]
            entry += [f"{longitude:.9f}", f"{latitude:.9f}", f"{height:.3f}"]
        table.writerow(entry)
    return file.getvalue().encode()
