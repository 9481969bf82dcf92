"""Plots of a placement: coverage by group and by number of cameras, overlap of cameras."""

from typing import TYPE_CHECKING

from rastercov._format import percent
from rastercov.network import Network, share_of_faces
from rastercov.placement.select.problem import BestCoverage, FewestCameras, Goal
from rastercov.placement.select.selection import Selection
from rastercov.report.plots import Axis, Curve, bar_plot, line_plot
from rastercov.report.theme import Theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_GROUPS = 24
"""Groups in a plot: those of the greatest area."""


def group_bars(network: Network, theme: Theme) -> "Figure":
    """Share of each group's area that is covered, the largest groups first."""
    bars = group_shares(network)
    left_out = len(bars) - MAX_GROUPS
    note = f"and {left_out} smaller groups, see the table" if left_out > 0 else ""
    return bar_plot("Covered, by group", bars[:MAX_GROUPS], theme, note)


def group_shares(network: Network) -> list[tuple[str, float, str]]:
    """Name, covered share and its text for each task group, the largest first."""
    mesh = network.mesh
    rows = []
    for index, group in enumerate(mesh.groups):
        members = mesh.face_group == index
        if not group.is_occluder and members.any():
            share = share_of_faces(mesh, members & network.covered, members)["area_percent"] / 100
            rows.append((float(mesh.areas[members].sum()), group.name, share))
    rows.sort(key=lambda row: -row[0])
    return [(name, share, f"{percent(share)} of the area") for _, name, share in rows]


def overlap_histogram(network: Network, theme: Theme) -> "Figure":
    """Share of the task's area by the number of cameras that cover it."""
    need = network.task.views
    note = f"a face is covered from {need} on" if need > 1 else ""
    return bar_plot(
        "Area by number of covering cameras", overlap_shares(network), theme, note, need
    )


def overlap_shares(network: Network) -> list[tuple[str, float, str]]:
    """Number of cameras, share of the task's area that they cover, and its text."""
    mesh, task = network.mesh, network.mesh.task_mask
    most = int(network.views[task].max(initial=0))
    last = min(most, max(network.task.views, 11))
    bars = []
    for count in range(last + 1):
        is_open = count == last and most > last
        faces = task & ((network.views >= count) if is_open else (network.views == count))
        share = share_of_faces(mesh, faces, task)["area_percent"] / 100
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
