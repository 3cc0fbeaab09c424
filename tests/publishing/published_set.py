"""A small data set published as a git repository under DVC: two versions, and what serves them."""

import contextlib
import os
import re
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np

from objectfolder.products.store import Array, Product, write_product
from objectfolder.products.tensor_file import TensorFile, write_tensor_file

GIT = {f"GIT_{who}_{what}": "t@t" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
IDS = ("cup", "fork", "mug")


def command(root: Path, *words: str) -> str:
    """Run git in a folder."""
    environment = {**os.environ, **GIT}
    done = subprocess.run(words, cwd=root, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def object_file(version: int, index: int) -> TensorFile:
    """A megabyte or so that compresses badly, as fitted tensors."""
    values = np.random.default_rng([version, index]).integers(0, 255, 1_500_000).astype(np.uint8)
    return TensorFile({"surface.positions": values}, {"format": "objectfolder"})


def write_version(root: Path, version: int) -> dict[str, bytes]:
    """Write Object Files and views of a version; return the bytes of the Object Files."""
    for index, object_id in enumerate(IDS):
        path = root / f"data/object_files/{object_id}.safetensors"
        write_tensor_file(path, object_file(version, index))
        image = Array(np.full((2, 3), version), ("view", "x"), "1", "views")
        write_product(root / f"data/views/{object_id}.zarr.zip", Product({"rgba": image}))
    return {path.name: path.read_bytes() for path in sorted((root / "data/object_files").iterdir())}


def publish(
    root: Path, remote: str, settings: str = "", versions: tuple[int, ...] = (1, 2)
) -> list[dict[str, bytes]]:
    """Make the repository at `root` with versions ``v1`` and so on, pushed to `remote`."""
    from dvc.repo import Repo

    root.mkdir(parents=True)
    command(root, "git", "init", "-q", "-b", "main")
    Repo.init(str(root)).close()
    (root / ".dvc/config").write_text(
        "[core]\n    remote = store\n    analytics = false\n"
        f"['remote \"store\"']\n    url = {remote}\n{settings}"
    )
    contents = []
    for number in versions:
        contents.append(write_version(root, number))
        with contextlib.chdir(root), Repo(str(root)) as repository:
            repository.add(["data/object_files", "data/views"])
            repository.push()
        command(root, "git", "add", "-A")
        command(root, "git", "commit", "-qm", f"version {number}")
        command(root, "git", "tag", f"v{number}")
    return contents


class Server:
    """Files of a folder by HTTP, with ranges; answers end before byte `cut_at` of a file, `cuts` times."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ranges = True
        self.cut_at, self.cuts = 0, 0
        self.sent: dict[str, int] = {}
        self.address = ""


class _Quiet(ThreadingHTTPServer):
    """A server that says nothing of clients that hang up."""

    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing."""


@contextlib.contextmanager
def serving(server: Server) -> Iterator[Server]:
    """Serve while the context lasts."""
    handler = type("Handler", (_Handler,), {"server_state": server})
    http = _Quiet(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=http.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    server.address = f"http://127.0.0.1:{http.server_address[1]}"
    try:
        yield server
    finally:
        http.shutdown()
        http.server_close()
        thread.join()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_state: Server

    def log_message(self, *_: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def do_GET(self) -> None:
        self._answer(body=True)

    def _answer(self, body: bool) -> None:
        state = self.server_state
        path = state.folder / self.path.lstrip("/")
        if not path.is_file():
            self.send_error(404)
            return
        content = path.read_bytes()
        byte_range = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        size, part, start = len(content), content, 0
        if byte_range and state.ranges:
            first, last = int(byte_range[1]), int(byte_range[2] or size - 1)
            part = content[first : last + 1]
            start = first
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {first}-{first + len(part) - 1}/{size}")
        else:
            self.send_response(200)
        if state.ranges:
            self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        if not body:
            return
        if state.cuts and start + len(part) > state.cut_at:
            part = part[: max(0, state.cut_at - start)]
            state.cuts -= 1
            self.close_connection = True
        state.sent[path.name] = state.sent.get(path.name, 0) + len(part)
        self.wfile.write(part)
        if self.close_connection:
            self.connection.close()
