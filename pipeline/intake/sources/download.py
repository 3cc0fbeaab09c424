"""Files from servers into a cache that processes share: verified, and whole or not there."""

import contextlib
import hashlib
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote

import requests
from pydantic import TypeAdapter, ValidationError
from urllib3.exceptions import HTTPError, MaxRetryError, ProtocolError

from objectfolder.errors import FormatError, InputError
from objectfolder.products.atomic import PARTIAL, atomic_write
from objectfolder.products.regular_file import open_regular
from pipeline.intake.disk import locked, writing
from pipeline.intake.sources.http_client import (
    RETRY_REMEDY,
    UnreachableError,
    check_answer,
    failure,
    finding_of,
    retrying_session,
)

CONNECT_S = 10.0
LIMIT_BYTES = 2 << 30
LIMIT_JSON_BYTES = 32 << 20
LONGEST_S = 6 * 3600.0  # of one file, pauses included
BLOCK_BYTES = 64 << 10
REMEDY = (
    "Nothing of it is kept. The source has changed or a proxy stands between: compare with a mirror, and "
    "record what is new only if it is right."
)
Progress = Callable[[str, int, int | None], None]


@dataclass(frozen=True)
class Expected:
    """What is known of a file before its download; None for what is not known."""

    url: str
    md5: str | None
    size: int | None
    limit_bytes: int

    def difference(self, path: Path) -> str:
        """Return how a file differs from what is expected, with both values; empty if it does not."""
        with open_regular(path) as file:
            return self.mismatch(path.stat().st_size, hashlib.file_digest(file, "md5").hexdigest())

    def mismatch(self, size: int, md5: str) -> str:
        """Return how size and MD5 of a file differ from what is expected; empty if they do not."""
        for name, value, expectation in (("size", size, self.size), ("md5", md5, self.md5)):
            if expectation is not None and str(expectation).lower() != str(value):
                return f"differs from what is known of it: its {name} is {value}, not {expectation}"
        return ""


def cached_path(cache: Path, url: str) -> Path:
    """Return where a cache has the file of an address: in a folder of its own, under a plain name."""
    name = unquote(re.split("[?#]", url)[0]).rpartition("/")[2]
    plain = re.sub(r"[^A-Za-z0-9._-]", "_", name)[-100:].lstrip(".") or "file"
    return cache / hashlib.sha256(url.encode("utf-8", "surrogatepass")).hexdigest()[:32] / plain


