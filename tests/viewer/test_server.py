"""The server without a browser: what it refuses, and that its answers are those of the session."""

import base64
import json
import math
import socket
import zlib
from contextlib import suppress

import httpx
import numpy as np
import pytest
from browser import TOKEN as SECRET
from browser import Program
from rigs_to_view import CAMERA, around, moved, part, session_of

import rastercov as rc
from rastercov import ConfigError
from rastercov.page.scene import describe_state
from rastercov.page.server import serve
from rastercov.page.session import remove_head
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


def rig_of(session):
    """The first rig of a session, as a page sends it."""
    return describe_state(session.scene, session.scene.start)


def asked(client, question="frame", **more):
    return client.post("/api/ask", json={"question": question, **more})


def test_the_page_and_its_files_need_no_token(client):
    bare = {"x-rastercov-token": ""}
    page, script = (client.get(path, headers=bare) for path in ("/", "/static/main.js"))
    assert page.status_code == 200
    assert SECRET not in page.text
    assert "default-src 'none'" in page.headers["content-security-policy"]
    policy = page.headers["content-security-policy"].replace("'wasm-unsafe-eval'", "")
    assert "unsafe" not in policy
    assert page.headers["x-content-type-options"] == "nosniff"
    assert script.headers["content-type"].startswith("text/javascript")


API = ("open", "load", "ping", "job", "drawing")
SENT = ("ask", "store", "job", "job/cancel", "save", "download", "drawing")


@pytest.mark.slow
@pytest.mark.parametrize("path", API + SENT)
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
    before = session.load()
    method = "POST" if path in SENT else "GET"
    answer = client.request(method, f"/api/{path}", headers=headers, json={})
    assert answer.status_code == 403
    assert "\n" not in answer.json()["error"]
    assert session.load() == before
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


def test_what_is_opened_has_the_mesh(client, session):
    data = client.get("/api/open").json()
    arrays = {
        name: zlib.decompress(base64.b64decode(data["mesh"][name]))
        for name in ("vertices", "faces", "groups")
    }
    mesh = session.scene.mesh
    assert arrays["vertices"] == mesh.vertices.astype("<f8").tobytes()
    assert arrays["faces"] == mesh.faces.astype("<i4").tobytes()
    assert arrays["groups"] == mesh.face_group.astype("<u2").tobytes()
    assert data["scene"]["n_faces"] == mesh.n_faces
    assert len(data["state"]["stations"]) == len(session.scene.start.stations)


def test_a_question_is_answered_for_the_rig_that_it_has(client, session):
    rig = rig_of(session)
    rig["stations"][0]["pose"] = moved(POSES[0], (0.02, 0, 0))
    head, levels = remove_head(asked(client, rig=rig).content)
    poses = np.array([np.reshape(each["pose"], (4, 4)) for each in rig["stations"]])
    result = rc.evaluate(part(), CAMERA, poses, fields=())
    percent = head["summary"]["covered_area"]["percent"]
    assert percent == pytest.approx(result.areas.summary()["percent"])
    plain, _ = remove_head(asked(client).content)  # of the first rig
    assert plain["summary"]["covered_area"]["percent"] != percent
    assert len(levels) == part().n_faces


def test_two_tabs_cannot_overwrite_each_other(client):
    revision = client.get("/api/load").json()["revision"]
    one = {"revision": revision, "keep": 0, "steps": [["a", ""]], "rest": {"at": 0}}
    codes = [client.post("/api/store", json=one).status_code for _ in range(2)]
    assert codes == [200, 409]
    more = {"revision": revision + 1, "keep": 1, "steps": [["b", "edit"]], "rest": {"at": 1}}
    assert client.post("/api/store", json=more).json() == {"revision": revision + 2}
    kept = client.get("/api/load").json()
    assert kept["steps"] == [["a", ""], ["b", "edit"]]
    assert kept["rest"] == {"at": 1}
    assert client.get("/api/ping").json()["revision"] == revision + 2


LONG = "lengthy " * 4000
PLAIN = {"width": 320, "height": 240, "fx": 300, "fy": 300}
RIG = {"stations": [], "cameras": {"a": {"plain": {LONG: LONG}}}, "task": {}}
STATION = {"id": 0, "name": "a", "camera": "eye", "is_on": True, "pose": [0.0] * 16}
POSE = [float(x) for x in POSES[0].ravel()]
STATIONS = (
    *({"pose": pose} for pose in ("x", [1, 2], [math.nan] * 16, [2.0] * 16, [0.0] * 16)),
    {"pose": POSE, "id": "0"}, {"pose": POSE, "camera": LONG}, {"pose": POSE, "name": LONG},
)  # fmt: skip
ASKED = (
    {"rig": RIG}, {LONG: 1}, {"mode": LONG}, {"options": {"a": [1]}}, {"options": {LONG: [1]}},
    {"mode": "segments", "options": {"beta_deg": LONG}}, {"mode": "single", "station": 99},
    {"at": [LONG]}, {"goal": LONG}, {"goal": "attic"}, {"station": "0"},
    {"question": LONG}, {"question": None}, {"question": "why"}, {"question": "why", "face": -1},
    {"question": "why", "face": 10**9}, {"question": "why", "face": "x"},
    {"question": "image"}, {"question": "image", "station": 0, "side": 100_000},
    {"question": "image", "station": 9}, {"question": "camera", "name": LONG},
    {"question": "camera", "plain": {LONG: 1}}, {"question": "camera", "plain": {"fx": -1}},
    {"question": "settled", "pose": [2.0] * 16, "before": POSE}, {"question": "settled"},
    {"question": "allowed", "eyes": [1.0]}, {"question": "allowed", "eyes": [LONG]},
    {"rig": {**RIG, "cameras": {}, "devices": [{"id": LONG, "pose": POSE}]}},
    *({"rig": {"stations": [STATION | each], "cameras": {}, "task": {}}} for each in STATIONS),
    {"rig": {"stations": 2 * [STATION | {"pose": POSE}], "cameras": {}, "task": {}}},
    *({"rig": {"stations": [], "cameras": {}, "task": task}}
      for task in ({LONG: 1}, {"min_visibility": 7}, {"views": "2"}, {"max_incidence_deg": [1]})),
    *({"rig": {**RIG, "cameras": {"eye": {"plain": PLAIN, "task": task}}}}
      for task in ({LONG: 1}, {"views": LONG})),
    {"revision": -1, "keep": 0, "steps": [], "rest": {}}, {"work": {"kind": "fly"}},
    {"what": LONG}, {"cameras": 0},
)  # fmt: skip
BODIES = [
    *(b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"question": 1e999}'),
    *({"question": "frame"} | each for each in ASKED),
]


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("path", ["ask", "store", "job", "save", "download"])
def test_malformed_messages_do_no_harm_and_are_quoted_in_a_short_line(client, session, path, body):
    before, headers = session.load(), {"content-type": "application/json"}
    content = body if isinstance(body, bytes) else json.dumps(body)
    answer = client.post(f"/api/{path}", content=content, headers=headers)
    assert answer.status_code in (400, 409)
    text = answer.json()["error"]
    assert len(text) <= 300
    assert "\n" not in text
    assert text.count("lengthy") < 12
    assert session.load() == before


def test_a_form_of_another_page_is_refused(client):
    answer = client.post("/api/ask", content=b"{}", headers={"content-type": "text/plain"})
    assert answer.status_code == 400


@pytest.mark.parametrize("path", ["ask", "job", "save"])
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


def test_a_port_that_is_taken_is_said(session):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match="expected a free port"):
            serve(session, port)
