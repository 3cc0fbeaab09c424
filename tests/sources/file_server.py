"""A server of a folder as HTTP wants it, and what servers and networks do to it, by a plan.

    server = FileServer(folder, plan=at_random(seed=3, rate=0.3))
    with server.listening() as base:
        downloader.file(f"{base}/archive.zip")
    assert server.bytes_sent < ...

Nothing listens to the outside; waits are as short as the test asks.
"""

import contextlib
import mimetypes
import random
import ssl
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from urllib.parse import unquote, urlsplit

from tests.pipeline.http_faults import reset, serving

STATUSES = ("403", "404", "429", "500", "503")  # 429 says when to come back
FAULTS = (
    *STATUSES,
    "reset",  # no answer
    "cut",  # reset in the middle of the body
    "short",  # closed in the middle of the body, as if that were its end
    "stall",  # nothing more comes from the middle of the body on
    "slow",  # all comes, a little at a time
    "wrong",  # one byte is another
    "truncated",  # the answer is a whole one of the file's beginning
    "changed",  # the answer is of another version of the file, and says so
    "chunked",  # no length is told
    "moved",  # redirected to where the file is
    "loop",  # redirected without end
)
HARMLESS = ("slow", "chunked", "moved")
Plan = Callable[[str], str]  # from the path of a request to what happens to it, "" for nothing


def no_faults(path: str) -> str:
    return ""


def redirection(target: str, kind: str) -> str:
    """Where a request is sent that is "moved" or in a "loop"."""
    return f"{target.partition('?loop')[0]}?{kind}"


def scripted(*kinds: str) -> Plan:
    """One after another for one request after another, then none."""
    left = list(kinds)

    def plan(path: str) -> str:
        return left.pop(0) if left else ""

    return plan


def at_random(seed: int, rate: float, kinds: tuple[str, ...] = FAULTS) -> Plan:
    """A share `rate` of the requests."""
    chance = random.Random(seed)
    return lambda path: chance.choice(kinds) if chance.random() < rate else ""


