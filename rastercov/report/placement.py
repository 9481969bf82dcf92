"""A placement for people: one HTML page that needs nothing else, with figures, bounds, pictures.

Last of placement: everything that is known about a network in, one file out. What is not given has
no section, so that a check of a network that somebody else made has a page, too. The words and
tables of each section are in `page_sections`.
"""

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

from PIL import Image

from rastercov.report import placement_pictures as pictures
from rastercov.report import placement_plots as plots
from rastercov.report import placement_sections as sections
from rastercov.report.canvas import DARK, LIGHT
from rastercov.report.figures import write_text
from rastercov.report.html import document, picture, png
from rastercov.report.placement_report import PlanReport

__all__ = ["PlanReport", "page", "write_page"]

Draw = Callable[[], Image.Image]
Progress = Callable[[int, int], None]


def write_page(
    path: str | Path, report: PlanReport, progress: Progress = lambda done, total: None
) -> Path:
    """Write the page of a report, and give its path; it appears there only when it is whole.

    Parameters
    ----------
    path : str or Path
        In a folder that exists.
    report : PlanReport
    progress : callable
        Called with the pictures drawn and the pictures in all.
    """
    write_text(path, page(report, progress))
    return Path(path)


def page(report: PlanReport, progress: Progress = lambda done, total: None) -> str:
    """HTML of a report, pictures inline; arguments as for `write_page`."""
    drawn = _drawn(report, progress)
    body = [
        f"<h1>{escape(report.title)}</h1>",
        sections.scene(report),
        sections.verdict(report),
        *sections.cameras(report, drawn),
        *sections.coverage(report, drawn),
        *sections.leftover(report, drawn),
        *sections.selection(report, drawn),
        *sections.tolerance(report),
        *sections.colophon(report),
    ]
    return document(report.title, body)


def _drawn(report: PlanReport, progress: Progress) -> dict[str, str]:
    """The pictures of a report as elements of a page, by name."""
    mesh, network = report.mesh, report.network
    parts: dict[str, tuple[str, Draw]] = {
        "network": (
            "The cameras around the part, from two sides",
            lambda: pictures.network_picture(
                mesh, report.camera, report.poses, network.best_pose, report.names
            ),
        ),
        "coverage": (
            "The part coloured by best coverage",
            lambda: pictures.coverage_picture(mesh, network.best),
        ),
    }
    if left := report.leftover:
        parts["leftover"] = (
            "Faces that are not covered, by reason",
            lambda: pictures.leftover_picture(left),
        )
    if segments := report.segmentation:
        parts["segments"] = (
            "The segments of the part",
            lambda: pictures.segments_picture(mesh, segments),
        )
    charts: dict[str, tuple[str, Callable[[Any], Image.Image]]] = {
        "groups": ("Covered part of each group", lambda theme: plots.group_bars(network, theme)),
        "overlap": (
            "Part of the area by number of cameras",
            lambda theme: plots.overlap_histogram(network, theme),
        ),
    }
    if (found := report.selection) and (goal := report.goal):
        charts["curve"] = (
            "Coverage by number of cameras",
            lambda theme: plots.coverage_curve(found, goal, theme),
        )
    total = len(parts) + len(charts)
    drawn: dict[str, str] = {}
    for name, (words, draw) in parts.items():
        progress(len(drawn), total)
        drawn[name] = picture(words, png(draw(), Image.Quantize.FASTOCTREE))
    for name, (words, chart) in charts.items():
        progress(len(drawn), total)
        light, dark = (png(chart(theme), Image.Quantize.MEDIANCUT) for theme in (LIGHT, DARK))
        drawn[name] = picture(words, light, dark)
    progress(total, total)
    return drawn
