"""Shards of a job made by workers: numbers in flight, retries, workers and schedulers that die."""

import errno
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.format import plural
from rastercov.cluster.address import risk
from rastercov.cluster.job import Job, Made, work
from rastercov.cluster.process import ProcessEndedError
from rastercov.cluster.quarantine import alone, forget, quarantined_of
from rastercov.cluster.workers import Workers

IN_FLIGHT = 4
"""Shards with the scheduler at a time, for each thread of the workers."""
FOLDER_PATIENCE = 300.0
"""Seconds without any shard made after which a lost folder ends the run."""
SCHEDULER_PATIENCE = 60.0
"""Seconds to wait for a lost scheduler to come back, and for a first worker."""
LOST = "lost"
"""Name for the worker of a shard that is in the folder, but whose cost was never heard of."""
FULL = (errno.ENOSPC, errno.EDQUOT)
Note = Callable[[str], None]


class _SchedulerLostError(Exception):
    """The scheduler does not answer any more."""


def make_shards(
    workers: Workers,
    job: Job,
    missing: Callable[[], Mapping[int, int]],
    done: Callable[[Made], None],
    note: Note,
) -> None:
    """Make all missing shards of a job.

    Parameters
    ----------
    workers : Workers
    job : Job
    missing : callable
        Gives the number of poses of each missing shard; asked again after a scheduler was lost.
    done : callable
        Called once with each shard that was made, in any order.
    note : callable
        Called with a line on what went wrong and was mended, and on an open scheduler.

    Raises
    ------
    ConfigError
        Where no scheduler answers or has workers, the folder stays lost or its disk is full, or a
        shard cannot be made. Shards that were made stay.
    """
    heard: set[int] = set()

    def heard_of(made: Made) -> None:
        if made.number not in heard:
            heard.add(made.number)
            done(made)

    asked: dict[int, int] = {}
    until = None
    if line := risk(workers.scheduler or ""):
        note(line)
    while True:
        shards = missing()
        for number in asked.keys() - shards.keys() - heard:  # made, but the scheduler was lost
            left_out = quarantined_of(Path(job.folder), number)
            heard_of(Made(number, asked[number], LOST, 0.0, 0.0, left_out))
        if not shards:
            return
        asked |= shards
        try:
            with workers.client() as client:
                _Run(client, job, shards, heard_of, note).make()
        except _SchedulerLostError:
            until = time.monotonic() + SCHEDULER_PATIENCE
            note(f"{workers.scheduler}: the scheduler is lost; waiting for it to come back")
        except ConfigError:
            if until is None or time.monotonic() > until:
                raise
            time.sleep(1)  # it is still lost


class _Run:
    """Shards of a job through one client."""

    def __init__(
        self,
        client: Any,
        job: Job,
        shards: Mapping[int, int],
        done: Callable[[Made], None],
        note: Note,
    ) -> None:
        self.client, self.job, self.shards = client, job, shards
        self.done, self.note = done, note
        self.finished: SimpleQueue[Any] = SimpleQueue()
        self.in_flight: dict[str, tuple[int, Any]] = {}
        self.attempts = 0
        self.room = IN_FLIGHT
        self.last_made = self.asked = time.monotonic()

    def make(self) -> None:
        """Make all shards: side by side, and those whose worker died alone in a process."""
        try:
            suspects = self._all_of(sorted(self.shards), self._usual)
            if suspects:
                self.note(
                    f"a worker died; {plural(len(suspects), 'shard')} to make once more, each in a "
                    "process of its own"
                )
                again = self._all_of(suspects, self._alone)
                if again:
                    raise ConfigError(
                        f"workers died while they watched shards {again}; shards that were made "
                        "stay: run again"
                    )
        finally:
            with suppress(Exception):  # a lost scheduler
                self.client.cancel([future for _, future in self.in_flight.values()])

    def _usual(self, number: int, key: str) -> Any:
        return self.client.submit(work, self.job, number, key=key, pure=False)

    def _alone(self, number: int, key: str) -> Any:
        return self.client.submit(alone, self.job, number, self.shards[number], key=key, pure=False)

    def _all_of(self, numbers: Iterable[int], submit: Callable[[int, str], Any]) -> list[int]:
        """Make these shards; gives those whose worker died."""
        waiting, suspects = deque(numbers), []
        while waiting or self.in_flight:
            self._watch_workers()
            while waiting and len(self.in_flight) < self.room:
                number = waiting.popleft()
                self.attempts += 1
                key = f"rastercov-{id(self):x}-{number}-{self.attempts}"
                future = submit(number, key)
                self.in_flight[key] = number, future
                future.add_done_callback(self.finished.put)
            try:
                future = self.finished.get(timeout=1)
            except Empty:
                continue
            number = self.in_flight.pop(future.key)[0]
            outcome = self._outcome(future)
            if outcome == "killed":
                suspects.append(number)
            elif outcome == "again":
                waiting.append(number)
        return suspects

    def _outcome(self, future: Any) -> str:
        """Result of a shard: "made", "killed" with its worker, or "again"."""
        if future.status == "finished":
            try:
                made = future.result()
            except CancelledError:  # the scheduler was lost before it sent the result
                raise _SchedulerLostError from None
            if not made.quarantined:
                forget(Path(self.job.folder), made.number)
            self.done(made)
            self.last_made = time.monotonic()
            return "made"
        if future.status != "error":  # cancelled, or lost
            raise _SchedulerLostError
        error = future.exception()
        # The second is of Dask, which need not be installed.
        if isinstance(error, ProcessEndedError) or type(error).__name__ == "KilledWorker":
            return "killed"
        if isinstance(error, RastercovError):
            raise error
        if not isinstance(error, OSError):
            raise RastercovError(f"a worker failed: {type(error).__name__}: {error}") from error
        if error.errno in FULL:
            raise ConfigError(
                f"{error.filename or self.job.folder}: the disk is full; shards that were made "
                "stay: free some space and run again"
            )
        if time.monotonic() - self.last_made > FOLDER_PATIENCE:
            raise ConfigError(
                f"{error}; the folder must be there for every worker under the same name"
            )
        self.note(f"{error}; trying again")
        time.sleep(1)
        return "again"

    def _watch_workers(self) -> None:
        """Count the threads of the workers from time to time; give up where there are none."""
        now = time.monotonic()
        if self.client.status != "running":
            raise _SchedulerLostError
        if now < self.asked:
            return
        try:
            threads = sum(self.client.nthreads().values())
        except (OSError, TimeoutError):
            raise _SchedulerLostError from None
        if threads:
            self.room, self.asked = IN_FLIGHT * threads, now + 5
        elif now - max(self.last_made, self.asked) > SCHEDULER_PATIENCE:
            raise ConfigError(
                f"{self.client.scheduler.address}: the scheduler has no workers; start some with "
                "`dask worker`"
            )
