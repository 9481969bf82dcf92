"""Files of lamps: TOML in the form of a plan, and lights of glTF scenes."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from os import PathLike
from pathlib import Path

import numpy as np

from rastercov.base import (
    CameraError,
    ConfigError,
    FloatArray,
    PoseError,
    ReadByName,
    StrPath,
    UnreadableError,
    errors_as,
    file_bytes,
    first_of,
    is_one_of,
    printable,
    read_json,
    read_toml,
    shown,
    suffix_of,
)
from rastercov.base.arguments import number, pair, positive
from rastercov.core.camera import Cameras, EquipmentKind, equipment_on, look_at
from rastercov.core.camera.catalogue import lamp_entries_of
from rastercov.core.camera.exposure import Exposure, check_unit, illuminance
from rastercov.core.camera.sun import NORTH_DEG, angle, moment, sun_directions, towards
from rastercov.core.mesh.files import NOWHERE, Site
from rastercov.light.gltf_lights import GltfLight, read_lights
from rastercov.light.lamps import SIZES, SUN, UNITS, Lamp, Lamps, lamps_of_json
from rastercov.light.photometry import READERS

LARGEST_SCENE = 1 << 30
"""Bytes of a glTF scene."""
ENTRIES = (
    *(
        "preset",
        "kind",
        "intensity_cd",
        "power_w_sr",
        "range",
        "half_angle_deg",
        "inner_angle_deg",
        "exponent",
        "size",
    ),
    *("points", "share", "ies", "position", "positions", "aim", "spin_deg", "rig"),
)
"""Entries of a lamp in a file."""
ANGLES, MOMENT = ("azimuth_deg", "elevation_deg"), ("latitude", "longitude", "time")
OF_SUN = (
    *("kind", "illuminance_lx", "irradiance_w_m2", "points", "share", "radius_deg", "north_deg"),
    *ANGLES,
    *MOMENT,
)
"""Entries of a lamp of kind sun."""


def load_lamps(path: StrPath, site: Site = NOWHERE) -> Lamps:
    r"""Read lamps and their poses from a file.

    Parameters
    ----------
    path : path
        TOML with a table [lamps.NAME] for each lamp, and optionally `ambient` and [exposure]; JSON,
        as the viewer saves it; or a glTF scene (.glb, .gltf) with lights (KHR_lights_punctual).
    site : Site, optional
        `Mesh.site`, whose north, latitude and longitude a sun has unless the file gives them.

    Raises
    ------
    CameraError
        For an unreadable file or invalid entries; the message has the file name.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rastercov as rc
    >>> _ = Path("lamps.toml").write_text(
    ...     '[lamps.ceiling]\nintensity_cd = 100\nposition = [0, 0, 2.5]\n'
    ... )
    >>> lamps = rc.load_lamps("lamps.toml")
    >>> lamps.names, lamps.places[0, :3, 3].tolist()
    (('ceiling',), [0.0, 0.0, 2.5])
    """
    try:
        if suffix_of(path) in (".glb", ".gltf"):
            return _of_lights(*read_lights(file_bytes(path, LARGEST_SCENE)))
        if suffix_of(path) in READERS:
            raise CameraError(
                "expected a file of lamps with their places, got a luminaire; name it in a .toml: "
                'ies = "FILE"'
            )
        if suffix_of(path) == ".json":
            return lamps_of_json(read_json(path))
        return lamps_of(read_toml(path), Path(path).parent, site)
    except (UnreadableError, CameraError, ConfigError, PoseError) as error:
        raise CameraError(f"{printable(str(path))}: {error}") from None


def _of_lights(lights: Sequence[GltfLight], notes: Sequence[str]) -> Lamps:
    """Lamps of the lights of a scene; those of one name are numbered."""
    names = [light.name for light in lights]
    uses = Counter(names)
    names = [f"{each} {row}" if uses[each] > 1 else each for row, each in enumerate(names)]
    lamps = [
        Lamp(
            kind="point" if light.half_angle_deg >= 180 else "spot",
            intensity=light.intensity,
            half_angle_deg=light.half_angle_deg,
            inner_angle_deg=light.inner_angle_deg,
        )
        if light.half_angle_deg
        else Lamp.sun(light.intensity)
        for light in lights
    ]
    return Lamps(lamps, np.array([light.place for light in lights]), names, notes=notes)


def lamps_of(entries: ReadByName, folder: Path = Path(), site: Site | None = NOWHERE) -> Lamps:
    """Lamps of the content of a file: `ambient`, `exposure`, and `lamps`, tables by name.

    Files of `ies` are relative to `folder`. A lamp has `ENTRIES`: `position` or `positions`, a lamp
    each; `aim`, a point that it looks at, in place of the direction down; `spin_deg`, its rotation
    about its axis, counterclockwise seen from behind it; `rig = true` where it rides on the rig of
    the cameras, looking along the z axis of the rig unless aimed. A sun whose place is that of a
    `site` not yet known, None, is at the zenith.
    """
    others = sorted(map(shown, entries.keys() - {"ambient", "lamps", "exposure"}))
    if others or not isinstance(entries.get("lamps"), Mapping):
        raise CameraError(
            "expected a table [lamps.NAME] per lamp, and only ambient and [exposure] beside them, "
            f"got {first_of(others) or 'no lamps'}; {'rename it' if others else 'add one'}"
        )
    lamps, places, names, rides = [], [], [], []
    for name, own in entries["lamps"].items():
        with errors_as(CameraError, f"lamp {shown(name)}", (CameraError, PoseError)):
            of_name, positions, on_rig = _read(own, folder, site)
        several = len(positions) > 1
        names += [f"{name} {row}" if several else name for row in range(len(positions))]
        lamps += of_name
        places += list(positions)
        rides += [on_rig] * len(positions)
    ambient = entries.get("ambient", 0.0)
    if isinstance(ambient, str):
        units = {UNITS[lamp.unit] for lamp in lamps}  # of both, the lamps are refused
        ambient = _illuminance(ambient, min(units)) if len(units) == 1 else 0.0
    exposure = None
    if "exposure" in entries:
        own = entries["exposure"]
        known = {each.name for each in fields(Exposure)}
        if not isinstance(own, Mapping) or not set(own) <= known:
            raise CameraError(
                f"expected exposure to have {', '.join(sorted(known))}, got {shown(own)}"
            )
        try:
            exposure = Exposure(**own)
        except TypeError:
            needed = [each.name for each in fields(Exposure) if each.default is MISSING]
            raise CameraError(
                f"expected exposure to have {', '.join(needed)}, got {shown(own)}"
            ) from None
    matrices = np.reshape(places, (-1, 4, 4))
    return Lamps(lamps, matrices, names, rides=rides, ambient=ambient, exposure=exposure)


def lamp_of(entries: ReadByName, folder: Path = Path(), tilt_deg: float | None = 0.0) -> Lamp:
    """Lamp of the entries of a file in a folder, `ENTRIES`; of its place only the tilt counts."""
    if "preset" in entries:
        own = {name: value for name, value in entries.items() if name != "preset"}
        if not own.keys().isdisjoint(powers := ENTRIES[2:5]):
            own |= dict.fromkeys(powers) | {name: own.get(name) for name in powers}
        entries = lamp_entries_of(entries["preset"]) | own
        entries = {name: value for name, value in entries.items() if value is not None}
    if "ies" in entries:
        if others := sorted(set(entries) & set(ENTRIES[1:10])):
            raise CameraError(f"expected ies or {', '.join(others)}, got both; remove one")
        return Lamp.from_ies(folder / str(entries["ies"]), tilt_deg)
    kind = entries.get("kind", "point")
    names = ("half_angle_deg", "inner_angle_deg", "exponent", "share", "points")
    own = {name: entries[name] for name in names if name in entries}
    own |= {"intensity": entries.get("intensity_cd"), "power_w_sr": entries.get("power_w_sr")}
    if "range" in entries:
        own["range_m"] = _metres(entries["range"])
    if kind == "spot" and "half_angle_deg" not in own:
        raise CameraError("expected half_angle_deg for a lamp of kind spot, got none; add it")
    size = entries.get("size")
    if not is_one_of(kind, SIZES):
        lamp = Lamp(kind=kind, **own)
        if size is not None:
            raise CameraError(f"expected no size of kind {kind}, got {shown(size)}; remove it")
        return lamp
    if size is None or (kind != "area" and isinstance(size, list)):
        raise CameraError(
            f"expected size of a lamp of kind {kind}, {SIZES[kind]}, got "
            f"{'none' if size is None else shown(size)}; correct it"
        )
    sides = pair("size", size)
    return getattr(Lamp, kind)(*(sides if kind == "area" else sides[:1]), **own)


def _metres(value: object) -> float:
    """Length of a number of metres, or of text such as "20 m"."""
    text = value.strip().removesuffix("m").strip() if isinstance(value, str) else value
    try:
        return positive("range", float(text) if isinstance(text, str) else text)
    except (ValueError, CameraError):
        raise CameraError(
            f'expected range to be a length above 0 such as "20 m", got {shown(value)}; correct it'
        ) from None


def _read(
    entries: object, folder: Path, site: Site | None
) -> tuple[list[Lamp], FloatArray, bool | str]:
    """Lamps of entries, one for each place, these, and whether they ride on the rig."""
    if isinstance(entries, Mapping) and entries.get("kind") == SUN:
        return _sun(entries, site)
    if not isinstance(entries, Mapping) or (unknown := sorted(set(entries) - set(ENTRIES))):
        raise CameraError(
            f"expected entries of a lamp ({', '.join(ENTRIES)}), got "
            f"{', '.join(map(shown, unknown)) if isinstance(entries, Mapping) else shown(entries)}"
        )
    if "position" in entries and "positions" in entries:
        raise CameraError("expected position or positions, got both; remove one")
    on_rig = entries.get("rig", False)
    if not isinstance(on_rig, bool | str):
        raise CameraError(
            f"expected rig to be true, or the name of a camera or rig, got {shown(on_rig)}"
        )
    points = entries.get("positions", [entries.get("position", [0.0, 0.0, 0.0])])
    if "position" not in entries and "positions" not in entries and not on_rig:
        raise CameraError(
            "expected position, rig = true, or candidates in a plan, got none; add position = [x, "
            "y, z], metres"
        )
    try:
        at = np.array(points, np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        raise CameraError(
            f"expected position to be [x, y, z] in metres, got "
            f"{shown(entries.get('positions', entries.get('position')))}"
        ) from None
    if "aim" in entries:
        places = look_at(at, entries["aim"])
    else:
        down = np.array([0.0, 0.0, 1.0 if on_rig else -1.0])
        places = look_at(at, at + down, (0.0, -1.0 if on_rig else 1.0, 0.0))
    tilts = np.degrees(np.arccos(np.clip(-places[:, 2, 2], -1, 1))).tolist()
    by_tilt = {tilt: lamp_of(entries, folder, None if on_rig else tilt) for tilt in set(tilts)}
    spin = np.radians(number("spin_deg", entries.get("spin_deg", 0.0)))
    if spin:
        turned = np.eye(4)
        turned[:2, :2] = [[np.cos(spin), np.sin(spin)], [-np.sin(spin), np.cos(spin)]]
        places = places @ turned
    return [by_tilt[tilt] for tilt in tilts], places, on_rig


def _sun(entries: ReadByName, site: Site | None) -> tuple[list[Lamp], FloatArray, bool]:
    """A sun of its entries, as of `_read`: by angles, or by place and time."""
    if unknown := sorted(set(entries) - set(OF_SUN)):
        raise CameraError(f"expected entries of a sun, {', '.join(OF_SUN)}, got {shown(unknown)}")
    known = {
        name: number(name, entries[name]) for name in ("north_deg", *MOMENT[:2]) if name in entries
    }
    north, *place = (site or NOWHERE).known_values(known, "north_deg")
    north = angle("north_deg", NORTH_DEG if north is None else north, 360)
    if "time" in entries:
        at = [0.0 if each is None and site is None else each for each in place]
        entries = {**entries, **{k: x for k, x in zip(MOMENT, at, strict=False) if x is not None}}
    given = [names for names in (ANGLES, MOMENT) if not entries.keys().isdisjoint(names)]
    if len(given) != 1 or not set(given[0]) <= set(entries):
        named = [name for name in (*ANGLES, *MOMENT) if name in entries]
        raise CameraError(
            f"expected {' and '.join(ANGLES)}, or {', '.join(MOMENT)} of a sun, got "
            f"{', '.join(named) or 'none'}; give one"
        )
    if given[0] is ANGLES:
        azimuth, elevation = (angle(name, entries[name], 360) for name in ANGLES)
        to_sun = towards(azimuth, elevation, north)
    else:
        latitude, longitude, time = (entries[name] for name in MOMENT)
        to_sun = sun_directions(latitude, longitude, [moment("time", time)], north)[0]
    if site is None and None in place:
        to_sun = np.array((0.0, 0.0, 1.0))
    if not to_sun[2] > 0:
        raise CameraError(
            f"expected a sun above the horizon, got {math.degrees(math.asin(to_sun[2])):.3g} "
            "degrees; change the time"
        )
    own = {name: entries[name] for name in ("points", "share", "radius_deg") if name in entries}
    lamp = Lamp.sun(entries.get("illuminance_lx"), entries.get("irradiance_w_m2"), **own)
    return [lamp], look_at(to_sun, np.zeros(3)), False


def _illuminance(text: str, unit: str) -> float:
    """Illuminance of text, in the unit of lamps."""
    try:
        result = illuminance(text)
    except ValueError as error:
        raise CameraError(f"expected ambient to be {error}") from None
    check_unit("ambient", result, unit)
    return float(result)


def lamps_on(cameras: Cameras) -> Lamps | None:
    """Lamps that must light what cameras see; None where light does not count."""
    entry = equipment_on(cameras).get("lamps")
    assert isinstance(entry, Lamps | None)
    return entry


class LampKind(EquipmentKind):
    """Lamps, see `Lamps`."""

    word = "lamps"
    help = "Lamp file (.toml, .json, .glb); a covered point must also be lit; see docs/light.md."
    entry = "light"

    def of(self, given: object, site: Site = NOWHERE) -> Lamps:
        """See `EquipmentKind`."""
        lamps = load_lamps(given, site) if isinstance(given, str | PathLike) else given
        if not isinstance(lamps, Lamps):
            raise CameraError(
                f"expected lamps to be Lamps or a file, got {shown(lamps)}; correct it"
            )
        return lamps

    def of_json(self, entries: ReadByName) -> Lamps:
        """See `EquipmentKind`."""
        return lamps_of_json(entries)


HOOKS = LampKind()
