"""The server of `rebar view`, on the loopback interface alone.

Python's own `http.server` does what is needed: one person looks, byte ranges and server-sent events are some lines each,
and an extra with a web framework would bring a dozen packages for them.
"""

from __future__ import annotations

import hmac
import re
import secrets
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from bench.errors import RebarError

from ._content import LOOK_S, Content, NotThere, document_text
from ._page import ICON, index_page, script

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    # The address of the first page holds the token.
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_RANGE = re.compile(r"bytes=(\d{1,18})-(\d{0,18})")
# Of a recording that is sent at a time. Chosen: it fits into caches of processors.
_PIECE_BYTES = 256 * 1024
# Host seconds: a client that has gone is noticed when something is sent to it.
_SIGN_OF_LIFE_S = 10.0
_IDLE_S = 60.0
Query = Mapping[str, str]


class ViewServer(ThreadingHTTPServer):
    """Serves one folder to whoever has the token; `address` is what to open. Port 0: the system chooses one."""

    daemon_threads = True
    # A browser opens six connections at once, and several pages may.
    request_queue_size = 64

    def __init__(self, content: Content, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.content = content
        self.token, self.session = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self.ended = threading.Event()

    @property
    def address(self) -> str:
        """With the token. Opening it gives the browser its cookie."""
        return f"http://127.0.0.1:{self.server_port}/?token={self.token}"

    @property
    def cookie_name(self) -> str:
        """Cookies know no ports: two servers of one machine would overwrite each other's."""
        return f"rebar-view-{self.server_port}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves is no fault."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)

    def shutdown(self) -> None:
        self.ended.set()
        super().shutdown()


