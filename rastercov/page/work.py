"""Placement of cameras by a plan for a page: one at a time, in a thread, with progress."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from rastercov.base import ByName, ConfigError, RastercovError, ReadByName, plural
from rastercov.base.interrupts import ABANDONED
from rastercov.page.actions import Action, check_entries
from rastercov.page.rig_state import MOST_STATIONS, RigState
from rastercov.page.scene import describe_stations
from rastercov.page.session import Session
from rastercov.placement.plan.run import place
from rastercov.placement.plan.sections import BestSelection
from rastercov.shards import Progress

if TYPE_CHECKING:
    from rastercov.placement.plan.file import Plan


class Cancelled(Exception):  # noqa: N818 - no error: someone asked for it
    """The work was to end."""


class PageJob(Action):
    """Request of a page for cameras; `cameras` is their number, in place of that of the plan."""

    cameras: Annotated[int, Field(ge=1, le=MOST_STATIONS)] | None = None


class BusyError(ConfigError):
    """Other work is running."""


class Work:
    """Placement by the plan of a session, at most one at a time; any thread may call it."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self._lock, self._cancel = Lock(), Event()
        self._said: ByName = {"id": None}

    def start(self, entries: ReadByName) -> int:
        """Begin to place cameras; its number.

        Raises
        ------
        BusyError
            While other work is running.
        ConfigError
            Without a plan that says how.
        """
        asked, plan = check_entries(PageJob, entries), self.session.scene.plan
        if plan is None or not self.session.scene.placement["is_by_plan"]:
            raise ConfigError("expected a plan that places cameras, got none; open one")
        with self._lock:
            if self._said.get("status") == "running":
                raise BusyError("expected an idle server, got running work; wait, or cancel it")
            number = (self._said["id"] or 0) + 1
            self._said = {"id": number, "status": "running", "done": 0, "total": None, "words": ""}
            self._step_began = time.monotonic()
            self._cancel.clear()
            self._thread = Thread(target=self._run, args=(plan, asked), daemon=True, name=ABANDONED)
            self._thread.start()
        return number

    def describe(self) -> ByName:
        """The work that is running or was last, ready for JSON; `id` is None before the first.

        While it is running, `words` name its step, and there are the seconds that this has taken.
        """
        with self._lock:
            said = dict(self._said)
            if said.get("status") == "running":
                said["step_seconds"] = time.monotonic() - self._step_began
            return said

    def cancel(self) -> ByName:
        """Ask the work to end, so that what it found is dropped; `describe` of it."""
        self._cancel.set()
        return self.describe()

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

    def _run(self, plan: "Plan", asked: PageJob) -> None:
        try:
            if asked.cameras is not None and isinstance(plan.selection, BestSelection):
                other = plan.selection.model_copy(update={"cameras": asked.cameras})
                plan = plan.model_copy(update={"selection": other})
            placement = place(plan, None, self._step)
            made = RigState.of(plan.rig, placement.cameras.placed).stations
            words = f"place {plural(len(made), 'camera')}"
            said = {"status": "done", "words": words, "stations": describe_stations(made)}
        except Cancelled:
            said = {"status": "cancelled", "words": "cancelled; nothing changed"}
        except (RastercovError, MemoryError) as error:
            said = {"status": "failed", "words": str(error)}
        except Exception as error:  # the page must learn that it ended
            said = {
                "status": "failed",
                "words": f"{type(error).__name__}: {error} (a defect of rastercov)",
            }
        with self._lock:
            self._said |= said
