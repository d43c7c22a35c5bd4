"""A headless Chromium in tests, driven by its DevTools protocol: pages are opened and looked at."""

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
NO_BROWSER = "no Chromium is installed: `apt install chromium` gives one"
_FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-extensions", "--disable-sync"),
    *("--disable-background-networking", "--disable-dev-shm-usage", "--mute-audio"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--hide-scrollbars", "--force-device-scale-factor=1", "--remote-debugging-port=0"),
)
WAIT_S = 120.0


def find_browser() -> str | None:
    """Return the path of a Chromium, None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Page:
    """One page of the browser."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._number = 0
        self.ask("Page.enable")

    def ask(self, method: str, **parameters: Any) -> Any:
        """Return the answer to a command of the protocol."""
        self._number += 1
        text = json.dumps({"id": self._number, "method": method, "params": parameters})
        self._socket.send(text)
        while True:
            answer = json.loads(self._socket.recv(timeout=WAIT_S))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def run(self, script: str) -> Any:
        """Return the value of an expression of JavaScript."""
        answer = self.ask("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, script: str) -> Any:
        """Return the value of an expression as soon as it counts as true."""
        end_s = time.monotonic() + WAIT_S
        while time.monotonic() < end_s:
            if value := self.run(script):
                return value
            time.sleep(0.2)
        raise AssertionError(f"in vain: {script}")

    def click(self, x: float, y: float) -> None:
        """Click at a pixel."""
        where = {"x": x, "y": y, "button": "left", "clickCount": 1}
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self.ask("Input.dispatchMouseEvent", type="mousePressed", **where)
        self.ask("Input.dispatchMouseEvent", type="mouseReleased", **where)

    def press(self, key: str, code: str) -> None:
        """Press a key by its name and its code in DevTools, as " " and "Space"."""
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=code)

    def picture(self, path: Path | None = None) -> NDArray[np.uint8]:
        """Return a screenshot, uint8 (height, width, 3); write it as PNG, too, if asked to."""
        from PIL import Image

        data = base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(data)
        return np.asarray(Image.open(BytesIO(data)).convert("RGB"))


@contextmanager
def open_page(url: str, profile: Path, width: int = 1000, height: int = 700) -> Iterator[Page]:
    """Open a page in a browser of its own; `profile` is an empty folder for it."""
    from websockets.sync.client import connect

    command = [str(find_browser()), *_FLAGS, f"--window-size={width},{height}"]
    command += [f"--user-data-dir={profile}", "about:blank"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, **quiet)  # type: ignore[call-overload]
    try:
        port = _port(profile, process)
        address = _address(port)
        with connect(address, max_size=None, open_timeout=WAIT_S) as socket:
            page = Page(socket)
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            page.ask("Emulation.setDeviceMetricsOverride", **size)
            page.ask("Page.navigate", url=url)
            yield page
            page.ask("Browser.close")
    finally:
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _port(profile: Path, process: "subprocess.Popen[bytes]") -> int:
    file = profile / "DevToolsActivePort"
    end_s = time.monotonic() + WAIT_S
    while time.monotonic() < end_s and process.poll() is None:
        if file.is_file() and (text := file.read_text(encoding="utf-8")).count("\n"):
            return int(text.splitlines()[0])
        time.sleep(0.05)
    raise AssertionError("the browser does not start")


def _address(port: int) -> str:
    from urllib.request import urlopen

    end_s = time.monotonic() + WAIT_S
    while time.monotonic() < end_s:
        with urlopen(f"http://127.0.0.1:{port}/json", timeout=WAIT_S) as answer:
            for target in json.load(answer):
                if target["type"] == "page":
                    return str(target["webSocketDebuggerUrl"])
        time.sleep(0.1)
    raise AssertionError("the browser has no page")
