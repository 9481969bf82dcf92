"""Choice of the processes that make shards."""

import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from rastercov.base import ConfigError, service_of, shown
from rastercov.base.threads import DEVICE
from rastercov.base.typed import check_fields
from rastercov.shards.process import Processes

PART = re.compile("([0-9]{1,9})/([0-9]{1,9})")
MOST_WORKERS = 1024
"""Processes on one machine; more are a slip of the keyboard."""
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    # Memory stays with a worker from pose to pose: given back after each, 1.5 times the time.
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 30),
}
"""Environment of a worker, which must be set before it starts."""


class Pool(Protocol):
    """Processes that make shards; PoolLostError by each method where they are lost."""

    def submit(self, function: Callable[..., Any], *arguments: object) -> Any:
        """Outcome of a call."""

    def result(self, future: Any) -> Any:
        """Result of a call that is done."""

    def is_end(self, error: Exception) -> bool:
        """True for the error of a call whose process ended."""

    def n_threads(self) -> int:
        """Calls that are made at a time."""


class Elsewhere:
    """Hooks of processes on other machines, which an address names."""

    def check(self, address: str) -> None:
        """Accept an address; ConfigError for another one, and where a package is missing."""
        raise ConfigError(f"expected no scheduler in this installation, got {shown(address)}")

    def risk(self, address: str) -> str:
        """Line on who can reach the processes, "" where no other can."""
        return ""

    def pool(self, address: str) -> AbstractContextManager[Pool]:
        """Processes of an address; ConfigError where it cannot be reached."""
        raise NotImplementedError  # each feature has its own


def elsewhere() -> Elsewhere:
    """Hooks of the feature that has such processes."""
    return service_of("clusters", Elsewhere())


@dataclass(frozen=True)
class Workers:
    """Worker processes: a number of them on this machine, or those of a scheduler.

    Parameters
    ----------
    number : int, optional
        Processes on this machine, one thread each, which end with the run and accept no other
        connections.
    scheduler : str, optional
        Address of a Dask scheduler: tcp:// on this machine, or tls:// with the certificates that
        the configuration of Dask names (`distributed.comm.tls`).
    only : (int, int), optional
        I and N: this process makes the shards whose number is I modulo N, and raises
        `PartMadeError`. Others may make the rest in the same folder, also at the same time.

    Raises
    ------
    ConfigError
        Unless exactly one is given, for a number below 1, for an address that is open to others,
        and for an address where Dask is not installed.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.look_at([(0.6, 0, 0), (0, 0, 0.6)], (0, 0, 0))
    >>> own = rc.Workers(1)  # one process, which writes shards to the folder
    >>> result = rc.evaluate(mesh, camera, poses, shards=("shards", own))
    >>> round(result.covered.share(), 3)
    0.333
    """

    number: int | None = None
    scheduler: str | None = None
    only: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        given = [each for each in (self.number, self.scheduler, self.only) if each is not None]
        if len(given) != 1:
            raise ConfigError(
                f"expected workers, a scheduler or only, got {len(given)} of them; give one"
            )
        if self.only is not None and not 0 <= self.only[0] < self.only[1]:
            raise ConfigError(
                f"expected only to be I/N with I below N, got {'/'.join(map(str, self.only))}"
                "; correct it"
            )
        number = 1 if self.number is None else self.number
        if not 1 <= number <= MOST_WORKERS:
            raise ConfigError(
                f"expected workers to be from 1 to {MOST_WORKERS}, got {shown(number)}; correct it"
            )
        if self.scheduler is not None:
            elsewhere().check(self.scheduler)

    @classmethod
    def of(
        cls, number: int | None, scheduler: str | None, only: str | None = None
    ) -> "Workers | None":
        """Workers of the options --workers, --scheduler and --only; None if none is given."""
        if number is None and scheduler is None and only is None:
            return None
        part = None if only is None else PART.fullmatch(only)
        if only is not None and part is None:
            raise ConfigError(f"--only: expected I/N, got {shown(only)}; write 0/4")
        return cls(number, scheduler, part and (int(part[1]), int(part[2])))

    @property
    def _address(self) -> str:
        """Address of processes on other machines, "" for those of this one."""
        return self.scheduler or ""

    @property
    def _risk(self) -> str:
        """Line on who can reach the processes, "" where no other can."""
        return self._address and elsewhere().risk(self._address)

    @contextmanager
    def pool(self, device: str = "") -> Iterator[Pool]:
        """Processes; local ones start and end here, and open the device of that label if any.

        Raises
        ------
        ConfigError
            Where those on other machines cannot be reached.
        """
        if self.scheduler is not None:
            with elsewhere().pool(self.scheduler) as others:
                yield others
            return
        with Processes(self.number or 1, {**ENVIRONMENT, DEVICE: device}) as processes:
            yield processes
