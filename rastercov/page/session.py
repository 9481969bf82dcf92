"""Session of a viewer: what a page asks of Python, without a server or a browser.

The page has the rig, its edits and their history, and sends all of it with each question. Methods
may be called from any thread, one at a time: `Session.lock` is theirs. Work that takes long, such
as a refinement, runs in `rastercov.page.server`.
"""

import base64
import json
import secrets
import struct
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from inspect import Parameter, signature
from io import BytesIO
from threading import Lock, RLock
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from PIL import Image
from pydantic import Field, create_model

from rastercov.base import (
    TINY,
    ByName,
    ConfigError,
    FloatArray,
    ReadByName,
    check_choice,
    first_of,
    norm,
    shown,
    sort_order,
)
from rastercov.base.arguments import number
from rastercov.base.format import distance
from rastercov.core.area import polygons
from rastercov.core.area.advice import task_in_words
from rastercov.core.area.polygons import to_world
from rastercov.core.camera import Camera, Rig
from rastercov.core.coverage.task import Task, check_equipment
from rastercov.core.mesh.groups import rows_of
from rastercov.core.mesh.unseeable import unseeable_in_view
from rastercov.page.actions import (
    Drawing,
    Matrix,
    Name,
    Number,
    Of,
    Point,
    Stored,
    TakenRig,
    check_entries,
)
from rastercov.page.measurements import (
    BYTES_A_FACE,
    LIVE_PAIRS,
    MOST_BYTES,
    ROUGH,
    Measurements,
    NetworkFigures,
    StationAreas,
    why,
)
from rastercov.page.rig_state import RigState, Station, check_pose
from rastercov.page.scene import OF_A_RIG, SEGMENT_OPTIONS, Scene, place_words
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.plan.network import (
    Requirement,
    classify_areas,
    classify_network,
    limits_of,
    views_by_group,
)
from rastercov.placement.select.problem import in_whole_numbers, weights_of
from rastercov.report.modes import OCCLUDER, OCCLUDER_OF_REASONS, mode_of
from rastercov.report.overview import by_faces, camera_keys, camera_pixels, camera_scene
from rastercov.report.pages import (
    describe_camera,
    describe_frame,
    soup_origin,
    zone_entries,
)

LEAST_SIDE, MOST_SIDE = 64, 2048
LEAST_MOVED_REL = 1e-6
"""Distance from which a place that the constraints change is said, in that of the mesh."""
MOST_MOMENTS = 64
"""Phases whose figures are kept."""
MOST_OPEN = 20_000
"""Pieces before which a page tries cameras."""
MOST_STATES = 8
"""Rigs of pages that are kept."""


class Moment:
    """The scene in one phase, for its task or a goal, see `Scene.place`, and what is measured."""

    def __init__(self, scene: Scene, at: tuple[float, ...], method: str, goal: str = "") -> None:
        self.scene, self.at, self.goal = scene, at, scene.goal(goal)
        self.mesh, self.kept, self.poses = scene.place(at, self.goal)
        self.measurements = Measurements(self.mesh, method, scene.by)
        self._shown: tuple[RigState, RigState] | None = None
        self._figures: NetworkFigures | None = None

    def show(self, state: RigState) -> RigState:
        """The state with cameras where bodies carry them, and the thresholds of the goal."""
        kept = self._shown  # which another thread may change
        if kept is None or kept[0] is not state:
            own = self.scene.carriers(state.cameras)
            bodies = {name: self.poses[body] for name, body in own.items()}
            placed = state.carry_bodies(bodies)
            if self.goal is not None:
                plan, rig = self.goal.plan, self.goal.rig_of(placed.whole)
                placed = replace(
                    placed,
                    whole=rig,
                    task=plan.build_task(),
                    needed=views_by_group(plan, None),
                )
            self._shown = kept = state, placed
        return kept[1]

    def figures(self, state: RigState, *, is_drag: bool = False) -> NetworkFigures:
        """Coverage by the cameras of a state; during a drag of many pairs by whole faces."""
        shown, kept = self.show(state), self._figures
        if kept is None or kept.state is not shown or kept.by_face_because == ROUGH:
            rows = self.measurements.rows(shown, shown.on)
            areas, because = None, ROUGH
            if not (is_drag and len(rows) * self.mesh.n_faces > LIVE_PAIRS):
                try:
                    areas, because = self.measurements.areas(shown), ""
                except ConfigError as error:
                    because = str(error)
            self._figures = kept = NetworkFigures(self.mesh, shown, rows, areas, because)
        return kept

    def requirements(self, state: RigState, *, is_drag: bool) -> list[ByName]:
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
            left = self.mesh.areas - unseeable_in_view(self.mesh, share) if is_seeable else None
            requirements: Sequence[Requirement] = classify_areas(
                network, limits, wanted, seeable=left
            )
        else:
            weights = in_whole_numbers(weights_of(self.mesh, plan.task.weight_by))
            requirements = classify_network(self.mesh, weights, limits, figures.covered)
        own = requirements if goal is None else [goal.requirement_of(each) for each in requirements]
        by_face, state = figures.areas is None, figures.state
        words = task_in_words(asdict(state.task), state.needed, by_face=by_face)
        name, asked = (goal.name, goal.asked) if goal else ("", words)
        return [
            {"goal": name, "status": each.status, "words": each.words(), "asked": asked}
            for each in own
        ]


