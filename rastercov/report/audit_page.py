"""Page of an audit: headline, pictures of the surface, and the figures of each camera."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.format import area, percent, plural
from rastercov.coverage.area.network import in_words
from rastercov.mesh import Mesh
from rastercov.placement.audit import Audit
from rastercov.report import theme
from rastercov.report.html import Picture, rendered
from rastercov.report.images import Key
from rastercov.report.placement_pictures import ALL_SIDES, key, two_sides

FloatArray = NDArray[np.float64]

MOST_ROWS = 400
"""Cameras in the table of a page; cameras.parquet has all."""
MOST_VIEWS = 8
"""Views from which on all have one colour."""
MOST_LINES = 8
"""Cameras with a line of their own; audit.json has all."""
HEADINGS = ("image", "camera", "sees", "lost without it", "by it alone", "in the smallest set")


def pictures_of(found: Audit) -> dict[str, Picture]:
    """Pictures of the elements by number of views, best density and widest angle."""
    on = found.mesh if found.cells is None else found.cells.elements
    eyes = found.poses.world_from_camera[:, :3, 3]
    drawn = {"views": _views(found, on, eyes)}
    if found.views.any():
        drawn["density"] = _scaled(
            on, found.best_density, found.views > 0, eyes, "Best pixel density", "px/m", is_log=True
        )
    if (found.views > 1).any():
        drawn["angle"] = _scaled(
            on, np.degrees(found.widest_angle), found.views > 1, eyes,
            "Widest angle between two views", "°", is_log=False,
        )  # fmt: skip
    return {f"audit_{name}": picture for name, picture in drawn.items()}


def _views(found: Audit, on: Mesh, eyes: FloatArray) -> Picture:
    most = max(1, min(MOST_VIEWS, int(found.views.max(initial=0))))
    scale = theme.coverage_colours()
    levels = scale[theme.level_rows(np.arange(most + 1) / most)]
    colours = levels[np.minimum(found.views, most)]
    colours[~on.task_mask] = theme.OCCLUDER_PALE
    keys = [key("no view", tuple(levels[0]))]
    keys += [
        key(plural(n, "view") + (" or more" if n == most else ""), tuple(levels[n]))
        for n in range(1, most + 1)
    ]
    image = two_sides(on, colours, "Views of each part of the surface", keys, ALL_SIDES, eyes=eyes)
    return Picture.of("the surface coloured by the number of views", image)


def _scaled(
    on: Mesh, values: FloatArray, is_known: NDArray[np.bool_], eyes: FloatArray, title: str,
    unit: str, *, is_log: bool,
) -> Picture:  # fmt: skip
    """Elements coloured by a figure, between the values that 2 and 98 % of the area lie below."""
    low, high = _limits(values[is_known], on.areas[is_known])
    level = np.zeros(len(values))
    if is_log:
        low = max(low, 1e-12)
        high = max(high, low * (1 + 1e-9))
        level[is_known] = np.log(np.maximum(values[is_known], low) / low) / np.log(high / low)
    else:
        high = max(high, low + 1e-9)
        level[is_known] = (values[is_known] - low) / (high - low)
    scale = theme.coverage_colours()
    colours = scale[theme.level_rows(np.clip(level, 1e-9, 1))]
    colours[~is_known] = theme.COVERED
    colours[~on.task_mask] = theme.OCCLUDER_PALE
    bar = np.repeat(scale[None, 2:], 24, axis=0)
    ends = f"{rounded(low)} {unit}", f"{rounded(high)} {unit}"
    keys = [Key(title.lower() + (", by factors" if is_log else ""), bar, *ends)]
    if not is_known[on.task_mask].all():
        keys.append(key("too few views", theme.COVERED))
    image = two_sides(on, colours, title, keys, ALL_SIDES, eyes=eyes)
    return Picture.of(f"the surface coloured by {title.lower()}", image)


def rounded(value: float) -> str:
    """A figure with three digits, without an exponent."""
    return f"{float(f'{value:.3g}'):,.10g}"


def _limits(values: FloatArray, areas: FloatArray) -> tuple[float, float]:
    order = np.argsort(values)
    below = np.cumsum(areas[order])
    low, high = np.searchsorted(below, [0.02 * below[-1], 0.98 * below[-1]])
    last = len(order) - 1
    return float(values[order[min(low, last)]]), float(values[order[min(high, last)]])


def page(
    found: Audit, summary: Mapping[str, Any], cameras: tuple[str, ...],
    pictures: Mapping[str, Picture],
) -> str:  # fmt: skip
    """HTML of an audit and its summary; `cameras` are the names of the cameras."""
    subset = summary["subset"]
    chosen = np.zeros(len(found.poses), np.bool_)
    chosen[found.subset.chosen] = True
    order = np.lexsort((-found.seen_m2, -found.lost_m2))
    rows = [
        (
            found.names[row],
            cameras[found.poses.camera[row]],
            area(float(found.seen_m2[row])),
            area(float(found.lost_m2[row])),
            area(float(found.alone_m2[row])),
            "yes" if chosen[row] else "",
        )
        for row in order[:MOST_ROWS].tolist()
    ]
    exact = summary.get("covered_area")
    lines = [
        f"median density {rounded(summary['median_density_px_per_m'])} px/m, "
        f"median angle between views {summary['median_widest_angle_deg']:.3g}°",
        f"{plural(subset['cameras'], 'image', 'cover')} the same; "
        f"none fewer than {subset['bound']:g}",
        f"{summary['redundant_cameras']:,} could be left out one at a time",
        *group_lines(summary),
    ]
    return rendered(
        "audit.html",
        title="rastercov audit",
        heading="Audit of existing cameras",
        answer=f"{plural(summary['cameras'], 'image', 'cover')} "
        f"{percent(summary['covered_percent'] / 100)} of the surface",
        exact="" if exact is None else in_words(exact),
        lines=lines,
        summary=summary,
        headings=HEADINGS,
        rows=rows,
        n_more=max(0, len(found.poses) - MOST_ROWS),
        pictures=list(pictures.values()),
    )


def group_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines on the frames of an audit and on each of its cameras; often none."""
    lines = []
    if "frames" in summary:
        frames = summary["frames"]
        lines.append(
            f"{frames['subset']['cameras']} of {frames['count']:,} frames cover the same; none "
            f"fewer than {frames['subset']['bound']:g}; {frames['redundant']:,} could be left out "
            "one at a time"
        )
    cameras = summary.get("by_camera", ())
    for entry in cameras[:MOST_LINES]:
        lost = f"{area(entry['lost_m2'])} is" if entry["lost_m2"] > 0 else "nothing is"
        lines.append(
            f"{entry['camera']}: {plural(entry['poses'], 'image', 'see')} "
            f"{area(entry['seen_m2'])}, "
            f"{lost} lost without them"
        )
    if cameras[MOST_LINES:]:
        lines.append(f"{len(cameras) - MOST_LINES} more cameras are in audit.json")
    return lines
