"""Page of a network: the surface that cameras cover together, dead zones, and advice.

`evaluate`, `place` and `check` fill the template `report.html` with it, each with its own headline.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    FloatArray,
    IntArray,
    ReadByName,
    first_of,
    frozen_record,
    norm,
    percent,
    plural,
    share_poses,
    sort_order,
    thread_count,
    with_bound,
)
from rastercov.base.format import area, coordinates, distance, length, text_with_sign
from rastercov.core.area.advice import focus_in_words
from rastercov.core.area.feature import in_words
from rastercov.core.area.features import values_of as values_of_features
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.remedies import ANY, SURE, Allowed, Change, Remedies, ZoneSpot
from rastercov.core.area.table import Regions
from rastercov.core.area.zones import DeadZones, face_zones
from rastercov.core.camera import (
    Cameras,
    Poses,
    Rig,
    axes_of,
    cameras_of,
    equipment_on,
    gates_of,
    led_by,
    look_at,
    names_of,
)
from rastercov.core.camera.rig import short_names
from rastercov.core.coverage.evaluation import LEAST_LOST_REL, lose_without
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.network import Network, reasons_of
from rastercov.core.coverage.task import NAMES, REASONS, Reason
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import blocker, names_in
from rastercov.placement.required import HOLDS
from rastercov.report.feature import NetworkPart, part_of
from rastercov.report.feature_table import FeatureRow, feature_rows, table_of
from rastercov.report.live import NO_ENGINE, Asked, record_cause, view_of
from rastercov.report.modes import (
    MODES,
    OF_EQUIPMENT,
    OF_GATES,
    REPORTS,
    OfCameras,
    OfUnit,
    mode_picture,
    of_devices,
)
from rastercov.report.overview import (
    Overview,
    Volume,
    best_covering,
    device_hatches,
    device_words,
    number_cameras,
    zone_close_up,
    zone_rows,
    zones_picture,
)
from rastercov.report.pages import (
    Picture,
    figures_of,
    image_name,
    render,
    values_of,
    view_page,
    zone_entries,
)
from rastercov.report.panorama import upright
from rastercov.report.tables import camera_words, mounting_angles
from rastercov.report.verdict import openings_in_words
from rastercov.shards import Progress, silent

if TYPE_CHECKING:
    from rastercov.placement.plan.network import Requirement

NO_FOCUS = (0.0, np.inf)
"""Depth of field of a camera without one."""
LAMP, LAMP_REL, MOST_LAMPS = (148, 98, 0), 0.02, 40
"""Colour of equipment in pictures, its radius relative to the scene, and most of it."""
OF_CAMERA = " from each camera, facing ({}), in its axes: x right, y down, z ahead"
"""Words on the place of equipment that rides on cameras."""
MOST_COLOURS = 60
"""Cameras that have a colour each in the overview."""
MOST_CLOSE_UPS = 3
"""Zones with a picture of their own, and goals."""
MOST_GROUPS = 12
"""Groups of a goal with a line of their own."""
MOST_FACES = 32
"""Faces of a zone of whole faces on which advice is tried."""
OF_SENSORS = (*OF_GATES, *OF_EQUIPMENT)
"""Modes with a picture of their own."""
SMALL = 0.1
"""Largest coordinate of cameras that are in a table in millimetres, m."""


def pictures_in_words() -> dict[str, str]:
    """Words for pictures of pages, in their order."""
    table = {"overview": "The surface in the colours of its cameras, from two sides"}
    for each in REPORTS:
        table |= dict(each.pictures)
    return table | {
        **{name: MODES[name].words for name in OF_SENSORS},
        "zones": "Dead zones by number and reason, from two sides",
        "contact_sheet": "The images of the cameras, with the reasons why parts are not covered",
    }


class GoalPart(NamedTuple):
    """A goal of a plan: lines on it, the page of it alone, and area of each camera.

    The area is lost without it, or that it sees of what must not be seen. Its groups are judged
    alone where they must not be seen. It has a picture where it `is_shown`.
    """

    name: str
    words: str
    status: str
    is_most: bool
    lines: Sequence[str]
    page: "NetworkPage"
    areas_m2: FloatArray | None
    groups: "Sequence[Requirement]" = ()
    is_shown: bool = False

    @property
    def is_short(self) -> bool:
        """True for a goal with dead zones to show."""
        return self.status != HOLDS and not self.is_most and bool(self.page.dead[0])

    def picture(self) -> Image.Image | None:
        """Dead zones of a goal, or the cameras that see what must not be seen; None for none."""
        if self.is_short:
            return zones_picture(*self.page.dead, self.page.poses.world_from_camera)
        return self.page.overview() if self.is_shown else None

    def of_groups(self) -> list[str]:
        """A line on each of several groups, those that lack most first."""
        ranked = sorted(self.groups, key=lambda each: each.high, reverse=self.is_most)
        lines = []
        for each in ranked[:MOST_GROUPS] if ranked[1:] else ():
            said = "covered"
            if self.is_most:
                proof = f", proved: {with_bound(0.0, 100 * each.high)} at most"
                said = f"seen, {each.status}{proof * (each.status == HOLDS)}"
            lines.append(f"{each.group}: {percent(each.share)} {said}")
        return lines


@frozen_record
class NetworkPage:
    """A network to be shown; drawings and pages are made when they are asked for.

    Attributes
    ----------
    title : str
    mesh, camera, poses
        Surface, cameras, and the pose of each.
    noun, names : str, sequence of str
        "camera": word for a pose; the name of each, as of `names_of_poses`.
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
    unit : {"m", "unit"}
        Of lengths, as of `rastercov.base.format.area`.
    level : int or None
        Of the tree of groups in the table of parts, as of `coverage.parts.entries_at`.
    of_faces : dict of str to (2, F) float64
        As of `ByCamera`.
    serves_goals : bool
        True where cameras serve goals that are not shown: none is said to be spare.
    volumes : sequence of Volume
        Limits of places of cameras.
    goals : sequence of GoalPart
    required : sequence of Requirement
        Shares that are required of the surface.
    north : float or None
        From which headings are, as of `mounting_angles`.
    asked : Asked or None
        What a page computes; recorded figures for None.
    allowed : Allowed
        Cameras that advice by face may name.
    """

    title: str
    mesh: Mesh
    camera: Cameras
    poses: Poses
    noun: str
    names: Sequence[str]
    network: Network
    covered: BoolArray
    need: IntArray
    figures: ReadByName
    areas: AreaNetwork | None = None
    zones: DeadZones | None = None
    parts: Regions | None = None
    covers: BoolArray | None = None
    unit: str = "m"
    level: int | None = None
    of_faces: Mapping[str, FloatArray] = field(default_factory=dict)
    serves_goals: bool = False
    volumes: Sequence[Volume] = ()
    asked: Asked | None = None
    allowed: Allowed = ANY
    goals: Sequence[GoalPart] = ()
    required: "Sequence[Requirement]" = ()
    north: float | None = None

    @property
    def eyes(self) -> FloatArray:
        """(P, 3) positions of the cameras."""
        return self.poses.eyes

    @cached_property
    def labels(self) -> list[str]:
        """Names after the noun, or below it in a table."""
        return short_names(self.names)

    @cached_property
    def task_m2(self) -> float:
        """Area of the task."""
        return float(self.mesh.areas[self.mesh.task_mask].sum())

    @cached_property
    def values(self) -> ByName:
        """Values of the modes that colour the faces."""
        covered = None if self.areas is None else self.areas.covered
        need = self.need if self.part is None else np.ones_like(self.need)
        table = values_of(self.network, self.covered, self.names, covered, need)
        if self.part is not None:
            table = {**self.part.modes(), **table}
        table |= values_of_features(self.mesh, self.camera, self.network.task)
        for name, (values, _) in self.of_faces.items():
            mode, _, unit = name.rpartition("_")
            if unit == "um":  # in the unit of the text on it
                values, unit = (values, "µm") if values.max() < 1e3 else (values / 1e3, "mm")
            table[mode] = OfUnit(values, unit)
        if (dead := self.zones) is not None:  # of a face the reason of its largest dead piece
            order = sort_order(dead.piece_area)
            table["reason"][dead.face[order]] = dead.leads[order]
            table["reason"][table["area"] > 0.5] = Reason.COVERED
        devices = self._devices()
        return table if devices is None else table | {"device": devices}

    @cached_property
    def part(self) -> NetworkPart | None:
        """Additions of a feature, where the scene has several phases."""
        return part_of(self.areas)

    def _devices(self) -> OfCameras | None:
        """The camera of a rig with a rule that fails on most of what is dead of each face."""
        zones, said = self.dead
        names = list(device_hatches(said["dead_zones"]))
        if not names:
            return None
        of_zone = [
            names.index(device_words(zone)) if "device" in zone else -1
            for zone in said["dead_zones"]
        ]
        device = np.append(of_zone, -1)[np.minimum(zones.zone, len(of_zone))]
        dead = np.zeros((len(names), self.mesh.n_faces))
        is_known = device >= 0
        np.add.at(dead, (device[is_known], zones.face[is_known]), zones.piece_area[is_known])
        row = np.where(dead.any(axis=0), dead.argmax(axis=0), -1)
        return of_devices(np.where(self.covered, len(names), row), names)

    @cached_property
    def seen_m2(self) -> FloatArray | None:
        """(P,) area that each camera covers; None where its regions are not known."""
        if self.covers is not None and self.areas is None:
            of_task = np.where(self.mesh.task_mask, self.mesh.areas, 0.0)
            return np.asarray(self.covers @ of_task, np.float64)
        if self.parts is None:
            return None
        areas = np.bincount(self.parts.pair_pose, self.parts.area, len(self.poses))
        return areas.astype(np.float64)

    @cached_property
    def _away(self) -> FloatArray | None:
        """(P,) mean distance of each camera from the faces of what it covers, 0 for none."""
        parts, seen = self.parts, self.seen_m2
        if parts is None or seen is None:
            return None
        away = norm(self.eyes[parts.pair_pose] - self.mesh.centroids[parts.pair_face])
        sums = np.bincount(parts.pair_pose, parts.area * away, len(self.poses))
        return np.asarray(sums / np.maximum(seen, TINY), np.float64)

    @cached_property
    def lost_m2(self) -> FloatArray | None:
        """(P,) area that is not covered any more without each camera; None where not known."""
        if self.part is not None and not self.part.is_any:
            return None
        if self.parts is not None:
            return lose_without(self.parts, self.need)
        if self.areas is not None or (self.need > 1).any():
            return None
        best = best_covering(self.network)
        alone = self.mesh.task_mask & (self.network.views == 1) & (best >= 0)
        areas = self.mesh.areas[alone]
        return np.bincount(best[alone], areas, len(self.poses)).astype(np.float64)

    @cached_property
    def dead(self) -> tuple[DeadZones, ReadByName]:
        """Dead zones, and their entries as of `zones.summary_of`.

        By face those of whole faces; only the worst have advice.
        """
        if self.zones is not None:
            return self.zones, self.figures
        left, why = self.mesh.task_mask & ~self.covered, reasons_of(self.network, self.covered)
        of_left = np.where(left, why.astype(np.int64), -1)
        zones = face_zones(self.mesh, of_left, self.network.views, self.need)
        entries = zones.places(zones.listed())
        for row, entry in enumerate(entries):
            faces = zones.face[zones.zone == row].astype(np.int64)
            away = norm(self.mesh.centroids[faces] - entry["centroid"])
            face = int(faces[away.argmin()])  # the one in the middle
            entry |= {"reason": NAMES[why[face]], "hidden_by": None}
            if row < MOST_CLOSE_UPS:
                entry |= self._advice_for(faces, int(why[face]))
            if why[face] == Reason.OCCLUDED and len(self.mesh.groups) == 1:  # by itself
                entry["hidden_by"] = self.mesh.groups[0].name
        return zones, {"dead_zones": entries, "other_dead_zones": zones.others()}

    def _advice_for(self, faces: IntArray, why: int) -> ByName:
        """Group that hides the middle face of some, and advice for the pose that comes nearest."""
        mesh, task = self.mesh, replace(self.network.task, views=1, min_angle_deg=0.0)
        some = faces[np.unique(np.linspace(0, len(faces) - 1, MOST_FACES).astype(np.int64))]
        spot, hider = ZoneSpot.of(mesh.centroids[some], some, int(self.need[some].max())), None
        if why == Reason.OCCLUDED:
            from rastercov.placement.uncovered import in_front  # loads all of placement

            away = norm(self.eyes - spot.at)
            nearest, face = self.poses[away.argmin(axis=0, keepdims=True)], some[spot.middle][None]
            axes = axes_of(self.camera, nearest)
            eye = nearest.eyes
            shares = in_front(mesh, eye, face, axes=axes)[0]
            hider = mesh.groups[int(shares.argmax())].name if shares.any() else None
        before = blocker(hider, mesh.groups[mesh.face_group[some[spot.middle]]].name)
        remedies = FaceRemedies(mesh, self.camera, task, self.poses, None, self.allowed)
        none = np.zeros(0, np.int64)
        return {"hidden_by": hider} | remedies.say(spot, why, none, before, is_tried=True)

    def overview(self) -> Image.Image:
        """The surface by the camera that covers it; of very many, by what they cover together."""
        if len(self.poses) <= MOST_COLOURS:
            best = best_covering(self.network)
            zones, said = self.dead
            shown = Overview(
                self.mesh,
                self.camera,
                self.poses,
                self.labels,
                best,
                self.parts,
                zones=zones,
                said=said["dead_zones"],
                noun=self.noun,
                volumes=[*self.volumes, *self._lamps()],
                most=f"{self._covers} it{self._long}",
                left=f"not covered{self._long}"
                if self._covers == "covers"
                else f"covered by no {self.noun}",
            )
            if self.part is not None:
                shown = replace(
                    shown,
                    best_pose=self.part.best(),
                    regions=None,
                    most=f"covers it {self.part.most}",
                )
            return shown.picture()
        mode = "views" if self.areas is None else "area"
        return mode_picture(mode, self.mesh, self.values[mode], self.poses.world_from_camera)

    def draw(self, progress: Progress = silent) -> dict[str, Image.Image]:
        """Overview, and if there are dead zones a picture of all and of each of the worst."""
        zones, said = self.dead
        poses = self.poses.world_from_camera
        tasks: dict[str, Callable[[], Image.Image | None]] = {"overview": self.overview}
        if zones:
            tasks["zones"] = partial(zones_picture, zones, said, poses)
        tasks |= self._close_ups()
        for each in self.goals[:MOST_CLOSE_UPS]:
            tasks |= each.page._close_ups(f"goal_{each.name}_") if each.is_short else {}
            tasks[f"goal_{each.name}"] = each.picture
        for name in (each for each in OF_SENSORS if each in self.values):
            tasks[name] = partial(
                mode_picture, name, self.mesh, self.values[name], poses, left=self.zones
            )
        if self.part is not None:
            tasks |= self.part.pictures
        names, table = list(tasks), {}

        def work(turn: slice) -> None:
            for name in names[turn]:
                table[name] = tasks[name]()
                progress(len(table), len(tasks))

        progress(0, len(tasks))
        share_poses(len(tasks), [work] * thread_count(None))
        return {name: image for name in names if (image := table[name]) is not None}

    @cached_property
    def shown_zones(self) -> list[tuple[ReadByName, list[str], str, list[str], bool]]:
        """The worst dead zones, with their rows of a table, the nearest camera, and words.

        They are on what is covered after the change, and on goals. Zones in what fails a goal are
        first, which the last entry is True of.
        """
        shown, found = number_cameras(self.dead[1]), list[tuple[bool, int, list[str]]]()
        short, groups = [e for e in self.required if e.status != HOLDS], self.mesh.groups
        for row, zone in enumerate(shown):
            own = [each for each in short if names_in(groups, each.group) & {*zone["groups"]}]
            found.append((not own, row, [self._after(zone, each) for each in own]))
        rows, items, added = zone_rows(self.dead[1]), [], dict[str, float]()
        for is_met, row, said in sorted(found)[:MOST_CLOSE_UPS]:
            zone, tried = shown[row], shown[row]["tried"] or {}
            if "gain_m2" in tried and "covered_area" in self.figures:
                moved = tried.get("group_gains_m2", {}).values()  # what others lose, too
                gains = {"then": sum(moved) if moved else tried["gain_m2"]} if is_met else {}
                if tried["pose"] is None:  # zones do not overlap: what cameras add in them adds up
                    added[rows[row][0]] = tried["gain_m2"]
                    if len(added) > 1:
                        with_all = f"with what is added for zones {', '.join(added)}"
                        gains[with_all] = sum(added.values())
                said += [f"{when} {self._with_more(m2)}" for when, m2 in gains.items()]
            if is_met and self.required:
                said.append("this surface meets its goal even so")
            items.append((zone, rows[row], self._nearest_of(zone), said, not is_met))
        return items

    def _with_more(self, m2: float) -> str:
        exact = self.figures["covered_area"]
        share = min((exact["m2"] + m2) / exact["of_m2"], 1.0)
        return f"about {percent(share)} of the area or more is covered"

    def _after(self, zone: ReadByName, required: "Requirement") -> str:
        """Words on a requirement that fails for a zone, and on its share after the change."""
        tried, whole = zone["tried"] or {}, getattr(required, "of_m2", 0.0)
        gains = tried.get("group_gains_m2")
        members = names_in(self.mesh.groups, required.group)
        if "gain_m2" not in tried or not whole or not members >= {*zone["groups"]}:
            return f"missing in {required.called}"
        m2 = tried["gain_m2"]
        if gains:
            m2 = sum(gains.get(name, 0.0) for name in members)
        return f"missing in {required.called}; {required.after(m2 / whole, is_about=not gains)}"

    def _close_ups(self, prefix: str = "") -> dict[str, Callable[[], Image.Image | None]]:
        """Pictures of `shown_zones` by their names."""
        own = *self.dead, self.poses.world_from_camera
        return {
            f"{prefix}zone_{row}": partial(zone_close_up, *own[:2], int(row) - 1, own[2])
            for _, (row, *_), *_ in self.shown_zones
        }

    @cached_property
    def why_recorded(self) -> str:
        """Reason for which `view` shows recorded figures; "" where it computes them."""
        if (asked := self.asked) is None:
            return ""
        others = {
            "results over time": self.part is not None,
            "results by face": self.areas is None,
            "methods other than certified": asked.method != "certified",
        }
        scene = self.mesh, self.camera, len(self._placed[0]), asked.task
        why = record_cause(*scene, others, asked.goals)
        if why == NO_ENGINE:
            logging.getLogger("rastercov").warning(why)
        return why

    @property
    def _placed(self) -> tuple[Poses, Sequence[str]]:
        """Poses and names of all cameras."""
        every = None if self.asked is None else self.asked.placed
        return every or (self.poses, self.names)

    @property
    def covered_faces(self) -> list[int]:
        """Number of faces that each camera covers; of a head, that of its first one."""
        counts, placed = self.network.covered_faces, self._placed[0]
        if len(counts) == len(self.poses):
            return counts
        return [counts[row] for row in led_by(self.camera, placed)]

    @cached_property
    def view(self) -> str | None:
        """The page to look around in, which computes where it can; None for a large mesh."""
        if self.asked is not None and not self.why_recorded:
            return view_of(self.title, self.mesh, self.camera, *self._placed, self.asked, self.unit)
        return view_page(  # with the figures that are known
            self.title,
            self.mesh,
            self.camera,
            self.poses,
            self.names,
            self.values,
            figures_of(self.figures, self.covered_faces, self.seen_m2, self.lost_m2, self.task_m2),
            zone_entries(self.mesh, self.zones, self.figures) if self.zones else (),
            unit=self.unit,
            phases=None if self.part is None else self.part.view(),
            notes=[self.why_recorded] if self.why_recorded else [],
        )

    def page(self, template: str, images: Mapping[str, Image.Image], **values: Any) -> str:
        """The page with images as of `draw`, by a template that extends `report.html`.

        `values` are those that the template wants; `title_block` is that of the run unless given.
        """
        title_block = (values["run"]["options"] or {}).get("sheet") or {}
        own = values.pop("notes", ()), values["summary"], values.get("under", "")
        has_room = bool(values.get("stops"))
        rows, more = self.camera_table(values.pop("columns", {}))
        drawn = {name: Picture.draw("", image) for name, image in images.items()}
        by_area, cameras = "covered_area" in self.figures, cameras_of(self.camera)
        return render(
            template,
            "rastercov.report" if self.part is None else self.part.package,
            title=self.title,
            page=self,
            rules=self._rules(),
            is_joint=bool(gates_of(self.camera)),
            goals=self.asked and self.asked.goals,
            kinds=[(names_of(self.camera)[at], camera_words(cameras[at])) for at in self._used],
            pictures={
                name: replace(drawn[name], alt=text)
                for name, text in pictures_in_words().items()
                if name in drawn
            }
            | values.pop("more", {}),
            close_ups=drawn,
            zone_rows=zone_rows(self.dead[1]),
            features=table_of(self.features, self.unit),
            by_area=by_area,
            cameras_heading=f"{self.noun.capitalize()}s",
            camera_headings=more,
            camera_table=rows,
            figures=self.figures,
            conditions=self._conditions(*own, has_room),
            section=None if self.part is None else self.part.template,
            own=None if self.part is None else self.part.section(self.figures),
            names=dict(zip(self.poses.ids.tolist(), self.names, strict=True)),
            reasons=REASONS,
            view=self.view,
            **{"title_block": title_block, "by_face": self.areas is None, **values},
        )

    @cached_property
    def features(self) -> list[FeatureRow]:
        """Rows of features, with those of goals; none for one, or a scene of several phases.

        What must not be seen has no best camera: its goal says who sees it.
        """
        rows = sorted(
            chain(
                self._features(),
                *(goal.page._features() for goal in self.goals if not goal.is_most),
            ),
            key=lambda each: (each.covered_percent, -each.area_m2),
        )
        return rows if len(rows) > 1 else []

    def _features(self) -> list[FeatureRow]:
        if self.part is not None:
            return []
        poses, names = self._placed
        if sensors := self.sensors:
            names = [" ".join(row[:2]) for row in sensors[1]]
        scene = self.mesh, self.camera, poses, self.network.task
        return feature_rows(*scene, names, self.figures)

    def _rules(self) -> list[str]:
        """Sentences on what devices measure together, on focus, and on equipment."""
        names, task = names_of(self.camera), self.network.task
        gates = gates_of(self.camera).items()
        said = [gate.in_words(names[at : at + gate.n]) for at, gate in gates]
        if isinstance(rig := self.camera, Rig):
            of_two = (slice(at, at + 2) for at, gate in gates if gate.n == 2)
            said += [
                _crossing(rig.rig_from_camera[at]) for at in of_two if not rig.is_fixed[at].any()
            ]
        every = [(names[row], cameras_of(self.camera)[row]) for row in self._used]
        ends = {name: each.depth_of_field(task.max_blur) for name, each in every}
        focus = {name: focus_in_words(own) for name, own in ends.items() if own != NO_FOCUS}
        if len({*focus.values()}) == 1 and len(focus) == len(every):
            said.append(f"It must be in focus, at a depth of {focus.popitem()[1]}.")
        said += [f"{name} must be in focus, at a depth of {text}." for name, text in focus.items()]
        for word, own in equipment_on(self.camera).items():
            words = (
                f"{name} ({own._words(at, vars(task))})"
                + f" at ({coordinates(own.places[at][:3, 3], 3)}) m" * bool(own._has_position(at))
                + OF_CAMERA.format(coordinates(own.places[at][:3, 2], 2)) * bool(own.rides[at])
                for at, name in enumerate(own.names)
            )
            said.append(f"{word.capitalize()}: {first_of([*words])}.")
        return said

    def _conditions(
        self, notes: Sequence[str], summary: ReadByName, under: str, has_room: bool
    ) -> list[str]:
        """Sentences on what the figures take for granted; requirements must hold `under` errors.

        An arm `has_room` for its cameras.
        """
        room = "" if has_room else "; room for bodies and cables is not checked"
        blur, every = self.network.task.max_blur, cameras_of(self.camera)
        used, types = self._used, names_of(self.camera)
        sharp = [types[at] for at in used if every[at].depth_of_field(blur) == NO_FOCUS]
        who = first_of(sharp) if len(sharp) < len(used) else f"each {self.noun}"
        there = np.unique(self.mesh.face_group).tolist()
        groups = [self.mesh.groups[row] for row in there]
        names = openings_in_words([each.name for each in groups if not each.is_target])
        lights = first_of([*equipment_on(self.camera)])
        said = {
            f"all surfaces are opaque and as in the file{names}": True,
            f"each {self.noun} is exactly where its table has it: no mounting errors{room}": (
                not under
            ),
            f"in focus at any distance, without a depth of field: {who}": bool(sharp),
            f"light comes straight from the {lights}, without reflections": bool(lights),
            "there is light enough everywhere: none is modelled": not lights,
            "what moves is as in its frames: nothing between them is checked": self.part
            is not None,
            "areas are estimates by samples, without a bound of their error": (
                self.asked is not None and self.asked.method == "sampled"
            ),
        }
        skipped = (
            f"pose {pose} was skipped: its process {end}"
            for pose, end in summary["quarantined"].items()
        )
        return [*(text for text, holds in said.items() if holds), *dict.fromkeys(notes), *skipped]

    def _lamps(self) -> list[Volume]:
        """Equipment beside the cameras, to be drawn."""
        if not equipment_on(self.camera):
            return []
        from rastercov.report.drawing import devices_of  # loads shapely

        placed = self._placed[0]
        size = LAMP_REL * float(np.ptp([*self.mesh.bounds, *placed.eyes], axis=0).max())
        every = islice(devices_of(self.camera, placed, self.network.task), MOST_LAMPS)
        return [
            Volume.sphere(
                f"{word.removesuffix('s')} {each.name}", LAMP, each.pose[:3, 3], size, True
            )
            for word, each in every
            if each.has_position
        ]

    @property
    def _used(self) -> list[int]:
        """Indices of the cameras that have poses, or else of those of rigs with a rule."""
        index: IntArray = np.unique(self._placed[0].camera)
        gates = gates_of(self.camera).items()
        return index.tolist() or [at + row for at, gate in gates for row in range(gate.n)]

    @property
    def answer(self) -> str:
        """Headline: what the cameras cover."""
        covered = self.figures.get("covered_area")
        who = plural(len(self.poses), self.noun, "cover")
        if covered is None:
            return f"{who} {percent(self.figures['covered']['area_percent'] / 100)} of the area"
        share = with_bound(covered["percent"], covered["bound_percent"])
        return f"{who} {share} of the area{self._long}"

    @property
    def _long(self) -> str:
        """Words on the phases in which parts are covered, after a space; none of one phase."""
        return "" if self.part is None else f" {self.part.words}"

    @property
    def _covers(self) -> str:
        """Verb of one camera; it does not cover a part where several must."""
        is_shared = self.part is None and (self.need > 1).any()
        return "gives a view of" if is_shared else "covers"

    @property
    def covered_words(self) -> str:
        """Words on the exact area, and on what fewer cameras cover; none where it is not known."""
        exact = self.figures.get("covered_area")
        if exact is None:
            return ""
        some = area(exact["m2"], self.unit, exact["of_m2"]) if exact["m2"] else "None"
        by_fewer = in_words(exact, self.noun).partition(" of the area")[2]
        return f"{some} of {area(exact['of_m2'], self.unit)} is covered{by_fewer}{self._long}"

    @property
    def _least(self) -> float:
        return LEAST_LOST_REL * self.task_m2

    def _areas(self, values: FloatArray, whole: float) -> list[str]:
        return [
            area(value, self.unit, whole) if value > self._least else "0"
            for value in values.tolist()
        ]

    def captions(self) -> list[str]:
        """Lines below the image of each camera: its name and type, and what it covers."""
        types, covers = names_of(self.camera), [plural(n, "whole face") for n in self.covered_faces]
        if self.seen_m2 is not None:
            covers = [f"{percent(m2 / self.task_m2)}{self._long}" for m2 in self.seen_m2.tolist()]
        return [
            f"{image_name(name, self.noun)}{f', {types[index]}' * bool(types[1:])}\n"
            f"{self._covers} {own}"
            for name, index, own in zip(self.names, self.poses.camera, covers, strict=True)
        ]

    def camera_table(self, more: Mapping[str, Sequence[str]]) -> tuple[list[list[str]], list[str]]:
        """Rows of the cameras and their headings.

        `more` are further columns by their headings; without them, those that add most are first.
        """
        types, seen, lost = names_of(self.camera), self.seen_m2, self.lost_m2
        columns: dict[str, Sequence[str]] = {self.noun: self.labels}
        if len({*self.poses.camera.tolist()}) > 1 and self.noun != "pose":
            columns["type"] = [types[index] for index in self.poses.camera.tolist()]
        columns |= self._mounting(self.poses)
        if self._away is not None:
            columns["mean distance"] = [
                distance(x, self.unit) if x else "-" for x in self._away.tolist()
            ]
        whole = 0.0
        if seen is None:
            columns["faces covered"] = [f"{count:,}" for count in self.covered_faces]
        else:
            whole = float(seen.max(initial=0.0))  # one unit for a row
            columns[f"{self._covers}{self._long}"] = self._areas(seen, whole)
        order = np.arange(len(self.poses))
        if lost is not None:
            columns["lost without it"] = self._areas(lost, whole)
            if not more:  # which follow the order of the names
                order = sort_order(-lost)
        for goal in self.goals:
            if goal.areas_m2 is not None:
                what = "seen" if goal.is_most else "lost without it"
                columns[f"{goal.name}: {what}"] = self._areas(goal.areas_m2, 0.0)
        columns |= more
        return [[each[row] for each in columns.values()] for row in order.tolist()], list(columns)

    def _mounting(self, placed: Poses) -> dict[str, Sequence[str]]:
        """Columns of a table with positions and angles of poses."""
        columns: dict[str, Sequence[str]] = {}
        is_small = self.unit == "m" and np.abs(self.eyes).max(initial=1e-12) < SMALL
        unit = "mm" if is_small else "m" if self.unit == "m" else "units"
        for name, places in zip("xyz", placed.eyes.T * (1e3 if is_small else 1.0), strict=True):
            digits = {"m": 3, "mm": 1}.get(unit)
            columns[f"{name}, {unit}"] = [
                length(value) if digits is None else text_with_sign(value, digits)
                for value in places.tolist()
            ]
        turned = [self._angles(pose) for pose in placed.world_from_camera]
        return columns | {
            name: [each[row] for each in turned]
            for row, name in enumerate(("heading", "tilt down", "roll"))
        }

    @cached_property
    def _axes(self) -> FloatArray:
        """As of `upright` for the poses."""
        return upright(self.poses.world_from_camera)

    def _angles(self, pose: FloatArray) -> list[str]:
        """Heading, tilt and roll of a pose, as tables have them."""
        angles = mounting_angles(self._axes @ pose[:3], self.north)
        return [f"{text_with_sign(each, 1)}°" for each in angles]

    def turned(self, zone: ReadByName) -> str:
        """Words on the angles of the change that was tried for a zone; "" for none."""
        if not zone["tried"]:
            return ""
        (pose,) = look_at(zone["tried"]["position"], zone["tried"]["looking_at"])
        heading, tilt, roll = self._angles(pose)
        return f"Its heading is then {heading}, its tilt down {tilt}, its roll {roll}."

    @property
    def sensors(self) -> tuple[list[str], list[list[str]]] | None:
        """Headings and rows of the sensors of heads; None where these have one each."""
        placed, _ = self._placed
        if len(placed) == len(self.poses):
            return None
        names, of = names_of(self.camera), self._head_of(placed.ids)
        columns: dict[str, Sequence[str]] = {
            self.noun: [self.labels[row] for row in of],
            "sensor": [names[row] for row in placed.camera.tolist()],
            **self._mounting(placed),
        }
        return [*columns], list(map(list, zip(*columns.values(), strict=True)))

    def _head_of(self, pose: ArrayLike) -> list[int]:
        """Row of the pose that is shown for each of all poses: of a rig with a rule its first."""
        places = np.searchsorted(self.poses.ids, np.atleast_1d(pose), side="right") - 1
        rows: list[int] = places.tolist()
        return rows

    def _nearest_of(self, zone: ReadByName) -> str:
        """Name of the camera that comes closest to covering a zone's middle; "" for none."""
        if zone["nearest"] is None:
            return ""
        (row,) = self._head_of(zone["nearest"]["pose"])
        return f"{self.noun} {self.labels[row]}"


