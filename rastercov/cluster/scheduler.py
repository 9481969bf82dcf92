"""Processes of a Dask scheduler, on any machines, that make shards.

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
from contextlib import AbstractContextManager, contextmanager
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from rastercov.base import ConfigError, shown
from rastercov.base.errors import PoolLostError
from rastercov.shards.workers import Elsewhere

CONNECT_SECONDS = 20
"""Time for the first connection to a scheduler."""
ASK_SECONDS = 5
"""Time between two questions for the number of threads of a scheduler."""
LOGS = ("distributed", "distributed.client")
"""Channels that Dask sets a level of."""


class OfScheduler:
    """Processes of a scheduler, called as `Processes` are.

    Raises
    ------
    PoolLostError
        By each method, where the scheduler is lost.
    """

    def __init__(self, client: Any) -> None:
        self._client, self._threads, self._asked = client, 0, 0.0

    def submit(self, function: Callable[..., Any], *arguments: object) -> Any:
        """Outcome of a call."""
        return self._client.submit(function, *arguments, pure=False)

    def result(self, future: Any) -> Any:
        """Result of a call that is done."""
        try:
            if future.status != "lost":
                return future.result()
        except CancelledError:  # also where the result has not been sent
            pass
        raise PoolLostError

    def is_end(self, error: Exception) -> bool:
        """True for the error of a call whose process ended; its type need not be installed."""
        return type(error).__name__ == "KilledWorker"

    def n_threads(self) -> int:
        """Calls that are made at a time."""
        if self._client.status != "running":
            raise PoolLostError
        if not self._threads or time.monotonic() > self._asked + ASK_SECONDS:
            try:
                self._threads = sum(self._client.nthreads().values())
            except (OSError, TimeoutError):
                raise PoolLostError from None
            self._asked = time.monotonic()
        return self._threads


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
        raise ConfigError(
            f"expected a scheduler such as tcp://127.0.0.1:8786, got {shown(address)}; correct it"
        )
    if parts.scheme == "tcp" and not _is_loopback(host):
        raise ConfigError(
            f"{address}: expected tls:// or a loopback address, got tcp:// on a network, where "
            "anyone can run programs on the workers; use TLS or a tunnel (docs/scale.md)"
        )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, which may mean any machine
        return False


def _import_distributed() -> Any:
    """The package `distributed`; it has no types worth checking."""
    try:
        return import_module("distributed")
    except ModuleNotFoundError:
        raise ConfigError(
            "expected Dask for --scheduler, got no package; run: pip install 'rastercov[cluster]'"
        ) from None


@contextmanager
def pool_of(address: str) -> Iterator[OfScheduler]:
    """Processes of a scheduler; ConfigError where it cannot be reached, or has no certificates."""
    with _quiet_log(), _connect(address) as client:
        yield OfScheduler(client)


@contextmanager
def _connect(address: str) -> Iterator[Any]:
    distributed = _import_distributed()
    security = distributed.Security()
    if address.startswith("tls://") and not (
        security.tls_ca_file and security.tls_client_cert and security.tls_client_key
    ):
        raise ConfigError(
            f"{address}: expected TLS certificates, got none; set distributed.comm.tls.ca-file, "
            ".client.cert and .client.key in the configuration of Dask (docs/scale.md)"
        )
    try:
        client = distributed.Client(
            address, timeout=f"{CONNECT_SECONDS}s", set_as_default=False, security=security
        )
    except (OSError, TimeoutError) as error:
        why = " ".join(str(error).split()) or "no answer"
        raise ConfigError(
            f"{address}: expected a scheduler, got none ({why[:80]}); start one with `dask "
            "scheduler` and workers with `dask worker`"
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


class _Elsewhere(Elsewhere):
    def check(self, address: str) -> None:
        """Accept an address; ConfigError where Dask is not installed."""
        check_address(address)
        _import_distributed()

    def risk(self, address: str) -> str:
        """Line on the users of this machine, empty for TLS."""
        if not address.startswith("tcp:"):
            return ""
        return (
            f"{address}: every user of this machine can run programs as you through this "
            "scheduler; on a shared machine use --workers or tls:// (docs/scale.md)"
        )

    def pool(self, address: str) -> AbstractContextManager[OfScheduler]:
        """Processes of a scheduler."""
        return pool_of(address)


HOOKS = _Elsewhere()
"""Hooks of this feature."""
