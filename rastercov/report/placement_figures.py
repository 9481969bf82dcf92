"""All pictures and plots of a placement page."""

from collections.abc import Callable, Mapping
from typing import Any

from PIL import Image

from rastercov.camera.rig import cameras_of
from rastercov.coverage.area.union import unite
from rastercov.report import placement_pictures as pictures
from rastercov.report import placement_plots as plots
from rastercov.report.camera_pictures import MANY, SIDE, SMALL, camera_picture, of_pose
from rastercov.report.html import Picture
from rastercov.report.overview import network_picture, overview_picture
from rastercov.report.placement_report import PlanReport
from rastercov.report.plots import picture_of
from rastercov.report.theme import DARK, LIGHT, Theme
from rastercov.report.zone_pictures import zones_picture

Progress = Callable[[int, int], None]


def drawn_for(report: PlanReport, progress: Progress) -> dict[str, Any]:
    """Pictures and plots of a report by name; "cameras" has a picture for each camera."""
    network, summary = report.network, report.summary or {}
    charts: dict[str, tuple[str, Callable[[Theme], Any]]] = {
        "groups": (
            "Covered part of each group",
            lambda theme: plots.group_bars(network, theme, report.summary),
        ),
        "overlap": (
            "Part of the area by number of cameras",
            lambda theme: plots.overlap_histogram(network, theme, report.regions),
        ),
    }
    if (found := report.selection) and (goal := report.goal):
        charts["curve"] = (
            "Coverage by number of cameras",
            lambda theme: plots.coverage_curve(
                found, goal, theme, "cells" if report.regions is not None else "everything"
            ),
        )
    parts = _parts(report, summary)
    n_cameras, done = len(report.poses), 0
    total = len(parts) + len(charts) + n_cameras
    drawn: dict[str, Any] = {"cameras": []}
    for name, (alt, draw) in parts.items():
        progress(done, total)
        drawn[name] = Picture.of(alt, draw())
        done += 1
    for name, (alt, chart) in charts.items():
        progress(done, total)
        drawn[name] = picture_of(alt, chart(LIGHT), chart(DARK))
        done += 1
    colours, side = report.colours.colours, SIDE if n_cameras <= MANY else SMALL
    cameras, placed = cameras_of(report.camera), report.placed
    for row, (name, pose) in enumerate(zip(report.names, report.poses, strict=True)):
        progress(done, total)
        title = f"{name}, {report.types[row]}," if report.types[row] else name
        own = None if report.regions is None else of_pose(report.regions, row)
        image = camera_picture(
            report.mesh,
            cameras[placed.camera[row]],
            pose,
            network.task,
            title,
            colours[row],
            own,
            side,
        )
        drawn["cameras"].append(Picture.of(f"What camera {name} sees and covers", image))
        done += 1
    progress(total, total)
    return drawn


def _parts(
    report: PlanReport, summary: Mapping[str, Any]
) -> dict[str, tuple[str, Callable[[], Image.Image]]]:
    """Pictures of the part by name: a description, and the function that draws it."""
    mesh, network, eyes = report.mesh, report.network, report.poses[:, :3, 3]
    parts: dict[str, tuple[str, Callable[[], Image.Image]]] = {
        "overview": (
            "The task in the colours of its cameras, and a floor plan",
            lambda: overview_picture(report.colours, report.camera),
        ),
        "network": (
            "The cameras around the part, from two sides",
            lambda: network_picture(report.colours, report.camera),
        ),
        "coverage": (
            "The part coloured by best coverage",
            lambda: pictures.coverage_picture(mesh, network.best, eyes),
        ),
    }
    if (regions := report.regions) is not None:
        views = len(summary["covered_area"]["by_views"])
        parts["coverage"] = (
            "The part coloured by the number of cameras that cover each point",
            lambda: pictures.views_picture(unite(regions, views), eyes),
        )
    if (zones := report.zones) is not None:
        if len(zones):
            parts["zones"] = (
                "Dead zones by number and reason",
                lambda: zones_picture(zones, summary, eyes),
            )
    elif left := report.leftover:
        parts["leftover"] = (
            "Faces that are not covered, by reason",
            lambda: pictures.leftover_picture(left, eyes),
        )
    if segments := report.segmentation:
        parts["segments"] = (
            "The segments of the part",
            lambda: pictures.segments_picture(mesh, segments),
        )
    return parts
