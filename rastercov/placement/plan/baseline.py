"""A check held against an earlier one: what is worse beyond the bounds of both, and where.

A face is the same in both checks if it has the same centroid, to the bit. Of a dead zone, that
counts which its faces have more of than in the earlier check, and all of a face that was not there.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError, errors_as
from rastercov.base.files import StrPath, UnreadableError, printable, read_json
from rastercov.base.format import area, percent
from rastercov.coverage.area.zones import LEAST_PERCENT, zone_line
from rastercov.placement.plan.network import FAILS, status_of

Told = Mapping[str, Any]
Entry = dict[str, Any]
NEEDED = {"task", "all", "groups"}
"""Entries of the `check.json` of an earlier check."""
NO_CHECK = "no check.json of a check of the same groups by this version; make one by --out"


@dataclass(frozen=True)
class Against:
    """Differences of a check from its baseline, beyond the bounds of both.

    Attributes
    ----------
    file : str
        The baseline.
    shares : list of dict
        For all, for each of several groups, and for goals of their own: name, group, share, before,
        bound of the difference, and status, "worse", "better" or "same".
    zones : list of dict
        Dead zones that are new or larger, by more than `LEAST_PERCENT`: row in `dead_zones`,
        status, more_m2, and line.
    """

    file: str
    shares: list[Entry]
    zones: list[Entry]

    def losses(self) -> list[str]:
        """Lines on shares that are worse, and on dead zones that are new or larger."""
        worse = [each for each in self.shares if each["status"] == "worse"]
        return [f"worse: {words(each)}" for each in worse] + [each["line"] for each in self.zones]

    def lines(self) -> list[str]:
        """The differences for people, the verdict last."""
        better = [words(each) for each in self.shares if each["status"] == "better"]
        verdict = f"{'' if self.losses() else 'no '}worse than {self.file}"
        return [*(f"better: {each}" for each in better), *self.losses(), verdict]


def words(share: Told) -> str:
    """A share and that of the baseline in one line."""
    more = share["share"] - share["before"]
    bound = 100 * share["bound"]
    digits = min(max(1, 1 - math.floor(math.log10(max(bound, 1e-9)))), 6)  # two of the bound
    points = f"{100 * abs(more):.{digits}f} ± {bound:.2g} points"
    both = f"{percent(share['share'])} covered, {percent(share['before'])} before"
    return f"{share['name']}: {both}: {points} {'more' if more > 0 else 'less'}"


def read_baseline(path: StrPath) -> Told:
    """The outcome of an earlier check, `check.json`.

    Raises
    ------
    ConfigError
        For another file.
    """
    file = printable(str(path))
    with errors_as(ConfigError, file, UnreadableError):
        told = read_json(path)
    if not isinstance(told, dict) or not told.keys() >= NEEDED:
        raise ConfigError(f"{file}: {NO_CHECK}")
    return {**told, "file": file}


def compare(before: Told, now: Told) -> Against:
    """Hold an outcome, as `record` gives it, against that of an earlier check.

    Raises
    ------
    ConfigError
        For a baseline of another task or of other groups.
    """
    file = before["file"]
    try:
        for name, value in now["task"].items():
            if (old := before["task"].get(name)) != value:
                other = f"with {name} = {shown(old)}, and this one has {shown(value)}"
                raise ConfigError(f"{file}: of a check {other}; make the baseline anew")
        shares, earlier = _by_name(now), _by_name(before)
        if shares.keys() != earlier.keys() or not _are_possible(before, earlier.values()):
            raise LookupError
        left_out = f"group {now['groups'][0]['group']}" if len(now["groups"]) == 1 else ""
        pairs = [_share(name, earlier[name], shares[name]) for name in shares if name != left_out]
        return Against(file, pairs, _zones(before, now) if "dead_zones" in now else [])
    except ConfigError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError):
        raise ConfigError(f"{file}: {NO_CHECK}") from None


def _by_name(told: Told) -> dict[str, Told]:
    """Shares of all, of groups, and of goals of their own."""
    found = {"all": told["all"]} | {f"group {each['group']}": each for each in told["groups"]}
    goals = [each for each in told.get("requirements", ()) if each.get("goal")]
    return found | {f"goal {each['goal']}": each for each in goals}


def _are_possible(told: Told, shares: Iterable[Told]) -> bool:
    """True for shares of 0 to 1, and areas of faces that are finite, and 0 or more."""
    numbers = [(each["low"], each["share"], each["high"]) for each in shares]
    rows = np.array(told.get("dead_faces") or np.zeros((0, 5)), np.float64)
    bound = finite_number(told.get("covered_area", {"bound_m2": 0}).get("bound_m2"))
    is_right = np.isfinite(rows).all() and (rows[:, 3:] >= 0).all() and bound >= 0
    return bool(is_right and all(0 <= low <= high <= 1 and 0 <= s <= 1 for low, s, high in numbers))


def _share(name: str, before: Told, now: Told) -> Entry:
    """A share, that of the baseline, and their difference; of what is permitted, less is better."""
    is_less = status_of(now["low"], now["high"], before["low"]) == FAILS
    is_more = status_of(before["low"], before["high"], now["low"]) == FAILS
    is_worse, is_better = (is_more, is_less) if now.get("is_most") else (is_less, is_more)
    status = "worse" if is_worse else "better" if is_better else "same"
    bound = sum(each["high"] - each["low"] for each in (before, now)) / 2
    shares = {"share": now["share"], "before": before["share"]}
    return {"name": name, "group": now["group"], **shares, "bound": bound, "status": status}


def _zones(before: Told, now: Told) -> list[Entry]:
    """Dead zones that are new or larger."""
    least = sum(told["covered_area"]["bound_m2"] for told in (before, now))
    least = max(least, LEAST_PERCENT / 100 * now["covered_area"]["of_m2"])
    dead: Counter[tuple[float, ...]] = Counter()
    for *centroid, _, square_metres in before["dead_faces"]:
        dead[tuple(centroid)] += square_metres
    more, found = [0.0] * len(now["dead_zones"]), []
    for *centroid, row, square_metres in now["dead_faces"]:
        if row < len(more):
            more[int(row)] += max(0.0, square_metres - dead[tuple(centroid)])
    for row, zone in enumerate(now["dead_zones"]):
        if more[row] > least:
            is_new = more[row] > zone["area_m2"] - least
            status, by = ("new", "") if is_new else ("larger", f" by {area(more[row])}")
            line = f"{status}{by}: {zone_line(zone)}"
            found.append({"row": row, "status": status, "more_m2": more[row], "line": line})
    return found