class Stations(NamedTuple):
    """Rig of a page at a time, for its task or a goal, and what it covers.

    Attributes
    ----------
    session : Session
    state : RigState
        With cameras where they are at rest.
    moment : Moment
    is_drag : bool
        The page is in a gesture.
    """

    session: "Session"
    state: RigState
    moment: Moment
    is_drag: bool = False

    @property
    def shown(self) -> RigState:
        """The state with cameras where they are at that time."""
        return self.moment.show(self.state)

    def figures(self) -> NetworkFigures:
        """Coverage by the cameras."""
        return self.moment.figures(self.state, is_drag=self.is_drag)

    def areas(self) -> StationAreas:
        """Exact area that they cover; ConfigError where the result is by face."""
        figures = self.figures()
        if figures.areas is None:
            raise ConfigError(figures.by_face_because)
        return figures.areas

    def space(self) -> PoseSpace:
        """Allowed places of cameras."""
        return self.session.scene.space(self.shown)

    def answer(self, question: str, **asked: Any) -> Any:
        """Bytes or entries for JSON that answer a question of a page; see `QUESTIONS`."""
        return QUESTIONS[question](self, **asked)


QUESTIONS: dict[str, Callable[..., Any]] = {}
_FORMS: dict[str, type[Of]] = {}


