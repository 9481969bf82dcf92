"""Server of a viewer: pages and answers for one user on this machine.

It binds to 127.0.0.1, and every answer with data wants the token that the page got in its address,
behind "#", where no other page and no log sees it. Requests of another host or origin are refused,
so that a page elsewhere cannot reach it by a name of its own (DNS rebinding).

A browser gets what it opens as an argument, which every user of the machine can read. So it gets
the name of a file that only this user can read, in a new folder that only this user can enter.

Placement of cameras by a plan for a page: one at a time, in a thread, with progress.
"""

import asyncio
import hmac
import html
import json
import logging
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from rastercov.base import (
    ByName,
    ConfigError,
    RastercovError,
    ReadByName,
    ResourceError,
    one_line,
    plural,
    shown,
)
from rastercov.base.interrupts import ABANDONED
from rastercov.page.actions import MOST_OF_DRAWING, Action, check_entries
from rastercov.page.live import open_live
from rastercov.page.rig_state import MOST_STATIONS, RigState
from rastercov.page.saving import Saving
from rastercov.page.scene import describe_stations
from rastercov.page.session import Session, StaleError
from rastercov.placement.plan.run import place
from rastercov.placement.plan.sections import BestSelection
from rastercov.report.pages import TYPES, digest_of, page_text, static_file
from rastercov.shards import Progress

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

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


LOG = logging.getLogger("rastercov")
Body = ByName
Answer = Callable[[Body], Any]
"""Answer to a body; see `_response`."""
MOST_BYTES = 2 * MOST_OF_DRAWING
"""Longest request: a drawing; a rig has some hundred bytes a camera."""
LONGEST_ERROR = 300
"""Characters of an error, of which a request may have chosen most."""
SECONDS_TO_CLOSE = 1.0
"""Time that an answer has to end when the program does."""
INSTALL = "expected starlette and uvicorn, got no package; run: pip install 'rastercov[view]'"
IMPORT_MAP = '{"imports": {"rastercov/": "/static/"}}'
"""Folder of the modules, which import each other by bare names."""
POLICY = (
    f"default-src 'none'; script-src 'self' 'wasm-unsafe-eval' {digest_of(IMPORT_MAP)}; "
    "worker-src blob:; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Content security policy of the page: its own files, and the import map by its hash."""
PAGE = """<!DOCTYPE html>
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0;url={url}">
<title>rastercov</title>
<a href="{url}">Open the viewer</a>
"""


def application(
    session: Session,
    token: str,
    port: int,
    out: Path | None = None,
    arrived: Callable[[], None] = lambda: None,
) -> "Starlette":
    """ASGI application of a session that is reached at a port by a page that has the token.

    `out` is the folder for what the page saves; `arrived` is called at the first request with the
    token.

    Raises
    ------
    ResourceError
        Where starlette is not installed.
    """
    try:
        from starlette.applications import Starlette
        from starlette.routing import Route
    except ImportError:
        raise ResourceError(INSTALL) from None
    threads = ThreadPoolExecutor(thread_name_prefix=ABANDONED)
    made = [Route("/", _page), Route("/static/{name:path}", _static)]
    for path, method, answer in _answers(session, Work(session), Saving(session, out)):
        made.append(Route(f"/api/{path}", _endpoint(threads, answer), methods=[method]))
    app = Starlette(routes=made)
    guard: Any = _Guard
    app.add_middleware(guard, port=port, token=token, arrived=arrived)
    return app


class _Guard:
    """Middleware that refuses other hosts, origins and tokens, and sets headers of safety."""

    def __init__(self, app: "ASGIApp", port: int, token: str, arrived: Callable[[], None]) -> None:
        self.app, self.token = app, token.encode()
        self.arrived: Callable[[], None] | None = arrived
        self.hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]")}
        self.origins = {f"http://{host}" for host in self.hosts}

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        if fault := self._fault(scope["path"], dict(scope["headers"])):
            await _error(403, fault)(scope, receive, send)
            return
        if scope["path"].startswith("/api/"):
            self._authenticate(scope)

        async def with_headers(message: "Message") -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_SAFETY]
            await send(message)

        await self.app(scope, receive, with_headers)

    def _authenticate(self, scope: "Scope") -> None:
        """Take note of a request with the token."""
        if (connection := scope.get("state", {}).get("connection")) is not None:
            connection.is_authenticated = True
        if self.arrived is not None:
            arrived, self.arrived = self.arrived, None
            arrived()

    def _fault(self, path: str, headers: dict[bytes, bytes]) -> str:
        host = headers.get(b"host", b"").decode("latin-1").lower()
        if host not in self.hosts:
            return "expected the address of this server, got another; open the printed URL"
        origin = headers.get(b"origin")
        if origin is not None and origin.decode("latin-1").lower() not in self.origins:
            return "expected a request of the viewer's own page, got another origin"
        if path.startswith("/api/"):
            given = headers.get(b"x-rastercov-token", b"")
            if not hmac.compare_digest(given, self.token):
                return "expected the token of this session, got another; open the printed URL"
        return ""


_SAFETY = [
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]


def _error(status: int, text: str) -> "Response":
    from starlette.responses import JSONResponse

    line = text if len(text) <= LONGEST_ERROR else f"{text[: LONGEST_ERROR - 1]}…"
    return JSONResponse({"error": line}, status_code=status)


