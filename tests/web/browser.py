"""A headless Chromium, driven by Chromium's own protocol over two pipes, and a server of pages."""

from __future__ import annotations

import json
import os
import select
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any


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


class Browser:
    """One tab of a headless Chromium.

    Args:
        program: Path of Chromium.
        folder: Folder of its profile.

    Attributes:
        said: Messages of errors and warnings of the console, and uncaught exceptions.
    """

    def __init__(self, program: str, folder: Path) -> None:
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        self._in, self._out = ours_in, ours_out

        def ready() -> None:  # Chromium reads from 3 and writes to 4
            high_in, high_out = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(high_in, 3)
            os.dup2(high_out, 4)

        options = [
            "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe",
            "--no-first-run", "--disable-dev-shm-usage", "--window-size=1000,1400",
            f"--user-data-dir={folder}", f"--crash-dumps-dir={folder}",
        ]  # fmt: skip
        environment = {**os.environ, "HOME": str(folder), "TMPDIR": str(folder)}
        self.process = subprocess.Popen(
            [program, *options], preexec_fn=ready, close_fds=False, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._number, self._left, self._session = 0, b"", None
        self.said: list[str] = []
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
        limit = time.monotonic() + 60.0
        while b"\0" not in self._left:
            ready, _, _ = select.select([self._in], [], [], limit - time.monotonic())
            assert ready, "Chromium does not answer"
            self._left += os.read(self._in, 1 << 20)
        message, _, self._left = self._left.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        reported = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.said.append(str(reported["exceptionDetails"].get("exception", reported)))
        if event.get("method") == "Runtime.consoleAPICalled" and reported["type"] in (
            "error",
            "warning",
        ):
            self.said.append(str(reported["args"]))
        if event.get("method") == "Log.entryAdded" and reported["entry"]["level"] == "error":
            self.said.append(f"{reported['entry']['text']} {reported['entry'].get('url', '')}")

    def open(self, address: str) -> None:
        """Open a page."""
        self.ask("Page.navigate", url=address)

    def run(self, code: str) -> Any:
        """Evaluate an expression in the page, await it, and return its value."""
        answer = self.ask(
            "Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def close(self) -> None:
        """End Chromium."""
        try:
            self._session = None
            self.ask("Browser.close")
        finally:
            self.process.wait(timeout=20)
            os.close(self._in)
            os.close(self._out)
