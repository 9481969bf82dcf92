"""Work of a viewer that takes long: one at a time, in a thread, with progress and cancelling.

One camera refined, or the best next one added: both try poses on cells of the surface, as
`rastercov place` does, and are judged by the exact area that all cameras cover together; by whole
faces where the result is. Cameras are placed by the plan, or one after another. All report progress
after every few poses, and end where `Progress` raises `Cancelled`.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from threading import Event, Lock, Thread
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.format import ByName, area, plural
from rastercov.base.interrupts import ABANDONED
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.core.area import polygons
from rastercov.core.area.cells import cells, usual_size
from rastercov.core.area.frames import to_world
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import is_joint
from rastercov.core.camera.viewpoints import SPREAD
from rastercov.core.coverage.network import least_cosine
from rastercov.core.coverage.observer import open_observer
from rastercov.page.actions import Action, checked
from rastercov.page.measurements import Measurements, NetworkFigures
from rastercov.page.rig_state import MOST_STATIONS, RigState
from rastercov.page.scene import Scene, distances
from rastercov.page.session import Moment, Session, StaleError
from rastercov.placement.improve.objective import CellObjective, Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import refine
from rastercov.placement.plan.prepare import Step
from rastercov.placement.plan.run import place
from rastercov.placement.plan.sections import BestSelection
from rastercov.shards import Progress, silent

BUDGET = 2_000
"""Poses that a refinement of one camera measures at most."""
TRIES = 600
"""Poses that are tried for the next camera where the plan has no candidates."""
MOST_EXACT = 16
"""Candidates whose exact area is computed: the best by cells."""


class Cancelled(Exception):  # noqa: N818 - no error: someone asked for it
    """The work was to end."""


@contextmanager
def _open(
    own: Measurements, state: RigState, count: int, progress: Progress
) -> Iterator[tuple[Objective, BoolArray, IntArray]]:
    """Objective of the cameras of a state; elements that its stations cover, and their views.

    Elements are cells by area and faces by face. The objective reports poses done of `count`.
    """
    (areas, because), rig, mesh = own.areas_or_why(state), state.rig(), own.mesh
    if areas is None and is_joint(rig):
        raise ConfigError(f"expected results by area for this rig, got by face: {because}")
    task, done = replace(state.task, views=state.most_views), 0
    views: Any = state.task.views if state.needed is None else state.needed

    def watch(more: int) -> None:
        nonlocal done
        done += more
        progress(min(done, count), count)

    with open_observer(mesh, rig, own.method) as observer, ExitStack() as opened:
        found = Objective.of(observer, task, views=views)
        if areas is not None:
            finder = RegionPass(mesh, rig, task, method=own.method)
            opened.callback(finder.close)
            on = cells(mesh, usual_size(mesh))
            found = CellObjective.of_cells(observer, finder, on, views=views)
        rest = state.poses()
        covers = found.covers(rest)
        covered = found.covered(covers, found.eyes(rest))
        yield replace(found, watch=watch), covered, covers.sum(axis=0)


def worth_of(own: Measurements, state: RigState) -> tuple[float, float]:
    """Area that enough cameras cover, and that summed over the views that are needed, m^2."""
    mesh, needed, (areas, _) = own.mesh, state.need(own.mesh), own.areas_or_why(state)
    task = mesh.task_mask
    if areas is None:
        found, sizes = _by_face(own, state), np.asarray(mesh.areas)
        views = np.minimum(found.views, needed)
        return float(sizes[found.covered & task].sum()), float((views * sizes)[task].sum())
    network = areas.network
    rows = np.arange(network.views)[:, None] < needed
    views_m2 = float((network.covered.area * rows)[:, task].sum())
    return float(areas.summary()["m2"]), views_m2


def refined(
    own: Measurements,
    state: RigState,
    station: int,
    space: PoseSpace,
    progress: Progress = silent,
    budget: int = BUDGET,
) -> tuple[RigState, float]:
    """A station moved by a compass search while all others stay; and the area it gained, m^2.

    Raises
    ------
    ConfigError
        For a station that is gone or off, and one at a forbidden place.
    Cancelled
        As `progress` does.
    """
    moving = state.station(station)
    if not moving.is_on:
        raise ConfigError(f"expected a camera that is on, got {moving.name}; switch it on")
    start = moving.pose.copy()
    eyes, is_allowed = space.project_to_allowed(start[None, :3, 3])
    if not is_allowed[0]:
        raise ConfigError(
            f"expected {moving.name} near an allowed place, got it farther away; move it closer"
        )
    start[:3, 3] = eyes[0]
    rest = state.with_station(replace(moving, is_on=False))
    progress(0, budget)
    with _open(own, rest, budget, progress) as (whole, covered, views):
        is_open = ~covered & (views >= whole.need - 1)
        lone: ByName = {"need": np.ones_like(whole.need), "min_cosine": least_cosine(0.0)}
        weights = np.where(is_open, whole.integer_weights, 0)
        objective = replace(whole, integer_weights=weights, **lone)
        row = rest.rig().names.index(moving.camera)
        found = refine(objective, space, Poses.of(start[None], camera=[row]), budget=budget)
    moved = state.with_pose(station, found.poses[0])
    before, after = (worth_of(own, each)[0] for each in (state, moved))
    return (moved, after - before) if after > before else (state, 0.0)


def with_next(
    own: Measurements,
    state: RigState,
    camera: str,
    candidates: FloatArray,
    progress: Progress = silent,
) -> tuple[RigState, float]:
    """With the candidate of a camera that covers most of what is not covered; and that area, m^2.

    Of a task of several views, each further view of a part that lacks some counts.

    Parameters
    ----------
    camera : str
        Name of the camera.
    candidates : (C, 4, 4) float64
        world_from_camera; of equals the first is taken.

    Raises
    ------
    ConfigError
        Where no candidate covers more.
    Cancelled
        As `progress` does.
    """
    progress(0, len(candidates))
    # With the camera among those of the rig, and without it among those that are on.
    rest = state.with_new(camera, np.eye(4))
    rest = rest.with_station(replace(rest.stations[-1], is_on=False))
    with _open(own, rest, len(candidates), progress) as (objective, _, views):
        worth = np.where(views < objective.need, objective.integer_weights, 0)
        row = rest.rig().names.index(camera)
        found = objective.estimated(Poses.of(candidates, camera=np.full(len(candidates), row)))
        sums = np.append(0, np.cumsum(worth[found.items]))
        gains = np.diff(sums[found.starts])
    most = MOST_EXACT if objective.is_estimated else 1
    order = np.argsort(-gains, kind="stable")[:most]
    made, best = state, before = state, worth_of(own, state)[1]
    for at in np.sort(order).tolist():
        tried = state.with_new(camera, candidates[at])
        if (area_m2 := worth_of(own, tried)[1]) > best:
            made, best = tried, area_m2
    if made is state:
        raise ConfigError(
            f"expected a pose that covers more, got none in {len(candidates)} tries; change "
            "lens or thresholds"
        )
    return made, best - before


def placed(
    own: Measurements, state: RigState, scene: Scene, asked: "Place", step: Step
) -> RigState:
    """Cameras in place of all stations.

    With a plan that has a selection these are the cameras of `rastercov place`, and thresholds and
    lenses are the plan's; else as many times the best next one, of one type.

    Parameters
    ----------
    asked : Place
    step : callable
        Context manager by the name of a step, which yields its progress.
    """
    plan, count = scene.plan, asked.cameras
    if plan is not None and scene.placement["is_by_plan"]:
        if count is not None and isinstance(plan.selection, BestSelection):
            other = plan.selection.model_copy(update={"cameras": count})
            plan = plan.model_copy(update={"selection": other})
        found = place(plan, None, step)
        return replace(scene.start, stations=RigState.of(plan.rig, found.cameras.placed).stations)
    made, camera = replace(state, stations=()), asked.camera or next(iter(state.cameras))
    count = count or 1
    for number in range(count):
        with step(f"camera {number + 1} of {count}") as progress:
            try:
                poses = tries(own, made, camera, scene.space(made), seed=number)
                made, _ = with_next(own, made, camera, poses, progress)
            except ConfigError:  # nothing is left to cover, or out of reach
                if not made.stations:
                    raise
                break
    return made


def tries(
    measurements: Measurements,
    state: RigState,
    camera: str,
    space: PoseSpace,
    count: int = TRIES,
    seed: int = 0,
) -> FloatArray:
    """Poses that look at what is not covered, (C, 4, 4), at allowed places.

    Parts are drawn by their area, and places in the directions around their normals, at distances
    from which the lens shows a fraction to all of the surface.

    Raises
    ------
    ConfigError
        Where all is covered, or no place is allowed.
    """
    mesh = measurements.mesh
    targets, faces, weight = _open_parts(measurements, state)
    if not weight.sum() > 0:
        raise ConfigError("expected uncovered area, got none; no further camera is needed")
    rng = np.random.default_rng(seed)
    drawn = rng.choice(len(faces), count, p=weight / weight.sum())
    targets, faces = targets[drawn], faces[drawn]
    normals = np.asarray(mesh.normals)[faces]
    flips = mesh.two_sided_mask[faces] & (rng.random(count) < 0.5)
    normals = np.where(flips[:, None], -normals, normals)
    slopes = rng.uniform(-SPREAD, SPREAD, (count, 3))
    directions = normals + slopes - (slopes * normals).sum(axis=1, keepdims=True) * normals
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    near, far = distances(mesh, state.cameras[camera])
    reach = np.exp(rng.uniform(np.log(near), np.log(far), count))
    eyes, is_allowed = space.project_to_allowed(targets + reach[:, None] * directions)
    is_allowed &= np.linalg.norm(eyes - targets, axis=1) > 1e-9
    if not is_allowed.any():
        raise ConfigError("expected an allowed place for a camera, got none; relax the constraints")
    rolls = rng.uniform(0, np.pi, int(is_allowed.sum())) * space.is_roll_free
    return space.composed(eyes[is_allowed], (targets - eyes)[is_allowed], rolls)


def _by_face(own: Measurements, state: RigState) -> NetworkFigures:
    return NetworkFigures(own.mesh, state, own.rows(state, state.on))


def _open_parts(own: Measurements, state: RigState) -> tuple[FloatArray, IntArray, FloatArray]:
    """Points in what is not covered, (N, 3), their faces, and areas: of pieces, or whole faces."""
    mesh, (areas, _) = own.mesh, own.areas_or_why(state)
    if areas is None:
        faces = np.flatnonzero(mesh.task_mask & ~_by_face(own, state).covered)
        return np.asarray(mesh.centroids)[faces], faces, np.asarray(mesh.areas)[faces]
    zones = areas.zones
    middle = polygons.centroids(zones.xy, zones.starts, zones.piece_area)
    faces = zones.face.astype(np.int64)
    return to_world(mesh, faces, middle), faces, zones.piece_area


class Refine(Action):
    """Refinement of a station."""

    kind: Literal["refine"]
    station: int


class AddNext(Action):
    """The best next station."""

    kind: Literal["add"]
    camera: str


class Place(Action):
    """Cameras in place of all that there are; see `placed`.

    `cameras` is their number, in place of that of a plan whose goal has one; `camera` is their
    type without a plan, the first unless given.
    """

    kind: Literal["place"]
    cameras: Annotated[int, Field(ge=1, le=MOST_STATIONS)] | None = None
    camera: str | None = None


Asked = Refine | AddNext | Place


class Job(Action):
    """Request of a page for work."""

    work: Annotated[Asked, Field(discriminator="kind")]


class BusyError(ConfigError):
    """Other work is running."""


class Work:
    """Work for a session, at most one at a time; any thread may call it.

    It measures with observers of its own, so that the session answers meanwhile, and hands its
    state over at the end, as one step of the history.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self._lock, self._cancel = Lock(), Event()
        self._thread: Thread | None = None
        self._said: ByName = {"id": None}

    def start(self, entries: object) -> int:
        """Begin work; its number.

        Raises
        ------
        BusyError
            While other work is running.
        ConfigError
            For work that does not exist.
        """
        asked = checked(Job, {"work": entries}).work
        with self._lock:
            if self._said.get("status") == "running":
                raise BusyError("expected an idle server, got running work; wait, or cancel it")
            number = (self._said["id"] or 0) + 1
            self._said = {
                "id": number,
                "kind": asked.kind,
                "status": "running",
                "done": 0,
                "total": None,
                "words": "",
            }
            self._began = self._step_began = time.monotonic()
            self._cancel.clear()
            self._thread = Thread(target=self._run, args=(asked,), daemon=True, name=ABANDONED)
            self._thread.start()
        return number

    def described(self) -> ByName:
        """The work that is running or was last, ready for JSON; `id` is None before the first.

        While it is running, `words` name its step, and there are the seconds that it and its step
        have taken.
        """
        with self._lock:
            now, said = time.monotonic(), dict(self._said)
            if said.get("status") == "running":
                said |= {"seconds": now - self._began, "step_seconds": now - self._step_began}
            return said

    def cancel(self) -> ByName:
        """Ask the work to end, so that what it found is dropped; `described` of it."""
        self._cancel.set()
        return self.described()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for its end."""
        if self._thread is not None:
            self._thread.join(seconds)

    def _progress(self, done: int, total: int) -> None:
        if self._cancel.is_set():
            raise Cancelled
        with self._lock:
            self._said |= {"done": int(done), "total": int(total)}

    @contextmanager
    def _step(self, words: str) -> Iterator[Progress]:
        """A step of the work with its own progress."""
        with self._lock:
            self._step_began = time.monotonic()
            self._said |= {"words": words, "done": 0, "total": None}
        if self._cancel.is_set():
            raise Cancelled
        yield self._progress

    def _run(self, asked: Asked) -> None:
        try:
            hand_over = self._made(asked)
            with self._lock:  # who sees the new state finds the work done
                self._said |= {"status": "done", "words": hand_over()}
            return
        except Cancelled:
            said = {"status": "cancelled", "words": "cancelled; nothing changed"}
        except StaleError:
            said = {
                "status": "failed",
                "words": "expected an unchanged rig, got edits meanwhile; start again",
            }
        except (RastercovError, MemoryError) as error:
            said = {"status": "failed", "words": str(error)}
        except Exception as error:  # the page must learn that it ended
            said = {
                "status": "failed",
                "words": f"{type(error).__name__}: {error} (a defect of rastercov)",
            }
        with self._lock:
            self._said |= said

    def _made(self, asked: Asked) -> Callable[[], str]:
        """Do the work; what hands its result to the session and gives words on it."""
        session = self.session
        with session.lock:
            revision, moment, before = session.history.revision, session.moment, session.state
            state = session.shown
        gain: float | None
        if moment.goal is not None and moment.goal.is_most and not isinstance(asked, Place):
            name = moment.goal.name
            raise ConfigError(
                f"expected a goal that requires coverage, got {name}, which limits it; click "
                "another goal, or the task"
            )
        own = Measurements(moment.mesh, moment.measurements.method, moment.measurements.by)
        try:
            if isinstance(asked, Refine):
                words = f"refine {state.station(asked.station).name}"
                with self._step(words) as progress:
                    made, gain = refined(own, state, asked.station, session.space(), progress)
            elif isinstance(asked, Place):
                made, gain = placed(own, state, session.scene, asked, self._step), None
                words = f"place {plural(len(made.stations), 'camera')}"
            else:
                words = "add the best next camera"
                candidates = self._candidates(own, state, asked.camera, moment)
                with self._step(words) as progress:
                    made, gain = with_next(own, state, asked.camera, candidates, progress)
        finally:
            own.close()

        def take() -> str:
            if made is state:
                return f"{words}: no better pose found"
            is_of_plan = isinstance(asked, Place) and session.scene.placement["is_by_plan"]
            rest = made if is_of_plan else moment.at_rest(made, state, before)
            session.take(rest, words, revision)
            if gain is None:
                return f"{words}: done"
            is_summed = isinstance(asked, AddNext) and state.most_views > 1
            more = "more covered, summed over views" if is_summed else "more covered"
            return f"{words}: {area(gain, state.unit)} {more}"

        return take

    def _candidates(
        self, own: Measurements, state: RigState, camera: str, moment: Moment
    ) -> FloatArray:
        """(C, 4, 4) poses that a further camera may have: those of the plan, if it has any."""
        state.camera(camera)
        scene = self.session.scene
        if scene.plan is not None and scene.pool is not None and len(scene.pool.candidates):
            mounts = scene.plan.mounts
            placed = mounts.cameras(scene.pool.candidates.placed)[0]
            names = np.array(mounts.rig.names)[placed.camera]
            if (names == camera).any():
                body = moment.poses.get(scene.carriers([camera]).get(camera, ""), np.eye(4))
                return body @ placed.world_from_camera[names == camera]
        return tries(own, state, camera, scene.space(state))