class Downloader:
    """Fetches files into a cache that processes may share.

    Parameters
    ----------
    cache
        Folder; a file lies in it under its address.
    proxies
        By scheme, ``{"https": "http://proxy:3128"}``; the environment's variables hold for others.
    mirrors
        Starts of addresses and what stands in their place; the longest that fits is taken.
    timeout_s
        Without a byte.
    retries
        How often to ask for a file again. A server that asks for a wait of more than
        `http_client.LONGEST_WAIT_S` is given up at once.
    backoff_s
        Wait before the second retry; it doubles from there.
    progress
        Called with the address, the bytes there are, which become fewer where it begins again, and those
        of the whole where they are known.
    """

    def __init__(
        self,
        cache: Path,
        *,
        proxies: Mapping[str, str] | None = None,
        mirrors: Mapping[str, str] | None = None,
        retries: int = 6,
        timeout_s: float = 30.0,
        backoff_s: float = 1.0,
        progress: Progress | None = None,
    ) -> None:
        self._cache = Path(cache)
        self._proxies = dict(proxies or {})
        self._mirrors = dict(sorted((mirrors or {}).items(), key=lambda pair: -len(pair[0])))
        self._timeout_s = timeout_s
        self._session, self._retry = retrying_session(retries, backoff_s)
        self._progress = progress or (lambda url, count, total: None)

    def file(
        self, url: str, *, md5: str | None = None, size: int | None = None, limit_bytes: int = LIMIT_BYTES
    ) -> Path:
        """Return a verified file in the cache, fetched where it is not there; `md5` and `size` where known.

        Raises
        ------
        AbsentError, RefusedError
            Its server answers 404 or 410, or another 4xx that does not pass.
        InputError
            It cannot be fetched or written, or is too large.
        FormatError
            It is another than expected.
        """
        return self._file(self._cache, Expected(url, md5, size, limit_bytes))

    def json(self, url: str, kind: Any = Any, limit_bytes: int = LIMIT_JSON_BYTES) -> Any:
        """Return a small document as `kind`; it is not kept. See `file` for what is raised."""
        with tempfile.TemporaryDirectory() as folder:
            content = self._file(Path(folder), Expected(url, None, None, limit_bytes)).read_bytes()
        try:
            return TypeAdapter(kind).validate_json(content)
        except ValidationError as error:
            detail = error.errors(include_url=False)[0]
            finding = f"its server's answer is not JSON of the expected form ({detail['msg']})"
            remedy = "Open it in a browser: a proxy may answer in its place. Or use a mirror."
            raise FormatError(url, finding, remedy) from error

    def forget(self, url: str) -> None:
        """Remove what the cache has of an address, as when its content turns out to be damaged."""
        path = cached_path(self._cache, url)
        with locked(path.with_name(".lock")), writing(path):
            path.unlink(missing_ok=True)

    def _file(self, cache: Path, expectation: Expected) -> Path:
        path = cached_path(cache, expectation.url)
        with locked(path.with_name(".lock")), writing(path):
            if not path.is_file() or expectation.difference(path):
                for leftover in path.parent.glob(f".*{PARTIAL}"):  # by a process that was killed
                    leftover.unlink()
                self._fetch(path, expectation)
        return path

    def _fetch(self, path: Path, expectation: Expected) -> None:
        """Bring all of a file and verify it before it has its name; again where its body breaks off."""
        retry, end = self._retry, time.monotonic() + LONGEST_S
        while True:
            try:
                with atomic_write(path) as file:
                    return self._receive(file, expectation, end)
            except HTTPError as problem:
                finding = finding_of(problem)
                try:
                    retry = retry.increment("GET", expectation.url, error=ProtocolError(finding))
                except MaxRetryError:
                    finding = f"cannot be fetched: {finding}"
                    raise UnreachableError(expectation.url, finding, RETRY_REMEDY) from problem
            retry.sleep()

    def _receive(self, file: BinaryIO, expectation: Expected, end: float) -> None:
        """Write the body of one answer; raise `HTTPError` where it is not whole."""
        count, digest = 0, hashlib.md5(usedforsecurity=False)
        with self._get(expectation.url) as response:
            total = _total(response, expectation)
            self._progress(expectation.url, count, total)
            for block in response.raw.stream(BLOCK_BYTES, decode_content=False):
                count += len(block)
                if max(count, total or 0) > expectation.limit_bytes:
                    remedy = "No such file should be that large; look at it before fetching it."
                    raise InputError(expectation.url, f"larger than {expectation.limit_bytes} bytes", remedy)
                if time.monotonic() > end:
                    finding = f"not there after {LONGEST_S / 3600:g} hours"
                    raise UnreachableError(expectation.url, finding, RETRY_REMEDY)
                file.write(block)
                digest.update(block)
                self._progress(expectation.url, count, total)
        if difference := expectation.mismatch(count, digest.hexdigest()):
            raise FormatError(expectation.url, difference, REMEDY)

    @contextlib.contextmanager
    def _get(self, url: str) -> Iterator[requests.Response]:
        """Ask for `url` or its mirror; yield an answer of 200, its body not read."""
        start = next((start for start in self._mirrors if url.startswith(start)), "")
        address = self._mirrors.get(start, "") + url.removeprefix(start)
        timeouts = min(CONNECT_S, self._timeout_s), self._timeout_s
        try:
            response = self._session.get(address, stream=True, timeout=timeouts, proxies=dict(self._proxies))
        except (requests.RequestException, HTTPError, OSError, ValueError) as error:
            raise failure(url, error) from error
        with response:
            check_answer(url, response)
            yield response


def _total(response: requests.Response, expectation: Expected) -> int | None:
    """Return the bytes of the whole file; None where the last chunk will tell."""
    if response.headers.get("Transfer-Encoding", "").lower() == "chunked":
        return None
    length = response.headers.get("Content-Length", "")
    if length.isdecimal():
        return int(length)
    if expectation.size is None and expectation.md5 is None:
        raise InputError(
            expectation.url,
            "its server does not say how long it is, so a cut connection would pass for its end",
            "Use a mirror.",
        )
    return expectation.size
