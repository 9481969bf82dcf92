"""Report of an audit: a page, tables of elements and cameras, arrays, a coloured mesh, a summary.

audit.html         headline, pictures of the surface, what each image adds; audit.pdf on paper
audit_*.png        the surface by number of views, best density, widest angle and weak zones
view.html          what the images cover, computed in the page; else as recorded
elements.parquet   figures of each cell or face, and elements.npz the same
cameras.parquet    figures of each image
audit.glb          the surface coloured by the number of views
rig.json           the cameras and poses, where there are up to 5,000
suggested*.json    the images to take next, where they are asked for, alone and with all others
audit.json         shares, medians, the smallest subset, and its provenance
"""

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from rastercov.base import (
    TINY,
    ByName,
    FloatArray,
    ReadByName,
    first_of,
    frozen_record,
    json_bytes,
    percent,
    plural,
    sampling,
    write_bytes,
    write_json,
    write_text,
)
from rastercov.base.format import area, verb
from rastercov.base.interrupts import hold_interrupts
from rastercov.base.output import write_npz
from rastercov.core.area.zones import DeadZones, face_zones
from rastercov.core.camera import cameras_of, eyes_of, names_of
from rastercov.core.coverage.network import share_of_faces
from rastercov.core.coverage.shards import folder_of_shards, provenance_of, remove
from rastercov.formats.cameras.own import content_of
from rastercov.placement.audit import Audit, element_figures
from rastercov.placement.footprints import overlap_words
from rastercov.placement.reconstruction import KINDS, Reconstruction, Suggested, Weak, weak
from rastercov.report.coverage_files import (
    INSTALL_PYARROW,
    has_parquet,
    views_of,
    write_coloured_mesh,
    write_rig,
)
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.live import NO_ENGINE, Asked, record_cause, view_of
from rastercov.report.modes import MODES, WEAK_LABELS, OfUnit, mode_picture
from rastercov.report.network_page import NetworkPage
from rastercov.report.overview import LEAST_PERCENT, Overview, close_up
from rastercov.report.pages import MOST_EMBEDDED, Picture, image_name
from rastercov.report.panorama import (
    neutral,
    paint,
    smooth,
)
from rastercov.report.printing import browser, write_page
from rastercov.report.tables import LITTLE
from rastercov.report.theme import WEAK
from rastercov.shards import Progress, silent

LOG = logging.getLogger("rastercov")
AUDIT = ReportKind(
    "audit",
    re.compile(
        r"(elements|cameras)\.parquet|elements\.npz|audit\.(glb|json|html|pdf)|rig\.json|view\.html"
        r"|audit_[a-z0-9_]+\.png|suggested[a-z_]*\.(json|zip)"
    ),
    last="audit.json",
)
MOST_CARDS = 3
"""Weak zones with a picture."""