def _crossing(places: FloatArray) -> str:
    """Sentence on two devices of a rig by their poses, (2, 4, 4)."""
    across, ways = places[1, :3, 3] - places[0, :3, 3], places[:, :3, 2] * ((1,), (-1,))
    reach = float(np.linalg.lstsq(ways.T, across)[0][0])
    cross = f"; their axes cross {distance(reach)} away" if reach > TINY else ""
    return f"They are {distance(float(norm(across)))} apart{cross}."


class FaceRemedies(Remedies):
    """Changes that are tried on whole faces."""

    most_judged = 12

    def _more_figures(self, row: int, spot: ZoneSpot) -> dict[str, float]:
        """The pixels of the face in the middle."""
        scene = self.mesh, self.camera, self.poses[row : row + 1], self.task
        result = evaluate(*scene, fields=("drawn_pixels",), by="face")
        return {"drawn_pixels": float(result.drawn_pixels[0, spot.face[spot.middle]])}

    def _share(self, change: Change, row: int, spot: ZoneSpot) -> float:
        """As of `Remedies`; of the faces that are covered as a whole."""
        if super()._share(change, row, spot) < SURE:
            return 0.0
        camera, task, poses = self._place_changes([change], row)
        result = evaluate(self.mesh, camera, poses, task, fields=("reason",), by="face")
        return float((result.reason[:, spot.face] == Reason.COVERED).any(axis=0).mean())
