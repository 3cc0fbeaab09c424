"""Files from servers into a cache: resumed, verified, and whole or not there."""

import contextlib
import hashlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import requests
from urllib3.exceptions import HTTPError, MaxRetryError

from objectfolder.errors import FormatError, InputError
from pipeline.intake.disk import writing
from pipeline.intake.sources.cached_file import CachedFile
from pipeline.intake.sources.http_client import (
    CONTENT_RANGE,
    LEAST_BYTES,
    RETRY_REMEDY,
    InterruptedBodyError,
    UnreachableError,
    body,
    check_address,
    check_answer,
    continues,
    failure,
    retry_policy,
    retrying_session,
    validator_of,
)

CONNECT_S = 10.0
LIMIT_BYTES = 2 << 30
LIMIT_JSON_BYTES = 32 << 20
REMEDY = (
    "Nothing of it is kept. The source has changed or a proxy stands between: compare with a mirror, and "
    "record what is new only if it is right."
)
Progress = Callable[[str, int, int | None], None]
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Expected:
    """What is known of a file before its download; None for what is not known."""

    url: str
    md5: str | None
    size: int | None
    limit_bytes: int

    def difference(self, path: Path) -> str:
        """Return in what a file differs, with both values; empty where it does not."""
        with writing(path), path.open("rb") as file:
            found = {"size": path.stat().st_size, "md5": hashlib.file_digest(file, "md5").hexdigest()}
        for name, value in found.items():
            wanted = getattr(self, name)
            if wanted is not None and str(wanted).lower() != str(value):
                return f"differs from what is known of it: its {name} is {value}, not {wanted}"
        return ""

    def check_count(self, count: int) -> None:
        """Raise `InputError` for more bytes than the file may have."""
        if count > self.limit_bytes:
            remedy = "No such file should be that large; look at it before fetching it."
            raise InputError(self.url, f"larger than {self.limit_bytes} bytes", remedy)


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

    Raises
    ------
    InputError
        A mirror that is no address.
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
        for address in (*self._mirrors, *self._mirrors.values()):
            check_address(address)
        self._timeout_s = timeout_s
        self._retry = retry_policy(retries, backoff_s)
        self._session = retrying_session(self._retry)
        self._progress = progress or (lambda url, count, total: None)

    def file(
        self, url: str, *, md5: str | None = None, size: int | None = None, limit_bytes: int = LIMIT_BYTES
    ) -> Path:
        """Return a verified file in the cache, fetched where it is not there.

        Parameters
        ----------
        md5, size
            Of the content, where they are known.
        limit_bytes
            The most that it may have.

        Raises
        ------
        AbsentError, RefusedError
            Its server answers 404 or 410, or another 4xx that does not pass.
        InputError
            It cannot be fetched or written, or is too large.
        FormatError
            It is another than expected.
        """
        cached, expected = self._cached(url), Expected(url, md5, size, limit_bytes)
        with cached.locked():
            if not cached.path.is_file() or expected.difference(cached.path):
                self._fetch(cached, expected)
        return cached.path

    def json(self, url: str, limit_bytes: int = LIMIT_JSON_BYTES) -> Any:
        """Return a small document, which is not kept; see `file` for what is raised."""
        expected = Expected(url, None, None, limit_bytes)
        content = self._retried(url, lambda: self._document(expected), lambda: 0)
        try:
            return json.loads(content)
        except (ValueError, RecursionError) as error:
            remedy = "Open it in a browser: a proxy may answer in its place."
            raise FormatError(url, "its server answers with no JSON", remedy) from error

    def forget(self, url: str) -> None:
        """Remove what the cache has of an address, as when its content turns out to be damaged."""
        cached = self._cached(url)
        with cached.locked(), writing(cached.path):
            cached.path.unlink(missing_ok=True)
            cached.discard()

    def _cached(self, url: str) -> CachedFile:
        check_address(url)
        return CachedFile(self._cache, url)

    @contextlib.contextmanager
    def _get(self, url: str, headers: Mapping[str, str]) -> Iterator[requests.Response]:
        """Ask for `url` or its mirror; yield an answer of 200, 206 or 416, its body not read."""
        start = next((start for start in self._mirrors if url.startswith(start)), "")
        address = self._mirrors.get(start, "") + url.removeprefix(start)
        try:
            response = self._session.get(
                address,
                headers=headers,
                stream=True,
                timeout=(min(CONNECT_S, self._timeout_s), self._timeout_s),
                proxies=dict(self._proxies),
            )
        except (requests.RequestException, HTTPError, OSError, ValueError) as error:
            raise failure(url, error) from error
        with response:
            check_answer(url, response)
            yield response

    def _fetch(self, cached: CachedFile, expected: Expected) -> None:
        """Bring all of a file, verify it, and give it its name."""
        for _ in range(2):  # an earlier part may be damaged: then from the beginning
            resumed = self._retried(
                expected.url, lambda: self._append(cached, expected), lambda: cached.resumable()[0]
            )
            difference = expected.difference(cached.partial)
            if not difference:
                return cached.finish()
            cached.discard()
            if not resumed:
                break
        raise FormatError(expected.url, difference, REMEDY)

    def _retried(self, url: str, attempt: Callable[[], _Result], position: Callable[[], int]) -> _Result:
        """Return what `attempt` returns; try it again while its body breaks off.

        Parameters
        ----------
        position
            Returns how many bytes are kept; attempts that add `LEAST_BYTES` to the furthest are not counted.
        """
        retry, furthest = self._retry, position()
        while True:
            try:
                return attempt()
            except InterruptedBodyError as problem:
                if position() >= furthest + LEAST_BYTES:
                    retry, furthest = self._retry, position()
                try:
                    retry = retry.increment("GET", url, error=problem)
                except MaxRetryError:
                    raise UnreachableError(url, f"cannot be fetched: {problem}", RETRY_REMEDY) from problem
                retry.sleep()

    def _append(self, cached: CachedFile, expected: Expected) -> bool:
        """Append what is missing; return whether some was there before."""
        count, validator = cached.resumable()
        headers = {"Range": f"bytes={count}-", "If-Range": validator} if count else {}
        with self._get(expected.url, headers) as response:
            if response.status_code == 416 and response.headers.get("Content-Range") == f"bytes */{count}":
                return True  # all of it was there
            total = _total(response, expected)
            expected.check_count(total or 0)
            resumed = bool(count) and continues(response, count, validator)
            if not resumed:
                count = 0
                cached.begin(validator_of(response))
                if response.status_code != 200:
                    raise InterruptedBodyError("its server sends another part than asked for")
            with writing(cached.partial):
                file = cached.partial.open("ab")
            with file:
                self._progress(expected.url, count, total)
                for block in body(response, self._timeout_s):
                    count += len(block)
                    if count > expected.limit_bytes:
                        cached.discard()
                    expected.check_count(count)
                    with writing(cached.partial):
                        file.write(block)
                        file.flush()
                    self._progress(expected.url, count, total)
        if total is not None and count < total:
            raise InterruptedBodyError(f"the connection was lost: after {count} of {total} bytes")
        return resumed

    def _document(self, expected: Expected) -> bytes:
        content = io.BytesIO()
        with self._get(expected.url, {"Accept": "application/json"}) as response:
            for block in body(response, self._timeout_s, decoded=True):
                content.write(block)
                expected.check_count(content.tell())
        return content.getvalue()


def _total(response: requests.Response, expected: Expected) -> int | None:
    """Return the bytes of the whole file; None where the end of its last chunk will tell.

    Raises
    ------
    FormatError
        The server says another size than is known.
    InputError
        Nothing tells where the file ends.
    """
    if response.headers.get("Transfer-Encoding", "").lower() == "chunked":
        return None
    matched = CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", ""))
    said = matched[2] if matched else response.headers.get("Content-Length", "")
    if not re.fullmatch(r"[0-9]{1,18}", said):
        if expected.size is None and expected.md5 is None:
            raise InputError(
                expected.url,
                "its server does not say how long it is, so a cut connection would pass for its end",
                "Use a mirror.",
            )
        return expected.size
    if expected.size is not None and int(said) != expected.size:
        finding = f"differs from what is known of it: its size is {said}, not {expected.size}"
        raise FormatError(expected.url, finding, REMEDY)
    return int(said)
