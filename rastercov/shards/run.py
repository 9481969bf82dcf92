"""All shards of a store: made here, or by workers with retries when they die or are lost."""

import errno
import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from queue import Empty, SimpleQueue
from typing import Any

from rastercov.base import ConfigError, RastercovError, ReadByName, one_line, plural, shown
from rastercov.base.errors import PartMadeError, PoolLostError
from rastercov.shards.store import Note, ShardStore
from rastercov.shards.work import Made, alone, work
from rastercov.shards.workers import Pool, Workers

IN_FLIGHT = 4
"""Shards with the workers at a time, for each of their threads."""
FOLDER_PATIENCE = 300.0
"""Seconds without any shard made after which a lost folder ends the run."""
PATIENCE = 60.0
"""Seconds to wait for lost workers to come back, and for a first one."""
LOST = "lost"
"""Name for the worker of a shard that is in the folder, but whose cost was never heard of."""
STAY = "run again (finished shards are kept)"
FULL = (errno.ENOSPC, errno.EDQUOT)
Progress = Callable[[int, int], None]
"""Called with what is done and what there is in all."""


def silent(done: int, total: int) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Staff:
    """Processes that measure, and the functions that they report to.

    Attributes
    ----------
    workers : Workers, optional
        Processes that measure; this one unless given.
    progress : callable
        Called with the poses done and the poses in all.
    watch : callable
        Called with each shard that a worker made.
    note : callable
        Called with a line on what went wrong and was mended; logs it as a warning unless given.
    answer : callable
        Called with the figures when they are known, before pictures and pages are made.
    """

    workers: Workers | None = None
    progress: Progress = silent
    watch: Callable[[Made], None] = lambda made: None
    note: Note = logging.getLogger("rastercov").warning
    answer: Callable[[ReadByName], object] = lambda summary: None

    @property
    def part(self) -> tuple[int, int] | None:
        """See `Workers.only`."""
        return self.workers.only if self.workers else None


ALONE = Staff()
"""This process, without reports."""


def fill(
    store: ShardStore,
    make: Callable[[int, Callable[[int], None]], bytes | memoryview],
    check: Callable[[int], object],
    staff: Staff,
) -> Iterator[int]:
    """Numbers of all shards in order, each once it is there; missing ones are made.

    Parameters
    ----------
    store : ShardStore
    make : callable
        Gives the content of a shard by its number, and calls its second argument with the poses
        that are done meanwhile.
    check : callable
        Reads a shard that is there, as for `ShardStore.mend`.
    staff : Staff
        Workers make the missing shards before the first number is given. After an interrupt the
        shards that are there are given before it is raised.

    Raises
    ------
    PartMadeError
        After the shards of workers with `only` are made.
    """
    start, step = staff.part or (0, 1)
    own = range(start, len(store), step)
    store.mend(staff.note, check, own)
    missing = {number: n for number, n in store.missing().items() if number in own}
    did = count_poses_of(store.n_poses, staff.progress, store.n_poses - sum(missing.values()))

    def take_shard(shard: Made) -> None:
        did(shard.n_poses)
        staff.watch(shard)

    if staff.workers is not None and missing and staff.part is None:
        try:
            make_shards(staff.workers, store, take_shard, staff.note)
        except KeyboardInterrupt:
            missing = store.missing()
            yield from (number for number in range(len(store)) if number not in missing)
            raise
        missing = {}
    for number in range(len(store)):
        if number in missing:
            data = make(number, did)
            store.note(number, {})
            store.write(number, data)
        if staff.part is None:
            yield number
    if staff.part is not None:
        raise PartMadeError(
            f"expected a part of a report, got {len(own)} of {plural(len(store), 'shard')}; when "
            "all parts are made, run the command without --only"
        )


def count_poses_of(n_poses: int, progress: Progress, done: int = 0) -> Callable[[int], None]:
    """Function of a number of poses, which tells `progress` how many are done of all so far."""

    def did(number: int) -> None:
        nonlocal done
        done += number
        progress(done, n_poses)

    did(0)
    return did


