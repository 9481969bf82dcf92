"""Report of an audit: a page, tables of elements and cameras, arrays, a coloured mesh, a summary.

audit.html         headline, pictures of the surface, what each image adds; audit.pdf on paper
audit_*.png        the surface by number of views, best density and widest angle
view.html          the same to look around in, without a server
elements.parquet   figures of each cell or face, and elements.npz the same
cameras.parquet    figures of each image
audit.glb          the surface coloured by the number of views
rig.json           the cameras and poses, where there are up to 5,000
audit.json         shares, medians, the smallest subset, and its provenance
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rastercov.base.format import area, percent, plural
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_bytes, write_json, write_npz, write_text
from rastercov.camera.rig import names_of
from rastercov.coverage.area.network import in_words
from rastercov.coverage.network import share_of_faces
from rastercov.coverage.provenance import provenance_of
from rastercov.coverage.shards import UNFINISHED, remove
from rastercov.placement.audit import Audit
from rastercov.report.coverage_files import write_coloured_mesh, write_rig, write_table
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.modes import MODES, mode_picture, rounded
from rastercov.report.pages import Picture, figures_of, rendered, view_page
from rastercov.report.printing import browser, write_page

AUDIT = ReportKind(
    "audit",
    re.compile(
        r"(elements|cameras)\.parquet|elements\.npz|audit\.(glb|json|html|pdf)|rig\.json|view\.html"
        r"|audit_[a-z]+\.png"
    ),
    last="audit.json",
)
MOST_ROWS = 400
"""Cameras in the table of a page; cameras.parquet has all."""
MOST_LINES = 8
"""Cameras with a line of their own; audit.json has all."""
HEADINGS = ("image", "camera", "sees", "lost without it", "by it alone", "in the smallest set")


def write(
    made: Callable[..., Audit],
    out: Path,
    options: Mapping[str, Any],
    notes: Sequence[str] = (),
    *,
    is_kept: bool = False,
    pdf: bool = False,
) -> tuple[Audit, dict[str, Any]]:
    """Make an audit and write its report; the audit, and the content of `audit.json`.

    Parameters
    ----------
    made : callable
        Gives the audit, once the folder can be used; `folder` is that of its shards, or None.
    out : Path
        Folder for the report.
    options : mapping
        Options of the audit, ready for JSON.
    notes : sequence of str
        Lines on the files that it is made from.
    is_kept : bool
        True for an audit that is kept in shards until its report is whole.
    pdf : bool
        True for the page on paper, too.
    """
    with ReportFolder(out, AUDIT) as folder:
        if pdf:
            browser()  # none fails before the work
        found = made(folder=folder.path / UNFINISHED if is_kept else None)
        header = provenance_of(found.mesh, found.camera, found.poses.given, found.task, options)
        summary = found.summary() | {"notes": list(notes), "run": header}
        eyes = found.poses.world_from_camera[:, :3, 3]
        surface = found.mesh if found.cells is None else found.cells.elements
        values, cameras = _values(found), _cameras(found, summary)
        pictures = {
            f"audit_{name}": Picture.of(MODES[name].words, mode_picture(name, surface, each, eyes))
            for name, each in values.items()
        }
        is_task = found.problem.weights > 0
        figures = {
            "covered": share_of_faces(surface, found.covered & is_task, is_task),
            "task_faces": int(is_task.sum()),
            "not_covered_because": {},
            "covered_area": summary.get("covered_area", {}),
        }
        view = view_page(
            folder.path.resolve().name, surface, found.camera, found.poses, found.names, values,
            figures_of(
                figures, np.diff(found.problem.bits.pairs()[0]), found.seen_m2, found.alone_m2,
                float(found.problem.weights.sum()),
            ),
        )  # fmt: skip
        html = page(summary, cameras, pictures, has_view=view is not None)
        with interrupts_held():
            for name, picture in pictures.items():
                write_bytes(folder.file(f"{name}.png"), picture.light)
            write_page(folder, "audit", html, pdf=pdf)
            if view is not None:
                write_text(folder.file("view.html"), view)
            elements = _arrays(found)
            for name, columns in (("elements", elements), ("cameras", cameras)):
                write_table(folder.file(f"{name}.parquet"), pa.table(columns))
            write_npz(folder.file("elements.npz"), **elements)
            shares = found.views / max(1, int(found.views.max(initial=0)))
            write_coloured_mesh(folder.file("audit.glb"), surface, shares)
            write_rig(folder.file("rig.json"), found.camera, found.poses, found.names)
            write_json(folder.file("audit.json"), summary)
            folder.publish()
            remove(folder.path / UNFINISHED)
    return found, summary


def _arrays(found: Audit) -> dict[str, np.ndarray[Any, Any]]:
    """Figures of the elements; `best_pose` is the row in the input, -1 for none."""
    on = found.mesh if found.cells is None else found.cells.elements
    source = np.arange(on.n_faces) if found.cells is None else found.cells.source_face
    ids = np.append(found.poses.ids, -1)
    return {
        "face": source.astype(np.int32),
        "area_m2": found.problem.weights,
        "views": found.views.astype(np.int32),
        "covered": found.covered,
        "best_density_px_per_m": found.best_density,
        "best_pose": ids[found.best_camera].astype(np.int64),
        "widest_angle_deg": np.degrees(found.widest_angle),
    }


def _cameras(found: Audit, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of each pose: `in_subset` is true for those of the smallest subset found."""
    entries, names = summary["per_camera"], names_of(found.camera)
    columns = {name: [entry[name] for entry in entries] for name in entries[0]}
    columns["camera"] = [names[index] for index in columns["camera"]]
    columns["in_subset"] = np.isin(np.arange(len(entries)), found.subset.chosen).tolist()
    if found.frames is not None:
        columns["frame"] = [found.frames.names[row] for row in found.frames.of_pose]
    return columns


