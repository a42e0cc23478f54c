"""The server of the page, from the standard library: on this machine alone, and only for who has the address with its token.

Every request must come to the loopback address and bear the token in its path; a request of a page from elsewhere is refused by its `Host` or its `Origin`,
so that neither another site in the same browser nor a name that is bound to 127.0.0.1 can ask. What the page sends is data: names are looked up among those
that there are, numbers are checked as everywhere, and nothing becomes a path or code.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from hmac import compare_digest
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from toolbox.errors import SceneError, SimulationError
from toolbox.messages import LOG

FILES = {
    "": ("index.html", "text/html; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "drawing.js": ("drawing.js", "text/javascript; charset=utf-8"),
    "uPlot.js": ("uPlot.iife.min.js", "text/javascript; charset=utf-8"),
    "uPlot.css": ("uPlot.min.css", "text/css; charset=utf-8"),
}
"""{what the page asks for: (file of the package, its type)}; there are no others."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self' http://localhost:* http://127.0.0.1:* https://localhost:* vscode-webview:"
)

LONGEST = 256 * 1024
"""Bytes that a request may have."""

PORTS = 20
"""Ports that are tried, one after the other, before the system gives one."""


HALF_OPEN = 32
"""Connections that may wait without having shown the token: one more ends the oldest of them, so that nobody can keep the user out."""

UNANSWERED = "The page cannot answer this question; the log says why."


class Server(ThreadingHTTPServer):
    """Server of a page. answer: function (path, data from the page) -> reply, or an iterator of replies, which are sent singly."""

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, answer: Callable[[str, Any], Any], port: int):
        self.answer, self.token = answer, secrets.token_urlsafe(24)
        self._strangers: dict[Any, None] = {}
        self._lock = threading.Lock()
        super().__init__(("127.0.0.1", _free(port)), Handler)

    @property
    def address(self) -> str:
        """Where the page is, with its token."""
        return f"http://127.0.0.1:{self.server_address[1]}/{self.token}/"

    @property
    def hosts(self) -> tuple[str, ...]:
        """What the header `Host` may be."""
        port = self.server_address[1]
        return f"127.0.0.1:{port}", f"localhost:{port}"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin a connection. If too many connections have not shown the token, the oldest of these is ended."""
        with self._lock:
            self._strangers[request] = None
            oldest = next(iter(self._strangers)) if len(self._strangers) > HALF_OPEN else None
            if oldest is not None:
                del self._strangers[oldest]
                with contextlib.suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def let_in(self, request: Any) -> None:
        """Count a connection as a connection of the user from now on."""
        with self._lock:
            self._strangers.pop(request, None)

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        self.let_in(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that went away."""
        LOG.debug("a request ended early", exc_info=True)


class Handler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "stickslip", ""
    server: Server
    timeout = 120
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Give a file of the page."""
        name = self._allowed()
        if name is None:
            return
        if name not in FILES:
            self._refuse(404, "There is no such file.")
            return
        file, kind = FILES[name]
        self._send(200, kind, files("toolbox.page").joinpath("web", file).read_bytes())

    def do_POST(self) -> None:
        """Answer a question of the page."""
        name = self._allowed()
        if name is None:
            return
        origin, length = self.headers.get("Origin"), self.headers.get("Content-Length", "")
        if origin is None or origin not in [f"http://{host}" for host in self.server.hosts]:
            self._refuse(403, "The request comes from another page.")
            return
        if not length.isdecimal() or int(length) > LONGEST:
            self._refuse(413, "The request is too long, or does not say how long it is.")
            return
        body = self.rfile.read(int(length))
        try:
            asked = json.loads(body)
        except (ValueError, RecursionError):
            self._refuse(400, "The request is no JSON.")
            return
        try:
            found = _body(self.server.answer(name, asked))
        except LookupError:
            self._refuse(404, "There is no such question.")
            return
        except (SceneError, SimulationError) as refusal:
            found = _body({"error": str(refusal)})
        except Exception:
            LOG.exception("a question of the page failed")
            self._refuse(500, UNANSWERED)
            return
        if isinstance(found, Iterator):
            self._stream(found)
        else:
            self._send(200, *found)

    def _allowed(self) -> str | None:
        """What is asked for behind the token; None, with an answer, for who may not ask."""
        if self.headers.get("Host") not in self.server.hosts:
            self._refuse(403, "This page is served to this computer alone.")
            return None
        _, token, *rest = (self.path.partition("?")[0] + "/").split("/", 2)
        if not compare_digest(token.encode("utf-8", "replace"), self.server.token.encode()):
            self._refuse(403, "The address lacks its token: open the one that was printed.")
            return None
        self.server.let_in(self.connection)
        return rest[0].removesuffix("/") if rest else ""

    def _headers(self, status: int, kind: str) -> None:
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind), ("Cache-Control", "no-store"), ("Content-Security-Policy", POLICY), ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"), ("Cross-Origin-Resource-Policy", "same-origin"),
        ):  # fmt: skip
            self.send_header(name, value)

    def _send(self, status: int, kind: str, body: bytes) -> None:
        self._headers(status, kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _stream(self, found: Iterator[Any]) -> None:
        """One line of JSON after the other, until there is no more or the browser has gone."""
        self._headers(200, "application/x-ndjson")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        for line in _lines(found):
            self.wfile.write(line)
            self.wfile.flush()

    def _refuse(self, status: int, why: str) -> None:
        self.close_connection = True
        self._headers(status, "text/plain; charset=utf-8")
        body = why.encode()
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing of every request."""


def _body(found: Any) -> Any:
    """(type, bytes) of an answer; one that comes piece by piece as it is."""
    if isinstance(found, Iterator):
        return found
    if isinstance(found, bytes):
        return "application/octet-stream", found
    return "application/json", json.dumps(found, allow_nan=False).encode()


def _lines(found: Iterator[Any]) -> Iterator[bytes]:
    """The pieces of an answer, each as a line of JSON; the last one is an error if the next one fails."""
    try:
        for each in found:
            yield json.dumps(each, allow_nan=False).encode() + b"\n"
    except Exception:
        LOG.exception("a question of the page failed")
        yield json.dumps({"error": UNANSWERED}).encode() + b"\n"


def _free(port: int) -> int:
    """The port, or one of the next that nobody has, or 0, for which the system gives one."""
    for candidate in range(port, min(port + PORTS, 65_536)) if port else ():
        with socket.socket() as tried:
            try:
                tried.bind(("127.0.0.1", candidate))
            except OSError:
                continue
            return candidate
    return 0


def in_background(server: Server, warm: Callable[[], None]) -> threading.Thread:
    """Serve in a thread that ends with the process, and prepare the first answers in another thread, which is returned."""
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.2}, name="page", daemon=True).start()
    warming = threading.Thread(target=warm, name="page-warm", daemon=True)
    warming.start()
    return warming
