"""Lines of a result for people: the answer, the goal, the worst dead zone and advice, then others.

All are made of the summary of a network as commands print it, which has its dead zones.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from rastercov.base import ReadByName, first_of, percent, plural
from rastercov.base.format import area, points
from rastercov.core.area.advice import general_advice
from rastercov.core.area.feature import in_words
from rastercov.core.area.stages import SLIVER_REL
from rastercov.core.area.zones import LEAST_PERCENT, MOST_LINES, n_unlisted, zone_line
from rastercov.core.coverage.evaluation import lines_of, question_in
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh.groups import at_level

MOST_REASONS = 6
"""Reasons in a line, the largest."""

Summary = ReadByName


def answer(summary: Summary) -> str:
    """The covered share, in one line."""
    if "covered_area" not in summary:
        covered = summary["covered"]
        shares = (f"{percent(covered[name] / 100)}" for name in ("percent", "area_percent"))
        text = "covered: {} of the faces, {} of the area".format(*shares)
        return text + (
            f", each by {views} cameras or more" if (views := summary["required_views"]) > 1 else ""
        )
    *_, in_phases = "".join(_lines(summary)[:1]).partition(" of the area")
    heads = summary.get("heads", 0)
    text = f"covered: {in_words(summary['covered_area'], noun_of(summary))}{in_phases}"
    text += f" by {plural(heads, 'head')}" if heads else ""
    of_seeable = summary["covered_of_seeable_percent"]
    if summary["unseeable_m2"] and of_seeable is not None:
        text += f"; {percent(of_seeable / 100)} of the coverable area"
    return text


def noun_of(summary: Summary) -> str:
    """Word for a row of a result."""
    return "head" if "heads" in summary else "camera"


def first_lines(
    summary: Summary,
    goal: str = "",
    level: int | None = None,
    instead: Sequence[str] = (),
    best: "GoalChange | None" = None,
) -> list[str]:
    """Answer, best change and goal if any, the worst dead zone or reason, and advice, or `instead`.

    Zones are named by parts of a level, as `with_parts` has them. Advice for the best change is
    left out.
    """
    lines = [answer(summary), "" if best is None else best.line, goal]
    zones = [with_parts(zone, level) for zone in _zones(summary)[:1]]
    reasons = {} if "covered_area" in summary else summary["not_covered_because"]
    if instead:
        lines += instead
    elif zones:
        lines += [zone_line(zones[0]), advice_line(zones[0])]
    elif reasons:
        worst = max(reasons, key=lambda name: int(reasons[name]["faces"]))
        faces, share = (
            sum(each[key] for each in reasons.values()) for key in ("faces", "area_percent")
        )
        most = f" ({plural(reasons[worst]['faces'], 'face')})" if len(reasons) > 1 else ""
        words = f"{plural(faces, 'face')} ({percent(share / 100)} of the area)"
        main = "main cause" if most else "cause"
        lines.append(f"not covered: {words}; {main}: {REASONS[worst].label}{most}")
        advice = general_advice(worst).replace("the camera", "a camera")
        lines.append(advice_line({"advice": advice}))
    is_said = [
        best is not None and line.startswith("advice: ") and best.advised in line for line in lines
    ]
    return [line for line, is_again in zip(lines, is_said, strict=True) if line and not is_again]


class GoalChange(NamedTuple):
    """A change that was tried, and what a goal gains by it.

    Attributes
    ----------
    share : float
        Gain, of the area of the goal.
    line : str
    advised : str
        Words on it in advice.
    """

    share: float
    line: str
    advised: str

    @classmethod
    def of_zone(
        cls, zone: Summary, goal: str, gain: float | None, losses: Mapping[str, float], whole: float
    ) -> "GoalChange":
        """The one that was tried for a zone of a goal with a whole area, m^2.

        `gain` is the share of it that is gained, None for about that of the zone; `losses` are
        those of other goals.
        """
        tried, nearest = zone["tried"], zone.get("nearest")
        words, share = tried["change"], tried["gain_m2"] / whole if gain is None else gain
        if nearest is not None:
            name = _nearest_name(nearest)
            words = words.replace("at the same place", f"at the place of {name}")
            words = words if tried["pose"] is None else words.replace("the camera", name)
        more = f"{'about ' * (gain is None)}{points(share)} more"
        return cls(share, gain_line(words, goal, more, losses), tried["change"])


NO_CHANGE = GoalChange(0.0, *["best change known: none covers half of a dead zone"] * 2)
"""No change of those that were tried covers half of a dead zone."""


def gain_line(
    words: str, goal: str, gain: str, losses: Mapping[str, float], without: str = ""
) -> str:
    """Line on the best change known for all goals that are not met, and what others lose."""
    lost = [f"{points(share)} of {name}" for name, share in losses.items()]
    cost = f"; lost{without}: {first_of(lost)}" if lost else ""
    return f"best change known: {words}: {gain} of {goal}{cost}"


def with_parts(zone: Summary, level: int | None) -> Summary:
    """A zone on the parts of a level, and hidden by one, instead of on their groups."""
    if level is None:
        return zone
    groups = dict.fromkeys(at_level(group, level) for group in zone["groups"])
    hider = zone["hidden_by"] and at_level(zone["hidden_by"], level)
    return {**zone, "groups": list(groups), "hidden_by": hider}


def advice_line(zone: Summary, noun: str = "") -> str:
    """The advice for a zone, with the camera that comes closest; "" where there is none."""
    text, nearest = zone["advice"], zone.get("nearest")
    if text and nearest is not None:
        name = _nearest_name(nearest, noun)
        text = f"{name} comes closest to covering the zone's middle: {text}"
    return f"advice: {text}" if text else ""


def _nearest_name(nearest: Summary, noun: str = "") -> str:
    noun = noun or ("head" if "head" in nearest else "camera")
    return f"{noun} {nearest.get('head', nearest['pose'] + 1)}"


def other_lines(
    summary: Summary,
    level: int | None = None,
    *,
    has_reasons: bool = True,
    said: Collection[int] = (0,),
) -> list[str]:
    """Losses by single cameras, the other dead zones and, unless left out, reasons by area.

    By face the other reasons, and why it is by face. Rows of zones that were named before are left
    out.
    """
    why = summary["not_covered_because"]
    reasons = {name: each for name, each in why.items() if "m2" in each}
    every = summary.get("dead_zones", ())
    zones = [zone for row, zone in enumerate(every) if row not in said]
    listed = [zone for zone in zones if zone["percent"] >= LEAST_PERCENT][: MOST_LINES - 1]
    lines = [*_lines(summary)[1:], *lines_of(summary)]
    whole = max((zone["area_m2"] for zone in every), default=0.0)  # one unit for the list
    lines += [zone_line(with_parts(zone, level), whole) for zone in listed]
    rest = zones[len(listed) :] if _zones(summary) else []
    if n := len(rest) and len(rest) + n_unlisted(summary):
        m2 = sum(zone["area_m2"] for zone in [*rest, summary["other_dead_zones"]])
        lines.append(f"and {plural(n, 'more dead zone')}, {area(m2, whole=whole)} in total")
    if len(reasons) > 1 and has_reasons:
        lines.append(f"not covered: {by_reason(reasons)}")
    elif "covered_area" not in summary:
        ranked = sorted(why, key=lambda name: -int(why[name]["faces"]))[1:]
        each = [
            f"{why[name]['faces']:,} ({REASONS[name].label}{gain_in_faces(why[name])})"
            for name in ranked
        ]
        if each and has_reasons:
            lines.append(f"other faces not covered: {', '.join(each)}")
        if summary.get("by_face_because"):
            lines.append(
                f"evaluated by face, because {summary['by_face_because'].partition(';')[0]}"
            )
    return lines


def _lines(summary: Summary) -> list[str]:
    """Lines on a result over phases of the scene."""
    return list(question_in(summary).get("lines", ()))


def _zones(summary: Summary) -> list[Summary]:
    """Dead zones that have a line."""
    return [each for each in summary.get("dead_zones", ()) if each["percent"] >= LEAST_PERCENT]


def most_named(n: int) -> int:
    """Number of n reasons that are named: one more than `MOST_REASONS` for the last alone."""
    return MOST_REASONS + (n == MOST_REASONS + 1)


def by_reason(why: Mapping[str, ReadByName]) -> str:
    """Areas by reason of `areas_by_reason`, the largest first, each with the gain by it alone.

    In one unit; after `MOST_REASONS` the sum of the others.
    """
    m2 = {name: each["m2"] for name, each in why.items()}
    ranked = sorted(m2, key=m2.__getitem__, reverse=True)
    ranked = [name for name in ranked if m2[name] > SLIVER_REL * sum(m2.values())]
    said = [
        f"{area(m2[name], whole=m2[ranked[0]])} {REASONS[name].label}"
        f"{gain_in_area(why[name], m2[ranked[0]])}"
        for name in ranked[: most_named(len(ranked))]
    ]
    if others := ranked[len(said) :]:
        rest = area(sum(m2[name] for name in others), whole=m2[ranked[0]])
        said.append(f"{rest} for {plural(len(others), 'other reason')}")
    return ", ".join(said)


def gain_in_area(entry: ReadByName, whole: float = 0.0) -> str:
    """Words in brackets on the gain by one criterion alone, m^2; "" for several."""
    gain = area(entry["gain_m2"], whole=whole) if "gain_m2" in entry else ""
    return f" (gain by this alone: {gain})" if gain else ""


def gain_in_faces(entry: ReadByName) -> str:
    """The same of faces."""
    return f", gain by this alone: {entry['gain']['faces']:,}" if "gain" in entry else ""
