"""Page of a network: the surface that cameras cover together, dead zones, and advice.

`evaluate`, `place` and `check` fill the template `report.html` with it, each with its own headline.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rastercov.base.format import area, length, percent, plural, with_bound
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, names_of
from rastercov.coverage.area import polygons
from rastercov.coverage.area.frames import to_world
from rastercov.coverage.area.network import AreaNetwork, in_words
from rastercov.coverage.area.regions import Regions, covering_poses
from rastercov.coverage.area.union import unite
from rastercov.coverage.area.zones import (
    DeadZones,
    advised,
    face_zones,
    nearest_row,
    nearest_to,
    zone_reason,
)
from rastercov.coverage.job import evaluate
from rastercov.coverage.network import Network
from rastercov.coverage.reasons import NAMES, REASONS, Reason, reason_rows
from rastercov.mesh import Mesh
from rastercov.placement.uncovered import in_front
from rastercov.report.modes import mode_picture
from rastercov.report.overview import (
    Overview,
    best_covering,
    numbered,
    zone_close_up,
    zone_rows,
    zones_picture,
)
from rastercov.report.pages import Picture, figures_of, rendered, values_of, view_page, zone_entries
from rastercov.report.tables import camera_rows, heading_and_tilt

FloatArray = NDArray[np.float64]
Progress = Callable[[int, int], None]

MOST_COLOURS = 60
"""Cameras that have a colour each in the overview."""
MOST_CLOSE_UPS = 3
"""Zones with a picture of their own."""
OF_A_FACE = ("drawn_pixels", "incidence", "pixel_density", "facing_density")
"""Figures of a face that its advice wants."""
ALTERNATIVES = {
    "overview": "The surface in the colours of its cameras, from two sides",
    "zones": "Dead zones by number and reason, from two sides",
    "contact_sheet": "The images of the poses side by side",
}
"""Words for pictures of pages."""
LEAST_LOST_REL = 1e-9
"""Area, relative to the task, below which a camera could be left out: rounding of the union."""


@dataclass(frozen=True, eq=False)
class NetworkPage:
    """A network to be shown; drawings and pages are made when they are asked for.

    Attributes
    ----------
    title : str
    mesh, camera, poses
        Surface, cameras, and the pose of each.
    noun, names : str, sequence of str
        "camera 0": word for a pose, and the name of each.
    network : Network
    covered, need : (F,) bool, (F,) int64
        Faces that enough cameras cover, and cameras that each face needs.
    figures : mapping
        Summary of the network, with its exact area and dead zones by area.
    areas, zones : AreaNetwork, DeadZones or None
        By area.
    parts : Regions or None
        Of all poses, where they are known.
    covers : (P, F) bool, or None
        Faces that each pose covers, by face.
    """

    title: str
    mesh: Mesh
    camera: Cameras
    poses: Poses
    noun: str
    names: Sequence[str]
    network: Network
    covered: NDArray[np.bool_]
    need: NDArray[np.int64]
    figures: Mapping[str, Any]
    areas: AreaNetwork | None = None
    zones: DeadZones | None = None
    parts: Regions | None = None
    covers: NDArray[np.bool_] | None = None

    @property
    def eyes(self) -> FloatArray:
        """(P, 3) positions of the cameras."""
        return self.poses.world_from_camera[:, :3, 3]

    @cached_property
    def task_m2(self) -> float:
        """Area of the task."""
        return float(self.mesh.areas[self.mesh.task_mask].sum())

    @cached_property
    def values(self) -> dict[str, Any]:
        """Values of the modes that colour the faces."""
        covered = None if self.areas is None else self.areas.covered
        return values_of(self.network, self.covered, self.names, covered, self.need)

    @cached_property
    def seen_m2(self) -> FloatArray | None:
        """(P,) area that each camera covers; None where its regions are not known."""
        if self.covers is not None and self.areas is None:
            of_task = np.where(self.mesh.task_mask, self.mesh.areas, 0.0)
            return np.asarray(self.covers @ of_task, np.float64)
        if self.parts is None:
            return None
        return np.bincount(self.parts.pair_pose, self.parts.area, len(self.poses)).astype(
            np.float64
        )

    @cached_property
    def lost_m2(self) -> FloatArray | None:
        """(P,) area that is not covered any more without each camera; None where not known."""
        if self.parts is not None:
            return lost_without(self.parts, self.need)
        if self.areas is not None or (self.need > 1).any():
            return None
        best = best_covering(self.network)
        alone = self.mesh.task_mask & (self.network.views == 1) & (best >= 0)
        areas = self.mesh.areas[alone]
        return np.bincount(best[alone], areas, len(self.poses)).astype(np.float64)

    @cached_property
    def dead(self) -> tuple[DeadZones, Mapping[str, Any]]:
        """Dead zones, and their entries as of `zones.summary_of`.

        By face those of whole faces; only the worst have advice.
        """
        if self.zones is not None:
            return self.zones, self.figures
        left, count = self.mesh.task_mask & ~self.covered, len(self.poses)
        why = reason_rows(self.network.reason, self.covered, count)
        zones = face_zones(self.mesh, np.where(left, why.astype(np.int64), -1), self.network.views)
        entries = zones.places(zones.listed())
        for row, entry in enumerate(entries):
            faces = zones.face[zones.zone == row].astype(np.int64)
            away = np.linalg.norm(self.mesh.centroids[faces] - entry["centroid"], axis=1)
            face = int(faces[away.argmin()])  # the one in the middle
            entry |= {"reason": NAMES[why[face]], "hidden_by": None}
            if row < MOST_CLOSE_UPS:
                entry |= self._advice_for(face, entry["reason"])
        return zones, {"dead_zones": entries, "other_dead_zones": zones.others()}

    def _advice_for(self, face: int, name: str) -> dict[str, Any]:
        """What hides a face, and advice for the pose that comes nearest to covering it."""
        mesh, task = self.mesh, replace(self.network.task, views=1, min_angle_deg=0.0)
        if name in ("too_few_views", "no_cameras"):
            return {"nearest": None, "advice": REASONS[name].advice}
        middle = mesh.centroids[face]
        some = nearest_to(self.poses, middle)
        found = evaluate(mesh, self.camera, some, task, fields=("reason", *OF_A_FACE))
        own = found.reason[:, face] == Reason[name.upper()]
        rows = np.flatnonzero(own if own.any() else ~own)
        figures = [
            {key: float(getattr(found, key)[row, face]) for key in OF_A_FACE}
            | {"distance": float(np.linalg.norm(some.world_from_camera[row, :3, 3] - middle))}
            for row in rows
        ]
        best = nearest_row(name, figures, task)
        pose = some[rows[best : best + 1]]
        hider, before = None, ""
        if name == "occluded":
            shares = in_front(mesh, pose.world_from_camera[:, :3, 3], np.array([face]))[0]
            hider = mesh.groups[int(shares.argmax())].name if shares.any() else None
            before = hider or ""
            if hider == mesh.groups[mesh.face_group[face]].name:
                before = "another part of it"
        corners = mesh.vertices[mesh.faces[face]]
        return {"hidden_by": hider} | advised(
            self.camera, task, pose, figures[best], corners, name, before
        )

    def overview(self) -> Image.Image:
        """The surface by the camera that covers it; of very many, by what they cover together."""
        if len(self.poses) <= MOST_COLOURS:
            best = best_covering(self.network)
            shown = Overview(self.mesh, self.camera, self.poses, self.names, best, self.parts)
            return shown.picture()
        mode = "views" if self.areas is None else "area"
        return mode_picture(mode, self.mesh, self.values[mode], self.eyes)

    def drawn(self, progress: Progress = lambda done, total: None) -> dict[str, Image.Image]:
        """Overview, and what is not covered: dead zones, or by face the reason of each."""
        progress(0, 2)
        images = {"overview": self.overview()}
        progress(1, 2)
        zones, said = self.dead
        if zones:
            images["zones"] = zones_picture(zones, said, self.eyes)
        progress(2, 2)
        return images

    def pictures(self, progress: Progress = lambda done, total: None) -> dict[str, Picture]:
        """The same for the page."""
        return pictures_of(self.drawn(progress))

    @cached_property
    def view(self) -> str | None:
        """The page to look around in; None for a large mesh."""
        return view_page(
            self.title, self.mesh, self.camera, self.poses,
            [f"{self.noun} {name}" for name in self.names], self.values,
            figures_of(
                self.figures, self.network.covered_faces, self.seen_m2, self.lost_m2, self.task_m2
            ),
            zone_entries(self.mesh, self.zones, self.figures) if self.zones else (),
        )  # fmt: skip

    def page(self, template: str, pictures: Mapping[str, Picture], **values: Any) -> str:
        """The page, by a template that extends `report.html`, and the values that it wants."""
        rows, more = self.camera_table(values.pop("columns", {}))
        by_area = "covered_area" in self.figures
        return rendered(
            template,
            heading=self.title,
            title=self.title,
            sentences=self.sentences(),
            pictures=pictures,
            zone_cards=self._cards(),
            zone_rows=zone_rows(self.dead[1]),
            by_area=by_area,
            camera_headings=more,
            camera_table=rows,
            camera_rows=camera_rows(self.figures),
            figures=self.figures,
            reasons=REASONS,
            view=self.view,
            **values,
        )

    @property
    def answer(self) -> str:
        """Headline: what the cameras cover."""
        covered = self.figures.get("covered_area")
        share = self.figures["covered"]["area_percent"] if covered is None else covered["percent"]
        who = plural(len(self.poses), self.noun, "cover")
        if covered is not None:
            return f"{who} {with_bound(share, covered['bound_percent'])} of the area"
        return f"{who} {percent(share / 100)} of the area"

    def sentences(self) -> list[str]:
        """Sentences on the covered area with its bound, on dead zones, and on single cameras."""
        figures, lost = self.figures, self.lost_m2
        whole, exact = figures["covered"], figures.get("covered_area")
        first = (
            f"{whole['faces']:,} of {figures['task_faces']:,} faces "
            f"({percent(whole['percent'] / 100)}) are covered as a whole"
        )
        if exact is not None:
            some = area(exact["m2"]) if exact["m2"] else "None"
            by_fewer = in_words(exact).partition(" of it")[2]
            first = f"{some} of {area(exact['of_m2'])} is covered{by_fewer}; {first}"
        said = [f"{first}."]
        zones, found = self.dead
        entries, reasons = found["dead_zones"], figures["not_covered_because"]
        if reasons and exact is None:
            parts = [
                f"{each['faces']:,} {REASONS[name].sentence}" for name, each in reasons.items()
            ]
            said[0] += f" Of those that are left, {', '.join(parts)}."
        if entries:
            total, worst = area(float(zones.area.sum())), area(entries[0]["area_m2"])
            largest = f", {total} in all. The largest" if len(entries) > 1 else ""
            where = f" of {entries[0]['groups'][0]}" if len(self.mesh.groups) > 1 else ""
            said.append(
                f"{plural(zones.count(), 'dead zone', 'are left')}{largest}: {worst}{where}, "
                f"{zone_reason(entries[0])}."
            )
        if lost is not None and (lost > self._least).any():
            best, spare = int(lost.argmax()), int((lost <= self._least).sum())
            rest = f" {spare} of {len(lost)} could be left out, one at a time, with no loss."
            said.append(
                f"{self.noun.capitalize()} {self.names[best]} adds most: {area(lost[best])} that "
                f"would not be covered without it.{rest if spare else ''}"
            )
        return said

    @property
    def _least(self) -> float:
        return LEAST_LOST_REL * self.task_m2

    def _areas(self, values: FloatArray) -> list[str]:
        return [area(value) if value > self._least else "0" for value in values.tolist()]

    def camera_table(self, more: Mapping[str, Sequence[str]]) -> tuple[list[list[str]], list[str]]:
        """Rows of the cameras and their headings.

        `more` are further columns by their headings; without them, those that add most are first.
        """
        types, seen, lost = names_of(self.camera), self.seen_m2, self.lost_m2
        columns: dict[str, Sequence[str]] = {self.noun: self.names}
        if len(types) > 1:
            columns["type"] = [types[index] for index in self.poses.camera.tolist()]
        for axis, name in enumerate("xyz"):
            columns[f"{name}, m"] = [length(value) for value in self.eyes[:, axis].tolist()]
        turned = [heading_and_tilt(pose) for pose in self.poses.world_from_camera]
        columns["heading"] = [f"{heading:.0f}°" for heading, _ in turned]
        columns["down"] = [f"{down:.0f}°" for _, down in turned]
        if seen is None:
            columns["covers, faces"] = [f"{count:,}" for count in self.network.covered_faces]
        else:
            columns["covers"] = self._areas(seen)
        order = np.arange(len(self.poses))
        if lost is not None:
            columns["only by it"] = self._areas(lost)
            if (lost <= self._least).any():
                spare = ["yes" if each == "0" else "" for each in columns["only by it"]]
                columns["could be left out"] = spare
            if not more:  # which follow the order of the names
                order = np.argsort(-lost, kind="stable")
        columns |= more
        return [[each[row] for each in columns.values()] for row in order.tolist()], list(columns)

    def _cards(self) -> list[dict[str, Any]]:
        """The worst zones: heading, picture, reason and advice."""
        found, (zones, said) = [], self.dead
        for row, zone in enumerate(numbered(said)[:MOST_CLOSE_UPS]):
            reason = zone_reason(zone)
            drawn = zone_close_up(zones, said, row, self.eyes)
            share = percent(round(zone["percent"] / 100, 9))
            heading = f"Zone {row + 1}: {area(zone['area_m2'])}, {share} of the area"
            advice, nearest = zone["advice"], zone["nearest"]
            if nearest is not None:
                place = self.poses.ids.tolist().index(nearest["pose"])
                advice = f"{self.noun} {self.names[place]} comes nearest: {advice}"
            found.append({
                "heading": heading,
                "reason": f"{zone['groups'][0]}: {reason}" if len(self.mesh.groups) > 1
                else f"{reason[:1].upper()}{reason[1:]}",
                "advice": f"{advice[:1].upper()}{advice[1:]}.",
                "picture": drawn and Picture.of(f"{heading}, {reason}", drawn),
            })  # fmt: skip
        return found


def pictures_of(images: Mapping[str, Image.Image]) -> dict[str, Picture]:
    """Pictures of a page by their names in `ALTERNATIVES`."""
    return {name: Picture.of(ALTERNATIVES[name], image) for name, image in images.items()}


def lost_without(parts: Regions, need: NDArray[np.int64]) -> FloatArray:
    """(P,) area that too few cameras cover without each one; `need`, (F,), are those wanted."""
    covered = unite(parts, int(need.max(initial=1)) + 1)
    tight = np.flatnonzero(covered.views == need[covered.face])
    xy, starts = polygons.chosen(covered.xy, covered.starts, tight)
    areas, face = polygons.polygon_areas(xy, starts), covered.face[tight]
    points = to_world(parts.mesh, face, polygons.centroids(xy, starts, np.maximum(areas, 1e-300)))
    lost: FloatArray = areas @ covering_poses(parts, face, points)
    return lost
