"""Attacks of other users on a viewer's server, and programs of it that are ended."""

import os
import resource
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress

from commands import ENTRY

VIEW = ("view", "teapot-5", "-c", "khepra", "-p", "sphere:3")
SLOW = """
import sys, time
from rastercov.page.session import Session
ask = Session.ask
def slow(self, entries):
    with self.lock:
        end = time.monotonic() + 60
        while time.monotonic() < end:
            sum(range(10_000))
    return ask(self, entries)
Session.ask = slow
"""
"""Before the command: answers that take a minute."""


STARTS = {
    "silent": "",
    "head": "GET / HTTP/1.1\r\n{host}x-a: ",
    "body": "POST /api/ask HTTP/1.1\r\n{host}content-length: 900000\r\n\r\n{{",
    "no HTTP": "\x16\x03\x01\x02\x00\x01\x00\x01",
    "unread": "GET /static/style.css HTTP/1.1\r\n{host}\r\n",
}
"""Starts of requests, if any, of connections that ask for no answer."""


def half_opened(kind, port, more=""):
    """A connection that asks for no answer; `more` are further lines of its head."""
    host = f"Host: 127.0.0.1:{port}\r\ncontent-type: application/json\r\n{more}"
    made = socket.create_connection(("127.0.0.1", port), timeout=20)
    made.sendall(STARTS[kind].format(host=host).encode("latin-1"))
    return made


KINDS = tuple(STARTS)


@contextmanager
def many_half_opened(number, port, kinds=KINDS):
    """Many of them, which stay until the block ends; those that the server closed, too."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(number + 1000, hard)), hard))
    with ExitStack() as made:
        made.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        lines = []
        for row in range(number):
            with suppress(OSError):  # closed while it sent
                lines.append(made.enter_context(half_opened(kinds[row % len(kinds)], port)))
        yield lines


def seconds_to_close(connection, limit, trickle=b""):
    """Seconds until the server closes a connection that sends `trickle` ten times a second.

    Infinity where it is open after `limit`.
    """
    began = time.monotonic()
    connection.settimeout(0.1)
    while (seconds := time.monotonic() - began) < limit:
        try:
            connection.sendall(trickle)
            if not connection.recv(65536):
                return seconds
        except TimeoutError:
            continue
        except OSError:
            return seconds
    return float("inf")


class Viewer:
    """The command `view` as a process; `url` and `token` are those that it printed."""

    def __init__(self, *options, code=ENTRY, **environment):
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", code, *VIEW, *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=os.environ | environment,
        )  # fmt: skip
        lines = iter(self.process.stdout.readline, "")
        self.url, self.token = next(x for x in lines if "/#" in x).strip().split("/#")

    def ended(self, seconds=60):
        """Exit code, and what it said on standard error."""
        try:
            _, said = self.process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
            return "it hangs", ""
        return self.process.returncode, said


def interrupted(after, gaps=(), *, is_slow=True):
    """Exit code and errors of a viewer that gets Ctrl-C `after` an edit was sent, s, and again."""
    import httpx

    viewer = Viewer("--no-browser", code=SLOW + ENTRY if is_slow else ENTRY)
    body = {"question": "frame"}
    headers = {"x-rastercov-token": viewer.token}
    with ThreadPoolExecutor() as pool:
        pool.submit(httpx.post, f"{viewer.url}/api/ask", json=body, headers=headers)
        for wait in (after, *gaps):
            time.sleep(wait)
            if viewer.process.poll() is None:
                viewer.process.send_signal(signal.SIGINT)
        return viewer.ended()
