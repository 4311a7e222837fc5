"""A headless Chromium for the tests of pages, spoken to by its DevTools protocol over a pipe.

https://chromedevtools.github.io/devtools-protocol/
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time

import cv2
import numpy as np

CHROMIUM = next(
    filter(
        None,
        map(
            shutil.which, ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
        ),
    ),
    None,
)
_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--mute-audio",
    "--hide-scrollbars",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    # WebGL without a graphics card.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # There is no network but this computer.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE localhost, EXCLUDE 127.0.0.1",
)
# Without a graphics card, the processor takes about a tenth of a second for a picture of a scene: a
# page that draws as many as it can keeps the cores from all else.
_SLOWLY = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 330);
window.cancelAnimationFrame = clearTimeout;
"""
_PATIENCE = 120.0  # s


class Browser:
    """A page in a window, while its ``with`` block lasts.

    Attributes:
        errors: what went wrong on the page, as its console says.
        requests: addresses of all that it has asked for.
    """

    def __init__(self, width: int = 640, height: int = 400, *, slowly: bool = False):
        """Args: width, height: of the window (px). slowly: to draw but three pictures a second."""
        self._size, self._slowly = (width, height), slowly
        self.errors, self.requests = [], []
        self._number, self._session, self._buffer = 0, None, b""

    def __enter__(self):
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        self._process = subprocess.Popen(
            [
                "bash",
                "-c",
                f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}',
                CHROMIUM,
                *_OPTIONS,
                "--remote-debugging-pipe",
                f"--user-data-dir={self._profile.name}",
                "--window-size={},{}".format(*self._size),
                "about:blank",
            ],
            pass_fds=(theirs_in, theirs_out),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")
        if self._slowly:
            self._call("Page.addScriptToEvaluateOnNewDocument", source=_SLOWLY)
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        os.close(self._in)
        os.close(self._out)
        self._profile.cleanup()

    def open(self, url: str) -> None:
        """Goes to a page, and forgets the errors and requests of the one before."""
        for address in ("about:blank", url):
            self.errors.clear()
            self.requests.clear()
            answer = self._call("Page.navigate", url=address)
            assert "errorText" not in answer, answer
            self.wait_for("document.readyState === 'complete'")

    def evaluate(self, expression: str):
        """Returns the value of JavaScript, once it is there."""
        answer = self._call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, expression: str, patience: float = _PATIENCE):
        """Returns the value of JavaScript as soon as it is true."""
        deadline = time.monotonic() + patience
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < deadline, (expression, self.errors)
            time.sleep(0.1)
        return value

    def screenshot(self) -> np.ndarray:
        """Returns what is seen, (height, width, 3), blue first."""
        # The scene is drawn between two frames, and a frame takes its time here.
        self.evaluate(
            "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))"
        )
        data = base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"])
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)

    def resize(self, width: int, height: int, theme: str = "light") -> None:
        """Changes the size of the window (px), and the theme that it asks pages for."""
        size = dict(width=width, height=height, deviceScaleFactor=1, mobile=False)
        self._call("Emulation.setDeviceMetricsOverride", **size)
        features = [{"name": "prefers-color-scheme", "value": theme}]
        self._call("Emulation.setEmulatedMedia", features=features)

    def click(self, selector: str) -> str:
        """Clicks a link as a hand does; returns the address of the page that opens beside this one."""
        before = {each["targetId"] for each in self._pages()}
        place = self.evaluate(
            f"(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])"
            f"(document.querySelector('{selector}').getBoundingClientRect())"
        )
        mouse = dict(zip("xy", place), button="left", clickCount=1)
        for kind in ("mousePressed", "mouseReleased"):
            self._call("Input.dispatchMouseEvent", type=kind, **mouse)
        deadline = time.monotonic() + _PATIENCE
        while not (new := [p for p in self._pages() if p["targetId"] not in before and p["url"]]):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        self._call("Target.closeTarget", targetId=new[0]["targetId"])
        return new[0]["url"]

    def tap(self, selector: str) -> None:
        """Taps something as a finger does."""
        place = self.evaluate(
            f"(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])"
            f"(document.querySelector('{selector}').getBoundingClientRect())"
        )
        self._call("Emulation.setTouchEmulationEnabled", enabled=True)
        finger = [dict(zip("xy", place))]
        for kind, points in (("touchStart", finger), ("touchEnd", [])):
            self._call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        self._call("Emulation.setTouchEmulationEnabled", enabled=False)

    def _pages(self) -> list[dict]:
        targets = self._call("Target.getTargets")["targetInfos"]
        return [each for each in targets if each["type"] == "page" and each["url"] != "about:blank"]

    def heap(self) -> float:
        """Returns how much memory the page's JavaScript holds (bytes)."""
        self._call("HeapProfiler.collectGarbage")
        return self._call("Runtime.getHeapUsage")["usedSize"]

    def _call(self, method, **params):
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                return answer["result"]
            self._note(answer.get("method"), answer.get("params"))

    def _read(self) -> dict:
        while b"\0" not in self._buffer:
            assert select.select([self._in], [], [], _PATIENCE)[0], "Chromium does not answer"
            data = os.read(self._in, 1 << 20)
            assert data, "Chromium has ended"
            self._buffer += data
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _note(self, event, params):
        if event == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif event == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
            self.errors.append(
                " ".join(str(a.get("value", a.get("description"))) for a in params["args"])
            )
        elif event == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        elif event == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
