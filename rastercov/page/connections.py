"""Connections of the viewer's server, limited so that no other user of the machine can block it.

Every user of a machine can connect to a loopback address, and send nothing, or a byte a second. A
connection is authenticated once a request with the token came through it. Any other has
`ANONYMOUS_SECONDS` for a request and its answer, and where all places are taken, the oldest of
them is closed for the next connection.
"""

import asyncio
import logging
import socket
from time import monotonic
from typing import Any, ClassVar

from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol

from rastercov.base import ByName, ConfigError

LOG = logging.getLogger("rastercov")
HOST = "127.0.0.1"
MOST_CONNECTIONS = 128
"""A browser has six a host; the rest is for those whose first request is on its way."""
ANONYMOUS_SECONDS = 10.0
"""Time for a request without the token and its answer: the files of the page."""
REQUEST_SECONDS = 20.0
"""Time for the whole of a request with the token; its answer may take any time."""
ACCEPTED_AT_ONCE = 16
"""Connections accepted before others are read: an eighth of the places, so that a connection which
is accepted with its request is read before it is the oldest."""


def _note_fault(loop: asyncio.AbstractEventLoop, context: ByName) -> None:
    """Take a failure of one connection without a traceback on the terminal."""
    LOG.debug("viewer: %s", context.get("exception") or context.get("message"))


class Protocol(H11Protocol):
    """HTTP of one connection, which requests have in their state as `connection`.

    Attributes
    ----------
    places : list of Protocol
        Open connections of the server, at most `MOST_CONNECTIONS`, the oldest first.
    since : float
        Time when it was accepted, or of the end of its last answer, s.
    is_authenticated : bool
        True once a request with the token came through it.
    """

    places: ClassVar[list["Protocol"]]

    # uvicorn's own narrows the argument in the same way.
    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a place, for which the oldest anonymous connection is closed if need be."""
        super().connection_made(transport)
        self.since, self.is_authenticated = monotonic(), False
        self.app_state = {"connection": self}
        while len(self.places) >= MOST_CONNECTIONS:
            anonymous = (each for each in self.places if not each.is_authenticated)
            oldest = next(anonymous, self.places[0])
            self.places.remove(oldest)
            oldest.transport.abort()
        self.places.append(self)

    def connection_lost(self, error: Exception | None) -> None:
        """Give the place back."""
        if self in self.places:
            self.places.remove(self)
        super().connection_lost(error)

    def on_response_complete(self) -> None:
        """The time of the next request begins."""
        self.since = monotonic()
        super().on_response_complete()

    def is_late(self, now: float) -> bool:
        """True where its time is over."""
        if not self.is_authenticated:
            return now - self.since > ANONYMOUS_SECONDS
        return now - self.since > REQUEST_SECONDS and not self.is_answered()

    def is_answered(self) -> bool:
        """True while the answer to a whole request is computed or sent."""
        if self.transport.get_write_buffer_size():
            return True
        cycle = self.cycle
        return cycle is not None and not (cycle.response_complete or cycle.more_body)

    @classmethod
    async def close_late(cls) -> None:
        """Close connections whose time is over; for once a second."""
        asyncio.get_running_loop().set_exception_handler(_note_fault)
        now = monotonic()
        for each in cls.places:
            if each.is_late(now):
                each.transport.abort()


class Listener(socket.socket):
    """Listening socket of this machine alone."""

    def listen(self, backlog: int = 0) -> None:
        """Listen with the longest queue: a connection beyond it is tried again after a second."""
        super().listen(socket.SOMAXCONN)


def bound(port: int) -> Listener:
    """A listener at a port of this machine, a free one for 0.

    Raises
    ------
    ConfigError
        For a port that is taken.
    """
    made = Listener(socket.AF_INET, socket.SOCK_STREAM)
    # On Windows SO_REUSEADDR would let any program take the port as well.
    own = getattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_REUSEADDR)
    made.setsockopt(socket.SOL_SOCKET, own, 1)
    try:
        made.bind((HOST, port))
    except OSError as error:
        made.close()
        raise ConfigError(
            f"{HOST}:{port}: expected a free port, got {error.strerror or error}; pass another "
            "--port, or 0"
        ) from None
    return made


def settings(application: Any) -> Any:
    """Settings of a server, which prints nothing.

    Answers have their own errors; what uvicorn would log are tracebacks of pages that were closed
    in a request, and a line for each request that is no HTTP.
    """
    own: Any = type("ProtocolOfServer", (Protocol,), {"places": []})
    return Config(
        application,
        http=own,
        loop="asyncio",
        ws="none",
        lifespan="off",
        backlog=ACCEPTED_AT_ONCE,
        callback_notify=own.close_late,
        timeout_notify=0,
        log_config=None,
        log_level="critical",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=2,
    )
