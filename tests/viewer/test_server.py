"""The server without a browser: what it refuses, and that its answers are those of the session."""

import json
import math
import socket
from contextlib import suppress

import httpx
import numpy as np
import pytest
from browser import TOKEN as SECRET
from browser import Program
from rigs_to_view import around, moved, part, session_of

from rastercov import ConfigError
from rastercov.page.server import serve
from rastercov.page.session import unframed
from rastercov.report.pages import static_file

pytest.importorskip("uvicorn")
TOKEN = {"x-rastercov-token": SECRET}
POSES = around(part())


@pytest.fixture(scope="module")
def session():
    made = session_of()
    yield made
    made.close()


@pytest.fixture(scope="module")
def client(session, tmp_path_factory):
    program = Program(session, out=tmp_path_factory.mktemp("out"))
    program.start()
    url = f"http://127.0.0.1:{program.port}"
    with httpx.Client(base_url=url, headers=TOKEN, timeout=60) as opened:
        yield opened
    program.stop()


@pytest.fixture(scope="module")
def port(client):
    return client.base_url.port


def acted(client, action, revision=None, **others):
    if revision is None:
        revision = client.get("/api/ping").json()["revision"]
    return client.post(
        "/api/act", json={"revision": revision, "mode": "reason", "action": action, **others}
    )


def test_the_page_and_its_files_need_no_token(client):
    bare = {"x-rastercov-token": ""}
    page, script = (client.get(path, headers=bare) for path in ("/", "/static/main.js"))
    assert page.status_code == 200
    assert SECRET not in page.text
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "unsafe" not in page.headers["content-security-policy"]
    assert page.headers["x-content-type-options"] == "nosniff"
    assert script.headers["content-type"].startswith("text/javascript")


API = ("scene", "soup", "groups", "state", "ping", "zones", "job", "image?station=0", "why?face=0",
       "download?what=rig")  # fmt: skip
EDITS = ("act", "job", "job/cancel", "save")


@pytest.mark.slow
@pytest.mark.parametrize("path", API + EDITS)
@pytest.mark.parametrize(
    "headers",
    [
        *({"x-rastercov-token": token} for token in ("", SECRET[:-1])),
        *({"host": host} for host in ("evil.example", "evil.example:PORT", "127.0.0.1:1",
                                      "127.0.0.1", "127.0.0.1.evil.example:PORT")),
        *({"origin": origin} for origin in ("https://evil.example", "null", "http://127.0.0.1",
                                            "http://127.0.0.1:PORT.evil.example")),
    ],
)  # fmt: skip
def test_a_foreign_host_origin_or_token_is_refused(client, session, port, path, headers):
    headers = {name: value.replace("PORT", str(port)) for name, value in headers.items()}
    before = session.history.revision
    method = "POST" if path in EDITS else "GET"
    answer = client.request(method, f"/api/{path}", headers=headers, json={})
    assert answer.status_code == 403
    assert "\n" not in answer.json()["error"]
    assert session.history.revision == before
    if "x-rastercov-token" not in headers:  # the page and its files need none
        for path in ("/", "/static/main.js"):
            assert client.get(path, headers=headers).status_code == 403


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]"])
def test_names_of_this_machine_are_taken(client, port, host):
    own = {"host": f"{host}:{port}", "origin": f"http://{host}:{port}"}
    assert client.get("/api/ping", headers=own).status_code == 200


@pytest.mark.parametrize(
    "name",
    ["../server.py", "..%2fserver.py", "%2e%2e/server.py", "nothing.js", "main.py",
     "shaders/../x.js", "shaders/face.vert.glsl", "/etc/passwd", "main.js%00.html", ""],
)  # fmt: skip
def test_only_files_of_the_page_are_given(client, name):
    assert client.get(f"/static/{name}").status_code == 404
    assert static_file(name) is None


def test_the_faces_are_those_of_the_mesh(client, session):
    answer = client.get("/api/soup")
    origin = np.array([float(x) for x in answer.headers["x-rastercov-origin"].split(",")])
    corners = np.frombuffer(answer.content, "<f4").reshape(-1, 3, 3) + origin
    mesh = session.scene.mesh
    assert np.abs(corners - mesh.vertices[mesh.faces]).max() < 1e-6
    groups = np.frombuffer(client.get("/api/groups").content, "<u2")
    assert np.array_equal(groups, mesh.face_group)
    assert client.get("/api/scene").json()["n_faces"] == mesh.n_faces


def test_an_edit_gives_the_frame_of_the_session(client, session):
    answer = acted(client, {"do": "pose", "station": 0, "pose": moved(POSES[0], (0.02, 0, 0))})
    head, levels = unframed(answer.content)
    again, expected = unframed(session.frame("reason", {}))
    assert levels == expected
    assert head["summary"]["covered"] == again["summary"]["covered"]
    assert acted(client, {"do": "undo"}).status_code == 200


