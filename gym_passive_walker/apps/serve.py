"""A server of one page, for browsers on this machine."""

from __future__ import annotations

import math
import os
import sys
import threading
import time
import webbrowser
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import PurePosixPath
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import unquote, urlsplit

# Fixed here: the tables of some systems have other types for scripts, which browsers refuse.
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".wasm": "application/wasm",
}
_LONGEST_WAIT = 0.5  # s for a request: on Windows Ctrl-C acts only between two waits
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


class PageServer(ThreadingTCPServer):
    """Serves files from memory at a free port of 127.0.0.1.

    Args:
        files: Contents of the files by their paths; "index.html" is the page.
    """

    daemon_threads = True

    def __init__(self, files: Mapping[str, bytes]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = files

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://127.0.0.1:{self.server_address[1]}/"

    def serve(self, seconds: float | None = None) -> None:
        """Open the page in the user's browser, answer requests, and close.

        Without a display no browser is opened, unless $BROWSER names one.

        Args:
            seconds: Time in seconds; None is until Ctrl-C.

        Raises:
            KeyboardInterrupt: after Ctrl-C.
        """
        end = math.inf if seconds is None else time.monotonic() + seconds
        with self:
            if sys.platform in ("win32", "darwin") or any(map(os.environ.get, _DISPLAYS)):
                # Some browsers return only when they are closed.
                threading.Thread(target=webbrowser.open, args=(self.address,), daemon=True).start()
            while (left := end - time.monotonic()) > 0.0:
                self.timeout = min(left, _LONGEST_WAIT)
                self.handle_request()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore that a browser closed a connection early; report other errors."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: PageServer

    def do_GET(self) -> None:
        name = unquote(urlsplit(self.path).path).removeprefix("/") or "index.html"
        if name not in self.server.files:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        content = self.server.files[name]
        self.send_response(HTTPStatus.OK)
        kind = _TYPES.get(PurePosixPath(name).suffix, "application/octet-stream")
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")  # the next page may have the same port
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing."""