@dataclass
class FileServer:
    """What is served and what was asked for.

    Parameters
    ----------
    folder
        Files by their paths.
    documents
        Further contents by path and query, such as ``"/models?page=2"``; they come before files.
    plan
        What happens to each request.
    seed
        Of where bodies are cut.
    headers
        Added to each answer with content; an empty one leaves out what would be sent.
    retry_after
        What a 429 says.
    drip_s
        Wait between the pieces of a slow body.
    tls
        With which it speaks https.
    """

    folder: Path
    documents: dict[str, bytes] = field(default_factory=dict)
    plan: Plan = no_faults
    seed: int = 0
    headers: dict[str, str] = field(default_factory=dict)
    retry_after: str = "0"
    drip_s: float = 0.002
    tls: ssl.SSLContext | None = None
    requests: list[tuple[str, str, dict[str, str]]] = field(default_factory=list)  # method, target, headers
    faults: Counter[str] = field(default_factory=Counter)
    bytes_sent: int = 0  # of bodies with content

    def __post_init__(self) -> None:
        self.lock = threading.Lock()
        self.chance = random.Random(self.seed)
        self.closing = threading.Event()
        self.when_sent: Callable[[int], object] = lambda count: None  # told `bytes_sent` as they grow

    @contextlib.contextmanager
    def listening(self) -> Iterator[str]:
        """Yield the server's address, without a slash at its end."""
        self.closing.clear()
        with serving(type("Handler", (_Handler,), {"files": self})) as address:
            try:
                yield address if self.tls is None else address.replace("http:", "https:")
            finally:
                self.closing.set()

    def fault(self, method: str, target: str, headers: dict[str, str]) -> str:
        with self.lock:
            self.requests.append((method, target, headers))
            if urlsplit(target).query in ("moved", "loop"):
                kind = "loop" if target.endswith("?loop") else ""
            else:
                kind = self.plan(urlsplit(target).path)
                self.faults.update([kind] if kind else [])
            return kind

    def content(self, target: str) -> tuple[bytes, float] | None:
        """What is at an address, and its time; None where nothing is."""
        target = target.removesuffix("?moved")
        if target in self.documents:
            return self.documents[target], 0.0
        path = (self.folder / unquote(urlsplit(target).path).lstrip("/")).resolve()
        if not path.is_relative_to(self.folder.resolve()) or not path.is_file():
            return None
        return path.read_bytes(), path.stat().st_mtime

    def cut(self, length: int) -> int:
        with self.lock:
            return self.chance.randrange(max(1, length))

    def sends(self, count: int) -> int:
        """Count what is about to be sent: once it is, a client may look at the count."""
        with self.lock:
            self.bytes_sent += count
            return self.bytes_sent


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    files: FileServer

    def log_message(self, *_: object) -> None:
        pass

    def setup(self) -> None:
        if self.files.tls is not None:
            self.request = self.files.tls.wrap_socket(self.request, server_side=True)
        super().setup()

    def do_GET(self) -> None:
        kind = self.files.fault(self.command, self.path, {k.lower(): v for k, v in self.headers.items()})
        if kind == "reset":
            return reset(self)
        if kind in STATUSES:
            return self.say(int(kind), {"Retry-After": self.files.retry_after} if kind == "429" else {})
        if kind in ("moved", "loop"):
            return self.say(302, {"Location": redirection(self.path, kind)})
        document = self.files.content(self.path)
        if document is None:
            return self.say(404, {})
        return self.give(*document, kind)

    do_HEAD = do_GET

    def say(self, status: int, headers: dict[str, str]) -> None:
        """Answer without content of a file."""
        text = b"<html>by the server</html>"
        self.send_response(status)
        for name, value in {"Content-Type": "text/html", "Content-Length": str(len(text)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(text)

    def give(self, content: bytes, modified: float, kind: str) -> None:
        if kind == "changed":
            content, modified = content[::-1] + b"changed", modified + 3600
        headers = {
            "Content-Type": mimetypes.guess_type(self.path)[0] or "application/octet-stream",
            "Last-Modified": formatdate(modified, usegmt=True),
        }
        headers = {name: value for name, value in {**headers, **self.files.headers}.items() if value}
        body = content
        if kind == "wrong" and body:
            place = self.files.cut(len(body))
            body = body[:place] + bytes([body[place] ^ 1]) + body[place + 1 :]
        if kind == "truncated":
            body = body[: self.files.cut(len(body))]
        self.send_response(200)
        headers |= (
            {"Transfer-Encoding": "chunked"} if kind == "chunked" else {"Content-Length": str(len(body))}
        )
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            with contextlib.suppress(ConnectionError):  # a client may go away
                self.send(body, kind)

    def send(self, body: bytes, kind: str) -> None:
        stop = self.files.cut(len(body)) if kind in ("cut", "short", "stall") else len(body)
        piece = max(1, len(body) // 8) if kind == "slow" else 64 << 10
        for place in range(0, stop, piece):
            block = body[place : min(stop, place + piece)]
            total = self.files.sends(len(block))
            self.wfile.write(b"%x\r\n%b\r\n" % (len(block), block) if kind == "chunked" else block)
            self.wfile.flush()
            self.files.when_sent(total)
            if kind == "slow":
                self.files.closing.wait(self.files.drip_s)
        if kind == "chunked":
            self.wfile.write(b"0\r\n\r\n")
        elif kind == "cut":
            reset(self)
        elif kind == "short":
            self.close_connection = True
        elif kind == "stall":
            self.wait_until_left()

    def wait_until_left(self) -> None:
        """Send nothing more, until the client goes away or the server ends."""
        self.connection.settimeout(0.05)
        self.close_connection = True
        while not self.files.closing.is_set():
            try:
                if not self.connection.recv(1):
                    return
            except TimeoutError:
                continue
