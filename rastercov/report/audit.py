"""Report of an audit: a page, tables of elements and cameras, arrays, a coloured mesh, a summary.

audit.html         headline, pictures of the surface, what each image adds; audit.pdf on paper
audit_*.png        the surface by number of views, best density, widest angle and weak zones
view.html          the same to look around in, without a server
elements.parquet   figures of each cell or face, and elements.npz the same
cameras.parquet    figures of each image
audit.glb          the surface coloured by the number of views
rig.json           the cameras and poses, where there are up to 5,000
suggested.json     the images to take next, where they are asked for
audit.json         shares, medians, the smallest subset, and its provenance
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from PIL import Image

from rastercov.base.format import area, number, percent, plural
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import json_bytes, write_bytes, write_json, write_npz, write_text
from rastercov.camera.formats.own import content_of
from rastercov.camera.rig import Views, cameras_of, names_of
from rastercov.coverage.area.network import in_words
from rastercov.coverage.network import share_of_faces
from rastercov.coverage.provenance import provenance_of
from rastercov.coverage.shards import UNFINISHED, remove
from rastercov.mesh import Mesh
from rastercov.placement.audit import Audit, element_figures
from rastercov.placement.reconstruction import KINDS, Suggested, summary_of, weak
from rastercov.report.coverage_files import views_of, write_coloured_mesh, write_rig, write_table
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import Key, framed
from rastercov.report.modes import MODES, WEAK_LABELS, OfUnit, mode_picture, rounded
from rastercov.report.overview import Overview
from rastercov.report.pages import Picture, figures_of, rendered, view_page
from rastercov.report.panorama import beside, look, neutral, paint, scene_keys, smooth, upright
from rastercov.report.printing import browser, write_page
from rastercov.report.theme import WEAK, Colour

AUDIT = ReportKind(
    "audit",
    re.compile(
        r"(elements|cameras)\.parquet|elements\.npz|audit\.(glb|json|html|pdf)|rig\.json|view\.html"
        r"|audit_[a-z0-9_]+\.png|suggested[a-z_]*\.(json|zip)"
    ),
    last="audit.json",
)
MOST_PICTURES = 4
"""Weak zones with a picture."""
CLOSE_UP = 2.5
"""Reach of the close-up of a zone, in those of the zone."""
MOST_NEAR = 0.7
"""Part of the surface from which a close-up is of all, and the second view is aslant by this."""
ASLANT = (0.8, -0.8, 0.6)
MOST_ROWS = 400
"""Cameras in the table of a page; cameras.parquet has all."""
MOST_LINES = 8
"""Cameras with a line of their own; audit.json has all."""


def write(
    made: Callable[..., Audit],
    out: Path,
    options: Mapping[str, Any],
    notes: Sequence[str] = (),
    *,
    is_kept: bool = False,
    pdf: bool = False,
    unit: str = "m",
    suggest: Callable[[Audit], Suggested] | None = None,
    written: Callable[[Views], tuple[str, bytes] | None] = lambda views: None,
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
    unit : {"m", "unit"}
        Unit of lengths: metres, or one of the reconstruction, which has no scale.
    suggest : callable, optional
        Gives the images to take next.
    written : callable
        Gives these in the format of the input: the end of a name, and the content; or None.
    """
    with ReportFolder(out, AUDIT) as folder:
        if pdf:
            browser()  # none fails before the work
        found = made(folder=folder.path / UNFINISHED if is_kept else None)
        header = provenance_of(found.mesh, found.camera, found.poses.given, found.task, options)
        summary = found.summary() | {"unit": unit} | summary_of(found)
        summary |= {"notes": list(notes), "run": header}
        surface, zones = found.elements, weak(found)
        eyes = found.poses.world_from_camera
        values, cameras = _values(found, unit), _cameras(found, summary)
        values["weak"] = zones.kind
        pictures = {
            f"audit_{name}": Picture.of(MODES[name].words, mode_picture(name, surface, each, eyes))
            for name, each in values.items()
        }
        for row, zone in enumerate(summary["weak"]["zones"][:MOST_PICTURES]):
            kind = KINDS.index(zone["kind"])
            words = f"Weak zone {row + 1}: {WEAK_LABELS[kind]}, {percent(zone['percent'] / 100)}"
            drawn = _zone_picture(surface, eyes, zones.zone == row, WEAK[kind], words)
            pictures[f"audit_zone_{row + 1}"] = Picture.of(words, drawn)
        more: dict[str, bytes] = {}
        if suggest is not None:
            next_ones = suggest(found)
            summary["suggested"] = next_ones.summary()
        if suggest is not None and next_ones.names:
            views = views_of(found.camera, next_ones.poses, next_ones.names)
            more["suggested.json"] = json_bytes(content_of(views), indent=2) + b"\n"
            if (other := written(views)) is not None:
                more[f"suggested_{other[0]}"] = other[1]
            words = "The surface by the suggested images alone"
            pictures["audit_suggested"] = Picture.of(words, _suggested_picture(next_ones))
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
            for name, content in more.items():
                write_bytes(folder.file(name), content)
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
    source = np.arange(found.mesh.n_faces) if found.cells is None else found.cells.source_face
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


