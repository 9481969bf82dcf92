"""Tables of a network for a terminal of 80 columns, and figures of cameras for tables."""

import math
import re
from collections.abc import Mapping

from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from rastercov.advice.headline import noun_of
from rastercov.base import (
    FloatArray,
    ReadByName,
    decimals_of,
    percent,
    plural,
    size_in_words,
    with_bound,
)
from rastercov.base.format import area, in_decimals, text_with_sign
from rastercov.core.camera import Camera
from rastercov.core.camera.projection import angles_of_view
from rastercov.core.coverage.evaluation import question_in
from rastercov.core.coverage.task import density_text
from rastercov.core.raster.contract import KIND_WORDS
from rastercov.placement.parts import MOST_ROWS, PartRow, entries_at, part_rows

STRAIGHT = 1e-4
"""Sine of the angle to the vertical below which a camera looks straight up or down."""
LITTLE = 0.01
"""Share of the result below which a camera adds little, and is named."""
LONGEST_NAME = 22
"""Characters of the name of a part in a table."""


def summary_table(summary: ReadByName, level: int | None = None, unit: str = "m") -> Table:
    """`Network.summary` for a terminal of 80 columns: parts or groups.

    Those with the least covered come first, at most `MOST_ROWS`, at a level of the tree of groups
    as for `rastercov.placement.parts.entries_at`. "main cause" is the reason of most of what is
    not covered, "faces %" the share of faces where the result is by face, and "% of coverable",
    where it differs, the covered share of the area that a camera outside all bodies can see. `unit`
    is of lengths, as of `rastercov.base.format.area`; a `noun` of the summary is a word for a pose.
    """
    views, by_area = summary["required_views"], "covered_area" in summary
    noun = summary.get("noun", noun_of(summary))
    title = f"Covered by {plural(n := summary.get('heads', summary['poses']), noun)}"
    title += " together" if n > 1 else ""
    title += f", {views} per {'point' if by_area else 'face'}" if views > 1 else ""
    if said := question_in(summary):
        title += f" {said['in_words']}"
    rows, has_seeable = part_rows(summary, level), bool(summary["unseeable_m2"]) or not by_area
    names = ("area", "covered %" if by_area else "faces %", *["% of\ncoverable"] * has_seeable)
    cells = [[_end_of(row.name), *_cells(row, unit, has_seeable)] for row in rows[:MOST_ROWS]]
    for row, own in zip(rows, cells, strict=False):
        own.append(row.reason)
    table = Table(title=title, title_justify="left", caption_justify="left")
    table.add_column("part" if summary["parts"] else "group", no_wrap=True, max_width=LONGEST_NAME)
    for at, name in enumerate(names, start=1):  # no figure is cut off
        texts = [*name.splitlines(), *(own[at] for own in cells)]
        width = max(map(cell_len, texts))
        table.add_column(name, justify="right", no_wrap=True, min_width=width)
    if any(own[-1] for own in cells):
        table.add_column("main cause")
    for own in cells:
        table.add_row(*map(Text, own[: len(table.columns)]))
    if rows[MOST_ROWS:]:
        table.caption = f"and {len(rows) - MOST_ROWS} more, see --json"
    occluders = [entry for entry in entries_at(summary, level or 1) if "covered" not in entry]
    for entry in occluders[:MOST_ROWS]:
        role = summary.get("goal_of_groups", {}).get(entry["name"], "occluder")
        table.add_row(Text(_end_of(entry["name"])), "", role, style="dim")
    return table


def _end_of(name: str) -> str:
    """The name of a part, without its beginning where it is long: that is what parts share."""
    return name if len(name) <= LONGEST_NAME else f"...{name[3 - LONGEST_NAME :]}"


def _cells(row: PartRow, unit: str, has_seeable: bool) -> list[str]:
    """Figures of a part."""
    shares = row.percent, *[row.of_seeable_percent] * has_seeable
    texts = ["" if each is None else percent(each / 100).removesuffix(" %") for each in shares]
    if row.bound_percent > 0 or row.percent == 0:
        texts[0] = with_bound(row.percent, row.bound_percent).removesuffix(" %")
    return [area(row.area_m2, unit), *texts]


