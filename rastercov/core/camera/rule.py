"""Rules of a rig: the devices that must see a point together before the rig covers it.

A stereo head is `All` of two cameras, a fringe sensor `All` of a camera and a projector, or
`AtLeast(2, needs=["projector"])` of two cameras and a projector. Devices that count together are on
one side of the face. `Limited` is a rule whose devices are counted.

Cameras that count together: what of a rig is covered where k of n of them see it.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any as Anything
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    LARGEST_COORDINATE,
    BoolArray,
    ByteArray,
    CameraError,
    FloatArray,
    finite_number,
    first_of,
    shown,
    tan,
)
from rastercov.base.arguments import LEAST_RAY_ANGLE, ray_angle
from rastercov.base.format import size_in_words
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.parallel import FAR


class RigRule(NamedTuple):
    """A rule with its limits for kernels, `area/rule.hpp`: n marks, angles, metres and radians."""

    k: int
    needs: ByteArray
    stripes: ByteArray
    least_deg: float
    most_deg: float
    most_deviation: float
    noise: FloatArray


@dataclass(frozen=True)
class Gate:
    """Devices that count together: k of n of them, and those of `needs` among these.

    A feature derives from it gates that ask for more, as the functions at the end say.

    Attributes
    ----------
    n, k : int
    needs : tuple of int
        In ascending order.
    """

    n: int
    k: int
    needs: tuple[int, ...] = ()

    def in_words(self, names: Sequence[str]) -> str:
        """Sentence on what is measured, with the names of the devices."""
        if self.k == self.n:
            said = [f"{' and '.join(names)} see it"]
        else:
            needed = " and ".join(names[row] for row in self.needs)
            said = [f"{self.k} of {', '.join(names)} see it"]
            said += [f"{needed} among them"] if needed else []
        return f"A point is measured if {', '.join((*said, *self.further()))}."

    def holds(self, sees: BoolArray) -> BoolArray:
        """(...) whether it holds where each of the devices sees, (n, ...)."""
        mask: BoolArray = np.count_nonzero(sees, axis=0) >= self.k
        return mask & sees[list(self.needs)].all(axis=0)

    def without(self, device: int) -> "Gate":
        """The same where a device sees everything: that of the others, with k = 0 where it is all.

        Numbers of devices are as before, of which the caller leaves out this one.
        """
        needs = tuple(row for row in self.needs if row != device)
        return replace(self, k=max(self.k - 1, len(needs)), needs=needs)

    def _for_kernels(self) -> RigRule:
        """The rule for kernels."""
        return RigRule(
            self.k, self._marks(self.needs), self._marks(()), 0.0, 180.0, 0.0, np.zeros(0)
        )

    def _marks(self, devices: Sequence[int]) -> ByteArray:
        """(n,) 1 for some devices."""
        return np.isin(np.arange(self.n), devices).astype(np.uint8)

    def further(self) -> list[str]:
        """Words on what it asks for beside the count."""
        return []

    @property
    def modes(self) -> tuple[str, ...]:
        """Modes of `rastercov.report.modes` that it has values of."""
        return ()

    @property
    def unproved(self) -> str:
        """Refusal where nothing is known of it with installation errors."""
        return ""

    def off_by(self, degrees: float) -> "Gate":
        """The same with limits of angles that hold for all changes, or for some if below 0."""
        return self

    def with_camera(self, device: int, before: Camera, after: Camera) -> "Gate":
        """The same with another camera of a device."""
        return self


MOST_DEVICES = 64
"""Devices of a rig with a rule."""
SHORTEST_LIMIT = 1e-30
"""Metres, of max_uncertainty."""
NOISE_PX = 1e-6, 1e6
"""Least and largest noise; with them no information overflows, which would be halved to the end."""


@dataclass(frozen=True)
class Any:
    """Any camera suffices: a rig covers what at least one of its cameras covers.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> pair = rc.Rig([camera, camera], ["front", "back"], rule=rc.Any())
    >>> poses = rc.look_at([(0, 0, 0.6), (0, 0, -0.6)], (0, 0, 0))
    >>> placed = rc.Poses.of(poses, camera=[0, 1])
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> round(rc.evaluate(mesh, pair, placed).covered.share(), 3)  # two sides of six
    0.333
    """


@dataclass(frozen=True)
class All:
    """All sensors must see the point: stereo, fringe projection, time of flight.

    Parameters
    ----------
    min_baseline_deg : float
        Minimum angle between the rays from a point to at least one pair of sensors, 0 or
        [0.001, 180]: below it depth is uncertain.
    max_baseline_deg : float
        Maximum angle between the rays to any pair, as that: above it images cannot be matched.
    max_uncertainty : float
        Largest standard deviation of the point in its worst direction, metres; see
        `rastercov.Uncertainty`.
    noise_px : float, or mapping of str to float
        Standard deviation of image positions, px, required with `max_uncertainty`: one for all
        sensors, or one for each by name.
    stripes : sequence of str
        Names of sensors that measure only one image coordinate, x: projectors of stripes along y,
        lasers with a sheet along y; the others measure both.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> rule = rc.All(min_baseline_deg=5)
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> right = rc.look_at((0.1, 0, 0), (0.1, 0, 1), up=(0, -1, 0))[0]
    >>> stereo = rc.Rig([camera, camera], ["left", "right"], [np.eye(4), right], rule=rule)
    >>> poses = stereo.poses(rc.look_at((-0.05, 0, 0.6), (-0.05, 0, 0), up=(0, 1, 0)))
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> round(rc.evaluate(mesh, stereo, poses).covered.share(), 3)  # the top, of six sides
    0.167
    """

    min_baseline_deg: float = 0.0
    max_baseline_deg: float = 180.0
    max_uncertainty: float = math.inf
    noise_px: float | Mapping[str, float] = 0.0
    stripes: Sequence[str] = ()


@dataclass(frozen=True)
class AtLeast:
    """At least k of the sensors must see the point.

    Parameters
    ----------
    k : int
        Minimum number of sensors that see the point, including all of `needs`.
    needs : sequence of str
        Names of sensors without which nothing is measured, such as the projector.

    Examples
    --------
    >>> import rastercov as rc
    >>> rule = rc.AtLeast(2, needs=["projector"])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> names = ["left", "projector", "right"]
    >>> places = [rc.look_at((x, 0, 0), (x, 0, 1), up=(0, -1, 0))[0] for x in (-0.1, 0, 0.1)]
    >>> head = rc.Rig([camera] * 3, names, places, rule=rule)
    >>> poses = head.poses(rc.look_at((0.3, 0, 0.6), (0.3, 0, 0), up=(0, 1, 0)))
    >>> result = rc.evaluate(rc.shapes.box((0.2, 0.2, 0.2)), head, poses)
    >>> round(result.covered.share(), 3)  # of the area of the box
    0.241
    """

    k: int
    needs: Sequence[str] = ()


Rule = Any | All | AtLeast
"""Rule of a rig."""


@dataclass(frozen=True)
class Limited(Gate):
    """Gate with limits of the angle between rays, and of the uncertainty of a point.

    Attributes
    ----------
    least_deg, most_deg : float
        Limits of the angle between rays, see `All`.
    most_deviation : float
        Limit of the standard deviation of a point, metres; 0 for none.
    noise : tuple of float
        Of each device, radians, where that is limited.
    stripes : tuple of int
        Devices that know one coordinate of the image.
    """

    least_deg: float = 0.0
    most_deg: float = 180.0
    most_deviation: float = 0.0
    noise: tuple[float, ...] = ()
    stripes: tuple[int, ...] = ()

    @property
    def has_baseline(self) -> bool:
        """True where the angle between rays is limited."""
        return self.least_deg > 0 or self.most_deg < 180

    @property
    def has_deviation(self) -> bool:
        """True where the standard deviation of a point is limited."""
        return self.most_deviation > 0

    def _for_kernels(self) -> RigRule:
        """See `Gate`."""
        angles, noise = (self.least_deg, self.most_deg), np.array(self.noise, np.float64)
        marks = self._marks(self.needs), self._marks(self.stripes)
        return RigRule(self.k, *marks, *angles, self.most_deviation, noise)

    def further(self) -> list[str]:
        """See `Gate`."""
        said = []
        if self.has_baseline:
            to = f" to {self.most_deg:g}°" if self.most_deg < 180 else "° or more"
            said.append(f"along rays {self.least_deg:g}{to} apart")
        if self.has_deviation:
            said.append(f"with an uncertainty of at most {size_in_words(self.most_deviation)}")
        return said

    @property
    def modes(self) -> tuple[str, ...]:
        """See `Gate`."""
        return ("uncertainty",) if self.has_deviation else ()

    @property
    def unproved(self) -> str:
        """See `Gate`."""
        wanted = "expected no max_uncertainty with installation errors, got one"
        return f"{wanted}; use min_baseline_deg" if self.has_deviation else ""

    def off_by(self, degrees: float) -> "Limited":
        """See `Gate`."""
        least = min(self.least_deg + degrees, 180.0) if self.least_deg > 0 else 0.0
        least = least if least >= LEAST_RAY_ANGLE else 0.0
        most = min(self.most_deg - degrees, 180.0) if self.most_deg < 180 else 180.0
        most = max(most, LEAST_RAY_ANGLE) if degrees < 0 else most
        if most < LEAST_RAY_ANGLE:
            # No angle is small enough, not even that of two sensors at one place.
            least, most = 180.0, 0.0
        return replace(self, least_deg=least, most_deg=most)

    def with_camera(self, device: int, before: Camera, after: Camera) -> "Limited":
        """See `Gate`: the noise stays in pixels."""
        noise = list(self.noise)
        if noise:
            scales = [pixels_a_radian(each, device in self.stripes) for each in (before, after)]
            noise[device] = noise[device] * scales[0] / scales[1]
        return replace(self, noise=tuple(noise))


def limits_of(gates: Iterable[Gate]) -> list[Limited]:
    """Gates of rules among others."""
    return [each for each in gates if isinstance(each, Limited)]


def pixels_a_radian(camera: Camera, is_striped: bool) -> float:
    """Pixels per radian on the axis of a camera, the fewer of x and y; of x alone for stripes.

    At the point that a parallel camera sees from, see `eyes_of`.
    """
    slope, first = 1.0, next(iter(camera.distortion), 0.0)
    if camera.model in ("omni", "double_sphere"):
        slope = 1 / (1 + first)
    elif camera.model == "fov" and first > 0:
        slope = 2 * tan(first / 2) / first
    focal = camera.fx if is_striped else min(camera.fx, camera.fy)
    return focal * slope * (FAR if camera.is_parallel else 1.0)


def gate_of(rule: Anything, names: Sequence[str], cameras: Sequence[Camera]) -> Limited | None:
    """Gate of a rule for devices and their names; None where each camera counts by itself.

    Raises
    ------
    CameraError
        For no rule, and for one that these devices cannot meet.
    """
    if isinstance(rule, Any):
        return None
    if not isinstance(rule, All | AtLeast):
        raise CameraError(f"expected rule to be Any(), All() or AtLeast(k), got {shown(rule)}")
    n, known = len(names), first_of(list(map(shown, names)), 8)
    if not 2 <= n <= MOST_DEVICES:
        raise CameraError(f"expected 2 to {MOST_DEVICES} sensors for a rule, got {n}: {known}")
    if isinstance(rule, All):
        least = ray_angle("min_baseline_deg", rule.min_baseline_deg, CameraError)
        most = ray_angle("max_baseline_deg", rule.max_baseline_deg, CameraError)
        if least > most:
            raise CameraError(
                f"expected min_baseline_deg <= max_baseline_deg <= 180, got {least:g} and {most:g}"
            )
        gate = Limited(n, n, (), least, most)
        return gate if rule == All(least, most) else _with_noise(gate, rule, names, cameras)
    k, needs = finite_number(rule.k), rule.needs
    if not k.is_integer() or not 1 <= k <= n:
        raise CameraError(
            f"expected k of AtLeast to be a whole number from 1 to {n}, got {shown(rule.k)}"
        )
    if isinstance(needs, str) or not all(name in names for name in needs):
        raise CameraError(f"expected needs of AtLeast to be some of {known}, got {shown(needs)}")
    rows = tuple(sorted({list(names).index(name) for name in needs}))
    if len(rows) > k:
        raise CameraError(
            f"expected AtLeast to need at most k = {int(k)} sensors, got {len(rows)}; give a "
            "larger k"
        )
    return Limited(n, int(k), rows)


def _with_noise(
    gate: Limited, rule: All, names: Sequence[str], cameras: Sequence[Camera]
) -> Limited:
    """The gate with the noise of its devices."""
    limit, noise, stripes = finite_number(rule.max_uncertainty), rule.noise_px, rule.stripes
    if not SHORTEST_LIMIT <= limit <= LARGEST_COORDINATE:
        raise CameraError(
            "expected max_uncertainty, with noise_px or stripes, to be from 1e-30 to 1e30 m, got "
            f"{shown(rule.max_uncertainty)}"
        )
    if isinstance(noise, Mapping) and set(noise) != set(names):
        raise CameraError(f"expected noise_px of each of {shown(list(names))}, got {shown(noise)}")
    of_devices = [noise[name] if isinstance(noise, Mapping) else noise for name in names]
    values = [finite_number(value) for value in of_devices]
    least, most = NOISE_PX
    if not all(least <= value <= most for value in values):
        raise CameraError(
            f"expected noise_px to be from {least:g} to {most:g} px with max_uncertainty, got "
            f"{shown(noise)}"
        )
    if isinstance(stripes, str) or not all(name in names for name in stripes):
        raise CameraError(
            f"expected stripes to be some of {shown(list(names))}, got {shown(stripes)}"
        )
    rows = tuple(sorted({list(names).index(name) for name in stripes}))
    if len(rows) == len(names):
        raise CameraError(
            "expected a sensor without stripes, got none; stripes give one coordinate of a point"
        )
    scales = _scales(cameras, rows)
    radians = tuple(value / each for value, each in zip(values, scales, strict=True))
    return replace(gate, most_deviation=limit, noise=radians, stripes=rows)


def rule_of_gate(gate: Limited, names: Sequence[str], cameras: Sequence[Camera]) -> Rule:
    """The rule of which `gate_of` makes this gate, to the last bit."""
    if gate.k < gate.n or gate.needs:
        return AtLeast(gate.k, [names[row] for row in gate.needs])
    rule = All(gate.least_deg, gate.most_deg)
    if not gate.has_deviation:
        return rule
    noise = {
        name: _pixels_of(radians, scale)
        for name, radians, scale in zip(
            names, gate.noise, _scales(cameras, gate.stripes), strict=True
        )
    }
    stripes = [names[row] for row in gate.stripes]
    return replace(rule, max_uncertainty=gate.most_deviation, noise_px=noise, stripes=stripes)


def _scales(cameras: Sequence[Camera], stripes: Sequence[int]) -> list[float]:
    """Pixels per radian of cameras, of which those of some rows have stripes."""
    return [pixels_a_radian(camera, row in stripes) for row, camera in enumerate(cameras)]


def _pixels_of(radians: float, scale: float) -> float:
    """Pixels that give these radians when divided by a scale: the product or a neighbour of it."""
    values = radians * scale
    near = (values, math.nextafter(values, 0.0), math.nextafter(values, math.inf))
    return next((each for each in near if each / scale == radians), values)


def compile_rule(
    rule: Rule | None, names: Sequence[str], cameras: Sequence[Camera]
) -> dict[str, Anything]:
    """Attributes of a rig with a rule, or without any."""
    rule = Any() if rule is None else rule
    gate = gate_of(rule, names, cameras)
    return {"rule": rule, "gates": {} if gate is None else {0: gate}}


def rename_devices(rule: Rule, before: Sequence[str], after: Sequence[str]) -> Rule:
    """The rule of devices that have other names."""
    names = dict(zip(before, after, strict=True))
    if isinstance(rule, AtLeast):
        return replace(rule, needs=[names[each] for each in rule.needs])
    if isinstance(rule, All):
        noise = rule.noise_px
        if isinstance(noise, Mapping):
            noise = {names[each]: value for each, value in noise.items()}
        return replace(rule, noise_px=noise, stripes=[names[each] for each in rule.stripes])
    return rule


def rule_to_json(rule: Rule) -> dict[str, Anything]:
    """Entries of a rule, ready for JSON; see `rule_of`."""
    own = asdict(rule)
    if isinstance(rule, AtLeast):
        own["needs"] = list(rule.needs)
    elif isinstance(rule, All):
        usual = asdict(All())
        named = dict(rule.noise_px) if isinstance(rule.noise_px, Mapping) else rule.noise_px
        own |= {"noise_px": named, "stripes": list(rule.stripes)}
        later = ("max_uncertainty", "noise_px", "stripes")
        own = {k: v for k, v in own.items() if k not in later or v not in (usual[k], [])}
        own = {} if rule == All() else own
    return {"rule": KINDS[type(rule)], **own}


def rule_of(entries: Mapping[str, Anything]) -> Rule:
    """Rule of its entries: "rule", one of `KINDS`, and the fields of its class."""
    kind, own = entries.get("rule", "any"), {k: v for k, v in entries.items() if k != "rule"}
    if kind == "at_least" and "k" not in own:
        raise CameraError("expected k, a number of sensors, for rule at_least, got none; add it")
    for made, name in KINDS.items():
        if kind == name and set(own) <= set(made.__dataclass_fields__):
            if isinstance(own.get("max_uncertainty"), str):
                own["max_uncertainty"] = length_of("max_uncertainty", own["max_uncertainty"])
            return made(**own)
    raise CameraError(
        f"expected rule any, at_least with k and needs, or all with "
        f"{', '.join(All.__dataclass_fields__)}, got {shown(dict(entries))}"
    )


def length_of(name: str, text: str) -> float:
    """Metres of a text with a unit, such as "50 um"."""
    number, _, unit = text.strip().partition(" ")
    try:
        return float(number) / UNITS[unit.strip()]
    except (ValueError, KeyError):
        raise CameraError(
            f"expected {name} to be a length in m, mm or um, such as {shown('50 um')}, got "
            f"{shown(text)}"
        ) from None


UNITS = {"m": 1.0, "mm": 1e3, "um": 1e6, "µm": 1e6}
"""Units of lengths in files, by their number in a metre."""


KINDS: dict[Anything, str] = {Any: "any", All: "all", AtLeast: "at_least"}
"""Names of rules in files."""
