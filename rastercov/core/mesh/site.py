"""Place of a scene on the earth, as files of buildings state it: north, latitude and longitude."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from rastercov.base import ConfigError, ReadByName

SAME_DEG = 1.0
"""Angle up to which two directions of north, or two places, are the same."""


class Site(NamedTuple):
    """Direction of north, degrees from +x towards +y, latitude and longitude; None if unknown."""

    north_deg: float | None = None
    latitude: float | None = None
    longitude: float | None = None

    @classmethod
    def common(cls, sites: Iterable["Site"]) -> "Site":
        """Values that no other site contradicts, those of the first that has one."""
        columns = [[each for each in own if each is not None] for own in zip(*sites, strict=True)]
        return cls(
            *(own[0] if own and all(_is_same(own[0], x) for x in own) else None for own in columns)
        )

    def known_values(self, given: ReadByName, name: str) -> tuple[Any, Any, Any]:
        """Direction of north, latitude and longitude, those given first; None if unknown.

        `name` is that of north for people.

        Raises
        ------
        ConfigError
            For a given north that the files contradict.
        """
        both = {**self._asdict(), **{key: x for key, x in given.items() if x is not None}}
        north, own = both["north_deg"], self.north_deg
        if own is not None and not _is_same(own, north):
            raise ConfigError(
                f"{name}: expected north at {own:.6g} degrees from +x, as in the mesh file, got "
                f"{north:g}; leave it out, or correct the file"
            )
        return north, both["latitude"], both["longitude"]


def _is_same(one: float, other: float) -> bool:
    return bool(abs((one - other + 180) % 360 - 180) <= SAME_DEG)


NOWHERE = Site()
"""Site of a scene of which nothing is known."""