def _zone_picture(
    surface: Mesh, eyes: NDArray[np.float64], own: NDArray[np.bool_], colour: Colour, words: str
) -> Image.Image:
    """A weak zone: where it is on the surface; then from near, or aslant where it is large."""
    colours = neutral(surface).copy()
    colours[own] = colour
    middle = np.average(surface.centroids[own], axis=0, weights=surface.areas[own])
    away = np.linalg.norm(surface.centroids - middle, axis=1)
    near = away <= max(CLOSE_UP * away[own].max(), 0.1 * float(np.ptp(surface.bounds)))
    normal = surface.areas[own] @ surface.normals[own]
    normal = normal if normal.any() else middle - surface.bounds.mean(axis=0)
    towards = upright(eyes) @ normal
    again = towards
    if near.mean() > MOST_NEAR:
        near[:], again = True, towards / np.linalg.norm(towards) + ASLANT
    close = look(Mesh(surface.vertices, surface.faces[near]), again, eyes=eyes)
    scenes = [look(surface, towards, eyes=eyes), close]
    painted = paint(scenes[0], colours), paint(close, colours[near])
    images = [smooth(Image.fromarray(pixels)) for pixels in painted]
    return framed(beside(images), words, [Key.of("the zone", colour), *scene_keys(scenes)])


def _suggested_picture(given: Suggested) -> Image.Image:
    """The suggested images, and the surface in the colours of those that cover it."""
    after = given.steps[-1]
    new = np.arange(len(given.steps[0].poses), len(after.poses))
    bits, eyes = after.problem.bits.take(new), given.poses.world_from_camera[:, :3, 3].copy()
    alone = replace(after.problem, bits=bits, eyes=eyes, costs=np.ones(len(new)))
    best = element_figures(alone, after.elements, given.poses, cameras_of(after.camera))
    names = [str(row + 1) for row in range(len(new))]
    shown = best["best_camera"], None, after.poses
    return Overview(after.elements, after.camera, given.poses, names, *shown).picture()


def _values(found: Audit, unit: str) -> dict[str, Any]:
    """Values of the modes that an audit is drawn by; densities and angles where there are any."""
    views = found.views
    values: dict[str, Any] = {"views": views}
    if views.any():
        values["density"] = OfUnit(np.where(views > 0, found.best_density, 0.0), f"px/{unit}")
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
    area, gsd = words_of(summary["unit"])
    order = np.lexsort((-np.array(cameras["seen_m2"]), -np.array(cameras["lost_m2"])))
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
        area=area,
        gsd=gsd,
        weak_labels=dict(zip(KINDS, WEAK_LABELS, strict=True)),
        cameras=cameras,
        order=order[:MOST_ROWS].tolist(),
        n_more=max(0, len(order) - MOST_ROWS),
        pictures=pictures,
        has_view=has_view,
    )


def words_of(unit: str) -> tuple[Callable[[float], str], Callable[[float], str]]:
    """Format of areas, and of ground sampling distances, whose values are of a unit of length."""
    if unit == "m":
        return area, lambda value: f"{number(1e3 * value)} mm/px"
    return lambda value: f"{number(value)} units²", lambda value: f"{number(value)} units/px"


def headlines(summary: Mapping[str, Any]) -> list[str]:
    """Lines on the whole of an audit, on its frames and on each of its cameras."""
    subset, (area, gsd) = summary["subset"], words_of(summary["unit"])
    lines, (least, median, most) = [], summary["gsd_per_px"].values()
    if median is not None:
        lines = [
            f"ground sampling distance {gsd(median)} (median), {gsd(least)} at best, {gsd(most)} "
            "or less for 95 % of the area seen"
        ]
    lines += [
        f"median density {rounded(summary['median_density_px_per_m'])} px/{summary['unit']}, "
        f"median angle between views {summary['median_widest_angle_deg']:.3g} degrees",
        f"{percent(summary['weak']['percent'] / 100)} of the area is weak: fewer than "
        f"{summary['weak']['views']} views, less than {summary['weak']['angle_deg']:g} degrees "
        "between them, or coarse",
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
    if summary.get("suggested", {}).get("images"):
        images, *ends = (summary["suggested"][name] for name in ("images", "before", "after"))
        covered, weak_ = (
            " in place of ".join(percent(end[name] / 100) for end in reversed(ends))
            for name in ("covered_percent", "weak_percent")
        )
        number_of = plural(len(images), "suggested image")
        lines.append(f"with the {number_of} (simulated): covered {covered}, weak {weak_}")
    cameras = summary.get("by_camera", ())
    for entry in cameras[:MOST_LINES]:
        lost = f"{area(entry['lost_m2'])} is" if entry["lost_m2"] > 0 else "nothing is"
        seen = f"{plural(entry['poses'], 'image', 'see')} {area(entry['seen_m2'])}"
        lines.append(f"{entry['camera']}: {seen}, {lost} lost without them")
    if cameras[MOST_LINES:]:
        lines.append(f"{len(cameras) - MOST_LINES} more cameras are in audit.json")
    return lines
