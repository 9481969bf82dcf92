"""Thresholds of coverage, and the decision whether a camera covers a face, (3.6).

    coverage = field of view * min(1, resolution) * focus * visibility, and ours: * incidence
               * pixel density, which are 1 within their limits and 0 beyond.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.

Reasons of faces, points and zones that are not covered, with the words and colour of each.

A reason is one criterion where meeting it alone would cover the point or
face, otherwise the fewest that must be met together, of any camera, all of which are named. From
behind a face, and of what lies behind a camera, no other criterion has a value: these reasons are
of one criterion.

Faces that fail criteria of the surface itself, see `rastercov.core.coverage.criterion`.

Choice of the engine that measures visibility: method, device, samples and threads.

The text form is METHOD[:DEVICE][@S], such as `certified`, `sampled:cpu` or `sampled:egl:0@4`. It is
accepted wherever `method` is, in Python and on the command line.

Pixel densities by the names of the standards, and as text with a unit.

EN 62676-4. Video surveillance systems for use in security applications - Part 4: Application
guidelines. 2015 (of IEC 62676-4:2014).
IEC 62676-4. Video surveillance systems for use in security applications - Part 4: Application
guidelines. 2025.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from enum import IntEnum
from hashlib import sha256
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray
from typing_extensions import Doc

from rastercov.base import (
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    IntArray,
    WholeArray,
    check_choice,
    check_kind,
    check_limits,
    cos,
    errors_as,
    finite_number,
    hooks_of,
    shown,
    tan,
    thread_count,
)
from rastercov.base.arguments import Reads, ray_angle
from rastercov.base.format import number
from rastercov.base.typed import typed
from rastercov.core.camera import Camera, Cameras, Rig, cameras_of, equipment_on, names_of
from rastercov.core.camera.exposure import GLOSS, LIGHT, Exposure
from rastercov.core.coverage.criterion import Criterion, Wording, Words
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import list_names
from rastercov.core.raster.contract import BACKENDS, MAX_SUPERSAMPLE

EDITIONS = {
    "EN 62676-4:2015": {
        "monitor": 12.5,
        "detect": 25.0,
        "observe": 62.5,
        "recognise": 125.0,
        "identify": 250.0,
        "inspect": 1000.0,
    },
    "IEC 62676-4:2025": {
        "overview": 20.0,
        "outline": 40.0,
        "discern": 80.0,
        "perceive": 125.0,
        "characterise": 250.0,
        "validate": 500.0,
        "scrutinise": 1500.0,
    },
}
"""Least pixels per metre of each level, on a target that faces the camera; names differ."""
_AMERICAN = ("recognize", "characterize", "scrutinize")
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "in": 0.0254}
"""Metres in the unit of "px/UNIT"."""
LEVELS = {name: value for levels in EDITIONS.values() for name, value in levels.items()}
"""Pixels per metre of every level."""
DORI_EDITION = "EN 62676-4:2015"
DORI = {
    name: EDITIONS[DORI_EDITION][name] for name in ("detect", "observe", "recognise", "identify")
}
"""Levels for camera plans: in legends of images, and offered as thresholds."""
_BY_NAME = LEVELS | {name: LEVELS[name.replace("ize", "ise")] for name in _AMERICAN}
_QUANTITY = re.compile(r"([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)\s*(?:px\s*/\s*(\w+))?")


def pixels_per_metre(text: str) -> float:
    """Pixels per metre of a level of `EDITIONS`, or of text such as "250 px/m" or "0.25 px/mm".

    Raises
    ------
    ValueError
        For other text; the message names similar levels.
    """
    words = text.strip().lower()
    if words in _BY_NAME:
        return _BY_NAME[words]
    result = _QUANTITY.fullmatch(words)
    try:
        if result and (result[2] or "m") in _LENGTHS:
            return float(result[1]) / _LENGTHS[result[2] or "m"]
    except ValueError:  # several points
        pass
    raise ValueError(
        f"px/{', px/'.join(_LENGTHS)} or a level, got {shown(text)}; levels: "
        f"{list_names(LEVELS, words)}"
    )


PX_PER_M = Reads(pixels_per_metre, tuple(_BY_NAME), _QUANTITY.pattern, "PX/M|NAME")
"""Metadata of a field that is a density, px/m."""


def density_text(value: float, unit: str = "px/m", beside: float = 0.0) -> str:
    """A density, or another figure with a unit, as text: "1.3 px/mm".

    It is in the unit of the larger of it and one `beside` it.
    """
    for power, name in ((1, "px/m"), (2, "px/m²")):
        if unit == name and max(value, beside) >= 10 ** (3 * power):
            value, unit = value / 10 ** (3 * power), name.replace("/m", "/mm")
    return f"{number(value)} {unit}"


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
        at the deepest vertex of a face, or at each point by area: min(fx, fy) / z of pinholes, the
        least singular value of the image's derivative of other lenses.
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
        0 or [0.001, 180]; above 0, at least two cameras are required.
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
        ray_angle("min_angle_deg", self.min_angle_deg)
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
            cos_incidence=cos(angle) if is_limited else 0.0,
            tan_incidence=tan(angle) if is_limited else 0.0,
            focus_of_centroid=self.focus_rule == "centroid",
            cap_resolution=self.cap_resolution,
        )


NEEDED: dict[str, str] = {
    "min_illuminance": "lamps",
    "max_illuminance": "lamps",
    "max_highlight_deg": "lamps",
}
"""Equipment of a rig that thresholds need."""


def rules_of(cameras: Cameras, task: Task) -> list[tuple[Camera, Task, Rules]]:
    """Each camera with its thresholds, also in the form of the compiled loops.

    ConfigError as of `check_equipment` and `tasks_of`.
    """
    check_equipment(cameras, task)
    pairs = zip(cameras_of(cameras), tasks_of(cameras, task), strict=True)
    return [(each, own, own.rules(each)) for each, own in pairs]


def check_equipment(cameras: Cameras, task: Task) -> None:
    """Raise `ConfigError` for thresholds that do not go with the equipment of cameras."""
    own = equipment_on(cameras)
    for name, word in NEEDED.items():
        if word not in own and getattr(task, name):
            raise ConfigError(f"expected {word} for {name}, got none; give {word}, or leave it out")
    for each in own.values():
        each._check(vars(task))


def tasks_of(cameras: Cameras, task: Task) -> tuple[Task, ...]:
    """Thresholds of each camera: its own if its rig has some, otherwise those of the task.

    Raises
    ------
    ConfigError
        For invalid thresholds, and for a number of views, which does not apply to one camera.
    """
    own = cameras.tasks if isinstance(cameras, Rig) else {}
    if not own:
        return (task,) * len(cameras_of(cameras))
    table = {}
    for name, given in own.items():
        if not isinstance(given, Task | Mapping):
            raise ConfigError(
                f"tasks of a rig: expected a Task of {shown(name)}, got {shown(given)}; give one"
            )
        with errors_as(ConfigError, f"tasks of a rig: {shown(name)}", (ConfigError, TypeError)):
            table[name] = given if isinstance(given, Task) else Task(**given)
        if table[name].views > 1 or table[name].min_angle_deg > 0:
            raise ConfigError(
                f"tasks of a rig: expected one view of {shown(name)}, got more or an angle; leave "
                "it out"
            )
        for each in NEEDED:
            if getattr(table[name], each):
                raise ConfigError(
                    f"tasks of a rig: expected no {each} of {shown(name)}, got some; give it for "
                    "all"
                )
    return tuple(table.get(name, task) for name in names_of(cameras))


CRITERIA_OF_TASK = tuple(
    each for each in Task.__bases__ if each is not Criterion and issubclass(each, Criterion)
)
"""Criteria of the surface."""
OF_SURFACE = tuple(each.name for own in CRITERIA_OF_TASK for each in fields(own))
"""Thresholds of these."""
THESIS: ByName = {"cap_resolution": False, "focus_rule": "centroid", "min_coverage": 0.0}
"""Values of `Task.thesis`."""


class _Several(IntEnum):
    """Numbers of which some are rows of several reasons, with their names."""

    @classmethod
    def _combine(cls, value: object) -> "_Several | None":
        """Member for several reasons."""
        if not isinstance(value, int | np.integer) or value not in range(
            FIRST_OF_SEVERAL, len(ROWS)
        ):
            return None
        made = int.__new__(cls, int(value))
        made._name_, made._value_ = ROWS[value].upper(), int(value)
        return made

    _missing_ = _combine


class Reason(_Several):
    """Criterion that a face fails; COVERED if it fails none.

    Where it fails several, its number is that of a row of `rastercov.core.coverage.task.NAMES`
    such as "too_oblique+occluded", and `Reason(number)` has this name. Criteria after one from
    BACK_FACING to UNSAMPLED, but OUT_OF_FOCUS, are not asked.

    A face is DEGENERATE if it has no area, BACK_FACING if the camera is behind it, OUTSIDE if a
    vertex, or of lenses with distortion a point of an edge, is outside the image or nearer than the
    near plane, OUT_OF_FOCUS if it is not within the depth of field, UNSAMPLED if it is in view but
    no sample hits it, TOO_COARSE if it has too few pixels, or too few per metre, OCCLUDED if too
    much of it is occluded, and TOO_OBLIQUE if its angle of incidence is too large.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> int((result.reason == rc.Reason.BACK_FACING).sum())  # of 12 faces
    10
    >>> rc.Reason(result.reason[0, 2]).name
    'COVERED'
    """

    DEGENERATE = 0
    """The face has no area."""
    BACK_FACING = 1
    """The camera is behind it."""
    OUTSIDE = 2
    """A vertex, or with distortion an edge, leaves the image or is nearer than the near plane."""
    OUT_OF_FOCUS = 3
    """It is not within the depth of field."""
    UNSAMPLED = 4
    """It is in view, but no sample hits it, or its image is within rounding error; its visibility
    is unknown."""
    TOO_COARSE = 5
    """Too few pixels, or too few per metre."""
    OCCLUDED = 6
    """Too much of it is occluded."""
    TOO_OBLIQUE = 7
    """Its angle of incidence is too large."""
    COVERED = 8
    """Every criterion holds."""


FIRST_OF_SEVERAL = Reason.COVERED + 1
TOGETHER = ("outside", "out_of_focus", "too_coarse", "occluded", "too_oblique")
"""Reasons of which a camera may have several; the bits of a row of several are in this order."""
SETS = sorted(
    (bits for bits in range(1 << len(TOGETHER)) if bits.bit_count() > 1),
    key=lambda bits: (-bits.bit_count(), bits),
)
"""Bits of the rows from `FIRST_OF_SEVERAL` on: the more criteria fail, the earlier."""
BETWEEN = "+"


class _Reasons(dict[str, Words]):
    """Words by the name of a reason; those of several reasons are made of theirs."""

    def __missing__(self, name: str) -> Words:
        names = name.split(BETWEEN)
        if len(names) < 2:
            raise KeyError(name)
        every = [self[each] for each in names]
        labels, sentences = [each.label for each in every], [each.sentence for each in every]
        advice = "no one change helps: another camera must meet all of these criteria"
        bits = sum(1 << TOGETHER.index(each) for each in names if each in TOGETHER)
        return Words(
            _text_list(labels),
            _text_list(sentences),
            advice,
            every[0].colour,
            bits or every[0].hatch,
        )


def _text_list(texts: list[str]) -> str:
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


OF_CAMERA = {
    "degenerate": Words(
        "zero area", "have zero area", "a face of zero area cannot be covered", (84, 96, 100), 10
    ),
    "back_facing": Words(
        "back-facing",
        "are back-facing",
        "move the camera to the front of the face",
        (136, 84, 164),
        1,
    ),
    "outside": Words(
        "outside the image",
        "are not fully in the image",
        "rotate the camera towards it{wider}",
        (0, 114, 178),
        4,
    ),
    "out_of_focus": Words(
        "out of focus",
        "are out of focus",
        "its depth is {depth}, the depth of field {in_focus}: refocus or move the camera",
        (86, 180, 233),
        8,
    ),
    "unsampled": Words(
        "below sampling resolution",
        "are below the sampling resolution",
        "move the camera closer",
        (120, 94, 60),
        5,
    ),
    "too_coarse": Words(
        "resolution too low",
        "have too low a resolution",
        "{found} at {distance}; {wanted} needs a distance of {nearer} or {times} the focal length",
        (240, 160, 0),
        2,
    ),
    "occluded": Words(
        "occluded",
        "are occluded",
        "move the camera so that {hider} no longer blocks the view",
        (214, 39, 40),
        3,
    ),
    "too_oblique": Words(
        "too oblique",
        "are too oblique",
        "incidence {angle}°, at most {max_angle}° allowed: move the camera closer to the face "
        "normal",
        (0, 158, 115),
        12,
    ),
    "covered": Words("covered", "are covered", "", (214, 220, 226)),
}
"""Words of the members of `Reason`."""
REASONS: dict[str, Words] = _Reasons(OF_CAMERA)
for _bits in SETS:
    _names = [each for at, each in enumerate(TOGETHER) if _bits >> at & 1]
    _name = BETWEEN.join(reversed(_names))  # the last criterion first
    REASONS[_name] = REASONS[_name]
REASONS |= {
    "too_few_views": Words(
        "too few cameras",
        "are covered by too few cameras",
        "add cameras that see this surface",
        (230, 120, 180),
        6,
    ),
    "no_cameras": Words(
        "no cameras",
        "have no camera",
        "add a camera; if no candidate covers it, check unit, camera and thresholds",
        (218, 198, 176),
        9,
    ),
    "baseline": Words(
        "ray angle out of range",
        "have a ray angle out of range",
        "change the baseline of the rig or its distance",
        (150, 160, 60),
        7,
    ),
    "uncertain": Words(
        "too uncertain",
        "are too uncertain",
        "widen the baseline of the rig, move it closer, or use more pixels",
        (130, 20, 20),
        17,
    ),
    "unseeable": Words(
        "not visible from anywhere (proved)",
        "are not visible from anywhere (proved)",
        "it lies inside a body or touches another: exclude it from the evaluation",
        (150, 150, 158),
        16,
    ),
}
"""By the name of the reason: the members of `Reason`, in their order, several of these together,
those of networks, and those of features."""
OF_FEATURES: dict[str, Words] = {}
WORDINGS = (*hooks_of(Wording), *(each._wording for each in CRITERIA_OF_TASK))
"""Words of features, and of criteria of the surface."""
for _each in WORDINGS:
    OF_FEATURES |= _each.reasons
REASONS |= OF_FEATURES
NAMES = tuple(REASONS)
TOO_FEW_VIEWS, NO_CAMERAS = NAMES.index("too_few_views"), NAMES.index("no_cameras")
BASELINE, UNCERTAIN = NAMES.index("baseline"), NAMES.index("uncertain")
"""Rows of the reasons of a network, and of a rig with a rule."""
UNSEEABLE = NAMES.index("unseeable")
ROWS = NAMES
CRITERIA = (*map(NAMES.index, TOGETHER), BASELINE, UNCERTAIN, *map(NAMES.index, OF_FEATURES))
"""Rows of the reasons that are criteria, in the order in which they are asked; that of the surface
itself is one of those of features."""
SEVERAL = 1 << 31
"""Bit of the code of several reasons without a row of their own; lower bits are of `CRITERIA`."""
BITS = np.zeros(256, np.uint32)
"""Bits of the criteria of each row, 0 for the others."""
for _at, _row in enumerate(CRITERIA):
    BITS[_row] = 1 << _at
for _at, _bits in enumerate(SETS):
    BITS[FIRST_OF_SEVERAL + _at] = _bits
ROW_OF = {int(bits): row for row, bits in enumerate(BITS.tolist()) if bits}


def nearness(rows: WholeArray) -> IntArray:
    """Ranks of reasons by how near a camera with them is to covering: the more, the nearer."""
    from rastercov.engine import area_rule as kernels

    result, given = np.empty(rows.shape, np.int64), np.ascontiguousarray(rows, np.uint8)
    kernels.rank_reasons(given.ravel(), result.ravel())
    return result


def nearer(one: ByteArray, other: ByteArray) -> ByteArray:
    """Of two cameras the row of the one that is nearer to covering, (N,)."""
    return np.where(nearness(one) >= nearness(other), one, other)


def code_of(rows: Iterable[int]) -> int:
    """Code of reasons, rows of `REASONS`: a row where there is one of them together."""
    every = list(rows)
    bits = int(np.bitwise_or.reduce(BITS[every]))
    return every[0] if len(every) == 1 else ROW_OF.get(bits, SEVERAL | bits)


def bits_of(code: int) -> int:
    """Bits of the criteria of a code, in the order of `CRITERIA`."""
    return code & ~SEVERAL if code & SEVERAL else int(BITS[code])


def rows_in(code: int) -> tuple[int, ...]:
    """Rows of the single reasons of a code, the last criterion first."""
    bits = bits_of(code)
    values = tuple(row for at, row in enumerate(CRITERIA) if bits >> at & 1)
    return values[::-1] or (code,)


def name_of(code: int) -> str:
    """Name of the reasons of a code."""
    return BETWEEN.join(NAMES[row] for row in rows_in(code))


def leads(codes: WholeArray) -> ByteArray:
    """Row of each code, by which pictures have colours: that of the last criterion of several."""
    every, own = np.unique(codes, return_inverse=True)
    rows = [code if code < len(NAMES) else rows_in(code)[0] for code in every.tolist()]
    return np.array(rows, np.uint8)[own]


def reason_rows(reason: ByteArray, covered: BoolArray, n_cameras: int) -> ByteArray:
    """(F,) row of `REASONS` of each face of a network.

    Parameters
    ----------
    reason : (F,) uint8
        `Reason` of the camera that comes nearest to covering the face.
    covered : (F,) bool
        Faces that enough cameras cover.
    n_cameras : int
        Cameras of the network.
    """
    if not n_cameras:
        return np.full(len(reason), NO_CAMERAS, np.uint8)
    rows = np.where(reason == Reason.COVERED, np.uint8(TOO_FEW_VIEWS), reason)
    rows[covered] = Reason.COVERED
    return rows


CONDITIONS = {"the angle between rays": "baseline", "the uncertainty": "uncertain"}
"""Conditions that fail of a rig with a rule where no device does, and the reason of each."""


def fails(device: str, reason: str = "") -> str:
    """Words on a sensor, one of `CONDITIONS`, or a lamp, for which something is not covered.

    The reason is of what is not; those of features name lamps.
    """
    if device in CONDITIONS:
        return REASONS[CONDITIONS[device]].label
    return f"nearest or reflected lamp: {device}" if reason in OF_FEATURES else f"{device} fails"


OWN_CRITERIA = {name: each._fails for each in CRITERIA_OF_TASK for name in each._wording.reasons}
"""Functions of a task and a mesh for the faces that fail, by the name of their reason."""


def own_reasons(mesh: Mesh, task: Task | None = None) -> NDArray[np.uint8]:
    """(F,) row of `REASONS` of each face: `DEGENERATE`, the criterion it fails, or `COVERED`."""
    result = np.where(mesh.degenerate_mask, np.uint8(Reason.DEGENERATE), np.uint8(Reason.COVERED))
    if task is not None:
        for name, fails in OWN_CRITERIA.items():
            result[(result == Reason.COVERED) & fails(task, mesh)] = NAMES.index(name)
    return result


def key_of(mesh: Mesh, tasks: Collection[Task]) -> bytes:
    """Bytes that differ where faces fail other criteria of the surface; none where none fails."""
    plain, result = own_reasons(mesh), [own_reasons(mesh, each) for each in dict.fromkeys(tasks)]
    return b"".join(sha256(own.tobytes()).digest() for own in result if (own != plain).any())


METHODS = ("certified", "exact", "sampled")


@dataclass(frozen=True)
class Engine:
    """Method of visibility and the device that computes it.

    Parameters
    ----------
    method : {"certified", "exact", "sampled"}
        Method, see `rastercov.open_observer`.
    device : str
        Device for method "sampled" and for pictures: "auto", "cpu", "gl", "hardware" (a GPU),
        or the name of an OpenGL device (`rastercov doctor` lists them).
    supersample : int
        S, for method "sampled": S x S samples per pixel, from 1 to 64.
    threads : int, optional
        Number of threads on the CPU; one per core unless given.

    Raises
    ------
    ConfigError
        For an unknown method, or supersampling with a method that does not sample.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=0.6, count=6)
    >>> sampled = rc.Engine("sampled", device="cpu", supersample=2)
    >>> result = rc.evaluate(mesh, camera, poses, method=sampled)
    >>> result.by, result.engine.supersample
    ('face', 2)
    """

    method: str = "certified"
    device: str = "auto"
    supersample: int = 1
    threads: int | None = None

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_kind("device", self.device, str, "a string", ConfigError)
        scale = finite_number(self.supersample)
        if self.method != "sampled" and scale != 1:
            raise ConfigError(
                f"expected supersample 1 with method {self.method}, got {shown(self.supersample)}; "
                "use method sampled"
            )
        if scale not in range(1, MAX_SUPERSAMPLE + 1):
            raise ConfigError(
                f"expected supersample from 1 to {MAX_SUPERSAMPLE}, got {shown(self.supersample)}; "
                "give a whole number"
            )
        object.__setattr__(self, "supersample", int(scale))
        if self.threads is not None:
            object.__setattr__(self, "threads", thread_count(self.threads))

    @classmethod
    @typed
    def parse(cls, text: str) -> Self:
        """Engine from text of the form METHOD[:DEVICE][@S], such as "sampled:egl:0@4".

        Raises
        ------
        ConfigError
            For another form, an unknown method, or supersampling with a method that does not
            sample.
        """
        form = re.fullmatch(r"(\w*)(?::([^@]+))?(?:@([0-9]{1,9}))?", text, re.ASCII)
        if form is None:
            raise ConfigError(
                f"expected a method such as sampled:cpu@4, got {shown(text)}; correct it"
            )
        method, device, scale = form.groups()
        return cls(method, device or "auto", int(scale or 1))

    @classmethod
    def of(cls, method: "str | Engine", threads: int | None = None) -> "Engine":
        """Engine from an `Engine`, a method, or the text form, with `threads` if given."""
        if isinstance(method, Engine):
            engine = method
        elif isinstance(method, str) and (":" in method or "@" in method):
            engine = cls.parse(method)
        else:
            engine = cls(method)
        return engine if threads is None else replace(engine, threads=threads)

    def __str__(self) -> str:
        device = f":{self.device}" if self.device != "auto" else ""
        return self.method + device + (f"@{self.supersample}" if self.supersample > 1 else "")

    @property
    def rasterizer_options(self) -> ByName:
        """Keyword arguments of `open_rasterizer` for the device, and the threads of the CPU."""
        if self.device not in BACKENDS:
            return {"backend": "gl", "device": self.device}
        has_threads = self.threads is not None and self.device != "gl"
        return {"backend": self.device} | ({"threads": self.threads} if has_threads else {})
