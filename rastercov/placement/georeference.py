"""Place of a scene on the Earth: coordinate reference system (CRS), and origin in it.

Local coordinates are metres with z up. In a projected CRS they are eastings and northings from the
origin; in a geographic one they are east, north and up of a tangent frame at the origin. Those of
`is_geocentric` are earth-centred, and `level` turns a scene into such a tangent frame.

Files of photogrammetry programs that state their CRS have a function in `FINDERS`. Sources: ODM,
stages/run_opensfm.py; OpenSfM, opensfm/geo.py; PROJ documentation, "Geocentric to topocentric
conversion".
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import ConfigError, FloatArray, matmul, norm, parse_json, shown
from rastercov.core.camera import Poses
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import matrices_of, rotation_about
from rastercov.formats.cameras.source import Source
from rastercov.formats.meshes.xml_tree import local_name

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

INSTALL = "expected pyproj for a CRS, got no package; run: pip install 'rastercov[geo]'"
WGS84 = "EPSG:4326"
MOST_BEYOND_DEG = 10.0
"""Degrees outside the area of use of a CRS at which a scene may be."""
MOST_SCALE_ERROR = 0.05
"""Of lengths on a map, such as Web Mercator beyond 17 degrees of latitude."""
MOST_EXTENT_M = 1e6
"""Width of a scene on a map, m; beyond, its unit is wrong."""
LOCAL_M = 1e4
"""Distance from 0 up to which coordinates without an origin are local, m."""


@dataclass(frozen=True)
class GeoReference:
    """Place of local coordinates on the Earth.

    Attributes
    ----------
    crs : str
        CRS as pyproj reads it: a code such as "EPSG:32632", WKT, or a PROJ string.
    origin : (float, float, float)
        Local origin in the CRS: easting, northing and height, m, of a projected CRS; latitude and
        longitude, degrees, and height of a geographic one.
    is_geocentric : bool
        True for earth-centred coordinates on the ellipsoid of the CRS.

    Raises
    ------
    ConfigError
        Without pyproj, and for a CRS that it does not know.

    Examples
    --------
    >>> import numpy as np
    >>> from rastercov.placement.georeference import GeoReference
    >>> place = GeoReference("EPSG:32632", (500000.0, 5300000.0, 400.0))
    >>> place.geodetic(np.zeros((1, 3))).round(4).tolist()  # longitude, latitude, height
    [[9.0, 47.8537, 400.0]]
    """

    crs: str
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_geocentric: bool = False

    def __post_init__(self) -> None:
        if not self._is_projected and not self.is_geocentric:
            latitude, longitude, _ = self.origin
            if not (abs(latitude) <= 90 and abs(longitude) <= 360):
                raise ConfigError(
                    f"expected a latitude and longitude, got {latitude:g}, {longitude:g}; give "
                    "the origin in the order of the CRS"
                )

    @cached_property
    def _crs(self) -> "CRS":
        try:
            from pyproj import CRS
            from pyproj.exceptions import CRSError
        except ImportError:
            raise ConfigError(INSTALL) from None
        try:
            read = CRS.from_user_input(self.crs)
        except CRSError:
            raise ConfigError(
                f"expected a CRS, got {shown(self.crs)}; give a code such as EPSG:32632"
            ) from None
        if not (read.is_projected or read.is_geographic):
            raise ConfigError(
                f"expected a projected or geographic CRS, got {shown(read.name)}; give another"
            )
        unit = read.axis_info[0].unit_conversion_factor if read.is_projected else 1.0
        if unit != 1.0:
            raise ConfigError(f"expected a CRS in metres, got {shown(read.name)}; give another")
        return read

    @property
    def _is_projected(self) -> bool:
        return bool(self._crs.is_projected)

    @cached_property
    def map_crs(self) -> "CRS":
        """CRS of maps: that of the coordinates if it is projected, else the UTM zone of origin."""
        if self._is_projected:
            return self._crs
        longitude, latitude, _ = self.geodetic(np.zeros((1, 3)))[0]
        zone = int((longitude + 180) % 360 // 6) + 1
        return type(self._crs).from_epsg((32600 if latitude >= 0 else 32700) + zone)

    @cached_property
    def epsg(self) -> int | None:
        """EPSG code of `map_crs`; None where it has none."""
        epsg = self.map_crs.to_epsg()
        return None if epsg is None else int(epsg)

    @property
    def words(self) -> str:
        """Name of the CRS of maps, for people."""
        return f"{self.map_crs.name}{'' if self.epsg is None else f' (EPSG:{self.epsg})'}"

    @cached_property
    def _to_base(self) -> "Transformer | None":
        """From the tangent frame at the origin to longitude and latitude of the CRS."""
        from pyproj import Transformer

        if self._is_projected and not self.is_geocentric:
            return None
        ellipsoid = self._crs.ellipsoid
        assert ellipsoid is not None
        shape = f"+a={ellipsoid.semi_major_metre!r} +rf={ellipsoid.inverse_flattening!r}"
        latitude, longitude, height = self.origin
        at = f"+lat_0={latitude!r} +lon_0={longitude!r} +h_0={height!r}"
        steps = [] if self.is_geocentric else [f"+step +inv +proj=topocentric {shape} {at}"]
        steps.append(f"+step +inv +proj=cart {shape}")
        steps.append("+step +proj=unitconvert +xy_in=rad +xy_out=deg")
        return Transformer.from_pipeline("+proj=pipeline " + " ".join(steps))

    def _in(self, points: FloatArray, target: "CRS | str") -> FloatArray:
        """Local points (N, 3) in another CRS, x or longitude first."""
        from pyproj import Transformer

        xyz, source = np.asarray(points, np.float64), self._crs
        if self._to_base is not None:
            xyz, source = np.stack(self._to_base.transform(*xyz.T), axis=1), self._base
        else:
            xyz = xyz + self.origin
        way = Transformer.from_crs(source, target, always_xy=True)
        values = np.stack(way.transform(*xyz.T), axis=1).reshape(-1, 3)
        if not (is_there := np.isfinite(values).all(axis=1)).all():
            at = ", ".join(f"{value:.6g}" for value in points[int(is_there.argmin())])
            raise ConfigError(
                f"expected places on the map of {shown(self._crs.name)}, got {at} m from the "
                "origin; correct the origin, or the unit of the scene"
            )
        return values

    @property
    def _base(self) -> "CRS":
        """Geographic CRS that the CRS is based on."""
        base = self._crs.geodetic_crs
        assert base is not None
        return base

    def geodetic(self, points: FloatArray) -> FloatArray:
        """Longitude and latitude in WGS 84, degrees, and height of local points (N, 3)."""
        return self._in(points, WGS84)

    def on_map(self, points: FloatArray) -> FloatArray:
        """Easting, northing and height in `map_crs` of local points (N, 3), m."""
        return self._in(points, self.map_crs)

    def headings_deg(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """(N,) azimuths from true north, clockwise, of horizontal directions (N, 3) at points."""
        from pyproj import Geod

        here, there = self.geodetic(points), self.geodetic(points + directions)
        return np.asarray(Geod(ellps="WGS84").inv(*here.T[:2], *there.T[:2])[0]) % 360

    def check_scene(self, bounds: FloatArray) -> None:
        """ConfigError for a scene, by its bounds (2, 3), that is not all where its CRS is used.

        Its coordinates are local without an origin, or those of the CRS with one.
        """
        from pyproj import Proj

        if self.is_geocentric:
            return
        middle, extent = bounds.mean(axis=0), float(np.ptp(bounds[:, :2], axis=0).max())
        if not extent <= MOST_EXTENT_M:
            raise ConfigError(
                f"expected a scene of up to {MOST_EXTENT_M / 1e3:,g} km on a map, got "
                f"{extent / 1e3:,.6g} km; correct its unit"
            )
        area = self._crs.area_of_use if self._is_projected else None
        is_whole = self._is_projected and (area is None or norm(middle[:2]) >= LOCAL_M)
        if not any(self.origin[:2]) and not is_whole:
            raise ConfigError(
                f"expected an origin with {self.words} for coordinates near 0, got none; give "
                "origin, the place of 0, 0 in it"
            )
        corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
        longitude, latitude, _ = self.geodetic(corners).T
        if area is None:
            return
        width = (area.east - area.west) % 360 or 360.0
        east = np.abs((longitude - area.west - width / 2 + 180) % 360 - 180) - width / 2
        beyond = np.max((east, area.south - latitude, latitude - area.north), axis=0)
        row = int(beyond.argmax())
        if not beyond[row] <= MOST_BEYOND_DEG:
            raise ConfigError(
                f"expected a scene where {shown(self.crs)} is used, got longitude "
                f"{longitude[row]:.4g}, latitude {latitude[row]:.4g}; correct the origin"
            )
        factors = Proj(self._crs).get_factors(longitude[0], latitude[0])
        scale = factors.areal_scale**0.5
        if not abs(scale - 1) < MOST_SCALE_ERROR:
            raise ConfigError(
                f"expected a map with the lengths of the ground, got {shown(self.crs)}, with "
                f"{scale:.3g} times these; give another, such as UTM, and a mesh in it"
            )

    def level(self, mesh: Mesh, poses: Poses) -> tuple["GeoReference", Mesh, Poses]:
        """Scene of earth-centred coordinates in the tangent frame at the middle of the mesh."""
        if not self.is_geocentric:
            return self, mesh, poses
        middle = mesh.centre
        assert self._to_base is not None
        longitude, latitude, height = self._to_base.transform(*middle.tolist())
        turned = mesh.moved(translation=-middle).moved(angle_deg=-(longitude + 90))
        turned = turned.moved(axis=(1, 0, 0), angle_deg=latitude - 90)
        about_z = rotation_about((0, 0, 1), np.radians(-(longitude + 90)))
        rotation = matmul(rotation_about((1, 0, 0), np.radians(latitude - 90)), about_z)
        matrices = poses.world_from_camera
        eyes = matmul(matrices[:, :3, 3] - middle, rotation.T)
        result = Poses.of(
            matrices_of(matmul(rotation, matrices[:, :3, :3]), eyes), camera=poses.camera
        )
        place = GeoReference(self._base.to_wkt(), (latitude, longitude, height))
        if self._is_projected:
            place.__dict__["map_crs"] = self._crs
        return place, turned, result


def given_reference(crs: str | None, origin: str | None) -> GeoReference | None:
    """Georeference of options: a CRS, and an origin as "x,y" or "x,y,z"; None without a CRS."""
    if crs is None:
        if origin is not None:
            raise ConfigError("expected --crs with --origin, got none; give the CRS")
        return None
    numbers = [] if origin is None else origin.replace(" ", "").split(",")
    try:
        values = [float(each) for each in numbers]
    except ValueError:
        values = [np.nan]
    if len(values) not in (0, 2, 3) or not np.isfinite(values).all():
        raise ConfigError(f"--origin: expected 2 or 3 numbers, got {shown(origin)}; write 0,0,0")
    x, y, z = (*values, 0.0, 0.0, 0.0)[:3] if len(values) != 2 else (*values, 0.0)
    return GeoReference(crs, (x, y, z))


def _of_reference_lla(content: object) -> GeoReference | None:
    """Georeference of OpenSfM's reference point."""
    if not isinstance(content, Mapping):
        return None
    try:
        values = [float(content[name]) for name in ("latitude", "longitude", "altitude")]
    except (TypeError, KeyError, ValueError):
        return None
    return GeoReference(WGS84, (values[0], values[1], values[2]))


