"""An HTTP proxy that does to requests what networks and servers do to them, at random by a seed."""

import contextlib
import http.client
import random
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

KINDS = (
    "500",  # not done
    "503",
    "500 after",  # done, and said not to be
    "late",  # done, but the answer comes after the client gave up
    "reset",
    "reset after",  # done, and the answer lost
    "request cut",
    "answer cut",
)
BODIES = {"403": "AccessDenied", "500": "InternalError", "503": "SlowDown"}
HOP = {"connection", "keep-alive", "transfer-encoding", "content-length"}


class Proxy:
    """What passes between clients and the server at `upstream`.

    Parameters
    ----------
    upstream
        Address of the server.
    rate
        Share of requests that something happens to.
    seed
        Of the random choices.
    late_s
        How long an answer that is late takes.
    kinds
        What may happen.
    """

    def __init__(
        self,
        upstream: str,
        rate: float = 0.0,
        seed: int = 0,
        late_s: float = 2.0,
        kinds: tuple[str, ...] = KINDS,
    ) -> None:
        self.host = urlsplit(upstream).netloc
        self.rate = rate
        self.late_s = late_s
        self.kinds = kinds
        self.requests: Counter[str] = Counter()  # by method
        self.faults: Counter[str] = Counter()  # by kind
        self.paths: list[tuple[str, str]] = []  # method and path, as they came
        self.bytes_up = self.bytes_down = 0
        self.refuse = False  # as a server that is down
        self.outage = range(0)  # numbers of the requests during which it is down
        self.refusals = 0
        self.after_fault: Callable[[], object] = lambda: None
        self.refused: Callable[[], object] = lambda: None
        self._chance = random.Random(seed)
        self._lock = threading.Lock()

    def refuses(self) -> bool:
        with self._lock:
            down = self.refuse or self.refusals + sum(self.requests.values()) in self.outage
            self.refusals += down
            return down

    def fault(self, method: str, path: str) -> str:
        with self._lock:
            self.requests[method] += 1
            self.paths.append((method, path))
            kind = self._chance.choice(self.kinds) if self._chance.random() < self.rate else ""
            if kind:
                self.faults[kind] += 1
                self.after_fault()
            return kind

    def cut(self, length: int) -> int:
        with self._lock:
            return self._chance.randrange(max(1, length))

    def passed(self, up: int, down: int) -> None:
        with self._lock:
            self.bytes_up += up
            self.bytes_down += down


@contextlib.contextmanager
def standing_before(proxy: Proxy) -> Iterator[str]:
    """Yield the address of the proxy while it serves."""
    with serving(type("Handler", (_Handler,), {"proxy": proxy})) as address:
        yield address


@contextlib.contextmanager
def serving(handler: type[BaseHTTPRequestHandler]) -> Iterator[str]:
    """Yield the address at which a handler answers, each connection in a thread of its own."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    server.handle_error = lambda *_: None  # clients that hang up are what this is about
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def reset(handler: BaseHTTPRequestHandler) -> None:
    """End a connection as a machine that crashes does: what is on its way is lost."""
    handler.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    handler.close_connection = True
    handler.connection.close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    proxy: Proxy

    def log_message(self, *_: object) -> None:
        pass

    def pass_on(self) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(length)  # "Expect: 100-continue" was answered before
        if self.proxy.refuses():
            self.proxy.refused()
            return reset(self)
        kind = self.proxy.fault(self.command, self.path)
        if kind in BODIES:
            return self.fail(kind)
        if kind == "reset":
            return reset(self)
        if kind == "request cut":
            self.ask(body[: self.proxy.cut(length)])
            return reset(self)
        status, headers, answer = self.ask(body)
        self.proxy.passed(length, len(answer))
        if kind == "500 after":
            return self.fail("500")
        if kind == "reset after":
            return reset(self)
        if kind == "late":
            time.sleep(self.proxy.late_s)
            return reset(self)
        cut = self.proxy.cut(len(answer)) if kind == "answer cut" else len(answer)
        self.answer(status, headers, answer, cut)
        return None

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = pass_on

    def ask(self, body: bytes) -> tuple[int, list[tuple[str, str]], bytes]:
        """Pass the request on with as much of its body as there is, and return the answer."""
        connection = http.client.HTTPConnection(self.proxy.host, timeout=60)
        whole = len(body) == int(self.headers.get("Content-Length") or 0)
        try:
            connection.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
            for name, value in self.headers.items():
                if name.lower() not in ("connection", "expect"):
                    connection.putheader(name, value)
            connection.endheaders()
            connection.send(body)
            if not whole:
                return 0, [], b""
            answer = connection.getresponse()
            content = answer.read()
            self.length = answer.getheader("Content-Length") or str(len(content))
            return answer.status, answer.getheaders(), content
        finally:
            connection.close()

    def answer(self, status: int, headers: list[tuple[str, str]], content: bytes, cut: int) -> None:
        self.send_response_only(status)
        for name, value in headers:
            if name.lower() not in HOP:
                self.send_header(name, value)
        if status != 204:
            self.send_header("Content-Length", self.length if self.command == "HEAD" else str(len(content)))
        self.end_headers()
        self.wfile.write(content[:cut])
        if cut < len(content):
            self.wfile.flush()
            self.close_connection = True

    def fail(self, kind: str) -> None:
        text = f"<Error><Code>{BODIES[kind]}</Code><Message>by the proxy</Message></Error>".encode()
        self.length = str(len(text))
        content = b"" if self.command == "HEAD" else text
        self.answer(int(kind), [("Content-Type", "application/xml")], content, len(text))
