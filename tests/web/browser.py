"""Chromium, Firefox and WebKitGTK without a window, and a server of pages."""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.client import HTTPConnection
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from shutil import which
from typing import Any, ClassVar

WIDTH, HEIGHT = 1000, 1400  # of a tab, in pixels
PATIENCE = 60.0  # s that a command may take

LISTEN = """<script>
  globalThis.heard = [];
  const hear = (text) => heard.push(String(text));
  console.error = console.warn = (...given) => hear(given.join(" "));
  addEventListener("error", ({ message, target }) => hear(message ?? target.outerHTML), true);
  addEventListener("unhandledrejection", ({ reason }) => hear(reason));
</script>"""
"""Stands first in the head of a page; notes errors and warnings, which not all drivers report."""

HEARD = "globalThis.heard?.splice(0) ?? []"


class _Silent(SimpleHTTPRequestHandler):
    extensions_map = {  # noqa: RUF012
        **SimpleHTTPRequestHandler.extensions_map,
        ".mjs": "text/javascript",
        ".js": "text/javascript",
        ".wasm": "application/wasm",
    }

    def log_message(self, *_: Any) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder, and yield its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Silent, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def _awaited(found: Callable[[], Any]) -> Any:
    """The first result of a function that is true."""
    limit = time.monotonic() + PATIENCE
    while not (result := found()):
        assert time.monotonic() < limit, "a browser does not start"
        time.sleep(0.02)
    return result


class Browser:
    """One tab of a browser.

    Args:
        programs: Paths of the programs in `NEEDS`.
        folder: Folder of its profile.

    Attributes:
        version: Name and version.
    """

    NEEDS: ClassVar[tuple[tuple[str, ...], ...]]
    """The programs, each by the names that systems give it."""

    version: str

    def __init__(self, programs: list[str], folder: Path) -> None:
        self._heard: list[str] = []
        self._start(programs, folder, {**os.environ, "HOME": str(folder), "TMPDIR": str(folder)})

    @classmethod
    def programs(cls) -> list[str] | None:
        """Paths of the programs; None if one is not installed."""
        found = [path for names in cls.NEEDS if (path := next(filter(None, map(which, names)), ""))]
        return found if len(found) == len(cls.NEEDS) else None

    def _start(self, programs: list[str], folder: Path, environment: dict[str, str]) -> None:
        """Start the programs, and set `version`."""
        raise NotImplementedError

    def ask(self, command: str, **parameters: Any) -> Any:
        """Send a command of the browser's protocol; return its result."""
        raise NotImplementedError

    def open(self, address: str) -> None:
        """Open a page."""
        self._heard += self.run(HEARD)
        self.ask("Navigate", url=address)

    def run(self, code: str) -> Any:
        """Evaluate an expression in the page, await it, and return its value."""
        # A driver's script has globals of its own, unlike the code of `eval`.
        return self.ask("ExecuteScript", script="return window.eval(arguments[0])", args=[code])

    def heard(self) -> list[str]:
        """Return errors and warnings since the last call; the pages begin with `LISTEN`."""
        found, self._heard = self._heard + self.run(HEARD), []
        return found

    def touch(self, fingers: list[list[tuple[int, int]]], kind: str = "touch") -> None:
        """Press, move and lift fingers, or the mouse.

        Args:
            fingers: The places of each, in pixels from the top left corner of the page.
            kind: "touch" or "mouse".
        """
        down, up = {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}
        moves = [
            [{"type": "pointerMove", "x": x, "y": y, "duration": 50} for x, y in places]
            for places in fingers
        ]
        actions = [
            {
                "type": "pointer", "id": f"{kind} {i}", "parameters": {"pointerType": kind},
                "actions": [first, down, *rest, up],
            }
            for i, (first, *rest) in enumerate(moves)
        ]  # fmt: skip
        self.ask("PerformActions", actions=actions)

    def close(self) -> None:
        """End the browser."""
        raise NotImplementedError


