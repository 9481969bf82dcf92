"""Flight of a plan as files; a format is a module with `content`, and its line in `FORMATS`."""

from collections.abc import Callable

from rastercov.survey.flight import Flight
from rastercov.survey.geo import flight_csv, flight_kml, qgroundcontrol

FORMATS: dict[str, Callable[[Flight], bytes]] = {
    "flight.plan": qgroundcontrol.content,
    "flight.kml": flight_kml.content,
    "flight.csv": flight_csv.content,
}
"""Content by the name of the file."""
LOCAL = ("flight.csv",)
"""Files that need no CRS."""


def files_of(flight: Flight) -> dict[str, bytes]:
    """Content of each file of a flight: none that is blocked; without a CRS, `LOCAL`.

    Each mission has its own, such as `flight_2.plan`.
    """
    if flight.unwritten:
        return {}
    names = LOCAL if flight.asked.place is None else tuple(FORMATS)
    return {
        name.replace(".", f"_{number}.") if flight.missions else name: FORMATS[name](each)
        for number, each in enumerate(flight.flown, 1)
        for name in names
    }
