"""The server of `rebar view`, on the loopback interface alone.

Python's own `http.server` does what is needed: one person looks, byte ranges and server-sent events are some lines each,
and a web framework would be an extra with a dozen packages for them.
"""

from __future__ import annotations

import hmac
import re
import secrets
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from bench.errors import RebarError

from ._content import LOOK_S, CampaignContent, Content, NotThere, document_text
from ._page import ICON, index_page, script

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    # The address of the first page holds the token.
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_RANGE = re.compile(r"bytes=(\d{1,18})-(\d{0,18})")
_BYTES = "application/octet-stream"
_PIECE_BYTES = 256 * 1024  # of a recording, sent at a time. Chosen: it fits into caches of processors


class ViewServer(ThreadingHTTPServer):
    """Serves one folder to whoever has the token; `address` is what to open. Port 0: the system chooses one."""

    daemon_threads = True

    def __init__(self, content: Content, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.content = content
        self.token, self.session = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        # Cookies know no ports: two servers of one machine would overwrite each other's.
        self.cookie_name = f"rebar-view-{self.server_port}"
        self.address = f"http://127.0.0.1:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves is no fault."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET, and nothing else."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "rebar-view", ""
    timeout = 60.0  # host seconds without a request, or without taking an answer. Chosen

    def log_message(self, *_: object) -> None:
        """Nothing: the address in a line would hold the token."""

    def do_GET(self) -> None:
        port = self.server.server_port
        # A page elsewhere whose name leads to this machine has another name in its requests.
        if self.headers.get("Host") not in (f"127.0.0.1:{port}", f"localhost:{port}"):
            return self._send(HTTPStatus.MISDIRECTED_REQUEST, "another host was asked for")
        url = urlsplit(self.path)
        query = {name: values[-1] for name, values in parse_qs(url.query).items()}
        if url.path == "/" and "token" in query:
            return self._exchange(query["token"])
        if not self._has_cookie():
            return self._send(HTTPStatus.FORBIDDEN, "open the address that rebar view printed")
        try:
            return self._answer(url.path, query)
        except NotThere:
            return self._send(HTTPStatus.NOT_FOUND, "this is not there")
        except RebarError as error:
            return self._send(HTTPStatus.CONFLICT, str(error))

    def _exchange(self, token: str) -> None:
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            return self._send(HTTPStatus.FORBIDDEN, "the token is another server's: open the newest address")
        cookie = f"{self.server.cookie_name}={self.server.session}; Path=/; HttpOnly; SameSite=Strict"
        return self._begin(HTTPStatus.SEE_OTHER, "text/plain", 0, Location="/", Set_Cookie=cookie)

    def _has_cookie(self) -> bool:
        expected = f"{self.server.cookie_name}={self.server.session}".encode()
        given = self.headers.get("Cookie", "").encode().split(b";")
        return any(hmac.compare_digest(part.strip(), expected) for part in given)

    def _answer(self, path: str, query: Mapping[str, str]) -> None:
        """Raises NotThere for a path that is none, and for a question about campaigns to the folder of a run."""
        content, name, condition = self.server.content, query.get("id", ""), query.get("where", "")
        if path == "/recording":
            return self._recording(name)
        if path == "/api/live" and isinstance(content, CampaignContent):
            return self._live(content)
        answers: dict[str, tuple[str, Callable[[], str]]] = {
            "/": ("text/html", lambda: index_page(f"REBAR: {content.root.name}")),
            "/app.js": ("text/javascript", script),
            "/icon.svg": ("image/svg+xml", lambda: ICON),
            "/api/summary": ("application/json", lambda: document_text(content.summary())),
            "/api/run": ("application/json", lambda: document_text(content.run(name))),
        }
        if isinstance(content, CampaignContent):
            answers["/api/runs"] = ("application/json", content.runs)
            answers["/api/where"] = ("application/json", lambda: document_text(content.where(condition)))
            answers["/api/runs.csv"] = ("text/csv", lambda: content.csv(condition))
        if path not in answers:
            raise NotThere
        return self._send(HTTPStatus.OK, answers[path][1](), answers[path][0])

    def _begin(self, status: HTTPStatus, kind: str, length: int | None, **more: str) -> None:
        """The head of an answer; without a length it ends with the connection."""
        self.send_response(status)
        more |= {"Connection": "close"} if length is None else {"Content-Length": str(length)}
        for name, value in (_HEADERS | {"Content-Type": kind} | more).items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()

    def _send(self, status: HTTPStatus, text: str, kind: str = "text/plain") -> None:
        data = text.encode("utf-8", "replace")
        self._begin(status, f"{kind}; charset=utf-8", len(data))
        self.wfile.write(data)

    def _recording(self, name: str) -> None:
        """The file, or the bytes that `Range` asks for. It may grow meanwhile: the size is that of now."""
        with self.server.content.recording(name).open("rb") as file:
            size = file.seek(0, 2)
            # Of nothing no range can be had.
            asked = _RANGE.fullmatch(self.headers.get("Range", "")) if size else None
            first, last = (int(asked[1]), min(int(asked[2] or size), size - 1)) if asked else (0, size - 1)
            if first > last and asked:
                status = HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE
                return self._begin(status, _BYTES, 0, Content_Range=f"bytes */{size}")
            status = HTTPStatus.PARTIAL_CONTENT if asked else HTTPStatus.OK
            more = {"Content_Range": f"bytes {first}-{last}/{size}"} if asked else {}
            self._begin(status, _BYTES, last + 1 - first, **more)
            file.seek(first)
            left = last + 1 - first
            while left and (piece := file.read(min(left, _PIECE_BYTES))):
                self.wfile.write(piece)
                left -= len(piece)
            # A recording that was written anew meanwhile: the browser must not wait for the rest.
            self.close_connection = self.close_connection or left > 0
        return None

    def _live(self, content: CampaignContent) -> None:
        """An event for each change of the campaign's state, until the browser goes away."""
        shown, text = "", document_text(content.live())
        self._begin(HTTPStatus.OK, "text/event-stream", None)
        self.close_connection = True
        while True:
            # A comment where nothing has changed: that a browser has gone is noticed when something is sent to it.
            self.wfile.write(b":\n\n" if text == shown else f"data: {text}\n\n".encode())
            time.sleep(LOOK_S)
            shown = text
            with suppress(RebarError):
                text = document_text(content.live())
