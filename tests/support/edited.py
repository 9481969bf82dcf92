"""Sessions of a viewer that are edited by the modules of its page, in Node, without a browser.

`Session.act` is that of the page; what the page asks and stores are calls of the session.
"""

import base64
import json
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

from rastercov.base.errors import CameraError, ConfigError, RastercovError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.models import MODELS
from rastercov.page import session as viewer
from rastercov.page.live import open_live
from rastercov.page.saving import Saving as SavingOfPages
from rastercov.page.server import Work as WorkOfPlan
from rastercov.page.session import add_head
from rastercov.report.pages import bundle_scripts, describe_camera

NODE = shutil.which("node")
DRIVER = Path(__file__).with_name("page_in_node.js")


@cache
def node():
    """Node with the modules of the page."""
    script = Path(tempfile.mkdtemp()) / "page.mjs"
    script.write_text(bundle_scripts("live") + DRIVER.read_text("utf-8"), encoding="utf-8")
    return subprocess.Popen(
        [NODE, str(script)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


def sent(what):
    node().stdin.write(json.dumps(what) + "\n")
    node().stdin.flush()


def called(what, answer=None):
    """Result of a call in Node, which may need answers; errors of an answer as they are."""
    if NODE is None:
        pytest.skip("the page's modules need Node; see `make node`")
    sent(what)
    error = None
    while True:
        said = json.loads(node().stdout.readline())
        if "need" in said:
            try:
                sent({"answer": answer(said["need"], said.get("given"))})
            except RastercovError as caught:
                error = caught
                sent({"answer": 0, "fault": str(caught), "status": 400})
        elif "fault" in said:
            if error is not None and str(error) == said["fault"]:
                raise error
            assert said["status"], said["stack"]
            raise ConfigError(said["fault"])
        else:
            return said["done"]


def changed(camera, changes):
    """A camera with other values, as the page changes it."""
    models = {name: each.coefficients.split() for name, each in MODELS.items()}
    given = {"camera": describe_camera(camera), "changes": changes, "models": models}
    try:
        return Camera.from_dict(called({"id": 0, "call": "lens", "given": given}))
    except ConfigError as error:
        raise CameraError(str(error)) from None


class Session(viewer.Session):
    """A session with a page that edits its rig; attributes are of the rig that the page has."""

    def __init__(self, scene, method="certified"):
        super().__init__(scene, method)
        self.saving, self.work = SavingOfPages(self), WorkOfPlan(self)
        self._is_open, self.more = False, {}

    def _answer(self, name, given):
        calls = {
            "open": lambda: open_live(self) | {"engine": ""} | self.more,
            "load": self.load,
            "ping": lambda: {"revision": self.load()["revision"], "measured": []},
            "job": self.work.describe,
            "startJob": lambda: self.work.start(given),
            "cancelJob": self.work.cancel,
            "drawing": self.describe_drawing,
            "keepDrawing": lambda: viewer.Session.draw(self, given),
            "store": lambda: self.store(given),
            "ask": lambda: self.ask(given),
            "save": lambda: self.saving.save(given),
        }
        answer = calls[name]()
        if not isinstance(answer, bytes):
            return answer
        head, payload = viewer.remove_head(answer)
        return {"json": head, "payload": base64.b64encode(payload).decode()}

    def call(self, name, given=None):
        """A call of the page."""
        if not self._is_open:
            self._is_open = True
            called({"id": id(self), "call": "start"}, self._answer)
        return called({"id": id(self), "call": name, "given": given}, self._answer)

    def act(self, entries):
        """Frame after an action of the page."""
        given = {"revision": self.call("state")["revision"], **entries}
        answer = self.call("act", given)
        return add_head(answer["json"], base64.b64decode(answer["payload"]))

    def now(self):
        """The rig of the page, as it asks about it."""
        self.call("load")
        asked = viewer.check_entries(viewer.Of, self.call("asked"))
        return self.take(asked.rig, asked.at, asked.goal)

    def described_state(self):
        return self.call("state")

    def draw(self, changes):
        self.call("keepDrawing", changes)

    def describe(self):
        return self.scene.describe()

    @property
    def history(self):
        said = self.call("state")
        return SimpleNamespace(**said, undo=lambda: self.call("step", -1))

    @property
    def state(self):
        return self.now().state

    @property
    def moment(self):
        return self.now().moment

    @property
    def measurements(self):
        return self.moment.measurements

    @property
    def at(self):
        return self.moment.at

    def figures(self):
        return self.now().figures()

    def areas(self):
        return self.now().areas()

    def frame(self, mode, options=None, station=None):
        return self.now().answer("frame", mode=mode, options=options, station=station)

    def pieces(self):
        return self.now().answer("pieces")

    def zones(self):
        return self.now().answer("zones")

    def why(self, face):
        return self.now().answer("why", face=face)

    def image(self, station, side):
        return self.now().answer("image", station=station, side=side)


class Saving(SavingOfPages):
    """Files of the rig that the page of a session has."""

    def save(self, entries):
        session = self.session
        session.saving.out = self.out
        if entries not in ({"what": "rig"}, {"what": "report"}):
            return super().save({**session.call("asked"), **entries})
        answer = session.call("save", entries["what"])
        session.act({"action": {"do": "none"}, "mode": "reason"})
        return answer

    def content(self, what):
        if what == "page":
            return super().content({**self.session.call("asked"), "what": what})
        return self.session.call("texts")[what].encode()


class Work:
    """Work of the page of a session, which is over when it has been started."""

    def __init__(self, session):
        self.session, self._said = session, {"id": None}

    def start(self, what, **more):
        self._said = self.session.call("work", {**what, **more})

    def wait(self, seconds=None):
        pass

    def draw(self, changes):
        self.call("keepDrawing", changes)

    def describe(self):
        return self._said
