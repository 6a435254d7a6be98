"""A page that shows estimates as they come, served to browsers by this process."""

from __future__ import annotations

import hmac
import ipaddress
import json
import secrets
import socket
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

from steelyard.errors import InputError
from steelyard.live.record import Record

LOOPBACK = "127.0.0.1"
_MOST_CLIENTS = 8
"""Browsers that are told new estimates at the same time."""
_MOST_CONNECTIONS = 32
"""Of any kind at the same time; more are closed at once."""
_KEPT = 2_000
"""Estimates that a browser is told first: beyond that, every other old one is forgotten."""
_PATIENCE = 10.0
"""How long a browser may take to ask and to listen [s]."""
_SIGN = 5.0
"""After so long without an estimate, a browser is told that the process is still there [s]."""
_COOKIE = "steelyard"
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class History:
    """Lines that have come, for many who read them at their own pace; of bounded size."""

    def __init__(self, most: int = _KEPT) -> None:
        self._most = most
        self._lines: list[tuple[int, str]] = []
        self._number = 0
        self._changed = threading.Condition()
        self.ended = False
        """Whether nothing more will come."""

    def add(self, line: str) -> None:
        """Take one more; the newest quarter is kept whole."""
        with self._changed:
            self._number += 1
            self._lines.append((self._number, line))
            if len(self._lines) > self._most:
                old = len(self._lines) - self._most // 4
                self._lines = self._lines[:old:2] + self._lines[old:]
            self._changed.notify_all()

    def end(self) -> None:
        """Let all readers go."""
        with self._changed:
            self.ended = True
            self._changed.notify_all()

    def after(self, number: int, seconds: float) -> tuple[int, list[str]]:
        """Lines after one that has been read, waited for at most so long [s], and the number of the
        last.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._number > number or self.ended, seconds)
            return self._number, [line for own, line in self._lines if own > number]


class PageServer(ThreadingHTTPServer):
    """Of bounded threads; says nothing about those who go away."""

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._room = threading.BoundedSemaphore(_MOST_CONNECTIONS)
        super().__init__(address, handler)

    def process_request(self, request: object, client_address: object) -> None:
        """In a thread of its own, where there is room."""
        if not self._room.acquire(blocking=False):
            self.shutdown_request(request)  # type: ignore[arg-type]
            return
        super().process_request(request, client_address)  # type: ignore[arg-type]

    def process_request_thread(self, request: object, client_address: object) -> None:
        """Until the connection ends."""
        try:
            super().process_request_thread(request, client_address)  # type: ignore[arg-type]
        finally:
            self._room.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that goes away is no error of ours."""


class PageSink:
    """A page, and the estimates for it as server-sent events."""

    def __init__(
        self, html: str, policy: str, port: int, listen: str | None = None, kept: int = _KEPT
    ) -> None:
        """Serve it.

        Args:
            html: The page; it asks for ``events`` beside it.
            policy: Its Content-Security-Policy.
            port: 0: any that is free.
            listen: Address of this machine; None: the loopback address. For any other one a token
                is needed.
            kept: Estimates that a browser is told first.

        Raises:
            InputError: There is no such address, or the port is taken.
        """
        host = listen or LOOPBACK
        self.token = None if _is_loopback(host) else secrets.token_urlsafe(24)
        """What a browser has to know; None: nothing."""
        self._history = History(kept)
        handler = _handler(html.encode(), policy, self._history, self.token, _names_of(host))
        try:
            self._server = PageServer((host, port), handler)
        except OSError as error:
            raise InputError(
                f"--page: expected a free port and an address of this machine, found {host}:{port}"
                f" ({error.strerror or error}); choose another"
            ) from error
        own = f"[{host}]" if ":" in host else host
        self.url = f"http://{own}:{self._server.server_address[1]}/"
        """Where the page is; with the token, if there is one."""
        if self.token is not None:
            self.url += f"?token={self.token}"
        self._thread = threading.Thread(
            target=self._server.serve_forever,
            name="page",
            daemon=True,
            kwargs={"poll_interval": 0.1},
        )
        self._thread.start()

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        self._history.add(record.line)

    def close(self) -> None:
        """End the server."""
        self._history.end()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _names_of(host: str) -> Callable[[str], bool]:
    """Which names a browser may call this machine by: a page from elsewhere whose name was made to
    point here (DNS rebinding) calls it by that name.
    """
    loopback = _is_loopback(host)
    names = {"localhost", host.casefold()}
    if not loopback:
        names |= {socket.gethostname().casefold(), socket.getfqdn().casefold()}

    def known(name: str) -> bool:
        if name.casefold() in names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        # A number is no name that could be made to point anywhere.
        return address.is_loopback or not loopback

    return known


