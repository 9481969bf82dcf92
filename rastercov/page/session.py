"""Session of a viewer: edits, undo, and faces as bytes, without a server or a browser.

Methods may be called from any thread, one at a time: `Session.lock` is theirs. Work that takes
long, such as a refinement, runs in `rastercov.page.work` and hands its state back.
"""

import base64
import json
import secrets
import struct
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from io import BytesIO
from threading import RLock
from typing import Any

import numpy as np
from PIL import Image

from rastercov.base.arguments import check_choice
from rastercov.base.checks import number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import ByName, ReadByName, distance
from rastercov.base.memory import TINY, FloatArray
from rastercov.core.area.advice import task_in_words
from rastercov.core.area.features import FEATURES
from rastercov.core.area.frames import to_world
from rastercov.core.camera.pose import inverse
from rastercov.core.mesh.groups import rows_of
from rastercov.core.mesh.unseeable import unseeable_where_seen
from rastercov.page.actions import (
    Constrain,
    Drawing,
    OfVariant,
    Request,
    Step,
    applied,
    checked,
    request_of,
)
from rastercov.page.measurements import (
    BYTES_A_FACE,
    LIVE_PAIRS,
    MOST_BYTES,
    ROUGH,
    Areas,
    Measurements,
    NetworkFigures,
    why,
)
from rastercov.page.rig_state import History, RigState
from rastercov.page.scene import (
    OF_A_RIG,
    SEGMENT_OPTIONS,
    Scene,
    described_state,
    place_words,
)
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.plan.network import (
    Requirement,
    judge,
    judge_areas,
    limits_of,
    views_by_group,
)
from rastercov.placement.select.problem import in_whole_numbers, weights_of
from rastercov.report.camera_pictures import by_faces, camera_keys, camera_pixels, camera_scene
from rastercov.report.modes import OCCLUDER, OCCLUDER_OF_REASONS, mode_of
from rastercov.report.pages import described_frame, soup_of, zone_entries

LEAST_SIDE, MOST_SIDE = 64, 2048
LEAST_MOVED_REL = 1e-6
"""Distance from which a place that the constraints change is said, in that of the mesh."""
MOST_MOMENTS = 64
"""Phases whose figures are kept."""


class StaleError(ConfigError):
    """An edit of a state that is no longer the present one."""


class Moment:
    """The scene in one phase, for its task or a goal, see `Scene.placed`, and what is measured."""

    def __init__(self, scene: Scene, at: tuple[float, ...], method: str, goal: str = "") -> None:
        self.scene, self.goal = scene, scene.goal(goal)
        self.mesh, self.kept, self.poses = scene.placed(at, self.goal)
        self.measurements = Measurements(self.mesh, method, scene.by)
        self._shown: tuple[RigState, RigState] | None = None
        self._figures: NetworkFigures | None = None

    def shown(self, state: RigState) -> RigState:
        """The state with cameras where bodies carry them, and the thresholds of the goal."""
        kept = self._shown  # which another thread may change
        if kept is None or kept[0] is not state:
            own = self.scene.carriers(state.cameras)
            bodies = {name: self.poses[body] for name, body in own.items()}
            placed = state.carried(bodies)
            if self.goal is not None:
                plan = self.goal.plan
                placed = replace(placed, task=plan.build_task(), needed=views_by_group(plan, None))
            self._shown = kept = state, placed
        return kept[1]

    def at_rest(self, made: RigState, shown: RigState, state: RigState) -> RigState:
        """A state that was made of the one that is shown, with cameras where they are at rest."""
        own = self.scene.carriers(made.cameras)
        back = {name: inverse(self.poses[body]) for name, body in own.items()}
        rest = made.carried(back)
        same = dict(zip(shown.stations, state.stations, strict=True))
        pairs = zip(made.stations, rest.stations, strict=True)
        stations = tuple(same.get(one, other) for one, other in pairs)
        if self.goal is not None:
            rest = replace(rest, task=state.task, needed=state.needed)
        return replace(rest, stations=stations)

    def figures(self, state: RigState, *, is_drag: bool = False) -> NetworkFigures:
        """Coverage by the cameras of a state; during a drag of many pairs by whole faces."""
        shown, kept = self.shown(state), self._figures
        if kept is None or kept.state is not shown or kept.by_face_because == ROUGH:
            rows = self.measurements.rows(shown, shown.on)
            is_late = is_drag and len(rows) * self.mesh.n_faces > LIVE_PAIRS
            late = None, ROUGH
            areas, because = late if is_late else self.measurements.areas_or_why(shown)
            self._figures = kept = NetworkFigures(self.mesh, shown, rows, areas, because)
        return kept

    def required(self, state: RigState, *, is_drag: bool) -> list[ByName]:
        """Requirements of the plan for the task, or the goal, and its state, ready for JSON."""
        goal, plan = self.goal, self.scene.plan
        if plan is None or self.scene.phases is not None:
            return []
        figures = self.figures(state, is_drag=is_drag)
        if figures.by_face_because == ROUGH:
            return []
        limits = {None: goal.limit} if goal else limits_of(plan.selection)
        limits = {
            place: limit
            for place, limit in limits.items()
            if place is None or rows_of([group.name for group in self.mesh.groups], place)
        }
        wanted = figures.state.needed or figures.state.task.views
        if figures.areas is not None:
            network, is_seeable = figures.areas.network, plan.task.weight_by == "seeable"
            share = network.covered.area[0] / np.maximum(self.mesh.areas, TINY)
            left = self.mesh.areas - unseeable_where_seen(self.mesh, share) if is_seeable else None
            found: Sequence[Requirement] = judge_areas(network, limits, wanted, seeable=left)
        else:
            weights = in_whole_numbers(weights_of(self.mesh, plan.task.weight_by))
            found = judge(self.mesh, weights, limits, figures.covered)
        own = found if goal is None else [goal.required(each) for each in found]
        by_face, state = figures.areas is None, figures.state
        words = task_in_words(asdict(state.task), state.needed, by_face=by_face)
        name, asked = (goal.name, goal.asked) if goal else ("", words)
        return [
            {"goal": name, "status": each.status, "words": each.words(), "asked": asked}
            for each in own
        ]