def test_two_tabs_cannot_overwrite_each_other(client):
    revision = client.get("/api/ping").json()["revision"]
    codes = [
        acted(client, action, revision).status_code
        for action in (
            {"do": "duplicate", "station": 0}, {"do": "delete", "station": 0}, {"do": "none"}
        )
    ]  # fmt: skip
    assert codes == [200, 409, 200]  # looking is no edit
    assert len(client.get("/api/state").json()["stations"]) == 5
    acted(client, {"do": "undo"})


LONG = "lengthy " * 4000
NOTHING = {"revision": 0, "mode": "reason", "action": {"do": "none"}}
RIG = {"stations": [], "cameras": {"a": {"plain": {LONG: LONG}}}, "task": {}}
ENTRIES = (
    {"revision": True}, {"revision": LONG}, {"mode": LONG}, {LONG: 1}, {"options": {"a": [1]}},
    {"options": {LONG: [1]}}, {"mode": "segments", "options": {"beta_deg": LONG}},
    {"mode": "single", "station": 99},
)  # fmt: skip
POSE = {"do": "pose", "station": 0, "pose": [float(x) for x in POSES[0].ravel()]}
EYE = {"do": "camera", "camera": "eye"}
ACTIONS = (
    {"do": "fly"}, {}, {"do": LONG}, {"do": "none", LONG: 1},
    {"do": "delete", "station": 0, LONG: 1},
    *(POSE | {"pose": pose} for pose in ("x", [1, 2], [math.nan] * 16, [2.0] * 16)),
    POSE | {"station": 77}, POSE | {"station": "0"}, {"do": "use", "station": 0, "camera": LONG},
    *({"do": "rename", "station": 0, "name": name} for name in (LONG, "", "  ", "a\nb")),
    *(EYE | {"changes": changes} for changes in ({LONG: 1}, {"fx": -1})),
    EYE | {"camera": "no", "changes": {}}, {"do": "restore", "rig": RIG},
    *({"do": "task", "changes": changes}
      for changes in ({LONG: 1}, {"mode": LONG}, {"min_visibility": 7})),
    {"do": "new_camera", "name": "eye", "source": "khepra"}, {"do": "constraints", "is_kept": True},
    {"do": "new_camera", "name": "x", "source": "nope"},
    {"do": "aim", "station": 0, "point": POSES[0, :3, 3].tolist()},
)  # fmt: skip
BODIES = [
    *(b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"revision": 1e999}'),
    *(NOTHING | each for each in ENTRIES),
    *(NOTHING | {"action": each} for each in ACTIONS),
]


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("path", ["act", "job", "save"])
def test_malformed_messages_do_no_harm_and_are_quoted_in_a_short_line(client, session, path, body):
    before, headers = session.state, {"content-type": "application/json"}
    content = body if isinstance(body, bytes) else json.dumps(body)
    answer = client.post(f"/api/{path}", content=content, headers=headers)
    assert answer.status_code in (400, 409)
    text = answer.json()["error"]
    assert len(text) <= 300
    assert "\n" not in text
    assert text.count("lengthy") < 12
    assert session.state is before


def test_a_form_of_another_page_is_refused(client):
    answer = client.post("/api/act", content=b"{}", headers={"content-type": "text/plain"})
    assert answer.status_code == 400


@pytest.mark.parametrize("path", ["act", "job", "save"])
@pytest.mark.parametrize("is_said", [True, False])
def test_a_gigabyte_is_refused_early(client, port, path, is_said):
    """With its length in the header, and in chunks without; the next request is answered."""
    sent, body = 0, b" " * (1 << 16)
    how = f"content-length: {1 << 30}" if is_said else "transfer-encoding: chunked"
    head = (
        f"POST /api/{path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{how}\r\n"
        f"x-rastercov-token: {SECRET}\r\ncontent-type: application/json\r\n\r\n"
    )
    piece = body if is_said else b"10000\r\n" + body + b"\r\n"
    with socket.create_connection(("127.0.0.1", port), timeout=20) as line:
        line.sendall(head.encode())
        with suppress(OSError):
            while sent < 1 << 30:
                line.sendall(piece)
                sent += len(body)
    assert sent < 1 << 27
    assert client.get("/api/ping").status_code == 200


@pytest.mark.parametrize(
    "path",
    ["why?face=-1", "why?face=99999999", "why", "why?face=x", "image?station=0&side=100000",
     "image?station=9", "image", "download?what=passwd", "download"],
)  # fmt: skip
def test_wrong_questions_are_answered_in_one_line(client, path):
    answer = client.get(f"/api/{path}")
    assert answer.status_code == 400
    assert answer.json()["error"]


def test_a_port_that_is_taken_is_said(session):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match="expected a free port"):
            serve(session, port)
