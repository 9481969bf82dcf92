"""Work of a viewer that takes long: one at a time, in a thread, with progress and cancelling."""

from collections.abc import Callable
from threading import Event, Lock, Thread
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.format import area
from rastercov.base.interrupts import ABANDONED
from rastercov.viewer.improve import Cancelled, Progress, poses_of_camera, refined, tries, with_next
from rastercov.viewer.measurements import Measurements, exact_area
from rastercov.viewer.session import Session, StaleError


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Refine(_Asked):
    """Refinement of a station."""

    kind: Literal["refine"]
    station: int


class AddNext(_Asked):
    """The best next station."""

    kind: Literal["add"]
    camera: str


class ExactArea(_Asked):
    """Exact area of the network."""

    kind: Literal["area"]


_ASKED: TypeAdapter[Refine | AddNext | ExactArea] = TypeAdapter(
    Annotated[Refine | AddNext | ExactArea, Field(discriminator="kind")]
)


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
        self._said: dict[str, Any] = {"id": None}

    def start(self, entries: Any) -> int:
        """Begin work; its number.

        Raises
        ------
        BusyError
            While other work is running.
        ConfigError
            For work that does not exist.
        """
        try:
            asked = _ASKED.validate_python(entries)
        except ValidationError:
            raise ConfigError(
                'work must be {"kind": "refine", "station": ID}, {"kind": "add", "camera": NAME} '
                f'or {{"kind": "area"}}, got {shown(entries)}'
            ) from None
        with self._lock:
            if self._said.get("status") == "running":
                raise BusyError("other work is running; wait for its end, or cancel it")
            number = (self._said["id"] or 0) + 1
            self._said = {
                "id": number, "kind": asked.kind, "status": "running", "done": 0, "total": None,
                "words": "",
            }  # fmt: skip
            self._cancel.clear()
            self._thread = Thread(target=self._run, args=(asked,), daemon=True, name=ABANDONED)
            self._thread.start()
        return number

    def described(self) -> dict[str, Any]:
        """The work that is running or was last, ready for JSON; `id` is None before the first."""
        with self._lock:
            return dict(self._said)

    def cancel(self) -> None:
        """Ask the work to end; what it found is dropped."""
        self._cancel.set()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for its end."""
        if self._thread is not None:
            self._thread.join(seconds)

    def _progress(self, done: int, total: int) -> None:
        if self._cancel.is_set():
            raise Cancelled
        with self._lock:
            self._said |= {"done": int(done), "total": int(total)}

    def _run(self, asked: Refine | AddNext | ExactArea) -> None:
        try:
            hand_over = self._made(asked)
            with self._lock:  # who sees the new state finds the work done
                self._said |= {"status": "done", "words": hand_over()}
            return
        except Cancelled:
            said = {"status": "cancelled", "words": "cancelled; nothing was changed"}
        except StaleError:
            said = {"status": "failed", "words": "the rig was edited meanwhile; start it again"}
        except (RastercovError, MemoryError) as error:
            said = {"status": "failed", "words": str(error)}
        except Exception as error:  # the page must learn that it ended
            said = {"status": "failed", "words": f"a defect: {type(error).__name__}: {error}"}
        with self._lock:
            self._said |= said

    def _made(self, asked: Refine | AddNext | ExactArea) -> Callable[[], str]:
        """Do the work; what hands its result to the session and gives words on it."""
        session = self.session
        with session.lock:
            state, revision = session.state, session.history.revision
        if isinstance(asked, ExactArea):
            found = exact_area(session.scene.mesh, state, self._progress)
            percent = found.summary(state.needed)["percent"]

            def keep() -> str:
                session.keep_areas(state, found)
                return f"{percent:.4g} % of the area is covered"

            return keep
        own = Measurements(session.scene.mesh, session.measurements.method)
        try:
            make: Callable[[Progress], tuple[Any, float]]
            if isinstance(asked, Refine):
                name = state.station(asked.station).name
                space, words = session.space(), f"refine {name}"

                def make(progress: Progress) -> tuple[Any, float]:
                    return refined(own, state, asked.station, space, progress)
            else:
                words = "add the best next camera"

                def make(progress: Progress) -> tuple[Any, float]:
                    return self._with_next(own, state, asked.camera, progress)

            made, gain = make(self._progress)
        finally:
            own.close()

        def take() -> str:
            if made is state:
                return f"{words}: no move covers more"
            session.take(made, words, revision)
            return f"{words}: {area(gain)} more"

        return take

    def _with_next(
        self, own: Measurements, state: Any, camera: str, progress: Progress
    ) -> tuple[Any, float]:
        if camera not in state.cameras:
            known = ", ".join(state.cameras)
            raise ConfigError(f"there is no camera {shown(camera)}; cameras are {known}")
        scene = self.session.scene
        if scene.plan is not None and scene.pool is not None and len(scene.pool.candidates):
            mounts = scene.plan.mounts
            placed = mounts.cameras(scene.pool.candidates.placed)[0]
            if camera in mounts.rig.names:
                candidates = poses_of_camera(placed, mounts.rig.names.index(camera))
                if len(candidates):
                    return with_next(own, state, camera, candidates, progress)
        space = scene.space(state)
        return with_next(own, state, camera, tries(own, state, camera, space), progress)
