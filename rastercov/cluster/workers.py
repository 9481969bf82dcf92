"""Choice of the processes that make shards, and a client of their scheduler."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.cluster.address import check_address
from rastercov.cluster.process import Processes

MOST_WORKERS = 1024
"""Processes on one machine; more are a slip of the keyboard."""
CONNECT_SECONDS = 20
"""Time for the first connection to a scheduler."""
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
        if self.number is not None and not (
            isinstance(self.number, int)
            and not isinstance(self.number, bool)
            and 1 <= self.number <= MOST_WORKERS
        ):
            raise ConfigError(
                f"workers must be a whole number 1 to {MOST_WORKERS}, got {shown(self.number)}"
            )
        if self.scheduler is not None:
            check_address(self.scheduler)
            _distributed()

    @classmethod
    def of(cls, number: int | None, scheduler: str | None) -> "Workers | None":
        """Choice by two options, None where neither is given."""
        return None if number is None and scheduler is None else cls(number, scheduler)

    @contextmanager
    def client(self) -> Iterator[Any]:
        """Own workers, which start and end here, or a client (`distributed.Client`).

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
            yield client


def _distributed() -> Any:
    """The package `distributed`; it has no types worth checking."""
    try:
        return import_module("distributed")
    except ModuleNotFoundError:
        raise ConfigError(
            "a scheduler needs the extra cluster: pip install 'rastercov[cluster]'"
        ) from None


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
    before = {name: logging.getLogger(name).level for name in LOGS}
    for name in LOGS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)