class Session:
    """A rig that is edited, and what it covers.

    Parameters
    ----------
    scene : Scene
        Mesh, first state, and plan.
    method : str
        Method of visibility.
    """

    def __init__(self, scene: Scene, method: str = "certified") -> None:
        self.scene, self.lock = scene, RLock()
        self.name = secrets.token_hex(8)  # a page tells by it that the program was started again
        self.history = History(scene.start)
        for each in FEATURES:
            each.check(scene.start.whole, scene.start.task)
        self.at: tuple[float, ...] = ()
        self.goal = ""
        """Name of the goal that is shown, "" for the task."""
        self._method, self._moments = method, OrderedDict[tuple[Any, ...], Moment]()
        self.take_time(())
        self.is_kept = scene.has_constraints
        self.variants: dict[str, tuple[RigState, ByName]] = {}  # with their figures
        self.drawing: Drawing | None = None  # under the floor plan
        self.is_drawing_saved = True
        self._in_phases: tuple[RigState, Mapping[str, FloatArray]] | None = None
        self._is_drag = False
        self._moved = ""  # what the constraints made of the last place
        self._segments: tuple[tuple[float, float], Segmentation] | None = None

    @property
    def state(self) -> RigState:
        """The present state."""
        return self.history.state

    @property
    def moment(self) -> Moment:
        """The scene at the time that is shown."""
        return self._moments[self.at, self.goal]

    @property
    def measurements(self) -> Measurements:
        """Everything that is measured at that time."""
        return self.moment.measurements

    @property
    def shown(self) -> RigState:
        """The present state with cameras where they are at that time."""
        return self.moment.shown(self.state)

    def take_time(self, at: tuple[float, ...], goal: str = "") -> None:
        """Show a phase, the first for (), and the task or a goal of the plan."""
        at = (at or (0.0,)) if self.scene.phases else ()
        before = self._moments.get((self.at, self.goal))
        if self._moment(at, goal) is not before and before is not None and at != self.at:
            before.measurements.close()  # its rows stay
        self.at, self.goal = at, goal

    def _moment(self, at: tuple[float, ...], goal: str) -> Moment:
        """The scene at a time for a goal; the last `MOST_MOMENTS` stay measured."""
        if (at, goal) not in self._moments:
            self._moments[at, goal] = Moment(self.scene, at, self._method, goal)
        self._moments.move_to_end((at, goal))
        size = BYTES_A_FACE * self.scene.mesh.n_faces * max(1, len(self.state.stations))
        kept = max(1 + len(self.scene.goals), min(MOST_MOMENTS, MOST_BYTES // size))
        while len(self._moments) > kept:
            self._moments.popitem(last=False)[1].measurements.close()
        return self._moments[at, goal]

    def close(self, seconds: float = -1) -> None:
        """Give back what measures, unless an answer takes more than `seconds`; -1 waits for it."""
        if self.lock.acquire(timeout=seconds):
            try:
                for each in self._moments.values():
                    each.measurements.close()
            finally:
                self.lock.release()

    def described(self) -> ByName:
        """The scene, ready for JSON."""
        return self.scene.described(is_kept=self.is_kept)

    def described_state(self) -> ByName:
        """The present state and what may be undone, ready for JSON."""
        state, entries = self.history.described()  # which does not wait for a measurement
        variants = [
            figures
            | {"name": name, "is_shown": kept is state, "is_of_task": kept.task == state.task}
            for name, (kept, figures) in self.variants.copy().items()
        ]
        own = {"session": self.name, "is_kept": self.is_kept, "variants": variants, "at": self.at}
        own["goal"] = self.goal
        own["is_saved"] = entries["is_saved"] and self.is_drawing_saved
        return described_state(self.scene, state, self.moment.shown(state), entries | own)

    def described_drawing(self) -> ByName:
        """The drawing under the floor plan, ready for JSON; empty where there is none."""
        return {} if self.drawing is None else self.drawing.model_dump()

    def draw(self, changes: ReadByName) -> None:
        """Take other entries of the drawing, or no drawing without any."""
        with self.lock:
            known = self.described_drawing()
            self.drawing = checked(Drawing, {**known, **changes}) if changes else None
            self.is_drawing_saved = False

    def act(self, entries: ReadByName) -> bytes:
        """Carry out an edit; a frame of the faces after it.

        Parameters
        ----------
        entries : mapping
            As `rastercov.page.actions.Request`.

        Raises
        ------
        StaleError
            For an edit of another revision than the present one.
        RastercovError
            For an edit that cannot be; the state stays as it is.
        """
        request = request_of(entries)
        with self.lock:
            check_choice("mode", request.mode, OF_A_RIG)
            self.take_time(tuple(request.at), request.goal)
            self._moved = ""
            self._is_drag = request.is_drag
            self._edit(request)
            notice = "" if request.is_drag else self._moved
            return self.frame(request.mode, request.options, request.station, notice)

    def take(self, state: RigState, words: str, of_revision: int) -> None:
        """Make the result of work the present state; StaleError where that has moved on."""
        with self.lock:
            self._check_revision(of_revision)
            self.history.take(state, words)

    def frame(
        self, mode: str, options: ReadByName, station: int | None = None, notice: str = ""
    ) -> bytes:
        """Frame of the present state, with a line for the user: JSON, then levels of faces."""
        with self.lock:
            figures = self.figures()
            moment, mesh = self.moment, self.scene.mesh
            values = self._values(figures, mode, options, station)
            painted = mode_of(mode).paint(moment.mesh, values)
            of_others = OCCLUDER_OF_REASONS if mode == "reason" else OCCLUDER
            away = 0 if self.scene.phases else of_others  # of a body, or of targets of other goals
            levels = np.full(mesh.n_faces, away, np.uint8)
            levels[moment.kept] = painted.levels
            head = described_frame(mode, painted) | {"summary": self._summary()}
            head |= {"state": self.described_state(), "notice": notice}
            if len(self.at) > 1:
                poses = np.stack(list(moment.poses.values()))[:, :3]
                head["bodies"] = base64.b64encode(np.ascontiguousarray(poses).data).decode()
            return framed(head, levels.tobytes())

    def figures(self) -> NetworkFigures:
        """Coverage by the cameras of the present state."""
        with self.lock:
            return self.moment.figures(self.state, is_drag=self._is_drag)

    def areas(self) -> Areas:
        """Exact area that they cover; ConfigError where the result is by face."""
        figures = self.figures()
        if figures.areas is None:
            raise ConfigError(figures.by_face_because)
        return figures.areas

    def pieces(self) -> bytes:
        """Frame of the convex pieces that too few cameras cover; ConfigError as `areas`.

        Number of pieces, face of each, row of its reason in `REASONS`, and its corners, uint32;
        then the corners, float32 from the origin of the soup.
        """
        with self.lock:
            moment, found = self.moment, self.areas()
        zones = found.zones
        counts, origin = np.diff(zones.starts), soup_of(self.scene.mesh)[0]
        corners = to_world(moment.mesh, np.repeat(zones.face, counts), zones.xy) - origin
        of_pieces = moment.kept[zones.face], zones.leads, counts
        numbers = np.concatenate(([len(counts)], *of_pieces)).astype("<u4")
        return framed({}, numbers.tobytes() + corners.astype("<f4").tobytes())

    def image(self, station: int, side: int) -> bytes:
        """Frame of a camera's own image, its distortion included: title, size, legend, then a PNG.

        Parameters
        ----------
        station : int
            Id of the station.
        side : int
            Longest side, px; at most that of the camera.

        Raises
        ------
        ConfigError
            For a station that is gone, or a side outside its limits.
        """
        if not LEAST_SIDE <= side <= MOST_SIDE:
            raise ConfigError(
                f"expected a side from {LEAST_SIDE} to {MOST_SIDE} px, got {side}; correct it"
            )
        with self.lock:
            mesh, state = self.moment.mesh, self.shown
            own = state.station(station)
            (row,) = self.measurements.rows(state, [own])
        camera = state.camera_of(own)
        small = camera.resized(min(1.0, side / max(camera.width, camera.height)))
        found = by_faces(camera_scene(mesh, small, own.pose), row.failed)
        image, buffer = Image.fromarray(camera_pixels(found)), BytesIO()
        legend = [
            {
                "label": key.name,
                "colour": first,
                "stripe": next(iter(others), None),
                "hatch": key.hatch,
            }
            for key in camera_keys(found)
            for first, *others in (key.colours,)
        ]
        image.save(buffer, "PNG", compress_level=1)
        head = {"width": image.width, "height": image.height, "title": own.name, "legend": legend}
        return framed(head, buffer.getvalue())

    def why(self, face: int) -> ByName:
        """Reason of a face, ready for JSON."""
        with self.lock:
            kept = self.moment.kept
            row = int(np.searchsorted(kept, face))
            if 0 <= face < self.scene.mesh.n_faces and (row == len(kept) or kept[row] != face):
                raise ConfigError(
                    "expected a face of this frame, got one of an absent body; pick another"
                )
            return why(self.measurements, self.figures(), row if row < len(kept) else face)

    def zones(self) -> list[ByName]:
        """Dead zones by exact area, the largest first, ready for JSON."""
        with self.lock:
            areas, moment = self.areas(), self.moment
            found = zone_entries(moment.mesh, areas.zones, areas.dead_zones())
            return [each | {"faces": moment.kept[each["faces"]].tolist()} for each in found]

    def space(self) -> PoseSpace:
        """Allowed places of cameras."""
        with self.lock:
            return self.scene.space(self.shown)

    def _edit(self, request: Request) -> None:
        action, history = request.action, self.history
        if action.do != "none":
            self._check_revision(request.revision)
        if isinstance(action, Step):
            (history.undo if action.do == "undo" else history.redo)()
        elif isinstance(action, Constrain):
            if action.is_kept and not self.scene.has_constraints:
                raise ConfigError(
                    "expected constraints, got a scene without any; open a plan with some"
                )
            self.is_kept = action.is_kept
        elif isinstance(action, OfVariant):
            self._vary(action)
        else:
            shown = self.shown
            if self.goal and action.do == "task":
                raise ConfigError(
                    "expected the task to be shown for new thresholds, got a goal; choose the task"
                )
            made, words = applied(action, shown, self._settled)
            if words:
                made = self.moment.at_rest(made, shown, self.state)
                history.take(made, words, is_drag=request.is_drag)

    def _vary(self, action: OfVariant) -> None:
        name, known = action.name, self.variants
        if action.do == "keep_variant":
            figures = self._summary()
            kept = {
                each: figures[each]
                for each in ("covered", "covered_area", "cost")
                if each in figures
            }
            known[name] = self.state, kept | {"cameras": len(self.state.on)}
        elif name not in known:
            raise ConfigError(f"expected a saved variant, got {shown(name)}; pick another")
        elif action.do == "drop_variant":
            del known[name]
        elif known[name][0] is not self.state:
            self.history.take(known[name][0], f"show {name}")

    def _check_revision(self, revision: int) -> None:
        if revision != self.history.revision:
            raise StaleError(
                f"expected revision {self.history.revision} of the rig, got {revision}; reload the "
                "page"
            )

    def _settled(self, wanted: FloatArray, before: FloatArray) -> FloatArray:
        """The pose at the nearest allowed place; the one before where there is none."""
        if not self.is_kept:
            return wanted
        space = self.space()
        eyes, is_allowed = space.project_to_allowed(wanted[None, :3, 3])
        pose = wanted.copy() if is_allowed[0] else before
        pose[:3, 3] = eyes[0] if is_allowed[0] else before[:3, 3]
        away = float(np.linalg.norm(pose[:3, 3] - wanted[:3, 3]))
        if away > LEAST_MOVED_REL * self.scene.mesh.diagonal:
            why = place_words(space.judge(wanted[None, :3, 3]))[0]
            moved = f"moved {distance(away, self.state.unit)} to the nearest allowed place"
            done = moved if is_allowed[0] else "no allowed place nearby, camera not moved"
            self._moved = f"the plan does not allow this place ({why}): {done}"
        return pose

    def _summary(self) -> ByName:
        """Figures of the network, its cost, and what the plan asks for."""
        moments = [self._moment(self.at, name) for name in self.scene.goal_names]
        found = [moment.required(self.state, is_drag=self._is_drag) for moment in moments]
        required = [each for of_one in found for each in of_one]
        own = {"cost": self.scene.cost(self.state), "required": required}
        return self.figures().summary() | own

    def _values(
        self, figures: NetworkFigures, mode: str, options: ReadByName, station: int | None
    ) -> Any:
        """Values of a mode of `rastercov.report.modes`, for its function."""
        mesh, state = self.moment.mesh, figures.state
        if mode in figures.values:
            return figures.values[mode]()
        if mode == "area":
            rows = np.minimum(figures.need, state.most_views) - 1
            covered = self.areas().network.covered.area[rows, np.arange(mesh.n_faces)]
            return covered / np.maximum(np.asarray(mesh.areas), TINY)
        if mode_of(mode).of == "phases":
            return self._over_phases()[mode][self.moment.kept]
        if mode == "segments":
            angles = (_angle(options, each) for each in SEGMENT_OPTIONS)
            return self._segmented(*angles).labels[self.moment.kept]
        if station is None:
            if not state.stations:
                raise ConfigError("expected a camera, got none; add one")
            station = state.stations[0].id
        return self.measurements.rows(state, [state.station(station)])[0].coverage

    def _over_phases(self) -> Mapping[str, FloatArray]:
        """Values of modes over all phases, (F,), kept for the present state."""
        state, poses = self.state, self.state.poses()
        if self._in_phases is None or self._in_phases[0] is not state:
            rig = state.rig(poses)
            phases = self.scene.phases_with(rig)
            if phases is None:
                raise ConfigError("expected a scene of several phases, got one; open another")
            self._in_phases = state, phases.values(rig, poses, state.task)
        return self._in_phases[1]

    def _segmented(self, alpha: float, beta: float) -> Segmentation:
        """Segments, kept for the last angles."""
        if self._segments is None or self._segments[0] != (alpha, beta):
            self._segments = (alpha, beta), segment(self.scene.mesh, alpha, beta)
        return self._segments[1]


def framed(head: ReadByName, payload: bytes) -> bytes:
    """A frame: length of the JSON as uint32, little-endian, the JSON, and the payload."""
    text = json.dumps(head, allow_nan=False).encode()
    return struct.pack("<I", len(text)) + text + payload


def unframed(frame: bytes) -> tuple[ByName, bytes]:
    """JSON and payload of a frame."""
    (size,) = struct.unpack_from("<I", frame)
    return json.loads(frame[4 : 4 + size]), frame[4 + size :]


def _angle(given: ReadByName, known: ReadByName) -> float:
    """Value of an option of a mode, its default where it is not given."""
    return number(known["name"], given.get(known["name"], known["default"]))