COORDS = re.compile(r"WGS84 UTM (\d{1,2})([NS])\s+(-?[\d.]+)\s+(-?[\d.]+)")
"""Start of odm_georeferencing/coords.txt: zone, and offset of the coordinates."""


def _utm_of(coords: Path) -> GeoReference | None:
    """UTM zone of a project of ODM, and the offset of its coordinates, by its coords.txt."""
    result = COORDS.match(coords.read_text(encoding="utf-8")) if coords.is_file() else None
    if result is None:
        return None
    code = (32600 if result[2] == "N" else 32700) + int(result[1])
    return GeoReference(f"EPSG:{code}", (float(result[3]), float(result[4]), 0.0))


def of_odm(path: Path) -> GeoReference | None:
    """Georeference of shots.geojson of ODM, whose poses are in the UTM zone without an offset."""
    if path.name != "shots.geojson":
        return None
    utm = _utm_of(path.parent.parent / "odm_georeferencing" / "coords.txt")
    return utm and replace(utm, origin=(0.0, 0.0, 0.0))


def of_opensfm(path: Path) -> GeoReference | None:
    """Georeference of a reconstruction of OpenSfM or ODM.

    ODM turns reconstruction.json into UTM less an offset, and keeps the one in the tangent frame as
    reconstruction.topocentric.json.
    """
    file = path / "reconstruction.json" if path.is_dir() else path
    if not file.name.startswith("reconstruction") or file.suffix != ".json" or not file.is_file():
        return None
    folder = file.parent
    coords = folder.parent / "odm_georeferencing" / "coords.txt"
    is_tangent = file.name == "reconstruction.topocentric.json"
    if not is_tangent and (folder / "reconstruction.topocentric.json").is_file():
        return _utm_of(coords)
    own = folder / "reference_lla.json"
    if own.is_file():
        return _of_reference_lla(parse_json(own.read_bytes()))
    content = parse_json(file.read_bytes())
    first = content[0] if isinstance(content, list) and content else content
    return _of_reference_lla(first.get("reference_lla") if isinstance(first, dict) else None)


def of_metashape(path: Path) -> GeoReference | None:
    """Georeference of the first enabled chunk of Metashape, whose poses are earth-centred."""
    if path.suffix.lower() != ".xml" or not path.is_file():
        return None
    source = Source(path)
    if not source.is_xml:
        return None
    root: Element = source.xml
    chunks = [each for each in root.iter() if local_name(each) == "chunk"]
    chunks = [
        each for each in chunks if each.get("enabled", "true") not in ("false", "0")
    ] or chunks
    words = [
        each.text or "" for each in (chunks[0] if chunks else ()) if local_name(each) == "reference"
    ]
    text = words[0].strip() if words else ""
    if not text.startswith(("GEO", "PROJ", "COMPD")):
        return None
    return GeoReference(text, is_geocentric=True)


FINDERS: tuple[Callable[[Path], GeoReference | None], ...] = (of_odm, of_opensfm, of_metashape)
"""Of camera files by their path, each None for files of other programs."""


def reference_of(path: Path) -> GeoReference | None:
    """Place on the Earth that a camera file, or a file of its project, states; None for none."""
    return next((result for each in FINDERS if (result := each(path)) is not None), None)
