"""The viewer's server under other users of the machine, closed pages and Ctrl-C.

Half-open connections of every kind while the owner asks, requests with long values, pages that
close at any byte of a request, and Ctrl-C at any moment of one.
"""

import contextlib
import io
import json
import random
import socket
import sys
import time

import httpx
from browser import TOKEN, Program
from rigs_to_view import session_of
from rows import Report
from viewer_doors import KINDS, interrupted, many_half_opened

CONNECTIONS = 10_000
"""Half-open connections of a whole campaign."""
REQUESTS = 2_000
"""Requests with long values, and as many pages that close."""
INTERRUPTS = 40
"""Programs that get Ctrl-C."""
SOON = 2.0
"""Seconds within which the owner is served."""
OWN = {"x-rastercov-token": TOKEN}
RIG = {
    "stations": [{"id": 0, "name": "a", "camera": "a", "is_on": True, "pose": [0.0] * 16}],
    "cameras": {"a": {"plain": {"preset": "khepra"}, "task": {"views": 1}}},
    "task": {"focus_rule": "vertices"},
    "devices": [{"id": "lamps 0", "pose": None}],
}
QUESTIONS = (
    {"question": "frame", "mode": "segments", "options": {"alpha_deg": 30.0}},
    {"question": "frame", "rig": RIG, "at": [0.0], "goal": "a"},
    {"question": "why", "face": 0},
    {"question": "image", "station": 0, "side": 100},
    {"question": "camera", "name": "khepra"},
    {"question": "settled", "pose": [0.0] * 16, "before": [0.0] * 16},
    {"revision": 0, "keep": 0, "steps": [[{}, "edit"]], "rest": {"at": 0}},
    {"what": "rig", "rig": RIG},
    {"cameras": 1},
)
PATHS = ("api/ping", "api/open", "api/load", "static/main.js", "")


def attack(report: Report, effort: float) -> None:
    """All parts, each fault printed."""
    session = session_of(count=2)
    program = Program(session)
    program.start()
    said = io.StringIO()
    url = f"http://127.0.0.1:{program.port}/"
    try:
        with contextlib.redirect_stderr(said):
            slowest = _half_open(program.port, url, max(300, int(CONNECTIONS * effort)), report)
            _long(url, max(20, int(REQUESTS * effort)), report)
            _closed(program.port, max(20, int(REQUESTS * effort)), report)
            is_served = httpx.get(f"{url}api/ping", headers=OWN, timeout=30).status_code == 200
    finally:
        program.stop()
        session.close()
    report.add("slowest answer to the owner meanwhile, CPU", slowest, "s", aim=SOON)
    report.check("the owner is served after all of them", is_served)
    report.check("nothing is printed", not said.getvalue())
    _interrupts(max(2, int(INTERRUPTS * effort)), report)


def _half_open(port: int, url: str, number: int, report: Report) -> float:
    """Seconds of the slowest answer to the owner among half-open connections."""
    slowest, refused = 0.0, 0
    for kinds in ((kind,) for kind in KINDS):
        with many_half_opened(number // len(KINDS), port, kinds):
            for path in PATHS:
                began = time.process_time()  # of the server, too
                try:
                    refused += httpx.get(url + path, headers=OWN, timeout=60).status_code != 200
                except httpx.HTTPError:
                    refused += 1
                slowest = max(slowest, time.process_time() - began)
    report.add("half-open connections", number // len(KINDS) * len(KINDS), "connections")
    report.add("requests of the owner refused meanwhile", refused, "requests", at_most=0)
    report.check("half-open connections shut nobody out", refused == 0)
    return slowest


def _long(url: str, number: int, report: Report) -> None:
    """Requests with a long value or key at a random place."""
    rng, wrong = random.Random(0), 0
    with httpx.Client(headers=OWN, timeout=60) as client:
        for _ in range(number):
            body = json.loads(json.dumps(rng.choice(QUESTIONS)))
            _lengthened(body, rng)
            path = rng.choice(["ask", "store", "job", "save", "download"])
            answer = client.post(f"{url}api/{path}", json=body)
            text = answer.json().get("error", "") if answer.status_code != 200 else ""
            bad = answer.status_code >= 500 or len(text) > 300 or text.count("long") > 20
            if bad or "\n" in text:
                wrong += 1
                print(f"{answer.status_code}: {text[:400]}", file=sys.stdout)
    report.add("requests with long values", number, "requests")
    report.add("errors that quote more than a short part", wrong, "errors", at_most=0)
    report.check("errors quote a short part of a request", wrong == 0)


def _lengthened(entries: dict, rng: random.Random) -> None:
    """Put a long key or value into a table or one of its tables."""
    tables = [entries]
    for table in tables:
        tables += [value for value in table.values() if isinstance(value, dict)]
    table, long = rng.choice(tables), "long " * 5000
    if table and rng.random() < 0.6:
        table[rng.choice(list(table))] = long
    else:
        table[long] = 1


def _closed(port: int, number: int, report: Report) -> None:
    """Pages that close after any byte of a request."""
    rng = random.Random(1)
    text = '{"question": "frame"}'
    for _ in range(number):
        head = f"Host: 127.0.0.1:{port}\r\nX-Rastercov-Token: {TOKEN}\r\n"
        whole = rng.choice([
            f"GET /{rng.choice(PATHS)} HTTP/1.1\r\n{head}\r\n",
            f"POST /api/ask HTTP/1.1\r\n{head}Content-Type: application/json\r\n"
            f"Content-Length: {len(text)}\r\n\r\n{text}",
        ])  # fmt: skip
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.sendall(whole[: rng.randint(0, len(whole))].encode())
            time.sleep(rng.choice([0, 0, 0.01]))
    report.add("pages that closed in a request", number, "pages")


def _interrupts(number: int, report: Report) -> None:
    """Ctrl-C, once or more, at random moments of an edit."""
    rng, wrong = random.Random(2), 0
    for row in range(number):
        gaps = [rng.uniform(0, 1) for _ in range(rng.randint(0, 3))]
        after = rng.uniform(0, 1.5)
        code, said = interrupted(after, gaps, is_slow=row % 2 == 0)
        lines = [line for line in said.splitlines() if not line.startswith("warning: ")]
        if code != 130 or lines != ["press Ctrl-C to stop", "interrupted"]:
            wrong += 1
            print(f"Ctrl-C after {after:.3f} s, then {gaps}: {code} {lines}", file=sys.stderr)
    report.add("programs that got Ctrl-C in a request", number, "programs")
    report.add("of these that end in anything but one line", wrong, "programs", at_most=0)
    report.check("Ctrl-C in a request ends in one line", wrong == 0)