def write(
    made: Callable[..., Reconstruction],
    out: Path,
    options: ReadByName,
    notes: Sequence[str] = (),
    *,
    is_kept: bool = False,
    pdf: bool = False,
    level: int | None = None,
    progress: Progress = silent,
) -> tuple[Reconstruction, ByName]:
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
    level : int, optional
        Of the parts in the table of the page, as of `rastercov.placement.parts.entries_at`.
    progress : callable
        Called with the pictures drawn and their total.
    """
    with ReportFolder(out, AUDIT) as folder:
        if pdf:
            browser()  # none fails before the work
        result = made(folder=folder_of_shards(folder.path) if is_kept else None)
        header = provenance_of(result.mesh, result.camera, result.poses.given, result.task, options)
        summary = result.summary() | {"notes": list(notes), "run": header}
        shown = replace(page_of(result, summary), level=level)
        pictures, files = shown.pictures(progress), _suggest_files(result)
        view = shown.live or shown.view
        summary |= {"answer": shown.answer, "sentences": shown.sentences()}
        html = shown.html(pictures, has_view=view is not None)
        with hold_interrupts():
            for name, picture in pictures.items():
                write_bytes(folder.file(f"audit_{name}.png"), picture.light)
            write_page(folder, "audit", html, pdf=pdf)
            for name, content in files.items():
                write_bytes(folder.file(name), content)
            if view is not None:
                write_text(folder.file("view.html"), view)
            elements = arrays_of(result)
            if has_parquet():
                from rastercov.report.parquet import write_columns

                write_columns(folder.file("elements.parquet"), elements)
                write_columns(folder.file("cameras.parquet"), cameras_of_images(result, summary))
            else:
                LOG.warning(
                    "did not write Parquet tables, which need pyarrow; run: %s", INSTALL_PYARROW
                )
            write_npz(folder.file("elements.npz"), **elements)
            shares = result.views / max(1, int(result.views.max(initial=0)))
            write_coloured_mesh(folder.file("audit.glb"), result.elements, shares)
            write_rig(
                folder.file("rig.json"), result.camera, result.poses, result.names, result.unit
            )
            write_json(folder.file("audit.json"), summary)
            folder.publish()
            remove(folder.path)
    return result, summary


def _suggest_files(reconstruction: Reconstruction) -> dict[str, bytes]:
    """Files of the images to take next, alone and with all others."""
    given = reconstruction.suggested
    if given is None or not given.names:
        return {}
    both = given.steps[-1].poses, (*reconstruction.names, *given.names)
    files = {"suggested": (given.poses, given.names), "suggested_joined": both}
    return {
        f"{name}.json": json_bytes(
            content_of(views_of(reconstruction.camera, *each, reconstruction.unit)), indent=2
        )
        for name, each in files.items()
    }


def arrays_of(audit: Audit) -> dict[str, np.ndarray[Any, Any]]:
    """Figures of the elements; `best_pose` is the row in the input, -1 for none."""
    source = np.arange(audit.mesh.n_faces) if audit.cells is None else audit.cells.source_face
    ids = np.append(audit.poses.ids, -1)
    return {
        "face": source.astype(np.int32),
        "area_m2": audit.problem.weights,
        "views": audit.views.astype(np.int32),
        "covered": audit.covered,
        "best_density_px_per_m": audit.best_density,
        "best_pose": ids[audit.best_camera].astype(np.int64),
        "widest_angle_deg": np.degrees(audit.widest_angle),
    }


def cameras_of_images(audit: Audit, summary: ReadByName) -> ByName:
    """Figures of each pose: `in_subset` is true for those of the smallest subset found."""
    entries, names = summary["per_camera"], names_of(audit.camera)
    columns = {name: [entry[name] for entry in entries] for name in entries[0]}
    columns["camera"] = [names[index] for index in columns["camera"]]
    columns["in_subset"] = np.isin(np.arange(len(entries)), audit.subset.chosen).tolist()
    if audit.frames is not None:
        columns["frame"] = [audit.frames.names[row] for row in audit.frames.of_pose]
    return columns


@frozen_record(kw_only=True)
class AuditPage(NetworkPage):
    """Page of an audit: `mesh` and `poses` are its elements and images.

    Attributes
    ----------
    found : Reconstruction
    summary : mapping
        Content of `audit.json`.
    """

    found: Reconstruction
    summary: ReadByName

    @cached_property
    def seen_m2(self) -> FloatArray:
        """(P,) area that each image covers."""
        return self.found.seen_m2

    @cached_property
    def lost_m2(self) -> FloatArray:
        """(P,) area that is not covered any more without each image."""
        return self.found.lost_m2

    @cached_property
    def dead(self) -> tuple[DeadZones, ReadByName]:
        """No dead zones: weak ones take their place."""
        none = np.full(self.mesh.n_faces, -1)
        zones = face_zones(self.mesh, none, self.network.views, self.need)
        return zones, {"dead_zones": [], "other_dead_zones": zones.others()}

    @cached_property
    def live(self) -> str | None:
        """The live page of what the images cover of the surface.

        None where it cannot, or where `view` is too large to be a part of the report.
        """
        result = self.found
        scene = result.mesh, result.camera
        others = {"results by face": result.by != "area"}
        why = record_cause(*scene, len(result.poses), result.task, others)
        if why == NO_ENGINE:
            LOG.warning(why)
        if why or len(self.view or "") > MOST_EMBEDDED:
            return None
        return view_of(
            self.title, *scene, result.poses, result.names, Asked(result.task), result.unit
        )

    @cached_property
    def weak(self) -> Weak:
        """Weak elements and their zones."""
        return weak(self.found)

    @cached_property
    def values(self) -> ByName:
        """Values of the modes that colour the elements."""
        result = self.found
        values: ByName = {"weak": self.weak.kind, "views": result.views}
        if result.views.any():
            density = np.where(result.views > 0, result.best_density, 0.0)
            values["density"] = OfUnit(density, f"px/{self.unit}")
        if (result.views > 1).any():
            values["angle"] = np.where(result.views > 1, np.degrees(result.widest_angle), 0.0)
        return values

    @property
    def answer(self) -> str:
        """Headline: what the images cover with the views required."""
        views, is_exact = self.summary["required_views"], "covered_area" in self.figures
        text = super().answer + (f", with {views} views of each point" if views > 1 else "")
        return text if is_exact or self.found.cells is None else f"{text} (on patches)"

    def sentences(self) -> list[str]:
        """Sentences on the area, sampling, weak zones, suggested images, redundancy and overlap."""
        summary, unit, zones = self.summary, self.unit, self.summary["weak"]
        least, median, most = summary["gsd_per_px"].values()
        said = [f"{summary['mean_views']:.1f} images cover each point on average."]
        if self.covered_words:
            said[0] = f"{self.covered_words}; {said[0]}"
        if median is not None:
            wide = (
                f"; where there are two views or more, the widest angle between them is "
                f"{summary['median_widest_angle_deg']:.3g}° (median)"
            )
            said.append(
                f"The surface sampling distance is {sampling(median, unit)} (median of the area), "
                f"{sampling(least, unit)} at best, and {sampling(most, unit)} or less for 95 % of "
                f"the area{wide * ('angle' in self.values)}."
            )
        words = (
            f"with fewer than {zones['views']} views",
            f"with views less than {zones['angle_deg']:.3g}° apart",
            "unusually coarse (sampling distance over twice the median)",
        )
        parts = zip(zones["by_kind"].values(), words, strict=True)
        kinds = ", ".join(
            f"{percent(share / 100)} {word}" for share, word in parts if share > LEAST_PERCENT
        )
        patches = "" if self.found.cells is None else " on patches"
        on = patches and f" ({patches.strip()})"
        text = f"{percent(zones['percent'] / 100)} of the area is weak{on}{kinds and ': '}{kinds}"
        if (given := self.found.suggested) is not None:
            before, images, after = given.summary().values()
            covered, left = (
                percent(after[f"{name}_percent"] / 100) for name in ("covered", "weak")
            )
            if images:
                text += (
                    f"; with {plural(len(images), 'suggested image')} (simulated{patches}), {left} "
                    f"would be weak and {covered} covered "
                    f"(now {percent(before['covered_percent'] / 100)})"
                )
            if len(images) < given.requested:
                text += f"; {len(images)} of {given.requested} suggested: no other candidate helps"
        said.append(f"{text}.")
        groups = [("image", summary["cameras"], summary["subset"], summary["redundant_cameras"])]
        if "frames" in summary:
            groups.append(
                ("frame", *(summary["frames"][x] for x in ("count", "subset", "redundant")))
            )
        said += [
            _of_subset(*group, summary["required_views"])
            if group[3]
            else f"{'All ' * (group[1] > 1)}{plural(group[1], group[0], 'are')} needed."
            for group in groups
            if group[2]["cameras"]
        ]
        if "footprints" in summary:
            said.append(footprint_words(summary["footprints"], unit))
        n = len(summary["overlap"].get("components", ()))
        return said + [
            f"The images form {n:,} unlinked groups: see Overlap of images on the page."
        ] * (n > 1)

    def overview(self) -> Image.Image:
        """The elements by weak zones."""
        return mode_picture("weak", self.mesh, self.weak.kind, self.poses.world_from_camera)

    def pictures(self, progress: Progress = silent) -> dict[str, Picture]:
        """The elements by each mode, the largest weak zones, and the suggested images, by name."""
        mesh, eyes = self.mesh, self.poses.world_from_camera
        asked: dict[str, tuple[str, Callable[[], Image.Image | None]]] = {
            name: (MODES[name].words, partial(mode_picture, name, mesh, each, eyes))
            for name, each in self.values.items()
        }
        for row, zone in enumerate(self.summary["weak"]["zones"][:MOST_CARDS]):
            words = f"Weak zone {row + 1}: {WEAK_LABELS[KINDS.index(zone['kind'])]}"
            if zone["percent"] >= LEAST_PERCENT:
                asked[f"zone_{row + 1}"] = words, partial(self._close_up, row)
        given = self.found.suggested
        if given is not None and given.names:
            words = "The suggested images, and the weak parts that each of them improves"
            asked["suggested"] = words, partial(self._suggest_picture, given)
        pictures = {}
        for done, (name, (words, draw)) in enumerate(asked.items()):
            progress(done, len(asked))
            if (image := draw()) is not None:
                pictures[name] = Picture.draw(words, image)
        progress(len(asked), len(asked))
        return pictures

    def _close_up(self, row: int) -> Image.Image | None:
        """A weak zone; None where it cannot be shown."""
        mesh, own = self.mesh, self.weak.zone == row
        corners = mesh.vertices[mesh.faces[own]].reshape(-1, 3)
        extent = np.stack((corners.min(axis=0), corners.max(axis=0)))
        scene = close_up(mesh, own, extent, self.poses.world_from_camera)
        if scene is None:
            return None
        kind = np.array(WEAK[int(self.weak.kind[own][0])], np.uint8)
        colours = np.where(own[:, None], kind, neutral(mesh))
        return smooth(Image.fromarray(paint(scene, colours)))

    def _suggest_picture(self, given: Suggested) -> Image.Image:
        """The suggested images, and the weak elements that each of them covers best."""
        after, n, before = given.steps[-1], len(given.poses), len(self.poses)
        new = replace(
            after.problem,
            bits=after.problem.bits.take(np.arange(before, before + n)),
            eyes=eyes_of(self.camera, given.poses),
            costs=np.ones(n),
        )
        figures = element_figures(new, self.mesh, given.poses, cameras_of(self.camera))
        best = np.where(weak(after).kind >= 0, -1, figures["best_camera"])
        best[self.weak.kind < 0] = -2
        names = [str(row + 1) for row in range(n)]
        shown = Overview(
            self.mesh,
            self.camera,
            given.poses,
            names,
            best,
            among=self.poses,
            noun="suggested image",
            about=", and the weak parts that they improve",
            left="still weak",
            unit=self.unit,
        )
        return shown.picture()

    def html(self, pictures: Mapping[str, Picture], *, has_view: bool | None) -> str:
        """The page with pictures as of `pictures`; `summary` has its notes and provenance, too."""
        return self.page(
            "audit.html",
            {},
            answer=self.answer,
            lines=(),
            summary=self.summary,
            run=self.summary["run"],
            notes=self.summary["notes"],
            sentences=self.sentences(),
            has_view=has_view,
            by_face=self.found.by == "face",
            unit=self.unit,
            drawn=pictures,
            weak_labels=dict(zip(KINDS, WEAK_LABELS, strict=True)),
        )


def _of_subset(noun: str, count: int, subset: ReadByName, spare: int, views: int) -> str:
    """Sentence on the smallest subset of images or frames, and on those that add little to it."""
    chosen, bound = subset["cameras"], round(subset["bound"])
    text = f"{chosen:,} of the {plural(count, noun)} suffice for the same coverage"
    text += f", with {plural(views, 'view')} of each point" if views > 1 else ""
    if subset["proved_on"]:
        text += f" (proved minimum on {subset['proved_on']})"
    else:
        text += f"; at least {bound:,} are needed"
        if subset["method"] == "greedy":
            text += "; pip install 'rastercov[place]' gives a better bound"
    text += f"; removable one at a time without loss: {plural(spare, noun)}."
    text += " A reconstruction needs more views: give --views 3." if views == 1 else ""
    steps = np.diff(subset["curve"], prepend=0.0) / max(subset["share"], TINY)
    named = zip(subset["names"], steps, strict=True)
    few = [image_name(name) for name, step in named if step < LITTLE]
    if few:
        each = " each" if len(few) > 1 else ""
        text += (
            f" Of the {plural(chosen, noun)}, {first_of(few)} {verb(len(few), 'add')} less than "
            f"1 % of the total{each}."
        )
    return text


def footprint_words(figures: ReadByName, unit: str) -> str:
    """Sentence on footprints: their area, GSD, and overlap of strips."""
    gsd = figures["gsd_per_px"]
    text = f"Footprints on {figures['surface']} cover {area(figures['union_m2'], unit)} in plan"
    if gsd is not None:
        text += f" at {sampling(gsd, unit)} (median GSD of the images)"
    words = overlap_words(figures)
    text += f"; {plural(figures['strips'], 'strip')}, {words}" if words else ""
    return f"{text}."


def html_of(reconstruction: Reconstruction) -> str:
    """The page of an audit."""
    run = provenance_of(
        reconstruction.mesh,
        reconstruction.camera,
        reconstruction.poses.given,
        reconstruction.task,
        {"by": reconstruction.by},
    )
    shown = page_of(reconstruction, reconstruction.summary() | {"notes": [], "run": run})
    return shown.html(shown.pictures(), has_view=None)


def page_of(reconstruction: Reconstruction, summary: ReadByName) -> AuditPage:
    """Page of an audit, and the content of `audit.json`."""
    is_task, elements = reconstruction.problem.weights > 0, reconstruction.elements
    figures = summary["network"] | {
        "covered": share_of_faces(elements, reconstruction.covered, is_task),
        "task_faces": int(is_task.sum()),
        "not_covered_because": {},
        "other_dead_zones": {"zones": 0, "percent": 0.0},
    }
    if reconstruction.task.min_angle_deg:  # which the exact area leaves out
        figures.pop("covered_area", None)
    return AuditPage(
        "Audit of existing images",
        elements,
        reconstruction.camera,
        reconstruction.poses,
        "image",
        reconstruction.names,
        reconstruction.network,
        reconstruction.covered,
        reconstruction.problem.views,
        figures,
        unit=reconstruction.unit,
        found=reconstruction,
        summary=summary,
    )
