"""Content of a placement page, with all its pictures and plots.

Pictures show the part from two sides, in colours that their legends explain.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, figures 6.2
to 6.11.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov.base.errors import ConfigError
from rastercov.base.format import percent, plural
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.area.union import unite
from rastercov.coverage.area.zones import DeadZones
from rastercov.coverage.network import Network, share_of_faces
from rastercov.coverage.reasons import reason_rows
from rastercov.mesh import Mesh
from rastercov.placement.select.problem import BestCoverage, FewestCameras, Goal
from rastercov.report.camera_pictures import MANY, SIDE, SMALL, camera_picture, of_pose
from rastercov.report.html import Picture
from rastercov.report.modes import mode_picture
from rastercov.report.overview import (
    CameraColours,
    best_covering,
    best_picture,
    camera_colours,
    network_picture,
    overview_picture,
    views_picture,
)
from rastercov.report.panorama import best_directions
from rastercov.report.plots import Axis, Curve, bar_plot, line_plot, picture_of
from rastercov.report.theme import DARK, LIGHT, Theme
from rastercov.report.zone_pictures import zones_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rastercov.placement.candidates.cavities import Openings
    from rastercov.placement.candidates.clearance import Dropped
    from rastercov.placement.candidates.pool import Candidates
    from rastercov.placement.candidates.segments import Segmentation
    from rastercov.placement.improve.tolerance import Tolerance
    from rastercov.placement.select.problem import Selection
    from rastercov.placement.uncovered import Leftover

Progress = Callable[[int, int], None]
FloatArray = NDArray[np.float64]

MAX_GROUPS = 24
"""Groups in a plot: those of the greatest area."""
MOST_BARS = 11
"""Largest number of cameras that has a bar of its own, unless more are needed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanReport:
    """Content of a placement page; None and empty for unknown parts."""

    mesh: Mesh
    camera: Cameras
    network: Network  # of all cameras, in the order of `poses`
    poses: NDArray[np.float64]  # world_from_camera, (K, 4, 4)
    camera_of: NDArray[np.int32] | None = None  # index of the camera of each pose, (K,)
    mount_of: NDArray[np.int64] | None = None  # row of the rig that each camera is on, (K,)
    title: str = "Placement of cameras"
    selection: "Selection | None" = None  # with its goal; both or none
    goal: Goal | None = None
    candidates: "Candidates | None" = None  # all of them; `selection.chosen` has rows of them
    dropped: "Dropped | None" = None  # candidates that were rejected before the selection
    segmentation: "Segmentation | None" = None
    leftover: "Leftover | None" = None
    openings: "Openings | None" = None
    tolerance: "Tolerance | None" = None
    camera_names: Sequence[str] = ()  # K; 1, 2, ... unless given
    sources: Sequence[str] = ()  # of each pose, K; taken from `candidates` unless given
    made_with: Mapping[str, Any] = field(default_factory=dict)  # for the end of the page
    notes: Sequence[str] = ()  # sentences for the top of the page
    summary: Mapping[str, Any] | None = None  # figures; those of the network unless given
    regions: Regions | None = None  # of the poses, where the result is by area
    zones: DeadZones | None = None  # of them, with `dead_zones` in `summary`

    def __post_init__(self) -> None:
        count = len(self.network.pose_ids)
        if len(self.poses) != count:
            raise ConfigError(
                f"the network has {count} cameras, got {len(self.poses)} poses; add each to it"
            )
        for name in ("camera_names", "sources"):
            if len(getattr(self, name)) not in (0, count):
                raise ConfigError(
                    f"{name} must be {count} words, one a camera, got {len(getattr(self, name))}"
                )

    @property
    def placed(self) -> Poses:
        """The poses with the camera of each."""
        return Poses.of(self.poses, camera=self.camera_of)

    @property
    def types(self) -> list[str]:
        """Name of the camera of each pose; "" where there is one."""
        names = names_of(self.camera)
        return [names[index] if len(names) > 1 else "" for index in self.placed.camera]

    @property
    def mounts(self) -> NDArray[np.int64]:
        """(K,) row of the rig that each camera is on; its own where there are no rigs."""
        return np.arange(len(self.poses)) if self.mount_of is None else self.mount_of

    @property
    def mount_names(self) -> list[str]:
        """Names of the cameras of each rig, as one text."""
        rows, names = self.mounts, self.names
        count = int(rows.max(initial=-1)) + 1
        return [
            ", ".join(name for name, row in zip(names, rows, strict=True) if row == mount)
            for mount in range(count)
        ]

    @property
    def names(self) -> list[str]:
        """Names of the cameras."""
        return list(self.camera_names) or [str(row + 1) for row in range(len(self.poses))]

    @property
    def colours(self) -> CameraColours:
        """Colours of the surface by its cameras."""
        best = best_covering(self.network)
        return camera_colours(self.mesh, self.placed, best, self.names, self.regions)

    @property
    def origins(self) -> list[str]:
        """Source of each pose, "" where it is unknown."""
        if self.sources:
            return list(self.sources)
        if self.candidates is None or self.selection is None:
            return [""] * len(self.poses)
        chosen = self.candidates.take(self.selection.chosen)
        if len(chosen) != len(self.poses):
            return [""] * len(self.poses)
        return [
            f"{source} {index}" if index >= 0 else str(source)
            for source, index in zip(chosen.source, chosen.index, strict=True)
        ]


