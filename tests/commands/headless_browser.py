"""A page in headless Chromium: its errors, values of expressions, clicks, and pictures, by the DevTools protocol."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest

WAIT = 60.0  # [s] for the browser and for what a page does
NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--remote-debugging-port=0"),
    *("--window-size=1000,1600", "--host-resolver-rules=MAP * ~NOTFOUND", "--hide-scrollbars"),
)


@contextmanager
def opened(path):
    """A Page that shows the file at `path`, without a network; the test is skipped without Chromium or tornado."""
    websocket = pytest.importorskip("tornado.websocket")
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("no Chromium here (Debian: apt install chromium)")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield Page(websocket, _address(Path(profile) / "DevToolsActivePort"), path)
        finally:
            browser.kill()
            browser.wait()


def _address(file):
    until = time.monotonic() + WAIT
    while time.monotonic() < until:
        if file.exists() and len(lines := file.read_text().split()) == 2:
            with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list") as answer:
                pages = [one for one in json.load(answer) if one["type"] == "page"]
            if pages:
                return pages[0]["webSocketDebuggerUrl"]
        time.sleep(0.1)
    raise AssertionError("the browser did not start")


class Page:
    """A page in the browser; `errors` has the exceptions, messages and requests that it should not have."""

    def __init__(self, websocket, address, path):
        from tornado.ioloop import IOLoop

        self.errors, self.number = [], 0
        self.loop = IOLoop(make_current=False)
        connect = lambda: websocket.websocket_connect(address, max_message_size=2**30)  # noqa: E731
        self.socket = self.loop.run_sync(connect, timeout=WAIT)
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.do(f"{domain}.enable")
        self.do("Page.navigate", url=Path(path).resolve().as_uri())
        self.until("document.readyState === 'complete'")

    def do(self, method, **parameters):
        """The answer to a command of the protocol."""
        self.number += 1
        self.socket.write_message(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            text = self.loop.run_sync(self.socket.read_message, timeout=WAIT)
            assert text is not None, "the browser ended"
            told = json.loads(text)
            if told.get("id") == self.number:
                assert "error" not in told, told
                return told["result"]
            self._note(told.get("method"), told.get("params", {}))

    def _note(self, event, told):
        if event == "Runtime.exceptionThrown":
            self.errors.append(told["exceptionDetails"].get("exception", told["exceptionDetails"]))
        elif event == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.errors.append(told["entry"]["text"])
        elif event == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning"):
            self.errors.append(told["args"])
        elif event == "Network.requestWillBeSent":
            address = told["request"]["url"]
            if not address.startswith(("file:", "data:", "about:", "blob:")):
                self.errors.append(address)

    def value(self, expression):
        """The value of an expression."""
        answer = self.do("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression):
        """Wait until an expression is true."""
        until = time.monotonic() + WAIT
        while not self.value(expression):
            assert time.monotonic() < until, (expression, self.errors)
            time.sleep(0.1)

    def click(self, x, y):
        """Click on a point [pixels] of the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.do("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def click_until(self, place, expression):
        """Click on what the expression `place` gives until another one is true.

        A busy browser takes two clicks for one, or draws after the click what lies under it.
        """
        until = time.monotonic() + WAIT
        while not self.value(expression):
            assert time.monotonic() < until, (expression, self.errors)
            self.click(*self.value(place))
            time.sleep(1.0)

    def picture(self):
        """The window as PNG."""
        return base64.b64decode(self.do("Page.captureScreenshot")["data"])
