"""Choice of the processes that make shards: those of this machine, or those of a Dask scheduler.

Whoever reaches an open scheduler can run any program on its workers, and whoever answers in its
place can run one in this process. So an address is of this machine, or of TLS with certificates on
both sides. On this machine its other users reach an open one, too: `risk` says so, and does not
refuse, because a machine or container with one user has no others.
"""

import ipaddress
import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.cluster.process import Processes

MOST_WORKERS = 1024
"""Processes on one machine; more are a slip of the keyboard."""
CONNECT_SECONDS = 20
"""Time for the first connection to a scheduler."""
ASK_SECONDS = 5
"""Time between two questions for the number of threads of a scheduler."""
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    # Memory stays with a worker from pose to pose: given back after each, 1.5 times the time.
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 30),
}
"""Environment of a worker, which must be set before it starts."""
LOGS = ("distributed", "distributed.client")
"""Channels that Dask sets a level of."""


class SchedulerLostError(Exception):
    """The scheduler does not answer any more."""


@dataclass(frozen=True)
class Workers:
    """Processes that make shards: a number of them on this machine, or those of a scheduler.

    Parameters
    ----------
    number : int, optional
        Worker processes of this machine, of one thread each, which end with the run and which only
        this process can reach.
    scheduler : str, optional
        Address of a Dask scheduler: tcp:// on this machine, or tls:// with the certificates that
        the configuration of Dask names (`distributed.comm.tls`).

    Raises
    ------
    ConfigError
        Where not exactly one is given, for a number below 1, for an address that is open to others,
        and for one where Dask is not installed.
    """

    number: int | None = None
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if (self.number is None) == (self.scheduler is None):
            raise ConfigError("give a number of workers, or the address of a scheduler, not both")
        number = 1 if self.number is None else self.number
        if type(number) is not int or not 1 <= number <= MOST_WORKERS:
            wanted = f"a whole number 1 to {MOST_WORKERS}"
            raise ConfigError(f"workers must be {wanted}, got {shown(number)}")
        if self.scheduler is not None:
            check_address(self.scheduler)
            _distributed()

    @classmethod
    def of(cls, number: int | None, scheduler: str | None) -> "Workers | None":
        """Choice by two options, None where neither is given."""
        return None if number is None and scheduler is None else cls(number, scheduler)

    @contextmanager
    def pool(self) -> "Iterator[Pool]":
        """Own workers, which start and end here, or those of the scheduler.

        Raises
        ------
        ConfigError
            Where the scheduler cannot be reached, or TLS has no certificates.
        """
        if self.number is not None:
            with Processes(self.number, ENVIRONMENT) as processes:
                yield processes
            return
        assert self.scheduler is not None
        with _quiet_log(), _connected(self.scheduler) as client:
            yield OfScheduler(client)


class OfScheduler:
    """Processes of a scheduler, called as `Processes` are.

    Raises
    ------
    SchedulerLostError
        By each method, where the scheduler is lost.
    """

    def __init__(self, client: Any) -> None:
        self._client, self._threads, self._asked = client, 0, 0.0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Outcome of a call."""
        return self._client.submit(function, *arguments, pure=False)

    def result(self, future: Any) -> Any:
        """Result of a call that is done."""
        try:
            if future.status != "lost":
                return future.result()
        except CancelledError:  # also where the result has not been sent
            pass
        raise SchedulerLostError

    def n_threads(self) -> int:
        """Calls that are made at a time."""
        if self._client.status != "running":
            raise SchedulerLostError
        if not self._threads or time.monotonic() > self._asked + ASK_SECONDS:
            try:
                self._threads = sum(self._client.nthreads().values())
            except (OSError, TimeoutError):
                raise SchedulerLostError from None
            self._asked = time.monotonic()
        return self._threads


Pool = Processes | OfScheduler


def check_address(address: str) -> None:
    """Accept the address of a scheduler.

    Raises
    ------
    ConfigError
        For an address of another form, and for one of another machine without TLS.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or port is None or parts.path or parts.scheme not in ("tcp", "tls"):
        wanted = "an address such as tcp://127.0.0.1:8786 or tls://host:8786"
        raise ConfigError(f"scheduler must be {wanted}, got {shown(address)}")
    if parts.scheme == "tcp" and not _is_loopback(host):
        raise ConfigError(
            f"{address}: refused, because anyone who reaches an open scheduler can run programs on "
            "its workers; use tls:// with certificates, or a tunnel to 127.0.0.1 (docs/scale.md)"
        )


def risk(address: str) -> str:
    """Line on the users of this machine, empty for TLS."""
    if not address.startswith("tcp:"):
        return ""
    return (
        f"{address}: every user of this machine can run programs as you through it; where there "
        "are others use --workers, or tls:// with certificates (docs/scale.md)"
    )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, which may mean any machine
        return False


def _distributed() -> Any:
    """The package `distributed`; it has no types worth checking."""
    try:
        return import_module("distributed")
    except ModuleNotFoundError:
        advice = "pip install 'rastercov[cluster]'"
        raise ConfigError(f"a scheduler needs the extra cluster: {advice}") from None


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    distributed = _distributed()
    security = distributed.Security()
    if address.startswith("tls://") and not (
        security.tls_ca_file and security.tls_client_cert and security.tls_client_key
    ):
        raise ConfigError(
            f"{address}: TLS needs certificates; name them in the configuration of Dask, "
            "distributed.comm.tls.ca-file and .client.cert, .client.key (docs/scale.md)"
        )
    try:
        client = distributed.Client(
            address, timeout=f"{CONNECT_SECONDS}s", set_as_default=False, security=security
        )
    except (OSError, TimeoutError) as error:
        why = " ".join(str(error).split()) or "no answer"
        raise ConfigError(
            f"{address}: no scheduler answers ({why}); start one with `dask scheduler`, and "
            "workers with `dask worker`"
        ) from None
    with client:
        yield client


@contextmanager
def _quiet_log() -> Iterator[None]:
    """Messages of Dask about workers that die are left to `run`, which says what follows."""
    loggers = [logging.getLogger(name) for name in LOGS]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
