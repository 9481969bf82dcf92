"""Connections of the viewer's server, limited so that no other user of the machine can block it.

Every user of a machine can connect to a loopback address, and send nothing, or a byte a second. A
connection is authenticated once a request with the token came through it. Any other has
`ANONYMOUS_SECONDS` for a request and its answer, and where all places are taken, the oldest of
them is closed for the next connection. They are counted when they are accepted, so that a TLS
handshake which does not end is limited as any other silence.
"""

import asyncio
import logging
import socket
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Any

from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol

from rastercov.base.errors import ConfigError

LOG = logging.getLogger("rastercov")
MOST_CONNECTIONS = 128
"""A browser has six a host; the rest is for those whose first request is on its way."""
ANONYMOUS_SECONDS = 10.0
"""Time for a request without the token and its answer: the files of the page."""
REQUEST_SECONDS = 20.0
"""Time for the whole of a request with the token; its answer may take any time."""
ACCEPTED_AT_ONCE = 16
"""Connections accepted before others are read: an eighth of the places, so that a connection which
is accepted with its request is read before it is the oldest."""


@dataclass(eq=False)
class Connection:
    """One connection.

    Attributes
    ----------
    socket : socket
    since : float
        Time when it was accepted, or of the end of its last answer, s.
    is_authenticated : bool
        True once a request with the token came through it.
    protocol : Protocol or None
        None before the end of a TLS handshake.
    """

    socket: socket.socket
    since: float
    is_authenticated: bool = False
    protocol: "Protocol | None" = None

    @property
    def is_open(self) -> bool:
        """False once it has ended, by itself or by either side."""
        return self.socket.fileno() >= 0

    def is_late(self, now: float) -> bool:
        """True where its time is over."""
        if not self.is_authenticated:
            return now - self.since > ANONYMOUS_SECONDS
        is_answered = self.protocol is not None and self.protocol.is_answered()
        return now - self.since > REQUEST_SECONDS and not is_answered

    def close(self) -> None:
        """End it at once, whatever is on its way."""
        if self.protocol is not None:
            self.protocol.transport.abort()
        else:
            with suppress(OSError):  # it has ended by itself
                self.socket.shutdown(socket.SHUT_RDWR)


class Listener(socket.socket):
    """Listening socket with `MOST_CONNECTIONS` places; `connections` has the oldest first."""

    def __init__(self, family: socket.AddressFamily) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self.connections: dict[int, Connection] = {}  # by file descriptor

    def listen(self, backlog: int = 0) -> None:
        """Listen with the longest queue: a connection beyond it is tried again after a second."""
        super().listen(socket.SOMAXCONN)

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection, for which the oldest anonymous one is closed if need be."""
        made, address = super().accept()
        self.connection(made)
        return made, address

    def connection(self, of: socket.socket) -> Connection:
        """The connection of a socket."""
        number = of.fileno()
        known = self.connections.get(number)
        if known is not None and known.is_open:
            return known
        self.connections.pop(number, None)
        while len(self.connections) >= MOST_CONNECTIONS:
            anonymous = (k for k, each in self.connections.items() if not each.is_authenticated)
            oldest = self.connections.pop(next(anonymous, next(iter(self.connections))))
            if oldest.is_open:
                oldest.close()
        made = self.connections[number] = Connection(of, monotonic())
        return made

    async def close_late(self) -> None:
        """Close connections whose time is over; for once a second."""
        asyncio.get_running_loop().set_exception_handler(_noted)
        now = monotonic()
        self.connections = {k: each for k, each in self.connections.items() if each.is_open}
        for each in self.connections.values():
            if each.is_late(now):
                each.close()


def _noted(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Take a failure of one connection without a traceback on the terminal."""
    LOG.debug("viewer: %s", context.get("exception") or context.get("message"))


class Protocol(H11Protocol):
    """HTTP of one connection, which requests have in their state as `connection`."""

    listener: Listener

    # uvicorn's own narrows the argument in the same way.
    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Find what the listener knows of it."""
        super().connection_made(transport)
        self.connection = self.listener.connection(transport.get_extra_info("socket"))
        self.connection.protocol = self
        self.app_state = {"connection": self.connection}

    def on_response_complete(self) -> None:
        """The time of the next request begins."""
        self.connection.since = monotonic()
        super().on_response_complete()

    def is_answered(self) -> bool:
        """True while the answer to a whole request is computed or sent."""
        if self.transport.get_write_buffer_size():
            return True
        cycle = self.cycle
        return cycle is not None and not (cycle.response_complete or cycle.more_body)


def bound(host: str, port: int) -> Listener:
    """A listener at an address, at a free port where it is 0.

    Raises
    ------
    ConfigError
        For a port that is taken, or an address that this machine does not have.
    """
    made = Listener(socket.AF_INET6 if ":" in host else socket.AF_INET)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        raise ConfigError(
            f"{host}:{port} cannot be bound ({error.strerror or error}); take another --port, 0 "
            "for a free one"
        ) from None
    return made


def settings(application: Any, listener: Listener, certificate: str | None, key: str | None) -> Any:
    """Settings of a server, which prints nothing.

    Answers have their own errors; what uvicorn would log are tracebacks of pages that were closed
    in a request, and a line for each request that is no HTTP.
    """
    return Config(
        application,
        http=type("ProtocolOfListener", (Protocol,), {"listener": listener}),
        loop="asyncio", ws="none", lifespan="off", backlog=ACCEPTED_AT_ONCE,
        callback_notify=listener.close_late, timeout_notify=0, log_config=None,
        log_level="critical", access_log=False, server_header=False, proxy_headers=False,
        ssl_certfile=certificate, ssl_keyfile=key, timeout_graceful_shutdown=2,
    )  # fmt: skip
