"""Comparison of a check with an earlier one: losses beyond the bounds of both, and their places.

A face is the same in both checks if it has the same centroid, to the bit. Of a dead zone, that
counts which its faces have more of than in the earlier check, and all of a face that was not there.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np

from rastercov.advice.headline import advice_line, with_parts
from rastercov.base import (
    ByName,
    ConfigError,
    ReadByName,
    StrPath,
    UnreadableError,
    errors_as,
    finite_number,
    first_of,
    percent,
    plural,
    printable,
    read_json,
    shown,
)
from rastercov.base.format import area, number
from rastercov.core.area.zones import LEAST_PERCENT, zone_line
from rastercov.placement.required import FAILS, status_of

Told = ReadByName
Entry = ByName
NEEDED = {"task", "all", "groups"}
"""Entries of the `check.json` of an earlier check."""
SCENE = ("size_m", "scene_sha256")
"""Those that tell scenes apart."""
NO_CHECK = (
    "expected a check.json written by this version for the same groups, got another file; "
    "write one with check --out"
)
MOST_PARTS, MOST_WORST = 12, 5
"""Parts, and groups or dead zones, that have a line: those that lost most."""
SQUARE_METRES = {"m": 1.0, "cm": 1e-4, "mm": 1e-6, "um": 1e-12, "µm": 1e-12}
SIZE = re.compile(
    r"([\d.]+(?:e[+-]?\d+)?) *(?:(%|points)|(mm|cm|m|um|µm)(?:2|²|\^2))?", re.IGNORECASE
)


@dataclass(frozen=True)
class Tolerated:
    """Loss that is accepted: a part of each share and of the task, or an area, m^2."""

    share: float = 0.0
    m2: float = 0.0

    @classmethod
    def of(cls, loss: str | float) -> "Tolerated":
        """A number of percentage points, or an area such as "2 cm2".

        Raises
        ------
        ConfigError
            For another text or number.
        """
        match = SIZE.fullmatch(str(loss).strip())
        value = finite_number(float(match[1])) if match and match[1].count(".") < 2 else -1.0
        if match is None or not (0 <= value <= 100 or (value >= 0 and match[3])):
            raise ConfigError(
                "allow_worse: expected 0 to 100 percentage points, such as 0.5, or an area, such "
                f"as 2cm2, got {shown(loss)}; give either"
            )
        return cls(m2=value * SQUARE_METRES[match[3].lower()]) if match[3] else cls(value / 100)

    def of_share(self, of_m2: float | None) -> float:
        """Loss of a share that is accepted, of the area that it is of, None by face."""
        if self.m2 and of_m2 is None:
            raise ConfigError(
                "allow_worse: expected percentage points by face, got an area; give 0.5, say"
            )
        return min(1.0, self.m2 / of_m2) if self.m2 and of_m2 else self.share

    def words(self) -> str:
        """The loss in words, after "worse than" and a name; none where none is accepted."""
        size = (
            area(self.m2)
            if self.m2
            else f"{100 * self.share:g} percentage point{'' if self.share == 0.01 else 's'}"
        )
        return f"; accepted loss: {size}" if self.m2 or self.share else ""


NOTHING = Tolerated()


@dataclass(frozen=True)
class Against:
    """Differences of a check from its baseline, beyond the bounds of both.

    Attributes
    ----------
    file : str
        The baseline.
    tolerated : str
        Loss that is accepted, in words; often none.
    shares : list of dict
        For all, goals of their own, parts and groups, in this order: name, group, level (0 for all
        and for goals), kind, share, before, bound of the difference, lost (area, m^2, or faces),
        and status, "worse", "better" or "same".
    zones : list of dict
        Dead zones that are new or larger, by more than `LEAST_PERCENT`, those that grew most first:
        row in `dead_zones`, the zone, status, more_m2, and line.
    is_other_scene : bool
        True if the baseline was written for other faces.
    """

    file: str
    tolerated: str
    shares: list[Entry]
    zones: list[Entry]
    is_other_scene: bool = False

    @property
    def is_worse(self) -> bool:
        """True where a share or a dead zone is worse than what is accepted."""
        return bool(self.zones or self.worse())

    def worse(self) -> list[Entry]:
        """Shares that are worse: all, goals, then parts and groups that lost most."""
        worse = [each for each in self.shares if each["status"] == "worse"]
        return sorted(worse, key=lambda each: (KINDS.index(each["kind"]), -each["lost"]))

    def to_json(self) -> Entry:
        """The differences, and names of the shares that are worse, ready for JSON."""
        return asdict(self) | {"worse": [each["name"] for each in self.worse()]}

    def losses(self, level: int | None = None) -> list[str]:
        """Lines on shares that are worse, and on dead zones that are new or larger, with advice.

        Parts and groups below a level are counted only.
        """
        worse, lines = self.worse(), []
        for kind, most in MOST_OF_KIND.items():
            own = [each for each in worse if each["kind"] == kind]
            first = [each for each in own if level is None or each["level"] <= level][:most]
            lines += [f"worse: {words(each)}" for each in first]
            if own[len(first) :]:
                below = "" if level is None else f" below level {level}"
                noun = plural(len(own) - len(first), kind).partition(" ")
                more = f"{noun[0]} more {noun[2]}" if first else plural(len(own), kind)
                lines.append(f"worse: {more}{below}")
        for each in self.zones[:MOST_WORST]:
            lines += self.words_of_zone(each, level)
        if len(self.zones) > MOST_WORST:
            lines.append(f"new or larger: {len(self.zones) - MOST_WORST} more dead zones")
        return lines

    def lines(self, level: int | None = None) -> list[str]:
        """The differences in words, the verdict first."""
        better = [words(each) for each in self.shares[:1] if each["status"] == "better"]
        verdict = f"{'' if self.is_worse else 'no '}worse than {self.file}{self.tolerated}"
        if self.is_other_scene:
            verdict += ", which has another scene: differences are of the rig and of the scene"
        return [verdict, *(f"better: {each}" for each in better), *self.losses(level)]

    @staticmethod
    def words_of_zone(each: Told, level: int | None = None) -> list[str]:
        """Lines on a zone that is new or larger, and advice for it."""
        grown = each["status"] == "larger"
        by = f" by {area(each['more_m2'])}" if grown else ""
        zone = with_parts(each["zone"], level)
        lines = [f"{each['status']}{by}: {zone_line(zone)}", advice_line(zone)]
        return [line for line in lines if line]


KINDS = ("all", "goal", "part", "group")
MOST_OF_KIND = {"all": 1, "goal": MOST_PARTS, "part": MOST_PARTS, "group": MOST_WORST}
"""Shares of each kind that have a line."""


def words(share: Told) -> str:
    """A share and its difference from that of the baseline in one line."""
    more = share["share"] - share["before"]
    lost = f" ({area(abs(share['lost']))})" if share["is_area"] else ""
    what = "whole task" if share["name"] == "all" else share["name"]
    name = f"{what}: {'up' if more > 0 else 'down'}"
    return f"{name} {number(100 * abs(more))} percentage points{lost} to {percent(share['share'])}"


def read_baseline(path: StrPath | None, allow_worse: str | float | None) -> Told | None:
    """The outcome of an earlier check, `check.json`, and the loss that is accepted; None for none.

    Raises
    ------
    ConfigError
        For another file, an invalid loss, and a loss without a baseline.
    """
    tolerated = NOTHING if allow_worse is None else Tolerated.of(allow_worse)
    if path is None:
        if allow_worse is not None:
            raise ConfigError("allow_worse: expected a baseline, got none; name its check.json")
        return None
    file = printable(str(path))
    with errors_as(ConfigError, file, UnreadableError):
        told = read_json(path)
    if (
        not isinstance(told, dict)
        or not told.keys() >= NEEDED
        or not isinstance(told["task"], dict)
    ):
        raise ConfigError(f"{file}: {NO_CHECK}")
    return {**told, "file": file, "tolerated": tolerated}


def check_task(before: Told, task: Told) -> None:
    """ConfigError for the baseline of another task than this one, ready for JSON."""
    for name, value in task.items():
        if (old := before["task"].get(name)) != value:
            raise ConfigError(
                f"{before['file']}: expected a check with {name} = {shown(value)}, got "
                f"{shown(old)}; write the baseline again"
            )
    before["tolerated"].of_share(None if task["by"] == "face" else 1.0)


def compare(before: Told, now: Told) -> Against:
    """Compare an outcome, as `record` gives it, with that of an earlier check.

    Raises
    ------
    ConfigError
        For a baseline of other groups, and for an accepted area by face.
    """
    file, tolerated = before["file"], before.get("tolerated", NOTHING)
    try:
        before = {"parts": []} | dict(before)  # of a version that did not write them
        shares = _by_name(now if before["parts"] else {**now, "parts": []})
        earlier = _by_name(before)
        if others := sorted(shares.keys() ^ earlier.keys()):
            raise ConfigError(
                f"{file}: expected a check of the same groups and goals, got one that differs in "
                f"{first_of([' '.join(each) for each in others], 3)}; write the baseline again"
            )
        if not _are_possible(before, earlier.values()):
            raise LookupError
        pairs = [_share(name, earlier[name], shares[name], tolerated) for name in shares]
        zones = _zones(before, now, tolerated) if "dead_zones" in now else []
        is_other = any(before.get(name, now[name]) != now[name] for name in SCENE)
        return Against(file, tolerated.words(), pairs, zones, is_other)
    except ConfigError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError):
        raise ConfigError(f"{file}: {NO_CHECK}") from None


def _by_name(told: Told) -> dict[tuple[str, str], Told]:
    """Shares of all, of goals of their own, of parts, and of several groups, by kind and name."""
    goals = [each for each in told.get("requirements", ()) if each.get("goal")]
    groups = told["groups"] if len(told["groups"]) > 1 else []
    table = {("all", ""): told["all"]} | {("goal", each["goal"]): each for each in goals}
    for kind, entries in (("part", told["parts"]), ("group", groups)):
        table |= {(kind, each["group"]): each for each in entries}
    return table


def _are_possible(told: Told, shares: Iterable[Told]) -> bool:
    """True for shares of 0 to 1, and areas of faces that are finite, and 0 or more."""
    numbers = [(each["low"], each["share"], each["high"]) for each in shares]
    rows = np.array(told.get("dead_faces") or np.zeros((0, 5)), np.float64)
    bound = finite_number(told.get("covered_area", {"bound_m2": 0}).get("bound_m2"))
    is_right = np.isfinite(rows).all() and (rows[:, 3:] >= 0).all() and bound >= 0
    return bool(is_right and all(0 <= low <= high <= 1 and 0 <= s <= 1 for low, s, high in numbers))


def _share(which: tuple[str, str], before: Told, now: Told, tolerated: Tolerated) -> Entry:
    """A share, that of the baseline, and their difference; of what is permitted, less is better."""
    accepted = tolerated.of_share(now.get("of_m2"))
    down, up = (-accepted, 0.0) if not now.get("is_most") else (0.0, accepted)
    is_less = status_of(now["low"], now["high"], before["low"] + down) == FAILS
    is_more = status_of(before["low"], before["high"], now["low"] - up) == FAILS
    is_worse, is_better = (is_more, is_less) if now.get("is_most") else (is_less, is_more)
    status = "worse" if is_worse else "better" if is_better else "same"
    kind, group = which
    lost = (before["share"] - now["share"]) * now.get("of_m2", now["faces"])
    return {
        "name": f"{kind} {group}".strip(),
        "group": now["group"],
        "kind": kind,
        "level": group.count("/") + 1 if kind in ("part", "group") else 0,
        "share": now["share"],
        "before": before["share"],
        "bound": sum(each["high"] - each["low"] for each in (before, now)) / 2,
        "lost": -lost if now.get("is_most") else lost,
        "is_area": "of_m2" in now,
        "status": status,
    }


def _zones(before: Told, now: Told, tolerated: Tolerated) -> list[Entry]:
    """Dead zones that are new or larger, those that grew most first."""
    least = sum(told["covered_area"]["bound_m2"] for told in (before, now))
    whole = now["covered_area"]
    accepted = tolerated.of_share(whole["of_m2"]) * whole["of_m2"]
    least = max(least, LEAST_PERCENT / 100 * whole["of_m2"]) + accepted
    dead: Counter[tuple[float, ...]] = Counter()
    for *centroid, _, square_metres in before["dead_faces"]:
        dead[tuple(centroid)] += square_metres
    more, items = [0.0] * len(now["dead_zones"]), []
    for *centroid, row, square_metres in now["dead_faces"]:
        if row < len(more):
            more[int(row)] += max(0.0, square_metres - dead[tuple(centroid)])
    for row, zone in enumerate(now["dead_zones"]):
        if more[row] > least:
            is_new = more[row] > zone["area_m2"] - least
            status = "new" if is_new else "larger"
            own = {"row": row, "zone": zone, "status": status, "more_m2": more[row]}
            items.append(own | {"line": Against.words_of_zone(own)[0]})
    return sorted(items, key=lambda each: -each["more_m2"])