def run_table(summary: ReadByName) -> Table:
    """Size, speed and device of a run, from the summary of `run`."""
    table = Table(show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row("faces", f"{summary['faces']:,}")
    table.add_row("size", size_in_words(summary["size_m"]))
    table.add_row("poses", f"{summary['poses']:,}")
    table.add_row("poses per second", f"{summary['poses_per_second']:,.1f}")
    by = summary["run"]["measured_by"]
    method = "" if by["backend"] == "analytic" else f"sampled, {by['backend']}, "
    table.add_row("method", Text(method + by["renderer"]))
    eye = summary["run"].get("camera")
    if isinstance(eye, Mapping) and eye.get("model") == "telecentric":
        across, down = (density_text(eye[name]) for name in ("fx", "fy"))
        table.add_row("resolution", f"{across} along the width, {down} along the height")
    pairs = [(word, summary["visibility_figures"][kind]) for kind, word in KIND_WORDS.items()]
    kinds = ", ".join(f"{word} for {n:,}" for word, n in pairs if n)
    if kinds:
        most = summary["largest_visibility_bound"]
        bound = f"visible fraction {kinds}{f'; within ±{most:.2g}' if most else ''}"
        table.add_row("pose-face pairs", bound)
    return table


def heading_and_tilt(pose: FloatArray) -> tuple[float, float]:
    """Direction of a camera in degrees, z up: counter-clockwise from +x, and down from level.

    The heading of a camera that looks straight up or down has no meaning.
    """
    x, y, z = pose[:3, 2].tolist()
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y)))


def mounting_angles(pose: FloatArray, north: float | None = None) -> tuple[float, float, float]:
    """Heading, tilt and roll of a camera in degrees, z up, by which it is mounted.

    The heading is counter-clockwise from +x; with a `north`, degrees counter-clockwise from +x
    itself, it is clockwise from that, 0 to 360. The tilt is down from level, the roll clockwise
    for who looks along the camera. One that looks straight down or up is turned by its heading
    alone: that of the top of its image in the first case, of the bottom in the second.
    """
    heading, tilt = heading_and_tilt(pose)
    roll = math.degrees(math.atan2(-pose[2, 0], -pose[2, 1]))
    if math.hypot(*pose[:2, 2].tolist()) < STRAIGHT:
        x, y = (-math.copysign(1.0, tilt) * pose[:2, 1]).tolist()
        heading, roll = math.degrees(math.atan2(y, x)), 0.0
    if north is not None:
        heading = round((north - heading) % 360, 1) % 360
    return heading, tilt, roll


def lens_text(camera: Camera) -> str:
    """Focal length and f-number of a camera; its field of view where metres are not known."""
    if camera.is_parallel:
        return (
            f"{camera.fx:.4g} px/m" if not camera.magnification else f"{camera.magnification:.3g}x"
        )
    if camera.focal_length is None:
        across, down = angles_of_view(camera)
        return f"{in_decimals(across, 0)} x {in_decimals(down, 0)}°"
    stop = camera.aperture and f" f/{camera.focal_length / camera.aperture:.2g}"
    return f"{1e3 * camera.focal_length:.3g} mm{stop or ''}"


def camera_words(camera: Camera) -> str:
    """Camera and lens as they are sold, pixels, focal length and angles of view, in one line."""
    size = f"{camera.width} x {camera.height} px"
    if camera.is_parallel:
        lens = lens_text(camera)
        view = size_in_words((camera.width / camera.fx, camera.height / camera.fy))
    else:
        angles = angles_of_view(camera)
        digits = max(1, decimals_of(min(angles)) - 1)
        view = f"{' x '.join(text_with_sign(each, digits) for each in angles)}°"
        lens = "" if camera.focal_length is None else lens_text(camera)
        lens = "" if not lens or camera.product.endswith(lens) else f"{lens} lens"
    return ", ".join(filter(None, (camera.product, size, lens, f"field of view {view}")))


def shares_by_type(summary: ReadByName) -> list[str]:
    """Name of each type of camera, and the share that it covers alone; often none."""
    return [
        f"{each['camera']} {percent(each.get('covered_area', each['covered'])['percent'] / 100)}"
        for each in summary.get("by_camera", ())
    ]


def source_of(origin: str) -> str:
    """Origin of a camera in words: its number is that of a face, or counts from 0."""
    text = re.sub(r"^((?:cavity|in ).*)(?= \d)", r"\1 at face", origin)
    text = re.sub("^existing", "kept: existing", text)
    return re.sub(r"^((?:kept: existing|facade|orbit|poses|strips).* \d+)", r"\1 (from 0)", text)
