"""A viewer's server that can die and come back, and a Chromium that opens its page.

Chromium is the system's own; Playwright drives it and downloads nothing. Its headless mode needs
SwiftShader for WebGL. The page's own policy forbids the scripts that Playwright injects to wait for
something, so contexts bypass it; `test_server.py` checks the policy itself.
"""

import shutil
import threading
import time
from contextlib import contextmanager

import numpy as np

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
ARGUMENTS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
TOKEN = "a-token-of-the-tests-0123456789"


class Program:
    """A server of a session on a port of its own, as `rastercov view` runs it."""

    def __init__(self, session, port=0, token=TOKEN, out=None):
        self.arrived = lambda: None
        self.session, self.token, self.out = session, token, out
        self.port, self._server, self._thread = port, None, None

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/#{self.token}"

    def start(self):
        import uvicorn

        from rastercov.page.connections import bound, settings
        from rastercov.page.server import application

        made = bound(self.port)
        made.listen()
        self.port = made.getsockname()[1]
        app = application(self.session, self.token, self.port, self.out, self.arrived)
        self._server = uvicorn.Server(settings(app))
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [made]}, daemon=True
        )
        self._thread.start()
        while not self._server.started:
            time.sleep(0.01)

    def stop(self):
        self._server.should_exit = True
        self._thread.join(10)


@contextmanager
def chromium():
    """A browser; needs `CHROMIUM` and Playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def context_of(browser):
    """Windows of one size, without motion."""
    made = browser.new_context(
        viewport={"width": 1180, "height": 620}, bypass_csp=True, reduced_motion="reduce"
    )
    made.set_default_timeout(60_000)
    try:
        yield made
    finally:
        made.close()


class Tab:
    """A page of the viewer, with what went wrong in it and what it asked for."""

    def __init__(self, context, url):
        self.page = context.new_page()
        self.faults, self.requests = [], []
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", self._heard)
        self.page.goto(url)
        while not self.js("window.rastercov?.session.figures !== undefined"):
            self.page.wait_for_timeout(50)
        self.idle()

    def _heard(self, message):
        if message.type == "error" and "Content Security Policy" in message.text:
            self.faults.append(message.text)

    def idle(self):
        """Wait until no answer and no picture is due."""
        self.page.evaluate("rastercov.whenIdle()")

    def js(self, expression, argument=None):
        return self.page.evaluate(expression, argument)

    def levels(self):
        return bytes(self.js("rastercov.levels()"))

    def state(self):
        return self.js("rastercov.state()")

    def pose(self, station=0):
        """(4, 4) pose of a station."""
        return np.reshape(self.state()["stations"][station]["pose"], (4, 4))

    def click_middle(self):
        box = self.page.locator("canvas.scene").bounding_box()
        self.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)

    def area_percent(self):
        """Covered part of the task's area."""
        return self.js("rastercov.summary().covered_area.percent")

    def open(self, panel):
        """Open a panel by its tab."""
        self.page.get_by_role("tab", name=panel, exact=True).click()

    def type_number(self, label, text):
        """Type into the box of a number and leave it."""
        box = self.page.locator(f'input.number[aria-label="{label}"]:visible')
        box.fill(text)
        box.press("Tab")
        self.idle()
        return box

    def keys(self, *keys):
        """Keys to what has the focus."""
        for key in keys:
            self.page.keyboard.press(key)
        self.idle()

    def button(self, name):
        """Click a button."""
        self.page.get_by_role("button", name=name).click()
        self.idle()

    def press(self, key):
        """A key over the picture."""
        self.page.locator("canvas.scene").focus()
        self.page.keyboard.press(key)

    def place(self, point):
        """Place of a world point in the window, pixels, when the view is at rest."""
        self.idle()
        x, y, _ = self.js("point => rastercov.screenOf(point)", list(point))
        box = self.page.locator("canvas.scene").bounding_box()
        return box["x"] + x, box["y"] + y

    def drag(self, start, end, *, release=True):
        """Drag from one place in the window to another, in steps."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        mouse.move(*end, steps=4)
        if release:
            mouse.up()
            self.page.wait_for_function("rastercov.session.isIdle")  # also after a lost answer
            self.idle()
