"""Files from servers into a cache: resumed, verified, and never half there."""

import hashlib
import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import requests

from objectfolder.errors import FormatError
from pipeline.intake.sources.answers import continues, length, marks_its_end, validator
from pipeline.intake.sources.cached_file import CachedFile, Digests, Whole, writing
from pipeline.intake.sources.expectation import REMEDY, Expected, TooLargeError
from pipeline.intake.sources.patience import Patience
from pipeline.intake.sources.web import Transient, Web, blocks, check_address

LIMIT_BYTES = 2 << 30
LIMIT_JSON_BYTES = 32 << 20
Progress = Callable[[str, int, int | None], None]


class Downloader:
    """Fetches files into a cache that processes may share.

    Parameters
    ----------
    cache
        Folder; a file lies in it under its address.
    proxies
        By scheme, ``{"https": "http://proxy:3128"}``; where none is given for a scheme, the usual
        variables of the environment hold (``HTTPS_PROXY``, ``NO_PROXY``).
    mirrors
        Starts of addresses, and what is asked instead of them. The cache keeps files under the
        addresses as they were given.
    requests_per_second
        To one host, at most.
    patience_s
        How long to go on trying while nothing new comes, waits included. A server that asks for a longer
        wait is given up at once.
    timeout_s
        Without a byte, after which a connection is given up and another tried.
    backoff_s
        Wait after a second failure in a row; it doubles from there.
    progress
        Called with the address, the bytes there are so far, which become fewer when it has to start
        again, and those of the whole where they are known.

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
        requests_per_second: float = 2.0,
        patience_s: float = 120.0,
        timeout_s: float = 30.0,
        backoff_s: float = 1.0,
        progress: Progress | None = None,
    ) -> None:
        self._cache = Path(cache)
        self._web = Web(
            proxies=proxies, mirrors=mirrors, requests_per_second=requests_per_second, timeout_s=timeout_s
        )
        self._patience_s = patience_s
        self._backoff_s = backoff_s
        self._progress = progress or (lambda url, count, total: None)

    def file(
        self,
        url: str,
        *,
        sha256: str | None = None,
        md5: str | None = None,
        size: int | None = None,
        limit_bytes: int = LIMIT_BYTES,
    ) -> Path:
        """Return a verified file in the cache, fetched where it is not there.

        Parameters
        ----------
        sha256, md5, size
            Of the content, where they are known. A file in the cache is checked against them, and against
            what it was when it came.
        limit_bytes
            The most that it may be.

        Raises
        ------
        AbsentError, RefusedError
            Its server answers 404 or 410, or another 4xx that does not pass.
        InputError
            It cannot be fetched or written, or is too large.
        FormatError
            It is another than expected.
        """
        check_address(url)
        expected = Expected(url, sha256, md5, size, limit_bytes)
        cached = CachedFile(self._cache, url)
        with cached.alone():
            found = cached.kept()
            if found is None or expected.differs(found):
                self._fetch(url, cached, expected)
        return cached.path

    def json(self, url: str, limit_bytes: int = LIMIT_JSON_BYTES) -> Any:
        """Return a small document, which is not kept; see `file` for what is raised."""
        patience = Patience(url, self._patience_s, self._backoff_s)
        expected = Expected(url, None, None, None, limit_bytes)
        while True:
            content = io.BytesIO()
            try:
                with self._web.get(url, {"Accept": "application/json"}) as response:
                    if response.status_code != 200:
                        raise Transient(f"its server answers {response.status_code}")
                    self._pour(expected, response, content, None, patience, decoded=True)
                break
            except Transient as problem:
                patience.wait(problem)
        try:
            return json.loads(content.getvalue())
        except (ValueError, RecursionError) as error:
            raise FormatError(
                url, "its server answers with no JSON", "Look at it in a browser: a proxy may stand between."
            ) from error

    def forget(self, url: str) -> None:
        """Remove what the cache has of an address, as when its content turns out to be damaged."""
        check_address(url)
        cached = CachedFile(self._cache, url)
        with cached.alone():
            cached.forget()

    def _fetch(self, url: str, cached: CachedFile, expected: Expected) -> None:
        """Bring all of a file, verify it, and give it its name."""
        patience = Patience(url, self._patience_s, self._backoff_s)
        wrong = False
        while True:
            try:
                resumed = self._attempt(url, cached, expected, patience)
            except Transient as problem:
                patience.wait(problem)
                continue
            with writing(cached.partial):
                found = Digests.of(cached.partial)
            difference = expected.differs(found)
            if not difference:
                cached.finish(found)
                return
            cached.discard()
            if wrong or not resumed:  # what was there before may have been another's
                raise FormatError(url, difference, REMEDY)
            wrong = True

    def _attempt(self, url: str, cached: CachedFile, expected: Expected, patience: Patience) -> bool:
        """Append what is missing; return whether some was there before."""
        count, whole = cached.come()
        # A mirror's address may have a password in it, which is not for the disk.
        asked = hashlib.sha256(self._web.address(url).encode("utf-8", "surrogatepass")).hexdigest()
        if whole is None or whole.asked != asked or not (whole.validator or expected.hashed):
            count, whole = 0, None
        if whole is not None and count == whole.total:
            return True
        headers = {}
        if whole is not None and count:
            headers["Range"] = f"bytes={count}-"
            if whole.validator:
                headers["If-Range"] = whole.validator
        with self._web.get(url, headers) as response:
            resumed = whole is not None and count > 0 and continues(response, count, whole)
            if not resumed:
                count, whole = 0, _begun(response, asked, cached, expected)
            total = whole.total if whole is not None else None
            if total is not None:
                cached.check_space(total - count)
            with writing(cached.partial):
                file = cached.partial.open("ab")
            with file:
                try:
                    self._pour(expected, response, file, total, patience, start=count)
                except TooLargeError:
                    cached.discard()
                    raise
        return resumed

    def _pour(
        self,
        expected: Expected,
        response: requests.Response,
        file: BinaryIO,
        total: int | None,
        patience: Patience,
        *,
        start: int = 0,
        decoded: bool = False,
    ) -> None:
        """Write a body as it comes."""
        count = start
        self._progress(expected.url, count, total)
        patience.answered()
        for block in blocks(response, decoded):
            count += len(block)
            expected.check_limit(count)
            if total is not None and count > total:
                raise Transient(f"its server sends more than the {total} bytes it told of")
            with writing(Path(getattr(file, "name", expected.url))):
                file.write(block)
                file.flush()
            patience.came(count)
            self._progress(expected.url, count, total)
        if total is not None and count < total:
            raise Transient(f"{count} bytes came of {total}")


def _begun(response: requests.Response, asked: str, cached: CachedFile, expected: Expected) -> Whole:
    """Forget what has come before, and return what an answer is that has all of a file."""
    if response.status_code != 200:
        cached.discard()
        raise Transient(f"its server sends another part than asked for ({response.status_code})")
    total = length(response)
    if total is None and not marks_its_end(response):
        expected.check_end()
        total = expected.size
    if total is not None:
        expected.check_size(total)
    whole = Whole(asked, validator(response), total)
    cached.begin(whole)
    return whole
