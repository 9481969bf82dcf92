"""Paths and units of mesh files, and their readers, which are found when a file is loaded.

Place of a scene on the earth, as files of buildings state it: north, latitude and longitude.
"""

import os
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from rastercov.base import (
    ConfigError,
    MeshError,
    ReadByName,
    StrPath,
    finite_number,
    members,
    service_of,
    shown,
)
from rastercov.core.mesh.terrain import Raster, raster_of_array

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


METRES = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}  # two Unicode mus
METRES |= {"in": 0.0254, "inch": 0.0254, "ft": 0.3048}
LARGEST_FILE = 2 << 30


class Limits(NamedTuple):
    """Limits and tolerances of reading, see `Mesh.load`."""

    drop_invalid: bool
    max_bytes: int
    memory_budget: int | None
    deflection_mm: float | None


class MeshFiles:
    """Hooks of what reads mesh files."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of the files."""
        raise NotImplementedError  # each feature has its own

    def read(
        self, paths: Sequence[StrPath], scales: Sequence[float], limits: Limits
    ) -> tuple[Any, list[tuple[str, str, int, Site]]]:
        """One scene, `Polygons` in metres; and name, SHA-256, faces and site of each file."""
        raise NotImplementedError  # each feature has its own

    def raster(self, path: StrPath) -> Raster:
        """Heights of a GeoTIFF or an ESRI ASCII grid."""
        raise NotImplementedError  # each feature has its own


def mesh_files() -> MeshFiles:
    """The readers."""
    return service_of("formats", MeshFiles())


def raster_of(
    heights: StrPath | ArrayLike,
    spacing: float | tuple[float, float] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
) -> Raster:
    """Raster of a file, or of an array with its spacing and north-west sample, metres."""
    if isinstance(heights, str | os.PathLike):
        return mesh_files().raster(heights)
    return raster_of_array(heights, spacing, origin)


def paths_of(path: StrPath | Sequence[StrPath]) -> Sequence[StrPath]:
    """One path or several as a sequence, or MeshError."""
    kinds = (str, os.PathLike)
    wanted = "a path or several, as strings or Paths"
    paths = [path] if isinstance(path, kinds) else members("path", path, kinds, wanted, MeshError)
    if not paths:
        raise MeshError("expected at least one mesh file, got none; pass a path")
    return paths


def metres_per(unit: str | float) -> float:
    """Metres in one `unit`, a name or a positive number."""
    if isinstance(unit, str) and unit in METRES:
        return METRES[unit]
    if (metres := finite_number(unit)) > 0:
        return metres
    raise MeshError(
        f"expected unit to be one of {', '.join(filter(str.isascii, METRES))} or a positive "
        f"number of metres, got {shown(unit)}"
    )
