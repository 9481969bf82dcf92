"""Lamps: points that send light, each an eye with an intensity; lamps of size are several points.

A point lamp sees all around; a spot sees a cone. What a lamp reaches is what its points see, by the
same regions as of cameras. A lamp looks along the z axis of its frame. The sun is a lamp whose rays
are parallel, or points of its disc; its place counts for nothing.

Intensity of a point at an angle t from its axis: I(t) = I / n cos^m t, I that of the lamp on its
axis, m its exponent; or that of a luminaire (`rastercov.light.photometry`).
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    CameraError,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    PoseError,
    ReadByName,
    StrPath,
    WholeArray,
    check_kind,
    dots,
    finite_number,
    frozen_record,
    is_one_of,
    members,
    norm,
    owners_of,
    shown,
)
from rastercov.base.arguments import distinct, number, positive, two
from rastercov.base.format import distance as in_metres
from rastercov.core.camera import Camera, Poses, apparent, fibonacci_sphere, look_at, valid_poses
from rastercov.core.camera.camera import field_angle
from rastercov.core.camera.catalogue import KINDS
from rastercov.core.camera.exposure import Exposure, check_unit
from rastercov.core.camera.parallel import FAR, SUN_RADIUS_DEG
from rastercov.core.camera.viewpoints import cone_of_directions
from rastercov.light.gltf_lights import GltfLight, scene_of
from rastercov.light.photometry import (
    ASCEND,
    LARGEST_NUMBER,
    LEAST_FALLOFF,
    WEBS,
    Planes,
    Profile,
    are_angles,
    are_planes,
    falloff,
    read_luminaire,
    shares_of,
    shares_of_planes,
    table_of,
)

SUN = KINDS[-1]
SIZES = {
    "bar": "its length in metres",
    "ring": "its diameter in metres",
    "dome": "its diameter in metres",
    "area": "its side or [width, height] in metres",
}
"""Meaning of `size` by kind of lamp; the other kinds have none."""
MOST_POINTS = 36
"""Points of a lamp: shares of it that are seen change by less than 0.2 points beyond 16."""
MOST_LAMPS = 64
"""Points of all lamps together."""
UNITS = {"cd": "lx", "W/sr": "W/m2"}
"""Unit of an illuminance by that of the intensity."""
PIXELS_PER_RADIAN = 1000
"""Of the image of a lamp, whose outline alone matters."""
MARGIN = 64
"""Pixels beyond the cone of a lamp in its image: polygons around the cone end within them, so that
nothing is cut to the image."""
MOST_RADIUS_DEG = 10.0
"""Largest radius of the disc of a sun."""
WIDE = 256.0
"""Width of the parallel rays of a sun, relative to the diagonal of a scene, whose bodies may move
within; it costs 8 of 53 bits."""
SHINES: ByName = {"half_angle_deg": 90.0, "exponent": 1.0}
"""Points of a lamp of size, as of a surface that shines."""


@dataclass(frozen=True, kw_only=True)
class Lamp:
    """A lamp, modelled as one or more point sources.

    `point`, `spot`, `bar`, `ring`, `dome`, `area`, `sun` and `from_ies` make one. Give exactly one
    of `intensity`, `power_w_sr` and `range_m`. The axis of a lamp is z of its own frame.

    Parameters
    ----------
    kind : str
        "point", "spot", "bar", "ring", "dome", "area" or "sun".
    intensity : float, optional
        Luminous intensity on the axis, cd, for illuminances in lx; of a sun its illuminance
        perpendicular to the rays, lx.
    power_w_sr : float, optional
        Radiant intensity on the axis, W/sr, for irradiances in W/m^2; of a sun its irradiance
        perpendicular to the rays, W/m^2.
    range_m : float, optional
        Range of an infrared lamp, metres, instead of a power: the irradiance on the axis at that
        distance is taken as 1 W/m^2, which is also the minimum for a task without
        `min_illuminance`.
    half_angle_deg : float
        Angle from the axis beyond which a point emits no light, degrees, (0, 175], or 180; of a sun
        the radius of its disc.
    exponent : float
        m of cos^m; 1 for a Lambertian emitter, 0 for the same intensity in all directions.
    size : (2,) float
        Width and height, metres; (length, 0) of a bar, (diameter, 0) of a ring or dome; of a sun
        the width of its rays.
    points : int
        Points of the lamp, 1 to 36.
    share : float
        Share of the points of the lamp that a lit surface point must see, (0, 1]; 0.5 unless given.
    profile : sequence of (float, float)
        Angles from the axis, degrees, ascending from 0, and the intensity there relative to that on
        the axis or the largest, in place of the exponent, linear in between; see `from_ies`.
    planes : sequence of sequences of float
        For a lamp without rotational symmetry: angles around the axis, degrees, ascending through a
        full turn (the last is the first + 360), each with the relative intensities at the angles of
        the profile.
    web : str
        Frame of these angles: "C", "A" or "B" as in IES LM-63, or "up" for an uplight of type C.
    inner_angle_deg : float, optional
        Angle from the axis up to which a spot has all its intensity, degrees, up to
        `half_angle_deg`, where it falls to 0 as in glTF (KHR_lights_punctual).

    Raises
    ------
    CameraError
        For a value outside its limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> bulb = rc.Lamp.point(intensity=100)  # cd
    >>> bulb.unit
    'cd'
    >>> ring = rc.Lamp.ring(diameter=0.1, power_w_sr=0.5, points=12)
    >>> ring.kind, ring.points
    ('ring', 12)
    """

    kind: str = "point"
    intensity: float | None = None
    power_w_sr: float | None = None
    range_m: float | None = None
    half_angle_deg: float = 180.0
    exponent: float = 0.0
    size: tuple[float, float] = (0.0, 0.0)
    points: int = 1
    share: float = 0.5
    profile: Profile = ()
    planes: Planes = ()
    web: str = "C"
    inner_angle_deg: float | None = None

    def __post_init__(self) -> None:
        if not is_one_of(self.kind, KINDS):
            raise CameraError(
                f"expected kind of a lamp to be {', '.join(KINDS)}, got {shown(self.kind)}"
            )
        given = {name: getattr(self, name) for name in ("intensity", "power_w_sr", "range_m")}
        if sum(value is not None for value in given.values()) != 1:
            words = "intensity (cd), power_w_sr (W/sr) or range_m (m) of a lamp"
            if self.kind == SUN:
                words = "illuminance (lx) or irradiance (W/m2) of a sun"
            raise CameraError(
                f"expected {words}, got "
                f"{', '.join(shown(each) for each in given.values() if each is not None) or 'none'}"
                "; give one of them"
            )
        for name, value in given.items():
            if value is not None:
                self.__dict__[name] = positive(f"{name} of a lamp", value)
        half_angle = field_angle("half_angle_deg of a lamp", self.half_angle_deg)
        self.__dict__["half_angle_deg"] = half_angle
        if self.kind == SUN and not half_angle <= MOST_RADIUS_DEG:
            raise CameraError(f"expected radius_deg of a sun up to 10, got {half_angle:g}")
        m = finite_number(self.exponent)
        if m != 0 and not 1 <= m <= 1000:
            raise CameraError(
                f"expected exponent of a lamp to be 0, or 1 to 1000, got {shown(self.exponent)}"
            )
        if m and not half_angle <= 90:
            raise CameraError(
                "expected half_angle_deg of a lamp with an exponent to be up to 90, got "
                f"{shown(self.half_angle_deg)}"
            )
        if not 0 < finite_number(self.share) <= 1:
            raise CameraError(
                f"expected share of a lamp to be more than 0, up to 1, got {shown(self.share)}"
            )
        n = finite_number(self.points)
        is_single = self.kind in KINDS[:2]
        if not n.is_integer() or not 1 <= n <= (1 if is_single else MOST_POINTS):
            raise CameraError(
                f"expected points of a lamp of kind {self.kind} to be "
                f"{'1' if is_single else f'from 1 to {MOST_POINTS}'}, got {shown(self.points)}"
            )
        self.__dict__.update(exponent=float(m), share=float(self.share), points=int(n))
        width, height = (number("size of a lamp", each) for each in two("size", self.size))
        n_sides = (self.kind in SIZES) + (self.kind == "area") + (self.kind == SUN and width > 0)
        if sum(each > 0 for each in (width, height)) != n_sides or not min(width, height) >= 0:
            raise CameraError(
                f"expected size of a lamp of kind {self.kind}, {SIZES.get(self.kind, 'none')}, "
                f"got {shown(self.size)}"
            )
        self.__dict__.update(size=(width, height), profile=_check_profile(self.profile))
        if self.profile and self.exponent:
            raise CameraError("expected a profile or an exponent of a lamp, got both; remove one")
        if (inner := self.inner_angle_deg) is not None and (
            not 0 <= finite_number(inner) <= half_angle <= 90
            or self.kind != "spot"
            or self.profile
            or self.exponent
        ):
            raise CameraError(
                "expected inner_angle_deg of a spot without profile or exponent to be from 0 to "
                f"half_angle_deg, at most 90, got {shown(inner)}"
            )
        self.__dict__["planes"] = _check_planes(self.planes, len(self.profile))
        if not is_one_of(self.web, WEBS) or (self.web in ("A", "B") and not self.planes):
            raise CameraError(
                f"expected web of a lamp to be {', '.join(WEBS)}, A and B with planes, got "
                f"{shown(self.web)}"
            )

    @classmethod
    def from_ies(cls, path: StrPath, tilt_deg: float | None = 0.0) -> "Lamp":
        """Lamp of one point with the intensities of an IES LM-63 or EULUMDAT (.ldt) file.

        `tilt_deg` is the angle between its axis and straight down, degrees. It matters only for
        files with TILT data: for these, None (unknown) is an error unless all factors are equal.
        """
        luminaire = read_luminaire(path)
        own = luminaire._asdict()
        tilt = finite_number(tilt_deg) if tilt_deg is not None else None
        del own["tilt"]
        return cls(
            kind="spot", **own | {"intensity": luminaire.intensity * luminaire.tilt_of(tilt)}
        )

    @classmethod
    def point(cls, intensity: float | None = None, power_w_sr: float | None = None) -> "Lamp":
        """Isotropic point lamp; give `intensity`, cd, or `power_w_sr`, W/sr."""
        return cls(kind="point", intensity=intensity, power_w_sr=power_w_sr)

    @classmethod
    def spot(
        cls,
        half_angle_deg: float,
        intensity: float | None = None,
        power_w_sr: float | None = None,
        *,
        exponent: float = 0.0,
    ) -> "Lamp":
        """Lamp of one point that lights a cone around its axis; intensities as for `point`.

        Examples
        --------
        >>> import rastercov as rc
        >>> spot = rc.Lamp.spot(half_angle_deg=30, intensity=200)
        >>> spot.half_angle_deg
        30.0
        """
        own: ByName = {"half_angle_deg": half_angle_deg, "exponent": exponent}
        return cls(kind="spot", intensity=intensity, power_w_sr=power_w_sr, **own)

    @classmethod
    def bar(
        cls,
        length: float,
        intensity: float | None = None,
        power_w_sr: float | None = None,
        *,
        points: int = 8,
        **more: object,
    ) -> "Lamp":
        """Lamp of points in a row of `length` metres along x, at the middles of equal parts.

        The intensity is that of the whole lamp, as for `point`. Points of a lamp with a size are
        Lambertian emitters, unless `half_angle_deg` and `exponent` are among `more`, the other
        arguments of `Lamp`.

        Examples
        --------
        >>> import rastercov as rc
        >>> bar = rc.Lamp.bar(length=0.3, intensity=200, points=8)
        >>> bar.intensity_of_point  # cd of each of its points
        25.0
        """
        return cls._shining("bar", (length, 0.0), (intensity, power_w_sr, points), more)

    @classmethod
    def ring(
        cls,
        diameter: float,
        intensity: float | None = None,
        power_w_sr: float | None = None,
        *,
        points: int = 12,
        **more: object,
    ) -> "Lamp":
        """Lamp of points on a circle of `diameter` metres around z, aimed along z; see `bar`.

        Examples
        --------
        >>> import rastercov as rc
        >>> rc.Lamp.ring(diameter=0.1, intensity=120).intensity_of_point
        10.0
        """
        return cls._shining("ring", (diameter, 0.0), (intensity, power_w_sr, points), more)

    @classmethod
    def dome(
        cls,
        diameter: float,
        intensity: float | None = None,
        power_w_sr: float | None = None,
        *,
        points: int = 16,
        **more: object,
    ) -> "Lamp":
        """Lamp of points on a hemisphere of `diameter` metres behind its origin, aimed at it.

        Other arguments as for `bar`.
        """
        return cls._shining("dome", (diameter, 0.0), (intensity, power_w_sr, points), more)

    @classmethod
    def area(
        cls,
        width: float,
        height: float | None = None,
        intensity: float | None = None,
        power_w_sr: float | None = None,
        *,
        points: int = 16,
        **more: object,
    ) -> "Lamp":
        """Rectangular lamp, `width` x `height` metres, of points on a grid; see `bar`.

        It is square without `height`. The number of columns is the divisor of `points` that makes
        grid cells squarest.

        Examples
        --------
        >>> import rastercov as rc
        >>> panel = rc.Lamp.area(0.6, 0.3, intensity=800, points=16)
        >>> panel.points, panel.intensity_of_point  # cd of each point
        (16, 50.0)
        """
        size = width, width if height is None else height
        return cls._shining("area", size, (intensity, power_w_sr, points), more)

    @classmethod
    def sun(
        cls,
        illuminance: float | None = None,
        irradiance: float | None = None,
        *,
        points: int = 1,
        share: float = 0.5,
        radius_deg: float = SUN_RADIUS_DEG,
    ) -> "Lamp":
        """Lamp of parallel rays along z of its pose; the position is ignored.

        Parameters
        ----------
        illuminance, irradiance : float, optional
            Perpendicular to its rays, lx or W/m^2: give one of them.
        points : int
            1, the default, for the centre of its disc; 3 or more for the corners of a polygon
            around it.
        share : float
            Share of these points that a lit surface point must see, (0, 1].
        radius_deg : float
            Angular radius of its disc, degrees.

        Examples
        --------
        >>> import rastercov as rc
        >>> sun = rc.Lamp.sun(illuminance=80e3)
        >>> lamps = rc.Lamps([sun], rc.look_at((0.2, -0.4, 0.9), (0, 0, 0)), ["sun"])
        >>> lamps.unit
        'lx'
        """
        own: ByName = {"half_angle_deg": radius_deg, "points": points, "share": share}
        return cls(kind=SUN, intensity=illuminance, power_w_sr=irradiance, **own)

    @classmethod
    def _shining(
        cls, kind: str, size: Sequence[float], given: Sequence[object], more: dict[str, object]
    ) -> "Lamp":
        """Lamp of points that shines like a surface, by its intensity or power, and its points."""
        own = dict(zip(("intensity", "power_w_sr", "points"), given, strict=True))
        return cls(**SHINES | {"kind": kind, "size": size} | own | more)

    @property
    def unit(self) -> str:
        """Unit of the intensity, "cd" or "W/sr"."""
        return "W/sr" if self.intensity is None else "cd"

    @property
    def intensity_of_point(self) -> float:
        """Intensity of each point on its axis, in `unit`."""
        whole = self.power_w_sr if self.intensity is None else self.intensity
        if self.range_m is not None:
            whole = self.range_m**2
        assert whole is not None
        return whole / self.points * (FAR**2 if self.kind == SUN else 1.0)

    @property
    def table(self) -> FloatArray | None:
        """(K, 4) shares of the intensity by the cosine, see `table_of`; None for an exponent."""
        if self.inner_angle_deg is not None:
            return falloff(self.half_angle_deg, self.inner_angle_deg)
        return table_of(self.profile) if self.profile and not self.planes else None

    @property
    def strength(self) -> str:
        """Intensity on its axis as text; of a sun its illuminance."""
        if self.kind == SUN:
            return f"{self.intensity or self.power_w_sr:g} {UNITS[self.unit]}"
        return f"{self.intensity_of_point * self.points:g} {self.unit}"

    @property
    def points_needed(self) -> int:
        """Number of its points that a lit surface point must see."""
        return max(1, math.ceil(self.share * self.points - 1e-9))

    @property
    def lamp_from_point(self) -> FloatArray:
        """(points, 4, 4) poses of its points, each aimed along its z axis."""
        n, (width, height) = self.points, self.size
        places = np.repeat(np.eye(4)[None], n, axis=0)
        middles = (np.arange(n) + 0.5) / n
        if self.kind == "bar":
            places[:, 0, 3] = (middles - 0.5) * width
        elif self.kind == "ring":
            turn = 2 * np.pi * middles
            places[:, 0, 3], places[:, 1, 3] = np.cos(turn), np.sin(turn)
            places[:, :2, 3] *= width / 2
        elif self.kind == "dome":
            behind = -fibonacci_sphere(n, 1.0) * width / 2
            places = look_at(behind, np.zeros(3), (0.0, 1.0, 0.0))
        elif self.kind == "area":
            divisors = [each for each in range(1, n + 1) if n % each == 0]
            columns = min(
                divisors, key=lambda m: abs(math.log(width / m) - math.log(height * m / n))
            )
            rows = n // columns
            x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
            places[:, 0, 3] = (x.ravel() / columns - 0.5) * width
            places[:, 1, 3] = (y.ravel() / rows - 0.5) * height
        elif self.kind == SUN and n > 2:
            rays = cone_of_directions(np.eye(3)[2:], n, self.half_angle_deg)
            places = look_at(np.zeros(3), rays[0], (0.0, -1.0, 0.0))
        if self.web == "up":
            places[:, :3, 1:3] *= -1
        return places

    @property
    def eye(self) -> Camera:
        """Camera that sees what one of its points lights; CameraError for a sun without a scene."""
        if self.kind == SUN:
            if not self.size[0]:
                raise CameraError("expected lamps with positions to choose from, got a sun")
            side = PIXELS_PER_RADIAN
            return Camera.orthographic(side, side, px_per_m=side / self.size[0])
        if self.half_angle_deg >= 180:
            step = 180 / math.pi
            return Camera(width=360, height=180, fx=step, fy=step, model="equirectangular")
        radius = math.ceil(PIXELS_PER_RADIAN * math.radians(self.half_angle_deg)) + MARGIN
        return Camera(
            width=2 * radius,
            height=2 * radius,
            fx=PIXELS_PER_RADIAN,
            fy=PIXELS_PER_RADIAN,
            model="opencv_fisheye",
            max_angle_deg=self.half_angle_deg,
        )

    def to_json(self) -> ByName:
        """Arguments of the constructor that differ from its defaults, ready for JSON."""
        own = {each.name: getattr(self, each.name) for each in fields(self)}
        own = {each.name: own[each.name] for each in fields(self) if own[each.name] != each.default}
        arrays = ("size", "profile", "planes")
        return own | {name: list(own[name]) for name in arrays if name in own}


@frozen_record(init=False, repr=False)
class Lamps(InOneLine):
    """Lamps with their poses, fixed in the work cell or on the rig of the cameras.

    Parameters
    ----------
    lamps : sequence of Lamp
        N lamps, all in cd or all in W/sr.
    places : (N, 4, 4) array_like, optional
        world_from_lamp, or rig_from_lamp of lamps on the rig; z is the axis of a lamp. All at the
        origin unless given.
    names : sequence of str, optional
        Distinct names; "lamp 0", ... unless given.
    rides : sequence of bool or str, optional
        True for lamps that move with the rig, or with the camera where there is no rig; or the name
        of the camera, or of the rig of a plan, that carries the lamp. By default all are fixed.
    ambient : float
        Ambient illuminance, lx or W/m^2, 0 or more.
    exposure : Exposure, optional
        Sensor and exposure time of the cameras; illuminance must also be within its `band`.
    notes : sequence of str
        Content of the file that does not count.

    Raises
    ------
    CameraError
        For no lamp, more than 64 points of all lamps, or lamps in different units.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> above = rc.look_at((0, 0, 1), (0, 0, 0))
    >>> lamps = rc.Lamps([rc.Lamp.point(intensity=100)], above, ["ceiling"])
    >>> poses = rc.look_at([(0, 0, 0.6), (0.6, 0, 0)], (0, 0, 0))
    >>> result = rc.evaluate(mesh, camera, poses, lamps=lamps)
    >>> round(result.covered.share(), 3)  # both see a side of six, and the lamp lights the top
    0.167
    """

    lamps: tuple[Lamp, ...]
    places: FloatArray
    names: tuple[str, ...]
    rides: tuple[bool | str, ...]
    ambient: float
    exposure: Exposure | None
    notes: tuple[str, ...]

    def __init__(
        self,
        lamps: Sequence[Lamp],
        places: ArrayLike | None = None,
        names: Sequence[str] | None = None,
        *,
        rides: Sequence[bool | str] | None = None,
        ambient: float = 0.0,
        exposure: Exposure | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        result = members("lamps", lamps, Lamp, "Lamp values", CameraError)
        n, n_points = len(result), sum(lamp.points for lamp in result)
        if not 1 <= n_points <= MOST_LAMPS:
            raise CameraError(
                f"expected 1 to {MOST_LAMPS} points of all lamps, got {n_points}; "
                f"{'give lamps with size fewer points' if n else 'give a lamp'}"
            )
        _check_alike(result)
        given = [f"lamp {row}" for row in range(n)] if names is None else names
        words = distinct("names of lamps", given, n, CameraError)
        matrices = np.repeat(np.eye(4)[None], n, axis=0) if places is None else valid_poses(places)
        if len(matrices) != n:
            raise PoseError(
                f"expected places to have one pose for each of {n} lamps, got {len(matrices)}"
            )
        wanted = f"True, False or the name of a camera for each of {n} lamps"
        on_rig = (
            (False,) * n
            if rides is None
            else members("rides", rides, (bool, np.bool_, str), wanted, CameraError)
        )
        if len(on_rig) != n:
            raise CameraError(f"expected rides to be {wanted}, got {len(on_rig)}")
        on_rig = tuple(each if isinstance(each, str) else bool(each) for each in on_rig)
        if any(lamp.kind == SUN and rides for lamp, rides in zip(result, on_rig, strict=True)):
            raise CameraError("expected a sun that is fixed, got one on a rig; set rig to false")
        if not finite_number(ambient) >= 0:
            raise CameraError(f"expected ambient to be 0 or more, got {shown(ambient)}")
        if exposure is not None:
            check_kind("exposure", exposure, Exposure, "an Exposure", CameraError)
        self.__dict__.update(
            lamps=result,
            places=matrices,
            names=words,
            rides=on_rig,
            ambient=float(ambient),
            exposure=exposure,
            notes=members("notes", notes, str, "texts", CameraError),
        )

    def __len__(self) -> int:
        return len(self.lamps)

    @property
    def has_range(self) -> bool:
        """True for lamps specified only by their range."""
        return self.lamps[0].range_m is not None

    @property
    def unit(self) -> str:
        """Unit of illuminances, "lx" or "W/m2"."""
        return UNITS[self.lamps[0].unit]

    @property
    def _units(self) -> dict[str, str]:
        """Units of thresholds of light."""
        return dict.fromkeys(("min_illuminance", "max_illuminance"), self.unit)

    def _check(self, thresholds: ReadByName) -> None:
        """Raise `ConfigError` for thresholds of light in another unit, or that nothing meets."""
        for name in self._units:
            check_unit(name, thresholds[name], self.unit)
        most = thresholds["max_illuminance"]
        if most is not None and not most > self.ambient:
            raise ConfigError(
                f"expected max_illuminance above the ambient {self.ambient:g} {self.unit}, got "
                f"{most:g}; increase it, or nothing is covered"
            )

    def _describe(self, row: int) -> ByName:
        """A lamp, ready for JSON: words, points in its frame, and the half angle of its cone."""
        lamp = self.lamps[row]
        return {
            "half_angle_deg": lamp.half_angle_deg,
            "words": f"{lamp.kind}, {lamp.strength}",
            "points": lamp.lamp_from_point[:, :3, 3].tolist(),
        }

    def _has_position(self, row: int) -> bool:
        """False for a sun."""
        return self.lamps[row].kind != SUN

    def _words(self, row: int, thresholds: ReadByName) -> str:
        """Intensity of a lamp, and the distance at which it is enough by itself."""
        lamp, least = self.lamps[row], thresholds["min_illuminance"]
        if lamp.kind == SUN:
            return lamp.strength
        whole = lamp.intensity_of_point * lamp.points
        reach = f", reaches {math.sqrt(whole / least):.3g} m" if least else ""
        across = f", {in_metres(max(lamp.size))} across" if any(lamp.size) else ""
        return f"{whole:.3g} {lamp.unit}{across}{reach}"

    @property
    def lamp_of_point(self) -> IntArray:
        """(K,) index of the lamp of each of the K points of all lamps."""
        return owners_of([lamp.points for lamp in self.lamps])

    @property
    def point_places(self) -> FloatArray:
        """(K, 4, 4) poses of the points of all lamps, in the frame of `places`."""
        of_lamps = zip(self.places, self.lamps, strict=True)
        return np.concatenate([place @ lamp.lamp_from_point for place, lamp in of_lamps])

    def _around(self, bounds: FloatArray) -> "Lamps":
        """The same with places of suns before a scene of bounds (2, 3), and rays around it."""
        if all(lamp.kind != SUN for lamp in self.lamps):
            return self
        width = WIDE * float(norm(np.ptp(bounds, axis=0)) or 1.0)
        lamps, places = list(self.lamps), self.places.copy()
        for row, lamp in enumerate(lamps):
            if lamp.kind == SUN:
                lamps[row] = replace(lamp, size=(width, 0.0))
                places[row, :3, 3] = bounds.mean(axis=0) - width / 2 * places[row, :3, 2]
        return replace(self, lamps=tuple(lamps), places=places)

    def _check_around(self, bounds: FloatArray) -> None:
        """Raise CameraError for bodies, in bounds (2, 3), that leave the rays of `_around`."""
        for lamp, place in zip(self.lamps, self.places, strict=True):
            middle = place[:3, 3] + lamp.size[0] / 2 * place[:3, 2]
            away = np.abs(bounds - middle).max()
            if lamp.kind == SUN and not away <= lamp.size[0] / 8:
                raise CameraError(
                    f"expected bodies within {lamp.size[0] / 8:.3g} m of the scene at rest "
                    "with a sun, got one farther away; leave out the sun"
                )

    def at(self, row: int, place: ArrayLike) -> "Lamps":
        """Copy with another pose, (4, 4), of the lamp with index `row`; raises as the class."""
        if finite_number(row) not in range(len(self)):
            raise CameraError(f"expected a lamp index from 0 to {len(self) - 1}, got {shown(row)}")
        given, places = valid_poses(place), self.places.copy()
        if len(given) != 1:
            raise PoseError(f"expected place to be one pose, got {len(given)}")
        places[int(row)] = given[0]
        return replace(self, places=places)

    def carried_by(self, cameras: Sequence[str]) -> BoolArray:
        """(N, C) mask of lamps that move with a camera, by its name: "camera" or "rig/camera".

        CameraError for a lamp on an unknown camera.
        """
        mask = np.zeros((len(self), len(cameras)), bool)
        for lamp, own in enumerate(self.rides):
            if own is True:
                mask[lamp] = True
            elif own:
                mask[lamp] = [name == own or name.startswith(f"{own}/") for name in cameras]
                if not mask[lamp].any():
                    raise CameraError(
                        f"expected lamp {shown(self.names[lamp])} to be mounted on one of "
                        f"{', '.join(map(shown, cameras[:8]))}, got {shown(own)}"
                    )
        return mask

    @cached_property
    def eyes(self) -> tuple[Camera, ...]:
        """For each lamp, a camera that sees what one of its points lights."""
        return tuple(lamp.eye for lamp in self.lamps)

    def to_json(self) -> ByName:
        """Entries, ready for JSON; `rastercov.load_lamps` reads them from a .json file."""
        return {
            "lamps": [lamp.to_json() for lamp in self.lamps],
            "places": self.places.tolist(),
            "names": list(self.names),
            "rides": list(self.rides),
            "ambient": self.ambient,
            **({} if self.exposure is None else {"exposure": asdict(self.exposure)}),
            **({"notes": list(self.notes)} if self.notes else {}),
        }

    def _to_gltf(self, _: object, nodes: list[ByName], roots: list[int]) -> ByName:
        """Add the points of lamps that are fixed in the cell to a glTF scene, as lights."""
        lights = []
        for place, row in zip(self.point_places, self.lamp_of_point.tolist(), strict=True):
            if not self.rides[row]:
                lamp = self.lamps[row]
                own = lamp.intensity_of_point, lamp.half_angle_deg, lamp.inner_angle_deg
                if lamp.kind == SUN:
                    own = own[0] / FAR**2, 0.0, None
                lights.append(GltfLight(self.names[row], place, *own))
        if not lights:
            return {}
        made, extension = scene_of(lights, len(nodes))
        roots.append(len(nodes))
        nodes += made
        return {"extensions": extension, "extensionsUsed": list(extension)}


def points_of(lamps: Lamps, chosen: BoolArray, world: FloatArray | None = None) -> Poses:
    """Poses of the points of some lamps, (N,) bool, of `Lamps.eyes`; in each of (R, 4, 4)."""
    own = chosen[lamps.lamp_of_point]
    places, lamp = lamps.point_places[own], lamps.lamp_of_point[own]
    if world is not None:
        places = (world[:, None] @ places[None]).reshape(-1, 4, 4)
        lamp = np.tile(lamp, len(world))
    return Poses.of(places, camera=lamp)


def intensities_of(lamp: Lamp, cosine: FloatArray, rays: FloatArray) -> FloatArray:
    """Intensities of a point of a lamp along rays, (N, 3) in its frame, in its unit.

    `cosine` is that of their angles to its axis, which is enough for lamps without planes.
    """
    if lamp.planes:
        shares = shares_of_planes(lamp.profile, lamp.planes, lamp.web, rays)
        return lamp.intensity_of_point * shares
    if lamp.profile:
        return lamp.intensity_of_point * shares_of(lamp.profile, cosine)
    if lamp.inner_angle_deg is not None:
        end, inner = (
            math.cos(math.radians(each)) for each in (lamp.half_angle_deg, lamp.inner_angle_deg)
        )
        share = np.clip((cosine - end) / max(LEAST_FALLOFF, inner - end), 0, 1)
        return lamp.intensity_of_point * share**2
    if lamp.exponent == 0:
        return np.full(cosine.shape, lamp.intensity_of_point)
    return lamp.intensity_of_point * np.maximum(cosine, 0.0) ** lamp.exponent


def bits_of(sets: IntArray, n: int) -> BoolArray:
    """(n, S) whether each of n points is in sets (S,), which are bits."""
    return (sets >> np.arange(n)[:, None]) & 1 > 0


def are_lit(lamps: Lamps, sees: BoolArray, lamp: WholeArray) -> BoolArray:
    """(N,) places that one lamp or more lights, from the points (K, N), of lamps (K,), they see."""
    counts = np.zeros((len(lamps), sees.shape[1]), np.int64)
    np.add.at(counts, lamp, sees)
    needed = np.array([each.points_needed for each in lamps.lamps])
    return np.asarray((counts >= needed[:, None]).any(axis=0))


def illuminances(
    lamps: Lamps, poses: Poses, sees: BoolArray, points: FloatArray, normals: FloatArray
) -> FloatArray:
    """(N,) illuminance of places with normals, (N, 3), by the points of lamps seen, (K, N).

    E = sum I(t) cos i / d^2, and the ambient light; on the side that each lamp is on.
    """
    result = np.full(len(points), lamps.ambient)
    placed = apparent(lamps.eyes, poses)
    for pose, row, own in zip(placed, poses.camera.tolist(), sees, strict=True):
        away = pose[:3, 3] - points
        d = np.maximum(norm(away), TINY)
        cosine = np.clip(-(away @ pose[:3, 2]) / d, -1, 1)
        height = np.abs(dots(away, normals))
        intensity = intensities_of(lamps.lamps[row], cosine, -(away @ pose[:3, :3]))
        with np.errstate(over="ignore"):
            result += np.where(own, intensity * height / d**3, 0.0)
    return result


def _check_alike(lamps: Sequence[Lamp]) -> None:
    """CameraError for lamps in different units, and for some with a range."""
    if len({lamp.unit for lamp in lamps}) > 1:
        raise CameraError(
            "expected lamps all in cd or all in W/sr, got both; convert one, since lx and W/m2 "
            "do not add up"
        )
    if len({lamp.range_m is None for lamp in lamps}) > 1:
        raise CameraError(
            "expected a range of all lamps or of none, got both; give the power in W/sr of all"
        )


def lamps_of_json(entries: ReadByName) -> Lamps:
    """Lamps of `Lamps.to_json`; CameraError for other entries."""
    try:
        more = {"exposure": Exposure(**entries["exposure"])} if "exposure" in entries else {}
        return Lamps(**{**entries, **more, "lamps": [Lamp(**each) for each in entries["lamps"]]})
    except (LookupError, TypeError, AttributeError):
        shape = "entries lamps, places, names, rides and ambient, as saved by place or the viewer"
        raise CameraError(f"expected {shape}, got {shown(entries)}; save them again") from None


def _check_profile(profile: object) -> Profile:
    """Profile as pairs of numbers."""
    pairs = members("profile", profile, (tuple, list), "pairs of angle and share", CameraError)
    result = tuple(
        (number("angle of a profile", angle), number("share of a profile", share))
        for angle, share in (two("profile", each) for each in pairs)
    )
    if result and not (
        are_angles(np.array(result)[:, 0])
        and all(0 <= share <= LARGEST_NUMBER for _, share in result)
    ):
        wanted = f"shares from 0 to {LARGEST_NUMBER:g}, of angles that {ASCEND}"
        raise CameraError(f"expected profile to have {wanted}, got other values; correct it")
    return result


def _check_planes(planes: object, n_angles: int) -> Planes:
    """Planes as numbers."""
    words = "an angle and shares each"
    rows = members("planes", planes, (tuple, list), words, CameraError)
    values = tuple(
        tuple(
            number("share of a plane", each)
            for each in members("plane", row, object, words, CameraError)
        )
        for row in rows
    )
    if values and not are_planes(values, n_angles):
        raise CameraError(
            "expected planes with angles that ascend to the first + 360, and a share from 0 to "
            f"{LARGEST_NUMBER:g} for each angle of the profile, got other values; correct them"
        )
    return values