def _question(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a function a question: its arguments after the first are those of the request."""

    def add_action(answer: Callable[..., Any]) -> Callable[..., Any]:
        hints = get_type_hints(answer, include_extras=True)
        default = {name: each.default for name, each in signature(answer).parameters.items()}
        own = {
            name: (hint, ... if default[name] is Parameter.empty else default[name])
            for name, hint in hints.items()
            if name not in ("asked", "return")
        }
        fields: Any = {"question": (str, ...), **own}
        QUESTIONS[name], _FORMS[name] = answer, create_model(name, __base__=Of, **fields)
        return answer

    return add_action


@_question("frame")
def _frame(
    asked: Stations,
    mode: str = "reason",
    options: dict[str, Number | int | bool | str] | None = None,
    station: int | None = None,
    is_drag: bool = False,
) -> bytes:
    """Frame of the faces: JSON with the summary, then levels."""
    check_choice("mode", mode, OF_A_RIG)
    asked = asked._replace(is_drag=is_drag)
    moment, mesh, figures = asked.moment, asked.session.scene.mesh, asked.figures()
    painted = mode_of(mode).paint(
        moment.mesh, _values(asked, figures, mode, options or {}, station)
    )
    of_others = OCCLUDER_OF_REASONS if mode == "reason" else OCCLUDER
    away = 0 if moment.scene.phases else of_others  # of a body, or of targets of other goals
    levels = np.full(mesh.n_faces, away, np.uint8)
    levels[moment.kept] = painted.levels
    head = describe_frame(mode, painted) | {"summary": _summary(asked, figures)}
    if len(moment.at) > 1:
        poses = np.stack(list(moment.poses.values()))[:, :3]
        head["bodies"] = base64.b64encode(np.ascontiguousarray(poses).data).decode()
    return add_head(head, levels.tobytes())


@_question("phase")
def _phase(asked: Stations) -> ByName:
    """Numbers that name the phase, and the pose of the body of each camera that is on one."""
    moment = asked.moment
    own = moment.scene.carriers(asked.state.cameras)
    bodies = {name: moment.poses[body].ravel().tolist() for name, body in own.items()}
    return {"at": moment.at, "bodies": bodies}


@_question("places")
def _places(asked: Stations) -> ByName:
    """Constraint of the plan that each station violates, and the cost of those that are on."""
    scene = asked.session.scene
    return {"places": scene.places(asked.state), "cost": scene.cost(asked.state)}


@_question("settled")
def _settle_pose(asked: Stations, pose: Matrix, before: Matrix) -> ByName:
    """The pose at the nearest allowed place, or the one before; words where it is another."""
    wanted, kept = (check_pose(np.reshape(each, (4, 4))) for each in (pose, before))
    space, scene = asked.space(), asked.session.scene
    eyes, is_allowed = space.project_to_allowed(wanted[None, :3, 3])
    made = wanted.copy() if is_allowed[0] else kept.copy()
    made[:3, 3] = eyes[0] if is_allowed[0] else kept[:3, 3]
    away, notice = float(norm(made[:3, 3] - wanted[:3, 3])), ""
    if away > LEAST_MOVED_REL * scene.mesh.diagonal:
        why = place_words(space.judge(wanted[None, :3, 3]))[0]
        moved = f"moved {distance(away, asked.state.unit)} to the nearest allowed place"
        done = moved if is_allowed[0] else "no allowed place nearby, camera not moved"
        notice = f"the plan does not allow this place ({why}): {done}"
    return {"pose": made.ravel().tolist(), "notice": notice}


@_question("allowed")
def project_to_allowed(asked: Stations, eyes: list[Point]) -> ByName:
    """The nearest allowed place of each of some places, where there is one."""
    project, is_allowed = asked.space().project_to_allowed(np.reshape(np.array(eyes), (-1, 3)))
    return {"eyes": project.tolist(), "is_allowed": is_allowed.tolist()}


@_question("worth")
def _worth(asked: Stations) -> ByName:
    """Area that is covered, summed over the views that are needed, m^2."""
    mesh, figures = asked.moment.mesh, asked.figures()
    if figures.areas is None:
        views = np.minimum(figures.views, figures.need)
        return {"m2": float((views * mesh.areas)[mesh.task_mask].sum())}
    rows = np.arange(figures.areas.network.views)[:, None] < figures.need
    m2 = figures.areas.network.covered.area * rows
    return {"m2": float(m2[:, mesh.task_mask].sum())}


@_question("by_camera")
def _by_camera(asked: Stations) -> list[ByName]:
    """Share of each station, and what is lost without it."""
    figures: list[ByName] = asked.figures().summary()["by_camera"]
    return figures


@_question("open")
def _open(asked: Stations) -> list[ByName]:
    """Middle, normal and area of each piece that is not covered, or whole face, the largest first.

    Those of faces with two sides are there with either.
    """
    mesh, figures = asked.moment.mesh, asked.figures()
    if figures.areas is None:
        faces = np.flatnonzero(mesh.task_mask & ~figures.covered)
        middles, sizes = np.asarray(mesh.centroids)[faces], np.asarray(mesh.areas)[faces]
    else:
        zones = figures.areas.zones
        faces, sizes = zones.face.astype(np.int64), zones.piece_area
        middles = to_world(mesh, faces, polygons.centroids(zones.xy, zones.starts, sizes))
    order = sort_order(-sizes)[:MOST_OPEN]
    return [
        {"middle": middle, "normal": [sign * x for x in normal], "area": size}
        for middle, normal, size, sides in zip(
            middles[order].tolist(),
            np.asarray(mesh.normals)[faces[order]].tolist(),
            sizes[order].tolist(),
            mesh.two_sided_mask[faces[order]].tolist(),
            strict=True,
        )
        for sign in ((1, -1) if sides else (1,))
    ]


@_question("camera")
def _camera(asked: Stations, name: Name = "", plain: ByName | None = None) -> ByName:
    """Description of a camera of the catalogue by its name, or of one with values of its own."""
    sold = {"preset": name, "catalogue": asked.state.catalogue}
    return describe_camera(Camera.from_dict(sold if plain is None else plain))


@_question("pieces")
def _pieces(asked: Stations) -> bytes:
    """Frame of the convex pieces that too few cameras cover, or of the reason why there are none.

    Number of pieces, face of each, row of its reason in `REASONS`, and its corners, uint32;
    then the corners, float32 from the origin of the page.
    """
    moment = asked.moment
    try:
        zones = asked.areas().zones
    except ConfigError as error:  # no fault of the page, which asks at every rest
        return add_head({"fault": str(error)}, b"")
    counts, origin = np.diff(zones.starts), soup_origin(asked.session.scene.mesh)
    corners = to_world(moment.mesh, np.repeat(zones.face, counts), zones.xy) - origin
    of_pieces = moment.kept[zones.face], zones.leads, counts
    numbers = np.concatenate(([len(counts)], *of_pieces)).astype("<u4")
    return add_head({}, numbers.tobytes() + corners.astype("<f4").tobytes())


@_question("image")
def _image(
    asked: Stations,
    station: int,
    side: Annotated[int, Field(ge=LEAST_SIDE, le=MOST_SIDE)] = 720,
) -> bytes:
    """Frame of a camera's own image, its distortion included: title, size, legend, then a PNG.

    `side` is its longest side, px, at most that of the camera.
    """
    mesh, state = asked.moment.mesh, asked.shown
    own = state.station(station)
    (row,) = asked.moment.measurements.rows(state, [own])
    camera = state.camera_of(own)
    small = camera.resized(min(1.0, side / max(camera.width, camera.height)))
    result = by_faces(camera_scene(mesh, small, own.pose), row.failed)
    image, buffer = Image.fromarray(camera_pixels(result)), BytesIO()
    legend = [
        {
            "label": key.name,
            "colour": first,
            "stripe": next(iter(others), None),
            "hatch": key.hatch,
        }
        for key in camera_keys(result)
        for first, *others in (key.colours,)
    ]
    image.save(buffer, "PNG", compress_level=1)
    head = {"width": image.width, "height": image.height, "title": own.name, "legend": legend}
    return add_head(head, buffer.getvalue())


@_question("why")
def _why(asked: Stations, face: Annotated[int, Field(ge=0)]) -> ByName:
    """Reason of a face."""
    kept = asked.moment.kept
    row = int(np.searchsorted(kept, face))
    if face < asked.session.scene.mesh.n_faces and (row == len(kept) or kept[row] != face):
        raise ConfigError("expected a face of this frame, got one of an absent body; pick another")
    return why(asked.moment.measurements, asked.figures(), row if row < len(kept) else face)


@_question("zones")
def _zones(asked: Stations) -> list[ByName]:
    """Dead zones by exact area, the largest first."""
    areas, moment = asked.areas(), asked.moment
    result = zone_entries(moment.mesh, areas.zones, areas.dead_zones())
    return [each | {"faces": moment.kept[each["faces"]].tolist()} for each in result]


class Session:
    """Answers to the questions of pages on a scene, and what they store.

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
        check_equipment(scene.start.whole, scene.start.task)
        self.method, self._moments = method, OrderedDict[tuple[Any, ...], Moment]()
        self._states: OrderedDict[str, RigState] = OrderedDict()
        self._whole = "", scene.start.whole
        self.drawing: Drawing | None = None  # under the floor plan
        self._in_phases: tuple[RigState, Mapping[str, FloatArray]] | None = None
        self._segments: tuple[tuple[float, float], Segmentation] | None = None
        self._last = self.of().moment
        self._storing, self._stored = Lock(), Stored(revision=0, keep=0, steps=[], rest={})

    @property
    def progress(self) -> list[int]:
        """Poses measured of those that an answer needs now, and their number."""
        return self._last.measurements.progress

    def of(
        self, state: RigState | None = None, at: Sequence[float] = (), goal: str = ""
    ) -> Stations:
        """A rig, that of the scene unless given, in a phase, for a goal."""
        with self.lock:
            state = self.scene.start if state is None else state
            return Stations(self, state, self._moment(tuple(at), goal, len(state.stations)))

    def ask(self, entries: ReadByName) -> Any:
        """Answer a question of a page: bytes, or entries for JSON.

        Raises
        ------
        RastercovError
            For what is no question, and for a rig that cannot be.
        """
        name = str(entries.get("question"))
        check_choice("question", name, tuple(QUESTIONS))
        request = check_entries(_FORMS[name], entries)
        given = {name: getattr(request, name) for name in _FORMS[name].model_fields}
        with self.lock:
            asked = self.take(given.pop("rig"), given.pop("at"), given.pop("goal"))
            return asked.answer(given.pop("question"), **given)

    def take(self, rig: TakenRig | None, at: Sequence[float], goal: str) -> Stations:
        """`of` the rig of a page."""
        return self.of(None if rig is None else self._state(rig), at, goal)

    def _state(self, rig: TakenRig) -> RigState:
        """State of the rig of a page; of equal ones it is the same object."""
        key = rig.model_dump_json()
        if key not in self._states:
            self._states[key] = self._read(rig)
        self._states.move_to_end(key)
        while len(self._states) > MOST_STATES:
            self._states.popitem(last=False)
        return self._states[key]

    def _read(self, rig: TakenRig) -> RigState:
        start = self.scene.start
        if len({each.id for each in rig.stations}) != len(rig.stations):
            raise ConfigError("expected distinct station ids, got duplicates; correct them")
        key = rig.model_dump_json(include={"cameras", "devices"})
        if self._whole[0] != key:
            self._whole = key, _whole_of(start.whole, rig)
        made = replace(
            start,
            stations=tuple(
                Station(e.id, e.name, e.camera, check_pose(np.reshape(e.pose, (4, 4))), e.is_on)
                for e in rig.stations
            ),
            whole=self._whole[1],
            task=_task_of(start.task, rig.task),
            needed=rig.needed,
        )
        for each in made.stations:
            made.camera(each.camera)
        return made

    def _moment(self, at: tuple[float, ...], goal: str, n_stations: int) -> Moment:
        """The scene at a time for a goal; the last `MOST_MOMENTS` stay measured."""
        at = (at or (0.0,)) if self.scene.phases else ()
        if (at, goal) not in self._moments:
            self._moments[at, goal] = Moment(self.scene, at, self.method, goal)
        moment = self._moments[at, goal]
        self._moments.move_to_end((at, goal))
        size = BYTES_A_FACE * self.scene.mesh.n_faces * max(1, n_stations)
        kept = max(1 + len(self.scene.goals), min(MOST_MOMENTS, MOST_BYTES // size))
        while len(self._moments) > kept:
            self._moments.popitem(last=False)[1].measurements.close()
        before, self._last = getattr(self, "_last", moment), moment
        if before.at != at:
            before.measurements.close()  # its rows stay
        return moment

    def close(self, seconds: float = -1) -> None:
        """Give back what measures, unless an answer takes more than `seconds`; -1 waits for it."""
        if self.lock.acquire(timeout=seconds):
            try:
                for each in self._moments.values():
                    each.measurements.close()
            finally:
                self.lock.release()

    def load(self) -> ByName:
        """Steps and the rest that pages have stored, ready for JSON, and the number of changes."""
        own = self._stored
        return {"session": self.name, "revision": own.revision, "steps": own.steps} | {
            "rest": own.rest
        }

    def store(self, entries: ReadByName) -> ByName:
        """Take changes of what is stored, see `Stored`; StaleError where another page was first."""
        given = check_entries(Stored, entries)
        with self._storing:
            known = self._stored
            if given.revision != known.revision:
                raise StaleError(
                    f"expected revision {known.revision} of the rig, got {given.revision}; reload "
                    "the page"
                )
            steps = [*known.steps[: given.keep], *given.steps]
            own = {"revision": known.revision + 1, "steps": steps}
            self._stored = given.model_copy(update=own)
            return {"revision": self._stored.revision}

    def describe_drawing(self) -> ByName:
        """The drawing under the floor plan, ready for JSON; empty where there is none."""
        return {} if self.drawing is None else self.drawing.model_dump()

    def draw(self, changes: ReadByName) -> None:
        """Take other entries of the drawing, or no drawing without any."""
        with self.lock:
            known = self.describe_drawing()
            self.drawing = check_entries(Drawing, {**known, **changes}) if changes else None

    def over_phases(self, state: RigState) -> Mapping[str, FloatArray]:
        """Values of modes over all phases, (F,), kept for the last state."""
        poses = state.poses()
        if self._in_phases is None or self._in_phases[0] is not state:
            rig = state.rig(poses)
            phases = self.scene.phases_with(rig)
            if phases is None:
                raise ConfigError("expected a scene of several phases, got one; open another")
            self._in_phases = state, phases.values(rig, poses, state.task)
        return self._in_phases[1]

    def segment(self, alpha: float, beta: float) -> Segmentation:
        """Segments, kept for the last angles."""
        if self._segments is None or self._segments[0] != (alpha, beta):
            self._segments = (alpha, beta), segment(self.scene.mesh, alpha, beta)
        return self._segments[1]


class StaleError(ConfigError):
    """A change of what another page has changed."""


def _task_of(task: Task, thresholds: ReadByName) -> Task:
    """The task with other thresholds; ConfigError for an unknown one."""
    known = asdict(task)
    if unknown := [name for name in thresholds if name not in known]:
        raise ConfigError(
            f"expected one of {first_of(list(known))}, got {shown(unknown[0])}; correct it"
        )
    return Task(**(known | dict(thresholds)))


def _whole_of(whole: Rig, rig: TakenRig) -> Rig:
    """Cameras, thresholds and equipment of the rig of a page, with the rules of the scene."""
    for name, camera in rig.cameras.items():
        made = Camera.from_dict(camera.plain)
        if name not in whole.names or whole.cameras[whole.names.index(name)] != made:
            whole = whole._with_camera(name, made)
    own = {name: each.task for name, each in rig.cameras.items()}
    tasks = {name: _task_of(Task(), each) for name, each in own.items() if each}
    whole = whole._with(tasks=tasks)
    places = {each.id: each.pose for each in rig.devices if each.pose}
    for word, each in whole.equipment.items():
        for row in range(len(each.names)):
            place = places.pop(f"{word} {row}", None)
            if place is not None and not each.rides[row]:
                each = each.at(row, check_pose(np.reshape(place, (4, 4))))
        whole = whole._equip(word, each)
    for name in places:
        raise ConfigError(f"expected equipment of the scene, got {shown(name)}; choose another")
    return whole


def _summary(asked: Stations, figures: NetworkFigures) -> ByName:
    """Figures of the network, its cost, and what the plan asks for."""
    session, at, state = asked.session, asked.moment.at, asked.state
    moments = [session.of(state, at, name).moment for name in session.scene.goal_names]
    items = [moment.requirements(state, is_drag=asked.is_drag) for moment in moments]
    required = [each for of_one in items for each in of_one]
    own = {"cost": session.scene.cost(state), "required": required}
    return figures.summary() | own


def _values(
    asked: Stations, figures: NetworkFigures, mode: str, options: ReadByName, station: int | None
) -> Any:
    """Values of a mode of `rastercov.report.modes`, for its function."""
    moment, state = asked.moment, figures.state
    mesh = moment.mesh
    if mode in figures.values:
        return figures.values[mode]()
    if mode == "area":
        rows = np.minimum(figures.need, state.most_views) - 1
        covered = asked.areas().network.covered.area[rows, np.arange(mesh.n_faces)]
        return covered / np.maximum(np.asarray(mesh.areas), TINY)
    if mode_of(mode).of == "phases":
        return asked.session.over_phases(asked.state)[mode][moment.kept]
    if mode == "segments":
        angles = (_angle(options, each) for each in SEGMENT_OPTIONS)
        return asked.session.segment(*angles).labels[moment.kept]
    if station is None:
        if not state.stations:
            raise ConfigError("expected a camera, got none; add one")
        station = state.stations[0].id
    return moment.measurements.rows(state, [state.station(station)])[0].coverage


def add_head(head: ReadByName, payload: bytes) -> bytes:
    """A frame: length of the JSON as uint32, little-endian, the JSON, and the payload."""
    text = json.dumps(head, allow_nan=False).encode()
    return struct.pack("<I", len(text)) + text + payload


def remove_head(frame: bytes) -> tuple[ByName, bytes]:
    """JSON and payload of a frame."""
    (size,) = struct.unpack_from("<I", frame)
    return json.loads(frame[4 : 4 + size]), frame[4 + size :]


def _angle(given: ReadByName, known: ReadByName) -> float:
    """Value of an option of a mode, its default where it is not given."""
    return number(known["name"], given.get(known["name"], known["default"]))