def make_shards(
    workers: Workers, store: ShardStore, done: Callable[[Made], None], note: Note
) -> None:
    """Have all missing shards of a store made by workers.

    Parameters
    ----------
    workers : Workers
    store : ShardStore
    done : callable
        Called once with each shard that was made, in any order.
    note : callable
        Called with a line on what went wrong and was mended, and on a risk.

    Raises
    ------
    ConfigError
        Where no workers answer, the folder stays lost or its disk is full, or a
        shard cannot be made. Shards that were made stay.
    """
    heard: set[int] = set()

    def heard_of(made: Made) -> None:
        if made.number not in heard:
            heard.add(made.number)
            done(made)

    store = replace(store, folder=store.folder.resolve())
    asked: dict[int, int] = {}
    until = None
    if workers._risk:
        note(workers._risk)
    while True:
        shards = store.missing()
        for number in asked.keys() - shards.keys() - heard:  # made, but the workers were lost
            heard_of(Made(number, asked[number], LOST, 0.0, 0.0, store.missing_rows(number)))
        if not shards:
            return
        asked |= shards
        try:
            with workers.pool(store.device) as pool:
                _Run(pool, store, heard_of, note, workers._address).make(sorted(shards))
        except PoolLostError:
            until = time.monotonic() + PATIENCE
            note(f"{workers._address}: lost the connection; reconnecting")
        except ConfigError:
            if until is None or time.monotonic() > until:
                raise
            time.sleep(1)  # it is still lost


@dataclass
class _Run:
    """Shards of a store through one pool of processes."""

    pool: Pool
    store: ShardStore
    done: Callable[[Made], None]
    note: Note
    address: str | None
    finished: SimpleQueue[Any] = field(default_factory=SimpleQueue)
    in_flight: dict[int, tuple[int, Any]] = field(default_factory=dict)
    room: int = IN_FLIGHT
    last_made: float = field(default_factory=time.monotonic)
    last_worker: float = field(default_factory=time.monotonic)

    def make(self, numbers: Iterable[int]) -> None:
        """Make these shards: side by side, and those whose worker died alone in a process."""
        try:
            suspects = self._all_of(numbers, work)
            if suspects:
                n_again = plural(len(suspects), "shard")
                self.note(
                    f"a worker process ended; retrying {n_again}, each in a process of its own"
                )
                if again := self._all_of(suspects, alone):
                    raise ConfigError(
                        f"expected results of shards {shown(again)}, got workers that ended; {STAY}"
                    )
        finally:
            with suppress(Exception):  # lost workers
                for _, future in self.in_flight.values():
                    future.cancel()

    def _all_of(self, numbers: Iterable[int], make: Callable[..., Made]) -> list[int]:
        """Make these shards; gives those whose worker died."""
        waiting, suspects = deque(numbers), []
        while waiting or self.in_flight:
            self._check_workers()
            while waiting and len(self.in_flight) < self.room:
                number = waiting.popleft()
                future = self.pool.submit(make, self.store, number)
                self.in_flight[id(future)] = number, future
                future.add_done_callback(self.finished.put)
            try:
                future = self.finished.get(timeout=1)
            except Empty:
                continue
            number, _ = self.in_flight.pop(id(future))
            try:
                made = self.pool.result(future)
            except PoolLostError:
                raise
            except OSError as error:
                self._wait_after(error)
                waiting.append(number)
            except RastercovError:
                raise
            except Exception as error:
                if not self.pool.is_end(error):
                    kind = type(error).__name__
                    raise RastercovError(
                        f"expected a result of a worker, got {kind}: {one_line(error)}; {STAY}"
                    ) from error
                suspects.append(number)
            else:
                if not made.quarantined:
                    self.store.note(number, {})
                self.done(made)
                self.last_made = time.monotonic()
        return suspects

    def _wait_after(self, error: OSError) -> None:
        """Wait for a folder that is lost; a full disk, and one that stays lost, end the run."""
        if error.errno in FULL:
            where = error.filename or self.store.folder
            raise ConfigError(
                f"{where}: expected free disk space, got a full disk; free some and {STAY}"
            )
        if time.monotonic() - self.last_made > FOLDER_PATIENCE:
            raise ConfigError(f"{error}; mount the folder under the same path on every worker")
        self.note(f"{error}; retrying")
        time.sleep(1)

    def _check_workers(self) -> None:
        """Count the threads of the workers; give up where there are none for long."""
        if threads := self.pool.n_threads():
            self.room, self.last_worker = IN_FLIGHT * threads, time.monotonic()
        elif time.monotonic() - self.last_worker > PATIENCE:
            raise ConfigError(f"{self.address}: expected workers, got none; start some")