class _Handler(BaseHTTPRequestHandler):
    """Answers GET, and nothing else."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "rebar-view", ""
    timeout = _IDLE_S

    def do_GET(self) -> None:
        # A browser that goes on to another page leaves at any moment.
        with suppress(ConnectionError, TimeoutError):
            self._answer()

    def log_message(self, *_: object) -> None:
        """Nothing: the address in a line would hold the token."""

    def _answer(self) -> None:
        port = self.server.server_port
        # A page elsewhere whose name leads to this machine has another name in its requests.
        if self.headers.get("Host") not in (f"127.0.0.1:{port}", f"localhost:{port}"):
            return self._send_text(HTTPStatus.MISDIRECTED_REQUEST, "another host was asked for")
        url = urlsplit(self.path)
        query = {name: values[-1] for name, values in parse_qs(url.query).items()}
        if url.path == "/" and "token" in query:
            return self._exchange(query["token"])
        if not self._has_cookie():
            return self._send_text(HTTPStatus.FORBIDDEN, "open the address that rebar view printed")
        route = _ROUTES.get(url.path)
        if route is None:
            return self._send_text(HTTPStatus.NOT_FOUND, "there is no such page")
        try:
            return route(self, query)
        except NotThere:
            return self._send_text(HTTPStatus.NOT_FOUND, "the folder does not hold this")
        except RebarError as error:
            return self._send_text(HTTPStatus.CONFLICT, str(error))

    def _exchange(self, token: str) -> None:
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            return self._send_text(
                HTTPStatus.FORBIDDEN, "the token is another server's: open the newest address"
            )
        cookie = f"{self.server.cookie_name}={self.server.session}; Path=/; HttpOnly; SameSite=Strict"
        self._begin(HTTPStatus.SEE_OTHER, "text/plain", 0, {"Location": "/", "Set-Cookie": cookie})
        return None

    def _has_cookie(self) -> bool:
        cookies: SimpleCookie = SimpleCookie()
        with suppress(CookieError):
            cookies.load(self.headers.get("Cookie", ""))
        given = cookies.get(self.server.cookie_name)
        return given is not None and hmac.compare_digest(given.value.encode(), self.server.session.encode())

    def _begin(self, status: HTTPStatus, kind: str, length: int | None, more: Mapping[str, str] = {}) -> None:
        self.send_response(status)
        for name, value in (_HEADERS | {"Content-Type": kind} | dict(more)).items():
            self.send_header(name, value)
        if length is None:
            self.send_header("Connection", "close")
        else:
            self.send_header("Content-Length", str(length))
        self.end_headers()

    def _send_text(self, status: HTTPStatus, text: str, kind: str = "text/plain", **more: str) -> None:
        data = text.encode("utf-8", "replace")
        self._begin(
            status,
            f"{kind}; charset=utf-8",
            len(data),
            {key.replace("_", "-"): text for key, text in more.items()},
        )
        self.wfile.write(data)

    def _send_document(self, document: object) -> None:
        self._send_text(HTTPStatus.OK, document_text(document), "application/json")

    def _index(self, query: Query) -> None:
        self._send_text(HTTPStatus.OK, index_page(f"REBAR: {self.server.content.root.name}"), "text/html")

    def _script(self, query: Query) -> None:
        self._send_text(HTTPStatus.OK, script(), "text/javascript")

    def _csv(self, query: Query) -> None:
        text = self.server.content.csv(query.get("where", ""))
        self._send_text(
            HTTPStatus.OK, text, "text/csv", Content_Disposition='attachment; filename="runs.csv"'
        )

    def _recording(self, query: Query) -> None:
        """The file, or the bytes that `Range` asks for. It may grow meanwhile: the size is that of now."""
        path = self.server.content.recording(query.get("id", ""))
        with path.open("rb") as file:
            size = path.stat().st_size
            # Of nothing no range can be had.
            asked = _RANGE.fullmatch(self.headers.get("Range", "")) if size else None
            first, last = (int(asked[1]), int(asked[2] or size - 1)) if asked else (0, size - 1)
            last = min(last, size - 1)
            if asked and first > last:
                empty = {"Content-Range": f"bytes */{size}"}
                return self._begin(
                    HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, "application/octet-stream", 0, empty
                )
            status = HTTPStatus.PARTIAL_CONTENT if asked else HTTPStatus.OK
            more = (
                {"Accept-Ranges": "bytes", "Content-Range": f"bytes {first}-{last}/{size}"} if asked else {}
            )
            self._begin(status, "application/octet-stream", last + 1 - first, more)
            file.seek(first)
            left = last + 1 - first
            while left and (piece := file.read(min(left, _PIECE_BYTES))):
                self.wfile.write(piece)
                left -= len(piece)
            # A recording that was written anew meanwhile: the browser must not wait for the rest.
            self.close_connection = self.close_connection or left > 0
        return None

    def _live(self, query: Query) -> None:
        """An event for each change of the campaign's state, until the browser goes away."""
        content, shown, last_s = self.server.content, "", time.monotonic()
        text = document_text(content.live())
        self._begin(HTTPStatus.OK, "text/event-stream", None)
        self.close_connection = True
        while not self.server.ended.is_set():
            if text != shown or time.monotonic() - last_s > _SIGN_OF_LIFE_S:
                self.wfile.write((f"data: {text}\n\n" if text != shown else ": here\n\n").encode())
                shown, last_s = text, time.monotonic()
            self.server.ended.wait(LOOK_S)
            with suppress(RebarError):
                text = document_text(content.live())


_ROUTES: Mapping[str, Callable[[_Handler, Query], None]] = {
    "/": _Handler._index,
    "/app.js": _Handler._script,
    "/icon.svg": lambda handler, query: handler._send_text(HTTPStatus.OK, ICON, "image/svg+xml"),
    "/api/summary": lambda handler, query: handler._send_document(handler.server.content.summary()),
    "/api/runs": lambda handler, query: handler._send_document(handler.server.content.runs()),
    "/api/where": lambda handler, query: handler._send_document(
        handler.server.content.where(query.get("c", ""))
    ),
    "/api/run": lambda handler, query: handler._send_document(
        handler.server.content.run(query.get("id", ""))
    ),
    "/api/runs.csv": _Handler._csv,
    "/api/live": _Handler._live,
    "/recording": _Handler._recording,
}
