"""Plots of a network: coverage by group, by number of cameras, and how often faces are covered.

Part of `page`: from plain values to `PIL.Image`, in a light or a dark theme.
"""

from collections.abc import Sequence

from PIL import Image, ImageFont

from rastercov.network import Network, share_of_faces
from rastercov.placement.select.problem import BestCoverage, FewestCameras, Goal
from rastercov.placement.select.selection import Selection
from rastercov.plan.requirements import percent
from rastercov.report.canvas import FINE, WIDTH, Canvas, Curve, LinearAxis, Theme, line_plot
from rastercov.report.images import cut

BAR, ROW = 16.0, 30.0
"""Height of a bar and of its row."""
MOST_GROUPS = 24
"""Groups in a plot: those of the greatest area."""


def group_bars(network: Network, theme: Theme) -> Image.Image:
    """Part of each group's area that is covered, the largest groups first."""
    mesh = network.mesh
    rows = []
    for index, group in enumerate(mesh.groups):
        members = mesh.face_group == index
        if not group.is_occluder and members.any():
            share = share_of_faces(mesh, members & network.covered, members)
            rows.append((float(mesh.areas[members].sum()), group.name, share))
    rows.sort(key=lambda row: -row[0])
    left_out = len(rows) - MOST_GROUPS
    bars = [
        (name, share["area_percent"] / 100, f"{percent(share['area_percent'] / 100)} of the area")
        for _, name, share in rows[:MOST_GROUPS]
    ]
    note = f"and {left_out} smaller groups, see the table" if left_out > 0 else ""
    return _bars("Covered, by group", bars, theme, 0, note)


def overlap_histogram(network: Network, theme: Theme) -> Image.Image:
    """Part of the task's area that so many cameras cover."""
    mesh, need = network.mesh, network.task.views
    task = mesh.task_mask
    most = int(network.views[task].max(initial=0))
    last = min(most, max(need, 11))
    bars = []
    for count in range(last + 1):
        beyond = count == last and most > last
        faces = task & ((network.views >= count) if beyond else (network.views == count))
        share = share_of_faces(mesh, faces, task)["area_percent"] / 100
        word = "camera" if count == 1 else "cameras"
        bars.append((f"{count}{'+' if beyond else ''} {word}", share, percent(share)))
    note = f"a face is covered from {need} on" if need > 1 else ""
    return _bars("Part of the area that so many cameras cover", bars, theme, need, note)


def coverage_curve(selection: Selection, goal: Goal, theme: Theme) -> Image.Image:
    """Coverage by the first cameras of a selection, and the bound that none can pass."""
    shares = [0.0, *selection.curve.tolist()]
    points = list(enumerate(shares))
    curves = [Curve("the cameras chosen, the best next", points, theme.series[0])]
    marks: list[tuple[str, float, str]] = []
    most = max(1, len(selection.chosen))
    if isinstance(goal, BestCoverage):
        words = f"none covers more than {percent(selection.bound)}"
        marks.append(("y", selection.bound, words))
    else:
        marks.append(("y", shares[-1], f"{percent(shares[-1])} is covered"))
        if float(selection.bound).is_integer() and selection.cost == len(selection.chosen):
            marks.append(("x", selection.bound, f"fewer than {selection.bound:g} cannot do it"))
    return line_plot(
        "Coverage by number of cameras",
        LinearAxis("cameras", 0, max(most, 2), is_whole=True),
        LinearAxis(_of(goal), 0, 1.04, is_percent=True),
        curves,
        theme,
        marks=marks,
    )


def _of(goal: Goal) -> str:
    reachable = isinstance(goal, FewestCameras) and goal.of_reachable
    return "covered (of everything)" if reachable else "covered"


def _bars(
    title: str,
    bars: Sequence[tuple[str, float, str]],
    theme: Theme,
    good_from: int,
    note: str,
) -> Image.Image:
    """Horizontal bars from 0 to 1 with their names before and words after them.

    Bars before `good_from` are in the second colour of the theme.
    """
    height = 52 + ROW * len(bars) + (24 if note else 0)
    canvas = Canvas(title, theme, round(height))
    font = ImageFont.load_default(float(15 * FINE))
    names = [cut(name, font, 0.34 * WIDTH * FINE) for name, _, _ in bars]
    left = 26 + max(float(font.getlength(name)) / FINE for name in names)
    room = max(float(font.getlength(words)) / FINE for _, _, words in bars)
    right = WIDTH - room - 26
    for row, (name, (_, share, words)) in enumerate(zip(names, bars, strict=True)):
        y = 44 + ROW * row + ROW / 2
        canvas.text((left - 10, y), name, 15, theme.ink, "rm")
        canvas.box((left, y - BAR / 2), (right, y + BAR / 2), theme.grid)
        colour = theme.series[0 if row >= good_from else 1]
        end = left + min(1.0, max(0.0, share)) * (right - left)
        if end > left:
            canvas.box((left, y - BAR / 2), (end, y + BAR / 2), colour)
        canvas.text((right + 10, y), words, 15, theme.ink)
    if note:
        canvas.text((left, height - 16), note, 14, theme.soft)
    return canvas.done()
