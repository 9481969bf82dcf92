"""Thresholds of coverage, and the decision whether a camera covers a face, (3.6).

    coverage = field of view * min(1, resolution) * focus * visibility, and ours: * incidence
               * pixel density, which are 1 within their limits and 0 beyond.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import math
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, fields, replace
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from annotated_types import Ge, Gt, Le
from typing_extensions import Doc

from rastercov.base import ByName, ConfigError, check_limits
from rastercov.core.camera import Camera
from rastercov.core.camera.exposure import Exposure
from rastercov.core.camera.light_units import GLOSS, LIGHT
from rastercov.core.coverage.criterion import Criterion
from rastercov.core.coverage.densities import PX_PER_M


class Rules(NamedTuple):
    """Thresholds of a task for one camera, as plain numbers for compiled loops.

    Those that a `Task` has keep their names. `z_n` and `z_f` are the depth of field, or for a lens
    that is sharp by distance the distances in focus; `max_incidence` is in radians, and the cosine
    and tangent of it are 0 where there is no limit, as are the densities.
    """

    min_pixels: float
    min_visibility: float
    min_coverage: float
    min_pixel_density: float
    min_facing_density: float
    min_pixels_per_m2: float
    z_n: float
    z_f: float
    max_incidence: float
    cos_incidence: float
    tan_incidence: float
    focus_of_centroid: bool
    cap_resolution: bool

    def in_units_of(self, scale: float) -> Self:
        """The same for a scene whose lengths are in units of `scale` metres."""
        return self._replace(
            z_n=self.z_n / scale,
            z_f=self.z_f / scale,
            min_pixel_density=self.min_pixel_density * scale,
            min_facing_density=self.min_facing_density * scale,
            min_pixels_per_m2=self.min_pixels_per_m2 * scale**2,
        )

    def without(self, reasons: Collection[str], camera: Camera) -> Self:
        """The same without the criteria of some reasons, by their names.

        With `STEEP` densities are judged at the largest angle of incidence that is allowed: those
        of a target that faces the camera, foreshortened by that angle.
        """
        changes: ByName = {}
        if STEEP in reasons and self.cos_incidence > 0:
            across = min(camera.fx, camera.fy) / math.sqrt(camera.fx * camera.fy)
            across = 1.0 if camera.is_curved else across
            least = (
                self.min_facing_density,
                self.min_pixel_density / self.cos_incidence,
                across * math.sqrt(self.min_pixels_per_m2 / self.cos_incidence),
            )
            changes |= dict.fromkeys(DENSITIES, 0.0) | {"min_facing_density": max(least)}
        if "too_coarse" in reasons:
            changes |= dict.fromkeys(DENSITIES, 0.0)
        if "out_of_focus" in reasons:
            changes |= {"z_n": 0.0, "z_f": math.inf}
        if "too_oblique" in reasons:
            changes |= {"max_incidence": math.pi / 2, "cos_incidence": 0.0, "tan_incidence": 0.0}
        return self._replace(**changes)


DENSITIES = ("min_pixel_density", "min_facing_density", "min_pixels_per_m2")
STEEP = "steep"
"""See `Rules.without`."""
Positive = Annotated[float, Gt(0)]
Share = Annotated[float, Ge(0), Le(1)]
Density = Annotated[float, Ge(0), PX_PER_M]


@dataclass(frozen=True, kw_only=True)
class Task(Criterion):
    """Thresholds that a point or a face must meet to be covered.

    By default a point is covered if one camera sees it in focus from the front of its face.
    `min_pixels`, `min_visibility`, `min_coverage`, `focus_rule` and `cap_resolution` apply to whole
    faces: if one of them is changed, results are by face. Numeric thresholds are also options of
    the command line, and all are keys of the [task] section of plan files. Numbers of equations are
    those of E. S. Eissa (2020), docs/appendix/equations.md.

    Parameters
    ----------
    min_pixels : float
        R_min of (3.8): number of pixels on a face that gives it a resolution of 1.
    min_visibility : float
        V_min: a face with a smaller visible fraction counts as occluded, [0, 1].
    max_blur : float, optional
        c of (3.10): largest diameter of the blur circle, pixels; the camera's own unless given.
    max_incidence_deg : float
        Maximum angle between the normal and the ray to the camera, degrees, (0, 90].
    min_pixel_density : float or str
        Minimum pixels per metre on the surface, in its worst direction; this and the next are a
        number in px/m, a string with a unit such as "0.25 px/mm", or the name of a level of EN or
        IEC 62676-4, such as "identify".
    min_facing_density : float or str
        Minimum pixels per metre of a target that faces the camera at the position of the surface,
        min(fx, fy) / z: at the deepest vertex of a face, or at each point by area.
    min_pixels_per_m2 : float
        Minimum pixels per square metre of the surface, fx fy h / z^3 with h the distance of the
        camera from the plane of the face: at its deepest vertex, or at each point by area.
    min_illuminance, max_illuminance : float or str
        Minimum and maximum illuminance, in the unit of the lamps, or a string such as "300 lx";
        only with lamps.
    max_highlight_deg : float or str
        Angle between the normal and the half vector of the rays to the camera and to a lamp, up to
        which the surface reflects the lamp and is not covered, degrees, [0, 90]; or "matt", "satin"
        or "polished". 0, the default, for no limit. Only with lamps.
    min_coverage : float
        A camera covers a face if its coverage is at least this and not 0, [0, 1].
    views : int
        Number of cameras that must cover a point or face (k of k-coverage).
    min_angle_deg : float
        Minimum angle between the rays to two of the cameras that cover a point or face, degrees,
        [0, 180]; above 0, at least two cameras are required.
    focus_rule : {"vertices", "centroid"}
        Points of a face that must be in focus: all vertices (Definition 1), or the centroid (3.12).
    cap_resolution : bool
        True if the resolution C_R enters the product (3.6) as min(1, C_R).

    Raises
    ------
    ConfigError
        For a value outside its limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> task = rc.Task(min_pixel_density=500, max_incidence_deg=60, views=2)  # px/m, degrees
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=0.6, count=12)
    >>> result = rc.evaluate(mesh, camera, poses, task)
    >>> [round(result.covered.share(n), 3) for n in (1, 2)]  # by one camera, by two
    [1.0, 0.997]
    """

    min_pixels: Annotated[
        Positive, Doc("Pixels on a face for a resolution score of 1 (R_min).")
    ] = 1.0
    min_visibility: Annotated[Share, Doc("Minimum visible share of a face, 0 to 1 (V_min).")] = 0.0
    max_blur: (
        Annotated[
            Positive, Doc("Maximum diameter of the blur circle, px; default: that of the camera.")
        ]
        | None
    ) = None
    max_incidence_deg: Annotated[
        float, Gt(0), Le(90), Doc("Maximum angle of incidence, deg from the normal.")
    ] = 90.0
    min_pixel_density: Annotated[
        Density,
        Doc("Minimum px/m on the surface in its worst direction, or a level of EN 62676-4."),
    ] = 0.0
    min_facing_density: Annotated[
        Density,
        Doc("Minimum px/m on a target facing the camera, or a level of EN 62676-4."),
    ] = 0.0
    min_pixels_per_m2: Annotated[
        float, Ge(0), Doc("Minimum pixels per square metre of the surface.")
    ] = 0.0
    min_illuminance: Annotated[
        float, Ge(0), LIGHT, Doc("Minimum illuminance, lx or W/m2 (needs lamps).")
    ] = 0.0
    max_illuminance: (
        Annotated[float, Gt(0), LIGHT, Doc("Maximum illuminance, lx or W/m2 (needs lamps).")] | None
    ) = None
    max_highlight_deg: Annotated[
        float,
        Ge(0),
        Le(90),
        GLOSS,
        Doc(
            "Largest angle between normal and half vector that counts as a highlight, deg, or "
            "matt, satin, polished; points in a highlight are not covered."
        ),
    ] = 0.0
    min_coverage: Annotated[
        Share, Doc("Coverage score from which a face counts as covered, 0 to 1.")
    ] = 0.5
    views: Annotated[
        int, Ge(1), Le(10_000), Doc("Required number of cameras per point or face.")
    ] = 1
    min_angle_deg: Annotated[
        float,
        Ge(0),
        Le(180),
        Doc("Minimum triangulation angle, between the rays to two cameras, deg."),
    ] = 0.0
    focus_rule: Annotated[
        Literal["vertices", "centroid"], Doc("Points of a face that must be in focus.")
    ] = "vertices"
    cap_resolution: Annotated[bool, Doc("Cap the resolution score at 1.")] = True

    def __post_init__(self) -> None:
        check_limits(self)
        if self.max_illuminance is not None and not self.max_illuminance > self.min_illuminance:
            raise ConfigError(
                f"expected max_illuminance above min_illuminance {self.min_illuminance:g}, got "
                f"{self.max_illuminance:g}; increase it"
            )

    def _without(self, names: Iterable[str]) -> Self:
        """The same with the defaults of some thresholds."""
        return replace(self, **{name: getattr(Task, name) for name in names})

    def _entries(self) -> dict[str, object]:
        """Thresholds by name; of criteria of the surface those that are asked."""
        return {
            name: value
            for name, value in asdict(self).items()
            if name not in OF_SURFACE or value != getattr(Task, name)
        }

    def exposed(self, exposure: Exposure | None, unit: str = "lx") -> Self:
        """Copy that is also limited to the illuminance band of an exposure, in "lx" or "W/m2".

        Unchanged for None; ConfigError if the band and the limits of the task do not overlap.
        """
        if exposure is None:
            return self
        least, most = exposure.band(unit)
        upper = most if self.max_illuminance is None else min(most, self.max_illuminance)
        lower = max(least, self.min_illuminance)
        return replace(self, min_illuminance=lower, max_illuminance=upper)

    @classmethod
    def thesis(cls, **changes: float | str | bool | None) -> Self:
        """Task by exactly (3.6) of Eissa (2020), with `changes` to its thresholds.

        The resolution is not capped, the centroid must be in focus, and any coverage counts.

        Examples
        --------
        >>> import rastercov as rc
        >>> task = rc.Task.thesis(max_incidence_deg=75)
        >>> task.max_incidence_deg, task.focus_rule
        (75.0, 'centroid')
        """
        return cls(**(THESIS | changes))

    def rules(self, camera: Camera) -> Rules:
        """Thresholds of this task for one camera, in the form of the compiled loops."""
        z_n, z_f = camera.depth_of_field(self.max_blur)
        angle = math.radians(self.max_incidence_deg)
        is_limited = self.max_incidence_deg < 90
        own = {
            name: float(getattr(self, name)) for name in Rules._fields if name.startswith("min_")
        }
        return Rules(
            **own,
            z_n=float(z_n),
            z_f=float(z_f),
            max_incidence=angle,
            cos_incidence=math.cos(angle) if is_limited else 0.0,
            tan_incidence=float(np.tan(angle)) if is_limited else 0.0,
            focus_of_centroid=self.focus_rule == "centroid",
            cap_resolution=self.cap_resolution,
        )


NEEDED: dict[str, str] = {
    "min_illuminance": "lamps",
    "max_illuminance": "lamps",
    "max_highlight_deg": "lamps",
}
"""Equipment of a rig that thresholds need."""
CRITERIA_OF_TASK = tuple(
    each for each in Task.__bases__ if each is not Criterion and issubclass(each, Criterion)
)
"""Criteria of the surface."""
OF_SURFACE = tuple(each.name for own in CRITERIA_OF_TASK for each in fields(own))
"""Thresholds of these."""
THESIS: ByName = {"cap_resolution": False, "focus_rule": "centroid", "min_coverage": 0.0}
"""Values of `Task.thesis`."""