async def _page(request: "Request") -> "Response":
    from starlette.responses import HTMLResponse

    text = page_text("index.html", import_map=IMPORT_MAP)
    return HTMLResponse(text, headers={"content-security-policy": POLICY})


async def _static(request: "Request") -> "Response":
    from starlette.responses import Response

    data = static_file(request.path_params["name"])
    if data is None:
        return _error(404, "no such file")
    kind = TYPES[Path(request.path_params["name"]).suffix]
    return Response(data, media_type=kind)


def _answers(session: Session, work: Work, saving: Saving) -> list[tuple[str, str, Answer]]:
    """Path, method and function of each answer."""

    def ping(body: Body) -> ByName:
        return {"revision": session.load()["revision"], "measured": session.progress}

    return [
        ("open", "GET", lambda body: open_live(session)),
        ("load", "GET", lambda body: session.load()),
        ("store", "POST", lambda body: session.store(body)),
        ("ask", "POST", lambda body: session.ask(body)),
        ("drawing", "GET", lambda body: session.describe_drawing()),
        ("drawing", "POST", lambda body: session.draw(body)),
        ("ping", "GET", ping),
        ("job", "POST", lambda body: {"id": work.start(body)}),
        ("job", "GET", lambda body: work.describe()),
        ("job/cancel", "POST", lambda body: work.cancel()),
        ("save", "POST", lambda body: saving.save(body)),
        ("download", "POST", lambda body: saving.content(body)),
    ]


def _response(answer: object) -> "Response":
    """Response with bytes, or with JSON."""
    from starlette.responses import Response

    if isinstance(answer, bytes):
        return Response(answer, media_type="application/octet-stream")
    return Response(json.dumps(answer), media_type="application/json")


def _endpoint(threads: ThreadPoolExecutor, answer: Answer) -> Any:
    """Endpoint that reads up to `MOST_BYTES`, answers in a thread, and reports errors in one line.

    A server that ends does not wait for `threads`, as it would for those of Starlette.
    """

    async def endpoint(request: "Request") -> "Response":
        from starlette.requests import ClientDisconnect
        from starlette.responses import Response

        from rastercov.base import RastercovError

        loop = asyncio.get_running_loop()
        try:
            body = await _body(request) if request.method == "POST" else {}
            return await loop.run_in_executor(threads, lambda: _response(answer(body)))
        except ClientDisconnect:
            return Response()  # to no one
        except _TooLong:
            refused = _error(413, f"expected at most {MOST_BYTES:,} bytes, got more; send less")
            refused.headers["connection"] = "close"  # the rest is not read
            return refused
        except (StaleError, BusyError) as error:
            return _error(409, str(error))
        except (RastercovError, MemoryError) as error:
            return _error(400, str(error) or type(error).__name__)
        except OSError as error:
            return _error(400, f"{error.filename or 'file'}: {error.strerror or error}")
        except Exception as error:
            fault = f"{type(error).__name__}: {one_line(error)} (a defect of rastercov)"
            LOG.warning("viewer: %s", fault)
            return _error(500, fault)

    return endpoint


class _TooLong(Exception):  # noqa: N818 - becomes an answer
    pass


async def _body(request: "Request") -> ByName:
    """JSON object of a request."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind != "application/json":
        raise ConfigError(f"expected content-type application/json, got {shown(kind)}; correct it")
    text = bytearray()
    async for part in request.stream():
        text += part
        if len(text) > MOST_BYTES:
            raise _TooLong
    with suppress(ValueError, RecursionError):
        body = json.loads(text or b"{}")
        if isinstance(body, dict):
            return body
    raise ConfigError("expected a JSON object, got something else; correct it")


def serve(
    session: Session,
    port: int = 0,
    out: Path | None = None,
    started: Callable[[str], None] = lambda url: None,
    arrived: Callable[[], None] = lambda: None,
) -> None:
    """Serve a session to this machine until Ctrl-C.

    Parameters
    ----------
    session, out
        As for `application`.
    port : int
        Port; 0 takes a free one.
    started : callable
        Gets the URL, with a token behind #, when it can be opened.
    arrived : callable
        Called when a page with the token has come.

    Raises
    ------
    ResourceError
        Where uvicorn is not installed.
    ConfigError
        For a port that cannot be bound.
    """
    try:
        import uvicorn

        from rastercov.page.connections import bound, settings
    except ImportError:
        raise ResourceError(INSTALL) from None
    with bound(port) as listener:
        port, token = listener.getsockname()[1], secrets.token_urlsafe(32)
        app = application(session, token, port, out, arrived)
        listener.listen()
        started(f"http://127.0.0.1:{port}/#{token}")
        try:
            uvicorn.Server(settings(app)).run(sockets=[listener])
        finally:
            session.close(SECONDS_TO_CLOSE)


@contextmanager
def redirect(url: str) -> Iterator[Path]:
    """File that leads a browser to a URL; it exists until the block ends."""
    # Browsers packaged by snap read neither /tmp nor hidden folders.
    place = Path.home() if shutil.which("snap") else None
    with TemporaryDirectory(prefix="rastercov-", dir=place, ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "open.html"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(PAGE.format(url=html.escape(url)))
        yield path
