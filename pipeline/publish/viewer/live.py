"""A page and what answers it, served to the browser of this machine; and the page of Object Files.

It listens on 127.0.0.1. Requests under any other name of host are refused, so that no page of the web
reaches it through a name that points here, and so are those that another page's script sends. The address
has a token, which every question must bring: other people may be at work on the machine.
Nothing is read from disk by a path that a request names.
"""

import asyncio
import contextlib
import hmac
import json
import os
import secrets
import signal
import threading
import webbrowser
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits
from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.publish.viewer.live_queries import Answer, LiveObjects
from pipeline.publish.viewer.static import PAGE, object_files_of

ADDRESS = "127.0.0.1"
LARGEST_REQUEST = 1 << 16
TOKEN = "token"
IMAGE_THREADS = 4  # as many parts as the page asks for at once
HTML = "live.html"
STYLES = ("player.css", "live.css")
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
# The browser takes nothing from elsewhere, and keeps nothing.
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Guarded(RequestHandler):
    """Refuses requests that do not come from the page itself, and sends no details."""

    def set_default_headers(self) -> None:
        """Set `HEADERS`."""
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Check the names under which the request was made and by whom."""
        hosts = self.settings["hosts"]
        if self.request.host not in hosts:
            raise HTTPError(403, reason="unknown host")
        origin = self.request.headers.get("Origin")
        site = self.request.headers.get("Sec-Fetch-Site", "none")
        foreign = origin is not None and origin not in {f"http://{host}" for host in hosts}
        if foreign or site not in ("same-origin", "none"):
            raise HTTPError(403, reason="another page asks")

    def write_error(self, status_code: int, **_: Any) -> None:
        """Send an error without details of the server."""
        self.finish({"error": self._reason})

    async def get(self) -> None:
        """Answer that there is no such page."""
        raise HTTPError(404)

    post = get


class PageFile(Guarded):
    """The page, its scripts and styles: a fixed list, read when the server starts."""

    async def get(self) -> None:
        """Answer with one of them."""
        name, content = self.settings["files"][self.request.path]
        self.set_header("Content-Type", f"{TYPES[Path(name).suffix]}; charset=utf-8")
        self.finish(content)


class Query(Guarded):
    """One question to an Object File, answered in a thread of its own kind."""

    def initialize(self, answer: Callable[[int, Any], Answer], threads: ThreadPoolExecutor) -> None:
        """Take what answers, and where."""
        self._answer, self._threads = answer, threads
        self._answering: Future[Answer] | None = None

    def prepare(self) -> None:
        """Check the token, too."""
        super().prepare()
        token = self.get_query_argument(TOKEN, "").encode()
        if not hmac.compare_digest(token, self.settings["token"].encode()):
            raise HTTPError(403, reason="not the address that was printed")

    def on_connection_close(self) -> None:
        """Drop a question that nobody waits for any more, unless it is being answered."""
        if self._answering is not None:
            self._answering.cancel()

    async def post(self) -> None:
        """Answer JSON with what `packed` makes of the answer."""
        try:
            number, query = self._question()
            answer = await self._answered(number, query)
        except asyncio.CancelledError:  # dropped
            return
        except (ObjectFolderError, ValueError, OSError, RecursionError) as error:
            self.set_status(400)
            self.finish({"error": str(error)})
            return
        self.set_header("Content-Type", "application/octet-stream")
        await self._send(number, query, answer)

    async def _send(self, number: int, query: dict[str, Any], answer: Answer) -> None:
        self.finish(packed(*answer))

    def _question(self) -> tuple[int, dict[str, Any]]:
        if self.request.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            raise HTTPError(415, reason="the Content-Type must be application/json")
        query = json.loads(self.request.body)
        if not isinstance(query, dict):
            raise ValueError("not a JSON object")
        return int(self.get_query_argument("object", "0")), query

    async def _answered(self, number: int, query: dict[str, Any]) -> Answer:
        self._answering = self._threads.submit(self._answer, number, query)
        return await asyncio.wrap_future(self._answering)


class Stream(Query):
    """One question, answered again and again from where the last answer ended, until the page is gone."""

    async def _send(self, number: int, query: dict[str, Any], answer: Answer) -> None:
        """Send each answer as `packed` makes it, after its length in four bytes."""
        with contextlib.suppress(asyncio.CancelledError, StreamClosedError):  # nobody listens any more
            while True:
                part = packed(*answer)
                self.write(len(part).to_bytes(4, "little") + part)
                await self.flush()
                query["since"] = answer[0]["next"]
                answer = await self._answered(number, query)


def packed(header: Mapping[str, Any], payload: bytes) -> bytes:
    """Return the length of a JSON header in four bytes, the header, and the bytes."""
    text = json.dumps(header, allow_nan=False).encode()
    return len(text).to_bytes(4, "little") + text + payload


Asked = tuple[Callable[[int, Any], Answer], ThreadPoolExecutor]


@dataclass(frozen=True)
class Page:
    """What a server offers.

    Parameters
    ----------
    script
        Of the folder of pages, which has all that it imports. It fills the page.
    questions
        What answers each, and in which threads.
    warm
        What is done first, and where.
    streams
        What answers one question without end: each header says what is asked for ``since`` in the next.
    """

    script: str
    questions: Mapping[str, Asked]
    warm: Sequence[tuple[Callable[[], None], ThreadPoolExecutor]] = ()
    streams: Mapping[str, Asked] = field(default_factory=dict)

    def files(self) -> dict[str, tuple[str, bytes]]:
        """Return name and content of each file by its path."""
        scripts = sorted(path.name for path in PAGE.glob("*.js"))
        files = {f"/{name}": (name, (PAGE / name).read_bytes()) for name in (*STYLES, *scripts)}
        page = (PAGE / HTML).read_bytes().replace(b"SCRIPT", self.script.encode())
        return {"/": (HTML, page), **files}


class Server:
    """A page that listens at `address`; port 0 takes a free one. Questions need the token, if there is one.

    Raises
    ------
    InputError
        A port that is taken or may not be used.
    """

    def __init__(self, page: Page, port: int = 0, token: str = "") -> None:
        try:
            self._sockets = bind_sockets(port, ADDRESS)
        except (OSError, OverflowError) as error:
            raise InputError("--port", f"{port}: {error}", "Name another one, or 0 for any.") from error
        self._port = self._sockets[0].getsockname()[1]
        self._token = token
        self.address = f"http://{ADDRESS}:{self._port}/" + (f"?{TOKEN}={token}" if token else "")
        self._page = page

    async def serve(self, until: Awaitable[Any]) -> None:
        """Answer requests until something has happened."""
        page, files = self._page, self._page.files()
        rules: list[Any] = [(path, PageFile) for path in files]
        for handler, answers in ((Query, page.questions), (Stream, page.streams)):
            for name, (answer, threads) in answers.items():
                rules.append((f"/{name}", handler, {"answer": answer, "threads": threads}))
        application = Application(
            rules,
            default_handler_class=Guarded,
            hosts={f"{name}:{self._port}" for name in (ADDRESS, "localhost")},
            files=files,
            token=self._token,
            log_function=lambda _: None,
        )
        server = HTTPServer(application, max_body_size=LARGEST_REQUEST, max_buffer_size=2 * LARGEST_REQUEST)
        server.add_sockets(self._sockets)
        for prepare, threads in page.warm:
            threads.submit(prepare)
        try:
            await until
        finally:
            server.stop()
            await server.close_all_connections()
            for _, threads in (*page.questions.values(), *page.streams.values()):
                threads.shutdown(wait=False, cancel_futures=True)


def page_of_objects(live: LiveObjects) -> Page:
    """Return the page of Object Files."""
    # A sound never waits for an image, whose parts the page asks for side by side.
    images, contacts = ThreadPoolExecutor(min(IMAGE_THREADS, os.cpu_count() or 1)), ThreadPoolExecutor(1)
    questions = {
        name: (partial(live.answer, name), images if name == "render" else contacts)
        for name in ("render", "object", "strike", "partials", "press")
    }
    warm = ((live[0].warm_images, images), (live[0].warm_contacts, contacts))
    return Page("live.js", questions, warm)


def view(paths: Sequence[Path], port: int, open_browser: bool) -> None:
    """Serve Object Files, and those in folders, until Ctrl-C.

    Raises
    ------
    FormatError
        No Object File, or a damaged one.
    FileNotFoundError
        No such file.
    InputError
        A port that cannot be had, or a folder without Object Files.
    """
    files = object_files_of(paths)
    one_thread_each()
    serve_until_stopped(paths[0], page_of_objects(LiveObjects(files)), port, open_browser)


def one_thread_each() -> None:
    """Let libraries compute each answer on one core: it is small, and waiting threads would only delay it.

    Those that are not loaded yet read the variables. Numba is told nothing: where its variables change it
    reads all of them again, forgets the target that `objectfolder.jit` set, and finds no kernel in the cache.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    threadpool_limits(1)


def serve_until_stopped(subject: Path, page: Page, port: int, open_browser: bool) -> None:
    """Serve a page of something until Ctrl-C.

    Raises
    ------
    InputError
        A port that cannot be had.
    """
    server = Server(page, port, secrets.token_urlsafe(16))

    async def serve() -> None:
        end = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, end.set)
        print(f"{subject}: {server.address} (Ctrl-C ends it)", flush=True)
        if open_browser:
            # Some browsers return when they are closed: nothing waits for them.
            threading.Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
        await server.serve(end.wait())

    asyncio.run(serve())