def drawn_for(report: PlanReport, progress: Progress) -> dict[str, Any]:
    """Pictures and plots of a report by name; "cameras" has a picture for each camera."""
    drawings = _drawings(report)
    n_cameras = len(report.poses)
    total = len(drawings) + n_cameras
    drawn: dict[str, Any] = {}
    for done, (name, (alt, draw)) in enumerate(drawings.items()):
        progress(done, total)
        drawn[name] = draw(alt)
    drawn["cameras"] = []
    colours, side = report.colours.colours, SIDE if n_cameras <= MANY else SMALL
    cameras, placed = cameras_of(report.camera), report.placed
    for row, (name, pose) in enumerate(zip(report.names, report.poses, strict=True)):
        progress(len(drawings) + row, total)
        image = camera_picture(
            report.mesh,
            cameras[placed.camera[row]],
            pose,
            report.network.task,
            f"{name}, {report.types[row]}," if report.types[row] else name,
            colours[row],
            None if report.regions is None else of_pose(report.regions, row),
            side,
        )
        drawn["cameras"].append(Picture.of(f"What camera {name} sees and covers", image))
    progress(total, total)
    return drawn


def _drawings(report: PlanReport) -> dict[str, tuple[str, Callable[[str], Picture]]]:
    """Pictures of the part and plots by name: a description, and the function that draws it."""
    mesh, network, eyes = report.mesh, report.network, report.poses[:, :3, 3]
    regions, summary = report.regions, report.summary or {}

    def part(draw: Callable[..., Image.Image], *given: Any) -> Callable[[str], Picture]:
        return lambda alt: Picture.of(alt, draw(*given))

    def plot(draw: Callable[..., "Figure"], *given: Any) -> Callable[[str], Picture]:
        return lambda alt: picture_of(alt, draw(LIGHT, *given), draw(DARK, *given))

    parts = {
        "overview": (
            "The task in the colours of its cameras, and a floor plan",
            part(overview_picture, report.colours, report.camera),
        ),
        "network": (
            "The cameras around the part, from two sides",
            part(network_picture, report.colours, report.camera),
        ),
    }
    if regions is None:
        parts["coverage"] = (
            "The part coloured by best coverage",
            part(best_picture, mesh, network.best, eyes),
        )
    else:
        parts["coverage"] = (
            "The part coloured by the number of cameras that cover each point",
            lambda alt: Picture.of(
                alt,
                views_picture(unite(regions, len(summary["covered_area"]["by_views"])), eyes),
            ),
        )
    if (zones := report.zones) is not None:
        if len(zones):
            parts["zones"] = (
                "Dead zones by number and reason",
                part(zones_picture, zones, summary, eyes),
            )
    elif left := report.leftover:
        parts["leftover"] = (
            "Faces that are not covered, by reason",
            part(leftover_picture, left, eyes),
        )
    if segments := report.segmentation:
        parts["segments"] = ("The segments of the part", part(segments_picture, mesh, segments))
    parts["groups"] = ("Covered part of each group", plot(group_bars, network, report.summary))
    parts["overlap"] = (
        "Part of the area by number of cameras",
        plot(overlap_histogram, network, regions),
    )
    if report.selection and report.goal:
        of = "cells" if regions is not None else "everything"
        parts["curve"] = (
            "Coverage by number of cameras",
            plot(coverage_curve, report.selection, report.goal, of),
        )
    return parts


def segments_picture(mesh: Mesh, segmentation: "Segmentation") -> Image.Image:
    """The part with one colour a segment; figures 6.2 to 6.9."""
    beta = "" if segmentation.beta_deg is None else f", beta {segmentation.beta_deg:g}°"
    title = f"{segmentation.n_segments} segments (alpha {segmentation.alpha_deg:g}°{beta})"
    return mode_picture("segments", mesh, segmentation.labels, title=title)


def leftover_picture(leftover: "Leftover", eyes: ArrayLike = ()) -> Image.Image:
    """Faces that no camera covers, by reason, from the directions that show most of them."""
    mesh, left = leftover.mesh, leftover.left
    share = share_of_faces(mesh, left, mesh.task_mask)
    return mode_picture(
        "reason", mesh, reason_rows(leftover.reason, ~left, leftover.n_cameras), eyes,
        title=f"Not covered: {plural(int(share['faces']), 'face')}, "
        f"{percent(share['area_percent'] / 100)} of the area",
        directions=best_directions(mesh, left, eyes=eyes), through=left,
    )  # fmt: skip


def group_bars(
    theme: Theme, network: Network, summary: Mapping[str, Any] | None = None
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


def overlap_histogram(theme: Theme, network: Network, regions: Regions | None = None) -> "Figure":
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
    theme: Theme, selection: "Selection", goal: Goal, of: str = "everything"
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
