"""What a user without the token can do to the server: nothing that its owner notices."""

import json
import socket
import time
from itertools import product
from unittest.mock import Mock

import httpx
import pytest
from browser import TOKEN, Program
from rigs_to_view import session_of
from viewer_doors import KINDS, half_opened, interrupted, many_half_opened, seconds_to_close

pytest.importorskip("uvicorn", reason="the viewer needs rastercov[view]")
from rastercov.page import connections

OWN = {"x-rastercov-token": TOKEN}
EDIT = {"question": "frame"}
SOON = 2.0
"""Seconds of CPU time, of the server and what asks it: other work on the machine does not count."""


@pytest.fixture
def program():
    """A server of a session."""
    session = session_of(count=2)
    running = Program(session)
    running.start()
    yield running
    running.stop()
    session.close()


@pytest.fixture
def quick(monkeypatch):
    """Limits of time of a second."""
    monkeypatch.setattr(connections, "ANONYMOUS_SECONDS", 1.0)
    monkeypatch.setattr(connections, "REQUEST_SECONDS", 1.0)


def asked(program, path="/api/ping"):
    began = time.process_time()
    answer = httpx.get(f"http://127.0.0.1:{program.port}{path}", headers=OWN, timeout=60)
    assert answer.status_code == 200
    return time.process_time() - began


@pytest.mark.parametrize("kind", KINDS)
def test_half_open_connections_do_not_shut_out_the_owner(program, kind):
    asked(program)
    with many_half_opened(300, program.port, [kind]):
        assert asked(program) < SOON
        assert asked(program, "/") < SOON
        assert asked(program, "/api/open") < SOON


def test_a_connection_with_the_token_keeps_its_place(program):
    with httpx.Client(headers=OWN, timeout=30) as client:
        url = f"http://127.0.0.1:{program.port}/api/ping"
        client.get(url)
        place = client.get(url).extensions["network_stream"].get_extra_info("client_addr")
        with many_half_opened(300, program.port):
            answer = client.get(url)
        assert answer.extensions["network_stream"].get_extra_info("client_addr") == place


@pytest.mark.parametrize(("kind", "trickle"), [
    ("silent", b""), ("silent", b"G"), ("head", b"a"), ("body", b" "), ("unread", b"")
])  # fmt: skip
def test_a_connection_without_the_token_has_little_time(program, quick, kind, trickle):
    """A body is read to no end although its request was refused."""
    with half_opened(kind, program.port) as line:
        assert seconds_to_close(line, 20, trickle) < 10


def test_a_body_with_the_token_has_a_limit_of_time(program, quick):
    token = f"X-Rastercov-Token: {TOKEN}\r\n"
    with half_opened("body", program.port, token) as line:
        assert seconds_to_close(line, 20, b" ") < 10


def slowly(monkeypatch, session, seconds):
    """Let each answer of a session take some time."""
    ask = session.ask
    monkeypatch.setattr(session, "ask", lambda body: time.sleep(seconds) or ask(body))


def test_an_answer_may_take_any_time(program, quick, monkeypatch):
    slowly(monkeypatch, program.session, 4)
    url = f"http://127.0.0.1:{program.port}/api/ask"
    assert httpx.post(url, json=EDIT, headers=OWN, timeout=60).status_code == 200


def test_a_large_answer_that_is_read_slowly_is_not_cut(program, quick, monkeypatch):
    data = bytes(20 << 20)
    monkeypatch.setattr("rastercov.page.server.open_live", lambda session: data)
    url, got = f"http://127.0.0.1:{program.port}/api/open", 0
    with httpx.stream("GET", url, headers=OWN, timeout=60) as answer:
        time.sleep(4)
        got = sum(map(len, answer.iter_bytes()))
    assert got == len(data)


def test_nothing_is_printed_when_a_page_closes_in_a_request(program, capfd, monkeypatch):
    """In its head, in its body, while its answer is computed, and while that is sent."""
    slowly(monkeypatch, program.session, 0.5)
    monkeypatch.setattr("rastercov.page.server.open_live", lambda session: bytes(20 << 20))
    head = f"Host: 127.0.0.1:{program.port}\r\nX-Rastercov-Token: {TOKEN}\r\n"
    text = json.dumps(EDIT)
    post = f"POST /api/ask HTTP/1.1\r\n{head}Content-Type: application/json\r\n"
    whole, chunked = (
        f"{post}Content-Length: {len(text)}\r\n\r\n{text}",
        "Transfer-Encoding: chunked",
    )
    sent = [
        *(whole[:size] for size in (1, 20, len(whole) - len(text), len(whole) - 3, len(whole))),
        *(f"{post}{chunked}\r\n\r\n{chunk}\r\n" for chunk in (f"5\r\n{text[:5]}", "zz")),
        f"GET /api/open HTTP/1.1\r\n{head}\r\n",
        f"GET / HTTP/1.1\r\n{head}Connection: upgrade\r\nUpgrade: websocket\r\n\r\n",
        "nonsense\r\n\r\n",
    ]
    for each, wait in product(sent, (0, 0.2)):
        with socket.create_connection(("127.0.0.1", program.port)) as line:
            line.sendall(each.encode())
            time.sleep(wait)
    time.sleep(1)
    asked(program)
    program.stop()
    assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize("gaps", [(), (0.05, 0.5, 0.5)])
def test_ctrl_c_in_a_request_ends_in_one_line(gaps):
    began = time.monotonic()
    code, said = interrupted(1.5, gaps)
    assert time.monotonic() - began < 45  # the answer takes a minute
    assert code == 130
    lines = [line for line in said.splitlines() if not line.startswith("warning: ")]
    assert lines == ["press Ctrl-C to stop", "interrupted"]


def test_a_defect_is_one_line(program, monkeypatch, capfd):
    defect = Mock(side_effect=KeyError("lengthy " * 4000))
    monkeypatch.setattr(program.session, "load", defect)
    answer = httpx.get(f"http://127.0.0.1:{program.port}/api/load", headers=OWN, timeout=30)
    assert answer.status_code == 500
    assert answer.json()["error"].startswith("KeyError: ")
    assert "Traceback" not in "".join(capfd.readouterr())
