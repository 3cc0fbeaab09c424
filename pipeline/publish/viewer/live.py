"""The page of Object Files, one at a time, served to the browser of this machine.

It listens on 127.0.0.1. Requests under any other name of host are refused, so that no page of the web
reaches it through a name that points here, and so are those that another page's script sends.
Nothing is read from disk by a path that a request names.
"""

import asyncio
import json
import os
import signal
import threading
import webbrowser
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.publish.viewer.live_queries import Answer, LiveObjects
from pipeline.publish.viewer.static import PAGE, SHARED_SCRIPTS

ADDRESS = "127.0.0.1"
LARGEST_REQUEST = 1 << 16
IMAGE_THREADS = 4  # as many parts as the page asks for at once
FILES_OF = "*.safetensors"  # a folder
SCRIPTS = (*SHARED_SCRIPTS, "live_object.js", "live.js")
FILES = {"/": "live.html", "/player.css": "player.css", "/live.css": "live.css"} | {
    f"/{name}": name for name in SCRIPTS
}
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

    async def post(self) -> None:
        """Answer JSON: the length of a JSON header in four bytes, the header, the bytes."""
        if self.request.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            raise HTTPError(415, reason="application/json is wanted")
        try:
            asked = json.loads(self.request.body)
            if not isinstance(asked, dict):
                raise ValueError("not a JSON object")
            number = int(self.get_query_argument("object", "0"))
            header, payload = await asyncio.get_running_loop().run_in_executor(
                self._threads, self._answer, number, asked
            )
        except (ObjectFolderError, ValueError, OSError, RecursionError) as error:
            self.set_status(400)
            self.finish({"error": str(error)})
            return
        text = json.dumps(header, allow_nan=False).encode()
        self.set_header("Content-Type", "application/octet-stream")
        self.finish(len(text).to_bytes(4, "little") + text + payload)


class Server:
    """Live objects that listen at `address`; port 0 takes a free one.

    Raises
    ------
    InputError
        A port that is taken or may not be used.
    """

    def __init__(self, live: LiveObjects, port: int = 0) -> None:
        try:
            self._sockets = bind_sockets(port, ADDRESS)
        except (OSError, OverflowError) as error:
            raise InputError("--port", f"{port}: {error}", "Name another one, or 0 for any.") from error
        self._port = self._sockets[0].getsockname()[1]
        self.address = f"http://{ADDRESS}:{self._port}/"
        # A sound never waits for an image, whose parts the page asks for side by side.
        images = min(IMAGE_THREADS, os.cpu_count() or 1)
        self._images, self._contacts = ThreadPoolExecutor(images), ThreadPoolExecutor(1)
        self._live = live

    async def serve(self, until: Awaitable[Any]) -> None:
        """Answer requests until something has happened."""
        live = self._live
        rules: list[Any] = [(path, PageFile) for path in FILES]
        for name in ("render", "object", "strike", "partials", "press"):
            threads = self._images if name == "render" else self._contacts
            rules.append((f"/{name}", Query, {"answer": partial(live.answer, name), "threads": threads}))
        application = Application(
            rules,
            default_handler_class=Guarded,
            hosts={f"{name}:{self._port}" for name in (ADDRESS, "localhost")},
            files={path: (name, _content(name)) for path, name in FILES.items()},
            log_function=lambda _: None,
        )
        server = HTTPServer(application, max_body_size=LARGEST_REQUEST, max_buffer_size=2 * LARGEST_REQUEST)
        server.add_sockets(self._sockets)
        self._images.submit(live[0].warm_images)
        self._contacts.submit(live[0].warm_contacts)
        try:
            await until
        finally:
            server.stop()
            await server.close_all_connections()
            for threads in (self._images, self._contacts):
                threads.shutdown(wait=False, cancel_futures=True)


def _content(name: str) -> bytes:
    scripts = "".join(f'<script src="{script}" defer></script>\n' for script in SCRIPTS)
    return (PAGE / name).read_text(encoding="utf-8").replace("SCRIPTS", scripts).encode()


def serve_until_stopped(paths: Sequence[Path], port: int, open_browser: bool) -> None:
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
    found = [file for path in paths for file in (sorted(path.glob(FILES_OF)) if path.is_dir() else [path])]
    if not found:
        raise InputError(" ".join(map(str, paths)) or "FILE", f"no Object File ({FILES_OF})", "Name one.")
    # One core for each answer: what libraries compute here is small, and waiting threads would only delay it.
    # Those that are not loaded yet read the variables.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    threadpool_limits(1)
    server = Server(LiveObjects(found), port)

    async def serve() -> None:
        stopped = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, stopped.set)
        print(f"{paths[0]}: {server.address} (Ctrl-C ends it)", flush=True)
        if open_browser:
            # Some browsers return when they are closed: nothing waits for them.
            threading.Thread(target=webbrowser.open, args=(server.address,), daemon=True).start()
        await server.serve(stopped.wait())

    asyncio.run(serve())
