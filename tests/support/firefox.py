"""Firefox of the system, driven by WebDriver BiDi (W3C, 2025) over a WebSocket (RFC 6455).

Playwright drives a Firefox of its own build alone, and Debian has no geckodriver. WebGL without a
GPU needs an X server, Xvfb: as root, apt-get install -y firefox-esr xvfb.
"""

import base64
import json
import os
import re
import shutil
import socket
import struct
import subprocess
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

FIREFOX = next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)
XVFB = shutil.which("Xvfb")
SECONDS = 180
PREFERENCES = {
    "webgl.force-enabled": True,
    "browser.download.folderList": 2,
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "app.update.enabled": False,
}


class Socket:
    """Texts to and from a server on this machine."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=SECONDS)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [
            "GET /session HTTP/1.1",
            f"Host: 127.0.0.1:{port}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}",
            "Sec-WebSocket-Version: 13",
        ]
        self._socket.sendall("\r\n".join([*lines, "", ""]).encode())
        self._stream = self._socket.makefile("rb")
        assert b" 101 " in self._stream.readline()
        while self._stream.readline().strip():
            pass

    def send(self, text):
        data, mask = text.encode(), os.urandom(4)
        size = struct.pack("!B", 0x80 | min(len(data), 125))
        if len(data) > 125:
            is_short = len(data) < 1 << 16
            size = struct.pack("!BH" if is_short else "!BQ", 0xFE if is_short else 0xFF, len(data))
        covered = bytes(byte ^ mask[k % 4] for k, byte in enumerate(data))
        self._socket.sendall(b"\x81" + size + mask + covered)

    def receive(self):
        parts, is_last = [], False
        while not is_last:
            first, size = self._stream.read(2)
            if size > 125:
                kind = "!H" if size == 126 else "!Q"
                (size,) = struct.unpack(kind, self._stream.read(struct.calcsize(kind)))
            parts.append(self._stream.read(size))
            is_last = bool(first & 0x80)
            assert first & 0x0F in (0, 1), "the browser ended the connection"
        return b"".join(parts).decode()

    def close(self):
        self._stream.close()
        self._socket.close()


class Page:
    """The one tab of a browser."""

    def __init__(self, port):
        self._socket, self._number, self.faults, self.requests = Socket(port), 0, [], []
        self.call("session.new", capabilities={})
        (answer,) = self.call("browsingContext.getTree")["contexts"]
        self.context = answer["context"]
        self.call("session.subscribe", events=["log.entryAdded", "network.beforeRequestSent"])

    def call(self, method, **parameters):
        """Result of a command; events that come before it are kept."""
        self._number += 1
        own = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(own))
        while True:
            said = json.loads(self._socket.receive())
            if said.get("id") == self._number:
                assert said["type"] == "success", said.get("message")
                return said["result"]
            if said.get("method") == "log.entryAdded" and said["params"]["level"] == "error":
                self.faults.append(said["params"]["text"])
            if said.get("method") == "network.beforeRequestSent":
                self.requests.append(said["params"]["request"]["url"])

    def goto(self, url):
        self.call("browsingContext.navigate", context=self.context, url=url, wait="complete")

    def resize(self, width, height):
        size = {"width": width, "height": height}
        self.call("browsingContext.setViewport", context=self.context, viewport=size)

    def picture(self, path):
        answer = self.call("browsingContext.captureScreenshot", context=self.context)
        Path(path).write_bytes(base64.b64decode(answer["data"]))

    def js(self, expression):
        """Value of an expression or a promise."""
        answer = self.call(
            "script.evaluate",
            expression=f"(async () => JSON.stringify((await ({expression})) ?? null))()",
            target={"context": self.context},
            awaitPromise=True,
        )
        assert answer["type"] == "success", answer["exceptionDetails"]["text"]
        return json.loads(answer["result"]["value"])

    def until(self, expression):
        """Wait until an expression is true."""
        wait = "new Promise((next) => setTimeout(next, 50))"
        limit = f"performance.now() + {1000 * SECONDS}"
        assert self.js(
            f"(async () => {{ const end = {limit}; while (!({expression})) "
            f"{{ if (performance.now() > end) return false; await {wait}; }} return true; }})()"
        ), expression

    def close(self):
        self._socket.close()


@contextmanager
def display():
    """Name of an X server without a screen."""
    with ended([XVFB, "-displayfd", "1", "-screen", "0", "1280x900x24"], "stdout") as program:
        yield f":{program.stdout.readline().strip()}"


@contextmanager
def ended(command, read, **options):
    """A program whose output is read, until the block ends."""
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, read: subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes, **options) as program:
        try:
            yield program
        finally:
            program.terminate()


@contextmanager
def firefox():
    """A page of a new profile; needs `FIREFOX` and `XVFB`."""
    with TemporaryDirectory(prefix="rastercov-firefox-") as folder, display() as name:
        lines = [f"user_pref({json.dumps(k)}, {json.dumps(v)});" for k, v in PREFERENCES.items()]
        Path(folder, "user.js").write_text("\n".join(lines))
        options = ["--headless", "--no-remote", "--profile", folder, "--remote-debugging-port", "0"]
        env = os.environ | {"DISPLAY": name, "LIBGL_ALWAYS_SOFTWARE": "1"}
        with ended([FIREFOX, *options], "stderr", env=env) as program:
            result = None
            while not result:
                line = program.stderr.readline()
                assert line, "Firefox ended"
                result = re.search(r"BiDi listening on ws://127\.0\.0\.1:(\d+)", line)
            with closing(Page(int(result[1]))) as page:
                yield page
