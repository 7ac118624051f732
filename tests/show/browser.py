"""A headless Chromium under test, driven by the Chrome DevTools Protocol over a pipe."""

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

from tests.processes import LIMIT

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
_KEYS = {
    "Backspace": 8,
    "Tab": 9,
    "Enter": 13,
    "Escape": 27,
    " ": 32,
    "End": 35,
    "Home": 36,
    "ArrowLeft": 37,
    "ArrowUp": 38,
    "ArrowRight": 39,
    "ArrowDown": 40,
}
_SWAPS = "BackForwardCache,ProactivelySwapBrowsingInstance,SpareRendererForSitePerProcess"
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-extensions",
    "--renderer-process-limit=1",  # all pages are shown by one process: to start others takes long
    "--disable-site-isolation-trials",
    f"--disable-features={_SWAPS}",
    "--remote-debugging-pipe",
)


class PageLeftError(AssertionError):
    """Another page was loaded before an answer."""


class Page:
    """A page that is open in a browser.

    complaints: Errors and warnings of the console, and what was thrown.
    requests: Addresses that the page asked for, without the page itself.
    """

    def __init__(self, to_browser, from_browser):
        self._to, self._from = to_browser, from_browser
        self._rest, self._number, self._session = b"", 0, None
        self.complaints, self.requests = [], []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def open(self, place, *, width=1200, height=800, dark=False, storage=None):
        """Open a file or an address; complaints and requests are those of this page from now on.

        Args:
            place: The file or address.
            width: Of the page [pixels].
            height: Of the page [pixels].
            dark: Whether the user likes dark colours.
            storage: What alone the local storage of the place has before the page runs; None leaves it as it is.
        """
        address = place.as_uri() if isinstance(place, Path) else place
        self.complaints.clear()
        self.requests.clear()
        self._call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        self.like_dark(dark)
        if storage is not None:
            fill = f"localStorage.clear(); Object.assign(localStorage, {json.dumps(storage)})"
            script = self._call("Page.addScriptToEvaluateOnNewDocument", source=fill)
        self._call("Page.navigate", url=address)
        self.wait_for_load()
        if storage is not None:
            self._call("Page.removeScriptToEvaluateOnNewDocument", **script)
        self.requests[:] = [url for url in self.requests if url != address and not url.startswith("data:")]

    def like_dark(self, dark=True):
        """Whether the user likes dark colours, from now on. None likes motion: a click misses while a page scrolls."""
        likes = {"prefers-color-scheme": "dark" if dark else "light", "prefers-reduced-motion": "reduce"}
        features = [{"name": name, "value": value} for name, value in likes.items()]
        self._call("Emulation.setEmulatedMedia", features=features)

    def wait_for_load(self):
        """Wait until the page has loaded."""
        self.evaluate(
            "new Promise((done) => document.readyState === 'complete' ? done() : addEventListener('load', done))"
        )

    def wait_for(self, script: str):
        """Wait until a script has a value that counts as true, and return it; other pages may load meanwhile."""
        end = time.monotonic() + LIMIT
        while True:
            found = f"Promise.resolve({script}).then((found) => (found instanceof Node ? true : found))"
            with contextlib.suppress(PageLeftError):
                answer = self._call("Runtime.evaluate", expression=found, awaitPromise=True, returnByValue=True)
                if "exceptionDetails" not in answer and (value := answer["result"].get("value")):
                    return value
            assert time.monotonic() < end, f"not within {LIMIT:g} s: {script}"
            time.sleep(0.05)

    def press(self, *keys: str):
        """Press keys, by their names in KeyboardEvent.key; with the control key as "Control+Home"."""
        for each in keys:
            key = each.removeprefix("Control+")
            if key != each:
                code = {"key": key, "modifiers": 2, "windowsVirtualKeyCode": _KEYS.get(key) or ord(key.upper())}
                self._call("Input.dispatchKeyEvent", type="rawKeyDown", **code)
                self._call("Input.dispatchKeyEvent", type="keyUp", **code)
                continue
            text = {"text": {"Enter": "\r"}.get(key, key)} if len(key) == 1 or key == "Enter" else {}
            code = {"windowsVirtualKeyCode": _KEYS[key]} if key in _KEYS else {}
            self._call("Input.dispatchKeyEvent", type="keyDown", key=key, **code, **text)
            self._call("Input.dispatchKeyEvent", type="keyUp", key=key, **code)

    def drag(self, start, end):
        """Press the mouse at a place in sight [pixels], move it to another, and release it; at one place: click."""
        (x, y), (to_x, to_y) = start, end
        button = {"button": "left", "clickCount": 1}
        self._call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self._call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **button)
        for share in (0.3, 0.7, 1.0) if start != end else ():
            there = {"x": x + share * (to_x - x), "y": y + share * (to_y - y)}
            self._call("Input.dispatchMouseEvent", type="mouseMoved", buttons=1, **there)
        self._call("Input.dispatchMouseEvent", type="mouseReleased", x=to_x, y=to_y, **button)

    def slide(self, start, end):
        """Move a finger from a place in sight [pixels] to another."""
        (x, y), (to_x, to_y) = start, end
        points = [{"x": x + share * (to_x - x), "y": y + share * (to_y - y)} for share in (0.0, 0.3, 0.7, 1.0)]
        for kind, place in zip(("touchStart", "touchMove", "touchMove", "touchMove"), points, strict=True):
            self._call("Input.dispatchTouchEvent", type=kind, touchPoints=[place])
        self._call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def middle(self, selector: str):
        """The middle of an element [pixels], which comes into sight."""
        self.wait_for(f"document.querySelector({json.dumps(selector)})")
        return tuple(
            self.evaluate(
                f"(() => {{ const one = document.querySelector({json.dumps(selector)});"
                "one.scrollIntoView({ block: 'nearest', behavior: 'instant' });"
                "const box = one.getBoundingClientRect();"
                "return [box.left + box.width / 2, box.top + box.height / 2]; })()"
            )
        )

    def click(self, selector: str):
        """Click an element with the mouse."""
        place = self.middle(selector)
        self.drag(place, place)

    def screenshot(self, file: Path, *, whole=True):
        """Write a picture of the page, of all of it or of what is in sight."""
        found = self._call("Page.captureScreenshot", captureBeyondViewport=whole)
        file.write_bytes(base64.b64decode(found["data"]))

    def evaluate(self, script: str):
        """The value of a script, of a promise its outcome."""
        answer = self._call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def collect_garbage(self):
        self._call("HeapProfiler.collectGarbage")

    def _call(self, method, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "navigated" in answer.get("error", {}).get("message", ""):
                    raise PageLeftError(answer)
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def _next(self):
        end = time.monotonic() + LIMIT
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._from], [], [], end - time.monotonic())
            assert ready, "the browser does not answer"
            data = os.read(self._from, 1 << 20)
            assert data, "the browser has ended"
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\0")
        return json.loads(line)

    def _note(self, event):
        parameters = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                self.complaints.append(parameters["exceptionDetails"]["text"])
            case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "warning", "assert"):
                self.complaints.append(str(parameters["args"]))
            case "Log.entryAdded" if parameters["entry"]["level"] in ("error", "warning"):
                self.complaints.append(parameters["entry"]["text"])
            case "Network.requestWillBeSent":
                self.requests.append(parameters["request"]["url"])


def _moved(number):
    """A file descriptor apart from 3 and 4, which the browser reads from and writes to."""
    moved = fcntl.fcntl(number, fcntl.F_DUPFD_CLOEXEC, 10)
    os.close(number)
    return moved


@contextlib.contextmanager
def browser(folder: Path):
    """A page of a browser with its profile in a folder."""
    browser_reads, we_write, we_read, browser_writes = map(_moved, (*os.pipe(), *os.pipe()))
    command = f'exec 3<&{browser_reads} 4>&{browser_writes}; exec "$@"'
    line = ["bash", "-c", command, "browser", CHROMIUM, *_OPTIONS, f"--user-data-dir={folder / 'profile'}"]
    none = subprocess.DEVNULL
    process = subprocess.Popen(line, pass_fds=(browser_reads, browser_writes), stdin=none, stdout=none, stderr=none)
    os.close(browser_reads)
    os.close(browser_writes)
    try:
        yield Page(we_write, we_read)
    finally:
        process.kill()
        process.wait()
        os.close(we_write)
        os.close(we_read)