class Chromium(Browser):
    """Chromium, driven by its own protocol over two pipes."""

    NEEDS = (("chromium", "chromium-browser", "google-chrome", "chrome"),)

    def _start(self, programs: list[str], folder: Path, environment: dict[str, str]) -> None:
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        self._in, self._out = ours_in, ours_out

        def ready() -> None:  # Chromium reads from 3 and writes to 4
            high_in, high_out = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(high_in, 3)
            os.dup2(high_out, 4)

        options = [
            "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe",
            "--no-first-run", "--disable-dev-shm-usage", f"--window-size={WIDTH},{HEIGHT}",
            f"--user-data-dir={folder}", f"--crash-dumps-dir={folder}",
        ]  # fmt: skip
        self.process = subprocess.Popen(
            [*programs, *options], preexec_fn=ready, close_fds=False, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._number, self._left, self._session = 0, b"", None
        self.version = self.ask("Browser.getVersion")["product"].replace("Headless", "")
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command; return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def _next(self) -> dict[str, Any]:
        limit = time.monotonic() + PATIENCE
        while b"\0" not in self._left:
            ready, _, _ = select.select([self._in], [], [], limit - time.monotonic())
            assert ready, "Chromium does not answer"
            self._left += os.read(self._in, 1 << 20)
        message, _, self._left = self._left.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        reported = event.get("params", {})
        if event.get("method") == "Log.entryAdded" and reported["entry"]["level"] == "error":
            self._heard.append(f"{reported['entry']['text']} {reported['entry'].get('url', '')}")

    def open(self, address: str) -> None:
        """Open a page."""
        self._heard += self.run(HEARD)
        self.ask("Page.navigate", url=address)

    def run(self, code: str) -> Any:
        """Evaluate an expression in the page, await it, and return its value."""
        answer = self.ask(
            "Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def touch(self, fingers: list[list[tuple[int, int]]], kind: str = "touch") -> None:
        """Press, move and lift fingers, or the mouse."""
        if kind == "mouse":
            ((place, *_),) = fingers
            x, y = place
            for event in ("mousePressed", "mouseReleased"):
                self.ask(
                    "Input.dispatchMouseEvent", type=event, button="left", clickCount=1, x=x, y=y
                )
            return
        times = list(zip(*fingers, strict=True))
        for i, places in enumerate([*times, ()]):
            points = [{"x": x, "y": y} for x, y in places]
            event = ("touchEnd", "touchStart", "touchMove")[(i < len(times)) + (0 < i < len(times))]
            self.ask("Input.dispatchTouchEvent", type=event, touchPoints=points)

    def close(self) -> None:
        """End the browser."""
        try:
            self._session = None
            self.ask("Browser.close")
        finally:
            self.process.wait(timeout=20)
            os.close(self._in)
            os.close(self._out)


class Firefox(Browser):
    """Firefox, driven by Marionette, on which its WebDriver stands."""

    NEEDS = (("firefox", "firefox-esr"),)

    def _start(self, programs: list[str], folder: Path, environment: dict[str, str]) -> None:
        (folder / "user.js").write_text('user_pref("marionette.port", 0);\n', encoding="utf-8")
        size = {"MOZ_HEADLESS_WIDTH": str(WIDTH), "MOZ_HEADLESS_HEIGHT": str(HEIGHT)}
        self.process = subprocess.Popen(
            [*programs, "--headless", "--marionette", "--profile", str(folder), "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment | size,
        )  # fmt: skip
        port = folder / "MarionetteActivePort"
        address = "127.0.0.1", int(_awaited(lambda: port.exists() and port.read_text()))
        self._socket = socket.create_connection(address, PATIENCE)
        self._answers = self._socket.makefile("rb")
        self._number = 0
        self._next()
        found = self.ask("NewSession")["capabilities"]
        self.version = f"Firefox/{found['browserVersion']}"

    def _next(self) -> Any:
        size = b"".join(iter(lambda: self._answers.read(1), b":"))
        return json.loads(self._answers.read(int(size)))

    def ask(self, command: str, **parameters: Any) -> Any:
        """Send a command of the browser's protocol; return its result."""
        self._number += 1
        name = command if ":" in command else f"WebDriver:{command}"
        message = json.dumps([0, self._number, name, parameters]).encode()
        self._socket.sendall(b"%d:%b" % (len(message), message))
        _, _, error, result = self._next()
        assert error is None, error
        return result["value"] if "value" in result else result

    def close(self) -> None:
        """End the browser."""
        try:
            self.ask("Marionette:Quit", flags=["eForceQuit"])
        finally:
            self._answers.close()
            self._socket.close()
            self.process.wait(timeout=20)


class WebKit(Browser):
    """WebKitGTK's MiniBrowser on a screen without a display, driven by WebDriver."""

    NEEDS = (("WebKitWebDriver",), ("Xvfb",))
    PATHS: ClassVar = {
        "Navigate": "/url", "ExecuteScript": "/execute/sync", "PerformActions": "/actions",
    }  # fmt: skip

    def _start(self, programs: list[str], folder: Path, environment: dict[str, str]) -> None:
        driver, screen = programs
        read, write = os.pipe()
        self._screen = subprocess.Popen(
            [screen, "-displayfd", str(write), "-screen", "0", f"{WIDTH}x{HEIGHT}x24"],
            pass_fds=[write], stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(write)
        with os.fdopen(read) as displays:
            display = displays.readline().strip()
        with socket.socket() as unused:
            unused.bind(("127.0.0.1", 0))
            self._port = unused.getsockname()[1]
        # Without a GPU, buffers that a GPU would share cost nine frames of ten.
        environment |= {"DISPLAY": f":{display}", "WEBKIT_DISABLE_DMABUF_RENDERER": "1"}
        self._driver = subprocess.Popen([driver, f"--port={self._port}"], env=environment)
        self._session = ""
        _awaited(self._listens)
        made = self._request("POST", "/session", {"capabilities": {}})
        self._session = f"/session/{made['sessionId']}"
        self.version = f"WebKitGTK/{made['capabilities']['browserVersion']}"
        self._request("POST", f"{self._session}/window/rect", {"width": WIDTH, "height": HEIGHT})

    def _listens(self) -> bool:
        with socket.socket() as tried:
            return tried.connect_ex(("127.0.0.1", self._port)) == 0

    def _request(self, method: str, path: str, content: dict[str, Any] | None = None) -> Any:
        connection = HTTPConnection("127.0.0.1", self._port, timeout=PATIENCE)
        connection.request(method, path, None if content is None else json.dumps(content))
        answer = connection.getresponse()
        value = json.loads(answer.read())["value"]
        connection.close()
        assert answer.status == HTTPStatus.OK, value
        return value

    def ask(self, command: str, **parameters: Any) -> Any:
        """Send a command of the browser's protocol; return its result."""
        return self._request("POST", self._session + self.PATHS[command], parameters)

    def close(self) -> None:
        """End the browser."""
        try:
            self._request("DELETE", self._session)
        finally:
            for process in (self._driver, self._screen):
                process.terminate()
                process.wait(timeout=20)


BROWSERS: dict[str, type[Browser]] = {"chromium": Chromium, "firefox": Firefox, "webkit": WebKit}
