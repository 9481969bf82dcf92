"""Words on a task, and advice to cover a face or a point: those of `REASONS` with its figures."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from rastercov.base import FloatArray, ReadByName, arccos, dots, matmul, norm, percent
from rastercov.base.format import distance as in_words
from rastercov.base.format import number
from rastercov.core.area.regions import OF_A_FACE
from rastercov.core.camera import Camera, to_camera, to_image
from rastercov.core.coverage.task import EDITIONS, REASONS, WORDINGS, Task, density_text

LIMITS = (
    ("drawn_pixels", "min_pixels", 0.5, "px"),
    ("pixel_density", "min_pixel_density", 1.0, "px/m"),
    ("facing_density", "min_facing_density", 1.0, "px/m"),
    ("pixels_per_m2", "min_pixels_per_m2", 0.5, "px/m²"),
)
"""Figure, minimum of a task, exponent by which it grows as the camera comes nearer, and unit."""
STEP_REL = 1e-4
"""Step of a derivative of the image, relative to the distance of the point."""


LARGER = "{found}; {wanted} needs {times} the magnification"
"""Advice where parallel rays are too coarse."""

GENERAL = {
    "outside": "rotate the camera towards this surface",
    "out_of_focus": "refocus or move the camera",
    "too_coarse": "move the camera closer or use a longer lens",
    "occluded": "move the camera so that nothing blocks the view",
    "too_oblique": "move the camera closer to the face normal",
}
"""Advice by reason where no figures of the camera are known."""


SOMETHING = "the obstacle"
"""Name of an occluder without a name."""


class Short(NamedTuple):
    """The minimum missed by the largest factor: that factor in distance, found, required."""

    factor: float
    found: str
    wanted: str


def short_of(figures: ReadByName, task: Task, unit: str = "m") -> Short | None:
    """Minimum of a task that figures miss by the largest factor; None if they meet all.

    `unit` is that of lengths, as of `rastercov.base.format.area`.
    """
    most = None
    for name, of_task, power, per in LIMITS:
        own, least, own_unit = (
            figures.get(name, 0.0),
            getattr(task, of_task),
            per.replace("m", unit),
        )
        if 0 < own < least and (most is None or (least / own) ** power > most.factor):
            result = text_of_result(figures, name, own_unit)
            most = Short((least / own) ** power, result, density_text(least, own_unit))
    return most


def text_of_result(figures: ReadByName, name: str, unit: str) -> str:
    """Figure with its unit; a density on the surface also as a camera that faces it would have."""
    facing = figures.get("facing_density", figures[name])
    said, head_on = density_text(figures[name], unit, facing), density_text(facing, unit)
    return said if name != "pixel_density" or head_on == said else f"{said} ({head_on} head-on)"


def advice(
    reason: str,
    figures: ReadByName,
    depth: FloatArray,
    task: Task,
    camera: Camera,
    hider: str = "",
    unit: str = "m",
) -> str:
    """Advice for a camera to cover what it does not cover.

    Parameters
    ----------
    reason : str
        Name of the criterion that fails.
    figures : mapping
        `distance`, metres, `incidence`, radians, and those of `LIMITS` that are known.
    depth : (N,) float64
        Depths of its points, metres.
    task, camera
        Thresholds, and the camera that has these figures.
    hider : str
        Name of the occluder.
    unit : {"m", "unit"}
        Of lengths.
    """
    text = LARGER if camera.is_parallel and reason == "too_coarse" else REASONS[reason].advice
    return advice_of(text, figures, depth, task, camera.depth_of_field(task.max_blur), hider, unit)


def advice_of(
    template: str,
    figures: ReadByName,
    depth: Sequence[float] | FloatArray,
    task: Task,
    focus: Sequence[float],
    hider: str,
    unit: str,
) -> str:
    """`advice` of a template of `REASONS`, with the ends of the depth of field."""
    short = short_of(figures, task, unit)
    if "{found}" in template and short is None:
        return GENERAL["too_coarse"]
    most = Short(1.0, "", "") if short is None else short
    return template.format(
        wider=" or use a wider lens" if min(depth) > 1e-9 else "",
        depth=depth_in_words(depth, unit),
        in_focus=focus_in_words(focus, unit),
        found=most.found,
        wanted=most.wanted,
        distance=in_words(figures["distance"], unit),
        nearer=in_words(figures["distance"] / most.factor, unit),
        times=f"{number(most.factor, 2)} times",
        hider=f'"{hider}"' if hider else SOMETHING,
        angle=f"{math.degrees(figures['incidence']):.3g}",
        max_angle=f"{task.max_incidence_deg:g}",
    )


def verdict_of(
    size: str, views: int, need: int, cameras: int, why: str, *, is_covered: bool, apart: str = ""
) -> str:
    """One line on a face of a size, by how many of the cameras cover it, and the nearest reason."""
    seen = f"Face of {size}: covered by {views} camera{'' if views == 1 else 's'}"
    if is_covered:
        return f"{seen}."
    if views > 0:
        return f"{seen}; {need} camera{'' if need == 1 else 's'}{apart} required."
    if cameras > 0:
        why = f"{why} in the camera that passes most criteria"
    return f"Face of {size}: not covered, {why if cameras > 0 else 'no cameras'}."


def verdict_of_rigs(size: str, device: str, why: str) -> str:
    """The same of rigs with a rule, by what fails in the nearest: nothing, or a reason."""
    if why == "":
        return f"Face of {size}: measured by a rig."
    who = f"{device} fails, " if device else ""
    return f"Face of {size}: not measured, {who}{why}."


def hidden_by(label: str, hider: str | None, share: float | None) -> str:
    """The label of a reason with what hides most of a face, and that share of it, where known."""
    if hider is None or share is None:
        return label
    by = f"occluded by {hider}"
    if label == "occluded":
        return f"{by}: {percent(share)} of the face"
    return label.replace("occluded", f"{by}, {percent(share)} of the face")


def general_advice(name: str) -> str:
    """Advice for a reason, by its name, without figures of a camera."""
    return GENERAL.get(name, REASONS[name].advice).format(hider=SOMETHING)


def depth_in_words(depth: Sequence[float] | FloatArray, unit: str) -> str:
    """Least and greatest depth: "0.4 to 0.6 m", or "0.4 m" where they are the same."""
    near, far = in_words(min(depth), unit), in_words(max(depth), unit)
    if near == far:
        return far
    return f"{near.removesuffix(' ' + far.split(' ')[1])} to {far}"


def focus_in_words(focus: Sequence[float], unit: str = "m") -> str:
    """Ends of a depth of field, with as many digits as tell them apart."""
    if math.isinf(focus[1]):
        return f"{in_words(focus[0], unit)} or more"
    text = f"{in_words(focus[0], unit)} to {in_words(focus[1], unit)}"
    metres = "m" if unit == "m" else "units"
    for digits in (4, 5, 6):
        if number(focus[0], digits - 1) == number(focus[1], digits - 1):
            text = f"{number(focus[0], digits)} to {number(focus[1], digits)} {metres}"
    return text


def figures_of_point(
    camera: Camera, pose: FloatArray, point: FloatArray, normal: FloatArray
) -> dict[str, float]:
    """Figures of a point of a surface with a unit normal.

    Densities are singular values of the derivative of the image, by central differences: on the
    surface, and for a target that faces the camera. They are 0 where there is no image. Of parallel
    rays the distance is the depth.
    """
    ray = point - pose[:3, 3]
    if camera.is_parallel:
        ray = dots(ray, pose[:3, 2]) * pose[:3, 2]
    distance = max(float(norm(ray)), 1e-300)
    steps = STEP_REL * distance * np.concatenate((np.eye(3), -np.eye(3)))
    with np.errstate(all="ignore"):
        ends = to_image(to_camera(point + steps, pose), camera)
        slopes = (ends[:3] - ends[3:]).T / (2 * STEP_REL * distance)
    slopes = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
    on_surface = matmul(slopes, np.eye(3) - np.outer(normal, normal))
    (most, least), (_, facing) = (
        np.linalg.svd(each, compute_uv=False).tolist() for each in (on_surface, slopes)
    )
    return {
        "distance": distance,
        "incidence": float(arccos(min(1.0, abs(float(dots(ray, normal))) / distance))),
        "pixel_density": least,
        "facing_density": facing,
        "pixels_per_m2": most * least,
    }


_NAMES = {value: name for name, value in EDITIONS["EN 62676-4:2015"].items()}
WORDS: dict[str, Callable[[Any], str]] = {
    "min_pixel_density": lambda value: f"with {density_text(value)} or more on the surface",
    "min_facing_density": lambda value: (
        f"with {density_text(value)} or more on a target facing the camera"
        + (f" ({_NAMES[value]})" if value in _NAMES else "")
    ),
    "min_pixels_per_m2": lambda value: f"with {density_text(value, 'px/m²')} or more",
    "max_incidence_deg": "at an incidence of {:g}° or less".format,
    "max_blur": "with a blur of {:g} px or less".format,
    "focus_rule": "with its centroid in focus".format,
    "min_visibility": lambda value: f"where {percent(value)} or more of it is visible",
}
"""Words for thresholds that differ from their defaults, those of features too."""
for _each in WORDINGS:
    WORDS |= _each.thresholds


def _score(task: ReadByName) -> str:
    """Words on the coverage score of a face."""
    cap = ", at most 1," if task["cap_resolution"] else ""
    least = f"{task['min_coverage']:g} or more" if task["min_coverage"] else "more than 0"
    score = f"(image area / {task['min_pixels']:g} px{cap} times visible share)"
    return f"with a coverage score {score} of {least}"


SCORE = ("min_pixels", "cap_resolution", "min_coverage")
"""Thresholds in `_score`."""


def task_in_words(
    task: ReadByName,
    views: Mapping[str, int] | None = None,
    *,
    by_face: bool = False,
    is_joint: bool = False,
) -> str:
    """Sentence on what counts as covered by thresholds, by default those of a `Task`.

    `views` are the cameras required per group, in place of those of the task; `is_joint` is true of
    rigs with a rule.
    """
    usual = asdict(Task())
    task = usual | dict(task)
    wanted = task["views"] if views is None else views
    few = 2 if task["min_angle_deg"] else 1  # to have an angle between them
    named = wanted if isinstance(wanted, Mapping) else {"": wanted}
    n = max(few, named.get("", 1))
    who, does = ("rig", "measure") if is_joint else ("camera", "see")
    said = [f"a {who} {does}s it" if n == 1 else f"{n} {who}s {does} it"]
    own = [f'{max(few, n)} for "{name}"' for name, n in named.items() if name]
    said[0] += f" ({', '.join(own)})" if own else ""
    if task["min_angle_deg"]:
        said.append(f"at least {task['min_angle_deg']:g}° apart")
    names = [*WORDS, *sorted(usual.keys() - {*WORDS, *SCORE, "views", "min_angle_deg"})]
    by_face = by_face or any(task[name] != usual[name] for name in OF_A_FACE)
    changed = [name for name in names if task[name] != usual[name]]
    more = [WORDS[at](task[at]) if at in WORDS else f"with {at} {task[at]}" for at in changed]
    more += [_score(task)] * by_face
    return f"A {'face' if by_face else 'point'} is covered if {', '.join(said + more)}."