def _values(found: Audit) -> dict[str, NDArray[Any]]:
    """Values of the modes that an audit is drawn by; densities and angles where there are any."""
    views = found.views
    values: dict[str, NDArray[Any]] = {"views": views}
    if views.any():
        values["density"] = np.where(views > 0, found.best_density, 0.0)
    if (views > 1).any():
        values["angle"] = np.where(views > 1, np.degrees(found.widest_angle), 0.0)
    return values


def page(
    summary: Mapping[str, Any],
    cameras: Mapping[str, Any],
    pictures: Mapping[str, Picture],
    *,
    has_view: bool,
) -> str:
    """HTML of an audit: its summary, and the columns of its cameras."""
    order = np.lexsort((-np.array(cameras["seen_m2"]), -np.array(cameras["lost_m2"])))
    rows = [
        [cameras["name"][row], cameras["camera"][row]]
        + [area(cameras[name][row]) for name in ("seen_m2", "lost_m2", "alone_m2")]
        + ["yes" if cameras["in_subset"][row] else ""]
        for row in order[:MOST_ROWS].tolist()
    ]
    exact = summary.get("covered_area")
    return rendered(
        "audit.html",
        title="rastercov audit",
        heading="Audit of existing cameras",
        answer=f"{plural(summary['cameras'], 'image', 'cover')} "
        f"{percent(summary['covered_percent'] / 100)} of the surface",
        exact="" if exact is None else in_words(exact),
        lines=headlines(summary),
        notes=summary["notes"],
        summary=summary,
        run=summary["run"],
        files="audit.json, elements.parquet and cameras.parquet",
        zone_rows=None,
        headings=HEADINGS,
        rows=rows,
        n_more=max(0, len(order) - MOST_ROWS),
        pictures=pictures,
        has_view=has_view,
    )


def headlines(summary: Mapping[str, Any]) -> list[str]:
    """Lines on the whole of an audit, on its frames and on each of its cameras."""
    subset = summary["subset"]
    lines = [
        f"median density {rounded(summary['median_density_px_per_m'])} px/m, "
        f"median angle between views {summary['median_widest_angle_deg']:.3g} degrees",
        f"{plural(subset['cameras'], 'image', 'cover')} the same; "
        f"none fewer than {subset['bound']:g}",
        f"{summary['redundant_cameras']:,} could be left out one at a time",
    ]
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
        seen = f"{plural(entry['poses'], 'image', 'see')} {area(entry['seen_m2'])}"
        lines.append(f"{entry['camera']}: {seen}, {lost} lost without them")
    if cameras[MOST_LINES:]:
        lines.append(f"{len(cameras) - MOST_LINES} more cameras are in audit.json")
    return lines
