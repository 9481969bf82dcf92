"""Plots of a placement: coverage by group and by number of cameras, overlap of cameras."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rastercov.base.format import percent
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.area.union import unite
from rastercov.coverage.network import Network, share_of_faces
from rastercov.placement.select.problem import BestCoverage, FewestCameras, Goal
from rastercov.placement.select.selection import Selection
from rastercov.report.plots import Axis, Curve, bar_plot, line_plot
from rastercov.report.theme import Theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_GROUPS = 24
"""Groups in a plot: those of the greatest area."""
MOST_BARS = 11
"""Largest number of cameras that has a bar of its own, unless more are needed."""


def group_bars(
    network: Network, theme: Theme, summary: Mapping[str, Any] | None = None
) -> "Figure":
    """Share of each group's area that is covered, the largest groups first.

    By exact area where `summary`, of the network, has it.
    """
    bars = group_shares(network, summary)
    left_out = len(bars) - MAX_GROUPS
    note = f"and {left_out} smaller groups, see the table" if left_out > 0 else ""
    return bar_plot("Covered, by group", bars[:MAX_GROUPS], theme, note)


def group_shares(
    network: Network, summary: Mapping[str, Any] | None = None
) -> list[tuple[str, float, str]]:
    """Name, covered share and its text for each task group, the largest first."""
    mesh = network.mesh
    by_area = {
        group["name"]: group["covered_area"]["percent"] / 100
        for group in (summary or {}).get("groups", [])
        if "covered_area" in group
    }
    rows = []
    for index, group in enumerate(mesh.groups):
        members = mesh.face_group == index
        if not group.is_occluder and members.any():
            whole = share_of_faces(mesh, members & network.covered, members)["area_percent"] / 100
            share = by_area.get(group.name, whole)
            rows.append((float(mesh.areas[members].sum()), group.name, share))
    rows.sort(key=lambda row: -row[0])
    return [(name, share, f"{percent(share)} of the area") for _, name, share in rows]


def overlap_histogram(network: Network, theme: Theme, regions: Regions | None = None) -> "Figure":
    """Share of the task's area by the number of cameras that cover it.

    By exact area where the regions of the network are given, by whole faces otherwise.
    """
    need = network.task.views
    what = "a face" if regions is None else "a point"
    note = f"{what} is covered from {need} on" if need > 1 else ""
    bars = overlap_shares(network, regions)
    return bar_plot("Area by number of covering cameras", bars, theme, note, need)


def overlap_shares(
    network: Network, regions: Regions | None = None
) -> list[tuple[str, float, str]]:
    """Number of cameras, share of the task's area that they cover, and its text."""
    mesh, task = network.mesh, network.mesh.task_mask
    limit = max(network.task.views, MOST_BARS)
    if regions is None:
        most = int(network.views[task].max(initial=0))
        shares = [
            share_of_faces(mesh, task & (network.views >= count), task)["area_percent"] / 100
            for count in range(min(most, limit) + 1)
        ]
    else:
        covered = unite(regions, min(max(len(regions.pose_ids), 1), limit + 1))
        shares = [1.0, *(covered.share(count + 1) for count in range(len(covered.area)))]
        most = max(count for count, share in enumerate(shares) if share > 0)
    last = min(most, limit)
    bars = []
    for count in range(last + 1):
        is_open = count == last and most > last
        above = shares[count + 1] if count < last else 0.0
        share = shares[count] - above
        word = "camera" if count == 1 else "cameras"
        bars.append((f"{count}{'+' if is_open else ''} {word}", share, percent(share)))
    return bars


def coverage_curve(
    selection: Selection, goal: Goal, theme: Theme, of: str = "everything"
) -> "Figure":
    """Coverage by the first cameras of a selection, and the bound of any selection.

    `of` is named as the whole where it is not everything, such as "cells".
    """
    shares = [0.0, *selection.curve.tolist()]
    curves = [Curve("chosen cameras, best first", list(enumerate(shares)), theme.series[0])]
    marks: list[tuple[str, float, str]] = []
    if isinstance(goal, BestCoverage):
        marks.append(("y", selection.bound, f"none covers more than {percent(selection.bound)}"))
    else:
        marks.append(("y", shares[-1], f"{percent(shares[-1])} is covered"))
        if float(selection.bound).is_integer() and selection.cost == len(selection.chosen):
            marks.append(("x", selection.bound, f"fewer than {selection.bound:g} cannot do it"))
    of_all = isinstance(goal, FewestCameras) and goal.of_reachable
    return line_plot(
        "Coverage by number of cameras",
        Axis("cameras", 0, max(len(selection.chosen), 2), is_whole=True),
        Axis(
            f"covered (of {of})" if of_all or of != "everything" else "covered",
            0,
            1.04,
            is_percent=True,
        ),
        curves,
        theme,
        marks=marks,
    )
