"""Files from servers into a cache that processes share: resumed, verified, and whole or not there."""

import contextlib
import hashlib
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import requests
from pydantic import TypeAdapter, ValidationError
from urllib3.exceptions import HTTPError, MaxRetryError

from objectfolder.errors import FormatError, InputError
from objectfolder.products.atomic import write_whole
from objectfolder.products.regular_file import open_regular
from pipeline.intake.disk import locked, writing
from pipeline.intake.sources.http_client import (
    LEAST_BYTES,
    RETRY_REMEDY,
    InterruptedBodyError,
    UnreachableError,
    body,
    check_answer,
    failure,
    retrying_session,
)

CONNECT_S = 10.0
LIMIT_BYTES = 2 << 30
LIMIT_JSON_BYTES = 32 << 20
LONGEST_S = 6 * 3600.0  # of one file, pauses included
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
            actual = {"size": path.stat().st_size, "md5": hashlib.file_digest(file, "md5").hexdigest()}
        for name, value in actual.items():
            expected = getattr(self, name)
            if expected is not None and str(expected).lower() != str(value):
                return f"differs from what is known of it: its {name} is {value}, not {expected}"
        return ""


class CachedFile:
    """The folder of an address in a cache; the file has its final name only once it is verified."""

    def __init__(self, cache: Path, url: str) -> None:
        self.folder = cache / hashlib.sha256(url.encode("utf-8", "surrogatepass")).hexdigest()[:32]
        name = unquote(re.split("[?#]", url)[0]).rpartition("/")[2]
        plain = re.sub(r"[^A-Za-z0-9._-]", "_", name)[-100:].lstrip(".") or "file"
        self.path, self.partial = self.folder / plain, self.folder / ".partial"
        self._version = self.folder / ".partial.etag"

    def resumable(self) -> tuple[int, str]:
        """Return the bytes that are there and the ETag of their version; 0 where they cannot be used."""
        try:
            return self.partial.stat().st_size, self._version.read_text("utf-8")
        except FileNotFoundError:
            return 0, ""

    def begin(self, etag: str) -> None:
        """Discard the part that is there, and note the version of the next."""
        # In this order a killed process leaves nothing that looks like a part of another version.
        self.discard()
        self.partial.touch()
        if re.fullmatch(r'"[!#-~]*"', etag):  # a strong one: it changes with every byte
            write_whole(self._version, etag)

    def finish(self) -> None:
        """Give the whole file its name."""
        with self.partial.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(self.partial, self.path)
        self.discard()

    def discard(self) -> None:
        """Remove the part that is there."""
        self._version.unlink(missing_ok=True)
        self.partial.unlink(missing_ok=True)


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
        How often to ask again while nothing new arrives. A server that asks for a wait of more than
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
        cached = CachedFile(self._cache, url)
        with locked(cached.folder / ".lock"), writing(cached.path):
            cached.path.unlink(missing_ok=True)
            cached.discard()

    def _file(self, cache: Path, expected: Expected) -> Path:
        cached = CachedFile(cache, expected.url)
        with locked(cached.folder / ".lock"), writing(cached.path):
            if not cached.path.is_file() or expected.difference(cached.path):
                self._fetch(cached, expected)
        return cached.path

    def _fetch(self, cached: CachedFile, expected: Expected) -> None:
        """Bring all of a file, verify it, and give it its name."""
        for _ in range(2):  # an earlier part may be damaged: then from the beginning
            resumed = self._completed(cached, expected)
            difference = expected.difference(cached.partial)
            if not difference:
                return cached.finish()
            cached.discard()
            if not resumed:
                break
        raise FormatError(expected.url, difference, REMEDY)

    def _completed(self, cached: CachedFile, expected: Expected) -> bool:
        """Append what is missing, also where the body breaks off; return whether some was there before."""
        # Attempts that add `LEAST_BYTES` to the furthest are not counted.
        retry, furthest = self._retry, cached.resumable()[0]
        end = time.monotonic() + LONGEST_S
        while True:
            try:
                return self._append(cached, expected, end)
            except InterruptedBodyError as problem:
                if (position := cached.resumable()[0]) >= furthest + LEAST_BYTES:
                    retry, furthest = self._retry, position
                try:
                    retry = retry.increment("GET", expected.url, error=problem)
                except MaxRetryError:
                    finding = f"cannot be fetched: {problem}"
                    raise UnreachableError(expected.url, finding, RETRY_REMEDY) from problem
                retry.sleep()

    def _append(self, cached: CachedFile, expected: Expected, end: float) -> bool:
        """Ask once for what is missing; return whether some was there before."""
        count, etag = cached.resumable()
        headers = {"Range": f"bytes={count}-", "If-Range": etag} if count else {}
        with self._get(expected.url, headers) as response:
            part = response.headers.get("Content-Range", "")
            if response.status_code == 416:
                if part == f"bytes */{count}":
                    return True  # all of it was there
                if not count:
                    remedy = "Use a mirror: this server refuses a request for a whole file."
                    raise InputError(expected.url, "its server has no part of it (416)", remedy)
            content_range = re.fullmatch(rf"bytes {count}-(\d+)/(\d+)", part)
            resumed = response.status_code == 206 and content_range is not None and count > 0
            if not resumed or response.headers.get("ETag", etag) != etag:
                count, resumed = 0, False
                cached.begin(response.headers.get("ETag", ""))
                if response.status_code != 200:
                    raise InterruptedBodyError("its server sends another part than asked for")
            total = _total(response, count, expected)
            with cached.partial.open("ab") as file:
                self._progress(expected.url, count, total)
                for block in body(response, self._timeout_s):
                    count += len(block)
                    if max(count, total or 0) > expected.limit_bytes:
                        cached.discard()
                        remedy = "No such file should be that large; look at it before fetching it."
                        finding = f"larger than {expected.limit_bytes} bytes"
                        raise InputError(expected.url, finding, remedy)
                    file.write(block)
                    file.flush()
                    self._progress(expected.url, count, total)
                    if time.monotonic() > end:
                        finding = f"not there after {LONGEST_S / 3600:g} hours"
                        raise UnreachableError(expected.url, finding, RETRY_REMEDY)
            if resumed and content_range is not None and count != int(content_range[2]):
                raise InterruptedBodyError(f"its server ends after {count} of {content_range[2]} bytes")
        return resumed

    @contextlib.contextmanager
    def _get(self, url: str, headers: Mapping[str, str]) -> Iterator[requests.Response]:
        """Ask for `url` or its mirror; yield an answer of 200, 206 or 416, its body not read."""
        start = next((start for start in self._mirrors if url.startswith(start)), "")
        address = self._mirrors.get(start, "") + url.removeprefix(start)
        timeouts = min(CONNECT_S, self._timeout_s), self._timeout_s
        try:
            response = self._session.get(
                address, headers=headers, stream=True, timeout=timeouts, proxies=dict(self._proxies)
            )
        except (requests.RequestException, HTTPError, OSError, ValueError) as error:
            raise failure(url, error) from error
        with response:
            check_answer(url, response)
            yield response


def _total(response: requests.Response, count: int, expected: Expected) -> int | None:
    """Return the bytes of the whole file, of which `count` are there; None where the last chunk will tell."""
    if response.headers.get("Transfer-Encoding", "").lower() == "chunked":
        return None
    length = response.headers.get("Content-Length", "")
    if length.isdecimal():
        return count + int(length)
    if expected.size is None and expected.md5 is None:
        raise InputError(
            expected.url,
            "its server does not say how long it is, so a cut connection would pass for its end",
            "Use a mirror.",
        )
    return expected.size