def _handler(
    html: bytes, policy: str, history: History, token: str | None, known: Callable[[str], bool]
) -> type[BaseHTTPRequestHandler]:
    """What answers to a browser: the page at ``/``, estimates at ``/events``, nothing else."""
    clients = threading.BoundedSemaphore(_MOST_CLIENTS)

    class Answer(BaseHTTPRequestHandler):
        timeout = _PATIENCE
        server_version = "steelyard"
        sys_version = ""

        def do_GET(self) -> None:
            parts = urlsplit(self.path)
            if not known(_host_of(self.headers.get("Host", ""))):
                self._refuse(HTTPStatus.MISDIRECTED_REQUEST)
            elif self.headers.get("Sec-Fetch-Site", "none") == "cross-site" and parts.path != "/":
                self._refuse(HTTPStatus.FORBIDDEN)
            elif (
                parts.path == "/" and token is not None and "token" in (q := parse_qs(parts.query))
            ):
                self._enter(q["token"][0])
            elif not self._may():
                self._refuse(HTTPStatus.UNAUTHORIZED)
            elif parts.path == "/":
                self._answer(HTTPStatus.OK, html, "text/html; charset=utf-8")
            elif parts.path == "/events":
                self._events()
            else:
                self._refuse(HTTPStatus.NOT_FOUND)

        def _may(self) -> bool:
            """Whether it has shown the token."""
            if token is None:
                return True
            wanted = f"{_COOKIE}={token}".encode()
            shown = self.headers.get("Cookie", "").split(";")
            return any(hmac.compare_digest(each.strip().encode(), wanted) for each in shown)

        def _enter(self, shown: str) -> None:
            """Exchange a token in the address for a cookie, so that no address holds it."""
            assert token is not None
            if not hmac.compare_digest(shown.encode(), token.encode()):
                self._refuse(HTTPStatus.UNAUTHORIZED)
                return
            self.send_response_only(HTTPStatus.SEE_OTHER)
            self._headers()
            self.send_header("Set-Cookie", f"{_COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict")
            self.send_header("Location", "/")
            self.send_header("Content-Length", "0")
            self.end_headers()

        def _events(self) -> None:
            """All estimates, and then each as it comes; a browser that is slow misses some."""
            if not clients.acquire(blocking=False):
                self._refuse(HTTPStatus.SERVICE_UNAVAILABLE)
                return
            try:
                self.send_response_only(HTTPStatus.OK)
                self._headers()
                self.send_header("Content-Type", "text/event-stream")
                self.end_headers()
                last = 0
                while True:
                    last, lines = history.after(last, _SIGN)
                    if lines:
                        text = f"event: estimates\ndata: [{','.join(lines)}]\n\n"
                    else:
                        text = f"event: sign\ndata: {json.dumps(round(time.time()))}\n\n"
                    self.wfile.write(text.encode())
                    if history.ended:
                        self.wfile.write(b"event: end\ndata: null\n\n")
                        return
            except OSError:
                pass
            finally:
                clients.release()

        def _refuse(self, status: HTTPStatus) -> None:
            self._answer(status, f"{status.value} {status.phrase}\n".encode(), "text/plain")

        def _answer(self, status: HTTPStatus, body: bytes, kind: str) -> None:
            self.send_response_only(status)
            self._headers()
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def _headers(self) -> None:
            for name, value in {**_HEADERS, "Content-Security-Policy": policy}.items():
                self.send_header(name, value)
            self.send_header("Connection", "close")
            self.close_connection = True

        def log_message(self, *_: object) -> None:
            """Nothing: addresses hold the token."""

    return Answer


def _host_of(header: str) -> str:
    """Name without the port."""
    if header.startswith("["):
        return header[1:].partition("]")[0]
    return header.partition(":")[0]
